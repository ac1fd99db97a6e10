"""Shadows where they go wrong: grazing light, contact, seams of the six-face map, masks, emitters."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from app.gl.shadow_atlas import (
    CASCADE_TEXELS,
    CUBE_MAP,
    FACE_TEXELS,
    HARD_CUBE_TEXELS,
    PARALLEL_MAP,
    SINGLE_MAP,
    Tile,
    lay_out,
    map_kind,
)
from app.raycast.caster import Caster
from app.renderer import Renderer
from app.scene import Camera, DirectionalLight, Light, Material, PointLight, RectLight, Scene, SpotLight, Texture
from app.settings import Settings
from tests.coarse_shadows import coarse_shadow_maps
from tests.gl import closed_forms as exact
from tests.gl.closed_forms import F64
from tests.gl.scenes import GREY, Part, box, draw, floor, make_scene, quad, sphere, visibility, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (128, 96)


def grazing(kind: str, angle_deg: float) -> Light:
    """A light whose light falls on the middle of the floor ``angle_deg`` off its normal."""
    a = np.radians(angle_deg)
    to = np.array([np.sin(a) * 0.8, np.cos(a), np.sin(a) * 0.6])
    at = tuple(4 * to)
    match kind:
        case "point":
            return PointLight(at, (1.0,) * 3)
        case "sphere":
            return PointLight(at, (1.0,) * 3, 0.05)
        case "spot":
            return SpotLight(at, tuple(-to), (1.0,) * 3, 20.0, 40.0)
        case "soft spot":
            return SpotLight(at, tuple(-to), (1.0,) * 3, 20.0, 40.0, 0.05)
        case "sun":
            return DirectionalLight(tuple(-to), (1.0,) * 3)
        case "soft sun":
            return DirectionalLight(tuple(-to), (1.0,) * 3, 0.5)
        case _:
            return RectLight(at, (0, 0.05, 0), tuple(0.3 * np.cross(to, (0, 1, 0))), (1.0,) * 3, two_sided=True)


@pytest.mark.parametrize("angle", [0.0, 45.0, 85.0, 89.0])
@pytest.mark.parametrize("kind", ["point", "sphere", "spot", "soft spot", "sun", "soft sun", "rectangle"])
def test_no_acne_on_a_lit_plane(kind: str, angle: float) -> None:
    camera = Camera((0.0, 2.0, 2.5), (0.0, 0.0, 0.0), fov_y_deg=50.0)
    share, _ = visibility(make_scene([floor(2.0)], [grazing(kind, angle)]), SIZE, camera)
    wrong = share < 0.98
    print(f"ACNE {kind} {angle}: {wrong.sum()} texels, darkest {share.min():.3f}")
    assert not wrong.any()


@pytest.mark.parametrize("light", ["point", "sphere", "sun", "soft sun"])
def test_no_acne_on_a_sphere(light: str) -> None:
    """Facets that face away by their own normal are dark; those that face the light are not."""
    camera = Camera((2.0, 2.0, 2.5), (0.0, 0.0, 0.0), fov_y_deg=40.0)
    share, at = visibility(make_scene([sphere((0, 0, 0), 1.0, 96)], [grazing(light, 30.0)]), SIZE, camera)
    to = exact.unit(np.array([np.sin(np.radians(30)) * 0.8, np.cos(np.radians(30)), np.sin(np.radians(30)) * 0.6]))
    limit = 0.35 if "s" not in light[:2] else 0.15
    facing = (at @ to > limit) & (np.abs(np.linalg.norm(at, axis=-1) - 1) < 0.01)
    print(f"ACNE ball {light}: {(share[facing] < 0.98).sum()} of {facing.sum()}, darkest {share[facing].min():.3f}")
    assert facing.mean() > 0.15
    assert (share[facing] > 0.98).all()


@pytest.mark.parametrize("kind", ["point", "sun"])
def test_contact(kind: str) -> None:
    """Beside a box on the floor: shadow up to the contact line, light before it, within a few texels of the map."""
    light: Light = PointLight((-3.0, 2.0, 0.0), (1.0,) * 3) if kind == "point" \
        else DirectionalLight((3.0, -2.0, 0.0), (1.0,) * 3)
    parts = [floor(2.0), box((-0.5, 0.0, -0.5), (1.0, 0.5, 1.0))]
    # Of the map, at the box.
    texel = 2 / HARD_CUBE_TEXELS * 4 if kind == "point" else 2 * 2.9 / FACE_TEXELS[PARALLEL_MAP]
    camera = Camera((1.3, 0.6, 0.0), (0.5, 0.0, 0.0), fov_y_deg=40.0)  # the dark side
    share, at = visibility(make_scene(parts, [light]), SIZE, camera)
    on_floor, middle = np.abs(at[..., 1]) < 1e-4, np.abs(at[..., 2]) < 0.4
    near = on_floor & middle & (at[..., 0] > 0.5) & (at[..., 0] < 0.9)  # the shadow is longer than 0.4
    leak = near & (share > 0.02)
    width = (at[..., 0][leak] - 0.5).max() if leak.any() else 0.0
    print(f"CONTACT {kind}: {leak.sum()} of {near.sum()} floor texels lit, up to {width / texel:.2f} map texels out")
    assert width <= 3 * texel
    assert near.sum() > 500

    camera = Camera((-1.3, 0.6, 0.0), (-0.5, 0.0, 0.0), fov_y_deg=40.0)  # the lit side
    share, at = visibility(make_scene(parts, [light]), SIZE, camera)
    on_floor = np.abs(at[..., 1]) < 1e-4
    dark = on_floor & (at[..., 0] < -0.5) & (np.abs(at[..., 2]) < 0.4) & (share < 0.98)
    side = (np.abs(at[..., 0] + 0.5) < 1e-4) & (at[..., 1] > 0) & (share < 0.98)
    width = (-0.5 - at[..., 0][dark]).max() if dark.any() else 0.0
    height = at[..., 1][side].max() if side.any() else 0.0
    print(f"CONTACT {kind}: {dark.sum()} dark floor texels up to {width / texel:.2f} map texels before the box; "
          f"{side.sum()} on its side, up to {height / texel:.2f}")
    assert max(width, height) <= 3 * texel


@pytest.mark.parametrize("shape", ["crossing", "fold", "overhang"])
@pytest.mark.parametrize("kind", ["point", "sun"])
def test_no_light_creeps_around_an_edge(kind: str, shape: str) -> None:
    """A sheet of wall keeps light from the floor beside it, whether the floor goes on under it or ends there.

    Half a texel of the map is let off. A lid that juts out by a texel or two of the map keeps it from the wall below.
    """
    light: Light = PointLight((-2.0, 2.0, 0.0), (1.0,) * 3) if kind == "point" \
        else DirectionalLight((1.0, -1.0, 0.0), (1.0,) * 3)
    wall = quad((0.0, 0.0, 1.0), (0, 2.0, 0), (0, 0, -2.0))
    ground = quad((0.0 if shape == "fold" else -1.0, 0.0, 1.0), (2.0 if shape == "fold" else 3.0, 0, 0), (0, 0, -2.0))
    parts, low, high = [ground, wall], 0.5 * 4 / HARD_CUBE_TEXELS, 0.01
    camera = Camera((0.02, 0.008, 0.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)
    if shape == "overhang":
        light = PointLight((-0.01, 2.0, 0.0), (1.0,) * 3) if kind == "point" \
            else DirectionalLight((0.002, -1.0, 0.0), (1.0,) * 3)
        parts = [box((0.0, -1.0, -1.0), (1.0, 1.0, 2.0)), box((-0.004, 0.0, -1.0), (1.0, 0.2, 2.0))]
        low, high = -0.05, 0.0
        camera = Camera((-0.1, -0.04, 0.0), (0.0, -0.02, 0.0), fov_y_deg=30.0)
    share, at = visibility(make_scene(parts, [light]), SIZE, camera)
    there = (np.abs(at[..., 0]) < 1e-5) & (at[..., 1] > low) & (at[..., 1] < high) if shape == "overhang" \
        else (np.abs(at[..., 1]) < 1e-5) & (at[..., 0] > low) & (at[..., 0] < high)
    print(f"CREEP {kind} {shape}: {(share[there] > 0.02).sum()} of {there.sum()} texels lit")
    assert there.mean() > 0.1
    assert (share[there] <= 0.02).all()


@pytest.mark.parametrize("radius", [0.0, 0.1])
def test_a_room_around_a_light_has_no_seams(radius: float) -> None:
    """Every edge and corner of the six faces lies somewhere on the sphere; all of it is lit."""
    scene = make_scene([sphere((0, 0, 0), 2.0, 64)], [PointLight((0.0, 0.0, 0.0), (1.0,) * 3, radius)])
    for target in ((1, 1, 0), (1, -1, 1), (0, 0, -1), (-1, 0.2, -1)):
        share, _ = visibility(scene, SIZE, Camera((0.0, 0.0, 0.0), target, fov_y_deg=100.0))
        assert share.min() > 0.98


@pytest.mark.parametrize("radius", [0.0, 0.1])
def test_a_shadow_crosses_a_seam_unchanged(radius: float) -> None:
    """The light's faces -y and +x meet on the floor at x = 2; a shadow's edge runs across."""
    light = np.array([0.0, 2.0, 0.0])
    camera = Camera((2.0, 0.7, 0.0), (2.0, 0.0, 0.0), (1.0, 0.0, 0.0), 90.0)
    half_plane = quad((-6.0, 1.0, 0.0), (12.0, 0, 0), (0, 0, -6.0))
    share, at = visibility(make_scene([floor(6.0), half_plane], [PointLight(tuple(light), (1.0,) * 3, radius)]),
                           SIZE, camera)
    turned = at[..., [2, 1, 0]]  # the edge runs along x
    reference = exact.disc_behind_edge(turned, light, max(radius, 1e-3), 0.0, 1.0, 24)
    error = np.abs(share - reference).mean(axis=1)
    seam = np.abs(at[..., 0] - 2.0).mean(axis=1) < 0.05
    print(f"SEAM {radius}: mean error {error[seam].mean():.4f} at the seam, {error[~seam].mean():.4f} elsewhere")
    assert error[seam].mean() < 1.5 * error[~seam].mean() + 0.002


@pytest.mark.parametrize("radius_deg", [0.0, 2.0])
def test_a_wide_floor_costs_a_map_nothing(radius_deg: float) -> None:
    """A bar's shadow is the same on a floor of 400 m as on one of 4 m, and far out the floor is lit."""
    sun = DirectionalLight((0.5, -1.0, 0.2), (1.0,) * 3, radius_deg)
    bar = box((-0.5, 0.2, -0.01), (1.0, 0.02, 0.02))
    camera = Camera((0.0, 1.2, 0.8), (0.1, 0.0, 0.0), fov_y_deg=50.0)
    small, wide = (visibility(make_scene([floor(half), bar], [sun]), SIZE, camera)[0] for half in (2.0, 200.0))
    print(f"FLOOR {radius_deg}: darkest {small.min():.3f} and {wide.min():.3f}, {np.abs(small - wide).max():.3f} apart")
    assert small.min() < 0.2
    assert np.abs(small - wide).max() < 0.1 and np.abs(small - wide).mean() < 2e-3


