"""Models on the validation views: better models get better figures, and references are traced once."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("mitsuba")

from app.errors import AfterglowError, SettingsError
from app.evaluation.picture_errors import AMBIENT
from app.evaluation.tables import markdown_table
from app.load import embedded_scene
from export.__main__ import cli
from export.reference.still import Still
from export.validation import detail
from export.validation.errors import ORACLE, Row, by_scene, measure_errors
from export.validation.scenes.glossy import (
    GLOSSY_SOURCES,
    ROUGHNESSES,
    SPHERE_RADIUS,
    SPHERE_ROWS,
    sphere_centers,
    spheres_seen,
)
from export.validation.tables import HEADER, noise_lines, table_lines, with_figures
from export.validation.timing import frame_times
from export.validation.views import View
from tests.gl.scenes import draw
from tests.tiny_network import write_tiny_network
from tests.unit.load_helpers import Gltf

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]


def compare_assets(folder: Path, size: str) -> str:
    """What ``validate assets`` says when it compares the assets of ``folder`` and writes to its folder ``out``."""
    run = CliRunner().invoke(cli, ["validate", "assets", str(folder), "--size", size, "--spp", "16",
                                   "--out", str(folder / "out")], catch_exceptions=False)
    assert run.exit_code == 0, run.output
    return run.output


def test_direct_light_on_assets_is_compared(tmp_path: Path) -> None:
    """A textured quad agrees under both lights; a file that can't be read is reported, and the others still are.

    A second run measures only what the table lacks, and a damaged table is refused.
    """
    gltf = Gltf()
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    texture = gltf.texture(np.random.default_rng(0).integers(0, 255, (4, 4, 4)))
    gltf.material(pbrMetallicRoughness={"baseColorTexture": {"index": texture}, "metallicFactor": 0.0})
    gltf.primitive["attributes"] = {"POSITION": gltf.array(corners), "TEXCOORD_0": gltf.array(corners[:, :2] / 2 + 0.5)}
    gltf.save(tmp_path, "quad.gltf")
    (tmp_path / "broken.gltf").write_text("{")
    compare_assets(tmp_path, "96x72")
    table = tmp_path / "out" / "assets.csv"
    rows = {row["asset"]: row for row in csv.DictReader(table.open())}
    assert rows["broken"]["error"] and not rows["broken"]["point"]
    assert all(float(rows["quad"][light]) > 30 for light in ("point", "spot"))
    assert (tmp_path / "out" / "quad-spot.png").is_file()

    table.write_text(table.read_text().replace(rows["quad"]["point"], "12.3"))
    again = compare_assets(tmp_path, "96x72")
    assert "12.3" in again and ": broken" in again and ": quad" not in again
    larger = compare_assets(tmp_path, "104x78")
    assert "12.3" not in larger and ": quad" in larger
    table.write_text("asset,point\nquad,bright\n")
    with pytest.raises(SettingsError, match="not a table of assets"):
        compare_assets(tmp_path, "96x72")


def test_glossy_views_are_compared_with_the_full_material(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing files are skipped with a reason; of spheres the ratio of each roughness is stated."""
    monkeypatch.setattr("export.validation.glossy.ROW_SIZE", (96, 32))
    monkeypatch.setattr("export.validation.glossy.SIZE", (32, 24))
    names = ("metal-spheres", "steel-room", "bathroom", "ToyCar")
    run = CliRunner().invoke(cli, [
        "validate", "glossy", "none", "--scenes", str(tmp_path), "--assets", str(tmp_path), "--references",
        str(tmp_path / "references"), "--spp", "16", "--out", str(tmp_path / "out"), "--provider", "cpu",
        *(text for name in names for text in ("--only", name))])
    assert run.exit_code == 0, run.output
    assert "bathroom skipped: no file" in run.output and "ToyCar skipped: no file" in run.output
    rows = {row["view"]: row for row in csv.DictReader((tmp_path / "out" / "glossy.csv").open())}
    assert set(rows) == {"metal-spheres", "steel-room"}
    assert all(0.1 < float(row["mean"]) < 1.1 and float(row["own"]) > float(row["psnr"]) for row in rows.values())
    assert all(0.05 < float(rows["metal-spheres"][f"ratio {r:g}"]) < 1.1 for r in ROUGHNESSES)
    assert not rows["steel-room"]["ratio 1"]
    assert (tmp_path / "out" / "steel-room.png").is_file() and len(list((tmp_path / "references").iterdir())) == 4


@pytest.mark.parametrize("name", SPHERE_ROWS)
def test_spheres_are_where_the_masks_say(name: str) -> None:
    """Each mask shows points of its sphere alone, and most of them."""
    scene = GLOSSY_SOURCES[name]()
    still = Still(scene, scene.cameras["main"].at(0.0), (192, 64))
    position = draw(scene, still.size, ("position",))["position"]
    for center, shown in zip(sphere_centers(), spheres_seen(still), strict=True):
        distance = np.linalg.norm(position - np.asarray(center, np.float32), axis=-1)
        on = np.abs(distance - SPHERE_RADIUS) < 0.01
        assert on[shown].all() and shown.sum() > 0.6 * on.sum() > 60


