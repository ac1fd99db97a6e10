"""The training loop. What is random depends on seed and step alone, so that a run can be resumed anywhere."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import torch
from lightning_fabric import Fabric, seed_everything
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from app.errors import SettingsError
from app.io.atomic_files import prepare_folders
from export.models import Network, make_network, weights_of
from export.models.network import Conditioned
from export.training import checkpoint
from export.training.augment import augment, coarser
from export.training.config import Config, ScheduleConfig, held_out
from export.training.discriminator import DiscriminatorTraining
from export.training.examples import Batch, Examples, tensors_of
from export.training.log import Log, mean_of, write_pictures
from export.training.losses import Loss, LossInputs, make_loss
from export.training.losses.loss_inputs import warp

CHECKPOINT = "checkpoint.pt"
Terms = dict[str, float]
Tell = Callable[[int, int, Terms], object]


class Run:
    """A training run in its folder; goes on from the checkpoint there, if there is one.

    Parameters
    ----------
    examples : Examples
        All drawn.
    folder : Path
        Gets ``checkpoint.pt``, ``log.jsonl``, ``curve.png`` and ``pictures/``.
    eligible : sequence of int or None
        Pairs that may be trained on, if not all; see ``export.training.eligible``. The held-out ones are never.

    Raises
    ------
    AfterglowError
        When the configuration does not fit the network, the examples or the checkpoint.
    """

    def __init__(self, config: Config, examples: Examples, folder: Path,
                 eligible: Sequence[int] | None = None) -> None:
        assert not examples.missing
        self.config, self.examples, self.folder = config, examples, folder
        self.held_out = list(held_out(len(examples), config.data.validation))
        others = range(self.held_out[0])
        candidates = [i for i in (others if eligible is None else eligible) if i in others]
        wanted = config.data.pairs or len(candidates)
        if wanted > len(candidates):
            raise SettingsError(f"{wanted} pairs to train on", config.data.dataset,
                                f"expected at most {len(candidates)} of {len(examples)}, {len(self.held_out)} are "
                                f"held out{_left_out(config)}")
        self.trained_on = candidates[:wanted]
        self.epoch_steps = wanted // config.schedule.batch
        if self.epoch_steps < 1:
            raise SettingsError(f"{wanted} pairs to train on", config.data.dataset,
                                f"expected at least a batch of {config.schedule.batch}{_left_out(config)}")
        self.steps = config.schedule.epochs * self.epoch_steps
        device = config.device
        self.fabric = Fabric(accelerator=device.accelerator, devices=device.devices, precision=device.precision)
        self.fabric.launch()
        seed_everything(config.seed, verbose=False)
        self._bare, self.loss = network_and_loss(config)  # a discriminator takes its weights from the seed, too
        self.contract = self._bare.contract
        _check_grid(examples, self.contract.multiple_of * config.data.every, config)
        optimizer = torch.optim.Adam(self._bare.parameters(), config.schedule.learning_rate)
        self.ema = AveragedModel(self._bare, avg_fn=_average(config.schedule.ema)).eval()
        self.progress = checkpoint.Progress()
        prepare_folders(folder, folder / "pictures")
        saved = self._checkpoint()
        if saved is not None:
            self._bare.load_state_dict(saved.model)
            self.ema.load_state_dict(saved.ema)
            self.progress = saved.progress
        self.log = Log(folder, self.progress.step)
        self.network, self.optimizer = self.fabric.setup(self._bare, optimizer)
        if saved is not None:  # now that the weights are where the optimizer's numbers are to be
            self.optimizer.load_state_dict(saved.optimizer)
        self.ema.to(self.fabric.device)
        self.discriminator = None
        if self.loss.discriminator is not None:
            self.discriminator = DiscriminatorTraining(self.loss.discriminator, config.loss.discriminator_rate, self.fabric,
                                         saved.discriminator if saved is not None else {})

    def train(self, tell: Tell = lambda step, steps, terms: None) -> Terms:
        """Train to the end; ``tell`` is told the steps taken, of how many, and the newest losses.

        Returns
        -------
        dict of str to float
            The loss on the held-out pairs, by term and ``loss``.
        """
        began = time.perf_counter() - self.progress.seconds
        recent: list[Terms] = []
        saved = self.progress.step
        while (step := self.progress.step) < self.steps:
            recent.append(self._step(step))
            self.progress.step, self.progress.seconds = step + 1, time.perf_counter() - began
            ends_epoch = (step + 1) % self.epoch_steps == 0
            if not (ends_epoch or (step + 1) % self.config.report.log_steps == 0):
                continue
            self._write_log(**mean_of(recent))
            tell(step + 1, self.steps, recent[-1])
            recent.clear()
            if ends_epoch:
                self._end_epoch((step + 1) // self.epoch_steps)
            if ends_epoch or step + 1 - saved >= self.config.report.checkpoint_steps:
                self._save()
                saved = step + 1
        return self.progress.validation

    def validate(self) -> Terms:
        """The averaged network's loss on the held-out pairs; a discriminator learns nothing by it."""
        if self.discriminator is not None:
            self.discriminator.train(False)
        size = self.config.schedule.batch
        parts = [self.held_out[at:at + size] for at in range(0, len(self.held_out), size)]
        with torch.no_grad():
            found = [summed(self.loss(self._views(self.ema, self._batch(part)))) for part in parts]
        if self.discriminator is not None:
            self.discriminator.train(True)
        return {name: sum(len(part) * float(terms[name]) for part, terms in zip(parts, found, strict=True))
                / len(self.held_out) for name in found[0]}

    def _step(self, step: int) -> Terms:
        schedule = self.config.schedule
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(schedule, step / self.steps)
        epoch, at = divmod(step, self.epoch_steps)
        order = torch.randperm(len(self.trained_on), generator=_random(self.config.seed, epoch)).tolist()
        order = [self.trained_on[i] for i in order]
        mine = order[at * schedule.batch:(at + 1) * schedule.batch][self.fabric.global_rank::self.fabric.world_size]
        stream = self.steps + step * self.fabric.world_size + self.fabric.global_rank
        batch = augment(self._batch(mine), self.contract, self.config.augmentation,
                        _random(self.config.seed, stream))
        torch.manual_seed((self.config.seed << 32) + stream)  # dropout's
        views = self._views(self.network, batch)
        terms = summed(self.loss(views))
        self.fabric.backward(terms["loss"])
        if schedule.largest_gradient is not None:
            self.fabric.clip_gradients(self.network, self.optimizer, max_norm=schedule.largest_gradient)
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        self.ema.update_parameters(self._bare)
        found = {name: float(term.detach()) for name, term in terms.items()}
        return found if self.discriminator is None else {**found, "discriminator": self.discriminator.learn(views)}

    def _views(self, network: Any, batch: Batch) -> LossInputs:
        warped = None
        if self.loss.uses_previous:
            # The previous output is what the current one is pulled to, not the other way round: no gradient.
            with torch.no_grad():
                previous = network(**tensors_of(batch, "previous")) * batch["ratio"]
                warped = warp(previous.float(), batch["motion"])
        output = network(**tensors_of(batch, "current"))
        condition = None
        if self.loss.uses_condition:
            with torch.no_grad():
                condition = cast(Conditioned, self._bare).condition(**tensors_of(batch, "current"))
        return LossInputs(output, batch["target"], warped, batch["seen"], batch.get("visible"), condition,
                     batch.get("reflectance"))

    def _batch(self, indices: list[int]) -> Batch:
        batch = coarser(self.examples.batch(indices), self.contract, self.config.data.every)
        return {name: x.to(self.fabric.device) for name, x in batch.items()}

    def _end_epoch(self, epoch: int) -> None:
        self.progress.validation = self.validate()
        self._write_log(epoch=epoch, validation=self.progress.validation)
        if self.fabric.is_global_zero:
            self.log.plot(self.folder / "curve.png")
            batch = self._batch(self.held_out[:self.config.report.pictures])
            with torch.no_grad():
                output = self.ema(**tensors_of(batch, "current"))
            write_pictures(self.folder / "pictures" / f"{epoch:04d}.png", batch, output, self.contract)

    def _write_log(self, **values: Any) -> None:
        if self.fabric.is_global_zero:
            self.log.write(step=self.progress.step, seconds=round(self.progress.seconds, 1), **values)

    def _save(self) -> None:
        if self.fabric.is_global_zero:
            facts = {"pairs": len(self.examples), "trained_on": len(self.trained_on), "weights": weights_of(self._bare),
                     "machine": checkpoint.machine(self.fabric.device)}
            discriminator = {} if self.discriminator is None else self.discriminator.state
            checkpoint.save(self.folder / CHECKPOINT, self.config, self.progress, self._bare, self.ema, self.optimizer,
                       discriminator, facts)
        self.fabric.barrier()

    def _checkpoint(self) -> checkpoint.Checkpoint | None:
        """What an earlier run left in the folder."""
        path = self.folder / CHECKPOINT
        if not path.exists():
            return None
        saved = checkpoint.load(path)
        if saved.config != self.config:
            raise SettingsError("another configuration than that of the checkpoint", path,
                                "expected the same; take another folder, or delete the checkpoint")
        return saved


