"""glTF materials -> Material."""

from dataclasses import replace
from typing import Any

import numpy as np

from app.arrays import F64, Bytes
from app.load.gltf_file import GltfFile
from app.load.gltf_textures import TextureReader
from app.load.scene_builder import SceneBuilder, color
from app.scene import Clearcoat, Material, Sheen, Texture, Transmission

Json = dict[str, Any]

MATERIAL_EXTENSIONS = frozenset(f"KHR_materials_{name}" for name in (
    "clearcoat", "emissive_strength", "ior", "pbrSpecularGlossiness", "sheen", "specular", "transmission", "unlit",
    "variants", "volume")) | {"KHR_texture_transform", "EXT_texture_webp"}

DEFAULT = Material(name="glTF default", albedo=(1.0, 1.0, 1.0), metallic=1.0, specular=(0.04, 0.04, 0.04),
                   double_sided=False, is_back_culled=True)

_IOR, _MAX_IOR = 1.5, 1e6


class MaterialReader:
    """Reads the materials of one file."""

    def __init__(self, file: GltfFile, builder: SceneBuilder) -> None:
        self._file, self._builder = file, builder
        self._textures = TextureReader(file, builder)

    def read(self, spec: Json, index: int) -> tuple[Material, tuple[int, ...]]:
        """Read a material, and the uv sets of the file that its textures call 0 and 1."""
        name = spec.get("name", f"material {index}")
        self._textures.begin_material(name)
        extensions = spec.get("extensions", {})
        if "KHR_materials_pbrSpecularGlossiness" in extensions:  # which pbrMetallicRoughness only stands in for
            material = self._specular_glossiness(extensions["KHR_materials_pbrSpecularGlossiness"])
        else:
            material = self._metallic_roughness(spec.get("pbrMetallicRoughness", {}), extensions)
        double_sided = bool(spec.get("doubleSided", False))
        material = replace(material, name=name, double_sided=double_sided, is_back_culled=not double_sided,
                           **self._alpha(spec, material))
        if "KHR_materials_unlit" in extensions:
            material = Material(name=name, albedo=material.albedo, albedo_map=material.albedo_map, is_unlit=True,
                                alpha=material.alpha, alpha_cutoff=material.alpha_cutoff,
                                is_blended=material.is_blended, double_sided=double_sided,
                                is_back_culled=not double_sided)
        else:
            material = replace(
                material, **self._emission(spec, extensions), **self._relief(spec),
                clearcoat=self._clearcoat(extensions.get("KHR_materials_clearcoat", {})),
                sheen=self._sheen(extensions.get("KHR_materials_sheen", {})),
                transmission=self._transmission(extensions))
        return material, tuple(self._textures.uv_sets)

    def apply_vertex_alpha(self, index: int) -> None:
        """Blend a material that has this alpha mode, since vertex colours make some of its surfaces translucent."""
        materials, specs = self._builder.materials, self._file.items("materials")
        if index < len(specs) and specs[index].get("alphaMode") == "BLEND":
            materials[index] = replace(materials[index], **self._blending())

    def _metallic_roughness(self, pbr: Json, extensions: Json) -> Material:
        base = _factors(pbr.get("baseColorFactor", (1, 1, 1, 1)))
        specular = extensions.get("KHR_materials_specular", {})
        tint = color(specular.get("specularColorFactor", (1, 1, 1)))
        f0 = ((_ior(extensions) - 1) / (_ior(extensions) + 1)) ** 2
        weight = _share(specular.get("specularFactor", 1.0))
        if weight < 1 or "specularTexture" in specular:
            self._builder.approximation("KHR_materials_specular: seen at grazing angles surfaces reflect all light, "
                                        "whatever their specular factor")
        return Material(
            albedo=color(base[:3]),
            albedo_map=self._textures.read(pbr.get("baseColorTexture"), is_color=True),
            alpha=float(base[3]),
            metallic=_share(pbr.get("metallicFactor", 1.0)),
            roughness=_share(pbr.get("roughnessFactor", 1.0)),
            metallic_roughness_map=self._textures.read(pbr.get("metallicRoughnessTexture")),
            specular=color(np.minimum(f0 * np.asarray(tint), 1.0) * weight),
            specular_map=self._specular_map(specular))

    def _specular_map(self, specular: Json) -> Texture | None:
        """The colour of one texture and the alpha of another in one image."""
        tint = self._textures.read(specular.get("specularColorTexture"), is_color=True)
        weight = self._textures.read(specular.get("specularTexture"), is_color=True)
        if tint is None or weight is None:
            texture = tint or weight
            return None if texture is None else replace(texture, pixels=_merge(tint, weight))
        if not np.array_equal(tint.transform, weight.transform) or tint.uv_set != weight.uv_set:
            self._builder.notice("a specular texture has the coordinates of its specular colour texture")
        return replace(tint, pixels=_merge(tint, weight))

    def _specular_glossiness(self, pbr: Json) -> Material:
        self._builder.approximation("KHR_materials_pbrSpecularGlossiness: diffuse light is not reduced by specular")
        base = _factors(pbr.get("diffuseFactor", (1, 1, 1, 1)))
        glossiness = _share(pbr.get("glossinessFactor", 1.0))
        albedo_map = self._textures.read(pbr.get("diffuseTexture"), is_color=True)
        texture = self._textures.read(pbr.get("specularGlossinessTexture"), is_color=True)
        roughness_map = None
        if texture is not None:
            assert texture.pixels.dtype == np.uint8
            roughness = np.rint(255 - glossiness * texture.pixels[..., 3]).astype(np.uint8)
            roughness_map = replace(texture, pixels=np.repeat(roughness[..., None], 4, axis=2), is_color=False)
            texture = replace(texture, pixels=_merge(texture, None))
        return Material(
            albedo=color(base[:3]), albedo_map=albedo_map, alpha=float(base[3]),
            specular=color(_factors(pbr.get("specularFactor", (1, 1, 1)))), specular_map=texture,
            roughness=1 - glossiness if texture is None else 1.0, metallic_roughness_map=roughness_map)

    def _alpha(self, spec: Json, material: Material) -> Json:
        mode, texture = spec.get("alphaMode", "OPAQUE"), material.albedo_map
        if mode == "MASK":
            return {"alpha_cutoff": float(np.nan_to_num(spec.get("alphaCutoff", 0.5)))}
        is_opaque = material.alpha >= 1.0 and (texture is None or texture.pixels[..., 3].min() == 255)
        return {} if mode != "BLEND" or is_opaque else self._blending()

    def _blending(self) -> Json:
        self._builder.approximation("alpha blending: blended surfaces have the indirect light of what is behind them")
        return {"is_blended": True}

    def _emission(self, spec: Json, extensions: Json) -> Json:
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        emission = color(np.asarray(spec.get("emissiveFactor", (0, 0, 0)), np.float64) * strength)
        return {"emission": emission, "emission_map": self._textures.read(spec.get("emissiveTexture"), is_color=True)}

    def _relief(self, spec: Json) -> Json:
        """Normal map and occlusion."""
        normal, occlusion = spec.get("normalTexture"), spec.get("occlusionTexture")
        return {"normal_map": self._textures.read(normal), "normal_scale": _scale(normal),
                "occlusion_map": self._textures.read(occlusion),
                "occlusion_strength": _share((occlusion or {}).get("strength", 1.0))}

    def _clearcoat(self, spec: Json) -> Clearcoat | None:
        strength = _share(spec.get("clearcoatFactor", 0.0))
        if not strength:
            return None
        self._builder.approximation("KHR_materials_clearcoat: coats of and behind glass mirror lights and the sky only")
        normal = spec.get("clearcoatNormalTexture")
        return Clearcoat(
            strength, _share(spec.get("clearcoatRoughnessFactor", 0.0)),
            self._textures.read(spec.get("clearcoatTexture")),
            self._textures.read(spec.get("clearcoatRoughnessTexture")),
            self._textures.read(normal), _scale(normal))

    def _sheen(self, spec: Json) -> Sheen | None:
        tint = color(_factors(spec.get("sheenColorFactor", (0, 0, 0))))
        if not any(tint):
            return None
        self._builder.approximation("KHR_materials_sheen: sheen reflects direct light only, of lights as if from "
                                    "their centres")
        return Sheen(tint, _share(spec.get("sheenRoughnessFactor", 0.0)),
                     self._textures.read(spec.get("sheenColorTexture"), is_color=True),
                     self._textures.read(spec.get("sheenRoughnessTexture")))

    def _transmission(self, extensions: Json) -> Transmission | None:
        spec, volume = extensions.get("KHR_materials_transmission", {}), extensions.get("KHR_materials_volume", {})
        factor = _share(spec.get("transmissionFactor", 0.0))
        if not factor:
            return None
        self._builder.approximation("KHR_materials_transmission: what is behind is taken from the picture, with the "
                                    "indirect light of what is opaque there; shadows are tinted, without caustics")
        if volume.get("thicknessFactor"):
            self._builder.approximation("KHR_materials_volume: light is refracted where it enters and where it first "
                                        "leaves, to what the picture shows")
        distance = float(volume.get("attenuationDistance", np.inf))
        return Transmission(
            factor, self._textures.read(spec.get("transmissionTexture")), _ior(extensions),
            max(float(np.nan_to_num(volume.get("thicknessFactor", 0.0))), 0.0),
            self._textures.read(volume.get("thicknessTexture")),
            color(_factors(volume.get("attenuationColor", (1, 1, 1)))), distance if distance > 0 else np.inf)


