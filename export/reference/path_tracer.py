"""A path tracer: Mitsuba's intersections and textures in a loop over bounces.

Diffuse light is demodulated by construction: the primary surface reflects with an albedo of 1, so radiance / albedo
needs no division by a dark albedo. The surface that the camera sees also reflects unbounced light by its GGX lobe. All
other reflections are diffuse, as in the renderer's model: indirect light has no highlights, and highlights show no
surface that does not emit.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F32, F64
from app.math3d import View
from app.scene import Scene
from export.reference.analytic_lights import AnalyticLights
from export.reference.ggx import GgxLobe
from export.reference.lambert import LambertLobe
from export.reference.light_sources import EmissiveMeshes, LightSource, Sky, power_heuristic
from export.reference.mitsuba_module import load_mitsuba
from export.reference.mitsuba_scene import EXTENT, convert_scene
from export.reference.still import Still

MAX_BOUNCES = 16
MAX_RAYS = 2**20        # traced at once, which bounds the memory
MAX_MASKED_LAYERS = 16  # masked surfaces that a ray can pass
ROULETTE_DEPTH = 4      # bounces before Russian roulette begins
SHADOW_EPSILON = 1e-3   # of the distance to a light: what lies closer to the light does not block it


@dataclass(frozen=True, eq=False)
class Samples:
    """One sample for each of N camera rays; 0 where a ray hits nothing.

    Attributes
    ----------
    direct, single, multi : ndarray, float32, shape (N, 3)
        Radiance / albedo in W/(sr m²): unbounced, by one bounce, and by all bounces. For unbounced light from emissive
        meshes other than light proxies see ``PathTracer``.
    albedo : ndarray, float32, shape (N, 3)
    normal : ndarray, float32, shape (N, 3)
        World-space shading normal on the camera's side of the surface.
    depth : ndarray, float32, shape (N,)
        Distance along the camera's -z in scene units.
    """

    direct: F32
    single: F32
    multi: F32
    albedo: F32
    normal: F32
    depth: F32


@dataclass(frozen=True, eq=False)
class RadianceSamples:
    """One sample of the radiance that reaches the camera along each of N rays, float32, shape (N, 3).

    Attributes
    ----------
    emitted : ndarray
        Emission of the visible surface; the environment where no surface is visible. W/(sr m²), as is ``reflected``.
    reflected : ndarray
        Diffuse light of all bounces, and highlights.
    albedo, normal : ndarray
        As in ``Samples``.
    """

    emitted: F32
    reflected: F32
    albedo: F32
    normal: F32


def average_samples(trace: Callable[[View, F64, int], Any], still: Still, points: F64, spp: int, seed: int) -> Any:
    """Means of ``spp`` samples, as ``trace`` returns them, through each point of the image, shape (N, 2)."""
    batch_spp = max(1, MAX_RAYS // len(points))
    sums: dict[str, Any] = {}
    for batch, begin in enumerate(range(0, spp, batch_spp)):
        count = min(batch_spp, spp - begin)
        samples = trace(still.view, np.tile(points, (count, 1)), seed * 2**8 + batch)
        for f in fields(samples):
            values = getattr(samples, f.name)
            total = values.reshape(count, len(points), *values.shape[1:]).sum(axis=0, dtype=np.float64)
            sums[f.name] = sums.get(f.name, 0.0) + total
    return type(samples)(**{name: (total / spp).astype(np.float32) for name, total in sums.items()})


class PathTracer:
    """Traces a scene at one time, from any camera.

    Parameters
    ----------
    time : float
        Seconds; places moving objects.
    max_bounces : int
        Of indirect light; 0 traces direct light only.
    emission_is_direct : bool
        Whether unbounced light of emissive meshes that are no light proxies is direct light; otherwise it counts as
        bounced once, as in the renderer, which leaves it to the network.

    Attributes
    ----------
    scene : MitsubaScene
    max_bounces : int
    notices : tuple of str
        What is rendered differently from the renderer.

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """

    def __init__(self, scene: Scene, time: float = 0.0, max_bounces: int = MAX_BOUNCES,
                 emission_is_direct: bool = True) -> None:
        mi = self._mi = load_mitsuba()
        converted = self.scene = convert_scene(scene, time)
        self.max_bounces = max_bounces
        self._has_specular = any(material.has_specular for material in scene.materials)
        self.notices = converted.notices
        occluders, analytic = converted.shadow_casters, scene.exact_lights
        lights = (AnalyticLights(mi, analytic, converted.origin, converted.scale, EXTENT, occluders) if analytic
                  else None)
        approximated, emissive = (None if meshes is None else EmissiveMeshes(mi, meshes, occluders)
                                  for meshes in (converted.approximated, converted.emissive))
        self._sky = None if converted.environment is None else Sky(mi, converted.environment, converted.meshes)
        direct = (lights, self._sky, approximated, emissive if emission_is_direct else None)
        self._direct: list[LightSource] = [source for source in direct if source is not None]
        self._indirect: list[LightSource] = [] if emission_is_direct or emissive is None else [emissive]

    def trace(self, view: View, pixels: F64, seed: int) -> Samples:
        """Trace one path of diffuse light through each point of the image.

        Parameters
        ----------
        pixels : ndarray, float64, shape (N, 2)
            Image positions in [0, 1], x to the right, y down.
        """
        sampler, ray = self._camera_rays(view, pixels, seed)
        si = self._intersect(self.scene.meshes, ray)
        hit = si.is_valid()
        normal = shading_normal(si)
        direct, single, multi = self._diffuse(si, normal, sampler, hit)
        # The rays' z is -1 in camera space, so t is the depth.
        depth = si.t / dr.opaque(self._mi.Float, self.scene.scale)
        return Samples(*evaluate(hit, direct, single, multi, albedo(si, hit), normal, depth))

    def trace_radiance(self, view: View, pixels: F64, seed: int) -> RadianceSamples:
        """Trace one path of all light through each point of the image, given as for ``trace``."""
        mi = self._mi
        sampler, ray = self._camera_rays(view, pixels, seed)
        si = self._intersect(self.scene.meshes, ray)
        hit = si.is_valid()
        normal = shading_normal(si)
        direct, _, multi = self._diffuse(si, normal, sampler, hit)
        reflected = albedo(si, hit) * (direct + multi)
        if self._has_specular:
            reflected += self._specular(si, normal, -dr.normalize(ray.d), sampler, hit)
        on_surface = (dr.select(hit, x, 0.0) for x in (reflected, albedo(si, hit), normal))
        everywhere = dr.full(mi.Bool, True, len(pixels))
        return RadianceSamples(*evaluate(everywhere, self._emission(ray, si), *on_surface))

    def _camera_rays(self, view: View, pixels: F64, seed: int) -> tuple[Any, Any]:
        """A sampler, and rays through points of the image, whose z is -1 in camera space."""
        mi, scene = self._mi, self.scene
        sampler = mi.load_dict({"type": "independent"})
        # Opaque values and one buffer: other literals or alignments would compile the kernel again.
        sampler.seed(dr.opaque(mi.UInt32, seed), len(pixels))
        image = (2 * pixels - 1) * (1, -1) * view.tan_half
        towards = np.concatenate([image, np.full((len(pixels), 1), -1.0)], axis=1) @ view.rotation
        origin = [dr.opaque(mi.Float, x) for x in ((view.eye - scene.origin) * scene.scale).tolist()]
        return sampler, mi.Ray3f(mi.Point3f(*origin),
                                 dr.unravel(mi.Vector3f, mi.Float(towards.astype(np.float32).ravel())))

    def _emission(self, ray: Any, si: Any) -> Any:
        """Emission towards the camera of the surface ``si``; the environment where there is none."""
        mi, emitters = self._mi, self.scene.visible_emitters
        hit, radiance = si.is_valid(), mi.Color3f(0.0)
        if emitters is not None:
            up_to_surface = mi.Ray3f(ray)
            up_to_surface.maxt = dr.select(hit, si.t, 0)
            emitter = self._intersect(emitters, up_to_surface, hit)  # slightly above its mesh
            seen = emitter.is_valid()
            radiance = dr.select(seen, emitter.emitter(emitters, seen).eval(emitter, seen), 0.0)
        return radiance if self._sky is None else dr.select(hit, radiance, self._sky.radiance(dr.normalize(ray.d)))

    def _specular(self, si: Any, normal: Any, v: Any, sampler: Any, active: Any) -> Any:
        """Unbounced light that the GGX lobe reflects along ``v``."""
        mi = self._mi
        f0, roughness = specular_of(si, active)
        active = active & (dr.max(f0) > 0)  # an F0 of 0 means no specular reflection, not even at grazing angles
        lobe, radiance = GgxLobe(mi, normal, v, f0, roughness), mi.Color3f(0.0)
        for source in (*self._direct, *self._indirect):
            for l, light in self._lobe_samples(source, si, lobe, sampler, active):  # noqa: E741
                radiance += dr.select(light > 0, light * lobe.eval(l) * lobe.fresnel(l), 0.0)
        return radiance

    @dr.syntax
    def _diffuse(self, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """Light that reaches a white diffuse surface unbounced, by one bounce, and by all bounces."""
        mi = self._mi
        direct = self._unbounced(self._direct, si, normal, sampler, active)
        single, multi = mi.Color3f(0.0), mi.Color3f(0.0)
        if dr.hint(self.max_bounces > 0, mode="scalar"):
            single += self._unbounced(self._indirect, si, normal, sampler, active)
            multi += single
            throughput, bounce = mi.Color3f(1.0), mi.UInt32(0)
            si, normal, active = type(si)(si), mi.Normal3f(normal), mi.Bool(active)
            while active:
                ray = si.spawn_ray(LambertLobe(mi, normal).sample(sampler.next_2d()))
                si = self._intersect(self.scene.meshes, ray)
                active &= si.is_valid()
                normal = shading_normal(si)
                throughput *= albedo(si, active)
                light = throughput * self._unbounced(self._direct, si, normal, sampler, active)
                emitted = throughput * self._unbounced(self._indirect, si, normal, sampler, active)
                multi += dr.select(active, light + emitted, 0.0)
                single += dr.select(active & (bounce == 0), light, 0.0)
                bounce += 1
                survival = dr.select(bounce < ROULETTE_DEPTH, 1.0, dr.minimum(dr.max(throughput), 0.95))
                active &= (bounce < self.max_bounces) & (sampler.next_1d() < survival)
                throughput /= dr.maximum(survival, 1e-6)
        return direct, single, multi

    def _unbounced(self, sources: Sequence[LightSource], si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """Light of ``sources`` that a white diffuse surface reflects without further bounces."""
        lobe, radiance = LambertLobe(self._mi, normal), self._mi.Color3f(0.0)
        for source in sources:
            samples = ([self._light_sample(source, si, sampler, active)] if source.bounded
                       else self._lobe_samples(source, si, lobe, sampler, active))
            for l, light in samples:  # noqa: E741
                radiance += dr.select(light > 0, light * lobe.eval(l), 0.0)
        return radiance

    def _lobe_samples(self, source: LightSource, si: Any, lobe: Any, sampler: Any,
                      active: Any) -> Iterator[tuple[Any, Any]]:
        """Multiple importance sampling of the source and the lobe: directions, and radiance / density from there."""
        yield self._light_sample(source, si, sampler, active, lobe)
        l = lobe.sample(sampler.next_2d(active))  # noqa: E741
        pdf = lobe.pdf(l)
        active = active & (pdf > 0) & (dr.dot(face_normal(si), l) > 0)
        distance = self._mi.Float(dr.inf)
        if source.occluders is not None:
            occluder = self._intersect(source.occluders, si.spawn_ray(l), active)
            distance = dr.select(occluder.is_valid(), occluder.t * (1 + SHADOW_EPSILON), dr.inf)
        yield l, dr.select(active, source.along(si, l, distance, pdf, active) / pdf, 0.0)

    def _light_sample(self, source: LightSource, si: Any, sampler: Any, active: Any,
                      lobe: Any = None) -> tuple[Any, Any]:
        """One direction of the source's light, and radiance / density, weighted if the lobe is sampled too."""
        sample = source.sample(si, sampler, active)
        weight = sample.weight
        if lobe is not None:
            weight = weight * dr.select(sample.pdf > 0, power_heuristic(sample.pdf, lobe.pdf(sample.d)), 1.0)
        active = active & (dr.dot(face_normal(si), sample.d) > 0) & (dr.max(weight) > 0)
        ray = si.spawn_ray(sample.d)
        ray.maxt = sample.distance * (1 - SHADOW_EPSILON)
        active &= ~self._is_occluded(ray, active, source.occluders)
        return sample.d, dr.select(active, weight, 0.0)

    def _is_occluded(self, ray: Any, active: Any, meshes: Any) -> Any:
        if meshes is None:
            return self._mi.Bool(False)
        return self._intersect(meshes, ray, active).is_valid() if self.scene.masked else meshes.ray_test(ray, active)

    @dr.syntax
    def _intersect(self, meshes: Any, ray: Any, active: Any = True) -> Any:
        """The first surface along the rays, which pass the holes of masked surfaces."""
        si = meshes.ray_intersect(ray, active)
        if dr.hint(self.scene.masked, mode="scalar"):
            through = self._is_hole(si)
            passed, layer = self._mi.Float(0.0), self._mi.UInt32(0)
            while through & (layer < MAX_MASKED_LAYERS):
                passed += si.t
                onward = si.spawn_ray(ray.d)
                onward.maxt = ray.maxt - passed
                si = meshes.ray_intersect(onward, through)
                through = self._is_hole(si)
                layer += 1
            si.t += passed
        return si

    def _is_hole(self, si: Any) -> Any:
        hit = si.is_valid()
        return hit & (si.bsdf().eval_null_transmission(si, hit).x > 0.5)


def evaluate(active: Any, *outputs: Any) -> list[F32]:
    """The outputs as arrays, 0 where not active; in one kernel, or each output would trace the paths again."""
    selected = [dr.select(active, x, 0.0) for x in outputs]
    dr.eval(selected)
    return [np.array(x, np.float32).T for x in selected]


# Quantities at a Mitsuba surface interaction, on the side of the face that the ray came from.


def albedo(si: Any, active: Any) -> Any:
    return si.bsdf().eval_diffuse_reflectance(si, active)


def face_normal(si: Any) -> Any:
    return dr.select(dr.dot(si.n, si.to_world(si.wi)) > 0, si.n, -si.n)


def shading_normal(si: Any) -> Any:
    return dr.select(dr.dot(si.sh_frame.n, face_normal(si)) < 0, -si.sh_frame.n, si.sh_frame.n)


def specular_of(si: Any, active: Any) -> tuple[Any, Any]:
    """Reflectance at normal incidence, and perceptual roughness; 0 if not active."""
    return si.shape.eval_attribute_3("face_f0", si, active), si.shape.eval_attribute_1("face_roughness", si, active)
