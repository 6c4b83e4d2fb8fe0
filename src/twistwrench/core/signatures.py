"""Signatures of functions that pass on to another all that they are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def taking_the_arguments_of(
    other: Callable[Arguments, Any],
) -> Callable[[Callable[..., Result]], Callable[Arguments, Result]]:
    """A decorator: names, types and defaults are those of ``other``, for people, checkers and ``inspect.signature``."""

    def of(function: Callable[..., Result]) -> Callable[Arguments, Result]:
        function.__wrapped__ = other  # type: ignore[attr-defined]
        return function

    return of
