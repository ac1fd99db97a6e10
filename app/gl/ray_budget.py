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
        """Which samples of its sequence each of ``texels`` takes: others in each frame while the same things move."""
        return self.turns(frame, texels, has_history, 1)[1]

    def turns(self, frame: FrameState, texels: int, has_history: bool, most: int) -> tuple[int, range]:
        """Of how many frames a texel takes samples in one, at most ``most``, a power of 2, and which ones then.

        It is more than one only where not each texel could have a sample in each frame.
        """
        first = min(self.max_first_samples, max(1, self.first_rays // texels))
        if not (has_history and frame.history_valid):
            return 1, range(first)
        rays = self.changed_rays if frame.motion is MotionKind.OBJECTS else self.rays
        rays = max(1, int(rays * math.prod(frame.size) / math.prod(frame.output_size)))
        turns = min(most, 2 ** math.ceil(math.log2(max(1.0, texels / rays))))
        count = min(self.max_samples, max(1, rays * turns // texels))
        start = first + frame.index // turns * count
        return turns, range(start, start + count)
