"""Control laws, observers and their thresholds: complete answers on record."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_answers import Records, refusal
from recorded_robots import chain, coupled, driven, placed, state, tree

import twistwrench as tw
from twistwrench.control import (
    PD,
    ComputedTorque,
    ContactWrench,
    HybridMotionForce,
    Impedance,
    MomentumObserver,
    PoseMotion,
    TaskSpace,
    references,
    residual_threshold,
    task_space,
)
from twistwrench.mechanics.algorithms import time_scalings
from twistwrench.robot import Robot

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

N = 4
K = np.arange(1.0, N + 1)


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


def robot():
    return Robot(chain(N))


def at(seed=1):
    """State (q, dq) of the chain."""
    q, dq, *_ = state(chain(N), seed)
    return q, dq


def joints(t):
    """Motion of the joints."""
    phase = t + 0.3 * K
    return 0.4 * np.sin(phase), 0.4 * np.cos(phase), -0.4 * np.sin(phase)


def symmetric(n):
    """Gain that couples rows."""
    return np.diag(20.0 + 3.0 * np.arange(n)) + 1.5 * (np.ones((n, n)) - np.eye(n))


def start_and_end():
    one = robot()
    q, _ = at()
    T = one.forward_kinematics(0.5 * q)
    return T, T @ placed((0.5, -0.4, 0.7), (0.2, -0.1, 0.3))


def paths():
    """Motions of the tip on a screw and on a straight line."""
    start, end = start_and_end()
    timing = time_scalings.quintic(0.8)
    return {
        "screw": PoseMotion(time_scalings.screw_path(start, end), timing),
        "straight": PoseMotion(time_scalings.straight_path(start, end), timing),
    }


# ── Laws of joints


@records.of
def torques_of_laws_of_joints():
    one = robot()
    q, dq = at()
    q_d = 0.3 * K - 0.6
    answers = {}
    for name, reference in {"still": q_d, "moving": joints}.items():
        for gains, (kp, kd) in {
            "numbers": (30.0, 4.0),
            "vectors": (10.0 * K, 3.0 / K),
            "matrices": (symmetric(N), 0.2 * symmetric(N)),
        }.items():
            pd = PD(one, reference, kp, kd)
            answers[f"{name}, {gains}"] = [
                pd(0.4, q, dq),
                PD(one, reference, kp, kd, gravity=False)(0.4, q, dq),
                ComputedTorque(one, reference, kp, kd)(0.4, q, dq),
                ComputedTorque(one, reference, kp, kd, friction=True)(0.4, q, dq),
                pd.error(0.4, q, dq),
                pd.rate_gains,
            ]
    answers["driven"] = [
        law(0.4, *state(driven())[:2])
        for law in (
            ComputedTorque(Robot(driven()), np.zeros(7), 9.0, 2.0, friction=True),
            PD(Robot(driven()), np.zeros(7), 9.0, 2.0),
        )
    ]
    answers["coupled"] = PD(Robot(coupled()), np.zeros(5), 9.0, 2.0)(0.4, *state(coupled())[:2])
    return answers


@records.of
def laws_for_rollouts():
    one = robot()
    times = np.array([0.0, 0.1, 0.3])

    def batch(law):
        found = law.batch_law(one, times)
        return {"type": type(found).__name__} | {
            name: value for name, value in vars(found).items() if not name.startswith("_")
        }

    return {
        "PD": batch(PD(one, joints, 10.0 * K, 3.0)),
        "PD, still": batch(PD(one, 0.1 * K, 10.0, 3.0 * K, gravity=False)),
        "computed torque": batch(ComputedTorque(one, joints, 10.0, 3.0)),
        "computed torque, still": batch(ComputedTorque(one, 0.1 * K, 10.0, 3.0)),
        "friction": tried(lambda: batch(ComputedTorque(one, joints, 10.0, 3.0, friction=True))),
        "coupled": [
            tried(lambda: batch(PD(one, joints, symmetric(N), 3.0))),
            tried(lambda: batch(ComputedTorque(one, joints, 3.0, symmetric(N)))),
        ],
        "another robot": tried(lambda: PD(Robot(chain(3)), np.zeros(3), 10.0, 3.0).batch_law(one, times)),
    }


class Planned:
    """Result of a planner, which holds a motion."""

    motion = staticmethod(joints)


@records.of
def references_that_hold_a_motion():
    one = robot()
    q, dq = at()
    law = PD(one, Planned(), 10.0, 3.0)
    still = PD(one, type("Held", (), {"motion": 0.1 * K})(), 10.0, 3.0)
    return [
        law(0.4, q, dq),
        PD(one, joints, 10.0, 3.0)(0.4, q, dq) - law(0.4, q, dq),
        law.batch_law(one, np.array([0.0, 0.2])).q_des,
        still(0.4, q, dq),
        TaskSpace(one, start_and_end()[0], 9.0, 4.0, rows="vx", posture=Planned())(0.4, q, dq),
    ]


@records.of
def motions_of_poses():
    answers = {name: [motion(t) for t in (0.0, 0.3, 0.8, 1.1)] for name, motion in paths().items()}
    start, _ = start_and_end()
    calls = {
        "path": lambda: PoseMotion(start, time_scalings.cubic(1.0)),
        "number": lambda: PoseMotion(time_scalings.screw_path(start, start), 1.0),
        "type": lambda: PoseMotion(time_scalings.screw_path(start, start), float),
        "no argument": lambda: PoseMotion(time_scalings.screw_path(start, start), lambda: 1.0),
        "one value": lambda: PoseMotion(time_scalings.screw_path(start, start), lambda t: t)(0.5),
        "two values": lambda: PoseMotion(time_scalings.screw_path(start, start), lambda t: (t, t))(0.5),
        "array": lambda: PoseMotion(time_scalings.screw_path(start, start), lambda t: np.zeros((3, 2)))(0.5),
    }
    return answers | {name: tried(call) for name, call in calls.items()}


@records.of
def references_that_are_not_motions():
    one = robot()
    cases = {
        "short": [1, 2],
        "not finite": [np.nan] * N,
        "text": "home",
        "no argument": lambda: 0,
        "one value": lambda t: np.zeros(N),
        "short velocities": lambda t: (np.zeros(N), np.zeros(2), np.zeros(N)),
        "short accelerations": lambda t: (np.zeros(N), np.zeros(N), np.zeros(3)),
        "short positions": lambda t: (np.zeros(2), np.zeros(N), np.zeros(N)),
        "class": int,
    }
    start, _ = start_and_end()
    poses = {
        "pose of another frame": tw.Pose(start, "s", "link2"),
        "pose seen from a moving frame": tw.Pose(start, "link2", "link1"),
        "pose seen from the base": tw.Pose(start, "base", "link1"),
        "pose seen from an unknown frame": tw.Pose(start, "s", "link1"),
        "not a pose": 2.0 * start,
        "three rows": start[:3],
        "motion without a pose": lambda t: (2.0 * start, np.zeros(6), np.zeros(6)),
        "motion with short twists": lambda t: (start, np.zeros(3), np.zeros(6)),
        "motion with short accelerations": lambda t: (start, np.zeros(6), np.zeros(3)),
        "vectors": np.zeros(N),
    }
    return {
        name: tried(lambda r=r: PD(one, r, 1.0, 1.0).error(0.0, np.zeros(N), np.zeros(N))) for name, r in cases.items()
    } | {name: tried(lambda r=r: TaskSpace(one, r, 1.0, 1.0).task(0.0, *at()).error) for name, r in poses.items()}


@records.of
def gains_that_cannot_be():
    names = ("a", "b", "c")
    M = np.diag([1.0, 2.0, 3.0])
    cases = {
        "number": 2.0,
        "vector": [1.0, 2.0, 3.0],
        "matrix": symmetric(3),
        "zero": 0.0,
        "two": [1.0, 2.0],
        "infinite": np.inf,
        "not symmetric": M + np.eye(3)[[1, 0, 2]] * [[0.1], [0], [0]],
        "almost symmetric": M + 1e-10 * np.eye(3)[[1, 2, 0]],
        "negative": [1.0, -0.5, 2.0],
        "slightly negative": [1.0, -1e-10, 2.0],
        "indefinite": [[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]],
        "singular": [1.0, 0.0, 2.0],
        "barely definite": [1.0, 1e-12, 2.0],
    }
    answers = {
        name: [
            tried(lambda g=g: references.gain(g, "the gain", names)),
            tried(lambda g=g: references.gain(g, "the mass", names, definite=True)),
        ]
        for name, g in cases.items()
    }
    one = robot()
    answers["laws"] = [
        tried(lambda: PD(one, np.zeros(N), -1.0, 1.0)),
        tried(lambda: PD(one, np.zeros(N), 1.0, [1.0, 2.0])),
        tried(lambda: ComputedTorque(one, np.zeros(N), 1.0, np.nan)),
        tried(lambda: TaskSpace(one, np.eye(4), np.ones(5), 1.0)),
        tried(lambda: TaskSpace(one, np.eye(4), 1.0, 1.0, posture_kp=-1.0)),
        tried(lambda: TaskSpace(one, np.eye(4), 1.0, 1.0, posture_kd=[1.0])),
        tried(lambda: Impedance(one, np.eye(4), -1.0, 1.0)),
        tried(lambda: Impedance(one, np.eye(4), 1.0, [1.0, 2.0])),
    ]
    answers["robots"] = [
        tried(lambda: PD(Robot(tree()), np.zeros(12), 1.0, 1.0)),
        tried(lambda: PD(3, np.zeros(3), 1.0, 1.0)),
        tried(lambda: TaskSpace(Robot(tree()), np.eye(4), 1.0, 1.0)),
        tried(lambda: MomentumObserver("robot", 3.0)),
    ]
    answers["states"] = [
        tried(lambda: PD(one, np.zeros(N), 1.0, 1.0)(0.0, np.zeros(3), np.zeros(N))),
        tried(lambda: PD(one, np.zeros(N), 1.0, 1.0)(0.0, np.zeros(N), np.zeros(3))),
        tried(lambda: TaskSpace(one, np.eye(4), 1.0, 1.0)(0.0, np.zeros(3), np.zeros(N))),
    ]
    return answers


class Named:
    """Numbers with names, in another order than the robot's, as a table of pandas has them."""

    def __init__(self, values, names):
        order = np.roll(np.arange(len(names)), 1)
        self.columns = [names[k] for k in order]
        self.values = np.asarray(values)[..., order]

    def to_numpy(self):
        return self.values


