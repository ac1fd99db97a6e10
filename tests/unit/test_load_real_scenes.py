"""The real scenes and the glTF edge cases, against their index and their READMEs."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest

from app.load import auto_camera, load_scene
from app.scene import RectLight
from tests.unit.load_helpers import world

NAMES = ("cornell-box", "sponza", "sibenik", "breakfast-room", "grey-white-room", "country-kitchen",
         "contemporary-bathroom", "stanford", "gltf-cases")


def entry(scenes, name):
    return next(e for e in json.loads((scenes / "scenes.json").read_text()) if e["name"] == name)


def without_area(scene):
    return next((int(n.split()[0]) for n in scene.notices if "without area" in n), 0)


@pytest.mark.parametrize("name", NAMES)
def test_counts_bounds_and_lightings(scenes, name):
    facts = entry(scenes, name)
    for lighting in facts["lightings"]:
        scene = load_scene(scenes / facts["file"], lighting=lighting)
        assert scene.triangles + without_area(scene) == facts["triangles"]
        size = np.ptp(facts["bounds"], axis=0).max()
        np.testing.assert_allclose(scene.bounds, facts["bounds"], atol=max(1e-3, 1e-4 * size))
        assert scene.lights and scene.lighting == lighting and scene.default_camera == "main"
        assert {m.emits for m in scene.materials if m.is_light_proxy} <= {True}


@pytest.mark.parametrize("name", ["cornell-box", "gltf-cases"])
def test_variants_load(scenes, name):
    for file in entry(scenes, name)["variants"]:
        scene = load_scene(scenes / file)
        assert scene.triangles and scene.lights and scene.cameras, file
        lengths = np.concatenate([np.linalg.norm(m.normals, axis=1) for m in scene.meshes])
        assert (np.isclose(lengths, 1, atol=1e-3) | (lengths == 0)).all(), file


@functools.lru_cache(maxsize=1)
def emissive(path):
    return load_scene(path, lighting="emissive")


@pytest.mark.parametrize(("file", "center", "low", "high", "normal", "radiance"), [
    ("cornell-box/CornellBox-Original.obj", (-0.005, 1.98, -0.03), (-0.24, 1.98, -0.22), (0.23, 1.98, 0.16), (0, -1, 0),
     (17, 12, 4)),
    ("stanford/stanford-in-box.glb", (-0.005, 1.98, -0.03), (-0.24, 1.98, -0.22), (0.23, 1.98, 0.16), (0, -1, 0),
     (17, 12, 4)),
    ("contemporary-bathroom/contemporary-bathroom.glb", (-2.8982, 1.405, -1.3927), (-2.8982, 0.405, -2.0443),
     (-2.8982, 2.405, -0.7411), (1, 0, 0), (30, 30, 30)),
    ("country-kitchen/country-kitchen.glb", (0.0603, 1.9738, -3.1173), (-0.7515, 0.8731, -3.1173),
     (0.8721, 3.0744, -3.1173), (0, 0, 1), (16.032,) * 3),
    ("country-kitchen/country-kitchen.glb", (-2.3884, 1.6129, -1.0485), (-2.4175, 1.6129, -1.2928),
     (-2.3594, 1.6129, -0.8042), (0, -1, 0), (11.2212,) * 3),
    ("country-kitchen/country-kitchen.glb", (-2.3884, 1.6129, -1.585), (-2.4175, 1.6129, -1.8293),
     (-2.3594, 1.6129, -1.3407), (0, -1, 0), (11.2212,) * 3),
    ("country-kitchen/country-kitchen.glb", (-2.3884, 1.6129, -2.1421), (-2.4175, 1.6129, -2.3864),
     (-2.3594, 1.6129, -1.8978), (0, -1, 0), (11.2212,) * 3),
])
def test_emissive_rectangles_are_the_listed_ones(scenes, file, center, low, high, normal, radiance):
    scene = emissive(scenes / file)
    light = min(scene.lights, key=lambda light: np.linalg.norm(np.subtract(light.center, center)))
    assert isinstance(light, RectLight)
    np.testing.assert_allclose(light.center, center, atol=2e-4)
    half = (np.abs(light.edge_u) + np.abs(light.edge_v)) / 2
    np.testing.assert_allclose([light.center - half, light.center + half], [low, high], atol=2e-4)
    across = np.cross(light.edge_u, light.edge_v)
    np.testing.assert_allclose(across / np.linalg.norm(across), normal, atol=1e-5)
    np.testing.assert_allclose(light.radiance, radiance, rtol=1e-3)
    assert len(scene.lights) == (4 if "kitchen" in file else 1)


def test_the_raw_file_reads_like_the_tidy_one(scenes):
    raw = load_scene(scenes / "cornell-box/CornellBox-Original-raw.obj")
    tidy = load_scene(scenes / "cornell-box/CornellBox-Original.obj", lighting="emissive")
    np.testing.assert_allclose(raw.bounds, [[-1.02, 0, -1.04], [1, 1.99, 0.99]], atol=1e-6)
    assert raw.lights == tidy.lights and raw.triangles == 36
    for a, b in zip(raw.instances, tidy.instances, strict=True):
        np.testing.assert_allclose(world(raw, a), world(tidy, b), atol=1e-6)


@pytest.mark.parametrize(("number", "sign"), [("00", 1), ("01", -1), ("04", -1), ("06", -1)])
def test_negative_scales_mirror(scenes, number, sign):
    scene = load_scene(scenes / f"gltf-cases/NegativeScale/Node_NegativeScale_{number}.gltf")
    child = next(i for i in scene.instances if i.name == "Node1")
    assert np.sign(np.linalg.det(child.transform[:3, :3])) == sign
    assert scene.materials[0].albedo_map.pixels is scene.materials[1].albedo_map.pixels, "one image, decoded once"


def test_instancing_shows_all_boxes(scenes):
    scene = load_scene(scenes / "gltf-cases/simple-instancing.glb")
    assert len(scene.meshes) == 1 and len(scene.instances) == 125
    assert len(np.unique([i.transform[:3, 3] for i in scene.instances], axis=0)) == 125


def test_texture_transform_puts_the_arrow_on_the_marker(scenes):
    scene = load_scene(scenes / "gltf-cases/TextureTransformTest/TextureTransformTest.gltf")
    places = {i.name: i.transform[:2, 3] for i in scene.instances}
    tips = []
    for name in ("Rotation", "Scale", "All"):
        marker = places[f"{name} - Correct"] - places[name] + 0.5  # the quad's own uv there, v upwards
        instance = next(i for i in scene.instances if i.name == name)
        texture = scene.materials[scene.meshes[instance.mesh].material].albedo_map
        assert texture.repeat == (False, False)
        tips.append((texture.transform @ [*marker, 1])[:2])
    np.testing.assert_allclose(tips, [[0.778, 0.222]] * 3, atol=0.04)


@pytest.mark.parametrize("number", ["00", "02", "05"])
def test_vertex_colours_are_red_green_blue(scenes, number):
    scene = load_scene(scenes / f"gltf-cases/VertexColor/Mesh_PrimitiveVertexColor_{number}.gltf")
    colors = scene.meshes[0].colors
    assert colors.shape == (4, 4) and colors.dtype == np.float32
    assert {tuple(c.round(2)) for c in colors[:, :3]} >= {(1, 0, 0), (0, 0, 1)}


def test_emissive_strength_and_broken_normals(scenes):
    scene = load_scene(scenes / "gltf-cases/CornellBox-emissive-strength.glb", lighting="lamp")
    assert not any(m.emits for m in scene.materials)
    bare = scenes / "gltf-cases/CornellBox-emissive-strength.glb"
    assert "lamp" in load_scene(bare).lighting
    bad = load_scene(scenes / "gltf-cases/BoxBadNormals.glb")
    assert any("4 normals" in n for n in bad.notices)


def test_alpha_modes_side_by_side(scenes):
    scene = load_scene(scenes / "gltf-cases/AlphaBlendModeTest.glb")
    cutoffs = {m.name: m.alpha_cutoff for m in scene.materials}
    assert cutoffs == {"MatCutoff25": 0.25, "MatCutoff75": 0.75, "MatBed": None, "MatBlend": None, "MatOpaque": None,
                       "MatCutoffDefault": 0.5}
    assert [m.name for m in scene.materials if m.is_blended] == ["MatBlend"]
    assert scene.default_camera.startswith("camera")


def test_points_and_lines_among_triangles(scenes):
    scene = load_scene(scenes / "gltf-cases/PrimitiveModeNormalsTest.glb")
    assert any("point clouds" in n for n in scene.notices)
    assert len(scene.instances) == 9


def test_rooms_and_objects_are_distinguished(scenes):
    for file, inside in [("sponza/sponza.glb", True), ("sibenik/sibenik.obj", True), ("stanford/bunny.ply", False),
                         ("country-kitchen/country-kitchen.glb", True), ("gltf-cases/BoxInterleaved.glb", False)]:
        scene = load_scene(scenes / file)
        eye = np.array(auto_camera(scene).eye)
        assert bool(((scene.bounds[0] < eye) & (eye < scene.bounds[1])).all()) is inside, file
