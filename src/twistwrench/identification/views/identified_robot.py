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
from ...core.typing import Array
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
_MAX_NAMES = 5
"""Largest number of names in a sentence."""
_MAX_REMARKS = 4
"""Largest number of doubts and notes in the short form."""
_MAX_ROWS = 12
"""Largest number of rows of a table in the short form."""
_MAX_LINES = 45
"""Number of lines of the short form."""
_OTHER_LINES = 17
"""Lines of the short form that are neither remarks nor rows of tables, such as headings."""
_MIN_ROWS = 4
"""Rows of a table that the short form has in any case."""
_TABLES = 2
"""Number of tables of the short form: bodies and joints."""
_LINE_WIDTH = 74
"""Characters of a printed line."""
_LAW_TITLES = {"coulomb": "Coulomb", "viscous": "viscous", "stribeck": "static excess"}
"""Titles of the columns of friction."""


def identification_view(found: IdentifiedRobot) -> Iterator[Block]:
    """Verdict, doubts, bodies and joints; in the full form also settings, groups and quantities that no log determines."""
    contradicts_itself = found.verdict.word is Word.LOOK_AGAIN
    bodies_level = Level.SHORT
    if contradicts_itself or found.payload is not None:  # bodies are not trustworthy, or not of interest
        bodies_level = Level.ALL
    bodies_are_unknown = bool(found.base.unknown.bodies)
    changes = found.body_changes if bodies_are_unknown else None
    tool_lines: list[Line] = []
    if changes is not None and changes.tool is not None and not contradicts_itself:
        tool_lines = [Line(tool_sentence(changes))]
    yield Headline(found.verdict.word, _headline(found), further=tool_lines)
    remarks = _remarks(found)
    yield from remarks
    if len(remarks) > _MAX_REMARKS:
        hidden_count = len(remarks) - _MAX_REMARKS
        yield More(f"{hidden_count} more doubts and notes")
    if found.payload is not None:
        yield from _payload_lines(found.payload)
    max_rows = _rows_that_fit(remarks[:_MAX_REMARKS])
    if changes is not None:
        yield _body_table(changes, bodies_level, max_rows)
    yield _joint_table(found, max_rows)
    if changes is not None and bodies_level is Level.SHORT:
        sentences = f"● is certain (two standard deviations). {_open_groups(found)}"
        yield Line((sentences.strip(), Style.QUIET))  # there may be no open groups
    if "gain-of-all" in found.undetermined:
        yield Line(
            "→ Weigh a payload, or hold one known mass: if all torques are wrong by one factor, this log cannot show it."
        )
    if found.thresholds is not None:
        yield from _thresholds(found.thresholds)
    yield More(f"{found.free_count} groups of parameters, their intervals, settings of the fit")
    yield from _details(found)


def _remarks(found: IdentifiedRobot) -> list[Line]:
    """Doubts and notes; the short form has the first ``_MAX_REMARKS``."""
    lines: list[Line] = []
    for doubt in found.doubts:
        style = Style.OVER if doubt.refuses else ""
        lines.append(Line((f"• {doubt.sentence}", style)))
    lines += [Line(note) for note in found.notes]
    for line in lines[_MAX_REMARKS:]:
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
    """Unexplained share of the torques, and the worst of several joints."""
    share_text = percent(found.held_out.all, 3)
    rows_text = _HELD_OUT_TEXTS[found.held_out.kind]
    worst_text = ""
    if found.worst is not None and len(found.held_out.joints) > 1:
        name, worst_share = found.worst
        worst_text = f" (worst joint {name}, {percent(worst_share, 3)})"
    if found.verdict.ok:
        return f"predicts torques to {share_text}{worst_text}, {rows_text}."
    return f"{share_text} of the torques unexplained{worst_text}, {rows_text}."


_MOTIONS = {
    "coulomb": "slowly in both directions",
    "stribeck": "slowly in both directions",
    "viscous": "fast and steadily",
    "motor_inertia": "with large accelerations",
    "offset": "in both directions",
}
"""Motion of a joint that determines a parameter of its drive; far and fast motions determine bodies."""


