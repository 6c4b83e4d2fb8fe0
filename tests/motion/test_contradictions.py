"""Rates and jumps of a motion that contradict it, in whatever portions it comes: more laws of log_checks/contradictions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.estimation.logged_rates import rate_scales, segments
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


def time_said(arm, n, step, move, *, first=0.0, limited=True, stated=False, counts=False, origin="log", dq=False):
    """Names and sentences of the doubts of time of n rows, ``step`` apart, in each of which a joint moves by ``move``."""
    t = first + step * np.arange(n)
    q = np.column_stack([move * np.arange(n), np.zeros(n)])
    v = np.column_stack([np.full(n, move / step), np.zeros(n)]) if dq else None
    rows = [LogRows(t, q, v, None)]
    tally = Contradictions(Coordinates.from_model(arm.model), time_stated=stated, may_count_rows=counts, runs=rows)
    tally.add(t, q)
    return [str(d) for d in tally.doubts(arm.limits if limited else None, origin=origin)]


@pytest.mark.parametrize(
    ("rows", "step", "move", "unit"),
    [
        (20, 10.0, 0.01, "ms"),
        (19, 10.0, 0.01, None),  # too few rows
        (100, 450.0, 0.001, "ms"),
        (100, 550.0, 0.001, "us"),
        (100, 4.5e5, 0.001, "us"),
        (100, 550.0, 0.0024, "us"),
        (100, 550.0, 0.0026, None),  # 4.7 rad/s in us
        (100, 5.5e5, 0.001, "ns"),
        (52, 10.0, 0.001, "ms"),
        (49, 10.0, 0.001, None),  # moves by less than 0.05 rad
        (100, 20.0, 0.089, "ms"),
        (100, 20.0, 0.091, None),  # 4.55 rad/s in ms, and the drive makes 3 rad/s: more than half as fast again
        (300, 0.11, 0.0004, "ms"),
        (300, 0.09, 0.0004, None),  # a slow logger
        (300, 0.2, 0.00088, "ms"),
        (300, 0.2, 0.00092, None),  # again too fast in ms
    ],
)
def test_steps_of_time_that_are_long_for_what_happens_in_them_are_in_a_smaller_unit(arm, rows, step, move, unit):
    found = [said for said in time_said(arm, rows, step, move) if "time seems to be in" in said]
    assert len(found) == (unit is not None)
    if unit is not None:
        assert f"time seems to be in {unit}" in found[0] and f"[{unit}]" in found[0]
        why = f"no joint moves by more than {move:.2g} rad or m" if step > 1.0 else "no joint moves faster than 0."
        assert why in found[0]
        assert step != 0.11 or "0.12 % of its limit of velocity" in found[0]
    assert not any("time seems" in said for said in time_said(arm, rows, step, move, stated=True))


@pytest.mark.parametrize(
    ("step", "move", "doubted"),
    [
        (2.0, 0.058, True),
        (2.0, 0.062, False),
        (40.0, 0.099, True),
        (40.0, 0.101, False),
        (1.0, 0.02, True),
        (0.9, 0.02, False),
    ],
)
def test_without_limits_a_second_is_long_for_a_tenth_of_a_radian_and_30_rad_per_s_are_too_fast(
    arm, step, move, doubted
):
    found = time_said(arm, 30, step, move, limited=False)
    assert any("time seems to be in ms" in said for said in found) == doubted
    assert not any("time seems to be in" in said for said in found) or doubted


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({}, "time rises by exactly 1 in each of 20 rows, as row numbers do"),
        ({"n": 19}, "usual time step is 1 s"),  # too few rows
        ({"first": 0.5}, "usual time step is 1 s"),  # row numbers are whole
        ({"step": 2.0}, "usual time step is 2 s"),
        ({"counts": False}, "usual time step is 1 s"),  # the column names a unit
        ({"dq": True}, "usual time step is 1 s"),  # velocities say that time is in seconds
        ({"origin": "plan"}, "usual time step is 1 s"),
        ({"move": 0.46}, "usual time step is 1 s"),  # ten rows a second would need 4.6 rad/s
        ({"move": 0.44}, "row numbers"),
        ({"step": 0.9, "counts": False}, None),
        ({"stated": True}, None),
    ],
)
def test_time_that_rises_by_one_in_each_row_may_count_rows(arm, options, word):
    asked = {"n": 20, "step": 1.0, "move": 0.3, "counts": True} | options
    found = [said for said in time_said(arm, **asked) if "usual time step" in said or "row numbers" in said]
    assert [word in said for said in found] == ([True] if word else [])


@pytest.mark.parametrize(
    ("count", "gap", "found"),
    [
        (7, None, []),
        (8, None, [(0, 8)]),
        (512, None, [(0, 512)]),
        (519, None, [(0, 512)]),  # seven rows are too few
        (520, None, [(0, 512), (512, 520)]),
        (600, 100, [(0, 100), (100, 512), (512, 600)]),
        (600, 7, [(7, 512), (512, 600)]),
    ],
)
def test_rates_are_integrated_over_8_to_512_rows_without_a_gap(count, gap, found):
    time = 0.01 * np.arange(count)
    if gap is not None:
        time[gap:] += 5.0
    assert [(rows.start, rows.stop) for rows in segments(time)] == found


def scale_of(x, y, *more):
    """Scale of a rate y over the slope of x, beside further curves of its kind with right rates."""
    t = 0.01 * np.arange(len(x))
    x, y = np.column_stack([x, *more]), np.column_stack([y, *(np.gradient(c, t) for c in more)])
    return float(rate_scales([(t, x, y)], np.zeros(x.shape[1], int))[0])


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_scale_of_a_rate_is_that_to_a_curve_that_moves_either_way(direction):
    """Half a turn at constant speed; by the counts of an encoder; and slowly beside another joint."""
    ramp, ones = np.linspace(0.0, 1.0, 500) * direction, np.ones(500) * direction / 4.99
    assert scale_of(3.0 * ramp, 3.0 * ones) == pytest.approx(1.0, abs=1e-9)
    assert scale_of(3.0 * ramp, 6.0 * ones) == pytest.approx(2.0, abs=1e-9)
    assert scale_of(3.0 * ramp, -3.0 * ones) == pytest.approx(-1.0, abs=1e-9)
    for counts, judged in ((29, False), (32, True)):  # a curve moves by more than 30 counts
        x = np.round(counts * ramp) * 1e-4
        assert (scale_of(x, 2.0 * counts * 1e-4 * ones) == pytest.approx(2.0, rel=0.02)) == judged
    for share, judged in ((0.018, False), (0.022, True)):  # of the speed of the fastest
        assert (scale_of(share * ramp, 2.0 * share * ones, ramp) == pytest.approx(2.0, abs=1e-6)) == judged
    for size, judged in ((0.9e-10, False), (1.1e-10, True)):  # rounding
        assert (scale_of(size * ramp, 2.0 * size * ones) == pytest.approx(2.0, rel=1e-3)) == judged


@pytest.mark.parametrize(
    ("moves", "still", "found"), [(0.21, 0.0, np.inf), (0.19, 0.0, 1.0), (0.21, 0.005, 1.0), (0.21, 0.004, np.inf)]
)
def test_a_rate_of_more_than_a_fifth_beside_a_curve_at_rest_contradicts_it(moves, still, found):
    """At rest is what moves by less than a fiftieth of that, to and fro."""
    flicker = still * (np.arange(500) % 2)
    assert scale_of(flicker, moves * np.ones(500) / 4.99) == found
