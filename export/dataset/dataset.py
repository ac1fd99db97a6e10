"""A finished dataset in its folder."""

from __future__ import annotations

import bisect
import json
from importlib import metadata
from pathlib import Path
from typing import Any

from app.errors import SettingsError
from app.io.atomic_files import write_text
from export.dataset.config import Config, Share
from export.dataset.pair import Pair
from export.dataset.plan import Group, pair_at, plan
from export.dataset.store import item_path, read_origin, read_target
from export.dataset.target import VERSION, Target

ABOUT = "dataset.json"
PACKAGES = ("mitsuba", "drjit", "pyoidn", "numpy")  # that targets and scenes depend on


class Dataset:
    """Pairs and their targets by index.

    Parameters
    ----------
    folder : Path
        Where ``python -m export dataset`` has put it.

    Raises
    ------
    SettingsError
        When there is none, or it is not finished.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        about = read_about(folder)
        if about is None:
            raise SettingsError("no dataset", folder, f"expected one: python -m export dataset --out {folder} …")
        self.config, self.seed, self._length = config_of(about), int(about["seed"]), int(about["pairs"])
        missing = next((i for i in range(self._length) if not item_path(folder, i).is_file()), None)
        if missing is not None:
            raise SettingsError(f"the dataset lacks pair {missing} of {self._length}", folder,
                                f"expected all; run python -m export dataset --out {folder} again")
        self._groups = plan(self.config, self._length)
        self._firsts = [group.first for group in self._groups]

    def __len__(self) -> int:
        return self._length

    def source(self, index: int) -> str:
        """The name of the source that made a pair."""
        return self._group(index).source

    def pair(self, index: int) -> Pair:
        """The frames, made anew from the seed; neighbouring indices often share a scene, which is kept.

        Raises
        ------
        SettingsError
            When the pair's file is corrupt.
        """
        origin = read_origin(item_path(self.folder, index))
        if origin is None:
            raise SettingsError("a corrupt item", item_path(self.folder, index),
                                f"expected a sound one; run python -m export dataset --out {self.folder} again")
        return pair_at(self.config, self.seed, self._group(index), origin.choice)

    def target(self, index: int) -> Target:
        """What was traced for the current frame of a pair."""
        return read_target(item_path(self.folder, index))

    def _group(self, index: int) -> Group:
        if not 0 <= index < self._length:
            raise IndexError(index)
        return self._groups[bisect.bisect_right(self._firsts, index) - 1]


def read_about(folder: Path) -> dict[str, Any] | None:
    """What ``dataset.json`` says; None where there is none."""
    path = folder / ABOUT
    if not path.is_file():
        return None
    try:
        about: dict[str, Any] = json.loads(path.read_text("utf-8"))
        config_of(about)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SettingsError(f"can't read the file ({error})", path, "expected what export dataset writes") from None
    return about


def write_about(folder: Path, config: Config, seed: int, pairs: int) -> None:
    """Write ``dataset.json``."""
    versions = {name: metadata.version(name) for name in PACKAGES}
    about = {"pairs": pairs, "seed": seed, "config": config.to_json(), "versions": {"targets": VERSION, **versions}}
    write_text(folder / ABOUT, json.dumps(about, indent=1) + "\n")


def config_of(about: dict[str, Any]) -> Config:
    """The configuration in ``dataset.json``."""
    table = about["config"]
    sources = tuple(Share(**share) for share in table["sources"])
    return Config(**{**table, "size": tuple(table["size"]), "files": tuple(table["files"]), "sources": sources})
