"""Hypothesis strategies that mutate a valid file."""

from __future__ import annotations

import copy
import json
import math
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

MAX_MUTATIONS = 4
WORDS = ("", "nan", "inf", "-inf", "1e400", "1e-400", "0", "-0", "-1", "1", "2", "1e30", "4294967296",
         "99999999999999999999", "9" * 5000, "0x10", "1_0", "٣", "\x00", "\ufffd", "#", "\\", "\n", "/", "1//1",
         "1/2/3/4", "-1/-1/-1", "v", "vt", "vn", "f", "o", "g", "usemtl", "mtllib", "newmtl", "map_Kd", "Kd", "-s")
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 0.5, 1e30, 1e308, -1e308, math.nan, math.inf, -math.inf, 2**31, 2**63, 10**400,
    "", "x", "\x00", "data:,", "data:;base64,AAAA", "../x", [], {}, [None], [0], [0, 0, 0], [math.nan] * 3, [1e308] * 3,
    {"x": 0})
BITS = (0, 1, 127, 128, 254, 255)


@st.composite
def mutate_bytes(draw: DrawFn, valid: bytes) -> bytes:
    """Truncate, or change, delete, repeat, move or insert bytes."""
    data = bytearray(valid)
    for _ in range(draw(st.integers(1, MAX_MUTATIONS))):
        at = draw(st.integers(0, len(data)))
        end = min(len(data), at + draw(st.sampled_from((1, 2, 4, 16, 256))))
        match draw(st.sampled_from(("truncate", "change", "delete", "repeat", "move", "insert"))):
            case "truncate":
                del data[at:]
            case "change":
                data[at:end] = bytes([draw(st.sampled_from(BITS) | st.integers(0, 255))]) * (end - at)
            case "delete":
                del data[at:end]
            case "repeat":
                data[at:at] = data[at:end] * draw(st.sampled_from((1, 2, 50)))
            case "move":
                piece = bytes(data[at:end])
                del data[at:end]
                to = draw(st.integers(0, len(data)))
                data[to:to] = piece
            case "insert":
                data[at:at] = draw(st.binary(max_size=64))
    return bytes(data)


@st.composite
def mutate_text(draw: DrawFn, valid: str) -> bytes:
    """Replace, delete, repeat or move words or lines."""
    lines = [line.split(" ") for line in valid.split("\n")]
    for _ in range(draw(st.integers(1, MAX_MUTATIONS))):
        row = draw(st.integers(0, len(lines) - 1))
        match draw(st.sampled_from(("word", "more words", "delete", "repeat", "move"))):
            case "word":
                column = draw(st.integers(0, len(lines[row]) - 1))
                lines[row][column] = draw(st.sampled_from(WORDS) | st.text(max_size=8))
            case "more words":
                lines[row] += draw(st.lists(st.sampled_from(WORDS), min_size=1, max_size=5))
            case "delete":
                lines[row] = [""]
            case "repeat":
                lines[row:row] = [list(lines[row])] * draw(st.sampled_from((1, 100)))
            case "move":
                lines.insert(draw(st.integers(0, len(lines))), list(lines[row]))
    return "\n".join(" ".join(line) for line in lines).encode("utf-8", "surrogatepass")


@st.composite
def mutate_json(draw: DrawFn, valid: Any) -> Any:
    """Replace values by odd ones, delete them, or add others with odd keys."""
    value = copy.deepcopy(valid)
    for _ in range(draw(st.integers(1, MAX_MUTATIONS))):
        containers = [c for c in _containers(value) if c]
        if not containers:
            break
        inside = containers[draw(st.integers(0, len(containers) - 1))]
        keys = list(inside) if isinstance(inside, dict) else list(range(len(inside)))
        key = keys[draw(st.integers(0, len(keys) - 1))]
        match draw(st.sampled_from(("replace", "replace", "number", "delete", "add", "swap"))):
            case "replace":
                inside[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
            case "number":
                inside[key] = draw(st.integers(-3, 9) | st.floats())
            case "delete":
                del inside[key]
            case "add" if isinstance(inside, dict):
                inside[draw(st.text(max_size=8))] = copy.deepcopy(inside[key])
            case "add":
                inside.append(copy.deepcopy(inside[key]))
            case "swap":
                other = keys[draw(st.integers(0, len(keys) - 1))]
                inside[key], inside[other] = inside[other], inside[key]
    return value


def mutate_json_text(valid: Any) -> SearchStrategy[bytes]:
    """``mutate_json`` as text, or the text itself mutated."""
    text = json.dumps(valid).encode()
    return mutate_json(valid).map(lambda value: json.dumps(value).encode()) | mutate_bytes(text)


def _containers(value: Any) -> list[Any]:
    """All lists and objects in a JSON value, including itself."""
    if not isinstance(value, list | dict):
        return []
    inner = value.values() if isinstance(value, dict) else value
    return [value, *(c for v in inner for c in _containers(v))]
