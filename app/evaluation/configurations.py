"""What is measured: every combination of models, sizes, scales and precisions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from app.errors import ModelError, SettingsError
from app.network.contract import ModelContract
from app.network.contract_json import read_contract
from app.network.selection import HALF_SUFFIX, NONE, SEPARATOR, Model, find_models, shades_environment
from app.scene import Scene
from app.settings import Settings

AUTO = "auto"  # any execution provider
PRECISIONS = {"float32": "", "float16": HALF_SUFFIX}  # with the end of such networks' names
MAX_DENOMINATOR = 64  # of scales that are written as fractions


@dataclass(frozen=True)
class Configuration:
    """One way to draw a frame.

    Attributes
    ----------
    label : str
        The models' names, and the scale and precision if any were chosen.
    models : tuple of (Path, ``ssgi`` or ``unshadowed_environment``)
        What ``Renderer`` takes as its models: none, one, or one for indirect light and one that shades an environment.
    size : tuple of int
        Width and height of the image in pixels.
    scale : float or None
        Size of the networks' screen grid relative to the image; None for the networks' own.
    render_scale : float
        As in ``Settings``.
    """

    label: str
    models: tuple[Model, ...]
    size: tuple[int, int]
    scale: float | None = None
    render_scale: float = 1.0

    def settings(self, provider: str, timing: bool = False) -> Settings:
        """How to draw it."""
        return Settings(self.size, scale=self.scale, render_scale=self.render_scale, provider=provider, timing=timing)

    @property
    def file(self) -> Model | None:
        """The model, if there is exactly one."""
        return self.models[0] if len(self.models) == 1 else None

    @property
    def shades_environment(self) -> bool:
        """Whether a model is useless in a scene without an environment."""
        return any(map(shades_environment, self.models))

    @property
    def grid(self) -> tuple[int, int] | None:
        """Width and height of the first network's screen grid; None without a network."""
        render_size = self.settings(AUTO).render_size
        return next((contract.screen_size(render_size) for contract in self._contracts), None)

    @property
    def precision(self) -> str | None:
        """The data type of the networks' tensors; None without a network."""
        return " and ".join(dict.fromkeys(contract.dtype for contract in self._contracts)) or None

    @property
    def _contracts(self) -> list[ModelContract]:
        return [read_contract(model).with_scale(self.scale) for model in self.models if isinstance(model, Path)]


def expand(models: Sequence[str], sizes: Sequence[tuple[int, int]], scales: Sequence[float] = (),
           precisions: Sequence[str] = (), where: str = "--models") -> tuple[list[Configuration], list[str]]:
    """Combine models, sizes, scales and precisions.

    Parameters
    ----------
    models : sequence of str
        Texts for ``find_models``, or such a text, ``@`` and a render scale.
    scales : sequence of float
        Sizes of the networks' screen grid relative to the image; the networks' own if empty.
    precisions : sequence of str
        Keys of ``PRECISIONS``; each network's own if empty. ``NAME-half.onnx`` beside ``NAME.onnx`` is its variant in
        half precision.
    where : str
        The option or argument to name in errors.

    Returns
    -------
    tuple
        Configurations, grouped by size, and a line for each variant that does not exist.

    Raises
    ------
    AfterglowError
        When there is no such model, two have the same task, or two configurations have the same label.
    """
    variants: dict[str, tuple[tuple[Model, ...], float | None, float]] = {}
    absent: list[str] = []
    for text in models:
        name, render_scale = _split_render_scale(text)
        for variant, files, scale in _variants(find_models(name, where), scales, precisions, absent):
            label = variant if render_scale == 1 else f"{variant}@{render_scale:g}"
            if label in variants:
                raise ModelError(f"two models are called {label!r}", text,
                                 "expected each once, and different file names")
            variants[label] = files, scale, render_scale
    return [Configuration(label, files, size, scale, render_scale)
            for size in sizes for label, (files, scale, render_scale) in variants.items()], absent


def select_applicable(configurations: Sequence[Configuration], scene: Scene) -> tuple[list[Configuration], list[str]]:
    """The configurations for ``scene``, and the labels of those that shade an environment it does not have."""
    if scene.environment is not None:
        return list(configurations), []
    skipped = dict.fromkeys(c.label for c in configurations if c.shades_environment)
    return [c for c in configurations if c.label not in skipped], list(skipped)


def no_environment_error(scene: Scene, labels: Sequence[str]) -> SettingsError:
    """The error for models that shade an environment in a scene without one."""
    return SettingsError(f"{scene.name} has no environment for {', '.join(labels)}", "--models",
                         "expected a lighting with one, or other models")


def _split_render_scale(text: str) -> tuple[str, float]:
    """The parts of ``ember@0.5``; 1 without a render scale."""
    name, _, number = text.rpartition("@")
    try:
        return (name, Settings(render_scale=float(number)).render_scale) if name else (text, 1.0)
    except ValueError:  # no number, so the @ belongs to the name of a file
        return text, 1.0


def _variants(models: tuple[Model, ...], scales: Sequence[float], precisions: Sequence[str],
              absent: list[str]) -> Iterator[tuple[str, tuple[Model, ...], float | None]]:
    """Label, models and scale of each variant that exists; only networks have variants."""
    if not any(isinstance(model, Path) for model in models):
        yield _label(models), models, None
        return
    for label, files in _in_precisions(models, precisions, absent):
        for scale in scales:
            yield f"{label} at {_format_scale(scale)}", files, scale
        if not scales:
            yield label, files, None


def _label(models: Sequence[Model]) -> str:
    return SEPARATOR.join(Path(model).stem for model in models) or NONE


def _in_precisions(models: tuple[Model, ...], precisions: Sequence[str],
                   absent: list[str]) -> Iterator[tuple[str, tuple[Model, ...]]]:
    """Label and models in each precision that exists."""
    if not precisions:
        yield _label(models), models
    name = SEPARATOR.join(Path(model).stem.removesuffix(HALF_SUFFIX) for model in models)
    for precision in precisions:
        variants = tuple(_in_precision(model, precision) for model in models)
        missing = next((m.name for m in variants if isinstance(m, Path) and not _has_precision(m, precision)), None)
        if missing is None:
            yield f"{name} {precision}", variants
        else:
            absent.append(f"{name} in {precision} is not available (there is no {missing} of that type)")


def _in_precision(model: Model, precision: str) -> Model:
    """The file of a network's variant in ``precision``, whether it exists or not; other models as they are."""
    if not isinstance(model, Path) or _has_precision(model, precision):
        return model
    return model.with_name(f"{model.stem.removesuffix(HALF_SUFFIX)}{PRECISIONS[precision]}.onnx")


def _has_precision(network: Path, precision: str) -> bool:
    return network.is_file() and read_contract(network).dtype == precision


def _format_scale(scale: float) -> str:
    """As a fraction if it is a short one."""
    fraction = Fraction(scale).limit_denominator(MAX_DENOMINATOR)
    return str(fraction) if float(fraction) == scale else f"{scale:g}"
