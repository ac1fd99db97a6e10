"""MTL files -> ``Material``, with the keys for physically based materials that Blender writes (Pr, Pm, norm …).

Colours are linear, colour textures sRGB-encoded. Height maps and maps of highlights are ignored.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from app.arrays import F64, Bytes
from app.errors import SceneError
from app.load.images import read_image
from app.load.scene_builder import SceneBuilder, color
from app.scene import Material, Texture

_GLASS_MODELS = {4, 6, 7, 9}  # of ``illum``
_MIRROR_MODELS = {3, 5, 8}     # which reflect their surroundings as well; so do glasses without a ``d``
_HIGHLIGHT_F0 = 0.08           # of Ks 1 in the others, so that 0.5, Blender's for a plain plastic, gives 0.04
_PLASTIC_F0 = 0.04             # where the keys for physically based materials stand without Ks
_NORMAL_MAP_BLUE = 0.25        # by which a map of normals is bluer than red and green; one of heights is grey
_IGNORED = "disp", "map_ka", "map_ks", "map_ns", "map_ps", "refl"
_OPTION_WORDS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
                 "-texres": 1, "-type": 1}
_OPTION_VECTORS = ("-o", "-s", "-t")

_COLORS = "kd", "ke", "ks"
_CHANNELS = {"r": 0, "g": 1, "b": 2, "m": 3}

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
    """Find a file named in an OBJ or MTL file, ignoring case and the kind of slash.

    Where there is none, as of paths that another machine wrote, the longest end of the path that is in ``folder``.
    """
    parts = Path(name.strip().strip('"').replace("\\", "/")).parts
    ends = (_find(folder, parts[first:]) for first in range(len(parts)))
    return next((path for path in ends if path is not None), None)


def _find(folder: Path, parts: tuple[str, ...]) -> Path | None:
    path = folder
    for part in parts:
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
        for key in (*_COLORS, "d", "tr", "ns", "pr", "pm"):
            if key in values and not all(map(_is_number, values[key][:3] if key in _COLORS else values[key][-1:])):
                said = " ".join((key, *values[key]))
                self._builder.notice(f"material {name!r}: {said!r} is no number, so it is ignored")
        albedo, emission, specular = (_color(values.get(k)) for k in _COLORS)
        albedo_map, emission_map, mask = (self._texture(name, values.get(k)) for k in ("map_kd", "map_ke", "map_d"))
        if albedo is None or (albedo_map is not None and max(albedo) == 0):
            albedo = (1.0, 1.0, 1.0) if albedo_map is not None else (0.8, 0.8, 0.8)
        if emission_map is not None and (emission is None or max(emission) == 0):
            emission = (1.0, 1.0, 1.0)
        alpha = _opacity(values)
        if alpha == 0.0:  # what is not there at all would not be in the file; some exporters invert the number
            self._builder.notice(f"material {name!r} would be invisible (d 0), so it is drawn opaque")
            alpha = 1.0
        if mask is not None:
            albedo_map = _merge_mask(albedo_map, mask)
        masked = mask is not None or (albedo_map is not None and albedo_map.pixels[..., 3].min() < 128)
        model = _number(values.get("illum"), 0.0)
        if model in _GLASS_MODELS and alpha == 1.0:
            self._builder.notice(f"material {name!r} is transparent but is drawn opaque")
        normal_map, strength = self._normal_map(name, values)
        if any(key in values for key in _IGNORED):
            self._builder.notice(f"maps of heights, highlights and reflections ({', '.join(_IGNORED)}) are ignored")
        exponent = max(_number(values.get("ns"), 0.0), 0.0)
        shine, metal = (_channel(self._detail(name, values.get(k)), values.get(k)) for k in ("map_pr", "map_pm"))
        is_physical = any(key in values for key in ("pr", "pm", "map_pr", "map_pm"))
        f0 = (_PLASTIC_F0,) * 3 if is_physical else (0.0,) * 3
        if specular is not None:
            is_mirror = model in _MIRROR_MODELS or (model in _GLASS_MODELS and alpha == 1.0)
            f0 = _scaled(specular, 1.0 if is_mirror else _HIGHLIGHT_F0)
        phong = (2.0 / (exponent + 2.0)) ** 0.25
        return Material(
            name=name,
            albedo=_clamp(albedo),
            albedo_map=albedo_map,
            alpha=alpha,
            alpha_cutoff=0.5 * alpha if masked else None,
            is_blended=alpha < 1.0 and not masked,
            emission=emission or (0.0, 0.0, 0.0),
            emission_map=emission_map,
            roughness=min(max(_number(values.get("pr"), 1.0 if shine is not None else phong), 0.0), 1.0),
            metallic=min(max(_number(values.get("pm"), 1.0 if metal is not None else 0.0), 0.0), 1.0),
            metallic_roughness_map=_pack(shine, metal),
            normal_map=normal_map,
            normal_scale=strength,
            specular=_clamp(f0),
            double_sided=False,
        )

    def _normal_map(self, material: str, values: Values) -> tuple[Texture | None, float]:
        """The map of normals and its strength; that of ``bump`` may be one too, but is of heights by the standard."""
        for key in ("norm", "map_bump", "bump"):
            texture = self._detail(material, values.get(key))
            if texture is None:
                continue
            red, green, blue = texture.pixels[..., :3].mean(axis=(0, 1), dtype=np.float64) / 255
            if blue - (red + green) / 2 > _NORMAL_MAP_BLUE:
                return replace(texture, is_color=False), _number(_option(values[key], "-bm"), 1.0)
            self._builder.notice("maps of heights (bump) are ignored")
        return None, 1.0

    def _detail(self, material: str, words: list[str] | None) -> Texture | None:
        """A texture that the material can do without, if it can't be read."""
        try:
            return self._texture(material, words)
        except SceneError as error:
            self._builder.notice(f"material {material!r} is drawn without a texture: {error}")
            return None

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


