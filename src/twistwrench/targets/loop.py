"""The loop NumPy calls: blocks of whole rows straight from the arrays, everything else through a small buffer.

``void loop(char **args, intp *dims, intp *steps, void *data)`` is the shape of a gufunc's inner loop: ``dims[0]`` samples,
``steps`` first the distance between samples of each operand, then the distances within one. Where all operands are
contiguous rows the block reads and writes them in place. What has other strides or is broadcast, and the last few rows, are
copied through buffers of one block; missing rows repeat the last one, so that they raise no floating-point flags of their own.
"""

from __future__ import annotations

from ..program.program import Port, Program
from .machine import Precision
from .writer import Writer

__all__ = ["loop"]

RANK = 3
"""Most axes an array of one sample may have."""


def loop(name: str, program: Program, precision: Precision, lanes: int) -> str:
    """Assembly of the loop function and its two copying helpers."""
    ports = [*program.inputs, *program.outputs]
    w = Writer(precision, lanes)
    _body(w, ports, len(program.inputs))
    return "\n".join(
        [
            _copy("gather", precision, lanes, inward=True),
            _copy("scatter", precision, lanes, inward=False),
            f"define void @{name}(ptr %args, ptr %dims, ptr %steps, ptr %data) {{\nentry:",
            *w.lines,
            "  ret void\n}\n",
        ]
    )


def _body(w: Writer, ports: list[Port], inputs: int) -> None:
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
    buffers = [w.new(f"alloca [{max(port.size, 1) * w.lanes} x {w.element}], align 64") for port in ports]
    direct = [_is_direct(w, port, *step[k], size) for k, port in enumerate(ports)]
    every = direct[0]
    for flag in direct[1:]:
        every = w.new(f"and i1 {every}, {flag}")
    whole = w.new(f"sdiv i64 {samples}, {w.lanes}")
    quick = w.new(f"select i1 {every}, i64 {whole}, i64 0")
    with w.loop(quick, "entry") as block:
        pointers = [
            w.at(bases[k], w.new(f"mul i64 {block}, {port.size * size * w.lanes}")) for k, port in enumerate(ports)
        ]
        _call(w, pointers)
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
        _call(w, pointers)
        for k in range(inputs, len(ports)):
            with w.when(copied[k]):
                _call_copy(w, "scatter", buffers[k], places[k], count, ports[k], step[k])


def _is_direct(w: Writer, port: Port, outer: str, inner: list[str], size: int) -> str:
    """Whether samples follow each other as the block wants them: C order without gaps."""
    expected, flag = size, "true"
    for length, stride in reversed(list(zip(port.shape, inner, strict=True))):
        same = w.new(f"icmp eq i64 {stride}, {expected}")
        flag = same if flag == "true" else w.new(f"and i1 {flag}, {same}")
        expected *= length
    same = w.new(f"icmp eq i64 {outer}, {expected}")
    return same if flag == "true" else w.new(f"and i1 {flag}, {same}")


def _call(w: Writer, pointers: list[str]) -> None:
    w.do(f"call void @block({', '.join(f'ptr {p}' for p in pointers)})")


def _call_copy(
    w: Writer, which: str, buffer: str, place: str, count: str, port: Port, step: tuple[str, list[str]]
) -> None:
    outer, inner = step
    lengths = [1] * (RANK - len(port.shape)) + list(port.shape)
    strides = ["0"] * (RANK - len(port.shape)) + inner
    sizes = ", ".join(f"i64 {n}, i64 {s}" for n, s in zip(lengths, strides, strict=True))
    w.do(f"call void @{which}(ptr {buffer}, ptr {place}, i64 {count}, i64 {outer}, {sizes})")


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
