"""The training loop. All randomness depends on seed and step only, so a run can be resumed at any step."""

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import torch
from lightning_fabric import Fabric, seed_everything
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from app.errors import SettingsError
from app.io.atomic_files import prepare_folders
from export.models import Network, count_weights, make_network
from export.models.network import Conditioned
from export.training.augment import augment, subsample
from export.training.checkpoint import Checkpoint, Progress, load_checkpoint, machine_name, save_checkpoint
from export.training.config import Config, ScheduleConfig, held_out
from export.training.discriminator import DiscriminatorTraining
from export.training.examples import Batch, Examples, frame_inputs
from export.training.log import Log, mean_terms, write_pictures
from export.training.losses import Loss, LossInputs, make_loss
from export.training.losses.loss_inputs import warp

CHECKPOINT = "checkpoint.pt"
Terms = dict[str, float]
OnProgress = Callable[[int, int, Terms], object]  # completed steps, all steps, latest terms


class Run:
    """A training run in a folder, which continues from the checkpoint there, if any.

    Parameters
    ----------
    examples : Examples
        Complete: none may be missing.
    folder : Path
        Where ``checkpoint.pt``, ``log.jsonl``, ``curve.png`` and ``pictures/`` are written.
    candidates : sequence of int or None
        Pairs that may be trained on, by default all; held-out pairs are always excluded.

    Raises
    ------
    AfterglowError
        When the configuration does not fit the network, the examples or the checkpoint.
    """

    def __init__(self, config: Config, examples: Examples, folder: Path,
                 candidates: Sequence[int] | None = None) -> None:
        assert not examples.missing
        self.config, self.examples, self.folder = config, examples, folder
        self.held_out = list(held_out(len(examples), config.data.validation))
        self.trained_on = _training_pairs(config, len(examples), self.held_out, candidates)
        self.epoch_steps = len(self.trained_on) // config.schedule.batch
        self.steps = config.schedule.epochs * self.epoch_steps
        device = config.device
        self.fabric = Fabric(accelerator=device.accelerator, devices=device.devices, precision=device.precision)
        self.fabric.launch()
        seed_everything(config.seed, verbose=False)
        self._module, self.loss = network_and_loss(config)  # after seeding, for the discriminator's weights
        self.contract = self._module.contract
        _check_grid(examples, self.contract.multiple_of * config.data.texel_stride, config)
        optimizer = torch.optim.Adam(self._module.parameters(), config.schedule.learning_rate)
        self.ema = AveragedModel(self._module, avg_fn=partial(_average, config.schedule.ema)).eval()
        self.progress = Progress()
        prepare_folders(folder, folder / "pictures")
        saved = self._load_checkpoint()
        if saved:
            self._module.load_state_dict(saved.model)
            self.ema.load_state_dict(saved.ema)
            self.progress = saved.progress
        self.log = Log(folder, self.progress.step)
        self.network, self.optimizer = self.fabric.setup(self._module, optimizer)
        if saved:  # after setup has moved the weights to the device
            self.optimizer.load_state_dict(saved.optimizer)
        self.ema.to(self.fabric.device)
        self.discriminator = None if self.loss.discriminator is None else DiscriminatorTraining(
            self.loss.discriminator, config.loss.discriminator_rate, self.fabric, saved.discriminator if saved else {})

    def train(self, on_progress: OnProgress = lambda step, steps, terms: None) -> Terms:
        """Train to the end; returns the loss on the held-out pairs, its terms and their sum ``loss``."""
        start = time.perf_counter() - self.progress.seconds
        recent: list[Terms] = []
        saved = self.progress.step
        while (step := self.progress.step) < self.steps:
            recent.append(self._step(step))
            self.progress.step, self.progress.seconds = step + 1, time.perf_counter() - start
            ends_epoch = (step + 1) % self.epoch_steps == 0
            if not (ends_epoch or (step + 1) % self.config.report.log_steps == 0):
                continue
            self._write_log(**mean_terms(recent))
            on_progress(step + 1, self.steps, recent[-1])
            recent.clear()
            if ends_epoch:
                self._end_epoch((step + 1) // self.epoch_steps)
            if ends_epoch or step + 1 - saved >= self.config.report.checkpoint_steps:
                self._save()
                saved = step + 1
        return self.progress.validation

    def validate(self) -> Terms:
        """Loss of the averaged network on the held-out pairs."""
        if self.loss.discriminator is not None:
            self.loss.discriminator.eval()  # so that a forward pass leaves its state unchanged
        size = self.config.schedule.batch
        parts = [self.held_out[at:at + size] for at in range(0, len(self.held_out), size)]
        with torch.no_grad():
            terms = [add_sum(self.loss(self._loss_inputs(self.ema, self._batch(part)))) for part in parts]
        if self.loss.discriminator is not None:
            self.loss.discriminator.train()
        return {name: sum(len(part) * float(t[name]) for part, t in zip(parts, terms, strict=True))
                / len(self.held_out) for name in terms[0]}

    def _step(self, step: int) -> Terms:
        schedule = self.config.schedule
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(schedule, step / self.steps)
        epoch, at = divmod(step, self.epoch_steps)
        order = torch.randperm(len(self.trained_on), generator=_generator(self.config.seed, epoch)).tolist()
        chosen = [self.trained_on[i] for i in order[at * schedule.batch:(at + 1) * schedule.batch]]
        local = chosen[self.fabric.global_rank::self.fabric.world_size]
        stream = self.steps + step * self.fabric.world_size + self.fabric.global_rank
        batch = augment(self._batch(local), self.contract, self.config.augmentation,
                        _generator(self.config.seed, stream))
        torch.manual_seed((self.config.seed << 32) + stream)  # for dropout
        inputs = self._loss_inputs(self.network, batch)
        terms = add_sum(self.loss(inputs))
        self.fabric.backward(terms["loss"])
        if schedule.max_gradient_norm is not None:
            self.fabric.clip_gradients(self.network, self.optimizer, max_norm=schedule.max_gradient_norm)
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        self.ema.update_parameters(self._module)
        values = {name: float(term.detach()) for name, term in terms.items()}
        return values if self.discriminator is None else {**values, "discriminator": self.discriminator.step(inputs)}

    def _loss_inputs(self, network: Any, batch: Batch) -> LossInputs:
        warped = condition = None
        if self.loss.uses_previous:
            # The previous output is a target for the current one, so it needs no gradient.
            with torch.no_grad():
                previous = network(**frame_inputs(batch, "previous")) * batch["exposure_ratio"]
                warped = warp(previous.float(), batch["motion"])
        output = network(**frame_inputs(batch, "current"))
        if self.loss.uses_condition:
            with torch.no_grad():
                condition = cast(Conditioned, self._module).condition(**frame_inputs(batch, "current"))
        return LossInputs(output, batch["target"], warped, batch["surface_mask"], batch.get("history_mask"), condition,
                          batch.get("reflectance"))

    def _batch(self, indices: list[int]) -> Batch:
        batch = subsample(self.examples.batch(indices), self.contract, self.config.data.texel_stride)
        return {name: x.to(self.fabric.device) for name, x in batch.items()}

    def _end_epoch(self, epoch: int) -> None:
        self.progress.validation = self.validate()
        self._write_log(epoch=epoch, validation=self.progress.validation)
        if self.fabric.is_global_zero:
            self.log.plot(self.folder / "curve.png")
            batch = self._batch(self.held_out[:self.config.report.pictures])
            with torch.no_grad():
                output = self.ema(**frame_inputs(batch, "current"))
            write_pictures(self.folder / "pictures" / f"{epoch:04d}.png", batch, output, self.contract)

    def _write_log(self, **values: Any) -> None:
        if self.fabric.is_global_zero:
            self.log.write(step=self.progress.step, seconds=round(self.progress.seconds, 1), **values)

    def _save(self) -> None:
        if self.fabric.is_global_zero:
            facts = {"pairs": len(self.examples), "trained_on": len(self.trained_on),
                     "weights": count_weights(self._module), "machine": machine_name(self.fabric.device)}
            discriminator = {} if self.discriminator is None else self.discriminator.state
            save_checkpoint(self.folder / CHECKPOINT, self.config, self.progress, self._module, self.ema,
                            self.optimizer, discriminator, facts)
        self.fabric.barrier()

    def _load_checkpoint(self) -> Checkpoint | None:
        """The checkpoint of an earlier run in the folder, if any."""
        path = self.folder / CHECKPOINT
        if not path.exists():
            return None
        saved = load_checkpoint(path)
        if saved.config != self.config:
            raise SettingsError("the configuration differs from the checkpoint's", path,
                                "expected the same; choose another folder, or delete the checkpoint")
        return saved


def network_and_loss(config: Config) -> tuple[Network, Loss]:
    """A newly initialised network and its loss.

    Raises
    ------
    AfterglowError
        When one of them is unknown, or they do not fit together.
    """
    network = make_network(config.network.preset, config.network.options)
    loss = make_loss(config.loss.kind, config.loss.options)
    if loss.uses_condition and not hasattr(network, "condition"):
        raise SettingsError(f"the loss {config.loss.kind!r} does not fit the network {config.network.preset!r}",
                            "loss.kind", "expected a loss that does not read the network's condition")
    return network, loss


def _training_pairs(config: Config, count: int, held_out: Sequence[int], candidates: Sequence[int] | None) -> list[int]:
    """The first ``data.pairs`` candidates that are not held out, of ``count`` pairs in all."""
    allowed = [i for i in (range(count) if candidates is None else candidates) if i < held_out[0]]
    chosen = config.data.pairs or len(allowed)
    limit = config.data.max_saturation
    note = f", and data.max_saturation = {limit:g} excludes some" if limit < 1 else ""
    if chosen > len(allowed):
        raise SettingsError(f"data.pairs = {chosen} is too many", config.data.dataset,
                            f"expected at most {len(allowed)} of {count}; {len(held_out)} are held out{note}")
    if chosen < config.schedule.batch:
        raise SettingsError(f"only {chosen} pairs to train on", config.data.dataset,
                            f"expected at least one batch of {config.schedule.batch}{note}")
    return allowed[:chosen]


def _check_grid(examples: Examples, multiple: int, config: Config) -> None:
    height, width = examples.batch([0])["target"].shape[-2:]
    if height % multiple or width % multiple:
        raise SettingsError(f"a grid of {width}x{height} does not fit data.texel_stride = {config.data.texel_stride}",
                            config.data.dataset, f"expected multiples of {multiple}")


def add_sum(terms: dict[str, Tensor]) -> dict[str, Tensor]:
    """``terms`` and their sum ``loss``."""
    return {**terms, "loss": torch.stack(list(terms.values())).sum()}


def learning_rate(schedule: ScheduleConfig, done: float) -> float:
    """Half a cosine from the first to the final rate; ``done`` is the share of completed steps."""
    fall = 0.5 * (1 + math.cos(math.pi * done))
    return schedule.final_learning_rate + fall * (schedule.learning_rate - schedule.final_learning_rate)


def _generator(seed: int, stream: int) -> torch.Generator:
    return torch.Generator().manual_seed((seed << 32) + stream)


def _average(decay: float, mean: Tensor, new: Tensor, count: Tensor | int) -> Tensor:
    """Moving average whose decay grows to ``decay``, so that the initial weights have little influence."""
    return torch.lerp(mean, new, 1 - min(decay, (1 + int(count)) / (10 + int(count))))