@pytest.mark.parametrize("radius_deg", [0.0, 2.0])
def test_a_wide_floor_is_lit_outside_the_map(radius_deg: float) -> None:
    """Also where the floor itself reaches the map's edge, on the side away from the light."""
    sun = DirectionalLight((0.5, -1.0, 0.2), (1.0,) * 3, radius_deg)
    scene = make_scene([floor(200.0), box((-0.5, 0.0, -0.5), (1.0, 0.1, 1.0))], [sun])
    for x, z in ((150.0, 100.0), (-150.0, 100.0), (150.0, -100.0), (-150.0, -100.0), (3.0, 1.0), (-3.0, -1.0)):
        camera = Camera((x, 1.2, z + 0.8), (x, 0.0, z), fov_y_deg=50.0)
        assert visibility(scene, SIZE, camera)[0].min() > 0.98


def test_a_map_keeps_its_size_while_something_ducks() -> None:
    """Feet may be a little below the floor, whatever the height above them is at the time."""
    figure = box((-0.2, -0.0015, -0.2), (0.4, 2.0, 0.4))
    scene = make_scene([floor(200.0), figure], [DirectionalLight((0.3, -1.0, 0.2), (1.0,) * 3)])
    with Renderer(scene, Settings((32, 24), outputs=("final",)), None) as renderer:
        lights = renderer._lights
        boxes = renderer._geometry.boxes.copy()
        before = lights.standing.copy()
        boxes[1, 1, 1] = 0.4  # the figure's top
        lights.cover(boxes)
        np.testing.assert_array_equal(lights.standing, before)
        boxes[1, :, 1] -= 1.0
        lights.cover(boxes)
        np.testing.assert_array_equal(lights.standing, lights.bounds)
    assert before[1, 0] < 1


