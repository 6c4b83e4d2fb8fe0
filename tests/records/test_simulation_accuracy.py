"""Errors of simulations, and the parts that estimate and report them: complete answers on record."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.verdict import Verdict, Word
from twistwrench.simulation import JointStops, Plane
from twistwrench.simulation import result as results
from twistwrench.simulation.accuracy import missed_impulses, relative_error, step_doubling
from twistwrench.simulation.accuracy.contact_durations import ContactDurations
from twistwrench.simulation.judgement import worst_moment
from twistwrench.simulation.methods import stiffness, variational

from .simulation_cases import ARM

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

BALL = """<mujoco model="ball"><worldbody><body name="arm"><joint name="ball" type="ball"/>
<inertial pos="0.12 0.03 0" mass="0.8" diaginertia="0.01 0.02 0.015"/></body></worldbody></mujoco>"""
Q0, DQ0 = (0.3, -0.07), (-0.8, 0.35)


@functools.cache
def robot_of(name):
    return tw.load({"arm": ARM, "ball": BALL}[name], gravity=(1.3, -2.1, -9.2))


def brief(result):
    ends = [result.q[-1], result.dq[-1], result.error_estimate, result.relative_error]
    is_iterated = result.method == "midpoint" or "variational" in result.method  # up to rounding errors
    counts = [result.steps, result.rejected, None if is_iterated else result.evaluations]
    return [*ends, result.remarks, result.stopped, counts]


def pulse(t, q, dq):
    return np.array([40.0 * np.exp(-(((t - 0.0227) / 4e-4) ** 2)), 3.0 - 20.0 * np.exp(-(((t - 0.0463) / 6e-4) ** 2))])


@records.of
def impulses_that_steps_miss():
    arm = robot_of("arm")
    kick = {
        "slide": lambda t, q, dq: np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]) * (1.0 + 90.0 * (abs(t - 0.0337) < 4e-4))
    }
    answers = {}
    for method in ("rk4", "semi_implicit", "midpoint", "dopri5"):
        answers[method] = brief(arm.simulate(Q0, DQ0, 0.06, 0.01, method=method, tau=pulse))
    answers["wrench"] = brief(arm.simulate(Q0, DQ0, 0.06, 0.01, method="rk4", wrench_on_robot=kick))
    answers["both"] = brief(
        arm.simulate(
            Q0,
            DQ0,
            0.06,
            0.01,
            method="rk4",
            wrench_on_robot=kick,
            tau=pulse,
            controller=lambda t, q, dq: [0.1, -dq[1]],
        )
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(missed_impulses, "MAX_STORED_STEPS", 2)
        patch.setattr(missed_impulses, "BATCH_SIZE", 3)
        answers["in parts"] = brief(arm.simulate(Q0, DQ0, 0.06, 0.01, method="rk4", tau=pulse))
    failing = lambda t, q, dq: pulse(t, q, dq) / (abs(t - 0.0250000000001) > 1e-9)  # noqa: E731
    answers["at rest"] = brief(
        arm.simulate(
            (0.0, 0.0),
            (0.0, 0.0),
            0.03,
            0.01,
            method="euler",
            tau=lambda t, q, dq: arm.gravity_forces(q) + 0.3 * pulse(t, q, dq),
        )
    )
    answers["failing between"] = brief(arm.simulate(Q0, DQ0, 0.05, 0.02, method="euler", tau=failing))
    return answers


@records.of
def steps_that_are_sampled():
    answers = {
        str(n): [len(k), k[:12], sum(k), k[-1]]
        for n in (1, 5, 31, 33, 64, 100, 1600, 3000, 100_000, 160_001)
        for k in [step_doubling.sample_steps(n)]
    }
    errors = np.array([[1.0, 2.0], [0.5, -1.0], [3.0, 0.25]])
    answers["sums"] = [
        step_doubling._interpolated_sum(np.array([0, 3, 8]), errors, 11),
        step_doubling._interpolated_sum(np.array([4]), errors[:1], 11),
    ]
    answers["without rounding"] = step_doubling._without_rounding(
        np.array([[1e-14, -3e-14], [2e-15, 5e-15]]), np.array([[1.0, -2.0, 0.5], [0.1, 0.2, 0.3]])
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(step_doubling, "MAX_SAMPLES", 5)
        stops = JointStops(3e3, exponent=1.5, dissipation=0.4)
        for method in ("rk4", "semi_implicit"):
            answers[method] = brief(
                robot_of("arm").simulate((0.86, -0.24), (1.3, -0.9), 0.1, 0.005, method=method, contacts=stops)
            )
        answers["friction"] = brief(
            robot_of("arm").simulate(
                Q0,
                (0.02, 0.01),
                0.1,
                0.005,
                method="semi_implicit",
                friction=True,
                tau=lambda t, q, dq: [2.0 * np.sin(90 * t), 9.0 * np.cos(70 * t)],
            )
        )
    return answers


@records.of
def extents_and_remarks_on_accuracy():
    rng = np.random.default_rng(2)
    arm, ball = robot_of("arm"), robot_of("ball")
    states = np.cumsum(rng.normal(size=(2600, 8)), axis=0) * 0.01
    short = relative_error.Extent.from_states(arm, states[:40])
    still = relative_error.Extent.from_states(arm, np.zeros((3, 8)))
    q = ball.add(ball.neutral, rng.normal(size=(12, 3)))
    answers = {
        "long": relative_error.Extent.from_states(arm, states), "short": [short, short.rests], "still": [still, still.rests],
        "ball": relative_error.Extent.from_states(ball, np.concatenate([q, rng.normal(size=(12, 7))], axis=1)),
        "errors": relative_error.Accuracy.from_error(short, np.array([0.003, 0.02])), "errors at rest": relative_error.Accuracy.from_error(still, np.array([1e-10, 3e-10])),
    }  # fmt: skip
    for relative in (0.0499, 0.0501, 0.97, 1.5, 9999.0, 10001.0, np.nan):
        accuracy = relative_error.Accuracy(np.array([0.1]), relative)
        answers[f"error {relative}"] = [
            accuracy.remarkable,
            accuracy.remarks("rk4", 0.0099),
            accuracy.remarks("dopri5", 0.0101),
        ]
    answers["drifts"] = [
        relative_error.Accuracy(np.array([0.1]), 0.0).remarks("rk4", x) for x in (0.5, 3.0, 20000.0, np.nan)
    ]
    return answers


@records.of
def contacts_by_duration():
    answers = {}
    times = np.arange(1, 9) * 0.01
    gaps = np.array([[1, 1], [-1, 1], [1, 1], [-1, -1], [-1, -1], [1, -1], [1, 1], [1, 1]], float)
    worked = np.array([False, True, True, True, True, True, False, True])
    for name, parts in {"whole": [8], "in parts": [3, 5], "one by one": [1] * 8}.items():
        durations = ContactDurations(["toe", "heel"])
        changed, begin = [], 0
        for count in parts:
            rows = slice(begin, begin + count)
            changed += durations.block(times[rows], gaps[rows], worked[rows]).tolist()
            begin += count
        answers[name] = [changed, durations.short, durations.first, durations.remark(0.01)]
    steps = ContactDurations(["toe"])
    answers["steps"] = [
        steps.step(0.01 * k, [g], worked=w)
        for k, (g, w) in enumerate([(1.0, False), (1.0, True), (-0.1, True), (0.0, True), (0.2, False)])
    ]
    answers["remark"] = [
        steps.remark(0.00123),
        steps.short,
        ContactDurations([]).remark(0.1),
        ContactDurations([]).block(times, gaps[:, :0], worked),
    ]
    return answers


@records.of
def stiff_equations():
    arm = robot_of("arm")
    answers = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stiffness, "CHECK_INTERVAL", 40)
        patch.setattr(stiffness, "MAX_REMAINING_STEPS", 50)
        for name, options in {
            "gains": {"tau": lambda t, q, dq: [0.1, 3.0 - 3e4 * dq[1]]}, "friction": {"friction": True, "creep": 3e-6},
        }.items():  # fmt: skip
            with pytest.raises(tw.SimulationError) as caught:
                arm.simulate(Q0, (-0.01, 0.001), 40.0, 5.0, rtol=1e-3, atol=1e-4, **options)
            answers[name] = str(caught.value)
        system = SimpleNamespace(robot=arm, friction=None, moving=slice(2, 4))
        rates = np.arange(28.0).reshape(1, 7, 4) ** 1.5
        trials = SimpleNamespace(count=0, states=np.array([[0.3, -0.07, 0.0, 0.0]]), rates=rates)
        for name, (limited, steepness, distance, duration) in {
            "not limited": (0, 3.24, 1.0, 90.0), "few": (4, 3.26, 1.0, 90.0), "many": (5, 3.26, 1.0, 90.0), "near the end": (5, 3.26, 1.0, 0.8), "no distance": (5, 3.26, 0.0, 90.0),
        }.items():  # fmt: skip
            counted = stiffness.Stiffness(system, trials, duration)
            try:
                for k in range(40):
                    counted.note(0.01 * k, 0.01, steepness if k < limited else 0.1, distance)
                answers[name] = [counted._trials, counted._limited, counted._begin]
            except tw.SimulationError as error:
                answers[name] = str(error)
    return answers


@records.of
def variational_steps_at_their_limits():
    ball = robot_of("ball")
    q = ball.add(ball.neutral, [0.3, -0.4, 0.2])
    secant = variational._Secant(np.array([0.5, -0.2, 0.1]))
    changes = [secant.correct(np.array(c)) for c in ([0.3, -0.15, 0.02], [0.1, 0.05, -0.03], [0.01, 0.02, 0.005])]
    x = np.array([0.4, -0.7, 1.1])
    a = np.array([[0.0, -0.3, 0.2], [0.3, 0.0, -0.5], [-0.2, 0.5, 0.0]])
    stops = JointStops(4e4, exponent=1.5, dissipation=0.2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(variational, "MAX_ITERATIONS", 3)
        no_balance = refusal(
            lambda: robot_of("arm").simulate((0.874, 0.1), (1.9, 0.2), 0.02, 0.01, method="midpoint", contacts=stops)
        )
    return {
        "no balance": no_balance,
        "series": [[np.sign(c), np.log(np.abs(c))] for c in (variational._BERNOULLI_SERIES, variational._TANH_SERIES)],
        "functions": [variational._exponential(a, x), variational._even_series(a, x, [0.5, -0.25, 0.125]), changes, secant.inverse],
        "too fast": [
            refusal(lambda method=method, speed=speed: ball.simulate(q, [4.9, speed, 3.7], 0.1, 0.02, method=method))
            for method, speed in (("midpoint", -110.0), ("variational", -260.0))
        ],
        "just not too fast": brief(ball.simulate(q, [4.9, -87.3, 3.7], 0.02, 0.02, method="midpoint")),
        "a stiff stop": brief(robot_of("arm").simulate((0.874, 0.1), (1.9, 0.2), 0.02, 0.01, method="midpoint", contacts=stops)),
        "unstable": refusal(lambda: robot_of("arm").simulate(Q0, DQ0, 0.02, 0.01, method="midpoint", tau=lambda t, q, dq: [0.0, 1e160 * dq[1] ** 3])).partition(": ")[0],
    }  # fmt: skip


@records.of
def rows_of_a_record():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results, "MAX_INITIAL_ROWS", 3)
        record = results.Record(9, 8, 2)
        sizes = [len(record._parts[0]), record.last]
        for k in range(5):
            record.keep(0.1 * k, np.arange(8.0) + k, np.full(2, k + 0.5), np.full(2, -k))
            sizes += [len(record._parts[0]), record.count, record.last]
        record.keep_block(np.array([0.5, 0.7, 0.8]), np.ones((3, 8)), np.zeros((3, 2)), np.array([1.0, 2.0]))
        sizes += [len(record._parts[0]), record.count, record.last]
        found = record.result(
            robot_of("arm"), ("torques", "friction", "wrenches", "contacts"), stopped="", evaluations=3
        )
    return [
        sizes,
        record.states,
        found.times,
        found.q,
        found.dq,
        found.ddq,
        found.tau,
        found.work,
        found.energy,
        found.drift,
        found.relative_drift,
        len(found),
    ]


@records.of
def verdicts_with_clearances():
    arm = robot_of("arm")
    near = SimpleNamespace(
        verdict=Verdict(Word.COLLISION, ("upper and slide touch",)), lines=["upper is nearest to slide", "second line"]
    )
    far = SimpleNamespace(verdict=Verdict(Word.OK), lines=["upper is 0.2 m from slide"])
    runs = {
        "done": arm.simulate(Q0, DQ0, 0.02, 0.01, method="euler"),
        "over": arm.simulate(Q0, DQ0, 0.02, 0.01, method="euler", tau=[4.0, -9.0], friction=True),
        "stopped": arm.simulate((0.86, 0.1), (1.9, 0.2), 0.03, 0.01, method="euler", limits="stop"),
        "rejected steps": arm.simulate((0.874, 0.1), (1.9, 0.2), 0.02, 0.01, contacts=Plane("slide", height=0.1, stiffness=100.0)),
    }  # fmt: skip
    answers = {}
    for name, run in runs.items():
        for label, clearance in (("alone", None), ("near", near), ("far", far)):
            found = replace(run, clearance=clearance)
            lines = str(found).splitlines()
            answers[f"{name}, {label}"] = [
                found.verdict.word,
                found.verdict.reasons,
                lines if label == "near" else lines[:4],
            ]
        degrees = replace(run, degrees=True)
        q, mark, title = worst_moment(degrees)
        answers[f"{name}, in degrees"] = [
            degrees.verdict.reasons,
            q,
            mark and [mark.joint, str(mark)],
            title,
            repr(run.facts()),
            repr(list(run.sources())),
        ]
    unknown = replace(runs["over"], simulated=None)
    answers["without a robot"] = [
        unknown.verdict.word,
        str(unknown).splitlines(),
        dict(unknown.sources()),
        refusal(lambda: unknown.motion),
    ]
    answers["not finite"] = replace(runs["done"], kinetic_energy=np.array([1.0, np.nan, 2.0])).relative_drift
    answers["nothing moves"] = replace(
        runs["done"], kinetic_energy=np.zeros(3), potential_energy=np.zeros(3)
    ).relative_drift
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
