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


PLANE = QUAD + "usemtl a\nf 1 2 3 4\n"


def test_roughness_comes_from_the_exponent_and_black_has_no_specular_lobe(tmp_path):
    smooth, _ = only_material(write_obj(tmp_path, PLANE, "newmtl a\nKs 0.5 0.5 0.5\nNs 30\n"))
    assert smooth.roughness == pytest.approx(0.5)
    dull, _ = only_material(write_obj(tmp_path, PLANE, "newmtl a\nKs 0 0 0\nNs 30\n"))
    assert not dull.has_specular


@pytest.mark.parametrize(("model", "expected"), [
    ("", 0.04), ("illum 2\n", 0.04), ("illum 3\n", 0.5), ("illum 5\n", 0.5)])
def test_highlights_are_those_of_a_plastic_where_no_mirror_image_is_asked_for(tmp_path, model, expected):
    """Blender writes Ks 0.5 for a plain plastic; illum 2 has highlights only, 3 and up reflect the surroundings."""
    material, _ = only_material(write_obj(tmp_path, PLANE, f"newmtl a\nKd 0.8 0 0\nKs 0.5 0.5 0.5\n{model}"))
    assert material.specular == pytest.approx((expected,) * 3)


def test_keys_of_physically_based_materials(tmp_path):
    for name, pixels in (("n.png", np.tile(np.uint8([128, 128, 255]), (4, 4, 1))), ("r.png", np.full((4, 4), 100)),
                         ("m.png", np.full((2, 2), 200)), ("h.png", np.full((4, 4), 90))):
        (tmp_path / name).write_bytes(png(pixels))
    obj = QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n"
    plain, _ = only_material(write_obj(tmp_path, obj, "newmtl a\nPr 0.3\nPm 0.7\n"))
    assert (plain.roughness, plain.metallic, plain.specular) == (0.3, 0.7, (0.04,) * 3)
    mapped, scene = only_material(write_obj(
        tmp_path, obj, "newmtl a\nmap_Pr r.png\nmap_Pm m.png\nmap_Bump -bm 1.0 n.png\n"))
    assert (mapped.roughness, mapped.metallic) == (1.0, 1.0)
    np.testing.assert_array_equal(mapped.metallic_roughness_map.pixels[0, 0, 1:3], [100, 200])
    assert not mapped.metallic_roughness_map.is_color and not mapped.normal_map.is_color
    assert scene.meshes[0].tangents is not None and not any("ignored" in n for n in scene.notices)
    bumpy, scene = only_material(write_obj(tmp_path, obj, "newmtl a\nmap_Bump h.png\n"))
    assert bumpy.normal_map is None and any("heights" in n for n in scene.notices)


def test_options_of_maps(tmp_path):
    (tmp_path / "n.png").write_bytes(png(np.tile(np.uint8([128, 128, 255]), (4, 4, 1))))
    (tmp_path / "orm.png").write_bytes(png(np.tile(np.uint8([255, 100, 200]), (2, 2, 1))))
    (tmp_path / "small.png").write_bytes(png(np.full((1, 1), 50)))
    bumps, _ = only_material(write_obj(tmp_path, PLANE, "newmtl a\nmap_bump -bm 0.2 n.png\n"))
    assert bumps.normal_scale == 0.2
    packed, _ = only_material(write_obj(
        tmp_path, PLANE, "newmtl a\nmap_Pr -imfchan g orm.png\nmap_Pm -imfchan b orm.png\n"))
    np.testing.assert_array_equal(packed.metallic_roughness_map.pixels[0, 0, 1:3], [100, 200])
    sizes, _ = only_material(write_obj(tmp_path, PLANE, "newmtl a\nmap_Pr small.png\nmap_Pm -imfchan b orm.png\n"))
    np.testing.assert_array_equal(sizes.metallic_roughness_map.pixels[..., 1:3], np.tile([50, 200], (2, 2, 1)))


@pytest.mark.parametrize("key", ["norm", "map_bump", "map_Pr", "map_Pm"])
def test_maps_that_can_be_done_without_are_a_notice_if_they_are_broken(tmp_path, key):
    (tmp_path / "h.exr").write_bytes(b"no image")
    material, scene = only_material(write_obj(tmp_path, PLANE, f"newmtl a\n{key} h.exr\n"))
    assert material.normal_map is None and any("h.exr" in n for n in scene.notices)


@pytest.mark.parametrize(("keys", "f0"), [("illum 9\nd 0.5\n", 0.04), ("illum 6\nd 1.0\n", 0.5)])
def test_blended_plastics_are_no_mirrors(tmp_path, keys, f0):
    """Blender writes illum 9 for all that is blended."""
    material, _ = only_material(write_obj(tmp_path, PLANE, f"newmtl a\nKd 0.8 0 0\nKs 0.5 0.5 0.5\n{keys}"))
    assert material.specular == pytest.approx((f0,) * 3)


