"""Penumbras behind a straight edge against the share of the light that shows past it."""

from __future__ import annotations

import numpy as np
import pytest

from app.renderer import Renderer
from app.scene import Camera, DirectionalLight, Light, PointLight, RectLight, SpotLight
from app.settings import Settings
from tests.gl import closed_forms as exact
from tests.gl.closed_forms import F64
from tests.gl.scenes import draw, floor, make_scene, quad, visibility, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

HEIGHT = 2.0  # of the lights
SIZE = (192, 96)


def profile(light: Light, blocker: float, extent: float, seed: int = 0) -> tuple[F64, F64]:
    """Mean visibility [w] along x behind a half plane at height ``blocker`` that ends at x = 0, and points [w, 3].

    The camera looks straight down from below the blocker, so every column of the image has one x.
    """
    half_view = 1.4 * extent
    eye = 0.8 * blocker
    fov = 2 * np.degrees(np.arctan(half_view / eye * SIZE[1] / SIZE[0]))
    camera = Camera((0.0, eye, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), float(fov))
    half_plane = quad((-4.0, blocker, 4.0), (4.0, 0, 0), (0, 0, -8.0))
    share, at = visibility(make_scene([floor(4.0), half_plane], [light], camera), SIZE, camera)
    return share.mean(axis=0), at[SIZE[1] // 2]


def check(found: F64, reference: F64, x: F64) -> None:
    """Width within 15 %, in the right place, and no step."""
    got, want = exact.width(x, found), exact.width(x, reference)
    error = np.abs(found - reference)
    print(f"PENUMBRA width {got:.4f} of {want:.4f} ({got / want - 1:+.1%}), "
          f"largest error {error.max():.3f}, mean {error.mean():.4f}")
    assert got == pytest.approx(want, rel=0.15)
    assert error.max() < 0.12


@pytest.mark.parametrize("share", [0.15, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("radius", [0.05, 0.15, 0.3])
def test_sphere(radius: float, share: float) -> None:
    blocker = share * HEIGHT
    found, at = profile(PointLight((0.0, HEIGHT, 0.0), (1.0,) * 3, radius), blocker,
                        radius * share / (1 - share) + 0.01)
    check(found, exact.disc_behind_edge(at, np.array([0, HEIGHT, 0]), radius, 0.0, blocker), at[:, 0])


def test_the_quadrature_is_the_disc_profile() -> None:
    x = np.linspace(-0.1, 0.1, 201)
    reference = exact.disc_behind_edge(np.stack([x, 0 * x, 0 * x], -1), np.array([0, 2.0, 0]), 0.1, 0.0, 1.0)
    s = np.clip(x / 0.1, -1, 1)
    np.testing.assert_allclose(reference, 0.5 + (s * np.sqrt(1 - s * s) + np.arcsin(s)) / np.pi, atol=0.01)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("side", [0.2, 0.6])
def test_rectangle(side: float, share: float) -> None:
    blocker = share * HEIGHT
    light = RectLight((0.0, HEIGHT, 0.0), (side, 0, 0), (0, 0, side), (1.0,) * 3)
    found, at = profile(light, blocker, 0.5 * side * share / (1 - share) + 0.01)
    check(found, exact.rectangle_behind_edge(at, np.array([0, HEIGHT, 0]), side / 2, 0.0, blocker), at[:, 0])


@pytest.mark.parametrize("blocker", [0.3, 1.0])
@pytest.mark.parametrize("angular_radius", [1.0, 4.0])
def test_directional(angular_radius: float, blocker: float) -> None:
    radius = np.radians(angular_radius)
    found, at = profile(DirectionalLight((0.0, -1.0, 0.0), (1.0,) * 3, angular_radius), blocker,
                        blocker * np.tan(radius) + 0.005)
    check(found, exact.parallel_behind_edge(at, np.array([0, 1.0, 0]), radius, 0.0, blocker), at[:, 0])


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("outer", [40.0, 70.0])
def test_spot(outer: float, share: float) -> None:
    radius, blocker = 0.15, share * HEIGHT
    light = SpotLight((0.0, HEIGHT, 0.0), (0.0, -1.0, 0.0), (1.0,) * 3, 30.0, outer, radius)
    found, at = profile(light, blocker, radius * share / (1 - share) + 0.01)
    check(found, exact.disc_behind_edge(at, np.array([0, HEIGHT, 0]), radius, 0.0, blocker), at[:, 0])


SLITS = DirectionalLight((-0.3, -1.0, 0.0), (1.0,) * 3, 3.0), 0.06, 0.08
SLATS = DirectionalLight((-0.3, -1.0, 0.0), (1.0,) * 3, 3.0), 0.02, 0.1
NEAR_LAMP = PointLight((0.0, HEIGHT, 0.0), (1.0,) * 3, 0.06), 0.02, 0.03


@pytest.mark.parametrize(("frames", "rms"), [(1, 0.07), (16, 0.0135)])
@pytest.mark.parametrize(("light", "slat", "pitch"), [SLITS, SLATS, NEAR_LAMP], ids=["slits", "slats", "lamp"])
def test_what_is_thinner_than_a_penumbra_is_hardly_noisy(frames: int, rms: float, light: Light, slat: float,
                                                         pitch: float) -> None:
    """Taps that look for a penumbra's edge can all meet slats, or all miss them."""
    height = 0.8
    camera = Camera((0.0, 0.7, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 50.0)
    count = int(1.2 / pitch)
    slats = [quad((x, height, 2.0), (slat, 0, 0), (0, 0, -4.0)) for x in np.arange(-count, count + 1) * pitch]
    scene = make_scene([floor(4.0), *slats], [light], camera)
    with Renderer(scene, Settings(size=SIZE)) as renderer:
        for _ in range(frames):
            lit = renderer.render(camera)["final"][..., 1]
    share = lit / draw(without_shadows(scene), SIZE, camera=camera)["final"][..., 1]
    noise, excess = (share - share.mean(axis=0)).std(), share.mean() - (1 - slat / pitch)
    print(f"SLATS {frames} frames: rms {noise:.4f}, mean {excess:+.4f}")
    assert noise < rms
    assert abs(excess) < 0.018
