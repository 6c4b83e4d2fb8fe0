"""Logs that do not mean what they say: units, sign, mounting, poses. Right logs raise no doubt, wrong ones do."""

from __future__ import annotations

import math
import re
import warnings
from collections import Counter

import numpy as np
import pytest
from quick import mostly_slow
from sensor_logs import AT_REST, BIAS

import twistwrench as tw
from twistwrench.core.doubts import doubt_table
from twistwrench.mechanics.lie import quaternion
from twistwrench.sensing.compensation import log_doubt
from twistwrench.sensing.identification import identify
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.sensor import ForceTorqueSensor
from twistwrench.sensing.simulated_logs import lively_motion, simulate

QUICK, COUNT = 25, 150
"""Tools of each kind, for `make test` and for the study: a rate of 2 % would be missed by one study in twenty."""
COUNTS = pytest.mark.parametrize("count", [QUICK, pytest.param(COUNT, marks=pytest.mark.slow)])
G = 9.80665
UNITS = {  # of a newton and of a newton metre, and what the doubt has to name
    "grams": (1000 / G, 1.0, "forces are in grams ("),
    "N mm": (1.0, 1000.0, "moments are in N mm"),
    "N cm": (1.0, 100.0, "moments are in N cm"),
    "kg and kg cm": (1 / G, 100 / G, "moments in kg cm"),
    "g and g cm": (1000 / G, 1e5 / G, "moments in g cm"),
}


def uniform(rng, low, high):
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def orientations(rng, count):
    return quaternion.rotation((q := rng.normal(size=(count, 4))) / np.linalg.norm(q, axis=1, keepdims=True))


def logs(seed=0, count=COUNT, quotient=(8, 250)):
    """Tools of 50 g to 50 kg, 1 to 30 cm out, on sensors for 2 to 20 times their weight, in random poses half a degree off.

    ``quotient``: least and largest noise of forces [N] over that of moments [N m].
    """
    rng = np.random.default_rng(seed)
    for _ in range(count):
        mass, out, n = uniform(rng, 0.05, 50), uniform(rng, 0.01, 0.3), int(rng.integers(6, 25))
        direction = rng.normal(size=3)
        com = out * direction / np.linalg.norm(direction)
        force = mass * 9.81 * uniform(rng, 2, 20) * uniform(rng, 3e-4, 3e-3)
        noise = np.repeat([force / uniform(rng, *quotient), force], 3)
        sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(mass, com), 30 * noise * rng.normal(size=6))
        R = orientations(rng, n)
        held = R @ tw.so3.exp(rng.normal(size=(n, 3)) * math.radians(rng.uniform(0, 0.5)))
        yield mass, out, R, sensor.predict(held) + noise * rng.normal(size=(n, 6))


def doubts(readings, R, **asked):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        found = identify(ReadingLog.from_arrays(readings, pose=R), **asked)
    refused = [each for each in found.doubts if each.refuses]
    assert found.doubtful or not refused
    return " ".join(each.sentence for each in refused if each.kind != "sensor-outliers")


@COUNTS
def test_right_logs_raise_no_doubt(count):
    assert [said for *_, R, readings in logs(count=count) if (said := doubts(readings, R))] == []


@pytest.mark.slow
def test_rows_of_the_table_are_raised_for_right_logs_as_rarely_as_they_say():
    """Poses are half a degree off, which chances of 1e-4 do not mind; a rate may be missed by three logs of 450."""
    raised = Counter()
    for *_, R, readings in logs(7, 3 * COUNT):
        raised.update(each.kind for each in identify(ReadingLog.from_arrays(readings, pose=R)).doubts)
    rates = {kind: doubt_table()[kind] for kind in raised}
    often = {kind: n for kind, n in raised.items() if n > 3 + 3 * COUNT * rates[kind].false_alarms}
    assert not {kind for kind in often if rates[kind].level != "note" and kind != "sensor-few-orientations"}, often
    assert sum(n for kind, n in raised.items() if rates[kind].level == "refuse") <= 0.02 * 3 * COUNT, raised


