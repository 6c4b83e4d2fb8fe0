"""Joint limits that the user gives: a CSV file, ``joint,lower,upper,velocity,effort,acceleration,deceleration,jerk``.

Limits of bearings are in the columns ``axial,radial,tilting`` [N, N, N m]. Rows of locked joints are ignored. The table of
``twistwrench info --csv``, with one row for each entry of dq, is also accepted; columns other than limits are ignored.
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
KINDS = tuple(field.name for field in fields(Limits))
"""Kinds of limits, which are columns of a limits file."""
_WORDS_FOR_NUMBERS = {
    **dict.fromkeys(("inf", "+inf", "infinity", "+infinity"), math.inf),
    **dict.fromkeys(("-inf", "-infinity"), -math.inf),
    "nan": math.nan,
}
"""Numbers that cells may have as words, in lower case."""
_QUANTITY_OF_KIND = {
    "lower": "q",
    "upper": "q",
    "velocity": "dq",
    "acceleration": "ddq",
    "deceleration": "ddq",
    "effort": "tau",
}
"""Quantity that has the units of a kind of limit. Kinds that are not listed, such as jerk, are themselves quantities."""
_BEARING_LOADS = {"axial": ("tau", False), "radial": ("tau", False), "tilting": ("tau", True)}
"""Quantity of each kind of bearing limit, and True for a moment; the type of the joint has no effect."""


Given: TypeAlias = str | Path | Limits | Mapping[str, Any] | None
"""Path of a file, limits, efforts by joint, arrays by kind of limit, or None for the limits of the model."""


def limits_of(given: Given, model: Model, *, degrees: bool = False) -> Limits:
    """Limits of the model, in which given limits replace those of the model.

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
    # A joint may have the name of a kind. Its effort is a number, which has no axis.
    arrays_by_kind = {name: value for name, value in given.items() if name in KINDS and np.ndim(value) > 0}
    efforts_by_joint = {name: value for name, value in given.items() if name not in arrays_by_kind}
    limits = {kind: getattr(model.limits, kind).copy() for kind in KINDS}
    for kind, array in arrays_by_kind.items():
        limits[kind] = np.asarray(arguments.plain(array, f"limits: {kind}"), float)
        if limits[kind].shape != (model.nv,):
            raise ShapeError(f"limits: {kind} has shape {limits[kind].shape}; give ({model.nv},), one for each joint.")
    coordinates = Coordinates.from_model(model)
    has_effort = np.full(model.nv, "effort" in arrays_by_kind)
    locked_joints = tuple(joint for joint in efforts_by_joint if joint in model.all_locked)
    for joint, effort in efforts_by_joint.items():
        if joint in locked_joints:
            continue
        if joint not in coordinates.velocity_names:
            raise UnknownNameError.from_choices("joint", joint, coordinates.velocity_names)
        k = _velocity_index(joint, {"effort": effort}, coordinates, previous_joints=set(), where="limits")
        limits["effort"][k] = arguments.number(effort, f"limits: {joint}")
        has_effort[k] = True
    for kind in KINDS:
        is_given = kind in arrays_by_kind or kind == "effort"  # efforts may be given by joint
        is_invalid = np.isnan(limits[kind])
        if kind not in ("lower", "upper"):
            is_invalid |= limits[kind] <= 0.0
        if is_given and is_invalid.any():
            first_invalid = int(np.argmax(is_invalid))
            joint = coordinates.velocity_names[first_invalid]
            raise ValueRangeError(
                f"limits: the {kind} limit of {joint!r} cannot be a limit. Give a number above 0, or inf."
            )
    with_unit = np.zeros((len(KINDS), model.nv), bool)
    return StatedLimits(**limits, stated=has_effort, with_unit=with_unit, of_locked=locked_joints)


