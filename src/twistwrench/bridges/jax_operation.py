"""A program as one operation of JAX, made when XLA asks for it: on the processor the compiled kernel, elsewhere JAX's own.

Nothing is compiled while JAX traces, and the kernel never where a computation is lowered for a GPU alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from math import prod
from typing import Any

from ..kernels.xla_handler import is_compiled
from ..targets.elementwise import batch_shape
from .quantity import BridgedQuantity
from .xla_call import xla_target

BATCH = 16
"""States from which a kernel that Python has to enter is faster than what XLA makes of the program."""


class JaxOperation:
    """The operation of one quantity: called with arrays, it gives a tuple of results. ``plain`` are JAX's own operations."""

    def __init__(self, quantity: BridgedQuantity, plain: Callable[..., tuple[Any, ...]]) -> None:
        self.quantity, self.plain = quantity, plain

    def __repr__(self) -> str:
        return f"<JaxOperation {self.quantity.name}>"

    def __call__(self, *arrays: Any) -> tuple[Any, ...]:
        """Take part in what JAX traces."""
        return tuple(_primitive().bind(*arrays, operation=self))

    def runs_plain(self, arrays: Sequence[Any]) -> bool:
        """Whether the processor takes JAX's operations: for a few states, where Python would have to enter the kernel."""
        return prod(batch_shape(arrays, self.quantity.program)) < BATCH and not is_compiled(self.quantity.kernel)

    def at_once(self, *arrays: Any) -> tuple[Any, ...]:
        """Outside of jit: XLA is not asked to compile what is computed by JAX's operations, once."""
        import jax

        given = [jax.numpy.asarray(a) for a in arrays]
        if all(device.platform == "cpu" for device in given[0].devices()) and self.runs_plain(given):
            return self.plain(*given)
        return tuple(jax.jit(self)(*given))

    def on_processor(self, *arrays: Any) -> tuple[Any, ...]:
        """The kernel as a call of XLA."""
        import jax

        if self.runs_plain(arrays):
            return self.plain(*arrays)
        program, kernel = self.quantity.program, self.quantity.kernel
        batch, dtype = batch_shape(arrays, program), arrays[0].dtype
        alone = prod(batch) == 1
        target = xla_target(jax, self.quantity.name, kernel, len(program.inputs), dtype.char, alone=alone)
        whole = [jax.numpy.broadcast_to(a, (*batch, *p.shape)) for a, p in zip(arrays, program.inputs, strict=True)]
        results = [jax.ShapeDtypeStruct((*batch, *p.shape), dtype) for p in program.outputs]
        return tuple(jax.ffi.ffi_call(target, results)(*whole))


@cache
def _primitive() -> Any:
    """JAX's name for all of these operations, with how it finds shapes and code."""
    import jax
    from jax.extend.core import Primitive
    from jax.interpreters import mlir

    def shaped(*arrays: Any, operation: JaxOperation) -> list[Any]:
        program = operation.quantity.program
        batch = batch_shape(arrays, program)
        return [jax.core.ShapedArray((*batch, *port.shape), arrays[0].dtype) for port in program.outputs]

    def plain(*arrays: Any, operation: JaxOperation) -> tuple[Any, ...]:
        return operation.plain(*arrays)

    def on_processor(*arrays: Any, operation: JaxOperation) -> tuple[Any, ...]:
        return operation.on_processor(*arrays)

    made = Primitive("twistwrench")
    made.multiple_results = True
    made.def_impl(lambda *arrays, operation: operation.at_once(*arrays))
    made.def_abstract_eval(shaped)
    mlir.register_lowering(made, mlir.lower_fun(plain, multiple_results=True))
    mlir.register_lowering(made, mlir.lower_fun(on_processor, multiple_results=True), platform="cpu")
    return made
