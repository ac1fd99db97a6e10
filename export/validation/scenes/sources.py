"""The emissive validation scenes by name."""

from collections.abc import Callable

from export.dataset.scenes.generated_scene import GeneratedScene
from export.validation.scenes.archway_stair import archway_stair
from export.validation.scenes.barred_window import barred_window
from export.validation.scenes.chandelier import chandelier
from export.validation.scenes.door_ajar import door_ajar

EMISSIVE_SOURCES: dict[str, Callable[..., GeneratedScene]] = {
    "door_ajar": door_ajar, "barred_window": barred_window, "archway_stair": archway_stair, "chandelier": chandelier,
}
