"""Rotations, rigid motions, screws and labelled vectors: complete answers on record."""

from __future__ import annotations

import copy
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
import sympy
from recorded_answers import Records, refusal
from recorded_robots import flat

import twistwrench as tw
from twistwrench.mechanics.lie import (
    adjoint,
    axis,
    compiled_forms,
    half_angles,
    identity,
    labelled,
    quaternion,
    se3,
    series,
    so3,
)
from twistwrench.mechanics.lie.twist_wrench import Pose, Twist, Wrench, move_covariance

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

w = np.array([0.31, -0.52, 0.87])
W3 = np.array([[0.31, -0.52, 0.87], [1.9, 0.4, -0.7], [-2.1, 1.3, 1.7], [1e-9, -3e-9, 2e-9], [0.0, 0.0, 0.0]])
V = np.array([0.31, -0.52, 0.87, 1.4, -2.3, 0.6])
V3 = np.concatenate(
    [W3, [[1.4, -2.3, 0.6], [0.2, 3.1, -1.1], [-0.4, 0.9, 2.2], [1.3, 0.7, -0.8], [0.5, -1.5, 2.5]]], axis=1
)
T_ab = se3._exp(V)
T3 = se3._exp(V3)
F = np.array([0.7, -1.9, 2.3, -4.1, 0.9, 3.3])


@pytest.fixture(scope="module", autouse=True)
def not_compiled():
    """The NumPy formulas of exp and log, whatever other tests have compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_forms, "compiler", None)
        yield


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


def caught(call):
    """Result and texts of warnings."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result = call()
    texts = [f"{x.category.__name__}: {x.message}" for x in found]
    return {"result": result, "warnings": texts, "where": {Path(x.filename).name for x in found}}


@records.of
def matrices_of_vectors_and_back():
    return {
        name: {
            "one": module.hat(x),
            "many": module.hat(xs),
            "back": module.vee(module.hat(x)),
            "many back": module.vee(module.hat(xs)),
        }
        for name, module, x, xs in (("so3", so3, w, W3), ("se3", se3, V, V3))
    } | {
        "vee of a matrix that is not skew": so3.vee(np.arange(9.0).reshape(3, 3)),
        "vee of two": so3.vee(np.arange(18.0).reshape(2, 3, 3)),
        "vee of se3": se3.vee(np.arange(16.0).reshape(4, 4)),
        "vees of se3": se3.vee(np.arange(32.0).reshape(2, 4, 4)),
        "of symbols": str(se3.hat(np.array(sympy.symbols("a b c d e f"))).tolist()),
        "of float32": str(so3.hat(w.astype(np.float32)).dtype),
    }


@records.of
def cross_products_of_all_shapes():
    a, b = w, np.array([1.7, 0.3, -2.9])
    return {
        "one": so3.cross(a, b),
        "float32 and float64": so3.cross(a.astype(np.float32), np.array([1.75, 0.5, -2.5])),
        "one and many": so3.cross(a, W3),
        "many and one": so3.cross(W3, b),
        "column and row": so3.cross(W3[:, None], W3[None, :2]),
        "not fitting": tried(lambda: so3.cross(W3, W3[:2])),
        "short": tried(lambda: so3.cross(a, [1, 2])),
    }


