"""Checks of ``out=``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import ShapeError

if TYPE_CHECKING:
    from ...compiler.ir.program import Program


def refuse_overlap(name: str, out: tuple[Any, ...]) -> None:
    """Raise an error if two results share memory; NumPy would overwrite one with the other."""
    arrays = [a for a in out if isinstance(a, np.ndarray)]
    for a, b in combinations(arrays, 2):
        if np.shares_memory(a, b):
            raise ShapeError(
                f"{name}: two arrays of out= share memory. Give each result memory of its own; or leave it out."
            )


def refuse_text(out: Any) -> None:
    """Raise an error for text arrays, into which NumPy would write truncated numbers."""
    arrays = out if isinstance(out, tuple) else (out,)
    for array in arrays:
        if getattr(getattr(array, "dtype", None), "kind", "f") in "SUT":
            raise TypeError


def unfit(name: str, out: Any, program: Program, arrays: Sequence[Any]) -> ShapeError:
    """Error for an ``out`` that does not fit the results."""
    kind = "float32"
    batch: tuple[int, ...] = ()
    for array, port in zip(map(np.asarray, arrays), program.inputs, strict=True):
        batch = np.broadcast_shapes(batch, array.shape[: array.ndim - len(port.shape)])
        if not np.can_cast(array.dtype, np.float32):
            kind = "float64"
    fitting = " and ".join(f"one of shape {batch + port.shape}" for port in program.outputs)
    targets = out if isinstance(out, tuple) else (out,)
    shown = " and ".join(map(_target_text, targets))
    several = "an array"
    if len(program.outputs) > 1:
        several = "a tuple of arrays"
    return ShapeError(
        f"{name}: out= is {shown}. Give {several} of {kind} that can be written to, {fitting}; or leave it out."
    )


def _target_text(target: Any) -> str:
    """An ``out`` as a message shows it."""
    if not isinstance(target, np.ndarray):
        return f"a {type(target).__name__}"
    access = "writable" if target.flags.writeable else "read-only"
    return f"a {access} array of {target.dtype.name} and shape {target.shape}"
