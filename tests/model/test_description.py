"""What a joint may be said to be: axes, pitches, poses and limits, and the snapping of fixed rotations."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.errors import (
    ModelError,
)
from twistwrench.formats.urdf import rotation_of_rpy
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.snapping import snap_rotation

pytestmark = pytest.mark.filterwarnings("ignore::twistwrench.core.errors.ModelWarning")


# ── joints ──


def joint_axes(kind: str, **options: object) -> np.ndarray:
    builder = ModelBuilder("one")
    builder.add_link("a")
    builder.add_link("b")
    builder.add_joint("j", kind, "a", "b", **options)
    return builder.build().bodies[0].joint.axes


def test_a_screw_axis_keeps_its_length_only_when_asked():
    S = [1, 0, 1, 0, 1, 0]  # the book's own first screw, which is not a unit screw
    assert np.allclose(joint_axes("helical", axis=S), [np.array(S) / np.sqrt(2)], atol=1e-16)
    assert joint_axes("helical", axis=S, normalise_axes=False).tolist() == [S]
    assert joint_axes("prismatic", axis=[0, 0, 0, 0, 3, 0]).tolist() == [[0, 0, 0, 0, 1, 0]]


def test_a_helical_joint_advances_by_its_pitch():
    assert joint_axes("helical", axis=(0, 0, 2), pitch=0.1).tolist() == [[0, 0, 1, 0, 0, 0.1]]


@pytest.mark.parametrize(
    ("kind", "options", "says"),
    [
        ("revolute", {"axis": (0, 0, 0)}, "zero axis"),
        ("revolute", {"axis": (0, 0, np.nan)}, "finite"),
        ("revolute", {"axis": (0, 0)}, "shape"),
        ("revolute", {"axis": "up"}, "the axis of joint 'j'"),
        ("revolute", {"axis": (0, 0, 0, 1, 0, 0)}, "nonzero omega"),
        ("prismatic", {"axis": (1, 0, 0, 1, 0, 0)}, "(0, 0, 0, v)"),
        ("helical", {"axis": (0, 0, 0, 0, 0, 0)}, "zero screw axis"),
        ("helical", {"axis": (1, 0, 0, 0, 0, 0), "pitch": 1.0}, "leave out pitch"),
        ("revolute", {"pitch": 1.0}, "only helical"),
        ("hinge", {}, "Allowed: revolute"),
        ("revolute", {"placement": 2 * np.eye(4)}, "not a pose"),
        ("revolute", {"placement": np.eye(3)}, "(4, 4)"),
        ("revolute", {"lower": 1.0, "upper": -1.0}, "reversed"),
        ("revolute", {"lower": np.nan}, "lower=nan"),
        ("revolute", {"effort": -1.0}, "effort=-1"),
        ("revolute", {"damping": np.inf}, "damping"),
        ("revolute", {"mimic": ("k", np.nan, 0.0)}, "mimic"),
    ],
)
def test_a_joint_that_cannot_be_meant_is_refused_by_name(kind, options, says):
    with pytest.raises(ModelError) as caught:
        joint_axes(kind, **options)
    assert "'j'" in str(caught.value)
    assert says in str(caught.value)


# ── snapping ──


def test_right_angles_become_exact():
    R = np.round(se3.exp([np.pi / 2, 0, 0, 0, 0, 0])[:3, :3] @ se3.exp([0, np.pi / 2, 0, 0, 0, 0])[:3, :3])
    noisy = se3.exp([3e-10, -2e-10, 1e-10, 0, 0, 0])[:3, :3] @ R
    assert np.array_equal(snap_rotation(noisy, 1e-9), R)
    assert np.array_equal(snap_rotation(noisy, 0), noisy)


def test_a_turn_beside_a_right_angle_of_eleven_digits_has_exact_zeros():
    """Rz(0.7) Rx(90°), its sines and cosines of eleven digits too: two columns are turned across the third, and stay a rotation."""
    typed = rotation_of_rpy([1.57079632679, 0.0, 0.7])
    typed[:2, [0, 2]] = np.round(typed[:2, [0, 2]], 11)
    R = snap_rotation(typed, 1e-9)
    assert np.abs(R @ R.T - np.eye(3)).max() <= 1e-15
    assert (R == 0.0).tolist() == [[False, True, False], [False, True, False], [True, False, True]]
    assert R[2, 1] == 1.0
    np.testing.assert_allclose(R[:2, [0, 2]], [[np.cos(0.7), np.sin(0.7)], [np.sin(0.7), -np.cos(0.7)]], atol=1e-11)


@pytest.mark.parametrize("angle", [2e-9, 1e-8, 1e-6, 1e-5, 1e-3])
def test_a_small_angle_is_left_to_the_last_bit(angle):
    R = se3.exp([0, 0, angle, 0, 0, 0])[:3, :3]
    assert np.array_equal(snap_rotation(R, 1e-9), R)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_snapped_stays_a_rotation_to_the_last_bit(seed):
    # Angles about three axes, of which some are right, as a file with eleven digits has them.
    rng = np.random.default_rng(seed)
    for _ in range(300):
        angles = np.where(rng.random(3) < 0.6, 0.5 * np.pi * rng.integers(-2, 3, 3), rng.uniform(-np.pi, np.pi, 3))
        small = np.where(rng.random(3) < 0.3, rng.choice([1e-4, 1e-5, 3e-10], 3), 0.0)
        exact = rotation_of_rpy(angles + small)
        typed = rotation_of_rpy(np.round(angles + small + 3e-10 * rng.uniform(-1, 1, 3), 11))
        R = snap_rotation(typed, 1e-9)
        # Sums of three products of numbers up to 1, each rounded: 1e-15 is a few units of the last place.
        assert np.abs(R @ R.T - np.eye(3)).max() <= 1e-15
        assert np.linalg.det(R) > 0
        assert np.abs(R - exact).max() <= 3e-9
        assert np.array_equal(snap_rotation(R, 1e-9), R), "once is enough"
        if not small.any() and (angles % (0.5 * np.pi) == 0).all():
            assert np.array_equal(R, np.round(exact))


def test_products_of_fixed_rotations_are_snapped_too():
    eighth = se3.exp([0, 0, np.pi / 4, 0, 0, 0])
    builder = ModelBuilder("turns")
    for i in range(3):
        builder.add_link(f"l{i}")
    builder.add_joint("a", "fixed", "l0", "l1", placement=eighth)
    builder.add_joint("b", "revolute", "l1", "l2", placement=eighth)
    exact = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert builder.build().bodies[0].placement.tolist() == exact
    assert builder.build(snap=0).bodies[0].placement.tolist() != exact


def test_remarks_that_say_the_same_are_one_sentence():
    """Six joints with effort=0 are one warning and one line of info; each remark by itself stays in the defects."""
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    links = "".join(f'<link name="l{k}"><inertial><mass value="1"/>{inertia}</inertial></link>' for k in range(9))
    joints = "".join(
        f'<joint name="j{k}" type="prismatic"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<limit lower="-1" upper="1" effort="0" velocity="1"/></joint>'
        for k in range(8)
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        robot = tw.load(f'<robot name="r">{links}{joints}</robot>')
    efforts = [str(w.message) for w in said if "effort=0" in str(w.message)]
    assert len(efforts) == 1
    assert "joint 'j0'" in efforts[0] and "the same of joint 'j1'" in efforts[0] and "and 3 more" in efforts[0]
    assert sum("effort=0" in defect for defect in robot.defects) == 8
    assert pickle.loads(pickle.dumps(robot)).defects == robot.defects
