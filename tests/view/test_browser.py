"""The page in a real browser: its image follows the user's input."""

from __future__ import annotations

import base64
import io
import json
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
import trimesh
from PIL import Image

from app.io.image import read_exr, read_png
from tests.unit.load_helpers import Gltf
from tests.unit.test_load_animation import animate
from tests.view.conftest import ROOT, Viewer, run_viewer

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

WINDOW = {"width": 320 + 300, "height": 240}  # the panel is 300 wide
SETTLE_FRAMES = 10
TIMEOUT_SECONDS = 20.0
STEP_SECONDS = 0.05  # of a held key
TALL_BLOCK, LEFT_WALL = -0.16, -1.0  # of the box: z of the block in the middle of the image, and x


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    with run_viewer("--model", "none", "--size", "320x240") as viewer:
        yield viewer


@pytest.fixture
def page(browser: Any, viewer: Viewer) -> Iterator[Any]:
    """The page with a settled image of the unedited scene."""
    page = browser.new_page(viewport=WINDOW)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.goto(viewer.link)
    wait_until(page, "window.afterglow?.state && afterglow.screen.header && String(afterglow.state.size) === '320,240'")
    page.evaluate("""() => { window.start ??= structuredClone(afterglow.state); }""")
    assert page.evaluate("start.camera.eye") == [0, 1, 3.9]  # the test before has left nothing behind
    settle(page)
    yield page
    reset(page)
    wait_until(page, "afterglow.idle")
    assert errors == []
    page.close()


def wait_until(page: Any, expression: str, arg: Any = None) -> None:
    """Wait until a JavaScript expression is true; the page's security policy forbids Playwright's own function."""
    end = time.monotonic() + TIMEOUT_SECONDS
    while not page.evaluate(expression, arg):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(20)


def settle(page: Any, repeats: int = SETTLE_FRAMES) -> np.ndarray[Any, Any]:
    """Wait until the image shows all input and has settled; return its pixels, float, shape (H, W, 3), 0 to 255."""
    wait_until(page, """repeats => {
        const {connection, screen} = afterglow, header = screen.header;
        return header && afterglow.idle && !connection.pending.size && header.repeat >= repeats
               && String(header.size) === String([view.clientWidth, view.clientHeight]);
    }""", repeats)
    return pixels(page)


def pixels(page: Any, canvas: str = "left") -> np.ndarray[Any, Any]:
    url = page.evaluate("id => document.getElementById(id).toDataURL('image/png')", canvas)
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))).convert("RGB"), np.float64)


