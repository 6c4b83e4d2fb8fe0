"""Lagrangians beside the beaten track: high powers, quotients of sums, functions and constants, and what no source can hold."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
import sympy

from twistwrench.core.errors import ShapeError, UnknownNameError, ValueRangeError
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


def compiled(source, folder, *flags):
    """The shared library that a C compiler makes of a source without a warning."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    (folder / "made.c").write_text(source, encoding="utf-8")
    flags = [*flags, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(folder / "made.c"), "-o", str(folder / "made.so"), "-lm"], check=True)
    return ctypes.CDLL(str(folder / "made.so"))


HOSTILE = """M_E M_PI M_1_PI NAN INFINITY HUGE_VAL HUGE I errno EOF NULL DOMAIN FP_NAN MATH_ERRNO OVERFLOW math_errhandling
    for int double restrict inline bool class lambda None True np float floor fma isnan signbit gamma j0 stdin linux unix
    parameters PARAMETERS batch out tau M C c g h p q dq ddq a-b a_b 2x θ _x __x EINVAL INT_MAX DBL_MAX""".split()  # noqa: SIM905


@pytest.mark.parametrize("standard", [["-std=c99"], [], ["-std=c11", "-include", "complex.h", "-include", "errno.h"]])
def test_symbols_may_be_called_as_macros_keywords_and_functions_are(standard, tmp_path):
    """Every hostile name is a constant of the Lagrangian, and the coordinate's and rate's names are two more of them."""
    symbols = [sympy.Symbol(name) for name in HOSTILE]
    q, dq = sympy.symbols("errno_1 M_2_SQRTPI")
    L = symbols[0] * dq**2 / 2 - sum((n + 2) * s * q for n, s in enumerate(symbols))
    system = lagrange(L, q, [dq], name="hostile")
    given = {s.name: 0.5 + n for n, s in enumerate(symbols)}
    wanted = given[symbols[0].name] * 3.0 + sum((n + 2) * (0.5 + n) for n in range(len(symbols)))
    assert system.function("inverse_dynamics")([0.1], [0.2], [3.0], given)[0] == pytest.approx(wanted, rel=1e-14)
    code = compiled(system.c_source("made"), tmp_path, *standard)
    ordered = sorted(given)
    p = (ctypes.c_double * len(given))(*(given[name] for name in ordered))
    assert f"p = ({', '.join(ordered)})" in system.c_source("made")
    tau = (ctypes.c_double * 1)()
    code.made_inverse_dynamics(*((ctypes.c_double * 1)(v) for v in (0.1, 0.2, 3.0)), p, tau)
    assert tau[0] == pytest.approx(wanted, rel=1e-14)


B, t = sympy.symbols("B t")
MAGNETIC = {
    "magnetic force": (m / 2 * (xdot**2 + ydot**2) + B / 2 * (x * ydot - y * xdot) - k * x**2, None),
    "magnetic force, not a polynomial": (m / 2 * (xdot**2 + ydot**2) + B * sympy.exp(x) * ydot, None),
    "driven": (m / 2 * ((xdot + sympy.cos(t)) ** 2 + ydot**2) - k * x * y, t),
    "mass that grows": (m * (1 + t**2) / 2 * (xdot**2 + ydot**2), t),
}


@pytest.mark.parametrize("case", MAGNETIC)
def test_bias_forces_are_all_of_tau_but_the_accelerations(case, tmp_path):
    """τ = M q̈ + h to rounding, in NumPy and in C; and where c and g are not all of h, no source says that they are."""
    L, time = MAGNETIC[case]
    system = lagrange(L, [x, y], time=time, name="charge")
    given = {s.name: 0.5 + 0.25 * n for n, s in enumerate(sorted(L.free_symbols - {x, y, xdot, ydot}, key=str))}
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 2))
    call = {n: system.function(n) for n in ("inverse_dynamics", "bias_forces", "mass_matrix", "coriolis_forces")}
    tau, h = call["inverse_dynamics"](q, dq, ddq, given), call["bias_forces"](q, dq, given)
    np.testing.assert_allclose(tau, call["mass_matrix"](q, given) @ ddq + h, rtol=1e-13)
    part = call["coriolis_forces"](q, dq, given) + system.function("gravity_forces")(q, given)
    assert np.abs(h - part).max() > 1e-3, "c and g are not all of it"
    assert not system.split
    for source in (system.numpy_source(), system.c_source()):
        assert "+ g(q)" not in source
        assert "h has terms besides c and g" in source
    code = compiled(system.c_source("made"), tmp_path, "-std=c99")
    vectors = [(ctypes.c_double * 2)(*v) for v in (q, dq)]
    p, out = (ctypes.c_double * len(given))(*(given[n] for n in sorted(given))), (ctypes.c_double * 2)()
    code.made_bias_forces(*vectors, p, out)
    np.testing.assert_allclose(list(out), h, rtol=1e-13)


def test_where_c_and_g_are_all_there_is_the_source_says_so():
    system = lagrange(free - k * x**2 / 2, x)
    assert system.split
    assert "h = c(q, dq) + g(q)." in system.c_source()
    assert "h = c(q, dq) + g(q)." in system.numpy_source()
    assert lagrange(free * sympy.exp(x) - k * sympy.sqrt(1 + x**2), x).split


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
