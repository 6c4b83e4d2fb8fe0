"""``tw.identify`` and ``tw.excite`` give the answers of their commands, on every surface; short forms fit on a screen."""

from __future__ import annotations

import functools
import html
import json
import re
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from identification_logs import fourier_states
from places import SHARED

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell
from twistwrench.identification.body_changes import BodyChanges

DEMO = tw.robots.path_of("planar_2r").with_name("planar_2r_demo_log.csv")
PENDULUM = """
<robot name="double_pendulum">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.21"/><mass value="0.8"/>
    <inertia ixx="0.0182" ixy="0" ixz="0" iyy="0.0182" iyz="0" izz="0.001"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.185"/><mass value="0.6"/>
    <inertia ixx="0.0034" ixy="0" ixz="0" iyy="0.0034" iyz="0" izz="0.0006"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/>
    <axis xyz="0 1 0"/></joint>
</robot>
"""
SETTLED, SETTLED_WORDS = {"cutoff": 10.0, "shift": 0.0}, ["--cutoff", 10, "--shift", 0]
RUNS = {
    "demo": ({}, []),
    "known value": ({"known": {"link2.m": 1.0}} | SETTLED, ["--known", "link2.m=1 kg", *SETTLED_WORDS]),
    "payload": ({"payload_only": "link2"} | SETTLED, ["--payload-only", "link2", *SETTLED_WORDS]),
    "no friction": (
        {"friction": (), "motor_inertia": False} | SETTLED,
        ["--friction-model", "none", "--no-motor-inertia", *SETTLED_WORDS],
    ),
    "strength": (
        {"keep_close": 1.0, "method": "wls"} | SETTLED, ["--keep-close", "1", "--weights", "wls", *SETTLED_WORDS],
    ),
    "test log": ({"test": DEMO} | SETTLED, ["--test", DEMO, *SETTLED_WORDS]),
    "gain": ({"assume": ["gain:joint1"], "cutoff": 10.0}, ["--assume", "gain:joint1", "--cutoff", 10]),
    "degrees": ({"degrees": True, "cutoff": 10.0}, ["--degrees", "--cutoff", 10]),
    "static friction": (
        {"friction": ("viscous", "coulomb", "stribeck"), "stribeck_speed": 0.2, "shift": 0.0},
        ["--friction-model", "viscous,coulomb,stribeck", "--stribeck-speed", 0.2, "--shift", 0],
    ),
    "plain least squares": ({"method": "ols", "cutoff": 8.0}, ["--weights", "ols", "--cutoff", 8]),
    "cause": ({"assume": "load-friction"} | SETTLED, ["--assume", "load-friction", *SETTLED_WORDS]),
}  # fmt: skip
"""Arguments of ``tw.identify``, and words of the command."""
MOTIONS = {
    "plain": ("planar_2r", {"acceleration": 3.0}, ["--acceleration", 3]),
    "degrees": ("planar_2r", {"acceleration": 3.0, "degrees": True}, ["--acceleration", 3, "--degrees"]),
    "clearance": (
        "planar_2r", {"acceleration": 3.0, "clearance": 0.01, "clear_of_itself": False},
        ["--acceleration", 3, "--clearance", 0.01, "--ignore-self"],
    ),
    "floor": ("planar_2r", {"acceleration": 3.0, "floor": -3.0}, ["--acceleration", 3, "--floor", -3]),
    "used share": ("planar_2r", {"acceleration": 3.0, "share": 0.5}, ["--acceleration", 3, "--share", 0.5]),
    "seed": ("pendulum", {"acceleration": 5.0, "seed": 3}, ["--acceleration", 5, "--seed", 3]),
    "noise": ("pendulum", {"acceleration": 5.0, "noise": 0.2}, ["--acceleration", 5, "--torque-noise", 0.2]),
    "no motor inertia": (
        "pendulum", {"acceleration": 5.0, "motor_inertia": False, "friction": ()},
        ["--acceleration", 5, "--no-motor-inertia", "--friction-model", "none"],
    ),
    "step": ("pendulum", {"acceleration": 5.0, "step": 0.02}, ["--acceleration", 5, "--step", "20ms"]),
    "deviations": (
        "pendulum", {"acceleration": 5.0, "criterion": "deviations", "friction": ("viscous",)},
        ["--acceleration", 5, "--criterion", "deviations", "--friction-model", "viscous"],
    ),
}  # fmt: skip
SEARCH = {"duration": 4.0, "harmonics": 1, "restarts": 1}
SEARCH_WORDS = ["--duration", 4, "--harmonics", 1, "--restarts", 1]


