"""Blended and transmissive surfaces against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from app.network.selection import UNSHADOWED, find_model
from app.renderer import Renderer
from app.scene import (
    Camera,
    DirectionalLight,
    Environment,
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
from tests.gl.scenes import Part, box, cellar, draw, floor, make_scene, quad, slide

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (48, 48)
TOP = Camera((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 30.0)
SLANTED = Camera((0.0, 2.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=30.0)  # the middle of its image shows the origin
OVERHEAD = DirectionalLight((0.0, -1.0, 0.0), (math.pi, math.pi, math.pi))
WHITE = (1.0, 1.0, 1.0)
WALL = floor(4.0, 0.0, Material(albedo=(0.8, 0.6, 0.4), is_unlit=True))


def middle(scene: Scene, **settings: object) -> np.ndarray:
    return draw(scene, SIZE, **settings)["final"][22:26, 22:26].mean(axis=(0, 1))  # type: ignore[arg-type]


def veil(color: tuple[float, float, float], alpha: float, **options: object) -> Material:
    return Material(albedo=color, alpha=alpha, is_blended=True, **options)  # type: ignore[arg-type]


def glass(color: tuple[float, float, float] = WHITE, **options: object) -> Material:
    """Smooth clear glass, without reflections unless asked for."""
    names = ("ior", "thickness", "attenuation_color", "attenuation_distance", "factor", "factor_map")
    transmission = {"factor": 1.0, **{k: options.pop(k) for k in names if k in options}}
    return Material(**{"albedo": color, "roughness": 0.0, **options},  # type: ignore[arg-type]
                    transmission=Transmission(**transmission))  # type: ignore[arg-type]


def test_a_pane_covers_by_its_alpha() -> None:
    """Half of a red pane, half of the wall; emission is covered too."""
    pane = floor(1.0, 0.5, veil((1.0, 0.0, 0.0), 0.5, is_unlit=True))
    np.testing.assert_allclose(middle(make_scene([pane, WALL], camera=TOP)), (0.9, 0.3, 0.2), rtol=2e-3)
    glowing = floor(1.0, 0.5, Material(albedo=(0.0,) * 3, alpha=0.25, is_blended=True, emission=(4.0, 0.0, 8.0)))
    np.testing.assert_allclose(middle(make_scene([glowing, WALL], camera=TOP)), (1.6, 0.45, 2.3), rtol=2e-3)


def test_a_pane_is_lit_like_other_surfaces() -> None:
    pane = floor(1.0, 0.5, veil((0.5, 1.0, 0.0), 0.5))
    scene = make_scene([pane, floor(4.0, 0.0, Material(albedo=(0.0,) * 3))], [OVERHEAD], TOP)
    np.testing.assert_allclose(middle(scene), (0.25, 0.5, 0.0), rtol=2e-3)
    lid = floor(0.5, 3.0, Material())  # above the camera
    assert not middle(make_scene([pane, lid], [OVERHEAD], TOP)).any()


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 1, 0)])
def test_panes_are_blended_in_the_order_of_their_depth(order: tuple[int, ...]) -> None:
    """However they are listed, and where they cross: every pixel has its own order."""
    colors = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0)]
    panes = [floor(1.0, 0.9 - 0.2 * k, veil(color, 0.5, is_unlit=True)) for k, color in enumerate(colors)]
    expected = np.array((0.8, 0.6, 0.4))
    for color in reversed(colors):
        expected = 0.5 * np.array(color) + 0.5 * expected
    seen = middle(make_scene([*(panes[k] for k in order), WALL], camera=TOP))
    np.testing.assert_allclose(seen, expected, rtol=3e-3)


def test_crossing_panes_swap_their_order() -> None:
    red, blue = (quad((-1, 0.5 - s, 1), (2, 2 * s, 0), (0, 0, -2), veil(color, 0.5, is_unlit=True))
                 for s, color in ((0.2, (1.0, 0.0, 0.0)), (-0.2, (0.0, 0.0, 1.0))))
    black = floor(4.0, 0.0, Material(albedo=(0.0,) * 3))
    image = draw(make_scene([red, blue, black], camera=TOP), SIZE)["final"]
    np.testing.assert_allclose(image[24, 8], (0.25, 0.0, 0.5), rtol=3e-3)
    np.testing.assert_allclose(image[24, 40], (0.5, 0.0, 0.25), rtol=3e-3)


def test_nothing_is_seen_through_what_is_opaque() -> None:
    hidden = floor(1.0, 0.2, veil((1.0, 0.0, 0.0), 0.5, is_unlit=True))
    lid = floor(1.0, 0.5, Material(albedo=(0.2, 0.4, 0.6), is_unlit=True))
    np.testing.assert_allclose(middle(make_scene([hidden, lid, WALL], camera=TOP)), (0.2, 0.4, 0.6), rtol=2e-3)


@pytest.mark.parametrize("f0", [0.0, 0.1])
def test_a_thin_pane_tints_what_is_behind_it(f0: float) -> None:
    pane = glass((0.5, 1.0, 0.25), specular=(f0,) * 3, ior=2.0)
    scene = make_scene([floor(1.0, 0.5, pane), WALL], camera=TOP)
    np.testing.assert_allclose(middle(scene), (1 - f0) * np.array((0.4, 0.6, 0.1)), rtol=3e-3)
    twice = make_scene([floor(1.0, 0.5, pane), floor(1.0, 0.7, pane), WALL], camera=TOP)
    np.testing.assert_allclose(middle(twice), (1 - f0) ** 2 * np.array((0.2, 0.6, 0.025)), rtol=4e-3)


def test_glass_may_have_a_specular_map() -> None:
    """What the map takes from the reflection passes."""
    half = Texture(np.full((1, 1, 4), 0.5, np.float32))
    mapped = glass((0.5, 1.0, 0.25), specular=(0.4,) * 3, specular_map=half)
    plain = glass((0.5, 1.0, 0.25), specular=(0.1,) * 3)
    seen, expected = (middle(make_scene([floor(1.0, 0.5, pane), WALL], camera=TOP)) for pane in (mapped, plain))
    np.testing.assert_allclose(seen, expected, rtol=2e-3)


def test_what_does_not_pass_is_reflected_diffusely() -> None:
    half = Texture(np.full((1, 1, 4), 128, np.uint8), is_color=False)
    pane = glass((0.5, 1.0, 0.25), factor=0.8, factor_map=half)
    black = floor(4.0, 0.0, Material(albedo=(0.0,) * 3))
    expected = (1 - 0.8 * 128 / 255) * np.array((0.5, 1.0, 0.25))
    np.testing.assert_allclose(middle(make_scene([floor(1.0, 0.5, pane), black], [OVERHEAD], TOP)), expected, rtol=5e-3)


RAMP = Texture(np.linspace(0, 1, 257, dtype=np.float32)[:, None, None].repeat(4, axis=2), repeat=(False, False))


def test_a_volume_shifts_what_is_behind_it_by_refraction() -> None:
    """As seen where the refracted ray leaves the volume; an index of 1 changes nothing at all."""
    ground = floor(4.0, 0.0, Material(albedo=WHITE, albedo_map=RAMP, is_unlit=True))
    plain = draw(make_scene([ground], camera=SLANTED), SIZE)["final"]
    for ior in (1.0, 1.5):
        pane = floor(2.0, 0.5, glass(ior=ior, thickness=0.5))
        seen = draw(make_scene([pane, ground], camera=SLANTED), SIZE)["final"]
        if ior == 1:
            np.testing.assert_allclose(seen, plain, atol=2e-3)
        refracted = math.asin(math.sin(math.pi / 4) / ior)
        below = 0.5 - 0.5 * math.cos(refracted)  # height of the point where the ray leaves
        z = 0.5 - 0.5 * math.sin(refracted)
        z -= below * (2 - z) / (2 - below)       # that point is seen over this one of the ground
        np.testing.assert_allclose(seen[23:25, 23:25].mean(), 1 - (4 - z) / 8, atol=4e-3)


@pytest.mark.parametrize("camera", [SLANTED, replace(SLANTED, fov_y_deg=0.0, orthographic_height=1.0)])
def test_what_is_inside_a_volume_is_seen_where_the_refracted_ray_meets_it(camera: Camera) -> None:
    below = 0.2  # the front of the volume
    inside = floor(4.0, 0.5 - below, Material(albedo=WHITE, albedo_map=RAMP, is_unlit=True))
    seen = draw(make_scene([floor(2.0, 0.5, glass(ior=1.5, thickness=0.8)), inside], camera=camera), SIZE)["final"]
    refracted = math.asin(math.sin(math.pi / 4) / 1.5)
    z = 0.5 - below * math.tan(refracted)
    np.testing.assert_allclose(seen[23:25, 23:25].mean(), 1 - (4 - z) / 8, atol=4e-3)


def test_glass_does_not_repeat_what_stands_before_it() -> None:
    """A red strip on a block of glass, where the refracted view meets it from below; its outline counts too."""
    ground = floor(4.0, 0.0, Material(albedo=(0.0, 0.0, 1.0), is_unlit=True))
    strip = floor(0.12, 0.52, Material(albedo=(1.0, 0.0, 0.0), is_unlit=True))
    seen = [draw(make_scene([*things, ground], camera=SLANTED), (96, 96))["final"][..., 0] > 0.3
            for things in ((strip,), (strip, floor(1.5, 0.5, glass(ior=1.5, thickness=0.4))))]
    assert seen[0].sum() > 50
    assert (seen[1] & ~seen[0]).sum() < 0.03 * seen[0].sum()


def test_what_a_thing_before_glass_hides_from_it_is_filled_from_beside_it() -> None:
    """Not with what is seen without refraction, which is farther away: on a ramp, so is its value."""
    ground = floor(4.0, 0.0, Material(albedo=WHITE, albedo_map=RAMP, is_unlit=True))
    block = floor(1.5, 0.5, glass(ior=1.5, thickness=0.4))
    strip = quad((-1.5, 0.52, 0.03), (3.0, 0, 0), (0, 0, -0.06), Material(albedo=(1.0, 0.0, 0.0), is_unlit=True))
    clear, seen = (draw(make_scene([*things, block, ground], camera=SLANTED), (96, 96))["final"]
                   for things in ((), (strip,)))
    is_strip = seen[..., 0] > 1.5 * seen[..., 1]
    error = np.abs(seen - clear)[~is_strip][:, 1].max()
    print(f"HIDDEN {error:.4f}")
    assert 0.001 < error < 0.03  # 0.07 without refraction


def test_a_volume_of_infinite_index_stays_finite() -> None:
    pane = floor(1.0, 0.5, glass(ior=math.inf, thickness=0.5, roughness=0.5))
    with Renderer(make_scene([pane, WALL], camera=TOP), Settings(SIZE, taa=False, check=True, provider="cpu")) as r:
        r.render(TOP)
        assert not any(p.get("non_finite") for p in r.timing()["passes"].values())


def test_a_volume_absorbs() -> None:
    pane = glass(thickness=0.5, attenuation_color=(0.5, 0.25, 1.0), attenuation_distance=0.25)
    scene = make_scene([floor(1.0, 0.8, pane), WALL], camera=TOP)
    np.testing.assert_allclose(middle(scene), np.array((0.8, 0.6, 0.4)) * np.array((0.5, 0.25, 1.0)) ** 2, rtol=3e-3)


def test_rough_glass_blurs_what_is_far_behind_it() -> None:
    """The farther it is behind the glass, the more; light is conserved."""
    stripes = np.zeros((1, 64, 4), np.float32)
    stripes[:, ::2] = 1.0
    ground = floor(2.0, 0.0, Material(albedo=WHITE, albedo_map=Texture(stripes), is_unlit=True))
    spread = []
    for height in (0.01, 0.3, 1.0):
        pane = floor(2.0, height, glass(roughness=0.3))
        seen = draw(make_scene([pane, ground], camera=TOP), (192, 192))["final"][64:128, 64:128]
        assert seen.mean() == pytest.approx(0.5, abs=0.02)
        spread.append(seen.std())
    assert spread[0] > 3 * spread[1] and spread[1] > spread[2]
    assert spread[2] < 0.05


LAMP = Material(albedo=(50.0, 50.0, 50.0), is_unlit=True)
BLACK = Material(albedo=(0.0, 0.0, 0.0), is_unlit=True)
BEHIND_PANE = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_y_deg=60.0)


def lamp_behind_a_pane(roughness: float, *others: Part, below: float = 1.0) -> tuple[Scene, Scene]:
    """A small square lamp behind rough glass, before black; with the glass and without."""
    room = [quad((0.32, -0.05, -below), (0.1, 0, 0), (0, 0.1, 0), LAMP),
            quad((-8, -8, -1.2), (16, 0, 0), (0, 16, 0), BLACK)]
    pane = quad((-8, -8, 0), (16, 0, 0), (0, 16, 0), glass(roughness=roughness))
    return make_scene([*room, pane, *others], camera=BEHIND_PANE), make_scene(room, camera=BEHIND_PANE)


def spread_by_ggx(picture: np.ndarray, radius: float) -> np.ndarray:
    """Convolved with the distribution of GGX's slopes, half of which are within a radius in pixels."""
    y, x = (np.minimum(i, 2048 - i) for i in np.indices((2048, 2048)))
    kernel = radius**2 / (np.pi * (x**2 + y**2 + radius**2) ** 2)
    padded = np.pad(picture, [(0, 2048 - side) for side in picture.shape])
    spread = np.fft.irfft2(np.fft.rfft2(padded) * np.fft.rfft2(kernel), padded.shape)
    return spread[:picture.shape[0], :picture.shape[1]]


