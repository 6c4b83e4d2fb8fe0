"""The batch loop: blocks of samples in place or through buffers, and copies between buffers and arrays of any strides.

Buffers are on the stack; those of large programs are allocated by each call, because a thread's stack may be small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ..ir.program import Program, TensorSpec
from .ir_builder import LlvmWriter, typed_list
from .target_machine import Precision

Step = tuple[str, list[str]]
"""Distance from one sample to the next, and strides of the axes within a sample [bytes]; texts of registers or numbers."""

RANK = 3
"""Maximum number of axes of an array for one sample."""

ON_STACK = 16_000
"""Maximum size of buffers and frame on the stack [bytes]: a thread may have a stack of only 64 kB."""

LINE = 64
"""Size of a cache line [bytes], to which buffers are aligned."""


def call_arrays(w: LlvmWriter, ports: Sequence[TensorSpec]) -> tuple[str, list[str], list[Step]]:
    """Load the number of samples, and addresses and strides of the arrays of a call of the loop."""
    samples = w.new("load i64, ptr %dims, align 8")
    bases = [w.new(f"load ptr, ptr {w.gep('%args', 8 * k)}, align 8") for k in range(len(ports))]
    strides = []
    next_stride = len(ports)  # strides of core axes follow those of the batch axis of all arrays
    for k, port in enumerate(ports):
        axis_count = len(port.shape)
        strides.append(load_strides(w, k, next_stride, axis_count))
        next_stride += axis_count
    return samples, bases, strides


def load_strides(w: LlvmWriter, operand: int, first_core_entry: int, axis_count: int) -> Step:
    """Load the strides of an operand; its strides within a sample begin at ``first_core_entry`` of ``%steps``."""
    batch_stride = w.new(f"load i64, ptr {w.gep('%steps', 8 * operand)}, align 8")
    entries = range(first_core_entry, first_core_entry + axis_count)
    core_strides = [w.new(f"load i64, ptr {w.gep('%steps', 8 * entry)}, align 8") for entry in entries]
    return batch_stride, core_strides


def buffer_size(w: LlvmWriter, port: TensorSpec) -> int:
    """Size of a buffer for a block of samples of an array [bytes]; at least one number per sample."""
    return max(port.size, 1) * w.lanes * w.precision.bytes


def buffer_sizes(w: LlvmWriter, ports: Sequence[TensorSpec]) -> list[int]:
    """Size of the buffer of each array [bytes]."""
    return [buffer_size(w, port) for port in ports]


def call_block(w: LlvmWriter, pointers: Sequence[str], name: str = "block") -> None:
    """Write a call of ``@block``, or of another function of pointers."""
    w.do(f"call void @{name}({typed_list('ptr', pointers)})")


def allocate(
    w: LlvmWriter, sizes: list[int], samples: str, outputs: Sequence[tuple[str, Sequence[int | str], Step]]
) -> tuple[str, str, list[str]]:
    """Allocate buffers, aligned to cache lines; returns the pointer to free, the current label, and the buffers.

    ``outputs`` has addresses, shapes and strides of the results. If malloc fails, the results are filled with NaN.
    """
    padded_sizes = [-(-size // LINE) * LINE for size in sizes]  # whole cache lines
    allocation = w.new(f"call ptr @malloc(i64 {sum(padded_sizes) + LINE})")
    failed_label, label = w.labels("nomemory", "memory")
    has_failed = w.new(f"icmp eq ptr {allocation}, null")
    w.do(f"br i1 {has_failed}, label %{failed_label}, label %{label}")
    w.begin(failed_label)
    for address, shape, step in outputs:
        w.do(f"call void @fill_nan(ptr {address}, i64 {samples}, {_axis_arguments(shape, step)})")
    w.do("ret void")
    w.begin(label)
    integer = w.new(f"ptrtoint ptr {allocation} to i64")
    within_first_line = w.new(f"add i64 {integer}, {LINE - 1}")
    aligned = w.new(f"and i64 {within_first_line}, {-LINE}")  # rounded up to a whole line
    start = w.new(f"inttoptr i64 {aligned} to ptr")
    offsets = [sum(padded_sizes[:k]) for k in range(len(padded_sizes))]
    buffers = [w.gep(start, offset) for offset in offsets]
    return allocation, label, buffers


def call_copy(
    w: LlvmWriter, function: str, buffer: str, address: str, count: str, shape: Sequence[int | str], step: Step
) -> None:
    """Write a call of ``gather`` or ``scatter`` for a buffer, and ``count`` samples of an array at ``address``."""
    w.do(f"call void @{function}(ptr {buffer}, ptr {address}, i64 {count}, {_axis_arguments(shape, step)})")


def _axis_arguments(shape: Sequence[int | str], step: Step) -> str:
    """Arguments of ``@gather``, ``@scatter`` and ``@fill_nan``: distance between samples, length and stride of three axes."""
    batch_stride, core_strides = step
    missing_axes = RANK - len(shape)
    lengths = [1] * missing_axes + list(shape)
    strides = ["0"] * missing_axes + core_strides
    axes = ", ".join(f"i64 {length}, i64 {stride}" for length, stride in zip(lengths, strides, strict=True))
    return f"i64 {batch_stride}, {axes}"


def copying(name: str, precision: Precision, lanes: int, *, inward: bool) -> str:
    """Text of a function that copies samples with three axes, between an array at ``%place`` and a packed buffer.

    ``gather`` copies into the buffer (``inward``), and pads it to a whole block. ``scatter`` copies out of the buffer.
    """
    w = LlvmWriter(precision, lanes)
    word = f"i{precision.bits}"  # numbers are copied as integers
    line_count = w.new("mul i64 %n0, %n1")
    sample_size = w.new(f"mul i64 {line_count}, %n2")  # number of elements
    sample_bytes = w.new(f"mul i64 {sample_size}, {precision.bytes}")
    with w.loop("%count", "entry") as row:
        in_array = w.gep("%place", w.new(f"mul i64 {row}, %outer"))
        in_buffer = w.gep("%buffer", w.new(f"mul i64 {row}, {sample_bytes}"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j:
            lines_before = w.new(f"mul i64 {i}, %n1")
            line = w.new(f"add i64 {lines_before}, {j}")
            elements_before = w.new(f"mul i64 {line}, %n2")
            line_in_buffer = w.gep(in_buffer, w.new(f"mul i64 {elements_before}, {precision.bytes}"))
            plane_in_array = w.gep(in_array, w.new(f"mul i64 {i}, %s0"))
            line_in_array = w.gep(plane_in_array, w.new(f"mul i64 {j}, %s1"))
            with w.loop("%n2", w.after) as k:  # the only work per element: it dominates a single call
                source = w.gep(line_in_buffer, w.new(f"mul i64 {k}, {precision.bytes}"))
                target = w.gep(line_in_array, w.new(f"mul i64 {k}, %s2"))
                if inward:
                    source, target = target, source
                value = w.new(f"load {word}, ptr {source}, align {precision.bytes}")
                w.do(f"store {word} {value}, ptr {target}, align {precision.bytes}")
    if inward:
        _pad(w, word, sample_size, sample_bytes)
    arguments = "ptr %buffer, ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @{name}({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def _pad(w: LlvmWriter, word: str, sample_size: str, sample_bytes: str) -> None:
    """Repeat the last sample in the remaining rows of a buffer."""
    last_row = w.new("sub i64 %count, 1")
    last_sample = w.gep("%buffer", w.new(f"mul i64 {last_row}, {sample_bytes}"))
    missing_rows = w.new(f"sub i64 {w.lanes}, %count")
    with w.loop(sample_size, w.after) as k:
        source = w.gep(last_sample, w.new(f"mul i64 {k}, {w.precision.bytes}"))
        value = w.new(f"load {word}, ptr {source}, align {w.precision.bytes}")
        with w.loop(missing_rows, w.after) as row:
            rows_after_last = w.new(f"add i64 {row}, 1")
            target = w.gep(source, w.new(f"mul i64 {rows_after_last}, {sample_bytes}"))
            w.do(f"store {word} {value}, ptr {target}, align {w.precision.bytes}")


def streaming(precision: Precision, lanes: int) -> str:
    """Text of ``stream``, which copies ``count`` vectors of a packed buffer to an aligned address, bypassing the caches."""
    w = LlvmWriter(precision, lanes)
    vector_bytes = lanes * precision.bytes
    with w.loop("%count", "entry") as k:
        offset = w.new(f"mul i64 {k}, {vector_bytes}")
        vector = w.new(f"load {w.vector}, ptr {w.gep('%buffer', offset)}, align {vector_bytes}")
        target = w.gep("%place", offset)
        w.do(f"store {w.vector} {vector}, ptr {target}, align {vector_bytes}, !nontemporal !{{i32 1}}")
    body = "\n".join(w.lines)
    arguments = "ptr %buffer, ptr %place, i64 %count"
    return f"define internal void @stream({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def nan_filler(precision: Precision, lanes: int) -> str:
    """Text of ``fill_nan``, which writes NaN into every entry of samples with three axes."""
    w = LlvmWriter(precision, lanes)
    with w.loop("%count", "entry") as row:
        sample = w.gep("%place", w.new(f"mul i64 {row}, %outer"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j, w.loop("%n2", w.after) as k:
            offset_0 = w.new(f"mul i64 {i}, %s0")
            offset_1 = w.new(f"mul i64 {j}, %s1")
            line_offset = w.new(f"add i64 {offset_0}, {offset_1}")
            offset_2 = w.new(f"mul i64 {k}, %s2")
            offset = w.new(f"add i64 {line_offset}, {offset_2}")
            nan = w.number(math.nan)
            w.do(f"store {w.element} {nan}, ptr {w.gep(sample, offset)}, align {precision.bytes}")
    arguments = "ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @fill_nan({arguments}) noinline cold {{\nentry:\n{body}\n  ret void\n}}\n"


# ── The loop that NumPy calls: blocks of whole rows in place, all others through a small buffer

# ``void loop(char **args, intp *dims, intp *steps, void *data)`` is the type of a gufunc's inner loop. ``dims[0]`` is the
# number of samples. ``steps`` has the distance between samples of each operand, then the distances within a sample. If all
# operands are contiguous rows, the block reads and writes them in place. Operands with other strides, broadcast operands and
# the last rows are copied through buffers of one block. There, the last row is repeated in place of missing rows, because its
# numbers set no floating-point flag that is not set anyway. Large results bypass the caches: they are computed in a buffer of
# one block, and written in whole vectors.

Loop = Callable[[str, Program, Precision, int, int, int], str]
"""Function that writes the loop around blocks; its arguments are those of :func:`loop`."""

BEYOND_CACHES = 1 << 24
"""Size of results [bytes] above which they bypass the caches. Otherwise they would remove large programs from the caches."""


MEMORY_DECLARATIONS = "declare ptr @malloc(i64)\ndeclare void @free(ptr)\n"
COPY_DECLARATION = "declare void @llvm.memcpy.inline.p0.p0.i64(ptr, ptr, i64 immarg, i1 immarg)"

SHORTEST_PIECE = 16
"""Minimum size of a store that bypasses the caches [bytes]."""
SHORTEST_ROW = 256
"""Minimum size of a sample's results for which such stores are faster [bytes]."""


