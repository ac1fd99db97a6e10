"""A catalogue of the user's own scenes and models: a JSON file that follows ``golden.schema.json``."""

import re
from pathlib import Path
from typing import Any

from app.errors import ModelError, SceneError, did_you_mean
from app.golden.case import Case
from app.golden.catalogue import SETTLING_FRAMES, with_networks
from app.golden.scene_case import SceneCase, Shot
from app.io.checked_json import at, read_checked
from app.load import load_scene
from app.network.selection import Model, find_model
from app.scene import Scene

SCHEMA = "golden.schema.json"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # also the name of a folder


def read_catalogue(path: Path) -> dict[str, Case]:
    """All cases of a catalogue file by name, including those of its networks alone; loads the scenes.

    Raises
    ------
    SceneError
        When the file or a scene can't be read, or a key is invalid; names the key.
    ModelError
        When there is no such model.
    """
    document = read_checked(path, schema=SCHEMA)
    cases = [_case(name, spec, path) for name, spec in document["cases"].items()]
    return {case.name: case for case in with_networks(cases)}


def _case(name: str, spec: dict[str, Any], path: Path) -> SceneCase:
    if not NAME.fullmatch(name):
        raise SceneError(f"invalid name {name!r} of a case", at(path, "cases", name),
                         "expected letters, digits, - and _")
    scene_json = spec.get("scene_json")
    scene = load_scene(path.parent / spec["scene"], lighting=spec.get("lighting"), variant=spec.get("variant"),
                       scene_json=path.parent / scene_json if scene_json else None)
    shots = tuple(_shot(s, scene, at(path, "cases", name, "shots", i, "camera"))
                  for i, s in enumerate(spec.get("shots", [{}])))
    last = sum(shot.frames for shot in shots)
    golden_frames = tuple(sorted({int(n) for n in spec.get("kept", [last])}))
    if golden_frames[-1] > last:
        raise SceneError(f"no frame {golden_frames[-1]}", at(path, "cases", name, "kept"),
                         f"expected frames from 1 to {last}, the length of all shots together")
    width, height = (int(n) for n in spec.get("size", SceneCase.size))
    return SceneCase(name, scene, _model(spec.get("model", "none"), path, at(path, "cases", name, "model")), shots,
                     golden_frames, (width, height), spec.get("taa", True))


def _shot(spec: dict[str, Any], scene: Scene, where: str) -> Shot:
    camera = spec.get("camera", scene.default_camera)
    if camera not in scene.cameras:
        raise SceneError(f"no camera {camera!r}", where, did_you_mean(camera, list(scene.cameras)))
    return Shot(camera, int(spec.get("frames", SETTLING_FRAMES)))


def _model(name: str, path: Path, where: str) -> Model | None:
    """A file beside the catalogue takes precedence over a bundled network of that name."""
    if name == "none":
        return None
    beside = path.parent / name
    try:
        return beside if beside.is_file() else find_model(name)
    except ModelError as error:
        raise ModelError(error.what, where, error.expected) from None