def difference(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> float:
    return float(np.abs(a - b).mean())


def drag(page: Any, start: tuple[float, float], by: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + by[0], start[1] + by[1], steps=6)
    page.mouse.up()


def reset(page: Any) -> None:
    """Restore the unedited scene, after the page has sent what would otherwise follow and undo it."""
    wait_until(page, "afterglow.idle")
    page.evaluate("""() => {
        const {camera, lights} = start;
        for (const object in afterglow.state.object_offsets)
            afterglow.connection.sendChange({type: 'move_object', object, translate: [0, 0, 0]});
        afterglow.connection.sendChange({type: 'camera', camera});
        afterglow.connection.sendChange({type: 'lights', lights});
        const settings = {model: 'none', split: '', aov: 'final', exposure: 1, taa: true};
        afterglow.connection.sendChange({type: 'settings', ...settings});
        afterglow.navigation.adopt(camera);
    }""")


def test_the_page_loads_and_shows_an_image(page: Any) -> None:
    image = settle(page)
    assert image.shape == (240, 320, 3)
    assert image.std() > 20 and image.mean() > 20
    assert "Cornell" in page.title() or "cornell" in page.title()
    wait_until(page, "document.getElementById('frame-rate').textContent.includes('ms')")
    assert "llvmpipe" in page.inner_text("#device") or "GL" in page.inner_text("#device")


def test_an_orbit_drag_changes_the_image(page: Any) -> None:
    before = settle(page)
    drag(page, (160, 120), (60, 10))
    after = settle(page)
    assert difference(before, after) > 8
    reset(page)
    assert difference(before, settle(page)) < 2


def test_keys_and_wheel_move_the_camera(page: Any) -> None:
    eye = "JSON.stringify(afterglow.navigation.camera.eye)"
    for act in (lambda: page.keyboard.press("w", delay=100), lambda: page.mouse.wheel(0, 200),
                lambda: page.keyboard.press("+")):
        before = page.evaluate(eye)
        page.mouse.move(160, 120)
        page.focus("#view")
        act()
        wait_until(page, f"before => {eye} !== before", before)


def camera_of(page: Any) -> dict[str, np.ndarray[Any, Any]]:
    """Return the current camera as ``frame_of`` does, when all questions of the page are answered."""
    wait_until(page, "afterglow.idle")
    return frame_of(page.evaluate("({...afterglow.navigation.camera, pivot: afterglow.navigation.pivot})"))


def frame_of(camera: dict[str, Any]) -> dict[str, np.ndarray[Any, Any]]:
    """Return eye, target and pivot of a camera, and its unit vectors right, up and forward."""
    eye, target, up = (np.array(camera[name], float) for name in ("eye", "target", "up"))
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    return {"eye": eye, "target": target, "pivot": np.array(camera["pivot"], float), "right": right,
            "up": np.cross(right, forward), "forward": forward}


def touch(page: Any, *fingers: tuple[tuple[float, float], tuple[float, float]], steps: int = 5) -> None:
    """Put fingers down, move each from its first position to its second, and lift them."""
    devtools = page.context.new_cdp_session(page)
    devtools.send("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    for step in range(steps + 1):
        points = [{"id": i, "x": a[0] + (b[0] - a[0]) * step / steps, "y": a[1] + (b[1] - a[1]) * step / steps}
                  for i, (a, b) in enumerate(fingers)]
        kind = "touchMove" if step else "touchStart"
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    devtools.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    devtools.send("Emulation.setTouchEmulationEnabled", {"enabled": False})
    devtools.detach()


def test_one_finger_orbits_about_the_surface_in_the_middle(page: Any) -> None:
    before, image = camera_of(page), settle(page)
    touch(page, ((90, 150), (150, 150)))
    after = camera_of(page)
    arm = after["eye"] - after["pivot"]
    assert after["pivot"] == pytest.approx([0, 1, TALL_BLOCK], abs=0.01)
    assert np.linalg.norm(arm) == pytest.approx(np.linalg.norm(before["eye"] - after["pivot"]))
    turned = np.degrees(np.arccos(arm @ (before["eye"] - after["pivot"]) / (arm @ arm)))
    assert turned == pytest.approx(np.degrees(3.5 * 60 / 240), abs=2)  # 3.5 rad for a drag over the image height
    assert difference(image, settle(page)) > 8


def test_two_fingers_pinch_and_pan(page: Any) -> None:
    before = camera_of(page)
    touch(page, ((140, 150), (100, 150)), ((180, 150), (220, 150)))  # 40 pixels apart, then 120
    apart = camera_of(page)
    arm = np.linalg.norm(before["eye"] - before["pivot"])
    assert np.linalg.norm(apart["eye"] - apart["pivot"]) == pytest.approx(arm / 3, rel=0.05)
    assert np.allclose(apart["forward"], before["forward"])
    touch(page, ((100, 150), (140, 150)), ((220, 150), (180, 150)))
    assert np.linalg.norm(camera_of(page)["eye"] - camera_of(page)["pivot"]) == pytest.approx(arm, rel=0.05)
    start = camera_of(page)
    touch(page, ((100, 150), (150, 130)), ((180, 150), (230, 130)))
    panned = camera_of(page)
    offset = panned["eye"] - start["eye"]
    assert np.allclose(offset, panned["target"] - start["target"])
    assert np.allclose(offset, panned["pivot"] - start["pivot"])
    assert offset @ start["right"] < 0 and offset @ start["up"] < 0  # the image follows the fingers
    assert abs(offset @ start["forward"]) < 1e-6
    assert page.evaluate("afterglow.navigation.pointers.size") == 0


def hold_for_one_step(page: Any, *keys: str) -> tuple[dict[str, np.ndarray[Any, Any]], dict[str, np.ndarray[Any, Any]]]:
    """Hold keys for one step of a fixed time; return the camera before and after it."""
    page.focus("#view")
    for key in keys:
        page.keyboard.down(key)
    cameras = page.evaluate("""seconds => {  // one task of the page, so that no screen refresh comes between
        const {navigation} = afterglow, before = {...navigation.camera, pivot: navigation.pivot};
        navigation.advance(seconds);
        return [before, {...navigation.camera, pivot: navigation.pivot}];
    }""", STEP_SECONDS)
    for key in reversed(keys):
        page.keyboard.up(key)
    before, after = map(frame_of, cameras)
    return before, after


@pytest.mark.parametrize(("key", "axis", "sign"), [
    ("w", "forward", 1), ("s", "forward", -1), ("d", "right", 1), ("a", "right", -1), ("e", "up", 1), ("q", "up", -1)])
def test_a_held_key_flies_and_shift_is_faster(page: Any, key: str, axis: str, sign: int) -> None:
    distances = []
    for keys in ((key,), ("Shift", key)):
        reset(page)
        before, after = hold_for_one_step(page, *keys)
        offset = after["eye"] - before["eye"]
        assert offset @ before[axis] * sign > 0 and np.linalg.norm(offset) == pytest.approx(abs(offset @ before[axis]))
        assert np.allclose(offset, after["target"] - before["target"])
        distances.append(float(np.linalg.norm(offset)))
        released = camera_of(page)
        page.evaluate("seconds => afterglow.navigation.advance(seconds)", STEP_SECONDS)
        page.wait_for_timeout(60)
        assert np.array_equal(camera_of(page)["eye"], released["eye"])  # it stops with the key
    extent = page.evaluate("afterglow.navigation.extent")
    assert distances == pytest.approx([0.4 * extent * STEP_SECONDS, 1.6 * extent * STEP_SECONDS])


def test_arrow_keys_look_around_from_the_eye(page: Any) -> None:
    for key, axis, sign in (("ArrowRight", "right", 1), ("ArrowLeft", "right", -1), ("ArrowUp", "up", 1),
                            ("ArrowDown", "up", -1)):
        reset(page)
        before, after = hold_for_one_step(page, key)
        assert np.array_equal(after["eye"], before["eye"])
        assert after["forward"] @ before[axis] * sign > 0.02, key


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
    assert (darker > 25).mean() > 0.02 and (brighter > 25).mean() > 0.02  # the shadow moved


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


def test_a_tone_map_and_automatic_exposure_change_the_image(page: Any) -> None:
    reset(page)
    before = settle(page)
    page.select_option("#tonemap", "agx")
    mapped = settle(page)
    page.check("#auto_exposure")
    exposed = settle(page)
    page.uncheck("#auto_exposure")
    page.select_option("#tonemap", "srgb")
    assert difference(before, mapped) > 4
    assert difference(mapped, exposed) > 4
    assert difference(before, settle(page)) < 2


def test_the_split_shows_two_models(page: Any) -> None:
    page.select_option("#split", "ssgi")
    left = settle(page)
    wait_until(page, "!document.getElementById('right').hidden && document.getElementById('right').width === 320")
    right = pixels(page, "right")
    assert right.mean() > left.mean() + 3  # has indirect light
    assert (page.inner_text("#label-left"), page.inner_text("#label-right")) == ("none", "ssgi")
    page.locator("#divider").focus()
    box = page.locator("#divider").bounding_box()
    drag(page, (box["x"] + box["width"] / 2, 60), (50, 0))
    assert page.evaluate("afterglow.screen.cut") == pytest.approx(0.66, abs=0.02)
    screenshot = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), np.float64)[:240, :320]
    inside = np.s_[100:200, 170:200]
    assert difference(screenshot[inside], left[inside]) < difference(screenshot[inside], right[inside])
    beyond = np.s_[100:200, 225:270]
    assert difference(screenshot[beyond], right[beyond]) < difference(screenshot[beyond], left[beyond])


