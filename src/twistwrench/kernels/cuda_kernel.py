"""A program as a function of arrays in a GPU's memory: checked, launched on the caller's stream, not waited for."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import KernelError, ShapeError, ValueRangeError
from ..program.port import Port
from ..program.program import Program
from ..targets.cuda_text import CudaFunction
from . import nvrtc
from .cuda_driver import Driver, driver
from .device_array import LEGACY, DeviceArray, View, empty_like, view

LARGEST = 40_000
"""Programs beyond this many instructions are refused: NVIDIA's compiler would take very long over one function of them."""

_PRECISIONS = {np.dtype(np.float32): "float", np.dtype(np.float64): "double"}
_MOST_PLANS = 256
_WHOLE = "such as by .contiguous() in PyTorch, cupy.ascontiguousarray in CuPy"


class _Plan(NamedTuple):
    """What follows from the shapes, strides and types of the inputs alone; kept, for a loop has the same ones each time."""

    dtype: np.dtype[Any]
    batch: tuple[int, ...]
    steps: tuple[int, ...]
    shapes: tuple[tuple[int, ...], ...]
    reaches: tuple[tuple[int, int], ...]


class CudaKernel:
    """GPU kernel: a program compiled when first called there, once for float32 and once for float64.

    Called with arrays that have ``__cuda_array_interface__`` or DLPack, (..., *shape of the input), all float32 or all
    float64, all on one GPU. An input without batch axes, or repeated along all of them, serves all samples. Outputs are
    arrays of the first input's library, or those of ``out=``; they are there when their stream has got that far, which
    is the first input's unless ``stream=`` names another.

    Parameters
    ----------
    name : str, of the function
    program : Program
    label : str, for messages

    Raises
    ------
    ShapeError, ValueRangeError, KernelError, MissingExtraError
        When called.
    """

    def __init__(self, name: str, program: Program, label: str) -> None:
        if len(program.instructions) > LARGEST:
            raise KernelError(
                f"{label} takes {len(program.instructions)} instructions, more than the {LARGEST} that NVIDIA's compiler is "
                "given. Ask for parts of it, or use the robot's own method."
            )
        self.name, self.program, self.label = name, program, label
        self._loaded: dict[tuple[str, int, int], Any] = {}
        self._functions: dict[str, CudaFunction] = {}
        self._plans: dict[Any, _Plan] = {}
        self._lock = threading.Lock()

    def __repr__(self) -> str:
        return f"<CudaKernel {self.label}: {self.program.signature}>"

    def function(self, precision: str) -> CudaFunction:
        """Source and launch of the kernel in one precision.

        Parameters
        ----------
        precision : "float" or "double"

        Returns
        -------
        function : CudaFunction

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.panda().cuda.kernel("mass_matrix").function("float").precision
        'float'
        """
        if precision not in self._functions:
            self._functions[precision] = CudaFunction(self.name, self.program, precision)
        return self._functions[precision]

    def __call__(self, *arrays: Any, out: Any = None, stream: Any = None) -> Any:
        """Launch it."""
        given = self._views(arrays, self.program.inputs, "inputs")
        plan = self._plan(given)
        outputs, taken = None, []
        if out is not None:
            outputs = tuple(out) if isinstance(out, tuple | list) else (out,)
            taken = self._views(outputs, self.program.outputs, "arrays in out=")
            self._check_outputs(taken, plan, given)
        gpu = driver()
        device = self._device(gpu, [*given, *taken])
        on = _stream(stream, self.label) or _stream_of(given)
        with gpu.context(device) as context:
            if outputs is None:
                outputs = tuple(empty_like(arrays[0], shape, plan.dtype, device, on) for shape in plan.shapes)
                taken = [view(o, self.label) for o in outputs]
            samples = math.prod(plan.batch)
            if samples:
                for other in dict.fromkeys(v.stream or LEGACY for v in (*given, *taken) if v.stream is not None):
                    gpu.wait(on, other)
                function = self.function(_PRECISIONS[plan.dtype])
                code = self._code(gpu, function, device, context)
                inputs = itertools.chain.from_iterable(zip((v.address for v in given), plan.steps, strict=True))
                arguments = [samples, *inputs, *(v.address for v in taken)]
                gpu.launch(code, -(-samples // function.threads), function.threads, on, arguments)
                for o in outputs:
                    if isinstance(o, DeviceArray):
                        o.stream = on
        return outputs[0] if len(outputs) == 1 else outputs

    def _code(self, gpu: Driver, function: CudaFunction, device: int, context: int) -> Any:
        key = (function.precision, device, context)
        with self._lock:
            if key not in self._loaded:
                text = nvrtc.compiled(function.source, function.name, function.options, gpu.capability(device))
                self._loaded[key] = gpu.function(text, function.name)
            return self._loaded[key]

    # ── the door ──

    def _views(self, arrays: Sequence[Any], ports: Sequence[Port], what: str) -> list[View]:
        if len(arrays) != len(ports):
            names = ", ".join(port.name for port in ports)
            raise ShapeError(f"{self.label}: {len(arrays)} {what} given, {len(ports)} wanted: {names}.")
        return [view(a, f"{self.label}: {port.name}") for a, port in zip(arrays, ports, strict=True)]

    def _plan(self, given: Sequence[View]) -> _Plan:
        key = tuple([(v.shape, v.strides, v.dtype) for v in given])
        plan = self._plans.get(key)
        if plan is None:
            dtype, batch = self._dtype(given), self._batch(given)
            steps = [self._step(v, port, batch) for v, port in zip(given, self.program.inputs, strict=True)]
            shapes = [batch + port.shape for port in self.program.outputs]
            plan = _Plan(dtype, batch, tuple(steps), tuple(shapes), tuple(v.reach for v in given))
            if len(self._plans) >= _MOST_PLANS:
                self._plans.clear()
            self._plans[key] = plan
        return plan

    def _dtype(self, given: Sequence[View]) -> np.dtype[Any]:
        labelled = [(port.name, v.dtype) for port, v in zip(self.program.inputs, given, strict=True)]
        for name, dtype in labelled:
            if dtype not in _PRECISIONS:
                raise ValueRangeError(
                    f"{self.label}: {name} is of type {dtype}; robot.cuda takes float32 and float64. Convert it first."
                )
        if len({dtype for _, dtype in labelled}) > 1:
            listed = ", ".join(f"{name} {dtype}" for name, dtype in labelled)
            raise ValueRangeError(f"{self.label}: the inputs are of several types: {listed}. Convert them to one.")
        return labelled[0][1]

    def _batch(self, given: Sequence[View]) -> tuple[int, ...]:
        """The shape that the batch axes of all inputs broadcast to."""
        batches = []
        for port, v in zip(self.program.inputs, given, strict=True):
            rank = len(v.shape) - len(port.shape)
            if rank < 0 or v.shape[rank:] != port.shape:
                wanted = ", ".join(["…", *map(str, port.shape)])
                raise ShapeError(f"{self.label}: {port.name} has shape {v.shape}, wanted ({wanted}).")
            batches.append(v.shape[:rank])
        try:
            return np.broadcast_shapes(*batches)
        except ValueError:
            listed = ", ".join(f"{port.name} {b}" for port, b in zip(self.program.inputs, batches, strict=True))
            raise ShapeError(f"{self.label}: the batch shapes do not broadcast: {listed}.") from None

    def _step(self, v: View, port: Port, batch: tuple[int, ...]) -> int:
        """How many elements lie from one sample to the next; 0 for one that serves all."""
        rank = len(v.shape) - len(port.shape)
        if not _without_gaps(port.shape, v.strides[rank:]):
            raise ValueRangeError(
                f"{self.label}: the elements of one sample of {port.name} do not lie next to each other, in the order of "
                f"their axes (strides {v.strides}). Make the array contiguous, {_WHOLE}."
            )
        own = [1] * (len(batch) - rank) + list(v.shape[:rank])
        strides = [0] * (len(batch) - rank) + list(v.strides[:rank])
        step = span = None
        for wide, length, stride in reversed(list(zip(batch, own, strides, strict=True))):
            if wide == 1:
                continue
            stride = stride if length == wide else 0
            if step is None:
                step = stride
            elif stride != span:
                raise ValueRangeError(
                    f"{self.label}: the samples of {port.name}, shape {v.shape}, are not a fixed distance apart in the batch "
                    f"{batch}: broadcast along some of its axes only, or cut out of a larger array. Broadcast it to "
                    f"{batch + port.shape} and make that contiguous, {_WHOLE}."
                )
            span = stride * wide
        return port.size if step is None else step

    def _check_outputs(self, taken: Sequence[View], plan: _Plan, given: Sequence[View]) -> None:
        spans = [
            (port.name, v.address + low, v.address + end)
            for port, v, (low, end) in zip(self.program.inputs, given, plan.reaches, strict=True)
        ]
        for port, v, shape in zip(self.program.outputs, taken, plan.shapes, strict=True):
            where = f"{self.label}: out= for {port.name}"
            if v.shape != shape or v.dtype != plan.dtype:
                raise ShapeError(f"{where} is {v.dtype} of shape {v.shape}, wanted {plan.dtype} of shape {shape}.")
            if not _without_gaps(v.shape, v.strides):
                raise ValueRangeError(f"{where} has gaps (strides {v.strides}). Give a contiguous array.")
            if v.readonly:
                raise ValueRangeError(f"{where} cannot be written to.")
            first, end = v.address, v.address + math.prod(shape) * plan.dtype.itemsize
            for name, other_first, other_end in spans:
                if first < other_end and other_first < end:
                    raise ValueRangeError(f"{where} overlaps {name}. Give memory of its own.")
            spans.append((f"out= for {port.name}", first, end))

    def _device(self, gpu: Driver, views: Sequence[View]) -> int:
        """The one GPU that all arrays are on."""
        names = [port.name for port in (*self.program.inputs, *self.program.outputs)]
        found: dict[int, str] = {}
        for name, v in zip(names, views, strict=False):
            if v.empty:
                continue
            device = gpu.device_of(v.address)
            if device is None:
                raise ValueRangeError(
                    f"{self.label}: {name} says that it is in a GPU's memory, and the driver knows nothing of it there."
                )
            found.setdefault(device, name)
        if len(found) > 1:
            listed = ", ".join(f"{name} on GPU {device}" for device, name in found.items())
            raise ValueRangeError(f"{self.label}: the arrays are on several GPUs: {listed}. Move them to one.")
        return next(iter(found)) if found else gpu.current_device()


def _without_gaps(shape: Sequence[int], strides: Sequence[int]) -> bool:
    """Whether elements lie one after another in C order; axes of length 1 may have any stride."""
    expected = 1
    for length, stride in reversed(list(zip(shape, strides, strict=True))):
        if length > 1 and stride != expected:
            return False
        expected *= length
    return True


def _stream(given: Any, label: str) -> int | None:
    """The handle of a stream: a number, PyTorch's, CuPy's, or what has ``__cuda_stream__``."""
    if given is None:
        return None
    protocol = getattr(given, "__cuda_stream__", None)
    handle = protocol()[1] if callable(protocol) else getattr(given, "cuda_stream", getattr(given, "ptr", given))
    if not isinstance(handle, int) or isinstance(handle, bool) or handle < 0:
        raise ValueRangeError(
            f"{label}: stream={given!r} is no stream. Give a handle, torch.cuda.current_stream() or cupy.cuda.Stream()."
        )
    return handle or LEGACY


def _stream_of(given: Sequence[View]) -> int:
    """The stream of the first input that has one."""
    return next((v.stream or LEGACY for v in given if v.stream is not None), LEGACY)
