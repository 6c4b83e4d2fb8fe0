"""AVX2 instructions before registers are given out: steps in order, on values that are numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Avx2Step(NamedTuple):
    """One machine instruction, or a few that belong together. ``result`` is -1 for stores."""

    kind: str
    name: str
    result: int
    sources: tuple[int, ...]
    port: int = 0
    offset: int = 0


class Avx2Code:
    """Steps in order; values are numbers. ``suffix`` is ``pd`` or ``ps``."""

    def __init__(self, suffix: str) -> None:
        self.suffix = suffix
        self.steps: list[Avx2Step] = []
        self.constants: dict[int, int] = {}
        self._values = 0

    def _new(self) -> int:
        self._values += 1
        return self._values - 1

    def _step(self, kind: str, name: str, *sources: int, port: int = 0, offset: int = 0) -> int:
        result = self._new()
        self.steps.append(Avx2Step(kind, name, result, sources, port, offset))
        return result

    def constant(self, bits: int) -> int:
        """A pattern in every lane; it lies in memory."""
        value = self._new()
        self.constants[value] = bits
        return value

    def is_constant(self, values: Sequence[int]) -> bool:
        """Whether all are one and the same constant."""
        return values[0] in self.constants and all(v == values[0] for v in values)

    def binary(self, name: str, a: int, b: int, *, swaps: bool = False) -> int:
        """``a op b``; ``swaps`` where the operands may change places."""
        return self._step("swapping" if swaps else "binary", name + self.suffix, a, b)

    def pairs(self, name: str, a: int, b: int) -> int:
        """An unpacking of pairs of floats."""
        return self._step("binary", name + "pd", a, b)

    def fused(self, signs: tuple[int, int], x: int, y: int, z: int) -> int:
        """± x y ± z, rounded once."""
        name = ("vfmadd", "vfmsub") if signs[0] > 0 else ("vfnmadd", "vfnmsub")
        return self._step("fused", name[signs[1] < 0], x, y, z)

    def unary(self, name: str, x: int) -> int:
        """A function of one value."""
        return self._step("unary", name + self.suffix, x)

    def shifted(self, x: int, bits: int) -> int:
        """The lanes as integers, moved to the left."""
        return self._step("shift", "vpsllq" if self.suffix == "pd" else "vpslld", x, offset=bits)

    def blend(self, a: int, b: int, mask: int) -> int:
        """b where the top bit of the mask is set, else a."""
        return self._step("blend", "vblendv" + self.suffix, a, b, mask)

    def joined(self, a: int, b: int, halves: int) -> int:
        """The lower halves of both (0x20), or the upper ones (0x31)."""
        return self._step("joined", "vperm2f128", a, b, offset=halves)

    def load(self, port: int, offset: int) -> int:
        """128 bits of an array into the lower half."""
        return self._step("load", "vmovu" + self.suffix, port=port, offset=offset)

    def insert(self, a: int, port: int, offset: int) -> int:
        """``a`` with 128 bits of an array as its upper half."""
        return self._step("insert", "vinsertf128", a, port=port, offset=offset)

    def gathered(self, port: int, offsets: Sequence[int]) -> int:
        """Single numbers of an array side by side."""
        if self.suffix == "pd":
            halves = [
                self._step("high", "vmovhpd", self._step("single", "vmovsd", port=port, offset=a), port=port, offset=b)
                for a, b in zip(offsets[::2], offsets[1::2], strict=True)
            ]
        else:
            halves = []
            for first in range(0, len(offsets), 4):
                x = self._step("single", "vmovss", port=port, offset=offsets[first])
                for k in range(1, 4):
                    x = self._step("lane", str(k), x, port=port, offset=offsets[first + k])
                halves.append(x)
        return self.joined(halves[0], halves[1], 0x20)

    def store(self, x: int, port: int, offset: int, *, whole: bool) -> None:
        """All of a register, or its lower half, to an array."""
        self.steps.append(Avx2Step("store", "ymm" if whole else "xmm", -1, (x,), port, offset))

    def store_upper(self, x: int, port: int, offset: int) -> None:
        """The upper half of a register to an array."""
        self.steps.append(Avx2Step("upper", "vextractf128", -1, (x,), port, offset))

    def keep(self, x: int, entry: int) -> None:
        """A register to an entry of the frame."""
        self.steps.append(Avx2Step("keep", "", -1, (x,), offset=entry))

    def scatter(self, x: int, port: int, offsets: Sequence[int]) -> None:
        """The lanes to single numbers of an array."""
        half = len(offsets) // 2
        for part, some in ((x, offsets[:half]), (self.joined(x, x, 0x31), offsets[half:])):
            for k, offset in enumerate(some):
                self.steps.append(Avx2Step("number", str(k), -1, (part,), port, offset))
