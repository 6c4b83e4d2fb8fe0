"""Findings about pictures and tables: what was cut or left out."""

from __future__ import annotations

import re

import numpy as np

import twistwrench as tw

TREE = '<robot name="many"><link name="base"/>{}</robot>'
JOINT = (
    '<link name="l{0}"><inertial><origin xyz="0 0 -.1"/><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link><joint name="joint_{0}" type="continuous"><parent link="base"/><child link="l{0}"/>'
    '<origin xyz="{0} 0 0"/><axis xyz="0 1 0"/></joint>'
)


def test_finding_65_the_plot_of_a_simulation_shows_all_joints(tmp_path):
    robot = tw.load(TREE.format("".join(JOINT.format(k) for k in range(32))))
    swing = robot.simulate(np.linspace(0.1, 1, 32), np.zeros(32), duration=0.05)
    swing.plot(tmp_path / "swing.svg")
    text = (tmp_path / "swing.svg").read_text()
    assert "the first" not in text
    panels = re.findall(r"(\d+) to (\d+) of 32", text)
    assert panels[0][0] == "1"
    assert panels[-1][1] == "32"
    assert all(int(b[0]) == int(a[1]) + 1 for a, b in zip(panels, panels[1:], strict=False))