def test_a_mask_stays_visible_where_the_material_is_half_transparent(tmp_path):
    (tmp_path / "mask.png").write_bytes(png(np.array([[0, 255]])))
    material, _ = only_material(write_obj(tmp_path, PLANE, "newmtl a\nd 0.4\nmap_d mask.png\n"))
    assert material.alpha * 1.0 >= material.alpha_cutoff > 0


def test_what_is_no_number_in_an_mtl_file_is_named(tmp_path):
    mtl = "newmtl a\nKd 0.5 x 0.2\nNs nan\nKe 2\nd -halo 1\n"
    material, scene = only_material(write_obj(tmp_path, PLANE, mtl))
    assert material.albedo == (0.8,) * 3 and material.emission == (2.0,) * 3
    assert [n for n in scene.notices if "no number" in n] == [
        "material 'a': 'kd 0.5 x 0.2' is no number, so it is ignored",
        "material 'a': 'ns nan' is no number, so it is ignored"]


def test_opacity_is_the_coverage_of_a_blended_surface_and_d_takes_precedence_over_tr(tmp_path):
    solid, scene = only_material(write_obj(tmp_path, PLANE, "newmtl a\nTr 1.0\nd 1.0\n"))
    assert not solid.is_blended and not any("transparent" in n for n in scene.notices)
    glass, _ = only_material(write_obj(tmp_path, PLANE, "newmtl a\nTr 0.75\n"))
    assert glass.is_blended and glass.alpha == 0.25 and glass.alpha_cutoff is None
    inverted, scene = only_material(write_obj(tmp_path, PLANE, "newmtl a\nd 0.000000\nillum 6\n"))
    assert not inverted.is_blended and any("invisible" in n for n in scene.notices)


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


@pytest.mark.parametrize("name", [r"C:\Users\me\Desktop\textures\Wood.PNG", "/home/me/textures/wood.png",
                                  "../maps/wood.png"])
