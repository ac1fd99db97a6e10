"""A renderer that follows a scene which the program changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.api.frame import Frame, make_frame
from app.api.scene import Scene, comparable
from app.errors import SettingsError, did_you_mean
from app.network.selection import DEFAULT_MODEL, Model, by_role, find_models
from app.renderer import Renderer as Engine
from app.scene import Camera, CameraPath, Light
from app.settings import SETTLE_FRAMES, TONE_MAPS, Settings

TIME_STEP = 1e-6  # seconds added to the clock when an object has moved, so that its transform is read again

Models = str | Path | Sequence[str | Path] | None
AnyCamera = Camera | CameraPath | str | None


class Renderer:
    """Draws ``scene``; a context manager, and otherwise to be closed by ``close``.

    The OpenGL context is made with the first frame and belongs to the thread that made it.

    Parameters
    ----------
    scene : Scene
        May be changed between frames.
    size : tuple of int
        Width and height in pixels.
    model : str, Path, sequence of these, or None
        A bundled network, an ``.onnx`` file with a contract, ``ssgi``, or None for no indirect light; and beside it a
        model that shades surfaces by an environment.
    outputs : sequence of str
        ``final`` and AOVs.
    taa, exposure, tonemap, auto_exposure, bounces, seed, provider, strict_device, scale
        As in ``Settings``; each has an option of the command line.

    Raises
    ------
    AfterglowError
        When a setting is outside its range, or there is no such model.
    """

    def __init__(self, scene: Scene, size: tuple[int, int] = (1024, 768), model: Models = DEFAULT_MODEL, *,
                 outputs: Sequence[str] = ("final",), taa: bool = True, exposure: float = 1.0,
                 auto_exposure: bool = False, tonemap: str = TONE_MAPS[0], bounces: int | None = None, seed: int = 0,
                 provider: str = "auto", strict_device: bool = False, scale: float | None = None) -> None:
        self.scene = scene
        self._settings = Settings(
            size=(size[0], size[1]), outputs=tuple(outputs), taa=taa, exposure=exposure, auto_exposure=auto_exposure,
            tonemap=tonemap, bounces=bounces, seed=seed, provider=provider, strict_device=strict_device, scale=scale)
        self._models = _find(model)
        self._engine: Engine | None = None
        self._key: tuple[object, ...] = ()
        self._movable: tuple[str, ...] = ()
        self._lights: tuple[Light, ...] = ()
        self._clock = 0.0

    @property
    def exposure(self) -> float:
        """Linear factor before the tone map of ``Frame.display``; may be changed."""
        return self._settings.exposure

    @exposure.setter
    def exposure(self, factor: float) -> None:
        self._settings = replace(self._settings, exposure=factor)

    @property
    def notices(self) -> tuple[str, ...]:
        """What was guessed, skipped or replaced in the scene."""
        self._follow()
        return self._assembled.loaded.scene.notices

    def render(self, camera: AnyCamera = None, time: float = 0.0, *, settle: int | None = None,
               following: tuple[AnyCamera, float] | None = None) -> Frame:
        """Draw one picture.

        Parameters
        ----------
        camera : Camera, CameraPath, str or None
            A camera, the name of one of the scene's, or None for the default one.
        time : float
            Seconds; places what animations and motions move.
        settle : int, optional
            Frames to draw before it, continuing from the picture before, as in a video; 0 draws the next frame of one.
            Without it the picture is a still that depends on nothing that was drawn before: with temporal
            anti-aliasing, 16 frames are drawn before it.
        following : tuple of camera and float, optional
            Camera and time of the next picture, for ``flow``. Objects moved by ``transform`` count as at rest.
        """
        engine = self._follow()
        view = self._camera(camera, time)
        after = (view, time) if following is None else (self._camera(*following), following[1])
        if settle is None:
            return self._still(engine, view, time, [view], after)
        engine.place_surfels(())
        return self._draw(engine, view, time, settle, after)

    def render_batch(self, cameras: Sequence[AnyCamera], time: float = 0.0) -> list[Frame]:
        """Draw stills of many cameras at one time, much faster than one by one.

        Surfels are chosen once, for all cameras together. The pictures do not depend on the order of the cameras.

        Returns
        -------
        list of Frame
            In the order of the cameras.
        """
        frames = dict(self.iterate_batch(cameras, time))
        return [frames[index] for index in range(len(cameras))]

    def iterate_batch(self, cameras: Sequence[AnyCamera], time: float = 0.0) -> Iterator[tuple[int, Frame]]:
        """Draw a batch that is too large to be kept: the frames of ``render_batch`` in another order.

        Yields
        ------
        tuple of int and Frame
            The index of the camera, and its picture.
        """
        engine = self._follow()
        views = [self._camera(camera, time) for camera in cameras]
        # In an order of their own, so that whatever a pass keeps was made for the same camera.
        order = sorted(range(len(views)), key=lambda index: repr(views[index]))
        together = [views[index] for index in order]
        for index in order:
            yield index, self._still(engine, views[index], time, together, (views[index], time))

    def render_video(self, cameras: Sequence[AnyCamera], times: Sequence[float], lead_in: int = 0) -> Iterator[Frame]:
        """Draw consecutive frames of a video, one after the other.

        They depend on nothing that was drawn before. The scene may be changed between two frames.

        Parameters
        ----------
        cameras : sequence
            The camera of each frame.
        times : sequence of float
            Seconds.
        lead_in : int
            How many of the first frames are drawn without being given, so that what accumulates over frames has
            settled. With 16 a video can be drawn in parts whose seams don't show.

        Yields
        ------
        Frame
        """
        for index, time in enumerate(times):
            engine = self._follow()
            view = self._camera(cameras[index], time)
            if index == 0:
                engine.cut()
            engine.place_surfels([view] if index == 0 else ())
            after = min(index + 1, len(times) - 1)
            following = self._camera(cameras[after], times[after]), times[after]
            if index < lead_in:
                engine.advance(view, time + self._clock)
            else:
                yield self._draw(engine, view, time, 0, following)

    def close(self) -> None:
        """Release everything; the next picture would begin anew."""
        if self._engine is not None:
            self._engine.close()
        self._engine, self._movable = None, ()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _still(self, engine: Engine, camera: Camera, time: float, together: Sequence[Camera],
               following: tuple[Camera, float]) -> Frame:
        engine.cut()
        engine.place_surfels(together)
        return self._draw(engine, camera, time, SETTLE_FRAMES if self._settings.taa else 0, following)

    def _draw(self, engine: Engine, camera: Camera, time: float, settle: int, following: tuple[Camera, float]
              ) -> Frame:
        engine.set_exposure(self._settings.exposure)
        for _ in range(settle):
            engine.advance(camera, time + self._clock)
        images = engine.render(camera, time + self._clock, (following[0], following[1] + self._clock))
        return make_frame(images, self._settings.exposure, camera, engine.scene, time)

    def _camera(self, camera: AnyCamera, time: float) -> Camera:
        scene = self._assembled.loaded.scene
        if camera is None or isinstance(camera, str):
            cameras = {**scene.cameras, **self.scene.cameras}
            name = scene.default_camera if camera is None else camera
            if name not in cameras:
                raise SettingsError(f"no camera {name!r}", "camera", did_you_mean(name, cameras))
            camera = cameras[name]
        if not isinstance(camera, Camera | CameraPath):
            raise SettingsError(f"can't look through a {type(camera).__name__}", "camera",
                                "expected a Camera, such as camera_from_matrix gives, or a name")
        return camera.at(time) if isinstance(camera, CameraPath) else camera

    def _follow(self) -> Engine:
        """The engine for the scene as it is now."""
        moved = self._moved()
        if self._engine is None or self.scene.key != self._key or not set(moved) <= set(self._movable):
            return self._begin(moved)
        lights = comparable(self.scene.lights)
        if lights != self._lights:
            derived = self._assembled.loaded.scene.lights[self._assembled.loaded.own_lights:]
            if not lights or not self._lights or not self._engine.relight((*lights, *derived)):
                return self._begin(moved)
            self._lights = lights
        self._move()
        return self._engine

    def _moved(self) -> tuple[str, ...]:
        """Names of the objects that are elsewhere than when the engine was made."""
        if self._engine is None:
            return ()
        placed = self._assembled.placed
        return tuple(name for name, item in self.scene.objects.items()
                     if name in placed and not np.array_equal(item.transform, placed[name]))

    def _move(self) -> None:
        """Write the transforms into the motions that the engine reads."""
        changed = False
        for name, motion in self._assembled.motions.items():
            transform = self.scene.objects[name].transform
            if not np.array_equal(motion.transforms[0], transform):
                motion.transforms[0] = transform
                changed = True
        self._clock += TIME_STEP * changed

    def _begin(self, moved: tuple[str, ...]) -> Engine:
        movable = tuple(name for name in (*self._movable, *moved) if name in self.scene.objects)
        self.close()
        self._movable = tuple(dict.fromkeys(movable))
        self._assembled = self.scene.assemble(self._movable)
        self._key, self._lights = self.scene.key, comparable(self.scene.lights)
        self._engine = Engine(self._assembled.loaded.scene, self._settings, self._models)
        return self._engine


def _find(model: Models) -> tuple[Model, ...]:
    names = [] if model is None else [model] if isinstance(model, str | Path) else list(model)
    found = [part for name in names for part in find_models(str(name), "model")]
    return tuple(by_role(found, "model").values())
