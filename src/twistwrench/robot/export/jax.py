"""Quantities as JAX functions, and kernels as in-place XLA calls on the CPU by its typed FFI.

Machine-code kernels have machine-code handlers (:mod:`twistwrench.compiler.runtime.xla_handler`). Kernels on NumPy, or composed
in Python, use the handler of :mod:`.xla_call`. It reads the needed fields of the structures of ``xla/ffi/api/c_api.h``,
which later versions only extend at the end.
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
# B maps rates of coordinates to velocities; without quaternions it is the identity. With quaternions, JAX differentiates J
# itself, and third derivatives are always JAX's. On the CPU the compiled kernels run.


def jax_function(quantity: BridgedQuantity, precision: str) -> Callable[..., Any]:
    """Function of JAX arrays of any batch shape. Raises MissingExtraError."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise MissingExtraError.from_extra("jax", "jax", "robot.to_jax") from None
    evaluate = _Differentiable(jax, quantity).evaluate

    def function(*arrays: Any) -> Any:
        dtype = _dtype(jax, jnp, precision)
        jax_arrays = [jnp.asarray(array) for array in quantity.brought("to_jax", arrays, jax.Array)]
        quantity.require_shapes("to_jax", [array.shape for array in jax_arrays])
        for array, port in zip(jax_arrays, quantity.inputs, strict=True):
            if jnp.issubdtype(array.dtype, jnp.complexfloating):
                raise ValueRangeError(f"to_jax {quantity.name}: {port.name} is {array.dtype}, real numbers wanted.")
        return evaluate(*(array.astype(dtype) for array in jax_arrays))

    function.__name__ = function.__qualname__ = quantity.name
    function.__doc__ = f"{quantity.name} of {quantity.engine.model.name}, of JAX arrays: {quantity.inputs_text}."
    return function


