"""Report of an identification, in blocks: what it predicts, bodies and joints against the file, and groups of parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from ...control.residual_threshold import threshold_table
from ...core.answers.blocks import Block, Column, Headline, Level, Line, More, Table, numbers, words
from ...core.colours import Style
from ...core.numbers import MISSING, estimate, number, percent, plus_minus
from ...core.text import listed
from ...core.verdict import Word
from ...mechanics.joints.units import heading_unit
from ...motion.coordinates import Coordinates
from ..body_changes import BodyChanges

if TYPE_CHECKING:
    from ...control.residual_threshold import ResidualThreshold
    from ..result import IdentifiedRobot

_KINDS = {"test": "in the test logs", "five-fold": "in 5-fold cross-validation over time"}
_MOST_NAMES, _MOST_DOUBTS, _MOST_ROWS = 5, 4, 12
_LINES, _OTHER_LINES, _FEWEST_ROWS = 45, 17, 4
"""Lines of the short form, lines of it that are neither doubts nor rows, and rows that it has in any case."""
_WIDTH = 74
_LAWS = {"coulomb": "Coulomb", "viscous": "viscous", "stribeck": "static excess"}


def identification_view(found: IdentifiedRobot) -> Iterator[Block]:
    """Verdict, doubts, bodies and joints; settings, groups and what no log determines in the full form."""
    unsure = found.verdict.word is Word.LOOK_AGAIN
    level = Level.ALL if unsure or found.payload is not None else Level.SHORT
    changes = found.body_changes if found.base.unknown.bodies else None
    further = [Line(tool_sentence(changes))] if changes is not None and changes.tool is not None and not unsure else []
    yield Headline(found.verdict.word, _headline(found), further=further)
    told = [Line((f"• {doubt.sentence}", Style.OVER if doubt.refuses else "")) for doubt in found.doubts]
    told += [Line(note) for note in found.notes]
    for k, line in enumerate(told):
        line.level = Level.SHORT if k < _MOST_DOUBTS else Level.ALL
        yield line
    if len(told) > _MOST_DOUBTS:
        yield More(f"{len(told) - _MOST_DOUBTS} more doubts and notes")
    if (payload := found.payload) is not None:
        com = ", ".join(plus_minus(x, d) for x, d in zip(payload.com, payload.com_deviations, strict=True))
        mass = plus_minus(payload.mass, payload.mass_deviation)
        yield f"payload at {payload.frame}: {mass} kg, centre of mass ({com}) m in its frame"
        if payload.unidentifiable:
            yield f"not determined by the torques, taken from the file: {', '.join(payload.unidentifiable)}"
    rows = _rows_that_fit(told[:_MOST_DOUBTS])
    if changes is not None:
        yield _bodies(changes, level, rows)
    yield _joints(found, rows)
    if changes is not None and level is Level.SHORT:
        yield Line((f"● is certain (two standard deviations). {_open_groups(found)}".strip(), Style.QUIET))
    if "gain-of-all" in found.undetermined:
        yield Line(
            "→ Weigh a payload, or hold one known mass: if all torques are wrong by one factor, this log cannot show it."
        )
    if found.thresholds is not None:
        yield from _thresholds(found.thresholds)
    yield More(f"{found.free_count} groups of parameters, their intervals, settings of the fit")
    yield from _details(found)


def _headline(found: IdentifiedRobot) -> str:
    """Share of the torques that the robot predicts, and the worst joint."""
    left, where = percent(found.held_out.all, 3), _KINDS[found.held_out.kind]
    worst = found.worst
    joint = (
        "" if worst is None or len(found.held_out.joints) == 1 else f" (worst joint {worst[0]}, {percent(worst[1], 3)})"
    )
    if found.verdict.ok:
        return f"predicts torques to {left}{joint}, {where}."
    return f"{left} of the torques unexplained{joint}, {where}."


_MOTIONS = {
    "coulomb": "slowly in both directions",
    "stribeck": "slowly in both directions",
    "viscous": "fast and steadily",
    "motor_inertia": "with large accelerations",
    "offset": "in both directions",
}
"""Motion of a joint that determines a parameter of its drive; far and fast motions determine bodies."""


def _open_groups(found: IdentifiedRobot) -> str:
    """Sentence on groups that leave torques of another motion open, and the motion for the largest; empty without."""
    if not (groups := found.open_for_torques):
        return ""
    (name, (joint, share)), count = next(iter(groups.items())), len(groups)
    first = name.split(" ")[0]
    way = _MOTIONS.get(first.rpartition(".")[2], "far and fast")
    said = "1 group leaves" if count == 1 else f"{count} groups leave"
    most = f"most {first} ({percent(share, 2)} at {joint})"
    return f"{said} more than 2 % of another motion's torques open, {most}: move {joint} {way}."


def tool_sentence(changes: BodyChanges) -> str:
    """Question about the body that alone explains the log."""
    tool = changes.tool
    assert tool is not None
    way, question = ("more", "is a tool mounted?") if tool.mass > 0 else ("less", "does the robot lack a tool?")
    return f"{tool.link} weighs {number(abs(tool.mass), 2)} kg {way} than in the file: {question}"


def _rows_that_fit(told: Sequence[Line]) -> int:
    """Rows of each of two tables that the short form has room for, beside these lines."""
    taken = sum(-(-sum(len(piece) for piece in _texts(line)) // _WIDTH) for line in told)
    return max(_FEWEST_ROWS, min(_MOST_ROWS, (_LINES - _OTHER_LINES - taken) // 2))


def _texts(line: Line) -> list[str]:
    return [piece if isinstance(piece, str) else piece[0] for piece in line.pieces]


def _thresholds(found: ResidualThreshold) -> Iterator[Block]:
    """Thresholds of a residual, and reasons to doubt them."""
    yield Line(found.sentence)
    yield from (Line(f"• {doubt.sentence}") for doubt in found.doubts)
    yield threshold_table(found)


# ── Bodies and joints


def _bodies(changes: BodyChanges, level: Level, rows: int) -> Table:
    """Masses in the file and identified, and moves of the centres of mass; sure changes have a mark."""
    masses = [*changes.masses.tolist(), float(changes.masses.sum())]
    sure = [*changes.is_heavier.tolist(), changes.is_sum_heavier]
    moved = [_change(1e3 * x, is_sure=bool(s)) for x, s in zip(changes.moved, changes.is_moved, strict=True)]
    by = [abs(after - before) for after, before in zip(changes.masses, changes.before, strict=True)]
    return Table(
        "",
        words("link", [*changes.links, "all"]),
        numbers("file", [*changes.before.tolist(), float(changes.before.sum())], _kilograms, "kg"),
        numbers(
            "measured", [_change(m, _kilograms(m), is_sure=s) for m, s in zip(masses, sure, strict=True)], unit="kg"
        ),
        numbers("centre moved", [*moved, MISSING], unit="mm"),
        level=level,
        most=rows,
        by=[*by, math.inf],
        of_limits=False,
    )


def _kilograms(value: float) -> str:
    return number(value, decimals=3)


def _change(value: float, text: str = "", *, is_sure: bool) -> Any:
    """Number with a mark if it is sure, and quiet without."""
    if not math.isfinite(value):
        return MISSING
    text = text or number(value, decimals=1)
    return Line(f"● {text}", value=value) if is_sure else Line((text, Style.QUIET), value=value)


def _joints(found: IdentifiedRobot, rows: int) -> Table:
    """Friction of each joint, and the share of its torque that is left unexplained."""
    shares, names = found.held_out.joints, list(found.held_out.joints)
    turning = Coordinates.from_model(found.original.model).angular_velocity
    columns: list[Column] = []
    if found.payload is None:
        of_laws = {law: found.consistent.of_joints(law) for law in _LAWS}
        kinds = {"viscous": "tau/dq"}
        columns = [
            numbers(
                _LAWS[law],
                [of.get(name, MISSING) for name in names],
                unit=_unit(kinds.get(law, "tau"), turning),
            )
            for law, of in of_laws.items()
            if of
        ]
    if found.offsets:
        offsets = [found.offsets.get(name) or MISSING for name in names]  # 0 has its interval around it
        columns.append(numbers("offset", offsets, unit=_unit("tau", turning)))
    return Table(
        "",
        words("joint", names),
        *columns,
        numbers("unexplained", shares.values(), lambda share: percent(share, 3)),
        most=rows,
        by=[0.0 if math.isnan(share) else share for share in shares.values()],
        of_limits=False,
    )


def _unit(quantity: str, turning: Any) -> str:
    """Unit of a torque, or of a torque by a speed."""
    if quantity == "tau":
        return heading_unit("tau", turning)
    kinds = ("N m s/rad", "N s/m")
    return ", ".join(kind for kind, has in zip(kinds, (turning.any(), (~turning).any()), strict=True) if has)


# ── The full form


def _details(found: IdentifiedRobot) -> Iterator[Block]:
    """Settings, residuals, groups with their intervals, bodies, and quantities that no log determines."""
    for block in _full_form(found):
        if isinstance(block, str):
            yield Line(block, level=Level.ALL)
        else:
            yield block


def _full_form(found: IdentifiedRobot) -> Iterator[str | Table]:
    yield f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    yield Table(
        "Unexplained share of the torques, in rows held out",
        words("joint", found.held_out.joints),
        numbers("held out", found.held_out.joints.values(), lambda share: percent(share, 3)),
        numbers(
            "size", found.sigma, unit=heading_unit("tau", Coordinates.from_model(found.original.model).angular_velocity)
        ),
        level=Level.ALL,
    )
    yield _groups_table(found)
    if any(".mc" in name.split(" ")[0] for name in found.groups):
        yield "mcx, mcy, mcz: mass times the coordinates of the centre of mass. A sum has the unit of its first term."
    if found.base.held.any():
        yield f"{int(found.base.held.sum())} parameters were held at known values"
    if listed_groups := found.poorly_determined:
        names = listed((name.split(" ")[0] for name in listed_groups), _MOST_NAMES, "; ")
        count = f"{len(listed_groups)} of {found.free_count} groups"
        yield f"Poorly determined, standard deviation above 30 %: {count}, {names}"
    yield _essential(found)
    yield from bodies_view(found)
    if found.undetermined:
        yield "Not determined by this log:"
        yield from (f"• {sentence}" for sentence in found.undetermined.values())


def _groups_table(found: IdentifiedRobot) -> Table:
    free = ~found.base.held
    values, deviations = found.values[free], found.standard_deviations[free]
    pairs = list(map(estimate, values, deviations))
    low, high = found.interval()[free].T
    units = [unit.replace("^2", "²") for unit, kept in zip(found.units, free, strict=True) if kept]
    column = partial(numbers, unit=", ".join(dict.fromkeys(units)), headed=False)
    return Table(
        f"{int(free.sum())} groups of parameters",
        words("group", [name for name, kept in zip(found.groups, free, strict=True) if kept]),
        words("unit", units, fold=False),
        column("value", [Line(text, value=x) for (text, _), x in zip(pairs, values, strict=True)]),
        column("deviation", [Line(text, value=x) for (_, text), x in zip(pairs, deviations, strict=True)]),
        column("95 % from", low),
        column("to", high),
        column("file", found.prior.mean[free]),
        level=Level.ALL,
    )


def _essential(found: IdentifiedRobot) -> str:
    one = found.essential
    names = "; ".join(
        f"{name.split(' ')[0]} {number(value)}" for name, value in zip(one.names, one.values, strict=True)
    )
    return (
        f"{len(one.names)} essential groups of {found.free_count} predict rows held out to "
        f"{percent(one.held_out, 3)}, all to {percent(one.curve[0][1], 3)} (in units of each joint's residuals): {names}"
    )


def bodies_view(found: IdentifiedRobot) -> Iterator[str | Table]:
    """Physically consistent bodies compared with the file's, and their prediction error."""
    consistent, unknown = found.consistent, found.base.unknown
    yield (
        f"Weight of the prior γ = {number(consistent.fit.strength)}: {percent(consistent.held_out, 3)} unexplained in 5-fold "
        f"cross-validation, weighted; by the file's own bodies with friction {percent(consistent.of_file, 3)}."
    )
    pairs = [(unknown.model.bodies[i], consistent.inertias[i]) for i in unknown.bodies]
    yield Table(
        "Physically consistent bodies",
        words("link", [body.link for body, _ in pairs]),
        numbers("mass", [float(G.mass) for _, G in pairs], unit="kg"),
        numbers("in the file", [float(body.inertia.mass) for body, _ in pairs], unit="kg"),
        words("centre of mass [m]", [", ".join(number(x) for x in G.com) for _, G in pairs]),
        level=Level.ALL,
    )
