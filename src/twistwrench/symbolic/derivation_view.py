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

_MAX_LINES = 45
"""Maximum number of lines of the short form."""
_WIDTH = 80
"""Width in characters for which lines are counted."""
_OTHER_LINES = 6
"""Lines of the short form that are neither symbols nor steps: verdict, check, remark, and the way to the full form."""
_TABLE_HEAD_LINES = 5
"""Lines of a table beside its rows."""
_MAX_STEP_LINES = 20
"""Maximum number of lines of a step that is printed beside the table of steps."""
_EXPANDED_STEPS = ("mass_matrix", "centripetal", "coriolis", "gravity_forces", "equations")
"""Steps printed of an expanded derivation, unless others are selected."""
_STEPS_BESIDE_TABLE = ("equations", "gravity_forces", "mass_matrix", "lagrangian")
"""Steps printed beside the table of steps, if they are short enough; in the order of their importance."""


def derivation_view(derivation: Derivation) -> Iterator[Block]:
    """Blocks of a derivation, verdict first."""
    yield _headline(derivation)
    legend = _legend(derivation)
    steps = {step.name: _equations(step) for step in derivation.steps}
    names = derivation.selected
    if not names:
        names = tuple(steps)
        if derivation.form == "expanded":
            names = _EXPANDED_STEPS
    printed_steps = [steps[name] for name in names if name in steps]
    is_selection = derivation.selected is not None
    line_count = _height(legend) + sum(map(_height, printed_steps)) + _OTHER_LINES
    if not is_selection and line_count > _MAX_LINES:
        yield from _overview(derivation, legend, steps)
    else:
        yield legend
        yield _step_table(derivation, Level.PAGE)
        yield from printed_steps
        if not is_selection:
            for block in steps.values():
                if block not in printed_steps:
                    yield replace(block, level=Level.ALL)
        yield from _check(derivation, Level.SHORT)
        if not is_selection:
            yield More(f"All {len(steps)} steps")
    yield from remarks(derivation.remarks)


def _headline(derivation: Derivation) -> Headline:
    """Verdict, with the form and the number of symbols if it is DONE."""
    verdict = derivation.verdict
    if not verdict.ok:
        return Headline.from_verdict(verdict)
    text = f"equations of motion of {derivation.name}, {derivation.brief}"
    symbol_count = len(derivation.parameters)
    if symbol_count:
        noun = "symbols" if symbol_count > 1 else "symbol"
        text += f", {symbol_count} {noun} with values"
    return Headline(verdict.word, f"{text}; checked.")


def _overview(derivation: Derivation, legend: Aligned, steps: dict[str, Aligned]) -> Iterator[Block]:
    """Table of the steps, short steps, and an entry of M unless M is a short step; all other blocks with ``Level.ALL``."""
    yield _step_table(derivation, Level.SHORT)
    remaining_lines = _MAX_LINES - _OTHER_LINES - len(steps) - _TABLE_HEAD_LINES
    short_steps: list[str] = []
    for name in _STEPS_BESIDE_TABLE:
        if name not in steps:
            continue
        height = _height(steps[name])
        if height <= min(remaining_lines, _MAX_STEP_LINES):
            short_steps.append(name)
            remaining_lines -= height
    if "mass_matrix" not in short_steps:
        rows = list(steps["mass_matrix"].rows)
        widths = [text_width(entry) for _, entry in rows]
        label, shortest_entry = rows[widths.index(min(widths))]
        yield Line(f"{label} {shortest_entry}")
    yield replace(legend, level=Level.ALL)
    for name, block in steps.items():
        if name in short_steps:
            yield block
        else:
            yield replace(block, level=Level.ALL)
    yield from _check(derivation, Level.ALL)
    line_count = _height(legend) + sum(map(_height, steps.values()))
    yield More(f"All {line_count} lines of symbols and steps")


def _height(block: Aligned) -> int:
    """Number of lines of a block at the width ``_WIDTH``; a title has a blank line before it."""
    title = block.title_lines(_WIDTH)
    blank_lines = 1 if title else 0
    return len(block.lines(_WIDTH)) + len(title) + blank_lines


def _legend(derivation: Derivation) -> Aligned:
    """Symbols with their meanings, and values of parameters."""
    notation = Text()
    meanings = dict(derivation.meanings)
    for parameter in derivation.parameters:
        meanings[parameter.name] = f"{parameter.meaning}: {number(parameter.value, 6)}"
    rows = [(notation.symbol(name), meaning) for name, meaning in meanings.items()]
    return Aligned("", rows, wrap, gap="  ")


def _equations(step: Step) -> Aligned:
    """Equations of a step, below its heading and remark."""
    notation = Text()
    rows = []
    for label, expr in step.lines:
        rows.append((f"{label.write(notation)} =", notation.write(expr)))
    title = f"{heading(step)}: {step.remark}"
    return Aligned(title, rows, lambda text, width: break_lines(text, width, text_width))


def _check(derivation: Derivation, level: Level) -> Iterator[Block]:
    """Text of the comparison with the kernels, if there is one."""
    if derivation.check is not None:
        yield Aligned(str(derivation.check), (), wrap, level=level)


def _step_table(derivation: Derivation, level: Level) -> Table:
    """Number of entries and terms of each step, and its longest entry."""
    notation = Text()
    steps = derivation.steps
    term_counts = []
    longest_entries = []
    for step in steps:
        terms_of_entries = [_term_count(expr) for _, expr in step.lines]
        longest_index = terms_of_entries.index(max(terms_of_entries))
        label, _ = step.lines[longest_index]
        term_counts.append(sum(terms_of_entries))
        longest_entries.append(label.write(notation))
    return Table(
        "Steps",
        words("step", map(heading, steps)),
        numbers("entries", [len(step.lines) for step in steps]),
        numbers("terms", term_counts),
        words("largest", longest_entries),
        level=level,
    )


def _term_count(expr: Any) -> int:
    """Number of terms of a sum, or of all entries of a column."""
    entries = list(expr) if hasattr(expr, "shape") else [expr]
    return sum(len(sympy.Add.make_args(entry)) for entry in entries)
