"""Which lights' shadows are traced: of lights that are too large for shadow maps, or too many.

A shadow map shows a scene from one point of the light. What the rest of the light sees differs the more, the larger the
angle that the light subtends at a receiver. Every map also costs a search at each pixel and room in the atlas; traced
lights share the rays of a frame, whatever their number.
"""

from collections.abc import Callable, Container, Iterable, Sequence

import numpy as np

from app.arrays import F64, Bools
from app.raycast.caster import Caster
from app.scene import DirectionalLight, Light, PointLight, RectLight, SpotLight

POINTS = 1024             # on the scene's surfaces, at each key time
MAX_RELATIVE_SIZE = 0.05  # radius / distance up to which one map will do
MAX_NEAR_SHARE = 0.02     # of what a light lights may lie nearer to it
MAX_SOFT_MAPS = 2         # of small lights with an area; each costs about ten times as much as a traced one
MAX_HARD_MAPS = 12        # of lights without one


def needs_rays(lights: Sequence[Light], hide_themselves: Container[Light], caster: Callable[[], Caster],
               times: Iterable[float]) -> tuple[bool, ...]:
    """Whether each light's shadows must be traced.

    Parameters
    ----------
    hide_themselves : container of Light
        Those that stand for surfaces that hide each other, which no map holds.
    caster : callable
        Gives the caster of the scene; called only if a light has an area.
    times : iterable of float
        Seconds at which the scene's objects are looked at.
    """
    areas = [_center_and_radius(light) for light in lights]
    traced = np.array([light in hide_themselves for light in lights], np.bool_)
    if any(radius > 0 for _, radius in areas):
        traced |= _too_large(lights, areas, caster, times)
    is_soft = np.array([radius > 0 for _, radius in areas], np.bool_)
    is_lamp = np.array([_is_lit_lamp(light) for light in lights], np.bool_)
    for alike, most in ((is_lamp & is_soft, MAX_SOFT_MAPS), (is_lamp & ~is_soft, MAX_HARD_MAPS)):
        if np.count_nonzero(alike & ~traced) > most:
            traced |= alike
    return tuple(traced.tolist())


def _is_lit_lamp(light: Light) -> bool:
    """Whether it shines from somewhere in the scene, with a light that is a number."""
    if isinstance(light, DirectionalLight):
        return False
    color = light.radiance if isinstance(light, RectLight) else light.intensity
    return bool(np.isfinite(color).all() and max(color) > 0)


def _too_large(lights: Sequence[Light], areas: Sequence[tuple[F64, float]], caster: Callable[[], Caster],
               times: Iterable[float]) -> Bools:
    counts = np.zeros((len(areas), 2), np.int64)  # of points that each light lights, and of the near ones among them
    rays, rng = caster(), np.random.default_rng(0)
    for time in times:
        rays.move_to(time)
        points = rays.random_points(POINTS, rng).astype(np.float64) + rays.origin
        counts += [_count_near(light, *area, points, rays) for light, area in zip(lights, areas, strict=True)]
    # A light of which nothing sees the centre is traced too: nothing is known about what sees the rest of it.
    return np.array([radius > 0 and near >= MAX_NEAR_SHARE * lit
                     for (_, radius), (lit, near) in zip(areas, counts, strict=True)], np.bool_)


def _center_and_radius(light: Light) -> tuple[F64, float]:
    """Centre in world space, shape (3,), and radius of a sphere around the light; 0 for parallel and point lights."""
    match light:
        case RectLight():
            return np.asarray(light.center), float(np.linalg.norm(np.add(light.edge_u, light.edge_v))) / 2
        case PointLight() | SpotLight():
            return np.asarray(light.position), light.radius
        case DirectionalLight():
            return np.zeros(3), 0.0


def _count_near(light: Light, center: F64, radius: float, points: F64, rays: Caster) -> tuple[int, int]:
    """How many world-space points see the light's centre, and how many of these are near for its size."""
    if radius <= 0:
        return 0, 0
    to_light = center - points
    distance = np.linalg.norm(to_light, axis=1)
    lit = _is_in_beam(light, to_light, distance) & (distance > 0)
    origins = (points[lit] - rays.origin).astype(np.float32)
    vectors = to_light[lit].astype(np.float32)
    away = np.float32(1e-3)  # off both ends, since surfaces of unknown side start and end the line
    seen = ~rays.is_occluded(origins + away * vectors, (1 - 2 * away) * vectors, False)
    near = radius > MAX_RELATIVE_SIZE * distance[lit]
    return int(seen.sum()), int((near & seen).sum())


def _is_in_beam(light: Light, to_light: F64, distance: F64) -> Bools:
    """Whether points lie where the light sends light at all, shape (N,)."""
    match light:
        case RectLight(two_sided=False):
            return np.asarray(to_light @ np.cross(light.edge_u, light.edge_v) < 0)
        case SpotLight():
            axis = np.asarray(light.direction) / np.linalg.norm(light.direction)
            return np.asarray(-to_light @ axis >= np.cos(np.radians(light.outer_deg)) * distance)
    return np.ones(len(to_light), np.bool_)
