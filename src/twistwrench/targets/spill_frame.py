"""Where a long program is cut, and where values that cross a cut are kept: a frame of vectors in memory.

One function per part keeps the compiler's time linear in the length of the program. The frame begins with all entries of the
results, in order; slots for the other values that a later part uses follow, each used again once its value is spent. Inputs
and constants are not kept: every part takes them from where they are.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

from ..program.program import Program

AT_HAND = ("const", "input")
"""What any part can take from where it is."""


@dataclass(frozen=True)
class SpillFrame:
    """A program, cut into parts of about ``length`` instructions."""

    program: Program
    length: int

    @cached_property
    def starts(self) -> list[int]:
        """The first instruction of each part, and the end; within half a length of even cuts, where the fewest values live."""
        end = len(self.program.instructions)
        born_and_dead = [0] * (end + 1)
        for number, last in enumerate(self._last):
            if last:
                born_and_dead[number + 1] += 1
                born_and_dead[last + 1] -= 1
        living = list(accumulate(born_and_dead))
        starts = [0]
        while end - starts[-1] > self.length * 3 // 2:
            low, high = starts[-1] + self.length // 2, starts[-1] + self.length * 3 // 2
            starts.append(min(range(low, high), key=living.__getitem__))
        return [*starts, end]

    @cached_property
    def _last(self) -> list[int]:
        """The last instruction that uses each value; 0 of those nobody uses and those at hand."""
        instructions = self.program.instructions
        last = [0] * len(instructions)
        for number, (_, args, _) in enumerate(instructions):
            for a in args:
                if instructions[a].op not in AT_HAND:
                    last[a] = number
        return last

    @cached_property
    def entries(self) -> dict[int, list[int]]:
        """The entries of the results that each instruction makes, but for constants."""
        entries: dict[int, list[int]] = {}
        for k, result in enumerate(self.program.results):
            if self.program.instructions[result].op != "const":
                entries.setdefault(result, []).append(k)
        return entries

    @cached_property
    def constants(self) -> list[tuple[int, int, float]]:
        """Runs of entries that are one constant: the first, how many, and the value."""
        runs: list[tuple[int, int, float]] = []
        for k, result in enumerate(self.program.results):
            op, _, value = self.program.instructions[result]
            if op == "const":
                if runs and runs[-1][0] + runs[-1][1] == k and runs[-1][2] == value:
                    runs[-1] = runs[-1][0], runs[-1][1] + 1, value
                else:
                    runs.append((k, 1, value))
        return runs

    @cached_property
    def homes(self) -> dict[int, int]:
        """Where each value that a later part uses is kept: as an entry of the results if it is one, else in a slot."""
        homes: dict[int, int] = {}
        free: list[int] = []
        spent: dict[int, list[int]] = {}
        size = len(self.program.results)
        for part, (first, end) in enumerate(pairwise(self.starts)):
            for number in range(first, end):
                last = self._last[number]
                if last < end:
                    continue
                if number in self.entries:
                    homes[number] = self.entries[number][0]
                    continue
                if not free:
                    free.append(size)
                    size += 1
                homes[number] = free.pop()
                spent.setdefault(bisect_right(self.starts, last) - 1, []).append(homes[number])
            free.extend(spent.pop(part, ()))  # not before: the part may read the old value after it has made a new one
        return homes

    @cached_property
    def size(self) -> int:
        """Vectors."""
        return max([len(self.program.results), *(home + 1 for home in self.homes.values())])
