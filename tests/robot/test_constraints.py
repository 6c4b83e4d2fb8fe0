"""Closed robots: the laws of their constraints, singular and redundant ones, long motions, and what is refused."""

from __future__ import annotations

import copy
import inspect
import pickle
import runpy
import warnings
from dataclasses import replace

import numpy as np
import pytest
from chains import chain
from mechanisms import LEGS, along, closed_platform, four_bar, integrated
from places import ROOT
from quick import mostly_slow
from random_trees import DIFFERENCES, ROUNDING

import twistwrench as tw
from twistwrench.mechanics.algorithms import loop_closure
from twistwrench.mechanics.model.limits import Friction
from twistwrench.robot.constraints import projections
from twistwrench.robot.quantities import QUANTITIES
from twistwrench.testing import assert_close, derivative, random_robot
from twistwrench.testing.verify import verify

pytest_plugins = ("mechanism_fixtures",)


@pytest.fixture
def at(linkage):
    """A state of the linkage: q, dq, tau."""
    q = linkage.consistent([0.3, 0.4, 1.2])
    return q, linkage.project_velocity(q, [1.0, -2.0, 0.5]), np.array([1.0, 2.0, 3.0])


# ── gaps ──


@pytest.mark.parametrize("scale", mostly_slow([1e-7, 1e-3, 1.0, 1e-5, 30.0], 2))
def test_how_far_a_loop_may_be_open_goes_by_the_size_of_the_mechanism(scale):
    lengths = scale * np.array([0.3, 0.8, 0.6, 0.7])
    closed = four_bar(tuple(lengths)).close("rocker_pin", "coupler_pin", "vx vz")
    q = closed.consistent([0.3, 0.4, 1.2])
    gap = np.abs(closed.constraint_error(q)).max()
    assert gap <= 1e-12 * min(1.0, scale * 2.2), "closed to 1e-12 of the mechanism's length, or of a metre"
    open_by = min(1.0, scale) * 0.05 * 0.6
    ajar = q + np.array([0.0, 0.0, open_by / (0.6 * scale)])
    with pytest.raises(tw.ConstraintError, match="leaves loops open"):
        closed.forward_dynamics(ajar, np.zeros(3), np.zeros(3))
    little = q + np.array([0.0, 0.0, 0.02 * open_by / (0.6 * scale)])
    assert np.isfinite(closed.forward_dynamics(little, np.zeros(3), np.zeros(3)).ddq).all()


@pytest.mark.parametrize("scale", mostly_slow([1e3, 1e5, 1e6, 1e8], 3))
def test_loops_of_huge_mechanisms_close_as_well_as_rounding_allows(scale):
    """Positions of 2.4 scale m are rounded to 1e-16 of that: 1e-12 m is less than the last place of them."""
    closed = four_bar(tuple(scale * np.array([0.3, 0.8, 0.6, 0.7]))).close("rocker_pin", "coupler_pin", "vx vz")
    starts = np.array([[0.3, 0.4, 1.2], [0.5, 0.3, 1.3], [0.1, 0.5, 1.1]])
    q = closed.consistent(starts, within=np.inf)
    assert np.abs(closed.constraint_error(q)).max() <= 1e-14 * 2.4 * scale


def test_two_rows_of_turning_make_a_hinge_that_turns_all_the_way():
    """The gap of a hinge's rows is that of its axes, zero for any turn about it, π for opposite ones; its slope is A."""
    arm = random_robot(3, joints=3, kinds=("revolute",))
    box = tw.robots.floating_box()
    hinge = box.close("ground", "box", "wx wy vx vy vz")
    turns = np.linspace(-np.pi, np.pi, 9)
    q = np.array([[np.cos(t / 2), 0, 0, np.sin(t / 2), 0, 0, 0] for t in turns])
    assert np.abs(hinge.constraint_error(q)).max() == 0
    tilted = box.add(q, [0.3, 0, 0, 0, 0, 0])
    assert_close(np.linalg.norm(hinge.constraint_error(tilted), axis=1), np.full(9, 0.3), 1e-13, "the tilt")
    over = hinge.constraint_error([0, 1, 0, 0, 0, 0, 0])
    assert_close(np.linalg.norm(over), np.pi, 1e-15, "upside down")
    assert arm.nv == 3


@pytest.mark.parametrize("which", ["linkage", "platform"])
def test_a_gap_moves_as_its_rows_do(which, request):
    closed = request.getfixturevalue(which)
    closed, q = closed if which == "platform" else (closed, closed.consistent([0.3, 0.4, 1.2]))
    v = np.random.default_rng(1).standard_normal(closed.nv)
    rate = derivative(lambda t: closed.constraint_error(closed.open().add(q, np.multiply.outer(t, v))), np.abs(v).sum())
    assert_close(rate, closed.constraint_jacobian(q) @ v, DIFFERENCES, "dΦ/dt = A dq")


def test_loops_close_with_newton_s_speed(platform, linkage, monkeypatch):
    """From a gap of a millimetre, squared each time: 1e-6, 1e-12, rounding."""
    monkeypatch.setattr(loop_closure, "ITERATIONS", 3)
    for closed, near in (platform, (linkage, linkage.consistent([0.3, 0.4, 1.2]))):
        start = closed.open().add(near, 1e-3 * np.random.default_rng(0).standard_normal(closed.nv))
        assert np.abs(closed.constraint_error(start)).max() > 1e-4
        assert np.abs(closed.constraint_error(closed.consistent(start))).max() < 1e-12


# ── dynamics ──


def both(platform, linkage):
    rng = np.random.default_rng(5)
    for closed, near in (platform, (linkage, np.array([0.3, 0.4, 1.2]))):
        q = closed.consistent(closed.open().add(near, 0.05 * rng.standard_normal((4, closed.nv))))
        yield closed, q, closed.project_velocity(q, rng.standard_normal((4, closed.nv))), rng


