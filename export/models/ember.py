"""Indirect light from world surfels: traced bounces between them, and attention that carries their light to pixels.

Exactly linear in light, by colour alike: all weights come from geometry. docs/network.md has the mathematics.
"""

from __future__ import annotations

import torch
from torch import Tensor

from app.network.channels import GLOBALS, RAYS, SURFELS
from app.network.contract import ModelContract, TensorSpec
from app.surfels.kernel import DISTANCE, PLANE, TURN
from export.models.finite import finite
from export.models.geometric_tail import rest
from export.models.network import Network

COUNT, K = 2048, 144
SHARE = 4  # of the rays, one in so many carries bounces between surfels; all carry the last one
BOUNCES = 4  # after the first; the rest is taken for a geometric series
MAX_RATIO = 0.95  # of one bounce to the one before
BLOCK = 256  # surfels at once, so that the weights stay in the cache
COARSE = 256  # surfels whose largest weight stands for that of all: they are spread farthest first
LOWEST, HIGHEST = -80.0, 60.0  # exponents whose sums times light single precision bears
UNUSED = 1e4  # taken from the exponent where there is no surfel


class Ember(Network):
    """Surfels light each other along traced rays, then every pixel by a normalised kernel of position and normal.

    Parameters
    ----------
    surfels, rays : int
        S, and K of each, a square number.

    Attributes
    ----------
    contract : ModelContract
        What it reads and writes; the exported file carries it.
    """

    contract: ModelContract

    def __init__(self, surfels: int = COUNT, rays: int = K) -> None:
        super().__init__()
        self.contract = ModelContract(
            name="ember", paper="world surfels with traced transport, interpolated by attention; docs/network.md",
            inputs={"screen": TensorSpec(("position.view.xyz", "normal.view.xyz")),
                    "surfels": TensorSpec(("position.view.xyz", "normal.view.xyz", "irradiance.rgb", "emissive_irradiance.rgb",
                                           "surfel.radius", "surfel.weight"), SURFELS, surfels),
                    "rays": TensorSpec(("ray.surfel", "ray.albedo.rgb"), RAYS, surfels, rays),
                    "bounces": TensorSpec(("bounces",), GLOBALS)},
            outputs={"indirect": TensorSpec(("indirect.rgb",))},
            scale=1 / 16, exposure="mean-radiance", bounces="multi", scene_extent=40.0,
            trained_on="nothing", licence="MIT")

    def forward(self, screen: Tensor, surfels: Tensor, rays: Tensor, bounces: Tensor) -> Tensor:
        """Light the points on the screen.

        Parameters
        ----------
        screen : Tensor, float32, shape (1, 6, h, w)
        surfels : Tensor, float32, shape (1, 14, S)
        rays : Tensor, float32, shape (1, 4, S, K)
        bounces : Tensor, float32, shape (1, 1)

        Returns
        -------
        Tensor, float32, shape (1, 3, h, w)
            Indirect radiance / albedo; 0 in the sky.
        """
        specs = self.contract.inputs
        screen, surfels = finite(screen, specs["screen"]), finite(surfels, specs["surfels"])
        before = finite(bounces, specs["bounces"]) - 1  # the last one, which takes all rays
        position, normal, irradiance, glow, radius, weight = surfels[0].t().tensor_split((3, 6, 9, 12, 13), dim=1)
        # What is no number ends in ``bounce``: these are so many that each step over them shows in the time of a frame.
        index, albedo = rays[0, 0].long().clamp(0, len(position) - 1), rays[0, 1:].clamp(0, 1).permute(1, 2, 0)
        few = index.shape[1] // SHARE
        indirect = neumann_series(irradiance, glow, index[:, :few], albedo[:, :few], before)
        indirect = glow + bounce(irradiance + indirect, index, albedo)
        pixel_position, pixel_normal = screen[0].flatten(1).t().tensor_split(2, dim=1)
        used = (weight > 0).to(weight)
        middle = (position * used).sum(dim=0) / used.sum().clamp(min=1)  # squares of far coordinates would cancel
        pixel_position, position = pixel_position - middle, position - middle
        light = carry(indirect, pixel_position, pixel_normal, position, normal, radius, weight)
        light = light * (pixel_normal.square().sum(dim=1, keepdim=True) > 0).to(screen)
        return light.t().reshape(1, 3, *screen.shape[2:])


