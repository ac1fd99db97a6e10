"""Six views as one picture: what the renderer packs is what ``export.models.panorama`` merges, and neighbours fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("onnx")
from onnx import TensorProto, helper, save

from app.environment import radiance_along
from app.golden import scenes
from app.math3d import View, cube_rotations
from app.network.contract import KEY, ModelContract, TensorSpec
from app.network.contract_json import contract_to_json
from app.network.inputs import prepare_inputs
from app.radiance_scale import radiance_scale
from app.renderer import Renderer
from app.scene import PointLight
from app.settings import Settings
from export.models.panorama import directions, merge_cube

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

FACE = 32
CHANNELS = ("direct.rgb", "albedo.rgb", "normal.view.xyz", "position.view.xyz", "depth", "emission.rgb", "roughness",
            "surface_and_sky_radiance.rgb")


def network(path: Path, axes: str) -> Path:
    """Reads the same channels as a cube and as a panorama, and gives no light."""
    contract = ModelContract(
        name="around", inputs={"screen": TensorSpec(("direct.rgb",)), "cube": TensorSpec(CHANNELS, "cube", FACE),
                               "panorama": TensorSpec(CHANNELS, "panorama", 2 * FACE)},
        outputs={"y": TensorSpec(("indirect.rgb",))}, scale=0.25, exposure="none", bounces="multi", scene_extent=40.0,
        cube_axes=axes)
    inputs = [helper.make_tensor_value_info(t, TensorProto.FLOAT, [1, s.components, *s.extent(("h", "w"))])
              for t, s in contract.inputs.items()]
    output = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 3, "h", "w"])
    none = helper.make_tensor("none", TensorProto.FLOAT, [], [0.0])
    made = helper.make_model(
        helper.make_graph([helper.make_node("Mul", ["screen", "none"], ["y"])], "around", inputs, [output], [none]),
        opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, {KEY: contract_to_json(contract)})
    save(made, path)
    return path


@pytest.fixture(scope="module", params=["camera", "world"])
def axes(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def packed(axes: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Cube and panorama of a room."""
    model = network(tmp_path_factory.mktemp("nets") / "around.onnx", axes)
    scene = scenes.room()
    with Renderer(scene, Settings((64, 48), ("indirect",), taa=False, provider="cpu"), model) as renderer:
        renderer.render(scene.cameras[scene.default_camera].at(0.5))
        return {t: renderer.resource(f"tensor_{t}") for t in ("cube", "panorama")}


def test_depth_lies_along_directions(packed: dict[str, np.ndarray], axes: str) -> None:
    panorama = packed["panorama"]
    place = directions(2 * FACE) * panorama[12]
    if axes == "world":
        assert np.abs(np.linalg.norm(place, axis=0) - np.linalg.norm(panorama[9:12], axis=0)).max() < 1e-2
    else:
        np.testing.assert_allclose(place, panorama[9:12], atol=1e-2)
    assert panorama[12].max() > 3


def test_the_panorama_is_the_merged_cube(packed: dict[str, np.ndarray]) -> None:
    assert packed["panorama"].shape == (20, 2 * FACE, 4 * FACE)
    np.testing.assert_array_equal(packed["panorama"], merge_cube(packed["cube"]))


def test_lumination_shows_the_environment_all_around(axes: str, tmp_path: Path) -> None:
    """Where a surface is, it is direct light and emission; elsewhere the environment along the texel's direction."""
    scene = scenes.dusk()
    glowing = replace(scene.materials[1], emission=(0.5, 1.0, 2.0))
    lamp = PointLight((1.0, 2.0, 1.0), (3.0, 2.0, 1.0))
    scene = replace(scene, lights=(lamp,), materials=(scene.materials[0], glowing))
    assert scene.environment is not None
    camera = replace(scene.cameras[scene.default_camera].at(0.0), target=(-2.0, 1.6, 0.0))
    with Renderer(scene, Settings((64, 48), ("indirect",), taa=False, provider="cpu"),
                  network(tmp_path / "around.onnx", axes)) as renderer:
        renderer.render(camera)
        assert "cube_background" in {p.name for p in renderer.plan.passes}
        cube, scale = renderer.resource("tensor_cube"), radiance_scale(scene)
    at = (2 * np.arange(FACE) + 1) / FACE - 1
    x, y = np.meshgrid(at, -at)
    rotations = cube_rotations() @ (View.of(camera, (64, 48), 0.01).rotation if axes == "camera" else np.eye(3))
    towards = np.stack([np.stack([x, y, -np.ones_like(x)], -1) @ rotation for rotation in rotations])
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    sky = cube[12] == 0
    expected = scale * radiance_along(scene.environment, towards[sky])
    assert 0.3 < sky.mean() < 0.99
    found = np.moveaxis(cube[17:20], 0, -1)
    off = np.abs(found[sky] - expected).max(axis=1)
    assert np.median(off) < 0.01 and np.percentile(off, 90) < 0.05  # but for texels larger than the map's
    assert cube[:3].max() > 0.1 and cube[13:16].max() > 0.1
    np.testing.assert_allclose(found[~sky], np.moveaxis(cube[0:3] + cube[13:16], 0, -1)[~sky], atol=1e-3)


def test_what_a_network_is_given_keeps_the_sky_of_lumination_alone() -> None:
    """Which counts in the mean, too: an environment may be all light that there is. Other radiance is masked there."""
    contract = ModelContract(
        name="x", inputs={"x": TensorSpec(("direct.rgb", "surface_and_sky_radiance.rgb", "depth"))},
        outputs={"y": TensorSpec(("indirect.rgb",))}, scale=1.0, exposure="mean-radiance", bounces="multi",
        scene_extent=40.0)
    given = np.full((7, 4, 4), 2.0, np.float32)
    given[6, :2] = 0.0
    given[3:6, :2] = 10.0
    out = {"x": np.empty_like(given)}
    mean = (24 * 2.0 + 24 * 2.0 + 24 * 10.0) / 72  # direct light; surface_and_sky_radiance of surfaces, and of the sky
    assert prepare_inputs(contract, {"x": given}, out) == pytest.approx(mean)
    assert not out["x"][:3, :2].any()
    np.testing.assert_allclose(out["x"][3:6, :2], 10 / mean)
    np.testing.assert_allclose(out["x"][:6, 2:], 2 / mean)


def test_neighbours_show_what_lies_side_by_side(packed: dict[str, np.ndarray]) -> None:
    """Directions hardly turn from a column of the middle to the next, all around; nor from the front to the caps."""
    position = packed["panorama"][9:12]
    towards = position / np.maximum(np.linalg.norm(position, axis=0), 1e-9)
    seen = np.linalg.norm(position, axis=0) > 0
    middle, both = towards[:, FACE], seen[FACE] & np.roll(seen[FACE], -1)
    turn = (middle * np.roll(middle, -1, axis=1)).sum(axis=0)[both]
    assert both.sum() > FACE and turn.min() > np.cos(3 / FACE)
    front = slice(FACE * 3 // 2, FACE * 5 // 2)
    for edge in (FACE // 2, 3 * FACE // 2):  # the caps' columns are spread over the whole width
        inner, outer = (edge, edge - 1) if edge == FACE // 2 else (edge - 1, edge)
        here, cap = towards[:, inner, front], towards[:, outer, ::4]
        both = seen[inner, front] & seen[outer, ::4]
        assert both.any() and (here * cap).sum(axis=0)[both].min() > np.cos(6 / FACE)
