"""All pages that look on: what they are told, and what they may change."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from app.bench.truth import Truth
from app.errors import AfterglowError, SettingsError
from app.load import Parts
from app.view.client import Client
from app.view.desk import Desk
from app.view.judge import Judge
from app.view.newest import Newest
from app.view.painter import Drawn, Painter
from app.view.pick import Picker
from app.view.protocol import CHANGES, Choices, changed
from app.view.saving import SETTLE, Saver
from app.view.scene_info import scene_info
from app.view.stage import Stage
from app.view.state import Json, State, state_json
from app.view.truth import Truths
from app.view.truth_picture import truth_picture

PATIENCE = 10.0  # seconds for the thread to finish its frame
LONGEST_LINE = 400


def one_line(error: Exception) -> str:
    """What went wrong, as a page shows it; of a long text its ends, which say what is wrong and what was expected."""
    text, half = " ".join(str(error).split()), LONGEST_LINE // 2
    return text if len(text) <= LONGEST_LINE else f"{text[:half - 1]}…{text[-half:]}"


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
        self._desk = Desk(state)
        self._folder = TemporaryDirectory(prefix="afterglow-view-")
        folder = Path(self._folder.name)
        self._painter = Painter(self._desk, Stage(file, parts, folder), provider, folder, self._deliver,
                                self._complain_from_thread)
        self._truths = Truths(file, parts, folder / "truth", self._tell_truth, self._complain)
        self._judge = Judge(lambda errors: self._tell({"type": "errors", "errors": errors}), self._complain)
        self._saver = Saver(file, parts, folder / "saved", provider)
        self._picker = Picker(parts)
        self._truth_pictures = Newest(self._show_truth, self._complain)
        self._errands: dict[str, asyncio.Task[None]] = {}
        self._newest: dict[str, bytes] = {}
        self._drawn: Drawn | None = None

    async def __aenter__(self) -> Session:
        self._loop = asyncio.get_running_loop()
        self._painter.start()
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None,
                        trace: TracebackType | None) -> None:
        self._desk.close()
        self._truths.stop()
        self._judge.stop()
        self._truth_pictures.stop()
        for errand in self._errands.values():
            errand.cancel()
        await asyncio.to_thread(self._painter.join, PATIENCE)
        self._folder.cleanup()

    @property
    def state(self) -> State:
        """The newest one."""
        return self._desk.state

    def join(self, client: Client) -> None:
        """One more page looks on."""
        self._clients.append(client)
        client.note({"type": "scene", **scene_info(self._file, self._parts, self.choices)})
        self._tell_roles()
        self._tell_state()
        for kind, message in self._newest.items():
            client.picture(kind, message)
        self._desk.watch(len(self._clients))
        self._truths.follow(self.state)

    def leave(self, client: Client) -> None:
        """It looks on no more; without any, drawing and tracing stop."""
        self._clients.remove(client)
        self._desk.watch(len(self._clients))
        self._tell_roles()
        if not self._clients:
            self._truths.stop()

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
            self._run_errand(client, kind, self._pick(message))
        elif kind == "save":
            self._run_errand(client, kind, self._save(message))
        elif client is not self._clients[0]:
            raise SettingsError("another page steers", kind, "expected a message of type steer first")
        else:
            assert kind in CHANGES
            self._desk.change(lambda state: changed(state, message, self.choices), int(message.get("input", 0)))
            self._truths.follow(self.state)
            if kind == "look" and self._truths.newest is not None:
                self._tell_truth(self._truths.newest)
            self._tell_state(but=client if kind != "bookmark" else None)

    def remind(self, client: Client) -> None:
        """Tell a page whose message was refused which state holds."""
        client.note({"type": "state", "state": state_json(self.state)})

    def file(self, number: int) -> Path | None:
        """What was saved under that number."""
        return self._saver.file(number)

    def _run_errand(self, client: Client, kind: str, work: Coroutine[None, None, Json]) -> None:
        """Begin what takes long and ends with a reply; one of each kind at a time."""
        if kind in self._errands and not self._errands[kind].done():
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

        self._errands[kind] = asyncio.create_task(run())

    async def _pick(self, message: Json) -> Json:
        found = await asyncio.to_thread(self._picker.pick, self.state, tuple(message["at"]))
        return {"type": "picked", "point": found and found.point, "object": found and found.object}

    async def _save(self, message: Json) -> Json:
        saved = await self._saver.save(self.state, message["kind"], int(message.get("settle", SETTLE)))
        return {"type": "saved", "kind": message["kind"], "number": saved.number, "name": saved.file.name,
                "command": saved.command}

    def _deliver(self, drawn: Drawn) -> None:
        """Of the painter's thread: hand a frame on, and wait until it is on its way."""
        if not self._loop.is_closed():
            asyncio.run_coroutine_threadsafe(self._show(drawn), self._loop).result()

    async def _show(self, drawn: Drawn) -> None:
        self._show_picture("frame", drawn.message)
        if drawn.report is not None:
            self._tell({"type": "stats", "pages": len(self._clients), **drawn.report})
        self._drawn = drawn
        self._offer_to_judge()
        await asyncio.sleep(0)  # the clients' own tasks send now

    def _offer_to_judge(self) -> None:
        """Have the newest frame judged, if it shows the newest state and there is a truth for that."""
        drawn, truth = self._drawn, self._truths.newest
        if drawn is not None and truth is not None and drawn.task.state.truth_key == self.state.truth_key:
            self._judge.offer(drawn.radiance, truth, drawn.task.repeat >= SETTLE)

    def _tell_truth(self, truth: Truth | None) -> None:
        if truth is None:
            self._newest.pop("truth", None)
            self._tell({"type": "truth", "spp": 0})
            return
        self._offer_to_judge()
        self._truth_pictures.offer((truth, self.state))

    async def _show_truth(self, asked: tuple[Truth, State]) -> None:
        message = await asyncio.to_thread(truth_picture, *asked)
        if self._truths.newest is asked[0]:
            self._show_picture("truth", message)

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

    def _complain_from_thread(self, error: Exception) -> None:
        self._loop.call_soon_threadsafe(self._complain, error)

    def _complain(self, error: Exception) -> None:
        """Tell all pages what went wrong, and which state holds now; what nobody foresaw is logged, too."""
        if not isinstance(error, AfterglowError):
            self._loop.call_exception_handler({"message": "the viewer goes on", "exception": error})
        self._tell({"type": "error", "message": one_line(error)})
        self._tell_state()
