"""Lagrangians beside the beaten track: high powers, quotients of sums, functions and constants, and what no source can hold."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
import sympy

from twistwrench.errors import ShapeError, UnknownNameError, ValueRangeError
from twistwrench.symbolic import lagrange

m, k, n, a, b, c = sympy.symbols("m k n a b c")
x, xdot = sympy.symbols("x xdot", real=True)  # real, so that the derivative of Abs is sign
y, ydot = sympy.symbols("y ydot")
free = m * xdot**2 / 2


# ── high powers ──


def test_a_power_beyond_the_packed_exponents_does_not_reach_the_next_symbol():
    """294 = 6·7·7; the potential of y is y, whatever that of x."""
    V = ((x**7 + 1) ** 7 + 1) ** 6
    forces = lagrange(xdot**2 / 2 + ydot**2 / 2 - V - y, [x, y]).gravity_forces
    assert forces[1] == 1
    assert forces[0].subs(x, sympy.Rational(1, 2)) == V.diff(x).subs(x, sympy.Rational(1, 2))


@pytest.mark.parametrize("power", [248, 249, 250, 252, 254, 255, 256, 257])
def test_no_power_near_the_limit_overflows(power):
    """The mass matrix of x^n, differentiated and multiplied by rates: by hand n/2 x^(n-1) ẋ²."""
    product = sympy.Integer(1)
    for factor in (7,) * (power // 7) + (power % 7,):
        product = sympy.Mul(product, sympy.Pow(x, factor, evaluate=False), evaluate=False)
    system = lagrange(sympy.Mul(product, xdot**2 / 2, evaluate=False) + ydot**2 / 2 - y, [x, y])
    assert system.coriolis_forces[0].subs(x, 1) == sympy.Rational(power, 2) * xdot**2
    assert system.gravity_forces[1] == 1


# ── brackets ──


@pytest.mark.parametrize(
    ("L", "text"),
    [
        (free - (a + b) / (c + x), "½ m ẋ² − (a + b)/(c + x)"),
        (free + (a + b) / x, "½ m ẋ² + (a + b)/x"),
        (free - (a + b) * c / x, "½ m ẋ² − c (a + b)/x"),
        (free + sympy.Mul(-1, a + x, evaluate=False), "½ m ẋ² − (a + x)"),
        (free - a / (2 * x), "½ m ẋ² − ½ a/x"),
    ],
)
def test_sums_stand_in_brackets_over_a_stroke_and_after_a_minus(L, text):
    assert lagrange(L, x).text("lagrangian").splitlines()[1].strip() == f"L = {text}"


def test_a_fraction_bar_needs_no_brackets():
    system = lagrange(free - (a + b) / (c + x), x)
    assert r"\frac{a + b}{c + x}" in system.latex("lagrangian")
    assert "(" not in system.html("lagrangian").partition("<mfrac>")[2].partition("</mfrac>")[0]


# ── functions and constants in sources ──

POTENTIALS = {
    "sqrt": k / 2 * (sympy.sqrt(x**2 + 1) - 1) ** 2,
    "inverse sqrt": k / sympy.sqrt(x**2 + 2),
    "power": k * x**n,
    "constants": sympy.pi * x**2 + sympy.E * sympy.GoldenRatio * x + k * sympy.exp(x) * sympy.sqrt(2),
    "abs": k * sympy.Abs(x) ** 3 + sympy.Abs(x - 5),
    "inverse trigonometric": k * (sympy.asin(x / 3) + sympy.atan(x) + sympy.atan2(x, 2) * sympy.acos(x / 4)),
    "hyperbolic": sympy.log(sympy.cosh(x)) + sympy.sinh(x) * sympy.tanh(x) + sympy.asinh(x) + sympy.atanh(x / 2),
    "trigonometric": sympy.tan(x / 2) * sympy.sin(x) + k * sympy.acosh(x + 2),
    "quotient": -(a + b) / (c + x) - (x - a) / (b + 2 * x) ** 2,
}
VALUES = {"m": 2.0, "k": 3.0, "n": 2.5, "a": 1.5, "b": 0.75, "c": 0.3}


@pytest.mark.parametrize("name", POTENTIALS)
def test_sources_have_the_values_of_sympy(name, tmp_path):
    """g = dV/dx at twenty digits; a source rounds some twenty operations."""
    V = POTENTIALS[name]
    system = lagrange(free - V, x)
    constants = sorted({s.name for s in (free - V).free_symbols - {x, xdot}})
    wanted = float(V.diff(x).subs({s: VALUES[s] for s in constants}).subs(x, 0.6).evalf(20))
    given = {s: VALUES[s] for s in constants}
    assert system.function("gravity_forces")([0.6], given)[0] == pytest.approx(wanted, rel=1e-14)
    source = system.c_source("made")
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    (tmp_path / "made.c").write_text(source, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(tmp_path / "made.c"), "-o", str(tmp_path / "made.so"), "-lm"], check=True)
    numbers = (ctypes.c_double * len(constants))(*given.values())
    out = (ctypes.c_double * 1)()
    assert f"p = ({', '.join(constants)})" in source
    ctypes.CDLL(str(tmp_path / "made.so")).made_gravity_forces((ctypes.c_double * 1)(0.6), numbers, out)
    assert out[0] == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("at", [-1.0, 0.0, 1.0])
def test_the_derivative_of_abs_is_the_sign(at):
    system = lagrange(free - k * sympy.Abs(x), x)
    assert system.function("gravity_forces")([at], {"m": 1.0, "k": 3.0})[0] == 3.0 * np.sign(at)


def test_constants_named_as_functions_of_c_are_renamed():
    fabs, tanh = sympy.symbols("fabs tanh")
    system = lagrange(free - fabs * sympy.Abs(x) - tanh * sympy.tanh(x), x)
    assert "const double fabs =" not in system.c_source()
    assert "const double tanh =" not in system.c_source()


@pytest.mark.parametrize(
    ("V", "named"),
    [
        (sympy.cot(x), "cot"),
        (sympy.Piecewise((x**2, x > 0), (x**3, True)), "Piecewise"),
        (sympy.Max(a, b) * x, "Max"),
        (sympy.Max(x, 0) ** 2, "Heaviside"),
        (sympy.zeta(x), "Derivative"),
        (sympy.I * x, "I"),
        (sympy.erf(y) * x, "erf"),
        (sympy.oo * sympy.Abs(x), "oo"),
        (sympy.Integer(10) ** 400 * x, "1000"),
    ],
)
def test_what_a_source_cannot_hold_is_named(V, named):
    system = lagrange(free - V, x)
    for source in (system.numpy_source, system.c_source):
        with pytest.raises(ValueRangeError, match=rf"{named}.*cannot be written as source"):
            source()
    with pytest.raises(ValueRangeError, match=named):
        system.function("gravity_forces")


# ── what is no Lagrangian ──


@pytest.mark.parametrize(
    "L",
    [
        "m*xdot**2/2",
        sympy.Eq(free, 0),
        sympy.Matrix([free]),
        sympy.MatrixSymbol("A", 2, 2),
        [free],
        None,
        True,
        free > 0,
    ],
)
def test_only_an_expression_is_a_lagrangian(L):
    with pytest.raises(ShapeError, match="SymPy expression"):
        lagrange(L, x)


def test_strings_are_not_evaluated(tmp_path):
    with pytest.raises(ShapeError, match="str"):
        lagrange(f"__import__('pathlib').Path({str(tmp_path / 'made')!r}).touch()", x)
    assert not (tmp_path / "made").exists()


def test_names_that_are_none_are_refused():
    system = lagrange(free - k * x, x)
    with pytest.raises(ValueRangeError, match="prefix=3"):
        system.c_source(3)
    for wrong in (3, [3], 2.5):
        with pytest.raises(UnknownNameError, match="gravity_forces"):
            system.text(wrong)
    for wrong in ([], {}, 3, None):
        with pytest.raises(UnknownNameError, match="inverse_dynamics"):
            system.function(wrong)
