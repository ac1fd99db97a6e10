"""Messages from the page: their validation, and the changes they make to the state; and what the page can choose."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.errors import SceneError, SettingsError, did_you_mean
from app.io.checked_json import check, parse
from app.load import LoadedScene, is_camera_keyword, parse_camera, parse_light
from app.scene import bounds_of
from app.settings import SETTLE_FRAMES
from app.view.scene_file import VIEW_NAME
from app.view.state import REFERENCE, Json, State, camera_to_json

SCHEMA = "view.schema.json"
CHANGE_TYPES = ("size", "camera", "lights", "settings", "move_object", "bookmark")  # these change the state
TYPES = ("ack", "take_control", *CHANGE_TYPES, "pick", "orbit", "save")
MAX_PIXELS = 3840 * 2160
MAX_BOOKMARKS, MAX_NAME_LENGTH = 64, 40
MAX_QUOTED = 40  # characters of a message that an error quotes


@dataclass(frozen=True)
class Choices:
    """The names that messages may use.

    Attributes
    ----------
    objects : mapping of str to collection of int
        Instances that move with each object.
    """

    models: tuple[str, ...]
    aovs: tuple[str, ...]
    tonemaps: tuple[str, ...]
    objects: Mapping[str, Collection[int]]


def describe_scene(file: Path, loaded: LoadedScene, choices: Choices) -> Json:
    """Return choices, cameras, bounds and the objects' centres in the file, in scene units; each page gets it once."""
    scene = loaded.scene
    centers = {name: bounds_of(scene.meshes, tuple(scene.instances[i] for i in members)).mean(axis=0).tolist()
               for name, members in choices.objects.items()}
    return {"file": file.name, "triangles": scene.triangles, "models": choices.models, "aovs": choices.aovs,
            "tonemaps": choices.tonemaps,
            "object_centers": centers, "emitters": len(scene.lights) - loaded.own_lights,
            "cameras": {name: camera_to_json(path.at(0.0)) for name, path in scene.cameras.items()},
            "bounds": scene.bounds.tolist(), "duration": scene.key_times[-1], "settle": SETTLE_FRAMES}


def read_message(text: str) -> Json:
    """Parse a message and check it against its schema.

    Raises
    ------
    AfterglowError
        When it is not JSON, has an unknown type, or breaks the schema.
    """
    try:
        message = parse(text)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"not a JSON message, {str(error)[:60]}", "message",
                            "expected valid JSON with finite numbers") from None
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        raise SettingsError("no type", "message", "expected a JSON object with a type")
    kind = message["type"]
    if kind not in TYPES:
        raise _unknown("type", kind, TYPES, "message")
    check(message, kind, kind, SCHEMA, SettingsError)
    return message


def apply_change(state: State, message: Json, choices: Choices) -> State:
    """Return the state after a message of ``CHANGE_TYPES``.

    Raises
    ------
    AfterglowError
        When a value is out of range or a name is unknown.
    """
    match message["type"]:
        case "size":
            return replace(state, size=_parse_size(message["size"]))
        case "camera":
            return replace(state, camera=parse_camera(message["camera"], "camera"))
        case "lights":
            lights = [parse_light(light, f"lights[{i}]") for i, light in enumerate(message["lights"])]
            return replace(state, lights=tuple(lights))
        case "settings":
            return _change_settings(state, message, choices)
        case "move_object":
            return _move_object(state, message, choices)
        case "bookmark":
            return _edit_bookmarks(state, message)
    raise AssertionError(message["type"])


def _unknown(what: str, word: str, known: Collection[str], where: str) -> SettingsError:
    word = word[:MAX_QUOTED]
    return SettingsError(f"unknown {what} {word!r}", where, did_you_mean(word, list(known)))


def _parse_size(values: list[float]) -> tuple[int, int]:
    width, height = map(int, values)
    if width * height > MAX_PIXELS:
        raise SettingsError(f"bad size {width}x{height}", "size", f"expected at most {MAX_PIXELS} pixels")
    return width, height


def _change_settings(state: State, message: Json, choices: Choices) -> State:
    values: dict[str, Any] = {key: value for key, value in message.items() if key not in ("type", "input")}
    for key, known in (("model", choices.models), ("split", ("", REFERENCE, *choices.models)), ("aov", choices.aovs),
                       ("tonemap", choices.tonemaps)):
        if key in values and values[key] not in known:
            raise _unknown(key, values[key], known, key)
    return replace(state, **values)


def _move_object(state: State, message: Json, choices: Choices) -> State:
    name = message["object"]
    if name not in choices.objects:
        raise _unknown("object", name, list(choices.objects)[:20], "object")
    for other in sorted({other for other, _ in state.object_offsets if other != name}):
        if set(choices.objects[other]) & set(choices.objects[name]):
            raise SceneError(f"{name!r} shares parts with {other!r}, which has moved", "object",
                             "expected an object without moved parts")
    offsets = {**dict(state.object_offsets), name: tuple(message["translate"])}
    return replace(state, object_offsets=tuple(sorted((n, offset) for n, offset in offsets.items() if any(offset))))


def _edit_bookmarks(state: State, message: Json) -> State:
    name, bookmarks = message["name"], dict(state.bookmarks)
    if not name.isprintable() or not 0 < len(name.strip()) <= MAX_NAME_LENGTH:
        raise SettingsError(f"bad name {name[:MAX_QUOTED]!r}", "bookmark",
                            f"expected 1 to {MAX_NAME_LENGTH} printable characters")
    if is_camera_keyword(name.strip()) or name.strip() == VIEW_NAME:
        raise SettingsError(f"the name {name!r} has another meaning for --camera", "bookmark",
                            f"expected another name than auto, orbit, *.json or {VIEW_NAME}")
    if message.get("remove", False):
        bookmarks.pop(name, None)
    else:
        bookmarks[name] = state.camera
    if len(bookmarks) > MAX_BOOKMARKS:
        raise SettingsError("too many bookmarks", "bookmark", f"expected at most {MAX_BOOKMARKS}")
    return replace(state, bookmarks=tuple(bookmarks.items()))