@records.of
def exponentials_and_logarithms():
    angles = (0.0, 1e-12, 1e-4, 0.4, 1.0, 1.7, 2.4999, 2.5, 2.5001, 3.0, 3.141592, np.pi, 3.2, 5.9, 6.9, 40.0)
    unit = np.array([2.0, -3.0, 6.0]) / 7.0
    v = np.array([1.4, -2.3, 0.6])
    answers = {}
    for angle in angles:
        twist = np.concatenate([angle * unit, v])
        R, T = so3.exp(angle * unit), se3.exp(twist)
        answers[str(angle)] = flat(
            {
                "R": R[0],
                "p": T[:3, 3],
                "log R": so3.log(R),
                "log T": se3.log(T),
                "J": so3.left_jacobian(angle * unit)[1],
                "J inverse": so3.left_jacobian_inverse(angle * unit)[1],
                "J6": se3.left_jacobian(twist)[3:, :3],
                "J6 inverse": se3.left_jacobian_inverse(twist)[3:, :3],
            }
        )
    answers["blocks"] = se3.left_jacobian(V)
    answers["blocks of the inverse"] = se3.left_jacobian_inverse(V)
    answers["many"] = [
        se3.exp(V3),
        so3.exp(W3),
        so3.log(so3.exp(W3)),
        se3.log(T3),
        se3.left_jacobian(V3),
        so3.left_jacobian(W3),
    ]
    answers["many inverses"] = [se3.left_jacobian_inverse(V3), so3.left_jacobian_inverse(W3)]
    answers["not finite"] = [
        so3.exp([np.nan, 1.0, 2.0]),
        so3.log(np.full((3, 3), np.nan)),
        so3.left_jacobian([np.inf, 1, 0]),
    ]
    return answers


@records.of
def rotations_by_half_a_turn_and_almost():
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, -0.8, 0], [0, -0.6, 0.8], [-2 / 3, 1 / 3, 2 / 3]])
    answers = {}
    for angle in (np.pi, np.pi - 1e-5, np.pi + 1e-5, 2.2):
        R = so3.exp(angle * axes)
        answers[f"{angle:.6f}"] = flat(so3.log(R), quaternion.from_matrix(R), [so3.log(one) for one in R])
    return answers


@records.of
def largest_angles_that_are_computed():
    return {
        "within reach": [
            series.within_reach(np.array(x)) for x in ([3e80, -4e80, 0.0], [3e60, -4e60, 0.0], [-3e80, -4e80, -1e79])
        ],
        "within reach, many": series.within_reach(np.array([[3e80, -4e80, 0.0], [0.3, 0.4, 1.2], [np.nan, 1, 1]])),
        "left jacobian": so3.left_jacobian([3e80, -4e80, 0.0]),
    }


@records.of
def series_on_both_sides_of_the_switch():
    theta = np.array([0.0, 1e-8, 0.3, 1.2, 2.49, 2.5, 2.51, 3.1, 4.7, 6.0])
    functions = (
        series.sinc,
        series.one_minus_cos_over_square,
        series.theta_minus_sin_over_cube,
        series.cot_term,
        series.one_minus_cos_slope,
        series.theta_minus_sin_slope,
        series.cot_slope,
    )
    answers = {}
    for function in functions:
        with np.errstate(all="ignore"):
            answers[function.__name__] = flat(function(theta), function(theta[:4]), function(theta[6:]), function(1.3))
    answers["coefficients"] = [series.cot_coefficients(6), series._slope_coefficients((2.0, 3.0, 5.0, 7.0))]
    a, b, da, db = (np.array([x, 2 * x - 1]) for x in (0.7, -0.4, 0.3, 1.1))
    answers["quadratic"] = series.quadratic(W3[:2], a, b, 0.5)
    answers["slope"] = series.slope(W3[:2], W3[1:3], a, b, da, db)
    answers["slope of one"] = series.slope(W3[0], W3[1], a[0], b[0], da[0], db[0])
    return answers


@records.of
def functions_of_half_angles():
    squares = (0.0, 1e-6, 0.5, 0.999, 1.0, 1.001, 3.0, 9.0, 39.0, 1000.0, 2.0**31)
    return {
        "half angle": {str(x): tuple(half_angles.half_angle(np.float64(x))) for x in squares},
        "half turn": [half_angles.half_turn(np.cos(x), np.sin(x) ** 2) for x in (0.0, 0.3, 1.1, 1.5, 1.57)],
        "cotangent quotient": [half_angles.cotangent_quotient(x) for x in (0.0, 0.25, 2.0, 9.5)],
        "short way": [half_angles.short_way(x) for x in (-0.3, 0.0, 0.4)],
        "far": tuple(half_angles.half_angle(4.5 * half_angles.LARGEST_HALF_TURN**2)),
    }


