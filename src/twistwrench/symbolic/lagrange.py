"""Lagrange's equations for any Lagrangian and any coordinates: a bead on a wire, a cart with a pole, a robot."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from numbers import Real
from typing import Any

import numpy as np

from ..core.errors import ShapeError, ValueRangeError
from .coordinates import Variable, rate_symbol
from .equations import Equations, Label, Step, assemble_equations, equation_fields, weighted_sum
from .expanded_form import Terms
from .factored_form import EquationWriter
from .names import names_of, require_sympy, sympy
from .trig_polynomial import HIGHEST, Ring, TrigPolynomial


def symbols_of(value: Any, what: str) -> tuple[Any, ...]:
    """Tuple of one symbol, or of several different symbols; raises ShapeError for other input. ``what`` names the argument."""
    symbols: tuple[Any, ...] = ()
    if isinstance(value, sympy.Symbol):
        symbols = (value,)
    elif isinstance(value, Sequence | sympy.MatrixBase | sympy.Tuple):
        symbols = tuple(value)
    all_are_symbols = all(isinstance(entry, sympy.Symbol) for entry in symbols)
    if not symbols or not all_are_symbols or len(set(symbols)) < len(symbols):
        raise ShapeError(
            f"{what}={value!r} are not different SymPy symbols. Write theta instead of theta(t): the rates are symbols of "
            "their own, theta, thetadot = sympy.symbols('theta thetadot')."
        )
    return symbols


def time_of(value: Any, moving: tuple[Any, ...]) -> Any:
    """Symbol of time; None if there is none.

    ``moving`` are the coordinates and their rates. Raises ShapeError for one of these, and for other input.
    """
    if value is None:
        return None
    if not isinstance(value, sympy.Symbol) or value in moving:
        raise ShapeError(
            f"time={value!r} is not a SymPy symbol other than {', '.join(map(str, moving))}. Give t = sympy.Symbol('t')."
        )
    return value


def check_lagrangian(L: Any, q: tuple[Any, ...], dq: tuple[Any, ...], time: Any) -> None:
    """Raise ValueRangeError for an L without kinetic energy, with functions, or with symbols that are surely mistaken.

    Mistaken symbols look like unlisted rates or like time, or have the name of a listed symbol but other assumptions.
    """
    functions = L.atoms(sympy.core.function.AppliedUndef, sympy.Derivative)
    if functions:
        raise ValueRangeError(
            f"L contains {_symbols_text(functions)}. Write coordinates and rates as symbols, theta and thetadot instead of "
            "theta(t) and its derivative: L.subs({theta(t).diff(t): thetadot}).subs({theta(t): theta})."
        )
    listed_symbols = {symbol.name: symbol for symbol in (*q, *dq)}
    if time is not None:
        listed_symbols[time.name] = time
    namesakes: set[Any] = set()
    unlisted_rates: set[Any] = set()
    times: set[Any] = set()  # symbols named t
    for symbol in L.free_symbols - set(listed_symbols.values()):
        if symbol.name in listed_symbols:
            namesakes.add(symbol)
        # Rates by the naming rule (xdot, thetaddot_1), or with "dot" at the end (theta_1dot, x_dot).
        if re.fullmatch(r"[^_]+dot(_.*)?|.+dot", symbol.name, flags=re.DOTALL):
            unlisted_rates.add(symbol)
        if symbol.name == "t":
            times.add(symbol)
    if namesakes:
        raise ValueRangeError(
            f"L contains another {_symbols_text(namesakes)} than the coordinates, rates or time given: symbols of one name "
            "with different assumptions (real=True) differ in SymPy. Make each symbol once."
        )
    if unlisted_rates:
        raise ValueRangeError(
            f"L contains {_symbols_text(unlisted_rates)}, by name the rate of a coordinate that is not in "
            f"q={_symbols_text(q)}, or a derivative of too high an order: L may depend on the rates {_symbols_text(dq)}. Add "
            "the coordinate to q, name rates of other names in rates=[…], or give a constant a name that does not end in dot."
        )
    if time is None and times:
        raise ValueRangeError(
            f"L contains {_symbols_text(times)}. If it is the time, pass time=t; if it is a constant, give it another name."
        )
    if not L.free_symbols & set(dq):
        rate_names = ", ".join(map(str, dq))
        raise ValueRangeError(
            f"L does not depend on {rate_names}, so there is no kinetic energy. Name the rates so, or give "
            "them: lagrange(L, q, rates=[…])."
        )


def _symbols_text(symbols: Any) -> str:
    """Names of symbols in alphabetical order, separated by commas."""
    return ", ".join(sorted(map(str, symbols)))


def lagrange(L: Any, q: Any, rates: Any = None, *, time: Any = None, name: str = "system") -> Equations:
    """Lagrange's equations d/dt ∂L/∂q̇ - ∂L/∂q = τ of a Lagrangian L(q, q̇, t), a SymPy expression (MR eq. 8.2 and 8.3).

    Every other symbol is a constant. Terms of L besides ½ q̇'M q̇ and a potential are included: terms linear in the
    rates appear in the equations, and g contains all torques at rest, including centrifugal forces of a rotating wire.

    Parameters
    ----------
    L : SymPy expression
    q : coordinates, independent SymPy symbols
    rates : symbols of their rates in L, optional
        Default: the naming rule theta_1 → thetadot_1, x → xdot. Accelerations are called thetaddot_1, xddot.
    time : symbol of time, optional, if L depends on it
        The equations then include ∂/∂t of the momenta as a separate step.
    name : str, of the system

    Returns
    -------
    equations : Equations

    Raises
    ------
    ValueRangeError
        L depends on none of the rates, on rates of coordinates that are not listed, on accelerations, or on a ``t``
        without ``time=``.
    MissingExtraError
        SymPy is not installed.

    Examples
    --------
    >>> import sympy
    >>> m, R, g, Omega, theta, thetadot = sympy.symbols("m R g Omega theta thetadot")
    >>> bead = lagrange(m*R**2/2*(thetadot**2 + Omega**2*sympy.sin(theta)**2) + m*g*R*sympy.cos(theta), theta)
    >>> print(bead.text("gravity_forces"))
    gravity_forces: g, torques at rest
      g₁ = m g R sin(θ) − m Ω² R² cos(θ) sin(θ)
    """
    require_sympy()
    L = _expression(L)
    coordinates = symbols_of(q, "q")
    velocities = _rates(rates, coordinates, L)
    time_symbol = time_of(time, (*coordinates, *velocities))
    check_lagrangian(L, coordinates, velocities, time_symbol)
    if time_symbol not in L.free_symbols:  # L does not depend on time
        time_symbol = None
    acceleration_names = [rate_symbol(coordinate.name, "ddot") for coordinate in coordinates]
    accelerations = tuple(map(sympy.Symbol, acceleration_names))
    sum_of_products = None  # terms and expressions of L, if it has this form
    if time_symbol is None:
        sum_of_products = _read_sum_of_products(L, coordinates, velocities, accelerations)
    if sum_of_products is None:
        fields = _differentiate(L, coordinates, velocities, accelerations, time_symbol)
    else:
        terms, expressions = sum_of_products
        # Symbols named m… are masses, except mu…
        masses = [symbol for symbol in terms.ring.symbols if symbol.startswith("m") and not symbol.startswith("mu")]
        writer = EquationWriter(terms.ring, masses=masses, expressions=expressions)
        fields = assemble_equations(terms, writer)
    lagrangian_step = Step("lagrangian", "as given", ((Label("L"), L),))
    fields = {**fields, "lagrangian": L, "steps": (lagrangian_step, *fields["steps"])}
    meanings = tuple((coordinate.name, "coordinate") for coordinate in coordinates)
    return Equations(name=name, q=coordinates, dq=velocities, ddq=accelerations, meanings=meanings, **fields)


def _expression(L: Any) -> Any:
    """L as a SymPy expression; raises ShapeError for other input. Strings are refused: SymPy would run them as Python."""
    is_number = isinstance(L, Real) and not isinstance(L, bool)
    if is_number:
        return sympy.sympify(L)
    if not isinstance(L, sympy.Expr) or L.is_Matrix:
        shortened = str(L)[:80]
        raise ShapeError(
            f"a Lagrangian is one SymPy expression, got {type(L).__name__} {shortened!r}. "
            "Make it of sympy.symbols; give K - P of an equation, and the single entry of a matrix."
        )
    return L


def _rates(rates: Any, coordinates: tuple[Any, ...], L: Any) -> tuple[Any, ...]:
    """Symbols of the rates: those given, or those with names by the naming rule."""
    if rates is None:
        symbols_by_name = {symbol.name: symbol for symbol in L.free_symbols}  # may have assumptions, as real=True
        velocities = []
        for coordinate in coordinates:
            name = rate_symbol(coordinate.name)
            velocities.append(symbols_by_name.get(name, sympy.Symbol(name)))
        return tuple(velocities)
    symbols = symbols_of(rates, "rates")
    has_coordinates = bool(set(symbols) & set(coordinates))
    if len(symbols) != len(coordinates) or has_coordinates:
        coordinate_names = ", ".join(map(str, coordinates))
        raise ShapeError(f"rates={rates!r}: one symbol for each of {coordinate_names}, and none of these.")
    return symbols


def _read_sum_of_products(
    L: Any, q: tuple[Any, ...], dq: tuple[Any, ...], ddq: tuple[Any, ...]
) -> tuple[Terms, Mapping[str, Any]] | None:
    """L as a sum of products, and the SymPy expression of each symbol of its ring by name; None if L has another form."""
    atoms: dict[Any, str] = {symbol: symbol.name for symbol in (*q, *dq, *ddq)}
    is_polynomial = _collect_atoms(L, {*q, *dq}, atoms)
    have_different_names = len(set(atoms.values())) == len(atoms)
    if not (is_polynomial and have_different_names):
        return None
    if _max_exponent(L, atoms) > HIGHEST - _EXPONENT_INCREASE:
        return None
    names, rates, accelerations = names_of(q), names_of(dq), names_of(ddq)
    ring = Ring(list(atoms.values()), names, exact=True)
    try:
        total = _polynomial(L, ring, atoms, q)
    except sympy.PolynomialError:
        return None
    for monomial in total.split(rates):
        degree_in_rates = sum(ring.exponents(monomial).values())
        if degree_in_rates > 2:  # not a kinetic energy
            return None
    coordinates = tuple(map(Variable, names, rates, accelerations))
    terms = Terms(ring, coordinates, total, ring.number(0))  # all of L in the kinetic part, zero as the potential
    expressions = {symbol: expr for expr, symbol in atoms.items()}
    return terms, expressions


def _collect_atoms(expr: Any, moving: set[Any], atoms: dict[Any, str]) -> bool:
    """Add the constants of an expression to ``atoms``, each with a name; False if the expression is not polynomial in them.

    Constants are symbols, and subexpressions without ``moving`` symbols that are not polynomial, such as √(1 + a). Sines and
    cosines of ``moving`` symbols count as polynomial.
    """
    if expr.is_Rational or expr in atoms:
        return True
    if expr.is_Symbol:
        atoms[expr] = expr.name
        return True
    if expr.is_Add or expr.is_Mul:
        return all(_collect_atoms(operand, moving, atoms) for operand in expr.args)
    if expr.is_Pow and expr.exp.is_Integer and 0 < expr.exp <= _MAX_POWER:
        return _collect_atoms(expr.base, moving, atoms)
    is_constant = not expr.free_symbols & moving
    if is_constant:
        atoms[expr] = f"constant{len(atoms)}"
        return True
    return expr.func.__name__ in ("sin", "cos")


_MAX_POWER = 7
"""Largest exponent that is multiplied out."""
_EXPONENT_INCREASE = 4
"""Upper bound of the increase of exponents by Lagrange's equations: c multiplies by two rates, d/dt ∂L/∂q̇ by one."""


