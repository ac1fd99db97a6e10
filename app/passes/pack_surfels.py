"""Packs what a network reads of world surfels; on the CPU, where they are already."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import Buf, Pass
from app.network.channels import RAYS, SURFELS
from app.network.contract import ModelContract
from app.surfels.tracked import TrackedSurfels
from app.surfels.world import WorldSurfels


def declare(surfels: TrackedSurfels, contract: ModelContract, names: dict[str, str], extent: float) -> Pass:
    """Packs the tensors on the grids ``surfels`` and ``rays``.

    Parameters
    ----------
    names : dict of str to str
        The graph's name of each tensor.
    extent : float
        The scene's longest edge in scene units.
    """
    specs = {t: spec for t, spec in contract.inputs.items() if spec.grid in (SURFELS, RAYS)}
    return Pass("pack_surfels", reads=("surfel_light",),
                writes={names[t]: Buf(spec.shape((0, 0)), on_host=True) for t, spec in specs.items()},
                make=lambda device, bound: make(surfels, contract, names, contract.scene_extent / extent))


def make(surfels: TrackedSurfels, contract: ModelContract, names: dict[str, str], extent: float) -> Execute:
    def execute(frame: FrameState, resources: Resources) -> None:
        world, irradiance = surfels.world, resources.rows("surfel_light")
        for tensor, spec in contract.inputs.items():
            if spec.grid == SURFELS:
                values = {name: _on_surfels(name, world, frame, extent, irradiance) for name in spec.channels}
            elif spec.grid == RAYS and not resources.is_current(surfels.version, names[tensor]):
                values = {"ray.surfel": world.index[None], "ray.albedo.rgb": np.moveaxis(world.albedo, -1, 0)}
            else:
                continue
            planes = np.empty(spec.shape((0, 0)), np.float32)
            for name, rows in spec.rows():
                planes[rows] = values[name]
            resources.write_array(names[tensor], planes)
            resources.set_current(surfels.version, names[tensor])

    return execute


def _on_surfels(name: str, world: WorldSurfels, frame: FrameState, extent: float,
                irradiance: F32) -> NDArray[Any]:
    """A channel, shape (components, S)."""
    match name:
        case "position.view.xyz":
            used = world.weight[:, None] > 0
            relative = world.position + (world.origin - frame.view.eye)
            return np.where(used, relative @ frame.view.rotation.T * extent, 0.0).T
        case "normal.view.xyz":
            return (world.normal @ frame.view.rotation.T).T
        case "irradiance.rgb":
            return irradiance.T
        case "emissive_irradiance.rgb":
            return world.emissive_irradiance.T
        case "surfel.radius":
            return world.radius[None] * np.float32(extent)
        case "surfel.clip_plane.view.xyzw":
            normal, offset = world.clip_plane[:, :3], world.clip_plane[:, 3:]
            offset = (offset + normal @ (frame.view.eye - world.origin)[:, None]) * extent
            return np.concatenate([normal @ frame.view.rotation.T, offset], axis=1).T
        case "surfel.weight":
            return world.weight[None]
    raise AssertionError(name)
