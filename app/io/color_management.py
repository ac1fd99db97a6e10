"""Displays and views of OpenColorIO, through OpenImageIO: of its default configuration, or the one that $OCIO names."""

from functools import cache
from typing import Any

import numpy as np
import OpenImageIO as oiio

from app.arrays import F32, Bytes
from app.errors import SettingsError, did_you_mean
from app.io.image import to_8bit
from app.settings import TONE_MAPS

SEPARATOR = "/"              # between a display and its view
LINEAR = "lin_rec709_scene"  # the renderer's colours


def find_view(text: str) -> tuple[str, str]:
    """The display and the view of ``DISPLAY/VIEW``.

    Raises
    ------
    SettingsError
        When the configuration has no such view.
    """
    views = {SEPARATOR.join((display, view)): (display, view)
             for display in _config().getDisplayNames() for view in _config().getViewNames(display)}
    if text not in views:
        known = did_you_mean(text, views) if SEPARATOR in text else (
            f"{did_you_mean(text, TONE_MAPS)}, or a view of OpenColorIO, such as {next(iter(views), 'DISPLAY/VIEW')!r}")
        raise SettingsError(f"unknown tone map or view {text!r}", "tonemap", known)
    return views[text]


def default_views() -> tuple[str, ...]:
    """The views of the configuration's default display, as ``DISPLAY/VIEW``."""
    display = _config().getDefaultDisplayName()
    return tuple(SEPARATOR.join((display, view)) for view in _config().getViewNames(display))


def display_view(radiance: F32, exposure: float, view: tuple[str, str]) -> Bytes:
    """``exposure`` times linear Rec. 709 ``radiance``, shape (H, W, 3), as a display and view show it, uint8.

    Raises
    ------
    SettingsError
        When the configuration can't convert to it.
    """
    linear = np.ascontiguousarray(radiance * np.float32(exposure))
    shown = oiio.ImageBufAlgo.ociodisplay(oiio.ImageBuf(linear), *view, fromspace=LINEAR)
    if shown.has_error:
        raise SettingsError(f"OpenColorIO can't show it: {' '.join(shown.geterror().split())}", SEPARATOR.join(view),
                            "expected a view of the configuration in $OCIO")
    pixels = np.asarray(shown.get_pixels(oiio.FLOAT))
    return to_8bit(np.nan_to_num(pixels[..., :3]))


@cache
def _config() -> Any:
    return oiio.ColorConfig()
