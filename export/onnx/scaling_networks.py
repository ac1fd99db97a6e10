"""Networks of several sizes without trained weights, for benchmarks: their time is right, their light is not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from export.models import Network, make_network
from export.models.bcnn import PRESETS
from export.models.radiosity import Radiosity
from export.onnx.export import write_network

SURFELS = (128, 256, 512, 768)
WIDTHS = ("bcnn-8", "bcnn-16", "bcnn-32")
SCALE = 1 / 4  # of all widths


def write_scaling_networks(folder: Path) -> list[Path]:
    """Write ``surfels-N.onnx`` and ``width-N.onnx``; N is the number of surfels, or of the first layer's channels."""
    return [write_network(network.eval(), folder, (), {})[0] for network in _sized()]


def _sized() -> Iterator[Network]:
    for surfels in SURFELS:
        network: Network = Radiosity(surfels)
        network.contract = replace(network.contract, name=f"surfels-{surfels}")
        yield network
    for preset in WIDTHS:
        network = make_network(preset)
        network.contract = replace(network.contract, name=f"width-{PRESETS[preset].widths[0]}", scale=SCALE)
        yield network
