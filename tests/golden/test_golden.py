"""The golden images match, and a check notices what it should."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.errors import OutputError, SceneError
from app.golden import Report, SceneCase, Shot, catalogue, check, orphan_cases, update
from app.golden.scenes import outdoor, room
from app.golden.store import ORIGIN, read_origin
from app.io.image import read_exr, write_exr
from app.network.selection import find_model
from app.renderer import Renderer
from tests.coarse_shadows import coarse_shadow_maps
from tests.override import override

pytestmark = pytest.mark.gl
IMAGES = Path(__file__).parent / "images"
MAX_BYTES = 24_800_000
SMALL = SceneCase("room", room(), find_model("gather"), (Shot("path", 2),), golden_frames=(1, 2), size=(48, 32))
ELSEWHERE = json.dumps({"renderer": "Voodoo 2"})


@dataclass(frozen=True, eq=False)
class Changed(SceneCase):
    """A case whose renderer is changed before its first frame."""

    change: Callable[[Renderer], None] = lambda renderer: None

    def renderer(self) -> Renderer:
        renderer = super().renderer()
        self.change(renderer)
        return renderer


def changed(change: Callable[[Renderer], None]) -> Changed:
    return Changed(SMALL.name, SMALL.scene, SMALL.model, SMALL.shots, SMALL.golden_frames, SMALL.size, change=change)


@pytest.fixture(scope="module")
def goldens(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("goldens") / "images"
    with coarse_shadow_maps():
        update([SMALL], folder, ["room"])
    return folder


@pytest.fixture
def folder(goldens: Path, tmp_path: Path, coarse_shadows: None) -> Path:
    return Path(shutil.copytree(goldens, tmp_path / "images"))


def broken(report: Report) -> list[tuple[str, str, str]]:
    return [(f.stage, f.resource, f.verdict) for f in report.broken]


def test_the_renderer_matches_the_goldens_of_the_repository(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["golden", "check", "--golden", str(IMAGES), "--report", str(tmp_path / "r.html")],
                                env={"COLUMNS": "160"})
    assert result.exit_code == 0, result.output
    assert "all is well" in (tmp_path / "r.html").read_text("utf-8")
    assert sum(file.stat().st_size for file in IMAGES.rglob("*")) <= MAX_BYTES


def test_the_sequence_has_a_cut_between_golden_frames() -> None:
    case = catalogue()["room"]
    assert isinstance(case, SceneCase)
    assert case.golden_frames == (1, 16, 64)
    assert case.golden_frames[1] < case.shots[0].frames < case.golden_frames[2]
    accumulated = {n: layer[..., 3].max() for n, layer in read_exr(IMAGES / "room" / "taa.exr").items()}
    assert accumulated["frame1"] == 1
    assert accumulated["frame16"] >= 8
    assert accumulated["frame64"] == case.golden_frames[2] - case.shots[0].frames  # the history restarts at the cut


def test_every_kind_of_pass_is_in_the_catalogue() -> None:
    resources = {path.stem for case in catalogue() for path in (IMAGES / case).glob("*.exr")}
    assert resources >= {"shadow", "albedo", "emission", "specular_roughness", "motion", "position", "direct",
                         "specular", "indirect", "cube_direct", "tensor_cube", "tensor_screen", "indirect_low", "lit",
                         "taa", "display", "copy"}


def test_a_second_run_gives_the_same_bits(folder: Path) -> None:
    report = check([SMALL], folder)
    assert {f.verdict for f in report.findings} == {"same"}
    assert not report.foreign


@pytest.mark.parametrize("resource", [
    "shadow_visible", "albedo", "depth", "direct", "tensor_cube", "tensor_screen", "indirect_low", "indirect", "lit",
    "taa", "display"])
def test_the_first_broken_stage_is_the_one_that_changed(folder: Path, resource: str) -> None:
    def change(renderer: Renderer) -> None:
        override(renderer, resource, lambda image: np.clip(image.astype(np.float32) * 0.9, -1e4, 1e4))

    report = check([changed(change)], folder)
    first = report.broken[0]
    assert (first.resource, first.verdict) == (resource, "differs")
    assert first.distance.difference > 0.01
    where = [f.stage for f in report.findings].index(first.stage)
    assert all(f.ok for f in report.findings[:where])


def test_a_few_texels_are_enough(folder: Path) -> None:
    def change(renderer: Renderer) -> None:
        override(renderer, "normal", lambda image: np.where(np.arange(48)[:, None] == 7, image * 0.9, image))

    assert check([changed(change)], folder).broken[0].stage == "gbuffer"


def test_flip_notices_what_is_spread_too_thin_for_the_other_bounds(folder: Path) -> None:
    pytest.importorskip("flip_evaluator")

    def change(renderer: Renderer) -> None:
        override(renderer, "display", lambda image: np.where(np.arange(4) == 0, image * 0.97, image))

    (folder / "room" / ORIGIN).write_text(ELSEWHERE)
    report = check([changed(change)], folder)
    finding = next(f for f in report.findings if f.resource == "display")
    assert finding.tolerance is not None
    assert finding.distance.share <= finding.tolerance.share
    assert finding.verdict == "differs", finding.distance


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
        override(renderer, "direct", lambda image: image * factor)

    first = check([changed(change)], folder).broken[0]
    assert (first.stage, first.verdict) == ("direct", "unsteady")


def test_another_renderer_gets_the_wider_tolerance(folder: Path) -> None:
    def change(renderer: Renderer) -> None:
        override(renderer, "direct", lambda image: image * 1.004)

    assert broken(check([changed(change)], folder))[0] == ("direct", "direct", "differs")
    (folder / "room" / ORIGIN).write_text(ELSEWHERE)
    report = check([changed(change)], folder)
    assert not report.broken
    assert report.foreign == {"room": "Voodoo 2"}


def test_update_overwrites_goldens_of_another_renderer_only_when_told(folder: Path) -> None:
    (folder / "room" / ORIGIN).write_text(ELSEWHERE)
    with pytest.raises(OutputError, match=r"Voodoo 2.*--i-looked"):
        update([SMALL], folder, ["room"])
    assert (folder / "room" / ORIGIN).read_text() == ELSEWHERE
    update([SMALL], folder, ["room"], overwrite_foreign=True)
    assert not check([SMALL], folder).foreign


def test_update_is_all_or_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def files() -> dict[str, bytes]:
        return {str(f.relative_to(folder.parent)): f.read_bytes() for f in folder.parent.rglob("*") if f.is_file()}

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    before = files()
    monkeypatch.setattr("app.golden.store.write_text", interrupted)
    with pytest.raises(KeyboardInterrupt):
        update([SMALL], folder, ["room"])
    assert files() == before


def test_update_keeps_other_cases_and_drops_orphans(folder: Path) -> None:
    shutil.copytree(folder / "room", folder / "gone")
    before = (folder / "room" / "lit.exr").read_bytes()
    other = SceneCase("outdoor", outdoor(), None, (Shot("path", 1),), golden_frames=(1,), size=(16, 12))
    update([other], folder, ["room", "outdoor"])
    assert sorted(f.name for f in folder.iterdir()) == ["outdoor", "room"]
    assert (folder / "room" / "lit.exr").read_bytes() == before
    assert not check([other], folder).broken


def test_goldens_behind_a_link_and_in_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The link stays a link; an empty current folder takes goldens too."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    copy = catalogue()["copy"]
    monkeypatch.chdir(tmp_path / "real")
    assert len(update([copy], Path(), ["copy"])) == 1
    monkeypatch.chdir(tmp_path)
    update([copy], Path("link"), ["copy"])
    assert (tmp_path / "link").is_symlink()
    assert sorted(f.name for f in tmp_path.iterdir()) == ["link", "real"]
    assert {f.verdict for f in check([copy], tmp_path / "real").findings} == {"same"}


@pytest.mark.parametrize("content", [
    '{"renderer": null}', '{"renderer": ""}', '{"renderer": " "}', '{"renderer": 1}', '{"renderer": ["x"]}', "[]",
    "[" * 100_000])
def test_an_origin_is_a_name(tmp_path: Path, content: str) -> None:
    """Anything else would select the wider tolerance of another renderer."""
    (tmp_path / ORIGIN).write_text(content)
    with pytest.raises(SceneError, match="origin of the goldens"):
        read_origin(tmp_path)


def test_places_are_checked_before_anything_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def drawn(*_: object) -> None:
        raise AssertionError("drawn too early")

    monkeypatch.setattr(SceneCase, "draw", drawn)
    (tmp_path / "file").write_text("mine")
    for args in (["check", "room", "--report", str(tmp_path)], ["check", "room", "--report", str(tmp_path / "file/r")],
                 ["update", "room", "--golden", str(tmp_path / "file" / "goldens")]):
        result = CliRunner().invoke(cli, ["golden", *args])
        assert result.exit_code == 2, (args, result.exception)


def test_a_cut_is_drawn_as_one(tmp_path: Path) -> None:
    with_cut = replace(SMALL, shots=(Shot("path", 1), Shot("path", 1)), golden_frames=(2,))
    pictures = {p.resource: p.frames[2] for p in with_cut.draw(tmp_path)}
    assert pictures["taa"][..., 3].max() == 1
    assert np.abs(pictures["motion"][..., :2]).max() < 1e-4


@pytest.mark.parametrize(("args", "said"), [
    (["check", "rooom"], "did you mean 'room'"),
    (["update", "--golden", "."], "not a golden image"),
    (["update", "--golden", "notes.txt"], "not a folder"),
    (["update", "--golden", "own"], "renders is not a golden image"),
    (["update", "--golden", "mixed"], "room/notes.txt is not a golden image"),
    (["check", "copy", "--report", "."], ". is a folder"),
    (["check", "--golden", "broken"], "origin"),
    (["check", "--catalogue", "mine.json"], "--golden"),
    (["chek"], "chek"),
])
def test_user_errors_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, args: list[str], said: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "mine.json").write_text('{"cases": {"box": {"scene": "box.obj"}}}')
    (tmp_path / "box.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for file, text in (("broken/room/origin.json", "{"), ("mixed/room/origin.json", ELSEWHERE),
                       ("mixed/room/notes.txt", "mine"), ("own/renders/a.exr", "mine")):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    result = CliRunner().invoke(cli, ["golden", *args])
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert len(result.stderr.splitlines()) == 1
    for file in ("notes.txt", "own/renders/a.exr", "mixed/room/notes.txt"):
        assert (tmp_path / file).read_text() == "mine"
