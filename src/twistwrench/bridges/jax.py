"""A quantity as a function of JAX arrays, which jits, vmaps and differentiates: the program itself, in JAX's operations.

Its derivatives are those of the analytic programs, J = df/d(x ⊕ v), in both modes, and so are those of J, H = dJ/dx:

    forward   df = J B dx,  dJ = H dx,    backward   dx = Bᵀ Jᵀ w,

with B from the rates of coordinates to velocities, 1 but for quaternions, by which the derivatives of J are JAX's; third
derivatives are JAX's as well. On the processor the compiled kernels run.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import accumulate
from math import prod
from typing import Any

from ..errors import MissingExtraError, ModelWarning, ValueRangeError
from ..kernels.interpreter import compiles
from ..program.port import Port
from ..program.program import Program
from ..targets.elementwise import batch_shape, evaluated, functions_of
from .jax_operation import JaxOperation
from .quantity import BridgedQuantity


def jax_function(quantity: BridgedQuantity, precision: str) -> Callable[..., Any]:
    """The function of JAX arrays, of any batch shape; raises MissingExtraError."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise MissingExtraError.of("jax", "jax", "robot.to_jax") from None
    inputs = quantity.inputs
    names, outputs = [port.name for port in inputs], quantity.program.outputs
    rates = _on_arrays(jnp, quantity.velocities()) if quantity.curved else None
    jacobians: dict[tuple[str, ...], Any] = {}

    def with_jacobian(by: tuple[str, ...]) -> Callable[..., Any]:
        if by not in jacobians:
            jacobians[by] = jax.custom_jvp(_compiled(jax, quantity.derivative(by, values=True)))
            jacobians[by].defjvp(partial(along_again, by), symbolic_zeros=True)
        return jacobians[by]

    values = jax.custom_jvp(_compiled(jax, quantity))

    def along(primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[Any, Any]:
        """The values and df = J B dx, of those inputs that move."""
        moved = _moved(jax, tangents)
        by = tuple(names[k] for k in moved)
        found = with_jacobian(by)(*primals)
        results, slopes = found[: len(outputs)], found[len(outputs) :]
        steps = [
            rates(primals[k], tangents[k]) if rates and names[k] in quantity.curved else tangents[k] for k in moved
        ]
        ranks = [1 if names[k] in quantity.curved else len(inputs[k].shape) for k in moved]
        changes = [
            sum(
                _contracted(jnp, J, v, rank, port.shape)
                for J, v, rank in zip(slopes[r * len(by) : (r + 1) * len(by)], steps, ranks, strict=True)
            )
            for r, port in enumerate(outputs)
        ]
        return _alone(results), _alone(tuple(changes))

    values.defjvp(along, symbolic_zeros=True)

    @cache
    def with_hessian(by: tuple[str, ...]) -> Callable[..., Any]:
        return _compiled(jax, quantity.derivative(by, "hessian"))

    def along_again(by: tuple[str, ...], primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[Any, Any]:
        """The values and J by some inputs, and df = J dx and dJ = H dx, of those inputs that move."""
        moved = _moved(jax, tangents)
        every = tuple(name for k, name in enumerate(names) if name in by or k in moved)
        if not compiles() or any(name in quantity.curved for name in every):
            plain = _on_arrays(jnp, quantity.derivative(by, values=True).program)
            whole = [t if k in moved else jnp.zeros(t.shape, t.dtype) for k, t in enumerate(tangents)]
            derived: tuple[Any, Any] = jax.jvp(plain, tuple(primals), tuple(whole))
            return derived
        sizes = {port.name: port.size for port in inputs if port.name in every}
        ends = dict(zip(sizes, accumulate(sizes.values()), strict=True))
        part = {name: slice(end - sizes[name], end) for name, end in ends.items()}
        given, found = with_jacobian(every)(*primals), with_jacobian(by)(*primals)
        hessians = _listed(with_hessian(every)(*primals))
        slopes, changes, bends = given[len(outputs) :], [], []
        for r, (port, H) in enumerate(zip(outputs, hessians, strict=True)):
            J = dict(zip(every, slopes[r * len(every) :], strict=False))
            change: Any = 0.0
            bend: Any = 0.0
            for k in moved:
                step, rank = tangents[k], len(inputs[k].shape)
                change += _contracted(jnp, J[names[k]], step, rank, port.shape)
                flat = step.reshape((*step.shape[: step.ndim - rank], inputs[k].size))
                bend += _contracted(jnp, H[..., part[names[k]]], flat, 1, (*port.shape, H.shape[-1]))
            changes.append(change)
            bends += [bend[..., part[name]].reshape(J[name].shape) for name in by]
        return found, (*changes, *bends)

    def function(*arrays: Any) -> Any:
        dtype = _dtype(jax, jnp, precision)
        given = [jnp.asarray(a) for a in quantity.brought("to_jax", arrays, jax.Array)]
        quantity.require_shapes("to_jax", [a.shape for a in given])
        for a, port in zip(given, inputs, strict=True):
            if jnp.issubdtype(a.dtype, jnp.complexfloating):
                raise ValueRangeError(f"to_jax {quantity.name}: {port.name} is {a.dtype}, real numbers wanted.")
        return values(*(a.astype(dtype) for a in given))

    function.__name__ = function.__qualname__ = quantity.name
    listed = ", ".join(f"{port.name} {port.shape}" for port in inputs)
    function.__doc__ = f"{quantity.name} of {quantity.engine.model.name}, of JAX arrays: {listed}."
    return function


def _compiled(jax: Any, quantity: BridgedQuantity) -> Callable[..., Any]:
    """The program in JAX's operations, or its kernel, by the device and the size of the batch; derivatives are JAX's."""
    import jax.numpy as jnp

    program = quantity.program
    plain = _on_arrays(jnp, program)
    operation = JaxOperation(quantity, lambda *arrays: _listed(plain(*arrays)))

    @jax.custom_batching.custom_vmap  # type: ignore[untyped-decorator]
    def run(*arrays: Any) -> Any:
        return _alone(operation(*arrays))

    @run.def_vmap  # type: ignore[untyped-decorator]
    def batched(size: int, mapped: Sequence[bool], *arrays: Any) -> tuple[Any, Any]:
        """One call for all: the new axis comes before those of the widest batch."""
        ranks = [a.ndim - len(p.shape) - m for a, p, m in zip(arrays, program.inputs, mapped, strict=True)]
        wide = [
            a.reshape((size, *(1,) * (max(ranks) - rank), *a.shape[1:])) if m else a
            for a, rank, m in zip(arrays, ranks, mapped, strict=True)
        ]
        return run(*wide), True if len(program.outputs) == 1 else (True,) * len(program.outputs)

    found = jax.custom_jvp(run)
    found.defjvp(lambda primals, tangents: jax.jvp(plain, primals, tangents))
    result: Callable[..., Any] = found
    return result


def _moved(jax: Any, tangents: Sequence[Any]) -> list[int]:
    """The inputs that move: whose tangents are not known to be zero."""
    return [k for k, t in enumerate(tangents) if not isinstance(t, jax.custom_derivatives.SymbolicZero)]


def _on_arrays(jnp: Any, program: Program) -> Callable[..., Any]:
    """The program on arrays whose last axes are its own."""
    functions = functions_of(jnp, jnp.where)

    def run(*arrays: Any) -> Any:
        batch = batch_shape(arrays, program)
        elements: list[Any] = []
        for a, port in zip(arrays, program.inputs, strict=True):
            flat = a.reshape((*a.shape[: a.ndim - len(port.shape)], port.size))
            elements += [flat[..., k] for k in range(port.size)]
        found = iter(evaluated(program, elements, functions))
        dtype = jnp.result_type(*arrays)
        results = [_stacked(jnp, [next(found) for _ in range(p.size)], batch, p, dtype) for p in program.outputs]
        return _alone(tuple(results))

    return run


def _stacked(jnp: Any, elements: Sequence[Any], batch: tuple[int, ...], port: Port, dtype: Any) -> Any:
    """One result from its elements, some of which may be constants."""
    if not elements:
        return jnp.zeros((*batch, *port.shape), dtype)
    whole = jnp.stack([jnp.broadcast_to(jnp.asarray(e, dtype), batch) for e in elements], axis=-1)
    return whole.reshape((*batch, *port.shape))


def _contracted(jnp: Any, J: Any, v: Any, rank: int, shape: tuple[int, ...]) -> Any:
    """J v, of a result of that shape: over the last ``rank`` axes of J, which are those of v; batch shapes broadcast."""
    split = J.ndim - rank
    size = prod(J.shape[split:])
    rows = J.reshape((*J.shape[:split], size))
    steps = v.reshape((*v.shape[: v.ndim - rank], *(1,) * len(shape), size))
    return jnp.sum(
        rows * steps, axis=-1
    )  # XLA makes less of a product of matrices: rows of the identity are no special case


def _listed(found: Any) -> tuple[Any, ...]:
    return found if isinstance(found, tuple) else (found,)


def _alone(results: tuple[Any, ...]) -> Any:
    return results[0] if len(results) == 1 else results


def _dtype(jax: Any, jnp: Any, precision: str) -> Any:
    if precision == "single":
        return jnp.float32
    if not jax.config.jax_enable_x64:
        warnings.warn(
            "JAX computes in float32 unless it is told: jax.config.update('jax_enable_x64', True) gives what precision="
            "'double' asks for; precision='single' says that float32 is meant.",
            ModelWarning,
            stacklevel=3,
        )
        return jnp.float32
    return jnp.float64
