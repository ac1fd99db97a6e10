"""Which model makes what: the indirect light, and the light that comes straight from an environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from app.bounces import with_bounces
from app.contract import COARSE, SSGI, Model, read_contract
from app.errors import SettingsError
from app.settings import Settings

if TYPE_CHECKING:
    from app.bounces import Reapplied
    from app.infer import Network


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
    environment: Network | Literal["coarse"] | None = None

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
    roles: dict[str, Model] = {}
    for model in chosen:
        role = "environment" if shades_environment(model) else "indirect"
        if role in roles:
            raise SettingsError(f"two models, {roles[role]} and {model}", "--model", "expected one for indirect light "
                                "and one that shades an environment")
        roles[role] = model
    if not has_environment:
        roles.pop("environment", None)
    loaded = {role: _load(model, settings) for role, model in roles.items()}
    if settings.bounces is not None:
        loaded["indirect"] = with_bounces(loaded.get("indirect"), settings.bounces)
    return Models(**loaded)


def shades_environment(model: Model) -> bool:
    """Whether a model makes an environment's direct light, not indirect light."""
    return model == COARSE or (model != SSGI and read_contract(model).shades_environment)


def _load(model: Model, settings: Settings) -> Any:
    if isinstance(model, str):
        return model
    from app.infer import Network  # not before a network is wanted: it imports onnxruntime

    grid = read_contract(model).screen_size(settings.size)
    return Network(model, grid, settings.provider, settings.strict_device)
