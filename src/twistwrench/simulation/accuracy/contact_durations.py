"""Durations of contacts in a run: contacts shorter than a step are not resolved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.numbers import printed
from ...core.typing import Array

MAX_STEPS_OF_SHORT_CONTACT = 2
"""Largest number of consecutive ends of steps at which a contact is closed and still counts as too short."""


class ContactDurations:
    """Contact states of a run, step by step, and its contacts that were too short."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._is_closed = np.zeros(len(self.names), bool)
        """True for contacts that were closed at the end of the last step."""
        self._closing_steps = np.zeros(len(self.names), int)
        """Number of the step at whose end each contact closed last."""
        self._worked = False
        """True if contacts did work in the last step."""
        self._step_count = 0
        """Number of recorded steps."""
        self.short = 0
        """Number of contacts that began and ended within three steps."""
        self.first = ""
        """Name and time of the first of these contacts, as text."""

    def step(self, t: float, gaps: Sequence[float], *, worked: bool) -> bool:
        """Record the gaps at the end t of a step, and if contacts did work; returns True if the contact state changed."""
        (has_changed,) = self.block(np.array([t]), np.array([gaps], float), np.array([worked]))
        return bool(has_changed)

    def block(self, times: Array, gaps: Array, worked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Record m steps that end at times (m,) with gaps (m, contacts); ``worked`` (m,) is True if contacts did work in them.

        Returns (m,): True for steps in which the contact state changed.
        """
        if not self.names:
            return np.zeros(len(times), bool)
        is_closed = np.concatenate([self._is_closed[None], gaps < 0.0])  # row k + 1 belongs to the end of step k
        does_work = np.concatenate([[self._worked], worked])
        has_changed = (is_closed[1:] != is_closed[:-1]).any(axis=1) | (does_work[1:] != does_work[:-1])
        for k in np.flatnonzero(has_changed).tolist():
            t = float(times[k])
            was_closed, ends_closed = is_closed[k], is_closed[k + 1]
            step_number = self._step_count + k + 1
            for j in np.flatnonzero(was_closed & ~ends_closed).tolist():
                if step_number - self._closing_steps[j] <= MAX_STEPS_OF_SHORT_CONTACT:
                    self._note_short(self.names[j], t)
            self._closing_steps[ends_closed & ~was_closed] = step_number
            began_to_work = does_work[k + 1] and not does_work[k]
            is_closed_at_ends = was_closed.any() or ends_closed.any()
            if began_to_work and not is_closed_at_ends:  # it began and ended within this step
                self._note_short("a contact", t)
        self._is_closed = is_closed[-1]
        self._worked = bool(does_work[-1])
        self._step_count += len(times)
        return np.asarray(has_changed)

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
