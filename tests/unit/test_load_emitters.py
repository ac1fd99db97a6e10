"""Emissive surfaces as analytic lights."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from app.load import load_scene
from app.load.emissive_pieces import find_pieces
from app.load.emitters import MAX_IMAGES
from app.load.light_tree import MAX_LIGHTS
from app.scene import Mesh, PointLight, RectLight
from tests.unit.load_helpers import TRIANGLE, Gltf, write_obj

EMISSIVE_MTL = "newmtl emissive\nKe 4 2 1\n"


def load_emissive(folder, obj):
    return load_scene(write_obj(folder, "usemtl emissive\n" + obj, EMISSIVE_MTL))


def power_of(scene):
    """W per channel of all sphere and rectangle lights."""
    return sum(4 * np.pi * np.array(light.intensity) if isinstance(light, PointLight) else
               np.pi * (1 + light.two_sided) * np.linalg.norm(np.cross(light.edge_u, light.edge_v))
               * np.array(light.radiance) for light in scene.lights)


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
    assert all(isinstance(light, RectLight) for light in scene.lights)
    np.testing.assert_allclose(power_of(scene), np.pi * np.array([4, 2, 1]), rtol=1e-9)
    assert any(n.startswith("1 emissive piece became") for n in scene.notices)


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


def test_exact_lights_are_told_from_approximate_ones(tmp_path):
    """One mesh with a rectangle, and a triangle far from it."""
    scene = load_emissive(tmp_path, quad(0) + "v 9 0 0\nv 11 0 0\nv 9 1 0\nf 5 6 7\n")
    (exact,) = scene.exact_lights
    assert exact.center == pytest.approx((0.5, 0.5, 0)) and len(scene.lights) > 1
    assert set(scene.lights) == {exact, *scene.approximate_lights}
    assert len(scene.with_radiance_scale(256.0).exact_lights) == 1
    assert all(m.is_light_proxy for m in scene.materials)
    triangles = [len(m.triangles) for m in scene.meshes if m.material in scene.approximated_materials]
    assert triangles == [1] and scene.triangles == 3


def test_any_number_of_pieces_becomes_few_lights(tmp_path):
    count = 10 * MAX_LIGHTS
    scene = load_emissive(tmp_path, "".join(quad(3 * i, height=0.1 + 0.01 * i, base=4 * i) for i in range(count)))
    assert len(scene.lights) <= MAX_LIGHTS
    assert all(m.is_light_proxy for m in scene.materials)
    areas = sum(0.1 + 0.01 * i for i in range(count))
    np.testing.assert_allclose(power_of(scene), np.pi * areas * np.array([4, 2, 1]), rtol=1e-6)
    assert any(f"{count} emissive pieces became {len(scene.lights)} lights" in n for n in scene.notices)


def test_moving_emitters_are_no_lights(tmp_path):
    write_obj(tmp_path, "o fixed\nusemtl emissive\n" + quad(0) + "o moves\nusemtl emissive\n" + quad(5, base=4),
              EMISSIVE_MTL)
    (tmp_path / "scene.json").write_text('{"objects": {"moves": {"keys": [{"time": 0}, {"time": 1}]}}}')
    scene = load_scene(tmp_path / "scene.obj")
    assert len(scene.lights) == 1
    assert {i.name: scene.materials[scene.meshes[i.mesh].material].is_light_proxy for i in scene.instances} == {
        "fixed": True, "moves": False}
    assert any("'moves' moves" in n for n in scene.notices)


def test_a_two_sided_closed_piece_emits_to_the_outside_only(tmp_path):
    """The light within does not leave it."""
    powers = []
    for double_sided in (False, True):
        gltf = Gltf()
        gltf.material(emissiveFactor=[1, 1, 1], doubleSided=double_sided)
        ball = trimesh.creation.icosphere(2)
        faces = ball.faces[:, ::-1] if double_sided else ball.faces
        gltf.primitive["attributes"]["POSITION"] = gltf.array(ball.vertices.astype(np.float32))
        gltf.primitive["indices"] = gltf.array(faces.astype(np.uint16).ravel())
        (light,) = load_scene(gltf.save(tmp_path)).lights
        assert isinstance(light, PointLight)
        powers.append(light.intensity)
    np.testing.assert_allclose(*powers)
    np.testing.assert_allclose(powers[0], np.pi, rtol=0.03)


@pytest.mark.parametrize("pole", [0.0, 1e-3])
def test_a_seam_closes_but_for_rounding(pole):
    """The columns of a sphere's first and last meridian, and its poles: collapsed triangles, or tiny holes."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 9), np.linspace(pole, np.pi - pole, 5))
    positions = 1e-2 * np.stack([np.cos(u) * np.sin(v), np.cos(v), np.sin(u) * np.sin(v)], axis=-1).reshape(-1, 3)
    first = (9 * np.arange(4)[:, None] + np.arange(8)).ravel()
    faces = np.concatenate([np.stack([first, first + 1, first + 10], 1), np.stack([first, first + 10, first + 9], 1)])
    ball, hole = (Mesh("ball", positions.astype(np.float32), np.zeros((45, 3), np.float32), f.astype(np.uint32))
                  for f in (faces, np.delete(faces, 12, axis=0)))
    assert find_pieces(ball).is_closed.tolist() == [True]
    assert find_pieces(hole).is_closed.tolist() == [False]


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


