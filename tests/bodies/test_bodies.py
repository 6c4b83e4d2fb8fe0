"""One rigid body: the formulas of Modern Robotics 8.2 (A1 to A11) and where sources slip.

Laws compare by norm: 1e-12 of the largest entry where nothing else is said. Terms are sums of some tens of products of numbers
of order 1 to 100, which rounds by 1e-14; 1e-12 allows for a frame that is metres away, whose terms cancel.
"""

from __future__ import annotations

import contextlib
import gc
import weakref

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import twistwrench as tw
from twistwrench import Ad, RigidBody, SpatialInertia, ad, se3, so3
from twistwrench.testing import assert_close, derivative, relative_gap

TOL = 1e-12


def law(test):
    """Run for many seeds, however long the machine takes for one."""
    return settings(max_examples=50, deadline=None)(given(seed=st.integers(0, 2**32 - 1))(test))


def cloud(rng: np.random.Generator, n: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Masses (n,) and points (n, 3) of a body made of points."""
    return rng.uniform(0.1, 2.0, n), rng.normal(size=(n, 3))


def random_body(rng: np.random.Generator) -> RigidBody:
    return RigidBody(SpatialInertia.from_points(*cloud(rng)))


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return se3.exp(rng.normal(size=6))


# ── A1 to A3: the body as point masses ──


@law
def test_point_velocity_and_acceleration(seed):
    rng = np.random.default_rng(seed)
    body, r, V, dV = random_body(rng), *(0.5 * rng.normal(size=n) for n in (3, 6, 6))

    # T(t) = exp([V t + ...]) by differences, from {s} aligned with the body at t = 0: V_b(t) = V + t dV to first order.
    def path(t: np.ndarray) -> np.ndarray:
        z = (
            t[:, None] * V + 0.5 * t[:, None] ** 2 * dV
        )  # log of the motion: body twist V + t dV + O(t²) in ad(dV) V only
        return se3.exp(z)[:, :3, :3] @ r + se3.exp(z)[:, :3, 3]

    rate = 1.0 + np.abs(V).sum() + np.abs(dV).sum()
    assert_close(
        body.point_velocity(V, r), derivative(path, rate), 1e-10, "velocity", scale=rate * (1 + np.abs(r).sum())
    )

    def velocity(t: np.ndarray) -> np.ndarray:
        z = t[:, None] * V + 0.5 * t[:, None] ** 2 * dV
        return (se3.exp(z)[:, :3, :3] @ body.point_velocity(V + t[:, None] * dV, r)[..., None])[..., 0]

    acceleration = body.point_acceleration(V, dV, r)
    assert_close(acceleration, derivative(velocity, rate), 1e-9, "acceleration", scale=rate**2 * (1 + np.abs(r).sum()))


@law
def test_the_wrench_is_the_sum_over_point_masses(seed):
    rng = np.random.default_rng(seed)
    masses, points = cloud(rng)
    body, V, dV = RigidBody(SpatialInertia.from_points(masses, points)), rng.normal(size=6), rng.normal(size=6)
    f = masses[:, None] * body.point_acceleration(V, dV, points)
    total = np.concatenate([np.cross(points, f).sum(axis=0), f.sum(axis=0)])
    assert_close(body.wrench(V, dV), total, TOL)


@law
def test_eulers_equations_at_the_centre_of_mass_in_principal_axes(seed):
    rng = np.random.default_rng(seed)
    I, m = rng.uniform(2.0, 3.0, 3), 1.5
    body, V, dV = RigidBody(SpatialInertia.from_com(m, moment_about_com=np.diag(I))), *rng.normal(size=(2, 6))
    (w1, w2, w3), (a1, a2, a3) = V[:3], dV[:3]
    couple = [
        I[0] * a1 + (I[2] - I[1]) * w2 * w3,
        I[1] * a2 + (I[0] - I[2]) * w1 * w3,
        I[2] * a3 + (I[1] - I[0]) * w1 * w2,
    ]
    assert_close(body.wrench(V, dV)[:3], couple, TOL)
    assert_close(
        body.wrench(V, dV)[3:], m * (dV[3:] + np.cross(V[:3], V[3:])), TOL
    )  # A2: the mass multiplies both terms


# ── A4 to A9: energy, momentum, frames ──


@law
def test_energy_and_momentum(seed):
    rng = np.random.default_rng(seed)
    masses, points = cloud(rng)
    body, V = RigidBody(SpatialInertia.from_points(masses, points)), rng.normal(size=6)
    p = masses[:, None] * body.point_velocity(V, points)
    assert_close(body.momentum(V), np.concatenate([np.cross(points, p).sum(axis=0), p.sum(axis=0)]), TOL)
    assert_close(body.kinetic_energy(V), 0.5 * np.sum(p**2 / masses[:, None]), TOL)
    G, w, c = body.inertia, V[:3], body.inertia.com
    v_com = body.point_velocity(V, c)
    assert_close(body.kinetic_energy(V), 0.5 * w @ G.moment_about_com @ w + 0.5 * G.mass * v_com @ v_com, TOL)


@law
def test_blocks_and_steiner(seed):
    rng = np.random.default_rng(seed)
    G = random_body(rng).inertia
    h = G.mass * so3.hat(G.com)
    assert_close(G.matrix, np.block([[G.moment_about_origin, h], [-h, G.mass * np.eye(3)]]), TOL)
    at_com = G.in_frame(se3.pose(np.eye(3), -G.com))
    assert_close(at_com.matrix, np.block([[G.moment_about_com, np.zeros((3, 3))], [np.zeros((3, 3)), G.mass * np.eye(3)]]),
                 TOL)  # fmt: skip
    q = rng.normal(size=3)
    about_q = at_com.in_frame(se3.pose(np.eye(3), -q)).moment_about_origin
    assert_close(about_q, G.moment_about_com + G.mass * (q @ q * np.eye(3) - np.outer(q, q)), TOL)


@law
def test_the_bracket(seed):
    V1, V2, V3 = np.random.default_rng(seed).normal(size=(3, 6))
    assert_close(ad(V1) @ V2, -(ad(V2) @ V1), TOL)
    jacobi = ad(V1) @ (ad(V2) @ V3) + ad(V2) @ (ad(V3) @ V1) + ad(V3) @ (ad(V1) @ V2)
    assert np.abs(jacobi).max() <= TOL * 100


def test_energy_power_and_motion_are_the_same_in_a_thousand_frames():
    rng = np.random.default_rng(8)
    body, V, dV = random_body(rng), *rng.normal(size=(2, 6))
    F = body.wrench(V, dV)
    for _ in range(1000):
        T_ab = random_pose(rng)
        T_ba = se3.inverse(T_ab)
        seen, V_a, dV_a = body.in_frame(T_ab), Ad(T_ab) @ V, Ad(T_ab) @ dV
        F_a = seen.wrench(V_a, dV_a)
        assert_close(seen.kinetic_energy(V_a), body.kinetic_energy(V), TOL)
        assert_close(F_a @ V_a, F @ V, TOL, scale=np.abs(F).max() * np.abs(V).max())
        assert_close(F_a, Ad(T_ba).T @ F, TOL)
        assert_close(seen.acceleration(V_a, F_a), dV_a, 1e-11)  # times the condition of G, ten to a hundred
        assert_close(seen.inertia.matrix, Ad(T_ba).matrix.T @ body.inertia.matrix @ Ad(T_ba).matrix, TOL)


@law
def test_power_is_the_rate_of_energy(seed):
    rng = np.random.default_rng(seed)
    body, V, dV = random_body(rng), *rng.normal(size=(2, 6))
    P = body.momentum(V)
    assert_close(
        body.wrench(V, dV) @ V, P @ dV, TOL, scale=np.abs(P).sum() * (1 + np.abs(dV).sum() + np.abs(V).sum() ** 2)
    )


@law
def test_acceleration_undoes_wrench_in_any_batch(seed):
    rng = np.random.default_rng(seed)
    body, V, dV = random_body(rng), rng.normal(size=(4, 1, 6)), rng.normal(size=(3, 6))
    F = body.wrench(V, dV)
    assert F.shape == (4, 3, 6)
    assert_close(body.acceleration(V, F), np.broadcast_to(dV, F.shape), 1e-10)  # times the condition of G
    assert_close(F[2, 1], body.wrench(V[2, 0], dV[1]), TOL)
    assert_close(F, body.inertia @ dV - ad(V).T @ (body.inertia @ V), TOL)


def test_batches_longer_than_a_block_and_empty_ones():
    rng = np.random.default_rng(2)
    body, V, dV = random_body(rng), *rng.normal(size=(2, 5000, 6))
    assert_close(body.wrench(V, dV), body.inertia @ dV - ad(V).T @ (body.inertia @ V), TOL)
    assert body.wrench(np.zeros((0, 6)), np.zeros((0, 6))).shape == (0, 6)
    single = body.wrench(V.astype(np.float32), dV.astype(np.float32))
    assert single.dtype == np.float32
    assert_close(single, body.wrench(V, dV), 1e-5)
    for mixed in (body.wrench(V.astype(np.float32), dV), body.acceleration(V.astype(np.float32), dV)):
        assert mixed.dtype == np.float64  # what float64 says is not rounded


@law
def test_weight_is_gravity_on_every_point(seed):
    rng = np.random.default_rng(seed)
    masses, points = cloud(rng)
    body, T, g = RigidBody(SpatialInertia.from_points(masses, points)), random_pose(rng), rng.normal(size=3)
    f = np.multiply.outer(masses, T[:3, :3].T @ g)
    assert_close(body.weight(T, g), np.concatenate([np.cross(points, f).sum(axis=0), f.sum(axis=0)]), TOL)
    # What falls freely feels nothing: the weight gives each point the acceleration g, whatever the spin.
    V = rng.normal(size=6)
    a = body.point_acceleration(V, body.acceleration(V, body.weight(T, g)), body.inertia.com)
    assert_close(a, T[:3, :3].T @ g, 1e-10, scale=1 + np.abs(V).max() ** 2)


# ── part C: where sources slip ──


def slips(seed: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Wrong and right values of one random motion and their difference as algebra has it, by name of the slip."""
    rng = np.random.default_rng(seed)
    body, r, V, dV, T_ab = random_body(rng), rng.normal(size=3), *rng.normal(size=(2, 6)), random_pose(rng)
    G, (w, v), (dw, dv) = body.inertia, np.split(V, 2), np.split(dV, 2)
    F, T_ba = body.wrench(V, dV), se3.inverse(T_ab)
    F_a = body.in_frame(T_ab).wrench(Ad(T_ab) @ V, Ad(T_ab) @ dV)
    I, m = np.sort(rng.uniform(1.0, 2.0, 3)), 1.5
    centred = RigidBody(SpatialInertia.from_com(m, moment_about_com=np.diag(I)))
    turn = np.cross(w, v + np.cross(w, r))
    diagonal = 0.5 * w @ G.moment_about_com @ w + 0.5 * G.mass * v @ v
    u = np.cross(w, G.com)  # of the centre of mass, relative to the origin
    second = I[1] * dw[1] + (I[2] - I[0]) * w[0] * w[2]
    P = G.matrix @ V
    l, p = P[:3], P[3:]
    R, t = T_ba[:3, :3], T_ba[:3, 3]
    gyroscopic = np.concatenate([np.cross(w, l) + np.cross(v, p), np.cross(w, p)])  # -ad(V)' P
    crossed = np.concatenate([np.cross(w, l), np.cross(v, l) + np.cross(w, p)])  # ad(V) P
    moved = np.concatenate([R @ F[:3], np.cross(t, R @ F[:3]) + R @ F[3:]])  # the twist's way
    against = np.concatenate([R.T @ (F[:3] - np.cross(t, F[3:])), R.T @ F[3:]])  # the wrench's
    return {
        "1: the sign of ad": (G @ dV + ad(V).T @ (G @ V), F, -2.0 * gyroscopic),
        "1: the transpose of ad": (G @ dV - ad(V) @ (G @ V), F, -crossed - gyroscopic),
        "2: the transpose of Ad": (Ad(T_ba) @ F, F_a, moved - against),
        "4: diag(I, m) off the centre of mass": (diagonal, body.kinetic_energy(V), -G.mass * (v @ u + 0.5 * u @ u)),
        "6: [w] r for [dw] r": (dv + np.cross(w, r) + turn, body.point_acceleration(V, dV, r), np.cross(w - dw, r)),
        "6: mass on one term": (m * dv + np.cross(w, v), centred.wrench(V, dV)[3:], (1.0 - m) * np.cross(w, v)),
        "7: indices of Euler's second row": (second, centred.wrench(V, dV)[1], 2.0 * (I[2] - I[0]) * w[0] * w[2]),
    }


@pytest.mark.parametrize("name", slips(0))
@law
def test_the_wrong_forms_fail_the_tests_above(name, seed):
    wrong, right, difference = slips(seed)[name]
    size = np.abs(right).max()
    # By luck a slip may cost nothing: a spin about one axis hides 7, a centre of mass at rest 4. Algebra says when.
    assume(np.abs(difference).max() > 1e-3 * size)
    assert_close(wrong - right, difference, TOL, scale=np.abs(wrong).max() + size)
    assert relative_gap(wrong, right) > 0.9e-3


@pytest.mark.parametrize("name", slips(0))
def test_the_wrong_forms_are_mostly_far_off(name):
    assert np.median([relative_gap(*slips(seed)[name][:2]) for seed in range(50)]) > 0.1


# ── refusals ──


def test_bodies_that_cannot_exist():
    for G, message in (
        (SpatialInertia.from_com(1.0, moment_about_com=np.diag([1.0, 1.0, 3.0])), "triangle inequality"),
        (SpatialInertia.from_com(-1.0), "negative mass"),
        (SpatialInertia.from_com(np.nan), "not a finite number"),
        (SpatialInertia.zero(), "no mass"),
    ):
        with pytest.raises(tw.InertiaError, match=message):
            RigidBody(G)
    with pytest.raises(tw.InertiaError, match="made of a SpatialInertia"):
        RigidBody(np.eye(6))
    with pytest.raises(tw.InertiaError, match="no extent"):
        SpatialInertia.from_points([1, 1], [[0, 0, 1], [0, 0, -1]]).log_cholesky()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
def test_moments_may_miss_the_triangle_inequality_by_a_millionth(scale):
    """To 1e-6 of their sum, whatever the scale: files with six digits are read, and a flat plate is no nearer than that."""
    for beyond, allowed in ((4e-7, True), (4e-5, False), (4e-3, False)):
        G = SpatialInertia.from_com(1.0, moment_about_com=scale * np.diag([1.0, 1.0, 2.0 + beyond]))
        assert (G.defects() == []) is allowed
    for below, allowed in ((-4e-7, True), (-4e-5, False)):
        G = SpatialInertia.from_com(1.0, moment_about_com=scale * np.diag([below, 1.0, 1.0]))
        assert (G.defects() == []) is allowed


def test_vectors_of_the_wrong_shape():
    body = RigidBody(SpatialInertia.sphere(0.1, mass=1.0))
    for call, message in (
        (lambda: body.wrench(np.ones(5), np.ones(6)), r"V has shape \(5,\)"),
        (lambda: body.wrench(np.ones((2, 6)), np.ones((3, 6))), r"V \(2, 6\), dV \(3, 6\)"),
        (lambda: body.point_velocity(np.ones(6), np.ones(2)), r"r has shape \(2,\)"),
        (lambda: body.weight(np.eye(3)), "T_sb has shape"),
        (lambda: SpatialInertia.from_pseudo_inertia(np.eye(3)), r"\(4, 4\)"),
        (lambda: SpatialInertia.from_log_cholesky(np.ones(9)), r"\(10,\)"),
    ):
        with pytest.raises(tw.ShapeError, match=message):
            call()
    with pytest.raises(tw.ValueRangeError, match="must be finite"):
        SpatialInertia.from_log_cholesky(np.full(10, np.nan))


def test_a_point_has_no_angular_acceleration():
    with pytest.raises(tw.SingularMassMatrixError, match="no inertia about"):
        RigidBody(SpatialInertia.from_com(1.0)).acceleration(np.zeros(6), np.ones(6))


def test_labels_of_two_frames_and_wrong_kinds_are_refused():
    body = tw.RigidBody(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
    V, dV = np.arange(6.0), np.ones(6)
    labelled = body.wrench(tw.Twist(V, "b"), tw.Twist(dV, "b"))
    assert np.array_equal(labelled, body.wrench(V, dV))
    with pytest.raises(tw.FrameError, match="V in 'b', dV in 'c'"):
        body.wrench(tw.Twist(V, "b"), tw.Twist(dV, "c"))
    with pytest.raises(tw.FrameError, match="F is a Wrench, not a Twist"):
        body.acceleration(V, tw.Twist(dV, "b"))


def test_a_labelled_twist_times_an_inertia_is_refused():
    """An inertia names no frame, so the frame of the twist would be dropped unchecked."""
    G, V = tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2), tw.Twist(np.ones(6), "b")
    with pytest.raises(tw.FrameError, match=r"write G @ V_b\.values"):
        G @ V
    with pytest.raises(tw.FrameError, match=r"work on V_b\.values"):
        G.matrix @ V
    assert np.array_equal(G @ V.values, G.matrix @ V.values)


def test_inertias_of_one_frame_can_be_summed():
    grip, part = tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2), tw.SpatialInertia.from_com(2.0, (0, 0, 0.1))
    assert np.array_equal(sum([grip, part]).parameters, (grip + part).parameters)
    for wrong in (1, "0", None, np.zeros(2)):
        with pytest.raises(tw.InertiaError, match="goes with another SpatialInertia"):
            wrong + grip


