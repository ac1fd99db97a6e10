"""One page's connection: the latest message of each kind, with one image in flight at a time."""

import asyncio
import json
from typing import Any

from app.view.state import Json


class Client:
    """Sends the latest messages as fast as the page accepts them; superseded messages are never sent.

    Parameters
    ----------
    socket : aiohttp.web.WebSocketResponse
        An open socket.
    """

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._messages: dict[str, str] = {}
        self._images: dict[str, bytes] = {}
        self._ready_for_image = True
        self._wake = asyncio.Event()

    def offer_message(self, message: Json) -> None:
        """Queue a JSON message, replacing an unsent one of the same type."""
        self._messages[message["type"]] = json.dumps(message)
        self._wake.set()

    def offer_image(self, kind: str, message: bytes) -> None:
        """Queue a binary image message, replacing an unsent one of the same kind."""
        self._images[kind] = message
        self._wake.set()

    def acknowledge(self) -> None:
        """Note that the page has received its last image, so that another can be sent."""
        self._ready_for_image = True
        self._wake.set()

    async def reply(self, message: Json) -> None:
        """Send an answer at once. This awaits the send, so slow clients apply backpressure to their own requests."""
        await self._socket.send_str(json.dumps(message))

    async def send_queued(self) -> None:
        """Send queued messages until cancelled."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._messages:
                await self._socket.send_str(self._messages.pop(next(iter(self._messages))))
            if self._ready_for_image and self._images:
                self._ready_for_image = False
                await self._socket.send_bytes(self._images.pop(next(iter(self._images))))
