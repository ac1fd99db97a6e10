"""Trains the discriminator of a loss alternately with the network."""

from dataclasses import replace
from typing import Any

import torch
from lightning_fabric import Fabric

from export.training.losses.loss_inputs import LossInputs

BETAS = (0.5, 0.999)  # of Adam; Radford et al. 2016, "Unsupervised Representation Learning with DCGANs"


class DiscriminatorTraining:
    """Optimizes a discriminator, whose weights are frozen while the network is trained.

    Parameters
    ----------
    discriminator : torch.nn.Module
        An ``export.training.losses.Discriminator``.
    state : dict
        The ``state`` of an earlier run; empty for a new one.
    """

    def __init__(self, discriminator: Any, rate: float, fabric: Fabric, state: dict[str, Any]) -> None:
        self._module = discriminator
        if state:
            discriminator.load_state_dict(state["model"])
        optimizer = torch.optim.Adam(discriminator.parameters(), rate, BETAS)
        self._wrapped, self._optimizer = fabric.setup(discriminator, optimizer)
        if state:  # after setup has moved the weights to the device
            self._optimizer.load_state_dict(state["optimizer"])
        self._wrapped.mark_forward_method("discriminator_loss")
        self._fabric = fabric
        discriminator.requires_grad_(False)

    def step(self, inputs: LossInputs) -> float:
        """Take one step on the network's output; returns the discriminator's own loss."""
        self._module.requires_grad_(True)
        loss = self._wrapped.discriminator_loss(replace(inputs, output=inputs.output.detach()))
        self._fabric.backward(loss)
        self._optimizer.step()
        self._optimizer.zero_grad(set_to_none=True)
        self._module.requires_grad_(False)
        return float(loss.detach())

    @property
    def state(self) -> dict[str, Any]:
        """State of weights and optimizer."""
        return {"model": self._module.state_dict(), "optimizer": self._optimizer.state_dict()}