@records.of
def numbers_with_names_in_another_order():
    one = robot()
    q, dq = at()
    names = one.model.velocity_names
    turned = [name + "?" for name in names]
    pd = PD(one, Named(0.1 * K, names), Named(10.0 * K, names), Named(3.0 / K, names))
    moving = PD(one, lambda t: tuple(Named(x, names) for x in joints(t)), 10.0, 3.0)
    task = TaskSpace(
        one,
        start_and_end()[0],
        25.0,
        Named([7.0, 6.0], ("vx", "wy")),
        rows="vx wy",
        posture=Named(0.1 * K, names),
        posture_kp=Named(K, names),
        posture_kd=Named(2.0 / K, names),
    )
    observer = MomentumObserver(one, 20.0)
    t, qs, dqs, taus = log_of_joints(one, 4)
    return {
        "PD": [
            pd(0.4, q, dq),
            pd(0.4, Named(q, names), Named(dq, names)),
            moving(0.4, q, dq),
            ComputedTorque(one, lambda t: tuple(Named(x, names) for x in joints(t)), 10.0, 3.0)(0.4, q, dq),
        ],
        "task": [
            task(0.4, q, dq),
            task(0.4, Named(q, names), Named(dq, names)),
            Impedance(one, start_and_end()[0], Named([25.0, 9.0], ("vx", "wy")), 7.0, rows="vx wy")(0.4, q, dq),
        ],
        "observer": [
            observer.update(0.0, Named(q, names), Named(dq, names), Named(K, names)),
            observer.update(0.1, Named(q, names), Named(dq, names), Named(K, names)),
            observer.over(t, Named(qs, names), Named(dqs, names), Named(taus, names)),
            observer.wrench(Named(q, names), residual=Named(K, names)).wrench,
        ],
        "other names": [
            tried(lambda: PD(one, Named(K, turned), 1.0, 1.0)),
            tried(lambda: PD(one, K, Named(K, turned), 1.0)),
            tried(lambda: pd(0.4, Named(q, turned), dq)),
            tried(lambda: observer.update(0.3, q, dq, Named(K, turned))),
        ],
    }


