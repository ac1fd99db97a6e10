"""Unbounced environment light, traced: on white diffuse surfaces, and as reflected by GGX lobes."""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F32, F64
from app.math3d import View
from app.scene import Scene
from export.reference.path_tracer import PathTracer, albedo, face_normal, shading_normal

MIN_ALPHA = 2e-3  # of GGX, as in shaders/include/ggx_lobe.glsl


@dataclass(frozen=True, eq=False)
class EnvironmentSamples:
    """One sample for each of N camera rays; 0 where a ray hits nothing. Light is in W/(sr m²).

    Attributes
    ----------
    diffuse : ndarray, float32, shape (N, 3)
        Irradiance / π.
    specular : ndarray, float32, shape (N, 3)
        Radiance reflected by the GGX lobe of the material's roughness, without the Fresnel factor (F = 1).
    specular_with_fresnel : ndarray, float32, shape (N, 3)
        The same with Schlick's approximation of the Fresnel factor.
    reflectance : ndarray, float32, shape (N, 3)
        What the renderer multiplies ``specular`` by, as in shaders/include/ggx.glsl.
    albedo, normal, depth : ndarray
        As in ``Samples``.
    """

    diffuse: F32
    specular: F32
    specular_with_fresnel: F32
    albedo: F32
    reflectance: F32
    normal: F32
    depth: F32


class EnvironmentTracer(PathTracer):
    """Traces a scene's environment at one time, from any camera; ``trace`` includes the scene's other lights.

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """

    def __init__(self, scene: Scene, time: float = 0.0) -> None:
        super().__init__(scene, time, max_bounces=1)
        for shape, instance in zip(self._scene.meshes.shapes(), scene.instances, strict=True):
            mesh = scene.meshes[instance.mesh]
            material, corners = scene.materials[mesh.material], shape.vertex_count()
            shape.add_attribute("vertex_f0", 3, np.tile(np.asarray(material.specular, np.float32), corners))
            shape.add_attribute("vertex_roughness", 1, np.full(corners, material.roughness, np.float32))

    def shade(self, view: View, pixels: F64, seed: int) -> EnvironmentSamples:
        """One sample through each point of the image, shape (N, 2) in [0, 1], x to the right, y down."""
        mi, scene = self._mi, self._scene
        sampler, ray = self._camera_rays(view, pixels, seed)
        si = self._intersect(scene.meshes, ray)
        hit = si.is_valid()
        normal = shading_normal(si)
        diffuse = self._sample_light(scene.environment, scene.meshes, si, normal, sampler, hit)
        v = -dr.normalize(ray.d)
        f0 = si.shape.eval_attribute_3("vertex_f0", si, hit)
        roughness = si.shape.eval_attribute_1("vertex_roughness", si, hit)
        specular, with_fresnel = self._sample_lobe(si, normal, v, f0, roughness, sampler, hit)
        grazing = dr.maximum(1 - roughness, f0) - f0
        has_specular = dr.max(f0) > 0  # an F0 of 0 means no specular reflection, not even at grazing angles
        reflectance = dr.select(has_specular, f0 + grazing * dr.power(1 - dr.maximum(dr.dot(normal, v), 0), 5), 0.0)
        with_fresnel = dr.select(has_specular, with_fresnel, 0.0)
        outputs = [dr.select(hit, x, 0.0) for x in (diffuse, specular, with_fresnel, albedo(si, hit), reflectance,
                                                    normal, si.t / dr.opaque(mi.Float, scene.scale))]
        dr.eval(outputs)
        return EnvironmentSamples(*[np.array(x, np.float32).T for x in outputs])

    def _sample_lobe(self, si: Any, normal: Any, v: Any, f0: Any, roughness: Any, sampler: Any,
                     active: Any) -> tuple[Any, Any]:
        """Light reflected by the lobe, without and with the Fresnel factor.

        Combines one direction sampled from the environment with one sampled from the lobe by the balance heuristic
        (Veach and Guibas 1995).
        """
        mi, emitters = self._mi, self._scene.environment
        if emitters is None:
            return mi.Color3f(0.0), mi.Color3f(0.0)
        alpha = dr.maximum(roughness * roughness, MIN_ALPHA)
        n_v = dr.maximum(dr.dot(normal, v), 1e-3)
        specular, with_fresnel = mi.Color3f(0.0), mi.Color3f(0.0)
        environment = emitters.environment()

        def add(light: Any, pdf: Any, l: Any) -> None:  # noqa: E741
            nonlocal specular, with_fresnel
            h = dr.normalize(l + v)
            n_l, n_h, v_h = dr.dot(normal, l), dr.dot(normal, h), dr.dot(v, h)
            lit = active & (n_l > 0) & (dr.dot(face_normal(si), l) > 0) & (pdf > 0)
            lit &= ~self._is_occluded(si.spawn_ray(l), lit, self._scene.meshes)
            reflected = dr.select(lit, light * n_l * _ggx_lobe(n_h, n_v, n_l, alpha) / pdf, 0.0)
            specular += reflected
            with_fresnel += reflected * (f0 + (1 - f0) * dr.power(1 - dr.clip(v_h, 0, 1), 5))

        def lobe_pdf(l: Any) -> Any:  # noqa: E741
            h = dr.normalize(l + v)
            n_h = dr.maximum(dr.dot(normal, h), 0)
            return _ggx_distribution(n_h, alpha) * n_h / (4 * dr.maximum(dr.dot(v, h), 1e-6))

        def environment_pdf(l: Any) -> Any:  # noqa: E741
            towards = dr.zeros(mi.DirectionSample3f, dr.width(l))
            towards.d = l
            return environment.pdf_direction(si, towards, active)

        sample, weight = emitters.sample_emitter_direction(si, sampler.next_2d(active), False, active)
        add(weight * sample.pdf, sample.pdf + lobe_pdf(sample.d), sample.d)
        l = _sample_reflection(mi, normal, v, alpha, sampler.next_2d(active))  # noqa: E741
        escaped = dr.zeros(type(si), dr.width(l))
        escaped.wi = -l
        add(environment.eval(escaped, active), lobe_pdf(l) + environment_pdf(l), l)
        return specular, with_fresnel


def _sample_reflection(mi: Any, normal: Any, v: Any, alpha: Any, u: Any) -> Any:
    """The view direction reflected at a microfacet that is sampled from the GGX distribution."""
    cosine = dr.sqrt((1 - u.x) / (1 + (alpha * alpha - 1) * u.x))
    sine = dr.sqrt(dr.maximum(1 - cosine * cosine, 0))
    phi = 2 * dr.pi * u.y
    h = mi.Frame3f(normal).to_world(mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), cosine))
    return 2 * dr.dot(v, h) * h - v


def _ggx_lobe(n_h: Any, n_v: Any, n_l: Any, alpha: Any) -> Any:
    """As ``ggx_lobe`` in shaders/include/ggx_lobe.glsl."""
    a2 = alpha * alpha
    smith = n_l * dr.sqrt(n_v * n_v * (1 - a2) + a2) + n_v * dr.sqrt(n_l * n_l * (1 - a2) + a2)
    return _ggx_distribution(n_h, alpha) * 0.5 / dr.maximum(smith, 1e-6)


def _ggx_distribution(n_h: Any, alpha: Any) -> Any:
    """Density of microfacet normals (Trowbridge and Reitz 1975)."""
    q = n_h * n_h * (alpha * alpha - 1) + 1
    return alpha * alpha / (dr.pi * q * q)
