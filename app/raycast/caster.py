"""Rays through a scene at one time.

All static instances form one body with an Embree scene, each rigid one with a motion of its own forms another, and all
that an animation moves or deforms a last one, which is built anew when it changes. Points can be attached to bodies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64, Bools, Ints
from app.math3d import (
    affine_inverse,
    normal_matrix,
    put_rows,
    row_dots,
    row_lengths,
    spread_points,
    translation,
    unit_rows,
)
from app.raycast.body import MAX_PASSED, Body, Lobes, hash_uv
from app.raycast.prefiltered_textures import PrefilteredTextures
from app.scene import Instance, Scene

if TYPE_CHECKING:
    from app.gl.shadow_rays import ShaderRays

STATIC = 0            # index of the body of all instances that never move
RAY_EPSILON = 1e-4    # offset of ray origins from their surface, relative to the scene's longest edge


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays end, in local space (world axes, the scene's centre as origin, scene units).

    Attributes
    ----------
    position, normal : ndarray, float32, shape (N, 3)
        The shading normal has unit length and lies on the side of the ray's origin.
    albedo, emission : ndarray, float32, shape (N, 3)
        Tinted by what the ray has passed, unless it came from ``cast_through``.
    distance : ndarray, float32, shape (N,)
        In lengths of the ray's direction; infinite for the sky.
    body : ndarray of int, shape (N,)
        Index into ``Caster.bodies``; -1 for the sky.
    is_light_proxy : ndarray of bool, shape (N,)
        Whether the surface is the mesh of an analytic light.
    triangle : ndarray of int, shape (N,)
        Index into the body's triangles; -1 for the sky.
    uv : ndarray, float32, shape (N, 2)
        Barycentric coordinates of the triangle's second and third corner.
    """

    position: F32
    normal: F32
    albedo: F32
    emission: F32
    distance: F32
    body: Ints
    is_light_proxy: Bools
    triangle: Ints
    uv: F32

    @property
    def traced_emission(self) -> F32:
        """Emission that rays have to find, shape (N, 3): 0 on light proxies, whose emission is an analytic light."""
        return self.emission_of(light_proxies=False)

    def emission_of(self, light_proxies: bool) -> F32:
        """Emission of light proxies, or of all other surfaces, shape (N, 3): 0 on the rest."""
        emission = self.emission.copy()
        emission[np.flatnonzero(self.is_light_proxy != light_proxies)] = 0
        return emission

    @property
    def anchors(self) -> Anchors:
        """Where on the bodies the hits are."""
        return Anchors(self.body, self.triangle, self.uv)

    def select(self, rows: Bools | Ints) -> Hits:
        """The hits at indices, or at a mask."""
        indices = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        return Hits(*(values.take(indices, axis=0) for values in vars(self).values()))

    def put(self, rows: Ints, hits: Hits) -> None:
        """Replace the hits at indices."""
        for target, values in zip(vars(self).values(), vars(hits).values(), strict=True):
            if target.ndim == 1:
                target[rows] = values
            else:
                put_rows(target, rows, values)


@dataclass(frozen=True, eq=False)
class SeenHits:
    """What is seen along N rays: where they end, and some of what they pass; M hits in all.

    Attributes
    ----------
    hits : Hits
        First the ends of the rays, in order.
    ray : ndarray of int, shape (M,)
        The ray that each is on.
    share : ndarray, float32, shape (M, 3)
        Of the radiance of each, what arrives at the ray's origin.
    covering : ndarray, float32, shape (M, 1)
        Share of light that does not pass each, of which its albedo is a share.
    """

    hits: Hits
    ray: Ints
    share: F32
    covering: F32


@dataclass(frozen=True, eq=False)
class _Passed:
    """Surfaces that light passes in part: hits, the ray that each is on, and the shares that pass, shape (M, 3)."""

    hits: Hits
    ray: Ints
    passing: F32


def concatenate(parts: Sequence[Hits]) -> Hits:
    """The hits of all parts, in order."""
    return Hits(*(np.concatenate(values) for values in zip(*(vars(p).values() for p in parts), strict=True)))


