"""Scenes and pictures from Python."""

from __future__ import annotations

import io
import pickle
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import app.api as afterglow
from app.errors import AfterglowError
from app.io.image import read_exr, read_png
from app.load import load_scene
from app.network.selection import find_model
from app.renderer import Renderer as Engine
from app.settings import SETTLE_FRAMES, Settings
from tests.tiny_network import write_tiny_network

pytestmark = pytest.mark.gl
SIZE = (48, 36)
LIGHT = afterglow.PointLight((0.5, 2.0, 1.5), (4.0, 4.0, 4.0))
CAMERA = afterglow.Camera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0))


def floor_and_box() -> afterglow.Scene:
    scene = afterglow.Scene()
    scene.add(trimesh.creation.box((4.0, 0.1, 4.0)), afterglow.Material(albedo=(0.7, 0.7, 0.7)), name="floor")
    scene.add(trimesh.creation.box((0.6, 0.6, 0.6)), afterglow.Material(albedo=(0.7, 0.2, 0.1)), moved(0.0), name="box")
    scene.lights.append(LIGHT)
    return scene


def moved(x: float) -> np.ndarray:
    return trimesh.transformations.translation_matrix((x, 0.5, 0.0))


def draw(scene: afterglow.Scene, **options: object) -> np.ndarray:
    with afterglow.Renderer(scene, SIZE, None, taa=False, **options) as renderer:
        return renderer.render(CAMERA)["final"]