def network_and_loss(config: Config) -> tuple[Network, Loss]:
    """Both fresh.

    Raises
    ------
    AfterglowError
        When there are no such, or they don't fit each other.
    """
    network = make_network(config.network.preset, config.network.options)
    loss = make_loss(config.loss.kind, config.loss.options)
    if loss.uses_condition and not hasattr(network, "condition"):
        raise SettingsError(f"the loss {config.loss.kind!r} for the network {config.network.preset!r}", "loss.kind",
                            "expected one that does not look at the network's condition")
    return network, loss


def _left_out(config: Config) -> str:
    limit = config.data.most_saturated
    return f", and data.most_saturated = {limit:g} leaves some out" if limit < 1 else ""


def _check_grid(examples: Examples, multiple: int, config: Config) -> None:
    height, width = examples.batch([0])["target"].shape[-2:]
    if height % multiple or width % multiple:
        raise SettingsError(f"data.every = {config.data.every} on a grid of {width}x{height}", config.data.dataset,
                            f"expected multiples of {multiple}")


def summed(terms: dict[str, Tensor]) -> dict[str, Tensor]:
    """``terms`` with their sum as ``loss``."""
    return {**terms, "loss": torch.stack(list(terms.values())).sum()}


def learning_rate(schedule: ScheduleConfig, done: float) -> float:
    """Half a cosine from the first to the final rate, when the share ``done`` of all steps is taken."""
    fall = 0.5 * (1 + math.cos(math.pi * done))
    return schedule.final_learning_rate + fall * (schedule.learning_rate - schedule.final_learning_rate)


def _random(seed: int, stream: int) -> torch.Generator:
    return torch.Generator().manual_seed((seed << 32) + stream)


def _average(decay: float) -> Callable[[Tensor, Tensor, Tensor | int], Tensor]:
    """Moving average whose memory grows to ``decay``, so that the first weights are soon forgotten."""
    def average(mean: Tensor, new: Tensor, count: Tensor | int) -> Tensor:
        return torch.lerp(mean, new, 1 - min(decay, (1 + int(count)) / (10 + int(count))))
    return average
