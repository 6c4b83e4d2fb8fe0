"""The loop of a search: operands, buffers, integers of each lane, and attempts."""

from __future__ import annotations

import math

from ..ir.loops import ATTEMPTS, PLACES, TIMES, TOLERANCES, Search
from ..ir.program import Program, TensorSpec
from .batch_loop import (
    COPY_DECLARATION,
    LINE,
    MEMORY_DECLARATIONS,
    ON_STACK,
    Loop,
    Step,
    allocate,
    buffer_size,
    buffer_sizes,
    call_block,
    call_copy,
    copying,
    load_strides,
    loop_function,
    nan_filler,
)
from .ir_builder import LlvmWriter, typed_list
from .target_machine import Precision

NO_ATTEMPT = 1 << 62
"""Attempt number that represents no attempt."""

OF_SAMPLE, OF_LANE = ("sample", "next", "winner", "flying", "nearest"), ("attempt", "times")
"""Integers of each lane. Those of a sample are stored for its lane, or for the first lane if all lanes share a sample."""

X, PASSED, GIVEN, MOVED, PASSED_ON, BEST, FAR, STATUS = range(8)
"""Numbers of the buffers; those of inputs follow."""


class SearchState:
    """Addresses of all data of a running loop."""

    def __init__(self, search: Search, w: LlvmWriter, frame: int) -> None:
        self.s, self.w, self.frame = search, w, frame
        self.bytes = w.precision.bytes
        x, passed = search.program.outputs
        self.ports = [
            x,
            passed,
            search.program.inputs[-1],
            x,
            passed,
            passed,
            TensorSpec("far", (PLACES,)),
            search.status,
        ]
        self.ports += search.inputs
        self.samples = ""
        """Number of samples."""
        self.large = frame + sum(buffer_sizes(w, self.ports)) > ON_STACK

    # ── data ──

    def operands(self) -> None:
        """Load addresses and strides of arrays, and flags of contiguous rows."""
        w, ports = self.w, [*self.s.inputs, *self.s.outputs]
        self.bases: list[str] = []
        self.strides: list[Step] = []
        self.plain: list[str] = []
        following = len(ports)
        for k, port in enumerate(ports):
            self.bases.append(w.new(f"load ptr, ptr {w.gep('%args', 8 * k)}, align 8"))
            outer, inner = load_strides(w, k, following, len(port.shape))
            following += len(port.shape)
            self.strides.append((outer, inner))
            plain, expected = "true", self.bytes
            for length, stride in reversed(list(zip(port.shape, inner, strict=True))):
                plain = self.both(plain, f"icmp eq i64 {stride}, {expected}")
                expected *= length
            self.plain.append(plain)

    def room(self) -> str:
        """Allocate all buffers; returns the pointer to free."""
        w, taken = self.w, ""
        w.after = "entry"
        self.counts = w.new(f"alloca [{len(OF_SAMPLE + OF_LANE) * w.lanes} x i64], align {LINE}")
        self.queue, self.working, self.found = (w.new("alloca i64, align 8") for _ in range(3))
        self.frame_room = ""
        sizes = buffer_sizes(w, self.ports)
        self.least = w.new(f"alloca {w.element}, align 8")
        if self.large:
            first = len(self.s.inputs)
            shapes = [port.shape for port in self.s.outputs]
            results = list(zip(self.bases[first:], shapes, self.strides[first:], strict=True))
            taken, w.after, (*self.buffers, self.frame_room) = allocate(w, [*sizes, self.frame], self.samples, results)
        else:
            self.buffers = [w.new(f"alloca [{size} x i8], align {LINE}") for size in sizes]
            if self.frame:
                self.frame_room = w.new(f"alloca [{self.frame} x i8], align {LINE}")
        if self.frame:
            w.do(f"call void @prepare(ptr {self.frame_room})")
        return taken

    def tables(self) -> None:
        """Copy the settings and the table of starts to contiguous memory."""
        w = self.w
        found = []
        for k in range(2, len(self.s.inputs)):
            buffer = self.buffers[STATUS + 1 + k]
            with w.when(w.new(f"xor i1 {self.plain[k]}, true")):
                call_copy(w, "gather", buffer, self.bases[k], "1", self.s.inputs[k].shape, self.strides[k])
            found.append(w.new(f"select i1 {self.plain[k]}, ptr {self.bases[k]}, ptr {buffer}"))
        self.settings, self.places, self.reached = found
        self.most_times = w.new(f"fptosi {w.element} {self.number(self.settings, TIMES)} to i64")
        self.most_attempts = w.new(f"fptosi {w.element} {self.number(self.settings, ATTEMPTS)} to i64")

    # ── Data access ──

    def place(self, name: str, lane: str) -> str:
        """Address of a lane's integer."""
        names = OF_SAMPLE + OF_LANE
        first = self.w.gep(self.counts, names.index(name) * self.w.lanes * 8)
        return self.w.gep(first, self.w.new(f"mul i64 {lane}, 8"))

    def count(self, name: str, lane: str) -> str:
        """Value of a lane's integer."""
        return self.w.new(f"load i64, ptr {self.place(name, lane)}, align 8")

    def put(self, name: str, lane: str, value: str | int) -> None:
        """Set a lane's integer."""
        self.w.do(f"store i64 {value}, ptr {self.place(name, lane)}, align 8")

    def row(self, which: int, lane: str) -> str:
        """Address of a lane's row in a buffer."""
        return self.w.gep(self.buffers[which], self.w.new(f"mul i64 {lane}, {self.ports[which].size * self.bytes}"))

    def number(self, place: str, entry: int) -> str:
        """Load an entry of a row."""
        return self.w.new(f"load {self.w.element}, ptr {self.w.gep(place, entry * self.bytes)}, align {self.bytes}")

    def store(self, place: str, entry: int, value: str) -> None:
        """Store an entry of a row."""
        self.w.do(f"store {self.w.element} {value}, ptr {self.w.gep(place, entry * self.bytes)}, align {self.bytes}")

    def move(self, there: str, here: str, count: int, align: int = 0) -> None:
        """Copy ``count`` bytes."""
        align = align or self.bytes
        target, source = f"ptr align {align} {there}", f"ptr align {align} {here}"
        self.w.do(f"call void @llvm.memcpy.inline.p0.p0.i64({target}, {source}, i64 {count}, i1 false)")

    def clear(self, buffer: str, port: TensorSpec) -> None:
        """Fill a buffer with zeros."""
        w, size = self.w, self.w.lanes * self.bytes
        with w.loop(str(port.size), w.after) as k:
            w.do(f"store {w.vector} zeroinitializer, ptr {w.gep(buffer, w.new(f'mul i64 {k}, {size}'))}, align {size}")

    def either(self, condition: str, a: str | int, b: str | int) -> str:
        """Select one of two integers."""
        return self.w.new(f"select i1 {condition}, i64 {a}, i64 {b}")

    def both(self, *conditions: str) -> str:
        """Condition (i1): all conditions hold; each is a value, or an instruction that returns one."""
        holds = "true"
        for condition in conditions:
            is_instruction = " " in condition
            value = self.w.new(condition) if is_instruction else condition
            if holds != "true":
                value = self.w.new(f"and i1 {holds}, {value}")
            holds = value
        return holds

    def copied_in(self, k: int, there: str, sample: str) -> None:
        """Copy one sample of an input into a row."""
        w, port = self.w, self.s.inputs[k]
        here = w.gep(self.bases[k], w.new(f"mul i64 {sample}, {self.strides[k][0]}"))
        with w.when(self.plain[k]):
            self.move(there, here, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.plain[k]}, true")):
            call_copy(w, "gather", there, here, "1", port.shape, self.strides[k])

    def copied_out(self, k: int, here: str, sample: str) -> None:
        """Copy a row into one sample of a result."""
        w, port, number = self.w, self.s.outputs[k], len(self.s.inputs) + k
        there = w.gep(self.bases[number], w.new(f"mul i64 {sample}, {self.strides[number][0]}"))
        with w.when(self.plain[number]):
            self.move(there, here, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.plain[number]}, true")):
            call_copy(w, "scatter", here, there, "1", port.shape, self.strides[number])


