"""The module around a block of AVX2 code: the check for huge angles, the rows of wide results, the loop NumPy calls.

The code is a function of the arrays' places without a branch; a frame comes before them, for what finds no register.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..program.program import Program
from .avx2 import OPERATIONS, Selection
from .avx2_text import ARRAYS_IN_REGISTERS, written
from .batch_loop import Loop, loop
from .lanes import RowStorer
from .llvm_text import LlvmWriter
from .processor import Machine, Precision
from .sincos import wrapper
from .spill_frame import SpillFrame
from .spill_frame_text import frame_to_rows, preparation, zero_tiles

WIDE = 100
"""With more entries of results than this, the code leaves them in the frame, and a loop makes rows of them, tile by tile:
straight-line code for the tiles would be longer than the first cache, and stores to few lines at a time are faster."""

MOST_IN_GROUP, FRAMES = 8, 200_000
"""Code in several parts does not fit the first cache: blocks take turns in a part, as long as their frames fit the second."""

SMALL = 2.0**14
"""Angles up to here are reduced as they are, in float32 too."""

UNLIKELY = '!prof !{!"branch_weights", i32 1, i32 100000}'


def serves(program: Program, machine: Machine) -> bool:
    """Whether this emitter can be asked: on this processor, for this program.

    An x86-64 with AVX2 and FMA under the System V calling convention, and a program whose angles are plain inputs that are
    nothing but angles, or are clipped to numbers that need no look.
    """
    used: dict[int, set[bool]] = {}
    for op, args, _ in program.instructions:
        if op not in OPERATIONS:
            return False
        for a in args:
            used.setdefault(a, set()).add(op in ("sin", "cos"))
    for result in program.results:
        used.setdefault(result, set()).add(False)
    angles = [a for a, ways in used.items() if True in ways]
    return (
        runs(machine)
        and all(
            used[a] == {True} if program.instructions[a].op == "input" else _is_within_reach(program, a) for a in angles
        )
        and (max(_angle_columns(program), default=0) < ARRAYS_IN_REGISTERS)
    )


def _is_within_reach(program: Program, angle: int) -> bool:
    """Whether a value is clipped to no more than ``SMALL``."""
    limits = []
    for op in ("max", "min"):
        found = program.instructions[angle]
        if found.op != op or program.instructions[found.args[0]].op != "const":
            return False
        limits.append(program.instructions[found.args[0]].value)
        angle = found.args[1]
    return -SMALL <= limits[0] <= limits[1] <= SMALL


def runs(machine: Machine) -> bool:
    """Whether a processor runs such code, and is no better off with vectors of another length."""
    avx2 = "+avx2" in machine.features.split(",") or machine.cpu == "x86-64-v3"
    known = machine.triple.startswith("x86_64") and "windows" not in machine.triple
    return known and avx2 and machine.fused and machine.vector_bits == 256


def _prefix(machine: Machine) -> str:
    """What the linker's names begin with."""
    return "_" if "apple" in machine.triple or "darwin" in machine.triple else ""


def module(program: Program, precision: Precision, machine: Machine, name: str, around: Loop = loop) -> str:
    """LLVM assembly of the module; ``name`` is that of the loop, which ``around`` makes."""
    lanes, packed = machine.lanes(precision), len(program.results) > WIDE
    columns, frame = _angle_columns(program), SpillFrame(program, len(program.instructions))
    code = Selection(program, precision, packed=packed).code
    checked = {k: program.inputs[k].size for k in columns}
    lines, parts, vectors = written(code, precision, checked, len(program.results) if packed else 0, _prefix(machine))
    size = max(vectors, 1) * lanes * precision.bytes
    group = _group(parts, size)
    arrays = [f"%a{k}" for k in range(len(program.inputs) + len(program.outputs))]
    types = ", ".join(["ptr"] * (len(arrays) + 1))
    made = _Blocks(program, precision, lanes, columns, parts, size, group, packed)
    e = made.w.element
    return "\n".join(
        [
            *(f'module asm "{line}"' for line in lines),
            f"declare {e} @llvm.fabs.f{precision.bits}({e})",
            *(f"declare double @{f}({', '.join(['double'] * n)})" for f, n in (("sin", 1), ("cos", 1), ("atan2", 2))),
            "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
            f"declare i32 @look({types})",
            *(f"declare void @part{k}({types})" for k in range(parts)),
            wrapper(precision, lanes),
            preparation(LlvmWriter(precision, lanes), frame.constants if packed else (), "prepare_one"),
            made.prepare(),
            made.rows() if packed else "",
            made.one(),
            made.several() if group > 1 else "",
            around(name, program, precision, lanes, size * group, group),
        ]
    )


