"""A mapping of a YAML file that knows the keys that lead to it, and its numbers with units."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import ModelError, UnknownNameError
from .data_sheet_units import in_si


def shown(value: object) -> str:
    """What stands there, shortened: with aliases a short file may mean a value of endless length."""
    short = reprlib.Repr()
    short.maxlevel, short.maxstring, short.maxother = 2, 60, 60
    return short.repr(value)


@dataclass(frozen=True)
class Section:
    """A mapping of the file, and the path of keys that leads to it."""

    content: Any
    path: str
    taken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        if not isinstance(self.content, Mapping):
            raise ModelError(f"{self.path or 'the file'} is {shown(self.content)}, expected entries 'name: value'.")

    def where(self, key: str) -> str:
        """Where an entry stands: the keys that lead to it."""
        return f"{self.path} → {key}" if self.path else key

    def only(self, *allowed: str) -> None:
        """Raise UnknownNameError for an entry that is not among those allowed."""
        for key in self.content:
            if key not in allowed:
                raise UnknownNameError.of(f"entry of {self.path or 'an actuator file'}", key, allowed)

    def section(self, key: str) -> Section:
        """The mapping below a key."""
        return Section(self.content[key], self.where(key))

    def number(self, key: str, kind: str) -> float:
        """A number with a unit; with no unit at all where ``kind`` is empty."""
        value = self.content[key]
        if kind:
            return in_si(value, kind, self.where(key))
        return plain_number(value, f"{self.where(key)} is {shown(value)}, expected a plain number.")

    def vector(self, key: str, kind: str) -> Any:
        """Three numbers (3,), each with its unit."""
        values = self.content[key]
        if isinstance(values, str | Mapping) or np.ndim(np.asarray(values, object)) != 1 or len(values) != 3:
            raise ModelError(f"{self.where(key)} is {shown(values)}, expected three entries in brackets.")
        items = Section({str(k): v for k, v in zip("xyz", values, strict=True)}, self.where(key))
        return np.array([items.number(k, kind) for k in "xyz"])

    def optional(self, key: str, get: Callable[..., Any], *args: Any) -> dict[str, Any]:
        """``{key: what get makes of it}``, or nothing where it is absent."""
        return {key: get(key, *args)} if key in self.content else {}


def plain_number(value: object, problem: str) -> float:
    """A number that is finite, or text of one; booleans and Python's 1_0 are none."""
    try:
        if isinstance(value, bool) or (isinstance(value, str) and "_" in value):
            raise ValueError  # noqa: TRY301  one sentence answers all of it
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ModelError(problem) from None
    if not np.isfinite(number):
        raise ModelError(problem)
    return number
