"""All pages that look on: what they are told, and what they may change."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from app.errors import AfterglowError, SettingsError
from app.evaluation.reference import Reference
from app.load import Parts
from app.view.client import Client
from app.view.edited_scene import EditedScene
from app.view.frame_scheduler import FrameScheduler
from app.view.latest_only import LatestOnly
from app.view.live_errors import LiveErrors
from app.view.pick import Picker
from app.view.progressive_reference import ReferenceTracer
from app.view.protocol import CHANGES, Choices, changed
from app.view.reference_picture import reference_picture
from app.view.render_thread import RenderedFrame, RenderThread
from app.view.saving import SETTLE, Saver
from app.view.scene_info import scene_info
from app.view.state import Json, State, state_json

PATIENCE = 10.0  # seconds for the thread to finish its frame
MAX_LINE = 400


def one_line(error: Exception) -> str:
    """What went wrong, as a page shows it; of a long text its ends, which say what is wrong and what was expected."""
    text, half = " ".join(str(error).split()), MAX_LINE // 2
    return text if len(text) <= MAX_LINE else f"{text[:half - 1]}…{text[-half:]}"


class Session:
    """One scene, one state, any number of pages of which the first steers; an asynchronous context manager.

    Parameters
    ----------
    file : Path
        The scene's file.
    parts : Parts
        What the loader made of it.
    """

    def __init__(self, file: Path, parts: Parts, state: State, choices: Choices, provider: str) -> None:
        self.choices, self._file, self._parts, self._provider = choices, file, parts, provider
        self._clients: list[Client] = []
        self._scheduler = FrameScheduler(state)
        self._folder = TemporaryDirectory(prefix="afterglow-view-")
        folder = Path(self._folder.name)
        self._render_thread = RenderThread(self._scheduler, EditedScene(file, parts, folder), provider, folder, self._deliver,
                                self._on_thread_error)
        self._references = ReferenceTracer(file, parts, folder / "reference", self._tell_reference, self._on_error)
        self._judge = LiveErrors(lambda errors: self._tell({"type": "errors", "errors": errors}), self._on_error)
        self._saver = Saver(file, parts, folder / "saved", provider)
        self._picker = Picker(parts)
        self._reference_pictures = LatestOnly(self._show_reference, self._on_error)
        self._requests: dict[str, asyncio.Task[None]] = {}
        self._newest: dict[str, bytes] = {}
        self._drawn: RenderedFrame | None = None

    async def __aenter__(self) -> Session:
        self._loop = asyncio.get_running_loop()
        self._render_thread.start()
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None,
                        trace: TracebackType | None) -> None:
        self._scheduler.close()
        self._references.stop()
        self._judge.stop()
        self._reference_pictures.stop()
        for request in self._requests.values():
            request.cancel()
        await asyncio.to_thread(self._render_thread.join, PATIENCE)
        self._folder.cleanup()

    @property
    def state(self) -> State:
        """The newest one."""
        return self._scheduler.state

    def join(self, client: Client) -> None:
        """One more page looks on."""
        self._clients.append(client)
        client.note({"type": "scene", **scene_info(self._file, self._parts, self.choices)})
        self._tell_roles()
        self._tell_state()
        for kind, message in self._newest.items():
            client.picture(kind, message)
        self._scheduler.watch(len(self._clients))
        self._references.follow(self.state)

    def leave(self, client: Client) -> None:
        """It looks on no more; without any, drawing and tracing stop."""
        self._clients.remove(client)
        self._scheduler.watch(len(self._clients))
        self._tell_roles()
        if not self._clients:
            self._references.stop()

    def handle(self, client: Client, message: Json) -> None:
        """Do what a page asks for, or begin to.

        Raises
        ------
        AfterglowError
            When it can't be done.
        """
        kind = message["type"]
        if kind == "ack":
            client.acknowledge()
        elif kind == "steer":
            self._clients.insert(0, self._clients.pop(self._clients.index(client)))
            self._tell_roles()
        elif kind == "pick":
            self._start_request(client, kind, self._pick(message))
        elif kind == "save":
            self._start_request(client, kind, self._save(message))
        elif client is not self._clients[0]:
            raise SettingsError("another page steers", kind, "expected a message of type steer first")
        else:
            assert kind in CHANGES
            self._scheduler.change(lambda state: changed(state, message, self.choices), int(message.get("input", 0)))
            self._references.follow(self.state)
            if kind == "look" and self._references.newest is not None:
                self._tell_reference(self._references.newest)
            self._tell_state(but=client if kind != "bookmark" else None)

    def remind(self, client: Client) -> None:
        """Tell a page whose message was refused which state holds."""
        client.note({"type": "state", "state": state_json(self.state)})

    def file(self, number: int) -> Path | None:
        """What was saved under that number."""
        return self._saver.file(number)

    def _start_request(self, client: Client, kind: str, work: Coroutine[None, None, Json]) -> None:
        """Begin what takes long and ends with a reply; one of each kind at a time."""
        if kind in self._requests and not self._requests[kind].done():
            work.close()
            raise SettingsError(f"another {kind} is under way", kind, "expected one at a time")

        async def run() -> None:
            try:
                reply = await work
            except AfterglowError as error:
                reply = {"type": "refused", "message": one_line(error)}
            except Exception as error:  # of the disk, too: whoever asked is told instead of waiting for ever
                reply = {"type": "error", "message": f"{kind} failed: {one_line(error)}"}
                self._loop.call_exception_handler({"message": f"{kind} failed", "exception": error})
            with suppress(ConnectionError):
                await client.reply(reply)

        self._requests[kind] = asyncio.create_task(run())

    async def _pick(self, message: Json) -> Json:
        found = await asyncio.to_thread(self._picker.pick, self.state, tuple(message["at"]))
        return {"type": "picked", "point": found and found.point, "object": found and found.object}

    async def _save(self, message: Json) -> Json:
        saved = await self._saver.save(self.state, message["kind"], int(message.get("settle", SETTLE)))
        return {"type": "saved", "kind": message["kind"], "number": saved.number, "name": saved.file.name,
                "command": saved.command}

    def _deliver(self, drawn: RenderedFrame) -> None:
        """Of the render_thread's thread: hand a frame on, and wait until it is on its way."""
        if not self._loop.is_closed():
            asyncio.run_coroutine_threadsafe(self._show(drawn), self._loop).result()

    async def _show(self, drawn: RenderedFrame) -> None:
        self._show_picture("frame", drawn.message)
        if drawn.report is not None:
            self._tell({"type": "stats", "pages": len(self._clients), **drawn.report})
        self._drawn = drawn
        self._offer_to_judge()
        await asyncio.sleep(0)  # the clients' own tasks send now

    def _offer_to_judge(self) -> None:
        """Have the newest frame judged, if it shows the newest state and there is a reference for that."""
        drawn, reference = self._drawn, self._references.newest
        if drawn is not None and reference is not None and drawn.task.state.reference_key == self.state.reference_key:
            self._judge.offer(drawn.radiance, reference, drawn.task.repeat >= SETTLE)

    def _tell_reference(self, reference: Reference | None) -> None:
        if reference is None:
            self._newest.pop("reference", None)
            self._tell({"type": "reference", "spp": 0})
            return
        self._offer_to_judge()
        self._reference_pictures.offer((reference, self.state))

    async def _show_reference(self, asked: tuple[Reference, State]) -> None:
        message = await asyncio.to_thread(reference_picture, *asked)
        if self._references.newest is asked[0]:
            self._show_picture("reference", message)

    def _show_picture(self, kind: str, message: bytes) -> None:
        self._newest[kind] = message
        for client in self._clients:
            client.picture(kind, message)

    def _tell_state(self, but: Client | None = None) -> None:
        for client in self._clients:
            if client is not but:
                client.note({"type": "state", "state": state_json(self.state)})

    def _tell_roles(self) -> None:
        for index, client in enumerate(self._clients):
            client.note({"type": "role", "steers": index == 0, "pages": len(self._clients)})

    def _tell(self, message: Json) -> None:
        for client in self._clients:
            client.note(message)

    def _on_thread_error(self, error: Exception) -> None:
        self._loop.call_soon_threadsafe(self._on_error, error)

    def _on_error(self, error: Exception) -> None:
        """Tell all pages what went wrong, and which state holds now; what nobody foresaw is logged, too."""
        if not isinstance(error, AfterglowError):
            self._loop.call_exception_handler({"message": "the viewer goes on", "exception": error})
        self._tell({"type": "error", "message": one_line(error)})
        self._tell_state()
