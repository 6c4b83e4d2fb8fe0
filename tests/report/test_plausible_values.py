"""The same number by file, table, option and header has the same word; what cannot be a limit or a load is not OK."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from twistwrench import robots
from twistwrench.reports.statistics import Gaps, gap_edges

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

URDF = robots.path_of("ur5").read_text("utf-8")


def word(text):
    first = text.split("\n")[0]
    return next(w for w in ("OK", "UNSURE", "OVER LIMIT", "LOOK AGAIN", "STOPPED") if first.startswith(w)), text


@pytest.fixture
def said(run):
    """First word of a command, whose exit code says the same."""

    def said(*arguments):
        code, text = run(*arguments)
        found, _ = word(text)
        assert (code == 0) == (found == "OK"), text
        return found

    return said


def test_torque_limits_in_another_unit_have_one_word_by_file_and_by_table(said, tmp_path):
    """Efforts in N cm made a UR5 carry 1863 kg, OK."""
    for scale in (0.1, 1.0, 100.0, 1000.0):
        rows = [
            f"{name},{scale * x}" for name, x in zip(robots.ur5().joint_names, (150, 150, 150, 28, 28, 28), strict=True)
        ]
        (tmp_path / "t.csv").write_text("\n".join(["joint,effort", *rows]))
        text = URDF
        for effort in ("150.0", "28.0", "150", "28"):
            text = text.replace(f'effort="{effort}"', f'effort="{scale * float(effort)}"')
        (tmp_path / "r.urdf").write_text(text)
        words = {
            said("torques", "ur5", "--trajectory", "demo", "--limits", tmp_path / "t.csv"),
            said("torques", tmp_path / "r.urdf", "--trajectory", robots.path_of("ur5").with_name("ur5_demo.csv")),
        }
        assert words == {"OK" if scale == 1.0 else "UNSURE"}, scale


def limits_by_file_and_table(folder, kind, scale, head=None):
    """UR5 whose limits of a kind are scaled in its file, and options that give the same numbers in a table."""
    root = ElementTree.fromstring(URDF)
    for limit in root.iter("limit"):
        limit.set(kind, repr(scale * float(limit.get(kind))))
    (folder / "r.urdf").write_bytes(ElementTree.tostring(root))
    numbers = scale * getattr(robots.ur5().limits, kind)
    rows = [f"{name},{x!r}" for name, x in zip(robots.ur5().joint_names, numbers.tolist(), strict=True)]
    (folder / "t.csv").write_text("\n".join([f"joint,{head or kind}", *rows]))
    return folder / "r.urdf", ("--limits", folder / "t.csv")


@pytest.mark.parametrize(
    ("kind", "scale", "expected"),
    [
        ("effort", 5.0, "UNSURE"),
        ("effort", 7.5, "UNSURE"),
        ("effort", 10.0, "UNSURE"),
        ("effort", 1 / 9.81, "UNSURE"),
        ("effort", 1 / 3, "OVER LIMIT"),
        ("velocity", 2.0, "OK"),
        ("velocity", 1 / 2, "OVER LIMIT"),
        ("velocity", 1 / 3.5, "UNSURE"),
        ("velocity", 1 / 10, "UNSURE"),
    ],
)
def test_the_same_limits_have_one_word_by_file_and_by_table(said, tmp_path, kind, scale, expected):
    """Beside the bounds of the rules on efforts and velocities; the bundled motion keeps 42 % of its torque limits."""
    file, table = limits_by_file_and_table(tmp_path, kind, scale)
    log = robots.path_of("ur5").with_name("ur5_demo.csv")
    assert said("torques", file, "--trajectory", log) == said("torques", "ur5", "--trajectory", log, *table) == expected
    if kind == "effort":
        assert said("payload", file) == said("payload", "ur5", *table)


def test_velocity_limits_with_their_unit_are_believed(said, tmp_path):
    """A log that the robot's own limits explain is then over those that were asked about."""
    _, table = limits_by_file_and_table(tmp_path, "velocity", 1 / 10, head="velocity [rad/s]")
    assert said("torques", "ur5", "--trajectory", "demo", *table) == "OVER LIMIT"


