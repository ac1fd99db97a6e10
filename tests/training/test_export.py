from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")
pytest.importorskip("lightning_fabric")


from app.errors import ModelError  # noqa: E402
from app.load import embedded_scene  # noqa: E402
from app.network.contract_json import read_contract  # noqa: E402
from app.network.session import Network  # noqa: E402
from app.renderer import Renderer  # noqa: E402
from app.settings import Settings  # noqa: E402
from export.models import make_network  # noqa: E402
from export.onnx.cli import linearity  # noqa: E402
from export.onnx.export import TRAINED_TOLERANCE, export_checkpoint, to_half, write_network  # noqa: E402
from export.onnx.linearity import additivity, exposure_error  # noqa: E402
from export.onnx.sample_inputs import sample_inputs  # noqa: E402
from export.training.checkpoint import load_checkpoint  # noqa: E402
from export.training.loop import CHECKPOINT, Run  # noqa: E402
from tests.training.test_training import config, examples  # noqa: E402

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a network after one epoch, its half variant and its card."""
    folder = tmp_path_factory.mktemp("exported")
    Run(config(folder, epochs=1), examples(folder), folder / "run").train()
    export_checkpoint(load_checkpoint(folder / "run" / CHECKPOINT), folder)
    return folder


@pytest.mark.parametrize(("name", "dtype"), [("bcnn-8", "float32"), ("bcnn-8-half", "float16")])
def test_the_renderer_runs_what_was_exported(exported: Path, name: str, dtype: str) -> None:
    path = exported / f"{name}.onnx"
    contract = read_contract(path)
    assert (contract.name, contract.dtype) == (name, dtype)
    assert "8 pairs" in contract.trained_on
    scene = embedded_scene()
    with Renderer(scene, Settings((128, 96), ("indirect",), taa=False, provider="cpu", check=True), path) as renderer:
        image = renderer.render(scene.cameras[scene.default_camera].at(0.0))["indirect"]
    assert np.isfinite(image).all() and image.min() >= 0 and image.max() > 0


def test_half_is_close_to_single_in_the_renderer(exported: Path) -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.random((3, 48, 64)), np.zeros((2, 48, 64)), np.ones((1, 48, 64)),
                        rng.uniform(-1, 1, (2, 48, 64)), np.full((1, 48, 64), -20.0)]).astype(np.float32)
    single, half = (Network(exported / f"bcnn-8{kind}.onnx", (64, 48), "cpu").run({"x": x})["indirect.rgb"]
                    for kind in ("", "-half"))
    assert np.abs(single - half).max() < 1e-2 * single.max()


def test_the_card_has_the_facts_of_the_checkpoint(exported: Path) -> None:
    card = (exported / "bcnn-8.md").read_text()
    for fact in ("62,691", "8 of 10 pairs", "2, 4, 0", "bcnn-8-half.onnx", "`direct.rgb`"):
        assert fact in card


def test_a_network_that_differs_from_torch_is_not_written(tmp_path: Path) -> None:
    network, other = make_network("bcnn-8").eval(), make_network("bcnn-8").eval()
    inputs = list(sample_inputs(network.contract))
    with pytest.raises(ModelError, match="differs from torch"):
        write_network(network, tmp_path, inputs, {label: TRAINED_TOLERANCE["float32"] for label, _ in inputs}, other)
    assert not list(tmp_path.iterdir())


def test_half_precision_stays_within_its_tolerance_at_other_widths(tmp_path: Path) -> None:
    network = make_network("bcnn-16").eval()
    inputs = list(sample_inputs(network.contract))
    tolerance = {label: TRAINED_TOLERANCE["float16"] for label, _ in inputs}
    assert 0 < write_network(to_half(network), tmp_path, inputs, tolerance, network)[1] < TRAINED_TOLERANCE["float16"]


def test_linearity_is_measured(exported: Path) -> None:
    """For a network that is linear by construction, and for one that is not."""
    bcnn, gather = exported / "bcnn-8.onnx", ROOT / "nets" / "gather.onnx"
    rooms = {path: [x for label, x in sample_inputs(read_contract(path)) if label == "room"][-1]
             for path in (bcnn, gather)}
    assert additivity(bcnn.read_bytes(), rooms[bcnn]) > 1e-3
    assert exposure_error(bcnn.read_bytes(), 1.0, rooms[bcnn]) == 0.0
    assert exposure_error(gather.read_bytes(), 10.0, rooms[gather]) < 1e-4


def test_linearity_is_printed(capsys: pytest.CaptureFixture[str], exported: Path) -> None:
    linearity(["gather", str(exported / "bcnn-8.onnx")])
    rows = {line.split()[0]: [float(x) for x in line.split()[1:]]
            for line in capsys.readouterr().out.splitlines() if "e-" in line}
    assert list(rows) == ["gather", "bcnn-8"] and all(len(row) == 3 for row in rows.values())
    assert max(rows["gather"]) < 1e-5
    assert rows["bcnn-8"][0] > 1e-3 and max(rows["bcnn-8"][1:]) < 1e-5, "not additive, but invariant to exposure"
    with pytest.raises(ModelError, match="'ssgi' is not a network"):
        linearity(["ssgi"])


def test_list_prints_all_presets() -> None:
    command = [sys.executable, "-m", "export", "onnx", "list", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    rows = {row["preset"]: row["weights"] for row in json.loads(done.stdout)}
    assert rows["bcnn-paper"] == pytest.approx(3.95e6, rel=0.02)
    assert rows["gather"] == 0 and rows["bcnn-8"] < rows["bcnn-16"] < rows["bcnn-paper"]


@pytest.mark.parametrize(("arguments", "problem"), [
    (["nonsense"], "no such command 'nonsense'"), (["reference", "--spp", "x"], "invalid value for '--spp'")])
def test_a_bad_command_line_is_one_line(arguments: list[str], problem: str) -> None:
    done = subprocess.run([sys.executable, "-m", "export", *arguments], cwd=ROOT, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"error: command line: {problem}")
