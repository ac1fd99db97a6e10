"""Indirect light without training: disks fitted to the views around the camera light every pixel by form factors.

``gather`` takes one bounce from them; ``radiosity`` first lets them light each other. Geometry is always float32, since
d² = |p|² + |q|² − 2 p·q cancels.
"""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from app.network.channels import CUBE, GLOBALS
from app.network.contract import ModelContract, TensorSpec
from export.models.disks import Disks, fit_disks, form_factors, select_largest, split_channels
from export.models.network import EXTENT, Network, geometric_tail, sanitize

FACE, FACE_CELL = 48, 8  # texels along the edge of a cube face, and of a cell on it
SCREEN_ROWS, SCREEN_COLUMNS, SCREEN_CELL = 48, 64, 4  # texels sampled from the screen grid, whatever its size
MAX_DISKS = 512  # by default
BLOCK = 256  # disks per block, so that a block's matrices stay in the cache
BOUNCES = 8
MAX_RATIO = 0.95  # of one bounce to the one before
OFFSET = 0.5  # of receivers towards the camera, in widths of a texel


def _contract(name: str, kind: str, channels: tuple[str, ...], **more: TensorSpec) -> ModelContract:
    return ModelContract(
        name=name, paper="geometry-term gather and radiosity over surfels, without training",
        inputs={"screen": TensorSpec(channels), "cube": TensorSpec((*channels, "on_screen"), CUBE, FACE), **more},
        outputs={"indirect": TensorSpec(("indirect.rgb",))},
        scale=1 / 16, exposure="mean-radiance", bounces=kind, scene_extent=EXTENT, cube_axes="world",
        trained_on="nothing", licence="MIT")


class DiskNetwork(Network):
    """Each pixel sums radiance × form factor over all disks, without visibility.

    The disks are fitted to the screen and to those parts of the cube that the screen does not show.

    Parameters
    ----------
    disks : int
        How many are kept, at most 816.
    """

    def __init__(self, disks: int = MAX_DISKS) -> None:
        super().__init__()
        self.disks = disks
        self._rows = {name.split(".")[0]: at for name, at in self.contract.inputs["screen"].rows()}

    def light(self, screen: Tensor, cube: Tensor, outgoing: Callable[[Disks], Tensor]) -> Tensor:
        """Light the points on the screen.

        Parameters
        ----------
        screen : Tensor, float32, shape (1, C, h, w)
            The receivers, which emit light too. View space, scaled to ``contract.scene_extent``.
        cube : Tensor, float32, shape (1, C + 1, 6, FACE, FACE)
        outgoing : callable
            Radiance [S, 3] of the disks.

        Returns
        -------
        Tensor, float32, shape (1, 3, h, w)
            Indirect radiance / albedo; 0 in the sky. At most the largest radiance of a disk.
        """
        screen = sanitize(screen, self.contract.inputs["screen"])
        cube = sanitize(cube, self.contract.inputs["cube"])
        points = split_channels(screen[0].flatten(1), self._rows)
        # Receivers are moved towards the camera; otherwise the gaps between disks would show along edges.
        position, normal = (points["position"] * (1 - OFFSET * points["solid_angle"].sqrt())).t(), points["normal"].t()
        disks = select_largest([fit_disks(self._screen_texels(screen), self._rows, SCREEN_CELL),
                                fit_disks(self._cube_texels(cube[0]), self._rows, FACE_CELL)], self.disks)
        # Relative to the centre of the disks, so that products of coordinates stay small.
        origin = (disks.position * disks.area).sum(0) / disks.area.sum().clamp(min=1e-12)
        disks = replace(disks, position=disks.position - origin)
        light = _receive(position - origin, normal, disks, outgoing(disks))
        light = light.t() * (points["solid_angle"] > 0)
        return light.reshape(1, 3, screen.shape[2], screen.shape[3])

    def _screen_texels(self, screen: Tensor) -> Tensor:
        """Sampled texels as an image [C, H, W], with the solid angle of the whole screen."""
        texels = functional.interpolate(screen, (SCREEN_ROWS, SCREEN_COLUMNS), mode="nearest")[0]
        omega = split_channels(texels, self._rows)["solid_angle"]
        scale = split_channels(screen[0], self._rows)["solid_angle"].sum() / omega.sum().clamp(min=1e-12)
        return torch.cat([texels[:-1], omega * scale])

    def _cube_texels(self, cube: Tensor) -> Tensor:
        """The faces above each other as an image [C, H, W]; texels that the screen shows have no solid angle."""
        texels = cube.flatten(1, 2)
        return torch.cat([texels[:-2], texels[-2:-1] * (1 - texels[-1:])])


class Gather(DiskNetwork):
    """One bounce: the disks emit their direct light."""

    contract = _contract("gather", "single", ("position.view.xyz", "normal.view.xyz", "radiance.rgb", "solid_angle"))

    def forward(self, screen: Tensor, cube: Tensor) -> Tensor:
        """See ``light``."""
        return self.light(screen, cube, lambda disks: self.outgoing(disks))

    def outgoing(self, disks: Disks) -> Tensor:
        """Radiance [S, 3] of the disks."""
        return disks.radiance


class Radiosity(DiskNetwork):
    """Any number of bounces: the disks light each other before the pixels gather.

    Eight bounces are computed; the tail is summed as the geometric series that they have become by then.
    """

    contract = _contract("radiosity", "multi", ("position.view.xyz", "normal.view.xyz", "albedo.rgb", "radiance.rgb",
                                                "solid_angle"), bounces=TensorSpec(("bounces",), GLOBALS))

    def forward(self, screen: Tensor, cube: Tensor, bounces: Tensor) -> Tensor:
        """See ``light``; ``bounces`` has the shape (1, 1)."""
        between = sanitize(bounces, self.contract.inputs["bounces"]) - 1  # the last bounce reaches the pixels
        return self.light(screen, cube, lambda disks: self.outgoing(disks, between))

    def outgoing(self, disks: Disks, between: Tensor) -> Tensor:
        """Radiance [S, 3] of the disks after ``between`` bounces among them."""
        factors = form_factors(disks.position, disks.normal, disks)
        # Energy can't grow: no disk receives more than the whole hemisphere, nor all of them more than was emitted.
        factors = factors / factors.sum(1, keepdim=True).clamp(min=1)
        light = bounce = disks.radiance
        for number in range(BOUNCES):
            sent = _flux(disks, bounce)
            received = factors @ bounce
            bounce = disks.albedo * received * (sent / _flux(disks, received)).clamp(max=1)
            light = light + bounce * (between > number).to(bounce)
            ratio = _flux(disks, bounce) / sent
        return light + geometric_tail(bounce, ratio.clamp(max=MAX_RATIO), between - BOUNCES)


def _flux(disks: Disks, light: Tensor) -> Tensor:
    """Area × radiance, summed over the disks, never 0; shape (3,)."""
    return (disks.area * light).sum(0).clamp(min=1e-12)


def _receive(p: Tensor, n: Tensor, disks: Disks, light: Tensor) -> Tensor:
    """Radiance / albedo [Q, 3] at points ``p`` with normals ``n``; their form factors sum to 1 at most."""
    light = torch.cat([light, torch.ones_like(light[:, :1])], 1)
    sums = torch.zeros_like(p[:, :1])
    for at in range(0, len(disks.area), BLOCK):
        rows = slice(at, at + BLOCK)
        sums = sums + form_factors(p, n, disks.select(rows)) @ light[rows]
    return sums[:, :3] / sums[:, 3:].clamp(min=1)
