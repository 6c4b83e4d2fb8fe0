"""Servos and exciting motions of an arm in which nothing is equal: replays, fits, doubts, searches and reports, on record."""

from __future__ import annotations

import functools
import importlib
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from leaning_arm import packed, short_arm, states_at
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.doubts import doubt, verdict_from_doubts
from twistwrench.core.estimation.cross_validation import HeldOut
from twistwrench.identification.excitation import motion_information, trajectory_constraints, trajectory_search
from twistwrench.identification.excitation.fourier_series import WindowedFourierSeries
from twistwrench.identification.excitation.motion_information import MotionInformation
from twistwrench.identification.excitation.trajectory_constraints import (
    TrajectoryConstraints,
    half_and_middle,
    shared_bounds,
)
from twistwrench.identification.excitation.trajectory_search import LimitBarrier, MotionSearch, typical_sizes
from twistwrench.identification.parameters import BaseParameters, UnknownParameters
from twistwrench.identification.servos import linear_start, output_error, result_view, servo_doubts
from twistwrench.identification.servos.output_error import OutputErrorFit, OutputErrorProblem
from twistwrench.identification.servos.replay import LAWS, ServoLog, ServoReplay, _hermite, servo_unit
from twistwrench.identification.servos.result import IdentifiedServos
from twistwrench.identification.views import exciting_motion
from twistwrench.shapes.capsules import CapsuleDistances, LinkCapsules

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
stub = SimpleNamespace
servos = importlib.import_module(
    "twistwrench.identification.servos.identify_servos"
)  # the package has a function of this name
exciting = importlib.import_module("twistwrench.identification.exciting_trajectory")


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


@functools.cache
def robot():
    return short_arm()


@functools.cache
def pair():
    """Two joints, of which one slides."""
    return short_arm().lock({"elbow": 0.4})


P = np.append(np.log([[0.5, 4.0, 0.6, 120.0], [2.5, 30.0, 5.0, 900.0]]).ravel(), 0.017)
"""Unknowns of two servos: armature, damping, Coulomb friction, kp; and the delay."""


def log_with(seconds=2.4, rate=60.0, count=2, seed=0):
    """A log whose positions follow commands late, with a ripple."""
    time = 3.0 + np.arange(round(seconds * rate)) / rate
    c, _, _ = states_at(time)
    late, _, _ = states_at(time - 0.03)
    ripple = 0.003 * np.sin(np.outer(time, [31.0, 43.0, 37.0]) + seed)
    return ServoLog.from_arrays(time, (0.97 * late + ripple)[:, :count], c[:, :count])


def near_replay(self, log, p):
    """Positions in closed form, near those of servos, in place of a rollout: smooth in all unknowns, and cheap."""
    found = []
    for own, share in zip(p, np.zeros((len(p), 1)) if self.share is None else self.share, strict=True):
        armature, damping, coulomb, kp = np.exp(own[:-1].reshape(-1, 4)).T
        c = log.mean_command(log.time - own[-1], 0.02, self.hold)
        speed = np.gradient(c, log.time, axis=0)
        friction = (
            coulomb * np.tanh(speed / 0.1) * (1.0 + share * np.exp(-((speed / (LAWS.get(self.law) or 1.0)) ** 2)))
        )
        load = 2.0 * np.sin(3.0 * log.time)[:, None] * np.arange(1, len(kp) + 1)
        found.append(
            c
            - (damping * speed + armature * np.gradient(speed, log.time, axis=0) + friction + load) / kp
            + 1e-3 * self.step
        )
    return np.array(found)


def with_near_replay(call):
    @functools.wraps(call)
    def wrapped():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ServoReplay, "_positions_of", near_replay)
            return call()

    return wrapped


# ── Servos: logs and replays


@records.of
def logs_of_servos_and_means_of_commands():
    log = log_with()
    found = {
        "log": [packed(log.time), log.begin_velocity, log.period],
        "slow": log_with(2.0, 9.0).begin_velocity,
        "fast": log_with(0.5, 200.0).begin_velocity,
    }
    begin = np.array([-0.05, 0.0, 0.011, 0.4, 1.2, 2.39, 2.6])
    for hold in ("zero", "linear"):
        for width in (0.004, 0.05):
            found[f"{hold} {width}"] = log.mean_command(begin, width, hold)
    q, dq = drawn(2, 4, 2, seed=1), drawn(2, 4, 2, seed=2)
    found["cubics"] = _hermite(q, dq, np.array([0.0, 0.13, 0.2, 0.45, 0.6]), 0.2)
    found["units"] = [
        servo_unit(name, turning=turning)
        for name in ("armature", "damping", "coulomb", "kp")
        for turning in (True, False)
    ]
    return found