@COUNTS
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_equal_numbers_of_noise_in_newtons_and_newton_metres_raise_no_doubt(seed, count):
    # A sensor may have them: "forces are in kilograms" was said to a third of such logs.
    said = [doubts(readings, R) for *_, R, readings in logs(seed, count, quotient=(1, 1))]
    assert np.mean([bool(s) for s in said]) <= 0.02, said


@pytest.mark.parametrize("digits", [1, 2, 4])
def test_rounding_is_not_taken_for_noise(digits):
    # Both rounded alike, forces and moments have the same noise, as no sensor has that measures in N and N m.
    rng = np.random.default_rng(2)
    for mass in (0.5, 2.0, 10.0):
        R = orientations(rng, 12)
        sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(mass, (0.1, 0.05, 0.1)), rng.normal(size=6))
        assert doubts(sensor.predict(R).round(digits), R) == ""


USUAL_UNITS = ("grams", "N mm")


@COUNTS
@pytest.mark.parametrize(
    "unit", [unit if unit in USUAL_UNITS else pytest.param(unit, marks=pytest.mark.slow) for unit in UNITS]
)
def test_logs_in_other_units_are_caught_and_the_unit_is_named(unit, count):
    force, moment, named = UNITS[unit]
    said = [doubts(readings * np.repeat([moment, force], 3), R) for *_, R, readings in logs(count=count)]
    assert np.mean([s.startswith("Units look wrong") for s in said]) > 0.99
    assert np.mean([named in s for s in said]) > 0.9


@pytest.mark.slow
def test_forces_in_kilograms_are_caught_where_the_tool_they_make_is_none():
    # 0.05 kg and 0.4 m are where tools end; in between a log in kilograms is that of another tool.
    told = [
        "forces are in kilograms (" in doubts(readings * np.repeat([1.0, 1 / G], 3), R)
        for mass, out, R, readings in logs(1, 2 * COUNT)
        if mass < 0.3 or out > 0.05
    ]
    assert len(told) > COUNT
    assert np.mean(told) > 0.95


def test_gravity_and_motion_in_other_units_are_doubted():
    _, V, dV = lively_motion(np.linspace(0, 2, 30))
    g = np.tile([0, 0, -9.81], (30, 1))

    def said(**changed):
        log = ReadingLog(np.zeros((30, 6)), **{"gravity": g, "V": V, "dV": dV, **changed})
        return " ".join(map(str, log.doubts()))

    assert said() == ""
    assert "gravity is 1 m/s²" in said(gravity=g / 9.81)
    assert "gravity is 981 m/s²" in said(gravity=100 * g)
    assert "gravity is 0.5 m/s²" in said(gravity=np.concatenate([[[0.0, 0.0, -0.5]], g[1:]]))  # one row is too small
    assert "degrees per second" in said(V=V * np.repeat([180 / math.pi, 1], 3))
    assert "in mm" in said(V=V * np.repeat([1, 1000], 3))
    assert "accelerations reach" in said(dV=dV * np.repeat([1, 1000], 3))


def test_a_gravity_that_is_none_is_the_only_doubt():
    log = simulate(ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0, 0, 0.1))), 12)
    (doubt,) = identify(ReadingLog(log.readings, 100 * log.gravity)).doubts
    assert str(doubt).startswith("gravity is 981 m/s²")


def test_a_bias_is_no_strong_force():
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(50.0, (0, 0, 0.2)), [0, 0, 0, 900, -900, 900])
    assert identify(simulate(sensor, 12)).doubts == ()


# ── sign, mounting, poses ──


def read(seed, mass=3.0, sign="on_sensor", turn=(0.0, 0.0, 0.0), poses=None):
    rng = np.random.default_rng(seed)
    R = orientations(rng, 12) if poses is None else poses
    load = tw.SpatialInertia.from_com(mass, rng.uniform(-0.1, 0.1, 3))
    return simulate(ForceTorqueSensor(load, rng.normal(size=6), sign, tw.so3.exp(turn)), R, rng=rng).readings, R


def verdict(readings, R, **asked):
    """What is said of a log, as a doubt or as the error of a negative mass."""
    try:
        return doubts(readings, R, **asked)
    except tw.ValueRangeError as error:
        assert "mass comes out as -" in str(error)
        return str(error)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 8))])
