"""The emissive validation scenes by name, and their emitters as the loader treats those of a file."""

from collections.abc import Callable
from dataclasses import replace

from app.load.emitters import find_emitters
from app.load.scene_builder import SceneBuilder
from app.scene import Scene
from export.dataset.scenes.generated_scene import GeneratedScene
from export.validation.scenes.archway_stair import archway_stair
from export.validation.scenes.barred_window import barred_window
from export.validation.scenes.chandelier import chandelier
from export.validation.scenes.door_ajar import door_ajar

EMISSIVE_SOURCES: dict[str, Callable[..., GeneratedScene]] = {
    "door_ajar": door_ajar, "barred_window": barred_window, "archway_stair": archway_stair, "chandelier": chandelier,
}


def with_found_emitters(scene: Scene) -> Scene:
    """The scene as if it had been loaded from a file: emissive surfaces are analytic lights."""
    builder = SceneBuilder(scene.name, list(scene.meshes), list(scene.instances), list(scene.materials),
                           list(scene.lights))
    find_emitters(builder)
    builder.drop_unused()
    return replace(scene, meshes=tuple(builder.meshes), instances=tuple(builder.instances),
                   materials=tuple(builder.materials), lights=tuple(builder.lights), notices=tuple(builder.notices),
                   approximate_lights=builder.approximate_lights,
                   approximated_materials=tuple(builder.approximated_materials))
