"""URDF, the robot description format of ROS: links and joints of a tree, and inertia tensors."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import RobotFileError
from ..core.numbers import printed
from ..core.text import shorten
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import quaternion, se3, so3
from ..mechanics.lie.identity import IDENTITY, UPRIGHT, pose_rows
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.description import Mimic
from ..mechanics.model.model import OfferedClosure
from ..mechanics.model.snapping import DEFAULT_SNAP, snap_rotation
from .known_elements import unread
from .xml import Element

ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Row and column of an entry of an inertia tensor, by its name in URDF and SDF."""
IN_MJCF = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""Names of the entries in the order of MJCF's ``fullinertia``: moments, then products."""


def tensor_of(entry: Callable[[str], float]) -> Array:
    """Symmetric tensor (3, 3); ``entry`` returns the entry of a name in :data:`ENTRIES`."""
    I = np.zeros((3, 3))
    for name, (i, j) in ENTRIES.items():
        I[i, j] = I[j, i] = entry(name)
    return I


def entries_of(I: Array) -> dict[str, float]:
    """Six entries of a tensor (3, 3) by name."""
    return {name: float(I[row_and_column]) for name, row_and_column in ENTRIES.items()}


# The format is described at https://wiki.ros.org/urdf/XML. Appearance, shapes, transmissions and simulator settings are
# skipped; mesh files are never opened.

_URDF_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
"""Joint types of URDF."""
LIMITS_OF_1_2 = ("acceleration", "deceleration", "jerk")
"""Limits defined since URDF 1.2; they are read for every ``version``."""
NO_LIMIT = 1e15
"""Limits above this value mean no limit: files have ±1e16, as the format requires a number."""

_ZEROS = [0.0, 0.0, 0.0]
"""Default of a position and of roll, pitch and yaw."""
_MAX_LENGTH_ERROR = 1e-3
"""Largest difference of a quaternion's length from 1 that counts as rounding; the quaternion is then normalised."""
_MIN_SINE = 1e-10
"""Sine of the angle between two unit vectors below which they count as parallel or opposite."""
_MIN_LENGTH = 1e-14
"""Length up to which a vector has no direction."""


def read_urdf(robot: Element, source: str = "", snap: float = DEFAULT_SNAP) -> ModelBuilder:
    """Builder with the links and joints of a ``<robot>`` element.

    ``snap`` is the tolerance of :func:`snap_rotation` for the rotations of inertial frames.

    Raises :class:`~twistwrench.RobotFileError` with element and line for violations of the format, and the errors of
    :class:`~twistwrench.mechanics.model.builder.ModelBuilder` for inconsistent robots.
    """
    name = robot.attributes.get("name", "").strip() or "robot"  # the name may be absent or empty
    builder = ModelBuilder(name, source)
    for link in robot.all("link"):
        add_link(builder, link, snap)
    for joint in robot.all("joint"):
        add_joint(builder, joint)
    for constraint in robot.all("constraint"):
        _add_closure(builder, constraint)
    builder.remark(*unread("URDF", robot))
    return builder


def add_link(builder: ModelBuilder, link: Element, snap: float = DEFAULT_SNAP) -> None:
    """Add one ``<link>``; raises the errors of :func:`read_urdf`."""
    has_shape = bool(link.all("visual") or link.all("collision"))
    builder.add_link(link.text("name"), _inertia(link, snap), where=f"line {link.line}", shaped=has_shape)


def _inertia(link: Element, snap: float) -> SpatialInertia | None:
    """Spatial inertia of a link in the axes of its frame; None without an ``<inertial>``."""
    inertial = link.child("inertial")
    if inertial is None:
        return None
    mass, T, I = inertial_of(inertial)
    R = T[:3, :3]
    if R.tolist() != UPRIGHT:
        R = snap_rotation(R, snap)
        I = R @ I @ R.T  # from the axes of the inertial frame to those of the link
    return SpatialInertia.from_com(mass, T[:3, 3], I)


def inertial_of(inertial: Element) -> tuple[float, Array, Array]:
    """Mass [kg], pose (4, 4) of the centre of mass with the axes of the tensor, and tensor (3, 3) [kg m²]."""
    mass = inertial.require_child("mass", '<mass value="1.0"/>').number("value")
    tensor = inertial.require_child("inertia", '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>')
    return mass, origin_of(inertial), tensor_of(tensor.number)


def origin_of(element: Element) -> Array:
    """Pose (4, 4) of an element's ``<origin>``; missing parts are zero."""
    return _pose(element.child("origin"))


