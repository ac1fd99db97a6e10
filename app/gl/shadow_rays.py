"""Shadow rays: the GPU chooses them, a caster on the CPU says which are blocked, and their light is summed."""

from collections.abc import Mapping
from typing import Protocol

import moderngl
import numpy as np

from app.arrays import F32, F64, Bools
from app.environment import SKY_DISTANCE
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.light_guide import LightGuide
from app.gl.receiver_tiles import TILE
from app.gl.shader import Program
from app.gl.sky_guide import DEFINES as SKY_GUIDE_DEFINES
from app.gl.sky_guide import SkyGuide
from app.math3d import LUMINANCE, put_rows

PASSES_PROXIES, MEETS_ALL, TO_SKY = 1.0, 2.0, 3.0  # kinds of rays in shadow_rays.frag, the last one from there on
TO_LUMINANCE = LUMINANCE.astype(np.float32)[:, None]
LUMINANCE_FLOOR, MAX_SQUARE = 1e-30, 1e4  # as in shadow_rays.frag
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
    sky_guide : SkyGuide, optional
        Where the environment is found; rays teach it.
    light_guide : LightGuide, optional
        Which lights are found; rays teach it.
    """

    def __init__(self, device: Device, size: tuple[int, int], defines: Mapping[str, object], scene: RayScene,
                 sky_guide: SkyGuide | None = None, light_guide: LightGuide | None = None) -> None:
        self._device, self._size, self._scene = device, size, scene
        self._sky_guide, self._light_guide = sky_guide, light_guide
        self.program: Program = device.fullscreen("shadow_rays.frag", {
            **defines, **guide_defines(sky_guide is not None, light_guide is not None)})
        self._has_specular, self._is_guided = "SPECULAR_RAYS" in defines, bool(sky_guide or light_guide)
        components = 4, 4, 4, *([4] * self._is_guided), *([2] * (light_guide is not None))
        self._textures = [device.ctx.texture(size, count, dtype="f4") for count in components]
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
            channel is the number of these samples, and of ``unshadowed`` the mean square of the share of it that one
            of them sees. Guided rays say little of what is hidden, so they only correct irradiance that is known.
        specular : ndarray, float32, shape (h, w, 4)
            With ``SPECULAR_RAYS`` only: mean luminance of the highlights whose rays reach their light, and of all that
            rays are traced for; the mean square of that; how many they are.
        """
        visible, unshadowed = np.zeros((2, self._size[0] * self._size[1], 4), np.float32)
        specular_rays, specular_square, square = np.zeros((3, len(visible)), np.float32)
        shift = (frame.view.eye - self._scene.origin).astype(np.float32)
        set_frame(self.program, frame, self._scene)
        for guide in (self._sky_guide, self._light_guide):
            if guide is not None:
                guide.bind(self.program)
        self._target.use()
        self._device.ctx.enable_only(moderngl.NOTHING)
        for sample in samples:
            self.program.set(sample_index=sample)
            self._device.draw_fullscreen(self.program)
            origin, vector, light = self._read(0)[:, :3], self._read(1), self._read(2)
            seen = self._seen(origin + shift, vector)
            visible += light * seen
            unshadowed += light
            luminance = (light[:, :3] @ TO_LUMINANCE)[:, 0]
            square += np.square(luminance * seen[:, 3])
            if self._has_specular:
                specular_rays += light[:, 3] > 0
                specular_square += np.square(light[:, 3])
            if self._is_guided:
                known = self._read(3)
                unshadowed[:, :3] += known[:, :3]
                self._learn(vector[:, 3], light[:, 3] == 0, luminance, seen[:, 3], known[:, 3])
        means = [_mean(total, len(samples) - specular_rays) for total in (visible, unshadowed)]
        mean = np.maximum(means[1][:, :3] @ TO_LUMINANCE, LUMINANCE_FLOOR)[:, 0]
        means[1][:, 3] = np.minimum(square / np.maximum(means[1][:, 3], 1) / mean, MAX_SQUARE * mean) / mean
        if self._has_specular:
            totals = visible[:, 3], unshadowed[:, 3], specular_square, specular_rays
            means.append(_mean(np.stack(totals, axis=1), specular_rays))
        return tuple(mean.reshape(self._size[1], self._size[0], 4) for mean in means)

    @property
    def guided(self) -> Bools:
        """Which receivers have rays guided to lights or to the sky, shape (h, w)."""
        guides = [guide.guides for guide in (self._sky_guide, self._light_guide) if guide is not None]
        return np.any(guides, axis=0).reshape(self._size[::-1])

    def _seen(self, origins: F32, vectors: F32) -> F32:
        """Share of the light that arrives by each ray, of the three channels and of luminance, shape (h · w, 4)."""
        seen, kind = np.zeros((len(vectors), 4), np.float32), vectors[:, 3]
        for is_kind, proxies_block in ((kind == PASSES_PROXIES, False), (kind >= MEETS_ALL, True)):
            rows = np.flatnonzero(is_kind)
            if len(rows):
                ends = vectors.take(rows, axis=0)[:, :3]  # much faster than with an index in brackets
                share = self._scene.transmitted(origins.take(rows, axis=0), ends, proxies_block)
                put_rows(seen, rows, np.concatenate([share, share @ TO_LUMINANCE], axis=1))
        return seen

    def _learn(self, kind: F32, is_diffuse: Bools, light: F32, seen: F32, sky: F32) -> None:
        """Let guides learn by the rays of one more sample, as the program wrote them; light is luminance."""
        if self._sky_guide is not None:
            hits = np.flatnonzero(seen * (kind >= TO_SKY))
            self._sky_guide.learn(hits, (kind.take(hits) - TO_SKY).astype(np.int64), light.take(hits), sky * is_diffuse)
        if self._light_guide is not None:
            index, analytic = self._read(4).T
            rows = np.flatnonzero(index >= 0)
            unshadowed = light.take(rows)
            self._light_guide.learn(rows, index.take(rows).astype(np.int64), analytic.take(rows), unshadowed,
                                    unshadowed * seen.take(rows))

    def _read(self, target: int) -> F32:
        """What the program wrote into one of its targets, shape (h · w, components)."""
        texture = self._textures[target]
        return np.frombuffer(texture.read(), np.float32).reshape(-1, texture.components)


