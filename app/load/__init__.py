"""Files -> Scene: OBJ, glTF, GLB and PLY, with the JSON file of the same stem beside them."""

from __future__ import annotations

from app.load.cameras import auto_camera, is_camera_word, orbit
from app.load.scene import Parts, embedded_scene, load_parts, load_scene
from app.load.sidecar import load_camera, parse_camera, parse_light

__all__ = ["Parts", "auto_camera", "embedded_scene", "is_camera_word", "load_camera", "load_parts", "load_scene",
           "orbit", "parse_camera", "parse_light"]