def _open_groups(found: IdentifiedRobot) -> str:
    """Sentence on groups that are too uncertain to predict another motion's torques, and a motion that determines the worst.

    Empty without such groups.
    """
    groups = found.open_for_torques  # those that change another motion's torques by over 2 %
    if not groups:
        return ""
    worst_group, (joint, share) = next(iter(groups.items()))  # the groups are sorted, worst first
    (parameter,) = first_parameters([worst_group])  # the first parameter of the sum names the group
    _, _, kind = parameter.rpartition(".")
    motion = _MOTIONS.get(kind, "far and fast")
    groups_text = "1 group leaves" if len(groups) == 1 else f"{len(groups)} groups leave"
    worst_text = f"most {parameter} ({percent(share, 2)} at {joint})"
    return f"{groups_text} more than 2 % of another motion's torques open, {worst_text}: move {joint} {motion}."


def tool_sentence(changes: BodyChanges) -> str:
    """Question about the body that alone explains the log."""
    tool = changes.tool
    assert tool is not None
    if tool.mass > 0:
        comparison = "more"
        question = "is a tool mounted?"
    else:
        comparison = "less"
        question = "does the robot lack a tool?"
    return f"{tool.link} weighs {number(abs(tool.mass), 2)} kg {comparison} than in the file: {question}"


