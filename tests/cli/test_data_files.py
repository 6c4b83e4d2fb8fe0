"""Files of data: printed by ``-`` in place of the report, and replaced with --overwrite only."""

from __future__ import annotations

import json
import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

COMMANDS = {
    "torques": "torques ur5 --trajectory demo",
    "payload": "payload ur5",
    "size": "size ur5 demo --catalog demo --masses-included",
    "info": "info planar_2r",
    "identify": "identify planar_2r demo --cutoff 10",
    "excite": "excite planar_2r --acceleration 5 --duration 4 --harmonics 2 --restarts 1 --step 0.1",
    "move": "move planar_2r --to 0.5,0.5 --duration 1 --step 0.1",
    "simulate": "simulate planar_2r --duration 0.05",
    "calibrate": "calibrate ur5 demo",
    "compensate": "sensor compensate demo --sensor demo",
    "sensor identify": "sensor identify demo",
    "poses": "sensor poses --count 3",
}
"""A quick call of each command that has --csv."""
DATA = re.compile(r"OUT(\.(csv|json|mcap|npz|rrd|urdf|yaml))?")


def run(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)])


def commands(group=main):
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        yield from commands(command) if isinstance(command, click.Group) else [command]


def test_every_command_that_writes_data_can_overwrite_and_has_a_call_here():
    every = list(commands())
    writing = [c for c in every if any(DATA.fullmatch(p.metavar or "") for p in c.params)]
    assert len(writing) > len(COMMANDS)
    assert [c for c in every if any("--overwrite" in p.opts for p in c.params)] == writing
    assert sum(any("--csv" in p.opts for p in c.params) for c in every) == len(COMMANDS)


SLOW = [
    pytest.param(n, marks=pytest.mark.slow) if n in ("size", "identify", "excite", "calibrate") else n for n in COMMANDS
]


@pytest.mark.parametrize("name", SLOW)
def test_a_table_is_printed_or_written_and_never_replaced_unasked(name, tmp_path):
    words, out = COMMANDS[name].split(), tmp_path / "out.csv"
    written = run(*words, "--csv", out)
    assert written.exit_code in (0, 1), written.output
    assert "wrote " in written.output
    first = out.read_bytes()
    printed = run(*words, "--csv", "-")
    assert (printed.exit_code, printed.stdout_bytes) == (written.exit_code, first)
    out.write_text("of another day")
    refused = run(*words, "--csv", out)
    assert (refused.exit_code, out.read_text()) == (2, "of another day")
    assert "is there already" in refused.stderr
    assert "--overwrite" in refused.stderr
    assert run(*words, "--csv", out, "--overwrite").exit_code == written.exit_code
    assert out.read_bytes() == first


def test_json_is_printed_alone_and_other_files_are_named_on_standard_error(tmp_path):
    out = tmp_path / "out.csv"
    found = run(*COMMANDS["identify"].split(), "--json", "-", "--csv", out)
    assert json.loads(found.stdout)["robot"] == "planar_2r"
    assert f"wrote {out}" in found.stderr
    assert out.is_file()
    both = run(*COMMANDS["identify"].split(), "--json", "-", "--csv", "-")
    assert both.exit_code == 2
    assert "Choose one, or give the other a name" in both.stderr


@pytest.mark.parametrize(
    ("words", "option", "name"),
    [
        ("torques ur5 --trajectory demo", "--mcap", "a.mcap"),
        ("simulate planar_2r --duration 0.05", "--npz", "a.npz"),
        ("sensor identify demo", "--save", "a.json"),
        (COMMANDS["identify"], "--out", "a.urdf"),
        ("doctor ur5", "--json", "a.json"),
    ],
)
def test_other_data_are_not_replaced_either(words, option, name, tmp_path):
    path = tmp_path / name
    path.write_text("before")
    refused = run(*words.split(), option, path)
    assert (refused.exit_code, path.read_text()) == (2, "before")
    assert "is there already" in refused.stderr


def test_a_robot_file_is_not_written_over_itself(tmp_path):
    """Not even where files may be replaced: what is read would be gone if writing failed."""
    path = tmp_path / "arm.urdf"
    before = tw.robots.path_of("planar_2r").read_bytes()
    path.write_bytes(before)
    refused = run("convert", path, path, "--overwrite")
    assert (refused.exit_code, path.read_bytes()) == (2, before)


def test_notes_on_standard_error_are_in_the_json_too(tmp_path):
    """On reading the log, beside those of the answer."""
    log = tmp_path / "log.csv"
    log.write_text("time,joint1\n" + "".join(f"{0.1 * k:.1f},{0.01 * k * k:.2f}\n" for k in range(20)))
    found = run("torques", "planar_2r", log, "--lock-missing", "--json", "-")
    (note,) = [line.removeprefix("note: ") for line in found.stderr.splitlines() if "held still" in line]
    assert note == "held still, as the motion has no column for them: joint2=0."
    assert note in json.loads(found.stdout)["notes"]


def test_pictures_and_pages_are_replaced(tmp_path):
    for name, option in (("a.png", "--plot"), ("a.html", "--report")):
        Path(tmp_path / name).write_text("before")
        assert run(*COMMANDS["payload"].split(), option, tmp_path / name).exit_code in (0, 1)
        assert (tmp_path / name).read_bytes() != b"before"
