"""Whatever comes in at a public door of trajectories, control, sensing and simulation: a result, or one error of the tree.

Every function is called rightly but for one argument, which is each kind of junk in turn.
"""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import control, sensing, simulation, trajectories

JUNK: dict[str, Any] = {
    "None": None,
    "text": "abc",
    "array": np.zeros(3),
    "table": np.zeros((7, 5)),
    "number": 2.0,
    "object": object(),
    "function": lambda: None,
    "class": dict,
    "list": [],
    "nan": np.nan,
    "not finite": np.full(2, np.nan),
}


@cache
def arm() -> Any:
    return tw.robots.planar_2r()


@cache
def three() -> Any:
    return tw.robots.planar_3r()


@cache
def line() -> Any:
    return trajectories.joint_line(arm(), [0, 0], [1, 1])


@cache
def moving() -> Any:
    return trajectories.move(arm(), [0, 0], [1, 1], trajectories.cubic(1.0))


@cache
def tool() -> Any:
    return sensing.ForceTorqueSensor(tw.SpatialInertia.from_com(2.0, (0, 0, 0.05)), bias=np.ones(6))


@cache
def log() -> Any:
    return sensing.simulate(tool(), 12)


@cache
def threshold() -> Any:
    return sensing.CollisionThreshold.of_noise((0.01, 0.3))


Q3 = [-0.6, 0.2, 2.2]
STATE: dict[str, Any] = {"t": 0.0, "q": [0.1, 0.2], "dq": [0.0, 0.0]}
MANY: dict[str, Any] = {"q0": [0, 0], "dq0": [0, 0], "steps": 2}
T3 = tw.se3.exp([0, 0, 0, 0.1, 0, 0])


def pose3() -> Any:
    return three().forward_kinematics(Q3)