def _rows_that_fit(lines: Sequence[Line]) -> int:
    """Number of rows for which the short form has room beside ``lines``, in each of its tables."""
    printed_lines = 0
    for line in lines:
        length = sum(map(len, _piece_texts(line)))
        printed_lines += -(-length // _LINE_WIDTH)  # rounded up
    rows_per_table = (_MAX_LINES - _OTHER_LINES - printed_lines) // _TABLES
    return max(_MIN_ROWS, min(_MAX_ROWS, rows_per_table))


def _piece_texts(line: Line) -> list[str]:
    """Texts of a line without their styles; a piece is a text, or a text and its style."""
    return [piece if isinstance(piece, str) else piece[0] for piece in line.pieces]


def _thresholds(found: ResidualThreshold) -> Iterator[Block]:
    """Thresholds of a residual, and reasons to doubt them."""
    yield Line(found.sentence)
    for doubt in found.doubts:
        yield Line(f"• {doubt.sentence}")
    yield threshold_table(found)


def _body_table(changes: BodyChanges, level: Level, max_rows: int) -> Table:
    """Masses in the file and identified, and moves of the centres of mass; sure changes have a mark. Last row: all links."""
    # the last entry of each list is that of all links together
    file_masses = [*changes.before.tolist(), float(changes.before.sum())]
    masses = [*changes.masses.tolist(), float(changes.masses.sum())]
    are_sure = [*changes.is_heavier.tolist(), changes.is_sum_heavier]
    mass_cells = []
    for mass, is_sure in zip(masses, are_sure, strict=True):
        mass_cells.append(_change(mass, _kilograms(mass), is_sure=is_sure))
    distances_mm = 1e3 * changes.moved
    distance_cells = []
    for distance, is_sure in zip(distances_mm, changes.is_moved, strict=True):
        distance_cells.append(_change(distance, is_sure=bool(is_sure)))
    mass_changes = np.abs(changes.masses - changes.before).tolist()
    return Table(
        "",
        words("link", [*changes.links, "all"]),
        numbers("file", file_masses, _kilograms, "kg"),
        numbers("measured", mass_cells, unit="kg"),
        numbers("centre moved", [*distance_cells, MISSING], unit="mm"),
        level=level,
        most=max_rows,
        by=[*mass_changes, math.inf],  # largest changes first; the row of all links always stays
        of_limits=False,
    )


def _kilograms(mass: float) -> str:
    return number(mass, decimals=3)


def _change(value: float, text: str = "", *, is_sure: bool) -> Any:
    """Cell of a value, written as ``text`` or with one decimal: sure values have a mark, others are quiet; nan is missing."""
    if not math.isfinite(value):
        return MISSING
    if not text:
        text = number(value, decimals=1)
    if is_sure:
        return Line(f"● {text}", value=value)
    return Line((text, Style.QUIET), value=value)


def _joint_table(found: IdentifiedRobot, max_rows: int) -> Table:
    """Friction of each joint, and the unexplained share of its torque."""
    shares = found.held_out.joints
    names = list(shares)
    is_angular = Coordinates.from_model(found.original.model).angular_velocity
    columns: list[Column] = []
    if found.payload is None:
        for law, title in _LAW_TITLES.items():
            values_by_joint = found.consistent.of_joints(law)
            if values_by_joint:
                quantity = "tau/dq" if law == "viscous" else "tau"  # viscous friction is per speed
                values = [values_by_joint.get(name, MISSING) for name in names]
                columns.append(numbers(title, values, unit=_unit(quantity, is_angular)))
    if found.offsets:
        # an offset of 0 stands for an interval that contains 0, which is shown as missing too
        offsets = [found.offsets.get(name) or MISSING for name in names]
        columns.append(numbers("offset", offsets, unit=_unit("tau", is_angular)))
    share_values = list(shares.values())
    return Table(
        "",
        words("joint", names),
        *columns,
        numbers("unexplained", share_values, lambda share: percent(share, 3)),
        most=max_rows,
        by=np.nan_to_num(share_values, posinf=math.inf).tolist(),  # largest first; nan counts as 0
        of_limits=False,
    )


def _unit(quantity: str, is_angular: Array) -> str:
    """Units of "tau", or of "tau/dq", of velocities of which some are angular (mask)."""
    if quantity == "tau":
        return heading_unit("tau", is_angular)
    units = []
    if is_angular.any():
        units.append("N m s/rad")
    if not is_angular.all():
        units.append("N s/m")
    return ", ".join(units)


def _details(found: IdentifiedRobot) -> Iterator[Block]:
    """Blocks of the full form; each line gets its level here."""
    for block in _full_form(found):
        if isinstance(block, str):
            yield Line(block, level=Level.ALL)
        else:
            yield block


def _full_form(found: IdentifiedRobot) -> Iterator[str | Table]:
    """Settings, residuals, groups with their intervals, bodies, and quantities that no log determines."""
    yield f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    is_angular = Coordinates.from_model(found.original.model).angular_velocity
    torque_unit = heading_unit("tau", is_angular)
    yield Table(
        "Unexplained share of the torques",
        words("joint", found.held_out.joints),
        numbers("held out", found.held_out.joints.values(), lambda share: percent(share, 3)),
        numbers("size", found.sigma, unit=torque_unit),  # standard deviations of the residuals
        detail=", in rows held out",
        level=Level.ALL,
    )
    yield _groups_table(found)
    has_mass_moment = any(".mc" in name for name in first_parameters(found.groups))
    if has_mass_moment:
        yield "mcx, mcy, mcz: mass times the coordinates of the centre of mass. A sum has the unit of its first term."
    held_count = int(found.base.held.sum())
    if held_count:
        yield f"{held_count} parameters were held at known values"
    poor_groups = first_parameters(found.poorly_determined)  # deviations over 30 % of the values
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
    """Table of the groups that are not held at a known value, with their 95 % intervals."""
    free = np.flatnonzero(~found.base.held)
    values, deviations = found.values[free], found.standard_deviations[free]
    value_cells: list[Line] = []
    deviation_cells: list[Line] = []
    for value, deviation in zip(values, deviations, strict=True):
        value_text, deviation_text = estimate(value, deviation)
        value_cells.append(Line(value_text, value=value))
        deviation_cells.append(Line(deviation_text, value=deviation))
    intervals = found.interval()[free]
    low, high = intervals.T
    units = [found.units[k].replace("^2", "²") for k in free]
    all_units = ", ".join(dict.fromkeys(units))  # each unit once
    column = partial(numbers, unit=all_units, headed=False)
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
    _, share_of_all_groups = essential.curve[0]  # the curve begins with all groups
    return (
        f"{len(essential.names)} essential groups of {found.free_count} predict rows held out to "
        f"{percent(essential.held_out, 3)}, all to {percent(share_of_all_groups, 3)} (in units of each joint's residuals): "
        f"{'; '.join(values)}"
    )


def bodies_view(found: IdentifiedRobot) -> Iterator[str | Table]:
    """Physically consistent bodies compared with the file's, and their prediction error."""
    consistent = found.consistent
    unknown = found.base.unknown
    yield (
        f"Weight of the prior γ = {number(consistent.fit.strength)}: {percent(consistent.held_out, 3)} unexplained in 5-fold "
        f"cross-validation, weighted; by the file's own bodies with friction {percent(consistent.of_file, 3)}."
    )
    links: list[str] = []
    masses: list[float] = []
    file_masses: list[float] = []
    centres: list[str] = []
    for i in unknown.bodies:
        file_body = unknown.model.bodies[i]
        inertia = consistent.inertias[i]
        links.append(file_body.link)
        masses.append(float(inertia.mass))
        file_masses.append(float(file_body.inertia.mass))
        centres.append(", ".join(map(number, inertia.com)))
    yield Table(
        "Physically consistent bodies",
        words("link", links),
        numbers("mass", masses, unit="kg"),
        numbers("in the file", file_masses, unit="kg"),
        words("centre of mass [m]", centres),
        level=Level.ALL,
    )
