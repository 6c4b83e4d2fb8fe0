"""Registers for straight-line AVX2 code: every later use is known, so what is needed last goes to memory first.

That is Belady's rule, and with it three things that this instruction set offers: one operand of an instruction may come from
memory at no cost, so a value in memory is not fetched before it has to be; a fused product overwrites one of its operands,
any of the three, so it takes one that is not needed again; and a value that is in memory already is dropped for nothing.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import NamedTuple

from .machine import Precision
from .sincos import limit_pattern

__all__ = ["ARRAYS_IN_REGISTERS", "Code", "allocated"]

REGISTERS = 16
NEVER = 1 << 60
CLEAN = 2
"""How much farther away the next use of a value counts that is in memory already: dropping it costs no store."""

_FRAME = "rdi"
PART = 1500
"""Steps in a part, about: some 12 kB of code, of which the first cache holds two."""

_ARGUMENTS = ("rsi", "rdx", "rcx", "r8", "r9")
_SCRATCH = ("rax", "r10", "r11")

ARRAYS_IN_REGISTERS = len(_ARGUMENTS)
"""Arrays whose places come in registers, by the System V calling convention; those of the others lie on the stack."""


class Step(NamedTuple):
    """One machine instruction, or a few that belong together. ``result`` is -1 for stores."""

    kind: str
    name: str
    result: int
    sources: tuple[int, ...]
    port: int = 0
    offset: int = 0


class Code:
    """Steps in order; values are numbers. ``suffix`` is ``pd`` or ``ps``."""

    def __init__(self, suffix: str) -> None:
        self.suffix = suffix
        self.steps: list[Step] = []
        self.constants: dict[int, int] = {}
        self._values = 0

    def _new(self) -> int:
        self._values += 1
        return self._values - 1

    def _step(self, kind: str, name: str, *sources: int, port: int = 0, offset: int = 0) -> int:
        result = self._new()
        self.steps.append(Step(kind, name, result, sources, port, offset))
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
        self.steps.append(Step("store", "ymm" if whole else "xmm", -1, (x,), port, offset))

    def store_upper(self, x: int, port: int, offset: int) -> None:
        """The upper half of a register to an array."""
        self.steps.append(Step("upper", "vextractf128", -1, (x,), port, offset))

    def keep(self, x: int, entry: int) -> None:
        """A register to an entry of the frame."""
        self.steps.append(Step("keep", "", -1, (x,), offset=entry))

    def scatter(self, x: int, port: int, offsets: Sequence[int]) -> None:
        """The lanes to single numbers of an array."""
        half = len(offsets) // 2
        for part, some in ((x, offsets[:half]), (self.joined(x, x, 0x31), offsets[half:])):
            for k, offset in enumerate(some):
                self.steps.append(Step("number", str(k), -1, (part,), port, offset))


class Assembled(NamedTuple):
    """Lines of assembly with functions ``part0``, ``part1`` …, and ``look``; the vectors of the frame they take."""

    lines: list[str]
    parts: int
    frame: int


def allocated(
    code: Code, precision: Precision, angles: Mapping[int, int], entries: int, prefix: str
) -> Assembled:
    """The steps as functions of the frame and the arrays, to be called one after the other.

    ``look`` gives 1 where an angle is huge. ``angles``: how many columns the arrays with angles have; ``entries``: vectors of
    the frame that :meth:`Code.keep` writes.
    """
    steps = _needed(code)
    parts = max(1, round(len(steps) / PART))
    a = _Allocation(code, steps, entries, {len(steps) * k // parts for k in range(1, parts)})
    words = ".quad" if precision.bytes == 8 else ".long"
    constants = [f"{words} " + ", ".join([str(bits)] * (32 // precision.bytes)) for bits in a.constants]
    lines = [".intel_syntax noprefix", ".text", ".p2align 5", *_look(precision, angles, prefix)]
    for k, body in enumerate(a.parts):
        lines += [".p2align 5", f"{prefix}part{k}:", *body, "vzeroupper", "ret"]
    lines += [".p2align 5", *_limits(precision), "twconst:", *constants, ".att_syntax"]
    return Assembled(lines, len(a.parts), a.frame)


def _look(precision: Precision, angles: Mapping[int, int], prefix: str) -> list[str]:
    """Give 1 if an angle is huge. The bits of sizes order like the sizes, and the upper 32 of them are enough."""
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


def _needed(code: Code) -> list[Step]:
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
    lines = []
    for name, value in (("twsize", size), ("twlimit", limit_pattern(precision))):
        lines += [f"{name}:", f"{words} " + ", ".join([str(value)] * n)]
    return lines


class _Allocation:
    """One walk through the steps: what is in which register, what lies in which place of the frame."""

    def __init__(self, code: Code, steps: list[Step], entries: int, cuts: Container[int]) -> None:
        self.suffix = code.suffix
        self.body: list[str] = []
        self.uses: dict[int, list[int]] = {}
        for k in reversed(range(len(steps))):
            for value in steps[k].sources:
                later = self.uses.setdefault(value, [])
                if not later or later[-1] != k:
                    later.append(k)
        self.register: dict[int, int] = {}
        self.holds: dict[int, int] = {}
        self.free = list(range(REGISTERS))
        self.place: dict[int, str] = {}
        self.spare: list[int] = []
        self.left: list[int] = []
        self.frame = entries
        used = [value for value in code.constants if value in self.uses]
        self.constants = [code.constants[value] for value in used]
        self.place.update({value: f"[rip + twconst + {32 * n}]" for n, value in enumerate(used)})
        self.fixed = frozenset(used)
        self.pointers: dict[int, str] = dict(enumerate(_ARGUMENTS))
        self.turn = 0
        self.handlers = {
            "binary": self._binary, "swapping": self._binary, "fused": self._fused, "unary": self._unary,
            "shift": self._shift, "blend": self._blend, "joined": self._joined, "load": self._load,
            "single": self._load, "insert": self._insert, "high": self._insert, "lane": self._insert,
            "store": self._store, "upper": self._store, "number": self._store, "keep": self._keep,
        }  # fmt: skip
        self.parts = [self.body]
        for self.now, step in enumerate(steps):
            if self.now in cuts:
                self._cut()
            self.handlers[step.kind](step)
            self.spare += self.left  # only now: what this step read from there it has read
            self.left.clear()

    def _cut(self) -> None:
        """Begin another part: what is still used goes to the frame, and no register holds anything."""
        for r, value in self.holds.items():
            self._save(value, r)
        self.register.clear()
        self.holds.clear()
        self.free = list(range(REGISTERS))
        self.pointers = dict(enumerate(_ARGUMENTS))
        self.body = []
        self.parts.append(self.body)

    # ── where values are ──

    def _next(self, value: int) -> int:
        later = self.uses.get(value)
        return later[-1] if later else NEVER

    def _text(self, value: int) -> str:
        """A value as an operand that may be memory."""
        r = self.register.get(value)
        return f"ymm{r}" if r is not None else f"ymmword ptr {self.place[value]}"

    def _take(self, locked: Iterable[int] = ()) -> int:
        """A register to write to."""
        if self.free:
            return self.free.pop()
        keep = {self.register[v] for v in locked if v in self.register}
        now, best, victim = self.now, -1, -1
        for r, value in self.holds.items():
            if r not in keep:
                distance = (self._next(value) - now) * (CLEAN if value in self.place else 1)
                if distance > best:
                    best, victim = distance, r
        value = self.holds.pop(victim)
        del self.register[value]
        self._save(value, victim)
        return victim

    def _save(self, value: int, r: int) -> None:
        """Store a value that is used again, unless it is in memory already."""
        if value not in self.place and self._next(value) < NEVER:
            if self.spare:
                n = self.spare.pop()
            else:
                n, self.frame = self.frame, self.frame + 1
            self.place[value] = f"[{_FRAME} + {32 * n}]"
            self.body.append(f"vmova{self.suffix} ymmword ptr {self.place[value]}, ymm{r}")

    def _fetch(self, value: int, locked: Iterable[int] = ()) -> int:
        """The register of a value, loaded where it is in memory."""
        r = self.register.get(value)
        if r is None:
            r = self._take(locked)
            self.body.append(f"vmova{self.suffix} ymm{r}, ymmword ptr {self.place[value]}")
            self._put(value, r)
        return r

    def _put(self, value: int, r: int) -> None:
        self.register[value], self.holds[r] = r, value

    def _read(self, sources: Sequence[int]) -> None:
        """These uses are done; what is not used again leaves its register and its place."""
        for value in sources:
            later = self.uses[value]
            if later and later[-1] == self.now:
                later.pop()
            if not later and value in self.register:
                r = self.register.pop(value)
                del self.holds[r]
                self.free.append(r)
            if not later and value not in self.fixed and value in self.place:
                self.left.append(int(self.place.pop(value)[7:-1]) // 32)

    def _result(self, step: Step) -> int:
        r = self._take()
        self._put(step.result, r)
        return r

    def _array(self, step: Step) -> str:
        """A place in an array; those beyond the registers for arguments have their addresses on the stack."""
        base = self.pointers.get(step.port)
        if base is None:
            base = _SCRATCH[self.turn]
            self.turn = (self.turn + 1) % len(_SCRATCH)
            self.pointers = {k: b for k, b in self.pointers.items() if b != base} | {step.port: base}
            self.body.append(f"mov {base}, qword ptr [rsp + {8 + 8 * (step.port - len(_ARGUMENTS))}]")
        return f"[{base} + {step.offset}]"

    # ── instructions ──

    def _binary(self, step: Step) -> None:
        a, b = step.sources
        if step.kind == "swapping" and a not in self.register and (b in self.register or self._next_after(b) < self._next_after(a)):
            a, b = b, a
        left = self._fetch(a, (a, b))
        right = self._text(b)
        self._read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, ymm{left}, {right}")

    def _next_after(self, value: int) -> int:
        later = self.uses[value]
        return later[-2] if len(later) > 1 else NEVER

    def _fused(self, step: Step) -> None:
        x, y, z = step.sources
        inside = [v in self.register for v in step.sources]
        dying = [self._next_after(v) == NEVER for v in step.sources]
        missing = {v for v, there in zip(step.sources, inside, strict=True) if not there}
        # which operand the result replaces: one that is in a register for the last time, else one that is fetched or copied
        ends = [k for k in range(3) if inside[k] and dying[k] and step.sources.count(step.sources[k]) == 1]
        if ends:
            target = ends[0]
        elif missing:
            target = self._target_of_missing(step, missing)
        else:
            target = 0 if x != y else 2
            if step.sources.count(step.sources[target]) > 1:
                target = -1
        self._emit_fused(step, target, ends)

    def _target_of_missing(self, step: Step, missing: set[int]) -> int:
        order = sorted((k for k in range(3) if step.sources[k] in missing), key=lambda k: -self._next_after(step.sources[k]))
        for k in order:
            if step.sources.count(step.sources[k]) == 1:
                return k
        return -1

    def _emit_fused(self, step: Step, target: int, ends: list[int]) -> None:
        sources = step.sources
        x, y, z = sources
        if target < 0:  # an operand that occurs twice: the result starts as a copy of z
            target = 2
        others = [sources[k] for k in range(3) if k != target]
        # of the others one may stay in memory
        away = [v for v in dict.fromkeys(others) if v not in self.register]
        if len(away) == 2 or (away and others[0] == others[1]):
            fetch = others[0] if others[0] == others[1] else min(away, key=self._next_after)
            self._fetch(fetch, sources)
        own = sources[target]
        if target in ends:
            r = self.register[own]
            others_text = [self._text(v) for v in others]
            self._read(sources)
            self.free.remove(r)
        else:
            r = self._take(sources)
            self.body.append(f"vmova{self.suffix} ymm{r}, {self._text(own)}")
            others_text = [self._text(v) for v in others]
            self._read(sources)
        first, second = others_text
        if target == 2:
            form = "231"
            if first.startswith("ymmword"):
                first, second = second, first
        elif first.startswith("ymmword"):  # the other factor is in memory
            form, first, second = "132", second, first
        else:
            form = "213"
        self._put(step.result, r)
        self.body.append(f"{step.name}{form}{self.suffix} ymm{r}, {first}, {second}")

    def _unary(self, step: Step) -> None:
        text = self._text(step.sources[0])
        self._read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, {text}")

    def _shift(self, step: Step) -> None:
        r = self._fetch(step.sources[0], step.sources)
        self._read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, ymm{r}, {step.offset}")

    def _blend(self, step: Step) -> None:
        a, b, mask = step.sources
        left, m, right = self._fetch(a, step.sources), self._fetch(mask, step.sources), self._text(b)
        left = self._fetch(a, step.sources)
        self._read(step.sources)
        self.body.append(f"{step.name} ymm{self._result(step)}, ymm{left}, {right}, ymm{m}")

    def _joined(self, step: Step) -> None:
        a, b = step.sources
        left, right = self._fetch(a, step.sources), self._text(b)
        self._read(step.sources)
        r = self._result(step)
        if step.offset == 0x20:
            half = right.replace("ymm", "xmm") if not right.startswith("ymmword") else right.replace("ymmword", "xmmword")
            self.body.append(f"vinsertf128 ymm{r}, ymm{left}, {half}, 1")
        else:
            self.body.append(f"vperm2f128 ymm{r}, ymm{left}, {right}, {step.offset}")

    def _load(self, step: Step) -> None:
        at = self._array(step)
        self.body.append(f"{step.name} xmm{self._result(step)}, {at}")

    def _insert(self, step: Step) -> None:
        r, at = self._fetch(step.sources[0], step.sources), self._array(step)
        self._read(step.sources)
        to = self._result(step)
        if step.kind == "insert":
            self.body.append(f"vinsertf128 ymm{to}, ymm{r}, xmmword ptr {at}, 1")
        elif step.kind == "high":
            self.body.append(f"vmovhpd xmm{to}, xmm{r}, qword ptr {at}")
        else:
            self.body.append(f"vinsertps xmm{to}, xmm{r}, dword ptr {at}, {16 * int(step.name)}")

    def _store(self, step: Step) -> None:
        r, at = self._fetch(step.sources[0], step.sources), self._array(step)
        if step.kind == "upper":
            self.body.append(f"vextractf128 xmmword ptr {at}, ymm{r}, 1")
        elif step.kind == "number":
            self.body.append(self._number(step, r, at))
        else:
            self.body.append(f"vmovu{self.suffix} {step.name}word ptr {at}, {step.name}{r}")
        self._read(step.sources)

    def _keep(self, step: Step) -> None:
        r = self._fetch(step.sources[0], step.sources)
        self.body.append(f"vmova{self.suffix} ymmword ptr [{_FRAME} + {32 * step.offset}], ymm{r}")
        self._read(step.sources)

    def _number(self, step: Step, r: int, at: str) -> str:
        if self.suffix == "pd":
            return f"{'vmovhpd' if step.name == '1' else 'vmovlpd'} qword ptr {at}, xmm{r}"
        return f"vextractps dword ptr {at}, xmm{r}, {step.name}"
