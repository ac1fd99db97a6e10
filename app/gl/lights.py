"""Lights as the shaders see them: one uniform block, and the views of their shadow maps."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from itertools import zip_longest

import moderngl
import numpy as np

from app.arrays import F32, F64, Bools
from app.errors import SceneError
from app.gl.context import Device
from app.gl.near_cascade import Cascade, cascade_around
from app.gl.shadow_atlas import CUBE_MAP, PARALLEL_MAP, SINGLE_MAP, Tile, lay_out, size_of
from app.math3d import affine_matrix, look_rotation, normalize, orthographic, perspective
from app.scene import DirectionalLight, Light, PointLight, RectLight, Scene, SpotLight, bounds_of, swept_bounds_of

# In the order of the numbers in lights.glsl.
LIGHT_KINDS = {PointLight: "POINT", SpotLight: "SPOT", DirectionalLight: "DIRECTIONAL", RectLight: "RECT"}
MAP_NAMES = {SINGLE_MAP: "SINGLE", CUBE_MAP: "CUBE", PARALLEL_MAP: "PARALLEL"}
LIGHT_FLOATS = 32
LIGHT_BYTES = 4 * LIGHT_FLOATS
COLOR = slice(4, 7)  # of a light's floats
SPOT_MARGIN_DEG = 2.0
FLAT = 1e-6      # height of a level floor, of its longest edge: rounding
SUNK = 1e-3      # share of the scene's height by which what is not level may lie below a floor, as feet do
MAX_THROW = 0.5  # of half the scene's size: blockers of parallel light farther away are not searched
IN_PLANE = 1e-4  # of a rectangle's size: points so near its plane count as in it, or rounding would decide their side

POINT_ROWS = 5   # of texels for the emission points of a light
POINT_LEVELS = 5  # of the tree of its points below the root
# Texture units beyond those that one stage can have samplers for.
POINTS_UNIT = 33
IMAGES_UNIT = 36

TRANSMITTANCE_MAPS = "shadow_transmittance", "shadow_transmittance_depth"
NEAREST_TRANSMITTANCE = "shadow_transmittance_nearest"


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

    Parameters
    ----------
    traced : tuple of bool, optional
        Whether the shadows of each light of the scene are traced; default none. The others have shadow maps.
    near_distance : callable, optional
        Distance of what is near a world-space eye, asked if directional lights have maps; default infinite.

    Attributes
    ----------
    lights : tuple of Light
        Those with maps first, then spheres, then rectangles, as in the uniform block; those of both that are sparse
        follow each other, and those with an image come last.
    mapped : tuple of Light
        Those with maps.
    bounds : ndarray, float64, shape (2, 3)
        World-space box around all motions and what ``cover`` was told of last.
    standing : ndarray, float64, shape (2, 3)
        The same without floors that nothing is below, which shade nothing in light from above: its maps fit this.
    cascades : tuple of Cascade or None
        The near cascade of each light with a map around the eye that ``follow`` was told of last.
    has_cascades : bool
        Whether the atlas has room for near cascades, since an eye needed one.

    Raises
    ------
    SceneError
        When the device's uniform blocks have no room for so many lights.
    """

    def __init__(self, device: Device, scene: Scene, traced: tuple[bool, ...] = (),
                 near_distance: Callable[[F64], float] = lambda _: math.inf) -> None:
        max_lights = device.ctx.info["GL_MAX_UNIFORM_BLOCK_SIZE"] // LIGHT_BYTES
        if len(scene.lights) > max_lights:
            raise SceneError(f"{len(scene.lights)} lights are too many for {device.renderer}", scene.name,
                             f"expected at most {max_lights}")
        self._ctx = device.ctx
        self._set_lights(scene, traced or (False,) * len(scene.lights))
        self.bounds = self._swept = scene.swept_bounds
        self._floors = _floors(scene)
        standing = tuple(scene.instances[k] for k in np.flatnonzero(~self._floors))
        self._swept_standing = swept_bounds_of(scene.meshes, standing) if self._floors.any() else scene.swept_bounds
        self.standing = self._swept_standing
        self._has_see_through = any(m.is_see_through for m in scene.materials)
        self._max_size = device.max_size
        self._near_distance = near_distance
        self.cascades: tuple[Cascade | None, ...] = (None,) * len(self.mapped)
        self.has_cascades = False
        self._lay_out()
        self.buffer = device.ctx.buffer(reserve=LIGHT_BYTES * max(1, len(self.lights)))
        self._emission_points, self._light_images = self._make_emission_points(), self._make_light_images()

    def _set_lights(self, scene: Scene, traced: tuple[bool, ...]) -> None:
        self.mapped = tuple(light for light, is_traced in zip(scene.lights, traced, strict=True) if not is_traced)
        others = [light for light, is_traced in zip(scene.lights, traced, strict=True) if is_traced]
        self._points = {light: scene.approximate_lights[light] for light in others if light in scene.approximate_lights}
        images = [light.image for light in others if isinstance(light, RectLight) and light.image is not None]
        self._images, self._image_count = tuple(dict.fromkeys(images)), len(images)
        sparse = {light for light, points in self._points.items() if points.is_sparse}
        # Spheres, then rectangles, and sparse ones between the others; those with an image last.
        others.sort(key=lambda light: (isinstance(light, RectLight), getattr(light, "image", None) is not None,
                                       isinstance(light, RectLight) != (light in sparse)))
        self.lights = (*self.mapped, *others)
        places = [place for place, light in enumerate(others, len(self.mapped)) if light in sparse]
        self._sparse = range(places[0], places[-1] + 1) if places else range(0)

    def _lay_out(self) -> None:
        self.tiles, self.cascade_tiles, self.atlas_size = lay_out(self.mapped, self._max_size, self.has_cascades)

    def _make_emission_points(self) -> moderngl.Texture | None:
        """A texture with ``POINT_ROWS`` rows for each traced light that only approximates emissive surfaces."""
        if not self._points:
            return None
        width = max(2 << POINT_LEVELS, max(len(points.area) for points in self._points.values()))
        texels = np.zeros((len(self._points), POINT_ROWS, width, 4), np.float32)
        for (positions, normals, intensities, nodes, shares), points in zip(texels, self._points.values(), strict=True):
            count = len(points.area)
            positions[:count] = np.concatenate([points.offset, points.area[:, None] / np.float32(math.pi)], axis=1)
            normals[:count] = np.concatenate([points.normal, points.two_sided[:, None]], axis=1)
            intensities[:count, :3] = points.intensity
            nodes[:2 << POINT_LEVELS] = _tree(positions[:count])
            shares[:2 << POINT_LEVELS, :3] = _shares(points.intensity)
        return self._ctx.texture((width, texels.shape[0] * POINT_ROWS), 4, texels.tobytes(), dtype="f4")

    def _make_light_images(self) -> moderngl.TextureArray | None:
        """A texture with a layer for each image of traced lights."""
        if not self._images:
            return None
        pixels = np.stack([image.pixels for image in self._images])
        layers, height, width, _ = pixels.shape
        texels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=3).astype(np.float16)
        texture = self._ctx.texture_array((width, height, layers), 4, texels.tobytes(), dtype="f2")
        texture.build_mipmaps()
        texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        texture.repeat_x = texture.repeat_y = False
        return texture

    def bind_emission_points(self) -> dict[str, object]:
        """Bind the emission points of traced lights, if any has some; the uniform of shaders that read them."""
        if self._emission_points is None:
            return {}
        self._emission_points.use(POINTS_UNIT)
        return {"emission_points": POINTS_UNIT}

    def bind_light_images(self) -> dict[str, object]:
        """Bind the images of traced lights, if any has one; the uniform of shaders that include lights.glsl."""
        if self._light_images is None:
            return {}
        self._light_images.use(IMAGES_UNIT)
        return {"light_images": IMAGES_UNIT}

    def release(self) -> None:
        for resource in (self.buffer, self._emission_points, self._light_images):
            if resource is not None:
                resource.release()

    def replace(self, scene: Scene, traced: tuple[bool, ...]) -> bool:
        """Take the lights of ``scene`` if they need the same shaders and shadow maps; whether they do."""
        other = copy(self)
        other._set_lights(scene, traced)
        other._lay_out()
        if (other.defines, other.tiles) != (self.defines, self.tiles):
            return False
        self.lights, self.mapped = other.lights, other.mapped
        if self._points != other._points:  # the points themselves are compared by identity
            if self._emission_points is not None:
                self._emission_points.release()
            self._points, self._emission_points = other._points, other._make_emission_points()
        if self._images != other._images:  # as are images
            if self._light_images is not None:
                self._light_images.release()
            self._images, self._light_images = other._images, other._make_light_images()
        return True

    def cover(self, boxes: F64) -> None:
        """Extend shadow maps to world-space ``boxes``, shape (N, 2, 3), that lie outside the bounds of all motions."""
        self.bounds = _extended(self._swept, boxes)
        are_floors = self._floors.any() and _level_floors(boxes, _tolerance(self._swept))[self._floors].all()
        self.standing = _extended(self._swept_standing, boxes[~self._floors]) if are_floors else self.bounds

    def follow(self, eye: F64) -> bool:
        """Move near cascades to a world-space eye; whether they need other shaders and another atlas from now on."""
        if not any(isinstance(light, DirectionalLight) for light in self.mapped):
            return False
        near = self._near_distance(eye)
        self.cascades = tuple(self._cascade(light, eye, near) if isinstance(light, DirectionalLight) else None
                              for light in self.mapped)
        if self.has_cascades or not any(self.cascades):
            return False
        self.has_cascades = True
        self._lay_out()
        return True

    def _cascade(self, light: DirectionalLight, eye: F64, near: float) -> Cascade | None:
        whole = self._parallel(light)
        return cascade_around(whole.rotation[:2] @ (eye - whole.center), whole.half, near)

    @property
    def has_soft_maps(self) -> bool:
        """Whether any light with a size has a shadow map."""
        return any(size_of(light) > 0 for light in self.mapped)

    @property
    def has_hard_maps(self) -> bool:
        """Whether any light without a size has a shadow map."""
        return any(size_of(light) <= 0 for light in self.mapped)

    @property
    def has_traced(self) -> bool:
        """Whether the shadows of any light are traced."""
        return len(self.mapped) < len(self.lights)

    @property
    def _is_tinted(self) -> bool:
        """Whether light of the maps can pass surfaces that only take a part of it."""
        return bool(self.mapped) and self._has_see_through

    @property
    def shadow_maps(self) -> tuple[str, ...]:
        """The resources of the shadow pass that the shaders of these lights read."""
        needed = {"shadow": bool(self.mapped), "shadow_slope": self.has_hard_maps,
                  "shadow_nearest": self.has_soft_maps, **dict.fromkeys(TRANSMITTANCE_MAPS, self._is_tinted),
                  NEAREST_TRANSMITTANCE: self._is_tinted and self.has_soft_maps}
        return tuple(name for name, is_needed in needed.items() if is_needed)

    @property
    def defines(self) -> dict[str, object]:
        """Shader defines: the number of lights, their kinds, whether any has a size, and their kinds of shadows."""
        traced = self.lights[len(self.mapped):]
        rect_count = sum(isinstance(light, RectLight) for light in traced)
        flags = {
            **{f"HAS_{LIGHT_KINDS[type(light)]}_LIGHT": True for light in self.lights},
            "HAS_SOFT_LIGHT": any(size_of(light) > 0 for light in self.lights),
            "HAS_SOFT_MAP": self.has_soft_maps, "HAS_HARD_MAP": self.has_hard_maps,
            **{f"HAS_{MAP_NAMES[tile.kind]}_MAP": True for tile in self.tiles},
            "HAS_TRACED_LIGHT": bool(traced), "HAS_TRACED_SPHERE": rect_count < len(traced),
            "HAS_TRACED_RECT": rect_count > 0, "HAS_EMISSION_POINTS": bool(self._points),
            "HAS_SPARSE_LIGHT": bool(self._sparse), "HAS_LIGHT_IMAGES": bool(self._images),
            "HAS_PLAIN_RECT": rect_count > self._image_count,
        }
        return {"LIGHT_COUNT": len(self.lights), "MAPPED_COUNT": len(self.mapped),
                "RECTS_BEGIN": len(self.lights) - rect_count,
                **({"IMAGES_BEGIN": len(self.lights) - self._image_count} if self._images else {}),
                **({"POINT_LEVELS": POINT_LEVELS} if self._points else {}),
                **({"SPARSE_BEGIN": self._sparse.start, "SPARSE_END": self._sparse.stop} if self._sparse else {}),
                **{name: 1 for name in sorted(flags) if flags[name]}}

    def upload(self, eye: F64) -> None:
        """Write the block with positions relative to ``eye``."""
        rows = np.zeros((max(1, len(self.lights)), LIGHT_FLOATS), np.float32)
        for row, light, tile in zip_longest(rows[:len(self.lights)], self.lights, self.tiles):
            self._pack(row.reshape(8, 4), light, tile, eye)
        for row, cascade, tile in zip(rows, self.cascades, self.cascade_tiles, strict=False):
            if cascade is not None and tile is not None:
                u, v = row.reshape(8, 4)[2:4]
                u[2:], v[:] = (cascade.half, tile.face), (*cascade.center, *tile.corner)
        self.buffer.write(_sanitize(rows).tobytes())

    def _pack(self, row: F32, light: Light, tile: Tile | None, eye: F64) -> None:
        position, color, u, v, location, frame_x, frame_y, frame_z = row
        if tile is not None:
            location[:] = (*tile.corner, tile.face, tile.kind)
        elif light in self._points:
            location[:2] = POINT_ROWS * list(self._points).index(light), len(self._points[light].area)
        color[3] = list(LIGHT_KINDS).index(type(light))
        if isinstance(light, DirectionalLight):
            parallel = self._parallel(light)
            position[:] = (*-parallel.direction, math.tan(math.radians(light.angular_radius_deg)))
            color[:3] = light.irradiance
            center = parallel.center - eye
            for frame, axis, bias in ((frame_x, parallel.rotation[0], 0.0), (frame_y, parallel.rotation[1], 0.0),
                                      (frame_z, parallel.direction, parallel.half)):
                frame[:] = (*axis, bias - float(axis @ center))
            u[:2] = parallel.half, MAX_THROW / 2 * np.linalg.norm(self.bounds[1] - self.bounds[0])
            return
        if isinstance(light, RectLight):
            position[:3] = np.subtract(light.center, eye)
            color[:3] = light.radiance
            u[:3], v[:3] = np.divide(light.edge_u, 2), np.divide(light.edge_v, 2)
            u[3] = IN_PLANE * (np.linalg.norm(u[:3]) + np.linalg.norm(v[:3]))
            v[3] = float(light.two_sided)
            for frame, edge in ((frame_x, light.edge_u), (frame_y, light.edge_v)):
                half = np.divide(edge, 2)
                frame[:] = (*normalize(half), np.linalg.norm(half))
            frame_z[:3] = normalize(np.cross(np.divide(light.edge_u, 2), np.divide(light.edge_v, 2)))
            if light.image is not None and light.image in self._images:
                position[3], frame_z[3] = light.image.pixels.max(), 1 + self._images.index(light.image)
            return
        position[:] = (*np.subtract(light.position, eye), light.radius)
        color[:3] = light.intensity
        if isinstance(light, SpotLight):
            u[:3] = normalize(np.asarray(light.direction, np.float64))
            v[:2] = np.radians([light.inner_deg, light.outer_deg])
            rotation, tan_half = _spot_frame(light)
            frame_x[:3], frame_y[:3] = rotation[0] / tan_half, rotation[1] / tan_half
            frame_z[:3] = -rotation[2]

    def _parallel(self, light: DirectionalLight) -> _Parallel:
        direction = normalize(np.asarray(light.direction, np.float64))
        bounds = self.standing if direction[1] < 0 else self.bounds
        half = float(np.linalg.norm(bounds[1] - bounds[0])) / 2 * 1.01 + 1e-30
        rotation = look_rotation(direction, np.array([0.0, 1.0, 0.0]))
        return _Parallel(rotation, direction, bounds.mean(axis=0), half)

    def faces(self) -> list[ShadowFace]:
        """Every square of the atlas but the near cascades."""
        return [face for light, tile in zip(self.mapped, self.tiles, strict=True) for face in self._faces(light, tile)]

    def cascade_faces(self) -> list[ShadowFace]:
        """The squares of near cascades, with distances as in the maps of the whole scene."""
        return [self._parallel_face(light, tile, cascade)
                for light, tile, cascade in zip(self.mapped, self.cascade_tiles, self.cascades, strict=True)
                if isinstance(light, DirectionalLight) and tile is not None and cascade is not None]

    def _faces(self, light: Light, tile: Tile) -> list[ShadowFace]:
        if isinstance(light, DirectionalLight):
            return [self._parallel_face(light, tile, None)]
        x, y, n = *tile.corner, tile.face
        origin = np.asarray(light.center if isinstance(light, RectLight) else light.position, np.float64)
        far = float(np.linalg.norm(np.maximum(np.abs(self.bounds[0] - origin), np.abs(self.bounds[1] - origin))))
        near = far * 2e-4 + 1e-30
        far = far * 1.01 + 2 * near
        if tile.kind == SINGLE_MAP:
            assert isinstance(light, SpotLight)
            rotation, tan_half = _spot_frame(light)
            clip = perspective(tan_half, near, far) @ affine_matrix(rotation)
            return [ShadowFace((x, y, n, n), origin, clip, None)]
        return [ShadowFace((x + n * axis, y + n * row, n, n), origin,
                           perspective(1.0, near, far) @ _axis_view(axis, sign), None)
                for axis in range(3) for row, sign in enumerate((-1.0, 1.0))]

    def _parallel_face(self, light: DirectionalLight, tile: Tile, cascade: Cascade | None) -> ShadowFace:
        """The map of the whole scene, or of a cascade."""
        p = self._parallel(light)
        half, center = (p.half, (0.0, 0.0)) if cascade is None else (cascade.half, cascade.center)
        clip = orthographic(half, 0.0, 2 * p.half) @ affine_matrix(p.rotation, (-center[0], -center[1], 0.0))
        return ShadowFace((*tile.corner, tile.face, tile.face), p.center - p.half * p.direction, clip, p.direction)


