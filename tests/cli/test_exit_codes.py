"""What commands end with: a table of inputs, exit codes and the first line that is said.

0: yes or done. 1: no or not sure. 2: bad input, in one line. 70: a fault of the program, in one line. 130: interrupted.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import click
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import TRACEBACK, Commands, main
from twistwrench.core.verdict import ExitCode
from twistwrench.robots import path_of
from twistwrench.simulation.forces import System

POSIX = pytest.mark.skipif(os.name != "posix", reason="pipes and signals are POSIX's")
MASS = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
URDF = f'<robot name="r"><link name="a"/><link name="b">{MASS}</link><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'


Files = dict[str, bytes | str]
GOOD_SRDF = '<robot name="ur5"><disable_collisions link1="base_link" link2="upper_arm_link" reason="Never"/></robot>'
GOOD_LIMITS = "joint,effort\nelbow_joint,100\n"

TABLE: dict[str, tuple[str, Files, ExitCode, str]] = {
    # ── answers ──
    "a robot that is fine": ("info pendulum", {}, ExitCode.FINE, r"pendulum"),
    "a limit that is passed": ("torques ur5 --trajectory demo --payload 100", {}, ExitCode.NO, r"OVER LIMIT: shoulder_lift_joint"),
    "a pose that cannot be held": ("payload ur5 --limits l.csv", {"l.csv": "joint,effort\nshoulder_lift_joint,40\n"}, ExitCode.NO, r"OVER LIMIT: no payload. shoulder_lift_joint needs"),
    # ── usage ──
    "a table in a spreadsheet's own format": ("torques ur5 --trajectory demo --csv t.xlsx", {}, ExitCode.BAD_INPUT, r"error: --csv 't.xlsx': CSV is written, .* Name it 't.csv'"),
    "a command that is none": ("dance", {}, ExitCode.BAD_INPUT, r"error: No such command 'dance'"),
    "an option that is none": ("info ur5 --speed", {}, ExitCode.BAD_INPUT, r"error: No such option"),
    "no robot": ("info", {}, ExitCode.BAD_INPUT, r"error: Missing ROBOT: a file"),
    "a lock that is none": ("info ur5 --lock elbow", {}, ExitCode.BAD_INPUT, r"error: --lock 'elbow' is not JOINT=VALUE"),
    "a joint that is not there": ("info ur5 --lock x=1", {}, ExitCode.BAD_INPUT, r"error: .*'x'"),
    # ── robot files ──
    "no file": ("info none.urdf", {}, ExitCode.BAD_INPUT, r"error: no robot file 'none.urdf', and no bundled robot"),
    "an empty file": ("info r.urdf", {"r.urdf": ""}, ExitCode.BAD_INPUT, r"error: r.urdf: it is empty"),
    "no XML": ("info r.urdf", {"r.urdf": "hello"}, ExitCode.BAD_INPUT, r"error: r.urdf: it is not XML: it begins with 'hello'"),
    "XML cut short": ("info r.urdf", {"r.urdf": URDF[:90]}, ExitCode.BAD_INPUT, r"error: r.urdf: line 1, column \d+: it is not well-formed"),
    "no text": ("info r.urdf", {"r.urdf": b"<\xff>"}, ExitCode.BAD_INPUT, r"error: r.urdf: line 1 has a byte that is not utf-8 text"),
    "an encoding that is none": (
        "info r.urdf", {"r.urdf": f'<?xml version="1.0" encoding="undefined"?>{URDF}'}, ExitCode.BAD_INPUT,
        r"error: r.urdf: declares the encoding 'undefined', which is not known",
    ),
    "half a surrogate": (
        "info r.urdf", {"r.urdf": '<?xml version="1.0" encoding="utf-7"?><robot name="+2AA-"/>'}, ExitCode.BAD_INPUT,
        r"error: r.urdf: (it cannot be read as XML|cannot be read as utf-7 text)",
    ),
    "an entity": ("info r.urdf", {"r.urdf": '<!DOCTYPE r [<!ENTITY a "b">]><robot/>'}, ExitCode.BAD_INPUT, r"error: r.urdf: line 1: it declares the entity"),
    "a folder": ("info folder", {"folder/x.urdf": URDF}, ExitCode.BAD_INPUT, r"error: 'folder' is a folder. Pass the robot file in it: x.urdf"),
    "an endless device": ("info /dev/zero", {}, ExitCode.BAD_INPUT, r"error: cannot read '/dev/zero': it has more than 64 MiB"),
    # ── actuator files ──
    "no actuator file": ("info ur5 --actuators none.yaml", {}, ExitCode.BAD_INPUT, r"error: no actuator file 'none.yaml'"),
    "actuators that are no YAML": ("info ur5 --actuators a.yaml", {"a.yaml": "actuators: ["}, ExitCode.BAD_INPUT, r"error: a.yaml is no YAML"),
    "actuators nested deep": ("info ur5 --actuators a.yaml", {"a.yaml": "[" * 100_000}, ExitCode.BAD_INPUT, r"error: a.yaml nests its entries more than 50 deep"),
    "actuators of words": ("info ur5 --actuators a.yaml", {"a.yaml": "actuators: 5\n"}, ExitCode.BAD_INPUT, r"error: a.yaml: actuators is '5', expected entries"),
    "actuators that are not text": ("info ur5 --actuators a.yaml", {"a.yaml": b"\xff\xfe\xff"}, ExitCode.BAD_INPUT, r"error: cannot read 'a.yaml': UnicodeDecodeError"),
    # ── limits, waypoints ──
    "no limits file": ("payload ur5 --limits none.csv", {}, ExitCode.BAD_INPUT, r"error: no limits file 'none.csv'"),
    "limits that are not text": ("payload ur5 --limits l.csv", {"l.csv": b"joint,effort\n\xff"}, ExitCode.BAD_INPUT, r"error: l.csv: line 2 is not UTF-8 text\. Save it as CSV in UTF-8"),
    "limits with a cell too long": ("payload ur5 --limits l.csv", {"l.csv": "joint,effort\n" + "9" * 200_000}, ExitCode.BAD_INPUT, r"error: l.csv: line 2 has 1 values, and the header names 2 columns"),
    "limits of a joint unknown": ("payload ur5 --limits l.csv", {"l.csv": "joint,effort\nknee,1\n"}, ExitCode.BAD_INPUT, r"error: l.csv: line 2: no joint named 'knee'"),
    "waypoints that are not text": ("move ur5 --to home --waypoints w.csv", {"w.csv": b"\xff"}, ExitCode.BAD_INPUT, r"error: "),
    # ── SRDF files ──
    "no SRDF file": ("torques ur5 --trajectory demo --clearance --srdf none.srdf", {}, ExitCode.BAD_INPUT, r"error: no file 'none.srdf'"),
    "an SRDF file without --clearance": ("torques ur5 --trajectory demo --srdf s.srdf", {"s.srdf": GOOD_SRDF}, ExitCode.BAD_INPUT, r"error: --srdf leaves out pairs of links for --clearance"),
    "SRDF that is no XML": ("torques ur5 --trajectory demo --clearance --srdf s.srdf", {"s.srdf": "hello"}, ExitCode.BAD_INPUT, r"error: s.srdf: it is not XML: it begins with 'hello'"),
    "an empty SRDF file": ("torques ur5 --trajectory demo --clearance --srdf s.srdf", {"s.srdf": ""}, ExitCode.BAD_INPUT, r"error: s.srdf: it is empty"),
    "SRDF cut short": ("torques ur5 --trajectory demo --clearance --srdf s.srdf", {"s.srdf": GOOD_SRDF[:40]}, ExitCode.BAD_INPUT, r"error: s.srdf: line 1, column \d+: it is not well-formed"),
    "a URDF in place of SRDF": ("torques ur5 --trajectory demo --clearance --srdf r.urdf", {"r.urdf": URDF}, ExitCode.BAD_INPUT, r"error: r.urdf: <robot> has no <disable_collisions"),
    "SRDF of another robot": ("torques ur5 --trajectory demo --clearance --srdf s.srdf", {"s.srdf": GOOD_SRDF.replace("upper", "lower")}, ExitCode.BAD_INPUT, r"error: s.srdf: none of its 1 pairs are links of robot 'ur5'; the first is base_link – lower_arm_link"),
    "a pair of SRDF with one link": ("torques ur5 --trajectory demo --clearance --srdf s.srdf", {"s.srdf": GOOD_SRDF.replace("link2", "link")}, ExitCode.BAD_INPUT, r'error: s.srdf: .* needs the attribute link2='),
    "SRDF that is xacro": ("torques ur5 --trajectory demo --clearance --srdf s.srdf", {"s.srdf": GOOD_SRDF.replace("base", "${prefix}base")}, ExitCode.BAD_INPUT, r"error: s.srdf: .* is unexpanded xacro"),
    "a clearance that is a word": ("torques --trajectory demo --clearance ur5", {}, ExitCode.BAD_INPUT, r"error: Invalid value for '--clearance': 'ur5' is not a valid float"),
    "a clearance that is not a number": ("torques ur5 --trajectory demo --clearance nan", {}, ExitCode.BAD_INPUT, r"error: clearance is nan, and must be a number, at least 0"),
    "a clearance without motion": ("view ur5 --clearance --html v.html", {}, ExitCode.BAD_INPUT, r"error: --clearance is of a motion"),
    # ── sensors ──
    "no sensor file": ("sensor compensate demo --sensor none.json", {}, ExitCode.BAD_INPUT, r"error: no sensor file 'none.json'"),
    "a sensor nested deep": ("sensor compensate demo --sensor s.json", {"s.json": "[" * 100_000}, ExitCode.BAD_INPUT, r"error: s.json: is not a sensor file: its entries are nested too deeply"),
    "a sensor that is a list": ("sensor compensate demo --sensor s.json", {"s.json": "[1]"}, ExitCode.BAD_INPUT, r"error: s.json: is not a sensor file"),
    "readings that are not text": ("sensor identify l.csv", {"l.csv": b"\xff"}, ExitCode.BAD_INPUT, r"error: l.csv: line 1 is not UTF-8 text"),
    # ── motions ──
    "no motion file": ("torques ur5 --trajectory none.csv", {}, ExitCode.BAD_INPUT, r"error: no motion file 'none.csv'"),
    "an empty motion": ("torques ur5 --trajectory m.csv", {"m.csv": ""}, ExitCode.BAD_INPUT, r"error: m.csv"),
    "a cell that begins with a control character": ("torques pendulum --trajectory m.csv", {"m.csv": "time,joint1\n0,0\n1,\x1f1\n"}, ExitCode.BAD_INPUT, r"error: m.csv"),
    # ── files out ──
    "a file over its own input": ("payload ur5 --limits l.csv --csv l.csv", {"l.csv": GOOD_LIMITS}, ExitCode.BAD_INPUT, r"error: --csv 'l.csv' would overwrite the file of --limits"),
    "a folder that is not there": ("payload ur5 --csv none/x.csv", {}, ExitCode.BAD_INPUT, r"error: cannot write 'none/x.csv': no such folder"),
    "a kind of picture that is not made": ("payload ur5 --plot x.doc", {}, ExitCode.BAD_INPUT, r"error: cannot draw 'x.doc'"),
}  # fmt: skip


def run(arguments: list[str], **options: Any) -> Any:
    return CliRunner().invoke(main, arguments, **options)


@pytest.mark.parametrize("case", TABLE)
def test_every_input_has_its_code_and_its_line(case, tmp_path, monkeypatch):
    arguments, files, code, first = TABLE[case]
    monkeypatch.chdir(tmp_path)
    for name, content in files.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    result = run(arguments.split())
    assert result.exit_code == code, result.output
    said = (result.stderr if code == ExitCode.BAD_INPUT else result.stdout).strip().splitlines()
    assert re.match(first, said[0]), said
    if code == ExitCode.BAD_INPUT:
        assert len(said) == 1
        assert result.stdout == ""


def test_the_table_of_codes_is_that_of_the_verdicts():
    assert {code.name: int(code) for code in ExitCode} == {
        "FINE": 0, "NO": 1, "BAD_INPUT": 2, "FAULT": 70, "INTERRUPTED": 130, "PIPE_CLOSED": 141, "TERMINATED": 143,
    }  # fmt: skip


# ── faults of the program, interrupts, pipes ──


@pytest.fixture
def failing(monkeypatch):
    """Lets a command raise; returns a function that runs it."""

    def invoke(problem, **environment):
        def load(*_, **__):
            raise problem

        monkeypatch.setattr("twistwrench.cli.shared.RobotOptions.load", load)
        return run(["verify", "ur5"], env=environment)

    return invoke


@pytest.mark.parametrize("problem", [MemoryError(), OSError(28, "No space left on device"), OSError(5, "no")])
def test_what_the_system_refuses_is_2_in_one_line(failing, problem):
    result = failing(problem)
    assert (
        result.exit_code == ExitCode.BAD_INPUT and result.stderr.startswith("error:") and result.stderr.count("\n") == 1
    )


@pytest.mark.parametrize(
    "problem",
    [
        ZeroDivisionError("by\nzero"),
        KeyError("x"),
        AssertionError(),
        RecursionError("deep"),
        OSError(22, "no"),
    ],
)
def test_a_fault_of_the_program_is_70_in_one_line_that_asks_for_a_report(failing, problem):
    result = failing(problem)
    assert result.exit_code == ExitCode.FAULT
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"error: a fault of twistwrench itself, not of your input: {type(problem).__name__}")
    assert "report" in line
    assert f"{TRACEBACK}=1" in line
    assert result.stdout == ""


@pytest.mark.parametrize(("said", "shown"), [("1", True), ("yes", True), ("0", False), ("off", False), ("", False)])
def test_a_variable_shows_where_a_fault_arose(failing, said, shown):
    result = failing(ZeroDivisionError("by zero"), **{TRACEBACK: said})
    assert result.exit_code == ExitCode.FAULT
    assert ("Traceback" in result.stderr) == shown
    assert result.stderr.splitlines()[-1].startswith("error: a fault of twistwrench itself")


def test_an_interrupt_is_130_and_a_closed_pipe_no_verdict(failing):
    result = failing(KeyboardInterrupt())
    assert (result.exit_code, result.stderr) == (ExitCode.INTERRUPTED, "interrupted\n")
    assert failing(BrokenPipeError(32, "closed")).exit_code == ExitCode.PIPE_CLOSED
    assert failing(tw.ModelError("no")).exit_code == ExitCode.BAD_INPUT
    assert failing(click.UsageError("no")).exit_code == ExitCode.BAD_INPUT
    assert failing(SystemExit(7)).exit_code == 7


def test_an_interrupted_simulation_is_shown_and_ends_with_130(tmp_path, monkeypatch):
    steps = []

    def step(self, *arguments):
        steps.append(arguments)
        if len(steps) == 5:
            raise KeyboardInterrupt
        return plain(self, *arguments)

    plain = System.rates
    monkeypatch.setattr(System, "rates", step)
    path = tmp_path / "run.csv"
    result = run(["simulate", "pendulum", "--duration", "1", "--method", "midpoint", "--csv", str(path)])
    assert result.exit_code == ExitCode.INTERRUPTED, result.output
    assert "interrupted" in result.stdout
    assert result.stderr == "interrupted\n"
    assert path.read_text().startswith("# twistwrench simulation")


def test_sigterm_s_handler_is_the_callers_own_again():
    """A program that calls the command keeps what it set; one that set nothing gets the system's behaviour back."""

    @click.group(cls=Commands)
    def group():
        pass

    seen = []

    @group.command()
    def look():
        seen.append(signal.getsignal(signal.SIGTERM))

    def own(*_):
        pass

    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        assert CliRunner().invoke(group, ["look"]).exit_code == 0
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        signal.signal(signal.SIGTERM, own)
        assert CliRunner().invoke(group, ["look"]).exit_code == 0
        assert signal.getsignal(signal.SIGTERM) is own
    finally:
        signal.signal(signal.SIGTERM, before)
    assert callable(seen[0])
    assert seen[0] is not own
    assert seen[1] is own


