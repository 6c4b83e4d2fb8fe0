"""Kernels of exp and log of rotations and rigid motions."""

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
"""Shapes of input and result by function."""


class ExponentialKernel:
    """Function of :mod:`~twistwrench.mechanics.lie.se3`, compiled for one row and for many."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.input_shape, self.result_shape = SHAPES[name]

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        """Pickled by name, since kernels are not pickled."""
        return kernel, (self.name,)

    def __call__(self, x: Array) -> tuple[Array, Any]:
        """Result for x, of one row or of many, and the measure by which the caller judges whether a row is valid."""
        if x.ndim > len(self.input_shape):
            with np.errstate(all="ignore"):
                results: tuple[Array, Array] = self._batch_kernel(x)
                return results
        result_and_measure = self._call_row(x)  # entries of the result, then the measure
        return result_and_measure[:-1].reshape(self.result_shape), result_and_measure[-1]

    def call_kernel(self, x: Array) -> Array:
        """Result and measure of a row that the builtin does not take: of float32, or not contiguous."""
        with np.errstate(all="ignore"):
            return np.asarray(self._row_kernel(x))

    @cached_property
    def _call_row(self) -> Callable[[Array], Array]:
        """Function of one row: result and measure in one array."""
        from ...compiler.runtime.dispatch import make_call

        return make_call(self._row_kernel, self.call_kernel, self.name) or self.call_kernel  # without a builtin

    @cached_property
    def _row_kernel(self) -> Any:
        """Kernel that returns result and measure in one array."""

        def flat_result(x: Array) -> Array:
            return np.concatenate([np.ravel(output) for output in self._function(x)])

        return self._compile(flat_result, ["row"])

    @cached_property
    def _batch_kernel(self) -> Any:
        """Kernel for any number of rows."""
        return self._compile(self._function, ["result", "measure"])

    @property
    def _function(self) -> Callable[[Array], tuple[Array, Any]]:
        """Function of :mod:`~twistwrench.mechanics.lie.se3` with this name, which returns result and measure."""
        from ...mechanics.lie import se3 as exponentials

        function: Callable[[Array], tuple[Array, Any]] = getattr(exponentials, self.name)
        return function

    def _compile(self, function: Callable[[Array], Any], outputs: list[str]) -> Any:
        """Compiled kernel of a function of x."""
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