@pytest.mark.parametrize("size", [(480, 270), (633, 361), (1024, 768)])
@pytest.mark.parametrize("roughness", [0.25, 0.5])
def test_rough_glass_spreads_a_lamp_as_ggx_does_its_slopes(size: tuple[int, int], roughness: float) -> None:
    """In the first frame."""
    seen, bare = (draw(s, size)["final"][..., 1].astype(np.float64) for s in lamp_behind_a_pane(roughness))
    radius = roughness**2 / 4 * size[1] / math.tan(math.radians(30))  # 1 of 4 units is behind the glass
    expected = spread_by_ggx(bare, radius)
    assert seen.sum() == pytest.approx(expected.sum(), rel=0.07)
    rows, columns = np.indices(bare.shape)
    away = np.hypot(rows - (rows * bare).sum() / bare.sum(), columns - (columns * bare).sum() / bare.sum()) / radius
    for first, last, bias, noise in ((0.0, 1.0, 0.3, 0.5), (1.0, 2.0, 0.2, 0.9), (2.0, 4.0, 0.6, 2.0)):
        ring = (first <= away) & (away < last)
        ratio = seen[ring].sum() / expected[ring].sum()
        assert ratio == pytest.approx(1.0, abs=bias)
        assert np.sqrt(np.mean((seen[ring] - ratio * expected[ring]) ** 2)) < noise * expected[ring].mean()


