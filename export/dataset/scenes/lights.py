"""Random lights of all kinds. Strengths are those at a distance of a metre, so that the kinds compare."""

import colorsys
import math
from dataclasses import replace

import numpy as np

from app.arrays import F64
from app.math3d import normalize
from app.scene import DirectionalLight, Light, PointLight, RectLight, SpotLight
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.materials import Color

MAX_STEP = 0.08  # metres, or for directional lights radians, that a light moves between two frames


def random_light_color(rng: Rng, mean: float, saturated: float = 0.15) -> Color:
    """A radiance, intensity or irradiance from a fifth of ``mean`` to five times it.

    Its tint is between warm and cool white, or with probability ``saturated`` of any hue.
    """
    if rng.random() < saturated:
        tint = np.array(colorsys.hsv_to_rgb(rng.random(), float(rng.uniform(0.4, 1.0)), 1.0))
    else:
        warmth = rng.uniform(-1, 1)
        tint = np.array([1 + 0.3 * warmth, 1.0, 1 - 0.45 * warmth])
        tint /= tint.max()
    return _triple(tint * (mean * 5 ** rng.uniform(-1, 1)))


def local_light(rng: Rng, at: F64, intensity: float) -> Light:
    """A point, sphere or spot light of about ``intensity`` W/sr."""
    kind = rng.choice(4, p=(0.25, 0.35, 0.25, 0.15))
    position, color = _triple(at), random_light_color(rng, intensity)
    if kind == 0:
        return PointLight(position, color)
    if kind == 1:
        return PointLight(position, color, radius=float(rng.uniform(0.03, 0.2)))
    down = np.array([rng.normal(0, 0.6), -1.0, rng.normal(0, 0.6)])
    return _spot(rng, at, down, _triple(np.multiply(color, 3.0)), max_outer_deg=75, soft=kind == 3)


def spot(rng: Rng, at: F64, towards: F64, intensity: float) -> SpotLight:
    """A narrow spot light of about ``intensity`` W/sr."""
    color = random_light_color(rng, intensity)
    return _spot(rng, at, towards, color, max_outer_deg=45, soft=bool(rng.random() < 0.5))


def panel(rng: Rng, at: F64, intensity: float) -> RectLight:
    """A horizontal rectangle that emits downwards, with about ``intensity`` W/sr along its normal."""
    width, depth = rng.uniform(0.2, 1.5, 2).tolist()
    angle = rng.uniform(0, math.pi)
    u = np.array([math.cos(angle), 0.0, math.sin(angle)]) * width
    v = np.array([math.sin(angle), 0.0, -math.cos(angle)]) * -depth
    if np.cross(u, v)[1] > 0:
        u = -u
    return RectLight(_triple(at), _triple(u), _triple(v), random_light_color(rng, intensity / (width * depth)))


def window(rng: Rng, centre: F64, inward: F64, size: tuple[float, float], intensity: float) -> RectLight:
    """An upright rectangle that emits along ``inward``, like a window in front of an overcast sky."""
    u = normalize(np.cross([0.0, 1.0, 0.0], inward)) * size[0]
    return RectLight(_triple(centre), _triple(u), (0.0, size[1], 0.0),
                     random_light_color(rng, intensity / (size[0] * size[1])))


def sun(rng: Rng, azimuth: float | None = None, min_elevation_deg: float = 15.0,
        irradiance: float = 8.0) -> DirectionalLight:
    """Directional light that travels down and towards ``azimuth``, in radians from -z to x (random if None)."""
    phi = rng.uniform(0, 2 * math.pi) if azimuth is None else azimuth
    elevation = math.radians(rng.uniform(min_elevation_deg, 75.0))
    direction = np.array([math.sin(phi) * math.cos(elevation), -math.sin(elevation),
                          -math.cos(phi) * math.cos(elevation)])
    color = random_light_color(rng, irradiance, 0.04)
    kind = int(rng.integers(3))
    angular_radius_deg = float(rng.uniform(0.5, 4.0)) if kind == 2 else (0.0, 0.27)[kind]
    return DirectionalLight(_triple(direction), color, angular_radius_deg=angular_radius_deg)


def sky(rng: Rng, count: int, irradiance: float) -> list[Light]:
    """A few wide, dim, bluish suns all around that approximate a sky."""
    color = _triple(np.multiply((0.55, 0.75, 1.0), irradiance / count))
    first = rng.uniform(0, 2 * math.pi)
    lights: list[Light] = []
    for k in range(count):
        phi, elevation = first + 2 * math.pi * k / count, math.radians(rng.uniform(35, 75))
        direction = math.sin(phi) * math.cos(elevation), -math.sin(elevation), math.cos(phi) * math.cos(elevation)
        lights.append(DirectionalLight(direction, color, angular_radius_deg=float(rng.uniform(3, 6))))
    return lights


def displace(rng: Rng, light: Light) -> Light:
    """The light after a small random move."""
    step = rng.uniform(-MAX_STEP, MAX_STEP, 3)
    match light:
        case DirectionalLight():
            return replace(light, direction=_triple(normalize(np.asarray(light.direction) + step)))
        case RectLight():
            return replace(light, center=_triple(np.asarray(light.center) + step))
        case PointLight() | SpotLight():
            return replace(light, position=_triple(np.asarray(light.position) + step))


def _spot(rng: Rng, at: F64, towards: F64, intensity: Color, max_outer_deg: float, soft: bool) -> SpotLight:
    outer = float(rng.uniform(20, max_outer_deg))
    inner = outer * float(rng.uniform(0.3, 0.95))
    return SpotLight(_triple(at), _triple(normalize(towards)), intensity, inner_deg=inner, outer_deg=outer,
                     radius=float(rng.uniform(0.02, 0.1)) if soft else 0.0)


def _triple(values: F64) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
