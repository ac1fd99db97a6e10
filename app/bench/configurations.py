"""What is measured: models, sizes, scales and precisions, multiplied out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from app.contract import HALF, KEY, SSGI, Model, bundled_models, find_model, read_contract
from app.errors import ModelError

NONE = "none"
PRECISIONS = {"float32": "", "float16": HALF}  # and what the names of networks end in
_METADATA_PROPS, _KEY, _VALUE = 14, 1, 2  # fields of ModelProto and StringStringEntryProto in onnx.proto


@dataclass(frozen=True)
class Configuration:
    """One way to draw a frame.

    Attributes
    ----------
    label : str
        The model's name, with the scale and precision that were asked for.
    file : Path, ``ssgi``, ``coarse`` or None
        What ``Renderer`` takes as its model.
    size : tuple of int
        Width and height of the image.
    """

    label: str
    file: Model | None
    size: tuple[int, int]

    @property
    def grid(self) -> tuple[int, int] | None:
        """Width and height of a network's screen grid."""
        return read_contract(self.file).screen_size(self.size) if isinstance(self.file, Path) else None

    @property
    def precision(self) -> str | None:
        """A network's type of number."""
        return read_contract(self.file).dtype if isinstance(self.file, Path) else None


def all_models() -> tuple[str, ...]:
    """No indirect light, the classical method, and the bundled networks for such; of two precisions the single one."""
    bundled = {name: file for name, file in bundled_models().items() if not read_contract(file).shades_environment}
    return NONE, SSGI, *(name for name in bundled
                         if not name.endswith(HALF) or name.removesuffix(HALF) not in bundled)


def expand(models: Sequence[str], sizes: Sequence[tuple[int, int]], scales: Sequence[float] = (),
           precisions: Sequence[str] = (), folder: Path = Path()) -> tuple[list[Configuration], list[str]]:
    """Multiply out.

    Parameters
    ----------
    models : sequence of str
        ``none``, ``ssgi``, names of bundled networks and paths.
    scales : sequence of float
        Sizes of the networks' screen grid relative to the image; their own when empty.
    precisions : sequence of str
        Each network's own when empty. ``NAME-half.onnx`` beside ``NAME.onnx`` is its variant in half precision.
    folder : Path
        Where copies of networks with another scale are written; they are used as long as it exists.

    Returns
    -------
    tuple
        Configurations, those of one size together, and a line for each that can't be had.

    Raises
    ------
    ModelError
        When there is no such model, or two of one name.
    """
    variants: dict[str, Model | None] = {}
    absent: list[str] = []
    for name in models:
        file = None if name == NONE else find_model(name)
        if not isinstance(file, Path):
            variants[name] = file
            continue
        for variant, precise in _of_precisions(file, precisions, absent):
            for scale in scales or (None,):
                label = variant + (f" at {_of_image(scale)}" if scale else "")
                if label in variants:
                    raise ModelError(f"two models are called {label!r}", file, "expected different file names")
                variants[label] = precise if scale is None else rescaled(precise, scale, folder)
    return [Configuration(label, file, size) for size in sizes for label, file in variants.items()], absent


def rescaled(network: Path, scale: float, folder: Path) -> Path:
    """A copy of ``network`` in ``folder`` whose contract has another scale.

    A second entry of the same key is appended, which protobuf allows and readers prefer.

    Raises
    ------
    ModelError
        When the scale is not above 0 and at most 1.
    """
    contract = replace(read_contract(network), scale=scale).to_json().encode()
    entry = _field(_METADATA_PROPS, _field(_KEY, KEY.encode()) + _field(_VALUE, contract))
    copy = folder / f"{network.stem}-{scale!r}.onnx"
    copy.write_bytes(network.read_bytes() + entry)
    return copy


def _of_precisions(file: Path, precisions: Sequence[str], absent: list[str]) -> list[tuple[str, Path]]:
    """Label and file of each variant that exists."""
    if not precisions:
        return [(file.stem, file)]
    found = []
    for precision in precisions:
        name = file.stem.removesuffix(HALF)
        variant = file.with_name(f"{name}{PRECISIONS[precision]}.onnx")
        if read_contract(file).dtype == precision:
            found.append((f"{name} {precision}", file))
        elif variant.is_file() and read_contract(variant).dtype == precision:
            found.append((f"{name} {precision}", variant))
        else:
            absent.append(f"{name} in {precision} is not available (there is no {variant.name} of that type)")
    return found


def _of_image(scale: float) -> str:
    """As a fraction where it is a short one."""
    short = Fraction(scale).limit_denominator(64)
    return str(short) if float(short) == scale else f"{scale:g}"


def _field(number: int, content: bytes) -> bytes:
    """A length-delimited protobuf field; https://protobuf.dev/programming-guides/encoding."""
    return bytes([number << 3 | 2]) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    return bytes([value & 127 | 128]) + _varint(value >> 7) if value > 127 else bytes([value])