@records.of
def branch_free_forms():
    answers = {}
    for k, twist in enumerate(
        [*V3, -V, [3.0, -0.6, 0.4, 0.2, 0.7, -1.6], [0.4, 3.05, -0.3, 1, 2, 3], [-0.2, 0.3, 3.1, 3, 2, 1]]
    ):
        twist = np.asarray(twist)
        R, square = se3.rotation_exp(twist[:3])
        T, _ = se3.pose_exp(twist)
        answers[str(k)] = flat(R[0], square, T[:3, 3], se3.rotation_log(R), se3.pose_log(T))
    bad = T_ab.copy()
    bad[0, 1] += 0.03
    bad[3] = [0.01, 0.02, -0.03, 1.04]
    answers["deviations"] = [se3.rotation_log(bad[:3, :3]), se3.pose_log(bad)]
    answers["slide"] = se3.slide(w, W3[1], 0.3, -0.7)
    return answers


@records.of
def compiled_forms_and_their_limits():
    reach = compiled_forms.REACH

    def formulas(x):
        return 100.0 + x

    def kernel(x):
        return x + 1.0, np.asarray(x)[..., 0]

    answers = {"none": compiled_forms.exponential("pose_exp", w, formulas)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_forms, "compiler", lambda name: kernel if name == "known" else None)
        for first in (0.5 * reach, reach, 2.0 * reach):
            x = np.array([first, 2.0, 3.0])
            answers[f"one {first:.3g}"] = compiled_forms.exponential("known", x, formulas) - first
        rows = np.array([[0.5 * reach, 1.0, 2.0], [reach, 3.0, 4.0], [2.0 * reach, 5.0, 6.0]])
        answers["many"] = compiled_forms.exponential("known", rows, formulas) - rows
        answers["unknown"] = compiled_forms.exponential("other", w, formulas)
        sure = (0.2 * 1e-6) ** 2
        for share in (0.5, 1.0, 2.0):
            checked = []
            x = np.full((3, 3), share * sure)

            def log_kernel(x):
                return "result", x[..., 0, 0]

            patch.setattr(compiled_forms, "compiler", lambda name, k=log_kernel: k)
            found = compiled_forms.logarithm("any", x, lambda x, c=checked: c.append(x.ndim), formulas)
            compiled_forms.logarithm(
                "any", np.stack([np.zeros((3, 3)), x]), lambda x, c=checked: c.append(x.ndim), formulas
            )
            answers[f"logarithm {share}"] = [found, checked]
    answers["logarithm, not compiled"] = compiled_forms.logarithm("any", w, lambda x: 2.0 * x, formulas)
    return answers


@records.of
def poses_and_their_inverses():
    R, p = T_ab[:3, :3], T_ab[:3, 3]
    return {
        "pose": se3.pose(R, p),
        "one rotation, many positions": se3.pose(R, W3),
        "many rotations, one position": se3.pose(so3.exp(W3), p),
        "grid": se3.pose(so3.exp(W3)[:, None], W3[:2]),
        "not fitting": tried(lambda: se3.pose(so3.exp(W3), W3[:2])),
        "inverse": se3.inverse(T_ab),
        "inverses": se3.inverse(T3),
        "not a pose": tried(lambda: se3.inverse(1.01 * T_ab)),
        "bad last row": tried(lambda: se3.log(T_ab + np.diag([0, 0, 0, 0.1]))),
        "reflection": tried(lambda: so3.log(np.diag([1.0, 1.0, -1.0]))),
        "row of a batch": tried(lambda: so3.log(np.stack([np.eye(3), 1.02 * np.eye(3)]))),
        "symbols": str(se3.pose(np.eye(3).astype(object), np.array(sympy.symbols("x y z"))).tolist()),
    }


