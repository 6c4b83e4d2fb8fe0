"""The report of ``verify`` as an answer."""

import json
import re
from dataclasses import replace

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main


@pytest.mark.parametrize("robot", ["planar_2r", "pendulum", "ur5"])
def test_the_function_and_the_command_give_the_same_answer(robot, tmp_path):
    path = tmp_path / "answer.json"
    result = CliRunner().invoke(main, ["verify", robot, "--json", str(path)])
    printed = json.loads(path.read_text("utf-8"))
    answer = tw.verify(tw.load(robot))
    assert answer.verdict.exit_code == result.exit_code == printed["exit_code"] == 0
    for key in ("verdict", "reasons", "sentences", "tables"):
        assert answer.to_dict()[key] == printed[key], key
    assert re.sub(r"\s+", " ", result.output).startswith(answer.headline)
    assert len(str(answer).splitlines()) <= 45


def test_a_check_that_disagrees_is_a_reason_to_look_again():
    answer = tw.verify(tw.robots.planar_2r(), states=1)
    wrong = replace(answer, checks=(replace(answer.checks[0], residual=1.0), *answer.checks[1:]))
    assert wrong.verdict.word == "LOOK AGAIN" and wrong.verdict.exit_code == 1
    assert wrong.headline == f"LOOK AGAIN: checks that disagree: {answer.checks[0].name}."
    assert not wrong.passed