def read_variant(spec: Json, number: int | None) -> int | None:
    """The index of a primitive's material in variant ``number`` of KHR_materials_variants, or without variants."""
    mappings = spec.get("extensions", {}).get("KHR_materials_variants", {}).get("mappings", [])
    chosen = [m["material"] for m in mappings if number is not None and number in m["variants"]]
    material: int | None = chosen[0] if chosen else spec.get("material")
    return material


def _factors(values: Any) -> F64:
    """Finite numbers from 0 to 1."""
    return np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)


def _share(value: Any) -> float:
    return float(_factors(value))


def _scale(normal: Json | None) -> float:
    """Of a normal texture's x and y."""
    return float(np.clip(np.nan_to_num((normal or {}).get("scale", 1.0)), -1e4, 1e4))


def _ior(extensions: Json) -> float:
    """Index of refraction; 0 in the file means infinite, that all light is reflected."""
    ior = float(np.nan_to_num(extensions.get("KHR_materials_ior", {}).get("ior", _IOR)))
    return min(max(ior, 1.0), _MAX_IOR) if ior else _MAX_IOR


def _merge(rgb: Texture | None, alpha: Texture | None) -> Bytes:
    """Colour of one image and alpha of another, at the larger size; white and opaque without."""
    height, width = (max(t.pixels.shape[axis] for t in (rgb, alpha) if t is not None) for axis in (0, 1))
    merged = np.full((height, width, 4), 255, np.uint8)
    for texture, channels in ((rgb, slice(0, 3)), (alpha, slice(3, 4))):
        if texture is not None:
            sizes = texture.pixels.shape[:2]
            rows, columns = (np.arange(n) * size // n for n, size in zip((height, width), sizes, strict=True))
            merged[..., channels] = texture.pixels[rows[:, None], columns, channels]
    return merged
