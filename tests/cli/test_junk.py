"""Whatever comes in at a public door of lie, screws and bodies: a result, or one error of the tree that names the argument.

Every function is called with each kind of junk in each of its places. Nothing may end in an error of NumPy or Python, and
nothing that is not an array of real numbers of the right shape may give a result.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.mechanics.lie import quaternion, se3, so3
from twistwrench.mechanics.lie.adjoint import Ad, ad
from twistwrench.mechanics.lie.axis import axis_of, line_of_action, reciprocal_product, screw_axis, wrench_along
from twistwrench.mechanics.lie.twist_wrench import move_covariance

V = np.arange(6.0)
T = se3.exp(V / 7)
R, w, quat = T[:3, :3], V[:3], np.array([1.0, 2.0, 3.0, 4.0])
BODY = tw.RigidBody(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
G = BODY.inertia
MESH = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]

ARRAYS: dict[str, tuple[Any, list[Any]]] = {
    "so3.hat": (so3.hat, [w]),
    "so3.vee": (so3.vee, [so3.hat(w)]),
    "so3.cross": (so3.cross, [w, w]),
    "so3.exp": (so3.exp, [w]),
    "so3.log": (so3.log, [R]),
    "so3.left_jacobian": (so3.left_jacobian, [w]),
    "so3.left_jacobian_inverse": (so3.left_jacobian_inverse, [w]),
    "so3.project": (so3.project, [R]),
    "so3.as_scipy": (so3.as_scipy, [R]),
    "se3.pose": (se3.pose, [R, w]),
    "se3.hat": (se3.hat, [V]),
    "se3.vee": (se3.vee, [se3.hat(V)]),
    "se3.inverse": (se3.inverse, [T]),
    "se3.exp": (se3.exp, [V]),
    "se3.log": (se3.log, [T]),
    "se3.left_jacobian": (se3.left_jacobian, [V]),
    "se3.left_jacobian_inverse": (se3.left_jacobian_inverse, [V]),
    "se3.project": (se3.project, [T]),
    "quaternion.rotation": (quaternion.rotation, [quat]),
    "quaternion.multiply": (quaternion.multiply, [quat, quat]),
    "quaternion.exp": (quaternion.exp, [w]),
    "quaternion.log": (quaternion.log, [quat]),
    "quaternion.from_matrix": (quaternion.from_matrix, [R]),
    "Ad": (lambda T, x: Ad(T) @ x, [T, V]),
    "Ad.T": (lambda T, x: Ad(T).T @ x, [T, V]),
    "ad": (lambda V, x: ad(V) @ x, [V, V]),
    "ad.T": (lambda V, x: ad(V).T @ x, [V, V]),
    "Twist": (lambda V: tw.Twist(V, "b"), [V]),
    "Wrench": (lambda F: tw.Wrench(F, "b"), [V]),
    "Pose": (lambda T: tw.Pose(T, "a", "b"), [T]),
    "of_force": (lambda f, r: tw.Wrench.of_force(f, "b", at=r), [w, w]),
    "of_couple": (lambda m: tw.Wrench.of_couple(m, "b"), [w]),
    "move_covariance": (move_covariance, [T, np.eye(6)]),
    "screw_axis": (screw_axis, [w, w]),
    "wrench_along": (wrench_along, [w, w]),
    "axis_of": (axis_of, [V]),
    "line_of_action": (line_of_action, [V]),
    "reciprocal_product": (reciprocal_product, [V, V]),
    "from_parameters": (tw.SpatialInertia.from_parameters, [G.parameters]),
    "SpatialInertia": (tw.SpatialInertia, [G.parameters]),
    "from_com": (lambda c, I: tw.SpatialInertia.from_com(1.0, c, I), [w, np.eye(3)]),
    "from_matrix": (tw.SpatialInertia.from_matrix, [G.matrix]),
    "from_pseudo_inertia": (tw.SpatialInertia.from_pseudo_inertia, [G.pseudo_inertia]),
    "from_log_cholesky": (tw.SpatialInertia.from_log_cholesky, [np.ones(10)]),
    "from_points": (tw.SpatialInertia.from_points, [np.ones(4), np.ones((4, 3))]),
    "box": (lambda size: tw.SpatialInertia.box(size, mass=1.0), [w + 1]),
    "ellipsoid": (lambda size: tw.SpatialInertia.ellipsoid(size, mass=1.0), [w + 1]),
    "mesh corners": (lambda x: tw.SpatialInertia.mesh((x, MESH[1]), mass=1.0), [np.array(MESH[0], float)]),
    "mesh faces": (lambda x: tw.SpatialInertia.mesh((MESH[0], x), mass=1.0), [np.array(MESH[1])]),
    "G.in_frame": (G.in_frame, [T]),
    "G @ V": (lambda V: G @ V, [V]),
    "wrench": (BODY.wrench, [V, V]),
    "acceleration": (BODY.acceleration, [V, V]),
    "momentum": (BODY.momentum, [V]),
    "kinetic_energy": (BODY.kinetic_energy, [V]),
    "weight": (BODY.weight, [T, w]),
    "point_velocity": (BODY.point_velocity, [V, w]),
    "point_acceleration": (BODY.point_acceleration, [V, V, w]),
    "in_frame": (BODY.in_frame, [T]),
    "fly": (lambda T, V, F: BODY.fly(T, V, 0.02, 0.01, F), [T, V, V]),
}
"""Functions and arguments that are right, each an array."""

NUMBERS: dict[str, Any] = {
    "so3.project within": lambda x: so3.project(R, x),
    "se3.project within": lambda x: se3.project(T, x),
    "a multiple": lambda x: x * tw.Twist(V, "b"),
    "a part": lambda x: tw.Twist(V, "b") / x,
    "reciprocal within": lambda x: tw.Wrench(V, "b").is_reciprocal_to(tw.Twist(V, "b"), x),
    "pitch": lambda x: screw_axis(w, w, x),
    "mass": tw.SpatialInertia.from_com,
    "mass of a solid": lambda x: tw.SpatialInertia.sphere(1.0, mass=x),
    "density": lambda x: tw.SpatialInertia.sphere(1.0, density=x),
    "radius": lambda x: tw.SpatialInertia.sphere(x, mass=1.0),
    "cylinder": lambda x: tw.SpatialInertia.cylinder(1.0, x, mass=1.0),
    "capsule": lambda x: tw.SpatialInertia.capsule(1.0, x, mass=1.0),
    "cone": lambda x: tw.SpatialInertia.cone(x, 1.0, mass=1.0),
    "scale": lambda x: tw.SpatialInertia.mesh(MESH, mass=1.0, scale=x),
    "angle": lambda x: G.turned(0, x),
    "duration": lambda x: BODY.fly(T, V, x, 0.01),
    "dt": lambda x: BODY.fly(T, V, 0.02, x),
    "order": lambda x: BODY.fly(T, V, 0.02, 0.01, order=x),
    "tolerance": lambda x: BODY.fly(T, V, 0.02, 0.01, tolerance=x),
    "every": lambda x: BODY.fly(T, V, 0.02, 0.01, every=x),
}


def junk(x: np.ndarray) -> dict[str, Any]:
    """What is not an array of real numbers of the shape of x, by name."""
    return {
        "a text": "abc",
        "None": None,
        "rows of None": np.full(x.shape, None),
        "a scalar": 1.0,
        "a ragged list": [[1.0, 2.0], [3.0]],
        "complex": x + 1e-3j,
        "objects that are complex": (x + 1e-3j).astype(object),
        "texts": x.astype(str),
        "numbers too large": np.full(x.shape, 10**400, object).tolist(),
        "dates": np.zeros(x.shape, "datetime64[s]"),
        "a dict": {"a": 1},
        "a shape too long": np.concatenate([x, x], axis=-1),
        "a shape too short": x[..., :2],
        "no columns": np.zeros((*x.shape[:-1], 0)),
        "objects": np.full(x.shape, object()),
        "a set": {1.0, 2.0},
    }


PLACES = [(name, place) for name, (_, good) in ARRAYS.items() for place in range(len(good))]


@pytest.mark.parametrize(("name", "place"), PLACES, ids=lambda x: str(x))
def test_what_is_no_array_of_the_shape_is_one_error_of_the_tree(name, place):
    function, good = ARRAYS[name]
    function(*good)  # the rest is right
    for kind, bad in junk(good[place]).items():
        arguments = [*good]
        arguments[place] = bad
        if bad is None and (name, place) in (("from_com", 1), ("fly", 2)):
            continue  # not given
        with pytest.raises(tw.TwistWrenchError) as caught:
            print(kind, function(*arguments))
        assert isinstance(caught.value, ValueError), kind
        assert len(str(caught.value)) > 20, kind


@pytest.mark.parametrize("name", NUMBERS)
def test_what_is_no_number_is_one_error_of_the_tree(name):
    for bad in ("abc", None, 1 + 1e-3j, [[1.0], [1.0, 2.0]], object(), {"a": 1}, 10**400):
        if bad is None and name in ("tolerance", "mass of a solid", "density"):
            continue  # not given
        with pytest.raises(tw.TwistWrenchError):
            print(bad, NUMBERS[name](bad))


VALUES = {"nan": np.nan, "inf": np.inf, "huge": 1e200, "tiny": 1e-200, "zero": 0.0, "minus": -1.0}


@pytest.mark.parametrize(("name", "place"), PLACES, ids=lambda x: str(x))
@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")  # overflow is NumPy's to tell
def test_any_value_gives_a_result_or_one_error_of_the_tree(name, place, kind):
    function, good = ARRAYS[name]
    for bad in (
        np.full_like(good[place], VALUES[kind]),
        np.where(np.arange(good[place].size).reshape(good[place].shape) == 1, VALUES[kind], good[place]),
    ):
        arguments = [*good]
        arguments[place] = bad
        try:
            function(*arguments)
        except tw.TwistWrenchError as error:
            assert len(str(error)) > 20


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
def test_any_number_gives_a_result_or_one_error_of_the_tree(name):
    for x in VALUES.values():
        try:
            NUMBERS[name](x)
        except tw.TwistWrenchError as error:
            assert len(str(error)) > 20


SINGLE = {"SpatialInertia", "fly", "in_frame", "G.in_frame", "box", "ellipsoid", "mesh corners", "mesh faces"}
BATCHED = [name for name in ARRAYS if name not in SINGLE and not name.startswith("from_")]


@pytest.mark.parametrize("name", BATCHED)
def test_empty_batches_and_batches_that_do_not_broadcast(name):
    function, good = ARRAYS[name]
    try:
        empty = function(*(np.broadcast_to(x, (0, *x.shape)) for x in good))
    except tw.ShapeError as error:
        assert "this version of SciPy" in str(error)
        return
    if isinstance(empty, np.ndarray):
        assert empty.shape[0] == 0
    if len(good) > 1:
        with pytest.raises(tw.ShapeError, match="do not broadcast"):
            function(*(np.broadcast_to(x, (k + 2, *x.shape)) for k, x in enumerate(good)))


# ── NaN ──

PLAIN = [name for name in BATCHED if name not in ("Twist", "Wrench", "Pose", "of_force", "of_couple", "so3.as_scipy")]
REFUSING = ("axis_of", "line_of_action", "screw_axis", "wrench_along")  # NaN has no axis


@pytest.mark.parametrize("name", [name for name in PLAIN if name not in REFUSING])
def test_plain_arrays_hand_nan_on_row_by_row(name):
    function, good = ARRAYS[name]
    for place in range(len(good)):
        rows = [np.broadcast_to(x, (3, *x.shape)).copy() for x in good]
        right = function(*rows)
        rows[place][1] = np.nan
        whole = function(*rows)
        assert np.isnan(whole[1]).any()
        assert np.array_equal(whole[[0, 2]], right[[0, 2]])  # to the bit


@pytest.mark.parametrize("name", ["Twist", "Wrench", "Pose", "of_force", "of_couple", "so3.as_scipy", "fly"])
def test_labels_refuse_nan_and_say_where(name):
    function, good = ARRAYS[name]
    for place in range(len(good)):
        arguments = [x.copy() for x in good]
        arguments[place].flat[1] = np.nan
        with pytest.raises(tw.ValueRangeError, match=r"has the entry nan at \("):
            function(*arguments)


def test_an_inertia_keeps_nan_and_whoever_needs_a_body_refuses_it():
    unknown = tw.SpatialInertia.from_com(np.nan)
    assert unknown.defects() == ["has a value that is not a finite number"]
    for use in (
        tw.RigidBody,
        tw.SpatialInertia.principal,
        tw.SpatialInertia.log_cholesky,
        tw.SpatialInertia.nearest_consistent,
    ):
        with pytest.raises(tw.InertiaError, match="not a finite number"):
            use(unknown)


# ── messages ──

MESSAGES = {
    "shape": (lambda: so3.exp([1, 2]), "so3.exp: w has shape (2,), expected (..., 3)."),
    "text": (lambda: so3.hat("abc"), "so3.hat: w has shape () of text, expected (..., 3)."),
    "complex": (lambda: so3.exp([1j, 0, 0]), "so3.exp: w has shape (3,) of complex numbers, expected (..., 3) of real numbers."),
    "None": (lambda: se3.log(None), "se3.log: T has shape () of NoneType, expected (..., 4, 4)."),
    "ragged": (lambda: se3.exp([[1, 2], [3]]), "se3.exp: V is not an array, expected (..., 6) of real numbers: "),
    "batches": (lambda: so3.cross(np.ones((2, 3)), np.ones((4, 3))), "do not broadcast: a (2, 3), b (4, 3)."),
    "poses": (lambda: Ad(np.ones((2, 4, 4))) , "Ad: T is not a pose: its last row is 1 off (0, 0, 0, 1), allowed 1e-06 (row 0 of the batch)."),
    "covariance": (lambda: move_covariance(np.eye(3), np.eye(6)), "move_covariance: T_ab has shape (3, 3), expected (..., 4, 4)."),
    "sum": (lambda: tw.Wrench(np.ones((2, 6)), "b") + tw.Wrench(np.ones((3, 6)), "b"), "do not broadcast: first (2, 6), second (3, 6)."),
    "power": (lambda: tw.Wrench(np.ones((2, 6)), "b") @ tw.Twist(np.ones((3, 6)), "b"), "wrench (2, 6), twist (3, 6)."),
    "relabelled": (lambda: tw.Wrench(tw.Wrench(V, "b"), "a"), "a wrench of a wrench in 'b': its numbers are F_b.values"),
    "an inertia and a number": (lambda: G + 1, "SpatialInertia + int: an inertia goes with another SpatialInertia."),
    "a number and an inertia": (lambda: 1 + G, "int + SpatialInertia: an inertia goes with another SpatialInertia."),
    "three moments": (
        lambda: tw.SpatialInertia.from_com(1.0, (0, 0, 0), [1e-3] * 3),
        "moment_about_com has shape (3,), expected (3, 3). Three moments about the axes are np.diag(…) of them.",
    ),
    "ragged moments": (lambda: tw.SpatialInertia.from_com(1.0, (0, 0, 0), [[1.0], [2.0, 3.0]]), "moment_about_com is not an array"),
    "an axis": (lambda: G.turned(3, 0.1), "no coordinate axis 3; choose 0, 1 or 2."),
    "no SciPy": (lambda: so3.from_scipy(R), "so3.from_scipy takes a scipy.spatial.transform.Rotation, got ndarray."),
}  # fmt: skip


@pytest.mark.parametrize("case", MESSAGES)
def test_messages_name_the_argument_what_came_and_what_is_wanted(case):
    action, message = MESSAGES[case]
    with pytest.raises(tw.TwistWrenchError) as caught:
        action()
    assert message in str(caught.value)


# ── what passes ──


def test_integers_of_any_size_and_sign_are_read_as_float64():
    assert so3.hat(np.array([1, 2, 3], np.uint8)).tolist() == so3.hat([1.0, 2.0, 3.0]).tolist()
    assert so3.cross(np.array([100, 0, 0], np.int8), np.array([0, 100, 0], np.int8)).tolist() == [0, 0, 10000]
    assert so3.cross([4 * 10**9, 0, 0], [0, 4 * 10**9, 0]).tolist() == [0, 0, 1.6e19]


def test_symbols_pass_every_traced_function_and_are_named_where_numbers_are_needed():
    from twistwrench.compiler.ir.tracer import Trace

    trace = Trace()
    x = np.array([trace.constant(float(k + 1)) for k in range(6)], object)
    S = se3.pose(quaternion.rotation(x[:4]), x[:3])
    for image in (
        so3.hat(x[:3]),
        so3.cross(x[:3], [1, 2, 3]),
        se3.inverse(S),
        Ad(S) @ x,
        Ad(S).T @ x,
        ad(x).T @ list(x),
    ):
        assert image.dtype == object
    assert float((Ad(S) @ x)[0].value) == pytest.approx(
        float((Ad(np.vectorize(lambda e: float(getattr(e, "value", e)))(S)) @ np.arange(1.0, 7))[0])
    )
    with pytest.raises(tw.ValueRangeError, match=r"so3.exp: w has shape \(3,\) of Expr, expected numbers"):
        so3.exp(x[:3])


@pytest.mark.parametrize("size", [1e78, 1e150, 1e200, 1e308])
def test_rotations_of_absurd_angles_are_rotations_about_their_axis(size):
    s = np.array([0.6, -0.48, 0.64])
    J = np.outer(s, s)  # the limit of the left Jacobian: 1/size is far below rounding
    for turn in (
        so3.exp(size * s),
        quaternion.rotation(quaternion.exp(size * s)),
        se3.exp([*(size * s), 1, 2, 3])[:3, :3],
    ):
        assert np.abs(turn.T @ turn - np.eye(3)).max() <= 1e-15
        assert np.abs(turn @ s - s).max() <= 1e-15
    assert np.abs(so3.left_jacobian(size * s) - J).max() <= 1e-15
    assert np.abs(se3.exp([*(size * s), 1, 2, 3])[:3, 3] - J @ [1, 2, 3]).max() <= 1e-14
    batch = so3.exp(np.array([[0.1, 0.2, 0.3], size * s, [np.nan, 0, 0], [0, 0, 0]]))
    assert np.array_equal(batch[0], so3.exp([0.1, 0.2, 0.3]))
    assert np.array_equal(batch[1], so3.exp(size * s))
    assert np.isnan(batch[2]).all()
    assert np.array_equal(batch[3], np.eye(3))


@pytest.mark.parametrize("scale", [1e-200, 1e-150, 1.0, 1e150, 1e200])
def test_the_log_of_a_quaternion_knows_no_length(scale):
    w = np.array([0.3, -2.0, 1.0])
    assert np.abs(quaternion.log(scale * quaternion.exp(w)) - w).max() <= 4e-15
