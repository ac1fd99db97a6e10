"""Contracts as JSON: the value of a metadata key of ``.onnx`` files, and the content of a ``CONTRACT.json``."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from app.errors import ModelError
from app.io.checked_json import check
from app.network.contract import KEY, SCHEMA, VERSION, ModelContract, TensorSpec

GRAPH, METADATA_PROPS = 7, 14   # fields of ModelProto in onnx.proto
ENTRY_KEY, ENTRY_VALUE = 1, 2   # fields of StringStringEntryProto
MAX_VARINT_BITS = 70            # ten bytes of seven bits hold 64 bits


def read_contract(path: Path | str) -> ModelContract:
    """The contract inside an ``.onnx`` file.

    Raises
    ------
    ModelError
        When the file can't be read, is no ONNX file, or has no contract or an invalid one.
    """
    text = _read_metadata(Path(path)).get(KEY)
    if text is None:
        raise ModelError("the network has no contract", path,
                         f"add one with: python -m export onnx stamp {path} CONTRACT.json")
    return contract_from_json(text, path)


def contract_to_json(contract: ModelContract) -> str:
    """The contract as one line of JSON with sorted keys."""
    return json.dumps(contract.to_dict(), sort_keys=True)


def contract_from_json(text: str, where: object) -> ModelContract:
    """Parse and check a contract; keys whose value is null count as absent.

    Parameters
    ----------
    where : object
        The file to name in errors.

    Raises
    ------
    ModelError
        When it is no JSON or no valid contract of this version.
    """
    try:
        value = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ModelError(f"the contract is no JSON ({error})", where, "expected a JSON object") from None
    _check_version(value, where)  # first, since another version may have other keys
    value = _without_nulls(value)
    check(value, where, schema=SCHEMA, error=ModelError)
    tensors = {group: {tensor: _tensor(spec) for tensor, spec in value[group].items()}
               for group in ("inputs", "outputs")}
    try:
        return ModelContract(**_whole(value) | tensors)
    except ModelError as error:
        raise ModelError(error.what, where, error.expected) from None


def _check_version(value: Any, where: object) -> None:
    version = value.get("version") if isinstance(value, dict) else VERSION
    if version != VERSION:
        advice = f", which python -m export onnx restamp {where} makes of version 1" if version == 1 else ""
        raise ModelError(f"contract version {version!r}", where, f"expected version {VERSION}{advice}")


def _without_nulls(contract: Any) -> Any:
    """A copy without null values of the contract itself and of its tensors."""
    contract = _drop_nulls(contract)
    for group in ("inputs", "outputs"):
        if isinstance(contract, dict) and isinstance(tensors := contract.get(group), dict):
            contract[group] = {tensor: _drop_nulls(spec) for tensor, spec in tensors.items()}
    return contract


def _drop_nulls(value: Any) -> Any:
    return {k: v for k, v in value.items() if v is not None} if isinstance(value, dict) else value


def _tensor(spec: dict[str, Any]) -> TensorSpec:
    return TensorSpec(**_whole(spec) | {"channels": tuple(spec["channels"])})


def _whole(value: dict[str, Any]) -> dict[str, Any]:
    """A copy with integers where the schema asks for such: in JSON 8.0 is one."""
    return {k: int(v) if k in ("multiple_of", "version", "size", "rays") else v for k, v in value.items()}


def _refuse(text: str) -> Any:
    raise ValueError(f"{text} is no number")


def _read_metadata(path: Path) -> dict[str, str]:
    """The entries of ``ModelProto.metadata_props``, without onnx or onnxruntime."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"can't read the network ({error.strerror})", path, "expected an .onnx file") from None
    has_graph, entries = False, {}
    try:
        for number, value in _fields(memoryview(data)):
            has_graph |= number == GRAPH
            if number == METADATA_PROPS:
                entry = dict(_fields(value))
                entries[bytes(entry[ENTRY_KEY]).decode()] = bytes(entry[ENTRY_VALUE]).decode()
        if not has_graph:
            raise ValueError("no graph")
    except (ValueError, KeyError, IndexError):
        raise ModelError("not a readable ONNX file", path, "expected a network saved as ONNX") from None
    return entries


def _fields(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Field numbers and contents of a message; https://protobuf.dev/programming-guides/encoding."""
    at = 0
    while at < len(data):
        tag, at = _varint(data, at)
        start = at
        match tag & 7:
            case 0:
                at = _varint(data, at)[1]
            case 1:
                at += 8
            case 2:
                length, start = _varint(data, at)
                at = start + length
            case 5:
                at += 4
            case other:
                raise ValueError(f"wire type {other}")
        if at > len(data):
            raise ValueError("truncated")
        yield tag >> 3, data[start:at]


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """A number of variable length, and the offset behind it."""
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if shift > MAX_VARINT_BITS:
            raise ValueError("number too long")
        if byte < 128:
            return value, at
