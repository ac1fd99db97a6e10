"""The procedural sources by name."""

from collections.abc import Callable
from functools import partial

from export.dataset.scenes.blocks import blocks
from export.dataset.scenes.cluttered_room import cluttered_room
from export.dataset.scenes.connected_rooms import connected_rooms
from export.dataset.scenes.corridor import corridor
from export.dataset.scenes.courtyard import courtyard
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.hall import hall
from export.dataset.scenes.open_box import open_box
from export.dataset.scenes.primitives import primitives
from export.dataset.scenes.room import room

FILES = "files"  # the source of scene files
SOURCES: dict[str, Callable[[Rng], GeneratedScene]] = {
    "room": room, "connected_rooms": connected_rooms, "open_box": open_box, "corridor": corridor, "hall": hall,
    "courtyard": courtyard, "blocks": blocks, "blocks-day": partial(blocks, night=False),
    "blocks-night": partial(blocks, night=True), "primitives": primitives, "cluttered_room": cluttered_room,
}
