"""GGX highlights of rectangle lights against float64 quadrature of the lobe, and what they may never do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from app.gl.lights import IN_PLANE
from app.scene import Camera, Material, RectLight, Scene
from app.specular_albedo import lobe_albedo
from tests.gl.closed_forms import unit
from tests.gl.scenes import Images, Part, draw, floor, make_scene, quad, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

F64 = NDArray[np.float64]
Point = tuple[float, float, float]

DISTANCE, DEPTH, ROWS = 40.0, 4.0, 14  # of the camera; of the floor, and pixels along it
ROUGHNESSES = (0.1, 0.3, 0.6, 1.0)
STRIP = 0.4  # width of the floor of one roughness
AROUND = RectLight((0.0, 1.0, 0.0), (4000.0, 0, 0), (0, 0, 4000.0), (1.0, 1.0, 1.0))
# Measured errors, largest over roughness and light, rounded up: shares of the largest value over the floor.
MAX_ERRORS = {0: 0.008, 30: 0.011, 60: 0.011, 75: 0.017, 85: 0.016, 86.5: 0.021, 88: 0.019}


def mirror(roughness: float, f0: float = 1.0) -> Material:
    return Material(albedo=(0.0,) * 3, roughness=roughness, specular=(f0,) * 3)


def seen_at(degrees: float, fov_y_deg: float = 5.0, distance: float = DISTANCE) -> Camera:
    angle = math.radians(degrees)
    up = (0.0, 0.0, -1.0) if degrees < 10 else (0.0, 1.0, 0.0)
    return Camera((0.0, distance * math.cos(angle), distance * math.sin(angle)), (0, 0, 0), up, fov_y_deg)


def lights_at(degrees: float) -> dict[str, RectLight]:
    """Two-sided rectangles of radiance 1, by name; one of each size is where the floor's middle mirrors the view."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    mirrored, across = np.array([0.0, cosine, -sine]), np.array([0.0, sine, cosine])
    rectangles = {
        "narrow, mirrored": (1.2 * mirrored, (1.8, 0, 0), 0.25 * across),
        "narrow, low": ((0.1, 0.15, -1.6), (1.8, 0.1, 0), (-0.1, 0.25, 0.1)),
        "large, mirrored": (1.2 * mirrored, (1.6, 0, 0.3), 1.6 * across),
        "large, above": ((0.3, 0.8, -0.3), (3.0, 0, 0), (0, 0, 2.0)),
        "large, across the horizon": ((0.3, 0.4, -1.5), (3.0, 0, 0.5), (0, 2.0, 0.2))}
    return {name: RectLight(*(tuple(map(float, x)) for x in light), (1.0, 1.0, 1.0), two_sided=True)
            for name, light in rectangles.items()}


def strips(light: RectLight, f0: float = 1.0) -> Scene:
    """Floors side by side, one for each roughness."""
    def strip(i: int, roughness: float) -> Part:
        left = STRIP * (i - len(ROUGHNESSES) / 2)
        return quad((left, 0, DEPTH / 2), (STRIP, 0, 0), (0, 0, -DEPTH), mirror(roughness, f0))

    return without_shadows(make_scene([strip(i, r) for i, r in enumerate(ROUGHNESSES)], [light]))


def draw_strips(degrees: float, light: RectLight, f0: float = 1.0) -> tuple[Images, Camera]:
    """``specular``, ``position`` and ``depth``, and the camera, which sees all strips and little else."""
    height = DEPTH * math.cos(math.radians(degrees))
    camera = seen_at(degrees, math.degrees(2 * math.atan(0.5 * height / DISTANCE)))
    size = round(ROWS * STRIP * len(ROUGHNESSES) / height), ROWS
    return draw(strips(light, f0), size, ("specular", "position", "depth"), camera), camera


