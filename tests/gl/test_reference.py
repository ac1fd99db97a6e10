"""The renderer and the path tracer agree with each other, and the path tracer with closed forms."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter

from app.animation.deformation import Deformation, Vertices
from app.animation.track import Track
from app.evaluation.denoise import denoise
from app.evaluation.metrics import psnr
from app.io.image import read_exr
from app.math3d import View
from app.renderer import Renderer
from app.scene import (
    Camera,
    DirectionalLight,
    Light,
    Material,
    PointLight,
    RectLight,
    Scene,
    SpotLight,
    Texture,
    Transmission,
)
from app.settings import Settings
from export.dataset.scenes.found_emitters import with_found_emitters
from tests.deforming import corners_of, deform, deforming_scene, strip
from tests.gl.closed_forms import point_irradiance
from tests.gl.scenes import F32, GREY, Images, Part, box, draw, floor, make_scene, quad, slide, sphere, without_shadows

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba, of the extra 'export', is not installed", allow_module_level=True)

from export.reference.path_tracer import PathTracer
from export.reference.still import Still
from export.reference.trace import mean_samples, trace_baselines, trace_reference, write_reference

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "path_tracer")]

SIZE = (128, 96)
SOFT_SIZE = (320, 240)
OUTPUTS = ("direct", "albedo", "normal", "depth")
CAMERA = Camera((0.9, 1.3, 2.6), (0.0, 0.35, 0.0), fov_y_deg=50.0)
CHECKS = np.zeros((8, 8, 4), np.uint8)
CHECKS[..., :3], CHECKS[::2, ::2, 3], CHECKS[1::2, 1::2, 3] = 190, 255, 255
CARD = Material(albedo=(0.9, 0.9, 0.9), albedo_map=Texture(CHECKS), alpha_cutoff=0.5)
WHITE = (10.0, 9.0, 8.0)
HARD: dict[str, Light] = {
    "point": PointLight((-0.8, 2.0, 1.0), WHITE),
    "spot": SpotLight((-0.8, 2.0, 1.0), (0.7, -1.9, -0.9), WHITE, 15.0, 35.0),
    "directional": DirectionalLight((0.5, -1.0, -0.4), (3.0, 2.5, 2.0)),
}
SOFT: dict[str, tuple[Light, Light]] = {  # with a size, and the same light without
    "sphere": (PointLight((-0.8, 2.0, 1.0), WHITE, 0.15), HARD["point"]),
    "spot": (SpotLight((-0.8, 2.0, 1.0), (0.7, -1.9, -0.9), WHITE, 15.0, 35.0, 0.1), HARD["spot"]),
    "sun": (DirectionalLight((0.5, -1.0, -0.4), (3.0, 2.5, 2.0), 3.0), HARD["directional"]),
    "rectangle": (RectLight((-0.8, 2.0, 1.0), (0.4, 0.0, 0.0), (0.0, 0.0, 0.4), (60.0,) * 3, True), HARD["point"]),
}


def hard_scene(*lights: Light) -> Scene:
    """A box, a sphere and a chequered card with holes, on a floor in front of a wall."""
    card = quad((0.35, 0.0, 0.55), (0.5, 0, -0.2), (0, 0.5, 0), CARD)
    wall = quad((-2, 0, -0.8), (4, 0, 0), (0, 2, 0), Material(albedo=(0.6, 0.3, 0.2)))
    return make_scene([floor(2.0), wall, box((-0.7, 0.0, -0.4), (0.5, 0.7, 0.5), Material(albedo=(0.2, 0.5, 0.7))),
                       sphere((0.25, 0.3, -0.1), 0.3), card], lights, CAMERA)


def soft_scene(*lights: Light) -> Scene:
    """A box and a sphere on a floor, from above: penumbras that widen from the contact to a quarter unit."""
    camera = Camera((0.5, 1.9, 0.6), (0.3, 0.0, -0.3), fov_y_deg=50.0)
    return make_scene([floor(2.0), box((-0.5, 0.0, -0.4), (0.4, 0.8, 0.4)), sphere((0.4, 0.35, 0.1), 0.25)],
                      lights, camera)


def trace(scene: Scene, spp: int, bounces: int = 0, size: tuple[int, int] = SIZE) -> Images:
    return mean_samples(PathTracer(scene, max_bounces=bounces), Still(scene, scene.cameras["main"].at(0.0), size), spp)


def free_light(scene: Scene, size: tuple[int, int] = SIZE) -> F32:
    """Direct light [h, w] of green without any shadow."""
    return draw(without_shadows(scene), size, ("direct",))["direct"][..., 1]


def edges(image: F32, width: int) -> np.ndarray:
    """Texels within ``width`` of a discontinuity of ``image`` [h, w]."""
    jump = maximum_filter(image, 3) - minimum_filter(image, 3) > 0.05
    return binary_dilation(jump, iterations=width - 1) if width > 1 else jump


@pytest.fixture(scope="module")
def traced() -> Images:
    return trace(hard_scene(HARD["point"]), 8)


def test_both_render_the_same_surfaces(traced: Images) -> None:
    drawn = draw(hard_scene(HARD["point"]), SIZE, OUTPUTS)
    both = (drawn["depth"][..., 0] > 0) & (traced["depth"][..., 0] > 0)
    either = (drawn["depth"][..., 0] > 0) | (traced["depth"][..., 0] > 0)
    difference = np.abs(drawn["depth"] / np.where(both[..., None], traced["depth"], 1) - 1)[..., 0]
    same = both & (difference < 1e-3)
    other = (either & ~same).mean()
    angle = np.degrees(np.arccos(np.clip((drawn["normal"] * traced["normal"]).sum(-1), -1, 1)))
    print(f"SEEN depth off by 1e-3 in {other:.3%}, else {np.median(difference[same]):.1e}; normals off by 2° "
          f"in {(angle[same] > 2).mean():.3%}")
    assert other < 0.003  # silhouettes and the rims of holes
    assert np.median(difference[same]) < 1e-5
    assert (angle[same] > 2.0).mean() < 0.01
    np.testing.assert_allclose(drawn["albedo"][same].mean(0), traced["albedo"][same].mean(0), atol=3e-3)


@pytest.mark.parametrize("kind", HARD)
def test_hard_light_away_from_shadow_edges(kind: str) -> None:
    scene = hard_scene(HARD[kind])
    drawn, reference = draw(scene, SIZE, OUTPUTS), trace(scene, 4)
    share = reference["direct"][..., 1] / np.maximum(free_light(scene), 1e-6)
    away = ~edges(share, 2)
    decibels = psnr(drawn["direct"], reference["direct"], away)
    print(f"HARD {kind}: {decibels:.1f} dB over {away.mean():.0%} of the image")
    assert away.mean() > 0.7
    assert decibels >= 40


@pytest.mark.parametrize("kind", HARD)
def test_highlights_of_hard_lights(kind: str) -> None:
    """On a polished floor and a rough sphere that reflect nothing else, through pixel centres."""
    floor_material, sphere_material = (Material(albedo=(0.0,) * 3, roughness=roughness, specular=(0.3, 0.4, 0.5))
                                       for roughness in (0.4, 0.7))
    scene = make_scene([floor(2.0, material=floor_material), sphere((0.25, 0.3, -0.1), 0.3, material=sphere_material)],
                       [HARD[kind]], CAMERA)
    w, h = SIZE
    y, x = np.divmod(np.arange(w * h), w)
    centres = np.stack([(x + 0.5) / w, (y + 0.5) / h], axis=1)
    samples = PathTracer(scene, max_bounces=0).trace_radiance(View.of(CAMERA, SIZE, 1e-3), centres, seed=0)
    reference, drawn = samples.reflected.reshape(h, w, 3), draw(scene, SIZE, ("specular",))["specular"]
    away = ~edges(reference[..., 1] / reference.max(), 2)
    decibels = psnr(drawn, reference, away)
    print(f"HIGHLIGHT {kind}: {decibels:.1f} dB over {away.mean():.0%} of the image")
    assert away.mean() > 0.7 and reference[away].max() > 0
    assert decibels >= 40


@pytest.mark.parametrize("kind", [
    pytest.param(kind, marks=() if kind == "sphere" else pytest.mark.long) for kind in SOFT])
def test_soft_shadows(kind: str) -> None:
    """Mean visibility error inside the true penumbra, against that of hard shadows."""
    soft, hard = (soft_scene(light) for light in SOFT[kind])
    free = free_light(soft, SOFT_SIZE)
    reference = trace(soft, 192, size=SOFT_SIZE)["direct"][..., 1] / np.maximum(free, 1e-6)
    smooth = gaussian_filter(reference, 1.0)  # otherwise noise counts as penumbra
    penumbra = (free > 0.1 * free.max()) & (smooth > 0.05) & (smooth < 0.95)
    error, hard_error = (np.abs(draw(s, SOFT_SIZE, ("direct",))["direct"][..., 1]
                           / np.maximum(free_light(s, SOFT_SIZE), 1e-6) - reference) for s in (soft, hard))
    print(f"SOFT {kind}: penumbra {penumbra.mean():.1%} of the image, mean error {error[penumbra].mean():.4f}, "
          f"with hard shadows {hard_error[penumbra].mean():.4f}")
    assert penumbra.mean() > 0.01
    assert error[penumbra].mean() <= 0.06
    assert error[penumbra].mean() <= 0.5 * hard_error[penumbra].mean()


def test_light_comes_through_the_holes_of_a_mask() -> None:
    """A card in which every other texel is a hole lets half of the light through, in both."""
    light = DirectionalLight((0.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    card = quad((-2, 0.5, 2), (4, 0, 0), (0, 0, -4), CARD)
    camera = Camera((0.0, 0.3, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 120.0)
    scene = make_scene([floor(1.5), card], [light], camera)
    lit = 0.5 / np.pi
    assert trace(scene, 4)["direct"].mean() == pytest.approx(lit / 2, rel=0.05)
    assert draw(scene, SIZE, ("direct",))["direct"].mean() == pytest.approx(lit / 2, rel=0.05)


def test_the_path_tracer_obeys_the_inverse_square_law() -> None:
    camera = Camera((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 60.0)
    light = (0.3, 1.0, -0.2)
    scene = make_scene([floor(3.0)], [PointLight(light, (2.0, 1.0, 0.5))], camera)
    at = draw(scene, SIZE, ("position",))["position"].astype(np.float64)
    expected = point_irradiance(at, np.array([0, 1.0, 0]), np.array(light)) * 0.5 / np.pi
    np.testing.assert_allclose(trace(scene, 2)["direct"][..., 1], expected, rtol=2e-3)


@pytest.mark.parametrize("height", [0.1, 0.2, 0.5])
def test_lamps_near_a_surface_light_it(height: float) -> None:
    """A small ball near the rim of a floor of 12 m, where rays start farthest off their surface."""
    ball = sphere((5.0, height, 5.0), 0.1 * height, 20, Material(emission=(100.0,) * 3))
    camera = Camera((5.0, 0.5 * height, 5.0), (5.0, 0.0, 5.0), (0.0, 0.0, -1.0), 2.0)
    scene = with_found_emitters(make_scene([floor(6.0), ball], [], camera))
    light = mean_samples(PathTracer(scene, max_bounces=0), Still(scene, camera, (8, 8)), 256)["direct"]
    assert light.mean() == pytest.approx(100.0 * 0.1**2 * GREY.albedo[0], rel=0.04)


def test_a_flame_in_a_glass_lights_the_table_of_a_large_room() -> None:
    """Two panes on the way to a ball of 9 mm, near the rim of a floor of 12 m: each lets through all but 4 %."""
    flame = sphere((5.0, 0.1, 5.0), 0.009, 20, Material(emission=(100.0,) * 3))
    glass = Material(albedo=(1.0,) * 3, specular=(0.04,) * 3, transmission=Transmission(1.0), double_sided=True)
    shells = [box((5 - h, 0.1 - h, 5 - h), (2 * h,) * 3, glass) for h in (0.05, 0.045)]
    camera = Camera((5.12, 0.04, 5.0), (5.12, 0.0, 5.0), (0.0, 0.0, -1.0), 10.0)
    light = [mean_samples(PathTracer(scene, max_bounces=0), Still(scene, camera, (8, 8)), 256)["direct"].mean()
             for scene in (with_found_emitters(make_scene([floor(6.0), flame, *around], [], camera))
                           for around in ([], shells))]
    assert light[1] / light[0] == pytest.approx(0.96**2, rel=0.03)


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
def test_the_path_tracer_sums_all_bounces(albedo: float) -> None:
    """In a closed box whose walls emit radiance 1, each wall receives the series 1 + ρ + ρ² + …; the 1 is unbounced."""
    emissive = Material(albedo=(albedo,) * 3, emission=(1.0, 1.0, 1.0))
    scene = make_scene([box((-1, -1, -1), (2, 2, 2), emissive)], [], Camera((0, 0, 0.9), (0.2, 0.1, 0.0), fov_y_deg=60))
    light = trace(scene, 64, bounces=64)
    assert light["indirect"].mean() == pytest.approx(albedo / (1 - albedo), rel=0.02)
    assert light["indirect_single"].mean() == pytest.approx(albedo, rel=0.02)
    np.testing.assert_allclose(light["direct"].mean(), albedo, rtol=0.02)


def test_single_bounce_light_excludes_further_bounces() -> None:
    """A lit floor lights a black wall, which reflects nothing back."""
    camera = Camera((0.0, 0.5, 1.5), (0.0, 0.5, 0.0))
    dark = Material(albedo=(1e-3,) * 3)
    scene = make_scene([floor(2.0), quad((-2, 0, -1), (4, 0, 0), (0, 2, 0), dark)], [HARD["point"]], camera)
    light = trace(scene, 64, bounces=8)
    assert light["indirect_single"].max() > 0.01
    np.testing.assert_allclose(light["indirect"].mean(), light["indirect_single"].mean(), rtol=2e-3)


def colored(part: Part, rgba: tuple[float, float, float, float], material: Material) -> Scene:
    """One part with vertex colours over a grey floor."""
    scene = make_scene([floor(1.5), replace(part, material=material)], [HARD["directional"]])
    mesh = scene.meshes[1]
    colors = np.tile(np.float32(rgba), (len(mesh.positions), 1))
    return replace(scene, meshes=(scene.meshes[0], replace(mesh, colors=colors)))


@pytest.mark.parametrize(("rgba", "material"), [
    ((0.5, 1.0, 0.25, 1.0), Material(albedo=(0.4, 0.2, 0.8))),
    ((1.0, 1.0, 1.0, 0.3), Material(alpha=0.9, alpha_cutoff=0.5)),
    ((1.0, 1.0, 1.0, 0.6), Material(alpha=0.9, alpha_cutoff=0.5)),
], ids=["color", "hole", "card"])
def test_vertex_colors_and_alpha(rgba: tuple[float, float, float, float], material: Material) -> None:
    scene = colored(quad((-0.5, 0.5, 0.5), (1, 0, 0), (0, 0, -1)), rgba, material)
    drawn, reference = draw(scene, SIZE, OUTPUTS), trace(scene, 1)
    same = np.abs(drawn["depth"] - reference["depth"])[..., 0] < 1e-3
    assert same.mean() > 0.99
    np.testing.assert_allclose(drawn["albedo"][same], reference["albedo"][same], atol=2e-3)


@pytest.fixture(scope="module")
def corner() -> Still:
    """A corner under a sphere light: noisy direct and indirect light."""
    walls = [floor(1.0), quad((-1, 0, -1), (2, 0, 0), (0, 1.5, 0)), quad((-1, 0, 1), (0, 0, -2), (0, 1.5, 0))]
    light = PointLight((0.2, 0.8, 0.1), (1.0, 0.8, 0.6), 0.2)
    camera = Camera((0.8, 0.9, 1.4), (-0.3, 0.3, -0.3))
    return Still(make_scene(walls, [light], camera), camera, (32, 24))


def test_the_estimated_noise_is_the_standard_error(corner: Still) -> None:
    runs = [trace_reference(corner, 20, seed) for seed in range(6)]
    for name in ("final", "direct", "indirect"):
        layers = np.stack([run.layers[name] for run in runs]).astype(np.float64)
        noise = np.sqrt(layers.var(axis=0, ddof=1).mean()) / layers.mean()
        estimated = np.sqrt(np.mean([run.noise[name] ** 2 for run in runs]))  # type: ignore[operator]
        assert estimated == pytest.approx(noise, rel=0.15), name


def test_a_denoised_reference_is_closer_to_the_converged_one(corner: Still) -> None:
    large = replace(corner, size=SIZE)
    converged, raw = trace_reference(large, 512, 1), trace_reference(large, 16)
    denoised = trace_reference(large, 16, denoised=True)
    for name in ("final", "indirect"):
        raw_error, error = (np.sqrt(((reference.layers[name] - converged.layers[name]) ** 2).mean())
                            for reference in (raw, denoised))
        assert error < 0.6 * raw_error, name
        assert denoised.layers[name].mean() == pytest.approx(converged.layers[name].mean(), rel=0.03), name
    assert np.array_equal(raw.layers["direct"], denoised.layers["direct"])
    assert denoised.noise == raw.noise  # before denoising


def test_denoising_spreads_no_light_into_the_sky() -> None:
    light = np.random.default_rng(0).gamma(1.0, 1.0, (48, 64, 3)).astype(np.float32)
    normal = np.zeros_like(light)
    normal[24:, :, 1] = 1.0
    light[:24] = 0.0
    denoised = denoise(light, normal)
    assert not denoised[:24].any() and denoised[24:].mean() == pytest.approx(1.0, rel=0.1)
    assert denoised[26:].std() < 0.2


def test_the_same_seed_gives_the_same_image() -> None:
    """Each conversion of the scene keeps the order of the lights, by which the path tracer samples them."""
    lights = [PointLight((-0.8, 2.0, 1.0), WHITE, 0.15),
              *(RectLight((x, 2.0, 1.0), (0.4, 0.0, 0.0), (0.0, 0.0, 0.4), (9.0 + x, 9.0, 9.0)) for x in (-1, 0, 1))]
    first = trace(hard_scene(*lights), 1, 2, (16, 12))
    for _ in range(60):
        again = trace(hard_scene(*lights), 1, 2, (16, 12))
        assert all(np.array_equal(first[name], again[name]) for name in first)


def test_baseline_images_accumulate_samples(corner: Still) -> None:
    """Noise falls with the square root of the number of samples, whatever numbers come before."""
    reference = trace_reference(corner, 256).layers["final"]
    rms = {}
    for count, layers, seconds in trace_baselines(corner, [1, 4, 16]):
        rms[count] = np.sqrt(((layers["final"] - reference) ** 2).mean())
        assert seconds > 0
        assert {name: image.shape for name, image in layers.items()} == dict.fromkeys(
            ("final", "albedo", "normal"), (24, 32, 3))
    assert rms[1] / rms[4] == pytest.approx(2, rel=0.25)
    assert rms[4] / rms[16] == pytest.approx(2, rel=0.25)


def test_files_of_a_reference(corner: Still, tmp_path: Path) -> None:
    reference = write_reference(tmp_path, corner, 1, 0, 4, {"scene": "corner"}, lambda share: None)
    about = json.loads((tmp_path / "reference.json").read_text())
    assert about["spp"] == 1 and about["size"] == [32, 24] and about["scene"] == "corner"
    assert about["noise"]["final"] is None  # unknown from one batch
    layers = read_exr(tmp_path / "reference.exr")
    np.testing.assert_allclose(layers[""], reference.layers["final"], rtol=2e-3, atol=1e-4)
    assert {"direct", "indirect", "indirect_single", "albedo", "normal", "depth"} <= set(layers)
    assert {file.name for file in tmp_path.iterdir()} == {"reference.exr", "reference.json"}


@pytest.mark.parametrize("kind", ["rigid", "skin", "morph"])
def test_moving_objects_are_traced_at_their_place(kind: str) -> None:
    block = replace(box((-0.2, 0.0, -0.2), (0.4, 0.4, 0.4), GREY), motion=slide([0, 1], [(-0.5, 0, 0), (0.5, 0, 0)]))
    if kind == "rigid":
        scene = make_scene([floor(2.0), block], [HARD["point"]], CAMERA)
    else:
        scene = deforming_scene(kind, [floor(2.0)], [HARD["point"]], CAMERA).scene
    for time in (0.0, 0.7):
        depth = mean_samples(PathTracer(scene, time, 0), Still(scene, CAMERA, SIZE, time), 1)["depth"]
        with Renderer(scene, Settings(SIZE, ("depth",), taa=False, provider="cpu")) as renderer:
            drawn = renderer.render(CAMERA, time)["depth"]
        assert (np.abs(drawn - depth) > 1e-3 * depth).mean() < 0.003


def test_normals_of_deforming_surfaces_are_those_of_the_time() -> None:
    """A morph target tilts the normals of a strip and leaves the strip where it is."""
    camera = Camera((0.0, 1.0, 3.0), (0.0, 1.0, 0.0), fov_y_deg=50.0)
    scene = make_scene([strip(GREY)], [HARD["point"]], camera)
    base = Vertices(corners_of(scene, 0), np.tile((0.0, 0.0, 1.0), (len(corners_of(scene, 0)), 1)))
    target = Vertices(np.zeros_like(base.positions), np.tile((1.0, 0.0, 0.0), (len(base.positions), 1)))
    weights = Track(np.array([0.0, 1.0]), np.array([[[0.0]], [[1.0]]]))
    tilting = deform(scene, 0, Deformation(base, (target,), weights, None, np.array([0.0, 1.0]))).scene
    for time, expected in ((0.0, (0.0, 0.0, 1.0)), (1.0, (np.sqrt(0.5), 0.0, np.sqrt(0.5)))):
        normal = mean_samples(PathTracer(tilting, time, 0), Still(tilting, camera, SIZE, time), 1)["normal"]
        seen = normal[normal.any(axis=2)]
        assert len(seen) > 500
        np.testing.assert_allclose(seen, np.tile(expected, (len(seen), 1)), atol=2e-3)
