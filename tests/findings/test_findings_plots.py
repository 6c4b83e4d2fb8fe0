"""Findings about pictures and tables: what was cut or left out."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

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
    assert all(int(b[0]) == int(a[1]) + 1 for a, b in itertools.pairwise(panels))


@pytest.mark.parametrize("width", [60, 80])
def test_finding_64_why_fits_a_narrow_terminal_and_cuts_neither_names_nor_numbers(width):
    def run(columns):
        env = {"COLUMNS": str(columns), "FORCE_COLOR": "1", "TERM": "xterm"}
        result = CliRunner().invoke(main, ["torques", "ur5", "--trajectory", "demo", "--why"], env=env)
        assert result.exit_code == 0, result.output
        return re.sub(r"\x1b\[[0-9;]*m", "", result.output)

    wide, narrow = run(200), run(width)
    assert max(map(len, narrow.splitlines())) <= width
    assert "…" not in narrow
    assert ("━" in narrow) == (width >= 80)
    numbers = r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])"
    assert sorted(re.findall(numbers, narrow)) == sorted(re.findall(numbers, wide))
    pieces = {piece for line in narrow.splitlines() for piece in line.split()}
    assert {"centripetal", "Coriolis", "together"} <= pieces
    for name in ("shoulder_pan_joint", "wrist_2_link"):
        parts = re.findall(r"[^_]+_?", name)
        assert any(name[: len(piece)] == piece and piece.endswith(("_", parts[-1])) for piece in pieces), name


def test_finding_65_ticks_of_a_payload_map_are_round(tmp_path):
    """They were 10, 20, 40, 70, … of even steps in the logarithm, to one digit."""
    result = CliRunner().invoke(main, ["payload", "ur5", "--map", "rz", "--plot", str(tmp_path / "map.svg")])
    assert result.exit_code == 0, result.output
    before = (tmp_path / "map.svg").read_text().partition("<!-- largest payload [kg] -->")[0]
    labels = re.findall(r"<!-- (.*?) -->", before.rpartition('<g id="matplotlib.axis_')[2])
    assert len(labels) >= 3
    assert all(label.strip("0.") in ("1", "2", "5") for label in labels), labels
