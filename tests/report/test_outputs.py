"""Files out: what is refused before anything runs, and that nothing half-written is ever found."""

from __future__ import annotations

import contextlib
import csv
import html
import io
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import ValueRangeError
from twistwrench.core import files
from twistwrench.core.files import check_outputs, picture_path, replacing
from twistwrench.core.tables import CsvWriter, csv_table, harmless_text, unescape_cell
from twistwrench.motion.motion_log import MotionLog

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


@pytest.mark.parametrize(
    ("given", "found"),
    [("a.png", "a.png"), ("a.PDF", "a.PDF"), ("a.svg", "a.svg"), ("a", "a.png"), ("b.d/a", "b.d/a.png")],
)
def test_pictures_have_a_suffix_that_says_their_kind(given, found):
    assert picture_path(given) == found
    assert picture_path(Path(given)) == found


@pytest.mark.parametrize("name", ["a.jpg", "a.csv", "a.tar.gz", "a.1"])
def test_other_kinds_are_refused_with_those_there_are(name):
    with pytest.raises(ValueRangeError, match=r"pictures of kind .* Choose one of \.png, \.pdf, \.svg"):
        picture_path(name)


def test_outputs_in_their_own_places_are_fine(tmp_path):
    (tmp_path / "in.csv").write_text("x")
    (tmp_path / "old.csv").write_text("x")
    check_outputs({"--csv": tmp_path / "old.csv", "--plot": tmp_path / "new.png", "--save": None}, {"LOG": None})
    check_outputs({"--csv": str(tmp_path / "new.csv")}, {"LOG": tmp_path / "in.csv", "--limits": tmp_path / "gone"})
    assert {p.name for p in tmp_path.iterdir()} == {"in.csv", "old.csv"}  # looking leaves no trace


def test_an_output_that_is_an_input_or_another_output_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log, link, hard = tmp_path / "log.csv", tmp_path / "link.csv", tmp_path / "hard.csv"
    log.write_text("x")
    link.symlink_to(log)
    hard.hardlink_to(log)
    (tmp_path / "sub").mkdir()
    for name in (log, link, hard, "log.csv", "sub/../log.csv"):
        with pytest.raises(ValueRangeError, match=r"--csv .* would overwrite the file of LOG"):
            check_outputs({"--csv": name}, {"LOG": log})
    with pytest.raises(ValueRangeError, match=r"--plot .* would overwrite the file of --csv"):
        check_outputs({"--csv": "new", "--plot": tmp_path / "new"}, {})
    assert log.read_text() == "x"


def test_devices_may_be_shared():
    check_outputs({"--csv": os.devnull, "--plot": os.devnull}, {"LOG": os.devnull})


def test_places_that_cannot_be_written_are_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    circle = tmp_path / "circle"
    circle.symlink_to(circle)
    for name, words in (
        (tmp_path, "it is a folder"),
        (tmp_path / "no" / "where.csv", "no such folder"),
        (tmp_path / "file" / "where.csv", "no such folder|Not a directory"),
        (tmp_path / ("x" * 300), "too long"),
        (circle / "a.csv", "no such folder|[Ll]oop|symbolic links"),
    ):
        with pytest.raises(ValueRangeError, match=f"cannot write .*({words})"):
            check_outputs({"--csv": name}, {})


def test_protected_files_and_folders_are_refused(tmp_path, monkeypatch):
    """Rights are asked of the system; a superuser has them all, so the system is stood in for."""
    (tmp_path / "old.csv").write_text("x")
    denied = []
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) not in denied)
    denied[:] = [tmp_path / "old.csv"]
    with pytest.raises(ValueRangeError, match="write-protected"):
        check_outputs({"--csv": tmp_path / "old.csv"}, {})
    check_outputs({"--csv": tmp_path / "new.csv"}, {})
    denied[:] = [tmp_path]
    for name in ("old.csv", "new.csv"):
        with pytest.raises(ValueRangeError, match="the folder is not writable"):
            check_outputs({"--csv": tmp_path / name}, {})


def test_what_was_there_stays_until_the_new_is_whole(tmp_path):
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(RuntimeError, match="halfway"), replacing(path) as scratch:
        scratch.write_text("ne")
        assert path.read_text() == "old"
        raise RuntimeError("halfway")
    assert path.read_text() == "old"
    with replacing(path) as scratch:
        scratch.write_text("new")
    assert path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]