@records.of
def laws_that_are_compared():
    one = robot()
    T, _ = start_and_end()
    pairs = {
        "PD": [PD(one, K, 1.0, 2.0) for _ in range(2)],
        "ComputedTorque": [ComputedTorque(one, K, 1.0, 2.0) for _ in range(2)],
        "TaskSpace": [TaskSpace(one, T, 1.0, 2.0, rows="vx") for _ in range(2)],
        "Impedance": [Impedance(one, T, 1.0, 2.0, rows="vx") for _ in range(2)],
        "PoseMotion": [PoseMotion(time_scalings.screw_path(T, T), time_scalings.cubic(1.0)) for _ in range(2)],
        "ContactWrench": [ContactWrench(np.ones(6), np.zeros((0, 6)), np.ones(2), "a", 6) for _ in range(2)],
        "MomentumObserver": [MomentumObserver(one, 1.0) for _ in range(2)],
        "ResidualThreshold": [
            residual_threshold.ResidualThreshold(MomentumObserver(one, 1.0), K, K, 1.0, 2.0, 3) for _ in range(2)
        ],
    }
    return {name: [a == b, repr(a).split("(")[0].split(" ")[0]] for name, (a, b) in pairs.items()}


# ── Laws of the tip

ROWS = {
    "all": {},
    "position": {"rows": "vx vy vz"},
    "some": {"rows": [5, 0, 3]},
    "body": {"kind": "body", "rows": "wx wy wz"},
    "plane": {"kind": "body", "rows": "wy vx vz"},
    "frame": {"frame": "link2", "rows": "vz vx"},
    "posture": {"rows": "vx vy", "posture": 0.1 * K, "posture_kp": 9.0 * K, "posture_kd": symmetric(N)},
    "moving posture": {"rows": "vx vy", "posture": joints},
}