def test_rough_glass_hides_the_outline_of_what_is_right_behind_it() -> None:
    """Of a lamp, although the wall beside it is far behind."""
    below, size = 0.15, (640, 480)
    scene, bare = lamp_behind_a_pane(0.5, below=below)
    with Renderer(scene, Settings(size=size, provider="cpu"), None) as renderer:
        seen = [renderer.render(BEHIND_PANE)["final"][..., 1] for _ in range(32)][-1].astype(np.float64)
    lamp = draw(bare, size)["final"][..., 1].astype(np.float64)
    expected = spread_by_ggx(lamp, 0.25 * below / (3.0 + below) * size[1] / math.tan(math.radians(30)))
    assert seen.sum() == pytest.approx(expected.sum(), rel=0.3)
    inside = lamp > 25.0
    beside = ~inside & (expected > 0.4 * expected.max())
    assert seen[inside].mean() == pytest.approx(expected[inside].mean(), rel=0.35)
    assert seen[beside].mean() > 0.3 * expected[beside].mean()


BEFORE_PANE = {"card": quad((-0.6, -0.2, 1.0), (0.3, 0, 0), (0, 0.4, 0), LAMP),
               "pole": quad((0.0, -3.0, 1.0), (0.02, 0, 0), (0, 6.0, 0), BLACK),
               "muntin": quad((0.6, -3.0, 0.01), (0.03, 0, 0), (0, 6.0, 0), BLACK)}


