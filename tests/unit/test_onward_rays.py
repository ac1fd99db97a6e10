"""Rays that go on from glossy surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.math3d import row_dots, unit_rows
from app.raycast.caster import Caster
from app.raycast.onward_rays import OnwardRays, go_on, reflected
from app.scene import Material, PointLight, Texture, Transmission
from app.specular_albedo import MEAN_COSINE, specular_albedo
from tests.gl.scenes import make_scene, quad

STEEL = Material("steel", albedo=(0.6, 0.5, 0.4), metallic=1.0, roughness=0.0)
STONE = Material("stone", albedo=(0.3, 0.3, 0.3), specular=(0.04,) * 3, roughness=0.1)
BLUE = Material("blue", albedo=(0.1, 0.1, 0.8))


def onward(floor: Material, towards: tuple[float, float, float], wall: Material = BLUE,
           start: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> OnwardRays:
    """From where a ray from above the middle of a floor meets it, below a wall at x = 4."""
    scene = make_scene([quad((-4, 0, 4), (8, 0, 0), (0, 0, -8), floor), quad((4, 0, 4), (0, 0, -8), (0, 9, 0), wall)],
                       [PointLight((0.0, 1.0, 0.0), (1.0,) * 3)])
    caster = Caster(scene)
    direction = unit_rows(np.array([towards], np.float32)).astype(np.float32)
    ends = caster.cast(np.array([start - caster.origin], np.float32), direction)
    return go_on(caster, ends, direction, *np.zeros((2, 1, 2), np.float32))


def albedo(material: Material, cosine: float) -> np.ndarray:
    f0 = material.albedo if material.metallic else material.specular
    roughness, cosines = (np.full((1, 1), value, np.float32) for value in (material.roughness, cosine))
    return specular_albedo(np.array([f0], np.float32), roughness, cosines)


def test_a_mirror_sends_rays_on_by_the_law_of_reflection() -> None:
    rays = onward(STEEL, (1.0, -2.0, 0.0))
    np.testing.assert_allclose(rays.direction, [(5**-0.5, 2 * 5**-0.5, 0)], atol=3e-3)
    np.testing.assert_allclose(rays.hits.position, [(4.0, 2 * 3.5 - 4.5, 0.0)], atol=0.05)  # 4.5: middle of the wall
    np.testing.assert_allclose(rays.hits.albedo, [BLUE.albedo], atol=1e-6)
    np.testing.assert_allclose(rays.share, albedo(STEEL, 2 * 5**-0.5), rtol=1e-4)
    assert np.abs(rays.left).max() < 1e-6


@pytest.mark.parametrize(("towards", "goes_on"), [((0.0, -1.0, 0.1), False), ((1.0, -1.2, 0.0), False),
                                                 ((1.0, -0.5, 0.0), True)])
def test_rays_go_on_from_stone_at_grazing_angles_only(towards: tuple[float, float, float], goes_on: bool) -> None:
    assert len(onward(STONE, towards).end) == goes_on


def test_what_textured_metal_mirrors_is_no_more_than_its_albedo() -> None:
    """Of a chequer, whether a ray is as narrow as its squares or shows their mean; what is left is never negative."""
    squares = np.where(np.add.outer(np.arange(64), np.arange(64))[..., None] % 2, 1.0, 0.1) * np.ones(4)
    metal = Material(albedo=(1.0,) * 3, albedo_map=Texture(squares.astype(np.float32)), metallic=1.0, roughness=0.05)
    caster = Caster(make_scene([quad((-1, -1, z), (2, 0, 0), (0, 2, 0), metal) for z in (0, 4)]))
    x, y = np.random.default_rng(0).uniform(-0.9, 0.9, (2, 500))
    origins = (np.stack([x, y, 0 * x + 2], axis=1) - caster.origin).astype(np.float32)
    towards = np.tile(np.float32((0, 0, -1)), (500, 1))
    for width, spread in ((0.0, 0.1), (1 / 4, 0.0)):
        beams = np.tile(np.float32((width, 0)), (500, 1))
        ends = caster.cast_through(origins, towards, beams).hits.select(np.arange(500))
        rays = go_on(caster, ends, towards, beams, np.zeros((500, 2), np.float32))
        assert (rays.share.std(axis=0) > spread).all() if spread else rays.share.std() < 0.01
        assert 0 <= rays.left.min() <= rays.left.max() < 0.1
        assert rays.left_for_direct.min() >= 0


def test_no_rays_go_on_from_rough_metal() -> None:
    assert len(onward(replace(STEEL, roughness=0.35), (1.0, -1.0, 0.0)).end) == 0
    half = onward(replace(STEEL, roughness=0.2), (1.0, -2.0, 0.0))
    np.testing.assert_allclose(half.share, 0.5 * albedo(replace(STEEL, roughness=0.2), 2 * 5**-0.5), rtol=1e-4)
    np.testing.assert_allclose(half.left, 0.5 * albedo(replace(STEEL, roughness=0.2), MEAN_COSINE), rtol=1e-4)


@pytest.mark.parametrize(("roughness", "share"), [(0.0, 1.0), (0.1, 0.5), (0.2, 0.0)])
def test_rays_from_smooth_surfaces_find_lamps_that_have_a_surface(roughness: float, share: float) -> None:
    """What they don't find of lamps is left to the diffuse reflection of direct light."""
    lamp, floor = replace(BLUE, emission=(3.0, 2.0, 1.0), is_light_proxy=True), replace(STEEL, roughness=roughness)
    rays = onward(floor, (1.0, -2.0, 0.0), wall=lamp)
    np.testing.assert_allclose(rays.hits.emission, share * np.array([lamp.emission]), rtol=1e-5)
    at_mean = albedo(floor, MEAN_COSINE)
    goes_on = (at_mean - rays.left) / at_mean
    np.testing.assert_allclose((at_mean - rays.left_for_direct) / at_mean, share * goes_on, atol=1e-5)