@records.of
def projections_to_rotations_and_poses():
    noise = np.array([[0.02, -0.03, 0.01], [0.04, 0.01, -0.02], [-0.05, 0.02, 0.03]])
    M = T_ab.copy()
    M[:3, :3] += noise
    M[3] += [0.01, -0.02, 0.03, 0.04]
    mirrored = so3.exp(w) @ np.diag([1.1, 0.9, -0.6])  # with equal lengths, any axis could turn
    many = np.stack([so3.exp(w) + noise, so3.exp(W3[1]) - noise, np.full((3, 3), np.nan)])
    return {
        "rotation": so3.project(M[:3, :3]),
        "rotations": so3.project(many),
        "pose": se3.project(M),
        "of a mirrored matrix": so3.project(mirrored, within=np.inf),
        "of a mirrored matrix, refused": tried(lambda: so3.project(mirrored)),
        "within 0.03": tried(lambda: so3.project(M[:3, :3], 0.03)),
        "within 0.2": so3.project(so3.exp(w) + 3 * noise, within=0.2),
        "pose, rotation too far": tried(lambda: se3.project(M, within=0.045)),
        "pose, last row too far": tried(lambda: se3.project(M, within=0.035)),
        "infinite": tried(lambda: so3.project(np.full((3, 3), np.inf))),
        "float32": str(so3.project(M[:3, :3].astype(np.float32)).dtype),
    }


@records.of
def rotations_of_scipy():
    R = so3.exp(w)
    return {
        "as": so3.as_scipy(R).as_quat(),
        "back": so3.from_scipy(so3.as_scipy(so3.exp(W3))),
        "not a rotation": tried(lambda: so3.as_scipy(2 * R)),
        "not finite": tried(lambda: so3.as_scipy(np.full((3, 3), np.nan))),
        "another object": tried(lambda: so3.from_scipy(R)),
    }


@records.of
def quaternions():
    q = np.array([0.3, -0.5, 0.7, 0.2])
    many = np.array([[0.3, -0.5, 0.7, 0.2], [-0.9, 0.1, 0.3, -0.2], [0.0, 0.6, -0.3, 0.1], [2.0, 1e-200, -3e-200, 0.0]])
    object_q = np.array(sympy.Matrix([1, 2, 3, 4]).tolist(), object).ravel()
    return {
        "rotation": quaternion.rotation(q),
        "rotations": quaternion.rotation(many),
        "of rational numbers": str(quaternion.rotation(object_q).tolist()),
        "huge": np.isnan(quaternion.rotation(np.array([1e200, 0, 0, 1e200]))).all(),
        "product": quaternion.multiply(q, many[1]),
        "products": quaternion.multiply(many[:2], many[2]),
        "not fitting": tried(lambda: quaternion.multiply(many, many[:3])),
        "exp": quaternion.exp(w),
        "exps": quaternion.exp(W3),
        "log": quaternion.log(q),
        "logs": quaternion.log(many),
        "logs of tiny and huge": quaternion.log(np.array([[1e-300, 2e-300, 0, 0], [1e300, 0, -1e300, 0]])),
        "log of almost none": quaternion.log(np.array([[-2.0, 3e-160, 0, 0], [2.0, 3e-149, 1e-149, 0]])) * 1e150,
        "from matrix": quaternion.from_matrix(so3.exp(W3)),
        "zero": [tried(lambda: quaternion.rotation(np.zeros(4))), tried(lambda: quaternion.log(np.zeros(4)))],
        "zero in a row": [
            tried(lambda: quaternion.rotation(np.array([[1.0, 0, 0, 0], [0, 0, 0, 0]]))),
            tried(lambda: quaternion.log(np.array([[[1.0, 0, 0, 0], [0, 0, 0, 0]]]))),
        ],
        "not a rotation": tried(lambda: quaternion.from_matrix(1.1 * np.eye(3))),
        "nan": np.isnan(quaternion.log([np.nan, 1, 0, 0])).all(),
    }