@pytest.mark.parametrize("name", BEFORE_PANE)
def test_what_stands_before_rough_glass_changes_nothing_around_it(name: str) -> None:
    """Neither is it spread itself, nor is what it hides missed in the light of the glass beside it."""
    scenes = [lamp_behind_a_pane(0.5, *others)[0] for others in ([BEFORE_PANE[name]], [])]
    before, without = (draw(scene, (481, 271), ("final", "depth")) for scene in scenes)
    free = (before["depth"] == without["depth"])[..., 0]
    assert 0.9 < free.mean() < 1.0
    change = np.abs(before["final"] - without["final"])[free]
    assert change.mean() < 0.03 * without["final"][free].mean()


def test_rough_glass_before_nothing_spreads_a_lamp_in_parallel_views() -> None:
    roughness = 0.25
    camera = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), orthographic_height=3.4)
    pane = quad((-8, -8, 0), (16, 0, 0), (0, 16, 0), glass(roughness=roughness))
    lamp = quad((-0.05, -0.05, -0.3), (0.1, 0, 0), (0, 0.1, 0), LAMP)
    seen, bare = (draw(make_scene(parts, camera=camera), (320, 240))["final"][..., 1].astype(np.float64)
                  for parts in ([lamp, pane], [lamp]))
    expected = spread_by_ggx(bare, 2 * roughness**2 * 0.3 * 240 / 3.4)
    rows, columns = np.indices(seen.shape)
    near = np.hypot(rows - 119.5, columns - 159.5) < 40
    assert seen[near].sum() == pytest.approx(expected[near].sum(), rel=0.4)
    assert np.median(seen[~near]) < 0.05 * seen[near].mean()


