"""Simulations by compiled steps: complete answers on record. A few small kernels are compiled."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest
from mechanisms import GROUND, four_bar, pins
from recorded_answers import Records

import twistwrench as tw
from twistwrench.simulation import Event, JointStops, Plane, rollout_steps

from .simulation_cases import ARM

records = Records(__file__)

GRAVITY = (1.3, -2.1, -9.2)
BALL = """<mujoco model="ball"><worldbody><body name="arm"><joint name="ball" type="ball"/>
<inertial pos="0.12 0 0" mass="0.8" diaginertia="0.01 0.02 0.015"/></body></worldbody></mujoco>"""
Q0, DQ0 = (0.3, -0.07), (-0.8, 0.35)
WRENCH = np.array([0.3, -0.2, 0.5, 1.1, -2.3, 0.9])


@functools.cache
def robot_of(name):
    if name == "linkage":
        drives = {
            "a": {"friction": {"viscous": "0.3 N m s/rad", "coulomb": "0.7 N m"}},
            "d": {"friction": {"coulomb": "0.4 N m"}},
        }
        return four_bar().with_actuators({"actuators": drives}).close("rocker_pin", "coupler_pin", "vx vz")
    return tw.load({"arm": ARM, "ball": BALL}[name], gravity=GRAVITY)


def compiled(call):
    """Call with programs compiled, also while its answers are recorded."""

    @functools.wraps(call)
    def call_compiled():
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TWISTWRENCH_JIT", "1")
            return call()

    return call_compiled


def found_in(result):
    has_roots = bool(result.events) and result.method != "semi_implicit"  # found up to rounding errors
    evaluations = None if has_roots else result.evaluations
    return [
        [result.times[-1], *result.q[-1], *result.dq[-1], *result.ddq[-1], *result.tau[-1]],
        [result.times.sum(), *result.q.sum(axis=0), *result.dq.sum(axis=0), *result.ddq.sum(axis=0), *result.tau.sum(axis=0)],
        [work[-1] for work in result.work.values()], [len(result), result.steps, result.rejected, evaluations],
        result.error_estimate, [f"{e} {e.q.sum():.5f} {e.dq.sum():.5f}" for e in result.events], result.stopped, result.remarks,
    ]  # fmt: skip


def failed(call):
    with pytest.raises(tw.SimulationError) as caught:
        call()
    return [str(caught.value), found_in(caught.value.result)]


def pushes(t, q, dq):
    return np.array([0.4 - 0.3 * q[0] + 0.1 * dq[1], 1.1 * np.cos(30 * t)])


def wrench(t, q, dq):
    return WRENCH * (1.0 + t) + 0.1 * q[1]


@records.of
@compiled
def steps_under_constant_forces():
    arm = robot_of("arm")
    ground = Plane(
        "slide", [[0.01, 0.02, -0.05], [0.03, -0.04, -0.06]], (0.2, 0.3, 1.0), 0.217, 2e3, 1.25, 0.6, 0.7, 0.03
    )
    answers = {}
    for method in ("rk4", "semi_implicit", "euler"):
        answers[method] = found_in(
            arm.simulate(Q0, DQ0, 0.13, 0.01, method=method, every=3, tau=[0.4, 5.0], wrench_on_robot={"upper": WRENCH})
        )
    for method in ("rk4", "semi_implicit"):
        shares = []
        found = arm.simulate(
            Q0, DQ0, 0.1, 0.01, method=method, friction=True, tau=[0.4, 5.0], limits="stop", progress=shares.append
        )
        answers[f"friction, {method}"] = [*found_in(found), shares]
    contacts = [JointStops(2e3, exponent=1.5, dissipation=0.4), ground]
    for method in ("rk4", "dopri5"):
        for name, q0, dq0 in (("stops", (0.85, -0.24), (1.3, -0.9)), ("ground", (-0.7, 0.2), (-1.1, 0.5))):
            answers[f"{name}, {method}"] = found_in(
                arm.simulate(q0, dq0, 0.05, 0.005, method=method, contacts=contacts, every=2)
            )
    for q0, dq0 in (
        ((0.6, 0.1), (2.9, 0.2)),
        ((0.1, -0.2), (0.1, -0.8)),
        ((0.875, 0.1), (0.5, 0.2)),
        ((-1.125, 0.1), (0.0, 0.0)),
        ((-0.5, 0.375), (0.0, 0.0)),
        ((0.6, -0.25), (0.0, 0.0)),
        ((0.875, -0.25), (0.5, -0.7)),
    ):
        for method in ("semi_implicit", "dopri5"):
            answers[f"limits from {q0}, {method}"] = found_in(
                arm.simulate(q0, dq0, 0.12, 0.01, method=method, limits="stop", every=4)
            )
    answers["unstable"] = failed(lambda: arm.simulate(Q0, DQ0, 0.1, 0.02, method="euler", tau=[4e8, 5.0]))
    answers["unstable later"] = failed(lambda: arm.simulate(Q0, DQ0, 0.1, 0.02, method="euler", tau=[1e6, 5.0]))
    return answers


@records.of
@compiled
def steps_under_functions():
    arm = robot_of("arm")
    answers = {}
    control = lambda t, q, dq: [-2.0 * dq[0], 0.3 - q[1]]  # noqa: E731
    for name, options in {
        "tau": {"tau": pushes}, "controller": {"controller": control}, "controller and torques": {"controller": control, "tau": [0.2, 5.0]},
        "both": {"controller": control, "tau": pushes}, "wrench": {"wrench_on_robot": {"slide": wrench, "upper": WRENCH}, "tau": [0.2, 5.0]},
        "all": {"wrench_on_robot": {"slide": wrench, "upper": WRENCH}, "tau": pushes, "controller": control},
    }.items():  # fmt: skip
        for method in ("rk4", "semi_implicit"):
            shares = []
            found = arm.simulate(Q0, DQ0, 0.11, 0.01, method=method, every=2, progress=shares.append, **options)
            answers[f"{name}, {method}"] = [*found_in(found), sum(shares)]
    long = arm.simulate(Q0, DQ0, 0.4, 0.001, method="semi_implicit", tau=pushes, friction=True)
    answers["two blocks"] = found_in(long)
    shares = []
    arm.simulate(Q0, DQ0, 0.25, 0.001, method="rk4", progress=shares.append)
    answers["reports of progress"] = [len(shares), shares[:3], shares[-1]]
    pulse = lambda t, q, dq: [40.0 * np.exp(-(((t - 0.0227) / 4e-4) ** 2)), 3.0]  # noqa: E731
    answers["missed impulses"] = found_in(arm.simulate(Q0, DQ0, 0.05, 0.01, method="rk4", tau=pulse))
    events = [
        Event(lambda t, q, dq: q[0] - 0.27, "low", direction="down"),
        Event(lambda t, q, dq: t - 0.064, "bell", terminal=True),
    ]
    for method in ("rk4", "semi_implicit", "dopri5"):
        answers[f"events, {method}"] = found_in(
            arm.simulate(Q0, DQ0, 0.11, 0.01, method=method, every=3, events=events)
        )
        answers[f"events and control, {method}"] = found_in(
            arm.simulate(Q0, DQ0, 0.11, 0.01, method=method, every=3, events=events, controller=control, limits="stop")
        )
    for method in ("rk4", "semi_implicit"):
        for name, options in {
            "nan": {"tau": lambda t, q, dq: [0.1, np.nan if t > 0.033 else 0.2]}, "list": {"tau": lambda t, q, dq: [0.1] if t > 0.033 else [0.1, 0.2]},
            "error": {"tau": lambda t, q, dq: [0.1, 1 / (t < 0.033)]}, "controller": {"controller": lambda t, q, dq: [0.1, np.inf if t > 0.033 else 0.2], "tau": pushes},
            "fast": {"tau": lambda t, q, dq: [0.1, 1e12 if t > 0.033 else 0.2]},
        }.items():  # fmt: skip
            answers[f"{name}, {method}"] = failed(
                lambda method=method, options=options: arm.simulate(Q0, DQ0, 0.1, 0.01, method=method, **options)
            )
    return answers


@records.of
@compiled
def adaptive_steps():
    arm, ball = robot_of("arm"), robot_of("ball")
    q, dq = ball.add(ball.neutral, [0.3, -0.4, 0.2]), [4.9, -7.3, 3.7]
    return {
        "dense": found_in(arm.simulate(Q0, DQ0, 0.9, 0.05, tau=[0.2, 5.0])),
        "friction": found_in(arm.simulate(Q0, DQ0, 0.5, 0.05, tau=[0.2, 5.0], friction=True, creep=0.05)),
        "tolerances": found_in(arm.simulate(Q0, DQ0, 0.9, 0.05, rtol=1e-4, atol=1e-5, every=3, max_step=0.1, tau=[0.2, 5.0])),
        "a ball": found_in(ball.simulate(q, dq, 0.3, 0.03)),
        "a ball by rk4": found_in(ball.simulate(q, dq, 0.3, 0.03, method="rk4")),
        "a ball by semi_implicit": found_in(ball.simulate(q, dq, 0.3, 0.03, method="semi_implicit", tau=[0.1, 0.2, -0.3])),
        "torques of a controller": found_in(arm.simulate(Q0, DQ0, 0.2, 0.05, controller=lambda t, q, dq: [0.3 * t, 4.0 - 9.0 * dq[1]], tau=[0.1, 0.2])),
        "at rest": found_in(arm.simulate([0.0, 0.1], [0.0, 0.0], 0.2, 0.05, tau=[0.1, 0.2])),
    }  # fmt: skip


@records.of
@compiled
def batches_side_by_side():
    arm = robot_of("arm")
    q0 = np.array([[Q0, (0.5, 0.2)], [(0.1, -0.23), (-0.4, 0.1)], [(0.8, 0.0), (0.0, 0.36)]])
    dq0 = np.array([DQ0, (1.9, -0.9)])
    answers = {}
    for name, options in {
        "plain": {"method": "rk4", "tau": [0.2, 5.0]}, "limits": {"method": "semi_implicit", "limits": "stop", "tau": [5.0, 9.0]},
        "stops": {"method": "rk4", "contacts": JointStops(2e3)},
    }.items():  # fmt: skip
        batch = arm.simulate_batch(q0, dq0, 0.12, 0.01, **options)
        answers[name] = [
            repr(batch),
            batch.ends,
            batch.completed,
            [x.q[-1] for x in batch],
            [x.evaluations for x in batch],
            found_in(batch[2, 1]),
        ]
    failing = arm.simulate_batch(
        q0, [[9e5, 0.1], [0.1, 0.2]], 0.02, 0.01, method="euler", wrench_on_robot={"upper": 1e6 * WRENCH}
    )
    answers["failing"] = [repr(failing), failing.completed, failing.ends]
    return answers


@records.of
@compiled
def rollouts_in_slices():
    arm = robot_of("arm")
    rng = np.random.default_rng(4)
    q0, tau = np.array(Q0) + 0.1 * rng.normal(size=(40, 2)), rng.normal(size=(12, 2))
    answers = {}
    for name, options in {
        "rk4": {"method": "rk4"},
        "torques": {"torques": True, "torque_limits": [0.5, 1.0]},
        "every": {"torques": True, "every": 4},
    }.items():
        whole = arm.rollout(q0, DQ0, tau, dt=0.01, **options)
        answers[name] = [
            whole.q.sum(axis=0),
            whole.dq.sum(axis=0),
            None if whole.tau is None else whole.tau.sum(axis=0),
        ]
        with pytest.MonkeyPatch.context() as patch:
            for operations in (3e4, 3e5):
                patch.setattr(rollout_steps, "OPERATIONS_PER_CALL", operations)
                found = arm.rollout(q0, DQ0, tau, dt=0.01, **options)
                same = [np.array_equal(a, b) for a, b in ((found.q, whole.q), (found.dq, whole.dq))]
                answers[f"{name}, {operations:g} operations"] = [
                    *same,
                    whole.tau is None or np.array_equal(found.tau, whole.tau),
                ]
    gradient = arm.rollout(q0, DQ0, tau, dt=0.01, every=4, gradients=True).gradient(q=1.0, dq=[0.3, -0.2])
    answers["gradient"] = [gradient.q0.sum(axis=0), gradient.dq0, gradient.tau]
    return answers


@records.of
@compiled
def closed_steps():
    closed = robot_of("linkage")
    B, C = pins(1.2)
    (x, z), (u, w) = C - B, C - [GROUND, 0.0]
    q = closed.consistent([1.2, np.arctan2(z, x) - 1.2, np.arctan2(w, u)])
    dq = closed.project_velocity(q, [9.0, 0.0, 0.0])
    answers = {}
    for method, options in (
        ("rk4", {}),
        ("semi_implicit", {"friction": True}),
        ("euler", {"wrench_on_robot": {"coupler": WRENCH}}),
    ):
        found = closed.simulate(q, dq, 0.0225, 0.0025, method=method, tau=[0.4, -0.2, 0.3], every=2, **options)
        answers[method] = [*found_in(found), found.lam[-1], found.lam.sum(axis=0), found.gap_before, found.slip_before]
    long = closed.simulate(q, dq, 0.09, 0.01, method="semi_implicit", friction=True)
    answers["ends off the constraints"] = [*found_in(long), long.gap_before, long.slip_before]
    stopped = failed(lambda: closed.simulate(q, 40.0 * dq, 0.09, 0.01, method="semi_implicit"))
    answers["too fast"] = [re.sub(r"and \S+ remains", "and some remains", stopped[0]), stopped[1][0]]
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
