"""How well a sensor is known: what its file keeps, and what that makes of new readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ValueRangeError
from ..typing import Array
from .fit import Fit
from .log import ReadingLog
from .sensor import ForceTorqueSensor, sign_factor
from .unknowns import SensorState, Unknowns

_KINDS = ("bias", "load", "inertia", "turn")  # of the sensor; drift, tilt and delay are of one log


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a sensor: the covariance of its unknowns, and the noise of a reading, with degrees of freedom."""

    unknowns: tuple[str, ...]
    """Names of p unknowns: of the bias, the load and its inertia, and the mounting's turn, those that were identified."""
    covariance: Array
    """(p, p)."""
    freedom: Array
    """(p,) degrees of freedom of their variances."""
    noise: Array
    """(6,) standard deviation of one reading in any orientation, its pose error included [N m, N]."""
    noise_freedom: Array
    """(6,) degrees of freedom of these variances; inf where the noise was given."""

    def __post_init__(self) -> None:
        p = len(self.unknowns)
        if self._asked.names != self.unknowns:
            raise ValueRangeError(f"the unknowns {', '.join(self.unknowns)} are not those of a sensor.")
        for name, shape in (("covariance", (p, p)), ("freedom", (p,)), ("noise", (6,)), ("noise_freedom", (6,))):
            x = np.asarray(getattr(self, name), float)
            whole = np.isfinite(x) | (x == np.inf) if "freedom" in name else np.isfinite(x)
            if x.shape != shape or not whole.all() or (name != "covariance" and (x < 0).any()):
                raise ValueRangeError(
                    f"{name} is not {shape} numbers" + ("." if name == "covariance" else " from 0 on.")
                )
            object.__setattr__(self, name, x)
        if p and np.linalg.eigvalsh(self.covariance / _outer(self.covariance)).min() < -1e-9:
            raise ValueRangeError("covariance is none: it has a negative eigenvalue.")

    @property
    def _asked(self) -> Unknowns:
        has = set(self.unknowns)
        return Unknowns(bias="bias mx" in has, inertia="Ixx" in has, turn="turn x" in has)

    def predictive(self, log: ReadingLog, sensor: ForceTorqueSensor) -> Array:
        """Predictive covariance of what that sensor leaves of readings without contact: S = diag σ² + A C A'.

        Parameters
        ----------
        log : ReadingLog
        sensor : ForceTorqueSensor

        Returns
        -------
        S : (n, 6, 6) array, in products of the units (N m, N)

        Examples
        --------
        >>> from twistwrench import SpatialInertia, sensing
        >>> tool = sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)))
        >>> log = sensing.simulate(tool, 12)
        >>> found = sensing.identify(log)
        >>> found.uncertainty.predictive(log, found.sensor).shape
        (12, 6, 6)
        """
        state = SensorState(np.asarray(sensor.mounting), load=sensor.load.parameters.astype(float))
        A = self._asked.design(log, sign_factor(sensor.sign), state)
        return np.asarray(np.diag(self.noise**2) + A @ self.covariance @ np.swapaxes(A, 1, 2))


def uncertainty_of(fit: Fit) -> Uncertainty:
    """What a fit knows of its sensor; what was of its log alone is left out, its variance stays in the others'."""
    kinds = [kind for kind in fit.unknowns.kinds if kind in _KINDS]
    places = np.concatenate([np.arange(*fit.unknowns.part(kind).indices(len(fit.estimate))) for kind in kinds])
    names = tuple(fit.unknowns.names[k] for k in places)
    C = fit.joint[np.ix_(places, places)]
    return Uncertainty(names, C, fit.known[places], fit.sigma, fit.freedom)


def _outer(C: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(C), 1e-300))
    return np.outer(size, size)
