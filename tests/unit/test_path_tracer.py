"""All light that reaches the camera by the path tracer: highlights, emission and background, against integrals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the path tracer needs mitsuba")

from app.environment import radiance_along
from app.math3d import View
from app.scene import (
    Camera,
    DirectionalLight,
    EmissionPoints,
    Environment,
    Light,
    Material,
    PointLight,
    RectLight,
    Scene,
    SpotLight,
    Texture,
)
from export.reference.path_tracer import PathTracer, RadianceSamples
from export.reference.still import Still
from export.reference.trace import trace_reference
from tests.gl.closed_forms import F64, ggx_compensation, polygon_irradiance, unit
from tests.gl.scenes import box, floor, make_scene, quad

pytestmark = pytest.mark.usefixtures("path_tracer")

UP = np.array([0.0, 1.0, 0.0])
EYE = np.array([0.0, 2.0, 2.0])
CAMERA = Camera((0.0, 2.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=10.0)  # the middle of its image shows the origin
STEPS = 600  # of quadrature, along each axis
LIGHTS: dict[str, Light] = {
    "point": PointLight((0.1, 1.0, -1.0), (1.0, 0.5, 2.0)),
    "sphere": PointLight((0.1, 1.0, -1.0), (1.0, 0.5, 2.0), 0.3),
    "spot": SpotLight((0.1, 1.0, -1.0), (0.0, -0.8, 0.6), (1.0, 0.5, 2.0), 5.0, 30.0),
    "directional": DirectionalLight((-0.1, -1.0, 1.0), (1.0, 0.5, 2.0)),
    "sun": DirectionalLight((-0.1, -1.0, 1.0), (1.0, 0.5, 2.0), 4.0),
    "rectangle": RectLight((0.3, 1.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.7, 0.7), (2.0, 1.0, 3.0), two_sided=True),
    "pane": RectLight((0.0, 0.8, -1.2), (6.0, 0.0, 0.0), (0.0, 1.5, 0.0), (2.0, 1.0, 3.0)),
}


def radiance_samples(scene: Scene, count: int, at: tuple[float, float] = (0.5, 0.5)) -> RadianceSamples:
    """Without bounces, along one ray."""
    view = View.of(scene.cameras["main"].at(0.0), (64, 48), 1e-3)
    return PathTracer(scene, max_bounces=0).trace_radiance(view, np.tile(at, (count, 1)), seed=0)


def light_from(light: Light) -> tuple[F64, F64]:
    """Directions [N, 3] from the origin to the light, and radiance times solid angle that each stands for, [N, 3]."""
    middle = (np.arange(STEPS) + 0.5) / STEPS
    match light:
        case RectLight():
            u, v = np.array(light.edge_u), np.array(light.edge_v)
            points = np.array(light.center) + (middle[:, None, None] - 0.5) * u + (middle[:, None] - 0.5) * v
            points = points.reshape(-1, 3)
            square, facing = (points**2).sum(-1), np.cross(u, v)
            away = -(points @ facing)
            weight = (np.abs(away) if light.two_sided else np.maximum(away, 0)) / square**1.5 / STEPS**2
            return unit(points), weight[:, None] * np.array(light.radiance)
        case DirectionalLight():
            axis, color, factor = -unit(np.array(light.direction)), light.irradiance, 1.0
            sine = math.sin(math.radians(light.angular_radius_deg))
        case PointLight() | SpotLight():
            position = np.array(light.position)
            axis, distance, color = unit(position), float(np.linalg.norm(position)), light.intensity
            sine, factor = light.radius / distance, 1 / distance**2
            if isinstance(light, SpotLight):
                angle = math.degrees(math.acos(-axis @ unit(np.array(light.direction))))
                factor *= np.clip((light.outer_deg - angle) / (light.outer_deg - light.inner_deg), 0, 1)
    if sine == 0:
        return axis[None], factor * np.array(color)[None]
    height = 1 - math.sqrt(1 - sine**2)
    x = unit(np.cross(axis, UP))
    y = np.cross(axis, x)
    below, phi = height * middle[:, None, None], 2 * np.pi * middle[:, None]
    rays = (1 - below) * axis + np.sqrt(below * (2 - below)) * (np.cos(phi) * x + np.sin(phi) * y)
    solid_angle = 2 * np.pi * height / STEPS**2
    radiance = factor / (math.pi * sine**2) * np.array(color)
    return rays.reshape(-1, 3), np.broadcast_to(radiance * solid_angle, (STEPS**2, 3))


def reflected_highlight(light: Light, roughness: float, f0: float) -> F64:
    """Radiance that GGX with height-correlated Smith and Schlick's law sends from the origin to the camera, with light
    that is scattered more than once.
    """
    l, light_power = light_from(light)  # noqa: E741
    v, a2 = unit(EYE), max(roughness**2, 2e-3) ** 2
    h = unit(l + v)
    n_l, n_v, n_h, v_h = np.maximum(l @ UP, 0), v @ UP, h @ UP, h @ v
    distribution = a2 / (np.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
    smith = 0.5 / (n_l * np.sqrt(n_v**2 * (1 - a2) + a2) + n_v * np.sqrt(n_l**2 * (1 - a2) + a2))
    fresnel = f0 + (1 - f0) * (1 - v_h) ** 5
    return ggx_compensation(f0, math.sqrt(a2), v @ UP) * ((distribution * smith * fresnel * n_l) @ light_power)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("name", LIGHTS)
def test_highlights_match_integrals(name: str, roughness: float) -> None:
    material = Material(albedo=(0.0,) * 3, roughness=roughness, specular=(0.2,) * 3)
    samples = radiance_samples(make_scene([floor(4.0, material=material)], [LIGHTS[name]], CAMERA), 2**16)
    expected = reflected_highlight(LIGHTS[name], roughness, 0.2)
    assert expected.min() > 0
    np.testing.assert_allclose(samples.reflected.mean(axis=0, dtype=np.float64), expected, rtol=0.015)
    assert not samples.emitted.any(), "lights have no bodies"


def test_a_mirror_shows_the_light_itself() -> None:
    """With the light's own radiance, nearly without noise."""
    mirror = Material(albedo=(0.0,) * 3, roughness=0.05, specular=(1.0,) * 3)
    light = RectLight((0.0, 1.0, -1.0), (1.5, 0.0, 0.0), (0.0, 1.0, 1.0), (2.0, 1.0, 3.0), two_sided=True)
    samples = radiance_samples(make_scene([floor(4.0, material=mirror)], [light], CAMERA), 2**10)
    np.testing.assert_allclose(samples.reflected.mean(axis=0), light.radiance, rtol=0.01)
    assert (samples.reflected.std(axis=0) < 0.1 * np.array(light.radiance)).all()