def test_the_button_hides_and_shows_the_panel(page: Any) -> None:
    page.click("#toggle")
    assert not page.is_visible("#panel")
    wait_until(page, "view.clientWidth === 620 && afterglow.state.size[0] === 620")
    page.click("#toggle")
    assert page.is_visible("#panel")
    wait_until(page, "afterglow.state.size[0] === 320")
    assert page.evaluate("afterglow.navigation.pointers.size") == 0


def test_a_double_click_sets_the_pivot_and_selects_the_object(page: Any) -> None:
    page.mouse.dblclick(110, 150)  # the tall block
    wait_until(page, "document.getElementById('object').value !== ''")
    pivot = page.evaluate("afterglow.navigation.pivot")
    assert -1 < pivot[0] < 0 and 0 < pivot[1] < 1.5
    name = page.evaluate("document.getElementById('object').value")
    before = settle(page)
    box = page.locator('#handles g[data-id="object"] .ring').bounding_box()
    drag(page, (box["x"] + 9, box["y"] + 9), (40, 0))
    assert difference(before, settle(page)) > 3
    assert page.evaluate("name => afterglow.state.object_offsets[name][0] > 0.1", name)
    eye = camera_of(page)["eye"]
    drag(page, (280, 60), (20, 0))
    after = camera_of(page)
    assert after["pivot"] == pytest.approx(pivot) and np.linalg.norm(after["eye"] - eye) > 0.3  # turned about it


