"""Bias, mass, centre of mass, inertia and mounting of a sensor's load, from a log, with what is known of each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..typing import Array
from .dwells import witnesses
from .fit import Problem, fit
from .fit_verdict import Use, judged
from .identified import Identification
from .log import ReadingLog, checked_log
from .noise import six_noises
from .observability import advice, blind_spots
from .outliers import least_rows, touched_in_dwells, trimmed
from .sensor import Sign, sign_factor
from .sign_and_mounting import Diagnosis, guessed
from .suggested_unknowns import unless_drift
from .unknowns import Unknowns
from .whiteness import whiteness


def identify(
    log: ReadingLog,
    *,
    sign: Sign = "on_sensor",
    inertia: bool = False,
    orientation: bool = False,
    drift: bool = False,
    delay: bool = False,
    tilt: bool = False,
    bias: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    outliers: str = "trim",
    confidence: float = 0.95,
) -> Identification:
    """Force-torque sensor identification: its bias and its load's mass and centre of mass, from readings in different poses.

    Parameters
    ----------
    log : ReadingLog
    sign : "on_sensor" or "by_sensor", whose wrench the readings are
    inertia : bool, also the six inertia numbers (the log must have V and dV, in lively motion)
    orientation : bool, also the rotation of the sensor's axes against {f}
    drift : bool, also a linear change of the bias, which is then that of the middle of the log
    delay : bool, also the time by which readings are late
    tilt : bool, also a turn of gravity about two level axes of {w}
    bias : (6,) array_like, optional, known, not looked for [N m, N]
    noise : (moment [N m], force [N]), optional, known standard deviations in place of the fit's own
    outliers : "trim" leaves out readings that the others contradict and says which, "keep" trusts all
    confidence : float, of intervals and regions, 0 to 1

    Returns
    -------
    found : Identification
        Doubts of units, sign, mounting, bias and poses are in it.

    Raises
    ------
    ShapeError
        ``log`` is no log.
    ValueRangeError
        The log cannot tell what was asked, naming the combinations of unknowns that no reading changes with, or mass
        comes out negative.

    Notes
    -----
    Without ``inertia`` the sensor found has a load whose inertia is ``unknown``: it compensates forces in motion, not
    moments. Source: least squares of F = Y π, Modern Robotics eq. 8.40.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> from twistwrench.sensing import ForceTorqueSensor, simulate
    >>> tool = ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)), bias=[0, 0, 0, 5, 0, 0])
    >>> found = identify(simulate(tool, 12, noise=(0.0, 0.0)))
    >>> round(found.sensor.load.mass, 6), round(float(found.sensor.load.com[2]), 6)
    (3.0, 0.1)
    """
    log, factor = checked_log(log, "identify"), sign_factor(sign)
    asked = {"inertia": inertia, "orientation": orientation, "drift": drift, "tilt": tilt, "delay": delay}
    unknowns = Unknowns(bias is None, *(arguments.flag(x, what) for what, x in asked.items()))
    known_bias, known_noise = _checked(bias, noise, outliers, confidence)
    _check_log(log, unknowns)
    used = np.ones(len(log), bool)
    witness = witnesses(log)
    if outliers == "trim" and (touched := touched_in_dwells(log, witness)).any():
        used = ~touched
        witness = witnesses(log.rows(used))
    problem = Problem(
        witness.log,
        unknowns,
        factor,
        known_bias,
        known_noise,
        witness.count,
        witness.within,
        witness.within_freedom,
        witness.label,
        log.time is not None,
    )
    if blind := blind_spots(log.rows(used), unknowns, factor):
        raise ValueRangeError(f"{log.name}: {' '.join(blind[:3])} {advice(log, unknowns)}")
    problem = guessed(problem)
    kept = np.ones(len(witness.log), bool)
    if outliers == "trim" and len(witness.log) > least_rows(problem):
        found, kept = unless_drift(problem, *trimmed(problem))
    else:
        found = fit(problem, keep=kept)
    label = problem.label
    white = whiteness(found, kept, label)
    again = len(np.unique(problem.label)) < len(kept)
    if white is not None and white.length > 1 and not again:  # neighbours that hang together are one witness
        problem = replace(problem, label=np.arange(len(kept)) // white.length, state=found.state)
        found = fit(problem, keep=kept)
    left_out, between = ~used, np.zeros(len(log), bool)
    between[used] = witness.row < 0
    left_out[used] = ~witness.spread(kept) & ~between[used]
    return judged(Diagnosis(sign, found, kept), confidence, problem, log, Use(left_out, between, label, white))


def _check_log(log: ReadingLog, unknowns: Unknowns) -> None:
    if unknowns.inertia and log.V is None:
        raise ValueRangeError(
            f"{log.name}: inertia shows only in motion, and the log has none. Give V and dV (columns wx, wy, wz, vx, vy, "
            "vz, dwx, …, dvz), or ask for no inertia."
        )
    if unknowns.delay and (log.V is None or log.time is None):
        raise ValueRangeError(
            f"{log.name}: a delay shows only in motion, and the log has no {'time' if log.time is None else 'motion'}. Give "
            "time, V and dV, or ask for no delay."
        )
    if unknowns.tilt and log.rotations is None:
        raise ValueRangeError(
            f"{log.name}: the log has gravity in the sensor's frame, so a tilt of the base has no part in it. Give "
            "orientations, or ask for no tilt."
        )
    least = max(3, math.ceil((len(unknowns.names) + 2) / 6) + unknowns.turn)
    if len(log) < least:
        count, wanted = len(log), len(unknowns.names)
        raise ValueRangeError(
            f"{log.name}: {count} reading{'s' * (count > 1)}, and {wanted} unknowns need at least {least} in different "
            "orientations. Add readings; `poses` proposes some."
        )


def _checked(
    bias: ArrayLike | None, noise: ArrayLike | None, outliers: str, confidence: float
) -> tuple[Array, Array | None]:
    known_bias = np.zeros(6) if bias is None else np.asarray(arguments.real(bias, "bias"), float)
    if known_bias.shape != (6,):
        raise ShapeError(f"bias has shape {known_bias.shape}, expected (6,): mx, my, mz, fx, fy, fz.")
    if not np.isfinite(known_bias).all():
        raise ValueRangeError(f"bias {known_bias.tolist()} has a value that is not a finite number.")
    known = None if noise is None else six_noises(noise)
    arguments.choice(outliers, "outliers", ("trim", "keep"))
    if not 0 < arguments.number(confidence, "confidence") < 1:
        raise ValueRangeError(f"confidence {confidence!r} is not between 0 and 1. Give 0.95 for 95 %.")
    return known_bias, known
