"""Final gathering: light at points from a few rays each, and the light that they meet.

Reichert 1992, "A Two-Pass Radiosity Method Driven by Lights and Viewer Position".
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np

from app.arrays import F32, F64, Ints
from app.math3d import LUMINANCE, R2, put_rows
from app.raycast.caster import Caster, Hits
from app.surfels.random_walks import sample_cosine_hemisphere

SPREAD_BITS = 20            # of the points that sequences start at: blocks of up to 2^10 by 2^10 texels
LEAST_COSINE = 0.1          # of rays in gradients, so that none outweighs all others
SHUFFLE = 0x9E3779B97F4A7C15  # multiplied by an index, its middle bits are as good as random


@dataclass(frozen=True, eq=False)
class GatheredRays:
    """What K rays from each of N points find.

    Attributes
    ----------
    light : ndarray, float32, shape (N, K, 3)
        W/(sr m²); its mean over the rays is indirect radiance / albedo.
    distance : ndarray, float32, shape (N, K)
        Of the rays' ends, relative to how far they reach, and at most 1.
    direction : ndarray, float32, shape (N, K, 3)
        Of the rays.
    """

    light: F32
    distance: F32
    direction: F32


@dataclass(frozen=True, eq=False)
class LightAt:
    """Irradiance / π at points with normals, all float32 of shape (M, 3) and in the caster's local space."""

    direct: Callable[[F32, F32], F32]
    indirect: Callable[[F32, F32], F32]


def gather(caster: Caster, light_at: LightAt, reach: float, origin: F32, normal: F32, numbers: F64) -> GatheredRays:
    """Trace cosine-distributed rays and find the light that they meet.

    A ray that ends at a surface gets its albedo times the light there, and the light that the surface emits, without
    emitters that are analytic lights. One that ends nowhere gets none, since an environment is direct light. Where a
    ray ends within ``reach``, light that is interpolated over such a distance would show, and another ray finds the
    indirect light (Christensen 1999, "Faster Photon Map Global Illumination").

    Parameters
    ----------
    reach : float
        Scene units; ``GatheredRays.distance`` is relative to it.
    origin, normal : ndarray, float32, shape (N, 3)
        Where the rays start, in the caster's local space, and the normals there.
    numbers : ndarray, shape (N, K, 2)
        In [0, 1).
    """
    count, rays = numbers.shape[:2]
    directions = sample_cosine_hemisphere(normal, numbers).reshape(-1, 3)
    hits = caster.cast(np.repeat(origin, rays, axis=0), directions)
    distance = np.minimum(hits.distance / np.float32(reach), 1)
    met = np.flatnonzero(hits.body >= 0)
    ends = hits.select(met)
    near = np.flatnonzero(distance[met] < 1)
    unused_digits = numbers.reshape(-1, 1, 2).take(met[near], axis=0) * 2**SPREAD_BITS % 1
    further = _cast_further(caster, ends.select(near), unused_digits)
    met_further = np.flatnonzero(further.body >= 0)
    last_ends = further.select(met_further)
    at = np.concatenate([ends.position, last_ends.position])
    facing = np.concatenate([ends.normal, last_ends.normal])
    has_surfels = np.delete(np.arange(len(at)), near)
    irradiance = light_at.direct(at, facing)
    indirect = light_at.indirect(at.take(has_surfels, axis=0), facing.take(has_surfels, axis=0))
    _add_rows(irradiance, has_surfels, indirect)
    from_further = further.traced_emission
    _add_rows(from_further, met_further, last_ends.albedo * irradiance[len(met):])
    _add_rows(irradiance, near, from_further)
    light = hits.traced_emission
    _add_rows(light, met, ends.albedo * irradiance[:len(met)])
    shape = count, rays, 3
    return GatheredRays(light.reshape(shape), distance.reshape(shape[:2]), directions.reshape(shape))


