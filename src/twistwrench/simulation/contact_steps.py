"""How many steps each contact of a run lasts: one that is shorter than a step is no more than guessed by any method."""

from __future__ import annotations

from collections.abc import Sequence

_FEW = 2
"""Ends of steps in a row at which a contact that is too short is closed, at most."""


class Touches:
    """The contacts of a run, step by step."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.inside = [0] * len(self.names)
        """For how many ends of steps in a row each contact has been closed."""
        self.worked = False
        self.short = 0
        """How many contacts began and ended within three steps."""
        self.first = ""
        """The first of them, and when."""

    def step(self, t: float, gaps: Sequence[float], *, worked: bool) -> bool:
        """Take note of a step that ends at t: the gaps then, and whether contacts did work in it; whether that is new."""
        before = [count > 0 for count in self.inside]
        now = [gap < 0.0 for gap in gaps]
        for k, (was, closed) in enumerate(zip(before, now, strict=True)):
            if was and not closed and self.inside[k] <= _FEW:
                self._short(self.names[k], t)
            self.inside[k] = self.inside[k] + 1 if closed else 0
        if worked and not self.worked and not any(before) and not any(now):
            self._short("a contact", t)
        changed = before != now or worked != self.worked
        self.worked = worked
        return changed

    def remark(self, h: float) -> str:
        """What to know of contacts that steps of h were too long for; empty if there are none."""
        if not self.short:
            return ""
        times = "once" if self.short == 1 else f"{self.short} times"
        return (
            f"{times} a contact was over within three steps of {h:.3g} s, which is too short to be computed; the first was "
            f"{self.first}: take a smaller dt"
        )

    def _short(self, name: str, t: float) -> None:
        self.short += 1
        self.first = self.first or f"{name!r} before {t:.6g} s"