def test_an_inertia_prints_mass_centre_and_moments():
    G = tw.SpatialInertia.from_com(2.0, (0, 0, 0.5), np.diag([0.1, 0.2, 0.25]))
    words = "about the com Ixx, Iyy, Izz = (0.1, 0.2, 0.25)"
    assert repr(G) == f"SpatialInertia: mass 2 kg, com (0, 0, 0.5) m, {words} kg m²"
    away = G.in_frame(tw.se3.exp([0, 0, 0, 7.0, -3, 2]))  # Steiner's rounding is not printed as products
    assert repr(away) == f"SpatialInertia: mass 2 kg, com (7, -3, 2.5) m, {words} kg m²"
    turned = G.in_frame(tw.se3.exp([0, 0, np.pi / 4, 0, 0, 0]))
    assert repr(turned).endswith("(0.15, 0.15, 0.25), Ixy, Ixz, Iyz = (-0.05, 0, 0) kg m²")
    assert "(nan, 0.0" in repr(tw.SpatialInertia([np.nan, *[0.0] * 9]))
    assert repr(tw.SpatialInertia.zero()).startswith("SpatialInertia: mass 0 kg")
    assert repr(tw.RigidBody(G)) == f"RigidBody(inertia={G!r})"


def test_poses_and_moments_that_are_none_are_refused():
    G = tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2)
    stretched = np.diag([1.1, 1.1, 1.1, 1.0])
    for use in (G.in_frame, tw.RigidBody(G).weight):
        with pytest.raises(tw.ValueRangeError, match="not a rotation"):
            use(stretched)
    with pytest.raises(tw.InertiaError, match="not symmetric"):
        tw.SpatialInertia.from_com(1, (0, 0, 0), [[1, 0.2, 0], [0, 1, 0], [0, 0, 1]])


