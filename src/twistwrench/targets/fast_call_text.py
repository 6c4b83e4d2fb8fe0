"""The shortest way from Python into a loop: a C function of the METH_FASTCALL kind, as LLVM assembly.

It takes exact float64 arrays of one sample, C-contiguous and aligned, allocates the result, and runs the loop on one row.
Whatever is not that (other types, shapes, keywords, results that are not finite) goes to a slower callable with the
arguments untouched. The code knows shapes but no addresses, so it can be cached: those come in the ``self`` argument,
a bytes object that holds :data:`POINTERS` in that order.
"""

from __future__ import annotations

from ..program.program import Port
from .llvm_text import LlvmWriter
from .processor import DOUBLE

CALL = "call"
"""Name of the function."""

POINTERS = ("array_type", "float64", "new_array", "vectorcall", "incref", "decref", "loop", "fallback")
"""What the bytes object holds: addresses, 8 bytes each."""

FIELDS = {"type": 8, "data": 16, "nd": 24, "dims": 32, "descr": 56, "flags": 64}
"""Offsets in NumPy's array object, as its C API has published them, on 64-bit CPython with its lock."""

BYTES_DATA = 32
"""Offset of the contents of a bytes object."""

_CONTIGUOUS_AND_ALIGNED = 0x1 | 0x100


def call_assembly(inputs: tuple[Port, ...], output: Port) -> str:
    """The module for arrays of these shapes."""
    w = LlvmWriter(DOUBLE, 2)
    context = w.at("%self", BYTES_DATA)
    at = {name: w.new(f"load ptr, ptr {w.at(context, 8 * k)}, align 8") for k, name in enumerate(POINTERS)}
    _check(w, "icmp eq ptr %names, null")
    _check(w, f"icmp eq i64 %count, {len(inputs)}")
    data = [_checked(w, at, k, port) for k, port in enumerate(inputs)]
    made = _new_array(w, at, output)
    data.append(w.new(f"load ptr, ptr {w.at(made, FIELDS['data'])}, align 8"))
    _run(w, at["loop"], [*inputs, output], data)
    _check_finite(w, at, made, data[-1], output.size)
    w.do(f"ret ptr {made}")
    w.begin("slow")
    w.do(f"%other = call ptr {at['vectorcall']}(ptr {at['fallback']}, ptr %args, i64 %count, ptr %names)")
    w.do("ret ptr %other")
    body = "\n".join(w.lines)
    return f"define ptr @{CALL}(ptr %self, ptr %args, i64 %count, ptr %names) {{\nentry:\n{body}\n}}\n"


def _check(w: LlvmWriter, condition: str) -> None:
    """Go on where it holds, else the slow way."""
    further = w.label("ok")
    w.do(f"br i1 {w.new(condition)}, label %{further}, label %slow")
    w.begin(further)


def _checked(w: LlvmWriter, at: dict[str, str], k: int, port: Port) -> str:
    """The data of an argument that is an array as wanted; dimensions are read only where there are as many."""

    def field(name: str, kind: str) -> str:
        return w.new(f"load {kind}, ptr {w.at(array, FIELDS[name])}, align 4")

    array = w.new(f"load ptr, ptr {w.at('%args', 8 * k)}, align 8")
    _check(w, f"icmp eq ptr {field('type', 'ptr')}, {at['array_type']}")
    _check(w, f"icmp eq ptr {field('descr', 'ptr')}, {at['float64']}")
    _check(w, f"icmp eq i32 {field('nd', 'i32')}, {len(port.shape)}")
    flags = w.new(f"and i32 {field('flags', 'i32')}, {_CONTIGUOUS_AND_ALIGNED}")
    _check(w, f"icmp eq i32 {flags}, {_CONTIGUOUS_AND_ALIGNED}")
    dims = field("dims", "ptr")
    for axis, size in enumerate(port.shape):
        found = w.new(f"load i64, ptr {w.at(dims, 8 * axis)}, align 8")
        _check(w, f"icmp eq i64 {found}, {size}")
    return field("data", "ptr")


def _new_array(w: LlvmWriter, at: dict[str, str], port: Port) -> str:
    dims = _table(w, [str(n) for n in port.shape], "i64")
    w.do(f"call void {at['incref']}(ptr {at['float64']})")  # the new array takes a reference over
    made = w.new(
        f"call ptr {at['new_array']}(ptr {at['array_type']}, ptr {at['float64']}, i32 {len(port.shape)}, ptr {dims}, "
        "ptr null, ptr null, i32 0, ptr null)"
    )
    got, failed = w.label("made"), w.label("failed")
    w.do(f"br i1 {w.new(f'icmp eq ptr {made}, null')}, label %{failed}, label %{got}")
    w.begin(failed)
    w.do("ret ptr null")
    w.begin(got)
    return made


def _run(w: LlvmWriter, loop: str, ports: list[Port], data: list[str]) -> None:
    """Call the loop on one sample, with the distances of contiguous rows."""
    inner: list[int] = []
    for port in ports:
        size = w.precision.bytes
        strides = []
        for n in reversed(port.shape):
            strides.append(size)
            size *= n
        inner += strides[::-1]
    steps = [port.size * w.precision.bytes for port in ports] + inner
    arguments, one = _table(w, data, "ptr"), _table(w, ["1"], "i64")
    w.do(f"call void {loop}(ptr {arguments}, ptr {one}, ptr {_table(w, [str(s) for s in steps], 'i64')}, ptr null)")


def _check_finite(w: LlvmWriter, at: dict[str, str], made: str, data: str, size: int) -> None:
    """Results that are not finite are made again the slow way, where NumPy says so as it does of all others."""
    spoiled = w.number(0.0)
    for k in range(size):
        value = w.new(f"load double, ptr {w.at(data, 8 * k)}, align 8")
        spoiled = w.new(f"fadd double {spoiled}, {w.new(f'fmul double {value}, {w.number(0.0)}')}")
    bits = w.new(f"bitcast double {spoiled} to i64")
    size_of = w.new(f"and i64 {bits}, {0x7FF0000000000000}")
    finite, not_finite = w.label("finite"), w.label("spoiled")
    w.do(f"br i1 {w.new(f'icmp eq i64 {size_of}, 0')}, label %{finite}, label %{not_finite}")
    w.begin(not_finite)
    w.do(f"call void {at['decref']}(ptr {made})")
    w.do("br label %slow")
    w.begin(finite)


def _table(w: LlvmWriter, values: list[str], kind: str) -> str:
    place = w.new(f"alloca [{max(len(values), 1)} x i64], align 8")
    for k, value in enumerate(values):
        w.do(f"store {kind} {value}, ptr {w.at(place, 8 * k)}, align 8")
    return place
