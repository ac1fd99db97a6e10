"""What comes straight from an environment, traced: light on white surfaces, and what GGX lobes gather."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from app.math3d import View
from app.scene import Scene
from export.reference.path_tracer import PathTracer, _albedo, _facing, _facing_normal
from export.reference.still import RAYS_AT_ONCE, Still

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

SHARPEST = 2e-3  # alpha, as in shaders/include/ggx_lobe.glsl


@dataclass(frozen=True, eq=False)
class EnvironmentSamples:
    """One sample for each of N camera rays; 0 where a ray meets nothing. Light in W/(sr m²).

    Attributes
    ----------
    diffuse : ndarray, float32, shape (N, 3)
        Irradiance / π.
    specular : ndarray, float32, shape (N, 3)
        Radiance that a surface of the material's roughness would send if it reflected all light, without Fresnel's law.
    highlight : ndarray, float32, shape (N, 3)
        Radiance that it does send, by Schlick's approximation.
    albedo : ndarray, float32, shape (N, 3)
    reflectance : ndarray, float32, shape (N, 3)
        What the renderer multiplies ``specular`` by, as in shaders/include/ggx.glsl.
    normal : ndarray, float32, shape (N, 3)
        Shading normal in world space on the camera's side.
    depth : ndarray, float32, shape (N,)
        Distance along the camera's -z in scene units.
    """

    diffuse: F32
    specular: F32
    highlight: F32
    albedo: F32
    reflectance: F32
    normal: F32
    depth: F32


class EnvironmentTracer(PathTracer):
    """Traces a scene's environment at one moment, from any camera; what lights the scene otherwise counts in ``trace``.

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """

    def __init__(self, scene: Scene, moment: float = 0.0) -> None:
        super().__init__(scene, moment, max_bounces=1)
        shapes = self._scene.seen.shapes()
        assert len(shapes) == len(scene.instances)
        for shape, instance in zip(shapes, scene.instances, strict=True):
            mesh = scene.meshes[instance.mesh]
            material, corners = scene.materials[mesh.material], shape.vertex_count()
            assert corners == mesh.triangles.size
            shape.add_attribute("vertex_f0", 3, np.tile(np.asarray(material.specular, np.float32), corners))
            shape.add_attribute("vertex_roughness", 1, np.full(corners, material.roughness, np.float32))

    def shade(self, view: View, pixels: F64, seed: int) -> EnvironmentSamples:
        """One sample through each point of the image, shape (N, 2) in [0, 1], x to the right, y down."""
        mi, scene = self._mi, self._scene
        sampler, ray = self._camera_rays(view, pixels, seed)
        si = self._intersect(scene.seen, ray)
        hit = si.is_valid()
        normal = _facing_normal(si)
        diffuse = self._light_from(scene.sky, si, normal, sampler, hit, scene.seen)
        v = -dr.normalize(ray.d)
        f0 = si.shape.eval_attribute_3("vertex_f0", si, hit)
        roughness = si.shape.eval_attribute_1("vertex_roughness", si, hit)
        specular, highlight = self._gathered(si, normal, v, f0, roughness, sampler, hit)
        rim = dr.maximum(1 - roughness, f0) - f0
        has_specular = dr.max(f0) > 0  # other materials have no highlight at all
        reflectance = dr.select(has_specular, f0 + rim * dr.power(1 - dr.maximum(dr.dot(normal, v), 0), 5), 0.0)
        highlight = dr.select(has_specular, highlight, 0.0)
        found = [dr.select(hit, x, 0.0) for x in (diffuse, specular, highlight, _albedo(si, hit), reflectance, normal,
                                              si.t / dr.opaque(mi.Float, scene.scale))]
        dr.eval(found)
        return EnvironmentSamples(*[np.array(x, np.float32).T for x in found])

    def _gathered(self, si: Any, normal: Any, v: Any, f0: Any, roughness: Any, sampler: Any,
                  active: Any) -> tuple[Any, Any]:
        """The lobe's light without and with Fresnel's law: one direction of the sky's, and one of the lobe's own.

        The balance heuristic joins both (Veach and Guibas 1995).
        """
        mi, sky = self._mi, self._scene.sky
        if sky is None:
            return mi.Color3f(0.0), mi.Color3f(0.0)
        alpha = dr.maximum(roughness * roughness, SHARPEST)
        n_v = dr.maximum(dr.dot(normal, v), 1e-3)
        specular, highlight = mi.Color3f(0.0), mi.Color3f(0.0)
        environment = sky.environment()

        def add(light: Any, density: Any, l: Any) -> None:  # noqa: E741
            nonlocal specular, highlight
            h = dr.normalize(l + v)
            n_l, n_h, v_h = dr.dot(normal, l), dr.dot(normal, h), dr.dot(v, h)
            lit = active & (n_l > 0) & (dr.dot(_facing(si), l) > 0) & (density > 0)
            lit &= ~self._blocked(si.spawn_ray(l), lit, self._scene.seen)
            found = dr.select(lit, light * n_l * _lobe(n_h, n_v, n_l, alpha) / density, 0.0)
            specular += found
            highlight += found * (f0 + (1 - f0) * dr.power(1 - dr.clip(v_h, 0, 1), 5))

        def density_of_lobe(l: Any) -> Any:  # noqa: E741
            h = dr.normalize(l + v)
            n_h = dr.maximum(dr.dot(normal, h), 0)
            return _distribution(n_h, alpha) * n_h / (4 * dr.maximum(dr.dot(v, h), 1e-6))

        def density_of_sky(l: Any) -> Any:  # noqa: E741
            towards = dr.zeros(mi.DirectionSample3f, dr.width(l))
            towards.d = l
            return environment.pdf_direction(si, towards, active)

        sample, weight = sky.sample_emitter_direction(si, sampler.next_2d(active), False, active)
        add(weight * sample.pdf, sample.pdf + density_of_lobe(sample.d), sample.d)
        l = _mirrored(mi, normal, v, alpha, sampler.next_2d(active))  # noqa: E741
        seen = dr.zeros(type(si), dr.width(l))
        seen.wi = -l
        add(environment.eval(seen, active), density_of_lobe(l) + density_of_sky(l), l)
        return specular, highlight


def mean_shaded(tracer: EnvironmentTracer, still: Still, points: F64, spp: int, seed: int) -> EnvironmentSamples:
    """Means of ``spp`` samples through each point of the image, shape (N, 2)."""
    at_once = max(1, RAYS_AT_ONCE // len(points))
    total: dict[str, Any] = dict.fromkeys((f.name for f in fields(EnvironmentSamples)), 0.0)
    for batch, begin in enumerate(range(0, spp, at_once)):
        count = min(at_once, spp - begin)
        samples = tracer.shade(still.view, np.tile(points, (count, 1)), seed * 2**8 + batch)
        for name in total:
            found = getattr(samples, name)
            total[name] += found.reshape(count, len(points), *found.shape[1:]).sum(axis=0, dtype=np.float64)
    return EnvironmentSamples(**{name: (x / spp).astype(np.float32) for name, x in total.items()})


def _mirrored(mi: Any, normal: Any, v: Any, alpha: Any, u: Any) -> Any:
    """The view direction mirrored at a microfacet, as often as there are such."""
    cosine = dr.sqrt((1 - u.x) / (1 + (alpha * alpha - 1) * u.x))
    sine = dr.sqrt(dr.maximum(1 - cosine * cosine, 0))
    turn = 2 * dr.pi * u.y
    h = mi.Frame3f(normal).to_world(mi.Vector3f(sine * dr.cos(turn), sine * dr.sin(turn), cosine))
    return 2 * dr.dot(v, h) * h - v


def _lobe(n_h: Any, n_v: Any, n_l: Any, alpha: Any) -> Any:
    """As ``ggx_lobe`` in shaders/include/ggx_lobe.glsl."""
    a2 = alpha * alpha
    smith = n_l * dr.sqrt(n_v * n_v * (1 - a2) + a2) + n_v * dr.sqrt(n_l * n_l * (1 - a2) + a2)
    return _distribution(n_h, alpha) * 0.5 / dr.maximum(smith, 1e-6)


def _distribution(n_h: Any, alpha: Any) -> Any:
    """Trowbridge and Reitz's."""
    q = n_h * n_h * (alpha * alpha - 1) + 1
    return alpha * alpha / (dr.pi * q * q)
