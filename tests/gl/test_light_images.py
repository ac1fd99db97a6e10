"""Light of textured rectangles against float64 quadrature of their images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.errors import SceneError
from app.renderer import Renderer
from app.scene import Camera, EmissionImage, Material, RectLight
from app.settings import Settings
from app.specular_albedo import lobe_albedo
from tests.gl.closed_forms import unit
from tests.gl.scenes import draw, floor, make_scene, quad, without_shadows
from tests.gl.test_rect_highlights import lobe_samples

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

F64 = NDArray[np.float64]

SIDE = 256  # texels of images
SIZE = 64, 48
ABOVE = Camera((0.0, 4.0, 0.01), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 50.0)


def image() -> EmissionImage:
    """Red on the left, blue on the right, a green disc and a black frame: such as a screen shows."""
    v, u = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE
    pixels = np.stack([u < 0.45, np.hypot(u - 0.7, v - 0.3) < 0.15, u > 0.55], axis=-1).astype(np.float64)
    pixels[(np.minimum(u, v) < 0.06) | (np.maximum(u, v) > 0.94)] = 0
    return EmissionImage((pixels / pixels.mean(axis=(0, 1))).astype(np.float32))


def pane(height: float = 0.1) -> RectLight:
    """Upright, so high above a floor."""
    return RectLight((0.0, height + 0.4, -1.0), (1.4, 0.0, 0.0), (0.0, 0.8, 0.0), (3.0, 2.0, 1.0), image=image())


def irradiance(light: RectLight, at: F64, normal: F64, hides: F64 | None = None) -> F64:
    """At points [N, 3], from the texels of which ``hides`` [S, S, N] is not true."""
    assert light.image is not None
    pixels = light.image.pixels.reshape(64, 4, 64, 4, 3).mean(axis=(1, 3)).astype(np.float64)
    v, u = (np.mgrid[:64, :64] + 0.5) / 64 - 0.5
    to = np.asarray(light.center) + u[..., None] * light.edge_u + v[..., None] * light.edge_v - at[:, None, None]
    facing = np.cross(light.edge_u, light.edge_v)
    square = (to**2).sum(axis=-1)
    form = np.maximum(to @ normal, 0) * np.maximum(-to @ facing, 0) / square**2 / 64**2
    if hides is not None:
        form = form * ~hides
    return np.asarray(np.einsum("nvu,vuc->nc", form, pixels) * light.radiance)


@pytest.mark.parametrize("height", [0.05, 0.3, 1.0])
def test_diffuse_light_has_the_colours_of_the_nearest_parts(height: float) -> None:
    light = pane(height)
    scene = without_shadows(make_scene([floor(2.0, material=Material(albedo=(1.0,) * 3))], [light], ABOVE))
    images = draw(scene, SIZE, ("direct", "position", "depth"), ABOVE)
    at = images["position"].reshape(-1, 3).astype(np.float64)
    is_before = (at[:, 2] > -0.95) & (images["depth"].ravel() > 0)
    expected = irradiance(light, at[is_before], np.array([0.0, 1.0, 0.0])) / np.pi
    drawn = images["direct"].reshape(-1, 3)[is_before]
    plain = draw(replace(scene, lights=(replace(light, image=None),)), SIZE, ("direct",), ABOVE)["direct"]
    error, before = (np.abs(x - expected).mean(axis=0) / expected.mean(axis=0)
                     for x in (drawn, plain.reshape(-1, 3)[is_before]))
    print(f"DIFFUSE at {height}: error {error.round(3)} of the mean, without the image {before.round(3)}; "
          f"all {(drawn.mean(axis=0) / expected.mean(axis=0)).round(3)}")
    assert error.max() < {0.05: 0.12, 0.3: 0.045, 1.0: 0.012}[height]
    assert error.max() < 0.3 * before.max()


@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.4, 0.7])
def test_highlights_show_the_image_as_wide_as_the_lobe(roughness: float) -> None:
    light = replace(pane(0.4), radiance=(1.0,) * 3)
    mirror = Material(albedo=(0.0,) * 3, roughness=roughness, specular=(1.0,) * 3)
    camera = Camera((0.0, 1.2, 2.0), (0.0, 0.0, 0.0), fov_y_deg=50.0)
    scene = without_shadows(make_scene([floor(2.0, material=mirror)], [light], camera))
    images = draw(scene, (48, 36), ("specular", "position"), camera)
    at = images["position"].astype(np.float64)
    rows = np.argwhere((np.abs(at[..., 0]) < 1.2) & (np.abs(at[..., 2]) < 0.8) & (images["specular"].max(-1) > 0))[::2]
    expected, drawn = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    plain = draw(replace(scene, lights=(replace(light, image=None),)), (48, 36), ("specular",), camera)["specular"]
    for number, (y, x) in enumerate(rows):
        directions, weight = lobe_samples(at[y, x], np.array(camera.eye), roughness**2, 2**14)
        expected[number] = weight @ seen(light, at[y, x], directions)
        cosine = float(unit(np.array(camera.eye) - at[y, x])[1])
        drawn[number] = images["specular"][y, x] * lobe_albedo(roughness**2, cosine)
    error = np.abs(drawn - expected).mean(axis=0) / expected.mean(axis=0)
    before = np.abs(plain[tuple(rows.T)] - expected).mean(axis=0) / expected.mean(axis=0)
    print(f"HIGHLIGHTS of roughness {roughness}: error {error.round(3)} of the mean, without the image "
          f"{before.round(3)}; all {(drawn.mean(axis=0) / expected.mean(axis=0)).round(3)}")
    assert error.max() < {0.1: 0.16, 0.2: 0.33, 0.4: 0.4, 0.7: 0.37}[roughness]
    assert error.max() < 0.7 * before.min()


def seen(light: RectLight, at: F64, directions: F64) -> F64:
    """Radiance along directions [N, 3] from a point in front of the pane."""
    assert light.image is not None
    t = (light.center[2] - at[2]) / np.minimum(directions[:, 2], -1e-9)
    hit = at + t[:, None] * directions - light.center
    u, v = hit[:, 0] / light.edge_u[0] + 0.5, hit[:, 1] / light.edge_v[1] + 0.5
    inside = (directions[:, 2] < 0) & (np.minimum(u, v) >= 0) & (np.maximum(u, v) < 1)
    texels = light.image.pixels[(v * SIDE).astype(int).clip(0, SIDE - 1), (u * SIDE).astype(int).clip(0, SIDE - 1)]
    return np.where(inside[:, None], texels.astype(np.float64), 0.0)


def test_rays_know_which_part_of_an_image_is_hidden() -> None:
    """A board hides the left half, so that no red light arrives where the view of the right half alone is free."""
    light = pane(0.3)
    board = quad((-0.8, 0.0, -0.9), (0.8, 0, 0), (0, 1.4, 0), Material(albedo=(0.0,) * 3, double_sided=True))
    scene = make_scene([floor(2.0, material=Material(albedo=(1.0,) * 3)), board], [light], ABOVE)
    with Renderer(scene, Settings(SIZE, ("direct", "position", "depth"), taa=True)) as renderer:
        for _ in range(24):
            images = renderer.render(ABOVE)
    at = images["position"].reshape(-1, 3).astype(np.float64)
    kept = np.flatnonzero((at[:, 2] > -0.8) & (np.abs(at[:, 1]) < 1e-3) & (images["depth"].ravel() > 0))
    u = (np.arange(64) + 0.5) / 64 - 0.5
    crossing = at[kept, 0, None] + (1.4 * u - at[kept, 0, None]) * (0.9 + at[kept, 2, None]) / (1.0 + at[kept, 2, None])
    hides = np.repeat(((crossing > -0.8) & (crossing < 0))[:, None], 64, axis=1)
    expected = irradiance(light, at[kept], np.array([0.0, 1.0, 0.0]), hides) / np.pi
    drawn = images["direct"].reshape(-1, 3)[kept]
    free = irradiance(light, at[kept], np.array([0.0, 1.0, 0.0])).mean(axis=0) / np.pi
    error = np.abs(drawn - expected).mean(axis=0) / free
    share, drawn_share = expected.mean(axis=0) / free, drawn.mean(axis=0) / free
    print(f"HALF HIDDEN: error {error.round(3)} of the unhidden light, of which {drawn_share.round(3)} arrive, not "
          f"{share.round(3)}")
    assert error.max() < 0.05
    assert np.abs(drawn_share - share).max() < 0.02


def test_highlights_of_cards_behind_each_other_are_those_of_the_front_one() -> None:
    """As of flames on cards; a polished floor shows the surfaces of the lights."""
    card = Material(albedo=(0.0,) * 3, emission=(1.0,) * 3, is_light_proxy=True)
    polished = Material(albedo=(0.0,) * 3, roughness=0.2, specular=(0.5,) * 3)
    camera = Camera((0.0, 1.2, 2.0), (0.0, 0.0, 0.0), fov_y_deg=50.0)
    shown = []
    for depths in ((1.0,), (1.0, 1.2)):
        lights = [replace(pane(0.2), center=(0.0, 0.6, -z)) for z in depths]
        cards = [quad((-0.7, 0.2, -z), (1.4, 0, 0), (0, 0.8, 0), card) for z in depths]
        scene = make_scene([floor(2.0, material=polished), *cards], lights, camera)
        with Renderer(scene, Settings((96, 72), ("specular",), taa=True)) as renderer:
            for _ in range(24):
                images = renderer.render(camera)
        shown.append(images["specular"].mean(axis=(0, 1)))
    print(f"CARDS behind each other: {(shown[1] / shown[0]).round(3)} of the light of one")
    np.testing.assert_allclose(shown[1], shown[0], rtol=0.25)  # what is visible is known for luminance alone
    assert shown[1].mean() == pytest.approx(shown[0].mean(), rel=0.1)


def test_a_light_that_gets_another_image_is_drawn_anew() -> None:
    """By the same renderer, as by one that knows nothing else; beside a light without an image."""
    light, plain = pane(), RectLight((0.0, 1.5, 1.0), (0.3, 0, 0), (0, 0, -0.3), (0.2, 0.2, 0.2))
    turned = replace(light, image=EmissionImage(np.ascontiguousarray(image().pixels[::-1, ::-1])))
    first, second = (make_scene([floor(2.0)], [of_scene, plain], ABOVE) for of_scene in (light, turned))
    with Renderer(first, Settings(SIZE, ("direct",), taa=False)) as renderer:
        before = renderer.render(ABOVE)["direct"]
        assert renderer.relight(second.lights)
        after = renderer.render(ABOVE)["direct"]
    fresh = draw(second, SIZE, ("direct",), ABOVE)["direct"]
    assert np.abs(after - before).max() > 0.1 * fresh.max()
    np.testing.assert_allclose(after, fresh, atol=0.05 * fresh.max())


@pytest.mark.parametrize("pixels", [np.ones((128, 128, 3)), np.full((256, 256, 3), np.nan), -np.ones((256, 256, 3))])
def test_images_that_shaders_can_not_read_are_refused(pixels: F64) -> None:
    with pytest.raises(SceneError, match="bad pixels"):
        EmissionImage(pixels.astype(np.float32))
