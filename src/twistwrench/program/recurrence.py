"""A program taken again and again: its results are its inputs the next time, for as many steps as are asked for.

The loop over the steps is part of the kernel. Its signature has two sizes of its own: ``(k)`` steps are taken, and every
k/m-th state is kept, in ``(m)`` rows. The states at the beginning go in once; whatever else goes in may differ from step to
step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from .port import Port, signature_of
from .program import Program

STEPS, KEPT = "k", "m"
"""The names of the two sizes in the signature."""


@dataclass(frozen=True)
class Source:
    """Where an input of the program comes from.

    ``"state"``: what result number ``state`` was the last time. ``"start"``: what it was when the step began, for programs that
    are taken several times a step. ``"stage"``: the row of the table for this time. ``"given"``: an array of the caller's.
    """

    kind: str
    state: int = 0


@dataclass(frozen=True)
class Recurrence:
    """A program, what its inputs are, and how often it is taken in a step.

    The first ``visible`` results are the state; ``hidden`` ones follow, which are zero at the beginning and nobody sees. What
    remains is said of a step as it begins: the torques applied, for example.
    """

    program: Program
    sources: tuple[Source, ...]
    visible: int
    hidden: int = 0
    table: tuple[tuple[float, ...], ...] = ((),)
    """A row for each time that the program is taken in a step."""

    @property
    def states(self) -> tuple[Port, ...]:
        """The results that are fed back, hidden ones last."""
        return self.program.outputs[: self.visible + self.hidden]

    @property
    def given(self) -> tuple[int, ...]:
        """The numbers of the inputs that the caller gives for each step."""
        return tuple(k for k, source in enumerate(self.sources) if source.kind == "given")

    @property
    def said(self) -> tuple[int, ...]:
        """The numbers of the results that are said of a step as it begins."""
        return tuple(range(self.visible + self.hidden, len(self.program.outputs)))

    @property
    def inputs(self) -> tuple[Port, ...]:
        """What the kernel takes, one step of it: first states, then what is given for each step."""
        return (*self.program.outputs[: self.visible], *(self.program.inputs[k] for k in self.given))

    @property
    def outputs(self) -> tuple[Port, ...]:
        """What the kernel returns, one row of it: states, then what is said of steps."""
        return (*self.program.outputs[: self.visible], *(self.program.outputs[k] for k in self.said))

    @cached_property
    def signature(self) -> str:
        """The gufunc signature, as in ``(7),(7),(k,7)->(m,7),(m,7)``."""
        ins: list[Sequence[int | str]] = [port.shape for port in self.inputs[: self.visible]]
        ins += [(STEPS, *port.shape) for port in self.inputs[self.visible :]]
        return signature_of(ins, [(KEPT, *port.shape) for port in self.outputs])