def set_frame(program: Program, frame: FrameState, scene: RayScene) -> None:
    """Set what variants of shadow_rays.frag need of a frame, beside their receivers."""
    program.set(noise_phase=frame.noise_phase, ray_epsilon=RAY_EPSILON * scene.extent,
                sky_distance=SKY_DISTANCE * scene.extent, **frame.lights.bind_emission_points(),
                **frame.lights.bind_light_images())


def guide_defines(has_sky_guide: bool, has_light_guide: bool) -> dict[str, object]:
    """What shadow_rays.frag needs for guides."""
    return {**({"GUIDE_TILE": TILE} if has_sky_guide or has_light_guide else {}),
            **(SKY_GUIDE_DEFINES if has_sky_guide else {}), **({"GUIDES_LIGHTS": 1} if has_light_guide else {})}


def _mean(total: F32, samples: F32) -> F32:
    """Means of what was summed up over so many samples of each receiver; their number."""
    mean = np.asarray(total / np.maximum(samples, 1)[:, None], np.float32)
    mean[:, 3] = samples
    return mean


def merge_unguided(found: tuple[F32, ...], before: tuple[F32, ...], guided: Bools) -> tuple[F32, ...]:
    """What ``ShadowRays.trace`` found, and found before; diffuse light only where rays are not guided, (h, w)."""
    def merged(new: F32, old: F32, count: F32, count_before: F32) -> F32:
        return np.asarray(new + (old - new) * (count_before / np.maximum(count + count_before, 1)), np.float32)

    counts = found[0][..., 3:], before[0][..., 3:] * ~guided[..., None]
    visible, unshadowed = (merged(new, old, *counts) for new, old in zip(found[:2], before[:2], strict=True))
    visible[..., 3:] = counts[0] + counts[1]
    if len(found) == 2:
        return visible, unshadowed
    rays = found[2][..., 3:], before[2][..., 3:]
    specular = merged(found[2], before[2], *rays)
    specular[..., 3:] = rays[0] + rays[1]
    return visible, unshadowed, specular


def specular_defines(lights: Mapping[str, object], has_specular: bool) -> dict[str, object]:
    """``SPECULAR_RAYS`` where some rays say what highlights see: where some surface has a specular lobe.

    Parameters
    ----------
    lights : mapping
        ``LightSet.defines``.
    """
    return {"SPECULAR_RAYS": 1} if has_specular and "HAS_TRACED_LIGHT" in lights else {}


def share_of(visible: F32, unshadowed: F32) -> F32:
    """Shares of the unshadowed light that are visible, as ``trace`` gives both; 1 where there is no light, and last."""
    share = np.ones_like(visible)
    np.divide(visible[..., :3], unshadowed[..., :3], out=share[..., :3], where=unshadowed[..., :3] > 0)
    return share
