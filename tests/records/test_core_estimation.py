"""Estimation on record: covariances, filters, least squares, rates, noise, sampling and glitches."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from recorded_answers import Records

from twistwrench.core.estimation import (
    covariance,
    cross_validation,
    filters,
    least_squares,
    logged_rates,
    noise,
    sampling,
)
from twistwrench.core.estimation.covariance import GroupCovariance, StateCells, Whiteness
from twistwrench.core.estimation.cross_validation import HeldOut, HeldOutRows
from twistwrench.core.estimation.least_squares import NormalEquations, Prior
from twistwrench.core.estimation.sampling import Gap
from twistwrench.core.estimation.single_row_glitches import SingleRowGlitches

pytest_plugins = ("numpy_fixtures",)
records = Records(__file__)


def numbers(*shape, seed=1):
    """Reproducible numbers from -1 to 1."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


def compact(value):
    if isinstance(value, np.ndarray):
        if value.size <= 12 or value.dtype.kind not in "fiub" or not np.isfinite(value).all():
            return value
        entries = value.astype(float).ravel()
        index = np.arange(1.0, len(entries) + 1.0)
        return {
            "shape": value.shape,
            "size": np.abs(entries).sum(),
            "sums": [np.sin(k * index) @ entries for k in (1.0, 1.7, 0.013)],
        }
    if isinstance(value, dict):
        return {key: compact(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [compact(entry) for entry in value]
    if dataclasses.is_dataclass(value):
        return {field.name: compact(getattr(value, field.name)) for field in dataclasses.fields(value)}
    return value


Q24, _ = np.linalg.qr(numbers(24, 4))
Q6 = Q24.reshape(4, 6, 4)
FREEDOM = np.array([5.0, 5.0, 9.0, 2.5, 12.0, 7.0])
GROUPS = np.array([0, 0, 1, 2, 3, 4])


@records.of
def covariances_of_channels_and_clusters():
    half = numbers(3, 4, seed=2)
    Q, _ = np.linalg.qr(numbers(72, 4, seed=3))
    labels = np.array([5, 5, 2, 2, 9, 9, 9, 1, 1, 4, 4, 4])
    e = numbers(12, 6, seed=4)
    lone = np.zeros((4, 6, 1))
    lone[0, 0] = 1.0
    variances = np.array([[1.0, 2.0, 0.5, 0.0, 3.0], [3.0, 0.1, 0.5, 2.0, 1.0]])
    nu = np.array([[4.0, 9.0, 30.0, 5.0, np.inf], [7.0, 3.0, 0.5, 8.0, 6.0]])
    M, s = covariance.cluster_moments(lambda rows: Q.reshape(12, 6, 4)[rows].reshape(-1, 4), e, labels)
    return compact({
        "weight freedom": covariance.weight_freedom(np.array([1.0, 3.0, 6.0, 5.9, 40.0])),
        "of variances": covariance.variance_estimate_covariance(Q6, FREEDOM, GROUPS),
        "of channels": covariance.channel_covariance(Q6, half, FREEDOM, GROUPS), "zero": covariance.channel_covariance(Q6, 0 * half, FREEDOM, GROUPS),
        "f": [covariance.f_test_freedom(np.array(f)) for f in ([5.0, 9.0], [1.0, 9.0, 3.0], [np.inf, np.inf])], "sums": covariance.sum_freedom(variances, nu), "sums of known": covariance.sum_freedom(variances[:, 3:], nu[:, 3:]),
        "clusters": covariance.cluster_robust_covariance(Q.reshape(12, 6, 4), e, half, labels), "alone": covariance.cluster_robust_covariance(lone, numbers(4, 6), np.ones((1, 1)), np.arange(4)), "moments": [M, s],
        "numbers": [covariance.cluster_numbers(labels), covariance.cluster_numbers(np.arange(1000))[-1], covariance.cluster_numbers(np.arange(1001))[[0, 1, 2, 500, 1000]]], "larger": covariance.larger_covariance((np.diag([1.0, 4.0]) + 0.5, np.array([3.0, 4.0])), (np.diag([2.0, 1.0]), np.array([8.0, 9.0]))),
        "quantiles": covariance.student_quantile(np.array([3.0, 1e12]), 0.9), "huber": [covariance._huber_factor(numbers(5, 2), w) for w in (np.ones((5, 2)), np.array([[1, 0.5], [1, 1], [0.25, 1], [1, 1], [1, 1.0]]))] + [covariance._huber_factor(np.array([[0, 1.0], [0, 2.0]]), np.array([[0.5, 1.0], [0.5, 0.8]])), covariance._huber_factor(np.zeros((3, 2)), 0.5 * np.ones((3, 2)))],
    })  # fmt: skip


def correlated(n, columns, share, seed=5):
    x = numbers(n, columns, seed=seed)
    for k in range(1, n):
        x[k] = share * x[k - 1] + (1 - share) * x[k]
    return x


@records.of(relative=1e-6)
def covariances_of_groups_of_parameters():
    n = 160
    t = np.r_[np.arange(100) * 0.02, np.arange(60) * 0.02]
    log = np.repeat([0, 1], [100, 60])
    W = numbers(n, 2, 3, seed=6)
    x = np.array([0.5, -1.25, 2.0])
    e = 0.1 * correlated(n, 2, 0.7)
    tau = W @ x + e
    q, dq = np.stack([np.sin(3 * t), np.cos(2 * t), t], 1), np.stack([np.cos(3 * t), -np.sin(2 * t), 0.3 - t], 1)
    chosen = numbers(n, 2, 2, seed=7) * [0.3, 0.0]
    weights = np.where(np.abs(numbers(n, 2, seed=8)) > 0.9, 0.6, 1.0)
    prior = Prior(np.zeros(3), np.array([10.0, 20.0, 30.0]))
    found = covariance.group_covariance(W, tau, x + 0.01, np.array([0.1, 0.2]), weights, prior, t, log, (q, dq), chosen)
    few = covariance.group_covariance(
        W[:9], tau[:9], x, np.array([0.1, 0.2]), weights[:9], prior, t[:9], log[:9], (q[:9], dq[:9]), chosen[:9, :, :0]
    )
    lone = W.copy()
    lone[1:, :, 2] = 0.0
    one = covariance.group_covariance(
        lone, lone @ x + e, x, np.array([0.1, 0.2]), weights, prior, t, log, (q, dq), chosen[..., :0]
    )
    wide = Prior(np.zeros(3), np.array([10.0, 20.0, 1e7]))
    alone = covariance.group_covariance(
        lone, lone @ x + e, x, np.array([0.1, 0.2]), weights, wide, t, log, (q, dq), chosen[..., :0]
    )
    single = covariance.group_covariance(
        W[:1], tau[:1], x, np.array([0.1, 0.2]), weights[:1], prior, t[:1], log[:1], (q[:1], dq[:1]), chosen[:1, :, :0]
    )
    lone[90:, :, 2] = W[90:, :, 2]
    halved = covariance.group_covariance(
        lone, lone @ x + e, x, np.array([0.1, 0.2]), weights, wide, t, log, (q, dq), chosen[..., :0]
    )
    cells = StateCells.from_residuals(q, dq, e)
    changes = np.array([[0.1, -0.2, 0.3], [0.05, 0.0, 0.0]])
    return compact({
        "alone": alone, "single": single, "halved": halved, "all": found, "few": few, "one row": one, "cells": [cells, cells.count, cells.numbers(q, dq)[::9]], "widened": [found.widened(changes).matrix, found.widened(changes).changes], "first": found.of_first(2), "deviations": [found.deviations, found.half_width(), found.half_width(0.5)],
        "one of three": StateCells.from_residuals(q, dq[:, :1], np.sign(dq[:, :1])), "negative": GroupCovariance(-np.eye(1), np.array([0.5]), np.ones(1), 1.0).half_width(),
        "lengths": [covariance.autocorrelation_length(correlated(200, 2, s)) for s in (0.0, 0.5, 0.95)], "correlations": covariance.autocorrelation(correlated(50, 1, 0.5)[:, 0], 4),
    })  # fmt: skip


@records.of
def whiteness_of_residuals():
    found = []
    for n, share in ((60, 0.0), (60, 0.6), (99, 0.9), (120, 0.0), (120, 0.5), (150, -0.6)):
        Q, _ = np.linalg.qr(numbers(n * 3, 2, seed=9))
        e = numbers(n, 3, seed=10)
        e[:, 1] = correlated(n, 1, share, seed=11)[:, 0]
        if n == 150:
            e[9:, 1] += 1.5 * e[:-9, 1]
        w = Whiteness.from_residuals(e, Q.reshape(n, 3, 2), ["x", "y", "z"])
        found.append([w, w.white])
    return [*found, covariance._mean_of_neighbours(np.array([1.0, 3.0, 7.0]))]


@records.of
def filters_of_samples():
    x = np.cumsum(numbers(150, 2, seed=12), axis=0) + 3.0
    t = np.arange(150.0) * 0.01 + 5.0
    spline = filters.UniformSpline.from_samples(t[:12], x[:12])
    long = np.cumsum(numbers(3000, seed=13))
    at = np.array([0, 40, 800, 1500, 1530, 2950, 2999])
    return compact({
        "low pass": [filters.low_pass(x, c, 100.0) for c in (5.0, 20.0, 44.9, 45.0)] + [filters.low_pass(x[:7, 0], 3.0, 100.0)], "some": filters.low_pass_at(long, 4.0, 100.0, at), "same": np.abs(filters.low_pass_at(long, 4.0, 100.0, at) - filters.low_pass(long, 4.0, 100.0)[at]).max() < 1e-9,
        "few": filters.low_pass_at(x, 4.0, 100.0, np.array([3, 70])), "lagged": [filters.lagged(x, 7.5), filters.lagged(x, 2.0, np.array([1.0, -2.0])), filters.lagged(x[:, 0], 3.0, np.array(0.5))[:4]],
        "spline": [spline, spline(np.array([4.99, 5.0, 5.034, 5.11, 5.12])), spline.slope(np.array([5.0, 5.034, 5.11]))], "response": filters._zero_phase_response(0.05, 30),
    })  # fmt: skip


@records.of(relative=1e-6)
def least_squares_of_rows():
    W, x = numbers(40, 2, 3, seed=14), np.array([0.5, -1.25, 2.0])
    tau = W @ x + [0.05, 0.3] * numbers(40, 2, seed=15)
    tau[7, 0] += 4.0
    tau[20, 1] -= 9.0
    active = np.array([[True, True, False], [True, True, True]])
    prior = Prior(np.array([0.4, -1.0, 0.5]), np.array([1.0, 3.0, 0.2]))
    rows = np.arange(3, 40, 2)
    root = 0.5 + np.abs(numbers(40, 2, seed=16))
    equations = NormalEquations.from_rows(W, tau, active, root, rows)
    other = NormalEquations.from_rows(W[:5], tau[:5])
    parts = [(W[k].T @ W[k], W[k].T @ tau[k], float(tau[k] @ tau[k])) for k in (0, 1, 2)]
    A = numbers(9, 2, 4, seed=17)
    A[:, :, 2] = 0.0
    return compact({
        "equations": equations, "sum": equations + other, "difference": (equations - other).c, "together": other.together(), "whitened": other.whitened(np.array([0.5, 2.0])), "squares": [other.squares(x), other.squares(x * 0)], "solved": [equations.solve(prior), NormalEquations(other.N * 0, other.c * 0, other.y * 0, 0.0).solve(prior)],
        "fits": {m: least_squares.weighted_fit(W, tau, prior, m, active, r) for m in ("irls", "wls", "ols") for r in (rows,)}, "all rows": least_squares.weighted_fit(W, tau, prior, "irls"), "prior": prior.solve(other.N.sum(axis=0), other.c.sum(axis=0)),
        "parts": [least_squares.sum_of(parts), list(least_squares.left_out(parts)), list(least_squares.left_out(parts[:1])), least_squares.squares_of(parts[1], x)], "huber": [least_squares.huber_weights(np.array([0.0, 1.3, 1.4, 5.0])), least_squares.huber_weights(np.array([2.0]), 4.0)],
        "positive": least_squares.solve_positive(np.array([[4.0, 1.0], [1.0, 9.0]]), np.array([1.0, 2.0]), np.array([2.0, 3.0])), "orthogonal": least_squares.orthogonal_fit(A, numbers(9, 2, seed=18), 0.5 + np.abs(numbers(9, 2, seed=19)), np.array([1.0, 2.0, 3.0, 0.5])),
        "null": [least_squares.null_combinations(np.array(a, float)) for a in ([[1, 2, 0, 0], [0, 0, 1, -1]], [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], [[1, 1, 1], [2, 2, 2], [3, 3, 3], [1, 1, 1.0]])] + [least_squares.null_combinations(np.zeros((2, 0)))],
    })  # fmt: skip


@records.of
def held_out_rows():
    rows = HeldOutRows(np.arange(4.0), np.zeros(4), 1.0 + numbers(4, 3), 1.0 + 0.9 * numbers(4, 3) + [[0.1, -0.2, 0.3]])
    rows.measured[:, 2] = 0.0
    found = HeldOut.from_rows("test", rows, ["shoulder", "elbow", "zero"])
    both = found + HeldOut.from_rows(
        "five-fold", HeldOutRows(rows.time, rows.log, 2 * rows.measured, rows.predicted), ["shoulder", "elbow", "zero"]
    )
    nothing = HeldOut("test", np.ones(1), np.zeros(1), ["a"])
    return compact(
        {
            "text": str(found).splitlines(),
            "sum": [both.kind, both.squares, both.sizes, len(both.rows), both.all],
            "joints": found.joints,
            "tiny": nothing.all > 1e100,
            "folds": cross_validation.FOLDS,
        }
    )


T = np.arange(400) * 0.01
X = np.stack([np.sin(2 * T), 0.5 * np.cos(3 * T), 0.3 * T, 0.2 + 0 * T], 1)
Y = np.stack([2 * np.cos(2 * T), -1.5 * np.sin(3 * T), 0.3 + 0 * T, 0 * T], 1)


@records.of
def scales_and_delays_of_rates():
    turns = np.array([True, True, False, False])
    gap = np.where(T > 2.0, T + 0.3, T)
    slow = np.array([1.0, 1.0, 1.0, 0.0])
    fast = np.stack([np.cos(300 * T)] * 4, 1)

    def delayed(d):
        return np.stack([np.interp(T - d, T, column) for column in Y.T], 1)

    return compact({
        "segments": [[(s.start, s.stop) for s in logged_rates.segments(t)] for t in (T[:7], T[:8], gap, np.arange(1100) * 0.01, np.r_[T[:5], T[:20] + 9])],
        "scales": [logged_rates.rate_scales([(T, X, Y * f)], turns) for f in (1.0, np.array([2.0, -1.0, 0.5, 3.0]))], "runs": logged_rates.rate_scales([(T[:200], X[:200], Y[:200]), (T[200:], X[200:], 3 * Y[200:])], turns), "none": logged_rates.rate_scales([(T[:5], X[:5], Y[:5])], turns),
        "stands": [logged_rates.rate_scales([(T, X, Y + np.array([0, 0, 0, v]))], turns) for v in (0.045, 0.055)], "little": [logged_rates.rate_scales([(T, np.c_[X[:, :1], f * X[:, 1:2], X[:, 2:]], np.c_[Y[:, :1], 2 * f * Y[:, 1:2], Y[:, 2:]])], turns) for f in (0.035, 0.045)], "rounded": logged_rates.rate_scales([(T, np.round(X / 0.03) * 0.03, 2 * Y)], turns), "noisy": logged_rates.rate_scales([(T, X + [0.1, 0.001, 0.01, 0] * numbers(400, 4), 2 * Y)], turns),
        "aliased": logged_rates.rate_scales([(T, X, fast)], turns), "gap": logged_rates.rate_scales([(gap, X, Y)], turns),
        "delays": [logged_rates.rate_delays([(T, X, delayed(d) * slow)], 4) for d in (0.03, 0.05, -0.2, 0.5, 0.65)], "bias": logged_rates.rate_delays([(T, X, delayed(0.1) + np.array([0.3, -0.2, 0.1, 0.0]))], 4), "short": [logged_rates.rate_delays([(T[:n], X[:n], delayed(0.1)[:n])], 4) for n in (150, 260)], "slow steps": logged_rates.rate_delays([(8 * T[:200], X[:200], delayed(0.09)[:200])], 4), "two runs": logged_rates.rate_delays([(T, X, delayed(0.1)), (T[:1], X[:1], Y[:1])], 4), "apart": logged_rates.rate_delays([(gap, X, delayed(0.1))], 4),
    })  # fmt: skip


@records.of
def sampling_of_logs():
    held = X[np.arange(400) // 4 * 4]
    irregular = X[np.minimum(399, np.cumsum(np.arange(400) % 7 > 3) * 2)]
    straight = np.stack([np.interp(T, T[::5], c[::5]) for c in X.T], 1)
    encoder = np.round(X[:, :1] / 0.05) * 0.05
    late = np.stack([np.interp(np.where(T < 2, T, T - 0.05), T, c) for c in X.T[:3]], 1)
    early = np.stack([np.interp(np.where((T < 1) | (T > 3), T, T + 0.07), T, c) for c in X.T[:3]], 1)
    stuck = X[np.where((np.arange(400) > 150) & (np.arange(400) < 155), 150, np.arange(400))][:, :3]
    one = X[:, :3].copy()
    one[200, 1] += 0.3
    one[120:, 0] += 0.2
    twice = X[:, :3].copy()
    twice[200] += 0.3
    twice[120:123] += [[0.2], [0.5], [0.1]]
    single = X[:, :1].copy()
    single[120:] += 0.2
    pause = np.where(T > 2.0, T + 0.5, T)
    tau = np.stack([3 + np.sin(7 * T), np.cos(9 * T), 2 * np.sin(5 * T)], 1)
    constant = tau.copy()
    constant[100:140, 0] = 3.5
    constant[200:231, 1] = 0.25
    constant[300:330, 1] = 0.25
    constant[50:90, 2] = tau[:, 2].max()
    unpowered = tau.copy()
    unpowered[100:150] = 0.0
    spiky = tau.copy()
    spiky[[40, 90, 91], [0, 1, 1]] += [6, 7, 7.5]
    cut = np.clip(tau[:, 0], -9, 3.9)
    gap = [Gap(1.0, 0.05), Gap(2.0, -0.05), Gap(2.7, 0.06, 3), Gap(3.1, -0.04)]
    return compact({
        "pauses": [sampling.pauses(t, m) for t, m in ((pause, 0.0), (pause, 0.6), (T[:1], 0.0), (np.r_[0, 1, 2, 6.9, 7.9, 13.1], 0.0))], "new": [None if (r := sampling.new_rows(x)) is None else np.flatnonzero(r)[:4] for x in (held, irregular, straight, encoder, X, held[:59], X[np.arange(400) // 2 * 2], X[:, 3:])],
        "changes": [sampling._have_equal_intervals(np.arange(n) % 3 == 0) for n in (58, 61, 64)],
        "moves": sampling.moves(np.c_[X, X[:, 0] + 0.3 * numbers(400), 1e-3 * numbers(400)]), "two rows": sampling.moves(X[:2]),
        "gaps": [sampling.gaps(T[: len(q)], q) for q in (late, early, stuck, one, single, X, X[:9], X[:, 3:], twice)] + [sampling.gaps(pause, late)], "held": sampling.held_rows(T, sampling.gaps(T, stuck)).nonzero(),
        "by turns": [sampling.late_by_turns(g, 0.5, 4.0) for g in (gap, gap[:1], [*gap, Gap(3.5, np.nan)], [*gap, Gap(3.3, np.nan), Gap(3.5, 0.2)], [gap[0], gap[2], gap[1]], gap[1:])], "spikes": np.argwhere(sampling.spikes(spiky)), "still": sampling.spikes(np.ones((5, 2))).sum(),
        "dropouts": [[(int(r[0]), int(r[1])) for r in np.argwhere(np.diff(m.astype(int), axis=0))] for m in (sampling.dropouts(T, x, X[:, :3]) for x in (constant, unpowered, tau, np.repeat(tau[::3], 3, axis=0)[:400]))], "unmoved": sampling.dropouts(T, constant, np.c_[X[:, :1] * 0, X[:, :2]]).sum(axis=0),
        "cut": [sampling.cut_off(x) for x in (cut, -cut, tau[:, 0], np.clip(tau[:, 1], -9, 0.999), np.zeros(50), np.clip(tau[:, 0], -9, 0.0), np.r_[np.ones(29), np.arange(9) / 10], np.r_[np.ones(31), np.arange(9) / 10])],
    })  # fmt: skip


@records.of
def glitches_of_single_rows():
    def found(q, t=T[:80], portions=(80,), turns=(True, False)):
        glitches = SingleRowGlitches(2, np.array(turns))
        begin = 0
        for end in portions:
            glitches.add(t[max(0, begin - 6) : end], q[max(0, begin - 6) : end])
            begin = end
        return {"result": glitches.result(), "times": glitches.times(), "stamps": glitches.stamps()}

    q = np.stack([np.sin(2 * T[:80]), 0.4 * np.cos(3 * T[:80])], 1)

    def wrong(rows, columns, by):
        x = q.copy()
        x[rows, columns] += by
        return x

    stamp = T[:80].copy()
    stamp[33] += 0.004
    turned = np.c_[np.mod(4 * T[:80] + 2, math.tau), q[:, 1]]
    turned[50, 0] += 0.1
    flicker = np.round(q / 0.002) * 0.002
    flicker[40, 0] += 0.006
    return {
        "one": found(wrong(30, 0, 0.01)), "two": found(wrong([20, 60], [1, 1], [0.02, -0.03])), "in a row": found(wrong([30, 31], [0, 0], 0.02)), "small": [found(wrong(30, 0, x))["times"] for x in (5e-4, 1.2e-3)], "early and late rows": [found(wrong(k, 0, 0.02))["times"] for k in (2, 3, 76, 77)],
        "stamp": found(q, stamp), "of one joint": found(np.c_[q[:, 0], 0 * T[:80]], stamp), "over a turn": [found(turned)["times"], found(turned, turns=(False, False))["times"]], "portions": [found(wrong([38, 41], [0, 1], 0.02), portions=p) for p in ((40, 80), (43, 80), (20, 41, 80))],
        "beside a pause": found(wrong(30, 0, 0.02), np.where(np.arange(80) > 31, T[:80] + 0.2, T[:80])), "flicker": found(flicker)["times"], "few": found(q[:6], T[:6], (6,)), "rough": found(q + 0.01 * numbers(80, 2))["times"],
    }  # fmt: skip


@records.of(relative=1e-6)
def noise_of_columns():
    n = 300
    t = np.arange(n) * 0.01
    uneven = t + 0.002 * numbers(n, seed=20)
    smooth = np.stack([np.sin(2 * t), 0.3 * t**2, np.cos(3 * t), 0 * t + 1.5], 1)
    noisy = smooth + 1e-3 * np.array([1.0, 2.0, 0.5, 0.0]) * numbers(n, 4, seed=21)
    grid = np.round(noisy / [0.002, 0.001, 1e-9, 1]) * [0.002, 0.001, 1e-9, 1]
    encoder = np.round(smooth[:, :1] * 3 / (2 * np.pi / 4096)) * (2 * np.pi / 4096)
    shaken = np.stack([np.sin(2 * (t + 0.002 * numbers(n, seed=22))), np.cos(5 * (t + 0.002 * numbers(n, seed=22)))], 1)
    glitch = noisy.copy()
    glitch[100, 0] += 0.5
    found = noise.survey([t], [grid])
    errors = noise.sample_errors([t], [np.c_[shaken, noisy[:, :1]]], noise.survey([t], [np.c_[shaken, noisy[:, :1]]]))
    gridded = noise.sample_errors([t[:150], t[150:]], [grid[:150], grid[150:]], found)
    drawn = errors.drawn(np.random.default_rng(3), shaken[:5][:, [0, 1, 0]], shaken[:5][:, [1, 0, 1]], 2)
    return compact({
        "surveys": [noise.survey([t], [noisy]), found, noise.survey([uneven], [noisy]), noise.survey([t], [smooth]), noise.survey([t[:1]], [smooth[:1]]), noise.survey([t], [glitch]), noise.survey([t[:100], t[100:]], [encoder[:100], encoder[100:]])], "error": found.error,
        "quanta": [noise.quantum([x]) for x in (grid[:, 0], encoder[:, 0], smooth[:, 0], np.ones(50), np.repeat(np.arange(40.0) % 7, 3), np.round(noisy[:, 0], 3)[:40])], "decimals": [noise._decimal_grid(np.array(x), max(map(abs, x))) for x in ([1.0, 2.5], [1.25, 3.0], [1 / 3, 0.5], [10.0, 20.0], [0.001, 1000.0])],
        "steps": [noise._common_step(np.array(x)) for x in ([0.1] * 20 + [0.2] * 20, [0.1] * 10 + [0.2] * 10, [0.1] * 20 + [0.2] * 20 + [0.25], [0.1, 0.101] * 20, [0.1] * 40 + [3.0])], "noise": [noise.noise([t], [noisy], 0.0), noise.noise([t[:3]], [noisy[:3]]), noise.noise([uneven[:40]], [noisy[:40]])],
        "deviation": [noise.deviation(np.r_[numbers(60, 2), [[9.0, 0.0]] * k], np.array([0.0, 1.0])) for k in (1, 7, 8, 30)] + [noise.deviation(np.r_[numbers(60, 2), [[9.0, 0.0]]], np.array([10.0, 0.0]))], "differences": [noise.differences(u, noisy[:9], o) for u, o in ((t[:9], 3), (uneven[:9], 5))],
        "errors": [errors, gridded, errors.scaled(np.array([2.0, 3.0, 4.0])), errors.at_rest, gridded.at_rest, errors.deviation(np.array([[1.0, 2.0, 3.0], [0.0, -5.0, 0.5]]))], "drawn": drawn, "drawn on a grid": gridded.drawn(np.random.default_rng(4), smooth[:3], smooth[:3], 2), "no speed": noise._split_variance(numbers(60, 1)[:, 0], np.zeros(60), rounding=1e-4), "at rest": noise.sample_errors([t], [np.tile([0.3], (n, 1)) + 1e-3 * numbers(n, 1)], noise.survey([t], [np.tile([0.3], (n, 1)) + 1e-3 * numbers(n, 1)])), "short": noise.sample_errors([t[:30]], [noisy[:30]], noise.survey([t[:30]], [noisy[:30]])),
    })  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
