"""Tracks, nodes, skins and morph targets against values by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.animation.deformation import Deformation, Skin, Vertices
from app.animation.node_tree import NodePlacement, NodeTrack, NodeTree
from app.animation.track import Interpolation, Track
from app.math3d import affine_matrix, translation
from tests.deforming import ANGLE, ELBOW, bent, morph_of, skin_of, waved

TIMES = np.array([1.0, 2.0, 4.0])


def track(values: list[list[float]], interpolation: Interpolation, **more: object) -> Track:
    return Track(TIMES, np.array(values, np.float64)[:, None], interpolation, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(("time", "expected"), [(0, 1), (1, 1), (1.999, 1), (2, 3), (3, 3), (4, -1), (9, -1)])
def test_step_holds_each_key_until_the_next(time: float, expected: float) -> None:
    assert track([[1], [3], [-1]], Interpolation.STEP).at(time).tolist() == [[expected]]


@pytest.mark.parametrize(("time", "expected"), [
    (0, 1), (1, 1), (1.25, 1.5), (2, 3), (3, 1), (3.5, 0), (4, -1), (9, -1)])
def test_linear(time: float, expected: float) -> None:
    assert track([[1], [3], [-1]], Interpolation.LINEAR).at(time)[0, 0] == pytest.approx(expected)


def test_a_cubic_spline_is_the_cubic_of_its_values_and_tangents() -> None:
    """Between 2 s and 4 s: value 3 and slope 0.5 at the start, value -1 and slope 2 at the end."""
    keys = [[[9], [1], [9]], [[9], [3], [0.5]], [[2], [-1], [9]]]
    spline = Track(TIMES, np.array(keys, np.float64)[:, :, None], Interpolation.CUBICSPLINE)
    system = [[1, 2, 4, 8], [1, 4, 16, 64], [0, 1, 4, 12], [0, 1, 8, 48]]  # c0 + c1 t + c2 t² + c3 t³ and its slope
    cubic = np.linalg.solve(system, [3, -1, 0.5, 2])
    for time in (2.0, 2.3, 3.0, 3.9, 4.0):
        assert spline.at(time)[0, 0] == pytest.approx(cubic @ [1, time, time**2, time**3])
    assert spline.at(0.0)[0, 0] == 1 and spline.at(5.0)[0, 0] == -1


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_take_the_shorter_way_at_constant_speed(sign: int) -> None:
    first, last = (Rotation.from_rotvec(v) for v in ([0.3, 0.2, -0.1], [0.5, -1.5, 0.4]))
    keys = np.stack([first.as_quat(), sign * last.as_quat()])[:, None]
    turn = Track(np.array([0.0, 2.0]), keys, are_rotations=True)
    step = (last * first.inv()).as_rotvec()
    assert np.linalg.norm(step) < np.pi
    for time in (0.0, 0.5, 1.0, 1.7, 2.0):
        expected = Rotation.from_rotvec(time / 2 * step) * first
        found = Rotation.from_quat(turn.at(time)[0])
        assert (found * expected.inv()).magnitude() < 1e-7


@pytest.mark.parametrize("angle", [0.0, 1e-9, np.pi - 1e-9, np.pi])
def test_nearly_equal_and_nearly_opposite_rotations_stay_unit(angle: float) -> None:
    keys = np.array([[[0, 0, 0, 1.0]], [[np.sin(angle / 2), 0, 0, np.cos(angle / 2)]]])
    found = Track(np.array([0.0, 1.0]), keys, are_rotations=True).at(0.25)[0]
    assert np.linalg.norm(found) == pytest.approx(1)
    assert found[0] == pytest.approx(np.sin(angle / 8), abs=1e-6)


def test_cubic_rotations_are_normalised() -> None:
    keys = np.zeros((2, 3, 1, 4))
    keys[:, 1, 0] = [[0, 0, 0, 1], [1, 0, 0, 0]]
    found = Track(np.array([0.0, 1.0]), keys, Interpolation.CUBICSPLINE, are_rotations=True).at(0.5)[0]
    np.testing.assert_allclose(found, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


def test_an_animation_with_a_period_begins_again() -> None:
    linear = track([[1], [3], [-1]], Interpolation.LINEAR, period=4.0)
    for time in (0.5, 1.5, 3.0):
        assert linear.at(time + 8)[0, 0] == pytest.approx(linear.at(time)[0, 0])
    assert linear.at(4.0)[0, 0] == 1


def test_nodes_follow_their_parents() -> None:
    """Of a chain of three, the middle one turns; the last is scaled and mirrored."""
    parents = np.array([2, -1, 1])  # 1 is the root, then 2, then 0
    quarter = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
    local = np.stack([affine_matrix(np.diag([2.0, -1, 1]), (1, 0, 0)), translation(np.array([5.0, 0, 0])), np.eye(4)])
    turn = Track(np.array([0.0, 1.0]), np.array([[[0, 0, 0, 1.0]], [quarter]]), are_rotations=True)
    tree = NodeTree(parents, local, np.array([[1.0, 0, 0], [5, 0, 0], [0, 3, 0]]), np.tile([0, 0, 0, 1.0], (3, 1)),
                    np.ones((3, 3)), (NodeTrack(np.array([2]), "rotation", turn),), 1.0)
    assert tree.moves.tolist() == [True, False, True]
    placed = NodePlacement(tree, 0, translation(np.array([0.5, 0, 0])))
    # The point is (1 + 2·(0.5 + 0.5), -1, 0) in the middle node's space; then a quarter turn, 3 up, 5 to the right.
    np.testing.assert_allclose(placed.at(1.0) @ [0.5, 1, 0, 1], [5 + 1, 3 + 3, 0, 1], atol=1e-12)
    np.testing.assert_allclose(placed.at(0.0) @ [0.5, 1, 0, 1], [5 + 3, 3 - 1, 0, 1], atol=1e-12)


def test_a_node_that_is_its_own_ancestor_is_refused() -> None:
    three = np.ones((3, 3))
    with pytest.raises(ValueError, match="its own ancestor"):
        NodeTree(np.array([1, 2, 0]), np.tile(np.eye(4), (3, 1, 1)), three, np.ones((3, 4)), three)


def test_two_joints_move_points_by_their_blended_matrices() -> None:
    rng = np.random.default_rng(0)
    positions = rng.uniform([-0.2, 0, -0.1], [0.2, 2, 0.1], (50, 3))
    deformation = skin_of(positions)
    assert deformation.moves and deformation.skin is not None
    for time in (0.0, 0.3, 1.0, 2.0):
        np.testing.assert_allclose(deformation.at(time).positions, bent(positions, min(time, 1.0)), atol=1e-6)


def test_normals_and_tangents_of_skins_stay_perpendicular_and_tangential() -> None:
    """Of a plane under one joint with shear and unequal scale."""
    linear = np.array([[1.0, 0.8, 0.2], [0, 2.0, 0], [0, 0.3, 0.5]])
    tree = NodeTree(np.array([-1]), affine_matrix(linear, (1, 2, 3))[None], np.zeros((1, 3)), np.ones((1, 4)),
                    np.ones((1, 3)))
    u, v = np.array([1.0, 0.5, 0]), np.array([0, 1.0, -0.4])
    base = Vertices(np.stack([0 * u, u, v]), np.tile(np.cross(u, v), (3, 1)), np.tile([*u, -1.0], (3, 1)))
    skin = Skin(tree, np.array([0]), np.eye(4)[None], np.zeros((3, 1), np.int64), np.ones((3, 1)))
    shape = Deformation(base, (), np.zeros(0), skin, tree.times).at(0.0)
    a, b, c = shape.positions.astype(np.float64)
    np.testing.assert_allclose(shape.normals[0], np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a)),
                               atol=1e-6)
    np.testing.assert_allclose(shape.tangents[0], [*(b - a) / np.linalg.norm(b - a), -1], atol=1e-6)


def test_morph_targets_add_up_before_the_skin() -> None:
    rng = np.random.default_rng(1)
    positions, first, second = rng.uniform(0, 1.5, (3, 20, 3))
    zeros = np.zeros_like(positions)
    skin = skin_of(positions).skin
    targets = Vertices(first, zeros), Vertices(second, zeros)
    weights = np.array([0.5, -2.0])
    both = Deformation(Vertices(positions, zeros), targets, weights, skin, np.zeros(1))
    alone = Deformation(Vertices(positions, zeros), targets, weights, None, np.zeros(1))
    morphed = positions + 0.5 * first - 2 * second
    np.testing.assert_allclose(alone.at(0.5).positions, morphed, atol=1e-6)
    # The weights of the joints are those of the points before they were morphed.
    weight = np.clip((positions[:, 1] - 0.7) / 0.6, 0, 1)[:, None]
    turned = ELBOW + Rotation.from_rotvec([0, 0, ANGLE / 2]).apply(morphed - ELBOW)
    np.testing.assert_allclose(both.at(0.5).positions, (1 - weight) * morphed + weight * turned, atol=1e-6)


def test_weights_are_animated_and_normals_are_unit() -> None:
    positions = np.random.default_rng(2).uniform(0, 2, (30, 3))
    deformation = morph_of(positions)
    for time in (0.0, 0.4, 1.0, 3.0):
        np.testing.assert_allclose(deformation.at(time).positions, waved(positions, min(time, 1.0)), atol=1e-6)
    base = Vertices(np.zeros((1, 3)), np.array([[0, 0, 1.0]]))
    target = Vertices(np.zeros((1, 3)), np.array([[0, 3.0, 3.0]]))
    shape = Deformation(base, (target,), np.ones(1), None, np.zeros(1)).at(0.0)
    np.testing.assert_allclose(shape.normals, [[0, 0.6, 0.8]], atol=1e-6)


def test_a_shape_is_kept_for_all_who_ask_at_one_time() -> None:
    deformation = morph_of(np.ones((4, 3)))
    first = deformation.at(0.5)
    assert deformation.at(0.5) is first and deformation.at(0.6) is not first


def test_shapes_are_relative_to_their_origin_and_finite() -> None:
    far = np.array([1e6, 0, 0])
    positions = far + np.random.default_rng(3).uniform(0, 1, (10, 3))
    rows = np.array([7, 2])
    shape = morph_of(positions).select(rows, far).at(1.0)
    np.testing.assert_allclose(shape.positions, waved(positions, 1.0)[rows] - far, atol=1e-6)
    broken = Deformation(Vertices(np.array([[np.nan, np.inf, 1e300]]), np.full((1, 3), np.nan)), (), np.zeros(0), None,
                         np.zeros(1)).at(0.0)
    assert np.isfinite(broken.positions).all() and np.isfinite(broken.normals).all()
