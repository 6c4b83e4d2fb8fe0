"""Keyframes: configurations by name, and the one that the file's bodies stand in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import RobotFileError
from ...lie.identity import UPRIGHT
from ...model.builder import ModelBuilder
from ...typing import Array
from ..element import Element
from .joints import COORDINATES, MjcfJoint

REFERENCE = "qpos0"
"""What MuJoCo calls the configuration in which the file describes the bodies."""


def add_configurations(
    builder: ModelBuilder, root: Element, joints: Sequence[tuple[MjcfJoint, Array]], kept: set[str]
) -> None:
    """``qpos0`` and the keyframes; ``joints`` are those of the file in order, each with the pose of its body."""
    start = np.concatenate([np.zeros(0), *(_reference(joint, T) for joint, T in joints)])
    _add(builder, REFERENCE, start, joints, kept)
    keys = [key for section in root.all("keyframe") for key in section.all("key")]
    for k, key in enumerate(keys):
        name = key.attributes.get("name", "").strip() or f"key{k}"
        if "qpos" not in key.attributes:
            continue
        q = key.numbers("qpos", len(key.text("qpos").split()))
        if len(q) != len(start):
            raise RobotFileError(f"{key} has {len(q)} numbers in qpos; the model has {len(start)} coordinates.")
        _add(builder, name, q, joints, kept)


def _reference(joint: MjcfJoint, T: Array) -> Array:
    if joint.single:
        return np.array([joint.reference])
    if joint.kind == "ball":
        return np.array([1.0, 0.0, 0.0, 0.0])
    return np.concatenate([T[:3, 3], quaternion_of(T[:3, :3])])


def quaternion_of(R: Array) -> Array:
    """(w, x, y, z) of a rotation, w not negative."""
    if R.tolist() == UPRIGHT:  # most are, and SciPy takes long to import
        return np.array([1.0, 0.0, 0.0, 0.0])
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(R).as_quat()
    Q = np.array([w, x, y, z])
    return -Q if w < 0 else Q


def _add(builder: ModelBuilder, name: str, q: Array, joints: Sequence[tuple[MjcfJoint, Array]], kept: set[str]) -> None:
    positions: dict[str, Array] = {}
    at = 0
    for joint, _ in joints:
        mine = q[at : at + COORDINATES[joint.kind]]
        at += len(mine)
        if joint.name in kept:
            if joint.kind == "floating":
                mine = np.concatenate([mine[3:], mine[:3]])
            if not joint.single and not mine[:4].any():
                mine = np.concatenate([[1.0], mine[1:]])
            positions[joint.name] = mine
    builder.add_configuration(name, positions)
