"""Two neighbouring frames of one place."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.scene import Camera
from export.dataset.cameras import a_frame_before
from export.dataset.scenes import lights
from export.dataset.scenes.generated_scene import FRAME_SECONDS, GeneratedScene, Rng
from export.reference.still import Still

CAMERA_MOVES, OBJECTS_MOVE, LIGHT_MOVES = 0.8, 0.6, 0.25  # how often; objects only where there are some that can


@dataclass(frozen=True, eq=False)
class Pair:
    """Neighbouring frames; both share one ``Scene`` object unless a light moved."""

    previous: Still
    current: Still


def pair_of(place: GeneratedScene, camera: Camera, size: tuple[int, int], rng: Rng) -> Pair:
    """The frame that ``camera`` sees, and one a little before: camera, objects, a light, or nothing moved."""
    camera_moves, objects_move, light_moves = rng.random(3) < (CAMERA_MOVES, OBJECTS_MOVE, LIGHT_MOVES)
    scene = place.scene
    before = a_frame_before(camera, rng) if camera_moves else camera
    if light_moves and scene.lights:
        moved = list(scene.lights)
        which = rng.integers(len(moved))
        moved[which] = lights.moved(rng, moved[which])
        scene = replace(scene, lights=tuple(moved))
    return Pair(Still(scene, before, size, 0.0 if objects_move else FRAME_SECONDS),
                Still(place.scene, camera, size, FRAME_SECONDS))
