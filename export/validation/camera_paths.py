"""Camera paths for temporal validation: consecutive frames, a path away from lit surfaces, an opening shutter."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.arrays import F64
from app.load import load_scene
from app.math3d import translation
from app.scene import (
    Camera,
    CameraPath,
    DirectionalLight,
    Instance,
    Material,
    Motion,
    PointLight,
    Scene,
    SpotLight,
    bounds_of,
)
from export.dataset.scenes.generated_scene import FRAME_SECONDS, GeneratedSceneBuilder
from export.dataset.scenes.parts import Triple, block, cylinder, slab
from export.dataset.scenes.sources import SOURCES
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, add_walls, rectangle

CAMERA_PATHS = 2  # first number of every seed; see ``export.dataset.plan``
FRAMES, QUICK_FRAMES = 12, 4
FRAME_STEP = 13
FILE = Path("breakfast-room", "breakfast-room.glb")

WIDTH, HEIGHT = 4.0, 2.7  # of rooms, metres
RED, GREEN, BLUE, WHITE, WOOD = (Material(albedo=color) for color in (
    (0.7, 0.12, 0.08), (0.2, 0.55, 0.15), (0.15, 0.25, 0.65), (0.75, 0.73, 0.7), (0.45, 0.32, 0.2)))


@dataclass(frozen=True, eq=False)
class CameraPathCase:
    """A camera path through a scene, and the frames along it that are evaluated.

    Attributes
    ----------
    frames : int
        Number of evaluated frames.
    frame_step : int
        Every ``frame_step``-th drawn frame is evaluated.
    seconds : float
        Time from the first frame to the last.
    animated : bool
        Whether the scene is animated too; otherwise only the camera moves.
    """

    name: str
    scene: Scene
    path: CameraPath
    frames: int
    frame_step: int
    seconds: float
    animated: bool = False

    @property
    def consecutive(self) -> bool:
        """Whether every drawn frame is evaluated."""
        return self.frame_step == 1

    @property
    def drawn(self) -> list[tuple[Camera, float]]:
        """The camera and the time of the scene in seconds, of each drawn frame."""
        last = (self.frames - 1) * self.frame_step
        times = [self.seconds * k / last for k in range(last + 1)]
        return [(self.path.at(time), time if self.animated else 0.0) for time in times]

    @property
    def evaluated(self) -> list[tuple[Camera, float]]:
        """The same of each evaluated frame."""
        return self.drawn[::self.frame_step]


def camera_paths(scenes: Path, quick: bool = False) -> list[CameraPathCase]:
    """All camera paths; the one through a scene file only if ``scenes`` contains it.

    Parameters
    ----------
    quick : bool
        Evaluate fewer frames of each.

    Raises
    ------
    SceneError
        When the file is damaged.
    """
    frames = QUICK_FRAMES if quick else FRAMES
    files = [scenes / FILE] if (scenes / FILE).is_file() else []
    return [_furnished_room(frames), _cluttered_room(frames), *(_scene_file(file, frames) for file in files),
            off_screen(frames), sun_enters(frames)]


def off_screen(frames: int = FRAMES) -> CameraPathCase:
    """Past two lit walls and on, until no directly lit surface is in view."""
    path = _path({0: ((0.9, 1.6, -0.4), (-0.9, 1.1, -4.0)), 50: ((0.9, 1.6, -2.2), (0.6, 1.2, -6.0)),
                  100: ((0.5, 1.6, -5.0), (0.3, 1.2, -9.0)), 143: ((0.328, 1.514, -6.72), (-0.13, 1.2, -10.72))})
    return CameraPathCase("off-screen", two_part_room(), path, frames, FRAME_STEP, path.times[-1])


def sun_enters(frames: int = FRAMES) -> CameraPathCase:
    """A static camera with its back to a window whose shutter opens: the sun only lights what is behind it."""
    camera = CameraPath.still(Camera((0.3, 1.5, -3.4), (0.0, 1.2, -7.0), fov_y_deg=60.0))
    seconds = FRAME_SECONDS * (QUICK_FRAMES - 1) * FRAME_STEP
    return CameraPathCase("sun-enters", shuttered_room(seconds), camera, frames, FRAME_STEP, seconds, animated=True)


def shuttered_room(seconds: float) -> Scene:
    """4 by 8 metres with a window at one end, whose shutter is fully open after three quarters of ``seconds``."""
    far, right, near, left = _walls(8.0)
    near = replace(near, openings=(Opening(0.8, 3.2, 0.8, 2.4),))
    builder = _shell(8.0, [far, right, near, left], [WHITE, GREEN, WHITE, RED])
    builder.add(block((0.7, 0.75, 1.2), (-1.3, 0.0, -6.2)), WHITE)
    builder.add(cylinder(0.2, HEIGHT, (1.2, 0.0, -7.0)), RED)
    builder.lights.append(DirectionalLight((0.15, -1.0, -0.7), (14.0, 12.5, 10.0), angular_radius_deg=0.27))
    scene = builder.build("shuttered room", []).scene
    shutter = GeneratedSceneBuilder(np.random.default_rng(0))
    shutter.add(slab((-2.0, 0.2, THICKNESS + 0.01), (2.0, 3.2, THICKNESS + 0.06)), WHITE)  # the sun comes from above
    shutter_scene = shutter.build("shutter", []).scene
    poses = np.stack([translation(np.array([0.0, 3.0 * share, 0.0])) for share in (0.0, 0.0, 1.0)])
    motion = Motion(seconds * np.array([0.0, 0.1, 0.75]), poses)
    mesh = replace(shutter_scene.meshes[0], name="shutter", material=len(scene.materials))
    meshes = (*scene.meshes, mesh)
    instances = (*scene.instances, Instance("shutter", len(scene.meshes), np.eye(4), motion))
    return replace(scene, meshes=meshes, instances=instances, materials=(*scene.materials, *shutter_scene.materials),
                   bounds=bounds_of(meshes, instances))


def two_part_room() -> Scene:
    """4 by 10 metres: a part whose red and green walls are lit by two spots, and a dark one behind a wide opening."""
    start, end = np.array([[-WIDTH / 2, -5.5], [WIDTH / 2, -5.5]])
    partition = Wall(start, end, HEIGHT, (Opening(1.0, 3.4, 0.0, 2.5),))
    builder = _shell(10.0, [*_walls(10.0), partition], [BLUE, GREEN, WHITE, RED, WHITE])
    builder.add(block((0.5, 0.5, 0.5), (-1.2, 0.0, -4.2)), WHITE)
    builder.add(block((0.7, 0.75, 1.2), (-1.5, 0.0, -8.2)), WHITE)
    builder.add(cylinder(0.2, HEIGHT, (1.2, 0.0, -9.0)), RED)
    builder.lights += [SpotLight(at, towards, (30.0, 28.0, 25.0), inner_deg=22.0, outer_deg=30.0, radius=0.04)
                        for at, towards in (((0.2, 2.5, -1.8), (-1.0, -0.55, -0.3)),
                                            ((0.0, 2.5, -3.8), (1.0, -0.6, 0.0)))]
    return builder.build("two-part room", []).scene


def _walls(depth: float) -> list[Wall]:
    """The four walls of a room from z = -depth to 0."""
    shift = (0, depth / 2)
    return [replace(w, start=w.start - shift, end=w.end - shift) for w in rectangle(WIDTH, depth, HEIGHT)]


def _shell(depth: float, walls: list[Wall], materials: list[Material]) -> GeneratedSceneBuilder:
    """A room of the given walls, with floor and ceiling from z = -depth to 0."""
    builder = GeneratedSceneBuilder(np.random.default_rng(0))  # unused
    add_walls(builder, walls, materials)
    x, t = WIDTH / 2 + THICKNESS, THICKNESS
    builder.add(slab((-x, -t, -depth - t), (x, 0.0, t)), WOOD)
    builder.add(slab((-x, HEIGHT, -depth - t), (x, HEIGHT + t, t)), WHITE)
    return builder


def _furnished_room(frames: int) -> CameraPathCase:
    """Along a furnished room at 0.7 m/s, turning by half a degree a frame."""
    scene = SOURCES["room"](np.random.default_rng([CAMERA_PATHS, 1])).scene
    path = _path({0: ((1.4, 1.3, 3.0), (1.3, 0.9, -1.0)), 15: ((1.1, 1.3, 2.8), (0.6, 0.9, -1.2))})
    return _consecutive("room", scene, path, frames)


def _cluttered_room(frames: int) -> CameraPathCase:
    """Past a table with small things, lamps and a curtain, under a light at the ceiling, sideways at 0.7 m/s."""
    scene = SOURCES["cluttered_room"](np.random.default_rng([CAMERA_PATHS, 7])).scene
    dark = replace(scene, materials=tuple(replace(m, emission=(0.0, 0.0, 0.0)) for m in scene.materials))
    lit = dark.with_lights(PointLight((0.0, 2.8, 0.0), (7.0, 6.5, 6.0), radius=0.08))
    path = _path({0: ((0.36, 1.45, -1.38), (-0.24, 0.75, 0.92)), 15: ((0.02, 1.45, -1.47), (-0.44, 0.75, 0.85))})
    return _consecutive("cluttered-room", lit, path, frames)


def _scene_file(file: Path, frames: int) -> CameraPathCase:
    """Sideways and forward from the file's own camera, at a similar speed relative to the scene."""
    scene = load_scene(file)
    first = scene.cameras[scene.default_camera].at(0.0)
    step = 0.08 * scene.longest_edge * np.array([1.0, 0.0, -0.4])
    last = replace(first, eye=_triple(first.eye + step), target=_triple(first.target - 0.5 * step))
    return _consecutive(file.stem, scene, CameraPath((0.0, 15 * FRAME_SECONDS), (first, last)), frames)


def _consecutive(name: str, scene: Scene, path: CameraPath, frames: int) -> CameraPathCase:
    return CameraPathCase(name, scene, path, frames, 1, (frames - 1) * FRAME_SECONDS)


def _path(keys: Mapping[int, tuple[Triple, Triple]]) -> CameraPath:
    """A path through eyes and targets, given by frame number."""
    cameras = tuple(Camera(eye, target, fov_y_deg=60.0) for eye, target in keys.values())
    return CameraPath(tuple(k * FRAME_SECONDS for k in keys), cameras)


def _triple(values: F64) -> Triple:
    x, y, z = values.tolist()
    return x, y, z