@records.of
def steps_of_replays():
    cases = {"plain": P, "stiff": P + np.r_[0, 0, 0, 9, 0, 0, 0, 0, 0], "damped": P + np.r_[0, 4, 0, 0, 0, 0, 0, 0, 0], "soft": P + np.r_[0, 0, 0, 0, 0, 0, 0, -9, 0],
             "light": P + np.r_[0, 0, 0, 0, -4, 0, 0, 0, 0]}  # fmt: skip
    found = {name: ServoReplay.step_of(p) for name, p in cases.items()}
    x = np.exp(np.stack([P, cases["damped"], cases["light"]])[:, :-1].reshape(3, 2, 4))
    for law in ("", "load", "stribeck", "presliding"):
        replay = ServoReplay(pair(), [log_with()], "zero", 4e-4, law)
        armature, damping = replay._stepped_values(x)
        found[f"values {law}"] = [armature, damping] if not law else None
        parameters = replay._parameters(armature, x[:, :, 2], 0.1 + np.arange(6).reshape(3, 2))
        found[f"parameters {law}"] = dict(parameters)
    return found


@records.of(relative=1e-5)
def replayed_positions():
    """Rollouts of a tenth of a second: a held and a straight command, other delays, and other laws of friction."""
    log = log_with(0.1, 100.0)
    p = np.stack([P, P + 0.1 * np.append(drawn(8, seed=3), 0.05)])
    found = {}
    for hold, law, step in (("zero", "", 4e-4), ("linear", "stribeck", 4e-4), ("zero", "load", 1.3e-3)):
        share = np.array([[0.1, 0.3], [0.2, 0.0]]) if law else None
        replay = ServoReplay(pair(), [log], hold, step, law, share)
        (positions,) = replay.positions(p)
        found[f"{hold} {law} {step}"] = [positions, positions[:, -1], replay.count]
    return found


# ── Servos: regression that starts a fit


@records.of(relative=1e-5)
def values_that_start_a_fit():
    logs = [log_with(4.0), log_with(2.4, 50.0, seed=1)]
    found = {}
    for hold in ("zero", "linear"):
        found[hold] = linear_start.linear_start(pair(), logs, hold)
    heavy = pair().with_armature({"waist": 0.7, "slide": 0.0})
    found["with armature"] = linear_start.linear_start(heavy, logs, "zero")
    rows = linear_start._Rows.from_log(pair(), logs[0])
    found["rows"] = [
        rows.cutoff,
        rows.columns,
        packed(rows.time),
        packed(rows.block),
        rows.error(0.02, "zero"),
        rows.error(0.05, "linear"),
    ]
    found["blocks"] = packed(linear_start._block_numbers([rows, linear_start._Rows.from_log(pair(), logs[1])]))
    found["scale"] = linear_start.scale_determining_torques(heavy, logs)
    found["cutoff"] = [linear_start._Rows.from_log(pair(), log_with(2.0, rate)).cutoff for rate in (40.0, 90.0)]
    return found


@records.of
def regressions_of_joints():
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(90, 4)) * [3.0, 0.3, 1.0, 5.0]
    x = np.array([0.004, 0.03, 0.005, 0.01])
    block = np.arange(90) // 15
    found = {}
    for name, noise, truth in (
        ("determined", 1e-4, x),
        ("hardly", 0.06, x),
        ("negative", 1e-3, x * [1, -1, 1, 1]),
        ("no scale", 1e-3, x * [1, 1, 1, 0]),
    ):
        fit = linear_start._JointFit.from_rows(columns, columns @ truth + noise * rng.normal(size=90), block)
        found[name] = [
            fit.x,
            len(fit.X),
            fit.residual,
            packed(fit.block),
            linear_start._drive_parameters(fit, 0.35),
            linear_start._log_square_residuals([fit, fit]),
        ]
    still = linear_start._JointFit.from_rows(columns * [1, 0.0, 1, 1], columns @ x, block)
    found["still"] = [still.x, linear_start._drive_parameters(still, 0.35), linear_start._log_square_residuals([still])]
    return found


# ── Servos: fit


def problem_of(logs=None, free=None, hold="zero"):
    logs = [log_with(), log_with(1.5, 50.0, seed=1)] if logs is None else logs
    replay = ServoReplay(pair(), logs, hold, 4e-4)
    return OutputErrorProblem.from_logs(replay, P, np.ones(9, bool) if free is None else free)


