"""Contents of a robot as blocks: joints, actuators, inertias and tree."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from ..core.answers.blocks import Block, Branch, Level, Line, More, Piece, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import number
from ..core.text import listed
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints.units import heading_unit
from ..mechanics.model.actuators import RATINGS
from ..mechanics.model.couplings import coupled_entries, joint_effort
from ..mechanics.model.description import grouped
from ..mechanics.model.model import BASE, Body, Model
from ..motion.coordinates import Coordinates
from ..motion.model_doubts import base_doubts
from ..robot import Robot
from .robot_summary import link_of

DEEPEST = 12
"""Depth at which the tree continues at the left margin."""


_MOST, _LARGE, _MOST_NOTES, _MOST_NAMES = 12, 6, 2, 8
"""Maximum number of rows of a table; number of bodies above which the short form has the joints only; maximum numbers of
notes and of names of configurations."""


def info_view(robot: Robot, *, degrees: bool = False) -> Iterator[Block]:
    """Heading, joints, actuators, inertias and tree of a robot; angles in degrees if ``degrees``."""
    model = robot.model
    level = Level.ALL if len(model.bodies) > _LARGE else Level.SHORT
    yield _heading(model)
    yield _joints(model, degrees=degrees)
    if model.actuators:
        yield _actuators(model)
    yield from (_coupling(model, k, level) for k in range(len(model.couplings)))
    yield _inertias(model, level)
    yield _tree(model, level)
    notes = [*grouped(model.defects), *(f"{text}." for text in base_doubts(model))]
    for k, note in enumerate(remarks(notes)):
        yield note if k < _MOST_NOTES else replace(note, level=Level.ALL)
    if level is Level.ALL:
        more = f", {len(notes) - _MOST_NOTES} more notes" if len(notes) > _MOST_NOTES else ""
        yield More(f"Inertias of {len(_masses(model))} links, tree{more}")
    elif len(notes) > _MOST_NOTES:
        yield More(f"{len(notes) - _MOST_NOTES} more notes")


def _heading(model: Model) -> Line:
    gravity = " ".join(map(number, model.gravity))
    rotors = sum(not b.joint.moves_body for b in model.bodies)
    bodies = f"{len(model.bodies) - rotors} moving bodies" + (f" and {rotors} rotors" if rotors else "")
    counts = f"{bodies}, {model.nq} coordinates, {model.nv} velocities, {len(model.all_frames)} frames"
    named = f"\nconfigurations {listed([*model.configurations], _MOST_NAMES)}" if model.configurations else ""
    moving, fixed = number(model.moving_mass), number(model.base_inertia.mass)
    masses = f"mass {moving} kg moving, {fixed} kg fixed  ·  gravity [{gravity}] m/s²"
    return Line((model.name, Style.STRONG), f"  {counts}\n{masses}  ·  tip {_tip(model)}{named}")


def _tip(model: Model) -> str:
    """Tip and other leaves of its body."""
    if model.tip is None:
        return f"none; leaves: {listed(model.leaves, _MOST_NAMES) if model.leaves else 'none'}"
    body = model.all_frames[model.tip].body
    others = [name for name in model.leaves if name != model.tip and model.frames[name].body == body]
    return f"{model.tip} (beside it: {', '.join(others)})" if others else model.tip


def _joints(model: Model, *, degrees: bool) -> Table:
    c, limits, friction = Coordinates.from_model(model), model.limits, model.friction
    unit = np.where(c.angular_velocity & degrees, math.degrees(1.0), 1.0)
    names, kinds, links, rows = [], [], [], []
    for i, b in enumerate(model.bodies):
        if b.follows and not b.joint.moves_body:  # listed in the table of actuators
            continue
        for k in range(b.v_index, b.v_index + b.joint.nv):
            rule = f",\n{_rule(b, c.velocity_names[k], unit[k], degrees=degrees)}" if b.follows else ""
            first = k == b.v_index or b.follows
            names.append(b.joint.name if b.follows else c.velocity_names[k])
            kinds.append(f"{b.joint.kind}{rule}" if first else "")
            links.append(link_of(model, i) if first else "")
            rows.append(None if b.follows else k)

    figures = {"lower": unit * limits.lower, "upper": unit * limits.upper, "velocity": unit * limits.velocity}
    coupled = coupled_entries(model)
    figures["effort"] = joint_effort(model, limits.effort)
    for name in ("acceleration", "deceleration", "jerk"):
        if np.isfinite(getattr(limits, name)).any():
            figures[name] = unit * getattr(limits, name)
    if friction.any:
        laws = {"damping": friction.viscous, "friction": friction.coulomb}
        figures |= {name: np.where(coupled, np.nan, x) for name, x in laws.items()}
    if model.armature.any():
        figures["armature"] = np.where(coupled, np.nan, model.armature)
    units = (heading_unit(part, (True, False), degrees=degrees) for part in ("q", "dq", "tau"))
    return Table(
        "Joints: positions in {}, velocities in {}, efforts in {}".format(*units),
        words("joint", names),
        words("kind", kinds),
        words("carries", links),
        *(numbers(head, ["" if k is None else float(x[k]) for k in rows]) for head, x in figures.items()),
        most=_MOST,
    )


def _actuators(model: Model) -> Table:
    """Gears, rotors and motors; unknown values are left blank."""
    actuators = list(model.actuators.values())
    return Table(
        "Actuators (SI units)",
        words("joint", [a.joint for a in actuators]),
        numbers("ratio", [a.ratio for a in actuators]),
        numbers("η", [a.efficiency for a in actuators]),
        numbers("rotor", [a.rotor.inertia if a.rotor else math.inf for a in actuators]),
        numbers("stiffness", [a.stiffness for a in actuators]),
        *(
            numbers(row.head, [getattr(a.motor, name, "") for a in actuators])
            for name, row in RATINGS.items()
            if row.head
        ),
        most=_MOST,
    )


def _coupling(model: Model, k: int, level: Level) -> Table:
    """Velocities of coupled motors per joint velocity, and indices of these motors."""
    c, (at, A, _) = model.couplings[k], model.coupled[k]
    return Table(
        f"Coupling {c.name}: velocity of each motor, behind its gear, per velocity of each joint (SI units)",
        words("motor", c.motors),
        *(numbers(joint, column) for joint, column in zip(c.joints, A.T, strict=True)),
        numbers("effort", model.limits.effort[at]),
        numbers("armature", model.armature[at]),
        numbers("damping", model.friction.viscous[at]),
        numbers("friction", model.friction.coulomb[at]),
        level=level,
    )


def _rule(follower: Body, leader: str, leader_factor: float, *, degrees: bool) -> str:
    """Coupling of a mimic joint in the table's units."""
    factor = math.degrees(1.0) if degrees and follower.joint.axes[0, :3].any() else 1.0
    ratio = follower.ratio * (factor / leader_factor)
    share = "" if ratio == 1.0 else f"{number(ratio)} × "
    offset = f" {'+' if follower.offset > 0 else ''}{number(factor * follower.offset)}" if follower.offset else ""
    return f"follows {share}{leader}{offset}"


