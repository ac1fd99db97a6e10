"""JSON files checked against a published schema; every mistake names its file and its key."""

from __future__ import annotations

import json
import math
from collections import Counter
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import AfterglowError, SceneError, did_you_mean

if TYPE_CHECKING:
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import ValidationError

SCHEMA = "scene.schema.json"
_KINDS = {"object": "an object", "array": "a list", "number": "a number", "integer": "a whole number",
          "string": "a string", "boolean": "true or false"}
_BOUNDS = {"minItems": "at least", "minProperties": "at least", "maxItems": "at most", "minimum": "at least",
           "maximum": "at most", "exclusiveMinimum": "more than", "exclusiveMaximum": "less than"}


def read_checked(path: Path, definition: str = "", schema: str = SCHEMA) -> Any:
    """The content of a JSON file that follows a schema of ``app/data``, or one of its definitions.

    Raises
    ------
    SceneError
        When the file can't be read, is no JSON, or breaks the schema; it names the key.
    """
    try:
        text = path.read_text("utf-8-sig")
    except FileNotFoundError as error:
        raise SceneError("no such JSON file", path, "expected the path of an existing file") from error
    except (OSError, ValueError) as error:  # UnicodeDecodeError, or a path with a null byte
        raise SceneError("can't read the JSON file", path, "expected a readable UTF-8 file") from error
    try:
        content = parse(text)
    except RecursionError as error:
        raise SceneError("nested too deeply", path, "expected a JSON file of this program's kind") from error
    except ValueError as error:
        raise SceneError(f"not a JSON file ({error})", path,
                         "expected valid JSON with finite numbers and each key once") from error
    check(content, path, definition, schema)
    return content


def parse(text: str) -> Any:
    """The value of a JSON text, all of whose numbers are finite floats and whose objects have each key once.

    Raises
    ------
    ValueError, RecursionError
        For anything else.
    """
    return json.loads(text, parse_float=_finite, parse_int=_finite, parse_constant=_finite,
                      object_pairs_hook=_object)


def check(content: Any, where: object, definition: str = "", schema: str = SCHEMA,
          error: type[AfterglowError] = SceneError) -> None:
    """Check that a JSON value follows a schema of ``app/data``, or one of its definitions.

    Parameters
    ----------
    where : object
        The file to name in errors.
    error : type
        Raised instead of ``SceneError``.

    Raises
    ------
    SceneError
        When it does not; it names the file and the key.
    """
    violations = list(_validator(schema, definition).iter_errors(content))
    if violations:
        first = next((v for v in violations if v.validator == "additionalProperties"), violations[0])
        what, keys, expected = _explain(first)
        raise error(what, at(where, *keys), expected)


def at(where: object, *keys: object) -> str:
    """``file: key.path`` for a message; list indices are written in brackets."""
    joined = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys).lstrip(".")
    return f"{where}: {joined}" if joined else str(where)


@cache
def _validator(name: str, definition: str) -> Draft202012Validator:
    from jsonschema import Draft202012Validator  # slow to import, and help and version need none of it

    schema = json.loads(resources.files("app.data").joinpath(name).read_text("utf-8"))
    if definition:
        schema = {"$ref": f"#/$defs/{definition}", "$defs": schema["$defs"]}
    return Draft202012Validator(schema)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is not a finite number")
    return value


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"key {twice!r} is there twice in an object")
    return content


def _explain(violation: ValidationError) -> tuple[str, list[object], str]:
    """What is wrong, the key, and what was expected."""
    keys, rule, value = list(violation.absolute_path), violation.validator_value, violation.instance
    kind = str(violation.validator)
    match kind:
        case "additionalProperties":
            known = sorted(violation.schema["properties"])
            stray = sorted(set(value) - set(known))[0]
            return f"unknown key {stray!r}", [*keys, stray], did_you_mean(stray, known)
        case "required":
            missing = next(k for k in rule if k not in value)
            return f"missing key {missing!r}", keys, f"expected {', '.join(rule)}"
        case "enum":
            return f"unknown value {value!r}", keys, did_you_mean(str(value), rule)
        case "type":
            rules = [rule] if isinstance(rule, str) else rule
            kinds = " or ".join(_KINDS[k] for k in rules)
            count, items = violation.schema.get("minItems"), violation.schema.get("items", {})
            if rule == "array" and items.get("type") == "number" and count == violation.schema.get("maxItems"):
                kinds = f"a list of {count} numbers"
            return f"wrong kind of value {_short(value)}", keys, f"expected {kinds}"
        case "pattern":
            return f"wrong form of {_short(value)}", keys, f"expected a text that matches {rule}"
        case "minLength":
            return "an empty string", keys, "expected a name"
        case "minItems" | "maxItems" | "minProperties":
            return f"{len(value)} values", keys, f"expected {_BOUNDS[kind]} {rule}"
    return f"{_short(value)} is out of range", keys, f"expected {_BOUNDS[kind]} {rule:g}"


def _short(value: object) -> str:
    is_whole = isinstance(value, float) and value.is_integer() and abs(value) < 1e15
    text = json.dumps(int(value) if is_whole else value)  # type: ignore[call-overload]
    return text if len(text) <= 40 else text[:37] + "..."