@records.of(relative=1e-5)
@with_near_replay
def equations_of_servo_fits():
    found = {}
    some = np.array([1, 1, 1, 0, 1, 0, 1, 1, 1], bool)
    for name, free in (("all", None), ("some", some)):
        problem = problem_of(free=free)
        p = P + 0.05 * np.append(drawn(8, seed=5), 0.1)
        r, J = problem.linearise(p)
        H, g, s2 = problem.normal_equations(p, r, J)
        trial = problem._best_trial(p, H, g, s2, float(problem.cost(p[None], r[None], s2)[0]))
        found[name] = {
            "sigma": problem.sigma, "used": [[rows[0], rows[-1], len(rows)] for rows in problem.used], "r": packed(r), "J": J, "directions": problem.directions,
            "precision": problem.precision, "H": packed(H), "g": packed(g), "s2": s2, "trial": trial, "scores": packed(problem._block_scores(r, J)),
            "cost": problem.cost(np.stack([p, P]), np.stack([r, 2 * r]), s2),
        }  # fmt: skip
    found["none"] = problem._best_trial(p, H, g, s2, -1.0)
    late = OutputErrorProblem.from_logs(
        ServoReplay(pair(), [log_with(6.0)], "zero", 4e-4), P, np.ones(9, bool), until=0.5
    )
    found["until"] = [late.used[0][0], late.used[0][-1]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(output_error, "_MAX_RESIDUALS", 200)
        found["stride"] = [[rows[0], rows[-1], len(rows)] for rows in problem_of().used]
    return found


@records.of(relative=1e-4)
@with_near_replay
def fits_of_servos():
    problem = problem_of()
    fit = problem.solve(P)
    r, J = problem.linearise(fit.p)
    found = {
        "fit": [fit.p, fit.covariance, fit.freedom, fit.cost, fit.steps, fit.sigma, packed(*fit.residuals)],
        "hopeless": problem.solve(P, hopeless=0.0).steps,
    }
    found["laws"] = {law: problem.law_change(fit, law, r, J) for law in LAWS}
    found["scales"] = problem.scale_changes(fit, J, np.array([0.2, 0.5]))
    fixed = problem_of(free=np.array([1, 1, 1, 0, 1, 1, 1, 1, 0], bool))
    r, J = fixed.linearise(P)
    found["fixed scales"] = fixed.scale_changes(fit, J, np.array([0.4, 0.29]))
    found["step"] = problem.change(fit, replace(fit.replay, step=2e-4))
    found["evidence"] = [fit.evidence(3.0, 2.0), fit.evidence(3.0, 2.0, 4), fit.evidence(2.0, 3.0)]
    found["widths"] = [fit.half_width(np.eye(9)[k], level) for k in (0, 5, 8) for level in (0.95, 0.5)]
    wider = output_error.with_model_changes(fit, [np.arange(9.0), 0.1 * np.ones(9)])
    found["wider"] = packed(wider.covariance - fit.covariance)
    found["probability"] = [output_error.probability(evidence) for evidence in (-600.0, -1.0, 0.0, 2.0, 600.0)]
    coarse = replace(log_with(), q=np.round(log_with().q / 0.01) * 0.01)
    found["errors"] = [
        output_error.position_errors([log_with(), log_with(1.5)]),
        output_error.position_errors([coarse]),
        output_error.position_errors([replace(coarse, q=0 * coarse.q)]),
    ]
    return found


@records.of(relative=1e-4)
@with_near_replay
def identified_servos_of_two_joints():
    def motion(log, of=None):
        return tw.Motion(log.time, log.q, robot=of or pair(), in_seconds=True, command=log.command)

    found = {}
    first, second = motion(log_with(6.5)), motion(log_with(3.0, 50.0, seed=1))
    cases = {
        "auto": ([first], {}),
        "linear": ([first, second], {"hold": "linear", "known": {"slide.kp": 950.0, "waist.coulomb": 0.5}}),
        "test": (first, {"hold": "zero", "test": second}),
    }
    for name, (logs, options) in cases.items():
        answer = servos.identify_servos(pair(), logs, **options)
        data = answer.to_dict()
        found[name] = {
            "text": str(answer).splitlines(), "verdict": str(answer.verdict), "facts": dict(answer.facts()), "brief": answer.brief,
            **{key: data[key] for key in ("servos", "delay", "held_out", "position_error")}, "doubts": [[d.kind, d.level, d.sentence] for d in answer.doubts],
            "hold": answer.fit.replay.hold, "sizes": answer.sizes, "live": answer.live, "whole": answer.whole, "ratios": answer.only_ratios,
            "shares": answer.torque_shares, "torques": answer.rms_torques, "wide": dict(answer.relative(0.5)),
        }  # fmt: skip
    return found


@records.of
def parts_of_servo_calls():
    logs = [
        stub(time=np.linspace(0, end, 50), q=np.zeros((50, 2)), command=np.zeros((50, 2)))
        for end in (100.0, 20.0, 30.0, 80.0)
    ]
    real = [ServoLog(log.time, log.q, log.command, np.zeros(2)) for log in logs]
    found = {
        "first": [[len(log.time), float(log.time[-1])] for log in servos._first_rows(real)],
        "all": [len(log.time) for log in servos._first_rows(real[1:3])],
    }
    found["known"] = servos._known_logarithms(pair(), {"slide.kp": 20.0, "waist.armature": 0.1})
    found["unknown"] = [
        refusal(lambda k=k: servos._known_logarithms(pair(), k)) for k in ({"slide.kv": 2.0}, {"slide.kp": -1.0})
    ]
    found["sizes"] = servos._typical_sizes([log_with(), log_with(1.0)])
    log = log_with(1.0)
    still = tw.Motion(log.time, log.command, robot=pair(), in_seconds=True, command=log.command)
    lacking = log.command.copy()
    lacking[:, 1] = np.nan
    cases = {
        "no commands": tw.Motion(log.time, log.q, robot=pair(), in_seconds=True), "same": still, "short": tw.Motion(log.time[:11], log.q[:11], robot=pair(), in_seconds=True, command=log.command[:11]),
        "lacking": tw.Motion(log.time, log.q, robot=pair(), in_seconds=True, command=lacking), "robot": tw.Motion(log.time, log.q, robot=tw.robots.planar_2r(), in_seconds=True, command=log.command),
    }  # fmt: skip
    found["refused"] = {
        name: refusal(lambda motion=motion: servos.servo_logs(pair(), motion, "logs")) for name, motion in cases.items()
    }
    found["hold"] = refusal(lambda: servos.identify_servos(pair(), [], hold="cubic"))
    found["none"] = refusal(lambda: servos.identify_servos(pair(), []))
    simulated = servos.simulated_servo_log(
        pair(),
        armature=[0.5, 2.5],
        damping=[4.0, 30.0],
        coulomb=0.6,
        kp=[120.0, 900.0],
        delay=0.02,
        seconds=0.1,
        rate=80.0,
        bits=14,
        seed=2,
    )
    found["simulated"] = [simulated.time, simulated.q, simulated.command]
    return found


# ── Servos: results


def servos_found(
    widths, delay_width=1e-3, live=(True, True), sizes=((3.0, 0.4, 1.0), (2.0, 0.1, 1.0)), tracking=0.05, **fields
):
    """Result whose logarithms have the given half widths (2, 4), independent of one another."""
    from twistwrench.core.estimation.covariance import student_quantile

    quantile = student_quantile(9.0, 0.95)
    half_widths = np.append(np.ravel(widths), delay_width)
    logs = [log_with()]
    residuals = [np.full((len(logs[0].time), 2), 0.001)]
    fit = OutputErrorFit(
        ServoReplay(pair(), logs, "zero", 4e-4),
        P,
        np.diag((half_widths / quantile) ** 2),
        9.0,
        residuals,
        np.array([1e-3, 2e-3]),
        5.0,
        3,
    )
    count = len(logs[0].time)
    names = pair().model.velocity_names
    shares = fields.pop("held_out", (0.05, 0.06)), fields.pop("trained", (0.04, 0.045))
    held_out, trained = (
        HeldOut("last fifth", count * (np.array(s) * tracking) ** 2, np.full(2, count * tracking**2), names)
        for s in shares
    )
    return IdentifiedServos(
        pair(), fit, held_out, trained, np.array(sizes), np.array(live), fields.pop("known", {}), **fields
    )


NARROW, WIDE = np.full((2, 4), 0.05), np.full((2, 4), 0.4)


@records.of
def results_of_servos():
    cases = {
        "narrow": servos_found(NARROW), "limit": servos_found([[0.099, 0.101, 0.3, 0.099], [0.101, 0.05, 0.05, 0.05]]), "wide": servos_found(WIDE), "still": servos_found(NARROW, live=(True, False)),
        "unknown": servos_found(WIDE * 20, delay_width=0.03), "friction": servos_found([[0.05, 0.9, 2.0, 0.05], [0.05, 0.3, 0.5, 0.05]]), "no torque": servos_found(NARROW, tracking=0.0),
    }  # fmt: skip
    correlated = servos_found(WIDE)
    C = correlated.fit.covariance.copy()
    for j in range(2):
        block = slice(4 * j, 4 * j + 4)
        C[block, block] = 0.04 + 0.0001 * np.diag([1.0, 2.0, 3.0, 4.0])
    cases["ratios"] = replace(correlated, fit=replace(correlated.fit, covariance=C))
    found = {}
    for name, case in cases.items():
        found[name] = {
            "text": str(case).splitlines(), "facts": dict(case.facts()), "determined": case.determined, "whole": case.whole, "only ratios": case.only_ratios,
            "shares": case.torque_shares, "relative": packed(*case.relative().values()), "interval": packed(*case.interval().values()), "ratio": packed(*case.ratio_interval(0.5).values()),
            "delay": [case.delay, case.delay_half_width], "torques": case.rms_torques, "accuracy": result_view._accuracy(case) if case.whole.any() else "", "error": case.position_error,
        }  # fmt: skip
    arm = cases["narrow"].robot
    return found | {
        "robot": [arm.armature, arm.model.friction.coulomb],
        "widths": [result_view.relative_width(w) for w in (0.0, 0.05, 2.3, 2.31)],
    }


@records.of
def doubts_about_servos():
    cases = {
        "fine": servos_found(NARROW), "still": servos_found(NARROW, live=(True, False)), "large": servos_found(NARROW, held_out=(0.1, 0.21), trained=(0.1, 0.2)),
        "refused": servos_found(NARROW, held_out=(0.61, 0.3), trained=(0.1, 0.2)), "unsure": servos_found(NARROW, held_out=(0.59, 0.3), trained=(0.1, 0.2)), "small error": servos_found(NARROW, held_out=(0.3, 0.3), trained=(0.01, 0.01)),
        "drifts": servos_found(NARROW, held_out=(0.16, 0.16), trained=(0.1, 0.1)), "hardly": servos_found(NARROW, held_out=(0.149, 0.149), trained=(0.1, 0.1)), "little": servos_found(NARROW, held_out=(0.099, 0.099), trained=(0.01, 0.01)),
        "no scale": servos_found(WIDE), "known": servos_found(WIDE, known={"slide.kp": 3.0}), "one wide": servos_found([[0.05] * 4, [0.05, 0.4, 0.05, 0.5]]),
    }  # fmt: skip
    long, short = [log_with(5.1)], [log_with(4.9)]
    few = [ServoLog(np.linspace(0, 6, 79), np.zeros((79, 2)), np.zeros((79, 2)), np.zeros(2))]
    enough = [ServoLog(np.linspace(0, 6, 80), np.zeros((80, 2)), np.zeros((80, 2)), np.zeros(2))]
    found = {
        name: [[d.kind, d.level, d.joints, d.value, d.sentence] for d in servo_doubts.fit_doubts(case, long)]
        for name, case in cases.items()
    }
    found["logs"] = [
        [d.kind for d in servo_doubts.fit_doubts(cases["fine"], logs)]
        for logs in (short, few, enough, [log_with(2.6), log_with(2.6)])
    ]
    return found


@records.of
def doubts_about_commands():
    log = log_with(5.0)
    c = log.command

    def said(command, q=None):
        logs = [replace(log, command=command, q=log.q if q is None else q)]
        return [[d.kind, d.joints, d.value, d.sentence] for d in servo_doubts.command_doubts(pair(), logs)]

    mixed = 0.55 * c[:, ::-1] / c.std(axis=0)[::-1] + 0.4 * c / c.std(axis=0)
    still = log.q * [1.0, 0.0]
    correlations, slopes = servo_doubts._correlations_and_slopes([log, log_with(2.0, seed=1)])
    return {
        "fine": said(c), "exchanged": said(c[:, ::-1]), "sign": said(c * [1, -1]), "degrees": said(np.degrees(c)), "still": said(c[:, ::-1], still), "mixed": said(mixed),
        "slopes": [said(c * factor) for factor in (0.395, 0.41, 2.35, 2.55)], "noise": said(drawn(*c.shape, seed=6)),
        "correlations": [correlations, slopes], "moving": [servo_doubts.moving_joints([replace(log, q=q)]) for q in (log.q, still)],
    }  # fmt: skip


@records.of
def servos_in_files(folder):
    found = {}
    cases = {
        "all": (servos_found(NARROW), {}),
        "one": (servos_found([[0.05] * 4, [0.5] * 4]), {}),
        "forced": (servos_found(WIDE), {"force": True}),
    }
    for name, (case, options) in cases.items():
        notes = case.write(folder / f"{name}.xml", folder / f"{name}.yaml", **options)
        text = re.sub(r"version \S+, \S+,", "VERSION,", (folder / f"{name}.xml").read_text())
        back = tw.load(folder / f"{name}.xml")
        lines = [
            line.strip()
            for line in text.splitlines()
            if "<position" in line or "<!--" in line or "solreffriction" in line
        ]
        found[name] = [
            notes,
            lines,
            back.armature,
            back.model.friction.coulomb,
            (folder / f"{name}.yaml").read_text().splitlines(),
        ]
    refused = verdict_from_doubts([doubt("servo-sign", ["waist"], level="refuse")])
    bad = replace(servos_found(NARROW), doubts=(doubt("servo-sign", ["waist"], level="refuse"),))
    found["refused"] = [
        refusal(lambda: bad.write(folder / "a.xml")),
        refusal(lambda: servos_found(WIDE).write(folder / "a.xml")),
        refusal(lambda: servos_found(NARROW).write(folder / "a.urdf")),
    ]
    return found | {"word": str(refused.word), "written": sorted(path.name for path in folder.iterdir())}


# ── Exciting motions


@functools.cache
def series():
    return WindowedFourierSeries(3.0, 2)


@functools.cache
def information(criterion="log_det", friction=("viscous", "coulomb", "stribeck", "offset")):
    unknown = UnknownParameters(robot(), True, friction, stribeck_speed=0.3)
    base = BaseParameters.from_unknowns(unknown)
    prior = base.weak_sizes(
        unknown.scales(np.array([20.0, 50.0, 5.0]), np.array([1.0, 0.3, 1.2]), np.array([6.0, 2.0, 8.0]))
    )
    return MotionInformation(base, np.array([0.9, 2.0, 0.4]), np.array([0.05, 0.07, 0.09]), 3.0, prior, criterion)


@records.of
def windowed_fourier_series():
    t = np.array([-1.0, 0.0, 1e-6, 0.4, 1.5, 2.2, 2.999, 3.0, 4.0])
    return [
        series().basis(t),
        series().basis(t)[:, 3],
        series().basis(t)[:, 5],
        series().count,
        WindowedFourierSeries(7.0, 3).basis(np.array([1.0, 5.0])),
    ]


@records.of(relative=1e-6)
def information_of_motions():
    q, dq, ddq = states_at(np.linspace(0.3, 3.2, 30))
    found = {}
    for criterion in motion_information.CRITERIA:
        for friction in (("viscous", "coulomb", "stribeck", "offset"), ("coulomb",)):
            m = information(criterion, friction)
            W = m.rows(q, dq, ddq)
            merit, slope = m.merit_and_slope(W)
            weights = 1e-3 * drawn(*W.shape, seed=7)
            found[f"{criterion} {friction}"] = [
                m.log_det(W),
                merit,
                slope,
                packed(m.deviations(W)),
                m.condition(W),
                m.slopes(np.stack([q, dq, ddq]), weights),
            ]
    values = np.array([0.3, 2.0, -1.0, 1.7, 0.2])
    return found | {
        "maximum": motion_information._smooth_maximum(values),
        "median": motion_information._smooth_median(values),
    }


def bounds_with(**options):
    limits = robot().limits
    return replace(limits, acceleration=np.array([5.0, 3.0, 9.0]), deceleration=np.array([6.0, 2.5, 9.5]), **options)


@records.of
def shared_limits_and_typical_sizes():
    endless = bounds_with(upper=np.array([np.inf, 0.25, 2.4]), lower=np.array([-np.inf, -0.45, -1.9]))
    beyond = bounds_with(upper=np.array([np.inf, np.inf, -0.5]), lower=np.array([0.7, -np.inf, -1.9]))
    found = {}
    for name, bounds in (("plain", bounds_with()), ("endless", endless), ("beyond", beyond)):
        shared = shared_bounds(bounds, 0.8)
        sizes, middle = typical_sizes(robot(), bounds, series())
        found[name] = [
            shared.lower,
            shared.upper,
            shared.velocity,
            shared.effort,
            shared.acceleration,
            shared.deceleration,
            half_and_middle(bounds),
            sizes,
            middle,
        ]
    return found


def clear_of_a_wall(q):
    """Distances from two things that depend on all joints."""
    return np.stack([1.5 + 0.4 * np.sin(q @ [0.5, 1.0, -0.7]), 0.9 - 0.2 * q[:, 2] ** 2 + 0.1 * q[:, 0]], axis=1)


@functools.cache
def constraints(clear=False, friction=True):
    arm = robot()
    if friction:
        arm = arm.with_actuators({"actuators": {"waist": {"friction": {"viscous": "1.3 N m s/rad", "coulomb": "2 N m", "static": "2.6 N m", "stribeck": "0.1 rad/s", "load": "0.05"}},
                                                "slide": {"friction": {"viscous": "7 N s/m", "coulomb": "5 N"}}}})  # fmt: skip
    capsules = CapsuleDistances.from_capsules(arm, LinkCapsules.from_robot(arm), floor=-0.5, itself=True)
    return TrajectoryConstraints(
        arm,
        shared_bounds(bounds_with(), 0.9),
        np.array([0.05, 0.07, 0.09]),
        capsules,
        clear_of_a_wall if clear else None,
    )


@records.of(relative=1e-6)
def distances_from_constraints():
    found = {}
    states = np.stack(states_at(np.linspace(0.3, 2.4, 5)))
    for clear in (False, True):
        for friction in (False, True):
            c = constraints(clear, friction)
            for smooth in (False, True):
                shares, pullback = c.evaluate(states, smooth=smooth)
                slopes = pullback(0.1 + np.abs(drawn(*shares.shape, seed=8)))
                found[f"{clear} {friction} {smooth}"] = [shares, slopes[0], slopes[1], slopes[2], float(shares.min())]
            found[f"{clear} {friction}"] = [c.least(states), c._edges[0], packed(*c._edges[1:])]
    bad = [lambda q: "no", lambda q: np.zeros(3), lambda q: np.full(len(q), np.nan)]
    found["refused"] = [
        refusal(lambda f=f: replace(constraints(), clear=f)._user_distances(np.zeros((2, 3)))) for f in bad
    ]
    return found


@functools.cache
def search(criterion="log_det"):
    bounds = constraints().bounds
    typical, middle = typical_sizes(robot(), bounds, series())
    return MotionSearch(series(), information(criterion), constraints(), typical, middle)


def scaled(s, coefficients):
    """Scaled coefficients of a search, whose units have arbitrary signs, for given coefficients of the series."""
    shift = np.array(coefficients)
    shift[:, 0] -= s.middle
    return np.array([np.linalg.solve(units, own) for units, own in zip(s._units, shift, strict=True)])


COEFFICIENTS = np.array(
    [[0.1, 0.06, -0.03, 0.09, 0.05], [-0.08, 0.02, 0.011, -0.014, 0.006], [0.3, -0.11, 0.07, 0.04, -0.09]]
)


@records.of(relative=1e-6)
def searches_of_motions():
    found = {}
    s = search()
    z = scaled(s, COEFFICIENTS)
    found["coefficients"] = [s.coefficients(z), packed(s._states(z, 2)), s._check_refinement, s._basis(2).shape]
    products = [units.T @ units for units in s._units]
    found["units"] = [np.trace(product) for product in products] + [
        np.linalg.det(units @ units.T) for units in s._units
    ]
    barrier = LimitBarrier(np.full((1, 1), 0.3), 5.0)
    for criterion in motion_information.CRITERIA:
        own = search(criterion)
        cost, slope = own.cost_and_slope(z.ravel(), barrier)
        by_coefficients = [
            np.linalg.solve(units.T, part) for units, part in zip(own._units, slope.reshape(3, 5), strict=True)
        ]
        found[criterion] = [own.merit(z), cost, by_coefficients]
    shares, _ = s.constraints.evaluate(s._states(z), smooth=True)
    cost, forces = barrier.cost_and_forces(shares)
    uneven = LimitBarrier(np.abs(drawn(4, 2, seed=10)), 2.0, 0.01)
    refined = uneven.refine(3)
    found["barrier"] = [
        cost,
        forces,
        refined.multipliers,
        uneven.refine(1) is uneven,
        uneven.cost_and_forces(drawn(4, 2, seed=11)),
        refined.finer,
    ]
    motion = s.random(np.random.default_rng(12))
    found["random"] = s.constraints.least(s._states(motion))
    wide = s.coefficients(s.narrow_to_limits(scaled(s, COEFFICIENTS * [1, 9, 9, 9, 9]), 1))
    kept = s.coefficients(s.narrow_to_limits(z, 1))
    beyond = s.narrow_to_limits(scaled(s, COEFFICIENTS + np.array([9.0, 0, 0, 0, 0])), 1)
    found["narrow"] = [wide, kept, beyond]
    less = scaled(s, 0.5 * COEFFICIENTS)
    found["better"] = [
        s._better(None, z) is z,
        s._better(z, None) is z,
        s._better(z, less) is z,
        s._better(less, z) is z,
        s._better(None, None),
    ]
    return found


def motion_with(size=1.0, *, own=None, step=0.02, degrees=False):
    """Motion with given coefficients, without a search."""
    given = constraints() if own is None else own
    return exciting.ExcitingMotion(robot(), series(), size * COEFFICIENTS, given, information(), step, degrees=degrees)


@records.of(relative=1e-5)
def exciting_motions_and_their_reports(folder):
    found = {}
    bare = replace(
        constraints(),
        capsules=CapsuleDistances.from_capsules(robot(), LinkCapsules.from_robot(robot()), floor=None, itself=False),
    )
    low = replace(
        constraints(),
        capsules=CapsuleDistances.from_capsules(robot(), LinkCapsules.from_robot(robot()), floor=0.6, itself=True),
    )
    for name, motion in {
        "plain": motion_with(),
        "degrees": motion_with(2.5, degrees=True),
        "bare": motion_with(own=bare),
        "low": motion_with(own=low, step=0.9),
    }.items():
        states = motion(np.array([[0.5, 1.0], [2.9, 3.5]]))
        csv = motion.to_csv(folder / "a.csv").read_text().splitlines()
        found[name] = {
            "text": str(motion).splitlines(), "facts": dict(motion.facts()), "brief": motion.brief, "verdict": str(motion.verdict), "peaks": motion.peaks,
            "clearances": motion.clearances, "unwatched": motion.unwatched, "deviations": packed(motion.predicted_deviations), "shares": packed(motion.shares_of_prior), "worst": motion.worst,
            "condition": [motion.condition, motion.log_det], "states": states, "rows": [len(motion.motion), csv[0], csv[7]], "bounds": packed(motion.bounds.upper, motion.bounds.effort),
            "lines": ["".join(map(str, line.pieces)) for line in exciting_motion._information_lines(motion)], "groups": exciting_motion._group_table(motion).title,
        }  # fmt: skip
    found["degrees of the file"] = motion_with().to_csv(folder / "b.csv", degrees=True).read_text().splitlines()[3]
    found["of limits"] = exciting_motion._shares(np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, np.inf, 0.0, 8.0]))
    return found


