"""The surrounding-aware network: weight counts, panorama lookups, units of light and its loss."""

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
from app.network.inputs import prepare_inputs  # noqa: E402
from export.models import make_network  # noqa: E402
from export.models.panorama import merge_cube, project_to_panorama, solid_angles  # noqa: E402
from export.models.pix2pix import ConditionalPatchGan  # noqa: E402
from export.models.surround import MAX_RADIANCE, from_tanh, smooth, to_tanh  # noqa: E402
from export.onnx.export import write_network  # noqa: E402
from export.onnx.sample_inputs import sample_inputs  # noqa: E402
from export.training.checkpoint import load_checkpoint  # noqa: E402
from export.training.config import config_from_table  # noqa: E402
from export.training.examples import Examples, render_missing  # noqa: E402
from export.training.loop import CHECKPOINT, Run  # noqa: E402
from export.training.losses.surround import SurroundLoss  # noqa: E402
from tests.training.pairs import CornellPairs  # noqa: E402
from tests.training.test_training import config  # noqa: E402


def network(**options: object) -> torch.nn.Module:
    torch.manual_seed(0)
    return make_network("surround-16", options).eval()


def room() -> dict[str, torch.Tensor]:
    """Inputs of the synthetic room on the largest grid."""
    rooms = [tensors for label, tensors in sample_inputs(network().contract) if label == "room"]
    return {t: torch.from_numpy(x) for t, x in max(rooms, key=lambda tensors: tensors["screen"].size).items()}


def exposed(net: torch.nn.Module, around: torch.Tensor) -> tuple[torch.Tensor, float]:
    """The panorama as the renderer feeds it, and its exposure."""
    tensors = {"around": around[0].numpy(), "screen": room()["screen"][0].numpy()}
    out = {t: np.empty_like(x) for t, x in tensors.items()}
    mean = prepare_inputs(net.contract, tensors, out)
    return torch.from_numpy(out["around"])[None], mean


def test_weights_are_those_of_the_thesis() -> None:
    from export.__main__ import cli

    rows = json.loads(CliRunner().invoke(cli, ["onnx", "list", "--json"]).stdout)
    weights = {row["preset"]: row["weights"] for row in rows}
    assert weights["surround-paper"] == 54_420_739 and weights["surround-discriminator"] == 2_778_817


