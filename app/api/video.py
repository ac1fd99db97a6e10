"""Videos of frames."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from app.api.checked import check_iterable, check_path
from app.api.frame import Frame
from app.errors import OutputError, SettingsError
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
    file = check_path(path, "video")
    kind = file.suffix.removeprefix(".")
    if kind not in CODECS:
        raise SettingsError(f"unknown kind of video {file.suffix!r}", file, f"expected one of: {', '.join(CODECS)}")
    failed: list[OSError] = []
    pending = _drawn(check_iterable(frames, "frames"), failed)
    first = next(pending, None)
    if first is None:
        raise SettingsError("no frame given", file, "expected at least one")
    size = _checked(first, file).size
    check_video([kind], size)
    try:
        with open_video(file, size) as write:
            for frame in chain([first], pending):
                write(_checked(frame, file, size).display)
    except OutputError:
        if not failed:
            raise
    if failed:
        raise failed[0]


def _drawn(frames: Iterable[Any], failed: list[OSError]) -> Iterator[Any]:
    """The frames; puts an error of drawing them into ``failed``, which would look like one of writing the video."""
    try:
        yield from frames
    except OSError as error:
        failed.append(error)
        raise


def _checked(frame: Any, file: Path, size: tuple[int, int] | None = None) -> Frame:
    if not isinstance(frame, Frame):
        raise SettingsError(f"can't write a {type(frame).__name__}", file, "expected frames, as a renderer gives them")
    if size is not None and frame.size != size:
        raise SettingsError(f"a frame has another size, {frame.size[0]}x{frame.size[1]}", file,
                            f"expected {size[0]}x{size[1]} as before")
    return frame
