"""Maps and layers of materials, against plain materials that must look the same and against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.load import load_scene
from app.network.selection import SSGI, find_model
from app.renderer import Renderer
from app.scene import (
    Camera,
    Clearcoat,
    DirectionalLight,
    Environment,
    Instance,
    Light,
    Material,
    Mesh,
    PointLight,
    RectLight,
    Scene,
    Sheen,
    SpotLight,
    Texture,
    Transmission,
    bounds_of,
)
from app.settings import Settings
from tests.gl.scenes import GREY, Images, box, draw, floor, make_scene, quad
from tests.robustness import valid_files

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

F64 = np.ndarray
SIZE = (64, 48)
FRONT = Camera((0.3, 0.2, 2.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)
LIGHT = PointLight((0.8, 0.9, 1.5), (3.0, 3.0, 3.0))
OUTPUTS = ("albedo", "normal", "direct", "specular")
METAL = Material(albedo=(0.9, 0.5, 0.2), metallic=1.0, roughness=0.3, specular=(0.04,) * 3)


def constant(*texel: float, is_color: bool = False, **options: object) -> Texture:
    """A texture of one float colour."""
    pixels = np.tile(np.array((*texel, *(1.0,) * 3)[:4], np.float32), (2, 2, 1))
    return Texture(pixels, is_color=is_color, **options)  # type: ignore[arg-type]


def normal_map(normal: tuple[float, float, float]) -> Texture:
    return constant(*(0.5 + 0.5 * np.asarray(normal) / np.linalg.norm(normal)).tolist())


def card(material: Material, normal: tuple[float, float, float] = (0, 0, 1), tangent: tuple[float, ...] = (1, 0, 0, 1),
         place: F64 | None = None) -> Scene:
    """A square across z, with vertex normals and tangents, that fills the picture; its uv is (x, y) + 1/2."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    unit = np.asarray(normal) / np.linalg.norm(normal)
    mesh = Mesh("card", corners, np.tile(unit, (4, 1)).astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
                uvs=corners[:, :2] + np.float32(0.5), second_uvs=corners[:, :2] * np.float32(3),
                tangents=np.tile(tangent, (4, 1)).astype(np.float32))
    instances = (Instance("card", 0, np.eye(4) if place is None else place),)
    scene = make_scene([floor(1.0)], [LIGHT], FRONT)
    return replace(scene, meshes=(mesh,), instances=instances, materials=(material,),
                   bounds=bounds_of((mesh,), instances))


def assert_alike(images: Images, expected: Images, names: tuple[str, ...] = OUTPUTS, atol: float = 2e-3) -> None:
    for name in names:
        scale = max(float(np.abs(expected[name]).max()), 1e-6)
        np.testing.assert_allclose(images[name] / scale, expected[name] / scale, atol=atol, err_msg=name)


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 1.0), (0.4, 0.0, 1.0), (0.1, -0.5, 1.0)])
@pytest.mark.parametrize(("tangent", "to_world"), [
    ((1, 0, 0, 1), np.eye(3)),
    ((0, 1, 0, 1), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),   # columns: tangent, bitangent, normal
    ((1, 0, 0, -1), np.diag([1, -1, 1])),
])
@pytest.mark.parametrize("place", [np.eye(4), np.diag([-1.0, 1, 1, 1]), np.diag([2.0, 2, 2, 1])])
def test_a_tilted_normal_map_is_a_tilted_normal(tilt: tuple[float, float, float], tangent: tuple[float, ...],
                                                to_world: F64, place: F64) -> None:
    normal = np.asarray(to_world) @ tilt
    images = draw(card(replace(METAL, metallic=0.5, normal_map=normal_map(tilt)), tangent=tangent, place=place),
                  SIZE, OUTPUTS)
    expected = draw(card(replace(METAL, metallic=0.5), normal=tuple(normal), place=place), SIZE, OUTPUTS)
    assert_alike(images, expected, atol=1e-2)


def test_the_scale_acts_on_x_and_y() -> None:
    images = draw(card(replace(METAL, normal_map=normal_map((0.4, 0.2, 1.0)), normal_scale=0.5)), SIZE, OUTPUTS)
    assert_alike(images, draw(card(METAL, normal=(0.2, 0.1, 1.0)), SIZE, OUTPUTS))


