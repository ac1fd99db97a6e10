"""Keys that depend on the content of values only, not on the file or object that they come from."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def content_key(*values: object) -> str:
    """Hexadecimal digest of dataclasses, mappings, sequences, arrays, strings and numbers.

    Raises
    ------
    TypeError
        For other values, which might compare by identity.
    """
    digest = hashlib.sha256()
    for part in _parts(values):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:32]


def changed_fields(value: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of a dataclass's fields, without those that have their default value.

    A new field with a default then changes no key.
    """
    for f in fields(value):
        inner = getattr(value, f.name)
        if not (isinstance(inner, bool | int | float | str | tuple | None) and inner == f.default):
            yield f.name, inner


def _parts(value: object) -> Iterator[bytes | memoryview]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape}".encode()
        yield np.ascontiguousarray(value).reshape(-1).view(np.uint8).data
    elif is_dataclass(value):
        yield type(value).__name__.encode()
        for name, inner in changed_fields(value):
            yield name.encode()
            yield from _parts(inner)
    elif isinstance(value, Mapping):
        yield from _parts(sorted(value.items()))
    elif isinstance(value, tuple | list):
        yield str(len(value)).encode()
        for inner in value:
            yield from _parts(inner)
    elif value is None or isinstance(value, bool | int | float | str | np.generic):
        yield f"{type(value).__name__} {value!r}".encode()
    else:
        raise TypeError(f"no key for a {type(value).__name__}")
