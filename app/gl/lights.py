"""Lights as the shaders see them: one uniform block, and the places of their shadow maps in an atlas."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError
from app.gl.context import Device
from app.math3d import look_rotation, normalize, orthographic, perspective
from app.scene import DirectionalLight, Light, PointLight, RectLight, Scene, SpotLight

F64 = NDArray[np.float64]
POINT, SPOT, DIRECTIONAL, RECT = range(4)
SINGLE_MAP, CUBE_MAP, PARALLEL_MAP = 1, 2, 3
LIGHT_FLOATS = 32
LIGHT_BYTES = 4 * LIGHT_FLOATS
COLOR = slice(4, 7)  # of a light's floats
NARROW_SPOT_DEG = 55.0
FACE_TEXELS = {CUBE_MAP: 1024, SINGLE_MAP: 2048, PARALLEL_MAP: 4096}  # a side
HARD_CUBE_TEXELS = 1536  # nothing blurs what is finer than a texel
MAX_ATLAS_TEXELS = 2**25
SPOT_MARGIN_DEG = 2.0


@dataclass(frozen=True, eq=False)
class ShadowFace:
    """One square of the atlas.

    Attributes
    ----------
    rect : tuple of int
        x, y, width, height in texels.
    origin : ndarray, float64, shape (3,)
        World-space point that ``clip`` and the stored distances are relative to.
    clip : ndarray, float64, shape (4, 4)
        Projection of points relative to ``origin``, ordinary Z.
    axis : ndarray or None
        Distances are measured along it, or radially when None.
    """

    rect: tuple[int, int, int, int]
    origin: F64
    clip: F64
    axis: F64 | None

    @property
    def frame(self) -> F64:
        """Columns, shape (3, 3): the map's half edges at unit depth, of a parallel one their directions; its axis."""
        x, y, _, w = self.clip[:, :3]
        if self.axis is not None:
            return np.stack([normalize(x), normalize(y), self.axis], axis=1)
        return np.stack([x / (x @ x), y / (y @ y), w], axis=1)


