"""The benchmark under an environment: its reference has all the light that models give, and its rows all the passes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.evaluation.configurations import Configuration
from app.evaluation.picture_errors import Layers, draw_layers, errors_of
from app.evaluation.reference import Reference
from app.io.image import write_exr
from app.load import load_scene
from app.network.contract import TensorSpec
from app.network.selection import UNSHADOWED, Model
from app.paths import data_dir
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from tests.gl.scenes import floor
from tests.gl.test_environment import under
from tests.gl.test_environment_shading import PASS, WHITE, glossy, write_pass

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (32, 24)
SPP = 2048  # leaves 3 % of noise
PATIO = data_dir() / "patio.obj"


def layers_of(scene: Scene, *models: Model) -> Layers:
    return draw_layers(scene, scene.cameras["main"].at(0.0), Configuration("it", models, SIZE), "cpu")


@pytest.mark.usefixtures("path_tracer")
@pytest.mark.parametrize("polished", [False, True], ids=["matte", "polished"])
def test_the_reference_has_the_light_that_shading_gives(polished: bool) -> None:
    """On an unshadowed floor all light comes straight from the sky, which ``unshadowed_environment`` reproduces."""
    from export.reference.still import Still
    from export.reference.trace import trace_reference

    material = glossy(0.6, 0.3, 0.4) if polished else glossy(1.0, 0.0, 0.8)
    camera = Camera((0.0, 1.0, 3.0), (0.0, 0.4, 0.0), fov_y_deg=50.0)  # sees sky, too
    scene = under(WHITE, floor(2.0, material=material), camera=camera)
    reference = Reference(trace_reference(Still(scene, camera, SIZE), SPP).layers, {}, "")
    layers = layers_of(scene, UNSHADOWED)
    errors = errors_of(layers, reference)
    assert errors["final"]["psnr"] > (32 if polished else 38)
    assert errors["direct"]["psnr"] > 38
    assert layers["final"].mean() == pytest.approx(reference.layers["final"].mean(), rel=0.02)


def bench(folder: Path, models: str) -> Any:
    return CliRunner().invoke(cli, [
        "bench", str(PATIO), "--reference", str(folder / "reference"), "--sizes", "32x24", "--repeats", "1",
        "--provider", "cpu", "--models", models, "--out", str(folder / "out")])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With ``reference``: the embedded patio as ``unshadowed_environment`` draws it."""
    scene = load_scene(PATIO)
    camera = scene.cameras["main"].at(0.0)
    outputs = ("final", "direct", "indirect", "albedo", "depth")
    with Renderer(scene, Settings(SIZE, outputs, taa=False, provider="cpu"), UNSHADOWED) as renderer:
        layers = renderer.render(camera)
    (tmp_path / "reference").mkdir()
    write_exr(tmp_path / "reference" / "reference.exr", {"" if n == "final" else n: layers[n] for n in outputs})
    (tmp_path / "reference" / "reference.json").write_text("{}")
    return tmp_path


def test_rows_of_two_models_have_the_times_of_their_passes(folder: Path) -> None:
    """A network that does not read unshadowed shading is measured without that pass."""
    own = replace(PASS, inputs={"x": TensorSpec(("albedo.rgb", "normal.view.xyz")), "sky": PASS.inputs["sky"]})
    (folder / "own").mkdir()
    corrects, alone = write_pass(folder), write_pass(folder / "own", own).rename(folder / "own.onnx")
    run = bench(folder, f"none,unshadowed_environment,gather+{corrects},gather + {alone}")
    assert run.exit_code == 0, run.output
    (scene,) = json.loads((folder / "out" / "bench.json").read_text())["scenes"]
    rows = {c["label"]: c for c in scene["configurations"]}
    assert list(rows) == ["none", "unshadowed_environment", "gather+pass", "gather+own"]
    shading = {"environment_pack_screen", "environment_network", "upsample_diffuse", "upsample_specular"}
    unshadowed = {"unshadowed_environment"}
    upsample = {"upsample_diffuse", "upsample_specular"}
    for label, expected in (("none", set()), ("unshadowed_environment", unshadowed | upsample),
                            ("gather+pass", unshadowed | shading), ("gather+own", shading)):
        assert set(rows[label]["stages"]) & (unshadowed | shading) == expected, label
        assert set(rows[label]["errors"]) == {"final", "direct", "indirect"}
        assert rows[label]["cold_start"]["startup_s"] > 0
    flips = {label: row["errors"]["final"]["flip"] for label, row in rows.items()}
    assert flips["unshadowed_environment"] < 0.5 * flips["none"]  # the reference has no shadows either
    assert set(scene["ambient"]["errors"]) == {"final", "indirect"}
    assert "gather+pass" in (folder / "out" / "report.html").read_text()


def test_embedded_scenes_without_work_for_any_model_are_skipped(folder: Path) -> None:
    (folder / "references").mkdir()
    (folder / "reference").rename(folder / "references" / "patio")
    done = CliRunner().invoke(cli, ["bench", "--reference", str(folder / "references"), "--sizes", "32x24",
                                    "--repeats", "1", "--provider", "cpu", "--models", "unshadowed_environment",
                                    "--out", str(folder / "out")])
    assert done.exit_code == 0, done.output
    assert "note: cornell-box has no environment for unshadowed_environment" in done.output
    results = json.loads((folder / "out" / "bench.json").read_text())
    assert [scene["name"] for scene in results["scenes"]] == ["patio"]


def test_the_ambient_oracle_has_the_sky_behind_it(folder: Path) -> None:
    assert bench(folder, "none").exit_code == 0
    (scene,) = json.loads((folder / "out" / "bench.json").read_text())["scenes"]
    assert scene["ambient"]["errors"]["final"]["flip"] < 0.5 * scene["configurations"][0]["errors"]["final"]["flip"]


@pytest.mark.parametrize(("scene", "models", "said"), [
    ("patio.obj", "ember+gather", "two models that compute indirect light"),
    ("patio.obj", "unshadowed_environment+unshadowed_environment", "two models that shade an environment"),
    ("patio.obj", "ember+unshadowed_environment+ssgi", "two models that compute indirect light"),
    ("patio.obj", "ember+", "no model ''"),
    ("cornell-box.obj", "unshadowed_environment,ember+unshadowed_environment",
     "cornell-box has no environment for unshadowed_environment, ember+unshadowed_environment"),
])
@pytest.mark.parametrize("command", ["bench", "compare"])
def test_pairs_that_make_no_sense_are_refused(command: str, scene: str, models: str, said: str, tmp_path: Path) -> None:
    listed = f"{models},none" if command == "compare" else models  # which needs at least two
    done = CliRunner().invoke(cli, [command, str(data_dir() / scene), "--models", listed, "--out",
                                    str(tmp_path / "out.html")])
    assert done.exit_code == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert said in line and "expected" in line
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
