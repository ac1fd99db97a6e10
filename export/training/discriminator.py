"""Trains a loss's discriminator beside the network."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from lightning_fabric import Fabric

from export.training.losses.loss_inputs import LossInputs

BETAS = (0.5, 0.999)  # Adam's, of Radford et al. 2016, "Unsupervised Representation Learning with DCGANs"


class DiscriminatorTraining:
    """Steps of a discriminator, which learns nothing while the network does.

    Parameters
    ----------
    discriminator : torch.nn.Module
        An ``export.training.losses.discriminator.Discriminator``.
    state : dict
        What ``state`` gave in an earlier run; empty for a fresh start.
    """

    def __init__(self, discriminator: Any, rate: float, fabric: Fabric, state: dict[str, Any]) -> None:
        self._bare = discriminator
        if state:
            discriminator.load_state_dict(state["model"])
        self._critic, self._optimizer = fabric.setup(discriminator, torch.optim.Adam(discriminator.parameters(), rate, BETAS))
        if state:  # now that the weights are where the optimizer's numbers are to be
            self._optimizer.load_state_dict(state["optimizer"])
        self._critic.mark_forward_method("mistaken")
        self._fabric = fabric
        discriminator.requires_grad_(False)

    def learn(self, views: LossInputs) -> float:
        """One step on what the network made; returns the discriminator's own loss."""
        self._bare.requires_grad_(True)
        term = self._critic.mistaken(replace(views, output=views.output.detach()))
        self._fabric.backward(term)
        self._optimizer.step()
        self._optimizer.zero_grad(set_to_none=True)
        self._bare.requires_grad_(False)
        return float(term.detach())

    def train(self, training: bool) -> None:
        """Whether looking at pictures is part of learning; otherwise nothing of it stays."""
        self._bare.train(training)

    @property
    def state(self) -> dict[str, Any]:
        """Weights and optimizer."""
        return {"model": self._bare.state_dict(), "optimizer": self._optimizer.state_dict()}
