"""Motor demands of a motion against data sheets: current, voltage, speed and heat; and the progress of several steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.numbers import deviation, number, over_limit, percent_of_limit, quantity, seconds
from ..core.typing import Array
from ..mechanics.model.actuators import RATINGS
from ..motion.bounds import Extrema
from .statistics import mean_weights, stride_of

if TYPE_CHECKING:
    from ..mechanics.algorithms.motor_loads import MotorLoads
    from ..mechanics.model.actuators import Motor
    from ..mechanics.model.model import Model

_MAX_POINTS = 4096
"""Largest number of points of a motor's speeds and torques."""
SURE_LOAD = 3.0
"""Standard deviations of a load within which noise decides.

The deviations are estimated from few draws; one load of a thousand is farther off.
"""


@dataclass(frozen=True)
class Demand:
    """Demand on a motor and its limit."""

    what: str
    """Name of the load, such as "rms current"."""
    value: float
    """Largest or mean load, in ``unit``."""
    limit: float
    """Limit of the load, in ``unit``."""
    unit: str
    """SI unit of the load."""
    time: float = math.nan
    """Time of the load [s]; nan for a mean over the motion."""
    base: float = 0.0
    """Value without load, such as the ambient temperature."""
    sigma: float = 0.0
    """Standard deviation of the value due to noise of a log."""

    @property
    def over(self) -> bool:
        """True if the value exceeds its limit by more than round-off, and by more than noise explains."""
        surely = replace(self, value=self.value - SURE_LOAD * self.sigma)
        return bool(over_limit(surely.share))

    @property
    def open(self) -> bool:
        """True if noise decides whether the limit is exceeded."""
        perhaps = replace(self, value=self.value + SURE_LOAD * self.sigma)
        return not self.over and bool(over_limit(perhaps.share))

    @property
    def share(self) -> float:
        """Value over limit, both relative to :attr:`base`; 0 for an infinite limit, inf if the limit is not above the base."""
        room = self.limit - self.base
        return (self.value - self.base) / room if room > 0 else math.inf

    @property
    def words(self) -> str:
        """Text of the demand with its limit."""
        value = quantity(self.value, self.unit)
        if self.sigma:
            value = f"{number(self.value)} ± {deviation(self.sigma)} {self.unit}"
        text = f"{self.what} {value} of {number(self.limit)} ({percent_of_limit(self.share)})"
        if not math.isnan(self.time):
            text += f" at t = {seconds(self.time)} s"
        return text


@dataclass(frozen=True, eq=False)
class MotorUse:
    """Demands on one motor over a motion."""

    joint: str
    """Name of the driven joint."""
    motor: Motor
    """Data sheet of the motor."""
    demands: tuple[Demand, ...]
    """One for each rating that bounds a load."""
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
        return max(self.demands, key=lambda demand: demand.share)

    @property
    def too_small(self) -> bool:
        """True if a limit is exceeded by more than round-off."""
        return bool(over_limit(self.tightest.share))

    @property
    def words(self) -> str:
        """Text of the demand nearest to its limit or farthest beyond it."""
        return f"{self.joint}, {self.tightest.words}"


