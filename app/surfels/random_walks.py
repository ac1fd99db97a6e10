"""Random walks over the surfaces that a view sees directly or by reflection, as in path tracing without a light.

A diffuse surface scatters light in all directions, so after a few bounces walks are spread evenly over all surfaces
that can exchange light with the eye, and never reach the insides of objects. Points spread over the meshes by area
would instead put most of a furnished room's surfels into closed cupboards and between double walls (3 to 5 dB worse
for the same number of surfels).
"""

from collections.abc import Sequence

import numpy as np

from app.arrays import F32, F64
from app.math3d import View, unit_rows
from app.raycast.caster import Caster, Hits, concatenate

BOUNCES = 7
MAX_ROUNDS = 4           # of walks, while they have too few hits
MIN_WALKS = 64           # of a round
MIN_WALKS_OF_VIEW = 8    # of several views that share them
BODY_SHARE = 1 / 16      # rays cast at each moving instance, relative to all hits; at most 1 for those of one body
SPHERE_SCALE = 1.1       # those rays start on the body's bounding sphere times this


def trace_walks(caster: Caster, views: Sequence[View], count: int, rng: np.random.Generator) -> Hits:
    """About ``count`` hits of walks from the views' eyes, and further ones on every moving body.

    Half of the walks start through the pictures, half in any direction.
    """
    rounds: list[Hits] = []
    for _ in range(MAX_ROUNDS):
        missing = count - sum(len(hits.body) for hits in rounds)
        if missing <= 0:
            break
        walks = max(missing // (BOUNCES + 1), MIN_WALKS)
        rounds += _trace_round(caster, views, max(walks // len(views), MIN_WALKS_OF_VIEW), rng)
    rounds += [_sample_body(caster, body, int(count * min(BODY_SHARE * len(caster.members[body]), 1.0)), rng)
               for body in range(1, len(caster.bodies))]
    return concatenate(rounds)


def sample_sphere(rng: np.random.Generator, count: int) -> F32:
    """Uniform random directions, shape (count, 3)."""
    return unit_rows(rng.normal(size=(count, 3))).astype(np.float32)


def sample_cosine_hemisphere(normal: F32, u: F64) -> F32:
    """Map random numbers to directions whose density is proportional to their cosine with the normal.

    Parameters
    ----------
    normal : ndarray, float32, shape (N, 3)
    u : ndarray, shape (N, K, 2)
        In [0, 1).

    Returns
    -------
    ndarray, float32, shape (N, K, 3)
    """
    x, y, z = normal.T.astype(np.float64)
    is_steep, none = np.abs(x) > 0.9, np.zeros_like(x)
    side = np.where(is_steep, (-z, none, x), (none, z, -y))  # across the normal and the y or the x axis
    tangent = side / np.maximum(np.sqrt((side * side).sum(axis=0)), 1e-30)
    bitangent = np.cross(normal.T, tangent, axis=0)
    radius, angle, rise = np.sqrt(u[..., 0]), 2 * np.pi * u[..., 1], np.sqrt(1 - u[..., 0])
    right, up = radius * np.cos(angle), radius * np.sin(angle)
    directions = np.empty((*u.shape[:2], 3), np.float32)
    for axis in range(3):  # by components, which is several times as fast
        directions[..., axis] = (right * tangent[axis, :, None] + up * bitangent[axis, :, None]
                                 + rise * normal[:, axis, None])
    return directions


def _trace_round(caster: Caster, views: Sequence[View], walks: int, rng: np.random.Generator) -> list[Hits]:
    """Hits of ``walks`` walks from each view, by bounce."""
    starts = [_start_walks(view, walks, rng) for view in views]
    origins = np.concatenate([(view.eye - caster.origin).astype(np.float32) + offsets
                              for view, (offsets, _) in zip(views, starts, strict=True)])
    directions = np.concatenate([directions for _, directions in starts])
    count = len(origins)
    bounces, alive = [], np.arange(count)
    for _ in range(BOUNCES + 1):
        hits = caster.cast(origins, directions)
        alive = alive[hits.body >= 0]
        bounces.append(hits := hits.select(hits.body >= 0))
        origins = hits.position + hits.normal * caster.ray_epsilon
        # Draw for all walks: otherwise a walk that ends would change the numbers, and so the paths, of the others.
        u = rng.random((count, 1, 2))[alive]
        directions = sample_cosine_hemisphere(hits.normal, u)[:, 0]
    return bounces


def _start_walks(view: View, walks: int, rng: np.random.Generator) -> tuple[F32, F32]:
    """Where walks start, relative to the eye, and their directions, both shape (walks, 3)."""
    offsets, through_image = view.rays(2 * rng.random((walks // 2, 2)) - 1)
    elsewhere = sample_sphere(rng, walks - len(through_image))
    return (np.concatenate([offsets, np.zeros_like(elsewhere)]).astype(np.float32),
            np.concatenate([through_image, elsewhere]).astype(np.float32))


def _sample_body(caster: Caster, body: int, count: int, rng: np.random.Generator) -> Hits:
    """Hits on one body of rays from a sphere around it."""
    center, radius, matrix = caster.bodies[body].center, caster.bodies[body].radius, caster.matrices[body]
    outside = center + SPHERE_SCALE * radius * sample_sphere(rng, count)
    inside = center + radius * (rng.random((count, 3)) - 0.5)
    origins, targets = (x @ matrix[:3, :3].T + matrix[:3, 3] for x in (outside, inside))
    hits = caster.cast(origins.astype(np.float32), (targets - origins).astype(np.float32), (body,))
    return hits.select(hits.body >= 0)
