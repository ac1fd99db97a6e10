"""Light straight from an environment: unshadowed shading against integrals, and with other networks and lights."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from app.environment import sky_light
from app.errors import ModelError, SettingsError
from app.network.channels import DIFFUSE, SPECULAR, UNSHADOWED_CHANNELS
from app.network.contract import KEY, ModelContract, TensorSpec
from app.network.contract_json import contract_from_json, contract_to_json
from app.network.selection import UNSHADOWED
from app.renderer import Renderer
from app.scene import Camera, Environment, Material, PointLight, Scene
from app.settings import Settings
from tests.gl.closed_forms import ggx_albedo, ggx_compensation
from tests.gl.scenes import F32, box, draw, floor, make_scene, quad
from tests.gl.test_environment import DUSK, SIZE, traced, under

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

WHITE = Environment(np.full((4, 8, 3), 0.7, np.float32))
ABOVE = Camera((0.0, 3.0, 0.01), (0.0, 0.0, 0.0), fov_y_deg=30.0)  # sees nothing but the floor
PASS = ModelContract(
    name="pass", inputs={"x": TensorSpec(UNSHADOWED_CHANNELS), "sky": TensorSpec(("environment.sh",), "globals")},
    outputs={"y": TensorSpec((DIFFUSE, SPECULAR))}, scale=1 / 2, exposure="mean-radiance", bounces="single",
    scene_extent=40.0)


def write_pass(folder: Path, contract: ModelContract = PASS) -> Path:
    """A network that gives half the unshadowed shading."""
    values = [helper.make_tensor_value_info(t, TensorProto.FLOAT, shape) for t, shape in (
        ("x", [1, 6, "h", "w"]), ("sky", [1, 75]), ("y", [1, 6, "h", "w"]))]
    nodes = [helper.make_node("ReduceSum", ["sky"], ["all"], keepdims=0),
             helper.make_node("Mul", ["all", "none"], ["nothing"]),
             helper.make_node("Mul", ["x", "half"], ["less"]), helper.make_node("Add", ["less", "nothing"], ["y"])]
    constants = [helper.make_tensor(n, TensorProto.FLOAT, [], [v]) for n, v in (("half", 0.5), ("none", 0.0))]
    model = helper.make_model(helper.make_graph(nodes, "pass", values[:2], values[2:], constants),
                              opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {KEY: contract_to_json(contract)})
    onnx.save(model, folder / "pass.onnx")
    return folder / "pass.onnx"


def glossy(roughness: float, f0: float = 1.0, albedo: float = 0.0) -> Material:
    return Material(albedo=(albedo,) * 3, roughness=roughness, specular=(f0,) * 3)


def middle(image: F32) -> F32:
    return image[SIZE[1] // 2, SIZE[0] // 2]


def names(scene: Scene, *models: object) -> set[str]:
    with Renderer(scene, Settings(SIZE), models) as renderer:  # type: ignore[arg-type]
        return {p.name for p in renderer.plan.passes}


@pytest.mark.parametrize("environment", [WHITE, DUSK], ids=["white", "dusk"])
@pytest.mark.parametrize("normal", [(0, 1, 0), (0, 0, 1), (0.6, -0.6, 0.5)], ids=str)
def test_diffuse_light_is_the_irradiance(environment: Environment, normal: tuple[float, float, float]) -> None:
    """A lone wall sees half of the sky: the sum over 64 directions, which is near the integral over all cells."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    side = np.cross((0.3, 0.2, 0.9), n)
    side /= np.linalg.norm(side)
    wall = quad(tuple(-side - np.cross(n, side)), tuple(2 * side), tuple(2 * np.cross(n, side)))
    scene = under(environment, wall, camera=Camera(tuple(2 * n), (0, 0, 0), tuple(side), 20.0))
    sky = sky_light(environment, 64)
    few, all_cells = (np.maximum(n @ d.T, 0) @ power / math.pi
                      for d, power in ((sky.direction, sky.power), (sky.cell, sky.cell_power)))
    found = middle(draw(scene, SIZE, ("direct",), model=UNSHADOWED)["direct"])
    np.testing.assert_allclose(found, 0.5 * few, rtol=2e-3)
    np.testing.assert_allclose(found, 0.5 * all_cells, rtol=0.1)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("tilt", [0.0, 30.0, 55.0])
