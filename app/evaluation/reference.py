"""Path-traced references, made by ``python -m export reference`` in a child process and cached by content."""

import json
import math
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.arrays import F32, Bools
from app.errors import SceneError
from app.evaluation.hashing import content_key
from app.evaluation.versions import exporter_version, require_path_tracer
from app.io.atomic_files import replace_folder
from app.io.child_process import run_module
from app.io.image import read_exr
from app.paths import TRAINING
from app.scene import Camera, Scene

LAYERS = ("final", "direct", "indirect", "albedo", "depth")
BASELINE_LAYERS = ("final", "albedo", "normal")
MIN_ALBEDO = 0.01  # below it demodulated light is not compared


@dataclass(frozen=True, eq=False)
class TraceRequest:
    """What to path-trace: a scene file, its lighting, camera and variant, and the image's width and height."""

    file: Path
    lighting: str | None
    camera: str | None
    size: tuple[int, int]
    variant: str | None = None

    @property
    def arguments(self) -> list[str]:
        """For ``python -m export reference``."""
        names = {"--lighting": self.lighting, "--camera": self.camera, "--variant": self.variant}
        options = [text for option, name in names.items() if name is not None for text in (option, name)]
        return [str(self.file), "--size", f"{self.size[0]}x{self.size[1]}", *options]


@dataclass(frozen=True, eq=False)
class Reference:
    """Layers by name, each of shape (H, W, C), and their metadata.

    Attributes
    ----------
    about : dict
        ``spp``, ``noise`` (relative standard error by layer), ``seconds``, ``notices`` (differences from what the
        renderer draws) and any further entries that the path tracer writes.
    key : str
        Equal for equal layers.
    """

    layers: dict[str, F32]
    about: dict[str, Any]
    key: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = self.layers["final"].shape[:2]
        return width, height

    @property
    def demodulated(self) -> Bools:
        """Where light divided by albedo is compared, shape (H, W)."""
        return (self.layers["depth"][..., 0] > 0) & (self.layers["albedo"].max(axis=2) >= MIN_ALBEDO)


@dataclass(frozen=True, eq=False)
class BaselineImage:
    """A path-traced image of ``spp`` samples per pixel, with guides for a denoiser and the seconds that it took."""

    spp: int
    seconds: float
    final: F32
    albedo: F32
    normal: F32


def read_reference(folder: Path) -> Reference:
    """The reference in ``folder``: ``reference.exr`` and ``reference.json``.

    Raises
    ------
    SceneError
        When a file is missing or damaged.
    """
    layers = _read_layers(folder / "reference.exr", LAYERS)
    return Reference(layers, _read_about(folder / "reference.json"), content_key(layers))


def make_reference(request: TraceRequest, scene: Scene, camera: Camera, spp: int) -> Reference:
    """The reference for ``scene``, from the cache if the same was requested before.

    Raises
    ------
    MissingExtraError
        When the path tracer is not installed.
    ProcessError
        When the path tracer fails.
    """
    key = content_key(scene, camera, request.size, spp, exporter_version(scene))
    return cache_reference(cache_folder() / key, lambda folder: _run(
        [*request.arguments, "--spp", str(spp), "--out", str(folder)]))


def cache_reference(folder: Path, make: Callable[[Path], object]) -> Reference:
    """The reference in ``folder``; if it is missing or damaged, ``make`` writes it into a new folder first."""
    if folder.is_dir():
        with suppress(SceneError):
            return read_reference(folder)
    with replace_folder(folder) as new:
        make(new)
    return read_reference(folder)


def cache_folder() -> Path:
    """Where references are cached, following the XDG base directory specification; safe to delete."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "afterglow" / "reference"


def make_baseline_images(request: TraceRequest, counts: Sequence[int]) -> list[BaselineImage]:
    """Path-trace images with ``counts`` samples per pixel, never from a cache, since their time is measured."""
    with TemporaryDirectory() as folder:
        _run([*request.arguments, "--baselines", ",".join(map(str, counts)), "--out", folder])
        return read_baseline_images(Path(folder))


def read_baseline_images(folder: Path) -> list[BaselineImage]:
    """The baseline images in ``folder``, by rising sample count; none without a ``baselines.json``.

    Raises
    ------
    SceneError
        When a file is missing or damaged.
    """
    file = folder / "baselines.json"
    if not file.is_file():
        return []
    images = []
    for spp, seconds in _read_json(file).items():
        if not spp.isdecimal() or int(spp) < 1 or not _is_number(seconds) or not 0 < seconds < math.inf:
            raise SceneError(f"bad entry {spp!r}: {seconds!r}", file, "expected sample counts with their seconds")
        layers = _read_layers(folder / f"baseline_{int(spp):04d}.exr", BASELINE_LAYERS)
        images.append(BaselineImage(int(spp), float(seconds), *(layers[name] for name in BASELINE_LAYERS)))
    return sorted(images, key=lambda image: image.spp)


def _run(arguments: Sequence[str]) -> None:
    require_path_tracer()
    run_module(TRAINING, ["reference", *arguments])


def _read_layers(path: Path, names: Sequence[str]) -> dict[str, F32]:
    """All layers, the unnamed one as ``final``; those in ``names`` exist and are finite, of one size and 3 channels."""
    layers = read_exr(path)
    if "" in layers:
        layers["final"] = layers.pop("")
    for name in names:
        if name not in layers:
            raise SceneError(f"no layer {name!r}", path, f"expected {', '.join(names)}")
        shape = (*layers["final"].shape[:2], 1 if name == "depth" else 3)
        if layers[name].shape != shape or not np.isfinite(layers[name]).all():
            raise SceneError(f"bad layer {name!r} of the shape {layers[name].shape}", path,
                             f"expected finite numbers of the shape {shape}")
    return layers


def _read_about(path: Path) -> dict[str, Any]:
    about = _read_json(path)
    noise, notices = about.get("noise", {}), about.get("notices", [])
    for name in ("spp", "seconds", "paths_per_second"):
        if name in about and not (_is_number(about[name]) and math.isfinite(about[name])):
            raise SceneError(f"{name} is {about[name]!r}", path, "expected a number")
    if not isinstance(noise, dict) or not all(map(_is_number, noise.values())):  # not finite for a black layer
        raise SceneError(f"noise is {noise!r}", path, "expected a number for each layer")
    if not isinstance(notices, list) or not all(isinstance(notice, str) for notice in notices):
        raise SceneError(f"notices are {notices!r}", path, "expected strings")
    return about


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        value = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SceneError(f"can't read the file ({error})", path,
                         "expected output of python -m export reference") from None
    if not isinstance(value, dict):
        raise SceneError("not a JSON object", path, "expected output of python -m export reference")
    return value
