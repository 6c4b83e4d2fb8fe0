"""The fastest timing: never beyond a limit, at one of them at all times, and as fast as closed forms say."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

import twistwrench as tw
from twistwrench import trajectories
from twistwrench.trajectories import fastest, joint_line, spline

WITHIN = 1e-6
"""The part of a limit by which none may be passed, and one is touched at all times."""


def instants(motion: trajectories.Fastest, count: int = 4000) -> np.ndarray:
    """Random, so that none of them is one the search looked at."""
    return np.random.default_rng(0).uniform(0, motion.duration, count)


def assert_extreme(motion: trajectories.Fastest) -> None:
    shares = motion.shares(instants(motion))
    assert shares.max() <= 1 + WITHIN
    assert shares.min() >= 1 - WITHIN
    touches = motion.limit_contacts
    assert touches[0].begin == 0
    assert touches[-1].end == pytest.approx(motion.duration, rel=1e-12)
    assert all(a.end == b.begin for a, b in itertools.pairwise(touches))


def assert_its_rates_are_derivatives(motion: trajectories.Fastest) -> None:
    t, h = instants(motion, 500), 1e-6
    t = t[(t > 2 * h) & (t < motion.duration - 2 * h)]
    ahead, behind, now = motion(t + h), motion(t - h), motion(t)
    assert_allclose((ahead[0] - behind[0]) / (2 * h), now[1], atol=1e-6 * (1 + np.abs(now[2]).max()))
    off = np.abs((ahead[1] - behind[1]) / (2 * h) - now[2]).max(axis=1)
    assert np.median(off) < 1e-6 * (1 + np.abs(now[2]).max())  # the instants beside a switch stand out


def test_an_instant_is_where_it_is_whatever_others_are_asked(bundled):
    """Shares of pieces are sought sample by sample: neither how many there are nor which tells in the last bit."""
    arm = bundled("planar_2r")
    motion = fastest(arm, joint_line(arm, [0, 0], [1, 1]), effort=[60, 30])
    t = instants(motion, 5000)
    together = motion.scaling(t)
    for some in (slice(7, 8), slice(2040, 2060), slice(4999, 3, -1)):
        for one, all_of_them in zip(motion.scaling(t[some]), together, strict=True):
            np.testing.assert_array_equal(one, all_of_them[some])
    s = motion.scaling(np.sort(t))[0]
    assert (np.diff(s) >= 0.0).all() and 0.0 < s[0] < s[-1] < 1.0


def test_the_work_of_an_instant_does_not_grow_with_their_number(bundled, monkeypatch):
    """One that rounding keeps from settling is sought on alone."""
    arm, sizes = bundled("planar_2r"), []
    motion = fastest(arm, joint_line(arm, [0, 0], [1, 1]), effort=[60, 30])
    integral = trajectories.collocation.FastestScaling._integral
    monkeypatch.setattr(
        trajectories.collocation.FastestScaling,
        "_integral",
        lambda self, k, *rest: sizes.append(len(k)) or integral(self, k, *rest),
    )
    each = []
    for count in (50, 5000):
        motion.scaling(instants(motion, count))
        each.append(sum(sizes) / count)
        sizes.clear()
    assert each[1] < 1.5 * each[0] and each[1] < 20.0


@pytest.mark.parametrize(("d", "a"), [(2.0, 8.0), (-0.3, 5.0), (6.0, 1.0)])
def test_a_mass_is_driven_bang_bang(d, a):
    """A double integrator takes 2 √(d/a)."""
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])  # 1 kg at 1 m
    motion = fastest(mass, joint_line(mass, [0], [d]), effort=a)
    assert motion.duration == pytest.approx(2 * np.sqrt(abs(d) / a), rel=1e-7)
    assert_allclose(
        motion([0.3 * motion.duration, 0.7 * motion.duration])[2][:, 0], [np.sign(d) * a, -np.sign(d) * a], rtol=1e-7
    )
    assert [t.side for t in motion.limit_contacts] == [np.sign(d), -np.sign(d)]
    assert_extreme(motion)


def test_a_motion_begins_with_full_force_and_ends_with_it_and_rests_before_and_after():
    """Also the first and the last row of a table of it; a double integrator of 1 kg m² has 8 rad/s² at 8 N m."""
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    motion = fastest(mass, joint_line(mass, [0], [2.0]), effort=8.0)
    T = motion.duration
    assert_allclose(motion([0.0, T])[2][:, 0], [8.0, -8.0], rtol=1e-6)
    q, dq, ddq = motion([-0.1, T + 0.1])
    assert_allclose(np.stack([q, dq, ddq])[..., 0], [[0.0, 2.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize(("d", "a", "b"), [(2.0, 8.0, 2.0), (-0.3, 5.0, 40.0), (6.0, 1.0, 1.0)])
def test_a_mass_that_slows_down_by_another_limit_than_it_speeds_up(d, a, b):
    """It gets to the speed v in v/a, and to rest in v/b: d = v²/2 (1/a + 1/b)."""
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    motion = fastest(mass, joint_line(mass, [0], [d]), acceleration=a, deceleration=b)
    assert motion.duration == pytest.approx(np.sqrt(2 * abs(d) * (1 / a + 1 / b)), rel=1e-7)
    assert [touch.side for touch in motion.limit_contacts] == [np.sign(d), -np.sign(d)]
    assert motion.violations() == ()
    assert_extreme(motion)
    sharper = tw.trajectories.bounds_of(mass, acceleration=a, deceleration=0.9 * b)
    (passed,) = motion.violations(sharper)
    assert (passed.kind, passed.limit) == ("acceleration", pytest.approx(-np.sign(d) * 0.9 * b, rel=1e-12))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_spline_is_kept_to_both_limits_while_joints_turn_back(bundled, seed):
    """Joints change direction on the way, each at a place of its own: there the limits that apply change over."""
    arm = bundled("ur5")
    rng = np.random.default_rng(seed)
    path = spline(arm, rng.uniform(-1.0, 1.0, (5, 6)))
    assert (np.diff(np.sign(path(np.linspace(0, 1, 500))[1]), axis=0) != 0).any()
    motion = fastest(arm, path, acceleration=[8, 8, 8, 12, 12, 12], deceleration=[4, 16, 8, 6, 24, 12])
    assert_extreme(motion)
    assert motion.violations(motion.bounds) == ()
    assert motion.duration < fastest(arm, path, acceleration=[4, 8, 8, 6, 12, 12]).duration
    shorter = trajectories.fitted(arm, path, bounds=motion.bounds)
    assert trajectories.Trajectory(arm, path, shorter).violations(motion.bounds) == ()


def test_acceleration_limits_of_the_file_are_kept_if_none_are_given(bundled):
    limited = tw.load(
        tw.robots.path_of("ur5").read_text().replace("effort=", 'acceleration="3" deceleration="2" effort=')
    )
    path = joint_line(limited, [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0])
    own = fastest(limited, path)
    assert own.duration == pytest.approx(fastest(bundled("ur5"), path, acceleration=3.0, deceleration=2.0).duration)
    assert str(own).endswith("limits of acceleration are the robot's own")
    assert "robot's own" not in str(fastest(limited, path, acceleration=30.0))
    assert trajectories.move(limited, [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0]).violations() == ()


@pytest.mark.parametrize(("shape", "largest"), [("quintic", 60.0), ("cubic", np.inf), ("trapezoid", np.inf)])
def test_limits_of_jerk_are_judged(shape, largest):
    """Over d = 0.5 rad in T = 2 s a quintic has jerks of 60 d/T³ at most; the others jump, if only where they begin."""
    made = {"trapezoid": trajectories.trapezoid(v=0.75, duration=2.0)}
    scaling = made[shape] if shape in made else getattr(trajectories, shape)(2.0)
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    motion = trajectories.Trajectory(mass, joint_line(mass, [0], [0.5]), scaling)
    exact = largest * 0.5 / 2.0**3
    assert motion.violations(trajectories.bounds_of(mass, jerk=min(1.001 * exact, 1e9))) == () or exact == np.inf
    (passed,) = motion.violations(trajectories.bounds_of(mass, jerk=min(0.999 * exact, 50.0)))
    assert passed.kind == "jerk"
    assert abs(passed.value) == pytest.approx(exact, rel=1e-4) or exact == np.inf


def test_a_mass_with_a_velocity_limit_coasts():
    """It takes d/v + v/a."""
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    motion = fastest(mass, joint_line(mass, [0], [2.0]), effort=8.0, velocity=2.5)
    assert motion.duration == pytest.approx(2 / 2.5 + 2.5 / 8, rel=1e-7)
    assert [t.kind for t in motion.limit_contacts] == ["torque", "velocity", "torque"]


def test_a_pendulum_agrees_with_its_energy():
    """Forward all torque is used until the switch, where ½ v² = T q - g (1 - cos q); then back, likewise."""
    pendulum, limit, end = tw.robots.pendulum(), 14.0, 2.0
    motion = fastest(pendulum, joint_line(pendulum, [0], [end]), effort=limit)
    switch = motion(motion.limit_contacts[1].begin)[0][0]
    assert limit * switch == pytest.approx(limit * (end - switch) + 9.81 * (np.cos(0) - np.cos(end)), rel=1e-6)
    assert_extreme(motion)


PATHS = [
    ("planar_2r", 0, {"effort": 60.0}),
    ("planar_2r", 3, {"effort": 60.0, "acceleration": 15.0}),
    pytest.param("ur5", 0, {"acceleration": 15.0}, marks=pytest.mark.slow),
    ("ur5", 5, {"velocity": np.inf}),
    pytest.param("ur5", 8, {}, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("name", "seed", "limits"), PATHS)
def test_never_a_limit_is_passed_and_always_one_is_touched(bundled, name, seed, limits):
    robot = bundled(name)
    rng = np.random.default_rng(seed)
    path = spline(robot, 0.5 * robot.random_configuration(rng, int(rng.integers(2, 7))))
    motion = fastest(robot, path, **limits)
    assert_extreme(motion)
    assert_its_rates_are_derivatives(motion)


def test_also_along_a_straight_line_of_the_tip(bundled):
    robot = bundled("ur5")
    q0 = np.array([0, -1.2, 1.5, -0.3, 1.5, 0])
    T = robot.forward_kinematics(q0)
    end = T.copy()
    end[:3, 3] += [0.1, -0.2, 0.15]
    motion = fastest(robot, trajectories.follow_poses(robot, trajectories.straight_path(T, end), q0))
    assert_extreme(motion)


def test_also_with_friction(bundled):
    text = tw.robots.path_of("planar_2r").read_text()
    drag = '<dynamics damping="1.5" friction="0.8"/><axis'
    robot = tw.load(text.replace("<axis", drag))
    path = spline(robot, [[0, 0], [0.8, -0.5], [0.3, 0.9]])
    motion = fastest(robot, path, effort=[60, 30], friction=True)
    assert_extreme(motion)
    assert motion.shares(motion.duration * (1 - np.logspace(-9, -2, 200))).max() <= 1  # where √x is not a polynomial
    assert motion.duration != pytest.approx(fastest(robot, path, effort=[60, 30]).duration, rel=1e-3)


def test_friction_is_against_the_motion_at_both_of_its_ends(bundled):
    """The first and the last instant have the full share that those a microsecond within have: it resists, then it helps."""
    text = tw.robots.path_of("planar_2r").read_text()
    robot = tw.load(text.replace("<axis", '<dynamics friction="4"/><axis'))
    for efforts in ([60, 30], [600, 300]):
        motion = fastest(robot, trajectories.joint_line(robot, [0, 0], [0.8, -0.5]), effort=efforts, friction=True)
        ends = motion.duration * np.array([0.0, 1e-6, 1 - 1e-6, 1.0])
        np.testing.assert_allclose(motion.shares(ends), 1.0, atol=1e-4)


def test_it_is_no_slower_than_a_linear_programme_on_a_grid_finds(bundled):
    """Maximising the sum of x on a grid bounds x from above, as far as the grid tells: an independent oracle.

    The rates x_k on N points, u by differences, torques in the middle of each step; first order in 1/N, so 2 per cent.
    """
    robot = bundled("planar_2r")
    path = spline(robot, [[0, 0], [0.8, -0.5], [0.3, 0.9]])
    limit = np.array([60.0, 30.0])
    motion = fastest(robot, path, effort=limit)
    N = 400
    s = (np.arange(N) + 0.5) / N
    q, q1, q2 = path(s)
    zero = np.zeros_like(q1)
    g = robot.inverse_dynamics(q, zero, zero)
    a, b = robot.inverse_dynamics(q, zero, q1) - g, robot.inverse_dynamics(q, q1, q2) - g
    here, ahead = np.eye(N, N + 1), np.eye(N, N + 1, 1)
    u, x = 0.5 * N * (ahead - here), 0.5 * (ahead + here)
    A = np.concatenate([a[:, [j]] * u + b[:, [j]] * x for j in (0, 1)])
    room = np.concatenate([limit[j] - g[:, j] for j in (0, 1)]), np.concatenate([limit[j] + g[:, j] for j in (0, 1)])
    bounds = [(0, 0), *[(0, None)] * (N - 1), (0, 0)]
    found = linprog(-np.ones(N + 1), A_ub=np.vstack([A, -A]), b_ub=np.concatenate(room), bounds=bounds, method="highs")
    root = np.sqrt(np.maximum(found.x, 0))
    time = float((2 / N / (root[1:] + root[:-1])).sum())
    assert motion.duration == pytest.approx(time, rel=0.02)


def test_any_other_scaling_is_slower(bundled):
    robot = bundled("ur5")
    path = spline(robot, [[0, -1.2, 1.5, -0.3, 1.5, 0], [1, -0.8, 1.2, -0.8, 1.2, 1], [1.5, -1.5, 1.8, -0.3, 1.5, 0]])
    quick = fastest(robot, path)
    for shape in (trajectories.cubic(1.0), trajectories.quintic(1.0), trajectories.trapezoid(v=1.5, duration=1.0)):
        assert quick.duration < trajectories.fitted(robot, path, shape).duration
    assert quick.violations() == ()


@pytest.mark.parametrize("out", [1, -1], ids=["counted outward", "counted inward"])
@pytest.mark.parametrize("slope", [0.4, -0.4], ids=["upward", "downward"])
def test_a_slider_that_is_held_while_it_is_turned_is_bounded_on_both_sides(slope, out):
    """Its force is weight and m r ω²: what bounds it bounds the rate alone, by what the weight leaves on that side."""
    c, s = np.cos(slope), np.sin(slope)
    robot = tw.load(
        f"""<robot name="turntable"><link name="base"/>
        <link name="table"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="rider"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="turn" type="continuous"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/></joint>
        <joint name="slide" type="prismatic"><parent link="table"/><child link="rider"/><origin xyz="{c} 0 {s}"/>
        <axis xyz="{out * c} 0 {out * s}"/><limit lower="-1" upper="1" velocity="9" effort="20"/></joint></robot>"""
    )
    motion = fastest(robot, trajectories.joint_line(robot, [0, 0], [3, 0]), effort=[50, 20])
    assert_extreme(motion)
    weight, inward = 2 * 9.81 * s, 2 * c * c  # along the slider, and m r ω² of ω = 1
    fastest_turn = np.sqrt((20 + weight) / inward)
    assert np.abs(motion(instants(motion))[1][:, 0]).max() == pytest.approx(fastest_turn, rel=WITHIN)


def test_the_phase_plane_has_the_motion_below_its_limit_curves(bundled):
    robot = bundled("planar_2r")
    motion = fastest(robot, spline(robot, [[0, 0], [0.8, -0.5], [0.3, 0.9]]), effort=[60, 30])
    curves = motion.limit_curves()
    s, rate = curves.path
    bound = motion.rows.cap(s).x
    assert (rate**2 <= bound * (1 + 1e-6)).all()
    assert len(curves.switches[0]) == len(motion.limit_contacts) - 1


def test_a_robot_that_cannot_hold_itself_says_where_which_joint_and_how_much(bundled):
    robot = bundled("planar_2r")
    with pytest.raises(tw.PathError, match=r"s = .* 'joint1' needs 29.43 of 25 to stand still") as caught:
        fastest(robot, joint_line(robot, [-1.0, 0], [1.0, 0]), effort=[25, 20])
    angle = -1 + 2 * caught.value.reached
    assert 29.43 * np.cos(angle) == pytest.approx(25, rel=0.02)  # where it becomes too much, to the grid


def test_what_nothing_limits_is_refused(bundled):
    arm = bundled("planar_2r")
    with pytest.raises(tw.ValueRangeError, match="nothing limits"):
        fastest(arm, joint_line(arm, [0, 0], [1, 1]))
    with pytest.raises(tw.ValueRangeError, match="stands still"):
        fastest(arm, spline(arm, [[0, 0], [1, 1]], times=[0, 1]), effort=60)
    with pytest.raises(tw.ValueRangeError, match="above 0"):
        fastest(arm, joint_line(arm, [0, 0], [1, 1]), effort=[60, 0])


@pytest.mark.parametrize("effort", [1e7, 1e9, 1e12])
@pytest.mark.parametrize("through", [[[0, 0], [1.0, 0.7]], [[0, 0], [1, -1], [2, 1]]])
def test_motors_far_stronger_than_needed_lead_to_the_time_of_the_velocity_limits(bundled, effort, through):
    """With unlimited motors the time is ∫ max |q'| ds / v; a millionth of the path goes to speeding up and slowing down."""
    arm = bundled("planar_2r")
    path = joint_line(arm, *through) if len(through) == 2 else spline(arm, through)
    quick = fastest(arm, path, effort=effort, velocity=1.0)
    s = (np.arange(200_000) + 0.5) / 200_000
    assert_allclose(quick.duration, np.abs(path(s)[1]).max(axis=1).mean(), rtol=2e-5)
    assert quick.shares(np.linspace(0, quick.duration, 301)).max() <= 1 + 1e-6
    assert quick.bounds.effort.tolist() == [effort] * 2


def test_a_path_beyond_the_positions_of_a_joint_is_said(bundled):
    panda = bundled("panda")
    q = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.5])
    with pytest.warns(tw.ConstraintWarning, match=r"panda_joint1 reaches 3.5 beyond 2\.\d+ at s = 1"):
        far = fastest(panda, joint_line(panda, q, q + 3.5 * np.eye(7)[0]))
    assert any(v.kind == "position" and v.joint == "panda_joint1" for v in far.violations())
    fastest(panda, joint_line(panda, q, q + 0.5 * np.eye(7)[0]))  # within them, no warning: those are errors here
