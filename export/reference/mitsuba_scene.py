"""A ``Scene`` as Mitsuba sees it: the same triangles, textures, masks and lights.

Lights have no body here, as in the renderer: they light, but stop no ray. So meshes and lights are Mitsuba scenes of
their own. Lengths are scaled, since Mitsuba's ray offsets suit scenes of a few tens of units.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.environment import centres, radiance_along
from app.errors import DeviceError
from app.math3d import look_rotation, normal_matrix, normalize
from app.scene import (
    F32,
    F64,
    DirectionalLight,
    Environment,
    Instance,
    Light,
    Material,
    Mesh,
    PointLight,
    RectLight,
    Scene,
    SpotLight,
    Texture,
)

VARIANT = "llvm_ad_rgb"
OLDEST_LLVM = 16       # older ones fail on processors with AVX-512
EXTENT = 40.0          # longest edge of the scaled scene
SUN_DISTANCE = 4e4     # scaled: where parallel light comes from, and the sphere stands that has its angular radius
SPOT_POINTS = 64       # point spots that stand for one with a radius
SKY_ROWS = 256
SEAM = 1e-4            # scaled: between the two sides of a two-sided emitter

_LLVM_FOLDERS = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")


def mitsuba() -> Any:
    """The Mitsuba module with its variant chosen.

    Raises
    ------
    DeviceError
        When Mitsuba or the LLVM library that it needs is missing, or the library is none that it can use.
    """
    try:
        import mitsuba as mi
    except ImportError:
        raise DeviceError("no path tracer", "package mitsuba", "expected it: pip install 'afterglow[export]'") from None
    if mi.variant() is None:
        if "DRJIT_LIBLLVM_PATH" not in os.environ:
            os.environ["DRJIT_LIBLLVM_PATH"] = _llvm()
        try:
            mi.set_variant(VARIANT)
        except ImportError:  # Dr.Jit has printed what it does not like
            raise DeviceError("LLVM can't be used", os.environ["DRJIT_LIBLLVM_PATH"],
                              f"expected a library of version {OLDEST_LLVM} or newer") from None
        mi.set_log_level(mi.LogLevel.Error)
    return mi


def _llvm() -> str:
    """The newest LLVM library on this machine."""
    found = {}
    for folder in _LLVM_FOLDERS:
        for pattern in ("libLLVM*.so*", "*/libLLVM*.so*", "libLLVM*.dylib"):
            for file in Path(folder).glob(pattern):
                if version := re.search(r"(\d+)", file.name):
                    found[int(version[1])] = str(file)
    newest = max(found, default=0)
    if newest < OLDEST_LLVM:
        raise DeviceError("no LLVM for the path tracer", "this machine", f"expected version {OLDEST_LLVM} or newer "
                          "(Debian: apt-get install libllvm19), or its path in DRJIT_LIBLLVM_PATH")
    return found[newest]


@dataclass(frozen=True, eq=False)
class MitsubaScene:
    """Meshes and lights, with ``scaled = (world - origin) * scale``.

    Attributes
    ----------
    seen : mitsuba.Scene
        All meshes.
    solid : mitsuba.Scene or None
        Those that cast shadows: all but the ones that stand for an analytic light.
    lights, glow, sky : mitsuba.Scene or None
        ``Scene.lights``, the emissive meshes that none of them stands for, and the environment; None where there is
        none.
    whole : dict
        All of it as one scene for Mitsuba's own integrators, where lights have bodies.
    masked : bool
        Whether some material has an alpha mask.
    notices : tuple of str
        What the path tracer can't draw as the renderer does.
    """

    seen: Any
    solid: Any
    lights: Any
    glow: Any
    sky: Any
    whole: dict[str, Any]
    masked: bool
    origin: F64
    scale: float
    notices: tuple[str, ...]


def convert(scene: Scene, time: float = 0.0) -> MitsubaScene:
    """Build the Mitsuba scenes, with instances where they are at ``time`` seconds.

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """
    mi = mitsuba()
    origin, scale = scene.bounds.mean(axis=0), EXTENT / scene.longest_edge
    builder = _MeshBuilder(mi, scene, time, origin, scale)
    seen: dict[str, Any] = {"type": "scene"}
    solid: dict[str, Any] = {"type": "scene"}
    lights: dict[str, Any] = {"type": "scene"}
    glow: dict[str, Any] = {"type": "scene"}
    for index, instance in enumerate(scene.instances):
        material = scene.materials[scene.meshes[instance.mesh].material]
        key = f"mesh{index}"
        seen[key] = builder.mesh(instance)
        if not material.is_light_proxy:
            solid[key] = seen[key]
            if material.emits:
                glow[key] = builder.mesh(instance, side=1)
                if material.double_sided:
                    glow[key + "back"] = builder.mesh(instance, side=-1)
    for index, light in enumerate(scene.lights):
        for part, emitter in enumerate(_emitters(light, origin, scale)):
            lights[f"light{index}part{part}"] = emitter

    sky = {"type": "scene", "environment": _sky(scene.environment)} if scene.environment is not None else {}

    def load(part: dict[str, Any]) -> Any:
        # Merging and loading in parallel shuffle the emitters, and so the picture, from run to run.
        return mi.load_dict(part, parallel=False, optimize=False) if len(part) > 1 else None

    # Mitsuba lets parallel light, and that of an environment, begin at the bounds of the scene that it is in.
    bounds = {"bounds": {"type": "sphere", "radius": SUN_DISTANCE}}
    masked = any(m.alpha_cutoff is not None for m in scene.materials)
    return MitsubaScene(load(seen), load(solid), load(lights | bounds) if len(lights) > 1 else None,
                        load(glow), load(sky | bounds) if sky else None, seen | lights | glow | sky, masked,
                        origin, scale, tuple(dict.fromkeys(builder.notices)))


class _MeshBuilder:
    """Makes Mitsuba meshes of instances."""

    def __init__(self, mi: Any, scene: Scene, time: float, origin: F64, scale: float) -> None:
        self._mi, self._scene, self._time, self._origin, self._scale = mi, scene, time, origin, scale
        self.notices: list[str] = []
        self._bsdfs: dict[tuple[int, bool], Any] = {}  # the fewer there are, the faster rays are shaded

    def mesh(self, instance: Instance, side: int = 0) -> Any:
        """The instance as a reflecting mesh, or as an emitter to its front (``side`` 1) or back (-1)."""
        mi, mesh = self._mi, self._scene.meshes[instance.mesh]
        material = self._scene.materials[mesh.material]
        transform = instance.transform_at(self._time)
        corners = mesh.triangles.ravel()  # every triangle has corners of its own, so that it can have face normals
        points = mesh.positions[corners].astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]
        points = (points - self._origin) * self._scale
        mirrored = np.linalg.det(transform[:3, :3]) < 0
        normals = _normals(mesh.normals[corners] @ normal_matrix(transform).T, points)
        if side:
            facing = np.cross(points[1::3] - points[::3], points[2::3] - points[::3]).repeat(3, axis=0)
            facing *= (-side if mirrored else side) / np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-300)
            points, normals = points + SEAM * facing, facing
        properties = mi.Properties()
        if side:
            properties["emitter"] = mi.load_dict({"type": "area", "radiance": _texture(
                material.emission, material.emission_map)})
        by_vertex = mesh.colors is not None and material.albedo_map is None
        if (mesh.material, by_vertex) not in self._bsdfs:
            self._bsdfs[mesh.material, by_vertex] = self._bsdf(material, by_vertex)
        properties["bsdf"] = self._bsdfs[mesh.material, by_vertex]
        self._note(mesh, material)
        # The shading normal decides to which side an area light shines; the winding, which side is the front.
        flip = bool(side) and (mirrored != (side < 0))
        faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)[:, ::-1 if flip else 1]
        made = mi.Mesh(instance.name, len(corners), len(faces), has_vertex_normals=True,
                       has_vertex_texcoords=mesh.uvs is not None, props=properties)
        if mesh.colors is not None:
            colors = mesh.colors[corners].astype(np.float32)
            made.add_attribute("vertex_albedo", 3, (colors[:, :3] * np.asarray(material.albedo, np.float32)).ravel())
            made.add_attribute("vertex_opacity", 1, _over_cutoff(colors[:, 3] * material.alpha, material))
        buffers = mi.traverse(made)
        buffers["vertex_positions"] = points.astype(np.float32).ravel()
        buffers["vertex_normals"] = normals.astype(np.float32).ravel()
        buffers["faces"] = np.ascontiguousarray(faces).ravel()
        if mesh.uvs is not None:
            texture = material.emission_map if side else material.albedo_map
            buffers["vertex_texcoords"] = _texcoords(mesh.uvs[corners], texture).astype(np.float32).ravel()
        buffers.update()
        return made

    def _bsdf(self, material: Material, by_vertex: bool) -> Any:
        reflectance = ({"type": "mesh_attribute", "name": "vertex_albedo"} if by_vertex
                       else _texture(material.albedo, material.albedo_map))
        bsdf: dict[str, Any] = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}
        if material.alpha_cutoff is not None:
            opacity = {"type": "mesh_attribute", "name": "vertex_opacity"} if by_vertex else _opacity(material)
            bsdf = {"type": "mask", "opacity": opacity, "bsdf": bsdf}
        return self._mi.load_dict(bsdf)

    def _note(self, mesh: Mesh, material: Material) -> None:
        texture = material.albedo_map
        if texture is None:
            return
        if mesh.colors is not None and (mesh.colors != 1).any():
            self.notices.append(f"{mesh.name!r}: the path tracer shows the texture without vertex colours")
        if mesh.uvs is not None and any(texture.repeat) and not all(texture.repeat):
            clamped = _texcoords(mesh.uvs, texture)[:, texture.repeat.index(False)]
            if clamped.min() < 0 or clamped.max() > 1:
                self.notices.append(f"{mesh.name!r}: the path tracer repeats a texture clamped in one direction")


def _normals(normals: F64, points: F64) -> F64:
    """Unit normals of the corners; that of the face where a corner has none."""
    face = np.cross(points[1::3] - points[::3], points[2::3] - points[::3]).repeat(3, axis=0)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    chosen = np.where(length > 1e-6, normals, face)
    return chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-300)


def _texcoords(uvs: F32, texture: Texture | None) -> F64:
    """Texture coordinates with Mitsuba's v, which starts at the top row."""
    uv1 = np.concatenate([uvs, np.ones_like(uvs[:, :1])], axis=1).astype(np.float64)
    moved = uv1 @ (texture.transform if texture is not None else np.eye(3)).T
    return np.stack([moved[:, 0], 1.0 - moved[:, 1]], axis=1)


