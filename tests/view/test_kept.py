"""What the viewer keeps on disk, what it deletes, and what whoever waits is told when that fails."""

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

from app.errors import AfterglowError, SceneError
from app.evaluation.reference import Reference
from app.io.image import write_exr
from app.load import load_parts
from app.paths import data_dir
from app.view import reference, saving
from app.view.latest_only import LatestOnly
from app.view.progressive_reference import SAMPLES, ReferenceTracer
from app.view.saving import MAX_KEPT, Saver
from app.view.state import REFERENCE, State

BOX = data_dir() / "cornell-box.obj"
PARTS = load_parts(BOX)
STATE = State((16, 12), PARTS.scene.cameras[PARTS.scene.default_camera].at(0.0), PARTS.scene.lights, "none",
              split=REFERENCE)


async def traced(module: str, arguments: list[str], **options: Any) -> str:
    """A path tracer that is done at once: of each seed another grey."""
    told = dict(pairwise(arguments))
    folder, grey = Path(told["--out"]), np.full((12, 16, 3), 1.0 + int(told["--seed"]), np.float32)
    layers = dict.fromkeys(("", "direct", "indirect", "albedo"), grey)
    write_exr(folder / "reference.exr", {**layers, "depth": grey[..., :1]})
    (folder / "reference.json").write_text(f'{{"spp": {told["--spp"]}}}')
    return ""


async def fails(module: str, arguments: list[str], **options: Any) -> str:
    raise OSError("no room")


def followed(folder: Path, states: list[State]) -> tuple[list[Reference | None], list[Exception]]:
    """What is told of the references of these states, each traced to its end, and what goes wrong."""
    told: list[Reference | None] = []
    wrong: list[Exception] = []

    async def follow() -> None:
        references = ReferenceTracer(BOX, PARTS, folder, told.append, wrong.append)
        for state in states:
            references.follow(state)
            assert references._work is not None
            await references._work

    asyncio.run(follow())
    return told, wrong


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "REST_SECONDS", 0.0)
    monkeypatch.setattr(reference, "exporter_version", lambda scene: "")


def test_of_a_reference_the_finest_is_kept_and_of_references_the_newest(tmp_path: Path,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "run_module", traced)
    monkeypatch.setattr(reference, "MAX_KEPT", 2)
    states = [replace(STATE, camera=replace(STATE.camera, fov_y_deg=40.0 + i)) for i in range(3)]
    told, wrong = followed(tmp_path, states)
    assert not wrong
    shown = [found for found in told if found is not None]
    assert [found.about["spp"] for found in shown] == 3 * [8, 32, 128, 512]
    assert np.allclose(shown[-1].layers["final"], np.average([1, 2, 3, 4], weights=SAMPLES))  # of all that was traced
    assert len(list(tmp_path.iterdir())) == 2


def test_a_refinement_that_was_stopped_is_in_none_that_follows(tmp_path: Path,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ended, go_on = threading.Event(), threading.Event(), threading.Event()
    add = reference._add

    def slowly(folder: Path, other: Path) -> None:
        """The first time it goes on after it was stopped, while the second has begun."""
        if begun.is_set():
            go_on.set()
            ended.wait(10)
            add(folder, other)
            return
        begun.set()
        go_on.wait(10)
        with suppress(OSError, AfterglowError):
            add(folder, other)
        ended.set()

    async def stop_and_go_on() -> list[Reference | None]:
        told: list[Reference | None] = []
        references = ReferenceTracer(BOX, PARTS, tmp_path, told.append, pytest.fail)
        references.follow(STATE)
        await asyncio.to_thread(begun.wait, 10)
        references.follow(replace(STATE, split=""))
        references.follow(STATE)
        assert references._work is not None
        await references._work
        return told

    monkeypatch.setattr(reference, "run_module", traced)
    monkeypatch.setattr(reference, "_add", slowly)
    shown = [found.about["spp"] for found in asyncio.run(stop_and_go_on()) if found is not None]
    assert shown[-4:] == [8, 32, 128, 512]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_tracer_that_fails_is_told_of_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "run_module", fails)
    told, wrong = followed(tmp_path, [STATE])
    assert told == [] and [str(error) for error in wrong] == ["no room"]
    assert list(tmp_path.iterdir()) == []


