"""Scenes lit by a random environment only, with specular materials."""

import math
from dataclasses import replace

import numpy as np

from app.arrays import F64
from app.environment import texel_directions
from app.math3d import normalize
from app.scene import Environment, Material, Scene
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.lights import random_light_color
from export.dataset.scenes.materials import random_color

SIZE = (64, 128)          # rows and columns of an environment
SUN_PROBABILITY = 0.6     # of a sun ...
PANELS_PROBABILITY = 0.3  # ... and of bright panels as in a photo studio, never both
SPECULAR_SHARE = 0.6      # of the materials
METAL_SHARE = 0.3         # of the specular materials
DIELECTRIC_F0 = 0.04


def with_random_environment(rng: Rng, scene: Scene) -> Scene:
    """The scene with an environment in place of lights and emission, and with some specular materials."""
    unlit = [replace(m, emission=(0.0, 0.0, 0.0), emission_map=None, is_light_proxy=False) for m in scene.materials]
    materials = tuple(_with_random_specular(rng, m) for m in unlit)
    return replace(scene, lights=(), materials=materials, environment=random_environment(rng))


def random_environment(rng: Rng) -> Environment:
    """A sky with a soft horizon and clouds, with a sun, bright panels, or neither."""
    d = texel_directions(*SIZE)
    zenith, horizon, ground = (np.array(random_light_color(rng, mean, 0.3)) for mean in (0.6, 0.8, 0.3))
    up = d[..., 1:2]
    above = horizon + (zenith - horizon) * np.maximum(up, 0) ** rng.uniform(0.3, 1.0)
    radiance = ground + (above - ground) / (1 + np.exp(-up / rng.uniform(0.01, 0.1)))
    radiance = radiance * np.exp(rng.uniform(0.0, 0.8) * _clouds(rng, d)[..., None])
    kind = rng.random()
    if kind < SUN_PROBABILITY:
        radiance = radiance + _sun(rng, d)
    elif kind < SUN_PROBABILITY + PANELS_PROBABILITY:
        for _ in range(rng.integers(1, 5)):
            radiance = radiance + _panel(rng, d)
    return Environment(radiance.astype(np.float32), float(rng.uniform(0, 360)))


def _clouds(rng: Rng, d: F64) -> F64:
    """Smooth noise over directions with mean 0 and standard deviation 1, shape (rows, columns)."""
    total = np.zeros(d.shape[:2])
    for _ in range(12):
        total += np.sin(d @ rng.normal(0, 1, 3) * rng.uniform(2, 16) + rng.uniform(0, 2 * math.pi))
    return np.asarray(total / math.sqrt(6))


def _sun(rng: Rng, d: F64) -> F64:
    """A disc with a soft edge, of about 1 to 25 W/m² on a facing surface."""
    elevation, phi = math.radians(rng.uniform(5, 85)), rng.uniform(0, 2 * math.pi)
    radius = math.radians(rng.uniform(2.5, 12))
    towards = np.array([math.cos(elevation) * math.sin(phi), math.sin(elevation), -math.cos(elevation) * math.cos(phi)])
    lobe = np.exp((d @ towards - 1) / (0.5 * radius**2))  # its solid angle is π radius²
    return lobe[..., None] * np.array(random_light_color(rng, 5.0, 0.1)) / (math.pi * radius**2)


def _panel(rng: Rng, d: F64) -> F64:
    """A bright rectangle, rarely below the horizon."""
    centre = normalize(rng.normal(0, 1, 3) * (1, 0.5, 1) + (0, 0.6, 0))
    right = normalize(np.cross(centre, rng.normal(0, 1, 3)))
    up, (width, height) = np.cross(right, centre), rng.uniform(0.1, 0.5, 2)
    ahead = np.maximum(d @ centre, 1e-6)
    inside = (d @ centre > 0) & (np.abs(d @ right) < width * ahead) & (np.abs(d @ up) < height * ahead)
    return inside[..., None] * np.array(random_light_color(rng, 8.0, 0.3))


def _with_random_specular(rng: Rng, material: Material) -> Material:
    if rng.random() >= SPECULAR_SHARE:
        return replace(material, roughness=1.0, specular=(0.0, 0.0, 0.0))
    roughness = float(rng.uniform(0.1, 1.0))
    if rng.random() < METAL_SHARE:
        return replace(material, albedo=(0.0, 0.0, 0.0), albedo_map=None, roughness=roughness,
                       specular=random_color(rng, 0.5, 1.0))
    return replace(material, roughness=roughness, specular=(DIELECTRIC_F0,) * 3)