def _texture(factor: tuple[float, float, float], texture: Texture | None) -> dict[str, Any]:
    if texture is None:
        return {"type": "rgb", "value": list(factor)}
    return _bitmap(_linear(texture)[..., :3] * np.asarray(factor, np.float32), texture)


def _opacity(material: Material) -> dict[str, Any]:
    """At least 1/2 where the material is there."""
    if material.albedo_map is None:
        return {"type": "rgb", "value": float(_over_cutoff(np.array([material.alpha], np.float32), material)[0])}
    alpha = _linear(material.albedo_map)[..., 3:] * np.float32(material.alpha)
    return _bitmap(_over_cutoff(alpha, material), material.albedo_map, "nearest")


def _over_cutoff(alpha: F32, material: Material) -> F32:
    """Alpha with the cutoff moved to 1/2, where the path tracer's is."""
    return np.clip(alpha / np.float32(2 * max(material.alpha_cutoff or 0, 1e-6)), 0, 1)


def _bitmap(pixels: F32, texture: Texture, filter_type: str = "bilinear") -> dict[str, Any]:
    return {"type": "bitmap", "bitmap": mitsuba().Bitmap(np.ascontiguousarray(pixels)), "raw": True,
            "filter_type": filter_type, "wrap_mode": "repeat" if any(texture.repeat) else "clamp"}


