"""Where surfels lie, what their rays meet, and when they are placed again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from app.environment import SKY_DISTANCE
from app.math3d import GOLDEN_RATIO, View, unit_rows
from app.raycast.caster import STATIC, Anchors, AttachedPoints, Caster
from app.scene import Camera, Environment, Material, Motion, Scene
from app.surfels import kernel
from app.surfels.farthest_points import neighbour_distance, sample_farthest
from app.surfels.neighbours import nearest
from app.surfels.random_walks import sample_cosine_hemisphere, trace_walks
from app.surfels.ray_bundle import trace_cosine_rays
from app.surfels.sky_rays import SkyRays
from app.surfels.tracked import TrackedSurfels
from app.surfels.world import MAX_END_SAMPLES, MAX_LIGHT_SAMPLES, MIN_SAMPLE_COSINE, MIN_SAMPLED_RADII, WorldSurfels
from tests.deforming import bent, deforming_scene, material_points
from tests.gl.closed_forms import polygon_irradiance
from tests.gl.scenes import GREY, Part, Point, box, cellar, floor, make_scene, moved, quad, slide, window_irradiance

ROOM = box((0, 0, 0), (4, 3, 4))
CUPBOARD = box((1, 0.01, 0.5), (1, 1, 1), replace(GREY, albedo=(0.2,) * 3))
INSIDE = (2.0, 1.5, 3.5)


def view(eye: Point = INSIDE, target: Point = (2, 1, 0)) -> View:
    return View.of(Camera(eye, target, fov_y_deg=60), (64, 48), 1e-4)


def made(scene: Scene, count: int = 128, rays: int = 16, time: float = 0.0, eye: Point = INSIDE) -> WorldSurfels:
    return WorldSurfels(scene, Caster(scene), [view(eye)], count, rays, time)


def track(scene: Scene, count: int) -> TrackedSurfels:
    caster = Caster(scene)
    return TrackedSurfels(scene, lambda: caster, count, 16)


def furnished(motion: Motion | None = None) -> Scene:
    ball = box((-0.3, -0.3, -0.3), (0.6, 0.6, 0.6), Material(albedo=(0.9, 0.1, 0.1)), motion)
    return make_scene([ROOM, CUPBOARD] + ([ball] if motion else []))


def crossing() -> Scene:
    return furnished(slide((0.0, 1.0), [(3, 0.5, 1), (3, 2, 2)]))


def arrays(world: WorldSurfels) -> dict[str, np.ndarray]:
    return {n: v for n, v in vars(world).items() if isinstance(v, np.ndarray)}


def test_light_proxies_have_surfels_of_their_own_and_no_light_samples() -> None:
    lamp = Material(albedo=(0.7,) * 3, emission=(1.0,) * 3, is_light_proxy=True)
    low = 2.999  # closer to the ceiling than surfels are to each other
    world = made(make_scene([ROOM, quad((1, low, 1), (2, 0, 0), (0, 0, 2), lamp)]))
    on_lamp = np.isclose(world.position[:, 1] + world.origin[1], low, atol=2e-4)
    assert on_lamp.sum() >= 2 and not on_lamp[world.light_sample_surfel].any()
    met = np.isclose(world.albedo[..., 0], 0.7)  # everything else has albedo 0.5
    assert met.any()
    np.testing.assert_array_equal(on_lamp[world.index[met].astype(int)], True)
    np.testing.assert_array_equal(on_lamp[world.index[~met & (world.index >= 0)].astype(int)], False)


def test_light_proxies_light_each_other_alone() -> None:
    """A pane of radiance 1 below a larger one: the form factor of what it sees, by 144 rays; nothing on walls."""
    lamp = Material(albedo=(0.7,) * 3, emission=(1.0,) * 3, is_light_proxy=True)
    above = np.array([(0.5, 2, 0.5), (0.5, 2, 3.5), (3.5, 2, 3.5), (3.5, 2, 0.5)])
    world = made(make_scene([ROOM, quad((0.5, 2, 0.5), (3, 0, 0), (0, 0, 3), lamp),
                             quad((1, 0.1, 3), (2, 0, 0), (0, 0, -2), lamp)]))
    at = world.position[:world.used] + world.origin
    low = np.flatnonzero(np.isclose(at[:, 1], 0.1, atol=2e-3) & (world.normal[:world.used, 1] > 0.9))
    assert len(low) >= 4
    expected = [abs(polygon_irradiance(at[i], np.array([0.0, 1, 0]), above)) / np.pi for i in low]
    np.testing.assert_allclose(world.proxy_irradiance[low, 0], expected, atol=0.03)
    assert world.proxy_irradiance[low, 0].mean() == pytest.approx(np.mean(expected), rel=0.02)
    proxies = np.isclose(at[:, 1], 0.1, atol=2e-3) | np.isclose(at[:, 1], 2, atol=2e-3)
    assert not world.proxy_irradiance[:world.used][~proxies].any() and not world.emissive_irradiance.any()


def test_walks_stay_on_surfaces_that_light_can_reach() -> None:
    scene = furnished()
    caster = Caster(scene)
    hits = trace_walks(caster, [view()], 4000, np.random.default_rng(0))
    assert 2000 < len(hits.body) <= 4000
    at = hits.position.astype(np.float64) + caster.origin
    on_wall = np.isclose(at, (0, 0, 0), atol=1e-4) | np.isclose(at, (4, 3, 4), atol=1e-4)
    on_cupboard = np.isclose(at, (1, 0.01, 0.5), atol=1e-4) | np.isclose(at, (2, 1.01, 1.5), atol=1e-4)
    assert (on_wall | on_cupboard).any(axis=1).all()
    outwards = ((at - (1.5, 0.51, 1.0)) * hits.normal).sum(axis=1) > 0
    cupboard = np.isclose(hits.albedo[:, 0], 0.2)
    assert cupboard.sum() > 100
    assert outwards[cupboard].all()


def test_walks_spread_evenly_over_a_closed_room() -> None:
    """Diffuse walks visit each wall in proportion to its area, except for the half that starts through the picture."""
    scene = make_scene([ROOM])
    caster = Caster(scene)
    hits = trace_walks(caster, [view((2, 1.5, 2), (2, 1.5, 0))], 40000, np.random.default_rng(0))
    share = [np.abs(hits.normal[:, axis]).mean() for axis in range(3)]
    np.testing.assert_allclose(share, np.array([12, 16, 12]) / 40, atol=0.05)


def test_walks_of_several_views_begin_at_each() -> None:
    far = 10.0
    scene = make_scene([ROOM, box((far, 0, 0), (4, 3, 4))])
    views = [view(), view((INSIDE[0] + far, *INSIDE[1:]), (2 + far, 1, 0))]
    caster = Caster(scene)
    hits = trace_walks(caster, views, 4000, np.random.default_rng(0))
    in_far_room = hits.position[:, 0] + caster.origin[0] > far - 1
    assert len(hits.body) == 4000 and in_far_room.sum() == 2000


def test_every_moving_body_gets_hits_of_its_own() -> None:
    scene = make_scene([floor(3.0), box((50, 50, 50), (0.1, 0.1, 0.1), motion=slide((0.0, 1.0), [(0, 0, 0)] * 2))])
    hits = trace_walks(Caster(scene), [view((0, 2, 2), (0, 0, 0))], 1600, np.random.default_rng(0))
    assert (hits.body == 1).sum() > 50


def test_farthest_points_are_far_apart() -> None:
    line = np.stack([np.arange(101), np.zeros(101), np.zeros(101)], 1).astype(np.float32)
    assert sample_farthest(line, 4).tolist() in ([0, 100, 50, 25], [0, 100, 50, 75])
    points = np.random.default_rng(0).random((2000, 3)).astype(np.float32)
    chosen = sample_farthest(points, 100)
    assert len(set(chosen)) == 100
    nearest = neighbour_distance(points[chosen], 1)
    to_chosen = np.linalg.norm(points[:, None] - points[chosen], axis=-1).min(axis=1)
    # Gonzalez: nothing is farther from the chosen than those are from each other.
    assert to_chosen.max() <= nearest.min() * 1.001


@pytest.mark.parametrize("size", [1.0, 1e6])
def test_points_that_nearly_coincide_are_chosen_once_each(size: float) -> None:
    rng = np.random.default_rng(0)
    points = np.repeat(size * rng.random((5, 3)), 20, axis=0) + 1e-7 * size * rng.random((100, 3))
    points = points.astype(np.float32)
    assert sorted(sample_farthest(points, 100)) == list(range(100))
    assert len(sample_farthest(points, 200)) == 100
    assert len(sample_farthest(points[:0], 4)) == 0


def test_the_nearest_surfel_is_that_of_the_whole_product() -> None:
    """Also for points far from all surfels, where none faces them, and beyond the nearest one's clip plane."""
    world, rng = made(furnished(), 256), np.random.default_rng(2)
    rows = slice(0, world.used)
    key = kernel.keys(world.position[rows], world.normal[rows], world.radius[rows])
    plane = np.concatenate([unit_rows(rng.normal(size=(world.used, 3))), rng.uniform(-1, 1, (world.used, 1))], axis=1)
    clip = kernel.clip_keys(plane.astype(np.float32), world.radius[rows])
    position = np.concatenate([rng.uniform(-2, 2, (3000, 3)), rng.uniform(-50, 50, (50, 3))]).astype(np.float32)
    normal = unit_rows(rng.normal(size=position.shape)).astype(np.float32)
    at = np.concatenate([position, np.ones_like(position[:, :1])], axis=1)
    exponent = kernel.queries(position, normal) @ key.T + np.minimum(at @ clip.T, 0)
    surfel = nearest(key, clip, position, normal)
    lost = exponent.max(axis=1) - np.take_along_axis(exponent, surfel[:, None], 1)[:, 0]
    assert (lost <= 1e-5 * np.abs(exponent.max(axis=1))).all()
    assert (surfel == exponent.argmax(axis=1)).mean() > 0.99


