"""Automatic cameras and lights, orbits, and the voxel grid that they rest on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app.errors import SceneError
from app.load import auto_camera, embedded_scene, load_scene, orbit
from app.load.free_space import FreeSpace
from app.math3d import View
from app.scene import DirectionalLight, PointLight
from tests.deforming import deforming_scene
from tests.gl.scenes import make_scene, slide, sphere
from tests.unit.load_helpers import write_obj


def save(folder, mesh):
    obj = "".join("v {} {} {}\n".format(*v) for v in mesh.vertices)
    obj += "".join("f {} {} {}\n".format(*f) for f in mesh.faces + 1)
    return load_scene(write_obj(folder, obj))


@pytest.fixture
def room(tmp_path):
    walls = trimesh.creation.box((10, 3, 5))
    walls.invert()
    crate = trimesh.creation.box((0.8, 0.8, 0.8)).apply_translation((2, -1.1, 1))
    return save(tmp_path, trimesh.util.concatenate([walls, crate]))


@pytest.fixture
def ball(tmp_path):
    return save(tmp_path, trimesh.creation.icosphere(3, radius=2).apply_translation((5, 0, 0)))


def test_a_room_gets_a_camera_and_a_light_inside(room):
    camera = room.cameras[room.default_camera].at(0)
    eye, forward = np.array(camera.eye), np.subtract(camera.target, camera.eye)
    assert (room.bounds[0] + 0.25 < eye).all() and (eye < room.bounds[1] - 0.25).all()
    assert abs(forward[0]) > abs(forward[2]), "it looks along the long side"
    assert eye[0] * forward[0] < 0, "from one end to the other"
    (lamp,) = room.lights
    assert isinstance(lamp, PointLight) and 0 < lamp.position[1] < 1.5 and lamp.radius > 0
    assert any("inside" in n for n in room.notices) and any("ceiling" in n for n in room.notices)
    assert room.default_camera == "auto"


def test_an_object_is_seen_completely_from_outside(ball):
    camera = auto_camera(ball)
    np.testing.assert_allclose(camera.target, [5, 0, 0], atol=1e-2)
    distance = np.linalg.norm(np.subtract(camera.eye, camera.target))
    assert 2 < distance * np.sin(np.radians(camera.fov_y_deg / 2)) < 4
    (sun,) = ball.lights
    assert isinstance(sun, DirectionalLight) and sun.direction[1] < 0
    assert any("outside" in n for n in ball.notices)


@pytest.mark.parametrize("kind", ["slide", "skin", "morph"])
def test_what_moves_fills_the_picture_and_never_leaves_it(kind):
    """As what stands still does: nine tenths of its width or height, at the time when it needs most."""
    if kind == "slide":
        times, scene = np.linspace(0, 2, 9), make_scene([replace(
            sphere((0, 0, 0), 1.0), motion=slide((0, 1, 2), [(0, 0, 0), (3, 0, 1), (0, 2, 0)]))])
    else:
        deforming = deforming_scene(kind, [])
        scene = deforming.scene
        times = np.linspace(0, max(scene.key_times), 33)
    camera = auto_camera(scene)
    view, farthest = View.of(camera, (400, 300), 1e-3), 0.0
    for time in times:
        for instance in scene.instances:
            matrix = instance.transform_at(time)
            at = instance.mesh_at(scene.meshes, time).positions @ matrix[:3, :3].T + matrix[:3, 3]
            seen = (at - np.array(camera.eye)) @ view.rotation.T
            farthest = max(farthest, np.abs(seen[:, :2] / -seen[:, 2:] / view.half_size).max())
    assert 0.88 < farthest < 0.94


def test_orbit_goes_once_around_an_object(ball):
    base = auto_camera(ball)
    cameras = orbit(ball, base, 8)
    assert cameras[0].eye == pytest.approx(base.eye)
    arms = np.array([np.subtract(c.eye, c.target) for c in cameras])
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), np.linalg.norm(arms[0]))
    np.testing.assert_allclose(arms.mean(axis=0)[[0, 2]], 0, atol=1e-9)


def test_orbit_in_a_room_stays_clear_of_the_walls(room):
    base = room.cameras["auto"].at(0)
    eyes = np.array([c.eye for c in orbit(room, base, 16)])
    assert len(np.unique(eyes.round(6), axis=0)) == 16
    assert (eyes > room.bounds[0]).all() and (eyes < room.bounds[1]).all()
    step = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    assert step.max() < 3 * step.min()


def test_orbit_before_an_open_box_never_leaves_its_front():
    scene = embedded_scene()
    for camera in orbit(scene, scene.cameras["main"].at(0), 12):
        assert camera.eye[2] > 2


def test_a_million_triangles_are_voxelised_quickly(tmp_path):
    side = np.linspace(-1, 1, 709)
    x, z = np.meshgrid(side, side, indexing="ij")
    points = np.stack([x, 0.01 * np.sin(9 * x), z], axis=-1).reshape(-1, 3)
    a = (np.arange(708)[:, None] * 709 + np.arange(708)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 710], 1), np.stack([a, a + 710, a + 709], 1)])
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "field.ply")
    assert load_scene(tmp_path / "field.ply").cameras["auto"].at(0).eye[1] > 0.5


def test_rays_measure_free_distance(room):
    space = FreeSpace(room.meshes, room.instances)
    distance, back = space.cast(np.zeros((2, 3)), np.array([[1.0, 0, 0], [0, 0, -1.0]]))
    np.testing.assert_allclose(distance, [5, 2.5], atol=2 * space.voxel)
    assert not back.any() and space.is_room


@pytest.mark.parametrize(("size", "is_furnished", "is_room"), [
    (0.2, False, False), (0.2, True, False), (5.0, False, False), (5.0, True, True), (20.0, False, True)],
    ids=["cup", "music box", "crate", "cabin", "hall"])
def test_a_hollow_object_is_no_room_unless_it_is_furnished_or_large(tmp_path, size, is_furnished, is_room):
    """Walls with two sides; a room of one-sided walls shows their backs to who looks at it from outside."""
    inside = trimesh.creation.box((0.9 * size, 0.6 * size, 0.9 * size))
    inside.invert()
    parts = [trimesh.creation.box((size, 0.7 * size, size)), inside]
    if is_furnished:
        table = trimesh.creation.box((0.3 * size, 0.02 * size, 0.2 * size))
        parts.append(table.apply_translation((0.05 * size, -0.12 * size, 0.1 * size)))
    scene = save(tmp_path, trimesh.util.concatenate(parts))
    assert FreeSpace(scene.meshes, scene.instances).is_room == is_room
    assert isinstance(scene.lights[0], PointLight if is_room else DirectionalLight)


def test_the_embedded_box():
    scene = embedded_scene()
    assert scene.lighting == "lamp" and scene.default_camera == "main" and not scene.notices
    assert scene.lights[0].radius == pytest.approx(0.12)
    assert not any(m.emits for m in scene.materials)
    emissive = embedded_scene(lighting="emissive")
    assert len(emissive.lights) == 1 and emissive.lights[0].center[1] == pytest.approx(1.995)
    with pytest.raises(SceneError, match="lamp, emissive"):
        embedded_scene(lighting="sun")
