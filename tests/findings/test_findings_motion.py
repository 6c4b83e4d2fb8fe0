"""Findings about commands that make motions: move, simulate, excite, and files that identify writes."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

LINK = (
    '<link name="{}"><inertial><origin xyz=".5 0 0"/><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" '
    'ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{}" type="revolute"><origin xyz="{} 0 0"/><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/>'
    '<limit lower="-3.1" upper="3.1" velocity="5" effort="{}"/>{}</joint>'
)


def arm(efforts=(30, 10), dynamics=""):
    """Two links of 1 kg and 1 m that turn about y; stretched out, gravity takes 19.6 and 4.9 N m."""
    joints = JOINT.format("shoulder", 0, "base", "l1", efforts[0], dynamics)
    joints += JOINT.format("elbow", 1, "l1", "l2", efforts[1], dynamics)
    tool = '<link name="tool"/><joint name="tf" type="fixed"><origin xyz="1 0 0"/><parent link="l2"/><child link="tool"/></joint>'
    return f'<robot name="arm2"><link name="base"/>{LINK.format("l1")}{LINK.format("l2")}{joints}{tool}</robot>'


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command run in a folder of its own: exit code and all that it prints, in one line."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        result = CliRunner().invoke(main, list(map(str, arguments)), env={"COLUMNS": "200"})
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return int(result.exit_code), " ".join(result.output.split())

    return run


# ── 24: friction is counted where the file has it ──


def test_finding_24_move_and_torques_agree_on_a_motion_with_friction(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(dynamics='<dynamics damping="50" friction="5"/>'))
    code, said = run("move", "arm.urdf", "--to", "1,0.8", "--duration", 4, "--csv", "m.csv")
    again, torques = run("torques", "arm.urdf", "--trajectory", "m.csv")
    assert code == again == 1
    assert said.startswith("OVER LIMIT: elbow: torque") and torques.startswith("OVER LIMIT: ")
    assert "with friction" in said
    code, said = run("move", "arm.urdf", "--to", "1,0.8", "--duration", 4, "--csv", "m.csv", "--no-friction")
    again, torques = run("torques", "arm.urdf", "--trajectory", "m.csv", "--no-friction")
    assert code == again == 0
    assert said.startswith("OK: ") and torques.startswith("OK: ")
    assert "without friction" in said


LAWS = "{viscous: 2 N m s/rad, coulomb: 2 N m, static: 3 N m, stribeck: 0.1 rad/s, load: 0.1}"


@pytest.mark.parametrize("scaling", ["quintic", "cubic", "trapezoid"])
def test_finding_24_the_shortest_motion_of_a_shape_keeps_limits_with_all_laws_of_friction(run, tmp_path, scaling):
    (tmp_path / "arm.urdf").write_text(arm(efforts=(40, 16)))
    (tmp_path / "a.yaml").write_text(f"actuators:\n  shoulder: {{friction: {LAWS}}}\n  elbow: {{friction: {LAWS}}}\n")
    motion = ("arm.urdf", "--actuators", "a.yaml", "--from=1.2,-0.5", "--to", "0.1,0.6", "--scaling", scaling)
    code, said = run("move", *motion, "--csv", "m.csv")
    assert (code, said.partition(":")[0]) == (0, "OK"), said
    robot = tw.load(tmp_path / "arm.urdf").with_actuators(tmp_path / "a.yaml")
    q, dq, ddq = (getattr(tw.Motion.from_file(tmp_path / "m.csv", robot), x) for x in ("q", "dq", "ddq"))
    share = np.abs(robot.inverse_dynamics(q, dq, ddq, friction=True)) / robot.limits.effort
    assert 0.9 < share.max() <= 1 + 1e-6  # load counts as of both parts of the torque, so it is not used up wholly


def test_finding_24_a_long_motion_at_its_limits_is_at_them_between_the_samples_looked_at_too(run, tmp_path):
    """32 s on a spline: rows of 2 ms lie between the 2001 instants of 16 ms, 3e-4 over the limit there."""
    (tmp_path / "w.csv").write_text("joint1,joint2\n0.55,-0.3\n")
    (tmp_path / "l.csv").write_text("joint,velocity,effort\njoint1,0.05,200\njoint2,0.3,200\n")
    motion = ("--from=0,0.3", "--to", "0.7,0.4", "--waypoints", "w.csv", "--limits", "l.csv", "--scaling", "trapezoid")
    code, said = run("move", "planar_2r", *motion, "--csv", "m.csv")
    again, torques = run("torques", "planar_2r", "--trajectory", "m.csv", "--limits", "l.csv")
    assert (code, again) == (0, 0), torques
    assert said.startswith("OK: ") and torques.startswith("OK: ")


def test_finding_24_the_fastest_timing_says_how_to_leave_out_friction_that_it_cannot_count(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(efforts=(40, 16)))
    (tmp_path / "a.yaml").write_text(f"actuators:\n  shoulder: {{friction: {LAWS}}}\n")
    motion = ("move", "arm.urdf", "--actuators", "a.yaml", "--from=1.2,-0.5", "--to", "0.1,0.6", "--fastest")
    code, said = run(*motion)
    assert code == 2 and "--no-friction" in said
    code, said = run(*motion, "--no-friction")
    assert code == 0 and "without friction" in said


@pytest.mark.parametrize("method", ["dopri5", "semi_implicit", "variational"])
def test_finding_24_simulate_counts_friction_by_default(run, tmp_path, method):
    """A pendulum with much damping, let go: it does not come back, and without friction it does."""
    (tmp_path / "arm.urdf").write_text(arm(dynamics='<dynamics damping="50"/>'))
    fall = ("simulate", "arm.urdf", "--at", "1,0", "--duration", 1, "--method", method, "--dt", 0.002)
    code, said = run(*fall)
    assert code == 0 and "with friction" in said and "work of friction" in said
    code, said = run(*fall, "--no-friction")
    assert code == 0 and "without friction" in said and "work of friction" not in said
    (tmp_path / "bare.urdf").write_text(arm())
    code, said = run("simulate", "bare.urdf", *fall[2:])
    assert code == 0 and "no friction, as its file gives none" in said and "! friction" not in said


# ── 28: small ones ──


def test_finding_28_simulate_says_that_a_torque_given_is_above_the_effort_limit(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm())
    fall = ("simulate", "arm.urdf", "--duration", 0.05)
    code, said = run(*fall, "--torque", "shoulder=1000")
    assert code == 0
    assert "! The torques given are more than the motors have: shoulder: torque 1000 beyond 30 at 0 s" in said
    assert "the motors have" not in run(*fall, "--torque", "shoulder=30")[1]


# ── 42: names and numbers of arrays are shown as what they are ──


def test_finding_42_a_joint_is_named_as_its_file_names_it(run, tmp_path):
    (tmp_path / "free.urdf").write_text(
        arm().replace('type="revolute"', 'type="continuous"').replace(' velocity="5"', "")
    )
    code, said = run("excite", "free.urdf")
    assert code == 2
    assert "how fast joint 'shoulder' of 'arm2' moves" in said
    (tmp_path / "still.urdf").write_text(arm().replace('lower="-3.1" upper="3.1"', 'lower="0.5" upper="0.5"'))
    code, said = run("excite", "still.urdf")
    assert code == 2
    assert "joint 'shoulder' has no room to move" in said


ARM = tw.robots.planar_2r()
NOT = np.float64(-1.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: ARM.forward_kinematics(ARM.neutral, frame=np.str_("hand")),
        lambda: ARM.lock({np.str_("hand"): 0.0}),
        lambda: ARM.inverse_kinematics(np.eye(4), restarts=np.int64(-1)),
        lambda: ARM.inverse_kinematics(np.eye(4), angle=NOT),
        lambda: ARM.random_configuration(0, np.int64(-1)),
        lambda: ARM.random_configuration(NOT),
        lambda: ARM.with_payload(NOT),
        lambda: ARM.simulate(duration=1.0, method="semi_implicit", creep=np.float64(1.0)),
        lambda: ARM.simulate(duration=1.0, limits=np.str_("halt")),
        lambda: ARM.inverse_dynamics([0, 0], [0, 0], [0, 0], wrench_on_robot={np.str_("tool"): np.zeros(5)}),
        lambda: tw.trajectories.move(ARM, [0, 0], [1, 1], tw.trajectories.cubic(1.0)).sample(NOT),
        lambda: tw.identification.exciting_trajectory(ARM, seed=NOT),
        lambda: tw.set_threads(NOT),
    ],
)
def test_finding_42_errors_show_numbers_and_names_of_numpy_without_their_types(call):
    with pytest.raises(tw.TwistWrenchError) as caught:
        call()
    assert "np." not in str(caught.value)