def loop(name: str, program: Program, precision: Precision, lanes: int, frame: int = 0, group: int = 1) -> str:
    """Assembly of the loop function and its copying helpers.

    If ``frame`` > 0, the block has another argument, a frame of that many bytes, which ``@prepare`` fills once per call. If
    ``group`` > 1, a call of ``@blocks`` processes that many blocks of rows in place.
    """
    ports = [*program.inputs, *program.outputs]
    w = LlvmWriter(precision, lanes)
    is_large = frame + sum(buffer_sizes(w, ports)) > ON_STACK
    result_row_bytes = precision.bytes * sum(port.size for port in program.outputs)
    vector_bytes = lanes * precision.bytes
    piece = 0  # size of a store that bypasses the caches [bytes]; 0 if none does
    if result_row_bytes >= SHORTEST_ROW and vector_bytes >= SHORTEST_PIECE and group == 1:
        piece = vector_bytes
    _write_body(w, ports, len(program.inputs), frame, is_large, group, piece)
    helpers = [copying("gather", precision, lanes, inward=True), copying("scatter", precision, lanes, inward=False)]
    if piece:
        helpers.append(streaming(precision, lanes))
    if is_large:
        helpers += [nan_filler(precision, lanes), MEMORY_DECLARATIONS]
    return "\n".join([*helpers, *loop_function(name, w)])


