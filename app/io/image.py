"""EXR, HDR and PNG files through OpenImageIO, and the sRGB transfer function. Arrays have their top row first."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from app.arrays import F32, Bytes, Floats
from app.errors import OutputError, SceneError
from app.io.atomic_files import replace_file

Image = NDArray[np.float16] | F32
Real = TypeVar("Real", np.float32, np.float64)

COMPONENTS = "RGBA"
COLORS = COMPONENTS[:3]
RADIANCE_SUFFIXES = (".exr", ".hdr")
EXACT = ("depth", "position", "motion", "flow", "instance", "material")  # AOVs that are no radiance
HALF_MAX = 65504.0
MIN_HALF_PEAK = 2**-8  # images that are darker lose precision as half floats


def srgb_encode(linear: Floats) -> F32:
    """Clamp linear values to 0..1 and apply the sRGB transfer function of IEC 61966-2-1."""
    x = np.clip(linear, 0.0, 1.0).astype(np.float32)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055).astype(np.float32)


def srgb_decode(encoded: NDArray[Real]) -> NDArray[Real]:
    """Clamp sRGB-encoded values to 0..1 and make them linear; the inverse of ``srgb_encode``."""
    x = np.clip(encoded, 0.0, 1.0)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(encoded.dtype)


def to_8bit(values: Floats) -> Bytes:
    """Round 0..1 to the nearest of 256 levels."""
    return (np.clip(values, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def exr_layer(name: str, values: NDArray[Any]) -> Image:
    """AOV ``name`` as it is stored: half floats, but for lengths, ids, and radiance that they can't represent."""
    values = values.astype(np.float32, copy=False)
    peak = float(np.abs(values).max())
    return values if name in EXACT or not MIN_HALF_PEAK <= peak <= HALF_MAX else values.astype(np.float16)


def write_exr(path: Path, layers: Mapping[str, Image], compression: str = "zip",
              header: Mapping[str, str] | None = None) -> None:
    """Write named layers into one EXR file; the same layers give the same bytes.

    Parameters
    ----------
    path : Path
        Ends in ``.exr``.
    layers : mapping of str to ndarray, float16 or float32, shape (H, W, 1 to 4)
        The layer ``""`` is stored in the channels ``R, G, B, A``, any other in ``name.R`` and so on; a layer of fewer
        components uses the first of them. float16 is stored as half, float32 as float.
    compression : str
        A method of OpenEXR, such as the lossless ``zip``, or ``dwaa:45``, which is lossy except for ``A``.
    header : mapping of str to str, optional
        Further attributes.

    Raises
    ------
    OutputError
        When the file can't be written.
    """
    names = [f"{layer}.{c}".lstrip(".") for layer, a in layers.items() for c in COMPONENTS[:a.shape[2]]]
    formats = [oiio.HALF if a.dtype == np.float16 else oiio.FLOAT for a in layers.values() for _ in range(a.shape[2])]
    pixels = np.concatenate([a.astype(np.float32) for a in layers.values()], axis=2)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], len(names), oiio.FLOAT)
    spec.channelnames, spec.channelformats = tuple(names), tuple(formats)
    # Otherwise the writer stores the current time.
    spec.attribute("DateTime", "")
    spec.attribute("compression", compression)
    for name, text in (header or {}).items():
        spec.attribute(name, text)
    _write(path, spec, pixels)


def write_png(path: Path, display: Bytes) -> None:
    """Write an sRGB-encoded image, shape (H, W, 3), as PNG.

    Raises
    ------
    OutputError
        When the file can't be written.
    """
    spec = oiio.ImageSpec(display.shape[1], display.shape[0], display.shape[2], oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    _write(path, spec, display)


def read_exr(path: Path) -> dict[str, F32]:
    """Read the layers of an EXR file by name, as ``write_exr`` takes them, in float32.

    Raises
    ------
    SceneError
        When the file can't be read.
    """
    pixels, names = _read(path, oiio.FLOAT)
    layers: dict[str, dict[str, int]] = {}
    for index, name in enumerate(names):
        layer, _, component = name.rpartition(".")
        layers.setdefault(layer, {})[component] = index
    return {layer: pixels[..., [channels[c] for c in sorted(channels, key=_component_order)]]
            for layer, channels in layers.items()}


def read_exr_header(path: Path) -> dict[str, str]:
    """The attributes of an EXR file that are texts, by name.

    Raises
    ------
    SceneError
        When the file can't be read.
    """
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise _unreadable(oiio.geterror(), path, "EXR")
    attributes = source.spec().extra_attribs
    source.close()
    return {a.name: a.value for a in attributes if isinstance(a.value, str)}


def read_radiance(path: Path) -> F32:
    """Read the linear RGB values of an HDR or EXR file, float32, shape (H, W, 3); grey is repeated, alpha dropped.

    Raises
    ------
    SceneError
        When the file can't be read or has another format.
    """
    if path.suffix.lower() not in RADIANCE_SUFFIXES:
        raise SceneError(f"unsupported image format {path.suffix!r}", path,
                         f"expected one of {', '.join(RADIANCE_SUFFIXES)}")
    pixels, names = _read(path, oiio.FLOAT, "HDR or EXR")
    channel = {name: index for index, name in reversed(list(enumerate(names)))}
    rgb = [channel.get(name, 0 if len(names) < len(COLORS) else index) for index, name in enumerate(COLORS)]
    return np.ascontiguousarray(pixels[..., rgb])


def read_png(path: Path) -> Bytes:
    """Read the stored 8-bit values, shape (H, W, C).

    Raises
    ------
    SceneError
        When the file can't be read.
    """
    pixels: Bytes = _read(path, oiio.UINT8)[0]
    return pixels


def _component_order(component: str) -> tuple[int, str]:
    return (COMPONENTS.find(component) if component in COMPONENTS else len(COMPONENTS), component)


def _write(path: Path, spec: Any, pixels: NDArray[Any]) -> None:
    with replace_file(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        assert output is not None, oiio.geterror()
        if not (output.open(str(temporary), spec) and output.write_image(np.ascontiguousarray(pixels))
                and output.close()):
            raise OutputError(f"can't write the image: {output.geterror()}", path,
                              "expected a writable folder with enough space")


def _read(path: Path, kind: Any, expected: str = "EXR or PNG") -> tuple[Any, tuple[str, ...]]:
    if not path.exists():
        raise SceneError("no such image file", path, f"expected the path of an existing {expected} file")
    try:
        source = oiio.ImageInput.open(str(path))
        if source is None:
            raise _unreadable(oiio.geterror(), path, expected)
        pixels, names = source.read_image(0, 0, 0, source.spec().nchannels, kind), source.spec().channelnames
        reason = source.geterror()
        source.close()
    except (UnicodeDecodeError, TypeError):  # from text in the file, or from its name
        raise _unreadable("its text is not UTF-8", path, expected) from None
    if pixels is None or reason:
        raise _unreadable(reason, path, expected)
    return pixels, names


def _unreadable(reason: str, path: Path, expected: str) -> SceneError:
    return SceneError(f"can't read the image: {' '.join(reason.split())}", path, f"expected a complete {expected} file")
