"""Near cascades: fine shadows of the sun around the eye in scenes that are much larger."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from app.arrays import Bools
from app.gl.near_cascade import CASCADE_TEXELS, cascade_around
from app.network.selection import find_model
from app.raycast.caster import Caster
from app.raycast.near_distance import NearDistance
from app.renderer import Renderer
from app.scene import Camera, DirectionalLight, Material, Transmission
from app.settings import Settings
from tests.gl.scenes import box, floor, make_scene, quad, visibility

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (128, 96)
GARDEN = box((-60.0, -0.5, -60.0), (120.0, 0.5, 120.0))  # no floor that its map leaves out
CAMERA = Camera((0.0, 1.6, 2.0), (0.0, 0.0, 0.0), fov_y_deg=50.0)
WHOLE_TEXEL = 120 * np.sqrt(2) * 1.01 / 4096


def sun(radius_deg: float = 0.0) -> DirectionalLight:
    return DirectionalLight((0.5, -1.0, 0.2), (1.0,) * 3, radius_deg)


@pytest.mark.parametrize("half", [200.0, 2000.0])
@pytest.mark.parametrize("eye_height", [0.5, 1.6])
def test_near_is_what_half_of_the_solid_angle_lies_in(eye_height: float, half: float) -> None:
    """Of a wide floor, 1 - height / distance of the lower half space lies nearer."""
    near = NearDistance(lambda: Caster(make_scene([floor(half)])))
    assert near(np.array([1.0, eye_height, 2.0])) == pytest.approx(2 * eye_height, rel=0.05)


@pytest.mark.parametrize("eye", [(1.0, -1.0, 50.0), (math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), (1e300, 0.0, 0.0)])
def test_nothing_is_near(eye: tuple[float, float, float]) -> None:
    wall = quad((0.0, 0.0, 0.0), (1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0))
    assert NearDistance(lambda: Caster(make_scene([wall])))(np.array(eye)) == math.inf


def test_a_room_alone_needs_no_cascade() -> None:
    assert cascade_around(np.zeros(2), 5.0, 1.5) is None
    assert cascade_around(np.zeros(2), 5.0, np.inf) is None
    assert cascade_around(np.zeros(2), np.nan, 1.0) is None
    assert cascade_around(np.array([np.nan, 0.0]), 80.0, 1.0) is None


@pytest.mark.parametrize("near", [0.0, 1e-9, 0.5, 2.0, 8.0])
def test_a_cascade_surrounds_the_eye(near: float) -> None:
    for eye in np.random.default_rng(0).uniform(-60.0, 60.0, (50, 2)):
        cascade = cascade_around(eye, 80.0, near)
        assert cascade is not None and 0.01 < cascade.half <= 40.0
        assert np.abs(eye - cascade.center).max() <= cascade.half / 8 + 1e-9


def test_a_cascade_balances_both_maps() -> None:
    """Its texels at what is near are about as coarse for what they show as those of the whole map at its edge."""
    cascade = cascade_around(np.zeros(2), 80.0, 2.0)
    assert cascade is not None
    own, whole = cascade.half / CASCADE_TEXELS / 2.0, 80.0 / 4096 / cascade.half
    assert 0.4 < own / whole < 2.5


@pytest.mark.parametrize("radius_deg", [0.0, 0.27])
def test_a_bar_thinner_than_a_texel_of_the_whole_map_casts_its_shadow(radius_deg: float) -> None:
    """As it does amid a garden whose own map has texels as small as the cascade's."""
    bar = box((-0.5, 0.2, -0.01), (1.0, 0.02, 0.02))
    camera = Camera((0.0, 1.0, 0.7), (0.0, 0.0, 0.0), fov_y_deg=50.0)
    small, amid = (visibility(make_scene([ground, bar], [sun(radius_deg)]), (256, 192), camera)[0]
                   for ground in (box((-15.0, -0.5, -15.0), (30.0, 0.5, 30.0)), GARDEN))
    error = np.abs(small - amid).mean()
    print(f"CASCADE {radius_deg}: darkest {amid.min():.3f}, {error:.5f} from a small garden's")  # without: 0.013, 0.016
    assert WHOLE_TEXEL > 0.04 and amid.min() < 0.1 and error < 4e-3


@pytest.mark.parametrize("radius_deg", [0.0, 0.27])
def test_a_shadow_goes_on_where_a_cascade_ends(radius_deg: float) -> None:
    """A long wall's shadow begins and ends where rays say, but for two texels of the whole map, on both sides."""
    low, high = np.array([-20.0, 0.0, -1.0]), np.array([40.0, 1.0, -0.7])
    scene = make_scene([GARDEN, box(tuple(low), tuple(high - low))], [sun(radius_deg)])
    camera, size = Camera((0.0, 2.5, 0.5), (14.0, 0.0, -0.5), fov_y_deg=20.0), (256, 192)
    with Renderer(scene, Settings(size, outputs=("direct",), taa=False)) as renderer:
        renderer.render(camera)
        cascade = renderer._lights.cascades[0]
    share, at = visibility(scene, size, camera)
    on_ground = (np.abs(at[..., 1]) < 1e-3) & (np.abs(at[..., 2] - high[2]) > 1e-3)
    away = np.abs(at[..., 0])[on_ground]
    assert cascade is not None and 0.5 * cascade.half < np.median(away) and away.max() > 2 * cascade.half

    def is_lit(shift: float) -> Bools:
        """By a ray from the ground, moved along z, to the sun."""
        with np.errstate(divide="ignore"):
            ends = np.stack([(edge - at - (0.0, 0.0, shift)) / -np.array(sun().direction) for edge in (low, high)])
        return np.asarray(ends.min(axis=0).max(axis=-1) > ends.max(axis=0).min(axis=-1))

    lit = [is_lit(shift) for shift in (-2 * WHOLE_TEXEL, 0.0, 2 * WHOLE_TEXEL)]
    wrong = on_ground & ((np.all(lit, axis=0) & (share < 0.5)) | (~np.any(lit, axis=0) & (share > 0.5)))
    print(f"CASCADE edge {radius_deg}: {wrong.sum()} of {on_ground.sum()} texels")
    assert wrong.sum() == 0


