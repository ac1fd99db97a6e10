"""Ids and optical flow: exact for every object, whatever is drawn beside it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import app.api as afterglow
from app.golden import scenes
from app.golden.catalogue import catalogue
from app.golden.scene_case import SceneCase
from app.golden.scenes import FRAME_SECONDS
from app.io.exr_header import CAMERA, INSTANCES, MATERIALS
from app.io.image import read_exr, read_exr_header
from app.math3d import View
from app.renderer import NEAR, Renderer
from app.scene import Camera, Instance, Scene
from app.settings import Settings

pytestmark = pytest.mark.gl
SIZE = (96, 72)
TIME, LATER = FRAME_SECONDS, 2 * FRAME_SECONDS
SCENES = {case.scene.name: case.scene for case in catalogue().values() if isinstance(case, SceneCase)}
FLOW = "instance", "material", "flow"
MAX_FLOW_ERROR = 0.05  # pixels


def cameras(scene: Scene) -> tuple[Camera, Camera]:
    """The default camera at ``TIME``, and one that has moved and turned since then."""
    camera = scene.cameras[scene.default_camera].at(TIME)
    step = 0.02 * scene.longest_edge
    later = replace(camera, eye=tuple(np.add(camera.eye, (step, 0.3 * step, -0.5 * step))),
                    target=tuple(np.add(camera.target, (0.0, 0.5 * step, 0.0))))
    return camera, later


def draw(scene: Scene, outputs: tuple[str, ...] = FLOW, size: tuple[int, int] = SIZE) -> dict[str, np.ndarray]:
    camera, later = cameras(scene)
    with Renderer(scene, Settings(size=size, outputs=outputs, taa=False)) as renderer:
        return renderer.render(camera, TIME, (later, LATER))


@cache
def draw_alone(name: str, index: int) -> dict[str, np.ndarray]:
    """An instance without the others; opaque where it covers at least half of what is behind it."""
    scene = SCENES[name]
    materials = tuple(replace(m, is_blended=False, alpha_cutoff=0.5 if m.is_blended else m.alpha_cutoff,
                              transmission=None) for m in scene.materials)
    return draw(replace(scene, instances=(scene.instances[index],), materials=materials),
                ("instance", "material", "depth", "position"))


@cache
def draw_together(name: str) -> dict[str, np.ndarray]:
    return draw(SCENES[name])


@pytest.mark.parametrize("name", SCENES)
def test_ids_are_those_of_each_object_alone(name: str) -> None:
    ids = draw_together(name)["instance"][..., 0]
    alone = [draw_alone(name, index) for index in range(len(SCENES[name].instances))]
    depths = np.stack([np.where(images["instance"] == 1, images["depth"], np.inf)[..., 0] for images in alone])
    assert np.array_equal(ids == 0, np.isinf(depths).all(axis=0))
    materials = np.stack([images["material"][..., 0] for images in alone])
    shown = ids > 0
    rows, columns = np.nonzero(shown)
    numbers = ids[shown].astype(int) - 1
    depth_shown = depths[numbers, rows, columns]
    assert np.isfinite(depth_shown).all()  # nothing is shown beyond an object's own silhouette
    assert (depth_shown <= depths.min(axis=0)[shown] * 1.001).all()  # nor behind another one
    assert np.array_equal(draw_together(name)["material"][..., 0][shown], materials[numbers, rows, columns])


@pytest.mark.parametrize("name", ["room", "outdoor"])
def test_ids_and_flow_do_not_depend_on_antialiasing(name: str) -> None:
    scene = SCENES[name]
    camera, later = cameras(scene)
    with Renderer(scene, Settings(size=SIZE, outputs=("final", *FLOW))) as renderer:
        for _ in range(2):  # the first frame has no offset
            renderer.advance(camera, TIME)
        images = renderer.render(camera, TIME, (later, LATER))
    assert all(np.array_equal(draw_together(name)[output], images[output]) for output in FLOW)


def pixels(points: np.ndarray, camera: Camera, scene: Scene, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Where world-space points, shape (N, 3), are seen: pixels from the upper left corner."""
    view = View.of(camera, size, NEAR * scene.longest_edge)
    clip = np.c_[points - view.eye, np.ones(len(points))] @ view.clip_from_relative().T
    return (clip[:, :2] / clip[:, 3:] * (1, -1) + 1) * size / 2


@pytest.mark.parametrize("name", [name for name in SCENES if name != "waving"])
def test_flow_is_that_of_surface_points(name: str) -> None:
    scene, images = SCENES[name], draw_together(name)
    (camera, later), ids = cameras(scene), images["instance"][..., 0]
    ahead, compared = View.of(later, SIZE, NEAR * scene.longest_edge), 0
    for index, instance in enumerate(scene.instances):
        at = ids == index + 1
        move = instance.transform_at(LATER) @ np.linalg.inv(instance.transform_at(TIME))
        points = draw_alone(name, index)["position"][at].astype(np.float64)
        moved = points @ move[:3, :3].T + move[:3, 3]
        expected = pixels(moved, later, scene) - pixels(points, camera, scene)
        errors = np.abs(images["flow"][at] - expected)[(moved - ahead.eye) @ -ahead.rotation[2] > 0]
        assert errors.max(initial=0.0) < MAX_FLOW_ERROR
        compared += len(errors)
    assert compared > 0.9 * (ids > 0).sum()
    assert np.linalg.norm(images["flow"], axis=2).max() > 0.5


def vertices(instance: Instance, scene: Scene, time: float) -> np.ndarray:
    transform = instance.transform_at(time)
    return instance.mesh_at(scene.meshes, time).positions @ transform[:3, :3].T + transform[:3, 3]


def test_flow_is_that_of_vertices_that_deform() -> None:
    scene, size = scenes.waving(), (256, 192)
    camera, later = cameras(scene)
    images = draw(scene, ("instance", "flow", "depth"), size)
    view = View.of(camera, size, 1e-3)
    errors = []
    for number, instance in enumerate(scene.instances, 1):
        points = vertices(instance, scene, TIME)
        now = pixels(points, camera, scene, size)
        moved = pixels(vertices(instance, scene, LATER), later, scene, size) - now
        depth = (points - view.eye) @ -view.rotation[2]
        for at, expected, d in zip(now, moved, depth, strict=True):
            x, y = np.floor(at - 0.5).astype(int)
            if not (0 <= x < size[0] - 1 and 0 <= y < size[1] - 1):
                continue
            around = np.s_[y:y + 2, x:x + 2]
            if (images["instance"][around] == number).all() and (np.abs(images["depth"][around] - d) < 0.005 * d).all():
                fx, fy = at - 0.5 - (x, y)
                weights = np.outer((1 - fy, fy), (1 - fx, fx))[..., None]
                errors.append(np.abs((images["flow"][around] * weights).sum(axis=(0, 1)) - expected).max())
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
