"""The loop of a scan: for each block of samples, all steps in order.

The function type is that of :mod:`.batch_loop`. The state of a block stays in buffers from the first step to the last. Inputs
that are equal for all steps are copied once, and rows of results are stored at the end of their step.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.loops import Scan
from ..ir.program import Program, TensorSpec, axes_of
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

TABLE = "stages"
"""Name of the constant with the rows of the scan's table, each repeated for every lane."""


def loop_over(recurrence: Scan) -> Loop:
    """Return a writer of the scan's loop around its program's blocks."""

    def write(name: str, _program: Program, precision: Precision, lanes: int, frame: int, _group: int) -> str:
        loop = _Steps(recurrence, LlvmWriter(precision, lanes), frame)
        loop.write()
        helpers = [copying("gather", precision, lanes, inward=True), copying("scatter", precision, lanes, inward=False)]
        if loop.large:
            helpers += [nan_filler(precision, lanes), MEMORY_DECLARATIONS]
        return "\n".join([*helpers, COPY_DECLARATION, _table(recurrence, loop.w), *loop_function(name, loop.w)])

    return write


def _table(recurrence: Scan, w: LlvmWriter) -> str:
    numbers: list[str] = []
    for row in recurrence.table:
        numbers += [w.number(x) for x in row] * w.lanes
    if not numbers:
        return ""
    kind = f"[{len(numbers)} x {w.element}]"
    return f"@{TABLE} = internal constant {kind} [{typed_list(w.element, numbers)}], align {LINE}"


class _Operand:
    """Array of the caller: address, shape and strides, and the stride of its step axis if it has one."""

    def __init__(self, port: TensorSpec, base: str, outer: str, inner: list[str], *, stepped: bool) -> None:
        self.port, self.base, self.outer = port, base, outer
        self.strides = inner
        self.along, self.inner = "0", inner
        if stepped:
            self.along, *self.inner = inner

    def with_rows(self, rows: str) -> tuple[str, list[int | str], Step]:
        """Address, shape and strides of a result with its axis of ``rows``."""
        return self.base, [rows, *self.port.shape], (self.outer, self.strides)

    @property
    def step(self) -> Step:
        """Strides of the samples of one step."""
        return self.outer, self.inner