def read_limits(path: str | Path | None, model: Model, *, degrees: bool = False) -> Limits:
    """Limits of the model, in which limits of a file replace those of the model.

    A heading may name the unit, as in ``velocity [deg/s]``. Otherwise the column ``unit`` has the unit of angles. Without both,
    angles are in degrees if ``degrees``, else in radians. Raises :class:`~twistwrench.NotFoundError`,
    :class:`~twistwrench.UnknownNameError` and :class:`~twistwrench.ValueRangeError`, naming file, line and column.
    """
    if path is None:
        return model.limits
    path = as_path(path)
    with table_errors(path, "limits file", f"joint,{','.join(KINDS)}, then a line per joint"):
        file = CsvFile.open(path)
        header, units = _header(file)
        rows = list(file.rows())
    coordinates = Coordinates.from_model(model)
    limits = {kind: getattr(model.limits, kind).copy() for kind in KINDS}
    previous_joints: set[str] = set()
    locked_joints: list[str] = []
    has_effort = np.zeros(model.nv, bool)
    with_unit = np.zeros((len(KINDS), model.nv), bool)
    for line, cells in rows:
        where = f"{path}: line {line}"
        row = dict(zip(header, cells, strict=True))
        if row.get("leader"):  # a mimic joint, which has no entry of dq
            continue
        joint = row.get("velocity_name") or row["joint"]
        if row["joint"] in model.all_locked:
            locked_joints.append(joint)
            continue
        values = {kind: _limit(row[kind], kind, where, file.dialect) for kind in KINDS if row.get(kind)}
        k = _velocity_index(joint, values, coordinates, previous_joints, where)
        if "effort" in values:
            refuse_coupled(
                model, [joint], "has no effort by itself. Give the motors' in the actuator file, and leave it blank"
            )
        previous_joints.add(joint)
        has_effort[k] = "effort" in values
        is_angular = bool(coordinates.angular_velocity[k])
        position_unit = row.get("unit") or unit_of("q", is_angular, degrees=degrees)
        position_factor = _factor(position_unit, "q", is_angular, f"{where}, column 'unit'")
        for kind, value in values.items():
            if kind in units:
                quantity, is_angular_quantity = _QUANTITY_OF_KIND.get(kind, kind), is_angular
                if kind in _BEARING_LOADS:
                    quantity, is_angular_quantity = _BEARING_LOADS[kind]
                factor = _factor(units[kind], quantity, is_angular_quantity, f"{where}, column {kind!r}")
            elif kind in ("effort", *BEARINGS):
                factor = 1.0
            else:  # positions and their derivatives
                factor = position_factor
            limits[kind][k] = value * factor
            with_unit[KINDS.index(kind), k] = kind in units
        _check_bearing(model, joint, values, where)
        if "acceleration" in values and "deceleration" not in values:
            limits["deceleration"][k] = limits["acceleration"][k]
        lower, upper = limits["lower"][k], limits["upper"][k]
        if lower > upper:
            raise ValueRangeError(
                f"{where}: the lower limit of {joint!r}, {printed(lower)}, is above the upper, {printed(upper)}. Swap them."
            )
    return StatedLimits(**limits, stated=has_effort, with_unit=with_unit, of_locked=tuple(locked_joints))


def _factor(unit: str, part: str, is_angular: bool, where: str) -> float:
    """Factor from a unit of the quantity ``part`` to SI units; raises ValueRangeError for units of other quantities."""
    factor = si_factor(unit, part, is_angular)
    if factor is None:
        joint_type = "turning" if is_angular else "sliding"
        units = known_units(part, is_angular)
        raise ValueRangeError(
            f"{where}: {unit!r} is not a unit of this limit of a {joint_type} joint. Write one of {units}."
        )
    return factor


def _velocity_index(
    joint: str, values: dict[str, float], coordinates: Coordinates, previous_joints: set[str], where: str
) -> int:
    """Velocity index of a joint with limits ``values`` by kind.

    Raises ValueRangeError for unknown and repeated joints, and for position limits of joints without a position.
    """
    names = coordinates.velocity_names
    if joint not in names:
        unknown_name = UnknownNameError.from_choices("joint", joint, names, similarity=0.6)
        raise ValueRangeError(f"{where}: {unknown_name}")
    if joint in previous_joints:
        raise ValueRangeError(f"{where}: joint {joint!r} has limits already. Keep one line for each joint.")
    k = names.index(joint)
    position_limits = [kind for kind in ("lower", "upper") if math.isfinite(values.get(kind, math.inf))]  # finite ones
    has_position = coordinates.position_of[k] >= 0
    if position_limits and not has_position:
        raise ValueRangeError(
            f"{where}, column {position_limits[0]!r}: {joint!r} is a velocity in the frame of a moving body, and no position "
            "belongs to it. Give limits of velocity and effort, and leave lower and upper blank."
        )
    return k


