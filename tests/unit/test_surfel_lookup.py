"""The light of surfels looked up in cells is that of the whole kernel."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.surfels import kernel
from app.surfels.lookup import SurfelLookup

COUNT = 500


def make_world(offset: float = 0.0) -> Any:
    """Surfels on two sides of a thin wall in the plane z = 0."""
    rng = np.random.default_rng(0)
    position = np.concatenate([rng.uniform(-1, 1, (COUNT, 2)), np.zeros((COUNT, 1))], axis=1) + offset
    normal = np.zeros((COUNT, 3))
    normal[:, 2] = np.where(np.arange(COUNT) % 2, 1.0, -1.0)
    return SimpleNamespace(position=position.astype(np.float32), normal=normal.astype(np.float32), used=COUNT - 1,
                           radius=np.full(COUNT, 0.2, np.float32), weight=np.ones(COUNT, np.float32),
                           clip_plane=np.zeros((COUNT, 4), np.float32))


def points(count: int, offset: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    position = np.concatenate([rng.uniform(-0.9, 0.9, (count, 2)), np.zeros((count, 1))], axis=1) + offset
    return position.astype(np.float32), np.broadcast_to(np.float32([0, 0, 1]), (count, 3))


@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_it_is_close_to_the_whole_kernel(offset: float) -> None:
    world, (position, normal) = make_world(offset), points(2000, offset)
    light = np.stack([1 + world.position[:, 0] - offset, 1 + world.normal[:, 2], np.ones(COUNT)], axis=1)
    found = SurfelLookup(world).interpolate(light.astype(np.float32), position, normal)
    rows = slice(0, world.used)
    exponent = (kernel.queries(position - np.float32(offset), normal)
                @ kernel.keys(world.position[rows] - np.float32(offset), world.normal[rows], world.radius[rows]).T)
    weight = np.exp(exponent - exponent.max(axis=1, keepdims=True))
    expected = (weight @ light[rows]) / weight.sum(axis=1, keepdims=True)
    assert np.abs(found - expected).mean() < 0.03
    np.testing.assert_allclose(found[:, 2], 1, rtol=1e-5)
    np.testing.assert_allclose(found[:, 1], 2, atol=1e-3)  # nothing from the other side


def test_known_cells_give_the_same_light_again() -> None:
    world, (position, normal) = make_world(), points(300)
    light = np.random.default_rng(2).random((COUNT, 3)).astype(np.float32)
    lookup = SurfelLookup(world)
    first = lookup.interpolate(light, position, normal)
    lookup.interpolate(light, position + np.float32(0.5), -normal)
    np.testing.assert_array_equal(lookup.interpolate(light, position, normal), first)
