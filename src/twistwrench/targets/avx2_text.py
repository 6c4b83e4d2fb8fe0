"""AVX2 code as the text of an assembler, Intel's way: steps written one by one with the registers they are given."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

from .avx2_code import Avx2Code, Avx2Step
from .processor import Precision
from .registers import FRAME, NEVER, Registers
from .sincos import limit_pattern

PART = 1500
"""Steps in a part, about: some 12 kB of code, of which the first cache holds two."""

_ARGUMENTS = ("rsi", "rdx", "rcx", "r8", "r9")
_SCRATCH = ("rax", "r10", "r11")

ARRAYS_IN_REGISTERS = len(_ARGUMENTS)
"""Arrays whose places come in registers, by the System V calling convention; those of the others lie on the stack."""


class Assembled(NamedTuple):
    """Lines of assembly with functions ``part0``, ``part1`` …, and ``look``; the vectors of the frame they take."""

    lines: list[str]
    parts: int
    frame: int


def written(code: Avx2Code, precision: Precision, angles: Mapping[int, int], entries: int, prefix: str) -> Assembled:
    """The steps as functions of the frame and the arrays, to be called one after the other.

    ``look`` gives 1 where an angle may be huge. ``angles``: how many columns the arrays with angles have; ``entries``:
    vectors of the frame that :meth:`Avx2Code.keep` writes.
    """
    steps = _needed(code)
    parts = max(1, round(len(steps) / PART))
    a = _Parts(code, steps, entries, {len(steps) * k // parts for k in range(1, parts)})
    words = ".quad" if precision.bytes == 8 else ".long"
    constants = [f"{words} " + ", ".join([str(bits)] * (32 // precision.bytes)) for bits in a.constants]
    lines = [".intel_syntax noprefix", ".text", ".p2align 5", *_look(angles, prefix)]
    for k, body in enumerate(a.parts):
        lines += [".p2align 5", f"{prefix}part{k}:", *body, "vzeroupper", "ret"]
    lines += [".p2align 5", *_limits(precision), "twconst:", *constants, ".att_syntax"]
    return Assembled(lines, len(a.parts), a.frame)


def _look(angles: Mapping[int, int], prefix: str) -> list[str]:
    """Give 1 if an angle may be huge.

    The bits of sizes order like the sizes; looked at are the upper 32, and what they leave open is settled where angles are
    replaced.
    """
    if not angles:
        return []
    lines, first = [f"{prefix}look:", "vmovdqa ymm1, ymmword ptr [rip + twsize]"], True
    for port, columns in angles.items():
        base = _ARGUMENTS[port]
        for k in range(columns):
            lines.append(f"vpand ymm{0 if first else 2}, ymm1, ymmword ptr [{base} + {32 * k}]")
            lines += [] if first else ["vpmaxud ymm0, ymm0, ymm2"]
            first = False
    return [
        *lines, "vpcmpgtd ymm0, ymm0, ymmword ptr [rip + twlimit]", "xor eax, eax", "vptest ymm0, ymm0", "setne al",
        "vzeroupper", "ret",
    ]  # fmt: skip


def _needed(code: Avx2Code) -> list[Avx2Step]:
    """The steps that something stored depends on."""
    used: set[int] = set()
    kept = []
    for step in reversed(code.steps):
        if step.result < 0 or step.result in used:
            used.update(step.sources)
            kept.append(step)
    return kept[::-1]


def _limits(precision: Precision) -> list[str]:
    bits = precision.bits
    words, n, size = (".quad", 4, 0x7FFFFFFF_00000000) if bits == 64 else (".long", 8, 0x7FFFFFFF)
    below = limit_pattern(precision) - 1 & size
    lines = []
    for name, value in (("twsize", size), ("twlimit", below)):
        lines += [f"{name}:", f"{words} " + ", ".join([str(value)] * n)]
    return lines


class _Parts(Registers):
    """One walk through the steps, part by part."""

    def __init__(self, code: Avx2Code, steps: list[Avx2Step], entries: int, cuts: Container[int]) -> None:
        used = {value for step in steps for value in step.sources}
        constants = [value for value in code.constants if value in used]
        fixed = {value: f"[rip + twconst + {32 * n}]" for n, value in enumerate(constants)}
        super().__init__([step.sources for step in steps], fixed, entries, code.suffix)
        self.constants = [code.constants[value] for value in constants]
        self.pointers: dict[int, str] = dict(enumerate(_ARGUMENTS))
        self.turn = 0
        self.parts = [self.body]
        writers = {
            "binary": self._binary, "swapping": self._binary, "fused": self._fused, "unary": self._unary,
            "shift": self._shift, "blend": self._blend, "joined": self._joined, "load": self._load,
            "single": self._load, "insert": self._insert, "high": self._insert, "lane": self._insert,
            "store": self._store, "upper": self._store, "number": self._store, "keep": self._keep,
        }  # fmt: skip
        for self.now, step in enumerate(steps):
            if self.now in cuts:
                self.empty()
                self.pointers = dict(enumerate(_ARGUMENTS))
                self.body = []
                self.parts.append(self.body)
            writers[step.kind](step)
            self.done()

    def _result(self, step: Avx2Step) -> int:
        r = self.take()
        self.put(step.result, r)
        return r

    def _array(self, step: Avx2Step) -> str:
        """A place in an array; those beyond the registers for arguments have their addresses on the stack."""
        base = self.pointers.get(step.port)
        if base is None:
            base = _SCRATCH[self.turn]
            self.turn = (self.turn + 1) % len(_SCRATCH)
            self.pointers = {k: b for k, b in self.pointers.items() if b != base} | {step.port: base}
            self.body.append(f"mov {base}, qword ptr [rsp + {8 + 8 * (step.port - len(_ARGUMENTS))}]")
        return f"[{base} + {step.offset}]"

    def _binary(self, step: Avx2Step) -> None:
        a, b = step.sources
        if step.kind == "swapping" and a not in self.register:
            a, b = sorted((a, b), key=lambda v: (v not in self.register, self.next_after(v)))
        left = self.fetch(a, (a, b))
        right = self.text(b)
        self.read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, ymm{left}, {right}")

    def _fused(self, step: Avx2Step) -> None:
        """The result replaces an operand: one in a register for the last time, else one that is fetched or copied for it."""
        sources = step.sources
        once = [k for k in range(3) if sources.count(sources[k]) == 1]
        ending = [k for k in once if sources[k] in self.register and self.next_after(sources[k]) == NEVER]
        away = [k for k in once if sources[k] not in self.register]
        if ending:
            target = ending[0]
        elif away:
            target = max(away, key=lambda k: self.next_after(sources[k]))
        else:
            target = once[0] if once else 2
        others = [sources[k] for k in range(3) if k != target]
        missing = [v for v in dict.fromkeys(others) if v not in self.register]
        if len(missing) == 2 or (missing and others[0] == others[1]):  # one may stay in memory
            self.fetch(min(missing, key=self.next_after), sources)
        if ending:
            r = self.register[sources[target]]
        else:
            r = self.take(sources)
            self.body.append(f"vmova{self.suffix} ymm{r}, {self.text(sources[target])}")
        first, second = (self.text(v) for v in others)
        self.read(sources)
        if ending:
            self.free.remove(r)
        form = "231" if target == 2 else "213"
        if first.startswith("ymmword"):
            form, first, second = form if target == 2 else "132", second, first
        self.put(step.result, r)
        self.body.append(f"{step.name}{form}{self.suffix} ymm{r}, {first}, {second}")

    def _unary(self, step: Avx2Step) -> None:
        text = self.text(step.sources[0])
        self.read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, {text}")

    def _shift(self, step: Avx2Step) -> None:
        r = self.fetch(step.sources[0], step.sources)
        self.read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, ymm{r}, {step.offset}")

    def _blend(self, step: Avx2Step) -> None:
        a, b, mask = step.sources
        left, m, right = self.fetch(a, step.sources), self.fetch(mask, step.sources), self.text(b)
        self.read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, ymm{left}, {right}, ymm{m}")

    def _joined(self, step: Avx2Step) -> None:
        a, b = step.sources
        left, right = self.fetch(a, step.sources), self.text(b)
        self.read(step.sources)
        r = self._result(step)
        if step.offset == 0x20:
            half = right.replace("ymm", "xmm", 1)
            self.body.append(f"vinsertf128 ymm{r}, ymm{left}, {half}, 1")
        else:
            self.body.append(f"vperm2f128 ymm{r}, ymm{left}, {right}, {step.offset}")

    def _load(self, step: Avx2Step) -> None:
        at = self._array(step)
        self.body.append(f"{step.name} xmm{self._result(step)}, {at}")

    def _insert(self, step: Avx2Step) -> None:
        r, at = self.fetch(step.sources[0], step.sources), self._array(step)
        self.read(step.sources)
        to = self._result(step)
        if step.kind == "insert":
            self.body.append(f"vinsertf128 ymm{to}, ymm{r}, xmmword ptr {at}, 1")
        elif step.kind == "high":
            self.body.append(f"vmovhpd xmm{to}, xmm{r}, qword ptr {at}")
        else:
            self.body.append(f"vinsertps xmm{to}, xmm{r}, dword ptr {at}, {16 * int(step.name)}")

    def _store(self, step: Avx2Step) -> None:
        r, at = self.fetch(step.sources[0], step.sources), self._array(step)
        if step.kind == "upper":
            self.body.append(f"vextractf128 xmmword ptr {at}, ymm{r}, 1")
        elif step.kind == "number":
            self.body.append(self._number(step, r, at))
        else:
            self.body.append(f"vmovu{self.suffix} {step.name}word ptr {at}, {step.name}{r}")
        self.read(step.sources)

    def _keep(self, step: Avx2Step) -> None:
        r = self.fetch(step.sources[0], step.sources)
        self.body.append(f"vmova{self.suffix} ymmword ptr [{FRAME} + {32 * step.offset}], ymm{r}")
        self.read(step.sources)

    def _number(self, step: Avx2Step, r: int, at: str) -> str:
        if self.suffix == "pd":
            return f"{'vmovhpd' if step.name == '1' else 'vmovlpd'} qword ptr {at}, xmm{r}"
        return f"vextractps dword ptr {at}, xmm{r}, {step.name}"
