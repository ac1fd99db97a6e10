"""Coarse shading by the environment: what a few directions send, with nothing in their way."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from app.environment import sky_light
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.scene import Environment

DIRECTIONS = 64  # Suppan et al.


def grid(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height that it has of its own, without a network, for an image of ``size``: half of that."""
    return math.ceil(size[0] / 2), math.ceil(size[1] / 2)


def declare(environment: Environment, scale: float, grid: tuple[int, int], targets: Mapping[str, str]) -> Pass:
    """Over a low-resolution ``grid`` of width and height; radiance is multiplied by ``scale``, the scene's.

    Parameters
    ----------
    targets : mapping of str to str
        The resource for ``diffuse``, irradiance / π, and, where the scene is has_specular, that for ``specular``, what GGX
        lobes gather without Fresnel's law.
    """
    sky = sky_light(environment, DIRECTIONS)
    radius = np.arccos(np.clip(1 - sky.solid_angle / (2 * np.pi), -1, 1))  # of a cap of that solid angle
    constants = {"directions": np.column_stack([sky.direction, radius]).tolist(),
                 "powers": (sky.power * np.float32(scale)).tolist()}

    def uniforms(frame: FrameState) -> Mapping[str, Any]:
        return {"ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1]), **constants}

    def make(device: Device, bound: BoundPass) -> Callable[[FrameState, Resources], None]:
        wanted = {f"WRITE_{kind.upper()}": bound.writes.index(name) for kind, name in targets.items()
                  if name in bound.writes}
        return make_fullscreen(device, bound, "unshadowed_environment.frag", uniforms, {"DIRECTIONS": DIRECTIONS, **wanted})

    return Pass("unshadowed_environment", reads=("normal", "depth", *(("specular_roughness",) if "specular" in targets else ())),
                writes={name: Tex("f2", 4, size=grid) for name in targets.values()}, make=make)