def test_the_equations_of_constrained_motion_hold(platform, linkage):
    for closed, q, dq, rng in both(platform, linkage):
        tau = 5 * rng.standard_normal((4, closed.nv))
        ddq, lam = closed.forward_dynamics(q, dq, tau)
        robot, A = closed.open(), closed.constraint_jacobian(q)
        pressed = (np.swapaxes(A, 1, 2) @ lam[..., None])[..., 0]
        scale = max(np.abs(tau).max(), np.abs(pressed).max())
        assert_close(robot.inverse_dynamics(q, dq, ddq) + pressed, tau, ROUNDING, "τ = M q̈ + h + A'λ", scale=scale)
        rest = (A @ ddq[..., None])[..., 0] + closed.constraint_bias(q, dq)
        assert_close(rest, 0 * rest, ROUNDING, "A q̈ + (dA/dt) dq = 0", scale=np.abs(ddq).max())


def test_wrenches_and_friction_enter_as_they_do_in_the_open_robot(linkage, at):
    q, dq, tau = at
    robot, F = linkage.open(), np.array([0.1, 0.2, 0.3, 4.0, 5.0, 6.0])
    J = robot.jacobian(q, "coupler")
    by, on = {"coupler": F}, {"coupler": -F}
    expected = linkage.forward_dynamics(q, dq, tau - J.T @ F)
    for found in (
        linkage.forward_dynamics(q, dq, tau, wrench_by_robot=by),
        linkage.forward_dynamics(q, dq, tau, wrench_on_robot=on),
    ):
        assert_close(found.ddq, expected.ddq, ROUNDING, "q̈")
        assert_close(found.lam, expected.lam, ROUNDING, "λ")
    assert_close(linkage.forward_dynamics(q, dq, tau, friction=True).ddq, linkage.forward_dynamics(q, dq, tau).ddq, 0.0)


def test_the_compiled_kernel_is_the_algorithm(linkage, at):
    kept = linkage.constraints
    ddq, lam, _ = linkage.open().reference("constrained_dynamics", *at, constraints=kept)
    found = linkage.forward_dynamics(*at)
    assert_close(found.ddq, ddq, ROUNDING, "q̈"), assert_close(found.lam, lam, ROUNDING, "λ")


def test_the_projector_splits_torques(platform, linkage):
    for closed, q, dq, rng in both(platform, linkage):
        P, A, M = closed.projector(q), closed.constraint_jacobian(q), closed.open().mass_matrix(q)
        scale = np.abs(P).max()
        assert_close(P @ P, P, ROUNDING, "P² = P", scale=scale**2)
        assert_close(np.trace(P, axis1=1, axis2=2), np.full(4, closed.nv - A.shape[1]), ROUNDING, "rank of P")
        assert_close(
            P @ np.swapaxes(A, 1, 2),
            np.zeros((4, *A.shape[:0:-1])),
            ROUNDING,
            "P A' = 0",
            scale=scale * np.abs(A).max(),
        )
        tau = rng.standard_normal((4, closed.nv))
        motion, force = closed.split(q, tau)
        assert_close(motion + force, tau, ROUNDING, "the parts add up")
        assert_close(
            closed.forward_dynamics(q, dq, motion).ddq, closed.forward_dynamics(q, dq, tau).ddq, 1e-10, "same motion"
        )
        # What presses on the constraints alone changes λ by as much, and moves nothing.
        still = closed.forward_dynamics(q, dq, 0 * tau)
        pressed = closed.forward_dynamics(q, dq, force)
        assert_close(pressed.ddq, still.ddq, 1e-10, "no motion")
        extra = (np.swapaxes(A, 1, 2) @ (pressed.lam - still.lam)[..., None])[..., 0]
        assert_close(extra, force, 1e-10, "A'Δλ = (1 - P)τ")
        # Book's form of it: P (M q̈ + h) = P τ for every motion that the constraints allow.
        ddq = closed.forward_dynamics(q, dq, tau).ddq
        h = closed.open().bias_forces(q, dq)
        left = (P @ ((M @ ddq[..., None])[..., 0] + h)[..., None])[..., 0]
        assert_close(left, motion, 1e-10, "P(M q̈ + h) = Pτ", scale=np.abs(h).max())


def test_projected_velocities_are_the_nearest_in_kinetic_energy(linkage, at):
    q = at[0]
    M, v = linkage.open().mass_matrix(q), np.array([1.0, 1.0, 1.0])
    dq = linkage.project_velocity(q, v)
    assert_close(linkage.constraint_jacobian(q) @ dq, [0, 0], ROUNDING, "A dq", scale=1.0)
    free = np.linalg.svd(linkage.constraint_jacobian(q))[2][2:]
    assert_close(free @ M @ (dq - v), [0.0], ROUNDING, "what is taken away does no work", scale=1.0)


def test_inverse_dynamics_of_the_motors_makes_the_motion(platform):
    closed, q = platform
    rng = np.random.default_rng(2)
    hips = [f"hip{k}" for k in range(LEGS)]
    dq = closed.project_velocity(q, rng.standard_normal(closed.nv))
    ddq = closed.project_acceleration(q, dq, rng.standard_normal(closed.nv))
    tau, lam = closed.inverse_dynamics(q, dq, ddq, hips)
    names = [b.joint.name for b in closed.open().model.leaders for _ in range(b.joint.nv)]
    assert not tau[[name not in hips for name in names]].any()
    found = closed.forward_dynamics(q, dq, tau)
    assert_close(found.ddq, ddq, 1e-10, "q̈"), assert_close(found.lam, lam, 1e-10, "λ")


def test_gaps_of_turning_are_allowed_in_radians_about_every_axis_however_small_the_robot():
    """Two joints of 1 cm links, about x and y."""
    builder = tw.ModelBuilder("finger")
    builder.add_link("base")
    T = tw.se3.pose(np.eye(3), [0.0, 0.0, 0.01])
    for k, (parent, axis) in enumerate((("base", [1, 0, 0]), ("link0", [0, 1, 0]))):
        builder.add_link(f"link{k}", tw.SpatialInertia.from_com(0.01, [0, 0, 0.005], 1e-6 * np.eye(3)))
        builder.add_joint(f"joint{k}", "revolute", parent, f"link{k}", axis=axis, placement=T)
    closed = tw.Robot(builder.build()).close("ground", "link1", rows="wx wy", pose=T @ T, near=[0.0, 0.0])
    assert closed.spans.tolist() == [1.0, 1.0]


