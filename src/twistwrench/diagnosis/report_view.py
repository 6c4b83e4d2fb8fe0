"""Findings of the doctor as blocks: one paragraph for all findings of a check with the same kind of repair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

from ..core.answers.blocks import Block, Headline, Level, Line, More, remarks
from ..core.answers.data import plain
from ..core.colours import Style, strong
from ..motion.model_doubts import base_doubts
from .findings import Finding, Severity

if TYPE_CHECKING:
    from .report import DoctorReport

_COLOURS = {Severity.ERROR: strong(Style.OVER), Severity.WARNING: Style.NEAR, Severity.NOTE: Style.QUIET}
_LINES, _WIDTH = 34, 76
"""Lines of the paragraphs of the short form, and characters of a line in the narrowest terminal."""
_PLACES = 6
"""Maximum number of places of a paragraph in the short form."""


def doctor_view(report: DoctorReport) -> Iterator[Block]:
    """Verdict, effect of all repairs, and the findings, worst first."""
    yield Headline(report.verdict.word, f"{report.robot}, {report.summary}.")
    yield from remarks(f"{text}." for text in base_doubts(report.contents.robot.model))
    if not report.findings:
        return
    if str(report.effect) != "none":
        yield f"all repairs together change: {report.effect}"
    yield ""
    left, short = _LINES, True
    for group in report.paragraphs:
        paragraph = _paragraph(group[0]) if len(group) == 1 else [_heading(group), *_paragraph(group[0])[1:]]
        left -= sum(1 + len(plain(line)) // _WIDTH for line in paragraph)
        short = short and (left >= 0 or group is report.paragraphs[0])
        yield from _at(paragraph, Level.SHORT if short else Level.ALL)
        yield from _at(chain.from_iterable(map(_paragraph, group[1:])), Level.ALL)
    if not short or len(report.paragraphs) < len(report.findings):
        yield More(f"All {len(report.findings)} findings with lines")


def _at(lines: Sequence[Line] | Iterator[Line], level: Level) -> Iterator[Line]:
    for line in lines:
        line.level = level
        yield line


def place_words(finding: Finding) -> str:
    """Part of the robot, with its file and line."""
    line = f"{finding.file + ', ' if finding.file else ''}line {finding.line}" if finding.line else ""
    return ", ".join(x for x in (finding.where, line) if x)


def _heading(group: Sequence[Finding]) -> Line:
    """Severity, check and places of a group."""
    first = group[0]
    places = [f"{finding.where} (line {finding.line})" if finding.line else finding.where for finding in group]
    named = [place for place in places[:_PLACES] if place]
    more = len(places) - _PLACES
    rest = f", and {more} more" if more > 0 else ""
    where = f": {', '.join(named)}{rest}" if named else ""
    return Line((str(first.severity), _COLOURS[first.severity]), f"  {first.check}, {len(group)} findings{where}")


def _paragraph(finding: Finding) -> list[Line]:
    """Severity, check and place; below them the sentence, the repair and its effect."""
    head = ", ".join(x for x in (finding.check, place_words(finding)) if x)
    lines = [
        Line((str(finding.severity), _COLOURS[finding.severity]), f"  {head}"),
        Line(finding.sentence, indent=2),
    ]
    if finding.repair is not None:
        lines.append(Line(f"repair: {finding.repair.sentence}", indent=2))
    if str(finding.effect) != "none":
        lines.append(Line(f"effect of the repair: {finding.effect}", indent=2))
    return lines
