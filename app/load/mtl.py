"""MTL files -> ``Material``. Colours are linear, textures sRGB-encoded; bump and reflection maps are ignored."""

from pathlib import Path

import numpy as np
from PIL import Image

from app.arrays import F64, Bytes
from app.load.images import read_image
from app.load.scene_builder import SceneBuilder, color
from app.scene import Material, Texture

_GLASS_MODELS = {4, 6, 7, 9}  # of ``illum``
_MIN_OPAQUE_ALPHA = 0.5
_OPTION_WORDS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
                 "-texres": 1, "-type": 1}
_OPTION_VECTORS = ("-o", "-s", "-t")

Values = dict[str, list[str]]

def read_mtl(folder: Path, names: str, builder: SceneBuilder) -> dict[str, Material]:
    """Materials by name from the MTL file, or files, of one ``mtllib`` line."""
    materials: dict[str, Material] = {}
    images: dict[Path, Bytes] = {}
    for name in [names] if find_file(folder, names) else names.split():
        path = find_file(folder, name)
        if path is None:
            builder.notice(f"the material file {name!r} is missing, so default materials are used")
            continue
        for material, values in _parse(path.read_bytes().decode("utf-8", errors="replace")):
            materials[material] = _MaterialBuilder(path.parent, images, builder).build(material, values)
    return materials


def find_file(folder: Path, name: str) -> Path | None:
    """Find a file named in an OBJ or MTL file, ignoring case and the kind of slash."""
    path = folder
    for part in Path(name.strip().strip('"').replace("\\", "/")).parts:
        exact = path / part
        if not exact.exists() and path.is_dir():
            exact = next((p for p in sorted(path.iterdir()) if p.name.lower() == part.lower()), exact)
        path = exact
    return path if path.is_file() else None


def _parse(text: str) -> list[tuple[str, Values]]:
    """The name of each material, and the words after each of its keywords."""
    entries: list[tuple[str, Values]] = []
    for line in text.splitlines():
        words = line.split("#")[0].split() if not line.lstrip().lower().startswith("map_") else line.split()
        if len(words) < 2:
            continue
        if words[0].lower() == "newmtl":
            entries.append((" ".join(words[1:]), {}))
        elif entries:
            entries[-1][1][words[0].lower()] = words[1:]
    return entries


class _MaterialBuilder:
    def __init__(self, folder: Path, images: dict[Path, Bytes], builder: SceneBuilder) -> None:
        self._folder, self._images, self._builder = folder, images, builder

    def build(self, name: str, values: Values) -> Material:
        albedo, emission, specular = (_color(values.get(k)) for k in ("kd", "ke", "ks"))
        albedo_map, emission_map, mask = (self._texture(name, values.get(k)) for k in ("map_kd", "map_ke", "map_d"))
        if albedo is None or (albedo_map is not None and max(albedo) == 0):
            albedo = (1.0, 1.0, 1.0) if albedo_map is not None else (0.8, 0.8, 0.8)
        if emission_map is not None and (emission is None or max(emission) == 0):
            emission = (1.0, 1.0, 1.0)
        alpha = _opacity(values)
        if mask is not None:
            albedo_map = _merge_mask(albedo_map, mask)
        masked = mask is not None or (albedo_map is not None and albedo_map.pixels[..., 3].min() < 128)
        is_glass = _number(values.get("illum"), 0.0) in _GLASS_MODELS or alpha < 1.0
        if is_glass and alpha >= _MIN_OPAQUE_ALPHA:
            self._builder.notice(f"material {name!r} is transparent but is drawn opaque")
        exponent = max(_number(values.get("ns"), 0.0), 0.0)
        return Material(
            name=name,
            albedo=_clamp(albedo),
            albedo_map=albedo_map,
            alpha=alpha,
            alpha_cutoff=0.5 if masked or alpha < _MIN_OPAQUE_ALPHA else None,
            emission=emission or (0.0, 0.0, 0.0),
            emission_map=emission_map,
            roughness=(2.0 / (exponent + 2.0)) ** 0.25,
            specular=_clamp(specular or (0.0, 0.0, 0.0)),
            double_sided=False,
        )

    def _texture(self, material: str, words: list[str] | None) -> Texture | None:
        if words is None:
            return None
        name, transform, clamped = _parse_map(words)
        path = find_file(self._folder, name)
        if path is None:
            self._builder.notice(f"material {material!r} is drawn without its texture {name!r}, which is missing")
            return None
        if path not in self._images:
            self._images[path] = read_image(path)
        return Texture(self._images[path], transform, (not clamped, not clamped))


def _parse_map(words: list[str]) -> tuple[str, F64, bool]:
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


def _merge_mask(colors: Texture | None, mask: Texture) -> Texture:
    """The colour texture with the mask in its alpha channel: the mask's alpha or, if it has none, its brightness."""
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
    """``d``, or else 1 − ``Tr``; files with both are often inconsistent, and ``d`` is the standard one."""
    opacity = _number(values["d"], 1.0) if "d" in values else 1.0 - _number(values.get("tr"), 0.0)
    return min(max(opacity, 0.0), 1.0)


def _color(words: list[str] | None) -> tuple[float, float, float] | None:
    if words is None or not _is_number(words[0]):
        return None
    numbers = [float(w) for w in words[:3]]
    return color(numbers if len(numbers) == 3 else [numbers[0]] * 3)


def _clamp(values: tuple[float, float, float]) -> tuple[float, float, float]:
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
