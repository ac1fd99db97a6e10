"""What the viewer draws is what the renderer draws, with the models and bounces that the command line was given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.load import load_parts
from app.paths import data_dir
from app.renderer import Renderer
from app.settings import Settings
from app.view.edited_scene import EditedScene
from app.view.encoder import jpeg
from app.view.model_renderer import ModelRenderer
from app.view.scene_file import NAME
from app.view.state import State

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

BOX = data_dir() / "cornell-box.obj"
SKY = '{"lightings": {"view": {"lights": [], "environment": {"type": "constant", "radiance": [1, 2, 3]}}}}'


def always() -> bool:
    return True


def test_a_second_model_shades_the_environment_whichever_is_chosen(tmp_path: Path) -> None:
    (tmp_path / "sky.json").write_text(SKY)
    parts = load_parts(BOX, scene_json=tmp_path / "sky.json", lighting=NAME)
    scene = parts.scene
    camera = scene.cameras[scene.default_camera].at(0.0)
    state = State((64, 48), camera, scene.lights[:parts.own_lights], "none", environment="unshadowed_environment", aov="direct")
    drawing = ModelRenderer(EditedScene(BOX, parts, tmp_path), "cpu", tmp_path)
    for model in ("none", "ssgi"):
        assert drawing.draw(state, model, always)
        with Renderer(scene, Settings((64, 48), ("direct",)), [model, "unshadowed_environment"][model == "none":]) as renderer:
            wanted = renderer.render(camera)["direct"]
        assert np.array_equal(drawing._renderer.read("direct"), wanted)
        assert wanted.max() > 0.1
    drawing.close()


def test_bounces_hold_where_a_model_makes_light(small_ember: Path, tmp_path: Path) -> None:
    parts = load_parts(BOX)
    camera = parts.scene.cameras[parts.scene.default_camera].at(0.0)
    mean: dict[int | None, float] = {}
    for bounces in (1, None):
        state = State((64, 48), camera, parts.scene.lights, str(small_ember), bounces=bounces)
        drawing = ModelRenderer(EditedScene(BOX, parts, tmp_path), "cpu", tmp_path)
        assert drawing.draw(state, str(small_ember), always)
        mean[bounces] = float(drawing.radiance().mean())
        assert drawing.draw(state, "none", always)
        drawing.close()
    assert mean[1] < mean[None]


def test_a_picture_of_four_components_is_encoded_as_of_three() -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 4), np.uint8)
    assert jpeg(pixels[::-1]) == jpeg(pixels[::-1, :, :3])


@pytest.mark.parametrize(("args", "expected"), [
    (["--model", "ember", "--model", "radiosity"], "two models"),
    (["--model", "ember", "--model", "ember"], "two models that make indirect light"),
    (["--model", "unshadowed_environment", "--model", "unshadowed_environment"], "two models that shade an environment"),
    (["--model", "none", "--bounces", "2"], "no model to follow them"),
    (["--bounces", "0"], "bad number of bounces"),
])
def test_models_that_don_t_fit_together_are_said_at_once(args: list[str], expected: str) -> None:
    result = CliRunner().invoke(cli, ["view", *args])
    assert result.exit_code == 2
    line, = [x for x in result.stderr.splitlines() if x.startswith("error: ")]
    assert expected in line
