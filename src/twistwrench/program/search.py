"""A program taken again and again until it says that it is there, from one start after the other: a search.

The loop is part of the kernel. An attempt begins at a start and ends when the program says so, or after as many times as the
settings allow; the next begins at the nearest of the places that are left. The first attempt that gets there is the answer,
else the one that comes nearest. So what is found for a sample depends on no other sample, nor on how many of its attempts are
made side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from .port import Port, signature_of
from .program import Program

PLACES = 64
"""Starts that a table has, beside the first."""

TIMES, ATTEMPTS, ALLOWED = 0, 1, 2
"""Where the settings say how often the program is taken in an attempt at most, and how often to start again; what the program
is given of them begins at the third."""


@dataclass(frozen=True)
class Search:
    """A program whose inputs are x, x once more, what is passed on, and what is given: the target and what is allowed of it.

    Its results are the next x, and what is passed on: the best x so far; what is said of it, first whether it is there (1; -1
    where there is nothing to look for) and what it costs; how long nothing got nearer; and last whether it goes on.
    """

    program: Program
    target: Port
    """What is looked for."""
    near: tuple[int, ...]
    """The entries of the target by which places are near: sums of squares, each with its own weight."""
    begins: tuple[float, ...]
    """What is passed on to the first step, after x."""
    least: tuple[float, ...]
    """What the entries of x are at least, as an attempt begins."""
    most: tuple[float, ...]
    """What they are at most."""

    @property
    def x(self) -> Port:
        """What is moved."""
        return self.program.outputs[0]

    @property
    def said(self) -> Port:
        """How many starts it took, and what the program says of the best x."""
        return Port("said", (self.program.outputs[1].size - self.x.size - 1,))

    @property
    def settings(self) -> Port:
        """How often, how many, what is allowed, and the weights."""
        given = self.program.inputs[-1].size - self.target.size
        return Port("settings", (ALLOWED + given + len(self.near),))

    @property
    def inputs(self) -> tuple[Port, ...]:
        """What the kernel takes: the target, the first start, the settings, and the places with the targets they lead to."""
        size, many = self.x.size, len(self.near)
        tables = Port("places", (PLACES, size)), Port("reached", (many, PLACES))
        return self.target, Port("start", (size,)), self.settings, *tables

    @property
    def outputs(self) -> tuple[Port, ...]:
        """What the kernel returns."""
        return self.x, self.said

    @cached_property
    def signature(self) -> str:
        """The gufunc signature."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])
