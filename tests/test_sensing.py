"""The six-axis sensor: readings and their signs, what a log tells and with what confidence, bad logs, contacts."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy import stats

import twistwrench as tw
from twistwrench.sensing import contact
from twistwrench.sensing.directions import gravity_in_frame, rotations_to_gravity
from twistwrench.sensing.identification import identify
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.poses import propose_poses
from twistwrench.sensing.sensor import ForceTorqueSensor, load_regressor
from twistwrench.sensing.simulate import lively_motion, simulate

BIAS = np.array([0.1, 0.2, -0.3, 5.0, -3.0, 8.0])
COM = np.array([0.02, -0.01, 0.1])
INERTIA = np.diag([0.02, 0.025, 0.01])
NOISE = (0.01, 0.3)


def tool(mass=3.0, sign="on_sensor", mounting=None):
    load = tw.SpatialInertia.from_com(mass, COM, INERTIA)
    return ForceTorqueSensor(load, BIAS, sign, np.eye(3) if mounting is None else mounting)


# ── what a sensor reads ──


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


# ── what a log tells ──


@pytest.fixture(scope="module", params=[3.0, 0.2], ids=["3kg", "0.2kg"])
def trials(request):
    """1000 identifications from 12 chosen poses: what came out, and whether the truth was inside the regions."""
    sensor = ForceTorqueSensor(tw.SpatialInertia.from_com(request.param, COM), BIAS)
    rng, R = np.random.default_rng(int(10 * request.param)), propose_poses(12).rotations
    found = [identify(simulate(sensor, R, noise=NOISE, rng=rng)) for _ in range(1000)]
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
    assert min(regions) >= 0.93, regions
    assert max(regions) <= 0.97, regions


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
    found = identify(log, sign="by_sensor", inertia=True, orientation=True)
    assert not found.sensor.load.defects()
    truth = np.concatenate([BIAS, sensor.load.parameters])
    z = (found.fit.estimate[:16] - truth) / np.sqrt(np.diag(found.fit.covariance)[:16])
    assert np.abs(z).max() < 4
    np.testing.assert_allclose(found.turn, turn, atol=4e-3)


def test_coverage_holds_with_inertia_and_mounting():
    turn = np.array([0.02, -0.03, 0.05])
    sensor = tool(mounting=tw.so3.exp(turn))
    exact = simulate(sensor, 60, motion=6.0, noise=(0, 0))
    truth, rng, inside = np.concatenate([BIAS, sensor.load.parameters]), np.random.default_rng(5), []
    for _ in range(250):
        readings = exact.readings + rng.normal(size=(60, 6)) * np.repeat(NOISE, 3)
        log = ReadingLog.of(readings, gravity=exact.gravity, V=exact.V, dV=exact.dV)
        found = identify(log, inertia=True, orientation=True)
        x, C = found.fit.estimate.copy(), found.fit.covariance
        delta = tw.so3.log(sensor.mounting.T @ found.fit.mounting)  # in the sensor's own axes
        r = np.concatenate([x[:16] - truth, delta])
        inside.append(r @ np.linalg.solve(C, r) < 19 * stats.f.ppf(0.95, 19, found.fit.freedom.min()))
    assert 0.91 <= np.mean(inside) <= 0.99  # 250 trials: ± 2.8 % is two deviations


def test_a_mounting_turned_by_a_right_angle_is_found():
    R = tw.so3.exp([0.0, 0.0, math.pi / 2])
    found = identify(simulate(tool(mounting=R), 12), orientation=True)
    assert np.linalg.norm(tw.so3.log(found.fit.mounting.T @ R)) < 0.02


def test_touched_readings_are_left_out_and_named():
    touch = {3: [0, 0.5, 0, 6, 0, 0], 7: [0.2, 0, 0, 0, 0, 5], 8: [0, 0, 0.1, 0, 4, 4]}
    found = identify(simulate(tool(), 12, touch=touch, rng=4))
    assert found.outliers == [3, 7, 8]
    assert "3, 7–8" in " ".join(found.remarks)
    assert abs(found.sensor.load.mass - 3) < 0.05
    spoiled = identify(simulate(tool(), 12, touch=touch, rng=4), outliers="keep")
    assert spoiled.outliers == []
    assert spoiled.noise[1] > 1


def test_a_known_bias_lets_fewer_turns_tell_the_mass():
    R = tw.so3.exp(np.outer([0, 0, 0, 1, 1, 1], [0, 1.0, 0]))
    log = simulate(tool(), R)
    with pytest.raises(tw.ValueRangeError, match="cannot be told apart"):
        identify(log)
    assert identify(log, bias=BIAS).sensor.load.mass == pytest.approx(3, abs=0.1)


def test_known_noise_makes_the_regions_normal():
    found = identify(simulate(tool(), 12), noise=NOISE)
    low, high = found.mass_interval
    k = found.fit.unknowns.names.index("mass")
    assert (high - low) / 2 == pytest.approx(stats.norm.ppf(0.975) * math.sqrt(found.fit.covariance[k, k]), rel=1e-6)


def test_residuals_beyond_the_noise_given_are_remarked_on():
    assert not identify(simulate(tool(), 12), noise=NOISE).remarks
    found = identify(simulate(tool(), 12, noise=(0.03, 0.9)), noise=NOISE, outliers="keep")
    assert "times the noise given" in " ".join(found.remarks)


def test_a_weightless_load_is_not_given_a_place():
    found = identify(simulate(ForceTorqueSensor(tw.SpatialInertia.zero(), BIAS), 12, rng=1))
    assert not np.isfinite(found.com_intervals).any()
    assert "cannot be told from zero" in " ".join(found.remarks)
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
    assert "only. Readings in more and wider orientations" in " ".join(found.remarks)


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


def _log(**changes):
    given = {"readings": np.zeros((4, 6)), "pose": np.tile(np.eye(3), (4, 1, 1))} | changes
    return ReadingLog.of(given.pop("readings"), **given)


SHEARED = np.eye(3) + np.array([[0, 0.2, 0], [0, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"readings": []}, "empty"),
        ({"readings": np.zeros((4, 5))}, r"\(n, 6\)"),
        ({"readings": np.where(np.arange(24) == 9, np.nan, 0.0).reshape(4, 6)}, "fx of reading 1 is nan"),
        ({"pose": np.tile(SHEARED, (4, 1, 1))}, "differs from the identity by 0.2"),
        ({"pose": np.tile(np.diag([1, 1, -1]), (4, 1, 1))}, "mirrors"),
        ({"pose": np.full((4, 3, 3), np.nan)}, "not finite"),
        ({"pose": np.zeros((4, 3))}, "expected rotations"),
        ({"pose": None, "quaternion": np.full((4, 4), 0.6)}, "length 1.2, off from 1 by 0.2"),
        ({"quaternion": np.full((4, 4), 0.5)}, "Keep one"),
        ({"pose": np.tile(np.eye(3), (3, 1, 1))}, "a row for each reading"),
        ({"pose": None, "gravity": [0, 0, 0]}, "gravity is zero"),
        ({"V": np.zeros((4, 6))}, "V and dV come together"),
        ({"time": [0, 1]}, "time has shape"),
    ],
)
def test_bad_logs_say_what_to_do(changes, said):
    with pytest.raises(tw.TwistWrenchError, match=said):
        _log(**changes)


def test_units_that_look_wrong_warn():
    log = simulate(tool(), 12)
    R = rotations_to_gravity(log.gravity)
    for factor, said in (
        (np.array([1, 1, 1, 102, 102, 102]), "grams"),
        (np.array([1000, 1000, 1000, 1, 1, 1]), "N mm"),
    ):
        with pytest.warns(tw.ModelWarning, match=said):
            ReadingLog.of(log.readings * factor, pose=R)
    with pytest.warns(tw.ModelWarning, match="degrees per second"):
        _log(V=np.full((4, 6), 60.0), dV=np.zeros((4, 6)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ReadingLog.of(log.readings, pose=R)


# ── poses ──


def test_chosen_poses_tell_more_than_random_ones():
    chosen = propose_poses(12)
    rng = np.random.default_rng(0)
    logs = [ReadingLog.of(np.zeros((11, 6)), gravity=9.81 * d / np.linalg.norm(d, axis=1, keepdims=True))
            for d in rng.normal(size=(20, 11, 3))]  # fmt: skip
    random = [propose_poses(1, log=log) for log in logs]
    assert chosen.mass_deviation[-1] < np.median([p.mass_deviation[-1] for p in random])
    assert chosen.first_moment_deviation[-1] < np.median([p.first_moment_deviation[-1] for p in random])
    best = NOISE[1] / (9.81 * math.sqrt(12))  # gravity that cancels in the mean
    assert best <= chosen.mass_deviation[-1] < 1.02 * best


def test_next_poses_fill_what_a_log_lacks():
    upright = simulate(tool(), np.tile(np.eye(3), (6, 1, 1)))
    proposal = propose_poses(3, log=upright)
    tilt = np.degrees(np.arccos(-proposal.gravity[:, 2] / 9.81))
    assert tilt[0] > 60
    assert np.isfinite(proposal.mass_deviation[-1])


def test_poses_stay_within_the_tilt_allowed():
    proposal = propose_poses(12, within=math.radians(40))
    assert np.arccos(-proposal.gravity[:, 2] / 9.81).max() <= math.radians(40) + 1e-9
    with pytest.raises(tw.ValueRangeError, match="Allow more"):
        propose_poses(3, candidates=[[0, 0, 1]], within=0.5)
    with pytest.raises(tw.ValueRangeError, match="at least one"):
        propose_poses(0)
    with pytest.raises(tw.ShapeError, match="gravity directions"):
        propose_poses(1, candidates=[1, 2, 3])


# ── contacts ──


def test_the_contact_point_is_found_on_planes_and_balls():
    rng = np.random.default_rng(0)
    r, f = rng.normal(size=(2, 50, 3))
    F = np.concatenate([np.cross(r, f), f], axis=1)
    np.testing.assert_allclose(contact.stray_couple(F), 0, atol=1e-12)
    normal = rng.normal(size=3)
    np.testing.assert_allclose(contact.contact_on_plane(F, r, normal), r, atol=1e-9)
    np.testing.assert_allclose(contact.contact_nearest(F, r), r, atol=1e-9)
    outward = r / np.linalg.norm(r, axis=1, keepdims=True)
    inward = np.where((f * outward).sum(1, keepdims=True) > 0, -f, f)
    F = np.concatenate([np.cross(outward, inward), inward], axis=1)
    np.testing.assert_allclose(contact.contact_on_sphere(F, (0, 0, 0), 1.0), outward, atol=1e-6)


def test_no_contact_point_without_a_force():
    assert np.isnan(contact.contact_on_plane(np.zeros(6), (0, 0, 0), (0, 0, 1))).all()
    assert np.isnan(contact.contact_on_plane([0, 0, 0, 1, 0, 0], (0, 0, 1), (0, 0, 1))).all()
    assert np.isnan(contact.contact_on_sphere([0, 0, 5, 1, 0, 0], (0, 0, 9), 1.0)).all()
    assert contact.stray_couple([0.5, 0, 0, 2, 0, 0]) == pytest.approx(0.5)


def test_false_alarms_come_as_often_as_stated():
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(200_000, 6)) * np.repeat(NOISE, 3)
    known = contact.CollisionThreshold.of_noise(NOISE, 1e-2)
    assert known(noise).mean() == pytest.approx(1e-2, rel=0.1)
    shares = [
        contact.CollisionThreshold.of_residuals(noise[k * 40 : k * 40 + 40], 1e-2)(noise[100_000:104_000]).mean()
        for k in range(400)
    ]
    assert np.mean(shares) == pytest.approx(
        1e-2, rel=0.15
    )  # Hotelling's factor: 40 readings would alarm 3 times as often
    assert known(np.array([0, 0, 0, 0, 0, 1.01 * known.per_axis[5]]))
    assert not known(np.array([0, 0, 0, 0, 0, 0.99 * known.per_axis[5]]))
    with pytest.raises(tw.ValueRangeError, match="at least 8"):
        contact.CollisionThreshold.of_residuals(noise[:5])
    with pytest.raises(tw.ValueRangeError, match="one in a million"):
        contact.CollisionThreshold.of_noise(NOISE, 0.0)


def test_poses_are_proposed_for_the_gravity_that_is_there():
    here, moon = tw.sensing.propose_poses(6), tw.sensing.propose_poses(6, gravity=1.62)
    assert np.allclose(np.linalg.norm(moon.gravity, axis=-1), 1.62)
    assert np.isclose(moon.mass_deviation[-1] / here.mass_deviation[-1], 9.81 / 1.62, rtol=0.05)


def test_a_collision_threshold_errs_on_the_safe_side():
    threshold = tw.sensing.CollisionThreshold.of_noise((0.01, 0.3))
    assert threshold(np.full(6, np.nan)) and not threshold(np.zeros(6))
    noise = np.random.default_rng(0).normal(size=(40, 6))
    noise[:, 4] = 0.0
    with pytest.raises(tw.ValueRangeError, match="fy never changes"):
        tw.sensing.CollisionThreshold.of_residuals(noise)
