"""Shadow rays: the GPU chooses them, a caster on the CPU says which are blocked, and their light is summed."""

from collections.abc import Mapping
from typing import Protocol

import moderngl
import numpy as np

from app.arrays import F32, F64
from app.environment import SKY_DISTANCE
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.shader import Program
from app.gl.sky_guide import DEFINES as GUIDE_DEFINES
from app.gl.sky_guide import SkyGuide
from app.math3d import LUMINANCE, put_rows

PASSES_PROXIES, MEETS_ALL, TO_SKY = 1.0, 2.0, 3.0  # kinds of rays in shadow_rays.frag, the last one from there on
TO_LUMINANCE = LUMINANCE.astype(np.float32)[:, None]
RAY_EPSILON = 1e-4  # of the scene's longest edge, by which rays start off their surface


class ShaderRays(Protocol):
    """Rays that shaders trace: shaders/include/ray_scene.glsl."""

    def bind(self, program: Program) -> None:
        """Let ``program`` trace rays through the scene as it is now."""


class RayScene(Protocol):
    """What shadow rays can meet.

    Attributes
    ----------
    origin : ndarray, float64, shape (3,)
        World-space point that positions are relative to.
    extent : float
        Longest edge of the scene, scene units.
    shader_rays : ShaderRays or None
        For shaders that trace rays themselves; None where ``transmitted`` does it.
    """

    origin: F64
    extent: float
    shader_rays: ShaderRays | None

    def transmitted(self, origins: F32, vectors: F32, proxies_block: bool) -> F32:
        """Shares, (N, 3), of light that arrives from the ends of vectors at origins, both float32 (N, 3) in world axes.

        Light proxies are in the way where ``proxies_block`` is True.
        """


