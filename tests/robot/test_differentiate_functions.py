"""The functions costs are written with: what their kernels give is NumPy's, and the slopes are those of differences."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel
from twistwrench.compiler.printers.c99 import CFunction

FUNCTIONS = {
    "tanh": lambda x, y: np.tanh(x * y),
    "exp": lambda x, y: np.exp(x - y),
    "log": lambda x, y: np.log(x * x + y * y),
    "arctan": lambda x, y: np.arctan(x * y),
    "arctan2": lambda x, y: np.arctan2(x, y),
    "hypot": lambda x, y: np.hypot(x, y),
    "power": lambda x, y: (x * x + 0.1) ** 0.3 + (y * y + 0.5) ** -1.7,
    "power of a symbol": lambda x, y: (x * x + 0.1) ** y,
    "power of a number": lambda x, y: 2.0 ** (x - y),
    "maximum": lambda x, y: tw.pointwise.maximum(x * y, 0.5 * x) ** 2 + tw.pointwise.maximum(0.3, y),
    "minimum": lambda x, y: tw.pointwise.minimum(x * y, 0.5 * x) ** 2 + tw.pointwise.minimum(y, 0.3),
    "clip": lambda x, y: tw.pointwise.clip(x * x * x, -1.0, y * y),
    "where": lambda x, y: (
        tw.pointwise.where_positive(x - y, np.sin(x * y), x * x) + tw.pointwise.where_positive(y, 2.0, x)
    ),
    "tower": lambda x, y: np.log(1.0 + np.exp(np.tanh(x) * np.arctan2(y, x))),
}
_RNG = np.random.default_rng(0)
POINTS = _RNG.uniform(0.2, 2.0, (40, 2)) * _RNG.choice([-1.0, 1.0], (40, 2))  # arctan2 is wild at the origin


def kernels(function, **options):
    return tw.differentiate(lambda x: function(x[0], x[1]), {"x": 2}, values=True, **options)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_are_numpys_and_slopes_those_of_differences(name, mode):
    """Differences over four points: h^4 / 30 of the fifth derivative, below 1e-8 here, and 1e-13 of rounding."""
    function = FUNCTIONS[name]
    value, slope = kernels(function, mode=mode)(POINTS)
    x, y = POINTS.T
    np.testing.assert_allclose(value, function(x, y), rtol=1e-14, atol=2e-15)
    for k in range(2):
        h = 1e-3 * np.eye(2)[k][:, None]
        near, far = (function(*(POINTS.T + n * h)) - function(*(POINTS.T - n * h)) for n in (1, 2))
        found = (8 * near - far) / 12e-3
        np.testing.assert_allclose(slope[:, k], found, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_second_derivatives_are_differences_of_first(name):
    """Central differences of exact slopes: 1e-5 cubed in the step, 1e-16 over it."""
    function = FUNCTIONS[name]
    slopes, curvature = kernels(function), kernels(function, form="hessian")
    h = 1e-5
    H = curvature(POINTS)[1].reshape(-1, 2, 2)
    np.testing.assert_allclose(H, H.transpose(0, 2, 1), rtol=1e-12, atol=1e-12)
    for k in range(2):
        step = h * np.eye(2)[k]
        found = (slopes(POINTS + step)[1] - slopes(POINTS - step)[1]) / (2 * h)
        np.testing.assert_allclose(H[:, :, k], found, rtol=1e-6, atol=1e-5 * np.abs(H).max() ** 0.5)


def one(function):
    """The kernel of a function of one number, and of its slope."""
    return tw.differentiate(function, {"x": ()}, values=True)


def test_logarithms_to_the_last_digits_at_every_size():
    rng = np.random.default_rng(1)
    x = np.concatenate([10.0 ** rng.uniform(-307, 308, 20000), 1 + 1e-3 * rng.normal(size=20000), [1.0]])
    value, slope = one(np.log)(x)
    np.testing.assert_allclose(value, np.log(x), rtol=4e-16, atol=1e-15)
    np.testing.assert_allclose(slope, 1 / x, rtol=1e-15)
    with np.errstate(all="ignore"):
        value, _ = one(np.log)(np.array([0.0, -0.0, -1.0, np.nan]))
        power, _ = one(lambda x: x**1.3)(np.array([0.0, -0.0]))
    np.testing.assert_array_equal(value, [-np.inf, -np.inf, np.nan, np.nan])
    np.testing.assert_array_equal(power, [0.0, 0.0])


def test_logarithms_in_single_precision():
    """Their constants are finite there: C takes them, and NumPy warns of no overflow."""
    program = trace(np.log, [("x", ())], ["y"])
    assert "sqrtf" in CFunction("logarithm", program, "float").definition
    x = np.geomspace(1e-37, 3e38, 200, dtype=np.float32)
    with np.errstate(over="raise"):
        value = NumpyKernel(program, "logarithm", "")(x)
    np.testing.assert_allclose(value, np.log(x), rtol=1e-6, atol=1e-6)


def test_tanh_ends_at_one():
    x = np.concatenate([np.linspace(-30, 30, 20001), [-1e6, 1e6, 1e-9]])
    value, slope = one(np.tanh)(x)
    np.testing.assert_allclose(value, np.tanh(x), atol=1e-15)
    np.testing.assert_allclose(slope, 1 / np.cosh(np.clip(x, -300, 300)) ** 2, atol=2e-15)
    with np.errstate(all="ignore"):
        assert np.isnan(one(np.tanh)(np.nan)[0])


def test_angles_of_points_on_the_axes_and_diagonals():
    """Where the formula changes its branch the slope is the function's still."""
    kernel = kernels(np.arctan2)
    for y in (-1.0, 0.0, 1.0):
        for x in (-1.0, 0.0, 1.0):
            if (y, x) == (0.0, 0.0):
                with np.errstate(all="ignore"):  # there is no slope
                    assert kernel([0.0, 0.0])[0] == 0.0
                continue
            value, slope = kernel([y, x])
            assert value == pytest.approx(np.arctan2(y, x), abs=1e-15)
            np.testing.assert_allclose(slope, np.array([x, -y]) / (x * x + y * y), atol=1e-15)
    y, x = np.random.default_rng(2).normal(size=(2, 10000)) * 10.0 ** np.arange(-5, 5).repeat(1000)
    np.testing.assert_allclose(kernel(np.stack([y, x], axis=1))[0], np.arctan2(y, x), atol=1e-15)


