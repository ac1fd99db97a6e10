"""Generated things without flat faces: smooth normals that agree with the faces, and a place on the floor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from app.math3d import row_dots, row_lengths, unit_rows
from export.dataset.scenes import cluttered_room
from export.dataset.scenes.curved import SMALL, STANDING, sheet, tube, turned
from export.dataset.scenes.furniture import table
from export.dataset.scenes.generated_scene import Pieces, Rng


@pytest.mark.parametrize("kind", dict.fromkeys((*STANDING, *SMALL)))
def test_things_stand_on_the_floor_with_finite_smooth_surfaces(kind: Callable[[Rng], Pieces]) -> None:
    for seed in range(8):
        for part, _ in kind(np.random.default_rng(seed)):
            assert all(np.isfinite(values).all() for values in (part.positions, part.normals, part.uvs))
            np.testing.assert_allclose(row_lengths(part.normals), 1.0, atol=1e-6)
            assert part.positions[:, 1].min() > -0.01
            a, b, c = (part.positions[part.triangles[:, corner]] for corner in range(3))
            face = np.cross(b - a, c - a)
            towards = sum(part.normals[part.triangles[:, corner]] for corner in range(3))
            assert np.average(row_dots(unit_rows(face), unit_rows(towards)), weights=row_lengths(face)) > 0.85


def test_what_is_turned_is_a_cylinder_for_a_constant_radius() -> None:
    part = turned(np.full(5, 0.3), np.linspace(0.0, 1.0, 5), at=(1.0, 0.0, 2.0))
    away = (part.positions - (1.0, 0.0, 2.0)) * (1.0, 0.0, 1.0)
    np.testing.assert_allclose(row_lengths(away), 0.3, atol=1e-12)
    np.testing.assert_allclose(part.normals, away / 0.3, atol=1e-6)  # outwards, also where the ends meet
    assert np.ptp(part.uvs[:, 0]) == pytest.approx(2 * np.pi * 0.3, rel=0.06)  # metres around, along chords


@pytest.mark.parametrize("downwards", [False, True])
def test_a_bar_is_as_thick_as_it_should_be(downwards: bool) -> None:
    points = np.stack([np.zeros(9), np.linspace(0, 1, 9), 0.2 * np.linspace(0, 1, 9) ** 2], axis=-1)
    points = points[::-1] if downwards else points
    part = tube(points, 0.05, aside=(1.0, 0.0, 0.0))
    away = part.positions - np.repeat(points, len(part.positions) // 9, axis=0)
    np.testing.assert_allclose(row_lengths(away), 0.05, rtol=1e-6)
    assert row_dots(part.normals, away / 0.05).min() > 0.99


def test_small_things_lie_on_furniture_and_below_the_ceiling(monkeypatch: pytest.MonkeyPatch) -> None:
    tables = 0
    for seed in range(60):
        alone: list[Pieces] = []

        def watched(rng: Rng, kept: list[Pieces] = alone) -> Pieces:
            kept.append(table(rng))
            return list(kept[-1])

        monkeypatch.setattr(cluttered_room, "table", watched)
        pieces = cluttered_room._crowded(np.random.default_rng(seed), height=1.0)
        if alone:
            tables += 1
            low, high = cluttered_room._bounds(alone[0])
            least, most = cluttered_room._bounds(pieces)
            assert (least[[0, 2]] >= low[[0, 2]] - 1e-9).all() and (most[[0, 2]] <= high[[0, 2]] + 1e-9).all()
            assert most[1] < 1.0 or most[1] == high[1]
    assert tables


def test_texture_coordinates_of_a_flat_sheet_are_metres() -> None:
    x, y = np.meshgrid(np.linspace(0, 2, 9), np.linspace(1, 0, 5))
    part = sheet(np.stack([x, y, np.zeros_like(x)], axis=-1))
    np.testing.assert_allclose(np.ptp(part.uvs, axis=0), (2.0, 1.0), rtol=1e-6)
    np.testing.assert_allclose(part.normals, np.broadcast_to((0.0, 0.0, 1.0), part.normals.shape), atol=1e-12)
