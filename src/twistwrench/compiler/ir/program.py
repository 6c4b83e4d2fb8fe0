"""Programs: instructions in one line, without loops and branches, with explicit rounding; shapes and gufunc signatures."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple


class TensorSpec(NamedTuple):
    """Name and shape of an input or output array."""

    name: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


def signature_of(inputs: Sequence[TensorSpec], outputs: Sequence[TensorSpec]) -> str:
    """Gufunc signature of inputs and outputs, as in ``(7),(7)->(7,7)``."""
    return gufunc_signature([spec.shape for spec in inputs], [spec.shape for spec in outputs])


def gufunc_signature(inputs: Sequence[Sequence[int | str]], outputs: Sequence[Sequence[int | str]]) -> str:
    """Gufunc signature from the shape of each operand, whose sizes may be names, as in ``(7),(k,7)->(m,7)``."""
    return f"{_operand_texts(inputs)}->{_operand_texts(outputs)}"


def _operand_texts(operands: Sequence[Sequence[int | str]]) -> str:
    """Sizes of several operands as text, as in ``(7),(7,7)``."""
    texts = []
    for sizes in operands:
        joined = ",".join(map(str, sizes))
        texts.append(f"({joined})")
    return ",".join(texts)


@cache
def axes_of(signature: str) -> list[list[int]]:
    """For each axis of each operand, the index of its size in the array ``dims`` of a compiled loop.

    Index 0 is the number of samples. Sizes that are equal in the signature share an index; indices are in the order of
    first appearance.

    >>> axes_of("(7),(k,7)->(m,7)")
    [[1], [2, 1], [3, 1]]
    """
    position_of_size: dict[str, int] = {}
    positions_by_operand = []
    for shape_text in re.findall(r"\(([^)]*)\)", signature):
        sizes = re.findall(r"\w+", shape_text)
        for size in sizes:
            position_of_size.setdefault(size, 1 + len(position_of_size))
        positions_by_operand.append([position_of_size[size] for size in sizes])
    return positions_by_operand


FUSED = {"fma": (1, 1), "fms": (1, -1), "fnma": (-1, 1), "fnms": (-1, -1)}
"""Fused products a b + c with one rounding: signs of the product and of c."""

ARITY = {
    "const": 0, "input": 0, "add": 2, "sub": 2, "mul": 2, "div": 2, "neg": 1,
    "sqrt": 1, "sin": 1, "cos": 1, "sign": 1, "exp": 1, "min": 2, "max": 2, **dict.fromkeys(FUSED, 3),
}  # fmt: skip
"""Number of operands of every operation.

``min`` is a if a < b, else b; ``max`` is a if a > b, else b. If an operand is NaN, the result is the second one, as in
processors.
"""


_FLOPS_OF_OPERATION = {"add": 1, "sub": 1, "mul": 1, "div": 1, **dict.fromkeys(FUSED, 2)}
"""Number of floating-point operations of each operation; operations that are not listed count as none."""


class Instruction(NamedTuple):
    """Operation on results of earlier instructions."""

    op: str
    """Name of the operation, one of :data:`ARITY`."""
    args: tuple[int, ...]
    """Numbers of the instructions that compute the operands."""
    value: float
    """Value of a constant, or number of an input."""


@dataclass(frozen=True, repr=False)
class Program:
    """Computation of a kernel for one sample.

    Input elements are numbered through all inputs in C order. ``results`` has the number of the instruction that computes each
    output element, in the same order.
    """

    instructions: tuple[Instruction, ...]
    """Instructions, each on earlier results."""
    results: tuple[int, ...]
    """Number of the instruction that computes each output element, in C order."""
    inputs: tuple[TensorSpec, ...]
    """Names and shapes of the inputs."""
    outputs: tuple[TensorSpec, ...]
    """Names and shapes of the outputs."""

    def __repr__(self) -> str:
        input_names = ", ".join(spec.name for spec in self.inputs)
        output_names = ", ".join(spec.name for spec in self.outputs)
        return f"<Program {input_names} → {output_names}, {self.signature}: {len(self.instructions)} instructions>"

    def counts(self) -> dict[str, int]:
        """Number of occurrences of each operation, without constants and inputs.

        Returns
        -------
        counts : {operation: int}

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.pendulum().program("gravity_forces").counts()
        {'sin': 1, 'mul': 1}
        """
        operations = [instruction.op for instruction in self.instructions if ARITY[instruction.op] > 0]
        return dict(Counter(operations))

    @property
    def flops(self) -> int:
        """Number of additions, multiplications and divisions; a fused product counts two, sines and cosines are not counted."""
        return sum(_FLOPS_OF_OPERATION.get(op, 0) * count for op, count in self.counts().items())

    @property
    def multiplications(self) -> int:
        """Number of products, including fused ones."""
        return sum(count for op, count in self.counts().items() if op == "mul" or op in FUSED)

    @cached_property
    def zeros(self) -> tuple[bool, ...]:
        """For each output element, True if it is zero for all inputs."""
        is_zero = []
        for result in self.results:
            op, _, value = self.instructions[result]
            is_zero.append(op == "const" and value == 0.0)
        return tuple(is_zero)

    @cached_property
    def digest(self) -> str:
        """Hash of the whole computation; equal programs have equal digests in every process."""
        import hashlib

        interface = repr((self.inputs, self.outputs, self.results))
        hasher = hashlib.sha256(interface.encode())
        for op, args, value in self.instructions:
            hasher.update(f"{op}{args}{value!r}\n".encode())
        return hasher.hexdigest()

    @property
    def signature(self) -> str:
        """Gufunc signature with the program's sizes, as in ``(7),(7)->(7,7)``."""
        return signature_of(self.inputs, self.outputs)
