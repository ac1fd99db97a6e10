"""The benchmark from end to end, on a generated scene with a reference that the renderer itself has drawn."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from app.bench.cold_start import _draw_first_frame
from app.cli import cli
from app.errors import SceneError
from app.io.image import write_exr
from app.load import load_scene
from app.network.selection import find_model
from app.renderer import Renderer
from app.settings import Settings

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE, LARGER = (32, 24), (64, 48)
OBJ = """mtllib room.mtl
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v -1 2 -1
v 1 2 -1
usemtl grey
f 1 4 3 2
usemtl red
f 1 2 6 5
"""
MTL = "newmtl grey\nKd 0.6 0.6 0.6\nnewmtl red\nKd 0.7 0.2 0.2\n"
SIDECAR = {
    "cameras": {"main": {"eye": [0, 1.2, 3], "target": [0, 0.6, 0], "fov_y_deg": 50}},
    "lightings": {"lamp": {"lights": [{"type": "point", "position": [0.3, 1.6, 0.5], "intensity": [2, 2, 2]}]}},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene ``room.obj``, and its reference in ``reference/room``."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "room.obj").write_text(OBJ)
    (folder / "room.mtl").write_text(MTL)
    (folder / "room.json").write_text(json.dumps(SIDECAR))
    write_reference(folder / "room.obj", folder / "reference" / "room")
    return folder


def write_reference(scene_file: Path, folder: Path) -> None:
    """What ``--model gather`` draws, settled for 16 frames, as if a path tracer had; and two noisier pictures of it."""
    scene = load_scene(scene_file)
    camera = scene.cameras["main"].at(0.0)
    outputs = ("direct", "indirect", "albedo", "depth", "normal")
    with Renderer(scene, Settings(SIZE, outputs, taa=False, provider="cpu"), find_model("gather")) as renderer:
        layers = renderer.render(camera)
    with Renderer(scene, Settings(SIZE, ("final",), provider="cpu"), find_model("gather")) as renderer:
        layers["final"] = [renderer.render(camera)["final"] for _ in range(16)][-1]
    folder.mkdir(parents=True)
    write_exr(folder / "reference.exr", {"" if name == "final" else name: image for name, image in layers.items()})
    about = {"spp": 64, "noise": {"final": 0.01}, "seconds": 1.0, "notices": ["no fog"]}
    (folder / "reference.json").write_text(json.dumps(about))
    random = np.random.default_rng(3)
    for spp in (1, 16):
        noisy = layers["final"] * random.gamma(4 * spp, 1 / (4 * spp), layers["final"].shape).astype(np.float32)
        guides = {name: layers[name] for name in ("albedo", "normal")}
        write_exr(folder / f"baseline_{spp:04d}.exr", {"": noisy, **guides})
    (folder / "baselines.json").write_text(json.dumps({"1": 0.001, "16": 30.0}))


def bench(folder: Path, out: str, *more: str) -> Any:
    return CliRunner().invoke(cli, [
        "bench", str(folder / "room.obj"), "--reference", str(folder / "reference"), "--sizes", "32x24,64x48",
        "--repeats", "2", "--provider", "cpu", "--out", str(folder / out), *more])


@pytest.fixture(scope="module")
def whole(folder: Path) -> tuple[Path, str]:
    """The files and the text of a whole run."""
    run = bench(folder, "out", "--models", "none,gather", "--precision", "float32,float16")
    assert run.exit_code == 0, run.output
    return folder / "out", run.output


def test_a_whole_benchmark(whole: tuple[Path, str]) -> None:
    out, text = whole
    results = json.loads((out / "bench.json").read_text())
    (scene,) = results["scenes"]
    assert scene["name"] == "room" and scene["lighting"] == "lamp" and scene["triangles"] == 4
    configurations = {(c["label"], tuple(c["size"])): c for c in scene["configurations"]}
    assert set(configurations) == {(n, s) for n in ("none", "gather float32") for s in (SIZE, LARGER)}
    assert "gather in float16 is not available" in results["absent"][0] and "float16" in text

    # The reference is gather's own picture, so gather is exactly right, and no indirect light is not.
    gather, none = configurations["gather float32", SIZE], configurations["none", SIZE]
    assert gather["errors"]["final"] == {"flip": 0, "psnr": None, "ssim": pytest.approx(1), "rel_mse": 0}
    assert gather["errors"]["indirect"]["rel_mse"] == pytest.approx(0, abs=1e-9)
    assert none["errors"]["direct"]["flip"] == 0
    assert none["errors"]["indirect"]["flip"] > scene["ambient"]["errors"]["indirect"]["flip"] > 0
    assert configurations["gather float32", LARGER]["errors"] is None

    assert {"gbuffer", "direct", "network", "taa", "copy", "frame"} <= set(gather["stages"])
    assert "network" not in none["stages"]
    for c in configurations.values():
        parts = [s["median"] for name, s in c["stages"].items() if name not in ("frame", "copy")]
        assert c["stages"]["frame"]["median"] >= max(parts)
        assert all(len(s["rounds"]) == 2 and s["p95"] >= s["median"] >= 0 for s in c["stages"].values())
    cold_start = configurations["none", LARGER]["cold_start"]
    assert cold_start["startup_s"] > 0 and cold_start["peak_mb"] > 50

    baselines = {(r["name"], r["spp"]): r for r in scene["baselines"]}
    assert len(baselines) == 6
    assert baselines["path tracer", 16]["ms"] == 30_000
    assert baselines["denoised (high)", 1]["ms"] > baselines["path tracer", 1]["ms"]
    noisy, clean = (baselines["path tracer", spp]["errors"]["final"]["flip"] for spp in (1, 16))
    assert noisy > clean > 0
    assert {h["against"] for h in results["headlines"]} == {"path tracer", "path tracer, denoised"}

    table = list(csv.DictReader((out / "bench.csv").open()))
    assert len(table) == 4 + 1 + 6
    assert {row["frame.p95_ms"] for row in table if row["kind"] == "baseline"} == {""}  # one measurement has none
    assert "note: room: no fog" in text
    page = (out / "report.html").read_text()
    assert "llvmpipe" in page or results["scenes"][0]["configurations"][0]["device"]["gl_renderer"] in page
    assert (out / "pareto.svg").read_text().startswith("<svg xmlns")


def test_a_run_can_be_compared_with_an_earlier_one(folder: Path, whole: tuple[Path, str]) -> None:
    old = json.loads((whole[0] / "bench.json").read_text())
    stages = old["scenes"][0]["configurations"][0]["stages"]
    for stage in (stages[name] for name in stages if name != "copy"):
        stage |= {"median": 1e-3 * stage["median"], "rounds": [1e-3 * (1 + n / 100) for n in range(5)]}
    (folder / "old.json").write_text(json.dumps(old))
    run = bench(folder, "again", "--models", "none", "--sizes", "32x24", "--repeats", "5", "--compare",
                str(folder / "old.json"))
    assert run.exit_code == 1
    assert "worse: room, none at 32x24, frame ms" in run.output
    assert "flip" not in run.output.partition("wrote")[2]  # the same frame has the same error
    assert "room, gather float32 at 32x24 is gone" in run.output


def test_a_reference_of_another_size_is_refused(folder: Path) -> None:
    run = bench(folder, "refused", "--sizes", "40x30")
    assert run.exit_code == 2
    assert "the reference is 32x24" in run.output


def test_a_cold_start_draws_the_variant(folder: Path) -> None:
    task = {"scene": str(folder / "room.obj"), "lighting": None, "camera": None, "variant": "red"}
    with pytest.raises(SceneError, match="no material variant 'red'"):
        _draw_first_frame(task)
