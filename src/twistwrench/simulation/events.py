"""What happens at a moment that no step knows beforehand: a function of the state goes through zero, and is found there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ValueRangeError
from .given import Function, Law, require_three

if TYPE_CHECKING:
    from ..robot import Robot
    from .contact import Contact

Array = NDArray[Any]

__all__ = ["Event", "Happening", "Watch", "contact_events", "limit_event", "limit_name"]

_DIRECTIONS = {"both": 0, "up": 1, "down": -1}


@dataclass(frozen=True)
class Event:
    """A function g(t, q, dq) whose zeros are looked for, and whether the simulation ends there.

    ``direction``: ``"up"``, ``"down"`` or ``"both"``, the way g passes zero. Two zeros within a step of a method are not seen.
    A zero at the very start is none. Raises ValueRangeError.

    >>> upright = Event(lambda t, q, dq: q[0], "upright", direction="up", terminal=True)
    """

    function: Function
    name: str = "event"
    direction: str = "both"
    terminal: bool = False

    def __post_init__(self) -> None:
        require_three(self.function, f"event {self.name!r}")
        if self.direction not in _DIRECTIONS:
            raise ValueRangeError(f"event {self.name!r}: direction is {self.direction!r}; choose up, down or both.")


@dataclass(frozen=True, eq=False)
class Happening:
    """An event that happened: when, and in which state."""

    name: str
    time: float
    """s."""
    q: Array
    """(nq,)."""
    dq: Array
    """(nv,)."""

    def __str__(self) -> str:
        return f"{self.name} at {self.time:.6g} s"


Step = Callable[[float], Array]
"""From a time after the beginning of a step to the state then."""


class Watch:
    """Events, and the signs they had when last looked at."""

    def __init__(
        self,
        events: Sequence[Event],
        named: Callable[[Event, Array], str],
        split: Callable[[Array], tuple[Array, Array]],
    ) -> None:
        self.events, self.named, self.split = tuple(events), named, split
        self.laws = [Law(e.function, f"event {e.name!r}", (), ", one number") for e in events]
        self.before: list[float] = []

    def values(self, t: float, y: Array) -> list[float]:
        """g of each event."""
        q, dq = self.split(y)
        return [float(law(t, q, dq)) for law in self.laws]

    def begin(self, t: float, y: Array) -> None:
        """Take the signs of the first state."""
        self.before = self.values(t, y)

    def look(self, t: float, points: Sequence[tuple[float, Array]], at: Step) -> tuple[list[Happening], float | None]:
        """What happened in a step from t whose states at some times after t are ``points``; and when it ended all, if so."""
        happened, s0 = [], 0.0
        for s1, y1 in points:
            after = self.values(t + s1, y1)
            pairs = list(zip(self.before, after, strict=True))
            crossed = [k for k, pair in enumerate(pairs) if self._passed(k, *pair)]
            for s, k in sorted((self._moment(k, t, (s0, pairs[k][0]), (s1, pairs[k][1]), at), k) for k in crossed):
                q, dq = self.split(at(s))
                happened.append(Happening(self.named(self.events[k], q), t + s, q.copy(), dq.copy()))
                if self.events[k].terminal:
                    return happened, s
            self.before, s0 = after, s1
        return happened, None

    def _passed(self, k: int, g0: float, g1: float) -> bool:
        way = _DIRECTIONS[self.events[k].direction]
        return (way >= 0 and g0 < 0.0 <= g1) or (way <= 0 and g0 > 0.0 >= g1)

    def _moment(self, k: int, t: float, left: tuple[float, float], right: tuple[float, float], at: Step) -> float:
        """The zero between two times after t, by Brent's method on the step itself, to a few units in the last place."""
        from scipy.optimize import brentq

        (s0, g0), (s1, g1) = left, right
        if g1 == 0.0:
            return s1

        def g(s: float) -> float:
            return g0 if s == s0 else g1 if s == s1 else float(self.laws[k](t + s, *self.split(at(s))))

        return float(brentq(g, s0, s1, xtol=4e-16 * max(t, s1), rtol=1e-15, maxiter=200))


def limit_event(robot: Robot) -> Event:
    """The first joint of one degree of freedom to reach a limit of position; it ends the simulation."""
    bodies = [b for b in robot.model.leaders if b.joint.nv == 1]
    i, k = (np.array([getattr(b, x) for b in bodies], int) for x in ("q_index", "v_index"))
    lower, upper = robot.limits.lower[k], robot.limits.upper[k]

    def margin(_t: float, q: Array, _dq: Array) -> float:
        return float(min(np.min(q[i] - lower, initial=np.inf), np.min(upper - q[i], initial=np.inf)))

    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        raise ValueRangeError(f"limits='stop': robot {robot.name!r} has no limits of position. Leave limits out.")
    return Event(margin, "limit", direction="down", terminal=True)


def limit_name(robot: Robot, q: Array) -> str:
    """Which joint is nearest to its limit, or beyond it, in words."""
    best, words = np.inf, ""
    for b in robot.model.leaders:
        if b.joint.nv == 1:
            x, low, high = q[b.q_index], robot.limits.lower[b.v_index], robot.limits.upper[b.v_index]
            for gap, side, limit in ((x - low, "lower", low), (high - x, "upper", high)):
                if gap < best:
                    best, words = gap, f"joint {b.joint.name!r} reaches its {side} limit {limit:.6g}"
    return words


def contact_events(contacts: Sequence[Contact]) -> list[Event]:
    """The beginning of each contact; it ends nothing."""
    return [Event(lambda _t, q, _dq, c=c: c.gap(q), c.name, direction="down") for c in contacts]  # type: ignore[misc]
