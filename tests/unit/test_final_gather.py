"""Rays that gather light from surfels: what they find, and how they are spread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.arrays import F32
from app.gl.frame_state import MotionKind
from app.math3d import View
from app.passes.gather_turns import RAYS as BUDGET
from app.passes.gather_turns import is_turn
from app.raycast.caster import Caster
from app.scene import Camera, Material, Scene
from app.surfels.final_gather import (
    SPREAD_BITS,
    GatheredRays,
    LightAt,
    gather,
    rotation_gradient,
    sequence,
    spread_evenly,
)
from app.surfels.lookup import SurfelLookup
from app.surfels.world import WorldSurfels
from tests.gl.scenes import GREY, Part, Point, box, floor, make_scene, quad

INSIDE = (2.0, 1.5, 3.5)
ROOM = box((0, 0, 0), (4, 3, 4))
UP = (0.0, 1.0, 0.0)
RAYS = 256
GRID = 48, 32
EVERY = np.arange(GRID[0] * GRID[1])  # texel of the grid


def constant(value: float) -> Callable[[F32, F32], F32]:
    return lambda position, normal: np.full_like(position, value)


HALF_EACH = LightAt(constant(1.0), constant(1.0))


def gather_at(parts: list[Part], point: Point, normal: Point = UP, reach: float = 0.5,
              light_at: LightAt = HALF_EACH, rays: int = RAYS) -> GatheredRays:
    """What rays from one point find."""
    scene: Scene = make_scene(parts)
    caster = Caster(scene)
    facing = np.array([normal], np.float32)
    origin = (np.array([point]) - caster.origin).astype(np.float32) + caster.ray_epsilon * facing
    return gather(caster, light_at, reach, origin, facing, sequence((1, 1), np.zeros(1, np.int64), 0, rays, 0.0))


@pytest.mark.parametrize(("point", "normal"), [((2.0, 0.0, 2.0), UP), ((0.0, 0.01, 0.01), (1.0, 0.0, 0.0))],
                         ids=["floor", "corner"])
def test_in_a_closed_room_every_ray_finds_what_the_walls_reflect(point: Point, normal: Point) -> None:
    found = gather_at([ROOM], point, normal, reach=1e-3)
    np.testing.assert_allclose(found.light, 2 * 0.5, rtol=1e-5)  # GREY reflects half


def test_near_ends_get_their_indirect_light_from_another_ray() -> None:
    """Direct light 1 and indirect light 0.5 in a room that reflects half: every ray finds half of the sum of the
    direct light there and half of the sum at the end of the other ray, also half of 1.5."""
    far = gather_at([ROOM], (2.0, 0.0, 2.0), reach=0.1, light_at=LightAt(constant(1.0), constant(0.5)))
    near = gather_at([ROOM], (2.0, 0.0, 2.0), reach=100.0, light_at=LightAt(constant(1.0), constant(0.5)))
    np.testing.assert_allclose(far.light, 0.5 * (1 + 0.5), rtol=1e-5)
    np.testing.assert_allclose(near.light, 0.5 * (1 + 0.5 * (1 + 0.5)), rtol=1e-5)


def test_rays_that_end_nowhere_find_nothing() -> None:
    """A wall that fills half of the hemisphere's cosine-weighted directions, and the sky."""
    found = gather_at([floor(2.0), quad((-50, 0, -0.001), (100, 0, 0), (0, 1000, 0))], (0.0, 0.0, 0.0), reach=1e-3)
    np.testing.assert_allclose(found.light.mean(axis=1), 0.5, atol=0.02)


def test_light_from_one_side_counts_more_on_what_tilts_to_it() -> None:
    """A wall fills the half of the hemisphere in which z < 0, and shines: its irradiance on a normal n is that on
    (0, 1, -1) / 2 · n."""
    shining = Material(albedo=(0.0,) * 3, emission=(1.0,) * 3)
    wall = replace(quad((-50, 0, -0.001), (100, 0, 0), (0, 1000, 0)), material=shining)
    rays = gather_at([floor(2.0), wall], (0.0, 0.0, 0.0), reach=1e-3, rays=4096)
    np.testing.assert_allclose(rotation_gradient(rays, np.array([UP], np.float32)), [(0.0, 0.0, -0.5, 0.5)], atol=0.04)


def test_light_of_emissive_surfaces_counts_unless_they_are_analytic_lights() -> None:
    shining = Material(albedo=(0.0,) * 3, emission=(3.0, 2.0, 1.0))
    walls = replace(ROOM, material=shining)
    proxies = replace(ROOM, material=replace(shining, is_light_proxy=True))
    np.testing.assert_allclose(gather_at([walls], (2, 0, 2)).light.mean(axis=1), [(3, 2, 1)], rtol=1e-5)
    np.testing.assert_array_equal(gather_at([proxies], (2, 0, 2)).light, 0)


