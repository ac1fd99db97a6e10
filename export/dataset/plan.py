"""Which source makes which pairs, and the pairs. They depend on configuration and seed only: a dataset can grow."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from export.dataset.cameras import random_camera, random_previous_camera
from export.dataset.config import Config
from export.dataset.scenes import lights
from export.dataset.scenes.environments import with_random_environment
from export.dataset.scenes.files import load_random_file
from export.dataset.scenes.generated_scene import FRAME_SECONDS, GeneratedScene
from export.dataset.scenes.sources import FILES, SOURCES
from export.reference.still import Still

TRAINING = 0  # first number of every seed; the validation list has another one
CAMERA_MOTION, OBJECT_MOTION, LIGHT_MOTION = 0.8, 0.6, 0.25  # probabilities that these move between the frames


@dataclass(frozen=True, eq=False)
class Pair:
    """Neighbouring frames. Both share one ``Scene`` object unless a light moves."""

    previous: Still
    current: Still


@dataclass(frozen=True)
class Group:
    """Consecutive pairs of one scene.

    Attributes
    ----------
    number : int
        Of the group, from 0.
    source : str
    first, pairs : int
        Index of the first pair, and the number of pairs.
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
    """The random scene and camera of a pair: the ``attempt`` to make the scene, and the number of the ``camera``."""

    attempt: int
    camera: int


@lru_cache(maxsize=4)
def plan_groups(config: Config, pairs: int) -> tuple[Group, ...]:
    """The groups of the first ``pairs`` pairs; each goes to the source that is furthest behind its weight."""
    total = sum(source.weight for source in config.sources)
    planned = dict.fromkeys(config.sources, 0)
    groups: list[Group] = []
    first = 0
    while first < pairs:
        source = max(config.sources, key=lambda s: s.weight / total * (first + s.pairs_per_scene) - planned[s])
        groups.append(Group(len(groups), source.name, first, source.pairs_per_scene))
        planned[source] += source.pairs_per_scene
        first += source.pairs_per_scene
    return tuple(groups)


@lru_cache(maxsize=4)
def generate_scene(config: Config, seed: int, group: Group, attempt: int) -> GeneratedScene:
    """The scene of ``group``; each ``attempt`` gives another one."""
    rng = np.random.default_rng([TRAINING, seed, group.number, attempt])
    generated = load_random_file(rng, config.scene_files) if group.source == FILES else SOURCES[group.source](rng)
    if config.environment:
        return replace(generated, scene=with_random_environment(rng, generated.scene))
    return generated


def generate_pair(config: Config, seed: int, group: Group, choice: Choice) -> Pair:
    """One of the many possible pairs of the group's scene; the camera, objects, a light, or nothing moves."""
    generated = generate_scene(config, seed, group, choice.attempt)
    rng = np.random.default_rng([TRAINING, seed, group.number, choice.attempt, choice.camera])
    camera, scene = random_camera(generated, rng), generated.scene
    camera_moves, objects_move, light_moves = rng.random(3) < (CAMERA_MOTION, OBJECT_MOTION, LIGHT_MOTION)
    previous_camera = random_previous_camera(camera, rng) if camera_moves else camera
    if light_moves and scene.lights:
        previous_lights = list(scene.lights)
        index = rng.integers(len(previous_lights))
        previous_lights[index] = lights.displace(rng, previous_lights[index])
        scene = replace(scene, lights=tuple(previous_lights))
    return Pair(Still(scene, previous_camera, config.size, 0.0 if objects_move else FRAME_SECONDS),
                Still(generated.scene, camera, config.size, FRAME_SECONDS))
