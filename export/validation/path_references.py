"""Path-traced references of camera paths: two independent estimates per evaluated frame, cached by content."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from app.arrays import F32, Bools
from app.errors import SceneError
from app.evaluation.reference import MIN_ALBEDO
from app.evaluation.versions import exporter_version
from app.io.image import read_exr, write_exr
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.network_inputs import was_visible
from export.dataset.scene_key import scene_key
from export.reference.path_tracer import PathTracer
from export.reference.still import Still
from export.reference.trace import mean_samples
from export.validation.camera_paths import CameraPathCase
from export.validation.errors import Progress
from export.validation.temporal import FrameSequence, Surfaces

LAYERS = ("first", "second", "direct", "albedo", "depth")


@dataclass(frozen=True, eq=False)
class PathReference:
    """Reference light of all evaluated frames.

    Attributes
    ----------
    direct : ndarray, float32, shape (F, H, W, 3)
        Radiance by direct light, W/(sr m²).
    """

    indirect: FrameSequence
    direct: F32
    surfaces: Surfaces


def reference_of(case: CameraPathCase, size: tuple[int, int], spp: int, folder: Path,
                 progress: Progress) -> PathReference:
    """The path-traced reference of every evaluated frame, cached in ``folder``."""
    tracer = lru_cache(maxsize=1)(lambda time: PathTracer(case.scene, time))
    frames = []
    for k, (camera, time) in enumerate(case.evaluated):
        progress(f"{case.name}: reference of frame {k + 1} of {case.frames}")
        frames.append(_frame(Still(case.scene, camera, size, time), spp, folder, case.name, tracer))
    first, second, direct, albedo, depth = (np.stack([frame[name] for frame in frames]) for name in LAYERS)
    counted = (depth[..., 0] > 0) & (albedo.max(axis=-1) >= MIN_ALBEDO)
    return PathReference(FrameSequence(first, second), direct, Surfaces(counted, *_motion(case, size)))


def _frame(still: Still, spp: int, folder: Path, name: str, tracer: Callable[[float], PathTracer]) -> dict[str, F32]:
    """Layers of one frame's reference by name, cached in ``folder`` by content."""
    time = (still.time,) if still.time else ()
    key = scene_key(still.scene, still.camera, still.size, spp, exporter_version(still.scene), *time)
    file = folder / f"path-{name}-{key}.exr"
    if file.is_file():
        with suppress(SceneError):  # a damaged file is traced again
            return read_exr(file)
    first, second = (mean_samples(tracer(still.time), still, spp // 2, seed) for seed in (0, 1))
    layers = {"first": first["indirect"], "second": second["indirect"],
              **{layer: first[layer] for layer in ("direct", "albedo", "depth")}}
    folder.mkdir(parents=True, exist_ok=True)
    write_exr(file, layers)
    return read_exr(file)


def _motion(case: CameraPathCase, size: tuple[int, int]) -> tuple[F32, Bools]:
    """``Surfaces.motion`` and ``Surfaces.visible`` between evaluated frames."""
    motions, visible = [], []
    with Renderer(case.scene, Settings(size, ("motion", "depth"), taa=False)) as renderer:
        before = None
        for camera, time in case.evaluated:
            renderer.advance(camera, time)
            depth, motion = renderer.resource("depth")[..., 0], renderer.resource("motion")
            if before is not None:
                pixels = np.moveaxis(motion[..., :2], -1, 0)
                motions.append(pixels)
                visible.append(was_visible(before, depth * motion[..., 2], pixels))
            before = depth
    return np.stack(motions), np.stack(visible)
