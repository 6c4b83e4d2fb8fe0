"""`verify` agrees with robots that are right, disagrees with ones that are not, and skips with a reason what it cannot do."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from printed_blocks import printed
from rich.console import Console
from robot_files import FILES, NONE

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.testing import KINDS, random_inertia, random_pose, random_robot
from twistwrench.testing import verify as module
from twistwrench.testing.verify import Check, verify

LAWS = ("closed form", "energies", "power", "Ṁ − 2C skew", "C dq = c", "forward∘inverse", "compiled")
FLYING_GRIPPER = """
<robot name="odd"><link name="world"/>
  <link name="puck"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0 0 .3" rpy=".3 .2 .1"/><mass value="1"/>
    <inertia ixx=".2" iyy=".3" izz=".4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger"><inertial><origin xyz=".1 0 0"/><mass value=".5"/>
    <inertia ixx=".02" iyy=".03" izz=".04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="twin"><inertial><mass value=".5"/><inertia ixx=".02" iyy=".03" izz=".04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slide" type="planar"><parent link="world"/><child link="puck"/><axis xyz="0 0 1"/></joint>
  <joint name="turn" type="continuous"><parent link="puck"/><child link="arm"/><axis xyz="1 1 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="arm"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="grip2" type="prismatic"><parent link="arm"/><child link="twin"/><axis xyz="0 1 0"/>
    <mimic joint="grip" multiplier="-1" offset=".1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  FEATHER
</robot>"""
FEATHER = '<link name="feather"/><joint name="vane" type="continuous"><parent link="arm"/><child link="feather"/><axis xyz="0 0 1"/></joint>'


@pytest.fixture(autouse=True)
def on_numpy(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")


def row(report, name):
    return next(check for check in report.checks if check.name == name)


def outcome(check):
    return "skipped" if check.skipped else "passed" if check.passed else "failed"


def write(tmp_path, feather):
    path = tmp_path / "odd.urdf"
    path.write_text(FLYING_GRIPPER.replace("FEATHER", FEATHER if feather else ""))
    return path


def load(*args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(*args, **options)


@pytest.mark.parametrize("name", tw.robots.names())
def test_bundled_robots_pass_every_check_that_can_be_done(name):
    report = verify(getattr(tw.robots, name)(), states=2)
    assert {check.name: outcome(check) for check in report.checks if check.name in LAWS} == dict.fromkeys(
        LAWS, "passed"
    )
    assert report.passed


def test_pinocchio_reads_urdf_files_and_mujoco_mjcf_files():
    pytest.importorskip("pinocchio", exc_type=ImportError)
    report = verify(tw.load(tw.robots.path_of("ur5"), floating_base=True), states=2)
    assert outcome(row(report, "Pinocchio")) == "passed"
    assert "MJCF files are compared" in row(report, "MuJoCo").skipped


@pytest.mark.parametrize("seed", range(3))
def test_random_robots_pass_and_have_no_file_to_compare(seed):
    report = verify(random_robot(seed, kinds=KINDS, floating_base=seed == 0), states=1)
    assert report.passed
    assert "no file" in row(report, "Pinocchio").skipped
    assert "no file" in row(report, "MuJoCo").skipped


def test_planar_and_mimic_joints_agree_with_pinocchio(tmp_path):
    """Where ours follow and Pinocchio's are independent, the torques of the follower are folded into its leader's."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    report = verify(load(write(tmp_path, feather=False)))
    assert outcome(row(report, "Pinocchio")) == "passed"
    assert outcome(row(report, "MuJoCo")) == "skipped"


def test_massless_joints_leave_out_only_what_needs_an_inverse(tmp_path):
    report = verify(load(write(tmp_path, feather=True)))
    assert "vane" in row(report, "forward∘inverse").skipped
    assert all(row(report, name).passed for name in LAWS if name != "forward∘inverse")
    assert report.passed


