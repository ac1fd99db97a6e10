"""Emissive surfaces as analytic lights."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from app.load import load_scene
from app.load.emitters import MAX_LIGHTS
from app.scene import PointLight, RectLight
from tests.unit.load_helpers import TRIANGLE, Gltf, write_obj

EMISSIVE_MTL = "newmtl emissive\nKe 4 2 1\n"


def load_emissive(folder, obj):
    return load_scene(write_obj(folder, "usemtl emissive\n" + obj, EMISSIVE_MTL))


def quad(x, width=1.0, height=1.0, base=0):
    corners = [(x, 0, 0), (x + width, 0, 0), (x + width, height, 0), (x, height, 0)]
    return "".join("v {} {} {}\n".format(*c) for c in corners) + f"f {base + 1} {base + 2} {base + 3} {base + 4}\n"


def test_a_rotated_quad_is_an_exact_rectangle_on_its_winding_side(tmp_path):
    rotation = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    corners = np.array([[0, 0, 0], [3, 0, 0], [3, 0.5, 0], [0, 0.5, 0]]) @ rotation.T
    scene = load_emissive(tmp_path, "".join("v {:.9f} {:.9f} {:.9f}\n".format(*c) for c in corners) + "f 1 2 3 4\n")
    (light,) = scene.lights
    assert isinstance(light, RectLight) and light.radiance == (4, 2, 1) and not light.two_sided
    normal = np.cross(light.edge_u, light.edge_v)
    np.testing.assert_allclose(normal, 1.5 * rotation[:, 2], atol=1e-5)
    np.testing.assert_allclose(light.center, corners.mean(axis=0), atol=1e-6)
    assert scene.materials[0].is_light_proxy
    assert not any("emissive" in n for n in scene.notices)


def test_other_flat_shapes_keep_their_power_and_give_a_notice(tmp_path):
    scene = load_emissive(tmp_path, "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n")
    (light,) = scene.lights
    power = np.linalg.norm(np.cross(light.edge_u, light.edge_v)) * np.array(light.radiance)
    np.testing.assert_allclose(power, [4, 2, 1], rtol=1e-6)
    assert any("no rectangle" in n for n in scene.notices)


def test_closed_meshes_become_spheres_of_the_same_area(tmp_path):
    ball = trimesh.creation.icosphere(3, radius=0.5)
    obj = "".join("v {} {} {}\n".format(*v) for v in ball.vertices + np.array([1, 2, 3]))
    obj += "".join("f {} {} {}\n".format(*f) for f in ball.faces + 1)
    scene = load_emissive(tmp_path, obj)
    (light,) = scene.lights
    assert isinstance(light, PointLight)
    np.testing.assert_allclose(light.position, [1, 2, 3], atol=1e-6)
    assert light.radius == pytest.approx(0.5, rel=0.01)
    # A sphere of radiance L is an intensity of L times its cross-section.
    np.testing.assert_allclose(light.intensity, np.pi * 0.25 * np.array([4, 2, 1]), rtol=0.01)


def test_separate_pieces_are_separate_lights(tmp_path):
    scene = load_emissive(tmp_path, quad(0) + quad(5, base=4))
    assert sorted(light.center[0] for light in scene.lights) == pytest.approx([0.5, 5.5])


def test_only_the_most_powerful_are_lights_and_the_others_stay_emissive(tmp_path):
    count = MAX_LIGHTS + 4
    scene = load_emissive(tmp_path, "".join(quad(3 * i, height=0.1 + 0.01 * i, base=4 * i) for i in range(count)))
    assert len(scene.lights) == MAX_LIGHTS
    assert min(light.center[0] for light in scene.lights) > 3 * 4
    triangles = {m.is_light_proxy: sum(len(x.triangles) for x in scene.meshes if scene.materials[x.material] is m)
                 for m in scene.materials}
    assert triangles == {True: 2 * MAX_LIGHTS, False: 8}
    assert any(f"{count} emissive pieces" in n for n in scene.notices)


def test_mirrored_and_instanced_emitters(tmp_path):
    gltf = Gltf()
    gltf.material(emissiveFactor=[1, 1, 1], doubleSided=False)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    gltf.primitive["attributes"]["POSITION"] = gltf.array(corners)
    gltf.primitive["indices"] = gltf.array(np.array([0, 1, 2, 0, 2, 3], np.uint16))
    gltf.json["nodes"].append({"mesh": 0, "scale": [-1, 1, 1], "translation": [9, 0, 0]})
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    scene = load_scene(gltf.save(tmp_path))
    assert len(scene.lights) == 2 and len(scene.meshes) == 1
    for light in scene.lights:
        np.testing.assert_allclose(np.cross(light.edge_u, light.edge_v), [0, 0, 1], atol=1e-6)


def test_emission_texture_counts_by_its_linear_mean(tmp_path):
    gltf = Gltf()
    gltf.material(emissiveFactor=[1, 1, 1], doubleSided=True,
                  emissiveTexture={"index": gltf.texture(np.array([[[255] * 3, [0] * 3]]))})
    gltf.primitive["attributes"]["TEXCOORD_0"] = gltf.array(TRIANGLE[:, :2].copy())
    (light,) = load_scene(gltf.save(tmp_path)).lights
    area = np.linalg.norm(np.cross(light.edge_u, light.edge_v))
    np.testing.assert_allclose(np.array(light.radiance) * area, [0.25] * 3, rtol=1e-6)
    assert light.two_sided
