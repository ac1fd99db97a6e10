"""Messages: what each changes in the state, and how wrong ones are rejected."""

from __future__ import annotations

import json
from typing import Any

import pytest

from app.errors import AfterglowError
from app.scene import Camera, DirectionalLight, PointLight, RectLight, SpotLight
from app.view.protocol import Choices, apply_change, read_message
from app.view.state import State, camera_to_json, light_to_json, state_to_json

CAMERA = Camera((0.0, 1.0, 4.0), (0.0, 1.0, 0.0))
LIGHTS = (PointLight((0.0, 1.5, 0.0), (2.0, 2.0, 2.0), 0.1),
          SpotLight((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 10.0, 20.0),
          DirectionalLight((0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 0.5),
          RectLight((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (3.0, 3.0, 3.0), True))
STATE = State((64, 48), CAMERA, LIGHTS, "none")
CHOICES = Choices(("none", "ember"), ("final", "normal"), ("srgb", "agx"), {"box": (0,), "boxes": (0, 1), "ball": (2,)})


def apply(state: State = STATE, **message: Any) -> State:
    return apply_change(state, read_message(json.dumps(message)), CHOICES)


def test_a_page_can_send_back_what_it_received() -> None:
    received = json.loads(json.dumps(state_to_json(STATE)))
    assert apply(type="camera", camera=received["camera"]) == STATE
    assert apply(type="lights", lights=received["lights"]).lights == LIGHTS
    assert apply(type="size", size=received["size"]) == STATE


def test_each_change() -> None:
    assert apply(type="size", size=[320, 240]).size == (320, 240)
    assert apply(type="lights", lights=[]).lights == ()
    chosen = apply(type="settings", model="ember", split="reference", aov="normal", exposure=2, taa=False, scale=0.25,
                   precision="float16", time=1.5)
    assert (chosen.model, chosen.split, chosen.aov) == ("ember", "reference", "normal")
    assert (chosen.exposure, chosen.taa, chosen.time) == (2.0, False, 1.5)
    assert (chosen.scale, chosen.precision, chosen.models) == (0.25, "float16", ("ember",))
    assert apply(type="settings", split="ember").models == ("none", "ember")
    moved = apply(type="move_object", object="box", translate=[1, 0, 0])
    assert moved.object_offsets == (("box", (1.0, 0.0, 0.0)),)
    assert apply(moved, type="move_object", object="box", translate=[0, 0, 0]) == STATE
    bookmarked = apply(type="bookmark", name="here")
    assert bookmarked.bookmarks == (("here", CAMERA),)
    assert apply(bookmarked, type="bookmark", name="here", remove=True) == STATE


def test_objects_that_share_parts_cannot_both_move() -> None:
    moved = apply(type="move_object", object="box", translate=[1, 0, 0])
    with pytest.raises(AfterglowError, match="shares parts with 'box'"):
        apply(moved, type="move_object", object="boxes", translate=[1, 0, 0])


CAMERA_TEXT = json.dumps(camera_to_json(CAMERA)).replace("45.0", "NUMBER")
LIGHT = light_to_json(LIGHTS[0])


@pytest.mark.parametrize(("text", "expected"), [
    ("", "not a JSON message"), ("{", "not a JSON message"), ("[" * 100_000, "not a JSON message"),
    ("null", "no type"), ("[]", "no type"), ('{"type": 3}', "no type"), ('{"type": "cmaera"}', "did you mean 'camera'"),
    ('{"type": "camera"}', "missing key 'camera'"),
    ('{"type": "camera", "camera": 3}', "wrong kind of value"),
    *((f'{{"type": "camera", "camera": {CAMERA_TEXT.replace("NUMBER", number)}}}', "not a JSON message")
      for number in ("NaN", "Infinity", "-Infinity", "1e999")),
    ('{"type": "camera", "camera": {"eye": [0, 0, 0], "target": [0, 0, 0]}}', "the same point"),
    ('{"type": "camera", "camera": {"eye": [0, 0, 0], "target": [0, 1e16, 0]}}', "out of range"),
    ('{"type": "camera", "camera": {"eye": [0, 0], "target": [0, 1, 0]}}', "2 values"),
    ('{"type": "camera", "camera": {"eye": [0, 0, 0], "target": [0, 0, 1], "file": "/etc"}}', "unknown key 'file'"),
    ('{"type": "size", "size": [0, 4]}', "out of range"), ('{"type": "size", "size": [4096, 4096]}', "at most"),
    ('{"type": "settings"}', "1 values"), ('{"type": "settings", "model": "../../etc/passwd"}', "unknown model"),
    ('{"type": "settings", "aov": "final,normal"}', "unknown aov"),
    ('{"type": "settings", "exposure": 0}', "out of range"),
    ('{"type": "settings", "precision": "int4"}', "unknown value"),
    ('{"type": "settings", "taa": "no"}', "true or false"),
    ('{"type": "move_object", "object": "/", "translate": [0, 0, 0]}', "unknown object"),
    ('{"type": "bookmark", "name": "a\\u0000b"}', "bad name"), ('{"type": "bookmark", "name": ""}', "bad name"),
    (json.dumps({"type": "lights", "lights": [LIGHT] * 513}), "513 values"),
    (json.dumps({"type": "lights", "lights": [LIGHT, {**LIGHT, "radius": -1}]}), "lights[1]"),
    (json.dumps({"type": "lights", "lights": [{"type": "laser"}]}), "unknown value 'laser'"),
])
def test_errors_in_messages_are_one_clear_line(text: str, expected: str) -> None:
    with pytest.raises(AfterglowError) as caught:
        apply_change(STATE, read_message(text), CHOICES)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_the_number_of_bookmarks_is_limited() -> None:
    state = STATE
    with pytest.raises(AfterglowError, match="too many bookmarks"):
        for index in range(100):
            state = apply(state, type="bookmark", name=str(index))
    assert len(state.bookmarks) == 64


@pytest.mark.parametrize("name", ["view", "auto", "orbit", " auto ", "low.json"])
def test_a_bookmark_with_another_meaning_for_the_camera_option_is_rejected(name: str) -> None:
    with pytest.raises(AfterglowError, match="expected another name"):
        apply(type="bookmark", name=name)
