"""LLVM assembly as text: fresh names, splat constants, shuffles, counted loops."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from .target_machine import DOUBLE, Precision


class LlvmWriter:
    """Lines of one function whose values are vectors of ``lanes`` elements."""

    def __init__(self, precision: Precision, lanes: int, *, fused: bool = True) -> None:
        self.precision, self.lanes, self.fused = precision, lanes, fused
        self.element = precision.llvm
        self.vector = f"<{lanes} x {self.element}>"
        self.integer = f"<{lanes} x i{precision.bits}>"
        self.mask = f"<{lanes} x i1>"
        self.suffix = f"v{lanes}f{precision.bits}"
        self.lines: list[str] = []
        self._names = 0

    def name(self) -> str:
        """A fresh local name."""
        self._names += 1
        return f"%t{self._names}"

    def label(self, stem: str) -> str:
        """A fresh label."""
        self._names += 1
        return f"{stem}{self._names}"

    def do(self, text: str) -> None:
        """Add an instruction without a result."""
        self.lines.append(f"  {text}")

    def new(self, text: str) -> str:
        """Add an instruction and name its result."""
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def begin(self, label: str) -> None:
        """Start a basic block."""
        self.lines.append(f"{label}:")

    # ── constants ──

    def number(self, value: float) -> str:
        """A scalar constant, exact to the bit."""
        return f"0x{DOUBLE.pattern(self.precision.rounded(value)) % 2**64:016X}"

    def splat(self, value: float) -> str:
        """The same constant in every lane."""
        return f"splat ({self.element} {self.number(value)})"

    def bits(self, value: int) -> str:
        """The same integer in every lane."""
        return f"splat (i{self.precision.bits} {value})"

    # ── vector operations ──

    def binary(self, op: str, a: str, b: str) -> str:
        """``op`` of two vectors, as in ``fadd``."""
        return self.new(f"{op} {self.vector} {a}, {b}")

    def negate(self, a: str) -> str:
        """-a."""
        return self.new(f"fneg {self.vector} {a}")

    def intrinsic(self, op: str, *operands: str) -> str:
        """A vector intrinsic on vectors, as in ``fma``."""
        arguments = ", ".join(f"{self.vector} {x}" for x in operands)
        return self.new(f"call {self.vector} @llvm.{op}.{self.suffix}({arguments})")

    def fma(self, a: str, b: str, c: str) -> str:
        """a b + c, rounded once; twice on a machine without fused products: LLVM would call the C library for each lane."""
        return self.intrinsic("fma", a, b, c) if self.fused else self.binary("fadd", self.binary("fmul", a, b), c)

    def select(self, condition: str, a: str, b: str) -> str:
        """For each lane, a if the condition holds, else b."""
        return self.new(f"select {self.mask} {condition}, {self.vector} {a}, {self.vector} {b}")

    def shuffle(self, a: str, b: str, indices: Sequence[int], length: int | None = None) -> str:
        """Elements of a and b, numbered through both, of which each has ``length``."""
        source = f"<{length or self.lanes} x {self.element}>"
        picks = ", ".join(f"i32 {i}" for i in indices)
        return self.new(f"shufflevector {source} {a}, {source} {b}, <{len(indices)} x i32> <{picks}>")

    def at(self, base: str, offset: int | str) -> str:
        """A pointer that many bytes on."""
        return self.new(f"getelementptr i8, ptr {base}, i64 {offset}")

    # ── samples, ``lanes`` of them side by side ──

    def blocks(self, samples: str) -> str:
        """Number of vectors that hold the samples; the last may be partly filled."""
        return self.new(f"sdiv i64 {self.new(f'add i64 {samples}, {self.lanes - 1}')}, {self.lanes}")

    def share(self, samples: str, first: str) -> tuple[str, str]:
        """Number of samples in the vector that begins with sample ``first``, and an i1 that is true if it is not full."""
        rest = self.new(f"sub i64 {samples}, {first}")
        short = self.new(f"icmp slt i64 {rest}, {self.lanes}")
        return self.new(f"select i1 {short}, i64 {rest}, i64 {self.lanes}"), short

    # ── control ──

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """Context whose code runs only if the i1 ``condition`` holds."""
        inside, end = self.label("then"), self.label("done")
        self.do(f"br i1 {condition}, label %{inside}, label %{end}")
        self.begin(inside)
        self.after = inside
        yield
        self.do(f"br label %{end}")
        self.begin(end)
        self.after = end

    @contextmanager
    def loop(self, count: str, block: str) -> Iterator[str]:
        """Count an i64 from 0 to ``count``; ``block`` is the label control comes from. Ends in a block named ``.end``.

        Yields the counter; :attr:`after` is the label that follows.
        """
        head, body, latch, end = (self.label(stem) for stem in ("head", "body", "latch", "end"))
        counter, following = self.name(), self.name()
        self.do(f"br label %{head}")
        self.begin(head)
        self.do(f"{counter} = phi i64 [0, %{block}], [{following}, %{latch}]")
        more = self.new(f"icmp slt i64 {counter}, {count}")
        self.do(f"br i1 {more}, label %{body}, label %{end}")
        self.begin(body)
        self.after = body
        yield counter
        self.do(f"br label %{latch}")
        self.begin(latch)
        self.do(f"{following} = add i64 {counter}, 1")
        self.do(f"br label %{head}")
        self.begin(end)
        self.after = end
