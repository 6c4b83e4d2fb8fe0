"""Robot as plain data, its limits as a table, and joint values from command-line options."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..answers import blocks
from ..core.arguments import assignments, parse_numbers
from ..core.errors import UnknownNameError, ValueRangeError
from ..core.numbers import number, printed
from ..core.tables import CsvWriter, html_table
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.joints.units import heading_unit, unit_of
from ..mechanics.model.couplings import coupled_entries, joint_effort
from ..mechanics.model.limits import Limits, StatedLimits
from ..mechanics.model.model import BASE, Body, Model
from ..motion.coordinates import Coordinates
from ..motion.limits_file import COLUMNS, KINDS
from ..robot.task_space_methods import require_robot

if TYPE_CHECKING:
    from ..robot import Robot

_SHOWN = ("joint", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort")
"""Columns of the table in notebooks."""


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
                known = {kind: getattr(limits, kind)[k] for kind in KINDS}
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


def _named(robot: Robot, texts: Iterable[str], option: str, *, velocities: bool) -> list[tuple[Body, list[float]]]:
    known, found = {b.joint.name: b for b in robot.model.leaders}, []
    for joint, value in assignments(texts, option, f"JOINT=VALUE, for example {_example(robot)}").items():
        if joint not in known:
            raise UnknownNameError.from_choices("joint", joint, known)
        count = known[joint].joint.nv if velocities else known[joint].joint.nq
        form = f"{count} number{'s' if count > 1 else ''}"
        found.append((known[joint], parse_numbers(value, f"{option} {joint}", form, count)))
    return found


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
