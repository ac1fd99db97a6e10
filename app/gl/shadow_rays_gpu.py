"""Shadow rays on the GPU alone: one draw traces all samples of a frame."""

from collections.abc import Mapping, Sequence

import moderngl
import numpy as np

from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.shader import Program
from app.gl.shadow_rays import RayScene, guide_defines, set_frame
from app.gl.sky_guide import SkyGuide

MAX_LESSONS = 8  # samples of a receiver that a guide learns by at once, as in shadow_rays.frag
LESSON_TEXTURES = 3
ARRIVED, PART, LUMINANCE, IS_DIFFUSE = 0x7FF, 16, 0xFFFF, 31  # masks and shifts of a lesson


class GpuShadowRays:
    """Shadow rays of a grid of receivers, with the same samples and the same results as those of ``ShadowRays``.

    The guide learns from a frame as if all samples of a receiver had the sky of the first.

    Parameters
    ----------
    size, defines, guide
        As for ``ShadowRays``.
    scene : RayScene
        One with ``shader_rays``.
    """

    def __init__(self, device: Device, size: tuple[int, int], defines: Mapping[str, object], scene: RayScene,
                 guide: SkyGuide | None = None) -> None:
        assert scene.shader_rays is not None
        self._device, self._scene, self._rays, self._guide = device, scene, scene.shader_rays, guide
        sums = 2 + ("SPECULAR_RAYS" in defines)
        lessons = {"WRITE_LESSONS": sums, **guide_defines(True, False)} if guide else {}
        self.program: Program = device.fullscreen("shadow_rays.frag", {**defines, **lessons, "RAYS_HERE": 1})
        self._lessons = [device.ctx.texture(size, 4, dtype="u4") for _ in range(LESSON_TEXTURES if guide else 0)]
        self._untaught = 0  # samples of each receiver that the guide has not learned by
        self._targets: dict[tuple[int, ...], moderngl.Framebuffer] = {}

    def draw(self, frame: FrameState, samples: range, targets: Sequence[moderngl.Texture]) -> None:
        """Draw what ``ShadowRays.trace`` returns into ``targets``; what ``program`` reads must be bound.

        With a guide, at most ``MAX_LESSONS`` samples, of which it learns by ``learn``.
        """
        set_frame(self.program, frame, self._scene)
        self._rays.bind(self.program)
        if self._guide is not None:
            self._guide.bind(self.program)
        self.program.set(local_eye=tuple(frame.view.eye - self._scene.origin), first_sample=samples.start,
                         sample_count=len(samples))
        key = tuple(texture.glo for texture in targets)
        if key not in self._targets:
            self._targets[key] = self._device.ctx.framebuffer([*targets, *self._lessons])
        self._targets[key].use()
        self._device.ctx.enable_only(moderngl.NOTHING)
        self._device.draw_fullscreen(self.program)
        self._untaught = len(samples)

    def learn(self) -> None:
        """Let the guide learn by what was drawn last: before the next frame, when there is no more to wait for."""
        if self._guide is None or not self._untaught:
            return
        used = self._lessons[:1 + self._untaught // 4]
        lessons = np.concatenate([np.frombuffer(t.read(), np.uint32).reshape(-1, 4) for t in used], axis=1)
        sky = lessons[:, 0].copy().view(np.float32)
        for lesson in lessons[:, 1:1 + self._untaught].T:
            arrived = lesson >> PART & ARRIVED
            rows = np.flatnonzero(arrived)
            luminance = (lesson.take(rows) & LUMINANCE).astype(np.uint16).view(np.float16) * sky.take(rows)
            self._guide.learn(rows, arrived.take(rows).astype(np.int64) - 1, luminance, sky * (lesson >> IS_DIFFUSE))
        self._untaught = 0
