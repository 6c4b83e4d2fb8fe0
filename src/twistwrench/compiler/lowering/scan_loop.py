"""The loop of a scan: for each block of samples, all steps in order.

The loop is a function of the type in :mod:`.batch_loop`. The state of a block stays in buffers from the first step to the last.
Inputs that are equal for all steps are copied once. States are stored once in several steps: a row of results belongs to
these steps and holds the states after the last of them.
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
"""Name of the constant with the rows of the scan's table. Each row stands once for every lane."""


def loop_over(recurrence: Scan) -> Loop:
    """Return a writer of the scan's loop around its program's blocks."""

    def write(name: str, _program: Program, precision: Precision, lanes: int, frame_bytes: int, _group: int) -> str:
        writer = _LoopWriter(recurrence, LlvmWriter(precision, lanes), frame_bytes)
        writer.write()
        gather = copying("gather", precision, lanes, inward=True)
        scatter = copying("scatter", precision, lanes, inward=False)
        helpers = [gather, scatter]
        if writer.is_on_heap:
            helpers += [nan_filler(precision, lanes), MEMORY_DECLARATIONS]
        table = _stage_table(recurrence, writer.w)
        return "\n".join([*helpers, COPY_DECLARATION, table, *loop_function(name, writer.w)])

    return write


def _stage_table(recurrence: Scan, w: LlvmWriter) -> str:
    """Constant with the scan's table, in which each number stands once for every lane; empty if the table has no numbers."""
    numbers: list[str] = []
    for row in recurrence.table:
        row_numbers = [w.number(x) for x in row]
        numbers += row_numbers * w.lanes  # lanes copies of the row, one after the other
    if not numbers:
        return ""
    array_type = f"[{len(numbers)} x {w.element}]"
    return f"@{TABLE} = internal constant {array_type} [{typed_list(w.element, numbers)}], align {LINE}"


class _Operand:
    """Array of the caller: address, shape and strides.

    Its first core axis has an entry for each step (inputs) or for each stored row (results). Initial states have no such axis.
    """

    def __init__(self, port: TensorSpec, base: str, sample_stride: str, strides: list[str], *, has_steps: bool) -> None:
        self.port = port
        self.base = base
        """Address of the first entry."""
        self.sample_stride = sample_stride
        self.strides = strides
        """Strides of all core axes."""
        self.step_stride = "0"
        """Stride of the axis of steps or rows; 0 if the array is equal for all steps."""
        self.entry_strides = strides
        """Strides of the other core axes."""
        if has_steps:
            self.step_stride, *self.entry_strides = strides

    def with_rows(self, row_count: str) -> tuple[str, list[int | str], Step]:
        """Address, shape and strides of a result with its axis of rows."""
        return self.base, [row_count, *self.port.shape], (self.sample_stride, self.strides)

    @property
    def strides_in_step(self) -> Step:
        """Strides of samples and entries within one step."""
        return self.sample_stride, self.entry_strides