def test_xml_text_and_edited_robots_are_not_compared_with_a_file(tmp_path):
    text = load(write(tmp_path, feather=False).read_text())
    assert "no file" in row(verify(text, states=1), "Pinocchio").skipped
    ur5 = tw.robots.ur5()
    loaded = verify(ur5.with_payload(tw.SpatialInertia.from_com(1.0)), states=1)
    assert "payload" in row(loaded, "Pinocchio").skipped
    locked = verify(ur5.lock({ur5.joint_names[0]: 0.3}), states=1)
    assert "locked" in row(locked, "Pinocchio").skipped


def test_a_robot_without_joints_has_nothing_to_check():
    report = verify(load('<robot name="stone"><link name="stone"/></robot>'))
    assert report.passed
    assert all(check.skipped for check in report.checks)


def test_libraries_that_are_not_installed_are_said_to_be_missing(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pinocchio", None)
    assert "pip install -e '.[peers]'" in row(verify(tw.robots.ur5(), states=1), "Pinocchio").skipped


class Wrong:
    """A robot with one method tampered with."""

    __class__ = tw.Robot  # what isinstance asks

    def __init__(self, robot, method, change):
        self._robot, self._method, self._change = robot, method, change

    def __getattr__(self, name):
        found = getattr(self._robot, name)
        if name != self._method:
            return found
        return lambda *args, **options: self._change(found(*args, **options))


def doubled(x):
    return 2 * x


def poisoned(x):
    return x * np.nan


def lopsided(x):
    return x + 0.01 * np.triu(np.ones_like(x))


@pytest.mark.parametrize(
    ("method", "change", "noticed_by"),
    [
        ("inverse_dynamics", doubled, {"closed form", "energies", "power", "compiled", "Pinocchio", "MuJoCo"}),
        ("inverse_dynamics", poisoned, {"closed form", "energies", "power", "compiled", "Pinocchio", "MuJoCo"}),
        ("mass_matrix", lopsided, {"compiled", "Pinocchio", "MuJoCo"}),
        ("coriolis_matrix", doubled, {"Ṁ − 2C skew", "C dq = c"}),
        ("coriolis_forces", doubled, {"C dq = c"}),
        ("forward_dynamics", doubled, {"forward∘inverse"}),
        ("kinetic_energy", doubled, {"energies", "power"}),
        ("potential_energy", doubled, {"energies", "power"}),
    ],
)
def test_each_wrong_quantity_is_noticed(method, change, noticed_by):
    report = verify(Wrong(tw.robots.ur5(), method, change), states=2)
    assert not report.passed
    failed = {check.name for check in report.checks if check.failed}
    done = {check.name for check in report.checks if not check.skipped}
    assert noticed_by & done <= failed


def test_a_mass_that_the_file_does_not_have_fails_against_pinocchio(monkeypatch):
    """As if our reader had misread the file: the check must not take the robot for an edited one."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    ur5 = tw.robots.ur5()
    first, *rest = ur5.model.bodies
    heavy = replace(first, inertia=tw.SpatialInertia.from_parameters(1.01 * first.inertia.parameters))
    monkeypatch.setattr(module, "file_gap", lambda _: 0.0)
    report = verify(tw.Robot(replace(ur5.model, bodies=(heavy, *rest))), states=2)
    assert row(report, "Pinocchio").failed


def test_the_table_says_what_agrees_what_does_not_and_what_was_skipped():
    report = verify(tw.robots.planar_2r(), states=1)
    checks = (*report.checks, Check("odd", "this, that", 0.5, 1e-10), Check("late", "a, b", skipped="[no] reason"))
    console = Console(width=120, record=True, file=__import__("io").StringIO())
    console.print(printed(replace(report, checks=checks).blocks(), console.width))
    text = console.export_text()
    for words in (
        "LOOK AGAIN: checks that disagree: odd.",
        "closed form",
        "agrees",
        "DISAGREES",
        "5.0e-01",
        "skipped: [no] reason",
    ):
        assert words in text


# ── every file there is ──


@pytest.mark.slow
@pytest.mark.parametrize("floating_base", [False, True])
@pytest.mark.parametrize("name", FILES or NONE)
def test_every_robot_file_agrees_with_itself_and_its_peers(name, floating_base):
    """As loaded by default, rotations snapped: what a file says exactly is the peers' test."""
    try:
        robot = load(FILES[name], floating_base=floating_base, inertia="accept")
    except tw.TwistWrenchError:
        pytest.skip("not read; with which reason is another test's business")
    failed = {check.name: check.residual for check in verify(robot, states=2).checks if check.failed}
    assert not failed


def test_a_slide_without_gravity_agrees_though_nothing_is_left_of_its_coriolis_forces():
    """c = 0, and C has the rounding of terms that cancel: 0 beside 0 is agreement."""
    rng = np.random.default_rng(5)
    builder = ModelBuilder("slides")
    builder.add_link("l0")
    for k in range(3):
        builder.add_link(f"l{k + 1}", random_inertia(rng))
        builder.add_joint(
            f"j{k}", "prismatic", f"l{k}", f"l{k + 1}", axis=rng.normal(size=3), placement=random_pose(rng)
        )
    assert verify(tw.Robot(builder.build(gravity=(0, 0, 0))), states=3).passed
    fan = random_robot(11, joints=1, kinds=("revolute",)).with_gravity((0, 0, 0))
    assert verify(fan, states=3).passed


@pytest.mark.parametrize("off, code", [(0.0, 0), (1e-6, 1), (np.nan, 1)])
def test_the_command_ends_with_1_where_a_check_disagrees(monkeypatch, off, code):
    monkeypatch.setattr(module, "LAWS", (("a law", "what it compares", 1e-9, lambda _robot, _at: off),))
    monkeypatch.setattr(module, "PEERS", ())
    done = CliRunner().invoke(main, ["verify", "pendulum"])
    assert done.exit_code == code, done.output
    assert ("DISAGREES" in done.output) is bool(code)


def test_other_libraries_are_asked_under_the_robots_gravity():
    pytest.importorskip("pinocchio")
    report = verify(tw.robots.ur5().with_gravity((1.0, 2.0, -3.0)), states=1)
    assert row(report, "Pinocchio").passed


def test_what_pinocchio_writes_past_python_is_a_note_and_never_on_the_screen(tmp_path, capfd, monkeypatch):
    pinocchio = pytest.importorskip("pinocchio")
    shape = '<collision><geometry><capsule radius="1" length="2"/></geometry></collision></link>'
    path = tmp_path / "capsule.urdf"
    path.write_text(tw.robots.path_of("ur5").read_text().replace("</link>", shape, 1))
    robot = tw.load(path)
    assert outcome(row(verify(robot, states=1), "Pinocchio")) == "passed"

    def refuses(*_):
        os.write(2, b"Error:   no such thing\n         at line 7\n")
        raise ValueError("The XML stream does not contain a valid URDF model.")

    monkeypatch.setattr(pinocchio, "buildModelFromUrdf", refuses)
    said = row(verify(robot, states=1), "Pinocchio").skipped
    assert "valid URDF model" in said and "it wrote: Error: no such thing at line 7" in said
    assert capfd.readouterr().err == ""


def test_a_fluid_that_is_left_out_is_left_out_of_both(tmp_path):
    """Its forces are remarked on when the file is read; MuJoCo is asked without them, too."""
    pytest.importorskip("mujoco")
    path = tmp_path / "swimmer.xml"
    path.write_text(
        '<mujoco><option density="4000" viscosity="0.1"/><worldbody><body><joint axis="0 1 0"/>'
        '<geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/></body></worldbody></mujoco>'
    )
    with pytest.warns(tw.ModelWarning, match="fluid"):
        robot = tw.load(path)
    report = verify(robot)
    assert report.passed and not next(c for c in report.checks if c.name == "MuJoCo").skipped
