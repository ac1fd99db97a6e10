"""The page in a real browser: what it shows follows what is done to it."""

from __future__ import annotations

import base64
import io
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from app.image import read_exr, read_png
from tests.view.conftest import ROOT, Viewer, running

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

WINDOW = {"width": 320 + 300, "height": 240}  # the panel takes 300
SETTLED = 10
PATIENCE = 20.0


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    with running("--model", "none", "--size", "320x240") as viewer:
        yield viewer


@pytest.fixture
def page(browser: Any, viewer: Viewer) -> Iterator[Any]:
    """The page with a settled picture of the scene as its files have it."""
    page = browser.new_page(viewport=WINDOW)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.goto(viewer.link)
    until(page, "window.afterglow?.state && afterglow.screen.header")
    page.evaluate("""() => { window.start ??= structuredClone(afterglow.state); }""")
    settle(page)
    yield page
    reset(page)
    until(page, "afterglow.idle")
    assert errors == []
    page.close()


def until(page: Any, expression: str, arg: Any = None) -> None:
    """Wait until JavaScript is true; Playwright's own way to wait is not allowed by the page's security policy."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(expression, arg):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(20)


def settle(page: Any, repeats: int = SETTLED) -> np.ndarray[Any, Any]:
    """Wait until the picture shows all that was done, some frames long; its pixels, float [H, W, 3], 0 to 255."""
    until(page, """repeats => {
        const {connection, screen} = afterglow, header = screen.header;
        return header && afterglow.idle && !connection.times.size && header.repeat >= repeats
               && String(header.size) === String(afterglow.state.size);
    }""", repeats)
    return pixels(page)


def pixels(page: Any, canvas: str = "left") -> np.ndarray[Any, Any]:
    url = page.evaluate("id => document.getElementById(id).toDataURL('image/png')", canvas)
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))).convert("RGB"), np.float64)


def change(page: Any, **message: Any) -> None:
    """What a control would send."""
    page.evaluate("message => afterglow.connection.change(message)", message)


def difference(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> float:
    return float(np.abs(a - b).mean())


def drag(page: Any, start: tuple[float, float], by: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + by[0], start[1] + by[1], steps=6)
    page.mouse.up()


def reset(page: Any) -> None:
    """The scene as its files have it."""
    page.evaluate("""() => {
        const {camera, lights, places} = start;
        for (const object in afterglow.state.places)
            afterglow.connection.change({type: 'place', object, translate: [0, 0, 0]});
        afterglow.connection.change({type: 'camera', camera});
        afterglow.connection.change({type: 'lights', lights});
        afterglow.connection.change({type: 'look', model: 'none', split: '', aov: 'final', exposure: 1, taa: true});
        afterglow.navigation.adopt(camera);
    }""")


def test_the_page_loads_and_frames_are_not_blank(page: Any) -> None:
    picture = settle(page)
    assert picture.shape == (240, 320, 3)
    assert picture.std() > 20 and picture.mean() > 20
    assert "Cornell" in page.title() or "cornell" in page.title()
    until(page, "document.getElementById('rate').textContent.includes('ms')")
    assert "llvmpipe" in page.inner_text("#device") or "GL" in page.inner_text("#device")


def test_an_orbit_drag_changes_the_picture(page: Any) -> None:
    before = settle(page)
    drag(page, (160, 120), (60, 10))
    after = settle(page)
    assert difference(before, after) > 8
    reset(page)
    assert difference(before, settle(page)) < 2  # and back again


def test_keys_wheel_and_touch_move_the_camera(page: Any) -> None:
    eye = "JSON.stringify(afterglow.navigation.camera.eye)"
    for act in (lambda: page.keyboard.press("w", delay=100), lambda: page.mouse.wheel(0, 200),
                lambda: page.keyboard.press("+")):
        before = page.evaluate(eye)
        page.mouse.move(160, 120)
        page.focus("#view")
        act()
        until(page, f"before => {eye} !== before", before)


def test_a_light_drag_moves_the_shadow(page: Any) -> None:
    reset(page)
    before = settle(page)
    handle = page.locator('#handles g[data-id="light-0"] .ring').bounding_box()
    at = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
    drag(page, at, (45, 20))
    after = settle(page)
    assert page.evaluate("afterglow.state.lights[0].position[0] > start.lights[0].position[0] + 0.2")
    floor = np.s_[190:235, 60:260]
    darker, brighter = (before - after)[floor].mean(axis=2), (after - before)[floor].mean(axis=2)
    assert (darker > 25).mean() > 0.02 and (brighter > 25).mean() > 0.02  # shadow came here, and left there


def test_a_model_switch_changes_indirect_light_but_not_direct(page: Any) -> None:
    shown = {}
    for model in ("none", "ssgi"):
        for aov in ("direct", "indirect"):
            page.select_option("#model", model)
            page.select_option("#aov", aov)
            shown[model, aov] = settle(page)
    assert difference(shown["none", "direct"], shown["ssgi", "direct"]) < 0.5
    assert shown["none", "indirect"].max() < 8  # black but for JPEG
    assert shown["ssgi", "indirect"].mean() > 20


def test_the_split_shows_two_models(page: Any) -> None:
    page.select_option("#split", "ssgi")
    left = settle(page)
    until(page, "!document.getElementById('right').hidden && document.getElementById('right').width === 320")
    right = pixels(page, "right")
    assert right.mean() > left.mean() + 3  # light that bounced
    assert page.inner_text("#label-right") == "ssgi"
    page.locator("#divider").focus()
    box = page.locator("#divider").bounding_box()
    drag(page, (box["x"] + box["width"] / 2, 60), (50, 0))
    assert page.evaluate("afterglow.screen.cut") == pytest.approx(0.66, abs=0.02)
    screenshot = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), np.float64)[:240, :320]
    inside = np.s_[100:200, 170:200]
    assert difference(screenshot[inside], left[inside]) < difference(screenshot[inside], right[inside])
    beyond = np.s_[100:200, 225:270]
    assert difference(screenshot[beyond], right[beyond]) < difference(screenshot[beyond], left[beyond])


def test_double_click_sets_the_pivot_and_chooses_the_object(page: Any) -> None:
    page.mouse.dblclick(110, 150)  # the tall block
    until(page, "document.getElementById('object').value !== ''")
    pivot = page.evaluate("afterglow.navigation.pivot")
    assert -1 < pivot[0] < 0 and 0 < pivot[1] < 1.5
    name = page.evaluate("document.getElementById('object').value")
    before = settle(page)
    box = page.locator('#handles g[data-id="object"] .ring').bounding_box()
    drag(page, (box["x"] + 9, box["y"] + 9), (40, 0))
    assert difference(before, settle(page)) > 3
    assert page.evaluate("name => afterglow.state.places[name][0] > 0.1", name)


def test_what_is_saved_is_drawn_again_to_the_bit(page: Any, tmp_path: Path) -> None:
    page.evaluate("""() => {
        const {connection, state} = afterglow, light = {...start.lights[0], position: [0.3, 1.5, 0.4], radius: 0.2};
        const object = document.getElementById('object').options[1].value;
        connection.change({type: 'place', object, translate: [0.1, 0.05, 0]});
        connection.change({type: 'lights', lights: [{...light, intensity: [1.5, 1, 2]}]});
        connection.change({type: 'camera', camera: {...start.camera, eye: [0.7, 1.3, 3.3]}});
        connection.change({type: 'look', exposure: 1.7});
    }""")
    live = settle(page, 3 * SETTLED)
    page.fill("#settle", "3")
    saved, commands = {}, {}
    for kind in ("json", "png", "exr"):
        with page.expect_download(timeout=1000 * PATIENCE) as download:
            page.click(f'[data-save="{kind}"]')
        saved[kind] = tmp_path / download.value.suggested_filename
        download.value.save_as(saved[kind])
        until(page, "format => document.getElementById('command').value.includes(`--format ${format} `)",
              "exr,png" if kind == "json" else kind)
        commands[kind] = shlex.split(page.input_value("#command"))
    assert commands["json"][:3] == ["python", "-m", "app"] and saved["json"].name in commands["json"]
    assert difference(read_png(saved["png"]).astype(float), live) < 3  # that is a JPEG with another history
    assert {"", "normal", "depth", "direct"} <= read_exr(saved["exr"]).keys()
    for kind in ("png", "exr"):
        subprocess.run([sys.executable, *commands[kind][1:], "--out", str(tmp_path / kind)], check=True, cwd=tmp_path,
                       env={**os.environ, "PYTHONPATH": str(ROOT)})
        assert (tmp_path / kind / f"0000.{kind}").read_bytes() == saved[kind].read_bytes()


def test_one_steers_several_watch_and_a_lost_connection_comes_back(page: Any, browser: Any, viewer: Viewer) -> None:
    other = browser.new_page(viewport=WINDOW)
    other.goto(viewer.link)
    until(other, "window.afterglow?.state && afterglow.screen.header")
    assert other.is_visible("#steer") and not page.is_visible("#steer")
    other.evaluate("afterglow.connection.change({type: 'look', exposure: 3})")
    other.wait_for_selector("#toast:not([hidden])")
    assert "another page steers" in other.inner_text("#toast")
    other.click("#steer")
    page.wait_for_selector("#steer:not([hidden])")
    page.evaluate("afterglow.connection.socket.close()")
    until(page, "afterglow.connection.open")
    other.close()
    page.wait_for_selector("#steer", state="hidden")
    drag(page, (160, 120), (30, 0))
    settle(page)
    reset(page)
