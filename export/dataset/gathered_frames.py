"""Frames with the light of single rays, from which a network learns to clean gathered light.

Some rays of a texel are there for the network's input, others for its target. These are another sequence: rays of one
sequence are spread evenly, so that where some find too much light the others find too little, and a network would learn
that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from app.arrays import F32
from app.errors import SettingsError
from app.io.atomic_files import prepare_folders, replace_file
from app.network.channels import SCREEN
from app.network.contract_json import read_contract
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera
from app.settings import MAX_SEED, Settings
from export.dataset.cameras import MAX_NEAR_SHARE, MIN_DEPTH, MIN_DEPTH_SPREAD, MIN_MEAN_DEPTH, random_camera
from export.dataset.scenes.found_emitters import with_found_emitters
from export.dataset.scenes.generated_scene import FRAME_SECONDS, GeneratedScene
from export.dataset.scenes.sources import SOURCES

SIZE = (224, 168)  # texels, so many that a drawn frame traces one ray of each
RAYS = 32         # of a texel for the input, and as many for the target
SOURCE_NAMES = ("cluttered_room", "cluttered_room", "connected_rooms", "cluttered_room", "room", "corridor",
                "cluttered_room", "courtyard")
FRAMES_PER_SCENE, CAMERAS = 2, 30  # and cameras that are tried for them
MIN_SURFACE_SHARE, MIN_LIT_SHARE = 0.5, 0.6
STREAM = 3  # second number of every seed; pairs and validation views have others
MODEL = "final-gather"


@dataclass(frozen=True, eq=False)
class GatheredFrame:
    """One frame; all lengths in the network's units.

    Attributes
    ----------
    light, target : ndarray, float16, shape (h, w, K, 3)
        Of each ray of the input and of the target, relative to the mean of ``interpolated``.
    distance : ndarray, float16, shape (h, w, K)
        Of the ends of the input's rays, as in the channel ``gathered.distance``.
    interpolated, normal, position : ndarray, float32, shape (3, h, w)
        The channels of these names.
    """

    light: np.ndarray
    target: np.ndarray
    distance: np.ndarray
    interpolated: F32
    normal: F32
    position: F32


def make_frames(folder: Path, scenes: int, seed: int, progress: Callable[[int], object]) -> None:
    """Write the missing frames of the first ``scenes`` scenes as ``SCENE-FRAME.npz``."""
    prepare_folders(folder)
    for number in range(scenes):
        if not any(folder.glob(f"{number:04}-*.npz")):
            rng = np.random.default_rng([seed, STREAM, number])
            generated = SOURCES[SOURCE_NAMES[number % len(SOURCE_NAMES)]](rng)
            for index, frame in enumerate(_frames(generated, rng)):
                with replace_file(folder / f"{number:04}-{index}.npz") as temporary, temporary.open("wb") as file:
                    np.savez(file, **vars(frame))
        progress(number + 1)


def read_frames(folder: Path) -> list[GatheredFrame]:
    """All frames of a folder, in order.

    Raises
    ------
    SettingsError
        When there are none, or one of another kind.
    """
    frames = []
    for path in sorted(folder.glob("*.npz")):
        try:
            with np.load(path) as values:
                frames.append(GatheredFrame(**values))
        except (OSError, EOFError, TypeError, ValueError, BadZipFile):
            raise SettingsError("not a frame with gathered light", path,
                                "expected files of python -m export gather make") from None
    if not frames:
        raise SettingsError("no frames", folder, "expected a folder of python -m export gather make")
    return frames


def _frames(generated: GeneratedScene, rng: np.random.Generator) -> Iterator[GatheredFrame]:
    """A few frames by cameras that show something."""
    settings = Settings(SIZE, ("indirect",), provider="cpu", scale=1.0)
    # Rays that seldom meet a small emitter would find so much light there that a network learned little but noise.
    with Renderer(with_found_emitters(generated.scene), settings, find_model(MODEL)) as renderer:
        found = 0
        for _ in range(CAMERAS):
            camera = random_camera(generated, rng)
            renderer.cut()
            renderer.advance(camera, FRAME_SECONDS)
            channels = _channels(renderer)
            if _is_suitable(-channels["position.view.xyz"][2], channels["interpolated.rgb"]):
                yield _gather(renderer, camera, channels, rng)
                found += 1
                if found == FRAMES_PER_SCENE:
                    return


def _channels(renderer: Renderer) -> dict[str, F32]:
    spec = next(s for s in read_contract(find_model(MODEL)).inputs.values() if s.grid == SCREEN)
    packed = renderer.resource("tensor_screen")
    return {name: packed[rows] for name, rows in spec.rows()}


def _is_suitable(depth: F32, light: F32) -> bool:
    """Whether a frame is worth learning from: not empty, blocked, bare or dark; ``depth`` in the network's units."""
    hit = depth > 0
    if hit.mean() < MIN_SURFACE_SHARE:
        return False
    relative = depth[hit] / read_contract(find_model(MODEL)).scene_extent
    return bool((relative < MIN_DEPTH).mean() <= MAX_NEAR_SHARE and relative.mean() >= MIN_MEAN_DEPTH
                and relative.std() >= MIN_DEPTH_SPREAD * relative.mean()
                and (light.max(axis=0)[hit] > 0).mean() >= MIN_LIT_SHARE)


def _gather(renderer: Renderer, camera: Camera, channels: dict[str, F32], rng: np.random.Generator) -> GatheredFrame:
    """The rays of twice ``RAYS`` drawn frames, one of each texel."""
    mean = max(float(channels["interpolated.rgb"].mean()), 1e-20)
    light, distance = np.zeros((2, *SIZE[::-1], RAYS, 3), np.float16), np.ones((*SIZE[::-1], RAYS), np.float16)
    for sequence, rays in enumerate(light):
        renderer.settings = replace(renderer.settings, seed=int(rng.integers(MAX_SEED)))  # where sequences start
        for ray in range(RAYS):
            renderer.advance(camera, FRAME_SECONDS)
            rays[:, :, ray] = np.minimum(renderer.resource("gathered_light_now")[..., :3] / mean, 6e4)
            if sequence == 0:
                distance[:, :, ray] = renderer.resource("gathered_surfels_now")[..., 3]
    return GatheredFrame(light[0], light[1], distance, channels["interpolated.rgb"] / np.float32(mean),
                         channels["normal.view.xyz"], channels["position.view.xyz"])