def test_neighbour_distance_agrees_with_sorted_distances() -> None:
    points = np.random.default_rng(0).random((1500, 3)).astype(np.float32)
    distance = np.sort(np.linalg.norm(points[:, None] - points, axis=-1), axis=1)
    np.testing.assert_allclose(neighbour_distance(points, 8), distance[:, 8], rtol=1e-3)
    assert np.isinf(neighbour_distance(points[:8], 8)).all()


def test_cosine_directions_meet_a_disc_in_proportion_to_its_form_factor() -> None:
    """The form factor to a disc of radius r at height h is r² / (r² + h²) (Howell's catalogue)."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(50, 3))
    normals = np.concatenate([normals / np.linalg.norm(normals, axis=1, keepdims=True), np.eye(3), -np.eye(3)])
    directions = sample_cosine_hemisphere(normals.astype(np.float32), rng.random((len(normals), 20000, 2)))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-5)
    cosine = np.einsum("nkc,nc->nk", directions, normals)
    assert cosine.min() > -1e-5
    for r, h in ((0.3, 1.0), (1.0, 1.0), (3.0, 1.0)):
        inside = cosine > h / np.hypot(r, h)
        np.testing.assert_allclose(inside.mean(axis=1), r * r / (r * r + h * h), atol=0.02)
    sideways = directions - cosine[..., None] * normals[:, None]
    assert np.abs(sideways.mean(axis=1)).max() < 0.02


@pytest.mark.parametrize("rays", [16, 64, 144])
def test_every_quarter_of_the_rays_is_cosine_distributed(rays: int) -> None:
    """Networks trace bounces along the first quarter only, so its mean squared cosine, 1/2, must be unbiased."""
    scene = make_scene([floor(1.0)])
    caster = Caster(scene)
    count = 400
    normal = np.tile(np.array([0, 1, 0], np.float32), (count, 1))
    anchors = Anchors(np.full(count, STATIC), np.full(count, -1), np.zeros((count, 2), np.float32))
    surfels = AttachedPoints(caster, np.zeros((count, 3), np.float32), normal, anchors)
    bundle = trace_cosine_rays(caster, surfels, rays, np.random.default_rng(0))
    for quarter in np.split(bundle._directions, 4, axis=1):
        squared = quarter[..., 1] ** 2
        assert squared.mean() == pytest.approx(0.5, abs=0.012)
        # One in each cell of a coarser grid: a much smaller variance than that of independent samples.
        assert squared.mean(axis=1).std() < 0.7 * np.sqrt(1 / 12 / (rays // 4))


LID = np.array([(-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)], float)


def lid(material: Material) -> Part:
    """A square two units wide, one above the floor."""
    return quad(LID[0], LID[1] - LID[0], LID[3] - LID[0], material)


def seen_of_lid(world: WorldSurfels) -> tuple[np.ndarray, np.ndarray]:
    """Which surfels lie on the floor, and their form factors to the lid."""
    on_floor = world.normal[:, 1] > 0.5
    return on_floor, polygon_irradiance(world.position[on_floor] + world.origin, (0, 1, 0), LID) / np.pi


def test_the_mean_over_rays_is_a_form_factor() -> None:
    """The share of rays that meet a square above the floor agrees with Lambert's formula for polygons."""
    world = made(make_scene([floor(1.0), lid(Material(albedo=(1.0,) * 3))]), 64, 144, eye=(0, 0.5, 0.9))
    on_floor, reference = seen_of_lid(world)
    measured = (world.albedo[on_floor, :, 0] > 0.9).mean(axis=1)
    assert on_floor.sum() > 20
    assert measured.mean() == pytest.approx(reference.mean(), rel=0.01)
    assert np.sqrt(((measured - reference) ** 2).mean()) < 0.02  # 0.04 without strata