class MotorFigures(NamedTuple):
    """Figures of the motors with a data sheet, in some rows of a motion; (motors,) each."""

    peaks: dict[str, Extrema]
    """Largest magnitudes of current, voltage, speed and power."""
    squares: Array
    """Share of these rows in the time mean of the squared current [A²]."""
    points: Array
    """(points, motors, 3) times, speeds and torques of evenly spaced states."""

    @classmethod
    def from_rows(cls, model: Model, rows: slice, time: Array, loads: MotorLoads) -> MotorFigures:
        """Figures of consecutive rows of a motion of all times ``time`` (n,), from the motors' loads in these rows."""
        described = [k for k, actuator in enumerate(model.actuators.values()) if actuator.motor is not None]
        time_of_rows = time[rows]
        peaks = {}
        for name in ("current", "voltage", "speed", "power"):
            load = getattr(loads, name)[:, described]
            peaks[name] = Extrema.from_rows(time_of_rows, np.abs(load), load)
        squares = mean_weights(time, rows) @ loads.current[:, described] ** 2
        stride = stride_of(len(time), _MAX_POINTS)
        first_point = -rows.start % stride  # points are at multiples of the stride in the motion
        points = slice(first_point, None, stride)
        speed = loads.speed[points, described]
        torque = loads.torque[points, described]
        point_times = np.broadcast_to(time_of_rows[points, None], speed.shape)
        return cls(peaks, squares, np.stack([point_times, speed, torque], axis=-1))

    @classmethod
    def from_parts(cls, parts: Sequence[MotorFigures]) -> MotorFigures:
        """Figures of a motion from those of its consecutive parts."""
        peaks = dict(parts[0].peaks)
        for name in peaks:
            peaks[name] = Extrema.merge([part.peaks[name] for part in parts])
        squares = np.sum([part.squares for part in parts], axis=0)
        return cls(peaks, squares, np.concatenate([part.points for part in parts]))

    def uses(self, model: Model) -> tuple[MotorUse, ...]:
        """Use of each motor in the order of the file."""
        uses = []
        rms_current = np.sqrt(self.squares)
        described = [actuator for actuator in model.actuators.values() if actuator.motor is not None]
        for k, actuator in enumerate(described):
            motor = actuator.motor
            assert motor is not None
            rms = float(rms_current[k])
            loads = {
                "peak current": self._peak("current", k),
                "rms current": (rms, math.nan),
                "current": self._peak("current", k),
                "voltage": self._peak("voltage", k),
                "speed": self._peak("speed", k),
                "power": self._peak("power", k),
            }
            heat = motor.resistance * rms**2
            power, _ = loads["power"]
            time, speed, torque = self.points[:, k].T
            demands = _demands(motor, loads)
            uses.append(MotorUse(actuator.joint, motor, demands, power, heat, time, speed, torque))
        return tuple(uses)

    def _peak(self, name: str, k: int) -> tuple[float, float]:
        """Peak of a load of one motor, and its time."""
        return float(self.peaks[name].value[k]), float(self.peaks[name].time[k])


def _demands(motor: Motor, loads: Mapping[str, tuple[float, float]]) -> tuple[Demand, ...]:
    """Demands of the loads for which a motor has a rating, from the value and the time of each load."""
    from ..formats.yaml import si_unit

    rating_by_load = {rating.load: name for name, rating in RATINGS.items() if rating.load}
    demands = []
    for load, (value, time) in loads.items():
        if load in rating_by_load:
            name = rating_by_load[load]
            limit = getattr(motor, name)
            unit = si_unit(RATINGS[name].kind)
            demands.append(Demand(load, value, limit, unit, time))
    return tuple(demands)


# ── Progress of work in several steps, as a share from 0 to 1


class Steps:
    """Consecutive steps with given weights; ``progress`` receives the finished share of the whole work."""

    def __init__(self, progress: Callable[[float], None] | None, weights: Sequence[float]) -> None:
        self._progress = progress
        self._bounds = [sum(weights[:k]) / sum(weights) for k in range(len(weights) + 1)]  # of the steps to come

    def next(self, size: int | None = None) -> Callable[[float], None] | None:
        """Begin the next step; returns a callback, or None without ``progress``.

        The callback takes the finished share of the step or, if the ``size`` of the step is given, the size of each
        finished portion.
        """
        begin = self._bounds.pop(0)
        end = self._bounds[0]
        progress = self._progress
        if progress is None:
            return None
        done = 0.0

        def report_share(share: float) -> None:
            progress(begin + (end - begin) * min(share, 1.0))

        def report_portion(portion: float) -> None:
            nonlocal done
            done += portion
            report_share(done / size if size else 1.0)

        return report_share if size is None else report_portion

    def skip(self, count: int) -> None:
        """Skip the next ``count`` steps."""
        del self._bounds[:count]

    def done(self) -> None:
        """Report completion."""
        if self._progress is not None:
            self._progress(1.0)
