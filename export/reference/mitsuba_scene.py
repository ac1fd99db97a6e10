"""A ``Scene`` as Mitsuba scenes with the same triangles, textures, masks and emitters.

As in the renderer, lights have no bodies: they emit but block no rays. Meshes and emitters therefore live in separate
Mitsuba scenes; the lights of ``Scene.lights`` are in ``analytic_lights.py``. Where they only approximate emissive
meshes, the meshes emit instead. Lengths are scaled, because Mitsuba's ray
offsets suit scenes of a few tens of units.
"""

from dataclasses import dataclass
from typing import Any

from app.arrays import F64
from app.scene import Scene
from export.reference.mitsuba_lights import SUN_DISTANCE, convert_environment, convert_light
from export.reference.mitsuba_meshes import MeshConverter
from export.reference.mitsuba_module import load_mitsuba
from export.reference.surfaces import SurfaceTable

EXTENT = 40.0  # longest edge of the scaled scene


@dataclass(frozen=True, eq=False)
class MitsubaScene:
    """Meshes and emitters, with ``scaled = (world - origin) * scale``. A scene without content is None.

    Attributes
    ----------
    meshes : mitsuba.Scene
        All meshes.
    surfaces : SurfaceTable
        What is at each point of them.
    shadow_casters : mitsuba.Scene or None
        All meshes but those that are exactly analytic lights.
    approximated, emissive, environment : mitsuba.Scene or None
        Emissive meshes that the renderer's lights only approximate; those that are no light proxies; the environment.
    combined : dict
        All of it and the exact analytic lights as one scene for Mitsuba's own integrators, in which lights have bodies.
    notices : tuple of str
        What the path tracer renders differently from the renderer.
    """

    meshes: Any
    surfaces: SurfaceTable
    shadow_casters: Any
    approximated: Any
    emissive: Any
    environment: Any
    combined: dict[str, Any]
    origin: F64
    scale: float
    notices: tuple[str, ...]


def convert_scene(scene: Scene, time: float = 0.0) -> MitsubaScene:
    """Build the Mitsuba scenes, with instances where they are at ``time`` seconds.

    Raises
    ------
    DeviceError
        When Mitsuba can't run here.
    """
    mi = load_mitsuba()
    origin, scale = scene.bounds.mean(axis=0), EXTENT / scene.longest_edge
    converter = MeshConverter(mi, scene, time, origin, scale)
    meshes: dict[str, Any] = {f"mesh{i}": converter.convert(instance) for i, instance in enumerate(scene.instances)}
    shadow_casters: dict[str, Any] = {}
    approximated: dict[str, Any] = {}
    emissive: dict[str, Any] = {}
    for (key, mesh), instance in zip(meshes.items(), scene.instances, strict=True):
        index = scene.meshes[instance.mesh].material
        material, is_approximated = scene.materials[index], index in scene.approximated_materials
        emitters = {}
        if material.emits:
            emitters = {f"{key}side{side}": converter.convert(instance, side)
                        for side in ((1, -1) if material.double_sided else (1,))}
        if is_approximated:
            approximated |= emitters
        elif not material.is_light_proxy:
            emissive |= emitters
        if is_approximated or not material.is_light_proxy:
            shadow_casters[key] = mesh
    lights = {f"light{i}part{k}": emitter for i, light in enumerate(scene.exact_lights)
              for k, emitter in enumerate(convert_light(mi, light, origin, scale))}
    environment = {} if scene.environment is None else {"environment": convert_environment(mi, scene.environment)}

    # Mitsuba starts directional and environment light at the bounds of the emitter's own scene.
    bounds = {"type": "sphere", "radius": SUN_DISTANCE}

    def load(part: dict[str, Any], **extra: Any) -> Any:
        # Merging and parallel loading shuffle the emitters, and so the image, from run to run.
        return mi.load_dict({"type": "scene"} | part | extra, parallel=False, optimize=False) if part else None

    return MitsubaScene(
        load(meshes), SurfaceTable(mi, scene, list(meshes.values()), time, scale), load(shadow_casters),
        load(approximated), load(emissive), load(environment, bounds=bounds),
        {"type": "scene"} | meshes | lights | approximated | emissive | environment, origin, scale,
        tuple(dict.fromkeys(converter.notices)))
