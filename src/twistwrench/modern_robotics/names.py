"""Rows of the book's names.

A row is the declaration of a function, with its arguments in the book's order and their types. Its decorator has the function
that evaluates it, checks of the arguments, the equation, and the result::

    @named(so3.hat, "eq. 3.30", "so3mat : (..., 3, 3) array", real(3))
    def VecToso3(omg: ArrayLike) -> Array:
        \"\"\"Skew-symmetric matrix [omg] of a vector.\"\"\"

:func:`named` is for functions of arrays, :func:`of_chain` for quantities of the chain that the lists among the arguments
describe. Type checkers see the declaration; ``help`` shows its sentence with the equation, and sections from the glossary.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from ..core.glossary import RETURNS
from ..core.typing import Array
from .chains import LISTS, chain_of, screws_of
from .checks import Check

Declared = TypeVar("Declared", bound=Callable[..., Any])


def named(target: Callable[..., Any], equation: str, result: str, *checks: Check) -> Callable[[Declared], Declared]:
    """Row of a function of arrays: ``target`` of the checked arguments."""

    def decorate(declared: Declared) -> Declared:
        labels = [f"{declared.__name__}: {name}" for name in inspect.signature(declared).parameters]
        first_check = checks[0]
        first_label = labels[0]

        def evaluate_one(values: tuple[Any, ...]) -> Any:
            """Result for one argument, the usual case; a loop would double the time of a call."""
            return target(first_check(values[0], first_label))

        def evaluate_several(values: tuple[Any, ...]) -> Any:
            """Result for several arguments."""
            return target(*map(lambda check, value, label: check(value, label), checks, values, labels))

        evaluate = evaluate_one if len(checks) == 1 else evaluate_several
        return _book_function(declared, evaluate, equation, result)

    return decorate


def of_chain(quantity: str, equation: str, result: str) -> Callable[[Declared], Declared]:
    """Row of a quantity of the chain of (Mlist, Glist, Slist), or of screws alone."""

    def decorate(declared: Declared) -> Declared:
        names = [*inspect.signature(declared).parameters]
        has_masses = names[-3:] == ["Mlist", "Glist", "Slist"]
        inputs = [(name, position) for position, name in enumerate(names) if name not in LISTS]
        inputs.sort(key=lambda name_and_position: name_and_position[0] == "g")  # kernels take gravity g last

        def evaluate(values: tuple[Any, ...]) -> Array:
            chain = chain_of(*values[-3:]) if has_masses else screws_of(values[0], names[0])
            return chain.run(quantity, **{name: chain.checked(values[position], name) for name, position in inputs})

        return _book_function(declared, evaluate, equation, result)

    return decorate


def _book_function(
    declared: Declared, evaluate: Callable[[tuple[Any, ...]], Any], equation: str, result: str
) -> Declared:
    """Function with the name and signature of a declaration, and with a docstring of its sentence, equation and result."""
    signature = inspect.signature(declared)
    parameter_count = len(signature.parameters)

    @wraps(declared)
    def function(*values: Any, **named_values: Any) -> Any:
        if named_values or len(values) != parameter_count:
            values = signature.bind(*values, **named_values).args
        return evaluate(values)

    returns = result or RETURNS[declared.__annotations__["return"]]  # by default the glossary's entry for the type
    sentence = (declared.__doc__ or "").rstrip(".")
    function.__doc__ = f"{sentence} (MR {equation}).\n\nReturns\n-------\n{returns}\n"
    return function  # type: ignore[return-value]
