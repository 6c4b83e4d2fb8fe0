"""Motions on record: states between samples, torques, violated limits, tables, smoothing, derived rates, and load cases."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records

import twistwrench as tw
from twistwrench.core.text import words_of_the_shell
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.motion import differentiation, load_case, smoothing
from twistwrench.motion.bounds import (
    Extrema,
    LimitCheck,
    TimeAbove,
    Violation,
    above_limits,
    bounds_of,
    bounds_or_own,
    velocities_inside,
)
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import (
    LoadCase,
    Payload,
    joints_beside,
    joints_held,
    parse_payload,
    parse_wrenches,
    payloads_of,
)
from twistwrench.motion.motion_io import data_frame_file, labelled_dataset
from twistwrench.motion.motion_log import MotionLog
from twistwrench.motion.readers.columnar_file import ArrayFile

from .test_motion_columns import ARM, CRANE, CRANE_TEXT, GEARED, RAFT, compactly, loaded, outcome

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
record = compactly(records)

T = np.cumsum([0.0, 0.04, 0.06, 0.05, 0.03, 0.07, 0.05, 0.06, 0.04, 0.05, 0.06, 0.05, 0.04, 0.05])
Q = np.stack([0.3 * np.sin(2 * T), -0.5 + 0.4 * T**2, 1.5 * T, 0.2 - 0.3 * np.cos(3 * T)], 1)
DQ = np.stack([0.6 * np.cos(2 * T), 0.8 * T, 1.5 + 0 * T, 0.9 * np.sin(3 * T)], 1)
DDQ = np.stack([-1.2 * np.sin(2 * T), 0.8 + 0 * T, 0 * T, 2.7 * np.cos(3 * T)], 1)
TAU = np.stack([np.cos(9 * T), np.sin(5 * T), 2 * np.cos(4 * T), T], 1)
COMMAND = np.c_[Q[:, 0] + 0.01, np.full((14, 2), np.nan), Q[:, 3] - 0.02]
AXIS = np.array([0.6, 0.0, 0.8])
RAFT_Q = np.c_[
    0.2 * T,
    0.1 * T**2,
    0.5 * T,
    0.3 * np.sin(3 * T),
    np.cos(T),
    np.sin(T)[:, None] * AXIS,
    0.3 * T,
    -0.2 * T**2,
    0.1 * np.cos(T),
]

PENDULUM = tw.robots.pendulum()


def crane_motion(**more):
    arrays = {"dq": DQ, "ddq": DDQ, "tau": TAU, "command": COMMAND} | more
    return tw.Motion(
        T, Q, robot=more.pop("robot", CRANE), **{k: v for k, v in arrays.items() if v is not None and k != "robot"}
    )


@record
def motions_made_of_arrays():
    def made(*arrays, **named):
        def make():
            m = tw.Motion(*arrays, **({"robot": CRANE} | named))
            return [m.derived, m.dq[len(m) // 2], m.ddq[-1], m.duration, len(m), repr(m), m.log]

        return outcome(make)

    zero = RAFT_Q.copy()
    zero[4, 4:8] = 0.0
    return {
        "all": made(T, Q, DQ, DDQ, TAU), "velocities": made(T, Q, DQ), "positions": made(T, Q), "accelerations": made(T, Q, ddq=DDQ), "raft": made(T, RAFT_Q, robot=RAFT),
        "wrapped": made(T, np.c_[Q[:, :2], np.mod(3 * Q[:, 2] + 2, math.tau) - math.pi, Q[:, 3]]), "five": [made(T[:n], Q[:n]) for n in (5, 6)], "one": made(T[:1], Q[:1], DQ[:1], DDQ[:1]),
        "errors": [made("a.csv", Q), made(T, Q, robot=None), made(T, Q[:, :3]), made(T, Q[:5]), made(T[:, None], Q), made(T[::-1], Q), made(np.r_[T[:5], T[4:13]], Q), made(T, Q, DQ[:, :3]), made(T, Q, DQ[:5]), made(T, Q, tau=TAU * np.nan), made(T, Q, command=np.where(Q > 0, Q, np.nan)),
                   made(T, np.where(Q > 0.4, np.inf, Q)), made(T, zero, robot=RAFT), made(np.array([]), Q[:0]), made(T, Q, robot="crane")],
    }  # fmt: skip


@record
def parts_and_states_of_motions():
    m = crane_motion()
    times = np.array([-0.1, 0.0, 0.02, 0.1, 0.131, 0.65, 0.66])
    other = CRANE.with_gravity([0, 0, -1.6])
    states = {
        "between": m.at(times),
        "one": m(0.131),
        "batch": [x.shape for x in m.at(times[:6].reshape(2, 3))],
        "positions": tw.Motion(T, Q, robot=CRANE).at(times)[2],
    }
    raft = tw.Motion(T, RAFT_Q, robot=RAFT)
    states["raft"] = raft.at(np.array([0.01, 0.13, 0.5]))
    states["contradicting"] = tw.Motion(T, Q, 3 * DQ, DDQ, robot=CRANE, in_seconds=True).at(np.array([0.02, 0.131]))
    rotated = RAFT_Q.copy()
    rotated[1::2, 4:8] *= -1
    states["signs"] = [smoothing.continuous(RAFT.model, rotated)[:, 4], tw.Motion(T, rotated, robot=RAFT).dq[:, 4]]
    states["constant twists"] = smoothing.between(RAFT, T, raft.q, np.array([-1.0, 0.02, 0.3, 9.0]))
    wrapped = np.c_[Q[:, :2], np.mod(Q[:, 2] + 2.9, math.tau) - math.pi, Q[:, 3]]
    states["over a turn"] = tw.Motion(T, wrapped, DQ, DDQ, robot=CRANE).at(np.linspace(0.1, 0.3, 5))[0][:, 2]
    parts = [m[2:7], m[::5], m[-3:], m.between(0.04, 0.23), m.between(0.041, 0.2299)]
    return states | {
        "parts": [[p.time, p.tau[:, 1], p.command[:, 3], p.ddq[0]] for p in parts],
        "errors": [outcome(lambda: m[3]), outcome(lambda: m[20:]), outcome(lambda: m["a":]), outcome(m.between, 0.05, 0.09), outcome(m.between, 2, 1), outcome(m.at, np.nan), outcome(m.with_robot, ARM), outcome(m.with_robot, 3), outcome(m.violations, tau=TAU[:3]), outcome(m.violations, {"velocity": 3})],
        "torques": [m.torques(), m.torques(friction=True), m.with_robot(other).torques()[[0, -1]], {k: v[5] for k, v in m.terms(friction=True).items()}, list(m.terms())],
        "friction at ends": [np.round(tw.Motion(T, Q, np.where((T[0] == T)[:, None], 0, DQ), DDQ, robot=CRANE, in_seconds=True).torques(friction=True)[0], 6)],
        "terms at rest": {k: v[0] for k, v in tw.Motion(T, Q, 0 * DQ, DDQ, robot=CRANE, in_seconds=True).terms(friction=True).items()},
    }  # fmt: skip


@record
def motions_as_tables(folder):
    m = crane_motion()
    raft = tw.Motion(T, RAFT_Q, robot=RAFT)
    with contextlib.chdir(folder):
        texts = {str(d): m.to_csv(f"{d}.csv", degrees=d).read_text().splitlines()[:3] for d in (False, True)}
        again = tw.Motion.from_file("True.csv", CRANE)
    frame = m.to_pandas()
    data = m.to_xarray()
    lazy = labelled_dataset(RAFT.model, T, {"q": raft.q[None, None], "tau": raft.dq[None, None, :-1]})
    return {
        "csv": texts, "again": [np.abs(again.q - Q).max() < 1e-12, np.abs(again.ddq - DDQ).max() < 1e-12, np.abs(again.tau - TAU).max() < 1e-12, again.notes],
        "raft": {k: v[5] for k, v in raft.columns(degrees=True).items()}, "columns": list(m.columns(degrees=True)),
        "pandas": [list(frame.columns), frame.index.name, frame.shape, frame.iloc[3].to_numpy()],
        "xarray": [dict(data.sizes), {n: (v.dims, v.attrs["units"], v.to_numpy()[4]) for n, v in data.variables.items() if n not in ("coordinate", "joint", "time")}, data.attrs, data.time.attrs, list(data.joint.to_numpy())],
        "one axis": [labelled_dataset(PENDULUM.model, T, {"q": Q[None, :, :1], "dq": DQ[None, :, :1]}).q.dims, labelled_dataset(PENDULUM.model, T, {"q": Q[None, :, :1]}).q.attrs],
        "padded": [dict(lazy.sizes), lazy.tau.to_numpy()[0, 0, -2:, :2], lazy.tau.attrs, lazy.q.attrs, lazy.tau.dims],
    }  # fmt: skip


@record
def motions_of_data_frames():
    import pandas as pd

    names = CRANE.joint_names
    days = pd.to_datetime(1_600_000_000 + T, unit="s")

    def read(frame, **options):
        return outcome(
            lambda: (
                (m := tw.Motion.from_dataframe(frame, CRANE, **options))
                and [m.time[:3], m.q[2], m.notes, m.derived, None if m.tau is None else m.tau[2], m.log is not None]
            )
        )

    frame = pd.DataFrame(Q, columns=names)
    return {
        "index": read(frame.set_index(T)), "named index": read(frame.set_index(pd.Index(T, name="time"))), "odd index": read(frame.set_index(pd.Index(T, name="odd"))), "row numbers": read(frame), "rate": read(frame, rate=20.0), "dates": read(frame.set_index(days)), "durations": read(frame.set_index(days - days[0])),
        "column": read(frame.assign(time=T)), "column and index": read(frame.assign(time=T).set_index(pd.Index(2 * T, name="t"))), "dates in a column": read(frame.assign(stamp=days)), "words": read(frame.assign(time=T, state="RUN", more="x")), "options": read(pd.DataFrame({"time": T, "a": Q[:, 0], "boom_joint": Q[:, 1], "spin": Q[:, 2], "a_tilt": Q[:, 3], "current": T}), columns={"zslide": "a", "spin.current": "current", "zslide.tau": "a", "boom_joint.tau": "a", "a_tilt.tau": "a"}, degrees=True, gain={"spin": 3.0}),
        "words in the index": read(frame.set_index(pd.Index([f"r{k}" for k in range(14)]))),
        "not finite": read(frame.assign(time=T, spin=np.where(T > 0.3, np.nan, T))), "no frame": read(Q), "class": read(pd.DataFrame), "integers": data_frame_file(frame.set_index(np.arange(14) * 3))[0].header, "time twice": data_frame_file(frame.assign(time=T).set_index(pd.Index(T, name="time")))[0].header,
    }  # fmt: skip


def limits(**values):
    return replace(CRANE.limits, **{name: np.array(value, float) for name, value in values.items()})


@record
def violated_limits():
    m = crane_motion()
    inf = np.inf
    closed = limits(effort=[1.0, 1.0, 1.0, 1.0])
    kinds = {
        "own": None, "position": limits(lower=[-0.1, -0.45, -inf, -0.05], upper=[0.25, 1, inf, 0.25]), "velocity": limits(velocity=[0.5, 0.4, 1.25, 0.75]), "effort": closed,
        "acceleration": limits(acceleration=[1.1, 0.7, inf, 2.2], deceleration=[0.9, 5.0, inf, 1.8]), "deceleration": limits(acceleration=[2.0, 0.7, inf, 5.0], deceleration=[0.3, 5.0, inf, 0.4]),
        "both sides": limits(velocity=[DQ[0, 0] / (1 + 0.9e-6), 10, 1.5 / (1 + 1.1e-6), 10]), "stops": limits(lower=[-1, -0.5 + 0.9e-6 * 0.5, -inf, -0.1 + 1.2e-6], upper=[1, 0.5, inf, 1]),
    }  # fmt: skip
    found = {name: [v if name == "effort" else str(v) for v in m.violations(bounds)] for name, bounds in kinds.items()}
    found["friction"] = [str(v) for v in m.violations(closed, friction=True)] + [
        len(replace(m, friction=True).violations(closed)),
        len(m.violations(closed, friction=False)),
    ]
    found["given torques"] = [str(v) for v in m.violations(closed, tau=TAU)]
    weak = loaded(CRANE_TEXT.replace('effort="2.5"', 'effort="0.05"'))
    found["follower"] = [str(v) for v in tw.Motion(T, Q, DQ, DDQ, robot=weak).violations()]
    found["geared"] = [
        str(v)
        for v in tw.Motion(T, Q, DQ, DDQ, robot=GEARED).violations(
            replace(GEARED.limits, effort=np.array([1.0, 2, 3, 4]))
        )
    ]
    turns = [tw.Motion(T, Q, DQ, DDQ, robot=SCREW).violations(replace(SCREW.limits, effort=np.full(4, 0.01)))]
    found["screw"] = [str(v) for v in turns[0]]
    check = LimitCheck(CRANE.model, limits(jerk=[3.0, 2.0, 1.0, 5.0]))
    check.add_jerk(T, DDQ * (T > 0.1)[:, None])
    found["jerk"] = check.violations()
    rest = LimitCheck(CRANE.model, limits(jerk=[3.0, 2.0, 1.0, 5.0]))
    rest.add_jerk(T, np.c_[np.sin(20 * T) ** 2, 0.5 * T, -0.4 + 0 * T, 2 * T * (T[-1] - T)])
    rest.add(T, Q, None)
    found["jerk of ends"] = rest.violations()
    found["in degrees"] = [
        Violation("a", k, 3.2, -3.0, 0.5, u).in_degrees()
        for k, u in (("velocity", "rad/s"), ("torque", "N m"), ("position", "m"))
    ] + [Violation("a", "torque", -3.2, -3.0, 0.5, "N m").by, Violation("a", "position", 0.2, 0.5, 0.5, "rad").by]
    return found


@record
def extrema_and_runs_above_limits():
    rows = np.array([[1.0, -np.inf, 3.0], [4.0, -np.inf, 3.0], [2.0, -np.inf, 1.0]])
    times = np.array([0.5, 0.7, 1.1])
    parts = [
        Extrema.from_rows(times[:2], rows[:2], -rows[:2]),
        Extrema.from_rows(times[2:], rows[2:], -rows[2:]),
        Extrema.from_rows(times[:0], rows[:0], rows[:0]),
    ]
    t = np.array([0.0, 0.004, 0.008, 0.012, 0.02, 0.03, 0.031, 0.032])
    above = np.array(
        [
            [1, 0, 0, 1, 0],
            [1, 0, 1, 0, 0],
            [1, 0, 1, 1, 0],
            [0, 0, 1, 1, 0],
            [1, 0, 1, 1, 0],
            [1, 0, 0, 0, 0],
            [1, 1, 1, 1, 0],
            [0, 1, 1, 1, 0],
        ],
        bool,
    )
    runs = TimeAbove.from_rows(t, above)
    rest = [np.array([0.0, 0.3]), np.array([[0.0, 2.0], [0.0, -1.0]]), np.array([[4.0, 4.0], [-3.0, 5.0]])]
    return {
        "parts": parts, "merged": Extrema.merge(parts), "rows": Extrema.from_rows(times, rows, -rows), "runs": runs, "lasting": [runs.is_lasting(h) for h in (0.001, 0.0019, 0.002, 0.0021, 0.004)], "none": TimeAbove.from_rows(t, above[:, :0]),
        "above": above_limits(np.array([[2.9, -3.2], [3.1, 3.0], [-3.1, np.nan]]), np.array([2.0, 3.0]), np.array([0.35, 0.05])),
        "inside": [velocities_inside(*rest, 0.0, 0.3), velocities_inside(*rest, 0.3, 0.3), velocities_inside(*rest, -1.0, 0.3)],
        "bounds": [outcome(bounds_of, CRANE, **k) for k in ({"velocity": 2.0, "acceleration": [1, 2, 3, 4]}, {"deceleration": 3.0, "jerk": [1, np.inf, 3, 4], "effort": 7}, {"acceleration": 2, "deceleration": [3, 4, 5, 6]}, {"velocity": [1, 2]}, {"jerk": [1, 0, 2, 3]}, {"effort": -1}, {"velocity": [1, 2, np.nan, 4]})],
        "own": [outcome(bounds_or_own, CRANE, 3), bounds_or_own(CRANE, None) is CRANE.limits],
    }  # fmt: skip


SCREW = CRANE.with_actuators({
    "couplings": {"lift": {"motors": ["m_up", "m_round"], "joints": ["zslide", "spin"], "motor_per_joint": [[40, 1], [0, 3]]}},
    "actuators": {"m_up": {"ratio": 8, "rotor": {"inertia": "20 g cm^2"}}, "m_round": {"ratio": 6, "rotor": {"inertia": "12 g cm^2"}}},
})  # fmt: skip
"""The crane with a motor that moves a sliding and a turning joint."""

N = 90
LT = np.arange(N) * 0.01
NOISE = 1e-3 * np.random.default_rng(7).uniform(-1, 1, (N, 4))
LQ = np.stack([0.3 * np.sin(2 * LT), -0.5 + 0.4 * LT**2, 1.5 * LT, 0.2 - 0.3 * np.cos(3 * LT)], 1)


@record
def smoothing_of_samples():
    uneven = LT + 0.003 * np.sin(np.arange(N) ** 2)
    noisy = LQ[:, 0] + NOISE[:, 0]
    glitch = noisy.copy()
    glitch[[30, 60]] += [0.05, -0.03]
    grid = np.round(LQ[:, 0] / 0.01) * 0.01
    return {
        "smooth": [smoothing.smooth(t, x, s, 0.01) for t, x, s in ((LT, noisy, 10.0), (uneven, noisy, 300.0), (LT, LQ[:3, 0], 5.0), (LT, noisy, 0.0))] + [smoothing.smooth(LT[:9], NOISE[:9, :2], 20.0, 0.02)],
        "strengths": [smoothing.best_strength(t, x, n, 0.01, g) for t, x, n, g in (([LT], [noisy], 7e-4, 0.0), ([LT], [noisy], 3e-4, 0.0), ([LT], [glitch], 7e-4, 0.0), ([LT[:40], LT[40:]], [noisy[:40], noisy[40:]], 7e-4, 0.0), ([LT], [grid], 0.003, 0.01), ([LT], [noisy], 0.0, 0.0), ([LT], [np.sin(400 * LT)], 1e-3, 0.0))],
        "alike": [smoothing.alike_samples([x], g, n) for x, g, n in ((grid, 0.01, 0.003), (grid, 0.01, 0.006), (grid[:5], 0.01, 0.001), (grid, 0.0, 1.0), (np.repeat(np.arange(5.0), 20), 1.0, 0.1))],
        "gains": [smoothing._noise_gain(s) for s in (0.0, 0.1, 1e3)], "margins": [smoothing.margin_of(s) for s in (0.0, 1e-3, 0.1, 10.0, 1e6)],
        "edges": [smoothing.stretch_edges(np.r_[LT[:a], LT[:b] + g]) for a, b, g in ((10, 10, 0.14), (10, 10, 0.13), (10, 10, 0.16), (5, 10, 1.0), (6, 6, 1.0), (10, 5, 1.0))] + [smoothing.stretch_edges(np.r_[LT[:10], 0.3, 0.5 + LT[:10]]), smoothing.stretch_edges(LT[:5]), smoothing.stretch_edges(0.5 * np.arange(12.0))],
        "rates": [np.round(np.stack(smoothing.spline_rates(np.r_[LT[:9], LT[:9] + 1], LQ[:18, :2]))[:, [0, 8, 9, 17]], 7), outcome(smoothing.spline_rates, np.r_[LT[:5], LT[4:8]], LQ[:9]), outcome(smoothing.spline_rates, 1e18 + LT[:9], LQ[:9])],
        "series": [smoothing._FORWARD[:6], smoothing._INVERSE[:6], [smoothing._term_count(np.array(x)) for x in (0.0, 0.1, 0.5, 3.0)]],
    }  # fmt: skip


def log_of(columns, robot=CRANE, parts=("q",)):
    from twistwrench.motion.coordinates import Coordinates

    c = Coordinates.from_model(robot.model)
    header = ["time", *[h for p in parts for h in c.headers(p)]]
    table = np.column_stack(columns)
    return MotionLog.open(ArrayFile.from_table(Path("log.csv"), header, table, table.nbytes), robot.model)


def differentiated(log, robot=CRANE, **options):
    plan = Differentiation.plan(log, robot.model, **options)
    states = list(plan.states(20))
    first = states[0]
    every = {name: np.concatenate([getattr(s, name) for s in states]) for name in ("q", "dq", "ddq", "measured")}
    outliers = np.concatenate([s.outlier for s in states])
    near = plan.states_near(40, 3)
    return {
        "plan": [plan.source, plan.derives_velocities, plan.places, plan.strengths, plan.sigma_ddq, plan.sigma_dq, plan.spread, plan.ends, plan.smooths, plan.derives, plan.margin], "states": every,
        "stationary": np.argwhere(np.concatenate([s.stationary for s in states]))[:12].tolist(), "outliers": outliers[np.abs(outliers).max(axis=(1, 2), initial=0) > 0] if outliers.ndim == 3 else outliers.shape,
        "sigma": plan.sigma_at(first)[3] if plan.derives and plan.source != "given" else "", "end gain": plan.end_gain(np.array([0.0, 0.013, 0.5, 0.89])) if plan.source != "given" else "", "near": near.dq, "count": [len(s) for s in states],
    }  # fmt: skip


def glitching():
    """Positions with a spike."""
    positions = LQ + NOISE
    positions[45, 1] += 0.05
    return positions


def noisy_velocities():
    exact = np.stack([0.6 * np.cos(2 * LT), 0.8 * LT, 1.5 + 0.1 * np.sin(4 * LT), 0.9 * np.sin(3 * LT)], 1)
    return exact + 3 * NOISE


@record(relative=2e-2)
def deviations_of_smoothed_rates():
    """Standard deviations of columns with hardly any noise follow from small differences."""
    logs = {
        "positions": log_of([LT, glitching()]),
        "velocities": log_of([LT, LQ, noisy_velocities()], parts=("q", "dq")),
    }
    plans = {name: Differentiation.plan(log, CRANE.model, smoothing=True) for name, log in logs.items()}
    return {
        name: [plan.sigma_ddq, plan.sigma_dq, plan.sigma_at(next(iter(plan.states(20))))[3]]
        for name, plan in plans.items()
    }


@record(relative=1e-5)
def derived_rates_of_logs():
    noisy = LQ + NOISE
    rest = noisy.copy()
    rest[:, 3] = np.where(LT < 0.3, 0.25, 0.25 + np.maximum(0, LT - 0.3) ** 2)
    paused = np.r_[LT[:50], LT[50:] + 0.4]
    velocities = noisy_velocities()
    calls = []
    found = {
        "positions": differentiated(log_of([LT, noisy]), progress=calls.append),
        "smoothed": differentiated(log_of([LT, glitching()]), smoothing=True, progress=calls.append),
        "at rest, paused": differentiated(log_of([paused, rest])),
        "velocities": differentiated(log_of([LT, LQ, velocities], parts=("q", "dq"))),
        "velocities, smoothed": differentiated(log_of([LT, LQ, velocities], parts=("q", "dq")), smoothing=True),
        "given": differentiated(log_of([LT, LQ, velocities * ((LT > 0) & (LT < 0.885))[:, None], 2 - velocities], parts=("q", "dq", "ddq"))),
        "accelerations": differentiated(log_of([LT, LQ, 2 - velocities], parts=("q", "ddq"))),
        "few": [outcome(Differentiation.plan, log_of([LT[:n], LQ[:n]]), CRANE.model) for n in (1, 5)] + [outcome(Differentiation.plan, log_of([LT[:5], LQ[:5], LQ[:5]], parts=("q", p)), CRANE.model) for p in ("dq", "ddq")],
    }  # fmt: skip
    for name in ("smoothed", "velocities, smoothed"):
        del found[name]["plan"][4:6], found[name]["sigma"]  # deviations_of_smoothed_rates
    plan = Differentiation.plan(log_of([LT, noisy]), CRANE.model)
    found["with smoothing"] = [plan.with_smoothing().strengths, calls]
    raft = (
        np.c_[
            0.2 * LT,
            0.1 * LT**2,
            0.5 * LT,
            0.3 * np.sin(3 * LT),
            np.cos(LT),
            np.sin(LT)[:, None] * AXIS,
            0.3 * LT,
            -0.2 * LT**2,
            0.1 * np.cos(LT),
        ]
        + np.c_[NOISE, NOISE[:, ::-1], NOISE[:, :3]]
    )
    found["raft"] = differentiated(log_of([LT, raft], RAFT), RAFT)
    return found


@record
def gains_of_noise():
    residual = np.zeros((40, 3))
    residual[[5, 6, 20, 30], [0, 0, 0, 1]] = [0.7, 0.3, -0.65, 0.5]
    residual[21, 0] = -0.4
    deviation = np.tile([0.1, 0.1, 0.0], (40, 1))
    rows = np.array([[0, 0.5, 7.0, 0.7, 0.0], [1, 0.9, -9.0, -0.5, 0.0], [0, 0.6, -8.0, -0.8, 1.0]])
    return {
        "gains": [differentiation.noise_gain(o, s, 0.02) for o in (1, 2) for s in (0.0, 10.0)], "ends": [differentiation.end_gains(o, s, np.array([0.0, 1.0, 2.5, 80.0])) for o in (1, 2) for s in (0.0, 30.0)],
        "ends of strong": [differentiation.end_gains(2, s, np.array([0.0, 10.0, 44.0])) for s in (1e4, 1e7)], "peaks": [differentiation.pulse_peak(o, h) for o in (1, 2) for h in (0.01, 0.25)],
        "residuals": [differentiation.outlier_residuals(residual, deviation, np.array(s))[:, :, 0].nonzero() for s in ([1.0, 1.0, 1.0], [100.0, 0.0, 1.0])], "outliers": differentiation.outliers_of(rows), "spread": differentiation.residual_spread([LT], [LQ[:, :2] + NOISE[:, :2]], np.array([10.0, 0.0]), 0.01, np.array([1e-5, 1e-5])),
        "least spread": differentiation.residual_spread([LT], [LQ[:, :2] + NOISE[:, :2]], np.array([10.0, 30.0]), 0.01, np.array([1.0, 1e-5])),
    }  # fmt: skip


LOADS = (
    Payload(1.5, (0.02, -0.03, 0.11)),
    Payload(0.8, (0.1, 0.0, 0.05), "jib"),
    Payload.from_inertia(SpatialInertia.from_com(0.6, [0.01, 0.04, -0.02], np.diag([0.004, 0.005, 0.006])), "finger"),
    Payload(0.4, (0.0, 0.05, 0.0)),
)
WRENCHES = {"tool0": [0.3, -0.2, 0.5, 4.0, -7.0, 11.0], "turret": [1.0, 2.0, -0.5, -3.0, 6.0, 2.0]}


def states_of(robot=CRANE):
    stationary = np.zeros((14, robot.nv), bool)
    stationary[4:7, 1] = True
    return differentiation.MotionSamples(T, Q, DQ, DDQ, Q, stationary, np.zeros((14, 0)))


@record
def load_cases():
    s = states_of()
    found = {}
    for name, case in {
        "bare": LoadCase(CRANE), "loaded": LoadCase(CRANE, LOADS), "all": LoadCase(CRANE, LOADS, WRENCHES), "without friction": LoadCase(CRANE, LOADS[:1], WRENCHES, friction=False), "geared": LoadCase(GEARED, LOADS[:2], WRENCHES),
    }.items():  # fmt: skip
        terms = case.terms(s)
        found[name] = {
            "torques": case.torques(s), "bare torques": case.unloaded_torques(s)[5], "terms": {k: v[5] for k, v in terms.items() if v.any()}, "off": float(np.abs(sum(terms.values()) - case.torques(s)).max()) < 1e-8,
            "drives": case.drive_torques(case.torques(s))[5], "units": case.units, "follower": case.follower_torques(s)[5], "payload": [case.payload_torques(s)[5], case.follower_payload_torques(s)[5]], "mass matrix": case.mass_matrix(Q[5]), "at rest": case.torques(s)[5:7, 1], "carries": case.carries, "words": case.fixed_words, "causes": len(case.causes),
        }  # fmt: skip
    case = LoadCase(GEARED, LOADS[:2], WRENCHES)
    why = case.explain(s[5])
    loads = case.motor_loads(s)
    found["explained"] = [
        why.joints,
        why.units,
        np.round(why.torque, 7),
        np.round(why.parts.sum(axis=0), 7),
        why.links if hasattr(why, "links") else "",
    ]
    found["motors"] = {k: v for k, v in loads._asdict().items() if isinstance(v, np.ndarray)}
    found["bearings"] = {k: v[5] for k, v in LoadCase(CRANE, LOADS, WRENCHES).bearing_loads(s).items()}
    springs = CRANE.with_actuators(
        {"actuators": {"a_tilt": {"ratio": 50, "rotor": {"inertia": "12 g cm^2"}, "stiffness": "900 N m/rad"}}}
    )
    found["elastic"] = [
        load_case.loaded_entries(springs.model, [0.0, 1, 0, 2e-6, 5]),
        load_case.driven_entries(springs.model),
    ]
    return found


@record
def doubts_about_load_cases():
    def case(*loads, robot=CRANE, **named):
        return outcome(
            lambda: (
                (c := LoadCase(robot, loads, **named)) and [[d.kind for d in c.doubts], c.unit_hints, c.contradictions]
            )
        )

    return {
        "loads": [case(Payload(2.0, (0, 0, 9.0))), case(Payload(132.0)), case(Payload(3000.0, frame="jib")), case(Payload(14000.0)), case(Payload(2.0, frame="nobody")), case(Payload(2.0), robot=ARM), case(Payload(2.0, frame="l7"), robot=ARM)],
        "wrenches": [case(wrenches={"tool0": [1, 2, 3]}), case(wrenches={"nobody": [1] * 6}), case(wrenches={"tool0": [1, 2, 3, np.nan, 5, 6]})],
        "grams": [load_case._hint_at_grams(*c) for c in ((9.9, 0.5), (10.0, 0.5), (99.0, 10.0), (101.0, 10.0), (10000.0, 10.0), (10001.0, 10.0), (500.0, 0.0))],
        "reach": [load_case.reach(r.model) for r in (CRANE, RAFT, ARM, tw.robots.planar_2r())], "endless": [load_case.reach(ENDLESS.model), load_case.least_torque_per_kilogram(ENDLESS.model)], "least": [load_case.least_torque_per_kilogram(r.model) for r in (CRANE, RAFT, CRANE.with_gravity([0, 0, 0]))],
        "parsed": [outcome(parse_payload, t, tip) for t, tip in (("5", None), ("2.5,0,-0.1,0.08@tool0", None), ("2 kg", "x"), ("2.kg,1,2,3@ jib ", "x"), ("2,1", None), ("-1", None), ("2@", None), ("2@ ", None), ("x", None), ("kg", None), ("inf", None))],
        "given": [outcome(payloads_of, g, t) for g, t in ((5, None), (0, "a"), (-1, None), (math.inf, None), ([5, "2@jib", {"tool0": [1.5, "3,0,0,1"]}], "a"), (Payload(1.0), "a"), (SpatialInertia.from_com(0.6, [0.01, 0.04, -0.02]), "a"), ({}, None), (None, None))],
        "texts of wrenches": [outcome(parse_wrenches, t) for t in (["tool0:1,2,3,4,5,6", " tool0 :0.5,0,0,0,0,-20", "a:b:1,1,1,1,1,1"], [":1,2,3,4,5,6"], ["1,2,3,4,5,6"], ["tool0:1,2"])],
        "remedies": [load_case.limits_remedy(p) for p in ("arm.urdf", "", str(tw.robots.path_of("ur5")), "/x/site-packages/a.urdf")], "confirmed": [load_case.confirmed_efforts(r.model, of="them") for r in (CRANE, ARM)], "labels": [load_case.cause_label(t) for t in load_case.TERMS],
        "shell": in_the_shell(lambda: [load_case.limits_remedy(p) for p in ("arm.urdf", "my arm's.urdf", "", str(tw.robots.path_of("ur5")))] + [load_case.no_tip_for_payload(ARM.model, 2.0)]),
    }  # fmt: skip


def in_the_shell(call):
    with words_of_the_shell():
        return call()


@record
def missing_limits_in_words():
    peaks = np.array([500.0, 90.0, 1e-5, 10.0])
    some = limits(effort=[np.inf, 140.0, 45.0, np.inf], velocity=[0.8, 60.1, np.inf, 59.9])
    none = limits(effort=[np.inf] * 4, velocity=[100.1, 2, 3, 4])
    large = limits(effort=[2000, 1500, 1200, 1100])
    from twistwrench.motion.limits_file import limits_of

    stated = limits_of({"boom_joint": 1500.0, "spin": 1200.0, "a_tilt": 1100.0}, CRANE.model)
    return {
        "doubts": [[str(r).replace("the text given", "arm.urdf") for r in load_case.limit_doubts(CRANE, b, p)] for b, p in ((CRANE.limits, peaks), (some, peaks), (none, peaks), (some, [0, 0, 0, 9.0]), (large, peaks), (stated, peaks), (large, [0, 0, 0, 0]))],
        "geared": [str(r) for r in load_case.limit_doubts(GEARED, replace(GEARED.limits, effort=np.array([900.0, 140, np.inf, 10])), peaks + 5)], "loaded": [load_case.loaded_entries(r.model, np.array(p)) for r, p in ((CRANE, [1.0, 0.9e-6, 1.1e-6, -1]), (RAFT, np.arange(10.0)))],
        "without": [load_case.drives_without_limit(CRANE.model, some.effort, peaks), load_case.drives_without_limit(GEARED.model, some.effort, peaks), load_case.without_velocity_limit(CRANE.model, some), load_case.without_velocity_limit(CRANE.model, none), load_case.without_velocity_limit(RAFT.model, RAFT.limits)],
    }  # fmt: skip


LOSSY = CRANE.with_actuators({"actuators": {"a_tilt": {"ratio": 50, "friction": {"load": 0.05, "coulomb": "0.2 N m"}}}})
ENDLESS = loaded(
    CRANE_TEXT.replace('lower="-0.75" upper="1.5" ', "").replace(
        'type="prismatic"><parent link="ground"', 'type="prismatic"><parent link="ground"'
    )
)


@record
def payload_margins():
    s = states_of()
    found = {}
    effort = np.array([900.0, 140.0, 45.0, 18.0])
    for name, (robot, loads, friction, limit) in {
        "one": (CRANE, LOADS[:1], True, effort), "on the jib": (CRANE, LOADS[1:2], False, effort), "two": (CRANE, LOADS[:2], True, effort), "no load": (CRANE, (), True, effort), "weightless": (CRANE, (Payload(0.0),), True, effort), "over": (CRANE, LOADS[:1], True, effort / 40), "unlimited": (CRANE, LOADS[:1], True, np.where(effort > 100, effort, np.inf)), "lossy": (LOSSY, LOADS[:1], True, effort), "lossy without friction": (LOSSY, LOADS[:1], False, effort), "geared": (GEARED, LOADS[:1], True, np.array([900.0, 140, 20, 12])), "tight": (CRANE, LOADS[:1], False, np.array([900.0, 140, 8, 6])),
    }.items():  # fmt: skip
        case = LoadCase(robot, loads, friction=friction)
        if not load_case.margin_determined(case):
            found[name] = "not determined"
            continue
        torques = np.c_[case.drive_torques(case.torques(s)), case.follower_torques(s)]
        carried = np.c_[case.drive_torques(case.payload_torques(s)), case.follower_payload_torques(s)]
        shares = load_case.payload_shares(case, limit, T, torques, carried)
        both = load_case.PayloadShares.from_parts(
            [load_case.payload_shares(case, limit, T[k], torques[k], carried[k]) for k in (slice(0, 6), slice(6, 14))]
        )
        margin = load_case.payload_margin(case, limit, shares)
        found[name] = [
            shares,
            np.array_equal(both.greatest.value, shares.greatest.value),
            both.within,
            margin,
            margin and [margin.words, margin.words_alone],
        ]
    return found


@record
def joints_held_and_beside():
    def held(lock, degrees=False, robot=CRANE):
        return outcome(joints_held, robot.model, lock, degrees=degrees)

    return {
        "held": [held({"spin": 0.5, "a_*": 0.25}), held({"*": 0.1, "spin": 2}), held({"*": 0.1}, degrees=True), held({"s*": 0.1, "*n": 0.1}), held({"s*": 0.1, "*n": 0.2}), held({"x?": 1}), held({"claw": 0.3}), held({"nobody": 1.0})],
        "limits": [held({"a_tilt": x}) for x in (2.875, 2.8750028, 2.87501, 90, -1.75, -1.8)] + [held({"a_tilt": 170}, degrees=True), held({"a_*": 90}), held({"zslide": 9.5}), held({"zslide": 9}, degrees=True), held({"z[st]lide": 0.5})],
        "shell": in_the_shell(lambda: held({"a_tilt": 90})), "beside": [outcome(joints_beside, CRANE.model, *c) for c in (("ground", "tool0"), ("jib", "hand"), ("turret", "ground"), ("tool0", "finger"), ("ground", "nobody"), ("hand", "tool0"))] + [outcome(joints_beside, ARM.model, "l7", "l8"), outcome(joints_beside, RAFT.model, "sea", "mast")],
    }  # fmt: skip


SPRUNG = CRANE.with_actuators(
    {"actuators": {"a_tilt": {"ratio": 50, "rotor": {"inertia": "12 g cm^2"}, "stiffness": "900 N m/rad"}}}
)
"""The crane with an elastic joint, whose motor is the last entry of q."""


@record
def load_cases_of_an_elastic_joint():
    q, dq, ddq = np.c_[Q, Q[:, 3] * 0.9], np.c_[DQ, DQ[:, 3] * 0.8], np.c_[DDQ, DDQ[:, 2] + 0.5]
    s = differentiation.MotionSamples(T, q, dq, ddq, q, np.zeros(q.shape, bool), np.zeros((14, 0)))
    case = LoadCase(SPRUNG, LOADS[:1], {"hand": [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]})
    return {"names": SPRUNG.model.velocity_names, "terms": {k: v[5] for k, v in case.terms(s).items()}, "torques": case.torques(s)[5], "explained": np.round(case.explain(s[5]).torque, 7), "loaded": [load_case.loaded_entries(SPRUNG.model, [0.0, 1, 0, 2e-6, 5]), load_case.loaded_entries(SPRUNG.model, [0.0, 1, 0, 1, 0])], "driven": load_case.driven_entries(SPRUNG.model)}  # fmt: skip


@record
def calls_of_rooms_above():
    """Arguments with which a motion calls plots, pages and recordings, and a file or frame is read."""
    given = []
    m = crane_motion()
    other = CRANE.with_gravity([0, 0, -1.6])

    def noted(name):
        def call(*positional, **named):
            shown = [
                (type(x).__name__, getattr(x, "robot", None) is other)
                if not isinstance(x, str | int | float | dict | None)
                else x
                for x in positional
            ]
            given.append(
                [
                    name,
                    shown,
                    {
                        k: v if isinstance(v, str | int | float | bool | dict | None) else type(v).__name__
                        for k, v in named.items()
                    },
                ]
            )
            return name

        return call

    from twistwrench.reports import drawn_motion
    from twistwrench.reports.recordings import mcap, recording, rerun_file
    from twistwrench.viz import page
    from twistwrench.viz.plots import motion as plots

    with pytest.MonkeyPatch.context() as patch:
        for module, name in (
            (plots, "plot_motion"),
            (page, "show"),
            (mcap, "write_mcap"),
            (rerun_file, "write_rerun"),
            (drawn_motion, "motion_of"),
        ):
            patch.setattr(module, name, noted(name))
        patch.setattr(recording.Recording, "from_motion", staticmethod(noted("from_motion")))
        results = [
            m.plot("a.svg"),
            m.plot("a.svg", CRANE.limits, friction=True),
            m.show(),
            m.show(other, embed=True, control="x"),
            m.to_mcap("a.mcap"),
            m.to_rerun("a.rrd"),
            m.to_rerun("a.rrd", other),
        ]

    class Opened(Exception):
        pass

    def opened(path, model, **options):
        given.append([str(path) if isinstance(path, str) else type(path).__name__, options])
        raise Opened

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MotionLog, "open", opened)
        for call in (
            lambda: tw.Motion.from_file("a.csv", CRANE),
            lambda: tw.Motion.from_file(
                "a.csv",
                CRANE,
                columns={"a": "b"},
                rate=2.0,
                degrees=True,
                gain={"a": 3.0},
                topic="t",
                command_topic="c",
                episode=4,
                plan=True,
            ),
            lambda: tw.Motion.from_dataframe(m.to_pandas(), CRANE),
            lambda: tw.Motion.from_dataframe(
                m.to_pandas(), CRANE, columns={"a": "b"}, rate=2.0, degrees=True, gain={"a": 3.0}
            ),
        ):
            with contextlib.suppress(Opened):
                call()
    return {
        "given": given,
        "results": results,
        "errors": [outcome(tw.Motion.from_file, "a.csv", 3), outcome(tw.Motion.from_dataframe, m.to_pandas(), 3)],
    }


@record
def rest_and_ringing_of_splines():
    t = np.r_[np.arange(10) * 0.01, 0.5 + np.arange(10) * 0.01]
    q = np.zeros((20, 4))
    q[:, 0], q[:, 1], q[:, 2], q[:, 3] = 1e3, 0.01 * np.arange(20), np.arange(20) // 3 * 0.02, 0.3
    dq = np.tile([3e-12, 0.5, 0.04, 0.2], (20, 1))
    dq[::4] *= [9, -1, 2, 0.1]
    exact = SimpleNamespace(quantum=np.array([0.0, 0.0, 0.02, 0.0]), noise=np.array([0.0, 1e-4, 0.0, 0.01]))
    sigma = np.array([0.0, 0.05, 0.009, 0.01])
    gridded = SimpleNamespace(quantum=np.zeros(4), noise=np.zeros(4))
    uneven = t + 0.002 * np.sin(np.arange(20.0))
    return {
        "rest": [np.argwhere(differentiation.stationary_intervals(x, CRANE.model, u, q, dq, sigma)) for x in (exact, gridded) for u in (t, uneven)],
        "ringing": [np.argwhere(differentiation.ringing(x, CRANE.model, t, q, dq, f)) for x in (exact, gridded) for f in (np.ones(4), np.array([1, 50.0, 1, 1]))], "two rows": differentiation.ringing(gridded, CRANE.model, t[:2], q[:2], dq[:2], np.ones(4)).sum(),
        "raft": [differentiation.stationary_intervals(SimpleNamespace(quantum=np.zeros(11)), RAFT.model, t, np.tile(np.arange(11.0), (20, 1)), np.full((20, 10), 0.3), np.zeros(10)).sum(axis=0), differentiation._to_joints(RAFT.model, np.arange(1.0, 12.0))],
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
