"""The models by name, and what each of the chosen ones does: indirect light, or light straight from an environment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from app.errors import ModelError, SettingsError, did_you_mean
from app.network.bounces import with_bounces
from app.network.contract_json import read_contract
from app.paths import nets_dir
from app.scene import Scene
from app.settings import Settings

if TYPE_CHECKING:
    from app.network.bounces import RepeatedNetwork
    from app.network.session import Network

NONE: Final = "none"                          # no model
SSGI: Final = "ssgi"                          # the classical screen-space method
UNSHADOWED: Final = "unshadowed_environment"  # an environment's light without shadows
DEFAULT_MODEL = "final-gather"                # light gathered along rays, cleaned by a network
SURFEL_MODEL = "ember"                        # whose light at surfels gathered rays end with
DEFAULT_COMPARISON = (NONE, SURFEL_MODEL, DEFAULT_MODEL)
HALF_SUFFIX = "-half"                         # of networks in half precision beside the same in single precision
SUFFIX = ".onnx"                              # of networks' files
SEPARATOR = "+"                               # between two models that are used together
Model = Path | Literal["ssgi", "unshadowed_environment"]

_TASKS = {"indirect": "compute indirect light", "environment": "shade an environment"}


@dataclass(frozen=True)
class Models:
    """The models of a renderer.

    Attributes
    ----------
    indirect : Network, RepeatedNetwork, ``ssgi`` or None
        Computes the indirect light.
    environment : Network, ``unshadowed_environment`` or None
        Shades surfaces by the scene's environment.
    surfels : Network or None
        Computes the light of surfels that gathered rays end with, if ``indirect`` reads such light.
    """

    indirect: Network | RepeatedNetwork | Literal["ssgi"] | None = None
    environment: Network | Literal["unshadowed_environment"] | None = None
    surfels: Network | None = None

    @property
    def provider(self) -> str:
        """Execution provider of the networks, or ``none``."""
        return next((m.provider for m in (self.indirect, self.environment) if not isinstance(m, str | None)), NONE)

    @property
    def surfels_read(self) -> tuple[int, int] | None:
        """How many surfels the network of their light reads, and how many rays of each; None if there is none."""
        model = self.surfels or self.indirect
        return None if model is None or isinstance(model, str) else model.contract.surfels


def bundled_models() -> dict[str, Path]:
    """The networks that come with the program, name to file, sorted by name."""
    return {path.stem: path for path in sorted(nets_dir().glob(f"*{SUFFIX}"), key=lambda path: path.stem)}


def all_models() -> tuple[str, ...]:
    """``none``, ``ssgi``, and the bundled networks for indirect light, each in one precision, single if it exists."""
    return NONE, SSGI, *_bundled(shading=False)


def sky_models() -> tuple[str, ...]:
    """The default model together with each model that shades an environment."""
    return tuple(SEPARATOR.join((DEFAULT_MODEL, name)) for name in (UNSHADOWED, *_bundled(shading=True)))


def find_model(name: str, where: str = "--model") -> Model:
    """The file of a bundled network's name or of a path; ``ssgi`` and ``unshadowed_environment`` remain names.

    Parameters
    ----------
    where : str
        The option to name in errors.

    Raises
    ------
    ModelError
        When there is no such model.
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
    if name and Path(name).is_dir():
        raise ModelError(f"{name!r} is a folder", where, "expected an .onnx file")
    if name.endswith(SUFFIX):
        raise ModelError(f"no such file {name!r}", where, "expected the path of an existing .onnx file")
    raise ModelError(f"no model {name!r}", where,
                     f"{did_you_mean(name, (NONE, *bundled, SSGI, UNSHADOWED))}, or an .onnx file")


