"""Ember through the whole renderer: light at surfels, closed boxes, exposure, light that the camera does not see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.graph import Buf
from app.load import embedded_scene
from app.math3d import View
from app.network.selection import find_model
from app.radiance_scale import radiance_scale
from app.raycast.caster import Caster
from app.renderer import NEAR, Renderer
from app.scene import Camera, Light, Material, PointLight, RectLight, Scene, SpotLight
from app.settings import Settings
from app.surfels.world import WorldSurfels
from tests.conftest import SMALL_EMBER
from tests.gl.closed_forms import F64, point_irradiance
from tests.gl.scenes import Images, Point, box, draw, floor, make_scene, quad
from tests.gl.test_indirect import mean_over_walls
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (256, 192)


@pytest.fixture(scope="module")
def small(small_ember: Path) -> Path:
    """Ember with fewer surfels, which are made in a second."""
    pytest.importorskip("torch", reason="export needs torch")
    return small_ember


def test_rays_of_surfels_stay_on_the_host_and_count_when_they_change(small: Path) -> None:
    scene = embedded_scene()
    camera = scene.cameras[scene.default_camera].at(0.0)
    with Renderer(scene, settings("indirect"), small) as renderer:
        assert {name for name, r in renderer.plan.resources.items() if isinstance(r, Buf) and not r.on_host} == {
            "tensor_screen"}
        first = renderer.render(camera)["indirect"]
        rays = renderer.resource("tensor_rays")
        override(renderer, "tensor_rays", lambda rays: rays * np.float32([1, 0, 0, 0]).reshape(4, 1, 1))
        assert renderer.render(camera)["indirect"].max() < 0.1 * first.max()
        override(renderer, "tensor_rays", None)
        np.testing.assert_array_equal(renderer.render(camera)["indirect"], first)
        again = renderer.resource("tensor_rays")
        renderer.render(camera)
        assert renderer.resource("tensor_rays") is again and np.array_equal(rays, again)


def settings(*outputs: str) -> Settings:
    return Settings(size=SIZE, outputs=outputs, taa=False, provider="cpu")


def surfel_light(scene: Scene, camera: Camera, model: Path) -> tuple[WorldSurfels, F64]:
    """The surfels that a renderer makes, and the direct light of each, W/(sr m²)."""
    with Renderer(scene, settings("indirect"), model) as renderer:
        renderer.render(camera)
        light = renderer.resource("surfel_light").T.astype(np.float64) / radiance_scale(scene)
    world = WorldSurfels(scene, Caster(scene), [View.of(camera, SIZE, NEAR * scene.longest_edge)], *SMALL_EMBER)
    return world, light


def of_surfels(world: WorldSurfels, values: NDArray[np.generic]) -> F64:
    """Means over the light samples of each surfel, shape (S,); NaN where it has none."""
    owner = world.light_sample_surfel
    with np.errstate(invalid="ignore"):
        return np.bincount(owner, values, world.count) / np.bincount(owner, minlength=world.count)


def blocked(points: F64, light: Point, low: Point, high: Point, margin: float) -> np.ndarray:
    """Whether segments to the light pass a box that is larger by ``margin`` (Kay and Kajiya 1986)."""
    along = np.asarray(light) - points
    with np.errstate(divide="ignore"):
        a, b = ((np.asarray(c) + s * margin - points) / along for c, s in ((low, -1), (high, 1)))
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    return (enter < leave) & (leave > 0) & (enter < 1)


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, 0, -1e6)])
def test_surfels_under_a_lamp_get_its_irradiance_or_its_shadow(small: Path, offset: Point) -> None:
    """Irradiance / π of a point light is I cos θ / (π d²), and 0 behind a box."""
    lamp, low, high = (0.5, 2.0, 0.3), (-0.5, 0.4, -0.5), (0.3, 0.8, 0.5)
    shift = np.asarray(offset, np.float64)
    parts = [floor(2.0), box(low, tuple(np.subtract(high, low)))]
    parts = [replace(p, place=p.place + np.outer(np.append(shift, 0), (0, 0, 0, 1))) for p in parts]
    scene = make_scene(parts, [PointLight(tuple(shift + lamp), (3.0, 2.0, 1.0))])
    camera = Camera(tuple(shift + np.array((2, 1.5, 3))), tuple(shift))
    world, found = surfel_light(scene, camera, small)
    at, normal = world.light_sample_position + world.origin - shift, world.light_sample_normal
    to = np.asarray(lamp) - at
    square = (to * to).sum(-1)
    free = np.maximum((to * normal).sum(-1), 0) / square**1.5 / np.pi
    on_floor = normal[:, 1] * (at[:, 1] < 0.1) > 0.5
    shadow, light = blocked(at, lamp, low, high, -0.03), ~blocked(at, lamp, low, high, 0.03)
    sunny, dark = (of_surfels(world, on_floor & where) == 1 for where in (light, shadow))
    mean = of_surfels(world, free)
    assert sunny.sum() > 40 and dark.sum() > 5
    np.testing.assert_allclose(found[sunny], mean[sunny, None] * (3, 2, 1), rtol=2e-3)
    at_floor = on_floor & light
    np.testing.assert_allclose(free[at_floor], point_irradiance(at[at_floor], (0, 1, 0), lamp) / np.pi, rtol=1e-4)
    assert not found[dark].any()
    assert not found[of_surfels(world, (to * normal).sum(-1) < -1e-3) == 1].any()
    top = of_surfels(world, (normal[:, 1] > 0.5) & (at[:, 1] > 0.7)) == 1
    assert top.any()
    np.testing.assert_allclose(found[top, 0], 3 * mean[top], rtol=2e-3)


def test_a_scene_without_lights_has_none_at_its_surfels(small: Path) -> None:
    scene = make_scene([floor(2.0), box((-1, 0.2, -1), (1, 1, 1))])
    _, found = surfel_light(scene, Camera((2, 1.5, 3), (0, 0, 0)), small)
    assert len(found) == SMALL_EMBER[0] and not found.any()
    assert not draw(scene, SIZE, ("indirect",), Camera((2, 1.5, 3), (0, 0, 0)), small)["indirect"].any()


@pytest.mark.parametrize(("rho", "eye", "target"), [(0.2, (20, 15, 35), (20, 15, 0)), (0.8, (20, 15, 20), (0, 9, 3))])
def test_a_glowing_closed_box_is_uniform(small: Path, rho: float, eye: Point, target: Point) -> None:
    """Every surface emits 1 and reflects ρ: the radiance is 1 / (1 − ρ) everywhere, whatever the shape."""
    walls = box((0, 0, 0), (40, 30, 40), Material(albedo=(rho,) * 3, emission=(1.0,) * 3))
    found = draw(make_scene([walls]), SIZE, ("indirect",), Camera(eye, target, fov_y_deg=60), small)["indirect"]
    np.testing.assert_allclose(found, 1 / (1 - rho), rtol=1.5e-3)  # half floats


@pytest.mark.parametrize(("rho", "lamp", "eye", "name"), [
    pytest.param(0.8, (20, 30, 20), (12, 14, 28), "ember", marks=pytest.mark.long),
    (0.3, (20, 20, 20), (20, 20, 20), "small"),
    (0.8, (20, 20, 20), (20, 20, 20), "small"), (0.9, (20, 30, 20), (12, 14, 28), "small")])
def test_a_lamp_in_a_closed_box_keeps_its_energy(small: Path, rho: float, lamp: Point, eye: Point, name: str) -> None:
    """All flux lands on the walls, so their mean indirect radiance is flux / (π area) times ρ / (1 − ρ)."""
    scene = make_scene([box((0, 0, 0), (40, 40, 40), Material(albedo=(rho,) * 3))],
                       [PointLight(lamp, (100.0, 100.0, 100.0))])
    reference = 4 * np.pi * 100 / (6 * 40**2) / np.pi * rho / (1 - rho)
    share = mean_over_walls(scene, eye, find_model("ember") if name == "ember" else small) / reference
    print(f"LAMP {name} {rho}: {share - 1:+.2%}")
    assert share == pytest.approx(1, abs=0.01 if name == "ember" else 0.03)


def test_what_a_lamp_lights_behind_itself_is_not_seen_through_it(small: Path) -> None:
    """A lamp that shines upwards, too, lights a ceiling close above; little of that leaves the gap between them."""
    corner, sides = (15, 39.6, 15), ((10, 0, 0), (0, 0, 10))
    parts = [box((0, 0, 0), (40, 40, 40), Material(albedo=(0.6,) * 3)),
             quad(corner, *sides, Material(albedo=(0.6,) * 3, emission=(1.0,) * 3, is_light_proxy=True))]
    camera = Camera((20, 10, 38), (20, 0, 10), fov_y_deg=60)

    def mean(two_sided: bool) -> float:
        light = RectLight((20, 39.6, 20), *sides, (1.0,) * 3, two_sided)
        return float(draw(make_scene(parts, [light]), SIZE, ("indirect",), camera, small)["indirect"].mean())

    assert mean(False) < mean(True) < 1.2 * mean(False)


def scaled(light: Light, factor: float) -> Light:
    key = "radiance" if isinstance(light, RectLight) else "intensity"
    return replace(light, **{key: tuple(factor * c for c in getattr(light, key))})  # type: ignore[arg-type]


def brighter(scene: Scene, factor: float) -> Scene:
    """All light of a scene times ``factor``."""
    return replace(scene, lights=tuple(scaled(light, factor) for light in scene.lights), materials=tuple(
        replace(m, emission=tuple(factor * c for c in m.emission)) for m in scene.materials))


@pytest.mark.parametrize("glows", [False, True])
def test_indirect_light_scales_with_the_light(small: Path, glows: bool) -> None:
    """Half floats round what surfels, the network's texels and the picture's hold, each by up to 5e-4."""
    scene = embedded_scene()
    if glows:  # the lamp is no light then, but met by rays
        lamp = replace(scene.materials[0], emission=(40.0, 36.0, 29.0))
        scene = replace(scene, lights=(), materials=(lamp, *scene.materials[1:]))
    reference = draw(scene, SIZE, ("indirect",), model=small)["indirect"].astype(np.float64)
    assert reference.mean() > 0
    for factor in (1e-4, 0.03, 7.0, 1e4):
        found = draw(brighter(scene, factor), SIZE, ("indirect",), model=small)["indirect"] / factor
        error = np.abs(found - reference)
        print(f"EXPOSURE {factor:g}: mean {error.mean() / reference.mean():.1e}, "
              f"max {error.max() / reference.max():.1e}")
        assert error.mean() < 1e-3 * reference.mean()
        assert error.max() < 2e-3 * reference.max()


HALL = box((0, 0, 0), (8, 3, 4), Material(albedo=(0.6,) * 3))
LIT = SpotLight((4.0, 1.5, 2.0), (-1.0, 0.0, 0.0), (50.0, 50.0, 50.0), 20.0, 25.0)  # at one end of the hall
TOWARDS, AWAY = (Camera((4, 1.5, 3.8), (x, 1.0, 0), fov_y_deg=70) for x in (2.0, 7.0))


def compared(first: Images, camera: Camera, second: Images) -> tuple[F64, F64]:
    """What two images show of the same points: the second's pixels and those of the first where they lie."""
    view = View.of(camera, SIZE, 1e-3)
    at = (second["position"] - view.eye) @ view.rotation.T
    x, y = (at[..., i] / -at[..., 2] / view.half_size[i] for i in (0, 1))
    inside = (at[..., 2] < 0) & (np.abs(x) < 0.98) & (np.abs(y) < 0.98)
    column = ((x + 1) / 2 * SIZE[0]).astype(int).clip(0, SIZE[0] - 1)
    row = ((1 - y) / 2 * SIZE[1]).astype(int).clip(0, SIZE[1] - 1)
    same = inside & (np.linalg.norm(first["position"][row, column] - second["position"], axis=-1) < 0.1)
    return first["indirect"][row, column][same, 1].astype(np.float64), second["indirect"][same, 1].astype(np.float64)


def test_light_that_left_the_picture_stays() -> None:
    """A hall lit at one end, seen by a camera that turns to the other, and by one that has never seen the lit end."""
    scene, outputs = make_scene([HALL], [LIT]), ("indirect", "position", "direct")
    with Renderer(scene, settings(*outputs), find_model("ember")) as renderer:
        towards, turned = renderer.render(TOWARDS), renderer.render(AWAY)
    fresh = draw(scene, SIZE, outputs, AWAY, find_model("ember"))
    assert towards["direct"].max() > 0
    for name, away, most in (("turned", turned, 0.02), ("fresh", fresh, 0.10)):
        assert not away["direct"].any()
        with_light, without = compared(towards, TOWARDS, away)
        error = np.percentile(np.abs(without / with_light - 1), 95)
        print(f"OFF SCREEN {name}: mean {without.mean() / with_light.mean() - 1:+.2%}, p95 {error:.2%}")
        assert len(without) > 5000
        assert without.mean() == pytest.approx(with_light.mean(), rel=0.02)
        assert error < most
