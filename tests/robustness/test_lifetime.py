"""Staying alive: renderers, frames, sizes and models come and go, and memory and GL objects stay as they are.

The default run is short; ``-m long`` takes the thousand renderers, ten thousand frames and hundred swaps.
"""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from app.golden.scenes import outdoor, room
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from tests.gl.scenes import box, slide
from tests.override import override
from tests.robustness.gl_objects import live_objects
from tests.robustness.scenes import CAMERA, lit_corner

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (16, 12)
OUTPUTS = ("final", "position", "motion")
KEPT_BY_MODERNGL = 40.0  # kB a context: moderngl 5.13 never gives back the addresses and names that it looked up
LONG = pytest.mark.long


def growth(step: Callable[[int], None], count: int, samples: int = 20) -> float:
    """Kilobytes of resident memory gained per call of ``step``: the median slope (Theil and Sen), after a tenth."""
    process = psutil.Process()
    for i in range(count // 10):
        step(i)
    at, memory = [], []
    for i in range(count):
        if i % max(1, count // samples) == 0:
            gc.collect()
            _trim()
            at.append(i)
            memory.append(process.memory_info().rss / 1024)
        step(i)
    slopes = [(memory[j] - memory[i]) / (at[j] - at[i]) for i in range(len(at)) for j in range(i + 1, len(at))]
    print(f"GROWTH {np.median(slopes):+.2f} kB a step over {count}, from {memory[0] / 1024:.0f} "
          f"to {memory[-1] / 1024:.0f} MB")
    return float(np.median(slopes))


def _trim() -> None:
    """Hand freed memory back to the system, where the C library can, so that only what is kept counts."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def handles() -> tuple[int, int]:
    """Open files and threads, once what other tests dropped is gone."""
    gc.collect()
    process = psutil.Process()
    return process.num_fds(), process.num_threads()


def default_camera(scene: Scene) -> Camera:
    return scene.cameras[scene.default_camera].at(0.0)


@pytest.fixture(scope="module")
def scenes_and_models(small_ember: Path) -> list[tuple[Scene, Path | None]]:
    return [(room(), small_ember), (lit_corner(), None), (outdoor(), find_model("gather"))]


@pytest.mark.parametrize(("count", "most"), [(10, 800.0), pytest.param(1000, 24.0 + KEPT_BY_MODERNGL, marks=LONG)])
def test_renderers_made_and_dropped(scenes_and_models: list[tuple[Scene, Path | None]], count: int,
                                    most: float) -> None:
    def one(i: int) -> None:
        scene, model = scenes_and_models[i % 3]
        settings = Settings(size=SIZE, outputs=OUTPUTS, timing=i % 2 == 0, provider="cpu")
        with Renderer(scene, settings, model) as renderer:
            renderer.render(default_camera(scene))

    for i in range(18):  # six of each: until the C library's pools of memory are as large as they get
        one(i)
    before = handles()
    assert growth(one, count) < most
    assert handles() == before


@pytest.mark.parametrize(("count", "most"), [(10, 800.0), pytest.param(1000, 24.0 + KEPT_BY_MODERNGL, marks=LONG)])
def test_renderers_that_nobody_closes(count: int, most: float) -> None:
    """Dropped without ``close``, as in a notebook: the context goes with the last reference."""
    def one(i: int) -> None:
        Renderer(lit_corner(), Settings(size=SIZE)).render(CAMERA)

    one(0)
    before = handles()
    assert growth(one, count) < most
    assert handles() == before


@pytest.fixture(params=[False, pytest.param(True, marks=pytest.mark.long)], ids=["untimed", "timed"])
def renderer(request: pytest.FixtureRequest) -> Iterator[Renderer]:
    settings = Settings(size=SIZE, outputs=OUTPUTS, timing=request.param, check=request.param, provider="cpu")
    mover = box((0.5, 0.0, 0.3), (0.2, 0.2, 0.2), motion=slide([0, 9], [(0, 0, 0), (0.5, 0, 0)]))
    with Renderer(lit_corner(more=(mover,)), settings, find_model("radiosity")) as renderer:
        yield renderer


@pytest.mark.parametrize(("count", "most"), [(60, 100.0), pytest.param(10_000, 0.5, marks=LONG)])
def test_frames(renderer: Renderer, count: int, most: float) -> None:
    """The camera moves, an object now and then; there are cuts, and somebody replaces what a pass wrote."""

    def one(i: int) -> None:
        if i % 50 == 20:
            renderer.cut()
        override(renderer, "direct", 0.5 if i % 50 == 30 else None)
        eye = (CAMERA.eye[0] + 0.01 * (i % 7), *CAMERA.eye[1:])
        renderer.render(replace(CAMERA, eye=eye), time=i // 20 % 9)

    for i in range(60):  # until every framebuffer of either parity has been made
        one(i)
    before, at_first = handles(), live_objects(renderer._gl)
    assert growth(one, count) < most
    assert live_objects(renderer._gl) == at_first
    assert handles() == before


@pytest.mark.parametrize(("count", "most"), [(6, 3000.0), pytest.param(100, 200.0, marks=LONG)])
def test_other_sizes_and_models(small_ember: Path, count: int, most: float) -> None:
    """Each is a renderer of its own, beside one that lives on and draws the same picture to the bit all the while."""
    scene = lit_corner()
    models = (None, find_model("gather"), small_ember)
    with Renderer(scene, Settings(size=SIZE, taa=False, provider="cpu"), models[2]) as resident:
        resident.advance(CAMERA)
        first, at_first = resident.render(CAMERA)["final"], live_objects(resident._gl)

        def one(i: int) -> None:
            size = (16 + 37 * i % 113, 12 + 23 * i % 71)
            with Renderer(scene, Settings(size=size, provider="cpu"), models[i % 3]) as other:
                assert other.render(CAMERA)["final"].shape == (size[1], size[0], 3)
            np.testing.assert_array_equal(resident.render(CAMERA)["final"], first)

        one(0)
        before = handles()
        assert growth(one, count) < most
        assert live_objects(resident._gl) == at_first
        assert handles() == before


def test_other_projections() -> None:
    """Another kind of projection makes all passes anew, and what the earlier ones held is released."""
    scene = room()
    camera = default_camera(scene)
    counts = []
    with Renderer(scene, Settings(size=SIZE, provider="cpu"), find_model("radiosity")) as renderer:
        for _ in range(3):
            for seen in (camera, replace(camera, orthographic_height=3.0)):
                renderer.render(seen)
                renderer.render(seen)
            counts.append(live_objects(renderer._gl))
    assert counts[0] == counts[1] == counts[2]


def test_the_counts_see_a_leak(renderer: Renderer) -> None:
    """One object of each kind, not given back, and the counts differ by one; memory that is kept shows as growth."""
    device = renderer._gl
    renderer.render(CAMERA)
    before = live_objects(device)
    with device.ctx:
        kept = [device.ctx.texture((4, 4), 4), device.ctx.buffer(reserve=16), device.ctx.query(time=True)]
        with kept[2]:
            pass
        kept += [device.ctx.framebuffer([kept[0]]), device.ctx.sampler()]
    after = live_objects(device)
    assert {k: after[k] - before[k] for k in after if after[k] != before[k]} == dict.fromkeys(
        ("Texture", "Buffer", "Query", "Framebuffer", "Sampler"), 1)
    hoard: list[np.ndarray] = []
    assert growth(lambda i: hoard.append(np.ones(64 * 1024 // 8)), 200) == pytest.approx(64, rel=0.3)
