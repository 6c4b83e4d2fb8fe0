"""A quantity as a function of PyTorch tensors, with compiled kernels for values and gradients on the tensors' device.

Let f be the quantity, w the incoming gradient of its results, and v the incoming gradient of the results of G:

    backward        G(x, w) = d(w . f)/dx                          form "weighted"
    backward of G   d(G . v)/dx = d2(w . f)/dx2 v,  d(G . v)/dw = (df/dx) v      forms "hessian_along", "along"

Derivatives along joint twists are converted to derivatives by the entries of q, which differ for quaternions. With
quaternions PyTorch differentiates G, from the program in PyTorch operations; otherwise it does so for third derivatives
only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import compress
from typing import Any

from ...compiler.ir.program import Program
from ...compiler.lowering.reference_interpreter import batch_shape, evaluated, functions_of
from ...core.errors import KernelError, MissingExtraError, ValueRangeError
from .request import BridgedQuantity


def torch_function(quantity: BridgedQuantity) -> Callable[..., Any]:
    """Function of tensors of any batch shape. Raises MissingExtraError."""
    try:
        import torch
    except ImportError:
        raise MissingExtraError.from_extra("torch", "torch", "robot.to_torch") from None
    compute = _Differentiable(torch, quantity).apply
    _ = quantity.kernel  # built now: torch.compile cannot trace the construction of a kernel

    def function(*tensors: Any) -> Any:
        arrays = quantity.brought("to_torch", tensors, torch.Tensor)
        tensors = tuple(map(torch.as_tensor, arrays))
        quantity.require_shapes("to_torch", [tuple(t.shape) for t in tensors])
        # the usual case needs no conversion
        if not all(t.is_cpu and t.dtype is torch.float64 and t.layout is torch.strided for t in tensors):
            tensors = _convert_to_common_type(torch, quantity, tensors)
        return compute(*tensors)

    function.__name__ = function.__qualname__ = quantity.name
    function.__doc__ = f"{quantity.name} of {quantity.engine.model.name}, of PyTorch's tensors: {quantity.inputs_text}."
    return function


class _Differentiable:
    """One quantity as a function with two derivatives in PyTorch."""

    def __init__(self, torch: Any, quantity: BridgedQuantity) -> None:
        self.torch = torch
        self.quantity = quantity
        self.names = quantity.input_names
        self.curved_inputs = quantity.curved_inputs
        self.slopes_by_entries = None  # program from derivatives along joint twists to those by the entries of q
        if self.curved_inputs:
            self.slopes_by_entries = quantity.slopes()
        self._functions: dict[Any, Any] = {}  # keys: names of inputs for G, a derivative for its last kernel
        self.apply = _function(torch, quantity, self.backward)

    def backward(self, tensors: Sequence[Any], weights: Sequence[Any], needed: Sequence[bool]) -> list[Any]:
        """Gradients dx = d(w . f)/dx of the needed inputs, by their entries."""
        needed_names = tuple(compress(self.names, needed))
        gradient = self.quantity.derivative(needed_names, "weighted")
        takes_weights = len(gradient.inputs) > len(tensors)  # else G has weight 1, and is scaled below
        inputs = [*tensors]
        if takes_weights:
            inputs += weights
        if self.curved_inputs and self.torch.is_grad_enabled():
            gradients = _evaluate_program(self.torch, gradient.program, inputs)
        else:
            compute_gradient = self._gradient(needed_names)
            gradients = _result_list(compute_gradient(*inputs))
        if not takes_weights:
            (weight,) = weights
            for k, g in enumerate(gradients):
                new_axes = (1,) * (g.ndim - weight.ndim)
                gradients[k] = g * weight.reshape(weight.shape + new_axes)
        gradient_of = dict(zip(needed_names, gradients, strict=True))
        dx = []
        for name, tensor in zip(self.names, tensors, strict=True):
            slope = gradient_of.get(name)
            if slope is not None and name in self.curved_inputs:
                assert self.slopes_by_entries is not None
                (slope,) = _evaluate_program(self.torch, self.slopes_by_entries, [tensor, slope])
            dx.append(slope)  # None for an input that is not needed
        return dx

    def _gradient(self, names: tuple[str, ...]) -> Callable[..., Any]:
        """Function G of the gradients by the named inputs, with its own backward."""
        if names not in self._functions:
            gradient = self.quantity.derivative(names, "weighted")
            self._functions[names] = _function(self.torch, gradient, partial(self._backward_again, names))
        return self._functions[names]

    def _backward_again(
        self, names: tuple[str, ...], tensors: Sequence[Any], v: Sequence[Any], needed: Sequence[bool]
    ) -> list[Any]:
        """Gradients of G . v by x and w, None if not needed. G are the gradients by the inputs ``names``."""
        input_count = len(self.names)
        x, w = tensors[:input_count], tensors[input_count:]
        v_of = dict(zip(names, v, strict=True))
        directions = [v_of.get(name, self.torch.zeros_like(t)) for name, t in zip(self.names, x, strict=True)]
        second_derivative = self.quantity.derivative(self.names, "hessian_along")
        by_inputs = self._last_kernel(second_derivative)(*x, *w, *directions)
        gradients = _result_list(by_inputs)
        if w:
            first_derivative = self.quantity.derivative(names, "along")
            by_weights = self._last_kernel(first_derivative)(*x, *v)
            gradients += _result_list(by_weights)
        return _needed_gradients(gradients, needed)

    def _last_kernel(self, derivative: BridgedQuantity) -> Callable[..., Any]:
        """Kernel of a derivative; PyTorch differentiates it from its program."""
        if derivative not in self._functions:
            torch = self.torch

            def results(*x: Any) -> tuple[Any, ...]:
                return tuple(_evaluate_program(torch, derivative.program, x))

            def backward(tensors: Sequence[Any], weights: Sequence[Any], needed: Sequence[bool]) -> list[Any]:
                _, pull_back = torch.func.vjp(results, *tensors)  # from weights to gradients
                return _needed_gradients(pull_back(tuple(weights)), needed)

            self._functions[derivative] = _function(torch, derivative, backward)
        return self._functions[derivative]


def _function(torch: Any, quantity: BridgedQuantity, backward: Callable[..., list[Any]]) -> Callable[..., Any]:
    """Kernel as a function of tensors with the given backward, called with tensors, weights and flags of needed gradients."""
    ports = quantity.inputs

    def save(ctx: Any, inputs: Any, output: Any) -> None:  # noqa: ARG001  PyTorch passes them
        ctx.save_for_backward(*inputs)

    def forward_mode(ctx: Any, *tangents: Any) -> Any:  # noqa: ARG001  PyTorch passes them
        raise KernelError(
            f"to_torch {quantity.name} has derivatives backward only: torch.func.grad, vjp and jacrev, not jvp, jacfwd or "
            "hessian. jacrev(f) is the Jacobian, and jacrev(jacrev(f)) the Hessian."
        )

    def gradients(ctx: Any, *weights: Any) -> Any:
        tensors = ctx.saved_tensors
        broadcast_gradients = backward(tensors, weights, ctx.needs_input_grad)
        return tuple(map(_sum_to_shape, broadcast_gradients, tensors))

    class Transformed(torch.autograd.Function):  # type: ignore[misc]
        """Variant for torch.func, with the context set up separately; PyTorch inspects the signature in every call."""

        forward = staticmethod(lambda *tensors: _call_kernel(torch, quantity, tensors))
        setup_context = staticmethod(save)
        backward, jvp = staticmethod(gradients), staticmethod(forward_mode)

        @staticmethod
        def vmap(info: Any, dims: Any, *tensors: Any) -> Any:  # noqa: ARG004  PyTorch passes them
            """Single call for the whole batch: the new axis precedes the batch axes of all inputs.

            ``dims`` has the new axis of each tensor, or None.
            """
            # batch axes of each tensor without the new one
            ranks = [t.ndim - len(p.shape) - (d is not None) for t, p, d in zip(tensors, ports, dims, strict=True)]
            aligned_tensors = list(tensors)
            for k, (t, d, rank) in enumerate(zip(tensors, dims, ranks, strict=True)):
                if d is not None:
                    with_axis_first = t.movedim(d, 0)
                    new_size, *other_sizes = with_axis_first.shape
                    missing_axes = (1,) * (max(ranks) - rank)
                    aligned_tensors[k] = with_axis_first.reshape((new_size, *missing_axes, *other_sizes))
            results = Transformed.apply(*aligned_tensors)
            if isinstance(results, tuple):
                return results, (0,) * len(results)  # the new axis is the first of each result
            return results, 0

    class Plain(torch.autograd.Function):  # type: ignore[misc]
        """Variant without torch.func: takes a third of the time for one state."""

        @staticmethod
        def forward(ctx: Any, *tensors: Any) -> Any:
            ctx.save_for_backward(*tensors)
            return _call_kernel(torch, quantity, tensors)

        backward, jvp = staticmethod(gradients), staticmethod(forward_mode)

    # without this function of PyTorch, the variant for torch.func serves all calls
    transforms_are_active = getattr(torch._C, "_are_functorch_transforms_active", lambda: True)
    plain = Plain.apply
    transformed = Transformed.apply
    return lambda *tensors: (transformed if transforms_are_active() else plain)(*tensors)


def _call_kernel(torch: Any, quantity: BridgedQuantity, tensors: Sequence[Any]) -> Any:
    """Kernel results in the tensors' memory; on a GPU, results of the program in PyTorch operations."""
    if tensors[0].device.type == "cuda":
        results = _evaluate_program(torch, quantity.program, tensors)
        return tuple(results) if len(results) > 1 else results[0]
    # force: the memory of a lazy conjugate has the wrong imaginary part
    arrays = quantity.kernel(*(t.numpy(force=True) for t in tensors))
    if isinstance(arrays, tuple):
        return tuple(map(torch.as_tensor, arrays))
    return torch.as_tensor(arrays)