@pytest.mark.parametrize("radius_deg", [0.0, 2.0])
@pytest.mark.parametrize("below", [
    box((-0.5, -3.0, -0.5), (1.0, 1.0, 1.0)), quad((7.0, -2.0, 1.0), (2, 0, 0), (0, 0, -2))], ids=["box", "floor"])
def test_a_wide_floor_shades_what_lies_below(below: Part, radius_deg: float) -> None:
    sun = DirectionalLight((0.5, -1.0, -0.5), (1.0,) * 3, radius_deg)
    scene = make_scene([floor(20.0), box((-0.5, 0.0, -0.5), (1.0, 1.0, 1.0)), below], [sun])
    x, y, z = below.triangles.reshape(-1, 3).mean(axis=0)
    share, at = visibility(scene, SIZE, Camera((x, y + 1.5, z + 3.0), (x, y, z), fov_y_deg=30.0))
    # Of the box, the side and the top that face the light.
    hidden = (at[..., 1] < -1.9) & ((at[..., 2] > 0.49) | (at[..., 1] > -2.01)) & (np.abs(at[..., 0] - x) < 1.1)
    print(f"FLOOR below {radius_deg}: {share[hidden].max():.3f} of {hidden.sum()} texels")
    assert hidden.sum() > 500 and share[hidden].max() < 0.02


