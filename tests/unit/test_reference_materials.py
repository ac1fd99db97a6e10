"""The path tracer's materials, texel by texel, against closed forms."""

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
    Clearcoat,
    DirectionalLight,
    Environment,
    Light,
    Material,
    Mesh,
    Scene,
    Sheen,
    Texture,
    Transmission,
)
from export.reference.path_tracer import PathTracer, RadianceSamples
from export.reference.sheen import sheen_albedo
from tests.gl.closed_forms import F64, ggx_compensation, unit
from tests.gl.scenes import floor, make_scene, quad

pytestmark = pytest.mark.usefixtures("path_tracer")

TOP = Camera((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 30.0)
SLANTED = Camera((0.0, 2.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)  # the middle of its image shows the origin
OVERHEAD = DirectionalLight((0.0, -1.0, 0.0), (1.0, 1.0, 1.0))
BLACK = (0.0, 0.0, 0.0)
WHITE = (1.0, 1.0, 1.0)


def linear(*texels: tuple[float, ...]) -> np.ndarray:
    """One row of linear texels; alpha is 1 where it is left out."""
    return np.array([[(*t, 1.0)[:4] for t in texels]], np.float32)


def unlit_rgb(scene: Scene, at: tuple[float, float] = (0.5, 0.5), count: int = 1) -> F64:
    return radiance(scene, at, count).emitted.mean(axis=0, dtype=np.float64)


def radiance(scene: Scene, at: tuple[float, float] = (0.5, 0.5), count: int = 1) -> RadianceSamples:
    """Without bounces, along one ray of the scene's camera."""
    view = View.of(scene.cameras["main"].at(0.0), (48, 48), 1e-3)
    return PathTracer(scene, max_bounces=0).trace_radiance(view, np.tile(at, (count, 1)), seed=0)


def reflected(scene: Scene, count: int = 1) -> F64:
    return radiance(scene, count=count).reflected.mean(axis=0, dtype=np.float64)


def with_mesh(scene: Scene, **attributes: object) -> Scene:
    """The scene with other attributes of its first mesh; rows stand for all of its vertices."""
    mesh: Mesh = scene.meshes[0]
    arrays = {name: np.broadcast_to(np.asarray(v, np.float32), (len(mesh.positions), np.shape(v)[-1])).copy()
              for name, v in attributes.items()}
    return replace(scene, meshes=(replace(mesh, **arrays), *scene.meshes[1:]))


def lit_floor(material: Material, *lights: Light, camera: Camera = SLANTED) -> Scene:
    return make_scene([floor(1.0, material=material)], lights or [OVERHEAD], camera)


RAMP = linear((0.0, 0.1, 0.2), (1.0, 0.1, 0.2), (0.5, 0.1, 0.2), (0.25, 0.1, 0.2))


@pytest.mark.parametrize(("u", "options", "expected"), [
    (0.25, {}, 0.5), (0.125, {}, 0.0), (0.3125, {}, 0.75), (0.0, {}, 0.125), (1.375, {}, 1.0), (-0.625, {}, 1.0),
    (1.5, {"repeat": (False, True)}, 0.25), (-3.0, {"repeat": (False, True)}, 0.0),
    (0.3125, {"magnified": "nearest"}, 1.0), (0.2499, {"magnified": "nearest"}, 0.0),
    (1.2501, {"magnified": "nearest"}, 1.0), (0.0, {"transform": np.array([[2, 0, 0.375], [0, 1, 0], [0, 0, 1]])}, 1.0),
])
def test_textures_are_looked_up_as_their_sampler_says(u: float, options: dict[str, object], expected: float) -> None:
    material = Material(albedo=(0.5, 1.0, 1.0), albedo_map=Texture(RAMP, **options), is_unlit=True)  # type: ignore[arg-type]
    seen = unlit_rgb(with_mesh(lit_floor(material), uvs=(u, 0.5)))
    np.testing.assert_allclose(seen, (0.5 * expected, 0.1, 0.2), atol=2e-3)


def test_rows_begin_at_the_top_and_each_texture_has_its_own_uv_set() -> None:
    rows = np.ones((2, 1, 4), np.float32) * np.array([[[0.25]], [[0.75]]], np.float32)
    for uv_set, expected in ((0, 0.25), (1, 0.75)):
        material = Material(emission=WHITE, emission_map=Texture(rows, uv_set=uv_set))
        seen = unlit_rgb(with_mesh(lit_floor(material), uvs=(0.0, 0.75), second_uvs=(0.0, 0.25)))
        np.testing.assert_allclose(seen, expected, rtol=1e-3)
    without = unlit_rgb(with_mesh(lit_floor(material), uvs=(0.0, 0.75)))  # the second set is missing
    np.testing.assert_allclose(without, 1.0)


def test_colors_of_textures_and_vertices_are_multiplied() -> None:
    pixels = np.full((1, 1, 4), 188, np.uint8)  # sRGB of 0.503
    for is_color, texel in ((True, 0.5029), (False, 188 / 255)):
        material = Material(albedo=(0.5, 1.0, 1.0), albedo_map=Texture(pixels, is_color=is_color), is_unlit=True)
        seen = unlit_rgb(with_mesh(lit_floor(material), uvs=(0, 0), colors=(1.0, 0.5, 0.25, 1.0)))
        np.testing.assert_allclose(seen, np.multiply((0.5, 0.5, 0.25), texel), rtol=2e-3)


def highlight(n: F64, v: F64, l: F64, roughness: float, f0: F64) -> F64:  # noqa: E741
    """GGX with height-correlated Smith, Schlick's law and multiple scattering, times the cosine of ``l``."""
    a2, h = roughness**4, unit(l + v)
    n_l, n_v, n_h = n @ l, n @ v, n @ h
    distribution = a2 / (math.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
    smith = 0.5 / (n_l * math.sqrt(n_v**2 * (1 - a2) + a2) + n_v * math.sqrt(n_l**2 * (1 - a2) + a2))
    return ggx_compensation(f0, roughness**2, n_v) * distribution * smith * n_l * (f0 + (1 - f0) * (1 - v @ h) ** 5)


UP, TOWARDS = np.array([0.0, 1.0, 0.0]), unit(np.array([0.0, 1.0, 1.0]))


def test_metals_reflect_their_color_where_the_map_says_so() -> None:
    base = np.array((0.9, 0.5, 0.1))
    for metallic in (0.0, 0.4, 1.0):
        numbers = Texture(linear((0.0, 0.5, metallic)), is_color=False)
        reflectance = Texture(linear((1.0, 0.5, 1.0, 0.5)))
        material = Material(albedo=tuple(base), metallic=1.0, roughness=0.8, specular=(0.04,) * 3,
                            metallic_roughness_map=numbers, specular_map=reflectance)
        seen = reflected(with_mesh(lit_floor(material), uvs=(0, 0)))
        dielectric = 0.04 * np.array((1.0, 0.5, 1.0)) * 0.5
        f0 = dielectric + metallic * (base - dielectric)
        expected = (1 - metallic) * base / math.pi + highlight(UP, TOWARDS, UP, 0.4, f0)
        np.testing.assert_allclose(seen, expected, rtol=2e-3)


def encoded(*normal: float) -> Texture:
    return Texture(linear(tuple(0.5 + 0.5 * x for x in unit(np.array(normal)))), is_color=False)


@pytest.mark.parametrize("handedness", [1.0, -1.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_normal_maps_tilt_the_shading_frame(handedness: float, mirrored: bool) -> None:
    """Tangent +x and bitangent ∓z of a floor; a mirrored instance mirrors both."""
    light = DirectionalLight((-1.0, -2.0, 1.5), WHITE)
    material = Material(albedo=WHITE, normal_map=encoded(0.3, 0.4, 1.0), normal_scale=0.5)
    scene = with_mesh(lit_floor(material, light), normals=UP, tangents=(1.0, 0.0, 0.0, handedness), uvs=(0, 0))
    normal = unit(np.array([0.15, 1.0, -0.2 * handedness]))
    if mirrored:
        instances = (replace(scene.instances[0], transform=np.diag([-1.0, 1.0, 1.0, 1.0])),)
        scene, normal = replace(scene, instances=instances), normal * (-1, 1, 1)
    expected = max(normal @ -unit(np.array(light.direction)), 0) / math.pi
    np.testing.assert_allclose(reflected(scene), expected, rtol=2e-3)


def test_mapped_normals_are_turned_on_the_back() -> None:
    light = DirectionalLight((-0.5, 1.0, 0.0), WHITE)
    material = Material(albedo=WHITE, normal_map=encoded(0.3, 0.0, 1.0))
    camera = replace(SLANTED, eye=(0.0, -2.0, 2.0))
    scene = with_mesh(lit_floor(material, light, camera=camera), normals=UP, tangents=(1, 0, 0, 1), uvs=(0, 0))
    expected = -unit(np.array([0.3, 1.0, 0.0])) @ -unit(np.array(light.direction)) / math.pi
    np.testing.assert_allclose(reflected(scene), expected, rtol=2e-3)


def test_no_light_passes_the_face_of_a_mapped_normal() -> None:
    """The mapped normal sees the light, the surface does not."""
    light = DirectionalLight((-1.0, 0.1, 0.0), WHITE)
    material = Material(albedo=WHITE, specular=WHITE, roughness=0.7, normal_map=encoded(1.0, 0.0, 0.5))
    scene = with_mesh(lit_floor(material, light), normals=UP, tangents=(1, 0, 0, 1), uvs=(0, 0))
    assert not reflected(scene).any()


@pytest.mark.parametrize("alpha", [0.0, 0.25, 1.0])
def test_blended_surfaces_cover_by_their_alpha(alpha: float) -> None:
    """What is seen, and the shadow: half of it by the factor, half by the vertices."""
    pane = Material(albedo=(1.0, 0.0, 0.0), alpha=math.sqrt(alpha), is_blended=True, is_unlit=True)
    wall = Material(albedo=(0.0, 1.0, 0.5), is_unlit=True)
    scene = make_scene([floor(1.0, 0.5, pane), floor(3.0, 0.0, wall)], camera=TOP)
    scene = with_mesh(scene, colors=(1, 1, 1, math.sqrt(alpha)))
    np.testing.assert_allclose(unlit_rgb(scene, count=2**14), (alpha, 1 - alpha, 0.5 * (1 - alpha)), atol=0.015)
    slanted = make_scene([floor(0.2, 0.5, pane), floor(3.0, 0.0, Material(albedo=WHITE))], [OVERHEAD], SLANTED)
    slanted = with_mesh(slanted, colors=(1, 1, 1, math.sqrt(alpha)))
    np.testing.assert_allclose(reflected(slanted, 2**14), (1 - alpha) / math.pi, atol=0.005)


def test_masks_cut_off_between_texels() -> None:
    """At the interpolated alpha; and a cut-out surface neither shows nor shades."""
    pixels = linear((1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0))
    lid = Material(albedo=(1.0, 0.0, 0.0), albedo_map=Texture(pixels, repeat=(False, False)), alpha_cutoff=0.75,
                   is_unlit=True)
    scene = make_scene([floor(1.0, 0.5, lid), floor(3.0, 0.0, Material(albedo=WHITE))], [OVERHEAD], TOP)
    for u, is_there in ((0.6, False), (0.65, True)):
        samples = radiance(with_mesh(scene, uvs=(u, 0.5)))
        assert samples.emitted.any() == is_there
        np.testing.assert_allclose(samples.reflected, 0 if is_there else 1 / math.pi, rtol=1e-3)


@pytest.mark.parametrize("is_unlit", [False, True])
def test_culled_backs_are_not_there(is_unlit: bool) -> None:
    """Not for the camera, and not for light where the surface is unlit."""
    lid = Material(albedo=(1.0, 0.0, 0.0), is_unlit=is_unlit, is_back_culled=True)
    for low, seen in ((True, 0.0), (False, 1.0)):
        corner, u = ((-1, 0.5, 1), (2, 0, 0)) if not low else ((1, 0.5, 1), (-2, 0, 0))
        scene = make_scene([quad(corner, u, (0, 0, -2), lid), floor(3.0, 0.0, Material(albedo=WHITE))], [OVERHEAD], TOP)
        samples = radiance(scene)
        np.testing.assert_allclose(samples.emitted[0], (seen * is_unlit, 0, 0), atol=1e-6)
        reflected = np.ones(3) * (1 - seen) if is_unlit else np.array([seen, 0, 0])  # by the floor, or by the lid
        np.testing.assert_allclose(samples.reflected[0], reflected / math.pi, rtol=1e-3, atol=1e-6)


def pane(**options: object) -> Material:
    """Smooth clear glass, without reflections unless asked for."""
    transmission = {k: options.pop(k) for k in tuple(options)
                    if k in ("ior", "thickness", "attenuation_color", "attenuation_distance", "factor", "factor_map")}
    return Material(**{"albedo": WHITE, "roughness": 0.0, **options},  # type: ignore[arg-type]
                    transmission=Transmission(**{"factor": 1.0, **transmission}))  # type: ignore[arg-type]


def test_a_thin_pane_tints_what_is_behind_it() -> None:
    wall = Material(albedo=(0.8, 0.6, 0.4), is_unlit=True)
    for f0 in (0.0, 0.1):
        glass = pane(albedo=(0.5, 1.0, 0.25), specular=(f0,) * 3, ior=2.0)
        scene = make_scene([floor(1.0, 0.5, glass), floor(3.0, 0.0, wall)], camera=TOP)
        np.testing.assert_allclose(unlit_rgb(scene), (1 - f0) * np.array((0.4, 0.6, 0.1)), rtol=1e-3)


def test_what_does_not_pass_is_reflected_diffusely() -> None:
    glass = pane(albedo=(0.5, 1.0, 0.25), factor=0.8, factor_map=Texture(linear((0.5, 0, 0)), is_color=False))
    scene = with_mesh(make_scene([floor(1.0, 0.5, glass)], [OVERHEAD], TOP), uvs=(0, 0))
    np.testing.assert_allclose(reflected(scene, 2**14), 0.6 * np.array((0.5, 1.0, 0.25)) / math.pi, rtol=0.02)


def test_glass_casts_a_tinted_shadow() -> None:
    glass = pane(albedo=(0.5, 1.0, 0.25))
    white = Material(albedo=WHITE)
    scene = make_scene([floor(0.2, 0.5, glass), floor(3.0, 0.0, white)], [OVERHEAD], SLANTED)
    np.testing.assert_allclose(reflected(scene), np.array((0.5, 1.0, 0.25)) / math.pi, rtol=1e-3)


def slab(material: Material, thickness: float, below: Material) -> Scene:
    """A slab of glass with its top at height 1 over a floor, seen slantwise."""
    top, bottom = floor(2.0, 1.0, material), quad((-2, 1 - thickness, -2), (4, 0, 0), (0, 0, 4), material)
    return make_scene([top, bottom, floor(8.0, 0.0, below)], [OVERHEAD], replace(SLANTED, target=(0.0, 0.0, 0.0)))


def test_a_volume_absorbs_along_the_refracted_path() -> None:
    below = Material(albedo=WHITE, is_unlit=True)
    for ior in (1.0, 1.5):
        glass = pane(ior=ior, thickness=1.0, attenuation_color=(0.5, 0.25, 1.0), attenuation_distance=0.25)
        length = 0.3 / math.sqrt(1 - (math.sin(math.pi / 4) / ior) ** 2)
        expected = np.array((0.5, 0.25, 1.0)) ** (length / 0.25)
        np.testing.assert_allclose(unlit_rgb(slab(glass, 0.3, below), count=64), expected, rtol=2e-3)


def test_a_slab_shifts_what_is_behind_it_by_refraction() -> None:
    """Snell's law; an index of 1 shifts nothing."""
    ramp = Texture(np.linspace(0, 1, 257, dtype=np.float32)[:, None, None].repeat(4, axis=2), repeat=(False, False))
    below = Material(albedo=WHITE, albedo_map=ramp, is_unlit=True)
    for ior in (1.0, 1.5):
        refracted = math.asin(math.sin(math.pi / 4) / ior)
        z = 0.5 * (1 - math.tan(refracted))  # the ray to the origin hits the floor behind it by that
        seen = unlit_rgb(slab(pane(ior=ior, thickness=1.0), 0.5, below))
        v = (8 - z) / 16  # of the floor's quad, from its front to its back
        np.testing.assert_allclose(seen, 1 - v, atol=3e-3)
        assert ior > 1 or abs(float(seen[0]) - 0.5) < 3e-3


@pytest.mark.parametrize("thickness", [0.0, 1.0])
def test_rough_glass_blurs_and_conserves(thickness: float) -> None:
    """Under an even sky it hides nothing but what the lobe's shadowing loses; a small spot behind it is blurred."""
    glass = pane(roughness=0.4, thickness=thickness)
    scene = make_scene([floor(1.0, material=glass)], camera=TOP)
    uniform = replace(scene, environment=Environment(np.ones((4, 8, 3), np.float32)))
    assert 0.9 < unlit_rgb(uniform, count=2**13).mean() < 1.0001
    sky = np.zeros((64, 128, 3), np.float32)
    sky[-2:] = 1.0  # straight down
    assert radiance_along(Environment(sky), -UP[None]).mean() == 1
    spot = replace(scene, environment=Environment(sky))
    assert 0.01 < unlit_rgb(spot, count=2**13).mean() < 0.9


def test_a_clearcoat_covers_the_base() -> None:
    strength = Texture(linear((0.5, 0, 0)), is_color=False)
    rough = Texture(linear((0, 0.5, 0)), is_color=False)
    coat = Clearcoat(1.0, 0.8, strength_map=strength, roughness_map=rough)
    material = Material(albedo=WHITE, emission=(1.0, 2.0, 3.0), clearcoat=coat)
    samples = radiance(with_mesh(lit_floor(material), uvs=(0, 0)))
    share = 1 - 0.5 * (0.04 + 0.96 * (1 - math.cos(math.pi / 4)) ** 5)
    np.testing.assert_allclose(samples.emitted[0], share * np.array((1.0, 2.0, 3.0)), rtol=1e-3)
    expected = share / math.pi + 0.5 * highlight(UP, TOWARDS, UP, 0.4, np.float64(0.04))
    np.testing.assert_allclose(samples.reflected[0], expected, rtol=2e-3)


def smith_lambda(cosine: float, alpha: float) -> float:
    """Of the distribution sin^(1/α), by Smith's integral: its mean projected backfacing area, as seen at ``cosine``."""
    theta, phi = (np.arange(2000) + 0.5) / 2000 * math.pi / 2, (np.arange(2000) + 0.5) / 2000 * 2 * math.pi
    density = (2 + 1 / alpha) * np.sin(theta) ** (1 / alpha) / (2 * math.pi)
    projected = math.sqrt(1 - cosine**2) * np.sin(theta)[:, None] * np.cos(phi) + cosine * np.cos(theta)[:, None]
    area = (np.maximum(-projected, 0) * (density * np.sin(theta))[:, None]).mean() * math.pi**2
    return float(area / cosine)


@pytest.mark.parametrize(("roughness", "tolerance"), [(0.6, 0.1), (1.0, 0.03)])  # of the paper's fit of Smith's term
def test_sheen_scatters_at_grazing_angles(roughness: float, tolerance: float) -> None:
    light = DirectionalLight((-1.0, -0.5, 0.0), WHITE)
    color = np.array((0.9, 0.5, 0.1))
    material = Material(albedo=BLACK, sheen=Sheen(tuple(color), roughness))
    l = -unit(np.array(light.direction))  # noqa: E741
    h = unit(l + TOWARDS)
    n_l, n_v, sine, power = l[1], TOWARDS[1], math.sqrt(1 - h[1] ** 2), roughness**-2
    shadowing = 1 + smith_lambda(n_l, roughness**2) + smith_lambda(n_v, roughness**2)
    expected = color * (2 + power) * sine**power / (2 * math.pi) / (4 * n_v * shadowing)
    np.testing.assert_allclose(reflected(lit_floor(material, light)), expected, rtol=tolerance)


def test_sheen_and_the_base_below_return_no_more_than_arrives() -> None:
    sky = Environment(np.ones((4, 8, 3), np.float32))
    for roughness in (0.3, 0.7, 1.0):
        material = Material(albedo=WHITE, sheen=Sheen(WHITE, roughness))
        scene = replace(make_scene([floor(1.0, material=material)], camera=SLANTED), environment=sky)
        assert 0.97 < reflected(scene, 2**15).mean() < 1.01
    assert sheen_albedo().max() <= 1


def test_occlusion_darkens_indirect_light_only() -> None:
    material = Material(albedo=WHITE, occlusion_map=Texture(linear((0.5, 0, 0)), is_color=False),
                        occlusion_strength=0.5)
    wall = quad((-1, 0, -0.5), (2, 0, 0), (0, 2, 0), Material(albedo=WHITE))
    view = View.of(SLANTED, (48, 48), 1e-3)
    light = DirectionalLight((0, -1, -1), WHITE)
    plain, occluded = (
        PathTracer(with_mesh(make_scene([floor(1.0, material=m), wall], [light], SLANTED), uvs=(0, 0))).trace(
            view, np.full((2**12, 2), 0.5), seed=0)
        for m in (replace(material, occlusion_map=None), material))
    np.testing.assert_allclose(occluded.direct.mean(), plain.direct.mean(), rtol=1e-3)
    np.testing.assert_allclose(occluded.multi.mean(), 0.75 * plain.multi.mean(), rtol=1e-3)
    assert plain.multi.any()


def test_demodulated_light_is_that_of_the_first_opaque_surface() -> None:
    """As in the G-buffer, which blended and transmissive surfaces do not enter."""
    below = Material(albedo=(0.25, 0.5, 0.75))
    for lid in (pane(), Material(albedo=WHITE, is_blended=True)):
        scene = make_scene([floor(1.0, 0.5, lid), floor(3.0, 0.0, below)], [OVERHEAD], TOP)
        samples = PathTracer(scene).trace(View.of(TOP, (48, 48), 1e-3), np.full((4, 2), 0.5), seed=0)
        np.testing.assert_allclose(samples.albedo, np.tile(below.albedo, (4, 1)), rtol=1e-3)
        np.testing.assert_allclose(samples.depth, 2.0, rtol=1e-4)
