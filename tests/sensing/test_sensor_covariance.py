"""The covariances of weighted least squares against what repeated draws of the noise show, seeds fixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sensor_logs import AT_REST, NOISE, drifting, dwells

from twistwrench.core.estimation.covariance import cluster_robust_covariance, variance_estimate_covariance
from twistwrench.sensing.compensation import compensate
from twistwrench.sensing.contact_detection import CollisionThreshold
from twistwrench.sensing.fit import Problem, fit
from twistwrench.sensing.identification import whiteness
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.poses import propose_poses
from twistwrench.sensing.static_poses import static_poses
from twistwrench.sensing.unknowns import Unknowns


def test_the_sandwich_is_unbiased_and_as_uncertain_as_its_degrees_of_freedom_say():
    """Where the noise is what the weights say, E[C] = half half', and var C_kk / E[C_kk]^2 = 2 / freedom_k.

    Of 2500 draws the mean of C_kk is known to about 2 % and its variance to some 6 %; a sandwich without its correction for
    leverage is low by a third.
    """
    rng = np.random.default_rng(1)
    label = np.repeat(np.arange(9), [1, 2, 3, 1, 4, 2, 1, 3, 2])
    A = rng.normal(size=(len(label), 6, 4)) * rng.uniform(0.3, 2.0, (len(label), 1, 1))
    Q, upper = np.linalg.qr(A.reshape(-1, 4))
    half = np.linalg.inv(upper)
    variances = []
    for _ in range(2500):
        e = rng.normal(size=len(Q))
        found = cluster_robust_covariance(Q.reshape(A.shape), (e - Q @ (Q.T @ e)).reshape(-1, 6), half, label)
        assert found is not None
        C, freedom = found
        variances.append(np.diag(C))
    true = np.diag(half @ half.T)
    np.testing.assert_allclose(np.mean(variances, axis=0), true, rtol=0.05)
    np.testing.assert_allclose(np.var(variances, axis=0) / true**2, 2 / freedom, rtol=0.25)


def test_estimated_weights_cost_what_is_added_for_them():
    """One unknown seen by two sets of channels whose variances are estimated, 8 degrees of freedom each.

    The mean of the variance that is claimed is that of the estimates, or a little more: 40000 of them tell it to 0.7 %, the
    first order alone is 1 % off, and ν - 2 for ν, by which regions of several unknowns hold, adds 5 %. Estimated weights add
    a sixth to it.
    """
    rng, freedom = np.random.default_rng(2), 8.0
    groups = np.repeat([0, 1], 3)
    x = rng.normal(size=(40_000, 2))
    v = rng.chisquare(freedom, size=(40_000, 2)) / freedom
    share = (1 / v) / (1 / v).sum(axis=1, keepdims=True)
    estimates = (share * x).sum(axis=1)
    claimed = []
    for k in range(0, 40_000, 10):
        Q = np.zeros((1, 6, 1))
        Q[0, [0, 3], 0] = np.sqrt(share[k])
        claimed.append((1.0 + variance_estimate_covariance(Q, np.full(6, freedom), groups)[0, 0]) / (1 / v[k]).sum())
    assert 0.99 < np.mean(claimed) / np.var(estimates) < 1.07


def test_a_few_readings_at_rest_give_no_more_false_alarms_than_stated():
    """Eight readings, the fewest allowed: a new one is judged with the error of their mean too."""
    rng, shares = np.random.default_rng(3), []
    for _ in range(4000):
        test = CollisionThreshold.of_residuals(rng.normal(size=(8, 6)), 0.3)
        shares.append(test(rng.normal(size=(20, 6))).mean())
    four = 4 * np.std(shares) / np.sqrt(len(shares))
    assert four < 0.027  # without the error of their mean the share is 0.329
    assert abs(np.mean(shares) - 0.3) < four


def test_white_noise_is_called_otherwise_no_more_often_than_stated():
    """Six channels and two tests have twelve chances to look unlike noise; 150 readings, 80 logs."""
    rng = np.random.default_rng(4)
    g = propose_poses(150).gravity
    exact, n = AT_REST.predict(np.eye(3), gravity=g), len(g)
    chances = []
    for _ in range(80):
        log = ReadingLog(exact + NOISE * rng.normal(size=exact.shape), g, time=np.arange(float(n)))
        asked = Problem(log, Unknowns(), 1.0, np.zeros(6), None, np.ones(n), np.zeros(6), 0.0, np.arange(n))
        found = whiteness(fit(asked, keep=np.ones(n, bool)), np.ones(n, bool), np.arange(n))
        assert found is not None
        chances.append(found.chance)
    # 0.2 of them at most have a chance below 0.2; four deviations of that share are 0.18.
    assert np.mean(np.array(chances) < 0.2) < 0.38


def test_a_short_rest_in_a_motion_is_no_dwell():
    """Three slow readings where a motion turns about are readings in motion; six at rest are a dwell."""
    n = 40
    V = np.tile([0.5, 0.0, 0.0, 0.0, 0.1, 0.0], (n, 1))
    V[10:13], V[25:31] = 0.0, 0.0
    gravity = np.column_stack([np.zeros(n), np.sin(0.2 * np.arange(n)), -np.cos(0.2 * np.arange(n))]) * 9.81
    gravity[25:31] = gravity[25]
    found = static_poses(
        ReadingLog.from_arrays(np.zeros((n, 6)), gravity=gravity, V=V, dV=np.ones((n, 6)) * V.any(axis=1)[:, None])
    )
    assert found.count.tolist() == [1.0] * 25 + [6.0] + [1.0] * 9
    assert found.moving.tolist() == [True] * 25 + [False] + [True] * 9


def test_poses_far_apart_are_not_taken_for_a_motion():
    """Whatever is wrong with a log of a hundred poses, each far from the one before, it is not that it moved."""
    log = drifting(np.random.default_rng(5))
    mixed = replace(log, readings=np.roll(log.readings, 50, axis=0))
    found = compensate(mixed, AT_REST, noise=(0.01, 0.3))
    assert "does not explain the log" in str(found.doubts[0])
    assert "motion" not in " ".join(map(str, found.doubts))


@pytest.mark.parametrize("error", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("outliers", [0, 6])
def test_a_robust_fit_finds_the_deviation_of_rows_whether_it_comes_from_readings_or_from_poses(error, outliers):
    """Means of 25 readings have a fifth of their noise, and each pose an error of its own; outliers are ten times as large.

    A deviation by the median of 60 rows is known to 15 %, and that of three channels to 9 %.
    """
    rng = np.random.default_rng(5)
    poses = static_poses(dwells(rng, 60, samples=25, error=error))
    wanted = NOISE * np.hypot(0.2, error)
    log = poses.log
    log.readings[: 2 * outliers : 2] += 10.0 * wanted
    asked = Problem(
        log, Unknowns(), 1.0, np.zeros(6), None, poses.count, poses.within, poses.within_freedom, np.arange(60)
    )
    found = fit(asked, keep=np.ones(60, bool), huber=True)
    for kind in (slice(0, 3), slice(3, 6)):
        share = np.sqrt((found.deviation[:, kind] ** 2).mean() / (wanted[kind] ** 2).mean())
        assert 0.75 < share < (1.25 if outliers == 0 else 1.45), share
    if not outliers:
        plain = fit(asked, keep=np.ones(60, bool))
        assert_allclose(np.sqrt((plain.deviation**2 / wanted**2).mean()), 1.0, atol=0.1)
