"""Orthographic and calibrated cameras in every pass, against the exact projection of points and the path tracer."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from app.evaluation.metrics import psnr
from app.load import embedded_scene
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import (
    Camera,
    Clearcoat,
    DirectionalLight,
    Environment,
    Intrinsics,
    Material,
    Scene,
    Sheen,
)
from app.settings import Settings
from tests.gl.scenes import draw, floor, make_scene, quad, slide, sphere

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (96, 64)
EYE, TARGET, UP = (2.0, 3.0, 4.0), (0.2, 0.1, -0.3), (0.1, 1.0, 0.2)
PARALLEL = Camera(EYE, TARGET, UP, orthographic_height=3.0)
LENS = Intrinsics(fx=700, fy=500, cx=350, cy=170, width=640, height=400)
CALIBRATED = Camera(EYE, TARGET, UP, intrinsics=LENS)
BALL = make_scene([sphere((0.2, 0.1, -0.3), 0.8), floor(3.0, -0.9)],
                  [DirectionalLight((0.3, -1.0, -0.2), (3.0, 3.0, 3.0))])


def pixels_of(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Where points are in an image of ``SIZE``, x right, y down from its upper left corner, and their depth."""
    back = np.subtract(camera.eye, camera.target)
    back /= np.linalg.norm(back)
    right = np.cross(camera.up, back)
    right /= np.linalg.norm(right)
    offset = points - camera.eye
    x, y, depth = offset @ right, -(offset @ np.cross(back, right)), -(offset @ back)
    if camera.orthographic_height is not None:
        scale = SIZE[1] / camera.orthographic_height
        return np.stack([SIZE[0] / 2 + scale * x, SIZE[1] / 2 + scale * y, depth], axis=-1)
    lens, scale = camera.intrinsics, SIZE[1] / camera.intrinsics.height
    return np.stack([SIZE[0] / 2 + scale * (lens.cx - lens.width / 2 + lens.fx * x / depth),
                     scale * (lens.cy + lens.fy * y / depth), depth], axis=-1)


def centres() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5), axis=-1)


@pytest.mark.parametrize("towards", [(0.36486177, 0.92406475, -0.11393077), (-0.96773341, -0.20049777, -0.15261944)])
def test_what_faces_a_parallel_view_reflects_the_sky(towards):
    """Rounding makes the cosine between these normals and the view a little more than 1."""
    u = np.cross(towards, (0.3, 1.0, 0.2))
    u /= np.linalg.norm(u)
    v = np.cross(towards, u)
    camera = Camera(tuple(np.multiply(3.0, towards)), (0.0, 0.0, 0.0), UP, orthographic_height=1.0)
    card = quad(tuple(-2 * u - 2 * v), tuple(4 * u), tuple(4 * v), Material(specular=(0.04,) * 3, roughness=0.3))
    scene = replace(make_scene([card]), environment=Environment(np.ones((4, 8, 3), np.float32)))
    specular = draw(scene, (32, 24), ("specular",), camera)["specular"]
    np.testing.assert_allclose(specular, 0.04, rtol=0.05)


def test_a_parallel_view_shows_what_leaves_the_bounds_of_key_times():
    """As an object does that the viewer drags."""
    motion = slide([0.0], [(0.0, 0.0, 0.0)])
    camera = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), orthographic_height=3.0)
    scene = make_scene([quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), motion=motion)], camera=camera)
    with Renderer(scene, Settings(size=SIZE, outputs=("depth",), taa=False, provider="cpu")) as renderer:
        near = renderer.render(camera)["depth"]
        motion.transforms[0, 2, 3] = -50.0
        far = renderer.render(camera, 1e-6)["depth"]
    np.testing.assert_allclose([near.max(), far.max()], [4.0, 54.0], rtol=1e-3)
    assert (far > 0).sum() == (near > 0).sum()


@pytest.mark.parametrize("camera", [PARALLEL, CALIBRATED], ids=["parallel", "calibrated"])
def test_every_visible_point_projects_to_its_pixel(camera):
    images = draw(BALL, SIZE, ("position", "depth"), camera)
    seen = images["depth"][..., 0] > 0
    assert seen.mean() > 0.2
    projected = pixels_of(camera, images["position"][seen].astype(np.float64))
    np.testing.assert_allclose(projected[:, :2], centres()[seen], atol=2e-3)
    np.testing.assert_allclose(projected[:, 2], images["depth"][seen][:, 0], rtol=1e-5)
    to_center = images["position"][seen].astype(np.float64) - (0.2, 0.1, -0.3)
    assert np.abs(np.linalg.norm(to_center, axis=1) - 0.8).min() < 5e-3  # points of the ball lie on it


@pytest.mark.parametrize("camera", [PARALLEL, CALIBRATED], ids=["parallel", "calibrated"])
def test_motion_is_the_difference_of_projections(camera):
    moved = replace(camera, eye=(2.1, 2.9, 4.2), target=(0.25, 0.15, -0.35))
    with Renderer(BALL, Settings(SIZE, outputs=("motion", "position", "depth"), taa=True)) as renderer:
        renderer.render(camera)
        images = renderer.render(moved)
    seen = images["depth"][..., 0] > 0
    points = images["position"][seen].astype(np.float64)
    expected = (pixels_of(moved, points) - pixels_of(camera, points))[:, :2]
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(images["motion"][seen], expected, atol=0.05)