class _Differentiable:
    """One quantity as a function with analytic first and second derivatives in JAX."""

    def __init__(self, jax: Any, quantity: BridgedQuantity) -> None:
        self.jax = jax
        self.quantity = quantity
        self.inputs = quantity.inputs
        self.outputs = quantity.program.outputs
        self.names = quantity.input_names
        self.velocities = None
        """Function B dx of a configuration and its tangent; None if B is the identity."""
        if quantity.curved_inputs:
            self.velocities = _array_function(jax.numpy, quantity.velocities())
        self._jacobians: dict[tuple[str, ...], Any] = {}
        self._hessians: dict[tuple[str, ...], Any] = {}
        self.evaluate = jax.custom_jvp(_device_function(jax, quantity))
        """Function that returns the values."""
        self.evaluate.defjvp(self.along, symbolic_zeros=True)

    def with_jacobian(self, by: tuple[str, ...]) -> Callable[..., Any]:
        """Function that returns the values and J with respect to the inputs ``by``; it has derivatives too."""
        if by not in self._jacobians:
            derivative = self.quantity.derivative(by, values=True)
            function = self.jax.custom_jvp(_device_function(self.jax, derivative))
            function.defjvp(partial(self.along_again, by), symbolic_zeros=True)
            self._jacobians[by] = function
        return self._jacobians[by]

    def hessian(self, by: tuple[str, ...]) -> Callable[..., Any]:
        """Function that returns H with respect to the inputs ``by``."""
        if by not in self._hessians:
            self._hessians[by] = _device_function(self.jax, self.quantity.derivative(by, "hessian"))
        return self._hessians[by]

    def along(self, primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[Any, Any]:
        """Values and df = J B dx for the inputs with tangents."""
        output_count = len(self.outputs)
        moving_inputs = _inputs_with_tangents(self.jax, tangents)
        by = tuple(self.names[k] for k in moving_inputs)
        values_and_jacobians = self.with_jacobian(by)(*primals)
        jacobians = iter(values_and_jacobians[output_count:])  # by output, then by input
        tangents_and_ranks = []  # B dx, or dx with its number of axes
        for k in moving_inputs:
            if self.velocities and self.names[k] in self.quantity.curved_inputs:
                tangents_and_ranks.append((self.velocities(primals[k], tangents[k]), 1))
            else:
                tangents_and_ranks.append((tangents[k], len(self.inputs[k].shape)))
        changes = []
        for port in self.outputs:
            change: Any = 0
            for tangent, rank in tangents_and_ranks:
                J = next(jacobians)
                change = change + _contract(self.jax.numpy, J, tangent, rank, port.shape)
            changes.append(change)
        values = values_and_jacobians[:output_count]
        return _single_or_tuple(values), _single_or_tuple(tuple(changes))

    def along_again(
        self, by: tuple[str, ...], primals: Sequence[Any], tangents: Sequence[Any]
    ) -> tuple[Any, tuple[Any, ...]]:
        """Values and J with respect to the inputs ``by``, and df = J dx and dJ = H dx for the inputs with tangents."""
        jax = self.jax
        jnp = jax.numpy
        quantity = self.quantity
        names = self.names
        outputs = self.outputs
        moving_inputs = _inputs_with_tangents(jax, tangents)
        moving_names = [names[k] for k in moving_inputs]
        involved = tuple(name for name in names if name in by or name in moving_names)
        are_curved = any(name in quantity.curved_inputs for name in involved)
        if are_curved or not compiles():  # JAX differentiates
            program_function = _array_function(jnp, quantity.derivative(by, values=True).program)
            dense_tangents = list(tangents)
            for k, tangent in enumerate(tangents):
                if k not in moving_inputs:
                    dense_tangents[k] = jnp.zeros(tangent.shape, tangent.dtype)
            derivatives: tuple[Any, Any] = jax.jvp(program_function, tuple(primals), tuple(dense_tangents))
            return derivatives
        columns = {}  # of H by the name of an input
        first_column = 0
        for port in self.inputs:
            if port.name in involved:
                columns[port.name] = slice(first_column, first_column + port.size)
                first_column += port.size
        values_and_jacobians = self.with_jacobian(involved)(*primals)
        jacobians = values_and_jacobians[len(outputs) :]
        results = self.with_jacobian(by)(*primals)
        hessians = _result_tuple(self.hessian(involved)(*primals))
        changes = []
        jacobian_changes = []
        for index, (port, H) in enumerate(zip(outputs, hessians, strict=True)):
            first_jacobian = index * len(involved)
            end_jacobian = first_jacobian + len(involved)
            jacobian_by_input = dict(zip(involved, jacobians[first_jacobian:end_jacobian], strict=True))
            change: Any = 0.0
            jacobian_change: Any = 0.0
            for k in moving_inputs:
                name = names[k]
                tangent = tangents[k]
                rank = len(self.inputs[k].shape)
                change += _contract(jnp, jacobian_by_input[name], tangent, rank, port.shape)
                batch = tangent.shape[: tangent.ndim - rank]
                flat_tangent = tangent.reshape((*batch, self.inputs[k].size))
                H_columns = H[..., columns[name]]
                jacobian_change += _contract(jnp, H_columns, flat_tangent, 1, (*port.shape, H.shape[-1]))
            changes.append(change)
            for name in by:
                own_change = jacobian_change[..., columns[name]]
                jacobian_changes.append(own_change.reshape(jacobian_by_input[name].shape))
        return results, (*changes, *jacobian_changes)


def _device_function(jax: Any, quantity: BridgedQuantity) -> Callable[..., Any]:
    """Program in JAX operations, or its kernel, by device and batch size; JAX differentiates it."""
    import jax.numpy as jnp

    program = quantity.program
    program_function = _array_function(jnp, program)
    operation = JaxOperation(quantity, lambda *arrays: _result_tuple(program_function(*arrays)))

    @jax.custom_batching.custom_vmap  # type: ignore[untyped-decorator]
    def run(*arrays: Any) -> Any:
        """Results for arrays of any batch shape."""
        return _single_or_tuple(operation(*arrays))

    @run.def_vmap  # type: ignore[untyped-decorator]
    def run_batch(size: int, mapped: Sequence[bool], *arrays: Any) -> tuple[Any, Any]:
        """Single call for the whole batch: the new axis precedes the batch axes of all inputs."""
        batch_ranks = []  # without the new axis
        for array, port, is_mapped in zip(arrays, program.inputs, mapped, strict=True):
            batch_ranks.append(array.ndim - len(port.shape) - int(is_mapped))
        aligned = list(arrays)
        for k, is_mapped in enumerate(mapped):
            if is_mapped:
                missing_axes = (1,) * (max(batch_ranks) - batch_ranks[k])
                aligned[k] = arrays[k].reshape((size, *missing_axes, *arrays[k].shape[1:]))
        results_are_mapped = _single_or_tuple((True,) * len(program.outputs))
        return run(*aligned), results_are_mapped

    function: Any = jax.custom_jvp(run)
    function.defjvp(lambda primals, tangents: jax.jvp(program_function, primals, tangents))
    result: Callable[..., Any] = function
    return result


def _inputs_with_tangents(jax: Any, tangents: Sequence[Any]) -> list[int]:
    """Indices of the inputs with tangents other than symbolic zeros."""
    symbolic_zero = jax.custom_derivatives.SymbolicZero
    return [k for k, tangent in enumerate(tangents) if not isinstance(tangent, symbolic_zero)]


def _array_function(jnp: Any, program: Program) -> Callable[..., Any]:
    """Function that evaluates a program in operations on arrays, any batch axes first."""
    functions = functions_of(jnp, jnp.where)

    def run(*arrays: Any) -> Any:
        """Results of the program, one array for each output."""
        batch = batch_shape(arrays, program)
        elements: list[Any] = []
        for array, port in zip(arrays, program.inputs, strict=True):
            own_batch = array.shape[: array.ndim - len(port.shape)]
            flat = array.reshape((*own_batch, port.size))
            elements += [flat[..., k] for k in range(port.size)]
        result_elements = iter(evaluated(program, elements, functions))
        dtype = jnp.result_type(*arrays)
        results = []
        for port in program.outputs:
            port_elements = list(islice(result_elements, port.size))
            results.append(_stack(jnp, port_elements, batch, port, dtype))
        return _single_or_tuple(tuple(results))

    return run


def _stack(jnp: Any, elements: Sequence[Any], batch: tuple[int, ...], port: TensorSpec, dtype: Any) -> Any:
    """Array of one result from its elements; an element may be a constant without batch axes."""
    if not elements:
        return jnp.zeros((*batch, *port.shape), dtype)
    full_elements = [jnp.broadcast_to(jnp.asarray(element, dtype), batch) for element in elements]
    return jnp.stack(full_elements, axis=-1).reshape((*batch, *port.shape))


def _contract(jnp: Any, J: Any, v: Any, rank: int, shape: tuple[int, ...]) -> Any:
    """J v (..., *shape): sum over the last ``rank`` axes of J and v; batch shapes broadcast."""
    first_axis = J.ndim - rank
    size = prod(J.shape[first_axis:])
    rows = J.reshape((*J.shape[:first_axis], size))
    v_of_rows = v.reshape((*v.shape[: v.ndim - rank], *(1,) * len(shape), size))
    # Faster in XLA than a matrix product, which does not exploit rows of the identity.
    return jnp.sum(rows * v_of_rows, axis=-1)


def _result_tuple(results: Any) -> tuple[Any, ...]:
    """Results as a tuple, also if there is only one."""
    if isinstance(results, tuple):
        return results
    return (results,)


def _single_or_tuple(results: tuple[Any, ...]) -> Any:
    """The result itself if there is only one, else the tuple."""
    if len(results) == 1:
        return results[0]
    return results


def _dtype(jax: Any, jnp: Any, precision: str) -> Any:
    """JAX type of a precision; warns if JAX does not compute in double precision."""
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
