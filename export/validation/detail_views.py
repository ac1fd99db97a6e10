"""Views at the size that people draw, with furniture and other detail near the camera.

Every scene file has one, furnished ones two. Half of the views are for development; the others are kept aside for
final figures, and nothing was ever tuned on them.
"""

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

from app.load import load_scene
from app.scene import Camera
from export.reference.still import Still
from export.validation.views import View, views

SIZE = (1024, 768)
LISTED = {  # names in the validation list, and whether the view is kept aside
    "cornell-box-emissive-0": False, "cornell-box-emissive-2": True, "sponza-lamp-1": False, "sponza-sun-0": True,
    "breakfast-room-lamp-3": False, "breakfast-room-lamp-0": True, "country-kitchen-emissive-3": False,
    "country-kitchen-emissive-0": True, "contemporary-bathroom-emissive-3": False,
    "contemporary-bathroom-emissive-0": True, "stanford-emissive-1": False, "stanford-lamp-0": True,
}
OTHERS = {  # file, lighting, camera (None: the file's own) of further views, and whether they are kept aside
    "grey-white-room-sun-near": ("grey-white-room/grey-white-room.glb", "sun",
                                 Camera((4.5, 1.4, -3.5), (1.5, 0.5, -1.0), fov_y_deg=50.0), False),
    "grey-white-room-lamp": ("grey-white-room/grey-white-room.glb", "lamp", None, True),
    "sibenik-lamp-near": ("sibenik/sibenik.obj", "lamp",
                          Camera((8.0, -12.5, 2.5), (-4.0, -11.0, -3.0), fov_y_deg=60.0), False),
    "sibenik-lamp": ("sibenik/sibenik.obj", "lamp", None, True),
}
NAMES = (*LISTED, *OTHERS)
KEPT_ASIDE = frozenset(name for name in NAMES if (LISTED.get(name) or (name in OTHERS and OTHERS[name][3])))


def detail_views(scenes: Path, only: Collection[str] = ()) -> Iterator[View]:
    """All views, or those that ``only`` names, one at a time.

    Raises
    ------
    SceneError
        When a scene file is missing or differs from the listed one.
    """
    chosen = only or NAMES
    listed = [name for name in LISTED if name in chosen]
    for view in views(scenes, names=listed) if listed else ():
        yield replace(view, still=replace(view.still, size=SIZE))
    for name, (file, lighting, camera, _) in OTHERS.items():
        if name in chosen:
            scene = load_scene(scenes / file, lighting=lighting)
            seen = camera or scene.cameras[scene.default_camera].at(0.0)
            yield View(name, Path(file).stem, Still(scene, seen, SIZE))