def test_lights_hide_no_light_and_meshes_do() -> None:
    """Of two lights in one direction both are reflected; a wall before one of them hides that one."""
    mirror = Material(albedo=(0.0,) * 3, roughness=0.2, specular=(1.0,) * 3)
    near, far = (RectLight((0.0, d, -d), (d, 0.0, 0.0), (0.0, d / 2, d / 2), (1.0,) * 3, True) for d in (1.0, 2.0))
    wall = quad((-3, 0, -1.5), (6, 0, 0), (0, 4, 0))
    light = {}
    for name, parts, lights in (("near", (), [near]), ("far", (), [far]), ("both", (), [near, far]),
                                ("walled", (wall,), [near, far])):
        scene = make_scene([floor(4.0, material=mirror), *parts], lights, CAMERA)
        light[name] = radiance_samples(scene, 2**13).reflected.mean()
    assert light["both"] == pytest.approx(light["near"] + light["far"], rel=0.02)
    assert light["walled"] == pytest.approx(light["near"], rel=0.02)


def emissive(**options: object) -> Material:
    return Material(albedo=(0.0,) * 3, emission=(3.0, 2.0, 1.0), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("roughness", [0.2, 0.7])
def test_highlights_of_emissive_meshes(roughness: float) -> None:
    """Those that are no analytic lights; they are sampled by area, and by the lobe."""
    light = RectLight((0.3, 1.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.7, 0.7), (3.0, 2.0, 1.0), two_sided=True)
    panel = quad((-0.2, 0.65, -1.35), light.edge_u, light.edge_v, emissive())
    gloss = Material(albedo=(0.0,) * 3, roughness=roughness, specular=(0.2,) * 3)
    samples = radiance_samples(make_scene([floor(4.0, material=gloss), panel], camera=CAMERA), 2**16)
    np.testing.assert_allclose(samples.reflected.mean(axis=0, dtype=np.float64),
                               reflected_highlight(light, roughness, 0.2), rtol=0.015)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_a_furnace_returns_no_more_than_it_sends(roughness: float) -> None:
    """Amid walls of radiance 1, and under a sky of radiance 1, a perfect reflector disappears."""
    reflector = floor(0.5, material=Material(albedo=(0.0,) * 3, roughness=roughness, specular=(1.0,) * 3))
    walls = box((-3, -3, -3), (6, 6, 6), Material(albedo=(0.0,) * 3, emission=(1.0,) * 3))
    amid = make_scene([reflector, walls], camera=CAMERA)
    below = replace(make_scene([reflector], camera=CAMERA), environment=Environment(np.ones((4, 8, 3), np.float32)))
    seen, sky = (radiance_samples(scene, 2**14).reflected.mean() for scene in (amid, below))
    assert seen == pytest.approx(1, rel=0.015)
    assert seen == pytest.approx(sky, rel=0.01)


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_a_closed_room_of_white_metal_loses_no_light(roughness: float) -> None:
    """All of its walls emit 1 and reflect everything, so each bounce adds exactly 1, in all directions."""
    metal = Material(albedo=(1.0,) * 3, metallic=1.0, roughness=roughness, emission=(1.0,) * 3)
    scene = make_scene([box((-1, -1, -1), (2, 2, 2), metal)], camera=Camera((0.3, 0.2, 0.6), (-1.0, -0.4, -0.9)))
    view = View.of(scene.cameras["main"].at(0.0), (64, 48), 1e-3)
    for bounces in (0, 4):
        samples = PathTracer(scene, max_bounces=bounces).trace_radiance(view, np.full((2**13, 2), 0.5), seed=0)
        seen = samples.emitted.mean(axis=0, dtype=np.float64) + samples.reflected.mean(axis=0, dtype=np.float64)
        np.testing.assert_allclose(seen, 2 + bounces, rtol=0.03)


@pytest.mark.parametrize("material", [
    Material(albedo=(1.0,) * 3, roughness=0.1, specular=(0.04,) * 3),
    Material(albedo=(1.0,) * 3, roughness=0.6, specular=(0.5,) * 3),
    Material(albedo=(0.0, 1.0, 0.5), metallic=0.5, roughness=0.4, specular=(0.04,) * 3),
], ids=["polished", "half mirror", "half metal"])
def test_diffuse_and_specular_light_together_are_no_more_than_arrives(material: Material) -> None:
    """Under an even sky, from the normal to a grazing angle; what is white for both is as bright as the sky."""
    for height in (2.0, 0.5, 0.1):
        camera = Camera((0.0, height, 2.0), (0.0, 0.0, 0.0), fov_y_deg=1.0)
        scene = replace(make_scene([floor(1.0, material=material)], camera=camera),
                        environment=Environment(np.ones((4, 8, 3), np.float32)))
        seen = radiance_samples(scene, 2**14).reflected.mean(axis=0, dtype=np.float64)
        assert seen.max() < 1.015
        if min(material.albedo) == 1:
            np.testing.assert_allclose(seen, 1, rtol=0.015)


def test_a_mirror_shows_what_light_comes_back_from_a_wall() -> None:
    """Behind the camera, as that wall itself looks: direct light, and light that the wall reflects of the floor."""
    white = Material(albedo=(0.8, 0.5, 0.2))
    mirror = quad((-2, 0, -2), (4, 0, 0), (0, 3, 0), Material(albedo=(1.0,) * 3, metallic=1.0, roughness=0.0))
    wall = quad((2, 0, 2), (-4, 0, 0), (0, 3, 0), white)
    light = PointLight((0.0, 2.5, 0.5), (3.0,) * 3)
    ahead = Camera((0.0, 1.0, 0.0), (0.0, 1.0, -2.0), fov_y_deg=4.0)  # the mirror image of the one below
    behind = Camera((0.0, 1.0, -4.0), (0.0, 1.0, 2.0), fov_y_deg=4.0)
    seen = []
    for camera, parts in ((ahead, (mirror,)), (behind, ())):
        scene = make_scene([floor(2.0, material=white), wall, *parts], [light], camera)
        view = View.of(camera, (64, 48), 1e-3)
        samples = PathTracer(scene, max_bounces=2).trace_radiance(view, np.full((2**14, 2), 0.5), seed=0)
        seen.append(samples.reflected.mean(axis=0, dtype=np.float64))
    # With the mirror the wall is brighter, by the light that the mirror throws back.
    assert (seen[0] > seen[1]).all() and (seen[0] < 2 * seen[1]).all() and seen[1].min() > 0.02


def test_light_does_not_die_on_metal() -> None:
    """A white floor in a room of rough steel gets nearly as much light as from walls of the metal's mean albedo."""
    def light_on_floor(walls: Material) -> float:
        room = box((-1, 0, -1), (2, 2, 2), walls)
        camera = Camera((0.0, 1.5, 0.2), (0.0, 0.01, 0.0), fov_y_deg=4.0)
        white = floor(0.9, 0.01, Material(albedo=(0.8,) * 3))
        scene = make_scene([white, room], [PointLight((0.0, 1.0, 0.0), (1.0,) * 3)], camera)
        samples = PathTracer(scene, max_bounces=64).trace(View.of(camera, (64, 48), 1e-3), np.full((2**14, 2), 0.5), 0)
        return float(samples.multi.mean())

    steel = light_on_floor(Material(albedo=(0.6,) * 3, metallic=1.0, roughness=1.0))
    paint = light_on_floor(Material(albedo=(0.45,) * 3))  # 2 ∫ S(μ) μ dμ of that steel is 0.45
    assert steel == pytest.approx(paint, rel=0.25)


def test_the_visible_surface_shows_its_emission() -> None:
    """Once, also where a light stands for it, from the back only where that emits too, and through no other surface."""
    for options, back, expected in (({}, False, 1), ({}, True, 1), ({"double_sided": False}, False, 1),
                                    ({"double_sided": False}, True, 0), ({"is_light_proxy": True}, False, 1)):
        panel = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), emissive(**options))
        camera = replace(CAMERA, eye=(0.0, -2.0, 2.0)) if back else CAMERA
        lights = [RectLight((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0), (3.0, 2.0, 1.0), True)]
        samples = radiance_samples(make_scene([panel], lights if "is_light_proxy" in options else [], camera), 16)
        np.testing.assert_allclose(samples.emitted, np.tile(np.multiply(expected, (3.0, 2.0, 1.0)), (16, 1)), rtol=1e-5)
        assert not samples.reflected.any()
    lid = quad((-1, 0.5, 1), (2, 0, 0), (0, 0, -2), Material(albedo=(0.0,) * 3))
    assert not radiance_samples(make_scene([panel, lid], [], CAMERA), 16).emitted.any()


