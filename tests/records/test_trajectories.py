"""Paths, timings and moves: complete answers on record."""

from __future__ import annotations

import contextlib
import re
import sys
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench import trajectories as planning
from twistwrench.core.errors import PathError
from twistwrench.trajectories import (
    collocation,
    jerk_limited,
    limit_rows,
    move_report,
    move_timing,
    trajectory,
)

timing = sys.modules["twistwrench.trajectories.fastest"]  # the package has a function of that name


pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


records = Records(__file__, listed=24)


def link_text(name, mass, com, moments):
    ixx, iyy, izz, ixy, ixz, iyz = moments
    return f"""<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/><inertia ixx="{ixx}"
    iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial></link>"""


def joint_text(name, kind, parent, child, xyz, axis, limits, dynamics=""):
    lower, upper, velocity, effort = limits
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>
    <axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>{dynamics}</joint>"""


ARM = f"""<robot name="feeder"><link name="stand"/>
{link_text("turret", 4.2, "0.02 -0.03 0.09", (0.04, 0.05, 0.03, 0.002, -0.003, 0.004))}
{link_text("beam", 2.6, "0.22 0.03 -0.04", (0.02, 0.06, 0.05, -0.001, 0.003, 0.002))}
{link_text("ram", 0.9, "0.05 0.02 0.11", (0.004, 0.005, 0.003, 0.0002, -0.0004, 0.0003))}
{joint_text("turn", "revolute", "stand", "turret", "0 0 0.3", "0.1 0 1", (-2.5, 2.1, 1.7, 24), '<dynamics damping="0.8" friction="1.3"/>')}
{joint_text("nod", "revolute", "turret", "beam", "0.1 0 0.2", "0 1 0.2", (-1.4, 1.6, 2.3, 31), '<dynamics damping="0.5" friction="0.9"/>')}
{joint_text("push", "prismatic", "beam", "ram", "0.35 0 0.05", "1 0 0.3", (-0.2, 0.5, 0.9, 40), '<dynamics damping="3" friction="2"/>')}
</robot>"""

BALL = """<mujoco model="pendulum"><worldbody><body name="bob"><inertial pos="0.2 0 -0.5" mass="2" diaginertia="0.5 0.3 0.4"/>
  <joint name="socket" type="ball"/></body></worldbody></mujoco>"""

LOADED = {
    "actuators": {
        "turn": {
            "friction": {
                "viscous": "0.4 N m s/rad",
                "coulomb": "1.1 N m",
                "static": "1.6 N m",
                "stribeck": "0.08 rad/s",
                "load": 0.05,
            }
        },
        "nod": {"friction": {"coulomb": "0.7 N m", "static": "1 N m", "stribeck": "0.1 rad/s"}},
    }
}
COUPLED = {
    "couplings": {
        "pair": {"motors": ["m1", "m2"], "joints": ["turn", "nod"], "motor_per_joint": [[1.0, 0.4], [-0.5, 1.2]]}
    },
    "actuators": {
        "m1": {"ratio": 3, "effort": "40 N m", "friction": {"viscous": "0.3 N m s/rad", "coulomb": "0.6 N m"}},
        "m2": {"ratio": 2, "effort": "45 N m"},
    },
}
START, END = np.array([-0.4, 0.3, 0.1]), np.array([1.1, -0.5, 0.35])


@cache
def arm():
    return tw.load(ARM, gravity=(0.3, -0.4, -9.6))


@cache
def loaded():
    return arm().with_actuators(LOADED)


@cache
def coupled():
    return arm().with_actuators(COUPLED)


@cache
def ball():
    return tw.load(BALL)


@cache
def line():
    return planning.joint_line(arm(), START, END)


@cache
def curve():
    return planning.spline(arm(), [START, [0.2, 0.6, 0.3], [0.7, 0.1, -0.1], END])


S = np.array([0.0, 0.13, 0.4, 0.77, 1.0])


def warned(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    return {"result": result, "warnings": [f"{w.category.__name__}: {w.message}" for w in caught]}


def along(path):
    third = None if path.third is None else path.third(S)
    return [path.name, *path(S), path.knots, third, path.deviation < 1e-7]


@records.of
def paths_of_joints():
    six = [START, [0.1, 0.4, 0.2], [0.2, 0.6, 0.3], [0.5, 0.2, 0.0], [0.7, 0.1, -0.1], END]
    near = [START, [0.2, 0.6, 0.3], [0.2, 0.6, 0.3], END]
    times = [1.0, 1.7, 3.2, 4.0]
    four = [START, [0.2, 0.6, 0.3], [0.7, 0.1, -0.1], END]
    rates = [[0.1, 0, 0], [0.5, -0.2, 0.1], [0.3, 0.4, -0.1], [0, 0.1, 0.2]]
    calls = {
        "one": lambda: planning.spline(arm(), [START]),
        "same": lambda: planning.spline(arm(), near),
        "degree": lambda: planning.spline(arm(), four, degree=4),
        "five of four": lambda: planning.spline(arm(), four, degree=5),
        "five with times": lambda: planning.spline(arm(), six, degree=5, times=np.arange(6.0)),
        "velocities": lambda: planning.spline(arm(), four, velocities=rates),
        "times": lambda: planning.spline(arm(), four, times=[0, 1, 2]),
        "times fall": lambda: planning.spline(arm(), four, times=[0, 2, 1, 3]),
        "times stand": lambda: planning.spline(arm(), four, times=[0, 1, 1, 3]),
        "shape": lambda: planning.spline(arm(), START),
        "columns": lambda: planning.spline(arm(), np.zeros((3, 2))),
        "ball": lambda: planning.spline(ball(), [[1, 0, 0, 0], [0, 1, 0, 0]]),
        "close": lambda: planning.spline(arm(), [[1, 1, 1], [0, 0, 0], [1e-20, 0, 0]]),
        "rates": lambda: planning.spline(arm(), four, times=times, velocities=rates[:3]),
        "no motion": lambda: planning.joint_line(arm(), START, START),
        "still": lambda: planning.joint_line(tw.load('<robot name="s"><link name="a"/></robot>'), [], []),
        "still spline": lambda: planning.spline(tw.load('<robot name="s"><link name="a"/></robot>'), np.zeros((2, 0))),
        "q": lambda: planning.joint_line(arm(), START[:2], END),
        "robot": lambda: planning.joint_line(3, START, END),
        "no path": lambda: planning.fitted(arm(), line()(0.5)),
    }
    return {
        "line": along(line()),
        "ball": along(planning.joint_line(ball(), [1, 0, 0, 0], [0.5, 0.5, -0.5, 0.5])),
        "one place": [x.shape for x in line()(0.3)],
        "spline": along(curve()),
        "degree 5": along(planning.spline(arm(), six, degree=5)),
        "times": along(planning.spline(arm(), four, times=times)),
        "times of stops": along(planning.spline(arm(), near, times=times)),
        "velocities": along(planning.spline(arm(), four, times=times, velocities=rates)),
        "refused": {label: refusal(call) for label, call in calls.items()},
    }


@cache
def six_axis():
    return tw.robots.ur5()


WORK = np.array([0.3, -1.2, 1.6, -0.8, 1.3, 0.4])


@records.of(relative=1e-5)
def paths_of_poses():
    robot = six_axis()
    T = robot.forward_kinematics(WORK)
    end = T @ tw.se3.exp([0.1, 0.2, -0.3, 0.05, -0.1, 0.08])
    found = {}
    for label, poses in (("straight", planning.straight_path(T, end)), ("screw", planning.screw_path(T, end))):
        path = planning.follow_poses(robot, poses, WORK, tolerance=1e-6)
        q, dq, ddq = path(S)
        found[label] = [path.name, q, dq, ddq, path.deviation < 1e-6, path.third(S), path.knots]
    found["frame"] = planning.follow_poses(
        robot,
        planning.straight_path(*robot.forward_kinematics([WORK, WORK + 0.05], "wrist_3_link")),
        WORK,
        "wrist_3_link",
        tolerance=1e-5,
    )(S)[0]

    def shifted(x, y, z):
        target = T.copy()
        target[:3, 3] += [x, y, z]
        return planning.straight_path(T, target)

    failures = {
        "out of reach": lambda: planning.follow_poses(robot, shifted(1.5, 0, 0), WORK, tolerance=1e-4),
        "a limit": lambda: planning.follow_poses(limited(0.4), shifted(0, 0.15, 0), WORK, tolerance=1e-4),
        "a limit soon": lambda: planning.follow_poses(limited(0.305), shifted(0.0, 0.4, 0), WORK, tolerance=1e-4),
        "begins outside": lambda: planning.follow_poses(limited(0.25), shifted(0.1, 0, 0), WORK),
        "start": lambda: planning.follow_poses(robot, planning.straight_path(end, T), WORK),
        "tolerance": lambda: planning.follow_poses(robot, shifted(0.1, 0, 0), WORK, tolerance=1e-11),
        "tolerance inf": lambda: planning.follow_poses(robot, shifted(0.1, 0, 0), WORK, tolerance=np.inf),
        "no function": lambda: planning.follow_poses(robot, T, WORK),
        "fails": lambda: planning.follow_poses(robot, lambda s: 1 / 0, WORK),
        "shape": lambda: planning.follow_poses(robot, lambda s: np.tile(T, (2, 1, 1)), WORK),
        "no pose": lambda: planning.follow_poses(robot, lambda s: np.ones((len(s), 4, 4)), WORK),
        "not finite": lambda: planning.follow_poses(robot, lambda s: np.nan * np.ones((len(s), 4, 4)), WORK),
        "ball": lambda: planning.follow_poses(ball(), lambda s: s, [1, 0, 0, 0]),
        "q0": lambda: planning.follow_poses(robot, shifted(0.1, 0, 0), WORK[:5]),
    }
    for label, call in failures.items():
        try:
            call()
        except PathError as error:
            partial = None if error.partial is None else error.partial(np.array([0.0, 1.0]))[0]
            found[label] = [str(error)[:90], round(float(error.reached), 3), None if partial is None else partial.shape]
        except Exception as error:
            found[label] = f"{type(error).__name__}: {error}"
    return found


def limited(upper=0.45):
    text = six_axis().to_urdf()
    name = 'joint name="shoulder_pan_joint"'
    place = text.index("upper=", text.index(name))
    end = text.index('"', place + 7)
    return tw.load(text[:place] + f'upper="{upper}' + text[end:])


@records.of
def steps_along_poses():
    """Newton's method to one pose and its reasons to stop, and what singular configurations look like."""
    from twistwrench.trajectories import paths

    robot = six_axis()
    T = robot.forward_kinematics(WORK)
    far = T.copy()
    far[:3, 3] += [2.0, 0.0, 0.0]
    tight = limited(0.45)
    beyond = robot.forward_kinematics(WORK + np.array([0.3, 0, 0, 0, 0, 0]))
    below = robot.forward_kinematics(WORK - np.array([0, 0, 0, 0, 0, 0.02]))
    jump = robot.forward_kinematics(WORK + np.array([0.0, 0, 0, 0, 0, 0.7]))
    J = robot.jacobian([WORK, [0.3, -1.2, 0.0, -0.8, 1.3, 0.4], [0.3, -1.2, 1.6, -0.8, 0.02, 0.4]])
    return {
        "reached": paths._newton(robot, robot.forward_kinematics(WORK + 0.05), WORK, WORK, None),
        "far": paths._newton(robot, far, WORK, WORK, None)[1],
        "limit": paths._newton(tight, beyond, WORK, WORK, None)[1],
        "below": paths._newton(tight, below, WORK, WORK, "tool0")[1],
        "jump": paths._newton(robot, jump, WORK, WORK, None)[1],
        "reasons": [paths._reason_without_solution(j) for j in (*J, J[0][:4], J[0][:, :5])],
        "numbers": [
            paths._FIRST_INTERVALS,
            paths._MAX_INTERVALS,
            paths._MAX_INTERVALS_AFTER_FAILURE,
            paths._MIN_PARTIAL_POINTS,
        ],
    }


