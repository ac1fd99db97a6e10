"""What the header of an EXR file says about its picture: the camera, and the names behind ids."""

import json
from collections.abc import Collection

from app.math3d import View
from app.scene import Camera, Scene

CAMERA, INSTANCES, MATERIALS = "afterglow:camera", "afterglow:instances", "afterglow:materials"


def picture_header(scene: Scene, camera: Camera, size: tuple[int, int], outputs: Collection[str]) -> dict[str, str]:
    """Attributes of an EXR file, each a JSON text.

    ``afterglow:camera`` has ``pose``, camera space (looking along -z, y up) to world space, and ``intrinsics`` in
    pixels, with integers in the middle of pixels and y down; or ``orthographic_height`` in scene units. The names of
    ``instance`` and ``material`` ids, counted from 1, are lists.
    """
    view = View.of(camera, size, 1.0)
    lens = ({"intrinsics": view.intrinsics(size).tolist()} if camera.orthographic_height is None
            else {"orthographic_height": camera.orthographic_height})
    header = {CAMERA: json.dumps({"pose": view.pose.tolist(), **lens})}
    if "instance" in outputs:
        header[INSTANCES] = json.dumps([instance.name for instance in scene.instances])
    if "material" in outputs:
        header[MATERIALS] = json.dumps([material.name for material in scene.materials])
    return header
