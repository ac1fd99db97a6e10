"""How to draw a frame, as frozen, validated data."""

import math
import re
from dataclasses import dataclass, fields
from numbers import Integral, Real

import numpy as np

from app.errors import AfterglowError, SettingsError

MAX_SIDE = 16384
MIN_RENDER_SCALE = 0.5
MAX_BOUNCES = 64
MAX_SEED = 2**31 - 1
RAY_METHODS = ("auto", "cpu", "gpu")
TONE_MAPS = ("srgb", "agx", "pbr-neutral", "aces")
SETTLE_FRAMES = 16  # until temporal anti-aliasing has converged, at a render scale of 1


@dataclass(frozen=True)
class Settings:
    """How to draw a frame.

    Attributes
    ----------
    size : tuple of int
        Width and height of the image in pixels.
    outputs : tuple of str
        Named images to deliver: ``final`` and AOVs.
    taa : bool
        Temporal anti-aliasing.
    reflections : bool
        Indirect light on glossy surfaces; environments that are reflected are then traced too.
    exposure : float
        Linear factor before the tone map; the linear final image is not affected.
    auto_exposure : bool
        Bring the picture's mean luminance to middle grey before that factor, slowly when it changes.
    tonemap : str
        One of ``TONE_MAPS``, or a display and view of OpenColorIO, as ``DISPLAY/VIEW``.
    bounces : int or None
        Number of bounces of indirect light; None for the model's own.
    seed : int
        Varies the shadow sampling pattern and the order of the jitter sequence.
    provider : str
        onnxruntime execution provider: ``auto``, ``cpu``, ``cuda`` ….
    rays : str
        What traces rays: ``cpu``, ``gpu`` where it can, or ``auto``: a GPU if it draws, but not a software renderer.
    strict_device : bool
        Refuse a software renderer, and any provider other than ``provider``.
    timing : bool
        Wait for the GPU after each pass, so that CPU times include the pass's own work.
    check : bool
        Count the non-finite texels that each pass writes.
    scale : float or None
        Size of the networks' screen grid relative to the image, in (0, 1]; None for the networks' own.
    render_scale : float
        Size at which frames are drawn before temporal anti-aliasing accumulates them at the image's, relative to it,
        from 0.5 to 1.

    Raises
    ------
    SettingsError
        When a value is outside its range.
    """

    size: tuple[int, int] = (1024, 768)
    outputs: tuple[str, ...] = ("final",)
    taa: bool = True
    reflections: bool = True
    exposure: float = 1.0
    auto_exposure: bool = False
    tonemap: str = "srgb"
    bounces: int | None = None
    seed: int = 0
    provider: str = "auto"
    rays: str = "auto"
    strict_device: bool = False
    timing: bool = False
    check: bool = False
    scale: float | None = None
    render_scale: float = 1.0

    def __post_init__(self) -> None:
        _check_size(self.size, "size")
        if not (_is_a(Real, self.render_scale) and MIN_RENDER_SCALE <= self.render_scale <= 1):
            raise SettingsError(f"bad scale {self.render_scale}", "render_scale",
                                f"expected a number from {MIN_RENDER_SCALE} to 1")
        if self.render_scale < 1 and not self.taa:
            raise SettingsError("needs temporal anti-aliasing", "render_scale", "expected 1 without it")
        if self.render_scale < 1 and self.outputs != ("final",):
            raise SettingsError(f"can't draw {', '.join(o for o in self.outputs if o != 'final')} at the image's size",
                                "render_scale", "expected 1, or final as the only output")
        if not (_is_a(Real, self.exposure) and math.isfinite(self.exposure) and self.exposure > 0):
            raise SettingsError(f"bad exposure {self.exposure}", "exposure", "expected a finite number above 0")
        if self.bounces is not None and not (_is_a(Integral, self.bounces) and 1 <= self.bounces <= MAX_BOUNCES):
            raise SettingsError(f"bad number of bounces {self.bounces}", "bounces", f"expected 1 to {MAX_BOUNCES}")
        if self.scale is not None and not (_is_a(Real, self.scale) and 0 < self.scale <= 1):
            raise SettingsError(f"bad scale {self.scale}", "scale", "expected a number above 0, at most 1")
        for name, value in (("tonemap", self.tonemap), ("provider", self.provider)):
            if not isinstance(value, str):
                raise SettingsError(f"bad value {value}", name, "expected a name")
        if self.rays not in RAY_METHODS:
            raise SettingsError(f"bad value {self.rays!r}", "rays", f"expected one of {', '.join(RAY_METHODS)}")
        for name in ("taa", "auto_exposure", "strict_device"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise SettingsError(f"bad value {getattr(self, name)!r}", name, "expected True or False")
        if not self.outputs:
            raise SettingsError("no output given", "outputs", "expected at least one name, such as final")
        if not (_is_a(Integral, self.seed) and 0 <= self.seed <= MAX_SEED):
            raise SettingsError(f"bad seed {self.seed}", "seed", f"expected 0 to {MAX_SEED}")

    @property
    def render_size(self) -> tuple[int, int]:
        """Width and height in pixels at which frames are drawn."""
        width, height = (math.ceil(n * self.render_scale) for n in self.size)
        return width, height

    @property
    def settle_frames(self) -> int:
        """Frames until temporal anti-aliasing has converged: as many samples of each pixel at any render scale."""
        return round(SETTLE_FRAMES / self.render_scale**2) if self.taa else 0


def _is_a(kind: type, value: object) -> bool:
    """Whether it is a number of that kind, which an array or a truth value is not."""
    return isinstance(value, kind) and not isinstance(value, bool)


_OPTIONS = {**{field.name: "--" + field.name.replace("_", "-") for field in fields(Settings)}, "outputs": "--aov"}


def command_line_error(error: AfterglowError) -> str:
    """What ``error`` says, with the option in place of the setting that it names."""
    where = _OPTIONS.get(error.where, error.where) if isinstance(error.where, str) else error.where
    return f"{where}: {error.what} ({error.expected})"


def parse_size(text: str, option: str = "--size") -> tuple[int, int]:
    """``1024x768`` as (1024, 768).

    Raises
    ------
    SettingsError
        When it is not two whole numbers from 1 to ``MAX_SIDE``.
    """
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", text)
    if match is None:
        raise SettingsError(f"bad size {text!r}", option, "expected WIDTHxHEIGHT in pixels, such as 1024x768")
    size = int(match[1]), int(match[2])
    _check_size(size, option)
    return size


def _check_size(size: tuple[int, int], where: str) -> None:
    if not all(isinstance(n, int) and 1 <= n <= MAX_SIDE for n in size):
        raise SettingsError(f"bad size {size[0]}x{size[1]}", where, f"expected WIDTHxHEIGHT, each from 1 to {MAX_SIDE}")
