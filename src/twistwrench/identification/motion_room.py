"""The room that a motion has: limits of positions, rates, accelerations and torques, the floor, and clearances of the user.

Every limit is a band, low ≤ x ≤ high, with a size that makes the distance s from its edge a share. What an optimiser is held
away from edges by is Σ -log s, continued below a width w by the parabola that has its value and slope there,

    ((s - 2 w)² / w² - 1) / 2 - log w,      s < w

so that it is finite beyond the edge, too (Hauser and Saccon, "A barrier function method for the optimization of trajectory
functionals with constraints", CDC 2006).
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

Clear = Callable[[Array], Array]
"""Distances (n, ...) [m] of configurations (n, nq), below 0 where something touches."""
_NEAR = 0.1
"""m: the size of a clearance."""
_STILL = 1e-9
"""m by which the height of a link that does not move may differ."""


@dataclass(frozen=True, eq=False)
class Band:
    """Band low ≤ x ≤ high, (m,) each; inf where nothing is limited."""

    low: Array
    high: Array
    size: Array

    def least(self, x: Array) -> float:
        """The least distance from an edge, as a share; below 0 beyond it."""
        above = ((self.high - x) / self.size).min(initial=np.inf)
        return float(min(above, ((x - self.low) / self.size).min(initial=np.inf)))

    def barrier(self, x: Array, width: float) -> tuple[float, Array]:
        """The barrier of x (n, m), and its derivative (n, m)."""
        value, slope = 0.0, np.zeros_like(x)
        for sign, limit in ((1.0, self.high), (-1.0, self.low)):
            told = np.isfinite(limit)
            s = sign * (limit - x)[:, told] / self.size[told]
            inside = s >= width
            logs = -np.log(np.maximum(s, width))
            value += float(np.where(inside, logs, ((s / width - 2.0) ** 2 - 1.0) / 2.0 + logs).sum())
            by_s = np.where(inside, -1.0 / np.maximum(s, width), (s / width - 2.0) / width)
            slope[:, told] -= sign * by_s / self.size[told]
        return value, slope


@dataclass(frozen=True, eq=False)
class MotionRoom:
    """Room of one robot's motions.

    Attributes
    ----------
    robot : Robot, whose own friction counts among the torques
    bounds : Bounds, those to keep
    friction_speed : (nv,) array, speed at which dry friction turns, for what has to be smooth
    floor : float, optional [m], height that no moving link's origin goes below
    clear : callable, optional
    """

    robot: Robot
    bounds: Bounds
    friction_speed: Array
    floor: float | None = None
    clear: Clear | None = None

    @cached_property
    def bands(self) -> tuple[Band, Band, Band]:
        """Of positions, velocities and accelerations."""
        b = self.bounds
        half = (b.upper - b.lower) / 2.0
        return (
            Band(b.lower, b.upper, np.where(np.isfinite(half), half, 1.0)),
            _both_ways(b.velocity),
            _both_ways(b.acceleration),
        )

    @cached_property
    def reacting(self) -> Band:
        """Of torques and clearances."""
        torques, count = _both_ways(self.bounds.effort), self.clearances(self.robot.neutral[None]).shape[1]
        return Band(
            np.append(torques.low, np.zeros(count)),
            np.append(torques.high, np.full(count, np.inf)),
            np.append(torques.size, np.full(count, _NEAR)),
        )

    @cached_property
    def moving(self) -> Array:
        """Numbers of the links whose origins change their height."""
        heights = self.robot.link_poses(self.robot.random_configuration(0, 32))[..., 2, 3]
        return np.flatnonzero(np.ptp(heights, axis=0) > _STILL)

    def clearances(self, q: Array) -> Array:
        """(n, m) distances [m]: heights of the moving links' origins above the floor, and those of ``clear``."""
        parts = [np.zeros((len(q), 0))]
        if self.floor is not None and self.moving.size:
            parts.append(self.robot.link_poses(q)[:, self.moving, 2, 3] - self.floor)
        if self.clear is not None:
            try:
                own = np.asarray(self.clear(q), float)
            except (TypeError, ValueError) as problem:
                raise ValueRangeError(f"clear could not be asked for {len(q)} configurations: {problem}") from None
            if own.ndim < 1 or len(own) != len(q) or not np.isfinite(own).all():
                raise ShapeError(
                    f"clear gave an array of shape {own.shape} for {len(q)} configurations: give a distance [m] for each, "
                    "finite, below 0 where something touches."
                )
            parts.append(own.reshape(len(q), -1))
        return np.concatenate(parts, axis=1)

    def smooth_reactions(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n, nv + m) torques and clearances, dry friction turning smoothly and at its largest."""
        f = self.robot.model.friction
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq))
        dry = (f.static + f.load * np.abs(rigid)) * np.tanh(dq / self.friction_speed)
        return np.concatenate([rigid + f.viscous * dq + dry, self.clearances(q)], axis=1)

    def least(self, q: Array, dq: Array, ddq: Array) -> float:
        """The least distance from any edge, as a share of its size; below 0 beyond one. Friction as the robot's file has it."""
        tau = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=True))
        reactions = np.concatenate([tau, self.clearances(q)], axis=1)
        found = [band.least(x) for band, x in zip(self.bands, (q, dq, ddq), strict=True)]
        return min(*found, self.reacting.least(reactions))


def _both_ways(limit: Array) -> Band:
    return Band(-limit, limit, np.where(np.isfinite(limit), limit, 1.0))


def half_and_middle(bounds: Bounds) -> tuple[Array, Array]:
    """Half the way between the limits of positions, inf where one is missing, and the middle, meant where both are there."""
    with np.errstate(invalid="ignore"):
        return (bounds.upper - bounds.lower) / 2.0, (bounds.upper + bounds.lower) / 2.0


def shared_bounds(bounds: Bounds, share: float) -> Bounds:
    """A share of the limits of positions, about their middle, of velocities and of torques; accelerations as they are.

    Parameters
    ----------
    bounds : Bounds
    share : float, above 0, at most 1

    Returns
    -------
    bounds : Bounds

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = shared_bounds(tw.trajectories.bounds_of(tw.robots.planar_2r(), velocity=2.0), 0.5)
    >>> found.velocity.tolist()
    [1.0, 1.0]
    """
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    with np.errstate(invalid="ignore"):
        lower = np.where(both, middle - share * half, bounds.lower)
        upper = np.where(both, middle + share * half, bounds.upper)
    return replace(bounds, lower=lower, upper=upper, velocity=share * bounds.velocity, effort=share * bounds.effort)
