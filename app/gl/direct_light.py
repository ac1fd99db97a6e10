"""Direct light at any points: irradiance / π, with shadows by maps or rays as in the picture."""

import math
from collections.abc import Callable, Mapping

import moderngl
import numpy as np

from app.arrays import F32
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.gl.shader import Program
from app.gl.shadow_rays import RayScene, ShadowRays
from app.gl.shadow_rays_gpu import GpuShadowRays


class DirectLight:
    """Draws direct light at up to as many points as ``layout`` has texels.

    A point takes the four texels of a quad, which search its shadows together.

    Parameters
    ----------
    defines : mapping
        ``HAS_X`` for what the pass reads, among it all shadow maps.
    layout : tuple of int
        Width and height of the textures that hold the points.
    on_gpu : bool
        Whether shaders place the points and trace their rays, for ``draw_estimate`` alone.
    """

    def __init__(self, device: Device, lights: LightSet, defines: Mapping[str, object], layout: tuple[int, int],
                 scene: RayScene, on_gpu: bool = False) -> None:
        self._device, self._layout, self._origin, self._maps = device, layout, scene.origin, lights.shadow_maps
        self._defines, self._mapped_count = {**lights.defines, **defines}, len(lights.mapped)
        self._light = device.ctx.texture((2 * layout[0], 2 * layout[1]), 4, dtype="f4")
        self._target = device.ctx.framebuffer([self._light])
        self._rows = layout[1]  # of texels that hold points
        names = "light_sample_position", "light_sample_normal", "light_sample_visibility"
        self._textures = {name: device.ctx.texture(layout, 4, dtype="f4") for name in names}
        ray_defines = {**lights.defines, "GRID_SURFELS": 1}
        self._rays = ShadowRays(device, layout, ray_defines, scene) if lights.has_traced and not on_gpu else None
        self._gpu_rays = GpuShadowRays(device, layout, ray_defines, scene) if lights.has_traced and on_gpu else None
        self._traced = [device.ctx.texture(layout, 4, dtype="f4") for _ in range(2 if self._gpu_rays else 0)]

    def place(self, position: F32, normal: F32) -> None:
        """Take other points, shape (N, 3) in local space: world axes, relative to the origin of the traced scene."""
        self._rows = -(-len(position) // self._layout[0])
        for name, rows in (("light_sample_position", position), ("light_sample_normal", normal)):
            self._textures[name].write(self._as_texels(rows).tobytes())

    def trace(self, frame: FrameState, samples: range) -> tuple[F32, ...] | None:
        """Irradiance of the lights whose shadows are traced, as ``ShadowRays.trace``; None without such lights."""
        if self._rays is None:
            return None
        self._bind(self._rays.program, tuple(self._textures)[:2], 0)
        self._rays.program.set(local_eye=tuple(frame.view.eye - self._origin))
        return self._rays.trace(frame, samples)

    def draw(self, frame: FrameState, resources: Resources, visibility: F32 | None) -> F32:
        """Irradiance / π at the points, in their order, shape (N, 3); more rows fill up the last row of texels.

        Parameters
        ----------
        visibility : ndarray, float32, shape (h, w, 4), or None
            Share of the light with traced shadows that reaches each point; None leaves this light out.
        """
        if visibility is not None:
            self._textures["light_sample_visibility"].write(visibility.tobytes())
        elif not self._mapped_count:
            return np.zeros((self._rows * self._layout[0], 3), np.float32)
        drawn = self._draw(frame, resources, visibility is not None)
        texels = np.frombuffer(self._target.read(drawn, components=4, alignment=1, dtype="f4"), np.float32)
        rows = texels.reshape(self._rows, 2, 8 * self._layout[0])
        pairs = (rows[:, 0] + rows[:, 1]).reshape(-1, 2, 4)
        return np.asarray((pairs[:, 0, :3] + pairs[:, 1, :3]) / np.float32(4), np.float32)

    def _draw(self, frame: FrameState, resources: Resources, has_traced: bool) -> tuple[int, int, int, int]:
        """Draw into the target, also lights whose shadows are traced or not; the rectangle of it that has points."""
        left_out = {} if has_traced else {"LIGHT_COUNT": self._mapped_count}  # which come last
        program = self._device.fullscreen("surfel_light.frag", {**self._defines, **left_out})
        drawn = 0, 0, 2 * self._layout[0], 2 * self._rows
        self._target.use()
        self._target.scissor = drawn
        self._device.ctx.enable_only(moderngl.NOTHING)
        resources.bind(program, reads=self._maps)
        self._bind(program, tuple(self._textures), len(self._maps))
        program.set(noise_phase=frame.noise_phase, local_eye=tuple(frame.view.eye - self._origin))
        self._device.draw_fullscreen(program)
        return drawn

    @property
    def points(self) -> tuple[moderngl.Texture, moderngl.Texture]:
        """Positions and normals of the points, for shaders that place them; a normal of 0 is no point."""
        return self._textures["light_sample_position"], self._textures["light_sample_normal"]

    def draw_estimate(self, frame: FrameState, resources: Resources, sample: int) -> dict[str, moderngl.Texture]:
        """Like ``estimate``, by a ``sample`` of each point's sequence of rays, but at ``points`` and on the GPU alone.

        Returns
        -------
        dict of str to Texture
            ``end_light``: irradiance / π by mapped lights, four texels for each point; with traced lights,
            ``end_traced``: irradiance by these.
        """
        self._draw(frame, resources, has_traced=False)
        light = {"end_light": self._light}
        if self._gpu_rays is not None:
            self._bind(self._gpu_rays.program, tuple(self._textures)[:2], 0)
            self._gpu_rays.draw(frame, range(sample, sample + 1), self._traced)
            light["end_traced"] = self._traced[0]
        return light

    def estimate(self, frame: FrameState, resources: Resources, position: F32, normal: F32, rays: int = 1,
                 smooth: Callable[[F32], F32] = lambda traced: traced) -> F32:
        """Irradiance / π at N points, shape (N, 3); of lights whose shadows are traced, the mean of so many ``rays``.

        Of these a ratio of visible to unshadowed light would be biased, for a single ray sees one light only.

        Parameters
        ----------
        smooth : callable, optional
            Takes some of the noise from light of that kind, shape (N, 3).
        """
        at_once = math.prod(self._layout)
        light, of_traced = np.zeros_like(position), np.zeros_like(position)
        for number, first in enumerate(range(0, len(position), at_once)):
            rows = slice(first, first + at_once)
            count = len(position[rows])
            self.place(position[rows], normal[rows])
            light[rows] = self.draw(frame, resources, None)[:count]
            first_sample = (frame.index + number) * rays
            if (traced := self.trace(frame, range(first_sample, first_sample + rays))) is not None:
                of_traced[rows] = traced[0].reshape(-1, 4)[:count, :3] / np.float32(math.pi)
        return light if self._rays is None else light + smooth(of_traced)

    def _bind(self, program: Program, names: tuple[str, ...], first_unit: int) -> None:
        """Bind textures to the samplers of their names, in the units from the first one on."""
        for unit, name in enumerate(names, first_unit):
            self._textures[name].use(unit)
            program.set(**{name: unit})

    def _as_texels(self, rows: F32) -> F32:
        """Rows of three as texels of four, [h, w, 4], the first at the bottom left; 0 beyond the last."""
        texels = np.zeros((self._layout[0] * self._layout[1], 4), np.float32)
        texels[:len(rows), :3] = rows
        return texels.reshape(self._layout[1], self._layout[0], 4)
