"""Kernels as builtin functions of CPython for single samples, for calls that loops repeat at kilohertz rates.

NumPy takes longer to reach a ufunc's loop than most kernels run. A builtin passes plain arguments directly to the loop and
computes one sample in one lane. All other calls go to its fallback, a slower callable that also reports errors. Calls with
other options, another type or a batch of one get further builtins. They form a chain: each one is the fallback of another.
"""

from __future__ import annotations

import ctypes
import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import KernelError
from ...core.typing import Array
from ..ir.loops import Form
from ..ir.program import TensorSpec, axes_of
from ..lowering.target_machine import DOUBLE, SINGLE, Machine
from .dispatch_ir import CALL, POINTERS, BuiltinWriter, CallLayout, abi_matches, call_assembly
from .gufunc import KernelMetadata, numpy_function, owner_of
from .jit import Code, assemble

MAX_CHAIN_LENGTH = 16
"""Maximum number of builtins of one method, for different options or arrays."""

LONG_PROGRAM = 4000
"""Number of instructions from which a program is long: compilation takes a second or more."""
INSTRUCTIONS_PER_CALL = 100
"""A long program gets its builtin after a number of calls: its number of instructions divided by this constant."""
_CALLS_BEFORE_SHORT = 2
"""Number of calls before the builtin of a short program is made."""

# Slots in NumPy's array API table, fixed since NumPy 1.0.
_SCALAR = 60
"""PyArray_Scalar."""
_NEW_FROM_DESCRIPTOR = 94
"""PyArray_NewFromDescr."""

# CPython's flags of functions.
FASTCALL = 0x0080
"""Arguments are an array and its length."""
KEYWORDS = 0x0002
"""A tuple of keyword names follows the arguments."""

_ADDRESS_BYTES = 8
"""Size of an address."""


@dataclass(frozen=True)
class CallSignature:
    """Kind of call with one sample: its options, and the type and batch shape of all arrays."""

    options: tuple[tuple[str, Any], ...] = ()
    """Names of parameters, with their values; values are compared by identity. Other parameters have their defaults."""
    batch: tuple[int, ...] = ()
    """Batch shape of all arrays: empty, or only ones."""
    char: str = "d"
    """NumPy's type letter of the entries of all arrays."""


class kernel(bytes):  # its name is in the builtin's repr: "built-in method … of kernel object"
    """Addresses that a builtin uses; the builtin's ``self``.

    Python pickles a builtin as its ``self`` and its name, and reads it back as ``getattr(self, name)``. Addresses are invalid
    in another process. This object is therefore pickled and copied as the owner of the method, whose attribute of that name is
    the method itself.
    """

    owner: Any
    """Object whose method the builtin replaces."""
    kept: dict[str, Any]
    """All objects whose addresses the builtin uses, by name; the references here keep them alive."""

    def hand_on_to(self, other: Callable[..., Any]) -> None:
        """Set the fallback, to which the builtin passes all calls that it does not handle."""
        self.kept["fallback"] = other
        self.kept["place"].value = id(other)  # the builtin reads the fallback's address at this place

    def __reduce_ex__(self, protocol: Any) -> tuple[Callable[[Any], Any], tuple[Any]]:
        return _itself, (self.owner,)


def _itself(owner: Any) -> Any:
    """The argument itself: ``pickle`` calls this function to read a :class:`kernel` back."""
    return owner


class _MethodDefinition(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


class _KeepingText(str):
    """Name of a builtin's module, which keeps the builtin's objects alive: the builtin has a reference to this text."""

    kept: dict[str, Any]


def builtin(name: str, doc: str, code: Code, flags: int, context: bytes, kept: dict[str, Any]) -> Any:
    """Machine code as a builtin function of Python, whose ``self`` is ``context``; it keeps ``kept`` alive."""
    definition = _MethodDefinition(name.encode(), code.address, flags, doc.encode())
    module_name = _KeepingText("twistwrench.robot")
    module_name.kept = kept
    kept.update(code=code, definition=definition)
    new_function = ctypes.pythonapi.PyCFunction_NewEx
    new_function.restype = ctypes.py_object
    new_function.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.py_object]
    return new_function(ctypes.addressof(definition), context, module_name)


