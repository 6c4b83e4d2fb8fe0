"""Every command opens and parses each of its input files once, whatever options name them; a long log twice: its head, its rows."""

from __future__ import annotations

import gzip
import shutil
import sys
from collections import Counter

import numpy as np
import pytest
from scipy.io import savemat

import twistwrench as tw
from twistwrench.formats import robot_file, xml, yaml

pytest_plugins = ("torque_fixtures",)

OPENED: list[str] = []
"""Paths of all files opened in this process while :data:`WATCHED` is not empty."""
WATCHED: list[bool] = []

_SRDF = '<robot name="ur5"><disable_collisions link1="forearm_link" link2="wrist_3_link"/></robot>'
_MOTION = ("--trajectory", "motion.csv")
_CLEARANCE = ("--clearance", "--srdf", "pairs.srdf")
_SETTINGS = ("--cutoff", "8", "--shift", "0")
_DRIVES = ("--actuators", "drives.yaml")
COMMANDS = {
    "torques": ("torques", "robot.urdf", *_MOTION, *_CLEARANCE, *_DRIVES),
    "torques, a joint held": ("torques", "robot.urdf", *_MOTION, *_DRIVES, "--lock", "wrist_3_joint=0"),
    "payload": ("payload", "robot.urdf", *_DRIVES),
    "move": ("move", "robot.urdf", "--to", "0,0,0,0,0,0.5", *_CLEARANCE, *_DRIVES, "--csv", "out.csv"),
    "simulate": ("simulate", "robot.urdf", "--duration", "0.01", *_CLEARANCE, *_DRIVES),
    "identify": (
        "identify",
        "arm.urdf",
        "log.csv",
        "--force",
        "--actuators",
        "arm.yaml",
        *_SETTINGS,
        "--out",
        "out.urdf",
    ),
    "doctor": ("doctor", "robot.urdf", "--out", "out.urdf"),
    "view": ("view", "robot.urdf", *_MOTION, *_CLEARANCE, *_DRIVES, "--html", "out.html"),
}


@pytest.fixture(scope="module", autouse=True)
def hook():
    """Hooks cannot be taken off again: this one does nothing while no test watches."""
    sys.addaudithook(lambda event, args: OPENED.append(str(args[0])) if WATCHED and event == "open" else None)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    bundled = tw.robots.path_of("ur5").parent
    names = {"robot.urdf": "ur5.urdf", "motion.csv": "ur5_demo.csv", "drives.yaml": "ur5_demo.yaml"}
    names |= {"arm.urdf": "planar_2r.urdf", "log.csv": "planar_2r_demo_log.csv"}
    for name, source in names.items():
        shutil.copy(bundled / source, tmp_path / name)
    rows = (tmp_path / "motion.csv").read_text().splitlines(keepends=True)
    (tmp_path / "motion.csv").write_text("".join(rows[:100]))
    (tmp_path / "arm.yaml").write_text('actuators: {joint1: {ratio: "1", rotor: {inertia: 1 kg cm^2}}}\n')
    (tmp_path / "pairs.srdf").write_text(_SRDF)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def watched(run, words):
    """Exit code and output of a command, and the paths that it opened."""
    OPENED.clear()
    WATCHED.append(True)
    try:
        code, said = run(*words)
    finally:
        WATCHED.clear()
    return code, said, [*OPENED]


def times_opened(opened, folder, names):
    """Number of times that each of these files of the folder was opened."""
    return Counter(name for path in opened for name in names if path in (name, str(folder / name)))


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_each_file_is_opened_and_parsed_once(folder, run, monkeypatch, words):
    parsed = []
    parse_xml, parse_yaml = xml._TreeMaker.parse, yaml._parse
    texts = {path.read_text(): path.name for path in folder.iterdir() if path.suffix in (".urdf", ".srdf", ".yaml")}
    monkeypatch.setattr(xml._TreeMaker, "parse", lambda maker, text: (parsed.append(text), parse_xml(maker, text)))
    monkeypatch.setattr(yaml, "_parse", lambda text, origin: (parsed.append(text), parse_yaml(text, origin))[1])
    code, said, opened = watched(run, words)
    assert code in (0, 1), said
    inputs = {word for word in words if word in texts.values()}
    assert times_opened(opened, folder, inputs) == dict.fromkeys(inputs, 1)
    assert Counter(texts[text] for text in parsed if text in texts) == dict.fromkeys(inputs, 1)


