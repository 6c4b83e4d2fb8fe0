"""Wrench ellipsoids, polytopes and weakest directions, as laws and against linear programmes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from statics_fixtures import STRONG

import twistwrench as tw
from twistwrench import statics

pytest_plugins = ("statics_fixtures",)


def limits_of(robot):
    return np.array(STRONG) if robot.name == "planar_2r" else robot.limits.effort


# ── ellipsoid ──


def test_the_ellipsoid_of_the_two_link_arm_is_golden(arm):
    found = statics.wrench_ellipsoid(arm, [0.0, np.pi / 2])
    golden = (1 + np.sqrt(5)) / 2
    assert_allclose(found.semi_axes[1:], [golden, 1 / golden], rtol=1e-12)
    assert np.isinf(found.semi_axes[0])  # across its plane the structure bears all


def test_forces_on_the_ellipsoid_take_torques_of_unit_norm(robot):
    rng = np.random.default_rng(5)
    q, d = robot.random_configuration(rng, 50), rng.standard_normal((50, 3))
    found = statics.wrench_ellipsoid(robot, q)
    f = found.reach(d)[:, None] * d / np.linalg.norm(d, axis=1, keepdims=True)
    J = robot.jacobian(q, kind="world_aligned")[:, 3:]
    assert_allclose(np.linalg.norm(np.einsum("kij,ki->kj", J, f), axis=1), 1, rtol=1e-9)
    product = np.einsum("kij,ki->kj", J, found.axes[..., -1] * found.semi_axes[:, -1:])
    assert_allclose(np.linalg.norm(product, axis=1), 1, rtol=1e-9)


def test_the_ellipsoid_of_shares_lies_in_the_polytope(bundled):
    ur5, rng = bundled("ur5").with_gravity((0, 0, 0)), np.random.default_rng(6)
    q = ur5.random_configuration(rng)
    inside = statics.wrench_ellipsoid(ur5, q, limits=ur5.limits.effort)
    d = rng.standard_normal((500, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    reach = inside.reach(d)
    assert statics.wrench_polytope(ur5, q).contains(reach[:, None] * d).all()
    assert (statics.largest_wrench(ur5, q, d).magnitude <= np.sqrt(6) * reach * (1 + 1e-9)).all()


# ── polytope ──


@pytest.mark.parametrize("part", ["force", "moment", "wrench"])
def test_the_polytope_is_exactly_what_the_torques_allow(robot, part):
    rng = np.random.default_rng(7)
    L = 1.2 * limits_of(robot)
    rows = {"moment": slice(0, 3), "force": slice(3, 6), "wrench": slice(0, 6)}[part]
    tried = 0
    for q in robot.random_configuration(rng, 6):
        g, J = robot.gravity_forces(q), robot.jacobian(q, kind="world_aligned")[rows]
        if (np.abs(g) > L).any():
            continue
        found = statics.wrench_polytope(robot, q, part=part, limits=L)
        x = found.vertices[rng.integers(len(found.vertices), size=300)] * rng.uniform(0, 2, (300, 1))
        x += rng.standard_normal(x.shape) @ found.borne @ found.borne.T
        allowed = (np.abs(g + x @ J) <= L).all(axis=1)
        clear = (np.abs(np.abs(g + x @ J) - L) > 1e-6).all(axis=1)
        assert (found.contains(x) == allowed)[clear].all()
        assert 0 < allowed.sum() < 300
        at_corners = np.abs(g + found.vertices @ J) / L
        assert_allclose(at_corners.max(axis=1), 1, atol=1e-7)
        dimension = x.shape[1] - found.borne.shape[1]
        assert (np.sum(at_corners > 1 - 1e-6, axis=1) >= min(dimension, robot.nv)).all()
        tried += 1
    assert tried


def test_its_support_is_the_linear_programme(bundled):
    from scipy.optimize import linprog

    panda, rng = bundled("panda"), np.random.default_rng(8)
    q = panda.random_configuration(rng)
    g, A, L = panda.gravity_forces(q), panda.jacobian(q, kind="world_aligned")[3:].T, panda.limits.effort
    found = statics.wrench_polytope(panda, q)
    for d in rng.standard_normal((20, 3)):
        best = linprog(-d, A_ub=np.vstack([A, -A]), b_ub=np.concatenate([L - g, L + g]), bounds=(None, None))
        assert_allclose(found.support(d), -best.fun, rtol=1e-9)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_the_projection_is_the_shadow_and_holds_the_section(bundled, name):
    from scipy.optimize import linprog

    robot, rng = bundled(name), np.random.default_rng(9)
    q = robot.random_configuration(rng)
    g, A, L = robot.gravity_forces(q), robot.jacobian(q, kind="world_aligned").T, robot.limits.effort
    section = statics.wrench_polytope(robot, q)
    shadow = statics.wrench_polytope(robot, q, rest="any")
    assert shadow.contains(section.vertices, slack=1e-6).all()
    for d in rng.standard_normal((10, 3)):
        best = linprog(
            np.concatenate([np.zeros(3), -d]),
            A_ub=np.vstack([A, -A]),
            b_ub=np.concatenate([L - g, L + g]),
            bounds=(None, None),
        )
        assert_allclose(shadow.support(d), -best.fun, rtol=1e-6)


def test_at_a_singular_pose_the_polytope_says_what_is_unbounded(bundled):
    ur5 = bundled("ur5")
    found = statics.wrench_polytope(ur5, ur5.neutral, part="wrench")
    assert found.borne.shape[1] == 6 - np.linalg.matrix_rank(ur5.jacobian(ur5.neutral), tol=1e-9)
    assert found.contains(1e6 * found.borne.T, slack=1e-3).all()
    assert np.isinf(found.support(found.borne[:, 0]))


G = 9.81


def test_the_two_link_arm_in_closed_form(arm):
    """At (0, 90°): τ₁ = 19.62 - f_x + f_z, τ₂ = -f_x up to the arm's signs, so the polygon is a parallelogram."""
    q = [0.0, np.pi / 2]
    found = statics.wrench_polytope(arm, q, limits=STRONG)
    assert found.vertices.shape == (4, 3)
    g, (f_x, f_z) = arm.gravity_forces(q), found.vertices[:, [0, 2]].T
    assert_allclose(g, [2 * G, 0], atol=1e-12)
    assert_allclose(np.abs(-f_x), STRONG[1], rtol=1e-9)
    assert_allclose(np.abs(g[0] - f_x + f_z), STRONG[0], rtol=1e-9)


