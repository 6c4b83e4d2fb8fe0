"""Figures behind reports, answers on many motions, logs without a robot, contents of robots and recordings: on record."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.verdict import Word
from twistwrench.mechanics.algorithms.motor_loads import MotorLoads
from twistwrench.mechanics.model.actuators import Actuator, Motor
from twistwrench.motion.bounds import Extrema, TimeAbove
from twistwrench.motion.load_case import LoadCase
from twistwrench.reports import log_quality, statistics, torque_analysis
from twistwrench.reports.checked_motions import CheckedMotion, CheckedMotions, expanded_paths
from twistwrench.reports.load_states import LoadStates
from twistwrench.reports.log_quality import LogColumn, LogQuality
from twistwrench.reports.log_report import LogReport
from twistwrench.reports.measured_torque import TorqueComparison, _AtExtreme
from twistwrench.reports.motors import MotorFigures, Steps
from twistwrench.reports.recordings.description import MovingJoints, robot_description
from twistwrench.reports.recordings.recording import Recording
from twistwrench.reports.recordings.rerun_file import _curves, _duplicate_rows
from twistwrench.reports.robot_summary import html_summary, limits_csv, summary
from twistwrench.reports.statistics import Bins, Gaps, Runs, excess_of_largest, gap_edges, mean_weights, stride_of

from .report_cases import (
    crane,
    fields_of,
    motion,
    quietly,
    said,
    shown,
    swing,
    uneven,
    words_of,
    write_log,
)
from .report_cases import heads as heads_of

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

T = uneven(37, 0.04)
X = np.sin(np.outer(T, [9.0, 17.0])) * [3.0, -1.4] + np.outer(T, [0.3, -1.1])


def parts(n, *cuts):
    return [slice(a, b) for a, b in pairwise((0, *cuts, n))]


# ── Statistics


@records.of
def weights_of_a_time_mean():
    still = np.full(5, 2.5)
    return {
        "whole": mean_weights(T, slice(0, 37)),
        "parts": [mean_weights(T, s) for s in parts(37, 1, 2, 17, 36)],
        "one time": [mean_weights(still, s) for s in (slice(0, 5), slice(0, 3), slice(3, 5))],
        "one row": mean_weights(T[:1], slice(0, 1)),
        "strides": [stride_of(n, m) for n, m in ((7, 7), (8, 7), (14, 7), (15, 7), (28, 7), (29, 7), (0, 7))],
    }


@records.of
def bins_and_runs_of_rows():
    def bins(cuts, count=37, most=5):
        return Bins.from_parts(
            [Bins.from_rows(s.start, T[s], X[s] - 0.1, X[s] + 0.2, count, most) for s in parts(37, *cuts)]
        )

    def runs(cuts, rows):
        found = Runs.from_parts([Runs.from_rows(s.start, np.abs(X[s]), rows) for s in parts(37, *cuts)])
        return [*found, found.run_count, found.contenders(0), found.contenders(1)]

    return {
        "bins": [list(bins(cuts)) for cuts in ((), (6, 17), (1, 2, 3, 36))],
        "wide": list(bins((), 37, 40)),
        "runs": [runs(cuts, rows) for cuts, rows in (((), 4), ((9, 10, 30), 4), ((), 1), ((18,), 7), ((), 40))],
        "single": [list(Runs.from_rows(3, X[:k], 4)) for k in (1, 2, 6)],
    }


@records.of
def largest_of_noisy_values():
    values = np.sort(np.abs(X[:, 0]))[::-1]
    near = 5.0 - 0.03 * np.arange(9.0) ** 1.5
    return {
        "spread": [excess_of_largest(values, s, 41) for s in (0.0, 0.05, 0.5, 3.0)],
        "near": [excess_of_largest(near, s, n) for s in (0.05, 0.2, 0.9) for n in (9, 31)],
        "one": excess_of_largest(np.array([3.0, -np.inf, -np.inf]), 0.2, 3),
        "equal": excess_of_largest(np.array([3.0, 3.0, 3.0]), 0.2, 3),
        "six deviations": [excess_of_largest(np.array([5.0, 5.0 - f * 6 * 0.1]), 0.1, 2) for f in (0.99, 1.01)],
    }


@records.of
def gaps_of_times():
    t = np.array([0.0, 0.1, 0.19, 0.32, 0.4, 0.95, 1.02, 1.1, 1.205, 1.3, 2.7, 2.81])
    edges = gap_edges(t, 0.12)
    q, dq = np.column_stack([np.sin(t), 0.3 * t**2]), np.column_stack([np.cos(t), 0.6 * t])
    rates = np.array([[1.0, 2.0], [1.5, 0.9]])
    stops = (np.array([-0.1, -0.2]), np.array([1.2, 2.5]))

    def figures(gaps):
        return [
            fields_of(gaps, "threshold", "count", "longest", "longest_at", "hiding", "hidden", "exceeds_logged_motion"),
            [list(gap) for gap in gaps.long],
        ]

    turned = q.copy()
    turned[6:, 1] += 3.0
    none = Gaps.from_edges(t[:5], (q[:0], dq[:0]), rates, 0.2)
    return {
        "edges": edges,
        "edges of short ones": gap_edges(t, 0.05),
        "steps": [statistics.long_steps(t, x) for x in (0.05, 0.1, 0.5, 2.0)],
        "rates": figures(Gaps.from_edges(t, (q[edges], dq[edges]), rates, 0.12, stops=stops)),
        "no rates": figures(Gaps.from_edges(t, (q[edges], dq[edges]), rates, 0.12, rates=False)),
        "far": figures(Gaps.from_edges(t, (turned[edges], dq[edges]), 9 * rates, 0.12)),
        "none": figures(none),
        "extent": statistics._cubic_extent(q[4], q[5], dq[4], -dq[5], 0.55),
        "least rates": statistics._least_rates_across(q[5] - q[4], dq[4], dq[5], 0.55),
    }


@records.of
def logs_with_a_gap():
    """A pause of a moving robot, with and without rates of its own."""
    t = uneven(70)
    kept = np.r_[0:30, 47:70]
    q, dq, ddq = swing(t)
    robot = crane()
    given = tw.Motion(t[kept], q[kept], dq[kept], ddq[kept], robot=robot, in_seconds=True)
    derived = tw.Motion(t[kept], q[kept], robot=robot, in_seconds=True)
    answers = {
        "given": tw.check(robot, given),
        "derived": tw.check(robot, derived),
        "tight": tw.check(robot, given, limits={"luff": 17.0}),
    }
    return {
        name: [words_of(answer), fields_of(answer.gaps, "count", "longest", "longest_at", "hiding", "exceeds_logged_motion")]
        for name, answer in answers.items()
    }  # fmt: skip


# ── Measured torques and motors


@records.of
def comparisons_of_torques():
    """Sums over parts of rows, of sound rows, and the rows of a column that is cut off."""
    n = 90
    t = uneven(n, 0.01)
    c = np.column_stack(
        [np.sin(11 * t) * 8, np.cos(7 * t) * 3 + 1, 0.2 * np.sin(5 * t), np.sin(9 * t + 1) * 20, 4 * np.sin(8 * t)]
    )
    m = c * [1.1, -0.9, 4.0, 0.7, 1.0] + [0.3, 0.1, 0.0, -2.0, 0.0]
    m[:, 3] = np.clip(m[:, 3], -9.0, 30.0)
    m[:, 4] = np.clip(m[:, 4], -3.9, 2.5)
    m[:, 2] = 0.33
    sigma = 0.1 + 0.01 * np.arange(n)[:, None] * [1, 2, 3, 4, 5]
    doubted = np.arange(n) % 7 == 3
    limits = np.array([8.1, 2.0, np.inf, 15.0, 3.1])
    above = TimeAbove.from_rows(t, np.abs(m) > limits)
    names, units = tuple("abcde"), ("N m", "N m", "N m", "N", "N")

    def of(cuts, doubted):
        found = [TorqueComparison.from_rows(t[s], c[s], m[s], sigma[s], doubted[s]) for s in parts(n, *cuts)]
        whole = TorqueComparison.from_parts(found)
        return [whole.misfit, whole.torques(names, units, limits, above, 0.0123)]

    rows = TorqueComparison.from_rows(t[:40], c[:40], m[:40], sigma[:40], doubted[:40])
    cut = {}
    for name, (count, all_rows, varies, variance, step) in {
        "29 rows": (29, 100, 1.0, 2.0, 0.1), "30 rows": (30, 100, 1.0, 2.0, 0.1),
        "share below": (60, 3010, 1.0, 2.0, 0.1), "share above": (60, 2990, 1.0, 2.0, 0.1),
        "varies less": (40, 100, 0.0049, 2.0, 0.0), "varies more": (40, 100, 0.0051, 2.0, 0.0),
        "step is larger": (40, 100, 0.0099, 2.0, 0.1), "step is smaller": (40, 100, 0.0101, 2.0, 0.1),
        "small beside the extreme": (40, 100, 6.0e-6, 1e-9, 0.0), "large beside the extreme": (40, 100, 6.5e-6, 1e-9, 0.0),
    }.items():  # fmt: skip
        mean = 1.7
        sums = np.array([[count], [count * mean], [count * (mean**2 + varies)]], float)
        for value in (5.0, 0.0):
            at = _AtExtreme(np.array([value]), np.array([value - step if step else -np.inf]), sums)
            cut[f"{name} {value}"] = at.cut(all_rows, np.array([variance]))
    zero = TorqueComparison.from_rows(t[:40], c[:40, :1], 0 * m[:40, :1], sigma[:40, :1], doubted[:40])
    steps = {}
    for step in (0.04, 0.06):
        x = np.r_[np.full(40, 5.0), np.full(9, 5.0 - step), np.linspace(4.0, -3.0, 30)][:, None]
        y = np.r_[2 + 0.05 * np.sqrt(2) * np.sin(np.arange(40)), np.linspace(4.0, -3.0, 39)][:, None]
        one = TorqueComparison.from_rows(np.arange(len(x)) * 0.01, y, x, 0 * x, np.zeros(len(x), bool))
        steps[str(step)] = one.highest.cut(len(x), 0.1 * np.var(y, axis=0))
    return {
        "whole": of((), doubted), "parts": of((13, 14, 60), doubted), "none is sound": of((31,), np.ones(n, bool)),
        "rows": [[*rows.measured], [*rows.computed], rows.beside, [*rows.highest], [*rows.lowest], [*rows.sound], [*rows.all_rows]],
        "cut": cut, "zero": zero.torques(("a",), ("N",), np.array([2.0]), above, 0.01), "steps": steps,
    }  # fmt: skip


@records.of
def motor_figures_of_parts():
    model = quietly(crane().with_actuators)("""
