"""Compiled programs as NumPy generalized ufuncs.

NumPy's C API makes the ufunc from the addresses of its loops for float32 and float64. The float64 loop is compiled at once. A
stub stands for the float32 loop: its first call compiles the loop and puts the address into the table. In a subinterpreter,
where C cannot call back, both loops are compiled at once. All memory that the ufunc points to belongs to an owner object,
which the ufunc keeps alive.
"""

from __future__ import annotations

import copyreg
import ctypes
import itertools
import threading
import weakref
from ast import literal_eval
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core import object_cache
from ...core.errors import KernelError
from ..ir.program import Program, TensorSpec, axes_of, signature_of
from ..lowering.target_machine import DOUBLE, SINGLE, Machine, Precision, chosen
from . import interpreter
from .jit import LOCK, Code, cached_code, compile_form

if TYPE_CHECKING:
    from ..ir.loops import Form

_LOOP = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
"""C type of a ufunc's loop: addresses of its arguments, dimensions, strides and data."""
_FROM_FUNC_AND_DATA_AND_SIGNATURE = 31
"""Slot of PyUFunc_FromFuncAndDataAndSignature in NumPy's ufunc API table; fixed since NumPy 1.0."""

_NO_IDENTITY = -1
"""PyUFunc_None: the ufunc cannot be reduced."""
_TYPE_COUNT = 2
"""Number of types of a ufunc made here: float32 and float64."""
_MAX_OPERANDS = 32
"""Maximum number of arrays of a ufunc, inputs and outputs together, in NumPy 1."""

LONGEST_SCALAR = 40_000
"""Maximum number of instructions of a program that is compiled again for single samples."""


class _UFuncObject(ctypes.Structure):
    """Head of NumPy's public PyUFuncObject, up to its reference to an owner."""

    _fields_ = (
        # Head of every Python object up to its type: reference counts. Longer in builds of Python without the global lock.
        ("counts", ctypes.c_byte * (object.__basicsize__ - ctypes.sizeof(ctypes.c_void_p))),
        ("type", ctypes.c_void_p),
        ("nin", ctypes.c_int),
        ("nout", ctypes.c_int),
        ("nargs", ctypes.c_int),
        ("identity", ctypes.c_int),
        ("functions", ctypes.c_void_p),
        ("data", ctypes.c_void_p),
        ("ntypes", ctypes.c_int),
        ("reserved", ctypes.c_int),
        ("name", ctypes.c_void_p),
        ("types", ctypes.c_void_p),
        ("doc", ctypes.c_void_p),
        ("pointer", ctypes.c_void_p),
        ("owner", ctypes.c_void_p),
    )


class KernelMetadata(NamedTuple):
    """Description of a kernel without its program."""

    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]
    length: int
    """Number of instructions of its program."""
    cost: int
    """Number of operations per sample."""
    code: tuple[str, ...]
    """Cache keys of its code for float64."""
    form: Callable[[], Form]
    """Function that returns the program."""
    key: str
    """Cache key of the kernel."""

    @property
    def signature(self) -> str:
        """Gufunc signature, equal to the program's."""
        return signature_of(self.inputs, self.outputs)


class _Returned:
    """Result of a callback. It is freed after the callback's Python code has ended, so that this cannot catch an exception."""


@cache
def _raise_in_thread() -> Any:
    """CPython function (thread, exception class) that raises an exception in a thread when it next runs Python code.

    The prototype has a third argument: called for a dead weak reference, the function receives the reference, and ignores it.
    """
    prototype = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_ulong, ctypes.py_object, ctypes.py_object)
    return prototype(("PyThreadState_SetAsyncExc", ctypes.pythonapi))


def _class_of(problem: BaseException) -> type[BaseException]:
    """Class that makes the exception ``problem`` when called: in another thread, Python raises exceptions by their class."""

    class ProblemClass(BaseException):
        def __new__(cls) -> Any:
            return problem

    return ProblemClass


