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

PATIENCE = 6
"""Number of steps allowed without progress."""
PROGRESS = 0.99
"""Largest residual that counts as progress, relative to the least residual so far."""
FIRST_RESIDUAL = 1e300
"""Residual before the first evaluation."""
_MAX_POSE_ERROR = 2e-7
"""Largest error of a matrix that is certainly a pose; :mod:`..core.arguments` allows at least five times as much."""
_LONGEST_STEP = 1.0
"""Longest step without a posture [rad or m]."""
_LONGEST_POSTURE_STEP = 0.2
"""Longest step of a search that also approaches a posture [rad or m]."""
_CONVERGED_STEP = 1e-7
"""Step length [rad or m] below which the search for a posture has converged."""
_MAX_STEP_RATIO = 0.9
"""Largest length of a step towards a posture, relative to the previous step, at which the divisor of steps stays."""
_DIVISOR_INCREASE = 0.25
"""Increase of the divisor of steps towards a posture after a longer step."""
_SHARE_FOR_LOOPS = 1e-2
"""Part of the poses' damping that is added to the loops' own damping; small, so that the search follows loops."""
_MIN_DAMPING = 1e-13
"""Smallest damping λ, so that the equations can be solved at singular configurations without residual."""
_LIMIT_MARGIN = 1e-12
"""Distance to a limit [rad or m] below which a joint is at the limit."""
_MIN_OUTWARD_STEP = 1e-9
"""Smallest step beyond a limit [rad or m] that counts; smaller ones are rounding errors."""


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """Inverse-kinematics steps of one robot towards poses of frames, or towards some rows of the poses."""

    model: Model
    frames: tuple[tuple[str, tuple[int, ...]], ...]
    """Name and twist rows (0 to 5) of each frame."""
    scale: Array
    """Weight of each row, frame by frame."""
    low: Array
    """(nv,) lower limits [rad or m] of joints of one degree of freedom; -inf for all others."""
    high: Array
    """(nv,) upper limits [rad or m] of joints of one degree of freedom; inf for all others."""
    coordinates: tuple[int, ...]
    """(nv,) index in q of each joint of one degree of freedom; -1 for all others."""
    posture: bool = False
    """True if the search also approaches a posture (nq,), which stands after the poses in ``inputs``."""
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
        """Sizes of the values that :meth:`__call__` passes on: q; status and cost; residual; held joints; idle steps and 1."""
        return self.model.nq, 2, len(self.scale), self.model.nv, 2

    @property
    def begins(self) -> tuple[float, ...]:
        """Values passed to the first step, after its best q, in the order of :attr:`sizes`."""
        residual_and_held = [0.0] * (len(self.scale) + self.model.nv)
        return (0.0, FIRST_RESIDUAL, *residual_and_held, 0.0, 1.0)

    def __call__(self, angles: Array, q: Array, passed: Array, inputs: Array) -> tuple[Array, Array]:
        """Next q, and the values that are passed to the next step, in the order of :attr:`sizes`.

        Passed on: the best q so far; its status (1 if converged, -1 if a T_d is not a pose, else 0) and its |V|; its residual
        twist; the joints held at limits; the number of steps without progress, and 1 while the search continues. With a
        posture, the length of the whole step to it replaces |V|, and the divisor of steps less 1 replaces the number of steps.

        ``angles`` are q for sines and cosines. ``inputs`` are the poses T_d, the posture if there is one, and the squared
        tolerances [rad², m²]. Conditions are numbers 0 and 1, since compiled code has no branches here.
        """
        best_q, status_and_cost, best_e, held, idle_and_continues = np.split(passed, np.cumsum(self.sizes)[:-1])
        best_status, best_cost = status_and_cost
        idle, continues = idle_and_continues
        pose_values = 16 * len(self.frames)
        flat_targets, posture, tolerances = np.split(inputs, [pose_values, len(inputs) - 2])  # the last two: tolerances
        targets = flat_targets.reshape(-1, 4, 4)
        e, displacements = self.residual(angles, targets)  # (1)
        V = self.scale * e
        dq, held_now, any_held = self.step(angles, q, V, posture, 1.0 + idle)
        has_arrived = self.is_within_tolerance(e, displacements, tolerances)
        is_invalid = 1.0 - self.are_poses(targets)
        if self.posture:  # the last step counts as best; steps that do not get shorter are divided by more
            has_arrived = has_arrived * (1.0 - positive(dq @ dq - _CONVERGED_STEP * _CONVERGED_STEP))
            cost = np.sqrt(dq @ dq) * (1.0 + idle)
            is_best = continues
            idle = idle + _DIVISOR_INCREASE * positive(cost - _MAX_STEP_RATIO * best_cost)
        else:
            cost = np.sqrt(V @ V)
            is_best = continues * (has_arrived + (1.0 - has_arrived) * positive(best_cost - cost))
            idle = (idle + 1.0) * (1.0 - positive(PROGRESS * best_cost - cost))
        continues = continues * (1.0 - has_arrived) * (1.0 - is_invalid)
        if not self.posture:
            continues = continues * positive(PATIENCE - idle)
        if self.rounds == 1:
            continues = continues * (1.0 - any_held)
        status = either(is_invalid, -1.0, either(is_best, has_arrived, best_status))
        passed_on = [
            either(is_best, q, best_q),
            np.array([status, either(is_best, cost, best_cost)]),
            either(is_best, e, best_e),
            either(continues, held_now, held),
            np.array([idle, continues]),
        ]
        q_next = kinematics.add_at_angles(self.model, q, continues * dq, angles)
        return self.clip_to_limits(q_next), np.concatenate(passed_on)  # (3)

    def are_poses(self, targets: Array) -> Any:
        """1 if all targets (k, 4, 4) are certainly poses, else 0."""
        all_valid: Any = 1.0
        for T in targets:
            rotation_errors = gaps(T[:3, :3].tolist())
            last_row_errors = T[3] - np.array([0.0, 0.0, 0.0, 1.0])
            errors = np.array([*rotation_errors, *last_row_errors])
            all_valid = all_valid * (1.0 - positive(errors @ errors - _MAX_POSE_ERROR * _MAX_POSE_ERROR))
        return all_valid

    def residual(self, angles: Array, targets: Array) -> tuple[Array, Array]:
        """Requested rows of the body twists V of (1), frame by frame, then the loops' gaps; displacements of the origins.

        If only some rows of a frame are requested, its angular and linear parts are evaluated separately. The displacements are
        the requested linear rows of all frames.
        """
        residuals = []
        displacements = [np.zeros(0)]
        last_row = np.array([[0.0, 0.0, 0.0, 1.0]])
        for (frame, rows), T_d in zip(self.frames, targets, strict=True):
            T = forward_kinematics(self.model, angles, frame)
            difference = se3.inverse(T) @ np.concatenate([T_d[:3], last_row])  # with the exact last row
            linear_rows = [row - 3 for row in rows if row >= 3]
            displacements.append(difference[linear_rows, 3])
            if len(rows) == 6:
                twist, _ = pose_log(difference)
                residuals.append(twist)
            else:
                rotation_vector, _ = rotation_log(difference[:3, :3])
                six_rows = np.concatenate([rotation_vector, difference[:3, 3]])
                residuals.append(six_rows[list(rows)])
        if self.loops is not None:
            residuals.append(-self.loops.gaps(self.model, angles))
        return np.concatenate(residuals), np.concatenate(displacements)

    def is_within_tolerance(self, e: Array, displacements: Array, tolerances: Array) -> Any:
        """1 if the residual is within the squared tolerances [rad², m²], and each gap within its tolerance, else 0."""
        is_angular = np.array([row < 3 for row in self.rows])
        twists, loop_gaps = np.split(e, [len(is_angular)])
        max_squared_angle, max_squared_displacement = tolerances
        errors_and_squares = (
            (twists[is_angular], max_squared_angle),
            (displacements, max_squared_displacement),
            (loop_gaps / np.array(self.gaps), 1.0),
        )
        all_within: Any = 1.0
        for error, max_square in errors_and_squares:
            if len(error):
                all_within = all_within * (1.0 - positive(error @ error - max_square))
        return all_within

    def step(self, angles: Array, q: Array, V: Array, posture: Array, divisor: Any) -> tuple[Array, Array, Any]:
        """dq of (2) or (4), zero at joints held at their limits; a mask (nv,) of these joints; 1 if there are any, else 0.

        The displacement to the posture is divided by ``divisor``.
        """
        blocks = [jacobian(self.model, angles, frame)[list(rows)] for frame, rows in self.frames]
        if self.loops is not None:
            blocks.append(self.loops.jacobian(self.model, angles))
        J = self.scale[:, None] * np.concatenate(blocks)
        damping = self.damping(V)
        limits = self.limit_masks(q)
        z = kinematics.subtract(self.model, posture, q) / divisor if self.posture else None
        dq = _damped_step(J, damping, V, z)
        is_free = 1.0 - _exceeds_limits(dq, *limits)
        any_held = 1.0 - np.prod(is_free)
        for round_number in range(1, self.rounds):
            z_free = None if z is None else z * is_free
            dq_free = _damped_step(J * is_free, damping, V, z_free)
            is_free = is_free * (1.0 - _exceeds_limits(dq_free, *limits))
            if round_number == self.rounds - 1:  # the last round; without held joints the first step stays
                dq = np.array([either(any_held, with_held, x) for with_held, x in zip(dq_free, dq, strict=True)])
        max_length = _LONGEST_POSTURE_STEP if self.posture else _LONGEST_STEP
        shortened_dq = dq * (max_length / largest(dq, max_length))
        return shortened_dq, 1.0 - is_free, any_held

    def damping(self, V: Array) -> Array:
        """Diagonal matrix in place of λ 1 of (2): λ for the rows of poses, a smaller value for the rows of loops."""
        twists, loop_gaps = np.split(V, [len(self.rows)])
        pose_damping = 0.5 * (V @ V)
        loop_damping = 0.5 * (loop_gaps @ loop_gaps) + _SHARE_FOR_LOOPS * pose_damping
        dampings = np.array([pose_damping] * len(twists) + [loop_damping] * len(loop_gaps))
        return np.diag(dampings + _MIN_DAMPING)

    def limit_masks(self, q: Array) -> tuple[Array, Array]:
        """Masks (nv,) of joints at their lower and at their upper limit: 1 at the limit, else 0."""
        at_low = zeros(self.model.nv)
        at_high = zeros(self.model.nv)
        for k, i in enumerate(self.coordinates):
            if np.isfinite(self.low[k]):
                at_low[k] = 1.0 - positive(q[i] - (self.low[k] + _LIMIT_MARGIN))
            if np.isfinite(self.high[k]):
                at_high[k] = 1.0 - positive((self.high[k] - _LIMIT_MARGIN) - q[i])
        return at_low, at_high

    def clip_to_limits(self, q: Array) -> Array:
        """q with the joints of one degree of freedom clipped to their limits."""
        clipped = q.copy()
        for k, i in enumerate(self.coordinates):
            if np.isfinite(self.low[k]) or np.isfinite(self.high[k]):
                clipped[i] = clipped[i].clip(self.low[k], self.high[k])
        return clipped


def _damped_step(F: Array, damping: Array, V: Array, z: Array | None) -> Array:
    """dq of (2), or of (4) if a displacement z to a posture is given. ``damping`` is the matrix λ 1."""
    factors = ldl_factors(F @ F.T + damping)
    if z is None:
        return np.asarray(F.T @ solve_ldl(*factors, V))  # (2)
    return np.asarray(z + F.T @ solve_ldl(*factors, V - F @ z))  # (4)


def _exceeds_limits(dq: Array, at_low: Array, at_high: Array) -> Array:
    """Mask (nv,) of joints at a limit that the step dq would exceed: 1 or 0."""
    exceeds = []
    for is_low, is_high, x in zip(at_low, at_high, dq, strict=True):
        exceeds.append(is_low * positive(-x - _MIN_OUTWARD_STEP) + is_high * positive(x - _MIN_OUTWARD_STEP))
    return np.array(exceeds)
