"""What ``lagrange`` is given: symbols, a Lagrangian of those alone, and perhaps a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..errors import ShapeError, ValueRangeError


def symbols_of(given: Any, what: str) -> tuple[Any, ...]:
    """One symbol or several different ones, as a tuple; ShapeError for anything else."""
    import sympy

    symbols = (
        (given,)
        if isinstance(given, sympy.Symbol)
        else tuple(given)
        if isinstance(given, Sequence | sympy.MatrixBase | sympy.Tuple)
        else ()
    )
    if not symbols or not all(isinstance(s, sympy.Symbol) for s in symbols) or len(set(symbols)) < len(symbols):
        raise ShapeError(
            f"{what}={given!r} are not different SymPy symbols. Write theta instead of theta(t): the rates are symbols of "
            "their own, theta, thetadot = sympy.symbols('theta thetadot')."
        )
    return symbols


def time_of(given: Any, moving: tuple[Any, ...]) -> Any:
    """The symbol of time, None where there is none; ShapeError for what is no symbol, or a coordinate or rate."""
    import sympy

    if given is None:
        return None
    if not isinstance(given, sympy.Symbol) or given in moving:
        raise ShapeError(
            f"time={given!r} is not a SymPy symbol other than {', '.join(map(str, moving))}. Give t = sympy.Symbol('t')."
        )
    return given


def check_lagrangian(L: Any, q: tuple[Any, ...], dq: tuple[Any, ...], time: Any) -> None:
    """ValueRangeError for what would be taken for a constant and is none, and for an L without kinetic energy."""
    import sympy

    if found := L.atoms(sympy.core.function.AppliedUndef, sympy.Derivative):
        raise ValueRangeError(
            f"L contains {_listed(found)}. Write coordinates and rates as symbols, theta and thetadot instead of theta(t) "
            "and its derivative: L.subs({theta(t).diff(t): thetadot}).subs({theta(t): theta})."
        )
    known = {*q, *dq, *(() if time is None else (time,))}
    others = L.free_symbols - known
    names = {s.name for s in known}
    if twins := {s for s in others if s.name in names}:
        raise ValueRangeError(
            f"L contains another {_listed(twins)} than the coordinates, rates or time given: symbols of one name with "
            "different assumptions (real=True) differ in SymPy. Make each symbol once."
        )
    if moving := {s for s in others if _is_rate(s.name)}:
        raise ValueRangeError(
            f"L contains {_listed(moving)}, by name the rate of a coordinate that is not in q={_listed(q)}, or a derivative "
            f"of too high an order: L may depend on the rates {_listed(dq)}. Add the coordinate to q, name rates of other "
            "names in rates=[…], or give a constant a name that does not end in dot."
        )
    if time is None and (clocks := {s for s in others if s.name == "t"}):
        raise ValueRangeError(
            f"L contains {_listed(clocks)}. Is it the time? Then say so, time=t; if it is a constant, give it another name."
        )
    if not L.free_symbols & set(dq):
        raise ValueRangeError(
            f"L does not depend on {', '.join(map(str, dq))}, so there is no kinetic energy. Name the rates so, or give "
            "them: lagrange(L, q, rates=[…])."
        )


def _is_rate(name: str) -> bool:
    """By the naming rule, xdot and thetaddot_1; and by a likely other one, theta_1dot and x_dot."""
    stem = name.partition("_")[0]
    return any(word.endswith("dot") and word != "dot" for word in (stem, name))


def _listed(symbols: Any) -> str:
    return ", ".join(sorted(map(str, symbols)))
