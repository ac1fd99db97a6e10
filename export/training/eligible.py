"""Which pairs of a dataset may be trained on, by what lights them."""

from __future__ import annotations

from app.scene import DirectionalLight, Light, RectLight, Scene
from export.training.examples import Pairs


def eligible(pairs: Pairs, most_saturated: float) -> list[int] | None:
    """Pairs without a light, or glow, of more saturation; None if no limit is set, since looking takes minutes."""
    if most_saturated >= 1:
        return None
    return [i for i in range(len(pairs)) if saturation(pairs.pair(i).current.scene) <= most_saturated]


def saturation(scene: Scene) -> float:
    """Of the scene's most saturated light or glowing material: 1 - smallest / largest of its colours, 0 in the dark."""
    colors = [_color(light) for light in scene.lights] + [material.emission for material in scene.materials]
    if scene.environment is not None:
        colors.append(tuple(scene.environment.radiance.mean(axis=(0, 1), dtype=float).tolist()))
    return max((1 - min(color) / max(color) for color in colors if max(color) > 0), default=0.0)


def _color(light: Light) -> tuple[float, float, float]:
    match light:
        case DirectionalLight():
            return light.irradiance
        case RectLight():
            return light.radiance
        case _:
            return light.intensity