def test_parallel_views_see_every_point_of_a_mirror_alike():
    """A glossy floor under a sun: in a parallel view, all of it has one angle to the viewer and one highlight."""
    glossy = Material(albedo=(0.2, 0.2, 0.2), specular=(0.5, 0.5, 0.5), roughness=0.4)
    scene = make_scene([floor(5.0, material=glossy)], [DirectionalLight((-0.4, -1.0, -0.6), (3.0, 3.0, 3.0))])
    camera = replace(PARALLEL, target=(0.0, 0.0, 0.0), orthographic_height=2.0)
    highlight = draw(scene, SIZE, ("specular",), camera)["specular"]
    assert highlight.min() > 0.01
    assert np.ptp(highlight) < 2e-3 * highlight.mean()


def test_a_renderer_changes_its_projection():
    pinhole = Camera(EYE, TARGET, UP)
    settings = Settings(SIZE, outputs=("final",), taa=True)
    with Renderer(BALL, settings) as renderer:
        before, parallel = renderer.render(pinhole)["final"], renderer.render(PARALLEL)["final"]
        after = renderer.render(pinhole)["final"]
    with Renderer(BALL, settings) as renderer:
        fresh = renderer.render(PARALLEL)["final"]
    np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(parallel, fresh)


@pytest.mark.parametrize("camera", [PARALLEL, CALIBRATED], ids=["parallel", "calibrated"])
def test_frames_accumulate_to_the_supersampled_picture(camera):
    fine = draw(BALL, (SIZE[0] * 8, SIZE[1] * 8), camera=camera)["final"]
    expected = fine.reshape(SIZE[1], 8, SIZE[0], 8, 3).mean(axis=(1, 3))
    with Renderer(BALL, Settings(SIZE, taa=True)) as renderer:
        for _ in range(64):
            renderer.advance(camera)
        settled = renderer.render(camera)["final"]
    assert psnr(settled, expected) > 36


@pytest.mark.parametrize("model", ["ssgi", "ember", "unshadowed_environment"])
def test_a_parallel_view_is_that_of_a_pinhole_far_away(model):
    """All passes at once, since the pinhole's are tested elsewhere."""
    scene = embedded_scene()
    if model == "unshadowed_environment":
        scene = replace(scene, environment=Environment(np.full((4, 8, 3), 0.5, np.float32)))
    target, towards, distance, height = np.array([0.0, 1.0, 0.0]), np.array([0.15, 0.2, 1.0]), 1000.0, 2.2
    towards /= np.linalg.norm(towards)
    parallel = Camera(tuple(target + 3 * towards), tuple(target), orthographic_height=height)
    pinhole = Camera(tuple(target + distance * towards), tuple(target),
                     fov_y_deg=float(np.degrees(2 * np.arctan(height / 2 / distance))))
    pictures = []
    for camera in (parallel, pinhole):
        with Renderer(scene, Settings((192, 128), provider="cpu"), find_model(model)) as renderer:
            for _ in range(24):
                renderer.advance(camera)
            pictures.append(renderer.render(camera)["final"])
    assert psnr(*pictures) > 33


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba, of the extra 'export', is missing")
@pytest.mark.parametrize("camera", [
    Camera((0.0, 1.0, 3.0), (0.0, 1.0, 0.0), orthographic_height=2.2),
    Camera((0.8, 1.6, 3.2), (0.0, 0.9, 0.0), orthographic_height=2.6),
    Camera((0.0, 1.0, 3.6), (0.0, 1.0, 0.0), intrinsics=Intrinsics(900, 1200, 300, 500, 1024, 768))],
    ids=["parallel", "oblique", "calibrated"])
def test_the_path_tracer_sees_the_same(camera):
    from export.reference.path_tracer import PathTracer
    from export.reference.still import Still
    from export.reference.trace import mean_samples

    scene: Scene = embedded_scene()
    images = draw(scene, SIZE, ("direct", "albedo", "depth", "normal"), camera)
    traced = mean_samples(PathTracer(scene, max_bounces=0), Still(scene, camera, SIZE), 64)
    inner = (traced["depth"][..., 0] > 0) & (images["depth"][..., 0] > 0)
    same = inner & (np.abs(traced["depth"] - images["depth"])[..., 0] < 0.02) \
        & (np.einsum("hwc,hwc->hw", traced["normal"], images["normal"]) > 0.99)
    assert same.sum() > 0.9 * inner.sum()
    assert psnr(*(np.where(same[..., None], picture["direct"], 0) for picture in (images, traced))) > 30


@pytest.mark.parametrize("material", [
    Material(clearcoat=Clearcoat(1.0, 0.1), sheen=Sheen((0.5, 0.5, 0.5), 0.4), specular=(0.04,) * 3, roughness=0.5),
    Material(is_blended=True, alpha=0.5)], ids=["layers", "blended"])
def test_layered_and_blended_materials_are_seen_in_parallel(material):
    scene = make_scene([sphere((0.0, 0.8, 0.0), 0.7, material=material), floor(2.0)],
                       [DirectionalLight((0.3, -1.0, -0.2), (3.0, 3.0, 3.0))])
    towards = np.array([0.3, 0.5, 1.0]) / np.linalg.norm([0.3, 0.5, 1.0])
    parallel = Camera(tuple(np.add((0, 0.6, 0), 4 * towards)), (0, 0.6, 0), orthographic_height=2.4)
    pinhole = Camera(tuple(np.add((0, 0.6, 0), 1000 * towards)), (0, 0.6, 0),
                     fov_y_deg=float(np.degrees(2 * np.arctan(1.2 / 1000))))
    assert psnr(*(draw(scene, SIZE, camera=camera)["final"] for camera in (parallel, pinhole))) > 33
