"""The result of a simulation as an answer: the command's verdict, text, data and page."""

import html
import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell

RUNS = {
    "fall": ("ur5", {"duration": 0.2}, ["--duration", "0.2"], "DONE"),
    "torque": (
        "ur5",
        {"duration": 0.2, "tau": [0, 0, 300, 0, 0, 0]},
        ["--duration", "0.2", "--torque", "elbow_joint=300"],
        "OVER LIMIT",
    ),
    "stopped": (
        "ur5",
        {"duration": 2.0, "limits": "stop"},
        ["--duration", "2", "--stop-at-limits"],
        "STOPPED",
    ),
    "swing": (
        "planar_2r",
        {"q0": [0.5, 0], "duration": 0.1},
        ["--at", "joint1=0.5", "--duration", "0.1"],
        "DONE",
    ),
}
"""Robot, arguments of the method, words of the command, and the verdict."""


@pytest.mark.parametrize("name", RUNS)
@words_of_the_shell()
def test_the_method_and_the_command_give_the_same_answer(name, tmp_path):
    robot, arguments, words, verdict = RUNS[name]
    path = tmp_path / "answer.json"
    result = CliRunner().invoke(main, ["simulate", robot, *words, "--no-friction", "--json", str(path)])
    printed = json.loads(path.read_text("utf-8"))
    answer = tw.load(robot).simulate(**arguments)
    data = answer.to_dict()
    assert answer.verdict.word == verdict
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"]
    for key in ("verdict", "reasons", "facts", "sentences", "tables", "notes"):
        assert data[key] == printed[key], key
    assert re.sub(r"\s+", " ", result.output).startswith(answer.headline)
    assert len(str(answer).splitlines()) <= 45


def test_every_surface_has_the_word_and_the_sentence(tmp_path):
    answer = tw.robots.ur5().simulate(duration=0.1, tau=np.full(6, 400.0))
    sentence = answer.headline.partition(": ")[2]
    assert answer.headline.startswith("OVER LIMIT: ")
    assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
    for text in (answer.to_html(tmp_path / "page.html").read_text("utf-8"), answer._repr_html_()):
        assert sentence in html.unescape(re.sub(r"<[^>]+>", "", text))
    assert json.loads(answer.to_json())["reasons"] == list(answer.verdict.reasons)
    assert answer.tables["Coordinates"].to_dict()["end"] == answer.q[-1].tolist()
    with pytest.raises(TypeError, match=r"verdict\.ok"):
        bool(answer)


def test_a_fall_past_a_limit_is_done_and_one_under_a_controller_is_judged():
    robot = tw.robots.ur5()
    fall = robot.simulate(duration=2.0, dt=0.01)
    assert fall.verdict.word == "DONE" and fall.verdict.ok
    driven = robot.simulate(duration=0.02, dt=0.01, controller=lambda t, q, dq: 300.0 * np.eye(6)[0])
    assert driven.verdict.word == "OVER LIMIT" and driven.verdict.exit_code == 1


@pytest.mark.parametrize(("driven", "more"), [(2, "; 1 more limit is passed. "), (3, "; 2 more limits are passed. ")])
def test_further_limits_that_are_passed_are_counted_beside_the_first(driven, more):
    """150 N m are what each of the first three drives gives; in a millisecond nothing else is passed."""
    answer = tw.robots.ur5().simulate(duration=1e-3, dt=1e-3, tau=400.0 * (np.arange(6) < driven))
    assert more in answer.headline


def test_the_largest_energy_of_the_table_is_the_largest_in_size():
    """1 kg at 1 m below its hinge has -9.81 cos q J: the most at the bottom, through which it swings."""
    swing = tw.robots.pendulum().simulate([1.0], [0.0], duration=1.0)
    table = swing.tables["Energies"].to_dict()
    largest = dict(zip(table[""], table["largest"], strict=True))
    assert swing.q[-1, 0] < 0.0
    assert largest["potential"] == pytest.approx(-9.81, rel=1e-4)


def test_numbers_of_the_size_of_rounding_are_zero_in_the_tables():
    """Upright, gravity has a lever of 1e-16 m; its speed is no number to read."""
    upright = tw.robots.pendulum().simulate([np.pi], [0.0], duration=0.05)
    assert 0.0 < np.abs(upright.dq[-1, 0]) < 1e-12
    (row,) = [line.split() for line in str(upright).splitlines() if line.split()[:2] == ["hinge", "0"]]
    assert row[:4] == ["hinge", "0", "0", "0"]


def test_a_result_from_a_file_is_judged_by_limits_once_it_has_its_robot(tmp_path):
    robot = tw.robots.ur5()
    result = robot.simulate(duration=0.1, dt=0.01, tau=[0, 0, 400, 0, 0, 0])
    read = tw.SimulationResult.load(result.to_npz(tmp_path / "run.npz"))
    assert read.verdict.word == "DONE"
    assert read.with_robot(robot).headline == result.headline
    assert str(read).splitlines()[0].startswith("DONE: simulated 0.1 s.")


def test_closed_robots_are_judged_alike():
    closed = tw.robots.planar_2r().constrain("link2", rows="vx")
    answer = closed.simulate([0.3, 0.5], duration=0.05, dt=0.01, tau=[1.0, 0.0])
    assert answer.verdict.word == "DONE" and answer.headline in str(answer).replace("\n", " ")


def test_a_long_simulation_report_keeps_to_the_screen():
    robot = tw.load("quadruped", floating_base=True)
    answer = robot.simulate(duration=0.02, dt=0.01)
    assert len(str(answer).splitlines()) <= 45
    assert len(answer.tables["Coordinates"].rows()) == robot.nq
