"""The reference for a picture: its direct and indirect light by path tracing, with the noise that is left."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.evaluation.denoise import denoise
from app.io.atomic_files import write_text
from app.io.image import write_exr
from app.renderer import Renderer
from app.settings import Settings
from export.reference.environment_tracer import EnvironmentTracer, mean_shaded
from export.reference.path_tracer import MAX_BOUNCES, PathTracer, Samples
from export.reference.still import RAYS_AT_ONCE, Still

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

MIN_BATCHES = 8   # whose spread tells the noise
SUPERSAMPLING = 4   # places along a pixel's edge, of what is not traced as diffuse light
SKY_SAMPLES = 16    # of an environment's highlights, at each of these places
LAYERS = ("final", "direct", "indirect", "indirect_single")
UNTRACED = ("emission", "specular", "background")
AOVS = ("albedo", "normal", "depth", "position", "direct", "specular", "emission")


@dataclass(frozen=True, eq=False)
class TracedReference:
    """What the path tracer found.

    Attributes
    ----------
    layers : dict of str to ndarray, float32, shape (H, W, 3), depth (H, W, 1)
        Through the pixels' centres: ``direct`` (radiance), ``indirect`` and ``indirect_single`` (radiance / albedo),
        ``albedo``, ``normal`` (world space, towards the viewer), ``depth`` (linear; 0 where nothing is seen).
        Over the pixels' whole area: ``final``, everything that reaches the camera.
    noise : dict of str to float, or None when there was one batch
        Standard error of each of ``LAYERS``: root mean square over the image, relative to the layer's mean.
    seconds : float
        Spent tracing.
    notices : tuple of str
        What was not drawn as the renderer does.
    """

    layers: dict[str, F32]
    noise: dict[str, float | None]
    seconds: float
    notices: tuple[str, ...]


def trace_reference(still: Still, spp: int, seed: int = 0, max_bounces: int = MAX_BOUNCES,
              progress: Callable[[float], object] = lambda share: None, denoised: bool = False) -> TracedReference:
    """Trace ``spp`` paths through each pixel's centre, and as many spread over the pixel for ``final``.

    Emission, lights' highlights and background, which are not traced, are the renderer's own, supersampled; highlights
    of the environment are traced, with equally many samples whatever ``spp``. ``progress`` is told the share of the
    samples that are done. ``denoised``: ``final`` and indirect light go through Open Image Denoise; the noise that is
    told is that before.

    Raises
    ------
    DeviceError
        When Mitsuba or EGL is missing.
    MissingExtraError
        When there is nothing to denoise with.
    """
    tracer = PathTracer(still.scene, still.time, max_bounces)
    start = time.perf_counter()
    centres = _Means()
    for count, samples in _batches(tracer, still, spp, 2 * seed, spread=False):
        centres.add(_layers(samples), count)
        progress(0.5 * centres.count / spp)
    pixels = _Means()
    for count, samples in _batches(tracer, still, spp, 2 * seed + 1, spread=True):
        pixels.add({"final": _radiance(samples), "albedo": samples.albedo, "normal": samples.normal}, count)
        progress(0.5 + 0.5 * pixels.count / spp)
    seconds = time.perf_counter() - start
    layers, whole = centres.means(), pixels.means()
    if denoised:
        layers |= {name: denoise(layers[name], layers["normal"]) for name in ("indirect", "indirect_single")}
        whole["final"] = denoise(whole["final"], whole["normal"], whole["albedo"])
    layers["final"] = whole["final"] + _rest(still, seed)
    noise = {name: (pixels if name == "final" else centres).noise(name) for name in LAYERS}
    return TracedReference(layers, noise, seconds, tracer.notices)


def mean_samples(tracer: PathTracer, still: Still, spp: int, seed: int = 0) -> dict[str, F32]:
    """The layers of ``TracedReference`` but ``final``, through the pixels' centres."""
    means = _Means()
    for count, samples in _batches(tracer, still, spp, seed, spread=False):
        means.add(_layers(samples), count)
    return means.means()


def plain(still: Still, counts: Sequence[int], seed: int = 0,
          max_bounces: int = MAX_BOUNCES) -> Iterator[tuple[int, dict[str, F32], float]]:
    """Path-traced pictures as a user would take them, by rising number of samples per pixel.

    Each picture keeps the samples of the one before. The seconds are those of Mitsuba's own integrator, which is
    faster for not keeping direct and indirect light apart.

    Yields
    ------
    count : int
    layers : dict of str to ndarray
        ``final``, ``albedo`` and ``normal``, float32 [H, W, 3].
    seconds : float
    """
    tracer = PathTracer(still.scene, still.time, max_bounces)
    clock = tracer.clock(still.view, still.size)
    rest = _rest(still, seed)
    means = _Means()
    for total in sorted(set(counts)):
        for count, samples in _batches(tracer, still, total - means.count, seed * 2**10 + total, spread=True):
            means.add({"final": _radiance(samples), "albedo": samples.albedo, "normal": samples.normal}, count)
        layers = means.means()
        yield total, {**layers, "final": layers["final"] + rest}, clock(total)


