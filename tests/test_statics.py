"""Statics: torques and wrenches, ellipsoids, polytopes and payloads, as laws and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import statics
from twistwrench.statics.limits import effort_limits, growth

STRONG = [50.0, 20.0]
ROBOTS = ["ur5", "panda", "planar_2r"]
G = 9.81


def limits_of(robot):
    return np.array(STRONG) if robot.name == "planar_2r" else robot.limits.effort


@pytest.fixture
def arm():
    return tw.robots.planar_2r()


@pytest.fixture(params=ROBOTS)
def robot(request, bundled):
    return bundled(request.param)


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


# ── payload ──


def test_the_two_link_arm_stretched_out(arm):
    found = statics.largest_payload(arm, [0.0, 0.0], limits=STRONG)
    assert_allclose(found.unloaded, [3 * G, G], rtol=1e-12)
    assert_allclose(found.per_kilogram, [2 * G, G], rtol=1e-12)
    assert_allclose(found.per_joint, [(50 - 3 * G) / (2 * G), (20 - G) / G], rtol=1e-12)
    assert found.joint == 1
    assert found.side == 1


def test_the_robot_that_carries_the_largest_payload_is_at_its_limit(robot):
    rng = np.random.default_rng(12)
    L, com = limits_of(robot), np.array([0.05, -0.02, 0.1])
    for q in robot.random_configuration(rng, 8):
        found = statics.largest_payload(robot, q, com, limits=L)
        if not found.holds:
            assert found.mass == 0
            assert (np.abs(robot.gravity_forces(q)) > L).any()
            continue
        loaded = robot.with_payload(tw.SpatialInertia.from_com(float(found.mass), com), frame=robot.tip)
        tau = loaded.reference("gravity_forces", q)
        assert_allclose(tau, found.torques, rtol=1e-9, atol=1e-9)
        assert_allclose(np.abs(tau / L).max(), 1, rtol=1e-9)
        assert_allclose(tau[found.joint] / L[found.joint], found.side, rtol=1e-9)
        assert_allclose(found.share[found.joint], 1, rtol=1e-12)


def test_bisection_finds_the_same_payload(bundled):
    ur5 = bundled("ur5")
    q, com = np.array([0.1, -0.6, 0.9, 0.2, 0.3, 0.0]), np.array([0.0, 0.03, 0.1])
    low, high = 0.0, 1000.0
    for _ in range(45):
        middle = 0.5 * (low + high)
        loaded = ur5.with_payload(tw.SpatialInertia.from_com(middle, com))
        fits = (np.abs(loaded.reference("gravity_forces", q)) <= ur5.limits.effort).all()
        low, high = (middle, high) if fits else (low, middle)
    assert_allclose(statics.largest_payload(ur5, q, com).mass, low, rtol=1e-10)


def test_payloads_come_in_batches(bundled):
    ur5, rng = bundled("ur5"), np.random.default_rng(13)
    q, com = ur5.random_configuration(rng, (4, 1)), rng.uniform(-0.1, 0.1, (3, 3))
    found = statics.largest_payload(ur5, q, com)
    assert found.mass.shape == (4, 3)
    assert found.share.shape == (4, 3, 6)
    one = statics.largest_payload(ur5, q[2, 0], com[1])
    assert_allclose(found.mass[2, 1], one.mass, rtol=1e-13)
    assert "12 poses" in str(found)


def test_a_robot_too_weak_for_itself_holds_nothing(arm):
    found = statics.largest_payload(arm, [0.0, 0.0], limits=[20.0, 20.0])
    assert found.mass == 0
    assert not found.holds
    assert found.joint == -1
    assert "joint1 needs 29.43 of 20" in str(found)
    upright = statics.largest_payload(arm, [np.pi / 2, 0.0], limits=[20.0, 20.0])
    assert np.isinf(upright.mass)
    assert "any payload" in str(upright)


def test_what_is_unknown_stays_unknown(bundled):
    ur5 = bundled("ur5")
    q = np.array([ur5.neutral, np.full(6, np.nan)])
    assert np.isnan(statics.largest_payload(ur5, q).mass).tolist() == [False, True]
    assert np.isnan(statics.largest_wrench(ur5, q, (0, 0, 1)).magnitude).tolist() == [False, True]


def test_a_region_is_as_weak_as_its_worst_corner_and_as_good_as_its_best_point(bundled):
    ur5, rng = bundled("ur5"), np.random.default_rng(14)
    q = np.array([0.1, -0.6, 0.9, 0.2, 0.3, 0.0])
    region = rng.uniform(-0.3, 0.3, (6, 3))
    found = statics.payload_in_region(ur5, q, region)
    mixtures = rng.dirichlet(np.ones(6), 4000) @ region
    masses = statics.largest_payload(ur5, q, mixtures).mass
    assert found.sure <= masses.min() + 1e-9
    assert_allclose(statics.largest_payload(ur5, q, found.worst_com).mass, found.sure, rtol=1e-12)
    assert found.best >= masses.max() - 1e-9
    assert_allclose(statics.largest_payload(ur5, q, found.best_com).mass, found.best, rtol=1e-7)


def test_the_map_keeps_to_the_samples_and_to_the_workspace(bundled):
    ur5 = bundled("ur5")
    found = statics.payload_map(ur5, "rz", cells=20, samples=5000)
    assert found.samples == 5000
    filled = found.count > 0
    assert (found.best[filled] >= found.worst[filled]).all()
    assert np.isnan(found.best[~filled]).all()
    masses = statics.largest_payload(ur5, ur5.random_configuration(np.random.default_rng(0), 5000)).mass
    assert np.nanmax(found.best) == masses.max()
    assert np.nanmin(found.worst) == masses.min()
    slab = statics.payload_map(ur5, "xz", thickness=0.2, cells=20, samples=5000)
    assert 0 < slab.samples < 5000


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


# ── errors ──


def test_without_limits_the_error_says_to_pass_them(arm):
    for call in (statics.largest_payload, statics.wrench_polytope, statics.weakest_direction):
        with pytest.raises(tw.ValueRangeError, match=r"gives no effort limits.*Pass limits= with 2 numbers"):
            call(arm, [0.0, 0.0])


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda r: statics.largest_payload(r, r.neutral, limits=[1.0]), tw.ShapeError, "limits has shape"),
        (lambda r: statics.largest_payload(r, r.neutral, limits=[-1.0] * 6), tw.ValueRangeError, "at least zero"),
        (lambda r: statics.largest_payload(r, r.neutral, com=[1, 2]), tw.ShapeError, "com has shape"),
        (lambda r: statics.largest_payload(r, r.neutral, com=[1, 2, np.nan]), tw.ValueRangeError, "not a finite"),
        (lambda r: statics.largest_payload(r, [0.0]), tw.ShapeError, "q has shape"),
        (lambda r: statics.largest_payload(r, r.neutral, frame="hand"), tw.UnknownNameError, "hand"),
        (lambda r: statics.payload_in_region(r, r.neutral[None], [[0, 0, 0]]), tw.ShapeError, "one q"),
        (lambda r: statics.wrench_polytope(r, r.neutral, part="couple"), tw.UnknownNameError, "part of a wrench"),
        (lambda r: statics.wrench_polytope(r, r.neutral, rest="all"), tw.UnknownNameError, "rest"),
        (lambda r: statics.wrench_polytope(r, r.neutral, limits=[1.0] * 6), tw.ValueRangeError, "gravity alone|itself"),
        (lambda r: statics.wrench_polytope(r, r.neutral, limits=[0.0] * 6), tw.ValueRangeError, "limit of zero"),
        (lambda r: statics.largest_wrench(r, r.neutral, [0, 0]), tw.ShapeError, "direction has shape"),
        (lambda r: statics.largest_wrench(r, r.neutral, [0, 0, 0]), tw.ValueRangeError, "points nowhere"),
        (lambda r: statics.wrench_from_torques(r, r.neutral, [1.0]), tw.ShapeError, "takes tau"),
        (lambda r: statics.wrench_from_torques(r, r.neutral[:2], [1.0] * 6), tw.ShapeError, "one q"),
        (lambda r: statics.wrench_polytope(r, [0, np.nan, 0, 0, 0, 0]), tw.ValueRangeError, "shoulder_lift_joint"),
        (lambda r: statics.wrench_from_torques(r, r.neutral, [1.0] * 6, length=0.0), tw.ValueRangeError, "positive"),
        (lambda r: statics.payload_map(r, "zz"), tw.UnknownNameError, "slice"),
        (lambda r: statics.payload_map(r, "xz", at=9.0, samples=100), tw.ValueRangeError, "none of 100"),
        (lambda r: statics.payload_map(r, samples=0), tw.ValueRangeError, "at least one cell"),
    ],
)
def test_errors_name_the_offender(bundled, call, error, words):
    with pytest.raises(error, match=words):
        call(bundled("ur5"))


def test_nothing_drives_a_floating_base(bundled):
    box = bundled("floating_box")
    with pytest.raises(tw.ValueRangeError, match="needs a fixed base"):
        statics.largest_payload(box, box.neutral)
    assert_allclose(effort_limits(box), 0)


def test_a_joint_that_gives_nothing_and_a_robot_without_joints(arm):
    found = statics.largest_payload(arm, [0.0, 0.0], limits=[50.0, 0.0])
    assert found.mass == 0
    assert np.isinf(found.share[1])
    with pytest.raises(tw.ValueRangeError, match="no joint that moves"):
        statics.largest_payload(arm.lock({"joint1": 0.0, "joint2": 0.0}), [], limits=[])
