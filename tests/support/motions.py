"""Motion files for tests of the torques command, and the report of one."""

from __future__ import annotations

import numpy as np

from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.torque_analysis import analyse

SLED = """<robot name="sled"><link name="ground"/><link name="sled"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="planar"><parent link="ground"/><child link="sled"/><axis xyz="0 0 1"/></joint></robot>"""
WRENCH = np.array([0.3, -0.2, 0.5, 4.0, -7.0, 11.0])
LOAD = {"payloads": (Payload(3.0, (0.0, 0.02, 0.1)),), "wrenches": {"tool0": WRENCH}}


def write_motion(path, robot, t, columns, parts=("", ".vel", ".acc"), order=None):
    names = [n + part for part in parts for n in robot.joint_names]
    table = np.column_stack([t, *columns])
    order = np.arange(table.shape[1]) if order is None else order
    header = np.array(["time", *names])[order]
    path.write_text(",".join(header) + "\n" + "".join(",".join(map(repr, r)) + "\n" for r in table[:, order].tolist()))
    return path


def wrapped(angles):
    """The same angles within ±π, as most logs have them."""
    return np.arctan2(np.sin(angles), np.cos(angles))


def write_positions(path, robot, t, q, form="%.17g"):
    header = ",".join(["time", *robot.coordinate_names])
    np.savetxt(path, np.column_stack([t, q]), form, ",", header=header, comments="")
    return path


def rough_motion():
    """A motion of six joints with uneven steps, and its rates: t (n,), q, dq, ddq (n, 6)."""
    rng = np.random.default_rng(7)
    t = np.cumsum(rng.uniform(0.5, 1.5, 700)) * 0.01
    w, phase = rng.uniform(0.5, 3, 6), rng.uniform(0, 6, 6)
    s = np.outer(t, w) + phase
    return t, np.sin(s), w * np.cos(s), -(w**2) * np.sin(s)


def report_of(robot, path, *, limits=None, smoothing=False, chunk=None, csv=None, split=False, **load):
    trajectory = MotionLog.open(path, robot.model)
    plan = Differentiation.plan(trajectory, robot.model, smoothing=smoothing)
    report = analyse(LoadCase(robot, **load), plan, limits or robot.limits, chunk=chunk)
    if csv is not None:
        report.to_csv(csv, split=split)
    return report
