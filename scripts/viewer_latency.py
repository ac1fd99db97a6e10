"""Print how long the viewer takes from an input to its picture, and what serving adds to the time of a frame.

``python scripts/viewer_latency.py [SIZE] [MODEL]…`` starts the renderer, then the viewer, with the same moving camera;
the client decodes each picture, as a page does. A frame's time is that between two frames: of the renderer without the
yardstick that it times beside them, of the viewer in the midst of a drag.
"""

from __future__ import annotations

import asyncio
import io
import json
import random
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, astuple, dataclass
from itertools import cycle, pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from app.bench.configurations import expand
from app.bench.measure import swayed
from app.extras import extra_module
from app.load import embedded_scene
from app.renderer import Renderer
from app.scene import Camera
from app.settings import Settings, parse_size
from app.view.desk import QUIET
from app.view.encoder import unpacked

FRAMES, WARM_UP = 24, 4
INPUTS = 60  # a second, in a drag
TURNS = 2   # of headless and served, one after the other


def cameras() -> list[Camera]:
    scene = embedded_scene()
    camera = scene.cameras[scene.default_camera].at(0.0)
    return [swayed(camera, scene, index) for index in range(FRAMES + WARM_UP)]


def headless(size: tuple[int, int], model: str) -> float:
    """Median milliseconds from one frame to the next."""
    scene, models = embedded_scene(), expand((model,), (size,))[0][0].models
    with Renderer(scene, Settings(size, timing=True), models) as renderer:
        ends = []
        for camera in cameras():
            renderer.render(camera)
            ends.append(perf_counter())
        yardstick = renderer.timing()["passes"]["copy"]["cpu_ms"]["median"]
    return float(np.median(np.diff(ends[WARM_UP:]))) * 1e3 - float(yardstick)


@contextmanager
def viewer(size: tuple[int, int], model: str) -> Iterator[str]:
    """Its socket's address."""
    command = [sys.executable, "-m", "app", "view", "--size", f"{size[0]}x{size[1]}", "--model", model]
    process = subprocess.Popen(command, text=True, stdout=subprocess.PIPE)
    assert process.stdout is not None
    yield process.stdout.readline().split()[-1].replace("http", "ws") + "live"
    process.terminate()
    process.wait()


@dataclass
class Times:
    """Milliseconds: of inputs at rest, while still frames are drawn, and in a drag; between the frames of the drag."""

    at_rest: list[float]
    refining: list[float]
    dragged: list[float]
    gaps: list[float]


class Page:
    """Sends cameras, takes pictures; ``frames``: when they were decoded, and up to which input they show."""

    def __init__(self, socket: Any) -> None:
        self._socket, self.next = socket, 1
        self.frames: list[tuple[float, int]] = []

    async def send(self, camera: Camera, number: int) -> None:
        await self._socket.send_str(json.dumps({"type": "camera", "camera": asdict(camera), "input": number}))

    async def picture(self) -> int:
        """Take the next picture; the input that it shows."""
        while True:
            message = await self._socket.receive()
            if isinstance(message.data, bytes):
                await self._socket.send_str('{"type": "ack"}')
                header, parts = unpacked(message.data)
                Image.open(io.BytesIO(parts[0])).load()
                self.frames.append((perf_counter(), header["input"]))
                return int(header["input"])


async def answered(page: Page, frame: float, refining: bool) -> list[float]:
    """Milliseconds from each input to its picture; ``refining``: while frames of an unchanged picture are drawn."""
    found, chance = [], random.Random(0)
    for number, camera in enumerate(cameras(), page.next):
        if refining:
            end = perf_counter() + QUIET + (1 + chance.random()) * frame / 1e3
            while perf_counter() < end:
                with suppress(TimeoutError):
                    await asyncio.wait_for(page.picture(), max(end - perf_counter(), 0))
        begin = perf_counter()
        await page.send(camera, number)
        while await page.picture() < number:
            pass
        found.append((perf_counter() - begin) * 1e3)
        page.next = number + 1
    return found[WARM_UP:]


async def dragged(page: Page) -> tuple[list[float], list[float]]:
    """Milliseconds from each input of a drag to the first picture that shows it, and from one picture to the next."""
    sent: dict[int, float] = {}

    async def send() -> None:
        for number, camera in enumerate(cycle(cameras()), page.next):
            page.next, sent[number] = number + 1, perf_counter()
            await page.send(camera, number)
            await asyncio.sleep(1 / INPUTS)

    first = page.next
    sending = asyncio.create_task(send())
    while await page.picture() < first:
        pass
    page.frames.clear()
    for _ in range(FRAMES):
        await page.picture()
    sending.cancel()
    found = [(time - sent[number]) * 1e3 for (_, shown), (time, newest) in pairwise(page.frames)
             for number in range(shown + 1, newest + 1)]
    return found, (np.diff([time for time, _ in page.frames]) * 1e3).tolist()


async def served(address: str, frame: float) -> Times:
    aiohttp = extra_module("aiohttp", "view")
    async with aiohttp.ClientSession() as session, session.ws_connect(address, max_msg_size=2**26) as socket:
        page = Page(socket)
        await page.picture()
        await answered(page, frame, refining=False)  # surfels, shaders, caches
        at_rest = await answered(page, frame, refining=False)
        return Times(at_rest, await answered(page, frame, refining=True), *await dragged(page))


def main() -> None:
    arguments = sys.argv[1:] or ["640x480"]
    size = parse_size(arguments[0])
    for model in arguments[1:] or ["none", "ember"]:
        alone, times = [], Times([], [], [], [])
        for _ in range(TURNS):
            alone.append(headless(size, model))
            with viewer(size, model) as address:
                found = asyncio.run(served(address, alone[-1]))
            times = Times(*(a + b for a, b in zip(astuple(times), astuple(found), strict=True)))
        frame, gap = float(np.median(alone)), float(np.median(times.gaps))
        print(f"{arguments[0]} {model}: headless {frame:.1f} ms a frame, served {gap:.1f} ms ({gap / frame - 1:+.1%})")
        for name, values in (("at rest", times.at_rest), ("while still frames are drawn", times.refining),
                             ("in a drag", times.dragged)):
            median, most = np.percentile(values, (50, 95))
            print(f"  input to picture {name}: median {median:.1f} ms (a frame + {median - frame:.1f}), "
                  f"95 % within {most:.1f} ms (a frame + {most - frame:.1f})")


if __name__ == "__main__":
    main()
