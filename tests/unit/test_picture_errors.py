"""The ambient oracle, and which layers are compared."""

from __future__ import annotations

import numpy as np
import pytest

from app.evaluation import metrics, reference
from app.evaluation.picture_errors import best_ambient, errors_of


def test_the_best_ambient_is_the_constant_that_was_there() -> None:
    random = np.random.default_rng(2)
    base = random.random((12, 16, 3), np.float32)
    albedo = random.random((12, 16, 3), np.float32)
    constant = np.array([0.3, 0.05, 0.0], np.float32)
    np.testing.assert_allclose(best_ambient(base, albedo, base + albedo * constant), constant, atol=1e-3)


def test_the_best_ambient_may_be_one_bright_channel() -> None:
    black = np.zeros((4, 5, 3), np.float32)
    albedo, red = black + 0.1, np.array([0.6, 0, 0], np.float32)
    albedo[0, :2] = 1  # sets an exposure at which the rest is not white
    np.testing.assert_allclose(best_ambient(black, albedo, albedo * red), red, atol=1e-3)


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e6])
def test_the_best_strength_of_light_is_found_however_dim_or_coloured(scale: float) -> None:
    light = scale * np.random.default_rng(0).random((8, 8, 3), np.float32) * np.float32([1, 1, 0.02])
    factor = np.float32([2, 0.5, 100])
    np.testing.assert_allclose(best_ambient(0 * light, light, light * factor), factor, rtol=2e-3)


def test_the_best_ambient_has_the_smallest_squared_error() -> None:
    black = np.zeros((1, 10, 3), np.float32)
    final = np.full((1, 10, 3), 0.2, np.float32)
    final[0, :3] = 0.7
    exposure = metrics.exposure_of(final)
    mean = metrics.tone_map(final, exposure).mean(axis=(0, 1))
    np.testing.assert_allclose(metrics.tone_map(best_ambient(black, black + 1, final), exposure), mean, atol=1e-3)


def test_without_light_the_best_ambient_is_none() -> None:
    black = np.zeros((4, 4, 3), np.float32)
    assert best_ambient(black, black + 0.5, black).tolist() == [0, 0, 0]


def test_without_a_visible_surface_indirect_light_is_not_compared() -> None:
    empty = reference.Reference({name: np.zeros((12, 16, 1 if name == "depth" else 3), np.float32)
                                 for name in reference.LAYERS}, {}, "k")
    assert set(errors_of(empty.layers, empty)) == {"direct", "final"}
