"""Every command opens and parses each of its input files once, whatever options name them; logs are left to their own tests."""

from __future__ import annotations

import shutil
import sys
from collections import Counter

import pytest

import twistwrench as tw
from twistwrench.formats import robot_file, xml, yaml

pytest_plugins = ("torque_fixtures",)

OPENED: list[str] = []
"""Paths of all files opened in this process while :data:`WATCHED` is not empty."""
WATCHED: list[bool] = []

_SRDF = '<robot name="ur5"><disable_collisions link1="forearm_link" link2="wrist_3_link"/></robot>'
_MOTION = ("--trajectory", "motion.csv")
_CLEARANCE = ("--clearance", "--srdf", "pairs.srdf")
_DRIVES = ("--actuators", "drives.yaml")
COMMANDS = {
    "torques": ("torques", "robot.urdf", *_MOTION, *_CLEARANCE, *_DRIVES, "--html", "out.html"),
    "torques, a joint held": ("torques", "robot.urdf", *_MOTION, *_DRIVES, "--lock", "wrist_3_joint=0"),
    "payload": ("payload", "robot.urdf", *_DRIVES),
    "move": ("move", "robot.urdf", "--to", "0,0,0,0,0,0.5", *_CLEARANCE, *_DRIVES, "--csv", "out.csv"),
    "simulate": ("simulate", "robot.urdf", "--duration", "0.1", *_CLEARANCE, *_DRIVES),
    "identify": ("identify", "arm.urdf", "log.csv", "--force", "--actuators", "arm.yaml", "--out", "out.urdf"),
    "doctor": ("doctor", "robot.urdf", "--html", "out.html", "--out", "out.urdf"),
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
    (tmp_path / "arm.yaml").write_text('actuators: {joint1: {ratio: "1", rotor: {inertia: 1 kg cm^2}}}\n')
    (tmp_path / "pairs.srdf").write_text(_SRDF)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_each_file_is_opened_and_parsed_once(folder, run, monkeypatch, words):
    parsed = []
    parse_xml, parse_yaml = xml._TreeMaker.parse, yaml._parsed
    texts = {path.read_text(): path.name for path in folder.iterdir() if path.suffix in (".urdf", ".srdf", ".yaml")}
    monkeypatch.setattr(xml._TreeMaker, "parse", lambda maker, text: (parsed.append(text), parse_xml(maker, text)))
    monkeypatch.setattr(yaml, "_parsed", lambda text, origin: (parsed.append(text), parse_yaml(text, origin))[1])
    OPENED.clear()
    WATCHED.append(True)
    try:
        code, said = run(*words)
    finally:
        WATCHED.clear()
    assert code in (0, 1), said
    inputs = {word for word in words if word in texts.values()}
    opens = Counter(name for path in OPENED for name in inputs if path in (name, str(folder / name)))
    assert opens == dict.fromkeys(inputs, 1)
    assert Counter(texts[text] for text in parsed if text in texts) == dict.fromkeys(inputs, 1)


def test_a_robot_of_another_process_parses_its_file_once_when_it_is_asked(folder):
    file = robot_file.RobotFile("robot.urdf")
    assert "root" not in vars(file)
    assert file.root is file.root
    assert robot_file.file_of(tw.load("robot.urdf").model).root.tag == "robot"
