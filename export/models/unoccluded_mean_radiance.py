"""What lit places around the camera would send anywhere, by the inverse square law alone: no shadows, no angles."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from export.models.panorama import directions

BLOCKS = 8       # of texels, down the panorama; twice as many across: the places that send
GRAZING = 0.05   # least cosine under which a texel's surface counts as seen
SMALL = 1e-6     # of lengths², areas and fluxes that are divided by, in the network's units


def unoccluded_mean_radiance(light: Tensor, normal: Tensor, depth: Tensor, solid_angle: Tensor, position: Tensor) -> Tensor:
    """Mean radiance from all around at points, as if every lit place sent to all of its half space alike.

    A block of texels sends flux = ∑ radiance × area of those that are lit from the middle of that flux; what arrives,
    flux / (8 π (r² + area / π)), is finite at r = 0. The sky, which is far, sends alike to all points.

    Parameters
    ----------
    light, normal : Tensor, shape (B, 3, H, 2 H), single precision
        Panoramas of radiance and of the surface's normal in camera space.
    depth : Tensor, shape (B, 1, H, 2 H)
        Distance from the camera; 0 in the sky.
    solid_angle : Tensor, shape (H, 2 H)
        Of each texel, in sr.
    position : Tensor, shape (B, 3, h, w)
        In camera space, in units of ``depth``.

    Returns
    -------
    Tensor, shape (B, 3, h, w)
        In the unit of ``light``.
    """
    direction = torch.from_numpy(directions(depth.shape[2])).to(depth)[None]
    place = direction * depth
    cosine = (normal * direction).sum(1, keepdim=True).abs()
    area = solid_angle * depth.square() / cosine.clamp(min=GRAZING)
    flux = light * area
    weight = flux.sum(1, keepdim=True)
    flux, moment, weight, area = torch.split(
        _sums(torch.cat([flux, weight * place, weight, area * (weight > 0)], 1)), [3, 3, 1, 1], dim=1)
    middle = moment / weight.clamp(min=SMALL)
    points = position.flatten(2).transpose(1, 2)
    found = 1 / _softened(points, middle, area / math.pi + SMALL) @ (flux.transpose(1, 2) / (8 * math.pi))
    sky = (light * solid_angle * (depth <= 0)).sum((2, 3), keepdim=True) / (4 * math.pi)
    return found.transpose(1, 2).reshape(position.shape) + sky


def _softened(points: Tensor, middle: Tensor, least: Tensor) -> Tensor:
    """|p − m|² + ``least``, [B, K, M], of points [B, K, 3], middles [B, 3, M] and [B, 1, M].

    As one product of matrices, |p|² − 2 p·m + (|m|² + least), which takes half the time of summing squares.
    """
    left = torch.cat([-2 * points, points.square().sum(2, keepdim=True), torch.ones_like(points[..., :1])], 2)
    right = torch.cat([middle, torch.ones_like(least), middle.square().sum(1, keepdim=True) + least], 1)
    return torch.maximum(left @ right, least)


def _sums(x: Tensor) -> Tensor:
    """Of each block, [B, C, 2 BLOCKS²]."""
    edge = x.shape[2] // BLOCKS
    return functional.avg_pool2d(x, edge).flatten(2) * edge**2