def test_more_motors_than_needed_share_with_least_torque(linkage, at):
    q, dq, _ = at
    ddq = linkage.forward_dynamics(*at).ddq
    tau, _ = linkage.inverse_dynamics(q, dq, ddq)
    A = linkage.constraint_jacobian(q)
    assert_close(linkage.forward_dynamics(q, dq, tau).ddq, ddq, 1e-10, "q̈")
    assert_close(
        A @ tau,
        [0, 0],
        1e-12,
        "least: no part of τ presses on the constraints",
        scale=np.abs(A).max() * np.abs(tau).max(),
    )
    one = linkage.inverse_dynamics(q, dq, ddq, ["a"])
    assert np.linalg.norm(tau) < np.linalg.norm(one.tau)
    assert_close(linkage.split(q, one.tau).motion, linkage.split(q, tau).motion, 1e-10, "the same motion part")


def test_batches_are_their_samples(linkage):
    starts = np.array([0.3, 0.4, 1.2]) + 0.1 * np.random.default_rng(0).standard_normal((2, 3, 3))
    q = linkage.consistent(starts)
    assert q.shape == (2, 3, 3)
    dq = linkage.project_velocity(q, np.ones(3))
    found = linkage.forward_dynamics(q, dq, np.zeros(3))
    assert found.lam.shape == (2, 3, 2)
    for index in np.ndindex(2, 3):
        alone = linkage.forward_dynamics(q[index], dq[index], np.zeros(3))
        assert_close(found.ddq[index], alone.ddq, ROUNDING), assert_close(found.lam[index], alone.lam, ROUNDING)


def test_single_precision_stays_single(linkage, at):
    single = [x.astype(np.float32) for x in at]
    found, double = linkage.forward_dynamics(*single), linkage.forward_dynamics(*at)
    assert found.ddq.dtype == found.lam.dtype == np.float32
    assert_close(found.ddq, double.ddq, 1e-4, "q̈ in float32"), assert_close(found.lam, double.lam, 1e-4, "λ in float32")


def test_a_rolling_constraint_has_no_gap_to_close():
    free = tw.robots.floating_box().constrain("box", "vy")
    assert free.constraint_error(free.open().neutral).shape == (0,)
    assert_close(free.consistent(free.open().neutral), free.open().neutral, 0.0)


def test_constraints_between_the_same_frames_keep_names_and_forces_apart(linkage, at):
    aslant = tw.se3.exp([0, 0.6, 0, 0, 0, 0])
    first = linkage.open().close("rocker_pin", "coupler_pin", "vx", pose=aslant)
    both = first.close("rocker_pin", "coupler_pin", "vx", pose=tw.se3.exp([0, 0.6 - np.pi / 2, 0, 0, 0, 0]))
    assert both.row_names == ("rocker_pin–coupler_pin vx", "rocker_pin–coupler_pin #2 vx")
    expected, (ddq, lam) = linkage.forward_dynamics(*at), both.forward_dynamics(*at)
    assert_close(ddq, expected.ddq, 1e-10, "the same pin in other axes")
    assert_close(np.linalg.norm(lam), np.linalg.norm(expected.lam), 1e-10, "|λ|")
    wrenches = both.wrenches(lam)
    assert [F[3] for F in wrenches.values()] == lam.tolist()


def test_closing_leaves_the_open_robot_as_it_was():
    robot = four_bar()
    once = robot.close("rocker_pin", "coupler_pin", "vx vz")
    twice = once.constrain("coupler", "wy")
    assert once.open() is robot
    assert [len(c.constraints) for c in (once, twice)] == [1, 2]
    assert (once.nq, once.nv, twice.row_names[-1]) == (3, 3, "coupler wy")


def test_a_blade_on_ice_goes_where_it_points():
    """A rate that no position goes with: a blade that may not slip sideways. Spinning, it runs round a circle and does no work."""
    blade = tw.robots.floating_box(gravity=(0, 0, 0)).constrain("box", "vy")
    dq = np.array([0, 0, 2.0, 3.0, 0, 0])
    q = blade.open().neutral
    ddq, lam = blade.forward_dynamics(q, dq, np.zeros(6))
    m = sum(b.inertia.mass for b in blade.open().model.bodies)
    assert_close(ddq, np.zeros(6), 1e-12, "steady", scale=1.0)
    assert_close(lam, [-m * 2.0 * 3.0], 1e-12, "the blade pushes the ice outward with m w v")


# ── motions ──


def drifts(closed, q, dq, torques, stored, dt, duration):
    """Range of energy, largest gap and largest A dq of a motion."""
    seen = []

    def each(q, dq):
        rate = np.abs(closed.constraint_jacobian(q) @ dq).max()
        seen.append((closed.open().kinetic_energy(q, dq) + stored(q), np.abs(closed.constraint_error(q)).max(), rate))

    integrated(closed, q, dq, torques, duration, dt, each)
    energy, gap, rate = np.array(seen).T
    return np.ptp(energy), gap.max(), rate.max()


def without_torques(q, dq):
    return np.zeros_like(dq)


@pytest.mark.parametrize("seconds", [2.5, pytest.param(10.0, marks=pytest.mark.slow)])
def test_a_four_bar_linkage_keeps_its_loop_for_seconds(linkage, seconds):
    q = linkage.consistent([0.3, 0.4, 1.2])
    dq = linkage.project_velocity(q, [6.0, 0, 0])
    energy, gap, rate = drifts(linkage, q, dq, without_torques, linkage.open().potential_energy, 0.01, seconds)
    assert gap < 1e-12
    assert rate < 1e-10
    assert energy < 1e-3  # of 6 J that go to and fro; falls with dt⁴ and faster


