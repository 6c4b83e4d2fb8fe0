"""Pictures and tables: what was cut or left out."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.viz import style
from twistwrench.viz.plots.holds import plot_support

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

TREE = '<robot name="many"><link name="base"/>{}</robot>'
JOINT = (
    '<link name="l{0}"><inertial><origin xyz="0 0 -.1"/><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link><joint name="joint_{0}" type="continuous"><parent link="base"/><child link="l{0}"/>'
    '<origin xyz="{0} 0 0"/><axis xyz="0 1 0"/></joint>'
)


def test_the_plot_of_a_simulation_shows_all_joints(tmp_path):
    robot = tw.load(TREE.format("".join(JOINT.format(k) for k in range(32))))
    swing = robot.simulate(np.linspace(0.1, 1, 32), np.zeros(32), duration=0.05)
    swing.plot(tmp_path / "swing.svg")
    text = (tmp_path / "swing.svg").read_text()
    assert "the 8 of 32 that move most" in text
    assert "24 others" in text
    assert set(re.findall(r"<!-- (joint_\d+) -->", text)) == {f"joint_{k}" for k in range(24, 32)}


def test_energies_of_a_simulation_begin_at_zero(drawn):
    """The potential energy of a robot far above the origin would hide what is exchanged."""
    swing = tw.load(TREE.format(JOINT.format(1))).simulate([0.5], [0.0], duration=0.1)
    swing.plot("swing.png")
    (energies,) = [axes for axes in drawn[0].axes if "Energies" in axes.get_title(loc="left")]
    for line in energies.lines[:3]:
        assert line.get_ydata()[0] == 0.0
    both = energies.lines[2].get_ydata()
    np.testing.assert_allclose(both, swing.energy - swing.energy[0], atol=1e-12)


@pytest.mark.parametrize("width", [60, 80])
def test_why_fits_a_narrow_terminal_and_cuts_neither_names_nor_numbers(width):
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


def test_ticks_of_a_payload_map_are_round(tmp_path):
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
    monkeypatch.setattr("twistwrench.viz.style.save", lambda figure, path: figures.append(figure))
    return figures


@pytest.mark.parametrize("friction", [False, True])
def test_the_plot_of_a_motion_counts_friction_where_it_is_asked_for(drawn, friction):
    drives = {name: {"friction": {"viscous": "3 N m s/rad"}} for name in ("joint1", "joint2")}
    arm, t = tw.robots.planar_2r().with_actuators({"actuators": drives}), np.linspace(0.0, 1.0, 21)
    motion = tw.Motion(t, np.sin(np.outer(t, [1.0, 2.0])), robot=arm)
    motion.plot("motion.png", friction=friction)
    shown = np.stack([line.get_ydata() for line in drawn[0].axes[1].lines[:2]], axis=1)
    np.testing.assert_allclose(shown, motion.torques(friction=friction), atol=1e-12)
    assert np.abs(motion.torques(friction=True) - motion.torques()).max() > 1.0


def test_the_plot_of_an_identification_shows_what_was_measured(drawn):
    """As points over the curve of the prediction, which has the joint's colour."""
    arm, t = tw.robots.planar_2r(), np.arange(800) * 0.01
    q = np.c_[0.5 * np.sin(2.3 * t + 1.5), 0.7 * np.cos(1.9 * t) + 0.2 * np.sin(4.1 * t)]
    dq, ddq = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    tau = arm.inverse_dynamics(q, dq, ddq)
    tau = tau + 1e-3 * tau.std(axis=0) * np.random.default_rng(0).normal(size=tau.shape)
    tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm)).plot("found.png")
    panels = [axes for axes in drawn[0].axes if "joint" in axes.get_title(loc="left")]
    for axes, colour in zip(panels, style.SERIES, strict=False):
        lines = {line.get_label(): line for line in axes.lines}
        order = [line.get_label() for line in axes.lines]
        assert lines["predicted"].get_color() == colour
        assert (lines["measured"].get_marker(), lines["measured"].get_color()) == (".", "#222222")
        assert order.index("measured") > order.index("predicted")
        below = drawn[0].axes[drawn[0].axes.index(axes) + 1]
        (left,) = [line for line in below.lines if line.get_label() == "residual"]
        shown = {name: lines[name].get_ydata() for name in ("measured", "predicted")}
        np.testing.assert_array_equal(left.get_ydata(), shown["measured"] - shown["predicted"])


