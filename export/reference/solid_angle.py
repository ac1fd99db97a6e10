"""Directions spread evenly over the solid angle of a sphere or a rectangle, in Dr.Jit arrays.

Their contributions are bounded however near the light is, whereas points spread over its area would give fireflies.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr

MIN_SOLID_ANGLE = 1e-3  # sr; below it single precision is too coarse, and a rectangle is sampled by area
MIN_PLANE_DISTANCE = 1e-4  # of a rectangle's size; as IN_PLANE in shaders/include/lights.glsl


@dataclass(frozen=True, eq=False)
class Cone:
    """The directions within the angle whose squared sine is ``sine2`` from the unit vector ``axis``."""

    axis: Any
    sine2: Any

    @property
    def pdf(self) -> Any:
        """Per steradian; infinite for a single direction."""
        return 0.5 / (dr.pi * self._height)

    @property
    def _height(self) -> Any:
        """1 − cos of the angle, without cancellation."""
        return self.sine2 / (1 + dr.sqrt(1 - self.sine2))

    def sample(self, frame: type, u: Any) -> Any:
        """The direction at ``u`` in the unit square; ``frame`` is Mitsuba's class of coordinate frames."""
        below = self._height * u.x
        sine, phi = dr.sqrt(dr.maximum(below * (2 - below), 0)), 2 * dr.pi * u.y
        local = type(self.axis)(sine * dr.cos(phi), sine * dr.sin(phi), 1 - below)
        return frame(self.axis).to_world(local)

    def contains(self, d: Any) -> Any:
        return (self._sine2_of(d) <= self.sine2) & (dr.dot(self.axis, d) > 0)

    def distance_to_sphere(self, center_distance: Any, d: Any) -> Any:
        """Distance along ``d``, which lies in the cone, to the sphere that fills it."""
        return center_distance * (dr.dot(self.axis, d) - dr.safe_sqrt(self.sine2 - self._sine2_of(d)))

    def _sine2_of(self, d: Any) -> Any:
        """Squared sine of the angle between the axis and ``d``."""
        return dr.squared_norm(dr.cross(self.axis, d))


class SphericalRectangle:
    """A rectangle as seen from a point (Ureña, Fajardo and King 2013, "An Area-Preserving Parametrization for
    Spherical Rectangles"). Where its solid angle is less than ``MIN_SOLID_ANGLE``, it is sampled by area.

    Parameters
    ----------
    p, center : mitsuba.Point3f
        The point, and the rectangle's centre.
    u, v : mitsuba.Vector3f
        The rectangle's edges, at a right angle.
    """

    def __init__(self, p: Any, center: Any, u: Any, v: Any) -> None:
        width, height = dr.norm(u), dr.norm(v)
        self._x, self._y = u / width, v / height
        self.normal = dr.cross(self._x, self._y)
        to = center - p
        self._area, self._z = width * height, dr.dot(to, self.normal)
        self._in_plane = dr.abs(self._z) <= MIN_PLANE_DISTANCE * 0.5 * (width + height)
        self._x0, self._y0 = dr.dot(to, self._x) - width / 2, dr.dot(to, self._y) - height / 2
        self._x1, self._y1 = self._x0 + width, self._y0 + height
        depth = -dr.abs(self._z)
        corners = [type(u)(x, y, depth) for x, y in ((self._x0, self._y0), (self._x1, self._y0),
                                                    (self._x1, self._y1), (self._x0, self._y1))]
        planes = [dr.normalize(dr.cross(a, b)) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
        angles = [dr.unit_angle(-a, b) for a, b in zip(planes, planes[1:] + planes[:1], strict=True)]
        self._b0, self._b1 = planes[0].z, planes[2].z
        self._k = 2 * dr.pi - angles[2] - angles[3]
        self._solid_angle = angles[0] + angles[1] - self._k
        self._by_area = self._solid_angle < MIN_SOLID_ANGLE

    def sample(self, u: Any) -> tuple[Any, Any]:
        """The unit direction towards the rectangle's point at ``u`` in the unit square, and its distance."""
        x, y = self._sample_solid_angle(u)
        x = dr.select(self._by_area, dr.lerp(self._x0, self._x1, u.x), x)
        y = dr.select(self._by_area, dr.lerp(self._y0, self._y1, u.y), y)
        to = x * self._x + y * self._y + self._z * self.normal
        distance = dr.norm(to)
        return to / distance, distance

    def intersect(self, d: Any) -> Any:
        """Distance to the rectangle along the unit vector ``d``; infinite where it is missed."""
        t = self._z / dr.dot(d, self.normal)
        x, y = t * dr.dot(d, self._x), t * dr.dot(d, self._y)
        hit = (t > 0) & (x >= self._x0) & (x <= self._x1) & (y >= self._y0) & (y <= self._y1)
        return dr.select(hit & ~self._in_plane, t, dr.inf)

    def pdf(self, d: Any, distance: Any) -> Any:
        """Of the direction ``d`` of a point of the rectangle, per steradian; 0 for points in the rectangle's plane."""
        cosine = dr.abs(dr.dot(d, self.normal))
        by_area = distance * distance / (self._area * dr.maximum(cosine, 1e-12))
        return dr.select(self._in_plane, 0.0, dr.select(self._by_area, by_area, 1 / self._solid_angle))

    def _sample_solid_angle(self, u: Any) -> tuple[Any, Any]:
        """Coordinates in the rectangle's plane; the names are those of the paper."""
        angle = u.x * self._solid_angle + self._k
        sine = dr.sin(angle)
        fu = (dr.cos(angle) * self._b0 - self._b1) / dr.select(dr.abs(sine) > 1e-7, sine, 1e-7)
        cu = dr.clip(dr.copysign(dr.rsqrt(dr.maximum(fu * fu + self._b0 * self._b0, 1e-12)), fu), -1, 1)
        depth = dr.abs(self._z)
        x = dr.clip(cu * depth * dr.rsqrt(dr.maximum(1 - cu * cu, 1e-12)), self._x0, self._x1)
        d2 = x * x + depth * depth
        h0, h1 = (y * dr.rsqrt(d2 + y * y) for y in (self._y0, self._y1))
        hv = dr.lerp(h0, h1, u.y)
        y = hv * dr.sqrt(d2) * dr.rsqrt(dr.maximum(1 - hv * hv, 1e-12))
        return x, dr.clip(y, self._y0, self._y1)
