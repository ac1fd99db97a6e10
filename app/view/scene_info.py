"""What the page is told of the scene once: what there is to choose from, and how large it is."""

from __future__ import annotations

from pathlib import Path

from app.load import Parts
from app.scene import bounds_of
from app.view.protocol import Choices
from app.view.saving import SETTLE
from app.view.state import Json, camera_json


def scene_info(file: Path, parts: Parts, choices: Choices) -> Json:
    """Names to choose from, cameras, extent and where objects are at rest, all in scene units."""
    scene = parts.scene
    centres = {
        name: bounds_of(scene.meshes, tuple(scene.instances[i] for i in members)).mean(axis=0).tolist()
        for name, members in choices.objects.items()}
    return {
        "file": file.name, "triangles": scene.triangles, "models": choices.models, "aovs": choices.aovs,
        "objects": centres, "cameras": {name: camera_json(path.at(0.0)) for name, path in scene.cameras.items()},
        "bounds": scene.bounds.tolist(), "notices": scene.notices, "settle": SETTLE,
        "emitters": len(scene.lights) - parts.own_lights,
    }
