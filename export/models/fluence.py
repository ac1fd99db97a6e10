"""What lit places around the camera would send anywhere, by the inverse square law alone: no shadows, no angles."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from app.math3d import cube_rotations
from export.panorama import merged

BLOCKS = 8       # of texels, down the panorama; twice as many across: the places that send
GRAZING = 0.05   # least cosine under which a texel's surface counts as seen
SMALL = 1e-6     # of lengths², areas and fluxes that are divided by, in the network's units


def fluence(light: Tensor, normal: Tensor, depth: Tensor, solid_angle: Tensor, position: Tensor) -> Tensor:
    """Mean radiance from all around at points, as if every lit place sent to all of its half space alike.

    A block of texels sends flux = ∑ radiance × area from the middle of its flux; flux / (8 π (r² + area / π)) is finite
    at r = 0. The sky, which is far, sends alike to all points.

    Parameters
    ----------
    light, normal : Tensor, shape (B, 3, H, 2 H), single precision
        Panoramas of radiance and of the surface's normal in camera space.
    depth : Tensor, shape (B, 1, H, 2 H)
        Along the axis of the view that shows the texel; 0 in the sky.
    solid_angle : Tensor, shape (H, 2 H)
        Of each texel, in sr.
    position : Tensor, shape (B, 3, h, w)
        In camera space, in units of ``depth``.

    Returns
    -------
    Tensor, shape (B, 3, h, w)
        In the unit of ``light``.
    """
    place = torch.from_numpy(at_depth_1(depth.shape[2])).to(depth) * depth
    square = place.square().sum(1, keepdim=True)
    cosine = (normal * place).sum(1, keepdim=True).abs() * torch.rsqrt(square.clamp(min=SMALL))
    area = solid_angle * square / cosine.clamp(min=GRAZING)
    flux = light * area
    weight = flux.sum(1, keepdim=True)
    flux, moment, weight, area = torch.split(
        _sums(torch.cat([flux, weight * place, weight, area * (weight > 0)], 1)), [3, 3, 1, 1], dim=1)
    middle = moment / weight.clamp(min=SMALL)
    points = position.flatten(2).transpose(1, 2)
    apart = (points.square().sum(2, keepdim=True) + middle.square().sum(1, keepdim=True) - 2 * points @ middle)
    found = 1 / (apart.clamp(min=0) + area / math.pi + SMALL) @ (flux.transpose(1, 2) / (8 * math.pi))
    sky = (light * solid_angle * (depth <= 0)).sum((2, 3), keepdim=True) / (4 * math.pi)
    return found.transpose(1, 2).reshape(position.shape) + sky


def at_depth_1(height: int) -> NDArray[np.float32]:
    """Where the middles of a panorama's texels lie, in camera space, shape (1, 3, height, 2 height)."""
    n = height // 2
    at = (2 * np.arange(n) + 1) / n - 1
    x, y = np.meshgrid(at, -at)
    views = [np.stack([x, y, -np.ones_like(x)], -1) @ rotation for rotation in cube_rotations()]
    return merged(np.stack([np.moveaxis(view, -1, 0) for view in views], axis=1)).astype(np.float32)[None]


def _sums(x: Tensor) -> Tensor:
    """Of each block, [B, C, 2 BLOCKS²]."""
    edge = x.shape[2] // BLOCKS
    return functional.avg_pool2d(x, edge).flatten(2) * edge**2
