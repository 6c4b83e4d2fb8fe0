"""``tw.move`` and the command ``move`` give the same answer, on every surface."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell

START, END = [0, -1.2, 1.5, -0.3, 1.5, 0], [1.2, -0.8, 1.1, -0.9, 1.2, 1]
WORDS = ["--from=0,-1.2,1.5,-0.3,1.5,0", "--to", "1.2,-0.8,1.1,-0.9,1.2,1"]

RUNS = {
    "joints": ("ur5", {"to": END, "start": START}, WORDS),
    "fastest": (
        "ur5",
        {"to": END, "start": START, "fastest": True, "payload": 3},
        [*WORDS, "--fastest", "--payload", "3"],
    ),
    "a joint": ("ur5", {"to": {"elbow_joint": 1.0}}, ["--to", "elbow_joint=1"]),
    "degrees": ("ur5", {"to": {"elbow_joint": 50}, "degrees": True}, ["--degrees", "--to", "elbow_joint=50"]),
    "a line": ("ur5", {"to": END, "start": START, "path": "line"}, [*WORDS, "--path", "line"]),
    "a screw": ("ur5", {"to": END, "start": START, "path": "screw"}, [*WORDS, "--path", "screw"]),
    "by a vector": ("ur5", {"start": START, "by": [0.05, 0.1, -0.1]}, [WORDS[0], "--by", "0.05,0.1,-0.1"]),
    "out of reach": ("ur5", {"start": START, "by": [2, 0, 0]}, [WORDS[0], "--by", "2,0,0"]),
    "too heavy": ("ur5", {"to": END, "start": START, "payload": 40}, [*WORDS, "--payload", "40"]),
    "too fast": ("ur5", {"to": END, "start": START, "duration": 0.1}, [*WORDS, "--duration", "0.1"]),
    "clearance": ("ur5", {"to": END, "start": START, "clearance": 0.01}, [*WORDS, "--clearance", "0.01"]),
    "acceleration": (
        "planar_2r",
        {"to": [1, 0.5], "acceleration": 2, "scaling": "cubic"},
        ["--to", "1,0.5", "--acceleration", "2", "--scaling", "cubic"],
    ),
    "grams": ("ur5", {"to": END, "start": START, "payload": 3000}, [*WORDS, "--payload", "3000"]),
}
"""Robot, arguments of the function, and words of the command."""


@pytest.mark.parametrize("name", RUNS)
@words_of_the_shell()
def test_the_function_and_the_command_give_the_same_answer(name, tmp_path):
    robot, arguments, words = RUNS[name]
    file = tmp_path / "report.json"
    result = CliRunner().invoke(main, ["move", robot, *words, "--json", str(file)])
    printed = json.loads(file.read_text("utf-8"))
    answer = tw.move(robot, **arguments)
    data = answer.to_dict()
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"]
    for key in ("verdict", "reasons", "sentences", "tables", "notes"):
        assert data[key] == printed[key], key


def test_the_trajectory_is_that_of_the_rooms_below_and_keeps_its_limits():
    robot = tw.robots.ur5()
    answer = tw.move(robot, np.array(END), start=np.array(START), payload=3)
    loaded = robot.with_payload(tw.SpatialInertia.from_com(3.0))
    by_parts = tw.trajectories.move(loaded, START, END)
    assert answer.trajectory.duration == by_parts.duration
    assert answer.verdict.ok
    assert answer.motion.violations() == ()
    assert np.allclose(answer.motion.q[[0, -1]], [START, END])
    assert tw.check(robot, answer, payload=3, friction=False).verdict.ok


def test_joints_that_the_end_does_not_name_stay_where_the_move_starts():
    answer = tw.move("ur5", {"elbow_joint": 1.0}, start=START)
    np.testing.assert_allclose(answer.motion.q[-1], [*START[:2], 1.0, *START[3:]], atol=1e-12)


def test_a_limit_of_acceleration_is_one_of_braking_too():
    """The fastest move between rest and rest speeds up and brakes with all that it may, whatever the robot's own limits are."""
    limits = replace(tw.robots.planar_2r().limits, acceleration=np.full(2, 8.0), deceleration=np.full(2, 9.0))
    ddq = tw.move("planar_2r", [1, 0.5], fastest=True, acceleration=2, limits=limits).motion.ddq
    assert ddq.max() == pytest.approx(2.0, rel=1e-3)
    assert ddq.min() == pytest.approx(-2.0, rel=1e-3)


def test_waypoints_of_a_file_and_of_an_array_are_the_same(tmp_path):
    file = tmp_path / "w.csv"
    file.write_text("joint2,joint1\n0.5,-0.2\n-0.1,0.7\n")
    given = {"to": [1, 1], "acceleration": 5, "limits": {"joint1": 60, "joint2": 60}}
    of_file, of_array = (tw.move("planar_2r", waypoints=w, **given) for w in (file, [[-0.2, 0.5], [0.7, -0.1]]))
    assert np.array_equal(of_file.motion.q, of_array.motion.q)


def test_several_exceeded_limits_are_lines_of_one_headline():
    answer = tw.move("ur5", END, start=START, duration=0.1)
    assert len(answer.verdict.reasons) > 2
    first, *others = "".join(p if isinstance(p, str) else p[0] for p in next(iter(answer.blocks())).pieces).splitlines()
    assert first == f"OVER LIMIT: {answer.verdict.reasons[0]}."
    assert others[0] == f"OVER LIMIT: {answer.verdict.reasons[1]}."


def test_every_surface_has_the_word_and_the_sentence(tmp_path):
    answer = tw.move("ur5", END, start=START, duration=0.1)
    assert answer.verdict.word == "OVER LIMIT"
    assert repr(answer) == "<MoveReport of ur5: OVER LIMIT, 0.1 s>"
    assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
    sentence = answer.headline.partition(": ")[2]
    page = answer.to_html(tmp_path / "report.html").read_text("utf-8")
    for text in (page, answer._repr_html_()):
        assert sentence in re.sub(r"<[^>]+>", "", text)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({}, tw.ValueRangeError, "where does it end"),
        ({"to": [1, 2]}, tw.ShapeError, "to"),
        ({"to": END, "by": [0, 0, 1]}, tw.ValueRangeError, "to=… and by=…"),
        ({"by": [0, 0, 0.1], "path": "screw"}, tw.ValueRangeError, "straight line"),
        ({"to": END, "path": "circle"}, tw.ValueRangeError, "'joint', 'line' or 'screw'"),
        ({"to": END, "fastest": True, "duration": 1}, tw.ValueRangeError, "computes the duration"),
        ({"to": END, "path": "line", "waypoints": [START]}, tw.ValueRangeError, "waypoints"),
        ({"to": END, "srdf": "a.srdf"}, tw.ValueRangeError, "clearance"),
        ({"to": END, "payload": -1}, tw.ValueRangeError, "at least 0"),
        ({"to": {"elbow": 1}}, tw.UnknownNameError, "elbow_joint"),
        ({"to": END, "scaling": "linear"}, tw.ValueRangeError, "quintic"),
    ],
    ids=str,
)
def test_bad_input_is_one_clear_error(arguments, error, words):
    with pytest.raises(error, match=words):
        tw.move("ur5", **arguments)
