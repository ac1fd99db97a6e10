"""Unshadowed light of lit places: the inverse square law, against sums in double precision and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from export.models.panorama import directions, solid_angles  # noqa: E402
from export.models.unoccluded_mean_radiance import GRAZING, unoccluded_mean_radiance  # noqa: E402

HEIGHT = 64
SOLID = torch.from_numpy(solid_angles(HEIGHT)).float()


def inside_a_ball(radius: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Normal and depth that a camera in the middle of a ball sees."""
    normal = -torch.from_numpy(directions(HEIGHT)).float()[None]
    return normal, torch.full((1, 1, HEIGHT, 2 * HEIGHT), radius)


def test_directions_are_those_that_the_panorama_shows() -> None:
    at = directions(HEIGHT)
    middle = HEIGHT // 2
    np.testing.assert_allclose(np.linalg.norm(at, axis=0), 1.0)
    np.testing.assert_allclose(at[:, middle, HEIGHT], (1 / 32, -1 / 32, -1), atol=1e-3)    # ahead, right and below
    np.testing.assert_allclose(at[:, middle, 0], (-1 / 32, -1 / 32, 1), atol=1e-3)         # behind
    assert (at[1, 0] > 0.5).all() and (at[1, -1] < -0.5).all()


@pytest.mark.parametrize("radius", [0.5, 20.0])
def test_a_small_patch_sends_by_the_inverse_square_law(radius: float) -> None:
    normal, depth = inside_a_ball(radius)
    light = torch.zeros(1, 3, HEIGHT, 2 * HEIGHT)
    light[:, :, 40, 10] = torch.tensor([1.0, 2.0, 4.0])
    patch = radius * torch.from_numpy(directions(HEIGHT)[:, 40, 10]).float()
    area = float(SOLID[40, 10]) * radius**2
    for distance in (0.5, 1.0, 3.0):
        point = (patch + distance * radius * torch.tensor([0.6, 0.0, -0.8])).reshape(1, 3, 1, 1)
        found = unoccluded_mean_radiance(light, normal, depth, SOLID, point)[0, :, 0, 0]
        sent = torch.tensor([1.0, 2.0, 4.0]) * area / (8 * np.pi * (distance * radius)**2)
        torch.testing.assert_close(found, sent, rtol=2e-2, atol=0.0)


def test_it_is_finite_within_what_sends_and_half_as_much_seen_from_there() -> None:
    """Of a ball that shines from everywhere, in its middle: half the radiance, as flux goes to a half space of 2 π.

    On the ball itself the integral of 1 / r² has no end but that of the blocks' own size.
    """
    normal, depth = inside_a_ball(3.0)
    light = torch.ones(1, 3, HEIGHT, 2 * HEIGHT)
    middle = unoccluded_mean_radiance(light, normal, depth, SOLID, torch.zeros(1, 3, 1, 1))
    torch.testing.assert_close(middle, torch.full((1, 3, 1, 1), 0.5), rtol=0.1, atol=0.0)
    wall = unoccluded_mean_radiance(light, normal, depth, SOLID, torch.tensor([0.0, 0.0, -3.0]).reshape(1, 3, 1, 1))
    assert 0.5 < wall.max() < 1.5


def test_it_does_not_change_with_the_unit_of_length() -> None:
    generator = torch.Generator().manual_seed(0)
    normal = torch.nn.functional.normalize(torch.randn(1, 3, HEIGHT, 2 * HEIGHT, generator=generator), dim=1)
    depth = 1 + 4 * torch.rand(1, 1, HEIGHT, 2 * HEIGHT, generator=generator)
    light = torch.rand(1, 3, HEIGHT, 2 * HEIGHT, generator=generator)**8
    points = torch.randn(1, 3, 4, 6, generator=generator)
    found = unoccluded_mean_radiance(light, normal, depth, SOLID, points)
    torch.testing.assert_close(unoccluded_mean_radiance(light, normal, 7 * depth, SOLID, 7 * points), found, rtol=1e-3, atol=0.0)
    place = directions(HEIGHT) * depth[0].double().numpy()
    cosine = np.abs((normal[0].double().numpy() * place).sum(0)) / np.sqrt((place**2).sum(0))
    area = SOLID.double().numpy() * (place**2).sum(0) / np.maximum(cosine, GRAZING)
    far = np.array([300.0, 100.0, -200.0])  # from where blocks are as good as their texels
    sent = (light[0].double().numpy() * area / ((place - far[:, None, None])**2).sum(0)).sum((1, 2)) / (8 * np.pi)
    at = unoccluded_mean_radiance(light, normal, depth, SOLID, torch.from_numpy(far).float().reshape(1, 3, 1, 1))
    np.testing.assert_allclose(at[0, :, 0, 0].numpy(), sent, rtol=1e-2)


def test_the_sky_sends_the_same_everywhere_and_the_dark_nothing() -> None:
    normal, depth = torch.zeros(1, 3, HEIGHT, 2 * HEIGHT), torch.zeros(1, 1, HEIGHT, 2 * HEIGHT)
    points = 10 * torch.randn(1, 3, 3, 3, generator=torch.Generator().manual_seed(0))
    sky = unoccluded_mean_radiance(torch.ones(1, 3, HEIGHT, 2 * HEIGHT), normal, depth, SOLID, points)
    torch.testing.assert_close(sky, torch.ones(1, 3, 3, 3), rtol=1e-4, atol=0.0)
    assert not unoccluded_mean_radiance(torch.zeros(1, 3, HEIGHT, 2 * HEIGHT), *inside_a_ball(1.0), SOLID, points).any()