def test_a_link_stays_a_link_and_its_file_is_replaced(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with replacing(tmp_path / "link") as scratch:
        scratch.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_replacing_reports_what_cannot_be_written(tmp_path):
    for path in (tmp_path, tmp_path / "no" / "where.csv"):
        with pytest.raises(ValueRangeError, match="cannot write"), replacing(path):
            pass


# ── modes, owners and what is left behind ──

POSIX = pytest.mark.skipif(os.name != "posix", reason="modes and signals are POSIX's")


@contextlib.contextmanager
def masked(mask):
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


@POSIX
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o444])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "out.csv"
    path.write_text("old")
    path.chmod(mode)
    with masked(0o022), replacing(path) as scratch:
        assert stat.S_IMODE(scratch.stat().st_mode) == 0o600  # private until it stands in its place
        scratch.write_text("new")
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


@POSIX
@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_gets_the_mode_of_new_files(tmp_path, mask, mode):
    with masked(mask), replacing(tmp_path / "new.csv") as scratch:
        scratch.write_text("new")
    assert stat.S_IMODE((tmp_path / "new.csv").stat().st_mode) == mode


@POSIX
def test_the_umask_is_never_set(tmp_path, monkeypatch):
    """It belongs to the process: a file that another thread makes while it is 0 is open to everybody."""
    (tmp_path / "old.csv").write_text("old")
    asked = []
    monkeypatch.setattr(os, "umask", lambda mask: asked.append(mask) or 0)
    for name in ("old.csv", "new.csv"):
        with replacing(tmp_path / name) as scratch:
            scratch.write_text("x")
    assert asked == []


@POSIX
def test_owner_and_group_are_kept_where_the_system_allows_it(tmp_path, monkeypatch):
    path = tmp_path / "out.csv"
    path.write_text("old")
    path.chmod(0o664)
    wanted = []
    monkeypatch.setattr(os, "chown", lambda _path, user, group: wanted.append((user, group)))
    with replacing(path) as scratch:
        scratch.write_text("new")
    assert wanted == [(path.stat().st_uid, -1), (-1, path.stat().st_gid)]

    def refused(*_):
        raise PermissionError(1, "not yours")

    class Elsewhere:
        """The file as it would be if another group owned it."""

        def __init__(self, about):
            self.st_mode, self.st_uid, self.st_gid = about.st_mode, about.st_uid, about.st_gid + 1

    monkeypatch.setattr(os, "chown", refused)
    scratch = tmp_path / "scratch"
    scratch.write_text("new")
    files._keep_owner_and_mode(scratch, Elsewhere(path.stat()))
    assert stat.S_IMODE(scratch.stat().st_mode) == 0o644  # the group that has it now may do no more than all may


def test_long_names_are_written(tmp_path):
    path = tmp_path / ("x" * 251 + ".csv")
    with replacing(path) as scratch:
        scratch.write_text("new")
    assert path.read_text() == "new"


WRITER = """
import sys
from twistwrench.cli.main import main
from twistwrench.core.files import replacing

@main.command()
def wait():
    with replacing(sys.argv[2]) as scratch:
        scratch.write_text("half")
        print("ready", flush=True)
        import time
        for _ in range(6000):  # a signal just before a sleep is taken after it
            time.sleep(0.01)

sys.argv[1:2] = ["wait"]
main(args=["wait"])
"""


