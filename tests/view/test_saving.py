"""Saved files: which ones are kept, and how failures are reported."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from app.errors import SceneError
from app.load import load_for_editing
from app.paths import data_dir
from app.view import saving
from app.view.protocol import Choices
from app.view.saving import MAX_SAVED, Saver
from app.view.session import Session
from app.view.state import State

BOX = data_dir() / "cornell-box.obj"
LOADED = load_for_editing(BOX)
STATE = State((16, 12), LOADED.scene.cameras[LOADED.scene.default_camera].at(0.0), LOADED.scene.lights, "none")


def test_the_latest_files_are_kept(tmp_path: Path) -> None:
    async def save() -> None:
        saver = Saver(BOX, LOADED, tmp_path, "cpu")
        saved = [await saver.save(STATE, "json") for _ in range(MAX_SAVED + 2)]
        assert [saver.find(one.number) for one in saved[2:]] == [one.path for one in saved[2:]]
        assert [saver.find(one.number) for one in saved[:2]] == [None, None]
        assert saver.find(0) is None
        assert len(list(tmp_path.iterdir())) == MAX_SAVED
        assert all(one.path.is_file() for one in saved[2:])

    asyncio.run(save())


def test_a_failed_save_leaves_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(module: str, arguments: list[str], **options: Any) -> str:
        raise OSError("disk full")

    monkeypatch.setattr(saving, "run_module_async", fail)
    with pytest.raises(OSError):
        asyncio.run(Saver(BOX, LOADED, tmp_path, "cpu").save(STATE, "png"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [OSError("disk full"), SceneError("bad", "scene", "expected better")])
def test_a_failed_save_is_reported_to_its_page(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    class Client:
        def __init__(self) -> None:
            self.replies: list[dict[str, Any]] = []

        def offer_message(self, message: object) -> None: ...

        async def reply(self, message: dict[str, Any]) -> None:
            self.replies.append(message)

    async def fail(*args: object) -> None:
        raise error

    async def save() -> None:
        session = Session(BOX, LOADED, STATE, Choices(("none",), ("final",), ("srgb",), {}), "cpu")
        session._loop = asyncio.get_running_loop()
        session._loop.set_exception_handler(lambda loop, context: None)
        monkeypatch.setattr(session._saver, "save", fail)
        client: Any = Client()
        for _ in range(2):
            client.replies.clear()
            session.handle(client, {"type": "save", "kind": "png"})
            await session._requests["save"]
            (reply,) = client.replies
            assert reply["type"] in ("error", "rejected") and str(error) in reply["message"]

    asyncio.run(save())
