"""Information of long logs: streamed in pieces it is that of the whole, it adds up, and it comes back from its file."""

from __future__ import annotations

import importlib
from itertools import pairwise

import numpy as np
import pytest
from identification_logs import known_log
from numpy.testing import assert_allclose, assert_array_equal
from quick import mostly_slow

import twistwrench as tw
from twistwrench.core.estimation.least_squares import NormalEquations
from twistwrench.identification import NormalEquationBlocks, accumulate, streaming
from twistwrench.identification import chunks as log_source
from twistwrench.identification.chunks import LogClock, LogSource, steady_windows
from twistwrench.identification.normal_equation_blocks import MOST_BLOCKS
from twistwrench.identification.rows import FilteredRows, SteadySamples

ARM = tw.robots.planar_2r()
FIXED = {"cutoff": 8.0, "shift": 0.003, "friction_speed": 0.05}


@pytest.fixture(scope="module")
def log():
    return known_log(ARM, 3, seconds=120.0, rate=250.0).motion


@pytest.fixture(scope="module")
def gathered(log):
    """Of the whole log, settings fixed."""
    return accumulate(ARM, log, **FIXED)


@pytest.fixture
def small_pieces(monkeypatch):
    """Pieces and chunks far shorter than the log."""
    for module in (log_source, streaming):
        monkeypatch.setattr(module, "CHUNK", 7000)
    monkeypatch.setattr(streaming, "LEAST_CORE", 2000)
    monkeypatch.setattr(streaming, "CORE", 500)


def equations(information):
    return information.moments.equations(information.frame, 0, slice(None))


def recorded(path, motion, columns=()):
    """As records of numbers in an npy file."""
    names = ["time", *ARM.coordinate_names, *(f"{n}.tau" for n in ARM.joint_names)]
    table = np.column_stack([motion.time, motion.q, motion.tau])
    records = np.zeros(len(table), [(name, float) for name in names])
    for name, values in zip(names, table.T, strict=True):
        records[name] = values
    np.save(path, records)
    return path


def test_rows_are_those_of_the_whole_log_in_memory(log, gathered):
    """W and τ of :class:`FilteredRows`, whose settings are fixed; filters of chunks begin 16 periods outside, where what they
    begin with is below 1e-16, and derivatives of that are below 1e-10 of the columns."""
    streamed = gathered
    base = streamed.frame.base
    rows = FilteredRows.from_samples(
        base, [SteadySamples.from_arrays(log.time, log.q, log.tau, "log")], 8.0, np.full(2, 0.05)
    )
    whole = NormalEquations.from_rows(rows.W, rows.torques(0.003))
    found = equations(streamed)
    assert found.rows == whole.rows == len(rows.W)
    for a, b in ((found.N, whole.N), (found.c, whole.c), (found.y, whole.y)):
        assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
    frame, tau = streamed.frame, rows.torques(0.003)
    left = np.abs(tau - rows.W @ frame.x[: base.count]) / frame.sigma
    huber = NormalEquations.from_rows(rows.W, tau, root=np.sqrt(np.minimum(1.0, 1.345 / left)))
    weighted = streamed.moments.equations(frame, 1, slice(None))
    assert frame.robust and (left > 1.345).any()
    for a, b in ((weighted.N, huber.N), (weighted.c, huber.c), (weighted.y, huber.y)):
        assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
    x, sigma = whole.solve(streamed.weak)
    wls = accumulate(ARM, log, **FIXED, method="wls")
    assert_allclose(wls.values, x, rtol=1e-9, atol=1e-9 * np.abs(x).max())
    assert sigma.all()


def test_pieces_say_what_the_whole_says(log, gathered, small_pieces, monkeypatch, tmp_path):
    """A file read in seventeen chunks of five pieces, against the motion in one."""
    monkeypatch.setattr("twistwrench.motion.log_table.LARGE", 0)
    in_pieces = accumulate(ARM, recorded(tmp_path / "log.npy", log), **FIXED)
    assert in_pieces.moments.counts.shape[0] == 4 * 12 + 3
    a, b = equations(in_pieces), equations(gathered)
    assert a.rows == b.rows and in_pieces.samples == len(log)
    assert_allclose(a.N, b.N, rtol=1e-9, atol=1e-9 * np.abs(b.N).max())
    assert_allclose(in_pieces.values, gathered.values, rtol=1e-9, atol=1e-9 * np.abs(gathered.values).max())


