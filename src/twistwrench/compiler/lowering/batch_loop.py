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
"""Distance between samples, and distances within a sample, axis by axis [bytes]."""

RANK = 3
"""Maximum number of axes of an array for one sample."""

ON_STACK = 16_000
"""Maximum size of buffers and frame on the stack [bytes]: a thread may have a stack of only 64 kB."""

LINE = 64
"""Size of a cache line [bytes], to which buffers are aligned."""


def call_arrays(w: LlvmWriter, ports: Sequence[TensorSpec]) -> tuple[str, list[str], list[Step]]:
    """Number of samples, addresses and strides of a call of the loop."""
    samples = w.new("load i64, ptr %dims, align 8")
    bases = [w.new(f"load ptr, ptr {w.gep('%args', 8 * k)}, align 8") for k in range(len(ports))]
    strides = []
    next_stride = len(ports)  # strides of core axes follow those of the batch axis of all arrays
    for k, port in enumerate(ports):
        axis_count = len(port.shape)
        strides.append(load_strides(w, k, next_stride, axis_count))
        next_stride += axis_count
    return samples, bases, strides


def load_strides(w: LlvmWriter, operand: int, first_inner: int, axis_count: int) -> Step:
    """Distance between samples of an operand, and distances within a sample, which begin at entry ``first_inner``."""
    outer = w.new(f"load i64, ptr {w.gep('%steps', 8 * operand)}, align 8")
    entries = range(first_inner, first_inner + axis_count)
    inner = [w.new(f"load i64, ptr {w.gep('%steps', 8 * entry)}, align 8") for entry in entries]
    return outer, inner


def buffer_size(w: LlvmWriter, port: TensorSpec) -> int:
    """Size of a block of samples of an array [bytes]."""
    return max(port.size, 1) * w.lanes * w.precision.bytes


def buffer_sizes(w: LlvmWriter, ports: Sequence[TensorSpec]) -> list[int]:
    """Size of a block of samples of each array [bytes]."""
    return [buffer_size(w, port) for port in ports]


def call_block(w: LlvmWriter, pointers: Sequence[str], name: str = "block") -> None:
    """Call ``@block``, or another function of pointers."""
    w.do(f"call void @{name}({typed_list('ptr', pointers)})")


