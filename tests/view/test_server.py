"""The server: access, hostile messages, slow pages, and shutdown."""

from __future__ import annotations

import asyncio
import json
import random
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import aiohttp
import pytest

from app.view.encoder import unpack_message
from app.view.protocol import TYPES
from app.view.server import MAX_MESSAGE_BYTES
from tests.view.conftest import Viewer, run_viewer

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

HOSTILE_MESSAGES = 10_000
TIMEOUT_SECONDS = 60.0


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    with run_viewer("--model", "none", "--size", "64x48") as viewer:
        yield viewer


async def receive(socket: Any, *kinds: str) -> dict[str, Any]:
    """Return the next message of these types; acknowledge binary messages on the way."""
    while True:
        message = await socket.receive(timeout=TIMEOUT_SECONDS)
        if message.type == aiohttp.WSMsgType.BINARY:
            await socket.send_json({"type": "ack"})
            header, _ = unpack_message(message.data)
            if header["kind"] in kinds:
                return header
        elif message.type == aiohttp.WSMsgType.TEXT:
            content = json.loads(message.data)
            if content["type"] in kinds:
                return content
        else:
            raise AssertionError(f"the socket closed: {message}")


def run(coroutine: Any) -> Any:
    return asyncio.run(asyncio.wait_for(coroutine, 120))


async def get(url: str, **headers: str) -> tuple[int, str]:
    async with aiohttp.ClientSession() as session, session.get(url, headers=headers) as response:
        return response.status, await response.text(errors="replace")


def test_paths_outside_the_page_are_not_found(viewer: Viewer) -> None:
    async def ask() -> None:
        assert (await get(viewer.link))[0] == 200
        assert (await get(viewer.link + "page/main.js"))[0] == 200
        for path in ("page/../server.py", "page/..%2fserver.py", "page/%2e%2e/server.py", "page//etc/passwd", "page/",
                     "saved/0/x", "saved/../x", "saved/0/..%2f..%2fedited.json", "state.py", "saved/99999999/0000.png"):
            status, text = await get(viewer.link + path)
            assert status == 404, path
            assert "root:" not in text and "import" not in text
    run(ask())


def test_other_sites_and_host_names_are_rejected(viewer: Viewer) -> None:
    async def ask() -> None:
        assert (await get(viewer.link, Origin="http://evil.example"))[0] == 403
        assert (await get(viewer.link, Host="evil.example"))[0] == 403
        async with aiohttp.ClientSession() as session:
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await session.ws_connect(viewer.socket, origin="http://evil.example")
    run(ask())


def test_other_addresses_need_the_token() -> None:
    async def ask(viewer: Viewer) -> None:
        plain, token = viewer.link.split("?token=")
        plain = plain.replace("0.0.0.0", "127.0.0.1")
        assert len(token) >= 20
        assert (await get(f"{plain}?token={token}"))[0] == 200
        for wrong in ("", "?token=", f"?token={token[:-1]}", f"?token={token}x", "?token=%00"):
            status, text = await get(plain + wrong)
            assert status == 403 and text.startswith("error: link: wrong token (")
        async with aiohttp.ClientSession() as session:
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await session.ws_connect(plain.replace("http", "ws") + "live?token=x")
            async with session.ws_connect(plain.replace("http", "ws") + f"live?token={token}") as socket:
                await receive(socket, "frame")

    with run_viewer("--model", "none", "--size", "64x48", "--host", "0.0.0.0") as viewer:
        run(ask(viewer))


def hostile(rng: random.Random) -> str | bytes:
    """Return one of many kinds of invalid messages."""
    number = rng.choice(["NaN", "Infinity", "-1e999", "1e16", "null", '"x"', "[]", "{}", "-0", "1e-320", "true"])
    name = rng.choice(["../../etc/passwd", "..\\\\x", "/dev/zero", "\\u0000", "a" * rng.randrange(500), "%s%n", "${x}"])
    kind = rng.choice([*TYPES[1:], "eval", name])
    return rng.choice([
        lambda: rng.randbytes(rng.randrange(200)),
        lambda: rng.randbytes(rng.randrange(200)).decode("latin-1"),
        lambda: "[" * rng.randrange(5000),
        lambda: '{"a":' * rng.randrange(900) + "1" + "}" * rng.randrange(900),
        lambda: f'{{"type": "{kind}", "{name}": {number}}}',
        lambda: f'{{"type": "camera", "camera": {{"eye": [{number}, 0, 0], "target": [0, {number}, 1], "x": 1}}}}',
        lambda: f'{{"type": "camera", "camera": {{"eye": [0, 0, 0], "target": [0, 0, 0], "up": [0, {number}, 0]}}}}',
        lambda: f'{{"type": "lights", "lights": [{{"type": "{name}", "position": {number}}}]}}',
        lambda: f'{{"type": "settings", "model": "{name}", "exposure": {number}}}',
        lambda: f'{{"type": "move_object", "object": "{name}", "translate": [{number}, 0, 0]}}',
        lambda: f'{{"type": "size", "size": [{number}, 100000]}}',
        lambda: f'{{"type": "save", "kind": "{name}", "settle": {number}}}',
        lambda: f'{{"type": "save", "kind": "png", "file": "{name}"}}',
        lambda: f'{{"type": "pick", "position": [{number}, 2]}}',
        lambda: f'{{"type": "bookmark", "name": "\\u0007{name}"}}',
    ])()


