"""What is measured: models, sizes, scales and precisions, multiplied out."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from app.errors import ModelError, SettingsError
from app.network.contract import (
    HALF,
    KEY,
    SSGI,
    UNSHADOWED,
    Model,
    ModelContract,
    bundled_models,
    find_model,
    read_contract,
)
from app.network.selection import by_role, shades_environment
from app.scene import Scene

NONE = "none"
JOINT = "+"        # between two models that draw together
DEFAULT = "ember"  # what makes indirect light where none is named
PRECISIONS = {"float32": "", "float16": HALF}  # and what the names of networks end in
_METADATA_PROPS, _KEY, _VALUE = 14, 1, 2  # fields of ModelProto and StringStringEntryProto in onnx.proto


@dataclass(frozen=True)
class Configuration:
    """One way to draw a frame.

    Attributes
    ----------
    label : str
        The models' names, with the scale and precision that were asked for.
    models : tuple of (Path, ``ssgi`` or ``coarse``)
        What ``Renderer`` takes as its models: none, one, or one for indirect light and one that shades an environment.
    size : tuple of int
        Width and height of the image.
    """

    label: str
    models: tuple[Model, ...]
    size: tuple[int, int]

    @property
    def file(self) -> Model | None:
        """The model where it is one."""
        return self.models[0] if len(self.models) == 1 else None

    @property
    def shades_environment(self) -> bool:
        """Whether a model is of no use to a scene without an environment."""
        return any(map(shades_environment, self.models))

    @property
    def grid(self) -> tuple[int, int] | None:
        """Width and height of the first network's screen grid."""
        return next((contract.screen_size(self.size) for contract in self._contracts), None)

    @property
    def precision(self) -> str | None:
        """The networks' type of number."""
        return " and ".join(dict.fromkeys(contract.dtype for contract in self._contracts)) or None

    @property
    def _contracts(self) -> list[ModelContract]:
        return [read_contract(model) for model in self.models if isinstance(model, Path)]


def all_models() -> tuple[str, ...]:
    """No indirect light, the classical method, and the bundled networks for such; of two precisions the single one."""
    return NONE, SSGI, *_bundled(shading=False)


def sky_models() -> tuple[str, ...]:
    """What is measured besides where there is an environment: the default beside each model that shades one."""
    return tuple(JOINT.join((DEFAULT, name)) for name in (UNSHADOWED, *_bundled(shading=True)))


def _bundled(shading: bool) -> list[str]:
    files = bundled_models()
    return [name for name, file in files.items() if read_contract(file).shades_environment == shading
            and (not name.endswith(HALF) or name.removesuffix(HALF) not in files)]


def find_models(text: str) -> tuple[Model, ...]:
    """What ``text`` names: ``none``, a model, or two joined by ``+``, such as ``ember+coarse``, in either order.

    Returns
    -------
    tuple
        What makes indirect light before what shades an environment.

    Raises
    ------
    AfterglowError
        When there is no such model, or two make the same.
    """
    roles = by_role((find_model(name, "--models") for name in _names(text) if name != NONE), text)
    return tuple(roles[role] for role in ("indirect", "environment") if role in roles)


def _names(text: str) -> list[str]:
    """Of the models in ``text``; a file's path may have a ``+`` itself."""
    known = (NONE, SSGI, UNSHADOWED, *bundled_models())
    parts = text.split(JOINT)
    splits = [[JOINT.join(parts[:k]).strip(), JOINT.join(parts[k:]).strip()] for k in range(1, len(parts))]
    for names in ([text], *splits):
        if all(name in known or Path(name).is_file() for name in names):
            return names
    return [part.strip() for part in parts]


