"""Materials and textures of glTF files."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene
from app.raycast.prefiltered_textures import sample_nearest
from app.scene import Material
from tests.unit.load_helpers import TRIANGLE, Gltf

PIXELS = np.random.default_rng(2).integers(0, 256, (4, 8, 4))


def read(gltf, folder, **options):
    """The scene and the material of its only triangle."""
    scene = load_scene(gltf.save(folder), **options)
    return scene, scene.materials[scene.meshes[0].material]


def with_uvs(gltf, *uvs):
    for number, values in enumerate(uvs):
        gltf.primitive["attributes"][f"TEXCOORD_{number}"] = gltf.array(np.asarray(values, np.float32))
    return gltf


def test_without_a_material_the_defaults_of_gltf_apply(tmp_path):
    _, material = read(Gltf(), tmp_path)
    assert material.albedo == (1.0, 1.0, 1.0) and material.metallic == 1.0 and material.roughness == 1.0
    assert material.is_back_culled and not material.double_sided


def test_factors(tmp_path):
    gltf = Gltf()
    gltf.material(pbrMetallicRoughness={"baseColorFactor": [0.123456, 0.5, 1, 1], "metallicFactor": 0.5,
                                        "roughnessFactor": 0.3}, doubleSided=True)
    _, material = read(gltf, tmp_path)
    assert material.albedo == (0.123456, 0.5, 1) and material.metallic == 0.5 and material.roughness == 0.3
    np.testing.assert_allclose(material.specular, [0.04] * 3)
    assert material.double_sided and not material.is_back_culled


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 2.0])
def test_factors_out_of_range_are_clamped(tmp_path, value):
    gltf = Gltf()
    gltf.material(pbrMetallicRoughness={"metallicFactor": value, "roughnessFactor": value,
                                        "baseColorFactor": [value] * 4})
    _, material = read(gltf, tmp_path)
    for number in (material.metallic, material.roughness, material.alpha, *material.albedo):
        assert number == (1.0 if value > 1 else 0.0)


def test_textures_are_colours_or_numbers(tmp_path):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    info = {"index": gltf.texture(PIXELS)}
    gltf.material(pbrMetallicRoughness={"baseColorTexture": info, "metallicRoughnessTexture": info},
                  normalTexture={**info, "scale": 0.5}, occlusionTexture={**info, "strength": 0.25},
                  emissiveTexture=info, emissiveFactor=[1, 1, 1])
    scene, material = read(gltf, tmp_path)
    assert {name: t.is_color for name, t in material.maps.items()} == {
        "albedo_map": True, "emission_map": True, "metallic_roughness_map": False, "normal_map": False,
        "occlusion_map": False}
    assert (material.metallic, material.roughness) == (1.0, 1.0)
    assert (material.normal_scale, material.occlusion_strength) == (0.5, 0.25)
    assert scene.meshes[0].tangents is not None
    assert not any(word in n for n in scene.notices for word in ("texture", "map", "material"))


def test_emission_is_factor_times_strength(tmp_path):
    gltf = Gltf()
    gltf.material(emissiveFactor=[1, 0.5, 0.25],
                  extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 40}})
    assert read(gltf, tmp_path)[1].emission == (40, 20, 10)


def test_alpha_modes(tmp_path):
    see_through = np.full((2, 2, 4), 255)
    see_through[0, 0, 3] = 0
    for spec, cutoff in (({"alphaMode": "MASK", "alphaCutoff": 0.25}, 0.25), ({"alphaMode": "MASK"}, 0.5),
                         ({"alphaMode": "BLEND"}, None), ({}, None)):
        gltf = Gltf()
        gltf.material(pbrMetallicRoughness={"baseColorTexture": {"index": gltf.texture(see_through)}}, **spec)
        scene, material = read(gltf, tmp_path)
        is_blended = spec.get("alphaMode") == "BLEND"
        assert material.alpha_cutoff == cutoff and material.is_blended is is_blended
        assert any("blending" in n for n in scene.approximations) == is_blended


@pytest.mark.parametrize(("mode", "alpha", "is_blended"), [("BLEND", 0.5, True), ("BLEND", 1.0, False),
                                                            ("OPAQUE", 0.5, False)])
def test_vertex_colours_can_be_translucent(tmp_path, mode, alpha, is_blended):
    gltf = Gltf()
    gltf.primitive["attributes"]["COLOR_0"] = gltf.array(np.array([[1, 1, 1, a] for a in (1, alpha, 1)], np.float32))
    gltf.material(alphaMode=mode)
    scene = load_scene(gltf.save(tmp_path))
    assert scene.materials[0].is_blended is is_blended
    assert any("blending" in n for n in scene.approximations) == is_blended


def test_blending_of_what_is_opaque_is_none(tmp_path):
    gltf = Gltf()
    gltf.material(alphaMode="BLEND")
    _, material = read(gltf, tmp_path)
    assert not material.is_blended and material.alpha_cutoff is None


def test_wrapping_and_second_uv_set_by_transform(tmp_path):
    gltf = Gltf()
    info = {"index": gltf.texture(np.zeros((2, 2, 3)), wrapS=33071, wrapT=10497, magFilter=9728),
            "extensions": {"KHR_texture_transform": {"offset": [0.25, 0.5], "texCoord": 1}}}
    gltf.material(pbrMetallicRoughness={"baseColorTexture": info})
    with_uvs(gltf, np.zeros((3, 2)), [[0, 0], [1, 0], [0, 0.25]])
    scene, material = read(gltf, tmp_path)
    texture = material.albedo_map
    assert texture.repeat == (False, True) and texture.magnified == "nearest"
    np.testing.assert_allclose(scene.meshes[0].uvs, [[0, 1], [1, 1], [0, 0.75]])
    assert scene.meshes[0].second_uvs is None
    # Upwards v: moving down by half in glTF's v is moving by minus a half.
    np.testing.assert_allclose(texture.transform @ [0, 1, 1], [0.25, 0.5, 1])


def test_two_uv_sets_are_read_and_a_third_is_noticed(tmp_path):
    gltf = with_uvs(Gltf(), *(np.full((3, 2), 0.1 * n) for n in range(4)))
    index = gltf.texture(PIXELS)
    gltf.material(pbrMetallicRoughness={"baseColorTexture": {"index": index, "texCoord": 3}},
                  emissiveTexture={"index": index, "texCoord": 1}, emissiveFactor=[1, 1, 1],
                  occlusionTexture={"index": index, "texCoord": 2})
    scene, material = read(gltf, tmp_path)
    assert [t.uv_set for t in (material.albedo_map, material.emission_map, material.occlusion_map)] == [0, 1, 0]
    np.testing.assert_allclose(scene.meshes[0].uvs, [[0.3, 0.7]] * 3, rtol=1e-6)
    np.testing.assert_allclose(scene.meshes[0].second_uvs, [[0.1, 0.9]] * 3, rtol=1e-6)
    assert sum("uv sets" in n for n in scene.notices) == 1


@pytest.mark.parametrize("wrap", [(33648, 33648), (33648, 10497), (10497, 33648)])
def test_mirrored_wrapping(tmp_path, wrap):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    info = {"index": gltf.texture(PIXELS, wrapS=wrap[0], wrapT=wrap[1]),
            "extensions": {"KHR_texture_transform": {"scale": [2, 3], "offset": [0.3, 0]}}}
    gltf.material(pbrMetallicRoughness={"baseColorTexture": info})
    texture = read(gltf, tmp_path)[1].albedo_map
    uv = np.random.default_rng(0).uniform(-3, 3, (200, 2))
    at = (uv * [1, -1] + [0, 1]) * [2, 3] + [0.3, 0]  # as glTF defines it, v downwards
    folded = [np.abs((v + 1) % 2 - 1) if w == 33648 else v % 1 for v, w in zip(at.T, wrap, strict=True)]
    expected = PIXELS[(folded[1] * 4).astype(int), (folded[0] * 8).astype(int)]
    np.testing.assert_allclose(sample_nearest(texture, uv) * 255, expected, atol=1e-3)


def test_one_image_is_decoded_once(tmp_path):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    info = {"index": gltf.texture(PIXELS)}
    gltf.material(pbrMetallicRoughness={"baseColorTexture": info, "metallicRoughnessTexture": info})
    _, material = read(gltf, tmp_path)
    assert material.albedo_map.pixels is material.metallic_roughness_map.pixels


def test_tangents_only_where_a_normal_map_needs_them(tmp_path):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    tangents = np.tile(np.array([[0, 2, 0, -1]], np.float32), (3, 1))
    gltf.primitive["attributes"] |= {"NORMAL": gltf.array(np.tile(np.array([[0, 0, 1]], np.float32), (3, 1))),
                                     "TANGENT": gltf.array(tangents)}
    gltf.material()
    assert read(gltf, tmp_path)[0].meshes[0].tangents is None
    gltf.material(normalTexture={"index": gltf.texture(PIXELS)})
    np.testing.assert_allclose(read(gltf, tmp_path)[0].meshes[0].tangents, [[0, 1, 0, -1]] * 3)
    del gltf.primitive["attributes"]["TANGENT"]
    np.testing.assert_allclose(read(gltf, tmp_path)[0].meshes[0].tangents, [[1, 0, 0, -1]] * 3)  # v grows downwards


@pytest.mark.parametrize(("extensions", "f0"), [
    ({}, 0.04),
    ({"KHR_materials_ior": {"ior": 1.33}}, (0.33 / 2.33) ** 2),
    ({"KHR_materials_ior": {"ior": 0}}, 1.0),
    ({"KHR_materials_specular": {"specularFactor": 0.5}}, 0.02),
    ({"KHR_materials_specular": {"specularColorFactor": [2, 2, 2]}}, 0.08),
    ({"KHR_materials_specular": {"specularColorFactor": [50] * 3, "specularFactor": 0.5}}, 0.5),
    ({"KHR_materials_specular": {"specularFactor": 0}}, 0.0),
])
def test_reflectance_at_normal_incidence(tmp_path, extensions, f0):
    gltf = Gltf()
    gltf.material(pbrMetallicRoughness={"metallicFactor": 0}, extensions=extensions)
    np.testing.assert_allclose(read(gltf, tmp_path)[1].specular, [f0] * 3, rtol=1e-5)


@pytest.mark.parametrize("size", [(4, 8), (2, 2)])
def test_both_specular_textures_become_one(tmp_path, size):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    weight = np.zeros((*size, 4), int)
    weight[..., 3] = np.arange(size[1]) * 20
    specular = {"specularColorTexture": {"index": gltf.texture(PIXELS)},
                "specularTexture": {"index": gltf.texture(weight)}}
    gltf.material(extensions={"KHR_materials_specular": specular})
    pixels = read(gltf, tmp_path)[1].specular_map.pixels
    np.testing.assert_array_equal(pixels[..., :3], PIXELS[..., :3])
    np.testing.assert_array_equal(pixels[0, :, 3], np.repeat(np.arange(size[1]) * 20, 8 // size[1]))


def test_layers(tmp_path):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    info = {"index": gltf.texture(PIXELS)}
    gltf.material(extensions={
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.8, "clearcoatRoughnessFactor": 0.3, "clearcoatTexture": info,
                                    "clearcoatNormalTexture": {**info, "scale": 0.2}},
        "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenRoughnessFactor": 0.6,
                                "sheenColorTexture": info, "sheenRoughnessTexture": info},
        "KHR_materials_transmission": {"transmissionFactor": 0.7}, "KHR_materials_ior": {"ior": 1.4},
        "KHR_materials_volume": {"thicknessFactor": 2, "attenuationColor": [1, 0.5, 0.5], "attenuationDistance": 3}})
    scene, material = read(gltf, tmp_path)
    coat, sheen, transmission = material.clearcoat, material.sheen, material.transmission
    assert (coat.strength, coat.roughness, coat.normal_scale) == (0.8, 0.3, 0.2)
    assert (sheen.color, sheen.roughness) == ((0.1, 0.2, 0.3), 0.6)
    assert (transmission.factor, transmission.ior, transmission.thickness) == (0.7, 1.4, 2)
    assert (transmission.attenuation_color, transmission.attenuation_distance) == ((1, 0.5, 0.5), 3)
    assert {name: t.is_color for name, t in material.maps.items()} == {
        "clearcoat_map": False, "clearcoat_normal_map": False, "sheen_color_map": True, "sheen_roughness_map": False}
    assert scene.meshes[0].tangents is not None
    assert any("clearcoat" in text for text in scene.approximations)


def test_layers_without_effect_are_none(tmp_path):
    gltf = Gltf()
    gltf.material(extensions={"KHR_materials_clearcoat": {}, "KHR_materials_sheen": {"sheenRoughnessFactor": 1},
                              "KHR_materials_transmission": {}, "KHR_materials_volume": {"thicknessFactor": 1}})
    scene, material = read(gltf, tmp_path)
    assert (material.clearcoat, material.sheen, material.transmission) == (None, None, None)
    assert not scene.approximations


def test_unlit_has_nothing_but_its_colour(tmp_path):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    info = {"index": gltf.texture(PIXELS)}
    gltf.material(name="sign", pbrMetallicRoughness={"baseColorFactor": [0.5, 0.25, 1, 1], "baseColorTexture": info},
                  emissiveFactor=[1, 1, 1], normalTexture=info, extensions={"KHR_materials_unlit": {}})
    scene, material = read(gltf, tmp_path)
    assert material.is_unlit and material.albedo == (0.5, 0.25, 1.0) and set(material.maps) == {"albedo_map"}
    assert not material.emits and not material.has_specular and len(scene.lights) == 1  # the sun that the scene lacks
    assert scene.with_radiance_scale(256).materials[0].albedo == (128, 64, 256)


def test_specular_glossiness_is_converted(tmp_path):
    gltf = with_uvs(Gltf(), TRIANGLE[:, :2])
    info = {"index": gltf.texture(PIXELS)}
    fallback = {"baseColorFactor": [1, 0, 0, 1]}
    gltf.material(pbrMetallicRoughness=fallback, extensions={"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [0.1, 0.2, 0.3, 1], "specularFactor": [0.5, 0.6, 0.7], "glossinessFactor": 0.8,
        "specularGlossinessTexture": info}})
    _, material = read(gltf, tmp_path)
    assert material.albedo == (0.1, 0.2, 0.3) and material.specular == (0.5, 0.6, 0.7) and material.metallic == 0
    np.testing.assert_array_equal(material.specular_map.pixels[..., :3], PIXELS[..., :3])
    roughness = material.roughness * material.metallic_roughness_map.pixels[..., 1] / 255
    np.testing.assert_allclose(roughness, 1 - 0.8 * PIXELS[..., 3] / 255, atol=0.003)


def with_variants():
    gltf = Gltf()
    for name in ("plain", "red", "blue"):
        gltf.material(name=name)
    gltf.primitive["material"] = 0
    gltf.primitive["extensions"] = {"KHR_materials_variants": {"mappings": [
        {"material": 1, "variants": [0]}, {"material": 2, "variants": [1, 2]}]}}
    gltf.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": n} for n in ("Fire", "Sea", "Sky")]}}
    return gltf


@pytest.mark.parametrize(("variant", "material"), [(None, "plain"), ("Fire", "red"), ("Sea", "blue"), ("Sky", "blue")])
def test_variants(tmp_path, variant, material):
    assert read(with_variants(), tmp_path, variant=variant)[1].name == material


def test_an_unknown_variant_names_the_known_ones(tmp_path):
    with pytest.raises(SceneError, match=r"no material variant 'Fir'.*did you mean 'Fire'.*Fire, Sea, Sky"):
        read(with_variants(), tmp_path, variant="Fir")
    with pytest.raises(SceneError, match="no material variant 'Fire'"):
        read(Gltf(), tmp_path, variant="Fire")


def test_what_is_ignored_is_a_notice(tmp_path):
    gltf = Gltf()
    gltf.json["extensionsUsed"] = ["KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_xmp_json_ld"]
    scene, _ = read(gltf, tmp_path)
    assert [n for n in scene.notices if "ignored" in n] == [
        "the extension KHR_materials_anisotropy is ignored", "the extension KHR_xmp_json_ld is ignored"]


def test_materials_without_features_are_as_plain_as_those_of_other_loaders(tmp_path):
    gltf = Gltf()
    gltf.material(name="default", pbrMetallicRoughness={"metallicFactor": 0, "baseColorFactor": [0.8, 0.8, 0.8, 1]},
                  doubleSided=True, extensions={"KHR_materials_specular": {"specularFactor": 0}})
    _, material = read(gltf, tmp_path)
    assert vars(material) == vars(Material())
