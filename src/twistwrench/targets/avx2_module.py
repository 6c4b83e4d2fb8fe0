"""The module around a block of AVX2 code: the check for huge angles, the rows of wide results, the loop NumPy calls.

The code is a function of the arrays' places without a branch; a frame comes before them, for what finds no register.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..program.program import Program
from .avx2 import OPERATIONS, Selection
from .frame import Frame
from .loop import loop
from .machine import Machine, Precision
from .registers import ARRAYS_IN_REGISTERS, allocated
from .sections import frame_to_rows, preparation
from .sincos import wrapper
from .writer import Writer

__all__ = ["module", "serves"]

WIDE = 100
"""With more entries of results than this, the code leaves them in the frame, and a loop makes rows of them, tile by tile:
straight-line code for the tiles would be longer than the first cache, and stores to few lines at a time are faster."""


def serves(program: Program, machine: Machine) -> bool:
    """Whether this emitter can be asked: an x86-64 with AVX2 and FMA under the System V calling convention, and a program
    whose angles are plain inputs that are nothing but angles."""
    used: dict[int, set[bool]] = {}
    for op, args, _ in program.instructions:
        if op not in OPERATIONS:
            return False
        for a in args:
            used.setdefault(a, set()).add(op in ("sin", "cos"))
    for result in program.results:
        used.setdefault(result, set()).add(False)
    angles = [a for a, ways in used.items() if True in ways]
    return _runs(machine) and all(program.instructions[a].op == "input" and used[a] == {True} for a in angles) and (
        max(_angle_columns(program), default=0) < ARRAYS_IN_REGISTERS
    )


def _runs(machine: Machine) -> bool:
    avx2 = "+avx2" in machine.features.split(",") or machine.cpu == "x86-64-v3"
    known = machine.triple.startswith("x86_64") and "windows" not in machine.triple
    return known and avx2 and machine.fused and machine.vector_bits == 256


def _prefix(machine: Machine) -> str:
    """What the linker's names begin with."""
    return "_" if "apple" in machine.triple or "darwin" in machine.triple else ""


def module(program: Program, precision: Precision, machine: Machine, name: str) -> str:
    """LLVM assembly of the module; ``name`` is that of the loop."""
    lanes, packed = machine.lanes(precision), len(program.results) > WIDE
    columns, frame = _angle_columns(program), Frame(program, len(program.instructions))
    code = Selection(program, precision, packed=packed).code
    checked = {k: program.inputs[k].size for k in columns}
    lines, vectors = allocated(code, precision, checked, len(program.results) if packed else 0, _prefix(machine))
    w = Writer(precision, lanes)
    _block(w, program, columns, packed)
    arrays = len(program.inputs) + len(program.outputs)
    arguments = ", ".join(f"ptr noalias %a{k}" for k in range(arrays))
    types = ", ".join(["ptr"] * (arrays + 1))
    e = w.element
    return "\n".join(
        [
            *(f'module asm "{line}"' for line in lines),
            f"declare {e} @llvm.fabs.f{precision.bits}({e})",
            *(f"declare double @{f}({', '.join(['double'] * n)})" for f, n in (("sin", 1), ("cos", 1), ("atan2", 2))),
            "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
            *(f"declare i32 @{f}({types})" for f in ("straight", "in_reach")),
            wrapper(precision, lanes),
            preparation(frame.constants if packed else (), precision, machine),
            f"define internal void @block({arguments}, ptr noalias %frame) noinline {{\nentry:",
            *w.lines,
            "  ret void\n}\n",
            loop(name, program, precision, lanes, max(vectors, 1) * lanes * precision.bytes),
        ]
    )


def _angle_columns(program: Program) -> dict[int, list[int]]:
    """Which columns of which inputs are angles."""
    taken = {i.args[0] for i in program.instructions if i.op in ("sin", "cos")}
    elements = [(k, c) for k, port in enumerate(program.inputs) for c in range(port.size)]
    columns: dict[int, list[int]] = {}
    for number in sorted(int(program.instructions[t].value) for t in taken):
        k, c = elements[number]
        columns.setdefault(k, []).append(c)
    return columns


def _block(w: Writer, program: Program, columns: dict[int, list[int]], packed: bool) -> None:
    """Call the straight code; if an angle is huge, on a copy whose huge angles are replaced. Then rows, where that is left."""
    inputs = len(program.inputs)
    places = [f"%a{k}" for k in range(inputs + len(program.outputs))]
    label = "entry"
    if columns:
        huge = w.new(f"icmp ne i32 {_call(w, 'straight', places)}, 0")
        w.do(f'br i1 {huge}, label %far, label %near, !prof !{{!"branch_weights", i32 1, i32 100000}}')
        w.begin("far")
        replaced = [_in_reach(w, p, program.inputs[k].size, columns[k]) if k in columns else p for k, p in enumerate(places)]
        _call(w, "in_reach", replaced)
        w.do("br label %near")
        w.begin("near")
        label = "near"
    else:
        _call(w, "in_reach", places)
    entry = 0
    for k, port in enumerate(program.outputs if packed else (), start=inputs):
        label = frame_to_rows(w, places[k], port.size, entry, label)
        entry += port.size


def _call(w: Writer, name: str, places: Sequence[str]) -> str:
    return w.new(f"call i32 @{name}({', '.join(f'ptr {p}' for p in ('%frame', *places))})")


def _in_reach(w: Writer, source: str, size: int, columns: Sequence[int]) -> str:
    """A copy of ``lanes`` rows with the huge angles among those columns replaced by their equals."""
    bytes_each = w.precision.bytes
    copy = w.new(f"alloca [{size * w.lanes} x {w.element}], align 64")
    w.do(f"call void @llvm.memcpy.p0.p0.i64(ptr {copy}, ptr {source}, i64 {size * w.lanes * bytes_each}, i1 false)")
    for c in columns:
        cells = [w.at(copy, (row * size + c) * bytes_each) for row in range(w.lanes)]
        vector = "poison"
        for row, cell in enumerate(cells):
            x = w.new(f"load {w.element}, ptr {cell}, align {bytes_each}")
            vector = w.new(f"insertelement {w.vector} {vector}, {w.element} {x}, i32 {row}")
        vector = w.new(f"call {w.vector} @wrap.{w.suffix}({w.vector} {vector})")
        for row, cell in enumerate(cells):
            x = w.new(f"extractelement {w.vector} {vector}, i32 {row}")
            w.do(f"store {w.element} {x}, ptr {cell}, align {bytes_each}")
    return copy
