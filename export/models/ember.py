"""Ember, world-surfel radiosity: traced bounces between surfels, and attention that interpolates their light.

The network is exactly linear in light and treats all colours alike, since all weights come from geometry.
docs/ember.md has the mathematics.
"""

import torch
from torch import Tensor

from app.network.channels import GLOBALS, RAYS, SURFELS
from app.network.contract import ModelContract, TensorSpec
from app.surfels.kernel import CLIP_MARGIN, CLIP_WEIGHT, DISTANCE_WEIGHT, NORMAL_WEIGHT, PLANE_WEIGHT
from export.models.network import EXTENT, Network, geometric_tail, sanitize

SURFEL_COUNT, RAYS_PER_SURFEL = 2048, 144
RAY_SHARE = 4  # all bounces but the last use one in RAY_SHARE rays
BOUNCES = 4  # computed after the first one; the tail is a geometric series
MAX_RATIO = 0.95  # of one bounce to the one before
BLOCK = 256  # surfels at once, so that the weights stay in the cache
PIVOT_SURFELS = 256  # the softmax's maximum is estimated from these; farthest-point order spreads them over the scene
MIN_EXPONENT, MAX_EXPONENT = -80.0, 60.0  # sums of such exponentials times light fit single precision
UNUSED_PENALTY = 1e4  # subtracted from the exponent of unused surfels


class Ember(Network):
    """Surfels light each other along traced rays; a normalized kernel of position and normal interpolates to pixels.

    Parameters
    ----------
    surfels, rays : int
        S, and K for each surfel, a square number.
    """

    def __init__(self, surfels: int = SURFEL_COUNT, rays: int = RAYS_PER_SURFEL) -> None:
        super().__init__()
        self.contract = ModelContract(
            name="ember", paper="world surfels with traced transport, interpolated by attention; docs/ember.md",
            inputs={"screen": TensorSpec(("position.view.xyz", "normal.view.xyz")),
                    "surfels": TensorSpec(("position.view.xyz", "normal.view.xyz", "irradiance.rgb",
                                           "emissive_irradiance.rgb", "surfel.radius", "surfel.weight",
                                           "surfel.clip_plane.view.xyzw"),
                                          SURFELS, surfels),
                    "rays": TensorSpec(("ray.surfel", "ray.albedo.rgb"), RAYS, surfels, rays),
                    "bounces": TensorSpec(("bounces",), GLOBALS)},
            outputs={"indirect": TensorSpec(("indirect.rgb",)),
                     "surfel_indirect": TensorSpec(("surfel.indirect.rgb",), SURFELS, surfels)},
            scale=1 / 16, exposure="mean-radiance", bounces="multi", scene_extent=EXTENT,
            trained_on="nothing", licence="MIT")

    def forward(self, screen: Tensor, surfels: Tensor, rays: Tensor, bounces: Tensor) -> tuple[Tensor, Tensor]:
        """Light the surface points on the screen, and the surfels.

        Parameters
        ----------
        screen : Tensor, float32, shape (1, 6, h, w)
        surfels : Tensor, float32, shape (1, 18, S)
        rays : Tensor, float32, shape (1, 4, S, K)
        bounces : Tensor, float32, shape (1, 1)

        Returns
        -------
        screen : Tensor, float32, shape (1, 3, h, w)
            Indirect radiance / albedo; 0 in the sky.
        surfels : Tensor, float32, shape (1, 3, S)
            The same at the surfels.
        """
        specs = self.contract.inputs
        screen, surfels = sanitize(screen, specs["screen"]), sanitize(surfels, specs["surfels"])
        between = sanitize(bounces, specs["bounces"]) - 1  # the last bounce uses all rays
        # Not ``tensor_split``, of which the exporter makes loops over sequences.
        position, normal, irradiance, emissive, radius, weight, plane = torch.split(
            surfels[0].t(), [3, 3, 3, 3, 1, 1, 4], dim=1)
        # ``bounce`` replaces NaN in its result: there are so many rays that a pass over them shows in the frame time.
        index, albedo = rays[0, 0].long().clamp(0, len(position) - 1), rays[0, 1:].clamp(0, 1).permute(1, 2, 0)
        few = index.shape[1] // RAY_SHARE
        indirect = neumann_series(irradiance, emissive, index[:, :few], albedo[:, :few], between)
        indirect = emissive + bounce(irradiance + indirect, index, albedo)
        pixel_position, pixel_normal = torch.split(screen[0].flatten(1).t(), [3, 3], dim=1)
        used = (weight > 0).to(weight)
        center = (position * used).sum(dim=0) / used.sum().clamp(min=1)  # squares of large coordinates would cancel
        pixel_position, position = pixel_position - center, position - center
        plane = torch.cat([plane[:, :3], plane[:, 3:] + (plane[:, :3] * center).sum(dim=1, keepdim=True)], dim=1)
        light = interpolate(indirect, pixel_position, pixel_normal, position, normal, radius, weight, plane)
        light = light * (pixel_normal.square().sum(dim=1, keepdim=True) > 0).to(screen)
        return light.t().reshape(1, 3, *screen.shape[2:]), indirect.t().reshape(1, 3, len(position))