def test_from_behind_a_bump_is_a_dent() -> None:
    behind = Camera((0.3, 0.2, -2.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)
    scene = card(replace(METAL, normal_map=normal_map((0.4, 0.0, 1.0))))
    normals = draw(scene, SIZE, ("normal",), behind)["normal"].reshape(-1, 3)
    np.testing.assert_allclose(normals, np.tile([-0.371, 0, -0.928], (len(normals), 1)), atol=2e-3)


@pytest.mark.parametrize("radius", [0.0, 0.02, 0.6])
def test_light_from_behind_the_face_gives_nothing(radius: float) -> None:
    """From lights with hard, soft and traced shadows; the surface is open, so nothing else hides them."""
    behind = (PointLight((1.5, 0.0, -0.7), (5.0,) * 3, radius),
              DirectionalLight((-1.0, 0.0, 0.1 + radius), (5.0,) * 3, 5 * radius),
              SpotLight((1.5, 0.0, -0.7), (-1.0, 0.0, 0.4), (5.0,) * 3, 30.0, 40.0, radius),
              RectLight((1.5, 0.0, -0.7), (0.0, 0.1 + radius, 0.0), (0.1 + radius, 0.0, 0.1 + radius), (5.0,) * 3,
                        two_sided=True))
    steep = card(replace(METAL, metallic=0.5, normal_map=normal_map((1.0, 0.0, 0.5))))
    images = draw(steep.with_lights(*behind), SIZE, OUTPUTS)
    assert not images["direct"].any() and not images["specular"].any()
    assert draw(steep.with_lights(PointLight((1.5, 0.0, 0.7), (5.0,) * 3, radius)), SIZE, OUTPUTS)["direct"].min() > 0


def test_bumps_have_the_share_of_a_sun_that_is_above_their_face() -> None:
    """Not all or nothing of it, or its terminator would follow the edges of facets."""
    radius_deg, steep = 3.0, (1.0, 0.0, 0.5)
    n = np.asarray(steep) / np.linalg.norm(steep)
    found, shares = [], []
    for elevation_deg in (-2.0, -1.0, 0.0, 1.0, 2.0, 6.0):
        angle = math.radians(elevation_deg)
        sun = DirectionalLight((-math.cos(angle), 0.0, -math.sin(angle)), (3.0,) * 3, radius_deg)
        scene = card(Material(normal_map=normal_map(steep))).with_lights(sun)
        seen = draw(scene, SIZE, ("direct",))["direct"][..., 0].astype(np.float64)
        x = np.clip(math.tan(angle) / math.tan(math.radians(radius_deg)), -1.0, 1.0)
        shares.append(0.5 + (x * math.sqrt(1 - x * x) + math.asin(x)) / math.pi)
        found.append(seen.mean() / (n @ (math.cos(angle), 0.0, math.sin(angle))))
    found = np.divide(found, found[-1])
    print(f"BUMPS {np.round(found, 3)} of {np.round(shares, 3)}")
    np.testing.assert_allclose(found[2:], shares[2:], atol=0.04)
    assert 0 < found[0] < found[1] < shares[1]  # below the horizon, the map takes a part of the rest


def test_mirror_directions_are_above_the_face() -> None:
    grazing = Camera((2.0, 0.0, 0.25), (0.0, 0.0, 0.0), fov_y_deg=20.0)
    scene = card(replace(METAL, normal_map=normal_map((-1.0, 0.3, 1.0))))
    images = draw(scene, SIZE, ("normal", "position", "depth"), grazing)
    on = images["depth"][..., 0] > 0
    assert on.mean() > 0.2
    n = images["normal"][on].astype(np.float64)
    v = np.asarray(grazing.eye) - images["position"][on]
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    mirrored = 2 * (n * v).sum(axis=1, keepdims=True) * n - v
    assert mirrored[:, 2].min() > -2e-3 and (n * v).sum(axis=1).min() > 0


@pytest.mark.parametrize("deviation", [0.05, 0.1, 0.2])
def test_distant_bumps_show_the_slopes_that_face_the_eye(deviation: float) -> None:
    """The mean of normally distributed slopes over what is visible of them, by quadrature, at a grazing view."""
    slopes = np.random.default_rng(0).normal(scale=deviation, size=(256, 256, 2))
    normals = np.concatenate([slopes, np.ones((256, 256, 1))], axis=2)
    normals = 0.5 + 0.5 * normals / np.linalg.norm(normals, axis=2, keepdims=True)
    pixels = np.concatenate([255 * normals, np.full((256, 256, 1), 255)], axis=2).round().astype(np.uint8)
    scene = card(replace(METAL, normal_map=Texture(pixels, is_color=False)))
    grazing = Camera((6.0, 0.0, 0.6), (0.0, 0.0, 0.0), fov_y_deg=5.0)
    image = draw(scene, (64, 48), ("normal",), grazing)["normal"]
    n = image[22:26].reshape(-1, 3).astype(np.float64).mean(axis=0)
    s = np.linspace(-8, 8, 4001)
    weight = np.exp(-0.5 * s * s) * np.maximum(1 + 10 * deviation * s, 0)
    expected = deviation * (weight @ s) / weight.sum()
    print(f"SLOPE {n[0] / n[2]:.4f}, by quadrature {expected:.4f}")
    assert n[0] / n[2] == pytest.approx(expected, abs=0.015)  # eight bits
    assert abs(n[1]) < 0.01


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("is_mapped", [False, True])
def test_metallic_mixes_diffuse_and_specular(metallic: float, is_mapped: bool) -> None:
    base, f0 = np.array([0.9, 0.5, 0.2]), 0.04
    mixed = f0 + (base - f0) * metallic
    plain = Material(albedo=tuple(base * (1 - metallic)), specular=tuple(mixed), roughness=0.4)
    options = {"metallic_roughness_map": constant(0.9, 0.5, metallic)} if is_mapped else {}
    material = Material(albedo=tuple(base), specular=(f0,) * 3, roughness=0.8 if is_mapped else 0.4,
                        metallic=1.0 if is_mapped else metallic, **options)  # type: ignore[arg-type]
    assert_alike(draw(card(material), SIZE, OUTPUTS), draw(card(plain), SIZE, OUTPUTS))


def test_a_metallic_map_halves_the_albedo_texel_by_texel() -> None:
    pixels = np.zeros((1, 2, 4), np.uint8)
    pixels[0, 1, 2] = 128  # linear
    texture = Texture(pixels, is_color=False, magnified="nearest", repeat=(False, False))
    images = draw(card(replace(METAL, metallic_roughness_map=texture)), SIZE, ("albedo", "position"))
    right = images["position"][..., 0] > 0
    np.testing.assert_allclose(images["albedo"][right], np.tile(np.multiply(METAL.albedo, 127 / 255), (right.sum(), 1)),
                               atol=1e-3)
    np.testing.assert_allclose(images["albedo"][~right], np.tile(METAL.albedo, ((~right).sum(), 1)), atol=1e-3)


def test_a_specular_map_multiplies_by_colour_and_alpha() -> None:
    plain = Material(albedo=(0.1,) * 3, roughness=0.4, specular=(0.2, 0.1, 0.05))
    mapped = replace(plain, specular=(0.8, 0.8, 0.8), specular_map=constant(0.5, 0.25, 0.125, 0.5))
    assert_alike(draw(card(mapped), SIZE, OUTPUTS), draw(card(plain), SIZE, OUTPUTS))


def gradient(**options: object) -> Texture:
    pixels = np.random.default_rng(0).uniform(0, 1, (16, 16, 4)).astype(np.float32)
    return Texture(pixels, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["emission_map", "specular_map", "metallic_roughness_map"])
def test_a_map_of_the_second_uv_set_is_one_of_the_first_with_its_transform(name: str) -> None:
    material = replace(METAL, metallic=0.5, specular=(0.5,) * 3, emission=(1.0,) * 3, albedo_map=gradient())
    second = np.array([[0.0, 0.5, 0.1], [-0.5, 0.0, 0.2], [0, 0, 1]])
    to_second = np.array([[3.0, 0, -1.5], [0, 3.0, -1.5], [0, 0, 1]])  # the uv sets of ``card``
    images, expected = (draw(card(replace(material, **{name: texture})), SIZE, (*OUTPUTS, "emission"))
                        for texture in (gradient(transform=second, uv_set=1), gradient(transform=second @ to_second)))
    assert_alike(images, expected, (*OUTPUTS, "emission"), atol=5e-3)


@pytest.mark.parametrize(("hole", "rel"), [(1.0, 0.1), (0.0, 0.2)])  # edges of wires are interpolated with holes
def test_a_mask_covers_its_share_from_far_away(hole: float, rel: float) -> None:
    """White wires over 15 % of a fence, two tiles to a pixel; no coarse level of it reaches the cutoff."""
    wires = np.full((64, 64, 4), hole, np.float32)
    rows, columns = np.indices((64, 64))
    wires[..., 3] = np.minimum(abs((rows + columns) % 64 - 32), abs((rows - columns) % 64 - 32)) < 3
    wires[wires[..., 3] > 0] = 1.0
    tiled = np.diag([2.31 * SIZE[0], 1.77 * SIZE[1], 1.0])
    fence = Material(albedo=(1.0,) * 3, albedo_map=Texture(wires, transform=tiled), alpha_cutoff=0.5, is_unlit=True)
    camera = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=20.0)
    with Renderer(replace(card(fence), lights=()), Settings(SIZE, provider="cpu"), None) as renderer:
        for _ in range(31):
            renderer.advance(camera)
        seen = renderer.render(camera)["final"]
    assert seen.mean() == pytest.approx(wires[..., 3].mean(), rel=rel)


