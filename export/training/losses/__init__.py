"""Losses, one file each, and their names."""

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


class Discriminator(Protocol):
    """A ``torch.nn.Module`` that is trained to tell a network's output from the target."""

    def generator_loss(self, inputs: LossInputs) -> Tensor:
        """The adversarial loss of the network."""

    def discriminator_loss(self, inputs: LossInputs) -> Tensor:
        """The loss of the discriminator itself."""


class Loss(Protocol):
    """Returns weighted terms by name; training minimizes their sum."""

    @property
    def uses_previous(self) -> bool:
        """Whether it reads ``LossInputs.warped``."""

    @property
    def uses_condition(self) -> bool:
        """Whether it reads ``LossInputs.condition``."""

    @property
    def discriminator(self) -> Any:
        """A module with the interface of ``Discriminator``, or None."""

    def __call__(self, inputs: LossInputs) -> dict[str, Tensor]: ...


LOSSES: Mapping[str, Callable[..., Loss]] = {
    "bcnn": BcnnLoss, "gfa": GfaLoss, "ndr": NdrLoss, "surround": SurroundLoss}


def make_loss(kind: str, options: Mapping[str, Any]) -> Loss:
    """The loss ``kind`` with its options.

    Raises
    ------
    SettingsError
        When the loss is unknown, or does not take these options.
    """
    if kind not in LOSSES:
        raise SettingsError(f"no loss {kind!r}", "loss.kind", f"expected one of: {', '.join(LOSSES)}")
    try:
        return LOSSES[kind](**options)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"bad options ({error})", f"loss {kind!r}", "expected the options in docs/training.md"
                            ) from None
