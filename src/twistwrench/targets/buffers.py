"""Buffers of one block of samples, and what copies samples into them and out of them, whatever their strides.

Buffers lie on the stack, those of large programs in memory that each call takes and frees: a thread's stack may be small.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..program.port import Port
from .llvm_text import LlvmWriter
from .processor import Precision

Step = tuple[str, list[str]]
"""The distance between samples, and those within one, axis by axis [bytes]."""

RANK = 3
"""Most axes an array of one sample may have."""

ON_STACK = 16_000
"""Bytes of buffers and frame that a call may have on the stack: threads may have no more than 64 kB of it."""

LINE = 64
"""Bytes of a cache line: buffers start with one."""


def buffer_size(w: LlvmWriter, port: Port) -> int:
    """Bytes that a block of samples takes."""
    return max(port.size, 1) * w.lanes * w.precision.bytes


def call_block(w: LlvmWriter, pointers: list[str], name: str = "block") -> None:
    """Call ``@block``, or another function of places."""
    w.do(f"call void @{name}({', '.join(f'ptr {p}' for p in pointers)})")


def take(
    w: LlvmWriter, sizes: list[int], samples: str, outputs: Sequence[tuple[str, Sequence[int | str], Step]]
) -> tuple[str, str, list[str]]:
    """Memory for buffers of those sizes: what to free, the label control is in, the buffers. Without it, results are NaN."""
    lines = [-(-size // LINE) * LINE for size in sizes]
    taken = w.new(f"call ptr @malloc(i64 {sum(lines) + LINE})")
    none, some = w.label("nomemory"), w.label("memory")
    w.do(f"br i1 {w.new(f'icmp eq ptr {taken}, null')}, label %{none}, label %{some}")
    w.begin(none)
    for place, shape, step in outputs:
        w.do(f"call void @spoil(ptr {place}, i64 {samples}, {_lengths(shape, step)})")
    w.do("ret void")
    w.begin(some)
    beyond = w.new(f"add i64 {w.new(f'ptrtoint ptr {taken} to i64')}, {LINE - 1}")
    place = w.new(f"inttoptr i64 {w.new(f'and i64 {beyond}, {-LINE}')} to ptr")
    return taken, some, [w.at(place, sum(lines[:k])) for k in range(len(lines))]


def call_copy(
    w: LlvmWriter, which: str, buffer: str, place: str, count: str, shape: Sequence[int | str], step: Step
) -> None:
    """Call ``@gather`` or ``@scatter`` for so many samples at ``place``."""
    w.do(f"call void @{which}(ptr {buffer}, ptr {place}, i64 {count}, {_lengths(shape, step)})")


def _lengths(shape: Sequence[int | str], step: Step) -> str:
    """The distance between samples, then length and stride of each axis, as arguments."""
    outer, inner = step
    lengths = [1] * (RANK - len(shape)) + list(shape)
    strides = ["0"] * (RANK - len(shape)) + inner
    sizes = ", ".join(f"i64 {n}, i64 {s}" for n, s in zip(lengths, strides, strict=True))
    return f"i64 {outer}, {sizes}"


def copying(name: str, precision: Precision, lanes: int, *, inward: bool) -> str:
    """``gather`` copies strided samples into a packed buffer and pads it to a block; ``scatter`` copies them out."""
    w = LlvmWriter(precision, lanes)
    word = f"i{precision.bits}"
    per_sample = w.new(f"mul i64 {w.new('mul i64 %n0, %n1')}, %n2")
    size = w.new(f"mul i64 {per_sample}, {precision.bytes}")
    with w.loop("%count", "entry") as row:
        place = w.at("%place", w.new(f"mul i64 {row}, %outer"))
        packed = w.at("%buffer", w.new(f"mul i64 {row}, {size}"))
        with w.loop("%n0", w.after) as i, w.loop("%n1", w.after) as j:
            line = w.new(f"add i64 {w.new(f'mul i64 {i}, %n1')}, {j}")
            number = w.new(f"mul i64 {line}, %n2")
            near = w.at(packed, w.new(f"mul i64 {number}, {precision.bytes}"))
            far = w.at(w.at(place, w.new(f"mul i64 {i}, %s0")), w.new(f"mul i64 {j}, %s1"))
            with w.loop("%n2", w.after) as k:  # all that is left to do for an element: this takes most of a single call
                close, away = (
                    w.at(near, w.new(f"mul i64 {k}, {precision.bytes}")),
                    w.at(far, w.new(f"mul i64 {k}, %s2")),
                )
                here, there = (away, close) if inward else (close, away)
                value = w.new(f"load {word}, ptr {here}, align {precision.bytes}")
                w.do(f"store {word} {value}, ptr {there}, align {precision.bytes}")
    if inward:
        _pad(w, word, per_sample, size)
    arguments = "ptr %buffer, ptr %place, i64 %count, i64 %outer, i64 %n0, i64 %s0, i64 %n1, i64 %s1, i64 %n2, i64 %s2"
    body = "\n".join(w.lines)
    return f"define internal void @{name}({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def _pad(w: LlvmWriter, word: str, per_sample: str, size: str) -> None:
    """Repeat the last sample in the rows of the block that are left."""
    last = w.at("%buffer", w.new(f"mul i64 {w.new('sub i64 %count, 1')}, {size}"))
    missing = w.new(f"sub i64 {w.lanes}, %count")
    with w.loop(per_sample, w.after) as k:
        source = w.at(last, w.new(f"mul i64 {k}, {w.precision.bytes}"))
        value = w.new(f"load {word}, ptr {source}, align {w.precision.bytes}")
        with w.loop(missing, w.after) as row:
            target = w.at(source, w.new(f"mul i64 {w.new(f'add i64 {row}, 1')}, {size}"))
            w.do(f"store {word} {value}, ptr {target}, align {w.precision.bytes}")


def streaming(precision: Precision, lanes: int) -> str:
    """``stream`` copies a packed buffer of so many vectors past the caches, to where a vector may stand."""
    w = LlvmWriter(precision, lanes)
    size = lanes * precision.bytes
    with w.loop("%count", "entry") as k:
        offset = w.new(f"mul i64 {k}, {size}")
        vector = w.new(f"load {w.vector}, ptr {w.at('%buffer', offset)}, align {size}")
        w.do(f"store {w.vector} {vector}, ptr {w.at('%place', offset)}, align {size}, !nontemporal !{{i32 1}}")
    body = "\n".join(w.lines)
    arguments = "ptr %buffer, ptr %place, i64 %count"
    return f"define internal void @stream({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def spoiling(precision: Precision, lanes: int) -> str:
    """Write NaN into every entry of strided samples."""
    w = LlvmWriter(precision, lanes)
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
