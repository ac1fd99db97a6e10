"""The path-traced reference: made by ``python -m export reference`` in a process of its own, kept by content."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata, util
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app import environment
from app.errors import MissingExtraError, SceneError
from app.evaluation.hashing import content_key
from app.gl.shader import resolve
from app.io.atomic_files import replacing_folder
from app.io.child_process import run_export
from app.io.image import read_exr
from app.paths import shader_dir
from app.scene import Camera, Scene

F32 = NDArray[np.float32]

LAYERS = ("final", "direct", "indirect", "albedo", "depth")
PLAIN_LAYERS = ("final", "albedo", "normal")
# Of the package export: what a reference depends on.
TRACER = ("denoise.py", "mitsuba_scene.py", "path_tracer.py", "reference.py")
SKY_TRACER = "environment_tracer.py"  # the same, where an environment makes highlights
# What emission and highlights depend on.
OWN_SHADERS = ("gbuffer.vert", "gbuffer.frag", "shadow.vert", "shadow.frag", "shadow_nearest.frag", "direct.frag")
SKY_SHADERS = ("gbuffer.vert", "gbuffer.frag", "background.frag")  # the same, of the background
MIN_ALBEDO = 0.01  # where demodulated light counts


@dataclass(frozen=True, eq=False)
class Order:
    """What the path tracer is to draw: a scene file, and which of its lightings and cameras."""

    file: Path
    lighting: str | None
    camera: str | None
    size: tuple[int, int]

    @property
    def arguments(self) -> list[str]:
        """For ``python -m export reference``."""
        names = {"--lighting": self.lighting, "--camera": self.camera}
        chosen = [text for option, name in names.items() if name is not None for text in (option, name)]
        return [str(self.file), "--size", f"{self.size[0]}x{self.size[1]}", *chosen]


@dataclass(frozen=True, eq=False)
class Reference:
    """Layers by name, [H, W, C], and what is known about them.

    Attributes
    ----------
    about : dict
        ``spp``, ``noise`` (relative standard error by layer), ``seconds``, ``notices`` (what is not as the renderer
        draws it) and whatever else the path tracer says.
    key : str
        Equal for equal layers.
    """

    layers: dict[str, F32]
    about: dict[str, Any]
    key: str

    @property
    def size(self) -> tuple[int, int]:
        height, width = self.layers["final"].shape[:2]
        return width, height

    @property
    def demodulated(self) -> NDArray[np.bool_]:
        """Where light divided by albedo is judged, shape (H, W)."""
        return (self.layers["depth"][..., 0] > 0) & (self.layers["albedo"].max(axis=2) >= MIN_ALBEDO)


@dataclass(frozen=True, eq=False)
class Plain:
    """A path-traced picture of ``spp`` samples per pixel, with its guides and the seconds that it took."""

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


def make_reference(order: Order, scene: Scene, camera: Camera, spp: int) -> Reference:
    """The reference for ``scene``, from the cache where the same was asked for before.

    Raises
    ------
    MissingExtraError
        When there is no path tracer here.
    PathTracerError
        When it fails.
    """
    key = content_key(scene, camera, order.size, spp, exporter_version(scene), renderer_version(scene))
    return kept_reference(cache_folder() / key,
                      lambda fresh: _run([*order.arguments, "--spp", str(spp), "--out", str(fresh)]))


def kept_reference(folder: Path, make: Callable[[Path], object]) -> Reference:
    """The reference in ``folder``; where it is missing or damaged, ``make`` writes it into a new folder."""
    if folder.is_dir():
        with suppress(SceneError):
            return read_reference(folder)
    with replacing_folder(folder) as fresh:
        make(fresh)
    return read_reference(folder)


def make_plain(order: Order, counts: Sequence[int], folder: Path) -> list[Plain]:
    """Path-traced pictures of so many samples per pixel, drawn now, since their time is what matters."""
    _run([*order.arguments, "--plain", ",".join(map(str, counts)), "--out", str(folder)])
    return read_plain(folder)


def read_plain(folder: Path) -> list[Plain]:
    """The plain pictures in ``folder``, by rising sample count; none where there is no ``plain.json``.

    Raises
    ------
    SceneError
        When a file is missing or damaged.
    """
    file = folder / "plain.json"
    if not file.is_file():
        return []
    found = []
    for spp, seconds in _read_json(file).items():
        if not spp.isdecimal() or int(spp) < 1 or not _is_number(seconds) or not 0 < seconds < math.inf:
            raise SceneError(f"{spp!r} with {seconds!r}", file, "expected sample counts with their seconds")
        layers = _read_layers(folder / f"plain_{int(spp):04d}.exr", PLAIN_LAYERS)
        found.append(Plain(int(spp), float(seconds), *(layers[name] for name in PLAIN_LAYERS)))
    return sorted(found, key=lambda plain: plain.spp)


def cache_folder() -> Path:
    """Where references are kept, after the XDG base directory specification; safe to delete."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "afterglow" / "reference"


