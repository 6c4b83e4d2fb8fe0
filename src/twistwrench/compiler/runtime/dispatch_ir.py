"""LLVM assembly of a builtin function of CPython that runs a kernel's loop on one sample.

The function is of the type METH_FASTCALL. It handles C-contiguous, aligned arrays of one type, lists and tuples of floats,
options that are identical to the expected objects, and ``out=``. It passes all other calls, and those with non-finite results,
to the fallback with unchanged arguments. The text contains shapes but no addresses, so its code can be cached. ``self`` is a
bytes object with the addresses of :data:`POINTERS`, then of parameter names, then of options.
"""

from __future__ import annotations

import ctypes
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..ir.program import TensorSpec
from ..lowering.ir_builder import LlvmWriter, typed_list
from ..lowering.target_machine import DOUBLE, Precision
from .interpreter import runs_machine_code

CALL = "call"
"""Name of the function."""

POINTERS = (
    "array_type", "list_type", "tuple_type", "float_type", "double_type", "none", "descriptor", "new_array", "new_scalar",
    "new_tuple", "vectorcall", "incref", "decref", "loop", "fallback",
)  # fmt: skip
"""Addresses at the beginning of the bytes object, 8 bytes each. For the fallback it is the address of a pointer to it."""

FIELDS = {"type": 8, "data": 16, "nd": 24, "dims": 32, "descr": 56, "flags": 64}
"""Offsets in NumPy's array object, published in its C API, for 64-bit CPython with the GIL."""

BYTES_DATA = 32
"""Offset [bytes] of the contents of a bytes object."""
SIZE = 16
"""Offset of the number of items of a list or tuple."""
LIST_ITEMS = 24
"""Offset of the pointer to the items of a list."""
TUPLE_ITEMS = tuple.__basicsize__
"""Offset of the first item of a tuple."""
FLOAT_VALUE = 16
"""Offset of the value of a float."""

CONTIGUOUS_AND_ALIGNED = 0x1 | 0x100
"""Two of NumPy's array flags."""
WRITABLE_FLAG = 0x400
SIDE_EFFECT_FLAGS = 0x2000 | 1 << 31
"""Flags of arrays to which writing has side effects: it is written back to another array, or causes a warning."""

_POINTER_BYTES = 8

_MAX_UNROLLED = 16
"""Maximum number of vectors tested for finite numbers one by one; more are tested in a loop."""


@cache
def abi_matches() -> bool:
    """True if objects have the memory layout that the code expects. Objects are inspected; versions are not compared."""
    if not runs_machine_code() or sys.byteorder != "little":
        return False
    if sysconfig.get_config_var("Py_GIL_DISABLED"):  # objects have longer headers, even with the GIL enabled
        return False
    array = np.arange(6.0).reshape(2, 3)
    contents = type("_Bytes", (bytes,), {})(b"twistwrench")
    sample_list = [1.5, None]
    sample_tuple = (None, 2.5)

    def integer_at(address: int, kind: Any = ctypes.c_ssize_t) -> int:
        return int(kind.from_address(address).value)

    def item_addresses(sequence: object, first: int) -> list[int]:
        size = integer_at(id(sequence) + SIZE)
        return list((ctypes.c_ssize_t * size).from_address(first))

    field_addresses = {name: id(array) + offset for name, offset in FIELDS.items()}
    floats = (sample_list[0], np.float64(1.5))
    return (
        item_addresses(sample_list, integer_at(id(sample_list) + LIST_ITEMS)) == list(map(id, sample_list))
        and item_addresses(sample_tuple, id(sample_tuple) + TUPLE_ITEMS) == list(map(id, sample_tuple))
        and all(ctypes.c_double.from_address(id(number) + FLOAT_VALUE).value == 1.5 for number in floats)
        and integer_at(field_addresses["type"]) == id(np.ndarray)
        and integer_at(field_addresses["data"]) == array.ctypes.data
        and integer_at(field_addresses["nd"], ctypes.c_int) == 2
        and list((ctypes.c_ssize_t * 2).from_address(integer_at(field_addresses["dims"]))) == [2, 3]
        and integer_at(field_addresses["descr"]) == id(array.dtype) == id(np.dtype(np.float64))
        and integer_at(field_addresses["flags"], ctypes.c_int) & CONTIGUOUS_AND_ALIGNED == CONTIGUOUS_AND_ALIGNED
        and ctypes.string_at(id(contents) + BYTES_DATA, len(contents)) == contents
    )


