"""The model contract: everything that the renderer must know about a network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from app.errors import ModelError
from app.io.checked_json import check
from app.network.channels import (
    CHANNELS,
    CUBE,
    DIFFUSE,
    GATHERED_CHANNELS,
    GLOBALS,
    PANORAMA,
    RAYS,
    SCREEN,
    SURFEL_INDIRECT,
    SURFELS,
)
from app.network.contract_rules import find_problems

KEY = "afterglow"  # of the metadata entry that holds the contract
VERSION = 2
SCHEMA = "contract.schema.json"
MIN_SCREEN_SIDE, MAX_RAISED_SCALE = 48, 0.5


@dataclass(frozen=True)
class TensorSpec:
    """One input or output tensor of a network.

    Attributes
    ----------
    channels : tuple of str
        Names from the channel table, in tensor order.
    grid : str
        ``screen`` [1, C, h, w] or ``cube`` [1, C, 6, n, n] (front, back, left, right, up, down), top row first;
        ``panorama`` [1, C, h, 2h], a cube of faces h / 2 merged as in ``shaders/include/panorama.glsl``;
        ``surfels`` [1, C, S], points on the scene's surfaces, or ``rays`` [1, C, S, K], which start there;
        ``globals`` [1, C], numbers for the whole frame.
    size : int or None
        Texels along the edge of a cube face, height of a panorama, or number of surfels; None for screen and globals.
    rays : int or None
        Rays per surfel: a square number, the same in all tensors on rays.
    """

    channels: tuple[str, ...]
    grid: str = SCREEN
    size: int | None = None
    rays: int | None = None

    @property
    def face(self) -> int | None:
        """Texels along the edge of the faces of the cube that the tensor is made from; None if it is made from none."""
        return {CUBE: self.size, PANORAMA: (self.size or 0) // 2}.get(self.grid)

    @property
    def components(self) -> int:
        """Number of tensor channels, C."""
        return sum(CHANNELS[name].components for name in self.channels)

    @property
    def has_radiance(self) -> bool:
        """Whether some channel holds radiance, which is divided by the exposure."""
        return any(CHANNELS[name].radiance for name in self.channels)

    def extent(self, screen: tuple[Any, ...]) -> tuple[Any, ...]:
        """The tensor's shape without batch and channels, where ``screen`` stands for [h, w]."""
        size = self.size or 0
        return {SCREEN: screen, CUBE: (6, size, size), PANORAMA: (size, 2 * size), SURFELS: (size,),
                RAYS: (size, self.rays or 0), GLOBALS: ()}[self.grid]

    def shape(self, screen: tuple[int, int]) -> tuple[int, ...]:
        """The tensor's shape without the batch, for a screen grid of the given width and height."""
        return self.components, *self.extent((screen[1], screen[0]))

    def rows(self) -> Iterator[tuple[str, slice]]:
        """Each channel name with the tensor channels that it occupies."""
        start = 0
        for name in self.channels:
            stop = start + CHANNELS[name].components
            yield name, slice(start, stop)
            start = stop


@dataclass(frozen=True)
class ModelContract:
    """What a network reads, writes and expects; valid by construction.

    Attributes
    ----------
    inputs, outputs : mapping of str to TensorSpec
        By the tensor's name in the ONNX graph.
    scale : float
        Size of the screen grid relative to the output image, in (0, 1]; see ``screen_size`` for small images.
    exposure : str
        ``mean-radiance``: radiance is divided, and the output multiplied, by one scalar per frame. ``none``.
    bounces : str
        ``single`` or ``multi``: whether the output is light of one bounce or of all.
    scene_extent : float
        Length of the longest edge of the scene's bounding box in the network's units.
    multiple_of : int
        The screen grid is padded to multiples of this, and the output cropped.
    dtype : str
        ``float32`` or ``float16``, of every tensor.
    cube_axes : str or None
        Axes of the cube's faces, ``world`` or ``camera``; needed when an input lies on a cube or panorama.
    static_input : str or None
        Input tensor; what the graph computes from it alone is cached as long as it stays the same
        (``app.network.static_cache``).

    Raises
    ------
    ModelError
        When a value is not allowed by ``app/data/contract.schema.json`` or contradicts another one.
    """

    name: str
    inputs: Mapping[str, TensorSpec]
    outputs: Mapping[str, TensorSpec]
    scale: float
    exposure: str
    bounces: str
    scene_extent: float
    multiple_of: int = 1
    dtype: str = "float32"
    cube_axes: str | None = None
    static_input: str | None = None
    paper: str = ""
    trained_on: str = ""
    licence: str = ""
    version: int = VERSION

    def __post_init__(self) -> None:
        where = f"contract of {self.name!r}"
        check(self.to_dict(), where, schema=SCHEMA, error=ModelError)
        for what, expected in find_problems(self):
            raise ModelError(what, where, expected)

    @property
    def shades_environment(self) -> bool:
        """Whether the network computes the direct light of an environment; otherwise it computes indirect light."""
        return any(DIFFUSE in spec.channels for spec in self.outputs.values())

    @property
    def lights_surfels(self) -> bool:
        """Whether the network computes the indirect light of surfels, besides that of the screen."""
        return any(SURFEL_INDIRECT in spec.channels for spec in self.outputs.values())

    @property
    def gathers(self) -> bool:
        """Whether the network reads light that is gathered along rays."""
        return any(name in GATHERED_CHANNELS for spec in self.inputs.values() for name in spec.channels)

    @property
    def face(self) -> int | None:
        """Texels along the edge of the faces of the cube around the camera; None if no input needs it."""
        return next((spec.face for spec in self.inputs.values() if spec.face), None)

    @property
    def surfels(self) -> tuple[int, int] | None:
        """Number of surfels, and of rays per surfel (1 if no input has any); None if the network reads no surfels."""
        sizes = [spec.size for spec in self.inputs.values() if spec.grid in (SURFELS, RAYS)]
        rays = [spec.rays for spec in self.inputs.values() if spec.grid == RAYS]
        return (sizes[0] or 0, (rays[0] if rays else 1) or 1) if sizes else None

    def screen_size(self, output: tuple[int, int]) -> tuple[int, int]:
        """Width and height of the screen grid for an output image of the given width and height.

        Small images get more than ``scale`` of their size, up to half, so that the shorter side keeps 48 texels.
        """
        scale = max(self.scale, min(MAX_RAISED_SCALE, MIN_SCREEN_SIDE / min(output)))
        width, height = (max(1, math.ceil(n * scale)) for n in output)
        return width, height

    def padded_shapes(self, specs: Mapping[str, TensorSpec], screen: tuple[int, int]) -> dict[str, tuple[int, ...]]:
        """The shapes of the graph's tensors: with the batch, and with a ``screen`` grid that is padded to multiples."""
        width, height = (-(-n // self.multiple_of) * self.multiple_of for n in screen)
        return {tensor: (1, *spec.shape((width, height))) for tensor, spec in specs.items()}

    def with_scale(self, scale: float | None) -> ModelContract:
        """The contract with another scale, or itself for None."""
        return self if scale is None else replace(self, scale=scale)

    def to_dict(self) -> dict[str, Any]:
        """The contract as JSON-compatible values, without those that are None."""
        value = {k: v for k, v in asdict(self).items() if v is not None}
        for group in ("inputs", "outputs"):
            value[group] = {tensor: {k: [*v] if k == "channels" else v for k, v in spec.items() if v is not None}
                            for tensor, spec in value[group].items()}
        return value