def _inertias(model: Model, level: Level) -> Table:
    links = _masses(model)
    bodies = [model.frames[link].body if link in model.frames else BASE for link in links]

    def three(values: Iterable[float]) -> str:
        return " ".join(map(number, values))

    return Table(
        "Links with mass, each in its own frame (kg, m, kg m²)",
        words("link", links),
        words("moves with", [link_of(model, body) for body in bodies]),
        numbers("mass", [inertia.mass for inertia in links.values()]),
        numbers("centre of mass", [three(inertia.com) for inertia in links.values()], min_width=10),
        numbers("principal moments", [three(inertia.principal()[0]) for inertia in links.values()], min_width=10),
        most=_MOST,
        level=level,
    )


def _masses(model: Model) -> dict[str, SpatialInertia]:
    return {link: inertia for link, inertia in model.link_inertias.items() if inertia.parameters.any()}


def _tree(model: Model, level: Level) -> Branch:
    """Tree of moving bodies; fixed frames are listed beside their body.

    Deeper levels continue at the left margin.
    """
    fixed = {i: [name for name, f in model.all_frames.items() if f.body == i] for i in range(BASE, len(model.bodies))}
    root = Branch(Line(*_frames("base", fixed[BASE])), level=level)
    branches, depths = {BASE: root}, {BASE: 0}
    for i, b in enumerate(model.bodies):
        if not b.joint.moves_body and b.follows:
            branches[b.parent].label.pieces.append((f"  · {b.link}", Style.QUIET))
            continue
        if depths[b.parent] == DEEPEST:
            branches[b.parent] = root.add(Line((link_of(model, b.parent), Style.STRONG), (" carries on:", Style.QUIET)))
            depths[b.parent] = 0
        joint = (b.joint.name, Style.POINTED), (f" ({b.joint.kind}) → ", Style.QUIET)
        branches[i] = branches[b.parent].add(Line(*joint, *_frames(link_of(model, i), fixed[i])))
        depths[i] = depths[b.parent] + 1
    return root


def _frames(link: str, frames: list[str]) -> list[Piece]:
    """Text of a link and the other frames of its body."""
    others = [name for name in frames if name != link]
    return [(link, Style.STRONG), (f"  + {', '.join(others)}" if others else "", Style.QUIET)]
