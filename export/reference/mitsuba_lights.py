"""Environments as Mitsuba emitters, and analytic lights for Mitsuba's own integrators, which are only timed."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.arrays import F64
from app.environment import radiance_along, texel_directions
from app.math3d import look_rotation, normalize
from app.scene import DirectionalLight, Environment, Light, PointLight, RectLight, SpotLight

SUN_DISTANCE = 4e4        # scaled: distance of the spheres that stand for directional lights with an angular radius
SPOT_POINTS = 64          # point spots that approximate a spot with a radius
MIN_ENVIRONMENT_ROWS = 256
SIDE_GAP = 1e-4           # scaled: between the two sides of a two-sided emitter


def convert_light(mi: Any, light: Light, origin: F64, scale: float) -> Iterator[dict[str, Any]]:
    """Mitsuba emitters with the same emission as ``light``, in the scaled space of ``MitsubaScene``."""
    def to_scaled(point: tuple[float, float, float]) -> list[float]:
        return list((np.asarray(point, np.float64) - origin) * scale)

    match light:
        case PointLight(radius=0):
            yield {"type": "point", "position": to_scaled(light.position), "intensity": _rgb(light.intensity, scale**2)}
        case PointLight():
            yield _sphere(to_scaled(light.position), light.radius * scale,
                          _rgb(light.intensity, 1 / (math.pi * light.radius**2)))
        case SpotLight():
            yield from _spots(mi, light, to_scaled(light.position), scale)
        case DirectionalLight(angular_radius_deg=0):
            yield {"type": "directional", "direction": list(light.direction), "irradiance": _rgb(light.irradiance)}
        case DirectionalLight():
            sine = math.sin(math.radians(light.angular_radius_deg))
            center = -SUN_DISTANCE * normalize(np.asarray(light.direction, np.float64))
            yield _sphere(list(center), SUN_DISTANCE * sine, _rgb(light.irradiance, 1 / (math.pi * sine**2)))
        case RectLight():
            for sign in (1.0, -1.0) if light.two_sided else (1.0,):
                yield _rectangle(mi, light, to_scaled(light.center), scale, sign)


def convert_environment(mi: Any, environment: Environment) -> dict[str, Any]:
    """A Mitsuba environment map.

    Mitsuba's map begins at -z, and its first and last row lie exactly at the poles. Maps with few rows are therefore
    resampled to at least ``MIN_ENVIRONMENT_ROWS``.
    """
    h, w = environment.radiance.shape[:2]
    factor = -(-MIN_ENVIRONMENT_ROWS // h)
    h, w = factor * h, factor * w * (1 + factor * w % 2)  # an even width, which can be rolled by half
    radiance = environment.radiance
    if (h, w) != radiance.shape[:2]:
        radiance = radiance_along(Environment(radiance), texel_directions(h, w).reshape(-1, 3)).reshape(h, w, 3)
    bitmap = mi.Bitmap(np.ascontiguousarray(np.roll(radiance, w // 2, axis=1)))
    to_world = mi.ScalarTransform4f().rotate([0, 1, 0], environment.rotation_deg)
    return {"type": "envmap", "bitmap": bitmap, "to_world": to_world}


def _rgb(color: tuple[float, float, float], factor: float = 1.0) -> dict[str, Any]:
    return {"type": "rgb", "value": [c * factor for c in color]}


def _sphere(center: list[float], radius: float, radiance: dict[str, Any]) -> dict[str, Any]:
    return {"type": "sphere", "center": center, "radius": radius, "emitter": {"type": "area", "radiance": radiance}}


def _rectangle(mi: Any, light: RectLight, center: list[float], scale: float, sign: float) -> dict[str, Any]:
    u, v = np.asarray(light.edge_u, np.float64), sign * np.asarray(light.edge_v, np.float64)
    normal = normalize(np.cross(u, v))
    to_world = np.eye(4)
    to_world[:3] = np.stack([u * scale / 2, v * scale / 2, normal, center + SIDE_GAP * normal], axis=1)
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f(to_world),
            "emitter": {"type": "area", "radiance": _rgb(light.radiance)}}


def _spots(mi: Any, light: SpotLight, center: list[float], scale: float) -> Iterator[dict[str, Any]]:
    """One spot, or for a spot with a radius many on a sunflower pattern across its disc."""
    axis = normalize(np.asarray(light.direction, np.float64))
    right, up, _ = look_rotation(axis, np.array([0.0, 1.0, 0.0]))
    count = SPOT_POINTS if light.radius > 0 else 1
    for k in range(count):
        r, angle = light.radius * scale * math.sqrt((k + 0.5) / count), k * math.pi * (3 - math.sqrt(5))
        at = np.asarray(center) + r * (math.cos(angle) * right + math.sin(angle) * up)
        yield {"type": "spot", "intensity": _rgb(light.intensity, scale**2 / count),
               "cutoff_angle": light.outer_deg, "beam_width": min(light.inner_deg, light.outer_deg - 1e-3),
               "to_world": mi.ScalarTransform4f().look_at(origin=list(at), target=list(at + axis), up=list(up))}