@pytest.mark.parametrize("height", [2.0, 200.0])
@pytest.mark.parametrize("part", ["rock", "deck"])
def test_only_what_is_level_and_lowest_is_a_floor(part: str, height: float) -> None:
    """Far from a box, relief of the ground's own mesh casts its shadow, and so does a low deck on the ground."""
    sun = DirectionalLight((0.1, -0.3, 1.0), (1.0,) * 3)
    ground, rock = floor(200.0), box((20.0, 0.0, 0.0), (1.0, 0.35, 1.0))
    if part == "rock":
        parts = [replace(ground, triangles=np.concatenate([ground.triangles, rock.triangles]))]
    else:
        parts = [ground, quad((20.0, 0.15, 1.0), (2.0, 0, 0), (0, 0, -2.0))]
    scene = make_scene([*parts, box((-1.0, 0.0, -1.0), (2.0, height, 2.0))], [sun])
    share, at = visibility(scene, SIZE, Camera((21.0, 3.0, 3.0), (21.0, 0.0, 1.0), fov_y_deg=60.0))
    assert share[np.abs(at[..., 1]) < 1e-3].min() < 0.05


def test_a_long_penumbra_is_as_long_as_the_floor_lets_it_be() -> None:
    """Near the tip of a pole's shadow, 20 m away: not only what is as near as half of the pole is looked for."""
    sun = DirectionalLight((1.0, -np.tan(np.radians(10.0)), 0.0), (1.0,) * 3, 2.0)
    low, size = np.array([-0.3, 0.0, -0.3]), np.array([0.6, 4.0, 0.6])
    x = 0.9 * 4.0 / np.tan(np.radians(10.0))
    parts = [floor(30.0), box(tuple(low), tuple(size))]
    share, at = visibility(make_scene(parts, [sun]), SIZE, Camera((x, 6.0, 0.0), (x, 0.0, 0.0), (0.0, 0.0, -1.0), 40.0))
    to = -exact.unit(np.array(sun.direction))
    side = exact.unit(np.cross(to, (0.0, 1.0, 0.0)))
    radius = np.tan(np.radians(sun.angular_radius_deg)) * np.sqrt((np.arange(256) + 0.5) / 256)
    turn = 2.399963 * np.arange(256)
    open_rays = np.zeros(share.shape)
    for r, a in zip(radius, turn, strict=True):
        direction = to + r * (np.cos(a) * side + np.sin(a) * np.cross(to, side))
        ends = np.sort(np.stack([(low - at) / direction, (low + size - at) / direction]), axis=0)
        open_rays += ends[0].max(axis=-1) > ends[1].min(axis=-1)
    error = np.abs(share - open_rays / 256).mean()
    print(f"PENUMBRA of a pole at its tip: mean error {error:.4f}")
    assert error < 0.04


