"""JSON files checked against a published schema; every mistake names its file and its key."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from app.errors import SceneError

SCHEMA = "scene.schema.json"
_KINDS = {"object": "an object", "array": "a list", "number": "a number", "integer": "a whole number",
          "string": "a text", "boolean": "true or false"}


def read_checked(path: Path, definition: str = "", schema: str = SCHEMA) -> Any:
    """The content of a JSON file that follows a schema of ``app/data``, or one of its definitions.

    Raises
    ------
    SceneError
        When the file can't be read, is no JSON, or breaks the schema; it names the key.
    """
    try:
        text = path.read_text("utf-8-sig")
    except (OSError, ValueError) as error:  # UnicodeDecodeError, or a path with a null byte
        raise SceneError("can't read the JSON file", path, "expected a readable UTF-8 file") from error
    try:
        content = parse(text)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"not a JSON file ({error})", path, "expected valid JSON with finite numbers") from error
    check(content, path, definition, schema)
    return content


def parse(text: str) -> Any:
    """The value of a JSON text, all of whose numbers are finite floats.

    Raises
    ------
    ValueError, RecursionError
        For anything else.
    """
    return json.loads(text, parse_float=_finite, parse_int=_finite, parse_constant=_finite)


def check(content: Any, path: Path, definition: str = "", schema: str = SCHEMA) -> None:
    """See to it that a JSON value follows a schema of ``app/data``, or one of its definitions.

    Raises
    ------
    SceneError
        When it does not; it names the key, and ``path`` as its file.
    """
    errors = list(_validator(schema, definition).iter_errors(content))
    if errors:
        raise _explain(next((e for e in errors if e.validator == "additionalProperties"), errors[0]), path)


def at(path: Path, *keys: object) -> str:
    """``file: key.path`` for a message; list indices are written in brackets."""
    joined = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys).lstrip(".")
    return f"{path}: {joined}" if joined else str(path)


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """What was expected in place of an unknown word."""
    near = difflib.get_close_matches(word, known, 1, 0.5)
    choices = ", ".join(known) if known else "none at all"
    return f"did you mean {near[0]!r}? (expected one of: {choices})" if near else f"expected one of: {choices}"


@cache
def _validator(name: str, definition: str) -> Draft202012Validator:
    schema = json.loads(resources.files("app.data").joinpath(name).read_text("utf-8"))
    if definition:
        schema = {"$ref": f"#/$defs/{definition}", "$defs": schema["$defs"]}
    return Draft202012Validator(schema)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is not a finite number")
    return value


def _explain(error: ValidationError, path: Path) -> SceneError:
    keys, rule, value = list(error.absolute_path), error.validator_value, error.instance
    if error.validator == "additionalProperties":
        known = sorted(error.schema["properties"])
        stray = sorted(set(value) - set(known))[0]
        return SceneError(f"unknown key {stray!r}", at(path, *keys, stray), did_you_mean(stray, known))
    if error.validator == "required":
        missing = next(k for k in rule if k not in value)
        return SceneError(f"missing key {missing!r}", at(path, *keys), f"expected {', '.join(rule)}")
    if error.validator == "enum":
        return SceneError(f"unknown value {value!r}", at(path, *keys), did_you_mean(str(value), rule))
    if error.validator == "type":
        return SceneError(f"wrong kind of value {_short(value)}", at(path, *keys), f"expected {_KINDS[rule]}")
    if error.validator == "minLength":
        return SceneError("an empty text", at(path, *keys), "expected a name")
    if error.validator in ("minItems", "maxItems", "minProperties"):
        return SceneError(f"{len(value)} values", at(path, *keys), f"expected {_amount(error)} {rule}")
    return SceneError(f"{_short(value)} is out of range", at(path, *keys), f"expected {_amount(error)} {rule:g}")


def _amount(error: ValidationError) -> str:
    return {"minItems": "at least", "minProperties": "at least", "maxItems": "at most",
            "minimum": "at least", "maximum": "at most",
            "exclusiveMinimum": "more than", "exclusiveMaximum": "less than"}[str(error.validator)]


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
