"""A set of triangles that moves as one, and the surface properties at the points where rays meet it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64, Bools, Ints
from app.embree import Triangles
from app.math3d import normal_matrix, put_rows, row_dots, row_lengths, unit_rows
from app.network.channels import HALF_MAX
from app.raycast.prefiltered_textures import PrefilteredTextures, sample_nearest
from app.scene import Instance, Material, Scene, Texture
from app.specular_albedo import MEAN_COSINE, specular_albedo

# Those that rays see, beside that of transmission.
_REFLECTING_MAPS = "albedo_map", "metallic_roughness_map", "specular_map"
_MAPS = "emission_map", *_REFLECTING_MAPS
MIN_OPACITY = 1e-3  # of what rays meet, so that nothing divides by 0
HASH_CELLS = 2**14  # of a triangle's edge, in which hits have the same random number
MIN_FACING = 0.1  # cosine of a surface to a ray, below which the ray's width on it grows no further
MAX_PASSED = 16  # surfaces with holes, culled backs and light proxies that a ray can pass


@dataclass(frozen=True, eq=False)
class SurfaceInteraction:
    """Surface properties at the hits of N rays.

    Attributes
    ----------
    normal : ndarray, float32, shape (N, 3)
        Unit shading normal in the body's space, on the side of the ray's origin.
    albedo : ndarray, float32, shape (N, 3)
        Reflected share of light, by diffuse and specular reflection; the latter for a cosine of ``MEAN_COSINE``.
    emission : ndarray, float32, shape (N, 3)
        In W/(sr m²), also of light proxies.
    """

    normal: F32
    albedo: F32
    emission: F32


@dataclass(frozen=True, eq=False)
class Lobes:
    """Specular lobes at N hits.

    Attributes
    ----------
    f0 : ndarray, float32, shape (N, 3)
        Reflectance at normal incidence, 0 where there is no lobe.
    roughness : ndarray, float32, shape (N, 1)
        Perceptual.
    face : ndarray, float32, shape (N, 3)
        Unit normal of the triangle where there is one.
    """

    f0: F32
    roughness: F32
    face: F32


@dataclass(frozen=True, eq=False)
class _Base:
    """The core material model at N hits.

    Attributes
    ----------
    material : ndarray of int, shape (N,)
        Index into ``Body.materials``.
    color, dielectric : ndarray, float32, shape (N, 3)
        Base colour, and F0 of what is no metal.
    roughness, metallic : ndarray, float32, shape (N, 1)
        Perceptual roughness, and share of metal.
    """

    material: Ints
    color: F32
    dielectric: F32
    roughness: F32
    metallic: F32

    @property
    def f0(self) -> F32:
        """Reflectance at normal incidence, shape (N, 3)."""
        return np.asarray(self.dielectric + self.metallic * (self.color.clip(0, 1) - self.dielectric))

    def select(self, rows: Ints) -> _Base:
        """The hits at indices."""
        return _Base(*(values.take(rows, axis=0) for values in vars(self).values()))


class Body:
    """Instances that share one space, with an Embree scene for casting rays at them.

    Parameters
    ----------
    placed : iterable of (Instance, ndarray)
        Each instance with its matrix from object space to the body's space.
    time : float
        Seconds, of the shape of instances that deform.
    textures : PrefilteredTextures
        Shared by all bodies of a scene.

    Attributes
    ----------
    positions, normals : ndarray, float32, shape (V, 3)
        Of the vertices, in the body's space.
    uvs : list of ndarray, float32, shape (V, 2)
        One or two sets.
    colors : ndarray, float32, shape (V, 4), or None
    triangles : ndarray of int, shape (T, 3)
    material : ndarray of int, shape (T,)
        Index into ``materials``.
    mirrored : ndarray of bool, shape (T,)
        Whether the triangle's corners go around clockwise, seen from its front.
    light_proxies, one_sided, lit_through, alpha_tested : ndarray of bool, shape (materials,)
        Which materials are those of an analytic light's mesh, have backs that rays pass and that light passes, and let
        rays pass in parts.
    part : ndarray of int, shape (T,)
        Which of ``placed`` each triangle belongs to.
    has_passable, lets_light_pass : bool
        Whether rays pass some surface, a masked, see-through or one-sided one, and whether light does.
    """

    def __init__(self, scene: Scene, placed: Iterable[tuple[Instance, F64]], textures: PrefilteredTextures,
                 time: float = 0.0) -> None:
        self._textures = textures
        parts = [_transform_instance(scene, instance, matrix, time) for instance, matrix in placed]
        self.materials = list({id(p.material): p.material for p in parts}.values())
        number = {id(m): k for k, m in enumerate(self.materials)}
        start = np.cumsum([0, *(len(p.positions) for p in parts)])
        self.triangles = _concatenate([p.triangles + s for p, s in zip(parts, start, strict=False)], (0, 3), np.int64)
        self.positions = _concatenate([p.positions for p in parts], (0, 3), np.float32)
        self.normals = _concatenate([p.normals for p in parts], (0, 3), np.float32)
        # Vertex values of the uv sets; few scenes have a second one.
        sets = 2 if any(t.uv_set for m in self.materials for t in m.maps.values()) else 1
        self.uvs = [_concatenate([p.uvs[number] for p in parts], (0, 2), np.float32) for number in range(sets)]
        self.colors = None
        if any(p.colors is not None for p in parts):
            self.colors = _concatenate([np.ones((len(p.positions), 4), np.float32) if p.colors is None else p.colors
                                         for p in parts], (0, 4), np.float32)
        self.material = _concatenate([np.full(len(p.triangles), number[id(p.material)]) for p in parts], (0,),
                                      np.int64)
        self.part = np.repeat(np.arange(len(parts)), [len(p.triangles) for p in parts])
        self.mirrored = _concatenate([np.full(len(p.triangles), p.mirrored) for p in parts], (0,), np.bool_)
        corners = self.positions if len(self.positions) else np.zeros((1, 3), np.float32)
        low, high = corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)
        self.center, self.radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        self.alpha_tested = np.array([m.alpha_cutoff is not None or m.is_see_through for m in self.materials], bool)
        self.one_sided = np.array([m.is_one_sided for m in self.materials], bool)
        self.lit_through = np.array([m.is_lit_through for m in self.materials], bool)
        self._has_glass = any(m.transmission is not None for m in self.materials)
        self._is_mapped = np.array([any(m.maps.get(name) is not None for name in _REFLECTING_MAPS)
                                    for m in self.materials], bool)
        self._emits_or_transmits = np.array([m.emits or m.transmission is not None for m in self.materials], bool)
        self._has_specular = np.array([m.has_specular and not m.is_unlit for m in self.materials], bool)
        self._min_roughness = np.array([1.0 if m.is_unlit else m.min_roughness for m in self.materials])
        self._albedo = _columns([(0.0,) * 3 if m.is_unlit else m.albedo for m in self.materials], 3)
        self._specular = _columns([m.specular for m in self.materials], 3)
        self._roughness_metallic = _columns([(m.roughness, m.metallic) for m in self.materials], 2)
        self.light_proxies = np.array([m.is_light_proxy for m in self.materials], bool)
        opaque = ~(self.alpha_tested | self.lit_through)[self.material]  # for light
        proxy = self.light_proxies[self.material]
        self._opaque, self._opaque_proxies, self._passable = (
            Triangles(self.positions, self.triangles, np.flatnonzero(chosen))
            for chosen in (opaque & ~proxy, opaque & proxy, ~opaque))
        self.has_passable = bool((self.alpha_tested | self.one_sided)[self.material].any())
        self.lets_light_pass = len(self._passable) > 0

    def cast(self, origins: F32, directions: F32, t_max: F32) -> tuple[F32, Ints, F32, F32]:
        """Find the nearest triangle along each ray.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
        t_max : ndarray, float32, shape (N,)
            Distance at which each ray ends, in lengths of its direction.

        Returns
        -------
        distance : ndarray, float32, shape (N,)
            In lengths of the direction; ``t_max`` for a miss.
        triangle : ndarray of int, shape (N,)
            -1 for a miss.
        uv : ndarray, float32, shape (N, 2)
            Barycentric coordinates of the second and third corner.
        face : ndarray, float32, shape (N, 3)
            Unit face normal on the side of the ray's origin.
        """
        return self._cast((self._opaque, self._opaque_proxies, self._passable), origins, directions, t_max)

    def _cast(self, parts: Iterable[Triangles], origins: F32, directions: F32,
              t_max: F32) -> tuple[F32, Ints, F32, F32]:
        """``cast`` among some parts of the body."""
        count = len(origins)
        triangle, uv = np.full(count, -1, np.int64), np.zeros((count, 2), np.float32)
        face, distance = np.zeros((count, 3), np.float32), t_max.astype(np.float32)
        for part in parts:
            if not len(part) or count == 0:
                continue
            hits = part.intersect(origins, directions, distance)
            hit = np.flatnonzero(hits.triangle >= 0)
            triangle[hit] = hits.triangle.take(hit)
            put_rows(uv, hit, np.stack([hits.u.take(hit), hits.v.take(hit)], 1))
            distance[hit] = hits.distance.take(hit)
            area = hits.area.take(hit, axis=0).astype(np.float64)  # whose square may overflow float32
            normal = unit_rows(area)
            away = row_dots(normal, directions.take(hit, axis=0)) > 0
            put_rows(face, hit, np.where(away[:, None], -normal, normal))
        return distance, triangle, uv, face

    def meets_opaque(self, origins: F32, vectors: F32, proxies_block: bool) -> Bools:
        """Whether a surface that no light passes lies on each vector, shape (N,).

        Parameters
        ----------
        origins, vectors : ndarray, float32, shape (N, 3)
            In the body's space.
        proxies_block : bool
            Whether light proxies count.
        """
        met = _meets(self._opaque, origins, vectors)
        if proxies_block and len(self._opaque_proxies):
            left = np.flatnonzero(~met)
            met[left] = _meets(self._opaque_proxies, origins.take(left, axis=0), vectors.take(left, axis=0))
        return met

    def meets_passable(self, origins: F32, vectors: F32, steps: F32, proxies_block: bool,
                       tint: F32 | None = None) -> Bools:
        """Whether one of the other surfaces blocks light from the end of each vector to its origin, shape (N,).

        Opaque light proxies are left to ``meets_opaque``.

        Parameters
        ----------
        origins, vectors, proxies_block
            As for ``meets_opaque``, which they don't meet.
        steps : ndarray, float32, shape (N,)
            How far rays go on behind what they pass, in lengths of their vectors.
        tint : ndarray, float32, shape (N, 3), optional
            Multiplied by the tint of what is passed.
        """
        occluded, rows = np.zeros(len(origins), np.bool_), np.arange(len(origins))
        passed = np.zeros(len(rows), np.float32)
        for _ in range(MAX_PASSED):
            if not len(rows):
                break
            along = vectors.take(rows, axis=0)
            start = origins.take(rows, axis=0) + passed[:, None] * along
            distance, triangle, uv, _ = self._cast((self._passable,), start, along, 1 - passed)
            met = triangle >= 0
            # Light comes from the other end. Where it is tinted, as much passes as of the brightest channel.
            passes, passing = self._passed_and_tint(triangle, uv, -along, self.lit_through,
                                                    np.mean if tint is None else np.max)
            if not proxies_block:
                passes |= met & self.is_light_proxy(triangle)
            occluded[rows[met & ~passes]] = True
            passed = passed + distance + steps[rows]
            if tint is not None and self._has_glass:
                tint[rows[passes]] *= passing[passes]
            passes &= passed < 1
            rows, passed = rows[passes], passed[passes]
        return occluded

    def surface_corners(self) -> F32:
        """Corners of all triangles but those of light proxies, shape (T, 3, 3), in the body's space."""
        rows = np.flatnonzero(~self.light_proxies.take(self.material))
        return self.positions.take(self.triangles.take(rows, axis=0), axis=0)

    def frames(self, triangle: Ints, uv: F32) -> tuple[F32, F32]:
        """Where points on triangles are, shape (N, 3), and axes that turn with the triangles, shape (N, 3, 3)."""
        origin = self._interpolate(self.positions, triangle, uv)
        a, b, c = (self.positions[self.triangles[triangle, i]].astype(np.float64) for i in range(3))
        normal = unit_rows(np.cross(b - a, c - a))
        along = unit_rows(b - a)
        return origin, np.stack([along, np.cross(normal, along), normal], axis=2).astype(np.float32)

    def passed_and_tint(self, triangle: Ints, uv: F32, directions: F32) -> tuple[Bools, F32]:
        """Whether rays along ``directions`` go through the surface, shape (N,), as often as light does on the mean.

        And light in each channel over that mean for those that do, 1 for others, shape (N, 3).
        """
        return self._passed_and_tint(triangle, uv, directions, self.one_sided, np.mean)

    def _passed_and_tint(self, triangle: Ints, uv: F32, directions: F32, culled: Bools,
                         often: Callable[..., F32]) -> tuple[Bools, F32]:
        """``passed_and_tint`` with a mean or another measure of the channels, where backs of ``culled`` are passed."""
        passed, tint = np.zeros(len(triangle), np.bool_), np.ones((len(triangle), 3), np.float32)
        met, share = self._passing_where_passable(triangle, uv, directions, culled)
        chance = often(share, axis=1)
        passes = _passes_by_chance(chance, uv[met])
        passed[met] = passes
        tint[met[passes]] = share[passes] / np.maximum(chance[passes, None], np.float32(MIN_OPACITY))
        return passed, tint

    def passing(self, triangle: Ints, uv: F32, directions: F32) -> F32:
        """Shares of light that rays along ``directions`` see behind the surface there, or the void, shape (N, 3)."""
        shares = np.zeros((len(triangle), 3), np.float32)
        met, share = self._passing_where_passable(triangle, uv, directions, self.one_sided)
        put_rows(shares, met, share)
        return shares

    def _passing_where_passable(self, triangle: Ints, uv: F32, directions: F32,
                                culled: Bools) -> tuple[Ints, F32]:
        """Indices of the hits on what can be passed along ``directions``, and the shares that do, shape (M, 3).

        The backs of the materials ``culled``, holes of masks, and blended and transmissive surfaces in part.
        """
        met = np.flatnonzero(triangle >= 0)
        material = self.material.take(triangle.take(met))
        met = met[(culled | self.alpha_tested)[material]]
        triangle, uv = triangle.take(met), uv.take(met, axis=0)
        material = self.material.take(triangle)
        shares = np.zeros((len(met), 3), np.float32)
        for index, rows in self._by_material(np.flatnonzero(self.alpha_tested[material]), triangle):
            m = self.materials[index]
            at = triangle[rows], uv[rows]
            alpha = np.full(len(rows), m.alpha, np.float32)
            if self.colors is not None:
                alpha *= self._interpolate(self.colors, *at)[:, 3]
            if m.albedo_map is not None:
                alpha *= sample_nearest(m.albedo_map, self._interpolate(self.uvs[0], *at))[:, 3]
            if m.is_see_through:
                coverage = alpha[:, None] if m.is_blended else np.float32(1)
                shares[rows] = np.nan_to_num(1 - coverage * (1 - self._passing(m, *at)[0]), nan=1.0).clip(0, 1)
            if m.alpha_cutoff is not None:
                shares[rows[~(alpha >= m.alpha_cutoff)]] = 1
        backs = np.flatnonzero(culled[material])
        shares[backs[~self._is_front(triangle[backs], directions.take(met[backs], axis=0))]] = 1
        return met, shares

    def _passing(self, m: Material, triangle: Ints, uv: F32) -> tuple[F32, F32]:
        """Shares of light that pass what is covered, (N, 3), and share that is not for diffuse reflection, (N,)."""
        share = np.tile(np.asarray(m.passing, np.float32), (len(triangle), 1))
        if m.transmission is None:
            return share, share[:, 0]
        at = [self._interpolate(uvs, triangle, uv) for uvs in self.uvs]
        refracted = self._textured(m.transmission.factor_map, at)[:, :1]
        share *= refracted * (1 - m.metallic * self._textured(m.metallic_roughness_map, at)[:, 2:])
        if self.colors is not None:
            share *= self._interpolate(self.colors, triangle, uv)[:, :3]
        share *= self._textured(m.albedo_map, at, m.alpha_cutoff is not None)
        share = share.clip(0, 1)
        return np.sqrt(share) if m.is_volume else share, m.transmission.factor * refracted[:, 0]

    def is_light_proxy(self, triangle: Ints) -> Bools:
        """Whether each triangle stands for an analytic light, shape (N,)."""
        return np.asarray(self.light_proxies.take(self.material.take(triangle)))

    def interact(self, triangle: Ints, uv: F32, face: F32, directions: F32,
                 widths: Sequence[F32] | None = None) -> SurfaceInteraction:
        """Evaluate the surface at hits of ``cast``, none of them a miss.

        Parameters
        ----------
        widths : sequence of ndarray, optional
            As of ``mesh_widths``, over which textures are averaged; default those of scattered rays.
        """
        normal = self._interpolate(self.normals, triangle, uv)
        length = row_lengths(normal)[:, None]
        normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-30), face)
        normal = np.where(row_dots(normal, face)[:, None] < 0, -normal, normal)
        base = self._base(triangle, uv, widths)
        albedo, emission = base.color, np.zeros_like(base.color)
        passing, refracted = np.zeros((2, len(triangle)), np.float32)
        for index, rows in self._by_material(np.flatnonzero(self._emits_or_transmits[base.material]), triangle):
            m, at = self.materials[index], (triangle[rows], uv[rows])
            if m.transmission is not None:
                shares, refracted[rows] = self._passing(m, *at)
                passing[rows] = shares.mean(axis=1)
            if m.emits:
                emits = m.double_sided | self._is_front(triangle[rows], directions[rows])[:, None]
                texels = self._textured(m.emission_map, [self._interpolate(uvs, *at) for uvs in self.uvs],
                                        width=_select(widths, rows))
                emission[rows] = np.where(emits, np.array(m.emission, np.float32) * texels, 0.0)
        shiny = np.flatnonzero(self._has_specular.take(base.material))
        of_shiny = base.select(shiny)
        matte = of_shiny.color.clip(0, 1)
        if self._has_glass:
            diffuse = np.float32(1) - refracted[:, None]
            albedo *= diffuse
            matte = matte * diffuse.take(shiny, axis=0)
        put_rows(albedo, shiny, _reflectance(of_shiny, matte))
        if self._has_glass:
            met = np.maximum(np.float32(1) - passing, np.float32(MIN_OPACITY))[:, None]  # share of rays that meet it
            albedo, emission = albedo / met, emission / met
        return SurfaceInteraction(normal.astype(np.float32), np.clip(albedo, 0.0, 1.0), np.maximum(emission, 0.0))

    def lobes(self, triangle: Ints, uv: F32, max_roughness: float, widths: Sequence[F32] | None = None) -> Lobes:
        """The specular lobes at hits as for ``Caster.lobes``, with face normals in the body's space on any side.

        ``widths`` are as for ``interact``.
        """
        f0, face = np.zeros((2, len(triangle), 3), np.float32)
        roughness = np.ones((len(triangle), 1), np.float32)
        rows = np.flatnonzero(self._min_roughness.take(self.material.take(triangle)) < max_roughness)
        base = self._base(triangle.take(rows), uv.take(rows, axis=0), _select(widths, rows))
        f0[rows], roughness[rows], face[rows] = base.f0, base.roughness, unit_rows(self._face(triangle.take(rows)))
        return Lobes(f0, roughness, face)

    def mesh_widths(self, triangle: Ints, directions: F32, width: F32, linear: F64) -> list[F32]:
        """Widths of rays where they meet triangles, along both mesh coordinates of each uv set, each of shape (N, 2).

        Obliquely met, they are means of an ellipse's.

        Parameters
        ----------
        directions, width : ndarray, float32, shapes (N, 3) and (N,)
            Of unit length, and across these, in the space that the matrix ``linear`` of shape (3, 3) leads to.
        """
        def edges(values: F32) -> tuple[F64, F64]:
            a, b, c = (values.take(corner, axis=0).astype(np.float64) for corner in self.triangles[triangle].T)
            return b - a, c - a

        first, second = (edge @ linear.T for edge in edges(self.positions))
        normal = np.cross(first, second)
        area = np.maximum(row_lengths(normal), 1e-60)
        across = width / np.sqrt(np.maximum(np.abs(row_dots(normal, directions)) / area, MIN_FACING)) / area
        return [np.stack([across * row_lengths(along * second - further * first)
                          for along, further in zip(*(edge.T[..., None] for edge in edges(uvs)), strict=True)],
                         axis=1).astype(np.float32) for uvs in self.uvs]

    def _base(self, triangle: Ints, uv: F32, widths: Sequence[F32] | None = None) -> _Base:
        """What the core material model says of surfaces at hits, averaged over widths in each uv set."""
        material = self.material[triangle]
        color = self._albedo.take(material, axis=0)
        if self.colors is not None:
            color *= self._interpolate(self.colors, triangle, uv)[:, :3]
        dielectric = self._specular.take(material, axis=0)
        roughness, metallic = self._roughness_metallic.take(material, axis=0).T[..., None]
        mapped = np.flatnonzero(self._is_mapped[material])
        everywhere = [self._interpolate(uvs, triangle, uv) for uvs in self.uvs] if len(mapped) else []
        for index, rows in self._by_material(mapped, triangle):
            m = self.materials[index]
            at = [uvs.take(rows, axis=0) for uvs in everywhere]
            wide = _select(widths, rows)
            if m.albedo_map is not None:
                color[rows] *= self._textured(m.albedo_map, at, m.alpha_cutoff is not None, wide)
            if m.specular_map is not None:
                dielectric[rows] *= self._textured(m.specular_map, at, width=wide)
            if m.metallic_roughness_map is not None:
                maps = self._textured(m.metallic_roughness_map, at, width=wide)
                roughness[rows] *= maps[:, 1:2]
                metallic[rows] *= maps[:, 2:]
        return _Base(material, color, dielectric, roughness, metallic)

    def _is_front(self, triangle: Ints, directions: F32) -> Bools:
        return (row_dots(self._face(triangle), directions) < 0) != self.mirrored[triangle]

    def _face(self, triangle: Ints) -> F32:
        """Cross product of two edges, shape (N, 3)."""
        a, b, c = (self.positions.take(corner, axis=0) for corner in self.triangles.take(triangle, axis=0).T)
        return np.asarray(np.cross(b - a, c - a))

    def _interpolate(self, values: F32, triangle: Ints, uv: F32) -> F32:
        """Vertex values at barycentric coordinates."""
        a, b, c = (values.take(corner, axis=0) for corner in self.triangles.take(triangle, axis=0).T)
        u, v = uv[:, :1], uv[:, 1:]
        interpolated: F32 = (1 - u - v) * a + u * b + v * c
        return interpolated

    def _textured(self, texture: Texture | None, uvs: Sequence[F32], alpha_tested: bool = False,
                  width: Sequence[F32] | None = None) -> F32:
        """A texture at the coordinates of each uv set, averaged over widths in each, shape (N, 3); 1 without one."""
        if texture is None:
            return np.ones((len(uvs[0]), 3), np.float32)
        return self._textures.sample(texture, uvs[texture.uv_set], alpha_tested,
                                     None if width is None else width[texture.uv_set])

    def _by_material(self, rows: Ints, triangle: Ints) -> Iterable[tuple[int, Ints]]:
        """Pairs of a material's index and those of ``rows`` whose triangle has it."""
        material = self.material[triangle[rows]]
        order = np.argsort(material, kind="stable")
        indices, start = np.unique(material[order], return_index=True)
        return zip(indices.tolist(), np.split(rows[order], start[1:]), strict=True) if len(rows) else ()


