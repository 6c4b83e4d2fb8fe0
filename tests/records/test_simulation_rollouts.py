"""Rollouts, their gradients, and motions of closed robots: complete answers on record."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mechanisms import GROUND, four_bar, pins
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.simulation import BatchComputedTorque, BatchPD, Event, JointStops
from twistwrench.simulation.methods.closed_steps import Loops, loses_rank

from .simulation_cases import ARM

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

BALL = """<mujoco model="ball"><worldbody><body name="arm" pos="0.2 0.1 0.05"><joint name="ball" type="ball"/>
<inertial pos="0.12 0.03 -0.02" mass="0.8" fullinertia="0.01 0.02 0.015 0 0 0"/>
<body name="tip" pos="0.3 0.02 0.04"><joint name="wrist" axis="0 1 0"/>
<inertial pos="0.05 -0.04 0.06" mass="0.4" fullinertia="0.002 0.004 0.003 0 0 0"/>
</body></body></worldbody></mujoco>"""
GRAVITY = (1.3, -2.1, -9.2)
Q0 = np.array([[0.3, -0.07], [-0.4, 0.12], [0.8, 0.02]])
DQ0 = np.array([-0.8, 0.35])
WRENCH = np.array([0.3, -0.2, 0.5, 1.1, -2.3, 0.9])
TORQUES = np.array([[1.3, -4.1], [2.2, 3.0], [-4.5, 9.0], [0.3, -9.5]])
LOADED = {}


def robot_of(name):
    makers = {
        "arm": lambda: tw.load(ARM, gravity=GRAVITY),
        "ball": lambda: tw.load(BALL, gravity=GRAVITY),
        "coupled": lambda: robot_of("arm").with_actuators(COUPLED),
        "linkage": lambda: four_bar().with_gravity(GRAVITY).close("rocker_pin", "coupler_pin", "vx vz"),
        "rubbing": lambda: four_bar().with_actuators(DRIVES).close("rocker_pin", "coupler_pin", "vx vz"),
    }
    if name not in LOADED:
        LOADED[name] = makers[name]()
    return LOADED[name]


COUPLED = {
    "couplings": {
        "both": {
            "motors": ["m1", "m2"],
            "joints": ["waist", "reach"],
            "motor_per_joint": [["1.5", "2.5 rad/m"], ["-0.3", "4 rad/m"]],
        }
    },
    "actuators": {"m1": {"friction": {"coulomb": "0.4 N m"}}, "m2": {"friction": {"coulomb": "0.2 N m"}}},
}
DRIVES = {
    "actuators": {
        "a": {"friction": {"viscous": "0.3 N m s/rad", "coulomb": "0.7 N m"}},
        "d": {"friction": {"coulomb": "0.4 N m"}},
    }
}


def whole(found):
    content = {name: getattr(found, name) for name in ("times", "q", "dq", "tau", "dt", "steps", "method", "remarks")}
    return [*content.values(), repr(found), found.batch, found.unstable, found.unstable_from]


def slopes(found, **given):
    gradient = found.gradient(**given)
    return [
        gradient.q0,
        gradient.dq0,
        gradient.tau,
        gradient.law,
        gradient.wrench_on_robot,
        gradient.parameters,
        repr(gradient),
    ]


PD = BatchPD([0.4, 0.1], kp=[9.0, 60.0], kd=[2.0, 11.0], dq_des=[0.1, -0.2])
FORCES = {
    "nothing": {"steps": 4},
    "constant torques": {"tau": TORQUES[0], "steps": 4},
    "torques by step": {"tau": TORQUES},
    "torques by sample": {"tau": np.stack([TORQUES, 0.5 * TORQUES, -TORQUES])},
    "PD": {"tau": PD, "steps": 4},
    "PD without gravity, by sample": {"tau": BatchPD(np.array([[[0.4, 0.1]], [[0.2, 0.3]], [[0.1, 0.2]]]), 9.0, 2.0, gravity=False), "duration": 0.04},
    "computed torque": {"tau": BatchComputedTorque([0.4, 0.1], 40.0, [9.0, 7.0], 0.1, [0.3, 0.2]), "steps": 4},
    "wrenches": {"wrench_on_robot": {"slide": WRENCH, "upper": np.linspace(0.5, 2, 4)[:, None] * WRENCH}, "steps": 4},
    "limits of the robot": {"tau": 3.0 * TORQUES, "torque_limits": True},
    "given limits": {"tau": TORQUES, "torque_limits": [1.5, 3.5]},
    "friction": {"tau": TORQUES, "friction": True},
    "friction and limits": {"tau": PD, "steps": 4, "friction": True, "torque_limits": [2.0, 6.0]},
    "parameters": {
        "tau": TORQUES, "parameters": {"slide.mass": [0.9, 1.3, 2.0], "upper.mass": 2.6},
    },
    "friction by parameters": {"tau": TORQUES, "friction": True, "parameters": {"waist.coulomb": [0.1, 0.5, 0.9], "reach.viscous": [1.0, 3.0, 5.0]}},
}  # fmt: skip


@records.of
def rollouts_by_method_and_force():
    answers = {}
    for name, options in FORCES.items():
        for method in ("semi_implicit", "rk4"):
            found = robot_of("arm").rollout(Q0, DQ0, dt=0.01, method=method, torques=True, **options)
            answers[f"{name}, {method}"] = [
                found.q[..., -1, :],
                found.dq[..., -1, :],
                found.q.sum(axis=-2),
                found.tau,
                repr(found),
            ]
    return answers


@records.of
def whole_rollouts_of_other_shapes():
    arm, ball = robot_of("arm"), robot_of("ball")
    q, dq = ball.add(ball.neutral, [0.3, -0.4, 0.2, 0.6]), [0.9, -1.3, 0.7, 1.7]
    answers = {
        "one": whole(arm.rollout(Q0[0], DQ0, dt=0.01, steps=6, every=3, torques=True, tau=PD)),
        "each with each": whole(arm.rollout(Q0[:, None], np.array([DQ0, 2 * DQ0]), dt=0.02, duration=0.05)),
        "float32": [
            str(
                arm.rollout(
                    Q0.astype("f4"),
                    DQ0.astype("f4"),
                    0.0 * TORQUES[0].astype("f4"),
                    dt=0.01,
                    steps=2,
                    torque_limits=True,
                ).q.dtype
            )
        ],
        "no samples": whole(arm.rollout(np.zeros((0, 2)), DQ0, steps=2)),
        "unstable": whole(
            arm.rollout(
                Q0, [[0, 0], [4e6, 0], [0, 0]], dt=0.01, steps=3, tau=np.array([[[0, 0]], [[0, 0]], [[0, 1e12]]])
            )
        ),
        "unstable, one": repr(arm.rollout(Q0[0], DQ0, [0, 1e12], dt=0.01, steps=3)),
        "a pendulum of a ball": whole(
            ball.rollout(q, dq, dt=0.01, steps=3, torques=True, tau=BatchPD(ball.neutral, 3.0, 0.4))
        ),
        "a ball by rk4": whole(ball.rollout(q, dq, [0.1, 0.2, -0.3, 0.4], dt=0.01, steps=3, method="rk4")),
        "friction of coupled drives": whole(
            robot_of("coupled").rollout(Q0, DQ0, steps=2, dt=0.01, method="rk4", friction=True)
        ),
        "no friction given": robot_of("ball").rollout(q, dq, steps=1, friction=True).remarks,
        "a controller": whole(
            arm.rollout(Q0, DQ0, tw.control.PD(arm, [0.4, 0.1], 9.0, [2.0, 3.0]), dt=0.01, steps=3, torques=True)
        ),
    }
    out = np.full((3, 3, 2), 7.0), np.full((3, 3, 2), 8.0)
    lent = arm.rollout(Q0, DQ0, dt=0.01, steps=4, every=2, out=out)
    answers["lent arrays"] = [lent.q is out[0] or np.shares_memory(lent.q, out[0]), out[0].copy(), out[1].copy()]
    again = arm.rollout(lent.q[:, -1], lent.dq[:, -1], dt=0.01, steps=4, every=2, out=out)
    answers["starting in them"] = again.q
    many = arm.rollout(Q0, DQ0, np.concatenate([TORQUES, -TORQUES[:3]]), dt=0.01, torques=True)
    motion = many.motion(1)
    answers["a motion"] = [
        motion.time,
        motion.q,
        motion.dq,
        motion.ddq,
        motion.tau,
        refusal(lambda: many.motion()),
        refusal(lambda: many.motion(3)),
        repr(many.motion(-3)),
    ]
    table = many.to_xarray()
    answers["labels"] = [dict(table.sizes), sorted(map(str, table.data_vars)), table.tau.values[1, -1], len(many)]
    return answers


@records.of
def gradients_and_linear_steps():
    rng = np.random.default_rng(5)
    answers = {}
    for name, options in FORCES.items():
        found = robot_of("arm").rollout(Q0, DQ0, dt=0.01, torques=True, gradients=True, **options)
        by_q, by_dq, by_tau = rng.normal(size=(3, 5, 2)), rng.normal(size=(3, 5, 2)), rng.normal(size=(3, 4, 2))
        answers[name] = slopes(found, q=by_q, dq=by_dq, tau=by_tau)
        if not isinstance(options.get("tau"), (BatchPD, BatchComputedTorque)):
            answers[f"{name}, linear"] = [x.ravel() for x in found.linearize()]
    ball = robot_of("ball")
    q, dq = ball.add(ball.neutral, [0.3, -0.4, 0.2, 0.6]), [[0.9, -1.3, 0.7, 1.7], [0.1, 0.2, -0.4, 0.3]]
    found = ball.rollout(q, dq, BatchPD(ball.neutral, 3.0, 0.4), dt=0.01, steps=4, every=2, gradients=True)
    answers["ball, every second"] = slopes(found, q=rng.normal(size=(2, 3, 4)), dq=0.3)
    return answers


@records.of
def gradients_by_other_ways():
    rng = np.random.default_rng(7)
    arm = robot_of("arm")
    rk4 = arm.rollout(Q0, DQ0, TORQUES, dt=0.01, method="rk4", gradients=True, wrench_on_robot={"upper": WRENCH})
    thinned = arm.rollout(Q0, DQ0, TORQUES, dt=0.01, every=2, torques=True, gradients=True)
    many = arm.rollout(
        Q0[:, None], np.array([DQ0, 2 * DQ0]), dt=0.01, steps=2, gradients=True, parameters={"slide.mass": [0.9, 1.3]}
    )
    return {
        "rk4": [*slopes(rk4, q=rng.normal(size=(3, 5, 2)), dq=0.4), [x.ravel() for x in rk4.linearize()]],
        "thinned": slopes(thinned, q=rng.normal(size=(3, 3, 2)), dq=rng.normal(size=2), tau=rng.normal(size=(3, 2, 2))),
        "two axes": [*slopes(many, q=rng.normal(size=(3, 2, 3, 2))), [x.shape for x in many.linearize()], many.linearize()[0][2, 1, 1]],
        "refused": [
            refusal(lambda: rk4.gradient(tau=1.0)), refusal(lambda: rk4.gradient(q=np.ones((2, 2)))), refusal(lambda: rk4.gradient(dq=np.ones((4, 2)))),
            refusal(thinned.linearize), refusal(lambda: thinned.gradient(tau=np.ones((5, 2)))),
            refusal(arm.rollout(Q0, DQ0, PD, dt=0.01, steps=1, gradients=True).linearize), refusal(arm.rollout(Q0, DQ0, steps=1).linearize),
            refusal(lambda: arm.rollout(Q0, DQ0, steps=1, gradients=True, friction=True, method="rk4")),
            refusal(lambda: arm.rollout(Q0, DQ0, steps=1, gradients=True, out=(np.zeros((3, 2, 2)), np.zeros((3, 2, 2))))),
            refusal(lambda: rk4.q.__setitem__(0, 1.0)),
        ],
    }  # fmt: skip


@records.of
def what_rollouts_refuse():
    arm = robot_of("arm")
    calls = {
        "q0": {"q0": [1, 2, 3]}, "q0 number": {"q0": 3.0}, "dq0": {"dq0": [[1.0]]}, "batches": {"q0": Q0, "dq0": np.zeros((2, 2))},
        "steps": {"steps": 0}, "steps and duration": {"duration": 1.0}, "how long": {"steps": None}, "duration": {"steps": None, "duration": -1.0},
        "too many": {"steps": None, "duration": 1e9}, "more than that": {"steps": 10**9 + 1}, "every": {"steps": 5, "every": 2}, "dt": {"dt": 0.0},
        "method": {"method": "euler"}, "method number": {"method": 3}, "tau": {"tau": [1, 2, 3]}, "tau number": {"tau": 3.0}, "tau axes": {"tau": np.zeros((3, 2, 2))},
        "tau class": {"tau": BatchPD}, "tau function": {"tau": lambda t, q, dq: q}, "law": {"tau": BatchPD([1, 2, 3], 1.0, 1.0)},
        "gains": {"tau": BatchPD([1, 2], [1.0, 2.0, 3.0], 1.0)}, "gravity": {"tau": BatchPD([1, 2], 1.0, 1.0, gravity="yes")},
        "limits": {"torque_limits": [1.0, -2.0]}, "limits nan": {"torque_limits": [1.0, np.nan]}, "limits long": {"torque_limits": [1, 2, 3]},
        "wrench": {"wrench_on_robot": WRENCH}, "frame": {"wrench_on_robot": {"nose": WRENCH}}, "wrench short": {"wrench_on_robot": {"upper": [1, 2]}},
        "parameters": {"parameters": 3}, "parameter": {"parameters": {"nose.mass": 1.0}}, "pattern": {"parameters": {"*.mass": 1.0}},
        "impossible": {"parameters": {"slide.mass": -1.0}}, "friction": {"friction": 3}, "torques": {"torques": "yes"}, "gradients": {"gradients": 2},
        "out": {"out": np.zeros((1, 2))}, "out shape": {"out": (np.zeros((3, 2)), np.zeros((3, 2)))}, "out type": {"out": (np.zeros((4, 2), "f4"), np.zeros((4, 2)))},
    }  # fmt: skip
    answers = {}
    for name, options in calls.items():
        options = {"q0": Q0[0], "dq0": DQ0, "steps": 3, **options}
        answers[name] = refusal(lambda options=options: arm.rollout(**options))
    same = np.zeros((4, 2))
    locked = np.zeros((4, 2))
    locked.flags.writeable = False
    answers["one array twice"] = refusal(lambda: arm.rollout(Q0[0], DQ0, steps=3, out=(same, same)))
    answers["locked"] = refusal(lambda: arm.rollout(Q0[0], DQ0, steps=3, out=(same, locked)))
    answers["across"] = refusal(lambda: arm.rollout(Q0[0], DQ0, steps=3, out=(same, np.zeros((2, 4)).T)))
    answers["computed torque of a ball"] = refusal(
        lambda: robot_of("ball").rollout(
            robot_of("ball").neutral, np.zeros(4), BatchComputedTorque(robot_of("ball").neutral, 1.0, 1.0), steps=1
        )
    )
    answers["zero quaternion"] = refusal(lambda: robot_of("ball").rollout(np.zeros(5), np.zeros(4), steps=1))
    answers["nothing moves"] = refusal(lambda: tw.load(ARM, lock={"waist": 0, "reach": 0}).rollout([], [], steps=1))
    answers["coupled"] = [
        refusal(lambda: robot_of("coupled").rollout(Q0, DQ0, steps=1, friction=True)), refusal(lambda: robot_of("coupled").rollout(Q0, DQ0, steps=1, torque_limits=9.0)),
    ]  # fmt: skip
    return answers


def closed_start(name="linkage"):
    closed = robot_of(name)
    B, C = pins(1.2)
    (x, z), (u, w) = C - B, C - [GROUND, 0.0]
    q = closed.consistent([1.2, np.arctan2(z, x) - 1.2, np.arctan2(w, u)])
    return q, closed.project_velocity(q, [9.0, 0.0, 0.0])


def of_closed(found):
    has_roots = found.method == "dopri5" and bool(found.events)  # found up to rounding errors
    evaluations = None if has_roots else found.evaluations
    return [
        [found.times[-1], *found.q[-1], *found.dq[-1], *found.ddq[-1], *found.lam[-1]], found.lam.sum(axis=0), found.row_names, found.gap_before, found.slip_before,
        bool((found.gap < 1e-12).all()), [w[-1] for w in found.work.values()], [found.steps, evaluations, found.rejected], found.error_estimate,
        [f"{e}" for e in found.events], found.remarks, found.stopped, found.method,
    ]  # fmt: skip


@records.of
def motions_of_closed_robots():
    q, dq = closed_start()
    closed = robot_of("linkage")
    answers = {}
    for method in (None, "rk4", "semi_implicit", "euler", "dopri5"):
        answers[str(method)] = of_closed(closed.simulate(q, dq, 0.06, 0.02, method=method, tau=[0.4, -0.2, 0.3]))
    answers["functions"] = of_closed(
        closed.simulate(
            q,
            dq,
            0.03,
            0.015,
            tau=lambda t, q, dq: [0.1, t, -0.2 * dq[2]],
            wrench_on_robot={"coupler": WRENCH},
            controller=lambda t, q, dq: [0.2, 0.0, t],
        )
    )
    answers["event"] = of_closed(
        closed.simulate(q, dq, 0.06, 0.02, events=Event(lambda t, q, dq: q[0] - 1.52, "there", terminal=True))
    )
    answers["adaptive event"] = of_closed(
        closed.simulate(
            q, dq, 0.06, 0.02, method="dopri5", events=Event(lambda t, q, dq: q[0] - 1.52, "there", terminal=True)
        )
    )
    rubbing = robot_of("rubbing")
    q, dq = closed_start("rubbing")
    for method in ("rk4", "semi_implicit"):
        answers[f"friction, {method}"] = of_closed(rubbing.simulate(q, dq, 0.03, 0.015, method=method, friction=True))
    answers["creep"] = of_closed(rubbing.simulate(q, dq, 0.03, 0.015, friction=True, creep=8.0))
    answers["started"] = rubbing.simulate(None, None, 0.01, 0.01).q[0]
    answers["refused"] = [
        refusal(lambda: closed.simulate(q, dq, 0.1, method="midpoint")), refusal(lambda: closed.simulate(np.add(q, [0.2, 0, 0]), dq, 0.1)),
        refusal(lambda: closed.simulate(q, np.add(dq, [6.0, 0, 0]), 0.1)), re.sub(r"and \S+ remains", "and some remains", refusal(lambda: closed.simulate(q, 100.0 * dq, 0.03, 0.015))),
        refusal(lambda: closed.simulate(q, dq, 0.1, contacts=JointStops(1.0))),
    ]  # fmt: skip
    with pytest.raises(tw.SimulationError) as caught:
        closed.simulate(q, dq, 0.06, 0.02, tau=lambda t, q, dq: [np.nan if t > 0.04 else 0.1, 0.0, 0.0])
    answers["failed"] = [str(caught.value), of_closed(caught.value.result)]
    return answers


@records.of
def pivots_of_constraints():
    q, dq = closed_start()
    loops = Loops(robot_of("linkage"))
    y = np.concatenate([q, dq, np.zeros(4)])
    pairs = ((0.02, 1.0), (0.009, 0.03), (0.009, 0.04), (0.0099, 0.0397), (np.nan, 1.0), (0.0, 0.0), (1e-20, 1e-20))
    return [
        loops.onto(0.0, y.copy()),
        loops.smallest_pivot(y),
        [bool(loses_rank(np.array(x), before)) for x, before in pairs],
    ]


@records.of
def rollouts_of_closed_robots():
    q, dq = closed_start()
    dq = 0.3 * dq
    closed = robot_of("linkage")
    answers = {}
    for method in ("rk4", "semi_implicit"):
        found = closed.rollout(
            q, [[x] for x in (dq, 0.5 * dq)], [0.4, -0.2, 0.3], dt=0.004, steps=3, method=method, torques=True
        )
        answers[method] = [
            found.q,
            found.dq,
            found.tau,
            found.gap_before,
            found.slip_before,
            bool((found.gap < 1e-12).all()),
            found.lost_from,
        ]
    lost = closed.rollout(q, [dq, 100.0 * dq, 12.0 * dq], dt=0.004, steps=3)
    answers["lost"] = [lost.lost_from, np.isnan(lost.q), lost.remarks, lost.unstable_from]
    rubbing = robot_of("rubbing")
    q, dq = closed_start("rubbing")
    dq = 0.2 * dq
    found = rubbing.rollout(q, dq, dt=0.004, steps=2, every=2, friction=True, parameters={"coupler.mass": [1.5, 2.5]})
    answers["friction"] = [found.q, found.dq, found.remarks, found.times, found.lost_from]
    answers["refused"] = [
        refusal(lambda: closed.rollout(q, dq, steps=1, gradients=True)), refusal(lambda: closed.rollout(q, dq, steps=1, out=(1, 2))),
        refusal(lambda: closed.rollout(np.add(q, [0.2, 0, 0]), dq, steps=1)),
    ]  # fmt: skip
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
