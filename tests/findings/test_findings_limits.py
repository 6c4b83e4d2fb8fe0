"""Findings about torque limits: none, some, placeholders, degrees; and what an OK has to say of what was left out."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

T = np.arange(0, 4, 0.01)
S = (T / 4) ** 3 * (10 - 15 * T / 4 + 6 * (T / 4) ** 2)


def link(name, mass=1.0, length=1.0):
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/><inertia ixx="{0.01 * mass}" '
        f'iyy="{0.01 * mass}" izz="{0.01 * mass}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name, parent, child, effort, *, x=0.0, rpy="0 0 0", inside=""):
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{x} 0 0" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 1 0"/><limit lower="-3.1" upper="3.1" velocity="5" effort="{effort}"/>'
        f"{inside}</joint>"
    )


def arm(efforts=(30, 10), *, extra="", rpy="0 0 0"):
    """Two links of 1 kg and 1 m that turn about y; stretched out, gravity takes 19.6 and 4.9 N m."""
    tool = '<link name="tool"/><joint name="tf" type="fixed"><origin xyz="1 0 0"/><parent link="l2"/><child link="tool"/></joint>'
    return (
        f'<robot name="arm2"><link name="base"/>{link("l1")}{link("l2")}{joint("shoulder", "base", "l1", efforts[0], rpy=rpy)}'
        f"{joint('elbow', 'l1', 'l2', efforts[1], x=1)}{tool}{extra}</robot>"
    )


def table(path, *columns, head="time,shoulder,elbow"):
    np.savetxt(path, np.c_[columns], delimiter=",", header=head, comments="", fmt="%.9g")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command run in a folder with the motion ok.csv: exit code and all that it prints, in one line."""
    monkeypatch.chdir(tmp_path)
    table("ok.csv", T, S, 0.3 + 0.5 * S)

    def run(*arguments):
        result = CliRunner().invoke(main, list(map(str, arguments)), env={"COLUMNS": "200"})
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        said = "\n".join(line for line in result.output.splitlines() if not line.startswith("note: robot"))
        return int(result.exit_code), " ".join(said.split())

    return run


COMMANDS = {
    "torques": ("torques", "arm.urdf", "--trajectory", "ok.csv"),
    "torques with a payload": ("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload", 0.2),
    "payload": ("payload", "arm.urdf"),
    "move": ("move", "arm.urdf", "--to", "1,0.8", "--duration", 4),
}
COUNTS = {(30, 10): 0, (0, 10): 1, (30, 0): 1, (0, 0): 2}

# ── 17 and 18: no limits, or some ──


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("efforts", COUNTS)
def test_finding_17_no_ok_unless_each_loaded_joint_has_a_limit(run, tmp_path, command, efforts):
    (tmp_path / "arm.urdf").write_text(arm(efforts))
    code, said = run(*COMMANDS[command])
    if COUNTS[efforts]:
        assert (code, said.startswith(f"UNSURE: no torque limit for {COUNTS[efforts]} of 2 joints")) == (1, True), said
        assert "'twistwrench info ROBOT --csv limits.csv'" in said and "--limits limits.csv" in said
    else:
        assert code == 0 and not said.startswith("UNSURE"), said


def test_finding_17_a_thousand_kilograms_are_not_ok(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm((0, 0)))
    code, said = run("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload", 1000, "--csv", "out.csv")
    assert code == 1 and said.startswith("UNSURE: no torque limit for 2 of 2 joints"), said
    assert len((tmp_path / "out.csv").read_text().splitlines()) == 401
    assert re.search(r"shoulder -?\d+\.?\d* ", said)  # the table of peaks


def test_finding_17_the_line_of_help_works(run, tmp_path):
    """The table that info writes is read by --limits, with its efforts filled in or not."""
    (tmp_path / "arm.urdf").write_text(arm((0, 10)))
    assert run("info", "arm.urdf", "--csv", "limits.csv") == (0, "wrote limits.csv")
    written = (tmp_path / "limits.csv").read_text()
    assert run("info", "arm.urdf", "--csv", "-")[1] == " ".join(written.split())
    for command in COMMANDS.values():
        code, said = run(*command, "--limits", "limits.csv")
        assert code == 1 and said.startswith("UNSURE: no torque limit for 1 of 2 joints (shoulder)"), said
    (tmp_path / "limits.csv").write_text(written.replace("-3.1,3.1,5.0,,", "-3.1,3.1,5.0,30,"))
    for command in COMMANDS.values():
        code, said = run(*command, "--limits", "limits.csv")
        assert code == 0 and not said.startswith("UNSURE"), said


def test_finding_17_what_nothing_drives_and_what_nothing_loads_is_not_asked_for(run, tmp_path):
    text = arm((30, 10)).replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/>')
    spin = joint("spin", "tool", "disc", 0).replace('xyz="0 1 0"', 'xyz="1 0 0"')
    disc = '<link name="disc"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", disc + spin + "</robot>"))
    table("spin.csv", T, S, 0.3 + 0.5 * S, 0 * T, head="time,shoulder,elbow,spin")
    code, said = run("torques", "arm.urdf", "--trajectory", "spin.csv")
    assert code == 0 and said.startswith("OK: "), said
    (tmp_path / "float.urdf").write_text(arm((300, 100)))
    robot = tw.load(tmp_path / "float.urdf", floating_base=True)
    report = run("move", "float.urdf", "--floating-base", "--to", "elbow=0.5", "--duration", 4)[1]
    assert "no torque limit" not in report.lower() and robot.nv == 8


@pytest.mark.parametrize("efforts", [(0, 10), (30, 0), (0, 0)])
def test_finding_18_no_payload_figure_without_the_limit_of_each_loaded_joint(run, tmp_path, efforts):
    (tmp_path / "arm.urdf").write_text(arm(efforts))
    for command in ("torques with a payload", "payload"):
        _, said = run(*COMMANDS[command])
        assert "kg:" not in said and "may have up to" not in said, said


# ── 25: an upright arm ──


def test_finding_25_an_upright_arm_does_not_limit_its_payload(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(rpy="0 -1.5707963 0"))
    code, said = run("payload", "arm.urdf", "--at", "0,0")
    assert (code, said.startswith("OK: the payload is not limited at this pose")) == (0, True), said
    assert "e+07" not in said
    code, said = run("payload", "arm.urdf", "--at", "1e-4,0")  # this lever of 0.2 mm is one
    assert code == 0 and re.match(r"5\.\d+e\+04 kg|\d{5} kg", said), said
    found = tw.statics.largest_payload(tw.load(tmp_path / "arm.urdf"), [0.0, 0.0])
    assert np.isinf(found.mass) and "not limited at this pose" in str(found)


def test_finding_25_nor_does_a_motion_that_stands_upright(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(rpy="0 -1.5707963 0"))
    table("up.csv", T, 0 * T, 0 * T)
    code, said = run("torques", "arm.urdf", "--trajectory", "up.csv", "--payload", 1)
    assert code == 0 and "may have up to" not in said, said
