"""Black surfaces and broken textures.

Row "black albedo" of the table of hazards.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from app.load import load_scene
from app.scene import Camera, Material, Scene, Texture
from tests.gl.scenes import draw, floor, make_scene, quad
from tests.robustness.scenes import LAMP, SIZE, assert_same, lit_corner, shown
from tests.unit.load_helpers import Gltf

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

FRONT = Camera((0.0, 0.5, 2.0), (0.0, 0.5, 0.0))
TEXELS = 8


def test_a_black_surface_is_exactly_black() -> None:
    """Row "black albedo": the light that falls on it is multiplied, never divided, by 0."""
    black = quad((-0.4, 0.0, 0.5), (0.8, 0, 0), (0, 0.5, 0), Material(albedo=(0.0, 0.0, 0.0)))
    images = shown(lit_corner(LAMP, more=(black,)))
    on = (images["albedo"].max(axis=2) == 0) & (images["depth"][..., 0] > 0)
    assert on.mean() > 0.02
    assert images["indirect"][on].min() > 0
    assert not images["final"][on].any()


def test_one_black_channel_is_exactly_black() -> None:
    red = Material(albedo=(0.8, 0.0, 0.0))
    scene = lit_corner()
    images = shown(replace(scene, materials=(red,) * len(scene.materials)))
    assert images["final"][..., 0].max() > 0.05
    assert not images["final"][..., 1:].any()


def card(pixels: NDArray[np.float32]) -> Scene:
    """A textured square that fills most of the picture; about five pixels a texel."""
    square = quad((-0.5, 0.0, 0.0), (1.0, 0, 0), (0, 1.0, 0), Material(albedo=(1.0,) * 3, albedo_map=Texture(pixels)))
    return make_scene([square, floor(1.5, -0.1)], [LAMP], FRONT)


def grey() -> NDArray[np.float32]:
    pixels = np.full((TEXELS, TEXELS, 4), 0.5, np.float32)
    pixels[..., 3] = 1.0
    return pixels


@pytest.mark.parametrize(("value", "becomes"), [(np.nan, 0.0), (-np.inf, 0.0), (-100.0, 0.0), (np.inf, 65504.0)])
def test_a_broken_texel_stays_alone(value: float, becomes: float) -> None:
    """It counts as black, or as white when infinite; what is more than a texel away is the same to the bit."""
    broken, mended = grey(), grey()
    broken[2, 3, :3], mended[2, 3, :3] = value, becomes
    found = shown(card(broken))
    assert_same(found, shown(card(mended)))
    clean = draw(card(grey()), (122, 94), ("albedo", "position", "direct"))
    spoiled = draw(card(broken), (122, 94), ("albedo", "direct"))
    u, v = clean["position"][..., 0] + 0.5, clean["position"][..., 1]
    away = np.maximum(abs(u - 3.5 / TEXELS), abs(v - (TEXELS - 2.5) / TEXELS)) > 1.001 / TEXELS
    for name in ("albedo", "direct"):
        np.testing.assert_array_equal(spoiled[name][away], clean[name][away], name)
        assert (spoiled[name][~away] != clean[name][~away]).any()
        assert np.isfinite(spoiled[name]).all()


def test_a_texture_of_broken_texels_alone_is_black() -> None:
    images = shown(card(np.full((TEXELS, TEXELS, 4), np.nan, np.float32)))
    on = np.abs(images["normal"][..., 2] - 1) < 1e-3
    assert on.mean() > 0.2
    assert not images["final"][on].any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
def test_broken_texture_coordinates_touch_only_their_triangle(value: float, tmp_path: Path) -> None:
    """They count as 0 in a file; the other triangles keep their texture."""
    def picture(bad: bool) -> dict[str, NDArray[np.float32]]:
        file = Gltf()
        uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [1, 1]], np.float32)
        corners = np.array([[-1, 0, 0], [0, 0, 0], [0, 1, 0], [0.2, 0, 0], [1, 0, 0], [1, 1, 0]], np.float32)
        uvs[5, 1] = value if bad else 1.0
        file.primitive["attributes"] |= {"POSITION": file.array(corners), "TEXCOORD_0": file.array(uvs)}
        pixels = np.random.default_rng(1).integers(60, 200, (TEXELS, TEXELS, 4))
        pixels[..., 3] = 255
        file.material(pbrMetallicRoughness={"baseColorTexture": {"index": file.texture(pixels)}, "metallicFactor": 0})
        scene = load_scene(file.save(tmp_path)).with_lights(LAMP)
        return draw(scene, SIZE, ("albedo", "final", "depth", "position"), FRONT)

    sound, bad = picture(False), picture(True)
    left = sound["position"][..., 0] < 0.1
    np.testing.assert_array_equal(bad["albedo"][left], sound["albedo"][left])
    np.testing.assert_array_equal(bad["depth"], sound["depth"])
    assert np.isfinite(bad["final"]).all() and bad["albedo"].max() <= 1.0


def test_an_albedo_beyond_1_makes_no_energy() -> None:
    """What multiplies to more than 1 counts as 1, directly and in every bounce."""
    scene = lit_corner()
    white, too_white = (shown(replace(scene, materials=(Material(albedo=(a,) * 3),) * len(scene.materials)))
                        for a in (1.0, 7.0))
    assert_same(too_white, white)
