"""The path tracer's light straight from an environment: closed forms, occlusion, and what it agrees with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("mitsuba", reason="the path tracer needs mitsuba")

from app.math3d import View
from app.network.contract import UNSHADOWED
from app.scene import Camera, Environment, Scene
from export.reference import trace
from export.reference.environment_tracer import EnvironmentSamples, EnvironmentTracer
from export.reference.still import Still
from tests.gl.scenes import F32, draw, floor, quad
from tests.gl.test_environment import DUSK, SIZE, under
from tests.gl.test_environment_shading import WHITE, has_specular, reflected

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]


def shaded(scene: Scene, count: int = 2**16) -> EnvironmentSamples:
    """Samples through the picture's middle."""
    view = View.of(scene.cameras["main"].at(0.0), SIZE, 1e-3)
    return EnvironmentTracer(scene).shade(view, np.full((count, 2), 0.5), seed=0)


def tilted(degrees: float, material: object, environment: Environment = WHITE) -> Scene:
    angle = math.radians(degrees)
    eye = (0.0, 3 * math.cos(angle), 3 * math.sin(angle) + 1e-4)
    return under(environment, floor(4.0, material=material), camera=Camera(eye, (0, 0, 0), fov_y_deg=10.0))  # type: ignore[arg-type]


@pytest.mark.parametrize("roughness", [0.15, 0.5, 1.0])
@pytest.mark.parametrize("degrees", [0.0, 60.0])
def test_an_even_sky_is_reflected_as_quadrature_has_it(roughness: float, degrees: float) -> None:
    found = shaded(tilted(degrees, has_specular(roughness)))
    np.testing.assert_allclose(found.diffuse.mean(axis=0), 0.7, rtol=0.02)
    expected = 0.7 * reflected(max(roughness**2, 2e-3), math.cos(math.radians(degrees)))
    np.testing.assert_allclose(found.specular.mean(axis=0), expected, rtol=0.03)
    np.testing.assert_allclose(found.highlight, found.specular, rtol=1e-4, atol=1e-6)  # F0 is 1


def test_a_smooth_metal_mirrors_the_sky() -> None:
    """Straight down and up again: what is overhead, times F0."""
    found = shaded(tilted(0.0, has_specular(0.05, 0.8), DUSK))
    np.testing.assert_allclose(found.specular.mean(axis=0), DUSK.radiance[0, 0], rtol=0.05)
    np.testing.assert_allclose(found.highlight.mean(axis=0), 0.8 * DUSK.radiance[0, 0], rtol=0.05)


def test_half_a_sky_behind_a_wall_gives_half_the_light() -> None:
    """At the foot of a wall without end."""
    scene = under(WHITE, floor(1.0, material=has_specular(0.6, 0.5, 0.5)), quad((-1e3, 0, 0), (2e3, 0, 0), (0, 1e3, 0)),
                  camera=Camera((0, 0.3, 1e-2), (0, 0, 1e-2), (0, 0, -1), 5.0))
    found = shaded(scene)
    np.testing.assert_allclose(found.diffuse.mean(axis=0), 0.35, rtol=0.03)
    away = shaded(replace(scene, meshes=scene.meshes[:1], instances=scene.instances[:1]))
    np.testing.assert_allclose(found.specular.mean(axis=0), 0.5 * away.specular.mean(axis=0), rtol=0.05)
    np.testing.assert_allclose(found.highlight.mean(axis=0), 0.5 * away.highlight.mean(axis=0), rtol=0.05)


def test_a_bright_spot_is_found_by_both_ways_of_looking() -> None:
    """A sun on a rough and on a smooth floor: the balance heuristic leaves little noise."""
    radiance = np.full((64, 128, 3), 0.1, np.float32)
    radiance[10:12, 60:64] = 500.0
    for roughness in (0.2, 0.7):
        scene = tilted(32.0, has_specular(roughness), Environment(radiance))
        found = shaded(scene, 2**14).specular[:, 0].astype(float).reshape(4, -1).mean(axis=1)
        assert found.std() < 0.05 * found.mean()


