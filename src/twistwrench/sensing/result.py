"""Result of a sensor identification: confidence intervals and regions of its unknowns, and doubts about units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.gravity import KGF
from ..core.numbers import number, percent, plus_minus
from ..core.verdict import Verdict, Word
from ..errors import ShapeError, ValueRangeError
from ..lie import so3
from ..typing import Array
from .checks import Diagnosis
from .fit import Fit, Uncertainty, uncertainty_of
from .log import ReadingLog
from .sensor import ForceTorqueSensor, sign_factor

_OK = Verdict(Word.OK)


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """Identified sensor: bias and load found from a log, and how well they are known.

    Regions are exact for noise that is normal.
    """

    sensor: ForceTorqueSensor
    """The sensor with bias, load and mounting as found."""
    fit: Fit
    """The least-squares fit, with unknowns, covariance and residuals."""
    rows: Array
    """(n,) which clusters were used: dwells, and readings in motion."""
    kept: Array
    """(N,) which readings were used; the others are outliers, or were read between dwells."""
    confidence: float
    """Of intervals and regions, 0 to 1."""
    remarks: tuple[str, ...]
    """What a person should know before using it, in sentences."""
    doubts: tuple[str, ...] = ()
    """Why the log seems not to mean what it says: its units, sign, mounting or poses, in sentences."""
    verdict: Verdict = _OK
    """OK; UNSURE where the intervals may be too narrow; LOOK AGAIN with doubts, with readings left out, or with a load that
    no body can have or that may be none."""
    left_out: Array | None = None
    """(N,) readings that the others contradict."""

    def __repr__(self) -> str:
        # What was found, never the arrays it was found from.
        halves = np.diff(self.com_intervals, axis=1)[:, 0] / 2
        place = ", ".join(plus_minus(1e3 * x, 1e3 * half) for x, half in zip(self.sensor.load.com, halves, strict=True))
        look = f"; {self.verdict.word}, see doubts and remarks" if self.doubtful else ""
        return (
            f"<Identification: {self.mass_text}, com ({place}) mm, noise {number(self.noise[1], 2)} N and "
            f"{number(self.noise[0], 2)} N m{look}>"
        )

    @property
    def mass_text(self) -> str:
        """The mass with half of its confidence interval, in words."""
        low, high = self.mass_interval
        return f"{plus_minus(self.fit.load[0], (high - low) / 2, 'kg')} ({percent(self.confidence, 3)})"

    @property
    def outliers(self) -> list[int]:
        """Readings that were left out, counting from 0."""
        return [] if self.left_out is None else np.flatnonzero(self.left_out).tolist()

    @property
    def doubtful(self) -> bool:
        """Whether a person must look: the verdict is not OK."""
        return not self.verdict.ok

    def rest(self, log: ReadingLog) -> Array:
        """Residuals: what is left of the readings of the log it was found from, with its drift, tilt and delay.

        Parameters
        ----------
        log : ReadingLog, the one it was found from

        Returns
        -------
        residuals : (n, 6) array, (m, f) [N m, N]

        Examples
        --------
        >>> from twistwrench import SpatialInertia, sensing
        >>> tool = sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)))
        >>> log = sensing.simulate(tool, 12)
        >>> found = sensing.identify(log)
        >>> found.rest(log).shape
        (12, 6)
        """
        unknowns, factor = self.fit.unknowns, sign_factor(self.sensor.sign)
        explained = unknowns.design(log, factor, self.fit.state) @ self.fit.estimate
        return np.asarray(log.readings - explained - (0.0 if unknowns.bias else np.asarray(self.sensor.bias)))

    @property
    def uncertainty(self) -> Uncertainty:
        """What the sensor's file keeps of how well it is known."""
        return uncertainty_of(self.fit)

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of one reading's moments [N m] and forces [N], root mean square of three channels each."""
        return self.fit.noise

    def interval(self, name: str) -> tuple[float, float]:
        """Confidence interval of one unknown.

        Parameters
        ----------
        name : str, in ``fit.unknowns.names`` (``turn`` and ``tilt`` about zero)

        Returns
        -------
        interval : (float, float), in the unknown's SI unit

        Examples
        --------
        >>> from twistwrench import SpatialInertia, sensing
        >>> tool = sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)))
        >>> log = sensing.simulate(tool, 12)
        >>> found = sensing.identify(log)
        >>> lower, upper = found.interval(found.fit.unknowns.names[0])
        >>> lower < upper
        True
        """
        names = self.fit.unknowns.names
        if name not in names:
            raise ValueRangeError(f"{name!r} was not identified. Choose one of: {', '.join(names)}.")
        k = names.index(name)
        half = _student(float(self.fit.known[k]), self.confidence) * math.sqrt(self.fit.covariance[k, k])
        middle = self.fit.state.delay if name == "delay" else float(self.fit.estimate[k])
        return middle - half, middle + half

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
        m = x[0]
        out = np.tile([-math.inf, math.inf], (3, 1))
        for k in range(3):
            t2 = _student(float(self.fit.com_known[k]), self.confidence) ** 2
            a = m * m - t2 * C[0, 0]
            if a <= 0:
                continue
            b, c = m * x[1 + k] - t2 * C[0, 1 + k], x[1 + k] ** 2 - t2 * C[1 + k, 1 + k]
            root = math.sqrt(max(b * b - a * c, 0.0))
            out[k] = (b - root) / a, (b + root) / a
        return out

    def com_region_contains(self, com: ArrayLike) -> bool:
        """Whether a point is in the joint confidence region of the centre of mass (Fieller's, for three).

        Parameters
        ----------
        com : (3,) array_like, in {f} [m]

        Returns
        -------
        answer : bool

        Examples
        --------
        >>> from twistwrench import SpatialInertia, sensing
        >>> tool = sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)))
        >>> log = sensing.simulate(tool, 12)
        >>> found = sensing.identify(log)
        >>> found.com_region_contains([0, 0, 0.1])
        True
        """
        x, C = self._load[0], self._joint
        c = np.asarray(com, float)
        if c.shape != (3,):
            raise ShapeError(f"com has shape {c.shape}, expected (3,).")
        H = np.hstack([-c[:, None], np.eye(3)])  # h - m c
        r = H @ x
        return bool(r @ np.linalg.solve(H @ C @ H.T, r) <= self._limit(3))

    def region_contains(self, mass: float, com: ArrayLike) -> bool:
        """Whether mass and centre of mass are in their joint confidence region, an ellipsoid of (m, m c).

        Parameters
        ----------
        mass : float [kg]
        com : (3,) array_like, in {f} [m]

        Returns
        -------
        answer : bool

        Examples
        --------
        >>> from twistwrench import SpatialInertia, sensing
        >>> tool = sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)))
        >>> log = sensing.simulate(tool, 12)
        >>> found = sensing.identify(log)
        >>> found.region_contains(3.0, [0, 0, 0.1])
        True
        """
        x, C = self._load[0], self._joint
        r = np.array([mass, *(mass * np.asarray(com, float))]) - x
        return bool(r @ np.linalg.solve(C, r) <= self._limit(4))

    @property
    def com_deviation(self) -> Array:
        """Standard deviations (3,) of the centre of mass [m], to first order."""
        return com_deviation(self.fit)

    @property
    def turn(self) -> Array:
        """Rotation vector (3,) [rad] of the mounting R_fs; zero if it was not asked for."""
        return so3.log(self.fit.mounting)

    @property
    def _load(self) -> tuple[Array, Array]:
        part = slice(self.fit.unknowns.load.start, self.fit.unknowns.load.start + 4)
        return self.fit.estimate[part], self.fit.covariance[part, part]

    @property
    def _joint(self) -> Array:
        part = slice(self.fit.unknowns.load.start, self.fit.unknowns.load.start + 4)
        return self.fit.joint[part, part]

    def _limit(self, count: int) -> float:
        from scipy import special

        return float(count * special.fdtri(count, min(self.fit.joint_freedom, 1e9), self.confidence))


