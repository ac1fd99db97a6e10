"""Unbounced environment light, traced: on white diffuse surfaces, and as reflected by GGX lobes."""

from dataclasses import dataclass

import drjit as dr

from app.arrays import F32, F64
from app.math3d import View
from app.scene import Scene
from export.reference.ggx import GgxLobe
from export.reference.lambert import LambertLobe
from export.reference.layers import Layers
from export.reference.path_tracer import PathTracer, evaluate


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
        What the renderer multiplies ``specular`` by, as in shaders/include/specular_albedo.glsl.
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

    def shade(self, view: View, pixels: F64, seed: int) -> EnvironmentSamples:
        """One sample through each point of the image, shape (N, 2) in [0, 1], x to the right, y down."""
        mi, scene = self._mi, self.scene
        sampler, ray = self._camera_rays(view, pixels, seed)
        seen, _ = self._intersect(scene.meshes, ray, True, sampler, self._passes_to_opaque)
        hit, si = seen.is_valid(), seen.si
        surface = scene.surfaces.at(seen, hit)
        normal, v = surface.normal, -dr.normalize(ray.d)
        sources = [] if self._sky is None else [self._sky]
        diffuse = self._unbounced(sources, si, LambertLobe(mi, normal), sampler, hit)
        has_specular = dr.max(surface.f0) > 0  # an F0 of 0 means no specular reflection, not even at grazing angles
        lobe = GgxLobe(mi, normal, v, surface.f0, surface.roughness)
        specular, with_fresnel = mi.Color3f(0.0), mi.Color3f(0.0)
        for source in sources:
            for l, light in self._lobe_samples(source, si, lobe, sampler, hit):  # noqa: E741
                reflected = dr.select(light > 0, light * lobe.eval(l), 0.0)
                specular += reflected
                with_fresnel += dr.select(has_specular, reflected * lobe.tint(l), 0.0)
        albedo = Layers(mi, scene.surfaces, surface, v).albedo
        depth = si.t / dr.opaque(mi.Float, scene.scale)
        return EnvironmentSamples(*evaluate(hit, diffuse, specular, with_fresnel, albedo, lobe.reflectance(),
                                            normal, depth))
