"""``tw.check`` and the command ``torques`` give the same answer, on every surface, from a file, a motion, or arrays."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell
from twistwrench.robots.finding import bundled_file

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

UR5 = tw.robots.path_of("ur5")
DEMO = UR5.with_name("ur5_demo.csv")

RUNS = {
    "over": ({"payload": 10}, ["--payload", "10"]),
    "ok": ({"payload": "5,0,0,0.1@tool0"}, ["--payload", "5,0,0,0.1@tool0"]),
    "two payloads": ({"payload": [2, {"forearm_link": 1}]}, ["--payload", "2", "--payload", "1@forearm_link"]),
    "wrench": (
        {"wrench_on_robot": {"tool0": [0, 0, 0, 0, 0, -40]}},
        ["--wrench-on-robot", "tool0:0,0,0,0,0,-40"],
    ),
    "no friction": ({"friction": False, "payload": 3}, ["--no-friction", "--payload", "3"]),
    "actuators": ({"actuators": "demo", "payload": 4}, ["--actuators", "demo", "--payload", "4"]),
    "why": ({"why": True, "payload": 8.5}, ["--why", "--payload", "8.5"]),
    "gearless wrist": ({"lock": {"wrist_3_joint": 0.5}}, ["--lock", "wrist_3_joint=0.5"]),
    "clearance": ({"clearance": 0.01}, ["--clearance", "0.01"]),
    "impossible payload": ({"payload": 1000}, ["--payload", "1000"]),
}
"""Arguments of the function, and words of the command."""


def command(*words: str, folder):
    result = CliRunner().invoke(main, ["torques", *words, "--json", str(folder / "report.json"), "--overwrite"])
    assert result.exit_code in (0, 1), result.output
    return result, json.loads((folder / "report.json").read_text("utf-8"))


@pytest.mark.parametrize("name", RUNS)
@words_of_the_shell()
def test_the_function_and_the_command_give_the_same_answer(name, tmp_path):
    arguments, words = RUNS[name]
    result, printed = command("ur5", "--trajectory", "demo", *words, folder=tmp_path)
    answer = tw.check(
        tw.robots.ur5() if "lock" not in arguments else UR5, DEMO if name != "actuators" else "demo", **arguments
    )
    data = answer.to_dict()
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"]
    for key in ("verdict", "sentences", "tables"):
        assert data[key] == printed[key], key
    assert data["notes"] == [note for note in printed["notes"] if note in data["notes"]]


def test_limits_of_a_file_of_joints_and_of_an_array_are_the_same(tmp_path):
    robot, table = tw.robots.ur5(), tmp_path / "limits.csv"
    table.write_text("joint,effort [N m]\nelbow_joint,60\n")
    effort = robot.limits.effort.copy()
    effort[robot.model.velocity_names.index("elbow_joint")] = 60.0
    answers = [
        tw.check(robot, DEMO, payload=6, limits=limits) for limits in (table, {"elbow_joint": 60}, {"effort": effort})
    ]
    assert len({answer.headline for answer in answers}) == 1
    assert "elbow_joint" in answers[0].headline and "60" in answers[0].headline


def test_a_motion_in_memory_is_judged_as_its_file():
    """By the log of ``Motion.from_file`` to the last digit; by its arrays with the same word and, by the rates, share."""
    robot = tw.robots.ur5()
    motion = tw.Motion.from_file(DEMO, robot)
    of_file = tw.check(robot, DEMO, payload=10)
    assert tw.check(robot, motion, payload=10).to_dict()["tables"] == of_file.to_dict()["tables"]
    arrays = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, robot=robot)
    of_arrays = tw.check(robot, arrays, payload=10)
    assert of_arrays.headline == of_file.headline
    assert np.allclose(of_arrays.peaks, of_file.peaks, rtol=1e-12)
    positions = tw.check(robot, tw.Motion(motion.time, motion.q, robot=robot), payload=10)
    assert positions.verdict.word is of_file.verdict.word
    assert positions.largest_payload == pytest.approx(of_file.largest_payload, rel=1e-3)  # rates are derived


def test_parts_and_edits_of_a_motion_have_no_log():
    motion = tw.Motion.from_file(DEMO, tw.robots.ur5())
    assert motion.log is not None
    assert motion.with_robot(tw.robots.ur5()).log is motion.log
    assert motion[10:200].log is None
    assert motion.between(1.0, 2.0).log is None


@pytest.mark.parametrize("seed", range(5))
def test_peaks_are_those_of_inverse_dynamics(seed):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)
    from twistwrench.robot.convert import to_pinocchio

    names = ("ur5", "panda", "kinova_gen3", "planar_2r", "pendulum")
    robot = getattr(tw.robots, names[seed])() if names[seed] in tw.robots.names() else tw.robots.ur5()
    model = pin.buildModelFromUrdf(str(tw.robots.path_of(robot.name)))
    rng, t = np.random.default_rng(seed), np.linspace(0, 2, 101)
    w = rng.uniform(0.5, 2.0, robot.nv)
    q, dq, ddq = 0.4 * np.sin(np.outer(t, w)), 0.4 * w * np.cos(np.outer(t, w)), -0.4 * w**2 * np.sin(np.outer(t, w))
    if model.nv != robot.nv:
        pytest.skip("Pinocchio moves joints that are locked here")
    states = [to_pinocchio(robot, model, *state) for state in zip(q, dq, ddq, strict=True)]
    peaks = np.abs([pin.rnea(model, model.createData(), *state) for state in states]).max(axis=0)
    answer = tw.check(robot, tw.Motion(t, q, dq, ddq, robot=robot), friction=False, plan=True)
    assert np.allclose(np.abs(answer.peaks), peaks, rtol=1e-6, atol=1e-9)
    assert np.allclose(np.abs(answer.torques()).max(axis=0), peaks, rtol=1e-6, atol=1e-9)


def test_a_load_with_moments_of_inertia_is_that_of_the_robot_that_carries_it():
    robot, load = tw.robots.ur5(), tw.SpatialInertia.from_com(2.0, (0, 0, 0.1), np.diag([0.3, 0.2, 0.1]))
    motion = tw.Motion.from_file(DEMO, robot)
    answer = tw.check(robot, motion, payload=load)
    assert np.allclose(answer.peaks, tw.check(robot.with_payload(load), motion).peaks, rtol=1e-9, atol=1e-9)
    assert answer.largest_payload > tw.check(robot, motion, payload=10).largest_payload * 0.5
    assert not np.allclose(answer.peaks, tw.check(robot, motion, payload="2,0,0,0.1").peaks, rtol=1e-3)


def test_without_torque_limits_no_payload_is_ok():
    """By path, motion and arrays: 1000 kg on an arm without limits is unsure, and no largest payload is known."""
    robot, t = tw.robots.planar_2r(), np.linspace(0, 1, 101)
    motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=robot)
    for asked in (motion, motion.to_pandas()):
        answer = tw.check(robot, asked, payload=1000)
        assert answer.verdict.word == "UNSURE"
        assert answer.largest_payload is None


def test_every_surface_has_the_word_and_the_sentence(tmp_path):
    answer = tw.check(tw.robots.ur5(), "demo", payload=10)
    assert answer.verdict.word == "OVER LIMIT"
    assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
    page = answer.to_html(tmp_path / "report.html").read_text("utf-8")
    sentence = answer.headline.partition(": ")[2]
    for text in (page, answer._repr_html_()):
        assert sentence in re.sub(r"<[^>]+>", "", text)
    assert json.loads(answer.to_json())["reasons"] == list(answer.verdict.reasons)
    assert repr(answer) == "<TorqueReport of ur5: OVER LIMIT, shoulder_lift_joint 111 %>"
    assert len(answer._repr_html_()) < 120_000
    assert "<script" not in answer._repr_html_()
    assert answer.tables["Torques"].to_dict()["joint"] == list(tw.robots.ur5().model.velocity_names)


def test_an_answer_is_not_a_yes():
    with pytest.raises(TypeError, match=r"verdict\.ok"):
        bool(tw.check(tw.robots.ur5(), "demo"))


def test_names_from_files_are_escaped_on_the_card():
    text = (
        tw.robots.path_of("pendulum")
        .read_text("utf-8")
        .replace('name="pendulum"', 'name="&lt;script&gt;x&lt;/script&gt;"')
    )
    robot = tw.load(text)
    assert robot.name.startswith("<script>")
    motion = tw.Motion(np.linspace(0, 1, 51), np.zeros((51, 1)), robot=robot)
    assert "<script" not in tw.check(robot, motion)._repr_html_()


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ((np.zeros((5, 6)),), TypeError, r"tw\.Motion\(time, q, robot=robot\)"),
        ((DEMO, {"payload": "5 apples"}), tw.ValueRangeError, r"MASS\[,x,y,z\]\[@FRAME\]"),
        ((DEMO, {"payload": -1}), tw.ValueRangeError, "at least 0"),
        ((DEMO, {"payload": np.nan}), tw.ValueRangeError, "payload"),
        ((DEMO, {"limits": {"elbow": 3}}), tw.UnknownNameError, "elbow_joint"),
        ((DEMO, {"limits": {"effort": [1, 2]}}), tw.ShapeError, r"\(6,\)"),
        ((DEMO, {"wrench_on_robot": {"tool0": [1, 2]}}), tw.ShapeError, r"\(6,\)"),
        ((DEMO, {"srdf": "a.srdf"}), tw.ValueRangeError, "clearance"),
        (("no_such.csv",), tw.NotFoundError, "no_such.csv"),
    ],
    ids=str,
)
def test_bad_input_is_one_clear_error(arguments, error, words):
    motion, *options = arguments
    with pytest.raises(error, match=words):
        tw.check(tw.robots.ur5(), motion, **(options[0] if options else {}))


def test_a_motion_of_another_robot_names_both():
    other = tw.robots.planar_2r()
    t = np.linspace(0, 1, 51)
    with pytest.raises(tw.ShapeError, match=r"joint1.*shoulder_pan_joint"):
        tw.check(tw.robots.ur5(), tw.Motion(t, np.zeros((51, 2)), robot=other))


def test_many_motions_have_the_verdicts_of_each(tmp_path):
    """In their order; the word on all is the severest, and a file that cannot be read has its error."""
    robot, broken = tw.robots.ur5(), tmp_path / "broken.csv"
    broken.write_text("time,nothing\n0,1\n")
    slow = tw.Motion.from_file(DEMO, robot)[::2]
    found = tw.check_each(robot, [DEMO, slow, broken], payload=10)
    one = tw.check(robot, DEMO, payload=10)
    assert (found[0].verdict, found[0].peak, found[0].reason) == (
        one.verdict.word,
        one.peaks[1],
        one.verdict.reasons[0],
    )
    assert found[1].verdict == tw.check(robot, slow, payload=10).verdict.word
    assert found[2].verdict == "failed"
    assert "nothing" in found[2].reason
    assert found.verdict.word == "OVER LIMIT"
    assert found.verdict.reasons[-1] == "1 of 3 cannot be read"
    assert tw.check_each(robot, [DEMO, broken], payload=1).verdict.word == "UNSURE"
    assert tw.check_each(robot, [DEMO, slow], payload=10).verdict.word == "OVER LIMIT"
    assert tw.check_each(robot, [DEMO, slow], payload=1).verdict.word == "OK"
    with pytest.raises(tw.ValueRangeError, match="none of the 1 motions"):
        tw.check_each(robot, [broken])


def test_the_options_of_check_each_are_those_of_check():
    import inspect
    import typing

    from twistwrench.reports.check import CheckOptions

    own = {name for name, p in inspect.signature(tw.check).parameters.items() if p.kind is p.KEYWORD_ONLY}
    assert own - {"progress"} == set(CheckOptions.__annotations__)
    assert typing.is_typeddict(CheckOptions)


def test_the_short_name_of_an_answer_says_what_its_word_is_about():
    """A robot that falls exceeds a velocity: its name names that, and not the torque, which is 0 %."""
    fall = tw.robots.ur5().simulate(np.zeros(6), duration=0.3)
    answer = tw.check("ur5", fall)
    assert answer.verdict.word == "OVER LIMIT"
    joint = answer.excesses[0].joint
    assert repr(answer) == f"<TorqueReport of ur5: OVER LIMIT, {joint}, velocity limit>"
    assert joint in answer.headline


def test_a_file_of_drives_may_name_joints_that_are_held():
    """Drives belong to the whole robot: locking a joint before or after changes nothing."""
    held, at = {"wrist_3_joint": 0.3}, {"elbow_joint": 0.9}
    drives = bundled_file("demo", "ur5", ".yaml", "actuator file")
    by_hand = tw.check(tw.robots.ur5().with_actuators(drives, stiff=True).lock(held), at=at)
    for robot in ("ur5", tw.robots.ur5()):
        assert tw.check(robot, at=at, actuators="demo", lock=held).headline == by_hand.headline
