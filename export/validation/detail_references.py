"""Path-traced references of diffuse light: two independent halves, each denoised for itself, cached by content.

Paths go through the pixels' centres, and highlights are left out, so that all that differs is indirect light.
"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.arrays import F32
from app.errors import SceneError
from app.evaluation.denoise import denoise, denoiser_version
from app.evaluation.reference import cache_folder
from app.evaluation.versions import exporter_version
from app.io.atomic_files import prepare_folders, replace_file
from app.io.image import read_exr, write_exr
from export.dataset.scene_key import scene_key
from export.reference.path_tracer import PathTracer
from export.reference.still import Still
from export.reference.trace import TracedMeans
from export.validation.views import View


@dataclass(frozen=True, eq=False)
class DetailReference:
    """Layers of a view at 0 and 1, its two halves; float32, shape (2, H, W, 3), depth (2, H, W, 1).

    Attributes
    ----------
    indirect : ndarray
        Indirect radiance / albedo, denoised.
    direct : ndarray
        Radiance by direct light, denoised.
    albedo, normal, depth : ndarray
        As in ``export.reference.trace.TracedReference``.
    """

    indirect: F32
    direct: F32
    albedo: F32
    normal: F32
    depth: F32


def detail_reference(view: View, spp: int, folder: Path | None) -> DetailReference:
    """The reference of ``spp`` paths a pixel, cached in ``folder`` or in the benchmark's cache."""
    halves = [_half(view, spp // 2, seed, folder or cache_folder()) for seed in (0, 1)]
    return DetailReference(**{name: np.stack([half[name] for half in halves]) for name in halves[0]})


def _half(view: View, spp: int, seed: int, folder: Path) -> dict[str, F32]:
    still = view.still
    key = scene_key(still.scene, still.camera, still.size, spp, seed, denoiser_version(), exporter_version(still.scene))
    file = folder / f"detail-{view.name}-{key}.exr"
    if file.is_file():
        with suppress(SceneError):  # a damaged file is traced again
            return read_exr(file)
    prepare_folders(folder)
    with replace_file(file) as temporary:
        write_exr(temporary, _trace(still, spp, seed))
    return read_exr(file)


def _trace(still: Still, spp: int, seed: int) -> dict[str, F32]:
    """The layers of a half by name."""
    means = TracedMeans(PathTracer(still.scene, still.time, emission_is_direct=False), still, jitter=False)
    means.add(spp, seed)
    layers = means.means()
    normal, albedo = layers["normal"], layers["albedo"]
    return {"indirect": denoise(layers["indirect"], normal), "direct": denoise(layers["direct"], normal, albedo),
            "albedo": albedo, "normal": normal, "depth": layers["depth"]}