def test_glass_shows_the_sky_and_its_reflection() -> None:
    """A smooth pane under an even sky: what it does not let pass it reflects."""
    pane = floor(3.0, 0.0, glass(specular=(0.04,) * 3))
    scene = replace(make_scene([pane], camera=SLANTED), environment=Environment(np.ones((4, 8, 3), np.float32)))
    np.testing.assert_allclose(middle(scene), 1.0, atol=0.02)


def test_layers_do_not_ghost() -> None:
    """A textured pane that moves over a textured wall: history changes it as little as it changes an opaque one."""
    noise = np.random.default_rng(0).random((16, 16, 1), np.float32).repeat(4, axis=0).repeat(4, axis=1)
    texture = Texture(np.concatenate([noise.repeat(3, axis=2), np.ones_like(noise)], axis=2))
    ground = floor(4.0, material=Material(albedo=(0.8, 0.6, 0.4), is_unlit=True, albedo_map=replace(
        texture, transform=np.diag([8.0, 8.0, 1.0]))))
    errors = []
    for material in (veil((1.0, 0.2, 0.0), 0.8), Material(albedo=(1.0, 0.2, 0.0))):
        pane = quad((-1, 0.5, 0.3), (0.6, 0, 0), (0, 0, -0.6), replace(material, is_unlit=True, albedo_map=texture),
                    slide((0.0, 1.0), [(0, 0, 0), (1.4, 0, 0)]))
        scene = make_scene([pane, ground], camera=TOP)
        with Renderer(scene, Settings((192, 192), provider="cpu")) as renderer:
            for step in range(10):
                image = renderer.render(TOP, 0.02 * step)["final"]
        with Renderer(scene, Settings((192, 192), taa=False, provider="cpu")) as renderer:
            alone = renderer.render(TOP, 0.18)["final"]
        errors.append(float(np.sqrt(((image - alone) ** 2).mean())))
    assert errors[0] < 1.3 * errors[1] < 0.03


LAMPS: dict[str, Light] = {
    "sun": OVERHEAD, "soft sun": replace(OVERHEAD, angular_radius_deg=1.0),
    "point": PointLight((0.0, 4.0, 0.0), (16 * math.pi,) * 3),
    "sphere": PointLight((0.0, 4.0, 0.0), (16 * math.pi,) * 3, 0.05),
    "spot": SpotLight((0.0, 4.0, 0.0), (0.0, -1.0, 0.0), (16 * math.pi,) * 3, 20.0, 30.0),
}


@pytest.mark.parametrize("name", LAMPS)
def test_shadows_have_the_color_of_what_passes(name: str) -> None:
    """Of two panes the product; beyond their edges there is none, nor above them."""
    panes = [quad((-0.2, y, 0.2), (0.4, 0, 0), (0, 0, -0.4), m)
             for y, m in ((1.0, glass((0.5, 1.0, 0.25))), (1.1, veil((1.0, 0.0, 0.0), 0.5)))]
    white = floor(2.0, 0.0, Material(albedo=WHITE))
    camera = Camera((0.0, 1.0, 3.0), (0.0, 0.0, 0.0), fov_y_deg=10.0)  # below the panes
    shaded, free = (middle(make_scene([*above, white], [LAMPS[name]], camera)) for above in (panes, ()))
    np.testing.assert_allclose(shaded / free, (0.25, 0.5, 0.125), rtol=0.01)
    aside = replace(camera, eye=(1.0, 1.0, 3.0), target=(1.0, 0.0, 0.0))
    beside, plain = (middle(make_scene([*above, white], [LAMPS[name]], aside)) for above in (panes, ()))
    np.testing.assert_allclose(beside, plain, rtol=1e-3)
    lid = floor(0.1, 1.5, Material(albedo=WHITE))
    over = replace(camera, eye=(0.0, 3.0, 0.5), target=(0.0, 1.5, 0.0))
    above, bare = (middle(make_scene([*parts, lid, white], [LAMPS[name]], over)) for parts in (panes, ()))
    np.testing.assert_allclose(above, bare, rtol=1e-3)


