"""Measure what a frame costs on the CPU besides drawing: processor time, which other programs do not change much.

``surfels`` is placing them for the first frame, ``move`` is tracing what changes when one instance moves, and ``frame``
is the main thread's part of a frame under an orbiting camera, without the network, while Mesa's driver draws nothing.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time, thread_time
from typing import Any

os.environ.setdefault("GALLIUM_NOOP", "1")  # before OpenGL is loaded
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # app, which need not be installed

import numpy as np

from app.exchange.copy import CopyExchange
from app.load import load_scene, orbit
from app.math3d import View, translation
from app.network.selection import find_models
from app.network.session import Network
from app.raycast.caster import Caster
from app.renderer import Renderer
from app.scene import Motion, Scene
from app.settings import Settings
from app.surfels.world import WorldSurfels

SIZE, SURFELS, RAYS = (1024, 768), 2048, 144
ROUNDS, WARM_UP, FRAMES = 5, 8, 24


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--instance", type=int, default=0, help="number of the instance that moves")
    parser.add_argument("--model", default="ember")
    arguments = parser.parse_args()
    scene = load_scene(arguments.scene)
    _print("surfels", measure_surfels(scene))
    _print("move", measure_move(scene, arguments.instance))
    with np.errstate(all="ignore"):  # what isn't drawn may hold any numbers
        _print("frame", measure_frame(scene, arguments.model))


def measure_surfels(scene: Scene) -> list[float]:
    """Milliseconds of placing surfels; the first round also blurs the textures."""
    caster = Caster(scene)
    return [_time(lambda: _place(scene, caster), process_time) for _ in range(ROUNDS)]


def measure_move(scene: Scene, instance: int) -> list[float]:
    """Milliseconds of following an instance that slides by a hundredth of the scene."""
    offset = translation(np.array([0.0, 0.0, 0.01 * scene.longest_edge]))
    motion = Motion(np.array([0.0, 1.0]), np.stack([np.eye(4), offset]))
    moving = replace(scene, instances=tuple(replace(each, motion=motion) if number == instance else each
                                            for number, each in enumerate(scene.instances)))
    world = _place(moving, Caster(moving))
    return [_time(partial(world.move_to, time), process_time) for time in np.linspace(0.1, 1.0, 2 * ROUNDS).tolist()]


def measure_frame(scene: Scene, model: str) -> list[float]:
    """Milliseconds of the main thread for a frame that is not read back."""
    cameras = orbit(scene, scene.cameras[scene.default_camera].at(0.0), 720)
    inferring, run = [0.0], Network.run

    def timed_run(network: Network, *args: Any) -> Any:
        begin = thread_time()
        outputs = run(network, *args)
        inferring[0] += (thread_time() - begin) * 1e3
        return outputs

    Network.run = timed_run  # type: ignore[assignment, method-assign]
    with Renderer(scene, Settings(size=SIZE, provider="cpu"), find_models(model), CopyExchange) as renderer:
        for camera in cameras[:WARM_UP]:
            renderer.advance(camera)
        times = []
        for start in range(WARM_UP, WARM_UP + ROUNDS * FRAMES, FRAMES):
            inferring[0], drawn = 0.0, cameras[start:start + FRAMES]
            spent = sum(_time(partial(renderer.advance, camera), thread_time) for camera in drawn)
            times.append((spent - inferring[0]) / FRAMES)
    return times


def _place(scene: Scene, caster: Caster) -> WorldSurfels:
    camera = scene.cameras[scene.default_camera].at(0.0)
    view = View.of(camera, SIZE, 1e-4 * scene.longest_edge, 2 * scene.longest_edge)
    return WorldSurfels(scene, caster, [view], SURFELS, RAYS)


def _time(work: Callable[[], object], clock: Callable[[], float]) -> float:
    begin = clock()
    work()
    return (clock() - begin) * 1e3


def _print(name: str, times: list[float]) -> None:
    print(f"{name}: median {np.median(times):.2f} ms, {min(times):.2f} to {max(times):.2f}", flush=True)


if __name__ == "__main__":
    main()
