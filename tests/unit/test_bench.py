"""The benchmark's arithmetic: Pareto fronts, rounds, scaling fits and baselines; nothing is drawn here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from app.bench import baselines
from app.bench.pareto import Point, Ratio, error_ratio, mean_ratio, pareto_front, speed_up
from app.bench.scaling import fit_power, hall
from app.cli import cli as app_cli
from app.errors import SettingsError
from app.evaluation import reference, timing
from app.evaluation.configurations import Configuration
from app.evaluation.timing import Spread, swayed
from app.load import embedded_scene

Json = dict[str, Any]

GREY = np.full((3, 4, 3), 0.5, np.float32)


def curve(*points: tuple[float, float]) -> list[Point]:
    return [Point(ms, error) for ms, error in points]


def test_the_pareto_front_is_what_no_other_point_beats() -> None:
    points = curve((4, 0.3), (1, 0.5), (2, 0.6), (4, 0.2), (9, 0.2), (3, 0.5))
    assert [(p.ms, p.error) for p in pareto_front(points)] == [(1, 0.5), (4, 0.2)]


def test_speed_up_is_interpolated_in_logarithms() -> None:
    baseline = curve((10, 0.4), (40, 0.1))
    assert speed_up(Point(5, 0.2), baseline) == Ratio(pytest.approx(4.0))
    assert speed_up(Point(40, 0.2), baseline) == Ratio(pytest.approx(0.5))


def test_error_ratio_is_interpolated_in_logarithms() -> None:
    baseline = curve((10, 0.4), (40, 0.1))
    assert error_ratio(Point(20, 0.1), baseline) == Ratio(pytest.approx(2.0))
    assert error_ratio(Point(20, 0.4), baseline) == Ratio(pytest.approx(0.5))


def test_nothing_is_extrapolated() -> None:
    baseline = curve((10, 0.4), (40, 0.1))
    assert speed_up(Point(5, 0.5), baseline) == Ratio(2.0, "≤")      # even its fastest has a smaller error
    assert speed_up(Point(5, 0.05), baseline) == Ratio(8.0, "≥")     # it never reaches that error
    assert error_ratio(Point(5, 0.2), baseline) == Ratio(2.0, "≥")   # it has no picture by then
    assert error_ratio(Point(80, 0.2), baseline) == Ratio(0.5, "≤")  # it finished its best before


def test_a_point_against_itself_is_one() -> None:
    own = Point(10, 0.4)
    for baseline in (curve((10, 0.4)), curve((10, 0.4), (40, 0.1))):
        assert speed_up(own, baseline) == error_ratio(own, baseline) == Ratio(1.0)


def test_points_off_the_baseline_s_front_do_not_count() -> None:
    baseline = curve((10, 0.4), (20, 0.9), (40, 0.1), (400, 0.3))
    assert speed_up(Point(5, 0.2), baseline).value == pytest.approx(4.0)


def test_means_are_geometric_and_keep_their_bound() -> None:
    assert mean_ratio([Ratio(2.0), Ratio(8.0)]) == Ratio(pytest.approx(4.0))
    assert mean_ratio([Ratio(2.0, "≥"), Ratio(8.0)]).bound == "≥"
    assert mean_ratio([Ratio(2.0, "≥"), Ratio(8.0, "≤")]).bound == "≈"


def test_a_spread_counts_all_frames_and_keeps_each_round() -> None:
    spread = Spread.of([[1, 2, 3], [4, 5, 60]])
    assert spread.median == 3.5
    assert spread.p95 == pytest.approx(np.percentile([1, 2, 3, 4, 5, 60], 95))
    assert spread.rounds == (2, 5)


class FakeRenderer:
    """The first two frames of each round take long."""

    def __init__(self, *_: object) -> None:
        self.device: dict[str, str] = {}
        self.frames = 0

    def __enter__(self) -> FakeRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def reset_timing(self) -> None:
        pass

    def render(self, camera: object, time: float) -> None:
        self.frames += 1

    def timing(self) -> Json:
        return {"passes": {}, "frame": {"cpu_ms": {"median": 90.0 if (self.frames - 1) % 8 < 2 else 1.0}}}


def test_the_first_frames_of_a_round_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "Renderer", FakeRenderer)
    scene = embedded_scene()
    run = timing.TimedRun(scene, scene.cameras[scene.default_camera].at(0.0), Configuration("none", (), (64, 48)))
    with timing.InterleavedTimer([run], "cpu") as timer:
        timer.run_round()
        timer.run_round()
    assert [times["frame"] for times in run.rounds] == [[1.0] * 6] * 2


def test_the_camera_sways_sideways() -> None:
    scene = embedded_scene()
    camera = scene.cameras[scene.default_camera].at(0.0)
    moved = [swayed(camera, scene, frame) for frame in range(1, 4)]
    assert len({c.eye for c in moved}) == 3
    for c in moved:
        shift = np.subtract(c.eye, camera.eye)
        assert 0 < np.linalg.norm(shift) <= 2e-3 * scene.longest_edge
        assert shift @ np.subtract(camera.target, camera.eye) == pytest.approx(0, abs=1e-9)


def test_the_exponent_of_a_power_is_fitted() -> None:
    counts = [1, 10, 100, 1000]
    exponent, error = fit_power(counts, [3 * n**0.7 for n in counts])
    assert exponent == pytest.approx(0.7)
    assert error == pytest.approx(0, abs=1e-9)
    # By hand: x = 0 … 3 and y = 0, 1, 1, 2 in decades: slope 0.6, squared residuals 0.2, two degrees, Σ(x − x̄)² = 5.
    assert fit_power(counts, [1, 10, 10, 100]) == (pytest.approx(0.6), pytest.approx(np.sqrt(0.2 / 2 / 5)))


def test_the_hall_has_the_requested_counts() -> None:
    for triangles, lights in ((1_000, 1), (10_000, 7), (100_000, 2)):
        scene = hall(triangles, lights)
        assert scene.triangles == pytest.approx(triangles, rel=0.06)
        assert len(scene.lights) == lights
        assert sum(light.intensity[0] for light in scene.lights) == pytest.approx(12)
        assert any(i.motion is not None for i in scene.instances)


def test_the_time_of_a_denoised_picture_is_tracing_plus_the_median_denoising(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = {"fast": iter([9.0, 0.1, 0.2, 0.3, 7.0, 0.2]), "high": iter([9.0, 1.0, 1.0, 1.0, 1.0, 1.0])}
    now = 0.0

    def denoise(image: reference.BaselineImage, quality: str) -> Any:
        nonlocal now
        now += next(seconds[quality])
        return image.final / 2

    monkeypatch.setattr(baselines, "denoise", denoise)
    monkeypatch.setattr(baselines, "perf_counter", lambda: now)
    drawn = baselines.draw_baselines(lambda: [reference.BaselineImage(4, 2.0, GREY, GREY, GREY)])
    assert [(r.name, r.spp, r.ms) for r in drawn] == [
        ("path tracer", 4, 2000), ("denoised (fast)", 4, pytest.approx(2200)), ("denoised (high)", 4, 3000)]
    assert [r.picture.max() for r in drawn] == [0.5, 0.25, 0.25]


@pytest.mark.parametrize(("sizes", "said"), [
    ("8x6", "expected sides of at least 11"), ("64x48,64x10", "expected sides of at least 11"),
    ("64x48,0x5", "--sizes: bad size 0x5"), ("-3x5", "--sizes: bad size '-3x5'")])
def test_bad_sizes_are_refused(sizes: str, said: str) -> None:
    done = CliRunner().invoke(app_cli, ["bench", "--sizes", sizes])
    assert done.exit_code == 2 and said in done.output


@pytest.mark.parametrize("option", [
    ["--seed", "32"], ["--max-bounces", "1001"], ["--baselines", "32769"], ["--baselines", "²"]])
def test_the_path_tracer_refuses_numbers_out_of_range(option: list[str], tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    from export.__main__ import cli as export_cli

    done = CliRunner().invoke(export_cli, ["reference", "--out", str(tmp_path), *option])
    assert done.exit_code == 2 or isinstance(done.exception, SettingsError)
