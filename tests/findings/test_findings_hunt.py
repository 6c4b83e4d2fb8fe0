"""Findings of a search through robot files: first words of the commands against each other."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main


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
