"""What a ray meets: glTF's material model at every point of a scene's meshes, looked up per texel."""

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F32, F64
from app.math3d import normal_matrix
from app.scene import Instance, Material, Mesh, Scene, Texture
from export.reference.textures import TextureTable

MIN_FACING = 1e-2       # cosine between a mapped normal and the face's, as in shaders/include/normal_map.glsl
MIN_ATTENUATION = 1e-6  # share of light left; its logarithm is finite


@dataclass
class Hit:
    """Where a ray meets a mesh.

    Attributes
    ----------
    si : mitsuba.SurfaceInteraction3f
    triangle : mitsuba.UInt32
        Index among the triangles of all instances.
    weights : mitsuba.Point2f
        Of the second and the third corner.
    """

    si: Any
    triangle: Any
    weights: Any

    def is_valid(self) -> Any:
        return self.si.is_valid()


@dataclass
class Surface:
    """The surface at a ``Hit``, on the side that the ray came from; directions are in world space.

    Attributes
    ----------
    normal : mitsuba.Normal3f
        With the normal map.
    is_front, is_culled, is_lit_through : mitsuba.Bool
        ``is_culled``: the ray meets the back of what is one-sided, and goes on; ``is_lit_through``: light that comes
        the other way does.
    base, albedo, f0, emission : mitsuba.Color3f
        Base colour, diffuse reflectance, reflectance at normal incidence, emitted radiance towards the ray's origin.
    roughness, coverage, transmission, occlusion : mitsuba.Float
        ``transmission`` is the share of what the base reflects diffusely that passes instead.
    is_thick : mitsuba.Bool
        Whether a volume lies behind the front.
    ior : mitsuba.Float
    extinction : mitsuba.Color3f
        Of that volume, per scaled length.
    coat, coat_roughness, coat_normal : mitsuba.Float, mitsuba.Float, mitsuba.Normal3f
    sheen, sheen_roughness : mitsuba.Color3f, mitsuba.Float
    """

    normal: Any
    is_front: Any
    is_culled: Any
    is_lit_through: Any
    base: Any
    albedo: Any
    f0: Any
    emission: Any
    roughness: Any
    coverage: Any
    transmission: Any
    occlusion: Any
    is_thick: Any
    ior: Any
    extinction: Any
    coat: Any
    coat_roughness: Any
    coat_normal: Any
    sheen: Any
    sheen_roughness: Any


@dataclass(frozen=True, eq=False)
class _Row:
    """One material's numbers, and its textures as indices."""

    albedo: tuple[float, ...]
    specular: tuple[float, ...]
    emission: tuple[float, ...]
    sheen: tuple[float, ...]
    extinction: tuple[float, ...]
    alpha: float
    cutoff: float
    blended: float
    unlit: float
    double_sided: float
    one_sided: float
    lit_through: float
    metallic: float
    roughness: float
    normal_scale: float
    occlusion: float
    transmission: float
    ior: float
    thick: float
    coat: float
    coat_roughness: float
    coat_normal_scale: float
    sheen_roughness: float
    maps: tuple[int, ...]


COLORS = ("albedo", "specular", "emission", "sheen", "extinction")
NUMBERS = ("alpha", "cutoff", "blended", "unlit", "double_sided", "one_sided", "lit_through", "metallic",
           "roughness", "normal_scale", "occlusion", "transmission", "ior", "thick", "coat", "coat_roughness",
           "coat_normal_scale", "sheen_roughness")
MAPS = ("albedo", "emission", "metallic_roughness", "specular", "normal", "occlusion", "transmission", "coat",
        "coat_roughness", "coat_normal", "sheen", "sheen_roughness")
ABSENT = {"normals": 0.0, "uvs": 0.0, "second_uvs": 0.0, "tangents": 0.0, "colors": 1.0}  # value of a missing attribute


