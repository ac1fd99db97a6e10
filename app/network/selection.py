"""Which model makes what: the indirect light, and the light that comes straight from an environment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from app.errors import SettingsError
from app.network.bounces import with_bounces
from app.network.contract import SSGI, UNSHADOWED, Model, read_contract
from app.scene import Scene
from app.settings import Settings

if TYPE_CHECKING:
    from app.network.bounces import Reapplied
    from app.network.session import Network

_TASKS = {"indirect": "make indirect light", "environment": "shade an environment"}


@dataclass(frozen=True)
class Models:
    """What draws a frame.

    Attributes
    ----------
    indirect : Network, Reapplied, ``ssgi`` or None
        Makes the indirect light.
    environment : Network, ``coarse`` or None
        Shades surfaces by the scene's environment.
    """

    indirect: Network | Reapplied | Literal["ssgi"] | None = None
    environment: Network | Literal["unshadowed_environment"] | None = None

    @property
    def provider(self) -> str:
        """Execution provider of the networks, or ``none``."""
        return next((m.provider for m in (self.indirect, self.environment) if not isinstance(m, str | None)), "none")


def load_models(chosen: Sequence[Model], settings: Settings, has_environment: bool) -> Models:
    """Load what was ``chosen``, but none for an environment that is not there.

    Raises
    ------
    AfterglowError
        When two make the same, or a network can't be loaded.
    """
    roles = by_role(chosen)
    if not has_environment:
        roles.pop("environment", None)
    loaded = {role: _load(model, settings) for role, model in roles.items()}
    if settings.bounces is not None:
        loaded["indirect"] = with_bounces(loaded.get("indirect"), settings.bounces)
    return Models(**loaded)


def by_role(chosen: Iterable[Model], where: str = "--model") -> dict[str, Model]:
    """The models as the attributes of ``Models``.

    Raises
    ------
    AfterglowError
        When two make the same, which ``where`` asks for.
    """
    roles: dict[str, Model] = {}
    for model in chosen:
        role = "environment" if shades_environment(model) else "indirect"
        if role in roles:
            raise SettingsError(f"two models that {_TASKS[role]}, {roles[role]} and {model}", where,
                                "expected one for indirect light and one that shades an environment")
        roles[role] = model
    return roles


def shades_environment(model: Model) -> bool:
    """Whether a model makes an environment's direct light, not indirect light."""
    return model == UNSHADOWED or (model != SSGI and read_contract(model).shades_environment)


def about_environment(scene: Scene, models: Sequence[Model]) -> Iterator[str]:
    """What is to be known of how the environment lights, or does not."""
    shading = [model for model in models if shades_environment(model)]
    if scene.environment is None:
        if shading:
            yield "the scene has no environment to shade"
    elif UNSHADOWED in shading:
        yield "the environment lights without shadows: no network puts them in"
    elif not shading and not any(_sees_sky(model) for model in models):
        yield "the environment is shown and lights nothing: ember takes light from it, ndr-8 and coarse shade by it"


def _load(model: Model, settings: Settings) -> Any:
    if isinstance(model, str):
        return model
    from app.network.session import Network  # not before a network is wanted: it imports onnxruntime

    grid = read_contract(model).screen_size(settings.size)
    return Network(model, grid, settings.provider, settings.strict_device)


def _sees_sky(model: Model) -> bool:
    """Whether a network for indirect light reads what an environment sends."""
    specs = read_contract(model).inputs.values() if isinstance(model, Path) else ()
    return any(name in ("emissive_irradiance.rgb", "surface_and_sky_radiance.rgb", "environment.sh") for spec in specs for name in spec.channels)
