"""Instances of meshes as Mitsuba meshes, whose materials only Mitsuba's own integrators use."""

from dataclasses import replace
from typing import Any

import numpy as np

from app.arrays import F32, F64, Ints
from app.math3d import normal_matrix
from app.scene import Instance, Material, Scene, Texture
from export.reference.mitsuba_lights import SIDE_GAP
from export.reference.textures import linear_pixels

MIN_SAMPLING_WEIGHT = 1e-9  # of an emitter


class MeshConverter:
    """Makes Mitsuba meshes of instances; ``notices`` names what it can't reproduce."""

    def __init__(self, mi: Any, scene: Scene, time: float, origin: F64, scale: float) -> None:
        self._mi, self._scene, self._time, self._origin, self._scale = mi, scene, time, origin, scale
        self.notices: list[str] = []
        self._bsdfs: dict[tuple[int, bool], Any] = {}  # shared, because shading is faster with fewer

    def convert(self, instance: Instance, side: int = 0) -> Any:
        """The instance as a reflecting mesh (``side`` 0), or as an emitter to its front (1) or back (-1)."""
        mi, mesh = self._mi, instance.mesh_at(self._scene.meshes, self._time)
        material = self._scene.materials[mesh.material]
        transform = instance.transform_at(self._time)
        corners = mesh.triangles.ravel()  # unshared vertices, so that a triangle can have its face normal
        points = mesh.positions[corners].astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]
        points = (points - self._origin) * self._scale
        mirrored = np.linalg.det(transform[:3, :3]) < 0
        cofactor = normal_matrix(transform)
        cofactor /= max(float(np.abs(cofactor).max()), 1e-300)
        normals = _shading_normals(mesh.normals[corners] @ cofactor.T, points)
        if side:
            facing = _face_normals(points)
            facing *= (-side if mirrored else side) / np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-300)
            points, normals = points + SIDE_GAP * facing, facing
        texture = _emission_texture(material) if side else material.albedo_map
        uvs = mesh.second_uvs if texture is not None and texture.uv_set == 1 else mesh.uvs
        properties = mi.Properties()
        if side:
            covered = material.alpha if material.is_blended and material.albedo_map is None else 1.0
            emission = tuple(covered * channel for channel in material.emission)
            properties["emitter"] = mi.load_dict({
                "type": "area", "radiance": self._texture(emission, None if uvs is None else texture),
                "sampling_weight": max(_mean_emission(emission, texture) * _area(points), MIN_SAMPLING_WEIGHT)})
        by_vertex = mesh.colors is not None and material.albedo_map is None
        if (mesh.material, by_vertex) not in self._bsdfs:
            self._bsdfs[mesh.material, by_vertex] = self._bsdf(material, by_vertex)
        properties["bsdf"] = self._bsdfs[mesh.material, by_vertex]
        # Shading normals decide to which side an area light emits, the winding which side is the front.
        flip = bool(side) and (mirrored != (side < 0))
        faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)[:, ::-1 if flip else 1]
        converted = mi.Mesh(instance.name, len(corners), len(faces), has_vertex_normals=True,
                            has_vertex_texcoords=uvs is not None, props=properties)
        if mesh.colors is not None:
            colors = mesh.colors[corners].astype(np.float32)
            albedo = colors[:, :3] * np.asarray(material.albedo, np.float32)
            converted.add_attribute("vertex_albedo", 3, albedo.ravel())
            converted.add_attribute("vertex_opacity", 1, _opacity_of(colors[:, 3] * material.alpha, material))
        buffers = mi.traverse(converted)
        buffers["vertex_positions"] = points.astype(np.float32).ravel()
        buffers["vertex_normals"] = normals.astype(np.float32).ravel()
        buffers["faces"] = np.ascontiguousarray(faces).ravel()
        if uvs is not None:
            buffers["vertex_texcoords"] = _texcoords(uvs[corners], texture).astype(np.float32).ravel()
            if side and texture is not None:
                self._note_difference(uvs, texture)
            if side and material.emission_map is not None and material.albedo_map is not None and (
                    material.alpha_cutoff is not None and not _lie_alike(material.emission_map, material.albedo_map)):
                self.notices.append("the path tracer's light ignores a mask with other coordinates than the emission's")
        buffers.update()
        return converted

    def _bsdf(self, material: Material, by_vertex: bool) -> Any:
        reflectance = ({"type": "mesh_attribute", "name": "vertex_albedo"} if by_vertex
                       else self._texture(material.albedo, material.albedo_map))
        bsdf: dict[str, Any] = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}
        if material.alpha_cutoff is not None:
            opacity = {"type": "mesh_attribute", "name": "vertex_opacity"} if by_vertex else self._opacity(material)
            bsdf = {"type": "mask", "opacity": opacity, "bsdf": bsdf}
        return self._mi.load_dict(bsdf)

    def _texture(self, factor: tuple[float, ...], texture: Texture | None) -> dict[str, Any]:
        if texture is None:
            return {"type": "rgb", "value": list(factor)}
        return self._bitmap(linear_pixels(texture)[..., :3] * np.asarray(factor, np.float32), texture)

    def _opacity(self, material: Material) -> dict[str, Any]:
        if material.albedo_map is None:
            return {"type": "rgb", "value": float(_opacity_of(np.array([material.alpha], np.float32), material)[0])}
        alpha = linear_pixels(material.albedo_map)[..., 3:] * np.float32(material.alpha)
        return self._bitmap(_opacity_of(alpha, material), material.albedo_map, "nearest")

    def _bitmap(self, pixels: F32, texture: Texture, filter_type: str = "bilinear") -> dict[str, Any]:
        return {"type": "bitmap", "bitmap": self._mi.Bitmap(np.ascontiguousarray(pixels)), "raw": True,
                "filter_type": filter_type, "wrap_mode": "repeat" if any(texture.repeat) else "clamp"}

    def _note_difference(self, uvs: F32, texture: Texture) -> None:
        if any(texture.repeat) and not all(texture.repeat):
            clamped = _texcoords(uvs, texture)[:, texture.repeat.index(False)]
            if clamped.min() < 0 or clamped.max() > 1:
                self.notices.append("the path tracer's light repeats an emission texture clamped in one direction")