class SurfaceTable:
    """The surfaces of a scene's meshes.

    Parameters
    ----------
    mi : module
        Mitsuba.
    shapes : list of mitsuba.Mesh
        One for each instance, with unshared vertices in the order of its triangles.
    scale : float
        ``scaled = (world - origin) * scale``.

    Attributes
    ----------
    has_holes, has_blend, has_transmission, has_specular : bool
        Whether a material has an alpha mask or culled backs, is blended, transmits light, has a GGX lobe.
    """

    def __init__(self, mi: Any, scene: Scene, shapes: list[Any], time: float, scale: float) -> None:
        self._mi = mi
        materials = scene.materials
        self.has_holes = any(m.alpha_cutoff is not None or m.is_one_sided for m in materials)
        self.has_blend = any(m.is_blended for m in materials)
        self.has_transmission = any(m.transmission is not None for m in materials)
        self.has_specular = any(m.has_specular for m in materials)
        self.has_coat = any(m.clearcoat is not None for m in materials)
        self.has_sheen = any(m.sheen is not None for m in materials)
        textures: dict[int, int] = {}
        used: list[Texture] = []

        def index_of(texture: Texture | None) -> int:
            if texture is None:
                return 0
            if id(texture) not in textures:
                used.append(texture)
                textures[id(texture)] = len(used)
            return textures[id(texture)]

        variants: dict[tuple[int, bool, bool, bool], int] = {}
        rows: list[_Row] = []
        material_of = []
        corners: dict[str, list[F32]] = {name: [] for name in ABSENT}
        starts, mirrored, count = [], [], 0
        for instance in scene.instances:
            mesh = instance.mesh_at(scene.meshes, time)
            key = mesh.material, mesh.uvs is not None, mesh.second_uvs is not None, mesh.tangents is not None
            if key not in variants:
                variants[key] = len(rows)
                rows.append(_row(materials[mesh.material], mesh, scale, index_of))
            for name, values in _corners(mesh, instance, time).items():
                corners[name].append(values)
            starts.append(count)
            material_of.append(variants[key])
            mirrored.append(np.linalg.det(instance.transform_at(time)[:3, :3]) < 0)
            count += len(mesh.triangles)
        self._shape_table(shapes, starts, material_of, mirrored)
        self._colors = {name: mi.Color3f(np.array([getattr(r, name) for r in rows], np.float32).reshape(-1, 3).T.copy())
                        for name in COLORS}
        self._numbers = {name: mi.Float(np.array([getattr(r, name) for r in rows], np.float32)) for name in NUMBERS}
        self._maps = {name: mi.UInt32(np.array([r.maps[i] for r in rows], np.uint32)) for i, name in enumerate(MAPS)
                      if any(r.maps[i] for r in rows)}
        self._textures = TextureTable(mi, used)
        self._corners = {name: mi.Float(np.concatenate(values).astype(np.float32).ravel())
                         for name, values in corners.items() if any((v != ABSENT[name]).any() for v in values)}

    def _shape_table(self, shapes: list[Any], starts: list[int], materials: list[int], mirrored: list[bool]) -> None:
        """First triangle, material and mirroring by the index that Dr.Jit gives to a shape."""
        mi = self._mi
        ids = [int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]) for shape in shapes]
        columns = []
        for values in (starts, materials, mirrored):
            column = np.zeros(max(ids, default=0) + 1, np.uint32)
            column[ids] = values
            columns.append(mi.UInt32(column))
        self._starts, self._materials, self._mirrored = columns

    def hit(self, meshes: Any, ray: Any, active: Any) -> Hit:
        """The first triangle along the rays."""
        mi = self._mi
        preliminary = meshes.ray_intersect_preliminary(ray, active=active)
        si = preliminary.compute_surface_interaction(ray, mi.RayFlags.All, active)
        hit = Hit(si, preliminary.prim_index, mi.Point2f(preliminary.prim_uv))
        hit.triangle += self._of_shape(self._starts, hit, si.is_valid())
        return hit

    def at(self, hit: Hit, active: Any) -> Surface:
        """The surfaces that were hit; 0 where not active."""
        mi, si = self._mi, hit.si
        active = active & hit.is_valid()
        row = self._of_shape(self._materials, hit, active)
        mirrored = self._of_shape(self._mirrored, hit, active) > 0
        uvs, second = (mi.Point2f(*self._interpolate(name, 2, hit, active)) for name in ("uvs", "second_uvs"))

        def number(name: str) -> Any:
            return dr.gather(mi.Float, self._numbers[name], row, active)

        def color(name: str) -> Any:
            return dr.gather(mi.Color3f, self._colors[name], row, active)

        def texel(name: str) -> Any:
            if name not in self._maps:
                return mi.Vector4f(1.0)
            return self._textures.lookup(dr.gather(mi.UInt32, self._maps[name], row, active), uvs, second, active)

        def rgb(name: str) -> Any:
            return mi.Color3f(texel(name).xyz)

        albedo_texel = texel("albedo")
        r, g, b, a = self._interpolate("colors", 4, hit, active)
        radiance = color("albedo") * mi.Color3f(albedo_texel.xyz) * mi.Color3f(r, g, b)  # of unlit surfaces
        base = dr.clip(radiance, 0, 1)
        alpha = number("alpha") * albedo_texel.w * a
        metallic_roughness, specular = texel("metallic_roughness"), texel("specular")
        metallic = number("metallic") * metallic_roughness.z
        f0 = dr.lerp(color("specular") * mi.Color3f(specular.xyz) * specular.w, base, metallic)
        unlit, lit = number("unlit") > 0, dr.select(number("unlit") > 0, 0.0, 1.0)
        towards = face_normal(si)
        is_front = (dr.dot(si.n, towards) > 0) != mirrored
        is_thick = number("thick") > 0
        shines = is_front | (number("double_sided") > 0)
        emission = dr.select(shines, color("emission") * rgb("emission"), 0.0)
        tangent = self._tangent_frame(hit, towards, active)
        holes = (alpha < number("cutoff")) | ~active
        blended = dr.select(number("blended") > 0, dr.clip(alpha, 0, 1), 1.0)
        return Surface(
            normal=self._mapped_normal(hit, tangent, texel("normal"), number("normal_scale")), is_front=is_front,
            is_culled=~is_front & (number("one_sided") > 0), is_lit_through=is_front & (number("lit_through") > 0),
            base=base, albedo=lit * base * (1 - metallic), f0=lit * f0, emission=dr.select(unlit, radiance, emission),
            roughness=number("roughness") * metallic_roughness.y, coverage=dr.select(holes, 0.0, blended),
            transmission=lit * number("transmission") * texel("transmission").x * (1 - metallic),
            occlusion=1 + number("occlusion") * (texel("occlusion").x - 1), is_thick=is_thick,
            ior=number("ior"), extinction=color("extinction"), coat=lit * number("coat") * texel("coat").x,
            coat_roughness=number("coat_roughness") * texel("coat_roughness").y,
            coat_normal=self._mapped_normal(hit, tangent, texel("coat_normal"), number("coat_normal_scale")),
            sheen=lit * color("sheen") * rgb("sheen"),
            sheen_roughness=number("sheen_roughness") * texel("sheen_roughness").w)

    def is_see_through(self, hit: Hit, active: Any) -> Any:
        """Whether the material is blended or transmits light."""
        mi = self._mi
        active = active & hit.is_valid()
        row = self._of_shape(self._materials, hit, active)
        return (dr.gather(mi.Float, self._numbers["blended"], row, active)
                + dr.gather(mi.Float, self._numbers["transmission"], row, active)) > 0

    def _of_shape(self, column: Any, hit: Hit, active: Any) -> Any:
        shape: Any = dr.reinterpret_array(self._mi.UInt32, hit.si.shape)
        return dr.gather(self._mi.UInt32, column, shape, active)

    def _interpolate(self, name: str, size: int, hit: Hit, active: Any) -> list[Any]:
        """Components of a vertex attribute."""
        mi = self._mi
        if name not in self._corners:
            return [mi.Float(ABSENT[name])] * size
        u, v = hit.weights.x, hit.weights.y
        weights = (1 - u - v, u, v)
        return [sum((weights[k] * dr.gather(mi.Float, self._corners[name], (3 * hit.triangle + k) * size + c, active)
                     for k in range(3)), mi.Float(0.0)) for c in range(size)]

    def _tangent_frame(self, hit: Hit, towards: Any, active: Any) -> tuple[Any, Any, Any]:
        """Tangent, bitangent and normal, on the side of the face normal ``towards``, which stands in for none."""
        mi = self._mi
        normal = mi.Vector3f(*self._interpolate("normals", 3, hit, active))
        square = dr.squared_norm(normal)
        normal = dr.select(square > 1e-12, normal * dr.rsqrt(dr.maximum(square, 1e-30)), mi.Vector3f(towards))
        sign = dr.select(dr.dot(normal, towards) < 0, -1.0, 1.0)
        if "tangents" not in self._corners:
            return mi.Vector3f(0.0), mi.Vector3f(0.0), sign * normal
        x, y, z, w = self._interpolate("tangents", 4, hit, active)
        tangent = mi.Vector3f(x, y, z)
        tangent = tangent * dr.rsqrt(dr.maximum(dr.squared_norm(tangent), 1e-30))
        bitangent = dr.cross(normal, tangent) * dr.select(w < 0, -1.0, 1.0)
        return sign * tangent, sign * bitangent, sign * normal

    def _mapped_normal(self, hit: Hit, frame: tuple[Any, Any, Any], texel: Any, scale: Any) -> Any:
        """The normal of a map's texel, bent above the face; the normal of the frame where ``scale`` is 0."""
        mi, si = self._mi, hit.si
        tangent, bitangent, normal = frame
        x, y, z = 2 * texel.x - 1, 2 * texel.y - 1, 2 * texel.z - 1
        mapped = scale * (x * tangent + y * bitangent) + z * normal
        square = dr.squared_norm(mapped)
        is_mapped = (scale != 0) & (square > 1e-12)
        face, v = mi.Vector3f(face_normal(si)), mi.Vector3f(si.to_world(si.wi))
        bent = _bend_above_face(dr.select(is_mapped, mapped * dr.rsqrt(square), face), face, v)
        return mi.Normal3f(dr.select(is_mapped, bent, normal))


