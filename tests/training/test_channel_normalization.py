from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from app.network.session import FIREFLY  # noqa: E402
from export.models.channel_normalization import in_own_means, times_means  # noqa: E402

H, W = 96, 128


def light_and_surface() -> tuple[torch.Tensor, torch.Tensor]:
    """Light around 1 on the left half, sky on the right."""
    light = 0.5 + torch.rand(1, 3, H, W, generator=torch.Generator().manual_seed(0))
    surface = torch.zeros(1, 1, H, W)
    surface[..., : W // 2] = 1.0
    return light, surface


def test_means_are_over_surfaces() -> None:
    light, surface = light_and_surface()
    relative, means = in_own_means(light, surface)
    torch.testing.assert_close(means[0, :, 0, 0], light[0, :, :, : W // 2].mean((1, 2)))
    torch.testing.assert_close(relative[..., : W // 2].mean((2, 3)), torch.ones(1, 3))
    torch.testing.assert_close(times_means(relative, means), light)


@pytest.mark.parametrize("value", [300.0, 65504.0])
def test_one_bright_texel_hardly_changes_the_rest(value: float) -> None:
    light, surface = light_and_surface()
    calm, _ = in_own_means(light, surface)
    light[..., 0, 0] = value
    relative, _ = in_own_means(light, surface)
    assert relative.max() == FIREFLY
    change = (relative / calm)[..., 1:, : W // 2]
    assert change.min() > 0.9 and change.max() < 1.0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16])
def test_darkness_and_sky_give_nothing(dtype: torch.dtype) -> None:
    light, surface = (x.to(dtype) for x in light_and_surface())
    light[:, 1] = 0.0
    relative, means = in_own_means(light, surface)
    assert relative.dtype == dtype and not relative[:, 1].any() and not times_means(relative, means)[:, 1].any()
    relative, means = in_own_means(light, torch.zeros_like(surface))
    assert torch.isfinite(relative).all() and not times_means(relative, means).any()
