"""Products, lengths and directions of rows."""

from __future__ import annotations

import numpy as np
import pytest

from app.math3d import put_rows, row_dots, row_lengths, unit_rows


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_rows_are_multiplied_and_measured_in_their_own_precision(dtype: type) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 50, 3)).astype(dtype)
    assert row_dots(a, b).dtype == row_lengths(a).dtype == unit_rows(a).dtype == dtype
    np.testing.assert_allclose(row_dots(a, b), (a * b).sum(axis=1), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(row_lengths(a), np.linalg.norm(a, axis=1), rtol=1e-6)
    np.testing.assert_allclose(row_lengths(unit_rows(a)), 1.0, rtol=1e-6)


def test_no_rows_and_rows_of_zeros_stay_what_they_are() -> None:
    none = np.zeros((0, 3), np.float32)
    assert row_dots(none, none).shape == row_lengths(none).shape == (0,) and unit_rows(none).shape == (0, 3)
    np.testing.assert_array_equal(unit_rows(np.zeros((2, 3), np.float32)), 0.0)


def test_put_rows_is_assignment_to_rows() -> None:
    rng = np.random.default_rng(0)
    expected, found = (np.zeros((9, 3), np.float32) for _ in range(2))
    for rows in (np.array([7, 2, 3]), np.array([], np.int64)):
        values = rng.normal(size=(len(rows), 3))
        expected[rows] = values
        put_rows(found, rows, values)
    assert np.array_equal(found, expected)