# ── directions ──


def test_the_largest_wrench_is_where_the_ray_leaves_the_polytope(robot):
    rng = np.random.default_rng(10)
    L = 2 * limits_of(robot)
    q = robot.random_configuration(rng, 200)
    d = rng.standard_normal((200, 6))
    found = statics.largest_wrench(robot, q, d, limits=L)
    J = robot.jacobian(q, kind="world_aligned")
    tau = robot.gravity_forces(q) + np.einsum("kij,ki->kj", J, found.magnitude[:, None] * found.wrench)
    share = (tau / L)[found.joint >= 0]
    assert_allclose(np.abs(share).max(axis=1), 1, rtol=1e-9)
    reached = np.take_along_axis(share, found.joint[found.joint >= 0, None], axis=1)[:, 0]
    assert_allclose(reached, found.side[found.joint >= 0], rtol=1e-9)


def test_no_direction_is_weaker_than_the_weakest(robot):
    rng = np.random.default_rng(11)
    L = 2 * limits_of(robot)
    d = rng.standard_normal((4000, 3))
    for q in robot.random_configuration(rng, 5):
        if (np.abs(robot.gravity_forces(q)) > L).any():
            continue
        weakest = statics.weakest_direction(robot, q, limits=L)
        others = statics.largest_wrench(robot, q, d, limits=L).magnitude
        assert others.min() >= weakest.magnitude * (1 - 1e-12)
        assert others.min() <= weakest.magnitude * 1.05
        again = statics.largest_wrench(robot, q, weakest.wrench, limits=L)
        assert_allclose(again.magnitude, weakest.magnitude, rtol=1e-12)


def test_the_facets_are_the_sides_that_bound_a_polytope(robot):
    """Without any other side it is the same, and each of them has a middle that no other side touches."""
    rng = np.random.default_rng(12)
    for q in robot.random_configuration(rng, 1):
        found = statics.wrench_polytope(robot, q, limits=3 * limits_of(robot))
        bounds = np.array([side in found.facets for side in found.sides])
        assert set(found.facets) <= set(found.sides) and bounds.sum() > found.normals.shape[1] - found.borne.shape[1]
        for k in np.flatnonzero(bounds):  # the middle of each is within all other sides
            on_it = np.abs(found.vertices @ found.normals[k] - found.offsets[k]) < 1e-6 * (1.0 + found.offsets[k])
            room = found.offsets - found.normals @ found.vertices[on_it].mean(axis=0)
            assert np.delete(room, k).min() > 1e-6 * (1.0 + found.offsets[k])
        directions = rng.standard_normal((400, 3))
        directions -= directions @ found.borne @ found.borne.T
        reach = [
            np.min(
                np.where((rate := directions @ found.normals[kept].T) > 1e-12, found.offsets[kept] / rate, np.inf),
                axis=1,
            )
            for kept in (np.ones(len(bounds), bool), bounds)
        ]
        assert_allclose(reach[1], reach[0], rtol=1e-6)
        points = directions * (reach[0] * rng.choice([0.99, 1.01], 400))[:, None]
        assert (
            found.contains(points) == (np.linalg.norm(points, axis=1) < np.linalg.norm(directions, axis=1) * reach[0])
        ).all()


@pytest.mark.parametrize(("effort", "holds"), [(0.4, True), (0.2, False)])
def test_a_joint_that_no_force_loads_bounds_nothing_but_has_to_hold_itself(tmp_path, effort, holds):
    """A wrist about its own axis carries 0.3 N m of a weight beside it, whatever force acts on that axis."""
    inertial = '<inertial><origin xyz="{0}"/><mass value="{1}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    hinge = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/><axis xyz="{4}"/>'
        '<limit lower="-3" upper="3" effort="{5}" velocity="1"/></joint>'
    )
    robot = tw.load(
        f'<robot name="wrist"><link name="base"/><link name="arm">{inertial.format("0.2 0 0", 1)}</link>'
        f'<link name="hand">{inertial.format("0 0.03 0", 1.0)}</link><link name="tip"/>'
        f"{hinge.format('shoulder', 'base', 'arm', '0 0 0', '0 1 0', 50)}{hinge.format('wrist', 'arm', 'hand', '0.5 0 0', '1 0 0', effort)}"
        '<joint name="end" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0.1 0 0"/></joint></robot>'
    )
    if holds:
        found = statics.wrench_polytope(robot, [0.3, 0.0], rest="zero")
        assert all("wrist" not in side for side in found.sides) and {side[1:] for side in found.sides} == {"shoulder"}
    else:
        with pytest.raises(tw.ValueRangeError, match="wrist is beyond its limit whatever wrench is applied"):
            statics.wrench_polytope(robot, [0.3, 0.0], rest="zero")
