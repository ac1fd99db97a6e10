"""Networks as torch modules, one file per family, and the presets of all families."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from torch import nn

from app.errors import ModelError
from export.models import bcnn, gfa, ndr, surround
from export.models.ember import Ember
from export.models.gather_cleaners import CLEANERS
from export.models.network import Network
from export.models.pix2pix import ConditionalPatchGan
from export.models.radiosity import Gather, Radiosity
from export.models.surround import Surround

__all__ = ["DISCRIMINATORS", "PRESETS", "UNTRAINED", "Network", "count_weights", "make_network"]

UNTRAINED: Mapping[str, type[Network]] = {"ember": Ember, "gather": Gather, "radiosity": Radiosity}
PRESETS: Mapping[str, Callable[..., Network]] = {
    **UNTRAINED,
    **CLEANERS,
    **{name: partial(bcnn.Bcnn, name) for name in bcnn.PRESETS},
    **{name: partial(gfa.Gfa, name) for name in gfa.PRESETS},
    **{name: partial(ndr.Ndr, name) for name in ndr.PRESETS},
    **{name: partial(Surround, name) for name in surround.PRESETS},
}
DISCRIMINATORS: Mapping[str, Callable[[], nn.Module]] = {"surround-discriminator": ConditionalPatchGan}


def make_network(preset: str, options: Mapping[str, Any] | None = None) -> Network:
    """A network with newly initialised weights.

    Raises
    ------
    ModelError
        When the preset is unknown, or its class does not take these options.
    """
    if preset not in PRESETS:
        raise ModelError(f"no preset {preset!r}", "network.preset", f"expected one of: {', '.join(PRESETS)}")
    try:
        return PRESETS[preset](**(options or {}))
    except (TypeError, ValueError) as error:
        raise ModelError(f"bad options ({error})", f"network {preset!r}", "expected the options in docs/training.md"
                         ) from None


def count_weights(network: nn.Module) -> int:
    """Number of trainable parameters."""
    return sum(p.numel() for p in network.parameters())