def test_emission_has_its_texture() -> None:
    pixels = np.zeros((1, 2, 4), np.float32)
    pixels[0, :, 0] = 0.25, 1.0
    panel = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), emissive(emission_map=Texture(pixels, repeat=(False, False))))
    scene = make_scene([panel], camera=replace(CAMERA, fov_y_deg=40.0))
    left, right = (radiance_samples(scene, 1, (x, 0.5)).emitted[0] for x in (0.2, 0.8))
    np.testing.assert_allclose(left, (0.75, 0, 0), atol=1e-4)
    np.testing.assert_allclose(right, (3.0, 0, 0), atol=1e-4)


def test_emission_and_background_are_averaged_over_each_pixel() -> None:
    """A pixel that an emissive edge halves is half as bright as the emission, half as the sky beside it."""
    sky = np.linspace([0.3, 0.5, 1.0], [1.2, 0.8, 0.5], 64, dtype=np.float32)[:, None]
    panel = quad((-1, -1, 0), (1, 0, 0), (0, 2, 0), emissive())  # up to x = 0
    camera = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=4.0)
    scene = replace(make_scene([panel], camera=camera), environment=Environment(sky, 30.0))
    reference = trace_reference(Still(scene, camera, (9, 1)), 512)
    final = reference.layers["final"][0]
    beyond = radiance_along(scene.environment, np.array([[0.0, 0.0, -1.0]]))[0]  # type: ignore[arg-type]
    np.testing.assert_allclose(final[:4], np.tile((3.0, 2.0, 1.0), (4, 1)), rtol=1e-4)
    np.testing.assert_allclose(final[5:], np.tile(beyond, (4, 1)), rtol=0.01)
    np.testing.assert_allclose(final[4], 0.5 * beyond + (1.5, 1.0, 0.5), rtol=0.1)
    assert reference.noise["final"] is not None and 0 < reference.noise["final"] < 0.05


