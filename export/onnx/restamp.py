"""Brings an ``.onnx`` file with a contract of version 1 up to date: only names differ, so its outputs stay the same."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import onnx

from app.errors import ModelError
from app.io.atomic_files import replacing
from app.network.contract import KEY, VERSION, ModelContract
from app.network.static_cache import PREFIX, PREVIOUS, RECOMPUTE
from export.onnx.export import load_model

CHANNELS = {
    "lumination.rgb": "surface_and_sky_radiance.rgb",
    "glow.rgb": "emissive_irradiance.rgb",
    "coarse.diffuse.rgb": "unshadowed_environment.diffuse.rgb",
    "coarse.specular.rgb": "unshadowed_environment.specular.rgb",
}
GRIDS = {"vector": "globals"}
KEYS = {"kept_from": "static_input"}
OLD_RECOMPUTE, OLD_PREFIX, OLD_PREVIOUS = "anew", "kept.", ".before"


def restamp(path: Path) -> None:
    """Rename channels, grids, contract keys and the cache's tensors in the file at ``path``.

    Raises
    ------
    ModelError
        When the file is no ONNX model or has no contract of version 1.
    """
    model = load_model(path)
    metadata = {p.key: p.value for p in model.metadata_props}
    old = _read(metadata.get(KEY, ""), path)
    contract = ModelContract.from_json(json.dumps(_renamed(old)), path)
    if contract.static_input is not None:
        _rename_tensors(model.graph)
    onnx.helper.set_model_props(model, metadata | {KEY: contract.to_json()})
    with replacing(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))


def _read(text: str, path: Path) -> dict[str, Any]:
    try:
        value = json.loads(text)
        if value["version"] == 1:
            return dict(value)
    except (ValueError, TypeError, KeyError):
        pass
    raise ModelError("no contract of version 1", path, "expected a network stamped by an earlier release")


def _renamed(old: dict[str, Any]) -> dict[str, Any]:
    new = {KEYS.get(key, key): value for key, value in old.items()} | {"version": VERSION}
    for group in ("inputs", "outputs"):
        new[group] = {tensor: {**spec, "channels": [CHANNELS.get(name, name) for name in spec["channels"]],
                               "grid": GRIDS.get(spec.get("grid", "screen"), spec.get("grid", "screen"))}
                      for tensor, spec in old[group].items()}
    return new


def _rename_tensors(graph: onnx.GraphProto) -> None:
    for value in (*graph.input, *graph.output, *graph.value_info):
        value.name = _tensor(value.name)
    for node in graph.node:
        node.input[:], node.output[:] = _tensors(node.input), _tensors(node.output)
        for attribute in node.attribute:
            if attribute.HasField("g"):
                _rename_tensors(attribute.g)


def _tensors(names: Iterable[str]) -> list[str]:
    return [_tensor(name) for name in names]


def _tensor(name: str) -> str:
    if name == OLD_RECOMPUTE:
        return RECOMPUTE
    if not name.startswith(OLD_PREFIX):
        return name
    index, previous = name.removeprefix(OLD_PREFIX).removesuffix(OLD_PREVIOUS), name.endswith(OLD_PREVIOUS)
    return f"{PREFIX}{index}{PREVIOUS if previous else ''}"
