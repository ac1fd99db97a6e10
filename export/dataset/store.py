"""One file for each pair: its target as OpenEXR, followed by a line of JSON.

EXR readers ignore the line. It says how the pair was generated, and has checksums of the image and of itself, so that
truncated and corrupt files are detected.
"""

import hashlib
import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from app.errors import AfterglowError, SceneError
from app.io.atomic_files import replace_file
from app.io.image import read_exr, write_exr
from export.dataset.plan import Choice
from export.dataset.target import Target

COMPRESSION = "dwaa:20"  # its error is a tenth of the targets' noise; see docs/dataset.md
REPAIR = "run python -m export dataset make --out {} again to repair it"


@dataclass(frozen=True)
class Origin:
    """How the pair of a file was generated; ``key`` is that of ``make.pair_key``."""

    choice: Choice
    key: str


def item_path(folder: Path, index: int) -> Path:
    """The file of a pair; there are a thousand in each sub-folder."""
    return folder / f"{index // 1000:04d}" / f"{index:07d}.exr"


def encode(target: Target, origin: Origin) -> bytes:
    """The content of a file."""
    layers = {name: np.minimum(image, np.finfo(np.float16).max).astype(np.float16)
              for name, image in target.layers.items()}
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
    """Write ``content`` atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replace_file(path) as temporary:
        temporary.write_bytes(content)


def read_origin(path: Path) -> Origin | None:
    """How the pair of a file was generated; None when the file is missing or corrupt."""
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
        raise SceneError("the dataset item is missing or corrupt", path, REPAIR.format(path.parents[1])) from None


def _digest(about: dict[str, object]) -> str:
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:16]