@records.of
def reasons_of_exciting_motions():
    def blocks(reasons, clearances):
        case = stub(clearances=clearances, verdict=stub(word="UNSURE" if reasons else "OK", reasons=tuple(reasons)))
        listed = exciting_motion._verdict_blocks(case)
        return [
            b
            if isinstance(b, str)
            else [
                type(b).__name__,
                getattr(b, "sentence", getattr(b, "text", "")),
                list(map(str, getattr(b, "pieces", ()))),
                int(b.level),
            ]
            for b in listed
        ]

    near = {"itself": 0.0213, "floor": -0.004}
    return [
        blocks([], near),
        blocks([], {}),
        blocks([f"reason {k}" for k in range(7)], near),
        blocks(["one"], {}),
        blocks([f"reason {k}" for k in range(5)], {"floor": 0.5}),
    ]


@records.of
def limits_and_noise_of_searches():
    arm = robot()
    still = replace(arm.model, limits=replace(arm.limits, upper=arm.limits.lower + np.array([1.0, 0, 1])))
    endless = replace(
        arm.model, limits=replace(arm.limits, upper=np.array([np.inf, 1, 1]), velocity=np.array([np.inf, 1, 1]))
    )
    bounds = exciting._bounds(arm, 0.7, None, 4.0, [50.0, 60.0, 70.0])

    def call(**options):
        return refusal(lambda: exciting.exciting_trajectory(arm, **options))

    return {
        "bounds": [bounds.lower, bounds.upper, bounds.velocity, bounds.acceleration, bounds.effort],
        "share": [refusal(lambda share=share: exciting._bounds(arm, share, None, 4.0, None)) for share in (0.0, 1.01)],
        "still": refusal(lambda: exciting._bounds(tw.Robot(still), 0.7, None, 4.0, None)), "endless": refusal(lambda: exciting._bounds(tw.Robot(endless), 0.7, None, None, None)),
        "noise": [exciting._torque_noise(arm, noise) for noise in (None, 2.0, [1.0, 2.0, 3.0])], "no limit": exciting._torque_noise(tw.robots.pendulum(), None),
        "bad noise": [refusal(lambda noise=noise: exciting._torque_noise(arm, noise)) for noise in ([1.0, 2.0], -1.0, [1.0, 0.0, 2.0])],
        "calls": [call(harmonics=51), call(criterion="trace"), call(duration=2.0, step=0.11, acceleration=4.0), call(clear=3), call(friction=("wind",)), call(floor=float("inf"), acceleration=4.0), call(duration=-1.0)],
    }  # fmt: skip


@records.of(relative=1e-3)
def search_for_an_exciting_motion():
    shares = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trajectory_search, "_ROUNDS", ((5.0, 4, 1), (20.0, 3, 2)))
        patch.setattr(trajectory_search, "_LAST_ROUND", (1000.0, 3, 4))
        patch.setattr(trajectory_search, "_RANDOM_MOTIONS", 2)
        patch.setattr(trajectory_search, "_MIN_CHECK_REFINEMENT", 4)
        patch.setattr(trajectory_constraints, "MAX_CHECK_STEP", 0.05)
        patch.setattr(trajectory_search, "MAX_CHECK_STEP", 0.05)
        found = exciting.exciting_trajectory(
            robot(),
            3.0,
            1,
            acceleration=4.0,
            restarts=2,
            friction=("coulomb",),
            floor=-1.0,
            step=0.05,
            progress=shares.append,
        )
    states = np.stack(found(np.linspace(0.0, 3.0, 40)))
    return [
        shares,
        found.constraints.least(states) > 0,
        found.coefficients.shape,
        list(found.clearances),
        found.duration,
        found.information.criterion,
    ]


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
