"""exp, log and the left Jacobians of SO(3) and SE(3) against 50-digit arithmetic, at every angle, and what they refuse.

The bounds are absolute errors of single entries, for |v| = 1. Up to π all of exp and the Jacobians stay under 1e-15; beyond,
the rounding of the angle itself is added, eps |w| / 2, and the inverse Jacobians grow as |w| nears 2π.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import twistwrench as tw
from twistwrench.mechanics.lie import quaternion, se3, series, so3
from twistwrench.mechanics.lie.adjoint import Ad, ad

EPS = np.finfo(float).eps
FEW = 1e-15  # 4.5 eps: about a dozen roundings of numbers up to 1
ANGLES = [
    *(0.0, 1e-300, 1e-160, 1e-20, 1e-9, 1e-7, 1e-5, 1e-3, 0.03, 0.3, 0.6, 1.0, 2.0),
    *(np.nextafter(series.SWITCH, 0.0), series.SWITCH, np.nextafter(series.SWITCH, 9.0), 2.9),
    *(np.pi - 1e-3, np.pi - 1e-7, np.nextafter(np.pi, 0.0), np.pi, np.nextafter(np.pi, 4.0)),
]
BEYOND = [np.pi + 1e-7, 3.3, 4.0, 5.0, 6.0, 7.0, 12.0, 40.0]
AXES = [(0, -1, 0), (0.6, -0.48, 0.64), (1e-5, 1e-5, -1)]
VELOCITIES = [(0.0, 0.0, 1.0), (0.48, 0.6, 0.64), (0.28, -0.96, 0.0)]  # across the axis, skew, and across again

every_axis = pytest.mark.parametrize("axis", AXES, ids=str)
every_angle = pytest.mark.parametrize("angle", ANGLES, ids=lambda a: f"{a:.17g}")
angles_beyond = pytest.mark.parametrize("angle", BEYOND, ids=lambda a: f"{a:.17g}")


def twist(axis, angle) -> np.ndarray:
    w = np.array(axis, float) / np.linalg.norm(axis) * angle
    return np.concatenate([w, VELOCITIES[AXES.index(axis)]])


def power_series(A, shift: int):
    """Σ Aᵏ / (k + shift)! in 50 digits: the exponential with shift 0, the left Jacobian of the group with shift 1."""
    A = mpmath.matrix(A.tolist())
    term = total = mpmath.eye(A.rows) / mpmath.factorial(shift)
    k = 0
    while mpmath.mnorm(term, 1) > 1e-50:
        k += 1
        term = term * A / (k + shift)
        total = total + term
    return total


def worst(ours: np.ndarray, exact) -> float:
    return max(abs(float(mpmath.mpf(float(x)) - y)) for x, y in zip(ours.ravel(), exact, strict=True))


@pytest.fixture(autouse=True)
def fifty_digits():
    with mpmath.workdps(70):  # 50 and what 40 radians cost
        yield


@every_axis
@every_angle
def test_exp_is_right_to_a_few_ulp(axis, angle):
    V = twist(axis, angle)
    assert worst(so3.exp(V[:3]), power_series(so3.hat(V[:3]), 0)) <= FEW
    assert worst(se3.exp(V), power_series(se3.hat(V), 0)) <= FEW


@every_axis
@every_angle
def test_left_jacobians_are_right_to_a_few_ulp(axis, angle):
    V = twist(axis, angle)
    J, J6 = power_series(so3.hat(V[:3]), 1), power_series(ad(V).matrix, 1)
    assert worst(so3.left_jacobian(V[:3]), J) <= FEW
    assert worst(se3.left_jacobian(V), J6) <= FEW
    assert worst(so3.left_jacobian_inverse(V[:3]), J**-1) <= FEW
    assert worst(se3.left_jacobian_inverse(V), J6**-1) <= FEW


@every_axis
@angles_beyond
def test_beyond_pi_only_the_rounding_of_the_angle_is_added(axis, angle):
    bound = FEW + EPS * angle
    V = twist(axis, angle)
    J6 = power_series(ad(V).matrix, 1)
    inverse = J6**-1
    assert worst(so3.exp(V[:3]), power_series(so3.hat(V[:3]), 0)) <= bound
    assert worst(se3.exp(V), power_series(se3.hat(V), 0)) <= bound
    assert worst(se3.left_jacobian(V), J6) <= bound
    condition = float(mpmath.mnorm(inverse, 1)) ** 2  # how fast the inverse changes with the angle
    assert worst(se3.left_jacobian_inverse(V), inverse) <= bound * condition


@every_axis
@every_angle
def test_log_is_right_to_a_few_ulp(axis, angle):
    V = twist(axis, angle)
    T = np.array(power_series(se3.hat(V), 0).tolist(), float)
    found = se3.log(T)
    if np.pi - angle < 1e-6:  # ±π are the same rotation, and rounding T chooses the sign
        assert np.linalg.norm(found[:3]) <= np.pi * (1 + EPS)
        assert np.abs(se3.exp(found) - T).max() <= 3 * FEW
    else:
        assert np.abs(so3.log(T[:3, :3]) - V[:3]).max() <= FEW
        assert np.abs(found - V).max() <= 3 * FEW  # an error of w meets p, and J⁻¹ grows to π/2


@pytest.mark.parametrize("name", ["one_minus_cos", "theta_minus_sin", "cot"])
def test_slopes_meet_at_the_switch(name):
    f = getattr(series, {"cot": "cot_term"}.get(name, f"{name}_over_{'square' if name[0] == 'o' else 'cube'}"))
    slope = getattr(series, f"{name}_slope")
    below, above = np.nextafter(series.SWITCH, 0), np.nextafter(series.SWITCH, 9)
    assert abs(slope(above) / slope(below) - 1) <= 60 * EPS
    for t in (0.7, 2.4, 2.6):
        h = 1e-4  # central differences: h² / 6 of the third derivative
        assert abs((f(t + h) - f(t - h)) / (2 * h) / t - slope(t)) <= 1e-9


def test_the_jacobian_is_the_derivative_of_exp():
    rng = np.random.default_rng(5)
    V, dV = rng.normal(size=(2, 50, 6))
    h = 1e-6
    step = se3.log(se3.exp(V + h * dV) @ se3.inverse(se3.exp(V))) / h
    assert np.abs(step - (se3.left_jacobian(V) @ dV[..., None])[..., 0]).max() <= 1e-4  # first order in h, |V| ≈ 3


def test_small_velocities_keep_their_relative_accuracy():
    V = np.array([0.3, -1.0, 0.4, 1e-12, -2e-12, 3e-12])
    large = V * [1, 1, 1, 1e12, 1e12, 1e12]
    for function in (se3.left_jacobian, se3.left_jacobian_inverse):
        assert np.allclose(function(V)[3:, :3] * 1e12, function(large)[3:, :3], rtol=0, atol=FEW * 10)


# ── projection, SciPy, precision ──


def test_projection_is_the_nearest_rotation():
    rng = np.random.default_rng(1)
    R = so3.exp(rng.normal(size=(30, 3)))
    M = R + 0.01 * rng.normal(size=R.shape)
    P = so3.project(M)
    assert np.abs(np.swapaxes(P, -1, -2) @ P - np.eye(3)).max() <= 4 * EPS * 3
    S = np.swapaxes(P, -1, -2) @ M  # optimal exactly when this is symmetric and positive
    assert np.abs(S - np.swapaxes(S, -1, -2)).max() <= 1e-14
    assert np.linalg.eigvalsh(S).min() > 0
    T = se3.pose(M, rng.normal(size=(30, 3)))
    assert np.array_equal(se3.project(T), se3.pose(P, T[:, :3, 3]))
    assert np.abs(so3.project(R) - R).max() <= 2 * FEW


def test_scipy_says_the_same():
    rng = np.random.default_rng(2)
    V = rng.normal(size=(7, 6))
    T = se3.exp(V)
    assert np.abs(so3.as_scipy(T[:, :3, :3]).as_rotvec() - V[:, :3]).max() <= 3 * FEW
    assert np.abs(so3.from_scipy(Rotation.from_rotvec(V[:, :3])) - T[:, :3, :3]).max() <= 3 * FEW


def test_scipy_s_rigid_transform_has_the_same_order():
    pytest.importorskip("scipy", minversion="1.16")
    from scipy.spatial.transform import RigidTransform

    V = np.random.default_rng(2).normal(size=(7, 6))
    T = se3.exp(V)
    rigid = RigidTransform.from_exp_coords(V)
    assert np.abs(se3.from_scipy(rigid) - T).max() <= 10 * FEW
    assert np.abs(se3.as_scipy(T).as_exp_coords() - V).max() <= 10 * FEW


def test_float32_stays_float32():
    V = np.array([0.1, -0.5, 2.0, 1, 2, 3], np.float32)
    T = se3.exp(V)
    assert {
        x.dtype for x in (T, se3.log(T), se3.inverse(T), se3.left_jacobian(V), so3.project(T[:3, :3]), Ad(T) @ V)
    } == {np.dtype(np.float32)}
    assert np.abs(se3.log(T) - V).max() <= 1e-5


@pytest.mark.parametrize("length", [1e5, 1e9, 1e12, 1e25, 3e38])
def test_float32_vectors_of_any_length_turn(length):
    """Where the square of w is beyond float32 too: some rotation about its axis, and a left Jacobian that keeps the axis."""
    w = np.array([0.6, 0.0, -0.8], np.float32)
    R, J = so3.exp(np.float32(length) * w), so3.left_jacobian(np.float32(length) * w)
    assert R.dtype == J.dtype == np.float32
    assert np.abs(R.T @ R - np.eye(3)).max() <= 1e-5
    assert np.abs(R @ w - w).max() <= 1e-5
    assert np.abs(J - np.outer(w, w)).max() <= 1e-4


def test_integers_are_read_as_floats():
    assert se3.exp([0, 0, 0, 1, 2, 3]).dtype == float


# ── what is refused ──

TURN = so3.exp([0.1, 0.2, 0.3])
BENT = TURN + 0.01 * np.eye(3)
MIRROR = TURN @ np.diag([1.0, 1.0, -1.0])
REFUSED = {
    "a bent matrix": (so3.log, BENT, r"R' R is 0\.0196 off the identity, allowed 1e-06; so3\.project .* nearest one\."),
    "a reflection": (so3.log, MIRROR, r"reflection: det R = -1; negate one axis"),
    "one row of a batch": (so3.log, np.stack([TURN, BENT, TURN]), r"\(row 1 of the batch\)"),
    "NaN for SciPy": (
        so3.as_scipy,
        np.where(np.eye(3), np.nan, 0.0),
        r"so3\.as_scipy: R has the entry nan at \(0, 0\)",
    ),
    "a wrong shape": (so3.log, np.eye(4), r"shape \(4, 4\), expected \(\.\.\., 3, 3\)"),
    "a bent pose": (se3.log, se3.pose(BENT, [0, 0, 0]), r"R' R is 0\.0196"),
    "a last row alone": (se3.log, np.eye(4) + 1e-3 * np.eye(4, k=-3), r"last row is 0\.001 off \(0, 0, 0, 1\)"),
    "a last row": (se3.log, np.ones((4, 4)), r"last row is 1 off \(0, 0, 0, 1\)"),
    "far from a rotation": (so3.project, 3 * TURN, r"the nearest one is 1\.\d+ away, allowed 0\.1\."),
    "a far reflection": (so3.project, MIRROR, r"not a rotation with rounding: the nearest one is \d"),
    "a singular matrix": (so3.project, np.zeros((3, 3)), r"the nearest one is 1 away"),
    "infinity": (se3.project, np.full((4, 4), np.inf), r"last row is inf off"),
    "an infinite rotation": (so3.project, np.full((3, 3), np.inf), r"the nearest one is inf away"),
    "an infinite entry": (so3.log, TURN + np.diag([0, np.inf, 0]), r"R' R is inf off the identity"),
    "ones": (Ad, np.ones((4, 4)), r"Ad: T is not a pose: its last row is 1 off \(0, 0, 0, 1\), allowed 1e-06"),
    "a bent pose for Ad": (Ad, se3.pose(BENT, [1, 2, 3]), r"Ad: T is not a rotation: R' R is 0\.0196"),
    "a mirror for Ad": (Ad, se3.pose(MIRROR, [1, 2, 3]), r"reflection: det R = -1"),
    "a bent pose to invert": (se3.inverse, np.stack([np.eye(4), se3.pose(BENT, [1, 2, 3])]), r"\(row 1 of the batch\)"),
    "a bent matrix as a quaternion": (quaternion.from_matrix, BENT, r"R' R is 0\.0196"),
    "no quaternion": (quaternion.rotation, np.zeros((2, 4)), r"quaternion\.rotation: quat is zero in row \(0,\)"),
    "the log of none": (quaternion.log, np.zeros(4), r"quaternion\.log: quat is zero, which is not a rotation"),
    "for SciPy": (so3.as_scipy, BENT, r"R' R is"),
    "a pose for SciPy": (se3.as_scipy, np.zeros((4, 4)), r"last row"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_say_how_far_off(case):
    function, matrix, message = REFUSED[case]
    with pytest.raises(tw.TwistWrenchError, match=message) as caught:
        function(matrix)
    assert isinstance(caught.value, ValueError)


def test_empty_batches_pass():
    assert so3.log(np.empty((0, 3, 3))).shape == (0, 3)
    assert se3.project(np.empty((2, 0, 4, 4))).shape == (2, 0, 4, 4)
    assert quaternion.from_matrix(np.empty((0, 3, 3))).shape == (0, 4)
    assert se3.left_jacobian(np.empty((0, 6))).shape == (0, 6, 6)


# ── compiled forms ──

COMPILED = {"so3.exp": (so3.exp, 3), "se3.exp": (se3.exp, 6), "so3.log": (so3.log, 3), "se3.log": (se3.log, 6)}


def given(name, rows):
    """What a function takes, at turns of every size, the last of no turn."""
    V = np.random.default_rng(3).normal(size=(rows, 6)) * np.linspace(1.5, 0.0, rows)[:, None]
    V = V[:, : COMPILED[name][1]]
    if name.endswith("exp"):
        return V
    return so3.exp(V) if name == "so3.log" else se3.exp(V)


@pytest.mark.parametrize("name", COMPILED)
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_a_row_has_the_same_bits_alone_and_among_others(name, kind):
    function, x = COMPILED[name][0], given(name, 30).astype(kind)
    together = function(x)
    assert together.dtype == kind
    assert np.array_equal(together, [function(row) for row in x])
    assert np.array_equal(together, function(np.asfortranarray(x)))
    assert np.array_equal(together.reshape(5, 6, *together.shape[1:]), function(x.reshape(5, 6, *x.shape[1:])))


@pytest.mark.parametrize("name", COMPILED)
def test_a_row_that_is_not_a_number_leaves_the_others(name):
    function, x = COMPILED[name][0], given(name, 5)
    clean = function(x)
    x[2].flat[:3] = np.nan
    found = function(x)
    assert np.isnan(found[2]).any()
    assert np.isnan(function(x[2])).any()
    assert np.array_equal(np.delete(found, 2, 0), np.delete(clean, 2, 0))


@pytest.mark.parametrize("name", ["so3.exp", "se3.exp"])
def test_a_row_that_turns_a_million_times_leaves_the_others(name):
    function, x = COMPILED[name][0], given(name, 5)
    clean = function(x)
    x[2] *= 1e7
    found = function(x)
    assert np.array_equal(np.delete(found, 2, 0), np.delete(clean, 2, 0))
    assert np.array_equal(found[2], function(x[2]))
    exact = Rotation.from_rotvec(x[2, :3]).as_matrix()
    assert np.abs(found[2][:3, :3] - exact).max() <= 1e7 * 10 * EPS  # the angle's own rounding


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_without_a_compiler_the_results_are_the_same(monkeypatch, kind):
    compiled = {name: function(given(name, 20).astype(kind)) for name, (function, _) in COMPILED.items()}
    monkeypatch.setattr("twistwrench.mechanics.lie.compiled_forms.compiler", lambda name: None)
    for name, (function, _) in COMPILED.items():
        found = function(given(name, 20).astype(kind))
        assert found.dtype == kind
        assert np.abs(found - compiled[name]).max() <= 25 * np.finfo(kind).eps  # entries up to 5, a few roundings each
