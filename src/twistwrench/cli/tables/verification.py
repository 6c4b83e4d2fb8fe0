"""The table of ``twistwrench verify``."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from ...verify import VerifyReport


def verification_table(report: VerifyReport) -> Table:
    """A row per check: what it compares, the residual, and what is allowed."""
    title = f"{escape(report.robot)}: {report.states} random states, seed {report.seed}"
    table = Table("check", "compares", "residual", "allowed", "", title=title, title_justify="left")
    for check in report.checks:
        if check.skipped:
            reason = f"{check.compares}\n[dim]skipped: {escape(check.skipped)}[/dim]"
            table.add_row(check.name, reason, "", "", "[dim]skipped[/dim]")
        else:
            verdict = "[green]agrees[/green]" if check.passed else "[bold red]DISAGREES[/bold red]"
            table.add_row(check.name, check.compares, f"{check.residual:.1e}", f"{check.tolerance:.0e}", verdict)
    return table
