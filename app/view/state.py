"""What is seen: one frozen value that messages replace, and its JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from app.scene import Camera, DirectionalLight, Light, PointLight, RectLight, SpotLight

Vec = tuple[float, float, float]
Json = dict[str, Any]

REFERENCE = "reference"  # in place of a second model
FINAL = "final"
TYPES = {PointLight: "point", SpotLight: "spot", DirectionalLight: "directional", RectLight: "rectangle"}


@dataclass(frozen=True)
class State:
    """All that a picture depends on, besides the scene's file.

    Attributes
    ----------
    size : tuple of int
        Width and height in pixels.
    lights : tuple of Light
        Without those that stand for emissive surfaces.
    places : tuple of (name, translation)
        Objects that were moved, by name, in scene units from where the file has them.
    model : str
        One of the choices; of what makes indirect light.
    scale : float
        Of a network's grid relative to the image; 0 is its own.
    precision : str
        ``float32``, ``float16`` or, for a network's own, nothing.
    aov : str
        What of the frame is shown.
    split : str
        What is right of the slider: another model, ``reference``, or nothing.
    environment : str
        What shades surfaces by the scene's environment, whichever model is chosen; or nothing.
    bounces : int or None
        Of indirect light, where a model makes any; None for what it gives by itself.
    """

    size: tuple[int, int]
    camera: Camera
    lights: tuple[Light, ...]
    model: str
    places: tuple[tuple[str, Vec], ...] = ()
    bookmarks: tuple[tuple[str, Camera], ...] = ()
    exposure: float = 1.0
    taa: bool = True
    scale: float = 0.0
    precision: str = ""
    aov: str = FINAL
    split: str = ""
    environment: str = ""
    bounces: int | None = None

    @property
    def models(self) -> tuple[str, ...]:
        """What is drawn: the model, and the one that it is compared with, if there is one."""
        return (self.model,) if self.split in ("", REFERENCE) else (self.model, self.split)

    @property
    def reference_key(self) -> tuple[object, ...]:
        """Equal for equal references."""
        return self.size, self.camera, self.lights, self.places


def camera_json(camera: Camera) -> Json:
    """A camera as the scene JSON writes it."""
    return asdict(camera)


def light_json(light: Light) -> Json:
    """A light as the scene JSON writes it."""
    return {"type": TYPES[type(light)], **asdict(light)}


def state_json(state: State) -> Json:
    """The state as the page gets it."""
    return {
        "size": state.size, "camera": camera_json(state.camera), "lights": [light_json(x) for x in state.lights],
        "places": dict(state.places), "bookmarks": {name: camera_json(c) for name, c in state.bookmarks},
        "model": state.model, "exposure": state.exposure, "taa": state.taa, "scale": state.scale,
        "precision": state.precision, "aov": state.aov, "split": state.split,
    }
