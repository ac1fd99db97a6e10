"""The state as a scene JSON, and as the command that draws the same picture without a viewer."""

from __future__ import annotations

import json
from pathlib import Path

from app.evaluation.configurations import NONE, PRECISIONS
from app.io.atomic_files import write_text
from app.load import Parts
from app.network.contract import HALF, SSGI, UNSHADOWED
from app.view.state import Json, State, camera_json, light_json

CLASSICAL = (NONE, SSGI, UNSHADOWED)  # models that are no networks
NAME = "view"  # of the camera and the lighting


def scene_json(state: State, parts: Parts) -> Json:
    """A scene JSON whose default camera and lighting are those of ``state``.

    Motions that the scene's own JSON has are kept, and its environment, whose image is named by its full path.
    """
    lighting: Json = {"lights": [light_json(light) for light in state.lights]}
    own = parts.lighting
    if own is not None:
        lighting["emission"] = own.emission
        if own.environment is not None:
            lighting["environment"] = _anchored(own.environment, parts.sidecar.path or Path())
    cameras = {**{name: camera_json(camera) for name, camera in state.bookmarks}, NAME: camera_json(state.camera)}
    moved = {name: {"keys": [{"time": 0, "translate": place}]} for name, place in state.places}
    return {"cameras": cameras, "lightings": {NAME: lighting}, "objects": {**_motions(parts), **moved},
            "default": {"camera": NAME, "lighting": NAME}}


def write_scene_json(path: Path, state: State, parts: Parts) -> None:
    """Write ``scene_json`` in one step."""
    write_text(path, json.dumps(scene_json(state, parts), indent=1) + "\n")


def arguments(state: State, scene: Path, file: Path | str, settle: int, aovs: tuple[str, ...], formats: str,
              provider: str) -> list[str]:
    """What ``python -m app`` is to be told to draw ``state``, whose scene JSON is ``file``."""
    found = [str(scene), "--scene-json", str(file), "--size", f"{state.size[0]}x{state.size[1]}",
             "--settle", str(settle), "--exposure", repr(state.exposure), "--model", model_name(state),
             "--aov", ",".join(aovs), "--format", formats, "--provider", provider]
    if state.environment:
        found += ["--model", state.environment]
    if state.scale and not {state.model, state.environment} <= {*CLASSICAL, ""}:
        found += ["--scale", repr(state.scale)]
    bounces = bounces_of(state, state.model)
    if bounces is not None:
        found += ["--bounces", str(bounces)]
    return found + ([] if state.taa else ["--no-taa"])


def bounces_of(state: State, model: str) -> int | None:
    """Those that ``model`` is held to: none where it makes no indirect light."""
    return None if model == NONE else state.bounces


def model_name(state: State) -> str:
    """The model in the precision that was chosen, as ``--model`` takes it."""
    if not state.precision or state.model in CLASSICAL:
        return state.model
    path = Path(state.model)
    return str(path.with_stem(path.stem.removesuffix(HALF) + PRECISIONS[state.precision]))


def _anchored(environment: Json, beside: Path) -> Json:
    if "file" not in environment:
        return environment
    return {**environment, "file": str((beside.resolve().parent / environment["file"]).resolve())}


def _motions(parts: Parts) -> Json:
    if parts.sidecar.path is None or not parts.sidecar.objects:
        return {}
    return json.loads(parts.sidecar.path.read_text("utf-8-sig"))["objects"]