# ── trajectories ──


@records.of
def motions_in_time(folder):
    found = {}
    scalings = {
        "quintic": planning.quintic(1.4),
        "cubic": planning.cubic(1.4),
        "s-curve": planning.s_curve(1.4),
        "trapezoid": planning.trapezoid(v=1.2, duration=1.4),
        "uniform": planning.uniform(1.4),
    }
    t = np.array([-0.1, 0.0, 0.2, 0.61, 1.1, 1.4, 1.6])
    for label, scaling in scalings.items():
        motion = planning.Trajectory(arm(), curve(), scaling, friction=True)
        has_jerk = hasattr(scaling, "third")
        jerk = motion.jerk(t[1:6]) if has_jerk else refusal(lambda m=motion: m.jerk(0.5))
        found[label] = [motion.duration, *motion(t), jerk]
    motion = planning.Trajectory(arm(), line(), scalings["quintic"])
    for dt in (0.35, 0.5, 1.4, 3.0, 1.4 / 3, 1.4 / 3 * (1 + 1e-13)):
        sampled = motion.sample(dt)
        found[f"every {dt:.6g}"] = [sampled.time, sampled.q, sampled.dq, sampled.ddq]
    file = motion.to_csv(folder / "m.csv", 0.7, degrees=True)
    found["file"] = file.read_text().splitlines()
    found["step of a file"] = len(motion.to_csv(folder / "n.csv").read_text().splitlines())
    plain = replace(line(), third=None)
    found["refused"] = {
        "no third": refusal(lambda: planning.Trajectory(arm(), plain, scalings["quintic"]).jerk(0.1)),
        "dt": refusal(lambda: motion.sample(0.0)),
        "dt inf": refusal(lambda: motion.sample(np.inf)),
        "dt small": refusal(lambda: motion.sample(1.3e-8)),
        "scaling": refusal(lambda: planning.Trajectory(arm(), line(), 3.0)),
        "scaling's class": refusal(lambda: planning.Trajectory(arm(), line(), SimpleNamespace)),
        "path": refusal(lambda: planning.Trajectory(arm(), START, scalings["cubic"])),
        "robot": refusal(lambda: planning.Trajectory(3, line(), scalings["cubic"])),
        "another robot": refusal(lambda: planning.Trajectory(tw.robots.planar_2r(), line(), scalings["cubic"])),
        "t": refusal(lambda: motion("now")),
    }
    return found


