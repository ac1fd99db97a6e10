from __future__ import annotations

from typing import Any

import pytest

torch = pytest.importorskip("torch")

from export.models import count_weights, make_network  # noqa: E402
from export.models.attention import Attention  # noqa: E402
from export.models.gfa import Gfa  # noqa: E402

COLORS = 3


def wall(h: int, w: int) -> torch.Tensor:
    """The geometry of a wall that faces the camera."""
    x = torch.zeros(1, 7, h, w)
    x[:, 2], x[:, 5], x[:, 6] = 1.0, -10.0, 10.0
    x[:, 3] = torch.linspace(-10, 10, w)
    x[:, 4] = torch.linspace(5, -5, h)[:, None]
    return x


def lit(h: int, w: int, seed: int = 0) -> torch.Tensor:
    """Random light and colours."""
    return torch.rand(1, 6, h, w, generator=torch.Generator().manual_seed(seed))


def network(**options: Any) -> Gfa:
    torch.manual_seed(0)
    return Gfa("gfa-8", **options).eval()


@pytest.mark.parametrize(("name", "weights", "off"), [("gfa-paper", 14.42e6, 0.02), ("gfa-mini", 8.76e6, 0.03)])
def test_the_papers_presets_have_their_weights(name: str, weights: float, off: float) -> None:
    assert count_weights(make_network(name)) == pytest.approx(weights, rel=off)


@torch.no_grad()
def test_each_colour_is_shaded_separately_and_in_the_same_way() -> None:
    light = lit(24, 32)
    permuted, redder = light[:, [2, 0, 1, 5, 3, 4]], light.clone()
    redder[:, 0] *= 5
    before, after, other = (network()(wall(24, 32), x) for x in (light, permuted, redder))
    torch.testing.assert_close(after, before[:, [2, 0, 1]])
    assert torch.equal(other[:, 1:], before[:, 1:]) and not torch.allclose(other[:, 0], before[:, 0])


@torch.no_grad()
def test_joint_colours_mix_at_about_the_same_cost() -> None:
    joint, separate = network(per_color=False), network()
    light = lit(16, 32)
    green = light.clone()
    green[:, 1, :, :16] *= 2.0
    change = joint(wall(16, 32), green) - joint(wall(16, 32), light)
    assert change[:, 0].abs().max() > 1e-3 < change[:, 2].abs().max()
    cost, expected = (net.runs * count_weights(net.shading) for net in (joint, separate))
    assert cost == pytest.approx(expected, rel=0.1)


@torch.no_grad()
def test_layers_replace_attention() -> None:
    with_layers, without = network(heads=0, layers=2), network(heads=0)
    weights = 32 * 32 * 9 + 32
    assert count_weights(with_layers) == count_weights(without) + 2 * weights
    with_layers.load_state_dict(without.state_dict(), strict=False)
    assert not torch.allclose(with_layers(wall(16, 32), lit(16, 32)), without(wall(16, 32), lit(16, 32)))


@torch.no_grad()
@pytest.mark.parametrize(("heads", "reaches"), [(8, True), (0, False)])
def test_attention_transports_light_over_any_distance(heads: int, reaches: bool) -> None:
    """The receptive field of the convolutions is smaller than 160 texels."""
    light, moved = lit(16, 256), lit(16, 256)
    light[:, :3, :, :16] += 20.0
    moved[:, :3, :, 16:32] += 20.0  # of the same mean
    shades = network(heads=heads)
    change = (shades(wall(16, 256), moved) - shades(wall(16, 256), light))[..., -64:].abs().max()
    assert (change > 1e-5) == reaches


@torch.no_grad()
def test_the_sky_neither_emits_nor_receives() -> None:
    geometry, light, other = wall(32, 32), lit(32, 32), lit(32, 32)
    geometry[:, :, :16] = 0.0
    other[:, :, :16] = 3.0
    y = network()(geometry, light)
    assert torch.equal(y, network()(geometry, other))
    assert y[..., :16, :].max() == 0.0 and y[..., 16:, :].min() > 0.0
    assert torch.equal(network()(torch.zeros(1, 7, 16, 16), light[..., :16, :16]), torch.zeros(1, 3, 16, 16))


@torch.no_grad()
def test_attention_is_the_sum_of_its_formula() -> None:
    """Each texel receives Σ_j softmax_j(Q_i · K_j / √d) V_j from all surfaces, head by head."""
    torch.manual_seed(0)
    attention = Attention(12, 12, heads=3, max_keys=1024)
    geometry, x = torch.randn(1, 12, 4, 5), torch.randn(1, COLORS, 12, 4, 5)
    surface = torch.ones(1, 1, 4, 5)
    surface[..., 1:3] = 0
    output = attention(x, attention.weights(3 * geometry, surface), surface)
    mask = surface.flatten().bool()
    q, k = (layer.weight[:, :, 0, 0] @ (3 * geometry).flatten(2)[0] for layer in (attention.query, attention.key))
    for color in range(COLORS):
        v = attention.value.weight[:, :, 0, 0] @ x[0, color].flatten(1)
        for head in range(3):
            rows = slice(4 * head, 4 * head + 4)
            expected = (q[rows].T @ k[rows][:, mask] / 2).softmax(dim=1) @ v[rows][:, mask].T
            torch.testing.assert_close(output[0, color, rows].flatten(1).T, expected)


@torch.no_grad()
def test_pooled_keys_give_the_same_where_neighbours_are_alike() -> None:
    torch.manual_seed(0)
    whole = Attention(8, 8, heads=2, max_keys=1024)
    pooled = Attention(8, 8, heads=2, max_keys=12)
    pooled.load_state_dict(whole.state_dict())
    geometry = 3 * torch.randn(1, 8, 3, 4).repeat_interleave(2, 2).repeat_interleave(2, 3)
    x = torch.randn(1, COLORS, 8, 3, 4).repeat_interleave(2, 3).repeat_interleave(2, 4)
    surface = torch.ones(1, 1, 6, 8)
    surface[..., :2, 2:6] = 0
    weights = pooled.weights(geometry, surface)
    assert weights.shape == (1, 2, 48, 12)
    torch.testing.assert_close(pooled(x, weights, surface), whole(x, whole.weights(geometry, surface), surface))
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(1, 2, 48))


def test_the_number_of_keys_is_limited() -> None:
    for h, w in ((48, 64), (135, 240), (31, 33), (1, 5000)):
        surface = torch.ones(1, 1, h, w)
        assert Attention(4, 4, heads=1, max_keys=100)._pool(surface, surface).numel() <= 100 + h + w


def test_guidance_serves_any_light() -> None:
    shades, geometry = network(), wall(16, 24)
    with torch.no_grad():
        guidance = shades.guide(geometry)
        for seed in range(2):
            light = lit(16, 24, seed)
            torch.testing.assert_close(shades.shade(light, guidance), shades(geometry, light))


def test_large_logits_stay_finite() -> None:
    shades = network()
    torch.nn.init.constant_(shades.last.bias, 100.0)
    with torch.no_grad():
        y = shades(wall(16, 16), lit(16, 16))
        assert torch.isfinite(y).all() and y.max() < 65504
        assert torch.isfinite(shades.half()(wall(16, 16).half(), lit(16, 16).half())).all()
