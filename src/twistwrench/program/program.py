"""A program: straight-line instructions in order, no loops, no branches, every rounding explicit."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from .port import Port, signature_of

FUSED = {"fma": (1, 1), "fms": (1, -1), "fnma": (-1, 1), "fnms": (-1, -1)}
"""The fused products: ``fma`` is a b + c; the two signs are those of the product and of c. One rounding each."""

ARITY = {
    "const": 0, "input": 0, "add": 2, "sub": 2, "mul": 2, "div": 2, "neg": 1,
    "sqrt": 1, "sin": 1, "cos": 1, "sign": 1, "exp": 1, "min": 2, "max": 2, **dict.fromkeys(FUSED, 3),
}  # fmt: skip
"""Every operation there is, and how many operands it takes.

``min`` is a if a < b, else b, and ``max`` a if a > b, else b, as processors have it: the second of two that do not compare.
"""


class Instruction(NamedTuple):
    """One operation on earlier results. ``value`` is a constant's value or an input's number."""

    op: str
    args: tuple[int, ...]
    value: float


@dataclass(frozen=True, repr=False)
class Program:
    """What a kernel computes for one sample.

    Input elements are numbered through all input ports in C order; ``results`` gives, for every output element in the same
    order, the number of the instruction that makes it.
    """

    instructions: tuple[Instruction, ...]
    """The operations, each of earlier results."""
    results: tuple[int, ...]
    """Number of the instruction that makes each output element, in C order."""
    inputs: tuple[Port, ...]
    """Names and shapes of the inputs."""
    outputs: tuple[Port, ...]
    """Names and shapes of the outputs."""

    def __repr__(self) -> str:
        ends = (", ".join(port.name for port in ports) for ports in (self.inputs, self.outputs))
        return f"<Program {' → '.join(ends)}, {self.signature}: {len(self.instructions)} instructions>"

    def counts(self) -> dict[str, int]:
        """Operation counts: how often each operation occurs; constants and inputs left out.

        Returns
        -------
        counts : {operation: int}

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.pendulum().program("gravity_forces").counts()
        {'sin': 1, 'mul': 1}
        """
        return dict(Counter(i.op for i in self.instructions if ARITY[i.op]))

    @property
    def flops(self) -> int:
        """Additions, multiplications and divisions; a fused product counts two, sines and cosines are not counted."""
        c = self.counts()
        return sum(c.get(op, 0) for op in ("add", "sub", "mul", "div")) + 2 * sum(c.get(op, 0) for op in FUSED)

    @property
    def multiplications(self) -> int:
        """Operations of the multiplier: products, fused ones included."""
        c = self.counts()
        return c.get("mul", 0) + sum(c.get(op, 0) for op in FUSED)

    @cached_property
    def zeros(self) -> tuple[bool, ...]:
        """Of each element of the outputs whether it is zero, whatever the inputs."""
        made = (self.instructions[result] for result in self.results)
        return tuple(x.op == "const" and x.value == 0.0 for x in made)

    @cached_property
    def digest(self) -> str:
        """A hash of everything the program computes; equal programs have equal digests, in every process."""
        import hashlib

        state = hashlib.sha256(repr((self.inputs, self.outputs, self.results)).encode())
        for op, args, value in self.instructions:
            state.update(f"{op}{args}{value!r}\n".encode())
        return state.hexdigest()

    @property
    def signature(self) -> str:
        """The gufunc signature with the program's own sizes, as in ``(7),(7)->(7,7)``."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])
