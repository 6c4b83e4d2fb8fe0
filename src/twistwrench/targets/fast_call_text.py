"""The shortest way from Python into a loop: a C function of the METH_FASTCALL kind, as LLVM assembly.

It takes the arguments of one sample in one way of calling: exact arrays of one type, C-contiguous and aligned, or lists of
Python's floats; options that are the very objects it knows; a dict of further arrays; ``out=``. It allocates what is to be
returned, and runs the loop on one row. Whatever is not that (other types, shapes, options, results that are not finite) goes to
a slower callable with the arguments untouched. The code knows shapes but no addresses, so it can be cached: those come in the
``self`` argument, a bytes object that holds :data:`POINTERS` in that order, and then those that :class:`Way` tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..program.program import Port
from .fast_call_checks import helpers, spoiled
from .llvm_text import LlvmWriter
from .processor import DOUBLE, Precision

CALL = "call"
"""Name of the function."""

POINTERS = (
    "array_type", "list_type", "tuple_type", "dict_type", "float_type", "double_type", "none", "descriptor", "new_array",
    "new_scalar", "new_tuple", "dict_size", "dict_item", "vectorcall", "incref", "decref", "loop", "fallback",
)  # fmt: skip
"""What the bytes object holds first: addresses, 8 bytes each; that of the slower callable is where its own address stands."""

FIELDS = {"type": 8, "data": 16, "nd": 24, "dims": 32, "descr": 56, "flags": 64}
"""Offsets in NumPy's array object, as its C API has published them, on 64-bit CPython with its lock."""

BYTES_DATA, SIZE, LIST_ITEMS, TUPLE_ITEMS = 32, 16, 24, tuple.__basicsize__
"""Offsets of the contents of a bytes object, of the size of a list or tuple, and of their items."""

CONTIGUOUS_AND_ALIGNED, _WRITABLE, _BACK, _WARNS = 0x1 | 0x100, 0x400, 0x2000, 1 << 31
"""NumPy's flags of arrays; the last two are of arrays whose writing has consequences."""


@dataclass(frozen=True)
class Way:
    """One way of calling a method: all that the code knows of it."""

    inputs: tuple[Port, ...]
    """The first parameters."""
    mapped: tuple[Port, ...]
    """Arrays that come in a dict; the keys are the last pointers."""
    outputs: tuple[Port, ...]
    precision: Precision
    parameters: int
    """How many there are; their names are the pointers after :data:`POINTERS`."""
    positional: int
    """How many of them may be given without a name."""
    options: tuple[tuple[int, bool], ...]
    """Parameters that must be a certain object, the next pointers; and whether they may be left out."""
    mapping: int = -1
    """The parameter that is a dict, if one is."""
    negative: bool = False
    """Whether what it holds counts with the other sign."""
    out: int = -1
    """The parameter for the results, if there is one."""
    batch: int = 0
    """How many of the first axes of every array, all of length 1, the loop knows nothing of."""


def call_assembly(way: Way) -> str:
    """The module for one way of calling."""
    call, ports = _Call(way), (*way.inputs, *way.mapped, *way.outputs)
    call.write()
    return "\n".join(
        [
            helpers(way.precision, LIST_ITEMS, TUPLE_ITEMS, SIZE, FIELDS["type"]),
            f"@one = internal constant {_numbers([1])}",
            f"@steps = internal constant {_numbers(loop_steps(ports, way.precision, way.batch))}",
            *(f"@shape{k} = internal constant {_numbers(port.shape)}" for k, port in enumerate(way.outputs)),
            f"define ptr @{CALL}(ptr %self, ptr %args, i64 %count, ptr %names) {{\nentry:",
            *call.w.lines,
            "}\n",
        ]
    )


def _numbers(values: Sequence[int]) -> str:
    """A constant table."""
    return f"[{len(values)} x i64] [{', '.join(f'i64 {n}' for n in values)}]"


def loop_steps(ports: Sequence[Port], precision: Precision, batch: int = 0) -> list[int]:
    """The distances of contiguous rows in bytes, as a loop wants them; of the first ``batch`` axes it knows nothing."""
    inner: list[int] = []
    for port in ports:
        size, strides = precision.bytes, []
        for n in reversed(port.shape[batch:]):
            strides.append(size)
            size *= n
        inner += strides[::-1]
    return [port.size * precision.bytes for port in ports] + inner


