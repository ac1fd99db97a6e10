"""Packs what a network reads of world surfels: on the CPU, since there are few and they are there already."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import Buf, Pass
from app.network.channels import RAYS, SURFELS
from app.network.contract import ModelContract
from app.surfels.tracked import TrackedSurfels
from app.surfels.world import F32, WorldSurfels


def declare(surfels: TrackedSurfels, contract: ModelContract, names: dict[str, str], extent: float,
            sky_is_direct: bool) -> Pass:
    """Packs surfels and rays.

    Parameters
    ----------
    names : dict of str to str
        The graph's name of each tensor.
    extent : float
        The scene's longest edge in scene units.
    sky_is_direct : bool
        Whether what comes straight from the environment is direct light, as where pixels are shaded by it, or glow.
    """
    specs = {t: spec for t, spec in contract.inputs.items() if spec.grid in (SURFELS, RAYS)}
    return Pass("pack_surfels", reads=("surfel_light",),
                writes={names[t]: Buf(spec.shape((0, 0))) for t, spec in specs.items()},
                make=lambda device, bound: make(surfels, contract, names, contract.scene_extent / extent,
                                                sky_is_direct))


def make(surfels: TrackedSurfels, contract: ModelContract, names: dict[str, str],
         extent: float, sky_is_direct: bool) -> Callable[[FrameState, Resources], None]:
    written: dict[str, object] = {}  # what a tensor on the rays holds
    light: list[tuple[object, F32]] = []

    def execute(frame: FrameState, resources: Resources) -> None:
        world = surfels.world
        state = surfels.version, frame.lighting
        if not light or light[0][0] != state:
            light[:] = [(state, _mean_light(resources, world))]
        for tensor, spec in contract.inputs.items():
            if spec.grid == SURFELS:
                sky, none = world.sky * np.float32(frame.lights.scale), np.float32(0)
                direct, glow = (sky, none) if sky_is_direct else (none, sky)
                lit = light[0][1] + direct, world.glow * np.float32(frame.lights.scale) + glow
                values = {name: _on_surfels(name, world, frame, extent, *lit) for name in spec.channels}
            elif spec.grid == RAYS and written.get(tensor) != (surfels.version, frame.overrides):
                values = {"ray.surfel": world.index[None], "ray.albedo.rgb": np.moveaxis(world.albedo, -1, 0)}
                written[tensor] = surfels.version, frame.overrides
            else:
                continue
            planes = np.empty(spec.shape((0, 0)), np.float32)
            for name, rows in spec.rows():
                planes[rows] = values[name]
            resources.buffer(names[tensor]).write(planes)

    return execute


def _mean_light(resources: Resources, world: WorldSurfels) -> F32:
    """Irradiance / π of each surfel, shape (S, 3): the mean over its places."""
    texture = resources["surfel_light"]
    texels = np.frombuffer(texture.read(alignment=1), np.float16).astype(np.float32)
    texels = texels.reshape(texture.height, texture.width, 4)
    quads = (texels[::2, ::2] + texels[::2, 1::2] + texels[1::2, ::2] + texels[1::2, 1::2]) / 4
    places = quads.reshape(-1, 4)[:len(world.light_sample_surfel)]
    number = np.maximum(np.bincount(world.light_sample_surfel, minlength=world.count), 1)
    return np.stack([np.bincount(world.light_sample_surfel, places[:, c], world.count) / number for c in range(3)],
                    axis=1).astype(np.float32)


def _on_surfels(name: str, world: WorldSurfels, frame: FrameState, extent: float, light: F32,
                glow: F32) -> NDArray[Any]:
    """A channel, shape (components, S)."""
    match name:
        case "position.view.xyz":
            used = world.weight[:, None] > 0
            relative = world.position + (world.origin - frame.view.eye)
            return np.where(used, relative @ frame.view.rotation.T * extent, 0.0).T
        case "normal.view.xyz":
            return (world.normal @ frame.view.rotation.T).T
        case "irradiance.rgb":
            return light.T
        case "emissive_irradiance.rgb":
            return glow.T
        case "surfel.radius":
            return world.radius[None] * np.float32(extent)
        case "surfel.weight":
            return world.weight[None]
    raise AssertionError(name)

