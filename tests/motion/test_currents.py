"""Currents as torques by a gain, from the command or the actuator file, and columns that are named for one log only."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.errors import TrajectoryError, UnknownNameError
from twistwrench.motion import MotionLog

pytest_plugins = ("torque_fixtures",)
GAINS = np.array([2.0, -4.0])
DRIVES = """
motors: {m: {torque_constant: 0.2 N m/A}}
actuators: {joint1: {ratio: 10, motor: m}, joint2: {ratio: -20, motor: m}}
"""


@pytest.fixture(scope="module")
def arm():
    return tw.robots.planar_2r()


@pytest.fixture(scope="module")
def log(arm):
    t = np.arange(0, 8, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    motion = tw.Motion(t, q, robot=arm)
    noise = 0.02 * np.random.default_rng(0).normal(size=q.shape)
    return t, q, motion.torques() + noise


def written(path, log, names, *more, scale=1.0):
    """A file of time, positions, and the torques, times ``scale``, by ``names``."""
    t, q, tau = log
    columns = {"time": t, "joint1": q[:, 0], "joint2": q[:, 1], **dict(zip(names, (tau * scale).T, strict=True))}
    columns |= {name: np.ones_like(t) for name in more}
    np.savetxt(path, np.stack(list(columns.values()), axis=1), "%.12g", ",", header=",".join(columns), comments="")
    return path


NAMES = [
    ("joint1.current", "joint2.current"),
    ("joint1_current", "joint2_current"),
    ("current_1", "current_2"),
    ("joint1.torque [A]", "joint2.torque [A]"),
]


@pytest.mark.parametrize("names", NAMES)
def test_a_current_times_its_gain_is_a_torque(arm, log, tmp_path, names):
    path = written(tmp_path / "log.csv", log, names, scale=1 / GAINS)
    for gain in (dict(zip(("joint1", "joint2"), GAINS, strict=True)), {"joint1.current": 2.0, "joint2.current": -4.0}):
        found = tw.Motion.from_file(path, arm, gain=gain)
        assert np.abs(found.tau - log[2]).max() < 1e-9


def test_a_gain_of_ampere_is_scaled_to_milliampere(arm, log, tmp_path):
    path = written(tmp_path / "log.csv", log, ("joint1.tau [mA]", "joint2.tau [mA]"), scale=1000 / GAINS)
    found = tw.Motion.from_file(path, arm, gain={"joint1": 2.0, "joint2": -4.0})
    assert np.abs(found.tau - log[2]).max() < 1e-9


def test_the_gain_is_for_the_current_where_a_torque_is_logged_too(arm, log, tmp_path):
    names = ("joint1.current", "joint2.current")
    path = written(tmp_path / "log.csv", log, names, "joint1.torque", "joint2.torque", scale=1 / GAINS)
    assert np.abs(tw.Motion.from_file(path, arm).tau - 1.0).max() == 0.0
    of_file = tw.Motion.from_file(path, arm, gain={"joint1.current": 2.0, "joint2.current": -4.0})
    assert np.abs(of_file.tau - 1.0).max() == 0.0
    assert np.abs(tw.Motion.from_file(path, arm, gain={"joint1": 2.0, "joint2": -4.0}).tau - log[2]).max() < 1e-9


def test_currents_without_a_gain_are_no_torques(arm, log, tmp_path):
    path = written(tmp_path / "log.csv", log, ("joint1.current", "joint2.current"))
    found = tw.Motion.from_file(path, arm)
    assert found.tau is None
    assert "ignored: joint1.current, joint2.current" in " ".join(found.notes)
    with pytest.raises(UnknownNameError, match=r"joint \(of gain=…\) named 'elbow'"):
        tw.Motion.from_file(path, arm, gain={"elbow": 1.0})


def test_a_column_in_newton_metres_has_no_gain(arm, log, tmp_path):
    path = written(tmp_path / "log.csv", log, ("joint1.torque [Nm]", "joint2.torque [Nm]"))
    with pytest.raises(TrajectoryError, match="gain=… of joint1 is for a current, and this is a torque in Nm"):
        tw.Motion.from_file(path, arm, gain={"joint1": 2.0})
    path = written(tmp_path / "other.csv", log, ("joint1.torque [A]", "joint2.torque [A]"))
    with pytest.raises(TrajectoryError, match="currents with gain=… A, mA"):
        tw.Motion.from_file(path, arm)


def test_identify_and_torques_read_currents_by_the_option_or_the_actuator_file(arm, log, tmp_path, run):
    path = written(tmp_path / "log.csv", log, ("joint1.current", "joint2.current"), scale=1 / GAINS)
    drives = tmp_path / "drives.yaml"
    drives.write_text(DRIVES)
    said = ("--gain", "joint1=2", "--gain", "joint2=-4")
    given = ("--no-motor-inertia", "--cutoff", "10", "--shift", "0")
    outputs = [run("identify", "planar_2r", path, *given, *more)[1] for more in (said, ("--actuators", drives))]
    assert outputs[0].startswith("OK")
    assert outputs[0].splitlines()[0] == outputs[1].splitlines()[0]
    for more in (said, ("--actuators", drives, "--no-friction")):
        assert "The file's own torques" in run("torques", "planar_2r", "--trajectory", path, *more)[1]
    code, text = run("identify", "planar_2r", path, "--no-motor-inertia")
    assert code == 2
    assert "currents, JOINT.current, need --gain" in " ".join(text.split())


def test_a_gain_that_differs_from_the_actuator_file_is_refused(log, tmp_path, run):
    path = written(tmp_path / "log.csv", log, ("joint1.current", "joint2.current"), scale=1 / GAINS)
    drives = tmp_path / "drives.yaml"
    drives.write_text(DRIVES)
    code, text = run("torques", "planar_2r", "--trajectory", path, "--actuators", drives, "--gain", "joint1=2.1")
    assert code == 2
    assert "--gain joint1=2.1, and" in text
    assert "gives 2 N m/A" in " ".join(text.split())
    code, _ = run("torques", "planar_2r", "--trajectory", path, "--actuators", drives, "--gain", "joint1=2.01")
    assert code != 2


def test_the_gain_of_a_log_goes_before_the_torque_constant_of_the_motor(log, tmp_path, run):
    """A drive of 10 times 0.2 N m/A whose log says 3 N m/A: 3 is what --gain must agree with."""
    path = written(tmp_path / "log.csv", log, ("joint1.current", "joint2.current"))
    drives = tmp_path / "drives.yaml"
    drives.write_text(f"log: {{joints: {{joint1: {{gain: 3 N m/A}}}}}}{DRIVES}")
    code, text = run("torques", "planar_2r", "--trajectory", path, "--actuators", drives, "--gain", "joint1=2")
    assert code == 2
    assert "gives 3 N m/A" in " ".join(text.split())


def test_gains_below_log_are_applied_once(arm, log, tmp_path, run):
    path = written(tmp_path / "log.csv", log, ("joint1.current", "joint2.current"), scale=1 / GAINS)
    drives = tmp_path / "drives.yaml"
    drives.write_text(
        "log: {joints: {joint1: {gain: 2 N m/A}, joint2: {gain: -4 N m/A}}}\nactuators: {joint1: {ratio: 3}}\n"
    )
    code, text = run("identify", "planar_2r", path, "--no-motor-inertia", "--actuators", drives, "--gain", "joint1=2")
    assert (code, text[:2]) == (0, "OK")


# ── Columns of one log


def test_columns_of_one_log_hold_for_that_log_only(arm, log, tmp_path, run):
    t, q, tau = log
    for name, sign in (("a", 1.0), ("b", -1.0)):
        table = np.stack([t, q[:, 0], q[:, 1], sign * q[:, 1], *tau.T], axis=1)
        header = f"time,joint1,enc_{name},other,joint1.torque,joint2.torque"
        np.savetxt(tmp_path / f"{name}.csv", table, "%.12g", ",", header=header, comments="")
    columns = {"joint2": "other", "b.csv:joint2": "enc_b", f"{tmp_path / 'c.csv'}:joint2": "nothing"}
    for name in "ab":
        assert np.abs(tw.Motion.from_file(tmp_path / f"{name}.csv", arm, columns=columns).q - q).max() < 1e-9
    logs = (tmp_path / "a.csv", tmp_path / "b.csv")
    said = ("--columns", "joint2=other", "--columns", "b.csv:joint2=enc_b")
    code, text = run("identify", "planar_2r", *logs, "--no-motor-inertia", *said)
    assert (code, text[:2]) == (0, "OK")
    code, text = run("torques", "planar_2r", "--trajectory", tmp_path, *said)
    assert "failed" not in text
    code, text = run("identify", "planar_2r", *logs, "--columns", "c.csv:joint2=enc_b")
    assert code == 2
    assert "there is no log 'c.csv'" in " ".join(text.split())


def test_a_name_with_a_colon_is_a_joint_before_it_is_a_log(tmp_path):
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"
      ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="ns:j" type="continuous"><parent link="a"/><child link="b"/>
      <axis xyz="0 0 1"/></joint></robot>"""
    path = tmp_path / "log.csv"
    path.write_text("time,x,y\n0,1,2\n0.1,1,2\n")
    model = tw.load(text).model
    for columns, value in (({"ns:j": "x"}, 1.0), ({"ns:j": "x", "log.csv:ns:j": "y"}, 2.0)):
        log = MotionLog.open(path, model, columns=columns)
        assert log.motion(log.table).q[0, 0] == value