class LightSet:
    """All lights of a scene: their atlas layout, and a uniform block refreshed for each eye.

    Attributes
    ----------
    scale : float
        Power of 256 that brings the scene's radiance to the middle of the half-float range; lights and
        emission are multiplied by it, outputs divided.

    Raises
    ------
    SceneError
        When the device's uniform blocks have no room for so many lights.
    """

    def __init__(self, device: Device, scene: Scene) -> None:
        most = device.ctx.info["GL_MAX_UNIFORM_BLOCK_SIZE"] // LIGHT_BYTES
        if len(scene.lights) > most:
            raise SceneError(f"{len(scene.lights)} lights", scene.name, f"expected at most {most} on {device.renderer}")
        self.lights = scene.lights
        self._bounds = self._swept = scene.swept_bounds
        self._max_size = device.max_size
        self.scale = radiance_scale(scene)
        self.tiles, self.atlas_size = lay_out(scene.lights, device.max_size)
        self.buffer = device.ctx.buffer(reserve=LIGHT_BYTES * max(1, len(self.lights)))

    def take(self, scene: Scene) -> bool:
        """Take over the lights of ``scene`` if shaders, shadow maps and scale stay the same by it; whether they do."""
        other = copy(self)
        other.lights, other.scale = scene.lights, radiance_scale(scene)
        other.tiles, other.atlas_size = lay_out(scene.lights, self._max_size)
        if (other.defines, other.tiles, other.scale) != (self.defines, self.tiles, self.scale):
            return False
        self.lights = scene.lights
        return True

    def cover(self, boxes: F64) -> None:
        """Have shadow maps reach to world-space ``boxes``, shape (N, 2, 3), that lie outside of where things move."""
        low, high = boxes[:, 0].min(axis=0, initial=np.inf), boxes[:, 1].max(axis=0, initial=-np.inf)
        self._bounds = np.stack([np.minimum(self._swept[0], low), np.maximum(self._swept[1], high)])

    @property
    def soft(self) -> bool:
        """Whether any light has a size."""
        return any(_size_of(light) > 0 for light in self.lights)

    @property
    def hard(self) -> bool:
        """Whether any light has none."""
        return any(_size_of(light) <= 0 for light in self.lights)

    @property
    def shadow_maps(self) -> tuple[str, ...]:
        """The shadow pass's resources that the shaders look these lights up in."""
        wanted = {"shadow": bool(self.lights), "shadow_slope": self.hard, "shadow_nearest": self.soft}
        return tuple(name for name, there in wanted.items() if there)

    @property
    def defines(self) -> dict[str, object]:
        """Shader defines: how many lights, which kinds, and whether any has a size."""
        kinds = {type(light) for light in self.lights}
        names = {PointLight: "POINT", SpotLight: "SPOT", DirectionalLight: "DIRECTIONAL", RectLight: "RECT"}
        found: dict[str, object] = {f"HAS_{names[k]}_LIGHT": 1 for k in sorted(kinds, key=lambda k: k.__name__)}
        if self.soft:
            found["HAS_SOFT_LIGHT"] = 1
        if self.hard:
            found["HAS_HARD_LIGHT"] = 1
        maps = {SINGLE_MAP: "SINGLE", CUBE_MAP: "CUBE", PARALLEL_MAP: "PARALLEL"}
        found |= {f"HAS_{maps[kind]}_MAP": 1 for kind in sorted({tile.kind for tile in self.tiles})}
        return {"LIGHT_COUNT": len(self.lights), **found}

    def upload(self, eye: F64) -> None:
        """Write the block with positions relative to ``eye``."""
        rows = np.zeros((max(1, len(self.lights)), LIGHT_FLOATS), np.float32)
        for row, light, tile in zip(rows, self.lights, self.tiles, strict=False):
            self._pack(row.reshape(8, 4), light, tile, eye)
        self.buffer.write(_sanitized(rows).tobytes())

    def _pack(self, row: NDArray[np.float32], light: Light, tile: Tile, eye: F64) -> None:
        position, color, u, v, place, frame_x, frame_y, frame_z = row
        place[:] = (*tile.corner, tile.face, tile.kind)
        color[3] = _kind_of(light)
        if isinstance(light, DirectionalLight):
            parallel = self._parallel(light)
            position[:] = (*-parallel.direction, math.tan(math.radians(light.angular_radius_deg)))
            color[:3] = np.multiply(light.irradiance, self.scale)
            center = parallel.center - eye
            for frame, axis, bias in ((frame_x, parallel.rotation[0], 0.0), (frame_y, parallel.rotation[1], 0.0),
                                      (frame_z, parallel.direction, parallel.half)):
                frame[:] = (*axis, bias - float(axis @ center))
            u[0] = parallel.half
            return
        if isinstance(light, RectLight):
            position[:3] = np.subtract(light.center, eye)
            color[:3] = np.multiply(light.radiance, self.scale)
            u[:3], v[:3] = np.divide(light.edge_u, 2), np.divide(light.edge_v, 2)
            v[3] = float(light.two_sided)
            return
        position[:] = (*np.subtract(light.position, eye), light.radius)
        color[:3] = np.multiply(light.intensity, self.scale)
        if isinstance(light, SpotLight):
            u[:3] = normalize(np.asarray(light.direction, np.float64))
            v[:2] = np.radians([light.inner_deg, light.outer_deg])
            rotation, tan_half = _spot_frame(light)
            frame_x[:3], frame_y[:3] = rotation[0] / tan_half, rotation[1] / tan_half
            frame_z[:3] = -rotation[2]

    def _parallel(self, light: DirectionalLight) -> _Parallel:
        direction = normalize(np.asarray(light.direction, np.float64))
        half = float(np.linalg.norm(self._bounds[1] - self._bounds[0])) / 2 * 1.01 + 1e-30
        rotation = look_rotation(direction, np.array([0.0, 1.0, 0.0]))
        return _Parallel(rotation, direction, self._bounds.mean(axis=0), half)

    def faces(self) -> list[ShadowFace]:
        """Every square of the atlas that has to be drawn."""
        return [face for light, tile in zip(self.lights, self.tiles, strict=True) for face in self._faces(light, tile)]

    def _faces(self, light: Light, tile: Tile) -> list[ShadowFace]:
        x, y, n = *tile.corner, tile.face
        if isinstance(light, DirectionalLight):
            p = self._parallel(light)
            clip = orthographic(p.half, 0.0, 2 * p.half) @ _rotate(p.rotation)
            return [ShadowFace((x, y, n, n), p.center - p.half * p.direction, clip, p.direction)]
        origin = np.asarray(light.center if isinstance(light, RectLight) else light.position, np.float64)
        far = float(np.linalg.norm(np.maximum(np.abs(self._bounds[0] - origin), np.abs(self._bounds[1] - origin))))
        near = far * 2e-4 + 1e-30
        far = far * 1.01 + 2 * near
        if tile.kind == SINGLE_MAP:
            assert isinstance(light, SpotLight)
            rotation, tan_half = _spot_frame(light)
            return [ShadowFace((x, y, n, n), origin, perspective(tan_half, near, far) @ _rotate(rotation), None)]
        return [ShadowFace((x + n * axis, y + n * row, n, n), origin,
                           perspective(1.0, near, far) @ _axis_view(axis, sign), None)
                for axis in range(3) for row, sign in enumerate((-1.0, 1.0))]


