"""Robot as plain data, and its limits as a table."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.numbers import number
from ..core.tables import CsvWriter, html_table
from ..mechanics.joints.units import unit_of
from ..mechanics.model.couplings import coupled_entries
from ..mechanics.model.model import BASE, Model
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


def limits_csv(robot: Robot) -> str:
    """:func:`joint_rows` as CSV with a header; unknown values are empty."""
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
