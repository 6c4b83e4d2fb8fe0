"""Derivation as blocks: symbols with their values, and the steps that fit into a screen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from ..core.answers.blocks import Aligned, Block, Headline, Level, Line, More, Table, numbers, remarks, words
from ..core.numbers import number
from ..core.text import text_width
from .documents import heading
from .equations import Step
from .line_breaks import break_lines
from .names import Text, sympy

if TYPE_CHECKING:
    from .derivation import Derivation

_MAX_LINES, _WIDTH = 45, 80
"""Maximum number of lines of the short form, and the columns for which lines are counted."""
_FRAME = 6
"""Lines of the short form beside symbols and steps: verdict, check, remark, and the way to the rest."""
_TABLE_LINES = 5
"""Lines of a table beside its rows."""
_MAX_STEP_LINES = 20
"""Maximum number of lines of a step that is printed beside the table of steps."""
_MAIN = ("mass_matrix", "centripetal", "coriolis", "gravity_forces", "equations")
"""Steps of a derivation that is written out, unless others are selected."""
_FIRST = ("equations", "gravity_forces", "mass_matrix", "lagrangian")
"""Steps printed beside the table of steps, if they are short enough."""


def derivation_view(derivation: Derivation) -> Iterator[Block]:
    """Blocks of a derivation, verdict first."""
    yield _headline(derivation)
    legend, steps = _legend(derivation), {step.name: _equations(step) for step in derivation.steps}
    names = derivation.selected
    if not names:
        names = _MAIN if derivation.form == "expanded" else tuple(steps)
    shown = [steps[name] for name in names if name in steps]
    if derivation.selected is None and _height(legend) + sum(map(_height, shown)) + _FRAME > _MAX_LINES:
        yield from _overview(derivation, legend, steps)
    else:
        yield legend
        yield _steps(derivation, Level.PAGE)
        yield from shown
        if derivation.selected is None:
            for block in steps.values():
                if block not in shown:
                    yield replace(block, level=Level.ALL)
        yield from _check(derivation, Level.SHORT)
        if derivation.selected is None:
            yield More(f"All {len(steps)} steps")
    yield from remarks(derivation.remarks)


def _headline(derivation: Derivation) -> Headline:
    verdict = derivation.verdict
    if not verdict.ok:
        return Headline.from_verdict(verdict)
    text = f"equations of motion of {derivation.name}, {derivation.brief}"
    count = len(derivation.parameters)
    if count:
        text += f", {count} symbol{'s' * (count > 1)} with values"
    return Headline(verdict.word, f"{text}; checked.")


def _overview(derivation: Derivation, legend: Aligned, steps: dict[str, Aligned]) -> Iterator[Block]:
    """Table of the steps, and short steps or the shortest entry of M; everything with all lines."""
    yield _steps(derivation, Level.SHORT)
    room = _MAX_LINES - _FRAME - len(steps) - _TABLE_LINES
    short: list[str] = []
    for name in _FIRST:
        if name in steps and _height(steps[name]) <= min(room, _MAX_STEP_LINES):
            short.append(name)
            room -= _height(steps[name])
    if "mass_matrix" not in short:
        left, right = min(steps["mass_matrix"].rows, key=lambda row: text_width(row[1]))
        yield Line(f"{left} {right}")
    yield replace(legend, level=Level.ALL)
    for name, block in steps.items():
        if name in short:
            yield block
        else:
            yield replace(block, level=Level.ALL)
    yield from _check(derivation, Level.ALL)
    yield More(f"All {_height(legend) + sum(map(_height, steps.values()))} lines of symbols and steps")


def _height(block: Aligned) -> int:
    """Lines of a block in the columns for which lines are counted; a title has a blank line before it."""
    title = block.title_lines(_WIDTH)
    return len(block.lines(_WIDTH)) + len(title) + bool(title)


def _legend(derivation: Derivation) -> Aligned:
    notation = Text()
    rows = []
    for name, meaning in derivation.meanings:
        rows.append((notation.symbol(name), meaning))
    rows += [(notation.symbol(p.name), f"{p.meaning}: {number(p.value, 6)}") for p in derivation.parameters]
    return Aligned("", rows, wrap, gap="  ")


def _equations(step: Step) -> Aligned:
    notation = Text()
    rows = []
    for label, expr in step.lines:
        rows.append((f"{label.write(notation)} =", notation.write(expr)))
    return Aligned(f"{heading(step)}: {step.remark}", rows, lambda text, width: break_lines(text, width, text_width))


def _check(derivation: Derivation, level: Level) -> Iterator[Block]:
    if derivation.check is not None:
        yield Aligned(str(derivation.check), (), wrap, level=level)


def _steps(derivation: Derivation, level: Level) -> Table:
    """Number of entries and terms of each step, and its longest entry."""
    notation, steps = Text(), derivation.steps
    totals, largest = [], []
    for step in steps:
        counts = [_terms(expr) for _, expr in step.lines]
        label, _ = step.lines[counts.index(max(counts))]
        totals.append(sum(counts))
        largest.append(label.write(notation))
    return Table(
        "Steps",
        words("step", map(heading, steps)),
        numbers("entries", [len(step.lines) for step in steps]),
        numbers("terms", totals),
        words("largest", largest),
        level=level,
    )


def _terms(expr: Any) -> int:
    """Number of terms of a sum, or of all entries of a column."""
    entries = list(expr) if hasattr(expr, "shape") else [expr]
    return sum(map(len, map(sympy.Add.make_args, entries)))
