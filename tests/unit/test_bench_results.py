"""What a benchmark reports: headline figures, comparison with an earlier run, table and page."""

from __future__ import annotations

import copy
import json
import platform
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.bench.headlines import headlines
from app.bench.machine import processor_name
from app.bench.records import rows
from app.bench.regressions import compare, read_results
from app.bench.report import html_report
from app.bench.run import VERSION
from app.errors import SettingsError
from app.evaluation.tables import to_csv

Json = dict[str, Any]


def configuration(label: str, ms: float, flip: float, grid: list[int] | None) -> Json:
    errors = {"flip": flip, "psnr": 30.0, "ssim": 0.9, "rel_mse": 0.1}
    return {"label": label, "size": [4, 3], "grid": grid, "precision": grid and "float32",
            "errors": {layer: dict(errors) for layer in ("direct", "indirect", "final")},
            "device": {"gl_renderer": "soft", "gl_version": "4.5", "provider": "cpu"},
            "cold_start": {"startup_s": 0.5, "peak_mb": 250.0},
            "stages": {n: times(m) for n, m in (("direct", ms / 2), ("tiny", 0.01), ("copy", 1.0), ("frame", ms))}}


def times(ms: float) -> Json:
    return {"median": ms, "p95": 2 * ms, "rounds": [f * ms for f in (1, 1.01, 0.99, 1.005, 0.995)]}


def slow(stages: Json, factor: float, *names: str) -> None:
    for name in names:
        stages[name] = times(factor * stages[name]["median"])


def baseline(name: str, spp: int, ms: float, flip: float) -> Json:
    return {"name": name, "spp": spp, "ms": ms,
            "errors": {"final": {"flip": flip, "psnr": 30.0, "ssim": 0.9, "rel_mse": 0.1}}}


@pytest.fixture
def results() -> Json:
    scene = {
        "name": "<box>", "lighting": "lamp", "camera": "main", "triangles": 32, "lights": 1, "yardstick": times(4.0),
        "reference": {"spp": 8, "noise": {"final": 0.01}, "notices": ["no fog"], "size": [4, 3], "key": "k"},
        "configurations": [configuration("none", 5.0, 0.5, None), configuration("net", 10.0, 0.2, [2, 2])],
        "ambient": {"constant": [1, 1, 1],
                    "errors": {"final": {"flip": 0.3, "psnr": None, "ssim": 1.0, "rel_mse": 0.0}}},
        "baselines": [baseline("path tracer", 1, 20, 0.4), baseline("path tracer", 4, 80, 0.1),
                   baseline("denoised (fast)", 1, 30, 0.1)],
    }
    return {"version": VERSION, "command": "bench", "absent": [], "seconds": 3.0, "scenes": [scene],
            "headlines": headlines([scene]),
            "machine": {"processor": "cpu", "cores": 2, "physical_cores": 2, "memory_gb": 8.0, "system": "Linux",
                        "python": "3.11", "load_average": 0.1, "versions": {"numpy": "2"}}}


def test_headlines_compare_with_every_baseline(results: Json) -> None:
    by_baseline = {row["against"]: row for row in results["headlines"]}
    assert set(by_baseline) == {"path tracer", "path tracer, denoised"}
    assert by_baseline["path tracer"]["speed_up"] == {"value": pytest.approx(4.0), "bound": ""}
    assert by_baseline["path tracer"]["error_ratio"] == {"value": pytest.approx(2.0), "bound": "≥"}
    assert by_baseline["path tracer, denoised"]["speed_up"] == {"value": pytest.approx(3.0), "bound": "≤"}


def test_equal_results_show_no_change(results: Json) -> None:
    assert compare(results, results) == ([], [])


def test_times_that_rose_beyond_noise_are_reported(results: Json) -> None:
    new = copy.deepcopy(results)
    stages = new["scenes"][0]["configurations"][1]["stages"]
    slow(stages, 1.025, "frame")
    slow(stages, 1.10, "direct")
    slow(stages, 4.0, "tiny")
    slow(new["scenes"][0]["configurations"][0]["stages"], 1.10, "direct", "frame")
    changes, notes = compare(results, new)
    assert not notes
    assert [(c.where, c.figure, c.worse) for c in changes] == [
        ("<box>, none at 4x3", "direct ms", True), ("<box>, none at 4x3", "frame ms", True),
        ("<box>, net at 4x3", "direct ms", True)]
    assert not any(change.worse for change in compare(new, results)[0])