def test_a_function_that_is_folded_keeps_its_rule():
    """A sign in front, or a number, and the rule is found all the same: across the axis where the formula's is wrong."""
    for function in (
        lambda y, x: -np.arctan2(y, x),
        lambda y, x: 3.0 - 2.0 * np.arctan2(y, x),
        lambda y, x: np.arctan2(-y, x),
    ):
        slope = kernels(function)([2.0, 0.0])[1]
        h = 1e-6
        expected = (function(2.0, h) - function(2.0, -h)) / (2 * h)
        assert slope[1] == pytest.approx(expected, abs=1e-9)


def test_choices_are_numpys_on_numbers_and_element_by_element_on_symbols():
    x, y = np.random.default_rng(3).normal(size=(2, 5))
    pairs = (
        (tw.pointwise.maximum, np.maximum),
        (tw.pointwise.minimum, np.minimum),
        (lambda x, y: tw.pointwise.clip(x, y, y + 0.5), lambda x, y: np.clip(x, y, y + 0.5)),
        (
            lambda x, y: tw.pointwise.where_positive(x, y, [1, 2, 3, 4, 5]),
            lambda x, y: np.where(x > 0, y, [1, 2, 3, 4, 5]),
        ),
    )
    for ours, numpys in pairs:
        np.testing.assert_array_equal(ours(x, y), numpys(x, y))
        value, _, _ = tw.differentiate(ours, {"x": 5, "y": 5}, values=True)(x, y)
        np.testing.assert_array_equal(value, numpys(x, y))
    table = tw.differentiate(lambda x, y: tw.pointwise.maximum(x[:, None], y), {"x": 5, "y": 5}, values=True)(x, y)[0]
    np.testing.assert_array_equal(table, np.maximum(x[:, None], y))


