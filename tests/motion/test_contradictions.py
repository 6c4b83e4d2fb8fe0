"""Rates and jumps of a motion that contradict it, in whatever portions it comes: more laws of log_checks/contradictions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.estimation.single_row_glitches import OVERLAP
from twistwrench.motion.contradictions import Contradictions
from twistwrench.motion.coordinates import Coordinates
from twistwrench.motion.motion_log import LogRows

T = np.arange(600) * 0.01
Q = np.column_stack([0.8 * np.sin(1.3 * T), 0.5 * np.sin(2.1 * T + 0.3)])
DQ = np.column_stack([0.8 * 1.3 * np.cos(1.3 * T), 0.5 * 2.1 * np.cos(2.1 * T + 0.3)])
DDQ = np.column_stack([-0.8 * 1.3**2 * np.sin(1.3 * T), -0.5 * 2.1**2 * np.sin(2.1 * T + 0.3)])
HINGE = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial>'
    '</link><joint name="{0}_joint" type="revolute"><parent link="{1}"/><child link="{0}"/><axis xyz="0 1 0"/>'
    '<origin xyz="0.5 0 0"/><limit lower="-6.2" upper="6.2" velocity="3" effort="50"/></joint>'
)
ARM = f'<robot name="arm"><link name="base"/>{HINGE.format("a", "base")}{HINGE.format("b", "a")}</robot>'


@pytest.fixture(scope="module")
def arm():
    return tw.load(ARM)


def said_of(arm, t, q, dq=None, ddq=None, portions=(), limits=None):
    tally = Contradictions(Coordinates.from_model(arm.model), time_stated=True, runs=[LogRows(t, q, dq, ddq)])
    for begin, end in pairwise((0, *portions, len(t))):
        rows = slice(max(0, begin - OVERLAP), end)
        tally.add(t[rows], q[rows], begin - rows.start)
    return tuple(map(str, tally.doubts(limits)))


def test_accelerations_beside_positions_alone_are_compared_with_their_second_slope(arm):
    assert said_of(arm, T, Q, None, DDQ) == ()
    (said,) = said_of(arm, T, Q, None, np.degrees(DDQ))
    assert "the acceleration column is 57.3 times the slope of the positions' velocities" in said
    (said,) = said_of(arm, T, Q, None, 2 * DDQ)
    assert "but some 2 times it" in said


@pytest.mark.parametrize("portions", [(), (300,), (299, 300, 301)])
def test_a_jump_is_seen_whatever_the_portions(arm, portions):
    q = Q.copy()
    q[300:, 1] += 3.6
    (said,) = said_of(arm, T, q, portions=portions)
    assert "b_joint jumps by 3." in said


def test_a_long_step_that_the_velocity_limit_allows_is_no_jump(arm):
    """A row a second of a slow motion, and in one second 3.6 rad: a joint that may make 3 rad/s has done so."""
    t = np.arange(60.0)
    q = np.column_stack([0.02 * t, 0.02 * t])
    q[30:, 1] += 3.6
    assert said_of(arm, t, q, limits=arm.limits) == ()
    (said,) = said_of(arm, t, q)
    assert "b_joint jumps" in said


def test_a_long_step_is_judged_by_the_limit_of_its_own_joint_on_a_floating_base_too(arm):
    """The base comes first in dq, and has no limits."""
    free = tw.load(ARM, floating_base=True)
    t = np.arange(60.0)
    q = np.column_stack([np.tile(free.neutral[:7], (60, 1)), 0.02 * t, 0.02 * t])
    q[30:, -1] += 3.6
    assert said_of(free, t, q, limits=free.limits) == ()
    (said,) = said_of(free, t, q, limits=replace(free.limits, velocity=np.r_[np.full(6, np.inf), 0.1, 0.1]))
    assert "b_joint jumps" in said


def test_nothing_is_said_of_rates_over_a_gap_in_time(arm):
    """The logger paused for half a swing: what the joints did meanwhile is in no row."""
    rows = np.r_[0:100, 340:440]
    assert said_of(arm, T[rows], Q[rows], DQ[rows]) == ()
    assert said_of(arm, T[rows], Q[rows], DQ[rows], DDQ[rows]) == ()


def test_accelerations_that_last_one_row_are_not_judged(arm):
    """A drive that changes its speed in kicks between two rows: of them, samples show as much as chance will have."""
    rng = np.random.default_rng(1)
    kicks = np.zeros(T.shape)
    kicks[5::12] = rng.uniform(0.5, 1.5, len(kicks[5::12])) * np.where(T[5::12] < 3, 1, -1)
    dq = np.cumsum(kicks)[:, None] * [0.1, 0.05]
    q = np.cumsum(dq, axis=0) * 0.01
    ddq = 3.0 * kicks[:, None] * [0.1, 0.05] / 0.01
    (said,) = said_of(arm, T, q, dq, ddq)
    assert "only in rows 0.120 s apart" in said
