"""The loop NumPy calls: blocks of whole rows straight from the arrays, everything else through a small buffer.

``void loop(char **args, intp *dims, intp *steps, void *data)`` is the shape of a gufunc's inner loop: ``dims[0]`` samples,
``steps`` first the distance between samples of each operand, then the distances within one. Where all operands are
contiguous rows the block reads and writes them in place. What has other strides or is broadcast, and the last few rows, are
copied through buffers of one block; missing rows repeat the last one, so that they raise no floating-point flags of their own.
Large results go past the caches, from a buffer of one block in whole vectors.
"""

from __future__ import annotations

from collections.abc import Callable

from ..program.port import Port
from ..program.program import Program
from .buffers import LINE, ON_STACK, buffer_size, call_block, call_copy, copying, spoiling, streaming, take
from .llvm_text import LlvmWriter
from .processor import Precision

Loop = Callable[[str, Program, Precision, int, int, int], str]
"""What makes the assembly of a loop around blocks; its arguments are those of :func:`loop`."""

BEYOND_CACHES = 1 << 24
"""Bytes of results that are written past the caches: they would drive out everything, the code of large programs too."""


SHORTEST_PIECE, SHORTEST_ROW = 16, 256
"""Bytes that processors write past their caches at once, at least; and of a sample's results, fewer of which gain nothing."""


def loop(name: str, program: Program, precision: Precision, lanes: int, frame: int = 0, group: int = 1) -> str:
    """Assembly of the loop function and its copying helpers.

    With a ``frame`` of so many bytes, the block takes it as one more pointer, and ``@prepare`` fills it once a call. With a
    ``group``, so many blocks of rows in place are one call of ``@blocks``.
    """
    ports = [*program.inputs, *program.outputs]
    w = LlvmWriter(precision, lanes)
    large = frame + sum(buffer_size(w, port) for port in ports) > ON_STACK
    row = precision.bytes * sum(port.size for port in program.outputs)
    piece = lanes * precision.bytes if row >= SHORTEST_ROW and group == 1 else 0
    piece = piece if piece >= SHORTEST_PIECE else 0
    _body(w, ports, len(program.inputs), frame, large, group, piece)
    return "\n".join(
        [
            copying("gather", precision, lanes, inward=True),
            copying("scatter", precision, lanes, inward=False),
            *([streaming(precision, lanes)] if piece else []),
            *([spoiling(precision, lanes), "declare ptr @malloc(i64)\ndeclare void @free(ptr)\n"] if large else []),
            f"define void @{name}(ptr %args, ptr %dims, ptr %steps, ptr %data) {{\nentry:",
            *w.lines,
            "  ret void\n}\n",
        ]
    )


def _body(w: LlvmWriter, ports: list[Port], inputs: int, frame: int, large: bool, group: int, piece: int) -> None:
    size = w.precision.bytes
    samples = w.new("load i64, ptr %dims, align 8")
    bases = [w.new(f"load ptr, ptr {w.at('%args', 8 * k)}, align 8") for k in range(len(ports))]
    step, following = [], 8 * len(ports)
    for k, port in enumerate(ports):
        outer = w.new(f"load i64, ptr {w.at('%steps', 8 * k)}, align 8")
        inner = [
            w.new(f"load i64, ptr {w.at('%steps', following + 8 * axis)}, align 8") for axis in range(len(port.shape))
        ]
        following += 8 * len(port.shape)
        step.append((outer, inner))
    taken, start = "", "entry"
    if large:
        sizes = [*(buffer_size(w, port) for port in ports), frame]
        spoiled = [(bases[k], ports[k].shape, step[k]) for k in range(inputs, len(ports))]
        taken, start, (*buffers, room) = take(w, sizes, samples, spoiled)
    else:
        buffers = [w.new(f"alloca [{max(port.size, 1) * w.lanes} x {w.element}], align 64") for port in ports]
        room = w.new(f"alloca [{frame} x i8], align {LINE}") if frame else ""
    further = [room] if frame else []
    if frame:
        w.do(f"call void @prepare(ptr {room})")
    direct = [_is_direct(w, port, *step[k], size) for k, port in enumerate(ports)]
    every = direct[0]
    for flag in direct[1:]:
        every = w.new(f"and i1 {every}, {flag}")
    whole = w.new(f"sdiv i64 {samples}, {w.lanes}")
    quick = w.new(f"select i1 {every}, i64 {whole}, i64 0")
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
            places.append(w.at(bases[k], w.new(f"mul i64 {first}, {step[k][0]}")))
            in_place = w.new(f"and i1 {direct[k]}, {whole_rows}")
            pointers.append(w.new(f"select i1 {in_place}, ptr {places[k]}, ptr {buffers[k]}"))
            copied.append(w.new(f"xor i1 {in_place}, true"))
        for k in range(inputs):  # a sample given once for all is copied once
            same = w.new(f"and i1 {later}, {w.new(f'icmp eq i64 {step[k][0]}, 0')}")
            with w.when(w.new(f"and i1 {copied[k]}, {w.new(f'xor i1 {same}, true')}")):
                call_copy(w, "gather", buffers[k], places[k], count, ports[k].shape, step[k])
        call_block(w, [*pointers, *further])
        for k in range(inputs, len(ports)):
            with w.when(copied[k]):
                call_copy(w, "scatter", buffers[k], places[k], count, ports[k].shape, step[k])
    if taken:
        w.do(f"call void @free(ptr {taken})")


