"""Free flight: what it keeps, at what order it converges, and the two exact solutions of torque-free rotation.

The exact solutions are independent of the integrator: Jacobi's elliptic functions from SciPy for three unequal moments
(Landau and Lifshitz, Mechanics, section 37), and two turns at constant rates for two equal ones.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import twistwrench as tw
from twistwrench.mechanics.bodies import inertia as splitting
from twistwrench.mechanics.bodies.free_body import Flight

EPS = np.finfo(float).eps
MOMENTS = np.array([0.01, 0.02, 0.03])
UNEQUAL = tw.RigidBody(tw.SpatialInertia.from_com(1.2, moment_about_com=np.diag(MOMENTS)))
"""Principal axes and centre of mass are those of {b}."""
SKEWED = UNEQUAL.in_frame(tw.se3.exp([0.3, -0.5, 0.8, 0.2, -0.1, 0.05]))
"""The same body from a frame that is neither."""
FLIPPING = np.array([0.1, 5.0, 0.0, 0.0, 0.0, 0.02])
"""Turning about the middle axis, with a push of 0.1 rad/s about the first."""


def exact_rotation(moments: np.ndarray, w0: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, float]:
    """Body angular velocities (n, 3) of a torque-free body with w0[2] = 0 or w0[0] = 0, and their period.

    For I1 < I2 < I3 from the moment at which the component that changes sign, of axis 2, is zero: (cn, sn, dn) or (dn, sn, cn)
    by whether L² is below or above 2 E I2. Here the start is a quarter period later, where w2 is at its largest.
    """
    I1, I2, I3 = moments
    L2, E2 = np.sum((moments * w0) ** 2), np.sum(moments * w0**2)  # L², 2E
    if L2 < E2 * I2:  # the polhode winds about axis 1: swap the roles of 1 and 3
        I1, I3, swap = I3, I1, True
    else:
        swap = False
    rate = np.sqrt((I3 - I2) * (L2 - E2 * I1) / (I1 * I2 * I3))
    m = (I2 - I1) * (E2 * I3 - L2) / ((I3 - I2) * (L2 - E2 * I1))
    quarter = ellipk(m)
    sn, cn, dn, _ = ellipj(rate * t + quarter, m)
    a1 = np.sqrt((E2 * I3 - L2) / (I1 * (I3 - I1)))
    a2 = np.sqrt((E2 * I3 - L2) / (I2 * (I3 - I2)))
    a3 = np.sqrt((L2 - E2 * I1) / (I3 * (I3 - I1)))
    w = np.stack([a1 * cn, a2 * sn, a3 * dn], axis=-1)
    if swap:
        w = w[:, ::-1]
        w[:, 0] *= np.sign(w0[0])
    return w, 4.0 * quarter / rate


def sampled(body: tw.RigidBody, V0: np.ndarray, duration: float, dt: float, **options: object) -> Flight:
    return body.fly(np.eye(4), V0, duration, dt, **options)


# ── the exact solutions ──


def test_the_flip_follows_jacobis_elliptic_functions():
    # Order 6 at 1 ms leaves rounding: 1e-16 a step, walking at random for some thousand, and growing with the motion away
    # from the unstable axis by the ratio of largest to smallest ω1, some 70. That is 5e-13; the bound is twenty times it.
    flight = sampled(UNEQUAL, FLIPPING, 4.0, 1e-3, order=6)
    exact, period = exact_rotation(MOMENTS, FLIPPING[:3], flight.times)
    # Signs, which depend on the quarter of the period, are Euler's equations' affair (tests/bodies/test_bodies.py).
    gap = np.abs(np.abs(flight.twists[:, :3]) - np.abs(exact)).max()
    assert 0.5 < flight.times[-1] / period < 2.0, "the flight should contain a flip"
    assert gap <= 1e-11 * 5.0


def flips(flight: Flight) -> np.ndarray:
    """Times at which the middle component of the angular velocity crosses zero, by Newton on a local polynomial."""
    w = flight.twists[:, 1]
    found = []
    for i in np.flatnonzero(w[1:] * w[:-1] < 0):
        s = slice(i - 3, i + 5)
        t = flight.times[s] - flight.times[i]
        fit = np.polynomial.Polynomial.fit(t, w[s], 7)
        roots = fit.roots()
        real = roots[np.abs(roots.imag) < 1e-12].real
        found.append(flight.times[i] + real[np.argmin(np.abs(real - 0.5 * t[4]))])
    return np.array(found)


def test_the_period_of_the_flip_is_the_exact_one():
    flight = sampled(UNEQUAL, FLIPPING, 12.0, 1e-3, order=4)
    _, period = exact_rotation(MOMENTS, FLIPPING[:3], np.zeros(1))
    between = 2.0 * np.diff(flips(flight))
    assert len(between) >= 2
    # Issue: 1e-8. The energy error of order 4, 1e-13 here, moves the period by that over the distance to the separatrix.
    assert np.abs(between / period - 1.0).max() <= 1e-8


@pytest.mark.parametrize("along", [0.011, 0.029], ids=["long", "flat"])
def test_an_axisymmetric_body_precesses_as_the_closed_form_says(along):
    across = 0.02
    body = tw.RigidBody(tw.SpatialInertia.from_com(1.2, moment_about_com=np.diag([across, across, along])))
    w0 = np.array([1.0, 0.0, 7.0])
    flight = sampled(body, np.array([*w0, 0, 0, 0]), 10.0, 0.1, order=2)
    # R(t) = exp([L] t / I_across) exp([z] Ω t), Ω = (1 - I_along/I_across) ω3: precession about L, spin about the axis.
    t = flight.times[:, None]
    L = np.array([across * w0[0], 0.0, along * w0[2]])
    spin = (1.0 - along / across) * w0[2]
    exact = tw.so3.exp(t * L / across) @ tw.so3.exp(t * np.array([0, 0, spin]))
    # Exact at any step: what is left is rounding of angles up to 150 rad and of 100 products.
    assert np.abs(flight.poses[:, :3, :3] - exact).max() <= 150 * 4 * EPS
    assert flight.drift.energy <= 100 * EPS


def test_a_ball_turns_at_constant_speed():
    ball = tw.RigidBody(tw.SpatialInertia.sphere(0.1, mass=3.0))
    V0 = np.array([1.0, -2.0, 0.5, 0, 0, 0])
    flight = sampled(ball, V0, 3.0, 0.5)
    exact = tw.se3.exp(np.multiply.outer(flight.times, V0))
    assert np.abs(flight.poses - exact).max() <= 100 * EPS


# ── order ──


@pytest.mark.parametrize("order", [2, 4, 6])
def test_the_composition_satisfies_its_order_conditions(order):
    c = np.array(splitting.COMPOSITIONS[order])
    assert np.array_equal(c, c[::-1])
    assert abs(c.sum() - 1.0) <= 4 * EPS
    for power in range(3, order, 2):
        assert abs((c**power).sum()) <= 20 * EPS


def slope(steps: list[float], errors: list[float]) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.mark.parametrize(
    ("order", "steps"), [(2, [0.02, 0.01, 0.005]), (4, [0.04, 0.02, 0.01]), (6, [0.1, 0.05, 0.025])]
)
def test_the_order_of_torque_free_flight(order, steps):
    V0 = np.array([1.0, 5.0, 0.5, 0.1, 0.2, 0.3])
    end = sampled(SKEWED, V0, 2.0, 2e-3, order=6).poses[-1]
    errors = [float(np.abs(sampled(SKEWED, V0, 2.0, h, order=order).poses[-1] - end).max()) for h in steps]
    assert abs(slope(steps, errors) - order) <= 0.2, errors  # the next term of the error is two powers higher


PULLED_START = np.array([1.0, 5.0, 0.5, 0.1, 0.2, 0.3])


def pulled(t: float, T: np.ndarray, V: np.ndarray) -> np.ndarray:
    """A wrench that depends on everything: weight, drag, and something that turns with time."""
    return SKEWED.weight(T) - 0.02 * V + np.array([0, 0.1 * np.sin(3 * t), 0, 0, 0, 0])


@functools.cache
def pulled_flight() -> Flight:
    return sampled(SKEWED, PULLED_START, 1.0, 0.5, wrench=pulled, tolerance=1e-12)


@pytest.mark.parametrize(("order", "steps"), [(2, [0.04, 0.02, 0.01]), (4, [0.1, 0.05, 0.025])])
def test_the_order_under_a_wrench_of_time_pose_and_twist(order, steps):
    end, errors = pulled_flight(), []
    for h in steps:
        flight = sampled(SKEWED, PULLED_START, 1.0, h, wrench=pulled, order=order)
        errors.append(float(np.abs(flight.poses[-1] - end.poses[-1]).max()))
    assert abs(slope(steps, errors) - order) <= 0.25, errors


# ── what is kept ──


def check_long_flight(steps: int) -> None:
    # The centre of mass drifts some 20 m in a million steps: at 10 km, rounding of the position alone would be 1e-12 of p × f.
    w = np.array([0.5, 5.0, 0.3])
    V0 = np.array([*w, *(np.array([0.0, 1e-3, 2e-3]) - np.cross(w, SKEWED.inertia.com))])
    flight = sampled(SKEWED, V0, steps * 0.01, 0.01)
    P, E = flight.momentum, flight.energy
    # Against its own size, by halves, since N m s and N s do not compare. v is the small difference of v_com and ω × c, here
    # 1e3 times it, and a chain of products rounds by 1e-15.
    for half in (slice(0, 3), slice(3, 6)):
        assert np.abs(P[:, half] - P[0, half]).max() <= 1e-12 * np.linalg.norm(P[0, half])
    assert flight.drift.momentum <= 1e-12
    assert np.abs(E / E[0] - 1.0).max() <= 1e-6
    # No trend: the straight line through the error rises by a small part of the error's own swing.
    assert abs(flight.drift.energy_trend) <= 1e-2 * flight.drift.energy
    assert flight.drift.rotation <= 20 * EPS


def test_momentum_and_energy_over_twenty_thousand_steps():
    check_long_flight(20_000)


@pytest.mark.slow
def test_momentum_and_energy_over_a_million_steps():
    check_long_flight(1_000_000)


def test_a_wrong_integrator_fails_the_same_measure():
    """Euler's steps on the body momentum, the usual shortcut, gain more than 1e-6 in a flight of a second."""
    m, h = MOMENTS * FLIPPING[:3], 1e-3
    E0 = 0.5 * np.sum(m**2 / MOMENTS)
    for _ in range(1000):
        m = m + h * np.cross(m, m / MOMENTS)
    assert abs(0.5 * np.sum(m**2 / MOMENTS) / E0 - 1.0) > 1e-6


