"""Result of a sensor identification: confidence intervals and regions of its unknowns, and notes on large ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt, doubt, verdict_from_doubts
from ..core.errors import ShapeError, ValueRangeError
from ..core.estimation.covariance import student_quantile
from ..core.glossary import complete
from ..core.numbers import number, percent, plus_minus
from ..core.typing import Array
from ..core.verdict import Verdict
from ..mechanics.lie import so3
from .files import write_compensated, write_sensor
from .fit import Fit
from .log import ReadingLog
from .sensor import ForceTorqueSensor, sign_factor
from .uncertainty import Uncertainty, uncertainty_of

_LARGE_SHARE_OF_TRACE = 0.5
"""Half of an interval of a moment of inertia, as a share of the inertia's trace, from which it is noted."""
_LARGE_SHARE_OF_MASS = 0.1
"""Half of the interval of the mass, as a share of the mass, from which it is noted."""
_LARGE_OFFSET = 0.01
"""Half of an interval of the centre of mass [m] from which it is noted."""


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Answer):
    """Identified sensor: bias and load found from a log, with their uncertainty: result of :func:`identify`.

    Confidence regions are exact for normal noise.

    Examples
    --------
    >>> import tempfile
    >>> from twistwrench import SpatialInertia, sensing
    >>> log = sensing.simulate(sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1))), 12)
    >>> found = sensing.identify(log)
    >>> lower, upper = found.interval(found.fit.unknowns.names[0])
    >>> lower < upper, found.rest(log).shape
    (True, (12, 6))
    >>> found.com_region_contains([0, 0, 0.1]), found.region_contains(3.0, [0, 0, 0.1])
    (True, True)
    >>> found = sensing.identify("demo")
    >>> found.facts()["mass"], found.sources()["LOG"].name, str(next(found.blocks()).word)
    ('2.986 ± 0.022 kg (95 %)', 'demo_poses.csv', 'OK')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.write(f"{folder}/hand.json").name, found.to_csv(f"{folder}/rest.csv").name
    ('hand.json', 'rest.csv')
    """

    call: ClassVar[str] = "sensor identify"

    sensor: ForceTorqueSensor
    """Sensor with the identified bias, load and mounting."""
    fit: Fit
    """Least-squares fit, with unknowns, covariance and residuals."""
    rows: Array
    """Mask (n,) of used rows: dwells, and readings in motion."""
    kept: Array
    """Mask (N,) of used readings; the others are outliers, or lie between dwells."""
    confidence: float
    """Confidence level of intervals and regions, 0 to 1."""
    log: ReadingLog
    """Readings."""
    doubts: tuple[Doubt, ...] = ()
    """Doubts and notes about units, sign, mounting, poses, readings and intervals."""
    left_out: Array | None = None
    """Mask (N,) of outliers."""

    def __repr__(self) -> str:
        com_in_mm = 1e3 * np.asarray(self.sensor.load.com)
        half_widths_in_mm = 1e3 * self._com_half_widths()
        com = ", ".join(plus_minus(x, half) for x, half in zip(com_in_mm, half_widths_in_mm, strict=True))
        of_moments, of_forces = self.noise
        word = f"; {self.verdict.word}, see doubts" if self.doubtful else ""
        return (
            f"<Identification: {self.mass_text}, com ({com}) mm, noise {number(of_forces, 2)} N and "
            f"{number(of_moments, 2)} N m{word}>"
        )

    @property
    def subject(self) -> str:
        """File of the log."""
        return Path(self.log.name).name

    @property
    def brief(self) -> str:
        """Mass with half of its confidence interval."""
        return self.mass_text

    @property
    def verdict(self) -> Verdict:
        """OK; UNSURE if the intervals may be too narrow; LOOK AGAIN if no number can be trusted."""
        return verdict_from_doubts(self.doubts)

    @property
    def mass_text(self) -> str:
        """Mass with half of its confidence interval, as text."""
        low, high = self.mass_interval
        mass = plus_minus(self.fit.load[0], (high - low) / 2, "kg")
        return f"{mass} ({percent(self.confidence, 3)})"

    @property
    def outliers(self) -> list[int]:
        """Indices of the rejected readings."""
        return [] if self.left_out is None else np.flatnonzero(self.left_out).tolist()

    @property
    def doubtful(self) -> bool:
        """True if the verdict is not OK."""
        return not self.verdict.ok

    def rest(self, log: ReadingLog) -> Array:
        """Residuals of the readings of its own log, with drift, tilt and delay.

        Parameters
        ----------
        log : ReadingLog, the log of the identification

        Returns
        -------
        residuals : (n, 6) array, (m, f) [N m, N]
        """
        unknowns = self.fit.unknowns
        design = unknowns.design(log, sign_factor(self.sensor.sign), self.fit.state)
        residuals = log.readings - design @ self.fit.estimate
        if not unknowns.bias:  # a known bias is not part of the estimate
            residuals = residuals - np.asarray(self.sensor.bias)
        return np.asarray(residuals)

    # ── The answer on every surface

    def blocks(self) -> Iterator[Block]:
        """Verdict, load and bias with their intervals, readings before and after, and remarks.

        Returns
        -------
        blocks : iterator of Block
        """
        from .views import identification_view

        return identification_view(self)

    def facts(self) -> Mapping[str, str]:
        """Mass and noise.

        Returns
        -------
        facts : {name: text}
        """
        of_moments, of_forces = self.noise
        noise = f"{number(of_forces, 2)} N, {number(of_moments, 2)} N m"
        return {"mass": self.mass_text, "noise of a reading": noise}

    def sources(self) -> Mapping[str, str | Path]:
        """File of the log, if it was read from one.

        Returns
        -------
        files : {argument: path}
        """
        path = Path(self.log.name)
        return {"LOG": path} if path.is_file() else {}

    def write(self, path: str | Path) -> Path:
        """Write the sensor file, which :func:`compensate` reads.

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        write_sensor(self.sensor, path, self.noise, self.uncertainty)
        return Path(path)

    def to_csv(self, path: str | Path) -> Path:
        """Write the readings without bias and load as a table, with times if the log has them.

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        return write_compensated(self.log, self.rest(self.log), path)

    @property
    def uncertainty(self) -> Uncertainty:
        """Uncertainty of the sensor, as stored in its file."""
        return uncertainty_of(self.fit)

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of one reading's moments [N m] and forces [N], root mean square of three channels each."""
        return self.fit.noise

    def interval(self, name: str) -> tuple[float, float]:
        """Confidence interval of one unknown.

        Parameters
        ----------
        name : str, one of ``fit.unknowns.names``; intervals of ``turn`` and ``tilt`` are centred on zero

        Returns
        -------
        interval : (float, float), in the unknown's SI unit
        """
        names = self.fit.unknowns.names
        if name not in names:
            raise ValueRangeError(f"{name!r} was not identified. Choose one of: {', '.join(names)}.")
        return self.fit.interval(name, self.confidence)

    @property
    def mass_interval(self) -> tuple[float, float]:
        """Confidence interval of the mass [kg]."""
        return self.fit.interval("mass", self.confidence)

    @property
    def com_intervals(self) -> Array:
        """Confidence intervals (3, 2) of the centre of mass [m]; infinite if the mass may be zero.

        Fieller's theorem is exact also for light loads, for which the error of the quotient h / m is skewed: the interval
        holds all coordinates y with (h - m y)² ≤ t² var(h - m y), which is a y² - 2 b y + c ≤ 0.
        Source: Fieller, "Some problems in interval estimation", J. R. Stat. Soc. B 16, 1954.
        """
        estimate, C, _ = self._load
        m = estimate[0]
        intervals = np.tile([-math.inf, math.inf], (3, 1))
        for axis in range(3):
            h = estimate[1 + axis]
            t2 = float(student_quantile(self.fit.com_known[axis], self.confidence)) ** 2
            a = m * m - t2 * C[0, 0]
            if a <= 0:  # the mass may be zero
                continue
            b = m * h - t2 * C[0, 1 + axis]
            c = h**2 - t2 * C[1 + axis, 1 + axis]
            root = math.sqrt(max(b * b - a * c, 0.0))
            intervals[axis] = (b - root) / a, (b + root) / a
        return intervals

    def _com_half_widths(self) -> Array:
        """Half widths (3,) of the confidence intervals of the centre of mass [m]."""
        low, high = self.com_intervals.T
        return (high - low) / 2

    def com_region_contains(self, com: ArrayLike) -> bool:
        """Test if a point is in the joint confidence region of the centre of mass (Fieller's, in three dimensions).

        Returns
        -------
        answer : bool
        """
        estimate, _, C = self._load
        c = np.asarray(com, float)
        if c.shape != (3,):
            raise ShapeError(f"com has shape {c.shape}, expected (3,).")
        H = np.hstack([-c[:, None], np.eye(3)])  # H (m, h) = h - m c
        r = H @ estimate
        return bool(r @ np.linalg.solve(H @ C @ H.T, r) <= self._squared_distance_limit(3))

    def region_contains(self, mass: float, com: ArrayLike) -> bool:
        """Test if a mass and centre of mass are in their joint confidence region, an ellipsoid of (m, m c).

        Parameters
        ----------
        mass : float [kg]

        Returns
        -------
        answer : bool
        """
        estimate, _, C = self._load
        first_moment = mass * np.asarray(com, float)
        r = np.array([mass, *first_moment]) - estimate
        return bool(r @ np.linalg.solve(C, r) <= self._squared_distance_limit(4))

    @property
    def com_deviation(self) -> Array:
        """Standard deviations (3,) of the centre of mass [m], to first order."""
        return self.fit.com_deviation

    @property
    def turn(self) -> Array:
        """Rotation vector (3,) [rad] of the mounting R_fs; zero if it was not an unknown."""
        return so3.log(self.fit.mounting)

    @property
    def _load(self) -> tuple[Array, Array, Array]:
        """Mass m and first moment h (4,), their covariance, and their covariance for joint regions."""
        start = self.fit.unknowns.load.start
        part = slice(start, start + 4)
        return self.fit.estimate[part], self.fit.covariance[part, part], self.fit.joint[part, part]

    def _squared_distance_limit(self, count: int) -> float:
        """Largest squared Mahalanobis distance in a joint region of ``count`` unknowns, by the F distribution."""
        from scipy import special

        freedom = min(self.fit.joint_freedom, 1e9)  # fdtri of inf is NaN
        return float(count * special.fdtri(count, freedom, self.confidence))


