"""Constraints of an exciting motion: limits of positions, rates, accelerations and torques, the floor, and clearances.

Every limit is a band, low ≤ x ≤ high, with a size that makes the distance s from its edge a share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import ShapeError, ValueRangeError
from ..motion.bounds import Bounds
from ..robot import Robot
from ..typing import Array
from .capsules import MARGIN, CapsuleDistances

Clear = Callable[[Array], Array]
"""Distances (n, ...) [m] of configurations (n, nq), below 0 where something touches."""
_NEAR = 0.1
"""m: the size of a clearance."""
DENSE = 0.01
"""s: the longest step at which clearances are looked at in the end."""
_STEP = 1e-5
"""Displacement of configurations for slopes of the user's distances."""


@dataclass(frozen=True, eq=False)
class Band:
    """Band low ≤ x ≤ high, (m,) each; inf where nothing is limited."""

    low: Array
    high: Array
    size: Array

    @cached_property
    def edges(self) -> tuple[tuple[float, Array, Array], ...]:
        """Sign, places (k,) and limits (k,) of the edges above and below."""
        return tuple(
            (sign, np.flatnonzero(np.isfinite(limit)), limit[np.isfinite(limit)])
            for sign, limit in ((1.0, self.high), (-1.0, self.low))
        )

    def shares(self, x: Array) -> Array:
        """(n, k) distances of x (n, m) from all edges, as shares; below 0 beyond them."""
        return np.concatenate(
            [sign * (limit - x[:, limited]) / self.size[limited] for sign, limited, limit in self.edges], axis=1
        )

    def least(self, x: Array) -> float:
        """The least distance from an edge, as a share; below 0 beyond it."""
        return float(self.shares(x).min(initial=np.inf))

    def slope(self, forces: Array) -> Array:
        """(n, m) derivative by x of the sum of forces (n, k) times shares."""
        found, done = np.zeros((len(forces), len(self.size))), 0
        for sign, limited, _ in self.edges:
            found[:, limited] -= sign * forces[:, done : done + len(limited)] / self.size[limited]
            done += len(limited)
        return found


@dataclass(frozen=True, eq=False)
class TrajectoryConstraints:
    """Constraints on the motions of one robot.

    Attributes
    ----------
    robot : Robot, whose own friction counts among the torques
    bounds : Bounds, those to keep
    friction_speed : (nv,) array, speed at which dry friction turns, for what has to be smooth
    capsules : CapsuleDistances, of the floor and the robot itself
    clear : callable, optional
    """

    robot: Robot
    bounds: Bounds
    friction_speed: Array
    capsules: CapsuleDistances
    clear: Clear | None = None

    @cached_property
    def bands(self) -> tuple[Band, Band, Band, Band, Band]:
        """Bands of positions, velocities, accelerations, torques and clearances."""
        b = self.bounds
        half = (b.upper - b.lower) / 2.0
        count = self.clearances(self.robot.neutral[None]).shape[1]
        return (
            Band(b.lower, b.upper, np.where(np.isfinite(half), half, 1.0)),
            _both_ways(b.velocity),
            _both_ways(b.acceleration),
            _both_ways(b.effort),
            Band(
                self._margins(count),
                np.full(count, np.inf),
                np.full(count, _NEAR),
            ),
        )

    def _margins(self, count: int) -> Array:
        """Least of each of the clearances (count,) [m]: the user's distances may come to 0."""
        found = np.where(np.arange(count) < self.capsules.count, MARGIN, 0.0)
        if self.capsules.margins is not None:
            found[: len(self.capsules.margins)] = self.capsules.margins
        return found

    def clearances(self, q: Array) -> Array:
        """(n, m) distances [m]: those of the capsules, and those of ``clear``."""
        return np.concatenate([self.capsules.distances(q, MARGIN + _NEAR), self._user_clearances(q)], axis=1)

    def clearance_slopes(self, q: Array, weights: Array) -> Array:
        """(n, nq) derivative by the joints of a sum of the clearances with weights (n, m)."""
        own = self.capsules.count
        found = self.capsules.slopes(q, weights[:, :own])
        if self.clear is not None and weights[:, own:].any():
            for k, step in enumerate(_STEP * np.eye(q.shape[1])):
                moved = (self._user_clearances(q + step) - self._user_clearances(q - step)) / (2.0 * _STEP)
                found[:, k] += (moved * weights[:, own:]).sum(axis=1)
        return found

    def _user_clearances(self, q: Array) -> Array:
        if self.clear is None:
            return np.zeros((len(q), 0))
        try:
            found = np.asarray(self.clear(q), float)
        except (TypeError, ValueError) as problem:
            raise ValueRangeError(f"clear could not be asked for {len(q)} configurations: {problem}") from None
        if found.ndim < 1 or len(found) != len(q) or not np.isfinite(found).all():
            raise ShapeError(
                f"clear gave an array of shape {found.shape} for {len(q)} configurations: give a distance [m] for each, "
                "finite, below 0 where something touches."
            )
        return found.reshape(len(q), -1)

    def smooth_torques(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n, nv) torques, dry friction turning smoothly and at its largest."""
        f = self.robot.model.friction
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq))
        dry = (f.static + f.load * np.abs(rigid)) * np.tanh(dq / self.friction_speed)
        return np.asarray(rigid + f.viscous * dq + dry)

    def least(self, q: Array, dq: Array, ddq: Array) -> float:
        """The least distance from any edge, as a share of its size; below 0 beyond one. Friction as the robot's file has it."""
        found = self.least_of_joints(q, dq, ddq)
        if found < 0.0:
            return found
        tau = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=True))
        return min(found, self.bands[3].least(tau), self.bands[4].least(self.clearances(q)))

    def least_of_joints(self, q: Array, dq: Array, ddq: Array) -> float:
        """The same of positions, velocities and accelerations alone."""
        return min(band.least(x) for band, x in zip(self.bands, (q, dq, ddq), strict=False))


def _both_ways(limit: Array) -> Band:
    return Band(-limit, limit, np.where(np.isfinite(limit), limit, 1.0))


def half_and_middle(bounds: Bounds) -> tuple[Array, Array]:
    """Half the way between the limits of positions, inf where one is missing, and the middle, meant where both are there."""
    with np.errstate(invalid="ignore"):
        return (bounds.upper - bounds.lower) / 2.0, (bounds.upper + bounds.lower) / 2.0


def shared_bounds(bounds: Bounds, share: float) -> Bounds:
    """A share of the limits of positions, about their middle, of velocities and of torques; accelerations as they are."""
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    with np.errstate(invalid="ignore"):
        lower = np.where(both, middle - share * half, bounds.lower)
        upper = np.where(both, middle + share * half, bounds.upper)
    return replace(bounds, lower=lower, upper=upper, velocity=share * bounds.velocity, effort=share * bounds.effort)
