"""What a robot is made of as plain data, for programs: the same facts that ``info`` prints, in SI units and radians."""

from __future__ import annotations

import io
import json
import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.csv_writer import CsvWriter
from ..joints.units import unit_of
from ..model.model import BASE, Body, Model
from ..motion.coordinates import Coordinates

if TYPE_CHECKING:
    from ..robot import Robot

COLUMNS = (
    "joint", "velocity_name", "type", "parent_link", "child_link", "unit", "lower", "upper", "velocity", "effort",
    "damping", "friction", "armature", "leader", "ratio", "offset",
)  # fmt: skip
"""The entries of a row of :func:`joint_rows`."""


def summary(robot: Robot) -> dict[str, Any]:
    """The robot as a dictionary that ``json.dumps`` takes: joints, links, frames, masses, defects.

    Parameters
    ----------
    robot
        Any robot.

    Returns
    -------
    dict
        ``name``, ``nq``, ``nv``, ``gravity`` [m/s^2], ``tip``, ``moving_mass`` and ``fixed_mass`` [kg], ``joints``
        (:func:`joint_rows`), ``links`` (those with mass: ``mass`` [kg], ``com`` [m] and ``moment_about_com`` [kg m^2]
        in the link's frame), ``frames`` of links, ``sites``, ``configurations`` (the q of each name), ``defects``. Angles
        are in rad. What is not known or not limited is None.

    Examples
    --------
    >>> import twistwrench as tw
    >>> summary(tw.robots.planar_2r())["joints"][0]["effort"] is None
    True
    """
    model = robot.model
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


def joint_rows(model: Model) -> list[dict[str, Any]]:
    """A row for each velocity entry of each joint, with the entries :data:`COLUMNS`; rotors of actuators have none.

    A mimic joint's row names its leader, ratio and offset, and has no limits, damping and friction of its own.
    """
    rows: list[dict[str, Any]] = []
    c, limits, friction = Coordinates.of(model), model.limits, model.friction
    for i, b in enumerate(model.bodies):
        if not b.joint.moves_body:
            continue
        for k in range(b.v_index, b.v_index + b.joint.nv):
            known: dict[str, float] = {}
            if not b.follows:
                known = {
                    "lower": limits.lower[k], "upper": limits.upper[k], "velocity": limits.velocity[k],
                    "effort": limits.effort[k], "damping": friction.viscous[k], "friction": friction.coulomb[k],
                    "armature": model.armature[k],
                }  # fmt: skip
            angular = bool(b.joint.axes[0, :3].any()) if b.follows else bool(c.angular_velocity[k])
            row = {
                "joint": b.joint.name,
                "velocity_name": b.joint.name if b.follows else c.velocity_names[k],
                "type": b.joint.kind,
                "parent_link": link_of(model, b.parent) if b.parent != BASE else _root(model),
                "child_link": link_of(model, i),
                "unit": unit_of("q", angular),
                **{name: float(x) if math.isfinite(x) else None for name, x in known.items()},
                **(_coupling(b, c.velocity_names[k]) if b.follows else {}),
            }
            rows.append({name: row.get(name) for name in COLUMNS})
    return rows


def as_text(robot: Robot, kind: Literal["json", "csv"]) -> str:
    """:func:`summary` as JSON, or :func:`joint_rows` as CSV with a header; what is not known is null or empty."""
    if kind == "json":
        return json.dumps(summary(robot), indent=2, ensure_ascii=False) + "\n"
    file = io.BytesIO()
    writer = CsvWriter(file)
    writer.row(COLUMNS)
    for row in joint_rows(robot.model):
        writer.row(row.values())
    return file.getvalue().decode()


def _root(model: Model) -> str:
    """The first link of the base, which is the root of the file's tree."""
    return next((name for name, f in model.frames.items() if f.body == BASE), "base")


def _coupling(follower: Body, leader: str) -> dict[str, Any]:
    return {"leader": leader, "ratio": float(follower.ratio), "offset": float(follower.offset)}


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
    """The link whose frame is the body's own, the child of its joint; "base" for the base."""
    if body == BASE:
        return "base"
    names = [name for name, f in model.frames.items() if f.body == body]
    return next(
        (n for n in names if np.array_equal(model.frames[n].pose, np.eye(4))), names[0] if names else f"body {body}"
    )
