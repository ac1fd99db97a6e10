"""GFA's loss: its discriminator, and VGG features from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("lightning_fabric")

from lightning_fabric import Fabric  # noqa: E402

from app.errors import SettingsError  # noqa: E402
from export.models import make_network  # noqa: E402
from export.training.checkpoint import load_checkpoint  # noqa: E402
from export.training.config import Config, config_from_table  # noqa: E402
from export.training.discriminator import DiscriminatorTraining  # noqa: E402
from export.training.loop import CHECKPOINT, Run  # noqa: E402
from export.training.losses import LossInputs, make_loss  # noqa: E402
from export.training.losses.bcnn import ssim_map  # noqa: E402
from export.training.losses.gfa import PatchDiscriminator  # noqa: E402
from export.training.losses.loss_inputs import tone_map  # noqa: E402
from export.training.losses.perceptual import MEAN, Perceptual  # noqa: E402
from tests.training.test_training import config, examples, losses  # noqa: E402

GFA = make_network("gfa-8").contract


def loss_inputs(output: torch.Tensor, target: torch.Tensor) -> LossInputs:
    ones = torch.ones(len(output), 1, *output.shape[2:])
    return LossInputs(output, target, None, ones, ones)


def rough_and_smooth(seed: int) -> LossInputs:
    random = torch.Generator().manual_seed(seed)
    rough, coarse = torch.rand(4, 3, 48, 48, generator=random), torch.rand(4, 3, 6, 6, generator=random)
    return loss_inputs(rough, torch.nn.functional.interpolate(coarse, scale_factor=8, mode="bilinear"))


def test_a_discriminator_step_leaves_the_network_unchanged() -> None:
    torch.manual_seed(0)
    training = DiscriminatorTraining(discriminator := PatchDiscriminator(8), 1e-3, Fabric(accelerator="cpu"), {})
    first = training.step(rough_and_smooth(0))
    for seed in range(1, 40):
        shown = rough_and_smooth(seed)
        shown.output.requires_grad_(True)
        last = training.step(shown)
        assert shown.output.grad is None
    assert last < 0.5 * first
    with torch.no_grad():
        shown = rough_and_smooth(99)
        assert discriminator(tone_map(shown.target)).mean() > discriminator(tone_map(shown.output)).mean() + 0.3


def test_the_adversarial_loss_reaches_the_network_only() -> None:
    training = DiscriminatorTraining(discriminator := PatchDiscriminator(8), 1e-3, Fabric(accelerator="cpu"), {})
    shown = rough_and_smooth(0)
    shown.output.requires_grad_(True)
    discriminator.generator_loss(shown).backward()
    assert shown.output.grad is not None and shown.output.grad.abs().sum() > 0
    assert all(p.grad is None for p in discriminator.parameters())
    assert training.state["model"].keys() == discriminator.state_dict().keys()


def test_a_patch_is_34_texels() -> None:
    discriminator, x = PatchDiscriminator(8).eval(), torch.rand(1, 3, 96, 96)
    x.requires_grad_(True)
    discriminator(x)[0, 0, 10, 10].backward()
    assert x.grad is not None
    rows = x.grad[0, 0].abs().sum(dim=1).nonzero()
    assert rows.max() - rows.min() + 1 == 34
    assert x.grad[0, 1:].abs().max() == 0  # one colour at a time


@pytest.fixture
def features(tmp_path: Path) -> tuple[Path, torch.nn.Module]:
    """A small network in VGG's form: two convolutions, pooling, one more."""
    torch.manual_seed(0)
    layers = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3, padding=1), torch.nn.ReLU(),
                                 torch.nn.Conv2d(4, 4, 3, padding=1), torch.nn.ReLU(), torch.nn.MaxPool2d(2),
                                 torch.nn.Conv2d(4, 8, 3, padding=1), torch.nn.ReLU(), torch.nn.MaxPool2d(2))
    path = tmp_path / "vgg.pth"
    torch.save({f"features.{k}": x for k, x in layers.state_dict().items()} | {"classifier.0.weight": torch.ones(1)},
               path)
    return path, layers