@records.of
def adjoint_operators():
    answers = {}
    operators = {
        "Ad": adjoint.Ad(T_ab),
        "Ad.T": adjoint.Ad(T_ab).T,
        "Ad.inverse": adjoint.Ad(T_ab).inverse,
        "Ad.inverse.T": adjoint.Ad(T_ab).inverse.T,
        "Ad.T.inverse": adjoint.Ad(T_ab).T.inverse,
        "Ad.inverse.inverse": adjoint.Ad(T_ab).inverse.inverse,
        "Ad.T.T": adjoint.Ad(T_ab).T.T,
        "ad": adjoint.ad(V),
        "ad.T": adjoint.ad(V).T,
        "Ad of many": adjoint.Ad(T3),
        "Ad of many, inverse, T": adjoint.Ad(T3).inverse.T,
        "ad of many": adjoint.ad(V3),
        "labelled": adjoint.Ad(Pose(T_ab, "a", "b")),
        "labelled T": adjoint.Ad(Pose(T_ab, "a", "b")).T,
        "labelled inverse": adjoint.Ad(Pose(T_ab, "a", "b")).inverse,
        "labelled inverse T": adjoint.Ad(Pose(T_ab, "a", "b")).inverse.T,
        "labelled ad": adjoint.ad(Twist(V, "b")).T,
    }
    for name, operator in operators.items():
        answers[name] = [flat(operator @ F, operator.apply(V3[::-1]), operator.matrix), repr(operator), operator.frames]
    Ad = operators["Ad"]
    answers["as array"] = np.asarray(Ad, np.float32).dtype.name
    answers["six vectors"] = caught(lambda: Ad @ np.arange(36.0).reshape(6, 6))
    answers["six vectors, applied"] = caught(lambda: Ad.T.apply(np.arange(36.0).reshape(6, 6)))
    answers["six vectors for many"] = caught(lambda: adjoint.Ad(np.stack([T_ab] * 6)) @ np.arange(36.0).reshape(6, 6))
    answers["Jacobian"] = [tried(lambda: Ad @ np.zeros((6, 4))), tried(lambda: Ad.T @ np.zeros((6, 5)))]
    answers["inertia"] = tried(lambda: operators["ad.T"] @ tw.SpatialInertia.box((1, 2, 3), mass=2))
    answers["from the left"] = tried(lambda: [1.0] * 6 @ Ad)
    answers["wrench"] = tried(lambda: adjoint.ad(Wrench(F, "b")))
    answers["batches"] = tried(lambda: operators["Ad of many"] @ V3[:2])
    answers["short"] = tried(lambda: Ad @ [1, 2, 3])
    return answers


@records.of
def screw_axes():
    s, q = np.array([2.0, -3.0, 6.0]), np.array([0.4, -1.1, 0.7])
    answers = {}
    for pitch in (0.0, 0.35, -0.2, np.inf, -np.inf):
        S = axis.screw_axis(s, q, pitch)
        answers[str(pitch)] = [
            S,
            axis.wrench_along(s, q, pitch),
            axis.axis_of(2.5 * S),
            axis.line_of_action(-1.5 * axis.wrench_along(s, q, pitch)),
        ]
    answers["defaults"] = [
        axis.screw_axis(s),
        axis.wrench_along(s),
        axis.screw_axis(s, pitch=0.5),
        axis.wrench_along(s, pitch=0.5),
    ]
    answers["many"] = axis.screw_axis(W3[:3], q, [0.0, 0.5, np.inf])
    answers["axes of many"] = axis.axis_of(V3[:4])
    answers["lines of many"] = axis.line_of_action(V3[:4])
    answers["mixed"] = axis.axis_of(np.array([[0, 0, 0, 1.0, 2.0, -2.0], [1.0, 2.0, -2.0, 3.0, 0.5, 1.0]]))
    answers["reciprocal product"] = [
        axis.reciprocal_product(V, F),
        axis.reciprocal_product(V3, F),
        axis.reciprocal_product(V, V3),
    ]
    answers["refused"] = [
        tried(lambda: axis.screw_axis([0, 0, 0])),
        tried(lambda: axis.screw_axis([1, np.nan, 0])),
        tried(lambda: axis.axis_of(np.zeros(6))),
        tried(lambda: axis.line_of_action([np.nan, 0, 0, 1, 0, 0])),
        tried(lambda: axis.screw_axis(W3[:3], W3[:2])),
        tried(lambda: axis.axis_of([1, 2, 3])),
    ]
    return answers


