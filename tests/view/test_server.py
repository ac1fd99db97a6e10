"""The server: who gets in, what is refused, who steers, and what is left when it ends."""

from __future__ import annotations

import asyncio
import json
import random
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import aiohttp
import pytest

from app.view.encoder import unpacked
from app.view.server import MAX_MESSAGE
from tests.view.conftest import Viewer, running

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

HOSTILE = 10_000
PATIENCE = 60.0


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    with running("--model", "none", "--size", "64x48") as viewer:
        yield viewer


async def until(socket: Any, *kinds: str) -> dict[str, Any]:
    """The next message of these types; pictures on the way are acknowledged."""
    while True:
        message = await socket.receive(timeout=PATIENCE)
        if message.type == aiohttp.WSMsgType.BINARY:
            await socket.send_json({"type": "ack"})
            header, _ = unpacked(message.data)
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


def test_paths_that_are_no_part_of_the_page_are_not_found(viewer: Viewer) -> None:
    async def ask() -> None:
        assert (await get(viewer.link))[0] == 200
        assert (await get(viewer.link + "page/main.js"))[0] == 200
        for path in ("page/../server.py", "page/..%2fserver.py", "page/%2e%2e/server.py", "page//etc/passwd", "page/",
                     "saved/0/x", "saved/../x", "saved/0/..%2f..%2fstage.json", "state.py", "saved/99999999/0000.png"):
            status, text = await get(viewer.link + path)
            assert status == 404, path
            assert "root:" not in text and "import" not in text
    run(ask())


def test_other_sites_and_names_are_refused(viewer: Viewer) -> None:
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
            assert status == 403 and text.startswith("error: wrong token, ")
        async with aiohttp.ClientSession() as session:
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await session.ws_connect(plain.replace("http", "ws") + "live?token=x")
            async with session.ws_connect(plain.replace("http", "ws") + f"live?token={token}") as socket:
                await until(socket, "frame")

    with running("--model", "none", "--size", "64x48", "--host", "0.0.0.0") as viewer:
        run(ask(viewer))


def hostile(rng: random.Random) -> str | bytes:
    """One of many kinds of nonsense."""
    number = rng.choice(["NaN", "Infinity", "-1e999", "1e16", "null", '"x"', "[]", "{}", "-0", "1e-320", "true"])
    name = rng.choice(["../../etc/passwd", "..\\\\x", "/dev/zero", "\\u0000", "a" * rng.randrange(500), "%s%n", "${x}"])
    kind = rng.choice(["camera", "lights", "look", "place", "size", "pick", "save", "bookmark", "steer", "eval", name])
    return rng.choice([
        lambda: rng.randbytes(rng.randrange(200)),
        lambda: rng.randbytes(rng.randrange(200)).decode("latin-1"),
        lambda: "[" * rng.randrange(5000),
        lambda: '{"a":' * rng.randrange(900) + "1" + "}" * rng.randrange(900),
        lambda: f'{{"type": "{kind}", "{name}": {number}}}',
        lambda: f'{{"type": "camera", "camera": {{"eye": [{number}, 0, 0], "target": [0, {number}, 1], "x": 1}}}}',
        lambda: f'{{"type": "camera", "camera": {{"eye": [0, 0, 0], "target": [0, 0, 0], "up": [0, {number}, 0]}}}}',
        lambda: f'{{"type": "lights", "lights": [{{"type": "{name}", "position": {number}}}]}}',
        lambda: f'{{"type": "look", "model": "{name}", "exposure": {number}}}',
        lambda: f'{{"type": "place", "object": "{name}", "translate": [{number}, 0, 0]}}',
        lambda: f'{{"type": "size", "size": [{number}, 100000]}}',
        lambda: f'{{"type": "save", "kind": "{name}", "settle": {number}}}',
        lambda: f'{{"type": "save", "kind": "png", "file": "{name}"}}',
        lambda: f'{{"type": "pick", "at": [{number}, 2]}}',
        lambda: f'{{"type": "bookmark", "name": "\\u0007{name}"}}',
    ])()