def com_deviation(fit: Fit) -> Array:
    """Standard deviations (3,) of the centre of mass [m], to first order."""
    part = slice(fit.unknowns.load.start, fit.unknowns.load.start + 4)
    x, C = fit.estimate[part], fit.covariance[part, part]
    D = np.hstack([-(x[1:] / x[0])[:, None], np.eye(3)]) / x[0]
    return np.asarray(np.sqrt(np.diag(D @ C @ D.T)))


def mass_interval(fit: Fit, confidence: float) -> tuple[float, float]:
    """Confidence interval of a fit's mass [kg]."""
    k = fit.unknowns.load.start
    half = _student(float(fit.known[k]), confidence) * math.sqrt(fit.covariance[k, k])
    return float(fit.estimate[k]) - half, float(fit.estimate[k]) + half


def _student(freedom: float, confidence: float) -> float:
    from scipy import special

    return float(special.stdtrit(min(freedom, 1e9), 0.5 + 0.5 * confidence))


def weakness(fit: Fit, sensor: ForceTorqueSensor, confidence: float) -> str | None:
    """A remark if mass or centre of mass is known badly."""
    result = Identification(sensor, fit, np.zeros(0), np.zeros(0), confidence, ())
    names = fit.unknowns.names
    if result.fit.unknowns.inertia:
        size = float(result.sensor.load.moment_about_com.trace())
        unsure = {n: float(np.ptp(result.interval(n))) / 2 for n in names if n.startswith("I")}
        worst = max(unsure, key=lambda n: unsure[n])
        if unsure[worst] > 0.5 * abs(size):
            return (
                f"The motion tells {worst} to ± {number(unsure[worst], 2)} kg m² ({percent(confidence, 3)}) only, beside a "
                f"trace of {number(size, 2)}. Log faster turns about three axes."
            )
    low, high = result.mass_interval
    share = (high - low) / 2 / result.sensor.load.mass
    widths = np.diff(result.com_intervals, axis=1)[:, 0] / 2
    k = int(widths.argmax())
    if share < 0.1 and widths[k] < 0.01:
        return None
    return (
        f"The log tells the mass to ± {number((high - low) / 2, 2)} kg and the centre of mass along {'xyz'[k]} to ± "
        f"{number(1e3 * widths[k], 2)} mm only ({percent(confidence, 3)}). Readings in more and wider orientations tell "
        "more; `poses` proposes some."
    )


