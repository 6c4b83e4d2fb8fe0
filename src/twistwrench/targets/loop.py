"""The loop NumPy calls: blocks of whole rows straight from the arrays, everything else through a small buffer.

``void loop(char **args, intp *dims, intp *steps, void *data)`` is the shape of a gufunc's inner loop: ``dims[0]`` samples,
``steps`` first the distance between samples of each operand, then the distances within one. Where all operands are
contiguous rows the block reads and writes them in place. What has other strides or is broadcast, and the last few rows, are
copied through buffers of one block; missing rows repeat the last one, so that they raise no floating-point flags of their own.
Buffers lie on the stack, those of large programs in memory that each call takes and frees: a thread's stack may be small.
"""

from __future__ import annotations

import math

from ..program.program import Port, Program
from .machine import Precision
from .writer import Writer

__all__ = ["loop"]

RANK = 3
"""Most axes an array of one sample may have."""

ON_STACK = 100_000
"""Bytes of buffers and frame that a call may have on the stack; threads have 256 kB of it and more."""

LINE = 64
"""Bytes of a cache line: buffers start with one."""


def loop(name: str, program: Program, precision: Precision, lanes: int, frame: int = 0, group: int = 1) -> str:
    """Assembly of the loop function and its copying helpers.

    With a ``frame`` of so many bytes, the block takes it as one more pointer, and ``@prepare`` fills it once a call. With a
    ``group``, so many blocks of rows in place are one call of ``@blocks``.
    """
    ports = [*program.inputs, *program.outputs]
    w = Writer(precision, lanes)
    large = frame + sum(_buffer_size(w, port) for port in ports) > ON_STACK
    _body(w, ports, len(program.inputs), frame, large, group)
    return "\n".join(
        [
            _copy("gather", precision, lanes, inward=True),
            _copy("scatter", precision, lanes, inward=False),
            *([_spoil(precision, lanes), "declare ptr @malloc(i64)\ndeclare void @free(ptr)\n"] if large else []),
            f"define void @{name}(ptr %args, ptr %dims, ptr %steps, ptr %data) {{\nentry:",
            *w.lines,
            "  ret void\n}\n",
        ]
    )


def _buffer_size(w: Writer, port: Port) -> int:
    return max(port.size, 1) * w.lanes * w.precision.bytes


def _body(w: Writer, ports: list[Port], inputs: int, frame: int, large: bool, group: int) -> None:
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
        sizes = [*(_buffer_size(w, port) for port in ports), frame]
        outputs = [(bases[k], ports[k], step[k]) for k in range(inputs, len(ports))]
        taken, start, (*buffers, room) = _take(w, sizes, samples, outputs)
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
    at, left = bases, quick
    if group > 1:
        groups = w.new(f"sdiv i64 {quick}, {group}")
        start = _blocks_in_place(w, ports, bases, groups, start, further, group)
        at = _moved(w, ports, bases, groups, group)
        left = w.new(f"sub i64 {quick}, {w.new(f'mul i64 {groups}, {group}')}")
    _blocks_in_place(w, ports, at, left, start, further)
    done = w.new(f"mul i64 {quick}, {w.lanes}")
    left = w.new(f"sub i64 {samples}, {done}")
    blocks = w.new(f"sdiv i64 {w.new(f'add i64 {left}, {w.lanes - 1}')}, {w.lanes}")
    with w.loop(blocks, w.after) as block:
        first = w.new(f"add i64 {done}, {w.new(f'mul i64 {block}, {w.lanes}')}")
        rest = w.new(f"sub i64 {samples}, {first}")
        short = w.new(f"icmp slt i64 {rest}, {w.lanes}")
        count = w.new(f"select i1 {short}, i64 {rest}, i64 {w.lanes}")
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
                _call_copy(w, "gather", buffers[k], places[k], count, ports[k], step[k])
        _call(w, [*pointers, *further])
        for k in range(inputs, len(ports)):
            with w.when(copied[k]):
                _call_copy(w, "scatter", buffers[k], places[k], count, ports[k], step[k])
    if taken:
        w.do(f"call void @free(ptr {taken})")


def _moved(w: Writer, ports: list[Port], bases: list[str], count: str, group: int) -> list[str]:
    """Where the arrays go on after so many groups of blocks."""
    rows = group * w.lanes * w.precision.bytes
    return [w.at(base, w.new(f"mul i64 {count}, {port.size * rows}")) for base, port in zip(bases, ports, strict=True)]


def _blocks_in_place(
    w: Writer, ports: list[Port], bases: list[str], count: str, label: str, further: list[str], group: int = 1
) -> str:
    """Call so many blocks, or groups of them, on the arrays themselves; returns the label control is in afterwards."""
    with w.loop(count, label) as k:
        _call(w, [*_moved(w, ports, bases, k, group), *further], "block" if group == 1 else "blocks")
    return w.after