def test_ten_thousand_hostile_messages_are_refused_and_the_server_goes_on(viewer: Viewer) -> None:
    async def attack() -> None:
        rng = random.Random(7)
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            before = (await until(socket, "state"))["state"]
            for index in range(HOSTILE):
                message = hostile(rng)
                await (socket.send_bytes(message) if isinstance(message, bytes) else socket.send_str(message))
                refused = (await until(socket, "refused"))["message"]
                assert ", " in refused and "\n" not in refused and len(refused) <= 400, (index, message, refused)
            await socket.send_json({"type": "look", "exposure": 2.0, "input": 1})
            while (await until(socket, "frame"))["input"] < 1:
                pass
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            after = (await until(socket, "state"))["state"]
            assert after == {**before, "exposure": 2.0}
    run(attack())


def test_an_oversized_message_ends_that_connection_alone(viewer: Viewer) -> None:
    async def attack() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as good:
            async with session.ws_connect(viewer.socket) as bad:
                await bad.send_str('{"type": "' + "x" * MAX_MESSAGE + '"}')
                while not bad.closed:
                    await bad.receive(timeout=PATIENCE)
                assert bad.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
            await good.send_json({"type": "look", "exposure": 1.5, "input": 2})
            while (await until(good, "frame"))["input"] < 2:
                pass
    run(attack())


def test_a_slow_page_gets_the_newest_frame(viewer: Viewer) -> None:
    async def watch() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            await until(socket, "role")
            numbers = []
            for index in range(4):
                message = await socket.receive(timeout=PATIENCE)
                while message.type != aiohttp.WSMsgType.BINARY:
                    message = await socket.receive(timeout=PATIENCE)
                numbers.append(unpacked(message.data)[0])
                await socket.send_json({"type": "look", "exposure": 1.0 + index, "input": 10 + index})
                await asyncio.sleep(0.6)  # many frames are drawn meanwhile, none of which is under way
                await socket.send_json({"type": "ack"})
            jumps = [b["number"] - a["number"] for a, b in pairwise(numbers)]
            assert min(jumps) > 5
            assert [n["input"] for n in numbers[1:]] == [10, 11, 12]
    run(watch())


def test_without_pages_nothing_is_drawn(viewer: Viewer) -> None:
    async def count() -> int:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            return (await until(socket, "frame"))["number"]

    first = run(count())

    async def wait() -> None:
        await asyncio.sleep(1.0)

    run(wait())
    assert run(count()) - first < 60  # at a hundred frames a second it would be more


def test_ctrl_c_ends_it_while_frames_are_on_their_way() -> None:
    async def look(viewer: Viewer) -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            await until(socket, "frame")
            loop = asyncio.get_running_loop()
            ended = loop.run_in_executor(None, viewer.end)
            while not socket.closed:
                await socket.receive(timeout=PATIENCE)
            assert socket.close_code == aiohttp.WSCloseCode.GOING_AWAY
            assert "ended" in await ended

    with running("--model", "none", "--size", "64x48") as viewer:
        run(look(viewer))


@pytest.mark.usefixtures("path_tracer")
def test_the_reference_is_traced_judged_and_kept(viewer: Viewer) -> None:
    async def look() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(viewer.socket) as socket:
            await socket.send_json({"type": "look", "split": "reference", "exposure": 1.0})
            first = (await until(socket, "reference"))["spp"]
            refined, errors = first, None  # which come, and in which order, depends on how fast each is
            while refined == first or errors is None:
                message = await until(socket, "reference", "errors")
                errors, refined = message.get("errors", errors), message.get("spp", refined)
            assert 8 <= first < refined <= 512
            assert len(errors) == 1
            assert 5 < errors[0]["psnr"] < 30 and 0.05 < errors[0]["rel_mse"] < 1  # no indirect light
            await socket.send_json({"type": "look", "split": "", "exposure": 2.0, "input": 1})
            while (message := await until(socket, "reference", "frame")).get("input", 0) < 1:
                refined = max(refined, message.get("spp", 0))
            await socket.send_json({"type": "look", "split": "reference"})
            while not (kept := (await until(socket, "reference"))["spp"]):
                pass
            assert kept >= refined  # begun again it would have 8
    run(look())
