"""Rays that go on from glossy surfaces where others end, by their specular lobes, as in shaders/reflection_trace.comp.

What mirrors much at its viewing angle, such as a polished floor at a grazing one, is no diffuse surface in a mirror.
Rays from rougher surfaces would be noise. They rarely meet a lamp, or never if it is a light without a surface, so what
is mirrored of lights stays with the diffuse reflection of direct light there.
"""

from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F32, Ints
from app.math3d import row_dots, unit_rows
from app.raycast.caster import Caster, Hits, width_at
from app.specular_albedo import MEAN_COSINE, MIN_ALPHA, specular_albedo

# As in shaders/include/ray_share.glsl:
MIN_MIRRORED, FULL_MIRRORED = 0.05, 0.15  # specular albedo, between which more and more of it goes on
SHARP_ROUGHNESS, BROAD_ROUGHNESS = 0.1, 0.3  # perceptual, between which less and less of it does,
SHARP_HIGHLIGHT, BROAD_HIGHLIGHT = 0.05, 0.15  # and of light of lamps
LOBE_WIDTH = 0.5  # of the squared roughness, growth of a ray that is one of many, as in reflection_march.frag
TRIM = 0.98  # of the lobe, as in shaders/include/visible_normals.glsl
MIN_COSINE = 1e-3


@dataclass(frozen=True, eq=False)
class OnwardRays:
    """Rays that go on from some ends, with M hits in all.

    Attributes
    ----------
    hits : Hits
        Where they end, and some of what they pass; with as much emission of light proxies as the first end's direct
        light leaves out.
    share : ndarray, float32, shape (M, 3)
        Of the radiance of each hit, what goes back along the ray that met the first end.
    end : ndarray of int, shape (M,)
        That first end.
    direction : ndarray, float32, shape (M, 3)
        Of the ray.
    left, left_for_direct : ndarray, float32, shape (M, 3)
        Of the first end's albedo for indirect and for direct light, what they don't stand for.
    """

    hits: Hits
    share: F32
    end: Ints
    direction: F32
    left: F32
    left_for_direct: F32


def go_on(caster: Caster, ends: Hits, direction: F32, beams: F32, u: F32) -> OnwardRays:
    """Let rays go on from where they end.

    Parameters
    ----------
    ends : Hits
        Of N rays, none of them the sky.
    direction, beams, u : ndarray, float32, shapes (N, 3), (N, 2) and (N, 2)
        Of the rays, of unit length; as of ``Caster.cast_through``; numbers in [0, 1) that choose where they go on.
    """
    lobes = caster.lobes(ends, BROAD_ROUGHNESS, direction, beams)
    cosine = np.maximum(-row_dots(direction, ends.normal), np.float32(MIN_COSINE))[:, None]
    mirrored = specular_albedo(lobes.f0, lobes.roughness, cosine)
    share = (_smoothstep(MIN_MIRRORED, FULL_MIRRORED, mirrored.max(axis=1, keepdims=True))
             * (1 - _smoothstep(SHARP_ROUGHNESS, BROAD_ROUGHNESS, lobes.roughness)))
    rows = np.flatnonzero(share > 0)
    share, f0, roughness = share.take(rows, axis=0), lobes.f0.take(rows, axis=0), lobes.roughness.take(rows, axis=0)
    normal, face = ends.normal.take(rows, axis=0), lobes.face.take(rows, axis=0)
    onward = reflected(-direction.take(rows, axis=0), normal, face, roughness, u.take(rows, axis=0))
    width = width_at(beams.take(rows, axis=0), ends.distance.take(rows))
    further = np.stack([width, beams.take(rows, axis=0)[:, 1] + LOBE_WIDTH * roughness[:, 0]**2], axis=1)
    met = caster.cast_through(ends.position.take(rows, axis=0) + caster.ray_epsilon * face, onward, further)
    at_mean = specular_albedo(f0, roughness, np.full_like(roughness, MEAN_COSINE))
    mirrored = share * mirrored.take(rows, axis=0)
    sharp = sharpness(roughness)
    albedo, ray = ends.albedo.take(rows, axis=0), met.ray
    left, for_direct = (np.minimum(albedo - part * share * at_mean, 1 - part * mirrored).clip(0) for part in (1, sharp))
    emission = met.hits.traced_emission + sharp.take(ray, axis=0) * met.hits.emission_of(light_proxies=True)
    return OnwardRays(replace(met.hits, emission=emission), mirrored.take(ray, axis=0) * met.share, rows.take(ray),
                      onward.take(ray, axis=0), left.take(ray, axis=0), for_direct.take(ray, axis=0))


def of_highlights(caster: Caster, hits: Hits) -> F32:
    """Of the albedo at N hits what stands for highlights of smooth surfaces, which are small spots; shape (N, 3)."""
    lobes = caster.lobes(hits, BROAD_HIGHLIGHT)
    return sharpness(lobes.roughness) * specular_albedo(lobes.f0, lobes.roughness,
                                                        np.full_like(lobes.roughness, MEAN_COSINE))


def sharpness(roughness: F32) -> F32:
    """How far highlights of lamps on a surface are their mirror images."""
    return 1 - _smoothstep(SHARP_HIGHLIGHT, BROAD_HIGHLIGHT, roughness)


def _smoothstep(low: float, high: float, x: F32) -> F32:
    t = ((x - np.float32(low)) / np.float32(high - low)).clip(0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def reflected(v: F32, n: F32, face: F32, roughness: F32, u: F32) -> F32:
    """Directions of N reflected rays above the faces, by the visible normals of GGX (Heitz 2018, section 3).

    Parameters
    ----------
    v, n, face : ndarray, float32, shape (N, 3)
        Unit vectors to the viewer, and of the shading and the face normal on its side.
    """
    alpha = np.maximum(roughness * roughness, np.float32(MIN_ALPHA))
    side = unit_rows(np.where(np.abs(n[:, 2:]) < 0.9, np.stack([-n[:, 1], n[:, 0], 0 * n[:, 0]], 1),
                              np.stack([0 * n[:, 0], -n[:, 2], n[:, 1]], 1)))
    up = np.cross(n, side)
    local = np.stack([row_dots(v, side), row_dots(v, up), np.maximum(row_dots(v, n), np.float32(MIN_COSINE))], 1)
    stretched = unit_rows(np.concatenate([alpha * local[:, :2], local[:, 2:]], axis=1))
    sine = row_dots(stretched[:, :2], stretched[:, :2])[:, None]
    first = np.where(sine > 1e-12, np.stack([-stretched[:, 1], stretched[:, 0], 0 * sine[:, 0]], 1)
                     / np.sqrt(np.maximum(sine, 1e-12)), np.array([1, 0, 0], np.float32))
    second = np.cross(stretched, first)
    radius, angle = np.sqrt(TRIM * u[:, :1]), 2 * np.pi * u[:, 1:]
    upper, a = 0.5 * (1 + stretched[:, 2:]), radius * np.cos(angle)
    b = (1 - upper) * np.sqrt(1 - a * a) + upper * radius * np.sin(angle)
    h = a * first + b * second + np.sqrt(np.maximum(1 - a * a - b * b, 0)) * stretched
    h = unit_rows(np.concatenate([alpha * h[:, :2], np.maximum(h[:, 2:], 1e-6)], axis=1))
    h = h[:, :1] * side + h[:, 1:2] * up + h[:, 2:] * n
    out = 2 * row_dots(v, h)[:, None] * h - v
    height = row_dots(out, face)[:, None]
    return unit_rows(np.where(height < 0, out - 2 * height * face, out)).astype(np.float32)