@contextlib.contextmanager
def piped(data: bytes) -> Iterator[str]:
    """A path as a shell gives for <(command): the end of a pipe that somebody else writes to, after a while."""
    reading, writing = os.pipe()

    def write() -> None:
        time.sleep(0.1)
        with os.fdopen(writing, "wb") as file:
            file.write(data)

    thread = threading.Thread(target=write)
    thread.start()
    try:
        yield f"/dev/fd/{reading}"
    finally:
        thread.join()
        os.close(reading)


@POSIX
def test_robots_come_by_pipes_and_by_standard_input():
    """Each is read once, although with --lock the robot is built twice; the answer is that for a file of the same text."""
    path, lock = path_of("planar_2r"), ["--lock", "joint1=0.2"]
    data = path.read_bytes()
    wanted = run(["info", str(path), *lock])
    assert wanted.exit_code == 0, wanted.output
    with piped(data) as name:
        assert run(["info", name, *lock]).output == wanted.output
    assert run(["info", "-", *lock], input=data).output == wanted.output
    for text, words in (
        ("hello", "standard input is no XML: it begins with 'hello'"),
        ("", "standard input is no XML: it is empty"),
        (data.decode()[:500], "not well-formed"),
    ):
        refused = run(["info", "-"], input=text)
        assert refused.exit_code == ExitCode.BAD_INPUT
        assert words in refused.stderr
    with piped(b"") as name:
        assert "it is empty" in run(["info", name]).stderr


