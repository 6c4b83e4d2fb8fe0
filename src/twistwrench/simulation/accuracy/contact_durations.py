"""Durations of contacts in a run: contacts shorter than a step are not resolved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.numbers import printed
from ...core.typing import Array

MAX_STEPS_OF_SHORT_CONTACT = 2
"""Largest number of consecutive step ends with a closed contact for which the contact counts as too short."""


class ContactDurations:
    """Contact states of a run, step by step."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._closed = np.zeros(len(self.names), bool)
        self._since = np.zeros(len(self.names), int)
        """Index of the step end at which each contact closed last."""
        self._worked = False
        """True if contacts did work in the last step."""
        self._steps = 0
        """Number of recorded steps."""
        self.short = 0
        """Number of contacts that began and ended within three steps."""
        self.first = ""
        """Name and time of the first of these contacts, as text."""

    def step(self, t: float, gaps: Sequence[float], *, worked: bool) -> bool:
        """Record the gaps at the end t of a step, and whether contacts did work; returns True if the contact state changed."""
        return bool(self.block(np.array([t]), np.array([gaps], float), np.array([worked]))[0])

    def block(self, times: Array, gaps: Array, worked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Record m steps that end at times (m,) with gaps (m, contacts) and a mask (m,) of those in which contacts did work.

        Returns a mask (m,) of the steps in which the contact state changed.
        """
        if not self.names:
            return np.zeros(len(times), bool)
        closed = np.concatenate([self._closed[None], gaps < 0.0])  # row k + 1 belongs to the end of step k
        works = np.concatenate([[self._worked], worked])
        changed = (closed[1:] != closed[:-1]).any(axis=1) | (works[1:] != works[:-1])
        for k in np.flatnonzero(changed).tolist():
            t = float(times[k])
            before, now = closed[k], closed[k + 1]
            step = self._steps + k + 1
            for j in np.flatnonzero(before & ~now).tolist():
                if step - self._since[j] <= MAX_STEPS_OF_SHORT_CONTACT:
                    self._note_short(self.names[j], t)
            self._since[now & ~before] = step
            began_to_work = works[k + 1] and not works[k]
            if began_to_work and not before.any() and not now.any():  # it began and ended within this step
                self._note_short("a contact", t)
        self._closed = closed[-1]
        self._worked = bool(works[-1])
        self._steps += len(times)
        return np.asarray(changed)

    def remark(self, h: float) -> str:
        """Remark on contacts for which steps of h are too long; empty if there are none."""
        if not self.short:
            return ""
        times = "once" if self.short == 1 else f"{self.short} times"
        return (
            f"{times} a contact was over within three steps of {printed(h, 3)} s, which is too short to be computed; the "
            f"first was {self.first}: take a smaller dt"
        )

    def _note_short(self, name: str, t: float) -> None:
        """Count a contact that was too short and had ended at time t."""
        self.short += 1
        if not self.first:
            self.first = f"{name!r} before {printed(t)} s"
