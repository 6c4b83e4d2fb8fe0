"""How many steps each contact of a run lasts: one that is shorter than a step is no more than guessed by any method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.printed_numbers import printed
from ..typing import Array

_FEW = 2
"""Ends of steps in a row at which a contact that is too short is closed, at most."""


class Touches:
    """The contacts of a run, step by step."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._closed = np.zeros(len(self.names), bool)
        self._since = np.zeros(len(self.names), int)
        """The end of a step at which each contact closed last, counted from the beginning."""
        self._worked = False
        self._steps = 0
        self.short = 0
        """How many contacts began and ended within three steps."""
        self.first = ""
        """The first of them, and when."""

    def step(self, t: float, gaps: Sequence[float], *, worked: bool) -> bool:
        """Take note of a step that ends at t: the gaps then, and whether contacts did work in it; whether that is new."""
        return bool(self.block(np.array([t]), np.array([gaps], float), np.array([worked]))[0])

    def block(self, times: Array, gaps: Array, worked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The same of m steps that end at times (m,), with gaps (m, contacts); (m,)."""
        if not self.names:
            return np.zeros(len(times), bool)
        closed = np.concatenate([self._closed[None], gaps < 0.0])
        works = np.concatenate([[self._worked], worked])
        changed = (closed[1:] != closed[:-1]).any(axis=1) | (works[1:] != works[:-1])
        for k in np.flatnonzero(changed).tolist():
            t, before, now = float(times[k]), closed[k], closed[k + 1]
            step = self._steps + k + 1
            for j in np.flatnonzero(before & ~now).tolist():
                if step - self._since[j] <= _FEW:
                    self._short(self.names[j], t)
            self._since[now & ~before] = step
            if works[k + 1] and not works[k] and not before.any() and not now.any():
                self._short("a contact", t)
        self._closed, self._worked, self._steps = closed[-1], bool(works[-1]), self._steps + len(times)
        return np.asarray(changed)

    def remark(self, h: float) -> str:
        """What to know of contacts that steps of h were too long for; empty if there are none."""
        if not self.short:
            return ""
        times = "once" if self.short == 1 else f"{self.short} times"
        return (
            f"{times} a contact was over within three steps of {printed(h, 3)} s, which is too short to be computed; the "
            f"first was {self.first}: take a smaller dt"
        )

    def _short(self, name: str, t: float) -> None:
        self.short += 1
        self.first = self.first or f"{name!r} before {printed(t)} s"
