"""A renderer that follows a scene which the program changes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np

from app.api.checked import (
    check_camera,
    check_cameras,
    check_count,
    check_iterable,
    check_lights,
    check_number,
    check_size,
)
from app.api.frame import Frame, make_frame
from app.api.scene import Scene
from app.errors import SettingsError, did_you_mean
from app.network.selection import DEFAULT_MODEL, Model, by_role, find_models
from app.renderer import Renderer as Engine
from app.scene import Camera, CameraPath, Light
from app.settings import TONE_MAPS, Settings

TIME_STEP = 1e-6  # seconds added to the clock when an object has moved, so that its transform is read again

Models = str | Path | Sequence[str | Path] | None
AnyCamera = Camera | CameraPath | str | None


class Renderer:
    """Draws ``scene``; a context manager, and otherwise to be closed by ``close``.

    The OpenGL context is made with the first frame. Several threads may use a renderer: one waits for the other.

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
    taa, exposure, tonemap, auto_exposure, bounces, seed, provider, rays, strict_device, scale, render_scale
        As in ``Settings``; each has an option of the command line.

    Raises
    ------
    AfterglowError
        When a setting is outside its range, or there is no such model.
    """

    def __init__(self, scene: Scene, size: tuple[int, int] = (1024, 768), model: Models = DEFAULT_MODEL, *,
                 outputs: Sequence[str] = ("final",), taa: bool = True, exposure: float = 1.0,
                 auto_exposure: bool = False, tonemap: str = TONE_MAPS[0], bounces: int | None = None, seed: int = 0,
                 provider: str = "auto", rays: str = "auto", strict_device: bool = False, scale: float | None = None,
                 render_scale: float = 1.0) -> None:
        if not isinstance(scene, Scene):
            raise SettingsError(f"can't draw a {type(scene).__name__}", "scene", "expected a Scene, such as load gives")
        self.scene = scene
        self._settings = Settings(
            size=check_size(size), outputs=_names(outputs), taa=taa, exposure=exposure, auto_exposure=auto_exposure,
            tonemap=tonemap, bounces=bounces, seed=seed, provider=provider, rays=rays, strict_device=strict_device,
            scale=scale, render_scale=render_scale)
        self._models = _find(model)
        self._engine: Engine | None = None
        self._key: tuple[object, ...] = ()
        self._movable: tuple[str, ...] = ()
        self._lights: tuple[Light, ...] = ()
        self._clock = 0.0
        self._video = 0  # number of the video, or of the other picture, that was drawn last
        self._is_closed = False
        self._lock = RLock()

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
        with self._lock:
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
            anti-aliasing, 16 frames are drawn before it, or more with ``render_scale``.
        following : tuple of camera and float, optional
            Camera and time of the next picture, for ``flow``. Objects moved by ``transform`` count as at rest.
        """
        time = check_number(time, "time")
        settle = None if settle is None else check_count(settle, "settle")
        with self._lock:
            engine = self._follow()
            view = self._camera(camera, time)
            after = (view, time) if following is None else self._following(following)
            self._video += 1
            if settle is None:
                return self._still(engine, view, time, [view], after)
            engine.place_surfels(())
            return self._draw(engine, view, time, settle, after)

    def render_batch(self, cameras: Sequence[AnyCamera], time: float = 0.0) -> list[Frame]:
        """Draw stills of many cameras at one time, faster than one by one.

        Surfels are chosen once, for all cameras together. The pictures do not depend on the order of the cameras.

        Returns
        -------
        list of Frame
            In the order of the cameras.
        """
        return [frame for _, frame in sorted(self.iterate_batch(cameras, time), key=itemgetter(0))]

    def iterate_batch(self, cameras: Sequence[AnyCamera], time: float = 0.0) -> Iterator[tuple[int, Frame]]:
        """Draw a batch that is too large to be kept: the frames of ``render_batch`` in another order.

        The scene as it is at the first frame counts for all.

        Yields
        ------
        tuple of int and Frame
            The index of the camera, and its picture.
        """
        time = check_number(time, "time")
        with self._lock:
            engine = self._follow()
            views = [self._camera(camera, time) for camera in check_iterable(cameras, "cameras")]
        # In an order of their own, so that whatever a pass keeps was made for the same camera.
        order = sorted(range(len(views)), key=lambda index: repr(views[index]))
        together = list(dict.fromkeys(views[index] for index in order))
        for index in order:
            with self._lock:
                if engine is not self._engine:
                    raise SettingsError("the renderer was closed or made anew for another scene during a batch",
                                        "cameras", "expected a renderer of its own for each")
                self._video += 1
                frame = self._still(engine, views[index], time, together, (views[index], time))
            yield index, frame

    def render_video(self, cameras: Sequence[AnyCamera], times: Sequence[float], lead_in: int = 0) -> Iterator[Frame]:
        """Draw consecutive frames of a video, one after the other.

        They depend on nothing that was drawn before. The scene may be changed between two frames, but the renderer must
        draw nothing else until the last one.

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
        listed, lead_in = list(check_iterable(cameras, "cameras")), check_count(lead_in, "lead_in")
        moments = [check_number(time, f"times[{index}]") for index, time in enumerate(check_iterable(times, "times"))]
        if len(listed) != len(moments):
            raise SettingsError(f"{len(listed)} cameras and {len(moments)} times", "times",
                                "expected one of each for every frame")
        with self._lock:
            self._video += 1
            video = self._video
        for index, time in enumerate(moments):
            with self._lock:
                if video != self._video:
                    raise SettingsError("another picture was drawn between two frames of a video", "cameras",
                                        "expected a renderer of its own for each video")
                engine = self._follow()
                view = self._camera(listed[index], time)
                if index == 0:
                    engine.cut()
                engine.place_surfels([view] if index == 0 else ())
                after = min(index + 1, len(moments) - 1)
                following = self._following((listed[after], moments[after]))
                if index < lead_in:
                    engine.advance(view, time + self._clock)
                    continue
                frame = self._draw(engine, view, time, 0, following)
            yield frame

    def close(self) -> None:
        """Release everything; the renderer can't draw afterwards."""
        with self._lock:
            self._is_closed = True
            self._release()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _release(self) -> None:
        if self._engine is not None:
            self._engine.close()
        self._engine, self._movable = None, ()

    def _still(self, engine: Engine, camera: Camera, time: float, together: Sequence[Camera],
               following: tuple[Camera, float]) -> Frame:
        engine.cut()
        engine.place_surfels(together)
        return self._draw(engine, camera, time, self._settings.settle_frames, following)

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
            cameras = {**scene.cameras, **check_cameras(self.scene.cameras)}
            name = scene.default_camera if camera is None else camera
            if name not in cameras:
                raise SettingsError(f"no camera {name!r}", "camera", did_you_mean(name, cameras))
            camera = cameras[name]
        if not isinstance(camera, Camera | CameraPath):
            raise SettingsError(f"can't look through a {type(camera).__name__}", "camera",
                                "expected a Camera, such as camera_from_matrix gives, or a name")
        return check_camera(check_cameras({"camera": camera})["camera"].at(time))

    def _following(self, following: Any) -> tuple[Camera, float]:
        if not (isinstance(following, tuple) and len(following) == 2):
            raise SettingsError(f"bad value of the type {type(following).__name__}", "following",
                                "expected a camera and a time")
        time = check_number(following[1], "following: time")
        return self._camera(following[0], time), time

    def _follow(self) -> Engine:
        """The engine for the scene as it is now."""
        if self._is_closed:
            raise SettingsError("it is closed", "renderer", "expected a new one, or to draw before it is closed")
        moved = self._moved()
        if self._engine is None or self.scene.key != self._key or not set(moved) <= set(self._movable):
            return self._begin(moved)
        lights = check_lights(self.scene.lights)
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
        self._release()
        self._movable = tuple(dict.fromkeys(movable))
        self._assembled = self.scene.assemble(self._movable)
        self._key, self._lights = self.scene.key, check_lights(self.scene.lights)
        self._engine = Engine(self._assembled.loaded.scene, self._settings, self._models)
        return self._engine


def _names(outputs: Any) -> tuple[str, ...]:
    if isinstance(outputs, str) or not isinstance(outputs, Iterable) or not all(isinstance(o, str) for o in outputs):
        raise SettingsError(f"bad outputs {outputs!r}", "outputs", 'expected a sequence of names, such as ["final"]')
    return tuple(outputs)


def _find(model: Models) -> tuple[Model, ...]:
    names = [] if model is None else [model] if isinstance(model, str | Path) else check_iterable(model, "model")
    found = [part for name in names for part in find_models(str(name), "model")]
    return tuple(by_role(found, "model").values())
