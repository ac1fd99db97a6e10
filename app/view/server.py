"""HTTP: the page, its socket, and the files that were saved."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import secrets
import signal
from collections.abc import Callable
from importlib import resources
from ipaddress import ip_address
from typing import Any

from app.errors import AfterglowError, DeviceError
from app.extras import extra_module
from app.view.client import Client
from app.view.protocol import read_message
from app.view.session import Session, one_line

EXTRA = "view"
MAX_MESSAGE = 2**18  # bytes; 512 lights are fewer
HEARTBEAT = 15.0         # seconds
TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
}


def is_local(host: str) -> bool:
    """Whether an address is reached from this machine alone."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _host(request: Any) -> str:
    """The name that a request calls this machine by; nothing where that makes no sense."""
    try:
        return request.url.host or ""
    except ValueError:
        return ""


def new_token(host: str) -> str:
    """What the link to the page must hold; nothing where only this machine reaches it."""
    return "" if is_local(host) else secrets.token_urlsafe(16)


class Server:
    """Answers requests; who asks without the token, or from another site's page, is refused."""

    def __init__(self, session: Session, token: str) -> None:
        self._web = extra_module("aiohttp.web", EXTRA)
        self._session, self._token = session, token
        folder = resources.files("app.view") / "page"
        self._page = {file.name: file.read_bytes() for file in folder.iterdir() if file.name.split(".")[-1] in TYPES}
        self._sockets: set[Any] = set()

    def application(self) -> Any:
        """The aiohttp application."""
        async def guard(request: Any, handler: Callable[[Any], Any]) -> Any:
            return await self._guard(request, handler)

        app = self._web.Application(middlewares=[self._web.middleware(guard)])
        app.router.add_get("/", self._index)
        app.router.add_get("/page/{name}", self._static)
        app.router.add_get("/live", self._live)
        app.router.add_get("/saved/{number:[0-9]{1,6}}/{name}", self._saved)
        app.on_shutdown.append(self._close_sockets)
        return app

    async def _guard(self, request: Any, handler: Callable[[Any], Any]) -> Any:
        """Refuse what comes from elsewhere: by the token, or on this machine by the names it is called by."""
        if self._token:
            given = request.query.get("token", "")
            if not request.path.startswith("/page/") and not hmac.compare_digest(given.encode(), self._token.encode()):
                return self._refused("wrong token, the link, expected the one that was printed")
        elif not is_local(_host(request)):
            return self._refused("another host name, the request, expected that of the printed link")
        origin = request.headers.get("Origin")
        if origin is not None and origin.split("://")[-1] != request.host:
            return self._refused("another site's page, the request, expected the page of this server")
        try:
            response = await handler(request)
        except self._web.HTTPException as error:
            response = self._web.Response(status=error.status, text=error.reason)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _refused(self, reason: str) -> Any:
        return self._web.Response(status=403, text=f"error: {reason}\n", headers=HEADERS)

    async def _index(self, request: Any) -> Any:
        return self._web.Response(body=self._page["index.html"], content_type=TYPES["html"], charset="utf-8")

    async def _static(self, request: Any) -> Any:
        name = request.match_info["name"]
        if name not in self._page:
            raise self._web.HTTPNotFound
        return self._web.Response(body=self._page[name], content_type=TYPES[name.split(".")[-1]], charset="utf-8")

    async def _saved(self, request: Any) -> Any:
        file = self._session.file(int(request.match_info["number"]))
        if file is None or file.name != request.match_info["name"]:
            raise self._web.HTTPNotFound
        name = file.name.replace("0000", "afterglow")
        return self._web.Response(body=await asyncio.to_thread(file.read_bytes),
                                  headers={"Content-Disposition": f'attachment; filename="{name}"'})

    async def _live(self, request: Any) -> Any:
        socket = self._web.WebSocketResponse(heartbeat=HEARTBEAT, max_msg_size=MAX_MESSAGE, compress=False)
        await socket.prepare(request)
        client = Client(socket)
        self._sockets.add(socket)
        self._session.join(client)
        sending = asyncio.create_task(client.send())
        try:
            async for message in socket:
                await self._answer(client, message)
        finally:
            sending.cancel()
            self._session.leave(client)
            self._sockets.discard(socket)
        return socket

    async def _answer(self, client: Client, message: Any) -> None:
        """Do what a message says, or say what is wrong with it."""
        try:
            if not isinstance(message.data, str):
                raise DeviceError("a binary message", "message", "expected JSON text")
            self._session.handle(client, read_message(message.data))
        except (AfterglowError, RecursionError) as error:
            self._session.remind(client)
            with contextlib.suppress(ConnectionError):
                await client.reply({"type": "refused", "message": one_line(error)})

    async def _close_sockets(self, app: Any) -> None:
        for socket in list(self._sockets):
            await socket.close(code=1001, message=b"the viewer has ended")


async def serve(session: Session, host: str, port: int, started: Callable[[str], object]) -> None:
    """Serve until the process is asked to end.

    Parameters
    ----------
    port : int
        0 lets the system choose.
    started : callable
        Takes the link.

    Raises
    ------
    DeviceError
        When the address can't be had.
    """
    token = new_token(host)
    async with session:
        web = extra_module("aiohttp.web", EXTRA)
        runner = web.AppRunner(Server(session, token).application(), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            site = web.TCPSite(runner, host, port)
            try:
                await site.start()
            except OSError as error:
                raise DeviceError(f"can't listen ({error.strerror or error})", f"{host}:{port}",
                                  "expected an address of this machine and a free port") from None
            bound = runner.addresses[0]
            name = f"[{bound[0]}]" if ":" in bound[0] else bound[0]
            started(f"http://{name}:{bound[1]}/" + (f"?token={token}" if token else ""))
            await _asked_to_end()
        finally:
            await runner.cleanup()


async def _asked_to_end() -> None:
    """Wait for Ctrl-C, or a request to terminate."""
    end = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, end.set)
    await end.wait()