# ── Mixed-up units, judged by the tool that they make

# Forces in another unit scale the mass, moments the first moment, so the centre of mass goes with their quotient, as does the
# quotient of the two noises. One of the three may well be unusual. A doubt is raised when one is, and another unit would make
# all three usual; or when one is beyond any tool.


class Mixup(NamedTuple):
    """Units that a log may have been written in instead of N and N m."""

    said: str
    cure: str
    force: float
    """Of that unit in a newton."""
    moment: float
    """Of that unit in a newton metre."""


MIXUPS = (
    Mixup("forces are in grams", f"multiply fx, fy, fz by {KGF / 1000}", 1000 / KGF, 1.0),
    Mixup("forces are in kilograms", f"multiply fx, fy, fz by {KGF}", 1 / KGF, 1.0),
    Mixup("moments are in N mm", "divide mx, my, mz by 1000", 1.0, 1000.0),
    Mixup("moments are in N cm", "divide mx, my, mz by 100", 1.0, 100.0),
    Mixup("forces are in kilograms and moments in kg cm",
          f"multiply fx, fy, fz by {KGF} and mx, my, mz by {KGF / 100}", 1 / KGF, 100 / KGF),
    Mixup("forces are in grams and moments in g cm",
          f"multiply fx, fy, fz by {KGF / 1000} and mx, my, mz by {KGF / 1e5}", 1000 / KGF, 1e5 / KGF),
    Mixup("forces are in pounds and moments in pound inches",
          "multiply fx, fy, fz by 4.448 and mx, my, mz by 0.113", 0.22481, 8.8507),
)  # fmt: skip
"""What logs are found in, the usual ones first."""