def test_rays_pass_by_the_coverage() -> None:
    """Shadows of a large light are traced: half of its light passes a pane of alpha 0.5."""
    lamp = RectLight((0.0, 1.5, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), WHITE)
    white = floor(2.0, 0.0, Material(albedo=WHITE))
    camera = Camera((0.0, 0.4, 2.0), (0.0, 0.0, 0.0), fov_y_deg=10.0)
    shade = floor(3.0, 0.8, veil(WHITE, 0.5))
    shaded, free = (middle(make_scene([*above, white], [lamp], camera)) for above in ((shade,), ()))
    np.testing.assert_allclose(shaded / free, 0.5, atol=0.06)


def test_texels_without_a_layer_are_black_whatever_they_were() -> None:
    """A new texture holds anything on a GPU: what no pane was drawn into is cleared."""
    scene = make_scene([floor(0.2, 0.5, glass(specular=(0.04,) * 3)), WALL], [OVERHEAD], TOP)
    with Renderer(scene, Settings(SIZE, taa=False, check=True, provider="cpu")) as renderer:
        written = ("peel0_direct", "peel0_specular", "peel3_direct", "peel3_specular")
        with renderer._gl.ctx:
            for name in written:
                renderer._pool.write(name, np.nan)
        renderer.render(TOP)
        for name in written:
            assert not renderer.resource(name)[0, 0, :3].any()
        assert not any(renderer._non_finite.values())


def hall(curtain: Material) -> Scene:
    """A room of 4 m, open at -z, whose opening a curtain covers, on a bright lawn below a bright sky, from inside."""
    grey, lawn = Material(albedo=(0.6, 0.5, 0.4)), Material(albedo=(0.3, 0.8, 0.2))
    parts = [quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), grey), quad((-2, 3, -2), (4, 0, 0), (0, 0, 4), grey),
             quad((-2, 0, -2), (0, 3, 0), (0, 0, 4), grey), quad((2, 0, 2), (0, 3, 0), (0, 0, -4), grey),
             quad((2, 0, 2), (-4, 0, 0), (0, 3, 0), grey), quad((-2, 0, -2), (4, 0, 0), (0, 3, 0), curtain),
             quad((-20, -0.01, -2), (40, 0, 0), (0, 0, -40), lawn)]
    lamp = PointLight((0.0, 2.5, 0.5), (3.0, 3.0, 3.0))
    camera = Camera((0.0, 1.5, 1.5), (0.0, 1.5, -2.0), fov_y_deg=40.0)
    sky = np.full((4, 8, 3), (2.0, 3.0, 4.0), np.float32)
    return replace(make_scene(parts, [lamp], camera), environment=Environment(sky))


@pytest.mark.parametrize("model", ["small_ember", "final-gather"])
def test_a_curtain_is_lit_by_its_room(model: str, request: pytest.FixtureRequest) -> None:
    """One that lets next to nothing pass looks like an opaque one, whatever is outside."""
    network = request.getfixturevalue(model) if model == "small_ember" else find_model(model)
    scenes = (hall(veil((0.8, 0.8, 0.8), 0.999)),
              hall(Material(albedo=(0.8, 0.8, 0.8))))
    seen, opaque = (draw(scene, (96, 72), model=network)["final"][18:54, 24:72].mean(axis=(0, 1)) for scene in scenes)
    np.testing.assert_allclose(seen, opaque, rtol=0.15)


@pytest.mark.parametrize("outside", ["sky", "wall"])
def test_indirect_light_has_the_color_of_a_window(outside: str) -> None:
    """That of the sky, and that of a wall outside, which a lamp lights that the room does not see.

    By all surfels: which rays pass is left to chance, and with few of them the light is off by up to a third.
    """
    color = np.float32((0.9, 0.4, 0.2))
    camera = Camera((2.0, 2.0, 3.6), (2.0, 0.0, 2.0), fov_y_deg=60.0)
    lit = [quad((-2, -2, -3), (8, 0, 0), (0, 8, 0), Material(albedo=(0.5,) * 3))] if outside == "wall" else []

    def indirect(color: tuple[float, ...]) -> np.ndarray:
        room, more = cellar(2.0), make_scene([*lit, quad((1, 1, 0), (2, 0, 0), (0, 2, 0), glass(color))])  # type: ignore[arg-type]
        meshes, materials = len(room.meshes), len(room.materials)
        scene = replace(
            room, meshes=(*room.meshes, *(replace(m, material=m.material + materials) for m in more.meshes)),
            instances=(*room.instances, *(replace(i, mesh=i.mesh + meshes) for i in more.instances)),
            materials=(*room.materials, *more.materials))
        if lit:
            scene = replace(scene, environment=None, lights=(PointLight((2.0, -1.5, -1.5), (9.0,) * 3),))
        return draw(scene, SIZE, ("indirect",), camera, find_model("ember"))["indirect"].mean(axis=(0, 1))

    np.testing.assert_allclose(indirect(tuple(color.tolist())) / indirect(WHITE), color, rtol=0.1)