motors:
  m1: {torque_constant: 0.13 N m/A, resistance: 0.4 ohm, current_continuous: 1.2 A, current_peak: 9 A}
  m2: {torque_constant: 0.05 N m/A, resistance: 1.3 ohm, voltage: 20 V, speed: 3000 rpm}
actuators:
  swivel: {ratio: 81, motor: m1}
  luff: {ratio: 50, rotor: {inertia: 100 g cm^2}}
  boom: {ratio: 40 mm/turn, motor: m2}
""").model
    n = 37
    base = np.column_stack([X, X[:, :1] * 0.7 - 0.2])
    loads = [
        MotorLoads(*(base[s] * [1.0, 9.0, f] for f in range(2, 2 + len(MotorLoads._fields))))
        for s in parts(n, 5, 6, 30)
    ]
    found = MotorFigures.from_parts(
        [MotorFigures.from_rows(model, s, T, load) for s, load in zip(parts(n, 5, 6, 30), loads, strict=True)]
    )
    return [
        fields_of(use, "joint", "demands", "power", "heat", "time", "speed", "torque", "words", "too_small") | {"tightest": use.tightest.what}
        for use in found.uses(model)
    ] + [[actuator.joint for actuator in model.actuators.values()], Actuator("a").ratio, Motor(0.1).resistance]  # fmt: skip


@records.of
def progress_of_steps():
    heard = []
    steps = Steps(heard.append, (1.0, 3.0, 0.5, 2.0))
    first = steps.next()
    first(0.5), first(1.3)
    second = steps.next(8)
    second(2), second(4), second(9)
    steps.skip(1)
    last = steps.next(0)
    last(0.0)
    steps.done()
    silent = Steps(None, (1.0, 2.0))
    return [heard, silent.next(), silent.next(3), silent.done()]


@records.of
def extremes_of_kinds():
    """Shares of velocities and positions, with joints that have no limit, and the order of excesses."""
    load = LoadCase(crane())
    s = next(iter(tw.check(crane(), motion()).differentiation.states(100)))
    limits = crane().limits
    some = replace(
        limits,
        velocity=np.array([1.0, np.inf, 0.3, 0.2]),
        lower=np.array([-np.inf, 0.1, 0.02, 0.0]),
        upper=np.array([0.8, 0.5, 0.15, 0.0]),
    )
    tau = np.asarray(load.torques(s))
    borne = np.asarray(load.follower_torques(s))
    found = torque_analysis.Extremes.from_states(load, some, s, (s.time, tau, borne))
    empty = torque_analysis.Extremes.from_states(load, some, s[:0], (s.time[:0], tau[:0], borne[:0]))
    joined = torque_analysis.Extremes.from_parts(
        [
            torque_analysis.Extremes.from_states(load, some, s[a], (s.time[a], tau[a], borne[a]))
            for a in parts(23, 3, 11)
        ]
    )
    free = torque_analysis.Extremes.from_states(
        load, replace(some, velocity=np.full(4, np.inf), upper=np.full(4, np.inf)), s, (s.time, tau, borne)
    )
    bear = replace(
        some,
        radial=np.array([50.0, np.inf, 20.0, np.inf]),
        tilting=np.array([np.inf, 3.0, np.inf, 1.0]),
        effort=np.array([5.0, 15.0, 3.0, 1.0]),
    )
    beared = torque_analysis.Extremes.from_states(load, bear, s, (s.time, tau, 40 * borne))
    return {
        "near": found.nearest(), "excesses": found.excesses(), "joined": [joined.nearest(), joined.excesses(), list(joined.peak), list(joined.borne)],
        "no rows": [empty.nearest(), empty.excesses()], "free": free.nearest(), "bearings": [beared.bearings(), beared.excesses()],
        "moved": [[m[0].start, m[0].stop, m[1]] for m in (torque_analysis._moved_velocities(crane().model, k) for k in range(4))],
    }  # fmt: skip


@records.of
def coordinates_of_a_free_body():
    robot = quietly(tw.load)('<mujoco><worldbody><body name="a"><joint name="turn" axis="0 1 0"/><geom size="0.1" mass="2"/><body name="b" pos="0.3 0 0"><joint name="ball" type="ball"/><geom size="0.07" pos="0.1 0.02 0" mass="1"/>'
                             '<body name="c" pos="0.2 0 0.1"><joint name="slide" type="slide" axis="0 0 1"/><geom size="0.05" mass="0.5"/></body></body></body><body name="d" pos="1 0 1"><freejoint name="free"/><geom size="0.1" mass="1"/></body></worldbody></mujoco>')  # fmt: skip
    moved = [torque_analysis._moved_velocities(robot.model, k) for k in range(robot.nq)]
    return [
        [list(robot.coordinate_names), list(robot.model.velocity_names)],
        [[m[0].start, m[0].stop, m[1]] for m in moved],
    ]


@records.of(relative=1e-4)
def glitches_and_slices_of_a_log():
    """Samples far off: outliers, their size, and torques in slices of rows."""
    t = np.arange(0, 2.4, 0.02)
    q, dq, _ = swing(t)
    noise = np.random.default_rng(5).normal(0, 2e-5, q.shape)
    robot = crane()
    positions = q + noise
    positions[50, 1] += 4e-3
    positions[77, 2] -= 1.5e-3
    speeds = dq + 20 * noise
    speeds[40, 0] += 0.05
    logs = {
        "positions": tw.Motion(t, positions, robot=robot, in_seconds=True),
        "speeds": tw.Motion(t, q, speeds, robot=robot, in_seconds=True),
        "with torques": tw.Motion(
            t,
            q + noise,
            tau=np.asarray(robot.inverse_dynamics(*swing(t))) * [1, 1.02, 1, 1],
            robot=robot,
            in_seconds=True,
        ),
    }
    table = {}
    for name, log in logs.items():
        answer = tw.check(robot, log)
        table[name] = [
            words_of(answer),
            answer.outliers,
            answer.peaks,
            [joint.noise for joint in answer.joints],
            answer.measured,
            answer.stationary,
        ]
    loads = tw.check(robot, logs["positions"], payload=1.0)
    parts_of = torque_analysis.analyse(loads.load, loads.derived.differentiation, robot.limits, chunk=17)
    table["slices"] = [
        [joint.terms for joint in parts_of.joints],
        parts_of.peaks,
        parts_of.stationary,
        parts_of.outliers,
        parts_of.largest,
        [joint.rms for joint in parts_of.joints],
        parts_of.envelope,
    ]
    states = LoadStates.from_report(loads)
    table["draws"] = [len(states.draws), states.motion.ddq[5], states.draws[3].q[60], states.draws[11].ddq[70]]
    plain = LoadStates.from_motion(robot, motion())
    derived = LoadStates.from_motion(robot, logs["positions"], friction=False)
    table["from motions"] = [len(plain.draws), plain.motion.ddq[3], len(derived.draws), derived.draws[2].ddq[9]]
    return table


COUPLED = """
couplings:
  wrist: {motors: [east, west], joints: [swivel, luff], motor_per_joint: [[1.2, 0.8], [-0.7, 1.1]]}