def test_equal_programs_rarely_differ_and_slower_ones_do(results: Json) -> None:
    random = np.random.default_rng(5)
    first = results["scenes"][0]["configurations"][0]

    def run(scatter: float, slower: float = 1.0) -> Json:
        """A hundred stages in five rounds."""
        drawn = {f"stage {i}": slower * random.lognormal(0, scatter, 5) for i in range(100)}
        stages = {n: {"median": float(np.median(t)), "rounds": t.tolist()} for n, t in drawn.items()}
        return results | {"scenes": [results["scenes"][0] | {
            "configurations": [first | {"stages": stages | {"copy": times(1.0), "frame": times(5.0)}}]}]}

    for scatter in (0.02, 0.1):
        assert sum(bool(compare(run(scatter), run(scatter))[0]) for _ in range(30)) <= 3
    assert len(compare(run(0.01), run(0.01, slower=1.1))[0]) > 95


def test_a_few_rounds_are_not_compared(results: Json) -> None:
    new = copy.deepcopy(results)
    for c in new["scenes"][0]["configurations"]:
        slow(c["stages"], 9, "direct")
        for stage in c["stages"].values():
            stage["rounds"] = stage["rounds"][:4]
    assert compare(results, new) == ([], ["times of fewer than 5 rounds are not compared"])


@pytest.mark.parametrize(("key", "value"), [("lighting", "sun"), ("camera", "side"), ("triangles", 33), ("lights", 2)])
def test_another_picture_is_not_compared(results: Json, key: str, value: object) -> None:
    new = copy.deepcopy(results)
    new["scenes"][0][key] = value
    slow(new["scenes"][0]["configurations"][0]["stages"], 9, "direct")
    new["scenes"][0]["configurations"][0]["errors"]["final"]["flip"] *= 3
    assert compare(results, new) == ([], [f"<box> differs in {key}: it is not compared"])


def test_times_of_another_device_are_not_compared(results: Json) -> None:
    for key in ("gl_renderer", "provider"):
        new = copy.deepcopy(results)
        for c in new["scenes"][0]["configurations"]:
            slow(c["stages"], 0.1, "direct", "frame")
            c["device"][key] = "another"
        changes, (note,) = compare(results, new)
        assert not changes and "another" in note and "are not compared with times on soft with provider cpu" in note


def test_a_loaded_machine_is_noted(results: Json) -> None:
    new = copy.deepcopy(results)
    new["machine"]["load_average"] = 3.5
    assert "this run began under a load of 3.5 on 2 cores" in compare(results, new)[1][0]
    assert "the earlier run began" in compare(new, results)[1][0]


@pytest.mark.parametrize("by", ["copy", "processor"])
def test_a_slower_machine_is_not_a_change(results: Json, by: str) -> None:
    new = copy.deepcopy(results)
    for c in new["scenes"][0]["configurations"]:
        slow(c["stages"], 1.5, "direct", "frame", *(["copy"] if by == "copy" else []))
    if by == "processor":
        slow(new["scenes"][0], 1.5, "yardstick")
    changes, notes = compare(results, new)
    assert not changes
    assert "the yardsticks moved by 50%" in notes[0]
    slow(new["scenes"][0]["configurations"][1]["stages"], 1.2, "direct")
    assert [c.figure for c in compare(results, new)[0]] == ["direct ms"]


def test_errors_that_rose_are_reported(results: Json) -> None:
    new = copy.deepcopy(results)
    final = new["scenes"][0]["configurations"][0]["errors"]["final"]
    final["flip"] *= 1.02
    final["psnr"] += 0.5
    final["ssim"] -= 0.0005
    changes, _ = compare(results, new)
    assert {(c.figure, c.worse) for c in changes} == {("final flip", True), ("final psnr", False)}