def _pack(roughness: Texture | None, metal: Texture | None) -> Texture | None:
    """Grey images of roughness and metal in the green and the blue channel of one."""
    given = max((t for t in (roughness, metal) if t is not None), key=lambda t: t.pixels.size, default=None)
    if given is None:
        return None
    height, width = given.pixels.shape[:2]
    pixels = np.full((height, width, 4), 255, np.uint8)
    for channel, texture in ((1, roughness), (2, metal)):
        if texture is not None:
            image = Image.fromarray(np.asarray(texture.pixels[..., 0], np.uint8))
            pixels[..., channel] = np.asarray(image.resize((width, height), Image.Resampling.BILINEAR))
    return Texture(pixels, given.transform, given.repeat, is_color=False)


def _channel(texture: Texture | None, words: list[str] | None) -> Texture | None:
    """A grey image of the channel that ``-imfchan`` names; by default of all three, which are alike in grey images."""
    if texture is None or words is None:
        return None
    channel = _CHANNELS.get((_option(words, "-imfchan") or [""])[-1].lower())
    pixels = texture.pixels[..., :3]
    grey = pixels.mean(axis=-1).round() if channel is None else texture.pixels[..., channel]
    return replace(texture, pixels=np.repeat(np.asarray(grey, np.uint8)[..., None], 4, axis=-1))


def _option(words: list[str], name: str) -> list[str] | None:
    """The word after an option of a ``map_`` line."""
    lower = [word.lower() for word in words]
    at = lower.index(name) + 1 if name in lower else len(words)
    return words[at:at + 1] or None


def _scaled(values: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    return values[0] * factor, values[1] * factor, values[2] * factor


def _opacity(values: dict[str, list[str]]) -> float:
    """``d``, or else 1 − ``Tr``; files with both are often inconsistent, and ``d`` is the standard one."""
    opacity = _number(values["d"], 1.0) if "d" in values else 1.0 - _number(values.get("tr"), 0.0)
    return min(max(opacity, 0.0), 1.0)


def _color(words: list[str] | None) -> tuple[float, float, float] | None:
    if words is None or not all(map(_is_number, words[:3])):
        return None
    numbers = [float(w) for w in words[:3]]
    return color(numbers if len(numbers) == 3 else [numbers[0]] * 3)


def _clamp(values: tuple[float, float, float]) -> tuple[float, float, float]:
    return min(values[0], 1.0), min(values[1], 1.0), min(values[2], 1.0)


def _number(words: list[str] | None, default: float) -> float:
    return float(words[-1]) if words and _is_number(words[-1]) else default


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
