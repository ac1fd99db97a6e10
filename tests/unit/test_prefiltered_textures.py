"""Prefiltered textures, against means and single texels."""

from __future__ import annotations

import numpy as np
import pytest

from app.io.image import srgb_decode
from app.raycast.prefiltered_textures import MAX_SIDE, PrefilteredTextures, sample_nearest
from app.scene import Texture

F32 = np.float32


def image(width: int, height: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(0, 4, (height, width, 4)).astype(F32)


def everywhere(steps: int) -> np.ndarray:
    at = (np.arange(steps) + 0.5) / steps
    return np.stack(np.meshgrid(at, at), -1).reshape(-1, 2)


def test_prefiltering_keeps_the_mean_colour() -> None:
    pixels = image(512, 256)
    color = PrefilteredTextures().sample(Texture(pixels), everywhere(MAX_SIDE * 4))
    np.testing.assert_allclose(color.mean(axis=0), pixels[..., :3].mean(axis=(0, 1)), rtol=1e-4)
    assert color.std() < pixels[..., :3].std() / 4  # 32 texels in one


@pytest.mark.parametrize("size", [(100, 70), (65, 3), (1, 200)])
def test_blocks_of_any_size_are_means(size: tuple[int, int]) -> None:
    """Blocks consist of whole texels, so their edges are off by less than one texel."""
    width, height = size
    ramp = np.broadcast_to(((np.arange(width) + 0.5) / width)[None, :, None], (height, width, 4)).astype(F32)
    uv = everywhere(200)
    color = PrefilteredTextures().sample(Texture(ramp), uv)[:, 0]
    assert np.abs(color - uv[:, 0]).max() <= 1 / width + 0.5 / min(MAX_SIDE, width)


@pytest.mark.parametrize("alpha_tested", [False, True])
def test_colour_is_averaged_over_a_width(alpha_tested: bool) -> None:
    """Of a chequer of texels: single ones, then blends of less and less contrast, and the mean, which stays."""
    pixels = np.ones((64, 128, 4), F32)
    pixels[..., :3] = np.where(np.add.outer(np.arange(64), np.arange(128)) % 2, 1.0, 0.0)[..., None]
    uv = (np.indices((64, 128)).reshape(2, -1).T[:, ::-1] + 0.5) / (128, 64)
    contrast = []
    for texels in (0.0, 1.0, 2.0, 16.0, 1e3):
        texture = Texture(pixels, np.diag([0.5, 1.0, 1.0]))
        width = np.tile(F32([2 * texels / 128, texels / 64]), (len(uv), 1))
        color = PrefilteredTextures().sample(texture, uv * (2, 1), alpha_tested, width)
        np.testing.assert_allclose(color.mean(axis=0), 0.5, atol=1e-3)
        contrast.append(float(color.std()))
    np.testing.assert_allclose(contrast, [0.5, 0.5, 0.0, 0.0, 0.0], atol=1e-3)


def test_the_mean_over_the_largest_width_is_that_of_the_texture() -> None:
    pixels = image(100, 70)
    color = PrefilteredTextures().sample(Texture(pixels), everywhere(3), width=np.full((9, 2), 1e6, F32))
    np.testing.assert_allclose(color, np.tile(pixels[..., :3].mean(axis=(0, 1)), (9, 1)), rtol=2e-3)


@pytest.mark.parametrize("side", [64, 512])
def test_stripes_of_a_narrow_texture_are_averaged(side: int) -> None:
    """Of one row of texels, by widths of a few texels along it, also turned by the texture's transform."""
    pixels = np.ones((1, side, 4), F32)
    pixels[..., :3] = (np.arange(side) % 2)[None, :, None]
    uv = np.random.default_rng(0).random((500, 2))
    turned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for transform, axis in ((np.eye(3), 0), (turned, 1)):
        for width in (np.full((500, 2), 4 / side, F32), np.eye(2, dtype=F32)[[axis] * 500] * 4 / side):
            color = PrefilteredTextures().sample(Texture(pixels, transform), uv, width=width.astype(F32))
            np.testing.assert_allclose(color, 0.5, atol=1e-3)


def test_magnified_texels_stay_squares_if_the_texture_says_so() -> None:
    pixels = np.zeros((1, 4, 4), F32)
    pixels[..., 0] = [[1, 2, 3, 5]]
    uv = np.array([[0.24, 0.5], [0.26, 0.5], [0.74, 0.5]])
    color = PrefilteredTextures().sample(Texture(pixels, magnified="nearest"), uv, width=np.full((3, 2), 0.01, F32))
    assert color[:, 0].tolist() == [1, 2, 3]


def test_dim_light_of_float_texels_is_kept() -> None:
    texture = Texture(np.full((4, 4, 4), 1e-8, F32))
    color = PrefilteredTextures().sample(texture, everywhere(2), width=np.zeros((4, 2), F32))
    np.testing.assert_allclose(color, 1e-8, rtol=1e-4)


def test_texels_beside_an_edge_are_those_of_the_wrap_mode() -> None:
    """At a texture's edge colour is half that of the other side, if it repeats."""
    pixels = np.zeros((1, 4, 4), F32)
    pixels[..., 0] = [[1, 2, 3, 5]]
    uv, width = np.array([[0.0, 0.5], [1.0, 0.5], [0.5, 0.5]]), np.zeros((3, 2), F32)
    for repeat, expected in ((True, [3, 3, 2.5]), (False, [1, 5, 2.5])):
        color = PrefilteredTextures().sample(Texture(pixels, repeat=(repeat, repeat)), uv, width=width)
        np.testing.assert_allclose(color[:, 0], expected, rtol=1e-3)


def test_8_bit_texels_are_averaged_in_linear_space() -> None:
    pixels = np.zeros((128, 128, 4), np.uint8)
    pixels[::2, :, :3] = 255
    pixels[1::2, :, :3] = 64
    color = PrefilteredTextures().sample(Texture(pixels), np.array([[0.3, 0.6]]))
    np.testing.assert_allclose(color, (1 + srgb_decode(np.array(64 / 255, F32))) / 2, rtol=1e-4)


def test_v_grows_upwards_and_u_to_the_right() -> None:
    pixels = np.zeros((2, 2, 4), F32)
    pixels[..., 0] = [[1, 2], [3, 4]]  # top row first
    corners = np.array([[0.1, 0.9], [0.9, 0.9], [0.1, 0.1], [0.9, 0.1]])
    assert PrefilteredTextures().sample(Texture(pixels), corners)[:, 0].tolist() == [1, 2, 3, 4]
    assert sample_nearest(Texture(pixels), corners)[:, 0].tolist() == [1, 2, 3, 4]


def test_uvs_repeat_or_clamp_to_the_edge() -> None:
    pixels = np.zeros((2, 2, 4), F32)
    pixels[..., 0] = [[1, 2], [3, 4]]
    uv = np.array([[1.1, 0.1], [-0.1, 0.1], [0.1, 1.1], [0.1, -0.1], [7.9, -3.9]])
    for repeat, values in (((True, True), [3, 4, 3, 1, 4]), ((False, False), [4, 3, 1, 3, 4]),
                           ((True, False), [3, 4, 1, 3, 4])):
        assert sample_nearest(Texture(pixels, repeat=repeat), uv)[:, 0].tolist() == values


def test_the_transform_maps_mesh_uv_to_texture_uv() -> None:
    pixels = np.zeros((1, 4, 4), F32)
    pixels[..., 0] = [[1, 2, 3, 4]]
    transform = np.array([[0.5, 0, 0.5], [0, 1, 0], [0, 0, 1]])
    assert sample_nearest(Texture(pixels, transform), np.array([[0.1, 0.5], [0.9, 0.5]]))[:, 0].tolist() == [3, 4]


def test_alpha_stays_sharp() -> None:
    pixels = np.zeros((128, 128, 4), np.uint8)
    pixels[:, ::2, 3] = 255
    uv = np.stack([(np.arange(128) + 0.5) / 128, np.full(128, 0.5)], 1)
    assert sample_nearest(Texture(pixels), uv)[:, 3].tolist() == [1.0, 0.0] * 64


def test_broken_texels_give_finite_colours() -> None:
    pixels = np.ones((4, 4, 4), F32)
    pixels[0, :, 0] = [np.nan, np.inf, -np.inf, -5]
    color = PrefilteredTextures().sample(Texture(pixels), everywhere(8))
    assert np.isfinite(color).all() and (color >= 0).all()


def test_cut_out_texels_do_not_bleed_into_the_mean() -> None:
    pixels = np.zeros((128, 128, 4), np.float32)
    pixels[::2, ::2] = (0.2, 0.6, 0.1, 1.0)
    color = PrefilteredTextures().sample(Texture(pixels), np.array([[0.3, 0.7]], np.float32), alpha_tested=True)
    np.testing.assert_allclose(color, [[0.2, 0.6, 0.1]], rtol=1e-4)