def test_small_torques_look_small(drawn, tmp_path):
    """The third wrist joint of the demo bears 0.002 of 28 N m; its axis spans a tenth of the limit on either side at least."""
    picture = str(tmp_path / "torques.png")
    result = CliRunner().invoke(main, ["torques", "ur5", "--trajectory", "demo", "--plot", picture])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    spans = {axes.get_title(loc="left"): np.ptp(axes.get_ylim()) for axes in drawn[0].axes}
    assert spans["wrist_3_joint"] == pytest.approx(0.2 * 28)
    assert spans["shoulder_pan_joint"] > 0.2 * 150


# ── One palette


def luminance(colour):
    parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one, other):
    """Ratio of WCAG 2."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_curves_of_joints_are_seen_on_white_and_on_dark_paper_and_remarks_are_read():
    """3 : 1 for marks, 4.5 : 1 for text; the dark paper is that of the viewer's panel."""
    for colour in style.SERIES:
        assert contrast(colour, "#ffffff") >= 3
        assert contrast(colour, "#1b222a") >= 3
    for colour in (style.QUIET, style.OVER, style.AXIS, style.INK):
        assert contrast(colour, "#ffffff") >= 4.5


def test_the_viewer_has_the_colours_of_the_plots():
    from twistwrench.viz.colours import COLOURS

    assert COLOURS["lines"] is style.SERIES
    assert len(set(style.SERIES)) == style.MAX_COLOURED


def test_curves_of_many_joints_differ_in_colour_or_dashes_and_the_rest_is_grey(drawn):
    t, sizes = np.linspace(0, 1, 5), np.arange(30.0)
    with style.figure(4, 3, "") as figure:
        axis = figure.subplots()
        names = [f"j{k}" for k in range(30)]
        chosen = style.draw_joints(axis, t, t[:, None] * sizes, names, sizes)
    assert chosen == list(range(22, 30))
    looks = {line.get_label(): (line.get_color(), line.get_linestyle()) for line in axis.lines}
    coloured = [look for name, look in looks.items() if name in names]
    assert len(set(coloured)) == len(coloured) == 8
    assert sum(line.get_color() == style.PALE for line in axis.lines) == 22
    assert "22 others" in looks


def test_minus_signs_of_plots_are_one_character(tmp_path):
    """Names keep their hyphen, and so do exponents."""
    with style.figure(4, 3, "arm-2: peak -3.5 N m, drift 1e-05") as figure:
        figure.subplots().plot([-2, 2], [-1, 1])
        style.save(figure, tmp_path / "minus.svg")
    text = (tmp_path / "minus.svg").read_text("utf-8")
    assert "arm-2: peak −3.5 N m, drift 1e-05" in text
    assert "<!-- −2.0 -->" in text or "<!-- −2 -->" in text


def test_a_magnet_is_drawn_with_the_friction_of_what_it_pulls(drawn):
    """A magnet of 100 N on a wall holds 2 kg by friction 0.5: 19.62 N of 50 N, and nothing presses it on."""
    magnet = tw.statics.Contact((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), friction=0.5, pull=100.0)
    found = tw.statics.hold(np.tile([0, 0, 0, 0, 0, -19.62], (3, 1)), [magnet])
    np.testing.assert_allclose(found.forces[:, 0], np.tile([0, 0, 19.62], (3, 1)), atol=1e-9)
    plot_support(found, "magnet.png", time=np.arange(3.0))
    (cones,) = [axes for axes in drawn[0].axes if "friction cones" in axes.get_title(loc="left")]
    np.testing.assert_allclose(cones.lines[0].get_ydata(), 100 * 19.62 / 50.0, rtol=1e-6)