@records.of(relative=1e-6)
def torques_of_laws_of_the_tip():
    one = robot()
    q, dq = at()
    motions = paths()
    answers = {}
    for name, options in ROWS.items():
        if name in ("all",):
            continue
        reference = (
            joints if "frame" in options else motions["straight" if name in ("position", "posture") else "screw"]
        )
        law = TaskSpace(one, reference, 25.0, 7.0, **options)
        n = len(law.row_names)
        coupled_gains = TaskSpace(one, reference, symmetric(n), 0.3 * symmetric(n), **options)
        answers[name] = {
            "rows": law.row_names,
            "task": law.task(0.3, q, dq)._asdict(),
            "torques": [law(0.3, q, dq), coupled_gains(0.3, q, dq)],
            "impedance": Impedance(one, reference, symmetric(n), 4.0, **options)(0.3, q, dq),
            "impedance of another mass": Impedance(
                one,
                reference,
                30.0,
                0.3 * symmetric(n),
                mass=2.0 + np.arange(n),
                wrench_on_robot=lambda t, q, dq: t * np.array([1.0, -2.0, 0.5, 3.0, 0.7, -1.1]),
                **options,
            )(0.3, q, dq),
        }
    answers["still"] = TaskSpace(one, start_and_end()[0], 25.0, 7.0, rows="vx wy")(0.3, q, dq)
    return answers


@records.of(relative=1e-6)
def torques_of_laws_of_all_six_rows():
    one = Robot(chain(7))
    q, dq, *_ = state(chain(7))
    T = one.forward_kinematics(0.7 * q)
    motion = PoseMotion(
        time_scalings.straight_path(T, T @ placed((0.5, -0.4, 0.7), (0.2, -0.1, 0.3))), time_scalings.cubic(0.8)
    )
    answers = {}
    for kind in task_space.KINDS:
        law = TaskSpace(one, motion, 10.0 + np.arange(6), 3.0, kind=kind, posture=np.zeros(7))
        answers[kind] = [
            law.task(0.3, q, dq)._asdict(),
            law(0.3, q, dq),
            Impedance(one, motion, 10.0 + np.arange(6), 3.0, kind=kind)(0.3, q, dq),
        ]
    return answers


@records.of
def errors_of_poses():
    T, T_d = placed((0.3, -0.5, 0.2), (0.1, 0.2, 0.3)), placed((-0.4, 0.6, 0.9), (0.5, -0.1, 0.2))
    V, V_d, dV_d = (
        np.array([0.3, -0.2, 0.5, 1.0, 0.4, -0.7]),
        np.array([-0.6, 0.1, 0.8, 0.2, 1.3, 0.5]),
        np.array([1.2, -0.9, 0.4, 0.6, -0.3, 0.8]),
    )
    return {
        "body": task_space.body_errors(T, V, T_d, V_d, dV_d),
        "world": task_space.world_errors(T, V, T_d, V_d, dV_d),
        "twist": task_space._transform_twist(T[:3, :3], T[:3, 3], V),
        "kinds": task_space.KINDS,
    }


