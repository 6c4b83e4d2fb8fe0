"""A doubt about a log, and what doubts are judged from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import percent
from ..motion.motion import Motion
from ..motion.single_row_glitches import SINGLE_ROW
from ..typing import Array
from .held_out import HeldOut
from .normal_equations import Prior
from .parameter_groups import BaseParameters
from .setting_trial import FitSettings

_UNEXPLAINED = 0.35
"""Share of the torques left in rows held out that refuses the logs."""
OTHERS, NOTABLE_IN_OTHERS = 2.5, 0.12
"""Times what is left of the training logs that is left of other logs, and the least such share, which say that they differ."""


@dataclass(frozen=True)
class LogDoubt:
    """A doubt about a log.

    Attributes
    ----------
    kind : str, one word for the cause, such as ``sign`` or ``late``
    sentence : str, with the evidence
    joints : tuple of str, those concerned
    refuses : bool, whether no number can be trusted while it stands
    """

    kind: str
    sentence: str
    joints: tuple[str, ...] = ()
    refuses: bool = False

    def __str__(self) -> str:
        return self.sentence


_HARMLESS = ("velocity column", "acceleration column", "velocities make", SINGLE_ROW)
"""What contradictions say that change nothing here: rates are derived from positions, and single rows weigh next to nothing."""


def contradiction(sentence: str, log: str = "") -> LogDoubt:
    """The doubt about columns of a log that contradict each other, as reading it found."""
    refuses = not any(word in sentence for word in _HARMLESS)
    return LogDoubt("contradiction", f"{log}: {sentence}" if log else sentence, refuses=refuses)


def left_unexplained(held: HeldOut, among: HeldOut) -> list[LogDoubt]:
    """What is left in rows held out refuses the logs: much, or of other logs far more than of the training logs ``among``."""
    if held.all > _UNEXPLAINED:
        said = (
            f"rigid bodies with friction leave {percent(held.all, 3)} of the torques unexplained in rows held out: these are "
            "no torques of this robot's joints, or positions are not theirs."
        )
        return [LogDoubt("unexplained", said, refuses=True)]
    if held.kind == "test" and held.all > max(OTHERS * among.all, NOTABLE_IN_OTHERS):
        said = (
            f"the logs held out are explained to {percent(held.all, 3)}, and the training logs among themselves to "
            f"{percent(among.all, 3)}: their torques are not those of the same rigid bodies. Was friction compensated, or "
            "something carried, in one of them?"
        )
        return [LogDoubt("other-torques", said, refuses=True)]
    return []


@dataclass(frozen=True, eq=False)
class Evidence:
    """What doubts are judged from: rows (m, nv, r), (m, nv) at the settings chosen, and what was fitted to them."""

    base: BaseParameters
    motions: Sequence[Motion]
    W: Array
    tau: Array
    fold: Array
    settings: FitSettings
    prior: Prior
    x: Array
    covariance: Array
    held_out: HeldOut
    trained: HeldOut
    speed: Array
    acceleration: Array
    rate: float
    dead: Array
    payload_only: bool = False
    """What the file lacks is sought, so its torques are not expected."""

    @property
    def deviations(self) -> Array:
        """(r,) of the groups."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the joints."""
        return self.base.unknown.model.velocity_names
