"""Errors of an image against a reference. Images are linear Rec. 709 radiance, shape (H, W, 3), top row first.

Perceptual metrics (PSNR, SSIM, temporal error, FLIP) expose so that the reference's 95th-percentile luminance is 1.
Every metric refuses images of different shapes, and values that are not finite: one NaN would hide in a mean.
With a ``mask``, bool of shape (H, W), both images count as black outside it and only texels inside it are averaged.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import F32, F64, Bools, Floats
from app.errors import MetricError
from app.extras import extra_module
from app.io.image import srgb_encode
from app.math3d import LUMINANCE

EXTRA = "evaluation"
MIN_LUMINANCE = 1e-12      # W/(sr m²); darker references count as black
SSIM_SIGMA, SSIM_RADIUS = 1.5, 5
FLIP_STOPS = (-2.0, 2.0)   # exposures of HDR-FLIP, in stops around ``exposure_of``; equal ends would give 0
FLIP_EXPOSURES = 3
MAX_FLIP_RADIANCE = 65504.0  # exposed; the tone map of FLIP divides squares by squares


def exposure_of(reference: Floats) -> float:
    """1 / the 95th-percentile luminance of ``reference``, shape (..., 3).

    The divisor is at least a hundredth of the mean luminance, so that the image is not black but for a small bright
    spot, and at least ``MIN_LUMINANCE``, so that a black reference has an exposure too.
    """
    luminance = reference.astype(np.float64) @ LUMINANCE
    return 1.0 / max(float(np.percentile(luminance, 95)), float(luminance.mean()) / 100, MIN_LUMINANCE)


def tone_map(image: Floats, exposure: float) -> F32:
    """The sRGB transfer of clamp(exposure · image, 0, 1)."""
    return srgb_encode(image.astype(np.float64) * exposure)


def psnr(image: Floats, reference: Floats, mask: Bools | None = None) -> float:
    """Peak signal-to-noise ratio of the tone-mapped images in dB; infinite for equal ones."""
    a, b, inside = _shown(image, reference, mask)
    mse = float(((a - b) ** 2)[inside].mean())
    return math.inf if mse == 0.0 else -10.0 * math.log10(mse)


def ssim(image: Floats, reference: Floats, mask: Bools | None = None) -> float:
    """Structural similarity of the tone-mapped images, -1 to 1; Wang et al. 2004, 11×11 Gaussian window of σ 1.5.

    Only texels whose window lies in the image are averaged; of a mask without such a texel, all are.

    Raises
    ------
    MetricError
        When the images are unsuitable, or a side is shorter than the window.
    """
    a, b, inside = _shown(image, reference, mask)
    if min(a.shape[:2]) < 2 * SSIM_RADIUS + 1:
        raise MetricError(f"image of {a.shape[1]}x{a.shape[0]}", "ssim", "expected at least 11x11 texels")
    similarity = extra_module("skimage.metrics", EXTRA).structural_similarity
    values = similarity(a, b, data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=SSIM_SIGMA,
                        truncate=SSIM_RADIUS / SSIM_SIGMA, use_sample_covariance=False, full=True)[1]
    whole = np.zeros_like(inside)
    whole[SSIM_RADIUS:-SSIM_RADIUS, SSIM_RADIUS:-SSIM_RADIUS] = True
    counted = inside & whole
    return float(values[counted if counted.any() else inside].mean())


def rel_mse(image: Floats, reference: Floats, mask: Bools | None = None) -> float:
    """Mean of (image − reference)² / (reference² + ε) on linear values; ε is 0.01 of the reference's squared mean."""
    a, b, inside = _checked(image, reference, mask)
    epsilon = max(0.01 * float(b[inside].mean()) ** 2, MIN_LUMINANCE**2)
    return float(((a - b) ** 2 / (b**2 + epsilon))[inside].mean())


