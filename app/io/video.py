"""Frames as a video file, encoded while they are drawn, by the FFmpeg libraries that the package ``av`` carries."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import OutputError, SettingsError
from app.extras import extra_module
from app.io.atomic_files import replacing

RATE = 30  # frames a second
EXTRA = "video"
BT709, SRGB, LIMITED = 1, 13, 1  # as in ITU-T H.273
# A palette of its own for each frame, so that nothing waits for the last one.
PALETTES = (("split", None), ("palettegen", "stats_mode=single"), ("paletteuse", "new=1:dither=sierra2_4a"))

Picture = NDArray[np.uint8]
Write = Callable[[Picture], None]


@dataclass(frozen=True)
class Codec:
    """How one kind of file is encoded; ``multiple_of`` is what its sides must be."""

    name: str
    pixels: str
    multiple_of: int = 1
    options: dict[str, str] = field(default_factory=dict)


CODECS = {
    "mp4": Codec("libx264", "yuv420p", 2, {"crf": "16", "preset": "medium"}),
    "webm": Codec("libvpx-vp9", "yuv420p", 1, {"crf": "20", "b": "0", "deadline": "good", "cpu-used": "4"}),
    "gif": Codec("gif", "pal8"),
}


def check_video(kinds: Iterable[str], size: tuple[int, int]) -> None:
    """See to it, before the first frame is drawn, that videos of these ``kinds`` and ``size`` can be written.

    Raises
    ------
    MissingExtraError
        When PyAV is not installed.
    SettingsError
        When it has no encoder for a kind, or one can't take this width and height.
    """
    for kind in kinds:
        av, codec = extra_module("av", EXTRA), CODECS[kind]
        try:
            av.codec.Codec(codec.name, "w")
        except ValueError:
            raise SettingsError(f"no encoder {codec.name} for {kind}", "--format", "expected a kind that this build of "
                                f"PyAV can write: the one of pip install 'afterglow[{EXTRA}]' can") from None
        n = codec.multiple_of
        if any(side % n for side in size):
            raise SettingsError(f"{kind} can't be {size[0]}x{size[1]}", "--size", f"expected sides divisible by {n}")


@contextlib.contextmanager
def video(path: Path, size: tuple[int, int]) -> Iterator[Write]:
    """Give a function that appends one frame, uint8 [H, W, 3], top row first, sRGB; ``RATE`` of them make a second.

    The file appears when the block succeeds.

    Parameters
    ----------
    path : Path
        Its suffix is one of ``CODECS``.
    size : tuple of int
        Width and height of every frame.

    Raises
    ------
    OutputError
        When encoding or writing fails; nothing is left behind.
    """
    av = extra_module("av", EXTRA)
    kind = path.suffix.removeprefix(".")
    try:
        with replacing(path) as temporary, _opened(av, temporary, kind) as container:
            stream = _stream(container, CODECS[kind], size)
            prepared = _palettes(av, size) if kind == "gif" else _bt709

            def write(picture: Picture) -> None:
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
                container.mux(stream.encode(prepared(frame)))

            yield write
            container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise OutputError(f"can't write the video ({error})", path, "expected a writable place with room") from error


def _opened(av: Any, path: Path, kind: str) -> Any:
    return av.open(str(path), "w", format=kind, container_options={"fflags": "+bitexact"})  # no random numbers


def _stream(container: Any, codec: Codec, size: tuple[int, int]) -> Any:
    stream = container.add_stream(codec.name, rate=RATE, options=codec.options)
    stream.width, stream.height = size
    stream.pix_fmt = codec.pixels
    context = stream.codec_context
    if codec.pixels.startswith("yuv"):
        context.colorspace, context.color_primaries = BT709, BT709
        context.color_trc, context.color_range = SRGB, LIMITED
    return stream


def _bt709(frame: Any) -> Any:
    return frame.reformat(format="yuv420p", dst_colorspace="itu709", dst_color_range=LIMITED)


def _palettes(av: Any, size: tuple[int, int]) -> Callable[[Any], Any]:
    """What turns a frame into one of 256 colours, by FFmpeg's filters."""
    graph = av.filter.Graph()
    source = graph.add_buffer(width=size[0], height=size[1], format="rgb24", time_base="1/30")
    split, generate, use = (graph.add(name, args) for name, args in PALETTES)
    sink = graph.add("buffersink")
    source.link_to(split)
    split.link_to(use, 0, 0)
    split.link_to(generate, 1, 0)
    generate.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    count = 0

    def prepared(frame: Any) -> Any:
        nonlocal count
        frame.pts, count = count, count + 1
        graph.push(frame)
        return graph.pull()

    return prepared