@records.of
def limits_exceeded():
    motion = planning.Trajectory(loaded(), curve(), planning.quintic(0.5))
    tight = planning.bounds_of(
        loaded(),
        velocity=[0.7, 2.0, 0.4],
        acceleration=3.0,
        deceleration=[2.0, 4.0, 1.0],
        jerk=[20.0, 30.0, np.inf],
        effort=[10.0, 60.0, 9.0],
    )
    slow = planning.Trajectory(arm(), line(), planning.cubic(4.0))
    outside = planning.move(arm(), START, [1.1, -1.9, 0.35], planning.quintic(3.0))
    return {
        "own": [str(v) for v in motion.violations()],
        "tight": motion.violations(tight),
        "friction": [str(v) for v in planning.violations(loaded(), motion, tight, friction=True)],
        "few samples": [str(v) for v in planning.violations(loaded(), motion, tight, samples=3)],
        "two samples": [str(v) for v in planning.violations(loaded(), motion, tight, samples=2)],
        "none": slow.violations(),
        "position": [str(v) for v in outside.violations()],
        "of a motion": [str(v) for v in planning.violations(loaded(), motion.sample(0.01), tight)],
        "passed": trajectory.positions_passed(arm(), S, outside.path(S)[0], arm().limits),
        "torques": trajectory.required_torques(loaded(), *_state_rows(motion), friction=True),
        "refused": [
            refusal(lambda: planning.violations(arm(), 3)),
            planning.violations(arm(), motion, samples=1),
            refusal(lambda: planning.violations(arm(), motion, samples=0)),
            refusal(lambda: planning.violations(arm(), motion, friction="yes")),
        ],
    }


def _state_rows(motion):
    t = np.linspace(0.0, motion.duration, 5)
    return t, *motion(t)


