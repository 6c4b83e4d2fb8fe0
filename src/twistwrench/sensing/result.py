"""Result of a sensor identification: confidence intervals and regions of its unknowns, and notes on wide intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

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
"""Half width of a moment's interval, as a share of the trace of the inertia, from which a note is made."""
_LARGE_SHARE_OF_MASS = 0.1
"""Half width of the mass's interval, as a share of the mass, from which a note is made."""
_LARGE_OFFSET = 0.01
"""Half width of an interval of the centre of mass [m] from which a note is made."""


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
    """Mask (n,) of the used rows of the fit; a row is a dwell, or a reading in motion."""
    kept: Array
    """Mask (N,) of the used readings of the log; unused ones are outliers or lie between dwells."""
    confidence: float
    """Confidence level of intervals and regions, 0 to 1."""
    log: ReadingLog
    """Log of N readings."""
    doubts: tuple[Doubt, ...] = ()
    """Doubts and notes about units, sign, mounting, poses, readings and intervals."""
    left_out: Array | None = None
    """Mask (N,) of outliers."""

    def __repr__(self) -> str:
        com_in_mm = 1e3 * np.asarray(self.sensor.load.com)
        half_widths_in_mm = 1e3 * self._com_half_widths()
        com_text = ", ".join(map(plus_minus, com_in_mm, half_widths_in_mm))
        moment_noise, force_noise = self.noise
        verdict_text = f"; {self.verdict.word}, see doubts" if self.doubtful else ""
        return (
            f"<Identification: {self.mass_text}, com ({com_text}) mm, noise {number(force_noise, 2)} N and "
            f"{number(moment_noise, 2)} N m{verdict_text}>"
        )

    @property
    def subject(self) -> str:
        """File name of the log, without folders."""
        return Path(self.log.name).name

    @property
    def brief(self) -> str:
        """Mass with the half width of its confidence interval."""
        return self.mass_text

    @property
    def verdict(self) -> Verdict:
        """UNSURE if intervals may be too narrow, LOOK AGAIN if no number can be trusted, otherwise OK."""
        return verdict_from_doubts(self.doubts)

    @property
    def mass_text(self) -> str:
        """Mass with the half width of its confidence interval, as text."""
        mass = self.fit.load[0]
        low, high = self.mass_interval
        mass_with_half_width = plus_minus(mass, (high - low) / 2, "kg")
        return f"{mass_with_half_width} ({percent(self.confidence, 3)})"

    @property
    def outliers(self) -> list[int]:
        """Indices of the rejected readings."""
        if self.left_out is None:
            return []
        indices = np.flatnonzero(self.left_out)
        return indices.tolist()

    @property
    def doubtful(self) -> bool:
        """True if the verdict is not OK."""
        return not self.verdict.ok

    def rest(self, log: ReadingLog) -> Array:
        """Residuals of all readings of the identification's own log: readings minus those of the fit.

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
        moment_noise, force_noise = self.noise
        noise_text = f"{number(force_noise, 2)} N, {number(moment_noise, 2)} N m"
        return {"mass": self.mass_text, "noise of a reading": noise_text}

    def sources(self) -> Mapping[str, str | Path]:
        """File of the log; empty if the log was not read from a file.

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
        """Standard deviations of a reading's moments [N m] and of its forces [N]; each is a root mean square of 3 channels."""
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
        m = estimate[0]  # mass; its row and column in C are the first
        intervals = np.tile([-math.inf, math.inf], (3, 1))  # (3, 2)
        for axis in range(3):
            h = estimate[1 + axis]  # first moment
            freedom = self.fit.com_known[axis]  # degrees of freedom
            t2 = float(student_quantile(freedom, self.confidence)) ** 2  # t²
            a = m * m - t2 * C[0, 0]
            if a <= 0:  # the mass may be zero
                continue
            b = m * h - t2 * C[0, 1 + axis]
            c = h**2 - t2 * C[1 + axis, 1 + axis]
            root = math.sqrt(max(b * b - a * c, 0.0))  # not below zero by round-off
            intervals[axis] = (b - root) / a, (b + root) / a
        return intervals

    def _com_half_widths(self) -> Array:
        """Half widths (3,) of the confidence intervals of the centre of mass [m]."""
        low, high = self.com_intervals.T
        return (high - low) / 2

    def com_region_contains(self, com: ArrayLike) -> bool:
        """Test if a point is in the joint confidence region of the centre of mass: Fieller's theorem in three dimensions.

        Returns
        -------
        answer : bool
        """
        estimate, _, C = self._load
        c = np.asarray(com, float)
        if c.shape != (3,):
            raise ShapeError(f"com has shape {c.shape}, expected (3,).")
        H = np.hstack([-c[:, None], np.eye(3)])  # H (m, h) = h - m c
        r = H @ estimate  # zero if c is the centre of mass
        covariance_of_r = H @ C @ H.T
        squared_distance = r @ np.linalg.solve(covariance_of_r, r)
        return bool(squared_distance <= self._squared_distance_limit(3))

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
        difference = np.array([mass, *first_moment]) - estimate
        squared_distance = difference @ np.linalg.solve(C, difference)
        return bool(squared_distance <= self._squared_distance_limit(4))

    @property
    def com_deviation(self) -> Array:
        """Standard deviations (3,) of the centre of mass [m], to first order."""
        return self.fit.com_deviation

    @property
    def turn(self) -> Array:
        """Rotation vector (3,) [rad] of the mounting R_fs; zero if the mounting was not an unknown."""
        return so3.log(self.fit.mounting)

    @property
    def _load(self) -> tuple[Array, Array, Array]:
        """Estimate (4,) of mass m and first moment h; its covariances (4, 4) for single intervals and for joint regions."""
        start = self.fit.unknowns.load.start
        m_and_h = slice(start, start + 4)
        estimate = self.fit.estimate[m_and_h]
        return estimate, self.fit.covariance[m_and_h, m_and_h], self.fit.joint[m_and_h, m_and_h]

    def _squared_distance_limit(self, count: int) -> float:
        """Largest squared Mahalanobis distance in a joint region of ``count`` unknowns, by the F distribution."""
        from scipy import special

        freedom = min(self.fit.joint_freedom, 1e9)  # fdtri of inf is NaN
        quantile = special.fdtri(count, freedom, self.confidence)
        return float(count * quantile)


