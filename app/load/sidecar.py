"""The scene JSON beside a scene file: named cameras, named lightings and moving objects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import SceneError
from app.io.checked_json import at, check, read_checked
from app.load.motion import MotionKey, motion_key
from app.load.scene_builder import vector
from app.scene import Camera, CameraPath, DirectionalLight, Intrinsics, Light, PointLight, RectLight, SpotLight

_MAX_EDGE_COSINE = 1e-3  # between the edges of a rectangle


@dataclass(frozen=True)
class Lighting:
    """Lights, a factor on the emission of the file's surfaces, and the environment's JSON."""

    lights: tuple[Light, ...]
    emission: float = 1.0
    environment: dict[str, Any] | None = None


@dataclass(frozen=True)
class Sidecar:
    """The content of a scene JSON; empty if there is none. ``has_z_up`` says so of the scene file."""

    path: Path | None = None
    cameras: dict[str, CameraPath] = field(default_factory=dict)
    lightings: dict[str, Lighting] = field(default_factory=dict)
    objects: dict[str, tuple[MotionKey, ...]] = field(default_factory=dict)
    has_z_up: bool = False
    default_camera: str | None = None
    default_lighting: str | None = None


def read_sidecar(path: Path) -> Sidecar:
    """Read and check a scene JSON.

    Raises
    ------
    SceneError
        When the file can't be read or is invalid; the error names the key, such as ``cameras.main.fov_y_deg``.
    """
    content = read_checked(path)
    default = content.get("default", {})
    return Sidecar(
        path=path,
        cameras={n: _camera_path(c, path, "cameras", n) for n, c in content.get("cameras", {}).items()},
        lightings={n: _lighting(spec, path, n) for n, spec in content.get("lightings", {}).items()},
        objects={n: _motion_keys(spec["keys"], path, n) for n, spec in content.get("objects", {}).items()},
        has_z_up=content.get("up_axis") == "z",
        default_camera=default.get("camera"),
        default_lighting=default.get("lighting"),
    )


def load_camera(path: str | Path) -> CameraPath:
    """Read a JSON file with one camera, fixed or key-framed, in the form of ``cameras`` in a scene JSON.

    Raises
    ------
    SceneError
        When the file can't be read or is invalid; the error names the key.
    """
    return _camera_path(read_checked(Path(path), "camera"), Path(path))


def parse_camera(spec: Any, where: object) -> Camera:
    """A fixed camera in the form of a scene JSON; a ``SceneError`` names ``where`` and the key."""
    check(spec, where, "fixed_camera")
    return _camera(spec, where)


def parse_light(spec: Any, where: object) -> Light:
    """A light in the form of a scene JSON; a ``SceneError`` names ``where`` and the key."""
    check(spec, where, "light")
    return _light(spec, where)


def _camera_path(spec: dict[str, Any], path: Path, *keys: object) -> CameraPath:
    if "keys" not in spec:
        return CameraPath.still(_camera(spec, path, *keys))
    times = _times(spec["keys"], path, *keys)
    cameras = tuple(_camera(k, path, *keys, "keys", i) for i, k in enumerate(spec["keys"]))
    if len({(c.orthographic_height is None, c.intrinsics is None) for c in cameras}) > 1:
        raise SceneError("keys have different kinds of projection", at(path, *keys, "keys"),
                         "expected orthographic_height, or intrinsics, in every key or in none")
    return CameraPath(times, cameras)


def _camera(spec: dict[str, Any], path: object, *keys: object) -> Camera:
    values: dict[str, Any] = {k: vector(v) if isinstance(v, list) else v for k, v in spec.items() if k != "time"}
    if "intrinsics" in values:
        if "orthographic_height" in values:
            raise SceneError("a camera has intrinsics and orthographic_height", at(path, *keys),
                             "expected at most one of them")
        values["intrinsics"] = Intrinsics(**values["intrinsics"])
    camera = Camera(**values)
    forward = np.subtract(camera.target, camera.eye)
    if not np.any(forward):
        raise SceneError("eye and target are the same point", at(path, *keys), "expected two different points")
    sideways = np.cross(forward, camera.up)
    if np.linalg.norm(sideways) <= 1e-9 * np.linalg.norm(forward) * np.linalg.norm(camera.up):
        raise SceneError("up has no length or points along the view", at(path, *keys, "up"),
                         "expected a vector at an angle to the view")
    return camera


def _lighting(spec: dict[str, Any], path: Path, name: str) -> Lighting:
    lights = tuple(_light(light, path, "lightings", name, "lights", i)
                   for i, light in enumerate(spec.get("lights", [])))
    return Lighting(lights, spec.get("emission", 1.0), spec.get("environment"))


def _light(spec: dict[str, Any], path: object, *keys: object) -> Light:
    values: dict[str, Any] = {k: vector(v) if isinstance(v, list) else v for k, v in spec.items()}
    kind = values.pop("type")
    if kind in ("point", "sphere"):
        return PointLight(**values)
    if kind == "directional":
        return DirectionalLight(**values | {"direction": _unit(values["direction"], path, *keys, "direction")})
    if kind == "rectangle":
        if not span_rectangle(values["edge_u"], values["edge_v"]):
            raise SceneError("edge_u and edge_v do not span a rectangle", at(path, *keys),
                             "expected two edges at a right angle, neither of length 0")
        return RectLight(**values)
    return _spot(values, path, *keys)


def span_rectangle(edge_u: Sequence[float], edge_v: Sequence[float]) -> bool:
    """Whether two edges are perpendicular and neither has length 0."""
    u, v = np.array(edge_u), np.array(edge_v)
    lengths = float(np.linalg.norm(u) * np.linalg.norm(v))
    return bool(abs(u @ v) <= _MAX_EDGE_COSINE * lengths and np.any(np.cross(u, v)))


def _spot(values: dict[str, Any], path: object, *keys: object) -> SpotLight:
    if ("target" in values) == ("direction" in values):
        raise SceneError("a spot needs a target or a direction", at(path, *keys),
                         "expected exactly one of target and direction")
    if values["outer_deg"] < values["inner_deg"]:
        raise SceneError(f"outer_deg {values['outer_deg']:g} is below inner_deg {values['inner_deg']:g}",
                         at(path, *keys, "outer_deg"), "expected at least inner_deg")
    key = "target" if "target" in values else "direction"
    direction = values.pop(key)
    if key == "target":
        direction = np.subtract(direction, values["position"])
    return SpotLight(direction=_unit(direction, path, *keys, key), **values)


def _unit(values: Sequence[float], path: object, *keys: object) -> tuple[float, float, float]:
    length = float(np.linalg.norm(values))
    if length == 0:
        raise SceneError("the direction has length 0", at(path, *keys), "expected a vector that is not zero")
    return vector(np.asarray(values) / length)


def _motion_keys(keys: Sequence[Mapping[str, Any]], path: Path, name: str) -> tuple[MotionKey, ...]:
    _times(keys, path, "objects", name)
    if len({isinstance(k["rotate_deg"], dict) for k in keys if "rotate_deg" in k}) > 1:
        raise SceneError("rotations have two different forms", at(path, "objects", name, "keys"),
                         "expected three angles in every key, or axis and angle_deg in every key")
    return tuple(motion_key(k) for k in keys)


def _times(keys: Sequence[Mapping[str, Any]], path: Path, *where: object) -> tuple[float, ...]:
    times = tuple(float(k["time"]) for k in keys)
    for i in range(1, len(times)):
        if times[i] <= times[i - 1]:
            raise SceneError(f"time {times[i]:g} after {times[i - 1]:g}", at(path, *where, "keys", i, "time"),
                             "expected increasing times")
    return times
