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


def test_surfels_behind_a_wall_do_not_count() -> None:
    """A wall in the plane x = 0, which is dark on one side; points that see no surfel at all are told."""
    world, (position, normal) = make_world(), points(300)
    world.normal[:] = (0.0, 0.0, 1.0)
    light = np.where(world.position[:, :1] < 0, np.float32(5), np.float32([[1, 1, 1]]))

    def is_occluded(origins: np.ndarray, vectors: np.ndarray, proxies_block: bool) -> np.ndarray:
        return np.asarray(origins[:, 0] * (origins + vectors)[:, 0] < 0)

    lookup, caster = SurfelLookup(world), SimpleNamespace(is_occluded=is_occluded, ray_epsilon=np.float32(1e-3))
    dark = position[:, 0] > 0
    assert lookup.interpolate(light, position, normal)[dark].max() > 2
    found, sees_any = lookup.interpolate_seen(light, position, normal, caster)  # type: ignore[arg-type]
    assert sees_any.mean() > 0.9
    np.testing.assert_allclose(found[dark & sees_any], 1, rtol=1e-5)
    np.testing.assert_allclose(found[~dark & sees_any], 5, rtol=1e-5)
    caster.is_occluded = lambda origins, vectors, proxies_block: np.ones(len(origins), np.bool_)
    assert not lookup.interpolate_seen(light, position, normal, caster)[1].any()  # type: ignore[arg-type]
