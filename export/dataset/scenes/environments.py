"""Scenes under random environments: the sky alone lights them, and materials have highlights."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.environment import centres
from app.math3d import normalize
from app.scene import Environment, Material, Scene
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.lights import strength
from export.dataset.scenes.materials import color

F64 = NDArray[np.float64]

SIZE = (64, 128)    # rows and columns of an environment
SUNNY = 0.6         # how often there is a sun ...
STUDIO = 0.3        # ... and otherwise bright panels
SHINY = 0.6         # share of the materials that have highlights ...
METALS = 0.3        # ... and of these, of the metals
GLASSY = 0.04       # F0 of anything else


def under_sky(rng: Rng, scene: Scene) -> Scene:
    """The scene with an environment for its lights and glow, and with highlights on some materials."""
    materials = tuple(_polished(rng, replace(m, emission=(0.0, 0.0, 0.0), emission_map=None, is_light_proxy=False))
                      for m in scene.materials)
    return replace(scene, lights=(), materials=materials, environment=random_environment(rng))


def random_environment(rng: Rng) -> Environment:
    """A sky with a soft horizon and clouds, and in it a sun, or panels as in a studio, or neither."""
    d = centres(*SIZE)
    zenith, horizon, ground = (np.array(strength(rng, mean, 0.3)) for mean in (0.6, 0.8, 0.3))
    up = d[..., 1:2]
    above = horizon + (zenith - horizon) * np.maximum(up, 0) ** rng.uniform(0.3, 1.0)
    radiance = ground + (above - ground) / (1 + np.exp(-up / rng.uniform(0.01, 0.1)))
    radiance = radiance * np.exp(rng.uniform(0.0, 0.8) * _clouds(rng, d)[..., None])
    kind = rng.random()
    if kind < SUNNY:
        radiance = radiance + _sun(rng, d)
    elif kind < SUNNY + STUDIO:
        for _ in range(rng.integers(1, 5)):
            radiance = radiance + _panel(rng, d)
    return Environment(radiance.astype(np.float32), float(rng.uniform(0, 360)))


def _clouds(rng: Rng, d: F64) -> F64:
    """Smooth noise of mean 0 and deviation 1 over directions, shape (rows, columns)."""
    total = np.zeros(d.shape[:2])
    for _ in range(12):
        total += np.sin(d @ rng.normal(0, 1, 3) * rng.uniform(2, 16) + rng.uniform(0, 2 * math.pi))
    return np.asarray(total / math.sqrt(6))


def _sun(rng: Rng, d: F64) -> F64:
    """A disc with a soft edge that gives a facing surface about 1 to 25 W/m²."""
    height, turn, radius = math.radians(rng.uniform(5, 85)), rng.uniform(0, 2 * math.pi), math.radians(
        rng.uniform(2.5, 12))
    towards = np.array([math.cos(height) * math.sin(turn), math.sin(height), -math.cos(height) * math.cos(turn)])
    lobe = np.exp((d @ towards - 1) / (0.5 * radius**2))  # of solid angle pi radius²
    return lobe[..., None] * np.array(strength(rng, 5.0, 0.1)) / (math.pi * radius**2)


def _panel(rng: Rng, d: F64) -> F64:
    """A bright rectangle anywhere but below."""
    middle = normalize(rng.normal(0, 1, 3) * (1, 0.5, 1) + (0, 0.6, 0))
    right = normalize(np.cross(middle, rng.normal(0, 1, 3)))
    up, (width, height) = np.cross(right, middle), rng.uniform(0.1, 0.5, 2)
    ahead = np.maximum(d @ middle, 1e-6)
    inside = (d @ middle > 0) & (np.abs(d @ right) < width * ahead) & (np.abs(d @ up) < height * ahead)
    return inside[..., None] * np.array(strength(rng, 8.0, 0.3))


def _polished(rng: Rng, material: Material) -> Material:
    if rng.random() >= SHINY:
        return replace(material, roughness=1.0, specular=(0.0, 0.0, 0.0))
    roughness = float(rng.uniform(0.1, 1.0))
    if rng.random() < METALS:
        return replace(material, albedo=(0.0, 0.0, 0.0), albedo_map=None, roughness=roughness,
                       specular=color(rng, 0.5, 1.0))
    return replace(material, roughness=roughness, specular=(GLASSY, GLASSY, GLASSY))
