"""Measurements of an ABB IRB 120 by a laser tracker, if their folder is named: Wu et al., IEEE T-ASE 12(2), 2015, 758-763.

The data are public (github.com/drliaowu/Minimal_Robot_Calibration_Using_Position) and have no licence, so they are not
copied here: ``IRB120_MEASUREMENTS`` names the folder of their ``.mat`` files. Lengths are those of the maker's data sheet,
masses those of the URDF of ROS-Industrial.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

import twistwrench as tw
from twistwrench.calibration import Measurements

VARIABLE = "IRB120_MEASUREMENTS"
_LINKS = (
    (6.215, "-0.042 0 0.08"), (3.067, "0 0 0.238"), (3.909, "0.001 -0.002 0.101"), (2.944, "0.023 0.001 0.058"),
    (1.328, "0.225 0 0"), (0.546, "-0.001 0 0"), (0.137, "-0.007 0 0"),
)  # fmt: skip
_JOINTS = (
    ("0 0 0", "0 0 1"), ("0 0 0.29", "0 1 0"), ("0 0 0.27", "0 1 0"), ("0 0 0.07", "1 0 0"), ("0.302 0 0", "0 1 0"),
    ("0.072 0 0", "1 0 0"),
)  # fmt: skip


def folder() -> Path | None:
    """Folder of the measurements; None without them."""
    named = os.environ.get(VARIABLE)
    return Path(named) if named else None


def irb120() -> tw.Robot:
    """Arm by its data sheet."""
    links = [
        f'<link name="link_{k}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>'
        '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for k, (mass, com) in enumerate(_LINKS)
    ]
    joints = [
        f'<joint name="joint_{k}" type="revolute"><parent link="link_{k - 1}"/><child link="link_{k}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="4" effort="50"/></joint>'
        for k, (at, axis) in enumerate(_JOINTS, 1)
    ]
    return tw.load(f'<robot name="irb120">{"".join(links + joints)}</robot>')


def _table(name: str) -> np.ndarray:
    from scipy.io import loadmat

    return next(value for key, value in loadmat(folder() / f"{name}.mat").items() if not key.startswith("__"))


def _registered(points: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Pose of a rigid shape (k, 3) at measured points (k, 3): Kabsch."""
    a, b = shape - shape.mean(axis=0), points - points.mean(axis=0)
    U, _, V = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return np.asarray(tw.se3.pose(R, points.mean(axis=0) - R @ shape.mean(axis=0)))


def poses() -> Measurements:
    """36 poses of three points on the flange, whose mean shape is registered."""
    points = 1e-3 * _table("CaliPosition").reshape(-1, 3, 3)
    shape = points[0] - points[0].mean(axis=0)
    for _ in range(20):
        every = [_registered(p, shape) for p in points]
        shape = np.mean([(p - T[:3, 3]) @ T[:3, :3] for p, T in zip(points, every, strict=True)], axis=0)
    return Measurements(np.radians(_table("CaliJointAngles")), poses=np.array([_registered(p, shape) for p in points]))


def separate_positions() -> list[Measurements]:
    """10 and 30 positions of another point, at other poses."""
    return [
        Measurements(np.radians(_table(f"TestJointAngles{which}")), positions=1e-3 * _table(f"TestPosition{which}"))
        for which in ("", "2")
    ]