def test_rays_name_a_surfel_of_the_body_that_they_meet() -> None:
    world = made(crossing())
    number = world.index.astype(int)
    body = world._surfels.anchors.body
    on_ball = np.isclose(world.albedo[..., 0], 0.9)
    met = world.albedo[..., 0] > 0
    assert on_ball.sum() > 20
    assert (number[met] >= 0).all() and (number < world.used).all()
    assert (body[number[on_ball]] == 1).all()
    assert (body[number[met & ~on_ball]] == STATIC).all()


def test_light_samples_are_ends_of_long_rays_and_candidates() -> None:
    world = made(crossing(), 200)
    ends = world._rays.static
    start = np.repeat(np.arange(world.used), world.rays)
    number = np.zeros((2, world.count), int)
    for surfel, at in zip(world.light_sample_surfel, world.light_sample_position, strict=True):
        ray = np.flatnonzero((ends.position == at).all(axis=1))
        number[int(len(ray) > 0), surfel] += 1
        assert (ends.distance[ray] > MIN_SAMPLED_RADII * world.radius[start[ray]]).all()
        assert (world._static_index[ray] == surfel).all()
    assert number[1].max() == MAX_END_SAMPLES and number[1].mean() > 3
    assert (number[0] > 0).mean() > 0.9


def test_every_surfel_has_light_samples_nearby_on_its_body() -> None:
    world = made(crossing(), 200)
    number = np.bincount(world.light_sample_surfel, minlength=world.count)
    assert world.used == 200
    assert number.min() >= 1 and number.max() <= MAX_LIGHT_SAMPLES
    assert number.mean() > 3
    assert (np.diff(world.light_sample_surfel) >= 0).all()
    assert (world._light_samples.anchors.body == world._surfels.anchors.body[world.light_sample_surfel]).all()
    away = np.linalg.norm(world.light_sample_position - world.position[world.light_sample_surfel], axis=1)
    assert (away < 2 * world.radius[world.light_sample_surfel]).mean() > 0.99
    facing = (world.light_sample_normal * world.normal[world.light_sample_surfel]).sum(axis=1)
    assert (facing > MIN_SAMPLE_COSINE).all() and (facing > 0.5).mean() > 0.99