def neumann_series(irradiance: Tensor, emissive: Tensor, index: Tensor, albedo: Tensor, bounces: Tensor) -> Tensor:
    """Indirect light of every surfel after a number of bounces, shape (S, 3).

    Each bounce is the mean over a surfel's rays of albedo times the light of the surfel that the ray hits, so it never
    creates energy. After ``BOUNCES`` of them the tail is summed as a geometric series. Its ratio at each surfel is
    that of successive bounces of uniform light: it depends on geometry and albedo only, so the sum stays linear in
    light. Light that arrives directly from emissive surfaces counts as one bounce.

    Parameters
    ----------
    irradiance, emissive : Tensor, shape (S, 3)
        Direct light from lights and from emissive surfaces, as radiance of a white surface.
    index : Tensor of int, shape (S, K)
        The surfel that a ray hits; any value for rays that hit nothing.
    albedo : Tensor, shape (S, K, 3)
        0 for rays that hit nothing.
    bounces : Tensor
        Any number, 0 for no light; broadcastable to (S, 3).
    """
    colors = int(irradiance.shape[1])  # a constant of the graph
    last = emissive + bounce(irradiance, index, albedo)
    twice = torch.cat([albedo, albedo], dim=2)  # broadcasting would take ten times as long
    total, uniform, ratio = last * (bounces > 0).to(last), torch.ones_like(last), torch.zeros_like(last)
    for number in range(1, BOUNCES + 1):
        last, dimmer = torch.split(bounce(torch.cat([last, uniform], dim=1), index, twice), [colors, colors], dim=1)
        total = total + last * (bounces > number).to(last)
        ratio = (dimmer / uniform.clamp(min=1e-6)).clamp(max=MAX_RATIO)
        uniform = dimmer
    return total + geometric_tail(last, ratio, bounces - BOUNCES - 1)


def bounce(light: Tensor, index: Tensor, albedo: Tensor) -> Tensor:
    """Mean over each surfel's rays of albedo [S, K, C] times the light [S, C] of the surfel that the ray hits."""
    mean = (light[index.flatten()].reshape(albedo.shape) * albedo).mean(dim=1)
    return mean.masked_fill(mean.isnan(), 0.0)


def interpolate(light: Tensor, pixel_position: Tensor, pixel_normal: Tensor, position: Tensor, normal: Tensor,
                radius: Tensor, weight: Tensor, plane: Tensor) -> Tensor:
    """Weighted mean of the surfels' light at points, shape (N, C): attention with geometric weights.

    The exponent is minus the squared distance, 1 - cosine of the normals and squared distance from the point's plane,
    in radii of the surfel (``app.surfels.kernel``), written as one product of queries and keys; a second product is the
    distance beyond the surfel's clip plane.

    Parameters
    ----------
    light : Tensor, shape (S, C)
    pixel_position, pixel_normal : Tensor, shape (N, 3)
    position, normal : Tensor, shape (S, 3)
    radius, weight : Tensor, shape (S, 1)
    plane : Tensor, shape (S, 4)
    """
    reach = radius.clamp(min=1e-6)
    scale = 1 / reach.square()
    x, y, z = torch.split(position, [1, 1, 1], dim=1)
    a, b, c = torch.split(pixel_normal, [1, 1, 1], dim=1)
    offset = (pixel_position * pixel_normal).sum(dim=1, keepdim=True)
    square = position.square().sum(dim=1, keepdim=True)
    norm = pixel_position.square().sum(dim=1, keepdim=True)
    bias = weight.clamp(min=1e-6).log() - UNUSED_PENALTY * (weight <= 0).to(weight)
    keys = torch.cat([torch.cat([x * x, y * y, z * z, x * y, x * z, y * z, position, square, torch.ones_like(square)],
                                dim=1) * scale, normal, bias, torch.ones_like(bias)], dim=1).t()
    queries = torch.cat([
        -PLANE_WEIGHT * torch.cat([a * a, b * b, c * c, 2 * a * b, 2 * a * c, 2 * b * c], dim=1),
        2 * PLANE_WEIGHT * offset * pixel_normal + 2 * DISTANCE_WEIGHT * pixel_position,
        torch.full_like(norm, -DISTANCE_WEIGHT),
        -PLANE_WEIGHT * offset.square() - DISTANCE_WEIGHT * norm,
        NORMAL_WEIGHT * pixel_normal, torch.ones_like(norm)], dim=1)
    # A softmax with an estimated maximum: the true maximum of the exponents would cost more than everything else.
    pivot = (queries @ keys[:-1, :PIVOT_SURFELS]).amax(dim=1, keepdim=True).clamp(-MAX_EXPONENT, 0.0)
    queries = torch.cat([queries, -pivot], dim=1)
    light = torch.cat([light, torch.ones_like(weight)], dim=1)
    clip = CLIP_WEIGHT * torch.cat([-plane[:, :3] / reach, CLIP_MARGIN - plane[:, 3:] / reach], dim=1).t()
    points = torch.cat([pixel_position, torch.ones_like(norm)], dim=1)
    sums = torch.zeros_like(light[:1])
    for block in range(0, len(light), BLOCK):
        rows = slice(block, block + BLOCK)
        exponent = queries @ keys[:, rows] + (points @ clip[:, rows]).clamp(max=0.0)
        sums = sums + exponent.clamp(MIN_EXPONENT, MAX_EXPONENT).exp() @ light[rows]
    return sums[:, :-1] / sums[:, -1:]