def rotation_gradient(rays: GatheredRays, normal: F32) -> F32:
    """How luminance changes as a surface tilts: the mean over its rays of luminance times the tangent of their angle.

    Ward and Heckbert 1992, "Irradiance Gradients", section 3.1.

    Parameters
    ----------
    normal : ndarray, float32, shape (N, 3)

    Returns
    -------
    ndarray, float32, shape (N, 4)
        Mean over the rays: the gradient by the part of the tilted unit normal along the surface, and luminance.
    """
    luminance = rays.light @ LUMINANCE.astype(np.float32)
    cosine = np.einsum("nkc,nc->nk", rays.direction, normal)
    weight = luminance / np.maximum(cosine, LEAST_COSINE)
    total = np.empty((len(normal), 4), np.float32)
    along_normal = np.einsum("nk,nk->n", weight, cosine)[:, None] * normal
    total[:, :3] = np.einsum("nk,nkc->nc", weight, rays.direction) - along_normal
    total[:, 3] = np.einsum("nk->n", luminance)
    return total / np.float32(luminance.shape[1])


def _add_rows(target: F32, rows: Ints, values: F32) -> None:
    put_rows(target, rows, target.take(rows, axis=0) + values)


def _cast_further(caster: Caster, starts: Hits, numbers: F64) -> Hits:
    """What one ray from each of N surfaces meets, for numbers of shape (N, 1, 2)."""
    directions = sample_cosine_hemisphere(starts.normal, numbers).reshape(-1, 3)
    return caster.cast(starts.position + caster.ray_epsilon * starts.normal, directions)


def sequence(grid: tuple[int, int], texel: Ints, first: int, count: int, phase: float) -> F64:
    """Numbers ``first`` to ``first + count`` of the sequence of each of N texels of a grid, shape (N, count, 2).

    Roberts' R2 sequence, whose start differs among texels so that those of any 2×2, 4×4 … together are spread evenly.

    Parameters
    ----------
    grid : tuple of int
        Width and height.
    texel : ndarray of int, shape (N,)
        Row by row.
    phase : float
        Shifts all sequences.
    """
    start = spread_evenly(*grid).take(texel, axis=0) + np.random.default_rng(int(phase * 2**16)).random(2)
    numbers: F64 = (start[:, None] + np.arange(first, first + count)[:, None] * np.array(R2)) % 1.0
    return numbers


@lru_cache(maxsize=4)
def spread_evenly(width: int, height: int) -> F64:
    """A point of the unit square for each texel, shape (h · w, 2): those of blocks of 2^k × 2^k form (0, 2k, 2)-nets.

    Sobol's sequence along a Z-order curve whose quarters are shuffled (Ahmed and Wonka 2020, "Screen-Space Blue-Noise
    Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels"). Further digits are random.
    """
    y, x = (n.astype(np.uint64) for n in np.divmod(np.arange(width * height), width))
    orders = np.array(list(permutations(range(4))), np.uint64)
    index = np.ones_like(x)
    for bit in range(SPREAD_BITS // 2 - 1, -1, -1):
        shuffle = (index * np.uint64(SHUFFLE) >> np.uint64(32)) % np.uint64(len(orders))
        quarter = (x >> np.uint64(bit) & np.uint64(1)) + 2 * (y >> np.uint64(bit) & np.uint64(1))
        index = 4 * index + orders[shuffle, quarter]
    points = np.zeros((len(x), 2), np.uint64)
    directions = np.full(2, 1 << SPREAD_BITS - 1, np.uint64)  # of Sobol's first two dimensions
    for bit in range(SPREAD_BITS):
        points ^= np.where((index >> np.uint64(bit) & np.uint64(1) > 0)[:, None], directions, np.uint64(0))
        directions[0] >>= np.uint64(1)
        directions[1] ^= directions[1] >> np.uint64(1)
    return (points + np.random.default_rng(0).random(points.shape)) / 2.0**SPREAD_BITS
