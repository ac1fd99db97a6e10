"""What training minimises: one file per loss, and the names of all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from torch import Tensor

from app.errors import SettingsError
from export.training.losses.bcnn import BcnnLoss
from export.training.losses.gfa import GfaLoss
from export.training.losses.loss_inputs import LossInputs
from export.training.losses.ndr import NdrLoss
from export.training.losses.surround import SurroundLoss

__all__ = ["LOSSES", "Loss", "LossInputs", "make_loss"]


class Loss(Protocol):
    """Weighted terms by name; training minimises their sum."""

    @property
    def uses_previous(self) -> bool:
        """Whether it looks at ``LossInputs.warped``."""

    @property
    def uses_condition(self) -> bool:
        """Whether it looks at ``LossInputs.condition``."""

    @property
    def discriminator(self) -> Any:
        """What is trained along, against the network: a module that is an ``export.training.losses.discriminator.Discriminator``, or None."""

    def __call__(self, views: LossInputs) -> dict[str, Tensor]: ...


LOSSES: Mapping[str, Callable[..., Loss]] = {"bcnn": BcnnLoss, "gfa": GfaLoss, "ndr": NdrLoss,
                                            "surround": SurroundLoss}


def make_loss(kind: str, options: Mapping[str, Any]) -> Loss:
    """The loss of that name.

    Raises
    ------
    SettingsError
        When there is none, or it has no such options.
    """
    if kind not in LOSSES:
        raise SettingsError(f"no loss {kind!r}", "loss.kind", f"expected one of {', '.join(LOSSES)}")
    try:
        return LOSSES[kind](**options)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"bad options ({error})", f"loss {kind!r}", "expected its weights by name") from None
