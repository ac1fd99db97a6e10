"""Highlights of lights that stand for surfaces far smaller than they: those of the surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.scene import Camera, EmissionPoints, Light, Material, PointLight, RectLight
from tests.gl.scenes import F32, draw, floor, make_scene

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

BULBS = np.array([(-0.4, 0.6, -1.2), (0.0, 0.6, -1.2), (0.4, 0.6, -1.2)])
COLORS = np.array([(1.0, 0.2, 0.2), (0.2, 1.0, 0.2), (0.2, 0.2, 1.0)])
RADIUS, COUNT = 0.02, 2048
CAMERA = Camera((0.0, 0.6, 1.2), (0.0, 0.0, 0.0), fov_y_deg=50.0)


def points(center: tuple[float, float, float], is_sparse: bool) -> EmissionPoints:
    """On three balls, in order, with so much intensity that each sends its colour in all directions."""
    bulb = np.arange(COUNT) * len(BULBS) // COUNT
    directions = np.random.default_rng(0).normal(size=(COUNT, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    area = np.full(COUNT, len(BULBS) * 4 * np.pi * RADIUS ** 2 / COUNT)
    radiance = COLORS[bulb] / (np.pi * RADIUS ** 2)
    return EmissionPoints(*(x.astype(np.float32) for x in (
        BULBS[bulb] + RADIUS * directions - center, directions, area[:, None] * radiance, area)),
        np.zeros(COUNT, np.bool_), False, is_sparse)


def highlights(lights: list[Light], roughness: float, is_sparse: bool = False) -> F32:
    glossy = Material(albedo=(0.0,) * 3, specular=(0.5,) * 3, roughness=roughness)
    scene = make_scene([floor(4.0, material=glossy)], lights, CAMERA)
    stand_ins = {light: points(light.center, is_sparse) for light in lights if isinstance(light, RectLight)}
    return draw(replace(scene, approximate_lights=stand_ins), (160, 120), ("specular",), CAMERA)["specular"]


@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.35])
def test_each_bulb_of_a_merged_light_has_its_own_highlight(roughness: float) -> None:
    """A rectangle that faces the floor stands for three bulbs of different colours."""
    width, depth = 1.0, 0.3
    merged = RectLight((0.0, 0.6, -1.2), (-width, 0, 0), (0, 0, -depth), (1.4 / (width * depth),) * 3, two_sided=True)
    bulbs: list[Light] = [PointLight(tuple(p), tuple(c), RADIUS)
                          for p, c in zip(BULBS.tolist(), COLORS.tolist(), strict=True)]
    expected = highlights(bulbs, roughness)
    alike, as_one = (float(np.corrcoef(highlights([merged], roughness, sparse).ravel(), expected.ravel())[0, 1])
                     for sparse in (True, False))
    print(f"SPARSE {roughness}: correlation {alike:.3f}, as one rectangle {as_one:.3f}")
    assert alike > max(0.88, as_one + 0.15)