def table_of(addresses: list[int]) -> bytes:
    """Table of addresses as bytes, 8 for each."""
    return b"".join(address.to_bytes(_ADDRESS_BYTES, sys.byteorder) for address in addresses)


def address_of(name: str) -> int:
    """Address of a function of Python's C API."""
    function = getattr(ctypes.pythonapi, name)
    return ctypes.cast(function, ctypes.c_void_p).value or 0  # ctypes has None for address 0


def _owner(kernel: Any) -> Any:
    """Object that holds a kernel's machine code; None without such code, or if Python is not CPython with the GIL."""
    if not abi_matches():
        return None
    return owner_of(kernel)


def make_call(
    ufunc: Any, method: Callable[..., Any], name: str, call: CallSignature | None = None
) -> Callable[..., Any] | None:
    """Builtin that evaluates ``ufunc`` for calls of one kind, and passes all others to the bound ``method``.

    Returns None if the kernel is not compiled, the method has other parameters, or the interpreter is of another build.
    """
    owner = _owner(ufunc)
    if owner is None:
        return None
    call = call or CallSignature()
    signature = inspect.signature(method, follow_wrapped=False)
    layout = _layout(owner.given, signature, call)
    if layout is None:
        return None
    dtype = np.dtype(call.char)
    fallback_address = ctypes.c_void_p(id(method))
    loop = owner.scalar_code(layout.precision)
    parameters = list(signature.parameters.values())
    options = dict(call.options)
    objects: list[Any] = [parameter.name for parameter in parameters]
    for k, _ in layout.options:  # the values of the options follow the names of all parameters
        objects.append(options.get(parameters[k].name, parameters[k].default))
    addresses = {
        "array_type": id(np.ndarray),
        "list_type": id(list),
        "tuple_type": id(tuple),
        "float_type": id(float),
        "double_type": id(np.float64),
        "none": id(None),
        "descriptor": id(dtype),
        "new_array": numpy_function("_ARRAY_API", _NEW_FROM_DESCRIPTOR),
        "new_scalar": numpy_function("_ARRAY_API", _SCALAR),
        "new_tuple": address_of("PyTuple_New"),
        "vectorcall": address_of("PyObject_Vectorcall"),
        "incref": address_of("Py_IncRef"),
        "decref": address_of("Py_DecRef"),
        "loop": loop.address,
        "fallback": ctypes.addressof(fallback_address),
    }
    pointers = [addresses[name] for name in POINTERS]
    context = kernel(table_of([*pointers, *map(id, objects)]))
    context.owner = method.__self__  # type: ignore[attr-defined]
    context.kept = {
        "ufunc": ufunc,
        "fallback": method,
        "place": fallback_address,
        "loop": loop,
        "dtype": dtype,
        "objects": objects,
    }
    without_annotations = [parameter.replace(annotation=parameter.empty) for parameter in parameters]
    # inspect.signature reads the signature of a builtin from this form of its docstring.
    doc = f"{name}{inspect.Signature(without_annotations)}\n--\n\n{method.__doc__ or ''}"
    code = assemble(call_assembly(layout), CALL, owner.machine)
    function: Callable[..., Any] = builtin(name, doc, code, FASTCALL | KEYWORDS, context, context.kept)
    return function


