"""Windows of long logs: all rows are checked, results do not depend on workers, and a word does not depend on the length."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from identification_logs import known_log
from numpy.testing import assert_allclose, assert_array_equal

import twistwrench as tw
from twistwrench.identification import identify, log_windows
from twistwrench.identification.identify import _longest_motion
from twistwrench.identification.log_windows import LogChecks, LogSource, checks_of, rows_of_window, spread_windows
from twistwrench.identification.result import without_links
from twistwrench.identification.rows import SteadySamples, border_of

ARM = tw.robots.planar_2r()
FIXED = {"cutoff": 8.0, "shift": 0.003, "friction_speed": 0.05}


@pytest.fixture(scope="module")
def log():
    """15,000 samples in 120 s."""
    return known_log(ARM, 3, seconds=120.0, rate=125.0).motion


@pytest.fixture
def short(monkeypatch):
    """A bound on the samples that the log exceeds three times, in windows of 16 s or less."""
    monkeypatch.setattr(log_windows, "MOST_STATES", 5_000)
    monkeypatch.setattr(log_windows, "WINDOW", 2048)


def recorded(path: Path, motion: tw.Motion) -> Path:
    """Records of numbers in an npy file."""
    names = ["time", *ARM.coordinate_names, *(f"{n}.tau" for n in ARM.joint_names)]
    table = np.column_stack([motion.time, motion.q, motion.tau])
    records = np.zeros(len(table), [(name, float) for name in names])
    for name, values in zip(names, table.T, strict=True):
        records[name] = values
    np.save(path, records)
    return path


# ── Windows


@pytest.mark.parametrize(
    "counts",
    [[3_600_000], [200_001], [150_000, 60_000], [1_000_000, 5_000], [10_000] * 300, [90] * 3000, [250_000, 1, 70]],
    ids=len,
)
def test_windows_are_spread_evenly_and_hold_the_bound(counts):
    windows = spread_windows(counts)
    used = [sum(w.stop - w.start for w in mine) for mine in windows]
    assert 0.9 * min(sum(counts), log_windows.MOST_STATES) * (len(counts) < 50) <= sum(used) <= log_windows.MOST_STATES
    for count, mine in zip(counts, windows, strict=True):
        assert all(0 <= w.start < w.stop <= count for w in mine)
        ends = [w.stop for w in mine[:-1]]
        begins = [w.start for w in mine[1:]]
        assert all(end <= begin for end, begin in zip(ends, begins, strict=True))
        if len(mine) > 1:
            between = np.subtract(begins, ends)
            assert (mine[0].start, mine[-1].stop) == (0, count) and np.ptp(between) <= 1
    if len(counts) <= 49:
        assert all(windows)


def test_short_logs_are_one_window():
    assert spread_windows([120_000, 80_000]) == [[slice(0, 120_000)], [slice(0, 80_000)]]


def test_rows_of_a_window_are_those_of_the_whole_log(log):
    """Away from its ends, which have no pieces of other windows to reach into."""
    source = LogSource(ARM, "log", motion=log)
    checks = checks_of(source)
    (whole,), (piece,) = (
        rows_of_window(source, rows, checks).samples for rows in (slice(0, len(log)), slice(9000, 13_000))
    )
    assert isinstance(whole, SteadySamples) and piece.cut and not whole.cut
    first = round((piece.start - whole.start) * whole.rate)
    assert first == 9000 and len(piece) == 4000
    for name in ("q", "tau"):
        assert_array_equal(getattr(piece, name), getattr(whole, name)[first : first + len(piece)])


@pytest.mark.parametrize("counts", [(4,), (6, 4, 9), (8, 8)])
def test_rows_that_were_held_are_left_out_and_the_row_that_they_repeat_is_kept(counts):
    """Only the first of equal rows was measured then; the first row after them is in time again."""
    t = np.arange(1200) * 0.01 + 40.0
    s = t - 46.0
    q = np.column_stack([0.25 * s + 0.02 * np.sin(2.0 * s), 0.02 * np.cos(2.5 * s) - 0.3 * s])
    is_held = np.zeros(len(t), bool)
    for number, count in enumerate(counts):
        first = 250 + 300 * number
        q[first : first + count] = q[first - 1]
        is_held[first : first + count] = True
    tau = 3.0 + np.sin(np.outer(t, [0.7, 1.1]))
    source = LogSource(ARM, "log", motion=tw.Motion(t, q, tau=tau, robot=ARM))
    rows = rows_of_window(source, slice(0, len(t)), checks_of(source))
    assert rows.count == len(t)
    for used, logged in ((rows.time, t), (rows.q, q), (rows.tau, tau)):
        assert_allclose(used, logged[~is_held], rtol=0, atol=1e-12)


def test_a_file_gives_what_its_motion_gives(log, tmp_path):
    path = recorded(tmp_path / "log.npy", log[:8000])
    of_file, of_motion = identify(ARM, path, **FIXED), identify(ARM, tw.Motion.from_file(path, ARM), **FIXED)
    assert_array_equal(of_file.values, of_motion.values)
    assert of_file.doubts == of_motion.doubts and of_file.notes == of_motion.notes


# ── One road


def test_a_long_log_gives_the_robot_of_all_its_samples(log, short, monkeypatch):
    """A third of the samples: the same within what noise leaves open, and intervals that are wider."""
    third = identify(ARM, log, **FIXED)
    assert third.notes == ("5,000 of 15,000 samples, in 3 windows.",)
    monkeypatch.undo()
    whole = identify(ARM, log, **FIXED)
    assert not whole.notes and third.verdict.word == whole.verdict.word
    assert (np.abs(third.values - whole.values) < 4.0 * third.standard_deviations).all()
    assert_allclose(third.sigma, whole.sigma, rtol=0.1)
    assert abs(third.held_out.all / whole.held_out.all - 1) < 0.1
    assert 1.0 < np.median(third.standard_deviations / whole.standard_deviations) < 5.0


def moved_log(robot, seed, count, *, position=2e-5, torque=0.5, friction=1.0, step=1e-3):
    """Log of a Fourier series, with noise; friction changes by a factor from the middle on."""
    rng, t = np.random.default_rng(seed), np.arange(count) * step
    q, dq, ddq = (np.zeros((count, robot.nv)) for _ in range(3))
    for j in range(robot.nv):
        for k in range(1, 6):
            w = 0.2 * np.pi * k
            a, b = rng.standard_normal(2) * 0.5 / k
            q[:, j] += a * np.sin(w * t) + b * np.cos(w * t)
            dq[:, j] += w * (a * np.cos(w * t) - b * np.sin(w * t))
            ddq[:, j] -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
    scale = np.where(t < 0.5 * t[-1], 1.0, friction)[:, None]
    tau = robot.inverse_dynamics(q, dq, ddq) + scale * (0.3 * np.sign(dq) + 0.5 * dq)
    tau += torque * rng.standard_normal(q.shape)
    return tw.Motion(t, q + position * rng.standard_normal(q.shape), tau=tau, robot=robot)


LENGTHS = (60_000, 89_999, 90_001, 150_000)
ROBOTS = ("ur5", "panda", "planar_3r", "planar_2r")
BOUND = 12_000
NOISES = ((2e-5, 0.5), (2e-6, 0.05), (1e-4, 0.2))


@pytest.mark.parametrize(
    "noise",
    [NOISES[0], *(pytest.param(noise, marks=pytest.mark.slow) for noise in NOISES[1:])],
    ids=("usual", "small", "of positions"),
)
def test_the_first_word_does_not_change_at_the_bound(monkeypatch, noise):
    """Beside the length from which windows are used."""
    position, torque = noise
    monkeypatch.setattr(log_windows, "MOST_STATES", BOUND)
    motion = moved_log(ARM, 1, BOUND + 1, position=position, torque=torque)
    whole, windows = identify(ARM, motion[:-2]), identify(ARM, motion)
    assert whole.verdict.word == windows.verdict.word
    assert not whole.notes and windows.notes


@pytest.mark.slow
@pytest.mark.parametrize("noise", NOISES, ids=("usual", "small", "of positions"))
@pytest.mark.parametrize("name", ROBOTS)
def test_the_first_word_does_not_depend_on_the_length(name, noise):
    """Beside the length at which logs were once accumulated by chunk, with another word for some."""
    robot = getattr(tw.robots, name)()
    position, torque = noise
    lengths = LENGTHS if name != "planar_2r" else LENGTHS[1:3]
    motion = moved_log(robot, 1, max(lengths), position=position, torque=torque)
    words = {n: str(identify(robot, motion[:n]).verdict.word) for n in lengths}
    assert len(set(words.values())) == 1, words


@pytest.mark.slow
@pytest.mark.parametrize("count", [60_000, 240_000])
def test_a_log_that_is_not_homogeneous_is_found_at_any_length(count):
    """Friction doubles from the middle on; the longer log is fitted in windows."""
    robot = tw.robots.ur5()
    found = identify(robot, moved_log(robot, 1, count, friction=2.0))
    assert found.verdict.word == "LOOK AGAIN"
    sentences = " ".join(str(one) for one in found.doubts)
    assert "times as large from" in sentences, sentences
    assert bool(found.notes) == (count > log_windows.MOST_STATES)


@pytest.mark.parametrize("most", [25_000, 5_000])
def test_friction_that_doubles_is_found_in_windows(monkeypatch, most):
    """The slow test above with a small robot and a small bound."""
    monkeypatch.setattr(log_windows, "MOST_STATES", most)
    found = identify(ARM, moved_log(ARM, 1, 15_000, torque=0.02, friction=2.0, step=0.01), cutoff=5.0)
    assert [one.kind for one in found.doubts] == ["warming"] and bool(found.notes) == (most < 15_000)


def test_causes_are_assumed_at_any_length(log, short):
    gained = tw.Motion(log.time, log.q, tau=log.tau * [1.0, 2.0], robot=ARM)
    found = identify(ARM, gained, assume=f"gain:{ARM.joint_names[1]}", cutoff=8.0, shift=0.0)
    (cause,) = found.settings.assumed
    assert found.notes[-1].startswith("5,000 of 15,000") and abs(cause.value - 2.0) < 0.05


# ── Checks of all rows


def between_windows(log):
    """Row where no window is."""
    first, second = spread_windows([len(log)])[0][:2]
    return (first.stop + second.start) // 2


def test_checks_see_rows_outside_the_windows(log, short):
    """A pause and a wrong stamp where no window is, in memory and in a file."""
    row = between_windows(log)
    time = log.time + np.where(np.arange(len(log)) > row, 30.0, 0.0)
    time[row - 900] += 0.0015
    found = identify(ARM, tw.Motion(time, log.q, tau=log.tau, robot=ARM, in_seconds=True), **FIXED)
    assert any(note.startswith("1 gap, 30 s in all") for note in found.notes), found.notes
    assert any(note.startswith("Left out: the time stamp of 1 row") for note in found.notes), found.notes
    assert found.verdict.ok


def test_a_step_outside_the_windows_is_told(log, short, tmp_path):
    q = log.q.copy()
    q[between_windows(log) :, 0] += 4.0
    path = recorded(tmp_path / "log.npy", tw.Motion(log.time, q, tau=log.tau, robot=ARM))
    assert "lone-step" in {one.kind for one in identify(ARM, path, **FIXED).doubts}
    both = identify(ARM, [path, recorded(tmp_path / "other.npy", log[:12_000])], **FIXED).doubts
    assert [one.sentence.startswith(f"{path}: ") for one in both if one.kind == "lone-step"] == [True]


def test_logs_cut_short_are_said_to_be(log, tmp_path, monkeypatch):
    """A large file that ends before its header says, and one with a number missing in its middle."""
    monkeypatch.setattr("twistwrench.motion.log_table.MAX_TABLE_IN_MEMORY", 0)
    path = recorded(tmp_path / "log.npy", log)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(tw.TrajectoryError, match="cut short"):
        identify(ARM, path)
    holed = tw.Motion(log.time, log.q, log.dq, log.ddq, log.tau.copy(), robot=ARM, in_seconds=True)
    holed.tau[10_000, 0] = np.nan
    recorded(path, holed)
    with pytest.raises(tw.TrajectoryError, match=r"row 10001, column 'joint1\.tau' is nan"):
        identify(ARM, path)


def test_a_log_that_cannot_be_read_is_left_out_with_a_doubt(log, tmp_path):
    good, bad = recorded(tmp_path / "good.npy", log[:8000]), tmp_path / "bad.npy"
    bad.write_bytes(b"nothing")
    found = identify(ARM, [good, bad], **FIXED)
    (doubt,) = (one for one in found.doubts if one.kind == "left-out")
    assert "bad.npy" in doubt.sentence and found.verdict.word == "UNSURE"
    assert_array_equal(found.values, identify(ARM, good, **FIXED).values)


def test_the_clock_of_a_log_with_a_gap_is_its_own():
    """A pause of ten seconds between rows of a hundred hertz makes no slower clock."""
    t = np.arange(1000) * 0.01
    t[500:] += 10.0
    found = SteadySamples.from_arrays(t, np.sin(t)[:, None], np.cos(t)[:, None], "log")
    assert found.rate == pytest.approx(100.0, rel=1e-9) and len(found) == 2000
    assert found.seconds == pytest.approx(t[-1] - t[0])


def test_a_dead_channel_is_announced_and_counts_nothing(log, short):
    tau = log.tau.copy()
    tau[:, 1] = 0.25
    found = identify(ARM, tw.Motion(log.time, log.q, log.dq, log.ddq, tau, robot=ARM, in_seconds=True), cutoff=8.0)
    assert "dead-torque" in {one.kind for one in found.doubts} and found.held_out.sizes[1] == 0


def test_a_log_of_other_torques_is_named(log):
    """A second log in which the torque of one joint has the other sign: the time at which it begins is told."""
    half = log[7_500:]
    turned = tw.Motion(half.time, half.q, half.dq, half.ddq, half.tau * [1.0, -1.0], robot=ARM, in_seconds=True)
    assert identify(ARM, [log[:7_500], half], **FIXED).verdict.ok
    (doubt,) = identify(ARM, [log[:7_500], turned], **FIXED).doubts
    assert doubt.kind == "gain-change" and "-1 times as large from 60" in doubt.sentence, doubt


def test_bits_do_not_depend_on_workers(log, tmp_path, short):
    """Two files in windows, read by two processes and by this one."""
    pytest.importorskip("distributed")
    from twistwrench.core.third_party.workers import workers_of

    paths = [recorded(tmp_path / f"{k}.npy", log[a:b]) for k, (a, b) in enumerate([(0, 7_000), (7_000, 15_000)])]
    alone = identify(ARM, paths, **FIXED)
    with workers_of(2) as team:
        shared = identify(ARM, paths, client=team.client, **FIXED)
    for name in ("values", "standard_deviations", "sigma"):
        assert_array_equal(getattr(shared, name), getattr(alone, name))
    assert shared.to_json() == alone.to_json()


def test_what_is_read_of_a_log_follows_from_its_rows():
    """A spike of one torque is one row; glitches of 5 % of the rows are no few, and are left; a cut piece loses twice the border."""
    robot, t = tw.robots.planar_2r(), 0.01 * np.arange(1000)
    q = np.stack([np.sin(t), np.cos(0.7 * t)], axis=1)
    tau = 10.0 * np.stack([np.cos(1.1 * t), np.sin(1.7 * t)], axis=1)
    spiked, glitched = tau.copy(), q.copy()
    spiked[500, 1] = 1e4
    glitched[10::20, 0] += 2.0
    source = LogSource.from_log(robot, tw.Motion(t, q, tau=spiked, robot=robot), "log", {})
    rows = rows_of_window(source, slice(0, 1000), LogChecks(1000, (), np.zeros(0), np.zeros(0)))
    assert sorted({*range(1000)} - {*np.round(rows.time / 0.01).astype(int).tolist()}) == [500]
    many = checks_of(LogSource.from_log(robot, tw.Motion(t, glitched, tau=tau, robot=robot), "log", {}))
    assert len(many.wrong_times) == 0
    assert [border_of(100.0, 5.0, 1000, cut=cut) for cut in (False, True)] == [20, 40]
    pieces = [
        SteadySamples(0.0, 10.0, np.zeros((70, 2)), np.zeros((70, 2))),
        SteadySamples(50.0, 10.0, np.zeros((200, 2)), np.zeros((200, 2))),
    ]
    log = SimpleNamespace(time=np.array([0.0, 70.0]), samples=pieces)
    assert (_longest_motion([log], robot).time[0], len(_longest_motion([log], robot))) == (50.0, 200)


def test_a_link_that_is_taken_away_takes_its_first_moment_along():
    """m c of hand and carrier together, in the carrier's frame, less that of the hand where it is mounted."""
    robot = tw.robots.panda()
    frame = robot.model.frames["panda_hand"]
    whole, hand = robot.model.bodies[frame.body].inertia, robot.model.link_inertias["panda_hand"]
    bare = without_links(robot, ["panda_hand"]).model.bodies[frame.body].inertia
    moment = whole.mass * whole.com - hand.mass * (frame.pose[:3, :3] @ hand.com + frame.pose[:3, 3])
    np.testing.assert_allclose(bare.mass * bare.com, moment, atol=1e-12)