def test_chunks_own_every_sample_once(log):
    """Of a log with a pause, cut anywhere."""
    late = log.time + np.where(log.time > 50.0, 30.0, 0.0)
    paused = tw.Motion(late, log.q, log.dq, log.ddq, log.tau, robot=ARM, in_seconds=True)
    for motion in (log, paused):
        clock = LogClock.from_times(motion.time, "log")
        source = LogSource(ARM, "log", motion=motion)
        owned = [(w.stretch, *w.own) for w in steady_windows(source, clock, 999, 400, 0, len(motion))]
        assert sum(b - a for _, a, b in owned) == len(motion)
        for s in range(len(clock.begins)):
            mine = [(a, b) for stretch, a, b in owned if stretch == s and a < b]
            assert all(b == c for (_, b), (c, _) in pairwise(mine))


@pytest.mark.slow
def test_weeks_add_up(log, tmp_path):
    """Two halves, the second gathered like the first and added a week later, against a fit of both."""
    first = accumulate(ARM, log[:15000])
    kept = NormalEquationBlocks.load(first.save(tmp_path / "week.npz"), ARM)
    assert_array_equal(kept.values, first.values)
    second = accumulate(ARM, log[15000:], like=kept)
    both = kept + second
    assert both.samples == len(log) and both.logs == (*first.logs, *second.logs)
    one, two, sum_of = equations(first), equations(second), equations(both)
    assert_allclose(sum_of.N, one.N + two.N, rtol=1e-12, atol=1e-9)
    found = both.identified()
    assert (found.standard_deviations < first.identified().standard_deviations).mean() > 0.8
    assert found.held_out.all < 0.05
    with pytest.raises(tw.ValueRangeError, match=r"do not add up: their cut-offs \[Hz\] differ"):
        first + accumulate(ARM, log[15000:], cutoff=3.0)
    with pytest.raises(tw.ValueRangeError, match="is of 'planar_2r'"):
        NormalEquationBlocks.load(tmp_path / "week.npz", tw.robots.pendulum())


def test_the_clock_of_a_log_with_a_gap_is_its_own():
    """A pause of ten seconds between rows of a hundred hertz makes no slower clock."""
    t = np.arange(1000) * 0.01
    t[500:] += 10.0
    found = SteadySamples.from_arrays(t, np.sin(t)[:, None], np.cos(t)[:, None], "log")
    assert found.rate == pytest.approx(100.0, rel=1e-9) and len(found) == 2000
    assert found.seconds == pytest.approx(t[-1] - t[0])


def test_blocks_of_time_that_become_one_lose_no_row(log):
    """There are at most so many of them, however many logs are added."""
    one = accumulate(ARM, log[:15000], **FIXED).moments
    many, logs = one, 1
    while len(many.counts) == logs * len(one.counts):
        many, logs = many + one, logs + 1
    assert len(many.counts) == MOST_BLOCKS
    assert_array_equal(many.counts[:, 0].sum(), logs * one.counts[:, 0].sum())
    assert_allclose(many.counts.sum(axis=0), logs * one.counts.sum(axis=0), rtol=1e-12)
    assert_allclose(many.sums.sum(axis=0), logs * one.sums.sum(axis=0), rtol=1e-9, atol=1e-9 * np.abs(one.sums).max())


def test_normal_equations_lose_no_digits_that_matter(gathered):
    """Against orthogonal factors, in units of the deviations."""
    assert gathered.check() < 1e-6


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """Of 95 %: 13 groups of 8 logs, whose noise hangs together; fewer than nine in ten would be 4 deviations of the count."""
    inside = []
    for seed in range(8):
        known = known_log(ARM, seed, seconds=60.0, rate=100.0)
        found = accumulate(ARM, known.motion, cutoff=5.0).identified()
        low, high = found.interval(0.95).T
        inside += ((low <= known.truth(found)) & (known.truth(found) <= high)).tolist()
    assert np.mean(inside) > 0.85


@pytest.mark.parametrize("when", ["writing", "closing"])
def test_a_full_disk_leaves_the_old_file(log, tmp_path, monkeypatch, when):
    """Whatever the moment, what was saved before is there, and nothing beside it."""
    import errno

    path = accumulate(ARM, log[:6000], **FIXED).save(tmp_path / "week.npz")
    before = path.read_bytes()

    def full(file, **arrays):
        if when == "closing":
            file.write(b"PK")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(tw.ValueRangeError, match=r"No space left on device\. Free space"):
        accumulate(ARM, log[:6000], **FIXED).save(path)
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["week.npz"]


def test_a_dead_channel_is_announced_and_counts_nothing(log):
    tau = log.tau.copy()
    tau[:, 1] = 0.25
    dead = tw.Motion(log.time, log.q, log.dq, log.ddq, tau, robot=ARM, in_seconds=True)
    information = accumulate(ARM, dead, cutoff=8.0)
    assert "dead-torque" in {d.kind for d in information.doubts}
    assert equations(information).y[1] == 0
    assert information.identified().held_out.sizes[1] == 0


