"""The arrays that go into a program and come out, and the signature that NumPy reads of them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple


class Port(NamedTuple):
    """A named array that goes in or comes out."""

    name: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


def signature_of(inputs: Sequence[Sequence[int | str]], outputs: Sequence[Sequence[int | str]]) -> str:
    """The gufunc signature of operands with those sizes."""
    ins, outs = (
        ",".join("(" + ",".join(map(str, sizes)) + ")" for sizes in operands) for operands in (inputs, outputs)
    )
    return f"{ins}->{outs}"


@cache
def axes_of(signature: str) -> list[list[int]]:
    """By operand, where NumPy puts the size of each axis in a loop's ``dims``: by names and numbers as they first appear.

    >>> axes_of("(7),(k,7)->(m,7)")
    [[1], [2, 1], [3, 1]]
    """
    names: list[str] = []
    operands = []
    for operand in re.findall(r"\(([^)]*)\)", signature):
        sizes = [size for size in operand.split(",") if size]
        names += [size for size in dict.fromkeys(sizes) if size not in names]
        operands.append([1 + names.index(size) for size in sizes])
    return operands