class _Owner:
    """All memory and code behind one ufunc."""

    def __init__(self, program: Form | KernelMetadata, name: str, doc: str, *, scalar: bool) -> None:
        operand_count = len(program.inputs) + len(program.outputs)
        if operand_count > _MAX_OPERANDS:
            raise KernelError(
                f"kernel {name!r} has {operand_count} arrays; NumPy allows {_MAX_OPERANDS}. Add up what can be."
            )
        self.is_scalar = scalar
        self.machine = chosen()
        if scalar:
            self.machine = self.machine.narrowed(DOUBLE.bits)
        self.given = program
        """Program, or its metadata as long as the program is not needed."""
        self.description = doc
        self.key = ""
        """Key of the cached kernel; empty if it is not cached."""
        double_code = None
        if isinstance(program, KernelMetadata):
            self.key = program.key
            double_code = cached_code(program.code, self.machine)
            if double_code is None:
                self.given = program.form()
        if double_code is None:
            double_code = compile_form(self.form, DOUBLE, self.machine)
        self.code: dict[str, Code] = {"d": double_code}
        """Code for batches, by character of the type."""
        self.scalar: dict[str, Code] = {}
        """Code for single samples, by character of the type."""
        self.lazy_stub = _LOOP(self._first_float32_call)
        self.interrupt: Any = None
        """Weak reference whose callback raises an exception of the stub."""
        # float32 first: NumPy uses the first loop to which the arguments can be cast without loss.
        stub_address = ctypes.cast(self.lazy_stub, ctypes.c_void_p).value
        self.functions = (ctypes.c_void_p * _TYPE_COUNT)(stub_address, double_code.address)
        self.data = (ctypes.c_void_p * _TYPE_COUNT)()
        float32_number = np.dtype(np.float32).num
        float64_number = np.dtype(np.float64).num
        type_numbers = [float32_number] * operand_count + [float64_number] * operand_count
        self.types = (ctypes.c_byte * len(type_numbers))(*type_numbers)
        self.name = ctypes.create_string_buffer(name.encode())
        self.doc = ctypes.create_string_buffer(doc.encode())
        if not interpreter.is_main():  # no stub: C cannot call back
            self.address(SINGLE)

    @cached_property
    def form(self) -> Form:
        """Program with its loop, if it has one."""
        if isinstance(self.given, KernelMetadata):
            return self.given.form()
        return self.given

    @cached_property
    def program(self) -> Program:
        """Program without its loop."""
        from ..ir.loops import program_of

        return program_of(self.form)

    @cached_property
    def length(self) -> int:
        """Number of instructions of the program."""
        if isinstance(self.given, KernelMetadata):
            return self.given.length
        return len(self.program.instructions)

    @cached_property
    def cost(self) -> int:
        """Number of operations per sample, or per step if there are several."""
        from .batch_threads import cost_model

        if isinstance(self.given, KernelMetadata):
            return self.given.cost
        return cost_model(self.given)

    @cached_property
    def result_size(self) -> int:
        """Size of all results of one sample, as float64 [bytes]."""
        return DOUBLE.bytes * sum(port.size for port in self.given.outputs)

    def _first_float32_call(self, args: int, dims: int, steps: int, data: int) -> _Returned | None:
        """Stub of the float32 loop: compiles the loop, stores its address in the table, and runs it.

        An exception cannot leave a callback: Python would print it as ignored. An exception of the compiler or of a signal
        handler is therefore raised after NumPy has returned. The results of this call are NaN instead of uninitialised memory.
        The next call compiles again.
        """
        try:
            _LOOP(self.address(SINGLE))(args, dims, steps, data)
        except BaseException as problem:
            self._fill_nan(args, dims, steps)
            return self._raise_later(problem)
        return None

    def _raise_later(self, problem: BaseException) -> _Returned:
        """Result of a callback, whose release raises ``problem``; no frame of the problem's traceback may hold the result."""
        returned = _Returned()
        raise_here = partial(_raise_in_thread(), threading.get_ident(), _class_of(problem))
        self.interrupt = weakref.ref(returned, raise_here)
        return returned

    def _fill_nan(self, args: int, dims: int, steps: int) -> None:
        """Write NaN into every float32 result of a call of the loop, whose arguments are ``args``, ``dims`` and ``steps``.

        ``args`` are addresses of the operands, ``dims`` the size of the batch and the core sizes. ``steps`` are the strides
        of the batch, one for each operand, and then those of the core axes, operand by operand.
        """
        axes_by_operand = axes_of(self.given.signature)
        operand_count = len(axes_by_operand)
        all_axes = list(itertools.chain(*axes_by_operand))
        sizes_type = ctypes.c_ssize_t * (1 + max(all_axes, default=0))
        strides_type = ctypes.c_ssize_t * (operand_count + len(all_axes))
        sizes = list(sizes_type.from_address(dims))
        strides = list(strides_type.from_address(steps))
        batch_strides, core_strides = strides[:operand_count], strides[operand_count:]
        for k, axes in enumerate(axes_by_operand):
            own_strides = [batch_strides[k], *core_strides[: len(axes)]]
            core_strides = core_strides[len(axes) :]  # of the operands after this one
            if k >= len(self.given.inputs):  # an output
                pointer_address = args + k * ctypes.sizeof(ctypes.c_void_p)
                start = ctypes.c_void_p.from_address(pointer_address).value or 0  # None is a null pointer
                shape = [sizes[0], *(sizes[axis] for axis in axes)]
                for index in np.ndindex(*shape):
                    offset = int(np.dot(index, own_strides))
                    ctypes.c_float.from_address(start + offset).value = float("nan")

    def address(self, precision: Precision) -> int:
        """Address of the loop for batches; the loop is compiled at the first call."""
        with LOCK:
            code = self.code.get(precision.char)
            if code is None:
                code = self._code_of(precision, self.machine)
                self.code[precision.char] = code
                self.functions[0] = code.address  # in place of the stub: the float64 loop was compiled at once
        return code.address

    def scalar_code(self, precision: Precision) -> Code:
        """Code for single samples in one lane; for very long programs, the code for batches."""
        with LOCK:
            if self.length > LONGEST_SCALAR or self.machine.lanes(precision) == 1:
                self.address(precision)
                return self.code[precision.char]
            if precision.char not in self.scalar:
                one_lane = self.machine.narrowed(precision.bits)
                self.scalar[precision.char] = self._code_of(precision, one_lane)
            return self.scalar[precision.char]

    def _code_of(self, precision: Precision, machine: Machine) -> Code:
        """Code for another type or vector width than at first; from the cache if the kernel is cached."""
        if not self.key:
            return compile_form(self.form, precision, machine)
        key = object_cache.digest("code", self.key, precision.char, str(machine)).hex()
        entry = object_cache.load(key)
        if entry is not None:
            code_keys = entry.decode("ascii", "replace").split()
            cached = cached_code(code_keys, machine)
            if cached is not None:
                return cached
        code = compile_form(self.form, precision, machine)
        if code.keys:
            object_cache.store(key, " ".join(code.keys).encode())
        return code