@records.of
def kinds_of_screws():
    names = ("line", "couple", "screw", "nothing")
    x, y = np.array([1.0, 0, 0]), np.array([0.0, 2.0, 0])
    eps = float(np.finfo(float).eps)
    cases = {
        "line": (x, y),
        "couple": (0 * x, y),
        "screw": (x, x + y),
        "nothing": (0 * x, 0 * x),
        "at the origin": (3 * x, 0 * x),
        "pitch of 15 eps": (x, y + 30 * eps * x),
        "pitch of 17 eps": (x, y + 34 * eps * x),
        "negative pitch": (x, y - 0.5 * x),
    }
    answers = {name: axis.kinds(*halves, names) for name, halves in cases.items()}
    answers["many"] = axis.kinds(*map(np.array, zip(*cases.values(), strict=True)), names)
    return answers


@records.of
def labelled_twists_and_wrenches():
    Vb, Fb = Twist(V, "b"), Wrench(F, "tool0")
    V_many, F_many = Twist(V3, "b"), Wrench(np.stack([V3, -V3]), "s")
    return {
        "twist": [repr(Vb), Vb.omega, Vb.v, Vb.axis, Vb.kind, Vb.symbol, Vb.shape],
        "wrench": [repr(Fb), Fb.m, Fb.f, Fb.axis, Fb.kind, Fb.symbol, Fb.shape],
        "many": [repr(V_many), repr(F_many), V_many.kind, F_many.kind, V_many.shape, F_many.shape],
        "kinds": [
            Twist(x, "b").kind for x in ([1, 0, 0, 0, 2, 0], [0, 0, 0, 1, 0, 0], [1, 0, 0, 1, 0, 0], np.zeros(6))
        ],
        "kinds of wrenches": [
            Wrench(x, "b").kind for x in ([0, 2, 0, 1, 0, 0], [1, 0, 0, 0, 0, 0], [1, 0, 0, 1, 0, 0], np.zeros(6))
        ],
        "empty": repr(Twist(np.zeros((0, 6)), "b")),
        "symbols": repr(Twist(np.array([sympy.symbols("a b c d e f")]), "b")),
        "sums": [Vb + Vb, Vb - 3 * Vb, -Vb, Vb * 2.5, 0.5 * Vb, Vb / 4.0, sum([Vb, Vb]), 0 + Vb],
        "products with many": [
            Vb * [1.0, 2.0, -3.0],
            V_many * np.arange(5.0),
            V_many / np.arange(1.0, 6.0),
            Vb + V_many,
        ],
        "rows": [
            V_many[1],
            V_many[-2:],
            F_many[1, 2],
            F_many[0],
            [x.values for x in V_many],
            V_many[np.array([True, False, True, False, False])],
        ],
        "power": [Wrench(F, "b") @ Vb, Vb @ Wrench(F, "b"), Wrench(F, "b") @ V_many],
        "bracket": [Vb.bracket(Twist(F, "b")), V_many.bracket(Vb)],
        "of force": [
            Wrench.of_force([1, -2, 3], "s"),
            Wrench.of_force([1, -2, 3], "s", at=[0.3, 0.7, -0.2]),
            Wrench.of_force(W3, "s", at=w),
        ],
        "of couple": [Wrench.of_couple([1, -2, 3], "s"), Wrench.of_couple(W3, "s")],
        "equal": [Vb == Twist(V, "b"), Vb == Twist(V, "c"), Vb == Wrench(V, "b"), Vb == Twist(2 * V, "b"), Vb == 1],
        "hash": [
            hash(Vb) == hash(Twist(V + 0.0, "b")),
            hash(Vb) == hash(Twist(V, "c")),
            hash(Twist([0.0] * 6, "b")) == hash(Twist([-0.0] * 6, "b")),
            hash(Vb) == hash(Wrench(V, "b")),
        ],
        "copies": [
            pickle.loads(pickle.dumps(Vb)) == Vb,
            copy.deepcopy(Fb) == Fb,
            pickle.loads(pickle.dumps(Vb)).values.flags.writeable,
        ],
        "as array": [np.asarray(Vb), np.array(Fb, np.float32).dtype.name],
    }