def pixels_of(strip: int, images: Images) -> NDArray[np.int64]:
    """Rows and columns [n, 2] of pixels spread over a strip."""
    inside = np.abs(images["position"][..., 0] - STRIP * (strip + 0.5 - len(ROUGHNESSES) / 2)) < 0.45 * STRIP
    pixels = np.argwhere(inside & (images["depth"][..., 0] > 0))
    assert len(pixels) >= 12
    return pixels[:: max(len(pixels) // 30, 1)]


def lobe_samples(point: F64, eye: F64, alpha: float, count: int = 2**14) -> tuple[F64, F64]:
    """Directions [n, 3] that a GGX lobe with F = 1 prefers, on a floor y = 0, and their weights [n], which add up to
    the directional albedo: a rank-1 lattice over half vectors."""
    u, phi = (np.arange(count) + 0.5) / count, 2 * np.pi * (np.arange(count) * 0.6180339887498949 % 1)
    n_h = np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u))
    sine = np.sqrt(1 - n_h**2)
    h = np.stack([sine * np.cos(phi), n_h, sine * np.sin(phi)], -1)
    v = unit(eye - point)
    v_h = h @ v
    light = 2 * v_h[:, None] * h - v
    n_l, n_v = light[:, 1], v[1]
    smith = n_l * np.sqrt(n_v**2 * (1 - alpha**2) + alpha**2) + n_v * np.sqrt(n_l**2 * (1 - alpha**2) + alpha**2)
    used = (n_l > 0) & (v_h > 0)
    weight = np.where(used, 0.5 / np.where(used, smith, 1.0) * n_l * 4 * v_h / n_h, 0.0) / count
    return light, weight


def hits(point: F64, directions: F64, light: RectLight) -> NDArray[np.bool_]:
    center, u, v = (np.asarray(x, np.float64) for x in (light.center, light.edge_u, light.edge_v))
    facing = np.cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((center - point) @ facing) / (directions @ facing)
        at = point + t[:, None] * directions - center
        share = np.stack([at @ u, at @ v], -1) @ np.linalg.inv([[u @ u, u @ v], [u @ v, v @ v]])
        return (t > 0) & (np.abs(share) < 0.5).all(-1)


def is_in_plane(point: F64, light: RectLight) -> bool:
    """Whether a point counts as in the rectangle's plane, where nothing of it arrives."""
    u, v = np.asarray(light.edge_u), np.asarray(light.edge_v)
    distance = abs((point - np.asarray(light.center)) @ unit(np.cross(u, v)))
    return bool(distance <= IN_PLANE * 0.5 * (np.linalg.norm(u) + np.linalg.norm(v)))


@pytest.mark.parametrize("degrees", sorted(MAX_ERRORS))
def test_highlights_are_the_lobes_integral(degrees: float) -> None:
    """For each roughness and light, relative to the largest value on its floor of any light of that size."""
    lights, images = lights_at(degrees), {}
    for name, light in lights.items():
        images[name], camera = draw_strips(degrees, light)
    first = images["narrow, mirrored"]
    position = first["position"].astype(np.float64)
    errors = {}
    for i, roughness in enumerate(ROUGHNESSES):
        pixels = pixels_of(i, first)
        exact = {name: np.zeros(len(pixels)) for name in lights}
        for k, (y, x) in enumerate(pixels):
            directions, weight = lobe_samples(position[y, x], np.asarray(camera.eye), roughness**2)
            once = lobe_albedo(roughness**2, unit(np.asarray(camera.eye) - position[y, x])[1])  # as in the shader
            for name, light in lights.items():
                is_dark = is_in_plane(position[y, x], light)
                exact[name][k] = 0 if is_dark else weight / once @ hits(position[y, x], directions, light)
        for name in lights:
            found = images[name]["specular"][pixels[:, 0], pixels[:, 1], 1].astype(np.float64)
            largest = max(exact[other].max() for other in lights if other.split(",")[0] == name.split(",")[0])
            errors[roughness, name] = float(np.abs(found - exact[name]).max()) / largest
    print(f"{degrees}°", {key: f"{error:.2%}" for key, error in errors.items()})
    assert max(errors.values()) < MAX_ERRORS[degrees]


@pytest.mark.parametrize("degrees", [0, 30, 60, 75, 85, 88])
@pytest.mark.parametrize("f0", [1.0, 0.04])
def test_a_light_all_around_reflects_the_directional_albedo(degrees: int, f0: float) -> None:
    """The furnace: a pane so large that it fills the hemisphere. Nothing of it is lost where F0 is 1."""
    images, camera = draw_strips(degrees, AROUND, f0)
    for i, roughness in enumerate(ROUGHNESSES):
        y, x = pixels_of(i, images)[5]
        point, eye = images["position"][y, x].astype(np.float64), np.asarray(camera.eye)
        directions, weight = lobe_samples(point, eye, roughness**2, 2**17)
        v = unit(eye - point)
        fresnel = f0 + (1 - f0) * (1 - np.clip(unit(directions + v) @ v, 0, 1)) ** 5
        found, once = float(images["specular"][y, x, 1]), weight.sum()
        assert found == pytest.approx(weight @ fresnel * (1 + f0 * (1 / once - 1)), rel=0.012), roughness
        assert found <= 1.01


