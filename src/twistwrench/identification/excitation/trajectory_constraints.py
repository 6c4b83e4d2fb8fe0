"""Constraints on exciting trajectories: limits, the floor, and clearances of the capsules around the links.

Each constraint is low ≤ x ≤ high, with an edge at each finite bound. An edge has a size, such as half the range of a joint;
distances from the edge are shares of this size.
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
"""Function of the user: distances (n, ...) [m] at configurations (n, nq), below 0 in contact."""
_CLEARANCE_SIZE = 0.1
"""Size of the edges of distances [m]."""
MAX_CHECK_STEP = 0.01
"""Maximum step at which clearances are finally checked [s]."""
_POSITION_STEP = 1e-5
"""Step of the finite differences of the user's distances [rad, m]."""


@dataclass(frozen=True, eq=False)
class TrajectoryConstraints:
    """Constraints on the motions of one robot."""

    robot: Robot  # its own friction is part of the torques
    bounds: Limits  # limits of the motion
    friction_speed: Array  # (nv,), Coulomb smoothing speed for the smooth torques
    capsules: CapsuleDistances  # distances from the floor and between links
    clear: Clear | None = None  # the user's distances

    @cached_property
    def _edges(self) -> tuple[int, Array, Array, Array]:
        """Number of upper edges; then for all edges, upper ones first: column of x, share at x = 0 and slope, (e,) each.

        The share of an edge is linear in x: (high - x) / size or (x - low) / size. The columns of x are positions,
        velocities, accelerations, torques and distances.
        """
        bounds = self.bounds
        half_ranges = (bounds.upper - bounds.lower) / 2.0
        neutral_distances, _ = self._clearances(self.robot.neutral[None])
        margins = np.full(neutral_distances.shape[1], MARGIN)
        margins[self.capsules.count :] = 0.0  # the user's distances may reach 0
        margins[: len(self.capsules.margins)] = self.capsules.margins
        symmetric_bounds = np.concatenate([bounds.velocity, bounds.acceleration, bounds.effort])  # on both sides of 0
        high = np.concatenate([bounds.upper, symmetric_bounds, np.full(len(margins), np.inf)])
        low = np.concatenate([bounds.lower, -symmetric_bounds, margins])
        position_sizes = np.where(np.isfinite(half_ranges), half_ranges, 1.0)  # 1 rad or m without two limits
        sizes = np.concatenate([position_sizes, symmetric_bounds, np.full(len(margins), _CLEARANCE_SIZE)])
        upper_columns = np.flatnonzero(np.isfinite(high))
        lower_columns = np.flatnonzero(np.isfinite(low))
        columns = np.concatenate([upper_columns, lower_columns])
        signs = np.repeat([-1.0, 1.0], [len(upper_columns), len(lower_columns)])
        slopes = signs / sizes[columns]
        shares_at_0 = -slopes * np.concatenate([high[upper_columns], low[lower_columns]])
        return len(upper_columns), columns, shares_at_0, slopes

    def evaluate(self, states: Array, *, smooth: bool = False) -> tuple[Array, Pullback]:
        """Distances from all edges as shares of their sizes, negative if violated, and their derivatives.

        Parameters
        ----------
        states : (3, n, nv) array, positions, velocities and accelerations
        smooth : bool, use smooth dry friction at its largest value instead of the file's friction; the pullback always uses it

        Returns
        -------
        shares : (n, e) array
        pullback : function of weights (n, e) that returns the derivatives (3, n, nv) of the weighted sum by the states
        """
        q, dq, ddq = states
        nv = states.shape[2]
        friction = self.robot.model.friction
        # with the file's friction, or without any: then it is added below
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=not smooth))
        smooth_sign = np.tanh(dq / self.friction_speed)
        dry_friction = friction.static + friction.load * np.abs(rigid)
        tau = rigid
        if smooth:
            tau = rigid + friction.viscous * dq + dry_friction * smooth_sign
        distances, distance_pullback = self._clearances(q)
        upper_count, columns, shares_at_0, slopes = self._edges
        x = np.concatenate([q, dq, ddq, tau, distances], axis=1)

        def pullback(weights: Array) -> Array:
            by_x = np.zeros_like(x)
            edge_slopes = weights * slopes
            by_x[:, columns[:upper_count]] = edge_slopes[:, :upper_count]  # each column has one edge of a kind at most
            by_x[:, columns[upper_count:]] += edge_slopes[:, upper_count:]
            by_q, by_dq, by_ddq, by_tau, by_distances = np.split(by_x, [nv, 2 * nv, 3 * nv, 4 * nv], axis=1)
            by_rigid = by_tau * (1.0 + friction.load * np.sign(rigid) * smooth_sign)
            by_states = np.stack([by_q, by_dq, by_ddq]) + self.robot.inverse_dynamics_gradient(q, dq, ddq, by_rigid)
            by_states[0] += distance_pullback(by_distances)
            by_states[1] += by_tau * (friction.viscous + dry_friction * (1.0 - smooth_sign**2) / self.friction_speed)
            return np.asarray(by_states)

        return shares_at_0 + slopes * x[:, columns], pullback

    def least(self, states: Array) -> float:
        """Least distance from any edge, as a share of its size, negative if violated; with the friction of the file."""
        shares, _ = self.evaluate(states)
        return float(shares.min(initial=np.inf))

    def _clearances(self, q: Array) -> tuple[Array, Pullback]:
        """Distances (n, k) [m] of the capsules, then of ``clear``, and the pullback of both; of ``clear`` by differences."""
        capsule_distances, capsule_pullback = self.capsules.evaluate(q, MARGIN + _CLEARANCE_SIZE)
        if self.clear is None:
            return capsule_distances, capsule_pullback
        capsule_count = capsule_distances.shape[1]

        def pullback(weights: Array) -> Array:
            by_q = capsule_pullback(weights[:, :capsule_count])
            user_weights = weights[:, capsule_count:]
            if not user_weights.any():
                return by_q
            for k, step in enumerate(_POSITION_STEP * np.eye(q.shape[1])):
                difference = self._user_distances(q + step) - self._user_distances(q - step)
                slopes = difference / (2.0 * _POSITION_STEP)
                by_q[:, k] += (slopes * user_weights).sum(axis=1)
            return by_q

        return np.concatenate([capsule_distances, self._user_distances(q)], axis=1), pullback

    def _user_distances(self, q: Array) -> Array:
        """Distances (n, k) of the user's function; raises ValueRangeError or ShapeError if they are not usable."""
        try:
            distances = np.asarray(self.clear(q) if self.clear else (), float)
        except (TypeError, ValueError) as problem:
            raise ValueRangeError(f"clear could not be evaluated for {len(q)} configurations: {problem}") from None
        has_row_for_each = distances.ndim >= 1 and len(distances) == len(q)
        if not has_row_for_each or not np.isfinite(distances).all():
            raise ShapeError(
                f"clear gave an array of shape {distances.shape} for {len(q)} configurations: give a distance [m] for each, "
                "finite, below 0 where something touches."
            )
        return distances.reshape(len(q), -1)


def half_and_middle(bounds: Limits) -> tuple[Array, Array]:
    """Half the range of positions (nv,), and its middle (nv,); not finite for joints without both limits."""
    with np.errstate(invalid="ignore"):  # inf - inf
        half = (bounds.upper - bounds.lower) / 2.0
        middle = (bounds.upper + bounds.lower) / 2.0
    return half, middle


def shared_bounds(bounds: Limits, share: float) -> Limits:
    """Limits of positions (about their middle), velocities and torques times a share.

    Acceleration and deceleration both get the smaller of their limits, unchanged.
    """
    half, middle = half_and_middle(bounds)
    has_both = np.isfinite(half)
    with np.errstate(invalid="ignore"):
        lower = np.where(has_both, middle - share * half, bounds.lower)
        upper = np.where(has_both, middle + share * half, bounds.upper)
    acceleration = np.minimum(bounds.acceleration, bounds.deceleration)
    return replace(
        bounds, lower=lower, upper=upper, velocity=share * bounds.velocity, effort=share * bounds.effort,
        acceleration=acceleration, deceleration=acceleration,
    )  # fmt: skip
