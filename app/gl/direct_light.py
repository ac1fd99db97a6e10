"""Direct light at any points: irradiance / π, with shadows by maps or rays as in the picture."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

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

LOBE_TEXTURES = "light_sample_lobe", "light_sample_view"


@dataclass(frozen=True, eq=False)
class PointLobes:
    """What N points reflect towards viewers by their specular lobes.

    Attributes
    ----------
    f0, view : ndarray, float32, shape (N, 3)
        Reflectance at normal incidence, 0 for no lobe; unit vectors towards the viewers.
    roughness, share : ndarray, float32, shape (N, 1)
        Perceptual; of the lobe's highlights that are wanted.
    """

    f0: F32
    view: F32
    roughness: F32
    share: F32


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
    has_lobes : bool
        Whether the points also have highlights of lights with shadow maps.
    """

    def __init__(self, device: Device, lights: LightSet, defines: Mapping[str, object], layout: tuple[int, int],
                 scene: RayScene, on_gpu: bool = False, has_lobes: bool = False) -> None:
        self._device, self._layout, self._origin, self._maps = device, layout, scene.origin, lights.shadow_maps
        self._defines = {**lights.defines, **defines, **({"HAS_LOBES": 1} if has_lobes else {})}
        self._mapped_count = len(lights.mapped)
        # Irradiance / π; with lobes, highlights.
        self._drawn = [device.ctx.texture((2 * layout[0], 2 * layout[1]), 4, dtype="f4") for _ in range(1 + has_lobes)]
        self._target = device.ctx.framebuffer(self._drawn)
        self._rows = layout[1]  # of texels that hold points
        names = ("light_sample_position", "light_sample_normal", "light_sample_visibility",
                 *(LOBE_TEXTURES if has_lobes else ()))
        self._textures = {name: device.ctx.texture(layout, 4, dtype="f4") for name in names}
        ray_defines = {**lights.defines, "GRID_SURFELS": 1}
        self._rays = ShadowRays(device, layout, ray_defines, scene) if lights.has_traced and not on_gpu else None
        self._gpu_rays = GpuShadowRays(device, layout, ray_defines, scene) if lights.has_traced and on_gpu else None
        self._traced = [device.ctx.texture(layout, 4, dtype="f4") for _ in range(2 if self._gpu_rays else 0)]

    def place(self, position: F32, normal: F32) -> None:
        """Take other points, shape (N, 3) in local space: world axes, relative to the origin of the traced scene."""
        self._rows = -(-len(position) // self._layout[0])
        self._write({"light_sample_position": position, "light_sample_normal": normal})

    def _write(self, values: Mapping[str, F32]) -> None:
        """Values of the points, up to four of each, into the textures of these names."""
        for name, rows in values.items():
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
        self._draw(frame, resources, visibility is not None)
        return self._read(0)

    @property
    def _area(self) -> tuple[int, int, int, int]:
        """The rectangle of the target that has points."""
        return 0, 0, 2 * self._layout[0], 2 * self._rows

    def _read(self, attachment: int) -> F32:
        """The mean over each point's four texels of what was drawn, shape (N, 3)."""
        texels = np.frombuffer(self._target.read(self._area, components=4, attachment=attachment, alignment=1,
                                                 dtype="f4"), np.float32)
        rows = texels.reshape(self._rows, 2, 8 * self._layout[0])
        pairs = (rows[:, 0] + rows[:, 1]).reshape(-1, 2, 4)
        return np.asarray((pairs[:, 0, :3] + pairs[:, 1, :3]) / np.float32(4), np.float32)

    def _draw(self, frame: FrameState, resources: Resources, has_traced: bool) -> None:
        """Draw into the target, also lights whose shadows are traced or not."""
        left_out = {} if has_traced else {"LIGHT_COUNT": self._mapped_count}  # which come last
        program = self._device.fullscreen("surfel_light.frag", {**self._defines, **left_out})
        self._target.use()
        self._target.scissor = self._area
        self._device.ctx.enable_only(moderngl.NOTHING)
        resources.bind(program, reads=self._maps)
        self._bind(program, tuple(self._textures), len(self._maps))
        program.set(noise_phase=frame.noise_phase, local_eye=tuple(frame.view.eye - self._origin),
                    **frame.lights.bind_light_images())
        self._device.draw_fullscreen(program)

    @property
    def points(self) -> tuple[moderngl.Texture, moderngl.Texture]:
        """Positions and normals of the points, for shaders that place them; a normal of 0 is no point."""
        return self._textures["light_sample_position"], self._textures["light_sample_normal"]

    @property
    def lobes(self) -> tuple[moderngl.Texture, moderngl.Texture]:
        """F0 and roughness of the points' lobes; directions to their viewers, and the shares that are wanted."""
        lobe, view = (self._textures[name] for name in LOBE_TEXTURES)
        return lobe, view

    def draw_estimate(self, frame: FrameState, resources: Resources, sample: int) -> dict[str, moderngl.Texture]:
        """Like ``estimate``, by a ``sample`` of each point's sequence of rays, but at ``points`` and on the GPU alone.

        Returns
        -------
        dict of str to Texture
            ``end_light``: irradiance / π by mapped lights, four texels for each point; with lobes, ``end_highlights``;
            with traced lights, ``end_traced``: irradiance by these.
        """
        self._draw(frame, resources, has_traced=False)
        light = dict(zip(("end_light", "end_highlights"), self._drawn, strict=False))
        if self._gpu_rays is not None:
            self._bind(self._gpu_rays.program, tuple(self._textures)[:2], 0)
            self._gpu_rays.draw(frame, range(sample, sample + 1), self._traced)
            light["end_traced"] = self._traced[0]
        return light

    def estimate(self, frame: FrameState, resources: Resources, position: F32, normal: F32, rays: int = 1,
                 smooth: Callable[[F32], F32] = lambda traced: traced,
                 lobes: PointLobes | None = None) -> tuple[F32, F32]:
        """Irradiance / π at N points; of lights whose shadows are traced, the mean of so many ``rays``. Highlights.

        Of these a ratio of visible to unshadowed light would be biased, for a single ray sees one light only.

        Parameters
        ----------
        smooth : callable, optional
            Takes some of the noise from light of that kind, shape (N, 3).
        lobes : PointLobes, optional
            Of the points, if the object has lobes and lights have shadow maps.

        Returns
        -------
        tuple of ndarray, float32, shape (N, 3)
            Irradiance / π, and the radiance of highlights of lights with shadow maps, less what of the same light is
            reflected where lobes count as diffuse; 0 without ``lobes``.
        """
        at_once = math.prod(self._layout)
        light, of_traced, highlights = np.zeros_like(position), np.zeros_like(position), np.zeros_like(position)
        for number, first in enumerate(range(0, len(position), at_once)):
            rows = slice(first, first + at_once)
            count = len(position[rows])
            self.place(position[rows], normal[rows])
            if lobes is not None:
                of_points = (lobes.f0, lobes.roughness), (lobes.view, lobes.share)
                self._write({name: np.concatenate([part[rows] for part in parts], axis=1)
                             for name, parts in zip(LOBE_TEXTURES, of_points, strict=True)})
            light[rows] = self.draw(frame, resources, None)[:count]
            if lobes is not None:
                highlights[rows] = self._read(1)[:count]
            first_sample = (frame.index + number) * rays
            if (traced := self.trace(frame, range(first_sample, first_sample + rays))) is not None:
                of_traced[rows] = traced[0].reshape(-1, 4)[:count, :3] / np.float32(math.pi)
        return light if self._rays is None else light + smooth(of_traced), highlights

    def _bind(self, program: Program, names: tuple[str, ...], first_unit: int) -> None:
        """Bind textures to the samplers of their names, in the units from the first one on."""
        for unit, name in enumerate(names, first_unit):
            self._textures[name].use(unit)
            program.set(**{name: unit})

    def _as_texels(self, rows: F32) -> F32:
        """Rows of up to four as texels, [h, w, 4], the first at the bottom left; 0 beyond the last."""
        texels = np.zeros((self._layout[0] * self._layout[1], 4), np.float32)
        texels[:len(rows), :rows.shape[1]] = rows
        return texels.reshape(self._layout[1], self._layout[0], 4)
