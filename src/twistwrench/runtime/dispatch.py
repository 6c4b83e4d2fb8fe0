"""What calls of a method have in common that one shortcut serves."""

from __future__ import annotations

import ctypes
import sys
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..ir.loops import Form
from ..ir.program import TensorSpec
from ..lowering.target_machine import DOUBLE, SINGLE
from .call_signature import BYTES_DATA, FIELDS, LIST_ITEMS, POINTERS, SIZE, TUPLE_ITEMS, Way
from .dispatch_ir import CALL, FLOAT_VALUE, call_assembly
from .gufunc import owner_of
from .interpreter import runs_machine_code
from .jit import assembled
from .kernel_metadata import KernelMetadata


@dataclass(frozen=True)
class CallForm:
    """One kind of calls with one sample: its options, its dict of arrays, the type and the batch shape of all arrays."""

    options: tuple[tuple[str, Any], ...] = ()
    """Parameters by name and the very objects they are given as; all others have their defaults."""
    mapping: str = ""
    """The parameter that is a dict of further arrays, if one is."""
    keys: tuple[str, ...] = ()
    """Its keys, in the order of the kernel's inputs."""
    negative: bool = False
    """Whether the dict counts with the other sign."""
    batch: tuple[int, ...] = ()
    """The batch shape of all arrays: none, or ones."""
    char: str = "d"
    """NumPy's letter for the type of all arrays."""


# ── The parameters of a method, and the way of calling it that the arguments of one kind of call make


@dataclass(frozen=True)
class CallParameters:
    """Those of a method, without its first."""

    names: tuple[str, ...]
    positional: int
    defaults: dict[str, Any]

    @classmethod
    def of(cls, method: Any) -> CallParameters:
        """Those of a bound method."""
        function = method.__func__
        code, given = function.__code__, function.__defaults__ or ()
        places = code.co_varnames[1 : code.co_argcount]
        names = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
        defaults = dict(zip(places[len(places) - len(given) :], given, strict=True)) | (function.__kwdefaults__ or {})
        return cls(names, len(places), defaults)

    def doc(self, method: Any, name: str) -> str:
        """The method's own, behind a line from which ``inspect.signature`` reads its parameters."""
        shown = [f"{p}={self.defaults[p]!r}" if p in self.defaults else p for p in self.names]
        if self.positional < len(shown):
            shown.insert(self.positional, "*")
        return f"{name}({', '.join(shown)})\n--\n\n{method.__func__.__doc__ or ''}"


def way_of(program: Form | KernelMetadata, parameters: CallParameters, asked: CallForm) -> Way | None:
    """How the builtin is called; None where none can be."""
    ports = (*program.inputs, *program.outputs)
    count = len(program.inputs) - len(asked.keys)
    names, options = parameters.names, dict(asked.options)
    scalar = len(program.outputs) > 1 and not all(port.shape for port in program.outputs)
    strange = {*options, *([asked.mapping] if asked.mapping else [])} - {*names[count:]}
    several = any(n != 1 for n in asked.batch)
    if several or scalar or strange or count > len(names) or any(not port.size for port in ports):
        return None
    if any(name not in parameters.defaults for name in names[count:] if name not in options):
        return None
    rest = [k for k in range(count, len(names)) if names[k] not in ("out", asked.mapping)]
    defaults = parameters.defaults

    def is_default(name: str) -> bool:
        return (
            name not in options
            or options[name] is defaults.get(name)
            or (type(options[name]) is str and options[name] == defaults.get(name))
        )

    inputs, outputs = (
        tuple(TensorSpec(port.name, asked.batch + port.shape) for port in some)
        for some in (program.inputs, program.outputs)
    )
    return Way(
        inputs[:count],
        inputs[count:],
        outputs,
        SINGLE if asked.char == SINGLE.char else DOUBLE,
        len(names),
        parameters.positional,
        tuple((k, is_default(names[k])) for k in rest),
        names.index(asked.mapping) if asked.mapping else -1,
        asked.negative,
        names.index("out") if "out" in names else -1,
        len(asked.batch),
    )


