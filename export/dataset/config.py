"""What a dataset is made of, from a TOML file; ``default.toml`` beside this file explains the keys."""

from __future__ import annotations

import tomllib
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

from app.errors import SettingsError
from export.dataset.scenes.sources import FILES, SOURCES

DEFAULT = Path(__file__).with_name("configs") / "default.toml"
WHERE = "dataset configuration"


@dataclass(frozen=True)
class Share:
    """How much of the dataset a source makes.

    Attributes
    ----------
    source : str
        A name of ``sources.SOURCES``, or ``files``.
    share : float
        Relative to the other sources'.
    pairs : int
        Made of one scene.
    """

    source: str
    share: float
    pairs: int


@dataclass(frozen=True)
class Config:
    """Valid by construction.

    Attributes
    ----------
    size : tuple of int
        Width and height of the frames, even numbers.
    paths : int
        Through each texel of a target.
    max_bounces : int
        Of indirect light.
    denoised : bool
        Whether Open Image Denoise takes the targets' noise out.
    sources : tuple of Share
    files : tuple of str
        Scene files of the source ``files``.
    environment : bool
        Whether a random environment is all that lights the scenes; targets are then what comes straight from it.
    least_lit : float
        Share of a picture's surfaces that a few paths have to find lit.
    darkest : float
        Least mean luminance of a picture, as a share of what the scene's cameras see on average.

    Raises
    ------
    SettingsError
        When a value is outside what is documented here.
    """

    size: tuple[int, int]
    paths: int
    max_bounces: int
    denoised: bool
    sources: tuple[Share, ...]
    files: tuple[str, ...] = ()
    environment: bool = False
    least_lit: float = 0.6
    darkest: float = 0.02

    def __post_init__(self) -> None:
        def need(ok: bool, key: str, expected: str) -> None:
            if not ok:
                raise SettingsError(f"bad {key} {getattr(self, key)!r}", WHERE, f"expected {expected}")

        need(len(self.size) == 2 and all(isinstance(n, int) and n >= 32 and n % 2 == 0 for n in self.size), "size",
             "two even numbers of at least 32")
        need(isinstance(self.paths, int) and self.paths >= 1, "paths", "a whole number above 0")
        need(isinstance(self.max_bounces, int) and self.max_bounces >= 1, "max_bounces", "a whole number above 0")
        for key in ("denoised", "environment"):
            need(isinstance(getattr(self, key), bool), key, "true or false")
        for key in ("least_lit", "darkest"):
            value = getattr(self, key)
            need(isinstance(value, float | int) and not isinstance(value, bool) and 0 < value <= 1, key,
                 "a share above 0, at most 1")
        need(bool(self.sources), "sources", "at least one")
        for s in self.sources:
            need(s.source in (*SOURCES, FILES), "sources", f"names among {', '.join((*SOURCES, FILES))}")
            need(s.share > 0 and isinstance(s.pairs, int) and s.pairs >= 1, "sources", "a share and pairs above 0")
        need(bool(self.files) or all(s.source != FILES for s in self.sources), "files", "scene files for that source")

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def read_config(path: Path | None) -> Config:
    """The configuration in a TOML file, or the default one.

    Raises
    ------
    SettingsError
        When the file can't be read, lacks a key, or has an unknown or bad one.
    """
    path = path or DEFAULT
    try:
        return from_table(tomllib.loads(path.read_text("utf-8")))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise SettingsError(f"can't read the configuration ({error})", path, "expected a TOML file") from None
    except SettingsError as error:
        raise SettingsError(error.what, path, error.expected) from None
    except (TypeError, ValueError) as error:
        raise SettingsError(f"bad configuration ({error})", path, f"expected such keys as in {DEFAULT}") from None


def from_table(table: dict[str, Any]) -> Config:
    """The configuration of a TOML table; its files lie in the table's ``folder``."""
    known = {f.name for f in fields(Config)} | {"folder"}
    needed = {f.name for f in fields(Config) if f.default is MISSING}
    for key in table.keys() ^ needed:
        if key not in known or key in needed:
            raise SettingsError(f"unknown or missing key {key!r}", WHERE,
                                f"expected {', '.join(sorted(known))}")
    if not isinstance(table["sources"], dict):
        raise SettingsError(f"bad sources {table['sources']!r}", WHERE, "expected a table of names and their shares")
    folder = Path(table.get("folder", "."))
    shares = tuple(Share(name, **values) for name, values in table["sources"].items())
    files = tuple(str(folder / name) for name in table.get("files", ()))
    plain = {key: value for key, value in table.items() if key not in ("folder", "size", "sources", "files")}
    return Config(size=tuple(table["size"]), sources=shares, files=files, **plain)
