"""Where rays towards the environment are sent: lists of its parts, and surfels that share what they have found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.gl.sky_guide import ENTRIES, _entries
from app.raycast.caster import AttachedPoints, Caster
from app.scene import Environment
from app.sky_parts import PARTS, blur_parts, part_of
from app.surfels.sky_rays import SkyRays, _Guide, _Rays
from tests.gl.scenes import floor, make_scene


def test_entries_stand_for_equal_chances() -> None:
    chance = np.zeros((3, PARTS**2), np.float32)
    chance[0, 1023] = 1.0
    chance[1, [0, 7, 500]] = 0.5, 0.3, 0.2
    chance[2] = 1 / PARTS**2
    table = _entries(chance).astype(np.uint32)
    count, entry = table[:, :PARTS**2], table[:, PARTS**2:]
    np.testing.assert_allclose(count / ENTRIES, chance, atol=1 / ENTRIES)
    for row in range(3):
        part, index, number = entry[row] & 1023, entry[row] >> 10 & 2047, entry[row] >> 21
        np.testing.assert_array_equal(np.bincount(part, minlength=PARTS**2), count[row])
        np.testing.assert_array_equal(number, count[row, part])
        for chosen in np.unique(part):
            np.testing.assert_array_equal(index[part == chosen], np.arange(count[row, chosen]))


def test_blurred_parts_keep_their_light() -> None:
    light = np.zeros((2, PARTS**2), np.float32)
    light[0, 5 * PARTS + 31], light[1, 0] = 1.0, 2.0
    blurred = blur_parts(light).reshape(2, PARTS, PARTS)
    np.testing.assert_allclose(blurred.sum(axis=(1, 2)), [1.0, 2.0])
    assert blurred[0, 5, 0] > 0 and blurred[1, 0, 31] > 0  # azimuth goes around
    assert blurred[1, 31].max() == 0


@pytest.mark.parametrize("at", [0.0, 1 / 3, 1.0])
def test_points_at_the_edge_are_in_a_part(at: float) -> None:
    part = part_of(np.full((1, 2), at, np.float32))
    assert part[0] == min(int(at * PARTS), PARTS - 1) * (PARTS + 1)


def test_warped_points_have_the_density_that_is_said() -> None:
    rng = np.random.default_rng(0)
    count = 400
    position, normal = rng.random((count, 3), np.float32), np.tile(np.array([0, 1, 0], np.float32), (count, 1))
    part = rng.integers(200, 210, 4 * count)
    rays = _Rays(np.repeat(np.arange(count), 4), part, np.zeros((4 * count, 3), np.float32),
                 rng.random((4 * count, 3), np.float32))
    guide = _Guide((position, normal), rays, np.ones((4 * count, 3), np.float32), 1.0)
    chosen = int(np.flatnonzero(guide.is_known)[3])
    surfel = np.full(200_000, chosen)
    warped = part_of(guide.warp(surfel, rng.random((len(surfel), 2), np.float32)))
    found = np.bincount(warped, minlength=PARTS**2) / len(surfel)
    expected = guide.density(np.full(PARTS**2, chosen), np.arange(PARTS**2)) / PARTS**2
    assert expected.sum() == pytest.approx(1, rel=1e-4)
    np.testing.assert_allclose(found, expected, atol=0.003)


@pytest.mark.parametrize("weak", [0.1, 0.02])
def test_open_surfels_between_two_lamps_have_the_light_of_the_weak_one(weak: float) -> None:
    """Fully open, they see it whatever their rays have met."""
    radiance = np.zeros((32, 64, 3), np.float32)
    radiance[15, 3] = 1.0
    radiance[15, 35] = weak
    scene = replace(make_scene([floor(1.0)]), environment=Environment(radiance))
    caster = Caster(scene)
    towards = {sign: np.array([sign * np.sin(np.pi * 0.9), 0.0, sign * np.cos(np.pi * 0.9)]) for sign in (-1.0, 1.0)}
    down = np.tile(np.array([0, -1, 0], np.float32), (20, 1))
    start = np.random.default_rng(0).uniform((-0.5, 1.0, -0.5), (0.5, 1.0, 0.5), (20, 3)) - caster.origin
    hits = caster.cast(start.astype(np.float32), down)
    found = []
    for sign in towards:
        normal = np.tile(towards[sign].astype(np.float32), (20, 1))
        surfels = AttachedPoints(caster, hits.position + np.array([0, 1, 0], np.float32), normal, hits.anchors)
        found.append(SkyRays(caster, surfels, scene.environment).irradiance())
    dim, bright = sorted(found, key=lambda light: float(light.mean()))
    assert dim.min() > 0
    np.testing.assert_allclose(dim.mean() / bright.mean(), weak, rtol=0.05)
    np.testing.assert_allclose(dim, dim.mean(), rtol=1e-3)
