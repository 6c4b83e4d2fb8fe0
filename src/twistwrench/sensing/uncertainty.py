"""Uncertainty of a sensor and of new readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.errors import ValueRangeError
from ..core.typing import Array
from .fit import Fit
from .log import ReadingLog
from .sensor import ForceTorqueSensor, sign_factor
from .unknowns import SensorState, Unknowns

_SENSOR_KINDS = ("bias", "load", "inertia", "turn")
"""Kinds of unknowns of a sensor; drift, tilt and delay belong to one log."""
_MAX_ASYMMETRY = 1e-6
"""Largest difference of mirrored entries of a covariance, as a share of the product of their standard deviations."""
_ROUNDING = 1e-9
"""Size of a negative eigenvalue of a correlation matrix that rounding explains."""
_TINY_VARIANCE = 1e-300
"""Variance in place of 0, as a divisor."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a sensor: covariance of its unknowns, and noise of a reading, with degrees of freedom."""

    unknowns: tuple[str, ...]
    """Names of the p identified unknowns of bias, load, inertia and mounting."""
    covariance: Array
    """Covariance (p, p) of the unknowns."""
    freedom: Array
    """Degrees of freedom (p,) of their variances."""
    noise: Array
    """Standard deviation (6,) of one reading in a new orientation, including pose errors [N m, N]."""
    noise_freedom: Array
    """Degrees of freedom (6,) of the noise variances; inf if the noise was given."""

    def __post_init__(self) -> None:
        p = len(self.unknowns)
        if self._kinds_of_names.names != self.unknowns:
            raise ValueRangeError(f"the unknowns {', '.join(self.unknowns)} are not those of a sensor.")
        shapes = {"covariance": (p, p), "freedom": (p,), "noise": (6,), "noise_freedom": (6,)}
        for name, shape in shapes.items():
            values = np.asarray(getattr(self, name), float)
            is_allowed = np.isfinite(values)
            if name in ("freedom", "noise_freedom"):
                is_allowed |= values == np.inf
            range_text = ""
            if name != "covariance":
                is_allowed &= values >= 0
                range_text = " from 0 on"
            if values.shape != shape or not is_allowed.all():
                raise ValueRangeError(f"{name} is not {shape} numbers{range_text}.")
            object.__setattr__(self, name, values)
        if not (np.diagonal(self.covariance) > 0).all():
            raise ValueRangeError("covariance is not valid: a variance on its diagonal is not above 0.")
        scale = _deviation_products(self.covariance)
        if (np.abs(self.covariance - self.covariance.T) > _MAX_ASYMMETRY * scale).any():
            raise ValueRangeError("covariance is not valid: it is not symmetric.")
        if p and np.linalg.eigvalsh(self.covariance / scale).min() < -_ROUNDING:
            raise ValueRangeError("covariance is not valid: it has a negative eigenvalue.")

    @property
    def _kinds_of_names(self) -> Unknowns:
        """Unknowns with the names of :attr:`unknowns`, found by the first name of each kind; the load is always among them."""
        names = set(self.unknowns)
        return Unknowns(bias="bias mx" in names, inertia="Ixx" in names, turn="turn x" in names)

    def predictive(self, log: ReadingLog, sensor: ForceTorqueSensor) -> Array:
        """Predictive covariance of compensated readings without contact: S = diag σ² + A C A'.

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
        A = self._kinds_of_names.design(log, sign_factor(sensor.sign), state)
        return np.asarray(np.diag(self.noise**2) + A @ self.covariance @ np.swapaxes(A, 1, 2))


def uncertainty_of(fit: Fit) -> Uncertainty:
    """Uncertainty of a fit's sensor: unknowns of the log are marginalised."""
    all_columns = np.arange(len(fit.estimate))
    kinds = [kind for kind in fit.unknowns.kinds if kind in _SENSOR_KINDS]
    columns = np.concatenate([all_columns[fit.unknowns.part(kind)] for kind in kinds])
    names = tuple(fit.unknowns.names[k] for k in columns)
    covariance = fit.joint[np.ix_(columns, columns)]
    return Uncertainty(names, covariance, fit.known[columns], fit.sigma, fit.freedom)


def _deviation_products(covariance: Array) -> Array:
    """Products (p, p) of the standard deviations of two unknowns."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), _TINY_VARIANCE))
    return np.outer(deviations, deviations)