def test_points_are_projected_to_their_texels() -> None:
    """For every texel: to its centre in the level views, and within its stretched texel in the caps."""
    n = 16
    at = (2 * np.arange(n) + 1) / n - 1
    x, y = np.meshgrid(at, -at)
    views = [np.stack([x, y, -np.ones_like(x)], -1) @ rotation for rotation in cube_rotations()]
    direction = merge_cube(np.stack([np.moveaxis(view, -1, 0) for view in views], axis=1))
    projected = project_to_panorama(torch.tensor(7.0 * direction)[None])[0].numpy()
    right, down = np.meshgrid((2 * np.arange(4 * n) + 1) / (4 * n) - 1, (2 * np.arange(2 * n) + 1) / (2 * n) - 1)
    level = slice(n // 2, n // 2 + n)
    np.testing.assert_allclose(projected[level, :, 0], right[level], atol=1e-6)
    np.testing.assert_allclose(projected[level, :, 1], down[level], atol=1e-6)
    assert np.abs(projected[..., 0] - right).max() <= 4 / (4 * n)
    assert np.abs(projected[..., 1] - down).max() <= 1 / (2 * n)


def test_the_scale_of_tanh_is_invertible() -> None:
    light = torch.tensor([0.0, 1e-3, 0.3, 1.0, 20.0, MAX_RADIANCE])
    assert to_tanh(light).min() == -1 and to_tanh(light).max() == pytest.approx(1.0)
    torch.testing.assert_close(from_tanh(to_tanh(light)), light, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("front_only", [False, True])
@torch.no_grad()
def test_only_the_whole_panorama_shows_light_behind_the_camera(front_only: bool) -> None:
    net = network(front_only=front_only)
    around, screen = room().values()
    other = around.flip(-1)  # the same amount of light from other directions
    other[:, :7] += 0.5
    front = slice(32, 96), slice(96, 160)
    other[..., *front] = around[..., *front]
    before = net(around, screen)
    changed = (before - net(other, screen)).abs().max() / before.max()
    assert changed < 1e-4 if front_only else changed > 1e-2


@torch.no_grad()
def test_surfaces_look_up_light_and_the_sky_is_black() -> None:
    net = network()
    inputs = room()
    inputs["screen"][..., :4, :] = 0.0
    output = net(**inputs)
    assert not output[..., :4, :].any() and output[..., 4:, :].min() >= 0 and output.max() > 0
    light = net.relative_map(inputs["around"])
    inputs["screen"][:] = torch.tensor([1e-5, -1e-5, -5.0]).reshape(1, 3, 1, 1)  # straight ahead
    middle = light[..., 64 - 1:64 + 1, 128 - 1:128 + 1].mean((2, 3))
    unit = net._unit(inputs["around"], inputs["screen"])[..., 0, 0]
    torch.testing.assert_close(net(**inputs)[..., 0, 0], middle * unit, rtol=1e-3, atol=0.0)


@torch.no_grad()
def test_the_condition_holds_the_known_light_of_the_panorama() -> None:
    net = network()
    inputs = room()
    inputs["screen"][:] = torch.tensor([0.01, 0.01, -5.0]).reshape(1, 3, 1, 1)
    at = 64 - 1, 128  # up and right of the centre
    inputs["around"][:, :3] = torch.tensor([0.5, 0.25, 1e-3]).reshape(1, 3, 1, 1)
    inputs["around"][:, 7:, *at] = torch.tensor([1.0, 0.5, 0.1])
    condition = net.condition(**inputs)[0, :, 0, 0]
    unit = (inputs["around"][0, 7:].numpy() * solid_angles(128)).sum() / (4 * np.pi) / 3
    assert float(condition[15]) == pytest.approx(unit, rel=1e-5)
    torch.testing.assert_close(condition[12:15] * condition[15], torch.tensor([2.0, 2.0, 5.0]))
    torch.testing.assert_close(condition[:12], net.features(inputs["around"])[0, :, *at])


@pytest.mark.parametrize("front_only", [False, True])
@torch.no_grad()
def test_each_colour_scales_with_its_light(front_only: bool) -> None:
    net = network(front_only=front_only)
    around, screen = room().values()
    before, other = net(around, screen), around.clone()
    for factors in ((0.01, 0.01, 0.01), (1.0, 0.5, 0.01)):
        factor = torch.tensor(factors).reshape(1, 3, 1, 1)
        other[:, 7:] = factor * around[:, 7:]
        torch.testing.assert_close(net(other, screen), factor * before, rtol=1e-3, atol=1e-5)
    other[:, 8] = 0.0
    assert not net(other, screen)[:, 1].any()


@torch.no_grad()
def test_light_is_weighted_by_solid_angle() -> None:
    """With the renderer's exposure, down to 24 of 32768 texels, which are 1365 times as bright as the mean."""
    net = network()
    around = room()["around"]
    for rows, columns in ((slice(60, 64), slice(3, 9)), (slice(10, 14), slice(40, 56))):
        around[:, 7:] = 0.0
        around[:, 7:, rows, columns] = 30.0
        lit, mean = exposed(net, around)
        share = solid_angles(128)[rows, columns].sum() / (4 * np.pi)
        assert float(net.condition(lit, room()["screen"])[0, 15].max()) * mean == pytest.approx(30.0 * share, rel=1e-4)
        assert float(net.features(lit)[0, 7, rows, columns].min()) == pytest.approx(
            float(to_tanh(torch.tensor(1 / share))), rel=1e-3)


def test_smoothing_removes_checkerboards_and_keeps_slopes() -> None:
    rows, columns = torch.meshgrid(torch.arange(16.0), torch.arange(32.0), indexing="ij")
    for period in (2, 4):
        for x in (rows, columns):
            assert smooth(torch.cos(2 * torch.pi * x / period)[None, None])[..., 2:-2, 2:-2].abs().max() < 1e-5
    slope = (0.3 * rows - 0.1 * columns)[None, None]
    torch.testing.assert_close(smooth(slope)[..., 2:-2, 2:-2], slope[..., 2:-2, 2:-2])
    assert smooth(slope).shape == slope.shape


@torch.no_grad()
def test_light_of_a_finer_panorama_is_averaged() -> None:
    net = network()
    around, screen = room().values()
    finer = around.repeat_interleave(2, -1).repeat_interleave(2, -2)
    assert finer.shape[2] == net.export_contract().inputs["around"].size == 2 * net.contract.inputs["around"].size
    expected = net(around, screen)
    torch.testing.assert_close(net(finer, screen), expected)
    uneven = finer.clone()
    uneven[:, 7:, ::2, ::2] *= 4.0
    uneven[:, 7:, 1::2] = uneven[:, 7:, ::2, 1::2] = 0.0
    uneven[:, :7, ::2] = uneven[:, :7, 1::2, ::2] = 0.5  # the other channels are subsampled
    torch.testing.assert_close(net(uneven, screen), expected, rtol=1e-4, atol=1e-6)
    assert network(front_only=True).export_contract() == network(front_only=True).contract


def test_solid_angles_match_the_closed_form() -> None:
    """Against the closed form of a rectangle's solid angle: differences of atan(x y / sqrt(1 + x² + y²))."""
    n = 32
    edges = np.linspace(-1, 1, n + 1)
    whole = np.arctan(edges[:, None] * edges / np.sqrt(1 + edges[:, None]**2 + edges**2))
    texels = np.diff(np.diff(whole, axis=0), axis=1)
    panorama = solid_angles(2 * n)
    np.testing.assert_allclose(panorama[n // 2:n // 2 + n, n // 2:n // 2 + n], texels, rtol=1e-2)  # the left view
    for rows in (slice(None, n // 2), slice(-n // 2, None)):
        cap = panorama[rows].reshape(n // 2, n, 4).sum(-1)
        np.testing.assert_allclose(cap, texels[::2] + texels[1::2], rtol=0.1)  # the caps sample one of two rows


def test_the_discriminator_scores_patches() -> None:
    logits = ConditionalPatchGan()(torch.rand(1, 12, 128, 128), torch.rand(1, 3, 128, 128))
    assert logits.shape == (1, 1, 14, 14)


def test_its_loss_compares_light_maps_and_trains_the_discriminator(tmp_path: Path) -> None:
    """Four epochs on one room: L1 decreases, and the checkpoint holds the discriminator."""
    options = {"widths": [4, 8, 8, 8]}
    table = config(tmp_path, epochs=4, learning_rate=2e-3, ema=0.5).to_json() | {
        "network": {"preset": "surround-16"}, "loss": {"kind": "surround", "options": options}}
    pairs = CornellPairs(tmp_path, 10)
    data = Examples(pairs, network().contract, SurroundLoss.uses_previous)
    assert sum(render_missing(pairs, network().contract, SurroundLoss.uses_previous, workers=1)) == 10
    assert "previous.screen" not in data.batch([0])
    run = Run(config_from_table(table, "test"), data, tmp_path / "run")
    before = run.validate()
    after = run.train()
    assert set(after) == {"l1", "adversarial", "loss"} and after["l1"] < 0.9 * before["l1"]
    assert load_checkpoint(tmp_path / "run" / CHECKPOINT).discriminator["model"]
    inputs = run._loss_inputs(run.ema, run._batch([0]))
    assert inputs.condition is not None and inputs.condition.shape[1] == 16
    right = replace(inputs, output=inputs.target)
    assert SurroundLoss(adversarial=0.0)(right)["l1"] == 0
    known, unit = inputs.condition[:, 12:15], inputs.condition[:, 15:]
    expected = 100 * (to_tanh(inputs.output / unit + known) - to_tanh(inputs.target / unit + known))
    torch.testing.assert_close(SurroundLoss(adversarial=0.0)(inputs)["l1"], expected.abs().mean())


def test_the_exported_file_agrees_with_torch(tmp_path: Path) -> None:
    net = network()
    net.contract = net.export_contract()
    files = write_network(net, tmp_path, sample_inputs(net.contract), {"room": 1e-4, "random": 2e-2})
    assert files[0].stat().st_size < 9e6