def _linear(texture: Texture) -> F32:
    """Linear float32 [H, W, 4]."""
    if texture.pixels.dtype != np.uint8:
        return texture.pixels.astype(np.float32)
    x = texture.pixels.astype(np.float32) / 255
    rgb = np.where(x > 0.04045, ((x + 0.055) / 1.055) ** 2.4, x / 12.92)
    return np.concatenate([rgb[..., :3], x[..., 3:]], axis=-1)


def _emitters(light: Light, origin: F64, scale: float) -> Iterator[dict[str, Any]]:
    """Mitsuba emitters that send what ``light`` sends."""
    def place(point: tuple[float, float, float]) -> list[float]:
        return list((np.asarray(point, np.float64) - origin) * scale)

    match light:
        case PointLight(radius=0):
            yield {"type": "point", "position": place(light.position), "intensity": _rgb(light.intensity, scale**2)}
        case PointLight():
            yield _glowing_sphere(place(light.position), light.radius * scale,
                                  _rgb(light.intensity, 1 / (math.pi * light.radius**2)))
        case SpotLight():
            yield from _spots(light, place(light.position), scale)
        case DirectionalLight(angular_radius_deg=0):
            yield {"type": "directional", "direction": list(light.direction), "irradiance": _rgb(light.irradiance)}
        case DirectionalLight():
            sine = math.sin(math.radians(light.angular_radius_deg))
            center = -SUN_DISTANCE * normalize(np.asarray(light.direction, np.float64))
            yield _glowing_sphere(list(center), SUN_DISTANCE * sine, _rgb(light.irradiance, 1 / (math.pi * sine**2)))
        case RectLight():
            for sign in (1.0, -1.0) if light.two_sided else (1.0,):
                yield _glowing_rectangle(light, place(light.center), scale, sign)


