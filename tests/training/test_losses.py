from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")
metrics = pytest.importorskip("skimage.metrics")
ndimage = pytest.importorskip("scipy.ndimage")

from app.errors import SettingsError  # noqa: E402
from export.training.losses import LossInputs, make_loss  # noqa: E402
from export.training.losses.bcnn import BcnnLoss, laplacian, ssim_map  # noqa: E402
from export.training.losses.loss_inputs import tone_map, warp  # noqa: E402

H, W = 40, 48


def images(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a = ndimage.gaussian_filter(rng.random((H, W, 3)), (2, 2, 0))
    a = (a - a.min()) / np.ptp(a)
    return a, np.clip(a + 0.1 * rng.standard_normal(a.shape), 0, 1)


def tensor(image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]


def loss_inputs(output: torch.Tensor, target: torch.Tensor, warped: torch.Tensor | None = None) -> LossInputs:
    ones = torch.ones(1, 1, H, W)
    return LossInputs(output, target, target if warped is None else warped, ones, ones)


def test_ssim_is_scikit_images() -> None:
    a, b = images()
    expected = metrics.structural_similarity(a, b, data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=1.5,
                                             truncate=5 / 1.5, use_sample_covariance=False, full=True)[1]
    result = ssim_map(tensor(a), tensor(b))[0].numpy().transpose(1, 2, 0)
    # Implementations differ at the borders.
    np.testing.assert_allclose(result[5:-5, 5:-5], expected[5:-5, 5:-5], atol=1e-10)


def test_laplacian_is_scipys() -> None:
    a, _ = images()
    result = laplacian(tensor(a))[0].numpy().transpose(1, 2, 0)
    expected = np.stack([ndimage.laplace(a[..., i], mode="nearest") for i in range(3)], axis=-1)
    np.testing.assert_allclose(result, expected, atol=1e-12)


def test_the_bcnn_loss_is_its_weighted_terms() -> None:
    a, b = (tensor(x).float() for x in images())
    warped = a.roll(1, dims=3)
    terms = BcnnLoss()(loss_inputs(a, b, warped))
    assert terms["ssim"].item() == pytest.approx(0.7 * (1 - ssim_map(tone_map(a), tone_map(b)).mean().item()), rel=1e-5)
    edges = (laplacian(tone_map(a)) - laplacian(tone_map(b))).abs().mean().item()
    assert terms["laplacian"].item() == pytest.approx(0.1 * edges, rel=1e-5)
    change = (tone_map(a) - tone_map(warped)).abs().mean().item()
    assert terms["temporal"].item() == pytest.approx(0.2 * change, rel=1e-5)
    assert set(terms) == {"ssim", "laplacian", "temporal"}


def test_equal_pictures_have_no_loss() -> None:
    a, _ = (tensor(x).float() for x in images())
    assert sum(BcnnLoss()(loss_inputs(a, a)).values()).item() == pytest.approx(0.0, abs=1e-6)


def test_sky_and_disoccluded_texels_do_not_count() -> None:
    a, _ = (tensor(x).float() for x in images())
    surface_mask, history_mask = torch.ones(1, 1, H, W), torch.ones(1, 1, H, W)
    surface_mask[..., :10, :] = 0.0
    history_mask[..., 10:20, :] = 0.0
    wrong, flickers = a.clone(), a.clone()
    wrong[..., :10, :] += 3.0
    flickers[..., :20, :] += 3.0
    terms = BcnnLoss(l1=1.0)(LossInputs(wrong, a, flickers, surface_mask, history_mask))
    assert max(term.item() for term in terms.values()) < 1e-6


def test_bright_light_keeps_the_loss_finite() -> None:
    dark, bright = torch.zeros(1, 3, H, W, requires_grad=True), torch.full((1, 3, H, W), 65504.0)
    total = sum(BcnnLoss(l1=1.0)(loss_inputs(dark, bright, bright)).values())
    total.backward()
    assert torch.isfinite(total) and torch.isfinite(dark.grad).all()


def test_warping_follows_motion() -> None:
    image = torch.rand(1, 3, H, W)
    motion = torch.zeros(1, 2, H, W)
    motion[:, 0], motion[:, 1] = 3.0, -2.0  # surfaces went 3 right and 2 up
    moved = image.roll((-2, 3), dims=(2, 3))
    torch.testing.assert_close(warp(image, motion)[..., :-2, 3:], moved[..., :-2, 3:], rtol=0, atol=1e-4)


def test_an_unknown_weight_is_one_line() -> None:
    with pytest.raises(SettingsError, match="ssimm"):
        make_loss("bcnn", {"ssimm": 1.0})
