"""What a robot is: joints and limits, bodies and inertias, masses, frames, and the tree they hang in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.text import Text
from rich.tree import Tree

from ...core.printed_numbers import number
from ...joints.units import heading_unit
from ...model.model import BASE, Body, Model
from ...model.remark import grouped
from ...motion.coordinates import Coordinates
from ...report.robot_summary import link_of
from .plain_table import PlainTable, remarks

if TYPE_CHECKING:
    from ...robot import Robot

DEEPEST = 12
"""Joints one inside the other before the tree goes on at the left."""


def info_view(robot: Robot, *, degrees: bool = False) -> RenderableType:
    """Everything there is to say about the robot's make-up; angles in degrees if ``degrees``."""
    model = robot.model
    actuators = [_actuators(model)] if model.actuators else []
    parts: list[RenderableType] = [
        _heading(model), _joints(model, degrees=degrees), *actuators, _inertias(model), _tree(model)
    ]  # fmt: skip
    return Group(*parts, *remarks(grouped(model.defects)))


def _heading(model: Model) -> Text:
    moving, fixed = sum(b.inertia.mass for b in model.bodies), model.base_inertia.mass
    gravity = " ".join(map(number, model.gravity))
    rotors = sum(not b.joint.moves_body for b in model.bodies)
    bodies = f"{len(model.bodies) - rotors} moving bodies" + (f" and {rotors} rotors" if rotors else "")
    counts = f"{bodies}, {model.nq} coordinates, {model.nv} velocities, {len(model.all_frames)} frames"
    named = f"\nconfigurations {', '.join(model.configurations)}" if model.configurations else ""
    return Text.assemble(
        (model.name, "bold"),
        f"  {counts}\nmass {number(moving)} kg moving, {number(fixed)} kg fixed  ·  gravity [{gravity}] m/s²  ·  tip ",
        _tip(model),
        named,
    )


def _tip(model: Model) -> str:
    """The tip, and what else could be one: the leaves on the same body."""
    if model.tip is None:
        return f"none; leaves: {', '.join(model.leaves) or 'none'}"
    body = model.all_frames[model.tip].body
    others = [name for name in model.leaves if name != model.tip and model.frames[name].body == body]
    return f"{model.tip} (beside it: {', '.join(others)})" if others else model.tip


def _joints(model: Model, *, degrees: bool) -> PlainTable:
    units = (heading_unit(part, (True, False), degrees=degrees) for part in ("q", "dq", "tau"))
    table = PlainTable("Joints: positions in {}, velocities in {}, efforts in {}".format(*units))
    table.words("joint", "kind", "carries")
    extra, drives = model.friction.any, bool(model.armature.any())
    table.numbers("lower", "upper", "velocity", "effort")
    table.numbers(*(("damping", "friction") if extra else ()), *(("armature",) if drives else ()))
    c, limits = Coordinates.of(model), model.limits
    for i, b in enumerate(model.bodies):
        for k in range(b.v_index, b.v_index + b.joint.nv):
            factor = math.degrees(1.0) if degrees and c.angular_velocity[k] else 1.0
            if b.follows and not b.joint.moves_body:  # in the table of actuators
                continue
            if b.follows:
                kind = f"{b.joint.kind},\n{_rule(b, c.velocity_names[k], factor, degrees=degrees)}"
                table.row(b.joint.name, kind, link_of(model, i))
                continue
            first = k == b.v_index
            cells = [factor * limits.lower[k], factor * limits.upper[k], factor * limits.velocity[k], limits.effort[k]]
            cells += [model.friction.viscous[k], model.friction.coulomb[k]] if extra else []
            cells += [model.armature[k]] if drives else []
            words = (c.velocity_names[k], b.joint.kind if first else "", link_of(model, i) if first else "")
            table.row(*words, *cells)
    return table


def _actuators(model: Model) -> PlainTable:
    """Gears, rotors and motors; what is not known stays empty."""
    table = PlainTable("Actuators (SI units)")
    table.words("joint")
    table.numbers("ratio", "η", "rotor", "stiffness", "k_t", "R", "V", "A", "A peak", "speed")
    for a in model.actuators.values():
        m = a.motor
        known = [m.torque_constant, m.resistance, m.voltage, m.current_continuous, m.current_peak, m.speed] if m else []
        cells = [a.ratio, a.efficiency, a.rotor.inertia if a.rotor else math.inf, a.stiffness, *known]
        table.row(a.joint, *cells)
    return table


def _rule(follower: Body, leader: str, leader_factor: float, *, degrees: bool) -> str:
    """What a mimic joint does, in the table's units: it has no limits, damping and friction, but its leader has."""
    factor = math.degrees(1.0) if degrees and follower.joint.axes[0, :3].any() else 1.0
    ratio = follower.ratio * (factor / leader_factor)
    share = "" if ratio == 1.0 else f"{number(ratio)} × "
    offset = f" {'+' if follower.offset > 0 else ''}{number(factor * follower.offset)}" if follower.offset else ""
    return f"follows {share}{leader}{offset}"


def _inertias(model: Model) -> PlainTable:
    table = PlainTable("Links with mass, each in its own frame (kg, m, kg m²)")
    table.words("link", "moves with")
    table.numbers("mass")
    table.numbers("centre of mass", "principal moments", min_width=10)  # three numbers each
    for link, inertia in model.link_inertias.items():
        if not inertia.parameters.any():
            continue
        body = model.frames[link].body if link in model.frames else BASE
        com, moments = (" ".join(map(number, x)) for x in (inertia.com, inertia.principal()[0]))
        table.row(link, link_of(model, body), inertia.mass, com, moments)
    return table


def _tree(model: Model) -> Tree:
    """Moving bodies below what carries them; the other frames fixed to each stand beside it.

    What hangs deeper than a terminal is wide goes on at the left.
    """
    fixed = {i: [name for name, f in model.all_frames.items() if f.body == i] for i in range(BASE, len(model.bodies))}
    root = Tree(_branch("base", fixed[BASE]))
    branches, depths = {BASE: root}, {BASE: 0}
    for i, b in enumerate(model.bodies):
        if not b.joint.moves_body and b.follows:
            branches[b.parent].label.append(f"  · {b.link}", "dim")  # type: ignore[union-attr]
            continue
        label = Text.assemble(
            (b.joint.name, "cyan"), (f" ({b.joint.kind}) → ", "dim"), _branch(link_of(model, i), fixed[i])
        )
        if depths[b.parent] == DEEPEST:
            branches[b.parent] = root.add(Text.assemble((link_of(model, b.parent), "bold"), (" carries on:", "dim")))
            depths[b.parent] = 0
        branches[i], depths[i] = branches[b.parent].add(label), depths[b.parent] + 1
    return root


def _branch(link: str, frames: list[str]) -> Text:
    others = [name for name in frames if name != link]
    return Text.assemble((link, "bold"), (f"  + {', '.join(others)}" if others else "", "dim"))