def _check_bearing(model: Model, joint: str, values: dict[str, float], where: str) -> None:
    """Raise ValueRangeError for limits of loads that a joint's bearing does not have."""
    given_kinds = [kind for kind in BEARINGS if math.isfinite(values.get(kind, math.inf))]
    body_by_joint = {body.joint.name: body for body in model.leaders}
    body = body_by_joint.get(joint)
    has_several_degrees = body is None or body.joint.nv != 1
    if given_kinds and has_several_degrees:
        raise ValueRangeError(
            f"{where}, column {given_kinds[0]!r}: {joint!r} has several degrees of freedom, and loads of its bearing are not "
            "computed. Leave this blank."
        )
    if "axial" in given_kinds and body is not None and not body.joint.turning[0]:
        raise ValueRangeError(
            f"{where}, column 'axial': {joint!r} slides along its axis, so that its drive bears the force along it, and no "
            "bearing. Leave this blank, and give the largest force of the drive as effort."
        )


def _header(file: CsvFile) -> tuple[list[str], dict[str, str]]:
    """Names of all columns, and the unit of each column of limits whose heading has one, as in ``velocity [deg/s]``."""
    header: list[str] = []
    units: dict[str, str] = {}
    for heading in file.header:
        name, unit = split_unit(heading)
        name = name.lower()
        header.append(name)
        if unit and name in KINDS:
            units[name] = unit
    unknown_names = set(header) - {*COLUMNS, *BEARINGS}
    has_repeated = len(set(header)) < len(header)
    if "joint" not in header or unknown_names or has_repeated:
        raise ValueRangeError(
            f"{file.path}: line {file.header_line}: the header is {','.join(file.header)!r}. Name 'joint' and any of "
            f"{', '.join(KINDS)}, each once, separated by commas."
        )
    return header, units


def _limit(text: str, kind: str, where: str, dialect: Dialect) -> float:
    """Number of a cell; raises ValueRangeError if it cannot be a limit of this kind."""
    value = _WORDS_FOR_NUMBERS.get(text.lower())
    if value is None:  # not a word
        value = dialect.number(text)
    if value is None:
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} is not a number. Leave it blank to keep the robot's."
        )
    is_position = kind in ("lower", "upper")
    if math.isnan(value) or (value <= 0 and not is_position):
        allowed = "a number" if is_position else "a number above 0"
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} cannot be a limit. Give {allowed}, inf for none, or a blank."
        )
    return value


def notes_on_limits(limits: Limits) -> Iterator[str]:
    """Note on given limits of joints that are locked."""
    if isinstance(limits, StatedLimits) and limits.of_locked:
        yield f"Limits of locked joints are ignored: {', '.join(limits.of_locked)}."


def robot_origin(robot: Robot, limits: Limits | None = None, *, degrees: bool = False) -> Iterator[Setting]:
    """Entries of a page's provenance: the robot with its joints, and the limits used; angles in degrees if ``degrees``."""
    yield "robot", f"{robot.name}: {', '.join(robot.model.velocity_names)}"
    if limits is not None:
        yield limits_table(robot.model, limits, degrees=degrees)


def limits_table(model: Model, limits: Limits, *, degrees: bool = False) -> Table:
    """Table of the limits that a report uses, and of their sources; angles in degrees if ``degrees``."""
    is_angular = Coordinates.from_model(model).angular_velocity
    degrees_per_radian = math.degrees(1.0)
    printed_units = np.where(is_angular & degrees, degrees_per_radian, 1.0)  # in an SI unit
    position_unit = heading_unit("q", is_angular, degrees=degrees)
    velocity_unit = heading_unit("dq", is_angular, degrees=degrees)
    sources = np.full(model.nv, "robot's file", object)
    if isinstance(limits, StatedLimits):
        sources[limits.stated] = "limits given"
    sources[~np.isfinite(limits.effort)] = "none"  # no limit
    for coupling in model.couplings:
        for joint in coupling.joints:
            sources[model.velocity_names.index(joint)] = f"of motors {listed(coupling.motors)}"
    return Table(
        "Limits used",
        words("joint", model.velocity_names),
        numbers("torque", joint_effort(model, limits.effort), unit=heading_unit("tau", is_angular)),
        numbers("velocity", printed_units * limits.velocity, unit=velocity_unit),
        numbers("lower", printed_units * limits.lower, unit=position_unit),
        numbers("upper", printed_units * limits.upper, unit=position_unit, headed=False),  # the unit stands at lower
        words("source of the torque limit", sources.tolist()),
    )
