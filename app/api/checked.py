"""What a program passes, checked and brought into plain form: tuples of floats, each finite and within its range.

Files are checked by their schemas. The data classes of scenes take anything, so what a program builds is checked here,
when it is added or drawn.
"""

import math
from collections.abc import Iterable
from dataclasses import fields, is_dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from app.arrays import F64
from app.errors import SceneError, SettingsError
from app.load.scene_builder import MAX_COORDINATE, MAX_RADIANCE, vector
from app.load.sidecar import span_rectangle
from app.math3d import normalize
from app.scene import (
    Camera,
    CameraPath,
    DirectionalLight,
    EmissionImage,
    Environment,
    Light,
    Material,
    RectLight,
    SpotLight,
    Texture,
)

T = TypeVar("T")
Range = tuple[float, float]

MAX_INTRINSIC = 1e6  # pixels
MAX_SHOWN = 40       # characters of a bad value
_FINITE: Range = (-1e30, 1e30)
_SHARE: Range = (0.0, 1.0)
_COORDINATE: Range = (-MAX_COORDINATE, MAX_COORDINATE)
_RADIANCE: Range = (0.0, MAX_RADIANCE)
_RANGES: dict[str, Range] = {  # of fields by name, as in scene.schema.json
    "eye": _COORDINATE, "target": _COORDINATE, "position": _COORDINATE, "center": _COORDINATE,
    "fov_y_deg": (1e-6, 180 - 1e-6), "orthographic_height": (1e-15, MAX_COORDINATE),
    "fx": (1e-3, MAX_INTRINSIC), "fy": (1e-3, MAX_INTRINSIC),
    "width": (1e-3, MAX_INTRINSIC), "height": (1e-3, MAX_INTRINSIC),
    "intensity": _RADIANCE, "irradiance": _RADIANCE, "radiance": _RADIANCE, "emission": _RADIANCE,
    "radius": (0.0, MAX_COORDINATE), "angular_radius_deg": (0.0, 90 - 1e-6), "inner_deg": (0.0, 90.0),
    "outer_deg": (1e-6, 90.0),
    "albedo": _SHARE, "alpha": _SHARE, "alpha_cutoff": _SHARE, "metallic": _SHARE, "roughness": _SHARE,
    "specular": _SHARE, "occlusion_strength": _SHARE, "strength": _SHARE, "factor": _SHARE, "color": _SHARE,
    "attenuation_color": _SHARE, "thickness": (0.0, MAX_COORDINATE), "attenuation_distance": (0.0, math.inf),
    "ior": (1.0, 1e30),
}


def check_camera(camera: Camera, where: str = "camera") -> Camera:
    """``camera`` in plain form.

    Raises
    ------
    SceneError
        When a value is not finite or out of range, or when the eye is at the target.
    """
    plain = _plain(camera, Camera, where)
    if plain.eye == plain.target:
        raise SceneError("eye and target are the same point", where, "expected two different points")
    return plain


def check_cameras(cameras: dict[str, Any]) -> dict[str, CameraPath]:
    """The cameras of a scene, by name.

    Raises
    ------
    SceneError
        When something else is among them.
    """
    if not isinstance(cameras, dict):
        raise SceneError(f"bad cameras {_shown(cameras)}", "cameras", "expected a dict of cameras by name")
    for name, camera in cameras.items():
        if not isinstance(camera, Camera | CameraPath) or (isinstance(camera, CameraPath) and not camera.keys):
            raise SceneError(f"bad camera {_shown(camera)}", f"cameras[{name!r}]",
                             "expected a Camera, or a CameraPath with at least one key")
    return {name: CameraPath.still(camera) if isinstance(camera, Camera) else camera
            for name, camera in cameras.items()}


def check_lights(lights: Iterable[Light]) -> tuple[Light, ...]:
    """``lights`` in plain form, with directions at unit length.

    Raises
    ------
    SceneError
        When something else is among them, or a value is not finite or out of range.
    """
    if not isinstance(lights, list | tuple):
        raise SceneError(f"bad lights {_shown(lights)}", "lights", "expected a list of lights")
    return tuple(_check_light(light, f"lights[{index}]") for index, light in enumerate(lights))


def check_material(material: Material, where: str) -> Material:
    """``material`` in plain form.

    Raises
    ------
    SceneError
        When a value is not finite or out of range, or a texture has another shape.
    """
    return _plain(material, Material, f"{where}: material")


def check_environment(environment: Environment) -> Environment:
    """``environment`` in plain form.

    Raises
    ------
    SceneError
        When it has another shape, or a value that is negative or not finite.
    """
    return _plain(environment, Environment, "environment")


def check_size(size: Any) -> tuple[int, int]:
    """Width and height as plain integers above 0; ``Settings`` checks that they are not too large.

    Raises
    ------
    SettingsError
        When it is not a pair of such integers.
    """
    if isinstance(size, tuple | list | np.ndarray) and len(size) == 2 and all(
            isinstance(side, int | np.integer) and not isinstance(side, bool) and side > 0 for side in size):
        return int(size[0]), int(size[1])
    raise SettingsError(f"bad size {_shown(size)}", "size", "expected (width, height), two integers above 0")


def check_path(path: Any, what: str) -> Path:
    """The path of a file.

    Raises
    ------
    SettingsError
        When it is no path.
    """
    if not isinstance(path, str | Path) or "\0" in str(path):
        raise SettingsError(f"bad path {_shown(path)}", what, "expected a str or a Path, without null characters")
    return Path(path)


def check_number(value: Any, where: str, span: Range = _FINITE) -> float:
    """A plain number.

    Raises
    ------
    SceneError
        When it is none, or is out of its range, which includes both ends.
    """
    return float(_numbers(value, (), where, span))


