"""Highlights of lights that stand for surfaces far smaller than they: those of the surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from app.renderer import Renderer
from app.scene import Camera, EmissionPoints, Material, PointLight, RectLight
from app.settings import Settings
from tests.gl.scenes import F32, draw, floor, make_scene

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

BULBS = np.array([(-0.4, 0.6, -1.2), (0.0, 0.6, -1.2), (0.4, 0.6, -1.2)])
COLORS = np.array([(1.0, 0.2, 0.2), (0.2, 1.0, 0.2), (0.2, 0.2, 1.0)])
RADIUS, COUNT = 0.02, 2048
BULB_LIGHTS = [PointLight(tuple(p), tuple(c), RADIUS) for p, c in zip(BULBS.tolist(), COLORS.tolist(), strict=True)]
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


def as_points(count: int = 20) -> list[PointLight]:
    """Each bulb as points on a ball whose mean square distance from the axis of any view is that of a disc."""
    directions = np.random.default_rng(1).normal(size=(count, 3))
    directions *= RADIUS * np.sqrt(0.75) / np.linalg.norm(directions, axis=1, keepdims=True)
    return [PointLight(tuple((position + offset).tolist()), tuple((color / count).tolist()))
            for position, color in zip(BULBS, COLORS, strict=True) for offset in directions]


def highlights(lights: Sequence[PointLight | RectLight], roughness: float, is_sparse: bool = False,
               size: tuple[int, int] = (160, 120)) -> F32:
    glossy = Material(albedo=(0.0,) * 3, specular=(0.5,) * 3, roughness=roughness)
    scene = make_scene([floor(4.0, material=glossy)], lights, CAMERA)
    stand_ins = {light: points(light.center if isinstance(light, RectLight) else light.position, is_sparse)
                 for light in lights if isinstance(light, RectLight) or light.radius > RADIUS}
    return draw(replace(scene, approximate_lights=stand_ins), size, ("specular",), CAMERA)["specular"]


@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.35])
def test_each_bulb_of_a_merged_light_has_its_own_highlight(roughness: float) -> None:
    """A rectangle that faces the floor stands for three bulbs of different colours."""
    width, depth = 1.0, 0.3
    merged = RectLight((0.0, 0.6, -1.2), (-width, 0, 0), (0, 0, -depth), (1.4 / (width * depth),) * 3, two_sided=True)
    expected = highlights(BULB_LIGHTS, roughness)
    alike, as_one = (float(np.corrcoef(highlights([merged], roughness, sparse).ravel(), expected.ravel())[0, 1])
                     for sparse in (True, False))
    print(f"SPARSE {roughness}: correlation {alike:.3f}, as one rectangle {as_one:.3f}")
    assert alike > max(0.88, as_one + 0.15)


@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.35, 0.5, 1.0])
def test_highlights_have_the_light_of_the_bulbs(roughness: float) -> None:
    """A ball stands for them, which sends as much in all directions as they do."""
    merged, size = PointLight((0.0, 0.6, -1.2), (1.4,) * 3, 0.4), (480, 360)
    bulbs, parts = highlights(as_points(), roughness, size=size), highlights([merged], roughness, True, size)
    print(f"SPARSE {roughness}: light {parts.sum() / bulbs.sum():.3f}, brightest {parts.max() / bulbs.max():.3f}")
    assert parts.sum() == pytest.approx(bulbs.sum(), rel=0.05)
    assert parts.max() < 1.5 * bulbs.max()


def test_a_lamp_can_be_dimmed_beside_approximate_lights() -> None:
    """Also where radiance is scaled on the GPU, so that their points are others than before."""
    merged, lamp = PointLight((0.0, 0.6, -1.2), (1.4,) * 3, 0.4), PointLight((0.0, 1.0, 0.0), (9e5,) * 3)
    scene = replace(make_scene([floor(4.0)], [merged, lamp], CAMERA),
                    approximate_lights={merged: points(merged.position, True)})
    with Renderer(scene, Settings(size=(32, 24), outputs=("direct",))) as renderer:
        before = renderer.render(CAMERA)["direct"]
        assert renderer.relight((merged, replace(lamp, intensity=(8e5,) * 3)))
        after = renderer.render(CAMERA)["direct"]
    assert after.mean() == pytest.approx(8 / 9 * before.mean(), rel=0.01)