def test_distances_are_short_beside_a_wall_and_never_beyond_the_reach() -> None:
    near, far = (gather_at([ROOM], (x, 0.0, 2.0)).distance.mean() for x in (0.01, 2.0))
    assert near < 0.75
    assert far == 1


@pytest.mark.parametrize(("texels", "turns", "count"), [(1000, 1, 4), (10_000, 1, 1), (20_000, 2, 1), (49_152, 4, 1),
                                                        (10**6, 4, 1)])
def test_texels_take_turns_where_rays_are_few_and_no_ray_is_traced_twice(texels: int, turns: int, count: int) -> None:
    numbers: set[int] = set()
    for index in range(8):
        frame = SimpleNamespace(history_valid=True, motion=MotionKind.CAMERA, index=index, size=(64, 48),
                                output_size=(64, 48))
        found, chosen = BUDGET.turns(frame, texels, has_history=True, most=4)
        assert (found, len(chosen)) == (turns, count)
        if index % turns == 0:
            assert not numbers & set(chosen)
            numbers |= set(chosen)
        assert chosen.start >= min(16, max(1, 2**17 // texels))


def test_sequences_go_on_in_the_next_frame_and_differ_among_phases() -> None:
    numbers = sequence(GRID, EVERY, 0, 1, 0.0)
    assert ((numbers >= 0) & (numbers < 1)).all()
    later = sequence(GRID, EVERY, 3, 2, 0.0)
    np.testing.assert_array_equal(later, sequence(GRID, EVERY, 0, 5, 0.0)[:, 3:])
    np.testing.assert_array_equal(sequence(GRID, EVERY[5:9], 3, 2, 0.0), later[5:9])
    assert (sequence(GRID, EVERY, 0, 1, 0.5) != numbers).all()


def test_rays_that_go_on_from_near_ends_differ_among_texels() -> None:
    """Their directions are the digits that no block of texels shares."""
    digits = sequence(GRID, EVERY, 0, 1, 0.3)[:, 0] * 2**SPREAD_BITS % 1
    assert np.abs(digits.mean(axis=0) - 0.5).max() < 0.03
    assert np.abs(digits.std(axis=0) - 12**-0.5).max() < 0.03


@pytest.mark.parametrize("side", [2, 4, 8, 16])
def test_blocks_of_texels_start_at_evenly_spread_points(side: int) -> None:
    """Each cell of the unit square, cut into as many as a block has texels, in any of three ways, has one of them."""
    points = spread_evenly(*GRID).reshape(*GRID[::-1], 2)
    for top in range(0, GRID[1], side):
        for left in range(0, GRID[0], side):
            u, v = points[top:top + side, left:left + side].reshape(-1, 2).T
            for columns in (1, side, side**2):
                cell = np.floor(u * columns) * (side**2 // columns) + np.floor(v * (side**2 // columns))
                assert len(set(cell.tolist())) == side**2


def test_light_that_is_constant_in_cells_stays_near_the_interpolated_light() -> None:
    """Of light that varies as smoothly as that of surfels does."""
    scene = make_scene([ROOM, box((1, 0.01, 0.5), (1, 1, 1), GREY)])
    caster = Caster(scene)
    world = WorldSurfels(scene, caster, [View.of(Camera(INSIDE, (2, 1, 0), fov_y_deg=60), (64, 48), 1e-4)], 512, 16)
    light = np.repeat(1 + 0.2 * world.position[:, :1], 3, axis=1)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(2000, 3)).astype(np.float32)
    hits = caster.cast(np.tile((np.array([INSIDE]) - caster.origin).astype(np.float32), (2000, 1)), directions)
    lookup = SurfelLookup(world)
    exact = lookup.interpolate(light, hits.position, hits.normal)
    approximate = lookup.approximate(light, hits.position, hits.normal)
    assert np.abs(approximate - exact).mean() < 0.02
    assert abs(float((approximate - exact).mean())) < 0.005
    np.testing.assert_allclose(lookup.approximate(np.ones_like(light), hits.position, hits.normal), 1, rtol=1e-5)


@pytest.mark.parametrize("turns", [1, 2, 4])
@pytest.mark.parametrize("grid", [(1, 1), (5, 3), (8, 6)])
def test_each_texel_has_its_turn_once(grid: tuple[int, int], turns: int) -> None:
    parts = [is_turn(grid, turns, turn) for turn in range(turns)]
    np.testing.assert_array_equal(np.sum(parts, axis=0), np.ones(grid[0] * grid[1]))
    with pytest.raises(ValueError, match="read-only"):
        parts[0][:] = False