def _max_exponent(expr: Any, atoms: Mapping[Any, str]) -> int:
    """Upper bound of the exponents of an expression after expansion."""
    if expr in atoms:
        return 1
    if expr.is_Add or expr.is_Mul:
        exponents = [_max_exponent(operand, atoms) for operand in expr.args]
        return max(exponents) if expr.is_Add else sum(exponents)
    if expr.is_Pow:
        return int(expr.exp) * _max_exponent(expr.base, atoms)
    return 0


def _polynomial(L: Any, ring: Ring, atoms: Mapping[Any, str], q: tuple[Any, ...]) -> TrigPolynomial:
    """L as a sum of products. Raises SymPy's PolynomialError for an angle that is not a sum of multiples of coordinates."""

    def read(expr: Any) -> TrigPolynomial:
        """Polynomial of a subexpression of L."""
        if expr.is_Rational:
            return ring.number(Fraction(int(expr.p), int(expr.q)))
        if expr in atoms:
            return ring.symbol(atoms[expr])
        if expr.is_Add:
            return sum(map(read, expr.args), ring.number(0))
        if expr.is_Mul:
            return math.prod(map(read, expr.args), start=ring.number(1))
        if expr.is_Pow:
            factors = [read(expr.base)] * int(expr.exp)
            return math.prod(factors, start=ring.number(1))
        return read_sine_or_cosine(expr)

    def read_sine_or_cosine(expr: Any) -> TrigPolynomial:
        """Polynomial of sin(…) or cos(…), whose angle is a sum of multiples of coordinates."""
        (angle,) = expr.args
        multiples = [sympy.Poly(angle, *q).coeff_monomial(coordinate) for coordinate in q]
        remainder = sympy.expand(angle - weighted_sum(multiples, q))
        if remainder != 0 or not all(multiple.is_Integer for multiple in multiples):
            raise sympy.PolynomialError(f"{expr}: the angle is not a sum of whole multiples of coordinates")
        return ring.wave(expr.func.__name__, list(map(int, multiples)))

    return read(L)


