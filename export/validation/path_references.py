"""The path-traced reference of a walk: every judged frame twice, with independent noise, kept by content."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError
from app.evaluation.reference import MIN_ALBEDO, exporter_version
from app.io.image import read_exr, write_exr
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.key import scene_key
from export.dataset.network_inputs import seen_before
from export.reference.path_tracer import PathTracer
from export.reference.still import Still
from export.reference.trace import mean_samples
from export.validation.camera_paths import CameraPathCase
from export.validation.temporal import FrameSequence, Surfaces

F32 = NDArray[np.float32]

LAYERS = ("first", "second", "direct", "albedo", "depth")

Progress = Callable[[str], object]


@dataclass(frozen=True, eq=False)
class Reference:
    """Of all judged frames.

    Attributes
    ----------
    direct : ndarray, float32, shape (F, H, W, 3)
        Radiance by direct light, W/(sr m²).
    """

    film: FrameSequence
    direct: F32
    surfaces: Surfaces


def reference_of(walk: CameraPathCase, size: tuple[int, int], spp: int, folder: Path, progress: Progress) -> Reference:
    """The path-traced reference of every judged frame, from ``folder`` where it was made before."""
    tracer = lru_cache(maxsize=1)(lambda moment: PathTracer(walk.scene, moment))
    frames = []
    for k, (camera, moment) in enumerate(zip(walk.judged, walk.moments[::walk.apart], strict=True)):
        progress(f"{walk.name}: reference of frame {k + 1} of {walk.frames}")
        frames.append(_frame(Still(walk.scene, camera, size, moment), spp, folder, walk.name, tracer))
    first, second, direct, albedo, depth = (np.stack([frame[name] for frame in frames]) for name in LAYERS)
    counted = (depth[..., 0] > 0) & (albedo.max(axis=-1) >= MIN_ALBEDO)
    return Reference(FrameSequence(first, second), direct, Surfaces(counted, *_motion(walk, size)))


def _frame(still: Still, spp: int, folder: Path, name: str, tracer: Callable[[float], PathTracer]) -> dict[str, F32]:
    """Layers of one frame's reference by name, kept in ``folder`` by content."""
    moment = (still.time,) if still.time else ()
    key = scene_key(still.scene, still.camera, still.size, spp, exporter_version(still.scene), *moment)
    file = folder / f"walk-{name}-{key}.exr"
    if file.is_file():
        with suppress(SceneError):  # a damaged file is made again
            return read_exr(file)
    first, second = (mean_samples(tracer(still.time), still, spp // 2, seed) for seed in (0, 1))
    layers = {"first": first["indirect"], "second": second["indirect"],
              **{layer: first[layer] for layer in ("direct", "albedo", "depth")}}
    folder.mkdir(parents=True, exist_ok=True)
    write_exr(file, layers)
    return read_exr(file)


def _motion(walk: CameraPathCase, size: tuple[int, int]) -> tuple[F32, NDArray[np.bool_]]:
    """``Surfaces.motion`` and ``Surfaces.visible`` between judged frames."""
    motions, visible = [], []
    with Renderer(walk.scene, Settings(size, ("motion", "depth"), taa=False)) as renderer:
        before = None
        for camera, moment in zip(walk.judged, walk.moments[::walk.apart], strict=True):
            renderer.advance(camera, moment)
            depth, motion = renderer.resource("depth")[..., 0], renderer.resource("motion")
            if before is not None:
                moved = np.moveaxis(motion[..., :2], -1, 0)
                motions.append(moved)
                visible.append(seen_before(before, depth * motion[..., 2], moved))
            before = depth
    return np.stack(motions), np.stack(visible)
