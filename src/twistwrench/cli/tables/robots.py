"""Tables of robots: ``info``, ``robots``, ``doctor``, ``verify`` and ``log info``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text
from rich.tree import Tree

from ... import robots
from ...core.numbers import number, percent, residual
from ...diagnosis import DoctorReport, Finding, Severity
from ...errors import UnknownNameError
from ...joints.units import heading_unit
from ...model.model import BASE, Body, Model
from ...model.notes import grouped
from ...motion.coordinates import Coordinates
from ...reports.log_quality import LogColumn, LogQuality
from ...reports.robot_summary import link_of
from ...robots.finding import FoundRobot, known_robots, plain_name
from ...verify import VerifyReport
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


# ── ``robots``: bundled robots, and those of other packages

_BUNDLED = "twistwrench"


def robot_tables(word: str = "") -> Iterator[PlainTable]:
    """The bundled robots that have ``word`` in their name or description, and the others that have it in their name."""
    described = {name: (getattr(robots, name).__doc__ or "").strip().split("\n")[0] for name in robots.names()}
    chosen = [name for name, text in described.items() if word.lower() in f"{name} {text}".lower()]
    known = known_robots()
    others: dict[str, list[FoundRobot]] = {}
    for name, robot in sorted(known.items()):
        if robot.source != _BUNDLED and plain_name(word) in name:
            others.setdefault(robot.source, []).append(robot)
    if not chosen and not others:
        raise UnknownNameError.of("robot", word, known)
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
    """One row a file, whatever it is called."""
    table = PlainTable()
    table.words(f"of {source}", fold=False, style="bold")
    table.words("file")
    by_file: dict[str, list[str]] = {}
    for robot in found:
        by_file.setdefault("/".join(robot.path.parts[-3:]), []).append(robot.name)
    for file, called in by_file.items():
        table.row(", ".join(called), file)
    return table


# ── ``doctor``

_COLOURS = {Severity.ERROR: "bold red", Severity.WARNING: "yellow", Severity.NOTE: "dim"}
_LISTED = 6
"""Notes of one check that are listed; more are counted."""


def doctor_view(report: DoctorReport, *, every: bool = False) -> RenderableType:
    """A heading and a paragraph for each finding; all notes if ``every``."""
    heading = Text.assemble((report.robot, "bold"), f"  {report.summary}")
    if not report.findings:
        return heading
    shown = list(_shown(report, every=every))
    left = len(report.findings) - len(shown)
    parts: list[RenderableType] = [heading]
    if str(report.effect) != "none":
        parts.append(Text(f"all repairs together change: {report.effect}"))
    parts.append(Text())
    parts += [part for finding in shown for part in _paragraph(finding)]
    if left:
        parts.append(Text(f"{left} more notes; --json lists all.", "dim"))
    return Group(*parts)


def _shown(report: DoctorReport, *, every: bool) -> Iterator[Finding]:
    notes: dict[str, int] = {}
    for finding in report.findings:
        if finding.severity is Severity.NOTE:
            notes[finding.check] = notes.get(finding.check, 0) + 1
            if notes[finding.check] > _LISTED and not every:
                continue
        yield finding


def _paragraph(finding: Finding) -> Iterator[RenderableType]:
    """Severity, check and place, and below them the sentence, the repair and its effect."""
    line = f"{finding.file + ', ' if finding.file else ''}line {finding.line}" if finding.line else ""
    head = ", ".join(x for x in (finding.check, finding.where, line) if x)
    yield Text.assemble((str(finding.severity), _COLOURS[finding.severity]), f"  {head}")
    yield Padding(Text(finding.sentence), (0, 0, 0, 2))
    if finding.repair is not None:
        yield Padding(Text(f"repair: {finding.repair.sentence}"), (0, 0, 0, 2))
    if str(finding.effect) != "none":
        yield Padding(Text(f"effect of the repair: {finding.effect}"), (0, 0, 0, 2))


# ── ``verify``


def verification_view(report: VerifyReport) -> RenderableType:
    """The verdict, and a row per check: what it compares, the residual, and what is allowed."""
    made = [check for check in report.checks if not check.skipped]
    failed = [check.name for check in made if not check.passed]
    verdict = f"DISAGREES: {', '.join(failed)}." if failed else f"OK: {len(made)} checks agree."
    return Group(Text(verdict, "bold red" if failed else "bold"), Text(), _table(report))


def _table(report: VerifyReport) -> PlainTable:
    table = PlainTable(f"{report.robot}: {report.states} random states, seed {report.seed}")
    table.words("check", "compares")
    table.numbers("residual", "allowed")
    table.words("")
    for check in report.checks:
        if check.skipped:
            reason = Text.assemble(f"{check.compares}\n", (f"skipped: {check.skipped}", "dim"))
            table.row(check.name, reason, "", "", Text("skipped", "dim"))
        else:
            verdict = Text("agrees", "green") if check.passed else Text("DISAGREES", "bold red")
            table.row(check.name, check.compares, residual(check.residual), residual(check.tolerance), verdict)
    return table


# ── ``log info``

_MANY_ZEROS, _FEW_STEPS = 0.1, 50
"""Share of the rows that are exactly zero, and steps of the grid from end to end, that are worth a word."""


def log_view(quality: LogQuality) -> RenderableType:
    """A line on the clock, and a table of the columns."""
    table = PlainTable()
    table.words("column")
    table.numbers("least", "most", "grid", "noise")
    table.words("", style="yellow")
    for column in quality.columns:
        table.row(column.name, column.least, column.most, column.grid or None, column.noise or None, _said(column))
    notes = [Text(f"note: {note}") for note in quality.notes]
    return Group(Text.assemble((quality.path.name, "bold"), f"  {_clock(quality)}"), table, *notes)


def _clock(quality: LogQuality) -> str:
    if not quality.time:
        return f"{quality.rows} rows, no column of time"
    said = [f"{quality.rows} rows in {number(quality.seconds)} s, {number(quality.rate)} Hz by the usual step"]
    if math.isfinite(quality.jitter) and quality.jitter * quality.rate > 1e-3:
        said.append(f"steps vary by {percent(quality.jitter * quality.rate, 2)}")
    for count, what in (
        (quality.gaps, f"gaps, the longest {number(quality.longest)} s"),
        (quality.repeated, "stamps repeated"),
        (quality.backward, "stamps run back"),
    ):
        if count:
            said.append(f"{count} {what}")
    return "; ".join(said)


def _said(column: LogColumn) -> str:
    if column.dead:
        return "one number throughout"
    said = [f"cut off: {percent(column.cut, 2)} of the rows at an extreme"] if column.cut else []
    if column.zeros > _MANY_ZEROS:
        said.append(f"exactly 0 in {percent(column.zeros, 2)} of the rows")
    if column.grid and column.most - column.least < _FEW_STEPS * column.grid:
        said.append(f"no more than {round((column.most - column.least) / column.grid)} steps of its grid in all")
    return "; ".join(said)
