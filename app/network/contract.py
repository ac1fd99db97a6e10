"""The model contract: everything the renderer must know about a network, as JSON inside its ``.onnx`` file.

Reading it needs neither onnx nor onnxruntime, so listing networks costs nothing.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal

from app.errors import ModelError
from app.network.channels import (
    BOUNCES,
    CHANNELS,
    CUBE,
    DIFFUSE,
    ENVIRONMENT,
    GLOBALS,
    LIT,
    PANORAMA,
    RAYS,
    SCREEN,
    SEEN,
    SURFELS,
    UNSHADOWED_CHANNELS,
)
from app.paths import nets_dir

# Chosen where a network may be: the classical screen-space method, and an environment without shadows.
SSGI: Final = "ssgi"
UNSHADOWED: Final = "unshadowed_environment"
HALF: Final = "-half"  # ends the names of networks' variants in half precision
Model = Path | Literal["ssgi", "unshadowed_environment"]

KEY = "afterglow"
VERSION = 2
GRIDS = (*SEEN, SURFELS, RAYS, GLOBALS)
MIN_SIDE, MAX_RAISED_SCALE = 48, 0.5
HALF_COUNTS = 2048  # whole numbers that half floats hold exactly
# So that a mistyped contract can't fill the memory.
MAX_TEXELS, MAX_SURFELS, MAX_RAYS, MAX_NUMBER = 1024, 16384, 2**22, 1e30


@dataclass(frozen=True)
class TensorSpec:
    """One input or output tensor of a network.

    Attributes
    ----------
    channels : tuple of str
        Names from the channel table, in tensor order.
    grid : str
        ``screen`` [1, C, h, w] or ``cube`` [1, C, 6, n, n] (front, back, left, right, up, down), top row first;
        ``panorama`` [1, C, h, 2h], a cube of faces h / 2 merged as in ``shaders/include/panorama.glsl``;
        ``surfels`` [1, C, S], points on the scene's surfaces, or ``rays`` [1, C, S, K], which go out from them;
        ``vector`` [1, C], numbers for the whole frame.
    size : int or None
        Texels along the edge of a cube face; height of a panorama; number of surfels; None for screen and vector.
    rays : int or None
        Of each surfel: a square number, the same in all tensors on the rays.
    """

    channels: tuple[str, ...]
    grid: str = SCREEN
    size: int | None = None
    rays: int | None = None

    @property
    def face(self) -> int | None:
        """Texels along the edge of the cube's faces that it is made from; None where it is from no cube."""
        return {CUBE: self.size, PANORAMA: (self.size or 0) // 2}.get(self.grid)

    @property
    def components(self) -> int:
        """Number of tensor channels, C."""
        return sum(CHANNELS[name].components for name in self.channels)

    def extent(self, screen: tuple[Any, ...]) -> tuple[Any, ...]:
        """Everything behind the channels in the tensor's shape, ``screen`` being what stands for [h, w]."""
        size = self.size or 0
        return {SCREEN: screen, CUBE: (6, size, size), PANORAMA: (size, 2 * size), SURFELS: (size,),
                RAYS: (size, self.rays or 0), GLOBALS: ()}[self.grid]

    def shape(self, screen: tuple[int, int]) -> tuple[int, ...]:
        """The tensor's shape without the batch, for a screen grid of the given width and height."""
        return self.components, *self.extent((screen[1], screen[0]))

    def rows(self) -> Iterator[tuple[str, slice]]:
        """Each channel name with the tensor channels that it takes."""
        start = 0
        for name in self.channels:
            stop = start + CHANNELS[name].components
            yield name, slice(start, stop)
            start = stop


@dataclass(frozen=True)
class ModelContract:
    """What a network reads, writes and expects; valid by construction.

    Attributes
    ----------
    inputs, outputs : mapping of str to TensorSpec
        By the tensor's name in the ONNX graph.
    scale : float
        Size of the screen grid relative to the output image, in (0, 1]; see ``screen_size`` for small images.
    exposure : str
        ``mean-radiance``: radiance is divided, and the output multiplied, by one scalar per frame. ``none``.
    bounces : str
        ``single`` or ``multi``: what the output means.
    scene_extent : float
        Length of the longest edge of the scene's bounding box in the network's units.
    multiple_of : int
        The screen grid is padded to multiples of this and cropped afterwards.
    dtype : str
        ``float32`` or ``float16``, of every tensor.
    cube_axes : str or None
        Axes of the cube's faces, ``world`` or ``camera``; needed when an input lies on the cube.
    static_input : str or None
        Input tensor whose share of the work is kept while it stays the same; the graph is then made as ``app.network.static_cache``
        says.

    Raises
    ------
    ModelError
        When a value is outside what is documented here.
    """

    name: str
    inputs: Mapping[str, TensorSpec]
    outputs: Mapping[str, TensorSpec]
    scale: float
    exposure: str
    bounces: str
    scene_extent: float
    multiple_of: int = 1
    dtype: str = "float32"
    cube_axes: str | None = None
    static_input: str | None = None
    paper: str = ""
    trained_on: str = ""
    licence: str = ""
    version: int = VERSION

    def __post_init__(self) -> None:
        where = f"contract of {self.name!r}"

        def need(ok: bool, what: str, expected: str) -> None:
            if not ok:
                raise ModelError(what, where, f"expected {expected}")

        need(self.version == VERSION, f"contract version {self.version!r}", f"version {VERSION}")
        for key in ("name", "paper", "trained_on", "licence"):
            need(isinstance(getattr(self, key), str), f"bad {key} {getattr(self, key)!r}", "text")
        need(_number(self.scale) and 0 < self.scale <= 1, f"bad scale {self.scale!r}", "a number above 0, at most 1")
        need(_number(self.scene_extent) and self.scene_extent > 0, f"bad scene_extent {self.scene_extent!r}",
             "a number above 0")
        need(_whole(self.multiple_of), f"bad multiple_of {self.multiple_of!r}", f"a whole number, 1 to {MAX_TEXELS}")
        for key, allowed in _CHOICES.items():
            need(getattr(self, key) in allowed, f"bad {key} {getattr(self, key)!r}", _one_of(allowed))
        need(bool(self.inputs) and bool(self.outputs), "no inputs or no outputs", "at least one tensor of each")
        tensors = {**self.inputs, **self.outputs}
        for tensor, spec in tensors.items():
            need(spec.grid in GRIDS, f"bad grid {spec.grid!r} of tensor {tensor!r}", _one_of(GRIDS))
            most = {CUBE: MAX_TEXELS, PANORAMA: 2 * MAX_TEXELS}.get(spec.grid, MAX_SURFELS)
            need(spec.size is None if spec.grid in (SCREEN, GLOBALS) else _whole(spec.size, most),
                 f"bad size {spec.size!r} of tensor {tensor!r}",
                 f"texels along the edge of a face on the cube, 1 to {MAX_TEXELS}, the height of a panorama, up to "
                 f"{2 * MAX_TEXELS}, the number of surfels on surfels and rays, 1 to {MAX_SURFELS}, and no size on "
                 "the screen and for vectors")
            need(spec.grid != PANORAMA or (spec.size or 0) % 4 == 0, f"a panorama {spec.size} high, tensor {tensor!r}",
                 "a multiple of 4, since views are halved and quartered")
            need(_square(spec.rays) if spec.grid == RAYS else spec.rays is None,
                 f"bad rays {spec.rays!r} of tensor {tensor!r}", "a square number of rays a surfel on rays, else none")
            need((spec.size or 0) * (spec.rays or 0) <= MAX_RAYS,
                 f"{spec.size} x {spec.rays} rays of tensor {tensor!r}", f"at most {MAX_RAYS} in all")
            need(spec.grid != RAYS or self.dtype != "float16" or (spec.size or 0) <= HALF_COUNTS,
                 f"{spec.size} surfels of tensor {tensor!r} in half precision", f"at most {HALF_COUNTS}, whose numbers "
                 "half floats tell apart")
            need(bool(spec.channels), f"tensor {tensor!r} has no channels", "at least one")
            for name in dict.fromkeys(spec.channels):
                need(name in CHANNELS, f"unknown channel {name!r} of tensor {tensor!r}", _suggest(name, CHANNELS))
                need(spec.grid in CHANNELS[name].grids, f"channel {name!r} is not provided on the {spec.grid} grid",
                     _one_of(CHANNELS[name].grids))
        for tensor, spec in self.inputs.items():
            for name in dict.fromkeys(spec.channels):
                need(not CHANNELS[name].output, f"channel {name!r} of input {tensor!r} can't be read",
                     "a channel that the renderer makes")
        faces = {spec.face for spec in tensors.values()} - {None}
        need(len(faces) <= 1, f"cubes and panoramas with different faces {sorted(filter(None, faces))}",
             "one size for all")
        counts = {spec.size for spec in tensors.values() if spec.grid in (SURFELS, RAYS)}
        need(len(counts) <= 1, f"surfel tensors of different sizes {sorted(counts, key=str)}", "one size for all")
        counts = {spec.rays for spec in tensors.values() if spec.grid == RAYS}
        need(len(counts) <= 1, f"different numbers of rays {sorted(counts, key=str)}", "one for all tensors")
        writable = [name for name, channel in CHANNELS.items() if channel.output]
        for tensor, spec in self.outputs.items():
            for name in dict.fromkeys(spec.channels):
                need(CHANNELS[name].output, f"channel {name!r} of output {tensor!r} can't be written",
                     _one_of(writable))
        made = {name for spec in self.outputs.values() for name in spec.channels}
        need(len(made & set(ENVIRONMENT)) in (0, len(made)), f"outputs {', '.join(sorted(made))}",
             "indirect light, or what shades an environment")
        need(made & set(ENVIRONMENT) in (set(), set(ENVIRONMENT)), f"outputs {', '.join(sorted(made))} alone",
             f"both of {', '.join(ENVIRONMENT)}")
        for name in dict.fromkeys(name for spec in self.inputs.values() for name in spec.channels):
            need(self.shades_environment or name not in UNSHADOWED_CHANNELS, f"channel {name!r} of a network for indirect "
                 "light", "it to be read by one that shades an environment")
            need(not self.shades_environment or name not in (*LIT, BOUNCES), f"channel {name!r} of a network that "
                 "shades an environment", "none of what that network lights itself, and no bounces")
        for tensor, spec in self.inputs.items():
            need(not self.shades_environment or spec.grid in (SCREEN, GLOBALS), f"grid {spec.grid!r} of tensor "
                 f"{tensor!r} of a network that shades an environment", f"{SCREEN} or {GLOBALS}")
        need(self.static_input in (None, *self.inputs), f"bad static_input {self.static_input!r}", _one_of(self.inputs))
        need(not faces or self.cube_axes is not None, "no cube_axes", "'world' or 'camera', since a tensor is a cube")

    @property
    def shades_environment(self) -> bool:
        """Whether it makes the light that comes straight from an environment; otherwise it makes indirect light."""
        return any(DIFFUSE in spec.channels for spec in self.outputs.values())

    @property
    def face(self) -> int | None:
        """Texels along the edge of the faces of the cube around the camera; None for no cube."""
        return next((spec.face for spec in self.inputs.values() if spec.face), None)

    @property
    def surfels(self) -> tuple[int, int] | None:
        """Number of surfels and of rays of each (1 when it reads none) that the network reads; None for no surfels."""
        sizes = [spec.size for spec in self.inputs.values() if spec.grid in (SURFELS, RAYS)]
        rays = [spec.rays for spec in self.inputs.values() if spec.grid == RAYS]
        return (sizes[0] or 0, (rays[0] if rays else 1) or 1) if sizes else None

    def screen_size(self, output: tuple[int, int]) -> tuple[int, int]:
        """Width and height of the screen grid for an output image of the given width and height.

        Small images get more than ``scale`` of their size, up to half, so that the shorter side keeps 48 texels.
        """
        scale = max(self.scale, min(MAX_RAISED_SCALE, MIN_SIDE / min(output)))
        width, height = (max(1, math.ceil(n * scale)) for n in output)
        return width, height

    def to_json(self) -> str:
        """The value of the metadata key: one line of JSON with sorted keys."""
        value = asdict(self)
        for group in ("inputs", "outputs"):
            value[group] = {tensor: {k: v for k, v in spec.items() if v is not None}
                            for tensor, spec in value[group].items()}
        return json.dumps({k: v for k, v in value.items() if v is not None}, sort_keys=True)

    @staticmethod
    def from_json(text: str, where: object) -> ModelContract:
        """Parse and check.

        Parameters
        ----------
        text : str
            The metadata value, or the content of a ``CONTRACT.json``.
        where : object
            File to name in errors.

        Raises
        ------
        ModelError
            When it is no JSON, or has missing, unknown or wrong values.
        """
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ModelError(f"the contract is no JSON ({error})", where, "expected one JSON object") from None
        # The version goes first: another version may well have other keys.
        if isinstance(value, dict) and value.get("version") != VERSION:
            restamp = f"; python -m export onnx restamp {where} brings it up to date" if value.get("version") == 1 else ""
            raise ModelError(f"contract version {value.get('version')!r}", where, f"expected version {VERSION}{restamp}")
        value = _checked_keys(value, ModelContract, "the contract", where)
        for group in ("inputs", "outputs"):
            if not isinstance(value[group], dict):
                raise ModelError(f"bad {group} {value[group]!r}", where, "expected tensors by name")
            value[group] = {tensor: _tensor(spec, tensor, where) for tensor, spec in value[group].items()}
        try:
            return ModelContract(**value)
        except ModelError as error:
            raise ModelError(error.what, where, error.expected) from None


_CHOICES: dict[str, tuple[str | None, ...]] = {
    "exposure": ("mean-radiance", "none"),
    "bounces": ("single", "multi"),
    "dtype": ("float32", "float16"),
    "cube_axes": ("world", "camera", None),
}


def bundled_models() -> dict[str, Path]:
    """Networks that come with the program, name to file, sorted by name."""
    return {path.stem: path for path in sorted(nets_dir().glob("*.onnx"), key=lambda path: path.stem)}


def find_model(name: str, where: str = "--model") -> Model:
    """File of a bundled network's name, or of a path; ``ssgi`` and ``coarse``, which have no file, as they are.

    Raises
    ------
    ModelError
        When it is neither, which ``where`` asks for.
    """
    if name == SSGI:
        return SSGI
    if name == UNSHADOWED:
        return UNSHADOWED
    bundled = bundled_models()
    if name in bundled:
        return bundled[name]
    if Path(name).is_file():
        return Path(name)
    raise ModelError(f"no network {name!r}", where,
                     "expected an .onnx file, none, or " + _suggest(name, (*bundled, SSGI, UNSHADOWED)))


def read_contract(path: Path | str) -> ModelContract:
    """The contract inside an ``.onnx`` file.

    Raises
    ------
    ModelError
        When the file can't be read, is no ONNX file, has no contract or a wrong one.
    """
    text = _metadata(Path(path)).get(KEY)
    if text is None:
        raise ModelError("the network has no contract", path,
                         f"expected metadata {KEY!r}; add it: python -m export onnx stamp {path} CONTRACT.json")
    return ModelContract.from_json(text, path)


def _metadata(path: Path) -> dict[str, str]:
    """ModelProto.metadata_props, by walking the file's top-level protobuf fields (onnx.proto: 7 graph, 14 metadata)."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"can't read the network ({error.strerror})", path, "expected an .onnx file") from None
    has_graph, entries = False, {}
    try:
        for number, value in _protobuf(memoryview(data)):
            has_graph |= number == 7
            if number == 14:
                entry = dict(_protobuf(value))
                entries[bytes(entry[1]).decode()] = bytes(entry[2]).decode()
        if not has_graph:
            raise ValueError("no graph")
    except (ValueError, KeyError, IndexError):
        raise ModelError("not a readable ONNX file", path, "expected a network saved as ONNX") from None
    return entries


def _protobuf(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Field numbers and contents; https://protobuf.dev/programming-guides/encoding."""
    at = 0
    while at < len(data):
        tag, at = _varint(data, at)
        start = at
        match tag & 7:
            case 0:
                at = _varint(data, at)[1]
            case 1:
                at += 8
            case 2:
                length, start = _varint(data, at)
                at = start + length
            case 5:
                at += 4
            case other:
                raise ValueError(f"wire type {other}")
        if at > len(data):
            raise ValueError("truncated")
        yield tag >> 3, data[start:at]


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if shift > 70:  # ten bytes hold 64 bits
            raise ValueError("an endless number")
        if byte < 128:
            return value, at


def _tensor(value: Any, tensor: str, where: object) -> TensorSpec:
    value = _checked_keys(value, TensorSpec, f"tensor {tensor!r}", where)
    channels = value["channels"]
    if not (isinstance(channels, list) and all(isinstance(name, str) for name in channels)):
        raise ModelError(f"bad channels {channels!r} of tensor {tensor!r}", where, "expected a list of channel names")
    return TensorSpec(**{**value, "channels": tuple(channels)})


def _checked_keys(value: Any, kind: type, what: str, where: object) -> dict[str, Any]:
    """A copy of ``value`` whose keys are all fields of ``kind`` and hold every field without a default."""
    if not isinstance(value, dict):
        raise ModelError(f"{what} is {value!r}", where, "expected a JSON object")
    known = {f.name: f for f in fields(kind)}
    for key in value:
        if key not in known:
            raise ModelError(f"unknown key {key!r} in {what}", where, "expected " + _suggest(key, known))
    for key, f in known.items():
        if key not in value and f.default is MISSING:
            raise ModelError(f"no key {key!r} in {what}", where, "expected " + _one_of(known))
    return dict(value)


def _suggest(word: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(known), n=1)
    return (f"{close[0]!r}? Known: " if close else "") + _one_of(known)


def _one_of(names: Any) -> str:
    return "one of " + ", ".join(str(name) for name in names if name is not None)


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_NUMBER


def _whole(value: object, most: int = MAX_TEXELS) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _square(value: object) -> bool:
    return isinstance(value, int) and _whole(value) and math.isqrt(value)**2 == value
