"""The loop of a search: operands, buffers, integers of each lane, and attempts.

With many samples, each lane has its own sample and makes its attempts one after another. With few, all lanes make attempts
for one sample in parallel. The result is the same: the first successful attempt in the order of starts; later attempts are
abandoned, earlier ones completed. The function type is that of :mod:`.batch_loop`; settings and starts are those of the
first sample.
"""

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

OF_SAMPLE = ("sample", "next", "winner", "running", "nearest")
"""Integers of a sample: its number, its next attempt, the attempt that succeeded, the number of attempts that run, and the
attempt with the best result. They are stored for the sample's *owner*: its lane, or lane 0 if all lanes share a sample."""
OF_LANE = ("attempt", "times")
"""Integers of a lane: its attempt, -1 if it is idle, and the attempt's number of evaluations."""

X, PASSED, GIVEN, MOVED, PASSED_ON, BEST, FAR, STATUS = range(8)
"""Numbers of the buffers: x, memory and given target of the program, its next x and next memory, the best memory of a sample,
the distances of start configurations, and the status. Buffers of the kernel's inputs follow."""


class SearchState:
    """Addresses of all data of a running loop."""

    def __init__(self, search: Search, w: LlvmWriter, frame_bytes: int) -> None:
        self.s = search
        self.w = w
        self.frame_bytes = frame_bytes
        self.bytes = w.precision.bytes
        """Size of a number."""
        x, passed = search.program.outputs
        given = search.program.inputs[-1]  # target and tolerances
        far = TensorSpec("far", (PLACES,))
        self.ports = [x, passed, given, x, passed, passed, far, search.status, *search.inputs]
        """Shapes of the buffers, in the order of their numbers."""
        self.samples = ""
        """Number of samples, as a register."""
        self.is_large = frame_bytes + sum(buffer_sizes(w, self.ports)) > ON_STACK
        """True if the buffers do not fit on the stack."""

    # ── data ──

    def load_operands(self) -> None:
        """Load addresses and strides of arrays, and flags of contiguous rows."""
        w = self.w
        ports = [*self.s.inputs, *self.s.outputs]
        self.bases: list[str] = []
        self.strides: list[Step] = []
        self.contiguous: list[str] = []
        next_stride = len(ports)  # strides of core axes follow those of the batch axis of all arrays
        for k, port in enumerate(ports):
            self.bases.append(w.new(f"load ptr, ptr {w.gep('%args', 8 * k)}, align 8"))
            batch_stride, core_strides = load_strides(w, k, next_stride, len(port.shape))
            next_stride += len(port.shape)
            self.strides.append((batch_stride, core_strides))
            is_contiguous = "true"
            expected_stride = self.bytes
            for length, stride in zip(reversed(port.shape), reversed(core_strides), strict=True):  # the last axis first
                is_contiguous = self.all_of(is_contiguous, f"icmp eq i64 {stride}, {expected_stride}")
                expected_stride *= length
            self.contiguous.append(is_contiguous)

    def allocate_buffers(self) -> str:
        """Allocate all buffers; returns the pointer to free, an empty text if they are on the stack."""
        w = self.w
        allocation = ""
        w.after = "entry"
        self.counts = w.new(f"alloca [{len(OF_SAMPLE + OF_LANE) * w.lanes} x i64], align {LINE}")
        self.next_sample = w.new("alloca i64, align 8")
        self.any_working = w.new("alloca i64, align 8")  # 1 if a lane has an attempt
        self.nearest_start = w.new("alloca i64, align 8")  # number of a start configuration
        self.frame_pointer = ""
        sizes = buffer_sizes(w, self.ports)
        self.least_distance = w.new(f"alloca {w.element}, align 8")  # of the nearest start configuration
        if self.is_large:
            first_output = len(self.s.inputs)
            shapes = [port.shape for port in self.s.outputs]
            results = list(zip(self.bases[first_output:], shapes, self.strides[first_output:], strict=True))
            allocation, w.after, buffers = allocate(w, [*sizes, self.frame_bytes], self.samples, results)
            *self.buffers, self.frame_pointer = buffers
        else:
            self.buffers = [w.new(f"alloca [{size} x i8], align {LINE}") for size in sizes]
            if self.frame_bytes:
                self.frame_pointer = w.new(f"alloca [{self.frame_bytes} x i8], align {LINE}")
        if self.frame_bytes:
            w.do(f"call void @prepare(ptr {self.frame_pointer})")
        return allocation

    def copy_tables(self) -> None:
        """Copy the settings, the starts and their targets to contiguous memory, unless they are contiguous already."""
        w = self.w
        pointers = []
        for k in range(2, len(self.s.inputs)):  # without target and x, the first two inputs
            buffer = self.buffers[STATUS + 1 + k]  # buffers of inputs follow STATUS
            with w.when(w.new(f"xor i1 {self.contiguous[k]}, true")):
                call_copy(w, "gather", buffer, self.bases[k], "1", self.s.inputs[k].shape, self.strides[k])
            pointers.append(w.new(f"select i1 {self.contiguous[k]}, ptr {self.bases[k]}, ptr {buffer}"))
        self.settings, self.starts, self.start_targets = pointers
        self.max_times = w.new(f"fptosi {w.element} {self.load(self.settings, TIMES)} to i64")
        self.max_attempts = w.new(f"fptosi {w.element} {self.load(self.settings, ATTEMPTS)} to i64")

    # ── Data access ──

    def count_address(self, name: str, lane: str) -> str:
        """Address of an integer of a lane, by its name in OF_SAMPLE or OF_LANE."""
        names = OF_SAMPLE + OF_LANE
        first_lane = self.w.gep(self.counts, names.index(name) * self.w.lanes * 8)
        offset = self.w.new(f"mul i64 {lane}, 8")
        return self.w.gep(first_lane, offset)

    def load_count(self, name: str, lane: str) -> str:
        """Value of a lane's integer."""
        return self.w.new(f"load i64, ptr {self.count_address(name, lane)}, align 8")

    def store_count(self, name: str, lane: str, value: str | int) -> None:
        """Set a lane's integer."""
        self.w.do(f"store i64 {value}, ptr {self.count_address(name, lane)}, align 8")

    def row_address(self, buffer: int, lane: str) -> str:
        """Address of a lane's row in a buffer, given by its number."""
        offset = self.w.new(f"mul i64 {lane}, {self.ports[buffer].size * self.bytes}")
        return self.w.gep(self.buffers[buffer], offset)

    def load(self, row: str, entry: int) -> str:
        """Load an entry of a row."""
        address = self.w.gep(row, entry * self.bytes)
        return self.w.new(f"load {self.w.element}, ptr {address}, align {self.bytes}")

    def store(self, row: str, entry: int, value: str) -> None:
        """Store an entry of a row."""
        address = self.w.gep(row, entry * self.bytes)
        self.w.do(f"store {self.w.element} {value}, ptr {address}, align {self.bytes}")

    def copy(self, target: str, source: str, byte_count: int, align: int = 0) -> None:
        """Copy bytes; ``align`` is the alignment of both addresses, 0 for that of an element."""
        align = align or self.bytes
        pointers = f"ptr align {align} {target}, ptr align {align} {source}"
        self.w.do(f"call void @llvm.memcpy.inline.p0.p0.i64({pointers}, i64 {byte_count}, i1 false)")

    def clear(self, buffer: str, port: TensorSpec) -> None:
        """Fill a buffer with zeros."""
        w = self.w
        vector_bytes = w.lanes * self.bytes
        with w.loop(str(port.size), w.after) as k:
            address = w.gep(buffer, w.new(f"mul i64 {k}, {vector_bytes}"))
            w.do(f"store {w.vector} zeroinitializer, ptr {address}, align {vector_bytes}")

    def choose(self, condition: str, a: str | int, b: str | int) -> str:
        """Select one of two integers: a if the condition holds, else b."""
        return self.w.new(f"select i1 {condition}, i64 {a}, i64 {b}")

    def all_of(self, *conditions: str) -> str:
        """Condition (i1) that holds if all conditions hold; each is a value, or the text of an instruction that yields one."""
        all_so_far = "true"
        for condition in conditions:
            is_instruction = " " in condition
            value = self.w.new(condition) if is_instruction else condition
            if all_so_far != "true":
                value = self.w.new(f"and i1 {all_so_far}, {value}")
            all_so_far = value
        return all_so_far

    def copy_in(self, k: int, row: str, sample: str) -> None:
        """Copy one sample of input k into a row."""
        w = self.w
        port = self.s.inputs[k]
        batch_stride, _ = self.strides[k]
        source = w.gep(self.bases[k], w.new(f"mul i64 {sample}, {batch_stride}"))
        with w.when(self.contiguous[k]):
            self.copy(row, source, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.contiguous[k]}, true")):
            call_copy(w, "gather", row, source, "1", port.shape, self.strides[k])

    def copy_out(self, k: int, row: str, sample: str) -> None:
        """Copy a row into one sample of result k."""
        w = self.w
        port = self.s.outputs[k]
        operand = len(self.s.inputs) + k
        batch_stride, _ = self.strides[operand]
        target = w.gep(self.bases[operand], w.new(f"mul i64 {sample}, {batch_stride}"))
        with w.when(self.contiguous[operand]):
            self.copy(target, row, port.size * self.bytes)
        with w.when(w.new(f"xor i1 {self.contiguous[operand]}, true")):
            call_copy(w, "scatter", row, target, "1", port.shape, self.strides[operand])


