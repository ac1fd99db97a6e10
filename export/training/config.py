"""Configuration of a training run, from a TOML file; ``export/training/configs/`` has those of the bundled networks."""

from dataclasses import field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from app.errors import SettingsError
from export.toml_config import JsonTable, parse_table, read_toml, strict

HELD_OUT_SHARE = 0.1  # of the pairs, by default


@strict
class NetworkConfig:
    """``preset`` names an entry of ``export.models.PRESETS``; ``options`` are passed to its class."""

    preset: str
    options: dict[str, Any] = field(default_factory=dict)


@strict
class LossConfig:
    """``kind`` names an entry of ``export.training.losses.LOSSES``; ``options`` are passed to its class.

    ``discriminator_rate`` is Adam's learning rate for the loss's discriminator.
    """

    kind: str = "bcnn"
    options: dict[str, Any] = field(default_factory=dict)
    discriminator_rate: PositiveFloat = 1e-4


def held_out(count: int, share: float = HELD_OUT_SHARE) -> range:
    """Indices of the pairs, of ``count``, that are never trained on; at least one."""
    return range(count - max(1, round(share * count)), count)


@strict
class DataConfig:
    """Selection of training data.

    Attributes
    ----------
    dataset : Path
        Folder written by ``python -m export dataset make``.
    validation : float
        Share of the pairs that is never trained on. It is taken from the end, since neighbouring pairs share scenes.
    pairs : int or None
        Number of the remaining pairs to train on, from the beginning; by default all.
    max_saturation : float
        Pairs with a more saturated light are left out; saturation is 1 - smallest / largest component of its colour.
    texel_stride : int
        Use every n-th texel across and down, which costs n² times less, for comparisons of networks.
    """

    dataset: Path
    validation: float = Field(HELD_OUT_SHARE, gt=0, lt=1)
    pairs: PositiveInt | None = None
    max_saturation: float = Field(1.0, ge=0, le=1)
    texel_stride: PositiveInt = 1


@strict
class AugmentationConfig:
    """Random changes of each example.

    Attributes
    ----------
    exposure_stops : float
        Light is scaled by 2 to a power of at most this magnitude.
    size_stops : float
        Lengths are scaled by 2 to a power of at most this magnitude; light does not depend on the size of the scene.
    permute_colors, mirror : bool
        Permute red, green and blue; swap left and right.
    """

    exposure_stops: NonNegativeFloat = 1.0
    size_stops: NonNegativeFloat = 0.0
    permute_colors: bool = True
    mirror: bool = True


@strict
class ScheduleConfig:
    """Length of the training, and learning rates.

    Attributes
    ----------
    batch : int
        Examples per step, over all devices.
    learning_rate, final_learning_rate : float
        Of Adam, at the beginning and at the end; half a cosine in between.
    ema : float
        Decay of the moving average of the weights. The averaged weights are validated and exported.
    max_gradient_norm : float or None
        The gradient of all weights together is clipped to this norm.
    """

    epochs: PositiveInt
    batch: PositiveInt = 8
    learning_rate: PositiveFloat = 1e-4
    final_learning_rate: NonNegativeFloat = 1e-4
    ema: float = Field(0.999, ge=0, lt=1)
    max_gradient_norm: PositiveFloat | None = None


@strict
class DeviceConfig:
    """Arguments of Lightning Fabric."""

    accelerator: Literal["auto", "cpu", "cuda"] = "auto"
    devices: PositiveInt = 1
    precision: Literal["32-true", "bf16-mixed"] = "32-true"


@strict
class ReportConfig:
    """Steps between log lines and between checkpoints, and number of example images per epoch."""

    log_steps: PositiveInt = 50
    checkpoint_steps: PositiveInt = 500
    pictures: PositiveInt = 4


@strict
class Config(JsonTable):
    """A training run; valid by construction."""

    network: NetworkConfig
    data: DataConfig
    schedule: ScheduleConfig
    loss: LossConfig = LossConfig()
    augmentation: AugmentationConfig = AugmentationConfig()
    device: DeviceConfig = DeviceConfig()
    report: ReportConfig = ReportConfig()
    seed: int = Field(0, ge=0)


def read_config(path: Path, dataset: Path | None = None, variant: str | None = None) -> Config:
    """Read a configuration from a TOML file.

    Parameters
    ----------
    dataset : Path, optional
        Replaces ``data.dataset``.
    variant : str, optional
        Name of a table ``[variants.NAME]`` in the file, whose values override the others.

    Raises
    ------
    SettingsError
        When the file can't be read, has no such variant, lacks a key, or has an unknown key or an invalid value.
    """
    table = read_toml(path)
    variants = table.pop("variants", {})
    if not (isinstance(variants, dict) and all(isinstance(overrides, dict) for overrides in variants.values())):
        raise SettingsError("bad key 'variants'", path, "expected tables [variants.NAME]")
    if variant is not None:
        if variant not in variants:
            known = f"one of: {', '.join(variants)}" if variants else "none, since the file has no variants"
            raise SettingsError(f"no variant {variant!r}", path, f"expected {known}")
        table = _merge(table, variants[variant])
    if dataset is not None:
        table = _merge(table, {"data": {"dataset": dataset}})
    return config_from_table(table, path)


def config_from_table(table: dict[str, Any], where: object) -> Config:
    """The configuration in a parsed TOML or JSON table; ``where`` names its source in errors."""
    return parse_table(Config, table, where, "expected the keys of docs/training.md")


def _merge(table: dict[str, Any], overrides: dict[str, Any]) -> dict[str, Any]:
    """``table`` with ``overrides``, table by table."""
    merged = dict(table)
    for key, value in overrides.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = _merge(merged[key], value) if both else value
    return merged