def test_coarse_shading_is_the_same_where_nothing_is_hidden() -> None:
    material = has_specular(0.7, 0.5, 0.4)
    scene = tilted(25.0, material, DUSK)
    found, drawn = shaded(scene), draw(scene, SIZE, ("direct", "specular"), model=UNSHADOWED)

    def middle(image: F32) -> F32:
        return image[SIZE[1] // 2, SIZE[0] // 2]

    np.testing.assert_allclose(middle(drawn["direct"]), 0.4 * found.diffuse.mean(axis=0), rtol=0.08)
    made = (found.reflectance * found.specular).mean(axis=0)
    np.testing.assert_allclose(middle(drawn["specular"]), made, rtol=0.12)
    np.testing.assert_allclose(made, found.highlight.mean(axis=0), rtol=0.1)


def test_dull_materials_reflect_no_sky() -> None:
    """Neither traced nor drawn, not even at the rim, beside one that does."""
    dull = replace(has_specular(0.2, 0.0, 0.3))
    scene = under(WHITE, floor(3.0, material=dull), quad((-1, 0.01, -1), (0.2, 0, 0), (0, 0, 0.2), has_specular(0.3)),
                  camera=Camera((0, 0.3, 2.9), (0, 0, 0), fov_y_deg=10.0))
    found = shaded(scene, 256)
    assert not found.reflectance.any() and not found.highlight.any() and found.diffuse.any()
    assert not draw(scene, SIZE, ("specular",), model=UNSHADOWED)["specular"][SIZE[1] // 2, SIZE[0] // 2].any()


def test_highlights_of_a_reference_are_traced_in_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rays at once, and other ones for another seed."""
    camera = Camera((0.0, 1.0, 3.0), (0.0, 0.4, 0.0), fov_y_deg=50.0)
    still = Still(under(DUSK, floor(2.0, material=has_specular(0.3, 0.5)), camera=camera), camera, SIZE)
    whole = trace.sky_highlights(still)
    rays = []
    shade = EnvironmentTracer.shade

    def counted(self: EnvironmentTracer, view: View, pixels: NDArray[np.float64], seed: int) -> EnvironmentSamples:
        rays.append(len(pixels))
        return shade(self, view, pixels, seed)

    most = 5 * trace.SKY_SAMPLES * trace.SUPERSAMPLING**2 * SIZE[0]  # which does not divide the height
    monkeypatch.setattr(trace, "RAYS_AT_ONCE", most)
    monkeypatch.setattr(EnvironmentTracer, "shade", counted)
    strips, other = (trace.sky_highlights(still, seed) for seed in (0, 1))
    assert len(rays) == 2 * -(-SIZE[1] // 5) and max(rays) <= most
    for found in (strips, other):
        assert found.shape == whole.shape and (found != whole).any()
        np.testing.assert_allclose(found, whole, rtol=0.15, atol=0.02)
    assert (strips != other).any()


def test_each_mesh_has_its_own_roughness() -> None:
    parts = floor(1.0, material=has_specular(0.3, 0.2, 0.5)), quad((-1, 0.5, -1), (0.5, 0, 0), (0, 0, 2), has_specular(0.9, 0.7, 0.1))
    scene = under(WHITE, *parts, camera=Camera((0, 3, 1e-3), (0, 0, 0), fov_y_deg=30.0))
    tracer = EnvironmentTracer(replace(scene))
    view = View.of(scene.cameras["main"].at(0.0), SIZE, 1e-3)
    found = tracer.shade(view, np.array([[0.5, 0.5], [0.2, 0.5]]), seed=1)
    np.testing.assert_allclose(found.reflectance[:, 0], [0.2, 0.7], atol=0.01)
    np.testing.assert_allclose(found.albedo[:, 0], [0.5, 0.1], atol=0.01)