def test_the_estimated_noise_covers_highlights() -> None:
    """Of the final picture, on a black surface that reflects nothing else."""
    gloss = Material(albedo=(0.0,) * 3, roughness=0.5, specular=(0.5,) * 3)
    scene = make_scene([floor(2.0, material=gloss)], [LIGHTS["pane"], LIGHTS["sphere"]], CAMERA)
    runs = [trace_reference(Still(scene, CAMERA, (16, 12)), 32, seed, 0) for seed in range(6)]
    final = np.stack([run.layers["final"] for run in runs]).astype(np.float64)
    estimated = np.sqrt(np.mean([run.noise["final"] ** 2 for run in runs]))  # type: ignore[operator]
    assert estimated == pytest.approx(np.sqrt(final.var(axis=0, ddof=1).mean()) / final.mean(), rel=0.15)


def test_the_denoiser_leaves_emission_and_background_sharp() -> None:
    """They have no noise to remove; only reflected light is denoised."""
    sky = np.random.default_rng(0).random((64, 128, 3), np.float32)
    panel = quad((-1, -1, 0), (1, 0, 0), (0, 2, 0), emissive())
    camera = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=60.0)
    still = Still(replace(make_scene([panel], camera=camera), environment=Environment(sky)), camera, (32, 24))
    raw, denoised = (trace_reference(still, 8, denoised=on).layers["final"] for on in (False, True))
    np.testing.assert_allclose(denoised, raw, atol=1e-3)


