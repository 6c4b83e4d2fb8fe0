"""The loop of a search: every lane makes an attempt of its own, and takes another when that has ended.

With many samples each lane has one, and makes its attempts one after the other; with few, all lanes make attempts of one
sample side by side. Which attempt wins is the same: the first, in the order of starts, that is there; so attempts after one
that is there are given up, and those before it are waited for. The shape is that of :mod:`.batch_loop`; settings and places
are those of the first sample.
"""

from __future__ import annotations

import math

from ..program.program import Port, Program
from ..program.search import ALLOWED, ATTEMPTS, PLACES, TIMES, Search
from .batch_loop import Loop
from .buffers import LINE, ON_STACK, Step, buffer_size, call_block, call_copy, copying, spoiling, take
from .llvm_text import LlvmWriter
from .processor import Precision

NONE = 1 << 62
"""The number of an attempt that there is not."""

_OF_SAMPLE, _OF_LANE = ("sample", "next", "winner", "flying", "nearest"), ("attempt", "times")
"""Integers kept for each lane. Those of a sample are its lane's, or the first lane's where all have the same sample."""

_X, _PASSED, _GIVEN, _MOVED, _PASSED_ON, _BEST, _FAR, _SAID = range(8)
"""Buffers; those of inputs follow."""


def search_over(search: Search) -> Loop:
    """What makes the loop of a search around its program's blocks."""

    def made(
        name: str, _program: Program, precision: Precision, lanes: int, frame: int, _group: int, streams: bool
    ) -> str:
        loop = _Attempts(search, LlvmWriter(precision, lanes), frame, streams)
        loop.write()
        w = loop.w
        tables = {"begins": search.begins, "least": search.least, "most": search.most}
        return "\n".join(
            [
                copying("gather", precision, 1, inward=True),
                copying("scatter", precision, 1, inward=False),
                *([spoiling(precision, lanes), "declare ptr @malloc(i64)\ndeclare void @free(ptr)\n"] * loop.large),
                "declare void @llvm.memcpy.inline.p0.p0.i64(ptr, ptr, i64 immarg, i1 immarg)",
                *(f"@{table} = internal constant {_constant(w, numbers)}" for table, numbers in tables.items()),
                f"define void @{name}(ptr %args, ptr %dims, ptr %steps, ptr %data) {{\nentry:",
                *w.lines,
                "  ret void\n}\n",
            ]
        )

    return made


def _constant(w: LlvmWriter, numbers: tuple[float, ...]) -> str:
    listed = ", ".join(f"{w.element} {w.number(x)}" for x in numbers)
    return f"[{len(numbers)} x {w.element}] [{listed}], align {LINE}"


