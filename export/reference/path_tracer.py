"""A diffuse path tracer: Mitsuba's intersections, textures and light sampling in a loop over bounces.

Estimates are demodulated by construction: the primary surface reflects with an albedo of 1, so radiance / albedo needs
no division by a dark albedo. All surfaces are diffuse, as in the renderer's model of indirect light.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from time import perf_counter
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F32, F64
from app.math3d import View
from app.scene import Scene
from export.reference.mitsuba_module import load_mitsuba
from export.reference.mitsuba_scene import convert_scene
from export.reference.still import Still

MAX_BOUNCES = 16
MAX_RAYS = 2**20        # traced at once, which bounds the memory
MAX_MASKED_LAYERS = 16  # masked surfaces that a ray can pass
ROULETTE_DEPTH = 4      # bounces before Russian roulette begins
SHORT_SECONDS = 1.0     # measurements below are repeated


@dataclass(frozen=True, eq=False)
class Samples:
    """One sample for each of N camera rays; 0 where a ray hits nothing.

    Attributes
    ----------
    direct, single, multi : ndarray, float32, shape (N, 3)
        Radiance / albedo in W/(sr m²): from the scene's lights, by one bounce, and by all bounces. Unbounced light
        from the environment and from emissive meshes other than light proxies counts as bounced once.
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

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """

    def __init__(self, scene: Scene, time: float = 0.0, max_bounces: int = MAX_BOUNCES) -> None:
        self._mi = load_mitsuba()
        self._scene = convert_scene(scene, time)
        self._max_bounces = max_bounces
        self.notices = self._scene.notices

    def trace(self, view: View, pixels: F64, seed: int) -> Samples:
        """Trace one path through each point of the image.

        Parameters
        ----------
        pixels : ndarray, float64, shape (N, 2)
            Image positions in [0, 1], x to the right, y down.
        """
        mi, scene = self._mi, self._scene
        sampler, ray = self._camera_rays(view, pixels, seed)
        si = self._intersect(scene.meshes, ray)
        hit = si.is_valid()
        normal = shading_normal(si)
        direct = self._sample_light(scene.lights, scene.shadow_casters, si, normal, sampler, hit)
        single = multi = mi.Color3f(0)
        if self._max_bounces:
            single, multi = self._indirect(si, normal, sampler, hit)
        # The rays' z is -1 in camera space, so t is the depth.
        outputs = [dr.select(hit, x, 0.0) for x in (direct, single, multi, albedo(si, hit), normal,
                                                    si.t / dr.opaque(mi.Float, scene.scale))]
        dr.eval(outputs)  # in one kernel, or each output would trace the paths again
        return Samples(*[np.array(x, np.float32).T for x in outputs])

    def make_integrator_timer(self, view: View, size: tuple[int, int]) -> Callable[[int], float]:
        """A function from samples per pixel to the seconds that Mitsuba's own ``path`` integrator takes, warmed up.

        Short measurements are taken twice, and the smaller one counts.
        """
        mi, scene = self._mi, self._scene
        origin = (view.eye - scene.origin) * scene.scale
        sensor = mi.load_dict({
            "type": "perspective", "fov": math.degrees(2 * math.atan(view.tan_half[1])), "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(origin=origin.tolist(), up=view.rotation[1].tolist(),
                                                       target=(origin - view.rotation[2]).tolist()),
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}})
        integrator = mi.load_dict({"type": "path", "max_depth": self._max_bounces + 2, "rr_depth": ROULETTE_DEPTH})
        combined = mi.load_dict(scene.combined)

        def render(spp: int) -> float:
            start = perf_counter()
            np.array(mi.render(combined, sensor=sensor, integrator=integrator, spp=spp))
            return perf_counter() - start

        def measure(spp: int) -> float:
            seconds = render(spp)
            return min(seconds, render(spp)) if seconds < SHORT_SECONDS else seconds

        for spp in (1, 2):  # one sample per pixel and several compile to different kernels
            render(spp)
        return measure

    def _camera_rays(self, view: View, pixels: F64, seed: int) -> tuple[Any, Any]:
        """A sampler, and rays through points of the image, whose z is -1 in camera space."""
        mi, scene = self._mi, self._scene
        sampler = mi.load_dict({"type": "independent"})
        # Opaque values and one buffer: other literals or alignments would compile the kernel again.
        sampler.seed(dr.opaque(mi.UInt32, seed), len(pixels))
        image = (2 * pixels - 1) * (1, -1) * view.tan_half
        towards = np.concatenate([image, np.full((len(pixels), 1), -1.0)], axis=1) @ view.rotation
        origin = [dr.opaque(mi.Float, x) for x in ((view.eye - scene.origin) * scene.scale).tolist()]
        return sampler, mi.Ray3f(mi.Point3f(*origin),
                                 dr.unravel(mi.Vector3f, mi.Float(towards.astype(np.float32).ravel())))

    @dr.syntax
    def _indirect(self, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """Light that reaches a white surface by one bounce, and by all bounces."""
        mi = self._mi
        emitted = self._sample_emission(si, normal, sampler, active)
        single, multi = mi.Color3f(emitted), mi.Color3f(emitted)
        throughput, bounce = mi.Color3f(1.0), mi.UInt32(0)
        si, normal, active = type(si)(si), mi.Normal3f(normal), mi.Bool(active)
        while active:
            ray = si.spawn_ray(mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d())))
            si = self._intersect(self._scene.meshes, ray)
            active &= si.is_valid()
            normal = shading_normal(si)
            throughput *= albedo(si, active)
            light = throughput * self._sample_light(self._scene.lights, self._scene.shadow_casters, si, normal, sampler,
                                                    active)
            emitted = throughput * self._sample_emission(si, normal, sampler, active)
            multi += dr.select(active, light + emitted, 0.0)
            single += dr.select(active & (bounce == 0), light, 0.0)
            bounce += 1
            survival = dr.select(bounce < ROULETTE_DEPTH, 1.0, dr.minimum(dr.max(throughput), 0.95))
            active &= (bounce < self._max_bounces) & (sampler.next_1d() < survival)
            throughput /= dr.maximum(survival, 1e-6)
        return single, multi

    def _sample_emission(self, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """One sample of the emissive meshes plus one of the environment, which every mesh occludes."""
        scene = self._scene
        return (self._sample_light(scene.emissive, scene.shadow_casters, si, normal, sampler, active)
                + self._sample_light(scene.environment, scene.meshes, si, normal, sampler, active))

    def _sample_light(self, emitters: Any, occluders: Any, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """One sample of the unbounced light of ``emitters`` that a white surface reflects."""
        if emitters is None:
            return self._mi.Color3f(0.0)
        sample, weight = emitters.sample_emitter_direction(si, sampler.next_2d(active), False, active)
        cosine = dr.dot(normal, sample.d)
        lit = active & (cosine > 0) & (dr.dot(face_normal(si), sample.d) > 0) & (sample.pdf != 0)
        lit &= ~self._is_occluded(si.spawn_ray_to(sample.p), lit, occluders)
        return dr.select(lit, weight * cosine / dr.pi, 0.0)

    def _is_occluded(self, ray: Any, active: Any, meshes: Any) -> Any:
        if meshes is None:
            return self._mi.Bool(False)
        return self._intersect(meshes, ray, active).is_valid() if self._scene.masked else meshes.ray_test(ray, active)

    @dr.syntax
    def _intersect(self, meshes: Any, ray: Any, active: Any = True) -> Any:
        """The first surface along the rays, which pass the holes of masked surfaces."""
        si = meshes.ray_intersect(ray, active)
        if dr.hint(self._scene.masked, mode="scalar"):
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


# Quantities at a Mitsuba surface interaction, on the side of the face that the ray came from.


def albedo(si: Any, active: Any) -> Any:
    return si.bsdf().eval_diffuse_reflectance(si, active)


def face_normal(si: Any) -> Any:
    return dr.select(dr.dot(si.n, si.to_world(si.wi)) > 0, si.n, -si.n)


def shading_normal(si: Any) -> Any:
    return dr.select(dr.dot(si.sh_frame.n, face_normal(si)) < 0, -si.sh_frame.n, si.sh_frame.n)