def _passes_by_chance(chance: F32, uv: F32) -> Bools:
    """Whether what passes as often as ``chance`` says does so, by a hash of the hit (Wyman and McGuire 2017)."""
    return np.asarray(~(1 - chance > hash_uv(uv)))


def _select(widths: Sequence[F32] | None, rows: Ints) -> list[F32] | None:
    return None if widths is None else [values.take(rows, axis=0) for values in widths]


def _columns(rows: Sequence[Sequence[float]], count: int) -> F32:
    return np.array(rows, np.float32).reshape(-1, count)


def _reflectance(base: _Base, matte: F32) -> F32:
    """Diffuse and specular albedo, shape (N, 3), at most 1.

    ``matte`` is the base colour without what glass lets through, shape (N, 3), at most 1.
    """
    specular = specular_albedo(base.f0, base.roughness, np.full_like(base.roughness, MEAN_COSINE))
    return np.asarray(specular + np.minimum(matte * (1 - base.metallic), 1 - specular))


def hash_uv(uv: F32) -> F32:
    """Numbers in [0, 1) that differ from hit to hit, shape (N,), but rarely by rounding, which CPUs do differently."""
    cells = np.floor(np.nan_to_num(uv).clip(0, 1) * np.float32(HASH_CELLS)).astype(np.uint64)
    bits = cells * np.uint64(2**32 // HASH_CELLS)
    mixed = (bits[:, 0] * np.uint64(0x9E3779B1) ^ bits[:, 1] * np.uint64(0x85EBCA77)) * np.uint64(0xC2B2AE3D27D4EB4F)
    return ((mixed >> np.uint64(40)).astype(np.float32) / np.float32(2**24)).astype(np.float32)


def _meets(part: Triangles, origins: F32, vectors: F32) -> Bools:
    """Whether any of the triangles lies on each vector, shape (N,)."""
    return part.meet(origins, vectors) if len(part) and len(origins) else np.zeros(len(origins), np.bool_)


@dataclass(frozen=True, eq=False)
class _Part:
    positions: F32
    normals: F32
    uvs: tuple[F32, F32]
    colors: F32 | None
    triangles: Ints
    material: Material
    mirrored: bool


def _transform_instance(scene: Scene, instance: Instance, matrix: F64, time: float) -> _Part:
    """One instance's mesh in the body's space, without triangles that have a non-finite corner."""
    mesh = instance.mesh_at(scene.meshes, time)
    count = len(mesh.positions)
    finite = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    triangles = mesh.triangles[finite[mesh.triangles].all(axis=1)].astype(np.int64)
    with np.errstate(invalid="ignore"):
        positions = np.where(finite[:, None], mesh.positions, 0.0) @ matrix[:3, :3].T + matrix[:3, 3]
        normals = np.nan_to_num(mesh.normals, nan=0.0, posinf=0.0, neginf=0.0) @ normal_matrix(matrix).T
    normals = unit_rows(normals)
    none = np.zeros((count, 2), np.float32)
    first, second = (none if uvs is None else _clamp(uvs, -HALF_MAX) for uvs in (mesh.uvs, mesh.second_uvs))
    colors = None if mesh.colors is None else _clamp(mesh.colors, 0.0)
    material = scene.materials[mesh.material]
    uv_sets = mesh.uvs, mesh.second_uvs
    without_uvs: dict[str, Any] = {name: None for name in _MAPS if (texture := material.maps.get(name)) is not None
                                   and uv_sets[texture.uv_set] is None}
    transmission = material.transmission
    if transmission and transmission.factor_map and uv_sets[transmission.factor_map.uv_set] is None:
        without_uvs["transmission"] = replace(transmission, factor_map=None)
    if without_uvs:
        material = replace(material, **without_uvs)
    return _Part(positions.astype(np.float32), normals.astype(np.float32), (first, second), colors, triangles, material,
                 bool(np.linalg.det(matrix[:3, :3]) < 0))


def _clamp(values: F32, low: float) -> F32:
    """Finite values between ``low`` and the largest half float, so that interpolation can't overflow."""
    return np.nan_to_num(values).clip(np.float32(low), np.float32(HALF_MAX))


def _concatenate(arrays: Sequence[NDArray[Any]], empty: tuple[int, ...], dtype: type) -> NDArray[Any]:
    """The arrays one after the other; of shape ``empty`` when there are none."""
    return np.concatenate([np.zeros(empty, dtype), *arrays]).astype(dtype, copy=False)
