"""Half precision against single precision: the error in a network's light, and how many values overflow.

Half precision is emulated as on a GPU with single-precision accumulators: the result of every operation is rounded to
half, matrix products and sums once at their end, and lower bounds of divisors are raised to what half precision can
represent, as converters of ONNX files do. (onnxruntime's CPU provider has no half kernels for most operations and would
silently compute in single precision.) A second variant keeps geometry, that is disks and form factors, and sums of flux
in single precision and rounds light only.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_map

from app.evaluation.tables import markdown_table
from app.network.contract import ModelContract
from app.scene import Scene
from export.models import UNTRAINED, ember, radiosity
from export.models.disks import form_factors
from export.models.network import outputs_of
from export.onnx.sample_inputs import Arrays, change_light, rendered_inputs, sample_inputs

SIZE = (512, 384)  # of the rendered frames
MAX_RELATIVE_ERROR = 0.05  # beyond it a value counts as wrong
LIGHT_FACTORS = (1e-6, 1e-3, 1e3)  # of inputs that are not divided by their mean
MIN_BOUND = 1e-7  # of a clamp; the smallest half is 6e-8
CLAMPS = (torch.ops.aten.clamp.default, torch.ops.aten.clamp_min.default)
HALF, LIGHT_ONLY = "half", "half, geometry single"
HEAD = ("inputs", "variant", "mean error", "p99 error", "values beyond 5 %", "overflows", "not finite")


@dataclass(frozen=True)
class Row:
    """One network on one input.

    Attributes
    ----------
    overflows : int
        Intermediate values that are finite in single precision and overflow in half precision.
    not_finite : float
        Share of output values.
    mean, p99 : float or None
        Mean and 99th percentile of |half − single| relative to the mean of single precision, over values that are
        finite in both and above 0 in single precision; None if there are none.
    wrong : float or None
        Share of these values whose own relative error exceeds ``MAX_RELATIVE_ERROR``.
    """

    network: str
    inputs: str
    variant: str
    overflows: int
    not_finite: float
    mean: float | None = None
    p99: float | None = None
    wrong: float | None = None


class Rounding(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """While ``active``, rounds the result of every operation to half precision and counts overflows."""

    def __init__(self, active: bool) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.active, self.overflows = active, 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if self.active and func in CLAMPS and args[1]:
            args = (args[0], max(args[1], MIN_BOUND), *args[2:])
        result = func(*args, **(kwargs or {}))
        return tree_map(self.round, result) if self.active else result

    def round(self, x: Any) -> Any:
        """``x`` rounded to half precision, as float32; anything but float32 tensors is returned unchanged."""
        if not isinstance(x, Tensor) or x.dtype != torch.float32:
            return x
        rounded = x.half().float()
        self.overflows += int((rounded.isinf() & x.isfinite()).sum())
        return rounded

    @contextmanager
    def switch(self, active: bool) -> Iterator[None]:
        """Enable or disable rounding in a ``with`` block, or as a decorator while a function runs."""
        previous, self.active = self.active, active
        try:
            yield
        finally:
            self.active = previous


def table(names: Sequence[str], scenes: Mapping[str, Scene]) -> list[Row]:
    """Rows for every network, on rendered inputs for ``scenes`` and on extreme inputs."""
    return [measure(name, network, label, inputs, variant) for name in names for network in [UNTRAINED[name]().eval()]
            for label, inputs in _inputs(network.contract, scenes) for variant in (HALF, LIGHT_ONLY)]


def measure(name: str, network: nn.Module, label: str, inputs: Arrays, variant: str) -> Row:
    """Run ``network`` once in single precision and once as ``variant``."""
    tensors = [torch.from_numpy(x) for x in inputs.values()]
    mode = Rounding(active=variant == HALF)
    with torch.no_grad():
        reference = outputs_of(network(*tensors))[0].numpy()
        with _geometry_in_single(network, mode) if variant == LIGHT_ONLY else nullcontext(), mode:
            rounded = (mode.round(x) if mode.active else x for x in tensors)
            output = outputs_of(network(*rounded))[0].numpy()
    finite = np.isfinite(output)
    compared = finite & (reference > 0)
    light, errors = reference[compared], {}
    if light.size:
        error, mean = np.abs(output[compared] - light), light.mean(dtype=np.float64)
        errors = {"mean": float(error.mean(dtype=np.float64) / mean), "p99": float(np.percentile(error, 99) / mean),
                  "wrong": float(np.mean(error > MAX_RELATIVE_ERROR * light))}
    return Row(name, label, variant, mode.overflows, float(np.mean(~finite)), **errors)


def as_markdown(rows: Sequence[Row]) -> str:
    """A table for each network."""
    parts = []
    for network, group in groupby(rows, lambda row: row.network):
        cells = [[row.inputs, row.variant, *map(_percent, (row.mean, row.p99, row.wrong)), str(row.overflows),
                  _percent(row.not_finite)] for row in group]
        parts += [f"`{network}`", markdown_table(HEAD, cells)]
    return "\n\n".join(parts)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.3g} %"


def _inputs(contract: ModelContract, scenes: Mapping[str, Scene]) -> Iterator[tuple[str, Arrays]]:
    """Rendered inputs, then the first of them without exposure under weak and strong light, and synthetic inputs."""
    yield from rendered_inputs(contract, scenes, SIZE)
    label, inputs = next(rendered_inputs(replace(contract, exposure="none"), scenes, SIZE))
    for factor in LIGHT_FACTORS:
        yield f"{label}, light × {factor:g}", change_light(contract, inputs, partial(np.multiply, np.float32(factor)))
    samples = dict(sample_inputs(contract))  # the largest of each label
    yield from ((f"synthetic, {label}", x) for label, x in samples.items())


@contextmanager
def _geometry_in_single(network: Any, mode: Rounding) -> Iterator[None]:
    """Round only light that is transported between surfels or disks, and from disks to pixels.

    Form factors are computed in single precision and rounded once. Sums of flux and the weights of ember's attention,
    which interpolate light at pixels, stay in single precision.
    """
    light, geometry = mode.switch(active=True), mode.switch(active=False)
    if isinstance(network, ember.Ember):
        with patch.multiple(ember, neumann_series=light(ember.neumann_series), bounce=light(ember.bounce)):
            yield
    else:
        exact = geometry(form_factors)
        with (patch.multiple(radiosity, form_factors=lambda *args: mode.round(exact(*args)),
                             _flux=geometry(radiosity._flux), _receive=light(radiosity._receive)),
              patch.object(network, "outgoing", light(network.outgoing))):
            yield
