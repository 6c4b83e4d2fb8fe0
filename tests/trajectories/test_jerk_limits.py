"""Limits of jerk: kept between samples, on the same path, and as short as other methods find, to figures that are stated."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quick import mostly_slow
from scipy.optimize import minimize

import twistwrench as tw
from twistwrench import trajectories
from twistwrench.mechanics.algorithms.time_scalings import Averaged
from twistwrench.trajectories import bounds_of, fastest, fitted, joint_line, s_curve, spline
from twistwrench.trajectories.jerk_limited import _improve

ROBOTS = {
    "planar_2r": {"effort": [60.0, 30.0], "velocity": 3.0, "acceleration": 12.0},
    "ur5": {"acceleration": 15.0},
    "panda": {"acceleration": 10.0},
}
"""Limits that stand in for those of each robot."""
FINE = 40_001
"""Instants looked at, 20 times as many as those from which a duration is found."""


def kept_on_a_fine_grid(motion: trajectories.Trajectory, bounds: tw.Limits) -> None:
    """No limit is passed by more than 1e-6 of it: by the exact derivatives, and by differences of the accelerations."""
    t = np.linspace(0.0, motion.duration, FINE)
    _, dq, ddq = motion(t)
    assert (np.abs(motion.jerk(t)) <= bounds.jerk * (1 + 1e-6)).all()
    assert trajectories.violations(motion.robot, motion, bounds, samples=FINE) == ()
    assert np.abs(dq[[0, -1]]).max() < 1e-12 and np.abs(ddq[[0, -1]]).max() < 1e-9  # rest to rest


def some_path(name: str, robot: tw.Robot, seed: int) -> trajectories.JointPath:
    rng = np.random.default_rng([seed, len(name)])
    middle = np.mean(np.nan_to_num([robot.limits.lower, robot.limits.upper], posinf=0, neginf=0), axis=0)
    places = middle + 0.3 * (robot.random_configuration(rng, int(rng.integers(2, 6))) - middle)
    return spline(robot, places) if len(places) > 2 else joint_line(robot, *places)


SEEDS = [
    *((name, 0) for name in ROBOTS),
    *(pytest.param(n, k, marks=pytest.mark.slow) for n in ROBOTS for k in range(1, 50)),
]


@pytest.mark.parametrize(("name", "seed"), mostly_slow(SEEDS, 3))
def test_no_limit_is_passed_between_samples(bundled, name, seed):
    robot = bundled(name)
    path = some_path(name, robot, seed)
    jerk = float(np.exp(np.random.default_rng(seed).uniform(np.log(50), np.log(5000))))
    motion = fastest(robot, path, jerk=jerk, **ROBOTS[name])
    kept_on_a_fine_grid(motion, motion.bounds)
    assert motion.shares(np.linspace(0, motion.duration, FINE)).max() <= 1 + 1e-6
    assert motion.slower >= 0 and motion.limit_contacts == ()
    s = motion.scaling(np.linspace(0, motion.duration, FINE))[0]
    assert (np.diff(s) >= -1e-10).all()  # on the path, and never back, but for rounding of second integrals
    ends = motion([0.0, motion.duration])[0]
    assert_allclose(ends, path([0.0, 1.0])[0], atol=1e-12)
    assert motion.duration <= fitted(robot, path, None, motion.bounds).duration * (1 + 1e-7)


@pytest.mark.parametrize("shape", [trajectories.quintic(1.0), s_curve(1.0), s_curve(1.0, alpha=0.5, beta=0.1)])
@pytest.mark.parametrize(("name", "seed"), [("ur5", 3), ("planar_2r", 1)])
def test_a_fitted_duration_keeps_a_limit_of_jerk_and_touches_one(bundled, shape, name, seed):
    robot = bundled(name)
    path = some_path(name, robot, seed)
    bounds = bounds_of(robot, jerk=4.0, **ROBOTS[name])
    motion = trajectories.Trajectory(robot, path, fitted(robot, path, shape, bounds))
    kept_on_a_fine_grid(motion, bounds)
    share = np.abs(motion.jerk(np.linspace(0, motion.duration, FINE))).max() / 4.0
    assert share == pytest.approx(1.0, abs=1e-3)


def test_the_duration_by_jerk_is_the_closed_form():
    """Over d a quintic has jerks of 60 d/T³ at most, a double S of d/(α² β (1 - α) (1 - β) T³)."""
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    path, J, a, b = joint_line(mass, [0], [-0.5]), 7.0, 0.3, 0.2
    bounds = bounds_of(mass, jerk=J)
    assert fitted(mass, path, None, bounds).duration == pytest.approx((60 * 0.5 / J) ** (1 / 3), rel=1e-12)
    most = 0.5 / (a * a * b * (1 - a) * (1 - b))
    assert fitted(mass, path, s_curve(9.0, alpha=a, beta=b), bounds).duration == pytest.approx(
        (most / J) ** (1 / 3), rel=1e-9
    )


@pytest.mark.parametrize(("alpha", "beta"), [(1 / 3, 1 / 3), (0.5, 0.5), (0.2, 0.01)])
def test_a_double_s_has_the_peaks_of_its_source(alpha, beta):
    """Biagiotti & Melchiorri 3.4: v = 1/((1-α) T), a = v/(α (1-β) T), j = a/(α β T), each held for a time of its own."""
    T = 1.7
    curve, t = s_curve(T, alpha=alpha, beta=beta), np.linspace(0, 1.7, 20_001)
    s, ds, dds = curve(t)
    v = 1 / ((1 - alpha) * T)
    a = v / (alpha * (1 - beta) * T)
    for values, peak in ((ds, v), (dds, a), (curve.third(t), a / (alpha * beta * T))):
        assert np.abs(values).max() == pytest.approx(peak, rel=1e-9)
    assert_allclose(s + s[::-1], 1.0, atol=1e-12)
    assert_allclose(np.gradient(ds, t)[1:-1], dds[1:-1], atol=a / (alpha * beta * T) * (t[1] - t[0]))


def test_a_path_whose_acceleration_jumps_has_no_bounded_jerk(bundled):
    robot = bundled("planar_2r")
    rates = [[0, 0], [1.0, 0.5], [0, 0]]
    path = spline(robot, [[0, 0], [0.5, 0.2], [1, 1]], times=[0, 0.6, 1], velocities=rates)
    with pytest.raises(tw.ValueRangeError, match=r"jumps at s = 0\.6"):
        fitted(robot, path, None, bounds_of(robot, jerk=100.0))


def test_limits_of_jerk_of_the_file_are_kept_and_can_be_lifted(bundled):
    text = tw.robots.path_of("planar_2r").read_text()
    robot = tw.load(text.replace("<axis", '<limit effort="60" velocity="3" acceleration="12" jerk="150"/><axis'))
    assert robot.limits.jerk.tolist() == [150.0, 150.0]
    path = spline(robot, [[0, 0], [0.8, -0.5], [0.3, 0.9]])
    kept, free = fastest(robot, path), fastest(robot, path, jerk=np.inf)
    assert free.time_optimal is None and kept.time_optimal.duration == pytest.approx(free.duration, rel=1e-12)
    assert kept.violations() == () and {v.kind for v in free.violations()} == {"jerk"}
    assert str(kept).endswith("not proven shortest; limits of acceleration and jerk are the robot's own")
    assert trajectories.move(robot, [0, 0], [1, 1]).violations() == ()


def test_windows_become_no_shorter_than_samples_resolve_in_however_many_steps():
    """A search that gains by shorter windows alone takes them to a 250th of the duration at its start."""
    s = np.linspace(0.0, 1.0, 41)
    shape = Averaged(s, np.sqrt(s * (1.0 - s)), (0.016, 0.016), "averaged")
    found = _improve(shape, lambda tried: np.array([sum(tried.windows)]))
    assert_allclose(found.windows, np.full(2, shape.duration / 250.0), rtol=1e-6)


# ── Against other methods


def shortest_by_collocation(path, bounds, start, parts=40):
    """Duration of a motion with a third derivative of s that is constant on each part of the time, locally the shortest.

    Velocities, accelerations and jerks of the joints are within their limits at four places of each part, which is less
    than everywhere: it may be a little short.
    """
    z = np.linspace(0, 1, 5)

    def motion(x):
        T, j = x[0], x[1:]
        h, d = T / parts, T / parts * z
        a = np.concatenate([[0], np.cumsum(j * h)])
        v = np.concatenate([[0], np.cumsum(a[:-1] * h + j * h * h / 2)])
        s = np.concatenate([[0], np.cumsum(v[:-1] * h + a[:-1] * h * h / 2 + j * h**3 / 6)])
        p, r, u, j = s[:-1, None], v[:-1, None], a[:-1, None], j[:, None]
        inner = (p + r * d + u * d**2 / 2 + j * d**3 / 6, r + u * d + j * d**2 / 2, u + j * d, j + 0 * d)
        return [y.reshape(-1, 1) for y in inner], np.array([s[-1] - 1, v[-1], a[-1]])

    def shares(x):
        (s, ds, dds, ddds), _ = motion(x)
        s = np.clip(s[:, 0], 0, 1)
        _, q1, q2 = path(s)
        jerk = path.third(s) * ds**3 + 3 * q2 * ds * dds + q1 * ddds
        values = q1 * ds / bounds.velocity, (q2 * ds**2 + q1 * dds) / bounds.acceleration, jerk / bounds.jerk
        return np.concatenate([y.ravel() for y in values])

    T = start.duration
    x = np.concatenate([[T], start.third((np.arange(parts) + 0.5) / parts * T)])
    size = np.concatenate([[T], np.full(parts, np.abs(x[1:]).max())])
    rules = [
        {"type": "ineq", "fun": lambda y: 1 - shares(y * size)},
        {"type": "ineq", "fun": lambda y: 1 + shares(y * size)},
        {"type": "eq", "fun": lambda y: motion(y * size)[1]},
    ]
    found = minimize(
        lambda y: y[0], x / size, method="SLSQP", constraints=rules, options={"maxiter": 1000, "ftol": 1e-8}
    )
    x = found.x * size
    assert np.abs(shares(x)).max() < 1 + 1e-5 and np.abs(motion(x)[1]).max() < 1e-6, found.message
    return float(x[0])


@pytest.mark.slow
@pytest.mark.parametrize("jerk", [400.0, 100.0, 25.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_gap_to_collocation_is_at_most_a_tenth(bundled, seed, jerk):
    """Measured -1 to 9 per cent: the less jerk, the more; below zero where 40 parts are too few."""
    robot = bundled("planar_2r")
    path = spline(robot, np.random.default_rng(seed).uniform(-1, 1, (3 + seed % 2, 2)))
    motion = fastest(robot, path, jerk=jerk, velocity=3.0, acceleration=10.0)
    best = shortest_by_collocation(path, motion.bounds, fitted(robot, path, None, motion.bounds))
    print(
        f"jerk {jerk:g}, path {seed}: {motion.duration:.4f} s, collocation {best:.4f} s, {motion.duration / best - 1:+.1%}"
    )
    assert motion.duration < 1.1 * best


LINES = [
    (2, 10, 100, 1), (2, 10, 1000, 1), (2, 1000, 50, 1), (100, 1000, 50, 1), (100, 10, 100, 1), (1, 20, 60, 2), (3, 10, 100, 1)
]  # fmt: skip


@pytest.mark.parametrize(("v", "a", "j", "d"), mostly_slow(LINES, 2))
def test_straight_lines_take_as_long_as_ruckig_finds(v, a, j, d):
    """Ruckig's times, from rest to rest, are exact. The second window costs 1/250; where no phase of constant acceleration is
    left but one of constant velocity, a ramp of the time-optimal motion stays in: 1 to 2 per cent."""
    ruckig = pytest.importorskip("ruckig")
    given, exact = ruckig.InputParameter(1), ruckig.Trajectory(1)
    given.current_position, given.target_position = [0.0], [float(d)]
    given.max_velocity, given.max_acceleration, given.max_jerk = [float(v)], [float(a)], [float(j)]
    ruckig.Ruckig(1).calculate(given, exact)
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    motion = fastest(mass, joint_line(mass, [0], [d]), velocity=v, acceleration=a, jerk=j, effort=np.inf)
    print(
        f"{v, a, j, d}: {motion.duration:.4f} s, ruckig {exact.duration:.4f} s, {motion.duration / exact.duration - 1:+.2%}"
    )
    assert exact.duration * (1 - 1e-6) <= motion.duration <= exact.duration * 1.025