def test_a_scene_with_little_in_it_leaves_rows_unused() -> None:
    world = made(make_scene([Part(np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], float))]), 4096, 4, eye=(0.2, 0.2, 2))
    assert 0 < world.used < 4096
    rows = slice(world.used, None)
    assert (world.weight[:world.used] > 0).all() and not world.weight[rows].any()
    assert (world.index[rows] == -1).all() and not world.albedo.any()
    assert not world.position[rows].any() and not world.normal[rows].any()
    assert (world.index == -1).all()


def test_an_empty_scene_has_no_surfels() -> None:
    scene = replace(make_scene([ROOM]), meshes=(), instances=(), materials=(), bounds=np.zeros((2, 3)))
    world = made(scene, 16, 4)
    assert world.used == 0 and len(world.light_sample_surfel) == 0
    assert not world.weight.any() and (world.index == -1).all()
    assert all(np.isfinite(a).all() for a in arrays(world).values())
    assert world.covers(np.zeros(3))


def test_emissive_irradiance_is_the_form_factor_times_radiance() -> None:
    glowing = lid(Material(albedo=(0.0,) * 3, emission=(3.0, 2.0, 1.0)))
    world = made(make_scene([floor(1.0), glowing]), 64, 4, eye=(0, 0.5, 0.9))
    on_floor, reference = seen_of_lid(world)
    np.testing.assert_allclose(world.emissive_irradiance[on_floor], reference[:, None] * (3, 2, 1), atol=0.12)
    mean = world.emissive_irradiance[on_floor].mean(axis=0)
    assert mean == pytest.approx(reference.mean() * np.array([3, 2, 1]), rel=0.01)
    assert not world.emissive_irradiance[~on_floor].any()


