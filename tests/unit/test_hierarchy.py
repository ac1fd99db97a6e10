"""Bounding volumes: every triangle is in a leaf, and every box holds what is below it."""

from __future__ import annotations

import numpy as np
import pytest

from app.raycast.hierarchy import LEAF, build_hierarchy


@pytest.mark.parametrize("count", [1, 4, 5, 8, 9, 100, 1000])
def test_boxes_hold_their_triangles(count: int) -> None:
    rng = np.random.default_rng(count)
    corners = (rng.random((count, 1, 3)) + 0.1 * rng.random((count, 3, 3))).astype(np.float32)
    hierarchy = build_hierarchy(corners)
    leaves = hierarchy.leaves
    assert len(hierarchy.order) == leaves * LEAF < 2 * count + 2 * LEAF
    assert set(hierarchy.order) == set(range(count))
    of_leaves = corners[hierarchy.order].reshape(leaves, -1, 3)
    np.testing.assert_array_equal(hierarchy.bounds[leaves:, 0], of_leaves.min(axis=1))
    np.testing.assert_array_equal(hierarchy.bounds[leaves:, 1], of_leaves.max(axis=1))
    for node in range(1, leaves):
        children = hierarchy.bounds[2 * node:2 * node + 2]
        np.testing.assert_array_equal(hierarchy.bounds[node], [children[:, 0].min(axis=0), children[:, 1].max(axis=0)])


def test_neighbours_share_leaves() -> None:
    """Along a row of triangles, each leaf has those beside each other."""
    corners = np.zeros((64, 3, 3), np.float32)
    corners[..., 0] = np.random.default_rng(0).permutation(64)[:, None]
    leaves = corners[build_hierarchy(corners).order, 0, 0].reshape(-1, LEAF)
    assert (np.ptp(leaves, axis=1) == LEAF - 1).all()
