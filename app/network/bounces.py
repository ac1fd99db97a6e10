"""Bounces asked for by number: networks that count them, and those that know one bounce, applied again.

With x₀ the light that surfaces send by direct light, ρ their albedo and f the network, what arrives by bounce k is

    y₁ = f(x₀),    yₖ₊₁ = f(xₖ) · min(1, Σ xₖ / Σ f(xₖ)),    xₖ = ρ yₖ,

sums over the picture, by colour; the result is y₁ + … + y_N. No bounce after the first brings more than was sent, so
that all together are on average at most 1 + ρ + … + ρᴺ⁻¹ times the first, whatever the network, ρ the largest albedo.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from app.errors import SettingsError
from app.network.channels import BOUNCES, CHANNELS, HALF_MAX, INDIRECT, SCREEN
from app.network.contract import TensorSpec

if TYPE_CHECKING:
    from app.network.session import F32, Network  # imports onnxruntime

ALBEDO = "bounces.albedo"  # the tensor that is packed besides the network's own
SENT = ("direct.rgb", "radiance.rgb")  # channels with the light that surfaces send


class Reapplied:
    """A network of one bounce, run once for each of ``bounces``.

    Attributes
    ----------
    contract : ModelContract
        The network's, which reads albedo besides.
    provider : str
        The network's.
    """

    def __init__(self, network: Network, bounces: int) -> None:
        self._network, self._bounces = network, bounces
        own = network.contract
        self.contract = replace(own, inputs={**own.inputs, ALBEDO: TensorSpec(("albedo.rgb",))})
        self.provider = network.provider
        self._sent = [(t, rows) for t, spec in own.inputs.items() for name, rows in spec.rows() if name in SENT]

    def run(self, tensors: Mapping[str, F32]) -> dict[str, F32]:
        """Infer one frame, as ``Network.run`` does."""
        own = {t: x for t, x in tensors.items() if t != ALBEDO}
        albedo = np.clip(np.nan_to_num(tensors[ALBEDO]), 0, 1)
        total = arrives = self._network.run(own)[INDIRECT]
        for _ in range(self._bounces - 1):
            sent = albedo * arrives
            arrives = self._network.run(self._lit(own, sent))[INDIRECT]
            arrives = arrives * _share(sent, arrives)
            total = total + arrives
        return {INDIRECT: np.minimum(total, np.float32(HALF_MAX))}

    def _lit(self, tensors: Mapping[str, F32], sent: F32) -> dict[str, F32]:
        """A copy of ``tensors`` in which surfaces send that."""
        lit = dict(tensors)
        for tensor, rows in self._sent:
            lit[tensor] = lit[tensor].copy()
            lit[tensor][rows] = sent
        return lit


def with_bounces(model: Network | Literal["ssgi"] | None, bounces: int) -> Network | Reapplied | Literal["ssgi"]:
    """What gives light of ``bounces`` bounces: the model itself where it counts them, or a network applied again.

    Raises
    ------
    SettingsError
        When the model can't be held to that number, or there is none.
    """
    if model is None:
        raise SettingsError("no model to follow them", "--bounces", "expected a --model for indirect light")
    if isinstance(model, str):
        if bounces > 1:
            raise _single_bounce(model)
        return model
    contract = model.contract
    read = {(name, spec.grid) for spec in contract.inputs.values() for name in spec.channels}
    if any(name == BOUNCES for name, _ in read):
        return model
    if contract.bounces == "multi":
        raise SettingsError(f"{contract.name} gives all bounces at once", "--bounces", "expected none, or a model that "
                            "counts bounces, such as ember or radiosity")
    light = {(name, grid) for name, grid in read if CHANNELS[name].radiance}
    if bounces > 1 and light not in [{(name, SCREEN)} for name in SENT]:
        raise _single_bounce(contract.name)
    return Reapplied(model, bounces) if bounces > 1 else model


def _single_bounce(name: str) -> SettingsError:
    """The error for a model of one bounce that can't be applied again."""
    return SettingsError(f"{name} follows one bounce", "--bounces",
                         "expected 1, or a model that counts bounces, such as ember or radiosity")


def _share(sent: F32, arrives: F32) -> F32:
    """By colour, shape (3, 1, 1): what may arrive of ``arrives`` so that it is no more than was sent."""
    given, taken = (np.sum(x, axis=(1, 2), keepdims=True, dtype=np.float64) for x in (sent, arrives))
    share = np.divide(given, taken, out=np.ones_like(taken), where=taken > given)
    return share.astype(np.float32)
