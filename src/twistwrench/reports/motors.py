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

The deviations are estimated from few draws; one load of a thousand is farther from its estimate than this.
"""


@dataclass(frozen=True)
class Demand:
    """Demand on a motor and its limit."""

    what: str
    """Name of the load, such as "rms current"."""
    value: float
    """Largest load, or a mean of the load over the motion, in ``unit``."""
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
        lower_bound = replace(self, value=self.value - SURE_LOAD * self.sigma)
        return bool(over_limit(lower_bound.share))

    @property
    def open(self) -> bool:
        """True if noise decides whether the limit is exceeded."""
        upper_bound = replace(self, value=self.value + SURE_LOAD * self.sigma)
        return not self.over and bool(over_limit(upper_bound.share))

    @property
    def share(self) -> float:
        """Value over limit, both relative to :attr:`base`; 0 for an infinite limit, inf if the limit is not above the base."""
        allowed_rise = self.limit - self.base
        return (self.value - self.base) / allowed_rise if allowed_rise > 0 else math.inf

    @property
    def words(self) -> str:
        """Text of the demand with its limit."""
        value_text = quantity(self.value, self.unit)
        if self.sigma:
            value_text = f"{number(self.value)} ± {deviation(self.sigma)} {self.unit}"
        text = f"{self.what} {value_text} of {number(self.limit)} ({percent_of_limit(self.share)})"
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
    """One demand for each rating that bounds a load."""
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
    """Loads of the motors with a data sheet in some rows of a motion, one entry for each motor."""

    peaks: dict[str, Extrema]
    """Largest magnitudes, by load: current, voltage, speed and power."""
    squares: Array
    """Time mean of the squared current [A²], as a sum over these rows alone; sums of all parts of a motion add up."""
    points: Array
    """(points, motors, 3) times, speeds and torques of evenly spaced states."""

    @classmethod
    def from_rows(cls, model: Model, rows: slice, time: Array, loads: MotorLoads) -> MotorFigures:
        """Figures of consecutive rows of a motion, from all its times (n,) and from the motors' loads in these rows."""
        with_motor = [k for k, actuator in enumerate(model.actuators.values()) if actuator.motor is not None]
        time_of_rows = time[rows]
        peaks = {}
        for name in ("current", "voltage", "speed", "power"):
            load = getattr(loads, name)[:, with_motor]
            peaks[name] = Extrema.from_rows(time_of_rows, np.abs(load), load)
        squares = mean_weights(time, rows) @ loads.current[:, with_motor] ** 2
        stride = stride_of(len(time), _MAX_POINTS)
        first_point = (
            -rows.start % stride
        )  # points are at multiples of the stride, counted from the begin of the motion
        points = slice(first_point, None, stride)
        speed = loads.speed[points, with_motor]
        torque = loads.torque[points, with_motor]
        point_times = np.broadcast_to(time_of_rows[points, None], speed.shape)
        return cls(peaks, squares, np.stack([point_times, speed, torque], axis=-1))

    @classmethod
    def from_parts(cls, parts: Sequence[MotorFigures]) -> MotorFigures:
        """Figures of a motion from the figures of its consecutive parts."""
        peaks = dict(parts[0].peaks)
        for name in peaks:
            peaks[name] = Extrema.merge([part.peaks[name] for part in parts])
        squares = np.sum([part.squares for part in parts], axis=0)
        return cls(peaks, squares, np.concatenate([part.points for part in parts]))

    def uses(self, model: Model) -> tuple[MotorUse, ...]:
        """Use of each motor in the order of the file."""
        uses = []
        rms_currents = np.sqrt(self.squares)
        with_motor = [actuator for actuator in model.actuators.values() if actuator.motor is not None]
        for k, actuator in enumerate(with_motor):
            motor = actuator.motor
            assert motor is not None
            rms_current = float(rms_currents[k])
            # two names of the peak current, since different ratings bound them
            loads = {  # value and time of each load
                "peak current": self._peak("current", k),
                "rms current": (rms_current, math.nan),
                "current": self._peak("current", k),
                "voltage": self._peak("voltage", k),
                "speed": self._peak("speed", k),
                "power": self._peak("power", k),
            }
            demands = _demands(motor, loads)
            peak_power, _ = loads["power"]
            heat = motor.resistance * rms_current**2
            time, speed, torque = self.points[:, k].T
            uses.append(MotorUse(actuator.joint, motor, demands, peak_power, heat, time, speed, torque))
        return tuple(uses)

    def _peak(self, name: str, k: int) -> tuple[float, float]:
        """Peak of a load of motor k, and the time of the peak [s]."""
        peak = self.peaks[name]
        return float(peak.value[k]), float(peak.time[k])


def _demands(motor: Motor, loads: Mapping[str, tuple[float, float]]) -> tuple[Demand, ...]:
    """Demands of the loads that a rating bounds; ``loads`` has the value and the time of each load, by name."""
    from ..formats.yaml import si_unit

    rating_names = {rating.load: name for name, rating in RATINGS.items() if rating.load}  # by load
    demands = []
    for load, (value, time) in loads.items():
        if load in rating_names:
            rating_name = rating_names[load]
            limit = getattr(motor, rating_name)
            unit = si_unit(RATINGS[rating_name].kind)
            demands.append(Demand(load, value, limit, unit, time))
    return tuple(demands)


# ── Progress of work in several steps, as a share from 0 to 1


class Steps:
    """Consecutive steps with given weights; ``progress`` receives the finished share of the whole work."""

    def __init__(self, progress: Callable[[float], None] | None, weights: Sequence[float]) -> None:
        self._progress = progress
        # share of the work that is finished when each remaining step begins, and when the last one ends
        self._bounds = [sum(weights[:k]) / sum(weights) for k in range(len(weights) + 1)]

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
        finished_size = 0.0

        def report_share(share: float) -> None:
            progress(begin + (end - begin) * min(share, 1.0))

        def report_portion(portion: float) -> None:
            nonlocal finished_size
            finished_size += portion
            share = finished_size / size if size else 1.0  # a step of size 0 is finished
            report_share(share)

        return report_share if size is None else report_portion

    def skip(self, count: int) -> None:
        """Skip the next ``count`` steps."""
        del self._bounds[:count]

    def done(self) -> None:
        """Report completion."""
        if self._progress is not None:
            self._progress(1.0)
