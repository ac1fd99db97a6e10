"""The classical screen-space method where everything that matters is on screen, and what it must never do."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.network.selection import SSGI, Model, find_model
from app.renderer import Renderer
from app.scene import Camera, Material, PointLight, Scene
from app.settings import Settings
from tests.gl.closed_forms import polygon_irradiance
from tests.gl.scenes import F32, Part, Point, box, draw, floor, make_scene, moved, quad, sphere

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

GLOW = Material(albedo=(0.0,) * 3, emission=(1.0, 0.5, 0.25))
SIZE = (512, 384)
SIDE = 4.0
WALL = np.array([(0, 0, 0), (0, SIDE, 0), (0, SIDE, SIDE), (0, 0, SIDE)])
ROOT = Path(__file__).parents[2]


def indirect(scene: Scene, camera: Camera | None = None, size: tuple[int, int] = SIZE, **settings: object) -> F32:
    return draw(scene, size, ("indirect",), camera, SSGI, **settings)["indirect"]


CAMERA = Camera((8, 3, 2), (1, 1.5, 2), fov_y_deg=40)


def corner(albedo: float = 0.5) -> Scene:
    """A floor y = 0 before a glowing wall x = 0."""
    return make_scene([quad((0, 0, 0), (0, SIDE, 0), (0, 0, SIDE), GLOW),
                       quad((0, 0, 0), (0, 0, SIDE), (SIDE, 0, 0), Material(albedo=(albedo,) * 3))], camera=CAMERA)


@pytest.mark.parametrize(("eye", "target", "mean", "p90"), [
    pytest.param((3, 9, 2), (1.5, 1, 2), 0.02, 0.08, id="from above"),
    pytest.param((8, 3, 2), (1, 1.5, 2), 0.03, 0.10, id="facing the wall"),
    pytest.param((9, 7, 9), (1.5, 1.5, 1.5), 0.04, 0.16, id="aslant"),
])
def test_a_floor_sees_a_wall_by_its_form_factor(eye: Point, target: Point, mean: float, p90: float) -> None:
    images = draw(corner(), SIZE, ("indirect", "position", "depth"), Camera(eye, target, fov_y_deg=40), SSGI)
    at = images["position"]
    on = (images["depth"][..., 0] > 0) & (np.abs(at[..., 1]) < 1e-3) & (at[..., 0] > 0.05)
    reference = polygon_irradiance(at[on].astype(np.float64), (0, 1, 0), WALL) / np.pi
    found = images["indirect"][on]
    error = np.abs(found[:, 0] / reference - 1)
    print(f"WALL mean {found[:, 0].mean() / reference.mean() - 1:+.2%}, p90 {np.percentile(error, 90):.2%}")
    assert on.mean() > 0.05
    assert found[:, 0].mean() == pytest.approx(reference.mean(), rel=mean)
    assert np.percentile(error, 90) < p90
    np.testing.assert_allclose(found.mean(axis=0), found[:, 0].mean() * np.array([1, 0.5, 0.25]), rtol=1e-3)


@pytest.mark.parametrize("angle", [60, 90])
def test_a_glowing_bowl_lights_itself_evenly(angle: float) -> None:
    """Any point of a spherical cap sees the cap as its share of the sphere's area."""
    whole = sphere((0, 0, 0), 2.0, 48).triangles
    bowl = whole[whole.mean(axis=1)[:, 1] < -2 * np.cos(np.radians(angle))]
    camera = Camera((0, 4, 0), (0, -2, 0), (0, 0, -1), 55)
    images = draw(make_scene([Part(bowl, GLOW)]), SIZE, ("indirect", "depth"), camera, SSGI)
    found = images["indirect"][images["depth"][..., 0] > 0][:, 0]
    reference = (1 - np.cos(np.radians(angle))) / 2
    error = np.abs(found / reference - 1)
    print(f"BOWL mean {found.mean() / reference - 1:+.2%}, p90 {np.percentile(error, 90):.2%}")
    assert found.mean() == pytest.approx(reference, rel=0.02)
    assert np.percentile(error, 90) < 0.05


def test_what_is_flat_or_bulges_does_not_light_itself() -> None:
    for part in (floor(2.0, material=GLOW), sphere((0, 0, 0), 1.0, material=GLOW), box((-1, -1, -1), (2, 2, 2), GLOW)):
        for eye in ((0, 3, 0.1), (2, 1, 3), (0, 0.1, 4)):
            assert indirect(make_scene([part]), Camera(eye, (0, 0, 0))).max() < 1e-3


