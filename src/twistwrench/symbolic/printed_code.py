"""Equations as straight-line statements, and those as a Python module that needs NumPy only."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .equations import Equations

FUNCTIONS = {
    "inverse_dynamics": (("q", "dq", "ddq"), "tau", 1, "tau = M(q) ddq + h(q, dq)"),
    "bias_forces": (("q", "dq"), "h", 1, "h, all of tau but M ddq"),
    "mass_matrix": (("q",), "M", 2, "M, symmetric and full"),
    "coriolis_forces": (("q", "dq"), "c", 1, "c, the velocity products"),
    "coriolis_matrix": (("q", "dq"), "C", 2, "C with C dq = c and dM/dt - 2C skew"),
    "gravity_forces": (("q",), "g", 1, "g, what is left at rest"),
}
"""Name of each function → its arrays in, its array out, how many axes that has, and what it is."""

_FIELDS = {"inverse_dynamics": "tau", "bias_forces": "tau"}
_RESERVED = frozenset(
    """q dq ddq tau M C c g h p out batch parameters PARAMETERS np float ValueError f math double int char const void
    return if else for while do long short signed unsigned static struct union enum switch case default break
    continue goto auto register volatile extern inline restrict sizeof typedef asm typeof fortran bool true false
    nullptr alignas alignof constexpr thread_local static_assert typeof_unqual complex imaginary noreturn class new
    delete this namespace template typename operator private protected public friend virtual explicit export mutable
    using try catch throw and or not xor bitand bitor compl and_eq or_eq xor_eq not_eq wchar_t main sin cos tan asin
    acos atan atan2 sinh cosh tanh asinh acosh atanh sincos exp exp2 exp10 expm1 log log2 log10 log1p logb ilogb pow
    pow10 sqrt cbrt hypot fabs fmod fmin fmax fma fdim floor ceil round trunc rint nearbyint lround llround lrint
    llrint modf remainder remquo drem frexp ldexp scalb scalbn scalbln significand copysign nan nextafter nexttoward
    gamma lgamma tgamma erf erfc j0 j1 jn y0 y1 yn isnan isinf isfinite isnormal signbit fpclassify finite signgam
    matherr float_t double_t math_errhandling abs labs div errno stdin stdout stderr I NAN INFINITY NULL EOF DOMAIN
    SING OVERFLOW UNDERFLOW PLOSS TLOSS X_TLOSS MAXFLOAT HUGE linux unix i386 near far huge min max""".split()  # noqa: SIM905
)
"""What means something else in Python, C or C++, in their mathematics headers, or in the functions written here."""
_MACRO = re.compile(r"(M_\w*[A-Z]|FP_|HUGE_|MATH_|DBL_|FLT_|LDBL_|INT|UINT|SIZE_|E[A-Z0-9]{3,}$)\w*")
"""Names that mathematics headers keep for macros: M_PI, FP_NAN, HUGE_VAL, and those of limits and errors beside them."""


@dataclass(frozen=True)
class Routine:
    """One function as statements: what it reads, in which names, the lines in order, the results."""

    name: str
    inputs: tuple[tuple[str, int, str], ...]
    """Array (q, dq, ddq, p), index, and the name for it."""
    lines: tuple[tuple[str, Any], ...]
    results: tuple[Any, ...]
    """In C order; every symbol has its safe name."""


def ordered_names(equations: Equations) -> dict[Any, str]:
    """A safe and unused name for every symbol."""
    taken: set[str] = set()
    names = {}
    symbols = [
        *equations.q,
        *equations.dq,
        *equations.ddq,
        *constants(equations),
        *(s for s, _ in equations.definitions),
    ]
    for symbol in symbols:
        name = re.sub(r"\W", "_", symbol.name, flags=re.ASCII)
        name = name if re.match(r"[A-Za-z]", name) else f"v{name}"
        name = f"{name}_" if _MACRO.fullmatch(name) else name
        while name in taken or name in _RESERVED or keyword.iskeyword(name):
            name += "_"
        taken.add(name)
        names[symbol] = name
    return names


def constants(equations: Equations) -> list[Any]:
    """The symbols that are neither coordinates nor definitions, the parameters first, in order."""
    known = {*equations.q, *equations.dq, *equations.ddq, *(s for s, _ in equations.definitions)}
    ordered = [s for s in equations.values if s not in known]
    exprs = [*equations.tau, *equations.mass_matrix, *(e for _, e in equations.definitions)]
    free = {s for e in exprs for s in e.free_symbols} - known - set(ordered)
    return [*ordered, *sorted(free, key=str)]


def routine(equations: Equations, name: str, names: dict[Any, str]) -> Routine:
    """The statements of one function: the definitions it needs, then what its results share."""
    import sympy

    safe = {symbol: sympy.Symbol(text) for symbol, text in names.items()}
    field, definitions = getattr(equations, _FIELDS.get(name, name)), equations.definitions
    results = [field[place] for place in np.ndindex(tuple(int(n) for n in field.shape))]
    if name == "bias_forces":
        at_rest = dict.fromkeys(equations.ddq, sympy.Integer(0))
        results = [e.subs(at_rest) for e in results]
        definitions = tuple((s, e.subs(at_rest)) for s, e in definitions)
    needed = _needed(definitions, results)
    exprs = [e for _, e in needed] + results
    exprs = [e.xreplace(safe) for e in exprs]
    fresh = (s for s in sympy.numbered_symbols("k") if s.name not in set(names.values()))
    if needed:  # the definitions are what is shared
        lines = [(names[s], e) for (s, _), e in zip(needed, exprs, strict=False)]
        results = exprs[len(needed) :]
    else:
        shared, results = sympy.cse(exprs, symbols=fresh, order="none")
        lines = [(s.name, e) for s, e in shared]
    used = {s.name for e in [*(e for _, e in lines), *results] for s in e.free_symbols}
    inputs = []
    for array, symbols in (
        ("q", equations.q),
        ("dq", equations.dq),
        ("ddq", equations.ddq),
        ("p", constants(equations)),
    ):
        inputs += [(array, k, names[s]) for k, s in enumerate(symbols) if names[s] in used]
    return Routine(name, tuple(inputs), tuple(lines), tuple(results))


def _needed(definitions: tuple[tuple[Any, Any], ...], results: list[Any]) -> list[tuple[Any, Any]]:
    """The definitions that the results depend on, in order."""
    wanted = {s for e in results for s in e.free_symbols}
    kept = []
    for symbol, expr in reversed(definitions):
        if symbol in wanted:
            kept.append((symbol, expr))
            wanted |= expr.free_symbols
    return kept[::-1]


def header(equations: Equations) -> list[str]:
    """Sentences for the top of a file of source."""
    from .documents import remarks_of

    split = "h = c(q, dq) + g(q)"
    if not equations.split:
        split = "h has more in it than c and g: what is linear in the rates, or due to time"
    lines = [
        f"Equations of motion of {equations.name}: {FUNCTIONS['inverse_dynamics'][3]}. SI units, radians.",
        f"{split}.",
    ]
    for array, symbols in (("q", equations.q), ("dq", equations.dq), ("ddq", equations.ddq)):
        lines.append(f"{array} = ({', '.join(s.name for s in symbols)})")
    lines += [f"{name}: {meaning}" for name, meaning in equations.meanings]
    return [*lines, *remarks_of(equations)]


def unused(names: Iterable[str], made: Routine) -> list[str]:
    """Those arrays that a function does not read."""
    read = {array for array, _, _ in made.inputs}
    return [name for name in names if name not in read]