@records.of(relative=1e-6)
def timings_fitted_to_limits():
    found = {}
    wide = replace(arm().limits, acceleration=np.array([4.0, np.inf, 3.0]), deceleration=np.array([2.5, np.inf, 3.5]))
    jerky = replace(arm().limits, jerk=np.array([30.0, np.inf, 8.0]))
    for label, robot, path, shape, bounds, friction in (
        ("line", arm(), line(), None, None, False),
        ("friction", arm(), line(), None, None, True),
        ("curve", arm(), curve(), planning.cubic(3.0), None, False),
        ("trapezoid", arm(), line(), planning.trapezoid(v=1.5, duration=1.0), wide, False),
        ("s-curve", arm(), line(), planning.s_curve(2.0), jerky, True),
        ("uniform", arm(), line(), planning.uniform(1.0), None, False),
        ("loaded", loaded(), curve(), None, wide, True),
        ("loaded, without friction", loaded(), curve(), None, wide, False),
        ("coupled", coupled(), line(), None, None, True),
    ):
        scaling = planning.fitted(robot, path, shape, bounds, friction=friction)
        found[label] = [scaling.name, scaling.duration]
        times = np.array([0.0, 0.1, 0.37, 0.5, 0.81, 1.0])
        unit = (planning.quintic(1.0) if shape is None else shape).stretched(1.0)
        with np.errstate(all="ignore"):
            found[label].append(
                trajectory.shortest_durations(robot, path, unit, bounds or robot.limits, times, friction=friction)
            )
    moved = [
        planning.move(arm(), START, END),
        planning.move(arm(), START, END, waypoints=[[0.2, 0.6, 0.3]]),
        planning.move(arm(), START, END, planning.cubic(2.0), waypoints=[0.2, 0.6, 0.3]),
    ]
    found["moved"] = [[m.duration, m.path.name, m(0.4)[0]] for m in moved]
    free = replace(arm().limits, velocity=np.full(3, np.inf), effort=np.full(3, np.inf))
    found["peaks"] = [
        trajectory._times_around_peaks(np.array([0.0, 0.1, 0.3, 0.6, 1.0]), np.array(durations))
        for durations in ([1.0, 3.0, 2.0, 1.5, 1.2], [5.0, 1.0, 0.5, 0.2, 0.1], [0.1, 0.2, 0.3, 0.4, 6.0])
    ]
    times = np.linspace(0, 1, 40)
    found["many peaks"] = trajectory._times_around_peaks(times, np.sin(60 * times) + times)
    weak = replace(arm().limits, effort=np.array([24.0, 9.0, 40.0]))
    cornered = planning.spline(arm(), [START, [0.2, 0.6, 0.3], END], times=[0, 1, 2], velocities=np.zeros((3, 3)) + 0.2)
    found["refused"] = {
        "nothing limits": refusal(lambda: planning.fitted(arm(), line(), None, free)),
        "stands": refusal(lambda: planning.fitted(arm(), line(), None, weak)),
        "stands with friction": refusal(
            lambda: planning.fitted(
                loaded(), line(), None, replace(weak, effort=np.array([24.0, 11.0, 40.0])), friction=True
            )
        ),
        "jerk at the ends": refusal(lambda: planning.fitted(arm(), line(), planning.cubic(1.0), jerky)),
        "jerk, uniform": refusal(lambda: planning.fitted(arm(), line(), planning.uniform(1.0), jerky)),
        "jerk on the way": refusal(lambda: planning.fitted(arm(), cornered, None, jerky)),
        "shape": refusal(lambda: planning.fitted(arm(), line(), 2.0)),
        "friction": refusal(lambda: planning.fitted(arm(), line(), friction="all")),
        "waypoints": refusal(lambda: planning.move(arm(), START, END, waypoints=[[0.1, 0.2]])),
    }
    return found


# ── fastest timings ──


@cache
def braked():
    return planning.fastest(
        arm(),
        curve(),
        acceleration=[4.0, 6.0, 2.0],
        deceleration=[3.0, 6.0, 5.0],
        velocity=[1.2, 2.0, 0.6],
        effort=[22, 30, 35],
    )


@cache
def rubbed():
    return planning.fastest(arm(), line(), friction=True)


@records.of(relative=1e-5)
def fastest_timings():
    found = {}
    for label, build in (("braked", braked), ("friction", rubbed)):
        motion = build()
        t = np.linspace(0.0, motion.duration, 9)
        curves = motion.limit_curves(21)
        found[label] = {
            "text": str(motion),
            "duration": motion.duration,
            "positions": motion(t)[0],
            "velocities": motion(t)[1],
            "contacts": [[c.joint, c.kind, c.side, c.begin, c.end, c.s] for c in motion.limit_contacts],
            "shares": motion.shares(t[1:-1] + 0.003).round(4),
            "curves": [curves.s[::3], curves.torque[::3], curves.velocity[::3], curves.path[0][::29], curves.switches],
            "bounds": motion.bounds,
            "slower": motion.slower,
            "friction": motion.friction,
            "scaling": [motion.scaling.name, motion.scaling([-1.0, 0.1, np.nan, 99.0])],
        }
    coupling = planning.fastest(coupled(), line(), friction=True)
    found["coupled"] = [str(coupling), coupling.duration, [[c.joint, c.kind, c.side] for c in coupling.limit_contacts]]
    weightless = planning.fastest(
        arm().with_gravity([0, 0, 0]), line(), effort=[np.inf, np.inf, np.inf], acceleration=[3.0, np.inf, 1.0]
    )
    found["accelerations alone"] = [str(weightless), weightless.duration]
    return found


@records.of
def fastest_timings_refused():
    stopping = planning.spline(arm(), [START, [0.2, 0.6, 0.3], END], times=[0, 1, 2])
    outside = planning.joint_line(arm(), START, [1.1, -1.9, 0.35])
    free = {"effort": np.inf, "velocity": np.inf}
    calls = {
        "path": lambda: planning.fastest(arm(), START),
        "robot": lambda: planning.fastest(3, line()),
        "friction": lambda: planning.fastest(arm(), line(), friction=2),
        "static friction": lambda: planning.fastest(loaded(), line(), friction=True),
        "stands still": lambda: planning.fastest(arm(), stopping),
        "nothing limits": lambda: planning.fastest(arm(), line(), effort=np.inf, velocity=1.0),
        "nothing at all": lambda: planning.fastest(arm(), line(), **free),
        "cannot hold": lambda: planning.fastest(arm(), line(), effort=[24, 9, 40]),
        "cannot hold friction": lambda: planning.fastest(arm(), line(), effort=[24, 10.9, 40], friction=True),
        "limit": lambda: planning.fastest(arm(), line(), velocity=-1.0),
        "limits": lambda: planning.fastest(arm(), line(), velocity=[1.0, 2.0]),
    }
    found = {}
    for label, call in calls.items():
        try:
            found[label] = str(call())
        except Exception as error:
            found[label] = f"{type(error).__name__}: {error}"
    found["outside"] = [text[:160] for text in warned(lambda: planning.fastest(arm(), outside).duration)["warnings"]]
    return found


