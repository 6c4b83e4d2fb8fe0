"""How far off a simulated motion may be: the errors of its steps, measured against the motion, and what to say of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.printed_numbers import percent
from ..motion.coordinates import Coordinates
from ..typing import Array
from .schemes import ADAPTIVE

if TYPE_CHECKING:
    from ..robot import Robot

_DRIFT = 0.01
"""Share of the energy that moved from which the drift is remarked on."""
_ERROR = 0.05
"""Share of the motion from which its error is remarked on. Errors that would cancel are added up, so less says little."""
_REST = 1e-9
"""rad or m: a motion shorter than this is rest."""
_MANY = 1e4
_MORE = "more than 10 000 times"
"""Times the motion from which its error is not said in numbers."""
_ROWS = 2000


@dataclass(frozen=True, eq=False)
class Extent:
    """How far and for how long the joints of a run move: all that turn together, and all that slide."""

    travels: Array
    """(nv,) rad or m, the largest difference of two places of a joint."""
    spans: Array
    """(nv,) s, the travel at the peak speed."""

    @property
    def rests(self) -> Array:
        """(nv,) whether a joint does not move at all."""
        return np.asarray(self.travels < _REST)

    @classmethod
    def of(cls, robot: Robot, states: Array) -> Extent:
        """Of states (n, nq + nv or more)."""
        rows: Any = slice(None)
        if len(states) > _ROWS:
            rows = np.linspace(0, len(states) - 1, _ROWS).round().astype(int)
        ways = np.ascontiguousarray(robot.subtract(states[rows, : robot.nq], states[0, : robot.nq]).T)
        rates = np.ascontiguousarray(states[:, robot.nq : robot.nq + robot.nv].T)  # rows are faster
        each, speeds = ways.max(axis=1) - ways.min(axis=1), np.maximum(rates.max(axis=1), -rates.min(axis=1))
        travels, spans = np.zeros(robot.nv), np.zeros(robot.nv)
        angular = Coordinates.of(robot.model).angular_velocity
        for group in (angular, ~angular):
            if group.any():
                travels[group], peak = each[group].max(), speeds[group].max()
                spans[group] = travels[group] / peak if peak > 0.0 else 0.0
        return cls(travels, spans)


@dataclass(frozen=True, eq=False)
class Accuracy:
    """The error of each coordinate, and of the motion as a whole."""

    error: Array
    """(nv,) rad or m, NaN where nothing is known."""
    relative: float

    @classmethod
    def of(cls, extent: Extent, error: Array) -> Accuracy:
        """An error (nv,), measured against the motion."""
        return cls(error, float(np.max(error / np.maximum(extent.travels, _REST))))

    @classmethod
    def unknown(cls, nv: int) -> Accuracy:
        """Where no step was judged."""
        return cls(np.full(nv, np.nan), np.nan)

    @property
    def remarkable(self) -> bool:
        """Whether the error is a share of the motion that is remarked on."""
        return self.relative > _ERROR

    def remarks(self, method: str, relative_drift: float) -> list[str]:
        """What to say of errors and drift where they call for it."""
        less, said = "rtol" if method == ADAPTIVE else "dt", []
        if self.remarkable:
            share = f"about {_percent(self.relative)} of" if self.relative < _MANY else _MORE
            said.append(f"the errors of its steps add up to {share} the motion: take a smaller {less}")
        if relative_drift > _DRIFT:
            said.append(
                f"the energy is off by {_percent(relative_drift)} of what moved: the motion, or the work said to be "
                f"done, is wrong: take a smaller {less}"
            )
        return said


def _percent(share: float) -> str:
    return percent(share, 2 if share < 1.0 else None) if share < _MANY else _MORE
