"""Same input, same output; what the timing file and the count of non-finite texels say."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.load import embedded_scene
from app.network.selection import find_model
from app.renderer import Renderer
from app.settings import Settings
from tests.gl.scenes import Images
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

ROOT = Path(__file__).parents[2]
OUTPUTS = ("final", "albedo", "normal", "depth", "position", "motion", "direct", "indirect")
CLOCK = {"median", "p95"}


def film(seed: int, frames: int = 3) -> list[Images]:
    scene = embedded_scene()
    with Renderer(scene, Settings(size=(97, 73), outputs=OUTPUTS, seed=seed, provider="cpu"),
                  find_model("radiosity")) as renderer:
        return [renderer.render(scene.cameras[scene.default_camera].at(0.0), i / 30) for i in range(frames)]


def test_two_renderers_agree_bit_for_bit() -> None:
    for first, second in zip(film(3), film(3), strict=True):
        for name in first:
            assert first[name].tobytes() == second[name].tobytes(), name


def test_two_renderers_live_side_by_side() -> None:
    """Each has a context of its own, and its own must be current when it draws, reads and closes."""
    scene = embedded_scene()
    camera = scene.cameras[scene.default_camera].at(0.0)
    settings = Settings(size=(97, 73), outputs=OUTPUTS, seed=3, provider="cpu")
    alone = film(3)
    with Renderer(scene, settings, find_model("radiosity")) as one:
        with Renderer(scene, Settings(size=(64, 48), taa=False)) as other:
            found = []
            for frame in range(2):
                found.append(one.render(camera, frame / 30))
                other.render(camera)
        found.append(one.render(camera, 2 / 30))
    for image, reference in zip(found, alone, strict=True):
        assert all(np.array_equal(image[name], reference[name]) for name in reference)


def test_another_seed_is_another_pattern_of_the_same_picture() -> None:
    first, second = film(0)[-1]["final"], film(1)[-1]["final"]
    assert not np.array_equal(first, second)
    assert second.mean() == pytest.approx(first.mean(), rel=0.05)  # three frames of jitter on a small bright lamp


def cli(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "app", "--out", str(folder), "--size", "96x72", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


def test_the_same_command_writes_the_same_bytes(tmp_path: Path) -> None:
    for run in ("a", "b"):
        cli(tmp_path / run, "--frames", "3", "--camera", "orbit", "--seed", "7",
            "--aov", "final,normal,motion,indirect")
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert files == [f"{i:04d}.{kind}" for i in range(3) for kind in ("exr", "png")]
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def check_timing(report: dict[str, Any]) -> None:
    assert set(report) == {"frame", "passes", "culled", "device", "model", "size", "scene", "triangles", "frames"}
    assert set(report["frame"]) == {"cpu_ms", "gpu_ms"}
    for name, entry in report["passes"].items():
        assert set(entry) == {"cpu_ms", "gpu_ms"} | ({"non_finite"} if name != "copy" else set()), name
        for clock in ("cpu_ms", "gpu_ms"):
            assert set(entry[clock]) == CLOCK
            assert 0 <= entry[clock]["median"] <= entry[clock]["p95"] < 60e3
    assert all(set(report["frame"][clock]) == CLOCK for clock in ("cpu_ms", "gpu_ms"))
    assert set(report["device"]) == {"gl_renderer", "gl_version", "provider", "exchange", "rays"}


def test_timing_file(tmp_path: Path) -> None:
    cli(tmp_path, "--timing", str(tmp_path / "t.json"), "--check", "--settle", "2")
    report = json.loads((tmp_path / "t.json").read_text())
    check_timing(report)
    assert {"shadow_rays", "gbuffer", "direct", "network", "upsample", "composite", "taa", "tonemap", "copy"} \
        <= set(report["passes"])
    assert report["model"] == "final-gather" and report["size"] == [96, 72] and report["frames"] == 1
    assert report["triangles"] == embedded_scene().triangles
    assert all(entry["non_finite"] == 0 for name, entry in report["passes"].items() if name != "copy")
    spent = sum(e["cpu_ms"]["median"] for name, e in report["passes"].items() if name not in ("copy", "shadow_rays"))
    assert spent <= 1.5 * report["frame"]["cpu_ms"]["median"]
    assert report["passes"]["network"]["cpu_ms"]["median"] > 0.1


def test_timing_file_without_network(tmp_path: Path) -> None:
    cli(tmp_path, "--timing", str(tmp_path / "t.json"), "--model", "none", "--no-taa", "--format", "png")
    report = json.loads((tmp_path / "t.json").read_text())
    check_timing(report)
    assert report["model"] is None and report["device"]["provider"] == "none"
    assert {"taa", "network", "cube_gbuffer"} <= set(report["culled"])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_non_finite_texels_are_counted_where_they_arise(value: float) -> None:
    scene = embedded_scene()
    with Renderer(scene, Settings(size=(40, 30), check=True, timing=True), find_model("radiosity")) as renderer:
        camera = scene.cameras[scene.default_camera].at(0.0)
        renderer.render(camera)
        assert all(p.get("non_finite", 0) == 0 for p in renderer.timing()["passes"].values())
        override(renderer, "direct", value)
        renderer.render(camera)
        counts = {name: p.get("non_finite", 0) for name, p in renderer.timing()["passes"].items()}
        assert counts.pop("direct") == 40 * 30
        assert not any(counts.values())
        renderer.reset_timing()
        override(renderer, "direct", None)
        renderer.render(camera)
        assert all(p.get("non_finite", 0) == 0 for p in renderer.timing()["passes"].values())