@records.of
def tasks_that_cannot_be():
    one = robot()
    T, _ = start_and_end()
    wrench = {"mass": 1.0, "wrench_on_robot": lambda t, q, dq: np.zeros(6)}
    calls = {
        "kind": lambda: TaskSpace(one, T, 1.0, 1.0, kind="space"),
        "kind that is not a text": lambda: TaskSpace(one, T, 1.0, 1.0, kind=3),
        "frame": lambda: TaskSpace(one, T, 1.0, 1.0, frame="nowhere"),
        "rows": lambda: TaskSpace(one, T, 1.0, 1.0, rows="x"),
        "mass alone": lambda: Impedance(one, T, 1.0, 1.0, mass=1.0),
        "wrench alone": lambda: Impedance(one, T, 1.0, 1.0, wrench_on_robot=lambda t, q, dq: np.zeros(6)),
        "wrench that is not a function": lambda: Impedance(one, T, 1.0, 1.0, mass=1.0, wrench_on_robot=np.zeros(6)),
        "no mass": lambda: Impedance(one, T, 1.0, 1.0, **(wrench | {"mass": 0.0})),
        "short wrench": lambda: Impedance(
            one, T, 1.0, 1.0, rows="vx", **(wrench | {"wrench_on_robot": lambda t, q, dq: np.zeros(3)})
        )(0.25, *at()),
        "posture": lambda: TaskSpace(one, T, 1.0, 1.0, posture=[1.0]),
    }
    answers = {name: tried(call) for name, call in calls.items()}
    for rows in ("vx", "wx wy", "wx vx vy", "wx vy vz", "wy vx vz", "wz vx vy", "vx vy vz", "wx wy wz", "wz wy wx"):
        answers[f"body, {rows}"] = tried(
            lambda rows=rows: TaskSpace(one, T, 1.0, 1.0, kind="body", rows=rows).row_names
        )
    return answers


@records.of(relative=1e-6)
def torques_of_hybrid_motion_and_force():
    one = robot()
    q, dq = at()
    T = one.forward_kinematics(q)
    closed = one.close("ground", "link1", rows="vz vx", pose=T)

    def motion(t, q, dq):
        return 3.0 * K * t - 0.2 * dq

    def sensor(t, q, dq):
        return np.array([1.0 + t, -2.0])

    calls = {
        "constant": lambda: HybridMotionForce(closed, motion, [5.0, -3.0]),
        "one number": lambda: HybridMotionForce(closed, motion, 5.0),
        "moving": lambda: HybridMotionForce(closed, motion, lambda t: [5.0 * t, 1.0]),
        "measured": lambda: HybridMotionForce(
            closed, motion, [5.0, -3.0], force_gain=symmetric(2) / 20.0, measured=sensor
        ),
        "gain alone": lambda: HybridMotionForce(closed, motion, [5.0, -3.0], force_gain=0.5),
        "measured alone": lambda: HybridMotionForce(closed, motion, [5.0, -3.0], measured=sensor),
        "not a sensor": lambda: HybridMotionForce(closed, motion, [5.0, -3.0], force_gain=0.5, measured=np.zeros(2)),
        "open": lambda: HybridMotionForce(one, motion, [5.0, -3.0]),
        "not a robot": lambda: HybridMotionForce("robot", motion, [5.0, -3.0]),
        "not a law": lambda: HybridMotionForce(closed, np.zeros(N), [5.0, -3.0]),
        "three forces": lambda: HybridMotionForce(closed, motion, [5.0, -3.0, 1.0]),
        "infinite force": lambda: HybridMotionForce(closed, motion, [np.inf, -3.0]),
        "short motion": lambda: HybridMotionForce(closed, lambda t, q, dq: [1.0], [5.0, -3.0]),
        "short force": lambda: HybridMotionForce(closed, motion, lambda t: [5.0]),
        "short measurement": lambda: HybridMotionForce(
            closed, motion, [5.0, -3.0], force_gain=0.5, measured=lambda t, q, dq: [1.0]
        ),
    }
    return {name: tried(lambda call=call: call()(0.25, q, dq)) for name, call in calls.items()}


# ── Observers


