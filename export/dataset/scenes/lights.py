"""Random lights of all kinds. Light is measured by the irradiance that it gives at a metre, so that kinds compare."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.math3d import normalize
from app.scene import DirectionalLight, Light, PointLight, RectLight, SpotLight
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.materials import Color

F64 = NDArray[np.float64]

FASTEST = 0.08  # metres, or radians of a sun, that a light moves between two frames


def tint(rng: Rng, saturated: float) -> Color:
    """The colour of a lamp, largest component 1: warm to cool white, or ``saturated`` so often."""
    if rng.random() < saturated:
        return colorsys.hsv_to_rgb(rng.random(), float(rng.uniform(0.4, 1.0)), 1.0)
    warmth = rng.uniform(-1, 1)
    shade = np.array([1 + 0.3 * warmth, 1.0, 1 - 0.45 * warmth])
    return _triple(shade / shade.max())


def strength(rng: Rng, mean: float, saturated: float = 0.15) -> Color:
    """A tinted light of about ``mean``, a fifth to five times."""
    return _scaled(tint(rng, saturated), mean * 5 ** rng.uniform(-1, 1))


def lamp(rng: Rng, at: F64, watts: float) -> Light:
    """A point, sphere or spot light at ``at`` of about ``watts`` W/sr."""
    kind = rng.choice(4, p=(0.25, 0.35, 0.25, 0.15))
    position, intensity = _triple(at), strength(rng, watts)
    if kind == 0:
        return PointLight(position, intensity)
    if kind == 1:
        return PointLight(position, intensity, radius=float(rng.uniform(0.03, 0.2)))
    down = np.array([rng.normal(0, 0.6), -1.0, rng.normal(0, 0.6)])
    return _spot(rng, at, down, _scaled(intensity, 3.0), widest_deg=75, soft=kind == 3)


def spot(rng: Rng, at: F64, towards: F64, watts: float) -> SpotLight:
    """A spot light at ``at`` of about ``watts`` W/sr, as narrow as those that are to light a wall."""
    return _spot(rng, at, towards, strength(rng, watts), widest_deg=45, soft=bool(rng.random() < 0.5))


def panel(rng: Rng, at: F64, watts: float) -> RectLight:
    """A horizontal rectangle at ``at`` that shines down with about ``watts`` W/sr."""
    width, depth = rng.uniform(0.2, 1.5, 2).tolist()
    angle = rng.uniform(0, math.pi)
    u = np.array([math.cos(angle), 0.0, math.sin(angle)]) * width
    v = np.array([math.sin(angle), 0.0, -math.cos(angle)]) * -depth
    if np.cross(u, v)[1] > 0:
        u = -u
    return RectLight(_triple(at), _triple(u), _triple(v), strength(rng, watts / (width * depth)))


def window(rng: Rng, centre: F64, inward: F64, size: tuple[float, float], watts: float) -> RectLight:
    """An upright rectangle that shines along ``inward``, as a window with an overcast sky behind."""
    u = normalize(np.cross([0.0, 1.0, 0.0], inward)) * size[0]
    return RectLight(_triple(centre), _triple(u), (0.0, size[1], 0.0), strength(rng, watts / (size[0] * size[1])))


def sun(rng: Rng, azimuth: float | None = None, lowest_deg: float = 15.0, irradiance: float = 8.0) -> DirectionalLight:
    """Parallel light that travels towards ``azimuth`` (radians from -z to x; any without) and down."""
    turn = rng.uniform(0, 2 * math.pi) if azimuth is None else azimuth
    height = math.radians(rng.uniform(lowest_deg, 75.0))
    direction = np.array([math.sin(turn) * math.cos(height), -math.sin(height), -math.cos(turn) * math.cos(height)])
    return DirectionalLight(_triple(direction), strength(rng, irradiance, 0.04), angular_radius_deg=_sun_radius(rng))


def sky(rng: Rng, count: int, irradiance: float) -> list[Light]:
    """A few wide, weak, bluish suns all around, in place of a sky."""
    shade = _scaled((0.55, 0.75, 1.0), irradiance / count)
    first = rng.uniform(0, 2 * math.pi)
    lights: list[Light] = []
    for k in range(count):
        turn, height = first + 2 * math.pi * k / count, math.radians(rng.uniform(35, 75))
        direction = (math.sin(turn) * math.cos(height), -math.sin(height), math.cos(turn) * math.cos(height))
        lights.append(DirectionalLight(direction, shade, angular_radius_deg=float(rng.uniform(3, 6))))
    return lights


def moved(rng: Rng, light: Light) -> Light:
    """Where ``light`` was a frame before."""
    step = rng.uniform(-FASTEST, FASTEST, 3)
    match light:
        case DirectionalLight():
            return replace(light, direction=_triple(normalize(np.asarray(light.direction) + step)))
        case RectLight():
            return replace(light, center=_triple(np.asarray(light.center) + step))
        case PointLight() | SpotLight():
            return replace(light, position=_triple(np.asarray(light.position) + step))


def _spot(rng: Rng, at: F64, towards: F64, intensity: Color, widest_deg: float, soft: bool) -> SpotLight:
    outer = float(rng.uniform(20, widest_deg))
    inner = outer * float(rng.uniform(0.3, 0.95))
    return SpotLight(_triple(at), _triple(normalize(towards)), intensity, inner_deg=inner, outer_deg=outer,
                     radius=float(rng.uniform(0.02, 0.1)) if soft else 0.0)


def _sun_radius(rng: Rng) -> float:
    choices: tuple[Callable[[], float], ...] = (lambda: 0.0, lambda: 0.27, lambda: float(rng.uniform(0.5, 4.0)))
    return choices[rng.integers(3)]()


def _scaled(shade: Color, factor: float) -> Color:
    return _triple(np.asarray(shade) * factor)


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
