"""Tables in pipes and narrow terminals: every number and every name is there, whatever the width."""

from __future__ import annotations

import io

import pytest
from rich.console import Group

from twistwrench.cli.console import console
from twistwrench.cli.tables.plain_table import PlainTable

NUMBERS = [f"{1234.5678 + k:.4f} N m" for k in range(14)]


@pytest.mark.parametrize("width", [40, 80, 110])
def test_numbers_names_and_heads_are_never_cut(width, capsys):
    table = PlainTable("a title")
    table.words("joint")
    table.numbers(*(f"peak number {k}" for k in range(len(NUMBERS))))
    table.row("shoulder_pan_joint", *NUMBERS)
    printer = console()
    printer.width, printer.file = width, io.StringIO()
    printer.print(Group(table))
    shown = printer.file.getvalue()
    assert all(number in shown for number in NUMBERS)
    names = "".join(line.split()[0] for line in shown.splitlines() if line.split() and "title" not in line)
    assert "shoulder_pan_joint" in names and shown.count("peak") == len(NUMBERS) and "…" not in shown