def _sky(environment: Environment) -> dict[str, Any]:
    """Mitsuba's map begins at -z, and has its first and last row straight up and down: where rows are few, more."""
    h, w = environment.radiance.shape[:2]
    finer = -(-SKY_ROWS // h)
    h, w = finer * h, finer * w * (1 + finer * w % 2)
    radiance = environment.radiance
    if (h, w) != radiance.shape[:2]:
        radiance = radiance_along(Environment(radiance), centres(h, w).reshape(-1, 3)).reshape(h, w, 3)
    bitmap = mitsuba().Bitmap(np.ascontiguousarray(np.roll(radiance, w // 2, axis=1)))
    turn = mitsuba().ScalarTransform4f().rotate([0, 1, 0], environment.rotation_deg)
    return {"type": "envmap", "bitmap": bitmap, "to_world": turn}


def _rgb(color: tuple[float, float, float], factor: float = 1.0) -> dict[str, Any]:
    return {"type": "rgb", "value": [c * factor for c in color]}


def _glowing_sphere(center: list[float], radius: float, radiance: dict[str, Any]) -> dict[str, Any]:
    return {"type": "sphere", "center": center, "radius": radius, "emitter": {"type": "area", "radiance": radiance}}


def _glowing_rectangle(light: RectLight, center: list[float], scale: float, sign: float) -> dict[str, Any]:
    u, v = np.asarray(light.edge_u, np.float64), sign * np.asarray(light.edge_v, np.float64)
    normal = normalize(np.cross(u, v))
    to_world = np.eye(4)
    to_world[:3] = np.stack([u * scale / 2, v * scale / 2, normal, center + SEAM * normal], axis=1)
    return {"type": "rectangle", "to_world": mitsuba().ScalarTransform4f(to_world),
            "emitter": {"type": "area", "radiance": _rgb(light.radiance)}}


def _spots(light: SpotLight, center: list[float], scale: float) -> Iterator[dict[str, Any]]:
    """One spot, or many on the disc that a spot with a radius shows along its axis."""
    mi = mitsuba()
    axis = normalize(np.asarray(light.direction, np.float64))
    right, up, _ = look_rotation(axis, np.array([0.0, 1.0, 0.0]))
    count = SPOT_POINTS if light.radius > 0 else 1
    for k in range(count):
        r, angle = light.radius * scale * math.sqrt((k + 0.5) / count), k * math.pi * (3 - math.sqrt(5))
        at = np.asarray(center) + r * (math.cos(angle) * right + math.sin(angle) * up)
        yield {"type": "spot", "intensity": _rgb(light.intensity, scale**2 / count),
               "cutoff_angle": light.outer_deg, "beam_width": min(light.inner_deg, light.outer_deg - 1e-3),
               "to_world": mi.ScalarTransform4f().look_at(origin=list(at), target=list(at + axis), up=list(up))}
