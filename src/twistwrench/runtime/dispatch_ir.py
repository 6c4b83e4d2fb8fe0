"""What the shortest way into a loop looks at: keywords, lists of numbers, results that are not finite; as LLVM assembly."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.program import TensorSpec
from ..lowering.ir_builder import LlvmWriter
from ..lowering.target_machine import DOUBLE, Precision
from .call_signature import BYTES_DATA, FIELDS, LIST_ITEMS, POINTERS, SIZE, TUPLE_ITEMS, Way, loop_steps

FLOAT_VALUE = 16
"""Offset of the number in Python's float, and in NumPy's, which is one."""

_UNROLLED = 16
"""Vectors that are looked at one by one; more go in a loop."""


def helpers(precision: Precision, list_items: int, tuple_items: int, size: int, kind: int) -> str:
    """``sort``, and for doubles ``numbers``; the arguments are offsets in Python's objects."""
    return _sort(tuple_items, size) + (_number_list(list_items, tuple_items, size, kind) if precision is DOUBLE else "")


def _sort(tuple_items: int, size: int) -> str:
    """``sort`` puts arguments where their parameters are; false for a name it does not know and for one given twice."""
    w = LlvmWriter(DOUBLE, 1)
    with w.loop("%count", "entry") as k:
        argument = w.new(f"load ptr, ptr {_entry(w, '%args', k)}, align 8")
        w.do(f"store ptr {argument}, ptr {_entry(w, '%slots', k)}, align 8")
    some, none = w.label("named"), w.label("plain")
    named = w.new("icmp eq ptr %names, null")
    w.do(f"br i1 {named}, label %{none}, label %{some}")
    w.begin(none)
    w.do("ret i1 true")
    w.begin(some)
    several = w.new(f"load i64, ptr {w.at('%names', size)}, align 8")
    items = w.at("%names", tuple_items)
    with w.loop(several, some) as j:
        name = w.new(f"load ptr, ptr {_entry(w, items, j)}, align 8")
        place = w.new(f"call i64 @place(ptr %known, i64 %parameters, ptr {name})")
        _else_false(w, w.new(f"icmp sge i64 {place}, 0"))
        slot = _entry(w, "%slots", place)
        taken = w.new(f"load ptr, ptr {slot}, align 8")
        _else_false(w, w.new(f"icmp eq ptr {taken}, null"))
        argument = w.new(f"load ptr, ptr {_entry(w, '%args', w.new(f'add i64 %count, {j}'))}, align 8")
        w.do(f"store ptr {argument}, ptr {slot}, align 8")
    w.do("ret i1 true")
    arguments = "ptr %slots, i64 %parameters, ptr %known, ptr %args, i64 %count, ptr %names"
    return _place() + _function("i1", "sort", arguments, w, otherwise="ret i1 false")


def _place() -> str:
    """``place``: the number of a pointer in a table, or -1."""
    w = LlvmWriter(DOUBLE, 1)
    with w.loop("%length", "entry") as k:
        entry = w.new(f"load ptr, ptr {_entry(w, '%table', k)}, align 8")
        here, on = w.label("here"), w.label("on")
        w.do(f"br i1 {w.new(f'icmp eq ptr {entry}, %wanted')}, label %{here}, label %{on}")
        w.begin(here)
        w.do(f"ret i64 {k}")
        w.begin(on)
    w.do("ret i64 -1")
    return _function("i64", "place", "ptr %table, i64 %length, ptr %wanted", w)


def _number_list(list_items: int, tuple_items: int, size: int, kind: int) -> str:
    """``numbers`` copies the floats of a list or tuple; false where it is not one of so many, or has other things in it."""
    w = LlvmWriter(DOUBLE, 1)
    found = w.new(f"load ptr, ptr {w.at('%object', kind)}, align 8")
    listed, tupled = w.new(f"icmp eq ptr {found}, %list"), w.new(f"icmp eq ptr {found}, %tuple")
    _else_false(w, w.new(f"or i1 {listed}, {tupled}"))
    length = w.new(f"load i64, ptr {w.at('%object', size)}, align 8")
    last = _else_false(w, w.new(f"icmp eq i64 {length}, %length"))
    apart = w.new(f"load ptr, ptr {w.at('%object', list_items)}, align 8")  # in a tuple an item, or a number
    items = w.new(f"select i1 {listed}, ptr {apart}, ptr {w.at('%object', tuple_items)}")
    with w.loop("%length", last) as k:
        item = w.new(f"load ptr, ptr {_entry(w, items, k)}, align 8")
        its = w.new(f"load ptr, ptr {w.at(item, kind)}, align 8")
        pythons, numpys = w.new(f"icmp eq ptr {its}, %float"), w.new(f"icmp eq ptr {its}, %double")
        _else_false(w, w.new(f"or i1 {pythons}, {numpys}"))
        value = w.new(f"load double, ptr {w.at(item, FLOAT_VALUE)}, align 8")
        w.do(f"store double {value}, ptr {_entry(w, '%into', k)}, align 8")
    w.do("ret i1 true")
    arguments = "ptr %object, i64 %length, ptr %into, ptr %list, ptr %tuple, ptr %float, ptr %double"
    return _function("i1", "numbers", arguments, w, otherwise="ret i1 false")


def _entry(w: LlvmWriter, table: str, number: str) -> str:
    return w.at(table, w.new(f"mul i64 {number}, 8"))


def _else_false(w: LlvmWriter, condition: str) -> str:
    """Go on where it holds, else return false; the label control is in."""
    further = w.label("ok")
    w.do(f"br i1 {condition}, label %{further}, label %no")
    w.begin(further)
    return further


