"""A search through robot files: first words of the commands against each other."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


def _link(name):
    return (
        f'<link name="{name}"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name, parent, child, inside):
    return (
        f'<joint name="{name}" type="continuous"><origin xyz="1 0 0"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 1 0"/>{inside}</joint>'
    )


@pytest.mark.parametrize(("elbow", "warned"), [('<limit effort="20" velocity="5"/>', False), ("", True)])
def test_hunt_doctor_asks_no_limits_of_a_mimic_follower(tmp_path, elbow, warned):
    """A follower without limits of its own is driven by its leader, which torques judges: only leaders are warned about."""
    path = tmp_path / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="base"/>{_link("l1")}{_link("l2")}{_link("f")}'
        + _joint("shoulder", "base", "l1", '<limit effort="50" velocity="5"/>')
        + _joint("elbow", "l1", "l2", elbow)
        + _joint("finger", "l2", "f", '<mimic joint="elbow"/>')
        + "</robot>"
    )
    assert tw.load(path).joint_names == ("shoulder", "elbow")
    result = CliRunner().invoke(main, ["doctor", str(path)], env={"COLUMNS": "200"})
    assert ("no limit of effort" in result.output) == warned, result.output
    assert "'finger'" not in result.output, result.output


@pytest.mark.parametrize("factor", [1.0, 1.001])
def test_hunt_the_mass_of_the_payload_command_is_within_the_limits(tmp_path, factor):
    """The mass is rounded down: what is printed is held, and a thousandth more is not."""
    run = CliRunner()
    said = run.invoke(main, ["payload", "ur5"], env={"COLUMNS": "200"}).output
    mass = float(said.split("in this pose: ", 1)[1].split(" kg", 1)[0])
    joints = tw.robots.ur5().joint_names
    path = tmp_path / "still.csv"
    header = ",".join(["time", *joints, *(f"{j}{rate}" for rate in (".vel", ".acc") for j in joints)])
    path.write_text(header + "\n" + "".join(f"{0.1 * k}" + ",0" * 18 + "\n" for k in range(7)))
    args = ["torques", "ur5", "--trajectory", str(path), "--payload", repr(factor * mass)]
    verdict = run.invoke(main, args, env={"COLUMNS": "200"}).output
    assert verdict.startswith("OK" if factor == 1.0 else "OVER LIMIT: shoulder_lift_joint"), said + verdict


@pytest.mark.parametrize(("place", "word"), [(0.98, "OK"), (980, "LOOK AGAIN")])
def test_hunt_the_last_link_reaches_to_its_end_though_no_frame_is_there(tmp_path, place, word):
    """A payload at the end of a pendulum's only link is not in millimetres: its rod of 1 m ends there."""
    rod = _link("rod").replace("0.01", "0.08")
    path, motion = tmp_path / "pendulum.urdf", tmp_path / "still.csv"
    joint = _joint("hinge", "base", "rod", '<limit effort="20" velocity="5"/>')
    path.write_text(f'<robot name="pendulum"><link name="base"/>{rod}{joint.replace("1 0 0", "0.01 0 0", 1)}</robot>')
    motion.write_text("time,hinge,hinge.vel,hinge.acc\n" + "".join(f"{0.1 * k},1.5,0,0\n" for k in range(7)))
    args = ["torques", str(path), "--trajectory", str(motion), "--payload", f"0.5,{place},0,0@rod"]
    said = CliRunner().invoke(main, args, env={"COLUMNS": "200"}).output
    assert said.startswith(word), said


def test_hunt_a_robot_whose_inertias_are_accepted_is_converted(tmp_path):
    """The written file has the same inertia that no body can have: that is not an error of the command that was told so."""
    path = tmp_path / "arm.urdf"
    wrong = _link("l1").replace('izz="0.01"', 'izz="0.03"')
    joint = _joint("shoulder", "base", "l1", '<limit effort="50" velocity="5"/>')
    path.write_text(f'<robot name="arm"><link name="base"/>{wrong}{joint}</robot>')
    for ending in ("urdf", "sdf"):
        out = tmp_path / f"out.{ending}"
        said = CliRunner().invoke(main, ["convert", str(path), str(out), "--inertia", "accept"])
        assert said.exit_code == 0 and "error" not in said.output, said.output
        M = tw.load(out, inertia="accept").mass_matrix([0.3])
        assert abs(M[0, 0] - 0.26) < 1e-12  # iyy and 1 kg at 0.5 m