def test_a_robot_of_another_process_parses_its_file_once_when_it_is_asked(folder):
    file = robot_file.RobotFile("robot.urdf")
    assert "root" not in vars(file)
    assert file.root is file.root
    assert robot_file.file_of(tw.load("robot.urdf").model).root.tag == "robot"


LOGS = {
    "motion.csv": 1,
    "motion.npz": 1,
    "motion.mat": 1,
    "motion.npy": 1,
    "motion.csv.gz": 2,
    "long.csv": 2,
    "long.npz": 4,
}
"""Most times that a log is opened. A long archive has its kind, its arrays, its time and its rows at distant places."""
LOG_COMMANDS = {
    "torques": ("torques", "robot.urdf", "--trajectory", "motion.csv", "--clearance"),
    "torques of two files": ("torques", "robot.urdf", "--trajectory", "motion.csv+late.csv"),
    "log": ("log", "motion.csv"),
    "size": ("size", "ur5", "motion.csv", "--catalog", "demo"),
    "view": ("view", "robot.urdf", "--trajectory", "motion.csv", "--html", "out.html"),
    "identify": ("identify", "arm.urdf", "log.csv", "--force"),
}


@pytest.fixture
def logs(folder):
    motion = tw.Motion.from_file("motion.csv", robot=tw.robots.ur5())
    columns = {name: motion.q[:, k] for k, name in enumerate(motion.robot.joint_names)} | {"time": motion.time}
    np.savez("motion.npz", **columns)
    savemat("motion.mat", columns)
    np.save("motion.npy", np.rec.fromarrays([*columns.values()], names=[*columns]))
    (folder / "motion.csv.gz").write_bytes(gzip.compress((folder / "motion.csv").read_bytes()))
    time = np.linspace(0.0, 20.0, 20_001)
    long = {name: 0.3 * np.sin(time + k) for k, name in enumerate(motion.robot.joint_names)} | {"time": time}
    np.savez("long.npz", **long)
    header = ",".join(long)
    np.savetxt("long.csv", np.column_stack([*long.values()]), delimiter=",", header=header, comments="")
    (folder / "late.csv").write_text("time,tool\n0,1\n20,1\n")
    return folder


@pytest.mark.parametrize(("name", "most"), LOGS.items())
def test_a_short_log_is_opened_once_and_a_long_one_for_its_head_and_its_rows(logs, run, name, most):
    code, said, opened = watched(run, ("torques", "robot.urdf", "--trajectory", name))
    assert code in (0, 1), said
    assert 1 <= times_opened(opened, logs, [name])[name] <= most


@pytest.mark.parametrize("words", LOG_COMMANDS.values(), ids=LOG_COMMANDS)
def test_every_command_opens_its_log_once(logs, run, words):
    code, said, opened = watched(run, words)
    assert code in (0, 1), said
    names = [name for word in words for name in word.split("+") if name in ("motion.csv", "late.csv", "log.csv")]
    assert times_opened(opened, logs, names) == dict.fromkeys(names, 1)


def test_rows_of_a_long_log_are_those_of_its_parts(logs):
    """Rows on both sides of the bytes that were read with the header are read once and whole."""
    text = (logs / "long.csv").read_text().splitlines(keepends=True)
    whole = tw.Motion.from_file("long.csv", robot=tw.robots.ur5())
    assert (logs / "long.csv").stat().st_size > 2 << 19
    for k, part in enumerate((text[1:5000], text[5000:])):
        (logs / f"part{k}.csv").write_text("".join([text[0], *part]))
    parts = [tw.Motion.from_file(f"part{k}.csv", robot=tw.robots.ur5()) for k in range(2)]
    np.testing.assert_array_equal(np.concatenate([part.q for part in parts]), whole.q)
