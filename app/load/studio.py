"""A neutral studio for what comes without light: a soft environment, a key light, and a ground if asked for.

It is a lighting like those of a scene JSON, so that it can be chosen by name and saved.
"""

import math
from collections.abc import Callable

import numpy as np

from app.arrays import F64
from app.errors import SettingsError
from app.load.emission import SurfaceEmission, triangle_radiance
from app.load.free_space import FreeSpace
from app.load.geometry import RawMesh, face_vectors
from app.load.scene_builder import SceneBuilder, vector
from app.load.sidecar import Lighting
from app.math3d import normalize
from app.scene import Camera, DirectionalLight, Material, bounds_of, swept_bounds_of

STUDIO = "studio"       # name of the lighting
# W/m² of a scene's own emission on its bounding box, below which it counts as unlit; the studio gives about 2.5.
MIN_ROOM_IRRADIANCE = 0.05
MIN_OBJECT_IRRADIANCE = 0.25  # whose light mostly leaves it
_ZENITH, _HORIZON = 0.45, 0.22  # radiance; the same below the horizon, so the backdrop has no edge
_KEY_IRRADIANCE = 2.2   # with the environment, just below what shows a white surface as white
_KEY_RADIUS_DEG = 3.0   # a soft edge of its shadow
_KEY_DIRECTION = (0.6, -1.0, 0.5)  # to the right, up and away as the camera sees it
_GROUND_SIZE = 8.0      # times the scene's longest edge
_GROUND_GAP = 1e-4      # below the scene, of its longest edge, so that a flat base hides it


def lighting_of(lighting: str | None, studio: bool | None) -> str | None:
    """The lighting that ``--lighting`` and ``--studio`` ask for.

    Raises
    ------
    SettingsError
        When they contradict each other.
    """
    if studio is False and lighting == STUDIO:
        raise SettingsError("excludes --lighting studio", "--no-studio", "expected only one of them")
    if not studio:
        return lighting
    if lighting not in (None, STUDIO):
        raise SettingsError("excludes --lighting", "--studio", "expected only one of them")
    return STUDIO


def studio_lighting(camera: Camera) -> Lighting:
    """The studio around what ``camera`` sees: light comes from the camera's upper left."""
    forward = normalize(np.subtract(camera.target, camera.eye))
    right = normalize(np.cross(forward, camera.up))
    ahead = normalize(np.cross(camera.up, right))
    direction = normalize(np.array(_KEY_DIRECTION) @ [right, normalize(np.asarray(camera.up, np.float64)), ahead])
    key = DirectionalLight(vector(direction), (_KEY_IRRADIANCE,) * 3, _KEY_RADIUS_DEG)
    return Lighting((key,), environment={"type": "gradient", "zenith": [_ZENITH] * 3, "horizon": [_HORIZON] * 3,
                                         "ground": [_HORIZON] * 3})


def add_ground(builder: SceneBuilder) -> None:
    """Add a large square below a scene, of an albedo with which it looks like the studio's backdrop."""
    bounds = swept_bounds_of(tuple(builder.meshes), tuple(builder.instances))
    edge = float((bounds[1] - bounds[0]).max())
    half, (x, z) = _GROUND_SIZE / 2 * edge, bounds.mean(axis=0)[[0, 2]]
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]) * half
    corners += (x, bounds[0, 1] - _GROUND_GAP * edge, z)
    builder.materials.append(Material("studio ground", albedo=(_ground_albedo(),) * 3))
    mesh = builder.add_mesh("studio ground", RawMesh(corners, np.array([[0, 1, 2], [0, 2, 3]])),
                            len(builder.materials) - 1)
    if mesh is not None:
        builder.add_instance("studio ground", mesh, np.eye(4))


def _ground_albedo() -> float:
    # Irradiance by the environment: the integral of radiance, linear in elevation e, times sin e cos e, over azimuth.
    environment = math.pi * (_HORIZON + (_ZENITH - _HORIZON) / 2)
    key = _KEY_IRRADIANCE * -float(normalize(np.array(_KEY_DIRECTION))[1])
    return math.pi * _HORIZON / (environment + key)


def is_dark(builder: SceneBuilder, space: Callable[[], FreeSpace]) -> bool:
    """Whether the emission of a scene's surfaces, if it has any, lights next to nothing.

    What counts is its irradiance on the scene's bounding box, as if all of its light arrived there.
    """
    x, y, z = np.ptp(bounds_of(tuple(builder.meshes), tuple(builder.instances)), axis=0).tolist()
    power, area = _emitted_power(builder), 2 * (x * y + y * z + z * x)
    return power <= MIN_ROOM_IRRADIANCE * area or (power <= MIN_OBJECT_IRRADIANCE * area and not space().is_room)


def why_dark(builder: SceneBuilder) -> str:
    """Why a scene is lit that is dark, for a notice."""
    emits = any(m.emits for m in builder.materials)
    return "the scene's emission lights next to nothing" if emits else "the scene has no light"


def _emitted_power(builder: SceneBuilder) -> float:
    """Mean power over the channels that all surfaces emit, W."""
    total = 0.0
    radiances: dict[int, F64] = {}
    for instance in builder.instances:
        mesh = builder.meshes[instance.mesh]
        material = builder.materials[mesh.material]
        if not material.emits:
            continue
        if instance.mesh not in radiances:
            radiances[instance.mesh] = triangle_radiance(mesh, SurfaceEmission(material)).mean(axis=1)
        world = mesh.positions @ instance.transform_at(0.0)[:3, :3].T
        areas = np.linalg.norm(face_vectors(world, mesh.triangles), axis=1) / 2
        total += math.pi * float(areas @ radiances[instance.mesh]) * (2 if material.double_sided else 1)
    return total