def flip_map(image: Floats, reference: Floats, mask: Bools | None = None) -> F32:
    """HDR-FLIP of each texel, shape (H, W), 0 to 1; Andersson et al. 2021, three exposures two stops apart."""
    a, b, _ = _checked(image, reference, mask)
    exposure = exposure_of(b if mask is None else b[mask])
    shown = [np.clip(x * exposure, 0.0, MAX_FLIP_RADIANCE).astype(np.float32) for x in (b, a)]
    evaluate = extra_module("flip_evaluator", EXTRA).evaluate
    # Explicit exposures: with automatic ones a black reference ends the interpreter.
    errors: F32 = evaluate(*shown, "HDR", applyMagma=False, computeMeanError=False, parameters={
        "startExposure": FLIP_STOPS[0], "stopExposure": FLIP_STOPS[1], "numExposures": FLIP_EXPOSURES})[0]
    return errors.reshape(a.shape[:2])


def flip(image: Floats, reference: Floats, mask: Bools | None = None) -> float:
    """Mean of ``flip_map``."""
    errors = flip_map(image, reference, mask)
    return float(errors.mean() if mask is None else errors[mask].mean())


def temporal_error(frames: Sequence[Floats], references: Sequence[Floats], mask: Bools | None = None) -> float:
    """Mean absolute difference between the frames' changes and the references', tone-mapped with one exposure for all.

    Flicker raises it; an error that stays the same in every frame does not.

    Raises
    ------
    MetricError
        When the images are unsuitable, fewer than two, or not as many as the references.
    """
    if len(frames) < 2 or len(frames) != len(references):
        raise MetricError(f"{len(frames)} frames and {len(references)} references", "temporal_error",
                          "expected two or more frames and as many references")
    pairs = [_checked(frame, reference, mask) for frame, reference in zip(frames, references, strict=True)]
    inside = pairs[0][2]
    exposure = exposure_of(np.stack([b[inside] for _, b, _ in pairs]))
    off = np.stack([tone_map(a, exposure) - tone_map(b, exposure) for a, b, _ in pairs])
    return float(np.abs(np.diff(off, axis=0))[:, inside].mean())


def _shown(image: Floats, reference: Floats, mask: Bools | None) -> tuple[F64, F64, Bools]:
    """Both images tone-mapped with the reference's exposure, and which texels count."""
    a, b, inside = _checked(image, reference, mask)
    exposure = exposure_of(b[inside])
    return tone_map(a, exposure).astype(np.float64), tone_map(b, exposure).astype(np.float64), inside


def _checked(image: Floats, reference: Floats, mask: Bools | None) -> tuple[F64, F64, Bools]:
    """Both images in float64, black outside the mask, and the mask."""
    if reference.ndim != 3 or reference.shape[2] != 3 or image.shape != reference.shape or 0 in reference.shape:
        raise MetricError(f"shapes {image.shape} and {reference.shape}", "image and reference",
                          "expected (H, W, 3) for both")
    inside = np.ones(reference.shape[:2], bool) if mask is None else mask
    if inside.shape != reference.shape[:2] or inside.dtype != bool or not inside.any():
        raise MetricError(f"{inside.dtype} of {inside.shape}", "mask",
                          f"expected bool of {reference.shape[:2]} with a texel that is true")
    for name, values in (("image", image), ("reference", reference)):
        bad = int(np.count_nonzero(~np.isfinite(values).all(axis=2) & inside))
        if bad:
            raise MetricError(f"{bad} texels are not finite", name, "expected finite numbers")
    a, b = (np.where(inside[..., None], values, 0).astype(np.float64) for values in (image, reference))
    return a, b, inside


@dataclass(frozen=True)
class Metric:
    """A metric, and what tables and comparisons of runs need to know about it.

    Attributes
    ----------
    noticeable : float
        Smallest reported change between two runs; a share of the earlier value if ``relative``.
    digits : str
        Number format in tables of validation results.
    """

    measure: Callable[..., float]
    title: str
    digits: str
    noticeable: float
    relative: bool = False
    higher_is_better: bool = False


METRICS = {
    "psnr": Metric(psnr, "PSNR", ".2f", noticeable=0.05, higher_is_better=True),
    "ssim": Metric(ssim, "SSIM", ".3f", noticeable=0.001, higher_is_better=True),
    "rel_mse": Metric(rel_mse, "relMSE", ".3g", noticeable=0.01, relative=True),
    "flip": Metric(flip, "FLIP", ".3f", noticeable=0.01, relative=True),
}
