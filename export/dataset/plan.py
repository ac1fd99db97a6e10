"""Which source makes which pairs: depends on the configuration alone, so that a dataset can grow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count

import numpy as np

from export.dataset.cameras import random_camera
from export.dataset.config import Config
from export.dataset.pair import Pair, pair_of
from export.dataset.scenes.environments import under_sky
from export.dataset.scenes.files import open_file
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.sources import FILES, SOURCES

TRAINING = 0  # first number of every seed; the validation list has another one


@dataclass(frozen=True)
class Group:
    """Neighbouring pairs of one scene.

    Attributes
    ----------
    number : int
        Of the group, from 0.
    first, pairs : int
        Index of its first pair, and how many there are.
    """

    number: int
    source: str
    first: int
    pairs: int

    def within(self, total: int) -> range:
        """Indices of its pairs in a dataset of ``total`` pairs, which may end before the group does."""
        return range(self.first, min(self.first + self.pairs, total))


@dataclass(frozen=True)
class Choice:
    """Where a pair came from, as its file says: the scene's ``attempt`` and the number of its ``camera`` there."""

    attempt: int
    camera: int


@lru_cache(maxsize=4)
def plan(config: Config, pairs: int) -> tuple[Group, ...]:
    """The groups that the first ``pairs`` pairs are in; each is by the source that is furthest behind its share."""
    total = sum(s.share for s in config.sources)
    made = dict.fromkeys(config.sources, 0)
    groups: list[Group] = []
    first = 0
    for number in count():
        if first >= pairs:
            break
        chosen = max(config.sources, key=lambda s: s.share / total * (first + s.pairs) - made[s])
        groups.append(Group(number, chosen.source, first, chosen.pairs))
        made[chosen] += chosen.pairs
        first += chosen.pairs
    return tuple(groups)


@lru_cache(maxsize=4)
def place_of(config: Config, seed: int, group: Group, attempt: int) -> GeneratedScene:
    """The scene of ``group``; a further ``attempt`` gives another one."""
    rng = np.random.default_rng([TRAINING, seed, group.number, attempt])
    place = open_file(rng, config.files) if group.source == FILES else SOURCES[group.source](rng)
    return replace(place, scene=under_sky(rng, place.scene)) if config.environment else place


def pair_at(config: Config, seed: int, group: Group, choice: Choice) -> Pair:
    """One of the many pairs that the group's scene could have."""
    place = place_of(config, seed, group, choice.attempt)
    rng = _rng(seed, group, choice)
    return pair_of(place, random_camera(place, rng), config.size, rng)


def _rng(seed: int, group: Group, choice: Choice) -> Rng:
    return np.random.default_rng([TRAINING, seed, group.number, choice.attempt, choice.camera])
