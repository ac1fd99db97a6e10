"""The procedural sources by name."""

from __future__ import annotations

from collections.abc import Callable

from export.dataset.blocks import blocks, blocks_by_day, blocks_by_night
from export.dataset.corridor import corridor
from export.dataset.courtyard import courtyard
from export.dataset.diorama import diorama
from export.dataset.hall import hall
from export.dataset.place import Place, Rng
from export.dataset.primitives import primitives
from export.dataset.room import room
from export.dataset.suite import suite

FILES = "files"  # the source that is not procedural
SOURCES: dict[str, Callable[[Rng], Place]] = {
    "room": room, "corridor": corridor, "hall": hall, "courtyard": courtyard, "blocks": blocks,
    "blocks-day": blocks_by_day, "blocks-night": blocks_by_night, "primitives": primitives, "suite": suite,
    "diorama": diorama,
}
