"""Held-out half of the kinds of faults: no rule is tuned on these. A new kind is one line and one function."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.signal import lfilter

from bench.one_fault_kinds import Fault, Needs
from bench.one_fault_logs import Recording
from bench.one_fault_open import moving


def zeros_inside(log: Recording) -> None:
    """Some rows in the middle are zeros."""
    k = int(log.rng.uniform(0.2, 0.8) * len(log.t))
    log.q[k : k + int(log.rng.integers(1, 5))] = 0.0


def rows_twice(log: Recording) -> None:
    """A stretch of rows is written twice, with stamps that go on."""
    n = len(log.t)
    start, length = int(log.rng.uniform(0.2, 0.6) * n), max(4, int(log.rng.uniform(0.05, 0.12) * n))
    order = np.concatenate([np.arange(start + length), np.arange(start, n)])
    t = log.t[0] + np.arange(len(order)) / log.rate
    log.t = np.concatenate([log.t, np.zeros(length)])
    for name in ("q", "dq", "tau"):
        if getattr(log, name) is not None:
            setattr(log, name, getattr(log, name)[order])
    log.t = t


def clock_reset(log: Recording) -> None:
    """Stamps begin anew in the middle."""
    k = len(log.t) // 2
    log.t = np.concatenate([log.t[:k], log.t[k:] - log.t[k] + log.t[0]])


def rezeroed_inside(log: Recording) -> None:
    """An encoder counts from another zero from the middle on."""
    k, row = moving(log), int(log.rng.uniform(0.3, 0.7) * len(log.t))
    log.q[row:, k] += float(log.rng.choice([-1, 1]) * log.rng.uniform(0.1, 1.0)) * (1.0 if log.judge.turns[k] else 0.1)


def millimetres(log: Recording) -> None:
    """Sliding joints in millimetres, under plain names."""
    log.q[:, ~log.judge.turns] *= 1e3


def speeds_in_degrees(log: Recording) -> None:
    """A table of the robot's limits, its velocities in degrees a second."""
    velocity = np.where(log.judge.turns, np.degrees(log.judge.limits.velocity), log.judge.limits.velocity)
    log.limits = log.judge.limits._replace(velocity=velocity)


def efforts_times(log: Recording, *, times: float) -> None:
    """A table of the robot's limits, its efforts in another unit."""
    log.limits = log.judge.limits._replace(effort=log.judge.limits.effort * times)


def currents(log: Recording) -> None:
    """Measured currents under the name of torques; gains from 2 to 15 N m/A."""
    assert log.tau is not None
    log.tau = log.tau / log.rng.uniform(2.0, 15.0, log.tau.shape[1])


def late_torques(log: Recording) -> None:
    """Measured torques that are a tenth of a second late, and filtered at 3 Hz."""
    assert log.tau is not None
    rows, keep = max(1, round(0.1 * log.rate)), np.exp(-2 * np.pi * 3.0 / log.rate)
    late = np.vstack([np.repeat(log.tau[:1], rows, axis=0), log.tau[:-rows]])
    log.tau = lfilter([1 - keep], [1, -keep], late, axis=0, zi=late[:1] * keep)[0]


def single_precision(log: Recording) -> None:
    """Stamps of a computer that is up for two weeks, in single precision."""
    log.t = (log.t - log.t[0] + 1_234_567.0).astype(np.float32).astype(float)


def saturated(log: Recording) -> None:
    """Positions of a joint that stop at 60 % of their way."""
    k = moving(log)
    log.q[:, k] = np.minimum(log.q[:, k], log.q[:, k].min() + 0.6 * np.ptp(log.q[:, k]))


def milliradians(log: Recording) -> None:
    """Positions as whole thousandths: the decimal point is lost."""
    log.q = np.round(1e3 * log.q)


def said_in_degrees(log: Recording) -> None:
    """Headers say degrees, the numbers are radians."""
    log.units = ["deg" if turns else "" for turns in log.judge.turns]


def milliseconds(log: Recording) -> None:
    """Time in milliseconds, under a plain name."""
    log.t = 1e3 * (log.t - log.t[0])


def no_value(log: Recording) -> None:
    """A row of 9999 where a value is missing."""
    log.q[int(log.rng.uniform(0.2, 0.8) * len(log.t))] = 9999.0