def untraced(still: Still) -> F32:
    """Emission, highlights and background as the renderer draws them, float32 [H, W, 3], averaged over each pixel."""
    (w, h), n = still.size, SUPERSAMPLING
    settings = Settings((n * w, n * h), UNTRACED, taa=False, provider="cpu")
    with Renderer(still.scene, settings) as renderer:
        images = renderer.render(still.camera, still.time)
    total = np.sum([images[name] for name in UNTRACED], axis=0)
    return total.reshape(h, n, w, n, 3).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def sky_highlights(still: Still, seed: int = 0) -> F32:
    """Highlights of the environment by Fresnel's law, float32 [H, W, 3], averaged over each pixel."""
    (w, h), n = still.size, SUPERSAMPLING
    tracer, random = EnvironmentTracer(still.scene, still.time), np.random.default_rng(seed)
    x, y = (np.arange(n * w) + 0.5) / (n * w), (np.arange(n * h) + 0.5) / (n * h)
    rows = max(1, RAYS_AT_ONCE // (SKY_SAMPLES * n * n * w))  # of pixels, whose samples are few enough to hold
    strips = []
    for top in range(0, h, rows):
        places = np.stack(np.meshgrid(x, y[n * top:n * (top + rows)]), axis=-1).reshape(-1, 2)
        found = mean_shaded(tracer, still, places, SKY_SAMPLES, int(random.integers(2**24))).highlight
        strips.append(found.reshape(-1, n, w, n, 3).mean(axis=(1, 3), dtype=np.float64))
    return np.concatenate(strips).astype(np.float32)


def write_reference(folder: Path, still: Still, spp: int, seed: int, max_bounces: int, about: dict[str, Any],
                    progress: Callable[[float], object], denoised: bool = False) -> TracedReference:
    """Write ``reference.exr``, the renderer's own images ``aovs.exr``, and last ``reference.json``."""
    (folder / "reference.json").unlink(missing_ok=True)  # while it is there, the images belong to it
    found = trace_reference(still, spp, seed, max_bounces, progress, denoised)
    write_exr(folder / "reference.exr", {"" if name == "final" else name: image for name, image in found.layers.items()})
    with Renderer(still.scene, Settings(still.size, AOVS, taa=False, provider="cpu")) as renderer:
        write_exr(folder / "aovs.exr", renderer.render(still.camera, still.time))
    paths = 2 * spp * still.size[0] * still.size[1]
    about = {**about, "size": still.size, "spp": spp, "seed": seed, "max_bounces": max_bounces, "denoised": denoised,
             "noise": found.noise, "seconds": found.seconds, "paths_per_second": paths / found.seconds,
             "notices": found.notices}
    write_text(folder / "reference.json", json.dumps(about, indent=1))
    return found


def write_plain(folder: Path, still: Still, counts: Sequence[int], seed: int, max_bounces: int) -> None:
    """Write ``plain_NNNN.exr`` for each number of paths per pixel, and last ``plain.json`` with their seconds."""
    (folder / "plain.json").unlink(missing_ok=True)
    seconds = {}
    for spp, layers, seconds[spp] in plain(still, counts, seed, max_bounces):
        write_exr(folder / f"plain_{spp:04d}.exr", {"" if name == "final" else name: x for name, x in layers.items()})
    write_text(folder / "plain.json", json.dumps(seconds, indent=1))


def _rest(still: Still, seed: int) -> F32:
    """What reaches the camera besides diffuse light."""
    scene, rest = still.scene, untraced(still)
    polished = scene.environment is not None and any(material.has_specular for material in scene.materials)
    return rest + sky_highlights(still, seed) if polished else rest


def _layers(samples: Samples) -> dict[str, F32]:
    return {"direct": samples.direct * samples.albedo, "indirect": samples.multi, "indirect_single": samples.single,
            "albedo": samples.albedo, "normal": samples.normal, "depth": samples.depth}


def _radiance(samples: Samples) -> F32:
    return samples.albedo * (samples.direct + samples.multi)


def _batches(tracer: PathTracer, still: Still, spp: int, seed: int, spread: bool) -> Iterator[tuple[int, Samples]]:
    """``spp`` samples for every pixel, by and by: how many a batch has, and their mean [H, W, …]."""
    w, h = still.size
    y, x = np.divmod(np.arange(w * h), w)
    corners = np.stack([x, y], axis=1).astype(np.float64)
    random = np.random.default_rng(seed)
    at_most = max(1, min(RAYS_AT_ONCE // (w * h), spp // MIN_BATCHES))
    for batch, begin in enumerate(range(0, spp, at_most)):
        count = min(at_most, spp - begin)
        inside = random.random((count, w * h, 2)) if spread else np.full((count, 1, 1), 0.5)
        samples = tracer.trace(still.view, ((corners + inside) / (w, h)).reshape(-1, 2), seed * 2**16 + batch)
        yield count, Samples(*(getattr(samples, f.name).reshape(count, h, w, -1).mean(axis=0)
                               for f in fields(samples)))


class _Means:
    """Running means of images over batches of samples, and their standard errors."""

    def __init__(self) -> None:
        self.count = self._batches = 0
        self._sums: dict[str, F64] = {}
        self._squares: dict[str, F64] = {}

    def add(self, images: dict[str, F32], count: int) -> None:
        """Take in the means of ``count`` samples."""
        self.count += count
        self._batches += 1
        for name, image in images.items():
            self._sums[name] = self._sums.get(name, 0.0) + count * image.astype(np.float64)
            self._squares[name] = self._squares.get(name, 0.0) + count * image.astype(np.float64) ** 2

    def means(self) -> dict[str, F32]:
        return {name: (total / self.count).astype(np.float32) for name, total in self._sums.items()}

    def noise(self, name: str) -> float | None:
        """Standard error of the mean, root mean square over the image, relative to the mean; None for one batch."""
        if self._batches < 2:
            return None
        mean = self._sums[name] / self.count
        variance = np.maximum(self._squares[name] / self.count - mean**2, 0) / (self._batches - 1)
        return float(np.sqrt(variance.mean()) / max(float(mean.mean()), 1e-30))
