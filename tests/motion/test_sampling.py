"""Faults of a log that are seen without a model: repeated and late rows, rows cut out, spikes; and logs that have none."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.core.estimation.sampling import cut_off, moves

ARM = tw.robots.planar_3r()
HZ = 250.0
T = np.arange(5000) / HZ


def series(seed, t=T):
    """Positions (n, 3) of five harmonics of 0.1 Hz."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 5, 3))
    w = 0.2 * np.pi * np.arange(1, 6)[:, None, None] * t[:, None]
    return 0.4 * (np.sin(w) * a[:, None] + np.cos(w) * b[:, None]).sum(axis=0)


def torques(seed, t=T):
    q = series(seed, t)
    return 5.0 * np.sin(q) + 0.1 * np.random.default_rng(seed).normal(size=q.shape)


def doubts(q, tau=None, t=T, kinds=("repeated", "buffered", "pause", "spikes", "dropout")):
    found = tw.Motion(t, q, tau=tau, robot=ARM, in_seconds=True).doubts
    return [doubt for doubt in found if doubt.kind in kinds]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("every", [3, 4, 10])
@pytest.mark.parametrize("between", ["held", "lines"])
def test_repeated_rows_have_the_rate_at_which_they_were_measured(seed, every, between):
    q = series(seed)
    rows = np.arange(len(T)) // every * every
    q = q[rows] if between == "held" else np.stack([np.interp(T, T[::every], x) for x in q[::every].T], axis=1)
    (found,) = doubts(q, torques(seed))
    assert (found.kind, found.level, found.unit) == ("repeated", "unsure", "Hz")
    assert found.value == pytest.approx(HZ / every, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("late", [0.05, 0.1, 0.2])
def test_positions_that_are_late_by_turns_have_their_delay(seed, late):
    edges = np.cumsum(np.random.default_rng(seed).uniform(0.5, 2.0, 40))
    waits = np.searchsorted(edges, T) % 2 == 1
    (found,) = doubts(np.where(waits[:, None], series(seed, T - late), series(seed)), torques(seed))
    assert (found.kind, found.unit) == ("buffered", "ms")
    assert found.value == pytest.approx(1e3 * late, rel=0.1)


def test_positions_that_are_late_by_turns_are_so_for_a_share_of_the_time():
    """Late from 4 to 9 s and from 13 to 20 s: twelve seconds of twenty."""
    waits = ((T >= 4.0) & (T < 9.0)) | (T >= 13.0)
    (found,) = doubts(np.where(waits[:, None], series(1, T - 0.1), series(1)), torques(1))
    (share,) = re.findall(r"in ([\d.]+) % of the time", found.sentence)
    assert float(share) == pytest.approx(60.0, abs=1.0)


def test_a_share_of_the_time_is_a_range_where_changes_were_not_seen():
    """Changes while the arm is slow are not seen: the true share is within the range in 95 % of logs, but for 3 points."""
    held, widths = [], []
    for seed, late in itertools.product(range(20), (0.05, 0.2)):
        edges = np.cumsum(np.random.default_rng(100 + seed).uniform(0.5, 2.0, 40))
        waits = np.searchsorted(edges, T) % 2 == 1
        (found,) = doubts(np.where(waits[:, None], series(seed, T - late), series(seed)), torques(seed))
        (text,) = re.findall(r"in ([\d. to]+) % of the time", found.sentence)
        shares = [float(share) for share in text.split(" to ")]
        held.append(shares[0] - 3.0 <= 100.0 * waits.mean() <= shares[-1] + 3.0)
        widths.append(shares[-1] - shares[0])
    assert np.mean(held) >= 0.95
    assert np.median(widths) < 15.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("lost", [0.5, 2.0])
def test_rows_that_were_cut_out_are_seen_where_their_stamps_were_closed_up(seed, lost):
    kept = (T < 9.0) | (9.0 + lost <= T)
    (found,) = doubts(series(seed)[kept], torques(seed)[kept], T[: kept.sum()])
    assert (found.kind, found.unit) == ("pause", "s")
    assert found.value == pytest.approx(9.0, abs=0.01)
    assert doubts(series(seed)[kept], torques(seed)[kept], T[kept]) == []


@pytest.mark.parametrize("share, level", [(0.002, "note"), (0.03, "unsure")])
def test_spikes_are_counted(share, level):
    rng = np.random.default_rng(1)
    tau, rows = torques(1), np.arange(3, len(T), round(1 / share))
    tau[rows, 1] += rng.choice([-50.0, 50.0], len(rows))
    (found,) = doubts(series(1), tau)
    assert (found.kind, found.level, found.joints, found.value) == ("spikes", level, ("joint2",), len(rows))


@pytest.mark.parametrize("value", [0.0, 1.7])
def test_a_torque_that_drops_out_is_named_with_its_time(value):
    """Zero, or the last number, for two seconds."""
    tau, out = torques(1), (T >= 7.0) & (T < 9.0)
    tau[out, 1] = value
    (found,) = doubts(series(1), tau)
    assert (found.kind, found.joints) == ("dropout", ("joint2",))
    assert found.value == pytest.approx(2.0, abs=0.01)
    assert "first at t = 7.0000 s" in found.sentence
    unpowered = np.where(out[:, None], value, tau)
    assert doubts(series(1), unpowered) == []
    at_rest = series(1, np.minimum(T, 7.0) + np.maximum(T - 9.0, 0.0))
    assert doubts(at_rest, tau) == []


def test_positions_that_become_late_are_not_missing_rows():
    """Rows cannot be missing where all joints step back."""
    late = np.where((T > 10.0)[:, None], series(3, T - 0.06), series(3))
    (found,) = doubts(late, torques(3))
    assert found.kind == "pause" and "60 ms late from there on" in found.sentence


def test_noise_is_not_motion():
    noise = 1e-6 * np.random.default_rng(0).normal(size=(5000, 20))
    assert not moves(noise).any() and not moves(0.0 * noise).any()
    assert moves(series(0) * 1e-2 + noise[:, :3]).all()


def clean_logs(seeds):
    """Logs without a fault: noise, grids, missing rows, shaken stamps, rests, corners, steady speeds."""
    for seed in seeds:
        rng, q, tau = np.random.default_rng(seed), series(seed), torques(seed)
        yield f"exact {seed}", T, q, tau
        yield f"noise {seed}", T, q + 1e-3 * rng.normal(size=q.shape), tau
        yield f"grid {seed}", T, q.round(3), tau.round(1)
        yield f"coarse grid {seed}", T, q.round(2), tau.round(0)
        kept = rng.random(len(T)) > 0.3
        yield f"missing {seed}", T[kept], q[kept], tau[kept]
        yield f"shaken {seed}", T + rng.uniform(-1e-3, 1e-3, len(T)), q, tau
        yield f"slow {seed}", T[::10], q[::10], tau[::10]
        rest = np.minimum(T, 6.0) + np.maximum(T - 12.0, 0.0)
        yield f"rest {seed}", T, series(seed, rest).round(4), torques(seed, rest).round(1)
        points = rng.uniform(-1, 1, (12, 3))
        corners = np.stack([np.interp(T, np.linspace(0, 20, 12), x) for x in points.T], axis=1)
        yield f"corners {seed}", T, corners, tau
        yield f"counts of corners {seed}", T, corners.round(3), tau
        yield f"still {seed}", T, 0 * q + 0.3, tau
        yield f"one joint {seed}", T, corners * [1.0, 0.0, 0.0], tau
        sign = np.sign(np.gradient(corners, axis=0))
        yield f"friction {seed}", T, corners, 3.0 * sign + 0.05 * rng.normal(size=q.shape)


@pytest.mark.parametrize("seeds", mostly_slow([range(2), range(2, 4)], 2))
def test_logs_without_a_fault_have_no_doubts(seeds):
    named = [(name, str(doubt)) for name, t, q, tau in clean_logs(seeds) for doubt in doubts(q, tau, t)]
    assert named == []


def test_columns_that_are_cut_off_are_told_from_coarse_ones():
    rng = np.random.default_rng(0)
    for x in (torques(0).T[0], rng.normal(size=5000).round(0), np.sin(T).round(1), np.ones(5000), np.zeros(5000)):
        assert cut_off(x) is None
    for x, extreme in ((np.clip(torques(0)[:, 0], -9, 3.0), 3.0), (np.clip(torques(0)[:, 0], -2.5, 9), -2.5)):
        found = cut_off(x)
        assert found is not None
        assert found[0] == extreme
        assert found[1] == pytest.approx((x == extreme).mean())


# ── In an identification


@pytest.fixture(scope="module")
def log():
    q = series(2)
    motion = tw.Motion(T, q, robot=ARM)
    return q, motion.torques() + 0.2 * np.sign(motion.dq) + 0.02 * np.random.default_rng(2).normal(size=q.shape)


def identified(q, tau, t=T):
    given = tw.Motion(t, q, tau=tau, robot=ARM, in_seconds=True)
    settings = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
    return tw.identification.identify(ARM, given, motor_inertia=False, **settings)


@pytest.mark.parametrize("fault", ["pause", "repeated", "spikes"])
def test_rows_are_cut_or_parted_before_a_fit(log, fault):
    q, tau = log
    t, rows = T, np.arange(len(T))
    if fault == "pause":
        rows, t = rows[(T < 9.0) | (T >= 11.0)], T[:4500]
    elif fault == "repeated":
        q = q[rows // 10 * 10]
    else:
        tau = tau.copy()
        tau[7::200, 0] += 100.0
    found = identified(q[rows], tau[rows], t)
    assert found.doubts[0].kind == fault
    assert not found.doubts[0].refuses
    assert found.held_out.all < 0.03


@pytest.mark.parametrize("count", [3, 5])
def test_samples_that_were_held_are_called_repeated_and_not_missing(count, tmp_path):
    """Steps of 0, …, 0 and then the whole: no row is missing, and the clock did not stop."""
    robot = tw.robots.ur5()
    t = np.arange(0, 8, 0.01)
    q = 0.4 * np.sin(t[:, None] * np.arange(1, 7) / 2 + np.arange(6))
    held = q.copy()
    held[300 : 300 + count] = held[299]
    said = [doubt for doubt in tw.Motion(t, held, robot=robot).doubts if doubt.kind in ("held", "pause")]
    assert [(doubt.kind, doubt.value) for doubt in said] == [("held", float(count))]
    kept = (t < 3.0) | (t >= 3.0 + 0.01 * (count + 1))
    cut = tw.Motion(t[: int(kept.sum())], q[kept], robot=robot)
    assert [doubt.kind for doubt in cut.doubts if doubt.kind in ("held", "pause")] in (["pause"], [])
