"""Doubts about motions on record: units, turns, jumps, rates, sampling, steps no robot makes, and limits and loads none has."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_answers import Records

import twistwrench as tw
import twistwrench.motion
from twistwrench.core.text import words_of_the_shell
from twistwrench.motion import contradictions, credible_values, model_doubts, plausibility
from twistwrench.motion.bounds import Extrema
from twistwrench.motion.contradictions import Contradictions, angle_doubts, length_doubts, scale_words
from twistwrench.motion.coordinates import Coordinates
from twistwrench.motion.load_case import Payload
from twistwrench.motion.log_checks.log_conventions import dataset_doubts, fanuc_doubts
from twistwrench.motion.motion_log import LogRows, MotionLog
from twistwrench.motion.plausibility import DoubtfulSpans, Instant, InstantKind, Origin, RecordedSteps
from twistwrench.motion.readers.columnar_file import ArrayFile

from .test_motion_columns import (
    ARM,
    CRANE,
    CRANE_TEXT,
    GEARED,
    RAFT,
    compactly,
    joint,
    link,
    loaded,
    outcome,
)

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
record = compactly(records)


def short(doubts):
    """Kind, level, joints, sentence and value of each doubt."""
    found = []
    for d in doubts:
        sentence = (
            d.sentence.removesuffix(d.remedy)
            if d.kind
            in (
                "zero-or-direction",
                "angle-unit",
                "impossible-speed",
                "lone-step",
                "degrees-option",
                "row-numbers",
                "degrees-inside",
                "millimetres-inside",
            )
            else d.sentence
        )
        found.append([d.kind, d.level, *d.joints, sentence, *([] if d.value is None else [d.value, d.unit])])
    return found


THREE = ["a", "b", "c"]
FREE = (np.full(3, -np.inf), np.full(3, np.inf))
STOPS = (np.array([-2.0, -1.5, -3.0]), np.array([2.5, 1.0, 3.5]))
DEG = math.radians(1.0)


@record
def angles_that_may_have_another_unit():
    def doubted(
        least, largest, limits=STOPS, factor=(1.0, 1.0, 1.0), stated=(False, False, False), origin="either", names=THREE
    ):
        found = angle_doubts(
            names, np.array([least, largest], float), limits, np.array(factor), np.array(stated), origin
        )
        return [d[1:] if d[0] == "angle-unit" else d for d in short(found)]

    one = (np.array([-2.0, -np.inf, -3.0]), np.array([2.5, np.inf, 3.5]))
    degrees = (DEG, DEG, DEG)
    return {
        "inside": doubted([-1, -1, -1], [1, 0.9, 1]),
        "degrees that fit": doubted([-90, -60, -100], [80, 50, 110]),
        "counts": doubted([-900, -6000, -100], [80, 50, 11000]),
        "one far of three": doubted([-1, -1, -1], [1, 40, 1]),
        "one far of three in a plan": doubted([-1, -1, -1], [1, 40, 1], origin="plan"),
        "two far of three": doubted([-1, -40, -30], [1, 0.5, 1]),
        "far below many turns": doubted([0, 0, 0], [12.4, 12.5, 12.5]),
        "far above many turns": doubted([0, 0, 0], [12.4, 12.7, 12.7]),
        "three reaches": [doubted([0, 0, 0], [x, 1, 1], (np.array([-9.0, -1.5, -3.0]), np.array([8.0, 1.0, 3.5]))) for x in (26.5, 27.5)],
        "two with limits, one far": doubted([-1, -30, -1], [1, 30, 1], one),
        "many turns without limits": doubted([-1, -30, -1], [13, 30, 20], FREE),
        "few turns without limits": doubted([-1, -30, -1], [12, 1, 12], FREE),
        "many turns, stated": doubted([-1, -30, -1], [13, 30, 20], FREE, stated=(False, True, False)),
        "stated": doubted([-90, -60, -100], [80, 50, 110], stated=(True, True, True)),
        "beyond a stop": [doubted([-1, -1, x], [1, 0.5, -1]) for x in (-3.34, -3.36)],
        "beyond two stops": doubted([-2.5, -2, -1], [1, 0.5, 1]),
        "beyond two stops, not degrees": doubted([-2.5, -2, -1], [1, 0.5, 1], (np.array([-2.0, -1.5, 1.5]), np.array([2.5, 1.0, 3.5]))),
        "one beyond as a log": [doubted([0, 0, -1], [1, 1.5, 1], origin=o) for o in ("log", "plan", "either")],
        "wound": [doubted([4.5, -1, -1], [5.0, 1, 1], origin=o) for o in ("log", "plan", "either")],
        "wound, down": doubted([-5.0, -1, -1], [-4.6, 1, 1]),
        "wound and beyond": doubted([4.5, -4.5, -1], [5.0, 1, 1]),
        "small degrees": doubted([-1, -1, -1], [1, 0.5, 1], factor=degrees),
        "radians read as degrees": doubted(DEG * np.array([-1.0, -1, -1]), DEG * np.array([1.0, 0.5, 2]), factor=degrees),
        "radians read as degrees, at rest": doubted(DEG * np.array([1.0, 1, 1]), DEG * np.array([1.1, 1.2, 1.29]), factor=degrees),
        "radians read as degrees, moved little": doubted(DEG * np.array([1.0, 1, 1]), DEG * np.array([1.1, 1.2, 1.31]), factor=degrees),
        "just below a turn": [doubted(DEG * np.array([-1.0, -1, -1]), DEG * np.array([1.0, 0.5, x]), factor=degrees) for x in (6.2, 6.4)],
        "two in degrees": doubted(DEG * np.array([-1.0, -1, -1]), DEG * np.array([1.0, 0.5, 2]), factor=(DEG, 1.0, DEG)),
        "two in degrees, one far": doubted([0, 0, 0], [DEG, 30.0, DEG], factor=(DEG, 1.0, DEG)),
        "in degrees, stated": doubted(DEG * np.array([-1.0, -1, -1]), DEG * np.array([1.0, 0.5, 2]), factor=degrees, stated=(True, True, True)),
    }  # fmt: skip


@record
def lengths_beyond_their_stops():
    lower, upper = np.array([0.0, -0.5, -np.inf]), np.array([0.5, 1.0, np.inf])

    def doubted(least, largest, origin="either"):
        return short(length_doubts(THREE, np.array([least, largest], float), (lower, upper), origin))

    return {
        "inside": doubted([0, -0.5, -9], [0.5, 1, 9]), "by the stroke": [doubted([0, 0, 0], [x, 1, 9]) for x in (0.99, 1.01)], "below": doubted([0, -2.1, 0], [0.4, 0.5, 1]),
        "millimetres": doubted([0, -400, 0], [400, 900, 1]), "millimetres, nearly": [doubted([0, -400, 0], [x, 900, 1]) for x in (540, 560)], "few strokes": [doubted([0, 0, 0], [x, 1, 1]) for x in (5.4, 5.6)],
        "plan": doubted([0, -400, 0], [400, 900, 1], "plan"), "log": doubted([0, -400, 0], [400, 900, 1], "log"), "one far": doubted([0, 0, 0], [400, 1, 1]), "one of them not millimetres": doubted([-300, -400, 0], [400, 900, 1]),
    }  # fmt: skip


@record
def words_for_wrong_scales():
    gains = [
        1e3,
        950.0,
        1.05e6,
        1e9,
        1e-3,
        57.3,
        60.0,
        1 / 57.3,
        9.55,
        8.8,
        10.6,
        math.inf,
        0.019,
        -0.019,
        0.021,
        -1.0,
        -1.09,
        -1.12,
        0.5,
        2.0,
        1150.0,
        7e5,
    ]
    short_list = [1e3, 1e-3, 57.3, 1 / 57.3, 9.55, math.inf, -1.0, 2.0]
    return {
        f"{angular} {per}": {
            str(round(g, 6)): scale_words(g, angular, "positions", per)
            for g in (gains if angular and per == "/s" else short_list)
        }
        for angular in (True, False)
        for per in ("/s", "/s^2")
    }


T = np.arange(60) * 0.05
S = np.stack(
    [0.2 * np.sin(1.3 * T), -0.6 + 0.5 * np.sin(0.9 * T + 0.3), 0.9 * np.sin(1.1 * T), 0.3 - 0.6 * np.cos(0.7 * T)], 1
)
D = np.stack([0.26 * np.cos(1.3 * T), 0.45 * np.cos(0.9 * T + 0.3), 0.99 * np.cos(1.1 * T), 0.42 * np.sin(0.7 * T)], 1)
A = np.stack(
    [-0.338 * np.sin(1.3 * T), -0.405 * np.sin(0.9 * T + 0.3), -1.089 * np.sin(1.1 * T), 0.294 * np.cos(0.7 * T)], 1
)
TAU = 3.0 + np.stack([np.sin(5 * T), np.cos(4 * T), np.sin(3 * T + 1), np.cos(7 * T)], 1)


LONG = np.arange(240) * 0.0125
WAVE = np.stack(
    [
        0.2 * np.sin(3 * LONG),
        -0.6 + 0.5 * np.sin(2 * LONG + 0.3),
        0.9 * np.sin(2.5 * LONG),
        0.3 - 0.6 * np.cos(2.2 * LONG),
    ],
    1,
)


def logged(t, q, dq=None, ddq=None, tau=None, time="time", robot=CRANE, **options):
    """Doubts about a log in memory, its notes, instants and origin."""
    c = Coordinates.from_model(robot.model)
    header, columns = [time], [np.asarray(t, float)[:, None]]
    for part, values in (("q", q), ("dq", dq), ("ddq", ddq), ("tau", tau)):
        if values is not None:
            header += c.headers(part)
            columns.append(values)
    table = np.concatenate(columns, axis=1)
    glitches = options.pop("glitches", True)
    limits, own = options.pop("limits", robot.limits), options.pop("own", None)

    def read():
        log = MotionLog.open(ArrayFile.from_table(Path("log.csv"), header, table, table.nbytes), robot.model, **options)
        doubts = log.doubts(limits, own=own, glitches=glitches)
        found = {
            "doubts": short(doubts),
            "rows": len(log.table),
            "origin": str(log.origin),
            "instants": [[round(i.begin, 9), round(i.end, 9), i.joint, str(i.cause)] for i in log.instants],
        }
        return {name: value for name, value in found.items() if value and value not in (len(t), "either")}

    return outcome(read)


def changed(array, rows, columns, values):
    array = array.copy()
    array[rows, columns] = values
    return array


@record
def doubts_about_times_of_logs():
    slow = S[0] + 0.1 * (S - S[0])
    return {
        "clean": logged(T, S, D, A, TAU),
        "milliseconds": logged(1000 * T, S),
        "microseconds": logged(1e6 * T, slow),
        "nanoseconds": logged(1e9 * T, slow),
        "milliseconds, stated": logged(1000 * T, S, time="time [s]"),
        "milliseconds, rates": logged(1000 * T, S, 1e-3 * D),
        "milliseconds, velocities in s": logged(1000 * T, S, D),
        "slow steps": [logged(step * np.arange(60), S) for step in (0.09, 0.11, 0.9)],
        "fast in milliseconds": logged(40 * T, 5 * S),
        "slow, for its limits": [logged(step * np.arange(90), np.outer(0.2 * np.arange(90), [1e-3, 2e-3, 3e-3, -2e-3]) * step / 0.2, robot=r) for step, r in ((0.2, CRANE), (0.3, CRANE), (0.2, UNLIMITED))],
        "rows": logged(np.arange(60.0), S),
        "rows from 7": logged(np.arange(7.0, 67.0), slow),
        "rows from a half": logged(np.arange(60) + 0.5, slow),
        "rows of a log": logged(np.arange(60.0), slow, tau=TAU),
        "rows with velocities": logged(np.arange(60.0), slow, 0.005 * D),
        "rows of a plan": logged(np.arange(60.0), slow, plan=True),
        "few rows": [logged(np.arange(float(n)), 3 * S[:n]) for n in (19, 20)],
        "at rest": logged(np.arange(60.0), S[:1] + 0 * S),
        "moved little": [logged(1000 * T, S[:1] + np.linspace(0, x, 60)[:, None]) for x in (0.049, 0.051)],
        "without limits": [logged(step * np.arange(60), S, robot=tw_unlimited()) for step in (0.9, 1.1)],
        "large steps": logged(2.0 * np.arange(60), 9 * S, robot=tw_unlimited()),
        "fast for tens a second": logged(np.arange(60.0), 40 * S, robot=tw_unlimited()),
        "shell": in_the_shell(logged, 1000 * T, S),
    }  # fmt: skip


def in_the_shell(call, *arguments):
    with words_of_the_shell():
        return call(*arguments)


def tw_unlimited():
    """The crane without any limit."""
    return UNLIMITED


UNLIMITED = loaded(
    "<robot name='free'><link name='ground'/>"
    + "".join(link(f"l{k}", 1.5 + k, "0.1 0.02 0.3", (0.1, 0.12, 0.09, 0.001, 0.002, 0.003)) for k in range(4))
    + joint("zslide", "continuous", "ground", "l0", "0 0 1", "0 1 0.2")
    + joint("boom_joint", "continuous", "l0", "l1", "0 0 1", "0 1 0.1")
    + joint("spin", "continuous", "l1", "l2", "0 0 1", "0 1 0.3")
    + joint("a_tilt", "continuous", "l2", "l3", "0 0 1", "1 0 0.2")
    + "</robot>"
)


@record
def doubts_about_positions_of_logs():
    turned = S.copy()
    turned[:, 3] = 1.1 * np.linspace(-1.5, 3.2, 60)
    wrapped = turned.copy()
    wrapped[:, 3] = np.mod(wrapped[:, 3] + math.pi, math.tau) - math.pi
    wide = S.copy()
    wide[:, 1] = np.linspace(-2.5, 4.5, 60)
    wide[:, 1] = np.mod(wide[:, 1] + math.pi, math.tau) - math.pi
    far = S.copy()
    far[:, 2] = 9 * T
    return {
        "degrees": logged(T, np.c_[S[:, 0], np.degrees(S[:, 1:])]),
        "degrees stated": logged(T, np.c_[S[:, 0], np.degrees(S[:, 1:])], degrees=True),
        "millimetres": logged(T, np.c_[1000 * S[:, 0], S[:, 1:]]),
        "wrapped": logged(T, wrapped),
        "wrapped beyond limits": logged(T, wide),
        "turns of an endless joint": logged(T, far),
        "jump": logged(T, changed(S, slice(30, 60), 1, S[30:, 1] + 3.3)),
        "jump by a turn beyond a turn": logged(T, changed(wide, slice(30, 60), 1, wide[30:, 1] + 3.0)),
        "slow jump": logged(8 * T, changed(S, slice(30, 60), 3, S[30:, 3] + 3.3)),
        "glitch": logged(T, changed(S, 30, 2, S[30, 2] + 0.2)),
        "glitches of two": logged(T, changed(changed(S, [12, 40], 2, S[[12, 40], 2] - 0.3), 25, 0, S[25, 0] + 0.04)),
        "glitches left to smoothing": logged(T, changed(S, 30, 2, S[30, 2] + 0.2), glitches=False),
        "late stamp": logged(changed(T[:, None], 30, 0, T[30] + 0.03)[:, 0], S),
        "early stamps": logged(changed(T[:, None], [20, 41], 0, T[[20, 41]] - 0.021)[:, 0], S),
        "lone steps": [logged(LONG, changed(WAVE, slice(110, 240), 2, WAVE[110:, 2] + x), robot=UNLIMITED) for x in (0.3, 0.32)],
        "lone step, others beside": logged(LONG, changed(changed(WAVE, slice(110, 240), 2, WAVE[110:, 2] + 0.6), slice(111, 240), 2, WAVE[111:, 2] + 0.85), robot=UNLIMITED),
        "lone step after a pause": [logged(LONG + x * (LONG > 1.37), changed(WAVE, slice(110, 240), 2, WAVE[110:, 2] + 0.6), robot=UNLIMITED) for x in (0.02, 0.03)],
        "lone step of a log": logged(LONG, changed(WAVE, slice(110, 240), 2, WAVE[110:, 2] + 0.6), tau=np.tile(TAU, (4, 1)), robot=UNLIMITED),
        "lone step with a limit": logged(LONG, changed(WAVE, slice(110, 240), 1, WAVE[110:, 1] + 0.07)),
        "fast step": logged(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.9)),
        "fast step of a log": logged(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.9), tau=TAU),
        "fast step, limits with units": logged(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.4), tau=TAU, limits=stated_limits(), own=CRANE.limits),
        "fast step, limits without units": logged(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.4), tau=TAU, limits=replace(CRANE.limits, velocity=0.4 * CRANE.limits.velocity), own=CRANE.limits),
        "fast step of a plan": logged(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.9), plan=True),
        "raft": logged(T, np.c_[S, np.cos(T), 0.6 * np.sin(T), 0 * T, 0.8 * np.sin(T), S[:, :3]], robot=RAFT, limits=RAFT.limits),
    }  # fmt: skip


def stated_limits():
    from twistwrench.mechanics.model.limits import StatedLimits
    from twistwrench.motion.limits_file import KINDS

    limits = {kind: getattr(CRANE.limits, kind) for kind in KINDS} | {"velocity": 0.4 * CRANE.limits.velocity}
    with_unit = np.zeros((len(KINDS), 4), bool)
    with_unit[KINDS.index("velocity"), [1, 2]] = True
    return StatedLimits(**limits, stated=np.zeros(4, bool), with_unit=with_unit)


@record
def doubts_about_rates_of_logs():
    def scaled(array, column, factor):
        array = array.copy()
        array[:, column] *= factor
        return array

    def rate(t):
        return np.stack(
            [0.6 * np.cos(3 * t), 1.0 * np.cos(2 * t + 0.3), 2.25 * np.cos(2.5 * t), 1.32 * np.sin(2.2 * t)], 1
        )

    def path(t):
        return np.stack(
            [0.2 * np.sin(3 * t), -0.6 + 0.5 * np.sin(2 * t + 0.3), 0.9 * np.sin(2.5 * t), 0.3 - 0.6 * np.cos(2.2 * t)],
            1,
        )

    fine = np.arange(240) * 0.0125
    wave = np.stack(
        [
            0.2 * np.sin(3 * fine),
            -0.6 + 0.5 * np.sin(2 * fine + 0.3),
            0.9 * np.sin(2.5 * fine),
            0.3 - 0.6 * np.cos(2.2 * fine),
        ],
        1,
    )
    grid = np.arange(240) // 4 * 4
    rows = np.arange(240)
    skipped = np.interp(np.where(rows < 120, fine, fine + 0.09), fine, fine)
    pause = np.stack(
        [
            0.2 * np.sin(3 * skipped),
            -0.6 + 0.5 * np.sin(2 * skipped + 0.3),
            0.9 * np.sin(2.5 * skipped),
            0.3 - 0.6 * np.cos(2.2 * skipped),
        ],
        1,
    )
    behind = np.where(rows < 120, fine, fine - 0.05)
    shifted = np.stack(
        [
            0.2 * np.sin(3 * behind),
            -0.6 + 0.5 * np.sin(2 * behind + 0.3),
            0.9 * np.sin(2.5 * behind),
            0.3 - 0.6 * np.cos(2.2 * behind),
        ],
        1,
    )
    by_turns = np.where((rows // 30) % 2 == 0, fine, fine - 0.04)
    turns = np.stack(
        [
            0.2 * np.sin(3 * by_turns),
            -0.6 + 0.5 * np.sin(2 * by_turns + 0.3),
            0.9 * np.sin(2.5 * by_turns),
            0.3 - 0.6 * np.cos(2.2 * by_turns),
        ],
        1,
    )
    stuck = wave[np.where((rows > 100) & (rows < 106), 100, rows)]
    tau = 3.0 + np.stack([np.sin(5 * fine), np.cos(4 * fine), np.sin(3 * fine + 1), np.cos(7 * fine)], 1)
    return {
        "degrees a second": logged(T, S, scaled(D, 2, 57.3)),
        "in between": [logged(T, S, scaled(D, 3, x)) for x in (0.84, 0.87, 1.13, 1.17)],
        "accelerations": [logged(T, S, D, scaled(A, 1, x)) for x in (0.74, 0.77, 1.28, 1.33)],
        "opposite": logged(T, S, D, scaled(A, slice(1, 3), -1.0)),
        "derived": [logged(T, S, None, scaled(A, 2, x)) for x in (1.0, 2.0)],
        "of a slide": logged(T, S, scaled(D, 0, 1e3)),
        "moves alone": logged(T, np.c_[S[:, :2], 0.1 + 0 * T, S[:, 3]], D),
        "two alike": logged(T, S, scaled(D, slice(1, 3), 2.0)),
        "late": [logged(fine, wave, rate(fine - x)) for x in (0.03, 0.15)],
        "early": logged(fine, wave, rate(fine + 0.1)),
        "late, one more so": logged(fine, wave, np.c_[rate(fine - 0.15)[:, :3], rate(fine - 0.2)[:, 3]]),
        "late, one alone": logged(fine, wave, np.c_[rate(fine)[:, :3], rate(fine - 0.2)[:, 3]]),
        "repeated often": logged(fine, wave[grid], tau=tau),
        "missing": logged(fine, pause),
        "shifted": logged(fine, shifted),
        "shifted, then missing": logged(fine, path(np.where(rows < 80, fine, np.where(rows < 160, fine - 0.05, fine + 0.2)))),
        "shifted twice": logged(fine, path(np.where(rows < 80, fine, np.where(rows < 160, fine - 0.05, fine - 0.11)))),
        "by turns": logged(fine, turns),
        "dropouts of two runs": short(Contradictions(Coordinates.from_model(CRANE.model), runs=[LogRows(fine[k], wave[k].copy(), None, None, changed(changed(tau, slice(60, 90), 1, 3.25), slice(150, 190), 1, 3.25)[k]) for k in (slice(0, 120), slice(120, 240))])._torque_doubts()),
        "held": logged(fine, stuck),
        "spike": logged(fine, wave, tau=changed(tau, 50, 2, 30.0)),
        "spikes": logged(fine, wave, tau=changed(tau, [50, 80, 130], 2, 30.0)),
        "dropout": logged(fine, wave, tau=changed(tau, slice(60, 110), 1, 3.25)),
        "two dropouts": logged(fine, wave, tau=changed(changed(tau, slice(60, 90), 1, 3.25), slice(120, 160), 1, 3.25)),
    }  # fmt: skip


@record
def instants_of_motions():
    t = np.arange(80) * 0.01

    def found(q, times=t, robot=CRANE):
        steps = RecordedSteps(Coordinates.from_model(robot.model), [(times, q)])
        for first in range(0, len(times), 40):
            begin, end = max(0, first - 20), min(len(times), first + 60)
            steps.add(times[begin:end], q[begin:end], slice(first - begin, min(first + 40, len(times)) - begin))
        whole = RecordedSteps(Coordinates.from_model(robot.model), [(times, q)])
        whole.add(times, q)
        return [
            [[round(i.begin, 9), round(i.end, 9), i.joint, str(i.cause)] for i in s.instants] for s in (steps, whole)
        ] + [np.stack(whole.fastest), np.stack(whole.lone)]

    q = np.stack([0.1 * np.sin(3 * t), 0.4 * np.sin(2 * t), 0.9 * t, 0.3 * np.cos(4 * t)], 1)
    stop = np.minimum(t, 0.5) ** 2
    start = np.sin(3.1 * np.maximum(0.0, t - 0.3))
    return {
        "smooth": found(q),
        "wrong row": found(changed(q, 33, 1, q[33, 1] + 0.1)),
        "missing rows": found(q[np.r_[0:30, 36:80]], t[:74]),
        "repeated rows": found(q[np.r_[0:30, [29] * 4, 34:80]]),
        "repeated and made up": found(q[np.r_[0:20, [19] * 3, 23:80]] + np.array([0, 0, 0.5, 0]) * (t[:, None] > 0.6)),
        "impact": found(np.c_[q[:, :2], 0.4 * np.abs(np.sin(3.8 * (t - 0.4))), q[:, 3]]),
        "impact between rows": found(np.c_[q[:, :2], 0.4 * np.abs(np.sin(3.8 * (t - 0.404))), q[:, 3]]),
        "freeze": found(np.c_[0.1 * stop, 0.4 * stop, 0.9 * stop, -0.2 * stop]),
        "start": found(np.c_[-0.1 * start, 0 * t, 0.9 * start, 0.2 * start]),
        "stop of one": found(np.c_[q[:, :2], 0.9 * stop, q[:, 3]]),
        "impact beside a wrong row": [found(changed(np.c_[q[:, :2], 0.4 * np.abs(np.sin(3.8 * (t - 0.4))), q[:, 3]], 40 + k, 1, 0.9))[0] for k in (4, 9)],
        "noise": found(q + 1e-3 * np.random.default_rng(5).uniform(-1, 1, (80, 4))),
        "first row": found(changed(q, 0, 1, 0.3)),
        "last row": found(changed(q, 79, 1, q[79, 1] + 0.3)),
        "few rows": found(q[:19], t[:19]),
        "late stamp": found(q, changed(t[:, None], 40, 0, 0.407)[:, 0]),
        "two rows": found(q[:2], t[:2]),
        "steps": np.round(np.c_[plausibility._departures(q[:20])[:, 1], plausibility._departures(changed(q, 5, 1, 1.0)[:20])[:, 1]], 9),
        "abrupt": [plausibility._is_abrupt(np.array(v), a, b) for v, a, b in (([0, 0, 1, 5, 1, 0, 0.0], 3, 3), ([0, 0, 4, 5, 4, 0, 0.0], 3, 3), ([9, 1, 1, 1, 1.0], 0, 0), ([1, 1, 1, 1, 9.0], 4, 4))],
    }  # fmt: skip


@record
def origins_and_doubtful_spans():
    rng = np.arange(200.0)
    grids = {g: np.round(np.sin(rng / 17) / g) * g for g in (2 * math.pi / 4096, 0.001, 0.0005, 0.0003, 0.002)}
    instants = [
        Instant(0.5, 0.51, 2, InstantKind.IMPACT),
        Instant(0.2, 0.23, 1, InstantKind.ROWS),
        Instant(0.9, 0.92, 0, InstantKind.FREEZE),
        Instant(0.3, 0.31, 1, InstantKind.ROWS),
    ]
    spans = {str(o): plausibility.doubtful_spans(instants, 0.01, o, rows=4) for o in Origin}
    corner = plausibility.doubtful_spans(instants[:1], 0.01, Origin.LOG, rows=4)
    e = np.array([900.0, 140.0, 45.0, 18.0])

    def torque(share, robot=CRANE, origin=Origin.LOG, time=0.7, spans=corner):
        tau = np.array([share]) * e
        return outcome(
            lambda: (
                (
                    d := plausibility.impossible_torque(
                        robot, Extrema.from_rows(np.array([time]), np.abs(tau), tau), origin, spans
                    )
                )
                and short([d])
            )
        )

    return {
        "encoder": {str(g): plausibility.is_encoder(g) for g in (0.0, -1.0, 0.001, 0.00099999999, 0.000999, 0.02, 0.03, 5.0, 0.05, 7.0)},
        "origins": {str(round(g, 6)): str(plausibility.origin_of([(x[:100, None], None), (x[100:, None], None)], plan=False)) for g, x in grids.items()},
        "by torques": [str(plausibility.origin_of([(rng[:, None], tau)], plan=p)) for tau in (None, np.ones((200, 1)), rng[:, None]) for p in (False, True)],
        "levels": [(str(o), o.level) for o in Origin],
        "spans": {name: [bool(s), [i.begin for i in s.instants], s.reach, s.within(np.array([0.155, 0.165, 0.265, 0.275, 0.345, 0.355, 0.455, 0.465, 0.545, 0.555, 0.955, 0.965])), [short([s.doubt_at(times)]) for times in ([0.5], [0.2, 0.9], [0.7], [0.48, 0.9])] if s else ""] for name, s in spans.items()},
        "empty": DoubtfulSpans().within(np.array([0.1])),
        "torques": [torque([1, 1, x, 0.5]) for x in (9.9, -10.1)] + [torque([11, 1, 12, 0.5]), torque([1, 12, 1, 0.5], origin=Origin.EITHER), torque([1, 12, 1, 0.5], origin=Origin.PLAN), torque([1, 12, 1, 0.5], time=0.5), torque([1, 1, 12, 13], GEARED), torque([0.1, 0.1, 40, 40], ROUND)],
    }  # fmt: skip


def with_limits(robot=CRANE, **values):
    return replace(robot.limits, **{name: np.array(value, float) for name, value in values.items()})


def with_units(kind):
    """Doubtful limits, of which one kind was given with its unit."""
    from twistwrench.mechanics.model.limits import StatedLimits
    from twistwrench.motion.limits_file import KINDS

    limits = with_limits(
        lower=[-0.75, -145, -np.inf, -100],
        upper=[1.5, 70, np.inf, 165],
        velocity=[0.8, 126, 177, 4.3],
        effort=[9000.0, 1400, 450, 180],
    )
    with_unit = np.zeros((len(KINDS), 4), bool)
    if kind:
        with_unit[KINDS.index(kind)] = True
    return StatedLimits(**{k: getattr(limits, k) for k in KINDS}, stated=np.zeros(4, bool), with_unit=with_unit)


ROUND = loaded(re.sub('effort="[0-9.]*"', 'effort="60"', CRANE_TEXT))
WEAK = loaded(CRANE_TEXT.replace('effort="140"', 'effort="9"'))


@record
def limits_that_no_robot_has():
    def doubted(robot=CRANE, **values):
        limits = with_limits(robot, **values)
        return short(credible_values.credible_limits(limits, robot)), credible_values.placeholder_limits(robot, limits)

    arm = {"effort": [70.0, 60, 50, 40, 30, 20, 10, 10]}
    inf = np.inf
    weights = credible_values.weight_torques(CRANE)
    return {
        "rounds": {str(x): credible_values.shared_round(np.array(x, float)) for x in ([10, 10, 10], [10, 10], [10, 10, 10.1], [7, 7, 7], [9, 9, 9, inf], [0.3, 0.3, 0.3, 0], [12, 12, 12], [9.99999999] * 3, [9.9] * 3, [inf] * 3)},
        "credible": [credible_values.credible_velocities(with_limits(velocity=v)) for v in ([1, 2, 3, 0], [10, 10, 10, 10], [5, -1, inf, 7])],
        "efforts": [credible_values.credible_efforts(CRANE), credible_values.credible_efforts(ARM), weights, credible_values.credible_efforts(ROUND), credible_values.credible_efforts(WEAK)],
        "arms of others": [credible_values.placeholder_limits(r, with_limits(r, effort=[150.0, 150, 150, 28, 28, 28, 10, 10])) for r in (ARM.with_gravity([0, 0, -2.0]), ARM.with_gravity([0, 0, -0.2]), ARM.with_gravity([0, 0, 0]))],
        "without gravity": short(credible_values.credible_limits(with_limits(effort=[1.0, 1, 1, 1]), CRANE.with_gravity([0, 0, 0]))),
        "own": doubted(),
        "degrees": doubted(lower=[-0.75, -145, -inf, -100], upper=[1.5, 70, inf, 165]),
        "degrees with a unit": [short(credible_values.credible_limits(with_units(kind), CRANE)) for kind in ("", "lower", "upper", "velocity", "effort")],
        "degrees, quarter turns": doubted(lower=[-0.75, -90, -inf, -90], upper=[1.5, 90, inf, 90]),
        "degrees, equal": doubted(lower=[-0.75, -100, -inf, -100], upper=[1.5, 100, inf, 100]),
        "degrees, not whole": doubted(lower=[-0.75, -145.5, -inf, -100], upper=[1.5, 70, inf, 165]),
        "degrees of one": doubted(lower=[-0.75, -145, -inf, -1], upper=[1.5, 70, inf, 1]),
        "degrees of one, near": [doubted(lower=[-0.75, -x, -inf, -1.75], upper=[1.5, 1.0, inf, 2.875]) for x in (12.0, 13.0)],
        "more than degrees": doubted(lower=[-0.75, -450, -inf, -410], upper=[1.5, 70, inf, 165]),
        "degrees a second": [doubted(velocity=[0.8, x, y, 4.3]) for x, y in ((126, 177), (19.5, 19.0), (21, 20.5), (126, 3.1), (2e4, 3e4))],
        "degrees and fast": doubted(lower=[-0.75, -145.5, -inf, -100.5], upper=[1.5, 70, inf, 165.5], velocity=[0.8, 61, 3.1, 4.3]),
        "efforts by a factor": [doubted(effort=np.array([900.0, 140, 45, 18]) * f) for f in (9.4, 9.6, 100, 1 / 9.81, 1 / 57.3, 30, 1000, 0.2)],
        "efforts by factors": [doubted(effort=np.array([900.0, 140, 45, 18]) * np.array([100, 100, 100, x])) for x in (108, 112)],
        "efforts of two": doubted(effort=[90, 14, 45, 18]),
        "weight": [doubted(effort=[900, weights[1] / x, 45, 18]) for x in (2.95, 3.05)],
        "placeholders": [doubted(effort=e) for e in ([1000, 1000, 45, 18], [1300, 1000, 999, 18], [1000, 999, 1000, 18], [2000, 140, 45, 1500])],
        "arm": [doubted(ARM), doubted(ARM, effort=[330.0, 330, 150, 54, 54, 54, 10, 10]), doubted(ARM, effort=[900.0] * 8), doubted(ARM, effort=[300.0, 900, 800, 700, 600, 500, 40, 30]), doubted(ARM, effort=[*arm["effort"][:7], inf])],
        "driven": [credible_values.driven_entries(r.model) for r in (CRANE, RAFT, GEARED, ARM)],
        "arms": [credible_values.arm_entries(r.model) for r in (CRANE, RAFT, ARM, UNLIMITED, tw.robots.panda())],
        "protractor": [credible_values._are_protractor_angles(np.array(v, float)) for v in ([90, 90], [100, 100], [89, 80], [90, 80], [90.5, 80], [180, 180], [])],
        "geared": doubted(GEARED, effort=[1000, 1000, 1000, 1000]),
    }  # fmt: skip


@record
def loads_that_no_robot_carries():
    def doubted(mass, place, frame=None, reach=1.5, robot=CRANE):
        return outcome(lambda: short(credible_values.credible_load(mass, place, frame, robot, reach)))

    mass = CRANE.model.moving_mass
    return {
        "far": [doubted(2.0, (0.9, -1.0, x)) for x in (0.65, 0.68)]
        + [
            doubted(None, (2, 0, 0), "jib"),
            doubted(0.0, (2, 0, 0)),
            doubted(2.0, (2, 0, 0), reach=0.0),
            doubted(2.0, (2, 0, 0), reach=math.inf),
        ],
        "base": [
            doubted(2.0, (0, 0, 0), "ground"),
            doubted(0.0, (0, 0, 0), "ground"),
            doubted(None, (0, 0, 0), "ground"),
        ],
        "heavy": [doubted(x * mass, (0.1, 0, 0)) for x in (99, 101)],
        "no tip": doubted(5.0, (0.1, 0, 0), robot=RAFT),
    }


class Peak:
    def __init__(self, peak, uncertainty, unit):
        self.peak, self.uncertainty, self.unit = peak, uncertainty, unit


QUADRUPED = loaded(tw.robots.path_of("quadruped"))
LOOPED = loaded("""<mujoco model="loops"><worldbody><body name="a" pos="0 0 1"><joint name="ja" axis="0 1 0"/><geom type="box" size=".1 .2 .3" mass="1"/>
<body name="b" pos="1 0 0"><joint name="jb" axis="0 1 0"/><geom type="box" size=".1 .2 .3" mass="2"/></body></body>
<body name="c" pos="1 0 0"><joint name="jc" axis="0 1 0"/><geom type="box" size=".1 .2 .3" mass="3"/><body name="d" pos="0 0 .5"><joint name="jd" axis="0 1 0"/><geom type="box" size=".1 .2 .3" mass="4"/></body></body></worldbody>
<equality><connect name="pin" body1="b" body2="c" anchor="0 0 0"/><connect name="rod" body1="a" body2="c" anchor="0.1 0 0"/></equality></mujoco>""")


@record
def doubts_about_models():
    floating = loaded(
        '<robot name="float"><link name="hull"><inertial><origin xyz="0.1 0.2 -0.05"/><mass value="8.5"/><inertia ixx="0.5" iyy="0.7" izz="0.9" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        + link("mast", 1.4, "0.05 -0.1 0.4", (0.09, 0.08, 0.02, 0.003, 0.001, -0.002)) + '<link name="flag"><visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual></link><link name="bare"/><link name="top"/>'
        + joint("j", "revolute", "hull", "mast", "0.2 0.1 0.5", "0.3 1 0.2", '<limit lower="-1" upper="1" velocity="200" effort="60"/><dynamics damping="0.5"/>')
        + '<joint name="f" type="fixed"><parent link="mast"/><child link="flag"/><origin xyz="0 0 0.7"/></joint><joint name="g" type="fixed"><parent link="mast"/><child link="top"/><origin xyz="0.2 0 0.9"/></joint>'
        + joint("k", "continuous", "mast", "bare", "0 0 1", "1 0 0") + "</robot>", floating_base=True, inertia="accept", tip="top",
    )  # fmt: skip
    names = floating.model.velocity_names

    def peaks(force, sigma=0.0, moment=1e5):
        return [
            Peak(moment if k < 3 else (force if k == 4 else 0.005), sigma, "N m" if k < 3 else "N")
            for k in range(len(names))
        ]

    weight = floating.model.moving_mass * 9.81
    weak = floating.with_gravity([0, 0, -0.1])
    loads = [Payload(2.0), Payload(1.25, frame="mast"), Payload(0.5)]
    jerk = replace(floating.limits, jerk=np.full(len(names), 5.0), acceleration=np.full(len(names), 7.0))
    return {
        "base": [model_doubts.base_velocities(r.model) for r in (floating, CRANE, RAFT)],
        "forces": [model_doubts.missing_force(floating.model, peaks(share * weight, s)) for share, s in ((0.049, 0), (-0.051, 0), (0.06, 0.02 * weight / 10), (0.06, 0.03 * weight / 10))],
        "weak gravity": [model_doubts.missing_force(weak.model, peaks(share * weight)) for share in (0.0009, 0.0011)],
        "words": [model_doubts.force_in_words(m.model, 12.34) for m in (floating, floating.with_gravity([0, 0, 0]))] + [model_doubts.force_remark(floating.model, peaks(0.5 * weight)), model_doubts.force_remark(floating.model, peaks(0.01 * weight))],
        "warnings": [model_doubts.model_warnings(floating.model), model_doubts.model_warnings(floating.model, peaks(0.5 * weight)), model_doubts.model_warnings(CRANE.model, [Peak(1, 0, "N")] * 4)],
        "assumptions": [model_doubts.assumptions(m, p, friction=f, unjudged=u, mass=s) for m, p, f, u, s in ((floating.model, loads, True, None, None), (floating.model, loads, False, jerk, "5 to 6"), (CRANE.model, [Payload(3.0)], False, CRANE.limits, None), (CRANE.lock({"spin": 0.1, "a_tilt": 0.2}).model, [], True, None, None), (ARM.model, [], False, ARM.limits, None))],
        "assumed": [model_doubts.assumed_words(c) for c in ([], ["one"], ["one", "two", "three"])],
        "massless": model_doubts.model_warnings(loaded('<robot name="m"><link name="a"/>' + "".join(f'<link name="m{k}"/>' + joint(f"j{k}", "continuous", "a", f"m{k}", "0 0 1", "0 1 0") for k in range(6)) + "</robot>", inertia="accept").model),
        "friction": [model_doubts.friction_words(m, counted=c) for m in (CRANE.model, ARM.model) for c in (True, False)],
        "legged": [model_doubts.base_doubts(CRANE.model), model_doubts.hanging_excess("x 5"), model_doubts.open_loop_excess("x 6")],
        "loops": [[model_doubts.open_loop_joints(m.model), model_doubts.model_warnings(m.model)] for m in (CRANE, LOOPED)],
        "on legs": [[str(r), r.remedy] for remedy in ("hanging", "hanging, feet", "hangs, payload") for r in model_doubts.base_doubts(QUADRUPED.model, remedy)],
        "on legs in the shell": in_the_shell(lambda: [str(r) for r in model_doubts.base_doubts(QUADRUPED.model)]),
        "shell": in_the_shell(lambda: model_doubts.assumptions(floating.model, loads)),
    }  # fmt: skip


@record
def conventions_of_programs():
    header = ("time", "J1", "J2", "J3", "J4", "J5", "J6", "thumb", "pinky")
    table = np.arange(45.0).reshape(5, 9) / 50

    def fanuc(robot, cells=header):
        return short(
            fanuc_doubts(
                ArrayFile.from_table(Path("f.csv"), cells, table, 9), robot.model, Coordinates.from_model(robot.model)
            )
        )

    def dataset(
        unit,
        names=(
            "observation.state.zslide.pos",
            "observation.state.boom_joint.pos",
            "observation.state.spin.pos",
            "observation.state.a_tilt.pos",
        ),
        degrees=False,
        factor=1.0,
        **options,
    ):
        def read():
            file = replace(
                ArrayFile.from_table(
                    Path("e.parquet"), ("timestamp", *names), factor * np.c_[np.arange(5.0), table[:, 1:5]], 9
                ),
                dataset=unit,
            )
            log = MotionLog.open(file, CRANE.model, degrees=degrees, **options)
            return short(log.of_source), log.columns.angle, log.degrees

        return outcome(read)

    so = {"boom_joint": "s.shoulder_lift.pos", "spin": "s.gripper.pos", "a_tilt": "s.x.pos", "zslide": "s.y.pos"}
    named = [so[n] for n in ("zslide", "boom_joint", "spin", "a_tilt")]
    return {
        "fanuc": [fanuc(ARM), fanuc(ARM, header[:6]), fanuc(CRANE)] + [bool(fanuc(tw.load(text))) for text in renamed("fanuc", "m_10i", "LR Mate 200", "r2000", "am10")],
        "units": [dataset(u) for u in ("", "degrees", "radians", "range", "unknown")],
        "stated": [dataset("unknown", degrees=True), dataset("unknown", factor=9.0), dataset("radians", factor=9.0)],
        "in its header": dataset("unknown", ("zslide", "boom_joint [deg]", "spin [rad]", "a_tilt [deg]")),
        "motors": [dataset("unknown", named, columns=so), dataset("unknown", named, columns=so, degrees=True), dataset("degrees", named, columns=so)],
        "none": dataset_doubts(ArrayFile.from_table(Path("f.csv"), header, table, 9), MotionLog.open(ArrayFile.from_table(Path("f.csv"), header, table, 9), ARM.model).columns, Coordinates.from_model(ARM.model), degrees=False),
    }  # fmt: skip


def renamed(*names):
    """Robots of three joints with these names."""
    for name in names:
        yield f'<robot name="{name}"><link name="floor"/>' + "".join(
            link(f"l{k}", 2.0, "0.1 0 0.2", (0.1, 0.1, 0.1, 0, 0, 0)) + joint(f"q{k}", "continuous", "floor" if k == 0 else f"l{k - 1}", f"l{k}", "0 0 1", "0 1 0") for k in range(3)
        ) + "</robot>"  # fmt: skip


@record
def doubts_about_arrays():
    """Motions made of arrays: only quick checks when they are made, all checks when they are asked."""

    def made(t, q, **arrays):
        motion = tw.Motion(t, q, robot=CRANE, **arrays)
        return {
            "notes": motion.notes,
            "doubts": short(motion.doubts),
            "contradictions": len(motion.contradictions),
            "instants": len(motion.instants),
            "shown": repr(motion),
        }

    t20 = np.arange(20) * 50.0
    with pytest.warns(tw.ModelWarning):
        slow = made(t20, 0.1 * S[:20])
    with pytest.warns(tw.ModelWarning):
        rates = made(T, S, dq=2 * D)
    return {
        "milliseconds": slow, "rates": rates, "in seconds": made(t20, 0.1 * S[:20], in_seconds=True), "clean": made(T, S, dq=D, ddq=A, tau=TAU),
        "glitch": made(T, changed(S, 30, 2, S[30, 2] + 0.2)), "fast step": made(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.9), tau=TAU), "late stamp": made(changed(T[:, None], 30, 0, T[30] + 0.03)[:, 0], S), "fast step of a plan": made(T, changed(S, slice(30, 60), 2, S[30:, 2] + 0.9), plan=True), "degrees": made(T, np.c_[S[:, 0], np.degrees(S[:, 1:])]),
    }  # fmt: skip


@record
def portions_of_a_log_are_counted_once():
    q = changed(S, 33, 2, S[33, 2] + 0.3)
    q[:, 3] = np.mod(np.linspace(-1.5, 3.9, 60) + math.pi, math.tau) - math.pi
    found = {}
    for first in (60, 20, 31):
        c = Contradictions(Coordinates.from_model(CRANE.model), time_stated=False, may_count_rows=True)
        for begin in range(0, 60, first):
            before = min(begin, contradictions.OVERLAP)
            c.add(10 * np.arange(60.0)[begin - before : begin + first], q[begin - before : begin + first], before)
        found[str(first)] = [short(c.doubts(CRANE.limits)), c._unwrapped_range, c._wrap_counts, c._step_count]
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