CALLS: dict[str, tuple[Any, dict[str, Any]]] = {
    "joint_line": (trajectories.joint_line, {"robot": arm(), "q0": [0, 0], "q1": [1, 1]}),
    "spline": (
        trajectories.spline,
        {"robot": arm(), "waypoints": [[0, 0], [1, 1], [0, 1]], "degree": 3, "times": [0, 1, 2], "velocities": np.zeros((3, 2))},
    ),
    "path": (line(), {"s": 0.5}),
    "trajectory": (moving(), {"t": 0.5}),
    "Trajectory": (
        trajectories.Trajectory,
        {"robot": arm(), "path": line(), "scaling": trajectories.quintic(1.0)},
    ),
    "Trajectory.sample": (moving().sample, {"dt": 0.5}),
    "Trajectory.violations": (moving().violations, {"bounds": None, "friction": False}),
    "Trajectory.to_csv": (moving().to_csv, {"path": "no/such/folder/m.csv", "dt": 0.1}),
    "Trajectory.plot": (moving().plot, {"path": "no/such/folder/m.png", "bounds": None}),
    "move": (
        trajectories.move,
        {"robot": arm(), "q0": [0, 0], "q1": [1, 1], "scaling": trajectories.cubic(1.0), "waypoints": [[0.5, 0.2]]},
    ),
    "fitted": (
        trajectories.fitted,
        {"robot": arm(), "path": line(), "shape": None, "bounds": trajectories.bounds_of(arm(), velocity=1.0)},
    ),
    "fastest": (
        trajectories.fastest,
        {"robot": arm(), "path": line(), "effort": [60, 30], "velocity": 2.0, "acceleration": 20.0, "friction": False},
    ),
    "bounds_of": (trajectories.bounds_of, {"robot": arm(), "velocity": 1.0, "acceleration": 1.0, "effort": 1.0}),
    "violations": (
        trajectories.violations,
        {"robot": arm(), "trajectory": moving(), "bounds": None, "samples": 5},
    ),
    "follow_poses": (
        trajectories.follow_poses,
        {
            "robot": three(), "poses": trajectories.straight_path(pose3(), pose3()), "q0": Q3, "frame": None,
            "tolerance": 1e-6,
        },
    ),
    "screw_path": (trajectories.screw_path, {"start": np.eye(4), "end": T3}),
    "straight_path": (trajectories.straight_path, {"start": np.eye(4), "end": T3}),
    "pose path": (trajectories.screw_path(np.eye(4), T3), {"s": 0.5}),
    "cubic": (trajectories.cubic, {"duration": 1.0}),
    "quintic": (trajectories.quintic, {"duration": 1.0}),
    "uniform": (trajectories.uniform, {"duration": 1.0}),
    "trapezoid": (trajectories.trapezoid, {"v": 1.5, "a": 4.0}),
    "scaling": (trajectories.cubic(1.0), {"t": 0.5}),
    "PD": (control.PD, {"robot": arm(), "reference": [0, 0], "kp": 1.0, "kd": 1.0, "gravity": True}),
    "PD law": (control.PD(arm(), [0, 0], 1.0, 1.0), STATE),
    "PD of a motion": (control.PD(arm(), moving(), 1.0, 1.0), STATE),
    "ComputedTorque": (control.ComputedTorque, {"robot": arm(), "reference": moving(), "kp": 1.0, "kd": 1.0, "friction": True}),
    "ComputedTorque law": (control.ComputedTorque(arm(), [0, 0], 1.0, 1.0), STATE),
    "PoseMotion": (
        control.PoseMotion,
        {"path": trajectories.screw_path(np.eye(4), T3), "scaling": trajectories.quintic(1.0)},
    ),
    "TaskSpace": (
        control.TaskSpace,
        {
            "robot": three(), "reference": pose3(), "kp": 1.0, "kd": 1.0, "rows": "vx vz", "frame": "tip", "posture": Q3,
            "kind": "world_aligned", "posture_kp": 1.0, "posture_kd": 1.0,
        },
    ),
    "Impedance": (
        control.Impedance,
        {
            "robot": three(), "reference": pose3(), "stiffness": 1.0, "damping": 1.0, "rows": "vx vz", "mass": 1.0,
            "wrench_on_robot": lambda t, q, dq: np.zeros(6), "posture": None,
        },
    ),
    "HybridMotionForce": (
        control.HybridMotionForce,
        {
            "closed": three().close("ground", "tip", rows="vx", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0])),
            "motion": control.PD(three(), Q3, 1.0, 1.0), "force": [1.0], "force_gain": 0.1,
            "measured": lambda t, q, dq: [0.0],
        },
    ),
    "MomentumObserver": (control.MomentumObserver, {"robot": arm(), "gain": 10.0, "friction": True}),
    "update": (lambda **given: control.MomentumObserver(arm(), 10.0).update(**given), {**STATE, "tau": [0, 0]}),
    "over": (
        control.MomentumObserver(arm(), 10.0).over,
        {"times": [0, 0.1], "q": np.zeros((2, 2)), "dq": np.zeros((2, 2)), "tau": np.zeros((2, 2))},
    ),
    "watch": (control.MomentumObserver(arm(), 10.0).watch, {"controller": lambda t, q, dq: [0, 0]}),
    "observed wrench": (
        control.MomentumObserver(arm(), 10.0).wrench,
        {"q": [0, 0.5], "frame": "tip", "kind": "body", "rows": "vx vz", "residual": [0, 0]},
    ),
    "simulate": (
        arm().simulate,
        {
            "q0": [0, 0], "dq0": [0, 0], "duration": 0.01, "dt": 0.005, "method": "rk4", "tau": [0, 0], "controller": None,
            "wrench_on_robot": {"tip": np.zeros(6)}, "friction": False, "creep": None, "contacts": (), "limits": None,
            "events": (), "rtol": 1e-6, "atol": 1e-6, "max_step": None, "every": 1, "progress": None,
        },
    ),
    "simulated wrench": (lambda F: arm().simulate(duration=0.01, wrench_on_robot={"tip": F}), {"F": np.zeros(6)}),
    "rollout": (
        arm().rollout,
        {
            **MANY, "tau": [0, 0], "dt": 1e-3, "duration": None, "every": 1, "method": "rk4",
            "wrench_on_robot": {"tip": np.zeros(6)}, "parameters": {"tip.mass": 1.0}, "torque_limits": False, "out": None,
        },
    ),
    "rolled PD": (
        lambda **law: arm().rollout(tau=simulation.PD(**law), **MANY),
        {"q_des": [0, 0], "kp": 1.0, "kd": 1.0, "dq_des": 0.0, "gravity": True},
    ),
    "rolled ComputedTorque": (
        lambda **law: arm().rollout(tau=simulation.ComputedTorque(**law), **MANY),
        {"q_des": [0, 0], "kp": 1.0, "kd": 1.0, "dq_des": 0.0, "ddq_des": 0.0},
    ),
    "rolled parameter": (lambda m: arm().rollout(parameters={"tip.mass": m}, **MANY), {"m": 1.0}),
    "rollout.motion": (lambda k: arm().rollout(np.zeros((3, 2)), [0, 0], steps=9).motion(k), {"k": 1}),
    "Plane": (
        lambda **given: arm().simulate(duration=0.01, contacts=simulation.Plane(**given)),
        {
            "frame": "tip", "points": np.zeros(3), "normal": [0, 0, 1.0], "height": -5.0, "stiffness": 1e4, "exponent": 1.5,
            "dissipation": 0.1, "friction": 0.1, "slip": 0.01,
        },
    ),
    "JointStops": (
        lambda **given: tw.robots.panda().simulate(duration=0.002, contacts=simulation.JointStops(**given)),
        {"stiffness": 1e3, "dissipation": 0.1, "exponent": 1.5},
    ),
    "Event": (
        lambda **given: arm().simulate(duration=0.01, events=simulation.Event(**given)),
        {"function": lambda t, q, dq: q[0] - 1, "name": "it", "direction": "both", "terminal": False},
    ),
    "SimulationResult.load": (simulation.SimulationResult.load, {"path": "no/such/file"}),
    "SimulationResult.with_robot": (lambda robot: arm().simulate(duration=0.01).with_robot(robot), {"robot": arm()}),
    "SimulationResult.to_csv": (lambda path: arm().simulate(duration=0.01).to_csv(path), {"path": "no/such/folder/x"}),
    "SimulationResult.plot": (lambda path: arm().simulate(duration=0.01).plot(path), {"path": "no/such/folder/x.png"}),
    "ForceTorqueSensor": (
        sensing.ForceTorqueSensor,
        {"load": tw.SpatialInertia.from_com(1.0), "bias": np.zeros(6), "sign": "on_sensor", "mounting": np.eye(3), "frame": "f"},
    ),
    "predict": (tool().predict, {"pose": np.eye(4), "V": np.zeros(6), "dV": np.zeros(6), "gravity": [0, 0, -9.81]}),
    "compensate": (
        tool().compensate,
        {"readings": np.zeros(6), "pose": np.eye(4), "V": np.zeros(6), "dV": np.zeros(6), "gravity": [0, 0, -9.81]},
    ),
    "contact_wrench": (tool().contact_wrench, {"compensated": np.zeros(6)}),
    "contact_on_plane": (sensing.contact_on_plane, {"F": [0, 0, 0, 0, 0, -9.0], "point": [0, 0, 0.1], "normal": [0, 0, 1]}),
    "contact_on_sphere": (sensing.contact_on_sphere, {"F": [0, 0, 0, 0, 0, -9.0], "centre": [0, 0, 0.1], "radius": 0.05}),
    "contact_nearest": (sensing.contact_nearest, {"F": [0, 0, 0, 0, 0, -9.0], "point": [0, 0, 0.1]}),
    "of_axes": (sensing.CollisionThreshold.of_axes, {"sigma": np.ones(6), "false_alarms": 1e-6, "axes": slice(3, 6)}),
    "of_noise": (sensing.CollisionThreshold.of_noise, {"noise": (0.1, 0.1), "false_alarms": 1e-6, "axes": slice(3, 6)}),
    "of_residuals": (
        sensing.CollisionThreshold.of_residuals,
        {"residuals": np.random.default_rng(0).normal(size=(20, 6)), "false_alarms": 1e-6},
    ),
    "predictive": (
        sensing.CollisionThreshold.predictive,
        {"covariance": np.eye(6), "freedom": np.full(6, 9.0), "false_alarms": 1e-6, "axes": slice(0, 6)},
    ),
    "threshold": (threshold(), {"compensated": np.zeros(6)}),
    "distance": (threshold().distance, {"compensated": np.zeros(6)}),
    "identify": (
        sensing.identify,
        {
            "log": log(), "sign": "on_sensor", "bias": None, "noise": None, "outliers": "trim", "confidence": 0.95,
            "inertia": False,
        },
    ),
    "propose_poses": (
        sensing.propose_poses,
        {"count": 2, "log": log(), "candidates": None, "within": 1.0, "noise": (0.01, 0.3), "gravity": 9.81},
    ),
    "sensing.simulate": (
        sensing.simulate,
        {"sensor": tool(), "poses": 3, "noise": (0.01, 0.3), "motion": None, "touch": None, "rng": 0},
    ),
    "touch": (lambda F: sensing.simulate(tool(), 3, touch={1: F}), {"F": np.zeros(6)}),
    "ReadingLog.from_arrays": (
        sensing.ReadingLog.from_arrays,
        {
            "readings": np.ones((2, 6)), "pose": None, "gravity": np.ones((2, 3)), "V": np.zeros((2, 6)),
            "dV": np.zeros((2, 6)), "time": [0, 1], "name": "log",
        },
    ),
    "ReadingLog.rows": (log().rows, {"which": slice(0, 3)}),
    "ReadingLog.predicted": (log().predicted, {"sensor": tool()}),
    "ReadingLog.compensated": (log().compensated, {"sensor": tool()}),
    "read_log": (sensing.read_log, {"path": "no/such/file", "gravity": [0, 0, -9.81]}),
    "write_log": (sensing.write_log, {"log": log(), "path": "no/such/folder/x.csv"}),
    "read_sensor": (sensing.read_sensor, {"path": "no/such/file"}),
    "write_sensor": (
        sensing.write_sensor,
        {"sensor": tool(), "path": "no/such/folder/x.json", "noise": (0.1, 0.1), "uncertainty": None},
    ),
}  # fmt: skip
"""Functions and arguments that are right."""


@pytest.mark.parametrize("name", CALLS)
def test_junk_is_one_error_of_the_tree_or_a_result(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a text may be a path
    function, good = CALLS[name]
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for argument in good:
            for kind, junk in JUNK.items():
                try:
                    function(**good | {argument: junk})
                except tw.TwistWrenchError as problem:
                    if len(str(problem)) < 20:
                        found.append((argument, kind, f"says little: {problem}"))
                except Exception as problem:
                    found.append((argument, kind, f"{type(problem).__name__}: {problem}"[:90]))
    assert not found, "\n" + "\n".join(map(str, found))


@pytest.mark.parametrize("name", CALLS)
def test_the_right_arguments_are_right(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function, good = CALLS[name]
    if any("no/such" in str(x) for x in good.values()):
        with pytest.raises(tw.TwistWrenchError, match="no/such"):
            function(**good)
    else:
        function(**good)