def make_ufunc(program: Form | KernelMetadata, name: str, doc: str, scalar: bool = False) -> np.ufunc:
    """Compile ``program`` as a ufunc; its signature has the program's sizes, so NumPy rejects others.

    The signature of a scan has two sizes chosen by the caller. NumPy cannot derive the number of rows from the inputs, so
    such a ufunc must be called with ``out=``. A ``scalar`` ufunc is for one sample at a time, in one lane.
    """
    owner = _Owner(program, name, doc, scalar=scalar)
    pointers = [ctypes.c_void_p] * 3  # functions, data, types
    integers = [ctypes.c_int] * 4  # numbers of types, inputs and outputs; identity
    texts = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p]  # name, doc, unused, signature
    constructor_type = ctypes.PYFUNCTYPE(ctypes.py_object, *pointers, *integers, *texts)
    constructor = constructor_type(numpy_function("_UFUNC_API", _FROM_FUNC_AND_DATA_AND_SIGNATURE))
    unused = 0
    ufunc: np.ufunc = constructor(
        ctypes.addressof(owner.functions), ctypes.addressof(owner.data), ctypes.addressof(owner.types),
        _TYPE_COUNT, len(program.inputs), len(program.outputs), _NO_IDENTITY,
        ctypes.addressof(owner.name), ctypes.addressof(owner.doc), unused, program.signature.encode(),
    )  # fmt: skip
    head = _UFuncObject.from_address(id(ufunc))
    has_known_layout = _abi_matches() and head.functions == ctypes.addressof(owner.functions) and head.owner is None
    if not has_known_layout:
        _FOREVER.append(owner)  # unknown layout: the code is kept forever, since freeing it too early would crash
    else:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(owner))
        head.owner = id(owner)
    return ufunc


