"""Robot as plain data, and its limits as a table."""

from __future__ import annotations

import io
import math
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.numbers import number
from ..core.tables import CsvWriter, html_table
from ..mechanics.joints.units import unit_of
from ..mechanics.model.couplings import coupled_entries
from ..mechanics.model.model import BASE, Model
from ..motion.coordinates import Coordinates
from ..motion.limits_file import COLUMNS, KINDS
from ..robot.base import require_robot

if TYPE_CHECKING:
    from ..robot import Robot

_NOTEBOOK_COLUMNS = ("joint", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort")
"""Columns of the table in notebooks."""


def summary(robot: Robot) -> dict[str, Any]:
    """Robot as a dictionary for ``json.dumps``: joints, links, frames, masses, defects."""
    model = require_robot(robot, "info").model
    return {
        "name": model.name,
        "nq": model.nq,
        "nv": model.nv,
        "gravity": np.asarray(model.gravity, float).tolist(),
        "tip": model.tip,
        "moving_mass": model.moving_mass,
        "fixed_mass": float(model.base_inertia.mass),
        "joints": joint_rows(model),
        "links": _links(model),
        "frames": list(model.frames),
        "sites": list(model.sites),
        "configurations": {name: np.asarray(q, float).tolist() for name, q in model.configurations.items()},
        "defects": list(model.defects),
    }


def html_summary(robot: Robot) -> str | None:
    """Table of the joints for notebooks; None for a robot with constraints, which prints as text."""
    if robot.constraints:
        return None
    mass = number(robot.model.moving_mass)
    title = f"{robot.name}: nq = {robot.nq}, nv = {robot.nv}, {mass} kg moving, tip {robot.tip or 'none'}"
    if robot.defects:
        title += f", {len(robot.defects)} defects"
    heads = [name.replace("_", " ") for name in _NOTEBOOK_COLUMNS]
    cells_of_row = itemgetter(*_NOTEBOOK_COLUMNS)
    return html_table(title, heads, map(cells_of_row, joint_rows(robot.model)))


def joint_rows(model: Model) -> list[dict[str, Any]]:
    """A row for each velocity of each joint, by :data:`COLUMNS`; an unknown value is None. Actuator rotors have no rows.

    The row of a mimic joint has its leader, ratio and offset, and neither limits nor losses. Rows of coupled joints have no
    effort, damping, friction and armature, since these belong to the motors.
    """
    rows: list[dict[str, Any]] = []
    coordinates = Coordinates.from_model(model)
    is_coupled = coupled_entries(model)  # of each velocity
    for body_index, body in enumerate(model.bodies):
        joint = body.joint
        if not joint.moves_body:
            continue
        for k in range(body.v_index, body.v_index + joint.nv):
            row = dict.fromkeys(COLUMNS)  # None for all, in the order of the columns
            row["type"] = joint.kind
            row["joint"] = joint.name
            row["parent_link"] = _root(model) if body.parent == BASE else link_of(model, body.parent)
            row["child_link"] = link_of(model, body_index)
            if body.follows:  # a mimic joint: velocity k belongs to its leader
                row["velocity_name"] = joint.name
                row["unit"] = unit_of("q", joint.turning[0])
                row["leader"] = coordinates.velocity_names[k]
                row["ratio"] = float(body.ratio)
                row["offset"] = float(body.offset)
            else:
                row["velocity_name"] = coordinates.velocity_names[k]
                row["unit"] = unit_of("q", bool(coordinates.angular_velocity[k]))
                row.update(_joint_figures(model, k, is_coupled=bool(is_coupled[k])))
            rows.append(row)
    return rows


def _joint_figures(model: Model, k: int, *, is_coupled: bool) -> dict[str, float | None]:
    """Limits, friction and armature of velocity k.

    A figure is None if it is unknown, or if it belongs to the motors of a coupled joint.
    """
    figures = {kind: getattr(model.limits, kind)[k] for kind in KINDS if kind in COLUMNS}
    figures["damping"] = model.friction.viscous[k]
    figures["friction"] = model.friction.coulomb[k]
    figures["armature"] = model.armature[k]
    if is_coupled:
        figures |= dict.fromkeys(("effort", "damping", "friction", "armature"), math.nan)
    return {name: float(x) if math.isfinite(x) else None for name, x in figures.items()}


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
    links_of_base = (name for name, frame in model.frames.items() if frame.body == BASE)
    return next(links_of_base, "base")


def _links(model: Model) -> list[dict[str, Any]]:
    """Name, carrier, mass, centre of mass and inertia of each link with inertia, in the link's own frame."""
    links = []
    for link, inertia in model.link_inertias.items():
        if not inertia.parameters.any():
            continue
        body = body_of_link(model, link)
        row = {
            "link": link,
            "moves_with": link_of(model, body),
            "mass": float(inertia.mass),
            "com": np.asarray(inertia.com, float).tolist(),
            "moment_about_com": np.asarray(inertia.moment_about_com, float).tolist(),
        }
        links.append(row)
    return links


def body_of_link(model: Model, link: str) -> int:
    """Index of the body that moves a link; BASE for links that are not frames."""
    return model.frames[link].body if link in model.frames else BASE


def link_of(model: Model, body: int) -> str:
    """Link whose frame is the body frame, which is the child of the body's joint; "base" for the base.

    If no link has the body frame, this is the first link of the body.
    """
    if body == BASE:
        return "base"
    names = [name for name, frame in model.frames.items() if frame.body == body]
    for name in names:
        if np.array_equal(model.frames[name].pose, np.eye(4)):
            return name
    if names:
        return names[0]
    return f"body {body}"  # of no link, between two joints