def test_ten_thousand_hostile_messages_are_rejected_and_change_nothing(viewer: Viewer) -> None:
    async def attack() -> None:
        rng = random.Random(7)
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            before = (await receive(socket, "state"))["state"]
            for index in range(HOSTILE_MESSAGES):
                message = hostile(rng)
                await (socket.send_bytes(message) if isinstance(message, bytes) else socket.send_str(message))
                reason = (await receive(socket, "rejected"))["message"]
                assert ": " in reason and reason.endswith(")"), (index, message, reason)
                assert "\n" not in reason and len(reason) <= 400, (index, message, reason)
            await socket.send_json({"type": "settings", "exposure": 2.0, "input": 1})
            while (await receive(socket, "frame"))["input"] < 1:
                pass
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            after = (await receive(socket, "state"))["state"]
            assert after == {**before, "exposure": 2.0}
    run(attack())


def test_an_oversized_message_closes_only_its_own_connection(viewer: Viewer) -> None:
    async def attack() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as good:
            async with session.ws_connect(viewer.socket) as bad:
                await bad.send_str('{"type": "' + "x" * MAX_MESSAGE_BYTES + '"}')
                while not bad.closed:
                    await bad.receive(timeout=TIMEOUT_SECONDS)
                assert bad.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
            await good.send_json({"type": "settings", "exposure": 1.5, "input": 2})
            while (await receive(good, "frame"))["input"] < 2:
                pass
    run(attack())


def test_a_slow_page_receives_the_latest_frame(viewer: Viewer) -> None:
    async def watch() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            await receive(socket, "role")
            headers = []
            for index in range(4):
                message = await socket.receive(timeout=TIMEOUT_SECONDS)
                while message.type != aiohttp.WSMsgType.BINARY:
                    message = await socket.receive(timeout=TIMEOUT_SECONDS)
                headers.append(unpack_message(message.data)[0])
                await socket.send_json({"type": "settings", "exposure": 1.0 + index, "input": 10 + index})
                await asyncio.sleep(0.6)  # many frames are drawn meanwhile, but none is sent before the acknowledgement
                await socket.send_json({"type": "ack"})
            jumps = [b["number"] - a["number"] for a, b in pairwise(headers)]
            assert min(jumps) > 5
            assert [n["input"] for n in headers[1:]] == [10, 11, 12]
    run(watch())


def test_nothing_is_drawn_without_pages(viewer: Viewer) -> None:
    async def count() -> int:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            return (await receive(socket, "frame"))["number"]

    first = run(count())

    async def wait() -> None:
        await asyncio.sleep(1.0)

    run(wait())
    assert run(count()) - first < 60  # at a hundred frames a second it would be more


def test_ctrl_c_ends_the_viewer_while_frames_are_sent() -> None:
    async def look(viewer: Viewer) -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            await receive(socket, "frame")
            loop = asyncio.get_running_loop()
            ended = loop.run_in_executor(None, viewer.interrupt)
            while not socket.closed:
                await socket.receive(timeout=TIMEOUT_SECONDS)
            assert socket.close_code == aiohttp.WSCloseCode.GOING_AWAY
            assert "ended" in await ended

    with run_viewer("--model", "none", "--size", "64x48") as viewer:
        run(look(viewer))


@pytest.mark.usefixtures("path_tracer")
def test_the_reference_is_traced_compared_and_cached(viewer: Viewer) -> None:
    async def look() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            await socket.send_json({"type": "settings", "split": "reference", "exposure": 1.0})
            first = (await receive(socket, "reference"))["spp"]
            refined, errors = first, None  # their order depends on which is faster
            while refined == first or errors is None:
                message = await receive(socket, "reference", "errors")
                errors, refined = message.get("errors", errors), message.get("spp", refined)
            assert 8 <= first < refined <= 512
            assert len(errors) == 1
            assert 5 < errors[0]["psnr"] < 30 and 0.05 < errors[0]["rel_mse"] < 1  # no indirect light
            await socket.send_json({"type": "settings", "split": "", "exposure": 2.0, "input": 1})
            while (message := await receive(socket, "reference", "frame")).get("input", 0) < 1:
                refined = max(refined, message.get("spp", 0))
            await socket.send_json({"type": "settings", "split": "reference"})
            while not (cached := (await receive(socket, "reference"))["spp"]):
                pass
            assert cached >= refined  # a restarted reference would have 8
    run(look())
