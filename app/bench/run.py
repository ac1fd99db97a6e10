"""The flow of a benchmark: reference, pictures and their errors, times in turns, and what follows from them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.bench import cold_start, records
from app.bench.baselines import NAMES, TRACED, Baseline, Trace, draw_baselines, traced_before, traced_now
from app.bench.headlines import HEADLINE_ERROR, headlines
from app.bench.machine import describe_machine
from app.errors import SceneError, SettingsError
from app.evaluation.configurations import Configuration, at_work, nothing_to_shade
from app.evaluation.picture_errors import AMBIENT, UNDER_SKY, draw_ambient, draw_layers, errors_of
from app.evaluation.reference import Order, Reference, make_reference, read_reference
from app.evaluation.timing import InterleavedTimer, Spread, TimedRun, yardstick
from app.extras import extra_module
from app.load import load_scene
from app.scene import Camera, Scene

VERSION = 2  # of the JSON file
JUDGE = ("flip_evaluator", "matplotlib", "psutil", "pyoidn", "skimage")

F32 = NDArray[np.float32]
Json = dict[str, Any]
Progress = Callable[[str], None]
Pictures = dict[str, F32]


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes
    ----------
    sizes : tuple of (int, int)
        Errors are judged at the first one, or at the size of the reference in ``reference``.
    reference_folder : Path or None
        Folder with ``reference.exr`` and ``reference.json``, or with such a folder for each scene's name, which more than one
        scene need; None: path-traced now, or taken from the cache.
    spp : int
        Samples per pixel of a reference that is made now.
    turns : int
        How often each configuration takes its turn.
    """

    scenes: tuple[Path, ...]
    sizes: tuple[tuple[int, int], ...]
    lighting: str | None = None
    camera: str | None = None
    reference_folder: Path | None = None
    spp: int = 1024
    turns: int = 5
    provider: str = "auto"


@dataclass
class Outcome:
    """``results`` as they go to JSON, and linear ``pictures`` [H, W, 3] by scene and label, the reference first."""

    results: Json
    pictures: dict[str, Pictures] = field(default_factory=dict)


@dataclass(frozen=True)
class _Loaded:
    """One scene with its camera, what is measured in it and what not."""

    file: Path
    scene: Scene
    camera: Camera
    configurations: list[Configuration]
    absent: list[str]


@dataclass(frozen=True)
class _Subject(_Loaded):
    """The same with its reference."""

    reference: Reference
    trace: Trace


def bench(options: Options, configurations: Sequence[Configuration], progress: Progress = lambda _: None) -> Outcome:
    """Measure ``configurations`` on every scene.

    Parameters
    ----------
    configurations : sequence of Configuration
        In the options' sizes.
    progress : callable, optional
        Called with a line for each step.

    Raises
    ------
    AfterglowError
        When a scene, a model, the reference or the device can't be had.
    """
    for name in JUDGE:  # says at once what is missing
        extra_module(name, "judge")
    begin = time.perf_counter()
    outcome = Outcome({"version": VERSION, "machine": describe_machine(), "scenes": []})
    names = [file.stem for file in options.scenes]
    if len(set(names)) < len(names):
        raise SettingsError("two scenes of one name", ", ".join(names), "expected different file names")
    loaded = [_load(file, options, configurations, progress) for file in options.scenes]  # all, before one is traced
    subjects = [_with_reference(scene, options, progress) for scene in loaded]
    outcome.results["absent"] = [note for subject in subjects for note in subject.absent]
    for subject in subjects:
        outcome.pictures[subject.scene.name] = pictures = {"reference": subject.reference.layers["final"]}
        outcome.results["scenes"].append(_run(subject, options, pictures, progress))
    outcome.results["headlines"] = headlines(outcome.results["scenes"])
    outcome.results["seconds"] = round(time.perf_counter() - begin, 1)
    return outcome


def _load(file: Path, options: Options, configurations: Sequence[Configuration], progress: Progress) -> _Loaded:
    progress(f"{file.stem}: loading")
    scene = load_scene(file, lighting=options.lighting)
    if options.camera is not None and options.camera not in scene.cameras:
        raise SettingsError(f"no camera {options.camera!r} in {file}", "--camera",
                            f"expected one of {', '.join(scene.cameras)}")
    camera = scene.cameras[options.camera or scene.default_camera].at(0.0)
    measured, idle = at_work(configurations, scene)
    if not measured:
        raise nothing_to_shade(scene, idle)
    absent = [f"{scene.name} has no environment for {', '.join(idle)}"] if idle else []
    return _Loaded(file, scene, camera, measured, absent)