def test_the_wheel_zooms_towards_the_surface_under_the_cursor(page: Any) -> None:
    before = camera_of(page)
    page.mouse.move(40, 130)  # the left wall
    for _ in range(4):
        page.mouse.wheel(0, -100)
    wait_until(page, "start.camera.eye[2] > afterglow.navigation.camera.eye[2] + 0.1")
    after = camera_of(page)
    point = after["pivot"]
    assert point[0] == pytest.approx(LEFT_WALL, abs=0.01)
    assert np.linalg.norm(after["eye"] - point) == pytest.approx(
        np.exp(-0.6) * np.linalg.norm(before["eye"] - point), rel=1e-3)
    assert np.allclose(after["forward"], before["forward"])
    for camera in before, after:
        to = point - camera["eye"]
        half_height = to @ camera["forward"] * np.tan(np.radians(page.evaluate("start.camera.fov_y_deg")) / 2)
        seen = 160 + 120 * (to @ camera["right"]) / half_height, 120 - 120 * (to @ camera["up"]) / half_height
        assert seen == pytest.approx((40, 130), abs=0.1)


def test_an_orbit_stops_at_walls_and_slides_along_them(page: Any) -> None:
    """A wall at the yaws from 20° to 25°, and at pitches above 10°; beyond the wall it is free again."""
    turned = page.evaluate("""async () => {
        const {Orbit} = await import('/page/orbit.js');
        const row = '1111' + '0' + '1'.repeat(67), step = Math.PI / 36;
        const camera = {eye: [0, 0, 3], target: [0, 0, 0], up: [0, 1, 0]};
        return [[10, 0], [60, 0], [-60, 0], [60, 5], [0, 60]].map(angles => {
            const orbit = new Orbit(camera, [0, 0, 0], {step, first_row: -1, free: [row, row, row]});
            const {eye} = orbit.turn(...angles.map(a => a * Math.PI / 180));
            return [Math.atan2(eye[0], eye[2]), Math.asin(-eye[1] / 3)].map(a => a * 180 / Math.PI);
        });
    }""")
    (free, at_wall, around, along, up) = turned
    assert free == pytest.approx([10, 0], abs=0.01) and around == pytest.approx([-60, 0], abs=0.01)
    assert 17 < at_wall[0] < 20 and 17 < along[0] < 20 and along[1] == pytest.approx(5, abs=0.01)
    assert up[0] == pytest.approx(0, abs=0.01) and 7 < up[1] < 10


def test_a_drag_in_a_room_looks_around(browser: Any, tmp_path: Path) -> None:
    (tmp_path / "room.obj").write_text(trimesh.creation.box((4, 3, 5)).export(file_type="obj"))
    (tmp_path / "room.json").write_text(json.dumps(
        {"cameras": {"inside": {"eye": [0.5, 0, 1], "target": [0, 0, -1], "fov_y_deg": 60}}}))
    with run_viewer(str(tmp_path / "room.obj"), "--model", "none", "--size", "320x240") as viewer:
        page = browser.new_page(viewport=WINDOW)
        page.goto(viewer.link)
        wait_until(page, "window.afterglow?.state && afterglow.screen.header")
        before = camera_of(page)
        drag(page, (160, 120), (100, 0))
        wait_until(page, "afterglow.idle")
        after = camera_of(page)
        assert np.array_equal(after["eye"], before["eye"])
        turned = np.degrees(np.arccos(after["forward"] @ before["forward"]))
        assert turned == pytest.approx(np.degrees(1.2 * 100 / 240), abs=0.5)  # 1.2 rad for a drag over the image height
        page.close()