def test_contact_is_dark_in_the_penumbra_of_what_stands_far_above() -> None:
    """A plate hides all of the sun from a strip beside it, of which a slab above hides less than half."""
    sun = DirectionalLight((1.0, -1.0, 0.0), (1.0,) * 3, 2.0)
    plate = quad((-1.0, 0.05, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -2.0))
    slab = quad((-4.0, 2.0, 0.0), (4.0, 0.0, 0.0), (0.0, 0.0, -3.0))
    share, at = visibility(make_scene([floor(2.0), plate, slab], [sun]), SIZE,
                           Camera((0.025, 1.0, 0.05), (0.025, 0.0, 0.05), (0.0, 0.0, -1.0), 15.0))
    strip = (at[..., 0] > 0.01) & (at[..., 0] < 0.04) & (at[..., 2] > 0.02) & (at[..., 2] < 0.08)
    beside = (at[..., 0] > 0.06) & (at[..., 2] > 0.02) & (at[..., 2] < 0.08)
    print(f"CONTACT below a slab: up to {share[strip].max():.3f}; beside it {share[beside].min():.2f}")
    assert strip.sum() > 200 and share[beside].min() > 0.4
    assert share[strip].mean() < 0.02 and share[strip].max() < 0.2


@pytest.mark.parametrize(("height", "radius_deg", "most"), [(0.5, 6.0, 0.032), (0.3, 6.0, 0.05), (0.3, 3.0, 0.052)])
def test_a_plate_near_the_ground_hides_what_a_roof_lets_pass(height: float, radius_deg: float, most: float) -> None:
    """Across its edge, where the roof hides a bit less than half of the sun; against a quadrature of the sun's disc."""
    sun, roof_height = DirectionalLight((0.0, -1.0, 0.0), (1.0,) * 3, radius_deg), 2.0
    near, far = (h * np.tan(np.radians(radius_deg)) for h in (height, roof_height))  # radii of the sun's image
    plate = quad((-2.0, height, 2.0), (2.0, 0.0, 0.0), (0.0, 0.0, -4.0))
    roof = quad((-2.0, roof_height, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -2.0))  # where z > 0
    eye, z = 0.8 * height, -0.08 * far
    fov = 2 * np.degrees(np.arctan(1.05 * near / eye))
    camera = Camera((0.0, eye, z), (0.0, 0.0, z), (0.0, 0.0, -1.0), float(fov))
    share, at = visibility(make_scene([floor(2.0), plate, roof], [sun], camera), SIZE, camera)
    rows = slice(SIZE[1] * 11 // 24, SIZE[1] * 13 // 24)
    x, z_of = at[rows, :, 0], at[rows, :, 2]
    passed = np.zeros(x.shape)
    for r, turn in zip(np.sqrt((np.arange(512) + 0.5) / 512), 2.399963 * np.arange(512), strict=True):
        passed += (x + near * r * np.cos(turn) >= 0) & (z_of + far * r * np.sin(turn) <= 0)
    error = np.abs(share[rows].mean(axis=0) - passed.mean(axis=0) / 512).mean()
    print(f"CONTACT of a plate at {height}, sun {radius_deg}: mean error {error:.4f}")
    assert error < most


@pytest.mark.parametrize(("kind", "most"), [("sun", 5e-5), ("sphere", 3e-4)])
def test_no_light_enters_an_attic_of_sheets(kind: str, most: float) -> None:
    """Walls without thickness, a roof with an overhang and rafters below it; the light has a size and is outside."""
    towards = exact.unit(np.array([0.78, 0.57, 0.26]))
    light: Light = (DirectionalLight(tuple(-towards), (1.0,) * 3, 0.27) if kind == "sun"
                    else PointLight(tuple(6.0 * towards + (0.0, 1.0, 0.0)), (36.0,) * 3, 0.05))
    roof = [quad((side * 2.2, 0.9, 2.2), (0.0, 0.0, -4.4), (-side * 2.2, 1.6, 0.0)) for side in (-1, 1)]
    walls = [quad((x, 0.0, -2.0), (0.0, 0.0, 4.0), (0.0, 1.1, 0.0)) for x in (-2.0, 2.0)]
    gables = [quad((-2.0, 0.0, z), (4.0, 0.0, 0.0), (0.0, 1.05, 0.0)) for z in (-2.0, 2.0)]
    gables += [Part(np.array([[[-2.0, 1.05, z], [2.0, 1.05, z], [0.0, 2.5, z]]])) for z in (-2.0, 2.0)]
    rafters = [box((-1.9, 1.0, z), (3.8, 0.12, 0.08)) for z in (-1.5, -0.5, 0.5, 1.5)]
    steps = [box((1.4 + 0.2 * k, 0.0, -1.0), (0.2, 0.2 + 0.15 * k, 0.8)) for k in range(3)]
    camera = Camera((-1.2, 0.8, 1.6), (1.2, 0.6, -1.2), fov_y_deg=90.0)
    scene = make_scene([floor(2.0), *roof, *walls, *gables, *rafters, *steps], [light], camera)
    lit, free = (draw(s, (512, 384), ("direct",), camera)["direct"][..., 1] for s in (scene, without_shadows(scene)))
    leak = lit[free > 0].sum() / free.sum()
    print(f"LEAKS into an attic, {kind}: {leak:.2e}")
    assert (free > 0).mean() > 0.4 and leak < most


@pytest.mark.parametrize("offset", [0.005, 0.006, 0.015])
def test_no_sun_enters_a_corner_of_two_sheets(offset: float) -> None:
    """Texels of the sun's map on the corner show what lies far behind it; boxes far away make them coarse."""
    sun = DirectionalLight((0.82, -0.42, 0.28), (3.0, 3.0, 3.0), angular_radius_deg=1.5)
    camera = Camera((1.0 + offset, 1.2, -1.0), (2.0 + offset, 1.2, -2.0), fov_y_deg=50.0)
    parts = [quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)), quad((2, 0, -2), (0, 0, 2), (0, 3, 0)), floor(2.0),
             box((18, -0.5, 18), (1, 1, 1)), box((-19, -0.5, -19), (1, 1, 1))]
    above_floor = draw(make_scene(parts, [sun], camera), (256, 192), ("direct",))["direct"][:130]
    assert above_floor.max() < 0.02


