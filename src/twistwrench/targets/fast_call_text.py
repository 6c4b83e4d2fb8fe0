"""The shortest way from Python into a loop: a C function of the METH_FASTCALL kind, as LLVM assembly.

It takes the arguments of one sample in one way of calling: exact arrays of one type, C-contiguous and aligned, or lists of
Python's floats; options that are the very objects it knows; a dict of further arrays; ``out=``. It allocates what is to be
returned, and runs the loop on one row. Whatever is not that (other types, shapes, options, results that are not finite) goes to
a slower callable with the arguments untouched. The code knows shapes but no addresses, so it can be cached: those come in the
``self`` argument, a bytes object that holds :data:`.call_way.POINTERS` in that order, and then those that :class:`Way` tells.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..program.port import Port
from .call_results import ResultWriter
from .call_way import FIELDS, LIST_ITEMS, POINTERS, SIZE, TUPLE_ITEMS, Way, loop_steps
from .fast_call_checks import helpers
from .processor import DOUBLE

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
