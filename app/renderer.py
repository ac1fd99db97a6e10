"""The renderer: owns the context, the plan and its textures; turns cameras into named images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from app.exchange.selection import Exchanges, OpenExchange, open_exchange
from app.frame import RADIANCE, REFLECTION_SURFELS, FrameInputs, build_frame
from app.gl.context import Device
from app.gl.frame_state import REFRESH_FRAMES, CameraBlock, Execute, FrameState
from app.gl.geometry import GpuScene
from app.gl.lights import LightSet
from app.gl.pool import Pixels, Pool, Resources
from app.gl.timer import MAX_FRAMES, Timer, Yardstick
from app.graph import BoundPass, Plan
from app.io.color_management import display_view, find_view
from app.math3d import GOLDEN_RATIO, View, halton
from app.network.selection import Model, Models, by_role, load_models, needs_surfels
from app.radiance_scale import radiance_scale
from app.raycast.caster import Caster
from app.raycast.gpu_rays import choose_rays
from app.raycast.light_extent import needs_rays
from app.raycast.near_distance import NearDistance
from app.scene import Camera, Light, Scene
from app.settings import TONE_MAPS, Settings
from app.surfels.tracked import TrackedSurfels

NEAR = 1e-4           # of the scene's longest edge
JITTER_PERIOD = 64    # frames after which the sub-pixel offsets repeat, at full size; more for smaller ones
COMPONENTS = {"depth": 1, "motion": 2, "instance": 1, "material": 1, "flow": 2}

AfterPass = Callable[[BoundPass, Pool], None]


class _AbandonedError(Exception):
    """The frame is no longer wanted."""


class _Pipeline:
    """The passes of frames at one render scale, and the textures that they write."""

    def __init__(self, device: Device, inputs: FrameInputs) -> None:
        outputs = inputs.settings.outputs
        frame = build_frame(inputs)
        self._device = device
        self.sources = {o: frame.resource(o) for o in outputs}
        self.plan = frame.compile(outputs)
        self.pool = Pool(device, self.plan, inputs.settings.render_size)
        self.make_passes()

    def make_passes(self) -> None:
        self.executors: list[tuple[BoundPass, Execute, Resources]] = [
            (b, b.spec.make(self._device, b), Resources(self.pool, b)) for b in self.plan.passes if b.spec.make]


def always() -> bool:
    return True


class Renderer:
    """Draws ``scene``; a context manager.

    Parameters
    ----------
    model : path, ``ssgi``, ``unshadowed_environment``, a sequence of these, or None
        What makes the indirect light: a network's file, or the classical screen-space method; and what shades
        surfaces by the scene's environment: a network's file, or ``unshadowed_environment``. None draws only the
        scene's lights.
    open_exchange : callable
        Chooses how a network's tensors get to onnxruntime and back.

    Attributes
    ----------
    missing : tuple of str
        Outputs that are zeros, since the scene can't have them.
    device : dict of str to str
        ``gl_renderer``, ``gl_version`` and the execution ``provider`` that really run, and the ``exchange``, the way
        of tensors between these: ``cuda``, ``mapped``, ``copy`` or ``none``.
    after_pass : list of callable
        Called after each pass with the pass and the pool of resources, in which they may read and write.

    Raises
    ------
    AfterglowError
        When the scene, the settings, the network and the device don't fit together.
    """

    def __init__(self, scene: Scene, settings: Settings, model: Model | Sequence[Model] | None = None,
                 open_exchange: OpenExchange = open_exchange) -> None:
        self.scene, self.settings = scene, settings
        chosen = () if model is None else (model,) if isinstance(model, str | Path) else tuple(model)
        by_role(chosen)  # raises errors before anything is set up
        needs_caster = any(map(needs_surfels, chosen)) and not RADIANCE.isdisjoint(settings.outputs)
        self._ocio_view = None if settings.tonemap in TONE_MAPS else find_view(settings.tonemap)
        self._exchanges = Exchanges(open_exchange)
        with ThreadPoolExecutor(1) as background:  # onnxruntime prepares networks while the scene is
            models = background.submit(load_models, chosen, settings, scene.environment is not None)
            self._gl = Device(settings.strict_device)
            try:
                self._set_up(models, needs_caster)
            except BaseException:
                with self._gl.ctx:
                    self._exchanges.release()
                self._gl.close()
                raise
        self.device = {"gl_renderer": self._gl.renderer, "gl_version": self._gl.version,
                       "provider": self._models.provider, "exchange": self._exchanges.names, "rays": self._traced_by}

    def _set_up(self, models: Future[Models], needs_caster: bool) -> None:
        settings = self.settings
        self._radiance_scale = radiance_scale(self.scene)
        scene = self.scene.with_radiance_scale(self._radiance_scale)
        self._caster: Caster | None = None
        self._scaled = scene
        self._geometry = GpuScene(self._gl, scene)
        self._traced = self._needs_rays(scene)
        if needs_caster:
            self._get_caster()
        self._models = models.result()
        self._lights = LightSet(self._gl, scene, self._traced, NearDistance(self._get_caster))
        self._camera = CameraBlock(self._gl)
        surfels = TrackedSurfels(scene, self._get_caster, *(self._models.surfels_read or REFLECTION_SURFELS))
        self._inputs = FrameInputs(scene, settings, self._lights, self._get_caster, self._models, surfels,
                                   self._exchanges)
        self._pipeline = _Pipeline(self._gl, self._inputs)
        self._pipelines = {settings.render_scale: self._pipeline}
        self.missing = tuple(o for o, source in self._pipeline.sources.items() if source is None)
        self._accumulates = "taa" in self.plan.resources
        self._timer = Timer(self._gl, settings.timing)
        self._yardstick = Yardstick(self._gl, settings.size) if settings.timing else None
        self._non_finite: Counter[str] = Counter()
        self.after_pass: list[AfterPass] = [self._count_non_finite] if settings.check else []
        self._previous: View | None = None
        self._index = 0
        self._lighting: tuple[object, ...] = ()
        self._unchanged = self._still = 0  # frames
        self._viewpoints: tuple[View, ...] = ()

    @property
    def plan(self) -> Plan:
        """The passes that run, and why others don't."""
        return self._pipeline.plan

    @property
    def _pool(self) -> Pool:
        return self._pipeline.pool

    def render(self, camera: Camera, time: float = 0.0, following: tuple[Camera, float] | None = None,
               names: Sequence[str] = ()) -> dict[str, Pixels]:
        """Draw one frame and read back outputs of the settings.

        Parameters
        ----------
        time : float
            Seconds; places moving objects.
        following : tuple of Camera and float, optional
            Camera and time of the next frame, for ``flow``; default is that nothing moves.
        names : sequence of str, optional
            What to read: outputs and, with ``final`` among these, ``display``; default all.

        Returns
        -------
        dict of str to ndarray
            Top row first. By output name float32 [H, W, C]; ``display`` is uint8 [H, W, 3].
            An output that the scene can't have (``emission`` without emitters) is zeros.
        """
        with self._gl.ctx:
            self._draw(camera, time, always, following)
            if self._yardstick is not None:
                with self._timer.measure("copy"):
                    self._yardstick.run()
            outputs = self.settings.outputs
            names = names or (*outputs, *(["display"] if "final" in outputs else []))
            images = {name: self.read(name) for name in names if name != "display"}
            if "display" in names:
                images["display"] = self._display(images.get("final"))
        return images

    def advance(self, camera: Camera, time: float = 0.0, wanted: Callable[[], bool] = always,
                following: tuple[Camera, float] | None = None) -> bool:
        """Draw one frame without reading it back, as temporal anti-aliasing needs to settle.

        Parameters
        ----------
        wanted : callable
            Asked before each pass, in time that does not count as the frame's. When it returns False, the frame is
            abandoned and leaves no trace. Only a frame with the camera, time and lights of the one before can be
            abandoned.
        following
            As for ``render``.

        Returns
        -------
        bool
            False when the frame was abandoned.
        """
        with self._gl.ctx:
            try:
                self._draw(camera, time, wanted, following)
            except _AbandonedError:
                return False
            self._gl.ctx.finish()
        return True

    def read(self, output: str) -> Pixels:
        """An output of the settings in the newest frame, as ``render`` gives it; ``display`` may be [H, W, 4]."""
        start = perf_counter()
        with self._gl.ctx:
            if output != "display":
                image = self._read(output)
            elif self._ocio_view is None:
                image = self._pool.read(output, newest=True)
            else:
                image = self._display()
        for name in ("tonemap", "frame"):
            self._timer.extend(name, (perf_counter() - start) * 1e3)
        return image

    def set_exposure(self, exposure: float) -> None:
        """Use another linear factor before the tone map, from the next frame on."""
        self.settings = replace(self.settings, exposure=exposure)

    def set_render_scale(self, scale: float) -> None:
        """Draw frames at another size from the next one on; what was accumulated stays, and times begin anew.

        What the passes of a size have made is kept for when it returns.
        """
        if scale == self.settings.render_scale:
            return
        self.settings = replace(self.settings, render_scale=scale)
        self.reset_timing()
        with self._gl.ctx:
            before = self._pool
            if scale not in self._pipelines:
                self._pipelines[scale] = _Pipeline(self._gl, replace(self._inputs, settings=self.settings))
            self._pipeline = self._pipelines[scale]
            self._pool.take_history(before)

    def relight(self, lights: tuple[Light, ...]) -> bool:
        """Use other lights from the next frame on; False, and no change, when they need other shaders or maps."""
        scene = self.scene.with_lights(*lights)
        if radiance_scale(scene) != self._radiance_scale:
            return False
        scaled = scene.with_radiance_scale(self._radiance_scale)
        # Edited lights keep their way of shadowing: looking for it takes long, and another one needs other shaders.
        same_kinds = [type(light) for light in lights] == [type(light) for light in self.scene.lights]
        with self._gl.ctx:  # which the first caster and the points of approximate lights need
            traced = self._traced if same_kinds else self._needs_rays(scaled)
            if not self._lights.replace(scaled, traced):
                return False
        self.scene, self._traced = scene, traced
        return True

    @property
    def shadow_methods(self) -> dict[str, int]:
        """Number of lights for each type of light and way of shadowing it."""
        names = [f"{type(light).__name__} {method}" for method, lights in (
            ("by shadow map", self._lights.mapped), ("by rays", self._lights.lights[len(self._lights.mapped):]))
            for light in lights]
        if any(b.name == "sky_light" for b in self.plan.passes):
            names.append("environment by rays")
        return dict(Counter(names))

    @property
    def surfels(self) -> TrackedSurfels:
        """World surfels as of the newest frame, if its passes read any."""
        return self._inputs.surfels

    def cut(self) -> None:
        """Forget all history: the next frame is a first frame."""
        self._previous, self._index = None, 0

    def place_surfels(self, cameras: Sequence[Camera]) -> None:
        """Choose world surfels for all of ``cameras`` together from the next frame on.

        They then depend on nothing that was drawn before. Without cameras, surfels follow the camera.
        """
        views = tuple(self._view(camera) for camera in cameras)
        is_same = len(views) == len(self._viewpoints) and all(map(View.same_as, views, self._viewpoints))
        self._viewpoints = self._viewpoints if is_same else views

    def resource(self, name: str) -> Pixels:
        """What a pass wrote in the newest frame, as it lies on the GPU: float32, top row first."""
        with self._gl.ctx:
            return self._pool.read(name, newest=True)

    def timing(self, newest: int = MAX_FRAMES) -> dict[str, Any]:
        """``{"frame": …, "passes": {name: {"cpu_ms", "gpu_ms", "non_finite"}}}`` over the ``newest`` frames.

        ``copy`` among the passes is the yardstick, run after each frame that is read back; it is no part of the frame.
        """
        passes: dict[str, Any] = self._timer.report(newest)
        frame = passes.pop("frame", {"cpu_ms": {}, "gpu_ms": {}})
        for name in {b.name for b in self.plan.passes} & set(passes):
            passes[name]["non_finite"] = self._non_finite[name]
        return {"frame": frame, "passes": passes}

    def reset_timing(self) -> None:
        """Forget all times and counts so far."""
        self._timer.clear()
        self._non_finite.clear()

    def close(self) -> None:
        """Release everything; the renderer can't be used afterwards."""
        with self._gl.ctx:
            for pipeline in self._pipelines.values():
                pipeline.pool.release()
            self._exchanges.release()
            self._geometry.release()
            self._lights.release()
            self._camera.buffer.release()
        self._gl.close()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _draw(self, camera: Camera, time: float, wanted: Callable[[], bool],
              following: tuple[Camera, float] | None = None) -> None:
        settings = self.settings
        self._adapt_to_projection(camera.orthographic_height is not None)
        cut = self._previous is None
        self._geometry.update(time, cut)
        if self._caster is not None:
            self._caster.move_to(time)
        self._lights.cover(self._geometry.boxes)
        view = self._view(camera)
        if self._lights.follow(view.eye):
            self._make_pipeline_again()
        lighting = self._lights.lights, self._geometry.changes
        unchanged = REFRESH_FRAMES if cut else self._unchanged + 1 if lighting == self._lighting else 0
        stands = self._previous is not None and view.same_as(self._previous)
        still = REFRESH_FRAMES if cut else min(self._still + 1, unchanged) if stands else 0
        frame = FrameState(
            size=settings.render_size, output_size=settings.size, view=view, previous=self._previous or view,
            jitter=self._jitter() if self._accumulates else (0.0, 0.0), history_valid=not cut,
            accumulates=self._accumulates, noise_phase=settings.seed * GOLDEN_RATIO % 1.0, index=self._index,
            exposure_factor=settings.exposure, exposure=settings.exposure / self._radiance_scale,
            geometry=self._geometry, lights=self._lights, lighting=lighting, unchanged=unchanged, still=still,
            relit=not cut and lighting[0] != self._lighting[0], viewpoints=self._viewpoints,
            following=(view, time) if following is None else (self._view(following[0]), following[1]))
        self._lights.upload(view.eye)
        self._camera.upload(frame)
        asking = 0.0  # seconds
        with self._timer.frame():
            for bound, execute, resources in self._pipeline.executors:
                start = perf_counter()
                if not wanted():
                    raise _AbandonedError
                asking += perf_counter() - start
                with self._timer.measure(bound.name):
                    execute(frame, resources)
                for hook in self.after_pass:
                    hook(bound, self._pool)
        self._timer.extend("frame", -asking * 1e3)
        # Only now does anything of this frame become the next one's past, so it can be abandoned until here.
        self._previous, self._lighting, self._unchanged, self._still = view, lighting, unchanged, still
        self._pool.swap()
        self._index += 1

    def _make_pipeline_again(self) -> None:
        """Make passes and textures anew, since the lights need others, and go on with what was accumulated."""
        history = None if self._previous is None else self._pool
        self._pipelines.clear()
        del self._pipeline
        self._gl.collect()  # before the new textures, so that there need not be memory for both
        self._pipeline = _Pipeline(self._gl, replace(self._inputs, settings=self.settings))
        self._pipelines[self.settings.render_scale] = self._pipeline
        if history is not None:
            self._pool.take_history(history)

    def _adapt_to_projection(self, is_orthographic: bool) -> None:
        """Another kind of projection needs other shaders, and is a cut."""
        if is_orthographic != ("ORTHOGRAPHIC" in self._gl.defines):
            self._gl.defines = {"ORTHOGRAPHIC": 1} if is_orthographic else {}
            for pipeline in self._pipelines.values():
                pipeline.make_passes()
            self._gl.collect()
            self.cut()

    def _view(self, camera: Camera) -> View:
        """The view of a camera, which may see all that ``LightSet.bounds`` contains."""
        far = 1.01 * float(np.linalg.norm(np.abs(self._lights.bounds - camera.eye).max(axis=0)))
        return View.of(camera, self.settings.size, NEAR * self.scene.longest_edge, far)

    @property
    def _traced_by(self) -> str:
        """What traces the rays of frames: ``cpu``, ``gpu``, or ``none`` where there are none."""
        if self._caster is None:
            return "none"
        return "cpu" if self._caster.shader_rays is None else "gpu"

    def _get_caster(self) -> Caster:
        """One caster of the scene for all who cast rays, made when the first of them does."""
        if self._caster is None:
            self._caster = Caster(self._scaled)
            self._caster.shader_rays = choose_rays(self._gl, self._caster, self.settings.rays)
        return self._caster

    def _needs_rays(self, scene: Scene) -> tuple[bool, ...]:
        """Which lights' shadows are traced, by what they light at all key times."""
        # A shadow map does not hold what hides the surfaces that its light stands for from each other.
        hidden = {light for light, points in scene.approximate_lights.items() if points.hides_itself}
        return needs_rays(scene.lights, hidden, self._get_caster, scene.key_times)

    def _jitter(self) -> tuple[float, float]:
        """Halton offsets in clip units, centred on the pixel."""
        i = (self._index + self.settings.seed) % round(JITTER_PERIOD / self.settings.render_scale**2) + 1
        w, h = self.settings.render_size
        return (2 * halton(i, 2) - 1) / w, (2 * halton(i, 3) - 1) / h

    def _display(self, final: Pixels | None = None) -> Pixels:
        """The display image of the newest frame, whose final image may be given."""
        if self._ocio_view is None:
            return self.read("display")[..., :3]
        exposure = self.settings.exposure
        if self.settings.auto_exposure:
            exposure *= float(self.resource("auto_exposure")[0, 0, 0]) * self._radiance_scale
        return display_view(self._read("final") if final is None else final, exposure, self._ocio_view)

    def _read(self, name: str) -> Pixels:
        w, h = self.settings.size
        channels = COMPONENTS.get(name, 3)
        source = self._pipeline.sources[name]
        if source is None:
            return np.zeros((h, w, channels), np.float32)
        image = self._pool.read(source, newest=True)
        if name == "position":
            assert self._previous is not None, "no frame was drawn"
            seen, eye = image[..., 3:] > 0, self._previous.eye.astype(np.float32)
            return np.where(seen, image[..., :3] + eye, np.float32(0))
        if name in RADIANCE and self._radiance_scale != 1:
            image = image * np.float32(1 / self._radiance_scale)  # before channels are left out: whole rows are faster
        if name == "flow":  # as drawn, it leads from the next frame to this one
            image = 0.0 - image
        return image[..., :channels]

    def _count_non_finite(self, bound: BoundPass, pool: Pool) -> None:
        self._non_finite[bound.name] += sum(pool.count_non_finite(name) for name in bound.writes)
