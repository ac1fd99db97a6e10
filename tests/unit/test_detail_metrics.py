"""Metrics of detail in indirect light, on pictures whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="export needs torch")

from app.arrays import F32
from export.validation.detail_metrics import EDGE_RADIUS, TEXEL, DetailMetrics, near_edges

SIZE = (96, 128)
EDGE = 40  # the column where the right wall begins


def corner() -> tuple[F32, F32]:
    """Normals and depth of two walls that meet in a crease."""
    normal = np.zeros((*SIZE, 3), np.float32)
    normal[:, :EDGE, 2], normal[:, EDGE:, 0] = 1.0, 1.0
    return normal, np.full(SIZE, 2.0, np.float32)


def pattern(period: int) -> F32:
    """Light that varies across the columns."""
    wave = 1 + 0.3 * np.sin(2 * np.pi * np.arange(SIZE[1]) / period)
    return np.broadcast_to(wave[None, :, None], (*SIZE, 3)).astype(np.float32)


def metrics(light: F32, noise: float = 0.0) -> DetailMetrics:
    rng = np.random.default_rng(0)
    halves = [(light + rng.normal(0, noise, light.shape)).astype(np.float32) for _ in range(2)]
    return DetailMetrics(halves[0], halves[1], *corner(), np.ones(SIZE, bool))


def test_edges_are_creases_and_silhouettes_and_not_slanted_planes() -> None:
    normal, depth = corner()
    edges = near_edges(normal, depth)
    assert edges[:, EDGE - EDGE_RADIUS:EDGE + EDGE_RADIUS].all()
    assert not edges[:, :EDGE - EDGE_RADIUS - 2].any() and not edges[:, EDGE + EDGE_RADIUS + 2:].any()
    plane = (1 / np.broadcast_to(np.linspace(1.0, 0.5, SIZE[1]), SIZE)).astype(np.float32)
    flat = np.broadcast_to(np.float32([0, 0, 1]), (*SIZE, 3))
    assert not near_edges(flat, plane).any()
    before = plane.copy()
    before[20:30, 50:60] = 0.5
    assert near_edges(flat, before)[20:30, 50].all()


def test_the_reference_itself_has_no_error_and_light_without_detail_has_all() -> None:
    light = pattern(8)
    judge = metrics(light)
    assert judge.edge_gradient(light) == judge.texel_variation(light) == 0
    for constant in (1.0, 7.0):
        assert judge.edge_gradient(np.full_like(light, constant)) == pytest.approx(1)
        assert judge.texel_variation(np.full_like(light, constant)) == pytest.approx(1)


def test_light_that_varies_between_texels_only_misses_what_varies_within_them() -> None:
    fine, coarse = pattern(8), pattern(64)
    means = coarse.reshape(SIZE[0], SIZE[1] // TEXEL, TEXEL, 3).mean(axis=2).repeat(TEXEL, axis=1)
    assert metrics(fine).texel_variation(means) == pytest.approx(1)
    assert metrics(coarse).texel_variation(coarse * np.float32(0.9)) == pytest.approx(0.1)


def test_noise_of_the_reference_drops_out() -> None:
    light = pattern(8)
    noisy = metrics(light, noise=0.1)
    assert noisy.texel_variation(light) < 0.1
    assert noisy.texel_variation(np.ones_like(light)) == pytest.approx(1, abs=0.1)