# ── wrenches ──


def test_a_thrown_body_follows_the_parabola():
    T0, V0 = tw.se3.exp([0.1, 0.2, 0.3, 1, 2, 3]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    g = np.array([0.0, 0.0, -9.81])
    flight = SKEWED.fly(T0, V0, 1.0, 0.05, lambda t, T, V: SKEWED.weight(T, g))
    com = SKEWED.inertia.com
    path = flight.poses[:, :3, :3] @ com + flight.poses[:, :3, 3]
    t = flight.times[:, None]
    v = T0[:3, :3] @ SKEWED.point_velocity(V0, com)
    # The impulse at mid-step is exact for a constant force: rounding alone, of numbers up to 15.
    assert np.abs(path - (path[0] + v * t + 0.5 * g * t**2)).max() <= 15 * 100 * EPS
    height = path[:, 2] - path[0, 2]
    assert np.abs(flight.work + SKEWED.inertia.mass * 9.81 * height).max() <= 1e-12


def test_a_constant_torque_about_a_principal_axis_spins_up():
    flight = UNEQUAL.fly(np.eye(4), np.zeros(6), 2.0, 0.1, [0, 0, 0.06, 0, 0, 0])
    assert np.abs(flight.twists[:, 2] - 2.0 * flight.times).max() <= 100 * EPS * 4
    assert flight.work[-1] == pytest.approx(0.5 * 0.03 * 4.0**2, rel=1e-13)
    assert flight.drift.energy <= 1e-13


def test_drag_takes_energy_and_the_books_balance():
    flight = sampled(SKEWED, FLIPPING, 1.0, 0.02, wrench=lambda t, T, V: -0.05 * V)
    assert flight.energy[-1] < 0.8 * flight.energy[0]
    assert flight.drift.momentum <= 1e-13
    assert flight.drift.energy <= 1e-9


def test_adaptive_steps_agree_with_the_fixed_ones():
    fixed = sampled(SKEWED, FLIPPING, 2.0, 1e-2, order=6)
    adaptive = sampled(SKEWED, FLIPPING, 2.0, 1e-2, tolerance=1e-12)
    assert np.array_equal(fixed.times, adaptive.times)
    assert np.abs(fixed.poses - adaptive.poses).max() <= 1e-9  # local 1e-12, grown along the unstable axis
    assert adaptive.drift.momentum <= 1e-13


def test_keeping_one_state_in_many():
    full, thin = (sampled(SKEWED, FLIPPING, 1.0, 0.01, every=k) for k in (1, 7))
    assert np.allclose(thin.times, [*np.arange(0, 100, 7) / 100, 1.0])
    assert np.array_equal(thin.poses[:-1], full.poses[::7])
    assert np.array_equal(thin.poses[-1], full.poses[-1])


# ── refusals ──


def mirrored() -> np.ndarray:
    return np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"T0": np.eye(3)}, r"T0 has shape \(3, 3\)"),
        ({"T0": 1.01 * np.eye(4)}, "T0 is not a pose: its last row is 0.01 off"),
        ({"T0": np.diag([1.01, 1.01, 1.01, 1.0])}, r"T0 is not a rotation: R' R is 0\.0201 off"),
        ({"T0": mirrored()}, "T0 is not a rotation but a reflection: det R = -1"),
        ({"V0": np.ones(5)}, r"V0 has shape \(5,\)"),
        ({"V0": np.full(6, np.nan)}, r"V0 has the entry nan at \(0,\)"),
        ({"duration": 0.0}, "duration is 0"),
        ({"dt": -0.1}, "dt is -0.1"),
        ({"order": 3}, r"choose one of \[2, 4, 6\]"),
        ({"every": 0}, "every is 0"),
        ({"every": "a"}, "every is 'a', expected one real number"),
        ({"every": 1.5}, "every is 1.5, and must be a whole number"),
        ({"every": np.nan}, "every is nan"),
        ({"order": [2]}, r"order is \[2\], expected one real number"),
        ({"tolerance": "x"}, "tolerance is 'x', expected one real number"),
        ({"tolerance": np.nan}, "tolerance is nan"),
        ({"duration": np.nan}, "duration is nan"),
        ({"duration": None}, "duration is None, expected one real number"),
        ({"dt": 1j}, "dt is 1j, expected one real number"),
        ({"duration": 1e300, "dt": 1e-300}, "makes more than 1e8 states"),
        ({"V0": "abc"}, r"V0 has shape \(\) of text, expected \(6,\)"),
        ({"V0": np.ones(6, complex)}, "V0 has shape .* of complex numbers"),
        ({"T0": np.full((4, 4), np.nan)}, "T0 has the entry nan"),
        ({"wrench": "abc"}, "wrench has shape"),
        ({"wrench": lambda t, T, V: None}, "the wrench has shape .* of NoneType"),
        ({"tolerance": 1e-20}, "between 1e-13 and"),
        ({"wrench": np.ones(3)}, r"wrench has shape \(3,\)"),
        ({"wrench": lambda t, T, V: np.ones(3)}, r"the wrench has shape \(3,\)"),
        ({"wrench": lambda t, T, V: -1e6 * V}, "smaller dt"),
    ],
)
def test_bad_input_is_refused_in_words(change, message):
    good = {"T0": np.eye(4), "V0": np.ones(6), "duration": 1.0, "dt": 0.1}
    with pytest.raises(tw.TwistWrenchError, match=message):
        UNEQUAL.fly(**{**good, **change})


