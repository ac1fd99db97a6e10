"""Points that stand for the surfaces of an approximate light."""

from __future__ import annotations

import numpy as np
import pytest

from app.load.emission_patches import EmissiveTriangles
from app.load.emission_points import POINTS, place_points
from app.scene import EmissionPoints, PointLight, RectLight

CENTER = np.array([1.0, 2.0, 3.0])


def triangles() -> EmissiveTriangles:
    """Two squares that face up and left, the second two-sided, and a weak small one far away."""
    square = np.array([[(0, 0, 0), (0, 0, 1), (1, 0, 1)], [(0, 0, 0), (1, 0, 1), (1, 0, 0)]], float)
    left = np.array([[(5, 0, 0), (5, 0, 1), (5, 1, 1)], [(5, 0, 0), (5, 1, 1), (5, 1, 0)]], float)
    radiance = np.repeat([(1.0, 2.0, 4.0), (3.0, 1.0, 0.0), (0.1, 0.1, 0.1)], 2, axis=0)
    return EmissiveTriangles(np.concatenate([square, left, 0.1 * square + (20, 0, 0)]), radiance,
                             np.repeat([False, True, False], 2), np.repeat([0, 1, 2], 2))


def points_of(emitters: EmissiveTriangles) -> EmissionPoints:
    ((_, points),) = place_points(emitters, [PointLight((1.0, 2.0, 3.0), (1.0, 1.0, 1.0), 0.5)])
    return points


def test_points_lie_on_the_surfaces_in_proportion_to_their_power() -> None:
    points = points_of(triangles())
    at = points.offset + CENTER
    up, side = np.abs(at[:, 1]) < 1e-5, np.abs(at[:, 0] - 5) < 1e-5
    np.testing.assert_array_equal(up, ~side)
    np.testing.assert_allclose(points.normal[up], [[0, 1, 0]] * int(up.sum()), atol=1e-6)
    np.testing.assert_allclose(points.normal[side], [[-1, 0, 0]] * int(side.sum()), atol=1e-6)
    np.testing.assert_array_equal(points.two_sided, side)
    assert abs(int(side.sum()) - POINTS * 8**0.5 / (7**0.5 + 8**0.5)) <= 2, "power counts both sides"
    quarter = (at[side, 1] < 0.5) & (at[side, 2] < 0.5)
    assert abs(quarter.mean() - 0.25) < 0.03


def test_points_have_the_power_and_area_of_the_surfaces() -> None:
    emitters = triangles()
    points = points_of(emitters)
    power = (np.pi * (1 + points.two_sided)[:, None] * points.intensity).sum(axis=0)
    np.testing.assert_allclose(power, emitters.power.sum(axis=0), rtol=0.02)
    assert abs(points.area.sum() - 2.01) < 0.04


def test_narrow_sides_get_more_points_than_their_power() -> None:
    """A panel of 1 m with sides of 1 cm, 2 % of its power."""
    corners = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 0.01) for z in (0.0, 1.0)])
    faces = [(0, 4, 5, 1), (2, 3, 7, 6), (0, 1, 3, 2), (4, 6, 7, 5), (0, 2, 6, 4), (1, 5, 7, 3)]
    rows = [face[k] for face in faces for k in (0, 1, 2, 0, 2, 3)]
    panel = EmissiveTriangles(corners[rows].reshape(-1, 3, 3), np.ones((12, 3)), np.zeros(12, bool), np.zeros(12, int))
    points = points_of(panel)
    on_sides = np.abs(points.normal[:, 1]) < 0.5
    assert 0.1 < on_sides.mean() < 0.3
    assert abs(points.area[on_sides].sum() - 0.04) < 0.001


@pytest.mark.parametrize(("radiance", "is_sparse"), [(1.0, False), (0.1, True), (4.0, True)])
def test_a_light_that_is_far_darker_or_brighter_than_its_surfaces_is_sparse(radiance: float, is_sparse: bool) -> None:
    square = triangles().select(np.arange(2))
    color = tuple((radiance * square.radiance[0]).tolist())
    light = RectLight((0.5, 0.0, 0.5), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), color)
    ((_, points),) = place_points(square, [light])
    assert points.is_sparse == is_sparse


