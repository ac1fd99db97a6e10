"""Half against single precision: how far a network's light moves, and how many values overflow on the way.

Half precision is carried out as a GPU with single-precision accumulators does: every operation's result is rounded to
half, matrix products and sums once at their end, and floors of divisors are raised to what half can hold, as converters
of ONNX files do. (onnxruntime's CPU provider has no half kernels for most operations and would quietly compute in
single precision.) A second variant keeps geometry, that is surfels and form factors, and sums of flux in single
precision and rounds only what carries light.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_map

from app.errors import ModelError
from app.golden.scenes import outdoor, room
from app.load import embedded_scene
from app.network.channels import CHANNELS
from app.network.contract import ModelContract, find_model
from app.passes.pack_screen import tensor_names
from app.renderer import Renderer
from app.scene import Scene
from app.settings import Settings
from export.models import UNTRAINED, ember, radiosity
from export.onnx.export import Arrays, cases

SIZE = (512, 384)  # of the pictures that real inputs are taken from
FAR_OFF = 0.05     # relative error from which a texel counts as wrong
EXPOSURES = (1e-6, 1e-3, 1e3)  # of inputs that nobody divided by their mean
FLOOR = 1e-7       # least lower bound of a clamp; half's smallest number is 6e-8
CLAMPS = (torch.ops.aten.clamp.default, torch.ops.aten.clamp_min.default)
HALF, LIGHT_ONLY = "half", "half, geometry single"
COLUMNS = {"inputs": "inputs", "variant": "variant", "mean": "mean error", "p99": "p99 error",
           "wrong": "values beyond 5 %", "overflows": "overflows", "not_finite": "not finite"}
SHARES = ("mean", "p99", "wrong", "not_finite")


@dataclass(frozen=True)
class Row:
    """One network on one input.

    Attributes
    ----------
    mean, p99 : float or None
        Mean and 99th percentile of |half − single| where both are finite and single precision sees light, relative to
        the mean of single precision there; None where there is no such value.
    wrong : float or None
        Share of these values that are off by more than ``FAR_OFF`` of their own.
    overflows : int
        Values between input and output that single precision holds and half doesn't.
    not_finite : float
        Share of the output's values.
    """

    network: str
    inputs: str
    variant: str
    mean: float | None
    p99: float | None
    wrong: float | None
    overflows: int
    not_finite: float


class Rounding(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Rounds what every operation gives to half, while ``active``, and counts what became infinite by that."""

    def __init__(self, active: bool) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.active, self.overflows = active, 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if not self.active:
            return func(*args, **(kwargs or {}))
        if func in CLAMPS and args[1]:
            args = (args[0], max(args[1], FLOOR), *args[2:])
        return tree_map(self.round, func(*args, **(kwargs or {})))

    def round(self, x: Any) -> Any:
        """``x`` as half precision holds it, in single precision; what is no float32 tensor stays."""
        if not isinstance(x, Tensor) or x.dtype != torch.float32:
            return x
        rounded = x.half().float()
        self.overflows += int((rounded.isinf() & x.isfinite()).sum())
        return rounded

    def switched(self, function: Callable[..., Tensor], active: bool) -> Callable[..., Tensor]:
        """``function`` with rounding switched on or off inside."""
        def wrapped(*args: Any) -> Tensor:
            before, self.active = self.active, active
            try:
                return function(*args)
            finally:
                self.active = before
        return wrapped


def table(names: list[str], scenes: dict[str, Scene]) -> list[Row]:
    """Rows of every network on real inputs, those of ``scenes``, and on extreme ones."""
    rows = []
    for name in names:
        module = UNTRAINED[name]().eval()
        for label, inputs in (*real_inputs(name, scenes), *_extreme_inputs(name, module, scenes)):
            rows += [measure(name, module, label, inputs, variant) for variant in (HALF, LIGHT_ONLY)]
    return rows


def default_scenes() -> dict[str, Scene]:
    """The Cornell box and the generated scenes of the golden images."""
    return {"cornell-box": embedded_scene(), "room": room(), "outdoor": outdoor()}


