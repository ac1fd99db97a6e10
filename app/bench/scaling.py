"""How cost scales: one quantity is swept, and each stage's time is fitted with a power of it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from app.bench.records import Json
from app.evaluation.configurations import Configuration
from app.evaluation.timing import FRAME, InterleavedTimer, TimedRun
from app.io.child_process import run_module
from app.math3d import translation
from app.paths import TRAINING
from app.scene import Camera, CameraPath, Instance, Material, Mesh, Motion, PointLight, Scene, bounds_of
from app.simple_meshes import block

Progress = Callable[[str], None]

SIZES = ((256, 192), (512, 384), (1024, 768), (1448, 1086))
TRIANGLES = (1_000, 10_000, 100_000, 1_000_000)
LIGHTS = (1, 2, 4, 8, 16)
SCALES = (1 / 16, 1 / 8, 3 / 16, 1 / 4)
MEDIUM_SIZE, QUERY_SIZE = (512, 384), (768, 768)  # at the second a grid of scale 1/16 is not below the minimum
MIN_MS = 0.1  # stages that never take longer are not fitted

WIDTH, HEIGHT = 8.0, 4.0
MATERIALS = (Material("ground", (0.5, 0.55, 0.4)), Material("walls", (0.7, 0.68, 0.65)),
             Material("ball", (0.7, 0.25, 0.2)))
VIEW = Camera((0.0, 2.4, 3.7), (0.0, 0.9, -1.0), fov_y_deg=60.0)
INTENSITY = 12.0  # of all lights together, W/sr


def measure_scaling(configurations: Sequence[Configuration], rounds: int, provider: str,
                    progress: Progress = lambda _: None) -> Json:
    """Sweep pixels, triangles, lights, network queries, surfels and network width in a generated hall.

    Surfels and width are fixed in a network's file: ``python -m export onnx scaling`` makes networks that differ in
    them.

    Parameters
    ----------
    configurations : sequence of Configuration
        The last one that consists of a single network is swept, or else the last one.

    Returns
    -------
    dict
        ``model``; and ``sweeps`` by quantity: ``counts``, and ``stages`` with ``ms`` for each count, ``exponent`` and
        its standard ``error``.

    Raises
    ------
    ProcessError
        When the networks can't be made.
    """
    model = ([c for c in configurations if isinstance(c.file, Path)] or list(configurations))[-1]
    medium = replace(model, size=MEDIUM_SIZE)
    sweeps = {
        "pixels": [(w * h, _hall_run(replace(model, size=(w, h)))) for w, h in SIZES],
        "triangles": [(n, _hall_run(medium, triangles=n)) for n in TRIANGLES],
        "lights": [(n, _hall_run(medium, lights=n)) for n in LIGHTS],
    }
    if isinstance(model.file, Path):
        scaled = [replace(model, size=QUERY_SIZE, scale=scale) for scale in SCALES]
        sweeps["queries"] = [(int(np.prod(c.grid or (0,))), _hall_run(c)) for c in scaled]
    with TemporaryDirectory() as folder:
        run_module(TRAINING, ["onnx", "scaling", "--out", folder])
        for quantity in ("surfels", "width"):
            files = {int(file.stem.removeprefix(f"{quantity}-")): file
                     for file in Path(folder).glob(f"{quantity}-*.onnx")}
            sweeps[quantity] = [(n, _hall_run(Configuration(quantity, (files[n],), MEDIUM_SIZE)))
                                for n in sorted(files)]
        return {"model": model.label,
                "sweeps": {quantity: _sweep(quantity, points, rounds, provider, progress)
                           for quantity, points in sweeps.items()}}


def fit_power(counts: Sequence[float], times: Sequence[float]) -> tuple[float, float]:
    """The exponent in time ∝ count ** exponent, by least squares in logarithms, and its standard error."""
    x, y = np.log(np.asarray(counts, np.float64)), np.log(np.maximum(times, 1e-9))
    slope, offset = np.polyfit(x, y, 1)
    residuals = y - slope * x - offset
    degrees = len(x) - 2
    error = np.sqrt((residuals @ residuals) / degrees / ((x - x.mean()) ** 2).sum()) if degrees > 0 else 0.0
    return float(slope), float(error)


def hall(triangles: int, lights: int) -> Scene:
    """A closed room with ``lights`` small point lights over ground of about ``triangles`` triangles.

    A block moves back and forth, so the shadow maps of all lights are redrawn in every frame.
    """
    meshes = (_ground(max(2, round(math.sqrt(triangles / 2)))),
              block("walls", 1, (-WIDTH, -HEIGHT, -WIDTH)), block("block", 2, (0.6, 0.6, 0.6)))
    times = np.arange(0.0, 600.0, 0.5)
    poses = np.stack([translation(np.array([-1.0 if i % 2 else 1.0, 1.2, -0.5])) for i in range(len(times))])
    instances = (Instance("ground", 0, np.eye(4)), Instance("walls", 1, translation(np.array([0, HEIGHT / 2, 0]))),
                 Instance("block", 2, np.eye(4), Motion(times, poses)))
    angles = 2 * np.pi * np.arange(lights) / lights
    point_lights = tuple(
        PointLight((2.2 * math.cos(a), HEIGHT - 0.6, 2.2 * math.sin(a)), (INTENSITY / lights,) * 3, 0.05)
        for a in angles.tolist())
    return Scene("hall", meshes, instances, MATERIALS, point_lights, {"main": CameraPath.still(VIEW)}, "main",
                 bounds_of(meshes, instances))


def _hall_run(configuration: Configuration, triangles: int = 10_000, lights: int = 1) -> TimedRun:
    scene = hall(triangles, lights)
    return TimedRun(scene, scene.cameras[scene.default_camera].at(0.0), configuration)


def _sweep(quantity: str, points: Sequence[tuple[int, TimedRun]], rounds: int, provider: str,
           progress: Progress) -> Json:
    """Times of one sweep, and their fits."""
    counts, runs = [count for count, _ in points], [run for _, run in points]
    with InterleavedTimer(runs, provider) as timer:
        for number in range(rounds):
            progress(f"scaling with {quantity}, round {number + 1} of {rounds}")
            timer.run_round()
    stages = {}
    for name in runs[0].stages:
        ms = [run.stages[name].median for run in runs]
        exponent, error = (round(v, 3) for v in fit_power(counts, ms)) if max(ms) >= MIN_MS else (None, None)
        stages[name] = {"ms": [round(v, 4) for v in ms], "exponent": exponent, "error": error}
    stages[FRAME] = stages.pop(FRAME)
    return {"counts": counts, "stages": stages}


def _ground(cells: int) -> Mesh:
    """A height field of ``cells`` × ``cells`` squares."""
    at = np.linspace(-WIDTH / 2, WIDTH / 2, cells + 1)
    x, z = np.meshgrid(at, at, indexing="ij")
    height = 0.3 + 0.15 * np.sin(2 * x) * np.cos(3 * z)
    slope_x, slope_z = 0.3 * np.cos(2 * x) * np.cos(3 * z), -0.45 * np.sin(2 * x) * np.sin(3 * z)
    normals = np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return Mesh("ground", np.stack([x, height, z], -1).reshape(-1, 3).astype(np.float32),
                normals.reshape(-1, 3).astype(np.float32), faces.astype(np.uint32), 0)