def test_a_low_wall_hides_the_lower_part_of_a_glowing_one() -> None:
    black = Material(albedo=(0.0,) * 3)
    scene = make_scene([quad((0, 0, 0), (0, SIDE, 0), (0, 0, SIDE), GLOW), quad((0, 0, 0), (0, 0, SIDE), (SIDE, 0, 0)),
                        box((1.0, 0, -3), (0.2, 0.8, SIDE + 6), black)])
    images = draw(scene, SIZE, ("indirect", "position"), Camera((7, 9, 2), (1.2, 0.8, 2), fov_y_deg=50), SSGI)
    for x, z in ((2.6, 2.0), (3.0, 2.0), (3.0, 1.0)):
        top = 0.8 * x / (x - 1.2)  # of what is hidden
        seen = np.array([(0, top, 0), (0, SIDE, 0), (0, SIDE, SIDE), (0, top, SIDE)])
        reference = polygon_irradiance(np.array([(x, 0.0, z)]), (0, 1, 0), seen)[0] / np.pi
        near = np.linalg.norm(images["position"] - (x, 0, z), axis=2) < 0.15
        found = images["indirect"][near][:, 0].mean()
        print(f"HIDDEN at {x}, {z}: {found:.4f}, reference {reference:.4f}")
        everything = polygon_irradiance(np.array([(x, 0.0, z)]), (0, 1, 0), WALL)[0] / np.pi
        assert reference < 0.8 * everything
        assert found == pytest.approx(reference, rel=0.15)


def test_without_light_it_is_black() -> None:
    scene = make_scene([floor(2.0), box((-0.5, 0, -0.5), (1, 1, 1))])
    for taa in (False, True):
        images = draw(scene, SIZE, ("final", "indirect"), Camera((2, 2, 3), (0, 0, 0)), SSGI, taa=taa)
        assert images["indirect"].max() == images["final"].max() == 0


def test_albedo_plays_no_part() -> None:
    np.testing.assert_array_equal(indirect(corner(albedo=0.0)), indirect(corner(albedo=0.9)))


def test_an_emitter_that_is_a_light_does_not_light_twice() -> None:
    scene = corner()
    analytic = replace(scene, materials=tuple(replace(m, is_light_proxy=True) for m in scene.materials))
    assert indirect(scene).max() > 0.3
    assert indirect(analytic).max() == 0


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_scale_of_a_scene_changes_nothing(scale: float) -> None:
    base, found = indirect(corner()), indirect(moved(corner(), scale=scale))
    assert np.mean(np.abs(found - base) > 0.01) < 0.001


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (5, 1), (61, 47), (640, 16)])
@pytest.mark.parametrize("taa", [False, True])
def test_any_size(size: tuple[int, int], taa: bool) -> None:
    images = draw(corner(), size, ("indirect", "depth"), model=SSGI, taa=taa)
    assert images["indirect"].shape == (*size[::-1], 3)
    assert np.isfinite(images["indirect"]).all()
    assert 0 <= images["indirect"].min() <= images["indirect"].max() <= 1.01
    assert images["indirect"][images["depth"][..., 0] == 0].max(initial=0) == 0


def test_half_the_size_looks_the_same() -> None:
    large, small = (indirect(corner(), size=size) for size in ((512, 384), (256, 192)))
    assert small.mean() == pytest.approx(large.mean(), rel=0.03)


def test_stills_stay_still() -> None:
    """Without accumulation the noise is fixed; with it, it settles until only the edges' anti-aliasing moves."""
    scene = make_scene([floor(2.0), box((-0.5, 0, -0.5), (1, 1, 1))], [PointLight((1, 3, 1), (9.0,) * 3)],
                       Camera((2, 2, 3), (0, 0, 0)))
    first, second = after(scene, 0, SSGI, taa=False)
    np.testing.assert_array_equal(first, second)
    assert (first != after(scene, 0, None, taa=False)[0]).mean() > 0.05
    changes = [np.mean(np.abs(first - second) > 1) for first, second in (after(scene, 63, m) for m in (None, SSGI))]
    assert changes[1] <= changes[0] + 0.0005


def after(scene: Scene, settling: int, model: Model | None, taa: bool = True) -> list[NDArray[np.int16]]:
    """Two pictures in a row after some frames."""
    camera = scene.cameras["main"].at(0.0)
    with Renderer(scene, Settings((128, 96), taa=taa), model) as renderer:
        for _ in range(settling):
            renderer.advance(camera)
        return [renderer.render(camera)["display"].astype(np.int16) for _ in range(2)]


def test_the_seed_turns_the_noise() -> None:
    one, same, other = (indirect(corner(), seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).mean() > 0.1
    assert one.mean() == pytest.approx(other.mean(), rel=0.01)


def test_no_pass_of_a_network_runs() -> None:
    with Renderer(corner(), Settings((32, 24)), SSGI) as renderer:
        names = [p.name for p in renderer.plan.passes]
        assert {"ssgi_radiance", "ssgi", "ssgi_filter_near", "ssgi_filter_far", "accumulate", "upsample"} <= set(names)
        assert not [n for n in names if n.startswith(("cube_", "pack_screen", "network"))]
        assert {"cube_gbuffer", "cube_direct", "pack_screen", "network"} <= set(renderer.plan.culled)
        assert renderer.device["provider"] == "none"
    for model in (None, find_model("gather")):
        with Renderer(corner(), Settings((32, 24), provider="cpu"), model) as renderer:
            assert not [p.name for p in renderer.plan.passes if p.name.startswith("ssgi")]
            assert "ssgi" in renderer.plan.culled


def test_onnxruntime_is_not_loaded(tmp_path: Path) -> None:
    code = ("import sys; from app.cli import cli; "
            "cli(['--model', 'ssgi', '--size', '16x12', '--settle', '0'], standalone_mode=False); "
            "sys.exit('onnxruntime' in sys.modules)")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "0000.png").is_file()
