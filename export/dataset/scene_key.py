"""A key for the content of a scene that is the same on every machine."""

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from app.evaluation.hashing import changed_fields, content_key
from app.scene import Scene

DECIMALS = 5  # processors differ in the last digits of sines and powers


def scene_key(scene: Scene, *values: object) -> str:
    """Equal for scenes with equal content, whatever their names and cameras, and equal further ``values``."""
    if scene.environment is not None:
        radiance = scene.environment.radiance
        maximum = float(radiance.max())
        values = (*values, float(np.log(maximum)), radiance / maximum, scene.environment.rotation_deg)
    return content_key(_rounded((scene.meshes, scene.instances, scene.materials, scene.lights, values)))


def _rounded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return np.round(value.astype(np.float64), DECIMALS) + 0.0 if value.dtype.kind == "f" else value
    if isinstance(value, float):
        return round(value, DECIMALS) + 0.0  # no negative zero
    if is_dataclass(value):
        return (type(value).__name__, *((name, _rounded(inner)) for name, inner in changed_fields(value)))
    if isinstance(value, Mapping):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [_rounded(inner) for inner in value]
    return value