@pytest.mark.parametrize(("mode", "alpha", "share"), [
    ("OPAQUE", 0.1, 1.0), ("BLEND", 0.1, 0.1), ("MASK", 0.6, 1.0)])
def test_what_is_covered_emits(mode: str, alpha: float, share: float, tmp_path):
    file = Gltf()
    file.material(alphaMode=mode, pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, alpha]},
                  emissiveFactor=[1, 0.5, 0.25], doubleSided=False)
    scene = load_scene(file.save(tmp_path), studio=False)
    area = 0.5
    np.testing.assert_allclose(power_of(scene), share * np.pi * area * np.array([1, 0.5, 0.25]), rtol=1e-6)


def test_a_triangle_emits_what_its_texture_is_over_it(tmp_path):
    gltf = Gltf()
    gltf.material(emissiveFactor=[1, 1, 1], doubleSided=True,
                  emissiveTexture={"index": gltf.texture(np.array([[[255] * 3, [0] * 3]]))})
    gltf.primitive["attributes"]["TEXCOORD_0"] = gltf.array(TRIANGLE[:, :2].copy())
    scene = load_scene(gltf.save(tmp_path))
    share = 5 / 8  # the integral of the interpolated and repeated texels over the triangle
    np.testing.assert_allclose(power_of(scene), 2 * np.pi * 0.5 * share, rtol=0.005)
    assert all(light.two_sided for light in scene.lights)
    assert tuple(scene.approximate_lights) == scene.lights, "a texture's details are no exact radiance"


def screen(pixels, **node) -> Gltf:
    """A square of side 1 with an emission texture of ``pixels``, whose left column is on its left."""
    gltf = Gltf()
    gltf.material(emissiveFactor=[1, 1, 1], doubleSided=False, emissiveTexture={"index": gltf.texture(pixels)})
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    gltf.primitive["attributes"]["POSITION"] = gltf.array(corners)
    gltf.primitive["attributes"].pop("NORMAL", None)
    uvs = np.stack([corners[:, 0], 1 - corners[:, 1]], axis=1)
    gltf.primitive["attributes"]["TEXCOORD_0"] = gltf.array(uvs.astype(np.float32))
    gltf.primitive["indices"] = gltf.array(np.array([0, 1, 2, 0, 2, 3], np.uint16))
    gltf.json["nodes"][0].update(node)
    return gltf


def quarters() -> np.ndarray:
    """Large texels, encoded: red and green above, blue and black below."""
    colors = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [0, 0, 0]]])
    return colors.repeat(32, axis=0).repeat(32, axis=1)


def emitted_at(scene, point) -> np.ndarray:
    """Radiance of the only light, which has an image, at a world-space point on it."""
    (light,) = scene.lights
    away = np.subtract(point, light.center)
    place = [away @ np.array(edge) / np.dot(edge, edge) + 0.5 for edge in (light.edge_u, light.edge_v)]
    height, width, _ = light.image.pixels.shape
    return light.image.pixels[int(place[1] * height), int(place[0] * width)] * light.radiance


@pytest.mark.parametrize("node", [{}, {"scale": [-1, 1, 1]}, {"rotation": [0, 0, 0.6, 0.8], "scale": [2, 1, 1]}])
def test_a_rectangle_with_a_texture_is_a_light_with_its_image(node, tmp_path):
    scene = load_scene(screen(quarters(), **node).save(tmp_path), studio=False)
    transform = scene.instances[0].transform
    for x, y, expected in ((0.25, 0.75, (1, 0, 0)), (0.75, 0.75, (0, 1, 0)), (0.25, 0.25, (0, 0, 1)), (0.75, 0.25, 0)):
        at = (transform @ (x - 0.5, y - 0.5, 0, 1))[:3]  # the mesh is moved so that its middle is the origin
        np.testing.assert_allclose(emitted_at(scene, at), np.broadcast_to(expected, 3), atol=0.01)
    area = abs(np.linalg.det(transform[:3, :3]))
    np.testing.assert_allclose(power_of(scene), np.pi * area / 4, rtol=0.01)
    assert not scene.approximate_lights and not scene.exact_lights
    assert len(scene.approximated_materials) == 1, "the reference traces the surface instead"


