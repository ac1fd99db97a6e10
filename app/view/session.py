"""All connected pages: what they receive, and what they may change."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from app.errors import AfterglowError, SettingsError
from app.evaluation.reference import Reference
from app.load import LoadedScene, parse_camera
from app.settings import SETTLE_FRAMES
from app.view.client import Client
from app.view.edited_scene import EditedScene
from app.view.encoder import encode_reference
from app.view.frame_scheduler import FrameScheduler
from app.view.latest_only import LatestOnly
from app.view.live_errors import LiveErrors
from app.view.pick import Picker
from app.view.progressive_reference import ReferenceTracer
from app.view.protocol import CHANGE_TYPES, Choices, apply_change, describe_scene
from app.view.render_thread import RenderedFrame, RenderThread
from app.view.saving import Saver
from app.view.state import REFERENCE, Json, State, state_to_json

JOIN_SECONDS = 10.0  # for the render thread to finish its frame
MAX_LINE_LENGTH = 400


def one_line(error: Exception) -> str:
    """Return an error as one line; a long one loses its middle, since its ends name the place and what was expected."""
    text, half = " ".join(str(error).split()), MAX_LINE_LENGTH // 2
    return text if len(text) <= MAX_LINE_LENGTH else f"{text[:half - 1]}…{text[-half:]}"


class Session:
    """One scene, one state and any number of pages, of which the first is in control; an asynchronous context manager.

    Parameters
    ----------
    file : Path
        The scene file.
    loaded : LoadedScene
        The scene as loaded from it.
    target_fps : float
        As in ``RenderThread``.
    """

    def __init__(self, file: Path, loaded: LoadedScene, state: State, choices: Choices, provider: str,
                 target_fps: float = 0.0) -> None:
        self._file, self._loaded, self._choices = file, loaded, choices
        self._clients: list[Client] = []
        self._scheduler = FrameScheduler(state)
        self._folder = TemporaryDirectory(prefix="afterglow-view-")
        folder = Path(self._folder.name)
        self._render_thread = RenderThread(self._scheduler, EditedScene(file, loaded, folder), provider,
                                           self._deliver, self._on_thread_error, target_fps)
        self._tracer = ReferenceTracer(file, loaded, folder / "reference", self._on_reference, self._on_error)
        self._errors = LiveErrors(lambda errors: self._broadcast({"type": "errors", "errors": errors}), self._on_error)
        self._saver = Saver(file, loaded, folder / "saved", provider)
        self._picker = Picker(loaded)
        self._reference_images = LatestOnly(self._show_reference, self._on_error)
        self._requests: dict[str, asyncio.Task[None]] = {}
        self._latest_images: dict[str, bytes] = {}
        self._latest_frame: RenderedFrame | None = None

    async def __aenter__(self) -> Session:
        self._loop = asyncio.get_running_loop()
        self._render_thread.start()
        return self

    async def __aexit__(self, *error: object) -> None:
        self._scheduler.close()
        self._tracer.stop()
        self._errors.stop()
        self._reference_images.stop()
        for request in self._requests.values():
            request.cancel()
        await asyncio.to_thread(self._render_thread.join, JOIN_SECONDS)
        self._folder.cleanup()

    @property
    def state(self) -> State:
        """The latest state."""
        return self._scheduler.state

    def join(self, client: Client) -> None:
        """Add a page."""
        self._clients.append(client)
        client.offer_message({"type": "scene", **describe_scene(self._file, self._loaded, self._choices)})
        self._broadcast_state()
        self._send_roles()  # last, since the page in control answers with the size of its window
        for kind, message in self._latest_images.items():
            client.offer_image(kind, message)
        self._scheduler.set_pages(len(self._clients))
        self._tracer.follow(self.state)

    def leave(self, client: Client) -> None:
        """Remove a page; without any, drawing and tracing stop."""
        self._clients.remove(client)
        self._scheduler.set_pages(len(self._clients))
        self._send_roles()
        if not self._clients:
            self._tracer.stop()

    def handle(self, client: Client, message: Json) -> None:
        """Process a message, or start a request that replies later.

        Raises
        ------
        AfterglowError
            When it is rejected.
        """
        kind = message["type"]
        if kind == "ack":
            client.acknowledge()
        elif kind == "take_control":
            self._clients.insert(0, self._clients.pop(self._clients.index(client)))
            self._send_roles()
        elif kind == "pick":
            self._start_request(client, message, self._pick(message))
        elif kind == "orbit":
            self._start_request(client, message, self._plan_orbit(message))
        elif kind == "save":
            self._start_request(client, message, self._save(message))
        elif client is not self._clients[0]:
            raise SettingsError("another page is in control", kind, "expected a message of type take_control first")
        else:
            assert kind in CHANGE_TYPES
            self._scheduler.update(lambda state: apply_change(state, message, self._choices),
                                   int(message.get("input", 0)))
            self._tracer.follow(self.state)
            if kind == "settings" and self._tracer.latest is not None:
                self._on_reference(self._tracer.latest)
            self._broadcast_state(but=client if kind != "bookmark" else None)

    def send_state(self, client: Client) -> None:
        """Send the current state to a page whose message was rejected."""
        client.offer_message({"type": "state", "state": state_to_json(self.state)})

    def find_saved(self, number: int) -> Path | None:
        """Return the file saved under ``number``, if it is still there."""
        return self._saver.find(number)

    def _start_request(self, client: Client, message: Json, work: Coroutine[None, None, Json]) -> None:
        """Run ``work`` in the background and send its reply; one request of each kind at a time."""
        kind = message["type"]
        if kind in self._requests and not self._requests[kind].done():
            work.close()
            raise SettingsError(f"another {kind} is running", kind, "expected one at a time")

        async def run() -> None:
            try:
                reply = await work
            except AfterglowError as error:
                reply = {"type": "rejected", "message": one_line(error)}
            except Exception as error:  # any error, those of the disk included: the page must not wait for ever
                reply = {"type": "error", "message": f"{kind} failed: {one_line(error)}"}
                self._loop.call_exception_handler({"message": f"{kind} failed", "exception": error})
            with suppress(ConnectionError):
                await client.reply({**reply, "ask": message.get("ask")})

        self._requests[kind] = asyncio.create_task(run())

    async def _pick(self, message: Json) -> Json:
        hit = await asyncio.to_thread(self._picker.pick, self._seen_by(message), tuple(message["position"]))
        return {"type": "picked", "point": hit and hit.point, "object": hit and hit.object}

    async def _plan_orbit(self, message: Json) -> Json:
        state, pivot = self._seen_by(message), message.get("pivot")
        if pivot is None:
            middle = await asyncio.to_thread(self._picker.pick, state, (0.5, 0.5))
            pivot = state.camera.target if middle is None else middle.point
        orbit = await asyncio.to_thread(self._picker.plan_orbit, state, pivot)
        return {"type": "orbit", "pivot": pivot, "orbit": orbit and asdict(orbit)}

    def _seen_by(self, message: Json) -> State:
        """The state with the camera of a message, which may be newer."""
        return replace(self.state, camera=parse_camera(message["camera"], "camera"))

    async def _save(self, message: Json) -> Json:
        saved = await self._saver.save(self.state, message["kind"], int(message.get("settle", SETTLE_FRAMES)))
        return {"type": "saved", "kind": message["kind"], "number": saved.number, "name": saved.path.name,
                "command": saved.command}

    def _deliver(self, frame: RenderedFrame) -> None:
        """Pass a frame from the render thread to the event loop and wait until it is being sent."""
        if not self._loop.is_closed():
            asyncio.run_coroutine_threadsafe(self._show_frame(frame), self._loop).result()

    async def _show_frame(self, frame: RenderedFrame) -> None:
        self._show_image("frame", frame.message)
        if frame.stats is not None:
            self._broadcast({"type": "stats", "pages": len(self._clients), **frame.stats})
        self._latest_frame = frame
        self._measure_errors()
        await asyncio.sleep(0)  # lets the clients' tasks send

    def _measure_errors(self) -> None:
        """Measure the latest frame, if it shows the current view and that has a reference."""
        frame, reference = self._latest_frame, self._tracer.latest
        if frame is not None and reference is not None and frame.task.state.reference_key == self.state.reference_key:
            self._errors.offer(frame.radiance, reference, settled=frame.task.repeat >= SETTLE_FRAMES)

    def _on_reference(self, reference: Reference | None) -> None:
        if reference is None:
            self._latest_images.pop(REFERENCE, None)
            self._broadcast({"type": "reference", "spp": 0})
            return
        self._measure_errors()
        self._reference_images.offer((reference, self.state))

    async def _show_reference(self, item: tuple[Reference, State]) -> None:
        message = await asyncio.to_thread(encode_reference, *item)
        if self._tracer.latest is item[0]:
            self._show_image(REFERENCE, message)

    def _show_image(self, kind: str, message: bytes) -> None:
        self._latest_images[kind] = message
        for client in self._clients:
            client.offer_image(kind, message)

    def _broadcast_state(self, but: Client | None = None) -> None:
        for client in self._clients:
            if client is not but:
                self.send_state(client)

    def _send_roles(self) -> None:
        for index, client in enumerate(self._clients):
            client.offer_message({"type": "role", "in_control": index == 0, "pages": len(self._clients)})

    def _broadcast(self, message: Json) -> None:
        for client in self._clients:
            client.offer_message(message)

    def _on_thread_error(self, error: Exception) -> None:
        self._loop.call_soon_threadsafe(self._on_error, error)

    def _on_error(self, error: Exception) -> None:
        """Send an error and the current state to all pages; an unexpected error is also logged."""
        if not isinstance(error, AfterglowError):
            self._loop.call_exception_handler({"message": "error in the viewer", "exception": error})
        self._broadcast({"type": "error", "message": one_line(error)})
        self._broadcast_state()
