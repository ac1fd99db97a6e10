"""glTF materials and textures -> Material and Texture."""

from typing import Any

import numpy as np

from app.arrays import F64, Bytes
from app.load.gltf_file import GltfFile
from app.load.images import decode_image, mean_color
from app.load.scene_builder import SceneBuilder, color
from app.scene import Material, Texture

_REPEAT = 10497
_MIRRORED_REPEAT = 33648
_MAX_SPECULAR_ROUGHNESS = 0.9  # rougher dielectrics have no specular lobe
_DIELECTRIC = 0.04             # reflectance at normal incidence
_V_FLIP = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
DEFAULT = Material(name="glTF default", albedo=(1.0, 1.0, 1.0), double_sided=False)


class MaterialReader:
    """Reads the materials of one file and decodes each image once."""

    def __init__(self, file: GltfFile, builder: SceneBuilder) -> None:
        self._file, self._builder = file, builder
        self._pixels: dict[int, Bytes] = {}

    def read(self, spec: dict[str, Any], index: int) -> tuple[Material, int]:
        """Read a material and the uv set that its textures use."""
        name = spec.get("name", f"material {index}")
        pbr = spec.get("pbrMetallicRoughness", {})
        base = np.clip(np.nan_to_num(np.asarray(pbr.get("baseColorFactor", (1, 1, 1, 1)), np.float64)), 0, 1)
        albedo_map, uv_set = self._texture(pbr.get("baseColorTexture"))
        emission_map, emission_set = self._texture(spec.get("emissiveTexture"))
        if albedo_map is None:
            uv_set = emission_set
        elif emission_map is not None and emission_set != uv_set:
            self._builder.notice(f"material {name!r}: its emission texture uses the uv set of its colour texture")
        metallic, roughness = self._metallic_roughness(name, pbr)
        tint = mean_color(albedo_map.pixels) if albedo_map is not None else np.ones(3)
        reflectance = _DIELECTRIC + (base[:3] * tint - _DIELECTRIC) * metallic
        has_specular = metallic > 0 or ("roughnessFactor" in pbr and roughness < _MAX_SPECULAR_ROUGHNESS)
        strength = spec.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        material = Material(
            name=name,
            albedo=color(base[:3] * (1 - metallic)),
            albedo_map=albedo_map,
            alpha=float(base[3]),
            alpha_cutoff=self._cutoff(name, spec, float(base[3]), albedo_map),
            emission=color(np.asarray(spec.get("emissiveFactor", (0, 0, 0)), np.float64) * strength),
            emission_map=emission_map,
            roughness=roughness,
            specular=color(reflectance) if has_specular else (0.0, 0.0, 0.0),
            double_sided=bool(spec.get("doubleSided", False)),
        )
        return material, uv_set

    def _metallic_roughness(self, name: str, pbr: dict[str, Any]) -> tuple[float, float]:
        """Metallic and roughness, clamped; a texture is replaced by its mean."""
        metallic, roughness = float(pbr.get("metallicFactor", 1.0)), float(pbr.get("roughnessFactor", 1.0))
        if "metallicRoughnessTexture" in pbr:
            texture, _ = self._texture(pbr["metallicRoughnessTexture"])
            if texture is not None:
                mean = texture.pixels.mean(axis=(0, 1), dtype=np.float64) / 255
                metallic, roughness = metallic * float(mean[2]), roughness * float(mean[1])
                self._builder.notice(f"material {name!r}: the mean of its metallic-roughness texture is used")
        elif "metallicFactor" not in pbr:
            metallic = 0.0
            self._builder.notice(f"material {name!r} has no metallic factor: it is taken as a non-metal, because the "
                                 "renderer shows no reflections")
        return min(max(metallic, 0.0), 1.0), min(max(roughness, 0.0), 1.0)

    def _cutoff(self, name: str, spec: dict[str, Any], alpha: float, texture: Texture | None) -> float | None:
        mode = spec.get("alphaMode", "OPAQUE")
        if mode == "MASK":
            return float(spec.get("alphaCutoff", 0.5))
        if mode == "BLEND" and (alpha < 1.0 or (texture is not None and texture.pixels[..., 3].min() < 255)):
            self._builder.notice(f"material {name!r}: alpha blending is replaced by a mask at alpha 0.5")
            return 0.5
        return None

    def _texture(self, info: dict[str, Any] | None) -> tuple[Texture | None, int]:
        """A texture reference as a Texture, and its uv set."""
        if info is None:
            return None, 0
        texture = self._file.json["textures"][info["index"]]
        source = texture.get("extensions", {}).get("EXT_texture_webp", texture).get("source")
        if source is None:
            self._builder.notice(f"texture {info['index']} has an unsupported format and is ignored")
            return None, 0
        if source not in self._pixels:
            image = self._file.json["images"][source]
            label = image.get("uri", "") if not str(image.get("uri", "")).startswith("data:") else ""
            where = self._file.path.parent / label if label else f"{self._file.path}: image {source}"
            self._pixels[source] = decode_image(self._file.image(source), where)
        sampler = self._file.json["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wrap = (sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT))
        if _MIRRORED_REPEAT in wrap:
            self._builder.notice("mirrored texture wrapping is replaced by plain repetition")
        transform = info.get("extensions", {}).get("KHR_texture_transform", {})
        return Texture(
            self._pixels[source],
            transform=uv_transform(transform),
            repeat=(wrap[0] in (_REPEAT, _MIRRORED_REPEAT), wrap[1] in (_REPEAT, _MIRRORED_REPEAT)),
        ), int(transform.get("texCoord", info.get("texCoord", 0)))


def uv_transform(spec: dict[str, Any]) -> F64:
    """KHR_texture_transform, which is defined with v downwards, as a matrix for uvs with v upwards, shape (3, 3)."""
    (du, dv), (su, sv) = spec.get("offset", (0, 0)), spec.get("scale", (1, 1))
    cos, sin = np.cos(spec.get("rotation", 0.0)), np.sin(spec.get("rotation", 0.0))
    downwards = np.array([[su * cos, sv * sin, du], [-su * sin, sv * cos, dv], [0.0, 0.0, 1.0]], np.float64)
    if not np.isfinite(downwards).all():
        raise ValueError("a texture transform is not finite")
    return np.asarray(_V_FLIP @ downwards @ _V_FLIP)
