"""A network: tensors in, low-resolution light out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass, Resource, Tex
from app.network.channels import SEEN, SURFEL_INDIRECT

if TYPE_CHECKING:
    from app.exchange.selection import Exchanges
    from app.network.bounces import RepeatedNetwork
    from app.network.session import Network


def declare(name: str, network: Network | RepeatedNetwork, exchanges: Exchanges, tensors: dict[str, str],
            grid: tuple[int, int], targets: dict[str, str]) -> Pass:
    """The pass ``name``, which runs ``network`` through one of ``exchanges``.

    Parameters
    ----------
    tensors : dict of str to str
        The graph's buffer of each input tensor.
    targets : dict of str to str
        The texture for each output channel, or the buffer of light at surfels.
    """
    writes: dict[str, Resource] = {target: Tex("f2", 4, size=grid) for target in targets.values()}
    if SURFEL_INDIRECT in targets:
        assert network.contract.surfels is not None
        writes[targets[SURFEL_INDIRECT]] = Buf((3, network.contract.surfels[0]), on_host=True)
    return Pass(name, reads=tuple(tensors.values()), writes=writes,
                make=lambda device, bound: make(device, bound, network, exchanges, tensors, grid, targets))


def make(device: Device, bound: BoundPass, network: Network | RepeatedNetwork, exchanges: Exchanges,
         tensors: dict[str, str], grid: tuple[int, int], targets: dict[str, str]) -> Execute:
    exchange = exchanges.get(device, network, grid)
    drawn = [tensor for tensor, spec in network.contract.inputs.items() if spec.grid in SEEN]

    def execute(frame: FrameState, resources: Resources) -> None:
        exchange.run({tensor: resources.buffer(name) if tensor in drawn else resources.array(name)
                      for tensor, name in tensors.items()})
        for channel, target in targets.items():
            if target not in bound.writes:
                continue
            if channel == SURFEL_INDIRECT:
                resources.write_array(target, exchange.read(channel))
            else:
                exchange.draw(channel, resources, target)

    return execute