def test_arrays_and_a_file_of_them_give_the_same_bits(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(2)
    mesh.vertex_normals  # noqa: B018  # which the file then has too
    mesh.export(tmp_path / "ball.ply", vertex_normal=True, encoding="binary")
    stored = trimesh.load(tmp_path / "ball.ply", process=False)
    from_file, from_arrays = afterglow.load(tmp_path / "ball.ply"), afterglow.Scene()
    from_arrays.add((stored.vertices, stored.faces), normals=stored.vertex_normals)
    for scene in (from_file, from_arrays):
        scene.lights.append(LIGHT)
    assert np.array_equal(draw(from_file), draw(from_arrays))


def test_a_still_is_that_of_the_command_line(tmp_path: Path) -> None:
    with afterglow.Renderer(afterglow.load(), SIZE, write_tiny_network(tmp_path / "tiny.onnx")) as renderer:
        renderer.render(CAMERA)
        frame = renderer.render()
    path = Path("app/data/cornell-box.obj")
    scene = load_scene(Path(__file__).parents[2] / path)
    camera = scene.cameras[scene.default_camera].at(0.0)
    with Engine(scene, Settings(size=SIZE), [find_model(str(tmp_path / "tiny.onnx"))]) as engine:
        for _ in range(SETTLE_FRAMES):
            engine.advance(camera)
        images = engine.render(camera)
    assert np.array_equal(frame["final"], images["final"])
    assert np.array_equal(frame.display, images["display"])


def test_an_object_moves_between_frames() -> None:
    scene, placed = floor_and_box(), floor_and_box()
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        before = renderer.render(CAMERA)["final"]
        for x in (0.4, 0.8):
            scene["box"].transform = moved(x)
            after = renderer.render(CAMERA)["final"]
    placed["box"].transform = moved(0.8)
    assert np.abs(after - before).max() > 0.05
    assert np.allclose(after, draw(placed), atol=2e-3)


def test_objects_of_a_file_move() -> None:
    scene = afterglow.load()
    name = next(name for name in scene.objects if "tall" in name.lower() or "box" in name.lower())
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        before = renderer.render()["final"]
        scene[name].transform = trimesh.transformations.translation_matrix((0.0, 0.3, 0.0))
        assert np.abs(renderer.render()["final"] - before).max() > 0.05


def test_a_closed_renderer_says_so() -> None:
    with afterglow.Renderer(floor_and_box(), SIZE, None) as renderer:
        renderer.render(CAMERA)
    for draw_again in (renderer.render, lambda camera: next(renderer.render_video([camera], [0.0]))):
        with pytest.raises(AfterglowError, match="renderer: it is closed"):
            draw_again(CAMERA)


def test_a_light_changes_between_frames() -> None:
    scene = floor_and_box()
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        before = renderer.render(CAMERA)["final"]
        scene.lights[0] = replace(LIGHT, intensity=(2.0, 2.0, 2.0))
        assert np.allclose(renderer.render(CAMERA)["final"], before / 2, rtol=2e-3, atol=1e-4)
        scene.lights.append(afterglow.DirectionalLight((0.0, -1.0, 0.0), (1.0, 1.0, 1.0)))
        assert renderer.render(CAMERA)["final"].mean() > before.mean() / 2


def test_lights_of_arrays_are_those_of_tuples() -> None:
    scene = floor_and_box()
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        before = renderer.render(CAMERA)["final"]
        scene.lights[0] = replace(LIGHT, position=np.array(LIGHT.position), intensity=[2.0, 2.0, 2.0])
        half = renderer.render(CAMERA)["final"]
        scene.lights[0] = replace(LIGHT, position=np.array(LIGHT.position))
        assert np.array_equal(renderer.render(CAMERA)["final"], before) and half.mean() < before.mean()


def test_cameras_of_a_scene_are_used_by_name() -> None:
    scene = floor_and_box()
    scene.cameras["front"] = CAMERA
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        assert np.array_equal(renderer.render("front")["final"], renderer.render(CAMERA)["final"])


def test_added_and_removed_objects_follow() -> None:
    scene = floor_and_box()
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        before = renderer.render(CAMERA)["final"]
        scene.add(trimesh.creation.icosphere(), transform=moved(1.2), name="box")
        assert list(scene.objects) == ["floor", "box", "box.1"]
        assert np.abs(renderer.render(CAMERA)["final"] - before).max() > 0.05
        scene.remove("box.1")
        assert np.array_equal(renderer.render(CAMERA)["final"], before)


def test_a_batch_depends_on_the_set_of_its_cameras_alone(small_ember: Path) -> None:
    scene = afterglow.load()
    camera = scene.cameras[next(iter(scene.cameras))].at(0.0)
    cameras = [replace(camera, fov_y_deg=camera.fov_y_deg + 5 * i) for i in range(3)]
    with afterglow.Renderer(scene, (24, 18), small_ember) as renderer:
        forward = renderer.render_batch(cameras)
        renderer.render(cameras[1])
        backward = renderer.render_batch(cameras[::-1])
        twice = renderer.render_batch([*cameras, cameras[0]])
    for a, b, c in zip(forward, backward[::-1], twice[:3], strict=True):
        assert a.camera == b.camera == c.camera and np.array_equal(a["final"], b["final"])
        assert np.array_equal(a["final"], c["final"])
    assert np.array_equal(twice[3]["final"], twice[0]["final"])


def test_a_trimesh_scene_keeps_its_parts_and_materials() -> None:
    parts = trimesh.Scene()
    red = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(
        baseColorFactor=(255, 0, 0, 255), metallicFactor=0.0))
    parts.add_geometry(trimesh.Trimesh(**trimesh.creation.box((1.0, 1.0, 1.0)).to_dict(), visual=red), "red",
                       transform=moved(-1.0))
    parts.add_geometry(trimesh.creation.box((1.0, 1.0, 1.0)), "grey", transform=moved(1.0))
    scene = afterglow.Scene()
    scene.add(parts)
    with afterglow.Renderer(scene, SIZE, None, taa=False, outputs=("albedo",)) as renderer:
        albedo = renderer.render(CAMERA)["albedo"]
    left, right = albedo[15, 14], albedo[15, 34]
    assert left[0] > 0.9 and left[1] < 0.01 and np.ptp(right) < 0.01 < right[0]


def test_colours_of_a_trimesh_are_srgb() -> None:
    scene, mesh = afterglow.Scene(), trimesh.creation.box((2.0, 2.0, 2.0))
    mesh.visual.vertex_colors = (188, 0, 0, 255)
    scene.add(mesh)
    with afterglow.Renderer(scene, SIZE, None, taa=False, outputs=("albedo",)) as renderer:
        assert renderer.render(CAMERA)["albedo"][18, 24] == pytest.approx([0.5, 0.0, 0.0], abs=0.01)


