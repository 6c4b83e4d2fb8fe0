"""Tables whose columns have names, read by these names: data frames, their rows, arrays with labelled axes.

Nothing is imported for it: an object is a table by what it has, ``columns`` (pandas, Polars), ``index`` (a row of pandas), or
``dims`` and ``coords`` (xarray).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..errors import UnknownNameError, ValueRangeError
from ..listing import listed

_PLAIN = (list, tuple, float, int)


def is_table(x: Any) -> bool:
    """Whether the last axis of ``x`` has labels."""
    return _labels(x) is not None


def in_order(x: Any, what: str, names: Sequence[str]) -> Any:
    """What is in the table ``x``, its columns in the order of ``names``; all else as it is.

    Where ``names`` is empty there is nothing to read the columns by, and a table is a ValueRangeError if its labels are
    texts. Raises UnknownNameError for columns that are not exactly ``names``: it lists the foreign and the missing ones.
    """
    labels = _labels(x)
    if labels is None:
        return x
    if not names:
        if any(isinstance(label, str) for label in labels):
            raise ValueRangeError(
                f"{what} has named columns ({listed(labels)}), and is read by position. Give its numbers alone, in the order "
                "that is meant: for a data frame, df.to_numpy()."
            )
        return _contents(x)
    if labels == list(names):
        return _contents(x)
    foreign = [label for label in labels if label not in names]
    missing = [name for name in names if name not in labels]
    twice = [label for k, label in enumerate(labels) if label in labels[:k]]
    if foreign or missing or twice:
        said = [("foreign", foreign), ("missing", missing), ("twice", twice)]
        wrong = "; ".join(f"{word}: {listed(some)}" for word, some in said if some)
        raise UnknownNameError(
            f"{what} has columns that are not the robot's. {wrong[0].upper()}{wrong[1:]}. Its columns must be "
            f"{listed(names)}, in any order. Choose them: df[list(names)] with names = robot.coordinate_names for "
            "q, robot.velocity_names for rates and torques; or give df.to_numpy() if they are in the robot's order already."
        )
    return _contents(x)[..., [labels.index(name) for name in names]]


def _labels(x: Any) -> list[Any] | None:
    """The labels of the last axis; None where it has none."""
    if isinstance(x, _PLAIN):
        return None
    columns = getattr(x, "columns", None)
    if columns is not None and not callable(columns):
        return list(columns)
    dims, coords = getattr(x, "dims", None), getattr(x, "coords", None)
    if isinstance(dims, tuple) and coords is not None:
        return list(coords[dims[-1]].values.tolist()) if dims and dims[-1] in coords else None
    index = getattr(x, "index", None)
    return list(index) if index is not None and not callable(index) and hasattr(x, "__array__") else None


def _contents(x: Any) -> Any:
    """The numbers without their labels; lazy where the table is."""
    if getattr(x, "dims", None) is not None and hasattr(x, "data"):
        return x.data
    return x.to_numpy()
