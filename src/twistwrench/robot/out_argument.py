"""The argument ``out=``: what it must be, and the error where results do not fit in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ShapeError

if TYPE_CHECKING:
    from ..program.program import Program


def refuse_lazy(name: str, out: Any) -> None:
    """Nothing can be written now that is computed later."""
    if out is not None:
        raise ShapeError(
            f"{name}: out= is for results that are computed now, and those of Dask arrays are computed later. Leave it out."
        )


def refuse_overlap(name: str, out: tuple[Any, ...]) -> None:
    """Two results in one memory are two wrong results, and NumPy lets them."""
    arrays = [a for a in out if isinstance(a, np.ndarray)]
    if any(np.shares_memory(a, b) for k, a in enumerate(arrays) for b in arrays[:k]):
        raise ShapeError(
            f"{name}: two arrays of out= share memory. Give each result memory of its own; or leave it out."
        )


def refuse_text(out: Any) -> None:
    """NumPy would write numbers into an array of text, cut to its width."""
    if any(
        getattr(getattr(a, "dtype", None), "kind", "f") in "SUT" for a in (out if isinstance(out, tuple) else (out,))
    ):
        raise TypeError


def unfit(name: str, out: Any, program: Program, arrays: Sequence[Any]) -> ShapeError:
    """The error for an ``out`` that the results do not fit in."""
    given = [np.asarray(a) for a in arrays]
    batch = np.broadcast_shapes(*(a.shape[: a.ndim - len(p.shape)] for a, p in zip(given, program.inputs, strict=True)))
    kind = "float32" if all(np.can_cast(a.dtype, np.float32) for a in given) else "float64"
    wanted = " and ".join(f"one of shape {batch + port.shape}" for port in program.outputs)
    shown = [
        f"a{' writable' if a.flags.writeable else ' read-only'} array of {a.dtype.name} and shape {a.shape}"
        if isinstance(a, np.ndarray)
        else f"a {type(a).__name__}"
        for a in (out if isinstance(out, tuple) else (out,))
    ]
    several = "a tuple of arrays" if len(program.outputs) > 1 else "an array"
    return ShapeError(
        f"{name}: out= is {' and '.join(shown)}. Give {several} of {kind} that can be written to, {wanted}; or leave it out."
    )
