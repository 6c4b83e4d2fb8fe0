"""Which orientations to read next: those that shrink the unknowns' ellipsoid most."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.gravity import STRENGTH
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..typing import Array
from .gravity_directions import rotations_to_gravity
from .log import ReadingLog, checked_log
from .noise import checked_noise
from .unknowns import SensorState, Unknowns

_CANDIDATES = 400
_BELIEF = 1e3  # what is taken to be possible of each unknown before the first reading, in its own scale


@dataclass(frozen=True, eq=False)
class PoseProposal:
    """Proposed orientations in the order to read them, and what will then be known."""

    gravity: Array
    """(count, 3) gravity in {f} [m/s²]."""
    rotations: Array
    """R_wf (count, 3, 3) that bring it there: the least turn from upright. Turns about the vertical are free."""
    mass_deviation: Array
    """(count,) standard deviation of the mass [kg] after each, for that noise; inf until it can be told."""
    first_moment_deviation: Array
    """(count,) the largest of the first moment m c [kg m] after each; divide by the mass for the centre of mass."""


def propose_poses(
    count: int,
    *,
    log: ReadingLog | None = None,
    candidates: ArrayLike | None = None,
    within: float = math.pi,
    noise: tuple[float, float] = (0.01, 0.3),
    gravity: float = STRENGTH,
) -> PoseProposal:
    """Optimal experiment design: the next orientations for a static identification, D-optimal one by one.

    Parameters
    ----------
    count : int, how many
    log : ReadingLog, optional, readings there are already
    candidates : (n, 3) array_like, optional, gravity directions in {f} to choose from; None: 400 spread evenly
    within : float, keeps those that tilt the tool by no more than that from upright (gravity along -z of {f}) [rad]
    noise : (moment [N m], force [N]), standard deviations of a reading
    gravity : float, size of gravity there [m/s²]

    Returns
    -------
    proposal : PoseProposal

    Raises
    ------
    ValueRangeError
        There is nothing to choose from, or a number is invalid.

    Notes
    -----
    Source: Fedorov, "Theory of Optimal Experiments", 1972: det(M + A'A) = det M · det(1 + A M⁻¹ A').

    Examples
    --------
    >>> proposal = propose_poses(12)
    >>> proposal.gravity.shape, bool(proposal.mass_deviation[-1] < 0.01)
    ((12, 3), True)
    """
    count, sigma = checked_count(count), checked_noise(noise)
    if not arguments.number(within, "within") >= 0:
        raise ValueRangeError(f"within {within!r} is no largest tilt. Give an angle in rad, such as 1.0.")
    directions = _choices(candidates, within)
    unknowns, weight = Unknowns(), (1.0 / np.repeat(sigma, 3))[:, None]
    if not 0 < arguments.number(gravity, "gravity") < math.inf:
        raise ValueRangeError(f"gravity {gravity!r} is no size of gravity. Give it in m/s², such as {STRENGTH}.")
    rows = _design(gravity * directions, unknowns) * weight
    information = np.diag(1.0 / (_BELIEF * unknowns.scales) ** 2)
    if log is not None:
        past = _design(checked_log(log, "propose_poses").gravity, unknowns) * weight
        information = information + np.einsum("nki,nkj->ij", past, past)
    chosen, deviations = [], []
    for _ in range(count):
        covariance = np.linalg.inv(information)
        gain = np.linalg.slogdet(np.eye(6) + rows @ covariance @ np.swapaxes(rows, -1, -2))[1]
        # Of equally good ones (to rounding) the first: the choice is the same on every machine.
        best = int(np.flatnonzero(gain > gain.max() - 1e-9)[0])
        chosen.append(best)
        information = information + rows[best].T @ rows[best]
        known = np.sqrt(np.diag(np.linalg.inv(information)))[unknowns.load]
        deviations.append((known[0], known[1:].max()))
    pulls = gravity * directions[chosen]
    spread = np.array(deviations)
    spread[spread > 10.0] = math.inf  # still only what was believed
    return PoseProposal(pulls, rotations_to_gravity(pulls), spread[:, 0], spread[:, 1])


def checked_count(count: Any) -> int:
    """How many poses, as an int of 1 or more; :class:`~twistwrench.ValueRangeError` otherwise."""
    try:
        whole = operator.index(count)
    except TypeError:
        raise ValueRangeError(f"count {count!r} is no whole number. Ask for a number of poses, such as 12.") from None
    if whole < 1:
        raise ValueRangeError(f"count {whole} proposes nothing. Ask for at least one pose.")
    return whole


def _design(gravity: Array, unknowns: Unknowns) -> Array:
    still = ReadingLog(np.zeros((len(gravity), 6)), gravity)
    return unknowns.design(still, 1.0, SensorState())


def _choices(candidates: ArrayLike | None, within: float) -> Array:
    """Unit gravity directions (n, 3)."""
    if candidates is None:
        k = np.arange(_CANDIDATES) + 0.5  # Fibonacci's lattice over what is allowed; upright is tried first
        cap = 1.0 - math.cos(min(within, math.pi))
        z, turn = cap * k / _CANDIDATES - 1.0, math.pi * (1.0 + math.sqrt(5.0)) * k
        radius = np.sqrt(1.0 - z * z)
        d = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1)
        d = np.concatenate([[[0.0, 0.0, -1.0]], d])
    else:
        d = np.asarray(arguments.real(candidates, "candidates"), float)
        if d.ndim != 2 or d.shape[1] != 3:
            raise ShapeError(
                f"candidates have shape {d.shape}, expected (n, 3): gravity directions in the sensor's frame."
            )
        length = np.linalg.norm(d, axis=1, keepdims=True)
        if not (np.isfinite(d).all() and (length > 0).all()):
            raise ValueRangeError("candidates must be finite and not zero: gravity directions in the sensor's frame.")
        d = d / length
    allowed = d[np.arccos(np.clip(-d[:, 2], -1.0, 1.0)) <= within + 1e-12]
    if not len(allowed):
        raise ValueRangeError(
            f"no candidate tilts the tool by {printed(math.degrees(within), 3)}° or less. Allow more."
        )
    return allowed