# A tool: mass [kg], centre of mass from the sensor [m]; a sensor: noise of forces over that of moments [1/m], which is
# how far its strain gauges are from its axis, at most a few times its radius. All with a tenth to spare.
_USUAL = np.array([[0.045, 55.0], [0.009, 0.33], [4.0, 600.0]])
_BEYOND = np.array([500.0, 0.5, math.inf])  # no tool on a six-axis sensor has these
_FAR = 0.4  # m; a long tool is no doubt yet
_SURE, _NOISE_SURE = 1e-5, 1e-3  # chances that an interval below misses the truth
_NO_NOISE = 1e-4  # of the weight; below, what is left of the readings is their rounding


def unit_doubt(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> str | None:
    """Which unit the log seems to be in, and what to do about it; None if the tool found is one that there may be."""
    found = _found(result, sensor, log)
    usual = _USUAL.copy()
    usual[1, 1] = _FAR
    # Poses that are off leave moments of a lever's length times the forces they leave, whatever the sensor.
    usual[2, 0] = min(usual[2, 0], max(0.7 / max(found[1, 1], 1e-9), 2.1))
    if _overlap(found, usual).all():
        return None
    ways = []
    for place, way in enumerate(MIXUPS):
        meant = found / np.array([way.force, way.moment / way.force, way.force / way.moment])[:, None]
        if _overlap(meant, _USUAL).all():
            off = (np.log(meant[:, 1]) - np.log(_USUAL).mean(axis=1)) / np.ptp(np.log(_USUAL), axis=1)
            ways.append((float((off[np.isfinite(off)] ** 2).sum()) + 0.08 * place, way))
    beyond = bool((found[:, 0] > _BEYOND).any())
    if not (ways or beyond):
        return None
    load, noise = sensor.load, result.fit.noise
    tool = (
        f"a mass of {number(load.mass, 3)} kg, {_length(float(np.linalg.norm(load.com)))} out, on a sensor with noise of "
        f"{number(noise[1], 2)} N and {number(noise[0], 2)} N m"
    )
    if not ways:
        return f"Units look wrong: {tool}, is no tool. Are the readings counts? Multiply them by the sensor's scale."
    best = [way for _, way in sorted(ways, key=lambda pair: pair[0])[:3]]
    first, *others = (f"{way.said} ({way.cure})" for way in best)
    return f"Units look wrong: {tool}, is unusual. Perhaps {'; or '.join([first, *others])}."


def _overlap(found: Array, usual: Array) -> Array:
    return (found[:, 0] <= usual[:, 1]) & (found[:, 2] >= usual[:, 0])


def _found(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Array:
    """Mass [kg], distance of the centre of mass [m] and quotient of the noises [1/m]: (3, 3) surely from, about, to."""
    from scipy import special

    kept, unknowns = result.kept, result.fit.unknowns
    mass, start = float(result.fit.load[0]), unknowns.load.start
    t = float(special.stdtrit(min(float(result.fit.known[start]), 1e9), 1 - _SURE))
    heavy = t * math.sqrt(result.fit.covariance[start, start])
    out, far = float(np.linalg.norm(sensor.load.com)), t * float(np.linalg.norm(com_deviation(result.fit)))
    freedom = max(3.0 * kept.sum() - len(unknowns.names) / 2, 1.0)
    moment, force = np.sqrt((result.fit.residuals[kept].reshape(-1, 2, 3) ** 2).sum(axis=(0, 2)) / freedom)
    weight = mass * float(np.linalg.norm(log.gravity, axis=1).mean())
    noises = (0.0, math.nan, math.inf)
    rough = moment > _rounding(log.readings[:, :3]) and force > _rounding(log.readings[:, 3:])
    if rough and moment > 0 and force > _NO_NOISE * weight:
        times = math.sqrt(float(special.fdtri(freedom, freedom, 1 - _NOISE_SURE)))
        noises = (force / moment / times, force / moment, force / moment * times)
    return np.array([(mass - heavy, mass, mass + heavy), (out - far, out, out + far), noises])


def _rounding(values: Array) -> float:
    """The decimal place that all values are rounded to, such as 0.01; 0 from the seventh on."""
    places = (10.0**-digits for digits in range(7))
    return next((p for p in places if (np.abs(values / p - np.round(values / p)) < 1e-6).all()), 0.0)


def _length(metres: float) -> str:
    return f"{number(metres, 3)} m" if metres >= 1 else f"{number(1e3 * metres, 3)} mm"
