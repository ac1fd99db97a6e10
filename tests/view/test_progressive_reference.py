"""The progressive reference: refinement, its cache, and failures."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.errors import AfterglowError
from app.evaluation.reference import Reference
from app.io.image import write_exr
from app.load import load_for_editing
from app.paths import data_dir
from app.view import progressive_reference
from app.view.progressive_reference import SAMPLES, ReferenceTracer
from app.view.state import REFERENCE, State

BOX = data_dir() / "cornell-box.obj"
LOADED = load_for_editing(BOX)
STATE = State((16, 12), LOADED.scene.cameras[LOADED.scene.default_camera].at(0.0), LOADED.scene.lights, "none",
              split=REFERENCE)


async def trace(module: str, arguments: list[str], **options: Any) -> str:
    """Stand in for the path tracer: finishes at once, with another grey for each seed."""
    values = dict(pairwise(arguments))
    folder, grey = Path(values["--out"]), np.full((12, 16, 3), 1.0 + int(values["--seed"]), np.float32)
    layers = dict.fromkeys(("", "direct", "indirect", "albedo"), grey)
    write_exr(folder / "reference.exr", {**layers, "depth": grey[..., :1]})
    (folder / "reference.json").write_text(f'{{"spp": {values["--spp"]}}}')
    return ""


async def fail(module: str, arguments: list[str], **options: Any) -> str:
    raise OSError("disk full")


def follow_all(folder: Path, states: list[State]) -> tuple[list[Reference | None], list[Exception]]:
    """Trace the reference of each state to its end; return all references and errors that were reported."""
    references: list[Reference | None] = []
    errors: list[Exception] = []

    async def run() -> None:
        tracer = ReferenceTracer(BOX, LOADED, folder, references.append, errors.append)
        for state in states:
            tracer.follow(state)
            assert tracer._work is not None
            await tracer._work

    asyncio.run(run())
    return references, errors


@pytest.fixture(autouse=True)
def without_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progressive_reference, "START_DELAY_SECONDS", 0.0)
    monkeypatch.setattr(progressive_reference, "exporter_version", lambda scene: "")


def test_the_finest_reference_of_the_latest_views_is_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progressive_reference, "run_module_async", trace)
    monkeypatch.setattr(progressive_reference, "MAX_CACHED", 2)
    states = [replace(STATE, camera=replace(STATE.camera, fov_y_deg=40.0 + i)) for i in range(3)]
    references, errors = follow_all(tmp_path, states)
    assert not errors
    shown = [reference for reference in references if reference is not None]
    assert [reference.about["spp"] for reference in shown] == 3 * [8, 32, 128, 512]
    assert np.allclose(shown[-1].layers["final"], np.average([1, 2, 3, 4], weights=SAMPLES))  # the mean of all samples
    assert len(list(tmp_path.iterdir())) == 2


def test_a_cancelled_refinement_does_not_enter_later_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started, ended, resume = threading.Event(), threading.Event(), threading.Event()
    accumulate = progressive_reference._accumulate

    def accumulate_slowly(folder: Path, other: Path) -> None:
        """The first call continues after its cancellation, while the second runs."""
        if started.is_set():
            resume.set()
            ended.wait(10)
            accumulate(folder, other)
            return
        started.set()
        resume.wait(10)
        with suppress(OSError, AfterglowError):
            accumulate(folder, other)
        ended.set()

    async def cancel_and_restart() -> list[Reference | None]:
        references: list[Reference | None] = []
        tracer = ReferenceTracer(BOX, LOADED, tmp_path, references.append, pytest.fail)
        tracer.follow(STATE)
        await asyncio.to_thread(started.wait, 10)
        tracer.follow(replace(STATE, split=""))
        tracer.follow(STATE)
        assert tracer._work is not None
        await tracer._work
        return references

    monkeypatch.setattr(progressive_reference, "run_module_async", trace)
    monkeypatch.setattr(progressive_reference, "_accumulate", accumulate_slowly)
    shown = [reference.about["spp"] for reference in asyncio.run(cancel_and_restart()) if reference is not None]
    assert shown[-4:] == [8, 32, 128, 512]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_tracer_that_fails_is_reported_and_leaves_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progressive_reference, "run_module_async", fail)
    references, errors = follow_all(tmp_path, [STATE])
    assert references == [] and [str(error) for error in errors] == ["disk full"]
    assert list(tmp_path.iterdir()) == []


def test_the_next_change_retries_a_failed_refinement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail_once_refined(module: str, arguments: list[str], **options: Any) -> str:
        first = dict(pairwise(arguments))["--seed"] == "0"
        return await (trace if errors or first else fail)(module, arguments)

    references: list[Reference | None] = []
    errors: list[Exception] = []

    async def run() -> None:
        tracer = ReferenceTracer(BOX, LOADED, tmp_path, references.append, errors.append)
        for exposure in (1.0, 2.0, 3.0):
            tracer.follow(replace(STATE, exposure=exposure))
            assert tracer._work is not None
            await tracer._work

    monkeypatch.setattr(progressive_reference, "run_module_async", fail_once_refined)
    asyncio.run(run())
    assert [str(error) for error in errors] == ["disk full"]
    assert [reference and reference.about["spp"] for reference in references] == [8, 8, 32, 128, 512]
