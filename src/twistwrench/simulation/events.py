"""Events: zero crossings of functions of the state and of position limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.numbers import number, printed
from ..core.typing import Array
from .forces import ControlLaw, Function, require_three

if TYPE_CHECKING:
    from ..robot import Robot
    from .contact import RobotContact


@dataclass(frozen=True, eq=False)
class PositionLimits:
    """Finite position limits of a robot, m in number.

    A joint within the tolerance of :class:`twistwrench.mechanics.model.limits.Limits` is at its limit. A joint inside its
    limits reaches one where the margin is zero. A joint at a limit leaves through it where the margin falls below minus the
    tolerance. A joint at rest at a limit does not end the simulation.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    """Names and units of the joints, (m,)."""
    sides: Array
    """-1 for lower limits, 1 for upper ones, (m,)."""
    limits: Array
    tolerances: Array
    """Tolerances (m,) [rad or m]."""
    coordinates: Array
    velocities: Array
    """Indices in q and in dq, (m,)."""

    @classmethod
    def from_robot(cls, robot: Robot) -> PositionLimits:
        """Limits of a robot; raises ValueRangeError if it has none."""
        limits, rows = robot.limits, []
        for b in robot.model.leaders:
            if b.joint.nv != 1:
                continue
            k, unit = b.v_index, b.joint.coordinate_units[0]
            for side, limit in ((-1, limits.lower[k]), (1, limits.upper[k])):
                if np.isfinite(limit):
                    rows.append((b.joint.name, unit, side, limit, limits.tolerance[k], b.q_index, k))
        if not rows:
            raise ValueRangeError(f"limits='stop': robot {robot.name!r} has no limits of position. Leave limits out.")
        names, units, *numbers = zip(*rows, strict=True)
        return cls(names, units, *map(np.array, numbers))

    def margins(self, q: Array) -> Array:
        """Distance of each joint to each of its limits, (..., nq) → (..., m), negative beyond it [rad or m]."""
        return np.asarray(self.sides * (self.limits - q[..., self.coordinates]))

    def outside(self, q: Array) -> str:
        """Joint farthest beyond a limit, as text; empty if none is beyond."""
        excess = -self.margins(q) / self.tolerances
        worst = int(excess.argmax())
        if excess[worst] <= 1.0:
            return ""
        place = f"{printed(q[self.coordinates[worst]])} {self.units[worst]}"
        return f"joint {self.names[worst]!r} is at {place}, beyond {self.limit(worst)}"

    def limit(self, k: int) -> str:
        """Limit k as text."""
        side = "lower" if self.sides[k] < 0 else "upper"
        return f"its {side} limit {printed(self.limits[k])} {self.units[k]}"

    def level(self, k: int, before: float) -> float:
        """Margin at which an event happens, for a joint with the margin ``before``."""
        return 0.0 if before > self.tolerances[k] else -float(self.tolerances[k])

    def mark_passings(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Mask of joints that reach their limits or leave through them, by the margins (..., m) before and after."""
        leaves = (after < -self.tolerances) & (-self.tolerances <= before)
        return np.where(before > self.tolerances, after <= 0.0, leaves)

    def words(self, k: int, before: float) -> str:
        """Event text of limit k."""
        verb = "reaches" if before > self.tolerances[k] else "moves beyond"
        return f"joint {self.names[k]!r} {verb} {self.limit(k)}"

    def leaving(self, q: Array, dq: Array, later: Array, h: float) -> int | None:
        """Limit through which a joint at that limit leaves immediately; of several joints, the fastest one.

        A joint leaves if it moves outward, or if it is at rest and moves outward ``h`` s later, at the velocities
        ``later`` (nv). Its speed or acceleration must take it past the tolerance within a second.
        """
        speed = self.sides * dq[self.velocities]
        speed_change = self.sides * (later - dq)[self.velocities]
        rests = np.abs(speed) <= self.tolerances
        leaves = (speed > self.tolerances) | (rests & (speed_change > h * self.tolerances))
        leaves &= np.abs(self.margins(q)) <= self.tolerances
        if not leaves.any():
            return None
        return int(np.where(leaves, speed + speed_change, -np.inf).argmax())


_SLOPE_INTERVAL = 1e-4
"""Fraction of a step over which the slope of an event is measured."""
MAX_SLOPE_RATIO = 3.0
"""Ratio of an event's slope to that of a straight line, above which several zeros in a step are possible."""
_DIRECTIONS = {"both": 0, "up": 1, "down": -1}


@dataclass(frozen=True)
class Event:
    """Event of a simulation: the zeros of a function g(t, q, dq), which may end the simulation.

    At most one zero is found within a step. If the slope of g allows more, a remark of the result names the event. A
    zero at the start does not count.

    Examples
    --------
    >>> upright = Event(lambda t, q, dq: q[0], "upright", direction="up", terminal=True)
    """

    function: Function
    """Function g(t, q, dq) that returns a number."""
    name: str = "event"
    """Name in the result."""
    direction: str = "both"
    """"up", "down" or "both": direction of the zero crossing."""
    terminal: bool = False
    """True if the simulation ends at the event."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ValueRangeError(f"event: the name is {arguments.value_text(self.name)}, and a text is wanted.")
        require_three(self.function, f"event {self.name!r}")
        arguments.choice(self.direction, f"event {self.name!r}: direction", tuple(_DIRECTIONS))


@dataclass(frozen=True, eq=False)
class Happening:
    """Event that happened, with time and state."""

    name: str
    """Name of the event."""
    time: float
    """Time [s]."""
    q: Array
    """Configuration (nq,)."""
    dq: Array
    """Velocities (nv,)."""

    def __str__(self) -> str:
        return f"{self.name} at {number(self.time, 6)} s"


Step = Callable[[float], Array]
"""Function from the time since the start of a step to the state."""


class EventDetector:
    """Events, contacts and position limits, in this order, with their values at the last check."""

    def __init__(
        self,
        events: Sequence[Event],
        split: Callable[[Array], tuple[Array, Array]],
        limits: PositionLimits | None = None,
        contacts: Sequence[RobotContact] = (),
    ) -> None:
        # The start of a contact is a non-terminal event.
        contact_events = [Event(lambda _t, q, _dq, c=c: c.gap(q), c.name, direction="down") for c in contacts]  # type: ignore[misc]
        self.watched, self.events, self.contacts = len(events), (*events, *contact_events), contacts
        """Number of events of the caller; these and those of contacts."""
        self.split, self.limits = split, limits
        self.laws = [ControlLaw(e.function, f"event {e.name!r}", (), ", one number") for e in self.events]
        self.before: list[float] = []
        """Value g of each event at the last check."""
        self.margins: Array = np.zeros(0)
        """Margins of the position limits at the last check."""
        self.state: Array | None = None
        """State at the last check."""
        self.several: dict[str, str] = {}
        """Remarks by event that may have more zero crossings than were found."""

    def values(self, t: float, y: Array) -> tuple[list[float], Array]:
        """Value g of each event, and margin of each limit."""
        q, dq = self.split(y)
        values = [law.number(t, q, dq) for law in self.laws]
        if self.limits is None:
            return values, self.margins
        return values, self.limits.margins(q)

    @property
    def gaps(self) -> list[float]:
        """Gaps of the contacts at the last check [m or rad]."""
        return self.before[self.watched :]

    @property
    def without_callbacks(self) -> bool:
        """True if there are only contacts and position limits."""
        return not self.watched

    def passings(self, states: Array, gaps: Array) -> Iterator[int]:
        """Steps between states (m + 1, size) in which a contact begins or a joint passes a limit, ready to be located."""
        margins = self._margins(states)
        for k in np.flatnonzero(self._begins_or_passes(gaps, margins)).tolist():
            self.stand(gaps[k], margins[k])
            yield k
        self.stand(gaps[-1], margins[-1])

    def mark_passings(self, states: Array) -> tuple[NDArray[np.bool_], Array, Array]:
        """Mask (m,) of states before which a contact begins or a joint passes a limit, with gaps and margins (m + 1, ...)."""
        q = self.split(states.T)[0].T
        after = np.array([contact.gaps(q) for contact in self.contacts]).reshape(-1, len(states)).T
        gaps = np.concatenate([np.array([self.before]), after])
        margins = np.concatenate([self.margins[None], self._margins(states)])
        return self._begins_or_passes(gaps, margins), gaps, margins

    def stand(self, gaps: Array, margins: Array) -> None:
        """Store gaps and margins of a checked state."""
        self.before, self.margins = gaps.tolist(), margins.copy()

    def _margins(self, states: Array) -> Array:
        """Margins of the position limits, (m, limits)."""
        if self.limits is None:
            return np.zeros((len(states), 0))
        return self.limits.margins(self.split(states.T)[0].T)

    def _begins_or_passes(self, gaps: Array, margins: Array) -> NDArray[np.bool_]:
        """Mask (m,): a contact begins or a joint passes a limit between states (m + 1)."""
        mask = ((gaps[:-1] > 0.0) & (gaps[1:] <= 0.0)).any(axis=1)
        if self.limits is not None:
            mask |= self.limits.mark_passings(margins[:-1], margins[1:]).any(axis=1)
        return np.asarray(mask)

    def begin(self, t: float, y: Array) -> None:
        """Store the values of the first state."""
        self.before, self.margins = self.values(t, y)
        self.state = y.copy()

    def leaves_at_once(self, y: Array, later: Array, h: float) -> Happening | None:
        """Event of a joint that starts at a limit and moves beyond it; ``later`` is the state ``h`` s after the first."""
        if self.limits is None:
            return None
        q, dq = self.split(y)
        k = self.limits.leaving(q, dq, self.split(later)[1], h)
        if k is None:
            return None
        return Happening(self.limits.words(k, 0.0), 0.0, q.copy(), dq.copy())

    def look(self, t: float, points: Sequence[tuple[float, Array]], at: Step) -> tuple[list[Happening], float | None]:
        """Events in a step from t through ``points``, and the time of the one that ends the run."""
        events, s0 = [], 0.0
        for s1, y1 in points:
            after, margins = self.values(t + s1, y1)
            self._note_several(t + s1, s1 - s0, y1, after)
            pairs = list(zip(self.before, after, strict=True))
            crossed = [k for k, (g0, g1) in enumerate(pairs) if self._crosses(k, g0, g1)]
            if self.limits is not None and not (margins > self.limits.tolerances).all():
                pairs += zip(self.margins.tolist(), margins.tolist(), strict=True)
                crossed += (len(after) + np.flatnonzero(self.limits.mark_passings(self.margins, margins))).tolist()
            moments = []
            for k in crossed:
                g0, g1 = pairs[k]
                moments.append((self._moment(k, t, (s0, g0), (s1, g1), at), k))
            for s, k in sorted(moments):
                q, dq = self.split(at(s))
                events.append(Happening(self._name(k), t + s, q.copy(), dq.copy()))
                if k >= len(self.events) or self.events[k].terminal:
                    return events, s
            self.before, self.margins, s0 = after, margins, s1
        return events, None

    def _note_several(self, t: float, h: float, y: Array, after: Sequence[float]) -> None:
        """Add remarks on events whose slope at t, after a step of h, allows more zeros than sign changes show."""
        if self.state is not None and h > 0.0:
            y0 = y + _SLOPE_INTERVAL * (self.state - y)
            for k, event in enumerate(self.events[: self.watched]):
                if event.name in self.several:
                    continue
                slope = (after[k] - self._value(k, t - _SLOPE_INTERVAL * h, y0)) / _SLOPE_INTERVAL
                ends = abs(self.before[k]) + abs(after[k])
                changes_sign = min(self.before[k], after[k]) <= 0.0 <= max(self.before[k], after[k])
                max_slope = MAX_SLOPE_RATIO * ends if changes_sign else ends
                jumps = abs(slope) * _SLOPE_INTERVAL > 0.5 * ends
                if abs(slope) > max_slope and not jumps:
                    self.several[event.name] = (
                        f"event {event.name!r} may pass zero more often than was seen: in the step to {number(t, 6)} s its "
                        f"slope is {number(abs(slope) / h, 3)} 1/s, and its values are {number(self.before[k], 3)} and "
                        f"{number(after[k], 3)}. Take a smaller dt than {number(h, 3)} s"
                    )
        self.state = y.copy()

    def _crosses(self, k: int, g0: float, g1: float) -> bool:
        """True if event k crosses zero in its direction from g0 to g1."""
        direction = _DIRECTIONS[self.events[k].direction]
        return (direction >= 0 and g0 < 0.0 <= g1) or (direction <= 0 and g0 > 0.0 >= g1)

    def _name(self, k: int) -> str:
        if self.limits is not None and k >= len(self.events):
            return self.limits.words(k - len(self.events), float(self.margins[k - len(self.events)]))
        return self.events[k].name

    def _value(self, k: int, t: float, y: Array) -> float:
        q, dq = self.split(y)
        if self.limits is not None and k >= len(self.events):
            return float(self.limits.margins(q)[k - len(self.events)])
        return self.laws[k].number(t, q, dq)

    def _moment(self, k: int, t: float, left: tuple[float, float], right: tuple[float, float], at: Step) -> float:
        """Time after t at which g reaches its level, to a few units in the last place, by Brent's method on the step."""
        from scipy.optimize import brentq

        (s0, g0), (s1, g1) = left, right
        level = 0.0
        if self.limits is not None and k >= len(self.events):
            level = self.limits.level(k - len(self.events), g0)
        if g1 == level:
            return s1

        def g(s: float) -> float:
            if s == s0:
                return g0 - level
            if s == s1:
                return g1 - level
            return self._value(k, t + s, at(s)) - level

        return float(brentq(g, s0, s1, xtol=4e-16 * max(t, s1), rtol=1e-15, maxiter=200))
