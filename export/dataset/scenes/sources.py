"""The procedural sources by name."""

from __future__ import annotations

from collections.abc import Callable

from export.dataset.scenes.blocks import blocks, blocks_by_day, blocks_by_night
from export.dataset.scenes.connected_rooms import connected_rooms
from export.dataset.scenes.corridor import corridor
from export.dataset.scenes.courtyard import courtyard
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.hall import hall
from export.dataset.scenes.open_box import open_box
from export.dataset.scenes.primitives import primitives
from export.dataset.scenes.room import room

FILES = "files"  # the source that is not procedural
SOURCES: dict[str, Callable[[Rng], GeneratedScene]] = {
    "room": room, "corridor": corridor, "hall": hall, "courtyard": courtyard, "blocks": blocks,
    "blocks-day": blocks_by_day, "blocks-night": blocks_by_night, "primitives": primitives, "connected_rooms": connected_rooms,
    "open_box": open_box,
}