def test_a_rod_without_thickness_does_not_fly():
    rod = tw.RigidBody(tw.SpatialInertia.from_points([1.0, 1.0], [[0, 0, 1], [0, 0, -1]]))
    with pytest.raises(tw.InertiaError, match="thickness"):
        rod.fly(np.eye(4), np.ones(6), 1.0, 0.1)


# ── labels ──

FORCE = tw.Wrench([0, 0, 0, 0, 0, 2.0], "b")
T_SB, T_BS = (tw.Pose(np.eye(4), to=to, of=of) for to, of in (("s", "b"), ("b", "s")))
V_B = tw.Twist(np.ones(6), "b")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"T0": T_BS}, "T0 = T_bs of 's', V0 in 'b'"),
        ({"V0": tw.Twist(np.ones(6), "s")}, "T0 = T_sb of 'b', V0 in 's'"),
        ({"V0": tw.Wrench(np.ones(6), "b")}, "V0 is a Twist, not a Wrench"),
        ({"T0": V_B}, "T0 is a Pose, not a Twist"),
        ({"wrench": tw.Wrench(np.ones(6), "s")}, "V0 in 'b', wrench in 's'"),
        ({"T0": np.eye(4), "V0": np.ones(6), "wrench": V_B}, "wrench is a Wrench, not a Twist"),
        ({"wrench": lambda t, T, V: tw.Wrench(np.ones(6), "s")}, "the body in 'b', wrench in 's'"),
        ({"wrench": lambda t, T, V: V_B}, "wrench is a Wrench, not a Twist"),
        (
            {
                "T0": np.eye(4),
                "V0": np.ones(6),
                "wrench": lambda t, T, V: tw.Wrench(np.ones(6), "b" if t < 0.5 else "s"),
            },
            "the body in 'b', wrench in 's'",
        ),
    ],
)
@pytest.mark.parametrize("tolerance", [None, 1e-6])
def test_labels_of_two_frames_do_not_fly(change, message, tolerance):
    with pytest.raises(tw.FrameError, match=message):
        UNEQUAL.fly(**{"T0": T_SB, "V0": V_B, "duration": 1.0, "dt": 0.1, "tolerance": tolerance, **change})


