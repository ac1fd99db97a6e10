"""``Scene.lights`` as a source of light: each is sampled by the solid angle that it fills."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F64
from app.math3d import normalize
from app.scene import Color, DirectionalLight, Light, PointLight, RectLight, SpotLight
from export.reference.light_sources import LightSample, power_heuristic
from export.reference.solid_angle import Cone, SphericalRectangle

UNIFORM_SHARE = 0.5  # of the samples, spread evenly over the lights; the others are spread by power
FAR = 1e6            # scaled: distance of directional lights
MAX_SINE2 = 1 - 1e-6
EVERYWHERE = 2 * math.pi, 3 * math.pi  # cone of lights that are no spots


@dataclass(frozen=True, eq=False)
class _Row:
    """One light; lengths are scaled.

    Attributes
    ----------
    color : tuple of float
        Radiance; intensity of points, irradiance of directional lights without a size.
    position : ndarray, shape (3,)
        Centre; of directional lights the unit vector towards them.
    radius : float
        Of spheres; of directional lights the sine of their angular radius.
    axis, cone : ndarray, shape (3,), tuple of float
        A spot's axis, and its inner and outer half angle in radians.
    u, v : ndarray, shape (3,)
        Edges of a rectangle; zeros for other lights.
    power : float
        W, roughly; of directional lights that which enters the scene.
    """

    color: Color
    position: F64
    power: float
    radius: float = 0.0
    directional: bool = False
    axis: F64 | Color = (0.0, 0.0, 0.0)
    cone: tuple[float, float] = EVERYWHERE
    u: F64 | Color = (0.0, 0.0, 0.0)
    v: F64 | Color = (0.0, 0.0, 0.0)
    two_sided: bool = False


class AnalyticLights:
    """Point, spot, directional and rectangle lights.

    Parameters
    ----------
    origin, scale, extent : ndarray, float64, shape (3,), float, float
        ``scaled = (world - origin) * scale``, and the scaled scene's longest edge.
    occluders : mitsuba.Scene or None
        The meshes that cast shadows.
    """

    bounded = True

    def __init__(self, mi: Any, lights: Sequence[Light], origin: F64, scale: float, extent: float,
                 occluders: Any) -> None:
        rows = [_row(light, origin, scale, extent) for light in lights]
        self._mi, self.occluders, self._count = mi, occluders, len(rows)
        self._has_rectangles = any(isinstance(light, RectLight) for light in lights)
        power = np.array([row.power for row in rows])
        chance = UNIFORM_SHARE / len(rows) + (1 - UNIFORM_SHARE) * power / max(float(power.sum()), 1e-300)
        self._choice = mi.DiscreteDistribution(mi.Float(chance.astype(np.float32)))

        def column(kind: Any, values: list[Any]) -> Any:
            array = np.array(values, np.float32)
            return kind(np.ascontiguousarray(array.T)) if array.ndim > 1 else kind(array)

        self._color = column(mi.Color3f, [row.color for row in rows])
        self._position, self._axis, self._u, self._v = (
            column(mi.Vector3f, [getattr(row, name) for row in rows]) for name in ("position", "axis", "u", "v"))
        self._cone = column(mi.Vector2f, [row.cone for row in rows])
        self._radius, self._directional, self._two_sided = (
            column(mi.Float, [getattr(row, name) for row in rows]) for name in ("radius", "directional", "two_sided"))

    def sample(self, si: Any, sampler: Any, active: Any) -> LightSample:
        """One direction towards one of the lights."""
        index = self._choice.sample(sampler.next_1d(active), active)
        u = sampler.next_2d(active)
        chance = self._choice.eval_pmf_normalized(index, active)
        cone, distance = self._cone_of(index, si.p, active)
        d = cone.sample(self._mi.Frame3f, u)
        has_size = cone.sine2 > 0
        distance = cone.distance_to_sphere(distance, d)
        pdf = dr.select(has_size, chance * cone.pdf, 0.0)
        directional = dr.gather(self._mi.Float, self._directional, index, active) > 0
        falloff = dr.select(has_size | directional, 1.0, 1 / (distance * distance))
        weight = self._emitted(index, d, active) * dr.select(has_size, 1 / pdf, falloff / chance)
        if self._has_rectangles:
            rectangle, is_rectangle, shines = self._rectangle_of(index, si.p, active)
            towards, length = rectangle.sample(u)
            rectangle_pdf = chance * rectangle.pdf(towards, length)
            color = dr.gather(self._mi.Color3f, self._color, index, active)
            d, distance = dr.select(is_rectangle, towards, d), dr.select(is_rectangle, length, distance)
            pdf = dr.select(is_rectangle, rectangle_pdf, pdf)
            weight = dr.select(is_rectangle, dr.select(shines & (pdf > 0), color / pdf, 0.0), weight)
        return LightSample(d, distance, weight, pdf)

    @dr.syntax
    def along(self, si: Any, d: Any, distance: Any, pdf: Any, active: Any) -> Any:
        """Of all lights that the ray meets, as lights hide no light."""
        radiance, index = self._mi.Color3f(0.0), self._mi.UInt32(0)
        while active & (index < self._count):
            radiance += self._met(index, si, d, distance, pdf, active)
            index += 1
        return radiance

    def _met(self, index: Any, si: Any, d: Any, distance: Any, pdf: Any, active: Any) -> Any:
        """Radiance of one light along the ray, times its weight."""
        chance = self._choice.eval_pmf_normalized(index, active)
        cone, to_center = self._cone_of(index, si.p, active)
        hit = (cone.sine2 > 0) & cone.contains(d) & (cone.distance_to_sphere(to_center, d) < distance)
        own_pdf, radiance = cone.pdf, self._emitted(index, d, active)
        if self._has_rectangles:
            rectangle, is_rectangle, shines = self._rectangle_of(index, si.p, active)
            length = rectangle.intersect(d)
            hit = dr.select(is_rectangle, shines & (length < distance) & dr.isfinite(length), hit)
            own_pdf = dr.select(is_rectangle, rectangle.pdf(d, length), own_pdf)
        return dr.select(active & hit, radiance * power_heuristic(pdf, chance * own_pdf), 0.0)

    def _cone_of(self, index: Any, p: Any, active: Any) -> tuple[Cone, Any]:
        """The directions towards a sphere or a disc at infinity, and the distance of its centre."""
        mi = self._mi
        position = dr.gather(mi.Vector3f, self._position, index, active)
        radius = dr.gather(mi.Float, self._radius, index, active)
        directional = dr.gather(mi.Float, self._directional, index, active) > 0
        to = dr.select(directional, position, position - mi.Vector3f(p))
        distance = dr.maximum(dr.norm(to), 1e-12)
        ratio = radius / distance
        return Cone(to / distance, dr.minimum(ratio * ratio, MAX_SINE2)), dr.select(directional, FAR, distance)

    def _emitted(self, index: Any, d: Any, active: Any) -> Any:
        """The light's colour, times the falloff of a spot that is seen in the direction ``d``."""
        mi = self._mi
        color, axis, cone = (dr.gather(kind, column, index, active) for kind, column in (
            (mi.Color3f, self._color), (mi.Vector3f, self._axis), (mi.Vector2f, self._cone)))
        angle = dr.safe_acos(-dr.dot(axis, d))
        return color * dr.clip((cone.y - angle) / dr.maximum(cone.y - cone.x, 1e-6), 0, 1)

    def _rectangle_of(self, index: Any, p: Any, active: Any) -> tuple[SphericalRectangle, Any, Any]:
        """The rectangle, whether the light is one, and whether it emits towards ``p``."""
        mi = self._mi
        u, v = (dr.gather(mi.Vector3f, edge, index, active) for edge in (self._u, self._v))
        is_rectangle = dr.squared_norm(u) > 0
        u, v = dr.select(is_rectangle, u, mi.Vector3f(1, 0, 0)), dr.select(is_rectangle, v, mi.Vector3f(0, 1, 0))
        center = dr.gather(mi.Vector3f, self._position, index, active)
        rectangle = SphericalRectangle(mi.Vector3f(p), center, u, v)
        in_front = dr.dot(mi.Vector3f(p) - center, rectangle.normal) > 0
        return rectangle, is_rectangle, in_front | (dr.gather(mi.Float, self._two_sided, index, active) > 0)


