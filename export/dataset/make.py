"""What a worker does: the missing items of one group."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import drjit

from app.errors import SceneError
from export.dataset.cameras import choose
from export.dataset.config import Config
from export.dataset.key import scene_key
from export.dataset.pair import Pair
from export.dataset.plan import Choice, Group, pair_at, place_of
from export.dataset.scenes.generated_scene import FRAME_SECONDS
from export.dataset.store import Origin, encode
from export.dataset.target import SKY_VERSION, VERSION, trace_sky, trace_target
from export.reference.environment_tracer import EnvironmentTracer
from export.reference.path_tracer import PathTracer

ATTEMPTS = 20    # scenes that are tried for a group
CANDIDATES = 48  # cameras that are tried in a scene

_ALONE = threading.Lock()  # the path tracer's number of threads is that of the process


def make_group(config: Config, seed: int, group: Group, wanted: Sequence[int],
               known: Mapping[int, Origin]) -> dict[int, bytes]:
    """The files, by index, of those ``wanted`` pairs whose ``known`` origin is not what would be made today.

    Parameters
    ----------
    wanted : sequence of int
        Indices of pairs of the group.

    Raises
    ------
    SceneError
        When a source makes no scene with enough cameras.
    """
    with _ALONE, _one_thread():
        missing = [index for index in wanted if not _up_to_date(config, seed, group, known.get(index))]
        return dict(_make(config, seed, group, missing)) if missing else {}


@contextmanager
def _one_thread() -> Iterator[None]:
    """With several threads the path tracer now and then gives a few texels another value, so bytes would differ."""
    before = drjit.thread_count()
    drjit.set_thread_count(1)
    try:
        yield
    finally:
        drjit.set_thread_count(before)


def key_of(config: Config, pair: Pair) -> str:
    """The content key of a pair and of all that its target depends on."""
    previous, current = pair.previous, pair.current
    sky = (SKY_VERSION,) if config.environment else ()
    options = (VERSION, config.paths, config.max_bounces, config.denoised, *sky)
    moved_lights = () if previous.scene is current.scene else previous.scene.lights
    return scene_key(current.scene, options, moved_lights,
                     [(still.camera, still.size, still.time) for still in (previous, current)])


def _up_to_date(config: Config, seed: int, group: Group, origin: Origin | None) -> bool:
    return origin is not None and key_of(config, pair_at(config, seed, group, origin.choice)) == origin.key


def _make(config: Config, seed: int, group: Group, missing: list[int]) -> Iterator[tuple[int, bytes]]:
    tracer, choices = _choose(config, seed, group)
    for index in missing:
        choice = choices[index - group.first]
        pair = pair_at(config, seed, group, choice)
        if isinstance(tracer, EnvironmentTracer):
            target = trace_sky(tracer, pair.current, config.paths, index - group.first, config.denoised)
        else:
            target = trace_target(tracer, pair.current, config.paths, index - group.first, config.denoised)
        yield index, encode(target, Origin(choice, key_of(config, pair)))


def _choose(config: Config, seed: int, group: Group) -> tuple[PathTracer, list[Choice]]:
    """The first scene that has enough cameras, and these."""
    for attempt in range(ATTEMPTS):
        place = place_of(config, seed, group, attempt)
        tracer = (EnvironmentTracer(place.scene, FRAME_SECONDS) if config.environment
                  else PathTracer(place.scene, FRAME_SECONDS, config.max_bounces))
        candidates = (pair_at(config, seed, group, Choice(attempt, k)).current.camera for k in range(CANDIDATES))
        cameras = choose(tracer, place.scene.longest_edge, candidates, group.pairs, config.least_lit, config.darkest)
        if len(cameras) == group.pairs:
            return tracer, [Choice(attempt, k) for k in cameras]
    raise SceneError(f"no camera shows enough in {ATTEMPTS} scenes", f"source {group.source!r}",
                     "expected scenes that are lit and have room for cameras")
