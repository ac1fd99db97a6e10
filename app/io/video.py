"""Video files, encoded frame by frame by the FFmpeg libraries in the package ``av``."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.arrays import Bytes
from app.errors import OutputError, SettingsError
from app.extras import extra_module
from app.io.atomic_files import replace_file

RATE = 30  # frames per second
EXTRA = "video"
BT709, SRGB, LIMITED = 1, 13, 1  # code points of ITU-T H.273
# Each frame has its own palette, so that encoding need not wait for the last frame.
PALETTES = (("split", None), ("palettegen", "stats_mode=single"), ("paletteuse", "new=1:dither=sierra2_4a"))

WriteFrame = Callable[[Bytes], None]


@dataclass(frozen=True)
class Codec:
    """How a file format is encoded; width and height are divisible by ``multiple_of``."""

    name: str
    pixels: str
    multiple_of: int = 1
    options: dict[str, str] = field(default_factory=dict)


CODECS = {
    "mp4": Codec("libx264", "yuv420p", 2, {"crf": "16", "preset": "medium"}),
    "webm": Codec("libvpx-vp9", "yuv420p", 1, {"crf": "20", "b": "0", "deadline": "good", "cpu-used": "4"}),
    "gif": Codec("gif", "pal8"),
}


def check_video(formats: Iterable[str], size: tuple[int, int]) -> None:
    """Check, before the first frame is drawn, that videos in these ``formats`` can have this ``size``.

    Raises
    ------
    MissingExtraError
        When PyAV is not installed.
    SettingsError
        When it has no encoder for a format, or the encoder does not support this width and height.
    """
    for name in formats:
        av, codec = extra_module("av", EXTRA), CODECS[name]
        try:
            av.codec.Codec(codec.name, "w")
        except ValueError:
            raise SettingsError(f"this build of PyAV has no encoder {codec.name}", name,
                                f"expected the build of pip install 'afterglow[{EXTRA}]'") from None
        if any(side % codec.multiple_of for side in size):
            raise SettingsError(f"{name} does not support {size[0]}x{size[1]}", "size",
                                f"expected sides divisible by {codec.multiple_of}")


@contextlib.contextmanager
def open_video(path: Path, size: tuple[int, int]) -> Iterator[WriteFrame]:
    """Give a function that appends one frame, sRGB uint8 [H, W, 3], top row first, at ``RATE`` frames per second.

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
    name = path.suffix.removeprefix(".")
    # Without bitexact, muxers store random numbers.
    options = {"container_options": {"fflags": "+bitexact"}}
    try:
        with replace_file(path) as temporary, av.open(str(temporary), "w", format=name, **options) as container:
            stream = _add_stream(container, CODECS[name], size)
            convert = _make_palette_filter(av, size) if name == "gif" else _to_bt709

            def write(pixels: Bytes) -> None:
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
                container.mux(stream.encode(convert(frame)))

            yield write
            container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise OutputError(f"can't write the video: {error}", path,
                          "expected a writable folder with enough space") from error


def _add_stream(container: Any, codec: Codec, size: tuple[int, int]) -> Any:
    stream = container.add_stream(codec.name, rate=RATE, options=codec.options)
    stream.width, stream.height = size
    stream.pix_fmt = codec.pixels
    context = stream.codec_context
    if codec.pixels.startswith("yuv"):
        context.colorspace, context.color_primaries = BT709, BT709
        context.color_trc, context.color_range = SRGB, LIMITED
    return stream


def _to_bt709(frame: Any) -> Any:
    return frame.reformat(format="yuv420p", dst_colorspace="itu709", dst_color_range=LIMITED)


def _make_palette_filter(av: Any, size: tuple[int, int]) -> Callable[[Any], Any]:
    """A function that reduces a frame to 256 colours, through FFmpeg's filters."""
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

    def convert(frame: Any) -> Any:
        nonlocal count
        frame.pts, count = count, count + 1
        graph.push(frame)
        return graph.pull()

    return convert
