"""The example programs and the notebook run, small, with the names of a checkout."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest

import app.api
from app.io.image import read_exr, read_png

pytestmark = pytest.mark.gl
EXAMPLES = Path(__file__).parents[2] / "examples"
SIZE = (48, 36)


@pytest.fixture(autouse=True)
def afterglow(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the wheel calls ``afterglow``."""
    monkeypatch.setitem(sys.modules, "afterglow", app.api)


def run(name: str, **options: object) -> None:
    runpy.run_path(str(EXAMPLES / name))["main"](size=SIZE, **options)


def test_hello(tmp_path: Path) -> None:
    run("hello.py", out=tmp_path)
    picture = read_png(tmp_path / "hello.png").astype(int)
    assert picture.shape == (*SIZE[::-1], 3) and (picture[..., 0] - picture[..., 2]).max() > 50


def test_own_network(tmp_path: Path) -> None:
    run("own_network.py", out=tmp_path)
    assert read_png(tmp_path / "own_network.png").mean() > 20


def test_dataset_with_masks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("dataset_with_masks.py", out=tmp_path, count=2)
    assert set(read_exr(tmp_path / "0001.exr")) == {"", "instance", "depth", "normal"}
    assert capsys.readouterr().out.count("covers") > 4


def test_light_animation(tmp_path: Path) -> None:
    pytest.importorskip("av")
    run("light_animation.py", out=tmp_path, frames=3)
    assert (tmp_path / "light_animation.mp4").stat().st_size > 500


def test_compare_with_path_tracer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                  capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mitsuba")
    pytest.importorskip("flip_evaluator")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    run("compare_with_path_tracer.py", out=tmp_path, spp=8)
    psnr = [float(line.split("psnr ")[1].split(",")[0]) for line in capsys.readouterr().out.splitlines()]
    assert psnr[1] > psnr[0] + 3


def test_notebook() -> None:
    notebook = json.loads((EXAMPLES / "first_picture.ipynb").read_text())
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]).replace("(320, 240)", str(SIZE)), names)
    assert names["frame"].display.shape == (*SIZE[::-1], 3)
