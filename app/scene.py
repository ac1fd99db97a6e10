"""The scene as plain data: meshes, materials, lights, cameras. No GL, no files.

Right-handed, y up, the scene's own units. Colours are linear Rec. 709.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64

Color = tuple[float, float, float]


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
    """

    pixels: NDArray[np.uint8] | F32
    transform: F64 = field(default_factory=lambda: np.eye(3))
    repeat: tuple[bool, bool] = (True, True)


@dataclass(frozen=True, eq=False)
class Material:
    """A diffuse surface with an optional GGX lobe and an optional emission.

    Attributes
    ----------
    albedo : tuple of float
        Diffuse reflectance, linear; multiplied by ``albedo_map`` and vertex colours.
    alpha_cutoff : float or None
        Texels whose alpha (``alpha`` × map × vertex) is below are not there; None: opaque.
    emission : tuple of float
        Radiance in W/(sr m²); multiplied by ``emission_map``.
    roughness : float
        Perceptual GGX roughness; alpha = roughness².
    specular : tuple of float
        Reflectance at normal incidence (F0); zeros mean that there is no highlight at all.
    double_sided : bool
        Whether the back emits too. Both sides always reflect.
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
    specular: Color = (0.0, 0.0, 0.0)
    double_sided: bool = True
    is_light_proxy: bool = False

    @property
    def emits(self) -> bool:
        return max(self.emission) > 0.0

    @property
    def has_specular(self) -> bool:
        return max(self.specular) > 0.0


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

    def __post_init__(self) -> None:
        assert self.positions.dtype == np.float32 and self.positions.ndim == 2
        assert self.normals.shape == self.positions.shape and self.normals.dtype == np.float32
        assert self.triangles.dtype == np.uint32 and self.triangles.shape[1:] == (3,)


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
    """One mesh placed in the world; ``transform`` is object to world, column vectors, float64."""

    name: str
    mesh: int
    transform: F64
    motion: Motion | None = None

    def transform_at(self, time: float) -> F64:
        """Object-to-world matrix, shape (4, 4), at ``time`` seconds."""
        if self.motion is None:
            return self.transform
        return _interpolate(time, self.motion.times, self.motion.transforms) @ self.transform


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


@dataclass(frozen=True)
class RectLight:
    """A rectangle that emits ``radiance`` in W/(sr m²) to the side of ``edge_u`` × ``edge_v``."""

    center: tuple[float, float, float]
    edge_u: tuple[float, float, float]
    edge_v: tuple[float, float, float]
    radiance: Color
    two_sided: bool = False


Light = PointLight | SpotLight | DirectionalLight | RectLight


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


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. Vertical field of view in degrees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov_y_deg: float = 45.0


@dataclass(frozen=True)
class CameraPath:
    """A fixed (one key) or key-framed camera; linear between keys and held outside them."""

    times: tuple[float, ...]
    keys: tuple[Camera, ...]

    @staticmethod
    def still(camera: Camera) -> CameraPath:
        return CameraPath((0.0,), (camera,))

    @property
    def moves(self) -> bool:
        return len(self.keys) > 1

    def at(self, time: float) -> Camera:
        """The camera at ``time`` seconds."""
        if not self.moves:
            return self.keys[0]
        rows = np.array([(*k.eye, *k.target, *k.up, k.fov_y_deg) for k in self.keys], np.float64)
        row = _interpolate(time, np.asarray(self.times), rows).tolist()
        return Camera(tuple(row[:3]), tuple(row[3:6]), tuple(row[6:9]), row[9])


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn, for one chosen lighting.

    Attributes
    ----------
    notices : tuple of str
        What the loader guessed, skipped or approximated; the command line prints them.
    bounds : ndarray, float64, shape (2, 3)
        World-space box around all instances at time 0, minimum and maximum corner.
    environment : Environment or None
        None where it is black.
    approximate_lights : tuple of Light
        Those of ``lights`` that only approximate emissive meshes. A reference has the meshes' light instead.
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
    environment: Environment | None = None
    approximate_lights: tuple[Light, ...] = ()
    approximated_materials: tuple[int, ...] = ()

    @property
    def exact_lights(self) -> tuple[Light, ...]:
        """Those of ``lights`` that approximate nothing."""
        return tuple(light for light in self.lights if light not in self.approximate_lights)

    @property
    def triangles(self) -> int:
        return sum(len(self.meshes[i.mesh].triangles) for i in self.instances)

    @property
    def longest_edge(self) -> float:
        """Longest edge of the bounding box in scene units; never 0."""
        return max(float((self.bounds[1] - self.bounds[0]).max()), 1e-30)

    @property
    def key_times(self) -> list[float]:
        """Seconds between which all motion is linear, in order; 0 is one of them."""
        return sorted({0.0} | {float(t) for i in self.instances if i.motion is not None for t in i.motion.times})

    @property
    def swept_bounds(self) -> F64:
        """World-space box, shape (2, 3), around all positions of the instances; motion is linear between keys."""
        boxes = [bounds_of(self.meshes, self.instances, time) for time in self.key_times]
        return np.stack([np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)])

    def with_lights(self, *lights: Light) -> Scene:
        return replace(self, lights=lights)

    def with_radiance_scale(self, scale: float) -> Scene:
        """The scene with all light and emission multiplied by ``scale``; itself where that is 1."""
        if scale == 1:
            return self
        environment = self.environment
        return replace(
            self, lights=tuple(_scaled_light(light, scale) for light in self.lights),
            approximate_lights=tuple(_scaled_light(light, scale) for light in self.approximate_lights),
            materials=tuple(replace(m, emission=_scaled(m.emission, scale)) for m in self.materials),
            environment=environment and replace(environment, radiance=environment.radiance * np.float32(scale)))


def _scaled(color: Color, scale: float) -> Color:
    r, g, b = color
    return r * scale, g * scale, b * scale


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
    corners = [world_box(meshes[i.mesh], i.transform_at(time)) for i in instances]
    return np.stack([np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)])


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