# ── The loop of a search: every lane makes its own attempt, and begins another one when it has ended

# With many samples, each lane has its own sample and makes the attempts one after another. With few, all lanes make attempts
# for one sample in parallel. The result is the same: the first successful attempt in the order of starts; later attempts are
# abandoned, earlier ones completed. The function type is that of :mod:`.batch_loop`; settings and starts are those of the
# first sample.


def search_over(search: Search) -> Loop:
    """Return a writer of the search's loop around its program's blocks."""

    def write(name: str, _program: Program, precision: Precision, lanes: int, frame: int, _group: int) -> str:
        loop = _Attempts(search, LlvmWriter(precision, lanes), frame)
        loop.write()
        w = loop.w
        helpers = [copying("gather", precision, 1, inward=True), copying("scatter", precision, 1, inward=False)]
        if loop.large:
            helpers += [nan_filler(precision, lanes), MEMORY_DECLARATIONS]
        tables = [_table("begins", w, search.begins), _table("least", w, search.least), _table("most", w, search.most)]
        return "\n".join([*helpers, COPY_DECLARATION, *tables, *loop_function(name, w)])

    return write


def _table(name: str, w: LlvmWriter, numbers: tuple[float, ...]) -> str:
    entries = typed_list(w.element, map(w.number, numbers))
    return f"@{name} = internal constant [{len(numbers)} x {w.element}] [{entries}], align {LINE}"


