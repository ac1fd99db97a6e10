"""How long Mitsuba's own path tracer takes for a picture."""

import math
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from app.math3d import View
from export.reference.mitsuba_module import load_mitsuba
from export.reference.mitsuba_scene import MitsubaScene
from export.reference.path_tracer import ROULETTE_DEPTH

SHORT_SECONDS = 1.0  # shorter measurements are repeated


def make_integrator_timer(scene: MitsubaScene, view: View, size: tuple[int, int],
                          max_bounces: int) -> Callable[[int], float]:
    """A function from samples per pixel to the seconds that Mitsuba's own ``path`` integrator takes, warmed up.

    Short measurements are taken twice, and the smaller one counts.
    """
    mi = load_mitsuba()
    origin = (view.eye - scene.origin) * scene.scale
    sensor = mi.load_dict({
        **_projection(view, scene.scale, mi.ScalarTransform4f().look_at(
            origin=origin.tolist(), up=view.rotation[1].tolist(), target=(origin - view.rotation[2]).tolist())),
        "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}})
    integrator = mi.load_dict({"type": "path", "max_depth": max_bounces + 2, "rr_depth": ROULETTE_DEPTH})
    combined = mi.load_dict(scene.combined)

    def render(spp: int) -> float:
        start = perf_counter()
        np.array(mi.render(combined, sensor=sensor, integrator=integrator, spp=spp))
        return perf_counter() - start

    def measure(spp: int) -> float:
        seconds = render(spp)
        return min(seconds, render(spp)) if seconds < SHORT_SECONDS else seconds

    for spp in (1, 2):  # one sample per pixel and several compile to different kernels
        render(spp)
    return measure


def _projection(view: View, scale: float, to_world: Any) -> dict[str, Any]:
    """A sensor's projection; Mitsuba's pixels are square."""
    if view.is_orthographic:
        width = view.half_size[0] * scale
        return {"type": "orthographic", "to_world": to_world @ type(to_world)().scale([width, width, 1.0])}
    return {"type": "perspective", "fov": math.degrees(2 * math.atan(view.half_size[1])), "fov_axis": "y",
            "principal_point_offset_x": view.center[0] / 2, "principal_point_offset_y": -view.center[1] / 2,
            "to_world": to_world}