class Caster:
    """Casts rays at ``scene`` as it is at the time of the last ``move_to``, 0 at first.

    Attributes
    ----------
    origin : ndarray, float64, shape (3,)
        Local space's origin in world space.
    bodies : list of Body
        The static body, one for each instance with a motion, and one for all animated instances if there are any.
    matrices : list of ndarray, float64, shape (4, 4)
        From each body's space to local space.
    members : list of list of int
        The scene's instances in each body.
    animated : int or None
        Index of the body of all animated instances, which is in local space.
    revision : int
        Changes whenever a body moves or deforms.
    extent : float
        Longest edge of the scene, scene units.
    textures : PrefilteredTextures
        What rays see of textures.
    shader_rays : ShaderRays or None
        Rays through the same scene for shaders, where these trace what is drawn (app/raycast/gpu_rays.py).
    """

    def __init__(self, scene: Scene) -> None:
        self.shader_rays: ShaderRays | None = None
        self.origin = scene.bounds.mean(axis=0)
        self.extent = scene.longest_edge
        self.ray_epsilon = np.float32(RAY_EPSILON * scene.longest_edge)
        to_local, textures = translation(-self.origin), PrefilteredTextures()
        self._scene, self.textures = scene, textures
        moving = [k for k, i in enumerate(scene.instances) if i.moves]
        animated = [k for k in moving if scene.instances[k].is_animated]
        self.members: list[list[int]] = [[k for k, i in enumerate(scene.instances) if not i.moves],
                                         *([k] for k in moving if k not in animated)]
        static = Body(scene, [(scene.instances[k], to_local @ scene.instances[k].transform)
                              for k in self.members[STATIC]], textures)
        self.bodies = [static, *(Body(scene, [(scene.instances[k], np.eye(4))], textures)
                                 for k, in self.members[1:])]
        self._rigid = [scene.instances[k] for k, in self.members[1:]]
        self.animated: int | None = None
        if animated:
            self.animated = len(self.bodies)
            self.members.append(animated)
            self.bodies.append(self._pose_body(0.0))
        self._pose = self._pose_at(0.0)
        self.matrices: list[F64] = []
        self.revision = 0
        self.move_to(0.0)

    def move_to(self, time: float) -> None:
        """Move the bodies to where they are at ``time`` seconds."""
        to_local = translation(-self.origin)
        matrices = [np.eye(4), *(to_local @ i.transform_at(time) for i in self._rigid)]
        matrices += [np.eye(4)] * (self.animated is not None)
        if not np.array_equal(matrices, self.matrices):
            self.matrices = matrices
            self.revision += 1
        if self.animated is None:
            return
        pose, previous = self._pose_at(time), self._pose
        if not all(map(np.array_equal, pose, previous)):
            self._pose = pose
            self.bodies[self.animated] = self._pose_body(time)
            self.revision += 1

    def instance_of(self, hits: Hits) -> Ints:
        """The scene's instance that each hit is on, shape (N,); -1 for the sky."""
        instance = np.full(len(hits.body), -1, np.int64)
        for index, (body, members) in enumerate(zip(self.bodies, self.members, strict=True)):
            rows = hits.body == index
            if rows.any():
                instance[rows] = np.asarray(members)[body.part[hits.triangle[rows]]]
        return instance

    def lobes(self, hits: Hits, max_roughness: float, directions: F32 | None = None,
              beams: F32 | None = None) -> Lobes:
        """The specular lobes at N hits, with face normals in local space on the side of the hits' normals.

        Materials that are nowhere as smooth as ``max_roughness`` have none.

        Parameters
        ----------
        directions, beams : ndarray, optional
            Of the rays that met them, as for ``cast_through``; both or none.
        """
        f0, face = np.zeros((2, len(hits.body), 3), np.float32)
        roughness = np.ones((len(hits.body), 1), np.float32)
        for index, body in enumerate(self.bodies):
            rows = np.flatnonzero(hits.body == index)
            triangle = hits.triangle.take(rows)
            widths = None if beams is None or directions is None else body.mesh_widths(
                triangle, directions.take(rows, axis=0),
                width_at(beams.take(rows, axis=0), hits.distance.take(rows)), self.matrices[index][:3, :3])
            found = body.lobes(triangle, hits.uv.take(rows, axis=0), max_roughness, widths)
            f0[rows], roughness[rows] = found.f0, found.roughness
            face[rows] = found.face if index == STATIC else transform_normals(found.face, self.matrices[index])
        return Lobes(f0, roughness, np.where(row_dots(face, hits.normal)[:, None] < 0, -face, face))

    def _pose_body(self, time: float) -> Body:
        """The body of all animated instances, in local space."""
        to_local = translation(-self.origin)
        return Body(self._scene, [(i, to_local @ i.transform_at(time)) for i in self._animated_instances()],
                    self.textures, time)

    def _pose_at(self, time: float) -> list[NDArray[Any]]:
        """What the body of all animated instances depends on."""
        instances = self._animated_instances()
        shapes = [i.deformation.at(time) for i in instances if i.deformation is not None]
        return [*(i.transform_at(time) for i in instances),
                *(values for shape in shapes for values in (shape.positions, shape.normals))]

    def _animated_instances(self) -> list[Instance]:
        return [] if self.animated is None else [self._scene.instances[k] for k in self.members[self.animated]]

    def cast(self, origins: F32, directions: F32, bodies: Sequence[int] | None = None,
             t_max: F32 | None = None) -> Hits:
        """Find the nearest surface along rays in local space.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
        bodies : sequence of int, optional
            The bodies that rays can meet; default all.
        t_max : ndarray, float32, shape (N,), optional
            Distance at which each ray ends, in lengths of its direction; default infinite.
        """
        return self._cast(origins, directions, range(len(self.bodies)) if bodies is None else bodies, t_max, None)

    def cast_through(self, origins: F32, directions: F32, beams: F32 | None = None) -> SeenHits:
        """Find the nearest surface along rays that nothing passes, and one of those before it that some light passes.

        That one is chosen as often as it is seen, and stands for all of the ray.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
            In local space; directions are unit vectors.
        beams : ndarray, float32, shape (N, 2), optional
            Width of each ray at its origin, and what it grows by in a unit of length: over these, textures are averaged
            where it ends; default that of scattered rays.
        """
        found: list[_Passed] = []
        ends = self._cast(origins, directions, range(len(self.bodies)), None, found, beams)
        found.append(_Passed(ends.select(np.zeros(0, np.int64)), np.zeros(0, np.int64), np.zeros((0, 3), np.float32)))
        hits = concatenate([p.hits for p in found])
        ray, passing = np.concatenate([p.ray for p in found]), np.concatenate([p.passing for p in found])
        rows = np.flatnonzero(hits.distance < ends.distance.take(ray))
        rows = rows[np.lexsort((hits.distance.take(rows), ray.take(rows)))]
        covering = 1 - passing.take(rows, axis=0).mean(axis=1, keepdims=True)
        share, left = _arriving(ray.take(rows), passing.take(rows, axis=0), len(origins))
        chosen, factor = _choose_one(ray.take(rows), share.mean(axis=1), hits.uv.take(rows, axis=0))
        rows, share = rows.take(chosen), share.take(chosen, axis=0) * factor[:, None]
        return SeenHits(concatenate([ends, hits.select(rows)]),
                        np.concatenate([np.arange(len(origins)), ray.take(rows)]), np.concatenate([left, share]),
                        np.concatenate([np.ones((len(origins), 1), np.float32), covering.take(chosen, axis=0)]))

    def _cast(self, origins: F32, directions: F32, bodies: Iterable[int], t_max: F32 | None,
              passed: list[_Passed] | None, beams: F32 | None = None) -> Hits:
        """``cast``, which adds what is passed in part, and the share that is, instead of choosing rays that pass."""
        count = len(origins)
        position, normal, albedo, emission = np.zeros((4, count, 3), np.float32)
        distance = np.full(count, np.inf, np.float32) if t_max is None else t_max.copy()
        hits = Hits(position, normal, albedo, emission, distance, np.full(count, -1, np.int64),
                    np.zeros(count, np.bool_), np.full(count, -1, np.int64), np.zeros((count, 2), np.float32))
        for index in bodies:
            self._cast_at(index, origins, directions, hits, passed, beams)
        hits.distance[hits.body < 0] = np.inf
        return hits

    def transmitted(self, origins: F32, vectors: F32, proxies_block: bool, bodies: Sequence[int] | None = None) -> F32:
        """Shares of light that arrive from the end of each vector at its origin, shape (N, 3), tinted on the way.

        Parameters are those of ``is_occluded``.
        """
        share = np.ones((len(origins), 3), np.float32)
        share[self.is_occluded(origins, vectors, proxies_block, bodies, share)] = 0.0
        return share

    def is_occluded(self, origins: F32, vectors: F32, proxies_block: bool,
                    bodies: Sequence[int] | None = None, tint: F32 | None = None) -> Bools:
        """Whether a surface blocks light from the end of each vector to its origin, shape (N,).

        Parameters
        ----------
        origins, vectors : ndarray, float32, shape (N, 3)
            In local space.
        proxies_block : bool
            Whether the meshes of analytic lights count.
        bodies : sequence of int, optional
            Those whose surfaces count, in ascending order; default all.
        tint : ndarray, float32, shape (N, 3), optional
            Multiplied by the tint of what is passed; of no meaning where light is blocked.
        """
        occluded = np.zeros(len(origins), np.bool_)
        for index in range(len(self.bodies)) if bodies is None else bodies:
            body, inverse = self.bodies[index], affine_inverse(self.matrices[index])
            if inverse is None:
                continue  # scaled to nothing
            rows = np.flatnonzero(~occluded)
            start, along = origins, vectors
            if index != STATIC:
                rows = rows[_rays_towards(*self.bounding_sphere(index), origins.take(rows, axis=0),
                                          vectors.take(rows, axis=0), np.ones(len(rows), np.float32))]
                start = (origins.take(rows, axis=0) @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
                along = (vectors.take(rows, axis=0) @ inverse[:3, :3].T).astype(np.float32)
            blocked = body.meets_opaque(start, along, proxies_block)
            if body.lets_light_pass:
                left = np.flatnonzero(~blocked)
                ray = rows.take(left)
                colors = None if tint is None else tint.take(ray, axis=0)
                blocked[left] = body.meets_passable(start.take(left, axis=0), along.take(left, axis=0),
                                                    self._steps(vectors.take(ray, axis=0)), proxies_block, colors)
                if tint is not None and colors is not None:
                    put_rows(tint, ray, colors)
            occluded[rows] = blocked
        return occluded

    def random_points(self, count: int, rng: np.random.Generator) -> F32:
        """Points spread evenly over all surfaces but light proxies, shape (count, 3), in local space.

        None where there is nothing to spread them over.
        """
        corners = [body.surface_corners().astype(np.float64) if index == STATIC
                   else body.surface_corners() @ matrix[:3, :3].T + matrix[:3, 3]
                   for index, (body, matrix) in enumerate(zip(self.bodies, self.matrices, strict=True))]
        triangles = np.concatenate(corners)
        a, b, c = np.moveaxis(triangles, 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        if not area.sum() > 0:
            return np.zeros((0, 3), np.float32)
        return spread_points(triangles, area, count, rng)[0].astype(np.float32)

    def bounding_sphere(self, index: int) -> tuple[F32, float]:
        """Centre in local space, shape (3,), and radius of a sphere around body ``index``."""
        body, matrix = self.bodies[index], self.matrices[index]
        scale = float(np.linalg.norm(matrix[:3, :3], 2))
        return (matrix[:3, :3] @ body.center + matrix[:3, 3]).astype(np.float32), 1.001 * scale * body.radius

    def _steps(self, directions: F32) -> F32:
        """How far rays go on behind what they pass, shape (N,), in lengths of their directions."""
        return np.asarray(self.ray_epsilon / np.maximum(row_lengths(directions), 1e-30), np.float32)

    def _cast_at(self, index: int, origins: F32, directions: F32, hits: Hits, passed: list[_Passed] | None,
                 beams: F32 | None) -> None:
        """Update ``hits`` where body ``index`` is nearer than its distance."""
        body, matrix = self.bodies[index], self.matrices[index]
        inverse = affine_inverse(matrix)
        if inverse is None:
            return  # scaled to nothing
        rows = _rays_towards(*self.bounding_sphere(index), origins, directions, hits.distance)
        start, along = origins.take(rows, axis=0), directions.take(rows, axis=0)
        step = self._steps(along)
        if index != STATIC:
            start = (start @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
            along = (along @ inverse[:3, :3].T).astype(np.float32)
        from_start = np.zeros(len(rows), np.float32)
        passed = passed if body.has_passable else None
        # Of what rays have passed; ``cast_through`` takes the shares of that instead.
        tint = np.ones((len(rows), 3), np.float32) if body.has_passable and passed is None else None
        for _ in range(MAX_PASSED):
            distance, triangle, uv, face = body.cast(start + along * from_start[:, None], along,
                                                     hits.distance[rows] - from_start)
            share = None if passed is None else body.passing(triangle, uv, along)
            goes_on = np.zeros(len(triangle), np.bool_) if share is None else (share > 0).any(axis=1)
            if tint is not None:
                goes_on, passing = body.passed_and_tint(triangle, uv, along)
                tint = tint * passing
            is_seen = ~goes_on if share is None else (share < 1).any(axis=1)
            seen = np.flatnonzero((triangle >= 0) & is_seen)
            to, at, bary, away = rows.take(seen), triangle.take(seen), uv.take(seen, axis=0), from_start + distance
            widths = None if beams is None else body.mesh_widths(
                at, directions.take(to, axis=0), width_at(beams.take(to, axis=0), away.take(seen)), matrix[:3, :3])
            surface = body.interact(at, bary, face.take(seen, axis=0), along.take(seen, axis=0), widths)
            normal = transform_normals(surface.normal, matrix) if index != STATIC else surface.normal
            position = origins.take(to, axis=0) + directions.take(to, axis=0) * away.take(seen)[:, None]
            behind = np.float32(1) if tint is None else tint.take(seen, axis=0)
            found = Hits(position, normal, behind * surface.albedo, behind * surface.emission, away.take(seen),
                         np.full(len(seen), index, np.int64), body.is_light_proxy(at), at, bary)
            if passed is not None and share is not None:
                is_passed = goes_on.take(seen)
                passed.append(_Passed(found.select(is_passed), to[is_passed], share[seen[is_passed]]))
                to, found = to[~is_passed], found.select(~is_passed)
            hits.put(to, found)
            if not goes_on.any():
                return
            from_start = (away + step)[goes_on]
            tint = None if tint is None else tint[goes_on]
            rows, start, along, step = rows[goes_on], start[goes_on], along[goes_on], step[goes_on]


@dataclass(frozen=True, eq=False)
class Anchors:
    """What points are attached to: see ``Hits``. Triangle and uv count only on the animated body."""

    body: Ints
    triangle: Ints
    uv: F32

    def select(self, rows: Bools | Ints) -> Anchors:
        """The anchors at an index or mask."""
        return Anchors(self.body[rows], self.triangle[rows], self.uv[rows])


class AttachedPoints:
    """Points stored in the space of their body or, on the animated one, in the frame of their triangle.

    Parameters
    ----------
    position, normal : ndarray, float32, shape (N, 3)
        In local space, for the current bodies of ``caster``.
    """

    def __init__(self, caster: Caster, position: F32, normal: F32, anchors: Anchors) -> None:
        self._caster, self.anchors = caster, anchors
        position, normal = self._transform(position, normal, [affine_inverse(m) for m in caster.matrices])
        for rows, origin, axes in self._frames():
            position[rows], normal[rows] = _turn(position[rows] - origin, normal[rows], axes.transpose(0, 2, 1))
        self._stored = position, normal
        self._current: tuple[int, tuple[F32, F32]] | None = None  # the caster's revision, and what was found for it

    def current(self) -> tuple[F32, F32]:
        """Positions and normals in local space, for the current bodies; read-only."""
        if self._current is None or self._current[0] != self._caster.revision:
            current = self._find_current()
            for values in current:
                values.flags.writeable = False
            self._current = self._caster.revision, current
        return self._current[1]

    def _find_current(self) -> tuple[F32, F32]:
        position, normal = (values.copy() for values in self._stored)
        for rows, origin, axes in self._frames():
            position[rows], normal[rows] = _turn(position[rows], normal[rows], axes)
            position[rows] += origin
        return self._transform(position, normal, self._caster.matrices)

    def select(self, rows: Ints) -> AttachedPoints:
        """The points at indices."""
        position, normal = self.current()
        return AttachedPoints(self._caster, position[rows], normal[rows], self.anchors.select(rows))

    def _frames(self) -> Iterator[tuple[Ints, F32, F32]]:
        """The points on the animated body, and where their triangles are, if there is one."""
        if self._caster.animated is not None:
            rows = np.flatnonzero(self.anchors.body == self._caster.animated)
            body = self._caster.bodies[self._caster.animated]
            yield rows, *body.frames(self.anchors.triangle[rows], self.anchors.uv[rows])

    def _transform(self, position: F32, normal: F32, matrices: Sequence[F64 | None]) -> tuple[F32, F32]:
        position, normal = position.copy(), normal.copy()
        for index, matrix in enumerate(matrices):
            rows = self.anchors.body == index
            if index != STATIC and matrix is not None and rows.any():
                position[rows] = position[rows] @ matrix[:3, :3].T + matrix[:3, 3]
                normal[rows] = transform_normals(normal[rows], matrix)
        return position, normal


def width_at(beams: F32, distance: F32) -> F32:
    """Of rays at a distance from where they start, shape (N,); beams are those of ``Caster.cast_through``."""
    return np.asarray(beams[:, 0] + beams[:, 1] * distance, np.float32)


def _turn(position: F32, normal: F32, axes: F32) -> tuple[F32, F32]:
    """Both vectors of each point, shape (N, 3), times its matrix, shape (N, 3, 3)."""
    return (axes @ position[:, :, None])[..., 0], (axes @ normal[:, :, None])[..., 0]


def transform_normals(normals: F32, matrix: F64) -> F32:
    """Unit normals, shape (N, 3), in the space that ``matrix`` leads to."""
    normals = normals @ normal_matrix(matrix).T * np.sign(np.linalg.det(matrix[:3, :3]))
    return unit_rows(normals).astype(np.float32)


def _rays_towards(center: F32, radius: float, origins: F32, directions: F32, t_max: F32) -> Ints:
    """Indices of rays that may meet a sphere before ``t_max``."""
    to = center - origins
    square = np.maximum(row_dots(directions, directions), 1e-30)
    along = row_dots(to, directions) / square
    past = to - directions * along[:, None]
    off = row_dots(past, past)
    inside = row_dots(to, to) <= radius**2
    near = along - radius / np.sqrt(square) <= t_max
    return np.flatnonzero(inside | ((off <= radius**2) & (along > 0) & near))


def _arriving(ray: Ints, passing: F32, count: int) -> tuple[F32, F32]:
    """Shares that arrive of surfaces in order along each of ``count`` rays, shape (M, 3), and of what is behind them.

    Parameters
    ----------
    ray : ndarray of int, shape (M,)
        Ascending.
    passing : ndarray, float32, shape (M, 3)
        Shares of light that each surface lets pass.
    """
    share, left = np.empty_like(passing), np.ones((count, 3), np.float32)
    rank = np.arange(len(ray)) - np.searchsorted(ray, ray)
    for number in range(rank.max(initial=-1) + 1):
        rows = np.flatnonzero(rank == number)
        on = ray.take(rows)
        share[rows] = left.take(on, axis=0) * (1 - passing.take(rows, axis=0).mean(axis=1, keepdims=True))
        left[on] *= passing.take(rows, axis=0)
    return share, left


def _choose_one(ray: Ints, weight: F32, uv: F32) -> tuple[Ints, F32]:
    """One of the rows of each ray that has any, as often as its weight says, and by what its light counts then.

    Parameters
    ----------
    ray : ndarray of int, shape (M,)
        Ascending.
    weight : ndarray, float32, shape (M,)
    uv : ndarray, float32, shape (M, 2)
        Which the choice depends on alone.
    """
    if not len(ray):
        return ray, weight
    first = np.flatnonzero(np.diff(ray, prepend=-1))
    sums = np.cumsum(weight, dtype=np.float64)
    before = sums.take(first) - weight.take(first)
    total = np.diff(np.append(before, sums[-1]))
    wanted = before + hash_uv(uv.take(first, axis=0)) * total
    chosen = np.clip(np.searchsorted(sums, wanted, side="right"), first, np.append(first[1:], len(ray)) - 1)
    return chosen, np.asarray(total / np.maximum(weight.take(chosen), 1e-6), np.float32)
