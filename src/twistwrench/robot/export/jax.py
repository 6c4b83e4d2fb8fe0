"""Quantities as JAX functions, and kernels as in-place XLA calls on the CPU by its typed FFI.

Machine-code kernels have machine-code handlers (:mod:`twistwrench.compiler.runtime.xla_handler`). Kernels on NumPy, or composed
in Python, use the callback below. It reads the needed fields of the structures of ``xla/ffi/api/c_api.h``, which later
versions only extend at the end.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from math import prod
from typing import Any

from ...compiler.ir.program import Program, TensorSpec
from ...compiler.lowering.reference_interpreter import batch_shape, evaluated, functions_of
from ...compiler.runtime.interpreter import compiles
from ...core.errors import MissingExtraError, ModelWarning, ValueRangeError
from .jax_operation import JaxOperation
from .request import BridgedQuantity

# ── A quantity as a function of JAX arrays for jit, vmap and differentiation: the program in JAX operations

# First derivatives J = df/d(x ⊕ v) and second derivatives H = dJ/dx come from analytic programs, in both modes:
#
#     forward   df = J B dx,  dJ = H dx,    backward   dx = Bᵀ Jᵀ w,
#
# B maps rates of coordinates to velocities and is the identity without quaternions. With quaternions JAX differentiates
# J, and JAX always computes third derivatives. On the CPU the compiled kernels run.


def jax_function(quantity: BridgedQuantity, precision: str) -> Callable[..., Any]:
    """Function of JAX arrays of any batch shape. Raises MissingExtraError."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise MissingExtraError.from_extra("jax", "jax", "robot.to_jax") from None
    inputs, values = quantity.inputs, _Differentiable(jax, quantity).values

    def function(*arrays: Any) -> Any:
        dtype = _dtype(jax, jnp, precision)
        converted = [jnp.asarray(a) for a in quantity.brought("to_jax", arrays, jax.Array)]
        quantity.require_shapes("to_jax", [a.shape for a in converted])
        for a, port in zip(converted, inputs, strict=True):
            if jnp.issubdtype(a.dtype, jnp.complexfloating):
                raise ValueRangeError(f"to_jax {quantity.name}: {port.name} is {a.dtype}, real numbers wanted.")
        return values(*(a.astype(dtype) for a in converted))

    function.__name__ = function.__qualname__ = quantity.name
    function.__doc__ = f"{quantity.name} of {quantity.engine.model.name}, of JAX arrays: {quantity.inputs_text}."
    return function


