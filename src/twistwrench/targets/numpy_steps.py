"""A recurrence on whole arrays, a NumPy kernel a step: the fallback where nothing compiles, and the oracle."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..program.recurrence import Recurrence, Source
from ..typing import Array
from .numpy import NumpyKernel


class NumpySteps:
    """Callable like the compiled ufunc of the same recurrence: arrays of a batch, and ``out=`` for the results."""

    def __init__(self, recurrence: Recurrence, name: str, doc: str) -> None:
        self.recurrence, self.__name__, self.__doc__ = recurrence, name, doc
        self.signature = recurrence.signature
        self.kernel = NumpyKernel(recurrence.program, name, doc)

    def __repr__(self) -> str:
        return f"<NumpySteps {self.__name__!r} {self.signature}>"

    def __call__(self, *args: Array, out: tuple[Array, ...]) -> tuple[Array, ...]:
        """Take all steps; ``args`` are the states at the beginning, then what is given for each step."""
        r = self.recurrence
        single = all(np.can_cast(np.asarray(a).dtype, np.float32) for a in args)
        dtype: Any = np.float32 if single else np.float64
        given = [np.asarray(a, dtype) for a in args[r.visible :]]
        axes = [a.ndim - 1 - len(port.shape) for a, port in zip(given, r.inputs[r.visible :], strict=True)]
        batch = np.broadcast_shapes(
            *(o.shape[: o.ndim - 1 - len(p.shape)] for o, p in zip(out, r.outputs, strict=True))
        )
        state = [np.broadcast_to(np.asarray(a, dtype), (*batch, *np.shape(a)[-1:])) for a in args[: r.visible]]
        state += [np.zeros((*batch, *port.shape), dtype) for port in r.states[r.visible :]]
        kept = out[0].shape[len(batch)]
        every = given[0].shape[axes[0]] // max(kept, 1)
        for row in range(kept):
            for between in range(every):
                number = row * every + between
                now = dict(zip(r.given, (np.take(a, number, k) for a, k in zip(given, axes, strict=True)), strict=True))
                begin = list(state)
                for stage, coefficients in enumerate(r.table):
                    found = self.kernel(
                        *(
                            self._input(k, s, now, state, begin, np.array(coefficients, dtype))
                            for k, s in enumerate(r.sources)
                        )
                    )
                    state = list(found[: len(r.states)])
                    if stage == 0 and between == 0:
                        for k, result in zip(r.said, out[r.visible :], strict=True):
                            result[..., row, :] = found[k]
            for result, x in zip(out, state[: r.visible], strict=False):
                result[..., row, :] = x
        return out

    @staticmethod
    def _input(
        k: int, source: Source, now: dict[int, Array], state: list[Array], begin: list[Array], row: Array
    ) -> Any:
        if source.kind == "given":
            return now[k]
        if source.kind == "stage":
            return row
        return begin[source.state] if source.kind == "start" else state[source.state]