@dataclass(frozen=True)
class CallLayout:
    """Shapes, types and parameters of the calls that one builtin handles."""

    inputs: tuple[TensorSpec, ...]
    """Specifications of the first parameters."""
    outputs: tuple[TensorSpec, ...]
    precision: Precision
    parameters: int
    """Number of parameters of the method."""
    positional: int
    """Number of parameters that may be passed by position."""
    options: tuple[tuple[int, bool], ...]
    """Number of each parameter that must be a certain object, and True if this object is its default."""
    out: int
    """Number of the parameter for the results; -1 if there is none."""
    batch: int
    """Number of leading axes of every array that the loop does not have; all are of length 1."""


def loop_steps(specs: Sequence[TensorSpec], precision: Precision, batch: int = 0) -> list[int]:
    """``steps`` [bytes] of a ufunc's loop for contiguous arrays, without their first ``batch`` axes.

    The steps from sample to sample of all arrays come first, then the strides of their axes.
    """
    sample_steps = [spec.size * precision.bytes for spec in specs]
    all_strides: list[int] = []
    for spec in specs:
        stride = precision.bytes
        strides = []
        for length in reversed(spec.shape[batch:]):
            strides.append(stride)
            stride *= length
        all_strides += reversed(strides)
    return sample_steps + all_strides


def call_assembly(layout: CallLayout) -> str:
    """Text of the module of one builtin."""
    call = _Call(layout)
    call.write()
    steps = loop_steps(call.specs, layout.precision, layout.batch)
    constants: dict[str, Sequence[int]] = {"one": [1], "steps": steps}
    constants |= {f"shape{k}": spec.shape for k, spec in enumerate(layout.outputs)}
    return "\n".join(
        [
            _sort_function(),
            _numbers_function() if layout.precision is DOUBLE else "",
            *(
                f"@{name} = internal constant [{len(values)} x i64] [{typed_list('i64', values)}]"
                for name, values in constants.items()
            ),
            f"define ptr @{CALL}(ptr %self, ptr %args, i64 %count, ptr %names) {{\nentry:",
            *call.w.lines,
            "}\n",
        ]
    )


def _sort_function() -> str:
    """Text of ``sort``, a function that stores arguments in parameter order; false for an unknown or repeated name."""
    w = LlvmWriter(DOUBLE, 1)
    with w.loop("%count", "entry") as k:
        _store(w, "%slots", k, _load(w, "%args", k))
    with_names, without_names = w.label("named"), w.label("plain")
    w.do(f"br i1 {w.new('icmp eq ptr %names, null')}, label %{without_names}, label %{with_names}")
    w.begin(without_names)
    w.do("ret i1 true")
    w.begin(with_names)
    name_count = w.new(f"load i64, ptr {w.gep('%names', SIZE)}, align 8")
    items = w.gep("%names", TUPLE_ITEMS)
    with w.loop(name_count, with_names) as j:
        name = _load(w, items, j)
        argument = _load(w, "%args", w.new(f"add i64 %count, {j}"))
        placed = w.label("placed")
        with w.loop("%parameters", w.after) as k:
            found, other = w.label("found"), w.label("other")
            same = w.new(f"icmp eq ptr {_load(w, '%known', k)}, {name}")
            w.do(f"br i1 {same}, label %{found}, label %{other}")
            w.begin(found)
            _else_false(w, w.new(f"icmp eq ptr {_load(w, '%slots', k)}, null"))
            _store(w, "%slots", k, argument)
            w.do(f"br label %{placed}")
            w.begin(other)
        w.do("br label %no")
        w.begin(placed)
        w.after = placed
    w.do("ret i1 true")
    return _boolean_function("sort", "ptr %slots, i64 %parameters, ptr %known, ptr %args, i64 %count, ptr %names", w)