def weakness(found: Identification) -> list[Doubt]:
    """Notes on poorly determined mass, centre of mass or inertia; empty if all are well determined."""
    load = found.sensor.load
    unknowns = found.fit.unknowns
    confidence = percent(found.confidence, 3)
    if unknowns.inertia:
        trace = float(load.moment_about_com.trace())
        moments = [name for name in unknowns.names if name.startswith("I")]  # Ixx, Ixy, …
        half_width_of_moment = {name: _half_width(found.interval(name)) for name in moments}
        name = max(moments, key=lambda moment: (half_width_of_moment[moment], moment))
        half_width = half_width_of_moment[name]
        if half_width > _LARGE_SHARE_OF_TRACE * abs(trace):
            half_text = number(half_width, 2)
            trace_text = number(trace, 2)
            return [
                doubt("sensor-weak-inertia", name=name, confidence=confidence, half=half_text, trace=trace_text),
            ]
    mass_half_width = _half_width(found.mass_interval)
    com_half_widths = found._com_half_widths()
    widest_axis = int(com_half_widths.argmax())
    com_half_width = com_half_widths[widest_axis]
    is_mass_known = mass_half_width < _LARGE_SHARE_OF_MASS * load.mass
    if is_mass_known and com_half_width < _LARGE_OFFSET:
        return []
    mass_text = number(mass_half_width, 2)
    com_text = number(1e3 * com_half_width, 2)  # mm
    return [doubt("sensor-weak-load", axis="xyz"[widest_axis], confidence=confidence, mass=mass_text, out=com_text)]


def _half_width(interval: tuple[float, float]) -> float:
    """Half the distance between the ends of an interval."""
    return float(np.ptp(interval)) / 2


complete(globals())
