"""Contents of a robot as blocks: joints, actuators, inertias and tree."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..core.answers.blocks import Block, Branch, Level, Line, More, Piece, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints.units import heading_unit
from ..mechanics.model.actuators import RATINGS
from ..mechanics.model.couplings import coupled_entries, joint_effort
from ..mechanics.model.description import grouped
from ..mechanics.model.model import BASE, Body, Model
from ..motion.coordinates import Coordinates
from ..motion.model_doubts import base_doubts
from ..robot import Robot
from .robot_summary import body_of_link, link_of

MAX_DEPTH = 12
"""Largest depth of the tree; deeper levels continue at the left margin."""
_MAX_ROWS = 12
"""Largest number of rows of a table in the short form."""
_MAX_BODIES = 6
"""Largest number of bodies with which the short form has inertias and the tree."""
_MAX_NOTES = 2
"""Largest number of notes in the short form."""
_MAX_NAMES = 8
"""Largest number of listed names."""


def info_view(robot: Robot, *, degrees: bool = False) -> Iterator[Block]:
    """Heading, joints, actuators, inertias and tree of a robot; ``degrees``: angles in degrees."""
    model = robot.model
    level = Level.ALL if len(model.bodies) > _MAX_BODIES else Level.SHORT
    yield _heading(model)
    yield _joints_table(model, degrees=degrees)
    if model.actuators:
        yield _actuators_table(model)
    for k in range(len(model.couplings)):
        yield _coupling_table(model, k, level)
    yield _inertias_table(model, level)
    yield _tree(model, level)
    doubts = [f"{text}." for text in base_doubts(model)]
    notes = remarks([*grouped(model.defects), *doubts])
    yield from notes[:_MAX_NOTES]
    for note in notes[_MAX_NOTES:]:
        yield replace(note, level=Level.ALL)
    left_out = []
    if level is Level.ALL:
        left_out.append(f"Inertias of {len(_links_with_mass(model))} links, tree")
    if len(notes) > _MAX_NOTES:
        left_out.append(f"{len(notes) - _MAX_NOTES} more notes")
    if left_out:
        yield More(", ".join(left_out))


def _heading(model: Model) -> Line:
    """Name, counts, masses, gravity, tip and configurations."""
    rotor_count = sum(not b.joint.moves_body for b in model.bodies)
    bodies = f"{len(model.bodies) - rotor_count} moving bodies"
    if rotor_count:
        bodies += f" and {rotor_count} rotors"
    counts = f"{bodies}, {model.nq} coordinates, {model.nv} velocities, {len(model.all_frames)} frames"
    gravity = " ".join(map(number, model.gravity))
    moving_mass = number(model.moving_mass)
    fixed_mass = number(model.base_inertia.mass)
    masses = f"mass {moving_mass} kg moving, {fixed_mass} kg fixed  ·  gravity [{gravity}] m/s²"
    text = f"  {counts}\n{masses}  ·  tip {_tip(model)}"
    if model.configurations:
        text += f"\nconfigurations {listed([*model.configurations], _MAX_NAMES)}"
    return Line((model.name, Style.STRONG), text)


def _tip(model: Model) -> str:
    """Text of the tip and the other leaves of its body; of all leaves for a robot without a tip."""
    if model.tip is None:
        leaves = listed(model.leaves, _MAX_NAMES) if model.leaves else "none"
        return f"none; leaves: {leaves}"
    body = model.all_frames[model.tip].body
    leaves_of_body = [name for name in model.leaves if model.frames[name].body == body]
    other_leaves = [name for name in leaves_of_body if name != model.tip]
    if not other_leaves:
        return model.tip
    return f"{model.tip} (beside it: {', '.join(other_leaves)})"


class _JointRow(NamedTuple):
    """Row of the table of joints."""

    name: str
    """Name of the joint, or of one of its velocities."""
    kind: str
    """Type of the joint; empty in all but its first row."""
    link: str
    """Link that the joint carries; empty in all but its first row."""
    velocity: int | None
    """Index of the velocity whose limits the row has; None for a mimic joint."""


def _joints_table(model: Model, *, degrees: bool) -> Table:
    """Table of joints with limits, friction and armature; mimic joints have blank figures."""
    is_angular = Coordinates.from_model(model).angular_velocity
    unit_factors = np.where(is_angular & degrees, math.degrees(1.0), 1.0)  # of each velocity
    rows = list(_joint_rows(model, unit_factors, degrees=degrees))
    columns = []
    for heading, figures in _joint_figures(model, unit_factors).items():
        cells = ["" if row.velocity is None else float(figures[row.velocity]) for row in rows]
        columns.append(numbers(heading, cells))
    unit_text = partial(heading_unit, turning=(True, False), degrees=degrees)  # of revolute and sliding joints
    return Table(
        "Joints",
        words("joint", [row.name for row in rows]),
        words("kind", [row.kind for row in rows]),
        words("carries", [row.link for row in rows]),
        *columns,
        detail=f": positions in {unit_text('q')}, velocities in {unit_text('dq')}, efforts in {unit_text('tau')}",
        most=_MAX_ROWS,
    )


def _joint_rows(model: Model, unit_factors: Array, *, degrees: bool) -> Iterator[_JointRow]:
    """A row for each velocity of each joint; rotors are listed in the table of actuators."""
    names = Coordinates.from_model(model).velocity_names
    for i, b in enumerate(model.bodies):
        if b.follows and not b.joint.moves_body:
            continue
        for k in range(b.v_index, b.v_index + b.joint.nv):
            if b.follows:
                rule = _mimic_rule(b, names[k], unit_factors[k], degrees=degrees)
                yield _JointRow(b.joint.name, f"{b.joint.kind},\n{rule}", link_of(model, i), None)
            elif k == b.v_index:
                yield _JointRow(names[k], b.joint.kind, link_of(model, i), k)
            else:
                yield _JointRow(names[k], "", "", k)


def _joint_figures(model: Model, unit_factors: Array) -> dict[str, Array]:
    """Limits, friction and armature (nv,) by the heading of their column, in the units of the table."""
    limits = model.limits
    friction = model.friction
    is_coupled = coupled_entries(model)  # the table of the coupling has their friction and armature, of the motors
    figures = {
        "lower": unit_factors * limits.lower,
        "upper": unit_factors * limits.upper,
        "velocity": unit_factors * limits.velocity,
        "effort": joint_effort(model, limits.effort),
    }
    for name in ("acceleration", "deceleration", "jerk"):
        limit = getattr(limits, name)
        if np.isfinite(limit).any():
            figures[name] = unit_factors * limit
    if friction.any:
        figures["damping"] = np.where(is_coupled, np.nan, friction.viscous)
        figures["friction"] = np.where(is_coupled, np.nan, friction.coulomb)
    if model.armature.any():
        figures["armature"] = np.where(is_coupled, np.nan, model.armature)
    return figures


def _actuators_table(model: Model) -> Table:
    """Gears, rotors and motors; unknown values are left blank."""
    actuators = list(model.actuators.values())
    ratings = []
    for name, rating in RATINGS.items():
        if rating.head:
            values = [getattr(a.motor, name, "") for a in actuators]
            ratings.append(numbers(rating.head, values))
    return Table(
        "Actuators",
        words("joint", [a.joint for a in actuators]),
        numbers("ratio", [a.ratio for a in actuators]),
        numbers("η", [a.efficiency for a in actuators]),
        numbers("rotor", [a.rotor.inertia if a.rotor else math.inf for a in actuators]),
        numbers("stiffness", [a.stiffness for a in actuators]),
        *ratings,
        detail=" (SI units)",
        most=_MAX_ROWS,
    )


def _coupling_table(model: Model, k: int, level: Level) -> Table:
    """Table of coupled motors: velocities per joint velocity, effort, armature and friction."""
    coupling = model.couplings[k]
    rows, A, _ = model.coupled[k]  # velocities of the coupled joints; motor velocities = A · joint velocities
    return Table(
        f"Coupling {coupling.name}",
        words("motor", coupling.motors),
        *map(numbers, coupling.joints, A.T),
        numbers("effort", model.limits.effort[rows]),
        numbers("armature", model.armature[rows]),
        numbers("damping", model.friction.viscous[rows]),
        numbers("friction", model.friction.coulomb[rows]),
        detail=": velocity of each motor, behind its gear, per velocity of each joint (SI units)",
        level=level,
    )


def _mimic_rule(follower: Body, leader: str, leader_factor: float, *, degrees: bool) -> str:
    """Text of a mimic joint's position as a function of its leader's, in the units of the table.

    ``leader_factor`` converts the leader's position to its unit in the table.
    """
    factor = 1.0
    is_angular = follower.joint.axes[0, :3].any()  # angular part of the screw axis
    if degrees and is_angular:
        factor = math.degrees(1.0)
    ratio = follower.ratio * (factor / leader_factor)
    position = leader
    if ratio != 1.0:
        position = f"{number(ratio)} × {leader}"
    if follower.offset:
        sign = "+" if follower.offset > 0 else ""  # a negative number has its sign
        position += f" {sign}{number(factor * follower.offset)}"
    return f"follows {position}"


def _inertias_table(model: Model, level: Level) -> Table:
    """Table of links with mass, centre of mass and principal moments."""
    links, carriers, masses, centres, moments = [], [], [], [], []
    for link, inertia in _links_with_mass(model).items():
        links.append(link)
        carrier = body_of_link(model, link)
        carriers.append(link_of(model, carrier))
        masses.append(inertia.mass)
        centres.append(" ".join(map(number, inertia.com)))
        principal_moments, *_ = inertia.principal()
        moments.append(" ".join(map(number, principal_moments)))
    return Table(
        "Links with mass",
        words("link", links),
        words("moves with", carriers),
        numbers("mass", masses),
        numbers("centre of mass", centres, min_width=10),
        numbers("principal moments", moments, min_width=10),
        detail=", each in its own frame (kg, m, kg m²)",
        most=_MAX_ROWS,
        level=level,
    )


def _links_with_mass(model: Model) -> dict[str, SpatialInertia]:
    """Inertias that are not zero, by link."""
    return {link: inertia for link, inertia in model.link_inertias.items() if inertia.parameters.any()}


def _tree(model: Model, level: Level) -> Branch:
    """Tree of moving bodies; fixed frames are listed beside their body.

    Deeper levels continue at the left margin.
    """
    frames_by_body: dict[int, list[str]] = defaultdict(list)
    for name, frame in model.all_frames.items():
        frames_by_body[frame.body].append(name)
    root = Branch(Line(*_link_and_frames("base", frames_by_body[BASE])), level=level)
    branches = {BASE: root}
    depths = {BASE: 0}
    for i, b in enumerate(model.bodies):
        if b.follows and not b.joint.moves_body:  # a rotor stands beside the body that carries it
            branches[b.parent].label.pieces.append((f"  · {b.link}", Style.QUIET))
            continue
        if depths[b.parent] == MAX_DEPTH:
            branches[b.parent] = root.add(Line((link_of(model, b.parent), Style.STRONG), (" carries on:", Style.QUIET)))
            depths[b.parent] = 0
        joint_name = (b.joint.name, Style.POINTED)
        joint_kind = (f" ({b.joint.kind}) → ", Style.QUIET)
        link_and_frames = _link_and_frames(link_of(model, i), frames_by_body[i])
        branches[i] = branches[b.parent].add(Line(joint_name, joint_kind, *link_and_frames))
        depths[i] = depths[b.parent] + 1
    return root


def _link_and_frames(link: str, frames: list[str]) -> list[Piece]:
    """Pieces of a line: name of a link, and the other frames of its body."""
    other_frames = [name for name in frames if name != link]
    text = f"  + {', '.join(other_frames)}" if other_frames else ""
    return [(link, Style.STRONG), (text, Style.QUIET)]
