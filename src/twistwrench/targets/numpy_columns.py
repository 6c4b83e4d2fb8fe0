"""Columns on whole arrays: the fallback where nothing compiles, and the oracle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..program.column_groups import ColumnGroups
from .numpy import NumpyKernel


class NumpyColumns:
    """Callable like the compiled ufunc of the same columns."""

    def __init__(self, columns: ColumnGroups, name: str, doc: str) -> None:
        self.columns, self.__name__, self.__doc__ = columns, name, doc
        self.signature, self.nin, self.nout = columns.signature, len(columns.inputs), len(columns.outputs)
        self.kernel = NumpyKernel(columns.program, name, doc)
        self.groups = [NumpyKernel(group.program, name, doc) for group in columns.groups]

    def __repr__(self) -> str:
        return f"<NumpyColumns {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes are the signature's."""
        made = self.kernel(*args)
        found, shared = list(made[: self.nout]), made[self.nout :]
        for group, kernel in zip(self.columns.groups, self.groups, strict=True):
            for matrix, column in group.places:
                found[matrix][..., column] = kernel(*shared, found[matrix][..., column])
        if out is None:
            return tuple(found)
        for k, place in enumerate(out):
            if place is not None:
                np.copyto(place, found[k], casting="same_kind")
                found[k] = place
        return tuple(found)
