"""glTF textures -> Texture: images are decoded once, samplers and uv transforms become what Texture can hold."""

from typing import Any, Literal

import numpy as np

from app.arrays import F64, Bytes
from app.load.gltf_file import GltfFile
from app.load.images import decode_image
from app.load.scene_builder import SceneBuilder
from app.scene import Texture

MAX_UV_SETS = 2  # of a material

_REPEAT = 10497
_MIRRORED_REPEAT = 33648
_NEAREST = 9728
_V_FLIP = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])


class TextureReader:
    """Reads the textures of one file.

    Attributes
    ----------
    uv_sets : list of int
        The file's uv sets that the textures read since ``begin_material`` use; ``Texture.uv_set`` is an index into it.
    """

    def __init__(self, file: GltfFile, builder: SceneBuilder) -> None:
        self._file, self._builder = file, builder
        self._pixels: dict[int, Bytes] = {}
        self._mirrored: dict[tuple[int, bool, bool], Bytes] = {}
        self._material = ""
        self.uv_sets: list[int] = []

    def begin_material(self, name: str) -> None:
        """Let the textures that follow belong to another material."""
        self._material, self.uv_sets = name, []

    def read(self, info: dict[str, Any] | None, is_color: bool = False) -> Texture | None:
        """The texture of a material's texture reference; None without one or if its format is unsupported."""
        if info is None:
            return None
        texture = self._file.json["textures"][info["index"]]
        source = texture.get("extensions", {}).get("EXT_texture_webp", texture).get("source")
        if source is None:
            self._builder.notice(f"texture {info['index']} has an unsupported format and is ignored")
            return None
        sampler = self._file.json["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wrap = (sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT))
        mirrored = (wrap[0] == _MIRRORED_REPEAT, wrap[1] == _MIRRORED_REPEAT)
        magnified: Literal["linear", "nearest"] = "nearest" if sampler.get("magFilter") == _NEAREST else "linear"
        transform = info.get("extensions", {}).get("KHR_texture_transform", {})
        shrink = np.diag([0.5 if mirrored[0] else 1.0, 0.5 if mirrored[1] else 1.0, 1.0])
        return Texture(
            self._mirror(source, mirrored),
            transform=shrink @ uv_transform(transform),
            repeat=(wrap[0] in (_REPEAT, _MIRRORED_REPEAT), wrap[1] in (_REPEAT, _MIRRORED_REPEAT)),
            is_color=is_color,
            uv_set=self._uv_set(int(transform.get("texCoord", info.get("texCoord", 0)))),
            magnified=magnified,
        )

    def _uv_set(self, number: int) -> int:
        if number not in self.uv_sets:
            if len(self.uv_sets) == MAX_UV_SETS:
                self._builder.notice(f"material {self._material!r} uses more than {MAX_UV_SETS} uv sets: textures of "
                                     f"the others use set {self.uv_sets[0]}")
                return 0
            self.uv_sets.append(number)
        return self.uv_sets.index(number)

    def _mirror(self, source: int, mirrored: tuple[bool, bool]) -> Bytes:
        """The pixels of an image, beside its mirror image in u, and below that in v; repeated, they are mirrored."""
        key = (source, *mirrored)
        if key not in self._mirrored:
            pixels = self._decode(source)
            pixels = np.concatenate([pixels, pixels[:, ::-1]], axis=1) if mirrored[0] else pixels
            self._mirrored[key] = np.concatenate([pixels[::-1], pixels], axis=0) if mirrored[1] else pixels
        return self._mirrored[key]

    def _decode(self, source: int) -> Bytes:
        if source not in self._pixels:
            image = self._file.json["images"][source]
            label = image.get("uri", "") if not str(image.get("uri", "")).startswith("data:") else ""
            where = self._file.path.parent / label if label else f"{self._file.path}: image {source}"
            self._pixels[source] = decode_image(self._file.image(source), where)
        return self._pixels[source]


def uv_transform(spec: dict[str, Any]) -> F64:
    """KHR_texture_transform, which is defined with v downwards, as a matrix for uvs with v upwards, shape (3, 3)."""
    (du, dv), (su, sv) = spec.get("offset", (0, 0)), spec.get("scale", (1, 1))
    cos, sin = np.cos(spec.get("rotation", 0.0)), np.sin(spec.get("rotation", 0.0))
    downwards = np.array([[su * cos, sv * sin, du], [-su * sin, sv * cos, dv], [0.0, 0.0, 1.0]], np.float64)
    if not np.isfinite(downwards).all():
        raise ValueError("a texture transform is not finite")
    return np.asarray(_V_FLIP @ downwards @ _V_FLIP)
