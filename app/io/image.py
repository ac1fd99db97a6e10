"""EXR and PNG files through OpenImageIO, and the sRGB transfer. Arrays have their top row first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from app.errors import OutputError, SceneError
from app.io.atomic_files import replacing

F32 = NDArray[np.float32]
Image = NDArray[np.float16] | F32

COMPONENTS = "RGBA"
COLORS = COMPONENTS[:3]
RADIANCE_FILES = (".exr", ".hdr")  # that hold linear values


def srgb_encode(linear: NDArray[np.floating[Any]]) -> F32:
    """Clamp linear values to 0..1 and apply the sRGB transfer of IEC 61966-2-1."""
    x = np.clip(linear, 0.0, 1.0).astype(np.float32)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055).astype(np.float32)


def srgb_decode(encoded: NDArray[np.floating[Any]]) -> F32:
    """The linear values that ``srgb_encode`` maps to 0..1."""
    x = np.clip(encoded, 0.0, 1.0).astype(np.float32)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** np.float32(2.4)).astype(np.float32)


def to_8bit(values: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Round 0..1 to the nearest of 256 levels."""
    return (np.clip(values, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def write_exr(path: Path, layers: Mapping[str, Image], compression: str = "zip") -> None:
    """Write named layers into one EXR; the same layers give the same bytes.

    Parameters
    ----------
    path : Path
        Ends in ``.exr``.
    layers : mapping of str to ndarray, float16 or float32, shape (H, W, 1 to 4)
        The layer ``""`` goes to the channels ``R, G, B``, any other to ``name.R, name.G, name.B``; a layer of
        fewer components takes the first of these, a fourth one is ``A``. float16 is stored as half, float32 as float.
    compression : str
        One of OpenEXR's, such as ``zip``, which loses nothing, or ``dwaa:45``, which does, but not in ``A``.

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
    # Without this the writer stores the time of day.
    spec.attribute("DateTime", "")
    spec.attribute("compression", compression)
    _write(path, spec, pixels)


def write_png(path: Path, display: NDArray[np.uint8]) -> None:
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
    """Layers of an EXR by name, as ``write_exr`` takes them, in float32.

    Raises
    ------
    SceneError
        When the file can't be read.
    """
    pixels, names = _read(path, oiio.FLOAT)
    found: dict[str, dict[str, int]] = {}
    for index, name in enumerate(names):
        layer, _, component = name.rpartition(".")
        found.setdefault(layer, {})[component] = index
    return {layer: pixels[..., [parts[c] for c in sorted(parts, key=_component_order)]]
            for layer, parts in found.items()}


def read_radiance(path: Path) -> F32:
    """The picture in an HDR or EXR file, float32, shape (H, W, 3); a grey one in all three colours, without alpha.

    Raises
    ------
    SceneError
        When the file can't be read or is of another kind.
    """
    if path.suffix.lower() not in RADIANCE_FILES:
        raise SceneError(f"an image of the kind {path.suffix!r}", path, f"expected one of {', '.join(RADIANCE_FILES)}")
    pixels, names = _read(path, oiio.FLOAT, "HDR or EXR")
    of = {name: index for index, name in reversed(list(enumerate(names)))}
    rgb = [of.get(name, 0 if len(names) < len(COLORS) else index) for index, name in enumerate(COLORS)]
    return np.ascontiguousarray(pixels[..., rgb])


def read_png(path: Path) -> NDArray[np.uint8]:
    """Read the stored 8-bit values, shape (H, W, C).

    Raises
    ------
    SceneError
        When the file can't be read.
    """
    pixels: NDArray[np.uint8] = _read(path, oiio.UINT8)[0]
    return pixels


def _component_order(component: str) -> tuple[int, str]:
    return (COMPONENTS.find(component) if component in COMPONENTS else len(COMPONENTS), component)


def _write(path: Path, spec: Any, pixels: NDArray[Any]) -> None:
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        assert output is not None, oiio.geterror()
        if not (output.open(str(temporary), spec) and output.write_image(np.ascontiguousarray(pixels))
                and output.close()):
            raise OutputError(f"can't write the image ({output.geterror()})", path,
                              "expected a writable place with room for it")


def _read(path: Path, kind: Any, expected: str = "EXR or PNG") -> tuple[Any, tuple[str, ...]]:
    try:
        source = oiio.ImageInput.open(str(path))
        if source is None:
            raise _unreadable(oiio.geterror(), path, expected)
        pixels, names = source.read_image(0, 0, 0, source.spec().nchannels, kind), source.spec().channelnames
        reason = source.geterror()
        source.close()
    except (UnicodeDecodeError, TypeError):  # of what the file says, or of its name
        raise _unreadable("its text is no UTF-8", path, expected) from None
    if pixels is None or reason:
        raise _unreadable(reason, path, expected)
    return pixels, names


def _unreadable(reason: str, path: Path, expected: str) -> SceneError:
    return SceneError(f"can't read the image ({' '.join(reason.split())})", path, f"expected a whole {expected} file")
