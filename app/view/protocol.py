"""Messages from the page: what is well-formed, and what each does to the state."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.errors import SceneError, SettingsError
from app.io.checked_json import check, did_you_mean, parse
from app.load import is_camera_word, parse_camera, parse_light
from app.view.scene_file import NAME
from app.view.state import REFERENCE, Json, State

SCHEMA = "view.schema.json"
TYPES = ("ack", "steer", "size", "camera", "lights", "look", "place", "bookmark", "pick", "save")
CHANGES = ("size", "camera", "lights", "look", "place", "bookmark")  # those of the state
MAX_PIXELS = 3840 * 2160
MAX_BOOKMARKS, MAX_NAME = 64, 40


@dataclass(frozen=True)
class Choices:
    """The names that messages may use.

    Attributes
    ----------
    objects : mapping of str to collection of int
        Instances that each object's name moves.
    """

    models: tuple[str, ...]
    aovs: tuple[str, ...]
    objects: Mapping[str, Collection[int]]


def read_message(text: str) -> Json:
    """A message that follows its schema.

    Raises
    ------
    AfterglowError
        When it is no JSON, of no known type, or has a wrong key.
    """
    try:
        message = parse(text)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"not a JSON message ({str(error)[:60]})", "message",
                            "expected valid JSON with finite numbers") from None
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        raise SettingsError("no type", "message", "expected a JSON object with a type")
    kind = message["type"]
    if kind not in TYPES:
        raise SettingsError(f"unknown type {kind[:40]!r}", "message", did_you_mean(kind[:40], TYPES))
    check(message, Path(kind), kind, SCHEMA)
    return message


def changed(state: State, message: Json, choices: Choices) -> State:
    """The state after a message of ``CHANGES``.

    Raises
    ------
    AfterglowError
        When a value is out of range, or a name is none of the choices.
    """
    match message["type"]:
        case "size":
            return replace(state, size=_size(message["size"]))
        case "camera":
            return replace(state, camera=parse_camera(message["camera"], "camera"))
        case "lights":
            lights = [parse_light(light, f"lights[{i}]") for i, light in enumerate(message["lights"])]
            return replace(state, lights=tuple(lights))
        case "look":
            return _look(state, message, choices)
        case "place":
            return _placed(state, message, choices)
        case "bookmark":
            return _bookmarked(state, message)
    raise AssertionError(message["type"])


def _size(values: list[float]) -> tuple[int, int]:
    width, height = map(int, values)
    if width * height > MAX_PIXELS:
        raise SettingsError(f"bad size {width}x{height}", "size", f"expected at most {MAX_PIXELS} pixels")
    return width, height


def _look(state: State, message: Json, choices: Choices) -> State:
    values: dict[str, Any] = {key: value for key, value in message.items() if key not in ("type", "input")}
    for key, known in (("model", choices.models), ("split", ("", REFERENCE, *choices.models)), ("aov", choices.aovs)):
        if key in values and values[key] not in known:
            raise SettingsError(f"unknown {key} {values[key][:40]!r}", key, did_you_mean(values[key][:40], known))
    return replace(state, **values)


def _placed(state: State, message: Json, choices: Choices) -> State:
    name = message["object"]
    if name not in choices.objects:
        raise SettingsError(f"no object {name[:40]!r}", "object", did_you_mean(name[:40], [*choices.objects][:20]))
    others = {other for other, _ in state.places if other != name}
    for other in sorted(others):
        if set(choices.objects[other]) & set(choices.objects[name]):
            raise SceneError(f"{name!r} shares parts with {other!r}", "object", "expected one of both to stay")
    places = {**dict(state.places), name: tuple(message["translate"])}
    return replace(state, places=tuple(sorted((n, p) for n, p in places.items() if any(p))))


def _bookmarked(state: State, message: Json) -> State:
    name, kept = message["name"], dict(state.bookmarks)
    if not name.isprintable() or not 0 < len(name.strip()) <= MAX_NAME:
        raise SettingsError(f"bad name {name[:40]!r}", "bookmark", f"expected 1 to {MAX_NAME} printable characters")
    if is_camera_word(name.strip()) or name.strip() == NAME:
        raise SettingsError(f"{name!r} would name no bookmark", "bookmark",
                            f"expected another name: auto, orbit, *.json and {NAME} mean something else to --camera")
    if message.get("forget", False):
        kept.pop(name, None)
    else:
        kept[name] = state.camera
    if len(kept) > MAX_BOOKMARKS:
        raise SettingsError("too many bookmarks", "bookmark", f"expected at most {MAX_BOOKMARKS}")
    return replace(state, bookmarks=tuple(kept.items()))
