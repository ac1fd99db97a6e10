"""The size at which frames are drawn while something moves: as large as a frame rate allows."""

from collections import deque

from app.settings import MIN_RENDER_SCALE

SCALES = (1.0, 0.75, MIN_RENDER_SCALE)  # relative to the image
MEASURED_FRAMES = 3   # whose median decides, so that one slow frame does not
MAX_PREDICTED = 0.8   # of a frame's time that a larger size is predicted to take, so that sizes don't alternate


class MotionScale:
    """Follows the times of frames.

    Parameters
    ----------
    target_fps : float
        Frames per second to reach; 0 to draw all frames at the image's size.
    """

    def __init__(self, target_fps: float) -> None:
        self._budget = 1 / target_fps if target_fps else float("inf")  # seconds
        self._index = 0
        self._seconds: deque[float] = deque(maxlen=MEASURED_FRAMES)

    @property
    def scale(self) -> float:
        """The render scale of the next frame that answers an input."""
        return SCALES[self._index]

    def measure(self, seconds: float) -> None:
        """Take into account how long a frame at ``scale`` took."""
        self._seconds.append(seconds)
        if len(self._seconds) < MEASURED_FRAMES:
            return
        median = sorted(self._seconds)[MEASURED_FRAMES // 2]
        if median > self._budget and self._index < len(SCALES) - 1:
            self._change_to(self._index + 1)
        elif self._index > 0:
            larger = SCALES[self._index - 1]
            if median * (larger / self.scale) ** 2 < MAX_PREDICTED * self._budget:
                self._change_to(self._index - 1)

    def _change_to(self, index: int) -> None:
        self._index = index
        self._seconds.clear()