def allocate(
    w: LlvmWriter, sizes: list[int], samples: str, outputs: Sequence[tuple[str, Sequence[int | str], Step]]
) -> tuple[str, str, list[str]]:
    """Allocate buffers, aligned to cache lines; returns the pointer to free, the current label, and the buffers.

    If malloc fails, the results, whose addresses, shapes and strides are ``outputs``, are filled with NaN.
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
    beyond = w.new(f"add i64 {integer}, {LINE - 1}")
    aligned = w.new(f"and i64 {beyond}, {-LINE}")
    start = w.new(f"inttoptr i64 {aligned} to ptr")
    return allocation, label, [w.gep(start, sum(padded_sizes[:k])) for k in range(len(padded_sizes))]


def call_copy(
    w: LlvmWriter, which: str, buffer: str, address: str, count: str, shape: Sequence[int | str], step: Step
) -> None:
    """Call ``@gather`` or ``@scatter`` for a buffer, and ``count`` samples of an array at ``address``."""
    w.do(f"call void @{which}(ptr {buffer}, ptr {address}, i64 {count}, {_axis_arguments(shape, step)})")


def _axis_arguments(shape: Sequence[int | str], step: Step) -> str:
    """Arguments of ``@gather`` and others: the distance between samples, then length and stride of each of three axes."""
    outer, inner = step
    lengths = [1] * (RANK - len(shape)) + list(shape)
    strides = ["0"] * (RANK - len(shape)) + inner
    axes = ", ".join(f"i64 {length}, i64 {stride}" for length, stride in zip(lengths, strides, strict=True))
    return f"i64 {outer}, {axes}"


def copying(name: str, precision: Precision, lanes: int, *, inward: bool) -> str:
    """Function that copies samples with three axes: ``gather`` (``inward``) into a packed buffer, ``scatter`` out of one.

    ``gather`` pads the buffer to a whole block.
    """
    w = LlvmWriter(precision, lanes)
    word = f"i{precision.bits}"
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
    """Repeat the last sample in the remaining rows of the block."""
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
    """Function ``stream`` that copies ``count`` vectors of a packed buffer to an aligned address, bypassing the caches."""
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
    """Function ``fill_nan`` that writes NaN into every entry of samples with three axes."""
    w = LlvmWriter(precision, lanes)
    with w.loop("%count", "entry") as row:
        sample = w.gep("%place", w.new(f"mul i64 {row}, %outer"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j, w.loop("%n2", w.after) as k:
            offset_0 = w.new(f"mul i64 {i}, %s0")
            offset_1 = w.new(f"mul i64 {j}, %s1")
            offset = w.new(f"add i64 {offset_0}, {offset_1}")
            offset_2 = w.new(f"mul i64 {k}, %s2")
            offset = w.new(f"add i64 {offset}, {offset_2}")
            nan = w.number(math.nan)
            w.do(f"store {w.element} {nan}, ptr {w.gep(sample, offset)}, align {precision.bytes}")
    arguments = "ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @fill_nan({arguments}) noinline cold {{\nentry:\n{body}\n  ret void\n}}\n"


# ── The loop that NumPy calls: blocks of whole rows in place, all others through a small buffer

# ``void loop(char **args, intp *dims, intp *steps, void *data)`` is the type of a gufunc's inner loop. ``dims[0]`` is the
# number of samples. ``steps`` has the distance between samples of each operand, then the distances within a sample. If all
# operands are contiguous rows, the block reads and writes them in place. Operands with other strides, broadcast operands and
# the last rows are copied through buffers of one block. In these, the last row stands in place of missing ones, because its
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
    large = frame + sum(buffer_sizes(w, ports)) > ON_STACK
    result_row_bytes = precision.bytes * sum(port.size for port in program.outputs)
    vector_bytes = lanes * precision.bytes
    piece = 0  # size of a store that bypasses the caches [bytes]; 0 if none does
    if result_row_bytes >= SHORTEST_ROW and vector_bytes >= SHORTEST_PIECE and group == 1:
        piece = vector_bytes
    _body(w, ports, len(program.inputs), frame, large, group, piece)
    helpers = [copying("gather", precision, lanes, inward=True), copying("scatter", precision, lanes, inward=False)]
    if piece:
        helpers.append(streaming(precision, lanes))
    if large:
        helpers += [nan_filler(precision, lanes), MEMORY_DECLARATIONS]
    return "\n".join([*helpers, *loop_function(name, w)])


def loop_function(name: str, w: LlvmWriter) -> list[str]:
    """Lines of the function that NumPy calls, around the writer's lines."""
    return [f"define void @{name}(ptr %args, ptr %dims, ptr %steps, ptr %data) {{\nentry:", *w.lines, "  ret void\n}\n"]


def _body(w: LlvmWriter, ports: list[TensorSpec], inputs: int, frame: int, large: bool, group: int, piece: int) -> None:
    """Write the body of the loop function; ``inputs`` is the number of inputs among the arrays ``ports``."""
    samples, bases, strides = call_arrays(w, ports)
    allocation, label = "", "entry"
    if large:
        results = [(bases[k], ports[k].shape, strides[k]) for k in range(inputs, len(ports))]
        allocation, label, (*buffers, room) = allocate(w, [*buffer_sizes(w, ports), frame], samples, results)
    else:
        *buffers, room = _buffers_on_stack(w, ports, frame)
    frame_argument: list[str] = []  # the frame, if there is one, is the last argument of blocks
    if frame:
        frame_argument = [room]
        w.do(f"call void @prepare(ptr {room})")
    are_contiguous = [_is_contiguous(w, port, *strides[k]) for k, port in enumerate(ports)]
    all_contiguous = are_contiguous[0]
    for is_contiguous in are_contiguous[1:]:
        all_contiguous = w.new(f"and i1 {all_contiguous}, {is_contiguous}")
    whole_blocks = w.new(f"sdiv i64 {samples}, {w.lanes}")
    blocks_in_place = w.new(f"select i1 {all_contiguous}, i64 {whole_blocks}, i64 0")
    outputs = list(zip(bases, ports, strict=True))[inputs:]
    addresses, remaining_blocks = bases, blocks_in_place
    if piece:
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
        first = w.new(f"add i64 {done_samples}, {samples_before}")
        count, is_partial = w.share(samples, first)
        is_whole = w.new(f"xor i1 {is_partial}, true")
        is_later = w.new(f"icmp sgt i64 {block}, 0")
        rows, pointers, are_copied = [], [], []
        for k in range(len(ports)):
            rows.append(w.gep(bases[k], w.new(f"mul i64 {first}, {strides[k][0]}")))
            in_place = w.new(f"and i1 {are_contiguous[k]}, {is_whole}")
            pointers.append(w.new(f"select i1 {in_place}, ptr {rows[k]}, ptr {buffers[k]}"))
            are_copied.append(w.new(f"xor i1 {in_place}, true"))
        for k in range(inputs):  # a sample that all rows share is copied in the first block only
            is_shared = w.new(f"icmp eq i64 {strides[k][0]}, 0")
            is_in_buffer = w.new(f"and i1 {is_later}, {is_shared}")
            is_missing = w.new(f"xor i1 {is_in_buffer}, true")
            with w.when(w.new(f"and i1 {are_copied[k]}, {is_missing}")):
                call_copy(w, "gather", buffers[k], rows[k], count, ports[k].shape, strides[k])
        call_block(w, [*pointers, *frame_argument])
        for k in range(inputs, len(ports)):
            with w.when(are_copied[k]):
                call_copy(w, "scatter", buffers[k], rows[k], count, ports[k].shape, strides[k])
    if allocation:
        w.do(f"call void @free(ptr {allocation})")