def test_nearest_magnification_has_no_colours_between() -> None:
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[:, 1] = 255
    albedos = {mode: draw(card(Material(albedo=(1.0,) * 3, albedo_map=Texture(pixels, magnified=mode))), SIZE,
                          ("albedo",))["albedo"][..., 0] for mode in ("linear", "nearest")}
    assert set(np.unique(albedos["nearest"])) == {0.0, 1.0}
    assert len(np.unique(albedos["linear"])) > 10


def test_occlusion_dims_indirect_light_alone() -> None:
    parts = [floor(2.0, material=replace(GREY, occlusion_map=constant(0.25), occlusion_strength=0.8)),
             quad((-1.0, 0.0, -1.0), (2.0, 0, 0), (0, 2.0, 0))]
    camera = Camera((0.0, 1.5, 3.0), (0.0, 0.3, 0.0), fov_y_deg=50.0)
    scene = make_scene(parts, [PointLight((0.0, 1.0, 1.0), (3.0,) * 3)], camera)
    images = draw(scene, (128, 96), ("lit", "direct", "indirect", "albedo", "normal"), model=SSGI)  # type: ignore[arg-type]
    is_floor = images["normal"][..., 1] > 0.9
    share = np.where(is_floor, 1 + 0.8 * (0.25 - 1), 1.0)[..., None]
    expected = images["direct"] + images["albedo"] * images["indirect"] * share
    assert images["indirect"][is_floor].max() > 0.01
    np.testing.assert_allclose(images["lit"], expected, rtol=5e-3, atol=1e-3)


