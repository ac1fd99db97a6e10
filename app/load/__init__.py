"""Files -> Scene: OBJ, glTF, GLB and PLY, with the JSON file of the same stem beside them."""

from __future__ import annotations

from app.load.scene import embedded_scene, load_scene
from app.load.sidecar import load_camera
from app.load.views import auto_camera, orbit

__all__ = ["auto_camera", "embedded_scene", "load_camera", "load_scene", "orbit"]