def current_directions(world: WorldSurfels) -> np.ndarray:
    """Directions of all rays, [S · K, 3]; surfels on moving bodies repeat a quarter of theirs four times."""
    bundle, dynamic = world._rays, world._surfels.anchors.body != STATIC
    directions = np.empty((world.used, world.rays, 3), np.float32)
    directions[~dynamic] = bundle._directions
    directions[dynamic] = np.tile(bundle._dynamic_rays.current()[1].reshape(dynamic.sum(), -1, 3), (1, 4, 1))
    return directions.reshape(-1, 3)


def test_move_to_gives_the_same_tables_as_new_rays() -> None:
    scene = crossing()
    world = made(scene)
    before = arrays(world)
    assert world.move_to(0.7)
    caster = Caster(scene)
    caster.move_to(0.7)
    origins = np.repeat(world.position + world.normal * caster.ray_epsilon, world.rays, axis=0)
    hits = caster.cast(origins, current_directions(world))
    albedo = hits.albedo.reshape(world.albedo.shape)
    np.testing.assert_allclose(world.albedo, albedo, atol=1e-6)
    assert (world.index.ravel().astype(int) == world._nearest(hits)).mean() > 0.999
    assert (np.isclose(albedo[..., 0], 0.9) != np.isclose(before["albedo"][..., 0], 0.9)).sum() > 20
    dynamic = world._surfels.anchors.body == 1
    np.testing.assert_allclose(world.position[dynamic] - before["position"][dynamic],
                               [(0, 0.7 * 1.5, 0.7)] * dynamic.sum(), atol=1e-5)
    assert (world.position[~dynamic] == before["position"][~dynamic]).all()
    dynamic = world._light_samples.anchors.body == 1
    np.testing.assert_allclose(world.light_sample_position[dynamic] - before["light_sample_position"][dynamic],
                               [(0, 0.7 * 1.5, 0.7)] * dynamic.sum(), atol=1e-5)


def courtyard() -> Scene:
    """Open above, with a block that moves from a corner into the middle."""
    walls = [quad((0, 0, 0), (4, 0, 0), (0, 2, 0)), quad((0, 0, 0), (0, 2, 0), (0, 0, 4)), floor(8.0)]
    block = box((0, 0, 0), (1, 1, 1), GREY, slide((0.0, 1.0), [(0.2, 0.1, 0.2), (2, 0.1, 2)]))
    return replace(make_scene([*walls, block]), environment=Environment(np.ones((8, 16, 3), np.float32)))


