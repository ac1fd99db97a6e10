"""The state as a scene JSON, and as the command that renders the same image without the viewer."""

import json
from pathlib import Path

from app.evaluation.configurations import PRECISIONS
from app.io.atomic_files import write_text
from app.load import LoadedScene
from app.network.selection import HALF_SUFFIX, NONE, SSGI, UNSHADOWED
from app.settings import TONE_MAPS
from app.view.state import Json, State, camera_to_json, light_to_json

CLASSICAL_MODELS = (NONE, SSGI, UNSHADOWED)  # without a network
VIEW_NAME = "view"  # of the camera and the lighting


def write_scene_json(path: Path, state: State, loaded: LoadedScene) -> None:
    """Write atomically a scene JSON whose default camera and lighting are those of ``state``.

    It keeps the up axis, the motions and the environment of the scene's own JSON; the environment's image is named by
    its full path.
    """
    lighting: Json = {"lights": [light_to_json(light) for light in state.lights]}
    own = loaded.lighting
    if own is not None:
        lighting["emission"] = own.emission
        if own.environment is not None:
            lighting["environment"] = _with_full_path(own.environment, loaded.sidecar.path or Path())
    cameras = {**{name: camera_to_json(camera) for name, camera in state.bookmarks},
               VIEW_NAME: camera_to_json(state.camera)}
    moved = {name: {"keys": [{"time": 0, "translate": offset}]} for name, offset in state.object_offsets}
    content = {"cameras": cameras, "lightings": {VIEW_NAME: lighting}, "objects": {**_read_motions(loaded), **moved},
               "default": {"camera": VIEW_NAME, "lighting": VIEW_NAME},
               **({"up_axis": "z"} if loaded.sidecar.has_z_up else {})}
    write_text(path, json.dumps(content, indent=1) + "\n")


def render_arguments(state: State, scene: Path, scene_json: Path | str, settle: int, aovs: tuple[str, ...],
                     formats: str, provider: str, animation: str | None = None,
                     variant: str | None = None) -> list[str]:
    """Return the arguments with which ``python -m app`` renders ``state`` from its scene JSON."""
    arguments = [str(scene), "--scene-json", str(scene_json), "--size", f"{state.size[0]}x{state.size[1]}",
                 "--settle", str(settle), "--exposure", repr(state.exposure), "--model", precise_model(state),
                 "--aov", ",".join(aovs), "--format", formats, "--provider", provider]
    arguments += ["--tonemap", state.tonemap] if state.tonemap != TONE_MAPS[0] else []
    arguments += ["--auto-exposure"] if state.auto_exposure else []
    arguments += content_arguments(state, animation, variant)
    if state.environment:
        arguments += ["--model", state.environment]
    if state.scale and not {state.model, state.environment} <= {*CLASSICAL_MODELS, ""}:
        arguments += ["--scale", repr(state.scale)]
    bounces = bounces_for(state, state.model)
    if bounces is not None:
        arguments += ["--bounces", str(bounces)]
    switched_off = [("--no-reflections", state.reflections), ("--no-taa", state.taa)]
    return [*arguments, *(option for option, is_on in switched_off if not is_on)]


def content_arguments(state: State, animation: str | None, variant: str | None) -> list[str]:
    """Return the arguments for what a file contains, for ``python -m app`` and ``python -m export reference``."""
    return [*(["--variant", variant] if variant is not None else []),
            *(["--animation", animation] if animation is not None else []),
            *(["--time", repr(state.time)] if state.time else [])]


def bounces_for(state: State, model: str) -> int | None:
    """Return the number of bounces for ``model``; None if it is the model's own, or no model makes indirect light."""
    return None if model == NONE else state.bounces


def precise_model(state: State) -> str:
    """Return the model in the chosen precision, as ``--model`` takes it."""
    if not state.precision or state.model in CLASSICAL_MODELS:
        return state.model
    path = Path(state.model)
    return str(path.with_stem(path.stem.removesuffix(HALF_SUFFIX) + PRECISIONS[state.precision]))


def _with_full_path(environment: Json, scene_json: Path) -> Json:
    if "file" not in environment:
        return environment
    return {**environment, "file": str((scene_json.resolve().parent / environment["file"]).resolve())}


def _read_motions(loaded: LoadedScene) -> Json:
    if loaded.sidecar.path is None or not loaded.sidecar.objects:
        return {}
    return json.loads(loaded.sidecar.path.read_text("utf-8-sig"))["objects"]
