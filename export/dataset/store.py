"""One file for each pair: its target as OpenEXR, and behind that a line of JSON.

Readers of EXR files don't mind the line. It says where the pair came from, and has checksums of the image and of
itself, so that a file that was cut or changed anywhere is found out.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.errors import AfterglowError, SceneError
from app.io.atomic_files import replacing
from app.io.image import read_exr, write_exr
from export.dataset.plan import Choice
from export.dataset.target import Target

COMPRESSION = "dwaa:20"  # loses a tenth of the targets' own noise; see docs/dataset.md


@dataclass(frozen=True)
class Origin:
    """What a file says about its pair; ``key`` is the content key of the pair and of what its target depends on."""

    choice: Choice
    key: str


def item_path(folder: Path, index: int) -> Path:
    """A thousand files in each sub-folder."""
    return folder / f"{index // 1000:04d}" / f"{index:07d}.exr"


def encode(target: Target, origin: Origin) -> bytes:
    """The content of a file."""
    layers = {name: _half(image) for name, image in target.layers.items()}
    first = next(iter(layers))
    layers[first] = np.concatenate([layers[first], target.seen[..., None].astype(np.float16)], axis=2)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "target.exr"
        write_exr(path, layers, COMPRESSION)
        image = path.read_bytes()
    about = {**asdict(origin), "image": hashlib.sha256(image).hexdigest()}
    text = json.dumps({**about, "about": _digest(about)})
    return image + b"\n" + text.encode()


def write_item(path: Path, content: bytes) -> None:
    """Write ``content`` in one step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def read_origin(path: Path) -> Origin | None:
    """Where the pair of a file came from; None when there is no such file, or it is corrupt."""
    try:
        image, _, line = path.read_bytes().rpartition(b"\n")
        about = json.loads(line)
        digest = about.pop("about")
        if digest != _digest(about) or about["image"] != hashlib.sha256(image).hexdigest():
            return None
        return Origin(Choice(**about["choice"]), about["key"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def read_target(path: Path) -> Target:
    """The target in a file.

    Raises
    ------
    SceneError
        When the file is missing or corrupt.
    """
    try:
        layers = read_exr(path)
        seen = next(image[..., 3] > 0.5 for image in layers.values() if image.shape[-1] == 4)
        return Target({name: np.where(seen[..., None], np.maximum(image[..., :3], 0), np.float32(0))
                       for name, image in layers.items()}, seen)
    except (AfterglowError, StopIteration):
        raise SceneError("no sound item of a dataset", path,
                         f"expected one; make it again: python -m export dataset --out {path.parents[1]}") from None


def _half(image: NDArray[np.float32]) -> NDArray[np.float16]:
    return np.minimum(image, np.finfo(np.float16).max).astype(np.float16)


def _digest(about: dict[str, object]) -> str:
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:16]
