"""What a source of light tells the path tracer, and sources made of Mitsuba's emitters."""

from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr


@dataclass(frozen=True, eq=False)
class LightSample:
    """A sampled direction towards light, as Dr.Jit arrays in the scaled space of ``MitsubaScene``.

    Attributes
    ----------
    d : mitsuba.Vector3f
        Unit length.
    distance : mitsuba.Float
        To the light.
    weight : mitsuba.Color3f
        Unoccluded radiance / density.
    pdf : mitsuba.Float
        Density per steradian; 0 for lights without a size, which no other direction finds.
    """

    d: Any
    distance: Any
    weight: Any
    pdf: Any


class LightSource(Protocol):
    """Light that falls on surfaces.

    Attributes
    ----------
    occluders : mitsuba.Scene or None
        The meshes that block it.
    bounded : bool
        Whether the cosine-weighted ``LightSample.weight`` is bounded, so that diffuse surfaces need no other samples.
    """

    occluders: Any
    bounded: bool

    def sample(self, si: Any, sampler: Any, active: Any) -> LightSample:
        """One sample of the light at the surface ``si``."""

    def along(self, si: Any, d: Any, distance: Any, pdf: Any, active: Any) -> Any:
        """Radiance from the direction ``d`` as far as ``distance``, each light times ``power_heuristic(pdf, …)``."""


class EmissiveMeshes:
    """The emission of meshes that are no analytic lights, sampled by area."""

    bounded = False

    def __init__(self, mi: Any, emitters: Any, occluders: Any) -> None:
        self._mi, self._emitters, self.occluders = mi, emitters, occluders

    def sample(self, si: Any, sampler: Any, active: Any) -> LightSample:
        """One point on a mesh."""
        return _sample_emitters(self._emitters, si, sampler, active)

    def along(self, si: Any, d: Any, distance: Any, pdf: Any, active: Any) -> Any:
        """Of the first emissive mesh."""
        ray = si.spawn_ray(d)
        ray.maxt = distance
        hit = self._emitters.ray_intersect(ray, active)
        active = active & hit.is_valid()
        towards = self._mi.DirectionSample3f(self._emitters, hit, si)
        own_pdf = self._emitters.pdf_emitter_direction(si, towards, active)
        radiance = hit.emitter(self._emitters, active).eval(hit, active)
        return dr.select(active, radiance * power_heuristic(pdf, own_pdf), 0.0)


class Sky:
    """The environment."""

    bounded = True

    def __init__(self, mi: Any, emitters: Any, occluders: Any) -> None:
        self._mi, self._emitters, self.occluders = mi, emitters, occluders

    def sample(self, si: Any, sampler: Any, active: Any) -> LightSample:
        """One direction, chosen by the radiance of the map."""
        return _sample_emitters(self._emitters, si, sampler, active)

    def along(self, si: Any, d: Any, distance: Any, pdf: Any, active: Any) -> Any:
        """Where nothing is hit."""
        towards = dr.zeros(self._mi.DirectionSample3f, dr.width(d))
        towards.d = d
        own_pdf = self._emitters.environment().pdf_direction(si, towards, active)
        return dr.select(active & dr.isinf(distance), self.radiance(d) * power_heuristic(pdf, own_pdf), 0.0)

    def radiance(self, d: Any) -> Any:
        """From the unit direction ``d``."""
        escaped = dr.zeros(self._mi.SurfaceInteraction3f, dr.width(d))
        escaped.wi = -d
        return self._emitters.environment().eval(escaped)


def power_heuristic(pdf: Any, other: Any) -> Any:
    """Weight of a sample of density ``pdf`` that has also been sampled by ``other`` (Veach and Guibas 1995)."""
    ratio = other / dr.maximum(pdf, 1e-30)
    return 1 / (1 + ratio * ratio)


def _sample_emitters(emitters: Any, si: Any, sampler: Any, active: Any) -> LightSample:
    sample, weight = emitters.sample_emitter_direction(si, sampler.next_2d(active), False, active)
    return LightSample(sample.d, sample.dist, dr.select(sample.pdf > 0, weight, 0.0), sample.pdf)
