"""Kernels as builtin functions of CPython for single samples: the calls that loops at kilohertz repeat.

NumPy takes longer to reach a ufunc's loop than most kernels run. A builtin takes plain arguments straight to the loop and
computes one sample in one lane; all other calls go to a slower callable, which also reports errors. Other options, another type
or a batch of one are calls of another kind; their builtins form a chain, in which each asks the next.
"""

from __future__ import annotations

import ctypes
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..ir.loops import Form
from ..ir.program import TensorSpec
from ..lowering.target_machine import DOUBLE, SINGLE
from .dispatch_ir import CALL, POINTERS, CallLayout, abi_matches, call_assembly
from .gufunc import numpy_function, owner_of
from .jit import Code, assembled
from .kernel_metadata import KernelMetadata

MOST_IN_A_ROW = 16
"""Builtins of one method, for other options or other arrays."""

LONG, EACH = 4000, 100
"""Programs of ``LONG`` instructions take a second to compile: they wait for one call for ``EACH`` instructions."""

_SCALAR, _NEW_FROM_DESCRIPTOR = 60, 94
"""Slots of PyArray_Scalar and PyArray_NewFromDescr in NumPy's array API table; fixed since NumPy 1.0."""

FASTCALL, KEYWORDS = 0x0080, 0x0002
"""CPython's flags of functions that take a table of arguments and its length; and a tuple of names."""


@dataclass(frozen=True)
class CallSignature:
    """One kind of call with one sample: its options, and the type and batch shape of all arrays."""

    options: tuple[tuple[str, Any], ...] = ()
    """Parameters by name and the objects they are; all others have their defaults."""
    batch: tuple[int, ...] = ()
    """The batch shape of all arrays: none, or ones."""
    char: str = "d"
    """NumPy's letter for the type of all arrays."""


class kernel(bytes):  # the name in the builtin's repr: "built-in method … of kernel object"
    """The addresses that a builtin works with; the builtin's ``self``.

    Addresses mean nothing in another process. A builtin is pickled as the attribute of its name of its ``self``; this object is
    pickled and copied as the owner of the method, so the owner's own method of that name comes out.
    """

    owner: Any
    kept: dict[str, Any]
    """All objects that the builtin points to, by name."""

    def hand_on_to(self, other: Callable[..., Any]) -> None:
        """Set the callable for all calls that the builtin does not serve."""
        self.kept["fallback"] = other
        self.kept["place"].value = id(other)

    def __reduce_ex__(self, protocol: Any) -> tuple[Callable[[Any], Any], tuple[Any]]:
        return _same, (self.owner,)


def _same(owner: Any) -> Any:
    return owner


class _MethodDefinition(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


class _Keeper(str):
    """A text that keeps alive all that a builtin points to: the builtin holds it as the name of its module."""

    kept: dict[str, Any]


def builtin(name: str, doc: str, code: Code, flags: int, context: bytes, kept: dict[str, Any]) -> Any:
    """Machine code as a builtin function of Python, whose ``self`` is ``context``; it keeps ``kept`` alive."""
    definition = _MethodDefinition(name.encode(), code.address, flags, doc.encode())
    keeper = _Keeper("twistwrench.robot")
    keeper.kept = kept
    kept.update(code=code, definition=definition)
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.py_object]
    return make(ctypes.addressof(definition), context, keeper)


def table_of(addresses: list[int]) -> bytes:
    """Addresses as bytes, 8 each."""
    return b"".join(address.to_bytes(8, sys.byteorder) for address in addresses)


def address_of(name: str) -> int:
    """The address of a function of Python's C API."""
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0


def make_call(
    ufunc: Any, method: Callable[..., Any], name: str, call: CallSignature | None = None
) -> Callable[..., Any] | None:
    """A builtin that evaluates ``ufunc`` for calls of one kind, and calls ``method``, a bound one, for all others.

    None if it cannot be made: no compiled kernel, a method with other parameters, an interpreter of another build.
    """
    owner = owner_of(ufunc)
    if owner is None or not abi_matches():
        return None
    call = call or CallSignature()
    parameters = inspect.signature(method, follow_wrapped=False)
    layout = _layout(owner.given, parameters, call)
    if layout is None:
        return None
    dtype, place = np.dtype(call.char), ctypes.c_void_p(id(method))
    loop, names = owner.scalar_code(layout.precision), list(parameters.parameters)
    wanted = {name: p.default for name, p in parameters.parameters.items()} | dict(call.options)
    objects = [*names, *(wanted[names[k]] for k, _ in layout.options)]
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
        "fallback": ctypes.addressof(place),
    }
    context = kernel(table_of([*(addresses[n] for n in POINTERS), *map(id, objects)]))
    context.owner = method.__self__  # type: ignore[attr-defined]
    context.kept = {
        "ufunc": ufunc,
        "fallback": method,
        "place": place,
        "loop": loop,
        "dtype": dtype,
        "objects": objects,
    }
    shown = [p.replace(annotation=p.empty) for p in parameters.parameters.values()]
    doc = f"{name}{inspect.Signature(shown)}\n--\n\n{method.__doc__ or ''}"  # read by inspect.signature
    code = assembled(call_assembly(layout), CALL, owner.machine)
    found: Callable[..., Any] = builtin(name, doc, code, FASTCALL | KEYWORDS, context, context.kept)
    return found


def _layout(program: Form | KernelMetadata, signature: inspect.Signature, call: CallSignature) -> CallLayout | None:
    """The layout of calls of one kind; None if no builtin can serve them."""
    inputs, outputs = (
        tuple(TensorSpec(spec.name, call.batch + spec.shape) for spec in specs)
        for specs in (program.inputs, program.outputs)
    )
    count, options, parameters = len(inputs), dict(call.options), signature.parameters
    names = list(parameters)
    scalar = len(outputs) > 1 and not all(spec.shape for spec in program.outputs)
    unknown = {*options} - {*names[count:]}
    missing = [n for n in names[count:] if n not in options and parameters[n].default is inspect.Parameter.empty]
    if any(n != 1 for n in call.batch) or scalar or unknown or missing or count > len(names):
        return None
    if not all(spec.size for spec in (*inputs, *outputs)):
        return None

    def is_default(name: str) -> bool:
        default = parameters[name].default
        value = options.get(name, default)
        return value is default or (type(value) is str and value == default)

    return CallLayout(
        inputs,
        outputs,
        SINGLE if call.char == SINGLE.char else DOUBLE,
        len(names),
        sum(p.kind is not p.KEYWORD_ONLY for p in parameters.values()),
        tuple((k, is_default(names[k])) for k in range(count, len(names)) if names[k] != "out"),
        names.index("out") if "out" in names else -1,
        len(call.batch),
    )


def is_made_here(function: Any) -> bool:
    """True for a builtin of :func:`make_call`."""
    return type(getattr(function, "__self__", None)) is kernel


def attach_fallback(first: Any, other: Any) -> None:
    """Insert a builtin between another and its fallback, unless the chain has :data:`MOST_IN_A_ROW`."""
    following, number = first.__self__.kept["fallback"], 1
    while is_made_here(following):
        following, number = following.__self__.kept["fallback"], number + 1
    if number < MOST_IN_A_ROW:
        other.__self__.hand_on_to(first.__self__.kept["fallback"])
        first.__self__.hand_on_to(other)


def calls_before(ufunc: Any) -> int:
    """Number of calls with one state after which a builtin pays: two, more for long programs; 0: never."""
    owner = owner_of(ufunc)
    if owner is None or not abi_matches():
        return 0
    return 2 if owner.length < LONG else owner.length // EACH
