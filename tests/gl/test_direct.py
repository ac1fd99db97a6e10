"""Direct light on a plane, without blockers, against closed forms and fine quadrature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from app.load import load_scene
from app.scene import Camera, DirectionalLight, Light, PointLight, RectLight, SpotLight
from tests.gl import closed_forms as exact
from tests.gl.closed_forms import F64
from tests.gl.scenes import draw, floor, make_scene
from tests.unit.load_helpers import Gltf

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

UP = (0.0, 1.0, 0.0)
SIZE = (96, 72)
ABOVE = Camera((1.0, 3.0, 2.5), (0.0, 0.0, 0.0), fov_y_deg=50.0)


def lit_plane(light: Light, camera: Camera = ABOVE) -> tuple[F64, F64]:
    """Irradiance [n] of a plane y = 0 of albedo 0.5, and where [n, 3]."""
    images = draw(make_scene([floor(4.0)], [light], camera), SIZE, ("direct", "position", "normal", "depth"))
    seen = images["depth"][..., 0] > 0
    assert seen.mean() > 0.5
    np.testing.assert_allclose(images["normal"][seen], np.broadcast_to(UP, (seen.sum(), 3)), atol=2e-3)
    return images["direct"][seen][:, 1] * np.pi / 0.5, images["position"][seen].astype(np.float64)


def worst(found: F64, reference: F64, floor_share: float = 0.0) -> float:
    """Largest relative error; the reference counts as at least ``floor_share`` of its maximum."""
    error = float((np.abs(found - reference) / np.maximum(reference, floor_share * reference.max())).max())
    print(f"DIRECT worst error {error:.3%}")
    return error


@pytest.mark.parametrize("position", [(0.3, 1.0, -0.2), (-2.0, 0.3, 1.0), (0.0, 40.0, 0.0)])
@pytest.mark.parametrize("intensity", [1e-3, 1.0, 1e4])
def test_point(position: tuple[float, float, float], intensity: float) -> None:
    found, at = lit_plane(PointLight(position, (intensity,) * 3))
    reference = intensity * exact.point_irradiance(at, UP, position)
    assert worst(found, reference, 1e-4) < 0.005


@pytest.mark.parametrize(("center", "u", "v"), [
    ((0.0, 1.5, 0.0), (1.0, 0, 0), (0, 0, 1.0)),
    ((0.5, 0.4, -0.3), (2.0, 0, 0), (0, 0, 0.5)),
    ((-1.0, 1.0, -1.0), (0.6, 0.6, 0), (0, 0, 1.0)),
    ((0.0, 9.0, 3.0), (3.0, 0, 0), (0, 0, 5.0)),
])
def test_rectangle(center: tuple[float, float, float], u: tuple[float, float, float],
                   v: tuple[float, float, float]) -> None:
    found, at = lit_plane(RectLight(center, u, v, (2.0, 2.0, 2.0)))  # u × v looks down
    reference = 2 * exact.polygon_irradiance(at, UP, corners(center, u, v))
    front = (at - np.asarray(center)) @ np.cross(u, v) > 0.02
    assert front.mean() > 0.3
    assert worst(found[front], reference[front], 1e-4) < 0.005


@pytest.mark.parametrize(("center", "u", "v"), [
    ((0.0, 0.0, -0.5), (1.5, 0, 0), (0, 1.0, 0)),
    ((0.0, 0.2, -0.5), (1.5, 0, 0), (0, 1.0, 0.3)),
    ((0.3, 0.1, 0.0), (0.8, 0.5, 0), (-0.5, 0.8, 0.2)),
    ((0.0, -0.2, -1.0), (1.5, 0.9, 0), (-0.3, 1.0, 0)),
])
def test_rectangle_across_the_horizon(center: tuple[float, float, float], u: tuple[float, float, float],
                                      v: tuple[float, float, float]) -> None:
    found, at = lit_plane(RectLight(center, u, v, (2.0, 2.0, 2.0), two_sided=True))
    away = np.flatnonzero(np.abs((at - np.asarray(center)) @ exact.unit(np.cross(u, v))) > 0.15)[::41]
    reference = 2 * exact.rectangle_quadrature(at[away], UP, corners(center, u, v), 300)
    assert worst(found[away], reference, 1e-3) < 0.01


def test_rectangle_shines_to_one_side_or_to_both() -> None:
    center, u, v = (0.0, 0.6, 0.0), (0.6, 0.8, 0), (0, 0, 1.0)  # upright, tilted
    two, at = lit_plane(RectLight(center, u, v, (1.0,) * 3, two_sided=True))
    one, _ = lit_plane(RectLight(center, u, v, (1.0,) * 3))
    other, _ = lit_plane(RectLight(center, v, u, (1.0,) * 3))
    side = (at - np.asarray(center)) @ np.cross(u, v)
    assert (one[side < -1e-3] == 0).all() and (other[side > 1e-3] == 0).all()
    assert (two[np.abs(side) > 0.02] > 0).all()
    np.testing.assert_allclose(one + other, two, rtol=2e-3, atol=1e-3 * float(two.max()))


def test_rectangle_does_not_light_the_surface_that_shows_it() -> None:
    light = RectLight((0.3, 0.0, 0.2), (1.1, 0.0, 0.3), (-0.3, 0.0, 1.1), (2.0,) * 3, two_sided=True)
    assert lit_plane(light)[0].max() == 0


@pytest.mark.parametrize(("inner", "outer"), [(0.0, 30.0), (10.0, 40.0), (25.0, 25.0), (20.0, 75.0)])
def test_spot_falls_off_linearly_in_angle(inner: float, outer: float) -> None:
    position, direction = np.array([0.5, 1.5, 0.5]), exact.unit(np.array([-0.3, -1.0, -0.2]))
    found, at = lit_plane(SpotLight(tuple(position), tuple(direction), (3.0, 3.0, 3.0), inner, outer))
    ray = exact.unit(at - position)
    angle = np.degrees(np.arccos(ray @ direction))
    falloff = np.clip((outer - angle) / (outer - inner), 0, 1) if outer > inner else angle <= outer
    reference = 3 * exact.point_irradiance(at, UP, position) * falloff
    clear = np.abs(angle - outer) > 0.2
    assert worst(found[clear], reference[clear], 0.05) < 0.005


def test_directional() -> None:
    direction = np.array([0.4, -0.8, 0.3])
    found, _ = lit_plane(DirectionalLight(tuple(direction), (2.0, 2.0, 2.0)))
    reference = np.full(found.shape, 2 * -exact.unit(direction)[1])
    assert worst(found, reference) < 0.005


@pytest.mark.parametrize(("height", "radius"), [(1.0, 0.5), (0.2, 0.5), (0.0, 0.4), (-0.2, 0.5)])
def test_sphere_above_and_across_the_horizon(height: float, radius: float) -> None:
    center = np.array([0.2, height, -0.1])
    found, at = lit_plane(PointLight(tuple(center), (1.0, 1.0, 1.0), radius))
    outside = np.flatnonzero(np.linalg.norm(at - center, axis=1) > 1.05 * radius)[::97]
    reference = exact.sphere_quadrature(at[outside], UP, center, radius)
    assert worst(found[outside], reference, 1e-3) < 0.01


def corners(center: tuple[float, float, float], u: tuple[float, float, float], v: tuple[float, float, float]) -> F64:
    c, a, b = (np.asarray(x, np.float64) / n for x, n in ((center, 1), (u, 2), (v, 2)))
    return np.stack([c - a - b, c + a - b, c + a + b, c - a + b])


@pytest.mark.parametrize("double_sided", [False, True])
def test_what_a_bulb_sends_into_itself_lights_nothing_else(double_sided: bool, tmp_path: Path) -> None:
    """A small bulb with an open base lights the floor below like a closed one."""
    ball = trimesh.creation.icosphere(3, radius=0.03)
    found = []
    for faces in (ball.faces, ball.faces[ball.face_normals[:, 1] < 0.9]):
        gltf = Gltf()
        gltf.material(emissiveFactor=[1.0, 1.0, 1.0], doubleSided=double_sided)
        gltf.primitive["attributes"]["POSITION"] = gltf.array(np.add(ball.vertices, (0, 2, 0)).astype(np.float32))
        gltf.primitive["indices"] = gltf.array(faces.astype(np.uint16).ravel())
        corners = np.array([(-3, 0, -3), (-3, 0, 3), (3, 0, 3), (3, 0, -3)], np.float32)
        gltf.json["materials"].append({"pbrMetallicRoughness": {"metallicFactor": 0.0}})
        gltf.json["meshes"].append({"primitives": [{
            "attributes": {"POSITION": gltf.array(corners)}, "material": 1,
            "indices": gltf.array(np.array([0, 1, 2, 0, 2, 3], np.uint16))}]})
        gltf.json["nodes"].append({"mesh": 1, "name": "floor"})
        gltf.json["scenes"] = [{"nodes": [0, 1]}]
        scene = load_scene(gltf.save(tmp_path), studio=False)
        camera = Camera((0.0, 3.0, 4.0), (0.0, 0.0, 0.0), fov_y_deg=40.0)
        found.append(draw(scene, (64, 48), ("direct",), camera)["direct"])
    assert abs(found[1].mean() / found[0].mean() - 1) < 0.05
