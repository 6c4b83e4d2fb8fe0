"""Constraints on exciting trajectories: limits, the floor, and clearances of the capsules around the links.

Each constraint is low ≤ x ≤ high. Each edge has a size, and distances from it are shares of that size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...core.errors import ShapeError, ValueRangeError
from ...core.typing import Array
from ...mechanics.model.limits import Limits
from ...robot import Robot
from ...shapes.capsules import MARGIN, CapsuleDistances, Pullback

Clear = Callable[[Array], Array]
"""Distances (n, ...) [m] of configurations (n, nq), below 0 in contact."""
_CLEARANCE_SCALE = 0.1  # scale of a clearance [m]
MAX_CHECK_STEP = 0.01
"""Maximum step at which clearances are finally checked [s]."""
_POSITION_STEP = 1e-5  # step of finite differences of the user's distances


@dataclass(frozen=True, eq=False)
class TrajectoryConstraints:
    """Constraints on the motions of one robot."""

    robot: Robot  # its own friction is part of the torques
    bounds: Limits  # limits of the motion
    friction_speed: Array  # (nv,), Coulomb smoothing speed for the smooth torques
    capsules: CapsuleDistances  # distances from the floor and between links
    clear: Clear | None = None

    @cached_property
    def _edges(self) -> tuple[int, Array, Array, Array]:
        """Number of upper edges; column (e,), share at 0 (e,) and slope (e,) of all edges, upper ones first.

        Columns are positions, velocities, accelerations, torques and distances.
        """
        b = self.bounds
        half = (b.upper - b.lower) / 2.0
        margins = np.full(self._clearances(self.robot.neutral[None])[0].shape[1], MARGIN)
        margins[self.capsules.count :] = 0.0  # the user's distances may reach 0
        margins[: len(self.capsules.margins)] = self.capsules.margins
        both = np.concatenate([b.velocity, b.acceleration, b.effort])
        high = np.concatenate([b.upper, both, np.full(len(margins), np.inf)])
        low = np.concatenate([b.lower, -both, margins])
        size = np.concatenate([np.where(np.isfinite(half), half, 1.0), both, np.full(len(margins), _CLEARANCE_SCALE)])
        above, below = np.flatnonzero(np.isfinite(high)), np.flatnonzero(np.isfinite(low))
        columns, signs = np.concatenate([above, below]), np.repeat([-1.0, 1.0], [len(above), len(below)])
        slopes = signs / size[columns]
        return len(above), columns, -slopes * np.concatenate([high[above], low[below]]), slopes

    def evaluate(self, states: Array, *, smooth: bool = False) -> tuple[Array, Pullback]:
        """Distances from all edges as shares of their sizes, negative if violated, and their pullback.

        Parameters
        ----------
        states : (3, n, nv) array, positions, velocities and accelerations
        smooth : bool, use smooth dry friction at its largest value instead of the file's; the pullback always does

        Returns
        -------
        shares : (n, e) array
        pullback : function that maps weights (n, e) to the derivative (3, n, nv) of the weighted sum by the states
        """
        (q, dq, ddq), f, nv = states, self.robot.model.friction, states.shape[2]
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=not smooth))
        eased, dry = np.tanh(dq / self.friction_speed), f.static + f.load * np.abs(rigid)
        tau = rigid + f.viscous * dq + dry * eased if smooth else rigid
        distances, of_distances = self._clearances(q)
        upper, columns, at_0, slopes = self._edges
        x = np.concatenate([q, dq, ddq, tau, distances], axis=1)

        def pullback(weights: Array) -> Array:
            by_x, scaled = np.zeros_like(x), weights * slopes
            by_x[:, columns[:upper]] = scaled[:, :upper]
            by_x[:, columns[upper:]] += scaled[:, upper:]
            by_q, by_dq, by_ddq, by_tau, by_distances = np.split(by_x, [nv, 2 * nv, 3 * nv, 4 * nv], axis=1)
            felt = by_tau * (1.0 + f.load * np.sign(rigid) * eased)
            found = np.stack([by_q, by_dq, by_ddq]) + self.robot.inverse_dynamics_gradient(q, dq, ddq, felt)
            found[0] += of_distances(by_distances)
            found[1] += by_tau * (f.viscous + dry * (1.0 - eased**2) / self.friction_speed)
            return np.asarray(found)

        return at_0 + slopes * x[:, columns], pullback

    def least(self, states: Array) -> float:
        """Least distance from any edge, as a share of its size, negative if violated; uses the friction of the robot's file."""
        return float(self.evaluate(states)[0].min(initial=np.inf))

    def _clearances(self, q: Array) -> tuple[Array, Pullback]:
        """Distances of the capsules and those of ``clear`` [m], and their pullback by central differences."""
        own, of_own = self.capsules.evaluate(q, MARGIN + _CLEARANCE_SCALE)
        if self.clear is None:
            return own, of_own

        def pullback(weights: Array) -> Array:
            by_q, user_weights = of_own(weights[:, : own.shape[1]]), weights[:, own.shape[1] :]
            if not user_weights.any():
                return by_q
            for k, step in enumerate(_POSITION_STEP * np.eye(q.shape[1])):
                slope = (self._user_distances(q + step) - self._user_distances(q - step)) / (2.0 * _POSITION_STEP)
                by_q[:, k] += (slope * user_weights).sum(axis=1)
            return by_q

        return np.concatenate([own, self._user_distances(q)], axis=1), pullback

    def _user_distances(self, q: Array) -> Array:
        try:
            distances = np.asarray(self.clear(q) if self.clear else (), float)
        except (TypeError, ValueError) as problem:
            raise ValueRangeError(f"clear could not be evaluated for {len(q)} configurations: {problem}") from None
        if distances.ndim < 1 or len(distances) != len(q) or not np.isfinite(distances).all():
            raise ShapeError(
                f"clear gave an array of shape {distances.shape} for {len(q)} configurations: give a distance [m] for each, "
                "finite, below 0 where something touches."
            )
        return distances.reshape(len(q), -1)


def half_and_middle(bounds: Limits) -> tuple[Array, Array]:
    """Half the range of positions, inf if a limit is missing, and its middle, for joints with both limits."""
    with np.errstate(invalid="ignore"):
        return (bounds.upper - bounds.lower) / 2.0, (bounds.upper + bounds.lower) / 2.0


def shared_bounds(bounds: Limits, share: float) -> Limits:
    """Apply a share to the limits of positions, about their middle, of velocities and of torques.

    The limit of accelerations is the smaller of the limits of acceleration and deceleration.
    """
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    with np.errstate(invalid="ignore"):
        lower = np.where(both, middle - share * half, bounds.lower)
        upper = np.where(both, middle + share * half, bounds.upper)
    either = np.minimum(bounds.acceleration, bounds.deceleration)
    return replace(
        bounds, lower=lower, upper=upper, velocity=share * bounds.velocity, effort=share * bounds.effort,
        acceleration=either, deceleration=either,
    )  # fmt: skip
