"""The emissive validation scenes: closed rooms of real proportions whose light comes from where it should."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from app.errors import SettingsError
from app.load.emissive_pieces import find_pieces
from app.load.light_tree import MAX_LIGHTS
from app.raycast.caster import Caster, Hits
from app.scene import Scene
from export.dataset.scene_key import scene_key
from export.dataset.scenes.found_emitters import with_found_emitters
from export.dataset.scenes.generated_scene import GeneratedScene
from export.validation.scenes.archway_stair import archway_stair
from export.validation.scenes.barred_window import barred_window
from export.validation.scenes.chandelier import chandelier
from export.validation.scenes.door_ajar import door_ajar

F64 = np.ndarray
Make = Callable[[np.random.Generator], GeneratedScene]
SCENES: dict[str, Make] = {"door": partial(door_ajar, angle_deg=20.0), "window": barred_window, "arch": archway_stair,
                           "chandelier": chandelier}
all_scenes = pytest.mark.parametrize("make", SCENES.values(), ids=SCENES)
SEEDS = range(4)


def made(make: Make, seed: int) -> GeneratedScene:
    return make(np.random.default_rng(seed))


def sphere(count: int) -> F64:
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def cast(scene: Scene, origins: F64, directions: F64) -> Hits:
    caster = Caster(scene)
    return caster.cast((origins - caster.origin).astype(np.float32), directions.astype(np.float32))


def pieces(scene: Scene) -> int:
    """Number of connected emissive pieces."""
    meshes = [mesh for mesh in scene.meshes if scene.materials[mesh.material].emits]
    return sum(len(find_pieces(mesh).is_closed) for mesh in meshes)


@all_scenes
def test_a_seed_gives_one_scene_and_another_seed_another(make: Make) -> None:
    keys = [scene_key(made(make, seed).scene) for seed in (0, 0, 1, 2)]
    assert keys[0] == keys[1] and len(set(keys)) == 3


@all_scenes
@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_are_metric_lit_by_emission_alone_and_partly_glossy(make: Make, seed: int) -> None:
    scene = made(make, seed).scene
    width, height, depth = scene.bounds[1] - scene.bounds[0]
    assert 3 < width < 7 and 2.4 < height < 4.5 and 3.8 < depth < 12
    assert scene.lights == () and all(i.motion is None for i in scene.instances)
    assert any(m.emits for m in scene.materials)
    assert sum(m.has_specular for m in scene.materials) >= 3
    saturation = [1 - min(m.albedo) / max(m.albedo) for m in scene.materials]
    assert max(saturation) > 0.45
    for mesh in scene.meshes:
        assert np.isfinite(mesh.positions).all()
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)


@all_scenes
@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_have_no_holes_and_cameras_see_them(make: Make, seed: int) -> None:
    """No ray from where cameras are leaves the scene, except past the pane outside of a window."""
    generated = made(make, seed)
    rng = np.random.default_rng(seed)
    eyes = np.array([generated.random_eye(rng) for _ in range(40)])
    directions = sphere(500)
    hits = cast(generated.scene, np.repeat(eyes, 500, axis=0), np.tile(directions, (40, 1)))
    escaped = np.isinf(hits.distance)
    assert escaped.mean() < (0.02 if make is barred_window else 1e-9)
    nearest = hits.distance.reshape(40, 500).min(axis=1)
    assert np.median(nearest) > 0.15


@pytest.mark.parametrize("seed", SEEDS)
def test_a_table_behind_the_door_never_sees_the_panel(seed: int) -> None:
    """At small angles, the panel lights almost nothing of the dark room, and more as the door opens."""
    shares = []
    for angle in (1.0, 10.0, 60.0):
        scene = door_ajar(np.random.default_rng(seed), angle).scene
        panel = next(mesh for mesh in scene.meshes if scene.materials[mesh.material].emits)
        low, high = panel.positions.min(axis=0).astype(float), panel.positions.max(axis=0).astype(float)
        z1 = scene.bounds[1, 2]
        rng, count = np.random.default_rng(0), 20_000
        door = high[2] + 0.4
        behind = np.sign(low[0])  # the panel is on the side of the hinges
        table = np.stack([behind * rng.uniform(0.6, 1.2, count), np.full(count, 0.8), rng.uniform(1.0, 1.6, count)], 1)
        anywhere = np.stack([rng.uniform(-1.6, 1.6, count), rng.uniform(0.1, 2.2, count),
                             rng.uniform(door + 0.9, z1 - 0.3, count)], axis=1)
        table[:, 2] += door
        target = rng.uniform(low, high, (count, 3)) + np.array([0.01 * -behind, 0, 0])
        seen = [np.isclose(cast(scene, points, target - points).distance, 1, atol=0.02).mean()
                for points in (table, anywhere)]
        assert angle == 60.0 or seen[0] == 0
        shares.append(seen[1])
    assert shares[0] < 0.002 and shares[0] <= shares[1] < shares[2]


def test_the_angle_opens_the_leaf_and_changes_nothing_else() -> None:
    narrow, wide = (door_ajar(np.random.default_rng(3), angle).scene for angle in (2.0, 50.0))
    assert len(narrow.meshes) == len(wide.meshes)
    moved = [np.abs(a.positions - b.positions).max() for a, b in zip(narrow.meshes, wide.meshes, strict=True)]
    assert 0 < sum(m > 0 for m in moved) <= 2  # paint and brass
    assert 0.5 < max(moved) < 1.0


@pytest.mark.parametrize("angle", [0.0, 61.0, -5.0, float("nan")])
def test_other_angles_are_refused(angle: float) -> None:
    with pytest.raises(SettingsError, match="angle_deg"):
        door_ajar(np.random.default_rng(0), angle)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_window_is_wide_and_most_of_it_is_hidden_by_slats_or_bars(seed: int) -> None:
    scene = barred_window(np.random.default_rng(seed)).scene
    pane = next(mesh for mesh in scene.meshes if scene.materials[mesh.material].emits)
    size = np.ptp(pane.positions, axis=0)
    assert size[0] >= 2 and size[1] >= 1.5
    assert pieces(scene) == 1 and sum(len(mesh.triangles) for mesh in scene.meshes) > 1000


@pytest.mark.parametrize("seed", SEEDS)
def test_a_chandelier_has_hundreds_of_pieces_curved_ones_among_them(seed: int) -> None:
    scene = chandelier(np.random.default_rng(seed)).scene
    assert pieces(scene) >= 300
    curved = [mesh for mesh in scene.meshes if scene.materials[mesh.material].emits
              and len(np.unique(np.round(mesh.normals, 2), axis=0)) > 20]
    assert len(curved) == 3, "bulbs, beads and bent tubes"
    assert sum(len(find_pieces(mesh).is_closed) for mesh in curved) >= 200
    complete = with_found_emitters(scene)
    assert 0 < len(complete.lights) <= MAX_LIGHTS
    assert all(m.is_light_proxy for m in complete.materials if m.emits)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_arch_leads_to_tall_panes_and_below_the_landing_is_space(seed: int) -> None:
    scene = archway_stair(np.random.default_rng(seed)).scene
    panes = [mesh for mesh in scene.meshes if scene.materials[mesh.material].emits]
    assert 2 <= len(panes) <= 3 and all(np.ptp(mesh.positions[:, 1]) > 2 for mesh in panes)
    camera = scene.cameras["main"].at(0.0)  # at the wall opposite the stair
    side, (x, _, z) = -np.sign(camera.eye[0]), scene.bounds[1]
    below = np.array([[side * (x - 0.6), 1.3, z - 0.4]] * 2)
    up, across = cast(scene, below, np.array([[0.0, 1.0, 0.0], [-side, 0.0, 0.0]])).distance
    assert up < 0.3 and across > 1.0
