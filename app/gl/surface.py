"""What a material needs of shaders: the features that choose a variant, and the values of its uniforms."""

from dataclasses import dataclass

from app.scene import Instance, Material, Mesh, Texture

MAP_UNITS = {name: unit for unit, name in enumerate((
    "albedo_map", "emission_map", "metallic_roughness_map", "specular_map", "normal_map", "occlusion_map",
    "clearcoat_map", "clearcoat_roughness_map", "clearcoat_normal_map", "sheen_color_map", "sheen_roughness_map",
    "transmission_map", "thickness_map"))}
NORMAL_MAPS = frozenset({"normal_map", "clearcoat_normal_map"})


@dataclass(frozen=True, eq=False)
class Surface:
    """A material on meshes that have the same attributes.

    Attributes
    ----------
    features : tuple of str
        Of the shader's variant, sorted.
    maps : dict of str to Texture
        The material's textures that the meshes have uvs for.
    uniforms : dict of str to object
        Values for all shaders that draw surfaces; each takes those that it has.
    """

    material: Material
    features: tuple[str, ...]
    maps: dict[str, Texture]
    uniforms: dict[str, object]


def describe_surface(instance: Instance, mesh: Mesh, m: Material) -> Surface:
    """The surface of an instance of ``mesh`` with material ``m``."""
    uvs = (mesh.uvs, mesh.second_uvs)
    maps = {name: texture for name, texture in m.maps.items() if uvs[texture.uv_set] is not None}
    if not m.emits:
        maps.pop("emission_map", None)
    if mesh.tangents is None:
        maps.pop("normal_map", None)
        maps.pop("clearcoat_normal_map", None)
    features = {
        "UV": bool(maps),
        "SECOND_UV": any(texture.uv_set for texture in maps.values()),
        "TANGENT": "normal_map" in maps or "clearcoat_normal_map" in maps,
        "VERTEX_COLOR": mesh.colors is not None,
        "ALPHA_MASK": m.alpha_cutoff is not None,
        "METALLIC": m.metallic > 0,
        "SPECULAR": m.has_specular,
        "CLEARCOAT": m.clearcoat is not None,
        "SHEEN": m.sheen is not None,
        "UNLIT": m.is_unlit,
        "BLENDED": m.is_blended,
        "TRANSMISSION": m.transmission is not None,
        "EMITS": m.emits,
        "DEFORMED": instance.deformation is not None,
    }
    used = [*(name for name, is_used in features.items() if is_used), *(name.upper() for name in maps)]
    return Surface(m, tuple(sorted(used)), maps, _uniforms(m, maps))


def _uniforms(m: Material, maps: dict[str, Texture]) -> dict[str, object]:
    uniforms: dict[str, object] = {
        "albedo": m.albedo, "specular_roughness": (*m.specular, m.roughness), "emission": m.emission,
        "emission_flags": (float(m.double_sided or m.is_unlit), float(not (m.is_light_proxy or m.is_unlit))),
        "metallic": m.metallic, "normal_scale": m.normal_scale, "occlusion_strength": m.occlusion_strength,
        "alpha": (m.alpha, m.alpha_cutoff or 0.0), "passing": m.passing, "faces": 2.0 if m.is_volume else 1.0,
    }
    if m.clearcoat is not None:
        uniforms["clearcoat"] = m.clearcoat.strength, m.clearcoat.roughness
        uniforms["clearcoat_normal_scale"] = m.clearcoat.normal_scale
    if m.sheen is not None:
        uniforms["sheen"] = *m.sheen.color, m.sheen.roughness
    if m.transmission is not None:
        uniforms["transmission"] = m.transmission.factor, m.transmission.ior, m.transmission.thickness
        uniforms["extinction"] = m.transmission.extinction
    for name, texture in maps.items():
        transform = texture.transform.copy()
        transform[2, 0] = texture.uv_set  # of the last row, which is (0, 0, 1), shaders need nothing
        uniforms |= {name: MAP_UNITS[name], name.removesuffix("map") + "uv": transform}
    return uniforms