def test_labels_that_agree_fly_as_plain_arrays_do():
    plain = UNEQUAL.fly(np.eye(4), V_B.values, 1.0, 0.1, FORCE.values)
    for wrench in (FORCE, lambda t, T, V: FORCE):
        assert np.array_equal(UNEQUAL.fly(T_SB, V_B, 1.0, 0.1, wrench).poses, plain.poses)


class Takes:
    def two(self, t, T):
        return np.zeros(6)


@pytest.mark.parametrize(
    "law", [lambda: None, lambda t: None, Takes().two, lambda t, T, V, more: None, lambda *, t: None]
)
def test_a_function_of_other_arguments_is_told_the_ones_it_gets(law):
    with pytest.raises(tw.ValueRangeError, match=r"is called as wrench\(t, T, V\)"):
        UNEQUAL.fly(np.eye(4), np.ones(6), 1.0, 0.1, law)


def test_errors_inside_the_function_are_the_users_own():
    def law(t, T, V):
        raise TypeError("mine")

    with pytest.raises(TypeError, match="mine"):
        UNEQUAL.fly(np.eye(4), np.ones(6), 1.0, 0.1, law)


# ── what a flight says of itself ──


def test_a_shortened_step_is_said():
    flight = sampled(UNEQUAL, [0.1, 0.2, 0.3, 0, 0, 0], 1.0, 0.3)
    assert (flight.dt, flight.step) == (0.3, 0.25)
    assert flight.remarks == ("steps of 0.25 s, not 0.3 s, so that a whole number fills 1 s",)
    assert str(flight).startswith("Flight of 1 s: 5 states, steps of 0.25 s; drift: momentum ")
    assert str(flight).endswith(flight.remarks[0]) and str(flight.drift).endswith(flight.remarks[0])
    assert sampled(UNEQUAL, FLIPPING, 1.0, 0.1).remarks == ()
    assert sampled(UNEQUAL, FLIPPING, 3.0, 0.01).remarks == ()  # 3 / 0.01 is not 300 in floats


