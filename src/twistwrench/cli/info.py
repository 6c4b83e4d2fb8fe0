"""The commands ``twistwrench info`` and ``robots``: contents of a robot, robots that have a name."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping

import click
from rich.console import Group, RenderableType
from rich.text import Text
from rich.tree import Tree

from .. import robots
from ..core.files import check_outputs, replacing
from ..core.numbers import number
from ..errors import ModelWarning, UnknownNameError, ValueRangeError
from ..joints.units import heading_unit
from ..model.description import grouped
from ..model.model import BASE, Body, Model
from ..motion.coordinates import Coordinates
from ..reports.robot_summary import as_text, link_of
from ..robot import Robot
from ..robots.finding import FoundRobot, known_robots, plain_name
from .console import show
from .plain_table import PlainTable, remarks
from .robot_options import RobotOptions, robot_command
from .usage import Given, command


@robot_command(
    "info",
    click.option(
        "--csv",
        "csv_path",
        metavar="OUT.csv",
        help="Write the joints as CSV, in SI units and radians, as --limits reads it; '-' prints it.",
    ),
    click.option("--json", "as_json", is_flag=True, help="Print everything as JSON, in SI units and radians."),
    examples=("info panda", "info ur5 --json"),
)
def info_command(options: RobotOptions, given: Given) -> None:
    """Parts of the robot: joints, limits, inertias, masses, frames, and its tree."""
    if given.as_json and given.csv_path is not None:
        raise ValueRangeError("--json prints the robot, and --csv writes its joints. Choose one.")
    if options.degrees and (given.as_json or given.csv_path is not None):
        raise ValueRangeError("--json and --csv are in SI units and radians. Leave --degrees out.")
    if given.csv_path is not None and given.csv_path != "-":
        check_outputs({"--csv": given.csv_path}, options.files)

    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always", ModelWarning)
        robot = options.load()
    for note in notes:  # those of the model itself stand below its tree
        if not any(defect in str(note.message) for defect in robot.defects):
            warnings.warn_explicit(note.message, note.category, note.filename, note.lineno)
    if given.as_json or given.csv_path is not None:
        text = as_text(robot, "json" if given.as_json else "csv")
        if given.as_json or given.csv_path == "-":
            click.echo(text, nl=False)
        elif given.csv_path is not None:
            with replacing(given.csv_path) as scratch:
                scratch.write_text(text, encoding="utf-8", newline="")
            click.echo(f"wrote {given.csv_path}")
        return
    show(info_view(robot, degrees=options.degrees))


# ── The report


DEEPEST = 12
"""Depth at which the tree continues at the left margin."""


def info_view(robot: Robot, *, degrees: bool = False) -> RenderableType:
    """Heading, joints, actuators, inertias and tree of a robot; angles in degrees if ``degrees``."""
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
    """Tip, and the other leaves of the same body."""
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
    c, limits = Coordinates.from_model(model), model.limits
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
    """Gears, rotors and motors; unknown values are left blank."""
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
    """Coupling of a mimic joint, in the table's units."""
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
    """Tree of moving bodies; fixed frames stand beside their body.

    Deeper levels continue at the left margin.
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


# ── ``robots``: bundled robots, and those of other packages


@command("robots", click.argument("word", default=""), examples_=("robots", "robots panda"))
def robots_command(given: Given) -> None:
    """The robots that have a name: bundled, or of packages that are installed; with WORD, those that have it in theirs."""
    show(*list(robot_tables(given.word)))


_BUNDLED = "twistwrench"


def robot_tables(word: str = "") -> Iterator[PlainTable]:
    """Tables of the bundled robots with ``word`` in name or description, and of others with it in their name."""
    described = {name: (getattr(robots, name).__doc__ or "").strip().split("\n")[0] for name in robots.names()}
    chosen = [name for name, text in described.items() if word.lower() in f"{name} {text}".lower()]
    known = known_robots()
    others: dict[str, list[FoundRobot]] = {}
    for name, robot in sorted(known.items()):
        if robot.source != _BUNDLED and plain_name(word) in name:
            others.setdefault(robot.source, []).append(robot)
    if not chosen and not others:
        raise UnknownNameError.from_choices("robot", word, known)
    if chosen:
        yield _bundled(chosen, described)
    for source, found in others.items():
        yield _others(source, found)


def _bundled(chosen: list[str], described: Mapping[str, str]) -> PlainTable:
    table = PlainTable()
    table.words("robot", fold=False, style="bold")
    table.numbers("q", "dq", "kg")
    table.words("what it is")
    for name in chosen:
        robot = getattr(robots, name)()
        mass = sum(body.inertia.mass for body in robot.model.bodies)
        table.row(name, robot.nq, robot.nv, mass, described[name].partition("; options as")[0].replace("``", ""))
    return table


def _others(source: str, found: list[FoundRobot]) -> PlainTable:
    """Table with one row per file."""
    table = PlainTable()
    table.words(f"of {source}", fold=False, style="bold")
    table.words("file")
    by_file: dict[str, list[str]] = {}
    for robot in found:
        by_file.setdefault("/".join(robot.path.parts[-3:]), []).append(robot.name)
    for file, called in by_file.items():
        table.row(", ".join(called), file)
    return table