def _row(light: Light, origin: F64, scale: float, extent: float) -> _Row:
    def scaled(point: Sequence[float]) -> F64:
        return np.asarray((np.asarray(point, np.float64) - origin) * scale)

    match light:
        case PointLight() | SpotLight():
            radius = light.radius * scale
            factor = 1 / (math.pi * light.radius**2) if radius > 0 else scale**2
            spot: dict[str, Any] = {} if isinstance(light, PointLight) else {
                "axis": normalize(np.asarray(light.direction, np.float64)),
                "cone": (math.radians(light.inner_deg), math.radians(light.outer_deg))}
            share = 1.0 if isinstance(light, PointLight) else (1 - math.cos(spot["cone"][1])) / 2
            return _Row(_times(light.intensity, factor), scaled(light.position),
                        4 * math.pi * share * scale**2 * sum(light.intensity), radius, **spot)
        case DirectionalLight():
            sine = math.sin(math.radians(light.angular_radius_deg))
            factor = 1 / (math.pi * sine**2) if sine > 0 else 1.0
            towards = -normalize(np.asarray(light.direction, np.float64))
            return _Row(_times(light.irradiance, factor), towards, extent**2 * sum(light.irradiance), sine,
                        directional=True)
        case RectLight():
            u, v = np.asarray(light.edge_u, np.float64) * scale, np.asarray(light.edge_v, np.float64) * scale
            power = math.pi * float(np.linalg.norm(np.cross(u, v))) * sum(light.radiance)
            return _Row(light.radiance, scaled(light.center), power * (1 + light.two_sided), u=u, v=v,
                        two_sided=light.two_sided)


def _times(color: Color, factor: float) -> Color:
    r, g, b = color
    return r * factor, g * factor, b * factor
