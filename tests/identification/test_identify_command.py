"""The command: which files it writes when, what it takes for a log, and what it says of bad input."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from identification_logs import known_log
from ros_logs import JOINT_STATE, header, write_messages

import twistwrench as tw
from twistwrench.cli.main import main

ARM = tw.robots.planar_2r()


SETTINGS = ("--cutoff", 10, "--shift", 0)
"""Nothing to be searched for: what these tests ask does not depend on it."""


def run(*arguments):
    return CliRunner().invoke(main, ["identify", *map(str, arguments)])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for seed in (1, 2):
        known_log(ARM, seed, seconds=8.0, rate=100.0).motion.to_csv(folder / f"log{seed}.csv")
    return folder


@pytest.fixture
def logs(written, tmp_path):
    """A folder of one's own with two logs."""
    return Path(shutil.copytree(written, tmp_path / "logs"))


def test_every_file_that_is_asked_for(tmp_path):
    """Of the bundled log."""
    outs = {"--json": "a.json", "--csv": "a.csv", "--out": "a.urdf", "--out-actuators": "a.yaml", "--report": "a.html"}
    asked = [x for option, name in outs.items() for x in (option, tmp_path / name)]
    result = run("planar_2r", "demo", "--cutoff", 10, *asked)
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "a.json").read_text())
    assert {"verdict", "doubts", "base_parameters", "held_out", "settings", "parameters"} <= set(found)
    assert {"all", "joints"} <= set(found["held_out"]) and set(found["held_out"]["joints"]) == set(ARM.joint_names)
    assert all({"value", "deviation"} <= set(one) for one in found["parameters"].values())
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 1 + found["base_parameters"]
    assert '<h1><span class="strong good">OK</span>: predicts torques to 1.74 %' in (tmp_path / "a.html").read_text(
        "utf-8"
    )
    assert tw.load(tmp_path / "a.urdf").with_actuators(tmp_path / "a.yaml").nv == 2


def test_folders_and_patterns_are_the_files_in_them(logs, tmp_path):
    out = [tmp_path / "a.json", tmp_path / "b.json", tmp_path / "c.json"]
    for path, what in zip(out, ([logs], [logs / "*.csv"], [logs / "log1.csv", logs / "log2.csv"]), strict=True):
        run("planar_2r", *what, *SETTINGS, "--json", path)
    first, *others = (json.loads(path.read_text()) | {"command": None} for path in out)
    assert all(other == first for other in others)


def test_the_topic_of_a_recording_is_chosen(logs, tmp_path):
    """The log is the topic with fewer rows; the other has torques of the wrong sign."""
    m = tw.Motion.from_file(logs / "log1.csv", ARM)
    states = {"position": m.q, "velocity": m.dq, "effort": m.tau}
    topics = {}
    for topic, sign, rows in (("/arm", 1.0, 700), ("/other", -1.0, 800)):
        messages = []
        for k in range(rows):
            values = {name: (sign if name == "effort" else 1.0) * x[k] for name, x in states.items()}
            message = {name: x.tolist() for name, x in values.items()}
            messages.append((m.time[k], {"header": header(m.time[k]), "name": list(ARM.joint_names), **message}))
        topics[topic] = ("sensor_msgs/msg/JointState", JOINT_STATE, messages)
    write_messages(tmp_path / "r.mcap", topics)
    m[:700].to_csv(tmp_path / "plain.csv")
    found = {}
    for name, log in (("r", ["r.mcap", "--topic", "/arm"]), ("plain", ["plain.csv"])):
        result = run("planar_2r", tmp_path / log[0], *log[1:], *SETTINGS, "--json", tmp_path / f"{name}.json")
        assert "error" not in result.output, result.output
        found[name] = json.loads((tmp_path / f"{name}.json").read_text())["parameters"]
    for name, value in found["plain"].items():
        assert found["r"][name]["value"] == pytest.approx(value["value"], rel=1e-6, abs=1e-6)
    quality = CliRunner().invoke(main, ["log", str(tmp_path / "r.mcap"), "--topic", "/arm", "--json", "-"])
    assert json.loads(quality.stdout)[0]["rows"] == 700
    assert "is for recordings of ROS" in run("planar_2r", tmp_path / "plain.csv", "--topic", "/arm").output


@pytest.mark.parametrize("option", ["--add", "--information"])
def test_options_of_saved_normal_equations_name_the_new_way(logs, option):
    result = run("planar_2r", logs / "log1.csv", option, "week.npz")
    assert result.exit_code == 2 and "identify ROBOT day1.csv day2.csv" in " ".join(result.output.split())
    assert option not in run("--help").output


def test_look_again_writes_nothing_but_json(logs, tmp_path):
    m = tw.Motion.from_file(logs / "log1.csv", ARM)
    tw.Motion(m.time, m.q, m.dq, m.ddq, m.tau * [1, -1], robot=ARM, in_seconds=True).to_csv(logs / "turned.csv")
    out, told = tmp_path / "new.urdf", tmp_path / "found.json"
    result = run("planar_2r", logs / "turned.csv", *SETTINGS, "--out", out, "--json", told)
    assert result.exit_code == 1 and "LOOK AGAIN" in result.output
    assert told.is_file() and not out.exists()


