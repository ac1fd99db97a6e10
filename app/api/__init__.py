"""Afterglow from Python: scenes from files, numpy arrays and trimesh objects, and pictures of them as arrays.

Axes are right-handed with y up, colours are linear Rec. 709, radiance is in W/(sr m²). An error in what is passed
raises an ``AfterglowError`` whose text is one line: where, what is wrong, and what was expected.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.api.cameras import camera_from_matrix, camera_matrix, intrinsic_matrix
    from app.api.compare import compare
    from app.api.frame import Frame
    from app.api.reference import path_trace
    from app.api.renderer import Renderer
    from app.api.scene import Scene, SceneObject, load
    from app.api.video import write_video
    from app.errors import AfterglowError
    from app.scene import (
        Camera,
        CameraPath,
        DirectionalLight,
        Environment,
        Intrinsics,
        Material,
        PointLight,
        RectLight,
        SpotLight,
        Texture,
    )

_MODULES = {
    "app.api.cameras": ("camera_from_matrix", "camera_matrix", "intrinsic_matrix"),
    "app.api.compare": ("compare",),
    "app.api.frame": ("Frame",),
    "app.api.reference": ("path_trace",),
    "app.api.renderer": ("Renderer",),
    "app.api.scene": ("Scene", "SceneObject", "load"),
    "app.api.video": ("write_video",),
    "app.errors": ("AfterglowError",),
    "app.scene": ("Camera", "CameraPath", "DirectionalLight", "Environment", "Intrinsics", "Material", "PointLight",
                  "RectLight", "SpotLight", "Texture"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [  # noqa: RUF022  # in the order of use
    "load", "Scene", "SceneObject", "Material", "Texture", "PointLight", "SpotLight", "DirectionalLight", "RectLight",
    "Environment", "Camera", "CameraPath", "Intrinsics", "camera_from_matrix", "camera_matrix", "intrinsic_matrix",
    "Renderer", "Frame", "write_video", "compare", "path_trace",
    "AfterglowError"]


def __getattr__(name: str) -> Any:
    """Import what is asked for; importing everything at once would take seconds."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
