"""Videos of frames."""

from collections.abc import Iterable
from itertools import chain
from pathlib import Path

from app.api.frame import Frame
from app.errors import SettingsError
from app.io.video import CODECS, check_video, open_video


def write_video(path: str | Path, frames: Iterable[Frame]) -> None:
    """Write a video of 30 frames per second, encoded while the frames are drawn.

    Parameters
    ----------
    path : str or Path
        Ends in ``.mp4``, ``.webm`` or ``.gif``.
    frames : iterable of Frame
        Of one size; H.264 needs an even width and height.

    Raises
    ------
    AfterglowError
        When the suffix or the size does not suit, there is no frame, or the extra ``video`` is not installed.
    """
    file, pending = Path(path), iter(frames)
    kind = file.suffix.removeprefix(".")
    if kind not in CODECS:
        raise SettingsError(f"unknown kind of video {file.suffix!r}", file, f"expected one of: {', '.join(CODECS)}")
    first = next(pending, None)
    if first is None:
        raise SettingsError("no frame given", file, "expected at least one")
    check_video([kind], first.size)
    with open_video(file, first.size) as write:
        for frame in chain([first], pending):
            write(frame.display)
