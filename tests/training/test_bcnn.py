from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from app.errors import ModelError  # noqa: E402
from export.models import bcnn, count_weights, make_network  # noqa: E402
from export.models.bcnn import Bcnn, Bilateral, bilateral_taps  # noqa: E402

GRID = (24, 32)
LIGHT, NORMAL, DEPTH = slice(0, 3), slice(3, 6), 8


def wall(depth: torch.Tensor, seed: int = 0) -> torch.Tensor:
    """Random light on surfaces that face the camera at ``depth`` [h, w]."""
    x = torch.zeros(1, 9, *depth.shape)
    x[:, LIGHT] = torch.rand(1, 3, *depth.shape, generator=torch.Generator().manual_seed(seed))
    x[:, 5], x[:, DEPTH] = 1.0, -depth
    return x


def test_the_papers_preset_has_its_weights() -> None:
    assert count_weights(make_network("bcnn-paper")) == pytest.approx(3.95e6, rel=0.02)


def test_lighter_presets_are_lighter() -> None:
    weights = [count_weights(make_network(name)) for name in bcnn.PRESETS]
    assert weights == sorted(weights, reverse=True)


@pytest.mark.parametrize("widths", [(4, 4), (12, 4)], ids=["gathers", "scatters"])
def test_at_equal_depth_a_bilateral_convolution_is_a_plain_one(widths: tuple[int, int]) -> None:
    layer, x = Bilateral(*widths), torch.randn(2, widths[0], *GRID)
    one = torch.ones(2, 1, *GRID)
    plain = torch.nn.functional.conv2d(x, layer.weight, layer.bias, padding=1)
    torch.testing.assert_close(layer(x, bilateral_taps(17.0 * one, one)), plain, rtol=0, atol=1e-5)


@pytest.mark.parametrize("widths", [(4, 4), (12, 4)], ids=["gathers", "scatters"])
def test_taps_are_weighted_by_depth(widths: tuple[int, int]) -> None:
    layer, x = Bilateral(*widths), torch.randn(1, widths[0], *GRID)
    depth = 3 * torch.rand(1, 1, *GRID)
    output = layer(x, bilateral_taps(depth, torch.ones_like(depth)))[0, :, 10, 20]
    expected = layer.bias.clone()
    for row in range(3):
        for column in range(3):
            at = 9 + row, 19 + column
            factor = torch.exp(-(depth[0, 0, 10, 20] - depth[0, 0, at[0], at[1]]) ** 2)
            expected = expected + factor * layer.weight[:, :, row, column] @ x[0, :, at[0], at[1]]
    torch.testing.assert_close(output, expected)


def change_beyond_step() -> tuple[torch.Tensor, torch.Tensor]:
    """A wall with a depth step of 10 σ on the grid of every level; light beyond it is mirrored."""
    depth = torch.full(GRID, 10.0)
    depth[:, 16:] = 20.0
    x = wall(depth)
    x[:, LIGHT] *= torch.linspace(0.2, 5.0, GRID[1])
    changed = x.clone()
    changed[:, LIGHT, :, 16:] = x[:, LIGHT, :, 16:].flip(-1)
    return x, changed


def test_only_the_mean_crosses_a_step_of_ten_sigma() -> None:
    x, changed = change_beyond_step()
    network = Bcnn("bcnn-8").eval()
    with torch.no_grad():
        before, after = network(x), network(changed)
    torch.testing.assert_close(before[..., :16], after[..., :16], rtol=1e-5, atol=1e-6)
    assert not torch.allclose(before[..., 16:], after[..., 16:])


def test_without_bilateral_taps_light_crosses_the_step() -> None:
    x, changed = change_beyond_step()
    network = Bcnn("bcnn-8", bilateral=False).eval()
    with torch.no_grad():
        assert not torch.allclose(network(x)[..., :16], network(changed)[..., :16])


def test_each_colour_scales_with_its_light() -> None:
    x, network = wall(torch.full(GRID, 10.0)), Bcnn("bcnn-8").eval()
    factors = torch.tensor([100.0, 0.1, 10.0]).reshape(3, 1, 1)
    colored, without_red = x.clone(), x.clone()
    colored[:, LIGHT] *= factors
    without_red[:, 0] = 0.0
    with torch.no_grad():
        torch.testing.assert_close(network(colored), network(x) * factors, rtol=1e-4, atol=0.0)
        assert [bool(colour.any()) for colour in network(without_red)[0]] == [False, True, True]


def test_ablations_ignore_inputs() -> None:
    x = wall(torch.full(GRID, 10.0))
    other = x.clone()
    other[:, 3:5], other[:, 6:8] = 0.5, 3.0
    whole, light = Bcnn("bcnn-8").eval(), Bcnn("bcnn-8", reads=["direct"]).eval()
    with torch.no_grad():
        assert torch.equal(light(x), light(other)) and not torch.equal(whole(x), whole(other))
    with pytest.raises(ModelError, match="depht"):
        make_network("bcnn-8", {"reads": ["depht"]})


def test_the_sky_is_black_and_its_channels_are_ignored() -> None:
    x = wall(torch.full(GRID, 10.0))
    x[..., :8, :] = 0.0
    other = x.clone()
    other[:, LIGHT, :8] = 30.0
    network = Bcnn("bcnn-8").eval()
    with torch.no_grad():
        output = network(x)
        assert torch.equal(output, network(other))
    assert output[..., :8, :].max() == 0.0 and output[..., 8:, :].min() > 0.0


def test_pooling_averages_over_surfaces_only() -> None:
    """Next to the sky, features are means over surfaces, not over surfaces and sky."""
    network = Bcnn("bcnn-8").eval()
    for name, parameter in network.named_parameters():
        if name.endswith("bias"):
            torch.nn.init.constant_(parameter, 0.3)
    whole, ragged = wall(torch.full(GRID, 10.0)), wall(torch.full(GRID, 10.0))
    whole[:, LIGHT], ragged[:, LIGHT] = 1.0, 1.0
    ragged[..., ::2, ::2] = 0.0
    outputs: list[torch.Tensor] = []
    network.bottom.register_forward_hook(lambda module, inputs, output: outputs.append(inputs[1]))
    with torch.no_grad():
        network(whole), network(ragged)
    assert torch.equal(outputs[0], outputs[1])  # every texel of the coarsest level has surfaces at the same depth