@dataclass(frozen=True, eq=False)
class _Parallel:
    rotation: F64
    direction: F64
    center: F64
    half: float


def _shares(intensity: F32) -> F64:
    """The share that each node of ``_tree`` has of the light of points, shape (2 << POINT_LEVELS, 3)."""
    shares = np.zeros((2 << POINT_LEVELS, 3))
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(intensity, axis=0, dtype=np.float64)])
    for level in range(POINT_LEVELS + 1):
        ends = np.arange((1 << level) + 1) * len(intensity) / (1 << level)
        at = np.stack([np.interp(ends, np.arange(len(sums)), channel) for channel in sums.T], axis=1)
        shares[1 << level:2 << level] = np.diff(at, axis=0) / np.maximum(sums[-1], 1e-30)
    return shares


def _tree(points: F32) -> F64:
    """Balls around equal parts of points in order: node k has the halves 2 k and 2 k + 1, and the root is 1.

    Parameters
    ----------
    points : ndarray, float32, shape (N, 4)
        Position and squared radius.

    Returns
    -------
    ndarray, float64, shape (2 << POINT_LEVELS, 4)
        Mean position, and mean square of the distance from there; row 0 is unused.
    """
    nodes = np.zeros((2 << POINT_LEVELS, 4))
    squares = np.square(points[:, :3].astype(np.float64)).sum(axis=1) + points[:, 3]
    sums = np.cumsum(np.concatenate([points[:, :3], squares[:, None]], axis=1), axis=0, dtype=np.float64)
    sums = np.concatenate([np.zeros((1, 4)), sums])
    for level in range(POINT_LEVELS + 1):
        part = np.arange(1 << level) * len(points) / (1 << level)
        first = part.astype(np.int64)
        end = np.maximum(np.ceil(part + len(points) / (1 << level)).astype(np.int64), first + 1)
        means = (sums[end] - sums[first]) / (end - first)[:, None]
        means[:, 3] -= np.square(means[:, :3]).sum(axis=1)
        nodes[1 << level:2 << level] = means
    nodes[:, 3] = np.maximum(nodes[:, 3], 0)
    return nodes