@records.of
def reciprocity_within_a_limit():
    V_s = Twist([0, 0, 2.0, 0, 3.0, 0], "s")
    answers = {}
    for extra in (0.0, 1e-12, 0.01, 0.02):
        F_s = Wrench([0.5, 0, extra, 0, 0, 4.0], "s")
        answers[str(extra)] = [
            F_s.is_reciprocal_to(V_s),
            F_s.is_reciprocal_to(V_s, within=1.1e-3),
            F_s.is_reciprocal_to(-V_s, 2e-3),
        ]
    answers["many"] = Wrench(V3, "s").is_reciprocal_to(V_s, 0.1)
    many = Twist(np.array([[0, 0, 2.0, 0, 3.0, 0], [0, 0, 200.0, 0, 300.0, 0], [0, 1.0, 0, 0, 0, 5.0]]), "s")
    answers["twists of different sizes"] = [
        Wrench([0, 0.3, 0.02, 0, 0, 4.0], "s").is_reciprocal_to(many, within) for within in (1e-3, 6e-3, 0.1, 2.0)
    ]
    answers["power, not lever"] = [
        Wrench([0, 0, 3.0, 0, -2.0, 0], "s").is_reciprocal_to(V_s),
        Wrench([0, 0, 3.0, 0, 2.0, 0], "s").is_reciprocal_to(V_s),
    ]
    return answers


@records.of
def labelled_poses():
    T = Pose(T_ab, "a", "b")
    many = Pose(T3, "base", "tool0")
    return {
        "texts": [
            repr(T),
            repr(many),
            repr(Pose(np.eye(4), "a", "b")),
            repr(Pose(se3.exp([0, 0, 5e-13, 1, 2, 3]), "a", "b")),
            repr(Pose(se3.exp([0, 0, 5e-12, 1, 2, 3]), "a", "b")),
        ],
        "symbols": repr(Pose(np.array(sympy.eye(4).tolist(), object), "a", "b")),
        "parts": [T.symbol, T.rotation, T.position, T.inverse.matrix, T.inverse.symbol, many.symbol, many.position],
        "products": [
            T @ Pose(T3[1], "b", "c"),
            T @ Twist(V, "b"),
            T @ Wrench(F, "b"),
            T.inverse @ Wrench(F, "a"),
            many @ Twist(F, "tool0"),
        ],
        "operators": [
            adjoint.Ad(T) @ Twist(F, "b"),
            adjoint.Ad(T).T @ Wrench(F, "a"),
            adjoint.ad(Twist(V, "b")).T @ Wrench(F, "b"),
            adjoint.Ad(T).inverse @ Twist(F, "a"),
        ],
        "equal": [
            Pose(T_ab, "a", "b") == T,
            Pose(T_ab, "a", "c") == T,
            Pose(T_ab, "c", "b") == T,
            Pose(T3[1], "a", "b") == T,
            T == 3,
        ],
        "hash": [hash(T) == hash(Pose(T_ab, "a", "b")), hash(T) == hash(Pose(T_ab, "b", "a"))],
        "copies": [pickle.loads(pickle.dumps(T)) == T, pickle.loads(pickle.dumps(T)).matrix.flags.writeable],
        "as array": np.asarray(T),
    }


