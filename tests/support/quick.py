"""Parameters of which some run in `make test`; the rest are slow oracles, for `make test-all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def slow(*values: Any) -> list[Any]:
    """Parameters, all marked slow."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


def mostly_slow(values: Iterable[Any], every: int) -> list[Any]:
    """Parameters, all marked slow but the first of every so many."""
    params = [v if hasattr(v, "marks") else pytest.param(*(v if isinstance(v, tuple) else (v,))) for v in values]
    slow = pytest.mark.slow
    return [
        param if number % every == 0 else pytest.param(*param.values, id=param.id, marks=[*param.marks, slow])
        for number, param in enumerate(params)
    ]