@pytest.mark.parametrize("smooth", [False, True])
def test_colours_of_faces_are_not_blended(smooth: bool) -> None:
    scene, mesh = afterglow.Scene(), trimesh.Trimesh(*QUAD, process=False)
    mesh.visual.face_colors = [[255, 0, 0, 255], [0, 0, 255, 255]]
    scene.add(mesh, smooth=smooth)
    albedo = draw_aov(scene, "albedo")
    assert albedo[28, 32] == pytest.approx([1.0, 0.0, 0.0], abs=0.01)
    assert albedo[8, 16] == pytest.approx([0.0, 0.0, 1.0], abs=0.01)


def test_colours_of_faces_leave_a_smooth_mesh_smooth() -> None:
    normals = []
    for has_colours in (False, True):
        scene, ball = afterglow.Scene(), trimesh.creation.icosphere(1)
        if has_colours:
            ball.visual.face_colors = [(255, 0, 0, 255)] * len(ball.faces)
        scene.add(ball, smooth=True)
        normals.append(draw_aov(scene, "normal"))
    assert np.abs(normals[0] - normals[1]).max() < 1e-3


def test_a_frame_is_shown_saved_and_shared(tmp_path: Path) -> None:
    with afterglow.Renderer(floor_and_box(), SIZE, None, taa=False, outputs=("final", "depth")) as renderer:
        frame = renderer.render(CAMERA)
    frame.save(tmp_path / "a.exr")
    frame.save(tmp_path / "a.png")
    assert np.array_equal(read_exr(tmp_path / "a.exr")["depth"], frame["depth"])
    assert np.array_equal(read_png(tmp_path / "a.png"), frame.display)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(frame._repr_png_()))), frame.display)
    assert repr(frame) == "Frame(final, depth; 48x36)"
    shared = np.from_dlpack(frame["depth"])
    frame["depth"][0, 0] = 7.0
    assert shared[0, 0] == 7.0
    assert frame in [frame] and frame != pickle.loads(pickle.dumps(frame)) and len({frame, frame}) == 1


def test_compare_gives_all_metrics() -> None:
    pytest.importorskip("flip_evaluator")
    with afterglow.Renderer(floor_and_box(), SIZE, None, taa=False) as renderer:
        frame = renderer.render(CAMERA)
    errors = afterglow.compare(frame, frame["final"] * np.float32(1.1))
    assert set(errors) == {"psnr", "ssim", "rel_mse", "flip"} and errors["flip"] > 0
    assert afterglow.compare(frame, frame)["flip"] == 0


@pytest.mark.parametrize("mistake", [
    lambda: afterglow.Scene().add(([[0, 0]], [[0, 1, 2]])),
    lambda: afterglow.Scene().add((np.zeros((3, 3)), np.array([[0, 1, 9]]))),
    lambda: afterglow.Scene().add((np.zeros((3, 3)), np.array([[0, 1, 2]]))),
    lambda: afterglow.Scene().add((np.eye(3), np.array([[0.0, 1.0, 2.0]]))),
    lambda: afterglow.Scene().add((np.eye(3), np.array([[0, 1, 2]])), uvs=np.zeros((2, 2))),
    lambda: afterglow.Scene().add((np.eye(3), np.array([[0, 1, 2]])), transform=np.eye(3)),
    lambda: afterglow.Scene().add(42),
    lambda: afterglow.Scene()["nothing"],
    lambda: afterglow.load("missing.glb"),
    lambda: afterglow.Renderer(floor_and_box(), (0, 1)),
    lambda: afterglow.Renderer(floor_and_box(), model="embers"),
    lambda: afterglow.Renderer(afterglow.Scene()).render(),
    lambda: afterglow.Renderer(floor_and_box(), SIZE, None).render(np.eye(4)),
    lambda: afterglow.compare(np.zeros((4, 4)), np.zeros((4, 4))),
])
def test_mistakes_are_one_line(mistake: object) -> None:
    with pytest.raises(AfterglowError) as caught:
        mistake()
    assert "\n" not in str(caught.value)


QUAD = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
UVS = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
ABOVE = afterglow.Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), orthographic_height=2.0)


def draw_aov(scene: afterglow.Scene, name: str, camera: afterglow.Camera = ABOVE, size: tuple[int, int] = SIZE
             ) -> np.ndarray:
    with afterglow.Renderer(scene, size, None, taa=False, outputs=(name,)) as renderer:
        return renderer.render(camera)[name]


