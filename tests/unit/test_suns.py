"""Suns of an environment map as directional lights: energy, direction, size, and what is no sun."""

from __future__ import annotations

import numpy as np
import pytest

from app.environment import radiance_along, row_solid_angles, texel_directions
from app.load.suns import MAX_SUNS, extract_suns
from app.scene import DirectionalLight, Environment

F32, F64 = np.ndarray, np.ndarray
SKY = np.array([0.3, 0.5, 1.0], np.float32)
SUN = (3e4, 2e4, 1e4)
ROWS = 256
TEXEL_DEG = 180 / ROWS  # a sun's place and size are known to a fraction of it


def unit(azimuth_deg: float, elevation_deg: float) -> F64:
    a, e = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.sin(a) * np.cos(e), np.sin(e), -np.cos(a) * np.cos(e)])


def with_disc(radiance: F32, towards: F64, radius_deg: float, color: tuple[float, ...], samples: int = 6) -> F32:
    """The map with a disc of radiance ``color`` added, whose edge is antialiased."""
    h, w = radiance.shape[:2]
    fine = texel_directions(samples * h, samples * w) @ towards >= np.cos(np.radians(radius_deg))
    share = fine.reshape(h, samples, w, samples).mean(axis=(1, 3)).astype(np.float32)
    return radiance + share[..., None] * np.array(color, np.float32)


def even_sky(rows: int = ROWS) -> F32:
    return np.broadcast_to(SKY, (rows, 2 * rows, 3)).copy()


def irradiance(radiance: F32) -> F64:
    """∫ L dω of a map, shape (3,)."""
    h, w = radiance.shape[:2]
    return np.einsum("hwc,h->c", radiance.astype(np.float64), row_solid_angles(h) / w)


def angle_deg(light: DirectionalLight, towards: F64) -> float:
    return float(np.degrees(np.arccos(np.clip(-np.array(light.direction) @ towards, -1, 1))))


@pytest.mark.parametrize("elevation", [-20.0, 5.0, 45.0, 89.5, 90.0])
@pytest.mark.parametrize("radius", [0.27, 0.6, 2.0])
def test_a_sun_becomes_a_light_of_the_same_energy_direction_and_size(radius: float, elevation: float) -> None:
    towards = unit(-179.8, elevation)  # across the seam
    radiance = with_disc(even_sky(), towards, radius, SUN)
    rest, (light,) = extract_suns(Environment(radiance))
    added = irradiance(radiance) - irradiance(even_sky())
    np.testing.assert_allclose(light.irradiance, added, rtol=0.01)
    np.testing.assert_allclose(irradiance(rest.radiance) + light.irradiance, irradiance(radiance), rtol=1e-5)
    np.testing.assert_allclose(rest.radiance, even_sky(), rtol=1e-3, atol=SUN[0] * 1e-3)
    assert angle_deg(light, towards) < 0.3 * TEXEL_DEG
    assert light.angular_radius_deg == pytest.approx(radius, abs=0.7 * TEXEL_DEG)


@pytest.mark.parametrize("rotation", [30.0, 215.0])
def test_a_turned_sun_shines_from_where_it_is_seen(rotation: float) -> None:
    environment = Environment(with_disc(even_sky(), unit(70, 30), 1.5, SUN), rotation)
    _, (light,) = extract_suns(environment)
    shown = radiance_along(environment, -np.array([light.direction]))
    assert shown[0, 0] > 0.9 * SUN[0]


def test_several_suns_come_by_power_and_an_aureole_stays() -> None:
    glow = np.exp(-(np.arccos(np.clip(texel_directions(ROWS, 2 * ROWS) @ unit(0, 30), -1, 1)) / 0.15) ** 2)
    sky = even_sky() + 20 * glow[..., None].astype(np.float32)
    radiance = with_disc(with_disc(sky, unit(0, 30), 0.5, SUN), unit(120, 60), 1.0, SUN)
    rest, suns = extract_suns(Environment(radiance))
    assert [angle_deg(sun, at) < 0.1 for sun, at in zip(suns, (unit(120, 60), unit(0, 30)), strict=True)] == [True] * 2
    np.testing.assert_allclose(rest.radiance, sky, atol=3)