def _buffers_on_stack(w: LlvmWriter, ports: list[TensorSpec], frame: int) -> list[str]:
    """Buffers for a block of samples of each array, then for the frame; the latter is empty without one."""
    buffers = [w.new(f"alloca [{max(port.size, 1) * w.lanes} x {w.element}], align 64") for port in ports]
    if frame == 0:
        return [*buffers, ""]
    return [*buffers, w.new(f"alloca [{frame} x i8], align {LINE}")]


def _can_stream(w: LlvmWriter, samples: str, outputs: list[tuple[str, TensorSpec]], piece: int) -> str:
    """Condition (i1): results exceed the caches, and the addresses and blocks of all are multiples of ``piece`` bytes."""
    result_row_bytes = 0
    for _, port in outputs:
        sample_bytes = port.size * w.precision.bytes
        if w.lanes * sample_bytes % piece:
            return "false"
        result_row_bytes += sample_bytes
    streams = w.new(f"icmp sgt i64 {samples}, {BEYOND_CACHES // result_row_bytes}")
    for base, _ in outputs:
        address = w.new(f"ptrtoint ptr {base} to i64")
        misalignment = w.new(f"and i64 {address}, {piece - 1}")
        is_aligned = w.new(f"icmp eq i64 {misalignment}, 0")
        streams = w.new(f"and i1 {streams}, {is_aligned}")
    return streams


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
    inputs = len(ports) - len(buffers)
    with w.loop(count, label) as k:
        addresses = _addresses_after(w, ports, bases, k, 1)
        call_block(w, [*addresses[:inputs], *buffers, *frame_argument])
        for buffer, address, port in zip(buffers, addresses[inputs:], ports[inputs:], strict=True):
            w.do(f"call void @stream(ptr {buffer}, ptr {address}, i64 {port.size})")
    with w.when(w.new(f"icmp sgt i64 {count}, 0")):
        w.do("fence seq_cst")  # orders the nontemporal writes for other threads
    return w.after


def _addresses_after(w: LlvmWriter, ports: list[TensorSpec], bases: list[str], count: str, group: int) -> list[str]:
    """Addresses in the arrays after ``count`` groups of blocks."""
    column_bytes = group * w.lanes * w.precision.bytes  # of one column of a group
    addresses = []
    for base, port in zip(bases, ports, strict=True):
        offset = w.new(f"mul i64 {count}, {port.size * column_bytes}")
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


def _is_contiguous(w: LlvmWriter, port: TensorSpec, outer: str, inner: list[str]) -> str:
    """Condition (i1): the samples of an array are adjacent and in C order."""
    expected, all_so_far = w.precision.bytes, ""
    lengths = [*reversed(port.shape), 1]
    for length, stride in zip(lengths, [*reversed(inner), outer], strict=True):
        has_expected = w.new(f"icmp eq i64 {stride}, {expected}")
        if all_so_far:
            has_expected = w.new(f"and i1 {all_so_far}, {has_expected}")
        all_so_far = has_expected
        expected *= length
    return all_so_far