def _pose(origin: Element | None) -> Array:
    """Pose (4, 4) of an ``<origin>``; the identity without one."""
    if origin is None:
        return IDENTITY
    p = origin.values("xyz", 3) if "xyz" in origin.attributes else _ZEROS
    if "quat_xyzw" in origin.attributes:
        return pose_rows(_rows_of_quaternion(origin), p)
    rpy = origin.values("rpy", 3) if "rpy" in origin.attributes else _ZEROS
    if not any(rpy):
        return pose_rows(UPRIGHT, p)  # exactly the identity, without -0.0
    return pose_rows(_rows_of_rpy(rpy), p)


def _rows_of_quaternion(origin: Element) -> list[list[float]]:
    """Rotation matrix, row by row, of URDF 1.1's ``quat_xyzw``: a unit quaternion, scalar last."""
    if "rpy" in origin.attributes:
        raise origin.error("has both rpy and quat_xyzw; one rotation is allowed. Remove one of them.")
    x, y, z, w = origin.values("quat_xyzw", 4)
    length = math.hypot(x, y, z, w)
    if abs(length - 1.0) > _MAX_LENGTH_ERROR:
        text = shorten(origin.attributes["quat_xyzw"])
        raise RobotFileError(
            f'{origin} has quat_xyzw="{text}" of length {printed(length)}; a rotation has '
            "length 1. Divide the four numbers by their length, or check that they stand in the order x y z w."
        )
    return quaternion.rotation([w, x, y, z]).tolist()


def rotation_of_rpy(rpy: ArrayLike) -> Array:
    """Rotation (3, 3) = Rz(yaw) Ry(pitch) Rx(roll) of roll, pitch and yaw (3,) about fixed axes. MR appendix B.2."""
    return np.array(_rows_of_rpy(rpy))


def _rows_of_rpy(rpy: ArrayLike) -> list[list[float]]:
    """Rotation matrix, row by row, of roll, pitch and yaw."""
    # Sines and cosines of roll, pitch and yaw.
    sr, sp, sy = np.sin(rpy).tolist()
    cr, cp, cy = np.cos(rpy).tolist()
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def rpy_of_rotation(R: Array) -> Array:
    """Roll, pitch and yaw (3,) of a rotation, accurate at any pitch; yaw is 0 where the pitch is ±90°."""
    x_axis_is_vertical = R[0, 0] == 0 and R[1, 0] == 0  # at a pitch of ±90°
    yaw = 0.0 if x_axis_is_vertical else np.arctan2(R[1, 0], R[0, 0])
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    # Rz(-yaw) R = Ry(pitch) Rx(roll); the roll is read from its second row.
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def rotation_of_z_axis_to(vector: Array) -> Array:
    """Smallest rotation (3, 3) that turns the z axis to a unit vector; half a turn about x if they are opposite."""
    axis = np.array([-vector[1], vector[0], 0.0])  # z × vector
    cosine = float(vector[2])
    sine = float(np.linalg.norm(axis))
    if sine < _MIN_SINE:
        if cosine > 0:
            return np.eye(3)
        return np.diag([1.0, -1.0, -1.0])  # half a turn about x
    angle = math.atan2(sine, cosine)
    return np.asarray(so3.exp(axis / sine * angle))


def direction(element: Element, attribute: str, vector: object) -> Array:
    """Normalised vector; for a zero vector, an error that names the element and its attribute."""
    array = np.asarray(vector, float)
    length = float(np.linalg.norm(array))
    if not length > _MIN_LENGTH:  # nan too
        raise element.error(f"has {attribute}={element.attributes.get(attribute, '')!r}, which is not a direction.")
    return array / length


def add_joint(builder: ModelBuilder, joint: Element) -> None:
    """Add one ``<joint>``; raises the errors of :func:`read_urdf`."""
    name = joint.text("name")
    kind = joint.text("type")
    if kind not in _URDF_TYPES:
        raise joint.error(
            f"has the unknown type {kind!r}. Allowed: {', '.join(_URDF_TYPES)}. A ball joint can be written as "
            "three revolute joints with massless links between them."
        )
    parent = joint.require_child("parent", '<parent link="base"/>').text("link")
    child = joint.require_child("child", '<child link="arm"/>').text("link")
    if kind == "fixed" and parent == "world":
        builder.mount()  # states that the base is fixed
    options: dict[str, Any] = {
        "placement": origin_of(joint),
        "axis": (1.0, 0.0, 0.0),  # the format's default
        "where": f"line {joint.line}",
    }
    if kind != "fixed":  # a fixed joint has no use for the other elements
        axis_element = joint.child("axis")
        if axis_element is not None and kind != "floating":
            options["axis"] = axis_element.values("xyz", 3)
        options |= _limits(builder, joint, kind)
        dynamics = joint.child("dynamics")
        if dynamics is not None:
            options["damping"] = dynamics.optional_number("damping") or 0.0  # 0 if absent
            options["friction"] = dynamics.optional_number("friction") or 0.0
        options["mimic"] = _mimic(joint)
    builder.add_joint(name, kind, parent, child, **options)


