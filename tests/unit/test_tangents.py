"""Computed tangents, against parametric surfaces and per-triangle gradients."""

from __future__ import annotations

import numpy as np
import pytest

from app.load.geometry import RawMesh
from app.load.tangents import add_tangents


def grid(function, uv_of=lambda s, t: (s, t), steps=40):
    """The surface ``function(s, t)`` over the unit square with exact normals, and its uvs."""
    s, t = (x.ravel() for x in np.meshgrid(*[np.linspace(0, 1, steps + 1)] * 2, indexing="ij"))
    h = 1e-6
    points = np.stack(function(s, t), axis=1)
    along_s = (np.stack(function(s + h, t), axis=1) - points) / h
    along_t = (np.stack(function(s, t + h), axis=1) - points) / h
    at = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()
    triangles = np.concatenate([np.stack([at, at + steps + 1, at + 1], axis=1),
                                np.stack([at + 1, at + steps + 1, at + steps + 2], axis=1)])
    mesh = RawMesh(points, triangles, unit(np.cross(along_s, along_t)))
    return mesh, np.stack(uv_of(s, t), axis=1), unit(along_s), unit(along_t)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def wavy(s, t):
    return s, t, 0.1 * np.sin(5 * s) * np.cos(4 * t)


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.5])
def test_tangents_follow_u_of_a_curved_surface(turn):
    cos, sin = np.cos(turn), np.sin(turn)
    mesh, uvs, along_s, along_t = grid(wavy, lambda s, t: (3 * (cos * s + sin * t), 2 * (cos * t - sin * s)))
    tangents = add_tangents(mesh, uvs).tangents
    expected = cos * along_s + sin * along_t
    expected = unit(expected - (expected * mesh.normals).sum(axis=1, keepdims=True) * mesh.normals)
    inner = np.abs(mesh.positions[:, :2] - 0.5).max(axis=1) < 0.45
    assert (tangents[inner, :3] * expected[inner]).sum(axis=1).min() > 0.99
    assert (tangents[:, 3] == 1).all()
    np.testing.assert_allclose((tangents[:, :3] * mesh.normals).sum(axis=1), 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1)


def test_mirrored_uvs_have_the_other_sign():
    mesh, uvs, along_s, _ = grid(wavy, lambda s, t: (1 - s, t))
    tangents = add_tangents(mesh, uvs).tangents
    assert (tangents[:, 3] == -1).all()
    assert ((tangents[:, :3] * along_s).sum(axis=1) < -0.9).all()


def test_vertices_between_mirrored_halves_are_split():
    mesh, uvs, *_ = grid(lambda s, t: (s, t, 0 * s), lambda s, t: (np.abs(s - 0.5), t), steps=4)
    split = add_tangents(mesh, uvs)
    assert len(split.positions) == len(mesh.positions) + 5  # those of the seam
    for triangle in split.triangles:
        side = 1.0 if split.positions[triangle, 0].mean() > 0.5 else -1.0
        np.testing.assert_allclose(split.tangents[triangle], [[side, 0, 0, side]] * 3, atol=1e-12)
    np.testing.assert_array_equal(split.positions[split.triangles], mesh.positions[mesh.triangles])


def test_equal_vertices_share_a_tangent():
    mesh, uvs, *_ = grid(wavy, lambda s, t: (s * s + 0.1 * s, t + 0.3 * s * t), steps=6)
    corners = mesh.triangles.ravel()
    soup = RawMesh(mesh.positions[corners], np.arange(len(corners)).reshape(-1, 3), mesh.normals[corners])
    np.testing.assert_allclose(add_tangents(soup, uvs[corners]).tangents, add_tangents(mesh, uvs).tangents[corners],
                               atol=1e-12)


def test_without_normals_each_triangle_has_its_own():
    mesh, uvs, *_ = grid(wavy, steps=3)
    flat = add_tangents(RawMesh(mesh.positions, mesh.triangles, colors=np.arange(64.0).reshape(16, 4)), uvs)
    assert len(flat.positions) == 3 * len(mesh.triangles)
    a, b, c = (flat.positions[flat.triangles[:, i]] for i in range(3))
    np.testing.assert_allclose(unit(flat.normals[flat.triangles[:, 1]]), unit(np.cross(b - a, c - a)), atol=1e-12)
    np.testing.assert_array_equal(flat.colors[flat.triangles, 0], 4.0 * mesh.triangles)
    assert np.ptp(flat.tangents[flat.triangles], axis=1).max() < 1e-12


@pytest.mark.parametrize("broken", [0.0, np.nan, np.inf])
def test_degenerate_input_gives_finite_tangents(broken):
    mesh, uvs, *_ = grid(wavy, steps=3)
    for values in (mesh.positions, mesh.normals, uvs):
        values[5:9] = broken
    with np.errstate(all="ignore"):
        tangents = add_tangents(mesh, uvs).tangents
    assert np.isfinite(tangents).all()