def _bend_above_face(normal: Any, face: Any, v: Any) -> Any:
    """To the face's side, and until ``v`` is mirrored above the face (Keller et al. 2017), as in the renderer."""
    normal = dr.normalize(normal + face * dr.maximum(MIN_FACING - dr.dot(normal, face), 0))
    mirrored = 2 * dr.dot(v, normal) * normal - v
    height = dr.dot(mirrored, face)
    raised = mirrored - normal * (height / dr.maximum(dr.dot(normal, face), MIN_FACING))
    return dr.select(height < 0, dr.normalize(v + dr.normalize(raised)), normal)


def face_normal(si: Any) -> Any:
    """Of a Mitsuba surface interaction, on the side of the face that the ray came from."""
    return dr.select(dr.dot(si.n, si.to_world(si.wi)) > 0, si.n, -si.n)


def _row(material: Material, mesh: Mesh, scale: float, index_of: Any) -> _Row:
    uv_sets = mesh.uvs, mesh.second_uvs
    transmission, coat, sheen = material.transmission, material.clearcoat, material.sheen

    def usable(texture: Texture | None) -> Texture | None:
        return texture if texture is not None and uv_sets[texture.uv_set] is not None else None

    normal_map = usable(material.normal_map) if mesh.tangents is not None else None
    coat_normal_map = usable(coat.normal_map) if coat is not None and mesh.tangents is not None else None
    maps = (material.albedo_map, material.emission_map, material.metallic_roughness_map, material.specular_map,
            normal_map, material.occlusion_map, transmission.factor_map if transmission else None,
            coat.strength_map if coat else None, coat.roughness_map if coat else None, coat_normal_map,
            sheen.color_map if sheen else None, sheen.roughness_map if sheen else None)
    return _Row(
        albedo=material.albedo, specular=material.specular, emission=material.emission,
        sheen=sheen.color if sheen else (0.0,) * 3, extinction=_extinction(material, scale), alpha=material.alpha,
        cutoff=-1.0 if material.alpha_cutoff is None else material.alpha_cutoff, blended=material.is_blended,
        unlit=material.is_unlit, double_sided=material.double_sided,
        one_sided=material.is_one_sided, lit_through=material.is_lit_through,
        metallic=material.metallic, roughness=material.roughness,
        normal_scale=material.normal_scale if normal_map else 0.0,
        occlusion=material.occlusion_strength, transmission=transmission.factor if transmission else 0.0,
        ior=transmission.ior if transmission else 1.0, thick=transmission is not None and transmission.thickness > 0,
        coat=coat.strength if coat else 0.0, coat_roughness=coat.roughness if coat else 0.0,
        coat_normal_scale=coat.normal_scale if coat and coat_normal_map else 0.0,
        sheen_roughness=sheen.roughness if sheen else 0.0, maps=tuple(index_of(usable(t)) for t in maps))


