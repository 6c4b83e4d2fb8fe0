"""The findings of ``twistwrench doctor``: what is wrong, what it does, and the repair."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ...diagnosis import DoctorReport, Finding, Severity

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
