"""Differentiation of traced functions: every rule by complex steps, forward against reverse, and what the door refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twistwrench as tw
from twistwrench.compiler.ir.autodiff import along, gradient, jacobian, work
from twistwrench.compiler.ir.program import ARITY, FUSED, Program
from twistwrench.compiler.ir.tracer import Trace, trace
from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel
from twistwrench.testing import assert_close

ROUNDING = 1e-13
"""Some tens of operations, 1e-16 each; a complex step of 1e-30 has no error of its own."""

# ── an evaluator of its own, on complex numbers too ──

OPERATIONS = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "sign": lambda a: np.sign(np.real(a)),
    "min": lambda a, b: a if np.real(a) < np.real(b) else b,
    "max": lambda a, b: a if np.real(a) > np.real(b) else b,
    **{op: lambda a, b, c, s=signs: s[0] * a * b + s[1] * c for op, signs in FUSED.items()},
}


def evaluated(program: Program, numbers) -> np.ndarray:
    """All results of a program, one after another."""
    values = []
    for op, args, value in program.instructions:
        if op == "const":
            values.append(value)
        elif op == "input":
            values.append(numbers[int(value)])
        else:
            values.append(OPERATIONS[op](*(values[a] for a in args)))
    return np.array([values[k] for k in program.results])


def by_complex_steps(program: Program, numbers) -> np.ndarray:
    """∂results/∂inputs: the imaginary part at x + ih is h times the derivative, and nothing is subtracted."""
    h = 1e-30
    columns = []
    for k in range(len(numbers)):
        x = np.array(numbers, complex)
        x[k] += 1j * h
        columns.append(evaluated(program, x).imag / h)
    return np.stack(columns, axis=-1)


def derivative_program(function, count: int, mode: str) -> Program:
    """J of a function of numbers."""

    def run(x):
        owner = x[0].trace
        known = {e: {k: owner.one} for k, e in enumerate(x)}
        return jacobian([owner.lift(r) for r in function(*x)], known, count, mode)

    return trace(run, [("x", (count,))], ["J"])


def value_program(function, count: int) -> Program:
    return trace(lambda x: np.array(function(*x), object), [("x", (count,))], ["y"])


# ── the rules ──

RULES = {
    "add": (lambda x, y: x + y, 2),
    "sub": (lambda x, y: x - y, 2),
    "mul": (lambda x, y: x * y, 2),
    "div": (lambda x, y: x / y, 2),
    "neg": (lambda x, y: -x - y, 2),
    "sqrt": (lambda x, y: np.sqrt(x * y), 2),
    "sin": (lambda x, y: np.sin(x * y), 2),
    "cos": (lambda x, y: np.cos(x * y), 2),
    "exp": (lambda x, y: np.exp(x * y), 2),
    "min": (lambda x, y: (x * y).trace.min(x * x, y * x) + 3.0 * x.trace.min(y, x), 2),
    "max": (lambda x, y: (x * y).trace.max(x * x, y * x) + 3.0 * x.trace.max(y, x), 2),
    "clip": (lambda x, y, z: (x * y).clip(-z, 0.7 * z), 3),
    "fma": (lambda x, y, z: x * y + z, 3),
    "fms": (lambda x, y, z: x * y - z, 3),
    "fnma": (lambda x, y, z: z - x * y, 3),
    "fnms": (lambda x, y, z: -(x * y) - z, 3),
    "of itself": (lambda x, y: x * x / (x + y * y), 2),
    "by a number": (lambda x, y: 2.0 / x + y / 3.0 - 5.0 * x, 2),
    "tan": (lambda x, y: np.tan(x) + y, 2),
    "power": (lambda x, y: x**5 + y**-2 + x**2.5 + y**0, 2),
    "norm": (lambda x, y: np.linalg.norm(np.array([x, y, x * y])), 2),
    "tower": (lambda x, y: np.sin(np.exp(np.cos(x) / y) * np.sqrt(x + y)), 2),
}


def test_every_operation_has_a_rule_here():
    assert {op for op, arity in ARITY.items() if arity} - {"sign"} <= set(RULES)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
@pytest.mark.parametrize("rule", RULES)
def test_rules_by_complex_steps(rule, mode):
    function, count = RULES[rule]
    x = np.random.default_rng(1).uniform(0.3, 2.0, count)
    program = value_program(lambda *x: [function(*x)], count)
    found = evaluated(derivative_program(lambda *x: [function(*x)], count, mode), x).reshape(1, count)
    assert_close(found, by_complex_steps(program, x), ROUNDING, rule)


@pytest.mark.parametrize("x", [-2.0, 3.0])
def test_signs_jump_and_have_the_derivative_zero(x):
    assert tw.differentiate(lambda x: x * x.sign(), {"x": ()})(x) == np.sign(x)
    assert tw.differentiate(lambda x: abs(x), {"x": ()})(x) == np.sign(x)
    assert tw.differentiate(lambda x: x.sign(), {"x": ()})(x) == 0.0


BINARY = ("add", "sub", "mul", "quotient")
UNARY = ("neg", "sin", "cos", "bounded exp", "root")


def grown(x, steps):
    """A function of random operations whose values stay of order one: each step takes earlier values by their places."""
    values = list(x)
    for op, i, j in steps:
        a, b = values[i % len(values)], values[j % len(values)]
        values.append({
            "add": lambda: 0.5 * (a + b), "sub": lambda: 0.5 * (a - b), "mul": lambda: np.sin(a) * b,  # noqa: B023
            "quotient": lambda: a / (1.5 + np.sin(b)), "neg": lambda: -a, "sin": lambda: np.sin(a),  # noqa: B023
            "cos": lambda: np.cos(a), "bounded exp": lambda: np.exp(np.sin(a)), "root": lambda: np.sqrt(1.5 + np.cos(a)),  # noqa: B023
        }[op]())  # fmt: skip
    return values[-3:]


STEPS = st.lists(
    st.tuples(st.sampled_from(BINARY + UNARY), st.integers(0, 50), st.integers(0, 50)), min_size=3, max_size=30
)


@settings(max_examples=150, deadline=None)
@given(steps=STEPS, seed=st.integers(0, 1000))
def test_any_function_by_complex_steps_forward_and_reverse(steps, seed):
    x = np.random.default_rng(seed).uniform(-2, 2, 3)
    expected = by_complex_steps(value_program(lambda *x: grown(x, steps), 3), x)
    for mode in ("forward", "reverse", "auto"):
        found = evaluated(derivative_program(lambda *x: grown(x, steps), 3, mode), x).reshape(3, 3)
        # Slopes multiply along a path of up to 30 steps: rounding is relative to the largest.
        assert_close(found, expected, 1e-12, mode, scale=max(1.0, np.abs(expected).max()))


def test_a_program_of_any_depth():
    def deep(x):
        for _ in range(5_000):  # Python's stack has a thousand frames
            x = np.sin(x) + 1.0
        return [x]

    for mode in ("forward", "reverse"):
        assert derivative_program(deep, 1, mode).counts()["cos"] == 5_000


def test_what_does_not_vary_costs_nothing():
    program = derivative_program(lambda x, y: [x + 3.0, 7.0, y * 0.0], 2, "reverse")
    assert program.flops == 0
    assert evaluated(program, [1.0, 2.0]).tolist() == [1, 0, 0, 0, 0, 0]


def test_what_is_known_is_taken_as_it_is():
    """A shorter formula for an inner derivative takes the place of the chain rule, in both modes."""
    owner = Trace()
    x = owner.input(0)
    s, direct = np.sin(x), 3.0 * x
    known = {x: {0: owner.one}, s: {0: owner.constant(100.0)}}
    for mode in ("forward", "reverse"):
        assert jacobian([s, direct], known, 1, mode)[:, 0].tolist() == [owner.constant(100.0), owner.constant(3.0)]
        assert jacobian([s * direct], known, 1, mode)[0, 0] is s * 3.0 + 100.0 * direct
    assert along([7.0 * s], known, [owner.constant(2.0)])[0].value == 1400.0
    assert gradient([s, direct], [2.0, 1.0], known, 1)[0].value == 203.0


@pytest.mark.parametrize(("function", "count", "forward", "reverse"), [
    (lambda *x: [math.prod(x)], 6, 2 + 3 + 4 + 5 + 6, 2 * 5),  # Speelpenning's product
    (lambda x: [x * k for k in (2.0, 3.0, 4.0)], 1, 3, 3),
    (lambda x, y: [x + y, x - y], 2, 0, 0),
    (lambda x, y: [np.sin(x + y)], 2, 2, 1),
    (lambda x: [np.sin(x) + np.cos(x)], 1, 2 + 1, 2 + 1),  # two products, and one addition where the ways of x meet
])  # fmt: skip
def test_operations_are_counted_before_they_are_made(function, count, forward, reverse):
    owner = Trace()
    x = [owner.input(k) for k in range(count)]
    counted = work(function(*x), {e: {k: owner.one} for k, e in enumerate(x)})
    assert counted.reverse == reverse
    assert counted.forward == forward


# ── the forms ──


def field(x, y):
    """Results of three shapes."""
    return np.array([np.sin(x[0]) * y[1], x @ x, y[0] / x[1]]), np.outer(x, y), np.exp(x[0] * y[1])


SHAPES = {"x": 3, "y": (2,)}
POINT = (np.array([0.3, -1.2, 0.7]), np.array([0.5, 1.4]))


def flat_field(*numbers):
    """The same as one list of numbers of five numbers."""
    return [e for x in field(np.array(numbers[:3]), np.array(numbers[3:])) for e in np.ravel(x)]


@pytest.mark.parametrize("mode", ["auto", "forward", "reverse"])
def test_jacobians_come_by_result_and_input(mode):
    found = tw.differentiate(field, SHAPES, mode=mode)(*POINT)
    assert [x.shape for x in found] == [(3, 3), (3, 2), (3, 2, 3), (3, 2, 2), (3,), (2,)]
    J = np.vstack([np.hstack([found[k].reshape(-1, 3), found[k + 1].reshape(-1, 2)]) for k in (0, 2, 4)])
    assert_close(J, by_complex_steps(value_program(flat_field, 5), np.concatenate(POINT)), ROUNDING, "J")


def test_products_are_those_of_the_jacobian():
    rng = np.random.default_rng(2)
    J = by_complex_steps(value_program(flat_field, 5), np.concatenate(POINT))
    v, w = rng.normal(size=5), rng.normal(size=10)
    weights = (w[:3], w[3:9].reshape(3, 2), w[9])
    forward = tw.differentiate(field, SHAPES, form="along")(*POINT, v[:3], v[3:])
    assert [np.shape(x) for x in forward] == [(3,), (3, 2), ()]
    assert_close(np.concatenate([np.ravel(x) for x in forward]), J @ v, ROUNDING, "J v")
    by_x, by_y = tw.differentiate(field, SHAPES, form="weighted")(*POINT, *weights)
    assert_close(np.r_[by_x, by_y], w @ J, ROUNDING, "w J")
    assert_close(tw.differentiate(field, SHAPES, "y", form="weighted")(*POINT, *weights), by_y, ROUNDING, "by y alone")


def test_a_result_that_is_there_twice_has_both_weights():
    """d(w₁ x² + w₂ x²)/dx = 2 (w₁ + w₂) x, though both results are one expression."""
    twice = tw.differentiate(lambda x: np.array([x * x, x * x]), {"x": ()}, form="weighted")
    assert twice(3.0, [1.0, 2.0]) == 18.0


@pytest.mark.parametrize("mode", ["auto", "forward", "reverse"])
def test_hessians_are_derivatives_of_jacobians(mode):
    kernel = tw.differentiate(field, SHAPES, form="hessian", mode=mode)
    found = kernel(*POINT)
    assert [x.shape for x in found] == [(3, 5, 5), (3, 2, 5, 5), (5, 5)]
    H = np.concatenate([x.reshape(-1, 5, 5) for x in found])
    gradients = derivative_program(flat_field, 5, "forward")
    expected = by_complex_steps(gradients, np.concatenate(POINT)).reshape(10, 5, 5)
    assert_close(H, expected, ROUNDING, "Hessians")
    np.testing.assert_array_equal(H, np.swapaxes(H, -1, -2))
    rng = np.random.default_rng(3)
    w, v = rng.normal(size=10), rng.normal(size=5)
    weights = (w[:3], w[3:9].reshape(3, 2), w[9])
    product = tw.differentiate(field, SHAPES, form="hessian_along")(*POINT, *weights, v[:3], v[3:])
    assert_close(np.concatenate(product), np.einsum("i,ijk,k", w, expected, v), ROUNDING, "Hessian times direction")


def test_a_function_of_one_number_takes_no_weights_and_gives_its_value_when_asked():
    def rosenbrock(x):
        return ((1.0 - x[:-1]) ** 2 + 100.0 * (x[1:] - x[:-1] ** 2) ** 2).sum()

    from scipy.optimize import minimize, rosen, rosen_der, rosen_hess, rosen_hess_prod

    x, v = np.array([0.4, -0.3, 1.2, 0.9]), np.array([1.0, 2.0, -1.0, 0.5])
    both = tw.differentiate(rosenbrock, {"x": 4}, values=True)
    value, slope = both(x)
    assert_close(value, rosen(x), ROUNDING, "value")
    assert_close(slope, rosen_der(x), ROUNDING, "gradient")
    assert_close(tw.differentiate(rosenbrock, {"x": 4}, form="weighted")(x), rosen_der(x), ROUNDING, "reverse")
    assert_close(tw.differentiate(rosenbrock, {"x": 4}, form="hessian")(x), rosen_hess(x), ROUNDING, "Hessian")
    product = tw.differentiate(rosenbrock, {"x": 4}, form="hessian_along")
    assert product.signature == "(4),(4)->(4)"
    assert_close(product(x, v), rosen_hess_prod(x, v), ROUNDING, "Hessian times v")
    assert_close(minimize(both, x, jac=True, method="BFGS").x, np.ones(4), 1e-5, "minimum")


def test_kernels_are_ufuncs_of_any_batch_and_of_both_precisions():
    kernel = tw.differentiate(lambda x, y: np.sin(x) @ y, {"x": 3, "y": 3}, "x")
    assert isinstance(kernel, np.ufunc)
    x, y = np.random.default_rng(4).normal(size=(2, 5, 4, 3))
    assert_close(kernel(x, y[0]), np.cos(x) * y[0], ROUNDING, "batch")
    single = kernel(x.astype(np.float32), y.astype(np.float32))
    assert single.dtype == np.float32
    assert_close(single, np.cos(x) * y, 1e-6, "float32")
    out = np.empty((5, 4, 3))
    kernel(x, y, out=out)
    np.testing.assert_array_equal(out, kernel(x, y))
    with pytest.raises(ValueError, match="mismatch in its core dimension"):
        kernel(x, y[..., :2])


def test_without_compiling(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    kernel = tw.differentiate(field, SHAPES, form="weighted", by="x")
    assert isinstance(kernel, NumpyKernel)
    assert kernel.program.outputs[0].shape == (3,)


# ── what is refused ──


def refuse(kind, *told, function=lambda x: x @ x, arguments=None, **options):
    with pytest.raises(kind) as caught:
        tw.differentiate(function, {"x": 3} if arguments is None else arguments, **options)
    for text in told:
        assert text in str(caught.value)


def branching(x):
    return x if x[0] > 0 else -x


def asking(x):
    return 2.0 * x if x[0] == 0 else x


@pytest.mark.parametrize(("function", "told"), [
    (branching, "not supported between"),
    (asking, "cannot be compared"),
    (lambda x: np.linalg.solve(np.outer(x, x), x), "cannot be traced"),
    (lambda x: np.arctan2(1.0, x[1]), "cannot be traced"),
    (lambda x: np.where(x, x, 0.0), "no truth"),
    (lambda x: x**65, "powers up to 64"),
    (lambda x: x[5], "out of bounds"),
])  # fmt: skip
def test_functions_that_cannot_be_traced(function, told):
    refuse(tw.KernelError, told, "differentiate", "It runs once, on symbols", function=function)


@pytest.mark.parametrize(
    "returned", [None, "text", {"a": 1.0}, 1j, object(), np.array(["a"]), ()], ids=lambda x: type(x).__name__
)
def test_functions_that_return_no_arrays(returned):
    refuse(tw.ShapeError, "it returned", "Return an array of numbers", function=lambda x: returned)


def test_functions_that_return_rows_of_unequal_length():
    refuse(tw.ShapeError, "it returned", "Return an array of numbers", function=lambda x: [x, x[0]])


def test_arguments_and_options_that_cannot_be_meant():
    refuse(tw.KernelError, "is not a function", "robot.kernel(name, by=…)", function="mass_matrix")
    refuse(tw.ShapeError, "a dict {name: shape or robot}", arguments=[(3,)])
    refuse(tw.ShapeError, "a dict {name: shape or robot}", arguments={})
    for shape in (-1, (2, -3), "three", 2.5, (1.5,), None):
        refuse(tw.ShapeError, "x has shape", repr(shape), arguments={"x": shape})
    refuse(tw.ShapeError, "does not take the arguments x, y", arguments={"x": 3, "y": 3})
    refuse(tw.UnknownNameError, "no input of differentiate <lambda> named 'z'", "Known: x", by="z")
    refuse(
        tw.ShapeError, "an argument is named 'along x'", function=lambda x, y: x @ y,
        arguments={"x": 3, "along x": 3}, by="x", form="along",
    )  # fmt: skip
    refuse(tw.KernelError, "named twice", by=("x", "x"))
    refuse(tw.KernelError, "names no input", by=())
    refuse(tw.KernelError, "names no input", by=0)
    refuse(tw.UnknownNameError, "mode of a derivative named 'backward'", "auto, forward, reverse", mode="backward")
    refuse(tw.UnknownNameError, "form of a derivative named 'jvp'", "hessian_along", form="jvp")
    refuse(tw.KernelError, "has one way to compute it", form="along", mode="reverse")


def test_results_too_large_are_refused_before_they_are_made(monkeypatch):
    refuse(
        tw.KernelError, "1000000 numbers, more than the 500000", "form='along'",
        function=lambda x: np.sin(x), arguments={"x": 1000},
    )  # fmt: skip
    refuse(tw.KernelError, "hessian has 1000000 numbers", arguments={"x": 1000}, form="hessian")
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    product = tw.differentiate(lambda x: np.sin(x), {"x": 1000}, form="along")
    assert product.signature == "(1000),(1000)->(1000)"


def test_constants_have_derivatives_too():
    assert tw.differentiate(lambda x: 3.0, {"x": 2})([1.0, 2.0]).tolist() == [0.0, 0.0]
    assert tw.differentiate(lambda x: np.eye(2), {"x": 2}, form="hessian")([1.0, 2.0]).shape == (2, 2, 2, 2)
