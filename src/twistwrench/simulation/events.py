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
    """Name of each limit's joint, (m,)."""
    units: tuple[str, ...]
    """Unit of each limit's coordinate, (m,)."""
    sides: Array
    """-1 for lower limits, 1 for upper ones, (m,)."""
    limits: Array
    """Position of each limit, (m,) [rad or m]."""
    tolerances: Array
    """Tolerance of each limit, (m,) [rad or m]."""
    coordinates: Array
    """Index in q of each limit's joint, (m,)."""
    velocities: Array
    """Index in dq of each limit's joint, (m,)."""

    @classmethod
    def from_robot(cls, robot: Robot) -> PositionLimits:
        """Limits of a robot; raises ValueRangeError if it has none."""
        limits = robot.limits
        finite_limits = []  # tuples in the order of the fields
        for b in robot.model.leaders:
            if b.joint.nv != 1:
                continue
            k = b.v_index
            unit = b.joint.coordinate_units[0]
            for side, limit in ((-1, limits.lower[k]), (1, limits.upper[k])):
                if np.isfinite(limit):
                    finite_limits.append((b.joint.name, unit, side, limit, limits.tolerance[k], b.q_index, k))
        if not finite_limits:
            raise ValueRangeError(f"limits='stop': robot {robot.name!r} has no limits of position. Leave limits out.")
        names, units, *numeric_columns = zip(*finite_limits, strict=True)
        return cls(names, units, *[np.array(column) for column in numeric_columns])

    def margins(self, q: Array) -> Array:
        """Distance of the joints to their limits, (..., nq) → (..., m) [rad or m]; negative beyond a limit."""
        return np.asarray(self.sides * (self.limits - q[..., self.coordinates]))

    def outside_text(self, q: Array) -> str:
        """Text about the joint farthest beyond a limit, in tolerances; empty if none is beyond by more than its tolerance."""
        excess_in_tolerances = -self.margins(q) / self.tolerances
        worst = int(excess_in_tolerances.argmax())
        if excess_in_tolerances[worst] <= 1.0:
            return ""
        position = q[self.coordinates[worst]]
        position_text = f"{printed(position)} {self.units[worst]}"
        return f"joint {self.names[worst]!r} is at {position_text}, beyond {self.limit_text(worst)}"

    def limit_text(self, k: int) -> str:
        """Text with side, position and unit of limit k."""
        side = "lower" if self.sides[k] < 0 else "upper"
        return f"its {side} limit {printed(self.limits[k])} {self.units[k]}"

    def event_margin(self, k: int, margin_before: float) -> float:
        """Margin at which a joint reaches limit k or leaves through it, by its margin before the step [rad or m]."""
        return 0.0 if margin_before > self.tolerances[k] else -float(self.tolerances[k])

    def mark_passings(self, margins_before: Array, margins_after: Array) -> NDArray[np.bool_]:
        """Mask (..., m) of limits that a joint reaches or leaves through, by the margins (..., m) before and after."""
        leaves = (margins_after < -self.tolerances) & (-self.tolerances <= margins_before)
        return np.where(margins_before > self.tolerances, margins_after <= 0.0, leaves)

    def event_text(self, k: int, margin_before: float) -> str:
        """Text of the event at limit k."""
        verb = "reaches" if margin_before > self.tolerances[k] else "moves beyond"
        return f"joint {self.names[k]!r} {verb} {self.limit_text(k)}"

    def limit_left_at_start(self, q: Array, dq: Array, next_dq: Array, h: float) -> int | None:
        """Index of the limit through which a joint leaves immediately; of several joints, the fastest one.

        A joint at its limit leaves if it moves outward, or if it is at rest and moves outward ``h`` s later, at the
        velocities ``next_dq`` (nv,). Its speed or acceleration must take it past the tolerance within a second. None
        if no joint leaves.
        """
        outward_speed = self.sides * dq[self.velocities]
        speed_change = self.sides * (next_dq - dq)[self.velocities]
        rests = np.abs(outward_speed) <= self.tolerances
        leaves = (outward_speed > self.tolerances) | (rests & (speed_change > h * self.tolerances))
        leaves &= np.abs(self.margins(q)) <= self.tolerances
        if not leaves.any():
            return None
        next_speed = outward_speed + speed_change
        return int(np.where(leaves, next_speed, -np.inf).argmax())


