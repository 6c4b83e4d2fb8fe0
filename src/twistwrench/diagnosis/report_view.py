"""Findings of the doctor as blocks: one paragraph for all findings of a check with the same kind of repair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..core.answers.blocks import Block, Headline, Level, Line, More, remarks
from ..core.answers.data import plain
from ..core.colours import Style, strong
from ..motion.model_doubts import base_doubts
from .findings import Finding, Severity, line_text

if TYPE_CHECKING:
    from .report import DoctorReport

_SEVERITY_STYLES = {Severity.ERROR: strong(Style.OVER), Severity.WARNING: Style.NEAR, Severity.NOTE: Style.QUIET}
_MAX_SHORT_LINES = 34
"""Maximum number of lines of the paragraphs in the short form, on the narrowest terminal."""
_MIN_TERMINAL_WIDTH = 76
"""Number of characters in a line of the narrowest terminal."""
_MAX_LISTED_PLACES = 6
"""Maximum number of places in the heading of a group of findings."""


def doctor_view(report: DoctorReport) -> Iterator[Block]:
    """Verdict, effect of all repairs, and the findings, worst first."""
    yield Headline(report.verdict.word, f"{report.robot}, {report.summary}.")
    yield from remarks(f"{text}." for text in base_doubts(report.contents.robot.model))
    if not report.findings:
        return
    if str(report.effect) != "none":
        yield f"all repairs together change: {report.effect}"
    yield ""
    groups = report.paragraphs
    remaining_lines = _MAX_SHORT_LINES
    level = Level.SHORT
    for group in groups:
        first_finding, *other_findings = group
        paragraph = _paragraph(first_finding)
        if other_findings:
            paragraph[0] = _heading(group)
        for line in paragraph:
            remaining_lines -= 1 + len(plain(line)) // _MIN_TERMINAL_WIDTH
        # The first group is shown even if it is long: a report of errors shows at least one.
        if remaining_lines < 0 and group is not groups[0]:
            level = Level.ALL
        yield from _set_level(level, paragraph)
        for finding in other_findings:
            yield from _set_level(Level.ALL, _paragraph(finding))
    if level is Level.ALL or len(groups) < len(report.findings):
        yield More(f"All {len(report.findings)} findings with lines")


def _set_level(level: Level, lines: Sequence[Line]) -> Sequence[Line]:
    """Set the level of the report from which the lines are shown, and return the lines."""
    for line in lines:
        line.level = level
    return lines


def place_words(finding: Finding) -> str:
    """Text of the part of the robot, with its file and line if they are known."""
    words = (finding.where, line_text(finding))
    return ", ".join(filter(None, words))


def _heading(group: Sequence[Finding]) -> Line:
    """Heading of a group of findings: severity, check, number and places."""
    first_finding = group[0]  # all have its check and severity
    text = f"  {first_finding.check}, {len(group)} findings"
    places = [_short_place(finding) for finding in group[:_MAX_LISTED_PLACES]]
    if any(places):
        text += f": {', '.join(filter(None, places))}"
        omitted_count = len(group) - _MAX_LISTED_PLACES
        if omitted_count > 0:
            text += f", and {omitted_count} more"
    severity = first_finding.severity
    return Line((str(severity), _SEVERITY_STYLES[severity]), text)


def _short_place(finding: Finding) -> str:
    """Part of the robot, with its line in the file if known."""
    if not finding.line:
        return finding.where
    return f"{finding.where} (line {finding.line})"


def _paragraph(finding: Finding) -> list[Line]:
    """Lines on a finding: severity, check and place; below them the sentence, the repair and its effect."""
    head = ", ".join(filter(None, (finding.check, place_words(finding))))  # there may be no place
    lines = [
        Line((str(finding.severity), _SEVERITY_STYLES[finding.severity]), f"  {head}"),
        Line(finding.sentence, indent=2),
    ]
    if finding.repair is not None:
        lines.append(Line(f"repair: {finding.repair.sentence}", indent=2))
    if str(finding.effect) != "none":
        lines.append(Line(f"effect of the repair: {finding.effect}", indent=2))
    return lines