def loop_function(name: str, w: LlvmWriter) -> list[str]:
    """Lines of the function that NumPy calls, around the writer's lines."""
    return [f"define void @{name}(ptr %args, ptr %dims, ptr %steps, ptr %data) {{\nentry:", *w.lines, "  ret void\n}\n"]


def _write_body(
    w: LlvmWriter, ports: list[TensorSpec], inputs: int, frame: int, is_large: bool, group: int, piece: int
) -> None:
    """Write the body of the loop function; ``inputs`` is the number of inputs, which are the first of the arrays ``ports``.

    ``piece`` is the size of a store that bypasses the caches [bytes], 0 if none does.
    """
    samples, bases, strides = call_arrays(w, ports)
    label, allocation = "entry", ""  # current label; pointer to free, empty if the buffers are on the stack
    if is_large:
        results = [(bases[k], ports[k].shape, strides[k]) for k in range(inputs, len(ports))]
        sizes = [*buffer_sizes(w, ports), frame]
        allocation, label, (*buffers, frame_pointer) = allocate(w, sizes, samples, results)
    else:
        *buffers, frame_pointer = _buffers_on_stack(w, ports, frame)
    frame_argument: list[str] = []  # the frame, if there is one, is the last argument of blocks
    if frame:
        frame_argument = [frame_pointer]
        w.do(f"call void @prepare(ptr {frame_pointer})")
    are_contiguous = [_is_contiguous(w, port, step) for port, step in zip(ports, strides, strict=True)]
    all_contiguous = _all_true(w, are_contiguous)
    whole_blocks = w.new(f"sdiv i64 {samples}, {w.lanes}")
    blocks_in_place = w.new(f"select i1 {all_contiguous}, i64 {whole_blocks}, i64 0")
    addresses = bases  # of the samples after the blocks that are done
    remaining_blocks = blocks_in_place
    if piece:
        outputs = list(zip(bases[inputs:], ports[inputs:], strict=True))
        can_stream = _can_stream(w, samples, outputs, piece)
        streamed_blocks = w.new(f"select i1 {can_stream}, i64 {blocks_in_place}, i64 0")
        label = _stream_blocks(w, ports, bases, streamed_blocks, label, buffers[inputs:], frame_argument)
        addresses = _addresses_after(w, ports, bases, streamed_blocks, 1)
        remaining_blocks = w.new(f"sub i64 {blocks_in_place}, {streamed_blocks}")
    if group > 1:
        groups = w.new(f"sdiv i64 {blocks_in_place}, {group}")
        label = _blocks_in_place(w, ports, bases, groups, label, frame_argument, group)
        addresses = _addresses_after(w, ports, bases, groups, group)
        blocks_in_groups = w.new(f"mul i64 {groups}, {group}")
        remaining_blocks = w.new(f"sub i64 {blocks_in_place}, {blocks_in_groups}")
    _blocks_in_place(w, ports, addresses, remaining_blocks, label, frame_argument)
    # All other samples, which are copied where an array is not contiguous or the block is not whole.
    done_samples = w.new(f"mul i64 {blocks_in_place}, {w.lanes}")
    remaining_samples = w.new(f"sub i64 {samples}, {done_samples}")
    with w.loop(w.blocks(remaining_samples), w.after) as block:
        samples_before = w.new(f"mul i64 {block}, {w.lanes}")
        first_sample = w.new(f"add i64 {done_samples}, {samples_before}")
        count, is_partial = w.share(samples, first_sample)
        is_whole = w.new(f"xor i1 {is_partial}, true")
        is_later_block = w.new(f"icmp sgt i64 {block}, 0")
        rows, pointers, are_copied = [], [], []  # for each array: first row in it, pointer for the block, condition
        for k, (batch_stride, _) in enumerate(strides):
            rows.append(w.gep(bases[k], w.new(f"mul i64 {first_sample}, {batch_stride}")))
            in_place = w.new(f"and i1 {are_contiguous[k]}, {is_whole}")
            pointers.append(w.new(f"select i1 {in_place}, ptr {rows[k]}, ptr {buffers[k]}"))
            are_copied.append(w.new(f"xor i1 {in_place}, true"))
        for k in range(inputs):
            is_missing = _is_missing_in_buffer(w, strides[k], is_later_block)
            with w.when(w.new(f"and i1 {are_copied[k]}, {is_missing}")):
                call_copy(w, "gather", buffers[k], rows[k], count, ports[k].shape, strides[k])
        call_block(w, [*pointers, *frame_argument])
        for k in range(inputs, len(ports)):
            with w.when(are_copied[k]):
                call_copy(w, "scatter", buffers[k], rows[k], count, ports[k].shape, strides[k])
    if allocation:
        w.do(f"call void @free(ptr {allocation})")


