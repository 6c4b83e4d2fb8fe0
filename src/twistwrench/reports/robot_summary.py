"""Robot as plain data, and joint values from command-line options or limits files."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.errors import UnknownNameError, ValueRangeError
from ..core.files import as_path
from ..core.numbers import number, printed
from ..core.tables import CsvWriter, html_table
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.joints.units import heading_unit, unit_of
from ..mechanics.model.couplings import coupled_entries, joint_effort, refuse_coupled
from ..mechanics.model.limits import Limits, StatedLimits
from ..mechanics.model.model import BASE, Body, Model
from ..motion.column_names import known_units, si_factor, split_unit
from ..motion.coordinates import Coordinates
from ..motion.readers.csv_reader import CsvFile, Dialect, table_errors
from ..robot.task_space_methods import require_robot
from . import blocks

if TYPE_CHECKING:
    from ..robot import Robot

COLUMNS = (
    "joint", "velocity_name", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort",
    "acceleration", "deceleration", "jerk", "damping", "friction", "armature", "leader", "ratio", "offset",
)  # fmt: skip
"""Entries of a row of :func:`joint_rows`."""
_SHOWN = ("joint", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort")
"""Columns of the table in notebooks."""
_KINDS = tuple(f.name for f in fields(Limits))
"""Kinds of limits."""


def summary(robot: Robot) -> dict[str, Any]:
    """Robot as a dictionary for ``json.dumps``: joints, links, frames, masses, defects."""
    model = require_robot(robot, "info").model
    return {
        "name": model.name,
        "nq": model.nq,
        "nv": model.nv,
        "gravity": [float(g) for g in model.gravity],
        "tip": model.tip,
        "moving_mass": model.moving_mass,
        "fixed_mass": float(model.base_inertia.mass),
        "joints": joint_rows(model),
        "links": _links(model),
        "frames": list(model.frames),
        "sites": list(model.sites),
        "configurations": {name: [float(x) for x in q] for name, q in model.configurations.items()},
        "defects": list(model.defects),
    }


def html_summary(robot: Robot) -> str | None:
    """Table of the joints for notebooks; None for a robot with constraints, which prints as text."""
    if robot.constraints:
        return None
    defects = f", {len(robot.defects)} defects" if robot.defects else ""
    mass = number(robot.model.moving_mass)
    title = f"{robot.name}: nq = {robot.nq}, nv = {robot.nv}, {mass} kg moving, tip {robot.tip}{defects}"
    names = [name.replace("_", " ") for name in _SHOWN]
    return html_table(title, names, ([row[name] for name in _SHOWN] for row in joint_rows(robot.model)))


def joint_rows(model: Model) -> list[dict[str, Any]]:
    """Rows for each velocity entry of each joint, with the entries :data:`COLUMNS`; actuator rotors have no rows.

    A mimic joint's row names its leader, ratio and offset, without limits, damping and friction. Effort, damping, friction and
    armature of coupled joints belong to their motors and are left out.
    """
    rows: list[dict[str, Any]] = []
    c, limits, friction = Coordinates.from_model(model), model.limits, model.friction
    coupled = coupled_entries(model)
    for i, b in enumerate(model.bodies):
        if not b.joint.moves_body:
            continue
        for k in range(b.v_index, b.v_index + b.joint.nv):
            known: dict[str, float] = {}
            if not b.follows:
                known = {kind: getattr(limits, kind)[k] for kind in _KINDS}
                known |= {
                    "damping": friction.viscous[k], "friction": friction.coulomb[k], "armature": model.armature[k],
                }  # fmt: skip
            if coupled[k] and not b.follows:
                known |= dict.fromkeys(("effort", "damping", "friction", "armature"), math.nan)
            angular = bool(b.joint.axes[0, :3].any()) if b.follows else bool(c.angular_velocity[k])
            row = {
                "joint": b.joint.name,
                "velocity_name": b.joint.name if b.follows else c.velocity_names[k],
                "type": b.joint.kind,
                "parent_link": link_of(model, b.parent) if b.parent != BASE else _root(model),
                "child_link": link_of(model, i),
                "unit": unit_of("q", angular),
                **{name: float(x) if math.isfinite(x) else None for name, x in known.items()},
                "leader": c.velocity_names[k] if b.follows else None,
                "ratio": float(b.ratio) if b.follows else None,
                "offset": float(b.offset) if b.follows else None,
            }
            rows.append({name: row.get(name) for name in COLUMNS})
    return rows


def as_text(robot: Robot, kind: Literal["json", "csv"]) -> str:
    """:func:`summary` as JSON, or :func:`joint_rows` as CSV with a header; unknown values are null or empty."""
    if kind == "json":
        return json.dumps(summary(robot), indent=2, ensure_ascii=False) + "\n"
    file = io.BytesIO()
    writer = CsvWriter(file)
    writer.row(COLUMNS)
    for row in joint_rows(robot.model):
        writer.row(row.values())
    return file.getvalue().decode()


def _root(model: Model) -> str:
    """Root of the file's tree: first link of the base."""
    return next((name for name, f in model.frames.items() if f.body == BASE), "base")