def test_light_of_emissive_meshes_is_direct_or_bounced_once() -> None:
    """As is asked for; the sum is the same."""
    panel = quad((-0.5, 1.0, -1.0), (1, 0, 0), (0, 0, 1), emissive())
    scene = make_scene([floor(2.0), panel, quad((-2, 0, -1.5), (4, 0, 0), (0, 2, 0))], camera=CAMERA)
    view = View.of(CAMERA, (64, 48), 1e-3)
    sums = []
    for direct in (False, True):
        samples = PathTracer(scene, emission_is_direct=direct).trace(view, np.full((2**14, 2), 0.5), seed=0)
        assert samples.direct.any() == direct
        assert samples.single.mean() < samples.multi.mean()
        sums.append((samples.direct + samples.multi).mean())
    assert sums[0] == pytest.approx(sums[1], rel=0.02)


def test_meshes_emit_what_lights_only_approximate() -> None:
    """Their light is direct and comes from their own shape, and they block light, unlike meshes that are a light."""
    panel = quad((-0.5, 1.0, -1.0), (1, 0, 0), (0, 0, 1), replace(emissive(), is_light_proxy=True))
    light = RectLight((0.0, 1.0, -0.5), (3.0, 0.0, 0.0), (0.0, 0.0, -3.0), (9.0, 9.0, 9.0), True)
    above = PointLight((0.0, 2.0, -1.0), (1.0, 1.0, 1.0))  # behind the panel, as seen from the origin
    scene = make_scene([floor(2.0), panel], [above, light], CAMERA)
    unused = EmissionPoints(*[np.zeros(0)] * 5)
    approximated = replace(scene, approximate_lights={light: unused}, approximated_materials=(1,))
    bare = replace(make_scene([floor(2.0), quad((-0.5, 1.0, -1.0), (1, 0, 0), (0, 0, 1), emissive())], [above], CAMERA))
    view = View.of(CAMERA, (64, 48), 1e-3)
    exact, seen, expected = (PathTracer(s, max_bounces=0, emission_is_direct=s is bare).trace(
        view, np.full((2**14, 2), 0.5), seed=0).direct.mean(axis=0) for s in (scene, approximated, bare))
    np.testing.assert_allclose(seen, expected, rtol=0.02)
    assert exact.mean() > 2 * seen.mean()


