"""Verification as blocks: verdict, and one row for each check."""

from __future__ import annotations

from collections.abc import Iterator

from ..core.answers.blocks import Block, Headline, Line, Table, numbers, words
from ..core.colours import Style, strong
from ..core.numbers import residual
from .verify import Check, VerifyReport


def verification_view(report: VerifyReport) -> Iterator[Block]:
    """Verdict, and for each check the compared quantities, residual and tolerance."""
    checks = report.checks
    count = sum(not check.skipped for check in checks)
    sentence = f"{count} checks agree."
    if report.verdict.reasons:
        sentence = f"{report.verdict.reasons[0]}."
    yield Headline(report.verdict.word, sentence)
    yield ""
    yield Table(
        report.robot,
        words("check", [check.name for check in checks]),
        words("compares", map(_compares, checks)),
        numbers("residual", [_figure(check, check.residual) for check in checks]),
        numbers("allowed", [_figure(check, check.tolerance) for check in checks]),
        words("", map(_agreement, checks)),
        detail=f": {report.states} random states, seed {report.seed}",
    )


def _compares(check: Check) -> str | Line:
    if not check.skipped:
        return check.compares
    return Line(f"{check.compares}\n", (f"skipped: {check.skipped}", Style.QUIET))


def _figure(check: Check, value: float) -> str | Line:
    if check.skipped:
        return ""
    return Line(residual(value), value=value)


def _agreement(check: Check) -> Line:
    if check.skipped:
        return Line(("skipped", Style.QUIET))
    return Line(("agrees", Style.GOOD) if check.passed else ("DISAGREES", strong(Style.OVER)))
