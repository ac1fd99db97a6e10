"""Lights in candela and lux (KHR_lights_punctual) as W/sr and W/m².

Files that are made for viewers at exposure 1 have intensities that light their scene as watts would. Files with the
luminous intensities of real lamps, such as Blender's exporter writes, are hundreds of times as bright.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from app.arrays import F64
from app.scene import Color, DirectionalLight, Light, PointLight, SpotLight

LUMENS_PER_WATT = 683.0  # of light of 555 nm, by the definition of the candela; exporters take it for all colours
MAX_IRRADIANCE = 50.0    # W/m², of which a white surface is 16 times as bright as white is at exposure 1


def are_photometric(lights: Sequence[Light], bounds: F64) -> bool:
    """Whether, taken as W/sr and W/m², lights would burn out what is in ``bounds``, shape (2, 3)."""
    center, diagonal = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0]))
    total = 0.0
    for light in lights:
        if isinstance(light, DirectionalLight):
            total += max(light.irradiance)
        elif isinstance(light, PointLight | SpotLight):
            distance = max(float(np.linalg.norm(center - light.position)), diagonal / 4)
            total += max(light.intensity) / max(distance, 1e-30) ** 2
    return total > MAX_IRRADIANCE


def to_radiometric(light: Light) -> Light:
    """The light with its luminous quantities as radiometric ones."""
    if isinstance(light, DirectionalLight):
        return replace(light, irradiance=_to_watts(light.irradiance))
    if isinstance(light, PointLight | SpotLight):
        return replace(light, intensity=_to_watts(light.intensity))
    return light


def _to_watts(color: Color) -> Color:
    r, g, b = color
    return r / LUMENS_PER_WATT, g / LUMENS_PER_WATT, b / LUMENS_PER_WATT