def _links(model: Model) -> list[dict[str, Any]]:
    return [
        {
            "link": link,
            "moves_with": link_of(model, model.frames[link].body if link in model.frames else BASE),
            "mass": float(inertia.mass),
            "com": [float(x) for x in inertia.com],
            "moment_about_com": np.asarray(inertia.moment_about_com, float).tolist(),
        }
        for link, inertia in model.link_inertias.items()
        if inertia.parameters.any()
    ]


def link_of(model: Model, body: int) -> str:
    """Link whose frame is the body frame, the child of its joint; "base" for the base."""
    if body == BASE:
        return "base"
    names = [name for name, f in model.frames.items() if f.body == body]
    return next(
        (n for n in names if np.array_equal(model.frames[n].pose, np.eye(4))), names[0] if names else f"body {body}"
    )


# ── Configurations and rates as typed in a shell

_PLAINLY_DEGREES = 3 * math.tau
"""Magnitude [rad] above which a coordinate is taken for degrees: three turns are rare, 19 degrees are not."""


def parse_configuration(
    robot: Robot,
    at: Iterable[str],
    *,
    degrees: bool,
    option: str = "--at",
    start: Array | None = None,
) -> Array:
    """Configuration (nq,) from texts ``JOINT=VALUE``, or from one text with all coordinates.

    All coordinates are ``v,v,…`` or the name of a configuration of the robot. Other joints keep their value of ``start`` (nq,),
    by default neutral. Raises ValueRangeError and UnknownNameError.
    """
    q = np.array(robot.neutral if start is None else start)
    single = [text for text in at if "=" in text]
    wholes = [(option, text) for text in at if "=" not in text]
    if len(wholes) > 1:
        both = " and ".join(f"{name} {text!r}" for name, text in wholes[:2])
        raise ValueRangeError(f"{both} both set all coordinates. Keep one of them; others are JOINT=VALUE.")
    unit = np.where(Coordinates.from_model(robot.model).angular & degrees, math.radians(1.0), 1.0)
    for name, text in wholes:
        q = _all_coordinates(robot, text, name, unit)
    for body, numbers in _named(robot, single, option, velocities=False):
        here = body.places[0]
        q[here] = np.array(numbers) * unit[here]
    return q


def _all_coordinates(robot: Robot, text: str, option: str, unit: Array) -> Array:
    known = robot.configurations
    if text in known:
        return np.array(known[text])
    names = robot.coordinate_names
    form = f"{robot.nq} numbers, {','.join(names[:8])}{',…' if len(names) > 8 else ''}; or JOINT=VALUE, as {_example(robot)}"
    if known:
        form += f"; or a configuration of the file: {', '.join(list(known)[:8])}{', …' if len(known) > 8 else ''}"
    return np.array(parse_numbers(text, option, form, robot.nq)) * unit


def _example(robot: Robot) -> str:
    """Example JOINT=VALUE with a joint of one coordinate; a free joint needs seven."""
    single = [body.joint.name for body in robot.model.leaders if body.joint.nq == 1]
    return f"{single[0] if single else 'joint1'}=0.5"


def degrees_hint(robot: Robot, q: Array) -> str:
    """Hint on coordinates q (nq,) [rad] that are obviously degrees; otherwise empty.

    >>> import twistwrench as tw
    >>> degrees_hint(tw.robots.planar_2r(), np.array([90.0, 0.0]))[:45]
    'joint1 is at 90 rad, 14.3 turns. For degrees '
    >>> degrees_hint(tw.robots.planar_2r(), np.array([-6.5, 0.0]))
    ''
    """
    angular = np.where(Coordinates.from_model(robot.model).angular, np.abs(q), 0.0)
    if angular.max(initial=0.0) < _PLAINLY_DEGREES:
        return ""
    k = int(np.argmax(angular))
    name = robot.coordinate_names[k]
    return f"{name} is at {printed(q[k])} rad, {number(angular[k] / math.tau, 3)} turns. For degrees add --degrees."


