"""Updates ``.onnx`` files with a contract of version 1. Only names differ, so outputs stay the same."""

import json
from pathlib import Path
from typing import Any

import onnx

from app.errors import ModelError
from app.io.atomic_files import replace_file
from app.network.channels import SCREEN
from app.network.contract import KEY, VERSION
from app.network.contract_json import contract_from_json, contract_to_json
from app.network.static_cache import PREFIX, PREVIOUS, RECOMPUTE
from export.onnx.export import load_model

RENAMED_CHANNELS = {
    "lumination.rgb": "surface_and_sky_radiance.rgb",
    "glow.rgb": "emissive_irradiance.rgb",
    "coarse.diffuse.rgb": "unshadowed_environment.diffuse.rgb",
    "coarse.specular.rgb": "unshadowed_environment.specular.rgb",
}
RENAMED_GRIDS = {"vector": "globals"}
RENAMED_KEYS = {"kept_from": "static_input"}
OLD_VERSION = 1
OLD_RECOMPUTE, OLD_PREFIX, OLD_PREVIOUS = "anew", "kept.", ".before"


def restamp(path: Path) -> None:
    """Rename channels, grids, contract keys and the tensors of the static cache in the file at ``path``.

    Raises
    ------
    ModelError
        When the file is not an ONNX model or has no valid contract of version 1.
    """
    model = load_model(path)
    metadata = {p.key: p.value for p in model.metadata_props}
    contract = contract_from_json(json.dumps(_updated(_read_contract(metadata.get(KEY, ""), path), path)), path)
    if contract.static_input is not None:
        _rename_tensors(model.graph)
    onnx.helper.set_model_props(model, metadata | {KEY: contract_to_json(contract)})
    with replace_file(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))


def _read_contract(text: str, path: Path) -> dict[str, Any]:
    try:
        value = json.loads(text)
        if value["version"] == OLD_VERSION:
            return dict(value)
    except (ValueError, TypeError, KeyError, RecursionError):
        pass
    raise ModelError(f"no contract of version {OLD_VERSION}", path, "expected a network of an earlier release")


def _updated(contract: dict[str, Any], path: Path) -> dict[str, Any]:
    updated = {RENAMED_KEYS.get(key, key): value for key, value in contract.items()} | {"version": VERSION}
    try:
        for group in ("inputs", "outputs"):
            updated[group] = {tensor: _updated_tensor(spec) for tensor, spec in contract[group].items()}
    except (AttributeError, KeyError, TypeError):
        raise ModelError(f"damaged contract of version {OLD_VERSION}", path,
                         "expected inputs and outputs by name, each with a list of channels and a grid") from None
    return updated


def _updated_tensor(spec: dict[str, Any]) -> dict[str, Any]:
    grid = spec.get("grid", SCREEN)
    return {**spec, "channels": [RENAMED_CHANNELS.get(name, name) for name in spec["channels"]],
            "grid": RENAMED_GRIDS.get(grid, grid)}


def _rename_tensors(graph: onnx.GraphProto) -> None:
    for value in (*graph.input, *graph.output, *graph.value_info):
        value.name = _new_name(value.name)
    for node in graph.node:
        node.input[:], node.output[:] = map(_new_name, node.input), map(_new_name, node.output)
        for attribute in node.attribute:
            if attribute.HasField("g"):
                _rename_tensors(attribute.g)


def _new_name(tensor: str) -> str:
    if tensor == OLD_RECOMPUTE:
        return RECOMPUTE
    if not tensor.startswith(OLD_PREFIX):
        return tensor
    index, is_input = tensor.removeprefix(OLD_PREFIX).removesuffix(OLD_PREVIOUS), tensor.endswith(OLD_PREVIOUS)
    return f"{PREFIX}{index}{PREVIOUS if is_input else ''}"
