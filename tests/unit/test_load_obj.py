"""OBJ and MTL files."""

from __future__ import annotations

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene
from tests.unit.load_helpers import QUAD, png, world, write_obj


def only_material(path):
    scene = load_scene(path)
    assert len(scene.materials) == 1
    return scene.materials[0], scene


def test_tabs_relative_indices_and_crlf_read_like_the_plain_file(tmp_path):
    plain = load_scene(write_obj(tmp_path, QUAD + "f 1 2 3 4\n" + QUAD.replace(" 0\n", " 2\n") + "f 5 6 7 8\n"))
    raw = (QUAD + "f -4 -3 -2 -1\n" + QUAD.replace(" 0\n", " 2\n") + "f -4 -3 -2 -1\n").replace("v ", "v\t")
    odd = load_scene(write_obj(tmp_path, raw.replace("\n", " \r\n"), name="raw.obj"))
    assert odd.triangles == plain.triangles == 4
    np.testing.assert_array_equal(odd.bounds, plain.bounds)
    np.testing.assert_array_equal(world(odd, odd.instances[0]), world(plain, plain.instances[0]))


def test_colours_keep_their_float_values(tmp_path):
    material, _ = only_material(write_obj(
        tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 0.1234567 0.5 0.9\nKe 17 12 4\n"))
    assert material.albedo == (0.1234567, 0.5, 0.9)
    assert material.emission == (17.0, 12.0, 4.0)
    assert not material.double_sided


def test_roughness_comes_from_the_exponent_and_black_has_no_specular_lobe(tmp_path):
    obj = QUAD + "usemtl a\nf 1 2 3 4\n"
    smooth, _ = only_material(write_obj(tmp_path, obj, "newmtl a\nKs 0.5 0.5 0.5\nNs 30\n"))
    assert smooth.specular == (0.5, 0.5, 0.5)
    assert smooth.roughness == pytest.approx(0.5)
    dull, _ = only_material(write_obj(tmp_path, obj, "newmtl a\nKs 0 0 0\nNs 30\n"))
    assert not dull.has_specular


def test_d_takes_precedence_over_tr(tmp_path):
    obj = QUAD + "usemtl a\nf 1 2 3 4\n"
    solid, scene = only_material(write_obj(tmp_path, obj, "newmtl a\nTr 1.0\nd 1.0\n"))
    assert solid.alpha_cutoff is None and not any("transparent" in n for n in scene.notices)
    with pytest.raises(SceneError, match="more than half transparent"):
        load_scene(write_obj(tmp_path, obj, "newmtl a\nTr 0.9\n"))


def test_texture_of_a_black_material_is_not_black(tmp_path):
    (tmp_path / "Map One.png").write_bytes(png(np.full((2, 3, 3), 200)))
    obj = QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n"
    material, scene = only_material(write_obj(
        tmp_path, obj, "newmtl a\nKd 0 0 0\nmap_Kd -s 2 3 1 -clamp on .\\map one.PNG\n"))
    assert material.albedo == (1.0, 1.0, 1.0)
    assert material.albedo_map.pixels.shape == (2, 3, 4)
    assert material.albedo_map.repeat == (False, False)
    np.testing.assert_array_equal(np.diag(material.albedo_map.transform), [2, 3, 1])
    assert scene.meshes[0].uvs.shape == (4, 2)


def test_mask_texture_becomes_alpha(tmp_path):
    (tmp_path / "mask.png").write_bytes(png(np.array([[0, 255]])))
    material, _ = only_material(write_obj(tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n", "newmtl a\nmap_d mask.png\n"))
    assert material.alpha_cutoff == 0.5
    np.testing.assert_array_equal(material.albedo_map.pixels[..., 3], [[0, 255]])


def test_missing_texture_is_a_notice_and_a_corrupt_one_an_error(tmp_path):
    path = write_obj(tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 0.2 0.3 0.4\nmap_Kd gone.png\n")
    material, scene = only_material(path)
    assert material.albedo == (0.2, 0.3, 0.4) and material.albedo_map is None
    assert any("gone.png" in n for n in scene.notices)
    (tmp_path / "gone.png").write_bytes(png(np.zeros((8, 8, 3)))[:40])
    with pytest.raises(SceneError, match=r"gone\.png"):
        load_scene(path)


@pytest.mark.filterwarnings("error")
def test_emission_is_clamped_to_the_maximum(tmp_path):
    material, scene = only_material(write_obj(tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKe 1e200 2 -1\n"))
    assert material.emission == (1e30, 2, 0)
    assert np.isfinite(np.float32(scene.lights[0].radiance)).all()


def test_undefined_material_gets_the_default_and_a_notice(tmp_path):
    _, scene = only_material(write_obj(tmp_path, QUAD + "usemtl ghost\nf 1 2 3 4\n", "newmtl a\nKd 0 0 0\n"))
    assert any("ghost" in n for n in scene.notices)


def test_objects_and_materials_stay_apart(tmp_path):
    obj = QUAD + "o one\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\no two\nf 1 2 4\n"
    scene = load_scene(write_obj(tmp_path, obj, "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n"))
    pairs = {(i.name, scene.materials[scene.meshes[i.mesh].material].name) for i in scene.instances}
    assert pairs == {("one", "a"), ("one", "b"), ("two", "b")}


def test_missing_normals_are_zero_so_that_face_normals_are_used(tmp_path):
    scene = load_scene(write_obj(tmp_path, QUAD + "f 1 2 3 4\n"))
    assert not scene.meshes[0].normals.any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("broken", ["nan", "1e400", "-1e200"])
def test_broken_normals_and_vertices_are_dropped(tmp_path, broken):
    obj = QUAD + f"v {broken} 0 0\nvn 0 0 2\nvn 0 0 0\nf 1//1 2//2 3//1\nf 1//1 3//1 5//1\nf 1//1 2//1 2//1\n"
    scene = load_scene(write_obj(tmp_path, obj))
    assert scene.triangles == 1
    assert np.isfinite(scene.bounds).all()
    lengths = np.linalg.norm(scene.meshes[0].normals, axis=1)
    np.testing.assert_allclose(np.sort(lengths), [0, 1, 1])
    assert any("2 triangles" in n for n in scene.notices)


def test_geometry_far_from_the_origin_keeps_its_precision(tmp_path):
    rows = np.array([[0, 0, 0], [0.001, 0, 0], [0, 0.002, 0]]) + 1e6
    obj = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in rows) + "f 1 2 3\n"
    scene = load_scene(write_obj(tmp_path, obj))
    assert np.abs(scene.meshes[0].positions).max() < 0.01
    np.testing.assert_allclose(np.ptp(world(scene, scene.instances[0]), axis=(0, 1)), [0.001, 0.002, 0], atol=1e-8)


def test_polygons_are_triangulated(tmp_path):
    hexagon = "".join(f"v {np.cos(a):.6f} {np.sin(a):.6f} 0\n" for a in np.arange(6) * np.pi / 3)
    scene = load_scene(write_obj(tmp_path, hexagon + "f 1 2 3 4 5 6\nf 1 2 3\n"))
    assert scene.triangles == 5


def test_lines_are_omitted_with_a_notice(tmp_path):
    scene = load_scene(write_obj(tmp_path, QUAD + "f 1 2 3\nl 1 2\n"))
    assert any("lines" in n for n in scene.notices)