class _Attempts:
    """The body of one loop."""

    def __init__(self, search: Search, w: LlvmWriter, frame: int, streams: bool) -> None:
        self.s, self.w, self.frame, self.streams = search, w, frame, streams
        self.bytes = w.precision.bytes
        x, passed = search.program.outputs
        self.ports = [x, passed, search.program.inputs[-1], x, passed, passed, Port("far", (PLACES,)), search.said]
        self.ports += search.inputs
        self.large = frame + sum(buffer_size(w, port) for port in self.ports) > ON_STACK

    def write(self) -> None:
        """Everything between the loop's head and its return."""
        w, lanes = self.w, str(self.w.lanes)
        self.samples = w.new("load i64, ptr %dims, align 8")
        self._operands()
        taken = self._room()
        self._tables()
        few = w.new(f"icmp slt i64 {self.samples}, {w.lanes // 2}")
        self.own = self._either(few, 0, 1)
        for k in (_X, _PASSED, _GIVEN, _BEST):  # lanes that never get work compute, too
            self._clear(self.buffers[k], self.ports[k])
        with w.loop(lanes, w.after) as lane:
            for name, value in (("sample", -1), ("next", NONE), ("winner", NONE), ("flying", 0), ("attempt", -1)):
                self._put(name, lane, value)
        w.do(f"store i64 0, ptr {self.queue}, align 8")
        head, body, found = w.label("search"), w.label("step"), w.label("found")
        w.do(f"br label %{head}")
        w.begin(head)
        w.do(f"store i64 0, ptr {self.working}, align 8")
        with w.loop(lanes, head) as lane:
            self._begin(lane)
        working = w.new(f"load i64, ptr {self.working}, align 8")
        w.do(f"br i1 {w.new(f'icmp sgt i64 {working}, 0')}, label %{body}, label %{found}")
        w.begin(body)
        x, passed, given, moved, passed_on = self.buffers[:_BEST]
        call_block(w, [x, x, passed, given, moved, passed_on, *([self.frame_room] if self.frame else [])])
        self._move(x, moved, buffer_size(w, self.ports[_X]), LINE)
        self._move(passed, passed_on, buffer_size(w, self.ports[_PASSED]), LINE)
        with w.loop(lanes, body) as lane:
            self._end(lane)
        w.do(f"br label %{head}")
        w.begin(found)
        if taken:
            w.do(f"call void @free(ptr {taken})")

    # ── what there is ──

    def _operands(self) -> None:
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
                plain = self._both(plain, f"icmp eq i64 {stride}, {expected}")
                expected *= length
            self.plain.append(plain)

    def _room(self) -> str:
        """Find room for all buffers; returns what is to be freed."""
        w, taken = self.w, ""
        w.after = "entry"
        self.counts = w.new(f"alloca [{len(_OF_SAMPLE + _OF_LANE) * w.lanes} x i64], align {LINE}")
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
            if self.streams:
                w.do(f"store i64 0, ptr {w.at(self.frame_room, self.frame - LINE)}")
        return taken

    def _tables(self) -> None:
        """Find the settings and the places, without gaps."""
        w = self.w
        found = []
        for k in range(2, len(self.s.inputs)):
            buffer = self.buffers[_SAID + 1 + k]
            with w.when(w.new(f"xor i1 {self.plain[k]}, true")):
                call_copy(w, "gather", buffer, self.bases[k], "1", self.s.inputs[k].shape, self.strides[k])
            found.append(w.new(f"select i1 {self.plain[k]}, ptr {self.bases[k]}, ptr {buffer}"))
        self.settings, self.places, self.reached = found
        self.most_times, self.most_attempts = (
            w.new(f"fptosi {w.element} {self._number(self.settings, k)} to i64") for k in (TIMES, ATTEMPTS)
        )

    # ── pieces ──

    def _place(self, name: str, lane: str) -> str:
        names = _OF_SAMPLE + _OF_LANE
        first = self.w.at(self.counts, names.index(name) * self.w.lanes * 8)
        return self.w.at(first, self.w.new(f"mul i64 {lane}, 8"))

    def _count(self, name: str, lane: str) -> str:
        return self.w.new(f"load i64, ptr {self._place(name, lane)}, align 8")

    def _put(self, name: str, lane: str, value: str | int) -> None:
        self.w.do(f"store i64 {value}, ptr {self._place(name, lane)}, align 8")

    def _row(self, which: int, lane: str) -> str:
        """Where the row of a lane begins in a buffer."""
        return self.w.at(self.buffers[which], self.w.new(f"mul i64 {lane}, {self.ports[which].size * self.bytes}"))

    def _number(self, place: str, entry: int) -> str:
        return self.w.new(f"load {self.w.element}, ptr {self.w.at(place, entry * self.bytes)}, align {self.bytes}")

    def _store(self, place: str, entry: int, value: str) -> None:
        self.w.do(f"store {self.w.element} {value}, ptr {self.w.at(place, entry * self.bytes)}, align {self.bytes}")

    def _move(self, there: str, here: str, count: int, align: int = 0) -> None:
        align = align or self.bytes
        target, source = f"ptr align {align} {there}", f"ptr align {align} {here}"
        self.w.do(f"call void @llvm.memcpy.inline.p0.p0.i64({target}, {source}, i64 {count}, i1 false)")

    def _clear(self, buffer: str, port: Port) -> None:
        w, size = self.w, self.w.lanes * self.bytes
        with w.loop(str(port.size), w.after) as k:
            w.do(f"store {w.vector} zeroinitializer, ptr {w.at(buffer, w.new(f'mul i64 {k}, {size}'))}, align {size}")

    def _either(self, condition: str, a: str | int, b: str | int) -> str:
        return self.w.new(f"select i1 {condition}, i64 {a}, i64 {b}")

    def _both(self, *conditions: str) -> str:
        """Whether all hold; each is a value, or an instruction that gives one."""
        found = "true"
        for one in conditions:
            value = self.w.new(one) if " " in one else one
            found = value if found == "true" else self.w.new(f"and i1 {found}, {value}")
        return found

    def _copied_in(self, k: int, there: str, sample: str) -> None:
        """One sample of an input, to a row."""
        w, port = self.w, self.s.inputs[k]
        here = w.at(self.bases[k], w.new(f"mul i64 {sample}, {self.strides[k][0]}"))
        with w.when(self.plain[k]):
            self._move(there, here, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.plain[k]}, true")):
            call_copy(w, "gather", there, here, "1", port.shape, self.strides[k])

    def _copied_out(self, k: int, here: str, sample: str) -> None:
        """A row, to one sample of a result."""
        w, port, number = self.w, self.s.outputs[k], len(self.s.inputs) + k
        there = w.at(self.bases[number], w.new(f"mul i64 {sample}, {self.strides[number][0]}"))
        with w.when(self.plain[number]):
            self._move(there, here, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.plain[number]}, true")):
            call_copy(w, "scatter", here, there, "1", port.shape, self.strides[number])

    # ── attempts ──

    def _begin(self, lane: str) -> None:
        """Give a lane without work an attempt: of its sample, or of another when that is done with."""
        w = self.w
        with w.when(w.new(f"icmp slt i64 {self._count('attempt', lane)}, 0")):
            mine = w.new(f"mul i64 {lane}, {self.own}")
            none = w.new(f"icmp eq i64 {self._count('winner', mine)}, {NONE}")
            more = self._both(none, f"icmp sle i64 {self._count('next', mine)}, {self.most_attempts}")
            idle = w.new(f"icmp eq i64 {self._count('flying', mine)}, 0")
            with w.when(self._both(f"xor i1 {more}, true", idle)):
                with w.when(w.new(f"icmp sge i64 {self._count('sample', mine)}, 0")):
                    self._say(mine)
                self._take(mine)
            none = w.new(f"icmp eq i64 {self._count('winner', mine)}, {NONE}")
            with w.when(self._both(none, f"icmp sle i64 {self._count('next', mine)}, {self.most_attempts}")):
                self._start(lane, mine)
        with w.when(w.new(f"icmp sge i64 {self._count('attempt', lane)}, 0")):
            w.do(f"store i64 1, ptr {self.working}, align 8")

    def _take(self, mine: str) -> None:
        """The next sample, if there is one."""
        w = self.w
        sample = w.new(f"load i64, ptr {self.queue}, align 8")
        there = w.new(f"icmp slt i64 {sample}, {self.samples}")
        self._put("sample", mine, self._either(there, sample, -1))
        self._put("next", mine, self._either(there, 0, NONE))
        self._put("winner", mine, NONE)
        self._put("nearest", mine, NONE)
        w.do(f"store i64 {self._either(there, w.new(f'add i64 {sample}, 1'), sample)}, ptr {self.queue}, align 8")

    def _start(self, lane: str, mine: str) -> None:
        """The next attempt of a sample."""
        w = self.w
        sample, attempt = self._count("sample", mine), self._count("next", mine)
        self._put("attempt", lane, attempt)
        self._put("times", lane, 0)
        self._put("next", mine, w.new(f"add i64 {attempt}, 1"))
        self._put("flying", mine, w.new(f"add i64 {self._count('flying', mine)}, 1"))
        given, x, passed = (self._row(k, lane) for k in (_GIVEN, _X, _PASSED))
        self._copied_in(0, given, sample)
        size = self.s.target.size * self.bytes
        rest = self.ports[_GIVEN].size * self.bytes - size
        self._move(w.at(given, size), w.at(self.settings, ALLOWED * self.bytes), rest)
        with w.when(w.new(f"icmp eq i64 {attempt}, 0")):
            self._copied_in(1, x, sample)
            self._bring_inside(x)
        with w.when(w.new(f"icmp eq i64 {attempt}, 1")):
            self._distances(given, mine)
        with w.when(w.new(f"icmp sgt i64 {attempt}, 0")):
            nearest = self._nearest(mine)
            size = self.ports[_X].size * self.bytes
            self._move(x, w.at(self.places, w.new(f"mul i64 {nearest}, {size}")), size)
        size = self.ports[_X].size * self.bytes
        self._move(passed, x, size)
        self._move(w.at(passed, size), "@begins", len(self.s.begins) * self.bytes)

    def _bring_inside(self, x: str) -> None:
        """Entries of x that are less than their least, or more than their most, become that."""
        w, e = self.w, self.w.element
        with w.loop(str(self.s.x.size), w.after) as k:
            offset = w.new(f"mul i64 {k}, {self.bytes}")
            place = w.at(x, offset)
            value = self._number(place, 0)
            for table, order in (("@least", "olt"), ("@most", "ogt")):
                bound = self._number(w.at(table, offset), 0)
                beyond = w.new(f"fcmp {order} {e} {value}, {bound}")
                value = w.new(f"select i1 {beyond}, {e} {bound}, {e} {value}")
            self._store(place, 0, value)

    def _distances(self, target: str, mine: str) -> None:
        """How far the places are from where a sample wants to be."""
        w = self.w
        far, first = self._row(_FAR, mine), ALLOWED + self.ports[_GIVEN].size - self.s.target.size
        pairs = [
            [
                f"{w.vector} {self._everywhere(self._number(*there))}"
                for there in ((target, entry), (self.settings, first + k))
            ]
            for k, entry in enumerate(self.s.near)
        ]
        with w.loop(str(PLACES // w.lanes), w.after) as k:
            offset, total = w.new(f"mul i64 {k}, {w.lanes * self.bytes}"), w.splat(0.0)
            for entry, (wanted, weight) in enumerate(pairs):
                place = w.at(w.at(self.reached, entry * PLACES * self.bytes), offset)
                gap = w.new(f"fsub {wanted}, {w.new(f'load {w.vector}, ptr {place}, align {self.bytes}')}")
                total = w.binary("fadd", total, w.new(f"fmul {weight}, {w.binary('fmul', gap, gap)}"))
            w.do(f"store {w.vector} {total}, ptr {w.at(far, offset)}, align {self.bytes}")

    def _everywhere(self, number: str) -> str:
        w = self.w
        one = w.new(f"insertelement {w.vector} poison, {w.element} {number}, i32 0")
        return w.shuffle(one, one, [0] * w.lanes)

    def _nearest(self, mine: str) -> str:
        """The number of the nearest place that is left; it is not left any more."""
        w = self.w
        far = self._row(_FAR, mine)
        found, least = self.found, self.least
        w.do(f"store i64 0, ptr {found}, align 8")
        w.do(f"store {w.element} {w.number(math.inf)}, ptr {least}, align 8")
        with w.loop(str(PLACES), w.after) as k:
            this = w.new(f"load {w.element}, ptr {w.at(far, w.new(f'mul i64 {k}, {self.bytes}'))}, align {self.bytes}")
            before = w.new(f"load {w.element}, ptr {least}, align 8")
            nearer = w.new(f"fcmp olt {w.element} {this}, {before}")
            w.do(
                f"store {w.element} {w.new(f'select i1 {nearer}, {w.element} {this}, {w.element} {before}')}, ptr {least}"
            )
            w.do(f"store i64 {self._either(nearer, k, w.new(f'load i64, ptr {found}, align 8'))}, ptr {found}, align 8")
        nearest = w.new(f"load i64, ptr {found}, align 8")
        place = w.at(far, w.new(f"mul i64 {nearest}, {self.bytes}"))
        w.do(f"store {w.element} {w.number(math.inf)}, ptr {place}, align {self.bytes}")
        return nearest

    def _end(self, lane: str) -> None:
        """See whether the attempt of a lane has ended, and what it found."""
        w = self.w
        attempt = self._count("attempt", lane)
        with w.when(w.new(f"icmp sge i64 {attempt}, 0")):
            mine = w.new(f"mul i64 {lane}, {self.own}")
            times = w.new(f"add i64 {self._count('times', lane)}, 1")
            self._put("times", lane, times)
            winner = self._count("winner", mine)
            late = w.new(f"icmp sgt i64 {attempt}, {winner}")
            passed = self._row(_PASSED, lane)
            goes = self._number(passed, self.ports[_PASSED].size - 1)
            goes = w.new(f"fcmp ogt {w.element} {goes}, {w.number(0.0)}")
            further = self._both(goes, f"icmp slt i64 {times}, {self.most_times}", f"xor i1 {late}, true")
            with w.when(w.new(f"xor i1 {further}, true")):
                self._put("attempt", lane, -1)
                self._put("flying", mine, w.new(f"sub i64 {self._count('flying', mine)}, 1"))
                with w.when(w.new(f"xor i1 {late}, true")):
                    self._compare(mine, attempt, passed)

    def _compare(self, mine: str, attempt: str, passed: str) -> None:
        """Keep what an attempt found if it is there, or nearer than all before; of two as near, the earlier."""
        w = self.w
        there, cost = self._number(passed, self.s.x.size), self._number(passed, self.s.x.size + 1)
        ends = w.new(f"fcmp one {w.element} {there}, {w.number(0.0)}")
        self._put("winner", mine, self._either(ends, attempt, self._count("winner", mine)))
        best = self._row(_BEST, mine)
        least, nearest = self._number(best, self.s.x.size + 1), self._count("nearest", mine)
        known = f"fcmp ord {w.element} {cost}, {cost}"
        nearer = self._both(known, f"fcmp ult {w.element} {cost}, {least}")  # than NaN, too
        same = self._both(f"fcmp oeq {w.element} {cost}, {least}", f"icmp slt i64 {attempt}, {nearest}")
        first = w.new(f"icmp eq i64 {nearest}, {NONE}")
        better = ends
        for one in (nearer, same, first):
            better = w.new(f"or i1 {better}, {one}")
        with w.when(better):
            self._put("nearest", mine, attempt)
            self._move(best, passed, self.ports[_PASSED].size * self.bytes)

    def _say(self, mine: str) -> None:
        """Hand over what was found for a sample."""
        w = self.w
        sample, winner, best = self._count("sample", mine), self._count("winner", mine), self._row(_BEST, mine)
        none = w.new(f"icmp eq i64 {winner}, {NONE}")
        starts = self._either(none, self._count("next", mine), w.new(f"add i64 {winner}, 1"))
        said = self._row(_SAID, mine)
        self._store(said, 0, w.new(f"sitofp i64 {starts} to {w.element}"))
        self._move(w.at(said, self.bytes), w.at(best, self.s.x.size * self.bytes), (self.s.said.size - 1) * self.bytes)
        self._copied_out(0, best, sample)
        self._copied_out(1, said, sample)
