"""The task of a worker: make the missing items of one group."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import drjit

from app.errors import SceneError
from export.dataset.cameras import choose_cameras
from export.dataset.config import Config
from export.dataset.plan import Choice, Group, Pair, generate_pair, generate_scene
from export.dataset.scene_key import scene_key
from export.dataset.scenes.generated_scene import FRAME_SECONDS
from export.dataset.store import Origin, encode
from export.dataset.target import ENVIRONMENT_VERSION, VERSION, trace_target
from export.reference.environment_tracer import EnvironmentTracer
from export.reference.path_tracer import PathTracer

MAX_ATTEMPTS = 20    # scenes generated for a group
MAX_CANDIDATES = 48  # cameras tried in a scene

_LOCK = threading.Lock()  # the path tracer's number of threads belongs to the process


def make_group(config: Config, seed: int, group: Group, indices: Sequence[int],
               known: Mapping[int, Origin]) -> dict[int, bytes]:
    """Contents of the files, by index, of those pairs that have no ``known`` origin, or an outdated one.

    Parameters
    ----------
    indices : sequence of int
        Pairs of the group.
    known : mapping of int to Origin
        Origins of the files that exist, by index.

    Raises
    ------
    SceneError
        When the source makes no scene with enough cameras.
    """
    with _LOCK, _one_thread():
        missing = [i for i in indices if i not in known
                   or pair_key(config, generate_pair(config, seed, group, known[i].choice)) != known[i].key]
        if not missing:
            return {}
        tracer, choices = _choose(config, seed, group)
        contents = {}
        for index in missing:
            choice = choices[index - group.first]
            pair = generate_pair(config, seed, group, choice)
            target = trace_target(tracer, pair.current, config.spp, index - group.first, config.denoise)
            contents[index] = encode(target, Origin(choice, pair_key(config, pair)))
        return contents


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit the path tracer to one thread; with several, a few texels differ between runs."""
    before = drjit.thread_count()
    drjit.set_thread_count(1)
    try:
        yield
    finally:
        drjit.set_thread_count(before)


def pair_key(config: Config, pair: Pair) -> str:
    """The content key of a pair and of everything that its target depends on."""
    previous, current = pair.previous, pair.current
    environment = (ENVIRONMENT_VERSION,) if config.environment else ()
    options = (VERSION, config.spp, config.max_bounces, config.denoise, *environment)
    previous_lights = () if previous.scene is current.scene else previous.scene.lights
    return scene_key(current.scene, options, previous_lights,
                     [(still.camera, still.size, still.time) for still in (previous, current)])


def _choose(config: Config, seed: int, group: Group) -> tuple[PathTracer, list[Choice]]:
    """The first scene that has enough suitable cameras, and these cameras."""
    for attempt in range(MAX_ATTEMPTS):
        scene = generate_scene(config, seed, group, attempt).scene
        tracer = (EnvironmentTracer(scene, FRAME_SECONDS) if config.environment
                  else PathTracer(scene, FRAME_SECONDS, config.max_bounces, emission_is_direct=False))
        candidates = (generate_pair(config, seed, group, Choice(attempt, k)).current.camera
                      for k in range(MAX_CANDIDATES))
        cameras = choose_cameras(tracer, scene.longest_edge, candidates, group.pairs, config.min_lit_share,
                                 config.min_mean_luminance_share)
        if len(cameras) == group.pairs:
            return tracer, [Choice(attempt, k) for k in cameras]
    raise SceneError(f"too few suitable cameras in {MAX_ATTEMPTS} scenes", f"source {group.source!r}",
                     "expected lit scenes with free space for cameras")