def measure(name: str, module: nn.Module, label: str, inputs: Arrays, variant: str) -> Row:
    """Run once in single precision and once as ``variant`` says."""
    tensors = [torch.from_numpy(x) for x in inputs.values()]
    mode = Rounding(active=variant == HALF)
    with torch.no_grad():
        reference = module(*tensors).numpy()
        with _geometry_in_single(module, mode) if variant == LIGHT_ONLY else nullcontext(), mode:
            found = module(*(mode.round(x) if mode.active else x for x in tensors)).numpy()
    finite = np.isfinite(found)
    compared = finite & (reference > 0)
    off, light = np.abs(found - reference, where=compared, out=np.zeros_like(reference))[compared], reference[compared]
    known = light.size > 0
    return Row(name, label, variant,
               mean=float(off.mean(dtype=np.float64) / light.mean(dtype=np.float64)) if known else None,
               p99=float(np.percentile(off, 99) / light.mean(dtype=np.float64)) if known else None,
               wrong=float(np.mean(off > FAR_OFF * light)) if known else None,
               overflows=mode.overflows, not_finite=float(np.mean(~finite)))


def real_inputs(name: str, scenes: dict[str, Scene], exposed: bool = True) -> Iterator[tuple[str, Arrays]]:
    """What the renderer hands to network ``name``: radiance divided by its mean when ``exposed``."""
    contract = UNTRAINED[name]().contract
    for label, scene in scenes.items():
        settings = Settings(SIZE, outputs=("indirect",), taa=False, provider="cpu")
        with Renderer(scene, settings, find_model(name)) as renderer:
            renderer.advance(scene.cameras[scene.default_camera].at(0.0))
            tensors = {t: renderer.resource(name)[None].copy() for t, name in tensor_names(contract).items()}
        radiance = _radiance(contract, tensors)
        mean = sum(float(r.sum()) for r in radiance) / max(1, sum(int(np.count_nonzero(r)) for r in radiance))
        for r in radiance:
            r /= mean if exposed and mean > 0 else 1.0
        yield label, tensors


def as_markdown(rows: list[Row]) -> str:
    """A table for each network, a line for each row."""
    lines: list[str] = []
    for network in dict.fromkeys(row.network for row in rows):
        lines += ["", f"`{network}`", "", "| " + " | ".join(COLUMNS.values()) + " |", "|" + "---|" * len(COLUMNS)]
        for row in rows:
            if row.network == network:
                values = {**asdict(row), **{key: _percent(getattr(row, key)) for key in SHARES}}
                lines.append("| " + " | ".join(str(values[key]) for key in COLUMNS) + " |")
    return "\n".join(lines[1:])


def to_json(rows: list[Row]) -> str:
    return json.dumps([asdict(row) for row in rows], indent=1)


def _extreme_inputs(name: str, module: nn.Module, scenes: dict[str, Scene]) -> Iterator[tuple[str, Arrays]]:
    """A real input that nobody exposed, under weak and strong light, and what the exporter feeds in."""
    label, inputs = next(real_inputs(name, dict(list(scenes.items())[:1]), exposed=False))
    contract: ModelContract = module.contract  # type: ignore[assignment]
    for factor in EXPOSURES:
        scaled = {t: x.copy() for t, x in inputs.items()}
        for x in _radiance(contract, scaled):
            x *= np.float32(factor)
        yield f"{label}, light × {factor:g}", scaled
    made_up = dict(cases(contract))  # the largest of those of one name
    yield from ((f"made up, {label}", x) for label, x in made_up.items())


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.3g} %"


def _radiance(contract: ModelContract, tensors: Arrays) -> list[NDArray[np.float32]]:
    """LossInputs of the radiance channels."""
    return [tensors[t][:, rows] for t, spec in contract.inputs.items() for channel, rows in spec.rows()
            if CHANNELS[channel].radiance]


@contextmanager
def _geometry_in_single(module: nn.Module, mode: Rounding) -> Iterator[None]:
    """Rounding only where light is carried: between surfels, and from them to the pixels.

    Form factors are made in single precision and rounded once; sums of flux stay single. So do the weights of ember's
    attention, with which it carries light to the pixels.
    """
    if isinstance(module, ember.Ember):
        with (patch.object(ember, "neumann_series", mode.switched(ember.neumann_series, active=True)),
              patch.object(ember, "bounce", mode.switched(ember.bounce, active=True))):
            yield
        return
    if not isinstance(module, radiosity.Gather | radiosity.Radiosity):
        raise ModelError(f"{type(module).__name__} has no geometry to keep apart", "export precision",
                         "expected a network without weights")
    exact = mode.switched(radiosity._form_factors, active=False)
    with (patch.object(radiosity, "_form_factors", lambda *args: mode.round(exact(*args))),
          patch.object(radiosity, "_flux", mode.switched(radiosity._flux, active=False)),
          patch.object(radiosity, "_receive", mode.switched(radiosity._receive, active=True)),
          patch.object(module, "outgoing", mode.switched(module.outgoing, active=True))):
        yield