def _differentiate(
    L: Any, q: tuple[Any, ...], dq: tuple[Any, ...], ddq: tuple[Any, ...], time: Any = None
) -> dict[str, Any]:
    """Fields of the equations by SymPy's derivatives; ``time`` is None if L does not depend on it."""
    n = len(q)
    matrix = sympy.ImmutableMatrix
    momenta = list(map(L.diff, dq))  # ∂L/∂q̇
    slopes = list(map(L.diff, q))  # ∂L/∂q
    zero_rates = dict.fromkeys(dq, 0)
    M = matrix(n, n, lambda i, j: sympy.expand(momenta[i].diff(dq[j])))
    is_quadratic = not M.free_symbols & set(dq)
    for i, momentum in enumerate(momenta):
        rest_momentum = sympy.expand(momentum - weighted_sum(M.row(i), dq))
        if rest_momentum.free_symbols & set(dq):
            rest_momentum = sympy.simplify(rest_momentum)
        is_quadratic &= not rest_momentum.free_symbols & set(dq)  # that of √ẋ² jumps at rest, where M is 0
    if not is_quadratic:
        raise ValueRangeError(
            "L is not a polynomial of degree two in the rates, so its equations have no mass matrix of the coordinates alone. "
            "Use kinetic energies ½ q̇'M q̇."
        )
    momentum_rates = []
    explicit_time = []  # label and expression of the ∂/∂t of each momentum that depends on time
    for momentum, rate in zip(momenta, dq, strict=True):
        chain_rule = []  # terms of the momentum's rate
        for x, v, a in zip(q, dq, ddq, strict=True):
            chain_rule.append(momentum.diff(x) * v + momentum.diff(v) * a)
        explicit_rate = sympy.Integer(0)
        if time is not None:
            explicit_rate = sympy.expand(momentum.diff(time))
        if explicit_rate != 0:
            explicit_time.append((Label("L", rate.name, time=time.name), explicit_rate))
        momentum_rates.append(sympy.Add(explicit_rate, *chain_rule))
    gamma = _christoffel_symbols(M, q)
    C = matrix(n, n, lambda i, j: weighted_sum(gamma[i, j], dq))
    c, g, tau = [], [], []
    is_standard = True  # the split τ = M q̈ + c + g holds for all coordinates
    for i in range(n):
        c.append(sympy.expand(weighted_sum(C.row(i), dq)))
        g.append(-slopes[i].subs(zero_rates))
        torque = sympy.expand(momentum_rates[i] - slopes[i])
        tau.append(sympy.collect(torque, (*ddq, *dq)))
        standard_torque = sympy.Add(weighted_sum(M.row(i), ddq), c[i], g[i])
        is_standard &= bool(sympy.expand(tau[i] - standard_torque) == 0)
    fields = equation_fields(
        names_of(q), names_of(dq), M, gamma, C, matrix(c), matrix(g), matrix(tau), momenta, momentum_rates, slopes,
        explicit_time=explicit_time,
    )  # fmt: skip
    return {**fields, "split": is_standard}


def _christoffel_symbols(M: Any, q: tuple[Any, ...]) -> Any:
    """Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i) of a mass matrix M: an ImmutableDenseNDimArray (n, n, n)."""
    n = len(q)
    dM = np.empty((n, n, n), object)  # ∂M_ij/∂q_k
    for i, j, k in np.ndindex(n, n, n):
        dM[i, j, k] = M[i, j].diff(q[k])
    half = sympy.Rational(1, 2)
    symbols = []
    for i, j, k in np.ndindex(n, n, n):
        symbols.append(sympy.expand(half * (dM[i, j, k] + dM[i, k, j] - dM[j, k, i])))
    return sympy.ImmutableDenseNDimArray(symbols, (n, n, n))
