"""Figures of the torque report against plain inverse dynamics: peaks, causes, limits, noise, whatever the chunks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from motions import LOAD, SLED, WRENCH, report_of, wrapped, write_motion, write_positions

from twistwrench import load, robots
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.model.model import Limits
from twistwrench.motion.load_case import TERMS
from twistwrench.reports.spoken_verdict import _nearer_sentences
from twistwrench.reports.statistics import Bins, Gaps, gap_edges, mean_weights

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")


# ── figures ──


def test_figures_are_those_of_plain_inverse_dynamics(ur5, motion, motion_file):
    t, q, dq, ddq = motion
    report = report_of(ur5, motion_file, **LOAD)
    loaded = ur5.with_payload(SpatialInertia.from_com(3.0, (0.0, 0.02, 0.1)), frame="tool0")
    tau = loaded.inverse_dynamics(
        q, dq, ddq, wrench_on_robot={"tool0": np.broadcast_to(WRENCH, (len(t), 6))}, friction=True
    )
    at = np.abs(tau).argmax(axis=0)
    np.testing.assert_allclose([j.peak for j in report.joints], tau[at, np.arange(6)], rtol=1e-12)
    np.testing.assert_array_equal([j.time for j in report.joints], t[at])
    np.testing.assert_allclose(
        [j.rms for j in report.joints], np.sqrt(np.trapezoid(tau**2, t, axis=0) / (t[-1] - t[0]))
    )
    np.testing.assert_allclose([j.share for j in report.joints], np.abs(tau).max(axis=0) / ur5.limits.effort)
    assert (report.rows, report.begin, report.end) == (700, t[0], t[-1])


def test_the_worst_joint_is_nearest_to_its_limit_and_without_limits_the_most_loaded(tmp_path):
    robot = robots.planar_2r()
    path = write_positions(tmp_path / "m.csv", robot, np.arange(50) * 1e-2, np.zeros((50, 2)))
    none = np.full(2, np.inf)
    for effort, worst in (([1000.0, 20.0], 1), ([40.0, 1000.0], 0), (none, 0)):
        report = report_of(robot, path, limits=Limits(-none, none, none, np.array(effort)))
        assert abs(report.joints[0].peak) > abs(report.joints[1].peak) > 0.0
        assert report.worst == worst


@pytest.mark.parametrize(
    ("torque", "speed", "named"), [(0.5, 0.6, False), (0.9, 0.95, True), (0.95, 0.9, False), (0.5, 0.95, True)]
)
def test_a_speed_is_named_if_it_is_near_its_limit_and_nearer_than_any_torque(torque, speed, named):
    """Near is above 80 % of the limit."""
    near = [SimpleNamespace(joint="elbow", kind="velocity", share=speed, time=1.0)]
    sentences = _nearer_sentences(SimpleNamespace(near=near, measured=()), torque)
    assert len(sentences) == named and all("Velocity of elbow" in each for each in sentences)


def test_the_causes_of_a_peak_add_up_to_it(ur5, motion_file):
    for joint in report_of(ur5, motion_file, **LOAD).joints:
        assert set(joint.terms) == set(TERMS)
        assert sum(joint.terms.values()) == pytest.approx(joint.peak, rel=1e-12, abs=1e-12)


def test_each_cause_vanishes_with_what_causes_it(ur5, motion, tmp_path):
    t, q, dq, _ = motion
    still = np.zeros_like(q)
    held = report_of(ur5, write_motion(tmp_path / "held.csv", ur5, t, [q, still, still]))
    for joint in held.joints:
        assert joint.peak == pytest.approx(joint.terms["gravity"], abs=1e-12)
    moving = report_of(ur5.with_gravity((0, 0, 0)), write_motion(tmp_path / "m.csv", ur5, t, [q, dq, still]))
    for joint in moving.joints:
        assert joint.peak == pytest.approx(joint.terms["coriolis"] + joint.terms["friction"], abs=1e-12)


def test_a_wrench_on_the_robot_is_held_up_by_the_joints(ur5, tmp_path):
    q = np.tile([0.3, -1.2, 1.5, -0.4, 0.8, 0.1], (2, 1))
    path = write_motion(tmp_path / "held.csv", ur5, [0.0, 1.0], [q, 0 * q, 0 * q])
    report = report_of(ur5, path, wrenches={"tool0": WRENCH})
    expected = -ur5.jacobian(q[0], "tool0").T @ WRENCH
    np.testing.assert_allclose([j.terms["wrench"] for j in report.joints], expected, atol=1e-12)


@pytest.mark.parametrize("parts", [("", ".vel", ".acc"), ("",)])
def test_chunks_do_not_matter(ur5, motion, tmp_path, parts):
    t, *columns = motion
    path = write_motion(tmp_path / "m.csv", ur5, t, columns[: len(parts)], parts)
    whole, *others = (report_of(ur5, path, chunk=chunk, **LOAD) for chunk in (10**6, 300, 128))
    tolerance = 1e-12 if len(parts) == 3 else 1e-8  # second differences cost digits
    for other in others:
        for a, b in zip(whole.joints, other.joints, strict=True):
            assert a.time == b.time
            assert [b.peak, b.rms, *b.terms.values()] == pytest.approx(
                [a.peak, a.rms, *a.terms.values()], rel=tolerance, abs=tolerance
            )
        for a, b in zip(whole.envelope, other.envelope, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-7)


def test_the_order_of_columns_does_not_matter(ur5, motion, tmp_path, motion_file):
    t, *columns = motion
    order = np.random.default_rng(0).permutation(19)
    shuffled = write_motion(tmp_path / "shuffled.csv", ur5, t, columns, order=order)
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    report_of(ur5, motion_file, csv=first)
    report_of(ur5, shuffled, csv=second)
    assert first.read_bytes() == second.read_bytes()


def test_without_friction_there_is_none(motion, tmp_path):
    panda = robots.panda()
    assert panda.model.friction.any
    t, q, dq, ddq = (x if x.ndim == 1 else np.column_stack([x, x[:, 0]]) for x in motion)
    path = write_motion(tmp_path / "panda.csv", panda, t, [q, dq, ddq])
    assert any(j.terms["friction"] for j in report_of(panda, path).joints)
    without = report_of(panda, path, friction=False)
    assert not any(j.terms["friction"] for j in without.joints)
    tau = panda.inverse_dynamics(q, dq, ddq)
    np.testing.assert_allclose([abs(j.peak) for j in without.joints], np.abs(tau).max(axis=0))


def test_rates_beyond_joint_limits_are_found_with_their_time(ur5, motion, motion_file):
    t, q, dq, _ = motion
    inside = Limits(np.full(6, -9.0), np.full(6, 9.0), np.full(6, 99.0), np.full(6, 999.0))
    assert report_of(ur5, motion_file, limits=inside).excesses == ()
    tight = Limits(np.full(6, -0.9), np.full(6, 9.0), np.full(6, 99.0), np.full(6, 999.0))
    found = report_of(ur5, motion_file, limits=tight).excesses
    assert {e.kind for e in found} == {"lower"}
    assert len(found) == 6
    for e in found:
        k = ur5.joint_names.index(e.joint)
        assert e.value == pytest.approx(q[:, k].min())
        assert e.time == t[q[:, k].argmin()]
    slow = Limits(inside.lower, inside.upper, np.r_[1e-3, np.full(5, 99.0)], inside.effort)
    (e,) = report_of(ur5, motion_file, limits=slow).excesses
    assert (e.joint, e.kind, e.unit) == (ur5.joint_names[0], "velocity", "rad/s")
    assert e.value == dq[np.abs(dq[:, 0]).argmax(), 0]  # with its sign


def test_a_velocity_over_its_limit_keeps_its_sign(ur5, tmp_path):
    one = np.ones((2, 6))
    path = write_motion(tmp_path / "m.csv", ur5, [0.0, 1.0], [one, -one * [[1], [2]], 0 * one])
    slow = Limits(np.full(6, -9.0), np.full(6, 9.0), np.full(6, 1.5), np.full(6, 999.0))
    assert {e.value for e in report_of(ur5, path, limits=slow).excesses} == {-2.0}


def test_position_limits_are_about_the_numbers_of_the_file_whatever_the_chunks(tmp_path):
    pendulum = robots.pendulum()
    t = np.arange(4000) * 5e-3
    path = write_positions(tmp_path / "m.csv", pendulum, t, wrapped(3 * t))
    none = np.full(1, np.inf)
    for bound, kinds in ((50.0, set()), (3.0, {"lower", "upper"})):
        limits = Limits(np.full(1, -bound), np.full(1, bound), none, none)
        found = [report_of(pendulum, path, limits=limits, chunk=chunk).excesses for chunk in (300, 1000, 4000)]
        assert {e.kind for e in found[0]} == kinds
        assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("smoothing", [False, True])
@pytest.mark.parametrize("robot", ["pendulum", "sled"])
def test_wrapping_changes_no_torque(tmp_path, robot, smoothing):
    (tmp_path / "sled.urdf").write_text(SLED)
    robot = load(tmp_path / "sled.urdf") if robot == "sled" else robots.pendulum()
    t = np.arange(4000) * 2e-3
    q = np.column_stack([0.3 * np.sin(t), 0.2 * np.cos(2 * t), 2 * t + 0.5 * np.sin(t)])[:, -robot.nq :]
    q[:, -1] += 1e-5 * smoothing * np.random.default_rng(0).normal(size=len(t))
    turned = np.column_stack([q[:, :-1], wrapped(q[:, -1])])
    plain, found = (
        report_of(robot, write_positions(tmp_path / "m.csv", robot, t, x), smoothing=smoothing) for x in (q, turned)
    )
    for a, b in zip(plain.joints, found.joints, strict=True):
        assert b.peak == pytest.approx(a.peak, rel=1e-6, abs=1e-6)
        assert b.uncertainty == pytest.approx(a.uncertainty, rel=1e-6, abs=1e-6)


def test_a_joint_at_steady_speed_is_no_coarse_encoder(ur5, tmp_path):
    t = np.arange(4000) * 1e-3
    q = 0.3 * np.sin(np.outer(t, [1.0, 1.2, 0.8, 0.5, 0.9, 1.1])) - 0.5
    q[:, 0] = 0.3 * t
    for joint in report_of(ur5, write_positions(tmp_path / "m.csv", ur5, t, q, "%.15g")).joints:
        assert joint.uncertainty < 1e-6


def test_torque_noise_is_that_of_repeated_noisy_logs(ur5, tmp_path):
    t = np.arange(3000) * 2e-3
    clean = 0.3 * np.sin(np.outer(t, [1.0, 1.2, 0.8, 0.5, 0.9, 1.1])) - 0.5
    sigma = 1e-5
    noisy = clean + sigma * np.random.default_rng(3).normal(size=clean.shape)
    reports = [
        report_of(ur5, write_motion(tmp_path / "n.csv", ur5, t, [q], ("",)), csv=tmp_path / "o.csv") for q in (noisy,)
    ]
    names = (tmp_path / "o.csv").read_text().splitlines()[0].split(",")
    derived = [names.index(f"{joint}.torque.derived") for joint in ur5.joint_names]
    found = np.loadtxt(tmp_path / "o.csv", delimiter=",", skiprows=1)[:, derived]
    report_of(ur5, write_motion(tmp_path / "c.csv", ur5, t, [clean], ("",)), csv=tmp_path / "o.csv")
    exact = np.loadtxt(tmp_path / "o.csv", delimiter=",", skiprows=1)[:, 1:]
    spread = (found - exact)[50:-50].std(axis=0)
    claimed = [j.noise for j in reports[0].joints]
    # The claim is for the state where M is largest, the spread an average over the motion.
    assert (spread < 1.1 * np.array(claimed)).all()
    assert (spread > 0.6 * np.array(claimed)).all()


# ── running figures ──


def test_rms_weighs_uneven_steps_by_their_length():
    time, values = np.array([0.0, 1.0, 1.5, 4.0, 4.25]), np.array([1.0, 2.0, 3.0, 0.0, 5.0])
    parts = (slice(0, 1), slice(1, 4), slice(4, 5))
    squares = [(1 + 4) / 2, (4 + 9) / 4, (9 + 0) * 1.25, (0 + 25) / 8]
    assert sum(mean_weights(time, part) @ values[part] ** 2 for part in parts) == pytest.approx(sum(squares) / 4.25)
    assert mean_weights(np.array([3.0]), slice(0, 1)).tolist() == [1.0]


def gaps_of(time, q, dq=None, ddq=None, threshold=0.5, **given):
    """Gaps of rows of one joint."""
    rates = [np.zeros_like(q) if x is None else x for x in (dq, ddq)]
    rows = gap_edges(time, threshold)
    return Gaps.from_edges(time, (q[rows], rates[0][rows]), np.abs(rates).max(axis=1), threshold, **given)


def test_the_longest_gap_and_the_gap_with_a_motion_may_differ():
    time = np.array([0.0, 0.1, 1.1, 1.2, 3.2, 3.3])
    gaps = gaps_of(time, np.minimum(time, 1.1)[:, None])
    assert (gaps.count, gaps.longest, gaps.longest_at) == (2, pytest.approx(2.0), pytest.approx(1.2))
    assert gaps.hiding == [(pytest.approx(0.1), pytest.approx(1.0))]  # the longer one stands


def test_a_gap_hides_a_motion_that_comes_back_to_where_it_began():
    time = np.array([0.0, 0.1, 1.1, 1.2])
    for speed, hidden in ((1.0, 1.0), (0.0, 0.0)):
        gaps = gaps_of(time, np.zeros((4, 1)), speed * np.array([[1.0], [1.0], [-1.0], [-1.0]]))
        assert gaps.hidden == pytest.approx(hidden)
        assert gaps.beside(1.1, 0.01) == (hidden > 0) and not gaps.beside(0.5, 0.01)


def test_a_gap_that_needs_more_speed_or_acceleration_than_was_logged():
    """From rest to rest over 0.1 rad in 1 s: 0.1 rad/s on average, and 0.4 rad/s² of a constant acceleration and deceleration."""
    time, q = np.array([0.0, 0.1, 1.1, 1.2, 1.3]), np.array([[0.0], [0.0], [0.1], [0.1], [0.1]])
    for fastest, hardest, more in ((0.2, 0.5, False), (0.05, 0.5, True), (0.2, 0.3, True)):
        last = np.array([[0.0], [0.0], [0.0], [0.0], [1.0]])
        gaps = gaps_of(time, q, fastest * last, hardest * last)
        assert gaps.exceeds_logged_motion == more


@pytest.mark.parametrize("portion", [1, 7, 64, 5000])
def test_the_envelope_holds_every_value_in_few_bins(portion):
    values = np.random.default_rng(1).normal(size=(5000, 2)).cumsum(axis=0)
    parts = []
    for k in range(0, 5000, portion):
        rows = values[k : k + portion]
        parts.append(Bins.from_rows(k, np.arange(k, k + len(rows)) * 1.0, rows, rows, 5000, bins=50))
    _, time, least, greatest = Bins.from_parts(parts)
    assert 50 < len(time) <= 100
    size = int(time[1] - time[0])
    starts = np.arange(0, 5000, size)
    np.testing.assert_array_equal(time, starts)
    np.testing.assert_array_equal(least, np.minimum.reduceat(values, starts))
    np.testing.assert_array_equal(greatest, np.maximum.reduceat(values, starts))