def shaded() -> Scene:
    """A floor below a culled back, a see-through pane and a light proxy, with a block that flies up far and one that is
    small for the scene.
    """
    def roof(x: float, material: Material) -> Part:
        return quad((x, 2, 0), (1, 0, 0), (0, 0, 4), material)

    pane = Material(alpha=0.5, is_blended=True)
    roofs = [roof(0, Material(double_sided=False)), roof(1.2, pane), roof(2.4, Material(is_light_proxy=True))]
    cover = box((0, 1, 0), (40, 1, 40), GREY, slide((0.0, 1.0), [(-18, 0, -18), (-18, 90, -18)]))
    pebble = box((0, 0, 0), (0.02, 0.02, 0.02), GREY, slide((0.0, 1.0), [(3.7, 0.02, 0.5), (3.7, 0.001, 0.5)]))
    return replace(make_scene([floor(8.0), *roofs, cover, pebble]),
                   environment=Environment(np.ones((8, 16, 3), np.float32)))


@pytest.mark.parametrize("make", [courtyard, shaded])
@pytest.mark.parametrize("time", [0.0, 0.7, 1.0])
def test_surfels_see_the_sky_where_shadow_rays_end_nowhere(make: Callable[[], Scene], time: float) -> None:
    scene = make()
    assert scene.environment is not None
    caster = Caster(scene)
    caster.move_to(1.0)
    rng = np.random.default_rng(0)
    above = np.concatenate([rng.uniform((0, 1.9, 0), (4, 1.9, 4), (300, 3)),
                            rng.uniform((3.66, 1.9, 0.46), (3.76, 1.9, 0.56), (900, 3))]) - caster.origin
    hits = caster.cast(above.astype(np.float32), np.tile(np.array([0, -1, 0], np.float32), (1200, 1)))
    hits = hits.select(np.flatnonzero(hits.body >= 0))
    surfels = AttachedPoints(caster, hits.position, hits.normal, hits.anchors)
    caster.move_to(0.0)
    rays = SkyRays(caster, surfels, scene.environment)
    caster.move_to(time)
    position, normal = surfels.current()
    is_moving = hits.body != STATIC
    assert is_moving.sum() > 5 and (~is_moving).sum() > 50
    found = rays.irradiance()
    own = rays._static
    is_open = ~caster.is_occluded((position + caster.ray_epsilon * normal)[own.surfel],
                                  SKY_DISTANCE * caster.extent * own.direction, proxies_block=True)
    share = np.repeat(np.float32(is_open)[:, None], 3, axis=1)
    np.testing.assert_allclose(found[~is_moving], own.sum(len(position), share)[~is_moving], rtol=1e-6)
    count = 4000
    height = 1 - (2 * np.arange(count) + 1) / count
    azimuth = 2 * np.pi * GOLDEN_RATIO * np.arange(count)
    flat = np.sqrt(1 - height**2)
    directions = np.stack([flat * np.cos(azimuth), height, flat * np.sin(azimuth)], axis=1)
    for rows in (~is_moving, is_moving):
        origins = np.repeat(position[rows] + caster.ray_epsilon * normal[rows], count, axis=0)
        ends = np.tile(SKY_DISTANCE * caster.extent * directions, (rows.sum(), 1)).astype(np.float32)
        is_open = ~caster.is_occluded(origins, ends, proxies_block=True).reshape(-1, count)
        exact = (np.maximum(normal[rows] @ directions.T, 0) * is_open).mean(axis=1) * 4
        assert exact.mean() < 0.98 and (exact.mean() > 0.02 or time == 0)
        assert abs(found[rows].mean() - exact.mean()) < 0.02
        assert np.abs(found[rows] - exact[:, None]).mean() < 0.1