@functools.cache
def run(*words, every=True):
    """Result of a command in 80 columns, and what it writes as JSON."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "told.json"
        told = [*map(str, words), "--json", str(file), "--overwrite", *(["--all"] if every else [])]
        result = CliRunner().invoke(main, told, env={"COLUMNS": "80"})
        assert result.exit_code in (0, 1), result.output
        return result, json.loads(file.read_text("utf-8"))


@functools.cache
def demo():
    """Answer on the bundled log."""
    return tw.identify("planar_2r", "demo")


def agree(answer, result, printed):
    with words_of_the_shell():
        data = json.loads(answer.to_json())
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"]
    for key in data.keys() - {"notes"}:
        assert data[key] == printed[key], key
    assert data["notes"] == [note for note in printed["notes"] if note in data["notes"]]
    assert printed["sentences"] and printed["tables"]


SLOW = {"gain", "degrees", "static friction", "plain least squares"}


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in RUNS])
def test_identify_and_its_command_give_the_same_answer(name):
    arguments, words = RUNS[name]
    with words_of_the_shell():  # sentences are kept in the words in which they were first asked for
        answer = tw.identify("planar_2r", "demo", **arguments)
    agree(answer, *run("identify", "planar_2r", "demo", *words))


@pytest.mark.parametrize("name", MOTIONS)
def test_excite_and_its_command_give_the_same_answer(name):
    robot, arguments, words = MOTIONS[name]
    answer = tw.excite(robot, **SEARCH, **arguments)
    agree(answer, *run("excite", robot, *SEARCH_WORDS, *words))


needs_logs = pytest.mark.skipif(not (SHARED / "logs").is_dir(), reason="the shared logs are not here")


@needs_logs
@pytest.mark.parametrize("stamp", ["060143", pytest.param("063536", marks=pytest.mark.slow)])
def test_answers_on_real_logs_of_a_double_pendulum_agree(stamp, tmp_path):
    robot = tmp_path / "pendulum.urdf"
    robot.write_text(PENDULUM)
    log = SHARED / "logs" / "dfki_double_pendulum" / f"20220812-{stamp}-PM_measured.csv"
    agree(tw.identify(robot, log, cutoff=5.0), *run("identify", robot, log, "--cutoff", 5))


@needs_logs
def test_answers_on_a_log_that_is_refused_agree():
    folder = SHARED / "logs" / "dfki_simple_pendulum"
    robot, log = folder / "dfki_simple_pendulum.urdf", folder / "sysid_pd_measured.csv"
    with words_of_the_shell():  # sentences are kept in the words in which they were first asked for
        answer = tw.identify(robot, log)
        assert answer.verdict.word == "LOOK AGAIN" and "measured [kg]" not in str(answer)
    agree(answer, *run("identify", robot, log))


# ── Short forms


@pytest.mark.parametrize("words", [
    ["identify", "planar_2r", "demo"],
    ["identify", "planar_2r", "demo", "--payload-only", "link2", *SETTLED_WORDS],
    ["excite", "planar_2r", *SEARCH_WORDS, "--acceleration", 3],
])  # fmt: skip
def test_short_reports_fit_on_a_screen(words):
    short, _ = run(*words, every=False)
    every, _ = run(*words)
    lines = [line for line in short.stdout.splitlines() if not line.startswith("wrote ")]  # whatever the folder's name
    assert len(lines) <= 45 and max(map(len, lines)) <= 80
    assert "--all" in short.stdout and len(every.stdout.splitlines()) > len(short.stdout.splitlines())


CARRIED = {"cutoff": 20.0, "shift": 0.0, "friction_speed": 0.02}
"""Hz, s and rad/s of the following logs, which need not be sought."""


def carried(robot, mass, com, *, seed, rate=100.0, seconds=12.0, body=-1):
    """Log of a robot that carries a mass at a link, by default its last one, with friction and noise."""
    rng = np.random.default_rng(seed)
    link = robot.model.bodies[body].link
    real = robot.with_payload(tw.SpatialInertia.from_com(mass, com), link) if mass else robot
    t, q, dq, ddq = fourier_states(robot, seconds, rate, rng)
    tau = real.inverse_dynamics(q, dq, ddq) + 0.6 * np.tanh(dq / 0.02) + 0.9 * dq
    tau = tau + 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    return tw.Motion(t, q, tau=tau, robot=robot)


@pytest.mark.parametrize("mass", [0.8, 0.0])
def test_a_tool_is_asked_about_with_its_mass(mass):
    """0.8 kg more, or nothing. The mass is that of a fit of the one body."""
    robot = tw.robots.ur5()
    answer = tw.identify(robot, carried(robot, mass, (0, 0.02, 0.08), seed=1), motor_inertia=False, **CARRIED)
    tool = answer.body_changes.tool
    if not mass:
        assert tool is None and "tool" not in str(answer)
        assert not answer.body_changes.is_heavier.any() and not answer.body_changes.is_moved.any()
        return
    assert tool.link == "wrist_3_link" and abs(tool.mass - mass) < 0.02
    assert "wrist_3_link weighs 0.8 kg more than in the file: is a tool mounted?" in str(answer)
    sure = dict(zip(answer.body_changes.links, answer.body_changes.is_heavier, strict=True))
    assert [link for link, is_sure in sure.items() if is_sure] in ([], ["wrist_3_link"])


def test_a_sum_of_masses_may_be_surer_than_each_of_them():
    """Of masses with a correlation of -0.99, the sum has √0.02 = 0.14 kg: 0.25 kg more of each are sure together alone."""
    C = np.array([[1.0, -0.99], [-0.99, 1.0]])
    still = np.zeros(2), np.zeros(2, bool), None, np.zeros(2, bool)
    found = BodyChanges(("a", "b"), np.ones(2), np.full(2, 1.25), C, *still)
    assert found.is_sum_heavier and not found.is_heavier.any()
    assert not BodyChanges(("a", "b"), np.ones(2), np.full(2, 1.25), abs(C), *still).is_sum_heavier


def test_a_body_of_denser_material_keeps_its_centre_of_mass():
    """Each parameter of the lower link is a fifth larger: its mass changes, and its centre stays where it is."""
    robot = tw.load(PENDULUM)
    bodies = list(robot.model.bodies)
    bodies[1] = replace(bodies[1], inertia=tw.SpatialInertia(1.2 * bodies[1].inertia.parameters))
    dense, t = tw.Robot(replace(robot.model, bodies=tuple(bodies))), np.arange(0, 10, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    tau = tw.Motion(t, q, robot=dense).torques()
    noise = 0.02 * tau.std(axis=0) * np.random.default_rng(3).normal(size=q.shape)
    given = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0, "motor_inertia": False, "friction": ()}
    found = tw.identify(robot, tw.Motion(t, q, tau=tau + noise, robot=robot), **given)
    changes = found.body_changes
    assert changes.is_heavier.tolist() == [False, True] and not changes.is_moved.any()
    rows = [line.split() for line in str(found).splitlines() if line.split()[:1] == ["lower"]]
    assert f"{1e3 * changes.moved[1]:.1f}" in [row[-1] for row in rows], rows  # mm


def test_a_robot_that_lacks_a_tool_is_asked_about():
    robot = tw.robots.ur5()
    loaded = robot.with_payload(tw.SpatialInertia.from_com(1.5, (0, 0, 0.08)), robot.model.bodies[-1].link)
    log = carried(robot, 0.0, (0, 0, 0), seed=2)
    answer = tw.identify(loaded, tw.Motion(log.time, log.q, tau=log.tau, robot=loaded), motor_inertia=False, **CARRIED)
    assert abs(answer.body_changes.tool.mass + 1.5) < 0.03
    assert "less than in the file: does the robot lack a tool?" in str(answer)


def test_a_mass_on_a_link_that_carries_others_is_no_tool():
    """Two kilograms on the forearm are a cable or a wrong file; no body at the flange explains them."""
    robot = tw.robots.ur5()
    forearm = [body.link for body in robot.model.bodies].index("forearm_link")
    changes = tw.identify(robot, carried(robot, 2.0, (0.2, 0, 0.1), seed=2, body=forearm), **CARRIED).body_changes
    assert changes.tool is None


@pytest.mark.slow
@pytest.mark.skipif(not (SHARED / "robots").is_dir(), reason="the shared robots are not here")
@pytest.mark.parametrize(("mass", "com", "seed"), [(0.8, (0, 0, -0.08), 0), (0.8, (0.05, 0, 0.1), 1)])
def test_a_tool_of_a_seven_axis_arm_is_nearer_by_one_body_than_by_all(mass, com, seed, tmp_path):
    path = SHARED / "robots" / "kinova_gen3_2f85.urdf"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        names = tw.load(path).model.velocity_names
        robot = tw.load(path, lock=dict.fromkeys(names[7:], 0.0))
    answer = tw.identify(robot, carried(robot, mass, com, seed=seed, seconds=20.0))
    changes = answer.body_changes
    assert abs(changes.tool.mass - mass) < 0.02
    assert abs(changes.tool.mass - mass) < abs(changes.masses[-1] - changes.before[-1] - mass)
    text = str(answer)
    assert len(text.splitlines()) <= 45 and max(map(len, text.splitlines())) <= 80
    page = answer.to_html(tmp_path / "report.html").read_text("utf-8")
    assert (
        str(answer.free_count) in page and len(answer.tables[f"{answer.free_count} groups of parameters"].rows()) > 50
    )


def test_a_joint_of_negligible_torque_does_not_make_the_verdict_unsure():
    """A quarter of wrist 3 is noise: below 1 % of a limit of 100 N m, and it counts without a limit."""
    robot = tw.robots.ur5()
    log = carried(robot, 0.0, (0, 0, 0), seed=4)
    noise = np.random.default_rng(4).normal(size=len(log.time))
    tau = log.tau + np.outer(noise, [0, 0, 0, 0, 0, 0.25 * np.sqrt(np.mean(log.tau[:, -1] ** 2))])
    words = []
    for effort in (100.0, np.inf):
        arm = tw.Robot(replace(robot.model, limits=replace(robot.limits, effort=np.full(6, effort))))
        answer = tw.identify(arm, tw.Motion(log.time, log.q, tau=tau, robot=arm), motor_inertia=False, **CARRIED)
        share = answer.held_out.joints["wrist_3_joint"]
        assert 0.1 < share < 0.5
        words.append([doubt.joints for doubt in answer.doubts if doubt.kind == "unexplained-joint"])
    assert words == [[], [("wrist_3_joint",)]]


@pytest.mark.slow
def test_many_doubts_leave_room_on_the_screen():
    """A log with several faults, of a robot with six joints."""
    robot = tw.robots.ur5()
    log = carried(robot, 0.0, (0, 0, 0), seed=3, seconds=20.0)
    tau = log.tau * [1, 1, -1, 1, 1.5, 1] + 5.0 * np.sin(3.0 * log.time)[:, None]
    answer = tw.identify(robot, tw.Motion(log.time, log.q, tau=tau, robot=robot))
    assert answer.verdict.word != "OK" and len(str(answer).splitlines()) <= 45


# ── Surfaces


def test_every_surface_has_the_word_and_the_sentence(tmp_path):
    for answer in (demo(), tw.excite("planar_2r", acceleration=3.0, **SEARCH)):
        assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
        page = answer.to_html(tmp_path / f"{answer.call}.html").read_text("utf-8")
        sentence, card = answer.headline.partition(": ")[2], answer._repr_html_()
        for text in (page, card):
            assert sentence in html.unescape(re.sub(r"<[^>]+>", "", text))
        assert len(card) < 120_000 and "<script" not in card
        data = json.loads(answer.to_json(tmp_path / f"{answer.call}.json").read_text("utf-8"))
        assert data["verdict"] == answer.verdict.word and len(data["tables"]) == len(answer.tables)
        assert answer.plot(path=tmp_path / f"{answer.call}.svg").is_file()
        assert repr(answer).startswith(f"<{type(answer).__name__} of planar_2r: {answer.verdict.word}, ")
        with pytest.raises(TypeError, match=r"verdict\.ok"):
            bool(answer)


def test_marks_are_those_of_the_data():
    """A cell with ● is a change of two standard deviations; numbers in tables have all digits."""
    answer = demo()
    changes, lines = answer.body_changes, str(answer).splitlines()
    for one in changes.to_list():
        line = next(line for line in lines if line.split()[:1] == [one["link"]])
        assert ("● " in line) == (one["mass_changed"] or one["com_changed"])
        assert one["mass_changed"] == (abs(one["mass"] - one["file_mass"]) > 2 * one["deviation"])
    assert answer.tables["link"].to_dict()["measured"][:-1] == changes.masses.tolist()


# ── Bad input


@pytest.mark.parametrize(("call", "said"), [
    (lambda: tw.identify("planar_2r", "none.csv"), "none.csv"),
    (lambda: tw.identify("planar_2r", "demo", keep_close=1e9), "not offered"),
    (lambda: tw.identify("planar_2r", "demo", without=["hand"]), "link that moves"),
    (lambda: tw.identify("ur5", "demo"), "no log is bundled with 'ur5'"),
    (lambda: tw.identify("planar_2r", []), "there is no log"),
    (lambda: tw.identify("no_such_robot", "demo"), "no_such_robot"),
    (lambda: tw.identify(3, "demo"), "give a tw.Robot"),
    (lambda: tw.excite("planar_2r"), "nothing limits"),
    (lambda: tw.excite("planar_2r", acceleration=3.0, srdf="pairs.srdf"), "Add clearance"),
    (lambda: tw.excite(3), "give a tw.Robot"),
])  # fmt: skip
def test_bad_input_is_one_error(call, said):
    with pytest.raises(tw.TwistWrenchError, match=re.escape(said)) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_a_gain_of_all_torques_is_no_tool():
    """A change of the last link of a planar arm explains such a log as well, and so does one factor of all bodies."""
    arm, t = tw.robots.planar_2r(), np.arange(0, 10, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    tau = 1.2 * tw.Motion(t, q, robot=arm).torques() + 0.05 * np.sin(np.outer(t, [41, 43]))
    assert tw.identify(arm, tw.Motion(t, q, tau=tau, robot=arm)).body_changes.tool is None