def test_rays_that_go_on_are_tinted_by_glass() -> None:
    """Before the sky too, which is seen through a wall of it."""
    pane = Material("pane", albedo=(1.0, 0.25, 0.1), is_blended=False, transmission=Transmission(1.0))
    rays = onward(STEEL, (1.0, -2.0, 0.0), wall=pane)
    sky = rays.hits.body < 0
    np.testing.assert_allclose(rays.share[sky] / albedo(STEEL, 2 * 5**-0.5), [pane.albedo], rtol=0.2)


@pytest.mark.parametrize("color", [0.02, 0.5, 0.9])
@pytest.mark.parametrize("height", [2.0, 0.7, 0.3, 0.05])
def test_a_floor_sends_back_no_more_than_arrives(color: float, height: float) -> None:
    """Where the same light arrives from everywhere."""
    rays = onward(replace(STONE, albedo=(color,) * 3), (0.0, -height, 1.0), start=(0.0, height, 0.0))
    assert (rays.left + rays.share <= 1 + 1e-6).all()
    assert (rays.left >= 0).all() and (rays.left_for_direct >= rays.left).all() and (rays.left_for_direct <= 1).all()


def test_rays_go_on_above_the_face_below_a_normal() -> None:
    v, n, face = (unit_rows(np.array([row], np.float32)).astype(np.float32)
                  for row in ((-1.0, 0.1, 0.0), (0.5, 1.0, 0.0), (0.0, 1.0, 0.0)))
    assert row_dots(2 * row_dots(v, n)[:, None] * n - v, face) < 0
    assert row_dots(reflected(v, n, face, np.zeros((1, 1), np.float32), np.zeros((1, 2), np.float32)), face) > 0


@pytest.mark.parametrize("cosine", [0.95, 0.5, 0.15])
def test_normals_are_chosen_as_often_as_the_viewer_sees_them(cosine: float) -> None:
    """Mean cosine of chosen normals, against quadrature of G1 (v·h) D / (v·n) over the lobe without its far tail."""
    roughness, count = 0.6, 2**16
    u = np.random.default_rng(1).random((count, 2), np.float32)
    v, n = np.array([(np.sqrt(1 - cosine**2), 0, cosine)]), np.array([(0.0, 0.0, 1.0)])
    v, n = (np.repeat(rows, count, axis=0).astype(np.float32) for rows in (v, n))
    directions = reflected(v, n, np.zeros_like(n), np.full((count, 1), roughness, np.float32), u)
    found = row_dots(unit_rows(directions + v), n)
    alpha = roughness**2
    c, angle = np.meshgrid((np.arange(2000) + 0.5) / 2000, (np.arange(1000) + 0.5) / 1000 * 2 * np.pi)
    h = np.stack([np.sqrt(1 - c**2) * np.cos(angle), np.sqrt(1 - c**2) * np.sin(angle), c], axis=-1)
    density = np.maximum(h @ v[0], 0) * alpha**2 / (c**2 * (alpha**2 - 1) + 1)**2
    np.testing.assert_allclose(found.mean(), (density * c).sum() / density.sum(), atol=0.012)