class _Differentiable:
    """One quantity as a function with analytic first and second derivatives in JAX."""

    def __init__(self, jax: Any, quantity: BridgedQuantity) -> None:
        self.jax, self.quantity, self.inputs, self.outputs = jax, quantity, quantity.inputs, quantity.program.outputs
        self.names = quantity.input_names
        self.rates = None
        if quantity.curved_inputs:
            self.rates = _array_function(jax.numpy, quantity.velocities())
        self._jacobians: dict[tuple[str, ...], Any] = {}
        self._hessians: dict[tuple[str, ...], Any] = {}
        self.values = jax.custom_jvp(_device_function(jax, quantity))
        self.values.defjvp(self.along, symbolic_zeros=True)

    def with_jacobian(self, by: tuple[str, ...]) -> Callable[..., Any]:
        """Values and J with respect to some inputs, with their own derivatives."""
        if by not in self._jacobians:
            function = self.jax.custom_jvp(_device_function(self.jax, self.quantity.derivative(by, values=True)))
            function.defjvp(partial(self.along_again, by), symbolic_zeros=True)
            self._jacobians[by] = function
        return self._jacobians[by]

    def hessian(self, by: tuple[str, ...]) -> Callable[..., Any]:
        """H with respect to some inputs."""
        if by not in self._hessians:
            self._hessians[by] = _device_function(self.jax, self.quantity.derivative(by, "hessian"))
        return self._hessians[by]

    def along(self, primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[Any, Any]:
        """Values and df = J B dx for the inputs with tangents."""
        moving, count = _inputs_with_tangents(self.jax, tangents), len(self.outputs)
        by = tuple(self.names[k] for k in moving)
        values_and_jacobians = self.with_jacobian(by)(*primals)
        jacobians = iter(values_and_jacobians[count:])
        steps = []
        for k in moving:
            if self.rates and self.names[k] in self.quantity.curved_inputs:
                steps.append((self.rates(primals[k], tangents[k]), 1))
            else:
                steps.append((tangents[k], len(self.inputs[k].shape)))
        changes = []
        for port in self.outputs:
            change: Any = 0
            for step, rank in steps:
                change = change + _contract(self.jax.numpy, next(jacobians), step, rank, port.shape)
            changes.append(change)
        return _alone(values_and_jacobians[:count]), _alone(tuple(changes))

    def along_again(
        self, by: tuple[str, ...], primals: Sequence[Any], tangents: Sequence[Any]
    ) -> tuple[Any, tuple[Any, ...]]:
        """Values and J with respect to some inputs, with df = J dx and dJ = H dx for the inputs with tangents."""
        jax, jnp, quantity, names, outputs = self.jax, self.jax.numpy, self.quantity, self.names, self.outputs
        moving = _inputs_with_tangents(jax, tangents)
        given = {*by, *(names[k] for k in moving)}
        involved = tuple(name for name in names if name in given)
        if not compiles() or any(name in quantity.curved_inputs for name in involved):
            plain = _array_function(jnp, quantity.derivative(by, values=True).program)
            dense = [t if k in moving else jnp.zeros(t.shape, t.dtype) for k, t in enumerate(tangents)]
            derivatives: tuple[Any, Any] = jax.jvp(plain, tuple(primals), tuple(dense))
            return derivatives
        columns = {}
        first = 0
        for port in self.inputs:
            if port.name in involved:
                columns[port.name] = slice(first, first + port.size)
                first += port.size
        jacobians = self.with_jacobian(involved)(*primals)[len(outputs) :]
        results = self.with_jacobian(by)(*primals)
        hessians = _result_tuple(self.hessian(involved)(*primals))
        changes, jacobian_changes = [], []
        for r, (port, H) in enumerate(zip(outputs, hessians, strict=True)):
            J = dict(zip(involved, jacobians[r * len(involved) :], strict=False))
            change: Any = 0.0
            jacobian_change: Any = 0.0
            for k in moving:
                step, rank = tangents[k], len(self.inputs[k].shape)
                change += _contract(jnp, J[names[k]], step, rank, port.shape)
                flat = step.reshape((*step.shape[: step.ndim - rank], self.inputs[k].size))
                jacobian_change += _contract(jnp, H[..., columns[names[k]]], flat, 1, (*port.shape, H.shape[-1]))
            changes.append(change)
            jacobian_changes += [jacobian_change[..., columns[name]].reshape(J[name].shape) for name in by]
        return results, (*changes, *jacobian_changes)


def _device_function(jax: Any, quantity: BridgedQuantity) -> Callable[..., Any]:
    """Program in JAX operations, or its kernel, by device and batch size; JAX differentiates it."""
    import jax.numpy as jnp

    program = quantity.program
    plain = _array_function(jnp, program)
    operation = JaxOperation(quantity, lambda *arrays: _result_tuple(plain(*arrays)))

    @jax.custom_batching.custom_vmap  # type: ignore[untyped-decorator]
    def run(*arrays: Any) -> Any:
        return _alone(operation(*arrays))

    @run.def_vmap  # type: ignore[untyped-decorator]
    def run_batch(size: int, mapped: Sequence[bool], *arrays: Any) -> tuple[Any, Any]:
        """Single call for the whole batch: the new axis precedes the batch axes of all inputs."""
        ranks = [a.ndim - len(p.shape) - m for a, p, m in zip(arrays, program.inputs, mapped, strict=True)]
        wide = list(arrays)
        for k, (a, rank, is_mapped) in enumerate(zip(arrays, ranks, mapped, strict=True)):
            if is_mapped:
                wide[k] = a.reshape((size, *(1,) * (max(ranks) - rank), *a.shape[1:]))
        return run(*wide), True if len(program.outputs) == 1 else (True,) * len(program.outputs)

    function: Any = jax.custom_jvp(run)
    function.defjvp(lambda primals, tangents: jax.jvp(plain, primals, tangents))
    result: Callable[..., Any] = function
    return result


def _inputs_with_tangents(jax: Any, tangents: Sequence[Any]) -> list[int]:
    """Inputs with tangents other than symbolic zeros."""
    return [k for k, t in enumerate(tangents) if not isinstance(t, jax.custom_derivatives.SymbolicZero)]


def _array_function(jnp: Any, program: Program) -> Callable[..., Any]:
    """Program on arrays whose last axes are those of its inputs."""
    functions = functions_of(jnp, jnp.where)

    def run(*arrays: Any) -> Any:
        batch = batch_shape(arrays, program)
        elements: list[Any] = []
        for a, port in zip(arrays, program.inputs, strict=True):
            flat = a.reshape((*a.shape[: a.ndim - len(port.shape)], port.size))
            elements += [flat[..., k] for k in range(port.size)]
        values = iter(evaluated(program, elements, functions))
        dtype = jnp.result_type(*arrays)
        results = [_stack(jnp, list(islice(values, port.size)), batch, port, dtype) for port in program.outputs]
        return _alone(tuple(results))

    return run


def _stack(jnp: Any, elements: Sequence[Any], batch: tuple[int, ...], port: TensorSpec, dtype: Any) -> Any:
    """Stack the elements of one result, some of which may be constants."""
    if not elements:
        return jnp.zeros((*batch, *port.shape), dtype)
    whole = jnp.stack([jnp.broadcast_to(jnp.asarray(e, dtype), batch) for e in elements], axis=-1)
    return whole.reshape((*batch, *port.shape))


def _contract(jnp: Any, J: Any, v: Any, rank: int, shape: tuple[int, ...]) -> Any:
    """J v for a result of that shape: contracts the last ``rank`` axes of J with those of v; batch shapes broadcast."""
    split = J.ndim - rank
    size = prod(J.shape[split:])
    rows = J.reshape((*J.shape[:split], size))
    steps = v.reshape((*v.shape[: v.ndim - rank], *(1,) * len(shape), size))
    # faster in XLA than a matrix product, which does not exploit rows of the identity
    return jnp.sum(rows * steps, axis=-1)


def _result_tuple(results: Any) -> tuple[Any, ...]:
    if isinstance(results, tuple):
        return results
    return (results,)


def _alone(results: tuple[Any, ...]) -> Any:
    return results[0] if len(results) == 1 else results


def _dtype(jax: Any, jnp: Any, precision: str) -> Any:
    if precision == "single":
        return jnp.float32
    if not jax.config.jax_enable_x64:
        warnings.warn(
            "JAX computes in float32 by default: jax.config.update('jax_enable_x64', True) gives what precision="
            "'double' needs; precision='single' accepts float32.",
            ModelWarning,
            stacklevel=3,
        )
        return jnp.float32
    return jnp.float64
