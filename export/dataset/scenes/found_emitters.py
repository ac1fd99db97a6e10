"""Emitters of a generated scene, treated as the loader treats those of a file."""

from dataclasses import replace

from app.load.emitters import find_emitters
from app.load.scene_builder import SceneBuilder
from app.scene import Scene


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