def test_specular_light_is_near_the_lobes_integral(roughness: float, tilt: float) -> None:
    """Under an even sky, with F0 = 1, all light is reflected, once or more often."""
    angle = math.radians(tilt)
    eye = (0.0, 3 * math.cos(angle), 3 * math.sin(angle) + 0.01)
    scene = under(WHITE, floor(4.0, material=glossy(roughness)), camera=Camera(eye, (0, 0, 0), fov_y_deg=10.0))
    found = middle(draw(scene, SIZE, ("specular",), model=UNSHADOWED)["specular"])
    np.testing.assert_allclose(found, 0.7, rtol=0.15)


def test_a_metal_reflects_f0_and_more_at_the_rim() -> None:
    def at(f0: float, tilt: float) -> float:
        angle = math.radians(tilt)
        eye = (0.0, 3 * math.cos(angle), 3 * math.sin(angle) + 0.01)
        scene = under(WHITE, floor(4.0, material=glossy(0.2, f0)), camera=Camera(eye, (0, 0, 0), fov_y_deg=5.0))
        return float(middle(draw(scene, SIZE, ("specular",), model=UNSHADOWED)["specular"])[0])

    assert at(0.3, 0.0) / at(1.0, 0.0) == pytest.approx(0.3, rel=0.01)
    cosine = math.cos(math.radians(80))
    once, grazing = (ggx_albedo(0.04, cosine, schlick) for schlick in (False, True))
    expected = (0.04 * once + 0.96 * grazing) * ggx_compensation(0.04, 0.04, cosine)
    assert at(0.04, 80.0) / at(1.0, 80.0) == pytest.approx(float(expected), rel=0.03)


def test_it_turns_with_the_map_and_scales_with_it() -> None:
    """A wall to the right under a map turned by 90° is a wall ahead under the map as it is."""
    radiance = np.zeros((16, 32, 3), np.float32)
    radiance[6:9, 14:18] = 5.0  # ahead
    ahead = quad((-1, -1, 0), (0, 2, 0), (2, 0, 0))
    left = quad((0, -1, 1), (0, 2, 0), (0, 0, -2))
    seen = [middle(draw(under(Environment(factor * radiance, turn), wall, camera=camera), SIZE, ("direct",),
                        model=UNSHADOWED)["direct"])
            for wall, camera, turn, factor in ((ahead, Camera((0, 0, -3), (0, 0, 0), fov_y_deg=20.0), 0.0, 1.0),
                                               (left, Camera((-3, 0, 0), (0, 0, 0), fov_y_deg=20.0), 90.0, 3.0))]
    assert seen[0].min() > 0.05
    np.testing.assert_allclose(seen[1], 3 * seen[0], rtol=0.02)


def test_it_is_added_to_the_light_of_lamps() -> None:
    lamp = PointLight((0.5, 1.0, 0.0), (1.0, 0.8, 0.6))
    parts = floor(2.0, material=glossy(0.4, 0.5, 0.3)), box((-0.3, 0, -0.3), (0.6,) * 3)
    dark = make_scene(parts, camera=ABOVE)
    pictures = {key: draw(scene, SIZE, ("final",), model=UNSHADOWED)["final"] for key, scene in {
        "both": replace(dark, lights=(lamp,), environment=DUSK), "lamp": replace(dark, lights=(lamp,)),
        "sky": replace(dark, environment=DUSK)}.items()}
    np.testing.assert_allclose(pictures["both"], pictures["lamp"] + pictures["sky"], rtol=5e-3, atol=2e-3)


