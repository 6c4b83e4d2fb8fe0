"""Memory and time of an identification: bounded for any length of the logs and for any number of tested causes."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import twistwrench as tw
from twistwrench.core.estimation.filters import REACH, lagged, low_pass, low_pass_at
from twistwrench.core.estimation.single_row_glitches import SingleRowGlitches
from twistwrench.identification.diagnosis.cause_fit import CauseFit, log_fit, screen_causes
from twistwrench.identification.diagnosis.causes import continuous_causes
from twistwrench.identification.diagnosis.log_states import LogStates
from twistwrench.identification.hyperparameters import FitSettings
from twistwrench.identification.parameters import UnknownParameters
from twistwrench.identification.rows import SteadySamples


@pytest.mark.parametrize(("cutoff", "every"), [(30.0, 20), (100.0, 50), (100.0, 997)])
def test_few_samples_of_a_low_pass_are_those_of_the_whole(cutoff, every):
    """Everywhere, also at the ends: to the size of the response that is left out."""
    x = np.random.default_rng(0).normal(size=(6001, 3, 2)).cumsum(axis=0)
    at = np.unique(np.r_[0, 5, np.arange(3, len(x), every), len(x) - 1])
    found = low_pass_at(x, cutoff, 1000.0, at)
    assert REACH * 1000.0 / cutoff * 6 < len(x)
    assert_allclose(found, low_pass(x, cutoff, 1000.0)[at], rtol=0, atol=1e-12 * np.abs(x).max())
    dense = np.arange(3000)
    assert_array_equal(low_pass_at(x, cutoff, 1000.0, dense), low_pass(x, cutoff, 1000.0)[dense])


@pytest.mark.parametrize("cutoff", [20.0, 50.0])
def test_a_low_pass_leaves_a_straight_line_straight_to_both_ends(cutoff):
    """Reflected at its ends, a line goes on; a repeated sample there would shift the ends by about half a step."""
    line = 3.0 + 0.002 * np.arange(400)
    assert_allclose(low_pass(line, cutoff, 1000.0), line, rtol=0, atol=0.002 / 20)


def test_a_low_pass_in_portions_is_the_low_pass():
    x, steps = np.random.default_rng(1).normal(size=(500, 2)).cumsum(axis=0), 7.3
    parts, before = [], None
    for a, b in [(0, 64), (64, 100), (100, 101), (101, 500)]:
        parts.append(lagged(x[a:b], steps, before))
        before = parts[-1][-1]
    assert_allclose(np.concatenate(parts), lagged(x, steps), rtol=0, atol=1e-13 * np.abs(x).max())


def _states_of_a_log(seconds=30.0):
    robot, t = tw.robots.planar_2r(), np.arange(0.0, seconds, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    tau = tw.Motion(t, q, robot=robot).torques() + 0.1 * np.random.default_rng(0).normal(size=q.shape)
    samples = SteadySamples.pieces(t, q, tau, "log")
    unknown, settings = UnknownParameters(robot), FitSettings(5.0, np.full(2, 0.05), 0.0)
    return log_fit(unknown, samples, settings, np.zeros(2, bool))


def test_columns_of_a_low_pass_are_low_passed_columns(monkeypatch):
    """Whatever the length of the portions; gains are applied to torques alone."""
    s = _states_of_a_log().states.with_fields(lag=0.08, gain=np.array([2.0, -1.0]))
    x = np.random.default_rng(2).normal(size=s.base.count)
    assert_allclose(s.predicted_torques(x), s.gain * (s.columns @ x), rtol=1e-10, atol=1e-10)
    monkeypatch.setattr("twistwrench.identification.diagnosis.log_states.PORTION", 100)
    assert_allclose(
        s.with_fields(lag=0.08 + 0.0 * s.lag).columns, s.columns, rtol=0, atol=1e-12 * np.abs(s.columns).max()
    )
    every = s.with_fields(lag=0.0, rows=np.arange(len(s.time))).columns
    (piece,) = s.pieces
    expected = lagged(every[piece], s.lag * float(s.rate[0]))[s.rows]
    assert_allclose(s.columns, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("lag", [0.0, 0.08])
def test_columns_of_states_with_another_field_are_those_that_are_computed_anew(lag):
    """Whatever was computed before and is kept; each of these fields changes some of the columns."""
    s = _states_of_a_log().states.with_fields(lag=lag)
    names = ("bodies", "drives", "columns")
    known = {name: getattr(s, name) for name in names}
    n = len(s.time)
    (piece,) = s.pieces
    for field, value in {
        "q": s.q + 0.1, "dq": -0.9 * s.dq, "ddq": s.ddq + 0.1, "gravity": 1.1 * s.gravity, "weightless": (1,),
        "rows": s.rows[::2], "friction_speed": 2.0 * s.friction_speed, "lag": lag + 0.1,
        "pieces": [slice(piece.start, n // 2), slice(n // 2, n)],
    }.items():  # fmt: skip
        kept, anew = s.with_fields(**{field: value}), replace(s, **{field: value})
        changed = [name for name in names if not np.array_equal(getattr(anew, name), known[name])]
        assert changed, field
        for name in names:
            assert_array_equal(getattr(kept, name), getattr(anew, name), err_msg=f"{name} of another {field}")
    without = s.with_fields(lag=0.0, weightless=(0, 1)).bodies
    assert_array_equal(without, s.with_fields(lag=0.0, gravity=0.0 * s.gravity).bodies)


def test_fits_of_distant_starts_do_not_outlive_their_screening(monkeypatch):
    """Each start has rows of its own: all of them together took hundreds of megabytes."""
    import weakref

    fit, alive, most = _states_of_a_log(), list[weakref.ref[CauseFit]](), 0
    refit = CauseFit.refit

    def counted(self: CauseFit, states: LogStates, *laws: np.ndarray) -> CauseFit:
        nonlocal most
        found = refit(self, states, *laws)
        alive.append(weakref.ref(found))
        most = max(most, sum(one() is not None for one in alive))
        return found

    monkeypatch.setattr(CauseFit, "refit", counted)
    found = screen_causes(fit, continuous_causes(fit.states, wide=True))
    assert len(alive) > 10 and most <= 2
    assert len(found) == sum(len(cause.starts) for cause in continuous_causes(fit.states, wide=True))


def test_the_largest_wrong_rows_are_kept_in_the_order_of_their_size():
    """A rough log has a candidate in each tenth row: only the largest fifty of each joint are looked at."""
    rng, t = np.random.default_rng(0), np.arange(2000) * 0.01
    q = np.stack([np.sin(t), np.cos(t)], axis=1)
    rows = np.arange(10, 1990, 10)
    q[rows, 0] += rng.uniform(1e-3, 2e-3, len(rows)) * rng.choice([-1.0, 1.0], len(rows))
    q[777, 1] += 0.01
    whole, parts = (SingleRowGlitches(2, np.zeros(2, bool)) for _ in range(2))
    whole.add(t, q)
    for a in range(0, 2000, 500):
        parts.add(t[max(0, a - 6) : a + 500], q[max(0, a - 6) : a + 500])
    assert whole.result() == parts.result()
    ((joint, (glitch,)),) = whole.result()
    assert joint == 1 and glitch.time == t[777] and abs(glitch.size - 0.01) < 1e-4


CHILD = """
import sys, time
import numpy as np
import twistwrench as tw
from twistwrench.identification import identify
robot, (logs, count, rate) = tw.robots.ROBOT(), LOGS
def log(seed):
    rng, t = np.random.default_rng(seed), np.arange(count) / rate
    a, b = rng.normal(size=(2, robot.nv, 5)) / np.arange(1, 6) * 0.5
    w = 0.2 * np.pi * np.arange(1, 6)
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q, dq, ddq = sin @ a.T + cos @ b.T, (cos * w) @ a.T - (sin * w) @ b.T, -(sin * w**2) @ a.T - (cos * w**2) @ b.T
    tau = np.asarray(robot.inverse_dynamics(q, dq, ddq)) + 2.0 * np.tanh(dq / 0.02) + 0.3 * rng.normal(size=q.shape)
    tau[:, 2] *= SIGN
    return t, q, tau
