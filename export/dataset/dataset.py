"""A finished dataset in its folder."""

import bisect
import json
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from app.errors import SettingsError
from app.io.atomic_files import write_text
from export.dataset.config import Config, config_from_table
from export.dataset.plan import Group, Pair, generate_pair, plan_groups
from export.dataset.store import REPAIR, item_path, read_origin, read_target
from export.dataset.target import VERSION, Target

FILE = "dataset.json"
PACKAGES = ("mitsuba", "drjit", "pyoidn", "numpy")  # that scenes and targets depend on


@dataclass(frozen=True)
class About:
    """The content of ``dataset.json``."""

    config: Config
    seed: int
    pairs: int


class Dataset:
    """Pairs and their targets by index.

    Parameters
    ----------
    folder : Path
        Written by ``python -m export dataset make``.

    Raises
    ------
    SettingsError
        When the folder has no dataset, or an unfinished one.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        about = read_about(folder)
        if about is None:
            raise SettingsError("no dataset", folder,
                                f"expected a dataset; make one with python -m export dataset make --out {folder}")
        self.config, self.seed, self._length = about.config, about.seed, about.pairs
        missing = next((i for i in range(self._length) if not item_path(folder, i).is_file()), None)
        if missing is not None:
            raise SettingsError(f"the dataset lacks pair {missing} of {self._length}", folder, REPAIR.format(folder))
        self._groups = plan_groups(self.config, self._length)

    def __len__(self) -> int:
        return self._length

    def source(self, index: int) -> str:
        """The name of the source that made a pair."""
        return self._group(index).source

    def pair(self, index: int) -> Pair:
        """The frames, generated from the seed. Consecutive pairs often share a scene, which is cached.

        Raises
        ------
        SettingsError
            When the pair's file is corrupt.
        """
        path = item_path(self.folder, index)
        origin = read_origin(path)
        if origin is None:
            raise SettingsError("the dataset item is missing or corrupt", path, REPAIR.format(self.folder))
        return generate_pair(self.config, self.seed, self._group(index), origin.choice)

    def target(self, index: int) -> Target:
        """The path-traced light of the pair's current frame."""
        return read_target(item_path(self.folder, index))

    def _group(self, index: int) -> Group:
        if not 0 <= index < self._length:
            raise IndexError(index)
        return self._groups[bisect.bisect_right(self._groups, index, key=lambda group: group.first) - 1]


def read_about(folder: Path) -> About | None:
    """The content of ``dataset.json``; None when there is no such file.

    Raises
    ------
    SettingsError
        When the file is damaged or was made by another version.
    """
    path = folder / FILE
    if not path.is_file():
        return None
    try:
        table = json.loads(path.read_text("utf-8"))
        return About(config_from_table(table["config"], path), int(table["seed"]), int(table["pairs"]))
    except SettingsError as error:
        raise SettingsError(f"made by another version ({error.what})", path,
                            "expected this version's keys; make it again with python -m export dataset make "
                            "--out and a new folder") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SettingsError(f"can't read the file ({error})", path,
                            "expected a file of python -m export dataset make") from None


def write_about(folder: Path, about: About) -> None:
    """Write ``dataset.json``."""
    versions = {"targets": VERSION, **{name: metadata.version(name) for name in PACKAGES}}
    table = {"pairs": about.pairs, "seed": about.seed, "config": about.config.to_json(), "versions": versions}
    write_text(folder / FILE, json.dumps(table, indent=1) + "\n")