@pytest.mark.parametrize("folder", ["", "textures"])
def test_a_texture_with_a_path_of_another_machine_is_found_beside_its_mtl(tmp_path, name, folder):
    """In the folder of its own name there, or else among the other files."""
    (tmp_path / folder).mkdir(exist_ok=True)
    (tmp_path / folder / "wood.png").write_bytes(png(np.full((2, 2, 3), 0.5)))
    path = write_obj(tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n", f"newmtl a\nmap_Kd {name}\n")
    material, scene = only_material(path)
    is_known = folder == "" or "textures" in name
    assert (material.albedo_map is not None) == is_known
    assert any("missing" in notice for notice in scene.notices) != is_known


@pytest.mark.filterwarnings("error")
def test_emission_is_clamped_to_the_maximum(tmp_path):
    material, scene = only_material(write_obj(tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKe 1e200 2 -1\n"))
    assert material.emission == (1e30, 2, 0)
    assert np.isfinite(np.float32(scene.lights[0].radiance)).all()


def test_undefined_material_gets_the_default_and_a_notice(tmp_path):
    _, scene = only_material(write_obj(tmp_path, QUAD + "usemtl ghost\nf 1 2 3 4\n", "newmtl a\nKd 0 0 0\n"))
    assert any("ghost" in n for n in scene.notices)


def test_one_notice_counts_the_materials_that_are_not_defined(tmp_path):
    faces = "".join(f"usemtl m{i}\nf 1 2 3 4\n" for i in range(6))
    scene = load_scene(write_obj(tmp_path, QUAD + "usemtl a\nf 1 2 3 4\n" + faces, "newmtl a\nKd 1 1 1\n"))
    notices = [notice for notice in scene.notices if "defined" in notice]
    assert notices == ["6 materials are not defined, so the default material is used: 'm0', 'm1', 'm2', 'm3', …"]


def test_objects_and_materials_stay_apart(tmp_path):
    obj = QUAD + "o one\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\no two\nf 1 2 4\n"
    scene = load_scene(write_obj(tmp_path, obj, "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n"))
    pairs = {(i.name, scene.materials[scene.meshes[i.mesh].material].name) for i in scene.instances}
    assert pairs == {("one", "a"), ("one", "b"), ("two", "b")}


def test_colours_of_vertices_are_encoded_as_in_scans(tmp_path):
    colored = "".join(f"v {x} {y} 0 0.5 1 0\n" for x, y in ((0, 0), (1, 0), (1, 1)))
    scene = load_scene(write_obj(tmp_path, colored + "f 1 2 3\n"))
    np.testing.assert_allclose(scene.meshes[0].colors, np.tile([0.2140, 1, 0, 1], (3, 1)), atol=1e-4)


def ridge(height):
    """Two squares that meet at an edge along y."""
    return "".join(f"v {x} {y} {height * (x == 1)}\n" for x in (0, 1, 2) for y in (0, 1))


@pytest.mark.parametrize(("height", "groups", "normals"), [
    (0.2, "", 1), (1.0, "", 2), (1.0, "s 1\n", 1), (0.2, "s off\n", 0), (0.2, "s 0\n", 0)],
    ids=["smooth", "sharp", "group", "off", "zero"])
def test_surfaces_without_normals_are_smooth_where_no_edge_is_sharp(tmp_path, height, groups, normals):
    """Squares at 23 degrees share a normal at their edge, those at 90 do not, unless a smoothing group joins them."""
    scene = load_scene(write_obj(tmp_path, ridge(height) + groups + "f 1 3 4 2\nf 3 5 6 4\n"))
    mesh, = scene.meshes
    at_edge = mesh.normals[mesh.triangles][np.isclose(world(scene, scene.instances[0])[..., 0], 1)]
    if normals == 1:
        np.testing.assert_allclose(at_edge, np.tile([0, 0, 1], (len(at_edge), 1)), atol=1e-6)
    else:
        assert not mesh.normals.any(), "all is flat"


@pytest.mark.parametrize("group", ["", "s 1\n"], ids=["by angle", "group"])
def test_surfaces_are_smooth_across_materials_and_polygons_of_different_lengths(tmp_path, group):
    obj = ridge(0.2) + group + "usemtl a\nf 1 3 4 2\nusemtl b\nf 3 5 6\nf 3 6 4\n"
    scene = load_scene(write_obj(tmp_path, obj, "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n"))
    assert len(scene.meshes) == 2
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        at_edge = mesh.normals[mesh.triangles][np.isclose(world(scene, instance)[..., 0], 1)]
        np.testing.assert_allclose(at_edge, np.tile([0, 0, 1], (len(at_edge), 1)), atol=1e-6)


def test_faces_back_to_back_stay_flat_and_groups_are_not_objects(tmp_path):
    both = load_scene(write_obj(tmp_path, QUAD + "s 1\nf 1 2 3 4\nf 4 3 2 1\n"))
    assert not both.meshes[0].normals.any() and both.triangles == 4
    many = "".join(f"s {i + 1}\nf 1 2 3\n" for i in range(5000))
    assert len(load_scene(write_obj(tmp_path, QUAD + many)).meshes) == 1


def test_faces_with_and_without_texture_coordinates_keep_what_they_have(tmp_path):
    obj = QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nf 1/1 2/2 3/3\nf 1 2 3 4\nf 1/1/1 2/2/1 3/3/1\n"
    scene = load_scene(write_obj(tmp_path, obj))
    assert scene.triangles == 4 and any(m.uvs is not None for m in scene.meshes)


def test_concave_polygons_beside_triangles(tmp_path):
    obj = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nf 2 3 4 5 6 1\nf 1 2 3\n"
    scene = load_scene(write_obj(tmp_path, obj))
    places = world(scene, scene.instances[0])
    areas = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])[:, 2] / 2
    assert len(scene.meshes) == 1 and areas.sum() == pytest.approx(3 + 1)


@pytest.mark.parametrize("corners", [
    [(0, 0), (1, 0), (0.2, 0.2), (0, 1)], [(0.2, 0.2), (0, 1), (0, 0), (1, 0)],
    [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
    [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]],
    ids=["dart", "turned dart", "L", "frame with a hole"])
def test_concave_polygons_cover_no_more_than_they_are(tmp_path, corners):
    points = "".join(f"v {x} {y} 0\n" for x, y in corners)
    scene = load_scene(write_obj(tmp_path, points + "f " + " ".join(map(str, range(1, len(corners) + 1))) + "\n"))
    places = world(scene, scene.instances[0])
    signed = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])[:, 2] / 2
    x, y = np.array(corners, float).T
    assert (signed > 0).all()
    assert signed.sum() == pytest.approx(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


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


@pytest.mark.filterwarnings("error")
def test_polygons_with_broken_corners_are_dropped(tmp_path):
    obj = QUAD + "v nan 0 0\nv 1e300 1 1\nv 0 -1e200 3\nf 1 2 3 4\nf 1 2 5 3\nf 1 6 2 7\nf 1 1 1 1\n"
    assert load_scene(write_obj(tmp_path, obj)).triangles == 2


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