def test_a_network_shades_and_another_adds_the_bounces(tmp_path: Path, small_ember: Path) -> None:
    """Half the unshadowed shading straight; ember adds bounces alone, with and without a network that shades."""
    network = write_pass(tmp_path)
    scene = under(DUSK, floor(2.0), quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)), quad((-1, 0, 1), (0, 0, -2), (0, 2, 0)),
                  box((-0.3, 0, -0.3), (0.6,) * 3, glossy(0.5, albedo=0.4)))
    unshadowed, less = (draw(scene, SIZE, ("direct", "specular"), model=model) for model in (UNSHADOWED, network))
    for name, image in less.items():
        np.testing.assert_allclose(image, 0.5 * unshadowed[name], rtol=3e-3, atol=1e-3)
    alone, beside = (draw(scene, SIZE, ("direct", "indirect"), model=models)
                     for models in (small_ember, (network, small_ember)))
    np.testing.assert_array_equal(beside["direct"], less["direct"])
    reference = traced(scene, 256)
    seen = reference["albedo"].max(axis=-1) > 0
    bounced = reference["indirect"][seen].mean()
    assert alone["direct"][seen].mean() == pytest.approx(reference["direct"][seen].mean(), rel=0.03)
    for images in (alone, beside):
        assert images["indirect"][seen].mean() == pytest.approx(bounced, rel=0.2)


def test_passes_run_only_where_they_are_needed(tmp_path: Path) -> None:
    network = write_pass(tmp_path)
    plain, polished, dark = (under(e, floor(1.0, material=m)) for e, m in (
        (DUSK, glossy(1.0, 0.0, 0.5)), (DUSK, glossy(0.5)), (None, glossy(0.5))))
    assert not {"unshadowed_environment", "environment_network"} & names(plain)
    assert {"unshadowed_environment", "upsample_diffuse"} <= names(plain, UNSHADOWED)
    assert "upsample_specular" not in names(plain, UNSHADOWED)
    assert {"environment_network", "environment_pack_globals", "upsample_specular"} <= names(polished, network)
    assert not names(dark, network) & {
        "unshadowed_environment", "environment_network", "environment_lowres_gbuffer", "upsample_diffuse"}


def test_two_models_for_the_same_are_refused(tmp_path: Path) -> None:
    scene = under(DUSK)
    for models in ((UNSHADOWED, write_pass(tmp_path)), ("ssgi", "ssgi")):
        with pytest.raises(SettingsError, match="two models"):
            Renderer(scene, Settings(SIZE), models)  # type: ignore[arg-type]


@pytest.mark.parametrize(("changes", "expected"), [
    ({"outputs": {"y": {"channels": [SPECULAR]}}}, "expected either indirect light or"),
    ({"outputs": {"y": {"channels": [DIFFUSE]}}}, "expected either indirect light or"),
    ({"inputs": {"x": {"channels": ["albedo.rgb"], "grid": "cube", "size": 8}}, "cube_axes": "world"},
     "expected screen or globals"),
    ({"inputs": {"x": {"channels": ["bounces"], "grid": "globals"}}}, "channel 'bounces' of a network that shades"),
    ({"outputs": {"y": {"channels": [DIFFUSE, "indirect.rgb"]}}}, "expected either indirect light or"),
    ({"inputs": {"x": {"channels": ["direct.rgb"]}}}, "channel 'direct.rgb' of a network that shades"),
    ({"outputs": {"y": {"channels": ["indirect.rgb"]}}}, "of a network that computes indirect light"),
], ids=lambda x: x if isinstance(x, str) else "")
def test_contracts_that_make_no_sense_are_refused(changes: dict[str, object], expected: str) -> None:
    table = {**json.loads(contract_to_json(PASS)), **changes}
    with pytest.raises(ModelError, match=expected):
        contract_from_json(json.dumps(table), "here")