def test_what_failed_is_tried_again_with_the_next_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Reference | None] = []
    wrong: list[Exception] = []

    async def fails_once_refined(module: str, arguments: list[str], **options: Any) -> str:
        first = dict(pairwise(arguments))["--seed"] == "0"
        return await (traced if wrong or first else fails)(module, arguments)

    async def follow() -> None:
        references = ReferenceTracer(BOX, PARTS, tmp_path, told.append, wrong.append)
        for exposure in (1.0, 2.0, 3.0):
            references.follow(replace(STATE, exposure=exposure))
            assert references._work is not None
            await references._work

    monkeypatch.setattr(reference, "run_module", fails_once_refined)
    asyncio.run(follow())
    assert [str(error) for error in wrong] == ["no room"]
    assert [found and found.about["spp"] for found in told] == [8, 8, 32, 128, 512]


def test_the_newest_saves_are_kept(tmp_path: Path) -> None:
    async def save() -> None:
        saver = Saver(BOX, PARTS, tmp_path, "cpu")
        saved = [await saver.save(STATE, "json") for _ in range(MAX_KEPT + 2)]
        assert [saver.file(one.number) for one in saved[2:]] == [one.file for one in saved[2:]]
        assert [saver.file(one.number) for one in saved[:2]] == [None, None]
        assert saver.file(0) is None
        assert len(list(tmp_path.iterdir())) == MAX_KEPT
        assert all(one.file.is_file() for one in saved[2:])

    asyncio.run(save())


def test_a_save_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(saving, "run_module", fails)
    with pytest.raises(OSError):
        asyncio.run(Saver(BOX, PARTS, tmp_path, "cpu").save(STATE, "png"))
    assert list(tmp_path.iterdir()) == []


def test_what_is_overtaken_is_never_done_and_the_loop_stays_free() -> None:
    done: list[int] = []

    async def work(item: int) -> None:
        await asyncio.sleep(0.02)
        done.append(item)

    async def drag() -> None:
        newest = LatestOnly(work, pytest.fail)
        for item in range(100):
            newest.offer(item)
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.1)
        assert len(done) < 20 and done[-1] == 99
        newest.offer(100)
        newest.stop()
        await asyncio.sleep(0.05)
        assert done[-1] == 99

    asyncio.run(drag())


def test_work_that_fails_is_told_of_and_the_next_is_done() -> None:
    done: list[int] = []
    wrong: list[Exception] = []

    async def work(item: int) -> None:
        if item == 1:
            raise MemoryError("no room")
        done.append(item)

    async def offer() -> None:
        newest = LatestOnly(work, wrong.append)
        for item in range(3):
            newest.offer(item)
            await asyncio.sleep(0.01)

    asyncio.run(offer())
    assert done == [0, 2] and [str(error) for error in wrong] == ["no room"]


@pytest.mark.parametrize("error", [OSError("no room"), SceneError("bad", "scene", "expected better")])
def test_whoever_saves_is_told_when_it_fails(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    from app.view.protocol import Choices
    from app.view.session import Session

    class Client:
        def __init__(self) -> None:
            self.replies: list[dict[str, Any]] = []

        def note(self, message: object) -> None: ...

        async def reply(self, message: dict[str, Any]) -> None:
            self.replies.append(message)

    async def refused(*args: object) -> None:
        raise error

    async def ask() -> None:
        session = Session(BOX, PARTS, STATE, Choices(("none",), ("final",), {}), "cpu")
        session._loop = asyncio.get_running_loop()
        session._loop.set_exception_handler(lambda loop, context: None)
        monkeypatch.setattr(session._saver, "save", refused)
        client: Any = Client()
        for _ in range(2):
            client.replies.clear()
            session.handle(client, {"type": "save", "kind": "png"})
            await session._requests["save"]
            (reply,) = client.replies
            assert reply["type"] in ("error", "refused") and str(error) in reply["message"]

    asyncio.run(ask())