def _extinction(material: Material, scale: float) -> tuple[float, ...]:
    transmission = material.transmission
    if transmission is None or math.isinf(transmission.attenuation_distance):
        return 0.0, 0.0, 0.0
    distance = max(transmission.attenuation_distance * scale, 1e-12)
    return tuple(-math.log(max(c, MIN_ATTENUATION)) / distance for c in transmission.attenuation_color)


def _corners(mesh: Mesh, instance: Instance, time: float) -> dict[str, F32]:
    """Attributes of unshared vertices, directions in world space."""
    transform: F64 = instance.transform_at(time)
    sign = -1.0 if np.linalg.det(transform[:3, :3]) < 0 else 1.0
    cofactor = normal_matrix(transform)
    turned = sign * cofactor.T / max(float(np.abs(cofactor).max()), 1e-300)
    corners = mesh.triangles.ravel()
    tangents = None if mesh.tangents is None else np.concatenate(
        [_unit(mesh.tangents[:, :3] @ transform[:3, :3].T), sign * mesh.tangents[:, 3:]], axis=1)
    attributes = (("normals", _unit(mesh.normals @ turned), 3), ("uvs", mesh.uvs, 2),
                  ("second_uvs", mesh.second_uvs, 2), ("tangents", tangents, 4), ("colors", mesh.colors, 4))
    return {name: np.full((len(corners), size), ABSENT[name], np.float32) if values is None else values[corners]
            for name, values, size in attributes}


def _unit(vectors: Any) -> F32:
    """Unit vectors; zero stays zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-6, vectors / np.maximum(length, 1e-300), 0.0).astype(np.float32)