class _Attempts(SearchState):
    """Writer of one loop."""

    def write(self) -> None:
        """Write the body of the loop function."""
        w, lanes = self.w, str(self.w.lanes)
        self.samples = w.new("load i64, ptr %dims, align 8")
        self.operands()
        taken = self.room()
        self.tables()
        few = w.new(f"icmp slt i64 {self.samples}, {w.lanes // 2}")
        self.own = self.either(few, 0, 1)
        if w.lanes > 1:
            for k in (X, PASSED, GIVEN):  # lanes without work compute, too
                self.clear(self.buffers[k], self.ports[k])
        with w.loop(lanes, w.after) as lane:
            for name, value in (
                ("sample", -1),
                ("next", NO_ATTEMPT),
                ("winner", NO_ATTEMPT),
                ("flying", 0),
                ("attempt", -1),
            ):
                self.put(name, lane, value)
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
        x, passed, given, moved, passed_on = self.buffers[:BEST]
        further = [self.frame_room] if self.frame else []
        call_block(w, [x, x, passed, given, moved, passed_on, *further])
        self.move(x, moved, buffer_size(w, self.ports[X]), LINE)
        self.move(passed, passed_on, buffer_size(w, self.ports[PASSED]), LINE)
        with w.loop(lanes, body) as lane:
            self._end(lane)
        w.do(f"br label %{head}")
        w.begin(found)
        if taken:
            w.do(f"call void @free(ptr {taken})")

    # ── attempts ──

    def _begin(self, lane: str) -> None:
        """Assign an attempt to an idle lane: of its sample, or of the next one if that is finished."""
        w = self.w
        with w.when(w.new(f"icmp slt i64 {self.count('attempt', lane)}, 0")):
            mine = w.new(f"mul i64 {lane}, {self.own}")
            none = w.new(f"icmp eq i64 {self.count('winner', mine)}, {NO_ATTEMPT}")
            more = self.both(none, f"icmp sle i64 {self.count('next', mine)}, {self.most_attempts}")
            idle = w.new(f"icmp eq i64 {self.count('flying', mine)}, 0")
            with w.when(self.both(f"xor i1 {more}, true", idle)):
                with w.when(w.new(f"icmp sge i64 {self.count('sample', mine)}, 0")):
                    self._report(mine)
                self._next_sample(mine)
            none = w.new(f"icmp eq i64 {self.count('winner', mine)}, {NO_ATTEMPT}")
            with w.when(self.both(none, f"icmp sle i64 {self.count('next', mine)}, {self.most_attempts}")):
                self._start(lane, mine)
        with w.when(w.new(f"icmp sge i64 {self.count('attempt', lane)}, 0")):
            w.do(f"store i64 1, ptr {self.working}, align 8")

    def _next_sample(self, mine: str) -> None:
        """Take the next sample, if there is one."""
        w = self.w
        sample = w.new(f"load i64, ptr {self.queue}, align 8")
        there = w.new(f"icmp slt i64 {sample}, {self.samples}")
        self.put("sample", mine, self.either(there, sample, -1))
        self.put("next", mine, self.either(there, 0, NO_ATTEMPT))
        self.put("winner", mine, NO_ATTEMPT)
        self.put("nearest", mine, NO_ATTEMPT)
        w.do(f"store i64 {self.either(there, w.new(f'add i64 {sample}, 1'), sample)}, ptr {self.queue}, align 8")

    def _start(self, lane: str, mine: str) -> None:
        """Begin the next attempt of a sample."""
        w = self.w
        sample, attempt = self.count("sample", mine), self.count("next", mine)
        self.put("attempt", lane, attempt)
        self.put("times", lane, 0)
        self.put("next", mine, w.new(f"add i64 {attempt}, 1"))
        self.put("flying", mine, w.new(f"add i64 {self.count('flying', mine)}, 1"))
        given, x, passed = self.row(GIVEN, lane), self.row(X, lane), self.row(PASSED, lane)
        self.copied_in(0, given, sample)
        size = self.s.target.size * self.bytes
        rest = self.ports[GIVEN].size * self.bytes - size
        self.move(w.gep(given, size), w.gep(self.settings, TOLERANCES * self.bytes), rest)
        with w.when(w.new(f"icmp eq i64 {attempt}, 0")):
            self.copied_in(1, x, sample)
            self._bring_inside(x)
        with w.when(w.new(f"icmp eq i64 {attempt}, 1")):
            self._distances(given, mine)
        with w.when(w.new(f"icmp sgt i64 {attempt}, 0")):
            nearest = self._nearest(mine)
            size = self.ports[X].size * self.bytes
            self.move(x, w.gep(self.places, w.new(f"mul i64 {nearest}, {size}")), size)
        size = self.ports[X].size * self.bytes
        self.move(passed, x, size)
        self.move(w.gep(passed, size), "@begins", len(self.s.begins) * self.bytes)

    def _bring_inside(self, x: str) -> None:
        """Clip the entries of x to their limits."""
        w, e = self.w, self.w.element
        with w.loop(str(self.s.x.size), w.after) as k:
            offset = w.new(f"mul i64 {k}, {self.bytes}")
            place = w.gep(x, offset)
            value = self.number(place, 0)
            for table, order in (("@least", "olt"), ("@most", "ogt")):
                bound = self.number(w.gep(table, offset), 0)
                beyond = w.new(f"fcmp {order} {e} {value}, {bound}")
                value = w.new(f"select i1 {beyond}, {e} {bound}, {e} {value}")
            self.store(place, 0, value)

    def _distances(self, target: str, mine: str) -> None:
        """Distances of the start configurations from the target."""
        w = self.w
        far, first = self.row(FAR, mine), TOLERANCES + self.ports[GIVEN].size - self.s.target.size
        pairs = []  # a target entry and its weight, each in every lane
        for number, entry in enumerate(self.s.near, start=first):
            wanted = f"{w.vector} {self._everywhere(self.number(target, entry))}"
            weight = f"{w.vector} {self._everywhere(self.number(self.settings, number))}"
            pairs.append((wanted, weight))
        with w.loop(str(PLACES // w.lanes), w.after) as k:
            offset, total = w.new(f"mul i64 {k}, {w.lanes * self.bytes}"), w.splat(0.0)
            for entry, (wanted, weight) in enumerate(pairs):
                place = w.gep(w.gep(self.reached, entry * PLACES * self.bytes), offset)
                gap = w.new(f"fsub {wanted}, {w.new(f'load {w.vector}, ptr {place}, align {self.bytes}')}")
                total = w.binary("fadd", total, w.new(f"fmul {weight}, {w.binary('fmul', gap, gap)}"))
            w.do(f"store {w.vector} {total}, ptr {w.gep(far, offset)}, align {self.bytes}")

    def _everywhere(self, number: str) -> str:
        w = self.w
        one = w.new(f"insertelement {w.vector} poison, {w.element} {number}, i32 0")
        return w.shuffle(one, one, [0] * w.lanes)

    def _nearest(self, mine: str) -> str:
        """Number of the nearest unused start configuration, which is marked as used."""
        w = self.w
        far = self.row(FAR, mine)
        found, least = self.found, self.least
        w.do(f"store i64 0, ptr {found}, align 8")
        w.do(f"store {w.element} {w.number(math.inf)}, ptr {least}, align 8")
        with w.loop(str(PLACES), w.after) as k:
            this = w.new(f"load {w.element}, ptr {w.gep(far, w.new(f'mul i64 {k}, {self.bytes}'))}, align {self.bytes}")
            before = w.new(f"load {w.element}, ptr {least}, align 8")
            nearer = w.new(f"fcmp olt {w.element} {this}, {before}")
            w.do(
                f"store {w.element} {w.new(f'select i1 {nearer}, {w.element} {this}, {w.element} {before}')}, ptr {least}"
            )
            w.do(f"store i64 {self.either(nearer, k, w.new(f'load i64, ptr {found}, align 8'))}, ptr {found}, align 8")
        nearest = w.new(f"load i64, ptr {found}, align 8")
        place = w.gep(far, w.new(f"mul i64 {nearest}, {self.bytes}"))
        w.do(f"store {w.element} {w.number(math.inf)}, ptr {place}, align {self.bytes}")
        return nearest

    def _end(self, lane: str) -> None:
        """Record the result of a lane's attempt if it has ended."""
        w = self.w
        attempt = self.count("attempt", lane)
        with w.when(w.new(f"icmp sge i64 {attempt}, 0")):
            mine = w.new(f"mul i64 {lane}, {self.own}")
            times = w.new(f"add i64 {self.count('times', lane)}, 1")
            self.put("times", lane, times)
            winner = self.count("winner", mine)
            late = w.new(f"icmp sgt i64 {attempt}, {winner}")
            passed = self.row(PASSED, lane)
            goes = self.number(passed, self.ports[PASSED].size - 1)
            goes = w.new(f"fcmp ogt {w.element} {goes}, {w.number(0.0)}")
            further = self.both(goes, f"icmp slt i64 {times}, {self.most_times}", f"xor i1 {late}, true")
            with w.when(w.new(f"xor i1 {further}, true")):
                self.put("attempt", lane, -1)
                self.put("flying", mine, w.new(f"sub i64 {self.count('flying', mine)}, 1"))
                with w.when(w.new(f"xor i1 {late}, true")):
                    self._compare(mine, attempt, passed)

    def _compare(self, mine: str, attempt: str, passed: str) -> None:
        """Keep the result of an attempt if it succeeded or is nearer than all others; ties go to the earlier attempt."""
        w = self.w
        there, cost = self.number(passed, self.s.x.size), self.number(passed, self.s.x.size + 1)
        ends = w.new(f"fcmp one {w.element} {there}, {w.number(0.0)}")
        self.put("winner", mine, self.either(ends, attempt, self.count("winner", mine)))
        best = self.row(BEST, mine)
        least, nearest = self.number(best, self.s.x.size + 1), self.count("nearest", mine)
        known = f"fcmp ord {w.element} {cost}, {cost}"
        nearer = self.both(known, f"fcmp ult {w.element} {cost}, {least}")  # or the best is NaN
        same = self.both(f"fcmp oeq {w.element} {cost}, {least}", f"icmp slt i64 {attempt}, {nearest}")
        first = w.new(f"icmp eq i64 {nearest}, {NO_ATTEMPT}")
        better = ends
        for one in (nearer, same, first):
            better = w.new(f"or i1 {better}, {one}")
        with w.when(better):
            self.put("nearest", mine, attempt)
            self.move(best, passed, self.ports[PASSED].size * self.bytes)

    def _report(self, mine: str) -> None:
        """Store the results of a sample."""
        w = self.w
        sample, winner, best = self.count("sample", mine), self.count("winner", mine), self.row(BEST, mine)
        none = w.new(f"icmp eq i64 {winner}, {NO_ATTEMPT}")
        starts = self.either(none, self.count("next", mine), w.new(f"add i64 {winner}, 1"))
        status = self.row(STATUS, mine)
        self.store(status, 0, w.new(f"sitofp i64 {starts} to {w.element}"))
        self.move(
            w.gep(status, self.bytes), w.gep(best, self.s.x.size * self.bytes), (self.s.status.size - 1) * self.bytes
        )
        self.copied_out(0, best, sample)
        self.copied_out(1, status, sample)
