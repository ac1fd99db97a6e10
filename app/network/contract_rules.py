"""Rules of a contract that its JSON schema can't express: relations between values, and the channel table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from app.errors import did_you_mean
from app.network.channels import (
    BOUNCES,
    CHANNELS,
    CUBE,
    ENVIRONMENT,
    GATHERED_CHANNELS,
    GLOBALS,
    INDIRECT,
    LIT,
    PANORAMA,
    RAYS,
    SCREEN,
    SURFEL_INDIRECT,
    SURFELS,
    UNSHADOWED_CHANNELS,
)

if TYPE_CHECKING:
    from app.network.contract import ModelContract, TensorSpec

MAX_HALF_INTEGER = 2048  # up to here half floats represent all whole numbers
MAX_FACE_SIZE, MAX_RAYS = 1024, 2**22  # so that a mistyped contract can't fill the memory

Problems = Iterator[tuple[str, str]]  # what is wrong, and what was expected


def find_problems(contract: ModelContract) -> Problems:
    """What is wrong with a contract that the schema allows. Take the first only: later rules rely on earlier ones."""
    tensors = {**contract.inputs, **contract.outputs}
    for tensor, spec in tensors.items():
        yield from _size_problems(tensor, spec, contract.dtype)
        yield from _channel_problems(tensor, spec, is_output=tensor in contract.outputs)
    yield from _sharing_problems([*tensors.values()])
    yield from _role_problems(contract)
    if contract.static_input not in (None, *contract.inputs):
        yield f"static_input {contract.static_input!r} is no input", f"expected one of: {', '.join(contract.inputs)}"
    if contract.cube_axes is None and any(spec.face for spec in tensors.values()):
        yield "no cube_axes", "expected 'world' or 'camera', since a tensor lies on a cube or panorama"


def _size_problems(tensor: str, spec: TensorSpec, dtype: str) -> Problems:
    has_size = spec.grid not in (SCREEN, GLOBALS)
    max_face = {CUBE: MAX_FACE_SIZE, PANORAMA: 2 * MAX_FACE_SIZE}.get(spec.grid, math.inf)
    if (spec.size is not None) != has_size or (spec.size or 0) > max_face:
        expected = f"a size of at most {max_face}" if spec.face is not None else "a size" if has_size else "no size"
        yield f"bad size {spec.size!r} of tensor {tensor!r}", f"expected {expected} on the grid {spec.grid}"
    if spec.grid == PANORAMA and (spec.size or 0) % 4:
        yield (f"panorama {tensor!r} is {spec.size} high",
               "expected a multiple of 4, since views are halved and quartered")
    if not (spec.rays and math.isqrt(spec.rays) ** 2 == spec.rays if spec.grid == RAYS else spec.rays is None):
        yield (f"bad number of rays {spec.rays!r} of tensor {tensor!r}",
               "expected a square number on the grid rays, and none on other grids")
    if (spec.size or 0) * (spec.rays or 0) > MAX_RAYS:
        yield f"tensor {tensor!r} has {spec.size} x {spec.rays} rays", f"expected at most {MAX_RAYS} in all"
    if spec.grid == RAYS and dtype == "float16" and (spec.size or 0) > MAX_HALF_INTEGER:
        yield (f"tensor {tensor!r} numbers {spec.size} surfels in half precision",
               f"expected at most {MAX_HALF_INTEGER}, which half floats can tell apart")


def _channel_problems(tensor: str, spec: TensorSpec, is_output: bool) -> Problems:
    """Channels that do not exist, there or at all, that can't be read, and that can't be written."""
    for name in spec.channels:
        if name not in CHANNELS:
            yield f"unknown channel {name!r} of tensor {tensor!r}", did_you_mean(name, CHANNELS)
        if spec.grid not in CHANNELS[name].grids:
            yield (f"channel {name!r} of tensor {tensor!r} does not exist on the grid {spec.grid}",
                   f"expected one of: {', '.join(CHANNELS[name].grids)}")
        if CHANNELS[name].output and not is_output:
            yield f"channel {name!r} of input {tensor!r} can't be read", "expected a channel that the renderer writes"
        if is_output and not CHANNELS[name].output:
            yield (f"channel {name!r} of output {tensor!r} can't be written",
                   f"expected one of: {', '.join(name for name, channel in CHANNELS.items() if channel.output)}")


def _sharing_problems(specs: list[TensorSpec]) -> Problems:
    """Sizes that differ between tensors."""
    for what, sizes in (("cube face sizes", {spec.face for spec in specs if spec.face}),
                        ("numbers of surfels", {spec.size for spec in specs if spec.grid in (SURFELS, RAYS)}),
                        ("numbers of rays", {spec.rays for spec in specs if spec.grid == RAYS})):
        if len(sizes) > 1:
            yield f"tensors have different {what} {sorted(filter(None, sizes))}", "expected the same in all tensors"


def _role_problems(contract: ModelContract) -> Problems:
    """A mixture of indirect light and environment shading in outputs or inputs."""
    written = {name for spec in contract.outputs.values() for name in spec.channels}
    if written & set(ENVIRONMENT) and written != set(ENVIRONMENT):
        yield f"outputs {', '.join(sorted(written))}", f"expected either indirect light or {' and '.join(ENVIRONMENT)}"
    if SURFEL_INDIRECT in written and (INDIRECT not in written or contract.surfels is None):
        yield f"outputs {', '.join(sorted(written))}", f"expected {INDIRECT} too, of a network that reads surfels"
    forbidden = (*LIT, BOUNCES, *GATHERED_CHANNELS) if contract.shades_environment else UNSHADOWED_CHANNELS
    role = "shades an environment" if contract.shades_environment else "computes indirect light"
    for tensor, spec in contract.inputs.items():
        for name in spec.channels:
            if name in forbidden:
                yield f"channel {name!r} of a network that {role}", f"expected no input among {', '.join(forbidden)}"
        if contract.gathers and spec.grid in (SURFELS, RAYS):
            yield (f"tensor {tensor!r} of a network that reads gathered light is on the grid {spec.grid}",
                   "expected none there: surfels and their light are those that rays end at")
        if contract.shades_environment and spec.grid not in (SCREEN, GLOBALS):
            yield (f"tensor {tensor!r} of a network that {role} is on the grid {spec.grid}",
                   f"expected {SCREEN} or {GLOBALS}")
