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
    steps, following = [], len(ports)
    for k, port in enumerate(ports):
        axes = len(port.shape)
        steps.append(load_strides(w, k, following, axes))
        following += axes
    return samples, bases, steps


def load_strides(w: LlvmWriter, operand: int, first_inner: int, axes: int) -> Step:
    """Distance between samples of an operand, and distances within a sample, which begin at place ``first_inner``."""
    outer = w.new(f"load i64, ptr {w.gep('%steps', 8 * operand)}, align 8")
    places = range(first_inner, first_inner + axes)
    inner = [w.new(f"load i64, ptr {w.gep('%steps', 8 * place)}, align 8") for place in places]
    return outer, inner


def buffer_size(w: LlvmWriter, port: TensorSpec) -> int:
    """Size of a block of samples [bytes]."""
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
    """Allocate buffers; returns the pointer to free, the current label, and the buffers. If malloc fails, results are NaN."""
    padded = [-(-size // LINE) * LINE for size in sizes]  # whole cache lines
    taken = w.new(f"call ptr @malloc(i64 {sum(padded) + LINE})")
    none, some = w.labels("nomemory", "memory")
    w.do(f"br i1 {w.new(f'icmp eq ptr {taken}, null')}, label %{none}, label %{some}")
    w.begin(none)
    for place, shape, step in outputs:
        w.do(f"call void @fill_nan(ptr {place}, i64 {samples}, {_lengths(shape, step)})")
    w.do("ret void")
    w.begin(some)
    beyond = w.new(f"add i64 {w.new(f'ptrtoint ptr {taken} to i64')}, {LINE - 1}")
    place = w.new(f"inttoptr i64 {w.new(f'and i64 {beyond}, {-LINE}')} to ptr")
    return taken, some, [w.gep(place, sum(padded[:k])) for k in range(len(padded))]


def call_copy(
    w: LlvmWriter, which: str, buffer: str, place: str, count: str, shape: Sequence[int | str], step: Step
) -> None:
    """Call ``@gather`` or ``@scatter`` for ``count`` samples at ``place``."""
    w.do(f"call void @{which}(ptr {buffer}, ptr {place}, i64 {count}, {_lengths(shape, step)})")


def _lengths(shape: Sequence[int | str], step: Step) -> str:
    """Arguments for the distance between samples, then length and stride of each axis."""
    outer, inner = step
    lengths = [1] * (RANK - len(shape)) + list(shape)
    strides = ["0"] * (RANK - len(shape)) + inner
    sizes = ", ".join(f"i64 {n}, i64 {s}" for n, s in zip(lengths, strides, strict=True))
    return f"i64 {outer}, {sizes}"


def copying(name: str, precision: Precision, lanes: int, *, inward: bool) -> str:
    """``gather`` copies strided samples into a packed buffer and pads it to a block; ``scatter`` copies a buffer out."""
    w = LlvmWriter(precision, lanes)
    word = f"i{precision.bits}"
    per_sample = w.new(f"mul i64 {w.new('mul i64 %n0, %n1')}, %n2")
    size = w.new(f"mul i64 {per_sample}, {precision.bytes}")
    with w.loop("%count", "entry") as row:
        place = w.gep("%place", w.new(f"mul i64 {row}, %outer"))
        packed = w.gep("%buffer", w.new(f"mul i64 {row}, {size}"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j:
            line = w.new(f"add i64 {w.new(f'mul i64 {i}, %n1')}, {j}")
            number = w.new(f"mul i64 {line}, %n2")
            near = w.gep(packed, w.new(f"mul i64 {number}, {precision.bytes}"))
            far = w.gep(w.gep(place, w.new(f"mul i64 {i}, %s0")), w.new(f"mul i64 {j}, %s1"))
            with w.loop("%n2", w.after) as k:  # the only work per element: it dominates a single call
                source = w.gep(near, w.new(f"mul i64 {k}, {precision.bytes}"))
                target = w.gep(far, w.new(f"mul i64 {k}, %s2"))
                if inward:
                    source, target = target, source
                value = w.new(f"load {word}, ptr {source}, align {precision.bytes}")
                w.do(f"store {word} {value}, ptr {target}, align {precision.bytes}")
    if inward:
        _pad(w, word, per_sample, size)
    arguments = "ptr %buffer, ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @{name}({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def _pad(w: LlvmWriter, word: str, per_sample: str, size: str) -> None:
    """Repeat the last sample in the remaining rows of the block."""
    last = w.gep("%buffer", w.new(f"mul i64 {w.new('sub i64 %count, 1')}, {size}"))
    missing = w.new(f"sub i64 {w.lanes}, %count")
    with w.loop(per_sample, w.after) as k:
        source = w.gep(last, w.new(f"mul i64 {k}, {w.precision.bytes}"))
        value = w.new(f"load {word}, ptr {source}, align {w.precision.bytes}")
        with w.loop(missing, w.after) as row:
            target = w.gep(source, w.new(f"mul i64 {w.new(f'add i64 {row}, 1')}, {size}"))
            w.do(f"store {word} {value}, ptr {target}, align {w.precision.bytes}")


def streaming(precision: Precision, lanes: int) -> str:
    """``stream`` copies ``count`` vectors of a packed buffer to an aligned address, bypassing the caches."""
    w = LlvmWriter(precision, lanes)
    size = lanes * precision.bytes
    with w.loop("%count", "entry") as k:
        offset = w.new(f"mul i64 {k}, {size}")
        vector = w.new(f"load {w.vector}, ptr {w.gep('%buffer', offset)}, align {size}")
        w.do(f"store {w.vector} {vector}, ptr {w.gep('%place', offset)}, align {size}, !nontemporal !{{i32 1}}")
    body = "\n".join(w.lines)
    arguments = "ptr %buffer, ptr %place, i64 %count"
    return f"define internal void @stream({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def nan_filler(precision: Precision, lanes: int) -> str:
    """``fill_nan`` writes NaN into every entry of strided samples."""
    w = LlvmWriter(precision, lanes)
    with w.loop("%count", "entry") as row:
        place = w.gep("%place", w.new(f"mul i64 {row}, %outer"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j, w.loop("%n2", w.after) as k:
            offset = w.new(f"add i64 {w.new(f'mul i64 {i}, %s0')}, {w.new(f'mul i64 {j}, %s1')}")
            offset = w.new(f"add i64 {offset}, {w.new(f'mul i64 {k}, %s2')}")
            nan = w.number(math.nan)
            w.do(f"store {w.element} {nan}, ptr {w.gep(place, offset)}, align {precision.bytes}")
    arguments = "ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @fill_nan({arguments}) noinline cold {{\nentry:\n{body}\n  ret void\n}}\n"


# ── The loop that NumPy calls: blocks of whole rows in place, all others through a small buffer

# ``void loop(char **args, intp *dims, intp *steps, void *data)`` is the type of a gufunc's inner loop. ``dims[0]`` is the
# number of samples; ``steps`` has the distance between samples of each operand, then the distances within a sample. If all
# operands are contiguous rows, the block reads and writes them in place. Operands with other strides, broadcast operands and
# the last rows are copied through buffers of one block. Missing rows repeat the last one, so that they raise no additional
# floating-point flags. Large results bypass the caches: they are written from a buffer of one block in whole vectors.

Loop = Callable[[str, Program, Precision, int, int, int], str]
"""Function that writes the loop around blocks; its arguments are those of :func:`loop`."""

BEYOND_CACHES = 1 << 24
"""Size of results [bytes] above which they bypass the caches; otherwise they would evict the code of large programs too."""


MEMORY_DECLARATIONS = "declare ptr @malloc(i64)\ndeclare void @free(ptr)\n"
COPY_DECLARATION = "declare void @llvm.memcpy.inline.p0.p0.i64(ptr, ptr, i64 immarg, i1 immarg)"

SHORTEST_PIECE, SHORTEST_ROW = 16, 256
"""Minimum size [bytes] of a store that bypasses the caches, and of a sample's results for which such stores pay."""


def loop(name: str, program: Program, precision: Precision, lanes: int, frame: int = 0, group: int = 1) -> str:
    """Assembly of the loop function and its copying helpers.

    If ``frame`` > 0, the block has another argument, a frame of that many bytes, which ``@prepare`` fills once per call. A
    call of ``@blocks`` processes ``group`` blocks of rows in place.
    """
    ports = [*program.inputs, *program.outputs]
    w = LlvmWriter(precision, lanes)
    large = frame + sum(buffer_sizes(w, ports)) > ON_STACK
    result_row = precision.bytes * sum(port.size for port in program.outputs)
    vector = lanes * precision.bytes
    piece = 0  # size of a store that bypasses the caches [bytes]; 0 if none does
    if result_row >= SHORTEST_ROW and vector >= SHORTEST_PIECE and group == 1:
        piece = vector
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
    size = w.precision.bytes
    samples, bases, step = call_arrays(w, ports)
    taken, start = "", "entry"
    further: list[str] = []  # the frame, if there is one, is the last argument of blocks
    if large:
        results = [(bases[k], ports[k].shape, step[k]) for k in range(inputs, len(ports))]
        taken, start, (*buffers, room) = allocate(w, [*buffer_sizes(w, ports), frame], samples, results)
        further = [room] if frame else []
    else:
        buffers = [w.new(f"alloca [{max(port.size, 1) * w.lanes} x {w.element}], align 64") for port in ports]
        if frame:
            further = [w.new(f"alloca [{frame} x i8], align {LINE}")]
    if frame:
        w.do(f"call void @prepare(ptr {further[0]})")
    direct = [_is_direct(w, port, *step[k], size) for k, port in enumerate(ports)]
    all_direct = direct[0]
    for flag in direct[1:]:
        all_direct = w.new(f"and i1 {all_direct}, {flag}")
    whole = w.new(f"sdiv i64 {samples}, {w.lanes}")
    quick = w.new(f"select i1 {all_direct}, i64 {whole}, i64 0")
    outputs = list(zip(bases, ports, strict=True))[inputs:]
    at, left = bases, quick
    if piece:
        many = _many_and_aligned(w, samples, outputs, piece)
        past = w.new(f"select i1 {many}, i64 {quick}, i64 0")
        start = _blocks_past_caches(w, ports, bases, past, start, buffers[inputs:], further)
        at = _moved(w, ports, bases, past, 1)
        left = w.new(f"sub i64 {quick}, {past}")
    if group > 1:
        groups = w.new(f"sdiv i64 {quick}, {group}")
        start = _blocks_in_place(w, ports, bases, groups, start, further, group)
        at = _moved(w, ports, bases, groups, group)
        left = w.new(f"sub i64 {quick}, {w.new(f'mul i64 {groups}, {group}')}")
    _blocks_in_place(w, ports, at, left, start, further)
    done = w.new(f"mul i64 {quick}, {w.lanes}")
    left = w.new(f"sub i64 {samples}, {done}")
    with w.loop(w.blocks(left), w.after) as block:
        first = w.new(f"add i64 {done}, {w.new(f'mul i64 {block}, {w.lanes}')}")
        count, short = w.share(samples, first)
        whole_rows = w.new(f"xor i1 {short}, true")
        later = w.new(f"icmp sgt i64 {block}, 0")
        places, pointers, copied = [], [], []
        for k in range(len(ports)):
            places.append(w.gep(bases[k], w.new(f"mul i64 {first}, {step[k][0]}")))
            in_place = w.new(f"and i1 {direct[k]}, {whole_rows}")
            pointers.append(w.new(f"select i1 {in_place}, ptr {places[k]}, ptr {buffers[k]}"))
            copied.append(w.new(f"xor i1 {in_place}, true"))
        for k in range(inputs):  # a sample shared by all rows is copied once
            same = w.new(f"and i1 {later}, {w.new(f'icmp eq i64 {step[k][0]}, 0')}")
            with w.when(w.new(f"and i1 {copied[k]}, {w.new(f'xor i1 {same}, true')}")):
                call_copy(w, "gather", buffers[k], places[k], count, ports[k].shape, step[k])
        call_block(w, [*pointers, *further])
        for k in range(inputs, len(ports)):
            with w.when(copied[k]):
                call_copy(w, "scatter", buffers[k], places[k], count, ports[k].shape, step[k])
    if taken:
        w.do(f"call void @free(ptr {taken})")


def _many_and_aligned(w: LlvmWriter, samples: str, outputs: list[tuple[str, TensorSpec]], piece: int) -> str:
    """True if results should bypass the caches and can: blocks and arrays are multiples of ``piece`` bytes."""
    row = 0  # size of all results of a sample [bytes]
    for _, port in outputs:
        size = port.size * w.precision.bytes
        if w.lanes * size % piece:
            return "false"
        row += size
    bypasses = w.new(f"icmp sgt i64 {samples}, {BEYOND_CACHES // row}")
    for base, _ in outputs:
        misalignment = w.new(f"and i64 {w.new(f'ptrtoint ptr {base} to i64')}, {piece - 1}")
        bypasses = w.new(f"and i1 {bypasses}, {w.new(f'icmp eq i64 {misalignment}, 0')}")
    return bypasses


def _blocks_past_caches(
    w: LlvmWriter,
    ports: list[TensorSpec],
    bases: list[str],
    count: str,
    label: str,
    buffers: list[str],
    further: list[str],
) -> str:
    """Evaluate ``count`` blocks on rows in place, with results through buffers; returns the current label."""
    inputs = len(ports) - len(buffers)
    with w.loop(count, label) as k:
        places = _moved(w, ports, bases, k, 1)
        call_block(w, [*places[:inputs], *buffers, *further])
        for buffer, place, port in zip(buffers, places[inputs:], ports[inputs:], strict=True):
            w.do(f"call void @stream(ptr {buffer}, ptr {place}, i64 {port.size})")
    with w.when(w.new(f"icmp sgt i64 {count}, 0")):
        w.do("fence seq_cst")  # orders the nontemporal writes for other threads
    return w.after


def _moved(w: LlvmWriter, ports: list[TensorSpec], bases: list[str], count: str, group: int) -> list[str]:
    """Addresses of the arrays after ``count`` groups of blocks."""
    group_bytes = group * w.lanes * w.precision.bytes  # size of one column of a group
    moved = []
    for base, port in zip(bases, ports, strict=True):
        offset = w.new(f"mul i64 {count}, {port.size * group_bytes}")
        moved.append(w.gep(base, offset))
    return moved


def _blocks_in_place(
    w: LlvmWriter, ports: list[TensorSpec], bases: list[str], count: str, label: str, further: list[str], group: int = 1
) -> str:
    """Call ``count`` blocks, or groups of blocks, on the arrays themselves; returns the current label."""
    function = "block" if group == 1 else "blocks"
    with w.loop(count, label) as k:
        call_block(w, [*_moved(w, ports, bases, k, group), *further], function)
    return w.after


def _is_direct(w: LlvmWriter, port: TensorSpec, outer: str, inner: list[str], size: int) -> str:
    """True if samples are adjacent and in C order."""
    expected, flag = size, ""
    lengths = [*reversed(port.shape), 1]
    for length, stride in zip(lengths, [*reversed(inner), outer], strict=True):
        same = w.new(f"icmp eq i64 {stride}, {expected}")
        if flag:
            same = w.new(f"and i1 {flag}, {same}")
        flag = same
        expected *= length
    return flag
