"""Coarse shading by the environment: the light of a few directions, without occlusion."""

import math
from collections.abc import Mapping

import numpy as np

from app.environment import sky_light
from app.gl.context import Device
from app.gl.frame_state import Execute
from app.gl.fullscreen import make_fullscreen, ratio_to
from app.graph import BoundPass, Pass, Tex
from app.scene import Environment

DIRECTIONS = 64  # Suppan et al.


def grid(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the pass's own grid, used without a network, for an image of ``size``: half of that."""
    return math.ceil(size[0] / 2), math.ceil(size[1] / 2)


def declare(environment: Environment, grid: tuple[int, int], targets: Mapping[str, str]) -> Pass:
    """Over a low-resolution ``grid`` of width and height.

    Parameters
    ----------
    targets : mapping of str to str
        The resource for ``diffuse``, irradiance / π, and, where a material has a specular lobe, that for ``specular``,
        the radiance that GGX lobes gather, without the Fresnel term.
    """
    sky = sky_light(environment, DIRECTIONS)
    radius = np.arccos(np.clip(1 - sky.solid_angle / (2 * np.pi), -1, 1))  # of a cap of that solid angle
    constants = {"directions": np.column_stack([sky.direction, radius]).tolist(), "powers": sky.power.tolist()}

    def make(device: Device, bound: BoundPass) -> Execute:
        outputs = {f"WRITE_{kind.upper()}": bound.writes.index(name) for kind, name in targets.items()
                   if name in bound.writes}
        return make_fullscreen("unshadowed_environment.frag", lambda frame: {
            "ratio": ratio_to(grid, frame), **constants}, {"DIRECTIONS": DIRECTIONS, **outputs})(device, bound)

    return Pass("unshadowed_environment",
                reads=("normal", "depth", *(("specular_roughness",) if "specular" in targets else ())),
                writes={name: Tex("f2", 4, size=grid) for name in targets.values()}, make=make)