@pytest.mark.parametrize("mass", mostly_slow([0.5, 3.0, 20.0], 2))
def test_the_right_sign_and_mounting_are_suggested(seed, mass):
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    flipped = verdict(*read(seed, mass, "by_sensor"))
    assert "Use sign='by_sensor': the residual is then noise of 0." in flipped, flipped
    for angle in (0.6, math.pi / 2, math.pi):
        turned = verdict(*read(seed, mass, turn=angle * axis))
        assert "Use sign='on_sensor' with assume='orientation' (turned by" in turned
        both = verdict(*read(seed, mass, "by_sensor", angle * axis))
        assert "Use sign='by_sensor' with assume='orientation' (turned by" in both
        assert "sign='on_sensor'" not in both
        assert verdict(*read(seed, mass, turn=angle * axis), assume="orientation") == ""
        assert "Use sign='by_sensor' with" in verdict(
            *read(seed, mass, "by_sensor", angle * axis), assume="orientation"
        )
        assert verdict(*read(seed, mass, "by_sensor", angle * axis), sign="by_sensor", assume="orientation") == ""


@pytest.mark.parametrize("seed", range(10))
def test_light_tools_in_noise_raise_no_doubt_of_sign_or_mounting(seed):
    for mass in (0.1, 0.3, 1.0):
        assert verdict(*read(seed, mass)) == ""


@pytest.mark.parametrize("seed", range(8))
def test_wrong_poses_are_told_from_noise_by_the_size_of_forces(seed):
    readings, R = read(seed)
    for wrong in (np.roll(R, 1, axis=0), R[::-1]):
        assert "poses do not explain" in verdict(readings, wrong) or "mass comes out" in verdict(readings, wrong)


def test_gravity_in_a_plane_cannot_tell_sign_from_a_half_turn():
    # 2 (g·n) n - g, a half turn about the normal n, is -g for what lies in the plane; the rest is as constant as a bias.
    R = tw.so3.exp(np.outer(np.linspace(-1.5, 1.5, 12), [1.0, 0, 0]))
    three = tw.so3.exp([[0, 0, 0], [0.9, 0, 0], [0, 1.1, 0], [0, 0, 0]])  # three directions always lie in one
    for poses in (R, three):
        readings, _ = read(1, poses=poses)
        assert "Sign and mounting cannot be distinguished" in verdict(readings, poses, assume="orientation")
    assert verdict(*read(1), assume="orientation") == ""


def test_inertia_that_shows_in_the_motion_is_asked_for():
    # Left out, it is taken for a centre of mass that is off by more than its interval.
    lively = simulate(
        ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0, 0, 0.1), 0.02 * np.eye(3))), 200, motion=6.0
    )
    assert "inertia=True" in " ".join(map(str, identify(lively).doubts))
    assert identify(lively, inertia=True).doubts == ()
    point = simulate(ForceTorqueSensor(tw.SpatialInertia.from_com(0.2)), 200, motion=6.0)
    assert identify(point).doubts == ()


# ── logs of another unit than the sensor's ──


@pytest.mark.parametrize(
    ("force", "moment", "said"),
    [(1000 / G, 1, "forces are in grams"), (1, 1000, "N mm"), (1 / G, 1, "kilograms"), (-1, -1, "by_sensor")],
)
def test_a_known_sensor_tells_the_unit_of_a_log(force, moment, said):
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0.02, 0, 0.1)), [0.1, 0.2, -0.3, 5, -3, 8])
    log = simulate(sensor, 20, rng=1, touch={3: [0, 5, 0, 90, 0, 0]})
    assert log_doubt(log, sensor, (0.01, 0.3)) is None
    wrong = ReadingLog(log.readings * np.repeat([moment, force], 3), log.gravity)
    assert said in str(log_doubt(wrong, sensor, (0.01, 0.3)))
    pushes = np.random.default_rng(2).normal(size=(20, 6)) * np.repeat([5.0, 90.0], 3)
    pushed = simulate(sensor, 20, rng=1, touch=dict(enumerate(pushes)))
    assert log_doubt(pushed, sensor, (0.01, 0.3)) is None


# ── slips ──


