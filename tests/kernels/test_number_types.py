"""What numbers may be made of, at methods with and without options, at kernels and in ``out``, compiled and on NumPy alike.

One rule: what float32 holds exactly is computed in float32, what float64 holds in float64, as NumPy's own functions do. All
else is an error that names the argument and its type; nothing is rounded unasked.
"""

from __future__ import annotations

import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import twistwrench as tw

SINGLE = ["float32", "float16", "bool", "int8", "uint8", "int16", "uint16"]
DOUBLE = ["float64", ">f8", "int32", "uint32", "int64", "uint64"]
WRONG = {
    "complex128": lambda a: a.astype(complex),
    "complex64": lambda a: a.astype(np.complex64),
    "object": lambda a: a.astype(object),
    "object ": lambda a: np.array([Fraction(1, 3)] * a.size, object).reshape(a.shape),
    "object  ": lambda a: np.array([Decimal(1)] * a.size, object).reshape(a.shape),
    "object   ": lambda a: np.full(a.shape, None),
    "object    ": lambda a: np.full(a.shape, 2**70).tolist(),
    "str": lambda a: a.astype(str),
    "bytes": lambda a: a.astype("S"),
    "datetime64": lambda a: a.astype("i8").astype("M8[s]"),
    "timedelta64": lambda a: a.astype("i8").astype("m8[s]"),
    "void": lambda a: np.zeros(a.shape, [("x", float)]),
}


def calls(robot, c):
    """Methods of every kind, with all their arrays of one type."""
    q, dq, ddq = (c(np.array([[0.0, 1.0, -2.0], [3.0, 1.0, 2.0]]) * k) for k in (1, 2, -1))
    F = c(np.array([1.0, 0.0, 2.0, 0.0, 0.0, 3.0]))
    return {
        "inverse_dynamics": lambda: robot.inverse_dynamics(q, dq, ddq),
        "forward_dynamics": lambda: robot.forward_dynamics(q, dq, ddq),
        "mass_matrix": lambda: robot.mass_matrix(q),
        "kinetic_energy": lambda: robot.kinetic_energy(q, dq),
        "jacobian": lambda: robot.jacobian(q, kind="space"),
        "wrench_by_robot": lambda: robot.inverse_dynamics(q, dq, ddq, wrench_by_robot={robot.tip: F}),
        "wrench_on_robot": lambda: robot.holding_torques(q, wrench_on_robot={robot.tip: F}),
        "friction": lambda: robot.inverse_dynamics(q, dq, ddq, friction=True),
        "wrench_torques": lambda: robot.wrench_torques(q, F),
        "derivatives": lambda: robot.inverse_dynamics_derivatives(q, dq, ddq)[0],
        "one state": lambda: robot.gravity_forces(q[0]),
    }


CALLS = list(calls(tw.robots.planar_3r(), np.asarray))


@pytest.fixture(scope="module", params=["compiled", "on NumPy"])
def robot(request):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWISTWRENCH_JIT", "01"[request.param == "compiled"])
        robot = tw.robots.planar_3r()
        for _ in range(2):  # kernels are made, and builtins put in front
            for call in calls(robot, np.asarray).values():
                call()
        yield robot


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("kind", [*SINGLE, *DOUBLE])
def test_numbers_that_a_float_holds(robot, call, kind):
    precision = np.float32 if kind in SINGLE else np.float64
    with np.errstate(invalid="ignore"):
        converted = calls(robot, lambda a: np.abs(a).astype(kind) if "u" in kind else a.astype(kind))[call]()
        exact = calls(robot, lambda a: (np.abs(a) if "u" in kind else a).astype(kind).astype(precision))[call]()
    assert converted.dtype == precision
    np.testing.assert_array_equal(converted, exact)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("kind", WRONG)
def test_numbers_that_no_float_holds(robot, call, kind):
    with pytest.raises(tw.ShapeError) as error:
        calls(robot, lambda a: WRONG[kind](np.asarray(a, float)))[call]()
    text = str(error.value)
    assert re.match(r"\w+: (q|dq|the one at 'tip'|wrench) is not an array of real numbers but of ", text), text
    assert kind.strip() in text
    assert ("np.asarray(…, float)" in text) == kind.startswith("object")


@pytest.mark.skipif(np.finfo(np.longdouble).nmant == 52, reason="long doubles are doubles here")
@pytest.mark.parametrize("call", CALLS)
def test_long_doubles_are_not_rounded_unasked(robot, call):
    with pytest.raises(tw.ShapeError, match=r"is of \w+, and kernels compute in float32 or float64\. .* np\.asarray\("):
        calls(robot, lambda a: np.asarray(a, np.longdouble))[call]()


def test_one_double_is_enough(robot):
    q, dq = np.zeros(3), np.ones(3)
    for types in [("f", "d", "f"), ("d", "f", "f"), ("i1", "f", "i4"), ("f", "f2", "d")]:
        assert robot.inverse_dynamics(*(x.astype(t) for x, t in zip((q, dq, dq), types, strict=True))).dtype == float


# ── out ──


@pytest.mark.parametrize("kind", ["float64", ">f8", "longdouble", "complex128", "object", "float32", "float16"])
def test_out_may_be_of_any_type_of_that_kind(robot, kind):
    q = np.linspace(-2, 2, 12).reshape(4, 3)
    expected, out = robot.gravity_forces(q), np.zeros((4, 3), kind)
    assert robot.gravity_forces(q, out=out) is out
    np.testing.assert_array_equal(out, expected.astype(kind))


def read_only(a):
    a.flags.writeable = False
    return a


