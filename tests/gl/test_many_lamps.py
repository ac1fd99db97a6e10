"""Scenes with more lamps than shadow maps: their shadows are traced, and look as with maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import app.renderer
from app.raycast.light_extent import MAX_HARD_MAPS, MAX_SOFT_MAPS
from app.renderer import Renderer
from app.scene import Camera, Light, Material, PointLight, RectLight, Scene, SpotLight, Transmission
from app.settings import Settings
from tests.gl.scenes import F32, GREY, Images, box, draw, floor, make_scene, quad

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (128, 96)
POLISHED = Material(albedo=(0.3,) * 3, roughness=0.2, specular=(0.2,) * 3)
WHITE = (1.0,) * 3
FRAMES = 12


def settled(scene: Scene, camera: Camera, *outputs: str, rays: str = "auto") -> tuple[Images, int]:
    """The images after some frames at rest, and how many lights have shadow maps."""
    with Renderer(scene, Settings(SIZE, outputs, provider="cpu", rays=rays)) as renderer:
        for _ in range(FRAMES):
            images = renderer.render(camera)
        return {name: image.copy() for name, image in images.items()}, len(renderer._lights.mapped)


def both(scene: Scene, camera: Camera, monkeypatch: pytest.MonkeyPatch, *outputs: str) -> tuple[Images, Images]:
    """With traced shadows, and with maps for all lights."""
    traced, mapped_count = settled(scene, camera, *outputs)
    assert mapped_count == 0
    monkeypatch.setattr(app.renderer, "needs_rays", lambda lights, *_: (False,) * len(lights))
    return traced, settled(scene, camera, *outputs)[0]


def lamps(kind: str, x: float, height: float, count: int) -> list[Light]:
    """Small ones side by side, of the same power for any ``count``."""
    places = [(x + 0.1 * (k - (count - 1) / 2), height, 0.0) for k in range(count)]
    light = (3.0 / count,) * 3
    if kind == "spots":
        return [SpotLight(place, (0.0, -1.0, 0.0), light, 40.0, 60.0) for place in places]
    return [PointLight(place, light, 0.0 if kind == "points" else 0.02) for place in places]


@pytest.mark.parametrize("kind", ["points", "spots", "spheres"])
@pytest.mark.parametrize("panel", [False, True])
def test_the_next_room_has_its_highlights_alone(kind: str, panel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lamps behind a wall, whose highlights would be on this side of it, light nothing here, also beside a panel."""
    count = (MAX_SOFT_MAPS if kind == "spheres" else MAX_HARD_MAPS) + 1
    wall = box((-0.05, 0, -2), (0.1, 2.5, 4))
    ceiling = quad((-3, 2.5, -2), (6, 0, 0), (0, 0, 4))
    hidden = [replace(lamp, intensity=(20.0,) * 3) for lamp in lamps(kind, 1.0, 2.0, count)]  # type: ignore[call-arg]
    lights = [*lamps(kind, -1.0, 2.2, count), *hidden]
    if panel:
        lights.append(RectLight((-2.0, 2.4, 0.0), (0.5, 0, 0), (0, 0, 0.5), (2.0,) * 3))
    camera = Camera((-2.6, 1.5, 0.0), (-1.5, 0.0, 0.0))
    scene = make_scene([floor(3.0, material=POLISHED), wall, ceiling], lights)
    traced, mapped = both(scene, camera, monkeypatch, "specular", "direct", "position")
    on_floor = (np.abs(mapped["position"][..., 1]) < 1e-3) & (mapped["position"][..., 0] < -0.2)
    if panel:  # whose own highlights a map of its centre does not have exactly
        assert traced["specular"][on_floor].max() < 1.3 * mapped["specular"][on_floor].max()
        return
    error = np.abs(traced["specular"] - mapped["specular"])[on_floor]
    peak = mapped["specular"][on_floor].max()
    print(f"ROOMS {kind}: highlights {error.max() / peak:.3f} of the brightest off at most")
    assert error.max() < 0.1 * peak


@pytest.mark.parametrize("kind", ["points", "spots", "spheres"])
def test_shadows_are_where_those_of_maps_are(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    count = (MAX_SOFT_MAPS if kind == "spheres" else MAX_HARD_MAPS) + 1
    scene = make_scene([floor(2.0), box((-0.3, 0.4, -0.3), (0.6, 0.1, 0.6))], lamps(kind, 0.0, 2.0, count))
    traced, mapped = both(scene, Camera((0.0, 3.0, 2.5), (0, 0, 0)), monkeypatch, "direct")
    error = np.abs(traced["direct"] - mapped["direct"])[..., 1] / mapped["direct"][..., 1].max()
    print(f"SHADOWS {kind}: {error.mean():.4f} off on the mean, {np.quantile(error, 0.95):.4f} at 95 %")
    assert error.mean() < 0.002 and np.quantile(error, 0.95) < 0.01


def test_traced_light_is_tinted_by_glass() -> None:
    """A large lamp through a red pane; each channel as dim as the pane lets it be."""
    def light_below(*panes: Material) -> F32:
        parts = [floor(2.0, material=GREY), *(quad((-1.5, 1.0, 1.5), (3.0, 0, 0), (0, 0, -3.0), m) for m in panes)]
        scene = make_scene(parts, [PointLight((0.0, 2.0, 0.0), WHITE, 0.4)])
        images, mapped_count = settled(scene, Camera((1.8, 0.6, 0.0), (0.0, 0.0, 0.0)), "direct", "position")
        near = np.linalg.norm(images["position"], axis=-1) < 0.5
        assert mapped_count == 0
        return np.asarray(images["direct"][near & (images["position"][..., 1] < 1e-3)].mean(axis=0))

    red = Material(albedo=(1.0, 0.1, 0.2), transmission=Transmission(factor=1.0), roughness=0.0)
    np.testing.assert_allclose(light_below(red) / light_below(), red.passing, rtol=0.03)
    black = replace(red, albedo=(0.0, 0.0, 0.0), alpha=0.25, is_blended=True)  # what it doesn't cover has no tint
    np.testing.assert_allclose(light_below(black) / light_below(), 0.75, rtol=0.03)


def test_cpu_and_gpu_trace_the_same_highlights() -> None:
    scene = make_scene([floor(2.0, material=POLISHED), box((-0.3, 0.2, -0.3), (0.6, 0.1, 0.6))],
                       lamps("spheres", 0.0, 2.0, MAX_SOFT_MAPS + 1))
    camera = Camera((0.0, 1.5, 2.5), (0, 0, 0))
    cpu, gpu = (settled(scene, camera, "specular", rays=rays)[0]["specular"] for rays in ("cpu", "gpu"))
    np.testing.assert_allclose(gpu, cpu, atol=2e-3 * float(cpu.max()))
    assert draw(scene, SIZE, ("specular",), camera)["specular"].max() > 0