def _numbers_function() -> str:
    """Text of ``numbers``, a function that copies the floats of a list or tuple; false for any other object."""
    w = LlvmWriter(DOUBLE, 1)
    kind = w.new(f"load ptr, ptr {w.gep('%object', FIELDS['type'])}, align 8")
    is_list, is_tuple = w.new(f"icmp eq ptr {kind}, %list"), w.new(f"icmp eq ptr {kind}, %tuple")
    _else_false(w, w.new(f"or i1 {is_list}, {is_tuple}"))
    length = w.new(f"load i64, ptr {w.gep('%object', SIZE)}, align 8")
    label = _else_false(w, w.new(f"icmp eq i64 {length}, %length"))
    list_items = w.new(f"load ptr, ptr {w.gep('%object', LIST_ITEMS)}, align 8")  # unused for tuples
    items = w.new(f"select i1 {is_list}, ptr {list_items}, ptr {w.gep('%object', TUPLE_ITEMS)}")
    with w.loop("%length", label) as k:
        item = _load(w, items, k)
        item_type = w.new(f"load ptr, ptr {w.gep(item, FIELDS['type'])}, align 8")
        is_float, is_double = w.new(f"icmp eq ptr {item_type}, %float"), w.new(f"icmp eq ptr {item_type}, %double")
        _else_false(w, w.new(f"or i1 {is_float}, {is_double}"))
        _store(w, "%into", k, w.new(f"load double, ptr {w.gep(item, FLOAT_VALUE)}, align 8"), "double")
    w.do("ret i1 true")
    return _boolean_function(
        "numbers", "ptr %object, i64 %length, ptr %into, ptr %list, ptr %tuple, ptr %float, ptr %double", w
    )


def _load(w: LlvmWriter, table: str, number: str) -> str:
    """Load a pointer from a table, by a number known at run time only."""
    return w.new(f"load ptr, ptr {_entry_address(w, table, number)}, align 8")


def _store(w: LlvmWriter, table: str, number: str, value: str, kind: str = "ptr") -> None:
    """Store a value of eight bytes in a table, by a number known at run time only."""
    w.do(f"store {kind} {value}, ptr {_entry_address(w, table, number)}, align 8")


def _entry_address(w: LlvmWriter, table: str, number: str) -> str:
    return w.gep(table, w.new(f"mul i64 {number}, {_POINTER_BYTES}"))


def _else_false(w: LlvmWriter, condition: str) -> str:
    """Continue if the condition holds, else return false; returns the current label."""
    further = w.label("ok")
    w.do(f"br i1 {condition}, label %{further}, label %no")
    w.begin(further)
    return further


def _boolean_function(name: str, arguments: str, w: LlvmWriter) -> str:
    """Text of a function with a given body, which returns false from the label ``no``."""
    body = "\n".join(w.lines)
    return f"define internal i1 @{name}({arguments}) noinline {{\nentry:\n{body}\nno:\n  ret i1 false\n}}\n"