def springs(robot, q, stiffness=40.0):
    """Springs at the hips that hold the platform up, and their energy."""
    where = [i for i, name in enumerate(robot.coordinate_names) if name.startswith("hip")]
    names = [b.joint.name for b in robot.model.leaders for _ in range(b.joint.nv)]
    joints = [i for i, name in enumerate(names) if name.startswith("hip")]
    rest = q[where] - 9.0 / stiffness

    def torques(q, dq):
        tau = np.zeros(robot.nv)
        tau[joints] = -stiffness * (q[where] - rest)
        return tau

    return torques, lambda q: robot.potential_energy(q) + 0.5 * stiffness * ((q[where] - rest) ** 2).sum()


@pytest.mark.slow
def test_a_platform_on_three_legs_keeps_its_loops_over_ten_seconds(platform):
    closed, q = platform
    torques, stored = springs(closed.open(), q)
    dq = closed.project_velocity(q, np.r_[1.0, -1.0, 0.5, 0.3, 0.2, 0.5, np.zeros(2 * LEGS)])
    energy, gap, rate = drifts(closed, q, dq, torques, stored, 0.01, 10.0)
    assert gap < 1e-12
    assert rate < 1e-10
    assert energy < 2e-3  # of 0.4 J of kinetic energy to begin with


def test_the_energy_of_a_linkage_drifts_by_the_integrator_alone(linkage):
    """With half the step, a method of order four drifts by a sixteenth or less."""
    q = linkage.consistent([0.3, 0.4, 1.2])
    dq = linkage.project_velocity(q, [6.0, 0, 0])
    coarse, fine = (
        drifts(linkage, q, dq, without_torques, linkage.open().potential_energy, dt, 0.5)[0] for dt in (0.01, 0.005)
    )
    assert fine < coarse / 12


# ── singular and redundant ──


def test_redundant_rows_are_named_with_an_independent_choice():
    with pytest.raises(
        tw.ConstraintError, match=r"of the 5 rows .* 2 are independent.*rows='vx vz'.*redundant='accept'"
    ) as told:
        four_bar().close("rocker_pin", "coupler_pin", "wx wz vx vy vz")
    for row in ("wx", "wz", "vy"):
        assert f"rocker_pin–coupler_pin {row}" in str(told.value)
    with pytest.raises(tw.ConstraintError, match=r"0 are independent.*It adds nothing"):
        four_bar().close("rocker_pin", "coupler_pin", "vx vz").close("coupler_pin", "rocker_pin", "vx vz")


def test_accepted_redundant_rows_change_no_motion_and_share_the_load(linkage, at):
    robot = linkage.open()
    twice = linkage.close("coupler_pin", "rocker_pin", "vx vz", redundant="accept")
    assert twice.redundant_rows == ("coupler_pin–rocker_pin vx", "coupler_pin–rocker_pin vz")
    once, shared = linkage.forward_dynamics(*at), twice.forward_dynamics(*at)
    assert_close(shared.ddq, once.ddq, ROUNDING, "q̈")
    A, lam = twice.constraint_jacobian(at[0]), shared.lam
    assert_close(A.T @ lam, linkage.constraint_jacobian(at[0]).T @ once.lam, ROUNDING, "A'λ")
    assert_close(
        np.linalg.norm(lam), np.linalg.norm(once.lam) / np.sqrt(2), ROUNDING, "two equal shares: the least norm"
    )
    assert twice.rank(at[0]) == 2
    assert twice.degrees_of_freedom(at[0]) == 1
    spatial = robot.close("rocker_pin", "coupler_pin", "wx wz vx vy vz", redundant="accept")
    found = spatial.wrenches(spatial.forward_dynamics(*at).lam)["rocker_pin–coupler_pin"]
    assert_close(found, [0, 0, 0, once.lam[0], 0, once.lam[1]], ROUNDING, "rows that never move bear nothing")
    tau, _ = twice.inverse_dynamics(*at[:2], once.ddq, ["a"])
    assert_close(tau, linkage.inverse_dynamics(*at[:2], once.ddq, ["a"]).tau, 1e-10, "τ")


@pytest.fixture(scope="module")
def parallelogram():
    """Equal cranks: stretched out flat, it may go on as a parallelogram or as an antiparallelogram."""
    return four_bar((0.3, 0.7, 0.3, 0.7)).close("rocker_pin", "coupler_pin", "vx vz", near=[1.0, -1.0, 1.0])


def test_a_singular_configuration_is_reported_and_solved_with_the_least_forces(parallelogram):
    q, still = np.zeros(3), np.zeros(3)
    assert np.abs(parallelogram.constraint_error(q)).max() == 0
    assert parallelogram.rank(q) == 1
    assert parallelogram.degrees_of_freedom(q) == 2
    assert parallelogram.rank([1.0, -1.0, 1.0]) == 2
    tau = np.array([1.0, 2.0, 3.0])
    with pytest.warns(tw.ConstraintWarning, match="by 1 directions, not 2"):
        ddq, lam = parallelogram.forward_dynamics(q, still, tau)
    A, M = parallelogram.constraint_jacobian(q), parallelogram.open().mass_matrix(q)
    h = parallelogram.open().bias_forces(q, still)
    assert_close(M @ ddq + h + A.T @ lam, tau, ROUNDING, "τ = M q̈ + h + A'λ", scale=np.abs(h).max())
    assert_close(A @ ddq, [0, 0], ROUNDING, "A q̈ = 0", scale=np.abs(ddq).max())
    S = A @ np.linalg.solve(M, A.T)
    assert_close(lam, np.linalg.pinv(S, rcond=1e-10) @ A @ np.linalg.solve(M, tau - h), 1e-10, "the λ of least norm")
    P = parallelogram.projector(q)
    assert_close(P @ P, P, ROUNDING, "P² = P", scale=np.abs(P).max() ** 2)
    assert_close(np.trace(P), 2.0, ROUNDING, "rank of P")


def test_one_singular_sample_leaves_the_others_of_its_batch_alone(parallelogram):
    q = parallelogram.consistent(np.array([[1.0, -1.0, 1.0], [0, 0, 0], [0.5, -0.5, 0.5]]))
    with pytest.warns(tw.ConstraintWarning, match="1 of these states"):
        found = parallelogram.forward_dynamics(q, np.zeros(3), np.ones(3))
    for k in (0, 2):
        alone = parallelogram.forward_dynamics(q[k], np.zeros(3), np.ones(3))
        assert_close(found.ddq[k], alone.ddq, ROUNDING), assert_close(found.lam[k], alone.lam, ROUNDING)
    assert np.isfinite(found.ddq).all()


