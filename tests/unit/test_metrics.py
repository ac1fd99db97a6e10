"""The metrics against closed forms, and what they refuse."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from app.arrays import F32
from app.errors import MetricError, MissingExtraError
from app.evaluation import metrics

ALL = (metrics.psnr, metrics.ssim, metrics.rel_mse, metrics.flip)


def grey(value: float, size: tuple[int, int] = (16, 20)) -> F32:
    return np.full((*size, 3), value, np.float32)


def picture(size: tuple[int, int] = (24, 32)) -> F32:
    y, x = np.mgrid[:size[0], :size[1]] / 8
    return np.stack([1 + np.sin(x), 1 + np.cos(y), 1 + np.sin(x + y)], axis=2).astype(np.float32)


def linear(encoded: float) -> float:
    """What the sRGB transfer turns into ``encoded``; above 0.04045."""
    return float(((encoded + 0.055) / 1.055) ** 2.4)


def test_exposure_is_one_over_the_95th_percentile_luminance() -> None:
    reference = np.repeat(np.arange(101, dtype=np.float32)[:, None, None], 3, axis=2)
    assert metrics.exposure_of(reference) == pytest.approx(1 / 95)
    green = np.zeros((4, 4, 3), np.float32)
    green[..., 1] = 2
    assert metrics.exposure_of(green) == pytest.approx(1 / (2 * 0.7152))


def test_a_black_reference_has_an_exposure() -> None:
    assert metrics.exposure_of(grey(0)) == 1e12


def test_a_small_bright_spot_does_not_set_the_exposure() -> None:
    reference = grey(0, (10, 10))
    reference[0, 0] = 1
    assert metrics.exposure_of(reference) == pytest.approx(1e4)


def test_tone_map_is_srgb_of_the_clamped_product() -> None:
    image = np.array([[[-1, 0.1, 50]]], np.float32)
    np.testing.assert_allclose(metrics.tone_map(image, 2.0), [[[0, 1.055 * 0.2 ** (1 / 2.4) - 0.055, 1]]], atol=1e-6)


def test_psnr_of_a_constant_offset() -> None:
    # The exposure turns a constant reference into white; the image is off by 0.1 after the transfer: 20 dB.
    assert metrics.psnr(grey(3 * linear(0.9)), grey(3)) == pytest.approx(20, abs=1e-4)


def test_psnr_is_independent_of_the_unit() -> None:
    reference = picture()
    scaled = metrics.psnr(reference * 8e5, reference * 1e6)
    assert metrics.psnr(reference * 0.8, reference) == pytest.approx(scaled, abs=1e-3)


def test_rel_mse_by_hand() -> None:
    reference, image = grey(1), grey(1)
    reference[:8], image[:8], image[8:] = 3, 4, 1.5
    epsilon = 0.01 * 2**2
    assert metrics.rel_mse(image, reference) == pytest.approx((1 / (9 + epsilon) + 0.25 / (1 + epsilon)) / 2)


def test_ssim_of_a_constant_pair() -> None:
    # Without structure only the luminance term is left: (2 a b + c1) / (a² + b² + c1), c1 = 0.01².
    expected = (2 * 0.5 + 1e-4) / (1 + 0.25 + 1e-4)
    assert metrics.ssim(grey(linear(0.5)), grey(1)) == pytest.approx(expected, abs=1e-5)


def test_equal_images() -> None:
    reference = picture()
    assert metrics.psnr(reference, reference) == math.inf
    assert metrics.ssim(reference, reference) == pytest.approx(1)
    assert metrics.rel_mse(reference, reference) == 0
    assert metrics.flip(reference, reference) == 0


def test_metrics_order_images_as_an_eye_does() -> None:
    reference = picture()
    noise = np.random.default_rng(1).normal(size=reference.shape).astype(np.float32)
    images = [np.maximum(reference + amount * noise, 0) for amount in (0.02, 0.1, 0.5)]
    for metric, sign in ((metrics.psnr, -1), (metrics.ssim, -1), (metrics.rel_mse, 1), (metrics.flip, 1)):
        values = [sign * metric(image, reference) for image in images]
        assert values == sorted(values)


def uneven_pair() -> tuple[F32, F32]:
    """An image with other colours, a dark block and a bright border, and its reference."""
    reference = picture()
    image = reference * np.array([1.3, 0.8, 1.0], np.float32)
    image[8:14, 5:20] *= 0.2
    image[:3] += 2
    return image, reference


def test_flip_is_that_of_three_exposures_two_stops_apart() -> None:
    image, reference = uneven_pair()
    assert metrics.flip(image, reference) == pytest.approx(0.504842, abs=2e-5)  # flip-evaluator 1.7
    assert metrics.flip(reference, image) == pytest.approx(0.505999, abs=2e-5)  # the reference's exposure counts


def test_ssim_is_that_of_scikit_image() -> None:
    image, reference = uneven_pair()
    a, b = (metrics.tone_map(x, metrics.exposure_of(reference)) for x in (image, reference))
    expected = structural_similarity(a, b, data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=1.5,
                                     use_sample_covariance=False)
    assert metrics.ssim(image, reference) == pytest.approx(float(expected), abs=1e-5)
    assert float(expected) == pytest.approx(0.396393, abs=1e-4)


def test_ssim_averages_a_mask_without_a_whole_window() -> None:
    image, reference = uneven_pair()
    mask = np.zeros(reference.shape[:2], bool)
    mask[:2, :2] = True
    assert metrics.ssim(image, reference, mask) < 0.98
    assert metrics.ssim(reference, reference, mask) == pytest.approx(1)


def test_flip_sees_a_difference_where_it_is() -> None:
    reference, image = grey(1, (48, 48)), grey(1, (48, 48))
    image[4:12, 4:12] = 0
    errors = metrics.flip_map(image, reference)
    assert errors.shape == (48, 48) and errors.dtype == np.float32
    assert errors[8, 8] > 0.5
    assert errors[30:, 30:].max() == 0
    assert metrics.flip(image, reference) == pytest.approx(float(errors.mean()))


def test_flip_is_finite_at_the_ends_of_the_range() -> None:
    bright, reference = grey(1), grey(1)
    bright[3, 3] = 3e38
    assert 0 < metrics.flip(bright, reference) < 1
    assert metrics.flip(grey(1e-38), grey(1e-38)) == 0


def test_a_black_reference_gives_finite_errors() -> None:
    black = grey(0)
    assert [metric(black, black) for metric in ALL] == [math.inf, pytest.approx(1), 0, 0]
    assert metrics.flip(grey(1), black) > 0.9
    assert metrics.psnr(grey(1), black) == pytest.approx(0, abs=1e-5)
    assert metrics.ssim(grey(1), black) < 1e-3
    assert metrics.temporal_error([black, black], [black, black]) == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("metric", ALL)
def test_a_single_non_finite_value_is_refused(metric, bad) -> None:
    invalid = picture()
    invalid[5, 6, 1] = bad
    with pytest.raises(MetricError, match="image: 1 texels are not finite"):
        metric(invalid, picture())
    with pytest.raises(MetricError, match="reference: 1 texels are not finite"):
        metric(picture(), invalid)


@pytest.mark.parametrize("metric", ALL)
def test_different_shapes_are_refused(metric) -> None:
    for image, reference in ((grey(1)[:-1], grey(1)), (grey(1)[..., :1], grey(1)[..., :1]), (grey(1)[:0], grey(1)[:0])):
        with pytest.raises(MetricError, match="expected \\(H, W, 3\\)"):
            metric(image, reference)


def test_ssim_refuses_less_than_its_window() -> None:
    with pytest.raises(MetricError, match="11x11"):
        metrics.ssim(grey(1, (10, 40)), grey(1, (10, 40)))


@pytest.mark.parametrize("metric", ALL)
def test_texels_outside_the_mask_do_not_count(metric) -> None:
    reference, image, other = picture(), picture() * 0.7, picture() * 0.7
    mask = np.zeros(reference.shape[:2], bool)
    mask[6:20, 4:28] = True
    other[~mask] = np.nan
    assert metric(image, reference, mask) == pytest.approx(metric(other, reference, mask))
    with pytest.raises(MetricError, match="mask"):
        metric(image, reference, np.zeros_like(mask))


def test_temporal_error_counts_flicker_and_no_bias() -> None:
    references = [grey(1), grey(1), grey(1)]
    assert metrics.temporal_error([grey(linear(0.5))] * 3, references) == 0
    flicker = [grey(linear(0.5)), grey(linear(0.7)), grey(linear(0.5))]
    assert metrics.temporal_error(flicker, references) == pytest.approx(0.2, abs=1e-6)
    assert metrics.temporal_error(flicker, flicker) == 0
    with pytest.raises(MetricError, match="two or more"):
        metrics.temporal_error(references[:1], references[:1])


def test_a_missing_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'afterglow\[evaluation\]'"):
        metrics.flip(picture(), picture())
