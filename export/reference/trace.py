"""Path-traced images of a still: the reference with an estimate of its noise, and baselines at a few samples."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from app.arrays import F32, F64
from app.evaluation.denoise import denoise
from app.io.atomic_files import write_text
from app.io.image import write_exr
from export.reference.integrator_timer import make_integrator_timer
from export.reference.path_tracer import MAX_BOUNCES, MAX_RAYS, PathTracer
from export.reference.still import Still

MIN_BATCHES = 8  # noise is estimated from the variance between batches
BASELINE_LAYERS = ("final", "albedo", "normal")
NOISE_LAYERS = ("final", "direct", "indirect", "indirect_single")


@dataclass(frozen=True, eq=False)
class TracedReference:
    """The result of the path tracer.

    Attributes
    ----------
    layers : dict of str to ndarray, float32, shape (H, W, 3), depth (H, W, 1)
        Through the pixel centres: ``direct`` (radiance), ``indirect`` and ``indirect_single`` (radiance / albedo),
        ``albedo``, ``normal`` (world space, towards the camera), ``depth`` (linear; 0 where no surface is visible).
        Averaged over each pixel's area: ``final``, all radiance that reaches the camera, with emission, highlights and
        background.
    noise : dict of str to float or None
        Standard error of each of ``NOISE_LAYERS``: root mean square over the image, relative to the layer's mean.
        None when there was only one batch.
    seconds : float
        Time spent tracing.
    notices : tuple of str
        What the path tracer renders differently from the renderer.
    """

    layers: dict[str, F32]
    noise: dict[str, float | None]
    seconds: float
    notices: tuple[str, ...]


def trace_reference(still: Still, spp: int, seed: int = 0, max_bounces: int = MAX_BOUNCES,
                    progress: Callable[[float], object] = lambda share: None,
                    denoised: bool = False, emission_is_direct: bool = True) -> TracedReference:
    """Trace ``spp`` paths through each pixel's centre, and another ``spp`` across each pixel's area for ``final``.

    Parameters
    ----------
    progress : callable
        Called with the share of the samples that are done.
    denoised : bool
        Denoise reflected light in ``final``, and indirect light, with Open Image Denoise. ``noise`` is measured before.
    emission_is_direct : bool
        See ``PathTracer``.

    Raises
    ------
    DeviceError
        When Mitsuba is missing.
    MissingExtraError
        When the denoiser is missing.
    """
    tracer = PathTracer(still.scene, still.time, max_bounces, emission_is_direct)
    start = perf_counter()
    centres, areas = (TracedMeans(tracer, still, jitter) for jitter in (False, True))
    centres.add(spp, 2 * seed, lambda share: progress(0.5 * share))
    areas.add(spp, 2 * seed + 1, lambda share: progress(0.5 + 0.5 * share))
    seconds = perf_counter() - start
    layers, over_area = centres.means(), areas.means()
    if denoised:
        layers |= {name: denoise(layers[name], layers["normal"]) for name in ("indirect", "indirect_single")}
        emitted = over_area["emitted"]  # the denoiser would blur it, although it has hardly any noise
        reflected = denoise(over_area["final"] - emitted, over_area["normal"], over_area["albedo"])
        over_area["final"] = reflected + emitted
    layers["final"] = over_area["final"]
    noise = {name: (areas if name == "final" else centres).noise(name) for name in NOISE_LAYERS}
    return TracedReference(layers, noise, seconds, tracer.notices)


def mean_samples(tracer: PathTracer, still: Still, spp: int, seed: int = 0) -> dict[str, F32]:
    """The layers of ``TracedReference`` through the pixel centres, thus without ``final``."""
    means = TracedMeans(tracer, still, jitter=False)
    means.add(spp, seed)
    return means.means()


def write_reference(folder: Path, still: Still, spp: int, seed: int, max_bounces: int, about: dict[str, Any],
                    progress: Callable[[float], object], denoised: bool = False,
                    emission_is_direct: bool = True) -> TracedReference:
    """Write ``reference.exr``, and last ``reference.json``."""
    (folder / "reference.json").unlink(missing_ok=True)  # it marks the images as complete
    reference = trace_reference(still, spp, seed, max_bounces, progress, denoised, emission_is_direct)
    _write_layers(folder / "reference.exr", reference.layers)
    paths = 2 * spp * still.size[0] * still.size[1]
    about = {**about, "size": still.size, "spp": spp, "seed": seed, "max_bounces": max_bounces, "denoised": denoised,
             "noise": reference.noise, "seconds": reference.seconds, "paths_per_second": paths / reference.seconds,
             "notices": reference.notices}
    write_text(folder / "reference.json", json.dumps(about, indent=1))
    return reference


def trace_baselines(still: Still, counts: Sequence[int], seed: int = 0,
                    max_bounces: int = MAX_BOUNCES) -> Iterator[tuple[int, dict[str, F32], float]]:
    """Images by rising samples per pixel, as a user would trace them; each includes the samples of the one before.

    Yields
    ------
    count : int
        Samples per pixel.
    layers : dict of str to ndarray
        ``final``, ``albedo`` and ``normal``, float32 [H, W, 3].
    seconds : float
        Of Mitsuba's own integrator, which is faster because it does not separate direct from indirect light.
    """
    tracer = PathTracer(still.scene, still.time, max_bounces)
    measure = make_integrator_timer(tracer.scene, still.view, still.size, max_bounces)
    means = TracedMeans(tracer, still, jitter=True)
    for total in sorted(set(counts)):
        means.add(total - means.count, seed * 2**10 + total)
        layers = means.means()
        yield total, {name: layers[name] for name in BASELINE_LAYERS}, measure(total)


def write_baselines(folder: Path, still: Still, counts: Sequence[int], seed: int, max_bounces: int) -> None:
    """Write ``baseline_NNNN.exr`` for each number of samples per pixel, and last ``baselines.json`` with seconds."""
    (folder / "baselines.json").unlink(missing_ok=True)  # it marks the images as complete
    seconds = {}
    for spp, layers, seconds[spp] in trace_baselines(still, counts, seed, max_bounces):
        _write_layers(folder / f"baseline_{spp:04d}.exr", layers)
    write_text(folder / "baselines.json", json.dumps(seconds, indent=1))


class TracedMeans:
    """Means of a still's layers over batches of samples, and the standard errors of these means.

    Samples go through the pixels' centres, which gives the layers of ``TracedReference`` but ``final``; with ``jitter``
    they are spread over the pixels' areas, which gives ``final``, its part ``emitted``, and the denoiser's guides.
    """

    def __init__(self, tracer: PathTracer, still: Still, jitter: bool) -> None:
        self._tracer, self._still, self._jitter = tracer, still, jitter
        self.count = self._batches = 0
        self._sums: dict[str, F64] = {}
        self._squares: dict[str, F64] = {}

    def add(self, spp: int, seed: int, progress: Callable[[float], object] = lambda share: None) -> None:
        """Trace another ``spp`` samples for every pixel; ``progress`` is called with the share that is done."""
        w, h = self._still.size
        y, x = np.divmod(np.arange(w * h), w)
        corners = np.stack([x, y], axis=1).astype(np.float64)
        random = np.random.default_rng(seed)
        batch_spp = max(1, min(MAX_RAYS // (w * h), spp // MIN_BATCHES))
        for batch, begin in enumerate(range(0, spp, batch_spp)):
            count = min(batch_spp, spp - begin)
            offsets = random.random((count, w * h, 2)) if self._jitter else np.full((count, 1, 1), 0.5)
            trace = self._tracer.trace_radiance if self._jitter else self._tracer.trace
            samples = trace(self._still.view, ((corners + offsets) / (w, h)).reshape(-1, 2), seed * 2**16 + batch)
            self.count += count
            self._batches += 1
            means = {f.name: getattr(samples, f.name).reshape(count, h, w, -1).mean(axis=0) for f in fields(samples)}
            for name, image in _layers(means).items():
                self._sums[name] = self._sums.get(name, 0.0) + count * image.astype(np.float64)
                self._squares[name] = self._squares.get(name, 0.0) + count * image.astype(np.float64) ** 2
            progress((begin + count) / spp)

    def means(self) -> dict[str, F32]:
        return {name: (total / self.count).astype(np.float32) for name, total in self._sums.items()}

    def noise(self, name: str) -> float | None:
        """Standard error of the mean, root mean square over the image, relative to the mean; None for one batch."""
        if self._batches < 2:
            return None
        mean = self._sums[name] / self.count
        variance = np.maximum(self._squares[name] / self.count - mean**2, 0) / (self._batches - 1)
        return float(np.sqrt(variance.mean()) / max(float(mean.mean()), 1e-30))


def _layers(means: dict[str, F32]) -> dict[str, F32]:
    """Layers of the means of ``Samples`` or of ``RadianceSamples``."""
    guides = {"albedo": means["albedo"], "normal": means["normal"]}
    if "emitted" in means:
        return {"final": means["reflected"] + means["emitted"], "emitted": means["emitted"], **guides}
    return {"direct": means["direct"] * means["albedo"], "indirect": means["multi"], "indirect_single": means["single"],
            **guides, "depth": means["depth"]}


def _write_layers(path: Path, layers: dict[str, F32]) -> None:
    """Write an EXR file whose unnamed layer, which viewers show first, is ``final``."""
    write_exr(path, {"" if name == "final" else name: image for name, image in layers.items()})