def _emission_texture(material: Material) -> Texture | None:
    """What emission is multiplied by: the material's texture, where it has alpha as far as it covers its surface."""
    mask = material.albedo_map if material.is_blended or material.alpha_cutoff is not None else None
    if mask is None:
        return material.emission_map
    alpha = linear_pixels(mask)[..., 3:] * np.float32(material.alpha)
    covered = alpha if material.alpha_cutoff is None else (alpha >= material.alpha_cutoff).astype(np.float32)
    texture = material.emission_map or replace(mask, pixels=np.ones((1, 1, 4), np.float32))
    if not _lie_alike(texture, mask):
        return texture
    size = np.maximum(covered.shape[:2], texture.pixels.shape[:2])
    return replace(texture, pixels=_enlarge(linear_pixels(texture), size) * _enlarge(covered, size))


def _lie_alike(one: Texture, other: Texture) -> bool:
    """Whether two textures have the same coordinates."""
    return (one.uv_set, one.repeat) == (other.uv_set, other.repeat) and np.array_equal(one.transform, other.transform)


def _enlarge(pixels: F32, size: Ints) -> F32:
    """Pixels repeated to a larger height and width."""
    rows, columns = (np.arange(new) * old // new for new, old in zip(size, pixels.shape, strict=False))
    return np.asarray(pixels[rows][:, columns])


def _mean_emission(emission: tuple[float, ...], texture: Texture | None) -> float:
    """Over all channels and the whole texture."""
    pixels = np.ones(3, np.float32) if texture is None else linear_pixels(texture)[..., :3]
    return float((pixels * np.asarray(emission, np.float32)).mean())


def _area(points: F64) -> float:
    """Of unshared triangles."""
    return float(np.linalg.norm(_face_normals(points)[::3], axis=1).sum()) / 2


def _face_normals(points: F64) -> F64:
    """Unnormalized normals of unshared triangles, one per corner."""
    return np.cross(points[1::3] - points[::3], points[2::3] - points[::3]).repeat(3, axis=0)


def _shading_normals(normals: F64, points: F64) -> F64:
    """Unit normals of the corners; a corner without a normal gets that of its face."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    chosen = np.where(length > 1e-6, normals, _face_normals(points))
    return chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-300)


def _texcoords(uvs: F32, texture: Texture | None) -> F64:
    """Texture coordinates with Mitsuba's v, which starts at the top row."""
    uv1 = np.concatenate([uvs, np.ones_like(uvs[:, :1])], axis=1).astype(np.float64)
    transformed = uv1 @ (texture.transform if texture is not None else np.eye(3)).T
    return np.stack([transformed[:, 0], 1.0 - transformed[:, 1]], axis=1)


def _opacity_of(alpha: F32, material: Material) -> F32:
    """Alpha scaled so that the material's cutoff becomes 1/2, the path tracer's threshold."""
    return np.clip(alpha / np.float32(2 * max(material.alpha_cutoff or 0, 1e-6)), 0, 1)