@records.of(relative=1e-6)
def rows_of_limits_along_a_path():
    found = {}
    bounds = replace(arm().limits, acceleration=np.array([4.0, np.inf, 2.0]), deceleration=np.array([3.0, np.inf, 2.0]))
    for label, robot, friction in (("arm", arm(), True), ("coupled", coupled(), True), ("plain", arm(), False)):
        rows = limit_rows.PathRows(robot, curve(), bounds, friction=friction)
        s = np.array([0.0, 0.21, 0.5, 0.86, 1.0])
        at = rows.at(s)
        x = np.array([0.1, 1.2, 3.0, 40.0, 0.0])
        cap = rows.cap(s)
        found[label] = {
            "rows": [[r.kind, r.joint] for r in rows.rows],
            "caps": [[r.kind, r.joint] for r in rows.caps],
            "L": rows.L,
            "flat": rows.flat,
            "at": [at.a, at.b, at.c, at.d, at.cap],
            "values": at.values(np.linspace(-1, 2, 5), x),
            "accelerations": rows.accelerations(at, x),
            "breaks": rows.breaks,
            "cap": [cap.x, cap.velocity, cap.torque],
            "part": rows.at(s, 0.2, 0.7).c,
            "falls": timing._limit_curve_falls(rows, s[1:4]),
            "grid": rows.grid.shape,
            "reachable": timing._reachable(rows).effort,
        }
    still = np.array([0.5, 0.5, 0.5])
    sliding = planning.joint_line(arm(), still, still + np.array([0.0, 0.0, -0.3]))
    bare = replace(arm().limits, acceleration=np.array([4.0, 5.0, 2.0]), deceleration=np.array([4.0, 5.0, 2.0]))
    rows = limit_rows.PathRows(arm(), sliding, bare)
    found["one joint"] = [rows.flat, [[r.kind, r.joint] for r in rows.caps], rows.cap(np.array([0.3])).x, rows.breaks]
    zeros = limit_rows.PathRows(arm(), line(), bare)
    grid = zeros.grid
    found["zeros"] = [
        zeros._zeros(np.sin(9 * grid) - 0.2, lambda s: np.sin(9 * s) - 0.2),
        zeros._zeros(np.where(np.abs(grid - 0.5) < 1e-9, 0.0, grid - 0.5), lambda s: s - 0.5),
        zeros._zeros(np.zeros_like(grid), lambda s: 0 * s),
        zeros._zeros(np.maximum(grid - 0.3, 0.0), lambda s: np.maximum(s - 0.3, 0)).shape,
    ]
    tight = replace(arm().limits, effort=np.array([24.0, 9.5, 8.0]))
    rough = replace(arm().limits, effort=np.array([24.0, 10.5, 9.0]))
    found["standing"] = refusal(lambda: limit_rows.PathRows(arm(), curve(), tight).require_standing())
    found["standing with friction"] = refusal(
        lambda: limit_rows.PathRows(arm(), curve(), rough, friction=True).require_standing()
    )
    low = replace(arm().limits, acceleration=np.array([3.0, 3.0, 3.0]), velocity=np.full(3, 1e-4))
    found["reachable"] = [timing._reachable(limit_rows.PathRows(arm(), line(), b)).effort for b in (low, arm().limits)]
    return found


@records.of(relative=1e-7)
def pieces_of_fastest_timings():
    rows = limit_rows.PathRows(arm(), line(), arm().limits)
    found = {"nodes": [collocation.NODES, collocation.INTEGRALS, collocation.POINTS, collocation._FLIP]}
    for label, s, x, h, way, caps in (
        ("from rest", 0.0, 0.0, 0.05, 1, True),
        ("back from rest", 1.0, 0.0, 0.05, -1, False),
        ("on the way", 0.3, 2.0, 0.02, 1, True),
        ("on the way back", 0.3, 2.0, 0.02, -1, True),
        ("at a cap", 0.4, float(rows.cap(np.array([0.4])).x[0]), 0.05, 1, True),
        ("too fast", 0.4, 40.0, 0.05, 1, False),
        ("too long", 0.0, 0.0, 0.9, 1, False),
    ):
        cell, lacks = collocation.try_cell(rows, s, x, h, way, along_caps=caps)
        found[label] = (
            [lacks]
            if cell is None
            else [lacks, cell.low, cell.high, cell.x, cell.active.kind, cell.active.joint, cell.side]
        )
    cell = collocation.Cell(0.2, 0.7, np.array([1.0, -0.5, 0.25, 0.125, 0.0, -0.1]), limit_rows.Row("torque", 1), -1)
    later = cell.since(0.3)
    slow = collocation.Cell(0.7, 1.0, np.array([0.775, -0.5, -0.275, 0.0, 0.0, 0.0]), limit_rows.Row("velocity", 0), 1)
    first = collocation.Cell(0.0, 0.2, np.array([0.0, 0.6, 0.4, 0.0, 0.0, 0.0]), limit_rows.Row("velocity", 0), 1)
    scaling = collocation.FastestScaling((first, cell, slow))
    t = np.linspace(-0.1, scaling.duration + 0.1, 9)
    found["cell"] = [cell.at(np.array([0.2, 0.4, 0.7])), later.low, later.x, later.at(np.array([0.4, 0.7]))]
    found["scaling"] = [scaling.times, scaling.duration, scaling(t), scaling(0.4), scaling([np.nan])]
    arc = timing.Arc((first, cell))
    found["arc"] = [
        arc.low,
        arc.high,
        arc.at(np.array([0.1, 0.2, 0.5])),
        timing._reaches(arc, 0.5, 0.9),
        timing._reaches(arc, 0.5, 0.1),
    ]
    found["solved"] = [
        collocation._solve(np.array([2.0 * np.eye(5)]), np.arange(5.0)[None]),
        collocation._solve(np.ones((1, 5, 5)), np.ones((1, 5))) @ np.ones(5),
    ]
    return found