@pytest.mark.parametrize(("mass", "expected"), [("1", "OK"), ("10000000", "UNSURE")])
def test_a_load_on_the_axes_of_all_joints_that_carry_it_has_one_word(said, mass, expected):
    """At shoulder_link it loads no joint."""
    load = f"{mass}@shoulder_link"
    assert said("torques", "ur5", "--trajectory", "demo", "--payload", load) == expected
    assert said("payload", "ur5", "--tool", load) == expected
    assert said("move", "ur5", "--to", "0.9,-0.9,1.0,-0.4,1.2,1.0", "--payload", load) == expected


def test_a_load_that_lies_beyond_the_reach_is_looked_at_by_every_command(said):
    load = ("--payload", "2,0,0,80")
    assert said("torques", "ur5", "--trajectory", "demo", *load) == "LOOK AGAIN"
    assert said("move", "ur5", "--to", "0.9,-0.9,1.0,-0.4,1.2,1.0", *load) == "LOOK AGAIN"
    assert said("simulate", "ur5", "--duration", "0.01", *load) == "LOOK AGAIN"
    assert said("payload", "ur5", "--com", "0,0,80") == "LOOK AGAIN"
    assert said("payload", "ur5", "--tool", "2,0,0,80") == "LOOK AGAIN"


def test_a_load_on_the_fixed_base_is_not_carried(said):
    assert said("torques", "ur5", "--trajectory", "demo", "--payload", "200@base_link") == "UNSURE"


def test_a_load_that_cannot_be_held_has_one_word(said):
    move = ("move", "ur5", "--to", "0.9,-0.9,1.0,-0.4,1.2,1.0", "--payload", "60")
    assert said("payload", "ur5", "--tool", "60") == said(*move) == said(*move, "--fastest") == "OVER LIMIT"


def test_radians_under_degrees_have_one_word_by_option_and_by_header(said, tmp_path):
    t = np.arange(0, 8, 0.01)
    q = 0.8 * np.sin(t[:, None] * np.arange(1, 7) / 3)
    for name, unit in (("option", ""), ("header", " [deg]")):
        header = ",".join(["time", *(f"{joint}{unit}" for joint in robots.ur5().joint_names)])
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t, q]), "%.9g", ",", header=header, comments="")
    assert said("torques", "ur5", "--trajectory", tmp_path / "option.csv", "--degrees") == "LOOK AGAIN"
    assert said("torques", "ur5", "--trajectory", tmp_path / "header.csv") == "LOOK AGAIN"
    assert said("torques", "ur5", "--trajectory", tmp_path / "header.csv", "--degrees") == "OK"


def test_stops_in_degrees_are_not_those_of_a_robot(said, tmp_path):
    text = URDF
    for stop in ("6.283185307179586", "6.28318530718", "3.141592653589793", "3.14159265359", "6.2832", "3.1416"):
        text = text.replace(f'"{stop}"', f'"{round(np.degrees(float(stop)))}"')
        text = text.replace(f'"-{stop}"', f'"-{round(np.degrees(float(stop)))}"')
    (tmp_path / "r.urdf").write_text(text)
    log = robots.path_of("ur5").with_name("ur5_demo.csv")
    assert said("torques", tmp_path / "r.urdf", "--trajectory", log) == "LOOK AGAIN"


def test_a_peak_of_position_within_a_gap_leaves_the_stops():
    """A joint turns back up to 0.04 rad beyond its stop at 6.28, while nothing is logged for 0.7 s; speeds are no larger."""
    t = np.arange(0, 5, 0.01)
    for top, leaves in ((6.32, True), (6.29, True), (6.27, False), (6.2, False)):
        q, dq = (top - 0.5 * (t - 2.5) ** 2)[:, None], (2.5 - t)[:, None]
        kept = np.abs(t - 2.5) > 0.35
        rows = gap_edges(t[kept], 0.05)
        edges, most = (q[kept][rows], dq[kept][rows]), np.array([np.abs(dq[kept]).max(axis=0), [1.0]])
        gaps = Gaps.from_edges(t[kept], edges, most, 0.05, stops=(np.array([-6.28]), np.array([6.28])))
        assert gaps.exceeds_logged_motion == leaves
