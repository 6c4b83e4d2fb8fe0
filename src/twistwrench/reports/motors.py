"""Motor demands of a motion against data sheets: current, voltage, speed and heat; and the progress of several steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.numbers import deviation, number, percent_of_limit, quantity, seconds
from ..core.typing import Array
from ..mechanics.model.limits import over_limit
from ..motion.bounds import RunningExtrema
from .statistics import Rms

if TYPE_CHECKING:
    from ..mechanics.algorithms.inverse_dynamics import MotorLoads
    from ..mechanics.model.actuators import Actuator, Motor
    from ..mechanics.model.model import Model

_MOST_POINTS = 4096
SURE_LOAD = 3.0
"""Standard deviations of a load within which noise decides; estimated from few draws, one of a thousand is farther off."""


@dataclass(frozen=True)
class Demand:
    """Demand on a motor and its limit."""

    what: str
    value: float
    limit: float
    unit: str
    time: float = math.nan
    """When [s]; nan for a mean over the motion."""
    base: float = 0.0
    """Value without load, such as the ambient temperature."""
    sigma: float = 0.0
    """Standard deviation of the value due to noise of a log."""

    @property
    def over(self) -> bool:
        """True if the value exceeds its limit by more than round-off, and by more than noise explains."""
        return bool(over_limit(replace(self, value=self.value - SURE_LOAD * self.sigma).share))

    @property
    def open(self) -> bool:
        """True if noise decides whether the limit is exceeded."""
        return not self.over and bool(over_limit(replace(self, value=self.value + SURE_LOAD * self.sigma).share))

    @property
    def share(self) -> float:
        """Value over limit, both relative to :attr:`base`; 0 without a limit, inf if the limit is not above the base."""
        room = self.limit - self.base
        return (self.value - self.base) / room if room > 0 else math.inf

    @property
    def words(self) -> str:
        """Text of the demand with its limit."""
        when = "" if math.isnan(self.time) else f" at t = {seconds(self.time)} s"
        sigma = f" ± {deviation(self.sigma)}" if self.sigma else ""
        value = f"{number(self.value)}{sigma} {self.unit}" if sigma else quantity(self.value, self.unit)
        return f"{self.what} {value} of {number(self.limit)} ({percent_of_limit(self.share)}){when}"


@dataclass(frozen=True, eq=False)
class MotorUse:
    """Demands on one motor over a motion."""

    joint: str
    motor: Motor
    demands: tuple[Demand, ...]
    """Peak current, rms current, voltage, speed."""
    power: float
    """Peak electrical power [W]."""
    heat: float
    """Mean winding loss [W]."""
    time: Array
    """Times (n,) of evenly spaced states [s]."""
    speed: Array
    """Motor speeds (n,) in these states [rad/s]."""
    torque: Array
    """Torques (n,) at the rotor in these states [N m]."""

    @property
    def tightest(self) -> Demand:
        """The demand nearest to its limit."""
        return max(self.demands, key=lambda d: d.share)

    @property
    def too_small(self) -> bool:
        """True if a limit is exceeded by more than round-off."""
        return bool(over_limit(self.tightest.share))

    @property
    def words(self) -> str:
        """Text of the demand nearest to its limit or farthest beyond it."""
        return f"{self.joint}, {self.tightest.words}"


class MotorTally:
    """Running figures of every described motor, accumulated over chunks of rows."""

    def __init__(self, model: Model) -> None:
        described = [(k, a) for k, a in enumerate(model.actuators.values()) if a.motor is not None]
        self._columns = np.array([k for k, _ in described], int)
        self._actuators: list[Actuator] = [a for _, a in described]
        n = len(described)
        self._peaks = {name: RunningExtrema(n) for name in ("current", "voltage", "speed", "power")}
        self._current = Rms(n)
        self._points: list[Array] = []
        self._stride, self._phase = 1, 0

    def add(self, time: Array, loads: MotorLoads) -> None:
        """Add consecutive rows."""
        if not self._actuators:
            return
        picked = {name: getattr(loads, name)[:, self._columns] for name in ("torque", *self._peaks)}
        for name, peak in self._peaks.items():
            peak.add(time, np.abs(picked[name]))
        self._current.add(time, picked["current"])
        speed, torque = picked["speed"], picked["torque"]
        self._keep(np.stack([np.broadcast_to(time[:, None], speed.shape), speed, torque], axis=-1))

    def _keep(self, points: Array) -> None:
        """Keep every n-th of the states (rows, motors, 3); n doubles if they become too many."""
        self._points.append(points[self._phase :: self._stride])
        self._phase = (self._phase - len(points)) % self._stride
        while sum(map(len, self._points)) > _MOST_POINTS:
            kept = np.concatenate(self._points)
            if len(kept) % 2:  # the next state to keep is then an odd number of old strides away
                self._phase += self._stride
            self._points, self._stride = [kept[::2]], 2 * self._stride
            self._phase %= self._stride

    def result(self) -> tuple[MotorUse, ...]:
        """Use of each motor in the order of the file."""
        if not self._points:
            return ()
        rms, points = self._current.result(), np.concatenate(self._points)
        uses = []
        for k, actuator in enumerate(self._actuators):
            motor = actuator.motor
            assert motor is not None
            peak = {name: (float(e.value[k]), float(e.time[k])) for name, e in self._peaks.items()}
            demands = (
                Demand("peak current", peak["current"][0], motor.current_peak, "A", peak["current"][1]),
                Demand("rms current", float(rms[k]), motor.current_continuous, "A", math.nan),
                Demand("voltage", peak["voltage"][0], motor.voltage, "V", peak["voltage"][1]),
                Demand("speed", peak["speed"][0], motor.speed, "rad/s", peak["speed"][1]),
            )
            heat = motor.resistance * float(rms[k]) ** 2
            uses.append(MotorUse(actuator.joint, motor, demands, peak["power"][0], heat, *points[:, k].T))
        return tuple(uses)


# ── Progress of work in several steps, as a share from 0 to 1


class Steps:
    """Consecutive steps with given weights; ``progress`` receives the finished share of the whole work."""

    def __init__(self, progress: Callable[[float], None] | None, weights: Sequence[float]) -> None:
        self._progress = progress
        self._bounds = [sum(weights[:k]) / sum(weights) for k in range(len(weights) + 1)]

    def next(self, size: int | None = None) -> Callable[[float], None] | None:
        """Begin the next step; returns a callback for its finished share, or, given ``size``, for each finished chunk."""
        begin, end, progress = self._bounds.pop(0), self._bounds[0], self._progress
        if progress is None:
            return None
        done = 0.0

        def report(share: float) -> None:
            progress(begin + (end - begin) * min(share, 1.0))

        def add(portion: float) -> None:
            nonlocal done
            done += portion
            report(done / size if size else 1.0)

        return report if size is None else add

    def skip(self, count: int) -> None:
        """Skip steps."""
        del self._bounds[:count]

    def done(self) -> None:
        """Report completion."""
        if self._progress is not None:
            self._progress(1.0)