def _evaluate_program(torch: Any, program: Program, tensors: Sequence[Any]) -> list[Any]:
    """Program in PyTorch operations, which PyTorch can differentiate."""
    batch = batch_shape(tensors, program)
    elements: list[Any] = []
    for tensor, port in zip(tensors, program.inputs, strict=True):
        flat = tensor.reshape((*tensor.shape[: tensor.ndim - len(port.shape)], port.size))
        elements += [flat[..., k] for k in range(port.size)]

    def as_tensor(x: Any) -> Any:
        """Number or tensor in the type and on the device of the inputs."""
        return torch.as_tensor(x).to(tensors[0])

    def where(condition: Any, a: Any, b: Any) -> Any:
        return torch.where(condition, as_tensor(a), as_tensor(b))

    result_entries = iter(evaluated(program, elements, functions_of(torch, where)))
    results = []
    for port in program.outputs:
        port_entries = [as_tensor(next(result_entries)).expand(batch) for _ in range(port.size)]
        flat_result = tensors[0].new_zeros((*batch, 0))  # for an output without entries, which stack refuses
        if port_entries:
            flat_result = torch.stack(port_entries, dim=-1)
        results.append(flat_result.reshape((*batch, *port.shape)))
    return results


def _result_list(results: Any) -> list[Any]:
    """Results as a list; a kernel with one output returns it without a tuple."""
    if isinstance(results, tuple):
        return list(results)
    return [results]