# ── Machine code as a builtin function of Python: the description CPython wants of it, and the function made from that

FASTCALL, KEYWORDS = 0x0080, 0x0002
"""CPython's flags of functions that take a table of arguments, and its length; and a tuple of names."""


class MethodDefinition(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def builtin(definition: MethodDefinition, context: bytes, keeper: str) -> Any:
    """The function, whose ``self`` is the context; the module's name has to keep alive what both point to."""
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.py_object]
    return make(ctypes.addressof(definition), context, keeper)


def address_of(name: str) -> int:
    """Where a function of Python's C API is."""
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0


# ── A kernel as a builtin function for single samples: what a kilohertz loop calls. CPython only, with its lock

# NumPy's own way into a ufunc takes longer than most kernels run. The builtin made here does without it where the arguments
# are plain, and computes the one sample in one lane; the rest it hands to a slower callable, which also has the last word on
# errors. Other options, another type or a batch of one are calls of another kind: builtins for them stand in a row behind it.

_SCALAR, _NEW_FROM_DESCRIPTOR = 60, 94
"""Slots of PyArray_Scalar and PyArray_NewFromDescr in NumPy's array API table; fixed since NumPy 1.0."""

MOST_IN_A_ROW = 16
"""Builtins for one method, each for other options or arrays of another kind: one asks the next."""

LONG, EACH = 4000, 100
"""Programs of so many instructions take a second to compile, so they wait for as many calls as they have hundreds of them."""


class _Keeper(str):
    """What keeps alive all that a builtin points to: it holds this object as the name of its module, a text to others."""

    kept: dict[str, Any]


class kernel(bytes):  # what the builtin's repr calls it: "built-in method … of kernel object"
    """The addresses a builtin works with, and whose method it is; ``self`` of the builtin.

    Addresses mean nothing elsewhere. A builtin is pickled as the attribute of its name of its ``self``, and this one is
    pickled, and copied, as the owner of the method: what comes out is the owner's own method of that name.
    """

    owner: Any
    kept: dict[str, Any]
    """All that the builtin points to, by name."""

    def hand_on_to(self, other: Callable[..., Any]) -> None:
        """Ask another from now on where the builtin does not serve; it asks whom this one asked before."""
        self.kept["fallback"] = other
        self.kept["place"].value = id(other)

    def __reduce_ex__(self, protocol: Any) -> tuple[Callable[[Any], Any], tuple[Any]]:
        return _same, (self.owner,)


def _same(owner: Any) -> Any:
    return owner


def make_call(
    ufunc: Any, method: Callable[..., Any], name: str, asked: CallForm | None = None
) -> Callable[..., Any] | None:
    """A builtin that does what ``method``, a bound one, does by ``ufunc`` in the calls that are ``asked`` for.

    All else it hands on to the method. None where it cannot be made: no compiled kernel, a method with other parameters, an
    interpreter of another build.
    """
    owner = owner_of(ufunc)
    if owner is None or not abi_matches():
        return None
    asked, parameters = asked or CallForm(), CallParameters.of(method)
    way = way_of(owner.given, parameters, asked)
    if way is None:
        return None
    code = assembled(call_assembly(way), CALL, owner.machine)
    dtype, place = np.dtype(asked.char), ctypes.c_void_p(id(method))
    loop = owner.scalar_code(way.precision)
    wanted = {**parameters.defaults, **dict(asked.options)}
    addresses = {
        "array_type": id(np.ndarray),
        "list_type": id(list),
        "tuple_type": id(tuple),
        "dict_type": id(dict),
        "float_type": id(float),
        "double_type": id(np.float64),
        "none": id(None),
        "descriptor": id(dtype),
        "new_array": _numpys(_NEW_FROM_DESCRIPTOR),
        "new_scalar": _numpys(_SCALAR),
        "new_tuple": address_of("PyTuple_New"),
        "dict_size": address_of("PyDict_Size"),
        "dict_item": address_of("PyDict_GetItem"),
        "vectorcall": address_of("PyObject_Vectorcall"),
        "incref": address_of("Py_IncRef"),
        "decref": address_of("Py_DecRef"),
        "loop": loop.address,
        "fallback": ctypes.addressof(place),
    }
    options = [wanted[parameters.names[k]] for k, _ in way.options]
    objects = [*parameters.names, *options, *asked.keys]
    places = [*(addresses[n] for n in POINTERS), *map(id, objects)]
    context = kernel(b"".join(place.to_bytes(8, sys.byteorder) for place in places))
    definition = MethodDefinition(
        name.encode(), code.address, FASTCALL | KEYWORDS, parameters.doc(method, name).encode()
    )
    context.owner = method.__self__  # type: ignore[attr-defined]
    keeper = _Keeper("twistwrench.robot")
    keeper.kept = context.kept = {
        "ufunc": ufunc,
        "fallback": method,
        "place": place,
        "code": code,
        "loop": loop,
        "dtype": dtype,
        "objects": objects,
        "definition": definition,
    }
    return builtin(definition, context, keeper)


