"""Where a motion contradicts itself: rates that are not those of its positions, jumps, and time in another unit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import printed, seconds
from ..listing import listed
from ..typing import Array
from .angle_units import AngleUnits
from .coordinates import Coordinates
from .gain_text import described_gain, near
from .rate_delay import RateDelay
from .rate_gain import RateGain, segments
from .single_row_glitches import SingleRowGlitches
from .turns_left_out import TurnsLeftOut

if TYPE_CHECKING:
    from ..model.limits import Limits
    from .motion_log import LogRows

_ALLOWED = {"velocity": (0.85, 1.15), "acceleration": (0.75, 1.3)}
"""Times the slope of what it belongs to that a measured rate may be: filters and delays cost less (measured velocities of
real logs are 0.94 to 1.02 times the slope), a wrong unit, ratio or clock more."""
_WRAP = (1.5 * math.pi, 2.5 * math.pi)
"""A step of an angle between these [rad] is taken for a turn that the log left out, where the log keeps within a turn."""
_SPILL = 0.01 * math.pi
_TOO_FAST = 3.0
"""Times the greatest speed elsewhere, or the velocity limit, from which a step of more than half a turn is a jump."""
_LONG_STEP, _SHORT_MOVE, _SOME_MOVE, _FEWEST_STEPS = 1.0, 0.1, 0.05, 20
"""A step of time [s] so long, with moves [rad, m] so short in every one, is in ms: else the motion would be sampled far
more finely than it is slow."""

_BEYOND, _NO_ROBOT = 1.5, 30.0
"""Times its limit, and rad/s or m/s without one, that no joint moves at: times are not in a unit that would make it so fast."""
_SLOW_STEP, _SLOW_SHARE = 0.1, 1 / 300
"""A step of time [s] so long in a motion that never goes faster than that share of its limits is in ms: robots are built for
their limits, and loggers for steps of 0.1 ms and more."""


class Contradictions:
    """A tally over the rows of a motion, which come in any portions."""

    def __init__(
        self,
        coordinates: Coordinates,
        *,
        time_stated: bool = True,
        angle: Array | None = None,
        angle_stated: Array | None = None,
    ) -> None:
        """``angle`` (nq,) is what took the file's angles to radians, and ``angle_stated`` (nq,) whether the file says that."""
        count = len(coordinates.names)
        self._factor = np.ones(count) if angle is None else angle
        self._stated = np.zeros(count, bool) if angle_stated is None else angle_stated
        self._names = coordinates.velocity_names
        self._angular = coordinates.angular_velocity
        self._single = np.flatnonzero(coordinates.position_of >= 0)
        self.at = coordinates.position_of[self._single]
        self._turns = coordinates.angular[self.at]
        self._bounded = self._turns & ~coordinates.endless[self.at]
        self._time_stated = time_stated
        count = len(self._single)
        self._velocity, self._acceleration = RateGain(count), RateGain(len(self._names))
        self._derived = RateGain(count)
        self._delay = RateDelay(count)
        self._glitches = SingleRowGlitches(count, self._turns)
        self._last: tuple[float, Array] | None = None
        self._least, self._greatest = np.full(count, math.inf), np.full(count, -math.inf)
        self._wraps = np.zeros(count, int)
        self._turned = TurnsLeftOut(self._bounded, _WRAP)
        self._jumps: dict[int, tuple[float, float, float]] = {}
        """Of each joint the fastest step beyond half a turn: speed, time before, size."""
        self._wrapped: dict[int, tuple[float, float, float]] = {}
        """Of each joint the first step that may be a turn left out, likewise."""
        self._speed, self._move = np.zeros(count), np.zeros(count)
        self._steps: list[float] = []
        self._rows = 0

    def add(self, motion: LogRows) -> None:
        """Take in consecutive rows."""
        t, q = motion.time, motion.q[:, self.at]
        if not len(t):
            return
        self.look_at_steps(t, q)
        self._glitches.add(t, q)
        if motion.dq is not None:
            self._delay.add(t, self._curves(motion), motion.dq[:, self._single])
        self.look_at_rates(motion)

    def _curves(self, motion: LogRows) -> Array:
        """Coordinates ``at`` (n, m) without the steps of a turn."""
        curves = motion.q[:, self.at].copy()
        curves[:, self._turns] = np.unwrap(curves[:, self._turns], axis=0)
        return curves

    def look_at_rates(self, motion: LogRows) -> None:
        """Take in the sizes of velocities and accelerations beside the slopes of what they belong to."""
        t, dq, ddq = motion.time, motion.dq, motion.ddq
        curves = self._curves(motion)
        for s in segments(t) if dq is not None or ddq is not None else ():
            if dq is not None:
                self._velocity.add(t[s], curves[s], dq[s][:, self._single])
            if ddq is not None and dq is not None:
                self._acceleration.add(t[s], dq[s], ddq[s])
            elif ddq is not None:
                self._derived.add(t[s], np.gradient(curves[s], t[s], axis=0), ddq[s][:, self._single])

    def look_at_steps(self, t: Array, q: Array) -> None:
        """Take in the steps of time, and of the coordinates ``at`` (n, m)."""
        self._rows += len(t)
        self._least, self._greatest = np.minimum(self._least, q.min(axis=0)), np.maximum(self._greatest, q.max(axis=0))
        if self._last is not None:
            t, q = np.r_[self._last[0], t], np.concatenate([self._last[1][None], q])
        self._last = float(t[-1]), q[-1].copy()
        h, moved = np.diff(t), np.diff(q, axis=0)
        self._turned.add(q, moved)
        if not len(h):
            return
        self._steps.append(float(np.median(h)))
        size = np.abs(moved)
        far = (size > math.pi) & self._bounded
        speed = np.where(far | (size > math.pi) & self._turns, 0.0, size / h[:, None])
        self._speed = np.maximum(self._speed, speed.max(axis=0))
        self._move = np.maximum(self._move, np.where((size > math.pi) & self._turns, 0.0, size).max(axis=0))
        for row, k in np.argwhere(far).tolist():
            found = float(size[row, k] / h[row]), float(t[row]), float(moved[row, k])
            if _WRAP[0] < size[row, k] < _WRAP[1]:
                self._wraps[k] += 1
                self._wrapped.setdefault(k, found)
            elif k not in self._jumps or found[0] > self._jumps[k][0]:
                self._jumps[k] = found

    def _within_a_turn(self) -> Array:
        about_zero = (self._least >= -math.pi - _SPILL) & (self._greatest <= math.pi + _SPILL)
        return np.asarray(about_zero | ((self._least >= -_SPILL) & (self._greatest <= math.tau + _SPILL)))

    def notes(self) -> list[str]:
        """What was put right by itself."""
        found = np.flatnonzero((self._wraps > 0) & self._within_a_turn())
        return [
            f"{self._names[self._single[k]]} steps by a full turn {self._wraps[k]} time{'s' if self._wraps[k] > 1 else ''}, "
            f"first at t = {seconds(self._wrapped[k][1], 4)} s: the log keeps within a turn, so it is taken to turn on."
            for k in found.tolist()
        ]

    def sentences(self, limits: Limits | None = None, *, glitches: bool = True) -> tuple[str, ...]:
        """A sentence for each contradiction; limits of velocity help to tell a jump from a fast motion."""
        of_time = tuple(self._of_time(limits))
        angles = self._angle_units(limits).contradictions
        wrapped = (self._wraps > 0) & self._within_a_turn()
        turns = () if limits is None else self._turned.sentences(wrapped, self._single, self._names, limits)
        jumps = () if angles else (*self._of_jumps(limits), *turns, *(self._of_glitches() if glitches else ()))
        delays = self._delay.result() if not of_time else np.zeros(len(self._single))
        of_rates = self.of_rates(time_told=bool(of_time), late=delays != 0.0)
        return (*of_time, *angles, *jumps, *of_rates, *self._of_delays(delays))

    def of_rates(self, *, time_told: bool = False, late: Array | None = None) -> tuple[str, ...]:
        """A sentence for each rate that is not the slope of what it belongs to; those of ``late`` joints (k,) aside."""
        return tuple(
            self._of_rates(time_told=time_told, late=np.zeros(len(self._single), bool) if late is None else late)
        )

    def hints(self, limits: Limits | None = None) -> tuple[str, ...]:
        """A sentence for each thing that is odd, and may yet be meant."""
        found = list(self._angle_units(limits).hints)
        step = float(np.median(self._steps)) if self._steps else 0.0
        if step >= _LONG_STEP and not self._time_stated and not tuple(self._of_time(limits)):
            found.append(f"the usual time step is {printed(step, 4)} s. Is time in ms? It is taken to be in seconds")
        return tuple(found)

    def _angle_units(self, limits: Limits | None) -> AngleUnits:
        k, at = self._single[self._turns], self.at[self._turns]
        none = np.full(len(k), np.inf)
        return AngleUnits(
            names=[self._names[j] for j in k.tolist()],
            least=self._least[self._turns],
            most=self._greatest[self._turns],
            endless=~self._bounded[self._turns],
            lower=-none if limits is None else limits.lower[k],
            upper=none if limits is None else limits.upper[k],
            factor=self._factor[at],
            stated=self._stated[at],
        )

    def _of_time(self, limits: Limits | None) -> Iterable[str]:
        if self._time_stated or (found := self.slow_steps(limits)) is None:
            return
        why, unit = found
        yield (
            f"{why}: time seems to be in {unit}. Say its unit in the column's name, time [{unit}] or time [s], or by --columns "
            f"'time=COLUMN [{unit}]'"
        )

    def slow_steps(self, limits: Limits | None) -> tuple[str, str] | None:
        """Why the steps of time are too long for how little the joints move in them, and the unit it may be in."""
        step = float(np.median(self._steps)) if self._steps else 0.0
        moving = self._greatest - self._least > _SOME_MOVE
        if self._rows < _FEWEST_STEPS or not moving.any():
            return None
        unit, factor = ("ms", 1e3) if step < 500 else ("us", 1e6) if step < 5e5 else ("ns", 1e9)
        velocity = np.full(len(self._single), np.inf) if limits is None else limits.velocity[self._single]
        if (factor * self._speed > np.where(np.isfinite(velocity), _BEYOND * velocity, _NO_ROBOT)).any():
            return None  # in that unit the motion would be too fast for the robot
        usual = f"the usual step of time is {printed(step, 4)} s"
        if step >= _LONG_STEP and self._move.max(initial=0.0) < _SHORT_MOVE:
            return f"{usual}, and within one no joint moves by more than {printed(self._move.max(), 2)} rad or m", unit
        if limits is not None and step >= _SLOW_STEP:
            shares = self._speed[moving] / limits.velocity[self._single[moving]]
            if np.isfinite(limits.velocity[self._single[moving]]).all() and shares.max() < _SLOW_SHARE:
                return (
                    f"{usual}, and no joint moves faster than {printed(100 * shares.max(), 2)} % of its limit of velocity",
                    unit,
                )
        return None

    def _of_delays(self, delays: Array) -> Iterable[str]:
        for way, found in (("late", delays > 0.0), ("early", delays < 0.0)):
            if found.any():
                names = listed([self._names[self._single[k]] for k in np.flatnonzero(found).tolist()])
                late = np.abs(delays[found])
                size = seconds(late.min()) + (f" to {seconds(late.max())}" if np.ptp(late) > 5e-4 else "")
                yield (
                    f"{names}: the velocity column is {size} s {way} against the positions: shift it, or leave it out, then it "
                    "is derived"
                )

    def _of_jumps(self, limits: Limits | None) -> Iterable[str]:
        whole = self._within_a_turn()
        for k in range(len(self._single)):
            jump = self._jumps.get(k) or (None if whole[k] else self._wrapped.get(k))
            if jump is None:
                continue
            joint = int(self._single[k])
            known = float(limits.velocity[joint]) if limits is not None else math.inf
            if jump[0] > _TOO_FAST * (known if math.isfinite(known) else float(self._speed[k])):
                yield (
                    f"{self._names[joint]} jumps by {printed(jump[2], 4)} rad after t = {seconds(jump[1], 4)} s, at "
                    f"{printed(jump[0], 3)} rad/s, and is no joint that turns on for ever: remove the rows, or add the "
                    "turns that the log left out"
                )

    def stamps(self) -> dict[float, float]:
        """Times of rows whose stamp alone is wrong, and what it is late by [s]."""
        return self._glitches.stamps()

    def _of_glitches(self) -> list[str]:
        said = self._glitches.sentences([self._names[k] for k in self._single.tolist()], self._turns)
        return [f"{sentence}: remove the row" for sentence in said]

    def _of_rates(self, *, time_told: bool, late: Array) -> Iterable[str]:
        """``late`` (k,) bool are joints whose velocity is the slope of another time, so that its size says nothing."""
        every = np.arange(len(self._names))
        cases = (
            (self._velocity, self._single, "velocity", "positions", "/s"),
            (self._acceleration, every, "acceleration", "velocities", "/s^2"),
            (self._derived, self._single, "acceleration", "positions' velocities", "/s^2"),
        )
        for tally, joints, rate, base, per in cases:
            angular = self._angular[joints]
            gains = tally.result(angular)
            if tally is self._velocity:
                gains = np.where(late, 1.0, gains)
            said: dict[str, list[str]] = {}
            least, most = _ALLOWED[rate]
            for k in np.flatnonzero(~((gains > least) & (gains < most))).tolist():
                if time_told and math.isfinite(gains[k]) and any(near(gains[k], f) for f in (1e3, 1e6, 1e9)):
                    continue
                what = described_gain(float(gains[k]), bool(angular[k]), base, per)
                said.setdefault(what, []).append(self._names[joints[k]])
            for what, names in said.items():
                yield f"{listed(names)}: the {rate} column {what}"


def slow_steps(coordinates: Coordinates, time: Array, q: Array, limits: Limits) -> tuple[str, str] | None:
    """:meth:`Contradictions.slow_steps` of times (n,) and positions (n, nq)."""
    found = Contradictions(coordinates)
    found.look_at_steps(time, q[:, found.at])
    return found.slow_steps(limits)
