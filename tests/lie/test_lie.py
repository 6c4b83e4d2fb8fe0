"""Rotations, rigid motions and their adjoints: the laws of the book, and 50-digit arithmetic at every angle.

Tolerances are in units of eps times the size of what is compared. Entries of a rotation are made of some ten operations on
numbers up to 1, and of a pose with numbers up to |p|; products of two or three of them multiply that. 30 eps covers these
and would not cover a cancellation, whose error grows with the inverse of the angle.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import twistwrench as tw
from twistwrench.mechanics.lie import quaternion, se3, series, so3
from twistwrench.mechanics.lie.adjoint import Ad, ad

EPS = np.finfo(float).eps
ROUNDING = 30 * EPS
SWITCHES = (0.6, 1.0, 2.0, series.SWITCH)  # 2.0 for half angles of 1
ACROSS = [np.nextafter(s, side) for s in SWITCHES for side in (0.0, 9.0)]
ANGLES = [0.0, 1e-300, 1e-160, 1e-20, 1e-9, 1e-7, 1e-4, 0.01, 0.3, *ACROSS, 1.5, 2.5, 3.0, np.pi - 1e-3, np.pi - 1e-7]
AXES = [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, -0.48, 0.64), (-0.28, 0.96, 1e-9), (1e-5, 1e-5, -1)]
BATCHES = [(), (1,), (4,), (2, 3), (0, 2)]

rotations = pytest.mark.parametrize("axis", AXES, ids=str)
angles = pytest.mark.parametrize("angle", ANGLES, ids=lambda a: f"{a:.17g}")


def along(axis, angle) -> np.ndarray:
    axis = np.array(axis, float)
    return axis / np.linalg.norm(axis) * angle


def exact_exp(X: np.ndarray) -> np.ndarray:
    with mpmath.workdps(50):
        return np.array(mpmath.expm(mpmath.matrix(X.tolist())).tolist(), float)


def random_twists(*shape) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(*shape, 6))


def difference(a, b) -> float:
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b)), initial=0.0))


# ── the quotients, where small angles are decided ──

QUOTIENTS = {
    "sinc": (series.sinc, lambda t: mpmath.sin(t) / t),
    "one_minus_cos_over_square": (series.one_minus_cos_over_square, lambda t: (1 - mpmath.cos(t)) / t**2),
    "theta_minus_sin_over_cube": (series.theta_minus_sin_over_cube, lambda t: (t - mpmath.sin(t)) / t**3),
    "cot_term": (series.cot_term, lambda t: (1 - t / 2 * mpmath.cot(t / 2)) / t**2),
}


@pytest.mark.parametrize("name", QUOTIENTS)
@angles
def test_quotients_against_50_digits(name, angle):
    ours, exact = QUOTIENTS[name]
    t = max(angle, 1e-30)  # the limit at 0, to 60 digits
    with mpmath.workdps(250):
        expected = float(exact(mpmath.mpf(t)))
    # Relative, with no slack for size: the closed forms lose at most the factor 1/(1 - sin 1) ≈ 6.3 at their switch.
    assert abs(float(ours(np.array(angle))) - expected) <= 10 * EPS * expected


# ── exp and log ──


@rotations
@angles
def test_exp_of_a_rotation_against_50_digits(axis, angle):
    w = along(axis, angle)
    assert difference(so3.exp(w), exact_exp(so3.hat(w))) <= ROUNDING


@rotations
@angles
def test_exp_of_a_twist_against_50_digits(axis, angle):
    V = np.concatenate([along(axis, angle), [0.3, -2.0, 0.7]])
    assert difference(se3.exp(V), exact_exp(se3.hat(V))) <= 2 * ROUNDING  # |p| is 2


@rotations
@angles
def test_exp_agrees_with_scipy(axis, angle):
    V = np.concatenate([along(axis, angle), [0.3, -2.0, 0.7]])
    # Scaling and squaring doubles its error at each of the log2(angle) + 3 squarings.
    assert difference(se3.exp(V), expm(se3.hat(V))) <= 40 * ROUNDING
    assert difference(so3.exp(V[:3]), Rotation.from_rotvec(V[:3]).as_matrix()) <= ROUNDING


@rotations
@angles
def test_log_undoes_exp(axis, angle):
    # Below π - 1e-3 log is unique and well conditioned; nearer, the sign is the axis's until rounding crosses π.
    V = np.concatenate([along(axis, angle), [0.3, -2.0, 0.7]])
    T = se3.exp(V)
    assert difference(so3.log(T[:3, :3]), V[:3]) <= ROUNDING
    # The inverse left Jacobian multiplies p by up to (π/2) / sin(π/2), and w enters it squared.
    assert difference(se3.log(T), V) <= 10 * ROUNDING


@rotations
@angles
def test_log_agrees_with_scipy(axis, angle):
    R = exact_exp(so3.hat(along(axis, angle)))
    assert difference(so3.log(R), Rotation.from_matrix(R).as_rotvec()) <= ROUNDING


@rotations
def test_at_pi_the_log_is_one_of_the_two(axis):
    w = along(axis, np.pi)
    found = so3.log(so3.exp(w))
    assert min(difference(found, w), difference(found, -w)) <= ROUNDING
    assert np.linalg.norm(found) <= np.pi * (1 + EPS)


@pytest.mark.parametrize("angle", [3.3, 5.0, 2 * np.pi - 1e-6, 40.0])
def test_log_takes_the_short_way(angle):
    turned = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
    w = along((0.6, -0.48, 0.64), 1.0)
    assert difference(so3.log(so3.exp(angle * w)), turned * w) <= ROUNDING * angle


def test_one_parameter_group():
    V = random_twists(20)
    s, t = 0.3, 0.45
    # Positions are of size |V| ≲ 4.
    assert difference(se3.exp(s * V) @ se3.exp(t * V), se3.exp((s + t) * V)) <= 4 * ROUNDING
    assert difference(se3.exp(-V), se3.inverse(se3.exp(V))) <= 4 * ROUNDING


@angles
def test_left_jacobians_are_inverse_and_the_derivative_of_exp(angle):
    w = along((0.6, -0.48, 0.64), angle)
    J = so3.left_jacobian(w)
    assert difference(J @ so3.left_jacobian_inverse(w), np.eye(3)) <= ROUNDING
    # J_l(w) = ∫₀¹ exp(s w) ds: Gauss–Legendre with 20 nodes is exact to 1e-30 for |w| ≤ π.
    nodes, weights = np.polynomial.legendre.leggauss(20)
    integral = np.einsum("n,nij->ij", weights / 2, so3.exp((nodes[:, None] + 1) / 2 * w))
    assert difference(J, integral) <= ROUNDING


# ── quaternions ──


@rotations
@angles
def test_quaternions_are_the_same_rotations(axis, angle):
    w = along(axis, angle)
    quat, R = quaternion.exp(w), so3.exp(w)
    assert abs(np.linalg.norm(quat) - 1) <= 4 * EPS
    assert difference(quaternion.rotation(-3.0 * quat), R) <= ROUNDING
    assert difference(quaternion.from_matrix(R), quat) <= ROUNDING
    assert difference(quaternion.log(5.0 * quat), w) <= ROUNDING
    assert difference(quaternion.rotation(quaternion.multiply(quat, quat)), R @ R) <= 2 * ROUNDING


# ── adjoints ──


def test_adjoint_matrices_are_the_book_s():
    V, W = random_twists(2)
    T = se3.exp(V)
    R, p, zero = T[:3, :3], T[:3, 3], np.zeros((3, 3))
    assert difference(Ad(T).matrix, np.block([[R, zero], [so3.hat(p) @ R, R]])) <= ROUNDING
    assert np.array_equal(Ad(T).T.matrix, np.asarray(Ad(T).T))
    assert difference(Ad(T).T.matrix, Ad(T).matrix.T) <= ROUNDING
    w, v = so3.hat(W[:3]), so3.hat(W[3:])
    assert difference(ad(W).matrix, np.block([[w, zero], [v, w]])) == 0.0
    assert difference(ad(W).T.matrix, ad(W).matrix.T) == 0.0


@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_adjoint_laws_on_batches(batch):
    V1, V2, F = random_twists(3, *batch)
    T1, T2 = se3.exp(V1), se3.exp(V2)
    A = Ad(T1)
    large = 10 * ROUNDING  # of numbers up to |p| |V| ≈ 10
    assert difference(A @ V2, np.einsum("...ij,...j->...i", A.matrix, V2)) <= large
    assert difference(Ad(T1 @ T2) @ F, A @ (Ad(T2) @ F)) <= 10 * large
    assert difference(Ad(se3.inverse(T1)) @ (A @ V2), V2) <= 10 * large
    assert difference(se3.hat(A @ V2), T1 @ se3.hat(V2) @ se3.inverse(T1)) <= 10 * large  # MR definition 3.20
    bracket = se3.hat(V1) @ se3.hat(V2) - se3.hat(V2) @ se3.hat(V1)
    assert difference(se3.hat(ad(V1) @ V2), bracket) <= large
    assert difference(ad(V1) @ V2, -(ad(V2) @ V1)) == 0.0
    assert difference(ad(V1) @ V1, 0.0) <= large
    jacobi = ad(V1) @ (ad(V2) @ F) + ad(V2) @ (ad(F) @ V1) + ad(F) @ (ad(V1) @ V2)
    assert difference(jacobi, 0.0) <= 10 * large
    assert difference(A @ (ad(V1) @ V2), ad(A @ V1) @ (A @ V2)) <= 100 * large


@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_power_does_not_depend_on_the_frame(batch):
    V_b, F_a, X = random_twists(3, *batch)
    T_ab = se3.exp(X)
    there, here = np.sum((Ad(T_ab) @ V_b) * F_a, axis=-1), np.sum(V_b * (Ad(T_ab).T @ F_a), axis=-1)
    assert difference(there, here) <= 100 * ROUNDING  # sums of six terms up to 30
    lie = np.sum((ad(X) @ V_b) * F_a, axis=-1) - np.sum(V_b * (ad(X).T @ F_a), axis=-1)
    assert difference(lie, 0.0) <= 100 * ROUNDING


def test_exp_of_ad_is_ad_of_exp():
    for V in random_twists(10):
        assert difference(Ad(se3.exp(V)).matrix, exact_exp(ad(V).matrix)) <= 10 * ROUNDING  # entries up to |p|


def test_operators_broadcast_and_refuse_the_wrong_side():
    T = se3.exp(random_twists(5, 1))
    V = random_twists(4)
    assert (Ad(T) @ V).shape == (5, 4, 6)
    assert np.array_equal((Ad(T) @ V)[3, 2], Ad(T[3, 0]) @ V[2])
    with pytest.raises(tw.ShapeError, match="stands to its right"):
        V @ Ad(T)


# ── shapes ──


@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_any_leading_shape(batch):
    V = random_twists(*batch)
    w, T = V[..., :3], se3.exp(V)
    R = T[..., :3, :3]
    singles = {
        "so3.hat": (so3.hat, w), "so3.exp": (so3.exp, w), "so3.log": (so3.log, R), "left": (so3.left_jacobian, w),
        "inverse left": (so3.left_jacobian_inverse, w), "se3.hat": (se3.hat, V), "se3.exp": (se3.exp, V),
        "se3.log": (se3.log, T), "inverse": (se3.inverse, T), "from_matrix": (quaternion.from_matrix, R),
    }  # fmt: skip
    for name, (function, x) in singles.items():
        whole, core = function(x), x.ndim - len(batch)
        for k in np.ndindex(*batch):
            assert difference(whole[k], function(x[k])) <= 2 * ROUNDING, name  # NumPy may sum a batch in another order
        assert whole.shape[: len(batch)] == batch, (name, core)
    assert np.array_equal(so3.vee(so3.hat(w)), w)
    assert np.array_equal(se3.vee(se3.hat(V)), V)


def test_cross_is_numpy_s():
    a, b = np.random.default_rng(5).normal(size=(2, 4, 3))
    assert np.array_equal(so3.cross(a, b), np.cross(a, b))
    assert (
        np.array_equal(so3.cross(a, b), (so3.hat(a) @ b[..., None])[..., 0])
        or difference(so3.cross(a, b), (so3.hat(a) @ b[..., None])[..., 0]) <= ROUNDING
    )


def test_the_books_product_needs_brackets_and_a_matrix_is_not_six_vectors():
    """``ad(V).T @ G @ V`` is read from the left; as rows of G it would lose the whole velocity term."""
    V, G = random_twists(3)[0], np.diag([0.05, 0.1, 0.13, 12.0, 12.0, 12.0])
    T, J = se3.exp(random_twists(3)[1]), random_twists(7).T
    with pytest.warns(tw.ShapeWarning, match=r"ad\(…\)\.T @ x takes the rows .* A @ \(G @ V\)"):
        ad(V).T @ G
    with pytest.raises(tw.ShapeError, match=r"shape \(6, 7\).*Ad\(…\)\.matrix @ x"):
        Ad(T) @ J
    with pytest.raises(tw.ShapeError, match=r"x @ Ad\(…\)\.matrix"):
        G @ Ad(T)
    with pytest.raises(tw.ShapeError, match=r"@ \(G @ V\)"):
        ad(V).T @ tw.SpatialInertia.from_com(1.0) @ V
    assert difference(ad(V).T @ (G @ V), ad(V).matrix.T @ G @ V) <= 100 * ROUNDING
    assert difference(Ad(T).matrix @ J, Ad(T).apply(J.T).T) <= 100 * ROUNDING


def test_six_labelled_vectors_are_a_batch():
    """Labels tell twists from matrices, so that six of them are taken as any other number of them."""
    T, V = tw.Pose(se3.exp(random_twists(1)[0]), to="a", of="b"), random_twists(6)
    assert difference((T @ tw.Twist(V, "b")).values, Ad(T.matrix).apply(V)) == 0.0
