"""Damped Newton step of inverse kinematics without branches, for batches in compiled code.

    (1)  T(q) exp([V]) = T_d                                MR section 6.2.2
    (2)  dq = F' (F F' + λ 1)⁻¹ V,   λ = |V|²/2             Sugihara, IEEE T-RO 27(5), 2011
    (3)  q ← q ⊕ dq, clipped to the limits
    (4)  dq = z + F' (F F' + λ 1)⁻¹ (V - F z)               Siciliano et al., Robotics (2009), eq. 3.54

(4) replaces (2) if a posture is given: z is the displacement to it, which is followed as far as the poses allow.

V is scaled so that a metre weighs as much as the displacement of the frame by a radian. F are the equally scaled Jacobian
columns of the joints that are not held at a limit. A configuration that has converged, or stopped improving, is not moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import gaps
from ...core.typing import Array
from ..lie import se3
from ..lie.se3 import pose_log, rotation_log
from ..model.model import Model
from . import kinematics
from .friction import either, largest, positive
from .kinematics import forward_kinematics, jacobian
from .mass_matrix import ldl_factors, solve_ldl
from .recursion import zeros

if TYPE_CHECKING:
    from .loop_closure import LoopRows

PATIENCE, PROGRESS = 6, 0.99
"""Number of steps allowed without progress, and the factor on the least residual that counts as progress."""
FIRST_RESIDUAL = 1e300
"""Residual before the first evaluation."""
_MAX_POSE_ERROR = 2e-7
"""Largest error of a matrix that is certainly a pose; :mod:`..core.arguments` allows at least five times as much."""
_LONGEST_POSTURE_STEP, _CONVERGED_STEP = 0.2, 1e-7
"""Longest step towards a posture, and the step length below which the search has converged [rad or m]."""
_HESITATION, _MAX_STEP_RATIO = 0.25, 0.9
"""Increase of the divisor of steps towards a posture, after a step longer than this fraction of the previous one."""
_SHARE_FOR_LOOPS = 1e-2
"""Part of the poses' damping that is added to the loops' own damping; small, so that the search follows loops."""
_LIMIT_MARGIN, _MIN_OUTWARD_STEP, _LONGEST_STEP, _MIN_DAMPING = 1e-12, 1e-9, 1.0, 1e-13


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """Inverse-kinematics steps of one robot towards poses of frames, or towards some rows of the poses."""

    model: Model
    frames: tuple[tuple[str, tuple[int, ...]], ...]
    """Name and twist rows (0 to 5) of each frame."""
    scale: Array
    """Weight of each row, frame by frame."""
    low: Array
    """(nv,) lower limits of joints of one degree of freedom; -inf for all others."""
    high: Array
    """(nv,) upper limits, inf for all others."""
    coordinates: tuple[int, ...]
    """(nv,) coordinate of each such joint; -1 for all others."""
    posture: bool = False
    """True if the search also approaches a posture as far as the poses allow; the posture follows the poses in ``inputs``."""
    loops: LoopRows | None = None
    """Rows of closed loops that have to close at the poses."""
    gaps: tuple[float, ...] = ()
    """Tolerance of each gap, rad or m."""
    rounds: int = 3
    """Rounds that determine the joints at their limits; with 1, the search stops when a joint reaches a limit."""

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows of the twists of all frames."""
        return tuple(row for _, rows in self.frames for row in rows)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of the values that :meth:`__call__` passes on with the next q."""
        return self.model.nq, 2, len(self.scale), self.model.nv, 2

    @property
    def begins(self) -> tuple[float, ...]:
        """Values passed to the first step, after q."""
        return (0.0, FIRST_RESIDUAL, *[0.0] * (len(self.scale) + self.model.nv), 0.0, 1.0)

    def __call__(self, angles: Array, q: Array, passed: Array, inputs: Array) -> tuple[Array, Array]:
        """Next q, and the values passed to the next step, of :attr:`sizes`.

        Passed on: the best q so far; its status (1 converged, -1 if a T_d is not a pose) and its |V|; its residual twist; the
        joints held at limits; the number of steps without progress, and 1 while the search continues. ``angles`` are q for
        sines and cosines. ``inputs``: the poses T_d, the posture if there is one, and the squared tolerances [rad², m²].
        """
        best_q, (best_status, best_cost), best_e, held, (idle, runs) = np.split(passed, np.cumsum(self.sizes)[:-1])
        poses = 16 * len(self.frames)
        targets, posture, tolerances = np.split(inputs, [poses, len(inputs) - 2])
        targets = targets.reshape(-1, 4, 4)
        e, displacements = self.residual(angles, targets)  # (1)
        V = self.scale * e
        dq, held_now, any_held = self.step(angles, q, V, posture, 1.0 + idle)
        arrived = self.is_within_tolerance(e, displacements, tolerances)
        invalid = 1.0 - self.are_poses(targets)
        cost = np.sqrt(V @ V)
        if self.posture:  # the last step counts as best; steps that do not get shorter are divided by more
            arrived = arrived * (1.0 - positive(dq @ dq - _CONVERGED_STEP * _CONVERGED_STEP))
            cost = np.sqrt(dq @ dq) * (1.0 + idle)
            nearer, idle = runs, idle + _HESITATION * positive(cost - _MAX_STEP_RATIO * best_cost)
        else:
            nearer = runs * (arrived + (1.0 - arrived) * positive(best_cost - cost))
            idle = (idle + 1.0) * (1.0 - positive(PROGRESS * best_cost - cost))
        runs = runs * (1.0 - arrived) * (1.0 - invalid)
        if not self.posture:
            runs = runs * positive(PATIENCE - idle)
        if self.rounds == 1:
            runs = runs * (1.0 - any_held)
        status = either(invalid, -1.0, either(nearer, arrived, best_status))
        passed_on = [
            either(nearer, q, best_q),
            np.array([status, either(nearer, cost, best_cost)]),
            either(nearer, e, best_e),
            either(runs, held_now, held),
            np.array([idle, runs]),
        ]
        q_next = kinematics.add_at_angles(self.model, q, runs * dq, angles)
        return self.clip_to_limits(q_next), np.concatenate(passed_on)  # (3)

    def are_poses(self, targets: Array) -> Any:
        """1 if all targets (k, 4, 4) are certainly poses."""
        valid: Any = 1.0
        for M in targets:
            deviations = np.array([*gaps(M[:3, :3].tolist()), *(M[3] - np.array([0.0, 0.0, 0.0, 1.0]))])
            valid = valid * (1.0 - positive(deviations @ deviations - _MAX_POSE_ERROR * _MAX_POSE_ERROR))
        return valid

    def residual(self, angles: Array, targets: Array) -> tuple[Array, Array]:
        """Body twists V of (1), frame by frame, then the loops' gaps; and the displacements of the origins, requested rows.

        If only some rows of a frame are requested, its angular and linear parts are evaluated separately.
        """
        parts, displacements = [], [np.zeros(0)]
        for (frame, rows), T_d in zip(self.frames, targets, strict=True):
            T, last_row = forward_kinematics(self.model, angles, frame), np.array([[0.0, 0.0, 0.0, 1.0]])
            difference = se3.inverse(T) @ np.concatenate([T_d[:3], last_row])
            displacements.append(difference[[row - 3 for row in rows if row >= 3], 3])
            if len(rows) == 6:
                parts.append(pose_log(difference)[0])
            else:
                turn = rotation_log(difference[:3, :3])[0]
                parts.append(np.concatenate([turn, difference[:3, 3]])[list(rows)])
        if self.loops is not None:
            parts.append(-self.loops.gaps(self.model, angles))
        return np.concatenate(parts), np.concatenate(displacements)

    def is_within_tolerance(self, e: Array, displacements: Array, tolerances: Array) -> Any:
        """1 if the residual is within the tolerance."""
        is_angular = np.array([row < 3 for row in self.rows])
        twists, gaps = np.split(e, [len(is_angular)])
        angle_bound, displacement_bound = tolerances
        within: Any = 1.0
        for part, bound in (
            (twists[is_angular], angle_bound),
            (displacements, displacement_bound),
            (gaps / np.array(self.gaps), 1.0),
        ):
            if len(part):
                within = within * (1.0 - positive(part @ part - bound))
        return within

    def step(self, angles: Array, q: Array, V: Array, posture: Array, slower: Any) -> tuple[Array, Array, Any]:
        """dq of (2) or (4), without joints that their limits hold; which joints these are; 1 if there are any."""
        blocks = [jacobian(self.model, angles, frame)[list(rows)] for frame, rows in self.frames]
        if self.loops is not None:
            blocks.append(self.loops.jacobian(self.model, angles))
        J = self.scale[:, None] * np.concatenate(blocks)
        damping = self.damping(V)
        limits = self.limit_masks(q)
        z = kinematics.subtract(self.model, posture, q) / slower if self.posture else None
        dq = _damped_step(J, damping, V, z)
        free = 1.0 - _leaving(dq, *limits)
        any_held = 1.0 - np.prod(free)
        for number in range(1, self.rounds):
            dq_free = _damped_step(J * free, damping, V, None if z is None else z * free)
            free = free * (1.0 - _leaving(dq_free, *limits))
            if number == self.rounds - 1:
                dq = np.array([either(any_held, a, b) for a, b in zip(dq_free, dq, strict=True)])
        longest = _LONGEST_POSTURE_STEP if self.posture else _LONGEST_STEP
        return dq * (longest / largest(dq, longest)), 1.0 - free, any_held

    def damping(self, V: Array) -> Array:
        """λ 1 of (2), with a damping of their own for the rows of loops."""
        poses, gaps = np.split(V, [len(self.rows)])
        of_poses = 0.5 * (V @ V)
        of_gaps = 0.5 * (gaps @ gaps) + _SHARE_FOR_LOOPS * of_poses
        return np.diag(np.array([of_poses] * len(poses) + [of_gaps] * len(gaps)) + _MIN_DAMPING)

    def limit_masks(self, q: Array) -> tuple[Array, Array]:
        """1 for each joint at its lower limit, and 1 for each joint at its upper limit."""
        low, high = zeros(self.model.nv), zeros(self.model.nv)
        for k, i in enumerate(self.coordinates):
            if np.isfinite(self.low[k]):
                low[k] = 1.0 - positive(q[i] - (self.low[k] + _LIMIT_MARGIN))
            if np.isfinite(self.high[k]):
                high[k] = 1.0 - positive((self.high[k] - _LIMIT_MARGIN) - q[i])
        return low, high

    def clip_to_limits(self, q: Array) -> Array:
        """q with the joints of one degree of freedom clipped to their limits."""
        clipped = q.copy()
        for k, i in enumerate(self.coordinates):
            if np.isfinite(self.low[k]) or np.isfinite(self.high[k]):
                clipped[i] = clipped[i].clip(self.low[k], self.high[k])
        return clipped


def _damped_step(F: Array, damping: Array, V: Array, z: Array | None) -> Array:
    """dq of (2), or of (4)."""
    factors = ldl_factors(F @ F.T + damping)
    if z is None:
        return np.asarray(F.T @ solve_ldl(*factors, V))  # (2)
    return np.asarray(z + F.T @ solve_ldl(*factors, V - F @ z))  # (4)


def _leaving(dq: Array, low: Array, high: Array) -> Array:
    """1 for each joint at a limit that the step would exceed."""
    outward = []
    for a, b, x in zip(low, high, dq, strict=True):
        outward.append(a * positive(-x - _MIN_OUTWARD_STEP) + b * positive(x - _MIN_OUTWARD_STEP))
    return np.array(outward)