def test_times_of_another_machine_are_not_compared(results: Json) -> None:
    new = copy.deepcopy(results)
    new["machine"]["processor"] = "another"
    slow(new["scenes"][0]["configurations"][1]["stages"], 9, "direct")
    new["scenes"][0]["reference"]["key"] = "other"
    new["scenes"][0]["configurations"][1]["errors"]["final"]["flip"] *= 3
    changes, notes = compare(results, new)
    assert not changes
    assert len(notes) == 2 and "times are not compared" in notes[0] and "another reference" in notes[1]


def test_new_and_missing_entries_are_noted(results: Json) -> None:
    new = copy.deepcopy(results)
    new["scenes"][0]["configurations"].append(configuration("added", 1.0, 0.1, None))
    new["scenes"][0]["configurations"][0]["stages"]["fog"] = times(50.0)
    assert compare(results, new) == ([], ["<box>, added at 4x3 is new", "<box>, none at 4x3, fog is new"])
    assert compare(new, results) == ([], ["<box>, added at 4x3 is gone", "<box>, none at 4x3, fog is gone"])
    assert compare(results, results | {"scenes": []}) == ([], ["<box> is gone"])


@pytest.mark.parametrize("text", ["", "[]", '{"version": 0}', f'{{"version": {VERSION}}}'])
def test_only_results_can_be_compared_with(text: str, tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text(text)
    with pytest.raises(SettingsError, match=r"expected the bench\.json of a run"):
        read_results(tmp_path / "old.json")


def test_an_incomplete_result_can_t_be_compared_with(results: Json, tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text(json.dumps(results))
    assert read_results(tmp_path / "old.json") == results
    del results["scenes"][0]["configurations"][1]["stages"]["frame"]["rounds"]
    (tmp_path / "old.json").write_text(json.dumps(results))
    with pytest.raises(SettingsError, match="not a result of version"):
        read_results(tmp_path / "old.json")


def test_the_table_has_a_row_for_each_entry(results: Json) -> None:
    lines = to_csv(rows(results)).splitlines()
    assert len(lines) == 1 + 2 + 1 + 3
    header = lines[0].split(",")
    assert {"scene", "label", "frame.median_ms", "frame.p95_ms", "final.flip", "indirect.psnr", "spp",
            "startup_s", "peak_mb"} <= set(header)
    assert dict(zip(header, lines[2].split(","), strict=True))["frame.median_ms"] == "10.0"


def test_the_page_needs_no_other_file(results: Json) -> None:
    image = np.full((12, 16, 3), 0.5, np.float32)
    results["scaling"] = {"model": "net", "sweeps": {"lights": {
        "counts": [1, 2], "stages": {"frame": {"ms": [1.0, 2.0], "exponent": 1.0, "error": 0.0},
                                     "tiny": {"ms": [0.01, 0.01], "exponent": None, "error": None}}}}}
    page = html_report(results, {"<box>": {"reference": image, "net": image * 2}})
    assert "<box>" not in re.sub(r"<script>.*</script>", "", page, flags=re.S)  # names are escaped
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:|#)", page)
    assert page.count("</script>") == 1
    for text in ("Speed-up at equal error", "4×", "≥2×", "path tracer, 4 spp", "1.00 ± 0.00", "cpu, 2 logical",
                 "; full-material reference of 8 samples per pixel", "; no fog"):
        assert text in page
    pictures = json.loads(re.search(r"const pictures = (.*);\n", page)[1])  # type: ignore[index]
    assert set(pictures["<box>"]["net"]) == {"picture", "flip"}
    assert pictures["<box>"]["net"]["picture"].startswith("data:image/webp;base64,")


def test_the_same_results_make_the_same_page(results: Json) -> None:
    image = {"<box>": {"reference": np.full((12, 16, 3), 0.5, np.float32)}}
    assert html_report(results, image) == html_report(results, image)


def test_a_system_without_cpuinfo_names_the_architecture(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> str:
        raise FileNotFoundError

    monkeypatch.setattr(Path, "read_text", refuse)
    assert processor_name() == platform.machine()
