"""How far a network is from being linear in light: raw ONNX, without the renderer's exposure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from app.network.channels import CHANNELS
from app.network.contract import KEY, ModelContract
from app.network.static_cache import StaticCache
from export.onnx.export import Arrays, cases

F32 = NDArray[np.float32]
REAL = "room"  # the label of inputs that a network may meet


def additivity(model: bytes, inputs: Arrays | None = None) -> float:
    """Max |f(L₁ + L₂) − f(L₁) − f(L₂)| / max f(L₁ + L₂).

    Parameters
    ----------
    model : bytes
        An ``.onnx`` file with its contract.
    inputs : dict of str to ndarray, optional
        Geometry, and the light L₁ + L₂; a room seen from inside without any. L₁ is what of it lies left of the middle.
    """
    run, contract = _opened(model)
    inputs = inputs or _room(contract)
    left = _lit(contract, inputs, lambda x: np.where(_left(x), x, np.float32(0)))
    right = _lit(contract, inputs, lambda x: np.where(_left(x), np.float32(0), x))
    whole, split = run(inputs), run(left) + run(right)
    return float(np.abs(whole - split).max() / max(float(whole.max()), 1e-12))


def exposure_error(model: bytes, factor: float, inputs: Arrays | None = None) -> float:
    """Max |f(αL) − αf(L)| / max αf(L) for α = ``factor``."""
    run, contract = _opened(model)
    inputs = inputs or _room(contract)
    expected = factor * run(inputs)
    found = run(_lit(contract, inputs, lambda x: x * np.float32(factor)))
    return float(np.abs(found - expected).max() / max(float(expected.max()), 1e-12))


def _opened(model: bytes) -> tuple[Callable[[Mapping[str, F32]], F32], ModelContract]:
    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    contract = ModelContract.from_json(session.get_modelmeta().custom_metadata_map[KEY], "the network")
    names, cache = list(contract.outputs), StaticCache(session, contract.static_input).feeds({})

    def run(inputs: Mapping[str, F32]) -> F32:
        found = session.run(names, {**{t: x.astype(contract.dtype) for t, x in inputs.items()}, **cache})[0]
        return np.asarray(found, np.float32)

    return run, contract


def _room(contract: ModelContract) -> Arrays:
    return [inputs for label, inputs in cases(contract) if label == REAL][-1]


def _lit(contract: ModelContract, inputs: Arrays, change: Callable[[F32], F32]) -> Arrays:
    """A copy of ``inputs`` with all radiance changed."""
    changed = {t: x.copy() for t, x in inputs.items()}
    for t, spec in contract.inputs.items():
        for name, rows in spec.rows():
            if CHANNELS[name].radiance:
                changed[t][:, rows] = change(changed[t][:, rows])
    return changed


def _left(x: F32) -> NDArray[np.bool_]:
    """Which texels lie in the left half of their image, broadcastable to ``x``."""
    width = x.shape[-1]
    return np.arange(width) < width // 2