@records.of(relative=1e-6)
def timings_with_limits_of_jerk():
    """The parts of a search for two windows of an average, and of its improvement."""
    nodes = np.linspace(0.0, 1.0, 11)
    rates = np.sqrt(np.array([0, 1.0, 2.2, 3.0, 2.0, 1.2, 1.5, 2.4, 1.8, 0.7, 0]))
    found = {"coasts": [jerk_limited.with_coasts(nodes, rates, d) for d in (0.02, 0.15, 0.6)]}

    def durations(shape):
        t = np.linspace(0.0, 1.0, 41)
        _, ds, dds = shape.stretched(1.0)(t)
        third = np.gradient(dds, t)
        return np.maximum(np.maximum(np.abs(ds), np.sqrt(np.abs(dds) / 3.0)), np.cbrt(np.abs(third) / 40.0))

    chosen = jerk_limited._choose_windows(nodes, rates, durations)
    found["windows"] = [chosen.name, chosen.windows, chosen.duration]
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "_KNOT_COUNT": 6,
            "_SHAPE_NODE_COUNT": 31,
            "_SHAPE_SAMPLE_COUNT": 201,
            "_MAX_PROGRAMMES": 3,
        }.items():
            patch.setattr(jerk_limited, name, value)
        better = jerk_limited._improve(chosen, durations)
    found["improved"] = [
        durations(better).max() < durations(chosen).max(),
        better.name,
        round(float(durations(better).max()), 3),
    ]
    found["numbers"] = [
        jerk_limited._MIN_WINDOW, jerk_limited._MIN_NODE_INTERVAL, jerk_limited._SAMPLE_COUNT, jerk_limited._GRID_SIZE,
        jerk_limited._KNOT_COUNT, jerk_limited._FIRST_TRUST, jerk_limited._MIN_TRUST, jerk_limited._TRUST_DIVISOR,
    ]  # fmt: skip
    return found


@records.of(relative=1e-3)
def a_fastest_move_with_limits_of_jerk():
    with pytest.MonkeyPatch.context() as patch:
        small = {
            "_GRID_SIZE": 4,
            "_MAX_SIMPLEX_TRIALS": 8,
            "_KNOT_COUNT": 4,
            "_SHAPE_NODE_COUNT": 41,
            "_SHAPE_SAMPLE_COUNT": 201,
            "_MAX_PROGRAMMES": 1,
            "_SAMPLE_COUNT": 101,
        }
        for name, value in small.items():
            patch.setattr(jerk_limited, name, value)
        motion = planning.fastest(arm(), line(), jerk=[60.0, np.inf, 15.0])
    curves = motion.limit_curves(15)
    return {
        "duration": motion.duration,
        "text": str(motion).split(" s, ")[1][-40:],
        "contacts": motion.limit_contacts,
        "within": bool((motion.shares(np.linspace(0, motion.duration, 60)) <= 1 + 1e-6).all()),
        "curves": [curves.switches, curves.path[0][[0, 7, 14]], len(curves.s)],
        "quick": motion.time_optimal.duration,
    }


# ── moves ──


def moved(report):
    data = {key: entry for key, entry in report.to_dict().items() if key not in ("version", "schema")}
    return {
        "text": str(report).splitlines(),
        "verdict": str(report.verdict),
        "data": {key: data[key] for key in ("exit_code", "facts", "remedies", "notes")},
        "subject": [report.subject, report.brief, report.robot_name, report.friction, report.assumed],
    }


@records.of(relative=1e-6)
def moves_of_joints(folder):
    with contextlib.chdir(folder):  # reports break long paths
        return _moves_of_joints(Path())


