"""Equations as source code: straight-line routines in C99, and in a Python module that needs only NumPy."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import ValueRangeError
from ..core.text import visible
from .documents import remarks_of
from .names import sympy

if TYPE_CHECKING:
    from .equations import Equations

FUNCTIONS = {
    "inverse_dynamics": (("q", "dq", "ddq"), "tau", 1, "tau = M(q) ddq + h(q, dq)"),
    "bias_forces": (("q", "dq"), "h", 1, "h = tau - M ddq"),
    "mass_matrix": (("q",), "M", 2, "M, symmetric and full"),
    "coriolis_forces": (("q", "dq"), "c", 1, "c, the velocity products"),
    "coriolis_matrix": (("q", "dq"), "C", 2, "C with C dq = c and dM/dt - 2C skew"),
    "gravity_forces": (("q",), "g", 1, "g, torques at rest"),
}
"""For each function name: input arrays, output array, its number of axes, and description."""

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
"""Reserved words of Python, C and C++, names in their mathematics headers, and names used in the functions written here."""
_MACRO = re.compile(r"(M_\w*[A-Z]|FP_|HUGE_|MATH_|DBL_|FLT_|LDBL_|INT|UINT|SIZE_|E[A-Z0-9]{3,}$)\w*")
"""Names that mathematics headers reserve for macros: M_PI, FP_NAN, HUGE_VAL, limits and error codes."""


@dataclass(frozen=True)
class Routine:
    """Function as statements: named inputs, ordered lines and results."""

    name: str
    inputs: tuple[tuple[str, int, str], ...]
    """Array (q, dq, ddq, p), index, and local name."""
    lines: tuple[tuple[str, Any], ...]
    results: tuple[Any, ...]
    """Results in C order, with safe names for all symbols."""


def ordered_names(equations: Equations) -> dict[Any, str]:
    """Safe, unused name for every symbol."""
    used: set[str] = set()
    names = {}
    moving = (*equations.q, *equations.dq, *equations.ddq)
    for symbol in (*moving, *constants(equations), *(s for s, _ in equations.definitions)):
        name = re.sub(r"\W", "_", symbol.name, flags=re.ASCII)
        if not re.match(r"[A-Za-z]", name):
            name = f"v{name}"
        if _MACRO.fullmatch(name):
            name = f"{name}_"
        while name in used or name in _RESERVED or keyword.iskeyword(name):
            name += "_"
        used.add(name)
        names[symbol] = name
    return names


def constants(equations: Equations) -> list[Any]:
    """Symbols that are neither coordinates nor definitions, parameters first, in order."""
    known = {*equations.q, *equations.dq, *equations.ddq, *(s for s, _ in equations.definitions)}
    ordered = [s for s in equations.values if s not in known]
    exprs = [*equations.tau, *equations.mass_matrix, *(e for _, e in equations.definitions)]
    free = {s for e in exprs for s in e.free_symbols} - known - set(ordered)
    return [*ordered, *sorted(free, key=str)]


def routine(equations: Equations, name: str, names: dict[Any, str]) -> Routine:
    """Statements of one function: its definitions, then common subexpressions of its results."""
    safe = {symbol: sympy.Symbol(text) for symbol, text in names.items()}
    field, definitions = getattr(equations, _FIELDS.get(name, name)), equations.definitions
    results = [field[place] for place in np.ndindex(tuple(int(n) for n in field.shape))]
    if name == "bias_forces":
        at_rest = dict.fromkeys(equations.ddq, sympy.Integer(0))
        results = [e.subs(at_rest) for e in results]
        definitions = tuple((s, e.subs(at_rest)) for s, e in definitions)
    needed = _needed_definitions(definitions, results)
    exprs = [e for _, e in needed] + results
    exprs = [e.xreplace(safe) for e in exprs]
    fresh = (s for s in sympy.numbered_symbols("k") if s.name not in set(names.values()))
    if needed:  # the definitions are the common subexpressions
        lines = [(names[s], e) for (s, _), e in zip(needed, exprs, strict=False)]
        results = exprs[len(needed) :]
    else:
        shared, results = sympy.cse(exprs, symbols=fresh, order="none")
        lines = [(s.name, e) for s, e in shared]
    used = {s.name for e in [*(e for _, e in lines), *results] for s in e.free_symbols}
    arrays = {"q": equations.q, "dq": equations.dq, "ddq": equations.ddq, "p": constants(equations)}
    inputs = [(a, k, names[s]) for a, symbols in arrays.items() for k, s in enumerate(symbols) if names[s] in used]
    return Routine(name, tuple(inputs), tuple(lines), tuple(results))


def _needed_definitions(definitions: tuple[tuple[Any, Any], ...], results: list[Any]) -> list[tuple[Any, Any]]:
    """Definitions that the results depend on, in order."""
    needed = {s for e in results for s in e.free_symbols}
    kept = []
    for symbol, expr in reversed(definitions):
        if symbol in needed:
            kept.append((symbol, expr))
            needed |= expr.free_symbols
    return kept[::-1]


def header(equations: Equations) -> list[str]:
    """Sentences for the top of a source file."""
    more = "h has terms besides c and g: terms linear in the rates, or due to time."
    lines = [f"Equations of motion of {equations.name}: {FUNCTIONS['inverse_dynamics'][3]}. SI units, radians."]
    lines += ["h = c(q, dq) + g(q)." if equations.split else more]
    for array, symbols in (("q", equations.q), ("dq", equations.dq), ("ddq", equations.ddq)):
        lines.append(f"{array} = ({', '.join(s.name for s in symbols)})")
    lines += [f"{name}: {meaning}" for name, meaning in equations.meanings]
    return [*lines, *remarks_of(equations)]


def unread_arrays(names: Iterable[str], function: Routine) -> list[str]:
    """Arrays that a function does not read."""
    read = {array for array, _, _ in function.inputs}
    return [name for name in names if name not in read]


# ── Operators shared by Python and C

_WAVES = ("sin", "cos", "tan", "sinh", "cosh", "tanh")


def expression_text(expr: Any, functions: Mapping[str, str]) -> str:
    """Expression in the operators shared by Python and C; integer powers become products.

    ``functions`` maps SymPy's name of each available function to the form of its call. ValueRangeError names other
    functions, and numbers outside the range of double.
    """

    def write(x: Any) -> str:
        if x.is_Add:
            return " + ".join(map(write, x.args)).replace("+ -", "- ")
        if x.is_Mul:
            coefficient, others = x.as_coeff_Mul()
            return f"-{product(others)}" if coefficient == -1 else product(x)
        if x.is_Symbol:
            return str(x.name)
        if x.is_Number or x.is_NumberSymbol:
            return _number(x)
        if x.is_Pow:
            return power(x.base, x.exp)
        return call(x.func.__name__ if x.args else str(x), *x.args)

    def power(base: Any, exponent: Any) -> str:
        if exponent.is_Integer and 0 < int(exponent) <= 8:
            return "*".join([factor(base)] * int(exponent))
        if exponent.is_Integer and int(exponent) < 0:
            below = base**-exponent
            divisor = write(below)
            if not (below.is_Symbol or below.is_Function):
                divisor = f"({divisor})"
            return f"1.0/{divisor}"
        if abs(exponent) == sympy.Rational(1, 2):
            return ("" if exponent > 0 else "1.0/") + call("sqrt", base)
        return call("pow", base, exponent)

    def product(x: Any) -> str:
        return "*".join(map(factor, sympy.Mul.make_args(x)))

    def factor(x: Any) -> str:
        plain = x.is_Symbol or x.is_Function or x.is_NumberSymbol or (x.is_Number and not x.is_negative)
        return write(x) if plain or (x.is_Pow and x.exp.is_Integer and int(x.exp) > 0) else f"({write(x)})"

    def call(name: str, *args: Any) -> str:
        if name not in functions:
            known = ", ".join(n for n in functions if n != "pow")
            raise ValueRangeError(
                f"{name}, in these equations or the derivatives, cannot be written as source. Allowed are powers and {known}, "
                "of symbols with real=True where Abs is differentiated. Rewrite the Lagrangian in these, or evaluate the "
                "expressions with SymPy."
            )
        return functions[name].format(*map(write, args))

    return write(expr)


def _number(x: Any) -> str:
    try:
        value = float(x) if x.is_finite else math.inf
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise ValueRangeError(f"{str(x)[:40]} cannot be written as source: no double holds it. Scale the Lagrangian.")
    whole = not x.is_Rational or x.is_Integer
    if whole or max(abs(x.p), x.q) >= 1 << 1000 or (x.q & (x.q - 1) == 0 and abs(x.p) < 1 << 50):
        return repr(value)
    return f"({x.p}.0/{x.q}.0)"


# ── C99: functions of plain arrays, no allocation, only math.h

# :mod:`..targets.c` prints recorded programs with one numbered operation a line and bit-exact kernel results. Equations
# are printed here for reading: one formula a line with its own names, which programs do not keep.


def c_source(equations: Equations, prefix: str | None = None) -> str:
    """C file with names that begin with ``prefix`` or the robot's name.

    Raises ValueRangeError if the prefix is not a C identifier, or for functions that math.h does not have.
    """
    if prefix is None:
        prefix = re.sub(r"\W", "_", equations.name, flags=re.ASCII)
        prefix = prefix if re.match(r"[A-Za-z]", prefix) else f"robot_{prefix}"
    if not isinstance(prefix, str) or not re.fullmatch(r"[A-Za-z]\w*", prefix, flags=re.ASCII):
        raise ValueRangeError(f"prefix={prefix!r} cannot begin a name in C. Use letters, digits and underscores.")
    names, symbols = ordered_names(equations), constants(equations)
    n = len(equations.q)
    about = [*header(equations)]
    if symbols:
        about.append(f"p = ({', '.join(s.name for s in symbols)})")
    text = visible("\n".join(about)).replace("*/", "* /").replace("/*", "/ *")
    comment = "\n".join(f" * {line}" for line in text.splitlines())
    parts = [f"/*\n{comment}\n * Matrices are stored row by row.\n */", "#include <math.h>"]
    signatures = {name: _signature(name, prefix, n, len(symbols)) for name in FUNCTIONS}
    parts.append("\n".join(f"{signature};" for signature in signatures.values()))
    values = {s: p.value for s, p in zip(equations.values, equations.parameters, strict=True)}
    if symbols and all(s in values for s in symbols):
        rows = "\n".join(f"    {float(values[s])!r}, /* {s.name} */" for s in symbols)
        parts.append(
            f"extern const double {prefix}_parameters[{len(symbols)}];\n"
            f"const double {prefix}_parameters[{len(symbols)}] = {{\n{rows}\n}};"
        )
    parts += [_function(routine(equations, name, names), signatures[name], n, bool(symbols)) for name in FUNCTIONS]
    return "\n\n".join(parts) + "\n"


def _signature(name: str, prefix: str, n: int, parameters: int) -> str:
    arrays, letter, axes, _ = FUNCTIONS[name]
    inputs = [f"const double {a}[{n}]" for a in arrays]
    inputs += [f"const double p[{parameters}]"] if parameters else []
    return f"void {prefix}_{name}({', '.join(inputs)}, double {letter}[{n**axes}])"


def _function(made: Routine, signature: str, n: int, has_parameters: bool) -> str:
    arrays, letter, axes, meaning = FUNCTIONS[made.name]
    lines = [f"/* {meaning}. */", signature, "{"]
    lines += [f"    (void){name};" for name in unread_arrays((*arrays, *(["p"] if has_parameters else [])), made)]
    lines += [f"    const double {name} = {array}[{k}];" for array, k, name in made.inputs]
    lines += [f"    const double {name} = {expression_text(expr, _C)};" for name, expr in made.lines]
    for k, (_, expr) in enumerate(zip(np.ndindex((n,) * axes), made.results, strict=True)):
        lines.append(f"    {letter}[{k}] = {expression_text(expr, _C)};")
    return "\n".join([*lines, "}"])


_C = {
    **{name: f"{name}({{}})" for name in (*_WAVES, "exp", "log", "sqrt")},
    **{f"a{name}": f"a{name}({{}})" for name in _WAVES},
    "atan2": "atan2({}, {})",
    "Abs": "fabs({})",
    "sign": "(double)((({0}) > 0.0) - (({0}) < 0.0))",
    "pow": "pow({}, {})",
}


# ── Python with NumPy


def numpy_source(equations: Equations) -> str:
    """Text of the Python module."""
    names = ordered_names(equations)
    values = {s: p.value for s, p in zip(equations.values, equations.parameters, strict=True)}
    symbols = constants(equations)
    parts = ['"""' + "\n".join(header(equations)).replace("\\", "").replace('"', "'") + '\n"""\n\nimport numpy as np\n']
    if all(s in values for s in symbols):
        rows = [f"    {s.name!r}: {float(values[s])!r}," for s in symbols]
        parts.append("\n".join(["PARAMETERS = {", *rows, "}\n"]))
    else:
        parts.append(f"# parameters = {{{', '.join(f'{s.name!r}: …' for s in symbols)}}}\n")
    parts += [_numpy_function(equations, routine(equations, name, names)) for name in FUNCTIONS]
    return "\n".join(parts)


def _numpy_function(equations: Equations, made: Routine) -> str:
    arrays, letter, axes, meaning = FUNCTIONS[made.name]
    n = len(equations.q)
    shape = ", ".join([str(n)] * axes)
    symbols = constants(equations)
    known = len(symbols) == len(equations.parameters)
    lines = [f"\ndef {made.name}({', '.join(arrays)}, parameters{'=PARAMETERS' if known else ''}):"]
    ins = ", ".join(f"{a} (..., {n})" for a in arrays)
    lines.append(f'    """{meaning}; {ins} -> (..., {shape})."""')
    lines.append(
        f"    {', '.join(arrays)}{',' if len(arrays) == 1 else ''} = (np.asarray(x, float) for x in ({', '.join(arrays)},))"
    )
    for name in arrays:
        wanted = f'f"{name} has shape {{{name}.shape}}, wanted (..., {n})"'
        lines += [f"    if {name}.shape[-1:] != ({n},):", f"        raise ValueError({wanted})"]
    for array, k, name in made.inputs:
        lines.append(
            f"    {name} = parameters[{symbols[k].name!r}]" if array == "p" else f"    {name} = {array}[..., {k}]"
        )
    lines += [f"    {name} = {expression_text(expr, _NUMPY)}" for name, expr in made.lines]
    batch = ", ".join(f"{a}.shape[:-1]" for a in arrays)
    lines.append(f"    {letter} = np.zeros((*np.broadcast_shapes({batch}), {shape}))")
    for place, expr in zip(np.ndindex((n,) * axes), made.results, strict=True):
        if expr != 0:
            lines.append(f"    {letter}[..., {', '.join(map(str, place))}] = {expression_text(expr, _NUMPY)}")
    lines.append(f"    return {letter}\n")
    return "\n".join(lines)


_NUMPY = {
    **{name: f"np.{name}({{}})" for name in (*_WAVES, "exp", "log", "sqrt", "sign")},
    **{f"a{name}": f"np.arc{name}({{}})" for name in _WAVES},
    "atan2": "np.arctan2({}, {})",
    "Abs": "np.abs({})",
    "pow": "np.power({}, {})",
}