@pytest.mark.parametrize("kind", ["point", "sun", "spot"])
def test_a_masked_caster_casts_a_masked_shadow(kind: str) -> None:
    light, towards = np.array([0.0, 3.0, 0.0]), np.array([0.0, 1.0, 0.0])
    squares = np.kron(np.indices((4, 4)).sum(0) % 2, np.ones((16, 16), np.uint8)).astype(np.uint8)
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[..., 3] = 255 * squares
    leaves = Material(albedo=(0.5,) * 3, albedo_map=Texture(pixels, repeat=(False, False)), alpha_cutoff=0.5)
    lamp: Light = {"point": PointLight(tuple(light), (1.0,) * 3), "sun": DirectionalLight(tuple(-towards), (1.0,) * 3),
                   "spot": SpotLight(tuple(light), tuple(-towards), (1.0,) * 3, 40.0, 45.0)}[kind]
    scene = make_scene([floor(2.0), quad((-0.8, 1.5, 0.8), (1.6, 0, 0), (0, 0, -1.6), leaves)], [lamp])
    share, at = visibility(scene, SIZE, Camera((0.0, 1.4, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 100.0))
    hit = at[..., [0, 2]] * (1.0 if kind == "sun" else 0.5)
    s, t = (hit[..., 0] + 0.8) / 1.6, (0.8 - hit[..., 1]) / 1.6
    inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    row, column = (np.clip((f * 4).astype(int), 0, 3) for f in (1 - t, s))
    opaque = inside & ((row + column) % 2 == 1)
    clear = np.minimum(np.abs(s * 4 - np.round(s * 4)), np.abs(t * 4 - np.round(t * 4))) > 0.1
    wrong = clear & (np.abs(share - np.where(opaque, 0.0, 1.0)) > 0.02)
    print(f"MASK {kind}: {wrong.sum()} of {clear.sum()} texels wrong")
    assert clear.mean() > 0.4 and (clear & opaque).sum() > 500
    assert not wrong.any()


def test_emitters_that_are_lights_cast_no_shadow() -> None:
    """The rectangle's own quad, and even one just below it, leave the floor lit; another quad does not."""
    lamp = RectLight((0.0, 2.0, 0.0), (1.0, 0, 0), (0, 0, 1.0), (1.0,) * 3)
    below = {"corner": (-0.5, 1.9, 0.5), "u": (1.0, 0, 0), "v": (0, 0, -1.0)}

    def darkest(material: Material) -> F64:
        parts: list[Part] = [floor(1.0), quad(**below, material=material)]
        return visibility(make_scene(parts, [lamp]), SIZE, Camera((0.0, 1.5, 0.0), (0, 0, 0), (0, 0, -1.0)))[0].min()

    assert darkest(Material(emission=(1.0,) * 3, is_light_proxy=True)) > 0.99
    assert darkest(GREY) < 0.1


@pytest.mark.parametrize("radius_deg", [0.0, 1.0])
def test_emitters_that_are_lights_shade_the_sun(radius_deg: float) -> None:
    """A panel between the floor and the sun casts the shadow of its square."""
    panel = quad((-0.5, 1.0, 0.5), (1.0, 0, 0), (0, 0, -1.0), Material(emission=(1.0,) * 3, is_light_proxy=True))
    sun = DirectionalLight((0.0, -1.0, 0.0), (1.0,) * 3, radius_deg)
    share, at = visibility(make_scene([floor(2.0), panel], [sun]), SIZE, Camera((2.5, 0.6, 0.0), (0, 0, 0)))
    offset = np.abs(at[..., [0, 2]]).max(axis=-1)
    on_floor = (np.abs(at[..., 1]) < 1e-3) & at.any(axis=-1)
    assert share[on_floor & (offset < 0.4)].max() < 0.01
    assert share[on_floor & (offset > 0.6)].min() > 0.99


@pytest.mark.parametrize("radius", [0.0, 0.05, 0.3])
def test_a_lit_corner_has_no_dark_crease(radius: float) -> None:
    """What lies behind the receiver, or beside the light's way, casts nothing on it, but for a texel of the map."""
    parts = [floor(2.0), quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)), quad((2, 0, -2), (0, 0, 4), (0, 3, 0))]
    lamp = PointLight((0.0, 1.5, 0.0), (1.0,) * 3, radius)
    share, at = visibility(make_scene(parts, [lamp]), (256, 192), Camera((-1.5, 1.2, 1.5), (1.0, 0.5, -1.0)))
    to_walls = np.sort(np.stack([at[..., 1], at[..., 2] + 2, 2 - at[..., 0]], -1), axis=-1)
    crease = to_walls[..., 1] < 2 / HARD_CUBE_TEXELS * np.linalg.norm(at - np.array(lamp.position), axis=-1)
    wrong = (share < 0.98) & ~crease
    print(f"ROOM {radius}: {wrong.sum()} wrong texels ({wrong.mean():.3%}), darkest {share.min():.3f}")
    assert wrong.mean() < 2e-4


