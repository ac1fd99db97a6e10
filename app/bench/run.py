"""The steps of a benchmark: references, pictures and their errors, times in interleaved rounds, headline figures."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from app.arrays import F32
from app.bench.baselines import COUNTS, NAMES, TRACED, Baseline, Trace, draw_baselines, recorded_trace
from app.bench.cold_start import measure_cold_start
from app.bench.headlines import HEADLINE_ERROR, headlines
from app.bench.machine import describe_machine
from app.bench.records import Json, baseline_record, error_record, reference_record, run_record, spread_record
from app.errors import SceneError, SettingsError
from app.evaluation.configurations import Configuration, no_environment_error, select_applicable
from app.evaluation.picture_errors import AMBIENT, draw_ambient, draw_layers, errors_of
from app.evaluation.reference import Reference, TraceRequest, make_baseline_images, make_reference, read_reference
from app.evaluation.timing import InterleavedTimer, Spread, TimedRun, yardstick
from app.extras import require_evaluation_packages
from app.load import load_scene
from app.scene import Camera, Scene

VERSION = 3  # of the JSON file

Progress = Callable[[str], None]
Pictures = dict[str, F32]


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes
    ----------
    sizes : tuple of (int, int)
        Errors are measured at the first one, or at the size of the reference in ``reference_folder``.
    reference_folder : Path or None
        Folder with ``reference.exr`` and ``reference.json``, or with such a folder for each scene's name, which is
        required for more than one scene. If None, references are path-traced or taken from the cache.
    spp : int
        Samples per pixel of references that are path-traced now.
    rounds : int
        How often each configuration is timed.
    skip_idle_scenes : bool
        Leave out scenes in which no configuration has work, instead of refusing them.
    """

    scenes: tuple[Path, ...]
    sizes: tuple[tuple[int, int], ...]
    lighting: str | None = None
    camera: str | None = None
    variant: str | None = None
    reference_folder: Path | None = None
    spp: int = 1024
    rounds: int = 5
    provider: str = "auto"
    skip_idle_scenes: bool = False


@dataclass
class Outcome:
    """``results`` as written to JSON, and linear ``pictures`` [H, W, 3] by scene and label, the reference first."""

    results: Json
    pictures: dict[str, Pictures] = field(default_factory=dict)


@dataclass(frozen=True)
class _Loaded:
    """A scene with its camera, the configurations that have work in it, and the labels of those that have none."""

    file: Path
    scene: Scene
    camera: Camera
    configurations: list[Configuration]
    idle: list[str]