def test_unlit_shows_its_colour_and_lights_nothing() -> None:
    sign = Material(albedo=(0.9, 0.5, 0.1), is_unlit=True)
    camera = Camera((0.0, 1.5, 3.0), (0.0, 0.3, 0.0), fov_y_deg=50.0)
    for power in (0.0, 3.0):
        lights = [PointLight((0.0, 1.0, 1.0), (power,) * 3)]
        images, black = (draw(make_scene([floor(2.0), quad((-1.0, 0.0, -1.0), (2.0, 0, 0), (0, 2.0, 0), material)],
                                         lights, camera), (128, 96), ("final", "normal", "depth"),
                              model=SSGI)  # type: ignore[arg-type]
                         for material in (sign, Material(albedo=(0.0,) * 3)))
        on = images["normal"][..., 2] > 0.9
        np.testing.assert_allclose(images["final"][on], np.tile(sign.albedo, (on.sum(), 1)), atol=1e-3)
        np.testing.assert_allclose(images["final"][~on], black["final"][~on], atol=1e-3)


@pytest.mark.parametrize("power", [1e-6, 1.0, 1e3])
def test_unlit_colours_do_not_depend_on_the_scale_of_light(power: float) -> None:
    scene = card(Material(albedo=(0.9, 0.5, 0.1), is_unlit=True)).with_lights(PointLight((0, 1, 2), (power,) * 3))
    final = draw(scene, SIZE, ("final",))["final"].reshape(-1, 3)
    np.testing.assert_allclose(final, np.tile((0.9, 0.5, 0.1), (len(final), 1)), rtol=5e-3)


def schlick(f0: float, c: F64) -> F64:
    return f0 + (1 - f0) * (1 - c) ** 5


