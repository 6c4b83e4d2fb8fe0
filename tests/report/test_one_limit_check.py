"""What is past a limit by less than the tolerance is at it, in every verdict, red mark and picture; beyond it, in none."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from motions import report_of
from printed_blocks import printed
from rich.console import Console

import twistwrench as tw
from twistwrench.core.numbers import TOLERANCE
from twistwrench.core.verdict import Word
from twistwrench.reports.motors import Demand, MotorUse
from twistwrench.reports.torque_view import motors_table, report_view
from twistwrench.statics import largest_payload
from twistwrench.trajectories import bounds_of
from twistwrench.viz.plots.torques import plot_report
from twistwrench.viz.style import OVER

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

SHARES = [pytest.param(1 + TOLERANCE / 2, False, id="at"), pytest.param(1 + 2 * TOLERANCE, True, id="over")]


def red(*view):
    console = Console(width=140, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    parts = [
        part for part in console.render(printed(view, 140)) if part.style is not None and part.style.color is not None
    ]
    return [part.text for part in parts if part.style.color.name == "red"]


@pytest.fixture(scope="module")
def robot():
    return tw.robots.planar_2r()


@pytest.fixture(scope="module")
def held(robot):
    """The torques that hold it stretched out: (29.43, 9.81) N m."""
    return np.asarray(robot.gravity_forces(np.zeros(2)))


@pytest.fixture
def report(robot, held, tmp_path):
    """Of a robot that stands still, as the one file gives it: without noise."""
    path = tmp_path / "still.csv"
    names = [f"{joint}{end}" for end in ("", ".vel", ".acc") for joint in robot.joint_names]
    rows = np.column_stack([0.01 * np.arange(50), np.zeros((50, 6))])
    np.savetxt(path, rows, delimiter=",", header=",".join(["time", *names]), comments="")
    return lambda share: report_of(robot, path, limits=replace(robot.limits, effort=held / [share, 0.5]))


@pytest.mark.parametrize(("share", "over"), SHARES)
def test_the_torque_report(report, share, over):
    found = report(share)
    assert found.verdict.word is (Word.OVER_LIMIT if over else Word.OK)
    assert bool(found.excesses) is over
    assert bool(red(*report_view(found))) is over


def test_the_picture_of_the_torque_report(report, tmp_path):
    counts = []
    for share in (1 - 2 * TOLERANCE, 1 + TOLERANCE / 2, 1 + 2 * TOLERANCE):
        plot_report(report(share), tmp_path / "torques.svg")
        counts.append((tmp_path / "torques.svg").read_text(encoding="utf-8").count(OVER))
    assert counts[0] == counts[1] < counts[2]


@pytest.mark.parametrize(("share", "over"), SHARES)
def test_the_payload_at_rest(robot, held, share, over):
    limits = held / [share, 0.5]
    found = largest_payload(robot, [0.0, 0.0], limits=limits)
    assert bool(found.holds) is not over
    view = tw.payload(robot, limits={"effort": limits}).blocks()
    assert bool([text for text in red(*view) if "joint1" in text]) is over


@pytest.mark.parametrize(("share", "over"), SHARES)
def test_a_motion(robot, held, share, over):
    still = tw.Motion(np.linspace(0, 1, 20), np.zeros((20, 2)), robot=robot)
    assert bool(still.violations(bounds_of(robot, effort=held / [share, 0.5]))) is over


@pytest.mark.parametrize(("share", "over"), SHARES)
def test_a_motor(share, over):
    motor = tw.robots.ur5().with_actuators(tw.robots.path_of("ur5").with_name("ur5_demo.yaml")).model.actuators
    demand = Demand("peak current", 7.0 * share, 7.0, "A", 0.5)
    use = MotorUse("elbow", next(iter(motor.values())).motor, (demand,), 1.0, math.pi, *np.zeros((3, 1)))
    assert use.too_small is over
    assert bool(red(motors_table([use]))) is over
