"""A chosen number of bounces: networks that take it as an input, and single-bounce networks applied repeatedly.

With x₀ the radiance that surfaces send out due to direct light, ρ their albedo and f the network, the light that
arrives by bounce k is

    y₁ = f(x₀),    yₖ₊₁ = f(xₖ) · min(1, Σ xₖ / Σ f(xₖ)),    xₖ = ρ yₖ,

with sums over the image for each colour channel; the result is y₁ + … + y_N. No bounce after the first adds more light
than was sent out, so on average the result is at most 1 + ρ + … + ρᴺ⁻¹ times y₁ for any network, with ρ the largest
albedo.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from app.arrays import F32
from app.errors import SettingsError
from app.network.channels import BOUNCES, CHANNELS, HALF_MAX, INDIRECT, SCREEN
from app.network.contract import TensorSpec

if TYPE_CHECKING:
    from app.network.session import Network  # imports onnxruntime

ALBEDO = "bounces.albedo"  # name of the tensor that is packed in addition to the network's own
SENT = ("direct.rgb", "radiance.rgb")  # channels with the light that surfaces send out
_ADVICE = "or a model that takes a number of bounces, such as ember or radiosity"


class RepeatedNetwork:
    """A single-bounce network that is run once for each of ``bounces``.

    Attributes
    ----------
    contract : ModelContract
        The network's, with albedo as an additional input.
    provider : str
        The network's execution provider.
    """

    def __init__(self, network: Network, bounces: int) -> None:
        self._network, self._bounces = network, bounces
        inputs = network.contract.inputs
        self.contract = replace(network.contract, inputs={**inputs, ALBEDO: TensorSpec(("albedo.rgb",))})
        self.provider = network.provider
        self._sent = [(tensor, rows) for tensor, spec in inputs.items() for name, rows in spec.rows() if name in SENT]

    def run(self, tensors: Mapping[str, F32]) -> dict[str, F32]:
        """Infer one frame, as ``Network.run`` does."""
        inputs = {t: x for t, x in tensors.items() if t != ALBEDO}
        albedo = np.clip(np.nan_to_num(tensors[ALBEDO]), 0, 1)
        total = arriving = self._network.run(inputs)[INDIRECT]
        for _ in range(self._bounces - 1):
            sent = albedo * arriving
            arriving = self._network.run(self._with_sent(inputs, sent))[INDIRECT]
            arriving = arriving * _energy_limit(sent, arriving)
            total = total + arriving
        return {INDIRECT: np.minimum(total, np.float32(HALF_MAX))}

    def _with_sent(self, tensors: Mapping[str, F32], sent: F32) -> dict[str, F32]:
        """A copy of ``tensors`` with ``sent`` as the light that surfaces send out."""
        replaced = dict(tensors)
        for tensor, rows in self._sent:
            replaced[tensor] = replaced[tensor].copy()
            replaced[tensor][rows] = sent
        return replaced


def with_bounces(model: Network | Literal["ssgi"] | None,
                 bounces: int) -> Network | RepeatedNetwork | Literal["ssgi"]:
    """Make ``model`` compute light of ``bounces`` bounces, by applying it repeatedly if it has no input for them.

    Raises
    ------
    SettingsError
        When the model has no such input and can't be applied repeatedly, or there is no model.
    """
    if model is None:
        raise SettingsError("needs a network", "bounces", "expected a --model that computes indirect light")
    if isinstance(model, str):
        if bounces > 1:
            raise _single_bounce(model)
        return model
    contract = model.contract
    read = {(name, spec.grid) for spec in contract.inputs.values() for name in spec.channels}
    if any(name == BOUNCES for name, _ in read):
        return model
    if contract.bounces == "multi":
        raise SettingsError(f"{contract.name} always computes all bounces", "bounces", f"expected none, {_ADVICE}")
    light = {(name, grid) for name, grid in read if CHANNELS[name].radiance}
    if bounces > 1 and light not in [{(name, SCREEN)} for name in SENT]:
        raise _single_bounce(contract.name)
    return RepeatedNetwork(model, bounces) if bounces > 1 else model


def _single_bounce(name: str) -> SettingsError:
    """The error for a single-bounce model that can't be applied repeatedly."""
    return SettingsError(f"{name} computes a single bounce", "bounces", f"expected 1, {_ADVICE}")


def _energy_limit(sent: F32, arriving: F32) -> F32:
    """Factors, shape (3, 1, 1), with which no more light arrives in any colour channel than was sent out."""
    outgoing, incoming = (np.sum(x, axis=(1, 2), keepdims=True, dtype=np.float64) for x in (sent, arriving))
    limit = np.divide(outgoing, incoming, out=np.ones_like(incoming), where=incoming > outgoing)
    return limit.astype(np.float32)
