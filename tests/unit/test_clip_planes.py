"""Walls beyond which surfels have no weight."""

from __future__ import annotations

import numpy as np
import pytest

from app.math3d import View
from app.raycast.caster import Caster
from app.scene import Camera
from app.surfels import kernel
from app.surfels.neighbours import nearest
from app.surfels.world import WorldSurfels
from tests.gl.scenes import Part, box, make_scene, quad

EYE = (4.8, 1.5, 3.8)
ROOM = box((0, 0, 0), (5, 3, 4))
DOORWAY = 1.0  # metres, as deep as the room: both halves have surfels


def halves(height: float) -> list[Part]:
    """A room, and a wall of ``height`` at x = 2.5 that leaves a doorway at its end."""
    return [ROOM, box((2.45, -0.01, -0.01), (0.1, height, 4 - DOORWAY))]


def made(parts: list[Part]) -> WorldSurfels:
    scene = make_scene(parts)
    view = View.of(Camera(EYE, (1, 1, 1), fov_y_deg=60), (64, 48), 1e-4)
    return WorldSurfels(scene, Caster(scene), [view], 512, 36)


def planes(world: WorldSurfels) -> tuple[np.ndarray, np.ndarray]:
    """Which surfels have a plane, and the planes in world space."""
    plane = world.clip_plane.astype(np.float64).copy()
    plane[:, 3] -= plane[:, :3] @ world.origin
    return np.abs(plane[:, :3]).sum(axis=1) > 0, plane


def test_an_open_room_has_no_clip_planes() -> None:
    assert not planes(made([ROOM]))[0].any()
    assert not planes(made(halves(0.06)))[0].any()  # a step is no wall


def test_surfels_beside_a_wall_end_at_it() -> None:
    world = made(halves(3.1))
    has, plane = planes(world)
    at = world.position + world.origin
    beside = (np.abs(at[:, 0] - 2.5) < 0.3) & (at[:, 2] < 2.5) & (np.abs(world.normal[:, 1]) > 0.9)
    assert beside.sum() > 10 and has[beside].mean() > 0.8
    left = at[beside & has, 0] < 2.5
    np.testing.assert_allclose(plane[beside & has, 0], np.where(left, 1, -1), atol=1e-3)
    offset = -plane[beside & has, 3] * plane[beside & has, 0]
    np.testing.assert_allclose(offset, np.where(left, 2.45, 2.55), atol=1e-3)
    depth = (plane[:, :3] * at).sum(axis=1) + plane[:, 3]
    assert (depth[has] < 0).all()  # no surfel is beyond its own plane


def test_rays_that_end_beside_a_wall_meet_surfels_of_their_own_side() -> None:
    world = made(halves(3.1))
    z = np.linspace(0.2, 2.4, 27)
    points = np.concatenate([np.stack([np.full(27, x), np.zeros(27), z], axis=1) for x in (2.44, 2.56)])
    up = np.tile(np.array([[0, 1, 0]], np.float32), (54, 1))
    position = (points - world.origin).astype(np.float32)
    key = kernel.keys(world.position, world.normal, world.radius)
    clip = kernel.clip_keys(world.clip_plane, world.radius)
    sides = [np.sign(points[:, 0] - 2.5) == np.sign(world.position[surfel, 0] + world.origin[0] - 2.5)
             for surfel in (nearest(key, clip, position, up), nearest(key, 0 * clip, position, up))]
    assert sides[0].all()
    assert not sides[1].all()  # the test would notice missing planes


@pytest.mark.parametrize("count", [1, 2])
def test_few_surfels_need_no_neighbours(count: int) -> None:
    scene = make_scene([quad((0, 0, 0), (1, 0, 0), (0, 0, 1))])
    world = WorldSurfels(scene, Caster(scene), [View.of(Camera((0.5, 1, 0.5), (0.5, 0, 0.4)), (8, 8), 1e-4)], count, 4)
    assert world.clip_plane.shape == (count, 4) and not world.clip_plane.any()