def _many_and_aligned(w: LlvmWriter, samples: str, outputs: list[tuple[str, Port]], piece: int) -> str:
    """True if results should be written past the caches, and can be: blocks and arrays are multiples of ``piece`` bytes."""
    sizes = [port.size * w.precision.bytes for _, port in outputs]
    if any(w.lanes * size % piece for size in sizes):
        return "false"
    yes = w.new(f"icmp sgt i64 {samples}, {BEYOND_CACHES // sum(sizes)}")
    for base, _ in outputs:
        odd = w.new(f"and i64 {w.new(f'ptrtoint ptr {base} to i64')}, {piece - 1}")
        yes = w.new(f"and i1 {yes}, {w.new(f'icmp eq i64 {odd}, 0')}")
    return yes


def _blocks_past_caches(
    w: LlvmWriter, ports: list[Port], bases: list[str], count: str, label: str, buffers: list[str], further: list[str]
) -> str:
    """So many blocks of rows in place, results by way of buffers; returns the label control is in afterwards."""
    inputs = len(ports) - len(buffers)
    with w.loop(count, label) as k:
        places = _moved(w, ports, bases, k, 1)
        call_block(w, [*places[:inputs], *buffers, *further])
        for buffer, place, port in zip(buffers, places[inputs:], ports[inputs:], strict=True):
            w.do(f"call void @stream(ptr {buffer}, ptr {place}, i64 {port.size})")
    with w.when(w.new(f"icmp sgt i64 {count}, 0")):
        w.do("fence seq_cst")  # such writes reach other threads in any order
    return w.after


def _moved(w: LlvmWriter, ports: list[Port], bases: list[str], count: str, group: int) -> list[str]:
    """Where the arrays go on after so many groups of blocks."""
    rows = group * w.lanes * w.precision.bytes
    return [w.at(base, w.new(f"mul i64 {count}, {port.size * rows}")) for base, port in zip(bases, ports, strict=True)]


def _blocks_in_place(
    w: LlvmWriter, ports: list[Port], bases: list[str], count: str, label: str, further: list[str], group: int = 1
) -> str:
    """Call so many blocks, or groups of them, on the arrays themselves; returns the label control is in afterwards."""
    with w.loop(count, label) as k:
        call_block(w, [*_moved(w, ports, bases, k, group), *further], "block" if group == 1 else "blocks")
    return w.after


def _is_direct(w: LlvmWriter, port: Port, outer: str, inner: list[str], size: int) -> str:
    """Whether samples follow each other as the block wants them: C order without gaps."""
    expected, flag = size, "true"
    for length, stride in reversed(list(zip(port.shape, inner, strict=True))):
        same = w.new(f"icmp eq i64 {stride}, {expected}")
        flag = same if flag == "true" else w.new(f"and i1 {flag}, {same}")
        expected *= length
    same = w.new(f"icmp eq i64 {outer}, {expected}")
    return same if flag == "true" else w.new(f"and i1 {flag}, {same}")