actuators:
  east: {ratio: 60, efficiency: 0.8, effort: 18 N m, reflected_inertia: 0.3 kg m^2, friction: {viscous: 2 N m s/rad, coulomb: 1.5 N m}}
  west: {ratio: 50, effort: 41 N m, reflected_inertia: 0.2 kg m^2, friction: {coulomb: 0.9 N m}}
"""


@functools.cache
def coupled():
    return quietly(crane().with_actuators)(COUPLED)


@records.of
def motors_that_move_two_joints():
    t = uneven(16)
    answer = tw.check(coupled(), tw.Motion(t, *swing(t), robot=coupled(), in_seconds=True), payload=0.8)
    recorded = Recording.from_report(answer)
    _, _, series = next(recorded.portions)
    return {
        "report": said(answer),
        "terms": answer.joints[0].terms,
        "torques": answer.torques(),
        "shares": series["share"].tau,
        "limits": [recorded.limits.dq, recorded.limits.tau],
        "info": shown(tw.info(coupled()).blocks()),
        "table": limits_csv(coupled()).splitlines(),
    }


# ── Many motions


@records.of
def verdicts_on_many_motions(folder):
    t = uneven(20)
    q, dq, ddq = swing(t)
    names = heads_of(crane(), "", ".vel", ".acc")
    (folder / ".hidden.csv").write_text("x")
    write_log(folder / "b fits.csv", t, (q, dq, ddq), names)
    write_log(folder / "a over.csv", t, (q, 4 * dq, 9 * ddq), names)
    write_log(folder / "c [1].csv", t, (q,), names[:4])
    (folder / "d broken.csv").write_text("time,swivel\n0,1\n")
    (folder / "sub").mkdir()
    finished = []
    found = tw.check_each(crane(), folder, payload=1.1, progress=finished.append)
    fine = tw.check_each(crane(), [folder / "b fits.csv", motion()], actuators=None, lock=None)
    paths = {
        "folder": expanded_paths(folder), "pattern": expanded_paths(f"{folder}/*.csv"), "brackets": expanded_paths(folder / "c [1].csv"),
        "one": expanded_paths("x.csv"), "question": expanded_paths(f"{folder}/? fits.csv"),
    }  # fmt: skip
    return {
        "blocks": shown(found.blocks()), "motions": found.motions, "severity": [one.severity for one in found], "csv": found.to_csv(folder / "sub" / "all.txt").read_text().splitlines(),
        "sources": list(found.sources()), "subject": [found.subject, fine.subject], "progress": finished, "fine": shown(fine.blocks())[0], "first": found[0], "slice": len(found[1:]),
        "paths": paths, "none": refusal(lambda: expanded_paths(f"{folder}/*.txt")), "empty": refusal(lambda: expanded_paths(folder / "sub2")) if (folder / "sub2").mkdir() is None else None,
        "all fail": refusal(lambda: tw.check_each(crane(), [folder / "d broken.csv"] * 2)),
    }  # fmt: skip


@records.of
def severest_of_many_verdicts():
    words = [Word.LOOK_AGAIN, Word.COLLISION, Word.OVER_LIMIT, "failed", Word.UNSURE, Word.OK]
    table = {}
    for k in range(len(words)):
        motions = tuple(
            CheckedMotion(f"{j}.csv", str(word), "arm", 3.0 + j, 7.0, "N m", 0.1 * j, 5 + j, f"why {j}")
            for j, word in enumerate(words[k:] + words[-1:] * 2)
        )
        found = CheckedMotions("arm", motions)
        table[str(words[k])] = [found.verdict, [one.severity for one in found], shown(found.blocks())[0]]
    odd = [
        CheckedMotion("a", "OK", "j", -3.0, math.inf, "N"),
        CheckedMotion("b", "OK", "j", 2.0, 0.0, "N"),
        CheckedMotion("c", "failed", reason="no"),
        CheckedMotion("d", "OK", "j", -6.0, 2.0, "N m", 0.2),
    ]
    table["odd"] = [[one.severity for one in odd], shown(CheckedMotions("arm", tuple(odd)).blocks())]
    table["one"] = CheckedMotions("arm", tuple(odd[:1])).subject
    return table  # fmt: skip


# ── Logs without a robot


@records.of
def quality_of_logs(folder):
    rng = np.random.default_rng(1)
    n = 200
    steps = np.full(n, 0.01)
    steps[[20, 60]] = 0.0299, 0.0301
    steps[100] = 0.0
    steps[150] = -0.02
    t = np.cumsum(steps)
    wave = np.sin(5 * np.arange(n) * 0.01) + rng.normal(0, 1e-4, n)
    columns = {
        "smooth": wave, "grid [deg]": np.round(wave, 2), "noisy": wave + rng.normal(0, 0.01, n), "dead": np.full(n, 3.3),
        "cut": np.clip(wave, -0.5, 0.94), "low": np.clip(wave, 0.0, 2.0), "coarse": np.round(3 * wave), "mostly zero": np.where(np.arange(n) % 9 < 8, 0.0, wave),
    }  # fmt: skip
    times = {
        "time": t, "time [ms]": 1e3 * t, "timestamp_ns": np.round(1e9 * (1.7e9 + np.arange(n) * 0.02)), "stamp": 1.7e9 + t, "elapsed": t,
    }  # fmt: skip
    table = {}
    for name, time in times.items():
        path = folder / f"{name.split()[0]}{'_ms' if '[' in name else ''}.csv"
        chosen = columns if name == "time" else {"smooth": wave}
        np.savetxt(
            path, np.column_stack([time, *chosen.values()]), "%.12g", ",", header=",".join([name, *chosen]), comments=""
        )
        quality = LogQuality.from_file(path)
        table[name] = [quality, LogReport(quality).brief, shown(LogReport(quality).blocks())]
    (folder / "words.csv").write_text("a,b,time,t2\n1,x,0,5\n2,y,0.1,7\n4,z,0.3,6\n")
    table["words"] = said(tw.check_log(folder / "words.csv"))
    (folder / "untimed.csv").write_text("a,b\n1,2\n2,1\n4,7\n")
    table["untimed"] = tw.check_log(folder / "untimed.csv").to_dict()["sentences"]
    (folder / "one.csv").write_text("time,b\n1,2\n")
    table["one row"] = {
        k: v for k, v in tw.check_log(folder / "one.csv").to_dict().items() if k not in ("schema", "version")
    }
    (folder / "empty.csv").write_text("time,b\n")
    table["empty"] = refusal(lambda: tw.check_log(folder / "empty.csv"))
    (folder / "all words.csv").write_text("a,b\nx,y\nz,w\n")
    table["all words"] = refusal(lambda: tw.check_log(folder / "all words.csv"))
    return table


@records.of
def remarks_on_a_log_on_both_sides():
    def column(**given):
        return LogColumn(
            **({"name": "q", "least": -1.0, "most": 4.0, "grid": 0.0, "noise": 0.0, "cut": 0.0, "dead": False} | given)
        )

    base = {
        "rows": 50,
        "time": "t",
        "seconds": 4.9,
        "rate": 10.0,
        "gaps": 0,
        "longest": 0.1,
        "repeated": 0,
        "backward": 0,
        "jitter": 0.0,
    }

    def text(**given):
        from pathlib import Path

        quality = LogQuality(path=Path("log.csv"), columns=(column(),), **(base | given))
        return shown(LogReport(quality).blocks())[0]

    saturated = {}
    for count in (19, 20, 21):
        x = np.r_[np.full(count, 2.0), np.linspace(1.9, -1.0, 100)][:, None]
        saturated[str(count)] = log_quality._column_quality("q", x, [x], 0)
        long = np.r_[np.full(count, -2.0), np.linspace(1.9, -1.0, 2010 - count)][:, None]
        saturated[f"of many {count}"] = log_quality._column_quality("q", long, [long[:900], long[900:]], 0).cut
    short = np.array([[0.0], [1.0], [0.0], [2.0]] * 3)
    return {
        "columns": [
            log_view_remark(column(**given))
            for given in (
                {"dead": True}, {"cut": 0.123, "zeros": 0.2}, {"zeros": 0.1}, {"zeros": 0.101}, {"grid": 0.1}, {"grid": 0.1001}, {"grid": 0.0999}, {"grid": 1.3, "cut": 0.5},
            )
        ],
        "clock": [
            text(**given)
            for given in (
                {}, {"time": ""}, {"jitter": 0.99e-4}, {"jitter": 1.01e-4}, {"gaps": 1, "longest": 0.7}, {"gaps": 3, "longest": 0.7, "repeated": 1, "backward": 2},
                {"repeated": 4, "backward": 1}, {"jitter": math.nan},
            )
        ],
        "saturated": saturated, "short": log_quality._column_quality("q", short, [short], 0), "few rows": [log_quality._grid_and_noise([X[:k, 0], X[:16, 0]]) for k in (15, 16)],
        "clocks": [log_quality._clock_figures(np.array(t)) for t in ([0.0, 1.0, 2.0, 5.0], [0.0, 1.0, 2.0, 4.99], [3.0, 3.0], [3.0], [2.0, 1.0])],
    }  # fmt: skip


def log_view_remark(column):
    from twistwrench.reports.log_report import _remarks_on_column

    return _remarks_on_column(column)


# ── Contents of robots


KINDS = """<mujoco model="kinds"><compiler angle="radian"/><option gravity="0.3 -0.2 -9.7"/><worldbody><body name="hull" pos="0 0 1"><freejoint name="root"/><geom type="box" size="0.2 0.11 0.07" mass="3.1"/>
<site name="eye" pos="0.1 0 0"/>
<body name="arm" pos="0.1 0.05 -0.1"><joint name="tilt" axis="0 1 0.2" range="-2 1.5" damping="0.3" frictionloss="0.2" armature="0.05" actuatorfrcrange="-9 9"/><geom type="capsule" fromto="0 0 0 0.1 0.02 -0.3" size="0.03" mass="0.7"/>
<body name="ball" pos="0.1 0 -0.3"><joint name="knob" type="ball" damping="0.1"/><geom type="box" size="0.05 0.03 0.02" pos="0.02 0.01 0" mass="0.4"/></body></body>
<body name="rail" pos="-0.1 0 0"><joint name="slide" type="slide" axis="1 0 0.1" range="-0.3 0.2"/><geom type="box" size="0.05 0.03 0.02" pos="0.02 0.01 0" mass="0.6"/></body></body></worldbody>
<keyframe><key name="home" qpos="0 0 1 1 0 0 0 0.2 1 0 0 0 0.1"/></keyframe></mujoco>"""


@functools.cache
def kinds():
    return quietly(tw.load)(KINDS)


@records.of
def contents_of_robots(folder):
    driven = quietly(crane().with_actuators)(
        "actuators:\n  luff: {ratio: 50, efficiency: 0.9, rotor: {inertia: 100 g cm^2}, motor: {torque_constant: 0.1 N m/A, resistance: 0.3 ohm, voltage: 24 V}}\n  swivel: {ratio: 30, stiffness: 900 N m/rad, rotor: {inertia: 90 g cm^2}}\n"
    )
    ball = "".join(
        f'<link name="l{k}"><inertial><mass value="{1 + 0.1 * k}"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        + (f'<joint name="j{k}" type="{"prismatic" if k % 3 == 2 else "revolute"}"><parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="0 {k % 2} 1"/><limit lower="-1" upper="1" effort="{k}" velocity="2"/>'
           + ('<mimic joint="j1" multiplier="-2.5" offset="-0.3"/>' if k == 4 else '<mimic joint="j2" multiplier="1"/>' if k == 6 else "") + "</joint>" if k else "")
        for k in range(15)
    )  # fmt: skip
    chain = quietly(tw.load)(f'<robot name="chain">{ball}</robot>')
    table = {}
    for name, robot in {
        "crane": crane(),
        "kinds": kinds(),
        "driven": driven,
        "chain": chain,
        "locked": crane().lock({"luff": 0.4}),
    }.items():
        report = tw.info(robot, degrees=name in ("crane", "chain"))
        table[name] = shown(report.blocks())
        table[f"{name} csv"] = limits_csv(robot).splitlines()
        if name in ("crane", "kinds"):
            table[f"{name} data"] = summary(robot)
            table[f"{name} html"] = html_summary(robot)
    path = folder / "limits.csv"
    report = tw.info(crane())
    report.to_csv(path)
    table["written"] = [
        len(path.read_text()),
        refusal(lambda: report.to_csv(path)),
        report.to_csv(path, overwrite=True).name,
        str(report.verdict.word),
        report.robot_name,
    ]
    table["html of a loop"] = html_summary(
        quietly(tw.load)(
            "<mujoco><worldbody><body name='a'><joint name='p'/><geom size='0.1'/></body><body name='b'><joint name='q'/><geom size='0.1'/></body></worldbody></mujoco>"
        )
    )
    return table  # fmt: skip


# ── Recordings


@records.of
def recordings_for_viewers():
    report = tw.check(crane(), motion(rows=9), payload=1.2, wrench_on_robot={"hook": (1, 2, 3, 4, 5, -6)})
    recording = Recording.from_report(report)
    time, q, series = next(recording.portions)
    own = tw.Motion(motion(rows=9).time, motion(rows=9).q, robot=crane(), in_seconds=True)
    plain = Recording.from_motion(own)
    robot = kinds()
    pose = np.tile(robot.neutral, (3, 1))
    pose[:, 7] = [0.1, 0.5, -0.4]
    pose[:, 8:12] = np.array([0.9, 0.1, 0.3, -0.2]) / math.sqrt(0.95)
    pose[:, -1] = [0.05, 0.1, 0.15]
    moving = MovingJoints(robot, robot_description(robot.model))
    joints = MovingJoints(crane(), robot_description(crane().model))
    late = replace(recording, epoch=5)
    noted = Recording.from_report(tw.check(crane(), motion(rows=9), friction=False))
    return {
        "series": {name: [states.q, states.dq, states.tau] for name, states in series.items()},
        "shape": [time, q],
        "names": [recording.joints, recording.units, recording.span, recording.epoch, recording.verdict],
        "limits": [recording.limits.dq, recording.limits.tau],
        "curves": [[list(path), unit, values[:2]] for topic in ("joint_states", "torque/gravity", "share") for path, unit, values in _curves(recording, topic, series[topic])],
        "twice": list(_duplicate_rows(recording.limits)),
        "values": {name: recording.values(states) for name, states in series.items() if name in ("torque", "share")},
        "without friction": sorted(next(noted.portions)[2]),
        "motion": [plain.limits, plain.verdict, plain.span, [list(next(plain.portions)[2])]],
        "stamps": [late.stamps(np.array([0.0, 1.2345678915])), refusal(lambda: replace(recording, epoch=-10**9).stamps(np.array([0.5, 1.0]))), refusal(lambda: recording.stamps(np.array([0.0, 2.0**31])))],
        "transforms": [[parent, child, p, Q] for parent, child, p, Q in moving.transforms(pose)],
        "coordinates": joints.coordinates(motion(rows=3).q),
        "kinds": {"joints": list(replace(plain, robot=robot).joints), "coordinates": moving.coordinates(pose)},
        "none": list(joints.transforms(motion(rows=3).q)),
        "largest": list(Extrema.from_rows(time, np.abs(series["torque"].tau), series["torque"].tau)),
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
