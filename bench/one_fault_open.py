"""Open half of the kinds of faults: rules of plausibility are tuned on these. A new kind is one line and one function."""

from __future__ import annotations

from functools import partial

import numpy as np

from bench.one_fault_kinds import Fault, Needs
from bench.one_fault_logs import Recording


def cut_out(log: Recording) -> None:
    """Rows of a tenth of the log left out, the stamps closed up."""
    n = len(log.t)
    start, length = int(log.rng.uniform(0.25, 0.6) * n), max(3, int(log.rng.uniform(0.04, 0.12) * n))
    rows = np.ones(n, bool)
    rows[start : start + length] = False
    log.value |= {"at": round(float(log.t[start] - log.t[0]), 4), "rows": length}
    log.keep(rows, closed_up=True)


def gap(log: Recording) -> None:
    """The same rows left out, with the stamps that they had."""
    n = len(log.t)
    start, length = int(log.rng.uniform(0.25, 0.6) * n), max(3, int(log.rng.uniform(0.02, 0.06) * n))
    rows = np.ones(n, bool)
    rows[start : start + length] = False
    log.keep(rows)


def held(log: Recording, *, rows: int) -> None:
    """Every so many rows one value, written into those that follow."""
    log.q = log.q[np.arange(len(log.t)) // rows * rows]


def zeros_at_the_end(log: Recording) -> None:
    """The last rows are zeros."""
    log.q[-int(log.rng.integers(1, 6)) :] = 0.0


def stuck_rows(log: Recording) -> None:
    """Three rows with the value of the first."""
    k = int(log.rng.uniform(0.2, 0.8) * len(log.t))
    log.q[k : k + 3] = log.q[k]


def one_in_degrees(log: Recording) -> None:
    """One turning joint in degrees."""
    k = moving(log)
    log.q[:, k] = np.degrees(log.q[:, k])


def all_in_degrees(log: Recording) -> None:
    """All turning joints in degrees, under plain names."""
    log.q[:, log.judge.turns] = np.degrees(log.q[:, log.judge.turns])


def rezeroed(log: Recording) -> None:
    """One encoder counts from another zero."""
    k = moving(log)
    off = float(log.rng.choice([-1, 1]) * log.rng.uniform(0.5, 2.5))
    log.q[:, k] += off
    log.value |= {"joint": log.names[k], "by": round(off, 3)}


def milliseconds_over_seconds(log: Recording) -> None:
    """The header of the time says ms, its numbers are seconds."""
    log.t = log.t - log.t[0]
    log.time_name = "time_ms"


def limits_times(log: Recording, *, times: float) -> None:
    """A table of the robot's limits, its efforts in another unit."""
    log.limits = log.judge.limits._replace(effort=log.judge.limits.effort * times)


def torque_in_percent(log: Recording) -> None:
    """Measured torques in percent of their limits."""
    assert log.tau is not None
    log.tau = 100 * log.tau / log.judge.limits.effort


def spike(log: Recording) -> None:
    """One position of one joint is off by a radian or 0.2 m."""
    k, row = moving(log), int(log.rng.uniform(0.2, 0.8) * len(log.t))
    log.q[row, k] += 1.0 if log.judge.turns[k] else 0.2


def stamps_shaken(log: Recording) -> None:
    """Stamps that are off by up to 0.4 steps."""
    log.t = log.t + log.rng.uniform(-0.4, 0.4, len(log.t)) / log.rate


def sign(log: Recording) -> None:
    """One joint counts the other way."""
    log.q[:, moving(log)] *= -1


def exchanged(log: Recording) -> None:
    """Columns of two joints exchanged."""
    first = int(log.rng.integers(len(log.names) - 1))
    log.q[:, [first, first + 1]] = log.q[:, [first + 1, first]]


def wrapped(log: Recording) -> None:
    """Angles of encoders of one turn, whose zero lies within the motion."""
    mean = log.q.mean(axis=0)
    log.q = np.where(log.judge.turns, mean + np.mod(log.q - mean, 2 * np.pi), log.q)


def stuck_encoder(log: Recording) -> None:
    """One joint keeps its value for a while."""
    k, n = moving(log), len(log.t)
    start, length = int(log.rng.uniform(0.2, 0.5) * n), max(4, int(log.rng.uniform(0.05, 0.15) * n))
    log.q[start : start + length, k] = log.q[start, k]


def moving(log: Recording) -> int:
    """One of the three turning joints that move most; any joint where none turns."""
    size = np.ptp(log.q, axis=0) * np.where(log.judge.turns, 1.0, 1e-3)
    return int(log.rng.choice(np.argsort(-size)[:3]))


KINDS = (
    Fault("rows cut out, stamps closed up", cut_out),
    Fault("rows missing, honest stamps", gap),
    Fault("10 rows held", partial(held, rows=10), needs=Needs(rate=100.0)),
    Fault("2 rows held", partial(held, rows=2)),
    Fault("zeros at the end", zeros_at_the_end),
    Fault("3 rows stuck", stuck_rows),
    Fault("one joint in degrees", one_in_degrees, needs=Needs(turns=True)),
    Fault("all in degrees, plain names", all_in_degrees, needs=Needs(turns=True)),
    Fault("an encoder re-zeroed", rezeroed, trace="measured"),
    Fault("time_ms over seconds", milliseconds_over_seconds, needs=Needs(forms=("csv", "npz", "parquet"))),
    Fault("limits in N cm", partial(limits_times, times=100.0), needs=Needs(efforts=True)),
    Fault("measured torques in percent", torque_in_percent, needs=Needs(efforts=True, measured=True)),
    Fault("one spike", spike),
    Fault("stamps shaken", stamps_shaken),
    Fault("sign of a joint", sign, trace="measured"),
    Fault("columns exchanged", exchanged, trace="measured"),
    Fault("angles wrapped", wrapped, needs=Needs(turns=True)),
    Fault("an encoder stuck for a while", stuck_encoder),
)