def test_the_command_reproduces_saved_files_bit_by_bit(page: Any, tmp_path: Path) -> None:
    page.evaluate("""() => {
        const {connection, state} = afterglow, light = {...start.lights[0], position: [0.3, 1.5, 0.4], radius: 0.2};
        const object = document.getElementById('object').options[1].value;
        connection.sendChange({type: 'move_object', object, translate: [0.1, 0.05, 0]});
        connection.sendChange({type: 'lights', lights: [{...light, intensity: [1.5, 1, 2]}]});
        connection.sendChange({type: 'camera', camera: {...start.camera, eye: [0.7, 1.3, 3.3]}});
        connection.sendChange({type: 'settings', exposure: 1.7});
    }""")
    live = settle(page, 3 * SETTLE_FRAMES)
    page.fill("#settle", "3")
    saved, commands = {}, {}
    for kind in ("json", "png", "exr"):
        with page.expect_download(timeout=1000 * TIMEOUT_SECONDS) as download:
            page.click(f'[data-save="{kind}"]')
        saved[kind] = tmp_path / download.value.suggested_filename
        download.value.save_as(saved[kind])
        wait_until(page, "format => document.getElementById('command').value.includes(`--format ${format} `)",
              "exr,png" if kind == "json" else kind)
        commands[kind] = shlex.split(page.input_value("#command"))
    assert commands["json"][:3] == ["python", "-m", "app"] and saved["json"].name in commands["json"]
    assert difference(read_png(saved["png"]).astype(float), live) < 3  # the live image is a JPEG with another history
    assert {"", "normal", "depth", "direct"} <= read_exr(saved["exr"]).keys()
    for kind in ("png", "exr"):
        subprocess.run([sys.executable, *commands[kind][1:], "--out", str(tmp_path / kind)], check=True, cwd=tmp_path,
                       env={**os.environ, "PYTHONPATH": str(ROOT)})
        assert (tmp_path / kind / f"0000.{kind}").read_bytes() == saved[kind].read_bytes()


def test_one_page_is_in_control_and_a_lost_connection_is_restored(page: Any, browser: Any, viewer: Viewer) -> None:
    other = browser.new_page(viewport=WINDOW)
    other.goto(viewer.link)
    wait_until(other, "window.afterglow?.state && afterglow.screen.header")
    assert other.is_visible("#take-control") and not page.is_visible("#take-control")
    other.evaluate("afterglow.connection.sendChange({type: 'settings', exposure: 3})")
    other.wait_for_selector("#toast:not([hidden])")
    assert "another page is in control" in other.inner_text("#toast")
    other.click("#take-control")
    page.wait_for_selector("#take-control:not([hidden])")
    page.evaluate("afterglow.connection.socket.close()")
    wait_until(page, "afterglow.connection.open")
    other.close()
    page.wait_for_selector("#take-control", state="hidden")
    drag(page, (160, 120), (30, 0))
    settle(page)
    reset(page)


def test_space_plays_the_animation_of_a_file(browser: Any, tmp_path: Path) -> None:
    """The slider then stops it at a time, whose image is the one of that time."""
    gltf = Gltf()
    animate(gltf, 0, "translation", [[-1, 0, 0], [1, 0, 0]])
    with run_viewer(str(gltf.save(tmp_path)), "--model", "none", "--size", "320x240") as viewer:
        page = browser.new_page(viewport=WINDOW)
        page.goto(viewer.link)
        wait_until(page, "window.afterglow?.state && afterglow.screen.header")
        assert page.is_visible("#motion-section")
        first = settle(page)
        page.keyboard.press("Space")
        wait_until(page, "afterglow.state.time > 0.2")
        page.evaluate("""() => {
            const slider = document.getElementById('time');
            slider.value = 0.75;
            slider.dispatchEvent(new Event('input'));
        }""")
        later = settle(page)
        assert page.evaluate("afterglow.state.time") == 0.75 and not page.is_checked("#play")
        assert difference(first, later) > 1
        # The triangle stands before the even backdrop of the studio.
        where = [np.average(np.arange(320), weights=np.abs(image.astype(float) - image[0, 0]).mean((0, 2)))
                 for image in (first, later)]
        assert where[1] - where[0] > 20  # to the right
        page.close()