@pytest.mark.parametrize("window", [0.6, 1.0])
def test_surfels_in_a_room_have_the_light_of_its_window(window: float) -> None:
    """Against the form factor of the hole, for the floor that sees only dim sky."""
    scene = cellar(window)
    caster = Caster(scene)
    x, z = np.meshgrid(np.linspace(0.3, 3.7, 24), np.linspace(1.6, 3.7, 24))
    down = np.stack([x.ravel(), np.full(x.size, 2.0), z.ravel()], axis=1) - caster.origin
    hits = caster.cast(down.astype(np.float32), np.tile(np.array([0, -1, 0], np.float32), (x.size, 1)))
    surfels = AttachedPoints(caster, hits.position, hits.normal, hits.anchors)
    found = SkyRays(caster, surfels, scene.environment).irradiance()
    exact = window_irradiance(hits.position + caster.origin, window) / np.pi
    print(f"CELLAR {window}: mean {found.mean() / exact.mean():.3f} of the form factor's light, "
          f"mean error {np.abs(found - exact[:, None]).mean() / exact.mean():.3f}")
    assert found.mean() == pytest.approx(exact.mean(), rel=0.15)
    assert np.abs(found - exact[:, None]).mean() < {0.6: 0.6, 1.0: 0.25}[window] * exact.mean()


def test_a_body_that_returns_restores_the_tables() -> None:
    world = made(crossing())
    before = {n: a.copy() for n, a in arrays(world).items()}
    assert world.move_to(0.7) and world.move_to(0.0)
    assert (world.index == before["index"]).mean() > 0.999
    np.testing.assert_allclose(world.albedo, before["albedo"], atol=1e-6)
    np.testing.assert_allclose(world.weight, before["weight"], rtol=1e-3)


def test_nothing_is_traced_while_nothing_moves() -> None:
    assert not made(furnished()).move_to(5.0)
    world = made(crossing())
    assert not world.move_to(0.0)
    assert world.move_to(1.5) and not world.move_to(2.0)  # held after the last key


def test_a_body_scaled_to_nothing_comes_back() -> None:
    grow = Motion(np.array([0.0, 1.0]), np.stack([np.diag([0.0, 0, 0, 1]), np.eye(4)]))
    block = box((2, 1, 1), (0.6, 0.6, 0.6), Material(albedo=(0.9, 0.1, 0.1)), grow)
    world = made(make_scene([ROOM, block]))
    assert not np.isclose(world.albedo[..., 0], 0.9).any()
    assert world.move_to(1.0)
    assert np.isclose(world.albedo[..., 0], 0.9).any()
    assert ((world.index >= 0) | (world.albedo.max(axis=-1) == 0)).all()  # otherwise it would receive surfel 0's light
    assert all(np.isfinite(a).all() for a in arrays(world).values())
    assert world.move_to(0.0)
    assert not np.isclose(world.albedo[..., 0], 0.9).any()


def test_the_same_scene_and_view_give_the_same_arrays() -> None:
    first, second = (arrays(made(crossing(), time=0.3)) for _ in range(2))
    assert set(first) >= {"position", "normal", "radius", "weight", "index", "albedo", "emissive_irradiance",
                          "light_sample_position"}
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], name)


def test_a_scene_far_away_has_the_same_surfels() -> None:
    near, far = made(furnished()), made(moved(furnished(), (1e6, 0, -1e6)), eye=(1e6 + 2, 1.5, -1e6 + 3.5))
    for surface in (near, far):
        edge = np.abs(np.abs(surface.position) - (2, 1.5, 2)).min(axis=1) < 1e-3
        assert edge.mean() > 0.7  # the others on the cupboard
    seen = [np.isclose(surface.albedo[..., 0], 0.2).mean() for surface in (near, far)]
    assert seen[1] == pytest.approx(seen[0], rel=0.25) and seen[0] > 0.03


def test_a_room_in_a_scene_a_thousand_times_as_large() -> None:
    """Far from the middle of the scene, where single precision holds no squares of small distances."""
    hill = Part(np.array([[(4000, 0, 0), (4000, 1, 0), (4000, 0, 1)]], float))
    world = made(make_scene([ROOM, CUPBOARD, hill]), 256)
    assert world.covers(np.asarray(INSIDE))
    assert np.median(world.radius) == pytest.approx(np.median(made(furnished(), 256).radius), rel=0.1)
    hits = world._rays.static
    to = (hits.position[:, None].astype(np.float64) - world.position) / world.radius[:, None]
    turn = 1 - hits.normal @ world.normal.T
    exponent = 3 * (to**2).sum(-1) + 8 * turn + 24 * (to * hits.normal[:, None]).sum(-1) ** 2
    beyond = hits.position.astype(np.float64) @ world.clip_plane[:, :3].T + world.clip_plane[:, 3]
    exponent += 200 * np.maximum(beyond / world.radius - 0.02, 0)
    met = hits.body >= 0
    lost = np.take_along_axis(exponent, world.index.reshape(-1, 1).astype(int), 1)[:, 0] - exponent.min(axis=1)
    assert lost[met].max() < 0.01