def _group(parts: int, frame: int) -> int:
    """Blocks that take turns in one part before the next: as many as have their frames in the second cache."""
    return 1 if parts == 1 else max(1, min(MOST_IN_GROUP, FRAMES // frame))


def _angle_columns(program: Program) -> dict[int, list[int]]:
    """Which columns of which inputs are angles."""
    taken = {i.args[0] for i in program.instructions if i.op in ("sin", "cos")}
    taken = {t for t in taken if program.instructions[t].op == "input"}
    elements = [(k, c) for k, port in enumerate(program.inputs) for c in range(port.size)]
    columns: dict[int, list[int]] = {}
    for number in sorted(int(program.instructions[t].value) for t in taken):
        k, c = elements[number]
        columns.setdefault(k, []).append(c)
    return columns


class _Blocks:
    """The functions that call the parts: of one block, and of several whose parts take turns."""

    def __init__(
        self, program: Program, precision: Precision, lanes: int, columns: dict[int, list[int]], parts: int, frame: int,
        group: int, packed: bool,
    ) -> None:  # fmt: skip
        self.program, self.columns, self.parts, self.frame, self.packed = program, columns, parts, frame, packed
        self.precision, self.lanes, self.group = precision, lanes, group
        self.ports = [*program.inputs, *program.outputs]
        self.arrays = [f"%a{k}" for k in range(len(self.ports))]
        self.w = LlvmWriter(precision, lanes)

    def _defined(self, name: str) -> str:
        arguments = ", ".join(f"ptr noalias {a}" for a in self.arrays)
        body = "\n".join(self.w.lines)
        self.w = LlvmWriter(self.precision, self.lanes)
        return f"define internal void @{name}({arguments}, ptr noalias %frame) noinline {{\nentry:\n{body}\n  ret void\n}}\n"

    def one(self) -> str:
        """``@block``: if an angle is huge, on a copy whose huge angles are replaced."""
        w = self.w
        if self.columns:
            w.do(f"br i1 {self._huge(self.arrays, '%frame')}, label %far, label %near, {UNLIKELY}")
            w.begin("far")
            places = [
                _in_reach(w, a, port.size, self.columns[k]) if k in self.columns else a
                for k, (a, port) in enumerate(zip(self.arrays, self.ports, strict=True))
            ]
            self._call_parts(places)
            w.do("br label %made")
            w.begin("near")
            self._call_parts(self.arrays)
            w.do("br label %made")
            w.begin("made")
        else:
            self._call_parts(self.arrays)
        self._call_rows(self.arrays, "%frame")
        return self._defined("block")

    def several(self) -> str:
        """``@blocks``: part by part, each for all blocks; block by block where an angle of one is huge."""
        w = self.w
        moved = [self._moved(k) for k in range(self.group)]
        if self.columns:
            some = self._huge(*moved[0])
            for places in moved[1:]:
                some = w.new(f"or i1 {some}, {self._huge(*places)}")
            w.do(f"br i1 {some}, label %far, label %near, {UNLIKELY}")
            w.begin("far")
            for arrays, _ in moved:
                w.do(f"call void @block({_pointers([*arrays, '%frame'])})")
            w.do("ret void")
            w.begin("near")
        for k in range(self.parts):
            for arrays, frame in moved:
                w.do(f"call void @part{k}({_pointers([frame, *arrays])})")
        for arrays, frame in moved:
            self._call_rows(arrays, frame)
        return self._defined("blocks")

    def _moved(self, k: int) -> tuple[list[str], str]:
        """The arrays and the frame of block k of a group."""
        w = self.w
        rows = k * w.lanes * w.precision.bytes
        arrays = [w.at(a, port.size * rows) for a, port in zip(self.arrays, self.ports, strict=True)]
        return arrays, w.at("%frame", k * self.frame)

    def _huge(self, arrays: Sequence[str], frame: str) -> str:
        return self.w.new(f"icmp ne i32 {self.w.new(f'call i32 @look({_pointers([frame, *arrays])})')}, 0")

    def _call_parts(self, arrays: Sequence[str]) -> None:
        for k in range(self.parts):
            self.w.do(f"call void @part{k}({_pointers(['%frame', *arrays])})")

    def _call_rows(self, arrays: Sequence[str], frame: str) -> None:
        if self.packed:
            self.w.do(f"call void @rows({_pointers([*arrays, frame])})")

    def rows(self) -> str:
        """``@rows``: rows of the entries in the frame."""
        entry, label, tables, zero = 0, "entry", [], self.program.zeros
        for k, port in enumerate(self.program.outputs):
            span = RowStorer(self.w, "", port.size).span
            table = zero_tiles(f"zeros{k}", zero[entry : entry + port.size], span)
            tables.append(table)
            array = self.arrays[len(self.program.inputs) + k]
            name = f"zeros{k}" if table else ""
            label = frame_to_rows(self.w, array, port.size, entry, label, name)
            entry += port.size
        return "\n".join([*tables, self._defined("rows")])

    def prepare(self) -> str:
        """``@prepare``: every frame of a group."""
        calls = [f"call void @prepare_one(ptr {self.w.at('%frame', k * self.frame)})" for k in range(self.group)]
        for call in calls:
            self.w.do(call)
        body = "\n".join(self.w.lines)
        self.w = LlvmWriter(self.precision, self.lanes)
        return f"define internal void @prepare(ptr %frame) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


def _pointers(places: Sequence[str]) -> str:
    return ", ".join(f"ptr {p}" for p in places)


def _in_reach(w: LlvmWriter, source: str, size: int, columns: Sequence[int]) -> str:
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