def test_the_unit_of_a_log_in_motion_is_told_by_forces_where_the_inertia_is_unknown():
    """What an unknown inertia does to the moments is not a reason against another unit of the forces."""
    noise, inertia = (0.01, 0.3), np.diag([0.3, 0.35, 0.1])
    true = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0.02, -0.01, 0.1), inertia), [0.1, 0.2, -0.3, 5, -3, 8])
    known = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0.02, -0.01, 0.1)), true.bias, inertia="unknown")
    t = np.linspace(0, 6, 300)
    T, V, dV = lively_motion(t)
    readings = true.predict(T, V, dV) + np.repeat(noise, 3) * np.random.default_rng(1).normal(size=(300, 6))
    assert log_doubt(ReadingLog.from_arrays(readings, pose=T, V=V, dV=dV, time=t), known, noise) is None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)  # of the unit, by its size alone
        log = ReadingLog.from_arrays(readings / [1, 1, 1, G, G, G], pose=T, V=V, dV=dV, time=t)
    assert "forces are in kilograms (" in str(log_doubt(log, known, noise))


def test_swapped_forces_and_moments_are_recognised():
    for seed in range(6):
        readings, R = read(seed)
        assert "Forces and moments seem swapped" in verdict(np.roll(readings, 3, axis=1), R), seed
        both = verdict(-np.roll(readings, 3, axis=1), R)
        assert "exchanged and sign='by_sensor'" in both


@pytest.mark.parametrize("seed", range(4))
def test_swapped_forces_and_moments_have_their_bias_swapped_too(seed):
    R = orientations(np.random.default_rng(seed), 12)
    readings = simulate(AT_REST, R, rng=seed).readings
    said = verdict(np.roll(readings, 3, axis=1), R, bias=np.roll(BIAS, 3))
    assert re.search(r"seem swapped.* the residual is noise of 0\.[23]\d* N and 0\.0[01]\d* N m", said), said


def test_gravity_that_points_up_is_as_good_as_the_other_sign_at_rest():
    readings, R = read(0)
    up = np.swapaxes(R, 1, 2) @ [0, 0, 9.81]
    with pytest.raises(tw.ValueRangeError, match=r"Use sign='by_sensor': .*Or gx, gy, gz point up.*negate these three"):
        identify(ReadingLog.from_arrays(readings, gravity=up))
    assert "point up" not in verdict(-readings, R)  # orientations say where up is


def test_gravity_that_points_up_is_told_from_the_sign_in_motion():
    tool = ForceTorqueSensor(
        tw.SpatialInertia.from_com(3.0, (0.02, 0, 0.1), 0.02 * np.eye(3)), [0.1, 0.2, 0, 4, -7, 11]
    )
    log = simulate(tool, 200, motion=6.0)
    up = ReadingLog.from_arrays(log.readings, gravity=-log.gravity, V=log.V, dV=log.dV)
    try:
        said = " ".join(map(str, identify(up, inertia=True).doubts))
    except tw.ValueRangeError as error:
        said = str(error)
    assert "gx, gy, gz seem to point up" in said
    assert "sign='by_sensor'" not in said


@pytest.mark.parametrize(
    "wrong", [[0, 0, 0, 1.5, 0, 0], [0, 0, 0, 60, 0, 0], [0.1, 0, 0, 0, 0, 0], [5, 5, 5, -20, 9, 9]]
)
def test_a_wrong_bias_is_blamed_on_the_bias(wrong):
    bias = np.array([0.1, 0.2, -0.3, 5, -3, 8])
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0.02, 0, 0.1)), bias)
    log = simulate(sensor, 12, rng=4)
    try:
        said = " ".join(map(str, identify(log, bias=bias + wrong).doubts))
    except tw.ValueRangeError as error:
        said = str(error)
    assert "The bias given does not fit: left free, it comes out as mx 0.1" in said
    assert "Give no bias" in said


@pytest.mark.slow
def test_a_right_bias_raises_no_doubt():
    bias = np.array([0.1, 0.2, -0.3, 5, -3, 8])
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0.02, 0, 0.1)), bias)
    assert [said for seed in range(100) if (said := identify(simulate(sensor, 12, rng=seed), bias=bias).doubts)] == []