@dataclass(frozen=True)
class _Subject(_Loaded):
    """A scene with its reference."""

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
        When a scene, a model, the reference or the device is not available.
    """
    require_evaluation_packages()
    begin = time.perf_counter()
    outcome = Outcome({"version": VERSION, "machine": describe_machine(), "scenes": []})
    names = [file.stem for file in options.scenes]
    if len(set(names)) < len(names):
        raise SettingsError("two scenes have the same name", ", ".join(names), "expected different file names")
    loaded = [_load(file, options, configurations, progress) for file in options.scenes]
    measured = [scene for scene in loaded if scene.configurations]
    for scene in loaded:
        if not scene.configurations and not (options.skip_idle_scenes and measured):
            raise no_environment_error(scene.scene, scene.idle)
    subjects = [_with_reference(scene, options, progress) for scene in measured]
    outcome.results["absent"] = [f"{scene.scene.name} has no environment for {', '.join(scene.idle)}"
                                 for scene in loaded if scene.idle]
    for subject in subjects:
        outcome.pictures[subject.scene.name] = pictures = {"reference": subject.reference.layers["final"]}
        outcome.results["scenes"].append(_measure(subject, options, pictures, progress))
    outcome.results["headlines"] = headlines(outcome.results["scenes"])
    outcome.results["seconds"] = round(time.perf_counter() - begin, 1)
    return outcome


def _load(file: Path, options: Options, configurations: Sequence[Configuration], progress: Progress) -> _Loaded:
    progress(f"{file.stem}: loading")
    scene = load_scene(file, lighting=options.lighting, variant=options.variant)
    if options.camera is not None and options.camera not in scene.cameras:
        raise SettingsError(f"{file} has no camera {options.camera!r}", "--camera",
                            f"expected one of: {', '.join(scene.cameras)}")
    camera = scene.cameras[options.camera or scene.default_camera].at(0.0)
    return _Loaded(file, scene, camera, *select_applicable(configurations, scene))


def _with_reference(loaded: _Loaded, options: Options, progress: Progress) -> _Subject:
    if options.reference_folder is None:
        request = TraceRequest(loaded.file, options.lighting, options.camera, options.sizes[0], options.variant)
        progress(f"{loaded.file.stem}: path-traced reference")
        reference = make_reference(request, loaded.scene, loaded.camera, options.spp)
        return _Subject(**vars(loaded), reference=reference, trace=partial(make_baseline_images, request, COUNTS))
    folder = options.reference_folder / loaded.scene.name
    if not folder.is_dir():
        if len(options.scenes) > 1:
            raise SceneError(f"no reference of {loaded.scene.name}", folder,
                             f"expected a folder for each of the {len(options.scenes)} scenes")
        folder = options.reference_folder
    reference = read_reference(folder)
    if reference.size not in options.sizes:
        raise SceneError(f"the reference is {reference.size[0]}x{reference.size[1]}", folder,
                         "expected one of the --sizes")
    return _Subject(**vars(loaded), reference=reference, trace=recorded_trace(folder, reference))


def _measure(subject: _Subject, options: Options, pictures: Pictures, progress: Progress) -> Json:
    """Everything about one scene; its pictures are added to ``pictures``."""
    errors, ambient = _measure_errors(subject, options, pictures, progress)
    runs, baselines, calibration = _measure_times(subject, options, progress)
    entries = [run_record(run) for run in runs]
    largest = max(options.sizes, key=math.prod)
    for entry, c in zip(entries, subject.configurations, strict=True):
        entry["errors"] = errors[c.label] if c.size == subject.reference.size else None
        if c.size == largest:
            progress(f"{subject.scene.name}: starting {c.label} in a new process")
            entry["cold_start"] = measure_cold_start(subject.file, options.lighting, options.camera, options.variant,
                                                     c, options.provider)
    result: Json = {
        "name": subject.scene.name, "lighting": subject.scene.lighting,
        "camera": options.camera or subject.scene.default_camera, "triangles": subject.scene.triangles,
        "lights": len(subject.scene.lights), "reference": reference_record(subject.reference),
        "configurations": entries, "ambient": ambient,
        "baselines": [baseline_record(baseline, subject.reference) for baseline in baselines],
        "yardstick": spread_record(calibration),
    }
    _add_baseline_pictures(baselines, result, pictures)
    return result


def _measure_errors(subject: _Subject, options: Options, pictures: Pictures,
                    progress: Progress) -> tuple[dict[str, Json], Json]:
    """Errors by label at the reference's size, and those of the ambient oracle; adds what it draws to ``pictures``."""
    errors = {}
    for c in (c for c in subject.configurations if c.size == subject.reference.size):
        progress(f"{subject.scene.name}: errors of {c.label}")
        layers = draw_layers(subject.scene, subject.camera, c, options.provider)
        errors[c.label], pictures[c.label] = error_record(errors_of(layers, subject.reference)), layers["final"]
    progress(f"{subject.scene.name}: errors of {AMBIENT}")
    layers, constant = draw_ambient(subject.scene, subject.camera, subject.reference, options.provider)
    pictures[AMBIENT] = layers["final"]
    return errors, {"constant": constant, "errors": error_record(errors_of(layers, subject.reference))}


def _measure_times(subject: _Subject, options: Options,
                   progress: Progress) -> tuple[list[TimedRun], list[Baseline], Spread]:
    """Times of all configurations, those of one size interleaved; the baselines; and the times of the yardstick.

    The baselines are drawn halfway through the rounds of the reference's size.
    """
    baselines: list[Baseline] = []
    calibration: list[list[float]] = []
    runs = [TimedRun(subject.scene, subject.camera, c) for c in subject.configurations]
    for size in dict.fromkeys(c.size for c in subject.configurations):
        with InterleavedTimer([run for run in runs if run.configuration.size == size], options.provider) as timer:
            for number in range(options.rounds):
                progress(f"{subject.scene.name}: {size[0]}x{size[1]}, round {number + 1} of {options.rounds}")
                calibration.append(yardstick())
                timer.run_round()
                if size == subject.reference.size and number == options.rounds // 2:
                    baselines = draw_baselines(subject.trace)
    return runs, baselines, Spread.of(calibration)


def _add_baseline_pictures(baselines: Sequence[Baseline], scene: Json, pictures: Pictures) -> None:
    """The first picture of the path tracer; of each denoiser its first, and its first with the error of a network."""
    layer, metric = HEADLINE_ERROR
    best = min((c["errors"][layer][metric] for c in scene["configurations"] if c["errors"] and c["grid"]), default=0.0)
    for name in NAMES:
        rows = [(b, row) for b, row in zip(baselines, scene["baselines"], strict=True) if b.name == name]
        equal = [pair for pair in rows if pair[1]["errors"][layer][metric] <= best]
        for baseline, _ in [*rows[:1], *(equal[:1] if name != TRACED else [])]:
            pictures[f"{name}, {baseline.spp} spp"] = baseline.picture