def test_logs_of_motors(logs, tmp_path):
    """Motors with gears, one of them turned and coupled, a zero and currents: the same numbers as of the joints."""
    m = tw.Motion.from_file(logs / "log1.csv", ARM)
    R = np.array([[50.0, 0.0], [30.0, -20.0]])
    zero, gain = np.array([0.0, np.pi / 2]), np.array([0.5, 1.0])
    q = (m.q - zero) @ R.T
    tau = np.linalg.solve(R.T, m.tau.T).T / gain
    columns = np.column_stack([m.time, q, tau])
    np.savetxt(
        logs / "motors.csv", columns, delimiter=",", header="time,joint1,joint2,joint1.tau,joint2.tau", comments=""
    )
    (tmp_path / "arm.yaml").write_text(
        "actuators:\n  joint1: {ratio: 50}\n  joint2: {ratio: -20}\nlog:\n  side: motor\n  joints:\n"
        "    joint1: {gain: 0.5 N m/A}\n    joint2: {zero: 90 deg, coupled: {joint1: 30}}\n"
    )
    found = []
    for log, options in ((logs / "log1.csv", ()), (logs / "motors.csv", ("--actuators", tmp_path / "arm.yaml"))):
        path = tmp_path / f"{log.stem}.json"
        run("planar_2r", log, *SETTINGS, "--json", path, *options)
        found.append(json.loads(path.read_text()))
    assert found[1]["held_out"]["all"] < 1.5 * found[0]["held_out"]["all"]
    one, other = (f["parameters"]["link2.mcx"] for f in found)
    assert abs(one["value"] - other["value"]) < 4 * one["deviation"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["planar_2r", "none.csv"], "none.csv"),
        (["planar_2r", "demo", "--cutoff", "fast"], "neither a number"),
        (["planar_2r", "demo", "--cutoff", "-1"], "above 0"),
        (["planar_2r", "demo", "--friction-model", "sticky"], "friction column"),
        (["planar_2r", "demo", "--without", "hand"], "link that moves"),
        (["planar_2r", "demo", "--keep-close", "1e9", "--out", "x.urdf"], "not offered"),
        (["planar_2r", "demo", "--out", "no/such/folder.urdf"], "no such folder"),
        (["ur5", "ur5_log.csv"], "ur5_log.csv"),
        (["floating_box", "demo"], "floating_box"),
    ],
)
def test_bad_input_is_one_line(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2 and said in result.output
    assert len([line for line in result.output.splitlines() if line.startswith("error:")]) == 1
    assert not list(tmp_path.iterdir())


def test_a_log_without_torques_says_which_columns_are_missing(tmp_path):
    m = tw.Motion.from_file(tw.robots.path_of("planar_2r").with_name("planar_2r_demo_log.csv"), ARM)
    tw.Motion(m.time, m.q, robot=ARM).to_csv(tmp_path / "bare.csv")
    result = run("planar_2r", tmp_path / "bare.csv")
    assert result.exit_code == 2 and "joint1.tau=COLUMN" in result.output


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems count a process's memory otherwise")
def test_the_longest_log_that_is_held_whole_stays_below_500_mb(tmp_path):
    """Ninety seconds of seven joints at 1 kHz, read from CSV; longer ones are streamed."""
    import resource

    robot = tw.robots.panda()
    motion = known_log(robot, 0, seconds=89.0, rate=1000.0).motion
    tw.Motion(motion.time, motion.q, tau=motion.tau, robot=robot, in_seconds=True).to_csv(tmp_path / "log.csv")
    command = [sys.executable, "-m", "twistwrench", "identify", "panda", str(tmp_path / "log.csv")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.startswith("OK")
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss < 500 * 1024  # kB


def test_a_robot_without_a_bundled_log_is_told_those_that_have_one():
    found = CliRunner().invoke(main, ["identify", "ur5", "demo"])
    assert found.exit_code == 2
    assert "no log is bundled with 'ur5'. With: planar_2r. Give the path of a CSV file instead." in found.output


def test_an_actuator_file_of_other_joints_is_refused(logs, tmp_path):
    """It would say nothing of these joints, and its ratios would be lost."""
    file = tmp_path / "drives.yaml"
    file.write_text("actuators:\n  joint_5: {ratio: 100}\n", "utf-8")
    result = run("planar_2r", logs, *SETTINGS, "--actuators", file)
    assert result.exit_code == 2 and "no joint named 'joint_5'. Did you mean 'joint2'" in result.output


def test_thresholds_are_those_of_an_observer_of_the_identified_robot(tmp_path):
    """Option, Python and the observer give the same; the log bundled with the robot lasts long enough."""
    log = tw.robots.path_of("planar_2r").with_name("planar_2r_demo_log.csv")
    given = ("--cutoff", "10", "--shift", "0")
    result = CliRunner().invoke(
        main, ["identify", "planar_2r", "demo", *given, "--thresholds", "30", "--json", str(tmp_path / "o.json")]
    )
    assert "thresholds for 1 false alarm an hour: " in result.output, result.output
    found = tw.identify("planar_2r", log, cutoff=10.0, shift=0.0, thresholds=30.0)
    mine = json.loads((tmp_path / "o.json").read_text("utf-8"))["thresholds"]
    theirs = tw.control.MomentumObserver(found.robot, 30.0, friction=True)
    expected = theirs.threshold(tw.Motion.from_file(log, found.original)).torques
    np.testing.assert_allclose(found.thresholds.torques, expected, rtol=0.1)
    assert [one["torques"] for one in mine["thresholds"].values()] == pytest.approx(found.thresholds.torques.tolist())