_SLOPE_INTERVAL = 1e-4
"""Fraction of a step over which the slope of an event is measured."""
MAX_SLOPE_RATIO = 3.0
"""Ratio of an event's slope to that of a straight line, above which several zeros in a step are possible."""
_JUMP_SHARE = 0.5
"""Change of g within the slope interval, relative to its values at the ends of a step, above which g jumps."""
_DIRECTIONS = {"both": 0, "up": 1, "down": -1}
"""Sign of the slope of g at a zero crossing that counts; 0 for any sign."""


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
    """Events, contacts and position limits, numbered in this order, with their values at the last check.

    States are vectors y; ``split`` returns q and dq of a state. In arrays of states, each row is a state.
    """

    def __init__(
        self,
        events: Sequence[Event],
        split: Callable[[Array], tuple[Array, Array]],
        limits: PositionLimits | None = None,
        contacts: Sequence[RobotContact] = (),
    ) -> None:
        # The start of a contact is a non-terminal event. c=c binds the contact of each pass to its function.
        contact_events = [Event(lambda _t, q, _dq, c=c: c.gap(q), c.name, direction="down") for c in contacts]  # type: ignore[misc]
        self.caller_event_count = len(events)
        self.events = (*events, *contact_events)
        self.contacts = contacts
        self.split = split
        self.limits = limits
        self.laws = [ControlLaw(e.function, f"event {e.name!r}", (), ", one number") for e in self.events]
        self.last_values: list[float] = []
        """Value g of each event at the last check."""
        self.margins: Array = np.zeros(0)
        """Margins of the position limits at the last check."""
        self.last_state: Array | None = None
        """State at the last check; None before the first."""
        self.missed_zero_remarks: dict[str, str] = {}
        """Remarks by the name of an event that may have more zero crossings than were found."""

    def values(self, t: float, y: Array) -> tuple[list[float], Array]:
        """Value g of each event, and margin of each limit, in the state y."""
        q, dq = self.split(y)
        values = [law.number(t, q, dq) for law in self.laws]
        if self.limits is None:
            return values, self.margins
        return values, self.limits.margins(q)

    @property
    def gaps(self) -> list[float]:
        """Gaps of the contacts at the last check [m or rad]."""
        return self.last_values[self.caller_event_count :]

    @property
    def without_callbacks(self) -> bool:
        """True if there are only contacts and position limits."""
        return self.caller_event_count == 0

    def steps_with_passings(self, states: Array, gaps: Array) -> Iterator[int]:
        """Indices of steps between states (m + 1, size) in which a contact begins or a joint passes a limit.

        While the caller has an index, the stored values are those before that step; at the end, those of the last state.
        """
        margins = self._margins(states)
        begins_or_passes = self._begins_or_passes(gaps, margins)
        for k in np.flatnonzero(begins_or_passes).tolist():
            self.store_values(gaps[k], margins[k])
            yield k
        self.store_values(gaps[-1], margins[-1])

    def mark_passings(self, states: Array) -> tuple[NDArray[np.bool_], Array, Array]:
        """Mask (m,) of states before which a contact begins or a joint passes a limit, with gaps and margins (m + 1, ...).

        The first row of gaps and margins is that of the last check.
        """
        q = self._configurations(states)
        gaps_after = np.array([contact.gaps(q) for contact in self.contacts]).reshape(-1, len(states)).T
        gaps = np.concatenate([np.array([self.last_values]), gaps_after])
        margins = np.concatenate([self.margins[None], self._margins(states)])
        return self._begins_or_passes(gaps, margins), gaps, margins

    def store_values(self, gaps: Array, margins: Array) -> None:
        """Store gaps and margins of a checked state, if contacts are the only events."""
        self.last_values = gaps.tolist()
        self.margins = margins.copy()

    def _configurations(self, states: Array) -> Array:
        """Configurations (m, nq) of states (m, size)."""
        q_columns, _ = self.split(states.T)
        return q_columns.T

    def _margins(self, states: Array) -> Array:
        """Margins of the position limits in states (m, size): (m, limits)."""
        if self.limits is None:
            return np.zeros((len(states), 0))
        return self.limits.margins(self._configurations(states))

    def _begins_or_passes(self, gaps: Array, margins: Array) -> NDArray[np.bool_]:
        """Mask (m,): a contact begins or a joint passes a limit between states, by m + 1 gaps and margins."""
        contact_begins = (gaps[:-1] > 0.0) & (gaps[1:] <= 0.0)
        mask = contact_begins.any(axis=1)
        if self.limits is not None:
            passes_limit = self.limits.mark_passings(margins[:-1], margins[1:])
            mask |= passes_limit.any(axis=1)
        return np.asarray(mask)

    def begin(self, t: float, y: Array) -> None:
        """Store the values of the first state."""
        self.last_values, self.margins = self.values(t, y)
        self.last_state = y.copy()

    def event_at_start(self, y: Array, next_y: Array, h: float) -> Happening | None:
        """Event of a joint that starts at a limit and moves beyond it; ``next_y`` is the state ``h`` s after y."""
        if self.limits is None:
            return None
        q, dq = self.split(y)
        _, next_dq = self.split(next_y)
        k = self.limits.limit_left_at_start(q, dq, next_dq, h)
        if k is None:
            return None
        return Happening(self.limits.event_text(k, 0.0), 0.0, q.copy(), dq.copy())

    def events_of_step(
        self, t: float, points: Sequence[tuple[float, Array]], state_at: Step
    ) -> tuple[list[Happening], float | None]:
        """Events in a step that begins at t, and the time after t of the event that ends the run; None if none does.

        The step is checked at ``points``: times after t, in order, and states.
        """
        events = []
        s0 = 0.0  # time after t of the last check
        for s1, y1 in points:
            values, margins = self.values(t + s1, y1)
            self._note_missed_zeros(t + s1, s1 - s0, y1, values)
            before_and_after = list(zip(self.last_values, values, strict=True))
            crossed = [k for k, (g0, g1) in enumerate(before_and_after) if self._crosses(k, g0, g1)]
            # usually all joints are inside their limits, and nothing is compared
            if self.limits is not None and not (margins > self.limits.tolerances).all():
                before_and_after += zip(self.margins.tolist(), margins.tolist(), strict=True)
                passed_limits = np.flatnonzero(self.limits.mark_passings(self.margins, margins))
                crossed += (len(values) + passed_limits).tolist()
            moments = []
            for k in crossed:
                g0, g1 = before_and_after[k]
                moment = self._moment(k, t, (s0, g0), (s1, g1), state_at)
                moments.append((moment, k))
            for s, k in sorted(moments):
                q, dq = self.split(state_at(s))
                events.append(Happening(self._name(k), t + s, q.copy(), dq.copy()))
                if k >= len(self.events) or self.events[k].terminal:
                    return events, s
            self.last_values = values
            self.margins = margins
            s0 = s1
        return events, None

    def _note_missed_zeros(self, t: float, h: float, y: Array, values: Sequence[float]) -> None:
        """Add remarks on events of the caller that may have more zeros in the step of h s up to t than their signs show."""
        if self.last_state is not None and h > 0.0:
            y_before = y + _SLOPE_INTERVAL * (self.last_state - y)
            t_before = t - _SLOPE_INTERVAL * h
            for k, event in enumerate(self.events[: self.caller_event_count]):
                if event.name in self.missed_zero_remarks:
                    continue
                g0, g1 = self.last_values[k], values[k]
                slope = (g1 - self._value(k, t_before, y_before)) / _SLOPE_INTERVAL  # per step, not per second
                sum_of_ends = abs(g0) + abs(g1)
                changes_sign = min(g0, g1) <= 0.0 <= max(g0, g1)
                max_slope = MAX_SLOPE_RATIO * sum_of_ends if changes_sign else sum_of_ends
                # a jump of g within the short interval is not a slope
                jumps = abs(slope) * _SLOPE_INTERVAL > _JUMP_SHARE * sum_of_ends
                if abs(slope) > max_slope and not jumps:
                    self.missed_zero_remarks[event.name] = (
                        f"event {event.name!r} may pass zero more often than was seen: in the step to {number(t, 6)} s its "
                        f"slope is {number(abs(slope) / h, 3)} 1/s, and its values are {number(g0, 3)} and "
                        f"{number(g1, 3)}. Take a smaller dt than {number(h, 3)} s"
                    )
        self.last_state = y.copy()

    def _crosses(self, k: int, g0: float, g1: float) -> bool:
        """True if event k crosses zero in its direction from g0 to g1."""
        direction = _DIRECTIONS[self.events[k].direction]
        return (direction >= 0 and g0 < 0.0 <= g1) or (direction <= 0 and g0 > 0.0 >= g1)

    def _name(self, k: int) -> str:
        """Name of event k, or text of the limit that follows the events."""
        if self.limits is not None and k >= len(self.events):
            limit = k - len(self.events)
            return self.limits.event_text(limit, float(self.margins[limit]))
        return self.events[k].name

    def _value(self, k: int, t: float, y: Array) -> float:
        """Value g of event k, or margin of the limit that follows the events."""
        q, dq = self.split(y)
        if self.limits is not None and k >= len(self.events):
            margins = self.limits.margins(q)
            return float(margins[k - len(self.events)])
        return self.laws[k].number(t, q, dq)

    def _moment(self, k: int, t: float, left: tuple[float, float], right: tuple[float, float], state_at: Step) -> float:
        """Time after t at which event k happens, to a few units in the last place, by Brent's method.

        ``left`` and ``right`` are the time after t and the value of g at the ends of the step.
        """
        from scipy.optimize import brentq

        s0, g0 = left
        s1, g1 = right
        level = 0.0  # value of g at the event
        if self.limits is not None and k >= len(self.events):
            level = self.limits.event_margin(k - len(self.events), g0)
        if g1 == level:
            return s1

        def difference_from_level(s: float) -> float:
            """g - level at the time s after t; the values at the ends are known."""
            if s == s0:
                return g0 - level
            if s == s1:
                return g1 - level
            return self._value(k, t + s, state_at(s)) - level

        time_tolerance = 4e-16 * max(t, s1)  # two units in the last place of the time [s]
        # rtol: the rounding of s itself; maxiter: far above what Brent's method needs
        return float(brentq(difference_from_level, s0, s1, xtol=time_tolerance, rtol=1e-15, maxiter=200))
