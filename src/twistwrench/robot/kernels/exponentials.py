"""exp and log of rotations and rigid motions as kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np

from ...compiler.runtime.interpreter import compiles
from ...core.typing import Array
from ...mechanics.lie import compiled_forms
from ..engine import compile_form

SHAPES = {
    "rotation_exp": ((3,), (3, 3)),
    "pose_exp": ((6,), (4, 4)),
    "rotation_log": ((3, 3), (3,)),
    "pose_log": ((4, 4), (6,)),
}
"""Types of inputs and results."""


class ExponentialKernel:
    """Function of :mod:`~twistwrench.mechanics.lie.se3`, compiled for one row and for many."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.input_shape, self.result_shape = SHAPES[name]

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        return kernel, (self.name,)

    def __call__(self, x: Array) -> tuple[Array, Any]:
        """Result for x (..., n), and the flag that marks valid rows."""
        if x.ndim > len(self.input_shape):
            with np.errstate(all="ignore"):
                results: tuple[Array, Array] = self._many(x)
                return results
        row = self._one(x)
        return row[:-1].reshape(self.result_shape), row[-1]

    def slower(self, x: Array) -> Array:
        """Calls that the builtin passes on: a float32 row or a row that is not contiguous."""
        with np.errstate(all="ignore"):
            return np.asarray(self._flat(x))

    @cached_property
    def _one(self) -> Callable[[Array], Array]:
        from ...compiler.runtime.dispatch import make_call

        return make_call(self._flat, self.slower, self.name) or self.slower

    @cached_property
    def _flat(self) -> Any:
        return self._compile(lambda x: np.concatenate([np.ravel(part) for part in self._function(x)]), ["row"])

    @cached_property
    def _many(self) -> Any:
        return self._compile(self._function, ["result", "measure"])

    @property
    def _function(self) -> Callable[[Array], tuple[Array, Any]]:
        from ...mechanics.lie import se3 as exponentials

        function: Callable[[Array], tuple[Array, Any]] = getattr(exponentials, self.name)
        return function

    def _compile(self, function: Callable[[Array], Any], outputs: list[str]) -> Any:
        from ...compiler.ir.tracer import trace

        program = trace(function, [("x", self.input_shape)], outputs)
        return compile_form(program, self.name, f"{self.name}, compiled.")


@cache
def kernel(name: str) -> ExponentialKernel | None:
    """Kernel of a function of :mod:`~twistwrench.mechanics.lie.se3`; None if programs run on NumPy."""
    return ExponentialKernel(name) if compiles() else None


def install() -> None:
    """Install compiled kernels for exp and log of :mod:`~twistwrench.mechanics.lie`."""
    compiled_forms.compiler = kernel