def _limits(builder: ModelBuilder, joint: Element, kind: str) -> dict[str, Any]:
    """Limits of a joint by name; a remark if a bounded joint has none."""
    limit = joint.child("limit")
    is_bounded = kind in ("revolute", "prismatic")
    if limit is None:
        if is_bounded:
            builder.remark(f"{joint} is {kind} and has no <limit>, so it is taken to be unlimited")
        return {}
    limits = {name: limit.optional_number(name) for name in _LIMIT_SIGNS}
    if is_bounded:
        for name in ("lower", "upper"):
            if limits[name] is None:
                limits[name] = 0.0  # the format's default of either bound
    return known_limits(**limits)


_LIMIT_SIGNS = {
    "lower": -1.0,
    "upper": 1.0,
    "velocity": 1.0,
    "effort": 1.0,
    **dict.fromkeys(LIMITS_OF_1_2, 1.0),
}
"""Sign of the infinity that means no limit, by name of the limit."""


def known_limits(**limits: float | None) -> dict[str, Any]:
    """Limits of a joint, without values that mean no limit."""
    given_limits = {name: limit for name, limit in limits.items() if limit is not None}
    return {name: limit for name, limit in given_limits.items() if limit * _LIMIT_SIGNS[name] < NO_LIMIT}


_CONSTRAINED_ROWS = {
    "revolute": "wx wy vx vy vz", "prismatic": "wx wy wz vx vy", "spherical": "vx vy vz", "link": "wx wy wz vx vy vz",
}  # fmt: skip
"""Components of the relative velocity that a closing joint prevents, by its type; z is its axis. A "link" is cut in two."""
_ENDS = ("parent", "child")
"""Names of the elements of a constraint's two ends."""


def _add_closure(builder: ModelBuilder, constraint: Element) -> None:
    """Offer the loop of a ``<constraint>``, as proposed for URDF in ros/urdfdom_headers#108; add a note if it is incomplete."""
    name = constraint.attributes.get("name", "").strip()
    kind = constraint.attributes.get("type", "").strip().removesuffix("_joint")
    links = [_link_of(constraint.child(end)) for end in _ENDS]
    is_complete = name and all(links) and kind in _CONSTRAINED_ROWS
    if not is_complete:
        builder.note(
            constraint,
            f"is left out, so its loop stays open: it needs a name, parent, child and a type of {', '.join(_CONSTRAINED_ROWS)}",
        )
        return
    R = np.eye(3)  # columns: axes of a frame with z along the joint axis, in the axes of an origin
    if kind in ("revolute", "prismatic"):
        axis_element = constraint.child("parent_axis")
        axis = np.array([1.0, 0.0, 0.0])
        if axis_element is not None:
            axis = direction(axis_element, "xyz", axis_element.values("xyz", 3))
        R = rotation_of_z_axis_to(axis)
    sites = []
    for end, link in zip(_ENDS, links, strict=True):
        origin = constraint.child(f"{end}_origin")
        T = _pose(origin) @ se3.pose(R, (0, 0, 0))
        sites.append(builder.add_site(f"{name}:{link}", link, T, constraint.place))
    parent_site, child_site = sites
    rows = _CONSTRAINED_ROWS[kind]
    builder.add_closure(name, OfferedClosure(parent_site, child_site, rows))
    builder.remark(f"{constraint} is left open: robot.close({parent_site!r}, {child_site!r}, {rows!r}) closes it")


def _link_of(end: Element | None) -> str:
    """Name of the link at one end of a constraint; empty if the end or its link is missing."""
    if end is None:
        return ""
    return end.attributes.get("link", "").strip()


def _mimic(joint: Element) -> Mimic | None:
    """Name of the leader, ratio and offset of a mimic joint; None for others."""
    mimic = joint.child("mimic")
    if mimic is None:
        return None
    ratio = mimic.optional_number("multiplier")
    if ratio is None:
        ratio = 1.0
    offset = mimic.optional_number("offset") or 0.0
    return mimic.text("joint"), ratio, offset
