"""A long program as several functions, a section each, in modules of a few: compiled in linear time and memory.

What crosses from a section to a later one, and all entries of the results, go through a :class:`~.frame.Frame`; once the last
section is done, rows of the results are made of it, tile by tile, in a loop. Instructions and their order stay the same, so
results keep their bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from ..program.program import Program
from ..program.recurrence import Recurrence
from .frame import Frame
from .llvm import CUT_OUTPUTS, LOOP, Emitter, assembly, declarations
from .loop import Loop, loop
from .machine import Machine, Precision
from .rows import RowStorer
from .sincos import wrapper
from .steps import loop_over
from .writer import Writer

__all__ = ["modules"]

LONG = 2000
"""Programs beyond this many instructions are emitted in sections; from here on they run faster, too (bench/NOTES.md)."""

SECTION = 400
"""Instructions in a section, about."""

EACH = 25
"""Sections in a module."""


def modules(given: Program | Recurrence, precision: Precision, machine: Machine) -> Iterator[str]:
    """The texts to compile and to link together; one, unless the program is long."""
    from . import avx2_module

    program, around = (given.program, loop_over(given)) if isinstance(given, Recurrence) else (given, loop)

    if avx2_module.serves(program, machine):
        yield avx2_module.module(program, precision, machine, LOOP, around)
        return
    if len(program.instructions) <= LONG:
        yield assembly(program, precision, machine, around)
        return
    frame = Frame(program, SECTION)
    yield _head(frame, precision, machine, around)
    sections = list(enumerate(pairwise(frame.starts)))
    for k in range(0, len(sections), EACH):
        w = _writer(precision, machine)
        parts = [_section(frame, precision, machine, *section) for section in sections[k : k + EACH]]
        yield "\n".join([declarations(w), wrapper(precision, w.lanes), *parts])


def _writer(precision: Precision, machine: Machine) -> Writer:
    return Writer(precision, machine.lanes(precision), fused=machine.fused)


def _at(w: Writer, home: int | str) -> str:
    """The place of a vector of the frame."""
    size = w.lanes * w.precision.bytes
    return w.at("%frame", home * size if isinstance(home, int) else w.new(f"mul i64 {home}, {size}"))


def _load(w: Writer, home: int | str) -> str:
    return w.new(f"load {w.vector}, ptr {_at(w, home)}, align {w.lanes * w.precision.bytes}")


def _store(w: Writer, value: str, home: int | str) -> None:
    w.do(f"store {w.vector} {value}, ptr {_at(w, home)}, align {w.lanes * w.precision.bytes}")


# ── the loop, and what it calls ──


def _head(frame: Frame, precision: Precision, machine: Machine, around: Loop) -> str:
    """The loop, the preparation of the frame, and the block, which calls the sections and then makes rows."""
    w = _writer(precision, machine)
    inputs, ports = len(frame.program.inputs), len(frame.program.inputs) + len(frame.program.outputs)
    given = ", ".join(f"ptr %a{k}" for k in range(inputs))
    sections = len(frame.starts) - 1
    for k in range(sections):
        w.do(f"call void @section{k}({given}, ptr %frame)")
    entry, label = 0, "entry"
    for k, port in enumerate(frame.program.outputs, start=inputs):
        label = frame_to_rows(w, f"%a{k}", port.size, entry, label)
        entry += port.size
    arguments = ", ".join(f"ptr noalias %a{k}" for k in range(ports))
    types = ", ".join(["ptr"] * (inputs + 1))
    body = "\n".join(w.lines)
    return "\n".join(
        [
            *(f"declare void @section{k}({types})" for k in range(sections)),
            preparation(frame.constants, precision, machine),
            f'define internal void @block({arguments}, ptr noalias %frame) noinline "stackrealign" {{\nentry:\n{body}',
            "  ret void\n}\n",
            around(LOOP, frame.program, precision, w.lanes, frame.size * w.lanes * precision.bytes, 1, False),
        ]
    )


def frame_to_rows(
    w: Writer, base: str, columns: int, entry: int, label: str, zeros: str = "", *, streamed: bool = False
) -> str:
    """Make rows of the vectors from ``entry`` on: tiles in a loop, then the last, which ends with the row.

    Takes the label control comes from and returns the one it is in afterwards. ``zeros``: a table as :func:`zero_tiles` makes.
    ``streamed``: as of :class:`.rows.RowStorer`.
    """
    whole = RowStorer(w, base, columns)
    if not whole.starts:  # too narrow for tiles
        for c in range(columns):
            whole.put(c, _load(w, entry + c))
        return label
    with w.loop(str(columns // whole.span), label) as tile:
        first = w.new(f"mul i64 {tile}, {whole.span}")
        if zeros:
            full, empty, stored = w.label("full"), w.label("empty"), w.label("stored")
            nothing = w.new(f"load i1, ptr {w.at(f'@{zeros}', tile)}, align 1")
            w.do(f"br i1 {nothing}, label %{empty}, label %{full}")
            w.begin(empty)
            place = w.at(base, w.new(f"mul i64 {first}, {w.precision.bytes}"))
            RowStorer(w, place, columns, streamed=streamed).clear()
            w.do(f"br label %{stored}")
            w.begin(full)
        _tile(w, base, columns, first, w.new(f"add i64 {first}, {entry}"), streamed)
        if zeros:
            w.do(f"br label %{stored}")
            w.begin(stored)
    label = w.after
    if columns % whole.span:
        last = columns - whole.span
        _tile(w, base, columns, str(last), w.new(f"add i64 0, {entry + last}"), streamed)
    return label


def zero_tiles(name: str, frame: Frame, columns: int, entry: int, span: int) -> str:
    """A table of which tiles of a row are all zeros; empty if none is."""
    instructions, results = frame.program.instructions, frame.program.results[entry : entry + columns]
    zero = [instructions[r].op == "const" and instructions[r].value == 0.0 for r in results]
    tiles = [all(zero[k : k + span]) for k in range(0, columns - span + 1, span)]
    if not any(tiles):
        return ""
    return f"@{name} = internal constant [{len(tiles)} x i8] [{', '.join(f'i8 {int(t)}' for t in tiles)}]"


def _tile(w: Writer, base: str, columns: int, first: str, entry: str, streamed: bool = False) -> None:
    place = w.at(base, w.new(f"mul i64 {first}, {w.precision.bytes}"))
    storer = RowStorer(w, place, columns, streamed=streamed)
    for c in range(storer.span):
        storer.put(c, _load(w, w.new(f"add i64 {entry}, {c}")))


def preparation(
    constants: Sequence[tuple[int, int, float]], precision: Precision, machine: Machine, name: str = "prepare"
) -> str:
    """Put constant entries of the results into the frame; the blocks of a call leave them alone."""
    w, label = _writer(precision, machine), "entry"
    for first, count, value in constants:
        with w.loop(str(count), label) as k:
            _store(w, w.splat(value), w.new(f"add i64 {k}, {first}"))
        label = w.after
    body = "\n".join(w.lines)
    return f"define internal void @{name}(ptr %frame) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


# ── one section ──


def _section(frame: Frame, precision: Precision, machine: Machine, number: int, bounds: tuple[int, int]) -> str:
    w = _writer(precision, machine)
    _Section(w, frame).walk(*bounds, frame.entries, large=False)
    arguments = ", ".join(f"ptr noalias %a{k}" for k in range(len(frame.program.inputs)))
    body = "\n".join(w.lines)
    head = f'define void @section{number}({arguments}, ptr noalias %frame) noinline "stackrealign"'
    return f"{head} {{\nentry:\n{body}\n  ret void\n}}\n"


class _Section(Emitter):
    """An emitter that finds values of earlier sections in the frame, and leaves there what later ones need."""

    def __init__(self, w: Writer, frame: Frame) -> None:
        super().__init__(w, frame.program)
        self.frame, self.stored = frame, 0

    def meet(self, number: int) -> None:
        """Leave an input until it is used; a later section may be the first to."""

    def value(self, number: int) -> str:
        """The vector of an instruction, from where it is."""
        op, _, value = self.program.instructions[number]
        if op != "const" and number not in self.values:
            self.values[number] = self.input(int(value)) if op == "input" else _load(self.w, self.frame.homes[number])
        return super().value(number)

    def made(self, number: int, value: str) -> None:
        """Take the vector of an instruction; as an entry of the results it comes into the frame anyway."""
        super().made(number, value)
        if number in self.frame.homes and number not in self.frame.entries:
            _store(self.w, value, self.frame.homes[number])

    def output(self, number: int, value: str) -> None:
        """Put an entry of the results into the frame."""
        _store(self.w, value, number)
        self.stored += 1
        if self.stored % CUT_OUTPUTS == 0:
            self.cut()