def _layout(program: Form | KernelMetadata, signature: inspect.Signature, call: CallSignature) -> CallLayout | None:
    """Layout of calls of one kind; None if no builtin can handle them.

    The first parameters of the method are the program's inputs, and the others are options.
    """
    inputs = _with_batch(program.inputs, call.batch)
    outputs = _with_batch(program.outputs, call.batch)
    parameters = signature.parameters
    names = list(parameters)
    input_count = len(inputs)
    options = dict(call.options)
    lacks_inputs = input_count > len(names)
    unknown_options = options.keys() - names[input_count:]
    has_several_samples = any(length != 1 for length in call.batch)
    if lacks_inputs or has_several_samples or unknown_options:
        return None
    has_number = any(not port.shape for port in program.outputs)
    returns_number_in_tuple = len(outputs) > 1 and has_number
    has_empty_array = any(port.size == 0 for port in (*inputs, *outputs))
    if returns_number_in_tuple or has_empty_array:
        return None
    option_defaults = []  # index of the parameter, and True if its value is the default
    out_index = -1  # of the parameter "out"; -1 without such a parameter
    for k, name in enumerate(names[input_count:], start=input_count):
        default = parameters[name].default
        if name not in options and default is inspect.Parameter.empty:
            return None
        if name == "out":
            out_index = k
            continue
        value = options.get(name, default)
        is_equal_text = type(value) is str and value == default
        option_defaults.append((k, value is default or is_equal_text))
    keyword_only = [p for p in parameters.values() if p.kind is p.KEYWORD_ONLY]
    precision = SINGLE if call.char == SINGLE.char else DOUBLE
    positional_count = len(names) - len(keyword_only)
    batch_axes = len(call.batch)
    return CallLayout(
        inputs, outputs, precision, len(names), positional_count, tuple(option_defaults), out_index, batch_axes
    )


def _with_batch(ports: Sequence[TensorSpec], batch: tuple[int, ...]) -> tuple[TensorSpec, ...]:
    """Arrays with batch axes before their own."""
    return tuple(TensorSpec(port.name, batch + port.shape) for port in ports)


def is_made_here(function: Any) -> bool:
    """True for builtins made by :func:`make_call`."""
    return type(getattr(function, "__self__", None)) is kernel


def attach_fallback(first: Any, other: Any) -> None:
    """Insert ``other`` between ``first`` and its fallback, unless the chain already has :data:`MAX_CHAIN_LENGTH` builtins."""
    chain_length = 1
    fallback = first.__self__.kept["fallback"]
    while is_made_here(fallback):
        chain_length += 1
        fallback = fallback.__self__.kept["fallback"]
    if chain_length < MAX_CHAIN_LENGTH:
        other.__self__.hand_on_to(first.__self__.kept["fallback"])
        first.__self__.hand_on_to(other)


def calls_before(ufunc: Any) -> int:
    """Number of single-state calls after which a builtin is worth its compilation; 0 if none can be made."""
    owner = _owner(ufunc)
    if owner is None:
        return 0
    if owner.length < LONG_PROGRAM:
        return _CALLS_BEFORE_SHORT
    return owner.length // INSTRUCTIONS_PER_CALL


# ── Prepared calls of a kernel's loop, row by row: NumPy's overhead for a ufunc exceeds the run time of short loops

# A table has a row for each call: the addresses of the operands. ``call(number, array)`` copies the array to one operand of row
# ``number``, runs the loop on the row, and returns one number of the results as a float. ``call(number)`` uses the operand
# unchanged. If the array is not a contiguous float64 array, the call returns None without effect. The code contains sizes;
# the addresses are in ``self``.

ROW_POINTERS = (
    "none",
    "array_type",
    "descriptor",
    "as_number",
    "new_float",
    "incref",
    "loop",
    "table",
    "sizes",
    "strides",
)
"""Names of the addresses in ``self``, 8 bytes each, in their order."""

Rows = tuple[Array, NDArray[np.intp]]
"""Values of one operand in n calls: an array with m rows (m, ...), and the row that each call uses (n,)."""