@torch.no_grad()
def test_features_are_those_of_the_network_in_the_file(features: tuple[Path, torch.nn.Module]) -> None:
    path, layers = features
    mean, deviation = (torch.tensor(x).reshape(1, 3, 1, 1) for x in (MEAN, (0.229, 0.224, 0.225)))
    a, b = torch.rand(2, 3, 16, 16), torch.rand(2, 3, 16, 16)
    x, y = (a - mean) / deviation, (b - mean) / deviation
    levels = [(layers[:4](x) - layers[:4](y)).abs().mean(), (layers[:7](x) - layers[:7](y)).abs().mean()]
    torch.testing.assert_close(Perceptual(path)(a, b), sum(levels) / 2)
    assert Perceptual(path)(a, a) == 0


@torch.no_grad()
def test_gfas_loss_is_its_weighted_terms(features: tuple[Path, torch.nn.Module]) -> None:
    shown = rough_and_smooth(0)
    loss = make_loss("gfa", {"features": str(features[0])})
    terms = loss(shown)
    assert set(terms) == {"smooth_l1", "perceptual", "adversarial"}
    a, b = tone_map(shown.output), tone_map(shown.target)
    torch.testing.assert_close(terms["smooth_l1"], 0.7 * torch.nn.functional.smooth_l1_loss(a, b, beta=0.1))
    torch.testing.assert_close(terms["perceptual"], 0.28 * Perceptual(features[0])(a, b))
    assert set(make_loss("gfa", {})(shown)) == {"smooth_l1", "adversarial"}
    plain = make_loss("gfa", {"adversarial": 0.0})
    assert plain.discriminator is None and set(plain(shown)) == {"smooth_l1"}
    structure = make_loss("gfa", {"adversarial": 0.0, "ssim": 0.5})(shown)["ssim"]
    torch.testing.assert_close(structure, 0.5 * (1 - ssim_map(a, b).mean()))


@pytest.mark.parametrize("content", [
    b"nothing", {"classifier.0.weight": torch.ones(1)}, {"features.0.weight": torch.ones(8, 3, 3, 3)},
    {"features.0.weight": torch.ones(8, 3, 3, 3), "features.0.bias": torch.ones(8),  # with batch norm
     "features.1.weight": torch.ones(8), "features.1.bias": torch.ones(8)},
], ids=["not a torch file", "no features", "no bias", "batch norm"])
def test_a_file_without_features_is_one_line(tmp_path: Path, content: bytes | dict[str, torch.Tensor]) -> None:
    path = tmp_path / "vgg.pth"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    with pytest.raises(SettingsError, match=r"vgg\.pth") as error:
        make_loss("gfa", {"features": str(path)})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("options", [{"smooth_l1": 0.0}, {"adversarial": -1.0}, {"smooth_l1": "much"},
                                     {"ssim": float("nan")}])
def test_bad_weights_are_one_line(options: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match="bad options"):
        make_loss("gfa", options)


def adversarial(folder: Path) -> Config:
    """GFA's smallest network, with dropout, against a discriminator."""
    table = config(folder).to_json() | {"network": {"preset": "gfa-8"}, "loss": {"kind": "gfa"}}
    return config_from_table(table, "test")


def test_validation_changes_nothing(tmp_path: Path) -> None:
    """It is repeatable despite dropout, and leaves the discriminator unchanged."""
    run = Run(adversarial(tmp_path), examples(tmp_path, contract=GFA), tmp_path / "run")
    assert run.discriminator is not None
    before = {key: value.clone() for key, value in run.discriminator.state["model"].items()}
    assert run.validate() == run.validate()
    assert all(torch.equal(value, before[key]) for key, value in run.discriminator.state["model"].items())


def test_an_interrupted_run_resumes_with_its_discriminator(tmp_path: Path) -> None:
    data = examples(tmp_path, contract=GFA)
    Run(adversarial(tmp_path), data, tmp_path / "whole").train()

    def stop(step: int, steps: int, terms: object) -> None:
        if step == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Run(adversarial(tmp_path), data, tmp_path / "interrupted").train(stop)
    Run(adversarial(tmp_path), data, tmp_path / "interrupted").train()
    assert losses(tmp_path / "interrupted") == losses(tmp_path / "whole")
    whole, interrupted = (load_checkpoint(tmp_path / name / CHECKPOINT) for name in ("whole", "interrupted"))
    for key, value in whole.discriminator["model"].items():
        assert torch.equal(value, interrupted.discriminator["model"][key])
    lines = (tmp_path / "whole" / "log.jsonl").read_text()
    assert '"discriminator"' in lines and '"adversarial"' in lines