def _level_floors(boxes: F64, tolerance: float) -> Bools:
    """Which world-space boxes, shape (N, 2, 3), are of the lowest level floor; shape (N,).

    What is not level may lie below it by ``tolerance``, in scene units, as feet do.
    """
    if not len(boxes):
        return np.zeros(0, bool)
    size, low = boxes[:, 1] - boxes[:, 0], boxes[:, 0, 1]
    flat = size[:, 1] <= FLAT * size.max(axis=1)
    lowest = float(low.min())
    level = float(low[flat].min(initial=np.inf))
    rounding = FLAT * float((boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)).max())
    return np.asarray(flat & (low <= level + rounding)) if level <= lowest + tolerance else np.zeros(len(boxes), bool)


def _floors(scene: Scene) -> Bools:
    """Which instances are floors at all times, and not everything; shape (N,)."""
    tolerance = _tolerance(scene.swept_bounds)
    still = np.array([not i.moves for i in scene.instances], bool)
    boxes = np.array([bounds_of(scene.meshes, (i,)) for i in scene.instances]).reshape(-1, 2, 3)
    floors = _level_floors(boxes, tolerance) & still
    if floors.any() and not still.all():
        boxes = np.array([swept_bounds_of(scene.meshes, (i,)) for i in scene.instances])
        floors &= _level_floors(boxes, tolerance)
    return floors & ~floors.all()


