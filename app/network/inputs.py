"""Prepares a network's inputs: finite, inside their ranges, masked where the sky is, and exposed."""

from collections.abc import Collection, Mapping

import numpy as np

from app.arrays import F32, Bools
from app.network.channels import CHANNELS, GLOBALS, PANORAMA
from app.network.contract import ModelContract, TensorSpec

MAX_RATIO_TO_MEAN = 32.0  # a texel counts for at most this many times the mean
MIN_MEAN_RADIANCE = 1e-20  # smallest divisor; outputs are multiplied by the mean itself, so black stays exactly black
_SURFACE_GUIDES = ("solid_angle", "normal.view.xyz", "normal.world.xyz", "depth", "position.view.xyz")


def prepare_inputs(contract: ModelContract, tensors: Mapping[str, F32], out: Mapping[str, F32],
                   prepared: Collection[str] = ()) -> float:
    """Turn what the renderer packed into what the network is fed.

    Parameters
    ----------
    tensors : mapping of str to ndarray, float32
        For each input tensor its ``TensorSpec.shape``; not modified.
    out : mapping of str to ndarray, float32
        Receives the results, in the same shapes.
    prepared : collection of str
        Input tensors without radiance whose results ``out`` holds already.

    Returns
    -------
    float
        The mean radiance that radiance was divided by, and that the output must be multiplied by; 1 if the contract's
        exposure is ``none``.
    """
    for t, spec in contract.inputs.items():
        if t not in prepared:
            clamp(tensors[t], *channel_bounds(spec), out=out[t])
    if contract.exposure == "none":
        return 1.0
    radiance, clamped, unclamped_sum, texels, surfaces = [], [], 0.0, 0, _surface_masks(contract, out)
    for t, spec in contract.inputs.items():
        surface = surfaces.get(spec.grid, np.ones(out[t].shape[1:], bool))
        for name, rows in spec.rows():
            if not CHANNELS[name].radiance:
                continue
            r = out[t][rows]
            radiance.append(r)
            if spec.grid == GLOBALS:  # coefficients, which are not light at any texel
                continue
            if CHANNELS[name].sky:
                texels += r.size
            else:
                np.multiply(r, surface, out=r)
                texels += int(np.count_nonzero(surface)) * len(r)
            if spec.grid == PANORAMA:
                unclamped_sum += float(r.sum(dtype=np.float64))
            else:
                clamped.append(r)
    mean = _robust_mean(clamped, unclamped_sum, texels) if radiance else 1.0
    max_radiance = CHANNELS["radiance.rgb"].range[1]
    for r in radiance:
        np.multiply(r, np.float32(1.0 / max(mean, MIN_MEAN_RADIANCE)), out=r)
        np.clip(r, -max_radiance, max_radiance, out=r)
    return mean


def channel_bounds(spec: TensorSpec) -> tuple[F32, F32, F32]:
    """Background, smallest and largest value of each tensor channel, broadcastable to the tensor."""
    columns = [[c.background, *c.range] for n in spec.channels for c in [CHANNELS[n]] for _ in range(c.components)]
    shape = (-1, *[1] * len(spec.extent((1, 1))))
    background, low, high = np.array(columns, np.float32).T
    return background.reshape(shape), low.reshape(shape), high.reshape(shape)


def clamp(values: F32, background: F32, low: F32, high: F32, out: F32 | None = None) -> F32:
    """Clamp to the channels' ranges; infinities become the ends of the range, NaN the background."""
    out = np.clip(values, low, high, out=out)
    invalid = np.isnan(out)  # clipping replaces infinities and keeps NaN
    if invalid.any():
        np.copyto(out, background, where=invalid)
    return out


def surface_guides(contract: ModelContract) -> dict[str, tuple[str, str]]:
    """For each grid a tensor and a channel of it that are 0 where no surface is visible, if there are any."""
    guides: dict[str, tuple[str, str]] = {}
    for tensor, spec in contract.inputs.items():
        for name in _SURFACE_GUIDES:
            if name in spec.channels:
                guides.setdefault(spec.grid, (tensor, name))
    return guides


def _surface_masks(contract: ModelContract, tensors: Mapping[str, F32]) -> dict[str, Bools]:
    """For each grid where a surface is visible, if some tensor shows it."""
    return {grid: (tensors[tensor][dict(contract.inputs[tensor].rows())[name]] != 0).any(axis=0)
            for grid, (tensor, name) in surface_guides(contract).items()}


def _robust_mean(radiance: list[F32], unclamped_sum: float, texels: int) -> float:
    """Mean of values clamped at 32 times their mean, so that one bright texel can't darken the rest; 0 without values.

    The clamp is not iterated: if light falls on less than a thirty-second of the texels, that would converge to 0.
    Light on panoramas is not clamped, since the only small lit area around the camera is no firefly; its sum is
    ``unclamped_sum``.
    """
    mean = (sum(float(r.sum()) for r in radiance) + unclamped_sum) / max(texels, 1)
    cap = np.float32(MAX_RATIO_TO_MEAN * mean)
    return (sum(float(np.minimum(r, cap).sum()) for r in radiance) + unclamped_sum) / max(texels, 1)
