"""Panoramas, six views around the camera merged as in ``shaders/include/panorama.glsl``, and the light in them."""

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from app.arrays import F64
from app.math3d import cube_rotations

BLOCKS = 8         # senders along the panorama's height, each a block of texels; twice as many along its width
MIN_COSINE = 0.05  # between a texel's surface normal and the view direction
EPSILON = 1e-6     # lower bound of divisors: squared lengths, areas and fluxes in the network's units


def merge_cube(cube: NDArray[Any]) -> NDArray[Any]:
    """The panorama, shape (C, 2 n, 4 n), of a cube, shape (C, 6, n, n); top row first, n even."""
    n = cube.shape[-1]
    front, back, left, right, up, down = np.moveaxis(cube, 1, 0)
    level = np.concatenate([back[..., n // 2:], left, front, right, back[..., :n // 2]], axis=-1)
    # The GPU counts rows from the bottom, so the lower one of every two rows is sampled.
    caps = [np.repeat(view[:, 1::2], 4, axis=-1) for view in (up, down)]
    return np.concatenate([caps[0], level, caps[1]], axis=1)


def directions(height: int) -> F64:
    """Directions from the camera to texel centres, unit vectors in camera space, shape (3, height, 2 height)."""
    n = height // 2
    at = (2 * np.arange(n) + 1) / n - 1
    x, y = np.meshgrid(at, -at)
    view = np.stack([x, y, -np.ones_like(x)], -1) / np.sqrt(x**2 + y**2 + 1)[..., None]
    return merge_cube(np.stack([np.moveaxis(view @ rotation, -1, 0) for rotation in cube_rotations()], axis=1))


def solid_angles(height: int) -> F64:
    """Solid angle of each texel of a panorama in sr, shape (height, 2 height); the sum is 4 π."""
    n = height // 2
    at = (2 * np.arange(n) + 1) / n - 1  # in half edges of a view, at distance 1
    view = (1 + at[:, None]**2 + at**2)**-1.5
    panorama = merge_cube(np.broadcast_to(view, (1, 6, n, n)))[0]
    for cap in (panorama[:n // 2], panorama[n // 2 + n:]):
        cap *= 2 / 4  # a cap texel covers two rows and a quarter of a column of its view
    return panorama * (4 * np.pi / panorama.sum())


def project_to_panorama(position: Tensor) -> Tensor:
    """Panorama coordinates [B, h, w, 2] of points, for ``grid_sample``; ``position`` [B, 3, h, w] in camera space.

    The inverse of ``shaders/include/panorama.glsl``. It covers all directions, so any field of view is supported.
    """
    x, y, z = position.unbind(1)
    largest = position.abs().amax(1).clamp(min=1e-12)
    x, y, z = x / largest, y / largest, z / largest
    level = torch.maximum(x.abs(), z.abs()) >= y.abs()
    sideways, ahead, side = x.abs() > z.abs(), z < 0, x.sign()
    # In half edges of a view, from the centre of the front view; the panorama is 8 wide and 4 high.
    across = torch.where(sideways, side * (2 + z), torch.where(ahead, x, side * (4 - x.abs())))
    right = torch.where(level, across, 4 * x)
    down = torch.where(level, -y, torch.where(y > 0, -1.5 - z / 2, 1.5 + z / 2))
    return torch.stack([right / 4, down / 2], -1)


def unoccluded_mean_radiance(light: Tensor, normal: Tensor, depth: Tensor, solid_angle: Tensor,
                             position: Tensor) -> Tensor:
    """Mean incident radiance at points, as if all lit surfaces emitted evenly into their half spaces, without shadows.

    Each block of texels emits flux = ∑ radiance × area from the flux-weighted centre of its lit texels. The mean
    radiance that arrives, flux / (8 π (r² + area / π)), is finite at r = 0. The sky contributes equally to all points.

    Parameters
    ----------
    light, normal : Tensor, shape (B, 3, H, 2 H), single precision
        Panoramas of radiance and surface normals in camera space.
    depth : Tensor, shape (B, 1, H, 2 H)
        Distance from the camera; 0 in the sky.
    solid_angle : Tensor, shape (H, 2 H)
        Of each texel, in sr.
    position : Tensor, shape (B, 3, h, w)
        Points in camera space, in the unit of ``depth``.

    Returns
    -------
    Tensor, shape (B, 3, h, w)
        In the unit of ``light``.
    """
    direction = torch.from_numpy(directions(depth.shape[2])).to(depth)[None]
    surface = direction * depth
    cosine = (normal * direction).sum(1, keepdim=True).abs()
    area = solid_angle * depth.square() / cosine.clamp(min=MIN_COSINE)
    flux = light * area
    weight = flux.sum(1, keepdim=True)
    flux, moment, weight, area = torch.split(
        _block_sums(torch.cat([flux, weight * surface, weight, area * (weight > 0)], 1)), [3, 3, 1, 1], dim=1)
    center = moment / weight.clamp(min=EPSILON)
    points = position.flatten(2).transpose(1, 2)
    squared = _squared_distance(points, center, area / math.pi + EPSILON)
    radiance = 1 / squared @ (flux.transpose(1, 2) / (8 * math.pi))
    sky = (light * solid_angle * (depth <= 0)).sum((2, 3), keepdim=True) / (4 * math.pi)
    return radiance.transpose(1, 2).reshape(position.shape) + sky


def _squared_distance(points: Tensor, center: Tensor, offset: Tensor) -> Tensor:
    """|p − c|² + ``offset``, [B, K, M], for points [B, K, 3], centres [B, 3, M] and offsets [B, 1, M].

    One matrix product, |p|² − 2 p·c + (|c|² + offset), takes half the time of summing squares.
    """
    left = torch.cat([-2 * points, points.square().sum(2, keepdim=True), torch.ones_like(points[..., :1])], 2)
    right = torch.cat([center, torch.ones_like(offset), center.square().sum(1, keepdim=True) + offset], 1)
    return torch.maximum(left @ right, offset)


def _block_sums(x: Tensor) -> Tensor:
    """Sums over blocks, [B, C, 2 BLOCKS²], of ``x`` [B, C, H, 2 H]."""
    edge = x.shape[2] // BLOCKS
    return functional.avg_pool2d(x, edge).flatten(2) * edge**2
