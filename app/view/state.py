"""The state of the viewer: one frozen value that messages replace, and its JSON."""

from dataclasses import asdict, dataclass, fields
from typing import Any

from app.scene import Camera, DirectionalLight, Light, PointLight, RectLight, SpotLight
from app.settings import TONE_MAPS

Vec = tuple[float, float, float]
Json = dict[str, Any]

REFERENCE = "reference"  # in place of a second model
FINAL = "final"
LIGHT_TYPES = {PointLight: "point", SpotLight: "spot", DirectionalLight: "directional", RectLight: "rectangle"}


@dataclass(frozen=True)
class State:
    """Everything that an image depends on besides the scene file.

    Attributes
    ----------
    size : tuple of int
        Width and height in pixels.
    lights : tuple of Light
        All lights except those that stand for emissive surfaces.
    model : str
        The model of indirect light.
    object_offsets : tuple of (name, translation)
        Moved objects, sorted by name; translations from their position in the file, in scene units.
    bookmarks : tuple of (name, Camera)
        Cameras that the user has stored.
    scale : float
        Resolution of a network's grid relative to the image; 0 is the network's own.
    precision : str
        ``float32``, ``float16``, or empty for the network's own.
    aov : str
        The displayed output.
    split : str
        What is displayed right of the divider: another model, ``reference``, or empty.
    environment : str
        The model that shades surfaces by the scene's environment, independent of ``model``; may be empty.
    bounces : int or None
        Number of bounces of indirect light; None for the model's own.
    tonemap : str
        As in ``Settings``.
    time : float
        Seconds; places what moves.
    """

    size: tuple[int, int]
    camera: Camera
    lights: tuple[Light, ...]
    model: str
    object_offsets: tuple[tuple[str, Vec], ...] = ()
    bookmarks: tuple[tuple[str, Camera], ...] = ()
    exposure: float = 1.0
    auto_exposure: bool = False
    tonemap: str = TONE_MAPS[0]
    taa: bool = True
    reflections: bool = True
    scale: float = 0.0
    precision: str = ""
    aov: str = FINAL
    split: str = ""
    environment: str = ""
    bounces: int | None = None
    time: float = 0.0

    @property
    def models(self) -> tuple[str, ...]:
        """The models to draw: ``model``, and the one it is compared with, if any."""
        return (self.model,) if self.split in ("", REFERENCE) else (self.model, self.split)

    @property
    def reference_key(self) -> tuple[object, ...]:
        """A key that is equal for equal references."""
        return self.size, self.camera, self.lights, self.object_offsets, self.time


def camera_to_json(camera: Camera) -> Json:
    """Return a camera in the format of the scene JSON."""
    return {key: value for key, value in asdict(camera).items() if value is not None}


def light_to_json(light: Light) -> Json:
    """Return a light in the format of the scene JSON."""
    values = {field.name: getattr(light, field.name) for field in fields(light) if field.name != "image"}
    return {"type": LIGHT_TYPES[type(light)], **values}


def state_to_json(state: State) -> Json:
    """Return the state as pages receive it."""
    return {
        "size": state.size, "camera": camera_to_json(state.camera),
        "lights": [light_to_json(light) for light in state.lights],
        "object_offsets": dict(state.object_offsets),
        "bookmarks": {name: camera_to_json(camera) for name, camera in state.bookmarks},
        "model": state.model, "exposure": state.exposure, "auto_exposure": state.auto_exposure,
        "tonemap": state.tonemap, "taa": state.taa, "reflections": state.reflections, "scale": state.scale,
        "precision": state.precision, "aov": state.aov, "split": state.split, "time": state.time,
    }
