"""Scene files -> ``Scene``: OBJ, glTF, GLB and PLY, with the JSON file of the same stem beside them."""

from app.load.cameras import auto_camera, is_camera_keyword, orbit
from app.load.scene import LoadedScene, embedded_scene, load_for_editing, load_scene
from app.load.sidecar import load_camera, parse_camera, parse_light
from app.load.studio import lighting_of

__all__ = ["LoadedScene", "auto_camera", "embedded_scene", "is_camera_keyword", "lighting_of", "load_camera",
           "load_for_editing", "load_scene", "orbit", "parse_camera", "parse_light"]
