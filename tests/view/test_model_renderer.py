"""The viewer draws what the renderer draws, with the models and bounces of the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.load import load_for_editing
from app.network.selection import UNSHADOWED
from app.paths import data_dir
from app.renderer import Renderer
from app.settings import Settings
from app.view.edited_scene import EditedScene
from app.view.encoder import encode_jpeg
from app.view.model_renderer import ModelRenderer
from app.view.scene_file import VIEW_NAME
from app.view.state import State

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

BOX = data_dir() / "cornell-box.obj"
SKY = '{"lightings": {"view": {"lights": [], "environment": {"type": "constant", "radiance": [1, 2, 3]}}}}'


def always() -> bool:
    return True


def test_a_second_model_shades_the_environment_beside_any_model(tmp_path: Path) -> None:
    (tmp_path / "sky.json").write_text(SKY)
    loaded = load_for_editing(BOX, scene_json=tmp_path / "sky.json", lighting=VIEW_NAME)
    scene = loaded.scene
    camera = scene.cameras[scene.default_camera].at(0.0)
    state = State((64, 48), camera, scene.lights[:loaded.own_lights], "none", environment=UNSHADOWED, aov="direct")
    model_renderer = ModelRenderer(EditedScene(BOX, loaded, tmp_path), "cpu")
    for model in ("none", "ssgi"):
        assert model_renderer.draw(state, model, always)
        models = [UNSHADOWED] if model == "none" else [model, UNSHADOWED]
        with Renderer(scene, Settings((64, 48), ("direct",)), models) as renderer:
            expected = renderer.render(camera)["direct"]
        assert np.array_equal(model_renderer._renderer.read("direct"), expected)
        assert expected.max() > 0.1
    model_renderer.close()


def test_the_number_of_bounces_applies_to_models_of_indirect_light(small_ember: Path, tmp_path: Path) -> None:
    loaded = load_for_editing(BOX)
    camera = loaded.scene.cameras[loaded.scene.default_camera].at(0.0)
    mean: dict[int | None, float] = {}
    for bounces in (1, None):
        state = State((64, 48), camera, loaded.scene.lights, str(small_ember), bounces=bounces)
        model_renderer = ModelRenderer(EditedScene(BOX, loaded, tmp_path), "cpu")
        assert model_renderer.draw(state, str(small_ember), always)
        mean[bounces] = float(model_renderer.read_radiance().mean())
        assert model_renderer.draw(state, "none", always)
        model_renderer.close()
    assert mean[1] < mean[None]


def test_the_encoder_ignores_a_fourth_component() -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 4), np.uint8)
    assert encode_jpeg(pixels[::-1]) == encode_jpeg(pixels[::-1, :, :3])


@pytest.mark.parametrize(("args", "expected"), [
    (["--model", "ember", "--model", "radiosity"], "two models"),
    (["--model", "ember", "--model", "ember"], "two models that compute indirect light"),
    (["--model", UNSHADOWED, "--model", UNSHADOWED], "two models that shade an environment"),
    (["--model", "none", "--bounces", "2"], "--bounces: needs a network"),
    (["--bounces", "0"], "bad number of bounces"),
])
def test_models_that_do_not_fit_together_are_rejected_at_once(args: list[str], expected: str) -> None:
    result = CliRunner().invoke(cli, ["view", *args])
    assert result.exit_code == 2
    line, = [x for x in result.stderr.splitlines() if x.startswith("error: ")]
    assert expected in line


def test_images_have_full_size_while_something_moves(tmp_path: Path) -> None:
    loaded = load_for_editing(BOX)
    camera = loaded.scene.cameras[loaded.scene.default_camera].at(0.0)
    model_renderer = ModelRenderer(EditedScene(BOX, loaded, tmp_path), "cpu")
    for aov, render_scale, upscaled in (("final", 0.5, True), ("final", 1.0, False), ("albedo", 0.5, False)):
        state = State((64, 48), camera, loaded.scene.lights, "none", aov=aov)
        assert model_renderer.draw(state, "none", always, render_scale)
        assert model_renderer.read_display(state).shape[:2] == (48, 64)
        assert ("upscale" in model_renderer.collect_stats()["passes"]) == upscaled
    model_renderer.close()