def view_cosine(images: Images) -> F64:
    v = np.asarray(FRONT.eye) - images["position"].astype(np.float64)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    return (v * images["normal"]).sum(axis=-1)[..., None]


@pytest.mark.parametrize("is_mapped", [False, True])
def test_a_clear_coat_is_a_lobe_over_what_it_lets_through(is_mapped: bool) -> None:
    base = Material(albedo=(0.6, 0.3, 0.2), roughness=0.6, specular=(0.3,) * 3, emission=(0.2,) * 3)
    coat = (Clearcoat(1.0, 1.0, constant(0.8, 0, 0), constant(0, 0.3, 0)) if is_mapped else Clearcoat(0.8, 0.3))
    outputs = (*OUTPUTS, "position", "emission")
    images = draw(card(replace(base, clearcoat=coat)), SIZE, outputs)
    bare = draw(card(base), SIZE, outputs)
    lobe = draw(card(Material(roughness=0.3, specular=(0.04,) * 3)), SIZE, OUTPUTS)["specular"]
    below = 1 - 0.8 * schlick(0.04, view_cosine(bare))
    np.testing.assert_allclose(images["direct"], bare["direct"] * below, rtol=5e-3)
    np.testing.assert_allclose(images["emission"], bare["emission"] * below, rtol=5e-3)
    np.testing.assert_allclose(images["specular"], bare["specular"] * below + 0.8 * lobe, rtol=1e-2, atol=1e-4)


def test_a_clear_coat_has_its_own_normal() -> None:
    """That of the mesh, or of its own map, whatever the normal map of the surface."""
    base = Material(albedo=(0.0,) * 3, normal_map=normal_map((0.5, 0.3, 1.0)))
    for own, normal in ((None, (0, 0, 1)), (normal_map((0.2, 0.3, 1.0)), (0.2, 0.3, 1.0))):
        images = draw(card(replace(base, clearcoat=Clearcoat(1.0, 0.3, normal_map=own))), SIZE, OUTPUTS)
        expected = draw(card(Material(albedo=(0.0,) * 3, roughness=0.3, specular=(0.04,) * 3), normal=normal), SIZE,
                        OUTPUTS)
        assert_alike(images, expected, ("specular",), atol=5e-3)


def charlie(n_l: F64, n_v: F64, n_h: F64, roughness: float) -> F64:
    """The sheen lobe, in float64 and by the paper's formulae."""
    alpha = roughness**2
    share = (1 - alpha) ** 2
    a, b, c, d, e = (x * (1 - share) + y * share for x, y in (
        (21.5473, 25.3245), (3.82987, 3.32435), (0.19823, 0.16801), (-1.97760, -1.27393), (-4.32054, -4.85967)))

    def curve(x: F64) -> F64:
        return a / (1 + b * x**c) + d * x + e

    def masking(x: F64) -> F64:
        return np.exp(np.where(x < 0.5, curve(x), 2 * curve(np.float64(0.5)) - curve(np.clip(1 - x, 1e-9, 1))))

    distribution = (2 + 1 / alpha) * (1 - n_h**2) ** (0.5 / alpha) / (2 * np.pi)
    return distribution / ((1 + masking(n_l) + masking(n_v)) * 4 * n_l * n_v)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("elevation", [15.0, 45.0, 80.0])
@pytest.mark.parametrize("is_mapped", [False, True])
def test_sheen_against_the_closed_form(roughness: float, elevation: float, is_mapped: bool) -> None:
    color = np.array([0.8, 0.5, 0.3])
    to_light = np.array([-np.cos(np.radians(elevation)), 0.0, np.sin(np.radians(elevation))])
    sheen = (Sheen((1.0,) * 3, 1.0, constant(*color), constant(0, 0, 0, roughness)) if is_mapped
             else Sheen(tuple(color), roughness))
    scene = card(Material(albedo=(0.0,) * 3, sheen=sheen)).with_lights(DirectionalLight(tuple(-to_light), (2.0,) * 3))
    images = draw(scene, SIZE, (*OUTPUTS, "position"))
    v = np.asarray(FRONT.eye) - images["position"].astype(np.float64)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    h = v + to_light
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    expected = 2.0 * to_light[2] * color * charlie(to_light[2], v[..., 2:], h[..., 2:], roughness)
    np.testing.assert_allclose(images["specular"], expected, rtol=0.02, atol=0.005 * float(expected.max()) + 1e-6)