def test_models_are_compared_with_cached_references(tmp_path: Path) -> None:
    scene = embedded_scene()
    still = Still(scene, scene.cameras[scene.default_camera].at(0.0), (64, 48))
    views = [View("box-0", "box", still), View("box-1", "box", still)]
    rows = measure_errors(views, ["none", "radiosity"], 8, tmp_path, "cpu", lambda line: None, oracle=True)
    labels = ["none", "radiosity", f"radiosity {ORACLE}", AMBIENT]
    assert [row["model"] for row in rows] == 2 * labels
    psnr = {row["model"]: row["final.psnr"] for row in rows}
    assert psnr["none"] < psnr[AMBIENT] < psnr["radiosity"] < psnr[f"radiosity {ORACLE}"]
    assert len({row["direct.psnr"] for row in rows}) == 1 and 20 < rows[0]["direct.psnr"] < 60  # no model changes it
    assert all(0 < rows[0][f"reference_noise.{layer}"] < 1 for layer in ("final", "direct", "indirect"))
    assert [line[0] for line in noise_lines(rows)] == ["box", "mean"]
    means = by_scene(rows)
    assert [(m["scene"], m["model"], m["views"]) for m in means] == [
        (scene, label, 2) for scene in ("box", "mean") for label in labels]
    assert means[0]["final.psnr"] == pytest.approx(psnr["none"])

    cached = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.exr")}
    assert measure_errors(views, ["none"], 8, tmp_path, "cpu", lambda line: None)[0] == rows[0]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.exr")} == cached

    times = frame_times(views, ["none", "radiosity"], (64, 48), "cpu", lambda line: None)
    ms = times.milliseconds
    assert ms["box"]["radiosity"] > ms["box"]["none"] > 0 and ms["mean"] == ms["box"]
    page = markdown_table(HEADER, table_lines(rows, times)).splitlines()
    assert len({line.count("|") for line in page}) == 1 and len(page) == 2 + 2 * len(labels)
    assert page[2].startswith(f"| box | none | {psnr['none']:.2f} |") and f"| {ms['box']['none']:.0f} |" in page[2]

    card = with_figures("# radiosity\n\n**Made by** us.\n", "radiosity", rows, 8, times)
    lines = card.splitlines()
    assert lines[:3] == ["# radiosity", "", "**Made by** us."] and "against 8 denoised paths a pixel" in card
    assert f"| mean | 2 | {psnr['none']:.2f}, " in card and f"{psnr['radiosity']:.2f}, " in card
    assert "`none` | `radiosity` | ambient (oracle) |" in card
    assert lines[-1].startswith(f"A frame of 64×48 takes {ms['mean']['radiosity']:.0f} ms, ") and "cpu" in lines[-1]
    assert with_figures(card, "radiosity", rows, 8, times) == card, "a second write replaces the section"
    between = with_figures(f"{card}\n## More\n\nMore.\n", "radiosity", rows, 8, None)
    assert between.endswith("\n\n## More\n\nMore.\n") and "A frame of" not in between


def test_cards_need_all_views_and_a_card_beside_each_network(tmp_path: Path) -> None:
    lonely = write_tiny_network(tmp_path / "lonely.onnx")
    for arguments, message in ((["radiosity", "--only", "sponza"], "needs all views"),
                               (["radiosity", "--lighting", "emissive"], "needs all views"),
                               ([str(lonely)], "no model card of 'lonely'")):
        with pytest.raises(AfterglowError, match=message):
            CliRunner().invoke(cli, ["validate", "views", *arguments, "--cards", "--out", str(tmp_path / "out")],
                               catch_exceptions=False)
    assert not (tmp_path / "out").exists()


def test_means_of_rows_and_of_none() -> None:
    rows = [{"model": "a", "scene": scene, "view": "v", "psnr": psnr, "seconds": 9.0}
            for scene, psnr in (("x", 1), ("x", 2.0), ("y", 6.0))]
    assert [m["psnr"] for m in by_scene([{**rows[0], "psnr": None}, rows[1]], ["psnr"])] == [2.0, 2.0]
    assert by_scene([{**rows[0], "psnr": None}], ["psnr"])[0]["psnr"] is None
    assert by_scene([]) == by_scene([], ["psnr"]) == []
    assert [(m["scene"], m["views"], m["psnr"]) for m in by_scene(rows, ["psnr"])] == [
        ("x", 2, 1.5), ("y", 1, 6.0), ("mean", 3, 3.0)]


def test_detail_of_indirect_light_is_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No light lacks all detail, surfels have some; references are traced once."""
    scene = embedded_scene()
    view = View("box", "box", Still(scene, scene.cameras[scene.default_camera].at(0.0), (64, 48)))

    def rows() -> dict[str, Row]:
        found = detail.measure_errors([view], ["none", "radiosity"], 32, tmp_path / "references", "cpu", tmp_path,
                                      lambda line: None)
        return {row["model"]: row for row in found}

    first = rows()
    assert first["none"]["edge gradient"] == first["none"]["texel variation"] == pytest.approx(1)
    assert first["radiosity"]["texel variation"] < 0.9
    assert first["none"]["psnr"] < first["radiosity"]["psnr"] < first[detail.REFERENCE]["psnr"]
    assert {path.name for path in tmp_path.glob("*.png")} == {
        f"box-{model}.png" for model in ("none", "radiosity", detail.REFERENCE)}
    monkeypatch.setattr("export.validation.detail_references.PathTracer", None)
    assert rows() == first
    means = {row["model"]: row for row in detail.means_of(list(first.values()))}
    assert means["radiosity"]["flip"] == first["radiosity"]["flip"]