@pytest.mark.parametrize("behind", [True, False])
def test_narrow_veils_are_lit_like_wide_ones(behind: bool) -> None:
    """Strips of a pixel or two below a white sky, before a dark wall or nothing."""
    strips = [quad((-1 + k / 6, -1, 0), (0.015, 0, 0), (0, 2, 0), veil((0.5,) * 3, 0.999)) for k in range(12)]
    wall = [quad((-3, -3, -2), (6, 0, 0), (0, 6, 0), Material(albedo=(0.0,) * 3))] if behind else []
    camera = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_y_deg=40.0)
    sky = np.ones((4, 8, 3), np.float32)
    scene = replace(make_scene([*strips, *wall], camera=camera), environment=Environment(sky))
    with Renderer(scene, Settings((320, 240), ("final",), taa=False, provider="cpu"),
                  find_model("final-gather")) as renderer:
        image = renderer.render(camera)["final"][60:180, :, 0]
        shown = renderer.resource("peel0_depth")[60:180, :, 0] > 0
    print(f"STRIPS {np.percentile(image[shown], [5, 50, 95])}")
    assert shown.mean() > 0.02
    assert np.percentile(image[shown], 5) > 0.4 and np.percentile(image[shown], 95) < 0.6


def test_a_veil_alone_below_a_sky_is_lit_by_it() -> None:
    """There are no surfaces but itself to know light from; half of a white sky is what arrives."""
    veiled = quad((-0.5, 0.0, 0.5), (1.0, 0, 0), (0, 0, -1.0), veil((0.5,) * 3, 0.999))
    scene = replace(make_scene([veiled], camera=SLANTED), environment=Environment(np.ones((4, 8, 3), np.float32)))
    np.testing.assert_allclose(middle(scene, model=find_model("final-gather")), 0.5, rtol=0.1)


def test_a_model_that_shades_the_environment_leaves_panes_their_sky() -> None:
    """A veil and glass before nothing but the sky, as without a model."""
    pictures = []
    for model in (None, UNSHADOWED):
        panes = [quad((x, 0.0, 0.5), (0.6, 0, 0), (0, 0, -1.0), m)
                 for x, m in ((-0.6, veil(WHITE, 0.5)), (0.0, glass(specular=(0.5,) * 3)))]
        sky = np.linspace(0.2, 2.0, 32, dtype=np.float32).reshape(4, 8, 1).repeat(3, axis=2)
        scene = replace(make_scene(panes, camera=SLANTED), environment=Environment(sky))
        with Renderer(scene, Settings(SIZE, taa=False, provider="cpu"), model) as renderer:
            pictures.append(renderer.render(SLANTED)["final"])
    assert pictures[0][24, 16].min() > 0.1 and pictures[0][24, 32].min() > 0.1
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("light", [
    DirectionalLight((0.3, -1.0, 0.1), (1.0,) * 3), DirectionalLight((0.3, -1.0, 0.1), (1.0,) * 3, 1.5),
    PointLight((-0.6, 3.0, 0.0), (1.0,) * 3), PointLight((-0.6, 3.0, 0.0), (1.0,) * 3, 0.05),
], ids=["hard sun", "soft sun", "point", "sphere"])
def test_bars_in_a_coloured_pane_cast_shadows_in_its_colour(light: Light) -> None:
    """All light comes through the pane, that beside the bars too, and what they hide of the pane is not lit."""
    bars = [box((x - 0.02, 1.48, -0.5), (0.04, 0.04, 1.0)) for x in (-0.3, -0.1, 0.1)]
    around = [box((-2.5, 1.49, -2.0), (2.0, 0.02, 4.0)), box((0.5, 1.49, -2.0), (2.0, 0.02, 4.0)),
              box((-0.5, 1.49, -2.0), (1.0, 0.02, 1.5)), box((-0.5, 1.49, 0.5), (1.0, 0.02, 1.5))]
    camera = Camera((0.4, 1.4, 0.1), (0.4, 0.0, 0.0), (0.0, 0.0, -1.0), 60.0)
    size = (128, 128)
    lit = draw(make_scene([floor(4.0), floor(1.0, 1.5, glass((0.8, 0.4, 0.2))), *bars, *around], [light], camera), size,
               ("direct",))["direct"][..., :3].astype(np.float64)
    clear = draw(make_scene([floor(4.0), *bars, *around], [light], camera), size, ("direct",))["direct"][..., :3]
    seen = lit[..., 0] > 0.03 * lit.max()
    color = lit[seen] / lit[seen][:, :1]
    print(f"BARS color {color.min(axis=0)} to {color.max(axis=0)} in {seen.mean():.2f} of the texels")
    assert seen.mean() > 0.2 and (lit[..., 0] < 0.5 * lit.max()).mean() > 0.2
    np.testing.assert_allclose(color, np.broadcast_to((1.0, 0.5, 0.25), color.shape), rtol=0.01)
    np.testing.assert_allclose(lit.mean(axis=(0, 1)), clear.mean() * np.array((0.8, 0.4, 0.2)), rtol=0.02)