def _with_reference(loaded: _Loaded, options: Options, progress: Progress) -> _Subject:
    if options.reference_folder is None:
        order = Order(loaded.file, options.lighting, options.camera, options.sizes[0])
        progress(f"{loaded.file.stem}: the path-traced reference")
        reference = make_reference(order, loaded.scene, loaded.camera, options.spp)
        return _Subject(**vars(loaded), reference=reference, trace=traced_now(order))
    folder = _reference_of(loaded.scene.name, options.reference_folder, len(options.scenes))
    reference = read_reference(folder)
    if reference.size not in options.sizes:
        raise SceneError(f"a reference of {reference.size[0]}x{reference.size[1]}", folder, "expected one of the --sizes")
    return _Subject(**vars(loaded), reference=reference, trace=traced_before(folder, reference))


def _reference_of(scene: str, reference: Path, scenes: int) -> Path:
    """The folder with the reference of one of so many scenes."""
    own = reference / scene
    if own.is_dir():
        return own
    if scenes > 1:
        raise SceneError(f"no reference of {scene}", own, f"expected a folder for each of the {scenes} scenes")
    return reference


def _run(subject: _Subject, options: Options, pictures: Pictures, progress: Progress) -> Json:
    judged, ambient = _judge(subject, options, pictures, progress)
    timed_runs, opponents, pace = _take_turns(subject, options, progress)
    entries = [records.timed_run(c) for c in timed_runs]
    largest = max(options.sizes, key=math.prod)
    for entry, c in zip(entries, subject.configurations, strict=True):
        entry["errors"] = judged[c.label] if c.size == subject.reference.size else None
        if c.size == largest:
            progress(f"{subject.scene.name}: starting {c.label} in a fresh process")
            entry["fresh"] = cold_start.start(subject.file, options.lighting, options.camera, c, options.provider)
    result: Json = {
        "name": subject.scene.name, "lighting": subject.scene.lighting,
        "camera": options.camera or subject.scene.default_camera, "triangles": subject.scene.triangles,
        "lights": len(subject.scene.lights), "reference": records.reference(subject.reference), "configurations": entries,
        "ambient": ambient, "baselines": [records.baseline(r, subject.reference) for r in opponents],
        "yardstick": records.spread(pace),
    }
    if subject.scene.environment is not None:
        result["reference"]["notices"] = [*result["reference"]["notices"], UNDER_SKY]
    _keep_pictures_of(opponents, result, pictures)
    return result


def _judge(subject: _Subject, options: Options, pictures: Pictures,
           progress: Progress) -> tuple[dict[str, Json], Json]:
    """Errors by label at the reference's size, and the ambient oracle; what was drawn goes to ``pictures``."""
    judged = {}
    for c in (c for c in subject.configurations if c.size == subject.reference.size):
        progress(f"{subject.scene.name}: judging {c.label}")
        layers = draw_layers(subject.scene, subject.camera, c, options.provider)
        judged[c.label], pictures[c.label] = records.errors(errors_of(layers, subject.reference)), layers["final"]
    progress(f"{subject.scene.name}: judging {AMBIENT}")
    layers, constant = draw_ambient(subject.scene, subject.camera, subject.reference, options.provider)
    pictures[AMBIENT] = layers["final"]
    return judged, {"constant": constant, "errors": records.errors(errors_of(layers, subject.reference))}


def _take_turns(subject: _Subject, options: Options,
                progress: Progress) -> tuple[list[TimedRun], list[Baseline], Spread]:
    """Times of all configurations, those of one size in turns; halfway through the reference's, the path tracer's.

    Last the yardstick's.
    """
    opponents: list[Baseline] = []
    yardsticks: list[list[float]] = []
    timed_runs = [TimedRun(subject.scene, subject.camera, c) for c in subject.configurations]
    for size in dict.fromkeys(c.size for c in subject.configurations):
        with InterleavedTimer([c for c in timed_runs if c.configuration.size == size], options.provider) as timer:
            for turn in range(options.turns):
                progress(f"{subject.scene.name}: {size[0]}x{size[1]}, turn {turn + 1} of {options.turns}")
                yardsticks.append(yardstick())
                timer.turn()
                if size == subject.reference.size and turn == options.turns // 2:
                    opponents = draw_baselines(subject.trace)
    return timed_runs, opponents, Spread.of(yardsticks)


def _keep_pictures_of(opponents: Sequence[Baseline], scene: Json, pictures: Pictures) -> None:
    """The path tracer's first picture, and of each denoiser the first and the first that is as near as a network."""
    layer, metric = HEADLINE_ERROR
    best = min((c["errors"][layer][metric] for c in scene["configurations"] if c["errors"] and c["grid"]), default=0.0)
    for name in NAMES:
        rows = [(baseline, row) for baseline, row in zip(opponents, scene["baselines"], strict=True) if baseline.name == name]
        equal = [pair for pair in rows if pair[1]["errors"][layer][metric] <= best]
        for baseline, _ in [*rows[:1], *(equal[:1] if name != TRACED else [])]:
            pictures[f"{name}, {baseline.spp} spp"] = baseline.picture
