"""One page's connection: the newest of everything, one frame under way at a time."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from app.view.state import Json


class Client:
    """Sends what it is offered, as fast as the page takes it; what is overtaken is never sent.

    Parameters
    ----------
    socket : aiohttp.web.WebSocketResponse
        Open.
    """

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._notes: dict[str, str] = {}
        self._pictures: dict[str, bytes] = {}
        self._ready = True
        self._wake = asyncio.Event()

    def note(self, message: Json) -> None:
        """Offer a JSON message, in place of one of the same type that has not been sent."""
        self._notes[message["type"]] = json.dumps(message)
        self._wake.set()

    def picture(self, kind: str, message: bytes) -> None:
        """Offer a binary message, in place of one of the same kind that has not been sent."""
        self._pictures[kind] = message
        self._wake.set()

    def acknowledge(self) -> None:
        """The page has what it was sent last, and takes another picture."""
        self._ready = True
        self._wake.set()

    async def reply(self, message: Json) -> None:
        """Send an answer; who does not read answers is not listened to."""
        await self._socket.send_str(json.dumps(message))

    async def send(self) -> None:
        """Send until cancelled."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._notes:
                await self._socket.send_str(self._notes.pop(next(iter(self._notes))))
            if self._ready and self._pictures:
                self._ready = False
                await self._socket.send_bytes(self._pictures.pop(next(iter(self._pictures))))
