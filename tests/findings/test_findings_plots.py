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


@pytest.fixture
def drawn(monkeypatch):
    """Figures in place of the files."""
    pytest.importorskip("matplotlib")
    figures = []
    monkeypatch.setattr("twistwrench.plotting.style.save", lambda figure, path: figures.append(figure))
    return figures


def test_finding_65_the_plot_of_an_identification_shows_what_was_measured(drawn):
    """As points over the curve of the prediction, which has the joint's colour."""
    arm, t = tw.robots.planar_2r(), np.arange(800) * 0.01
    q = np.c_[0.5 * np.sin(2.3 * t + 1.5), 0.7 * np.cos(1.9 * t) + 0.2 * np.sin(4.1 * t)]
    dq, ddq = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    tau = arm.inverse_dynamics(q, dq, ddq)
    tau = tau + 1e-3 * tau.std(axis=0) * np.random.default_rng(0).normal(size=tau.shape)
    tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm)).plot("found.png")
    panels = [axes for axes in drawn[0].axes if "joint" in axes.get_title(loc="left")]
    for axes, colour in zip(panels, ("#0072B2", "#E69F00"), strict=True):
        lines = {line.get_label(): line for line in axes.lines}
        order = [line.get_label() for line in axes.lines]
        assert lines["predicted"].get_color() == colour
        assert (lines["measured"].get_marker(), lines["measured"].get_color()) == (".", "#222222")
        assert order.index("measured") > order.index("predicted")


def test_finding_65_small_torques_look_small(drawn, tmp_path):
    """The third wrist joint of the demo bears 0.002 of 28 N m; its axis spans a fifth of the limit at least."""
    picture = str(tmp_path / "torques.png")
    result = CliRunner().invoke(main, ["torques", "ur5", "--trajectory", "demo", "--plot", picture])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    spans = {axes.get_title(loc="left"): np.ptp(axes.get_ylim()) for axes in drawn[0].axes}
    assert spans["wrist_3_joint"] == pytest.approx(0.2 * 28)
    assert spans["shoulder_pan_joint"] > 0.2 * 150