@pytest.mark.parametrize("order", [2, 4])
def test_steps_too_large_to_be_right_are_said(order):
    """By the exact rotation: what is said to be too large is in fact lost."""
    quiet, loud = (sampled(UNEQUAL, FLIPPING, 20.0, dt, order=order) for dt in (0.1, 0.4))
    for flight in (quiet, loud):
        assert flight.turn == pytest.approx(flight.step * np.linalg.norm(flight.twists[:, :3], axis=1).max(), rel=1e-12)
    assert quiet.remarks == ()
    assert quiet.turn < 1 < loud.turn
    assert f"turns up to {loud.turn:.3g} rad in a step" in loud.remarks[0]
    assert quiet.drift.energy < 0.01 < loud.drift.energy
    assert f"the energy is off by {100 * loud.drift.energy:.2g} %" in loud.remarks[1]
    exact = exact_rotation(MOMENTS, FLIPPING[:3], loud.times)[0]
    assert np.abs(loud.twists[:, :3] - exact).max() > 1.0


def test_steps_that_are_exact_or_adapt_may_be_as_large_as_one_likes():
    flat = tw.RigidBody(tw.SpatialInertia.from_com(1.0, moment_about_com=np.diag([0.01, 0.01, 0.02])))
    assert sampled(flat, [1, 2, 3, 0, 0, 0], 10.0, 5.0).remarks == ()
    assert sampled(UNEQUAL, FLIPPING, 10.0, 5.0, tolerance=1e-9).remarks == ()


