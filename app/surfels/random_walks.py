"""Where light goes that is seen from somewhere: random walks over the surfaces, as in path tracing without a light.

A diffuse surface sends what it receives to all sides alike, so after a few bounces walks are spread evenly over all
surfaces that can exchange light with the eye, and never reach the insides of things. Points spread over the meshes by
area instead put most of a furnished room's into closed cupboards and between double walls (3 to 5 dB worse at equal
number).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.math3d import View
from app.raycast.caster import Caster, Hits, joined

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

BOUNCES = 7
ROUNDS = 4  # of walks, while too few have hit anything


def walk(caster: Caster, view: View, count: int, rng: np.random.Generator) -> Hits:
    """About ``count`` places that walks from the view's eye meet, and some on every moving body.

    Half of the walks begin in the picture, half in any direction.
    """
    found: list[Hits] = []
    for _ in range(ROUNDS):
        wanted = count - sum(len(h.body) for h in found)
        if wanted <= 0:
            break
        found += _round(caster, view, max(wanted // (BOUNCES + 1), 64), rng)
    found += [_around(caster, body, count // 16, rng) for body in range(1, len(caster.bodies))]
    return joined(found)


def _round(caster: Caster, view: View, walks: int, rng: np.random.Generator) -> list[Hits]:
    image = (2 * rng.random((walks // 2, 2)) - 1) * view.tan_half
    seen = np.concatenate([image, -np.ones((len(image), 1))], axis=1) @ view.rotation
    directions = np.concatenate([seen.astype(np.float32), sphere(rng, walks - len(seen))])
    origins = np.broadcast_to((view.eye - caster.origin).astype(np.float32), directions.shape)
    found, alive = [], np.arange(walks)
    for _ in range(BOUNCES + 1):
        hits = caster.cast(origins, directions)
        alive = alive[hits.body >= 0]
        found.append(hits := hits.rows(hits.body >= 0))
        origins = hits.position + hits.normal * caster.ray_epsilon
        # Numbers for all walks, or one that ends would give the others new ones: rounding would change everything.
        directions = hemisphere(hits.normal, rng.random((walks, 1, 2))[alive])[:, 0]
    return found


def _around(caster: Caster, body: int, count: int, rng: np.random.Generator) -> Hits:
    """Places on a body, seen from a ball around it."""
    ball = caster.bodies[body]
    matrix = caster.matrices[body]
    outside = ball.centre + 1.1 * ball.radius * sphere(rng, count)
    across = ball.centre + ball.radius * (rng.random((count, 3)) - 0.5)
    origins, targets = (x @ matrix[:3, :3].T + matrix[:3, 3] for x in (outside, across))
    hits = caster.cast(origins.astype(np.float32), (targets - origins).astype(np.float32), (body,))
    return hits.rows(hits.body >= 0)


def sphere(rng: np.random.Generator, count: int) -> F32:
    """Random directions, shape (count, 3)."""
    v = rng.normal(size=(count, 3))
    return (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-30)).astype(np.float32)


def hemisphere(normal: F32, u: F64) -> F32:
    """Directions around normals, as many per angle as their cosine.

    Parameters
    ----------
    normal : ndarray, float32, shape (N, 3)
    u : ndarray, shape (N, K, 2)
        In [0, 1).

    Returns
    -------
    ndarray, float32, shape (N, K, 3)
    """
    side = np.where(np.abs(normal[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    tangent = np.cross(normal, side)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    bitangent = np.cross(normal, tangent)
    radius, angle = np.sqrt(u[..., :1]), 2 * np.pi * u[..., 1:]
    return (radius * np.cos(angle) * tangent[:, None] + radius * np.sin(angle) * bitangent[:, None]
            + np.sqrt(1 - u[..., :1]) * normal[:, None]).astype(np.float32)
