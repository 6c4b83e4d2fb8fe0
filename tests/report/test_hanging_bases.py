"""A legged robot without a statement about its base: never OK, first reason its base; other robots are left alone."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from legged_robots import ALIKE, DOWN, LEGGED, OTHERS, branched
from page_under_node import under_node
from robot_files import FILES, NONE
from scipy.optimize import linprog

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell
from twistwrench.mechanics.model.legs import hanging_base
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.drawn_motion import reported_motion
from twistwrench.reports.spoken_verdict import verdict_text
from twistwrench.reports.torque_analysis import analyse
from twistwrench.viz import write_page

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

FIRST = "UNSURE: trunk is held in the air, and the robot looks legged; "


CARRIES = "UNSURE: trunk is held in the air, and the robot looks legged; if a stand holds it: --fixed-base."


def run(*words):
    done = CliRunner().invoke(main, list(map(str, words)))
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def dog(tmp_path_factory):
    """The bundled quadruped as a file, a squatting log of its joints, and a limits table."""
    folder = tmp_path_factory.mktemp("dog")
    file = tw.robots.path_of("quadruped")
    robot = tw.load(file, floating_base=False)
    t = np.linspace(0, 2, 101)
    bend = 0.2 * np.sin(np.pi * t)[:, None] ** 2
    q = np.tile([0.0, 0.7, -1.4], (len(t), 4)) + bend * np.tile([0.0, 1.0, -2.0], 4)
    log = tw.Motion(t, q, robot=robot).to_csv(folder / "squat.csv")
    return file, log, robot


def test_every_command_is_unsure_of_a_dog_held_in_the_air_and_answers_once_it_is_stated(dog):
    """One declaration on the model is seen by all commands; ``doctor`` and ``info`` print a line and keep their word."""
    file, log, _ = dog
    goal = ",".join(map(str, np.tile([0.0, 0.8, -1.5], 4)))
    start = ",".join(map(str, np.tile([0.0, 0.7, -1.4], 4)))
    commands = [
        ["torques", file, "--trajectory", log, "--payload", "150@trunk"],
        ["payload", file, "--at", start, "--frame", "FL_foot"],
        ["move", file, f"--from={start}", f"--to={goal}"],
    ]
    for words in commands:
        code, output = run(*words)
        assert output.startswith(CARRIES if words[0] == "payload" else FIRST), output
        assert code == 1
    assert run(*commands[0][:-2], "--fixed-base")[1].startswith("OK: all limits kept")
    assert run(*commands[0], "--fixed-base", "--floating-base")[0] == 2
    for command in ("doctor", "info"):
        assert "trunk is held in the air" in run(command, file)[1]
    assert "held in the air" not in run("doctor", file, "--fixed-base")[1]


def test_the_remedy_of_a_payload_that_is_unsure_of_its_base_is_answered(dog):
    """The largest payload is that of a robot on a stand; the command names no option whose answer is another error."""
    stance = ",".join(map(str, np.tile([0.0, 0.7, -1.4], 4)))
    words = ["payload", dog[0], "--frame", "FL_foot", "--at", stance]
    code, output = run(*words)
    assert code == 1 and "--floating-base" not in output
    assert "What a robot that stands on the ground can carry is not computed" in " ".join(output.split())
    assert run(*words, "--fixed-base")[1].startswith("OK: ")


@words_of_the_shell()
def test_an_excess_of_a_dog_held_in_the_air_is_not_certain(dog, tmp_path):
    """Its torques are those of a robot that hangs, by every command; with the base stated, the excess is certain."""
    file, log, _ = dog
    start, goal = (",".join(map(str, np.tile([0.0, *knee], 4))) for knee in ([0.7, -1.4], [0.8, -1.5]))
    torques = ["torques", file, "--trajectory", log, "--payload", "40@FL_foot"]
    move = ["move", file, f"--from={start}", f"--to={goal}", "--payload", "40@FL_foot"]
    for words in (torques, move, [*move, "--duration", "0.3"]):
        _, output = run(*words)
        assert output.startswith(FIRST[:60]) and "as it hangs OVER LIMIT: " in " ".join(output.split())
        assert run(*words, "--fixed-base")[1].startswith("OVER LIMIT: ")
    weak = tw.load(file)
    carries = LoadCase(weak, (Payload(40.0, frame="FL_foot"),), {})
    report = analyse(carries, Differentiation.plan(MotionLog.open(log, weak.model), weak.model), weak.limits)
    page = write_page(weak, tmp_path / "page.html", motion=reported_motion(report))
    [text] = under_node(page, "(m, all, motion) => all.map(() => new Verdict(motion, m.robot).now.text)", [0])
    assert text == verdict_text(report) and "as it hangs OVER LIMIT" in text


def test_a_dog_that_hangs_by_a_wrong_verdict_needs_more_than_its_limits_for_any_contact_forces(dog):
    """With 150 kg on its trunk: by a linear program over the forces of four feet, some joint is beyond its limit.

    Hanging, every joint keeps its limit with ease, so that OK would be wrong.
    """
    file, _, robot = dog
    standing = tw.load(file, floating_base=True).with_payload(tw.SpatialInertia.from_com(150.0), frame="trunk")
    q = np.concatenate([standing.neutral[:7], np.tile([0.0, 0.7, -1.4], 4)])
    g, feet, mu = standing.holding_torques(q), standing.model.leaves, 1.0
    J = np.concatenate([standing.jacobian(q, foot, kind="world_aligned")[3:] for foot in feet])
    limit = standing.limits.effort[6:]
    # unknown: forces (12) and the share x; |g - J'f| ≤ x limit, rows of the base equal, a friction pyramid that holds the cone
    n = len(feet)
    sides = [[s * (k == j) - mu * (k == 2) for k in range(3)] for j in (0, 1) for s in (1, -1)]
    cone = np.hstack([np.kron(np.eye(n), sides), np.zeros((4 * n, 1))])
    joints = np.vstack([np.hstack([-s * J[:, 6:].T, -limit[:, None]]) for s in (1, -1)])
    bound = np.concatenate([-g[6:], g[6:], np.zeros(4 * n)])
    base = np.hstack([J[:, :6].T, np.zeros((6, 1))])
    cost = np.append(np.zeros(3 * n), 1.0)
    ranges = [(None, None), (None, None), (0, None)] * n + [(0, None)]
    found = linprog(cost, np.vstack([joints, cone]), bound, base, g[:6], ranges)
    assert found.status == 0
    assert found.x[-1] > 1.0
    hanging = robot.with_payload(tw.SpatialInertia.from_com(150.0), frame="trunk").holding_torques(q[7:])
    assert (np.abs(hanging) / limit).max() < 0.2


@pytest.mark.parametrize("name", [*LEGGED, *ALIKE])
def test_legs_are_told_by_their_geometry(name):
    """Also arms on a ceiling, as geometry cannot tell: their torques are right only if something holds their base."""
    assert hanging_base((LEGGED | ALIKE)[name]().model) is not None


@pytest.mark.parametrize("name", OTHERS)
def test_mechanisms_that_do_not_stand_on_their_branches_are_left_alone(name):
    assert hanging_base(OTHERS[name]().model) is None


@pytest.mark.parametrize("held", [0, 1])
def test_a_branch_that_a_loop_holds_to_the_base_is_not_a_leg_whichever_it_is(held):
    """Two branches, and a point on the base to which one of them is closed."""
    branches = [*(((0, y, 0), 0.0, DOWN) for y in (-0.1, 0.1)), ((0.3, 0, 0), 0.0, [])]
    assert hanging_base(branched(branches).model) is not None
    assert hanging_base(branched(branches, closed=((held, 2),)).model) is None


@pytest.mark.parametrize(("offset", "stands"), [(0.0, True), (np.pi, False)])
def test_a_leg_that_follows_another_is_where_its_offset_turns_it(offset, stands):
    """Two legs of 0.8 m; half a turn at its hip leaves the second one pointing up."""
    inertial = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(
        f'<link name="{n}">{inertial}</link>'
        for n in ("hips", "thigh0", "shank0", "foot0", "thigh1", "shank1", "foot1")
    )
    joint = (
        '<joint name="to_{1}" type="{2}"><parent link="{0}"/><child link="{1}"/><origin xyz="0 {5} {3}"/><axis xyz="0 1 0"/>'
        '<limit lower="-4" upper="4" velocity="9" effort="9"/>{4}</joint>'
    )
    mimic = f'<mimic joint="to_thigh0" offset="{offset}"/>'
    legs = "".join(
        joint.format("hips", f"thigh{k}", "revolute", 0, mimic * k, 0.2 * k - 0.1)
        + joint.format(f"thigh{k}", f"shank{k}", "revolute", -0.4, "", 0)
        + joint.format(f"shank{k}", f"foot{k}", "fixed", -0.4, "", 0)
        for k in (0, 1)
    )
    assert (hanging_base(tw.load(f'<robot name="biped">{links}{legs}</robot>').model) is not None) is stands


LEG = """<body name="{0}" pos="0 {1} 0"><joint name="{0}_hip" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1"/>
<body name="{0}_shank" pos="0 0 -.4"><joint name="{0}_knee" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1"/>
<body name="{0}_foot" pos="0 0 -.4"><joint name="{0}_ankle" axis="0 1 0"/><geom type="box" size=".1 .05 .02" mass=".5"/></body></body></body>"""
BIPED = """<mujoco><worldbody><geom type="plane" size="9 9 1"/><body name="hips" pos="0 0 .9">{0}<geom type="box" size=".1 .1 .1" mass="9"/>
{1}{2}</body></worldbody></mujoco>"""


def test_files_of_all_formats_are_asked_alike(tmp_path):
    """One biped as MJCF, URDF and SDF: held in the air unless it floats, or a joint of the file fixes it to the world."""
    legs = [LEG.format(name, y) for name, y in (("left", 0.1), ("right", -0.1))]
    held, free = (tw.load(BIPED.format(joint, *legs)) for joint in ("", "<freejoint/>"))
    assert hanging_base(held.model).link == "hips"
    assert hanging_base(free.model) is None
    assert hanging_base(tw.load(BIPED.format("<freejoint/>", *legs), floating_base=False).model) is None
    for suffix, robot in (
        ("urdf", free.chain("hips", None)),
        ("sdf", free),
    ):  # SDF says by no joint at all that it floats
        path = tmp_path / f"biped.{suffix}"
        tw.save(robot, path)
        assert hanging_base(tw.load(path).model).link == "hips"
        assert hanging_base(tw.load(path, floating_base=False).model) is None
    world = '<link name="world"/><joint name="bolts" type="fixed"><parent link="world"/><child link="hips"/></joint>'
    bolted = (tmp_path / "biped.urdf").read_text().replace("</robot>", f"{world}</robot>")
    assert hanging_base(tw.load(bolted).model) is None
    static = (tmp_path / "biped.sdf").read_text().replace("<link ", "<static>true</static><link ", 1)
    assert hanging_base(tw.load(static).model) is None


STANDING = [
    "a1",
    "alexander_description",
    "anymal_b",
    "anymal_c",
    "b1",
    "bolt",
    "centauro",
    "g1",
    "go1",
    "go2",
    "human_description",
    "hyq",
    "icub",
    "laikago",
    "quadruped",
    "romeo",
    "simple_humanoid",
    "solo",
    "talos_data",
    "beside/atlas",
    "beside/icub",
    "beside/mit",
    "beside/nao",
    "beside/unitree_b2",
    "beside/unitree_go2w",
    "beside/unitree_h1",
]
PARTS = ("talos_left_arm",)
"""Beside them are a minitaur whose legs point up at zero, which is not told, and a humanoid on six joints to the world, whose base
is not fixed."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES or NONE)
def test_of_robot_files_the_legged_ones_are_held_in_the_air_and_no_others(name):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = tw.load(FILES[name], inertia="accept").model
    except tw.TwistWrenchError:
        pytest.skip("not read; with which reason is another test's business")
    legged = name.startswith(tuple(STANDING)) and not any(part in name for part in PARTS)
    assert (hanging_base(model) is not None) == legged


