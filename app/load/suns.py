"""Suns of an environment map -> directional lights, whose shadows are sharp.

A sun is a small, compact group of texels far above everything around it that gives a notable share of the map's light.
What it emits above its surroundings leaves the map and becomes the light, so no light is lost or counted twice.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F32, F64, Bools, Ints
from app.environment import row_solid_angles
from app.scene import DirectionalLight, Environment

MAX_SUNS = 4                 # the most powerful ones; further ones stay in the map
MAX_RADIUS_DEG = 3.0         # of a sun; larger ones are soft boxes, windows or clouds
MIN_CONTRAST = 10.0          # of a sun's brightest texel to everything around the sun
MIN_POWER_SHARE = 0.02       # of the map's light; dimmer ones are stars or hot pixels
MAX_OUTLIER_SHARE = 0.05     # of the light of texels as bright as a sun that lies outside it
MIN_COMPACTNESS = 0.4        # of the texels' spread: 1 for a disc, 0.2 for a strip ten times as long as wide
MAX_PEAKS = 64               # brightest places that are examined
EDGE_TEXELS = 2.0            # that a sun's edge may be blurred over
MIN_RING_TEXELS = 2.0        # width of the ring around a sun whose radiance replaces it ...
MIN_RING = math.radians(0.5)  # ... and that in radians
MAX_SOLID_ANGLE = 2 * math.pi * (1 - math.cos(math.radians(MAX_RADIUS_DEG)))


@dataclass(frozen=True, eq=False)
class _Texels:
    """Some texels of a map without rotation: flat indices, unit directions, mean radiance and solid angle, sr."""

    index: Ints
    direction: F64
    radiance: F64
    solid_angle: F64

    def __getitem__(self, chosen: Bools) -> "_Texels":
        return _Texels(self.index[chosen], self.direction[chosen], self.radiance[chosen], self.solid_angle[chosen])

    @property
    def power(self) -> F64:
        """Mean irradiance that each texel gives to a surface facing it, W/m², shape (N,)."""
        return self.radiance * self.solid_angle


def extract_suns(environment: Environment) -> tuple[Environment | None, list[DirectionalLight]]:
    """Split an environment into one without suns, None if that is black, and the suns, the most powerful first.

    The irradiance that a sun gives to a surface facing it is what its texels lose.
    """
    suns = sorted(_find_suns(environment.radiance), key=lambda sun: -sun.power.sum())[:MAX_SUNS]
    radiance, lights = environment.radiance, []
    for sun in suns:
        radiance, light = _extract(radiance, sun, environment.rotation_deg)
        lights.append(light)
    if not lights:
        return environment, []
    return (replace(environment, radiance=radiance) if radiance.any() else None), lights


def describe_sun(light: DirectionalLight) -> str:
    """A notice for the user; the azimuth is clockwise from -z, seen from above."""
    x, y, z = np.negative(light.direction).tolist()
    azimuth, elevation = math.degrees(math.atan2(x, -z)) % 360, math.degrees(math.asin(np.clip(y, -1, 1)))
    return (f"the environment's sun at azimuth {azimuth:.0f}°, elevation {elevation:.0f}° became a directional light "
            f"of {np.mean(light.irradiance):.3g} W/m²")


def _find_suns(radiance: F32) -> Iterator[_Texels]:
    """The texels of each sun of a map, shape (H, W, 3)."""
    bright, power = _bright_texels(radiance)
    unseen = bright.radiance.copy()
    for _ in range(MAX_PEAKS):
        peak = int(unseen.argmax()) if len(unseen) else 0
        if not len(unseen) or unseen[peak] * MAX_SOLID_ANGLE < MIN_POWER_SHARE * power:
            return
        near = bright.direction @ bright.direction[peak] >= math.cos(2 * math.radians(MAX_RADIUS_DEG))
        disc = _disc(bright[near & (bright.radiance >= bright.radiance[peak] / MIN_CONTRAST)])
        if disc is not None and disc.power.sum() >= MIN_POWER_SHARE * power:
            yield disc
        unseen[near] = 0


def _bright_texels(radiance: F32) -> tuple[_Texels, float]:
    """The texels that can belong to a sun, and the power of the whole map.

    A sun of the largest size and the least share of the power is ``MIN_POWER_SHARE`` 4π / ``MAX_SOLID_ANGLE``, about
    29, times as bright as the map's mean.
    """
    rows, columns = radiance.shape[:2]
    mean = radiance.mean(axis=2, dtype=np.float64)
    solid_angle = row_solid_angles(rows) / columns
    power = float(mean.sum(axis=1) @ solid_angle)
    threshold = MIN_POWER_SHARE * power / MAX_SOLID_ANGLE / MIN_CONTRAST
    index = np.flatnonzero(mean > threshold)
    return _Texels(index, _directions(index, rows, columns), mean.ravel()[index], solid_angle[index // columns]), power


def _disc(texels: _Texels) -> _Texels | None:
    """The texels without a few outliers if they fill a small disc, otherwise None."""
    inside = texels.direction @ _centroid(texels) >= math.cos(math.radians(MAX_RADIUS_DEG))
    disc = texels[inside]
    if disc.power.sum() < (1 - MAX_OUTLIER_SHARE) * texels.power.sum():
        return None
    spread = 2 * float(disc.power @ (1 - disc.direction @ _centroid(disc))) / float(disc.power.sum())  # mean square
    solid_angle = _solid_angle(disc)
    compact = solid_angle >= MIN_COMPACTNESS * 2 * math.pi * spread
    return disc if compact and solid_angle <= MAX_SOLID_ANGLE else None


def _extract(radiance: F32, sun: _Texels, rotation_deg: float) -> tuple[F32, DirectionalLight]:
    """The map with the sun replaced by what surrounds it, and the sun as a light."""
    footprint, around = _footprint(radiance, sun)
    texels = radiance.reshape(-1, 3)[footprint.index]
    rest = np.minimum(texels, around)
    excess = texels.astype(np.float64) - rest
    r, g, b = (footprint.solid_angle @ excess).tolist()
    emission = replace(footprint, radiance=excess.mean(axis=1))
    x, y, z = _centroid(emission).tolist()
    angle = math.radians(rotation_deg)
    c, s = math.cos(angle), math.sin(angle)
    radius = math.degrees(math.acos(1 - min(_solid_angle(emission), MAX_SOLID_ANGLE) / (2 * math.pi)))
    without = radiance.reshape(-1, 3).copy()
    without[footprint.index] = rest
    return without.reshape(radiance.shape), DirectionalLight((-c * x - s * z, -y, s * x - c * z), (r, g, b), radius)


def _footprint(radiance: F32, sun: _Texels) -> tuple[_Texels, F32]:
    """The sun's texels with those that its blurred edge may reach, and the median radiance, shape (3,), around them."""
    rows, columns = radiance.shape[:2]
    texel = math.pi / rows
    centre = _centroid(sun)
    inner = math.acos(np.clip((sun.direction @ centre).min(), -1, 1)) + EDGE_TEXELS * texel
    outer = inner + max(MIN_RING, MIN_RING_TEXELS * texel)
    polar = math.acos(np.clip(centre[1], -1, 1))
    first, last = np.clip(np.array([polar - outer, polar + outer]) / texel + (0, 1), 0, rows).astype(int)
    index = np.arange(first * columns, last * columns)
    direction = _directions(index, rows, columns)
    angle = np.arccos(np.clip(direction @ centre, -1, 1))
    inside, ring = angle <= inner, index[(angle > inner) & (angle <= outer)]
    flat = radiance.reshape(-1, 3)
    texels = _Texels(index[inside], direction[inside], flat[index[inside]].mean(axis=1, dtype=np.float64),
                     (row_solid_angles(rows) / columns)[index[inside] // columns])
    return texels, np.median(flat[ring], axis=0)


def _centroid(texels: _Texels) -> F64:
    """Unit direction, shape (3,), weighted by power."""
    total = texels.power @ texels.direction
    return np.asarray(total / np.linalg.norm(total))


def _solid_angle(texels: _Texels) -> float:
    """Solid angle, sr, of the uniform disc with the same power and the same power-weighted mean radiance."""
    power = texels.power
    return float(power.sum() ** 2 / (power @ texels.radiance))


def _directions(index: Ints, rows: int, columns: int) -> F64:
    """Directions, shape (N, 3), of texels given by flat indices."""
    polar = (index // columns + 0.5) * math.pi / rows
    azimuth = ((index % columns + 0.5) / columns - 0.5) * 2 * math.pi
    return np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)], axis=1)
