"""A sensor found from a log: confidence intervals and regions of its unknowns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, ValueRangeError
from ..lie import so3
from .fit import Fit
from .sensor import ForceTorqueSensor

Array = NDArray[Any]

__all__ = ["Identification", "mass_interval", "weakness"]


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """A sensor found from a log, and how well it is known. Regions are exact for noise that is normal."""

    sensor: ForceTorqueSensor
    fit: Fit
    kept: Array
    """(n,) which readings were used; the others are outliers."""
    confidence: float
    remarks: tuple[str, ...]
    """What a person should know before using it, in sentences."""
    doubts: tuple[str, ...] = ()
    """Why the log seems not to mean what it says: its units, sign, mounting or poses, in sentences."""

    def __repr__(self) -> str:
        # What was found, never the arrays it was found from.
        place = ", ".join(f"{1e3 * x:.1f}" for x in self.sensor.load.com)
        wide = ", ".join(f"{5e2 * w:.1f}" for w in np.diff(self.com_intervals, axis=1)[:, 0])
        look = "; LOOK AGAIN, see doubts and remarks" if self.doubtful else ""
        return (
            f"<Identification: {self.mass_text}, com ({place}) ± ({wide}) mm, noise {self.noise[1]:.2g} N and "
            f"{self.noise[0]:.2g} N m{look}>"
        )

    @property
    def mass_text(self) -> str:
        """The mass with half of its confidence interval, in words."""
        low, high = self.mass_interval
        return f"{self.fit.load[0]:.4g} ± {(high - low) / 2:.2g} kg ({100 * self.confidence:g} %)"

    @property
    def outliers(self) -> list[int]:
        """Readings that were left out, counting from 0."""
        return np.flatnonzero(~self.kept).tolist()

    @property
    def doubtful(self) -> bool:
        """Whether a person must look: doubts, outliers left out, or a load that no body can have or that may be none."""
        impossible = bool(self.sensor.load.defects()) or self.mass_interval[0] <= 0
        return bool(self.doubts) or bool(self.outliers) or impossible

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of one reading's moments [N m] and forces [N]."""
        return float(self.fit.sigma[0]), float(self.fit.sigma[1])

    def interval(self, name: str) -> tuple[float, float]:
        """Confidence interval of one unknown, by its name in ``fit.unknowns.names`` (``turn`` ones about zero)."""
        names = self.fit.unknowns.names
        if name not in names:
            raise ValueRangeError(f"{name!r} was not identified. Choose one of: {', '.join(names)}.")
        k = names.index(name)
        half = self._t * math.sqrt(self.fit.covariance[k, k])
        return float(self.fit.estimate[k]) - half, float(self.fit.estimate[k]) + half

    @property
    def mass_interval(self) -> tuple[float, float]:
        """Confidence interval of the mass [kg]."""
        return mass_interval(self.fit, self.confidence)

    @property
    def com_intervals(self) -> Array:
        """Confidence intervals (3, 2) of the centre of mass [m]; infinite while the mass may be zero.

        By Fieller's theorem, so right for loads that are light beside the noise, where errors of a quotient are lopsided.
        Source: Fieller, "Some problems in interval estimation", J. R. Stat. Soc. B 16, 1954.
        """
        x, C = self._load
        t2, m = self._t**2, x[0]
        a = m * m - t2 * C[0, 0]
        out = np.tile([-math.inf, math.inf], (3, 1))
        for k in range(3 if a > 0 else 0):
            b, c = m * x[1 + k] - t2 * C[0, 1 + k], x[1 + k] ** 2 - t2 * C[1 + k, 1 + k]
            root = math.sqrt(max(b * b - a * c, 0.0))
            out[k] = (b - root) / a, (b + root) / a
        return out

    def com_region_contains(self, com: ArrayLike) -> bool:
        """Whether a point (3,) [m] is in the joint confidence region of the centre of mass (Fieller's, for three)."""
        from scipy import special

        x, C = self._load
        c = np.asarray(com, float)
        if c.shape != (3,):
            raise ShapeError(f"com has shape {c.shape}, expected (3,).")
        H = np.hstack([-c[:, None], np.eye(3)])  # h - m c
        r = H @ x
        return bool(r @ np.linalg.solve(H @ C @ H.T, r) <= 3 * special.fdtri(3, self._freedom, self.confidence))

    def region_contains(self, mass: float, com: ArrayLike) -> bool:
        """Whether mass [kg] and centre of mass (3,) [m] are in their joint confidence region, an ellipsoid of (m, m c)."""
        from scipy import special

        x, C = self._load
        r = np.array([mass, *(mass * np.asarray(com, float))]) - x
        return bool(r @ np.linalg.solve(C, r) <= 4 * special.fdtri(4, self._freedom, self.confidence))

    @property
    def com_deviation(self) -> Array:
        """Standard deviations (3,) of the centre of mass [m], to first order."""
        x, C = self._load
        D = np.hstack([-(x[1:] / x[0])[:, None], np.eye(3)]) / x[0]
        return np.sqrt(np.diag(D @ C @ D.T))

    @property
    def turn(self) -> Array:
        """Rotation vector (3,) [rad] of the mounting R_fs; zero if it was not asked for."""
        return so3.log(self.fit.mounting)

    @property
    def _load(self) -> tuple[Array, Array]:
        part = slice(self.fit.unknowns.load.start, self.fit.unknowns.load.start + 4)
        return self.fit.estimate[part], self.fit.covariance[part, part]

    @property
    def _freedom(self) -> float:
        return _freedom(self.fit)

    @property
    def _t(self) -> float:
        return _student(self.fit, self.confidence)


def mass_interval(fit: Fit, confidence: float) -> tuple[float, float]:
    """Confidence interval of a fit's mass [kg]."""
    k = fit.unknowns.load.start
    half = _student(fit, confidence) * math.sqrt(fit.covariance[k, k])
    return float(fit.estimate[k]) - half, float(fit.estimate[k]) + half


def _freedom(fit: Fit) -> float:
    return float(min(fit.freedom.min(), 1e9))


def _student(fit: Fit, confidence: float) -> float:
    from scipy import special

    return float(special.stdtrit(_freedom(fit), 0.5 + 0.5 * confidence))


def weakness(result: Identification) -> str | None:
    """A remark if mass or centre of mass is known badly."""
    names, percent = result.fit.unknowns.names, 100 * result.confidence
    if result.fit.unknowns.inertia:
        size = float(result.sensor.load.moment_about_com.trace())
        unsure = {n: float(np.ptp(result.interval(n))) / 2 for n in names if n.startswith("I")}
        worst = max(unsure, key=lambda n: unsure[n])
        if unsure[worst] > 0.5 * abs(size):
            return (
                f"The motion tells {worst} to ± {unsure[worst]:.2g} kg m² ({percent:g} %) only, beside a trace of {size:.2g}. "
                "Log faster turns about three axes."
            )
    low, high = result.mass_interval
    share = (high - low) / 2 / result.sensor.load.mass
    widths = np.diff(result.com_intervals, axis=1)[:, 0] / 2
    k = int(widths.argmax())
    if share < 0.1 and widths[k] < 0.01:
        return None
    return (
        f"The log tells the mass to ± {(high - low) / 2:.2g} kg and the centre of mass along {'xyz'[k]} to ± "
        f"{1e3 * widths[k]:.2g} mm only ({percent:g} %). Readings in more and wider orientations tell more; `poses` "
        "proposes some."
    )
