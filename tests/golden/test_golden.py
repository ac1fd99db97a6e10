"""The golden images hold, and a check notices what it is there to notice."""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.golden import Case, catalogue, check, orphan_cases, update
from app.golden.compare import ORIGIN, Report
from app.golden.scenes import outdoor, room
from app.image import read_exr, write_exr
from app.renderer import Renderer

pytestmark = pytest.mark.gl
IMAGES = Path(__file__).parent / "images"
MOST_BYTES = 4_000_000
SMALL = Case(room(), "gather", frames=2, kept=(1, 2), size=(48, 32))


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("goldens") / "images"
    update([SMALL], folder, ["room"])
    return folder


@pytest.fixture
def folder(fresh: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(fresh, tmp_path / "images"))


def broken(report: Report) -> list[tuple[str, str, str]]:
    return [(f.stage, f.resource, f.verdict) for f in report.broken]


def test_the_repository_holds_its_goldens() -> None:
    result = CliRunner().invoke(cli, ["golden", "check", "--golden", str(IMAGES)], env={"COLUMNS": "120"})
    assert result.exit_code == 0, result.output
    assert sum(file.stat().st_size for file in IMAGES.rglob("*")) <= MOST_BYTES


def test_every_kind_of_pass_is_in_the_catalogue() -> None:
    stages = {path.stem for case in catalogue() for path in (IMAGES / case).glob("*.exr")}
    assert stages >= {"shadow", "albedo", "emission", "gloss", "motion", "position", "direct", "specular", "indirect",
                      "surround_direct", "tensor_cube", "tensor_screen", "indirect_low", "lit", "taa", "display"}


def test_a_second_run_gives_the_same_bits(folder: Path) -> None:
    report = check([SMALL], folder)
    assert {f.verdict for f in report.findings} == {"same"}
    assert not report.foreign


@pytest.mark.parametrize("resource", [
    "shadow", "albedo", "depth", "direct", "tensor_cube", "tensor_screen", "indirect_low", "indirect", "lit", "taa",
    "display"])
def test_the_first_broken_stage_is_the_one_that_changed(folder: Path, resource: str) -> None:
    def change(renderer: Renderer) -> None:
        renderer.override(resource, lambda image: np.clip(image.astype(np.float32) * 0.9, -1e4, 1e4))

    report = check([SMALL], folder, change)
    first = report.broken[0]
    assert (first.resource, first.verdict) == (resource, "differs")
    assert first.difference > 0.01
    changed = [f.stage for f in report.findings].index(first.stage)
    assert all(f.ok for f in report.findings[:changed])


def test_a_few_texels_are_enough(folder: Path) -> None:
    def change(renderer: Renderer) -> None:
        renderer.override("normal", lambda image: np.where(np.arange(48)[:, None] == 7, image * 0.9, image))

    assert check([SMALL], folder, change).broken[0].stage == "gbuffer"


def test_missing_goldens_fail(folder: Path, tmp_path: Path) -> None:
    (folder / "room" / "lit.exr").unlink()
    layers = read_exr(folder / "room" / "taa.exr")
    write_exr(folder / "room" / "taa.exr", {"frame1": layers["frame1"]})
    assert broken(check([SMALL], folder)) == [("composite", "lit", "missing"), ("taa", "taa", "missing")]
    nothing = check([SMALL], tmp_path / "nowhere")
    assert {f.verdict for f in nothing.findings} == {"missing"}


def test_orphans_fail(folder: Path) -> None:
    layers = read_exr(folder / "room" / "taa.exr")
    write_exr(folder / "room" / "taa.exr", layers | {"frame9": layers["frame1"]})
    shutil.copy(folder / "room" / "lit.exr", folder / "room" / "left.exr")
    assert broken(check([SMALL], folder)) == [("taa", "taa", "orphan"), ("", "left.exr", "orphan")]
    assert [f.resource for f in orphan_cases(folder, ["other"])] == ["room"]


def test_unsteady_passes_fail(folder: Path) -> None:
    factors = itertools.count(1)

    def change(renderer: Renderer) -> None:
        factor = 1 + 1e-3 * next(factors)
        renderer.override("direct", lambda image: image * factor)

    first = check([SMALL], folder, change).broken[0]
    assert (first.stage, first.verdict) == ("direct", "unsteady")


def test_another_renderer_gets_the_wider_tolerance(folder: Path) -> None:
    def change(renderer: Renderer) -> None:
        renderer.override("display", lambda image: np.minimum(image * 1.01, 254))

    assert broken(check([SMALL], folder, change)) == [("output", "display", "differs")]
    (folder / "room" / ORIGIN).write_text(json.dumps({"renderer": "Voodoo 2"}))
    report = check([SMALL], folder, change)
    assert not report.broken
    assert report.foreign == {"room": "Voodoo 2"}


def test_update_is_all_or_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def files() -> dict[str, bytes]:
        return {str(f.relative_to(folder.parent)): f.read_bytes() for f in folder.parent.rglob("*") if f.is_file()}

    before = files()
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("app.golden.compare.write_text", interrupted)
    with pytest.raises(KeyboardInterrupt):
        update([SMALL], folder, ["room"])
    assert files() == before


def test_update_keeps_other_cases_and_drops_orphans(folder: Path) -> None:
    shutil.copytree(folder / "room", folder / "gone")
    kept = (folder / "room" / "lit.exr").read_bytes()
    update([Case(outdoor(), None, frames=1, kept=(1,), size=(16, 12))], folder, ["room", "outdoor"])
    assert sorted(f.name for f in folder.iterdir()) == ["outdoor", "room"]
    assert (folder / "room" / "lit.exr").read_bytes() == kept
    assert "network" not in {f.stage for f in check([SMALL], folder).broken}


@pytest.mark.parametrize(("args", "said"), [
    (["check", "rooom"], "did you mean 'room'"),
    (["update", "--golden", "."], "no golden image"),
    (["update", "--golden", "notes.txt"], "no folder"),
    (["check", "--golden", "broken"], "origin"),
    (["chek"], "chek"),
])
def test_user_errors_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, args: list[str], said: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "broken" / "room").mkdir(parents=True)
    (tmp_path / "broken" / "room" / ORIGIN).write_text("{")
    result = CliRunner().invoke(cli, ["golden", *args])
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_difference_is_exit_code_1(folder: Path) -> None:
    result = CliRunner().invoke(cli, ["golden", "check", "room", "--golden", str(folder)], env={"COLUMNS": "120"})
    assert result.exit_code == 1
    assert "first broken stage of room: shadow" in result.stdout