def search_over(search: Search) -> Loop:
    """Return a writer of the search's loop around its program's blocks."""

    def write(name: str, _program: Program, precision: Precision, lanes: int, frame_bytes: int, _group: int) -> str:
        loop = _SearchLoop(search, LlvmWriter(precision, lanes), frame_bytes)
        loop.write()
        w = loop.w
        helpers = [copying("gather", precision, 1, inward=True), copying("scatter", precision, 1, inward=False)]
        if loop.is_large:
            helpers += [nan_filler(precision, lanes), MEMORY_DECLARATIONS]
        tables = [_table("begins", w, search.begins), _table("least", w, search.least), _table("most", w, search.most)]
        return "\n".join([*helpers, COPY_DECLARATION, *tables, *loop_function(name, w)])

    return write


def _table(name: str, w: LlvmWriter, numbers: tuple[float, ...]) -> str:
    """Constant array of numbers."""
    entries = typed_list(w.element, map(w.number, numbers))
    return f"@{name} = internal constant [{len(numbers)} x {w.element}] [{entries}], align {LINE}"


class _SearchLoop(SearchState):
    """Writer of one loop: every lane makes an attempt, and begins another one when it has ended."""

    def write(self) -> None:
        """Write the body of the loop function."""
        w = self.w
        lanes = str(self.w.lanes)
        self.samples = w.new("load i64, ptr %dims, align 8")
        self.load_operands()
        allocation = self.allocate_buffers()
        self.copy_tables()
        are_few = w.new(f"icmp slt i64 {self.samples}, {w.lanes // 2}")
        self.owner_step = self.choose(are_few, 0, 1)  # 0 if all lanes share a sample: its owner is lane 0
        if w.lanes > 1:
            for k in (X, PASSED, GIVEN):  # idle lanes compute too, with zeros
                self.clear(self.buffers[k], self.ports[k])
        initial_values = {"sample": -1, "next": NO_ATTEMPT, "winner": NO_ATTEMPT, "running": 0, "attempt": -1}
        with w.loop(lanes, w.after) as lane:
            for name, value in initial_values.items():
                self.store_count(name, lane, value)
        w.do(f"store i64 0, ptr {self.next_sample}, align 8")
        search_label, step_label, end_label = w.label("search"), w.label("step"), w.label("found")
        w.do(f"br label %{search_label}")
        w.begin(search_label)
        w.do(f"store i64 0, ptr {self.any_working}, align 8")
        with w.loop(lanes, search_label) as lane:
            self._begin(lane)
        working_flag = w.new(f"load i64, ptr {self.any_working}, align 8")
        is_working = w.new(f"icmp sgt i64 {working_flag}, 0")
        w.do(f"br i1 {is_working}, label %{step_label}, label %{end_label}")
        w.begin(step_label)
        x, passed, given, moved, passed_on = self.buffers[:BEST]
        frame_argument = [self.frame_pointer] if self.frame_bytes else []
        call_block(w, [x, x, passed, given, moved, passed_on, *frame_argument])  # the program has x as two inputs
        self.copy(x, moved, buffer_size(w, self.ports[X]), LINE)
        self.copy(passed, passed_on, buffer_size(w, self.ports[PASSED]), LINE)
        with w.loop(lanes, step_label) as lane:
            self._end(lane)
        w.do(f"br label %{search_label}")
        w.begin(end_label)
        if allocation:
            w.do(f"call void @free(ptr {allocation})")

    # ── attempts ──

    def _begin(self, lane: str) -> None:
        """Assign an attempt to an idle lane: for its sample, or for the next sample if its own is finished.

        A sample is finished if no attempt remains and none runs.
        """
        w = self.w
        with w.when(w.new(f"icmp slt i64 {self.load_count('attempt', lane)}, 0")):
            owner = w.new(f"mul i64 {lane}, {self.owner_step}")
            no_winner = w.new(f"icmp eq i64 {self.load_count('winner', owner)}, {NO_ATTEMPT}")
            continues = self.all_of(no_winner, f"icmp sle i64 {self.load_count('next', owner)}, {self.max_attempts}")
            none_runs = w.new(f"icmp eq i64 {self.load_count('running', owner)}, 0")
            with w.when(self.all_of(f"xor i1 {continues}, true", none_runs)):
                with w.when(w.new(f"icmp sge i64 {self.load_count('sample', owner)}, 0")):
                    self._report(owner)
                self._next_sample(owner)
            # The integers of the owner may have changed.
            no_winner = w.new(f"icmp eq i64 {self.load_count('winner', owner)}, {NO_ATTEMPT}")
            with w.when(self.all_of(no_winner, f"icmp sle i64 {self.load_count('next', owner)}, {self.max_attempts}")):
                self._start(lane, owner)
        with w.when(w.new(f"icmp sge i64 {self.load_count('attempt', lane)}, 0")):
            w.do(f"store i64 1, ptr {self.any_working}, align 8")

    def _next_sample(self, owner: str) -> None:
        """Take the next sample, if there is one."""
        w = self.w
        sample = w.new(f"load i64, ptr {self.next_sample}, align 8")
        exists = w.new(f"icmp slt i64 {sample}, {self.samples}")
        self.store_count("sample", owner, self.choose(exists, sample, -1))
        self.store_count("next", owner, self.choose(exists, 0, NO_ATTEMPT))
        self.store_count("winner", owner, NO_ATTEMPT)
        self.store_count("nearest", owner, NO_ATTEMPT)
        sample_after = self.choose(exists, w.new(f"add i64 {sample}, 1"), sample)
        w.do(f"store i64 {sample_after}, ptr {self.next_sample}, align 8")

    def _start(self, lane: str, owner: str) -> None:
        """Begin the next attempt of a sample: attempt 0 at the start of the caller, others at the nearest unused start."""
        w = self.w
        sample = self.load_count("sample", owner)
        attempt = self.load_count("next", owner)
        self.store_count("attempt", lane, attempt)
        self.store_count("times", lane, 0)
        self.store_count("next", owner, w.new(f"add i64 {attempt}, 1"))
        running = self.load_count("running", owner)
        self.store_count("running", owner, w.new(f"add i64 {running}, 1"))
        given = self.row_address(GIVEN, lane)
        x = self.row_address(X, lane)
        passed = self.row_address(PASSED, lane)
        self.copy_in(0, given, sample)  # input 0 is the target
        target_bytes = self.s.target.size * self.bytes
        tolerance_bytes = self.ports[GIVEN].size * self.bytes - target_bytes
        self.copy(w.gep(given, target_bytes), w.gep(self.settings, TOLERANCES * self.bytes), tolerance_bytes)
        with w.when(w.new(f"icmp eq i64 {attempt}, 0")):
            self.copy_in(1, x, sample)  # input 1 is the caller's start
            self._bring_inside(x)
        with w.when(w.new(f"icmp eq i64 {attempt}, 1")):
            self._compute_distances(given, owner)
        x_bytes = self.ports[X].size * self.bytes
        with w.when(w.new(f"icmp sgt i64 {attempt}, 0")):
            nearest = self._take_nearest_start(owner)
            self.copy(x, w.gep(self.starts, w.new(f"mul i64 {nearest}, {x_bytes}")), x_bytes)
        self.copy(passed, x, x_bytes)
        self.copy(w.gep(passed, x_bytes), "@begins", len(self.s.begins) * self.bytes)

    def _bring_inside(self, x: str) -> None:
        """Clip the entries of x to their limits."""
        w = self.w
        number_type = w.element
        with w.loop(str(self.s.x.size), w.after) as k:
            offset = w.new(f"mul i64 {k}, {self.bytes}")
            entry = w.gep(x, offset)
            value = self.load(entry, 0)
            for table, comparison in (("@least", "olt"), ("@most", "ogt")):
                bound = self.load(w.gep(table, offset), 0)
                is_beyond = w.new(f"fcmp {comparison} {number_type} {value}, {bound}")
                value = w.new(f"select i1 {is_beyond}, {number_type} {bound}, {number_type} {value}")
            self.store(entry, 0, value)

    def _compute_distances(self, target: str, owner: str) -> None:
        """Store the distances of the start configurations from the target, Σ weight (target entry - entry of the start)².

        Each vector holds the distances of as many starts as there are lanes.
        """
        w = self.w
        distances = self.row_address(FAR, owner)
        first_weight = TOLERANCES + self.ports[GIVEN].size - self.s.target.size  # in the settings, after the tolerances
        entries_and_weights = []  # of the target, each in every lane
        for position, entry in enumerate(self.s.near, start=first_weight):
            target_entry = f"{w.vector} {self._in_all_lanes(self.load(target, entry))}"
            weight = f"{w.vector} {self._in_all_lanes(self.load(self.settings, position))}"
            entries_and_weights.append((target_entry, weight))
        with w.loop(str(PLACES // w.lanes), w.after) as k:
            offset = w.new(f"mul i64 {k}, {w.lanes * self.bytes}")
            total = w.splat(0.0)
            for entry, (target_entry, weight) in enumerate(entries_and_weights):
                address = w.gep(w.gep(self.start_targets, entry * PLACES * self.bytes), offset)
                start_entry = w.new(f"load {w.vector}, ptr {address}, align {self.bytes}")
                difference = w.new(f"fsub {target_entry}, {start_entry}")
                square = w.binary("fmul", difference, difference)
                total = w.binary("fadd", total, w.new(f"fmul {weight}, {square}"))
            w.do(f"store {w.vector} {total}, ptr {w.gep(distances, offset)}, align {self.bytes}")

    def _in_all_lanes(self, number: str) -> str:
        """Vector with a number in every lane."""
        w = self.w
        in_lane_0 = w.new(f"insertelement {w.vector} poison, {w.element} {number}, i32 0")
        return w.shuffle(in_lane_0, in_lane_0, [0] * w.lanes)

    def _take_nearest_start(self, owner: str) -> str:
        """Number of the nearest unused start configuration; an infinite distance then marks it as used."""
        w = self.w
        distances = self.row_address(FAR, owner)
        nearest_start, least_distance = self.nearest_start, self.least_distance
        w.do(f"store i64 0, ptr {nearest_start}, align 8")
        w.do(f"store {w.element} {w.number(math.inf)}, ptr {least_distance}, align 8")
        with w.loop(str(PLACES), w.after) as k:
            address = w.gep(distances, w.new(f"mul i64 {k}, {self.bytes}"))
            distance = w.new(f"load {w.element}, ptr {address}, align {self.bytes}")
            least_before = w.new(f"load {w.element}, ptr {least_distance}, align 8")
            is_nearer = w.new(f"fcmp olt {w.element} {distance}, {least_before}")
            new_least = w.new(f"select i1 {is_nearer}, {w.element} {distance}, {w.element} {least_before}")
            w.do(f"store {w.element} {new_least}, ptr {least_distance}")
            nearest_before = w.new(f"load i64, ptr {nearest_start}, align 8")
            w.do(f"store i64 {self.choose(is_nearer, k, nearest_before)}, ptr {nearest_start}, align 8")
        nearest = w.new(f"load i64, ptr {nearest_start}, align 8")
        address = w.gep(distances, w.new(f"mul i64 {nearest}, {self.bytes}"))
        w.do(f"store {w.element} {w.number(math.inf)}, ptr {address}, align {self.bytes}")
        return nearest

    def _end(self, lane: str) -> None:
        """Record the result of a lane's attempt if it has ended, or is abandoned because an earlier one succeeded."""
        w = self.w
        attempt = self.load_count("attempt", lane)
        with w.when(w.new(f"icmp sge i64 {attempt}, 0")):
            owner = w.new(f"mul i64 {lane}, {self.owner_step}")
            times = w.new(f"add i64 {self.load_count('times', lane)}, 1")
            self.store_count("times", lane, times)
            winner = self.load_count("winner", owner)
            after_winner = w.new(f"icmp sgt i64 {attempt}, {winner}")  # an earlier attempt succeeded
            passed = self.row_address(PASSED, lane)
            continue_flag = self.load(passed, self.ports[PASSED].size - 1)  # the last entry of the memory
            program_continues = w.new(f"fcmp ogt {w.element} {continue_flag}, {w.number(0.0)}")
            continues = self.all_of(
                program_continues, f"icmp slt i64 {times}, {self.max_times}", f"xor i1 {after_winner}, true"
            )
            with w.when(w.new(f"xor i1 {continues}, true")):
                self.store_count("attempt", lane, -1)
                running = self.load_count("running", owner)
                self.store_count("running", owner, w.new(f"sub i64 {running}, 1"))
                with w.when(w.new(f"xor i1 {after_winner}, true")):
                    self._compare(owner, attempt, passed)

    def _compare(self, owner: str, attempt: str, passed: str) -> None:
        """Keep the result of an attempt if it succeeded or is nearer than all others; ties go to the earlier attempt."""
        w = self.w
        status = self.load(passed, self.s.x.size)  # the memory has x, the status and the error
        error = self.load(passed, self.s.x.size + 1)
        is_decided = w.new(f"fcmp one {w.element} {status}, {w.number(0.0)}")  # found, or the target is invalid
        winner = self.load_count("winner", owner)
        self.store_count("winner", owner, self.choose(is_decided, attempt, winner))
        best = self.row_address(BEST, owner)
        least_error = self.load(best, self.s.x.size + 1)
        nearest = self.load_count("nearest", owner)
        is_number = f"fcmp ord {w.element} {error}, {error}"
        is_nearer = self.all_of(is_number, f"fcmp ult {w.element} {error}, {least_error}")  # or the best is NaN
        wins_tie = self.all_of(f"fcmp oeq {w.element} {error}, {least_error}", f"icmp slt i64 {attempt}, {nearest}")
        is_first = w.new(f"icmp eq i64 {nearest}, {NO_ATTEMPT}")
        is_better = is_decided
        for reason in (is_nearer, wins_tie, is_first):
            is_better = w.new(f"or i1 {is_better}, {reason}")
        with w.when(is_better):
            self.store_count("nearest", owner, attempt)
            self.copy(best, passed, self.ports[PASSED].size * self.bytes)

    def _report(self, owner: str) -> None:
        """Store the results of a sample: the best x, and the status with the number of attempts."""
        w = self.w
        sample = self.load_count("sample", owner)
        winner = self.load_count("winner", owner)
        best = self.row_address(BEST, owner)
        no_winner = w.new(f"icmp eq i64 {winner}, {NO_ATTEMPT}")
        attempts = self.choose(no_winner, self.load_count("next", owner), w.new(f"add i64 {winner}, 1"))
        status = self.row_address(STATUS, owner)
        self.store(status, 0, w.new(f"sitofp i64 {attempts} to {w.element}"))
        report_size = self.s.status.size - 1  # the first entry, the number of attempts, is stored already
        report_bytes = report_size * self.bytes
        self.copy(w.gep(status, self.bytes), w.gep(best, self.s.x.size * self.bytes), report_bytes)
        self.copy_out(0, best, sample)  # result 0 is x
        self.copy_out(1, status, sample)