def _needed_gradients(gradients: Sequence[Any], needed: Sequence[bool]) -> list[Any]:
    """Gradients of the needed inputs, and None in place of the others."""
    return [gradient if needs else None for gradient, needs in zip(gradients, needed, strict=True)]


def _sum_to_shape(gradient: Any, tensor: Any) -> Any:
    """Gradient, if there is one, summed over broadcast axes to the shape of the tensor."""
    if gradient is None or gradient.shape == tensor.shape:
        return gradient
    return gradient.sum_to_size(tensor.shape)


def _convert_to_common_type(torch: Any, quantity: BridgedQuantity, tensors: Sequence[Any]) -> tuple[Any, ...]:
    """Tensors in a common type: float32 if all are, else float64. Raises ValueRangeError, naming the invalid input."""
    ports = quantity.inputs
    for t, port in zip(tensors, ports, strict=True):
        _require_computable(torch, quantity.name, t, port.name)
    if len({t.device for t in tensors}) > 1:
        listed = ", ".join(f"{port.name} on {t.device}" for t, port in zip(tensors, ports, strict=True))
        raise ValueRangeError(f"to_torch {quantity.name}: {listed}. Move all to one device.")
    dtype = torch.float64
    if all(t.dtype == torch.float32 for t in tensors):
        dtype = torch.float32
    return tuple(t.to(dtype) for t in tensors)


def _require_computable(torch: Any, name: str, tensor: Any, label: str) -> None:
    """Raise ValueRangeError if the tensor of the input ``label`` has an unsupported device, type or layout."""
    if tensor.device.type not in ("cpu", "cuda"):
        raise ValueRangeError(
            f"to_torch {name}: {label} is on {tensor.device}; this computes on the processor and on NVIDIA's GPUs. Pass "
            f"{label}.cpu()."
        )
    if tensor.dtype.is_complex or tensor.dtype is torch.bool:
        raise ValueRangeError(f"to_torch {name}: {label} is {tensor.dtype}, real numbers wanted.")
    if tensor.layout is not torch.strided:
        raise ValueRangeError(
            f"to_torch {name}: {label} is {tensor.layout}, a dense tensor wanted: {label}.to_dense()."
        )