class _LoopWriter:
    """Writer of one loop."""

    def __init__(self, recurrence: Scan, w: LlvmWriter, frame_bytes: int) -> None:
        self.r, self.w = recurrence, w
        self.frame_bytes = frame_bytes
        """Size of the frame in which the program's blocks keep values; 0 without a frame."""
        self.program = recurrence.program
        self.saved_states = sorted({source.state for source in recurrence.sources if source.kind == "start"})
        """Numbers of the states whose values at the beginning of a step are needed."""
        starts = [recurrence.states[j] for j in self.saved_states]
        step_inputs = [self.program.inputs[k] for k in recurrence.given]
        self.ports = [*recurrence.states, *starts, *step_inputs, *self.program.outputs]
        """Shapes of the buffers."""
        self.is_on_heap = frame_bytes + sum(buffer_sizes(w, self.ports)) > ON_STACK
        """True if the buffers do not fit on the stack."""

    def write(self) -> None:
        """Write the body of the loop function."""
        w, r = self.w, self.r
        samples = w.new("load i64, ptr %dims, align 8")
        operands = self._operands()
        inputs, outputs = operands[: len(r.inputs)], operands[len(r.inputs) :]
        row_count = self._axis_length(-1)  # of any result
        allocation, label = self._allocate(samples, outputs, row_count)
        if self.frame_bytes:
            w.do(f"call void @prepare(ptr {self.frame})")
        stores_nothing = w.new(f"icmp slt i64 {row_count}, 1")
        step_count = self._axis_length(len(r.inputs) - 1)  # of any input with steps
        divisor = w.new(f"select i1 {stores_nothing}, i64 1, i64 {row_count}")  # never zero
        steps_per_row = w.new(f"sdiv i64 {step_count}, {divisor}")
        with w.loop(w.blocks(samples), label) as block:
            first_sample = w.new(f"mul i64 {block}, {w.lanes}")
            self.sample_count, is_partial = w.share(samples, first_sample)
            self.is_whole_block = w.new(f"xor i1 {is_partial}, true")
            addresses = []  # of the block's first sample in each array
            for operand in operands:
                offset = w.new(f"mul i64 {first_sample}, {operand.sample_stride}")
                addresses.append(w.gep(operand.base, offset))
            for k, operand in enumerate(inputs[: r.visible]):
                self._copy("gather", self.state[k], addresses[k], operand)
            for k in range(r.visible, len(r.states)):  # hidden states start at zero
                self._clear(self.state[k], r.states[k])
            with w.loop(row_count, w.after) as row, w.loop(steps_per_row, w.after) as step_in_row:
                steps_before_row = w.new(f"mul i64 {row}, {steps_per_row}")
                step = w.new(f"add i64 {steps_before_row}, {step_in_row}")
                self._copy_step_inputs(step, addresses[r.visible : len(inputs)], inputs[r.visible :])
                begins_row = w.new(f"icmp eq i64 {step_in_row}, 0")
                next_step_in_row = w.new(f"add i64 {step_in_row}, 1")
                ends_row = w.new(f"icmp eq i64 {next_step_in_row}, {steps_per_row}")
                row_addresses = []  # of the results
                for address, operand in zip(addresses[len(inputs) :], outputs, strict=True):
                    offset = w.new(f"mul i64 {row}, {operand.step_stride}")
                    row_addresses.append(w.gep(address, offset))
                self._step(begins_row, row_addresses[r.visible :], outputs[r.visible :])
                with w.when(ends_row):
                    for k, operand in enumerate(outputs[: r.visible]):
                        self._copy("scatter", self.state[k], row_addresses[k], operand)
        if allocation:
            w.do(f"call void @free(ptr {allocation})")

    # ── data ──

    def _operands(self) -> list[_Operand]:
        """Arrays of the caller, inputs first."""
        w, r = self.w, self.r
        ports = [*r.inputs, *r.outputs]
        operands = []
        next_stride = len(ports)  # strides of core axes follow those of the batch axis of all arrays
        for k, port in enumerate(ports):
            has_steps = k >= r.visible  # all but the initial states
            pointer_address = w.gep("%args", 8 * k)  # pointers have 8 bytes
            base = w.new(f"load ptr, ptr {pointer_address}, align 8")
            axis_count = len(port.shape) + has_steps
            sample_stride, strides = load_strides(w, k, next_stride, axis_count)
            next_stride += axis_count
            operands.append(_Operand(port, base, sample_stride, strides, has_steps=has_steps))
        return operands

    def _axis_length(self, operand: int) -> str:
        """Length of the axis of steps or rows of an operand, given by its index."""
        axes = axes_of(self.r.signature)[operand]
        length_address = self.w.gep("%dims", 8 * axes[0])  # lengths have 8 bytes; steps or rows are the first axis
        return self.w.new(f"load i64, ptr {length_address}, align 8")

    def _allocate(self, samples: str, outputs: Sequence[_Operand], row_count: str) -> tuple[str, str]:
        """Allocate all buffers.

        Returns the pointer to free, which is empty for buffers on the stack, and the label of the current basic block.
        """
        w = self.w
        allocation, label = "", "entry"
        sizes = buffer_sizes(w, self.ports)
        self.frame = ""
        if self.is_on_heap:
            results = [operand.with_rows(row_count) for operand in outputs]
            allocation, label, (*buffers, self.frame) = allocate(w, [*sizes, self.frame_bytes], samples, results)
        else:
            buffers = [w.new(f"alloca [{size} x i8], align {LINE}") for size in sizes]
            if self.frame_bytes:
                self.frame = w.new(f"alloca [{self.frame_bytes} x i8], align {LINE}")
        next_buffer = iter(buffers)  # in the order of ``ports``; each line takes its share
        self.state = [next(next_buffer) for _ in self.r.states]
        self.start = {j: next(next_buffer) for j in self.saved_states}
        self.given = {k: next(next_buffer) for k in self.r.given}
        self.results = list(next_buffer)
        return allocation, label

    # ── steps ──

    def _copy_step_inputs(self, step: str, addresses: Sequence[str], operands: Sequence[_Operand]) -> None:
        """Copy the inputs of this step, unless they equal those of the previous step."""
        w = self.w
        is_first = w.new(f"icmp eq i64 {step}, 0")
        for buffer, address, operand in zip(self.given.values(), addresses, operands, strict=True):
            changes = w.new(f"icmp ne i64 {operand.step_stride}, 0")
            must_copy = w.new(f"or i1 {is_first}, {changes}")
            with w.when(must_copy):
                offset = w.new(f"mul i64 {step}, {operand.step_stride}")
                address_of_step = w.gep(address, offset)
                self._copy("gather", buffer, address_of_step, operand)

    def _step(self, begins_row: str, row_addresses: Sequence[str], reported: Sequence[_Operand]) -> None:
        """Evaluate the program once for each stage of a step; the first step of a row stores the reported results."""
        w, r = self.w, self.r
        for j, start in self.start.items():
            self._copy_buffer(start, self.state[j], r.states[j])
        frame = [self.frame] if self.frame_bytes else []
        for stage in range(len(r.table)):
            inputs = [self._input_address(k, stage) for k in range(len(r.sources))]
            call_block(w, [*inputs, *self.results, *frame])
            if stage == 0 and reported:
                with w.when(begins_row):
                    for k, address, operand in zip(r.reported, row_addresses, reported, strict=True):
                        self._copy("scatter", self.results[k], address, operand)
            # The first results are the new states. Further results stay in their buffers, so zip ends before them.
            for state, result, port in zip(self.state, self.results, r.states, strict=False):
                self._copy_buffer(state, result, port)

    def _input_address(self, k: int, stage: int) -> str:
        """Address of the program's input k in a stage."""
        source = self.r.sources[k]
        if source.kind == "given":
            return self.given[k]
        if source.kind == "stage":
            row_bytes = buffer_size(self.w, self.program.inputs[k])
            return self.w.gep(f"@{TABLE}", stage * row_bytes)
        if source.kind == "start":
            return self.start[source.state]
        return self.state[source.state]

    def _copy(self, which: str, buffer: str, address: str, operand: _Operand) -> None:
        """Copy a block of samples to a buffer ("gather") or from it ("scatter"), as :func:`.batch_loop.call_copy` does.

        If the block is whole and its samples are contiguous, the copy needs no call.
        """
        w, element_bytes = self.w, self.w.precision.bytes
        sample_bytes = operand.port.size * element_bytes
        needs_no_call = self.is_whole_block
        for stride in operand.entry_strides:
            is_contiguous = w.new(f"icmp eq i64 {stride}, {element_bytes}")
            needs_no_call = w.new(f"and i1 {needs_no_call}, {is_contiguous}")
        with w.when(needs_no_call):
            for lane in range(w.lanes):
                in_buffer = w.gep(buffer, lane * sample_bytes)
                sample_offset = w.new(f"mul i64 {operand.sample_stride}, {lane}")
                in_array = w.gep(address, sample_offset)
                target, source = (in_buffer, in_array) if which == "gather" else (in_array, in_buffer)
                self._copy_bytes(target, source, sample_bytes, element_bytes)
        needs_call = w.new(f"xor i1 {needs_no_call}, true")
        with w.when(needs_call):
            call_copy(w, which, buffer, address, self.sample_count, operand.port.shape, operand.strides_in_step)

    def _copy_buffer(self, target: str, source: str, port: TensorSpec) -> None:
        """Copy a whole buffer."""
        self._copy_bytes(target, source, buffer_size(self.w, port), LINE)

    def _copy_bytes(self, target: str, source: str, count: int, align: int) -> None:
        """Copy ``count`` bytes; ``align`` is the alignment of both addresses."""
        pointers = f"ptr align {align} {target}, ptr align {align} {source}"
        self.w.do(f"call void @llvm.memcpy.inline.p0.p0.i64({pointers}, i64 {count}, i1 false)")

    def _clear(self, buffer: str, port: TensorSpec) -> None:
        """Fill a buffer with zeros."""
        w = self.w
        vector_bytes = w.lanes * w.precision.bytes
        for k in range(port.size):
            address = w.gep(buffer, k * vector_bytes)
            w.do(f"store {w.vector} zeroinitializer, ptr {address}, align {vector_bytes}")
