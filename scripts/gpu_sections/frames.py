"""Frame times, whole and by pass."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

from app.load import embedded_scene, load_scene, orbit
from app.network.selection import DEFAULT_MODEL, SURFEL_MODEL, Model, find_models
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from gpu_sections.common import Json, Options, format_size

# Models, and what traces rays.
MODELS = (("none", "auto"), (SURFEL_MODEL, "auto"), (DEFAULT_MODEL, "auto"), (DEFAULT_MODEL, "cpu"))
SMALL_SIZE = (64, 48)  # at which the CPU dominates
ORBIT_FRAMES = 720


def frames(options: Options) -> Json:
    """Milliseconds per frame while the camera orbits, with and without timing of passes."""
    scenes = {"cornell-box": embedded_scene()}
    if options.scene is not None:
        scenes[options.scene.stem] = load_scene(options.scene)
    warm_up, counted = (3, 4) if options.quick else (12, 30)
    rows = {}
    for name, scene in scenes.items():
        cameras = orbit(scene, scene.cameras[scene.default_camera].at(0.0), ORBIT_FRAMES)[:warm_up + counted]
        for size in (SMALL_SIZE, *options.sizes):
            for model, rays in MODELS:
                models, settings = find_models(model), Settings(size=size, rays=rays)
                rows[f"{name} {format_size(size)} {model}, rays: {rays}"] = {
                    **_untimed(scene, settings, models, cameras[:warm_up], cameras[warm_up:]),
                    **_timed(scene, settings, models, cameras[:warm_up], cameras[warm_up:])}
    return rows


def _untimed(scene: Scene, settings: Settings, models: Sequence[Model], warm_up: Sequence[Camera],
             cameras: Sequence[Camera]) -> Json:
    """``submit`` and ``in_flight`` wait for the GPU only after the last frame, ``advance`` after each."""
    with Renderer(scene, settings, models) as renderer:
        _run(renderer.advance, warm_up)
        context = renderer._gl.ctx
        with context:
            context.finish()
            begin = perf_counter()
            for camera in cameras:
                renderer._draw(camera, 0.0, lambda: True)
            submitted = perf_counter()
            context.finish()
            in_flight = perf_counter()
        return {"device": renderer.device, "submit": round((submitted - begin) * 1e3 / len(cameras), 3),
                "in_flight": round((in_flight - begin) * 1e3 / len(cameras), 3),
                "advance": _run(renderer.advance, cameras),
                "render": _run(renderer.render, cameras[:len(cameras) // 2])}


def _timed(scene: Scene, settings: Settings, models: Sequence[Model], warm_up: Sequence[Camera],
           cameras: Sequence[Camera]) -> Json:
    """Times of each pass, for which the renderer waits for the GPU after each."""
    with Renderer(scene, replace(settings, timing=True), models) as renderer:
        _run(renderer.advance, warm_up)
        renderer.reset_timing()
        ms = _run(renderer.advance, cameras)
        passes = renderer.timing()["passes"]
        return {"advance_timed": ms,
                **{key: {name: round(times[f"{key}_ms"]["median"], 3) for name, times in passes.items()}
                   for key in ("cpu", "gpu")}}


def _run(draw: Callable[[Camera, float], object], cameras: Sequence[Camera]) -> float:
    """Mean milliseconds per frame."""
    begin = perf_counter()
    for camera in cameras:
        draw(camera, 0.0)
    return round((perf_counter() - begin) * 1e3 / len(cameras), 3)