@dataclass(frozen=True)
class Tile:
    """Where a light's map lies: lower left corner and face size in texels, and its kind."""

    corner: tuple[int, int]
    face: int
    kind: int


@dataclass(frozen=True, eq=False)
class _Parallel:
    rotation: F64
    direction: F64
    center: F64
    half: float


def _sanitized(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light blocks in which a light with a number that is not finite is black, and none takes light away."""
    finite = np.isfinite(rows)
    rows = np.where(finite, rows, np.float32(0))
    rows[:, COLOR] = np.where(finite.all(axis=1, keepdims=True), np.maximum(rows[:, COLOR], 0), 0)
    return rows


def radiance_scale(scene: Scene) -> float:
    """A power of 256 that brings typical reflected radiance to 1/16 … 16; mostly 1, which read-back need not undo."""
    distance = scene.longest_edge / 4
    estimates = [max(m.emission) for m in scene.materials if m.emits]
    if scene.environment is not None:
        estimates.append(float(scene.environment.radiance.mean(axis=(0, 1), dtype=np.float64).max()))
    for light in scene.lights:
        match light:
            case PointLight() | SpotLight():
                irradiance = max(light.intensity) / distance**2
            case DirectionalLight():
                irradiance = max(light.irradiance)
            case RectLight():
                area = float(np.linalg.norm(np.cross(light.edge_u, light.edge_v)))
                irradiance = max(light.radiance) * min(area / distance**2, math.pi)
        estimates.append(irradiance / (2 * math.pi))
    brightest = max((e for e in estimates if math.isfinite(e)), default=0.0)
    if brightest <= 0:
        return 1.0
    return float(256.0 ** max(-12, min(12, -round(math.log2(brightest) / 8))))


def lay_out(lights: tuple[Light, ...], max_size: int) -> tuple[list[Tile], tuple[int, int]]:
    """Shelves of tiles: finer ones for hard six-face maps if the atlas fits then, and all halved until it does.

    Returns
    -------
    tiles : list of Tile
        One for each light.
    size : tuple of int
        Width and height of the atlas, in texels.
    """
    usual = FACE_TEXELS[CUBE_MAP]
    for hard, shrink in ((HARD_CUBE_TEXELS, 0), *((usual, shrink) for shrink in range(9))):
        tiles, size = _shelves(lights, hard, shrink, max_size)
        if size[0] * size[1] <= MAX_ATLAS_TEXELS and max(size) <= max_size:
            break
    return tiles, size


def _shelves(lights: tuple[Light, ...], hard: int, shrink: int,
             max_size: int) -> tuple[list[Tile], tuple[int, int]]:
    limit = min(max_size, 8192)
    tiles, x, y, shelf, width = [], 0, 0, 0, 1
    for light in lights:
        kind = _map_kind(light)
        face = (hard if kind == CUBE_MAP and _size_of(light) <= 0 else FACE_TEXELS[kind]) >> shrink
        w, h = (3 * face, 2 * face) if kind == CUBE_MAP else (face, face)
        if x + w > limit:
            x, y, shelf = 0, y + shelf, 0
        tiles.append(Tile((x, y), face, kind))
        x, shelf = x + w, max(shelf, h)
        width = max(width, x)
    return tiles, (width, max(1, y + shelf))


def _kind_of(light: Light) -> int:
    return {PointLight: POINT, SpotLight: SPOT, DirectionalLight: DIRECTIONAL, RectLight: RECT}[type(light)]


def _map_kind(light: Light) -> int:
    if isinstance(light, DirectionalLight):
        return PARALLEL_MAP
    if isinstance(light, SpotLight) and light.outer_deg <= NARROW_SPOT_DEG:
        return SINGLE_MAP
    return CUBE_MAP


def _size_of(light: Light) -> float:
    if isinstance(light, DirectionalLight):
        return light.angular_radius_deg
    return 1.0 if isinstance(light, RectLight) else light.radius


def _spot_frame(light: SpotLight) -> tuple[F64, float]:
    rotation = look_rotation(np.asarray(light.direction, np.float64), np.array([0.0, 1.0, 0.0]))
    return rotation, math.tan(math.radians(min(light.outer_deg + SPOT_MARGIN_DEG, 80.0)))


def _axis_view(axis: int, sign: float) -> F64:
    """View along ``sign`` × world ``axis`` whose right and up are the two axes after it; possibly mirrored."""
    rows = np.zeros((4, 4))
    rows[0, (axis + 1) % 3] = rows[1, (axis + 2) % 3] = rows[3, 3] = 1.0
    rows[2, axis] = -sign
    return rows


def _rotate(rotation: F64) -> F64:
    m = np.eye(4)
    m[:3, :3] = rotation
    return m