@POSIX
def test_a_pipe_that_nobody_writes_to_is_refused(tmp_path, monkeypatch):
    from twistwrench.core import files

    monkeypatch.setattr(files, "_OPENING_TIMEOUT", 0.1)
    os.mkfifo(tmp_path / "pipe.urdf")
    result = run(["info", str(tmp_path / "pipe.urdf")])
    assert result.exit_code == ExitCode.BAD_INPUT
    assert "it is a pipe that nobody writes to" in result.stderr


@POSIX
def test_a_reader_that_goes_away_is_no_verdict():
    """`twistwrench … | head` ends with a code that no verdict has, under a shell's pipefail too."""
    command = [sys.executable, "-m", "twistwrench", "info", "ur5"]
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=240)
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (ExitCode.PIPE_CLOSED, "")


@POSIX
def test_sigterm_is_143_and_what_is_open_is_closed():
    """128 and the number of the signal, as in shells; files of a moment are cleared away."""

    @click.group(cls=Commands)
    def group():
        pass

    closed = []

    @group.command()
    def wait():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            closed.append(True)

    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        assert CliRunner().invoke(group, ["wait"]).exit_code == 128 + signal.SIGTERM
    finally:
        signal.signal(signal.SIGTERM, before)
    assert closed == [True]


@pytest.mark.parametrize(("word", "motion"), [("ur5", "demo"), ("panda", "MOTION")])
def test_a_robot_in_place_of_a_command_is_answered_with_commands_that_run(word, motion):
    """Only the ur5 has a motion that comes with it."""
    found = CliRunner().invoke(main, [word])
    assert found.exit_code == 2
    assert f"{word} is a robot: twistwrench info {word}, twistwrench torques {word} {motion}." in found.stderr