def log_of_joints(one, n, step=0.01):
    """Times, coordinates, velocities and torques of a motion, rows not evenly spaced."""
    t = step * (np.arange(n) + 0.2 * np.sin(np.arange(n)))
    q, dq, ddq = (np.array(x) for x in zip(*map(joints, t), strict=True))
    tau = one.inverse_dynamics(q, dq, ddq) + 0.5 * np.sin(7.0 * t)[:, None] * K
    return t, q, dq, tau


@records.of
def residuals_of_observers():
    one = robot()
    t, q, dq, tau = log_of_joints(one, 12)
    answers = {}
    for name, (gain, friction) in {
        "one gain": (30.0, False),
        "gains": (10.0 * K, False),
        "not filtered": (np.inf, False),
        "friction": (20.0, True),
    }.items():
        observer = MomentumObserver(one, gain, friction=friction)
        over = observer.over(t, q, dq, tau)
        steps = [observer.update(*row) for row in zip(t, q, dq, np.roll(tau, 1, axis=0), strict=True)]
        answers[name] = [over, np.array(steps), observer.gain, repr(observer), observer.residual]
        observer.reset()
        answers[name] += [observer.residual, observer.update(0.0, q[0], dq[0], tau[0])]
    watching = MomentumObserver(one, 30.0)
    law = watching.watch(lambda t, q, dq: K * t - dq)
    answers["watched"] = [[law(*row), watching.residual] for row in zip(t[:4], q, dq, strict=False)]
    q2, dq2, _, tau2 = state(driven())
    other = MomentumObserver(Robot(driven()), 15.0, friction=True)
    answers["driven"] = [other.update(x, q2 * (1 + x), dq2, tau2 * (1 - x)) for x in (0.0, 0.1, 0.3)]
    return answers


@records.of
def observers_that_cannot_be():
    one = robot()
    observer = MomentumObserver(one, 30.0)
    t, q, dq, tau = log_of_joints(one, 3)
    observer.update(0.1, q[0], dq[0], tau[0])
    calls = {
        "gain": lambda: MomentumObserver(one, 0.0),
        "gains": lambda: MomentumObserver(one, [1.0, 2.0]),
        "negative gain": lambda: MomentumObserver(one, [1.0, 2.0, -3.0, 4.0]),
        "friction": lambda: MomentumObserver(one, 1.0, friction=3),
        "time": lambda: observer.update(0.1, q[0], dq[0], tau[0]),
        "earlier": lambda: observer.update(0.05, q[0], dq[0], tau[0]),
        "not finite": lambda: observer.update(0.2, q[0], dq[0], tau[0] * np.nan),
        "time that is not finite": lambda: observer.update(np.inf, q[0], dq[0], tau[0]),
        "short": lambda: observer.update(0.2, q[0], dq[0][:2], tau[0]),
        "rows": lambda: observer.over(t, q[:2], dq, tau),
        "times": lambda: observer.over(np.zeros((2, 2)), q, dq, tau),
        "no times": lambda: observer.over([], q[:0], dq[:0], tau[:0]),
        "order": lambda: observer.over(t[::-1], q, dq, tau),
        "one row out of order": lambda: observer.over([0.0, 0.2, 0.1], q, dq, tau),
        "rows that are not finite": lambda: observer.over(t, q, dq * np.inf, tau),
        "not a law": lambda: observer.watch(3),
        "short torques": lambda: MomentumObserver(one, 30.0).watch(lambda t, q, dq: [1.0])(0.3, q[0], dq[0]),
        "kind": lambda: observer.wrench(q[0], kind="local"),
        "kind that is not a text": lambda: observer.wrench(q[0], kind=["body"]),
        "row": lambda: observer.wrench(q[0], rows="x"),
        "residual": lambda: observer.wrench(q[0], residual=[1.0]),
        "residual that is not finite": lambda: observer.wrench(q[0], residual=[np.nan] * N),
        "frame": lambda: observer.wrench(q[0], "nowhere"),
        "configuration": lambda: observer.wrench([np.nan] * N),
    }
    return {name: tried(call) for name, call in calls.items()}


