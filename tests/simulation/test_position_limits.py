"""Limits of position that end a simulation: each joint by itself, from inside, from the limit itself, and not at rest on it."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.numbers import TOLERANCE
from twistwrench.mechanics.model.limits import Limits
from twistwrench.simulation import METHODS

LEAF = """<link name="{name}"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>"""
HINGE = """<joint name="{name}" type="revolute"><parent link="base"/><child link="{child}"/><axis xyz="0 -1 0"/>
<limit lower="{lower}" upper="{upper}" effort="50" velocity="9"/></joint>"""


@functools.cache
def doors(*limits):
    """Leaves of 2 kg on hinges of one base, level at zero, their angle counted upward: gravity takes each down."""
    parts = [
        LEAF.format(name=f"leaf{k}") + HINGE.format(name=f"hinge{k}", child=f"leaf{k}", lower=low, upper=high)
        for k, (low, high) in enumerate(limits)
    ]
    return tw.load(f'<robot name="doors"><link name="base"/>{"".join(parts)}</robot>')


WEIGHT = 2 * 9.81 * 0.5
"""N m about a hinge at the level."""


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_that_starts_at_its_limit_and_falls_outward_ends_the_run_at_once(method):
    """At rest with the acceleration outward, at rest on the upper side, and with a speed outward."""
    door = doors((0.0, 1.5))
    for q0, dq0, tau, side in (
        ([0.0], None, None, "lower 0"),
        ([1.5], None, [30.0], "upper 1.5"),
        ([1.5], [0.1], None, "upper 1.5"),
    ):
        found = door.simulate(q0, dq0, 1.0, 1e-3, limits="stop", method=method, tau=tau)
        assert not found.completed
        assert found.times.tolist() == [0.0]
        assert found.stopped == f"joint 'hinge0' moves beyond its {side.replace(' ', ' limit ')} rad at 0 s"
        assert [e.time for e in found.events] == [0.0]


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_that_starts_at_its_limit_and_moves_inward_goes_on(method):
    door = doors((0.0, 1.5))
    found = door.simulate([0.0], [2.0], 0.2, 1e-3, limits="stop", method=method)
    assert found.completed
    back = door.simulate([0.0], [2.0], 2.0, 1e-3, limits="stop", method=method)
    assert "reaches its lower limit 0" in back.stopped
    assert abs(back.q[-1, 0]) < 1e-12
    assert back.times[-1] > 0.2


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_that_rests_at_its_limit_hides_no_other(method):
    """The first is held level by a torque, exactly at its limit; the second falls 0.5 rad to its own."""
    pair = doors((0.0, 1.5), (-0.5, 1.5))
    found = pair.simulate(None, None, 2.0, 1e-3, limits="stop", method=method, tau=[WEIGHT, 0.0])
    assert "joint 'hinge1' reaches its lower limit -0.5" in found.stopped
    assert abs(found.q[-1, 1] + 0.5) < 1e-12
    alone = doors((-0.5, 1.5)).simulate(None, None, 2.0, 1e-3, limits="stop", method=method)
    assert found.times[-1] == pytest.approx(alone.times[-1], abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_that_rests_at_its_limit_may_leave_through_it_later(method):
    """Held until 0.1 s, then let go: with the acceleration a it is past the tolerance √(2 tolerance / a) later."""
    door = doors((0.0, 1.5))
    found = door.simulate(
        None, None, 1.0, 1e-3, limits="stop", method=method, controller=lambda t, q, dq: [WEIGHT * (t < 0.0999)]
    )
    assert "moves beyond its lower limit 0" in found.stopped
    assert found.times[-1] == pytest.approx(0.1, abs=2e-3)
    assert found.q[-1, 0] == pytest.approx(-TOLERANCE * 1.5, rel=1e-3)


def test_a_joint_held_at_its_limit_with_rounding_rests_there():
    door = doors((0.0, 1.5))
    found = door.simulate(None, None, 1.0, 1e-3, limits="stop", tau=[WEIGHT * (1 - 1e-12)], method="rk4")
    assert found.completed


def test_two_joints_at_their_limits_end_it_by_the_one_that_moves_outward():
    pair = doors((0.0, 1.5), (0.0, 1.5))
    found = pair.simulate(None, None, 1.0, limits="stop", tau=[WEIGHT + 1.0, 0.0])
    assert found.stopped == "joint 'hinge1' moves beyond its lower limit 0 rad at 0 s"


def test_of_two_joints_that_leave_their_limits_the_one_that_gathers_more_speed_is_named():
    """Both fall outward, the second pulled down besides."""
    pair = doors((0.0, 1.5), (0.0, 1.5))
    found = pair.simulate(None, None, 1.0, limits="stop", tau=[0.0, -30.0])
    assert found.stopped == "joint 'hinge1' moves beyond its lower limit 0 rad at 0 s"


def test_a_start_beyond_a_limit_is_refused_and_one_beyond_it_by_rounding_is_not():
    door = doors((0.0, 1.5))
    with pytest.raises(tw.ValueRangeError, match=r"joint 'hinge0' is at 1\.50001 rad, beyond its upper limit 1\.5 rad"):
        door.simulate([1.50001], limits="stop")
    rounded = door.simulate([float(np.float32(1.5) * (1 + 1e-7))], [-1.0], 0.1, limits="stop")
    assert rounded.completed


def test_a_limit_is_exceeded_beyond_one_tolerance_that_goes_with_its_size():
    """Six digits of the larger limit, whatever the unit: of 2 rad, of 0.1 mm, and of a limit at zero."""
    lower, upper = np.array([-1.0, -1e-4, 0.0, -np.inf]), np.array([2.0, 1e-4, np.inf, np.inf])
    limits = Limits(lower, upper, np.full(4, np.inf), np.full(4, np.inf))
    np.testing.assert_allclose(limits.tolerance, [2e-6, 1e-10, 1e-6, 1e-6])
    assert not limits.exceeded(lower - 0.9 * limits.tolerance).any()
    assert not limits.exceeded(upper + 0.9 * limits.tolerance).any()
    np.testing.assert_array_equal(limits.exceeded(lower - 1.1 * limits.tolerance), [True, True, True, False])
    np.testing.assert_array_equal(limits.exceeded(upper + 1.1 * limits.tolerance), [True, True, False, False])
    assert not limits.exceeded(np.full(4, np.nan)).any()


def test_positions_of_joints_are_found_beside_a_floating_base():
    robot = tw.robots.ur5(floating_base=True)
    q = robot.random_configuration(1, 3)
    np.testing.assert_array_equal(robot.model.positions(q)[:, 6:], q[:, 7:])
    assert not robot.model.positions(q)[:, :6].any()
    assert robot.limits.exceeded(robot.model.positions(q)).shape == (3, 12)


def test_the_command_ends_at_once_with_a_sentence_and_says_no(tmp_path):
    (tmp_path / "door.urdf").write_text(
        '<robot name="door"><link name="base"/>'
        + LEAF.format(name="leaf")
        + HINGE.format(name="hinge", child="leaf", lower=0, upper=1.5)
        + "</robot>"
    )
    asked = ["simulate", str(tmp_path / "door.urdf"), "--duration", "0.2"]
    done = CliRunner().invoke(main, [*asked, "--stop-at-limits"])
    assert done.exit_code == 1, done.output
    assert "joint 'hinge' moves beyond its lower limit 0 rad at 0 s" in done.output
    assert "STOPPED" in done.output
    assert CliRunner().invoke(main, asked).exit_code == 0
    within = CliRunner().invoke(main, [*asked, "--stop-at-limits", "--at", "hinge=1.4"])
    assert within.exit_code == 0, within.output
