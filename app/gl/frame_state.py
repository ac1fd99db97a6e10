"""What the passes of one frame share: the cameras, the scene on the GPU, the lights."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import moderngl
import numpy as np

from app.gl.context import Device
from app.gl.geometry import GpuScene
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.math3d import View


class MotionKind(Enum):
    """What moved since the last frame."""

    NONE = 0
    CAMERA = 1
    OBJECTS = 2


REFRESH_FRAMES = 8  # from a change of objects or lights on, in which history is short
# Frames of indirect light: it follows moving objects, so its history must be short; a moving camera changes no light.
MAX_HISTORY = {MotionKind.NONE: 256.0, MotionKind.CAMERA: 10.0, MotionKind.OBJECTS: 3.0}

CAMERA_BINDING, LIGHT_BINDING = 0, 1


@dataclass(eq=False)
class FrameState:
    """One frame.

    Attributes
    ----------
    size, output_size : tuple of int
        Width and height in pixels at which the frame is drawn, and those of the image.
    previous : View
        Last frame's camera; this frame's after a cut.
    jitter : tuple of float
        Sub-pixel offset in clip units; zeros without TAA.
    history_valid : bool
        False in the first frame, after a cut and after a resize.
    accumulates : bool
        Whether TAA accumulates frames.
    noise_phase : float
        In [0, 1), from the seed.
    index : int
        Frames since the last cut.
    exposure_factor, exposure : float
        Linear factor for the display image, as the user chose it, and with the scene's radiance scale undone.
    lighting : tuple
        What the light on surfaces depends on, from any viewpoint: the lights, and how often any object has moved.
    unchanged, still : int
        Frames since objects or lights have changed last, and since these or the camera have; at least
        ``REFRESH_FRAMES`` from a cut on.
    relit : bool
        Whether lights have changed since the last frame.
    following : tuple of View and float
        The camera of the next frame, and its time in seconds.
    viewpoints : sequence of View
        Whose surfels are used; without any, surfels follow the camera. The same object as long as they stay.
    """

    size: tuple[int, int]
    output_size: tuple[int, int]
    view: View
    previous: View
    jitter: tuple[float, float]
    history_valid: bool
    accumulates: bool
    noise_phase: float
    index: int
    exposure_factor: float
    exposure: float
    geometry: GpuScene
    lights: LightSet
    lighting: tuple[object, ...]
    unchanged: int
    still: int
    relit: bool
    viewpoints: Sequence[View]
    following: tuple[View, float]

    @property
    def motion(self) -> MotionKind:
        """What moved since the last frame; objects count before the camera.

        Changed lights count as objects, and both for some frames more, since what was accumulated before is wrong.
        """
        if self.unchanged < REFRESH_FRAMES:
            return MotionKind.OBJECTS
        return MotionKind.CAMERA if self.still == 0 else MotionKind.NONE

    @property
    def view_and_lighting(self) -> tuple[object, ...]:
        """What light on the surfaces in view depends on, besides random numbers."""
        view = self.view
        return view.eye.tobytes(), view.rotation.tobytes(), view.half_size, view.center, self.lighting

    @property
    def stands_alone(self) -> bool:
        """Whether the frame depends on none before it, to the bit: a first one with the surfels of viewpoints."""
        return bool(self.viewpoints) and not self.history_valid

    @property
    def rests(self) -> bool:
        """Whether nothing moved between the two frames before either, so that what was gathered at rest stands."""
        return self.history_valid and self.still > 1 and self.unchanged > REFRESH_FRAMES

    @property
    def settled(self) -> bool:
        """Whether all history shows what is visible now."""
        return self.still >= REFRESH_FRAMES


Execute = Callable[[FrameState, Resources], None]  # draws one pass of a frame


class CameraBlock:
    """The uniform block of ``camera.glsl``."""

    def __init__(self, device: Device) -> None:
        self.buffer: moderngl.Buffer = device.ctx.buffer(reserve=4 * 28)

    def upload(self, frame: FrameState) -> None:
        """Write the frame's camera and bind both blocks."""
        block = np.zeros((7, 4), np.float32)
        block[:3, :3] = frame.view.rotation.T
        block[3, 3] = 1.0
        center = frame.view.center
        block[4] = (*frame.view.half_size, frame.jitter[0] + center[0], frame.jitter[1] + center[1])
        block[5] = (*frame.size, 1 / frame.size[0], 1 / frame.size[1])
        block[6, :2] = center
        self.buffer.write(block.tobytes())
        self.buffer.bind_to_uniform_block(CAMERA_BINDING)
        frame.lights.buffer.bind_to_uniform_block(LIGHT_BINDING)