def test_a_texture_of_one_colour_has_no_image(tmp_path):
    scene = load_scene(screen(np.full((4, 4, 3), 255)).save(tmp_path), studio=False)
    (light,) = scene.exact_lights
    assert light.image is None and not scene.approximated_materials
    np.testing.assert_allclose(light.radiance, 1, rtol=1e-6)


def test_only_what_is_bright_of_an_atlas_is_a_light(tmp_path):
    """Two squares of one mesh; the texture is black but for the part that the second shows."""
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[:, 40:] = 255
    gltf = screen(pixels)
    corners = np.array([[x + d, y, 0] for d in (0, 3) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
    uvs = np.array([[low + x, y] for low in (0.1, 0.7) for x, y in ((0, 0.2), (0.2, 0.2), (0.2, 0.6), (0, 0.6))])
    gltf.primitive["attributes"]["POSITION"] = gltf.array(corners)
    gltf.primitive["attributes"]["TEXCOORD_0"] = gltf.array(uvs.astype(np.float32))
    gltf.primitive["indices"] = gltf.array(np.array([0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7], np.uint16))
    (light,) = load_scene(gltf.save(tmp_path), studio=False).lights
    np.testing.assert_allclose(light.center, (3.5, 0.5, 0), atol=1e-6)
    np.testing.assert_allclose(light.radiance, 1, rtol=1e-6)


@pytest.mark.parametrize(("side", "lit"), [(1024, 2), (1024, 8), (64, 1), (2048, 16)])
def test_a_small_bright_spot_keeps_its_power(side, lit, tmp_path):
    rng = np.random.default_rng(side + lit)
    pixels = np.zeros((side, side, 3), np.uint8)
    row, column = rng.integers(side // 4, side // 2, 2)
    pixels[row:row + lit, column:column + lit] = 255
    scene = load_scene(screen(pixels).save(tmp_path), studio=False)
    np.testing.assert_allclose(power_of(scene), np.pi * (lit / side)**2, rtol=0.1)


def test_a_dim_part_that_is_large_keeps_its_power(tmp_path):
    """A small bright square and a large one of a hundredth of its radiance, in one mesh."""
    pixels = np.full((64, 64, 3), 25, np.uint8)  # encoded
    pixels[:, 40:] = 255
    gltf = screen(pixels)
    corners = np.array([[x * size, y * size, z] for z, size in ((0, 10), (1, 0.1))
                        for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
    uvs = np.array([[low + x, y] for low in (0.1, 0.7) for x, y in ((0, 0.2), (0.2, 0.2), (0.2, 0.6), (0, 0.6))])
    gltf.primitive["attributes"]["POSITION"] = gltf.array(corners)
    gltf.primitive["attributes"]["TEXCOORD_0"] = gltf.array(uvs.astype(np.float32))
    gltf.primitive["indices"] = gltf.array(np.array([0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7], np.uint16))
    dim = ((25 / 255 + 0.055) / 1.055)**2.4
    scene = load_scene(gltf.save(tmp_path), studio=False)
    np.testing.assert_allclose(power_of(scene), np.pi * (100 * dim + 0.01), rtol=0.01)


def test_a_fine_grid_with_a_texture_is_one_light_with_its_image(tmp_path):
    count = 40
    y, x = (np.mgrid[:count + 1, :count + 1] / count).reshape(2, -1)
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    quads = np.stack([first, first + 1, first + count + 2, first + count + 1], axis=1)
    gltf = screen(quarters())
    gltf.primitive["attributes"]["POSITION"] = gltf.array(np.stack([x, y, 0 * x], axis=1).astype(np.float32))
    gltf.primitive["attributes"]["TEXCOORD_0"] = gltf.array(np.stack([0.4 * x, 0.4 * y], axis=1).astype(np.float32))
    gltf.primitive["indices"] = gltf.array(quads[:, [0, 1, 2, 0, 2, 3]].ravel().astype(np.uint16))
    gltf.material(emissiveFactor=[1, 1, 1], emissiveTexture={"index": gltf.texture(
        np.linspace(100, 255, 64).astype(np.uint8)[None, :, None].repeat(64, axis=0).repeat(3, axis=2))})
    (light,) = load_scene(gltf.save(tmp_path), studio=False).lights
    assert light.image is not None


def test_only_the_brightest_screens_have_images(tmp_path):
    gltf = screen(quarters())
    gltf.json["nodes"] = [{"mesh": 0, "translation": [2 * i, 0, 0]} for i in range(MAX_IMAGES + 2)]
    gltf.json["scenes"][0]["nodes"] = list(range(MAX_IMAGES + 2))
    scene = load_scene(gltf.save(tmp_path), studio=False)
    assert sum(isinstance(light, RectLight) and light.image is not None for light in scene.lights) == MAX_IMAGES
    np.testing.assert_allclose(power_of(scene), np.pi * (MAX_IMAGES + 2) / 4, rtol=0.01)


def test_what_is_cut_out_of_a_card_does_not_emit(tmp_path):
    """Its left half alone."""
    alpha = np.full((32, 32, 4), 255)
    alpha[:, 16:, 3] = 0
    gltf = screen(np.full((4, 4, 3), 255))
    gltf.json["materials"][0] |= {"alphaMode": "MASK", "pbrMetallicRoughness": {
        "baseColorTexture": {"index": gltf.texture(alpha)}}}
    scene = load_scene(gltf.save(tmp_path), studio=False)
    np.testing.assert_allclose(power_of(scene), np.pi / 2, rtol=0.01)
    np.testing.assert_allclose(emitted_at(scene, (0.25, 0.5, 0)), 1, atol=0.01)
    np.testing.assert_allclose(emitted_at(scene, (0.75, 0.5, 0)), 0, atol=0.01)


@pytest.mark.parametrize(("sides", "double_sided", "hidden"), [
    (4, True, True), (6, True, True), (24, True, True), (24, False, False), (0, True, False)])
def test_all_lights_of_a_shade_know_that_it_hides_some_of_its_light(sides, double_sided, hidden, tmp_path):
    """A cylinder without caps; 0 sides: a flat triangle, whose light leaves it."""
    angle = 2 * np.pi * np.arange(max(sides, 3)) / max(sides, 3)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=-1)
    k, after = np.arange(sides), (np.arange(sides) + 1) % max(sides, 1)
    faces = np.concatenate([np.stack([k, after, after + sides], 1), np.stack([k, after + sides, k + sides], 1)])
    gltf = Gltf()
    gltf.material(emissiveFactor=[1, 1, 1], doubleSided=double_sided)
    positions = np.concatenate([ring, np.add(ring, (0, 1, 0))])
    gltf.primitive["attributes"]["POSITION"] = gltf.array(positions.astype(np.float32))
    gltf.primitive["indices"] = gltf.array((faces if sides else np.array([[0, 1, 2]])).astype(np.uint16).ravel())
    scene = load_scene(gltf.save(tmp_path))
    assert scene.approximate_lights
    assert {points.hides_itself for points in scene.approximate_lights.values()} == {hidden}


def test_the_points_of_a_tube_have_its_power(tmp_path):
    """It becomes crossed rectangles, or parts of it do."""
    tube = trimesh.creation.cylinder(0.02, 1.0, sections=16)
    vertices = "".join("v {} {} {}\n".format(*v) for v in tube.vertices)
    scene = load_emissive(tmp_path, vertices + "".join("f {} {} {}\n".format(*f) for f in tube.faces + 1))
    power = sum((np.pi * (1 + points.two_sided[:, None]) * points.intensity).sum(axis=0)
                for points in scene.approximate_lights.values())
    np.testing.assert_allclose(power, np.pi * tube.area * np.array([4, 2, 1]), rtol=0.02)
    np.testing.assert_allclose(power_of(scene), np.pi * tube.area * np.array([4, 2, 1]), rtol=0.02)


@pytest.mark.parametrize("offset", [0.0, 30.0])
def test_the_outside_of_a_piece_with_holes_is_the_same_far_from_its_mesh_s_origin(offset):
    tube = trimesh.creation.cylinder(0.0015, 1.0, sections=8)
    faces = tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5]
    for turned in (False, True):
        mesh = Mesh("tube", (tube.vertices + offset).astype(np.float32), np.zeros((len(tube.vertices), 3), np.float32),
                    (faces[:, ::-1] if turned else faces).astype(np.uint32))
        pieces = find_pieces(mesh)
        assert pieces.is_closed.all()
        assert pieces.is_inside_out.tolist() == [turned]