def _function(kind: str, name: str, arguments: str, w: LlvmWriter, otherwise: str = "") -> str:
    lines = [*w.lines, *(["no:", f"  {otherwise}"] if otherwise else [])]
    body = "\n".join(lines)
    return f"define internal {kind} @{name}({arguments}) noinline {{\nentry:\n{body}\n}}\n"


def has_nonfinite(w: LlvmWriter, data: str, size: int, label: str) -> tuple[str, str]:
    """Whether numbers in a row are not all finite, an i1; takes and returns the label control is in.

    A number times zero is zero, but for infinities and what is not a number: so is the sum of many.
    """
    width = 512 // w.precision.bits
    while width > size:
        width //= 2
    kind = f"<{width} x {w.element}>"
    zero = f"splat ({w.element} {w.number(0.0)})"

    def times_zero(offset: int | str) -> str:
        place = w.at(data, offset)
        return w.new(f"fmul {kind} {w.new(f'load {kind}, ptr {place}, align {w.precision.bytes}')}, {zero}")

    def plus(a: str, b: str) -> str:
        return w.new(f"fadd {kind} {a}, {b}")

    step, sums = width * w.precision.bytes, [times_zero((size - width) * w.precision.bytes)]
    whole = size // width
    if whole <= _UNROLLED:
        sums += [times_zero(k * step) for k in range(whole)]
    else:
        head, body, end, following = (w.label(stem) for stem in ("head", "body", "end", "next"))
        first, counter, total = w.name(), w.name(), w.name()
        w.do(f"br label %{head}")
        w.begin(head)
        w.do(f"{counter} = phi i64 [0, %{label}], [%{following}, %{body}]")
        w.do(f"{total} = phi {kind} [{sums[0]}, %{label}], [{first}, %{body}]")
        w.do(f"br i1 {w.new(f'icmp slt i64 {counter}, {whole // 2}')}, label %{body}, label %{end}")
        w.begin(body)
        near = w.new(f"mul i64 {counter}, {2 * step}")
        pair = plus(times_zero(near), times_zero(w.new(f"add i64 {near}, {step}")))
        w.do(f"{first} = fadd {kind} {total}, {pair}")
        w.do(f"%{following} = add i64 {counter}, 1")
        w.do(f"br label %{head}")
        w.begin(end)
        label, sums = end, [total, *([times_zero((whole - 1) * step)] if whole % 2 else [])]
    while len(sums) > 1:
        sums = [*(plus(a, b) for a, b in zip(sums[::2], sums[1::2], strict=False)), *sums[len(sums) // 2 * 2 :]]
    unordered = w.new(f"fcmp uno {kind} {sums[0]}, {zero}")
    bits = w.new(f"bitcast <{width} x i1> {unordered} to i{width}")
    return w.new(f"icmp ne i{width} {bits}, 0"), label


# ── What every part of a call's code is written with: addresses, fields of arrays, forks to the slow callable

CONTIGUOUS_AND_ALIGNED, WRITABLE, BACK, WARNS = 0x1 | 0x100, 0x400, 0x2000, 1 << 31
"""NumPy's flags of arrays; the last two are of arrays whose writing has consequences."""


class CallWriter:
    """The lines of the function, and the tables it works with."""

    def __init__(self, way: Way) -> None:
        self.way, self.w, self.label = way, LlvmWriter(way.precision, 1), "entry"
        w = self.w
        self.given = (*way.inputs, *way.mapped)
        self.context = w.at("%self", BYTES_DATA)
        self.data = w.new(f"alloca [{len(self.given) + len(way.outputs)} x ptr], align 8")
        self.results = w.new(f"alloca [{len(way.outputs)} x ptr], align 8")
        self.slots = w.new(f"alloca [{way.parameters} x ptr], align 8")
        self.rooms = [w.new(f"alloca [{port.size} x {w.element}], align 64") for port in (*self.given, *way.outputs)]

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

    def array(self, array: str, port: TensorSpec, flags: tuple[int, int] = (CONTIGUOUS_AND_ALIGNED,) * 2) -> str:
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


# ── The second half of a call: room for the results, the loop, a look at what came out, and what is returned


class ResultWriter(CallWriter):
    """Writes what follows once the data of all arguments are found."""

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
            found, self.label = has_nonfinite(w, self.at(self.data, k), port.size, self.label)
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
        wanted = CONTIGUOUS_AND_ALIGNED | WRITABLE
        for k, (item, port) in enumerate(zip(objects, way.outputs, strict=True)):
            place = self.array(item, port, (wanted | BACK | WARNS, wanted))
            ports = (*self.given, *way.outputs)
            for j in range(len(self.given) + k):
                other = self.at(self.data, j)
                self.check(f"or i1 {self.ends_before(place, port, other)}, {self.ends_before(other, ports[j], place)}")
            self.put(self.data, len(self.given) + k, place)

    def ends_before(self, one: str, port: TensorSpec, other: str) -> str:
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


# ── The shortest way from Python into a loop: a C function of the METH_FASTCALL kind, as LLVM assembly

# It takes the arguments of one sample in one way of calling: exact arrays of one type, C-contiguous and aligned, or lists of
# Python's floats; options that are the very objects it knows; a dict of further arrays; ``out=``. It allocates what is to be
# returned, and runs the loop on one row. Whatever is not that (other types, shapes, options, results that are not finite)
# goes to
# a slower callable with the arguments untouched. The code knows shapes but no addresses, so it can be cached: those come in the
# ``self`` argument, a bytes object that holds :data:`.call_way.POINTERS` in that order, and then those that :class:`Way` tells.

CALL = "call"
"""Name of the function."""


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


class _Call(ResultWriter):
    """The function, written from its first line to its last."""

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

    def input(self, k: int, given: str, port: TensorSpec) -> None:
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
