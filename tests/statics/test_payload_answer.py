"""``tw.payload`` and the command ``payload`` give the same answer, on every surface."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell

POSE = {"shoulder_lift_joint": -0.6, "elbow_joint": 0.9}
WORDS = ["--at", "shoulder_lift_joint=-0.6", "--at", "elbow_joint=0.9"]

RUNS = {
    "a pose": ("ur5", {"at": POSE}, WORDS),
    "coordinates": ("ur5", {"at": [0, -0.6, 0.9, 0, 0, 0]}, ["--at", "0,-0.6,0.9,0,0,0"]),
    "degrees": ("ur5", {"at": {"elbow_joint": 50}, "degrees": True}, ["--degrees", "--at", "elbow_joint=50"]),
    "place": ("ur5", {"at": POSE, "com": (0, 0, 0.1)}, [*WORDS, "--com", "0,0,0.1"]),
    "tools": (
        "ur5",
        {"at": POSE, "tool": [1.2, {"forearm_link": 0.5}]},
        [*WORDS, "--tool", "1.2", "--tool", "0.5@forearm_link"],
    ),
    "too heavy a tool": ("ur5", {"at": POSE, "tool": 40}, [*WORDS, "--tool", "40"]),
    "beyond a stop": ("ur5", {"at": {"elbow_joint": 9}}, ["--at", "elbow_joint=9"]),
    "a frame": ("ur5", {"at": POSE, "frame": "forearm_link"}, [*WORDS, "--frame", "forearm_link"]),
    "without limits": ("planar_2r", {}, []),
    "map": ("panda", {"map": "rz", "samples": 500}, ["--map", "rz", "--samples", "500"]),
}
"""Robot, arguments of the function, and words of the command."""


@pytest.mark.parametrize("name", RUNS)
@words_of_the_shell()
def test_the_function_and_the_command_give_the_same_answer(name, tmp_path):
    robot, arguments, words = RUNS[name]
    file = tmp_path / "report.json"
    result = CliRunner().invoke(main, ["payload", robot, *words, "--json", str(file)])
    printed = json.loads(file.read_text("utf-8"))
    answer = tw.payload(getattr(tw.robots, robot)(), **arguments)
    data = answer.to_dict()
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"]
    for key in ("verdict", "sentences", "tables"):
        assert data[key] == printed[key], key
    assert data["notes"] == [note for note in printed["notes"] if note in data["notes"]]
    assert data["robot"] == robot


def test_the_answer_holds_the_largest_payload_of_the_pose():
    robot, q = tw.robots.ur5(), [0, -0.6, 0.9, 0, 0, 0]
    answer = tw.payload(tw.robots.path_of("ur5"), q, com=(0, 0, 0.1))
    found = tw.statics.largest_payload(robot, q, (0, 0, 0.1))
    assert answer.largest.mass == found.mass
    assert np.array_equal(answer.largest.torques, found.torques)
    assert answer.tables["Holding torques"].to_dict()["joint"] == list(found.joint_names)


def test_bars_are_as_long_as_the_shares_beside_them_up_to_the_limit(tmp_path):
    """Twelve characters are the limit, on a terminal with room for them; a joint without a limit has no share."""
    ur5, file = tw.robots.ur5(), tmp_path / "limits.csv"
    efforts = dict(zip(ur5.joint_names, [150, 150, 150, 28, 28, np.inf], strict=True))
    file.write_text("joint,effort\n" + "".join(f"{name},{effort}\n" for name, effort in efforts.items()))
    for tool in (1.2, 40):
        words = ["payload", "ur5", *WORDS, "--tool", str(tool), "--limits", str(file)]
        said = CliRunner().invoke(main, words, env={"COLUMNS": "150"}).output
        rows = re.findall(r"^ (\w+_joint) .* ([━─]{12}) +(–|\d+ %)", said, re.MULTILINE)
        answer = tw.payload(ur5, POSE, tool=tool, limits=efforts)
        assert [name for name, _, _ in rows] == list(ur5.joint_names)
        for (name, bar, text), share in zip(rows, answer.largest.share, strict=True):
            assert bar.count("━") == (min(12, round(12 * share)) if np.isfinite(efforts[name]) else 0)
            assert text == (f"{100 * share:.0f} %" if np.isfinite(efforts[name]) else "–")


def test_every_surface_has_the_word_and_the_sentence(tmp_path):
    answer = tw.payload("ur5", POSE, tool=40)
    assert answer.verdict.word == "OVER LIMIT"
    assert repr(answer) == "<PayloadReport of ur5: OVER LIMIT>"
    assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
    sentence = answer.headline.partition(": ")[2]
    page = answer.to_html(tmp_path / "report.html").read_text("utf-8")
    for text in (page, answer._repr_html_()):
        assert sentence in re.sub(r"<[^>]+>", "", text)
    assert json.loads(answer.to_json())["reasons"] == [f"{sentence.removesuffix('.')}"]


def test_reasons_of_several_kinds_are_lines_below_the_first_word():
    """A pose beyond a stop that the robot does not hold either: the first word is of the pose, the second of the load."""
    answer = tw.payload("ur5", {"elbow_joint": 9}, tool=40)
    lines = "".join(text if isinstance(text, str) else text[0] for text in next(iter(answer.blocks())).pieces)
    assert [line.partition(":")[0] for line in lines.splitlines()][:2] == ["OVER LIMIT", "OVER LIMIT"]
    assert len(answer.verdict.reasons) == 2


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"at": [1, 2]}, tw.ShapeError, r"at"),
        ({"at": {"elbow": 1}}, tw.UnknownNameError, "elbow_joint"),
        ({"at": {"elbow_joint": np.nan}}, tw.ValueRangeError, "elbow_joint"),
        ({"at": "bent"}, tw.ValueRangeError, "6 numbers"),
        ({"tool": -1}, tw.ValueRangeError, "at least 0"),
        ({"com": (0, 0)}, tw.ShapeError, "com"),
        ({"frame": "hand"}, tw.UnknownNameError, "hand"),
        ({"map": "zz"}, tw.UnknownNameError, "zz"),
        ({"samples": 100}, tw.ValueRangeError, "map='rz'"),
        ({"limits": {"elbow": 3}}, tw.UnknownNameError, "elbow_joint"),
    ],
    ids=str,
)
def test_bad_input_is_one_clear_error(arguments, error, words):
    with pytest.raises(error, match=words):
        tw.payload(tw.robots.ur5(), **arguments)
