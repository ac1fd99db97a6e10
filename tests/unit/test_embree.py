"""Triangles that rays meet: among parts of all, and the same by several threads as by one."""

import numpy as np
import pytest

from app import embree
from app.embree import Triangles

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


@pytest.fixture
def stack() -> tuple[np.ndarray, np.ndarray]:
    """Positions and corners of five triangles at heights 0 to 4."""
    positions = np.concatenate([CORNERS + np.float32([0, 0, height]) for height in range(5)])
    return positions, np.arange(15).reshape(5, 3)


def down(count: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.random.default_rng(1).random((2, count, 1)) * 0.45 + 0.01
    origins = np.concatenate([x, y, np.full_like(x, 9)], axis=1).astype(np.float32)
    return origins, np.tile(np.float32([0, 0, -1]), (count, 1))


def test_triangles_keep_their_numbers_among_all(stack) -> None:
    triangles = Triangles(*stack, np.array([1, 3]))
    hits = triangles.intersect(*down(1), np.full(1, np.inf, np.float32))
    assert hits.triangle.tolist() == [3]
    assert hits.distance[0] == pytest.approx(6.0)
    assert len(triangles) == 2


def test_a_ray_ends_at_its_end(stack) -> None:
    hits = Triangles(*stack, np.arange(5)).intersect(*down(1), np.full(1, 4.5, np.float32))
    assert (hits.triangle.tolist(), hits.distance.tolist()) == ([-1], [4.5])


def test_threads_find_what_one_finds(stack, monkeypatch: pytest.MonkeyPatch) -> None:
    triangles, (origins, directions) = Triangles(*stack, np.arange(5)), down(9001)
    ends = np.random.default_rng(2).random(9001).astype(np.float32) * 10
    found, met = [], []
    for cores in (1, 4):
        monkeypatch.setattr(embree, "_cores", lambda cores=cores: cores)
        found.append(triangles.intersect(origins, directions, ends))
        met.append(triangles.meet(origins, directions * ends[:, None]))
    for name, values in vars(found[0]).items():
        assert np.array_equal(values, getattr(found[1], name)), name
    assert np.array_equal(*met)
    assert 0 < met[0].sum() < 9001
