"""Environments as data: which way is where, and how much light comes from where."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import sph_harm_y

from app.arrays import F32, F64, Bools
from app.environment import (
    CELLS,
    ORDER,
    harmonics,
    radiance_along,
    sky_light,
    sky_points,
    spherical_harmonics,
    texel_directions,
)
from app.math3d import R2
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


def irradiance(environment: Environment, normal: F64,
               is_open: Callable[[F32], Bools] = lambda d: np.ones(len(d), bool)) -> F32:
    """Irradiance that points of the unit square give normals, shape (N, 3), along the directions that are open."""
    at = (0.5 + np.arange(2**16)[:, None] * np.array(R2)) % 1.0
    direction, light = sky_points(environment, at.astype(np.float32))
    cosine = np.maximum(np.asarray(normal, np.float32) @ direction.T, 0) * is_open(direction)
    return np.asarray(cosine @ light / len(at))


def test_an_even_sky_lights_by_its_radiance() -> None:
    """∫ L cos θ dω = π L on a surface that sees half of it."""
    environment = Environment(np.full((1, 1, 3), 2.0, np.float32))
    normals = np.stack([RIGHT, UP, -UP, np.array([0.6, 0.0, 0.8])])
    np.testing.assert_allclose(sky_light(environment, 64).unoccluded(normals), 2 * np.pi, rtol=0.01)
    np.testing.assert_allclose(irradiance(environment, normals), 2 * np.pi, rtol=0.01)
    assert sky_light(environment, 64).power.sum(axis=0) == pytest.approx(4 * np.pi * 2.0, rel=0.01)


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
        environment = Environment(radiance, rotation)
        for found in (sky_light(environment, 1).unoccluded(np.stack([facing, -facing])),
                      irradiance(environment, np.stack([facing, -facing]))):
            np.testing.assert_allclose(found[0], 1 + 0.01 * np.pi, rtol=0.03)
            assert found[1].max() < 0.1 * found[0].min()
        behind = irradiance(environment, facing[None], lambda d, facing=facing: d @ facing < 0.9)
        assert behind.max() < 0.05 * found[0].min()


def test_half_of_the_sky_hidden_is_half_of_the_light() -> None:
    found = irradiance(Environment(np.ones((4, 8, 3), np.float32)), UP[None], lambda d: np.asarray(d[:, 0] < 0))
    np.testing.assert_allclose(found, np.pi / 2, rtol=0.01)


@pytest.mark.parametrize("weak", [0.01, 0.002])
def test_dim_light_is_not_lost_beside_bright_light(weak: float) -> None:
    """Opposite a bright patch is a weak one of another colour: all that a point behind a window may see."""
    for row, column in ((5, 3), (9, 17), (12, 30)):
        radiance = np.zeros((16, 32, 3), np.float32)
        radiance[row, column] = 1.0, 0.5, 0.0
        radiance[15 - row, (column + 16) % 32] = 0.0, 0.0, weak
        normals = texel_directions(16, 32)[[row, 15 - row], [column, (column + 16) % 32]]
        environment = Environment(radiance)
        exact = sky_light(environment, 1).unoccluded(normals)
        assert exact[0, 0] > 0 and exact[1, 2] > 0
        np.testing.assert_allclose(irradiance(environment, normals), exact, rtol=0.02, atol=1e-3 * exact[1, 2])


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