@records.of
def mistakes_with_labels():
    Vb, Fb, T = Twist(V, "b"), Wrench(F, "b"), Pose(T_ab, "a", "b")
    calls = {
        "no name": lambda: Twist(V, ""),
        "number as name": lambda: Wrench(F, 3),
        "pose to": lambda: Pose(T_ab, "", "b"),
        "pose of": lambda: Pose(T_ab, "a", None),
        "twist of a twist": lambda: Twist(Vb, "c"),
        "wrench of a twist": lambda: Wrench(Vb, "b"),
        "pose of a pose": lambda: Pose(T, "a", "c"),
        "not finite": lambda: Twist([np.nan, 0, 0, 0, 0, 0], "b"),
        "short": lambda: Twist([1, 2], "b"),
        "not a pose": lambda: Pose(2 * T_ab, "a", "b"),
        "plus numbers": lambda: Vb + V,
        "plus one": lambda: Vb + 1,
        "minus numbers": lambda: Fb - F,
        "twist plus wrench": lambda: Vb + Fb,
        "wrench minus twist": lambda: Fb - Vb,
        "other frame": lambda: Vb + Twist(V, "tool0"),
        "twist times twist": lambda: Vb * Vb,
        "wrench times twist": lambda: Fb * Vb,
        "power of two twists": lambda: Vb @ Vb,
        "power with numbers": lambda: Fb @ V,
        "power in other frames": lambda: Fb @ Twist(V, "c"),
        "divided by zero": lambda: Vb / 0.0,
        "array times twist": lambda: np.eye(6) @ Vb,
        "array times pose": lambda: np.eye(4) @ T,
        "list times pose": lambda: [1] @ T,
        "list times twist": lambda: [1] @ Vb,
        "Ad of numbers": lambda: adjoint.Ad(T_ab) @ Vb,
        "Ad of another frame": lambda: adjoint.Ad(T) @ Twist(V, "c"),
        "Ad on a wrench": lambda: adjoint.Ad(T) @ Fb,
        "Ad.T on a twist": lambda: adjoint.Ad(T).T @ Vb,
        "ad.T on a twist": lambda: adjoint.ad(Vb).T @ Vb,
        "pose times numbers": lambda: T @ V,
        "pose times other frame": lambda: T @ Twist(V, "a"),
        "pose times pose": lambda: T @ T,
        "batches of poses": lambda: Pose(T3, "a", "b") @ Pose(T3[:2], "b", "c"),
        "batches of twists": lambda: Twist(V3, "b") + Twist(V3[:2], "b"),
        "bracket with a wrench": lambda: Vb.bracket(Fb),
        "bracket in other frames": lambda: Vb.bracket(Twist(V, "c")),
        "no rows": lambda: iter(Vb),
        "no such row": lambda: Twist(V3, "b")[7],
        "row of one": lambda: Vb[0],
        "covariances": lambda: move_covariance(T3, np.zeros((2, 6, 6))),
    }
    return {name: tried(call) for name, call in calls.items()}


@records.of
def covariances_of_wrenches():
    A = np.sin(np.arange(36.0)).reshape(6, 6)
    C = A @ A.T
    return {
        "numbers": move_covariance(T_ab, C),
        "labelled": move_covariance(Pose(T_ab, "a", "b"), C),
        "many": move_covariance(T3, C),
    }


@records.of
def names_and_identities():
    T = T_ab
    return {
        "symbols": [
            labelled.symbol("T", "a", "b"),
            labelled.symbol("T", "a", "tool0"),
            labelled.symbol("V", "s"),
            labelled.missing_pose("b", "tool0"),
        ],
        "hash of symbols": labelled.hash_of(np.array([sympy.Symbol("a")], object), "n")
        == labelled.hash_of(np.array([sympy.Symbol("a")], object), "n"),
        "names": [labelled.TWIST, labelled.WRENCH],
        "identity": [identity.is_identity(identity.IDENTITY), identity.is_identity(np.eye(4)), identity.is_identity(T)],
        "products": [
            identity.product(identity.IDENTITY, T) is T,
            identity.product(T, identity.IDENTITY) is T,
            identity.product(T, T3[1]),
        ],
        "rows": identity.pose_rows(so3.exp(w), [1.5, 2.5, 3.5]),
        "read only": identity.IDENTITY.flags.writeable,
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