def _moves_of_joints(folder):
    q1 = {"turn": 1.1, "nod": -0.5, "push": 0.35}
    box = tw.SpatialInertia.from_com(0.8, (0.02, 0.0, 0.03))
    file = folder / "limits.csv"
    file.write_text("joint,velocity,acceleration,jerk\\nturn,1.5,4,\\npush,0.5,2,30\\n".replace("\\n", "\n"))
    points = folder / "points.csv"
    points.write_text("push,turn,nod\n0.3,11.5,34.4\n0.0,40.1,5.7\n")
    none = tw.load(ARM.replace('velocity="1.7" effort="24"', 'velocity="0" effort="0"'))
    loose = tw.load(
        ARM.replace('type="revolute"', 'type="continuous"')
        .replace('lower="-2.5" upper="2.1" velocity="1.7" effort="24"', "")
        .replace("<limit />", "")
    )
    calls = {
        "plain": lambda: tw.move(arm(), q1, start=START),
        "from neutral": lambda: tw.move(arm(), [1.1, -0.5, 0.35]),
        "degrees": lambda: tw.move(
            arm(), {"turn": 60, "nod": -30, "push": 0.3}, start=[-20, 15, 0.1], degrees=True, duration=0.6
        ),
        "cubic": lambda: tw.move(arm(), q1, start=START, scaling="cubic", friction=False),
        "trapezoid": lambda: tw.move(arm(), q1, scaling="trapezoid", payload=box),
        "s-curve": lambda: tw.move(arm(), q1, scaling="s-curve", jerk=40.0),
        "too short": lambda: tw.move(arm(), q1, start=START, duration=0.3),
        "file of limits": lambda: tw.move(arm(), q1, limits=file),
        "uniform limits": lambda: tw.move(arm(), q1, acceleration=1.5, limits=file),
        "limits by joint": lambda: tw.move(arm(), q1, limits={"turn": 20.0, "nod": 50.0}),
        "waypoints": lambda: tw.move(arm(), q1, start=START, waypoints=[[0.2, 0.6, 0.3]]),
        "file of waypoints": lambda: tw.move(
            arm(), [63, -29, 0.35], start=[-23, 17, 0.1], waypoints=points, degrees=True
        ),
        "fastest": lambda: tw.move(arm(), q1, start=START, fastest=True),
        "fastest in degrees": lambda: tw.move(
            arm(), [63, -29, 0.35], fastest=True, degrees=True, friction=False, payload=[0.3, 0.5]
        ),
        "outside": lambda: tw.move(arm(), [1.1, -1.9, 0.35], duration=4),
        "heavy": lambda: tw.move(arm(), q1, payload=12.0),
        "no velocity": lambda: tw.move(loose, [1.1, -0.5, 0.35], duration=2.0),
        "no limits": lambda: tw.move(none, [1.1, -0.5, 0.35], duration=2.0),
        "degrees meant": lambda: tw.move(arm(), [90, -45, 0.3], duration=9.0),
        "coupled": lambda: tw.move(coupled(), q1, start=START),
        "floating": lambda: tw.move(tw.load(ARM, floating_base=True), [1, 0, 0, 0, 0.1, 0, 0, *END], duration=3.0),
        "clearance": lambda: tw.move(arm(), q1, start=START, clearance=0.01),
    }
    found = {}
    for label, call in calls.items():
        try:
            report = call()
        except Exception as error:
            found[label] = f"{type(error).__name__}: {error}"
            continue
        found[label] = moved(report)
        if label in ("degrees", "coupled", "fastest"):
            found[label]["uses"] = report.uses
            moment = __import__("twistwrench.trajectories.move_view", fromlist=["x"]).worst_moment(
                report, report.trajectory
            )
            found[label]["worst"] = [moment[0], moment[1], moment[2]]
    report = calls["degrees"]()
    found["motion"] = [report.motion.time[-2:], report.motion.q[-1]]
    found["file"] = [
        len(report.to_csv(folder / f"r{k}.csv", step).read_text().splitlines()) for k, step in enumerate((None, 0.1))
    ]
    found["first rows"] = report.to_csv(folder / "r.csv", 0.3).read_text().splitlines()
    found["origin"] = [getattr(entry, "name", type(entry).__name__) for entry in report.origin()]
    found["sources"] = sorted(calls["file of limits"]().sources())
    return found


@records.of(relative=1e-5)
def moves_of_the_tip():
    robot = six_axis()
    calls = {
        "by": lambda: tw.move(robot, start=WORK, by=[0.05, -0.04, 0.03], friction=False),
        "line": lambda: tw.move(robot, WORK + 0.05, start=WORK, path="line", fastest=False),
        "screw": lambda: tw.move(robot, WORK + 0.05, start=WORK, path="screw", duration=1.2),
        "ends early": lambda: tw.move(robot, start=WORK, by=[1.2, 0.0, 0.0], fastest=True),
        "ends at once": lambda: tw.move(limited(0.302), start=WORK, by=[0.0, 0.5, 0.0]),
    }
    found = {}
    for label, call in calls.items():
        report = call()
        result = moved(report)
        if label in ("ends early", "ends at once"):
            result = [result["verdict"][:60], result["subject"][0]]
        found[label] = result
    return found


@records.of
def moves_refused(folder):
    q1 = [1.1, -0.5, 0.35]
    bad = folder / "bad.csv"
    bad.write_text("turn,nod\n0.1,0.2\n")
    empty = folder / "empty.csv"
    empty.write_text("turn,nod,push\n")
    calls = {
        "step": lambda: tw.move(arm(), q1, step=0.0),
        "fastest and duration": lambda: tw.move(arm(), q1, fastest=True, duration=1.0),
        "srdf": lambda: tw.move(arm(), q1, srdf="a.srdf"),
        "path": lambda: tw.move(arm(), q1, path="arc"),
        "scaling": lambda: tw.move(arm(), q1, scaling="sine"),
        "to and by": lambda: tw.move(arm(), q1, by=[0, 0, 0.1]),
        "no end": lambda: tw.move(arm()),
        "by and path": lambda: tw.move(arm(), by=[0, 0, 0.1], path="line"),
        "waypoints of the tip": lambda: tw.move(arm(), q1, path="line", waypoints=[q1]),
        "waypoints and by": lambda: tw.move(arm(), by=[0, 0, 0.1], waypoints=[q1]),
        "columns": lambda: tw.move(arm(), q1, waypoints=bad),
        "no row": lambda: tw.move(arm(), q1, waypoints=empty),
        "no file": lambda: tw.move(arm(), q1, waypoints=folder / "none.csv"),
        "same": lambda: tw.move(arm(), START, start=START),
        "name": lambda: tw.move("feedr", q1),
        "by of two": lambda: tw.move(six_axis(), start=WORK, by=[0.1, 0.2]),
        "nothing limits": lambda: tw.move(tw.robots.planar_2r(), [1.0, 0.5]),
        "contradiction": lambda: tw.move(arm(), q1, limits={"turn": 1e9}),
        "acceleration": lambda: tw.move(arm(), q1, acceleration=-1.0),
        "no motion to write": lambda: tw.move(arm(), q1, payload=40.0).to_csv(folder / "x.csv"),
    }
    found = {}
    for label, call in calls.items():
        try:
            result = call()
            found[label] = [str(result.verdict), result.subject, str(result).splitlines()]
        except Exception as error:
            found[label] = f"{type(error).__name__}: {error}"
    return found