def _take(
    w: Writer, sizes: list[int], samples: str, outputs: list[tuple[str, Port, tuple[str, list[str]]]]
) -> tuple[str, str, list[str]]:
    """Memory for buffers of those sizes: what to free, the label control is in, the buffers. Without it, results are NaN."""
    lines = [-(-size // LINE) * LINE for size in sizes]
    taken = w.new(f"call ptr @malloc(i64 {sum(lines) + LINE})")
    none, some = w.label("nomemory"), w.label("memory")
    w.do(f"br i1 {w.new(f'icmp eq ptr {taken}, null')}, label %{none}, label %{some}")
    w.begin(none)
    for place, port, step in outputs:
        w.do(f"call void @spoil(ptr {place}, i64 {samples}, {_lengths(port, step)})")
    w.do("ret void")
    w.begin(some)
    beyond = w.new(f"add i64 {w.new(f'ptrtoint ptr {taken} to i64')}, {LINE - 1}")
    place = w.new(f"inttoptr i64 {w.new(f'and i64 {beyond}, {-LINE}')} to ptr")
    return taken, some, [w.at(place, sum(lines[:k])) for k in range(len(lines))]


def _is_direct(w: Writer, port: Port, outer: str, inner: list[str], size: int) -> str:
    """Whether samples follow each other as the block wants them: C order without gaps."""
    expected, flag = size, "true"
    for length, stride in reversed(list(zip(port.shape, inner, strict=True))):
        same = w.new(f"icmp eq i64 {stride}, {expected}")
        flag = same if flag == "true" else w.new(f"and i1 {flag}, {same}")
        expected *= length
    same = w.new(f"icmp eq i64 {outer}, {expected}")
    return same if flag == "true" else w.new(f"and i1 {flag}, {same}")


def _call(w: Writer, pointers: list[str], name: str = "block") -> None:
    w.do(f"call void @{name}({', '.join(f'ptr {p}' for p in pointers)})")


def _call_copy(
    w: Writer, which: str, buffer: str, place: str, count: str, port: Port, step: tuple[str, list[str]]
) -> None:
    w.do(f"call void @{which}(ptr {buffer}, ptr {place}, i64 {count}, {_lengths(port, step)})")


def _lengths(port: Port, step: tuple[str, list[str]]) -> str:
    """The distance between samples, then length and stride of each axis, as arguments."""
    outer, inner = step
    lengths = [1] * (RANK - len(port.shape)) + list(port.shape)
    strides = ["0"] * (RANK - len(port.shape)) + inner
    sizes = ", ".join(f"i64 {n}, i64 {s}" for n, s in zip(lengths, strides, strict=True))
    return f"i64 {outer}, {sizes}"


def _copy(name: str, precision: Precision, lanes: int, *, inward: bool) -> str:
    """``gather`` copies strided samples into a packed buffer and pads it to a block; ``scatter`` copies them out."""
    w = Writer(precision, lanes)
    word = f"i{precision.bits}"
    per_sample = w.new(f"mul i64 {w.new('mul i64 %n0, %n1')}, %n2")
    rows = str(lanes) if inward else "%count"
    last = w.new("sub i64 %count, 1")
    with w.loop(rows, "entry") as row:
        beyond = w.new(f"icmp sgt i64 {row}, {last}")
        source_row = w.new(f"select i1 {beyond}, i64 {last}, i64 {row}")
        place = w.at("%place", w.new(f"mul i64 {source_row}, %outer"))
        packed = w.at("%buffer", w.new(f"mul i64 {w.new(f'mul i64 {row}, {per_sample}')}, {precision.bytes}"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j, w.loop("%n2", w.after) as k:
            number = w.new(f"add i64 {w.new(f'mul i64 {i}, %n1')}, {j}")
            number = w.new(f"add i64 {w.new(f'mul i64 {number}, %n2')}, {k}")
            near = w.at(packed, w.new(f"mul i64 {number}, {precision.bytes}"))
            offset = w.new(f"mul i64 {i}, %s0")
            offset = w.new(f"add i64 {offset}, {w.new(f'mul i64 {j}, %s1')}")
            offset = w.new(f"add i64 {offset}, {w.new(f'mul i64 {k}, %s2')}")
            far = w.at(place, offset)
            here, there = (far, near) if inward else (near, far)
            value = w.new(f"load {word}, ptr {here}, align {precision.bytes}")
            w.do(f"store {word} {value}, ptr {there}, align {precision.bytes}")
    arguments = "ptr %buffer, ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @{name}({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def _spoil(precision: Precision, lanes: int) -> str:
    """Write NaN into every entry of strided samples."""
    w = Writer(precision, lanes)
    with w.loop("%count", "entry") as row:
        place = w.at("%place", w.new(f"mul i64 {row}, %outer"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j, w.loop("%n2", w.after) as k:
            offset = w.new(f"add i64 {w.new(f'mul i64 {i}, %s0')}, {w.new(f'mul i64 {j}, %s1')}")
            offset = w.new(f"add i64 {offset}, {w.new(f'mul i64 {k}, %s2')}")
            nan = w.number(math.nan)
            w.do(f"store {w.element} {nan}, ptr {w.at(place, offset)}, align {precision.bytes}")
    arguments = "ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @spoil({arguments}) noinline cold {{\nentry:\n{body}\n  ret void\n}}\n"
