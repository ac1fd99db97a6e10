"""HTTP: the page, its WebSocket, and downloads of saved files."""

import asyncio
import contextlib
import hmac
import secrets
import signal
from collections.abc import Callable
from importlib import resources
from ipaddress import ip_address
from typing import Any

from app.errors import AfterglowError, DeviceError, SettingsError
from app.extras import extra_module
from app.view.client import Client
from app.view.protocol import read_message
from app.view.session import Session, one_line

EXTRA = "view"
MAX_MESSAGE_BYTES = 2**18  # enough for 512 lights
HEARTBEAT_SECONDS = 15.0
SHUTDOWN_SECONDS = 1.0
CONTENT_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
}


def is_local(host: str) -> bool:
    """Return whether an address is reachable from this machine only."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


class Server:
    """Answers requests; rejects those without the token or from other sites' pages."""

    def __init__(self, session: Session, token: str) -> None:
        self._web = extra_module("aiohttp.web", EXTRA)
        self._session, self._token = session, token
        folder = resources.files("app.view") / "page"
        self._page = {file.name: file.read_bytes() for file in folder.iterdir()
                      if file.name.split(".")[-1] in CONTENT_TYPES}
        self._sockets: set[Any] = set()

    def build_application(self) -> Any:
        """Return the aiohttp application."""
        async def guard(request: Any, handler: Callable[[Any], Any]) -> Any:
            return await self._guard(request, handler)

        app = self._web.Application(middlewares=[self._web.middleware(guard)])
        app.router.add_get("/", self._get_page_file)
        app.router.add_get("/page/{name}", self._get_page_file)
        app.router.add_get("/live", self._open_socket)
        app.router.add_get("/saved/{number:[0-9]{1,6}}/{name}", self._get_saved_file)
        app.on_shutdown.append(self._close_sockets)
        return app

    async def _guard(self, request: Any, handler: Callable[[Any], Any]) -> Any:
        """Reject foreign requests: by the token if there is one, otherwise by the host name; and by the origin."""
        if self._token:
            given = request.query.get("token", "")
            if not request.path.startswith("/page/") and not hmac.compare_digest(given.encode(), self._token.encode()):
                return self._forbid("link: wrong token (expected the printed link)")
        elif not is_local(_host_name(request)):
            return self._forbid("request: unknown host name (expected the printed link)")
        origin = request.headers.get("Origin")
        if origin is not None and origin.split("://")[-1] != request.host:
            return self._forbid("request: sent by another site's page (expected this server's page)")
        try:
            response = await handler(request)
        except self._web.HTTPException as error:
            response = self._web.Response(status=error.status, text=error.reason)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _forbid(self, reason: str) -> Any:
        return self._web.Response(status=403, text=f"error: {reason}\n", headers=HEADERS)

    async def _get_page_file(self, request: Any) -> Any:
        name = request.match_info.get("name", "index.html")
        if name not in self._page:
            raise self._web.HTTPNotFound
        content_type = CONTENT_TYPES[name.split(".")[-1]]
        return self._web.Response(body=self._page[name], content_type=content_type, charset="utf-8")

    async def _get_saved_file(self, request: Any) -> Any:
        file = self._session.find_saved(int(request.match_info["number"]))
        if file is None or file.name != request.match_info["name"]:
            raise self._web.HTTPNotFound
        name = file.name.replace("0000", "afterglow")
        return self._web.Response(body=await asyncio.to_thread(file.read_bytes),
                                  headers={"Content-Disposition": f'attachment; filename="{name}"'})

    async def _open_socket(self, request: Any) -> Any:
        socket = self._web.WebSocketResponse(
            heartbeat=HEARTBEAT_SECONDS, max_msg_size=MAX_MESSAGE_BYTES, compress=False)
        await socket.prepare(request)
        client = Client(socket)
        self._sockets.add(socket)
        self._session.join(client)
        sending = asyncio.create_task(client.send_queued())
        try:
            async for message in socket:
                await self._handle(client, message)
        finally:
            sending.cancel()
            self._session.leave(client)
            self._sockets.discard(socket)
        return socket

    async def _handle(self, client: Client, message: Any) -> None:
        """Process a message, or reply why it is rejected."""
        try:
            if not isinstance(message.data, str):
                raise SettingsError("binary data", "message", "expected JSON text")
            self._session.handle(client, read_message(message.data))
        except (AfterglowError, RecursionError) as error:
            self._session.send_state(client)
            with contextlib.suppress(ConnectionError):
                await client.reply({"type": "rejected", "message": one_line(error)})

    async def _close_sockets(self, app: Any) -> None:
        for socket in list(self._sockets):
            await socket.close(code=1001, message=b"the viewer has ended")


async def serve(session: Session, host: str, port: int, on_start: Callable[[str], object]) -> None:
    """Serve until the process receives SIGINT or SIGTERM.

    Parameters
    ----------
    port : int
        0 lets the system choose one.
    on_start : callable
        Receives the link to the page.

    Raises
    ------
    DeviceError
        When the address is not available.
    """
    token = "" if is_local(host) else secrets.token_urlsafe(16)
    async with session:
        web = extra_module("aiohttp.web", EXTRA)
        runner = web.AppRunner(Server(session, token).build_application(), access_log=None,
                               shutdown_timeout=SHUTDOWN_SECONDS)
        await runner.setup()
        try:
            site = web.TCPSite(runner, host, port)
            try:
                await site.start()
            except OSError as error:
                raise DeviceError(f"can't listen, {error.strerror or error}", f"{host}:{port}",
                                  "expected an address of this machine and a free port") from None
            address = runner.addresses[0]
            name = f"[{address[0]}]" if ":" in address[0] else address[0]
            on_start(f"http://{name}:{address[1]}/" + (f"?token={token}" if token else ""))
            await _wait_for_signal()
        finally:
            await runner.cleanup()


def _host_name(request: Any) -> str:
    """Return the host name that a request uses for this machine; empty if it is malformed."""
    try:
        return request.url.host or ""
    except ValueError:
        return ""


async def _wait_for_signal() -> None:
    signalled = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, signalled.set)
    await signalled.wait()
