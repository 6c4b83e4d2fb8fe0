"""Bias, mass, centre of mass, inertia and mounting of a sensor's load, from a log, with what is known of each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.inertia import SpatialInertia
from ..errors import ShapeError, ValueRangeError
from ..lie import so3
from .blind_spots import advice, blind_spots
from .fit import Fit, Unknowns, fit
from .identified import Identification, weakness
from .log import ReadingLog
from .outliers import runs, trimmed
from .sensor import ForceTorqueSensor, Sign, sign_factor

Array = NDArray[Any]

__all__ = ["identify"]

_LEAST = 3  # gravity directions that fix a mass, its place and six biases
_MISFIT = 1.5  # residuals this many times the noise given are not that noise


def identify(
    log: ReadingLog,
    *,
    sign: Sign = "on_sensor",
    inertia: bool = False,
    orientation: bool = False,
    bias: ArrayLike | None = None,
    noise: tuple[float, float] | None = None,
    outliers: str = "trim",
    confidence: float = 0.95,
) -> Identification:
    """The sensor's bias and its load's mass and centre of mass, from readings in different orientations.

    ``inertia``: also the six inertia numbers (the log must have V and dV, in lively motion). ``orientation``: also the
    rotation of the sensor's axes against {f}. ``bias`` (6,): known, not looked for. ``noise``: known standard deviations
    (moment [N m], force [N]) in place of the fit's own. ``outliers``: ``trim`` leaves out readings that the others
    contradict and says which, ``keep`` trusts all.

    Raises :class:`~twistwrench.ValueRangeError` when the log cannot tell what was asked, naming the combinations of unknowns
    that no reading changes with, and when mass comes out negative.
    Source: least squares of F = Y π, Modern Robotics eq. 8.40.

    >>> from twistwrench.sensing.simulate import simulate
    >>> tool = ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)), bias=[0, 0, 0, 5, 0, 0])
    >>> found = identify(simulate(tool, 12, noise=(0.0, 0.0)))
    >>> round(found.sensor.load.mass, 6), round(float(found.sensor.load.com[2]), 6)
    (3.0, 0.1)
    """
    factor = sign_factor(sign)
    unknowns = Unknowns(bias=bias is None, inertia=inertia, turn=orientation)
    known_bias, known_noise = _checked(bias, noise, outliers, confidence)
    if inertia and log.V is None:
        raise ValueRangeError(
            f"{log.name}: inertia shows only in motion, and the log has none. Give V and dV (columns wx, wy, wz, vx, vy, "
            "vz, dwx, …, dvz), or ask for no inertia."
        )
    least = max(_LEAST, math.ceil((len(unknowns.names) + 2) / 6) + orientation)
    if len(log) < least:
        count, wanted = len(log), len(unknowns.names)
        raise ValueRangeError(
            f"{log.name}: {count} reading{'s' * (count > 1)}, and {wanted} unknowns need at least {least} in different "
            "orientations. Add readings; `poses` proposes some."
        )
    if blind := blind_spots(log, unknowns, factor):
        raise ValueRangeError(f"{log.name}: {' '.join(blind[:3])} {advice(log, unknowns)}")
    problem: dict[str, Any] = {
        "log": log,
        "unknowns": unknowns,
        "factor": factor,
        "bias": known_bias,
        "noise": known_noise,
    }
    if orientation:
        problem["mounting"] = _first_guess(log, factor, fixed=None if bias is None else known_bias)
    if outliers == "trim" and len(log) > least:
        found, kept = trimmed(least, **problem)
    else:
        kept = np.ones(len(log), bool)
        found = fit(**problem, keep=kept)
    return _judged(log, found, kept, sign, known_bias, confidence)


def _checked(
    bias: ArrayLike | None, noise: tuple[float, float] | None, outliers: str, confidence: float
) -> tuple[Array, Array | None]:
    known_bias = np.zeros(6) if bias is None else np.asarray(bias, float)
    if known_bias.shape != (6,):
        raise ShapeError(f"bias has shape {known_bias.shape}, expected (6,): mx, my, mz, fx, fy, fz.")
    known = None if noise is None else np.asarray(noise, float)
    if known is not None and (known.shape != (2,) or not (known > 0).all()):
        raise ValueRangeError(f"noise {noise!r} is not two positive numbers: of moments [N m] and of forces [N].")
    if outliers not in ("trim", "keep"):
        raise ValueRangeError(f"outliers {outliers!r} is not known. Choose one of: trim, keep.")
    if not 0 < confidence < 1:
        raise ValueRangeError(f"confidence {confidence!r} is not between 0 and 1. Give 0.95 for 95 %.")
    return known_bias, known


def _first_guess(log: ReadingLog, factor: float, fixed: Array | None) -> Array:
    """A mounting R_fs (3, 3) from forces alone: the rotation nearest to M of f = bias + M g, however large."""
    felt = log.gravity
    if log.V is not None and log.dV is not None:
        felt = log.gravity - log.dV[:, 3:] - so3.cross(log.V[:, :3], log.V[:, 3:])
    f = log.readings[:, 3:]
    if fixed is None:
        felt, f = felt - felt.mean(axis=0), f - f.mean(axis=0)
    else:
        f = f - fixed[3:]
    M = factor * np.linalg.lstsq(felt, f, rcond=None)[0].T  # m R_fs'
    U, _, Vt = np.linalg.svd(M)
    return np.asarray((U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T)


def _judged(
    log: ReadingLog, found: Fit, kept: Array, sign: Sign, known_bias: Array, confidence: float
) -> Identification:
    """The result with its remarks; an error if the mass is negative."""
    parameters = found.load
    mass, deviation = (
        float(parameters[0]),
        math.sqrt(found.covariance[found.unknowns.load.start, found.unknowns.load.start]),
    )
    if mass < -2 * deviation or mass == 0:
        other = "by_sensor" if sign == "on_sensor" else "on_sensor"
        raise ValueRangeError(
            f"{log.name}: mass comes out as {mass:.4g} kg, so the readings seem to have the other sign. "
            f"Use sign={other!r}, or check that the poses are of the sensor's frame."
        )
    load = SpatialInertia.from_parameters(parameters)
    if not found.unknowns.inertia and mass > 2 * deviation:  # at least the moments of a point mass there
        load = SpatialInertia.from_com(mass, load.com)
    bias = found.estimate[:6] if found.unknowns.bias else known_bias
    remarks = []
    if mass < 2 * deviation:
        remarks.append(
            f"The mass, {mass:.3g} ± {deviation:.2g} kg, cannot be told from zero, so neither can its place."
        )
    elif defects := load.defects():
        remarks.append(
            f"The load cannot be a real body ({'; '.join(defects)}): noise is larger than what the motion shows. "
            "sensor.load.nearest_consistent() is the nearest that can; livelier motion tells more."
        )
    if out := np.flatnonzero(~kept).tolist():
        spans = [f"{a}" if a == b else f"{a}–{b}" for a, b in runs(~kept)]
        listed = ", ".join(spans[:10]) + (", …" if len(spans) > 10 else "")
        remarks.append(f"Left out {len(out)} of {len(log)} readings that the others contradict: {listed} (from 0).")
    for what, sigma, part in zip(("moments", "forces"), found.sigma, (slice(0, 3), slice(3, 6)), strict=True):
        times = float(np.sqrt(np.mean(found.residuals[kept][:, part] ** 2))) / sigma
        if np.isinf(found.freedom).all() and times > _MISFIT:
            remarks.append(
                f"What is left of the {what} is {times:.2g} times the noise given: the intervals are too narrow. "
                "Let the noise be estimated, or check poses and sign."
            )
    sensor = ForceTorqueSensor(load, bias, sign, found.mounting)
    result = Identification(sensor, found, kept, confidence, tuple(remarks))
    if mass >= 2 * deviation and (weak := weakness(result)):
        return Identification(sensor, found, kept, confidence, (*remarks, weak))
    return result