_FOREVER: list[_Owner] = []
"""Owners that no ufunc keeps alive."""


def owner_of(kernel: Any) -> _Owner | None:
    """Owner of a ufunc made here; None for all other objects."""
    if not isinstance(kernel, np.ufunc) or not _abi_matches():
        return None
    try:
        owner = ctypes.py_object.from_address(id(kernel) + _UFuncObject.owner.offset).value
    except ValueError:  # a null pointer
        return None
    if not isinstance(owner, _Owner):
        return None
    return owner


def load_ufunc(key: str, form: Callable[[], Form]) -> np.ufunc | None:
    """Cached kernel for a key; None if the cache has none. ``form`` returns its program when needed."""
    entry = object_cache.load(key)
    if entry is None:
        return None
    try:
        name, doc, input_rows, output_rows, length, cost, code_keys = literal_eval(entry.decode())
        inputs, outputs = _specs_from_rows(input_rows), _specs_from_rows(output_rows)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):  # the kernel is made again
        return None
    return make_ufunc(KernelMetadata(inputs, outputs, length, cost, code_keys, form, key), name, doc)


def _specs_from_rows(rows: Sequence[tuple[str, tuple[int, ...]]]) -> tuple[TensorSpec, ...]:
    """Inputs or outputs from their names and shapes."""
    return tuple(TensorSpec(*row) for row in rows)


def store_ufunc(key: str, kernel: Any) -> None:
    """Cache the metadata of a kernel, if it is compiled and its code is cached."""
    owner = owner_of(kernel)
    if owner is None:
        return
    owner.key = key
    code = owner.code["d"]
    if code.keys:
        inputs = tuple(map(tuple, owner.given.inputs))
        outputs = tuple(map(tuple, owner.given.outputs))
        entry = (kernel.__name__, owner.description, inputs, outputs, owner.length, owner.cost, code.keys)
        object_cache.store(key, repr(entry).encode())


class _Recipe:
    """Kernel in the form that ``pickle`` and ``copy`` store: pickled as its program, and copied as itself."""

    def __init__(self, kernel: Any) -> None:
        self.kernel = kernel

    def __deepcopy__(self, memo: Any) -> _Recipe:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        owner = owner_of(self.kernel)
        assert owner is not None
        return make_ufunc, (owner.form, self.kernel.__name__, owner.description, owner.is_scalar)


def _kernel_of(recipe: Any) -> Any:
    """Kernel of a recipe; after unpickling, the argument is the new kernel itself."""
    if isinstance(recipe, _Recipe):
        return recipe.kernel
    return recipe


def _reduce(ufunc: np.ufunc) -> Any:
    """Reduction of a ufunc for ``pickle`` and ``copy``; NumPy's own for ufuncs not made here."""
    if owner_of(ufunc):
        return _kernel_of, (_Recipe(ufunc),)
    return _reduce_by_numpy(ufunc)


_reduce_by_numpy: Any = copyreg.dispatch_table[np.ufunc]
copyreg.pickle(np.ufunc, _reduce)


@cache
def _abi_matches() -> bool:
    """True if ufuncs lie in memory as :class:`_UFuncObject` describes, judged by NumPy's addition."""
    head = _UFuncObject.from_address(id(np.add))
    counts = (head.nin, head.nout, head.nargs, head.ntypes)
    counts_of_addition = (2, 1, 3, np.add.ntypes)
    return head.type == id(np.ufunc) and counts == counts_of_addition and head.owner is None


@cache
def numpy_function(table: str, slot: int) -> int:
    """Address of a function of NumPy's C API, by the name of its table and its slot there."""
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype = ctypes.c_void_p
    get_pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    table_address = get_pointer(getattr(_multiarray_umath, table), None)
    functions = ctypes.cast(table_address, ctypes.POINTER(ctypes.c_void_p))
    return functions[slot] or 0  # None is a null pointer