def _buffers_on_stack(w: LlvmWriter, ports: list[TensorSpec], frame: int) -> list[str]:
    """Allocate buffers on the stack: of each array, then the frame; an empty text without a frame."""
    buffers = [w.new(f"alloca [{max(port.size, 1) * w.lanes} x {w.element}], align {LINE}") for port in ports]
    if frame == 0:
        return [*buffers, ""]
    return [*buffers, w.new(f"alloca [{frame} x i8], align {LINE}")]


def _can_stream(w: LlvmWriter, samples: str, outputs: list[tuple[str, TensorSpec]], piece: int) -> str:
    """Condition (i1): results exceed the caches, and addresses and blocks of all results are multiples of ``piece`` bytes."""
    result_row_bytes = 0
    for _, port in outputs:
        sample_bytes = port.size * w.precision.bytes
        if w.lanes * sample_bytes % piece:
            return "false"
        result_row_bytes += sample_bytes
    can_stream = w.new(f"icmp sgt i64 {samples}, {BEYOND_CACHES // result_row_bytes}")
    for base, _ in outputs:
        address = w.new(f"ptrtoint ptr {base} to i64")
        misalignment = w.new(f"and i64 {address}, {piece - 1}")
        is_aligned = w.new(f"icmp eq i64 {misalignment}, 0")
        can_stream = w.new(f"and i1 {can_stream}, {is_aligned}")
    return can_stream


