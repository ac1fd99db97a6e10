"""The surrounding-aware network: the thesis's counts of weights, where it looks, and what it knows of."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("lightning_fabric")

from typer.testing import CliRunner  # noqa: E402

from app.math3d import cube_rotations  # noqa: E402
from app.network.session import feed  # noqa: E402
from export.models import make_network  # noqa: E402
from export.models.panorama import merged, solid_angles  # noqa: E402
from export.models.surround import BRIGHTEST, Discriminator, from_tanh, places, smooth, to_tanh  # noqa: E402
from export.onnx.export import cases, write_network  # noqa: E402
from export.training.checkpoint import load  # noqa: E402
from export.training.config import from_table  # noqa: E402
from export.training.examples import Examples, draw_missing  # noqa: E402
from export.training.loop import CHECKPOINT, Run  # noqa: E402
from export.training.losses.surround import SurroundLoss  # noqa: E402
from tests.training.pairs import CornellPairs  # noqa: E402
from tests.training.test_training import config  # noqa: E402


def network(**options: object) -> torch.nn.Module:
    torch.manual_seed(0)
    return make_network("surround-16", options).eval()


def room() -> dict[str, torch.Tensor]:
    """Inputs like those of a room, on the largest grid that there are any for."""
    found = [tensors for label, tensors in cases(network().contract) if label == "room"]
    return {t: torch.from_numpy(x) for t, x in max(found, key=lambda tensors: tensors["screen"].size).items()}


def exposed(net: torch.nn.Module, around: torch.Tensor) -> tuple[torch.Tensor, float]:
    """The panorama as the renderer feeds it, and what its light was divided by."""
    tensors = {"around": around[0].numpy(), "screen": room()["screen"][0].numpy()}
    out = {t: np.empty_like(x) for t, x in tensors.items()}
    mean = feed(net.contract, tensors, out)
    return torch.from_numpy(out["around"])[None], mean


def test_weights_are_those_of_the_thesis() -> None:
    from export.__main__ import cli

    rows = json.loads(CliRunner().invoke(cli, ["models", "--json"]).stdout)
    weights = {row["preset"]: row["weights"] for row in rows}
    assert weights["surround-paper"] == 54_420_739 and weights["surround-discriminator"] == 2_778_817


def test_points_are_looked_up_where_the_panorama_shows_them() -> None:
    """Of every texel: through its middle in the row of level views, within its stretched texel above and below."""
    n = 16
    at = (2 * np.arange(n) + 1) / n - 1
    x, y = np.meshgrid(at, -at)
    views = [np.stack([x, y, -np.ones_like(x)], -1) @ rotation for rotation in cube_rotations()]
    towards = merged(np.stack([np.moveaxis(view, -1, 0) for view in views], axis=1))
    found = places(torch.tensor(7.0 * towards)[None])[0].numpy()
    right, down = np.meshgrid((2 * np.arange(4 * n) + 1) / (4 * n) - 1, (2 * np.arange(2 * n) + 1) / (2 * n) - 1)
    level = slice(n // 2, n // 2 + n)
    np.testing.assert_allclose(found[level, :, 0], right[level], atol=1e-6)
    np.testing.assert_allclose(found[level, :, 1], down[level], atol=1e-6)
    assert np.abs(found[..., 0] - right).max() <= 4 / (4 * n) and np.abs(found[..., 1] - down).max() <= 1 / (2 * n)


def test_light_on_tanhs_scale_comes_back() -> None:
    light = torch.tensor([0.0, 1e-3, 0.3, 1.0, 20.0, BRIGHTEST])
    assert to_tanh(light).min() == -1 and to_tanh(light).max() == pytest.approx(1.0)
    torch.testing.assert_close(from_tanh(to_tanh(light)), light, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("front_alone", [False, True])
@torch.no_grad()
def test_only_the_one_that_looks_around_sees_what_is_behind(front_alone: bool) -> None:
    net = network(front_alone=front_alone)
    around, screen = room().values()
    other = around.flip(-1)  # as much light from elsewhere
    other[:, :7] += 0.5
    front = slice(32, 96), slice(96, 160)
    other[..., *front] = around[..., *front]
    before = net(around, screen)
    changed = (before - net(other, screen)).abs().max() / before.max()
    assert changed < 1e-4 if front_alone else changed > 1e-2


@torch.no_grad()
def test_light_is_looked_up_on_surfaces_and_the_sky_is_black() -> None:
    net = network()
    inputs = room()
    inputs["screen"][..., :4, :] = 0.0
    found = net(**inputs)
    assert not found[..., :4, :].any() and found[..., 4:, :].min() >= 0 and found.max() > 0
    light = net.relative_map(inputs["around"])
    inputs["screen"][:] = torch.tensor([1e-5, -1e-5, -5.0]).reshape(1, 3, 1, 1)  # straight ahead
    middle = light[..., 64 - 1:64 + 1, 128 - 1:128 + 1].mean((2, 3))
    unit = net._unit(inputs["around"], inputs["screen"])[..., 0, 0]
    torch.testing.assert_close(net(**inputs)[..., 0, 0], middle * unit, rtol=1e-3, atol=0.0)


@torch.no_grad()
def test_loss_and_critic_see_lumination_as_the_panorama_has_it() -> None:
    net = network()
    inputs = room()
    inputs["screen"][:] = torch.tensor([0.01, 0.01, -5.0]).reshape(1, 3, 1, 1)
    at = 64 - 1, 128  # up and right of the middle
    inputs["around"][:, :3] = torch.tensor([0.5, 0.25, 1e-3]).reshape(1, 3, 1, 1)
    inputs["around"][:, 7:, *at] = torch.tensor([1.0, 0.5, 0.1])
    found = net.condition(**inputs)[0, :, 0, 0]
    unit = (inputs["around"][0, 7:].numpy() * solid_angles(128)).sum() / (4 * np.pi) / 3
    assert float(found[15]) == pytest.approx(unit, rel=1e-5)
    torch.testing.assert_close(found[12:15] * found[15], torch.tensor([2.0, 2.0, 5.0]))
    torch.testing.assert_close(found[:12], net.seen(inputs["around"])[0, :, *at])


@pytest.mark.parametrize("front_alone", [False, True])
@torch.no_grad()
def test_more_light_of_a_colour_gives_as_much_more_of_it(front_alone: bool) -> None:
    net = network(front_alone=front_alone)
    around, screen = room().values()
    before, other = net(around, screen), around.clone()
    for factors in ((0.01, 0.01, 0.01), (1.0, 0.5, 0.01)):
        factor = torch.tensor(factors).reshape(1, 3, 1, 1)
        other[:, 7:] = factor * around[:, 7:]
        torch.testing.assert_close(net(other, screen), factor * before, rtol=1e-3, atol=1e-5)
    other[:, 8] = 0.0
    assert not net(other, screen)[:, 1].any()


@torch.no_grad()
def test_light_of_a_place_counts_by_its_solid_angle() -> None:
    """As the renderer exposes it, down to 24 of 32768 texels, which are 1365 times as bright as its exposure."""
    net = network()
    around = room()["around"]
    for rows, columns in ((slice(60, 64), slice(3, 9)), (slice(10, 14), slice(40, 56))):
        around[:, 7:] = 0.0
        around[:, 7:, rows, columns] = 30.0
        lit, mean = exposed(net, around)
        share = solid_angles(128)[rows, columns].sum() / (4 * np.pi)
        assert float(net.condition(lit, room()["screen"])[0, 15].max()) * mean == pytest.approx(30.0 * share, rel=1e-4)
        assert float(net.seen(lit)[0, 7, rows, columns].min()) == pytest.approx(
            float(to_tanh(torch.tensor(1 / share))), rel=1e-3)


def test_chequers_are_smoothed_away_and_slopes_are_kept() -> None:
    rows, columns = torch.meshgrid(torch.arange(16.0), torch.arange(32.0), indexing="ij")
    for period in (2, 4):
        for x in (rows, columns):
            assert smooth(torch.cos(2 * torch.pi * x / period)[None, None])[..., 2:-2, 2:-2].abs().max() < 1e-5
    slope = (0.3 * rows - 0.1 * columns)[None, None]
    torch.testing.assert_close(smooth(slope)[..., 2:-2, 2:-2], slope[..., 2:-2, 2:-2])
    assert smooth(slope).shape == slope.shape


@torch.no_grad()
def test_of_more_texels_light_is_averaged() -> None:
    net = network()
    around, screen = room().values()
    finer = around.repeat_interleave(2, -1).repeat_interleave(2, -2)
    assert finer.shape[2] == net.export_contract().inputs["around"].size == 2 * net.contract.inputs["around"].size
    expected = net(around, screen)
    torch.testing.assert_close(net(finer, screen), expected)
    uneven = finer.clone()
    uneven[:, 7:, ::2, ::2] *= 4.0
    uneven[:, 7:, 1::2] = uneven[:, 7:, ::2, 1::2] = 0.0
    uneven[:, :7, ::2] = uneven[:, :7, 1::2, ::2] = 0.5  # of the rest one of four is looked at
    torch.testing.assert_close(net(uneven, screen), expected, rtol=1e-4, atol=1e-6)
    assert network(front_alone=True).export_contract() == network(front_alone=True).contract


def test_solid_angles_are_those_of_a_cubes_texels() -> None:
    """Against the closed form of a rectangle's solid angle: differences of atan(x y / sqrt(1 + x² + y²))."""
    n = 32
    edges = np.linspace(-1, 1, n + 1)
    whole = np.arctan(edges[:, None] * edges / np.sqrt(1 + edges[:, None]**2 + edges**2))
    texels = np.diff(np.diff(whole, axis=0), axis=1)
    found = solid_angles(2 * n)
    np.testing.assert_allclose(found[n // 2:n // 2 + n, n // 2:n // 2 + n], texels, rtol=1e-2)  # the left view
    for rows in (slice(None, n // 2), slice(-n // 2, None)):
        cap = found[rows].reshape(n // 2, n, 4).sum(-1)
        np.testing.assert_allclose(cap, texels[::2] + texels[1::2], rtol=0.1)  # of two rows one is picked


def test_discriminator_judges_patches() -> None:
    found = Discriminator()(torch.rand(1, 12, 128, 128), torch.rand(1, 3, 128, 128))
    assert found.shape == (1, 1, 14, 14)


def test_its_loss_compares_light_maps_and_its_critic_learns(tmp_path: Path) -> None:
    """Four epochs on a room, as a configuration says: L1 falls, and the discriminator takes part and is kept."""
    options = {"widths": [4, 8, 8, 8]}
    table = config(tmp_path, epochs=4, learning_rate=2e-3, ema=0.5).to_json() | {
        "network": {"preset": "surround-16"}, "loss": {"kind": "surround", "options": options}}
    pairs = CornellPairs(tmp_path, 10)
    made = Examples(pairs, network().contract, SurroundLoss.uses_previous)
    assert sum(draw_missing(pairs, network().contract, SurroundLoss.uses_previous, workers=1)) == 10
    assert "previous.screen" not in made.batch([0])
    run = Run(from_table(table, "test"), made, tmp_path / "run")
    before = run.validate()
    after = run.train()
    assert set(after) == {"l1", "adversarial", "loss"} and after["l1"] < 0.9 * before["l1"]
    assert load(tmp_path / "run" / CHECKPOINT).discriminator["model"]
    views = run._views(run.ema, run._batch([0]))
    assert views.condition is not None and views.condition.shape[1] == 16
    right = replace(views, output=views.target)
    assert SurroundLoss(adversarial=0.0)(right)["l1"] == 0
    known, unit = views.condition[:, 12:15], views.condition[:, 15:]
    expected = 100 * (to_tanh(views.output / unit + known) - to_tanh(views.target / unit + known))
    torch.testing.assert_close(SurroundLoss(adversarial=0.0)(views)["l1"], expected.abs().mean())


def test_it_is_the_same_in_onnx(tmp_path: Path) -> None:
    net = network()
    net.contract = net.export_contract()
    files = write_network(net, tmp_path, cases(net.contract), {"room": 1e-4, "random": 2e-2})
    assert files[0].stat().st_size < 9e6