def test_parts_of_points_lie_close_together() -> None:
    """On a closed curve, where points of opposite sides are as far along any axis."""
    angle = np.linspace(0, 2 * np.pi, 65)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    corners = np.stack([ring[:-1], ring[1:], ring[1:] + np.array([0, 0, 0.01])], axis=1)
    points = points_of(EmissiveTriangles(corners, np.ones((64, 3)), np.zeros(64, bool), np.zeros(64, int)))
    parts = points.offset.reshape(32, -1, 3)
    assert np.ptp(parts, axis=1).max() < 0.3  # 32 equal parts of the ring are 0.2 long


def test_triangles_without_power_do_no_harm() -> None:
    """Such as slivers, which rounding leaves of divided triangles; here the only one that faces its direction."""
    emitters = triangles()
    sliver = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]])
    radiance = np.concatenate([emitters.radiance, np.ones((1, 3))])
    more = EmissiveTriangles(np.concatenate([emitters.corners, sliver]), radiance,
                             np.append(emitters.two_sided, False), np.append(emitters.piece, 3))
    assert np.isfinite(points_of(more).offset).all()


def test_lights_that_stand_for_the_same_surfaces_share_their_power() -> None:
    """Crossed rectangles, which stand for a tube: rays to both would count its light twice."""
    crossed = [RectLight((1.0, 2.0, 3.0), (0.0, 2.0, 0.0), edge, (radiance,) * 3, two_sided=True)
               for edge, radiance in (((0.1, 0.0, 0.0), 3.0), ((0.0, 0.0, 0.2), 0.5))]
    placed = dict(place_points(triangles(), crossed))
    alone = points_of(triangles())
    for light, share in zip(crossed, (0.75, 0.25), strict=True):
        np.testing.assert_allclose(placed[light].intensity, share * alone.intensity, rtol=1e-6)
        np.testing.assert_array_equal(placed[light].offset, alone.offset)


@pytest.mark.parametrize("seed", range(4))
def test_points_are_spread_over_crowded_triangles_in_proportion_to_their_area(seed: int) -> None:
    """Of one radiance, on a bent strip with triangles of 0.01 to 100 parts of its area."""
    rng = np.random.default_rng(seed)
    edges = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-2, 2, 40))])
    edges = np.union1d(edges / edges[-1], 3 / 7)  # where the strip bends
    path = np.array([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 4.0, 0.0)])
    along = np.stack([np.interp(edges, [0.0, 3 / 7, 1.0], path[:, k]) for k in range(3)], -1)
    near, far = along, along + np.array((0.0, 0.0, 2.0))
    corners = np.concatenate([np.stack([near[:-1], near[1:], far[1:]], 1), np.stack([near[:-1], far[1:], far[:-1]], 1)])
    emitters = EmissiveTriangles(corners, np.ones((len(corners), 3)), np.zeros(len(corners), bool),
                                 np.zeros(len(corners), int))
    points = points_of(emitters)
    at = points.offset.astype(np.float64) + CENTER

    def off(triangle: np.ndarray) -> np.ndarray:
        """Distance of each point from a triangle's plane, infinite where it projects beyond its edges."""
        a, b, c = triangle
        normal = np.cross(b - a, c - a)
        inside = [np.cross(q - p, at - p) @ normal >= -1e-5 * normal @ normal for p, q in ((a, b), (b, c), (c, a))]
        return np.where(np.all(inside, axis=0), np.abs((at - a) @ normal) / np.linalg.norm(normal), np.inf)

    assert np.min([off(triangle) for triangle in corners], axis=0).max() < 1e-5, "off the pieces"
    length = np.where(at[:, 0] < 3 - 1e-6, at[:, 0], 3 + at[:, 1])
    for share in (0.1, 0.3, 3 / 7, 0.6, 0.9):
        assert abs(np.average(length < 7 * share, weights=points.area) - share) < 0.02, "along the strip"
    assert abs(np.average(at[:, 2] < 0.5, weights=points.area) - 0.25) < 0.05, "across the strip"