OUTS = {
    "writable array of int64": lambda: np.zeros((4, 3), int),
    "writable array of bool": lambda: np.zeros((4, 3), bool),
    "writable array of str": lambda: np.zeros((4, 3), "U30"),
    "writable array of bytes": lambda: np.zeros((4, 3), "S30"),
    "float64 and shape (4, 2)": lambda: np.zeros((4, 2)),
    "float64 and shape (3,)": lambda: np.zeros(3),
    "float64 and shape (2, 3)": lambda: np.zeros((2, 3)),
    "read-only array of float64": lambda: read_only(np.zeros((4, 3))),
    "a list": lambda: [0.0] * 3,
    "a str": lambda: "here",
    "a float": lambda: 1.0,
    "float64 and shape (4, 3) and a writable": lambda: (np.zeros((4, 3)), np.zeros((4, 3))),
}


@pytest.mark.parametrize("what", OUTS)
def test_an_out_that_results_do_not_fit_in(robot, what):
    q, out = np.linspace(-2, 2, 12).reshape(4, 3), OUTS[what]()
    with pytest.raises(tw.ShapeError) as error:
        robot.gravity_forces(q, out=out)
    text = str(error.value)
    assert text.startswith("gravity_forces: out= is ")
    assert what in text
    assert text.endswith("Give an array of float64 that can be written to, one of shape (4, 3); or leave it out.")
    if isinstance(out, np.ndarray) and out.dtype.kind in "ifb":
        assert not out.any()
    with pytest.raises(tw.ShapeError, match="of float32 that can be written to"):
        robot.gravity_forces(q.astype(np.float32), out=OUTS[what]())


def test_an_out_for_several_results(robot):
    q = np.zeros((4, 3))
    with pytest.raises(
        tw.ShapeError, match=r"a tuple of arrays .* one of shape \(4, 3, 3\) and one of shape \(4, 3, 3\)"
    ):
        robot.inverse_dynamics_derivatives(q, q, q, out=np.zeros((4, 3, 3)))


def test_inputs_are_blamed_before_out(robot):
    with pytest.raises(tw.ShapeError, match="q has shape"):
        robot.gravity_forces(np.zeros(4), out=np.zeros(2))


@pytest.mark.parametrize("single", [False, True])
def test_out_may_be_an_input(robot, single):
    rng = np.random.default_rng(5)
    q, dq, ddq = rng.normal(size=(3, 9, 3)).astype("f" if single else "d")
    expected = robot.inverse_dynamics(q, dq, ddq)
    for k in range(3):
        arrays = [q.copy(), dq.copy(), ddq.copy()]
        assert robot.inverse_dynamics(*arrays, out=arrays[k]) is arrays[k]
        np.testing.assert_array_equal(arrays[k], expected)
        one = [q[2].copy(), dq[2].copy(), ddq[2].copy()]  # a single state, with the builtin in front
        robot.inverse_dynamics(*one, out=one[k])
        np.testing.assert_array_equal(one[k], robot.inverse_dynamics(q[2], dq[2], ddq[2]))
    shifted = np.concatenate([q, q[:1]])
    robot.inverse_dynamics(shifted[:-1], dq, ddq, out=shifted[1:])
    np.testing.assert_array_equal(shifted[1:], expected)
    same = q.copy()
    doubled = robot.inverse_dynamics(same, same, same)
    robot.inverse_dynamics(same, same, same, out=same)
    np.testing.assert_array_equal(same, doubled)


def test_kernels_refuse_what_numpy_would(robot):
    kernel = robot.kernel("gravity_forces")
    for wrong in (complex, object, "U8", "M8[s]", np.longdouble):
        if np.can_cast(wrong, float) or (wrong is np.longdouble and np.finfo(wrong).nmant == 52):
            continue
        with pytest.raises(TypeError):
            kernel(np.zeros(3).astype(wrong) if wrong != "M8[s]" else np.zeros(3, int).astype(wrong))
    with pytest.raises(TypeError):
        kernel(np.zeros(3), out=np.zeros(3, int))
    assert kernel(np.zeros(3, np.float16)).dtype == np.float32


def test_wrenches_as_lists_take_the_precision_of_the_state(robot):
    """A list has no precision of its own; an array has, and what float64 holds is computed in float64."""
    state, push = np.zeros((3, 3), np.float32), [0.0, 0.0, 0.0, 0.0, 1.5, 0.0]
    for side in ("wrench_by_robot", "wrench_on_robot"):
        for given, precision in ((push, np.float32), (np.array(push, "f"), np.float32), (np.array(push), np.float64)):
            assert robot.inverse_dynamics(*state, **{side: {robot.tip: given}}).dtype == precision
    tau = robot.inverse_dynamics(*state, wrench_by_robot={robot.tip: push})
    np.testing.assert_allclose(
        tau, robot.inverse_dynamics(*state.astype(float), wrench_by_robot={robot.tip: push}), 1e-5
    )


def test_two_results_are_not_written_to_one_memory(robot):
    q = np.zeros((5, 3))
    room = np.zeros((6, 3, 3))
    for out in ((room[:5], room[:5]), (room[:5], room[1:])):
        with pytest.raises(tw.ShapeError, match="two arrays of out= share memory"):
            robot.inverse_dynamics_derivatives(q, q, q, out=out)
    both = np.zeros((5, 3, 3, 2))  # side by side, element by element
    robot.inverse_dynamics_derivatives(q, q + 1, q, out=(both[..., 0], both[..., 1]))
    np.testing.assert_array_equal(np.moveaxis(both, -1, 0), robot.inverse_dynamics_derivatives(q, q + 1, q))
