"""A path tracer: Mitsuba's intersections and textures in a loop over bounces.

Diffuse light is demodulated by construction: the primary surface reflects with an albedo of 1, so radiance / albedo
needs no division by a dark albedo. All surfaces reflect by all of their lobes. After a rough reflection, what a path
meets is at least as rough, up to ``MIN_BOUNCED_ROUGHNESS``: else the few paths that a smooth surface sends to a small
light, which are its caustics, would be as bright as they are rare (Kaplanyan and Dachsbacher 2013, "Path Space
Regularization for Holistic and Robust Light Transport").
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F32, F64
from app.math3d import View
from app.scene import DirectionalLight, Scene
from export.reference.analytic_lights import AnalyticLights
from export.reference.lambert import LambertLobe
from export.reference.layers import ChosenLobe, Layers
from export.reference.light_sources import EmissiveMeshes, LightSource, Sky, power_heuristic
from export.reference.mitsuba_module import load_mitsuba
from export.reference.mitsuba_scene import EXTENT, convert_scene
from export.reference.still import Still
from export.reference.surfaces import Hit, Surface, face_normal

MAX_BOUNCES = 16
MAX_RAYS = 2**20        # traced at once, which bounds the memory
MIN_COSINE = 0.05       # between a ray and a surface that it leaves
MAX_LAYERS = 16         # surfaces that a ray can pass
ROULETTE_DEPTH = 4      # bounces before Russian roulette begins
MIN_BOUNCED_ROUGHNESS = 0.3  # of what is met after a reflection that is rougher
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
        Below a clearcoat and a sheen.
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
        Diffuse and glossy light of all bounces.
    albedo : ndarray
        Of the first surface, with its reflectance at normal incidence, so that a denoiser sees what metals reflect.
    normal : ndarray
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
        self.notices = converted.notices
        occluders = converted.shadow_casters

        def analytic(are_suns: bool, occluders: Any) -> AnalyticLights | None:
            lights = [light for light in scene.exact_lights if isinstance(light, DirectionalLight) == are_suns]
            return AnalyticLights(mi, lights, converted.origin, converted.scale, EXTENT, occluders) if lights else None

        approximated, emissive = (None if meshes is None else EmissiveMeshes(mi, meshes, occluders)
                                  for meshes in (converted.approximated, converted.emissive))
        self._sky = None if converted.environment is None else Sky(mi, converted.environment, converted.meshes)
        direct = (analytic(True, converted.meshes), analytic(False, occluders), self._sky, approximated,
                  emissive if emission_is_direct else None)
        self._direct: list[LightSource] = [source for source in direct if source is not None]
        self._indirect: list[LightSource] = [] if emission_is_direct or emissive is None else [emissive]

    def trace(self, view: View, pixels: F64, seed: int) -> Samples:
        """Trace one path of diffuse light through each point of the image, to the first opaque surface.

        Parameters
        ----------
        pixels : ndarray, float64, shape (N, 2)
            Image positions in [0, 1], x to the right, y down.
        """
        sampler, ray = self._camera_rays(view, pixels, seed)
        hit, _ = self._intersect(self.scene.meshes, ray, True, sampler, self._passes_to_opaque)
        active = hit.is_valid()
        surface = self.scene.surfaces.at(hit, active)
        direct, single, multi = self._diffuse(hit.si, surface.normal, sampler, active)
        # The rays' z is -1 in camera space, so t is the depth.
        depth = hit.si.t / dr.opaque(self._mi.Float, self.scene.scale)
        single, multi = surface.occlusion * single, surface.occlusion * multi
        albedo = Layers(self._mi, self.scene.surfaces, surface, -dr.normalize(ray.d)).albedo
        return Samples(*evaluate(active, direct, single, multi, albedo, surface.normal, depth))

    def trace_radiance(self, view: View, pixels: F64, seed: int) -> RadianceSamples:
        """Trace one path of all light through each point of the image, given as for ``trace``."""
        sampler, ray = self._camera_rays(view, pixels, seed)
        ray.d = dr.normalize(ray.d)
        everywhere = dr.full(self._mi.Bool, True, len(pixels))
        return RadianceSamples(*evaluate(everywhere, *self._seen(ray, sampler, everywhere)))

    @dr.syntax
    def _seen(self, ray: Any, sampler: Any, active: Any) -> Any:
        """Emitted and reflected light along the rays, albedo and normal of the first surface.

        Rays go on where light passes a surface: spread by its roughness into a volume and through a thin wall, without
        that out of a volume. How far the ray went through a volume is known where it leaves.
        """
        mi, surfaces = self._mi, self.scene.surfaces
        sky: Any = self._sky
        emitted, reflected, throughput = mi.Color3f(0.0), mi.Color3f(0.0), mi.Color3f(1.0)
        first_albedo, first_normal = mi.Color3f(0.0), mi.Normal3f(0.0)
        layer = mi.UInt32(0)
        while active:
            hit, _ = self._intersect(self.scene.meshes, ray, active, sampler, self._passes_uncovered)
            if dr.hint(sky is not None, mode="scalar"):
                emitted += dr.select(active & ~hit.is_valid(), throughput * sky.radiance(ray.d), 0.0)
            active &= hit.is_valid()
            surface = surfaces.at(hit, active)
            layers = Layers(mi, surfaces, surface, -ray.d)
            reflectance = dr.minimum(layers.albedo + layers.base_share * surface.f0, 1.0)
            first_albedo = dr.select(active & (layer == 0), reflectance, first_albedo)
            first_normal = dr.select(active & (layer == 0), surface.normal, first_normal)
            leaves, passes = mi.Bool(False), mi.Bool(False)
            if dr.hint(surfaces.has_transmission, mode="scalar"):
                leaves = active & surface.is_thick & ~surface.is_front & (surface.transmission > 0)
                throughput *= dr.select(leaves, dr.exp(-surface.extinction * hit.si.t), 1.0)
                passes = active & (leaves | (sampler.next_1d() < surface.transmission))
            shown = active & ~leaves
            emitted += dr.select(shown, throughput * layers.coat_share * surface.emission, 0.0)
            direct, _, multi = self._diffuse(hit.si, surface.normal, sampler, shown & ~passes)
            diffuse = layers.albedo * (direct + surface.occlusion * multi)
            reflected += dr.select(shown & ~passes, throughput * diffuse, 0.0)
            reflected += dr.select(shown, throughput * self._glossy(layers, hit.si, sampler, shown), 0.0)
            active = mi.Bool(False)
            if dr.hint(surfaces.has_transmission, mode="scalar"):
                d, weight = layers.transmitted(leaves, sampler.next_2d())
                throughput *= dr.select(passes, weight, 1.0)
                ray = hit.si.spawn_ray(dr.select(passes, d, ray.d))
                layer += 1
                active = passes & (layer < MAX_LAYERS)
        return emitted, reflected, first_albedo, first_normal

    def _camera_rays(self, view: View, pixels: F64, seed: int) -> tuple[Any, Any]:
        """A sampler, and rays through points of the image, whose z is -1 in camera space."""
        mi, scene = self._mi, self.scene
        sampler = mi.load_dict({"type": "independent"})
        # Opaque values and one buffer: other literals or alignments would compile the kernel again.
        sampler.seed(dr.opaque(mi.UInt32, seed), len(pixels))
        offsets, towards = view.rays((2 * pixels - 1) * (1, -1))
        eye = (view.eye - scene.origin) * scene.scale
        if view.is_orthographic:
            origin = dr.unravel(mi.Point3f, mi.Float((eye + offsets * scene.scale).astype(np.float32).ravel()))
        else:
            origin = mi.Point3f(*(dr.opaque(mi.Float, x) for x in eye.tolist()))
        return sampler, mi.Ray3f(origin, dr.unravel(mi.Vector3f, mi.Float(towards.astype(np.float32).ravel())))

    def _glossy(self, layers: Layers, si: Any, sampler: Any, active: Any) -> Any:
        """Light that the surface's glossy layers reflect towards the viewer."""
        radiance = self._mi.Color3f(0.0)
        for lobe, share, is_there in layers.glossy:
            here = active & is_there
            unbounced = self._unbounced((*self._direct, *self._indirect), si, lobe, sampler, here)
            radiance += dr.select(here, share * unbounced, 0.0)
        if layers.glossy and self.max_bounces > 0:
            lobe = ChosenLobe(self._mi, layers.glossy, sampler.next_1d())
            radiance += self._bounced(lobe, si, sampler, active)[1]
        return radiance

    def _diffuse(self, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """Light that reaches a white diffuse surface unbounced, by one bounce, and by all bounces."""
        lobe = LambertLobe(self._mi, normal)
        direct = self._unbounced(self._direct, si, lobe, sampler, active)
        if self.max_bounces == 0:
            return direct, self._mi.Color3f(0.0), self._mi.Color3f(0.0)
        emitted = self._unbounced(self._indirect, si, lobe, sampler, active)
        single, multi = self._bounced(lobe, si, sampler, active)
        return direct, emitted + single, emitted + multi

    @dr.syntax
    def _bounced(self, lobe: Any, si: Any, sampler: Any, active: Any) -> Any:
        """Light that the lobe of a surface reflects after one bounce, and after one or more."""
        mi, surfaces = self._mi, self.scene.surfaces
        single, multi, bounce = mi.Color3f(0.0), mi.Color3f(0.0), mi.UInt32(0)
        d, throughput = self._scatter(lobe, sampler)
        roughness = mi.Float(dr.minimum(lobe.roughness, MIN_BOUNCED_ROUGHNESS))
        si, active = type(si)(si), mi.Bool(active)
        while active:
            active &= (dr.dot(face_normal(si), d) > 0) & (dr.max(throughput) > 0)
            hit, tint = self._intersect(self.scene.meshes, si.spawn_ray(d), active, sampler, self._passes_straight)
            active &= hit.is_valid()
            surface, si = surfaces.at(hit, active), hit.si
            surface.roughness = dr.maximum(surface.roughness, roughness)
            surface.coat_roughness = dr.maximum(surface.coat_roughness, roughness)
            chosen = self._choose_lobe(Layers(mi, surfaces, surface, -d), sampler)
            throughput *= tint
            light = throughput * self._unbounced(self._direct, si, chosen, sampler, active)
            emitted = throughput * self._unbounced(self._indirect, si, chosen, sampler, active)
            multi += dr.select(active, light + emitted, 0.0)
            single += dr.select(active & (bounce == 0), light, 0.0)
            d, weight = self._scatter(chosen, sampler)
            throughput *= weight
            roughness = dr.maximum(roughness, dr.minimum(chosen.roughness, MIN_BOUNCED_ROUGHNESS))
            bounce += 1
            survival = dr.select(bounce < ROULETTE_DEPTH, 1.0, dr.minimum(dr.max(throughput), 0.95))
            active &= (bounce < self.max_bounces) & (sampler.next_1d() < survival)
            throughput /= dr.maximum(survival, 1e-6)
        return single, multi

    def _choose_lobe(self, layers: Layers, sampler: Any) -> Any:
        """One of the surface's lobes, which stands for all."""
        if not layers.glossy:
            return layers.lobes[0][0]
        return ChosenLobe(self._mi, layers.lobes, sampler.next_1d())

    def _scatter(self, lobe: Any, sampler: Any) -> tuple[Any, Any]:
        """A direction that the lobe reflects light from, and value · cosine / density."""
        d = lobe.sample(sampler.next_2d())
        pdf = lobe.pdf(d)
        return d, self._mi.Color3f(dr.select(pdf > 0, lobe.eval(d) * lobe.tint(d) / pdf, 0.0))

    def _unbounced(self, sources: Sequence[LightSource], si: Any, lobe: Any, sampler: Any, active: Any) -> Any:
        """Light of ``sources`` that the lobe reflects without further bounces."""
        radiance = self._mi.Color3f(0.0)
        for source in sources:
            samples = ([self._light_sample(source, si, sampler, active)]
                       if source.bounded and isinstance(lobe, LambertLobe)
                       else self._lobe_samples(source, si, lobe, sampler, active))
            for l, light in samples:  # noqa: E741
                radiance += dr.select(light > 0, light * lobe.eval(l) * lobe.tint(l), 0.0)
        return radiance

    def _lobe_samples(self, source: LightSource, si: Any, lobe: Any, sampler: Any,
                      active: Any) -> Iterator[tuple[Any, Any]]:
        """Multiple importance sampling of the source and the lobe: directions, and radiance / density from there."""
        yield self._light_sample(source, si, sampler, active, lobe)
        l = lobe.sample(sampler.next_2d(active))  # noqa: E741
        pdf = lobe.pdf(l)
        active = active & (pdf > 0) & (dr.dot(face_normal(si), l) > 0)
        distance, tint = self._mi.Float(dr.inf), self._mi.Color3f(1.0)
        if source.occluders is not None:
            hit, tint = self._intersect(source.occluders, si.spawn_ray(l), active, sampler, self._passes_to_light)
            distance = dr.select(hit.is_valid(), hit.si.t * (1 + SHADOW_EPSILON), dr.inf)
        yield l, dr.select(active, tint * source.along(si, l, distance, pdf, active) / pdf, 0.0)

    def _light_sample(self, source: LightSource, si: Any, sampler: Any, active: Any,
                      lobe: Any = None) -> tuple[Any, Any]:
        """One direction of the source's light, and radiance / density, weighted if the lobe is sampled too."""
        sample = source.sample(si, sampler, active)
        weight = sample.weight
        if lobe is not None:
            weight = weight * dr.select(sample.pdf > 0, power_heuristic(sample.pdf, lobe.pdf(sample.d)), 1.0)
        active = active & (dr.dot(face_normal(si), sample.d) > 0) & (dr.max(weight) > 0)
        ray = si.spawn_ray(sample.d)
        # The ray starts off the surface, nearer to the light by more than SHADOW_EPSILON if that is close.
        towards = si.p + sample.d * sample.distance - ray.o
        distance = dr.norm(towards)
        ray.d, ray.maxt = towards / distance, distance * (1 - SHADOW_EPSILON)
        return sample.d, dr.select(active, weight * self._visible(ray, active, source.occluders), 0.0)

    def _visible(self, ray: Any, active: Any, meshes: Any) -> Any:
        """What arrives of light along the rays, straight through surfaces that transmit it."""
        mi, surfaces = self._mi, self.scene.surfaces
        if meshes is None:
            return mi.Color3f(1.0)
        if not (surfaces.has_holes or surfaces.has_blend or surfaces.has_transmission):
            return dr.select(meshes.ray_test(ray, active), mi.Color3f(0.0), mi.Color3f(1.0))
        return self._transmittance(ray, active, meshes)

    @dr.syntax
    def _transmittance(self, ray: Any, active: Any, meshes: Any) -> Any:
        """The product of what each surface along the rays lets pass; 0 behind ``MAX_LAYERS`` of them."""
        mi, surfaces = self._mi, self.scene.surfaces
        arriving, layer, active = mi.Color3f(1.0), mi.UInt32(0), mi.Bool(active)
        while active:
            hit = surfaces.hit(meshes, ray, active)
            active &= hit.is_valid()
            surface = surfaces.at(hit, active)
            coverage, share = dr.select(surface.is_lit_through, 0.0, surface.coverage), mi.Color3f(0.0)
            if dr.hint(surfaces.has_transmission, mode="scalar"):
                share = self._transmitted_share(hit, surface, ray.d)
            arriving *= dr.select(active, 1 - coverage + coverage * share, 1.0)
            layer += 1
            arriving = dr.select(active & (layer == MAX_LAYERS), 0.0, arriving)
            passed = beyond(hit.si, ray.d)
            ray.o, ray.maxt = ray(passed), ray.maxt - passed
            active &= dr.max(arriving) > 0
        return arriving

    def _transmitted_share(self, hit: Hit, surface: Surface, d: Any) -> Any:
        """Mean share of light that passes what is covered, without being bent; absorbed where it leaves a volume."""
        leaves = surface.is_thick & ~surface.is_front & (surface.transmission > 0)
        absorbed = dr.exp(-surface.extinction * hit.si.t * dr.norm(d))
        layers = Layers(self._mi, self.scene.surfaces, surface, -dr.normalize(d))
        return dr.select(leaves, absorbed, surface.transmission * layers.transmitted_share)

    @dr.syntax
    def _intersect(self, meshes: Any, ray: Any, active: Any, sampler: Any, passes: Any) -> Any:
        """The first surface at which the rays stop, and the product of the tints of those that they pass.

        Parameters
        ----------
        passes : callable
            Whether the ray passes the surface that it hit, and its tint.
        """
        surfaces = self.scene.surfaces
        hit, tint = surfaces.hit(meshes, ray, active), self._mi.Color3f(1.0)
        if dr.hint(surfaces.has_holes or surfaces.has_blend or surfaces.has_transmission, mode="scalar"):
            through, factor = passes(hit, ray.d, sampler)
            tint = dr.select(through, factor, 1.0)
            passed, layer, onward = self._mi.Float(0.0), self._mi.UInt32(0), self._mi.Ray3f(ray)
            while through & (layer < MAX_LAYERS):
                passed += beyond(hit.si, ray.d)
                onward.o, onward.maxt = ray(passed), ray.maxt - passed
                hit = surfaces.hit(meshes, onward, through)
                through, factor = passes(hit, ray.d, sampler)
                tint *= dr.select(through, factor, 1.0)
                layer += 1
            hit.si.t += passed
        return hit, tint

    def _passes_to_opaque(self, hit: Hit, d: Any, sampler: Any) -> tuple[Any, Any]:
        """Rays pass all but what the G-buffer shows: surfaces that are neither blended nor transmit light."""
        surfaces, active = self.scene.surfaces, hit.is_valid()
        surface = surfaces.at(hit, active)
        passes = (surface.coverage <= 0) | surface.is_culled | surfaces.is_see_through(hit, active)
        return active & passes, self._mi.Color3f(1.0)

    def _passes_uncovered(self, hit: Hit, d: Any, sampler: Any) -> tuple[Any, Any]:
        """Rays pass culled backs, holes of masks, and blended surfaces by their coverage."""
        surface = self.scene.surfaces.at(hit, hit.is_valid())
        return hit.is_valid() & (surface.is_culled | self._is_uncovered(surface, sampler)), self._mi.Color3f(1.0)

    def _passes_straight(self, hit: Hit, d: Any, sampler: Any) -> tuple[Any, Any]:
        """Rays pass what is not covered, and are tinted by what transmits light, which does not bend them."""
        surface = self.scene.surfaces.at(hit, hit.is_valid())
        return self._passes_tinted(hit, surface, surface.is_culled, d, sampler)

    def _passes_to_light(self, hit: Hit, d: Any, sampler: Any) -> tuple[Any, Any]:
        """The same for light that comes the other way."""
        surface = self.scene.surfaces.at(hit, hit.is_valid())
        return self._passes_tinted(hit, surface, surface.is_lit_through, d, sampler)

    def _passes_tinted(self, hit: Hit, surface: Surface, through: Any, d: Any, sampler: Any) -> tuple[Any, Any]:
        """Whether rays pass, in any case where ``through`` says so, and their tint."""
        mi, surfaces, active = self._mi, self.scene.surfaces, hit.is_valid()
        through = active & (through | self._is_uncovered(surface, sampler))
        if not surfaces.has_transmission:
            return through, mi.Color3f(1.0)
        leaves = surface.is_thick & ~surface.is_front & (surface.transmission > 0)
        transmits = active & ~through & (leaves | (sampler.next_1d() < surface.transmission))
        absorbed = dr.exp(-surface.extinction * hit.si.t * dr.norm(d))
        colored = dr.select(leaves, absorbed, Layers(mi, surfaces, surface, -dr.normalize(d)).transmitted_share)
        return through | transmits, dr.select(transmits, mi.Color3f(colored), mi.Color3f(1.0))

    def _is_uncovered(self, surface: Surface, sampler: Any) -> Any:
        return surface.coverage <= (sampler.next_1d() if self.scene.surfaces.has_blend else 0.5)


def beyond(si: Any, d: Any) -> Any:
    """How far along a ray of direction d it has left the surface that it hits, to go on along the same line.

    Mitsuba's own offset, along the normal, would move the line, which would meet the side of a small light.
    """
    off = dr.dot(si.spawn_ray(d).o - si.p, si.n)
    return si.t + dr.abs(off) / dr.maximum(dr.abs(dr.dot(si.n, d)), MIN_COSINE * dr.norm(d))


def evaluate(active: Any, *outputs: Any) -> list[F32]:
    """The outputs as arrays, 0 where not active; in one kernel, or each output would trace the paths again."""
    selected = [dr.select(active, x, 0.0) for x in outputs]
    dr.eval(selected)
    return [np.array(x, np.float32).T for x in selected]
