"""What networks are judged by over time: neighbouring frames of a walk, one away from all that is lit, a shutter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.load import load_scene
from app.math3d import translation
from app.scene import (
    Camera,
    CameraPath,
    DirectionalLight,
    Instance,
    Material,
    Motion,
    Scene,
    SpotLight,
    bounds_of,
)
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.generated_scene import FRAME_SECONDS
from export.dataset.scenes.parts import Triple, block, cylinder, slab
from export.dataset.scenes.sources import SOURCES
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, build, rectangle
from export.validation.views import SCENES

CAMERA_PATHS = 2  # first number of every seed; see ``export.dataset.plan``
FRAMES, QUICK_FRAMES = 12, 4
APART = 13
FILE = Path("breakfast-room", "breakfast-room.glb")

RED, GREEN, BLUE = (0.7, 0.12, 0.08), (0.2, 0.55, 0.15), (0.15, 0.25, 0.65)
WHITE, WOOD = (0.75, 0.73, 0.7), (0.45, 0.32, 0.2)


@dataclass(frozen=True, eq=False)
class CameraPathCase:
    """A camera on its way through a scene.

    Attributes
    ----------
    frames : int
        How many are judged.
    apart : int
        Frames that are drawn from one that is judged to the next.
    seconds : float
        Along the path from the first frame to the last.
    moves : bool
        Whether time passes for the scene's things, too; otherwise they stand still.
    """

    name: str
    scene: Scene
    path: CameraPath
    frames: int
    apart: int
    seconds: float
    moves: bool = False

    @property
    def neighbours(self) -> bool:
        """Whether each judged frame follows the one before without another between."""
        return self.apart == 1

    @property
    def cameras(self) -> list[Camera]:
        """Those of all drawn frames."""
        return [self.path.at(time) for time in self._times]

    @property
    def judged(self) -> list[Camera]:
        """Those of the frames that are judged."""
        return self.cameras[::self.apart]

    @property
    def moments(self) -> list[float]:
        """The scene's time in each drawn frame, in seconds."""
        return [time if self.moves else 0.0 for time in self._times]

    @property
    def _times(self) -> list[float]:
        last = (self.frames - 1) * self.apart
        return [self.seconds * k / last for k in range(last + 1)]


def camera_paths(scenes: Path = SCENES, quick: bool = False) -> list[CameraPathCase]:
    """All camera_paths; that through a file only where ``scenes`` has it. ``quick`` judges fewer frames of each.

    Raises
    ------
    SceneError
        When the file is damaged.
    """
    frames = QUICK_FRAMES if quick else FRAMES
    files = [scenes / FILE] if (scenes / FILE).is_file() else []
    return [_furnished(frames), *(_real(file, frames) for file in files), off_screen(frames), sun_enters(frames)]


def off_screen(frames: int = FRAMES) -> CameraPathCase:
    """Past a lit wall and another one, and on until nothing that the lamps light is in view."""
    path = _path({0: ((0.9, 1.6, -0.4), (-0.9, 1.1, -4.0)), 50: ((0.9, 1.6, -2.2), (0.6, 1.2, -6.0)),
                  100: ((0.5, 1.6, -5.0), (0.3, 1.2, -9.0)), 143: ((0.328, 1.514, -6.72), (-0.13, 1.2, -10.72))})
    return CameraPathCase("off-screen", two_part_room(), path, frames, APART, path.times[-1])


def sun_enters(frames: int = FRAMES) -> CameraPathCase:
    """A still camera with its back to a window, whose shutter goes up: what the sun lights is behind it."""
    camera = CameraPath.still(Camera((0.3, 1.5, -3.4), (0.0, 1.2, -7.0), fov_y_deg=60.0))
    seconds = FRAME_SECONDS * (QUICK_FRAMES - 1) * APART
    return CameraPathCase("sun-enters", shuttered_room(seconds), camera, frames, APART, seconds, moves=True)


