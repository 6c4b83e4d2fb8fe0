"""Wrench on the mounting, loads of bolts and of bearings: sums, statics by hand, and a floating copy of the robot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import statics


def moving(robot, seed=0, rows=5):
    rng = np.random.default_rng(seed)
    q = robot.random_configuration(rng, (rows,))
    return q, *rng.standard_normal((2, rows, robot.nv))


@pytest.mark.parametrize("name", ["ur5", "panda", "quadruped"])
def test_the_mounting_carries_what_drives_a_free_root_at_rest(name):
    """The same file with a floating base that does not move: its six rows are the wrench of the foundation on the robot."""
    path = tw.robots.path_of(name)
    fixed, free = tw.load(path, floating_base=False), tw.load(path, floating_base=True)
    q, dq, ddq = moving(fixed)
    load = statics.mounting_load(fixed, q, dq, ddq)
    at_rest = np.zeros((len(q), 6))
    root = np.repeat(free.neutral[None, :7], len(q), axis=0)
    tau = free.inverse_dynamics(np.c_[root, q], np.c_[at_rest, dq], np.c_[at_rest, ddq])
    assert_allclose(load.wrench, -tau[:, :6], rtol=1e-9, atol=1e-9)


def test_at_rest_the_mounting_carries_the_whole_weight():
    ur5 = tw.robots.ur5()
    load = statics.mounting_load(ur5, ur5.neutral, np.zeros(6), np.zeros(6))
    mass = ur5.model.moving_mass + ur5.model.base_inertia.mass
    assert_allclose(load.wrench[0, 3:], [0, 0, -9.81 * mass], atol=1e-9)
    assert load.largest["fz"] == (load.wrench[0, 5], 0)


def test_bolts_add_up_to_the_wrench():
    ur5 = tw.robots.ur5()
    load = statics.mounting_load(ur5, *moving(ur5))
    places = np.array([[0.1, 0.0], [-0.05, 0.09], [-0.07, -0.08], [0.03, 0.02]])  # neither symmetric nor centred
    axial = load.bolts(places)[..., 0]
    assert_allclose(axial.sum(axis=1), load.wrench[:, 5], rtol=1e-9)
    assert_allclose(axial @ places[:, 1], load.wrench[:, 0], rtol=1e-9, atol=1e-9)
    assert_allclose(-axial @ places[:, 0], load.wrench[:, 1], rtol=1e-9, atol=1e-9)
    assert_allclose(load.bolts(places, preload=500.0)[..., 0], axial + 500.0)


def test_bolts_on_a_circle_by_hand():
    """A tilting moment M on k bolts of a circle of diameter D: largest axial load 4 M / (k D); torsion: 2 M / (k D)."""
    tilted = statics.MountingLoad(
        np.array([[0, 12.0, 0, 0, 0, 0], [0, 0, 12.0, 0, 0, 0], [0, 0, 0, 8.0, 0, 0]]), "base"
    )
    loads = tilted.bolts(statics.bolt_circle(4, 0.2))
    assert_allclose(np.abs(loads[0, :, 0]).max(), 4 * 12.0 / (4 * 0.2))
    assert_allclose(loads[1, :, 1], 2 * 12.0 / (4 * 0.2))
    assert_allclose(loads[2, :, 1], 2.0)


def test_bearings_carry_what_the_motor_does_not():
    """Force and moment across each joint, less the part along its axis, which is the motor's torque."""
    ur5 = tw.robots.ur5()
    q, dq, ddq = moving(ur5)
    loads = statics.bearing_loads(ur5, q, dq, ddq)
    F, tau = ur5.joint_wrenches(q, dq, ddq), ur5.inverse_dynamics(q, dq, ddq)
    assert loads.joints == ur5.joint_names
    assert_allclose(np.hypot(loads.axial, loads.radial), np.linalg.norm(F[..., 3:], axis=-1), rtol=1e-9)
    assert_allclose(np.hypot(loads.tilting, tau), np.linalg.norm(F[..., :3], axis=-1), rtol=1e-9)


def test_impossible_mountings_are_errors():
    ur5, box = tw.robots.ur5(), tw.robots.floating_box()
    z = np.zeros(6)
    with pytest.raises(tw.ValueRangeError, match="floating_base=False"):
        statics.mounting_load(box, box.neutral, z, z)
    with pytest.raises(tw.ValueRangeError, match="fixed to the base"):
        statics.mounting_load(ur5, ur5.neutral, z, z, "tool0")
    with pytest.raises(tw.ValueRangeError, match="one line"):
        statics.mounting_load(ur5, ur5.neutral, z, z).bolts([[0, 0], [1, 0], [2, 0]])
    with pytest.raises(tw.ShapeError, match=r"\(k, 2\)"):
        statics.mounting_load(ur5, ur5.neutral, z, z).bolts([0.0, 0.0])
