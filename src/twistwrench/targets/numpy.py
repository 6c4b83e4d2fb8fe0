"""A program on whole arrays, one NumPy call an instruction: the fallback where nothing compiles, and the oracle.

Same call as a ufunc: broadcasting, ``out=``, float32 in and out. Fused products round twice here, so results agree with
compiled ones to round-off, not to the bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..program.program import Program
from ..typing import Array
from .elementwise import batch_shape, evaluated, functions_of, last_uses

CHUNK = 4096
"""Samples computed at a time: intermediates stay in the cache, and memory stays bounded."""

_FUNCTIONS = functions_of(np, np.where)


class NumpyKernel:
    """Callable like the compiled ufunc of the same program."""

    def __init__(self, program: Program, name: str, doc: str) -> None:
        self.program, self.__name__, self.__doc__ = program, name, doc
        self.signature, self.nin, self.nout = program.signature, len(program.inputs), len(program.outputs)
        self._spent = last_uses(program)

    def __repr__(self) -> str:
        return f"<NumpyKernel {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes are the signature's."""
        arrays = [np.asarray(a) for a in args[: self.nin]]
        if len(args) != self.nin:
            raise TypeError(f"{self.__name__} takes {self.nin} arrays, got {len(args)}.")
        for a, port in zip(arrays, self.program.inputs, strict=True):
            if not np.can_cast(a.dtype, float):
                raise TypeError(f"{self.__name__}: {port.name} is {a.dtype}, real numbers wanted.")
        for number, (a, port) in enumerate(zip(arrays, self.program.inputs, strict=True)):
            if a.ndim < len(port.shape) or a.shape[a.ndim - len(port.shape) :] != port.shape:
                raise ValueError(
                    f"{self.__name__}: operand {number} has shape {a.shape}, core shape {port.shape} wanted."
                )
        single = all(
            np.can_cast(a.dtype, np.float32) for a in arrays
        )  # the loop that NumPy would take of a ufunc's two
        dtype: Any = np.float32 if single else np.float64
        batch = batch_shape(arrays, self.program)
        samples = int(np.prod(batch))
        rows = [
            np.broadcast_to(a, (*batch, *p.shape)).reshape(samples, p.size).astype(dtype, copy=False)
            for a, p in zip(arrays, self.program.inputs, strict=True)
        ]
        results = [np.empty((samples, p.size), dtype) for p in self.program.outputs]
        for start in range(0, samples, CHUNK):
            part = slice(start, start + CHUNK)
            self._evaluate([r[part].T for r in rows], [r[part].T for r in results])
        shaped = [r.reshape((*batch, *p.shape)) for r, p in zip(results, self.program.outputs, strict=True)]
        if out is None:
            shaped = [s if s.ndim else s[()] for s in shaped]
        else:
            places = out if isinstance(out, tuple) else (out,)
            if len(places) != self.nout:
                raise ValueError(f"{self.__name__}: out= has {len(places)} arrays, {self.nout} wanted.")
            for k, place in enumerate(places):
                if place is not None:
                    np.copyto(place, shaped[k], casting="same_kind")  # as a ufunc casts: never to whole numbers
                    shaped[k] = place
        return shaped[0] if self.nout == 1 else tuple(shaped)

    def _evaluate(self, inputs: list[Array], outputs: list[Array]) -> None:
        columns = [c for columns in inputs for c in columns]
        found = evaluated(self.program, columns, _FUNCTIONS, self._spent)
        slots = [row for rows in outputs for row in rows]
        for slot, result in zip(slots, found, strict=True):
            slot[...] = result