def neumann_series(irradiance: Tensor, glow: Tensor, index: Tensor, albedo: Tensor, bounces: Tensor) -> Tensor:
    """Indirect light of every surfel, shape (S, 3), by so many bounces.

    Each bounce takes the mean, over a surfel's rays, of albedo times the light of the surfel that the ray meets, so it
    never creates energy. After ``BOUNCES`` of them the rest is a geometric series, whose ratio at each surfel is that
    by which the light of a room that is lit evenly dies away there: a property of the room and not of its lights, so
    the sum stays linear in light. What surfels get straight from what glows counts as bounced once.

    Parameters
    ----------
    irradiance, glow : Tensor, shape (S, 3)
        As radiance of a white surface: direct light, and light of what glows.
    index : Tensor of int, shape (S, K)
        The surfel that a ray meets; any for none.
    albedo : Tensor, shape (S, K, 3)
        0 where a ray meets nothing.
    bounces : Tensor
        Any number, 0 for no light; broadcastable to (S, 3).
    """
    newest = glow + bounce(irradiance, index, albedo)
    twice = torch.cat([albedo, albedo], dim=2)  # broadcasting would take ten times as long
    total, even, ratio = newest * (bounces > 0).to(newest), torch.ones_like(newest), torch.zeros_like(newest)
    for number in range(1, BOUNCES + 1):
        newest, dimmer = bounce(torch.cat([newest, even], dim=1), index, twice).tensor_split(2, dim=1)
        total = total + newest * (bounces > number).to(newest)
        ratio = (dimmer / even.clamp(min=1e-6)).clamp(max=MAX_RATIO)
        even = dimmer
    return total + rest(newest, ratio, bounces - BOUNCES - 1)


def bounce(light: Tensor, index: Tensor, albedo: Tensor) -> Tensor:
    """Mean over each surfel's rays of albedo times the light [S, C] of what the ray meets; ``albedo`` is [S, K, C]."""
    mean = (light[index.flatten()].reshape(albedo.shape) * albedo).mean(dim=1)
    return mean.masked_fill(mean.isnan(), 0.0)


def carry(light: Tensor, pixel_position: Tensor, pixel_normal: Tensor, position: Tensor, normal: Tensor, radius: Tensor,
          weight: Tensor) -> Tensor:
    """Mean light of the surfels around points, shape (N, C): attention whose weights are geometry alone.

    The exponent is minus squared distance, turn of the normal and squared distance from the point's plane, in radii of
    the surfel (``app.surfels.kernel``), as one product of queries and keys.

    Parameters
    ----------
    light : Tensor, shape (S, C)
    pixel_position, pixel_normal : Tensor, shape (N, 3)
    position, normal : Tensor, shape (S, 3)
    radius, weight : Tensor, shape (S, 1)
    """
    scale = 1 / radius.clamp(min=1e-6).square()
    x, y, z = position.tensor_split(3, dim=1)
    a, b, c = pixel_normal.tensor_split(3, dim=1)
    off = (pixel_position * pixel_normal).sum(dim=1, keepdim=True)
    square = position.square().sum(dim=1, keepdim=True)
    own = pixel_position.square().sum(dim=1, keepdim=True)
    bias = weight.clamp(min=1e-6).log() - UNUSED * (weight <= 0).to(weight)
    keys = torch.cat([torch.cat([x * x, y * y, z * z, x * y, x * z, y * z, position, square, torch.ones_like(square)],
                                dim=1) * scale, normal, bias, torch.ones_like(bias)], dim=1).t()
    queries = torch.cat([
        -PLANE * torch.cat([a * a, b * b, c * c, 2 * a * b, 2 * a * c, 2 * b * c], dim=1),
        2 * PLANE * off * pixel_normal + 2 * DISTANCE * pixel_position, torch.full_like(own, -DISTANCE),
        -PLANE * off.square() - DISTANCE * own, TURN * pixel_normal, torch.ones_like(own)], dim=1)
    # A softmax, but the true maximum of the exponents would cost more than all the rest.
    level = (queries @ keys[:-1, :COARSE]).amax(dim=1, keepdim=True).clamp(-HIGHEST, 0.0)
    queries = torch.cat([queries, -level], dim=1)
    light = torch.cat([light, torch.ones_like(weight)], dim=1)
    sums = torch.zeros_like(light[:1])
    for block in range(0, len(light), BLOCK):
        exponent = queries @ keys[:, block:block + BLOCK]
        sums = sums + exponent.clamp(LOWEST, HIGHEST).exp() @ light[block:block + BLOCK]
    return sums[:, :-1] / sums[:, -1:]
