"""Unoccluded light by the inverse square law, against sums in double precision and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from export.models.panorama import (  # noqa: E402
    MIN_COSINE,
    directions,
    solid_angles,
    unoccluded_mean_radiance,
)

HEIGHT = 64
SOLID = torch.from_numpy(solid_angles(HEIGHT)).float()


def ball(radius: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Normal and depth of a ball around the camera."""
    normal = -torch.from_numpy(directions(HEIGHT)).float()[None]
    return normal, torch.full((1, 1, HEIGHT, 2 * HEIGHT), radius)


def test_directions_match_the_panorama() -> None:
    at = directions(HEIGHT)
    center = HEIGHT // 2
    np.testing.assert_allclose(np.linalg.norm(at, axis=0), 1.0)
    np.testing.assert_allclose(at[:, center, HEIGHT], (1 / 32, -1 / 32, -1), atol=1e-3)    # ahead, right and below
    np.testing.assert_allclose(at[:, center, 0], (-1 / 32, -1 / 32, 1), atol=1e-3)         # behind
    assert (at[1, 0] > 0.5).all() and (at[1, -1] < -0.5).all()


@pytest.mark.parametrize("radius", [0.5, 20.0])
def test_a_small_patch_follows_the_inverse_square_law(radius: float) -> None:
    normal, depth = ball(radius)
    light = torch.zeros(1, 3, HEIGHT, 2 * HEIGHT)
    light[:, :, 40, 10] = torch.tensor([1.0, 2.0, 4.0])
    patch = radius * torch.from_numpy(directions(HEIGHT)[:, 40, 10]).float()
    area = float(SOLID[40, 10]) * radius**2
    for distance in (0.5, 1.0, 3.0):
        point = (patch + distance * radius * torch.tensor([0.6, 0.0, -0.8])).reshape(1, 3, 1, 1)
        radiance = unoccluded_mean_radiance(light, normal, depth, SOLID, point)[0, :, 0, 0]
        expected = torch.tensor([1.0, 2.0, 4.0]) * area / (8 * np.pi * (distance * radius)**2)
        torch.testing.assert_close(radiance, expected, rtol=2e-2, atol=0.0)


def test_it_is_finite_inside_and_on_an_emitting_ball() -> None:
    """Half the radiance at the centre of a uniformly emitting ball, since flux spreads over a half space of 2 π.

    On the ball itself, only the size of the blocks bounds the integral of 1 / r².
    """
    normal, depth = ball(3.0)
    light = torch.ones(1, 3, HEIGHT, 2 * HEIGHT)
    inside = unoccluded_mean_radiance(light, normal, depth, SOLID, torch.zeros(1, 3, 1, 1))
    torch.testing.assert_close(inside, torch.full((1, 3, 1, 1), 0.5), rtol=0.1, atol=0.0)
    wall = unoccluded_mean_radiance(light, normal, depth, SOLID, torch.tensor([0.0, 0.0, -3.0]).reshape(1, 3, 1, 1))
    assert 0.5 < wall.max() < 1.5


def test_the_unit_of_length_does_not_matter() -> None:
    generator = torch.Generator().manual_seed(0)
    normal = torch.nn.functional.normalize(torch.randn(1, 3, HEIGHT, 2 * HEIGHT, generator=generator), dim=1)
    depth = 1 + 4 * torch.rand(1, 1, HEIGHT, 2 * HEIGHT, generator=generator)
    light = torch.rand(1, 3, HEIGHT, 2 * HEIGHT, generator=generator)**8
    points = torch.randn(1, 3, 4, 6, generator=generator)
    radiance = unoccluded_mean_radiance(light, normal, depth, SOLID, points)
    scaled = unoccluded_mean_radiance(light, normal, 7 * depth, SOLID, 7 * points)
    torch.testing.assert_close(scaled, radiance, rtol=1e-3, atol=0.0)
    surface = directions(HEIGHT) * depth[0].double().numpy()
    cosine = np.abs((normal[0].double().numpy() * surface).sum(0)) / np.sqrt((surface**2).sum(0))
    area = SOLID.double().numpy() * (surface**2).sum(0) / np.maximum(cosine, MIN_COSINE)
    far = np.array([300.0, 100.0, -200.0])  # far enough for blocks to be as accurate as texels
    expected = (light[0].double().numpy() * area / ((surface - far[:, None, None])**2).sum(0)).sum((1, 2)) / (8 * np.pi)
    at = unoccluded_mean_radiance(light, normal, depth, SOLID, torch.from_numpy(far).float().reshape(1, 3, 1, 1))
    np.testing.assert_allclose(at[0, :, 0, 0].numpy(), expected, rtol=1e-2)


def test_the_sky_is_uniform_and_black_surfaces_emit_nothing() -> None:
    normal, depth = torch.zeros(1, 3, HEIGHT, 2 * HEIGHT), torch.zeros(1, 1, HEIGHT, 2 * HEIGHT)
    points = 10 * torch.randn(1, 3, 3, 3, generator=torch.Generator().manual_seed(0))
    sky = unoccluded_mean_radiance(torch.ones(1, 3, HEIGHT, 2 * HEIGHT), normal, depth, SOLID, points)
    torch.testing.assert_close(sky, torch.ones(1, 3, 3, 3), rtol=1e-4, atol=0.0)
    assert not unoccluded_mean_radiance(torch.zeros(1, 3, HEIGHT, 2 * HEIGHT), *ball(1.0), SOLID, points).any()