def exporter_version(scene: Scene) -> str:
    """Changes when the path tracer or the code around it does, as far as ``scene`` has a use for it.

    Raises
    ------
    MissingExtraError
        When one of both is not installed.
    """
    package = _exporter()
    digest = hashlib.sha256((metadata.version("mitsuba") + metadata.version("drjit")).encode())
    sky = (package / SKY_TRACER, Path(environment.__file__)) if scene.environment else ()
    for file in (*(package / name for name in TRACER), *sky):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _exporter() -> Path:
    """The folder of the package ``export``, found without importing it."""
    found = util.find_spec("export")
    try:
        metadata.version("mitsuba"), metadata.version("drjit")
    except metadata.PackageNotFoundError:
        found = None
    if found is None or not found.submodule_search_locations:
        raise MissingExtraError("no path tracer to make the reference with", "--reference auto",
                                "expected pip install 'afterglow[export]', or --reference DIR")
    return Path(found.submodule_search_locations[0])


def renderer_version(scene: Scene) -> str:
    """Changes when the shaders of highlights, emission and background do, if the renderer adds such to the reference."""
    digest = hashlib.sha256()
    own = any(material.emits or material.has_specular for material in scene.materials)
    sky = scene.environment is not None
    for file in (*(OWN_SHADERS if own else ()), *(SKY_SHADERS if sky else ())):
        digest.update(resolve(shader_dir() / file, {}, []).encode())
    return digest.hexdigest()


def _run(arguments: Sequence[str]) -> None:
    _exporter()
    run_export(["reference", *arguments], "the path tracer to draw the scene")


def _read_layers(path: Path, names: Sequence[str]) -> dict[str, F32]:
    """All layers, the unnamed one as ``final``; ``names`` are there, of one size, finite, and of three channels."""
    layers = read_exr(path)
    if "" in layers:
        layers["final"] = layers.pop("")
    for name in names:
        if name not in layers:
            raise SceneError(f"no layer {name!r}", path, f"expected {', '.join(names)}")
        shape = (*layers["final"].shape[:2], 1 if name == "depth" else 3)
        if layers[name].shape != shape or not np.isfinite(layers[name]).all():
            raise SceneError(f"layer {name!r} of {layers[name].shape}", path, f"expected finite numbers of {shape}")
    return layers


def _read_about(path: Path) -> dict[str, Any]:
    about = _read_json(path)
    noise, notices = about.get("noise", {}), about.get("notices", [])
    for name in ("spp", "seconds", "paths_per_second"):
        if name in about and not (_is_number(about[name]) and math.isfinite(about[name])):
            raise SceneError(f"{name} is {about[name]!r}", path, "expected a number")
    if not isinstance(noise, dict) or not all(map(_is_number, noise.values())):  # that of a black layer isn't finite
        raise SceneError(f"noise is {noise!r}", path, "expected a number for each layer")
    if not isinstance(notices, list) or not all(isinstance(notice, str) for notice in notices):
        raise SceneError(f"notices are {notices!r}", path, "expected texts")
    return about


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        value = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SceneError(f"can't read the file ({error})", path, "expected what export reference writes") from None
    if not isinstance(value, dict):
        raise SceneError("this is no JSON object", path, "expected what export reference writes")
    return value
