"""What specular surfaces do with light: none is lost or made, in the picture and in bounces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.math3d import translation
from app.network.selection import find_model
from app.scene import Camera, Environment, Instance, Material, PointLight, Scene, bounds_of
from app.simple_meshes import ball
from tests.gl.scenes import box, draw, floor, make_scene, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SKY = 0.5
WHITE = Environment(np.full((4, 8, 3), SKY, np.float32))
CAMERA = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov_y_deg=35.0)


def sphere(material: Material) -> Scene:
    """Alone under an even sky."""
    meshes, instances = (ball("ball", 0, 1.0, 48),), (Instance("ball", 0, translation(np.zeros(3))),)
    scene = make_scene([floor(1.0)], camera=CAMERA)
    return replace(scene, meshes=meshes, instances=instances, materials=(material,), environment=WHITE,
                   bounds=bounds_of(meshes, instances))


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
def test_a_white_metal_sphere_disappears_in_a_white_environment(roughness: float) -> None:
    metal = Material(albedo=(1.0,) * 3, metallic=1.0, roughness=roughness)
    images = draw(sphere(metal), (96, 96), ("final", "depth"))
    assert 0.3 < (images["depth"] > 0).mean() < 0.8
    np.testing.assert_allclose(images["final"], SKY, rtol=0.02)


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.4, 0.5, 0.6, 0.8, 1.0])
def test_it_disappears_with_reflections_too(roughness: float, small_ember: Path) -> None:
    """Traced rays find the environment up to a roughness of 0.4, and direct light has it from 0.6 on."""
    metal = Material(albedo=(1.0,) * 3, metallic=1.0, roughness=roughness)
    images = draw(sphere(metal), (96, 96), ("final", "reflection"), model=small_ember)
    assert images["reflection"].any() == (roughness < 0.6)
    np.testing.assert_allclose(images["final"], SKY, rtol=0.02)


@pytest.mark.parametrize("f0", [0.04, 0.5])
@pytest.mark.parametrize("roughness", [0.05, 0.5, 1.0])
def test_a_white_sphere_never_outshines_the_sky(f0: float, roughness: float) -> None:
    """Its diffuse light makes way for what it reflects, so that it disappears as well; a grey one is darker."""
    white = Material(albedo=(1.0,) * 3, specular=(f0,) * 3, roughness=roughness)
    np.testing.assert_allclose(draw(sphere(white), (96, 96))["final"], SKY, rtol=0.02)
    assert draw(sphere(replace(white, albedo=(0.5,) * 3)), (96, 96))["final"].max() <= 1.01 * SKY


def test_a_surface_that_is_not_white_keeps_its_colour() -> None:
    """Where diffuse and specular light together are less than what arrives, there is nothing to take away."""
    painted = Material(albedo=(0.7, 0.4, 0.1), specular=(0.04,) * 3, roughness=0.5)
    scene = make_scene([floor(2.0, material=painted)], [PointLight((0.0, 1.0, 0.0), (1.0,) * 3)])
    albedo = draw(scene, (32, 24), ("albedo",), Camera((0.0, 2.0, 0.1), (0.0, 0.0, 0.0), fov_y_deg=20.0))["albedo"]
    np.testing.assert_allclose(albedo, np.broadcast_to((0.7, 0.4, 0.1), albedo.shape), rtol=2e-3)


@pytest.mark.parametrize("roughness", [0.05, 0.6])
@pytest.mark.parametrize("height", [0.02, 0.35, 1.0])
def test_a_highlight_is_no_brighter_than_its_sphere(height: float, roughness: float) -> None:
    """Also on surfaces close to the sphere and inside of it."""
    radius, intensity = 0.3, 2.0
    metal = Material(albedo=(1.0,) * 3, metallic=1.0, roughness=roughness)
    scene = without_shadows(make_scene([floor(2.0, material=metal)],
                                       [PointLight((0.0, height, 0.0), (intensity,) * 3, radius)]))
    camera = Camera((0.0, 0.6, 2.0), (0.0, 0.0, 0.0), fov_y_deg=50.0)
    specular = draw(scene, (96, 72), ("specular",), camera)["specular"]
    radiance = intensity / (np.pi * radius**2)
    assert 0.01 * radiance < specular.max() <= 1.02 * radiance


@pytest.mark.parametrize("roughness", [0.4, 1.0])
@pytest.mark.usefixtures("path_tracer")
def test_light_does_not_die_in_a_steel_room(roughness: float) -> None:
    """What a white floor gets of it by world surfels, against the path tracer."""
    from export.reference.path_tracer import PathTracer
    from export.reference.still import Still
    from export.reference.trace import mean_samples

    steel = Material(albedo=(0.56, 0.57, 0.58), metallic=1.0, roughness=roughness)
    parts = [box((-2, 0, -2), (4, 3, 4), steel), floor(1.95, 0.01, Material(albedo=(0.7,) * 3))]
    camera, size = Camera((0.0, 1.8, 1.5), (0.0, 0.0, -0.2), fov_y_deg=45.0), (64, 48)
    scene = make_scene(parts, [PointLight((0.3, 2.0, -0.2), (3.0,) * 3)], camera)
    images = draw(scene, size, ("indirect", "normal"), camera, find_model("ember"))  # type: ignore[arg-type]
    on_floor = images["normal"][..., 1] > 0.9
    reference = mean_samples(PathTracer(scene, max_bounces=32), Still(scene, camera, size), 64)["indirect"]
    ratio = images["indirect"][on_floor].mean() / reference[on_floor].mean()
    print(f"STEEL ROOM {roughness}: {ratio:.3f}")
    assert ratio == pytest.approx(1, abs=0.15)