def test_a_point_mass_far_from_the_origin_is_no_defect():
    rng = np.random.default_rng(0)
    for mass, com in zip(rng.uniform(1, 1000, 2000), rng.normal(0, 10, (2000, 3)), strict=True):
        assert tw.SpatialInertia.from_com(mass, com).defects() == []


@pytest.mark.parametrize("length", [1e-6, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("mass", [1e-9, 1e-3, 1e3])
def test_whether_a_body_can_exist_does_not_depend_on_its_scale(mass, length):
    unit = mass * length**2
    for moments in ([-1e-3, 1.0, 1.0], [1.0, 1.0, 2.001]):
        assert SpatialInertia.from_com(mass, (0.1 * length, 0, 0), unit * np.diag(moments)).defects()
    for moments in ([0.0, 1.0, 1.0], [1.0, 1.0, 2.0], [1.0, 1.0, 2.000001]):
        assert not SpatialInertia.from_com(mass, (0.1 * length, 0, 0), unit * np.diag(moments)).defects()


def test_a_point_mass_that_comes_to_lie_at_the_origin_loads():
    text = """<robot name="bob"><link name="world"/><link name="rod"/>
      <link name="bob"><inertial><origin xyz="0.3 -0.7 0.1"/><mass value="2"/>
        <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="hinge" type="continuous"><parent link="world"/><child link="rod"/></joint>
      <joint name="held" type="fixed"><parent link="rod"/><child link="bob"/>
        <origin xyz="-0.3 0.7 -0.1" rpy="0.0 0.0 0.0"/></joint></robot>"""
    for rpy in ("0 0 0", "0.4 0.2 -0.3", "1 2 3"):
        body = tw.load(text.replace("0.0 0.0 0.0", rpy)).model.bodies[0]
        assert body.inertia.mass == 2.0


@pytest.mark.parametrize("size", [1e-4, 1e-3, 5e-3])
def test_a_linear_first_matrix_of_a_small_body_is_refused(size):
    swap = np.roll(np.eye(6), 3, axis=0)
    bodies = {
        "cube": SpatialInertia.box((size, size, size), density=7800),
        "brick": SpatialInertia.box((size, 2 * size, 3 * size), density=7800),
        "off its centre": SpatialInertia.from_com(1.0, (size, 0, 0), size**2 * np.eye(3)),
    }
    for name, G in bodies.items():
        assert_close(SpatialInertia.from_matrix(G.matrix).parameters, G.parameters, 1e-15)
        with pytest.raises(tw.InertiaError, match="linear part first"):
            print(name, SpatialInertia.from_matrix(swap @ G.matrix @ swap.T))


def test_a_small_bodys_moments_have_to_be_symmetric():
    G = SpatialInertia.from_com(1.0, (0, 0, 0), 1e-9 * np.eye(3)).matrix
    G[0, 1] += 1e-10
    with pytest.raises(tw.InertiaError, match="no spatial inertia"):
        SpatialInertia.from_matrix(G)


@pytest.mark.parametrize(
    "wrong", [np.arange(36.0).reshape(6, 6), np.diag([3.7, 3.7, 3.7, 0.01, 0.02, 0.03]), np.full((6, 6), np.nan)]
)
def test_a_matrix_without_the_form_of_an_inertia_is_refused(wrong):
    with pytest.raises(tw.InertiaError, match="no spatial inertia"):
        SpatialInertia.from_matrix(wrong)
    lists = tw.robots.planar_2r().screws
    with pytest.raises(tw.InertiaError, match="link2: no spatial inertia"):
        tw.from_screws(lists.M, lists.Slist, lists.Mlist, [lists.Glist[0], wrong])


def test_a_matrix_where_an_inertia_is_wanted_is_refused_with_the_call_for_matrices():
    G = np.diag([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    with pytest.raises(tw.ShapeError, match=r"SpatialInertia\.from_matrix\(G\)"):
        tw.SpatialInertia(G)
    with pytest.raises(tw.InertiaError, match=r"SpatialInertia\.from_matrix\(G\)"):
        tw.RigidBody(G)
    assert tw.RigidBody(tw.SpatialInertia.from_matrix(G)).inertia.mass == 2.0


def test_a_misused_constructor_lets_its_arguments_go():
    """An error that is caught keeps nothing: no reference cycle holds the arguments until the next collection."""

    class Thing:
        pass

    thing = Thing()
    gone = weakref.ref(thing)
    gc.disable()
    try:
        with contextlib.suppress(TypeError):
            SpatialInertia(thing, wrong=1)
        del thing
        assert gone() is None
    finally:
        gc.enable()