def short_push(t, T, V):
    """100 N for 5 ms, 0.5 N s."""
    return [0, 0, 0, 0, 0, 100.0 if 0.5 <= t < 0.505 else 0.0]


@pytest.mark.slow
@pytest.mark.parametrize("order", [2, 4, 6])
def test_a_pulse_between_the_times_of_a_method_is_remarked(order):
    body = tw.RigidBody(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=2.0))
    missed = body.fly(np.eye(4), np.zeros(6), 1.0, 0.05, short_push, order=order)
    assert any("changes within steps of 0.05 s" in r and "t = 0.50" in r for r in missed.remarks), missed
    seen = body.fly(np.eye(4), np.zeros(6), 1.0, 0.0005, short_push, order=order)
    assert seen.remarks == () and abs(seen.twists[-1, 5] - 0.25) < 0.05 * 0.25  # a step more or less of ten


def test_a_pulse_is_not_missed_with_a_tolerance():
    body = tw.RigidBody(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=2.0))
    for dt in (0.05, 0.5):
        found = body.fly(np.eye(4), np.zeros(6), 1.0, dt, short_push, tolerance=1e-9)
        assert abs(found.twists[-1, 5] - 0.25) < 1e-5 and found.remarks == ()


def test_smooth_wrenches_are_not_remarked():
    body = tw.RigidBody(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=2.0))
    found = body.fly(
        np.eye(4), 0.1 * np.ones(6), 1.0, 0.02, lambda t, T, V: 1e-3 * np.sin(9 * t) * np.ones(6) - 1e-3 * V
    )
    assert found.remarks == ()