def is_made_here(function: Any) -> bool:
    """Whether it is a builtin of :func:`make_call`."""
    return type(getattr(function, "__self__", None)) is kernel


def attach_fallback(first: Any, other: Any) -> None:
    """Let a builtin ask another before it asks the method, unless there are enough in a row."""
    following, number = first.__self__.kept["fallback"], 1
    while is_made_here(following):
        following, number = following.__self__.kept["fallback"], number + 1
    if number < MOST_IN_A_ROW:
        other.__self__.hand_on_to(first.__self__.kept["fallback"])
        first.__self__.hand_on_to(other)


def calls_before(ufunc: Any) -> int:
    """How many calls with one state are a reason for a builtin: two, more where compiling takes long; never: 0."""
    owner = owner_of(ufunc)
    if owner is None or not abi_matches():
        return 0
    length = owner.length
    return 2 if length < LONG else length // EACH


@cache
def _numpys(slot: int) -> int:
    """The address of a function of NumPy's C API."""
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype, get_pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    table = ctypes.cast(get_pointer(_multiarray_umath._ARRAY_API, None), ctypes.POINTER(ctypes.c_void_p))
    return table[slot] or 0


@cache
def abi_matches() -> bool:
    """Whether objects lie in memory as the code expects: looked at, not guessed from versions."""
    if not runs_machine_code() or sys.byteorder != "little":
        return False
    if sysconfig.get_config_var("Py_GIL_DISABLED"):  # objects have longer heads, even while the lock is switched on
        return False
    probe, contents = np.arange(6.0).reshape(2, 3), kernel(b"twistwrench")

    def word(name: str, kind: Any = ctypes.c_ssize_t) -> int:
        return int(kind.from_address(id(probe) + FIELDS[name]).value)

    dims = (ctypes.c_ssize_t * 2).from_address(word("dims"))
    row, pair = [1.5, None], (None, 2.5)
    return (
        _items(row, _at(row, LIST_ITEMS)) == [*map(id, row)]
        and _items(pair, id(pair) + TUPLE_ITEMS) == [*map(id, pair)]
        and all(ctypes.c_double.from_address(id(x) + FLOAT_VALUE).value == 1.5 for x in (row[0], np.float64(1.5)))
        and word("type") == id(np.ndarray)
        and word("data") == probe.ctypes.data
        and word("nd", ctypes.c_int) == 2
        and list(dims) == [2, 3]
        and word("descr") == id(probe.dtype) == id(np.dtype(np.float64))
        and word("flags", ctypes.c_int) & 0x101 == 0x101
        and ctypes.string_at(id(contents) + BYTES_DATA, len(contents)) == contents
    )


def _at(thing: object, offset: int) -> int:
    return int(ctypes.c_ssize_t.from_address(id(thing) + offset).value)


def _items(thing: object, place: int) -> list[int]:
    """The addresses of the items that begin at a place, as many as the thing says it has."""
    return list((ctypes.c_ssize_t * _at(thing, SIZE)).from_address(place))
