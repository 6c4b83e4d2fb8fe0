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
        halves = np.diff(self.com_intervals, axis=1)[:, 0] / 2
        com = ", ".join(plus_minus(1e3 * x, 1e3 * half) for x, half in zip(self.sensor.load.com, halves, strict=True))
        word = f"; {self.verdict.word}, see doubts" if self.doubtful else ""
        return (
            f"<Identification: {self.mass_text}, com ({com}) mm, noise {number(self.noise[1], 2)} N and "
            f"{number(self.noise[0], 2)} N m{word}>"
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
        return f"{plus_minus(self.fit.load[0], (high - low) / 2, 'kg')} ({percent(self.confidence, 3)})"

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
        unknowns, factor = self.fit.unknowns, sign_factor(self.sensor.sign)
        residuals = log.readings - unknowns.design(log, factor, self.fit.state) @ self.fit.estimate
        if not unknowns.bias:
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
        noise = f"{number(self.noise[1], 2)} N, {number(self.noise[0], 2)} N m"
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
        name : str, in ``fit.unknowns.names`` (``turn`` and ``tilt``: centred on zero)

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

        Fieller's theorem: exact also for light loads, for which the error of the quotient is skewed.
        Source: Fieller, "Some problems in interval estimation", J. R. Stat. Soc. B 16, 1954.
        """
        x, C, _ = self._load
        m = x[0]
        out = np.tile([-math.inf, math.inf], (3, 1))
        for k in range(3):
            t2 = float(student_quantile(self.fit.com_known[k], self.confidence)) ** 2
            a = m * m - t2 * C[0, 0]
            if a <= 0:
                continue
            b, c = m * x[1 + k] - t2 * C[0, 1 + k], x[1 + k] ** 2 - t2 * C[1 + k, 1 + k]
            root = math.sqrt(max(b * b - a * c, 0.0))
            out[k] = (b - root) / a, (b + root) / a
        return out

    def com_region_contains(self, com: ArrayLike) -> bool:
        """Test if a point is in the joint confidence region of the centre of mass (Fieller's, in three dimensions).

        Returns
        -------
        answer : bool
        """
        x, _, C = self._load
        c = np.asarray(com, float)
        if c.shape != (3,):
            raise ShapeError(f"com has shape {c.shape}, expected (3,).")
        H = np.hstack([-c[:, None], np.eye(3)])  # h - m c
        r = H @ x
        return bool(r @ np.linalg.solve(H @ C @ H.T, r) <= self._limit(3))

    def region_contains(self, mass: float, com: ArrayLike) -> bool:
        """Test if a mass and centre of mass are in their joint confidence region, an ellipsoid of (m, m c).

        Parameters
        ----------
        mass : float [kg]

        Returns
        -------
        answer : bool
        """
        x, _, C = self._load
        r = np.array([mass, *(mass * np.asarray(com, float))]) - x
        return bool(r @ np.linalg.solve(C, r) <= self._limit(4))

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
        """Mass and first moment (4,), their covariance, and their covariance for joint regions."""
        part = slice(self.fit.unknowns.load.start, self.fit.unknowns.load.start + 4)
        return self.fit.estimate[part], self.fit.covariance[part, part], self.fit.joint[part, part]

    def _limit(self, count: int) -> float:
        from scipy import special

        return float(count * special.fdtri(count, min(self.fit.joint_freedom, 1e9), self.confidence))


def weakness(found: Identification) -> list[Doubt]:
    """Notes on poorly determined mass, centre of mass or inertia; empty if all are well determined."""
    fit, load = found.fit, found.sensor.load
    words: dict[str, Any] = {"confidence": percent(found.confidence, 3)}
    if fit.unknowns.inertia:
        size = float(load.moment_about_com.trace())
        moments = [name for name in fit.unknowns.names if name.startswith("I")]
        half, name = max((float(np.ptp(found.interval(name))) / 2, name) for name in moments)
        if half > 0.5 * abs(size):
            return [doubt("sensor-weak-inertia", name=name, half=number(half, 2), trace=number(size, 2), **words)]
    half = float(np.ptp(found.mass_interval)) / 2
    widths = np.diff(found.com_intervals, axis=1)[:, 0] / 2
    k = int(widths.argmax())
    if half < 0.1 * load.mass and widths[k] < 0.01:
        return []
    out = number(1e3 * widths[k], 2)
    return [doubt("sensor-weak-load", mass=number(half, 2), axis="xyz"[k], out=out, **words)]


complete(globals())
