"""Networks as torch modules, one file per family, and the presets of all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from torch import Tensor, nn

from app.contract import ModelContract
from app.errors import ModelError
from export.models import bcnn
from export.models.surfels import Gather, Radiosity


class Network(Protocol):
    """A torch module that training and export can work with.

    Called with the tensors of its contract's inputs by name, each [B, C, h, w] or [B, C, 6, n, n], it returns
    radiance / albedo [B, 3, h, w] in the unit of the radiance that it was given.
    """

    contract: ModelContract

    def __call__(self, **tensors: Tensor) -> Tensor: ...


UNTRAINED: Mapping[str, Callable[[], nn.Module]] = {"gather": Gather, "radiosity": Radiosity}
PRESETS: Mapping[str, Callable[..., nn.Module]] = {
    **UNTRAINED,
    **{name: partial(bcnn.Bcnn, name) for name in bcnn.PRESETS},
}


def make_network(preset: str, options: Mapping[str, Any] | None = None) -> nn.Module:
    """A network with fresh weights.

    Raises
    ------
    ModelError
        When there is no such preset, or it has no such options.
    """
    if preset not in PRESETS:
        raise ModelError(f"no network {preset!r}", "preset", f"expected one of {', '.join(PRESETS)}")
    try:
        return PRESETS[preset](**(options or {}))
    except (TypeError, ValueError) as error:
        raise ModelError(f"bad options ({error})", f"network {preset!r}", "expected what its class takes") from None


def weights_of(network: nn.Module) -> int:
    """Number of trained numbers."""
    return sum(p.numel() for p in network.parameters())
