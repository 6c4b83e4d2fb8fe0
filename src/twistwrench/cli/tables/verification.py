"""The table of ``twistwrench verify``."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ...core.printed_numbers import residual
from ...verify import VerifyReport
from .plain_table import PlainTable


def verification_view(report: VerifyReport) -> RenderableType:
    """The verdict, and a row per check: what it compares, the residual, and what is allowed."""
    made = [check for check in report.checks if not check.skipped]
    failed = [check.name for check in made if not check.passed]
    verdict = f"DISAGREES: {', '.join(failed)}." if failed else f"OK: {len(made)} checks agree."
    return Group(Text(verdict, "bold red" if failed else "bold"), Text(), _table(report))


def _table(report: VerifyReport) -> PlainTable:
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