def test_choices_at_their_edges():
    largest = tw.differentiate(tw.pointwise.maximum, {"x": (), "y": ()}, values=True)
    assert [float(f) for f in largest(2.0, 2.0)] == [2.0, 0.5, 0.5]
    chosen = tw.differentiate(lambda x: tw.pointwise.where_positive(x, x + 1.0, x - 1.0), {"x": ()}, values=True)
    assert [float(f) for f in chosen(0.0)] == [-1.0, 1.0]
    with np.errstate(all="ignore"):
        root = tw.differentiate(lambda x: tw.pointwise.where_positive(x, np.sqrt(x), 0.0), {"x": ()}, values=True)
        assert root([-1.0, 4.0])[0].tolist() == [0.0, 2.0]  # the other one is NaN
        assert np.isnan(chosen(np.nan)[0])


def test_zero_is_not_positive_on_numbers_either():
    np.testing.assert_array_equal(
        tw.pointwise.where_positive([-1.0, -0.0, 0.0, 1e-300], 1.0, 2.0), [2.0, 2.0, 2.0, 1.0]
    )


def test_a_clip_between_limits_that_are_reversed_is_the_upper_one():
    """A torque between limits that leave no room: the upper one, on numbers and on symbols, and it has no slope."""
    x = np.array([-2.0, 0.0, 2.0])
    np.testing.assert_array_equal(tw.pointwise.clip(x, 1.0, -1.0), [-1.0, -1.0, -1.0])
    value, slope = one(lambda x: tw.pointwise.clip(x, 1.0, -1.0))(x)
    np.testing.assert_array_equal(value, [-1.0, -1.0, -1.0])
    np.testing.assert_array_equal(slope, [0.0, 0.0, 0.0])


@pytest.mark.parametrize("jit", ["0", "1"])
def test_what_is_not_a_number_is_no_choice(jit, monkeypatch):
    """A gap of a log is not a torque within its limits; as NumPy has it, wherever the NaN stands."""
    monkeypatch.setenv("TWISTWRENCH_JIT", jit)
    numbers = [np.nan, 1.0, -1.0, np.inf, 0.0]
    x, y = (grid.ravel() for grid in np.meshgrid(numbers, numbers))
    choose = tw.pointwise
    for function in (
        lambda x, y: choose.maximum(x, y),
        lambda x, y: choose.minimum(x, y),
        lambda x, y: choose.maximum(x, 0.5) + choose.minimum(0.5, y),
        lambda x, y: choose.minimum(x, 0.5) + choose.maximum(0.5, y),
        lambda x, y: choose.clip(x, -0.5, y),
        lambda x, y: choose.clip(x, y, 0.5),
        lambda x, y: choose.maximum(x, np.nan) + y,
    ):
        with np.errstate(all="ignore"):
            np.testing.assert_array_equal(kernels(function)(np.stack([x, y], axis=1))[0], function(x, y))


def test_a_constant_that_is_not_a_number_is_traced_without_a_warning():
    """Comparisons with NaN set NumPy's flag of an invalid operation."""
    value, _ = tw.differentiate(lambda x: tw.pointwise.maximum(x, np.nan), {"x": 2}, values=True)([1.0, 2.0])
    assert np.isnan(value).all()


def test_functions_of_robots_take_choices():
    arm = tw.robots.planar_2r()

    def cost(q, dq):
        tau = arm.inverse_dynamics(q, dq, np.zeros(2))
        return np.sum(tw.pointwise.maximum(np.abs(tau) - 5.0, 0.0) ** 2) + np.log(1.0 + np.hypot(dq[0], dq[1]))

    q, dq, h = np.array([0.3, -0.7]), np.array([1.0, 0.5]), 1e-6
    slopes = tw.differentiate(cost, {"q": arm, "dq": 2})(q, dq)
    for k, step in enumerate(h * np.eye(2)):
        assert slopes[0][k] == pytest.approx((cost(q + step, dq) - cost(q - step, dq)) / (2 * h), rel=1e-6, abs=1e-6)
        assert slopes[1][k] == pytest.approx((cost(q, dq + step) - cost(q, dq - step)) / (2 * h), rel=1e-6, abs=1e-6)
