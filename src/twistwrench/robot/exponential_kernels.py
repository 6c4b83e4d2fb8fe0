"""exp and log of rotations and rigid motions as kernels: the bridge between the geometry that says them and the compiler."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np

from ..kernels.interpreter import compiles
from ..lie import compiled as lie
from ..typing import Array

SHAPES = {
    "rotation_exp": ((3,), (3, 3)),
    "pose_exp": ((6,), (4, 4)),
    "rotation_log": ((3, 3), (3,)),
    "pose_log": ((4, 4), (6,)),
}
"""Of what is given, and of what comes out."""


class ExponentialKernel:
    """A function of :mod:`~twistwrench.lie.exponentials`, compiled for one row, which comes as one array, and for many."""

    def __init__(self, name: str) -> None:
        self.name, (self.given, self.found) = name, SHAPES[name]

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        return kernel, (self.name,)

    def __call__(self, x: Array) -> tuple[Array, Any]:
        """The result of x (..., n), and the number that says whether it counts."""
        if x.ndim > len(self.given):
            with np.errstate(all="ignore"):
                several: tuple[Array, Array] = self._many(x)
                return several
        row = self._one(x)
        return row[:-1].reshape(self.found), row[-1]

    def slower(self, x: Array) -> Array:
        """What the builtin hands on: one row of float32, or one that is not in order in memory."""
        with np.errstate(all="ignore"):
            return np.asarray(self._flat(x))

    @cached_property
    def _one(self) -> Callable[[Array], Array]:
        from ..kernels.fast_call import make_call

        return make_call(self._flat, self.slower, self.name) or self.slower

    @cached_property
    def _flat(self) -> Any:
        return self._compiled(lambda x: np.concatenate([np.ravel(part) for part in self._text(x)]), ["row"])

    @cached_property
    def _many(self) -> Any:
        return self._compiled(self._text, ["result", "measure"])

    @property
    def _text(self) -> Callable[[Array], tuple[Array, Any]]:
        from ..lie import exponentials

        found: Callable[[Array], tuple[Array, Any]] = getattr(exponentials, self.name)
        return found

    def _compiled(self, text: Callable[[Array], Any], outputs: list[str]) -> Any:
        from ..program.trace import trace
        from .model_kernels import compiled

        return compiled(trace(text, [("x", self.given)], outputs), self.name, f"{self.name}, compiled.")


@cache
def kernel(name: str) -> ExponentialKernel | None:
    """The kernel of a function of :mod:`~twistwrench.lie.exponentials`; None where programs run on NumPy."""
    return ExponentialKernel(name) if compiles() else None


def install() -> None:
    """Let exp and log of :mod:`~twistwrench.lie` ask here."""
    lie.compiler = kernel