class _Call:
    """The function, written from its first line to its last."""

    def __init__(self, way: Way) -> None:
        self.way, self.w, self.label = way, LlvmWriter(way.precision, 1), "entry"
        w = self.w
        self.given = (*way.inputs, *way.mapped)
        self.context = w.at("%self", BYTES_DATA)
        self.data = w.new(f"alloca [{len(self.given) + len(way.outputs)} x ptr], align 8")
        self.results = w.new(f"alloca [{len(way.outputs)} x ptr], align 8")
        self.slots = w.new(f"alloca [{way.parameters} x ptr], align 8")
        self.rooms = [w.new(f"alloca [{port.size} x {w.element}], align 64") for port in (*self.given, *way.outputs)]

    # ── pieces ──

    def known(self, what: str | int) -> str:
        """An address of the context, by its name or its number."""
        number = POINTERS.index(what) if isinstance(what, str) else len(POINTERS) + what
        return self.at(self.context, number)

    def at(self, table: str, number: int, kind: str = "ptr") -> str:
        """An entry of a table."""
        return self.w.new(f"load {kind}, ptr {self.w.at(table, 8 * number)}, align 8")

    def put(self, table: str, number: int, value: str) -> None:
        """Set a pointer of a table."""
        self.w.do(f"store ptr {value}, ptr {self.w.at(table, 8 * number)}, align 8")

    def begin(self, label: str) -> None:
        """Start a basic block."""
        self.w.begin(label)
        self.label = label

    def fork(self, condition: str, yes: str, no: str) -> None:
        """Go to the one label where it holds, else to the other."""
        self.w.do(f"br i1 {self.w.new(condition)}, label %{yes}, label %{no}")

    def check(self, condition: str) -> None:
        """Go on where it holds, else the slow way."""
        further = self.w.label("ok")
        self.fork(condition, further, "slow")
        self.begin(further)

    def field(self, array: str, name: str, kind: str) -> str:
        """A field of an array."""
        return self.w.new(f"load {kind}, ptr {self.w.at(array, FIELDS[name])}, align 4")

    # ── the function ──

    def write(self) -> None:
        """All of it."""
        w, way = self.w, self.way
        outs = "null"
        arguments = self.slots
        if way.mapping < 0 and all(optional for _, optional in way.options):
            quick, sort, sorted_ = (w.label(stem) for stem in ("quick", "sort", "sorted"))
            plain = w.new("icmp eq ptr %names, null")
            as_many = w.new(f"icmp eq i64 %count, {len(way.inputs)}")
            self.fork(f"and i1 {plain}, {as_many}", quick, sort)
            self.begin(quick)
            w.do(f"br label %{sorted_}")
            self.begin(sort)
            self.sort()
            found, last = self.at(self.slots, way.out) if way.out >= 0 else "null", self.label
            w.do(f"br label %{sorted_}")
            self.begin(sorted_)
            arguments = w.new(f"phi ptr [%args, %{quick}], [{self.slots}, %{last}]")
            outs = w.new(f"phi ptr [null, %{quick}], [{found}, %{last}]")
        else:
            self.sort()
            outs = self.at(self.slots, way.out) if way.out >= 0 else "null"
        for k, port in enumerate(way.inputs):
            self.input(k, self.at(arguments, k), port)
        self.mapped()
        self.results_and_run(outs)
        self.begin("slow")
        slower = self.at(self.known("fallback"), 0)
        arguments = f"ptr {slower}, ptr %args, i64 %count, ptr %names"
        other = w.new(f"call ptr {self.known('vectorcall')}({arguments})")
        w.do(f"ret ptr {other}")

    def sort(self) -> None:
        """Bring arguments into the order of the parameters, and look at the options."""
        w, way = self.w, self.way
        for k in range(way.parameters):
            self.put(self.slots, k, "null")
        names = w.at(self.context, 8 * len(POINTERS))
        self.check(f"icmp sle i64 %count, {way.positional}")
        sorted_ = w.new(
            f"call i1 @sort(ptr {self.slots}, i64 {way.parameters}, ptr {names}, ptr %args, i64 %count, ptr %names)"
        )
        self.check(f"icmp eq i1 {sorted_}, true")
        for number, (parameter, optional) in enumerate(way.options, start=way.parameters):
            given = self.at(self.slots, parameter)
            same = w.new(f"icmp eq ptr {given}, {self.known(number)}")
            missing = w.new(f"icmp eq ptr {given}, null")
            self.check(f"or i1 {same}, {missing if optional else 'false'}")

    def input(self, k: int, given: str, port: Port) -> None:
        """Find the numbers of an argument: those of an array as it lies, or of a list in a room of our own."""
        w = self.w
        self.check(f"icmp ne ptr {given}, null")
        if self.way.precision is not DOUBLE or len(port.shape) != 1:
            self.put(self.data, k, self.array(given, port))
            return
        array, listed, done = (w.label(stem) for stem in ("array", "list", "given"))
        self.fork(f"icmp eq ptr {self.field(given, 'type', 'ptr')}, {self.known('array_type')}", array, listed)
        self.begin(listed)
        types = ", ".join(f"ptr {self.known(t)}" for t in ("list_type", "tuple_type", "float_type", "double_type"))
        fine = w.new(f"call i1 @numbers(ptr {given}, i64 {port.size}, ptr {self.rooms[k]}, {types})")
        self.check(f"icmp eq i1 {fine}, true")
        self.put(self.data, k, self.rooms[k])
        w.do(f"br label %{done}")
        self.begin(array)
        self.put(self.data, k, self.array(given, port))
        w.do(f"br label %{done}")
        self.begin(done)

    def array(self, array: str, port: Port, flags: tuple[int, int] = (CONTIGUOUS_AND_ALIGNED,) * 2) -> str:
        """The data of an array that is as wanted; dimensions are read only where there are as many."""
        w, (mask, wanted) = self.w, flags
        self.check(f"icmp eq ptr {self.field(array, 'type', 'ptr')}, {self.known('array_type')}")
        self.check(f"icmp eq ptr {self.field(array, 'descr', 'ptr')}, {self.known('descriptor')}")
        self.check(f"icmp eq i32 {self.field(array, 'nd', 'i32')}, {len(port.shape)}")
        found = self.field(array, "flags", "i32")
        self.check(f"icmp eq i32 {w.new(f'and i32 {found}, {mask}')}, {wanted}")
        dims = self.field(array, "dims", "ptr")
        for axis, size in enumerate(port.shape):
            self.check(f"icmp eq i64 {self.at(dims, axis, 'i64')}, {size}")
        return self.field(array, "data", "ptr")

    def mapped(self) -> None:
        """Find the arrays of the dict, with the sign they count with."""
        w, way = self.w, self.way
        if way.mapping < 0:
            return
        given = self.at(self.slots, way.mapping)
        self.check(f"icmp ne ptr {given}, null")
        self.check(f"icmp eq ptr {self.field(given, 'type', 'ptr')}, {self.known('dict_type')}")
        many = w.new(f"call i64 {self.known('dict_size')}(ptr {given})")
        self.check(f"icmp eq i64 {many}, {len(way.mapped)}")
        for number, port in enumerate(way.mapped):
            k = len(way.inputs) + number
            key = self.known(way.parameters + len(way.options) + number)
            array = w.new(f"call ptr {self.known('dict_item')}(ptr {given}, ptr {key})")
            self.check(f"icmp ne ptr {array}, null")
            data = self.array(array, port)
            if way.negative:
                kind, align = f"<{port.size} x {w.element}>", f"align {w.precision.bytes}"
                numbers = w.new(f"load {kind}, ptr {data}, {align}")
                opposite = w.new(f"fmul {kind} {numbers}, splat ({w.element} {w.number(-1.0)})")
                w.do(f"store {kind} {opposite}, ptr {self.rooms[k]}, {align}")
                data = self.rooms[k]
            self.put(self.data, k, data)

    # ── results ──

    def results_and_run(self, outs: str) -> None:
        """Room for results, the loop, a look at what came out, and what is returned."""
        w, way = self.w, self.way
        fresh, lent, run, kept = (w.label(stem) for stem in ("fresh", "lent", "run", "kept"))
        if way.out >= 0:
            none = w.new(f"icmp eq ptr {outs}, {self.known('none')}")
            self.fork(f"or i1 {none}, {w.new(f'icmp eq ptr {outs}, null')}", fresh, lent)
            self.begin(lent)
            self.lent(outs)
            after_lent = self.label
            w.do(f"br label %{run}")
        else:
            w.do(f"br label %{fresh}")
        self.begin(fresh)
        self.allocate()
        after_fresh = self.label
        w.do(f"br label %{run}")
        self.begin(run)
        mine = w.new(f"phi i1 [true, %{after_fresh}]" + (f", [false, %{after_lent}]" if way.out >= 0 else ""))
        w.do(f"call void {self.known('loop')}(ptr {self.data}, ptr @one, ptr @steps, ptr null)")
        bad = "false"
        for k, port in enumerate(way.outputs, start=len(self.given)):
            found, self.label = spoiled(w, self.at(self.data, k), port.size, self.label)
            bad = w.new(f"or i1 {bad}, {found}")
        wrong, fine, drop, hand = (w.label(stem) for stem in ("wrong", "fine", "drop", "hand"))
        w.do(f"br i1 {bad}, label %{wrong}, label %{fine}")
        self.begin(wrong)  # results that are not finite are made again the slow way, where NumPy says so
        w.do(f"br i1 {mine}, label %{drop}, label %slow")
        self.begin(drop)
        self.drop(len(way.outputs))
        w.do("br label %slow")
        self.begin(fine)
        w.do(f"br i1 {mine}, label %{hand}, label %{kept}")
        self.begin(kept)
        w.do(f"call void {self.known('incref')}(ptr {outs})")
        w.do(f"ret ptr {outs}")
        self.begin(hand)
        self.hand_over()

    def lent(self, outs: str) -> None:
        """The caller's arrays, where they can be written to and share no memory with each other or with what is read."""
        w, way = self.w, self.way
        objects = [outs]
        if len(way.outputs) > 1:
            self.check(f"icmp eq ptr {self.field(outs, 'type', 'ptr')}, {self.known('tuple_type')}")
            self.check(f"icmp eq i64 {self.at(w.at(outs, SIZE), 0, 'i64')}, {len(way.outputs)}")
            objects = [self.at(w.at(outs, TUPLE_ITEMS), k) for k in range(len(way.outputs))]
        wanted = CONTIGUOUS_AND_ALIGNED | _WRITABLE
        for k, (item, port) in enumerate(zip(objects, way.outputs, strict=True)):
            place = self.array(item, port, (wanted | _BACK | _WARNS, wanted))
            ports = (*self.given, *way.outputs)
            for j in range(len(self.given) + k):
                other = self.at(self.data, j)
                self.check(f"or i1 {self.ends_before(place, port, other)}, {self.ends_before(other, ports[j], place)}")
            self.put(self.data, len(self.given) + k, place)

    def ends_before(self, one: str, port: Port, other: str) -> str:
        """Whether the numbers of one array end before those of another begin."""
        end = self.w.at(one, port.size * self.way.precision.bytes)
        return self.w.new(f"icmp ule ptr {end}, {other}")

    def allocate(self) -> None:
        """New arrays; a scalar is computed in a room of our own."""
        w = self.w
        for k, port in enumerate(self.way.outputs):
            if not port.shape:
                self.put(self.data, len(self.given) + k, self.rooms[len(self.given) + k])
                continue
            descriptor = self.known("descriptor")
            w.do(f"call void {self.known('incref')}(ptr {descriptor})")  # the new array takes a reference over
            made = w.new(
                f"call ptr {self.known('new_array')}(ptr {self.known('array_type')}, ptr {descriptor}, i32 {len(port.shape)}, "
                f"ptr @shape{k}, ptr null, ptr null, i32 0, ptr null)"
            )
            self.made(made, k)
            self.put(self.results, k, made)
            self.put(self.data, len(self.given) + k, self.field(made, "data", "ptr"))

    def made(self, item: str, before: int) -> None:
        """Go on where Python made an object, else drop what was made before and leave with its error."""
        got, failed = self.w.label("made"), self.w.label("failed")
        self.fork(f"icmp eq ptr {item}, null", failed, got)
        self.begin(failed)
        self.drop(before)
        self.w.do("ret ptr null")
        self.begin(got)

    def drop(self, count: int) -> None:
        """Let go of so many new arrays."""
        for k in range(count):
            if self.way.outputs[k].shape:
                self.w.do(f"call void {self.known('decref')}(ptr {self.at(self.results, k)})")

    def hand_over(self) -> None:
        """Return what was made: an array, a scalar, or a tuple."""
        w, outputs = self.w, self.way.outputs
        if len(outputs) > 1:
            several = w.new(f"call ptr {self.known('new_tuple')}(i64 {len(outputs)})")
            self.made(several, len(outputs))
            for k in range(len(outputs)):
                self.put(w.at(several, TUPLE_ITEMS), k, self.at(self.results, k))
            w.do(f"ret ptr {several}")
        elif outputs[0].shape:
            w.do(f"ret ptr {self.at(self.results, 0)}")
        else:
            room = self.rooms[len(self.given)]
            scalar = w.new(f"call ptr {self.known('new_scalar')}(ptr {room}, ptr {self.known('descriptor')}, ptr null)")
            w.do(f"ret ptr {scalar}")
