"""``tw.size_drives`` and the command ``size`` give the same answer, from a file, a motion, or arrays."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from quick import mostly_slow

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

UR5 = tw.robots.path_of("ur5")
DEMO = UR5.with_name("ur5_demo.csv")

RUNS = {
    "rated": ({"pause": 0.8, "add_masses": False}, ["--pause", "0.8", "--masses-included"]),
    "overloaded": (
        {"payload": 8, "ambient": 40, "add_masses": False},
        ["--payload", "8", "--ambient", "40", "--masses-included"],
    ),
    "chosen": ({"choose": True, "payload": "2@tool0"}, ["--choose", "--payload", "2@tool0"]),
    "hot": ({"ambient": 60, "friction": False}, ["--ambient", "60", "--no-friction"]),
    "an emergency": ({"emergency": "demo", "brake": True}, ["--emergency", "demo", "--brake"]),
}
"""Arguments of the function, and words of the command."""


@pytest.mark.parametrize("name", mostly_slow(RUNS, 3))
@words_of_the_shell()
def test_the_function_and_the_command_give_the_same_answer(name, tmp_path):
    arguments, words = RUNS[name]
    file = tmp_path / "report.json"
    result = CliRunner().invoke(main, ["size", "ur5", "demo", "--catalog", "demo", *words, "--json", str(file)])
    printed = json.loads(file.read_text("utf-8"))
    answer = tw.size_drives("ur5", "demo", "demo", **arguments)
    data = answer.to_dict()
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"]
    for key in ("verdict", "reasons", "sentences", "tables", "notes"):
        assert data[key] == printed[key], key


def test_a_path_is_sized_as_the_motion_of_its_rows():
    """The file has velocities and accelerations, so that both have the same loads."""
    robot = tw.robots.ur5()
    of_file = tw.size_drives(robot, DEMO, "demo", add_masses=False, payload=2)
    of_motion = tw.size_drives(robot, tw.Motion.from_file(DEMO, robot), "demo", add_masses=False, payload=2)
    assert of_motion.verdict == of_file.verdict
    rows, others = (one.tables["Drives at 25 degC"].to_dict() for one in (of_file, of_motion))
    assert rows["motor"] == others["motor"]
    assert rows["used"] == pytest.approx(others["used"], rel=1e-6, abs=1e-9)


def test_noise_of_a_file_is_judged_as_by_the_command(tmp_path):
    """Positions of an encoder: the file has no accelerations, and its noise is smoothed."""
    file, t = tmp_path / "log.csv", np.linspace(0, 4, 801)
    q = 0.5 * np.sin(1.5 * t) + np.random.default_rng(3).normal(0, 2e-4, len(t))
    np.savetxt(file, np.column_stack([t, q]), delimiter=",", header="time,hinge", comments="")
    servo = {"stall_torque": "30 N m", "no_load_speed": "60 rpm", "voltage": "24 V"}
    answer = tw.size_drives("pendulum", file, {"motors": {"servo": servo}})
    assert answer.report is not None
    assert answer.report.noisy
    motion = tw.Motion(t, 0.5 * np.sin(1.5 * t)[:, None], robot=tw.robots.pendulum())
    exact = tw.size_drives(tw.robots.pendulum(), motion, {"motors": {"servo": servo}})
    shares = [one.joints["hinge"].motor.rms_current for one in (answer, exact)]
    assert shares[0] == pytest.approx(shares[1], rel=0.02)


def test_a_log_that_contradicts_itself_sizes_nothing(tmp_path):
    file, t = tmp_path / "log.csv", np.linspace(0, 4, 401)
    q, wrong = np.sin(t), 3.0 * np.cos(t)
    np.savetxt(file, np.column_stack([t, q, wrong]), delimiter=",", header="time,hinge,hinge.vel", comments="")
    servo = {"stall_torque": "30 N m", "no_load_speed": "60 rpm", "voltage": "24 V"}
    answer = tw.size_drives("pendulum", file, {"motors": {"servo": servo}})
    assert answer.verdict.word == "LOOK AGAIN"
    assert not answer.joints
    assert str(answer).startswith("LOOK AGAIN")


def test_every_surface_has_the_word_and_the_sentence(tmp_path):
    answer = tw.size_drives("ur5", "demo", "demo", payload=20, add_masses=False)
    assert answer.verdict.word == "OVER LIMIT"
    assert repr(answer).startswith("<Sizing of ur5: OVER LIMIT, ")
    assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
    sentence = answer.headline.partition(": ")[2]
    page = answer.to_html(tmp_path / "report.html").read_text("utf-8")
    for text in (page, answer._repr_html_()):
        assert sentence in re.sub(r"<[^>]+>", "", text)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (("ur6", "demo", "demo"), tw.NotFoundError, "ur6"),
        (("ur5", "no_such.csv", "demo"), tw.NotFoundError, r"no_such\.csv"),
        (("ur5", np.zeros((3, 6)), "demo"), tw.ShapeError, "tw.Motion or a path"),
        (("ur5", "demo", "demo", {"payload": -1}), tw.ValueRangeError, "at least 0"),
        (("planar_2r", DEMO, "servos"), tw.TrajectoryError, "joint1"),
        (("planar_2r", DEMO, "demo"), tw.UnknownNameError, "catalogue"),
    ],
    ids=str,
)
def test_bad_input_is_one_clear_error(arguments, error, words):
    *given, options = arguments if isinstance(arguments[-1], dict) else (*arguments, {})
    with pytest.raises(error, match=words):
        tw.size_drives(*given, **options)


def test_a_motion_read_from_a_log_is_sized_as_the_log(tmp_path):
    """One question by two doors: by path and by Motion.from_file the same word, reasons and drives, with rows in doubt."""
    robot = tw.robots.ur5()
    motion = tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), robot)
    q = motion.q + 1e-4 * np.random.default_rng(0).standard_normal(motion.q.shape)
    q[340:344] = 0.0  # zeros inside
    path, header = tmp_path / "log.csv", ",".join(["time", *robot.coordinate_names])
    np.savetxt(path, np.column_stack([motion.time, q]), "%.9f", ",", header=header, comments="")
    of_path, of_motion = (
        tw.size_drives(
            robot, asked, tw.robots.path_of("ur5").with_name("ur5_demo.drives.yaml"), pause=0.8, add_masses=False
        )
        for asked in (path, tw.Motion.from_file(path, robot))
    )
    assert of_path.to_dict()["tables"] == of_motion.to_dict()["tables"]
    assert (of_path.headline, of_path.verdict) == (of_motion.headline, of_motion.verdict)
