"""Volumes of glass that light leaves at their backs, against rays through closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from app.arrays import F64
from app.network.selection import find_model
from app.scene import Camera, Environment, Material, Scene, Texture, Transmission
from tests.gl.scenes import Part, box, draw, floor, make_scene, quad, sphere

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

IOR, RADIUS = 1.5, 0.5
WALL_HALF = 8.0
FRONT = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)
SLANTED = Camera((0.0, 2.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)  # the middle of its image shows the origin
WHITE = Material(albedo=(1.0, 1.0, 1.0), is_unlit=True)
RAMP = Texture(np.linspace(0, 1, 257, dtype=np.float32)[:, None, None].repeat(4, axis=2), repeat=(False, False))


def glass(ior: float = IOR, thickness: float = 0.1, **options: object) -> Material:
    """Clear, smooth and without reflections; a thickness unlike its geometry's, as artists write it."""
    absorbs = {k: options.pop(k) for k in ("attenuation_color", "attenuation_distance") if k in options}
    return Material(**{"albedo": (1.0, 1.0, 1.0), "roughness": 0.0, **options},  # type: ignore[arg-type]
                    transmission=Transmission(1.0, ior=ior, thickness=thickness, **absorbs))  # type: ignore[arg-type]


def smooth_ball(material: Material, *others: Part, camera: Camera = FRONT) -> Scene:
    scene = make_scene([sphere((0, 0, 0), RADIUS, 96, material), *others], camera=camera)
    ball = scene.meshes[0]
    return replace(scene, meshes=(replace(ball, normals=ball.positions / RADIUS), *scene.meshes[1:]))


def wall(z: float, material: Material) -> Part:
    return quad((-WALL_HALF, -WALL_HALF, z), (2 * WALL_HALF, 0, 0), (0, 2 * WALL_HALF, 0), material)


def ramp_wall(z: float = -1.5) -> Part:
    """A wall whose radiance falls from 1 to 0 upwards."""
    return wall(z, replace(WHITE, albedo_map=RAMP))


def refract(d: F64, n: F64, ratio: float) -> F64:
    """Snell's law for a unit direction against a unit normal."""
    cosine = -float(n @ d)
    return ratio * d + (ratio * cosine - math.sqrt(1 - ratio * ratio * (1 - cosine * cosine))) * n


def height_through_ball(slope: float, wall_z: float) -> float:
    """Where a ray from the eye meets a wall, in float64; ``slope`` is that of the ray in the plane x = 0."""
    eye = np.array([0.0, 0.0, 4.0])
    d = np.array([0.0, slope, -1.0]) / math.hypot(slope, 1.0)
    b = float(eye @ d)
    entry = eye + (-b - math.sqrt(b * b - float(eye @ eye) + RADIUS**2)) * d
    inside = refract(d, entry / RADIUS, 1 / IOR)
    leaving = entry - 2 * float(entry @ inside) * inside
    out = refract(inside, -leaving / RADIUS, IOR)
    return float((leaving + (wall_z - leaving[2]) / out[2] * out)[1])


