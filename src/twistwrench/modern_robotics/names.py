"""Rows of the book's names.

A row is the declaration of a function, with its arguments in the book's order and their types, under a decorator that has what
evaluates it, the equation, and the result::

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
        check, label = checks[0], labels[0]

        def of_one(given: tuple[Any, ...]) -> Any:  # the usual case by itself: a loop would double the time of a call
            return target(check(given[0], label))

        def of_several(given: tuple[Any, ...]) -> Any:
            return target(*map(lambda check, x, label: check(x, label), checks, given, labels))

        return _built_from(declared, of_one if len(checks) == 1 else of_several, equation, result)

    return decorate


def of_chain(quantity: str, equation: str, result: str) -> Callable[[Declared], Declared]:
    """Row of a quantity of the chain of (Mlist, Glist, Slist), or of screws alone; its kernel takes gravity last."""

    def decorate(declared: Declared) -> Declared:
        names = [*inspect.signature(declared).parameters]
        whole = names[-3:] == ["Mlist", "Glist", "Slist"]
        inputs = [(name, place) for place, name in enumerate(names) if name not in LISTS]
        inputs.sort(key=lambda one: one[0] == "g")

        def evaluate(given: tuple[Any, ...]) -> Array:
            chain = chain_of(*given[-3:]) if whole else screws_of(given[0], names[0])
            return chain.run(quantity, **{name: chain.checked(given[place], name) for name, place in inputs})

        return _built_from(declared, evaluate, equation, result)

    return decorate


def _built_from(declared: Declared, evaluate: Callable[[tuple[Any, ...]], Any], equation: str, result: str) -> Declared:
    """Function with the name and signature of a declaration, and with a docstring of its sentence, equation and result."""
    signature = inspect.signature(declared)
    count = len(signature.parameters)

    @wraps(declared)
    def function(*given: Any, **by_name: Any) -> Any:
        if by_name or len(given) != count:
            given = signature.bind(*given, **by_name).args
        return evaluate(given)

    returns = result or RETURNS[declared.__annotations__["return"]]
    function.__doc__ = f"{(declared.__doc__ or '').rstrip('.')} (MR {equation}).\n\nReturns\n-------\n{returns}\n"
    return function  # type: ignore[return-value]