def two_rooms() -> Scene:
    """Two closed rooms, side by side."""
    return make_scene([ROOM, box((4.05, 0, 0), (4, 3, 4))])


def test_another_room_behind_a_wall_is_not_covered() -> None:
    world = made(two_rooms(), 512)
    for eye in (INSIDE, (0.5, 0.5, 0.5), (3.95, 2.5, 0.5)):
        assert world.covers(np.asarray(eye))
    assert (world.position[:world.used] + world.origin)[:, 0].max() < 4.01
    for eye in ((6.05, 1.5, 3.5), (4.3, 1.5, 2), (7.5, 0.5, 1)):
        assert not world.covers(np.asarray(eye))


def test_surfels_are_placed_again_when_the_camera_leaves_them() -> None:
    tracked = track(two_rooms(), 512)
    tracked.update(view(), 0.0)
    first, version = tracked.world, tracked.version
    tracked.update(view(), 0.0)
    tracked.update(view((1, 1, 1), (2, 1, 0)), 0.1)
    assert tracked.world is first and tracked.version == version
    tracked.update(view((6, 1.5, 2), (6, 1, 0)), 0.2)
    assert tracked.world is not first and tracked.version > version
    assert (tracked.world.position + tracked.world.origin)[:, 0].min() > 4


def test_coverage_is_tested_only_after_noticeable_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    tracked = track(two_rooms(), 512)
    tracked.update(view(), 0.0)
    tested: list[float] = []
    monkeypatch.setattr(WorldSurfels, "covers", lambda _, eye: tested.append(eye[0]) is None)
    step = 0.1 * float(tracked.world.median_radius)
    for index in range(1, 10):
        tracked.update(view((INSIDE[0] - index * step, *INSIDE[1:])), 0.0)
    assert tested == pytest.approx([INSIDE[0] - index * step for index in (3, 6, 9)])


def test_tracked_surfels_move_with_bodies() -> None:
    tracked = track(crossing(), 128)
    tracked.update(view(), 0.0)
    world, version = tracked.world, tracked.version
    tracked.update(view(), 0.5)
    assert tracked.world is world and tracked.version == version + 1
    tracked.update(view(), 0.5)
    assert tracked.version == version + 1


def test_surfels_follow_a_body_that_deforms() -> None:
    """They and their light samples lie on the deformed surface, and their rays are those of new ones."""
    moving = deforming_scene("skin", [floor(2.0), quad((-2, 0, -1), (4, 0, 0), (0, 3, 0))])
    scene = moving.scene
    world = made(scene, 256, 16, eye=(0.5, 1.2, 2.5))
    before = world.position.copy()
    assert world.move_to(0.8)
    body = world._surfels.anchors.body == 1
    assert body.sum() > 10 and np.abs(world.position - before)[:world.used][body].max() > 0.3
    triangles = scene.meshes[0].triangles
    shape = bent(moving.positions, 0.8)[triangles]
    for points in (world.position[:world.used][body],
                   world.light_sample_position[world._light_samples.anchors.body == 1]):
        assert material_points(points + world.origin, shape, shape)[1].all()
    caster = Caster(scene)
    caster.move_to(0.8)
    origins = np.repeat(world.position + world.normal * caster.ray_epsilon, world.rays, axis=0)
    hits = caster.cast(origins[:world.used * world.rays], current_directions(world))
    np.testing.assert_allclose(world.albedo[:world.used].reshape(-1, 3), hits.albedo, atol=1e-6)
    assert not world.move_to(0.8)
