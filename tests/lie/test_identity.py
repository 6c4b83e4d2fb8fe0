"""The identity pose that everybody shares: products with it are the other factor, and nobody can write to it."""

from __future__ import annotations

import numpy as np
import pytest

from twistwrench.mechanics.lie import se3, so3
from twistwrench.mechanics.lie.identity import IDENTITY, UPRIGHT, is_identity, pose_rows, product


def test_products_are_those_of_matrices():
    T = se3.pose(so3.exp([0.3, -0.2, 0.5]), [1.0, 2.0, 3.0])
    S = se3.pose(so3.exp([-0.1, 0.4, 0.2]), [0.5, -1.0, 2.0])
    for A, B in ((T, T), (T, S), (S, T), (T, IDENTITY), (IDENTITY, T), (IDENTITY, IDENTITY), (np.eye(4), T)):
        np.testing.assert_array_equal(product(A, B), A @ B)
    assert product(IDENTITY, T) is T
    assert product(T, IDENTITY) is T


def test_what_moves_nothing_is_known():
    assert is_identity(IDENTITY)
    assert is_identity(np.eye(4))
    assert is_identity(np.where(np.eye(4) == 0.0, -0.0, 1.0))
    assert not is_identity(se3.pose(np.eye(3), [0.0, 0.0, 1e-300]))


def test_rows_make_a_pose():
    R = so3.exp([0.3, -0.2, 0.5])
    np.testing.assert_array_equal(pose_rows(R.tolist(), [1.0, 2.0, 3.0]), se3.pose(R, [1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(pose_rows(UPRIGHT, [0.0, 0.0, 0.0]), IDENTITY)


def test_nobody_can_write_to_it():
    with pytest.raises(ValueError, match="read-only"):
        IDENTITY[0, 3] = 1.0
