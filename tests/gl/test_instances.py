"""Instances that one call draws are where their own matrices put them, whichever of them are drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.renderer import Renderer
from app.scene import Instance, Material, Motion, Scene
from app.settings import Settings
from tests.gl.scenes import make_scene, quad

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

PATCH, WIDE = ((-0.2, 0, 0.2), (0.4, 0, 0), (0, 0, -0.4)), ((-0.2, 0, 0.8), (0.4, 0, 0), (0, 0, -1.6))
TURNED = np.diag([1.0, -1, -1, 1])  # shows its back
MIRRORED = np.diag([-1.0, 1, 1, 1])


def at(x: float, linear: np.ndarray | None = None) -> np.ndarray:
    matrix = np.eye(4) if linear is None else linear.copy()
    matrix[0, 3] = x
    return matrix


def one_material() -> Scene:
    """Two meshes of one material without backs, from left to right: a patch, its mirror image, its back, one that is
    mirrored from 1 s on, and the other mesh; one more is far outside the picture."""
    scene = make_scene([quad(*PATCH), quad(*WIDE)])
    meshes = tuple(replace(mesh, material=0) for mesh in scene.meshes)
    turning = Motion(np.array([0.0, 1.0]), np.stack([at(0.8), at(0.8, MIRRORED)]))
    instances = [Instance("patch", 0, at(-1.6)), Instance("mirrored", 0, at(-0.8, MIRRORED)),
                 Instance("back", 0, at(0.0, TURNED)), Instance("turning", 0, np.eye(4), turning),
                 Instance("wide", 1, at(1.6)), Instance("outside", 1, at(100.0))]
    return replace(scene, meshes=meshes, instances=tuple(instances),
                   materials=(Material("paint", (0.5, 0.4, 0.3), is_back_culled=True),))


def test_each_instance_is_drawn_where_it_is() -> None:
    scene = one_material()
    with Renderer(scene, Settings(size=(96, 48), outputs=("instance", "normal"), taa=False)) as renderer:
        batches = renderer._geometry.batches
        pictures = [renderer.render(scene.cameras["main"].at(0.0), time) for time in (0.0, 1.0)]
    assert len(batches) == 1
    for picture in pictures:
        labels = picture["instance"][..., 0]
        middle = labels[24]
        assert [int(label) for label in dict.fromkeys(middle.tolist()) if label] == [1, 2, 4, 5]
        height = [int((labels[:, middle == label] == label).any(axis=1).sum()) for label in (1, 2, 4, 5)]
        assert height[0] == height[1] == height[2] and height[3] == pytest.approx(4 * height[0], abs=3)
        np.testing.assert_allclose(picture["normal"][labels > 0], [[0, 1, 0]] * int((labels > 0).sum()), atol=1e-6)


def test_normals_are_interpolated_at_unit_length_where_a_transform_stretches() -> None:
    scene = make_scene([quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))])
    left, right = np.array([-0.6, 0.8, 0.0]), np.array([0.1, 0.995, 0.0])
    mesh = scene.meshes[0]
    normals = np.where(mesh.positions[:, :1] < 0, left, right).astype(np.float32)
    stretched = np.diag([1.0, 6.0, 1.0, 1.0])
    scene = replace(scene, meshes=(replace(mesh, normals=normals),), instances=(Instance("quad", 0, stretched),))
    with Renderer(scene, Settings(size=(65, 65), outputs=("normal",), taa=False)) as renderer:
        middle = renderer.render(scene.cameras["main"].at(0.0))["normal"][32, 32]
    ends = [n / np.linalg.norm(n) for n in (left / [1, 6, 1], right / [1, 6, 1])]
    expected = (ends[0] + ends[1]) / np.linalg.norm(ends[0] + ends[1])
    np.testing.assert_allclose(middle, expected, atol=2e-3)
