"""Joint limits that the user gives: a CSV file, ``joint,lower,upper,velocity,effort,acceleration,deceleration,jerk``.

Bearings have the columns ``axial,radial,tilting`` [N, N, N m]. Rows of locked joints are ignored.

The table of ``twistwrench info --csv`` is accepted: one row for each entry of dq; its other columns are ignored. A page
lists the limits used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..core import arguments
from ..core.answers.blocks import Table, numbers, words
from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.files import as_path
from ..core.numbers import printed
from ..core.text import listed
from ..mechanics.joints.units import heading_unit, unit_of
from ..mechanics.model.couplings import joint_effort, refuse_coupled
from ..mechanics.model.limits import BEARINGS, Limits, StatedLimits
from ..mechanics.model.model import Model
from .column_names import known_units, si_factor, split_unit
from .coordinates import Coordinates
from .readers.csv_reader import CsvFile, Dialect, table_errors

if TYPE_CHECKING:
    from ..core.answers.page import Setting
    from ..robot import Robot

COLUMNS = (
    "joint", "velocity_name", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort",
    "acceleration", "deceleration", "jerk", "damping", "friction", "armature", "leader", "ratio", "offset",
)  # fmt: skip
"""Columns of the table of ``twistwrench info --csv``."""
KINDS = tuple(f.name for f in fields(Limits))
"""Kinds of limits."""
_WORDS_FOR_NUMBERS = {
    **dict.fromkeys(("inf", "+inf", "infinity", "+infinity"), math.inf),
    **dict.fromkeys(("-inf", "-infinity"), -math.inf),
    "nan": math.nan,
}
_PARTS = {"lower": "q", "upper": "q", "velocity": "dq", "acceleration": "ddq", "deceleration": "ddq", "effort": "tau"}
"""Quantities of the kinds of limits, for their units; jerk is one by itself."""
_OF_BEARINGS = {"axial": ("tau", False), "radial": ("tau", False), "tilting": ("tau", True)}
"""Quantity, and True for a moment, of the limits of bearings, whatever the joint."""


Given: TypeAlias = str | Path | Limits | Mapping[str, Any] | None
"""A file, limits, efforts by joint, or arrays by kind of limit."""


def limits_of(given: Given, model: Model, *, degrees: bool = False) -> Limits:
    """Limits of the model, replaced by those that are given.

    Parameters
    ----------
    given : path of a CSV file, Limits, {joint: effort} [N m or N], or {kind: (nv,) array}, in SI units
    degrees : bool, angles of a file without units are in degrees

    Returns
    -------
    limits : Limits

    Raises
    ------
    NotFoundError, UnknownNameError, ValueRangeError
        The file cannot be read, a joint is unknown, or a number cannot be a limit.

    Examples
    --------
    >>> import twistwrench as tw
    >>> limits_of({"joint1": 28.0}, tw.robots.planar_2r().model).effort.tolist()
    [28.0, inf]
    """
    if isinstance(given, Limits):
        return given
    if not isinstance(given, Mapping):
        return read_limits(given, model, degrees=degrees)
    kinds = {name: value for name, value in given.items() if name in KINDS and np.ndim(value)}
    efforts = {name: value for name, value in given.items() if name not in kinds}
    limits = {kind: getattr(model.limits, kind).copy() for kind in KINDS}
    for kind, values in kinds.items():
        limits[kind] = np.asarray(arguments.plain(values, f"limits: {kind}"), float)
        if limits[kind].shape != (model.nv,):
            raise ShapeError(f"limits: {kind} has shape {limits[kind].shape}; give ({model.nv},), one for each joint.")
    joints, stated = Coordinates.from_model(model), np.zeros(model.nv, bool)
    of_locked = tuple(joint for joint in efforts if joint in model.all_locked)
    for joint, effort in efforts.items():
        if joint in of_locked:
            continue
        if joint not in joints.velocity_names:
            raise UnknownNameError.from_choices("joint", joint, joints.velocity_names)
        k = _check(joint, {"effort": effort}, joints, set(), "limits")
        limits["effort"][k] = arguments.number(effort, f"limits: {joint}")
        stated[k] = True
    for kind in KINDS:
        is_invalid = np.isnan(limits[kind])
        if kind not in ("lower", "upper"):
            is_invalid |= limits[kind] <= 0.0
        if is_invalid.any() and (kind in kinds or kind == "effort"):
            joint = joints.velocity_names[int(np.argmax(is_invalid))]
            raise ValueRangeError(
                f"limits: the {kind} limit of {joint!r} cannot be a limit. Give a number above 0, or inf."
            )
    with_unit = np.zeros((len(KINDS), model.nv), bool)
    return StatedLimits(**limits, stated=stated | ("effort" in kinds), with_unit=with_unit, of_locked=of_locked)


def read_limits(path: str | Path | None, model: Model, *, degrees: bool = False) -> Limits:
    """Limits of the model, replaced by those of a file where given.

    Angles have the unit of the head, ``velocity [deg/s]``, else of the column ``unit``, else degrees if ``degrees``.
    Raises :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.UnknownNameError` and
    :class:`~twistwrench.ValueRangeError`, naming file, line and column.
    """
    if path is None:
        return model.limits
    path = as_path(path)
    with table_errors(path, "limits file", f"joint,{','.join(KINDS)}, then a line per joint"):
        file = CsvFile.open(path)
        header, units = _header(file)
        rows = list(file.rows())
    joints = Coordinates.from_model(model)
    limits = {kind: getattr(model.limits, kind).copy() for kind in KINDS}
    previous_joints: set[str] = set()
    of_locked: list[str] = []
    stated, with_unit = np.zeros(model.nv, bool), np.zeros((len(KINDS), model.nv), bool)
    for line, cells in rows:
        row, where = dict(zip(header, cells, strict=True)), f"{path}: line {line}"
        if row.get("leader"):
            continue
        joint = row.get("velocity_name") or row["joint"]
        if row["joint"] in model.all_locked:
            of_locked.append(joint)
            continue
        values = {kind: _limit(row[kind], kind, where, file.dialect) for kind in KINDS if row.get(kind)}
        k = _check(joint, values, joints, previous_joints, where)
        if "effort" in values:
            refuse_coupled(
                model, [joint], "has no effort by itself. Give the motors' in the actuator file, and leave it blank"
            )
        previous_joints.add(joint)
        stated[k] = "effort" in values
        turns = bool(joints.angular_velocity[k])
        unit = row.get("unit") or unit_of("q", turns, degrees=degrees)
        angle = _factor(unit, "q", turns, f"{where}, column 'unit'")
        for kind, value in values.items():
            part, moment = _OF_BEARINGS.get(kind, (_PARTS.get(kind, kind), turns))
            factor = 1.0 if kind in ("effort", *BEARINGS) else angle
            if kind in units:
                factor = _factor(units[kind], part, moment, f"{where}, column {kind!r}")
            limits[kind][k] = value * factor
            with_unit[KINDS.index(kind), k] = kind in units
        _check_bearing(model, joint, values, where)
        if "acceleration" in values and "deceleration" not in values:
            limits["deceleration"][k] = limits["acceleration"][k]
        if limits["lower"][k] > limits["upper"][k]:
            raise ValueRangeError(
                f"{where}: the lower limit of {joint!r}, {printed(limits['lower'][k])}, is above the upper, "
                f"{printed(limits['upper'][k])}. Swap them."
            )
    return StatedLimits(**limits, stated=stated, with_unit=with_unit, of_locked=tuple(of_locked))


def _factor(unit: str, part: str, turns: bool, where: str) -> float:
    """Factor from a unit to SI units; raises ValueRangeError for units of other quantities."""
    factor = si_factor(unit, part, turns)
    if factor is None:
        joint = "turning" if turns else "sliding"
        raise ValueRangeError(
            f"{where}: {unit!r} is not a unit of this limit of a {joint} joint. Write one of {known_units(part, turns)}."
        )
    return factor


def _check(joint: str, values: dict[str, float], joints: Coordinates, previous_joints: set[str], where: str) -> int:
    """Velocity index of a joint; raises for unknown and repeated joints and for positions of joints without one."""
    known = joints.velocity_names
    if joint not in known:
        raise ValueRangeError(f"{where}: {UnknownNameError.from_choices('joint', joint, known, similarity=0.6)}")
    if joint in previous_joints:
        raise ValueRangeError(f"{where}: joint {joint!r} has limits already. Keep one line for each joint.")
    k = known.index(joint)
    bounded = [kind for kind in ("lower", "upper") if math.isfinite(values.get(kind, math.inf))]
    if joints.position_of[k] < 0 and bounded:
        raise ValueRangeError(
            f"{where}, column {bounded[0]!r}: {joint!r} is a velocity in the frame of a moving body, and no position "
            "belongs to it. Give limits of velocity and effort, and leave lower and upper blank."
        )
    return k


def _check_bearing(model: Model, joint: str, values: dict[str, float], where: str) -> None:
    """Raise ValueRangeError for limits of loads that a joint's bearing does not have."""
    kinds = [kind for kind in BEARINGS if math.isfinite(values.get(kind, math.inf))]
    bodies = {body.joint.name: body for body in model.leaders}
    body = bodies.get(joint)
    if kinds and (body is None or body.joint.nv != 1):
        raise ValueRangeError(
            f"{where}, column {kinds[0]!r}: {joint!r} has several degrees of freedom, and loads of its bearing are not "
            "computed. Leave this blank."
        )
    if "axial" in kinds and body is not None and not body.joint.turning[0]:
        raise ValueRangeError(
            f"{where}, column 'axial': {joint!r} slides along its axis, so that its drive bears the force along it, and no "
            "bearing. Leave this blank, and give the largest force of the drive as effort."
        )


def _header(file: CsvFile) -> tuple[list[str], dict[str, str]]:
    """Column names, and the units of heads that name one, ``velocity [deg/s]``."""
    header, units = [], {}
    for head in file.header:
        name, unit = split_unit(head)
        header.append(name.lower())
        if unit and name.lower() in KINDS:
            units[name.lower()] = unit
    has_unknown = not set(header) <= {*COLUMNS, *BEARINGS}
    if "joint" not in header or has_unknown or len(set(header)) < len(header):
        raise ValueRangeError(
            f"{file.path}: line {file.header_line}: the header is {','.join(file.header)!r}. Name 'joint' and any of "
            f"{', '.join(KINDS)}, each once, separated by commas."
        )
    return header, units


def _limit(text: str, kind: str, where: str, dialect: Dialect) -> float:
    value = _WORDS_FOR_NUMBERS.get(text.lower())
    if value is None:
        value = dialect.number(text)
    if value is None:
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} is not a number. Leave it blank to keep the robot's."
        )
    if math.isnan(value) or (kind not in ("lower", "upper") and value <= 0):
        allowed = "a number" if kind in ("lower", "upper") else "a number above 0"
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} cannot be a limit. Give {allowed}, inf for none, or a blank."
        )
    return value


def notes_on_limits(limits: Limits) -> Iterator[str]:
    """Note on limits that were given of joints that are locked."""
    if isinstance(limits, StatedLimits) and limits.of_locked:
        yield f"Limits of locked joints are ignored: {', '.join(limits.of_locked)}."


def robot_origin(robot: Robot, limits: Limits | None = None, *, degrees: bool = False) -> Iterator[Setting]:
    """Robot with its joints, and the limits used, for the provenance of a page; angles in degrees if ``degrees``."""
    yield "robot", f"{robot.name}: {', '.join(robot.model.velocity_names)}"
    if limits is not None:
        yield limits_table(robot.model, limits, degrees=degrees)


def limits_table(model: Model, limits: Limits, *, degrees: bool = False) -> Table:
    """Limits used by a report and their source; angles in degrees if ``degrees``."""
    turning = Coordinates.from_model(model).angular_velocity
    unit = np.where(turning & degrees, math.degrees(1.0), 1.0)
    sources = np.full(model.nv, "robot's file", object)
    if isinstance(limits, StatedLimits):
        sources[limits.stated] = "limits given"
    sources[~np.isfinite(limits.effort)] = "none"
    for c in model.couplings:
        for joint in c.joints:
            sources[model.velocity_names.index(joint)] = f"of motors {listed(c.motors)}"
    return Table(
        "Limits used",
        words("joint", model.velocity_names),
        numbers("torque", joint_effort(model, limits.effort), unit=heading_unit("tau", turning)),
        numbers("velocity", unit * limits.velocity, unit=heading_unit("dq", turning, degrees=degrees)),
        numbers("lower", unit * limits.lower, unit=heading_unit("q", turning, degrees=degrees)),
        numbers("upper", unit * limits.upper, unit=heading_unit("q", turning, degrees=degrees), headed=False),
        words("source of the torque limit", sources.tolist()),
    )