def test_what_is_cut_out_of_a_surface_does_not_emit() -> None:
    """A mask leaves half of a panel: its light is that of a panel of half the size."""
    pixels = np.ones((1, 2, 4), np.float32)
    pixels[0, 1, 3] = 0
    mask = replace(emissive(), albedo_map=Texture(pixels, repeat=(False, False), magnified="nearest"), alpha_cutoff=0.5)
    view, pixels_at = View.of(CAMERA, (64, 48), 1e-3), np.full((2**14, 2), 0.5)
    means = []
    for width, material in ((2.0, mask), (1.0, emissive())):
        scene = make_scene([floor(2.0), quad((-1.0, 1.0, -1.0), (width, 0, 0), (0, 0, 1), material)], camera=CAMERA)
        samples = PathTracer(scene, max_bounces=0, emission_is_direct=True).trace(view, pixels_at, seed=0)
        means.append(samples.direct.mean())
    assert means[0] == pytest.approx(means[1], rel=0.03)


def test_light_of_the_environment_is_direct() -> None:
    """A convex scene reflects it once and bounces nothing."""
    scene = replace(make_scene([floor(2.0)], camera=CAMERA), environment=Environment(np.ones((4, 8, 3), np.float32)))
    samples = PathTracer(scene).trace(View.of(CAMERA, (64, 48), 1e-3), np.full((2**16, 2), 0.5), seed=0)
    np.testing.assert_allclose(samples.direct.mean(axis=0), 1, rtol=0.02)
    assert not samples.single.any() and not samples.multi.any()


@pytest.mark.parametrize("height", [1e-3, 0.3])
@pytest.mark.parametrize("analytic", [True, False], ids=["rectangle", "mesh"])
def test_a_large_pane_gives_no_fireflies(analytic: bool, height: float) -> None:
    """However near it is: a diffuse surface reflects at most twice the radiance of the pane in one sample."""
    edge_u, edge_v = (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)
    light = RectLight((0.0, height, 0.0), edge_u, edge_v, (1.0,) * 3, two_sided=True)
    pane = quad((-1, height, -1), edge_u, edge_v, Material(albedo=(0.0,) * 3, emission=(1.0,) * 3))
    white = floor(4.0, material=Material(albedo=(1.0,) * 3))
    camera = Camera((0.0, height / 2, height / 2), (0.0, 0.0, 0.0), fov_y_deg=10.0)  # between floor and pane
    scene = make_scene([white] if analytic else [white, pane], [light] if analytic else [], camera)
    samples = PathTracer(scene, max_bounces=1).trace(View.of(camera, (64, 48), 1e-5), np.full((2**15, 2), 0.5), seed=0)
    unbounced = samples.direct[:, 0]
    corners = np.array([(-1, height, -1), (1, height, -1), (1, height, 1), (-1, height, 1)], np.float64)
    expected = polygon_irradiance(np.zeros((1, 3)), UP, corners)[0] / np.pi
    assert unbounced.mean(dtype=np.float64) == pytest.approx(expected, rel=0.03)
    assert unbounced.max() < 2.05
