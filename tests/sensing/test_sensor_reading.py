"""What a six-axis sensor reads: the equation of its load, its sign, its mounting."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from sensor_logs import BIAS, COM, tool

import twistwrench as tw
from twistwrench.sensing.sensor import (
    ForceTorqueSensor,
    checked_rotations,
    gravity_in_frame,
    load_regressor,
    rotations_to_gravity,
)
from twistwrench.sensing.simulated_logs import lively_motion, simulate


def test_hand_and_apple_to_the_last_digit():
    T_hf = np.eye(4)
    T_hf[:3, 3] = [-0.1, 0, 0]
    T_af = np.array([[1, 0, 0, -0.25], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    hand = tw.SpatialInertia.from_com(0.5).in_frame(tw.se3.inverse(T_hf))
    apple = tw.SpatialInertia.from_com(0.1).in_frame(tw.se3.inverse(T_af))
    F_f = ForceTorqueSensor(hand + apple).predict(np.eye(3), gravity=(0, -10, 0))
    by_frames = tw.Ad(T_hf).T @ [0, 0, 0, 0, -5, 0] + tw.Ad(T_af).T @ [0, 0, 0, 0, 0, 1]
    np.testing.assert_allclose(F_f, [0, 0, -0.75, 0, -6, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(F_f, by_frames, rtol=0, atol=1e-15)


def test_readings_in_motion_obey_the_equation_of_one_body():
    T, V, dV = lively_motion(np.linspace(0, 3, 50))
    G = tool().load
    g = np.concatenate([np.zeros((50, 3)), gravity_in_frame(T)], axis=1)
    F_on = G @ g - (G @ dV - (tw.ad(V).T @ (G @ V)))
    np.testing.assert_allclose(tool().predict(T, V, dV), BIAS + F_on, atol=1e-12)
    np.testing.assert_allclose(tool(sign="by_sensor").predict(T, V, dV), BIAS - F_on, atol=1e-12)


def test_a_sensor_that_falls_with_its_load_reads_its_bias():
    T = lively_motion(np.linspace(0, 3, 9))[0]
    falling = np.concatenate([np.zeros((9, 3)), gravity_in_frame(T)], axis=1)
    np.testing.assert_allclose(tool().predict(T, dV=falling), np.tile(BIAS, (9, 1)), atol=1e-12)


def test_simulated_twists_are_the_rates_of_simulated_poses():
    h = 1e-4
    T, V, dV = lively_motion(np.arange(0, 1, h))
    np.testing.assert_allclose(tw.se3.log(tw.se3.inverse(T[:-2]) @ T[2:]) / (2 * h), V[1:-1], atol=1e-6)
    np.testing.assert_allclose((V[2:] - V[:-2]) / (2 * h), dV[1:-1], atol=1e-5)


def test_a_turned_mounting_turns_the_wrench():
    R = tw.so3.exp([0.3, -0.2, 0.5])
    T, V, dV = lively_motion(np.linspace(0, 3, 9))
    straight = tool().predict(T, V, dV) - BIAS
    T_fs = np.eye(4)
    T_fs[:3, :3] = R
    np.testing.assert_allclose(tool(mounting=R).predict(T, V, dV) - BIAS, tw.Ad(T_fs).T @ straight, atol=1e-12)


@pytest.mark.parametrize("sign", ["on_sensor", "by_sensor"])
def test_what_is_left_is_what_touches_the_load(sign):
    sensor = tool(sign=sign, mounting=tw.so3.exp([0.1, 0.2, 0.3]))
    push = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    T, V, dV = lively_motion(np.linspace(0, 3, 4))
    factor = 1.0 if sign == "on_sensor" else -1.0
    T_fs = np.eye(4)
    T_fs[:3, :3] = sensor.mounting
    readings = sensor.predict(T, V, dV) + factor * (tw.Ad(T_fs).T @ push)
    left = sensor.compensate(readings, T, V, dV)
    np.testing.assert_allclose(sensor.contact_wrench(left), np.tile(push, (4, 1)), atol=1e-12)


def test_batches_broadcast():
    pose, V = np.tile(np.eye(4), (5, 1, 1, 1)), np.zeros((7, 6))
    assert tool().predict(pose, V, V).shape == (5, 7, 6)
    assert load_regressor(np.zeros((2, 3))).shape == (2, 6, 10)


@pytest.mark.parametrize("count", [1, 9])
def test_the_least_turn_brings_gravity_where_it_is_wanted(count):
    d = np.random.default_rng(0).normal(size=(count, 3))
    d = np.concatenate([d / np.linalg.norm(d, axis=1, keepdims=True), [[0, 0, 1.0], [0, 0, -1.0]]])
    np.testing.assert_allclose(gravity_in_frame(rotations_to_gravity(d), (0, 0, -1)), d, atol=1e-15)


# ── simulated logs ──


@pytest.mark.parametrize("count", [5, np.int64(5), np.uint8(5), np.array(5)])
def test_a_number_of_poses_may_be_of_any_integer_type(count):
    np.testing.assert_array_equal(simulate(tool(), count).readings, simulate(tool(), 5).readings)
    assert len(simulate(tool(), count, motion=1.0)) == 5


def test_one_pose_makes_a_log_of_one_reading():
    np.testing.assert_allclose(simulate(tool(), np.eye(3), noise=(0, 0)).readings, [tool().predict(np.eye(3))])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"poses": 2.5}, "give a whole number of at least 1"),
        ({"poses": 0}, "give a whole number of at least 1"),
        ({"poses": "twelve"}, "of text, expected"),
        ({"poses": np.eye(3), "motion": 1.0}, "Give their number"),
        ({"motion": -1.0}, "motion -1.0 is not a valid duration"),
        ({"motion": math.nan}, "motion nan is not a valid duration"),
        ({"motion": "long"}, "motion 'long' is not a valid duration"),
        ({"noise": (0.1,)}, "two numbers from 0 on"),
        ({"noise": (0.1, -1.0)}, "two numbers from 0 on"),
        ({"noise": (math.nan, 1.0)}, "two numbers from 0 on"),
        ({"touch": {12: np.zeros(6)}}, "no reading 12. They are 0 to 11"),
        ({"touch": {"first": np.zeros(6)}}, "no reading 'first'"),
        ({"touch": {0: [1, 2, 3]}}, "touch of reading 0 has"),
        ({"touch": {0: np.full(6, math.nan)}}, "touch of reading 0 has"),
    ],
)
def test_what_cannot_be_simulated_is_said(arguments, said):
    with pytest.raises(tw.TwistWrenchError, match=said):
        simulate(tool(), **{"poses": 12, **arguments})


# ── which inertia a load has ──

_NOBODY = tw.SpatialInertia.from_com(
    1.0, np.zeros(3), np.diag([0.01, 0.01, 0.1])
)  # one moment exceeds the sum of the others


def test_a_load_that_no_body_can_be_is_refused_as_a_rigid_body_is():
    with pytest.raises(tw.InertiaError, match="no load has this inertia: triangle inequality"):
        ForceTorqueSensor(_NOBODY)
    with pytest.raises(tw.InertiaError, match="no rigid body has this inertia: triangle inequality"):
        tw.RigidBody(_NOBODY)
    assert ForceTorqueSensor(_NOBODY, inertia="accept").load is _NOBODY
    with pytest.raises(tw.InertiaError, match="negative mass"):
        ForceTorqueSensor(tw.SpatialInertia.from_com(-1.0), inertia="accept")
    with pytest.raises(tw.InertiaError, match="is a SpatialInertia, got float"):
        ForceTorqueSensor(3.0)
    with pytest.raises(tw.ValueRangeError, match="given, accept, unknown"):
        ForceTorqueSensor(inertia="maybe")


def test_an_unknown_inertia_is_warned_of_in_motion_and_has_no_part_in_forces():
    T, V, dV = lively_motion(np.linspace(0, 3, 9))
    point = tw.SpatialInertia.from_com(3.0, COM)
    unknown = ForceTorqueSensor(point, BIAS, inertia="unknown")
    readings = tool().predict(T, V, dV)
    with pytest.warns(tw.ModelWarning, match="inertia not identified"):
        left = unknown.compensate(readings, T, V, dV)
    np.testing.assert_allclose(left[:, 3:], 0, atol=1e-12)
    assert np.abs(left[:, :3]).max() > 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        unknown.compensate(readings, T)
        tool().compensate(readings, T, V, dV)


def test_a_contact_is_told_in_the_axes_of_the_frame_whose_poses_are_given():
    """The sensor's axes are turned by 90° about z: a force along its x axis acts along y of the frame, of either sign."""
    turned = np.asarray(tw.so3.exp([0.0, 0.0, np.pi / 2]))
    for sign, factor in (("on_sensor", 1.0), ("by_sensor", -1.0)):
        contact = ForceTorqueSensor(mounting=turned, sign=sign).contact_wrench([0.0, 0.0, 2.0, 3.0, 0.0, 0.0])
        np.testing.assert_allclose(factor * contact, [0.0, 0.0, 2.0, 0.0, 3.0, 0.0], atol=1e-12)


def test_a_load_that_only_slides_needs_no_inertia():
    """Moments of inertia multiply rates of turning: linear velocities and accelerations leave nothing out."""
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0, 0, 0.1)), inertia="unknown")
    sliding, turning = [0.0, 0, 0, 1, 2, 3], [0.0, 0, 0.1, 0, 0, 0]
    assert sensor.missing_signals(sliding, sliding) is None
    assert sensor.missing_signals(turning, sliding) and sensor.missing_signals(sliding, turning)


@pytest.mark.parametrize("decimals", [4, 5, 12])
def test_orientations_with_few_decimals_are_rotations(decimals):
    """A log's r11 … r33 have as many digits as a program prints."""
    R = tw.so3.exp(np.array([[0.3, -0.5, 0.8], [2.0, 0.4, -1.1]]))
    found = checked_rotations(np.round(R, decimals))
    np.testing.assert_allclose(found, R, atol=10.0**-decimals)
    np.testing.assert_allclose(np.swapaxes(found, 1, 2) @ found, np.tile(np.eye(3), (2, 1, 1)), atol=1e-14)