def test_the_sky_behind_a_sun_is_smooth() -> None:
    """What replaces a sun differs from its surroundings no more than these do among themselves."""
    slope = even_sky() * np.linspace(2, 1, ROWS, dtype=np.float32)[:, None, None]
    rest, suns = extract_suns(Environment(with_disc(slope, unit(40, 35), 0.27, SUN)))
    assert len(suns) == 1
    near = texel_directions(ROWS, 2 * ROWS) @ unit(40, 35) > np.cos(np.radians(0.4))
    np.testing.assert_allclose(rest.radiance[near], slope[near], rtol=0.05)


def sky_dome() -> F32:
    """Brighter towards the horizon and, smoothly, towards a sun that is not shown."""
    d = texel_directions(ROWS, 2 * ROWS)
    near = np.exp(-(np.arccos(np.clip(d @ unit(10, 40), -1, 1)) / 0.3) ** 2)
    return even_sky() * (1 + 3 * (1 - np.abs(d[..., 1:2])) ** 4 + 60 * near[..., None]).astype(np.float32)


def soft_boxes(size_deg: float, height_deg: float | None = None) -> F32:
    """Three bright rectangles in a dark studio."""
    radiance = np.full((ROWS, 2 * ROWS, 3), 0.01, np.float32)
    w, h = (int(size * ROWS / 180) for size in (size_deg, height_deg or size_deg))
    for row, column in ((40, 60), (110, 200), (100, 380)):
        radiance[row:row + h, column:column + w] = 50
    return radiance


def hot_pixels() -> F32:
    """Dim sky with three hundred stars, and one hot texel."""
    radiance, rng = even_sky(), np.random.default_rng(0)
    radiance[rng.integers(0, ROWS, 300), rng.integers(0, 2 * ROWS, 300)] = 40
    radiance[100, 77] = 200
    return radiance


@pytest.mark.parametrize("radiance", [
    np.zeros((ROWS, 2 * ROWS, 3), np.float32), even_sky(), sky_dome(), soft_boxes(8), soft_boxes(12), soft_boxes(40),
    soft_boxes(30, 1), hot_pixels(), np.random.default_rng(1).random((ROWS, 2 * ROWS, 3), np.float32) ** 8,
    np.ones((1, 1, 3), np.float32), with_disc(even_sky(8), unit(0, 30), 3, SUN)],
    ids=["black", "even", "dome", "box 8", "box 12", "box 40", "strip", "hot pixels", "noise", "one texel", "coarse"])
def test_what_is_no_sun_stays(radiance: F32) -> None:
    environment = Environment(radiance)
    rest, suns = extract_suns(environment)
    assert suns == [] and rest is environment


@pytest.mark.parametrize("size", [7.0, 9.0, 11.0, 14.0])
def test_no_corner_of_a_box_is_a_sun(size: float) -> None:
    assert extract_suns(Environment(soft_boxes(size)))[1] == []


def test_of_thirty_suns_only_a_few_become_lights() -> None:
    radiance = np.zeros((ROWS, 2 * ROWS, 3), np.float32)
    for k in range(30):
        radiance = with_disc(radiance, unit(24 * k, 12 * (k % 5)), 0.7, SUN, 3)
    rest, suns = extract_suns(Environment(radiance))
    assert len(suns) == MAX_SUNS
    total = irradiance(rest.radiance) + np.sum([sun.irradiance for sun in suns], axis=0)
    np.testing.assert_allclose(total, irradiance(radiance), rtol=1e-4)


def test_a_sun_in_a_black_sky_leaves_nothing() -> None:
    rest, suns = extract_suns(Environment(with_disc(0 * even_sky(), unit(5, 50), 0.5, SUN)))
    assert len(suns) == 1 and rest is None


@pytest.mark.parametrize("color", [(1e30, 1e30, 1e30), (1e-20, 2e-20, 1e-20), (0.0, 0.0, 5e4)], ids=str)
def test_extreme_suns_stay_finite(color: tuple[float, float, float]) -> None:
    radiance = with_disc(0 * even_sky(), unit(5, 50), 0.5, color)
    _, (light,) = extract_suns(Environment(radiance))
    np.testing.assert_allclose(light.irradiance, irradiance(radiance), rtol=1e-4)
    assert np.isfinite([*light.direction, light.angular_radius_deg]).all()
