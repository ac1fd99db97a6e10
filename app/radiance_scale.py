"""The power of two that brings a scene's radiance to the middle of the half-float range."""

import math

import numpy as np

from app.scene import DirectionalLight, PointLight, RectLight, Scene, SpotLight

MAX_EXPONENT = 12  # of 256


def radiance_scale(scene: Scene) -> float:
    """A power of 256 that brings typical reflected radiance to 1/16 … 16; mostly 1, which read-back need not undo."""
    distance = scene.longest_edge / 4
    estimates = [max(m.albedo if m.is_unlit else m.emission) for m in scene.materials if m.emits or m.is_unlit]
    if scene.environment is not None:
        estimates.append(float(scene.environment.radiance.mean(axis=(0, 1), dtype=np.float64).max()))
    for light in scene.lights:
        match light:
            case PointLight() | SpotLight():
                irradiance = max(light.intensity) / distance**2
            case DirectionalLight():
                irradiance = max(light.irradiance)
            case RectLight():
                area = float(np.linalg.norm(np.cross(light.edge_u, light.edge_v)))
                irradiance = max(light.radiance) * min(area / distance**2, math.pi)
        estimates.append(irradiance / (2 * math.pi))
    brightest = max((e for e in estimates if math.isfinite(e)), default=0.0)
    if brightest <= 0:
        return 1.0
    return float(256.0 ** max(-MAX_EXPONENT, min(MAX_EXPONENT, -round(math.log2(brightest) / 8))))
