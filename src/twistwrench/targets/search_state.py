"""What the loop of a search keeps: its operands, its buffers, the integers of each lane, and how they are read and written."""

from __future__ import annotations

from ..program.port import Port
from ..program.search import ATTEMPTS, PLACES, TIMES, Search
from .buffers import LINE, ON_STACK, Step, buffer_size, call_copy, take
from .llvm_text import LlvmWriter

NONE = 1 << 62
"""The number of an attempt that there is not."""

OF_SAMPLE, OF_LANE = ("sample", "next", "winner", "flying", "nearest"), ("attempt", "times")
"""Integers kept for each lane. Those of a sample are its lane's, or the first lane's where all have the same sample."""

X, PASSED, GIVEN, MOVED, PASSED_ON, BEST, FAR, SAID = range(8)
"""Buffers; those of inputs follow."""


class SearchState:
    """Where everything is while a loop runs."""

    def __init__(self, search: Search, w: LlvmWriter, frame: int) -> None:
        self.s, self.w, self.frame = search, w, frame
        self.bytes = w.precision.bytes
        x, passed = search.program.outputs
        self.ports = [x, passed, search.program.inputs[-1], x, passed, passed, Port("far", (PLACES,)), search.said]
        self.ports += search.inputs
        self.samples = ""
        """How many there are."""
        self.large = frame + sum(buffer_size(w, port) for port in self.ports) > ON_STACK

    # ── what there is ──

    def operands(self) -> None:
        """Where arrays begin, their strides, and whether their rows have no gaps."""
        w, ports = self.w, [*self.s.inputs, *self.s.outputs]
        self.bases: list[str] = []
        self.strides: list[Step] = []
        self.plain: list[str] = []
        following = 8 * len(ports)
        for k, port in enumerate(ports):
            self.bases.append(w.new(f"load ptr, ptr {w.at('%args', 8 * k)}, align 8"))
            outer = w.new(f"load i64, ptr {w.at('%steps', 8 * k)}, align 8")
            axes = range(len(port.shape))
            inner = [w.new(f"load i64, ptr {w.at('%steps', following + 8 * axis)}, align 8") for axis in axes]
            following += 8 * len(port.shape)
            self.strides.append((outer, inner))
            plain, expected = "true", self.bytes
            for length, stride in reversed(list(zip(port.shape, inner, strict=True))):
                plain = self.both(plain, f"icmp eq i64 {stride}, {expected}")
                expected *= length
            self.plain.append(plain)

    def room(self) -> str:
        """Find room for all buffers; returns what is to be freed."""
        w, taken = self.w, ""
        w.after = "entry"
        self.counts = w.new(f"alloca [{len(OF_SAMPLE + OF_LANE) * w.lanes} x i64], align {LINE}")
        self.queue, self.working, self.found = (w.new("alloca i64, align 8") for _ in range(3))
        self.least = w.new(f"alloca {w.element}, align 8")
        if self.large:
            sizes = [*(buffer_size(w, port) for port in self.ports), self.frame]
            spoiled = [
                (self.bases[k], port.shape, self.strides[k])
                for k, port in enumerate(self.s.outputs, len(self.s.inputs))
            ]
            taken, w.after, (*self.buffers, self.frame_room) = take(w, sizes, self.samples, spoiled)
        else:
            self.buffers = [w.new(f"alloca [{buffer_size(w, port)} x i8], align {LINE}") for port in self.ports]
            self.frame_room = w.new(f"alloca [{self.frame} x i8], align {LINE}") if self.frame else ""
        if self.frame:
            w.do(f"call void @prepare(ptr {self.frame_room})")
        return taken

    def tables(self) -> None:
        """Find the settings and the places, without gaps."""
        w = self.w
        found = []
        for k in range(2, len(self.s.inputs)):
            buffer = self.buffers[SAID + 1 + k]
            with w.when(w.new(f"xor i1 {self.plain[k]}, true")):
                call_copy(w, "gather", buffer, self.bases[k], "1", self.s.inputs[k].shape, self.strides[k])
            found.append(w.new(f"select i1 {self.plain[k]}, ptr {self.bases[k]}, ptr {buffer}"))
        self.settings, self.places, self.reached = found
        self.most_times, self.most_attempts = (
            w.new(f"fptosi {w.element} {self.number(self.settings, k)} to i64") for k in (TIMES, ATTEMPTS)
        )

    # ── pieces ──

    def place(self, name: str, lane: str) -> str:
        """Where the integer of a lane is."""
        names = OF_SAMPLE + OF_LANE
        first = self.w.at(self.counts, names.index(name) * self.w.lanes * 8)
        return self.w.at(first, self.w.new(f"mul i64 {lane}, 8"))

    def count(self, name: str, lane: str) -> str:
        """The integer of a lane."""
        return self.w.new(f"load i64, ptr {self.place(name, lane)}, align 8")

    def put(self, name: str, lane: str, value: str | int) -> None:
        """Set the integer of a lane."""
        self.w.do(f"store i64 {value}, ptr {self.place(name, lane)}, align 8")

    def row(self, which: int, lane: str) -> str:
        """Where the row of a lane begins in a buffer."""
        return self.w.at(self.buffers[which], self.w.new(f"mul i64 {lane}, {self.ports[which].size * self.bytes}"))

    def number(self, place: str, entry: int) -> str:
        """An entry of a row."""
        return self.w.new(f"load {self.w.element}, ptr {self.w.at(place, entry * self.bytes)}, align {self.bytes}")

    def store(self, place: str, entry: int, value: str) -> None:
        """Set an entry of a row."""
        self.w.do(f"store {self.w.element} {value}, ptr {self.w.at(place, entry * self.bytes)}, align {self.bytes}")

    def move(self, there: str, here: str, count: int, align: int = 0) -> None:
        """Copy so many bytes."""
        align = align or self.bytes
        target, source = f"ptr align {align} {there}", f"ptr align {align} {here}"
        self.w.do(f"call void @llvm.memcpy.inline.p0.p0.i64({target}, {source}, i64 {count}, i1 false)")

    def clear(self, buffer: str, port: Port) -> None:
        """Fill a buffer with zeros."""
        w, size = self.w, self.w.lanes * self.bytes
        with w.loop(str(port.size), w.after) as k:
            w.do(f"store {w.vector} zeroinitializer, ptr {w.at(buffer, w.new(f'mul i64 {k}, {size}'))}, align {size}")

    def either(self, condition: str, a: str | int, b: str | int) -> str:
        """One of two integers."""
        return self.w.new(f"select i1 {condition}, i64 {a}, i64 {b}")

    def both(self, *conditions: str) -> str:
        """Whether all hold; each is a value, or an instruction that gives one."""
        found = "true"
        for one in conditions:
            value = self.w.new(one) if " " in one else one
            found = value if found == "true" else self.w.new(f"and i1 {found}, {value}")
        return found

    def copied_in(self, k: int, there: str, sample: str) -> None:
        """One sample of an input, to a row."""
        w, port = self.w, self.s.inputs[k]
        here = w.at(self.bases[k], w.new(f"mul i64 {sample}, {self.strides[k][0]}"))
        with w.when(self.plain[k]):
            self.move(there, here, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.plain[k]}, true")):
            call_copy(w, "gather", there, here, "1", port.shape, self.strides[k])

    def copied_out(self, k: int, here: str, sample: str) -> None:
        """A row, to one sample of a result."""
        w, port, number = self.w, self.s.outputs[k], len(self.s.inputs) + k
        there = w.at(self.bases[number], w.new(f"mul i64 {sample}, {self.strides[number][0]}"))
        with w.when(self.plain[number]):
            self.move(there, here, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.plain[number]}, true")):
            call_copy(w, "scatter", here, there, "1", port.shape, self.strides[number])
