"""Times of frames, and of transfers between OpenGL and the CPU."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from time import perf_counter
from typing import Any

import moderngl
import numpy as np

from app.gl.context import Device
from app.load import embedded_scene, orbit
from app.network.selection import DEFAULT_MODEL, find_model
from app.renderer import Renderer
from app.settings import Settings

MILLI = 1e3
WARM_UP, MIN_FRAMES, MAX_FRAMES = 3, 5, 120
MAX_SECONDS = 4.0  # that the measured frames take
REPEATS = 9        # of a transfer


def measure_frames(size: tuple[int, int], provider: str) -> dict[str, Any]:
    """Times of the embedded box under an orbiting camera, with the default model, as ``Renderer.timing`` gives them."""
    scene = embedded_scene()
    cameras = orbit(scene, scene.cameras[scene.default_camera].at(0.0), MAX_FRAMES)
    with Renderer(scene, Settings(size, provider=provider, timing=True), find_model(DEFAULT_MODEL)) as renderer:
        for camera in cameras[:WARM_UP]:
            renderer.render(camera)
        renderer.reset_timing()
        start = perf_counter()
        for count, camera in enumerate(cameras[WARM_UP:]):
            if count >= MIN_FRAMES and perf_counter() - start > MAX_SECONDS:
                break
            renderer.render(camera)
        return {**renderer.timing(), "device": renderer.device}


def measure_transfers(size: tuple[int, int]) -> dict[str, float]:
    """Milliseconds to bring a picture of ``size`` to the CPU or from it, each with its format."""
    times = {}
    with closing(Device()) as device, device.ctx:
        for name, dtype in (("single precision", "f4"), ("8 bits", "f1")):
            texture = device.ctx.texture(size, 4, dtype=dtype)
            pixels = texture.read(alignment=1)
            times[f"read a picture in {name}"] = _median_ms(partial(texture.read, alignment=1))
            times[f"write a picture in {name}"] = _median_ms(partial(_write, device, texture, pixels))
            texture.release()
    return times


def _write(device: Device, texture: moderngl.Texture, pixels: bytes) -> None:
    texture.write(pixels, alignment=1)
    device.ctx.finish()


def _median_ms(run: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = perf_counter()
        run()
        times.append((perf_counter() - start) * MILLI)
    return float(np.median(times))