def has_nonfinite(w: LlvmWriter, data: str, size: int, label: str) -> tuple[str, str]:
    """Emit the condition (i1) that some of ``size`` numbers is not finite; takes and returns the current label.

    A finite number times zero is zero, and so is the sum of such products. An infinity or NaN makes the sum NaN.
    """
    width = 512 // w.precision.bits  # numbers of one vector
    while width > size:
        width //= 2
    kind = f"<{width} x {w.element}>"
    zero = f"splat ({w.element} {w.number(0.0)})"

    def times_zero(offset: int | str) -> str:
        vector = w.new(f"load {kind}, ptr {w.gep(data, offset)}, align {w.precision.bytes}")
        return w.new(f"fmul {kind} {vector}, {zero}")

    def plus(a: str, b: str) -> str:
        return w.new(f"fadd {kind} {a}, {b}")

    step = width * w.precision.bytes
    sums = [times_zero((size - width) * w.precision.bytes)]  # the last numbers, which may overlap the whole vectors
    whole = size // width
    if whole <= _MAX_UNROLLED:
        sums += [times_zero(k * step) for k in range(whole)]
    else:
        head, body, end, following = w.labels("head", "body", "end", "next")
        new_total, counter, total = w.name(), w.name(), w.name()
        w.do(f"br label %{head}")
        w.begin(head)
        w.do(f"{counter} = phi i64 [0, %{label}], [%{following}, %{body}]")
        w.do(f"{total} = phi {kind} [{sums[0]}, %{label}], [{new_total}, %{body}]")
        w.do(f"br i1 {w.new(f'icmp slt i64 {counter}, {whole // 2}')}, label %{body}, label %{end}")
        w.begin(body)
        offset = w.new(f"mul i64 {counter}, {2 * step}")
        pair = plus(times_zero(offset), times_zero(w.new(f"add i64 {offset}, {step}")))
        w.do(f"{new_total} = fadd {kind} {total}, {pair}")
        w.do(f"%{following} = add i64 {counter}, 1")
        w.do(f"br label %{head}")
        w.begin(end)
        label = end
        sums = [total]
        if whole % 2:
            sums.append(times_zero((whole - 1) * step))
    while len(sums) > 1:  # in pairs, so that few sums depend on each other
        pairs = zip(sums[::2], sums[1::2], strict=False)
        without_partner = sums[len(sums) // 2 * 2 :]
        sums = [plus(a, b) for a, b in pairs] + without_partner
    unordered = w.new(f"fcmp uno {kind} {sums[0]}, {zero}")
    bits = w.new(f"bitcast <{width} x i1> {unordered} to i{width}")
    return w.new(f"icmp ne i{width} {bits}, 0"), label


class BuiltinWriter:
    """Writer of a builtin function: addresses from its ``self``, tables, checks of arrays, the branch to the fallback."""

    def __init__(self, precision: Precision, pointers: Sequence[str]) -> None:
        self.w = LlvmWriter(precision, 1)
        self.pointers = pointers
        self.label = "entry"
        """Label of the current basic block."""
        self.context = self.w.gep("%self", BYTES_DATA)

    def known(self, key: str | int) -> str:
        """Load an address from the bytes object ``self``, by its name, or by its number after the named ones."""
        if isinstance(key, str):
            return self.entry(self.context, self.pointers.index(key))
        return self.entry(self.context, len(self.pointers) + key)

    def entry(self, table: str, number: int, kind: str = "ptr") -> str:
        """Load an entry of a table."""
        return self.w.new(f"load {kind}, ptr {self.w.gep(table, _POINTER_BYTES * number)}, align 8")

    def put(self, table: str, number: int, value: str) -> None:
        """Store a pointer in a table."""
        self.w.do(f"store ptr {value}, ptr {self.w.gep(table, _POINTER_BYTES * number)}, align 8")

    def begin(self, label: str) -> None:
        """Start a basic block."""
        self.w.begin(label)
        self.label = label

    def fork(self, condition: str, yes: str, no: str) -> None:
        """Branch on a condition."""
        self.w.do(f"br i1 {self.w.new(condition)}, label %{yes}, label %{no}")

    def check(self, condition: str) -> None:
        """Continue if the condition holds, else branch to the fallback."""
        further = self.w.label("ok")
        self.fork(condition, further, "slow")
        self.begin(further)

    def field(self, array: str, name: str, kind: str) -> str:
        """Load a field of an array."""
        return self.w.new(f"load {kind}, ptr {self.w.gep(array, FIELDS[name])}, align 4")

    def array(
        self, array: str, spec: TensorSpec, flags: tuple[int, int] = (CONTIGUOUS_AND_ALIGNED, CONTIGUOUS_AND_ALIGNED)
    ) -> str:
        """Pointer to the data of an array, after checks of type, shape and flags.

        ``flags`` are a mask, and the expected flags within it. Dimensions are read only if their number is right.
        """
        w = self.w
        mask, wanted_flags = flags
        self.check(f"icmp eq ptr {self.field(array, 'type', 'ptr')}, {self.known('array_type')}")
        self.check(f"icmp eq ptr {self.field(array, 'descr', 'ptr')}, {self.known('descriptor')}")
        self.check(f"icmp eq i32 {self.field(array, 'nd', 'i32')}, {len(spec.shape)}")
        array_flags = self.field(array, "flags", "i32")
        self.check(f"icmp eq i32 {w.new(f'and i32 {array_flags}, {mask}')}, {wanted_flags}")
        dims = self.field(array, "dims", "ptr")
        for axis, size in enumerate(spec.shape):
            self.check(f"icmp eq i64 {self.entry(dims, axis, 'i64')}, {size}")
        return self.field(array, "data", "ptr")


class _Call(BuiltinWriter):
    """Writer of the function: arguments, results, loop, and return value."""

    def __init__(self, layout: CallLayout) -> None:
        super().__init__(layout.precision, POINTERS)
        w = self.w
        self.layout = layout
        self.specs = (*layout.inputs, *layout.outputs)
        self.data = w.new(f"alloca [{len(self.specs)} x ptr], align 8")
        """Table of pointers to the numbers of all arrays."""
        self.results = w.new(f"alloca [{len(layout.outputs)} x ptr], align 8")
        """Table of the new arrays."""
        self.slots = w.new(f"alloca [{layout.parameters} x ptr], align 8")
        """Table of the arguments in parameter order."""
        self.buffers = [w.new(f"alloca [{spec.size} x {w.element}], align 64") for spec in self.specs]

    def write(self) -> None:
        """Write the whole function."""
        w, layout = self.w, self.layout
        arguments, out = self.arguments()
        for k, spec in enumerate(layout.inputs):
            self.store_input(k, self.entry(arguments, k), spec)
        fresh, lent, run, hand, kept = w.labels("fresh", "lent", "run", "hand", "kept")
        from_lent = ""  # entry of the phi below, for results in the caller's arrays
        if layout.out >= 0:
            is_none = w.new(f"icmp eq ptr {out}, {self.known('none')}")
            self.fork(f"or i1 {is_none}, {w.new(f'icmp eq ptr {out}, null')}", fresh, lent)
            self.begin(lent)
            self.use_arrays_of(out)
            from_lent = f", [false, %{self.label}]"
            w.do(f"br label %{run}")
        else:
            w.do(f"br label %{fresh}")
        self.begin(fresh)
        self.allocate()
        label_after_allocation = self.label
        w.do(f"br label %{run}")
        self.begin(run)
        is_allocated = w.new(f"phi i1 [true, %{label_after_allocation}]{from_lent}")
        w.do(f"call void {self.known('loop')}(ptr {self.data}, ptr @one, ptr @steps, ptr null)")
        any_nonfinite = self.any_nonfinite()
        wrong, fine, drop = w.labels("wrong", "fine", "drop")
        w.do(f"br i1 {any_nonfinite}, label %{wrong}, label %{fine}")
        self.begin(wrong)  # for non-finite results, the fallback repeats the call, with NumPy's warnings
        w.do(f"br i1 {is_allocated}, label %{drop}, label %slow")
        self.begin(drop)
        self.drop(len(layout.outputs))
        w.do("br label %slow")
        self.begin(fine)
        w.do(f"br i1 {is_allocated}, label %{hand}, label %{kept}")
        self.begin(kept)
        w.do(f"call void {self.known('incref')}(ptr {out})")
        w.do(f"ret ptr {out}")
        self.begin(hand)
        self.hand_over()
        self.begin("slow")
        vectorcall = self.known("vectorcall")
        call_arguments = f"ptr {self.entry(self.known('fallback'), 0)}, ptr %args, i64 %count, ptr %names"
        w.do(f"ret ptr {w.new(f'call ptr {vectorcall}({call_arguments})')}")

    def any_nonfinite(self) -> str:
        """Condition (i1) that some number of the results is not finite."""
        condition = "false"
        for k, spec in enumerate(self.layout.outputs, start=len(self.layout.inputs)):
            is_nonfinite, self.label = has_nonfinite(self.w, self.entry(self.data, k), spec.size, self.label)
            condition = self.w.new(f"or i1 {condition}, {is_nonfinite}")
        return condition

    def arguments(self) -> tuple[str, str]:
        """Pointers to the arguments in parameter order, and to ``out``.

        If all inputs and nothing else are passed by position (``quick``), the arguments are in order already.
        """
        w, layout = self.w, self.layout
        quick, sort, ready = w.labels("quick", "sort", "ready")
        all_default = all(is_default for _, is_default in layout.options)
        quick_count = len(layout.inputs) if all_default else -1  # no call has -1 arguments
        no_names = w.new("icmp eq ptr %names, null")
        has_quick_count = w.new(f"icmp eq i64 %count, {quick_count}")
        self.fork(f"and i1 {no_names}, {has_quick_count}", quick, sort)
        self.begin(quick)
        w.do(f"br label %{ready}")
        self.begin(sort)
        for k in range(layout.parameters):
            self.put(self.slots, k, "null")
        names = w.gep(self.context, _POINTER_BYTES * len(POINTERS))
        self.check(f"icmp sle i64 %count, {layout.positional}")
        sort_arguments = f"ptr {self.slots}, i64 {layout.parameters}, ptr {names}, ptr %args, i64 %count, ptr %names"
        self.check(f"icmp eq i1 {w.new(f'call i1 @sort({sort_arguments})')}, true")
        for number, (parameter, is_default) in enumerate(layout.options, start=layout.parameters):
            option = self.entry(self.slots, parameter)
            same = w.new(f"icmp eq ptr {option}, {self.known(number)}")
            missing = w.new(f"icmp eq ptr {option}, null")
            self.check(f"or i1 {same}, {missing if is_default else 'false'}")
        out = "null"
        if layout.out >= 0:
            out = self.entry(self.slots, layout.out)
        label_after_sort = self.label
        w.do(f"br label %{ready}")
        self.begin(ready)
        arguments = w.new(f"phi ptr [%args, %{quick}], [{self.slots}, %{label_after_sort}]")
        return arguments, w.new(f"phi ptr [null, %{quick}], [{out}, %{label_after_sort}]")

    def store_input(self, k: int, argument: str, spec: TensorSpec) -> None:
        """Store a pointer to the numbers of an argument: those of an array, or a buffer with those of a list."""
        w = self.w
        self.check(f"icmp ne ptr {argument}, null")
        if self.layout.precision is not DOUBLE or len(spec.shape) != 1:
            self.put(self.data, k, self.array(argument, spec))
            return
        array, listed, done = w.labels("array", "list", "given")
        self.fork(f"icmp eq ptr {self.field(argument, 'type', 'ptr')}, {self.known('array_type')}", array, listed)
        self.begin(listed)
        type_names = ("list_type", "tuple_type", "float_type", "double_type")
        types = typed_list("ptr", [self.known(name) for name in type_names])
        is_number_list = w.new(f"call i1 @numbers(ptr {argument}, i64 {spec.size}, ptr {self.buffers[k]}, {types})")
        self.check(f"icmp eq i1 {is_number_list}, true")
        self.put(self.data, k, self.buffers[k])
        w.do(f"br label %{done}")
        self.begin(array)
        self.put(self.data, k, self.array(argument, spec))
        w.do(f"br label %{done}")
        self.begin(done)

    def use_arrays_of(self, out: str) -> None:
        """Use the caller's arrays, if they are writable and do not overlap each other or the inputs."""
        w, outputs = self.w, self.layout.outputs
        input_count = len(self.layout.inputs)
        objects = [out]
        if len(outputs) > 1:
            self.check(f"icmp eq ptr {self.field(out, 'type', 'ptr')}, {self.known('tuple_type')}")
            self.check(f"icmp eq i64 {self.entry(w.gep(out, SIZE), 0, 'i64')}, {len(outputs)}")
            objects = [self.entry(w.gep(out, TUPLE_ITEMS), k) for k in range(len(outputs))]
        expected_flags = CONTIGUOUS_AND_ALIGNED | WRITABLE_FLAG
        for k, (item, spec) in enumerate(zip(objects, outputs, strict=True), start=input_count):
            data = self.array(item, spec, (expected_flags | SIDE_EFFECT_FLAGS, expected_flags))
            for j in range(k):
                other = self.entry(self.data, j)
                is_before = self.ends_before(data, spec, other)
                is_after = self.ends_before(other, self.specs[j], data)
                self.check(f"or i1 {is_before}, {is_after}")
            self.put(self.data, k, data)

    def ends_before(self, data: str, spec: TensorSpec, other: str) -> str:
        """Condition (i1) that the numbers at ``data`` end before those at ``other`` begin."""
        end = self.w.gep(data, spec.size * self.layout.precision.bytes)
        return self.w.new(f"icmp ule ptr {end}, {other}")

    def allocate(self) -> None:
        """Allocate new arrays; a scalar is computed in a buffer."""
        w = self.w
        for k, spec in enumerate(self.layout.outputs):
            number = len(self.layout.inputs) + k
            if not spec.shape:
                self.put(self.data, number, self.buffers[number])
                continue
            descriptor = self.known("descriptor")
            w.do(f"call void {self.known('incref')}(ptr {descriptor})")  # the new array steals a reference
            call_arguments = f"ptr {self.known('array_type')}, ptr {descriptor}, i32 {len(spec.shape)}, ptr @shape{k}"
            array = w.new(f"call ptr {self.known('new_array')}({call_arguments}, ptr null, ptr null, i32 0, ptr null)")
            self.require_object(array, k)
            self.put(self.results, k, array)
            self.put(self.data, number, self.field(array, "data", "ptr"))

    def require_object(self, item: str, earlier_count: int) -> None:
        """Continue if CPython made an object; otherwise release the earlier arrays and return NULL, with its error set."""
        made, failed = self.w.label("made"), self.w.label("failed")
        self.fork(f"icmp eq ptr {item}, null", failed, made)
        self.begin(failed)
        self.drop(earlier_count)
        self.w.do("ret ptr null")
        self.begin(made)

    def drop(self, count: int) -> None:
        """Release the first ``count`` new arrays."""
        for k in range(count):
            if self.layout.outputs[k].shape:
                self.w.do(f"call void {self.known('decref')}(ptr {self.entry(self.results, k)})")

    def hand_over(self) -> None:
        """Return the new array, a scalar or a tuple."""
        w, outputs = self.w, self.layout.outputs
        first, *others = outputs
        if others:
            results = w.new(f"call ptr {self.known('new_tuple')}(i64 {len(outputs)})")
            self.require_object(results, len(outputs))
            for k in range(len(outputs)):
                self.put(w.gep(results, TUPLE_ITEMS), k, self.entry(self.results, k))
            w.do(f"ret ptr {results}")
        elif first.shape:
            w.do(f"ret ptr {self.entry(self.results, 0)}")
        else:
            call_arguments = f"ptr {self.buffers[len(self.layout.inputs)]}, ptr {self.known('descriptor')}, ptr null"
            new_scalar = self.known("new_scalar")
            w.do(f"ret ptr {w.new(f'call ptr {new_scalar}({call_arguments})')}")