@pytest.mark.parametrize("above", [0.03, 0.1, 1.0])
@pytest.mark.parametrize("name", ["sun", "sphere", "rectangle"])
def test_coloured_shadows_of_large_lamps_have_penumbrae(name: str, above: float) -> None:
    """Across the edge of a half plane of glass, light turns as the share of the light's image that the glass covers."""
    radius, height, side = 0.05, 4.0, 0.2
    lamps: dict[str, Light] = {
        "sun": replace(OVERHEAD, angular_radius_deg=math.degrees(math.atan(radius / height))),
        "sphere": PointLight((0.0, height, 0.0), (16 * math.pi,) * 3, radius),
        "rectangle": RectLight((0.0, height, 0.0), (2 * radius, 0.0, 0.0), (0.0, 0.0, 2 * radius), (1e3,) * 3),
    }
    pane = quad((0.0, above, 2.0), (4.0, 0, 0), (0, 0, -4.0), glass((0.2, 0.2, 0.2)))
    # From below the pane, or past its edge.
    camera = Camera((0.0, 0.8 * above, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), orthographic_height=side)
    lit, free = (draw(make_scene([floor(4.0), *p], [lamps[name]], camera), (96, 96), ("direct",))["direct"][..., 0]
                 for p in ([pane], []))
    x = ((np.arange(96) + 0.5) / 96 - 0.5) * side
    seen = np.clip(-x * ((height - above) / above if name != "sun" else height / above) / radius, -1.0, 1.0)
    share = (seen + 1) / 2 if name == "rectangle" else 0.5 + (seen * np.sqrt(1 - seen**2) + np.arcsin(seen)) / math.pi
    found = ((lit / free).mean(axis=0) - 0.2) / 0.8
    error, noise = np.abs(found - share), (lit / free).std(axis=0).max()
    print(f"PENUMBRA of {name} from {above} m: {error.max():.3f}, {error.mean():.3f} on the mean, noise {noise:.3f}")
    # A shadow from nearby has a penumbra narrower than texels of the map, which blur its edge.
    assert error[np.abs(x) > 0.02].max() < 0.02 and error.mean() < 0.03 and noise < 0.05
    assert error.max() < 0.08 or above < 1.0


def test_panes_behind_a_pane_take_no_light_from_a_room_of_one_brightness() -> None:
    """What a level pane does not let through at a grazing view, it mirrors, also where another pane is before it."""
    glowing = Material(albedo=(0.6,) * 3, emission=(1.0,) * 3)
    glass = Material(albedo=(1.0,) * 3, specular=(0.04,) * 3, roughness=0.0, transmission=Transmission(1.0),
                     double_sided=True)
    camera = Camera((0.0, 0.25, 1.8), (0.0, 0.0, 0.0), fov_y_deg=40)
    panes = [quad((-1.0, -1.0, 1.0), (2.0, 0, 0), (0, 2.0, 0), glass),
             *(quad((-1.0, y, 0.8), (2.0, 0, 0), (0, 0, -1.6), glass) for y in (0.0, -0.02))]
    scene = make_scene([box((-2, -2, -2), (4, 4, 4), glowing), *panes], (), camera)
    with Renderer(scene, Settings((256, 192), ("final",), provider="cpu"), find_model("ember")) as renderer:
        for _ in range(8):
            image = renderer.render(camera)["final"][..., 1]
    print(f"LEVEL panes: {image.min():.3f} to {image.max():.3f}, mean {image.mean():.4f} of the 2.5 everywhere")
    np.testing.assert_allclose(image, 2.5, rtol=0.06)