class _Steps:
    """Writer of one loop."""

    def __init__(self, recurrence: Scan, w: LlvmWriter, frame: int) -> None:
        self.r, self.w, self.frame = recurrence, w, frame
        self.program = recurrence.program
        self.starts = sorted({s.state for s in recurrence.sources if s.kind == "start"})
        starts = [recurrence.states[j] for j in self.starts]
        given = [self.program.inputs[k] for k in recurrence.given]
        self.ports = [*recurrence.states, *starts, *given, *self.program.outputs]
        self.large = frame + sum(buffer_sizes(w, self.ports)) > ON_STACK

    def write(self) -> None:
        """Write the body of the loop function."""
        w, r = self.w, self.r
        samples = w.new("load i64, ptr %dims, align 8")
        operands = self._operands()
        inputs, outputs = operands[: len(r.inputs)], operands[len(r.inputs) :]
        kept = self._size(-1)
        taken, label = self._places(samples, outputs, kept)
        if self.frame:
            w.do(f"call void @prepare(ptr {self.room})")
        none = w.new(f"icmp slt i64 {kept}, 1")
        every = w.new(f"sdiv i64 {self._size(len(r.inputs) - 1)}, {w.new(f'select i1 {none}, i64 1, i64 {kept}')}")
        with w.loop(w.blocks(samples), label) as block:
            first = w.new(f"mul i64 {block}, {w.lanes}")
            self.count, short = w.share(samples, first)
            self.whole = w.new(f"xor i1 {short}, true")
            places = [w.gep(x.base, w.new(f"mul i64 {first}, {x.outer}")) for x in operands]
            for k, operand in enumerate(inputs[: r.visible]):
                self._copy("gather", self.state[k], places[k], operand)
            for k in range(r.visible, len(r.states)):
                self._clear(self.state[k], r.states[k])
            with w.loop(kept, w.after) as row, w.loop(every, w.after) as between:
                number = w.new(f"add i64 {w.new(f'mul i64 {row}, {every}')}, {between}")
                self._take_given(number, places[r.visible : len(inputs)], inputs[r.visible :])
                begins = w.new(f"icmp eq i64 {between}, 0")
                ends = w.new(f"icmp eq i64 {w.new(f'add i64 {between}, 1')}, {every}")
                rows = []
                for place, operand in zip(places[len(inputs) :], outputs, strict=True):
                    rows.append(w.gep(place, w.new(f"mul i64 {row}, {operand.along}")))
                self._step(begins, rows[r.visible :], outputs[r.visible :])
                with w.when(ends):
                    for k, operand in enumerate(outputs[: r.visible]):
                        self._copy("scatter", self.state[k], rows[k], operand)
        if taken:
            w.do(f"call void @free(ptr {taken})")

    # ── data ──

    def _operands(self) -> list[_Operand]:
        w, r = self.w, self.r
        ports = [*r.inputs, *r.outputs]
        operands, following = [], len(ports)
        for k, port in enumerate(ports):
            has_steps = k >= r.visible  # all but the initial states
            base = w.new(f"load ptr, ptr {w.gep('%args', 8 * k)}, align 8")
            axes = len(port.shape) + has_steps
            outer, inner = load_strides(w, k, following, axes)
            following += axes
            operands.append(_Operand(port, base, outer, inner, stepped=has_steps))
        return operands

    def _size(self, operand: int) -> str:
        """Length of an operand's step or row axis."""
        place = axes_of(self.r.signature)[operand][0]
        return self.w.new(f"load i64, ptr {self.w.gep('%dims', 8 * place)}, align 8")

    def _places(self, samples: str, outputs: Sequence[_Operand], kept: str) -> tuple[str, str]:
        """Allocate all buffers; returns the pointer to free, and the current label."""
        w, taken, label = self.w, "", "entry"
        sizes = buffer_sizes(w, self.ports)
        self.room = ""
        if self.large:
            results = [x.with_rows(kept) for x in outputs]
            taken, label, (*buffers, self.room) = allocate(w, [*sizes, self.frame], samples, results)
        else:
            buffers = [w.new(f"alloca [{size} x i8], align {LINE}") for size in sizes]
            if self.frame:
                self.room = w.new(f"alloca [{self.frame} x i8], align {LINE}")
        states, starts = len(self.r.states), len(self.starts)
        given = len(self.r.given)
        self.state, buffers = buffers[:states], buffers[states:]
        self.start, buffers = dict(zip(self.starts, buffers[:starts], strict=True)), buffers[starts:]
        self.given, self.results = dict(zip(self.r.given, buffers[:given], strict=True)), buffers[given:]
        return taken, label

    # ── steps ──

    def _take_given(self, number: str, places: Sequence[str], operands: Sequence[_Operand]) -> None:
        """Copy the inputs of this step, unless they equal those of the previous step."""
        w = self.w
        first = w.new(f"icmp eq i64 {number}, 0")
        for buffer, place, operand in zip(self.given.values(), places, operands, strict=True):
            changes = w.new(f"icmp ne i64 {operand.along}, 0")
            with w.when(w.new(f"or i1 {first}, {changes}")):
                here = w.gep(place, w.new(f"mul i64 {number}, {operand.along}"))
                self._copy("gather", buffer, here, operand)

    def _step(self, begins: str, rows: Sequence[str], reported: Sequence[_Operand]) -> None:
        """Evaluate the program once for each stage of a step."""
        w, r = self.w, self.r
        for j, start in self.start.items():
            self._move(start, self.state[j], r.states[j])
        further = [self.room] if self.frame else []
        for stage in range(len(r.table)):
            inputs = [self._input(k, stage) for k in range(len(r.sources))]
            call_block(w, [*inputs, *self.results, *further])
            if stage == 0 and reported:
                with w.when(begins):
                    for k, row, operand in zip(r.reported, rows, reported, strict=True):
                        self._copy("scatter", self.results[k], row, operand)
            for state, result, port in zip(self.state, self.results, r.states, strict=False):
                self._move(state, result, port)

    def _input(self, k: int, stage: int) -> str:
        source = self.r.sources[k]
        if source.kind == "given":
            return self.given[k]
        if source.kind == "stage":
            row = buffer_size(self.w, self.program.inputs[k])
            return self.w.gep(f"@{TABLE}", stage * row)
        if source.kind == "start":
            return self.start[source.state]
        return self.state[source.state]

    def _copy(self, which: str, buffer: str, place: str, operand: _Operand) -> None:
        """Copy like :func:`.batch_loop.call_copy`, but without a call if rows are contiguous and complete."""
        w, size = self.w, self.w.precision.bytes
        plain = self.whole
        for stride in operand.inner:
            plain = w.new(f"and i1 {plain}, {w.new(f'icmp eq i64 {stride}, {size}')}")
        with w.when(plain):
            for lane in range(w.lanes):
                near = w.gep(buffer, lane * operand.port.size * size)
                far = w.gep(place, w.new(f"mul i64 {operand.outer}, {lane}"))
                target, source = (near, far) if which == "gather" else (far, near)
                self._bytes(target, source, operand.port.size * size, size)
        with w.when(w.new(f"xor i1 {plain}, true")):
            call_copy(w, which, buffer, place, self.count, operand.port.shape, operand.step)

    def _move(self, there: str, here: str, port: TensorSpec) -> None:
        self._bytes(there, here, buffer_size(self.w, port), LINE)

    def _bytes(self, there: str, here: str, count: int, align: int) -> None:
        target, source = f"ptr align {align} {there}", f"ptr align {align} {here}"
        self.w.do(f"call void @llvm.memcpy.inline.p0.p0.i64({target}, {source}, i64 {count}, i1 false)")

    def _clear(self, buffer: str, port: TensorSpec) -> None:
        w = self.w
        for k in range(port.size):
            place = w.gep(buffer, k * w.lanes * w.precision.bytes)
            w.do(f"store {w.vector} zeroinitializer, ptr {place}, align {w.lanes * w.precision.bytes}")
