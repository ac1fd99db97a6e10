"""How bright a scene is, and the power of two that brings its radiance to the middle of the half-float range."""

import math

import numpy as np

from app.scene import DirectionalLight, PointLight, RectLight, Scene, SpotLight

MAX_EXPONENT = 12  # of 256


def radiance_scale(scene: Scene) -> float:
    """A power of 256 that brings typical reflected radiance to 1/16 … 16; mostly 1, which read-back need not undo."""
    emitted = [max(m.albedo if m.is_unlit else m.emission) for m in scene.materials if m.emits or m.is_unlit]
    brightest = max((e for e in (*emitted, reflected_radiance(scene)) if math.isfinite(e)), default=0.0)
    if brightest <= 0:
        return 1.0
    return float(256.0 ** max(-MAX_EXPONENT, min(MAX_EXPONENT, -round(math.log2(brightest) / 8))))


def reflected_radiance(scene: Scene) -> float:
    """About what surfaces reflect of the brightest light, W/(sr m²); 0 without light."""
    distance = scene.longest_edge / 4
    estimates = []
    if scene.environment is not None:
        estimates.append(float(scene.environment.mean_radiance.max()))
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
    return max((e for e in estimates if math.isfinite(e)), default=0.0)
