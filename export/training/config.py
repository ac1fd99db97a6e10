"""What a training run does, from a TOML file; ``export/training/configs/`` has those of the shipped networks."""

from __future__ import annotations

import tomllib
from dataclasses import field
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, NonNegativeFloat, PositiveFloat, PositiveInt, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from app.errors import SettingsError

strict = dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))

HELD_OUT = 0.1  # share of the pairs, where a configuration has no other


@strict
class NetworkConfig:
    """``preset`` names an entry of ``export.models.PRESETS``; ``options`` go to its class."""

    preset: str
    options: dict[str, Any] = field(default_factory=dict)


@strict
class LossConfig:
    """``kind`` names an entry of ``export.training.losses.LOSSES``; ``options`` go to its class.

    ``discriminator_rate``: Adam's learning rate of a loss's discriminator.
    """

    kind: str = "bcnn"
    options: dict[str, Any] = field(default_factory=dict)
    discriminator_rate: PositiveFloat = 1e-4


def held_out(count: int, share: float = HELD_OUT) -> range:
    """Those of ``count`` pairs, one at least, that are never trained on."""
    return range(count - max(1, round(share * count)), count)


@strict
class DataConfig:
    """Where examples come from.

    Attributes
    ----------
    dataset : Path
        Folder of ``python -m export dataset``.
    validation : float
        Share of the pairs, from the end, that is never trained on. Neighbouring pairs share scenes, so it is one piece.
    pairs : int or None
        Train on so many of the others, from the beginning; on all without.
    most_saturated : float
        Leave out pairs with a light of more saturation than this (1 - smallest / largest of its colours).
    every : int
        Take every so-many-th texel across and down: the square of it cheaper, for comparisons of networks.
    """

    dataset: Path
    validation: float = Field(HELD_OUT, gt=0, lt=1)
    pairs: PositiveInt | None = None
    most_saturated: float = Field(1.0, ge=0, le=1)
    every: PositiveInt = 1


@strict
class AugmentationConfig:
    """Random changes of each example.

    Attributes
    ----------
    exposure_stops : float
        Light is multiplied by up to 2 to this power, or divided.
    size_stops : float
        Lengths are multiplied by up to 2 to this power, or divided: light is the same in a scene of another size.
    permute_colors, mirror : bool
        Swap red, green and blue; left and right.
    """

    exposure_stops: NonNegativeFloat = 1.0
    size_stops: NonNegativeFloat = 0.0
    permute_colors: bool = True
    mirror: bool = True


@strict
class ScheduleConfig:
    """How long and how fast.

    Attributes
    ----------
    batch : int
        Examples in a step, on all devices together.
    learning_rate, final_learning_rate : float
        Adam's, at the beginning and, after half a cosine, at the end.
    ema : float
        Decay of the moving average of the weights, which is what is validated and exported.
    largest_gradient : float or None
        Norm that the gradient of all weights is scaled down to where it is longer.
    """

    epochs: PositiveInt
    batch: PositiveInt = 8
    learning_rate: PositiveFloat = 1e-4
    final_learning_rate: NonNegativeFloat = 1e-4
    ema: float = Field(0.999, ge=0, lt=1)
    largest_gradient: PositiveFloat | None = None


@strict
class DeviceConfig:
    """What Lightning Fabric calls them; ``precision`` is ``32-true`` or ``bf16-mixed``."""

    accelerator: Literal["auto", "cpu", "cuda"] = "auto"
    devices: PositiveInt = 1
    precision: Literal["32-true", "bf16-mixed"] = "32-true"


@strict
class ReportConfig:
    """How often, in steps, means are logged and checkpoints written; pictures of how many examples each epoch."""

    log_steps: PositiveInt = 50
    checkpoint_steps: PositiveInt = 500
    pictures: PositiveInt = 4


@strict
class Config:
    """A whole training run; valid by construction."""

    network: NetworkConfig
    data: DataConfig
    schedule: ScheduleConfig
    loss: LossConfig = LossConfig()
    augmentation: AugmentationConfig = AugmentationConfig()
    device: DeviceConfig = DeviceConfig()
    report: ReportConfig = ReportConfig()
    seed: int = Field(0, ge=0)

    def to_json(self) -> dict[str, Any]:
        """As JSON holds it; ``from_table`` takes it back."""
        made: dict[str, Any] = TypeAdapter(Config).dump_python(self, mode="json")
        return made


def read_config(path: Path, dataset: Path | None = None) -> Config:
    """The configuration in a TOML file, with another ``dataset`` if one is given.

    Raises
    ------
    SettingsError
        When the file can't be read, lacks a key, or has an unknown one or a bad value.
    """
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"can't read the configuration ({error})", path, "expected a TOML file") from None
    if dataset is not None:
        table.setdefault("data", {})["dataset"] = dataset
    return from_table(table, path)


def from_table(table: dict[str, Any], where: object) -> Config:
    """The configuration of a table as TOML gives it."""
    try:
        return TypeAdapter(Config).validate_python(table)
    except ValidationError as errors:
        first = errors.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SettingsError(f"bad key {key!r} ({first['msg'].lower()})", where,
                            "expected the keys of docs/training.md") from None
