"""MTL files -> Material. Colours are linear, textures sRGB; bump and reflection maps are left out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.load.images import read_image
from app.load.scene_builder import SceneBuilder, color
from app.scene import Material, Texture

_GLASS = {4, 6, 7, 9}
_TRANSPARENT_BELOW = 0.5
_OPTION_WORDS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
                 "-texres": 1, "-type": 1}
_OPTION_VECTORS = ("-o", "-s", "-t")


@dataclass
class _Entry:
    name: str
    values: dict[str, list[str]] = field(default_factory=dict)


def read_mtl(folder: Path, names: str, builder: SceneBuilder) -> dict[str, Material]:
    """Materials by name from the MTL file, or the files, of one ``mtllib`` line."""
    found: dict[str, Material] = {}
    images: dict[Path, NDArray[np.uint8]] = {}
    for name in [names] if locate(folder, names) else names.split():
        path = locate(folder, name)
        if path is None:
            builder.notice(f"the material file {name!r} is missing: default materials are used")
            continue
        for entry in _entries(path.read_bytes().decode("utf-8", errors="replace")):
            found[entry.name] = _Builder(path.parent, images, builder).build(entry)
    return found


def locate(folder: Path, name: str) -> Path | None:
    """A file named in an OBJ or MTL file; upper and lower case and kinds of slash don't matter."""
    path = folder
    for part in Path(name.strip().strip('"').replace("\\", "/")).parts:
        exact = path / part
        if not exact.exists() and path.is_dir():
            exact = next((p for p in sorted(path.iterdir()) if p.name.lower() == part.lower()), exact)
        path = exact
    return path if path.is_file() else None


def _entries(text: str) -> list[_Entry]:
    entries: list[_Entry] = []
    for line in text.splitlines():
        words = line.split("#")[0].split() if not line.lstrip().lower().startswith("map_") else line.split()
        if len(words) < 2:
            continue
        if words[0].lower() == "newmtl":
            entries.append(_Entry(" ".join(words[1:])))
        elif entries:
            entries[-1].values[words[0].lower()] = words[1:]
    return entries


class _Builder:
    def __init__(self, folder: Path, images: dict[Path, NDArray[np.uint8]], builder: SceneBuilder) -> None:
        self._folder, self._images, self._builder = folder, images, builder

    def build(self, entry: _Entry) -> Material:
        values = entry.values
        albedo, emission, specular = (_color(values.get(k)) for k in ("kd", "ke", "ks"))
        albedo_map, emission_map = self._texture(entry, "map_kd"), self._texture(entry, "map_ke")
        if albedo is None or (albedo_map is not None and max(albedo) == 0):
            albedo = (1.0, 1.0, 1.0) if albedo_map is not None else (0.8, 0.8, 0.8)
        if emission_map is not None and (emission is None or max(emission) == 0):
            emission = (1.0, 1.0, 1.0)
        alpha = _opacity(values)
        mask = self._texture(entry, "map_d")
        if mask is not None:
            albedo_map = _with_mask(albedo_map, mask)
        masked = mask is not None or (albedo_map is not None and albedo_map.pixels[..., 3].min() < 128)
        self._tell_about_glass(entry, alpha)
        exponent = max(_number(values.get("ns"), 0.0), 0.0)
        return Material(
            name=entry.name,
            albedo=_at_most_one(albedo),
            albedo_map=albedo_map,
            alpha=alpha,
            alpha_cutoff=0.5 if masked or alpha < _TRANSPARENT_BELOW else None,
            emission=emission or (0.0, 0.0, 0.0),
            emission_map=emission_map,
            roughness=(2.0 / (exponent + 2.0)) ** 0.25,
            specular=_at_most_one(specular or (0.0, 0.0, 0.0)),
            double_sided=False,
        )

    def _tell_about_glass(self, entry: _Entry, alpha: float) -> None:
        glass = _number(entry.values.get("illum"), 0.0) in _GLASS or alpha < 1.0
        if glass and alpha >= _TRANSPARENT_BELOW:
            self._builder.notice(f"material {entry.name!r} lets light through: it is drawn opaque")

    def _texture(self, entry: _Entry, key: str) -> Texture | None:
        words = entry.values.get(key)
        if words is None:
            return None
        name, transform, clamped = _map_options(words)
        path = locate(self._folder, name)
        if path is None:
            self._builder.notice(f"material {entry.name!r}: the texture {name!r} is missing, its plain colour is used")
            return None
        if path not in self._images:
            self._images[path] = read_image(path)
        return Texture(self._images[path], transform, (not clamped, not clamped))


def _map_options(words: list[str]) -> tuple[str, NDArray[np.float64], bool]:
    """File name, uv transform (scale, then offset) and clamping of a ``map_`` line."""
    at, clamped, vectors = 0, False, {"-s": [1.0, 1.0], "-o": [0.0, 0.0]}
    while at < len(words) - 1 and words[at].startswith("-"):
        option = words[at].lower()
        at += 1
        if option in _OPTION_VECTORS:
            numbers: list[float] = []
            while len(numbers) < 3 and at < len(words) - 1 and _is_number(words[at]):
                numbers.append(_number([words[at]], 1.0 if option == "-s" else 0.0))
                at += 1
            if option in vectors:
                vectors[option][:len(numbers[:2])] = numbers[:2]
        else:
            clamped |= option == "-clamp" and words[at].lower() == "on"
            at += _OPTION_WORDS.get(option, 0)
    (su, sv), (ou, ov) = vectors["-s"], vectors["-o"]
    return " ".join(words[at:]), np.array([[su, 0.0, ou], [0.0, sv, ov], [0.0, 0.0, 1.0]]), clamped


def _with_mask(colors: Texture | None, mask: Texture) -> Texture:
    """The colour texture with the mask's alpha, or with its brightness where it has no alpha, in the alpha channel."""
    alpha = mask.pixels[..., 3]
    if alpha.min() == 255:
        alpha = mask.pixels[..., :3].max(axis=2)
    if colors is None:
        white = np.full_like(mask.pixels, 255)
        white[..., 3] = alpha
        return Texture(white, mask.transform, mask.repeat)
    pixels = np.array(colors.pixels, np.uint8)
    height, width = pixels.shape[:2]
    pixels[..., 3] = np.asarray(Image.fromarray(alpha).resize((width, height), Image.Resampling.BILINEAR))
    return Texture(pixels, colors.transform, colors.repeat)


def _opacity(values: dict[str, list[str]]) -> float:
    """``d``, or else 1 − ``Tr``: files that give both contradict themselves, and ``d`` is the standard one."""
    opacity = _number(values["d"], 1.0) if "d" in values else 1.0 - _number(values.get("tr"), 0.0)
    return min(max(opacity, 0.0), 1.0)


def _color(words: list[str] | None) -> tuple[float, float, float] | None:
    if words is None or not _is_number(words[0]):
        return None
    numbers = [float(w) for w in words[:3]]
    return color(numbers if len(numbers) == 3 else [numbers[0]] * 3)


def _at_most_one(values: tuple[float, float, float]) -> tuple[float, float, float]:
    return min(values[0], 1.0), min(values[1], 1.0), min(values[2], 1.0)


def _number(words: list[str] | None, default: float) -> float:
    value = float(words[-1]) if words and _is_number(words[-1]) else default
    return value if np.isfinite(value) else default


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
