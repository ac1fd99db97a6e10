"""Traced environment light: closed forms, occlusion, and agreement with the renderer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the path tracer needs mitsuba")

from app.math3d import View
from app.network.selection import UNSHADOWED
from app.scene import Camera, Environment, Scene
from export.reference.environment_tracer import EnvironmentSamples, EnvironmentTracer
from tests.gl.closed_forms import ggx_albedo
from tests.gl.scenes import F32, draw, floor, quad
from tests.gl.test_environment import DUSK, SIZE, under
from tests.gl.test_environment_shading import WHITE, glossy

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]


def shaded(scene: Scene, count: int = 2**16) -> EnvironmentSamples:
    """Samples through the centre of the image."""
    view = View.of(scene.cameras["main"].at(0.0), SIZE, 1e-3)
    return EnvironmentTracer(scene).shade(view, np.full((count, 2), 0.5), seed=0)


def tilted(degrees: float, material: object, environment: Environment = WHITE) -> Scene:
    angle = math.radians(degrees)
    eye = (0.0, 3 * math.cos(angle), 3 * math.sin(angle) + 1e-4)
    return under(environment, floor(4.0, material=material), camera=Camera(eye, (0, 0, 0), fov_y_deg=10.0))  # type: ignore[arg-type]


@pytest.mark.parametrize("roughness", [0.15, 0.5, 1.0])
@pytest.mark.parametrize("degrees", [0.0, 60.0])
def test_reflection_of_a_constant_environment_matches_quadrature(roughness: float, degrees: float) -> None:
    samples = shaded(tilted(degrees, glossy(roughness)))
    np.testing.assert_allclose(samples.diffuse.mean(axis=0), 0.7, rtol=0.02)
    expected = 0.7 * ggx_albedo(max(roughness**2, 2e-3), math.cos(math.radians(degrees)))
    np.testing.assert_allclose(samples.specular.mean(axis=0), expected, rtol=0.03)
    np.testing.assert_allclose(samples.specular_with_fresnel.mean(axis=0), 0.7, rtol=0.03)  # F0 is 1


def test_a_smooth_metal_mirrors_the_environment() -> None:
    """Seen from above: the radiance of the zenith, times F0."""
    samples = shaded(tilted(0.0, glossy(0.05, 0.8), DUSK))
    np.testing.assert_allclose(samples.specular.mean(axis=0), DUSK.radiance[0, 0], rtol=0.05)
    np.testing.assert_allclose(samples.specular_with_fresnel.mean(axis=0), 0.8 * DUSK.radiance[0, 0], rtol=0.05)


def test_a_wall_that_hides_half_of_the_environment_halves_its_light() -> None:
    """At the foot of an infinite wall."""
    scene = under(WHITE, floor(1.0, material=glossy(0.6, 0.5, 0.5)), quad((-1e3, 0, 0), (2e3, 0, 0), (0, 1e3, 0)),
                  camera=Camera((0, 0.3, 1e-2), (0, 0, 1e-2), (0, 0, -1), 5.0))
    samples = shaded(scene)
    np.testing.assert_allclose(samples.diffuse.mean(axis=0), 0.35, rtol=0.03)
    open_sky = shaded(replace(scene, meshes=scene.meshes[:1], instances=scene.instances[:1]))
    for name in ("specular", "specular_with_fresnel"):
        half, whole = (getattr(result, name).mean(axis=0) for result in (samples, open_sky))
        np.testing.assert_allclose(half, 0.5 * whole, rtol=0.05)


def test_multiple_importance_sampling_of_a_small_sun_has_little_noise() -> None:
    """On a rough and on a smooth floor."""
    radiance = np.full((64, 128, 3), 0.1, np.float32)
    radiance[10:12, 60:64] = 500.0
    for roughness in (0.2, 0.7):
        scene = tilted(32.0, glossy(roughness), Environment(radiance))
        samples = shaded(scene, 2**14).specular[:, 0].astype(float).reshape(4, -1).mean(axis=1)
        assert samples.std() < 0.05 * samples.mean()


def test_unshadowed_shading_is_the_same_without_occluders() -> None:
    material = glossy(0.7, 0.5, 0.4)
    scene = tilted(25.0, material, DUSK)
    samples, drawn = shaded(scene), draw(scene, SIZE, ("direct", "specular"), model=UNSHADOWED)

    def middle(image: F32) -> F32:
        return image[SIZE[1] // 2, SIZE[0] // 2]

    np.testing.assert_allclose(middle(drawn["direct"]), 0.4 * samples.diffuse.mean(axis=0), rtol=0.08)
    specular = (samples.reflectance * samples.specular).mean(axis=0)
    np.testing.assert_allclose(middle(drawn["specular"]), specular, rtol=0.12)
    np.testing.assert_allclose(specular, samples.specular_with_fresnel.mean(axis=0), rtol=0.1)


def test_diffuse_materials_have_no_specular_reflection() -> None:
    """Neither traced nor rendered, not even at grazing angles, beside a specular material."""
    diffuse = replace(glossy(0.2, 0.0, 0.3))
    polished = quad((-1, 0.01, -1), (0.2, 0, 0), (0, 0, 0.2), glossy(0.3))
    scene = under(WHITE, floor(3.0, material=diffuse), polished,
                  camera=Camera((0, 0.3, 2.9), (0, 0, 0), fov_y_deg=10.0))
    samples = shaded(scene, 256)
    assert not samples.reflectance.any() and not samples.specular_with_fresnel.any() and samples.diffuse.any()
    assert not draw(scene, SIZE, ("specular",), model=UNSHADOWED)["specular"][SIZE[1] // 2, SIZE[0] // 2].any()


def test_each_mesh_has_its_own_roughness() -> None:
    parts = (floor(1.0, material=glossy(0.3, 0.2, 0.5)),
             quad((-1, 0.5, -1), (0.5, 0, 0), (0, 0, 2), glossy(0.9, 0.7, 0.1)))
    scene = under(WHITE, *parts, camera=Camera((0, 3, 1e-3), (0, 0, 0), fov_y_deg=30.0))
    tracer = EnvironmentTracer(replace(scene))
    view = View.of(scene.cameras["main"].at(0.0), SIZE, 1e-3)
    samples = tracer.shade(view, np.array([[0.5, 0.5], [0.2, 0.5]]), seed=1)
    def reflectance(f0: float, roughness: float) -> float:
        once = ggx_albedo(roughness**2, 1.0)
        return (f0 + (1 - f0) * ggx_albedo(roughness**2, 1.0, schlick=True) / once) * (1 + f0 * (1 / once - 1))

    expected = [reflectance(0.2, 0.3), reflectance(0.7, 0.9)]
    np.testing.assert_allclose(samples.reflectance[:, 0], expected, rtol=0.01)
    np.testing.assert_allclose(samples.albedo[:, 0], [0.5, 0.1], atol=0.01)
