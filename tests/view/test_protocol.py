"""Messages: what each does to the state, and how wrong ones are refused."""

from __future__ import annotations

import json
from typing import Any

import pytest

from app.errors import AfterglowError
from app.scene import Camera, DirectionalLight, PointLight, RectLight, SpotLight
from app.view.protocol import Choices, changed, read_message
from app.view.state import State, camera_json, light_json, state_json

CAMERA = Camera((0.0, 1.0, 4.0), (0.0, 1.0, 0.0))
LIGHTS = (PointLight((0.0, 1.5, 0.0), (2.0, 2.0, 2.0), 0.1),
          SpotLight((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 10.0, 20.0),
          DirectionalLight((0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 0.5),
          RectLight((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (3.0, 3.0, 3.0), True))
STATE = State((64, 48), CAMERA, LIGHTS, "none")
CHOICES = Choices(("none", "ember"), ("final", "normal"), {"box": (0,), "boxes": (0, 1), "ball": (2,)})


def apply(**message: Any) -> State:
    return changed(STATE, read_message(json.dumps(message)), CHOICES)


def test_what_the_page_is_told_may_be_sent_back() -> None:
    told = json.loads(json.dumps(state_json(STATE)))
    assert apply(type="camera", camera=told["camera"]) == STATE
    assert apply(type="lights", lights=told["lights"]).lights == LIGHTS
    assert apply(type="size", size=told["size"]) == STATE


def test_each_change() -> None:
    assert apply(type="size", size=[320, 240]).size == (320, 240)
    assert apply(type="lights", lights=[]).lights == ()
    look = apply(type="look", model="ember", split="reference", aov="normal", exposure=2, taa=False, scale=0.25,
                 precision="float16")
    assert (look.model, look.split, look.aov, look.exposure, look.taa) == ("ember", "reference", "normal", 2.0, False)
    assert (look.scale, look.precision, look.models) == (0.25, "float16", ("ember",))
    assert apply(type="look", split="ember").models == ("none", "ember")
    moved = apply(type="place", object="box", translate=[1, 0, 0])
    assert moved.places == (("box", (1.0, 0.0, 0.0)),)
    back = changed(moved, read_message('{"type": "place", "object": "box", "translate": [0, 0, 0]}'), CHOICES)
    assert back == STATE
    kept = apply(type="bookmark", name="here")
    assert kept.bookmarks == (("here", CAMERA),)
    assert changed(kept, read_message('{"type": "bookmark", "name": "here", "forget": true}'), CHOICES) == STATE


def test_objects_that_share_parts_don_t_both_move() -> None:
    moved = apply(type="place", object="box", translate=[1, 0, 0])
    with pytest.raises(AfterglowError, match="shares parts with 'box'"):
        changed(moved, read_message('{"type": "place", "object": "boxes", "translate": [1, 0, 0]}'), CHOICES)


NOT_FINITE = json.dumps(camera_json(CAMERA)).replace("45.0", "NUMBER")
LIGHT = light_json(LIGHTS[0])


@pytest.mark.parametrize(("text", "said"), [
    ("", "not a JSON message"), ("{", "not a JSON message"), ("[" * 100_000, "not a JSON message"),
    ("null", "no type"), ("[]", "no type"), ('{"type": 3}', "no type"), ('{"type": "cmaera"}', "did you mean 'camera'"),
    ('{"type": "camera"}', "missing key 'camera'"),
    ('{"type": "camera", "camera": 3}', "wrong kind of value"),
    *((f'{{"type": "camera", "camera": {NOT_FINITE.replace("NUMBER", number)}}}', "not a JSON message")
      for number in ("NaN", "Infinity", "-Infinity", "1e999")),
    ('{"type": "camera", "camera": {"eye": [0, 0, 0], "target": [0, 0, 0]}}', "the same point"),
    ('{"type": "camera", "camera": {"eye": [0, 0, 0], "target": [0, 1e16, 0]}}', "out of range"),
    ('{"type": "camera", "camera": {"eye": [0, 0], "target": [0, 1, 0]}}', "2 values"),
    ('{"type": "camera", "camera": {"eye": [0, 0, 0], "target": [0, 0, 1], "file": "/etc"}}', "unknown key 'file'"),
    ('{"type": "size", "size": [0, 4]}', "out of range"), ('{"type": "size", "size": [4096, 4096]}', "at most"),
    ('{"type": "look"}', "1 values"), ('{"type": "look", "model": "../../etc/passwd"}', "unknown model"),
    ('{"type": "look", "aov": "final,normal"}', "unknown aov"), ('{"type": "look", "exposure": 0}', "out of range"),
    ('{"type": "look", "precision": "int4"}', "unknown value"), ('{"type": "look", "taa": "no"}', "true or false"),
    ('{"type": "place", "object": "/", "translate": [0, 0, 0]}', "no object"),
    ('{"type": "bookmark", "name": "a\\u0000b"}', "bad name"), ('{"type": "bookmark", "name": ""}', "bad name"),
    (json.dumps({"type": "lights", "lights": [LIGHT] * 513}), "513 values"),
    (json.dumps({"type": "lights", "lights": [LIGHT, {**LIGHT, "radius": -1}]}), "lights[1]"),
    (json.dumps({"type": "lights", "lights": [{"type": "laser"}]}), "unknown value 'laser'"),
])
def test_wrong_messages_are_one_clear_line(text: str, said: str) -> None:
    with pytest.raises(AfterglowError) as caught:
        changed(STATE, read_message(text), CHOICES)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_bookmarks_are_bounded() -> None:
    state = STATE
    with pytest.raises(AfterglowError, match="too many bookmarks"):
        for index in range(100):
            state = changed(state, read_message(json.dumps({"type": "bookmark", "name": str(index)})), CHOICES)
    assert len(state.bookmarks) == 64


@pytest.mark.parametrize("name", ["view", "auto", "orbit", " auto ", "low.json"])
def test_a_bookmark_that_a_camera_option_would_not_find_is_refused(name: str) -> None:
    with pytest.raises(AfterglowError, match="expected another name"):
        apply(type="bookmark", name=name)
