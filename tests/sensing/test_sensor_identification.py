"""What a log tells of a sensor's load, with what confidence, and what it cannot tell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from sensor_logs import BIAS, COM, tool
from sensor_logs import NOISES as NOISE

import twistwrench as tw
from twistwrench.sensing.files import read_sensor_file
from twistwrench.sensing.identification import identify
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.observability import advice
from twistwrench.sensing.poses import propose_poses
from twistwrench.sensing.sensor import ForceTorqueSensor
from twistwrench.sensing.simulated_logs import simulate
from twistwrench.sensing.unknowns import Unknowns

STUDY = 1000
"""Identifications of the slow study; the quick one has a fifth of them."""


@pytest.fixture(
    scope="module",
    params=[(3.0, STUDY // 5), *(pytest.param((mass, STUDY), marks=pytest.mark.slow) for mass in (3.0, 0.2))],
    ids=["3kg-quick", "3kg", "0.2kg"],
)
def trials(request):
    """Identifications from 12 chosen poses: what came out, and whether the truth was inside the regions."""
    mass, count = request.param
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(mass, COM), BIAS)
    rng, R = np.random.default_rng(int(10 * mass)), propose_poses(12).rotations
    found = [identify(simulate(sensor, R, noise=NOISE, rng=rng)) for _ in range(count)]
    return sensor, found


def test_mass_within_one_percent_and_centre_within_a_millimetre(trials):
    sensor, found = trials
    if sensor.load.mass < 1:
        pytest.skip("promised of the 3 kg tool")
    good_mass = np.mean([abs(f.sensor.load.mass / 3.0 - 1) < 0.01 for f in found])
    good_com = np.mean([np.linalg.norm(f.sensor.load.com - COM) < 1e-3 for f in found])
    assert good_mass >= 0.95
    assert good_com >= 0.95


def test_the_truth_is_inside_the_95_percent_regions(trials):
    """Between 93 and 97 % of 1000; of 200, as many as all but one of 30,000 runs of a true 95 % have, four deviations."""
    sensor, found = trials
    mass = sensor.load.mass

    def share(inside):
        return np.mean([inside(f) for f in found], axis=0)

    regions = [
        share(lambda f: f.mass_interval[0] < mass < f.mass_interval[1]),
        *share(lambda f: (f.com_intervals[:, 0] < COM) & (f.com_intervals[:, 1] > COM)),
        share(lambda f: f.com_region_contains(COM)),
        share(lambda f: f.region_contains(mass, COM)),
        *share(
            lambda f: [lo < b < hi for b, (lo, hi) in zip(BIAS, map(f.interval, f.fit.unknowns.names[:6]), strict=True)]
        ),
    ]
    room = 0.02 if len(found) == STUDY else 4.0 * math.sqrt(0.95 * 0.05 / len(found))
    assert min(regions) >= 0.95 - room, regions
    assert max(regions) <= min(0.95 + room, 1.0 - 1.0 / len(found)), regions


def test_regions_of_a_known_noise_end_at_quantiles_of_chi_square():
    """The centre's region is Fieller's, of three numbers h - m c; that of mass and centre is the ellipsoid of m and h."""
    found = identify(simulate(tool(), 12), noise=NOISE)
    part = found.fit.unknowns.load
    x, C = found.fit.estimate[part][:4], found.fit.covariance[part, part][:4, :4]

    def of_centre(c):
        H = np.hstack([-c[:, None], np.eye(3)])
        return (H @ x) @ np.linalg.solve(H @ C @ H.T, H @ x)

    def of_both(c):
        r = x[0] * np.array([1.0, *c]) - x
        return r @ np.linalg.solve(C, r)

    for contains, square, count in (
        (found.com_region_contains, of_centre, 3),
        (lambda c: found.region_contains(x[0], c), of_both, 4),
    ):
        limit = stats.chi2.ppf(0.95, count)
        for direction in np.eye(3):
            inside, outside = 0.0, 1.0  # m
            for _ in range(50):
                middle = 0.5 * (inside + outside)
                if contains(x[1:] / x[0] + middle * direction):
                    inside = middle
                else:
                    outside = middle
            assert square(x[1:] / x[0] + inside * direction) == pytest.approx(limit, rel=1e-6)


def test_clean_logs_keep_their_readings(trials):
    assert np.mean([not f.outliers for f in trials[1]]) > 0.99


def test_noise_is_estimated_without_bias(trials):
    noise = np.array([f.noise for f in trials[1]])
    np.testing.assert_allclose(np.sqrt((noise**2).mean(axis=0)), NOISE, rtol=0.02)


def test_after_compensation_the_residual_is_noise():
    sensor = tool()
    found = identify(simulate(sensor, 600, motion=12.0, noise=NOISE, rng=1), inertia=True)
    fresh = simulate(sensor, 3000, motion=40.0, noise=NOISE, rng=2)
    left = fresh.compensated(found.sensor) / np.repeat(NOISE, 3)
    assert np.abs(left.mean(axis=0)).max() < 0.2  # the bias is known from 600 readings, correlated with the load
    np.testing.assert_allclose(left.var(axis=0), 1.0, atol=0.15)
    left = left - left.mean(axis=0)
    for lag in range(1, 20):  # white: no correlation with any earlier reading beyond 5 σ
        assert np.abs((left[lag:] * left[:-lag]).mean(axis=0)).max() < 5 / math.sqrt(3000) + 0.02
    assert stats.kstest(left.ravel() / left.std(), "norm").pvalue > 1e-3


def test_all_in_motion_inertia_and_mounting_come_out_too():
    turn = np.array([0.02, -0.03, 0.05])
    sensor = tool(sign="by_sensor", mounting=tw.so3.exp(turn))
    log = simulate(sensor, 500, motion=10.0, rng=0)
    found = identify(log, sign="by_sensor", inertia=True, assume="orientation")
    assert not found.sensor.load.defects()
    truth = np.concatenate([BIAS, sensor.load.parameters])
    z = (found.fit.estimate[:16] - truth) / np.sqrt(np.diag(found.fit.covariance)[:16])
    assert np.abs(z).max() < 4
    np.testing.assert_allclose(found.turn, turn, atol=4e-3)


@pytest.mark.slow
def test_coverage_holds_with_inertia_and_mounting():
    turn = np.array([0.02, -0.03, 0.05])
    sensor = tool(mounting=tw.so3.exp(turn))
    exact = simulate(sensor, 60, motion=6.0, noise=(0, 0))
    truth, rng, inside = np.concatenate([BIAS, sensor.load.parameters]), np.random.default_rng(5), []
    for _ in range(250):
        readings = exact.readings + rng.normal(size=(60, 6)) * np.repeat(NOISE, 3)
        log = ReadingLog.from_arrays(readings, gravity=exact.gravity, V=exact.V, dV=exact.dV)
        found = identify(log, inertia=True, assume="orientation")
        x, C = found.fit.estimate.copy(), found.fit.joint
        delta = tw.so3.log(sensor.mounting.T @ found.fit.mounting)  # in the sensor's own axes
        r = np.concatenate([x[:16] - truth, delta])
        inside.append(r @ np.linalg.solve(C, r) < 19 * stats.f.ppf(0.95, 19, found.fit.freedom.min()))
    assert 0.91 <= np.mean(inside) <= 0.99  # 250 trials: ± 2.8 % is two deviations


@pytest.mark.parametrize("inertia", [False, True])
@pytest.mark.parametrize("assume", [None, "orientation"])
def test_the_uncertainty_of_any_unknowns_is_written_read_and_used(inertia, assume, tmp_path):
    """The kinds of unknowns are found by their names in the file: bias, load, inertia and mounting."""
    log = simulate(tool(), 60, motion=6.0)
    options = {} if assume is None else {"assume": assume}
    found = identify(log, inertia=inertia, **options)
    file = tmp_path / "sensor.yaml"
    found.write(file)
    uncertainty = read_sensor_file(file).uncertainty
    assert uncertainty.unknowns == found.uncertainty.unknowns
    S = uncertainty.predictive(log, found.sensor)
    np.testing.assert_allclose(S, found.uncertainty.predictive(log, found.sensor), rtol=1e-9)


def test_a_mounting_turned_by_a_right_angle_is_found():
    R = tw.so3.exp([0.0, 0.0, math.pi / 2])
    found = identify(simulate(tool(mounting=R), 12), assume="orientation")
    assert np.linalg.norm(tw.so3.log(found.fit.mounting.T @ R)) < 0.02


def test_touched_readings_are_left_out_and_named():
    touch = {3: [0, 0.5, 0, 6, 0, 0], 7: [0.2, 0, 0, 0, 0, 5], 8: [0, 0, 0.1, 0, 4, 4]}
    found = identify(simulate(tool(), 12, touch=touch, rng=4))
    assert found.outliers == [3, 7, 8]
    assert "3, 7–8" in " ".join(map(str, found.doubts))
    assert abs(found.sensor.load.mass - 3) < 0.05
    spoiled = identify(simulate(tool(), 12, touch=touch, rng=4), outliers="keep")
    assert spoiled.outliers == []
    assert spoiled.noise[1] > 1


def test_a_known_bias_lets_fewer_turns_tell_the_mass():
    R = tw.so3.exp(np.outer([0, 0, 0, 1, 1, 1], [0, 1.0, 0]))
    log = simulate(tool(), R)
    with pytest.raises(tw.ValueRangeError, match="cannot be distinguished"):
        identify(log)
    assert identify(log, bias=BIAS).sensor.load.mass == pytest.approx(3, abs=0.1)


def test_known_noise_makes_the_regions_normal():
    found = identify(simulate(tool(), 12), noise=NOISE)
    low, high = found.mass_interval
    k = found.fit.unknowns.names.index("mass")
    assert (high - low) / 2 == pytest.approx(stats.norm.ppf(0.975) * math.sqrt(found.fit.covariance[k, k]), rel=1e-6)


@pytest.mark.parametrize("confidence", [0.68, 0.99])
def test_the_interval_of_the_mass_has_the_confidence_asked_for(confidence):
    """Of known noise: as many standard deviations to either side as a normal distribution has there."""
    found = identify(simulate(tool(), 12), noise=NOISE, confidence=confidence)
    low, high = found.mass_interval
    k = found.fit.unknowns.names.index("mass")
    deviations = (high - low) / 2 / math.sqrt(found.fit.covariance[k, k])
    assert deviations == pytest.approx(stats.norm.ppf(0.5 + confidence / 2), rel=1e-6)
    assert found.interval("mass") == (low, high)


def test_residuals_beyond_the_noise_given_are_remarked_on():
    assert not identify(simulate(tool(), 12), noise=NOISE).doubts
    found = identify(simulate(tool(), 12, noise=(0.03, 0.9)), noise=NOISE, outliers="keep")
    assert "times the given noise" in " ".join(map(str, found.doubts))
    assert found.doubtful


def test_a_weightless_load_is_not_given_a_place():
    found = identify(simulate(ForceTorqueSensor(tw.SpatialInertia.zero(), BIAS), 12, rng=1))
    assert not np.isfinite(found.com_intervals).any()
    assert "cannot be distinguished from zero" in " ".join(map(str, found.doubts))
    assert found.doubtful


# ── what it cannot tell ──


@pytest.mark.parametrize(
    ("rotations", "said"),
    [
        (
            np.tile(np.eye(3), (5, 1, 1)),
            r"mass \+1 kg with bias fz \+9.81 N changes no reading.*points along \(0, 0, -1\)",
        ),
        (tw.so3.exp(np.outer([0, 0, 1, 1], [0, 1.0, 0])), r"m cx .* with m cz .*turned about \(0, -?1, -?0\) only"),
    ],
    ids=["one orientation", "one axis"],
)
def test_degenerate_poses_name_what_cannot_be_told(rotations, said):
    with pytest.raises(tw.ValueRangeError, match=said):
        identify(simulate(tool(), rotations))


def test_a_narrow_log_says_how_little_it_tells():
    found = identify(simulate(tool(), propose_poses(12, within=0.03).rotations))
    assert "mm only (95 %). Readings in more and wider orientations" in " ".join(map(str, found.doubts))


def test_the_other_sign_is_recognised():
    with pytest.raises(tw.ValueRangeError, match="sign='by_sensor'"):
        identify(simulate(tool(sign="by_sensor"), 12), sign="on_sensor")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"sign": "up"}, "on_sensor, by_sensor"),
        ({"outliers": "maybe"}, "trim, keep"),
        ({"noise": (0.0, 1.0)}, "two positive numbers"),
        ({"confidence": 95}, "between 0 and 1"),
        ({"bias": [1, 2]}, "expected \\(6,\\)"),
        ({"inertia": True}, "shows only in motion"),
    ],
)
def test_wrong_arguments(arguments, said):
    with pytest.raises(tw.TwistWrenchError, match=said):
        identify(simulate(tool(), 12), **arguments)


def test_too_few_readings():
    with pytest.raises(tw.ValueRangeError, match="2 readings, and 10 unknowns need at least 3"):
        identify(simulate(tool(), 2))
    identify(simulate(tool(), 3))
    # 13 unknowns of 18 equations, but the forces of three poses, 9 equations, have mass, turn and bias, 7, twice over
    with pytest.raises(tw.ValueRangeError, match="3 readings, and 13 unknowns need at least 4"):
        identify(simulate(tool(), 3), assume="orientation")


@pytest.mark.parametrize("angle", [0.31, 0.7, 1.4, 2.2])
def test_advice_prints_rounding_errors_of_an_axis_as_zero(angle):
    """The tool was turned about (1, 3, 0): no turn within the plane of x and y has a part along z."""
    axis = np.array([1.0, 3.0, 0.0]) / np.sqrt(10.0)
    turns = tw.so3.exp(np.outer([0.0, angle, 0.0], axis))
    log = ReadingLog.from_arrays(np.zeros((3, 6)), gravity=turns @ [0.0, 0.0, -9.81])
    sentence = advice(log, Unknowns())
    _, _, axis_text = sentence.partition("turned about (")
    x, y, z = axis_text.split(")")[0].split(", ")
    assert z == "0" and float(y) == pytest.approx(3.0 * float(x), rel=0.05), sentence


def test_a_turned_mounting_is_found_from_a_log_in_fast_motion():
    """Centripetal accelerations are several times gravity: the first guess of the mounting has to take them off."""
    rng = np.random.default_rng(0)
    load = tw.SpatialInertia.from_com(3.0, (0.02, -0.01, 0.1), 0.02 * np.eye(3))
    sensor = ForceTorqueSensor(load, np.ones(6), mounting=tw.so3.exp([0, 0, 2.8]))
    g, V, dV = rng.normal(size=(40, 3)), 4 * rng.normal(size=(40, 6)), rng.normal(size=(40, 6))
    g *= 9.81 / np.linalg.norm(g, axis=1, keepdims=True)
    readings = sensor.predict(np.eye(3), V, dV, gravity=g) + 0.01 * rng.normal(size=(40, 6))
    found = identify(ReadingLog.from_arrays(readings, gravity=g, V=V, dV=dV), inertia=True, assume="orientation")
    np.testing.assert_allclose(found.sensor.mounting, sensor.mounting, atol=1e-3)
