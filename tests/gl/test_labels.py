"""Ids and optical flow: exact for every object, whatever is drawn beside it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import app.api as afterglow
from app.golden import scenes
from app.golden.scenes import FRAME_SECONDS
from app.io.exr_header import CAMERA, INSTANCES, MATERIALS
from app.io.image import read_exr, read_exr_header
from app.math3d import View
from app.renderer import NEAR, Renderer
from app.scene import Camera, Instance, Scene
from app.settings import Settings

pytestmark = pytest.mark.gl
SIZE = (96, 72)
OUTPUTS = ("instance", "material", "flow", "depth", "position")
TIME = FRAME_SECONDS
SCENES = {name: getattr(scenes, name) for name in (
    "room", "outdoor", "dusk", "noon", "hard", "area_lights", "spotlights", "terrace", "emissive", "materials", "glass",
    "waving")}
MAX_FLOW_ERROR = 0.05  # pixels


def draw(scene: Scene, outputs: tuple[str, ...] = OUTPUTS, size: tuple[int, int] = SIZE, taa: bool = False
         ) -> dict[str, np.ndarray]:
    path = scene.cameras[scene.default_camera]
    with Renderer(scene, Settings(size=size, outputs=outputs, taa=taa)) as renderer:
        return renderer.render(path.at(TIME), TIME, (path.at(2 * TIME), 2 * TIME))


@pytest.mark.parametrize("name", SCENES)
def test_ids_are_those_of_each_object_alone(name: str) -> None:
    scene = SCENES[name]()
    both = draw(scene, ("instance", "material"))
    ids = both["instance"][..., 0]
    for number, instance in enumerate(scene.instances, 1):
        alone = draw(replace(scene, instances=(instance,)), ("instance", "material"))
        seen = alone["instance"][..., 0] == 1
        shown = ids == number
        assert not (shown & ~seen).any()
        assert (ids[seen] != 0).all()
        assert np.array_equal(both["material"][shown], alone["material"][shown])


@pytest.mark.parametrize("name", ["room", "hard", "area_lights", "waving"])
def test_the_nearest_object_has_its_id(name: str) -> None:
    scene = SCENES[name]()
    ids = draw(scene, ("instance",))["instance"][..., 0]
    depths = np.stack([draw(replace(scene, instances=(i,)), ("depth",))["depth"][..., 0] for i in scene.instances])
    depths[depths == 0] = np.inf
    nearest, second = np.sort(depths, axis=0)[:2] if len(depths) > 1 else (depths[0], np.inf)
    clear = np.isfinite(nearest) & (second > nearest * 1.001)
    assert np.array_equal(ids[clear], depths.argmin(axis=0)[clear] + 1)
    assert np.array_equal(ids == 0, np.isinf(nearest))


def test_ids_do_not_depend_on_antialiasing() -> None:
    assert all(np.array_equal(draw(scenes.room(), (name,))[name], draw(scenes.room(), (name,), taa=True)[name])
               for name in ("instance", "material", "flow"))


def pixels(points: np.ndarray, camera: Camera, scene: Scene, size: tuple[int, int]) -> np.ndarray:
    """Where world-space points, shape (N, 3), are seen: pixels from the upper left corner."""
    view = View.of(camera, size, NEAR * scene.longest_edge)
    clip = np.c_[points - view.eye, np.ones(len(points))] @ view.clip_from_relative().T
    return (clip[:, :2] / clip[:, 3:] * (1, -1) + 1) * size / 2


def test_flow_is_that_of_surface_points() -> None:
    scene = scenes.room()
    path = scene.cameras["path"]
    images = draw(scene)
    ids, expected = images["instance"][..., 0].astype(int), np.zeros((*SIZE[::-1], 2))
    for number, instance in enumerate(scene.instances, 1):
        at = ids == number
        move = instance.transform_at(2 * TIME) @ np.linalg.inv(instance.transform_at(TIME))
        points = images["position"][at].astype(np.float64)
        later = points @ move[:3, :3].T + move[:3, 3]
        expected[at] = pixels(later, path.at(2 * TIME), scene, SIZE) - pixels(points, path.at(TIME), scene, SIZE)
    assert np.abs(images["flow"] - expected).max() < MAX_FLOW_ERROR
    assert np.linalg.norm(images["flow"], axis=2).max() > 0.5


def vertices(instance: Instance, scene: Scene, time: float) -> np.ndarray:
    transform = instance.transform_at(time)
    return instance.mesh_at(scene.meshes, time).positions @ transform[:3, :3].T + transform[:3, 3]


def test_flow_is_that_of_vertices_that_deform() -> None:
    scene, size = scenes.waving(), (256, 192)
    camera = scene.cameras[scene.default_camera].at(0.0)
    images = draw(scene, ("instance", "flow", "depth"), size)
    view = View.of(camera, size, 1e-3)
    errors = []
    for number, instance in enumerate(scene.instances, 1):
        points = vertices(instance, scene, TIME)
        now, later = (pixels(p, camera, scene, size) for p in (points, vertices(instance, scene, 2 * TIME)))
        depth = (points - view.eye) @ -view.rotation[2]
        for at, moved, d in zip(now, later - now, depth, strict=True):
            x, y = np.floor(at - 0.5).astype(int)
            if not (0 <= x < size[0] - 1 and 0 <= y < size[1] - 1):
                continue
            around = np.s_[y:y + 2, x:x + 2]
            if (images["instance"][around] == number).all() and (np.abs(images["depth"][around] - d) < 0.005 * d).all():
                fx, fy = at - 0.5 - (x, y)
                weights = np.outer((1 - fy, fy), (1 - fx, fx))[..., None]
                errors.append(np.abs((images["flow"][around] * weights).sum(axis=(0, 1)) - moved).max())
    assert len(errors) > 20
    assert max(errors) < MAX_FLOW_ERROR


def test_labels_are_culled_unless_asked_for() -> None:
    with Renderer(scenes.room(), Settings(size=SIZE)) as renderer:
        assert "labels" in renderer.plan.culled
    with Renderer(scenes.room(), Settings(size=SIZE, outputs=("instance",))) as renderer:
        assert [p.name for p in renderer.plan.passes] == ["labels"]


def test_files_name_camera_and_ids(tmp_path: Path) -> None:
    camera = afterglow.camera_from_matrix(np.eye(4), np.array([[50.0, 0, 31.5], [0, 50.0, 23.5], [0, 0, 1]]), (64, 48))
    scene = afterglow.load()
    with afterglow.Renderer(scene, (64, 48), None, taa=False, outputs=("instance", "material")) as renderer:
        frame = renderer.render(camera)
    frame.save(tmp_path / "a.exr")
    header = read_exr_header(tmp_path / "a.exr")
    about = json.loads(header[CAMERA])
    assert np.allclose(about["pose"], afterglow.camera_matrix(camera))
    assert np.allclose(about["intrinsics"], afterglow.intrinsic_matrix(camera, (64, 48)))
    assert json.loads(header[INSTANCES]) == list(frame.instances)
    assert json.loads(header[MATERIALS]) == list(frame.materials)
    assert frame["instance"].dtype == np.int32 and frame["instance"].max() <= len(frame.instances)
    assert np.array_equal(read_exr(tmp_path / "a.exr")["instance"], frame["instance"])