def weakness(found: Identification) -> list[Doubt]:
    """Notes on poorly determined mass, centre of mass or inertia; empty if all are well determined."""
    load = found.sensor.load
    unknowns = found.fit.unknowns
    confidence = percent(found.confidence, 3)
    if unknowns.inertia:
        trace = float(load.moment_about_com.trace())
        moments = [name for name in unknowns.names if name.startswith("I")]
        half, name = max((_half_width(found.interval(name)), name) for name in moments)
        if half > _LARGE_SHARE_OF_TRACE * abs(trace):
            figures: dict[str, Any] = {"half": number(half, 2), "trace": number(trace, 2)}
            return [doubt("sensor-weak-inertia", name=name, confidence=confidence, **figures)]
    mass_half = _half_width(found.mass_interval)
    com_halves = found._com_half_widths()
    widest = int(com_halves.argmax())
    if mass_half < _LARGE_SHARE_OF_MASS * load.mass and com_halves[widest] < _LARGE_OFFSET:
        return []
    mass = number(mass_half, 2)
    out = number(1e3 * com_halves[widest], 2)
    return [doubt("sensor-weak-load", axis="xyz"[widest], confidence=confidence, mass=mass, out=out)]


def _half_width(interval: tuple[float, float]) -> float:
    return float(np.ptp(interval)) / 2


complete(globals())