def test_logs_cut_short_are_said_to_be(log, tmp_path, monkeypatch):
    """A large file that ends before its header says, and one with a number missing in its middle."""
    monkeypatch.setattr("twistwrench.motion.log_table.LARGE", 0)
    path = recorded(tmp_path / "log.npy", log)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(tw.TrajectoryError, match="cut short"):
        accumulate(ARM, path)
    holed = tw.Motion(log.time, log.q, log.dq, log.ddq, log.tau.copy(), robot=ARM, in_seconds=True)
    holed.tau[20_000, 0] = np.nan
    recorded(path, holed)
    with pytest.raises(tw.TrajectoryError, match=r"row 20001, column 'joint1\.tau' is nan"):
        accumulate(ARM, path)


def test_a_log_of_other_torques_is_named(log, tmp_path):
    """Next week, something is carried; the second joint's torque is turned."""
    first = accumulate(ARM, log[:15000], **FIXED)
    tau = log.tau[15000:] * [1.0, -1.0]
    half = log[15000:]
    turned = tw.Motion(half.time, half.q, half.dq, half.ddq, tau, robot=ARM, in_seconds=True)
    assert accumulate(ARM, half, like=first).doubts == ()
    (doubt,) = accumulate(ARM, turned, like=first).doubts
    assert doubt.kind == "other-torques" and "number 1" in doubt.sentence


@pytest.mark.slow
def test_a_jump_in_the_middle_is_seen(tmp_path, monkeypatch):
    """Far from what settings were chosen on."""
    monkeypatch.setattr(streaming, "WINDOW", 300)
    arm = tw.robots.ur5()
    motion = known_log(arm, 1, seconds=120.0, rate=100.0).motion
    q = motion.q.copy()
    q[5_345:, 0] += 4.0
    jumped = tw.Motion(motion.time, q, motion.dq, motion.ddq, motion.tau, robot=arm, in_seconds=True)
    jumped.to_csv(tmp_path / "log.csv")
    doubts = accumulate(arm, tmp_path / "log.csv", **FIXED).doubts
    (said,) = (d for d in doubts if d.kind == "jump")
    assert "log.csv: " in said.sentence and "jump" in said.sentence
    assert said.refuses  # as it does of a log that is read at once


def test_rows_that_nothing_explains_count_little(log, gathered):
    """A push of three seconds in two minutes: the robust weights leave less than half of what it does to plain least squares."""
    tau = log.tau.copy()
    tau[10_000:10_750] += 0.5 * log.tau.std(axis=0)
    pushed = tw.Motion(log.time, log.q, log.dq, log.ddq, tau, robot=ARM, in_seconds=True)
    clean = gathered.identified()
    off = {
        method: np.linalg.norm(
            (accumulate(ARM, pushed, **FIXED, method=method).values - clean.values) / clean.standard_deviations
        )
        for method in ("irls", "wls")
    }
    assert off["irls"] < 0.5 * off["wls"], off


@pytest.mark.parametrize(
    ("settings", "most"), mostly_slow([(FIXED, 0.2), ({"cutoff": 8.0}, 1.5)], 2), ids=["fixed", "chosen"]
)
def test_a_log_gives_the_same_robot_on_both_sides_of_the_seam(log, gathered, monkeypatch, settings, most):
    """Held whole, and accumulated by chunk as logs beyond MOST_SAMPLES are: the same within what noise leaves open.

    With chosen settings the two see other rows: of the whole log every tenth of a period, of an excerpt fewer.
    """
    whole = tw.identification.identify(ARM, log, **settings)
    monkeypatch.setattr(importlib.import_module("twistwrench.identification.identify"), "MOST_SAMPLES", 1000)
    by_chunk = tw.identification.identify(ARM, log, **settings)
    if settings == FIXED:
        assert_array_equal(by_chunk.values, gathered.values)
    off = np.abs(by_chunk.values - whole.values) / whole.standard_deviations
    assert off.max() < most, off
    assert_allclose(by_chunk.standard_deviations, whole.standard_deviations, rtol=0.3)
    assert abs(by_chunk.held_out.all / whole.held_out.all - 1) < 0.05
    assert_allclose(by_chunk.sigma, whole.sigma, rtol=0.05)
    assert by_chunk.verdict.word == whole.verdict.word


def test_the_long_road_notes_gaps_and_rows_left_out(log, tmp_path):
    """As the short one does: a pause of 30 s, and one stamp off."""
    late = log.time + np.where(log.time > 50.0, 30.0, 0.0)
    late[3000] += 0.0015
    paused = tw.Motion(late, log.q, tau=log.tau, robot=ARM, in_seconds=True)
    paused.to_csv(tmp_path / "log.csv")
    notes = accumulate(ARM, tmp_path / "log.csv", **FIXED).identified().notes
    assert any(note.startswith("1 gap, 30 s in all") for note in notes), notes
    assert any(note.startswith("Left out: the time stamp of 1 row") for note in notes), notes
