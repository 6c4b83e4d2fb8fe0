"""Tables in pipes and narrow terminals: every number and every name is there, whatever the width."""

from __future__ import annotations

import io

import numpy as np
import pytest
from click.testing import CliRunner
from rich.cells import cell_len
from rich.console import Console

from twistwrench.cli.main import main
from twistwrench.core import numbers as printed
from twistwrench.core.answers.blocks import Bar, Table, numbers, words
from twistwrench.core.answers.terminal import console, renderable

NUMBERS = [f"{1234.5678 + k:.4f} N m" for k in range(14)]


@pytest.mark.parametrize("width", [40, 80, 110])
def test_numbers_names_and_heads_are_never_cut(width, capsys):
    peaks = (numbers(f"peak number {k}", [text]) for k, text in enumerate(NUMBERS))
    table = Table("a title", words("joint", ["shoulder_pan_joint"]), *peaks)
    printer = console()
    printer.width, printer.file = width, io.StringIO()
    printer.print(renderable(table, printer))
    shown = printer.file.getvalue()
    assert all(number in shown for number in NUMBERS)
    names = "".join(line.split()[0] for line in shown.splitlines() if line.split() and "title" not in line)
    assert "shoulder_pan_joint" in names and shown.count("peak") == len(NUMBERS) and "…" not in shown


@pytest.mark.parametrize("huge", [3e9, -1.5e120, 1e300])
def test_huge_numbers_have_four_digits_and_their_power_of_ten(huge):
    said = [
        printed.torque(huge),
        printed.percent(huge),
        printed.percent_of_limit(huge),
        printed.deviation(abs(huge)),
        *printed.estimate(huge, abs(huge) / 7),
    ]
    assert max(map(len, said)) <= 12, said
    assert all(float(text.removesuffix(" %")) != 0 for text in said)


def test_whole_numbers_of_numpy_stand_in_full_as_those_of_python():
    table = Table("", numbers("python", [12345678]), numbers("numpy", [np.int64(12345678)]))
    printer = console()
    printer.width, printer.file = 80, io.StringIO()
    printer.print(renderable(table, printer))
    assert printer.file.getvalue().count("12345678") == 2


@pytest.mark.parametrize(
    "words",
    [
        "torques ur5 --trajectory demo --payload 10 --why --actuators demo",
        "payload ur5",
        "info panda",
        "doctor ur5",
        "robots",
        "move planar_2r --by 0.5,0.5 --duration 1",
        "simulate ur5 --duration 0.01",
        "identify planar_2r demo --cutoff 8 --shift 0",
        "sensor identify demo",
        "sensor poses",
        "derive planar_2r",
        "convert panda panda.xml",
        "size ur5 demo --catalog demo --masses-included --pause 0.8 --ambient 40",
    ],
)
def test_reports_keep_within_80_columns(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    output = CliRunner().invoke(main, words.split(), env={"COLUMNS": "80"}).output
    assert output and not [line for line in output.splitlines() if cell_len(line.rstrip()) > 80]


@pytest.mark.parametrize("width", [60, 72, 80, 84, 100, 120])
def test_a_name_is_folded_only_in_a_table_that_would_not_fit_with_it(width):
    """Padding goes first: a folded name means that the table with whole names is wider than the console."""
    names = [f"joint_{k}" for k in range(1, 7)]
    values = [123.456, -98.765, 4.5, 0.25, -0.003, 12.0]
    columns = [numbers(head, values) for head in ("peak", "± 1σ", "raw\npeak", "rms", "limit")]
    bars = words("share of limit", [Bar(0.1 * k, f"  {10 * k:>3} %") for k in range(6)], fold=False)
    table = Table("Torques [N m]", words("joint", names), *columns, bars, numbers("when", values, unit="s"))
    output = Console(width=width)
    with output.capture() as captured:
        output.print(renderable(table, output))
    lines = captured.get().splitlines()
    folded = [name for name in names if not any(line.split()[:1] == [name] for line in lines)]
    saved = len("joint_1") - len("joint_")
    assert not folded or max(cell_len(line.rstrip()) for line in lines) + saved > width
