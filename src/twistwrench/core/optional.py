"""Heavy packages that are imported when they are first used."""

from __future__ import annotations

import importlib
from typing import Any


class _LazyModule:
    """Stands for a module, whose names it takes over one by one as they are used."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        value = getattr(importlib.import_module(self._name), name)
        setattr(self, name, value)
        return value


def lazy_module(name: str) -> Any:
    """Module of that name, imported when one of its names is first used.

    >>> lazy_module("math").sqrt(4.0)
    2.0
    """
    return _LazyModule(name)