def expand(models: Sequence[str], sizes: Sequence[tuple[int, int]], scales: Sequence[float] = (),
           precisions: Sequence[str] = (), folder: Path = Path()) -> tuple[list[Configuration], list[str]]:
    """Multiply out.

    Parameters
    ----------
    models : sequence of str
        Texts for ``find_models``.
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
    AfterglowError
        When there is no such model, two make the same, or two are of one name.
    """
    variants: dict[str, tuple[Model, ...]] = {}
    absent: list[str] = []
    for text in models:
        for label, variant in _variants(find_models(text), scales, precisions, folder, absent):
            if label in variants:
                raise ModelError(f"two models are called {label!r}", text,
                                 "expected each once, and different file names")
            variants[label] = variant
    return [Configuration(label, files, size) for size in sizes for label, files in variants.items()], absent


def at_work(configurations: Sequence[Configuration], scene: Scene) -> tuple[list[Configuration], list[str]]:
    """Those that ``scene`` has work for, and the labels of those that have no environment to shade there."""
    if scene.environment is not None:
        return list(configurations), []
    idle = dict.fromkeys(c.label for c in configurations if c.shades_environment)
    return [c for c in configurations if c.label not in idle], list(idle)


def nothing_to_shade(scene: Scene, labels: Sequence[str]) -> SettingsError:
    """The error for models that shade an environment, where there is none."""
    return SettingsError(f"{scene.name} has no environment for {', '.join(labels)}", "--models",
                         "expected a lighting with one, or other models")


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
    content = network.read_bytes() + entry
    # Networks of one stem are told apart by their content.
    copy = folder / f"{network.stem}-{scale!r}-{hashlib.sha256(content).hexdigest()[:16]}.onnx"
    copy.write_bytes(content)
    return copy


def _variants(models: tuple[Model, ...], scales: Sequence[float], precisions: Sequence[str], folder: Path,
              absent: list[str]) -> Iterator[tuple[str, tuple[Model, ...]]]:
    """Label and files of each precision and scale that exists; what is no network has none."""
    if not any(isinstance(model, Path) for model in models):
        yield _label(models), models
        return
    for label, precise in _of_precisions(models, precisions, absent):
        for scale in scales:
            yield f"{label} at {_of_image(scale)}", tuple(
                rescaled(m, scale, folder) if isinstance(m, Path) else m for m in precise)
        if not scales:
            yield label, precise


def _label(models: Sequence[Model]) -> str:
    return JOINT.join(Path(model).stem for model in models) or NONE


def _of_precisions(models: tuple[Model, ...], precisions: Sequence[str],
                   absent: list[str]) -> list[tuple[str, tuple[Model, ...]]]:
    """Label and files of each variant that exists."""
    if not precisions:
        return [(_label(models), models)]
    name = JOINT.join(Path(model).stem.removesuffix(HALF) for model in models)
    found = []
    for precision in precisions:
        variants = tuple(_in_precision(model, precision) for model in models)
        missing = next((m.name for m in variants if isinstance(m, Path) and not _is_of(m, precision)), None)
        if missing is None:
            found.append((f"{name} {precision}", variants))
        else:
            absent.append(f"{name} in {precision} is not available (there is no {missing} of that type)")
    return found


def _in_precision(model: Model, precision: str) -> Model:
    """The file that a network's variant in ``precision`` should be; what is no network as it is."""
    if not isinstance(model, Path) or _is_of(model, precision):
        return model
    return model.with_name(f"{model.stem.removesuffix(HALF)}{PRECISIONS[precision]}.onnx")


def _is_of(network: Path, precision: str) -> bool:
    return network.is_file() and read_contract(network).dtype == precision


def _of_image(scale: float) -> str:
    """As a fraction where it is a short one."""
    short = Fraction(scale).limit_denominator(64)
    return str(short) if float(short) == scale else f"{scale:g}"


def _field(number: int, content: bytes) -> bytes:
    """A length-delimited protobuf field; https://protobuf.dev/programming-guides/encoding."""
    return bytes([number << 3 | 2]) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    return bytes([value & 127 | 128]) + _varint(value >> 7) if value > 127 else bytes([value])