def _stream_blocks(
    w: LlvmWriter,
    ports: list[TensorSpec],
    bases: list[str],
    count: str,
    label: str,
    buffers: list[str],
    frame_argument: list[str],
) -> str:
    """Evaluate ``count`` blocks, with inputs in place and results through buffers; returns the current label."""
    input_count = len(ports) - len(buffers)
    with w.loop(count, label) as k:
        addresses = _addresses_after(w, ports, bases, k, 1)
        call_block(w, [*addresses[:input_count], *buffers, *frame_argument])
        for buffer, address, port in zip(buffers, addresses[input_count:], ports[input_count:], strict=True):
            w.do(f"call void @stream(ptr {buffer}, ptr {address}, i64 {port.size})")
    with w.when(w.new(f"icmp sgt i64 {count}, 0")):
        w.do("fence seq_cst")  # orders the nontemporal writes for other threads
    return w.after


def _addresses_after(w: LlvmWriter, ports: list[TensorSpec], bases: list[str], count: str, group: int) -> list[str]:
    """Addresses in the arrays after ``count`` groups of ``group`` blocks."""
    bytes_per_entry = group * w.lanes * w.precision.bytes  # in all samples of a group
    addresses = []
    for base, port in zip(bases, ports, strict=True):
        offset = w.new(f"mul i64 {count}, {port.size * bytes_per_entry}")
        addresses.append(w.gep(base, offset))
    return addresses


def _blocks_in_place(
    w: LlvmWriter,
    ports: list[TensorSpec],
    bases: list[str],
    count: str,
    label: str,
    frame_argument: list[str],
    group: int = 1,
) -> str:
    """Call ``count`` blocks, or groups of blocks, on the arrays themselves; returns the current label."""
    function = "block" if group == 1 else "blocks"
    with w.loop(count, label) as k:
        call_block(w, [*_addresses_after(w, ports, bases, k, group), *frame_argument], function)
    return w.after


def _all_true(w: LlvmWriter, conditions: list[str]) -> str:
    """Condition (i1): all conditions hold; at least one is given."""
    all_true = conditions[0]
    for condition in conditions[1:]:
        all_true = w.new(f"and i1 {all_true}, {condition}")
    return all_true


def _is_missing_in_buffer(w: LlvmWriter, step: Step, is_later_block: str) -> str:
    """Condition (i1): a sample is not in the buffer yet. A sample that all rows share is copied in the first block only."""
    batch_stride, _ = step
    is_shared = w.new(f"icmp eq i64 {batch_stride}, 0")
    is_in_buffer = w.new(f"and i1 {is_later_block}, {is_shared}")
    return w.new(f"xor i1 {is_in_buffer}, true")


def _is_contiguous(w: LlvmWriter, port: TensorSpec, step: Step) -> str:
    """Condition (i1): the samples of an array are adjacent and in C order."""
    batch_stride, core_strides = step
    lengths = [*reversed(port.shape), 1]
    strides = [*reversed(core_strides), batch_stride]
    expected_stride = w.precision.bytes
    all_expected = ""  # condition for the axes up to here
    for length, stride in zip(lengths, strides, strict=True):
        is_expected = w.new(f"icmp eq i64 {stride}, {expected_stride}")
        if all_expected:
            is_expected = w.new(f"and i1 {all_expected}, {is_expected}")
        all_expected = is_expected
        expected_stride *= length
    return all_expected