def test_textures_of_obj_files_that_trimesh_loaded_keep_their_colours() -> None:
    image = np.zeros((4, 4, 3), np.uint8)
    image[:2], image[2:] = (255, 0, 0), (0, 0, 255)  # red above blue
    mesh, scene = trimesh.Trimesh(*QUAD, process=False), afterglow.Scene()
    mesh.visual = trimesh.visual.TextureVisuals(uv=UVS, image=Image.fromarray(image))
    scene.add(mesh)
    albedo = draw_aov(scene, "albedo")
    assert albedo[8, 24] == pytest.approx([1.0, 0.0, 0.0], abs=0.05)
    assert albedo[28, 24] == pytest.approx([0.0, 0.0, 1.0], abs=0.05)


def test_a_normal_map_acts_alike_on_arrays_trimesh_objects_and_files(tmp_path: Path) -> None:
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[..., :3] = 200, 128, 220
    material = afterglow.Material(normal_map=afterglow.Texture(pixels, is_color=False))
    mesh = trimesh.Trimesh(*QUAD, process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=UVS)
    mesh.export(tmp_path / "quad.glb")
    normals = []
    for quad, options in ((QUAD, {"uvs": UVS}), (mesh, {}), (tmp_path / "quad.glb", {})):
        scene = afterglow.Scene()
        scene.add(quad, material, **options)
        normals.append(draw_aov(scene, "normal")[18, 24])
    assert normals[0][0] > 0.5
    assert np.allclose(normals, normals[0], atol=1e-3)


@pytest.mark.parametrize("convention", ["opengl", "opencv"])
def test_balls_are_seen_where_a_calibrated_camera_sees_them(convention: str) -> None:
    scene, centers = afterglow.Scene(), np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.5]])
    for center, colour in zip(centers, np.eye(3), strict=True):
        scene.add(trimesh.creation.icosphere(2, 0.15), afterglow.Material(albedo=colour),
                  trimesh.transformations.translation_matrix(center))
    size, intrinsics = (240, 160), np.array([[300.0, 0, 100], [0, 150, 90], [0, 0, 1]])  # neither square nor centred
    pose = trimesh.transformations.euler_matrix(0.05, 0.1, 0.2)
    pose[:3, 3] = 0.3, 0.2, 5.0
    opencv = pose @ np.diag([1.0, -1, -1, 1])
    camera = afterglow.camera_from_matrix(opencv if convention == "opencv" else pose, intrinsics, size,
                                          convention=convention)
    albedo = draw_aov(scene, "albedo", camera, size)
    for channel, center in enumerate(centers):
        u, v, w = intrinsics @ (np.linalg.inv(opencv) @ np.append(center, 1.0))[:3]
        rows, columns = np.nonzero(albedo[..., channel] > 0.5)
        assert (columns.mean(), rows.mean()) == pytest.approx((u / w, v / w), abs=0.3)


def test_threads_share_a_renderer() -> None:
    with afterglow.Renderer(floor_and_box(), SIZE, None) as renderer:
        expected = renderer.render(CAMERA)["final"]
        with ThreadPoolExecutor(2) as threads:
            pictures = list(threads.map(lambda _: renderer.render(CAMERA)["final"], range(4)))
    assert all(np.array_equal(picture, expected) for picture in pictures)


def test_what_would_spoil_a_video_or_a_batch_is_refused() -> None:
    scene = floor_and_box()
    with afterglow.Renderer(scene, SIZE, None, taa=False) as renderer:
        video = renderer.render_video([CAMERA] * 3, [0.0] * 3)
        next(video)
        renderer.render(CAMERA)
        with pytest.raises(AfterglowError, match="another picture"):
            next(video)
        batch = renderer.iterate_batch([CAMERA, replace(CAMERA, fov_y_deg=50.0)])
        next(batch)
        scene.remove("box")
        renderer.render(CAMERA)
        with pytest.raises(AfterglowError, match="during a batch"):
            next(batch)


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, FileNotFoundError])
def test_an_error_between_frames_leaves_no_video(tmp_path: Path, error: type[BaseException]) -> None:
    pytest.importorskip("av")
    with afterglow.Renderer(floor_and_box(), SIZE, None, taa=False) as renderer:
        def frames() -> Iterator[afterglow.Frame]:
            yield renderer.render(CAMERA)
            raise error

        with pytest.raises(error):
            afterglow.write_video(tmp_path / "a.mp4", frames())
    assert not list(tmp_path.iterdir())
