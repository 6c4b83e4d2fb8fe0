"""Registers for straight-line AVX2 code: every later use is known, so what is needed last goes to memory first.

That is Belady's rule, and with it three things that this instruction set offers: one operand of an instruction may come from
memory at no cost, so a value in memory is not fetched before it has to be; a fused product overwrites one of its operands,
any of the three, so it takes one that is not needed again; and a value that is in memory already is dropped for nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

REGISTERS = 16
NEVER = 1 << 60
CLEAN = 2
"""How much farther away the next use of a value counts that is in memory already: dropping it costs no store."""

FRAME = "rdi"
"""The register that points to the frame. Not the stack's: processors track what lies on the stack by its register, and on
some of them that made code with a thousand places half as fast (bench/NOTES.md)."""


class Registers:
    """What is in which register and what lies in which place of the frame, while instructions are written one by one.

    ``sources``: the values that each step reads; ``fixed``: where constants lie; ``entries``: vectors of the frame that are
    not for us.
    """

    def __init__(self, sources: Sequence[tuple[int, ...]], fixed: Mapping[int, str], entries: int, suffix: str) -> None:
        self.suffix, self.now = suffix, 0
        self.body: list[str] = []
        self.uses: dict[int, list[int]] = {}
        for k in reversed(range(len(sources))):
            for value in dict.fromkeys(sources[k]):
                self.uses.setdefault(value, []).append(k)
        self.register: dict[int, int] = {}
        self.holds: dict[int, int] = {}
        self.free = list(range(REGISTERS))
        self.place = dict(fixed)
        self.slot: dict[int, int] = {}
        self.spare: list[int] = []
        self.left: list[int] = []
        self.frame = entries

    def next(self, value: int) -> int:
        """The step that uses a value next."""
        later = self.uses.get(value)
        return later[-1] if later else NEVER

    def text(self, value: int) -> str:
        """A value as an operand that may be memory."""
        r = self.register.get(value)
        return f"ymm{r}" if r is not None else f"ymmword ptr {self.place[value]}"

    def take(self, locked: Iterable[int] = ()) -> int:
        """A register to write to."""
        if self.free:
            return self.free.pop()
        keep = {self.register[v] for v in locked if v in self.register}
        now, best, victim = self.now, -1, -1
        for r, value in self.holds.items():
            if r not in keep:
                distance = (self.next(value) - now) * (CLEAN if value in self.place else 1)
                if distance > best:
                    best, victim = distance, r
        value = self.holds.pop(victim)
        del self.register[value]
        self.save(value, victim)
        return victim

    def save(self, value: int, r: int) -> None:
        """Store a value that is used again, unless it is in memory already."""
        if value not in self.place and self.next(value) < NEVER:
            if self.spare:
                n = self.spare.pop()
            else:
                n, self.frame = self.frame, self.frame + 1
            self.slot[value], self.place[value] = n, f"[{FRAME} + {32 * n}]"
            self.body.append(f"vmova{self.suffix} ymmword ptr {self.place[value]}, ymm{r}")

    def fetch(self, value: int, locked: Iterable[int] = ()) -> int:
        """The register of a value, loaded where it is in memory."""
        r = self.register.get(value)
        if r is None:
            r = self.take(locked)
            self.body.append(f"vmova{self.suffix} ymm{r}, ymmword ptr {self.place[value]}")
            self.put(value, r)
        return r

    def put(self, value: int, r: int) -> None:
        """Note what a register holds."""
        self.register[value], self.holds[r] = r, value

    def read(self, sources: Sequence[int]) -> None:
        """These uses are done; what is not used again leaves its register and its place."""
        for value in sources:
            later = self.uses[value]
            if later and later[-1] == self.now:
                later.pop()
            if not later and value in self.register:
                r = self.register.pop(value)
                del self.holds[r]
                self.free.append(r)
            if not later and value in self.slot:
                del self.place[value]
                self.left.append(self.slot.pop(value))

    def next_after(self, value: int) -> int:
        """The use after the one at hand."""
        later = self.uses[value]
        return later[-2] if len(later) > 1 else NEVER

    def done(self) -> None:
        """The step is written: what it read for the last time, it has read, and its places are free."""
        self.spare += self.left
        self.left.clear()

    def empty(self) -> None:
        """Put what is used again into the frame, so that no register holds anything."""
        for r, value in self.holds.items():
            self.save(value, r)
        self.register.clear()
        self.holds.clear()
        self.free = list(range(REGISTERS))
