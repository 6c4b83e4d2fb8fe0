"""Torques and wrenches at rest: virtual work, the way back from torques, limits, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import statics
from twistwrench.statics.torque_limits import effort_limits, growth

pytest_plugins = ("statics_fixtures",)

BENT = [0, -0.6, 0.9, 0, 0, 0]


# ── torques ⇄ wrenches ──


@pytest.mark.parametrize("kind", ["body", "space", "world_aligned"])
def test_virtual_work_and_the_same_torques_in_every_frame(robot, kind):
    rng = np.random.default_rng(1)
    q, dq, F = robot.random_configuration(rng), rng.standard_normal(robot.nv), rng.standard_normal(6)
    tau = robot.wrench_torques(q, F)
    T = robot.forward_kinematics(q)
    if kind == "space":
        F = tw.Ad(tw.se3.inverse(T)).T @ F
    elif kind == "world_aligned":
        F = np.concatenate([T[:3, :3] @ F[:3], T[:3, :3] @ F[3:]])
    J = robot.jacobian(q, kind=kind)
    assert_allclose(J.T @ F, tau, atol=1e-12)
    assert_allclose(F @ (J @ dq), tau @ dq, atol=1e-12)


def test_the_slips_of_common_sources_fail_the_same_law(robot):
    """Part C: no transpose on the adjoint, and power as f · v alone."""
    rng = np.random.default_rng(2)
    q, dq, F = robot.random_configuration(rng), rng.standard_normal(robot.nv), rng.standard_normal(6)
    tau, T = robot.wrench_torques(q, F), robot.forward_kinematics(q)
    V = robot.jacobian(q) @ dq
    untransposed = robot.jacobian(q, kind="space").T @ (tw.Ad(tw.se3.inverse(T)) @ F)
    assert np.abs(untransposed - tau).max() > 1e-2
    assert abs(F[3:] @ V[3:] - tau @ dq) > 1e-2


@pytest.mark.parametrize("name", ["ur5", "panda", "planar_2r", "planar_3r"])
def test_torques_split_into_what_a_wrench_balances_and_what_none_does(bundled, name):
    robot = bundled(name)
    rng = np.random.default_rng(3)
    for q in [robot.neutral, *robot.random_configuration(rng, 20)]:
        tau = 10 * rng.standard_normal(robot.nv)
        found = statics.wrench_from_torques(robot, q, tau, length=rng.uniform(0.3, 3))
        J = robot.jacobian(q)
        assert_allclose(robot.gravity_forces(q) + J.T @ found.wrench + found.unbalanced, tau, atol=1e-8)
        assert_allclose(J.T @ found.borne, 0, atol=1e-9)
        assert_allclose(J @ found.idle, 0, atol=1e-9)
        assert_allclose(found.idle.T @ (tau - robot.gravity_forces(q) - found.unbalanced), 0, atol=1e-8)
        assert found.borne.shape == (6, 6 - found.rank)
        assert found.idle.shape == (robot.nv, robot.nv - found.rank)
        together = np.column_stack([found.producible, found.borne])
        assert np.linalg.matrix_rank(together) == 6
        assert_allclose(found.producible @ (found.producible.T @ found.wrench), found.wrench, atol=1e-8)


@pytest.mark.parametrize("arm", [1e-12, 1e-9, 1e-3, 1.0, 1e6])
def test_how_many_wrenches_torques_make_does_not_depend_on_the_length_of_the_arm(arm):
    robot = tw.from_dh({"a": [arm, arm]}, masses=[1.0, 1.0]).with_gravity((0, 0, 0))
    q, F = np.array([0.2, 0.9]), np.array([0, 0, 0, 3.0, -4.0, 0])
    tau = robot.wrench_torques(q, F)
    found = statics.wrench_from_torques(robot, q, tau, length=arm)
    assert found.rank == 2
    assert found.balanced
    assert_allclose(robot.wrench_torques(q, found.wrench), tau, rtol=1e-9, atol=1e-9 * np.abs(tau).max())
    assert statics.wrench_from_torques(robot, [0.2, 0.0], tau).rank == 2, "stretched: a pull along the arm is borne"
    for length in (1e-3, 1.0):
        assert statics.wrench_from_torques(robot, q, tau, length=length).rank == 2


def test_a_slide_and_a_crank_of_a_nanometre_make_two_wrenches():
    robot = tw.from_dh(
        {"a": [0.0, 1e-9], "alpha": [np.pi / 2, 0.0]}, joint_types=["prismatic", "revolute"], masses=[1.0, 1.0]
    )
    robot = robot.with_gravity((0, 0, 0))
    found = statics.wrench_from_torques(robot, [0.1, 0.4], [2.0, 3e-9])
    assert found.rank == 2
    assert_allclose(robot.wrench_torques([0.1, 0.4], found.wrench), [2.0, 3e-9], rtol=1e-9)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_torques_that_no_wrench_balances_are_told_whatever_their_size(bundled, scale):
    panda = bundled("panda").with_gravity((0, 0, 0))
    q = panda.random_configuration(1)
    assert not statics.wrench_from_torques(panda, q, scale * np.ones(7)).balanced
    balanced = panda.wrench_torques(q, scale * np.arange(6.0))
    assert statics.wrench_from_torques(panda, q, balanced).balanced


def test_a_stretched_arm_names_what_it_cannot_do(arm):
    found = statics.wrench_from_torques(arm, [0.0, 0.0], [50.0, 20.0], kind="world_aligned")
    assert found.rank == 2
    straight = statics.wrench_from_torques(arm.with_gravity((0, 0, 0)), [0.0, 0.0], [2.0, 1.0], kind="world_aligned")
    along = np.array([0, 0, 0, 1.0, 0, 0])
    assert np.linalg.matrix_rank(np.column_stack([straight.borne, along])) == 4  # a pull along the arm is borne
    ur5 = tw.robots.ur5()
    singular = statics.wrench_from_torques(ur5, ur5.neutral, np.zeros(6))
    assert singular.rank < 6
    assert "singular pose" in str(singular)
    assert "borne by the structure" in str(singular)
    assert "moves nothing there" in str(singular)


def test_a_wrench_survives_the_way_through_the_torques(bundled):
    ur5, rng = bundled("ur5"), np.random.default_rng(4)
    q, F = np.array([0.3, -1.2, 1.1, 0.4, 0.9, 0.2]), rng.standard_normal(6)
    tau = ur5.holding_torques(q, wrench_by_robot={"tool0": F})
    found = statics.wrench_from_torques(ur5, q, tau)
    assert_allclose(found.wrench, F, atol=1e-11)
    assert found.balanced
    redundant = statics.wrench_from_torques(bundled("panda"), bundled("panda").random_configuration(1), np.ones(7))
    assert redundant.idle.shape == (7, 1)
    assert not redundant.balanced


# ── limits ──


def test_growth_is_the_interval_within_limits():
    rng = np.random.default_rng(15)
    start, step, L = rng.standard_normal((2000, 4)), rng.standard_normal((2000, 4)), np.array([1.0, 2.0, np.inf, 0.5])
    found = growth(start, step, L)
    some = found.least <= found.most
    assert 0 < some.sum() < 2000
    for s, inside in ((found.most, 1 - 1e-9), (found.least, 1 - 1e-9)):
        at = (
            start + (0.5 * (found.least + found.most) + inside * (s - 0.5 * (found.least + found.most)))[:, None] * step
        )
        assert (np.abs(at) <= L)[some].all()
    beyond = start + (found.most + 1e-6)[:, None] * step
    assert (np.abs(beyond) > L)[some].any(axis=1).all()


def test_without_limits_the_error_says_to_pass_them(arm):
    for call in (statics.largest_payload, statics.wrench_polytope, statics.weakest_direction):
        with pytest.raises(tw.ValueRangeError, match=r"has no effort limits.*Pass limits=… with 2 numbers"):
            call(arm, [0.0, 0.0])


def test_nothing_drives_a_floating_base(bundled):
    box = bundled("floating_box")
    with pytest.raises(tw.ValueRangeError, match="needs a fixed base"):
        statics.largest_payload(box, box.neutral)
    assert_allclose(effort_limits(box), 0)


def test_a_contact_stays_where_it_was_made():
    point, normal = np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 2.0])
    contact = statics.Contact(point, normal)
    point[:], normal[:] = 5.0, 1.0
    assert contact.point.tolist() == [0.1, 0.2, 0.3]
    assert contact.normal.tolist() == [0.0, 0.0, 1.0]


# ── errors ──


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda r: statics.largest_payload(r, r.neutral, limits=[1.0]), tw.ShapeError, "limits has shape"),
        (lambda r: statics.largest_payload(r, r.neutral, limits=[-1.0] * 6), tw.ValueRangeError, "at least zero"),
        (lambda r: statics.largest_payload(r, r.neutral, com=[1, 2]), tw.ShapeError, "com has shape"),
        (
            lambda r: statics.largest_payload(r, r.neutral, com=[1, 2, np.nan]),
            tw.ValueRangeError,
            "com has the entry nan",
        ),
        (lambda r: statics.largest_payload(r, [0.0]), tw.ShapeError, "q has shape"),
        (lambda r: statics.largest_payload(r, r.neutral, frame="hand"), tw.UnknownNameError, "hand"),
        (lambda r: statics.payload_in_region(r, r.neutral[None], [[0, 0, 0]]), tw.ShapeError, "one q"),
        (lambda r: statics.wrench_polytope(r, r.neutral, part="couple"), tw.UnknownNameError, "part of a wrench"),
        (lambda r: statics.wrench_polytope(r, r.neutral, rest="all"), tw.UnknownNameError, "rest"),
        (
            lambda r: statics.wrench_polytope(r, r.neutral, limits=[1.0] * 6),
            tw.ValueRangeError,
            "own weight and springs|itself",
        ),
        (lambda r: statics.wrench_polytope(r, r.neutral, limits=[0.0] * 6), tw.ValueRangeError, "limit of zero"),
        (lambda r: statics.largest_wrench(r, r.neutral, [0, 0]), tw.ShapeError, "direction has shape"),
        (lambda r: statics.largest_wrench(r, r.neutral, [0, 0, 0]), tw.ValueRangeError, "points nowhere"),
        (lambda r: statics.wrench_from_torques(r, r.neutral, [1.0]), tw.ShapeError, "tau has shape"),
        (lambda r: statics.wrench_from_torques(r, r.neutral[:2], [1.0] * 6), tw.ShapeError, "q has shape"),
        (lambda r: statics.wrench_polytope(r, [0, np.nan, 0, 0, 0, 0]), tw.ValueRangeError, "shoulder_lift_joint"),
        (lambda r: statics.wrench_from_torques(r, r.neutral, [1.0] * 6, length=0.0), tw.ValueRangeError, "positive"),
        (lambda r: statics.payload_map(r, "zz"), tw.UnknownNameError, "slice"),
        (lambda r: statics.payload_map(r, "xz", at=9.0, samples=100), tw.ValueRangeError, "none of 100"),
        (lambda r: statics.payload_map(r, samples=0), tw.ValueRangeError, "samples is 0"),
        (lambda r: statics.payload_map(r, samples=1.5), tw.ValueRangeError, "samples is 1.5"),
        (lambda r: statics.payload_map(r, cells="many"), tw.ValueRangeError, "cells is 'many'"),
        (lambda r: statics.payload_map(r, "xz", at=np.nan), tw.ValueRangeError, "at is nan"),
        (lambda r: statics.payload_map(r, "xz", thickness=0), tw.ValueRangeError, "thickness .* is 0"),
        (lambda r: statics.payload_map(r, rng="a"), tw.ValueRangeError, "rng is 'a'"),
        (lambda r: statics.largest_payload(r, r.neutral, com="here"), tw.ShapeError, "com has shape"),
        (
            lambda r: statics.largest_payload(r, r.neutral, limits="all"),
            tw.ShapeError,
            "limits has shape .* shoulder_pan_joint",
        ),
        (lambda r: statics.largest_payload(r, [r.neutral] * 2, com=np.zeros((3, 3))), tw.ShapeError, "broadcast"),
        (lambda r: statics.largest_wrench(r, [r.neutral] * 3, np.eye(3)[:2]), tw.ShapeError, "do not broadcast"),
        (lambda r: statics.largest_wrench(r, r.neutral, "up"), tw.ShapeError, "direction has shape"),
        (lambda r: statics.largest_wrench(r, r.neutral, [[0, 1], [2]]), tw.ShapeError, "direction is not an array"),
        (
            lambda r: statics.wrench_polytope(r, [r.neutral] * 2),
            tw.ShapeError,
            r"one q .* corners .* for x in q\.reshape",
        ),
        (lambda r: statics.wrench_polytope(r, BENT).support([1, 2]), tw.ShapeError, "direction has shape"),
        (lambda r: statics.wrench_polytope(r, BENT).support([1, 2, np.nan]), tw.ValueRangeError, "entry nan"),
        (lambda r: statics.wrench_polytope(r, BENT).contains([1, 2]), tw.ShapeError, "x has shape"),
        (lambda r: statics.wrench_polytope(r, BENT).contains([1, 2, np.nan]), tw.ValueRangeError, "entry nan"),
        (lambda r: statics.wrench_ellipsoid(r, BENT).reach([1, 2]), tw.ShapeError, "direction has shape"),
        (lambda r: statics.wrench_ellipsoid(r, BENT).reach([0, 0, 0]), tw.ValueRangeError, "points nowhere"),
        (lambda r: statics.wrench_from_torques(r, [BENT] * 2, BENT), tw.ShapeError, "one q .* rank"),
        (lambda r: statics.wrench_from_torques(r, BENT, [np.nan] * 6), tw.ValueRangeError, "tau has the entry nan"),
        (lambda r: statics.wrench_from_torques(r, BENT, BENT, length=np.inf), tw.ValueRangeError, "length .* is inf"),
        (lambda r: statics.payload_in_region(r, BENT, []), tw.ShapeError, "com|region"),
    ],
)
def test_errors_name_the_offender(bundled, call, error, words):
    with pytest.raises(error, match=words):
        call(bundled("ur5"))
