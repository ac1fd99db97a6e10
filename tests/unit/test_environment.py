"""Environments as data: which way is where, and how much light comes from where."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import sph_harm_y

from app.environment import CELLS, ORDER, harmonics, radiance_along, sky_light, spherical_harmonics, texel_directions
from app.scene import Environment

RIGHT, UP, BACK = np.eye(3)
RED, GREEN, BLUE = np.eye(3, dtype=np.float32)


def compass(size: int = 8, rotation: float = 0.0) -> Environment:
    """Red where -z is, green to the right of it, blue behind, black on the left; size by 4 size texels."""
    colours = np.stack([BLUE, np.zeros(3, np.float32), RED, GREEN, BLUE])
    quarters = np.repeat(colours, [size // 2, size, size, size, size // 2], axis=0)
    return Environment(np.broadcast_to(quarters, (size, *quarters.shape)).copy(), rotation)


def test_the_middle_is_minus_z_and_x_is_right_of_it() -> None:
    found = radiance_along(compass(), np.stack([-BACK, RIGHT, BACK, -RIGHT]))
    np.testing.assert_array_equal(found, [RED, GREEN, BLUE, np.zeros(3)])


def test_rotation_turns_it_to_the_left() -> None:
    """A quarter of a turn, counter-clockwise seen from above, brings what was ahead to the left."""
    found = radiance_along(compass(rotation=90.0), np.stack([-RIGHT, -BACK, RIGHT, BACK]))
    np.testing.assert_array_equal(found, [RED, GREEN, BLUE, np.zeros(3)])


def test_rows_run_from_up_to_down_and_between_texels_it_is_linear() -> None:
    radiance = np.array([0.0, 1.0], np.float32)[:, None, None] * np.ones((2, 1, 3), np.float32)
    slanted = np.array([np.cos(0.25), np.sin(0.25), 0.0])
    found = radiance_along(Environment(radiance), np.stack([UP, -UP, RIGHT, slanted]))[:, 0]
    np.testing.assert_allclose(found, [0.0, 1.0, 0.5, 0.5 - 0.25 / (np.pi / 2)], atol=1e-6)


def test_texel_centres_are_where_they_are_looked_up() -> None:
    radiance = np.random.default_rng(0).random((6, 10, 3), np.float32)
    found = radiance_along(Environment(radiance), texel_directions(6, 10).reshape(-1, 3))
    np.testing.assert_allclose(found, radiance.reshape(-1, 3), atol=1e-5)


@pytest.mark.parametrize("count", [64, 144, 1000])
def test_an_even_sky_lights_by_its_radiance(count: int) -> None:
    """∫ L cos θ dω / π = L on a surface that sees half of it, and all of that is in the directions, too."""
    light = sky_light(Environment(np.full((1, 1, 3), 2.0, np.float32)), count)
    normals = np.stack([RIGHT, UP, -UP, np.array([0.6, 0.0, 0.8])])
    np.testing.assert_allclose(light.irradiance(normals, np.ones((4, count), bool)), 2.0, rtol=0.01)
    assert light.power.sum(axis=0) == pytest.approx(4 * np.pi * 2.0, rel=0.01)
    assert not light.irradiance(normals, np.zeros((4, count), bool)).any()


@pytest.mark.parametrize("size", [(16, 32), (100, 300), (512, 1024)])
def test_a_small_sun_keeps_its_light(size: tuple[int, int]) -> None:
    """One texel gives a surface that faces it 1 W/m²; a dim sky beside it."""
    h, w = size
    radiance = np.full((h, w, 3), 0.01, np.float32)
    row, column = h // 3, (2 * w) // 3
    radiance[row, column] = 1 / ((np.cos(row * np.pi / h) - np.cos((row + 1) * np.pi / h)) * 2 * np.pi / w)
    towards = texel_directions(h, w)[row, column]
    for rotation in (0.0, 77.0):
        turn = np.radians(rotation)
        facing = np.array([np.cos(turn) * towards[0] + np.sin(turn) * towards[2], towards[1],
                           np.cos(turn) * towards[2] - np.sin(turn) * towards[0]])
        light = sky_light(Environment(radiance, rotation), 144)
        found = light.irradiance(np.stack([facing, -facing]), np.ones((2, 144), bool))
        np.testing.assert_allclose(found[0], 1 / np.pi + 0.01, rtol=0.03)
        assert found[1].max() < 0.1 * found[0].min()
        behind = light.direction @ facing < 0.9
        assert light.irradiance(facing[None], behind[None]).max() < 0.05 * found[0].min()


def test_half_of_the_sky_hidden_is_half_of_the_light() -> None:
    light = sky_light(Environment(np.ones((4, 8, 3), np.float32)), 576)
    left = light.direction[:, 0] < 0
    np.testing.assert_allclose(light.irradiance(UP[None], left[None]), 0.5, rtol=0.05)


@pytest.mark.parametrize("weak", [0.01, 0.002])
def test_no_light_of_an_open_surface_is_lost(weak: float) -> None:
    """Opposite a bright patch is a weak one of another colour, which no direction may have been chosen for."""
    for row, column in ((5, 3), (9, 17), (12, 30)):
        radiance = np.zeros((16, 32, 3), np.float32)
        radiance[row, column] = 1.0, 0.5, 0.0
        radiance[15 - row, (column + 16) % 32] = 0.0, 0.0, weak
        normals = texel_directions(16, 32)[[row, 15 - row], [column, (column + 16) % 32]]
        light = sky_light(Environment(radiance), 144)
        expected = np.maximum(normals @ light.cell.T, 0) @ light.cell_power / np.pi
        assert expected[0, 0] > 0 and expected[1, 2] > 0
        np.testing.assert_allclose(light.irradiance(normals, np.ones((2, 144), bool)), expected, rtol=1e-5)


def test_cells_are_few() -> None:
    assert len(sky_light(compass(400), 16).cell) == np.prod(CELLS)


def test_spherical_harmonics_are_scipys() -> None:
    rng = np.random.default_rng(0)
    d = rng.normal(size=(50, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    theta, phi = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
    found = spherical_harmonics(d)
    for order in range(ORDER + 1):
        for m in range(-order, order + 1):
            y = sph_harm_y(order, abs(m), theta, phi) * (-1) ** m  # scipy's have the Condon-Shortley phase
            expected = y.real if m == 0 else np.sqrt(2) * (y.real if m > 0 else y.imag)
            np.testing.assert_allclose(found[:, order * (order + 1) + m], expected, atol=1e-12)


def test_harmonics_of_an_environment_bring_back_smooth_light() -> None:
    """A map made of harmonics has just their coefficients, in whatever space they are asked for."""
    rng = np.random.default_rng(1)
    wanted = np.concatenate([[[9.0] * 3], rng.uniform(-1, 1, (24, 3))])
    d = texel_directions(64, 128)
    environment = Environment((spherical_harmonics(d.reshape(-1, 3)) @ wanted).reshape(64, 128, 3).astype(np.float32))
    np.testing.assert_allclose(harmonics(environment, np.eye(3)).reshape(3, 25), wanted.T, atol=0.05)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned = harmonics(environment, turn).reshape(3, 25)
    towards = d.reshape(-1, 3)[::97]
    np.testing.assert_allclose(spherical_harmonics(towards @ turn.T) @ turned.T, radiance_along(environment, towards),
                               atol=0.1)