def one_late(log: Recording) -> None:
    """One joint is 60 ms late from the middle on."""
    k, row = moving(log), len(log.t) // 2
    log.q[row:, k] = log.motion(log.t[row:] - _start(log) - 0.06)[0][:, k + log.judge.base]


def clock_times(log: Recording, *, times: float) -> None:
    """A clock that runs at another rate; rates of the columns stay."""
    log.t = log.t[0] + times * (log.t - log.t[0])


def blocks_exchanged(log: Recording) -> None:
    """Two parts of the log in the wrong order."""
    n = len(log.t)
    a, b = sorted(int(x) for x in log.rng.uniform(0.2, 0.8, 2) * n)
    rows = np.concatenate([np.arange(a), np.arange(b, n), np.arange(a, b)])
    log.keep(rows, closed_up=True)


def a_column_of_another_row(log: Recording) -> None:
    """Positions of a later row in one row, as of two threads that write at once."""
    k = int(log.rng.uniform(0.2, 0.6) * len(log.t))
    log.q[k] = log.q[k + len(log.t) // 4]


def more_than_computed(log: Recording) -> None:
    """Measured torques with a load that the file does not have: their peak is 130 % of the limit."""
    assert log.tau is not None
    k = int(np.argmax(np.abs(log.tau).max(axis=0) / log.judge.limits.effort))
    peak = np.abs(log.tau[:, k]).max()
    log.tau[:, k] *= 1.3 * log.judge.limits.effort[k] / peak


def rates_in_degrees(log: Recording) -> None:
    """A column of velocities in degrees a second beside positions in radians."""
    dq = log.motion(log.t - _start(log))[1]
    log.dq = np.degrees(dq)


def dropped(log: Recording) -> None:
    """A third of the rows missing at random, the stamps closed up."""
    log.keep(log.rng.random(len(log.t)) > 0.33, closed_up=True)


def a_step_back(log: Recording) -> None:
    """A few rows are repeated from before: the logger wrote its buffer again."""
    n = len(log.t)
    k, length = int(log.rng.uniform(0.3, 0.7) * n), int(log.rng.integers(3, 9))
    log.q[k : k + length] = log.q[k - length : k]


def bits_lost(log: Recording) -> None:
    """Positions of one joint in steps of 1/16 of its way."""
    k = moving(log)
    step = np.ptp(log.q[:, k]) / 16
    log.q[:, k] = np.round(log.q[:, k] / step) * step


def _start(log: Recording) -> float:
    """Stamp of the motion's beginning."""
    return float(log.t[0])


KINDS = (
    Fault("zeros inside", zeros_inside),
    Fault("rows written twice", rows_twice),
    Fault("clock begins anew", clock_reset),
    Fault("an encoder re-zeroed inside", rezeroed_inside),
    Fault("millimetres, plain names", millimetres, needs=Needs(slides=True)),
    Fault("limits of speed in degrees", speeds_in_degrees, needs=Needs(efforts=True, velocities=True, turns=True)),
    Fault("limits in N mm", partial(efforts_times, times=1000.0), needs=Needs(efforts=True)),
    Fault("limits in kgf cm", partial(efforts_times, times=10.2), needs=Needs(efforts=True)),
    Fault("currents for torques", currents, needs=Needs(efforts=True, measured=True)),
    Fault("torques late and filtered", late_torques, needs=Needs(efforts=True, measured=True)),
    Fault("stamps in single precision", single_precision),
    Fault("positions saturated", saturated),
    Fault("thousandths, plain names", milliradians),
    Fault("[deg] over radians", said_in_degrees, needs=Needs(turns=True, forms=("csv", "gzip", "tabs"))),
    Fault("milliseconds, plain name", milliseconds, needs=Needs(forms=("csv", "npz", "semicolons", "parquet"))),
    Fault("9999 for no value", no_value),
    Fault("one joint late from the middle", one_late),
    Fault("clock at half the rate", partial(clock_times, times=0.5), trace="measured"),
    Fault("blocks exchanged", blocks_exchanged),
    Fault("a row of another time", a_column_of_another_row),
    Fault("measured beyond the limit", more_than_computed, needs=Needs(efforts=True, measured=True)),
    Fault("velocities in degrees", rates_in_degrees),
    Fault("a third dropped, stamps closed up", dropped),
    Fault("a buffer written again", a_step_back),
    Fault("positions in 16 steps", bits_lost),
)