def _tolerance(swept: F64) -> float:
    return SUNK * float(swept[1, 1] - swept[0, 1])


def _extended(bounds: F64, boxes: F64) -> F64:
    low, high = boxes[:, 0].min(axis=0, initial=np.inf), boxes[:, 1].max(axis=0, initial=-np.inf)
    return np.stack([np.minimum(bounds[0], low), np.maximum(bounds[1], high)])


def _sanitize(rows: F32) -> F32:
    """Light blocks in which lights with a non-finite number are black, and none is negative."""
    finite = np.isfinite(rows)
    rows = np.where(finite, rows, np.float32(0))
    rows[:, COLOR] = np.where(finite.all(axis=1, keepdims=True), np.maximum(rows[:, COLOR], 0), 0)
    return rows


def _spot_frame(light: SpotLight) -> tuple[F64, float]:
    rotation = look_rotation(np.asarray(light.direction, np.float64), np.array([0.0, 1.0, 0.0]))
    return rotation, math.tan(math.radians(min(light.outer_deg + SPOT_MARGIN_DEG, 80.0)))


def _axis_view(axis: int, sign: float) -> F64:
    """View along ``sign`` × world ``axis`` whose right and up are the two axes after it; possibly mirrored."""
    rows = np.zeros((4, 4))
    rows[0, (axis + 1) % 3] = rows[1, (axis + 2) % 3] = rows[3, 3] = 1.0
    rows[2, axis] = -sign
    return rows
