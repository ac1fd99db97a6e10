"""How far a network is from linear in light, measured on the ONNX graph without the renderer's exposure."""

from collections.abc import Callable, Mapping

import numpy as np
import onnxruntime as ort

from app.arrays import F32, Bools
from app.network.contract import KEY, ModelContract
from app.network.contract_json import contract_from_json
from app.network.static_cache import StaticCache
from export.onnx.sample_inputs import Arrays, change_light


def additivity(model: bytes, inputs: Arrays) -> float:
    """Max |f(L₁ + L₂) − f(L₁) − f(L₂)| / max f(L₁ + L₂).

    Parameters
    ----------
    model : bytes
        Contents of an ``.onnx`` file with a contract.
    inputs : dict of str to ndarray
        Geometry and the light L₁ + L₂. L₁ is the light in the left half of each tensor.
    """
    run, contract = _open(model)
    left = change_light(contract, inputs, lambda x: np.where(_left_half(x), x, np.float32(0)))
    right = change_light(contract, inputs, lambda x: np.where(_left_half(x), np.float32(0), x))
    whole, split = run(inputs), run(left) + run(right)
    return float(np.abs(whole - split).max() / max(float(whole.max()), 1e-12))


def exposure_error(model: bytes, factor: float, inputs: Arrays) -> float:
    """Max |f(αL) − αf(L)| / max αf(L) for α = ``factor``."""
    run, contract = _open(model)
    expected = factor * run(inputs)
    scaled = run(change_light(contract, inputs, lambda x: x * np.float32(factor)))
    return float(np.abs(scaled - expected).max() / max(float(expected.max()), 1e-12))


def _open(model: bytes) -> tuple[Callable[[Mapping[str, F32]], F32], ModelContract]:
    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    contract = contract_from_json(session.get_modelmeta().custom_metadata_map[KEY], "the network")
    names, cache = list(contract.outputs), StaticCache(session, contract.static_input).feeds({})

    def run(inputs: Mapping[str, F32]) -> F32:
        feeds = {t: x.astype(contract.dtype) for t, x in inputs.items()}
        return np.asarray(session.run(names, {**feeds, **cache})[0], np.float32)

    return run, contract


def _left_half(x: F32) -> Bools:
    """Mask of the left half of the last axis, broadcastable to ``x``."""
    return np.arange(x.shape[-1]) < x.shape[-1] // 2