def shuttered_room(seconds: float) -> Scene:
    """4 by 8 metres with a window at one end, whose shutter is open after three quarters of so many ``seconds``."""
    assembly = Assembly(np.random.default_rng(0))  # nothing is random here
    width, depth, height = 4.0, 8.0, 2.7
    red, green, white, wood = (Material(albedo=c) for c in (RED, GREEN, WHITE, WOOD))
    walls = [replace(w, start=w.start - (0, depth / 2), end=w.end - (0, depth / 2))
             for w in rectangle(width, depth, height)]
    walls[2] = replace(walls[2], openings=(Opening(0.8, 3.2, 0.8, 2.4),))
    build(assembly, walls, [white, green, white, red])
    x, t = width / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -depth - t), (x, 0.0, t)), wood)
    assembly.add(slab((-x, height, -depth - t), (x, height + t, t)), white)
    assembly.add(block((0.7, 0.75, 1.2), (-1.3, 0.0, -6.2)), white)
    assembly.add(cylinder(0.2, height, (1.2, 0.0, -7.0)), red)
    assembly.lights.append(DirectionalLight((0.15, -1.0, -0.7), (14.0, 12.5, 10.0), angular_radius_deg=0.27))
    scene = assembly.place("shuttered room", []).scene
    shutter = Assembly(np.random.default_rng(0))
    shutter.add(slab((-2.0, 0.2, t + 0.01), (2.0, 3.2, t + 0.06)), white)  # the sun comes from above
    made = shutter.place("shutter", []).scene
    up = np.stack([translation(np.array([0.0, 3.0 * share, 0.0])) for share in (0.0, 0.0, 1.0)])
    motion = Motion(seconds * np.array([0.0, 0.1, 0.75]), up)
    mesh = replace(made.meshes[0], name="shutter", material=len(scene.materials))
    meshes = (*scene.meshes, mesh)
    instances = (*scene.instances, Instance("shutter", len(scene.meshes), np.eye(4), motion))
    return replace(scene, meshes=meshes, instances=instances, materials=(*scene.materials, *made.materials),
                   bounds=bounds_of(meshes, instances))


def two_part_room() -> Scene:
    """4 by 10 metres: a part whose red and green walls two spots light, and a dark one behind a wide opening."""
    assembly = Assembly(np.random.default_rng(0))  # nothing is random here
    width, depth, height, parted = 4.0, 10.0, 2.7, 5.5
    red, green, blue, white, wood = (Material(albedo=c) for c in (RED, GREEN, BLUE, WHITE, WOOD))
    walls = [replace(w, start=w.start - (0, depth / 2), end=w.end - (0, depth / 2))
             for w in rectangle(width, depth, height)]
    opening = Opening(1.0, 3.4, 0.0, 2.5)
    walls.append(Wall(np.array([-width / 2, -parted]), np.array([width / 2, -parted]), height, (opening,)))
    build(assembly, walls, [blue, green, white, red, white])
    x, t = width / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -depth - t), (x, 0.0, t)), wood)
    assembly.add(slab((-x, height, -depth - t), (x, height + t, t)), white)
    assembly.add(block((0.5, 0.5, 0.5), (-1.2, 0.0, -4.2)), white)
    assembly.add(block((0.7, 0.75, 1.2), (-1.5, 0.0, -8.2)), white)
    assembly.add(cylinder(0.2, height, (1.2, 0.0, -9.0)), red)
    assembly.lights += [SpotLight(at, towards, (30.0, 28.0, 25.0), inner_deg=22.0, outer_deg=30.0, radius=0.04)
                        for at, towards in (((0.2, 2.5, -1.8), (-1.0, -0.55, -0.3)),
                                            ((0.0, 2.5, -3.8), (1.0, -0.6, 0.0)))]
    return assembly.place("two-part room", []).scene


def _furnished(frames: int) -> CameraPathCase:
    """Along a furnished room at 0.7 m/s, turning by half a degree a frame."""
    scene = SOURCES["room"](np.random.default_rng([CAMERA_PATHS, 1])).scene
    path = _path({0: ((1.4, 1.3, 3.0), (1.3, 0.9, -1.0)), 15: ((1.1, 1.3, 2.8), (0.6, 0.9, -1.2))})
    return _neighbours("room", scene, path, frames)


def _real(file: Path, frames: int) -> CameraPathCase:
    """From the file's own camera to the side and on, about as fast in the scene's own units."""
    scene = load_scene(file)
    begin = scene.cameras[scene.default_camera].at(0.0)
    step = 0.08 * scene.longest_edge * np.array([1.0, 0.0, -0.4])
    end = replace(begin, eye=_triple(begin.eye + step), target=_triple(begin.target - 0.5 * step))
    return _neighbours(file.stem, scene, CameraPath((0.0, 15 * FRAME_SECONDS), (begin, end)), frames)


def _neighbours(name: str, scene: Scene, path: CameraPath, frames: int) -> CameraPathCase:
    return CameraPathCase(name, scene, path, frames, 1, (frames - 1) * FRAME_SECONDS)


def _path(keys: Mapping[int, tuple[Triple, Triple]]) -> CameraPath:
    """Eyes and targets by the number of a frame."""
    cameras = tuple(Camera(eye, target, fov_y_deg=60.0) for eye, target in keys.values())
    return CameraPath(tuple(k * FRAME_SECONDS for k in keys), cameras)


def _triple(values: NDArray[np.float64]) -> Triple:
    x, y, z = values.tolist()
    return x, y, z
