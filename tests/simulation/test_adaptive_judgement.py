"""What adaptive steps are judged by: the mean error of all coordinates, and how stiff the equations are, as far as steps tell."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.simulation.methods.stiffness import Stiffness

RATE = 300.0
"""1/s, of the wheel's damping over its inertia."""
PENDULUM = """<body pos="0 {y} 0"><joint type="hinge" axis="0 1 0"/><geom type="sphere" size="0.1" pos="0.5 0 0" mass="2"/></body>"""


def wheel() -> tw.Robot:
    """One kg m² about an upright axis."""
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    return tw.load(
        f'<mujoco><worldbody><body><joint name="a" type="hinge" axis="0 0 1" damping="{RATE}"/>{inertia}</body>'
        "</worldbody></mujoco>"
    )


@pytest.fixture
def noted(monkeypatch):
    """What the judge of stiffness was told, and the judge."""
    found, judges, note = [], [], Stiffness.note

    def kept(self, t, h, steep, away):
        found.append((h, steep, away))
        judges[:] = [self]
        note(self, t, h, steep, away)

    monkeypatch.setattr(Stiffness, "note", kept)
    return found, judges


@pytest.mark.parametrize("compiled", [True, False])
def test_the_largest_eigenvalue_is_estimated_from_the_stages(noted, compiled):
    """Of a wheel that is damped, by machine code and, where its damping is a function, in Python; the work has no part in it."""
    acting = {"friction": True} if compiled else {"tau": lambda t, q, dq: -RATE * dq}
    result = wheel().simulate([0.0], [2.0], 0.1, 1e-2, rtol=1e-6, **acting)
    h, steep, away = np.array(noted[0]).T
    assert len(h) >= result.steps > 10
    np.testing.assert_allclose(steep / (h * away), RATE, rtol=1e-2)


@pytest.mark.parametrize(
    ("share", "product", "to_come", "stiff"),
    [
        (0.11, 3.3, 110_000, True),
        (0.09, 3.3, 110_000, False),
        (1.0, 3.2, 110_000, False),
        (1.0, 3.3, 90_000, False),
    ],
)
def test_a_run_is_stiff_where_many_steps_are_at_the_edge_of_stability_and_far_more_are_to_come(
    noted, share, product, to_come, stiff
):
    """Of three thousand steps a tenth at least, and a hundred thousand to come."""
    h, tried = 1e-3, 3000
    wheel().simulate([0.0], [2.0], 0.01, 1e-2, friction=True)
    (given,) = noted[1]
    judge = Stiffness(given.system, given.trials, (tried + to_come) * h)
    at_edge = np.zeros(tried, bool)
    at_edge[: round(share * tried)] = True
    for k, edge in enumerate(at_edge[:-1]):
        judge.note(k * h, h, product if edge else 1.0, 1.0)
    if stiff:
        with pytest.raises(tw.SimulationError, match="the equations are stiff"):
            judge.note(tried * h, h, 1.0, 1.0)
    else:
        judge.note(tried * h, h, 1.0, 1.0)


@pytest.mark.parametrize("compiled", [True, False])
def test_pendulums_side_by_side_take_the_steps_of_one(compiled):
    """The error of a step is the mean square of all coordinates': those of equals are that of each."""
    none = {} if compiled else {"tau": lambda t, q, dq: 0.0 * dq}
    found = []
    for n in (1, 3):
        bodies = "".join(PENDULUM.format(y=k) for k in range(n))
        robot = tw.load(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
        result = robot.simulate(np.full(n, 0.3), np.zeros(n), 2.0, 0.1, rtol=1e-7, **none)
        found.append((result.steps, result.rejected))
    assert found[0] == found[1]


def test_large_errors_of_adaptive_steps_ask_for_a_smaller_tolerance():
    """Steps follow the tolerance, and dt only says which states are kept."""
    found = tw.robots.pendulum().simulate([1.0], [0.0], 20.0, rtol=0.05, atol=0.05)
    assert found.relative_error > 0.05 and found.relative_drift > 0.01
    assert [remark.endswith("take a smaller rtol") for remark in found.remarks] == [True, True]


TURN_AND_SLIDE = """<mujoco><worldbody><body name="arm"><joint name="turn" type="hinge" axis="0 0 1"/>
<inertial pos="0.1 0 0" mass="2" diaginertia="0.03 0.04 0.03"/>
<body name="slider" pos="0 0.4 0"><joint name="slide" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("joint", ["turn", "slide"])
def test_a_stiff_run_names_the_joint_of_the_gain(joint):
    """By torque: a gain on the slide, 0.4 m from the axis, changes the acceleration of the turn by more rad/s² than m/s² of its own.

    A force f of the slide accelerates both by M⁻¹ (0, f), in the ratio M_12 : M_11 = 0.4 kg m : 0.23 kg m².
    """
    robot = tw.load(TURN_AND_SLIDE)
    gains = np.where(np.array(robot.joint_names) == joint, 3e4, 0.0)
    with pytest.raises(tw.SimulationError, match=f"most of all in joint '{joint}'"):
        robot.simulate(
            [0.3, 0.0], [-0.01, 0.001], 40.0, 5.0, rtol=1e-3, atol=1e-4, tau=lambda t, q, dq: [0.1, 3] - gains * dq
        )
