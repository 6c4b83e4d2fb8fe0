"""A program as one JAX operation: on the CPU the compiled kernel, elsewhere the program in JAX's own operations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from math import prod
from typing import Any

from ...compiler.lowering.reference_interpreter import batch_shape
from ...compiler.runtime.xla_handler import is_compiled
from .request import BridgedQuantity
from .xla_call import xla_target

# Kernels are compiled at lowering, not while JAX traces, and not for computations that run only on a GPU.

MIN_KERNEL_BATCH = 16
"""Smallest batch for which a kernel that enters Python is faster than XLA's code of the program."""


class JaxOperation:
    """JAX operation of one quantity: takes arrays, returns a tuple of results.

    ``jax_function`` is the quantity in JAX's own operations.
    """

    def __init__(self, quantity: BridgedQuantity, jax_function: Callable[..., tuple[Any, ...]]) -> None:
        self.quantity = quantity
        self.jax_function = jax_function

    def __repr__(self) -> str:
        return f"<JaxOperation {self.quantity.name}>"

    def __call__(self, *arrays: Any) -> tuple[Any, ...]:
        """Bind the operation in JAX's trace."""
        return tuple(_primitive().bind(*arrays, operation=self))

    def prefers_jax_function(self, arrays: Sequence[Any]) -> bool:
        """True if the version in JAX operations runs on the CPU: small batches of kernels that enter Python."""
        if is_compiled(self.quantity.kernel):
            return False
        return prod(batch_shape(arrays, self.quantity.program)) < MIN_KERNEL_BATCH

    def evaluate(self, *arrays: Any) -> tuple[Any, ...]:
        """Evaluation outside of jit; JAX operations that run once are not compiled by XLA."""
        import jax

        inputs = [jax.numpy.asarray(array) for array in arrays]
        is_on_cpu = all(device.platform == "cpu" for device in inputs[0].devices())  # all inputs are on the same
        if is_on_cpu and self.prefers_jax_function(inputs):
            return self.jax_function(*inputs)
        return tuple(jax.jit(self)(*inputs))

    def call_kernel(self, *arrays: Any) -> tuple[Any, ...]:
        """Kernel as an XLA call."""
        import jax

        if self.prefers_jax_function(arrays):
            return self.jax_function(*arrays)
        program, kernel = self.quantity.program, self.quantity.kernel
        batch = batch_shape(arrays, program)
        dtype = arrays[0].dtype
        is_single_sample = prod(batch) == 1
        target = xla_target(jax, self.quantity.name, kernel, len(program.inputs), dtype.char, scalar=is_single_sample)
        full_arrays = []
        for array, port in zip(arrays, program.inputs, strict=True):
            full_arrays.append(jax.numpy.broadcast_to(array, (*batch, *port.shape)))
        result_types = [jax.ShapeDtypeStruct((*batch, *port.shape), dtype) for port in program.outputs]
        return tuple(jax.ffi.ffi_call(target, result_types)(*full_arrays))


@cache
def _primitive() -> Any:
    """JAX primitive of all operations of this class, with its rules for shapes and lowering."""
    import jax
    from jax.extend.core import Primitive
    from jax.interpreters import mlir

    def result_shapes(*arrays: Any, operation: JaxOperation) -> list[Any]:
        program = operation.quantity.program
        batch = batch_shape(arrays, program)
        return [jax.core.ShapedArray((*batch, *port.shape), arrays[0].dtype) for port in program.outputs]

    def jax_function(*arrays: Any, operation: JaxOperation) -> tuple[Any, ...]:
        return operation.jax_function(*arrays)

    def kernel_call(*arrays: Any, operation: JaxOperation) -> tuple[Any, ...]:
        return operation.call_kernel(*arrays)

    primitive = Primitive("twistwrench")
    primitive.multiple_results = True
    primitive.def_impl(lambda *arrays, operation: operation.evaluate(*arrays))
    primitive.def_abstract_eval(result_shapes)
    mlir.register_lowering(primitive, mlir.lower_fun(jax_function, multiple_results=True))
    mlir.register_lowering(primitive, mlir.lower_fun(kernel_call, multiple_results=True), platform="cpu")
    return primitive
