"""The table of ``twistwrench verify``."""

from __future__ import annotations

from rich.text import Text

from ...core.printed_numbers import residual
from ...verify import VerifyReport
from .plain_table import PlainTable


def verification_table(report: VerifyReport) -> PlainTable:
    """A row per check: what it compares, the residual, and what is allowed."""
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