def find_models(text: str, where: str = "--models") -> tuple[Model, ...]:
    """The models that ``text`` names: ``none``, one, or two joined by ``+`` in either order, such as ``ember+ndr-8``.

    Returns
    -------
    tuple
        The model for indirect light before the one that shades an environment.

    Raises
    ------
    AfterglowError
        When there is no such model, or both have the same task.
    """
    roles = by_role((find_model(name, where) for name in _split(text) if name != NONE), where)
    return tuple(roles[role] for role in _TASKS if role in roles)


def by_role(models: Iterable[Model], where: str = "--model") -> dict[str, Model]:
    """The models by the attributes of ``Models``.

    Raises
    ------
    AfterglowError
        When two have the same task; names the option ``where``.
    """
    roles: dict[str, Model] = {}
    for model in models:
        role = "environment" if shades_environment(model) else "indirect"
        if role in roles:
            raise SettingsError(f"two models that {_TASKS[role]}, {roles[role]} and {model}", where,
                                "expected one model for indirect light and one that shades an environment")
        roles[role] = model
    return roles


def shades_environment(model: Model) -> bool:
    """Whether a model computes the direct light of an environment; otherwise it computes indirect light."""
    return model == UNSHADOWED or (model != SSGI and read_contract(model).shades_environment)


def needs_surfels(model: Model) -> bool:
    """Whether a model reads surfels of the world, or light that is gathered from them."""
    return not isinstance(model, str) and (read_contract(model).surfels is not None or read_contract(model).gathers)


def environment_notices(scene: Scene, models: Sequence[Model]) -> Iterator[str]:
    """Notes for the user when the environment lights surfaces without shadows, or when there is none to shade."""
    shading = [model for model in models if shades_environment(model)]
    if scene.environment is None:
        if shading:
            yield "the scene has no environment to shade"
    elif UNSHADOWED in shading:
        yield "the environment casts no shadows: that needs a network, such as ndr-8"


def load_models(models: Sequence[Model], settings: Settings, has_environment: bool) -> Models:
    """Load ``models``; one that shades an environment is skipped if the scene has none.

    Raises
    ------
    AfterglowError
        When two have the same task, a network can't be loaded, or a setting does not fit the models.
    """
    roles = by_role(models)
    if not has_environment:
        roles.pop("environment", None)
    loaded = {role: _load(model, settings) for role, model in roles.items()}
    if settings.bounces is not None:
        loaded["indirect"] = with_bounces(loaded.get("indirect"), settings.bounces)
    if isinstance(model := roles.get("indirect"), Path) and read_contract(model).gathers:
        loaded["surfels"] = _load_surfel_model(settings)
    return Models(**loaded)


def _load(model: Model, settings: Settings) -> Any:
    if isinstance(model, str):
        return model
    from app.network.session import Network  # imports onnxruntime, which is slow

    grid = read_contract(model).with_scale(settings.scale).screen_size(settings.render_size)
    return Network(model, grid, settings.provider, settings.strict_device, settings.scale)


def _load_surfel_model(settings: Settings) -> Network:
    """A network for a screen of one texel, which stays empty: only the light of surfels is wanted."""
    from app.network.session import Network  # imports onnxruntime, which is slow

    return Network(find_model(SURFEL_MODEL), (1, 1), settings.provider, settings.strict_device)


def _bundled(shading: bool) -> list[str]:
    files = bundled_models()
    return [name for name, file in files.items() if read_contract(file).shades_environment == shading
            and (not name.endswith(HALF_SUFFIX) or name.removesuffix(HALF_SUFFIX) not in files)]


def _split(text: str) -> list[str]:
    """The names in ``text``; a file's path may itself contain a ``+``."""
    known = (NONE, SSGI, UNSHADOWED, *bundled_models())
    parts = text.split(SEPARATOR)
    splits = [[SEPARATOR.join(parts[:k]).strip(), SEPARATOR.join(parts[k:]).strip()] for k in range(1, len(parts))]
    for names in ([text], *splits):
        if all(name in known or Path(name).is_file() for name in names):
            return names
    return [part.strip() for part in parts]
