"""One wrong row of a log contradicts the rest; corners, stairs, noise and knocks do not."""

import math

import numpy as np
import pytest

import twistwrench as tw

ROBOT = tw.robots.panda()
T = np.linspace(0, 2, 401)
SHARE = 10 * (T / 2) ** 3 - 15 * (T / 2) ** 4 + 6 * (T / 2) ** 5
START, END = np.array([0.1, -0.3, 0.2, -1.5, 0.1, 1.6, 0.3]), np.array([0.7, 0.4, -0.5, -2.0, 0.6, 2.4, 1.0])
CLEAN = START + SHARE[:, None] * (END - START)


def contradictions(q, t=T):
    return tuple(map(str, tw.Motion(t, q, robot=ROBOT).contradictions))


@pytest.mark.parametrize("row", [3, 17, 200, 397])
@pytest.mark.parametrize("size", [0.005, 0.7, -2.0])
def test_a_single_wrong_row_is_named_with_its_size_and_time(row, size):
    q = CLEAN.copy()
    q[row, 2] += size
    (said,) = contradictions(q)
    assert said.startswith("panda_joint3 leaves its path")
    assert f"t = {T[row]:.4f} s" in said
    told = float(said.partition("by ")[2].partition(" degrees")[0])
    assert told == pytest.approx(abs(math.degrees(size)), rel=0.01)  # three digits, beside a path that curves a little


def test_several_rows_of_several_joints():
    q = CLEAN.copy()
    for row in (50, 120, 300, 350):
        q[row, 0] += 0.2
    q[77, 5] -= 0.1
    first, second = contradictions(q)
    assert "panda_joint1" in first and "and 1 more" in first
    assert "panda_joint6" in second


def test_a_row_that_was_taken_early_is_on_its_path():
    """Rows need not be evenly spaced: this one has the position of its own time."""
    t = T.copy()
    t[200] -= 0.002
    s = 10 * (t / 2) ** 3 - 15 * (t / 2) ** 4 + 6 * (t / 2) ** 5
    assert contradictions(START + s[:, None] * (END - START), t) == ()


def test_a_joint_that_is_much_faster_than_the_others_is_wrong_alone():
    """Any deviation of the fastest joint fits some delay of the stamp; only the slower ones tell a wrong stamp from it."""
    travel = (END - START) * np.where(np.arange(7) == 2, 1.0, 0.15)
    wrong_position = START + SHARE[:, None] * travel
    wrong_position[200, 2] += 0.1
    (said,) = contradictions(wrong_position)
    assert said.startswith("panda_joint3 leaves its path by 5.7")
    stamp = T.copy()
    stamp[200] -= 0.002  # the positions are those of 1 s
    (said,) = contradictions(START + SHARE[:, None] * travel, stamp)
    assert "the time stamp of 1 row is 0.002 s early" in said


MEANT = {
    "clean": CLEAN,
    "noise": CLEAN + 1e-4 * np.random.default_rng(1).normal(size=CLEAN.shape),
    "counts": np.round(CLEAN * 4096 / math.tau) * math.tau / 4096,
    "corners": START + np.interp(T, [0, 0.5, 1.5, 2.0], [0, 0, 1, 1])[:, None] * (END - START),
    "there and back at once": START + np.interp(T, [0, 1, 2], [0, 1, 0])[:, None] * (END - START),
    "knock": CLEAN + 0.02 * np.exp(-(((T - 1) / 0.01) ** 2))[:, None],
    "bang bang": START + np.where(T < 1, T**2 / 2, 1 - (2 - T) ** 2 / 2)[:, None] * (END - START),
    "a count that flickers at rest": START + np.outer(T[100] == T, np.full(7, math.tau / 4096)),
    "held samples": CLEAN[np.arange(401) // 4 * 4],
}


@pytest.mark.parametrize("name", MEANT)
def test_what_may_be_meant_is_no_glitch(name):
    assert not any("leaves its path" in said for said in contradictions(MEANT[name]))


@pytest.mark.parametrize("row", range(60, 70))
def test_portions_of_a_long_file_find_the_same(row):
    """Long logs are looked at in portions; whatever row a portion ends at, the glitch is found."""
    from twistwrench.core.estimation.single_row_glitches import OVERLAP, SingleRowGlitches

    q = CLEAN.copy()
    q[row, 2] += 0.3
    whole, parts = (SingleRowGlitches(7, np.ones(7, bool)) for _ in range(2))
    whole.add(T, q)
    for first in range(0, len(T), 32):
        rows = slice(max(0, first - OVERLAP), first + 32)
        parts.add(T[rows], q[rows])
    assert whole.result() == parts.result()
    assert [k for k, _ in parts.result()] == [2]
