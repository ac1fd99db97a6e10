"""How many rays a frame may trace from the texels of a grid."""

import math
from dataclasses import dataclass

from app.gl.frame_state import FrameState, MotionKind


@dataclass(frozen=True)
class RayBudget:
    """Rays of all texels together, and samples of each, at most; but each has one at least.

    Attributes
    ----------
    first_rays, max_first_samples : int
        Of a frame without history.
    changed_rays : int
        Of frames in which objects or lights change.
    rays, max_samples : int
        Of the other frames; ``max_samples`` is for these and changed ones.

    Frames that are smaller than the image trace as many fewer in each frame with history.
    """

    first_rays: int
    max_first_samples: int
    changed_rays: int
    rays: int
    max_samples: int

    def samples(self, frame: FrameState, texels: int, has_history: bool) -> range:
        """Which samples of its sequence each of ``texels`` takes in a frame, none of them twice."""
        first = min(self.max_first_samples, max(1, self.first_rays // texels))
        if not (has_history and frame.history_valid):
            return range(first)
        rays = self.changed_rays if frame.motion is MotionKind.OBJECTS else self.rays
        share = math.prod(frame.size) / math.prod(frame.output_size)
        count = min(self.max_samples, max(1, int(rays * share) // texels))
        return range(first + frame.index * count, first + (frame.index + 1) * count)
