"""Light of single bright rays, spread over the surface that they start from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.math3d import LUMINANCE
from app.passes.gather_outliers import MAX_RATIO, spread_outliers

GRID = 80, 60
F32 = NDArray[np.float32]


def floor_and_wall(light: F32, rays: int = 1, columns: int = GRID[0]) -> tuple[F32, F32]:
    """What becomes of light, shape (h, w), where the right half of the picture is a wall, and of which texels."""
    y, x = (n.ravel() for n in np.mgrid[:GRID[1], :GRID[0]])
    on_wall = x >= GRID[0] // 2
    position = np.stack([x / 40 - 1, np.where(on_wall, y / 40, -1), np.where(on_wall, -3, y / 60 - 3)], 1)
    normal = np.where(on_wall[:, None], (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    traced = np.flatnonzero((x < columns) & ((x + y) % 2 == 0))
    before = np.repeat(light.astype(np.float32).reshape(-1, 1), 3, axis=1)[traced]
    found = spread_outliers(before, np.ones_like(before), rays, traced, position[traced].astype(np.float32),
                            normal[traced].astype(np.float32), GRID)
    shown = np.full(light.size, np.nan, np.float32)
    shown[traced] = found @ LUMINANCE.astype(np.float32)
    return shown.reshape(light.shape), found


def one_bright_ray(value: float = 300.0) -> F32:
    light = np.ones(GRID[::-1], np.float32)
    light[30, 20] = value
    return light


def test_light_of_one_ray_is_spread_over_its_surface() -> None:
    light = one_bright_ray()
    shown, _ = floor_and_wall(light)
    on_floor = shown[:, :GRID[0] // 2]
    np.testing.assert_allclose(np.nansum(shown), shown.size / 2 + 299, rtol=1e-4)
    assert np.nanmax(shown) < MAX_RATIO + 1
    assert np.nanmax(np.delete(on_floor.ravel(), 30 * on_floor.shape[1] + 20)) < 1.6
    np.testing.assert_array_equal(shown[:, GRID[0] // 2:][~np.isnan(shown[:, GRID[0] // 2:])], 1.0)


def test_light_within_what_is_expected_stays() -> None:
    light = np.random.default_rng(0).exponential(1.0, GRID[::-1]).astype(np.float32)
    shown, _ = floor_and_wall(light)
    traced = ~np.isnan(shown)
    np.testing.assert_allclose(shown[traced], light[traced], rtol=1e-5)
    four, _ = floor_and_wall(one_bright_ray(4.5), rays=4)  # together they are 18 times as bright as expected
    assert four[30, 20] < 4.3


def test_a_small_surface_is_not_overwhelmed() -> None:
    """A strip of two columns: what would more than double its light is lost."""
    light = np.ones(GRID[::-1], np.float32)
    light[30, 0] = 1e5
    shown, _ = floor_and_wall(light, columns=2)
    assert np.nanmax(np.delete(shown.ravel(), 30 * GRID[0])) <= 2.001
    assert np.nanmax(shown) <= MAX_RATIO + 1.001


def test_no_light_and_no_texels_leave_nothing() -> None:
    shown, _ = floor_and_wall(np.zeros(GRID[::-1], np.float32))
    assert np.nanmax(shown) == 0
    none = np.zeros((0, 3), np.float32)
    assert len(spread_outliers(none, none, 1, np.zeros(0, np.int64), none, none, GRID)) == 0
    _, found = floor_and_wall(one_bright_ray(1e30))
    assert np.isfinite(found).all()
