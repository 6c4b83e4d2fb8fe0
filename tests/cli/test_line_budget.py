"""No command prints more than 45 lines at 80 columns without --all, and no name is folded in a table that fits with it whole."""

from __future__ import annotations

import shlex

import numpy as np
import pytest
from click.testing import CliRunner
from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from robot_files import FILES, NONE

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.answers.blocks import Headline, Remark, Table, numbers, words
from twistwrench.core.answers.terminal import MAX_LINES, TerminalTable, as_text, renderable
from twistwrench.core.errors import TwistWrenchError
from twistwrench.core.verdict import Word

WIDTHS = (60, 80, 84, 100, 120)

# ── Lines

BUNDLED = {
    "check": "torques ur5 demo --payload 10 --why",
    "payload": "payload quadruped --fixed-base --tip RR_foot",
    "move": "move panda --to 0.1,0.1,0.1,-0.5,0.1,0.5,0.1 --duration 2",
    "simulate": "simulate quadruped --duration 0.01",
    "info": "info quadruped",
    "doctor": "doctor quadruped",
    "robots": "robots",
    "sensor": "sensor identify demo",
    "log": f"log {tw.robots.path_of('ur5').with_name('ur5_demo.csv')}",
}
"""Commands on bundled robots; their slow relatives have laws of their own."""
OF_ANY_ROBOT = (
    "doctor {robot}",
    "info {robot}",
    "move {robot} --to {pose} --duration 2",
    "simulate {robot} --duration 0.005",
    "torques {robot} log.csv",
)


def printed_lines(command: str) -> list[str]:
    """Lines on standard output at 80 columns."""
    result = CliRunner().invoke(main, shlex.split(command), env={"COLUMNS": "80"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.stdout.splitlines()


@pytest.mark.parametrize("name", BUNDLED)
def test_a_command_prints_at_most_45_lines(name):
    lines = printed_lines(BUNDLED[name])
    assert 0 < len(lines) <= MAX_LINES
    assert not [line for line in lines if cell_len(line.rstrip()) > 80]


def arm_with_names_of(length: int, joints: int) -> str:
    """URDF of an arm whose joints and links have names of so many characters."""

    def name(kind: str, number: int) -> str:
        return (f"{kind}{number}" + "_part" * length)[:length]

    inertia = '<inertia ixx="0.01234" iyy="0.01345" izz="0.01456" ixy="0" ixz="0" iyz="0"/>'
    body = f'<inertial><mass value="1.2345"/><origin xyz="0.01234 0.02345 0.0056"/>{inertia}</inertial>'
    limits = '<limit lower="-1.234" upper="2.345" effort="12" velocity="3"/><dynamics damping="0.1" friction="0.12"/>'
    text = "".join(f'<link name="{name("l", k)}">{body}</link>' for k in range(joints + 1))
    for k in range(joints):
        ends = f'<parent link="{name("l", k)}"/><child link="{name("l", k + 1)}"/>'
        text += f'<joint name="{name("j", k)}" type="revolute">{ends}<axis xyz="0 0 1"/>{limits}</joint>'
    return f'<robot name="arm">{text}</robot>'


@pytest.mark.parametrize("joints", [1, 4, 6, 9])
@pytest.mark.parametrize("length", [3, 16, 30, 55])
def test_names_of_any_length_leave_a_short_form_of_45_lines(length, joints, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm_with_names_of(length, joints))
    lines = printed_lines(f"info {path}")
    assert 0 < len(lines) <= MAX_LINES
    text = "".join(" ".join(lines).split())
    for joint in tw.load(path).joint_names[:2]:
        assert all(part in text for part in joint.split("_"))


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name) for name in FILES] or NONE)
def test_a_command_prints_at_most_45_lines_for_any_robot(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = FILES[name]
    try:
        robot = tw.load(path)
    except TwistWrenchError:
        pytest.skip("not read")
    pose = robot.random_configuration(0)
    if robot.nq == robot.nv:
        time = np.linspace(0.0, 2.0, 50)
        q = robot.neutral + 0.05 * np.sin(time[:, None] + np.arange(robot.nq))
        head = ",".join(["time", *robot.coordinate_names])
        np.savetxt("log.csv", np.column_stack([time, q]), delimiter=",", header=head, comments="")
    long = {}
    for command in OF_ANY_ROBOT:
        typed = command.format(robot=shlex.quote(str(path)), pose=",".join(map(str, pose)))
        count = len(printed_lines(typed))
        if count > MAX_LINES:
            long[command] = count
    assert not long


def test_with_all_every_row_is_printed():
    names = tw.robots.quadruped().coordinate_names
    few, every = ("\n".join(printed_lines(f"simulate quadruped --duration 0.01{more}")) for more in ("", " --all"))
    assert len(names) == 19
    assert all(name in every for name in names) and not all(name in few for name in names)


def test_long_tables_share_the_lines_that_are_left():
    """Three tables of thirty joints beside a headline: each keeps its most important rows, and says how many it leaves out."""
    share = np.linspace(0.0, 1.0, 30)
    names = [f"joint_{k}" for k in range(30)]
    tables = [
        Table(title, words("joint", names), numbers("peak", share), most=12, by=share) for title in ("a", "b", "c")
    ]
    text = as_text([Headline(Word.OK, "all limits kept."), *tables, Remark("A note.")])
    assert len(text.splitlines()) <= MAX_LINES
    assert text.count("joint_29") == 3
    assert text.count("more below") == 3


# ── Names


def printed_table(table: Table, width: int) -> list[str]:
    """Lines of a table in a console of this width."""
    output = Console(width=width, color_system=None)
    with output.capture() as captured:
        output.print(renderable(table, output))
    return [line.rstrip() for line in captured.get().splitlines()]


def whole_width(table: Table) -> int:
    """Least width of a table with whole names: without padding, and with columns in their narrow form."""
    tight = TerminalTable(table, narrow=True)
    tight.padding = (0, 0)
    return Measurement.get(Console(), Console().options.update(max_width=10_000), tight).maximum


ANSWERS = {
    "check": lambda: tw.check("ur5", "demo", payload=10, why=True),
    "quadruped": lambda: tw.info("quadruped"),
    "panda": lambda: tw.info("panda"),
    "payload": lambda: tw.payload("ur5"),
    "move": lambda: tw.move("ur5", [0.9, -0.9, 1.0, -0.4, 1.2, 1.0]),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_name_is_folded_only_where_the_table_would_not_fit_with_it_whole(name):
    for table in [block for block in ANSWERS[name]().blocks() if isinstance(block, Table)]:
        names = [
            str(cell) for column in table.columns if column.words for cell in column.values if isinstance(cell, str)
        ]
        for width in WIDTHS:
            text = "\n".join(printed_table(table, width))
            if whole_width(table) <= width:
                assert [cell for cell in names if cell not in text] == [], (table.title, width)