def parse_rates(robot: Robot, texts: Iterable[str], option: str, *, degrees: bool) -> Array:
    """Velocities or torques (nv,) from texts ``JOINT=VALUE``, others zero; ``degrees`` applies to turning joints.

    Raises ValueRangeError and UnknownNameError.
    """
    found = np.zeros(robot.nv)
    for body, numbers in _named(robot, texts, option, velocities=True):
        here = body.places[1]
        turning = np.any(body.joint.axes[:, :3] != 0, axis=1)
        found[here] = np.where(turning & degrees, np.radians(numbers), numbers)
    return found


def parse_numbers(text: str, what: str, form: str, *counts: int) -> list[float]:
    """Parse finite numbers separated by commas, of one of these counts; ValueRangeError shows the form."""
    try:
        numbers = [float(x) for x in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        raise ValueRangeError(f"{what} {text!r}: expected {form}.")
    return numbers


def assignments(texts: Iterable[str], option: str, form: str) -> dict[str, str]:
    """Values by name from texts ``NAME=VALUE``; ValueRangeError shows the form."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise ValueRangeError(f"{option} {text!r} is not {form}.")
        if name in found:
            raise ValueRangeError(f"{option} {name} is given twice. Keep one of them.")
        found[name] = value
    return found


def _named(robot: Robot, texts: Iterable[str], option: str, *, velocities: bool) -> list[tuple[Body, list[float]]]:
    known, found = {b.joint.name: b for b in robot.model.leaders}, []
    for joint, value in assignments(texts, option, f"JOINT=VALUE, for example {_example(robot)}").items():
        if joint not in known:
            raise UnknownNameError.from_choices("joint", joint, known)
        count = known[joint].joint.nv if velocities else known[joint].joint.nq
        form = f"{count} number{'s' if count > 1 else ''}"
        found.append((known[joint], parse_numbers(value, f"{option} {joint}", form, count)))
    return found


# ── Joint limits from a CSV file, ``joint,lower,upper,velocity,effort,acceleration,deceleration,jerk``

# The table of ``twistwrench info --csv`` is accepted: one row for each entry of dq; its other columns are ignored.

_BEYOND = {sign + word: float(sign + "inf") for word in ("inf", "infinity") for sign in ("", "+", "-")} | {
    "nan": math.nan
}
"""Words for numbers."""
_PARTS = {"lower": "q", "upper": "q", "velocity": "dq", "acceleration": "ddq", "deceleration": "ddq", "effort": "tau"}
"""Quantities of the kinds of limits, for their units; jerk is one by itself."""


def read_limits(path: str | Path | None, model: Model, *, degrees: bool = False) -> Limits:
    """Limits of the model, replaced by those of a file where given.

    Angles have the unit of the head, ``velocity [deg/s]``, else of the column ``unit``, else degrees if ``degrees``.
    Raises :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.UnknownNameError` and
    :class:`~twistwrench.ValueRangeError`, naming file, line and column.
    """
    if path is None:
        return model.limits
    path = as_path(path)
    with table_errors(path, "limits file", f"joint,{','.join(_KINDS)}, then a line per joint"):
        file = CsvFile.open(path)
        header, units = _header(file)
        rows = list(file.rows())
    joints = Coordinates.from_model(model)
    found = {kind: getattr(model.limits, kind).copy() for kind in _KINDS}
    seen: set[str] = set()
    stated, with_unit = np.zeros(model.nv, bool), np.zeros((len(_KINDS), model.nv), bool)
    for line, cells in rows:
        row, where = dict(zip(header, cells, strict=True)), f"{path}: line {line}"
        if row.get("leader"):
            continue
        joint = row.get("velocity_name") or row["joint"]
        values = {kind: _limit(row[kind], kind, where, file.dialect) for kind in _KINDS if row.get(kind)}
        k = _check(joint, values, joints, seen, where)
        if "effort" in values:
            refuse_coupled(
                model, [joint], "has no effort by itself. Give the motors' in the actuator file, and leave it blank"
            )
        seen.add(joint)
        stated[k] = "effort" in values
        turns = bool(joints.angular_velocity[k])
        unit = row.get("unit") or unit_of("q", turns, degrees=degrees)
        angle = _factor(unit, "q", turns, f"{where}, column 'unit'")
        for kind, value in values.items():
            part = _PARTS.get(kind, kind)
            of_head = _factor(units[kind], part, turns, f"{where}, column {kind!r}") if kind in units else None
            found[kind][k] = value * (of_head or (1.0 if kind == "effort" else angle))
            with_unit[_KINDS.index(kind), k] = of_head is not None
        if "acceleration" in values and "deceleration" not in values:
            found["deceleration"][k] = found["acceleration"][k]
        if found["lower"][k] > found["upper"][k]:
            raise ValueRangeError(
                f"{where}: the lower limit of {joint!r}, {printed(found['lower'][k])}, is above the upper, "
                f"{printed(found['upper'][k])}. Swap them."
            )
    return StatedLimits(**found, stated=stated, with_unit=with_unit)


def _factor(unit: str, part: str, turns: bool, where: str) -> float:
    """Factor from a unit to SI units; raises ValueRangeError for units of other quantities."""
    factor = si_factor(unit, part, turns)
    if factor is None:
        joint = "turning" if turns else "sliding"
        raise ValueRangeError(
            f"{where}: {unit!r} is not a unit of this limit of a {joint} joint. Write one of {known_units(part, turns)}."
        )
    return factor


def _check(joint: str, values: dict[str, float], joints: Coordinates, seen: set[str], where: str) -> int:
    """Velocity index of a joint; raises for unknown and repeated joints and for positions of joints without one."""
    known = joints.velocity_names
    if joint not in known:
        raise ValueRangeError(f"{where}: {UnknownNameError.from_choices('joint', joint, known)}")
    if joint in seen:
        raise ValueRangeError(f"{where}: joint {joint!r} has limits already. Keep one line for each joint.")
    k = known.index(joint)
    bounded = [kind for kind in ("lower", "upper") if math.isfinite(values.get(kind, math.inf))]
    if joints.position_of[k] < 0 and bounded:
        raise ValueRangeError(
            f"{where}, column {bounded[0]!r}: {joint!r} is a velocity in the frame of a moving body, and no position "
            "belongs to it. Give limits of velocity and effort, and leave lower and upper blank."
        )
    return k


def _header(file: CsvFile) -> tuple[list[str], dict[str, str]]:
    """Column names, and the units of heads that name one, ``velocity [deg/s]``."""
    heads = [(name.lower(), unit) for name, unit in map(split_unit, file.header)]
    header = [name for name, _ in heads]
    unknown = [name for name in header if name not in COLUMNS]
    if "joint" not in header or unknown or len(set(header)) < len(header):
        raise ValueRangeError(
            f"{file.path}: line {file.header_line}: the header is {','.join(file.header)!r}. Name 'joint' and any of "
            f"{', '.join(_KINDS)}, each once, separated by commas."
        )
    return header, {name: unit for name, unit in heads if unit and name in _KINDS}


def _limit(text: str, kind: str, where: str, dialect: Dialect) -> float:
    value = _BEYOND[text.lower()] if text.lower() in _BEYOND else dialect.number(text)
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


def limits_table(model: Model, limits: Limits, *, degrees: bool = False) -> blocks.Table:
    """Limits used by a report and their source; angles in degrees if ``degrees``."""
    turning = Coordinates.from_model(model).angular_velocity
    unit = np.where(turning & degrees, math.degrees(1.0), 1.0)
    stated = limits.stated if isinstance(limits, StatedLimits) else np.zeros(model.nv, bool)
    known = np.isfinite(limits.effort)
    sources = [
        ("--limits" if own else "robot's file") if has else "none" for own, has in zip(stated, known, strict=True)
    ]
    for c in model.couplings:
        for joint in c.joints:
            sources[model.velocity_names.index(joint)] = f"of motors {listed(c.motors)}"
    return blocks.Table(
        "Limits used",
        blocks.words("joint", model.velocity_names),
        blocks.numbers("torque", joint_effort(model, limits.effort), unit=heading_unit("tau", turning)),
        blocks.numbers("velocity", unit * limits.velocity, unit=heading_unit("dq", turning, degrees=degrees)),
        blocks.numbers("lower", unit * limits.lower, unit=heading_unit("q", turning, degrees=degrees)),
        blocks.numbers("upper", unit * limits.upper, unit=heading_unit("q", turning, degrees=degrees), headed=False),
        blocks.words("source of the torque limit", sources),
    )
