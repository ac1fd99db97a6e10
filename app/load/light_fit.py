"""Lights that stand for emission patches, with the same power and moments, and the irradiance of both."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.arrays import F64, Ints
from app.load.emission_patches import Patches
from app.load.scene_builder import color, vector
from app.scene import Light, PointLight, RectLight

RECT_SAMPLES = 6           # patches along each edge of a rectangle, for its irradiance
MIN_MEAN_NORMAL = 1e-3     # below it a rectangle has no front
MIN_SECOND_SHARE = 0.02    # of the emission, across the main direction, that is worth a second rectangle
MIN_RECT_WIDTH = 1e-3      # of a rectangle's longer edge
MAX_ELONGATION = 3.0       # of patches that a sphere may stand for: their deviation along and across
MAX_SQUARENESS_ERROR = 1e-6  # relative difference of variances below which a rectangle's direction is arbitrary
CHUNK = 2**12              # patches at once, which bounds the memory


@dataclass(frozen=True, eq=False)
class Receivers:
    """R points with unit normals where irradiance is compared, both float64 (R, 3)."""

    position: F64
    normal: F64


@dataclass(frozen=True, eq=False)
class Fit:
    """One light or two, their irradiance at R receivers, float64, shape (R, 3), in W/m², and the area that emits."""

    lights: tuple[Light, ...]
    irradiance: F64
    area: float


def fit_lights(patches: Patches, rows: Ints, receivers: Receivers) -> Iterator[Fit]:
    """Lights with the power and variances of the patches ``rows``.

    A sphere, unless they form a line; if the patches have normals, also a rectangle that emits to one side or to both,
    and two such rectangles at a right angle, as a tube looks like.
    """
    weight, position, normal = patches.weight[rows], patches.position[rows], patches.normal[rows]
    power, total = patches.power[rows].sum(axis=0), weight.sum()
    center = weight @ position / total
    away = position - center
    covariance = (np.einsum("n,nij->ij", weight, patches.covariance[rows])
                  + np.einsum("n,ni,nj->ij", weight, away, away)) / total
    variances = np.linalg.eigvalsh(covariance)
    if variances[2] <= MAX_ELONGATION**2 * variances[1] or not normal.any():
        yield _fit_sphere(power, center, covariance, receivers)
    flux = weight @ normal
    length = float(np.linalg.norm(flux))
    if length > MIN_MEAN_NORMAL * total and not patches.two_sided[rows].any():
        yield _fit_rectangle(power, center, covariance, flux / length, False, receivers)
    if normal.any():
        shares, axes = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, normal, normal) / total)
        first, second = (_orient(axes[:, k]) for k in (2, 1))
        yield _fit_rectangle(power, center, covariance, first, True, receivers)
        if shares[1] > MIN_SECOND_SHARE:
            share = shares[2] / (shares[1] + shares[2])
            one = _fit_rectangle(share * power, center, covariance, first, True, receivers)
            other = _fit_rectangle((1 - share) * power, center, covariance, second, True, receivers)
            yield Fit(one.lights + other.lights, one.irradiance + other.irradiance, one.area + other.area)


def form_factors(patches: Patches, receivers: Receivers) -> F64:
    """Unoccluded irradiance in W/m² of each patch at each receiver, per watt of its power; shape (R, N)."""
    chunks = range(0, len(patches.position), CHUNK)
    return np.concatenate([_form_factors(patches, slice(k, k + CHUNK), receivers) for k in chunks], axis=1)


def _form_factors(patches: Patches, rows: slice, receivers: Receivers) -> F64:
    to = patches.position[rows] - receivers.position[:, None]
    square = np.maximum(np.einsum("rni,rni->rn", to, to), 1e-300)
    distance = np.sqrt(square)
    received = np.einsum("rni,ri->rn", to, receivers.normal) / distance
    variance = np.trace(patches.covariance[rows], axis1=1, axis2=2)
    normal, two_sided = patches.normal[rows], patches.two_sided[rows]
    has_normal = normal.any(axis=1)
    # A disc and a sphere with that variance have the squared radii 2 σ² and σ².
    emitted = -np.einsum("rni,ni->rn", to, normal) / distance
    emitted = np.where(two_sided, np.abs(emitted) / 2, np.maximum(emitted, 0))
    disc = np.maximum(received, 0) * emitted / (np.pi * (square + 2 * variance))
    out = disc
    balls = np.flatnonzero(~has_normal)
    if len(balls):
        radius = np.sqrt(np.maximum(variance[balls], 1e-300))
        form = _sphere_form(received[:, balls], distance[:, balls] / radius)
        out[:, balls] = form / (4 * np.pi**2 * radius**2)
    return np.asarray(out)


def _sphere_form(cosine: F64, h: F64) -> F64:
    """Form factor times π of a sphere whose centre is at distance / radius ``h``, as in shaders/include/lights.glsl."""
    h = np.maximum(h, 1.0001)
    form = np.pi * np.maximum(cosine, 0) / h**2
    partial = np.abs(h * cosine) < 1
    c, k = cosine[partial], h[partial]
    sine, x = np.sqrt(np.maximum(1 - c * c, 1e-8)), np.sqrt(k * k - 1)
    y = np.clip(-x * c / sine, -1, 1)
    root = sine * np.sqrt(1 - y * y)
    form[partial] = np.maximum((c * np.arccos(y) - x * root) / k**2 + np.arctan(root / x), 0)
    return form


def _fit_sphere(power: F64, center: F64, covariance: F64, receivers: Receivers) -> Fit:
    radius = float(np.sqrt(np.trace(covariance)))
    patch = Patches(power[None], center[None], covariance[None], np.zeros((1, 3)), np.zeros(1, bool), np.zeros(1, int),
                    np.array([4 * np.pi * radius**2]))
    return Fit((PointLight(vector(center), color(power / (4 * np.pi)), radius),),
               form_factors(patch, receivers) * power, float(patch.area[0]))


def _fit_rectangle(power: F64, center: F64, covariance: F64, axis: F64, two_sided: bool,
                   receivers: Receivers) -> Fit:
    """A rectangle across the unit vector ``axis``; its variances along its edges w and h are w² / 12 and h² / 12."""
    across = np.eye(3) - np.outer(axis, axis)
    values, vectors = np.linalg.eigh(across @ covariance @ across)
    u = vectors[:, 2] - vectors[:, 2] @ axis * axis
    if values[2] - values[1] <= MAX_SQUARENESS_ERROR * values[2]:
        u = across[:, np.argmax(np.diag(across))]  # along the world axis that lies flattest
    u = _orient(u / np.linalg.norm(u))
    v = np.cross(axis, u)
    width, height = (math.sqrt(max(12 * float(e @ covariance @ e), 0.0)) for e in (u, v))
    width, height = (max(edge, MIN_RECT_WIDTH * max(width, height)) for edge in (width, height))
    u, v = width * u, height * v
    radiance = power / (np.pi * max(width * height, 1e-300) * (2 if two_sided else 1))
    light = RectLight(vector(center), vector(u), vector(v), color(radiance), two_sided)
    parts = _divide(light, axis)
    return Fit((light,), form_factors(parts, receivers).mean(axis=1, keepdims=True) * power, float(parts.area.sum()))


def _divide(light: RectLight, axis: F64) -> Patches:
    """``RECT_SAMPLES``² equal parts of a rectangle."""
    count = RECT_SAMPLES**2
    at = (np.arange(RECT_SAMPLES) + 0.5) / RECT_SAMPLES - 0.5
    s, t = (x.reshape(-1, 1) for x in np.meshgrid(at, at))
    u, v = np.asarray(light.edge_u), np.asarray(light.edge_v)
    covariance = (np.outer(u, u) + np.outer(v, v)) / (12 * count)
    area = np.linalg.norm(np.cross(u, v)) * (2 if light.two_sided else 1)
    return Patches(np.ones((count, 3)), np.asarray(light.center) + s * u + t * v, np.tile(covariance, (count, 1, 1)),
                   np.tile(axis, (count, 1)), np.full(count, light.two_sided), np.zeros(count, int),
                   np.full(count, area / count))


def _orient(axis: F64) -> F64:
    """Of the two directions of a line, the one whose largest component is positive."""
    return axis if axis[np.argmax(np.abs(axis).round(6))] > 0 else -axis
