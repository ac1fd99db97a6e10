"""Irradiance and visibility in float64 numpy, by closed form or fine quadrature; independent of the shaders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def point_irradiance(points: F64, normal: F64, light: F64) -> F64:
    """Of intensity 1 at ``points`` [..., 3]."""
    to = np.asarray(light) - points
    square = (to * to).sum(-1)
    return np.maximum(to @ np.asarray(normal), 0) / square**1.5


def polygon_irradiance(points: F64, normal: F64, corners: F64) -> F64:
    """Of radiance 1, wholly above the horizon: half the sum of edge angles times their planes' slope (Lambert 1760)."""
    total = np.zeros(points.shape[:-1])
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        p, q = unit(a - points), unit(b - points)
        across = np.cross(p, q)
        total += np.arctan2(np.linalg.norm(across, axis=-1), (p * q).sum(-1)) * (unit(across) @ np.asarray(normal))
    return np.abs(total) / 2


def rectangle_quadrature(points: F64, normal: F64, corners: F64, steps: int = 200) -> F64:
    """As above by midpoints, so that any part may lie below the horizon; two-sided."""
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    facing = np.cross(u, v)
    at = (np.arange(steps) + 0.5) / steps
    total = np.zeros(points.shape[:-1])
    for s in at:
        to = corners[0] + s * u + at[:, None] * v - points[..., None, :]
        square = (to * to).sum(-1)
        total += (np.maximum(to @ np.asarray(normal), 0) * np.abs(to @ facing) / square**2).sum(-1)
    return total / steps**2


def sphere_quadrature(points: F64, normal: F64, center: F64, radius: float, steps: int = 200) -> F64:
    """Of intensity 1, that is radiance 1 / (π radius²), by midpoints of equal solid angle over the cap."""
    cap, rays = _cap_rays(points, center, radius, steps)
    return np.maximum(rays @ np.asarray(normal), 0).mean((-1, -2)) * cap / (np.pi * radius**2)


def disc_behind_edge(points: F64, center: F64, radius: float, edge_x: float, height: float, steps: int = 60) -> F64:
    """Share of a sphere seen past the half plane y = ``height``, x < ``edge_x``."""
    _, rays = _cap_rays(points, center, radius, steps)
    return _past_edge(points, rays, edge_x, height)


def parallel_behind_edge(points: F64, towards: F64, angular_radius: float, edge_x: float, height: float,
                         steps: int = 60) -> F64:
    """As above for a disc at infinity."""
    far = 1e6
    return disc_behind_edge(points, points + far * unit(np.asarray(towards, np.float64)),
                            far * np.sin(angular_radius), edge_x, height, steps)


def rectangle_behind_edge(points: F64, center: F64, half: float, edge_x: float, height: float) -> F64:
    """As above for a horizontal rectangle, ``half`` its half edge along x."""
    share = (height - points[..., 1]) / (center[1] - points[..., 1])
    hidden_up_to = points[..., 0] + (edge_x - points[..., 0]) / share  # of the light, along x
    return np.clip((center[0] + half - hidden_up_to) / (2 * half), 0, 1)


def width(x: F64, profile: F64, low: float = 0.05, high: float = 0.95) -> float:
    """Distance between the places where a rising ``profile`` passes ``low`` and ``high``."""
    return _crossing(x, profile, high) - _crossing(x, profile, low)


def _crossing(x: F64, profile: F64, level: float) -> float:
    """Mean over all crossings, since a noisy profile may pass a level more than once."""
    i = np.flatnonzero((profile[:-1] < level) != (profile[1:] < level))
    return float((x[i] + (level - profile[i]) / (profile[i + 1] - profile[i]) * (x[i + 1] - x[i])).mean())


def _past_edge(points: F64, rays: F64, edge_x: float, height: float) -> F64:
    rise = (height - points[..., 1])[..., None, None]
    x = points[..., 0][..., None, None] + rays[..., 0] / rays[..., 1] * rise
    return (x > edge_x).mean((-1, -2))


def _cap_rays(points: F64, center: F64, radius: float, steps: int) -> tuple[F64, F64]:
    """Solid angle of a sphere, and unit rays [..., steps, steps, 3] that share it evenly."""
    to = np.asarray(center) - points
    distance = np.linalg.norm(to, axis=-1)
    axis = to / distance[..., None]
    helper = np.where(np.abs(axis[..., :1]) < 0.6, [1.0, 0, 0], [0, 0, 1.0])
    side = unit(np.cross(axis, helper))
    other = np.cross(axis, side)
    limit = 1 - np.sqrt(1 - (radius / distance) ** 2)
    middle = (np.arange(steps) + 0.5) / steps
    cos = 1 - limit[..., None] * middle
    sin = np.sqrt(1 - cos**2)
    turn = 2 * np.pi * middle
    rays = (cos[..., :, None, None] * axis[..., None, None, :]
            + sin[..., :, None, None] * (np.cos(turn)[:, None] * side[..., None, None, :]
                                         + np.sin(turn)[:, None] * other[..., None, None, :]))
    return 2 * np.pi * limit, rays


def unit(v: F64) -> F64:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v), where=length > 0)


def ggx_albedo(alpha: float, n_v: float, schlick: bool = False) -> float:
    """Share of even light that a GGX lobe with F = 1 reflects to the viewer; midpoints over half vectors.

    With ``schlick`` F is (1 - v·h)⁵.
    """
    u, phi = np.meshgrid((np.arange(512) + 0.5) / 512, (np.arange(256) + 0.5) / 256 * 2 * np.pi, indexing="ij")
    n_h = np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u))  # half vectors as often as microfacets
    v_h = np.sqrt(1 - n_v**2) * np.sqrt(1 - n_h**2) * np.cos(phi) + n_v * n_h
    n_l = 2 * v_h * n_h - n_v
    smith = n_l * np.sqrt(n_v**2 * (1 - alpha**2) + alpha**2) + n_v * np.sqrt(n_l**2 * (1 - alpha**2) + alpha**2)
    weight = np.where((n_l > 0) & (v_h > 0), 0.5 / np.maximum(smith, 1e-9) * n_l * 4 * v_h / n_h, 0.0)
    return float((weight * (1 - np.clip(v_h, 0, 1)) ** 5 if schlick else weight).mean())


def ggx_compensation(f0: float | F64, alpha: float, n_v: float) -> F64:
    """Factor of light that microfacets scatter more than once (Turquin 2019)."""
    return np.asarray(1 + np.asarray(f0) * (1 / ggx_albedo(alpha, n_v) - 1))