@POSIX
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_nothing_is_left_behind_by_a_command_that_is_told_to_end(tmp_path, number, code):
    path = tmp_path / "out.csv"
    path.write_text("old")
    command = subprocess.Popen(
        [sys.executable, "-c", WRITER, "wait", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs tests in the background ignores SIGINT, and its children with it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert command.stdout.readline() == "ready\n"
    assert len(list(tmp_path.iterdir())) == 2
    command.send_signal(number)
    _, said = command.communicate(timeout=60)
    assert command.returncode == code, said
    assert "Traceback" not in said
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]
    assert path.read_text() == "old"


# ── CSV ──

HOSTILE = [
    "a,b",
    'a"b',
    "a\nb",
    "=cmd|' /C calc'!A0",
    "+1",
    "-x",
    "@sum",
    "\tx",
    "\rx",
    "'=x",
    "''",
    "'",
    "plain",
    "ü",
    "＝x",
    "",
]


def test_a_name_comes_back_from_csv_as_it_was_and_no_spreadsheet_runs_it():
    file = io.BytesIO()
    CsvWriter(file).row(HOSTILE)
    (cells,) = csv.reader(io.StringIO(file.getvalue().decode(), newline=""))
    assert list(map(unescape_cell, cells)) == HOSTILE
    assert not [cell for cell in cells if cell[:1] in "=+-@\t\r\n" and cell]
    assert [harmless_text(n) for n in ("plain", "elbow-1", "a=b", "'")] == ["plain", "elbow-1", "a=b", "'"]


def test_numbers_come_back_to_the_last_bit_and_stay_numbers():
    numbers = np.array([[-1.0, 1e-300, 0.1 + 0.2], [np.pi, -0.0, 1e22]])
    file = io.BytesIO()
    CsvWriter(file).numbers(numbers)
    np.testing.assert_array_equal(np.loadtxt(io.BytesIO(file.getvalue()), delimiter=","), numbers)
    row = io.BytesIO()
    CsvWriter(row).row(["x", -0.1, None, 3])
    assert row.getvalue() == b"x,-0.1,,3.0\n"


NAMES = ["a,b", "=1+1", 'say "x"\nand y']


def arm(names=NAMES):
    """Joints whose names a spreadsheet would split or run."""
    links = "".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        "</link>"
        for k in range(len(names) + 1)
    )
    joints = "".join(
        f'<joint name="{html.escape(name).replace(chr(10), "&#10;")}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
        for k, name in enumerate(names)
    )
    return tw.load(f'<robot name="arm">{links}{joints}</robot>')


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return [[unescape_cell(cell) for cell in row] for row in csv.reader(file) if not row[0].startswith("# ")]


def test_every_csv_file_quotes_names_and_makes_them_harmless(tmp_path):
    """The five writers of CSV: motions, simulations, torques, payloads, logs of sensors."""
    robot = arm()
    velocities = [f"{n}.vel" for n in NAMES]
    moving = tw.trajectories.move(robot, np.zeros(3), np.ones(3))
    assert rows_of(moving.to_csv(tmp_path / "motion.csv"))[0][:7] == ["time", *NAMES, *velocities]
    result = robot.simulate(np.zeros(3), duration=0.01, dt=1e-3)
    path = result.to_csv(tmp_path / "simulation.csv")
    with open(path, encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file.readlines()[2:]))
    assert list(map(unescape_cell, lines[0][:7])) == ["time", *NAMES, *velocities]
    back = tw.simulation.SimulationResult.load(path)
    assert back.coordinate_names == tuple(NAMES)
    np.testing.assert_array_equal(back.q, result.q)
    with csv_table(tmp_path / "table.csv", ["time", *(f"{n}.torque" for n in NAMES)]) as table:
        table.numbers(np.ones((2, 4)))
    assert rows_of(tmp_path / "table.csv")[0] == ["time", *(f"{n}.torque" for n in NAMES)]
    tw.payload(robot, frame="l3").to_csv(tmp_path / "payload.csv")
    assert [row[0] for row in rows_of(tmp_path / "payload.csv")] == ["joint", *NAMES]
    for path in tmp_path.iterdir():
        assert "\n=1+1" not in path.read_text()
        assert ",=1+1" not in path.read_text()


def test_a_motion_of_joints_with_such_names_is_read_back(tmp_path):
    """To the last bit; names over two lines too, those in quotes or blanks, and those that other columns have."""
    robot = arm([*NAMES, 'say "x" now', "'=x", '"x"', " x ", "time", "t", "a\r\nb"])
    moving = tw.trajectories.move(robot, np.zeros(robot.nq), np.ones(robot.nq))
    motion = MotionLog.open(moving.to_csv(tmp_path / "motion.csv", 0.01), robot.model)
    read, sampled = motion.motion(motion.table), moving.sample(0.01)
    for name in ("time", "q", "dq", "ddq"):
        np.testing.assert_array_equal(getattr(read, name), getattr(sampled, name))


@pytest.mark.parametrize("kind", ["csv", "npz"])
def test_a_simulation_of_joints_with_such_names_is_read_back(tmp_path, kind):
    """As a simulation, and as a motion."""
    robot = arm([*NAMES, "time", "t", "a\r\nb"])
    result = robot.simulate(duration=0.02, dt=2e-3)
    path = getattr(result, f"to_{kind}")(tmp_path / f"a.{kind}")
    back = tw.simulation.SimulationResult.load(path)
    assert back.coordinate_names == robot.coordinate_names
    np.testing.assert_array_equal(back.q, result.q)
    motion = MotionLog.open(path, robot.model)
    read = motion.motion(motion.table)
    np.testing.assert_array_equal(read.time, result.times)
    np.testing.assert_array_equal(read.q, result.q)
    np.testing.assert_array_equal(read.tau, result.tau)