@pytest.mark.parametrize(("wall_z", "size"), [(-1.5, 192), (-8.0, 192), (-8.0, 900)])
def test_a_ball_shows_what_is_behind_it_upside_down(wall_z: float, size: int) -> None:
    """Along its vertical diameter, as far as what it shows is in the picture."""
    column = draw(smooth_ball(glass(), ramp_wall(wall_z)), (size, size))["final"]
    seen = column[:, size // 2 - 1:size // 2 + 1].mean((1, 2))
    slopes = -((np.arange(size) + 0.5) / size * 2 - 1) * math.tan(math.radians(15))
    through = np.abs(slopes) < 0.6 * RADIUS / 4
    expected = [0.5 - height_through_ball(slope, wall_z) / (2 * WALL_HALF) for slope in slopes[through]]
    assert np.ptp(expected) > 0.03 and expected[0] > expected[-1]  # upside down
    np.testing.assert_allclose(seen[through], expected, atol=2e-3)


def test_a_mirrored_ball_is_refracted_like_any_other() -> None:
    scene = smooth_ball(glass(), ramp_wall())
    mirrored = replace(scene.instances[0], transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    same = replace(scene, instances=(mirrored, *scene.instances[1:]))
    plain, seen = (draw(s, (96, 96))["final"] for s in (scene, same))
    np.testing.assert_allclose(seen, plain, atol=2e-3)


@pytest.mark.parametrize("model", [None, "bcnn-8", "final-gather"])
def test_a_ball_in_an_even_environment_is_not_seen(model: str | None) -> None:
    """Clear glass neither takes light nor gives any; also where it refracts to what the picture does not show."""
    white = Environment(np.ones((4, 8, 3), np.float32))
    scene = replace(smooth_ball(glass()), environment=white)
    seen = draw(scene, (96, 96), model=None if model is None else find_model(model))["final"]
    np.testing.assert_allclose(seen, 1.0, atol=5e-3)


def test_a_blended_wall_is_seen_through_a_ball() -> None:
    """Beside the ball it is the nearest layer, behind it the third."""
    red = Material(albedo=(1.0, 0.0, 0.0), alpha=1.0, is_blended=True, is_unlit=True)
    seen = draw(smooth_ball(glass(), wall(-1.5, red), wall(-2.0, WHITE)), (96, 96))["final"]
    np.testing.assert_allclose(seen, np.broadcast_to((1.0, 0.0, 0.0), seen.shape), atol=2e-3)


@pytest.mark.parametrize("size", [64, 512])
def test_a_deep_volume_absorbs_near_the_camera_too(size: int) -> None:
    near = Camera((0.0, 0.0, 0.05), (0.0, 0.0, -1.0), fov_y_deg=45.0)
    block = box((-20.0, -20.0, -10.0), (40.0, 40.0, 10.0), glass(ior=1.0, attenuation_color=(0.5,) * 3,
                                                                 attenuation_distance=10.0))
    seen = draw(make_scene([block, wall(-12.0, WHITE)], camera=near), (size, size))["final"]
    middle = slice(size // 2 - 2, size // 2 + 2)
    np.testing.assert_allclose(seen[middle, middle], 0.5, rtol=5e-3)


def test_a_volume_absorbs_along_the_way_through_it() -> None:
    """Whatever its nominal thickness is."""
    tint = np.array((0.5, 0.25, 1.0))
    absorbing = glass(ior=1.0, attenuation_color=tuple(tint), attenuation_distance=2 * RADIUS)
    seen = draw(smooth_ball(absorbing, ramp_wall()), (64, 64))["final"][31:33, 31:33].mean((0, 1))
    np.testing.assert_allclose(seen, 0.5 * tint, rtol=1e-2)


def test_what_is_seen_through_shows_within_a_volume() -> None:
    """A thin pane in a block, tinted by a ramp, where the refracted ray meets it."""
    below = 0.2  # the top of the block
    pane = floor(1.9, 0.5 - below, Material(albedo=(1.0, 1.0, 1.0), albedo_map=RAMP, roughness=0.0,
                                            transmission=Transmission(1.0)))
    block = box((-2.0, 0.0, -2.0), (4.0, 0.5, 4.0), glass(thickness=0.5))
    seen = draw(make_scene([block, pane, floor(8.0, -0.1, WHITE)], camera=SLANTED), (48, 48))["final"]
    z = 0.5 - below * math.tan(math.asin(math.sin(math.pi / 4) / IOR))
    np.testing.assert_allclose(seen[23:25, 23:25].mean(), 1 - (1.9 - z) / 3.8, atol=8e-3)


def test_a_block_on_the_ground_hides_nothing_below_it() -> None:
    """Its bottom and the ground are one plane."""
    block = box((-0.5, 0.0, -0.5), (1.0, 0.2, 1.0), glass())
    seen = draw(make_scene([block, floor(8.0, 0.0, WHITE)], camera=SLANTED), (96, 96))["final"][40:56, 32:64]
    np.testing.assert_allclose(seen, 1.0, rtol=1e-3)
