"""Report of an identification, in blocks: what it predicts, bodies and joints against the file, and groups of parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...control.residual_threshold import threshold_table
from ...core.answers.blocks import Block, Column, Headline, Level, Line, More, Table, numbers, words
from ...core.colours import Style
from ...core.numbers import MISSING, estimate, number, percent, plus_minus
from ...core.text import listed
from ...core.verdict import Word
from ...mechanics.joints.units import heading_unit
from ...motion.coordinates import Coordinates
from ..body_changes import BodyChanges
from ..parameters import first_parameters

if TYPE_CHECKING:
    from ...control.residual_threshold import ResidualThreshold
    from ..payload import IdentifiedPayload
    from ..result import IdentifiedRobot

_HELD_OUT_TEXTS = {"test": "in the test logs", "five-fold": "in 5-fold cross-validation over time"}
"""Text by kind of held-out rows."""
_MAX_NAMES, _MAX_DOUBTS, _MAX_ROWS = 5, 4, 12
"""Largest numbers of names in a sentence, and of doubts and table rows in the short form."""
_MAX_LINES = 45
"""Number of lines of the short form."""
_OTHER_LINES = 17
"""Lines of the short form that are neither doubts nor rows of tables."""
_MIN_ROWS = 4
"""Rows of a table that the short form has in any case."""
_LINE_WIDTH = 74
"""Characters of a printed line."""
_LAW_TITLES = {"coulomb": "Coulomb", "viscous": "viscous", "stribeck": "static excess"}
"""Titles of the columns of friction."""


def identification_view(found: IdentifiedRobot) -> Iterator[Block]:
    """Verdict, doubts, bodies and joints; settings, groups and what no log determines in the full form."""
    must_look = found.verdict.word is Word.LOOK_AGAIN
    bodies_level = Level.SHORT
    if must_look or found.payload is not None:  # bodies are not trustworthy, or not of interest
        bodies_level = Level.ALL
    changes = found.body_changes if found.base.unknown.bodies else None
    further: list[Line] = []
    if changes is not None and changes.tool is not None and not must_look:
        further = [Line(tool_sentence(changes))]
    yield Headline(found.verdict.word, _headline(found), further=further)
    remarks = _remarks(found)
    yield from remarks
    if len(remarks) > _MAX_DOUBTS:
        yield More(f"{len(remarks) - _MAX_DOUBTS} more doubts and notes")
    if found.payload is not None:
        yield from _payload_lines(found.payload)
    max_rows = _rows_that_fit(remarks[:_MAX_DOUBTS])
    if changes is not None:
        yield _body_table(changes, bodies_level, max_rows)
    yield _joint_table(found, max_rows)
    if changes is not None and bodies_level is Level.SHORT:
        yield Line((f"● is certain (two standard deviations). {_open_groups(found)}".strip(), Style.QUIET))
    if "gain-of-all" in found.undetermined:
        yield Line(
            "→ Weigh a payload, or hold one known mass: if all torques are wrong by one factor, this log cannot show it."
        )
    if found.thresholds is not None:
        yield from _thresholds(found.thresholds)
    yield More(f"{found.free_count} groups of parameters, their intervals, settings of the fit")
    yield from _details(found)


def _remarks(found: IdentifiedRobot) -> list[Line]:
    """Doubts and notes; the short form has the first four."""
    lines: list[Line] = []
    for doubt in found.doubts:
        style = Style.OVER if doubt.refuses else ""
        lines.append(Line((f"• {doubt.sentence}", style)))
    lines += [Line(note) for note in found.notes]
    for line in lines[_MAX_DOUBTS:]:
        line.level = Level.ALL
    return lines


def _payload_lines(payload: IdentifiedPayload) -> Iterator[str]:
    """Mass and centre of mass of a payload, and what the torques do not determine of it."""
    com = ", ".join(map(plus_minus, payload.com, payload.com_deviations))
    mass = plus_minus(payload.mass, payload.mass_deviation)
    yield f"payload at {payload.frame}: {mass} kg, centre of mass ({com}) m in its frame"
    if payload.unidentifiable:
        yield f"not determined by the torques, taken from the file: {', '.join(payload.unidentifiable)}"


def _headline(found: IdentifiedRobot) -> str:
    """Share of the torques that the robot predicts, and the worst joint."""
    share, where = percent(found.held_out.all, 3), _HELD_OUT_TEXTS[found.held_out.kind]
    joint = ""
    if found.worst is not None and len(found.held_out.joints) > 1:
        name, worst_share = found.worst
        joint = f" (worst joint {name}, {percent(worst_share, 3)})"
    if found.verdict.ok:
        return f"predicts torques to {share}{joint}, {where}."
    return f"{share} of the torques unexplained{joint}, {where}."


_MOTIONS = {
    "coulomb": "slowly in both directions",
    "stribeck": "slowly in both directions",
    "viscous": "fast and steadily",
    "motor_inertia": "with large accelerations",
    "offset": "in both directions",
}
"""Motion of a joint that determines a parameter of its drive; far and fast motions determine bodies."""


def _open_groups(found: IdentifiedRobot) -> str:
    """Sentence on groups that leave torques of another motion open, with a motion that determines the largest of them.

    Empty without such groups.
    """
    groups = found.open_for_torques
    if not groups:
        return ""
    name, (joint, share) = next(iter(groups.items()))
    (parameter,) = first_parameters([name])
    _, _, kind = parameter.rpartition(".")
    motion = _MOTIONS.get(kind, "far and fast")
    count = "1 group leaves" if len(groups) == 1 else f"{len(groups)} groups leave"
    largest = f"most {parameter} ({percent(share, 2)} at {joint})"
    return f"{count} more than 2 % of another motion's torques open, {largest}: move {joint} {motion}."


def tool_sentence(changes: BodyChanges) -> str:
    """Question about the body that alone explains the log."""
    tool = changes.tool
    assert tool is not None
    comparison, question = "less", "does the robot lack a tool?"
    if tool.mass > 0:
        comparison, question = "more", "is a tool mounted?"
    return f"{tool.link} weighs {number(abs(tool.mass), 2)} kg {comparison} than in the file: {question}"


def _rows_that_fit(lines: Sequence[Line]) -> int:
    """Number of rows of each of two tables for which the short form has room, besides these lines."""
    printed_lines = 0
    for line in lines:
        length = sum(map(len, _texts(line)))
        printed_lines += -(-length // _LINE_WIDTH)  # rounded up
    rows = (_MAX_LINES - _OTHER_LINES - printed_lines) // 2
    return max(_MIN_ROWS, min(_MAX_ROWS, rows))


def _texts(line: Line) -> list[str]:
    return [piece if isinstance(piece, str) else piece[0] for piece in line.pieces]


def _thresholds(found: ResidualThreshold) -> Iterator[Block]:
    """Thresholds of a residual, and reasons to doubt them."""
    yield Line(found.sentence)
    for doubt in found.doubts:
        yield Line(f"• {doubt.sentence}")
    yield threshold_table(found)


def _body_table(changes: BodyChanges, level: Level, max_rows: int) -> Table:
    """Masses in the file and identified, and moves of the centres of mass; sure changes have a mark."""
    file_masses = [*changes.before.tolist(), float(changes.before.sum())]
    masses = [*changes.masses.tolist(), float(changes.masses.sum())]
    is_heavier = [*changes.is_heavier.tolist(), changes.is_sum_heavier]
    mass_cells = [_change(mass, _kilograms(mass), is_sure=sure) for mass, sure in zip(masses, is_heavier, strict=True)]
    distances_mm = 1e3 * changes.moved
    moved_cells = [_change(x, is_sure=bool(sure)) for x, sure in zip(distances_mm, changes.is_moved, strict=True)]
    mass_changes = np.abs(changes.masses - changes.before).tolist()
    return Table(
        "",
        words("link", [*changes.links, "all"]),
        numbers("file", file_masses, _kilograms, "kg"),
        numbers("measured", mass_cells, unit="kg"),
        numbers("centre moved", [*moved_cells, MISSING], unit="mm"),
        level=level,
        most=max_rows,
        by=[*mass_changes, math.inf],  # the row of all links always stays
        of_limits=False,
    )


def _kilograms(value: float) -> str:
    return number(value, decimals=3)


def _change(value: float, text: str = "", *, is_sure: bool) -> Any:
    """Cell of a table: a sure value has a mark, another one is quiet; ``text`` replaces one decimal."""
    if not math.isfinite(value):
        return MISSING
    text = text or number(value, decimals=1)
    if is_sure:
        return Line(f"● {text}", value=value)
    return Line((text, Style.QUIET), value=value)


def _joint_table(found: IdentifiedRobot, max_rows: int) -> Table:
    """Friction of each joint, and the unexplained share of its torque."""
    shares, names = found.held_out.joints, list(found.held_out.joints)
    turning = Coordinates.from_model(found.original.model).angular_velocity
    columns: list[Column] = []
    if found.payload is None:
        for law, title in _LAW_TITLES.items():
            friction = found.consistent.of_joints(law)
            if friction:
                quantity = "tau/dq" if law == "viscous" else "tau"
                values = [friction.get(name, MISSING) for name in names]
                columns.append(numbers(title, values, unit=_unit(quantity, turning)))
    if found.offsets:
        offsets = [found.offsets.get(name) or MISSING for name in names]  # 0 stands for an interval around 0
        columns.append(numbers("offset", offsets, unit=_unit("tau", turning)))
    return Table(
        "",
        words("joint", names),
        *columns,
        numbers("unexplained", shares.values(), lambda share: percent(share, 3)),
        most=max_rows,
        by=np.nan_to_num(list(shares.values()), posinf=math.inf).tolist(),
        of_limits=False,
    )


def _unit(quantity: str, turning: Any) -> str:
    """Unit of a torque, or of a torque by a speed."""
    if quantity == "tau":
        return heading_unit("tau", turning)
    units = []
    if turning.any():
        units.append("N m s/rad")
    if not turning.all():
        units.append("N s/m")
    return ", ".join(units)


def _details(found: IdentifiedRobot) -> Iterator[Block]:
    """Settings, residuals, groups with their intervals, bodies, and quantities that no log determines."""
    for block in _full_form(found):
        if isinstance(block, str):
            yield Line(block, level=Level.ALL)
        else:
            yield block


def _full_form(found: IdentifiedRobot) -> Iterator[str | Table]:
    """Lines and tables that stand in the full form alone."""
    yield f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    torque_unit = heading_unit("tau", Coordinates.from_model(found.original.model).angular_velocity)
    yield Table(
        "Unexplained share of the torques, in rows held out",
        words("joint", found.held_out.joints),
        numbers("held out", found.held_out.joints.values(), lambda share: percent(share, 3)),
        numbers("size", found.sigma, unit=torque_unit),
        level=Level.ALL,
    )
    yield _groups_table(found)
    if any(".mc" in name for name in first_parameters(found.groups)):
        yield "mcx, mcy, mcz: mass times the coordinates of the centre of mass. A sum has the unit of its first term."
    if found.base.held.any():
        yield f"{int(found.base.held.sum())} parameters were held at known values"
    poor_groups = first_parameters(found.poorly_determined)
    if poor_groups:
        names = listed(poor_groups, _MAX_NAMES, "; ")
        yield f"Poorly determined, standard deviation above 30 %: {len(poor_groups)} of {found.free_count} groups, {names}"
    yield _essential_text(found)
    yield from bodies_view(found)
    if found.undetermined:
        yield "Not determined by this log:"
        for sentence in found.undetermined.values():
            yield f"• {sentence}"


def _groups_table(found: IdentifiedRobot) -> Table:
    """Row for each group that is not held at a known value."""
    free = np.flatnonzero(~found.base.held)
    values, deviations = found.values[free], found.standard_deviations[free]
    value_cells: list[Line] = []
    deviation_cells: list[Line] = []
    for value, deviation in zip(values, deviations, strict=True):
        value_text, deviation_text = estimate(value, deviation)
        value_cells.append(Line(value_text, value=value))
        deviation_cells.append(Line(deviation_text, value=deviation))
    low, high = found.interval()[free].T
    units = [found.units[k].replace("^2", "²") for k in free]
    column = partial(numbers, unit=", ".join(dict.fromkeys(units)), headed=False)
    return Table(
        f"{len(free)} groups of parameters",
        words("group", [found.groups[k] for k in free]),
        words("unit", units, fold=False),
        column("value", value_cells),
        column("deviation", deviation_cells),
        column("95 % from", low),
        column("to", high),
        column("file", found.prior.mean[free]),
        level=Level.ALL,
    )


def _essential_text(found: IdentifiedRobot) -> str:
    """Sentence on the essential groups, their prediction error and their values."""
    essential = found.essential
    values: list[str] = []
    for name, value in zip(first_parameters(essential.names), essential.values, strict=True):
        values.append(f"{name} {number(value)}")
    _, share_of_all_groups = essential.curve[0]
    return (
        f"{len(essential.names)} essential groups of {found.free_count} predict rows held out to "
        f"{percent(essential.held_out, 3)}, all to {percent(share_of_all_groups, 3)} (in units of each joint's residuals): "
        f"{'; '.join(values)}"
    )


def bodies_view(found: IdentifiedRobot) -> Iterator[str | Table]:
    """Physically consistent bodies compared with the file's, and their prediction error."""
    consistent, unknown = found.consistent, found.base.unknown
    yield (
        f"Weight of the prior γ = {number(consistent.fit.strength)}: {percent(consistent.held_out, 3)} unexplained in 5-fold "
        f"cross-validation, weighted; by the file's own bodies with friction {percent(consistent.of_file, 3)}."
    )
    links: list[str] = []
    masses: list[float] = []
    file_masses: list[float] = []
    centres: list[str] = []
    for i in unknown.bodies:
        body, G = unknown.model.bodies[i], consistent.inertias[i]
        links.append(body.link)
        masses.append(float(G.mass))
        file_masses.append(float(body.inertia.mass))
        centres.append(", ".join(map(number, G.com)))
    yield Table(
        "Physically consistent bodies",
        words("link", links),
        numbers("mass", masses, unit="kg"),
        numbers("in the file", file_masses, unit="kg"),
        words("centre of mass [m]", centres),
        level=Level.ALL,
    )