@pytest.mark.parametrize("roughness", [0.2, 0.5, 1.0])
def test_sheen_takes_from_the_base_what_it_scatters(roughness: float) -> None:
    """The albedo of the lobe, by quadrature over all directions of light."""
    steps = 400
    z = (np.arange(steps) + 0.5) / steps
    phi = (np.arange(steps) + 0.5) / steps * np.pi
    z, phi = z[:, None], phi[None, :]
    for elevation in (20.0, 60.0):
        v = np.array([np.cos(np.radians(elevation)), 0.0, np.sin(np.radians(elevation))])
        sine = np.sqrt(1 - z * z)
        lights = np.stack(np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), z), -1)
        h = (lights + v) / np.linalg.norm(lights + v, axis=-1, keepdims=True)
        albedo = 2 * np.pi * float((charlie(lights[..., 2], v[2], h[..., 2], roughness) * lights[..., 2]).mean())
        camera = Camera(tuple(40 * v), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.5)
        images = draw(card(Material(albedo=(0.5,) * 3, sheen=Sheen((0.2, 0.8, 0.4), roughness))), SIZE, ("albedo",),
                      camera)
        np.testing.assert_allclose(images["albedo"] / 0.5, 1 - 0.8 * albedo, atol=0.04)


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_culled_backs_are_invisible(is_mirrored: bool) -> None:
    place = np.diag([-1.0 if is_mirrored else 1.0, 1, 1, 1])
    behind = Camera((0.3, 0.2, -2.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)
    for material in (GREY, replace(GREY, is_back_culled=True)):
        scene = card(material, place=place)
        assert draw(scene, SIZE, ("depth",))["depth"].min() > 0
        assert (draw(scene, SIZE, ("depth",), behind)["depth"].max() > 0) is not material.is_back_culled


LAMPS: dict[str, Light] = {
    "point": PointLight((0.0, 2.0, 0.0), (3.0,) * 3), "sphere": PointLight((0.0, 2.0, 0.0), (3.0,) * 3, 0.01),
    "spot": SpotLight((0.0, 2.0, 0.0), (0.0, -1.0, 0.0), (3.0,) * 3, 30.0, 40.0),
    "wide spot": SpotLight((0.0, 2.0, 0.0), (0.0, -1.0, 0.0), (3.0,) * 3, 60.0, 70.0),
    "sun": DirectionalLight((0.0, -1.0, 0.0), (1.0,) * 3),
    "traced": RectLight((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0,) * 3),
}


OUTLINE = Material(albedo=(0.01,) * 3, is_back_culled=True)


@pytest.mark.parametrize("name", LAMPS)
@pytest.mark.parametrize("material", [OUTLINE, replace(GREY, is_back_culled=True)], ids=["outline", "wall"])
def test_light_passes_backs_of_outlines_only(name: str, material: Material) -> None:
    """A blind whose front or back faces the light, also where its instance is mirrored."""
    below = Camera((0.0, 0.5, 2.5), (0.0, 0.0, 0.0))
    free = draw(make_scene([floor(0.5)], [LAMPS[name]], below), SIZE, ("direct",))["direct"]
    assert free.any()
    for is_mirrored, faces_light in ((False, True), (False, False), (True, True), (True, False)):
        edges = (0.0, 0.0, -2.0), (2.0, 0.0, 0.0)  # their product points down
        u, v = reversed(edges) if faces_light else edges
        blind = quad((-1.0, 1.0, 1.0), u, v, material)
        blind = replace(blind, place=np.diag([-1.0 if is_mirrored else 1.0, 1, 1, 1]))
        lit = draw(make_scene([floor(0.5), blind], [LAMPS[name]], below), SIZE, ("direct",))["direct"]
        if faces_light or material is not OUTLINE:
            assert not lit.any()
        else:
            np.testing.assert_allclose(lit, free, atol=1e-3)


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_all_maps_and_layers_of_a_file_go_together(mode: str, tmp_path: Path) -> None:
    """No two of them may use one name in the shader."""
    file = valid_files.gltf()
    file.json["materials"][0]["alphaMode"] = mode
    scene = load_scene(file.save(tmp_path))
    assert max(len(material.maps) for material in scene.materials) == 13
    image = draw(scene, SIZE, ("final",))["final"]
    assert np.isfinite(image).all() and image.any()


def test_targets_exist_only_for_what_a_material_has() -> None:
    plain = {"albedo", "normal", "depth"}
    for material, more in ((GREY, set()), (replace(GREY, occlusion_map=constant(0.5)), {"occlusion"}),
                           (replace(GREY, normal_map=normal_map((0, 0, 1))), {"smooth_normal"}),
                           (replace(GREY, is_unlit=True), {"emission"}),
                           (replace(GREY, metallic=0.5), {"specular_roughness"}),
                           (replace(GREY, clearcoat=Clearcoat(1, 0.5)), {"specular_roughness", "clearcoat"}),
                           (replace(GREY, sheen=Sheen((1, 1, 1), 0.5)), {"specular_roughness", "sheen"})):
        settings = Settings(size=SIZE, taa=False, provider="cpu")
        with Renderer(card(material), settings, SSGI) as renderer:  # type: ignore[arg-type]
            written = [w for p in renderer.plan.passes if p.name.startswith("gbuffer") for w in p.writes]
            assert set(written) == plain | more


def with_tangents(scene: Scene) -> Scene:
    """The scene with its last mesh, a floor, ready for a normal map: tangents along x."""
    *others, last = scene.meshes
    axes = {name: np.tile(np.array(axis, np.float32), (len(last.positions), 1))
            for name, axis in (("normals", (0, 1, 0)), ("tangents", (1, 0, 0, 1)))}
    return replace(scene, meshes=(*others, replace(last, **axes)))


def test_indirect_light_has_no_blotches_on_bumps() -> None:
    """On the mean over blocks it is that of a floor without bumps times one factor, since bumps all over see a little
    less. They differ from texel to texel of the grid that light is gathered on."""
    tilts = np.random.default_rng(3).uniform(-1.0, 1.0, (256, 256, 2))
    normals = np.dstack([tilts, np.ones((256, 256))])
    pixels = np.dstack([0.5 + 0.5 * normals / np.linalg.norm(normals, axis=-1, keepdims=True), np.ones((256, 256))])
    bumps = replace(GREY, normal_map=Texture(pixels.astype(np.float32), is_color=False))
    panel = RectLight((0.0, 2.8, 0.0), (1.2, 0.0, 0.0), (0.0, 0.0, 1.2), (3.0,) * 3)
    camera = Camera((0.0, 1.5, 1.9), (0.0, 0.0, 0.2), fov_y_deg=45.0)

    def light(material: Material) -> Images:
        parts = [box((-2, -0.01, -2), (4, 3, 4)), floor(1.99, 0.0, material)]
        scene = with_tangents(make_scene(parts, [panel], camera))
        settings = Settings((256, 192), ("direct", "indirect"), provider="cpu")
        with Renderer(scene, settings, find_model("final-gather")) as renderer:
            renderer.render(camera)
            return renderer.render(camera)

    plain, bumpy = light(GREY), light(bumps)
    ratio = (bumpy["indirect"] / plain["indirect"]).reshape(12, 16, 16, 16, 3).mean(axis=(1, 3, 4))
    print(f"BUMPS {ratio.mean():.3f} of the light, blocks {ratio.std():.3f} apart")
    assert np.abs(bumpy["direct"] - plain["direct"]).mean() > 0.03 * plain["direct"].mean()
    assert 0.8 < ratio.mean() < 1.0 and ratio.std() < 0.02


@pytest.mark.parametrize(("tilt", "expected"), [
    ((1, 0, 3), 3 / 10**0.5 + 1 / 10**0.5), ((-1, 0, 3), 3 / 10**0.5 - 1 / 10**0.5), ((0, 1, 3), 3 / 10**0.5)],
    ids=["towards", "away", "aside"])
def test_indirect_light_counts_more_on_bumps_that_face_it(tilt: tuple[float, float, float], expected: float) -> None:
    """Half of what a floor's middle sees is a lit wall, the rest is black: its light on a tilted normal n over that on
    the floor's is n · (floor's normal + direction to the wall)."""
    sun = DirectionalLight((1.0, 0.0, 0.0), (3.0,) * 3)
    camera = Camera((0.7, 0.5, 0.0), (0.95, 0.0, 0.0), fov_y_deg=10.0)
    wall = quad((1, -0.001, 300), (0, 0, -600), (0, 300, 0), GREY)

    def light(*normal: float) -> F64:
        bumps = replace(GREY, normal_map=normal_map((normal[0], normal[1], normal[2])))
        scene = with_tangents(make_scene([wall, floor(1, 0, bumps)], [sun], camera))
        with Renderer(scene, Settings((64, 48), ("indirect",), provider="cpu"), find_model("final-gather")) as renderer:
            frames = [renderer.render(camera)["indirect"] for _ in range(12)]
        return np.mean(frames[-4:])

    found = light(*tilt) / light(0, 0, 1)
    print(f"BUMP {found:.3f} of the light, expected {expected:.3f}")
    assert found == pytest.approx(expected, abs=0.08)


def specular_of(lights: list[Light], roughness: float) -> F64:
    """What a metal floor reflects, of the picture's lower half."""
    metal = replace(METAL, roughness=roughness)
    camera = Camera((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=60.0)
    scene = make_scene([floor(50.0, 0.0, metal)], lights, camera)
    return np.asarray(draw(scene, (96, 72), ("specular",))["specular"][24:, :, 0])


@pytest.mark.parametrize(("roughness", "radius", "mean", "peak"), [
    (0.1, 3.0, 0.35, 0.1), (0.3, 3.0, 0.05, 0.25), (0.6, 3.0, 0.02, 0.05), (0.6, 15.0, 0.05, 0.3),
    (1.0, 15.0, 0.05, 0.05), (0.6, 60.0, 0.6, 0.4)])
def test_highlights_of_discs_are_those_of_many_small_lights(
        roughness: float, radius: float, mean: float, peak: float) -> None:
    """The mean and the brightest are those of suns all over the disc, within what one point and a wider lobe can do."""
    axis = np.array((0.0, -0.5, 0.8)) / np.hypot(0.5, 0.8)
    side, up = np.array((1.0, 0.0, 0.0)), np.cross(axis, (1.0, 0.0, 0.0))
    count, suns = 48, []
    for i in range(count):
        sine = np.sin(np.radians(radius)) * np.sqrt((i + 0.5) / count)
        across = sine * (np.cos(2.4 * i) * side + np.sin(2.4 * i) * up)
        way = across + np.sqrt(1 - sine**2) * axis
        # Of a disc of one radiance, as much as it sends to what faces its centre.
        suns.append(DirectionalLight((float(way[0]), float(way[1]), float(way[2])),
                                     (1.0 / count / np.sqrt(1 - sine**2),) * 3))
    expected = specular_of([*suns], roughness)
    middle = DirectionalLight((0.0, float(axis[1]), float(axis[2])), (1.0,) * 3, angular_radius_deg=radius)
    disc = specular_of([middle], roughness)
    found = disc.mean() / expected.mean(), disc.max() / expected.max()
    print(f"DISC {roughness} {radius}: mean {found[0]:.2f} brightest {found[1]:.2f}")
    assert abs(found[0] - 1) < mean and abs(found[1] - 1) < peak


def test_a_scene_with_every_feature_is_lit() -> None:
    """Its direct light reads more textures than that of any other scene, beside the table of specular lobes."""
    ground = Material("ground", albedo=(0.5,) * 3, roughness=0.4, specular=(0.04,) * 3, clearcoat=Clearcoat(1.0, 0.2),
                      sheen=Sheen((0.2,) * 3, 0.5), normal_map=constant(0.5, 0.5, 1.0))
    pane = Material("pane", albedo=(0.9, 0.2, 0.2), roughness=0.0, specular=(0.04,) * 3, transmission=Transmission(1.0))
    lights = (PointLight((0.0, 3.0, 0.0), (5.0,) * 3, radius=0.02),
              RectLight((0.0, 1.5, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0,) * 3))
    camera = Camera((0.0, 2.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=40.0)
    parts = floor(2.0, 0.0, ground), quad((-0.3, 0.5, 0.3), (0.6, 0, 0), (0, 0, -0.6), pane)
    scene = make_scene([*parts], lights, camera)
    scene = replace(scene, environment=Environment(np.ones((8, 16, 3), np.float32)))
    settings = Settings(size=SIZE, outputs=("final", "direct"), provider="cpu")
    with Renderer(scene, settings, SSGI) as renderer:
        assert sum(p.name == "direct" and len(p.reads) > 15 for p in renderer.plan.passes) == 1
        assert (renderer.render(camera)["direct"][16:32, 8:56] > 0.1).all()