class ShadowRays:
    """Shadow rays of a grid of receivers.

    Parameters
    ----------
    size : tuple of int
        Width and height of the grid.
    defines : mapping
        What receivers there are and which lights.
    guide : SkyGuide, optional
        Where the environment is found; rays teach it.
    """

    def __init__(self, device: Device, size: tuple[int, int], defines: Mapping[str, object], scene: RayScene,
                 guide: SkyGuide | None = None) -> None:
        self._device, self._size, self._scene, self._guide = device, size, scene, guide
        self.program: Program = device.fullscreen("shadow_rays.frag", {**defines, **(GUIDE_DEFINES if guide else {})})
        self._has_specular, self._has_lights = "SPECULAR_RAYS" in defines, "HAS_TRACED_LIGHT" in defines
        self._textures = [device.ctx.texture(size, 4, dtype="f4") for _ in range(4 if guide else 3)]
        self._target = device.ctx.framebuffer(self._textures)

    def trace(self, frame: FrameState, samples: range) -> tuple[F32, ...]:
        """Trace ``samples`` of each receiver; what ``program`` reads must be bound.

        Parameters
        ----------
        samples : range
            Indices into each receiver's sequence.

        Returns
        -------
        visible, unshadowed : ndarray, float32, shape (h, w, 4)
            Mean irradiance of the samples of diffuse light with and without occlusion, bottom row first. The last
            channel is the number of these samples, and of ``unshadowed`` whether the guide guides them. Guided rays say
            little of what is hidden, so ``unshadowed`` has the environment's exact irradiance instead of theirs then.
        specular : ndarray, float32, shape (h, w, 4)
            With ``SPECULAR_RAYS`` only: mean luminance of the highlights whose rays reach their light, and of all that
            rays are traced for; 0; how many they are.
        """
        visible, unshadowed = np.zeros((2, self._size[0] * self._size[1], 4), np.float32)
        of_lights, specular_rays = np.zeros_like(visible), np.zeros(len(visible), np.float32)
        shift = (frame.view.eye - self._scene.origin).astype(np.float32)
        set_frame(self.program, frame, self._scene)
        if self._guide is not None:
            self._guide.bind(self.program)
        sky_of_all = np.zeros_like(visible)
        self._target.use()
        self._device.ctx.enable_only(moderngl.NOTHING)
        for sample in samples:
            self.program.set(sample_index=sample)
            self._device.draw_fullscreen(self.program)
            origin, vector, light = self._read(0)[:, :3] + shift, self._read(1), self._read(2)
            seen = np.zeros((len(light), 4), np.float32)  # of each channel, and of luminance
            kind = vector[:, 3]
            for is_kind, proxies_block in ((kind == PASSES_PROXIES, False), (kind >= MEETS_ALL, True)):
                rows = np.flatnonzero(is_kind)
                if len(rows):
                    ends = vector.take(rows, axis=0)[:, :3]  # much faster than with an index in brackets
                    share = self._scene.transmitted(origin.take(rows, axis=0), ends, proxies_block)
                    put_rows(seen, rows, np.concatenate([share, share @ TO_LUMINANCE], axis=1))
            visible += light * seen
            unshadowed += light
            if self._guide is not None:
                sky = self._read(3)
                sky_of_all += sky
                hits = np.flatnonzero(seen[:, 3] * (kind >= TO_SKY))
                self._guide.learn(hits, (kind.take(hits) - TO_SKY).astype(np.int64),
                                  (light.take(hits, axis=0)[:, :3] @ TO_LUMINANCE)[:, 0],
                                  sky[:, 3] * (light[:, 3] == 0))
                if self._has_lights:
                    of_lights += light * ((kind >= 0) & (kind < TO_SKY))[:, None]
            if self._has_specular:
                specular_rays += light[:, 3] > 0
        means = [_mean(total, len(samples) - specular_rays) for total in (visible, unshadowed)]
        if self._guide is not None:
            mean_of_lights = of_lights / np.maximum(len(samples) - specular_rays, 1)[:, None]
            np.copyto(means[1], sky_of_all / len(samples) + mean_of_lights, where=self._guide.guides[:, None])
        means[1][:, 3] = 0.0 if self._guide is None else self._guide.guides
        if self._has_specular:
            none = np.zeros_like(specular_rays)
            means.append(_mean(np.stack([visible[:, 3], unshadowed[:, 3], none, none], axis=1), specular_rays))
        return tuple(mean.reshape(self._size[1], self._size[0], 4) for mean in means)

    def _read(self, target: int) -> F32:
        """What the program wrote into one of its targets, shape (h · w, 4)."""
        return np.frombuffer(self._textures[target].read(), np.float32).reshape(-1, 4)


def set_frame(program: Program, frame: FrameState, scene: RayScene) -> None:
    """Set what variants of shadow_rays.frag need of a frame, beside their receivers."""
    program.set(noise_phase=frame.noise_phase, ray_epsilon=RAY_EPSILON * scene.extent,
                sky_distance=SKY_DISTANCE * scene.extent, **frame.lights.bind_emission_points())


def _mean(total: F32, samples: F32) -> F32:
    """Means of what was summed up over so many samples of each receiver; their number."""
    mean = np.asarray(total / np.maximum(samples, 1)[:, None], np.float32)
    mean[:, 3] = samples
    return mean


def specular_defines(lights: Mapping[str, object], has_specular: bool) -> dict[str, object]:
    """``SPECULAR_RAYS`` where some rays say what highlights see: where some surface has a specular lobe.

    Parameters
    ----------
    lights : mapping
        ``LightSet.defines``.
    """
    return {"SPECULAR_RAYS": 1} if has_specular and "HAS_TRACED_LIGHT" in lights else {}


def share_of(visible: F32, unshadowed: F32) -> F32:
    """The share of the unshadowed light that is visible, as ``trace`` gives both; 1 where there is no light."""
    share = np.ones_like(visible)
    np.divide(visible, unshadowed, out=share, where=unshadowed > 0)
    return share