def check_count(value: Any, where: str, least: int = 0) -> int:
    """A whole number from ``least``.

    Raises
    ------
    SettingsError
        When it is none.
    """
    if not isinstance(value, int | np.integer) or value < least:
        raise SettingsError(f"bad number {_shown(value)}", where, f"expected a whole number from {least}")
    return int(value)


def check_iterable(values: Any, where: str) -> Iterable[Any]:
    """A sequence or another iterable, but no text.

    Raises
    ------
    SettingsError
        When it is none.
    """
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise SettingsError(f"can't go through a {type(values).__name__}", where, "expected a sequence")
    return values


def read_array(values: Any, where: str, expected: str) -> F64:
    """Numbers as a float64 array of any shape.

    Raises
    ------
    SceneError
        When they are no numbers, or rows differ in length; the message has what was ``expected``.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind in "biuf":
            return array.astype(np.float64)
    except (TypeError, ValueError, RuntimeError):  # ragged; of torch, what is on a GPU or needs a gradient
        pass
    raise SceneError(f"bad numbers {_shown(values)}", where, expected)


def _check_light(light: Any, where: str) -> Light:
    if not isinstance(light, Light):
        raise SceneError(f"bad light {_shown(light)}", where,
                         "expected a PointLight, SpotLight, DirectionalLight or RectLight")
    try:
        return _plain_light_once(light, where)
    except TypeError:  # it has lists or arrays
        return _plain_light(light, where)


def _plain_light(light: Light, where: str) -> Light:
    plain = _plain(light, type(light), where)
    if isinstance(plain, SpotLight | DirectionalLight):
        if not any(plain.direction):
            raise SceneError("the direction has length 0", where, "expected a vector that is not zero")
        plain = replace(plain, direction=vector(normalize(np.array(plain.direction))))
    if isinstance(plain, SpotLight) and plain.outer_deg < plain.inner_deg:
        raise SceneError(f"outer_deg {plain.outer_deg:g} is below inner_deg {plain.inner_deg:g}", where,
                         "expected outer_deg to be at least inner_deg")
    if isinstance(plain, RectLight) and not span_rectangle(plain.edge_u, plain.edge_v):
        raise SceneError("edge_u and edge_v do not span a rectangle", where, "expected perpendicular edges")
    return plain


_plain_light_once = lru_cache(4096)(_plain_light)  # a renderer looks at all lights before each frame


def _plain(data: Any, kind: type[T], where: str) -> T:
    """A data class with each of its fields in plain form."""
    if not isinstance(data, kind):
        raise SceneError(f"bad value {_shown(data)}", where, f"expected {kind.__name__}(…)")
    is_unlit = getattr(data, "is_unlit", False)  # whose albedo is radiance
    values = {name: _plain_field(kind, name, hint, getattr(data, name), where,
                                 _RADIANCE if is_unlit and name == "albedo" else _RANGES.get(name, _FINITE))
              for name, hint in _hints(kind).items()}  # type: ignore[arg-type]  # classes are hashable
    return replace(data, **values)  # type: ignore[type-var]  # it is a data class


def _plain_field(kind: type, name: str, hint: Any, value: Any, where: str, span: Range) -> Any:
    where = f"{where}.{name}"
    if (kind, name) == (Environment, "radiance"):
        return _image(value, where, 3, span)
    if (kind, name) == (Texture, "pixels"):
        return _image(value, where, 4, _FINITE)
    if (kind, name) == (Texture, "transform"):
        return _numbers(value, (3, 3), where, _FINITE)
    if isinstance(value, EmissionImage):
        return value  # which checks itself, and is known by its identity
    options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    if value is None and NoneType in options:
        return None
    hint = next(option for option in options if option is not NoneType)
    if hint is float:
        return check_number(value, where, span)
    if get_origin(hint) is tuple and get_args(hint)[0] is float:
        return tuple(_numbers(value, (len(get_args(hint)),), where, span).tolist())
    if is_dataclass(hint):
        return _plain(value, hint, where)  # type: ignore[arg-type]  # of classes
    allowed = get_args(hint) if get_origin(hint) is Literal else None
    if value not in allowed if allowed else not isinstance(value, get_origin(hint) or hint):
        expected = " or ".join(map(repr, allowed)) if allowed else f"a value of the type {hint}"
        raise SceneError(f"bad value {_shown(value)}", where, f"expected {expected}")
    return value


@cache
def _hints(kind: type) -> dict[str, Any]:
    """The type of each field."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


def _numbers(values: Any, shape: tuple[int, ...], where: str, span: Range) -> F64:
    kind = "a number" if shape == () else f"numbers of the shape {shape}"
    expected = f"expected {kind} from {span[0]:g} to {span[1]:g}"
    array = read_array(values, where, expected)
    if array.shape != shape or not ((array >= span[0]) & (array <= span[1])).all():
        raise SceneError(f"bad value {_shown(values)}", where, expected)
    return array


def _image(pixels: Any, where: str, channels: int, span: Range) -> Any:
    """An image of uint8 where it has such pixels, and of float32 otherwise."""
    expected = f"expected an array of the shape (H, W, {channels}), finite and from {span[0]:g} to {span[1]:g}"
    values = read_array(pixels, where, expected)
    if values.ndim != 3 or values.shape[2] != channels or not values.size:
        raise SceneError(f"bad shape {values.shape}", where, expected)
    if not ((values >= span[0]) & (values <= span[1])).all():
        raise SceneError("a value is not finite or out of range", where, expected)
    return pixels if getattr(pixels, "dtype", None) == np.uint8 and channels == 4 else values.astype(np.float32)


def _shown(value: Any) -> str:
    """A value in a message, in one short line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"
