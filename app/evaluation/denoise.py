"""Open Image Denoise, which removes most of the noise of path-traced light."""

from importlib import metadata

import numpy as np

from app.arrays import F32
from app.extras import extra_module

PACKAGE, EXTRA = "pyoidn", "export"


def denoiser_version() -> str:
    """Version of the package, on which denoised images depend.

    Raises
    ------
    MissingExtraError
        When it is not installed.
    """
    extra_module(PACKAGE, EXTRA)
    return metadata.version(PACKAGE)


def denoise(light: F32, normal: F32, albedo: F32 | None = None) -> F32:
    """Denoise the light of surfaces; the result is never negative, and 0 where there is no surface.

    Parameters
    ----------
    light : ndarray, float32, shape (H, W, 3)
        Linear, in W/(sr m²): radiance, or without ``albedo`` radiance / albedo.
    normal : ndarray, float32, shape (H, W, 3)
        World space; 0 where there is no surface.
    albedo : ndarray, float32, shape (H, W, 3), or None
        A guide for light that is not divided by it.

    Raises
    ------
    MissingExtraError
        When Open Image Denoise is not installed.
    """
    denoised = run_denoiser(light, normal, np.ones_like(light) if albedo is None else albedo)
    return np.where(normal.any(axis=-1, keepdims=True), np.maximum(denoised, 0), np.float32(0))


def run_denoiser(color: F32, normal: F32, albedo: F32, quality: str = "high") -> F32:
    """Denoise a linear image, shape (H, W, 3), with normals and albedo of the same shape as guides.

    Parameters
    ----------
    quality : str
        ``high``, ``balanced`` or ``fast``.

    Raises
    ------
    MissingExtraError
        When Open Image Denoise is not installed.
    """
    run = extra_module(PACKAGE, EXTRA).denoise
    images = map(np.ascontiguousarray, (color, np.clip(albedo, 0, 1), normal))
    denoised: F32 = run(*images, hdr=True, quality=quality)
    return denoised