@records.of
def verdicts_on_moves():
    hanging = tw.robots.quadruped()
    problem = PathError("the robot cannot hold itself on this path: x", reached=0.5)
    limits = arm().limits
    found = {
        "untimed": [
            [str(part) for part in move_timing.untimed_verdict(problem, robot, can_stand=stands)]
            for robot in (arm(), hanging)
            for stands in (True, False)
        ],
        "stands": [
            move_timing.can_stand(arm(), line(), replace(limits, effort=np.array([24.0, e, 40.0])))
            for e in (9.0, 13.0, 20.0, 31.0)
        ],
        "waypoints": [
            move_timing.read_waypoints(arm(), [10.0, 20.0, 0.3], degrees=True),
            move_timing.read_waypoints(arm(), [[10.0, 20.0, 0.3], [1, 2, 3]], degrees=False),
        ],
    }
    motion = planning.Trajectory(arm(), curve(), planning.quintic(0.4))
    violations = motion.violations()
    found["certain"] = [
        [[str(v) for v in certain], doubts]
        for certain, doubts in (move_timing.certain_violations(violations, robot) for robot in (arm(), hanging))
    ]
    found["shares"] = [
        move_report._share(-3.0, 4.0),
        move_report._share(2.0, np.inf),
        move_report._peak(np.array([1.0, -3.0, 2.5])),
    ]
    found["bounds"] = [
        move_report._with_uniform_limits(arm(), limits, a, j).__dict__[kind]
        for a, j in ((2.0, None), (None, 9.0), (None, None))
        for kind in ("acceleration", "deceleration", "jerk")
    ]
    return found


@records.of(relative=1e-5)
def views_of_moves_that_are_rare():
    """Collisions, doubts about a hanging base, and limits of jerk, with stand-ins for what takes long to compute."""
    from twistwrench.core.verdict import Verdict, Word
    from twistwrench.trajectories import move_view, paths

    report = tw.move(arm(), END, start=START, duration=1.9)
    near = SimpleNamespace(
        verdict=Verdict(Word.COLLISION, ("beam and stand touch",)), lines=["Closest links: beam and stand."]
    )
    unsure = SimpleNamespace(verdict=Verdict(Word.UNSURE, ("clearance not known",)), lines=[])
    motion = braked()
    slower = replace(motion, time_optimal=rubbed(), scaling=planning.quintic(3.3))
    ended = replace(report, early_end="nod reaches its limit.")
    found = {
        "collision": moved(replace(report, clearance=near)),
        "collision and early end": moved(replace(ended, clearance=near))["text"][:6],
        "unsure": moved(replace(report, clearance=unsure))["text"][:4],
        "early end": moved(ended)["text"][:5],
        "over limit in degrees": moved(replace(tw.move(arm(), END, duration=0.3), degrees=True))["text"][:7],
        "slower": [slower.price_of_jerk, round(slower.slower, 6), str(slower), slower.limit_contacts],
        "slower in a view": moved(replace(report, trajectory=slower))["text"][:3],
        "own limits": [
            str(
                replace(
                    motion,
                    bounds=replace(motion.bounds, acceleration=np.full(3, 5.0), jerk=np.full(3, j)),
                    robot=_limited_arm(),
                )
            )
            for j in (9.0, 11.0)
        ],
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(move_view, "_MAX_LISTED_CONTACTS", 3)
        found["timeline"] = moved(replace(report, trajectory=motion))["text"][-9:]
        patch.setattr(move_timing, "base_doubts", lambda model: ["nothing holds the base"])
        problem = PathError("cannot hold", reached=0.5)
        found["hanging"] = [str(part) for part in move_timing.untimed_verdict(problem, arm(), can_stand=False)]
        violations = planning.Trajectory(arm(), curve(), planning.quintic(0.4)).violations()
        for label, some in (("torques", violations), ("no torques", [v for v in violations if v.kind != "torque"])):
            certain, doubts = move_timing.certain_violations(tuple(some), arm())
            found[f"certain of {label}"] = [[str(v) for v in certain], doubts]
        patch.setattr(paths, "_FIRST_INTERVALS", 8)
        patch.setattr(paths, "_MAX_INTERVALS", 16)

        def cornered(s):
            T = np.tile(six_axis().forward_kinematics(WORK), (len(s), 1, 1))
            T[:, 0, 3] += 0.1 * np.abs(s - 0.43)[:] - 0.043
            return T

        try:
            planning.follow_poses(six_axis(), cornered, WORK, tolerance=1e-6)
        except PathError as error:
            found["corner"] = [re.sub(r"[\d.]+e-\d+|0\.\d+", "x", str(error)), error.partial.deviation > 1e-5]
    doubtful = replace(arm().limits, effort=np.array([24.0, 31.0, 1e9]))
    found["contradiction"] = refused_or_moved(lambda: tw.move(arm(), END, limits=doubtful))
    found["hints"] = refused_or_moved(lambda: tw.move(tw.robots.planar_2r(), [90.0, -45.0], friction=False))
    return found


def _limited_arm():
    limits = replace(arm().limits, acceleration=np.full(3, 5.0), jerk=np.full(3, 9.0))
    return tw.Robot(replace(arm().model, limits=limits))


def refused_or_moved(call):
    try:
        return moved(call())["text"][:4]
    except Exception as error:
        return [f"{type(error).__name__}: {error}", *getattr(error, "__notes__", [])]


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
