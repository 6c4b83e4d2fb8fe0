"""Equations as straight-line routines: names, statements, and expressions in the operators shared by Python and C."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import ValueRangeError
from .documents import remarks_of
from .names import names_of, sympy

if TYPE_CHECKING:
    from .equations import Equations

FUNCTIONS = {  # inputs, output, number of axes, description
    "inverse_dynamics": (("q", "dq", "ddq"), "tau", 1, "tau = M(q) ddq + h(q, dq)"),
    "bias_forces": (("q", "dq"), "h", 1, "h = tau - M ddq"),
    "mass_matrix": (("q",), "M", 2, "M, symmetric and full"),
    "coriolis_forces": (("q", "dq"), "c", 1, "c, the velocity products"),
    "coriolis_matrix": (("q", "dq"), "C", 2, "C with C dq = c and dM/dt - 2C skew"),
    "gravity_forces": (("q",), "g", 1, "g, torques at rest"),
}
"""Functions by name: input arrays, output array, number of axes of the output, and description."""

_FIELDS = {"inverse_dynamics": "tau", "bias_forces": "tau"}
"""Field of the equations, by name of a function that has another name than its field."""
_MAX_PRODUCT_EXPONENT = 8
"""Largest exponent of a power that is written as a product."""
_MAX_QUOTE_LENGTH = 40
"""Number of characters of a number in a message."""
_MAX_WHOLE_NUMBER = 1 << 1000
"""Bound of numerator and denominator of a written quotient, inside the range of double."""
_MAX_EXACT_NUMERATOR = 1 << 50
"""Bound of a numerator that double holds exactly."""
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
    """Local name and expression of each intermediate result."""
    results: tuple[Any, ...]
    """Results in C order, with safe names for all symbols."""


def ordered_names(equations: Equations) -> dict[Any, str]:
    """Name for every symbol, valid in Python and C and different from all others."""
    used_names: set[str] = set()
    names = {}
    variables = (*equations.q, *equations.dq, *equations.ddq)
    for symbol in (*variables, *constants(equations), *dict(equations.definitions)):
        name = re.sub(r"\W", "_", symbol.name, flags=re.ASCII)
        if not re.match(r"[A-Za-z]", name):
            name = f"v{name}"
        if _MACRO.fullmatch(name):
            name = f"{name}_"
        while name in used_names or name in _RESERVED or keyword.iskeyword(name):
            name += "_"
        used_names.add(name)
        names[symbol] = name
    return names


def constants(equations: Equations) -> list[Any]:
    """Symbols that are neither coordinates nor definitions, parameters first, in order."""
    definitions = dict(equations.definitions)
    variables = {*equations.q, *equations.dq, *equations.ddq, *definitions}
    parameters = [symbol for symbol in equations.values if symbol not in variables]
    all_symbols = free_symbols([*equations.tau, *equations.mass_matrix, *definitions.values()])
    other_constants = all_symbols - variables - set(parameters)
    return [*parameters, *sorted(other_constants, key=str)]


def free_symbols(expressions: Iterable[Any]) -> set[Any]:
    """Symbols that occur in any of the expressions."""
    symbols: set[Any] = set()
    for expr in expressions:
        symbols |= expr.free_symbols
    return symbols


def routine(equations: Equations, name: str, names: dict[Any, str]) -> Routine:
    """Statements of one function: the definitions that it needs; without any, common subexpressions of its results."""
    output = getattr(equations, _FIELDS.get(name, name))
    definitions = equations.definitions
    shape = tuple(map(int, output.shape))
    results = [output[index] for index in np.ndindex(shape)]
    if name == "bias_forces":
        zero_ddq = dict.fromkeys(equations.ddq, sympy.Integer(0))
        results = [expr.subs(zero_ddq) for expr in results]
        definitions = tuple((symbol, expr.subs(zero_ddq)) for symbol, expr in definitions)
    needed_definitions = _needed_definitions(definitions, results)
    safe_symbols = {symbol: sympy.Symbol(safe_name) for symbol, safe_name in names.items()}
    results = [expr.xreplace(safe_symbols) for expr in results]
    lines = []
    if needed_definitions:  # these are the common subexpressions
        for symbol, expr in needed_definitions:
            lines.append((names[symbol], expr.xreplace(safe_symbols)))
    else:
        subexpressions, results = sympy.cse(results, symbols=_unused_symbols(names), order="none")
        for symbol, expr in subexpressions:
            lines.append((symbol.name, expr))
    used_names = set(map(str, free_symbols([*dict(lines).values(), *results])))
    inputs = []
    arrays = {"q": equations.q, "dq": equations.dq, "ddq": equations.ddq, "p": constants(equations)}
    for array, symbols in arrays.items():
        for index, symbol in enumerate(symbols):
            local_name = names[symbol]
            if local_name in used_names:
                inputs.append((array, index, local_name))
    return Routine(name, tuple(inputs), tuple(lines), tuple(results))


def _unused_symbols(names: dict[Any, str]) -> Iterator[Any]:
    """Symbols k0, k1, … without those whose names are used."""
    used_names = set(names.values())
    for symbol in sympy.numbered_symbols("k"):
        if symbol.name not in used_names:
            yield symbol


def _needed_definitions(definitions: tuple[tuple[Any, Any], ...], results: list[Any]) -> list[tuple[Any, Any]]:
    """Definitions that the results depend on, in their order."""
    needed_symbols = free_symbols(results)
    needed_definitions = []
    for symbol, expr in reversed(definitions):  # a definition uses only earlier ones
        if symbol in needed_symbols:
            needed_definitions.append((symbol, expr))
            needed_symbols |= expr.free_symbols
    return needed_definitions[::-1]


def header(equations: Equations) -> list[str]:
    """Sentences for the top of a source file."""
    _, _, _, description = FUNCTIONS["inverse_dynamics"]
    lines = [f"Equations of motion of {equations.name}: {description}. SI units, radians."]
    if equations.split:
        lines.append("h = c(q, dq) + g(q).")
    else:
        lines.append("h has terms besides c and g: terms linear in the rates, or due to time.")
    for array, symbols in (("q", equations.q), ("dq", equations.dq), ("ddq", equations.ddq)):
        lines.append(f"{array} = ({', '.join(names_of(symbols))})")
    for name, meaning in equations.meanings:
        lines.append(f"{name}: {meaning}")
    return [*lines, *remarks_of(equations)]


def unread_arrays(names: Iterable[str], function: Routine) -> list[str]:
    """Names of the arrays that a function does not read."""
    read_arrays = {array for array, _, _ in function.inputs}
    return [name for name in names if name not in read_arrays]


def expression_text(expr: Any, functions: Mapping[str, str]) -> str:
    """Expression in the operators shared by Python and C; integer powers become products.

    ``functions`` maps SymPy's name of each available function to the form of its call. ValueRangeError names other
    functions, and numbers outside the range of double.
    """

    def write(x: Any) -> str:
        """Text of any subexpression."""
        if x.is_Add:
            sum_text = " + ".join(map(write, x.args))
            return sum_text.replace("+ -", "- ")
        if x.is_Mul:
            coefficient, other_factors = x.as_coeff_Mul()
            if coefficient == -1:
                return f"-{write_product(other_factors)}"
            return write_product(x)
        if x.is_Symbol:
            return str(x.name)
        if x.is_Number or x.is_NumberSymbol:
            return _number(x)
        if x.is_Pow:
            return write_power(x.base, x.exp)
        function_name = x.func.__name__ if x.args else str(x)
        return write_call(function_name, *x.args)

    def write_power(base: Any, exponent: Any) -> str:
        """Power as a product, a quotient, a square root or a call of pow."""
        if exponent.is_Integer and 0 < int(exponent) <= _MAX_PRODUCT_EXPONENT:
            return "*".join([write_factor(base)] * int(exponent))
        if exponent.is_Integer and int(exponent) < 0:
            denominator = base**-exponent
            text = write(denominator)
            if not (denominator.is_Symbol or denominator.is_Function):
                text = f"({text})"
            return f"1.0/{text}"
        if abs(exponent) == sympy.Rational(1, 2):
            root = write_call("sqrt", base)
            return root if exponent > 0 else f"1.0/{root}"
        return write_call("pow", base, exponent)

    def write_product(x: Any) -> str:
        """Text of a product, or of its only factor."""
        return "*".join(map(write_factor, sympy.Mul.make_args(x)))

    def write_factor(x: Any) -> str:
        """Factor of a product, in parentheses unless it is an atom or a product itself."""
        is_atom = x.is_Symbol or x.is_Function or x.is_NumberSymbol or (x.is_Number and not x.is_negative)
        is_product = x.is_Pow and x.exp.is_Integer and int(x.exp) > 0
        if is_atom or is_product:
            return write(x)
        return f"({write(x)})"

    def write_call(name: str, *args: Any) -> str:
        """Call of a function by SymPy's name."""
        if name not in functions:
            names = ", ".join(function for function in functions if function != "pow")
            raise ValueRangeError(
                f"{name}, in these equations or the derivatives, cannot be written as source. Allowed are powers and {names}, "
                "of symbols with real=True where Abs is differentiated. Rewrite the Lagrangian in these, or evaluate the "
                "expressions with SymPy."
            )
        return functions[name].format(*map(write, args))

    return write(expr)


def _number(x: Any) -> str:
    """Number as text: a decimal if a double holds it exactly, otherwise a quotient of whole numbers."""
    value = math.inf
    with suppress(OverflowError):
        if x.is_finite:
            value = float(x)
    if not math.isfinite(value):
        raise ValueRangeError(
            f"{str(x)[:_MAX_QUOTE_LENGTH]} cannot be written as source: no double holds it. Scale the Lagrangian."
        )
    if not x.is_Rational or x.is_Integer:
        return repr(value)
    numerator, denominator = x.p, x.q
    if max(abs(numerator), denominator) >= _MAX_WHOLE_NUMBER:
        return repr(value)
    is_power_of_two = denominator & (denominator - 1) == 0
    if is_power_of_two and abs(numerator) < _MAX_EXACT_NUMERATOR:
        return repr(value)
    return f"({numerator}.0/{denominator}.0)"