@pytest.mark.parametrize(("hard", "soft", "faces"), [
    (1, 0, {1536}), (0, 1, {1024}), (2, 0, {1536}), (1, 1, {1536, 1024}), (3, 0, {1024}), (1, 2, {1024}),
    (5, 0, {512}), (40, 0, {256}),
])
def test_maps_are_as_fine_as_the_atlas_lets_them_be(hard: int, soft: int, faces: set[int]) -> None:
    lights = (PointLight((0, 1, 0), (1.0,) * 3),) * hard + (PointLight((0, 1, 0), (1.0,) * 3, 0.1),) * soft
    tiles, _, size = lay_out(lights, 16384)
    assert {tile.face for tile in tiles} == faces
    assert_apart(tiles, size)


@pytest.mark.parametrize(("suns", "cubes", "spots", "max_size", "sun", "face"), [
    (1, 0, 0, 16384, 4096, 0), (1, 2, 0, 16384, 4096, 1024), (1, 8, 0, 16384, 4096, 512),
    (1, 19, 0, 16384, 4096, 256), (1, 0, 4, 16384, 4096, 2048), (1, 3, 2, 16384, 4096, 512),
    (1, 41, 0, 16384, 2048, 256), (2, 1, 0, 16384, 2048, 512), (2, 10, 2, 16384, 2048, 512),
    (1, 1, 0, 4096, 2048, 512), (1, 6, 0, 2048, 1024, 256), (3, 100, 30, 16384, 2048, 128),
])
def test_lamps_leave_the_sun_its_fine_map(suns: int, cubes: int, spots: int, max_size: int, sun: int,
                                          face: int) -> None:
    lights = (*(PointLight((0, 1, 0), (1.0,) * 3, 0.1),) * cubes, *(DirectionalLight((0, -1, 0), (1.0,) * 3),) * suns,
              *(SpotLight((0, 1, 0), (0, -1, 0), (1.0,) * 3, 10.0, 20.0, 0.1),) * spots)
    tiles, cascades, size = lay_out(lights, max_size)
    assert cascades == [None] * len(lights)
    assert {tile.face for tile in tiles if tile.kind == PARALLEL_MAP} == {sun}
    assert {tile.face for tile in tiles if tile.kind == CUBE_MAP} <= {face}
    assert {tile.face for tile in tiles if tile.kind == SINGLE_MAP} <= {2 * face if cubes else face}
    assert [tile.kind for tile in tiles] == [map_kind(light) for light in lights]
    assert max(size) <= max_size
    assert_apart(tiles, size)
    with_cascades, cascades, size = lay_out(lights, max_size, True)
    assert with_cascades == tiles  # and so is what they show
    drawn = [tile for tile in cascades if tile is not None]
    assert len(drawn) == suns or (not drawn and size[1] == max_size)
    assert len({tile.face for tile in drawn}) <= 1 and all(256 <= tile.face <= CASCADE_TEXELS for tile in drawn)
    assert max(size) <= max_size
    assert_apart(tiles + drawn, size)


