"""The path tracer: Mitsuba's intersections, textures and light sampling in a loop of diffuse bounces.

Estimates are demodulated by construction: the primary surface reflects as white (radiance / albedo), so nothing is
ever divided by a dark albedo. All surfaces are diffuse, as the renderer's indirect light takes them to be.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from app.math3d import View
from app.scene import Scene
from export.reference.mitsuba_scene import convert, mitsuba

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

MAX_BOUNCES = 16
ROULETTE_AFTER = 4  # bounces
MAX_LAYERS = 16    # of masked surfaces that a ray goes through
SHORT = 1.0         # second


@dataclass(frozen=True, eq=False)
class Samples:
    """One sample for each of N camera rays; 0 where a ray meets nothing.

    Attributes
    ----------
    direct, single, multi : ndarray, float32, shape (N, 3)
        Radiance / albedo in W/(sr m²): by the scene's lights, by one bounce, by all bounces. What comes straight from
        the environment, and from glowing meshes that are no lights, counts as bounced once.
    albedo : ndarray, float32, shape (N, 3)
    normal : ndarray, float32, shape (N, 3)
        Shading normal in world space on the camera's side of the surface.
    depth : ndarray, float32, shape (N,)
        Distance along the camera's -z in scene units.
    """

    direct: F32
    single: F32
    multi: F32
    albedo: F32
    normal: F32
    depth: F32


class PathTracer:
    """Traces one scene at one moment, from any camera.

    Parameters
    ----------
    moment : float
        Seconds; places moving objects.
    max_bounces : int
        Of indirect light; 0 traces direct light alone.

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """

    def __init__(self, scene: Scene, moment: float = 0.0, max_bounces: int = MAX_BOUNCES) -> None:
        self._mi = mitsuba()
        self._scene = convert(scene, moment)
        self._max_bounces = max_bounces
        self.notices = self._scene.notices

    def trace(self, view: View, pixels: F64, seed: int) -> Samples:
        """Follow one path through each point of the image.

        Parameters
        ----------
        pixels : ndarray, float64, shape (N, 2)
            Image positions in [0, 1], x to the right, y down.
        """
        mi, scene = self._mi, self._scene
        sampler, ray = self._camera_rays(view, pixels, seed)
        si = self._intersect(scene.seen, ray)
        hit = si.is_valid()
        normal = _facing_normal(si)
        direct = self._light_from(scene.lights, si, normal, sampler, hit)
        single = multi = mi.Color3f(0)
        if self._max_bounces:
            single, multi = self._indirect(si, normal, sampler, hit)
        # The rays' z is -1 in camera space, so t is the depth.
        found = [dr.select(hit, x, 0.0) for x in (direct, single, multi, _albedo(si, hit), normal,
                                              si.t / dr.opaque(mi.Float, scene.scale))]
        dr.eval(found)  # together, or each would be traced anew
        return Samples(*[np.array(x, np.float32).T for x in found])

    def clock(self, view: View, size: tuple[int, int]) -> Callable[[int], float]:
        """The seconds that Mitsuba's own ``path`` integrator takes for so many samples per pixel, warm, as for a user.

        A short measurement is taken twice, and the lesser counts.
        """
        mi, scene = self._mi, self._scene
        origin = (view.eye - scene.origin) * scene.scale
        sensor = mi.load_dict({
            "type": "perspective", "fov": math.degrees(2 * math.atan(view.tan_half[1])), "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(origin=origin.tolist(), up=view.rotation[1].tolist(),
                                                       target=(origin - view.rotation[2]).tolist()),
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}})
        integrator = mi.load_dict({"type": "path", "max_depth": self._max_bounces + 2, "rr_depth": ROULETTE_AFTER})
        whole = mi.load_dict(scene.whole)

        def once(spp: int) -> float:
            start = time.perf_counter()
            np.array(mi.render(whole, sensor=sensor, integrator=integrator, spp=spp))
            return time.perf_counter() - start

        def measure(spp: int) -> float:
            seconds = once(spp)
            return min(seconds, once(spp)) if seconds < SHORT else seconds

        for spp in (1, 2):  # compiles, for one sample per pixel and for more
            once(spp)
        return measure

    def _camera_rays(self, view: View, pixels: F64, seed: int) -> tuple[Any, Any]:
        """A sampler, and rays through points of the image, whose z is -1 in camera space."""
        mi, scene = self._mi, self._scene
        sampler = mi.load_dict({"type": "independent"})
        # Numbers as data, and gathered: the kernel would be compiled anew for other literals, and for other alignments.
        sampler.seed(dr.opaque(mi.UInt32, seed), len(pixels))
        image = (2 * pixels - 1) * (1, -1) * view.tan_half
        towards = np.concatenate([image, np.full((len(pixels), 1), -1.0)], axis=1) @ view.rotation
        origin = [dr.opaque(mi.Float, x) for x in ((view.eye - scene.origin) * scene.scale).tolist()]
        return sampler, mi.Ray3f(mi.Point3f(*origin),
                                 dr.unravel(mi.Vector3f, mi.Float(towards.astype(np.float32).ravel())))

    @dr.syntax
    def _indirect(self, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """Light by one bounce and by all bounces that reaches a white surface."""
        mi = self._mi
        glow = self._glow(si, normal, sampler, active)
        single, multi = mi.Color3f(glow), mi.Color3f(glow)
        throughput, bounce = mi.Color3f(1.0), mi.UInt32(0)
        si, normal, active = type(si)(si), mi.Normal3f(normal), mi.Bool(active)
        while active:
            ray = si.spawn_ray(mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d())))
            si = self._intersect(self._scene.seen, ray)
            active &= si.is_valid()
            normal = _facing_normal(si)
            throughput *= _albedo(si, active)
            light = throughput * self._light_from(self._scene.lights, si, normal, sampler, active)
            glow = throughput * self._glow(si, normal, sampler, active)
            multi += dr.select(active, light + glow, 0.0)
            single += dr.select(active & (bounce == 0), light, 0.0)
            bounce += 1
            survival = dr.select(bounce < ROULETTE_AFTER, 1.0, dr.minimum(dr.max(throughput), 0.95))
            active &= (bounce < self._max_bounces) & (sampler.next_1d() < survival)
            throughput /= dr.maximum(survival, 1e-6)
        return single, multi

    def _glow(self, si: Any, normal: Any, sampler: Any, active: Any) -> Any:
        """Samples of what glows and of the environment, which all meshes hide."""
        scene = self._scene
        return (self._light_from(scene.glow, si, normal, sampler, active)
                + self._light_from(scene.sky, si, normal, sampler, active, scene.seen))

    def _light_from(self, emitters: Any, si: Any, normal: Any, sampler: Any, active: Any, hidden_by: Any = None) -> Any:
        """One sample of the light that a white surface reflects straight from ``emitters``.

        ``hidden_by``: the meshes that cast shadows, or others than those.
        """
        if emitters is None:
            return self._mi.Color3f(0.0)
        sample, weight = emitters.sample_emitter_direction(si, sampler.next_2d(active), False, active)
        cosine = dr.dot(normal, sample.d)
        lit = active & (cosine > 0) & (dr.dot(_facing(si), sample.d) > 0) & (sample.pdf != 0)
        lit &= ~self._blocked(si.spawn_ray_to(sample.p), lit, self._scene.solid if hidden_by is None else hidden_by)
        return dr.select(lit, weight * cosine / dr.pi, 0.0)

    def _blocked(self, ray: Any, active: Any, meshes: Any) -> Any:
        if meshes is None:
            return self._mi.Bool(False)
        return self._intersect(meshes, ray, active).is_valid() if self._scene.masked else meshes.ray_test(ray, active)

    @dr.syntax
    def _intersect(self, meshes: Any, ray: Any, active: Any = True) -> Any:
        """The first surface that is there, behind the holes of masked ones."""
        si = meshes.ray_intersect(ray, active)
        if dr.hint(self._scene.masked, mode="scalar"):
            through = self._through(si)
            passed, layer = self._mi.Float(0.0), self._mi.UInt32(0)
            while through & (layer < MAX_LAYERS):
                passed += si.t
                onward = si.spawn_ray(ray.d)
                onward.maxt = ray.maxt - passed
                si = meshes.ray_intersect(onward, through)
                through = self._through(si)
                layer += 1
            si.t += passed
        return si

    def _through(self, si: Any) -> Any:
        there = si.is_valid()
        return there & (si.bsdf().eval_null_transmission(si, there).x > 0.5)


def _albedo(si: Any, active: Any) -> Any:
    return si.bsdf().eval_diffuse_reflectance(si, active)


def _facing_normal(si: Any) -> Any:
    """The shading normal on that side of the face which the ray came from."""
    return dr.select(dr.dot(si.sh_frame.n, _facing(si)) < 0, -si.sh_frame.n, si.sh_frame.n)


def _facing(si: Any) -> Any:
    """The face's normal on that side which the ray came from."""
    return dr.select(dr.dot(si.n, si.to_world(si.wi)) > 0, si.n, -si.n)
