"""The renderer: owns the context, the plan and its textures; turns cameras into named images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.frame import RADIANCE, build_frame
from app.gl.context import Device
from app.gl.frame_state import CameraBlock, FrameState
from app.gl.geometry import GpuScene
from app.gl.lights import LightSet
from app.gl.pool import Pool, Resources
from app.gl.timer import NEWEST, Timer
from app.graph import BoundPass, Buf, Tex
from app.math3d import View, halton
from app.network.contract import Model
from app.network.selection import load_models
from app.scene import Camera, Light, Scene
from app.settings import Settings

NEAR = 1e-4           # of the scene's longest edge
JITTER_PERIOD = 64    # frames after which the sub-pixel offsets repeat
GOLDEN = 0.61803398875
COMPONENTS = {"depth": 1, "motion": 2}
DTYPES: dict[str, type] = {"f1": np.uint8, "f2": np.float16, "f4": np.float32}

Image = NDArray[Any]
Execute = Callable[[FrameState, Resources], None]


class _GivenUpError(Exception):
    """The frame is no longer wanted."""


def _always() -> bool:
    return True


class Renderer:
    """Draws ``scene``; a context manager.

    Parameters
    ----------
    model : path, ``ssgi``, ``coarse``, a sequence of these, or None
        What makes the indirect light: a network's file, or the classical screen-space method; and what shades
        surfaces by the scene's environment: a network's file, or ``coarse``. None draws the scene's lights only.

    Attributes
    ----------
    plan : Plan
        The passes that run, and why others don't.
    device : dict of str to str
        ``gl_renderer``, ``gl_version`` and the execution ``provider`` that really run.

    Raises
    ------
    AfterglowError
        When the scene, the settings, the network and the device don't fit together.
    """

    def __init__(self, scene: Scene, settings: Settings, model: Model | Sequence[Model] | None = None) -> None:
        self.scene, self.settings = scene, settings
        chosen = () if model is None else (model,) if isinstance(model, str | Path) else model
        self._models = load_models(chosen, settings, scene.environment is not None)
        self._gl = Device(settings.strict_device)
        try:
            self._set_up()
        except BaseException:
            self._gl.close()
            raise
        self.device = {"gl_renderer": self._gl.renderer, "gl_version": self._gl.version,
                       "provider": self._models.provider}

    def _set_up(self) -> None:
        scene, settings = self.scene, self.settings
        self._geometry = GpuScene(self._gl, scene)
        self._lights = LightSet(self._gl, scene)
        self._camera = CameraBlock(self._gl)
        frame = build_frame(scene, settings, self._lights, self._models)
        self._sources = {o: frame.resource(o) for o in settings.outputs}
        self.missing = tuple(o for o, source in self._sources.items() if source is None)
        self.plan = frame.compile(settings.outputs)
        self._pool = Pool(self._gl, self.plan, settings.size)
        self._executors: list[tuple[BoundPass, Execute, Resources]] = [
            (b, b.spec.make(self._gl, b), Resources(self._pool, b)) for b in self.plan.passes if b.spec.make]
        self._timer = Timer(self._gl, settings.timing)
        self._yardstick = _Yardstick(self._gl, settings.size) if settings.timing else None
        self._non_finite: dict[str, int] = {b.name: 0 for b in self.plan.passes}
        self._overrides: dict[str, Image | float | Callable[[Image], Image]] = {}
        self._override_count = 0
        self._previous: View | None = None
        self._index = 0

    def render(self, camera: Camera, time: float = 0.0) -> dict[str, Image]:
        """Draw one frame and read back what the settings ask for.

        Parameters
        ----------
        time : float
            Seconds; places moving objects.

        Returns
        -------
        dict of str to ndarray
            Top row first. By output name float32 [H, W, C]; with ``final`` also ``display``, uint8 [H, W, 3].
            An output that the scene can't have (``emission`` without emitters) is zeros.
        """
        with self._gl.ctx:
            self._draw(camera, time, _always)
            if self._yardstick is not None:
                with self._timer.measure("copy"):
                    self._yardstick.run()
            images = {name: self.read(name) for name in self.settings.outputs}
            if "final" in images:
                images["display"] = self.read("display")[..., :3]
        return images

    def advance(self, camera: Camera, time: float = 0.0, wanted: Callable[[], bool] = _always) -> bool:
        """Draw one frame without reading it back, as temporal anti-aliasing needs to settle.

        Parameters
        ----------
        wanted : callable
            Asked before each pass, in time that is none of the frame's. Where it says no, the frame is given up, and
            all is as if it had never been begun.
            Only a frame like the one before, of the same camera, time and lights, can be given up so.

        Returns
        -------
        bool
            False where the frame was given up.
        """
        with self._gl.ctx:
            try:
                self._draw(camera, time, wanted)
            except _GivenUpError:
                return False
            self._gl.ctx.finish()
        return True

    def read(self, output: str) -> Image:
        """One of the settings' outputs of the newest frame, as ``render`` gives them; of ``display`` [H, W, 4]."""
        start = perf_counter()
        with self._gl.ctx:
            image = self._pixels(output, newest=True) if output == "display" else self._read(output)
        for name in ("tonemap", "frame"):
            self._timer.extend(name, (perf_counter() - start) * 1e3)
        return image

    def expose(self, exposure: float) -> None:
        """Another linear factor before the tone map, from the next frame on."""
        self.settings = replace(self.settings, exposure=exposure)

    def relight(self, lights: tuple[Light, ...]) -> bool:
        """Other lights from the next frame on; False, with nothing changed, where they need other shaders or maps."""
        scene = self.scene.with_lights(*lights)
        if not self._lights.take(scene):
            return False
        self.scene = scene
        return True

    def cut(self) -> None:
        """Forget all history: the next frame is a first frame."""
        self._previous, self._index = None, 0

    def override(self, resource: str, value: Image | float | Callable[[Image], Image] | None) -> None:
        """Replace what a pass writes, after it ran, in every frame from now on; None undoes it.

        Parameters
        ----------
        value : ndarray, float or callable
            A constant for all texels and components, an image [H, W, C] with its top row first, or what makes
            such an image from the one that the pass wrote. Tensors are [C, h, w] or [C, 6, n, n].
        """
        if value is not None:
            self._overrides[resource] = value
        else:
            self._overrides.pop(resource, None)
        self._override_count += 1

    def resource(self, name: str) -> Image:
        """What a pass wrote in the newest frame, as it lies on the GPU: float32, top row first."""
        with self._gl.ctx:
            return self._pixels(name, newest=True)

    def timing(self, newest: int = NEWEST) -> dict[str, Any]:
        """``{"frame": …, "passes": {name: {"cpu_ms", "gpu_ms", "non_finite"}}}``; see ``Timer``.

        Only the ``newest`` so many frames count.
        ``copy`` among the passes is the yardstick, run after each frame that is read back; it is no part of the frame.
        """
        passes: dict[str, Any] = self._timer.report(newest)
        frame = passes.pop("frame", {"cpu_ms": {}, "gpu_ms": {}})
        for name, count in self._non_finite.items():
            if name in passes:
                passes[name]["non_finite"] = count
        return {"frame": frame, "passes": passes}

    def reset_timing(self) -> None:
        """Forget all times and counts so far."""
        self._timer.clear()
        self._non_finite = dict.fromkeys(self._non_finite, 0)

    def close(self) -> None:
        """Give everything back; the renderer can't be used afterwards."""
        with self._gl.ctx:
            self._pool.release()
            self._geometry.release()
            self._lights.buffer.release()
            self._camera.buffer.release()
        self._gl.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def _draw(self, camera: Camera, time: float, wanted: Callable[[], bool]) -> None:
        cut = self._previous is None
        self._override_count += any(callable(value) for value in self._overrides.values())  # wants what a pass wrote
        view = View.of(camera, self.settings.size, NEAR * self.scene.longest_edge)
        self._geometry.update(time, cut)
        self._lights.cover(self._geometry.boxes)
        gathered = any(b.name == "taa" for b in self.plan.passes)
        jitter = self._jitter() if gathered else (0.0, 0.0)
        frame = FrameState(self.settings.size, view, self._previous or view, jitter, not cut, gathered,
                           (self.settings.seed * GOLDEN) % 1.0, self._index, self.settings.exposure, self._geometry,
                           self._lights, self._override_count)
        self._lights.upload(view.eye)
        self._camera.upload(frame)
        asking = 0.0  # seconds
        with self._timer.frame():
            for bound, execute, resources in self._executors:
                start = perf_counter()
                if not wanted():
                    raise _GivenUpError
                asking += perf_counter() - start
                with self._timer.measure(bound.name):
                    execute(frame, resources)
                self._apply_overrides(bound)
                if self.settings.check:
                    self._non_finite[bound.name] += sum(self._count_non_finite(w) for w in bound.writes)
        self._timer.extend("frame", -asking * 1e3)
        # Only now does anything of this frame become the next one's past, so that until here it can be given up.
        self._previous = view
        self._pool.swap()
        self._index += 1

    def _jitter(self) -> tuple[float, float]:
        """Halton offsets in clip units, centred on the pixel."""
        i = (self._index + self.settings.seed) % JITTER_PERIOD + 1
        w, h = self.settings.size
        return (2 * halton(i, 2) - 1) / w, (2 * halton(i, 3) - 1) / h

    def _read(self, name: str) -> Image:
        w, h = self.settings.size
        channels = COMPONENTS.get(name, 3)
        source = self._sources[name]
        if source is None:
            return np.zeros((h, w, channels), np.float32)
        image = self._pixels(source, newest=True)
        if name == "position":
            assert self._previous is not None, "no frame was drawn"
            seen, eye = image[..., 3:] > 0, self._previous.eye.astype(np.float32)
            return np.where(seen, image[..., :3] + eye, np.float32(0))
        if name in RADIANCE and self._lights.scale != 1:
            image = image * np.float32(1 / self._lights.scale)  # whole rows, before channels are left out: faster
        return image[..., :channels]

    def _pixels(self, name: str, newest: bool = False) -> Image:
        resource = self.plan.resources[name]
        if isinstance(resource, Buf):
            return np.frombuffer(self._pool.buffer(name).read(), np.float32).reshape(resource.shape)
        newest_copy = newest and name in self.plan.history
        texture = self._pool.texture(name + "@prev" if newest_copy else name)
        kind = DTYPES[resource.dtype]
        image: Image = np.frombuffer(texture.read(alignment=1), kind).reshape(texture.height, texture.width, -1)[::-1]
        return image.astype(np.float32) if kind is np.float16 else image

    def _apply_overrides(self, bound: BoundPass) -> None:
        for name in set(bound.writes) & set(self._overrides):
            resource, value = self.plan.resources[name], self._overrides[name]
            value = np.asarray(value(self._pixels(name)) if callable(value) else value, np.float32)
            if isinstance(resource, Buf):
                self._pool.buffer(name).write(np.broadcast_to(value, resource.shape).astype(np.float32).tobytes())
                continue
            texture = self._pool.texture(name)
            kind = DTYPES[resource.dtype]
            shape = (texture.height, texture.width, texture.components)
            with np.errstate(invalid="ignore", over="ignore"):
                texture.write(np.broadcast_to(value, shape)[::-1].astype(kind).tobytes(), alignment=1)

    def _count_non_finite(self, name: str) -> int:
        resource = self.plan.resources[name]
        if isinstance(resource, Tex) and resource.dtype == "f1":
            return 0
        components = 0 if isinstance(resource, Buf) else -1
        return int(np.count_nonzero(~np.isfinite(self._pixels(name)).all(axis=components)))


class _Yardstick:
    """A full-screen RGBA16F copy, timed beside the passes."""

    def __init__(self, device: Device, size: tuple[int, int]) -> None:
        self._device = device
        self._source = device.ctx.texture(size, 4, dtype="f2")
        self._target = device.ctx.framebuffer([device.ctx.texture(size, 4, dtype="f2")])
        self._program = device.fullscreen("copy.frag")

    def run(self) -> None:
        self._target.use()
        self._source.use(0)
        self._program.set(source=0)
        self._device.draw_fullscreen(self._program)
