"""Light of any strength and number, in odd places, and none at all.

Rows "no light at all" and "grazing light, acne, peter-panning" of the table of hazards.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.gl.shadow_atlas import HARD_CUBE_TEXELS
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, DirectionalLight, Light, PointLight, RectLight, SpotLight
from app.settings import Settings
from tests.gl.scenes import box, draw, floor, make_scene, visibility, without_shadows
from tests.robustness.scenes import (
    CAMERA,
    HARD_LAMP,
    LAMP,
    RADIOSITY,
    SIZE,
    beyond,
    corner,
    lit_corner,
    shown,
)

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

PICTURES = ("final", "direct", "indirect")


def times(lamp: PointLight, factor: float) -> PointLight:
    return replace(lamp, intensity=tuple(c * factor for c in lamp.intensity))


@pytest.mark.usefixtures("coarse_shadows")
@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e3, 1e6])
def test_the_picture_is_linear_in_the_light(factor: float) -> None:
    """f(a x) = a f(x), but for what half precision rounds."""
    one, many = shown(lit_corner(LAMP), PICTURES), shown(lit_corner(times(LAMP, factor)), PICTURES)
    for name in PICTURES:
        assert one[name].max() > 0.01
        assert beyond(many[name] / np.float32(factor), one[name], 3e-3) == 0, name


@pytest.mark.usefixtures("coarse_shadows")
def test_the_default_network_is_linear_in_the_light() -> None:
    def lit(factor: float) -> dict[str, np.ndarray]:
        return draw(lit_corner(times(LAMP, factor)), SIZE, PICTURES, model=find_model("ember"))

    one = lit(1.0)
    for factor in (1e-4, 1e4):
        many = lit(factor)
        for name in PICTURES:
            found = many[name] / np.float32(factor)
            assert beyond(found, one[name], 1e-3) < 1e-3, name
            assert np.abs(found - one[name]).mean() < 5e-4 * one[name].mean(), name


@pytest.mark.usefixtures("coarse_shadows")
@pytest.mark.parametrize("factor", [256.0**-3, 256.0**2])
def test_the_picture_is_the_same_to_the_bit_at_another_power_of_256(factor: float) -> None:
    """The scale that keeps radiance in the middle of the half range takes such a factor up whole."""
    one, many = shown(lit_corner(LAMP), PICTURES), shown(lit_corner(times(LAMP, factor)), PICTURES)
    for name in PICTURES:
        np.testing.assert_array_equal(many[name], one[name] * np.float32(factor), name)


@pytest.mark.usefixtures("coarse_shadows")
@pytest.mark.parametrize("lights", [(), (PointLight(LAMP.position, (0.0, 0.0, 0.0), 0.05),)], ids=["none", "black"])
def test_without_light_the_picture_is_exactly_black(lights: tuple[Light, ...]) -> None:
    """Row "no light at all"; also after many frames of history."""
    scene = make_scene(corner(), lights, CAMERA)
    with Renderer(scene, Settings(size=SIZE, outputs=PICTURES, provider="cpu"), RADIOSITY) as renderer:
        for _ in range(4):
            images = renderer.render(CAMERA)
            for name in PICTURES:
                assert not images[name].any(), name
            assert not images["display"].any()


def forty_lights() -> list[Light]:
    """All kinds, all around, of all colours."""
    found: list[Light] = []
    for i in range(10):
        turn = 2 * np.pi * i / 10
        at = (1.2 * np.cos(turn), 0.8 + 0.1 * i, 1.2 * np.sin(turn))
        down = (-0.3 * np.cos(turn), -1.0, -0.3 * np.sin(turn))
        color = (0.1 + 0.02 * i, 0.2, 0.3 - 0.02 * i)
        found += [PointLight(at, color, 0.02 * (i % 3)), SpotLight(at, down, color, 20.0, 30.0 + 4 * i),
                  DirectionalLight(down, tuple(0.2 * c for c in color), 0.3 * (i % 2)),
                  RectLight(at, (0.2, 0.0, 0.0), (0.0, 0.0, 0.2), color)]
    return found


@pytest.mark.usefixtures("coarse_shadows")
def test_forty_lights_are_the_sum_of_forty_pictures() -> None:
    lights = forty_lights()
    scene = without_shadows(lit_corner())
    together = draw(scene.with_lights(*lights), SIZE, ("direct",))["direct"]
    alone = sum(draw(scene.with_lights(light), SIZE, ("direct",))["direct"].astype(np.float64) for light in lights)
    assert together.max() > 0.1
    assert beyond(together, alone, 2e-3) == 0


def test_forty_shadows_are_those_of_the_same_lights_alone() -> None:
    """Forty maps share one atlas, so each has fewer texels: only the edges of shadows may differ."""
    lights = forty_lights()
    scene = lit_corner()
    together = draw(scene.with_lights(*lights), SIZE, ("direct",))["direct"]
    fives = sum(draw(scene.with_lights(*lights[i::8]), SIZE, ("direct",))["direct"].astype(np.float64)
                for i in range(8))
    assert beyond(together, fives, 0.02) < 0.02
    assert together.mean() == pytest.approx(fives.mean(), rel=5e-3)


BROKEN: tuple[Light, ...] = (
    PointLight(LAMP.position, (np.nan, 1.0, 1.0)), PointLight(LAMP.position, (1.0, np.inf, 1.0), 0.05),
    PointLight((np.nan, 1.0, 0.0), (1.0, 1.0, 1.0)), PointLight(LAMP.position, (1.0, 1.0, 1.0), np.nan),
    PointLight((0.0, np.inf, 0.0), (1.0, 1.0, 1.0)), PointLight(LAMP.position, (-1.0, -1.0, -1.0)),
    SpotLight((0.0, 1.0, 0.0), (np.nan, 0.0, 0.0), (1.0, 1.0, 1.0), 10.0, 20.0),
    DirectionalLight((0.0, -1.0, 0.0), (np.nan, np.nan, np.nan)),
    RectLight((0.0, 1.5, 0.0), (np.nan, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)),
)


@pytest.mark.usefixtures("coarse_shadows")
def test_lights_with_broken_numbers_send_nothing() -> None:
    """What the sound light shows stays, but for the rounding of another shader."""
    expected = draw(lit_corner(HARD_LAMP), SIZE, ("direct",))["direct"]
    for broken in BROKEN:
        found = draw(lit_corner(broken, HARD_LAMP), SIZE, ("direct",))["direct"]
        assert beyond(found, expected, 1e-3) == 0, broken


@pytest.mark.usefixtures("coarse_shadows")
def test_a_light_with_a_broken_number_does_not_change_the_whole_picture() -> None:
    found, expected = shown(lit_corner(HARD_LAMP, BROKEN[0]), PICTURES), shown(lit_corner(HARD_LAMP), PICTURES)
    for name in PICTURES:
        assert beyond(found[name], expected[name], 2e-3) == 0, name


def test_a_light_inside_an_object_lights_nothing_outside() -> None:
    scene = lit_corner(PointLight((-0.05, 0.3, 0.0), (1.0, 1.0, 1.0)))
    images = draw(scene, SIZE, ("direct", "depth"))
    assert (images["depth"] > 0).mean() > 0.5
    assert not images["direct"].any()


def test_a_light_inside_a_wall_lights_neither_side() -> None:
    slab = box((-1.5, 0.0, -0.55), (3.0, 1.0, 0.1))
    inside = PointLight((0.0, 0.5, -0.5), (1.0, 1.0, 1.0))
    for eye in ((0.0, 0.8, 2.0), (0.0, 0.8, -3.0)):
        images = draw(make_scene([slab], [inside]), SIZE, ("direct", "depth"), Camera(eye, (0.0, 0.5, 0.0)))
        assert (images["depth"] > 0).mean() > 0.3
        assert not images["direct"].any()


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_a_light_inside_a_room_lights_only_the_room(radius: float) -> None:
    """Outside of the closed room nothing is lit; inside everything is."""
    lamp = PointLight((0.3, 0.6, 0.1), (1.0,) * 3, radius)
    scene = make_scene([box((-1, 0, -1), (2, 1, 2)), floor(3.0, -0.2)], [lamp])
    outside = draw(scene, SIZE, ("direct", "depth"), Camera((0.0, 2.5, 4.0), (0.0, 0.3, 0.0)))
    assert (outside["depth"] > 0).mean() > 0.3
    assert not outside["direct"].any()
    inside = draw(scene, SIZE, ("direct",), Camera((-0.8, 0.5, 0.8), (0.5, 0.4, -0.5)))["direct"]
    assert inside.min() > 0.005


@pytest.mark.parametrize(("light", "texel"), [
    (HARD_LAMP, 2 / HARD_CUBE_TEXELS * 2.2), (DirectionalLight((-0.3, -1.0, -0.2), (1.0,) * 3), 2 * 0.87 / 4096),
    (PointLight((0.0, 1.5, 0.0), (1.0,) * 3, 0.3), 0.0), (PointLight((0.5, 1.5, 0.8), (1.0,) * 3, 0.3), 0.0),
], ids=["point", "sun", "sphere", "sphere in a plane"])
def test_no_light_comes_into_a_closed_box(light: Light, texel: float) -> None:
    """Its inside, seen from within, is exactly black, but for two texels of the map along its edges."""
    scene = make_scene([box((-0.5, -0.5, -0.5), (1, 1, 1))], [light])
    for target in ((0.0, 0.1, -3.0), (3.0, 0.1, 0.0), (0.0, 3.0, 0.01), (0.0, -3.0, 0.01), (-3.0, 0.0, 3.0)):
        images = draw(scene, SIZE, ("direct", "position"), Camera((0.0, 0.1, 0.0), target, fov_y_deg=80.0))
        to_edge = np.sort(0.5 - np.abs(images["position"]), axis=-1)[..., 1]
        assert not images["direct"][to_edge > 2 * texel].any()


@pytest.mark.parametrize("light", [
    DirectionalLight((0.9998, -0.01745, 0.0), (1.0,) * 3), PointLight((3.0, 0.0524, 0.0), (1.0,) * 3),
    PointLight((3.0, 0.0524, 0.0), (1.0,) * 3, 0.02),
], ids=["sun", "point", "sphere"])
def test_a_plane_at_89_degrees_is_lit_without_acne(light: Light) -> None:
    """Row "grazing light": no texel of a bare plane is in shadow."""
    share, _ = visibility(make_scene([floor(1.5)], [light]), SIZE, Camera((0.0, 2.0, 2.0), (0.0, 0.0, 0.0)))
    assert (share < 0.98).sum() == 0


def test_a_box_stands_on_its_shadow() -> None:
    """Row "peter-panning": on the dark side the floor is in shadow up to the box, but for three texels of the map."""
    lamp = PointLight((-3.0, 2.0, 0.0), (1.0,) * 3)
    scene = make_scene([floor(2.0), box((-0.5, 0.0, -0.5), (1.0, 0.5, 1.0))], [lamp])
    share, at = visibility(scene, (128, 96), Camera((1.3, 0.6, 0.0), (0.5, 0.0, 0.0), fov_y_deg=40.0))
    texel = 2 / HARD_CUBE_TEXELS * 4
    beside = ((np.abs(at[..., 1]) < 1e-4) & (np.abs(at[..., 2]) < 0.4) & (at[..., 0] > 0.5 + 3 * texel)
              & (at[..., 0] < 0.9))
    assert beside.sum() > 500
    assert (share[beside] > 0.02).sum() == 0
