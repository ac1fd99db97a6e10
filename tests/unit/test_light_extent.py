"""Which lights' shadows are traced: those that are large for their distance from what they light."""

from __future__ import annotations

import pytest

from app.raycast.caster import Caster
from app.raycast.light_extent import MAX_HARD_MAPS, MAX_SOFT_MAPS, needs_rays
from app.scene import DirectionalLight, Light, PointLight, RectLight, SpotLight
from tests.gl.scenes import Part, box, floor, make_scene, quad, slide

DOWN = (0.0, -1.0, 0.0)
WHITE = (1.0,) * 3


def all_traced(lights: list[Light], *parts: Part) -> tuple[bool, ...]:
    scene = make_scene(parts or (floor(2.0),), lights)
    return needs_rays(scene.lights, (), lambda: Caster(scene), scene.key_times)


def traced(light: Light, *parts: Part) -> bool:
    return all_traced([light], *parts)[0]


def pane(height: float, side: float) -> RectLight:
    return RectLight((0.0, height, 0.0), (side, 0, 0), (0, 0, side), WHITE)


@pytest.mark.parametrize(("light", "expected"), [
    (PointLight((0, 2, 0), WHITE), False), (SpotLight((0, 2, 0), DOWN, WHITE, 20, 30), False),
    (DirectionalLight(DOWN, WHITE, 5.0), False),
    (PointLight((0, 2, 0), WHITE, 0.05), False), (PointLight((0, 2, 0), WHITE, 0.5), True),
    (SpotLight((0, 2, 0), DOWN, WHITE, 20, 30, 0.05), False), (SpotLight((0, 2, 0), DOWN, WHITE, 20, 30, 0.2), True),
    (pane(2.0, 0.1), False), (pane(2.0, 1.0), True), (pane(20.0, 1.0), False),
], ids=str)
def test_size_against_distance_decides(light: Light, expected: bool) -> None:
    assert traced(light) is expected


def test_only_what_the_light_can_reach_counts() -> None:
    """A shelf just behind a pane, and one right above it but hidden from it, take no light from it."""
    light = RectLight((0.0, 4.0, 0.0), (0.2, 0, 0), (0, 0, 0.2), WHITE)  # shines down
    behind = quad((-0.5, 4.01, 0.5), (1, 0, 0), (0, 0, -1))
    assert not traced(light, floor(1.0), behind)
    assert traced(light, floor(1.0), quad((-0.5, 3.9, 0.5), (1, 0, 0), (0, 0, -1)))


def test_what_comes_near_later_counts() -> None:
    light = PointLight((0.0, 2.0, 0.0), WHITE, 0.05)
    part = box((-0.5, 0, -0.5), (1, 0.1, 1), motion=slide((0.0, 1.0), [(0, 0, 0), (0, 1.8, 0)]))
    assert traced(light, part)
    assert not traced(light, box((-0.5, 0, -0.5), (1, 0.1, 1)))


def test_a_light_whose_centre_nothing_sees_is_traced() -> None:
    assert traced(PointLight((0.0, 2.0, 0.0), WHITE, 0.05), floor(1.0), box((-0.01, 1.99, -0.01), (0.02,) * 3))


SUN = DirectionalLight(DOWN, WHITE, 5.0)


@pytest.mark.parametrize(("radius", "most"), [(0.05, MAX_SOFT_MAPS), (0.0, MAX_HARD_MAPS)])
def test_too_many_lights_for_maps_are_traced(radius: float, most: int) -> None:
    lamps: list[Light] = [PointLight((0.1 * k, 2, 0), WHITE, radius) for k in range(most + 1)]
    assert not any(all_traced([*lamps[:-1], SUN]))
    assert all_traced([*lamps, SUN]) == (True,) * len(lamps) + (False,)


def test_lights_that_are_traced_anyway_are_not_too_many() -> None:
    large: list[Light] = [PointLight((0, 2, 0.1 * k), WHITE, 0.5) for k in range(5)]
    small: list[Light] = [PointLight((0.1 * k, 2, 0), WHITE, 0.05) for k in range(MAX_SOFT_MAPS)]
    assert all_traced([*large, *small]) == (True,) * len(large) + (False,) * len(small)


def test_many_points_leave_a_small_lamp_its_map() -> None:
    points: list[Light] = [PointLight((0.1 * k, 2, 0), WHITE) for k in range(MAX_HARD_MAPS + 1)]
    assert all_traced([PointLight((0, 2, 0.5), WHITE, 0.05), *points]) == (False,) + (True,) * len(points)


def test_lights_that_send_none_are_not_too_many() -> None:
    dark: list[Light] = [PointLight((0.1 * k, 2, 0), color) for k in range(MAX_HARD_MAPS)
                         for color in ((0.0,) * 3, (float("nan"),) * 3)]
    assert not any(all_traced([PointLight((0, 2, 0.5), WHITE), *dark]))