@records.of(relative=1e-6)
def wrenches_of_contacts():
    one, seven = robot(), Robot(chain(7))
    q, _ = at()
    observer = MomentumObserver(one, 30.0)
    residual = 1.5 * K - 2.0
    answers = {}
    for name, options in {
        "all": {},
        "space": {"kind": "space"},
        "forces": {"rows": "vx vy vz", "kind": "world_aligned"},
        "one": {"rows": "vy"},
        "middle": {"frame": "link3"},
    }.items():
        found = observer.wrench(q, residual=residual, **options)
        answers[name] = [
            found.wrench,
            found.blind.T @ found.blind,
            found.unexplained,
            found.frame,
            found.rank,
            str(found),
        ]
    full = MomentumObserver(seven, 30.0).wrench(state(chain(7))[0], residual=np.arange(7.0))
    answers["seven"] = [full, str(full)]
    answers["own residual"] = observer.wrench(q).wrench
    answers["text"] = str(
        ContactWrench(np.array([1.0, -2.0, 0.5, 3.0, 0.25, -7.0]), np.zeros((0, 6)), np.array([0.3, 0.4]), "tool", 6)
    )
    return answers


@records.of
def thresholds_of_residuals():
    one = robot()
    rng = np.random.default_rng(5)
    n, step = 3700, 0.01
    t = step * np.arange(n) + 3.0
    phase = np.outer(t, 0.7 + 0.3 * K) + K
    q, dq, ddq = 0.4 * np.sin(phase), 0.4 * (0.7 + 0.3 * K) * np.cos(phase), -0.4 * (0.7 + 0.3 * K) ** 2 * np.sin(phase)
    tau = one.inverse_dynamics(q, dq, ddq) + rng.normal(0.0, 0.3 * K, q.shape) + 0.8 * np.sign(dq) * [1, 0, 2, 0]
    motion = tw.Motion(t, q, dq, ddq, tau, robot=one, in_seconds=True)
    pushed = tau.copy()
    pushed[2000:2060, 1] += 40.0
    observer = MomentumObserver(one, 20.0)
    found = observer.threshold(motion)
    some = observer.threshold(tw.Motion(t, q, dq, ddq, pushed, robot=one, in_seconds=True), per_hour=12.0)
    short = observer.threshold(motion[:2300], per_hour=12.0)
    contradicted = observer.threshold(tw.Motion(t, q, 3.0 * dq, ddq, tau, robot=one, in_seconds=True))
    calls = {
        "no torques": lambda: observer.threshold(tw.Motion(t, q, dq, ddq, robot=one, in_seconds=True)),
        "per hour": lambda: observer.threshold(motion, per_hour=0.0),
        "short": lambda: observer.threshold(motion[:350]),
        "shorter": lambda: observer.threshold(motion[:150]),
        "as short as may be": lambda: observer.threshold(motion[:402]).blocks_of_log,
    }
    return {
        "found": found,
        "pushed": some,
        "of a short log": short,
        "of a log that contradicts itself": [contradicted.verdict, contradicted.doubts],
        "facts": [found.facts(), found.brief, found.sentence, found.torques, found.texts],
        "blocks": [found.blocks_of_log, short.blocks_of_log, some.blocks_of_log],
        "blocks at the limit": [observer.threshold(motion[:rows]).blocks_of_log for rows in (3195, 3205)],
    } | {name: tried(call) for name, call in calls.items()}


@records.of
def parts_of_thresholds():
    one = robot()
    rng = np.random.default_rng(6)
    maxima = rng.uniform(1.0, 2.0, (40, 2)) * [1.0, 3.0]
    e = rng.normal(0.2, 0.1, (600, 2)) + 0.3 * np.sign(np.sin(np.arange(600.0)))[:, None] * [1.0, 0.0]
    dq = np.stack([np.sin(np.arange(600.0)), np.zeros(600)], axis=1)
    q = np.stack([np.arange(600.0) % 90, np.arange(600.0) ** 1.1], axis=1)
    poses = np.stack([at(seed)[0] for seed in range(7)])
    observer = MomentumObserver(one, 5.0 * K)
    return {
        "level": [residual_threshold.gumbel_level(maxima, share) for share in (1e-4, 0.01, 0.3)],
        "means": [residual_threshold._cell_means(e, dq, q, step, np.array([30.0, 5.0])) for step in (0.01, 0.001)],
        "force": [
            residual_threshold.smallest_force(observer, poses, K),
            residual_threshold.smallest_force(MomentumObserver(one, np.inf), np.tile(poses, (60, 1)), 2.0 * K),
        ],
        "force of one joint": residual_threshold.smallest_force(
            MomentumObserver(Robot(chain(1)), 5.0), np.zeros((2, 1)), np.ones(1)
        ),
        "directions": residual_threshold._DIRECTIONS,
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
