"""The scene as plain data: meshes, materials, lights, cameras. No GL, no files.

Right-handed, y up, the scene's own units. Colours are linear Rec. 709.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64, Bools
from app.errors import SceneError

Color = tuple[float, float, float]

MIN_ATTENUATION = 1e-6            # share of light left; its logarithm is finite
MIN_ATTENUATION_DISTANCE = 1e-12  # in lengths of the scene
MIN_SCALE = 1e-300                # of a matrix; what is less counts as 0
MIN_RELATIVE_SCALE = 1e-9         # of an axis, to the longest one
MAX_OUTLINE_ALBEDO = 0.02         # of hulls that draw outlines
MIN_REST_SHARE = 0.01             # of the longest edge at all times that the one at time 0 counts as


@dataclass(frozen=True, eq=False)
class Texture:
    """An image on a surface.

    Attributes
    ----------
    pixels : ndarray, uint8 or float32, shape (H, W, 4)
        Top row first. uint8 is sRGB-encoded colour with linear alpha; float32 is linear.
    transform : ndarray, float64, shape (3, 3)
        Maps homogeneous mesh uv to texture uv (KHR_texture_transform).
    repeat : tuple of bool
        Whether u and v repeat; otherwise they are clamped to the edge.
    is_color : bool
        Whether uint8 pixels are sRGB-encoded; False: linear numbers, such as normals and roughness.
    uv_set : int
        0: ``Mesh.uvs``, 1: ``Mesh.second_uvs``.
    magnified : str
        ``linear`` or ``nearest``: how texels that are larger than a pixel are interpolated.
    """

    pixels: NDArray[np.uint8] | F32
    transform: F64 = field(default_factory=lambda: np.eye(3))
    repeat: tuple[bool, bool] = (True, True)
    is_color: bool = True
    uv_set: int = 0
    magnified: Literal["linear", "nearest"] = "linear"


@dataclass(frozen=True, eq=False)
class Clearcoat:
    """A clear layer of reflectance 0.04 at normal incidence over the surface (KHR_materials_clearcoat).

    Attributes
    ----------
    strength, roughness : float
        Multiplied by the red channel of ``strength_map`` and by the green channel of ``roughness_map``.
    normal_map : Texture or None
        Of the layer alone; without it the layer has the normal of the mesh.
    """

    strength: float
    roughness: float
    strength_map: Texture | None = None
    roughness_map: Texture | None = None
    normal_map: Texture | None = None
    normal_scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Sheen:
    """Light that fibres scatter back at grazing angles (KHR_materials_sheen).

    Attributes
    ----------
    color : tuple of float
        Linear; multiplied by the colour of ``color_map``.
    roughness : float
        Perceptual; multiplied by the alpha of ``roughness_map``.
    """

    color: Color
    roughness: float
    color_map: Texture | None = None
    roughness_map: Texture | None = None


@dataclass(frozen=True, eq=False)
class Transmission:
    """Light that passes through the surface (KHR_materials_transmission, _volume and _ior).

    Attributes
    ----------
    factor : float
        Share of light that is not reflected and passes; multiplied by the red channel of ``factor_map``.
    ior : float
        Index of refraction.
    thickness : float
        Of the volume behind the surface, in object space; multiplied by the green channel of ``thickness_map``; 0:
        a thin wall, which does not refract.
    attenuation_color : tuple of float
        What is left of white light after ``attenuation_distance`` (world space; may be infinite) in the volume.
    """

    factor: float
    factor_map: Texture | None = None
    ior: float = 1.5
    thickness: float = 0.0
    thickness_map: Texture | None = None
    attenuation_color: Color = (1.0, 1.0, 1.0)
    attenuation_distance: float = float("inf")

    @property
    def extinction(self) -> Color:
        """Of the volume, per unit of length in world space."""
        distance = max(self.attenuation_distance, MIN_ATTENUATION_DISTANCE)
        r, g, b = (-math.log(max(c, MIN_ATTENUATION)) / distance for c in self.attenuation_color)
        return r, g, b


@dataclass(frozen=True, eq=False)
class Material:
    """A diffuse surface with an optional GGX lobe and an optional emission: glTF 2.0 with its extensions.

    Diffuse reflectance is (1 - metallic) · base colour; reflectance at normal incidence is mix(specular, base colour,
    metallic).

    Attributes
    ----------
    albedo : tuple of float
        Base colour, linear: multiplied by ``albedo_map``, which has uv set 0, and vertex colours.
    alpha_cutoff : float or None
        Texels whose alpha (``alpha`` × map × vertex) is below are not there; None: all are.
    is_blended : bool
        Whether alpha is the coverage of a see-through surface; False: alpha has no effect but that of the cutoff.
    emission : tuple of float
        Radiance in W/(sr m²); multiplied by ``emission_map``.
    metallic, roughness : float
        Multiplied by the blue and the green channel of ``metallic_roughness_map``. Roughness is perceptual: GGX's alpha
        is its square.
    specular : tuple of float
        Reflectance at normal incidence (F0) of what is not metallic; multiplied by colour and alpha of
        ``specular_map``; zeros mean that there is no highlight at all.
    normal_map : Texture or None
        Normals in tangent space (glTF: +y is up in the image), x and y multiplied by ``normal_scale``.
    occlusion_map : Texture or None
        Indirect light is multiplied by 1 + ``occlusion_strength`` · (red - 1).
    is_unlit : bool
        Whether the base colour is shown as radiance, in W/(sr m²), unlit and unshadowed (KHR_materials_unlit). It
        lights nothing, and nothing else of the material counts but its alpha.
    double_sided : bool
        Whether the back emits too. Both sides reflect.
    is_back_culled : bool
        Whether cameras and gathered rays see through the back (glTF's materials that are not double-sided).
    is_light_proxy : bool
        True when the emission is also in ``Scene.lights``: it is shown, but its light is not counted twice.
    """

    name: str = "default"
    albedo: Color = (0.8, 0.8, 0.8)
    albedo_map: Texture | None = None
    alpha: float = 1.0
    alpha_cutoff: float | None = None
    emission: Color = (0.0, 0.0, 0.0)
    emission_map: Texture | None = None
    roughness: float = 1.0
    metallic: float = 0.0
    metallic_roughness_map: Texture | None = None
    specular: Color = (0.0, 0.0, 0.0)
    specular_map: Texture | None = None
    normal_map: Texture | None = None
    normal_scale: float = 1.0
    occlusion_map: Texture | None = None
    occlusion_strength: float = 1.0
    clearcoat: Clearcoat | None = None
    sheen: Sheen | None = None
    transmission: Transmission | None = None
    is_blended: bool = False
    is_unlit: bool = False
    double_sided: bool = True
    is_back_culled: bool = False
    is_light_proxy: bool = False

    def __post_init__(self) -> None:
        texture = self.albedo_map
        if texture is not None and not (isinstance(texture, Texture) and texture.uv_set == 0):
            raise SceneError("bad albedo_map", f"material {self.name!r}", "expected a Texture of uv set 0")

    @property
    def emits(self) -> bool:
        """Whether it sends light; unlit surfaces do not."""
        return max(self.emission) > 0.0

    @property
    def has_specular(self) -> bool:
        """Whether any layer of it reflects more than diffuse light."""
        return max(self.specular) > 0.0 or self.metallic > 0.0 or self.clearcoat is not None or self.sheen is not None

    @cached_property
    def min_roughness(self) -> float:
        """Lowest perceptual roughness of the base's specular lobe anywhere; 1 where it has none."""
        if not (max(self.specular) > 0.0 or self.metallic > 0.0):
            return 1.0
        texture = self.metallic_roughness_map
        if texture is None:
            return self.roughness
        values = np.nan_to_num(texture.pixels[..., 1], nan=1.0)
        return self.roughness * float(values.min()) / (255.0 if texture.pixels.dtype == np.uint8 else 1.0)

    @property
    def is_see_through(self) -> bool:
        """Whether what is behind it can be seen: it is blended or transmits light."""
        return self.is_blended or self.transmission is not None

    @property
    def is_volume(self) -> bool:
        """Whether its front bounds a volume of glass, which light leaves at the back."""
        return self.transmission is not None and self.transmission.thickness > 0

    @property
    def is_rough_glass(self) -> bool:
        """Whether it blurs what is seen through it."""
        return self.transmission is not None and self.roughness > 0

    @property
    def is_one_sided(self) -> bool:
        """Whether cameras and gathered rays see through its back."""
        return self.is_back_culled and not self.is_volume

    @property
    def is_lit_through(self) -> bool:
        """Whether light that arrives at its back passes, as that of inverted hulls must that draw outlines.

        Those are one-sided, and unlit or all but black. Other one-sided surfaces, such as a room's walls, block light.
        """
        is_black = all(c <= MAX_OUTLINE_ALBEDO for c in self.albedo) and not self.emits
        return self.is_one_sided and self.transmission is None and (self.is_unlit or is_black)

    @property
    def passing(self) -> Color:
        """Share of light that passes what is covered, of a volume through both of its faces.

        Without textures, and as if nothing were metallic.
        """
        t = self.transmission
        if t is None:
            return 0.0, 0.0, 0.0
        share = t.factor * (1 - max(self.specular))
        r, g, b = (share * c * math.exp(-e * t.thickness) for c, e in zip(self.albedo, t.extinction, strict=True))
        return r, g, b

    @property
    def maps(self) -> dict[str, Texture]:
        """All textures that shading reads, by the names that shaders have for them."""
        maps = {
            "albedo_map": self.albedo_map, "emission_map": self.emission_map,
            "metallic_roughness_map": self.metallic_roughness_map, "specular_map": self.specular_map,
            "normal_map": self.normal_map, "occlusion_map": self.occlusion_map,
        }
        if self.clearcoat is not None:
            maps |= {"clearcoat_map": self.clearcoat.strength_map,
                     "clearcoat_roughness_map": self.clearcoat.roughness_map,
                     "clearcoat_normal_map": self.clearcoat.normal_map}
        if self.sheen is not None:
            maps |= {"sheen_color_map": self.sheen.color_map, "sheen_roughness_map": self.sheen.roughness_map}
        if self.transmission is not None:
            maps |= {"transmission_map": self.transmission.factor_map, "thickness_map": self.transmission.thickness_map}
        return {name: texture for name, texture in maps.items() if texture is not None}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material, in object space.

    Attributes
    ----------
    positions : ndarray, float32, shape (V, 3)
        Relative to ``Instance.transform``, whose float64 translation carries far-away offsets.
    normals : ndarray, float32, shape (V, 3)
        Unit length; a zero vector makes the shader take the face normal.
    uvs : ndarray, float32, shape (V, 2), or None
        v grows upwards (the loader turns glTF's around).
    second_uvs : ndarray, float32, shape (V, 2), or None
        Of textures whose ``uv_set`` is 1.
    tangents : ndarray, float32, shape (V, 4), or None
        Unit vectors along u of the normal map, and the sign of the bitangent (glTF); None without a normal map.
    colors : ndarray, float32, shape (V, 4), or None
        Linear, multiplied into the albedo.
    triangles : ndarray, uint32, shape (T, 3)
    """

    name: str
    positions: F32
    normals: F32
    triangles: NDArray[np.uint32]
    material: int = 0
    uvs: F32 | None = None
    colors: F32 | None = None
    second_uvs: F32 | None = None
    tangents: F32 | None = None

    def __post_init__(self) -> None:
        assert self.positions.dtype == np.float32 and self.positions.ndim == 2
        assert self.normals.shape == self.positions.shape and self.normals.dtype == np.float32
        assert self.triangles.dtype == np.uint32 and self.triangles.shape[1:] == (3,)


@dataclass(frozen=True, eq=False)
class Shape:
    """What changes of a mesh that deforms: see ``Mesh``."""

    positions: F32
    normals: F32
    tangents: F32 | None = None


class Placement(Protocol):
    """An object-to-world matrix that changes with time."""

    @property
    def times(self) -> F64:
        """Seconds at which to look at bounds, shape (S,)."""

    def at(self, time: float) -> F64:
        """The matrix, shape (4, 4), at ``time`` seconds."""


class Deformation(Protocol):
    """Vertices that change with time."""

    @property
    def times(self) -> F64:
        """Seconds at which to look at bounds, shape (S,)."""

    def at(self, time: float) -> Shape:
        """The vertices at ``time`` seconds; the same object as long as the time is the same."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Key-framed rigid or scaled motion, linear between keys and held outside them.

    Attributes
    ----------
    times : ndarray, float64, shape (K,)
        Seconds, increasing.
    transforms : ndarray, float64, shape (K, 4, 4)
        World-space matrices applied after the instance's own transform.
    """

    times: F64
    transforms: F64


@dataclass(frozen=True, eq=False)
class Instance:
    """One mesh placed in the world.

    Attributes
    ----------
    transform : ndarray, float64, shape (4, 4)
        Object to world, column vectors; with a placement what that is at time 0.
    motion : Motion or None
        Applied after ``transform`` or ``placement``.
    deformation : Deformation or None
        Its shape at time 0 is the mesh's.
    """

    name: str
    mesh: int
    transform: F64
    motion: Motion | None = None
    placement: Placement | None = None
    deformation: Deformation | None = None

    @property
    def moves(self) -> bool:
        """Whether any time changes its transform or its shape."""
        return self.motion is not None or self.is_animated

    @property
    def is_animated(self) -> bool:
        """Whether an animation of its file moves or deforms it."""
        return self.placement is not None or self.deformation is not None

    @property
    def key_times(self) -> list[float]:
        """See ``Scene.key_times``."""
        animations = (self.motion, self.placement, self.deformation)
        return [float(t) for animation in animations if animation is not None for t in animation.times]

    def transform_at(self, time: float) -> F64:
        """Object-to-world matrix, shape (4, 4), at ``time`` seconds."""
        transform = self.transform if self.placement is None else self.placement.at(time)
        if self.motion is None:
            return transform
        return _interpolate(time, self.motion.times, self.motion.transforms) @ transform

    def mesh_at(self, meshes: tuple[Mesh, ...], time: float) -> Mesh:
        """Its mesh, one of ``meshes``, as it is at ``time`` seconds."""
        mesh = meshes[self.mesh]
        if self.deformation is None:
            return mesh
        shape = self.deformation.at(time)
        return replace(mesh, positions=shape.positions, normals=shape.normals,
                       tangents=None if mesh.tangents is None else shape.tangents)


@dataclass(frozen=True)
class PointLight:
    """A point (radius 0) or a sphere. Intensity in W/sr per channel."""

    position: tuple[float, float, float]
    intensity: Color
    radius: float = 0.0


@dataclass(frozen=True)
class SpotLight:
    """A point or sphere light in a cone; falls off linearly in angle between the two half angles."""

    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    intensity: Color
    inner_deg: float
    outer_deg: float
    radius: float = 0.0


@dataclass(frozen=True)
class DirectionalLight:
    """Parallel light. ``direction`` is the way light travels; irradiance in W/m² on a facing surface."""

    direction: tuple[float, float, float]
    irradiance: Color
    angular_radius_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class EmissionImage:
    """How the radiance of a rectangle light varies over it.

    Attributes
    ----------
    pixels : ndarray, float32, shape (SIDE, SIDE, 3)
        Factors of the light's radiance, 1 on the mean of each channel. Columns go along ``edge_u``, rows along
        ``edge_v``.
    """

    SIDE: ClassVar[int] = 256  # shaders/include/light_image.glsl knows the level of its mipmaps with 4×4 texels

    pixels: F32

    def __post_init__(self) -> None:
        shape = (self.SIDE, self.SIDE, 3)
        if self.pixels.shape != shape or not (np.isfinite(self.pixels) & (self.pixels >= 0)).all():
            raise SceneError("bad pixels", "emission image", f"expected finite factors from 0 on, of the shape {shape}")


@dataclass(frozen=True)
class RectLight:
    """A rectangle that emits ``radiance`` in W/(sr m²) to the side of ``edge_u`` × ``edge_v``.

    Of a surface with a texture, ``radiance`` is the mean, and ``image``, which loading makes, says how it varies. The
    surface is in the scene, and references trace it instead of the light.
    """

    center: tuple[float, float, float]
    edge_u: tuple[float, float, float]
    edge_v: tuple[float, float, float]
    radiance: Color
    two_sided: bool = False
    image: EmissionImage | None = field(default=None, repr=False)


Light = PointLight | SpotLight | DirectionalLight | RectLight


@dataclass(frozen=True, eq=False)
class EmissionPoints:
    """N points of the emissive surfaces that an approximate light stands for, spread evenly by power.

    Attributes
    ----------
    offset : ndarray, float32, shape (N, 3)
        From the light's centre, in world axes.
    normal : ndarray, float32, shape (N, 3)
        Unit length.
    intensity : ndarray, float32, shape (N, 3)
        W/sr of each along its normal; it falls off with the cosine.
    area : ndarray, float32, shape (N,)
        That a point stands for.
    two_sided : ndarray, bool, shape (N,)
        Whether a point also emits against its normal.
    hides_itself : bool
        Whether light that leaves the points meets the surfaces around them, as in a shade that emits within too.
    is_sparse : bool
        Whether the surfaces fill little of the light, as a neon sign does, so that highlights do not have its shape.
    """

    offset: F32
    normal: F32
    intensity: F32
    area: F32
    two_sided: Bools
    hides_itself: bool = False
    is_sparse: bool = False


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from infinitely far away, seen where no surface is.

    Attributes
    ----------
    radiance : ndarray, float32, shape (H, W, 3)
        W/(sr m²), at least 0, latitude-longitude: rows of equal height from straight up (+y) to straight down, columns
        of equal azimuth all around, -z in the middle and +x right of it.
    rotation_deg : float
        Rotation about +y, counter-clockwise seen from above.
    """

    radiance: F32
    rotation_deg: float = 0.0

    @cached_property
    def mean_radiance(self) -> F64:
        """Over the sphere, W/(sr m²), shape (3,)."""
        return np.asarray(self.radiance.mean(axis=(0, 1), dtype=np.float64))


@dataclass(frozen=True)
class Intrinsics:
    """Projection of a calibrated pinhole camera, in pixels of an image of ``width`` and ``height``.

    ``cx``, ``cy`` is where the view axis meets the image, from its upper left corner. An image of another size shows
    the same from its top to its bottom.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: float
    height: float


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, or one that projects in parallel.

    Attributes
    ----------
    fov_y_deg : float
        Vertical field of view in degrees.
    orthographic_height : float or None
        Height of what a parallel projection shows, in scene units; None: perspective.
    intrinsics : Intrinsics or None
        Of a perspective projection; replaces ``fov_y_deg``.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov_y_deg: float = 45.0
    orthographic_height: float | None = None
    intrinsics: Intrinsics | None = None

    def placed(self, matrix: F64) -> Camera:
        """The camera where a matrix of shape (4, 4) takes it; of its scale only mirroring counts.

        Its directions stay where the scale is 0 along two axes or more.
        """
        eye, target, up = (np.asarray(v, np.float64) for v in (self.eye, self.target, self.up))
        axes = unit_columns(matrix[:3, :3])
        forward, up = ((direction if axes is None else axes @ direction) / np.linalg.norm(direction)
                       for direction in (target - eye, up))
        eye = matrix[:3, :3] @ eye + matrix[:3, 3]
        return replace(self, eye=tuple(eye.tolist()), target=tuple((eye + forward).tolist()), up=tuple(up.tolist()))


def unit_columns(matrix: F64) -> F64 | None:
    """The columns of a matrix of shape (3, 3) at unit length; one of length 0 becomes perpendicular to the others.

    None if there are more of these, or if the others are parallel.
    """
    columns = matrix / max(float(np.abs(matrix).max()), MIN_SCALE)  # squares of its smallest numbers would be 0
    lengths = np.linalg.norm(columns, axis=0)
    short = np.flatnonzero(lengths <= MIN_RELATIVE_SCALE)
    if len(short) > 1:
        return None
    columns = columns / np.maximum(lengths, MIN_RELATIVE_SCALE)
    for axis in short:
        perpendicular = np.cross(columns[:, axis - 2], columns[:, axis - 1])
        length = float(np.linalg.norm(perpendicular))
        if length <= MIN_RELATIVE_SCALE:
            return None
        columns[:, axis] = perpendicular / length
    return np.asarray(columns)


@dataclass(frozen=True)
class CameraPath:
    """A fixed (one key) or key-framed camera; linear between keys, of one kind, and held outside them.

    Attributes
    ----------
    placement : Placement or None
        Takes the camera from the space of the keys to the world.
    """

    times: tuple[float, ...]
    keys: tuple[Camera, ...]
    placement: Placement | None = None

    @staticmethod
    def still(camera: Camera) -> CameraPath:
        return CameraPath((0.0,), (camera,))

    @property
    def moves(self) -> bool:
        return len(self.keys) > 1 or self.placement is not None

    def at(self, time: float) -> Camera:
        """The camera at ``time`` seconds."""
        camera = self.keys[0] if len(self.keys) == 1 else self._between_keys(time)
        return camera if self.placement is None else camera.placed(self.placement.at(time))

    def _between_keys(self, time: float) -> Camera:
        rows = np.array([(*k.eye, *k.target, *k.up, k.fov_y_deg, k.orthographic_height or 0.0,
                          *(astuple(k.intrinsics) if k.intrinsics else ())) for k in self.keys], np.float64)
        row = _interpolate(time, np.asarray(self.times), rows).tolist()
        return Camera(tuple(row[:3]), tuple(row[3:6]), tuple(row[6:9]), row[9], row[10] or None,
                      Intrinsics(*row[11:]) if row[11:] else None)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn, for one chosen lighting.

    Attributes
    ----------
    notices : tuple of str
        What the loader guessed, skipped or replaced; the command line prints them.
    approximations : tuple of str
        Which parts of the file's materials are only approximated; ``-v`` prints them.
    bounds : ndarray, float64, shape (2, 3)
        World-space box around all instances at time 0, minimum and maximum corner.
    environment : Environment or None
        None where it is black.
    approximate_lights : dict of Light to EmissionPoints
        Those of ``lights`` that only approximate emissive meshes, and points of these meshes. A reference has the
        meshes' light instead.
    approximated_materials : tuple of int
        Indices of those meshes' materials, all light proxies.
    """

    name: str
    meshes: tuple[Mesh, ...]
    instances: tuple[Instance, ...]
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    cameras: dict[str, CameraPath]
    default_camera: str
    bounds: F64
    lighting: str = ""
    notices: tuple[str, ...] = ()
    approximations: tuple[str, ...] = ()
    environment: Environment | None = None
    approximate_lights: dict[Light, EmissionPoints] = field(default_factory=dict)
    approximated_materials: tuple[int, ...] = ()

    @property
    def exact_lights(self) -> tuple[Light, ...]:
        """Those of ``lights`` that approximate nothing; others stand for surfaces that are in the scene too."""
        return tuple(light for light in self.lights if light not in self.approximate_lights
                     and (not isinstance(light, RectLight) or light.image is None))

    @property
    def triangles(self) -> int:
        return sum(len(self.meshes[i.mesh].triangles) for i in self.instances)

    @property
    def longest_edge(self) -> float:
        """Longest edge of the box at time 0 in scene units; never 0.

        It is at least a hundredth of that of all times, since animated scenes may begin as a point.
        """
        edge = float((self.bounds[1] - self.bounds[0]).max())
        if any(i.moves for i in self.instances):
            edge = max(edge, MIN_REST_SHARE * float((self.swept_bounds[1] - self.swept_bounds[0]).max()))
        return max(edge, 1e-30)

    @property
    def key_times(self) -> list[float]:
        """Seconds at which to look at bounds, in order; 0 is one of them.

        Between two of them motions are linear; animations of a file may leave their bounds a little.
        """
        return key_times_of(self.instances)

    @cached_property
    def swept_bounds(self) -> F64:
        """World-space box, shape (2, 3), around the instances at all ``key_times``; found once, since it takes long."""
        return swept_bounds_of(self.meshes, self.instances)

    def with_lights(self, *lights: Light) -> Scene:
        return self._with_geometry_kept(lights=lights)

    def _with_geometry_kept(self, **changes: Any) -> Scene:
        """Changes of other fields, after which ``swept_bounds`` need not be found again."""
        scene = replace(self, **changes)
        if "swept_bounds" in vars(self):
            vars(scene)["swept_bounds"] = self.swept_bounds
        return scene

    def with_radiance_scale(self, scale: float) -> Scene:
        """The scene with all light and emission multiplied by ``scale``; itself where that is 1."""
        if scale == 1:
            return self
        environment = self.environment
        return self._with_geometry_kept(
            lights=tuple(_scaled_light(light, scale) for light in self.lights),
            approximate_lights={_scaled_light(light, scale): replace(points, intensity=points.intensity * scale)
                                for light, points in self.approximate_lights.items()},
            materials=tuple(_scaled_material(m, scale) for m in self.materials),
            environment=environment and replace(environment, radiance=environment.radiance * np.float32(scale)))


def _scaled(color: Color, scale: float) -> Color:
    r, g, b = color
    return r * scale, g * scale, b * scale


def _scaled_material(material: Material, scale: float) -> Material:
    if material.is_unlit:
        return replace(material, albedo=_scaled(material.albedo, scale))
    return replace(material, emission=_scaled(material.emission, scale))


def _scaled_light(light: Light, scale: float) -> Light:
    match light:
        case DirectionalLight():
            return replace(light, irradiance=_scaled(light.irradiance, scale))
        case RectLight():
            return replace(light, radiance=_scaled(light.radiance, scale))
        case _:
            return replace(light, intensity=_scaled(light.intensity, scale))


def bounds_of(meshes: tuple[Mesh, ...], instances: tuple[Instance, ...], time: float = 0.0) -> F64:
    """World-space bounding box, shape (2, 3), of all instances at ``time`` seconds; zeros for none."""
    if not instances:
        return np.zeros((2, 3))
    corners = [world_box(i.mesh_at(meshes, time), i.transform_at(time)) for i in instances]
    return np.stack([np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)])


def key_times_of(instances: tuple[Instance, ...]) -> list[float]:
    """See ``Scene.key_times``."""
    return sorted({0.0, *(t for i in instances for t in i.key_times)})


def swept_bounds_of(meshes: tuple[Mesh, ...], instances: tuple[Instance, ...]) -> F64:
    """World-space box, shape (2, 3), around the instances at all key times."""
    moving = tuple(i for i in instances if i.moves)
    boxes = [bounds_of(meshes, instances)]
    boxes += [bounds_of(meshes, moving, time) for time in key_times_of(moving) if moving]
    return np.stack([np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)])


def world_box(mesh: Mesh, transform: F64) -> F64:
    """World-space box, shape (2, 3), of the mesh's transformed object-space box, without non-finite vertices."""
    low, high = mesh.positions.min(axis=0).astype(np.float64), mesh.positions.max(axis=0).astype(np.float64)
    if not np.isfinite([low, high]).all():
        finite = mesh.positions[np.isfinite(mesh.positions).all(axis=1)].astype(np.float64)
        low, high = (finite.min(axis=0), finite.max(axis=0)) if len(finite) else (np.zeros(3), np.zeros(3))
    center, half = (low + high) / 2, (high - low) / 2
    world_center = transform[:3, :3] @ center + transform[:3, 3]
    world_half = np.abs(transform[:3, :3]) @ half
    return np.stack([world_center - world_half, world_center + world_half])


def _interpolate(time: float, times: F64, values: F64) -> F64:
    right = int(np.clip(np.searchsorted(times, time), 1, len(times) - 1)) if len(times) > 1 else 0
    if right == 0:
        return values[0]
    span = times[right] - times[right - 1]
    t = float(np.clip((time - times[right - 1]) / span, 0.0, 1.0))
    return (1 - t) * values[right - 1] + t * values[right]