@pytest.mark.parametrize("small", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
def test_near_a_singular_configuration_the_motion_is_still_right(parallelogram, small):
    """On the parallelogram's branch the answer is known: the cranks turn together, so the motion is that of one angle.

    The rows lie aslant, so that both feel the lost direction.
    """
    aslant = tw.se3.exp([0, 0.6, 0, 0, 0, 0])
    slanted = parallelogram.open().close("rocker_pin", "coupler_pin", "vx vz", pose=aslant, near=[1.0, -1.0, 1.0])
    q = np.array([small, -small, small])
    together = np.array([1.0, -1.0, 1.0])
    tau = np.array([1.0, 2.0, 3.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ddq = slanted.forward_dynamics(q, np.zeros(3), tau).ddq
    M, h = parallelogram.open().mass_matrix(q), parallelogram.open().bias_forces(q, np.zeros(3))
    expected = together * (together @ (tau - h)) / (together @ M @ together)
    assert_close(ddq, expected, 1e-14 / small + 1e-9, "q̈")  # rounding of A over its smaller singular value


# ── what is refused ──


@pytest.mark.parametrize(
    ("close", "error", "told"),
    [
        (("rocker_pin", "couplr_pin"), tw.UnknownNameError, "'couplr_pin'.*Did you mean 'coupler_pin'"),
        (("rocker", "rocker_pin"), tw.ConstraintError, "'rocker' and 'rocker_pin' are fixed to one body"),
        (("ground", "ground_link"), tw.ConstraintError, "fixed to one body"),
        (("rocker_pin", "coupler_pin", "vx vq"), tw.UnknownNameError, "no row of a twist named 'vq'.*wx, wy, wz, vx"),
        (("rocker_pin", "coupler_pin", (3, 6)), tw.ValueRangeError, "row 6 is out of range.*0 to 5"),
        (("rocker_pin", "coupler_pin", (3, 3)), tw.ValueRangeError, "names a row twice: vx, vx"),
        (("rocker_pin", "coupler_pin", ()), tw.ValueRangeError, "names no row"),
        (("rocker_pin", "coupler_pin", 3), tw.ShapeError, "rows=3: give names"),
        (("rocker_pin", "coupler_pin", (1.5,)), tw.ShapeError, "a name or a number, got 1.5"),
    ],
)
def test_loops_that_cannot_be_meant(close, error, told):
    with pytest.raises(error, match=told):
        four_bar().close(*close)


@pytest.mark.parametrize(
    ("options", "error", "told"),
    [
        ({"pose": np.eye(3)}, tw.ShapeError, r"pose has shape \(3, 3\)"),
        ({"pose": 2 * np.eye(4)}, tw.ValueRangeError, "pose"),
        ({"near": [0.0, 1.0]}, tw.ShapeError, r"near has shape \(2,\)"),
        ({"redundant": "drop"}, tw.ValueRangeError, "redundant='drop'.*'error', 'accept'"),
        ({"pose": along(5.0)}, tw.ConstraintError, "no configuration found.*leaves a gap of.*near=q"),
    ],
)
def test_options_of_closing_that_cannot_be_meant(options, error, told):
    with pytest.raises(error, match=told):
        four_bar().close("rocker_pin", "coupler_pin", "vx vz", **options)


def test_one_turning_row_alone_is_a_loop_in_the_plane_only():
    assert four_bar().close("rocker_pin", "coupler_pin", "wy").row_names == ("rocker_pin–coupler_pin wy",)
    with pytest.raises(tw.ConstraintError, match=r"wz is the only row of turning.*rate of no angle.*constrain"):
        tw.robots.ur5().close("ground", "tool0", "wz vz", pose=along(0.3, 0.2, 0.4))


def test_frames_and_kinds_of_rolling_are_checked():
    arm = tw.robots.planar_2r()
    with pytest.raises(tw.UnknownNameError, match="Known: body, space, world_aligned"):
        arm.constrain("tip", "vx", "spatial")
    with pytest.raises(tw.ConstraintError, match="'base' is fixed to the base"):
        arm.constrain("base", "vx")
    with pytest.raises(tw.ConstraintError, match=r"of the 1 rows of .tip. 0 are independent"):
        arm.constrain("tip", "wx")


@pytest.mark.parametrize(
    ("call", "error", "told"),
    [
        (
            lambda c, q, v: c.forward_dynamics(q + 0.1, v, v),
            tw.ConstraintError,
            r"leaves loops open by 0\.103 .*pin v[xz]'.*closed\.consistent",
        ),
        (
            lambda c, q, v: c.forward_dynamics(q, v + 1, v),
            tw.ConstraintError,
            "dq breaks the constraints by .*project_velocity",
        ),
        (lambda c, q, v: c.inverse_dynamics(q, v, [1, 1, 1]), tw.ConstraintError, "ddq breaks .*project_acceleration"),
        (lambda c, q, v: c.inverse_dynamics(q, v, v, ["e"]), tw.UnknownNameError, "no joint named 'e'.*Known: a, b, d"),
        (
            lambda c, q, v: c.inverse_dynamics(q, v, 0 * v, []),
            tw.ConstraintError,
            "joints a, b, d have no motor.*Degrees of freedom: 1",
        ),
        (lambda c, q, v: c.forward_dynamics(q[:2], v, v), tw.ShapeError, r"forward_dynamics: q has shape \(2,\)"),
        (lambda c, q, v: c.forward_dynamics(q, v, "no"), tw.ShapeError, "forward_dynamics: tau"),
        (lambda c, q, v: c.forward_dynamics(q * np.nan, v, v), tw.ValueRangeError, "q has the entry nan"),
        (
            lambda c, q, v: c.forward_dynamics(np.tile(q, (2, 1)), np.tile(v, (3, 1)), v),
            tw.ShapeError,
            "do not broadcast",
        ),
        (lambda c, q, v: c.wrenches([1, 2, 3]), tw.ShapeError, r"lam has shape \(3,\)"),
        (lambda c, q, v: c.consistent(q, tolerance=-1.0), tw.ValueRangeError, "tolerance=-1 .*positive"),
        (lambda c, q, v: c.open().kernel("constraint_jacobian"), tw.KernelError, "needs constraints="),
    ],
)
def test_states_that_break_the_constraints_and_shapes_that_do_not_fit(linkage, call, error, told):
    q = linkage.consistent([0.3, 0.4, 1.2])
    with pytest.raises(error, match=told):
        call(linkage, q, np.zeros(3))


# ── judged per sample and by size ──


@pytest.fixture(scope="module")
def held():
    return tw.robots.planar_3r().close("ground", "tip", "vx vz", pose=along(1.5))


def test_a_motion_without_motors_for_it_hides_behind_no_larger_sample_of_its_batch(linkage):
    """A sample's own torques say what is left over of them; the other one's are 1e8 times as large."""
    q = np.tile(linkage.consistent([0.3, 0.4, 1.2]), (2, 1))
    still, F = np.zeros((2, 3)), np.array([[1e8, 0, 0, 0, 0, 0], np.zeros(6)])
    possible = linkage.inverse_dynamics(q, still, still, ["a"], wrench_by_robot={"crank": F})
    alone = linkage.inverse_dynamics(q[1], still[1], still[1], ["a"])
    assert_close(possible.tau[1], alone.tau, 1e-12, "τ of the small sample")
    box = tw.robots.floating_box(gravity=(0, 0, 0)).constrain("box", "vy vz")
    push = np.zeros((2, 6))
    push[0, 4], push[1, 3] = 1e8, 10.0  # on the rows that are held, and across them
    q = np.tile(box.open().neutral, (2, 1))
    box.inverse_dynamics(q[0], np.zeros(6), np.zeros(6), [], wrench_by_robot={"box": push[0]})
    with pytest.raises(tw.ConstraintError, match=r"10 N m or N is left over \(row 1 of the batch\)"):
        box.inverse_dynamics(q, np.zeros((2, 6)), np.zeros((2, 6)), [], wrench_by_robot={"box": push})


@pytest.mark.parametrize("speed", [0.09, 0.9, 90.0])
def test_a_velocity_that_is_all_wrong_is_refused_however_slow(held, speed):
    q = held.consistent([0.5, 0.5, 0.5], within=np.inf)
    wrong = np.linalg.pinv(held.constraint_jacobian(q)) @ [speed, 0.0]
    right = held.project_velocity(q, wrong)
    with pytest.raises(tw.ConstraintError, match="dq breaks the constraints by"):
        held.forward_dynamics(q, wrong, np.zeros(3))
    with pytest.raises(tw.ConstraintError, match=r"dq breaks.*\(row 1 of the batch\)"):
        held.forward_dynamics(q, [right, wrong], np.zeros(3))
    with pytest.raises(tw.ConstraintError, match="ddq breaks"):
        held.inverse_dynamics(q, np.zeros(3), wrong)
    held.forward_dynamics(q, right, np.zeros(3))


@pytest.mark.parametrize("seed", range(6))
def test_a_tenth_of_the_terms_of_a_rate_may_break_the_constraints_whatever_signs_they_have(held, seed):
    """Terms of a row: |A| |ddq| and what velocities add, which has one sign at some poses and the other one at others."""
    rng = np.random.default_rng(seed)
    q = held.consistent(rng.uniform(-1.5, 1.5, 3), within=np.inf)
    dq = held.project_velocity(q, rng.normal(size=3))
    A, b = held.constraint_jacobian(q), held.constraint_bias(q, dq)
    right, across = held.project_acceleration(q, dq, rng.normal(size=3)), np.linalg.pinv(A)

    def share(ddq):
        terms = np.abs(A) @ np.abs(ddq) + np.abs(b)
        return (np.abs(A @ ddq + b) / held.sizes).max() / (terms / held.sizes).max()

    for row in across.T:
        for sign in (-1, 1):
            ddqs = right + sign * np.geomspace(1e-3, 1e2, 200)[:, None] * row
            shares = np.array([share(ddq) for ddq in ddqs])
            held.inverse_dynamics(q, dq, ddqs[np.flatnonzero(shares < 0.097)[-1]])
            with pytest.raises(tw.ConstraintError, match=r"ddq breaks the constraints by 0\.1"):
                held.inverse_dynamics(q, dq, ddqs[np.flatnonzero(shares > 0.11)[0]])


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_small_and_large_robots_are_judged_alike(scale):
    robot = four_bar(tuple(scale * np.array([0.3, 0.8, 0.6, 0.7])))
    closed = robot.close("rocker_pin", "coupler_pin", "vx vz")
    q = closed.consistent([0.3, 0.4, 1.2])
    right = closed.project_velocity(q, [1.0, 0.0, 0.0])
    closed.forward_dynamics(q, right, np.zeros(3))
    with pytest.raises(tw.ConstraintError, match="dq breaks"):
        closed.forward_dynamics(q, right + np.array([0.0, 1.0, 0.0]), np.zeros(3))
    with pytest.raises(tw.ConstraintError, match="ddq breaks"):
        closed.inverse_dynamics(q, 0 * q, [0.0, 1.0, 0.0])
    if scale <= 1.0:  # beyond a metre, a centimetre stays a gap
        closed.forward_dynamics(q + np.array([0, 0.002, 0]), right, np.zeros(3))
        with pytest.raises(tw.ConstraintError, match="leaves loops open"):
            closed.forward_dynamics(q + np.array([0, 0.1, 0]), right, np.zeros(3))


def test_where_a_motion_turns_round_the_stages_of_a_step_are_not_refused(linkage):
    """The first stage ends at rest but for its errors, of which most break the constraints."""
    q, half = linkage.consistent([0.3, 0.4, 1.2]), 0.005
    along_it = linkage.project_velocity(q, [1.0, 0.0, 0.0])
    along_it /= np.linalg.norm(along_it)
    dq = np.zeros(3)
    for _ in range(20):  # dq + half q̈ = 0 along the motion, a contraction by half |q̈| / rad
        dq = -half * (along_it @ linkage.forward_dynamics(q, dq, np.zeros(3)).ddq) * along_it
    stage = dq + half * linkage.forward_dynamics(q, dq, np.zeros(3)).ddq
    there = q + half * dq
    A = linkage.constraint_jacobian(there)
    assert np.abs(A @ stage).max() > 0.1 * (np.abs(A) @ np.abs(stage)).max()
    assert np.abs(stage).max() < 0.01 * np.abs(dq).max()
    linkage.forward_dynamics(there, stage, np.zeros(3))


def test_a_robot_that_no_row_of_its_constraints_holds_moves_as_the_open_one():
    arm = tw.robots.planar_2r()
    closed = arm.constrain("tip", "vy", kind="world_aligned", redundant="accept")
    assert closed.redundant_rows == ("tip vy",)
    rng = np.random.default_rng(0)
    q, dq, tau = rng.standard_normal((3, 4, 2))
    ddq, lam = closed.forward_dynamics(q, dq, tau)
    assert_close(ddq, arm.forward_dynamics(q, dq, tau), 0.0, "the open robot's")
    assert lam.shape == (4, 1)
    assert not lam.any()
    again, lam = closed.inverse_dynamics(q, dq, ddq)
    assert_close(again, tau, 1e-12, "τ")
    assert not lam.any()
    assert_close(closed.projector(q), np.tile(np.eye(2), (4, 1, 1)), ROUNDING, "P")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_wrenches_that_are_no_numbers_are_refused_by_name(held, bad):
    q = held.consistent([0.5, 0.5, 0.5], within=np.inf)
    with pytest.raises(tw.ValueRangeError, match=r"wrench_by_robot.*must be a finite number"):
        held.inverse_dynamics(q, np.zeros(3), np.zeros(3), wrench_by_robot={"tip": [bad] * 6})


@pytest.mark.parametrize("path", [lambda c: c, copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
def test_arrays_of_closed_robots_are_read_only(held, path):
    assert held.constraints[0].T_ac[0, 3] == 1.5  # so that it is there to be copied
    closed = path(held)
    for array in (closed.sizes, closed.spans, closed.constraints[0].T_ac):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 9.0
    assert closed.constraints == held.constraints


def test_a_frame_left_out_is_the_tip_by_name():
    arm = tw.robots.planar_2r()
    assert arm.constrain(None, "vx").row_names == ("tip vx",)
    assert arm.close("ground", None, "vx", pose=along(1.9)).row_names == ("ground–tip vx",)
    with pytest.raises(tw.FrameError, match="no single tip"):
        four_bar().constrain(None, "vx")


def test_a_start_that_leads_nowhere_says_which_and_how_far_it_got():
    arm = tw.robots.planar_2r().close("ground", "tip", "vx", pose=along(1.9))
    assert arm.consistent([0.3, 0.3]).shape == (2,)
    with pytest.raises(
        tw.ConstraintError, match=r"a gap of 0\.1 \(rad or m\) is left \(row 1 of the batch\), allowed 1e-12"
    ):
        arm.consistent([[0.3, 0.3], [0.0, 0.0]])  # stretched out, no joint moves the tip along x


def test_a_closed_configuration_that_is_not_near_is_warned_of():
    arm = tw.robots.planar_3r()
    held = arm.close("ground", arm.tip, rows="vx vz", pose=along(1.5))
    start = np.array([2.0, 2.0, 2.0])
    with pytest.warns(
        tw.ConstraintWarning, match=r"joint 'joint\d' moved by [\d.]+ \(rad or m\), and 0\.5 is called"
    ) as told:
        q = held.consistent(start)
    assert told[0].filename == __file__
    moved = np.abs(arm.subtract(q, start))
    assert f"joint '{arm.joint_names[moved.argmax()]}' moved by {moved.max():.3g} " in str(told[0].message)
    assert_close(held.consistent(start, within=np.inf), q, 0.0)  # the same, and silently
    with pytest.warns(tw.ConstraintWarning, match=r"row 1, 0 of the batch"):
        held.consistent(np.array([[q], [start]]))
    with pytest.warns(tw.ConstraintWarning):
        held.consistent(start, within=0.99 * moved.max())
    held.consistent(start, within=1.01 * moved.max())
    for bad in (-1.0, np.nan):
        with pytest.raises(tw.ValueRangeError, match="within="):
            held.consistent(start, within=bad)


INPUTS = {"q": [0.3, 0.4, 1.2], "q1": [0.3, 0.4, 1.2], "q0": [0.1, 0.2, 0.3], "wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}


@pytest.mark.parametrize("name", sorted(QUANTITIES))
def test_a_closed_robot_has_the_quantities_that_the_table_says(linkage, name):
    """Those marked "as is" are the open tree's, bit by bit; the others are refused, with the way out, or have constraint forces."""
    quantity, tree = QUANTITIES[name], linkage.open()
    if "constraints" in quantity.options:
        return
    arrays = [INPUTS.get(x, [0.5, -0.2, 0.1]) for x in quantity.inputs]
    given = {"frame": "coupler"} if "frame" in quantity.options else {}
    if quantity.constrained == "as is":
        assert_close(linkage.kernel(name, **given)(*arrays), tree.kernel(name, **given)(*arrays), 0.0)
        return
    with pytest.raises(tw.KernelError, match=rf"^{name}: not available.*robot\.open\(\)"):
        linkage.kernel(name, **given)
    if quantity.constrained == "refused":
        with pytest.raises(tw.KernelError, match=r"robot\.open\(\)"):
            getattr(linkage, name)(*arrays, **given)
    else:
        assert inspect.signature(getattr(projections, name)).parameters.keys() >= {"closed", *quantity.inputs}


def test_what_has_no_meaning_on_constraints_is_refused_with_the_way_out(linkage):
    calls = (
        lambda: linkage.with_gravity([0, 0, 0]), lambda: linkage.with_payload(tw.SpatialInertia.from_com(1.0)),
        lambda: linkage.with_armature({}), lambda: linkage.lock({"a": 0.0}), lambda: linkage.chain(), linkage.to_urdf,
        lambda: linkage.attach(linkage.open()), lambda: tw.robots.ur5().attach(linkage), linkage.to_mjcf, linkage.to_sdf,
        lambda: linkage.closed_form([0, 0, 0], [0, 0, 0]), lambda: linkage.inverse_kinematics_branches(np.eye(4)),
        lambda: linkage.simulate_batch([[0, 0, 0]]), lambda: linkage.lost_directions([0, 0, 0], "coupler"), linkage.info,
        lambda: tw.statics.largest_payload(linkage, [0, 0, 0]), lambda: tw.statics.wrench_ellipsoid(linkage, [0, 0, 0], "coupler"),
        lambda: tw.statics.wrench_from_torques(linkage, [0, 0, 0], [0, 0, 0], "coupler"), lambda: tw.symbolic.derive(linkage),
        lambda: tw.statics.torques_per_kilogram(linkage, [0, 0, 0], frame="coupler"), lambda: verify(linkage),
    )  # fmt: skip
    for call in calls:
        with pytest.raises(tw.ValueRangeError, match=r"robot with constraints, .*robot\.open\(\)"):
            call()
    with pytest.raises(tw.ValueRangeError, match="actuated= is for a robot with constraints"):
        linkage.open().inverse_dynamics([0, 0, 0], [0, 0, 0], [0, 0, 0], ["a"])
    with pytest.raises(tw.ValueRangeError, match="out= is for a robot without"):
        linkage.forward_dynamics([0, 0, 0], [0, 0, 0], [0, 0, 0], out=np.zeros(3))


@pytest.mark.parametrize("path", [lambda c: c, copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
def test_a_closed_robot_is_a_robot_and_open_again(linkage, path):
    closed = path(linkage)
    assert isinstance(closed, tw.Robot)
    assert closed.row_names == linkage.row_names
    assert closed.open().constraints == ()
    assert closed.open().open() is closed.open()
    assert repr(closed) == repr(linkage) != repr(closed.open())


@pytest.mark.parametrize("actuated", [None, ["a"]])
def test_inverse_dynamics_with_friction_is_undone_by_forward_dynamics_with_it(linkage, at, actuated):
    q, dq, _ = at
    friction = Friction.plain([0.7, 0.1, 0.3], [0.4, 0.2, 0.0])
    rough = tw.Robot(replace(linkage.open().model, friction=friction)).close("rocker_pin", "coupler_pin", "vx vz")
    ddq = rough.project_acceleration(q, dq, [1.0, 0.0, 0.0])
    without = rough.inverse_dynamics(q, dq, ddq, actuated)
    tau, lam = rough.inverse_dynamics(q, dq, ddq, actuated, friction=True)
    assert np.abs(tau - without.tau).max() > 0.1
    found = rough.forward_dynamics(q, dq, tau, friction=True)
    assert_close(found.ddq, ddq, 1e-11, "ddq")
    assert_close(found.lam, lam, 1e-11, "λ")


@pytest.mark.parametrize("kind", mostly_slow(["closure", "body", "world_aligned", "space"], 2))
def test_wrenches_across_the_joints_turn_them_with_the_torques_of_their_motors(kind):
    """What a joint's axis takes of the wrench across it is τ: of motors that of theirs, nothing at the others."""
    F = {"panda_hand_tcp": [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]}
    if kind == "closure":
        closed, q = closed_platform()
        motors, F = [f"hip{k}" for k in range(LEGS)], {"plate": F["panda_hand_tcp"]}
    else:
        panda = tw.robots.panda()
        closed, q, motors = panda.constrain("panda_hand_tcp", "vz wx", kind=kind), panda.random_configuration(0), None
    rng = np.random.default_rng(1)
    dq = closed.project_velocity(q, rng.standard_normal((2, closed.nv)))
    ddq = closed.project_acceleration(q, dq, rng.standard_normal(closed.nv))
    tau = closed.inverse_dynamics(q, dq, ddq, motors, wrench_on_robot=F).tau
    across = closed.joint_wrenches(q, dq, ddq, motors, wrench_on_robot=F)
    for i, body in enumerate(closed.open().model.bodies):
        mine = (across[:, i, None] @ body.joint.axes.T)[:, 0]
        assert_close(mine, tau[:, body.places[1]], ROUNDING, body.joint.name, scale=np.abs(tau).max())
    assert np.abs(across - closed.open().joint_wrenches(q, dq, ddq, wrench_on_robot=F)).max() > 0.1


def test_the_example_draws_and_says_what_its_motion_keeps(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(ROOT / "examples" / "four_bar.py"))
    example["main"](tmp_path, duration=0.1)
    assert (tmp_path / "four_bar.png").read_bytes().startswith(b"\x89PNG")
    assert "over 0.1 s in steps of 0.005 s: gap" in capsys.readouterr().out


def test_a_row_that_moves_by_rounding_alone_takes_no_torque_off():
    """A point on the axis of the joint between two links stays where it is, and its row of A is some 1e-17."""
    axis = np.array([0.36, 0.48, 0.8])

    def on_the_axis(name, options):
        options |= {"j2": {"axis": axis}, "j3": {"placement": along(*(0.7 * axis))}}.get(name, {})

    rng = np.random.default_rng(1)
    robot = tw.Robot(chain(rng, "rrf", on_the_axis).build())
    q, dq, ddq = rng.normal(size=(3, robot.nv))
    pose = tw.se3.inverse(robot.forward_kinematics(q, "l1")) @ robot.forward_kinematics(q, "l3")
    held = robot.close("l1", "l3", rows="vx", pose=pose, redundant="accept")
    assert 0 < np.abs(held.constraint_jacobian(q)).max() < 1e-12
    assert held.rank(q) == 0
    found = held.inverse_dynamics(q, dq, ddq)
    np.testing.assert_array_equal(found.tau, robot.inverse_dynamics(q, dq, ddq))
    assert found.lam == 0
    np.testing.assert_allclose(held.forward_dynamics(q, dq, found.tau).ddq, ddq, rtol=1e-9)
    np.testing.assert_array_equal(held.holding_torques(q).tau, robot.holding_torques(q))