spent = [0.0]
import importlib
module = importlib.import_module("twistwrench.identification.identify")
search = module.diagnose
def timed(*given):
    begun = time.process_time()
    found = search(*given)
    spent[0] += time.process_time() - begun
    return found
module.diagnose = timed
given = [log(k) for k in range(logs)]
begun = time.process_time()
found = identify(robot, [tw.Motion(t, q, tau=tau, robot=robot) for t, q, tau in given])
whole = time.process_time() - begun
peak = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(found.verdict.word, peak // 1024, whole / (whole - spent[0]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "logs", "sign"),
    [("ur5", (4, 4000, 100.0), 1.0), ("ur5", (4, 4000, 100.0), -1.0), ("panda", (1, 250_000, 1000.0), -1.0)],
    ids=("four logs", "four logs with a fault", "windows"),
)
def test_memory_and_time_of_the_search_for_causes_are_bounded(robot, logs, sign):
    """Of a child, whose largest memory is its own: 500 MB, and twice the processor time of the fit alone.

    The motion in memory counts: 250,000 samples of seven joints with their rates are 62 MB.
    """
    code = CHILD.replace("ROBOT", robot).replace("LOGS", repr(logs)).replace("SIGN", repr(sign))
    variables = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=variables)
    _, peak, ratio = child.stdout.split()[-3:]
    assert int(peak) <= 500 and float(ratio) <= 2.0, child.stdout
