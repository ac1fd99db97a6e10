"""The environment's light on surfels: its rays are traced once through the static body, then only where bodies move."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F32, Bools, Floats, Ints
from app.environment import SKY_DISTANCE, sky_light, sky_points
from app.math3d import R2, row_dots
from app.raycast.caster import STATIC, AttachedPoints, Caster
from app.scene import Environment
from app.sky_parts import PARTS, blur_parts, part_of
from app.surfels.ray_bundle import SHARE, may_meet_sphere

RAYS = 144         # of a surfel, spread over the environment's light; RAYS // SHARE on moving bodies
GUIDED_RAYS = 288  # more of a surfel that sees little of that light
OPEN = 0.5         # of the light that faces a surfel, from which on it sees much
CLUSTERS = 64      # of surfels that are guided together
NORMAL_WEIGHT = 0.1  # scene's longest edges for which a right angle counts there
TINY = 1e-30


@dataclass(frozen=True, eq=False)
class _Rays:
    """R rays from surfels towards the environment.

    Attributes
    ----------
    surfel, part : ndarray of int, shape (R,)
        Where each begins, and the part of the environment's light that it ends in.
    direction : ndarray, float32, shape (R, 3)
        World space, unit length.
    light : ndarray, float32, shape (R, 3)
        Irradiance / π that each stands for where nothing is in the way, W/(sr m²).
    """

    surfel: Ints
    part: Ints
    direction: F32
    light: F32

    def sum(self, count: int, share: F32 | None = None) -> F32:
        """Light of the rays, or ``share`` of it, shape (R, 3), on each of ``count`` surfels, shape (count, 3)."""
        light = self.light if share is None else self.light * share
        sums = [np.bincount(self.surfel, channel, count) for channel in light.T]
        return np.stack(sums, axis=1).astype(np.float32)

    def join(self, others: "_Rays") -> "_Rays":
        return _Rays(np.concatenate([self.surfel, others.surfel]), np.concatenate([self.part, others.part]),
                     np.concatenate([self.direction, others.direction]), np.concatenate([self.light, others.light]))


class SkyRays:
    """Shadow rays from N surfels to an environment.

    Each surfel has directions of its own. Those on the static body that see little of the light, as in a room with a
    window, trace more rays to where the first ones of surfels around have met it; both kinds of rays are weighted by
    the balance heuristic (Veach and Guibas 1995, "Optimally Combining Sampling Techniques for Monte Carlo Rendering").
    """

    def __init__(self, caster: Caster, surfels: AttachedPoints, environment: Environment) -> None:
        self._caster, self._surfels, self._environment = caster, surfels, environment
        is_static = surfels.anchors.body == STATIC
        self._count, self._moving = len(is_static), np.flatnonzero(~is_static)
        self._start = np.random.default_rng(0).random((self._count, 2), np.float32)
        self._static, self._past_static = self._trace_static(np.flatnonzero(is_static))

    def irradiance(self) -> F32:
        """Irradiance / π, shape (N, 3), for the bodies' current matrices, W/(sr m²)."""
        moving = self._corrected(self._rays(*self._points(self._moving, 0, RAYS // SHARE)))
        arriving = self._trace(moving, range(len(self._caster.bodies)))
        return self._static.sum(self._count, self._past_moving_bodies()) + moving.sum(self._count, arriving)

    def _trace_static(self, surfels: Ints) -> tuple[_Rays, F32]:
        """The rays of ``surfels``, which are on the static body, and the shares of their light that pass it, (R, 3)."""
        first = self._rays(*self._points(surfels, 0, RAYS))
        share = self._trace(first, [STATIC])
        if not len(surfels):
            return first, share
        light, visible = first.sum(self._count), first.sum(self._count, share)
        sees_little = visible.sum(axis=1) < OPEN * light.sum(axis=1)
        guide = _Guide(self._surfels.current(), first, share, self._caster.extent)
        guided = surfels[sees_little[surfels] & guide.is_known[surfels]]
        surfel, at = self._points(guided, RAYS, GUIDED_RAYS)
        more = self._rays(surfel, guide.warp(surfel, at))
        rays = first.join(more)
        is_guided = np.isin(rays.surfel, guided)
        density = RAYS + GUIDED_RAYS * guide.density(rays.surfel[is_guided], rays.part[is_guided])
        light = np.concatenate([self._corrected(first).light, more.light])
        light[is_guided] = rays.light[is_guided] / np.asarray(density, np.float32)[:, None]
        return replace(rays, light=light), np.concatenate([share, self._trace(more, [STATIC])])

    def _corrected(self, rays: _Rays) -> _Rays:
        """Rays whose light sums to the unshadowed light of their surfels, which is known exactly.

        For surfels that see much, since light with and without occlusion is alike there. Where no ray meets any light,
        all count alike.
        """
        exact = sky_light(self._environment, 1).unoccluded(self._surfels.current()[1]) / np.float32(math.pi)
        sampled, count = rays.sum(self._count), np.bincount(rays.surfel, minlength=self._count)[:, None]
        ratio = np.divide(exact, sampled, out=np.zeros_like(exact), where=sampled > TINY)
        each = np.where(sampled > TINY, 0, exact / np.maximum(count, 1))
        return replace(rays, light=np.asarray(rays.light * ratio.take(rays.surfel, axis=0)
                                              + each.take(rays.surfel, axis=0), np.float32))

    def _points(self, surfels: Ints, first: int, count: int) -> tuple[Ints, F32]:
        """Numbers ``first`` to ``first + count`` of each surfel's sequence, and whose each is."""
        steps = np.asarray(np.arange(first, first + count)[:, None] * np.array(R2) % 1.0, np.float32)
        at = self._start.take(surfels, axis=0)[:, None] + steps
        at -= at >= 1
        return np.repeat(surfels, count), at.reshape(-1, 2)

    def _rays(self, surfel: Ints, at: F32) -> _Rays:
        """Rays to points of the unit square that is spread over the light, if they leave the fronts of their surfels.

        Their light is over the density of evenly spread points.
        """
        direction, light = sky_points(self._environment, at)
        cosine = row_dots(self._surfels.current()[1].take(surfel, axis=0), direction)
        rows = np.flatnonzero(cosine > 0)
        return _Rays(surfel[rows], part_of(at.take(rows, axis=0)), direction.take(rows, axis=0),
                     light.take(rows, axis=0) * (cosine[rows, None] / np.float32(math.pi)))

    def _past_moving_bodies(self) -> F32:
        """The shares of light of the rays of surfels on the static body that pass all bodies, shape (R, 3)."""
        moving, share = range(STATIC + 1, len(self._caster.bodies)), self._past_static.copy()
        rows = np.flatnonzero(share.any(axis=1))
        origin = self._origins().take(self._static.surfel[rows], axis=0)
        direction, may_meet = self._static.direction.take(rows, axis=0), np.zeros(len(rows), bool)
        for index in moving:
            center, radius = self._caster.bounding_sphere(index)
            to = np.asarray(center, np.float32) - origin
            may_meet |= may_meet_sphere(to, row_dots(to, direction)[:, None], radius)[:, 0]
        share[rows[may_meet]] *= self._trace(self._static, moving, rows[may_meet])
        return share

    def _origins(self) -> F32:
        position, normal = self._surfels.current()
        return np.asarray(position + normal * self._caster.ray_epsilon, np.float32)

    def _trace(self, rays: _Rays, bodies: Sequence[int], rows: Ints | None = None) -> F32:
        """Shares of light that arrive along the rays, or those of ``rows``, past ``bodies``, tinted there, (R, 3)."""
        surfel, direction = ((rays.surfel, rays.direction) if rows is None
                             else (rays.surfel[rows], rays.direction.take(rows, axis=0)))
        return self._caster.transmitted(self._origins().take(surfel, axis=0),
                                        direction * np.float32(SKY_DISTANCE * self._caster.extent), True, bodies)


class _Guide:
    """Where rays of the surfels around each surfel have met the environment.

    Its own rays don't count: parts that they meet by chance would get more rays, and each of these less weight.

    Attributes
    ----------
    is_known : ndarray of bool, shape (N,)
        Whether any of the rays around have met it.
    """

    def __init__(self, surfels: tuple[F32, F32], rays: _Rays, share: F32, extent: float) -> None:
        position, normal = surfels
        place = np.concatenate([position, normal * np.float32(NORMAL_WEIGHT * extent)], axis=1)
        centers = place[:CLUSTERS]  # surfels are sorted so that the first ones are far apart
        cluster = (place @ centers.T - 0.5 * (centers**2).sum(axis=1)).argmax(axis=1)
        seen = (rays.light * share).sum(axis=1)
        own, around = (np.bincount(start * PARTS**2 + rays.part, seen, count * PARTS**2).reshape(count, -1)
                       for start, count in ((rays.surfel, len(place)), (cluster[rays.surfel], len(centers))))
        others = blur_parts(np.asarray(np.maximum(around[cluster] - own, 0), np.float32))
        total = others.sum(axis=1, keepdims=True)
        self.is_known: Bools = total[:, 0] > 0
        self._chance = others / np.maximum(total, TINY)

    def warp(self, surfel: Ints, at: F32) -> F32:
        """Move evenly spread points of the unit square to where the light around their surfels is."""
        sums = np.cumsum(self._chance, axis=1, dtype=np.float64)
        rows = sums + np.arange(len(sums))[:, None]
        part = np.searchsorted(rows.ravel(), surfel + at[:, 0], side="right") - surfel * PARTS**2
        part = np.clip(part, 0, PARTS**2 - 1)
        chance = np.maximum(self._chance[surfel, part], TINY)
        within = np.clip((at[:, 0] - sums[surfel, part]) / chance + 1, 0, 1)
        return np.asarray(np.stack([part % PARTS + within, part // PARTS + at[:, 1]], axis=1) / PARTS, np.float32)

    def density(self, surfel: Ints, part: Ints) -> Floats:
        """Of what ``warp`` gives, in a part."""
        return self._chance[surfel, part] * PARTS**2
