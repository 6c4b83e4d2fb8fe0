"""A long program as several functions, a section each, in modules of a few: compiled in linear time and memory.

What crosses from a section to a later one, and all entries of the results, go through a :class:`~.frame.SpillFrame`; once the
last section is done, rows of the results are made of it, tile by tile, in a loop. Instructions and their order stay the
same, so results keep their bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from ..program.program import Program
from .batch_loop import Loop
from .llvm import CUT_OUTPUTS, LOOP, Emitter, declarations
from .llvm_text import LlvmWriter
from .processor import Machine, Precision
from .sincos import wrapper
from .spill_frame import SpillFrame
from .spill_frame_text import frame_to_rows, load_home, preparation, store_home

SECTION = 400
"""Instructions in a section, about."""

EACH = 25
"""Sections in a module."""


def in_sections(program: Program, precision: Precision, machine: Machine, around: Loop) -> Iterator[str]:
    """The texts of the modules to compile and to link together."""
    frame = SpillFrame(program, SECTION)
    yield _head(frame, precision, machine, around)
    sections = list(enumerate(pairwise(frame.starts)))
    for k in range(0, len(sections), EACH):
        w = _writer(precision, machine)
        parts = [_section(frame, precision, machine, *section) for section in sections[k : k + EACH]]
        yield "\n".join([declarations(w), wrapper(precision, w.lanes), *parts])


def _writer(precision: Precision, machine: Machine) -> LlvmWriter:
    return LlvmWriter(precision, machine.lanes(precision), fused=machine.fused)


# ── the loop, and what it calls ──


def _head(frame: SpillFrame, precision: Precision, machine: Machine, around: Loop) -> str:
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
            preparation(_writer(precision, machine), frame.constants),
            f'define internal void @block({arguments}, ptr noalias %frame) noinline "stackrealign" {{\nentry:\n{body}',
            "  ret void\n}\n",
            around(LOOP, frame.program, precision, w.lanes, frame.size * w.lanes * precision.bytes, 1, False),
        ]
    )


# ── one section ──


def _section(frame: SpillFrame, precision: Precision, machine: Machine, number: int, bounds: tuple[int, int]) -> str:
    w = _writer(precision, machine)
    _Section(w, frame).walk(*bounds, frame.entries, large=False)
    arguments = ", ".join(f"ptr noalias %a{k}" for k in range(len(frame.program.inputs)))
    body = "\n".join(w.lines)
    head = f'define void @section{number}({arguments}, ptr noalias %frame) noinline "stackrealign"'
    return f"{head} {{\nentry:\n{body}\n  ret void\n}}\n"


class _Section(Emitter):
    """An emitter that finds values of earlier sections in the frame, and leaves there what later ones need."""

    def __init__(self, w: LlvmWriter, frame: SpillFrame) -> None:
        super().__init__(w, frame.program)
        self.frame, self.stored = frame, 0

    def meet(self, number: int) -> None:
        """Leave an input until it is used; a later section may be the first to."""

    def value(self, number: int) -> str:
        """The vector of an instruction, from where it is."""
        op, _, value = self.program.instructions[number]
        if op != "const" and number not in self.values:
            self.values[number] = (
                self.input(int(value)) if op == "input" else load_home(self.w, self.frame.homes[number])
            )
        return super().value(number)

    def made(self, number: int, value: str) -> None:
        """Take the vector of an instruction; as an entry of the results it comes into the frame anyway."""
        super().made(number, value)
        if number in self.frame.homes and number not in self.frame.entries:
            store_home(self.w, value, self.frame.homes[number])

    def output(self, number: int, value: str) -> None:
        """Put an entry of the results into the frame."""
        store_home(self.w, value, number)
        self.stored += 1
        if self.stored % CUT_OUTPUTS == 0:
            self.cut()