def test_edits_keep_the_statement():
    """Payload, locked joints and parts of a robot that hangs on purpose; cutting a part fixes its base on purpose."""
    file = tw.robots.path_of("quadruped")
    stated, silent = tw.load(file, floating_base=False), tw.load(file)
    for robot, hangs in ((stated, False), (silent, True)):
        edited = [
            robot.with_payload(tw.SpatialInertia.from_com(1.0), frame="trunk"),
            robot.lock({"FL_calf_joint": -1.4}),
        ]
        assert [hanging_base(one.model) is not None for one in edited] == [hangs, hangs]
    assert hanging_base(silent.chain("trunk", None).model) is None
    floating = tw.robots.quadruped()
    assert hanging_base(floating.lock({"root_joint": floating.neutral[:7]}).model) is None


@words_of_the_shell()
def test_the_page_of_a_hanging_dog_says_what_the_command_says(dog, tmp_path):
    file, log, _ = dog
    robot = tw.load(file)
    report = analyse(
        LoadCase(robot, (), {}), Differentiation.plan(MotionLog.open(log, robot.model), robot.model), robot.limits
    )
    page = write_page(robot, tmp_path / "page.html", motion=reported_motion(report))
    [text] = under_node(page, "(m, all, motion) => all.map(() => new Verdict(motion, m.robot).now.text)", [0])
    assert text == verdict_text(report)
    assert text.startswith(FIRST)