def test_a_cascade_is_drawn_again_in_steps_and_leaves_all_else() -> None:
    """Small movements of the eye change no map, and no movement light that does not depend on it."""
    with Renderer(make_scene([GARDEN, box((-0.5, 0.0, -0.5), (1.0, 1.0, 1.0))], [sun(0.27)]),
                  Settings(SIZE, outputs=("final",)), find_model("ember")) as renderer:
        renderer.place_surfels([CAMERA])
        seen = []
        for x in (0.3, 0.4, 40.0):
            renderer.render(replace(CAMERA, eye=(x, 1.6, 2.0), target=(x, 0.0, 0.0)))
            seen.append((renderer._lights.cascades, renderer.resource("shadow"), renderer.resource("surfel_light")))
    assert seen[0][0] == seen[1][0] != seen[2][0]
    np.testing.assert_array_equal(seen[0][1], seen[1][1])
    assert (seen[0][1] != seen[2][1]).any()
    assert seen[0][2] is seen[1][2] is seen[2][2]


def test_a_cascade_that_becomes_needed_changes_nothing_else() -> None:
    """Walking into a garden from far above gives the same picture as beginning there."""
    scene = make_scene([GARDEN, box((-0.5, 0.2, -0.01), (1.0, 0.02, 0.02))], [sun()])
    above = Camera((0.0, 150.0, 1.0), (0.0, 0.0, 0.0), fov_y_deg=50.0)
    settings = Settings(SIZE, outputs=("direct", "final"), taa=False)
    with Renderer(scene, settings) as renderer:
        begin = renderer.render(above)
        assert renderer._lights.cascades == (None,)
        whole = renderer.resource("shadow").shape
        walked = renderer.render(CAMERA)
        assert renderer.resource("shadow").shape > whole
        again = renderer.render(above)
        back = renderer.render(CAMERA)
    with Renderer(scene, settings) as renderer:
        first = renderer.render(CAMERA)
    for name in first:
        np.testing.assert_array_equal(again[name], begin[name])
        np.testing.assert_array_equal(walked[name], first[name])
        np.testing.assert_array_equal(back[name], first[name])


@pytest.mark.parametrize("taa", [False, True])
def test_the_projection_may_change_after_a_cascade_appeared(taa: bool) -> None:
    scene = make_scene([GARDEN, box((-0.5, 0.0, -0.5), (1.0, 1.0, 1.0))], [sun()])
    parallel = replace(CAMERA, orthographic_height=3.0)
    with Renderer(scene, Settings(SIZE, outputs=("direct", "final"), taa=taa)) as renderer:
        renderer.render(CAMERA)
        changed = renderer.render(parallel)["direct"]
        renderer.render(CAMERA)
    with Renderer(scene, Settings(SIZE, outputs=("direct", "final"), taa=taa)) as renderer:
        np.testing.assert_array_equal(renderer.render(parallel)["direct"], changed)


def test_without_a_cascade_its_shader_reads_the_whole_map() -> None:
    """Also where the low sun of a large radius reaches a floor that its map leaves out, and glass tints its light."""
    pane = quad((5.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0), Material(transmission=Transmission(factor=1.0)))
    low = DirectionalLight((1.0, -np.tan(np.radians(5.0)), 0.0), (1.0,) * 3, 10.0)
    boxes = [box((x, 0.0, z), (0.4, 0.4, 0.4)) for x in (-20.0, 0.0, 20.0) for z in (-20.0, 0.0, 20.0)]
    scene = make_scene([floor(300.0), pane, *boxes], [low])
    above = Camera((-250.0, 60.0, 1.0), (-200.0, 0.0, 0.0), fov_y_deg=80.0)
    with Renderer(scene, Settings(SIZE, outputs=("direct",), taa=False)) as renderer:
        before = renderer.render(above)["direct"]
        renderer.render(Camera((0.5, 0.3, 1.0), (0.0, 0.1, 0.0)))
        assert any(renderer._lights.cascades)
        np.testing.assert_array_equal(renderer.render(above)["direct"], before)


def test_another_sun_keeps_the_cascade() -> None:
    scene = make_scene([GARDEN, box((-0.5, 0.2, -0.01), (1.0, 0.02, 0.02))], [sun()])
    low = DirectionalLight((1.0, -0.3, 0.2), (1.0,) * 3)
    settings = Settings(SIZE, outputs=("direct",), taa=False)
    with Renderer(scene, settings) as renderer:
        renderer.render(CAMERA)
        assert renderer.relight((low,))
        relit = renderer.render(CAMERA)["direct"]
    with Renderer(replace(scene, lights=(low,)), settings) as renderer:
        np.testing.assert_array_equal(renderer.render(CAMERA)["direct"], relit)
