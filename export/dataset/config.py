"""The configuration of a dataset: a TOML file, see ``configs/default.toml``."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from export.dataset.scenes.sources import FILES, SOURCES
from export.toml_config import JsonTable, parse_table, read_toml, strict

DEFAULT = Path(__file__).with_name("configs") / "default.toml"

Count = Annotated[int, Field(strict=True, ge=1)]
EvenSize = Annotated[int, Field(strict=True, ge=32, multiple_of=2)]
Share = Annotated[float, Field(strict=True, gt=0, le=1)]


@strict
class Source:
    """What makes a part of the dataset.

    Attributes
    ----------
    name : str
        A key of ``sources.SOURCES``, or ``files``.
    weight : float
        Its part of the pairs, relative to the weights of the other sources.
    pairs_per_scene : int
    """

    name: str
    weight: Annotated[float, Field(strict=True, gt=0)]
    pairs_per_scene: Count

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if name not in (*SOURCES, FILES):
            raise ValueError(f"no source {name!r}; there are {', '.join((*SOURCES, FILES))}")
        return name


@strict
class Config(JsonTable):
    """A valid configuration.

    Attributes
    ----------
    size : tuple of int
        Width and height of the frames; targets have half of both.
    spp : int
        Paths through each texel of a target.
    max_bounces : int
        Of indirect light.
    denoise : bool
        Whether targets are denoised by Open Image Denoise.
    sources : tuple of Source
        In TOML a table by name.
    folder : Path
        Of ``files``.
    files : tuple of Path
        Scene files of the source ``files``.
    environment : bool
        Light the scenes by a random environment only. Targets are then its unbounced light.
    min_lit_share : float
        Minimum share of an image's surfaces on which the probe of a camera finds light.
    min_mean_luminance_share : float
        Minimum mean luminance of an image, relative to the mean over the scene's cameras.
    """

    size: tuple[EvenSize, EvenSize]
    spp: Count
    max_bounces: Count
    denoise: Annotated[bool, Field(strict=True)]
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]
    folder: Path = Path()
    files: tuple[Path, ...] = ()
    environment: Annotated[bool, Field(strict=True)] = False
    min_lit_share: Share = 0.6
    min_mean_luminance_share: Share = 0.02

    @field_validator("sources", mode="before")
    @classmethod
    def _name_sources(cls, table: object) -> object:
        if not isinstance(table, dict):
            return table
        return [{"name": name, **values} if isinstance(values, dict) else values for name, values in table.items()]

    @model_validator(mode="after")
    def _check_files(self) -> Self:
        if not self.files and any(source.name == FILES for source in self.sources):
            raise ValueError("the source 'files' needs scene files in the key 'files'")
        return self

    @property
    def scene_files(self) -> tuple[Path, ...]:
        return tuple(self.folder / file for file in self.files)


def read_config(path: Path | None) -> Config:
    """The configuration in a TOML file, or the default one.

    Raises
    ------
    SettingsError
        When the file can't be read, lacks a key, or has an unknown key or a bad value.
    """
    path = path or DEFAULT
    return config_from_table(read_toml(path), path)


def config_from_table(table: object, where: object) -> Config:
    """The configuration in a TOML or JSON table; ``where`` names its source in errors."""
    return parse_table(Config, table, where, f"expected the keys of {DEFAULT}")
