"""Rates derived from logs: their order, their independence of windows, and how noise is found and smoothed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import wrapped

from twistwrench import robots
from twistwrench.core.estimation.noise import noise, quantum, survey
from twistwrench.formats import load_model
from twistwrench.motion.coordinates import Continuity, Coordinates, joint_rates
from twistwrench.motion.differentiation import Differentiation, noise_gain
from twistwrench.motion.log_table import windows
from twistwrench.motion.motion_log import MotionLog
from twistwrench.motion.smoothing import best_strength, margin_of, smooth, spline_rates

pytest_plugins = ("motion_fixtures",)

# ── windows ──


@given(st.integers(1, 1200), st.integers(1, 50), st.integers(0, 20))
@settings(deadline=None)
def test_windows_cover_every_row_once_with_their_neighbours(total, core, margin):
    rows, seen = np.arange(total), []
    for around, inner in windows(total, core, margin):
        window = rows[around]
        first, last = window[inner][0], window[inner][-1]
        assert first % core == 0
        np.testing.assert_array_equal(window, np.arange(window[0], window[-1] + 1))
        assert window[0] == max(0, first - margin)
        assert window[-1] >= min(total - 1, last + margin)
        assert len(window) <= core + 2 * margin + (margin if window[-1] == total - 1 else 0)
        seen.append(window[inner])
    np.testing.assert_array_equal(np.concatenate(seen), rows)


# ── derivatives ──


def motion_file(write, t, q, form="%.17g"):
    rows = "".join(",".join(form % x for x in row) + "\n" for row in np.column_stack([t, q]).tolist())
    return write("time,joint1,joint2\n" + rows)


def test_the_spline_is_of_fourth_order_in_accelerations_and_better_in_velocities():
    errors = []
    for n in (41, 81, 161):
        t = np.linspace(0, 2 * np.pi, n)
        first, second = spline_rates(t, np.sin(t)[:, None])
        inside = slice(n // 4, -n // 4)
        errors.append(
            (np.abs(first[inside, 0] - np.cos(t[inside])).max(), np.abs(second[inside, 0] + np.sin(t[inside])).max())
        )
    for coarse, fine in pairwise(errors):
        assert coarse[1] / fine[1] == pytest.approx(2**4, rel=0.2)
        assert coarse[0] / fine[0] > 0.9 * 2**5


def test_large_clock_readings_cost_no_digits():
    t = np.arange(200) / 128  # exact in binary, also after the shift
    for rates, shifted in zip(
        spline_rates(t, np.sin(t)[:, None]), spline_rates(t + 2.0**30, np.sin(t)[:, None]), strict=True
    ):
        np.testing.assert_array_equal(rates, shifted)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
@pytest.mark.parametrize("smoothing", [False, True])
def test_rates_do_not_depend_on_the_window(model, write, smoothing, jitter):
    rng = np.random.default_rng(5)
    t = (np.arange(4000) + jitter * rng.uniform(-1, 1, 4000)) * 2e-3
    q = np.column_stack([np.sin(3 * t), np.cos(2 * t)]) + 1e-5 * rng.normal(size=(4000, 2))
    plan = Differentiation.plan(MotionLog.open(motion_file(write, t, q), model), model, smoothing=smoothing)
    assert plan.strengths.any() == smoothing
    whole, *rest = plan.states(10**6)
    assert not rest
    parts = list(plan.states(700))
    assert len(parts) > 4
    # Round-off of a second difference: a few ulp of q over the square of the step.
    scale = 2.2e-16 / plan.quality.step**2
    for name, tolerance in (("q", 1e-12), ("dq", 1e-10), ("ddq", 500 * scale)):
        found = np.concatenate([getattr(s, name) for s in parts])
        np.testing.assert_allclose(found, getattr(whole, name), rtol=0, atol=tolerance)


def test_accelerations_come_from_velocities_where_those_are_given(model, write):
    t = np.arange(400) * 0.01
    columns = np.column_stack([t, np.sin(t), np.cos(t), np.cos(t), -np.sin(t)])
    text = "time,joint1,joint2,joint1.vel,joint2.vel\n" + "".join(
        ",".join(map(repr, r)) + "\n" for r in columns.tolist()
    )
    plan = Differentiation.plan(MotionLog.open(write(text), model), model)
    assert (plan.source, plan.derives_velocities) == ("velocities", False)
    (states,) = plan.states(10**6)
    np.testing.assert_array_equal(states.dq, columns[:, 3:])
    np.testing.assert_allclose(states.ddq, np.column_stack([-np.sin(t), -np.cos(t)]), atol=1e-7)


def test_given_accelerations_are_kept_when_velocities_are_derived(model, write):
    t = np.arange(400) * 0.01
    columns = np.column_stack([t, np.sin(t), np.cos(t), 7 + t, 8 + t])
    text = "time,joint1,joint2,joint1.acc,joint2.acc\n" + "".join(
        ",".join(map(repr, r)) + "\n" for r in columns.tolist()
    )
    plan = Differentiation.plan(MotionLog.open(write(text), model), model)
    (states,) = plan.states(10**6)
    np.testing.assert_array_equal(states.ddq, columns[:, 3:])
    np.testing.assert_allclose(states.dq, np.column_stack([np.cos(t), -np.sin(t)]), atol=1e-8)
    assert not plan.sigma_ddq.any()


def test_a_log_of_five_decimals_at_a_millisecond_is_cured_by_smoothing(model, write):
    t = np.arange(20000) * 1e-3
    w = np.array([3.0, 5.0])
    path = motion_file(write, t, 1.2 * np.sin(np.outer(t, w)), form="%.5f")
    exact = -1.2 * w**2 * np.sin(np.outer(t, w))
    trajectory = MotionLog.open(path, model)
    worst, spread, claimed = {}, {}, {}
    for smoothing in (False, True):
        plan = Differentiation.plan(trajectory, model, smoothing=smoothing)
        error = np.concatenate([s.ddq for s in plan.states(6000)]) - exact
        worst[smoothing], spread[smoothing] = np.abs(error[500:-500]).max(), error[500:-500].std(axis=0)
        claimed[smoothing] = plan.sigma_ddq
        np.testing.assert_allclose(plan.quality.quantum, 1e-5)
        np.testing.assert_allclose(plan.quality.noise, 1e-5 / np.sqrt(12), rtol=0.05)
    assert worst[False] > 30.0
    assert worst[True] < worst[False] / 100
    np.testing.assert_allclose(claimed[False], spread[False], rtol=0.05)  # what the report says is what is there
    np.testing.assert_allclose(claimed[True], spread[True], rtol=0.25)


def test_a_slow_joint_with_a_coarse_encoder_is_cured_by_smoothing(model, write):
    """Its error is slower than what shows as noise: each point of the grid lasts for dozens of samples."""
    t, grid = np.arange(20000) * 1e-3, 2 * np.pi / 4096
    A, w = np.array([0.05, 0.3]), np.array([0.3, 0.05])
    path = motion_file(write, t, np.round(A * np.sin(np.outer(t, w)) / grid) * grid)
    exact = -A * w**2 * np.sin(np.outer(t, w))
    spread = {}
    for smoothing in (False, True):
        plan = Differentiation.plan(MotionLog.open(path, model), model, smoothing=smoothing)
        (states,) = plan.states(10**6)
        spread[smoothing] = (states.ddq - exact)[3000:-3000].std(axis=0)
        np.testing.assert_allclose(plan.quality.quantum, grid)
        np.testing.assert_allclose(plan.sigma_ddq, spread[smoothing], rtol=0.5 if smoothing else 0.1)
    assert (spread[True] < spread[False] / 50).all()


def test_wrapped_angles_of_continuous_joints_are_unwrapped(write):
    model = load_model(robots.path_of("pendulum"))
    (name,) = Coordinates.from_model(model).names
    if not Coordinates.from_model(model).endless.all():
        pytest.skip("the pendulum's joint has ends")
    t = np.arange(2000) * 0.01
    q = (2 * t + np.pi) % (2 * np.pi) - np.pi
    path = write(f"time,{name}\n" + "".join(f"{a!r},{b!r}\n" for a, b in np.column_stack([t, q]).tolist()))
    (states,) = Differentiation.plan(MotionLog.open(path, model), model).states(10**6)
    np.testing.assert_allclose(states.dq, 2.0, atol=1e-9)


@pytest.mark.parametrize("degrees", [False, True])
@pytest.mark.parametrize("from_zero", [False, True])
def test_wrapping_is_no_noise(write, degrees, from_zero):
    model = load_model(robots.path_of("pendulum"))
    t = np.arange(6000) * 1e-3
    angle = 4 * t + np.sin(3 * t)
    turn = 360.0 if degrees else 2 * np.pi
    q = (wrapped(angle) % (2 * np.pi) if from_zero else wrapped(angle)) * turn / (2 * np.pi)
    path = write("time,hinge\n" + "".join(f"{a!r},{b!r}\n" for a, b in np.column_stack([t, q]).tolist()))
    plan = Differentiation.plan(MotionLog.open(path, model, degrees=degrees), model)
    assert plan.quality.noise[0] < 1e-14 * turn
    (states,) = plan.states(10**6)
    np.testing.assert_allclose(states.dq[:, 0], 4 + 3 * np.cos(3 * t), atol=1e-8)


def test_noise_and_strength_are_those_of_the_unwrapped_log(write):
    model = load_model(robots.path_of("pendulum"))
    t = np.arange(6000) * 1e-3
    angle = 4 * t + np.sin(3 * t) + 1e-4 * np.random.default_rng(4).normal(size=6000)
    plans = []
    for q in (angle, wrapped(angle)):
        path = write("time,hinge\n" + "".join(f"{a!r},{b!r}\n" for a, b in np.column_stack([t, q]).tolist()))
        plans.append(Differentiation.plan(MotionLog.open(path, model), model, smoothing=True))
    plain, turned = plans
    assert plain.quality.noise[0] == pytest.approx(1e-4, rel=0.05)
    np.testing.assert_allclose(turned.quality.noise, plain.quality.noise, rtol=1e-6)
    np.testing.assert_array_equal(turned.strengths, plain.strengths)


def test_signs_of_quaternions_are_no_noise(write):
    model = load_model(robots.path_of("floating_box"), floating_base=True)
    t = np.arange(3000) * 1e-3
    q = np.zeros((3000, 7))
    q[:, 0], q[:, 2] = np.cos(t), np.sin(t)
    flipped = q.copy()
    flipped[1000:2000, :4] *= -1
    noises = []
    for table in (q, flipped):
        rows = "".join(",".join(map(repr, row)) + "\n" for row in np.column_stack([t, table]).tolist())
        path = write(f"time,{','.join(Coordinates.from_model(model).names)}\n{rows}")
        noises.append(Differentiation.plan(MotionLog.open(path, model), model).quality.noise)
    np.testing.assert_array_equal(*noises)


def test_a_log_that_counts_turns_is_not_unwrapped():
    coordinates = Coordinates.from_model(load_model(robots.path_of("pendulum")))
    fast = np.arange(50.0)[:, None] * 4.0  # more than half a turn a sample
    np.testing.assert_array_equal(Continuity.from_parts(coordinates, [fast]).curves(fast), fast)
    slow = np.arange(50.0)[:, None]
    np.testing.assert_allclose(
        Continuity.from_parts(coordinates, [wrapped(slow)]).curves(wrapped(slow)), slow, atol=1e-12
    )


@pytest.mark.parametrize("name", ["floating_box"])
def test_floating_joints_give_body_rates(name):
    model = load_model(robots.path_of(name), floating_base=True)
    joint = model.leaders[0].joint
    rng = np.random.default_rng(3)
    V, dV = rng.normal(size=6), rng.normal(size=6)
    q0 = np.r_[rng.normal(size=4), rng.normal(size=3)]
    q0[:4] /= np.linalg.norm(q0[:4])
    # Follow a twist V + t dV by small steps, then differentiate the coordinates.
    steps, h = 41, 1e-3
    t = (np.arange(steps) - steps // 2) * h
    fine = 64
    q, path = q0, {}
    for side in (1, -1):
        q = q0
        path[0] = q0
        for k in range(1, steps // 2 + 1):
            for i in range(fine):
                tau = side * ((k - 1) + (i + 0.5) / fine) * h
                q = np.array(joint.add(q, (V + tau * dV) * side * h / fine, q), float)
            path[side * k] = q
    q = np.array([path[k] for k in range(-(steps // 2), steps // 2 + 1)])
    q[:, :4] *= np.linspace(0.5, 2.0, steps)[:, None]  # any length will do
    found_v, found_a = joint_rates(model, q, *spline_rates(t, q))
    np.testing.assert_allclose(found_v[steps // 2], V, atol=1e-7)
    np.testing.assert_allclose(found_a[steps // 2], dV, atol=1e-4)


def test_planar_rates_follow_the_joint():
    from twistwrench.mechanics.bodies.inertia import SpatialInertia
    from twistwrench.mechanics.joints.multi_dof import Planar
    from twistwrench.mechanics.model.model import Body, Limits, Model

    joint = Planar("slide", Planar.axes_from((0, 0, 1), 0.0, True, "slide"))
    none = np.full(3, np.inf)
    body = Body(joint, "link", -1, np.eye(4), SpatialInertia.zero(), 0, 0)
    zero = np.zeros(3)
    model = Model("p", (body,), {}, Limits(-none, none, none, none), zero, zero, zero, SpatialInertia.zero(), None)
    h, V, dV = 1e-4, np.array([0.7, -0.4, 1.1]), np.array([0.3, 0.9, -0.5])
    q0 = np.array([0.1, 0.2, 0.9])
    moves = {s: s * h * V + 0.5 * (s * h) ** 2 * dV for s in (-1, 1)}
    steps = {s: np.array(joint.add(q0, dv, q0), float) for s, dv in moves.items()}
    q1, q2 = (steps[1] - steps[-1]) / (2 * h), (steps[1] - 2 * q0 + steps[-1]) / h**2
    found_v, found_a = joint_rates(model, q0[None], q1[None], q2[None])
    np.testing.assert_allclose(found_v[0], V, atol=1e-7)
    np.testing.assert_allclose(found_a[0], dV, atol=1e-6)


# ── quality of logs ──


@pytest.mark.parametrize("sigma", [1e-6, 1e-4])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_noise_is_found_on_smooth_motion(sigma, jitter):
    rng = np.random.default_rng(0)
    t = (np.arange(4000) + jitter * rng.uniform(-1, 1, 4000)) * 1e-3
    x = np.sin(4 * t) + 0.3 * np.cos(11 * t) + sigma * rng.normal(size=4000)
    assert noise([t], [x[:, None]])[0] == pytest.approx(sigma, rel=0.05)


def test_a_clean_log_has_no_noise_and_no_grid():
    t = np.arange(4000) * 1e-3
    found = survey([t], [np.column_stack([np.sin(3 * t), np.full(4000, 0.25)])])
    assert found.step == pytest.approx(1e-3)
    assert found.noise[0] < 1e-15
    assert found.noise[1] == 0
    np.testing.assert_array_equal(found.quantum, 0)


@pytest.mark.parametrize("rest", [0, 1000])
def test_a_steady_speed_is_no_grid(rest):
    """Its increments are all alike, as those of a coarse encoder are not."""
    t = np.arange(4000) * 1e-3
    x = 0.3 * np.maximum(t - rest * 1e-3, 0.0)
    x = np.array([float(f"{value:.15g}") for value in x])
    found = survey([t], [x[:, None]])
    assert found.quantum[0] == 0
    assert found.noise[0] < (1e-15 if rest == 0 else 0.05 * 3e-4 / np.sqrt(12))


@pytest.mark.parametrize("grid", [1e-3, 2 * np.pi / 4096])
def test_a_coarse_encoder_is_a_grid_and_its_noise_is_rounding(grid):
    t = np.arange(20000) * 1e-3
    found = survey([t], [(np.round(1.2 * np.sin(3 * t) / grid) * grid)[:, None]])
    assert found.quantum[0] == pytest.approx(grid, rel=1e-6)
    assert found.noise[0] == pytest.approx(grid / np.sqrt(12), rel=0.1)


@pytest.mark.parametrize("grid", [1e-5, 1e-3, 2 * np.pi / 4096])
def test_the_grid_of_a_log_is_found(grid):
    t = np.arange(20000) * 1e-3
    assert quantum([np.round(np.sin(0.3 * t) / grid) * grid]) == pytest.approx(grid, rel=1e-6)


def test_no_strength_means_no_change_and_polynomials_pass_unchanged():
    t = np.sort(np.random.default_rng(1).uniform(0, 1, 200))
    x = 1 + 2 * t - 3 * t**2
    np.testing.assert_array_equal(smooth(t, x, 0.0, 0.005), x)
    np.testing.assert_allclose(smooth(t, x, 1e6, 0.005), x, atol=1e-9)
    assert best_strength([t], [x], 0.0, 0.005) == 0.0


@pytest.mark.parametrize("strength", [1e-1, 1e2, 1e6])
def test_the_margin_ends_a_samples_influence(strength):
    n = margin_of(strength)
    pulse = np.zeros(2 * n + 1)
    pulse[n] = 1.0
    response = smooth(np.arange(2.0 * n + 1), pulse, strength, 1.0)
    assert np.abs(response[[0, -1]]).max() < 1e-12 * 10


def test_the_gain_of_noise_is_that_of_random_noise():
    rng = np.random.default_rng(2)
    for strength in (0.0, 1e3):
        t = np.arange(30000) * 1e-2
        second = spline_rates(t, smooth(t, rng.normal(size=30000), strength, 1e-2)[:, None])[1][200:-200]
        assert noise_gain(2, strength, 1e-2) == pytest.approx(second.std(), rel=0.05)


@pytest.mark.parametrize("rows", [200, 5000])
def test_one_glitch_is_no_noise(rows):
    t = np.arange(rows) * 0.01
    x = 0.3 * np.sin(t) + 1e-3 * np.random.default_rng(8).normal(size=rows)
    x[rows // 3] += 0.5
    assert noise([t], [x[:, None]])[0] == pytest.approx(1e-3, rel=0.2)