@pytest.mark.parametrize(("roughness", "degrees", "bound"), [
    (0.15, 88.0, 0.008), (0.2, 88.0, 0.013), (0.67, 87.5, 0.024), (0.82, 80.0, 0.012), (0.87, 88.0, 0.008),
    (0.975, 84.5, 0.01), (0.975, 87.5, 0.01)])
def test_roughnesses_between_those_of_the_table(roughness: float, degrees: float, bound: float) -> None:
    """Between rows and columns of the table, whose parameters must be of one kind to be interpolated."""
    errors, largest = {}, 0.0
    camera = seen_at(degrees, 0.2)
    for name, light in lights_at(degrees).items():
        scene = without_shadows(make_scene([floor(2.0, material=mirror(roughness))], [light]))
        images = draw(scene, (32, 24), ("specular", "position", "depth"), camera)
        seen = np.argwhere(images["depth"][..., 0] > 0)[::25]
        assert len(seen) > 20
        points = images["position"].astype(np.float64)[seen[:, 0], seen[:, 1]]
        samples = [lobe_samples(point, np.asarray(camera.eye), roughness**2) for point in points]
        once = [lobe_albedo(roughness**2, unit(np.asarray(camera.eye) - point)[1]) for point in points]
        exact = np.array([weight @ hits(point, directions, light)
                          for point, (directions, weight) in zip(points, samples, strict=True)]) / once
        errors[name] = float(np.abs(images["specular"][seen[:, 0], seen[:, 1], 1] - exact).max())
        largest = max(largest, float(exact.max()))
    print(f"{degrees}°", {name: f"{error / largest:.2%}" for name, error in errors.items()})
    assert max(errors.values()) < bound * largest


@pytest.mark.parametrize("degrees", [1e-4, 86.5, 88.0, 89.0, 89.9])
def test_no_view_makes_energy_or_a_hole(degrees: float) -> None:
    """Straight down, where no plane of incidence is defined, and nearly along the floor."""
    lanes = [quad((0.1 * i - 0.25, 0, 30.0), (0.1, 0, 0), (0, 0, -60.0), mirror(roughness))
             for i, roughness in enumerate((0.0, *ROUGHNESSES))]
    scene = without_shadows(make_scene(lanes, [AROUND]))
    images = draw(scene, (40, 16), ("specular", "depth"), seen_at(degrees, 20.0, 1.0))
    found = images["specular"][images["depth"][..., 0] > 0]
    assert len(found) > 100 and np.isfinite(found).all()
    assert found.max() <= 1.01 and found.min() > 0.9


def test_a_smooth_floor_mirrors_the_pane() -> None:
    """Inside its mirror image the radiance is the light's, outside it is 0."""
    light = RectLight((0.0, 1.0, 0.0), (1.0, 0, 0), (0, 0, 1.0), (3.0, 2.0, 1.0))
    scene = without_shadows(make_scene([floor(2.0, material=mirror(0.0))], [light]))
    images = draw(scene, (64, 48), ("specular", "position"), seen_at(50.0))
    eye = np.asarray(seen_at(50.0).eye)
    at = images["position"].astype(np.float64)
    ray = unit(at - eye) * [1, -1, 1]
    hit = at + ray / ray[..., 1:2]
    distance = np.abs(hit[..., [0, 2]]).max(-1) - 0.5
    assert (distance < -0.1).sum() > 20
    inside = images["specular"][distance < -0.1]
    np.testing.assert_allclose(inside, np.broadcast_to((3, 2, 1), inside.shape), rtol=0.01)
    assert images["specular"][distance > 0.1].max() < 0.02


def test_a_pane_shines_to_one_side_or_to_both_and_not_in_its_plane() -> None:
    def highlight(y: float, u: Point, v: Point, two_sided: bool) -> F64:
        light = RectLight((0.0, y, 0.0), u, v, (1.0,) * 3, two_sided=two_sided)
        scene = without_shadows(make_scene([floor(2.0, material=mirror(0.5))], [light]))
        return draw(scene, (32, 24), ("specular",), seen_at(40.0))["specular"].astype(np.float64)

    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    down = highlight(0.5, x, z, False)
    assert down.max() > 0.1
    np.testing.assert_array_equal(highlight(0.5, x, z, True), down)
    np.testing.assert_allclose(highlight(0.5, z, x, True), down, rtol=1e-3, atol=1e-4)
    assert not highlight(0.5, z, x, False).any()
    assert not highlight(-0.5, x, z, True).any()
    assert not highlight(0.0, x, z, True).any()
