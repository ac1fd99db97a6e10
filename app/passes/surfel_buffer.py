"""World surfels and their light for shaders: shaders/include/surfel_kernel.glsl."""

import numpy as np

from app.arrays import F32
from app.gl.context import Device
from app.gl.shader import Program
from app.network.channels import HALF_MAX
from app.surfels import kernel
from app.surfels.tracked import TrackedSurfels

BINDING = 0
MIN_RADIUS = np.float32(1e-18)
MIN_WEIGHT = np.float32(1e-6)


class SurfelBuffer:
    """The surfels of ``surfels`` as they are when it is bound."""

    def __init__(self, device: Device, surfels: TrackedSurfels) -> None:
        self._surfels = surfels
        self._buffer = device.ctx.buffer(reserve=surfels.count * 5 * 16)
        self._version = 0
        self._records = np.zeros((surfels.count, 5, 4), np.float32)
        self._center = np.zeros(3, np.float32)

    def bind(self, program: Program, indirect: F32, with_sky: bool = True) -> None:
        """Let ``program`` interpolate between the surfels.

        Parameters
        ----------
        indirect : ndarray, float32, shape (S, 3)
            Indirect irradiance / π of each, or of those that are used. All surfels count everywhere, so one that is no
            number counts as 0.
        with_sky : bool
            Whether they give that of the sky too.
        """
        world = self._surfels.world
        if self._version != self._surfels.version:
            self._version = self._surfels.version
            self._pack()
        self._records[:len(indirect), 3, :3] = np.where(indirect < HALF_MAX, indirect, 0)  # what is no number, too
        self._records[:, 4, :3] = world.sky_irradiance if with_sky else 0
        self._buffer.write(self._records.tobytes())
        self._buffer.bind_to_storage_buffer(BINDING)
        program.set(surfel_count=max(world.used, 1), surfel_center=tuple(self._center))

    def _pack(self) -> None:
        world = self._surfels.world
        self._center = world.position[:max(world.used, 1)].mean(axis=0)  # for precision where the scene is much larger
        radius = np.maximum(world.radius, MIN_RADIUS)
        plane = world.clip_plane.copy()
        plane[:, 3] += plane[:, :3] @ self._center
        self._records[:, 0, :3], self._records[:, 0, 3] = world.position - self._center, 1 / radius**2
        self._records[:, 1, :3], self._records[:, 1, 3] = world.normal, np.log(np.maximum(world.weight, MIN_WEIGHT))
        self._records[:, 2] = kernel.clip_keys(plane, radius)
