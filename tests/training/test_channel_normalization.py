from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from app.network.inputs import MAX_RATIO_TO_MEAN  # noqa: E402
from export.models.channel_normalization import denormalize_channels, normalize_channels  # noqa: E402

H, W = 96, 128


def light_and_surface() -> tuple[torch.Tensor, torch.Tensor]:
    """Light around 1 on the left half, sky on the right."""
    light = 0.5 + torch.rand(1, 3, H, W, generator=torch.Generator().manual_seed(0))
    surface = torch.zeros(1, 1, H, W)
    surface[..., : W // 2] = 1.0
    return light, surface


def test_means_are_over_surfaces() -> None:
    light, surface = light_and_surface()
    normalized, means = normalize_channels(light, surface)
    torch.testing.assert_close(means[0, :, 0, 0], light[0, :, :, : W // 2].mean((1, 2)))
    torch.testing.assert_close(normalized[..., : W // 2].mean((2, 3)), torch.ones(1, 3))
    torch.testing.assert_close(denormalize_channels(normalized, means), light)


@pytest.mark.parametrize("value", [300.0, 65504.0])
def test_one_bright_texel_hardly_changes_the_rest(value: float) -> None:
    light, surface = light_and_surface()
    reference, _ = normalize_channels(light, surface)
    light[..., 0, 0] = value
    normalized, _ = normalize_channels(light, surface)
    assert normalized.max() == MAX_RATIO_TO_MEAN
    change = (normalized / reference)[..., 1:, : W // 2]
    assert change.min() > 0.9 and change.max() < 1.0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16])
def test_black_channels_and_sky_give_zero(dtype: torch.dtype) -> None:
    light, surface = (x.to(dtype) for x in light_and_surface())
    light[:, 1] = 0.0
    normalized, means = normalize_channels(light, surface)
    assert normalized.dtype == dtype and not normalized[:, 1].any()
    assert not denormalize_channels(normalized, means)[:, 1].any()
    normalized, means = normalize_channels(light, torch.zeros_like(surface))
    assert torch.isfinite(normalized).all() and not denormalize_channels(normalized, means).any()