def assert_apart(tiles: list[Tile], size: tuple[int, int]) -> None:
    unit = math.gcd(*(tile.face for tile in tiles))
    taken = np.zeros((-(-size[1] // unit), -(-size[0] // unit)), np.int32)
    for tile in tiles:
        (x, y), (width, height) = (np.array(pair) // unit for pair in (tile.corner, tile.size))
        assert tuple(np.array(tile.corner) % unit) == (0, 0)
        assert x + width <= taken.shape[1] and y + height <= taken.shape[0]
        taken[y:y + height, x:x + width] += 1
    assert taken.max(initial=0) <= 1


def seen_of_floor(parts: list[Part], light: Light) -> tuple[F64, F64, Scene]:
    """Share [N] of light that arrives at points [N, 3] of a floor whose coarse map has texels of several pixels."""
    far = [box((x, 0.0, 0.0), (0.2, 1.0, 0.2)) for x in (-4.0, 4.0)]
    scene = make_scene([floor(2.0), *parts, *far], [light])
    with coarse_shadow_maps():
        seen, at = visibility(scene, (256, 192), Camera((-0.15, 0.45, 0.6), (-0.15, 0.0, 0.0), fov_y_deg=50.0))
    is_floor = np.abs(at[..., 1]) < 1e-4
    return seen[is_floor], at[is_floor], scene


@pytest.mark.parametrize("turn_deg", [3.0, 17.0, 40.0])
@pytest.mark.parametrize(("kind", "most"), [("sun", 0.0115), ("spot", 0.021), ("point", 0.032)])
def test_a_straight_edge_of_a_hard_shadow_is_straight(kind: str, most: float, turn_deg: float) -> None:
    """Also where the map's texels are several pixels wide, and its edge runs in steps."""
    half, height, turn = 0.3, 0.5, np.radians(turn_deg)
    u, v = np.array([np.cos(turn), 0.0, np.sin(turn)]), np.array([-np.sin(turn), 0.0, np.cos(turn)])
    plate = quad(tuple(np.array([0, height, 0]) - half * (u + v)), tuple(2 * half * v), tuple(2 * half * u))
    light = grazing(kind, 15.0)
    seen, at, _ = seen_of_floor([plate], light)
    to = -np.array(light.direction) if isinstance(light, DirectionalLight) else np.array(light.position) - at
    at_plate = at + to * (height / to[..., 1:2])
    is_hidden = (np.abs(at_plate @ u) < half) & (np.abs(at_plate @ v) < half)
    wrong = np.abs(seen - ~is_hidden)
    print(f"STEPS {kind} {turn_deg}: {wrong.mean():.4f}")  # interpolated alone: 0.014, 0.026, 0.036
    assert 0.2 < is_hidden.mean() < 0.6 and wrong.mean() < most


@pytest.mark.parametrize(("what", "most"), [("grid", 0.135), ("contact", 0.017)])
def test_straight_edges_of_hard_shadows_cost_no_gaps_and_corners(what: str, most: float) -> None:
    """Bars and gaps of a few texels of the map, and boxes on the floor."""
    if what == "grid":
        steps = np.arange(-0.5, 0.5, 0.12)
        parts = [box((x, 0.5, -0.6), (0.04, 0.02, 1.2)) for x in steps]
        parts += [box((-0.6, 0.5, z), (1.2, 0.02, 0.04)) for z in steps]
    else:
        parts = [box((x, 0.0, z), (0.12, 0.25, 0.12)) for x in (-0.5, -0.2, 0.1) for z in (-0.3, 0.1)]
    seen, at, scene = seen_of_floor(parts, grazing("sun", 35.0))
    caster = Caster(scene)
    start = (at - caster.origin + (0, 1e-4, 0)).astype(np.float32)
    to = np.broadcast_to(-9 * np.array(scene.lights[0].direction, np.float32), start.shape)
    wrong = np.abs(seen - ~caster.is_occluded(start, to, True))
    print(f"GAPS {what}: {(wrong > 0.3).mean():.4f}")  # interpolated alone: 0.131, 0.019
    assert (wrong > 0.3).mean() < most
