"""The bundled networks through rendered views: form factors, closed boxes, energy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.math3d import CUBE_FACES
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, Material, PointLight, Scene
from app.settings import Settings
from tests.gl.closed_forms import polygon_irradiance
from tests.gl.scenes import Point, box, draw, floor, make_scene, quad
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIDE = 20.0
SIZE = (256, 192)  # a network sees 64x48
VIEW = 128  # pixels a side of the six views
WALLS = Settings(size=(VIEW, VIEW), outputs=("indirect", "position", "normal"), taa=False, provider="cpu")


@pytest.mark.parametrize(("eye", "target", "fov", "corner"), [
    pytest.param((10, 10, 10), (10, 10, 0), 90, (0, 0), id="facing"),
    pytest.param((10, 10, 15), (10, 10, 0), 80, (0, 0), id="close to the sender"),
    pytest.param((5, 7, 10), (10, 10, 0), 90, (0, 0), id="off centre"),
    pytest.param((0, 0, 10), (10, 10, 0), 60, (0, 0), id="across a cube corner"),
    pytest.param((0, 0, 10), (10, 10, 0), 60, (-10, -10), id="around a cube corner"),
])
def test_gather_agrees_with_parallel_squares(eye: Point, target: Point, fov: float,
                                             corner: tuple[float, float]) -> None:
    """What a square sees of another that shines with radiance 1 is the form factor from each of its points."""
    sender = quad((*corner, SIDE), (0, SIDE, 0), (SIDE, 0, 0), Material(albedo=(0.0,) * 3, emission=(1.0,) * 3))
    receiver = quad((0, 0, 0), (SIDE, 0, 0), (0, SIDE, 0))
    images = draw(make_scene([receiver, sender]), SIZE, ("indirect", "position", "depth"),
                  Camera(eye, target, fov_y_deg=fov), find_model("gather"))
    on = (images["depth"][..., 0] > 0) & (np.abs(images["position"][..., 2]) < 1e-3)
    at = images["position"][on].astype(np.float64)
    corners = np.array([(*corner, SIDE), (corner[0] + SIDE, corner[1], SIDE),
                        (corner[0] + SIDE, corner[1] + SIDE, SIDE), (corner[0], corner[1] + SIDE, SIDE)])
    reference = polygon_irradiance(at, (0, 0, 1), corners) / np.pi
    found = images["indirect"][on][:, 1]
    error = np.abs(found / reference - 1)
    print(f"SQUARES mean {found.mean() / reference.mean() - 1:+.2%}, p90 {np.percentile(error, 90):.2%}, "
          f"max {error.max():.2%}")
    assert on.mean() > 0.3
    assert found.mean() == pytest.approx(reference.mean(), rel=0.05)
    assert np.percentile(error, 90) < 0.05


@pytest.mark.parametrize("rho", [0.2, 0.5, 0.8])
@pytest.mark.parametrize(("eye", "target"), [((20, 15, 35), (20, 15, 0)), ((20, 15, 20), (0, 9, 3))])
def test_a_glowing_closed_box_is_uniform(eye: Point, target: Point, rho: float) -> None:
    """Every surface emits 1 and reflects ρ: the radiance is 1 / (1 − ρ) everywhere, whatever the shape."""
    walls = box((0, 0, 0), (40, 30, 40), Material(albedo=(rho,) * 3, emission=(1.0,) * 3))
    for name, reference in (("gather", 1.0), ("radiosity", 1 / (1 - rho))):
        found = draw(make_scene([walls]), SIZE, ("indirect",), Camera(eye, target, fov_y_deg=60),
                     find_model(name))["indirect"]
        print(f"BOX {name} {rho}: mean {found.mean() / reference - 1:+.2%}, "
              f"max {found.max() / reference - 1:+.2%}, min {found.min() / reference - 1:+.2%}")
        assert found.mean() == pytest.approx(reference, rel=0.10)
        assert found.max() <= reference * 1.001  # half floats


@pytest.mark.parametrize("rho", [0.3, 0.8])
@pytest.mark.parametrize(("lamp", "eye"), [((20, 20, 20), (20, 20, 20)), ((20, 30, 20), (12, 14, 28))])
def test_a_lamp_in_a_closed_box_keeps_its_energy(rho: float, lamp: Point, eye: Point) -> None:
    """All flux lands on the walls, so their mean indirect radiance is flux / (π area) times ρ / (1 − ρ), or times ρ."""
    scene = make_scene([box((0, 0, 0), (40, 40, 40), Material(albedo=(rho,) * 3))],
                       [PointLight(lamp, (100.0, 100.0, 100.0))])
    mean = 4 * np.pi * 100 / (6 * 40**2) / np.pi
    for name, reference in (("gather", mean * rho), ("radiosity", mean * rho / (1 - rho))):
        share = mean_over_walls(scene, eye, find_model(name)) / reference
        print(f"LAMP {name} {rho}: {share - 1:+.2%}")
        assert share == pytest.approx(1, rel=0.10)
        assert share <= 1.01  # quadrature; energy itself is bounded


def mean_over_walls(scene: Scene, eye: Point, model: Path) -> float:
    """Mean of ``indirect`` over all surfaces."""
    with Renderer(scene, WALLS, model) as renderer:
        return mean_around(renderer, eye)


def mean_around(renderer: Renderer, eye: Point) -> float:
    """The same of a renderer with the settings ``WALLS``, by six views of 90° that cover all directions."""
    at = 2 * (np.arange(VIEW) + 0.5) / VIEW - 1
    solid_angle = (2 / VIEW) ** 2 / (1 + at[:, None] ** 2 + at[None, :] ** 2) ** 1.5
    total = area = 0.0
    for forward, up in CUBE_FACES:
        view = renderer.render(Camera(eye, tuple(np.asarray(eye) + forward), tuple(up), 90.0))
        to = view["position"] - np.asarray(eye)
        r2 = (to * to).sum(-1)
        texel = solid_angle * r2**1.5 / np.maximum(-(to * view["normal"]).sum(-1), 1e-9)
        total += (texel * view["indirect"][..., 1]).sum()
        area += texel.sum()
    return total / area


@pytest.mark.parametrize("taa", [True, False])
def test_a_wire_before_the_sky_is_lit_like_what_surrounds_it(taa: bool) -> None:
    """One pixel wide, it lies between the texels that a network sees, so that all of those show the sky."""
    wire = quad((0.02, 0, -10), (0.07, 0, 0), (0, 9, 0))
    camera = Camera((0, 0, 0), (0, 0, -1), fov_y_deg=90)
    scene = make_scene([floor(100.0, y=-3.0), wire], camera=camera)
    settings = Settings(size=(256, 192), outputs=("indirect", "depth"), taa=taa, provider="cpu")
    inferred = np.where(np.arange(48)[:, None, None] > 24, 0.5, 9.0)  # 9: the sky's, which means nothing
    with Renderer(scene, settings, find_model("gather")) as renderer:
        override(renderer, "indirect_now" if taa else "indirect_low", inferred)
        images = renderer.render(camera)
    seen, found = images["depth"][..., 0] > 0, images["indirect"]
    assert seen[:90].any(axis=0).sum() == 1
    np.testing.assert_allclose(found[:90][seen[:90]], 0.5, rtol=1e-3)
    np.testing.assert_allclose(found[104:], 0.5, rtol=1e-3)
    assert not found[~seen].any()