@cache
def _row_code(operand_count: int, size: int, taken: int, passed: int, machine: Machine) -> Code:
    """Code of a prepared call.

    ``taken`` is the index of the operand to which ``size`` doubles are copied, ``passed`` of the one whose first number is
    returned.
    """
    call = BuiltinWriter(DOUBLE, ROW_POINTERS)
    w = call.w
    number = w.new(f"call i64 {call.known('as_number')}(ptr {call.entry('%args', 0)})")
    row_bytes = _ADDRESS_BYTES * operand_count
    table = call.known("table")
    row_offset = w.new(f"mul i64 {number}, {row_bytes}")
    row = w.gep(table, row_offset)
    call.fork("icmp eq i64 %count, 1", "run", "copy")  # without an array, nothing is copied
    call.begin("copy")
    source = call.array(call.entry("%args", 1), TensorSpec("x", (size,)))
    target = call.entry(row, taken)
    array_bytes = DOUBLE.bytes * size
    w.do(f"call void @llvm.memcpy.p0.p0.i64(ptr align 8 {target}, ptr align 8 {source}, i64 {array_bytes}, i1 false)")
    w.do("br label %run")
    call.begin("run")
    loop, sizes, strides = call.known("loop"), call.known("sizes"), call.known("strides")
    w.do(f"call void {loop}(ptr {row}, ptr {sizes}, ptr {strides}, ptr null)")
    new_float = call.known("new_float")
    value = w.new(f"load double, ptr {call.entry(row, passed)}, align 8")
    result = w.new(f"call ptr {new_float}(double {value})")
    w.do(f"ret ptr {result}")
    call.begin("slow")  # for other arrays
    none = call.known("none")
    w.do(f"call void {call.known('incref')}(ptr {none})")
    w.do(f"ret ptr {none}")
    declaration = "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1 immarg)"
    text = [declaration, f"define ptr @{CALL}(ptr %self, ptr %args, i64 %count) {{\nentry:", *w.lines, "}\n"]
    return assemble("\n".join(text), CALL, machine)


def can_bind_calls(kernel: Any) -> bool:
    """True if calls row by row can be prepared: for a compiled kernel in CPython with the GIL."""
    return _owner(kernel) is not None


def bind_calls(kernel: Any, operands: Sequence[Rows], taken: int, passed: int) -> Callable[..., Any]:
    """Function ``call`` that makes one of n prepared calls of a kernel.

    Each call uses one row of every operand; for a scan, it makes one step. ``call(k, x)`` copies x to the row of operand
    ``taken``, makes call k, and returns the first number of operand ``passed``. ``call(k)`` uses the row unchanged. If x is not
    a contiguous float64 array of the operand's size, the call returns None without effect. k is not checked.
    """
    owner = _owner(kernel)
    if owner is None:
        raise KernelError("calls row by row are prepared for compiled kernels only.")
    sizes: dict[int, int] = {0: 1}  # by number of the axis; axis 0 is the batch, of one sample
    strides: list[int] = [0] * len(operands)  # of the batch axis, then of the core axes of each operand
    ports = (*owner.given.inputs, *owner.given.outputs)
    for port, axes, (array, _) in zip(ports, axes_of(owner.given.signature), operands, strict=True):
        if array.shape[1:] != port.shape or array.dtype != np.float64:
            raise KernelError(f"{port.name}: rows {array.shape[1:]} of {array.dtype}, and not {port.shape} of float64.")
        scan_axis_count = len(axes) - len(port.shape)  # the axes of a scan's steps and rows have length 1
        axis_lengths = (1,) * scan_axis_count + port.shape
        sizes |= dict(zip(axes, axis_lengths, strict=True))
        strides += [0] * scan_axis_count + list(array.strides[1:])
    arrays, row_numbers = zip(*operands, strict=True)
    first_addresses = np.array([array.ctypes.data for array in arrays], np.intp)
    row_strides = np.array([array.strides[0] for array in arrays], np.intp)
    row_addresses = first_addresses + np.stack(row_numbers, axis=1) * row_strides  # (n, operands)
    tables = {
        "table": np.ascontiguousarray(row_addresses),
        "sizes": np.array([sizes[k] for k in range(len(sizes))], np.intp),
        "strides": np.array(strides, np.intp),
    }
    code = _row_code(len(operands), ports[taken].size, taken, passed, owner.machine)
    dtype = np.dtype(float)
    addresses = {
        "none": id(None),
        "array_type": id(np.ndarray),
        "descriptor": id(dtype),
        "as_number": address_of("PyLong_AsSsize_t"),
        "new_float": address_of("PyFloat_FromDouble"),
        "incref": address_of("Py_IncRef"),
        "loop": owner.code[DOUBLE.char].address,
        "table": tables["table"].ctypes.data,
        "sizes": tables["sizes"].ctypes.data,
        "strides": tables["strides"].ctypes.data,
    }
    kept = {"kernel": kernel, "operands": tuple(operands), "tables": tables, "dtype": dtype}
    context = table_of([addresses[name] for name in ROW_POINTERS])
    function: Callable[..., Any] = builtin(CALL, "A prepared call.", code, FASTCALL, context, kept)
    return function
