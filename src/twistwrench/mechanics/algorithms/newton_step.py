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
from .mass_matrix import factored, solved
from .recursion import zeros

if TYPE_CHECKING:
    from .loop_closure import LoopRows

PATIENCE, NEARER = 6, 0.99
"""Number of steps allowed without progress, and the factor on the least residual that counts as progress."""
FAR = 1e300
"""Residual before the first evaluation."""
_POSE = 2e-7
"""Largest error of a matrix that is certainly a pose; :mod:`..core.arguments` allows at least five times as much."""
_LONGEST_WAY, _STILL = 0.2, 1e-7
"""Longest step towards a posture, and the step length below which the search has converged [rad or m]."""
_HESITATION, _SHORTER = 0.25, 0.9
"""Increase of the divisor of steps towards a posture, after a step longer than this fraction of the previous one."""
_STIFFER = 1e-2
"""Part of the poses' damping that is added to the loops' own damping; small, so that the search follows loops."""
_AT_LIMIT, _PUSHES, _LONGEST_STEP, _LEAST_DAMPING = 1e-12, 1e-9, 1.0, 1e-13


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
    """True if the search also approaches a posture as far as the poses allow; the posture follows the poses in ``given``."""
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
        return (0.0, FAR, *[0.0] * (len(self.scale) + self.model.nv), 0.0, 1.0)

    def __call__(self, angles: Array, q: Array, passed: Array, given: Array) -> tuple[Array, Array]:
        """Next q, and the values passed to the next step, of :attr:`sizes`.

        Passed on: the best q so far; its status (1 converged, -1 if a T_d is not a pose) and its |V|; its residual twist; the
        held joints; the number of steps without progress, and 1 while the search continues. ``angles`` are q for sines and
        cosines. ``given``: the poses T_d, the posture if there is one, and the squared tolerances [rad², m²].
        """
        best, (arrived, cost), least, held, (idle, runs) = np.split(passed, np.cumsum(self.sizes)[:-1])
        poses = 16 * len(self.frames)
        targets, wanted, allowed = np.split(given, [poses, len(given) - 2])
        e, ways = self.left(angles, targets.reshape(-1, 4, 4))  # (1)
        V = self.scale * e
        dq, held_now, some = self.step(angles, q, V, wanted, 1.0 + idle)
        there = self.there(e, ways, allowed)
        odd = 1.0 - self.are_poses(targets.reshape(-1, 4, 4))
        now = np.sqrt(V @ V)
        if self.posture:  # the last step counts as best; steps that do not get shorter are divided by more
            there = there * (1.0 - positive(dq @ dq - _STILL * _STILL))
            now = np.sqrt(dq @ dq) * (1.0 + idle)
            nearer, idle = runs, idle + _HESITATION * positive(now - _SHORTER * cost)
        else:
            nearer = runs * (there + (1.0 - there) * positive(cost - now))
            idle = (idle + 1.0) * (1.0 - positive(NEARER * cost - now))
        goes = runs * (1.0 - there) * (1.0 - odd)
        if not self.posture:
            goes = goes * positive(PATIENCE - idle)
        if self.rounds == 1:
            goes = goes * (1.0 - some)
        said = np.array([either(odd, -1.0, either(nearer, there, arrived)), either(nearer, now, cost)])
        parts = either(nearer, q, best), said, either(nearer, e, least), either(goes, held_now, held)
        moved = kinematics.moved(self.model, q, goes * dq, angles)
        return self.inside(moved), np.concatenate([*parts, np.array([idle, goes])])  # (3)

    def are_poses(self, targets: Array) -> Any:
        """1 if all targets (k, 4, 4) are certainly poses."""
        fine: Any = 1.0
        for M in targets:
            off = np.array([*gaps(M[:3, :3].tolist()), *(M[3] - np.array([0.0, 0.0, 0.0, 1.0]))])
            fine = fine * (1.0 - positive(off @ off - _POSE * _POSE))
        return fine

    def left(self, angles: Array, targets: Array) -> tuple[Array, Array]:
        """Body twists V of (1), frame by frame, then the loops' gaps; and the displacements of the origins, requested rows.

        If only some rows of a frame are requested, its angular and linear parts are evaluated separately.
        """
        parts, ways = [], [np.zeros(0)]
        for (frame, rows), T_d in zip(self.frames, targets, strict=True):
            T, last = forward_kinematics(self.model, angles, frame), np.array([[0.0, 0.0, 0.0, 1.0]])
            between = se3.inverse(T) @ np.concatenate([T_d[:3], last])
            ways.append(between[[row - 3 for row in rows if row >= 3], 3])
            if len(rows) == 6:
                parts.append(pose_log(between)[0])
            else:
                parts.append(np.concatenate([rotation_log(between[:3, :3])[0], between[:3, 3]])[list(rows)])
        if self.loops is not None:
            parts.append(-self.loops.gaps(self.model, angles))
        return np.concatenate(parts), np.concatenate(ways)

    def there(self, e: Array, ways: Array, allowed: Array) -> Any:
        """1 if the residual is within the tolerance."""
        turns = np.array([row < 3 for row in self.rows])
        fine: Any = 1.0
        poses, open_by = np.split(e, [len(turns)])
        gaps = open_by / np.array(self.gaps)
        for part, most in ((poses[turns], allowed[0]), (ways, allowed[1]), (gaps, 1.0)):
            if len(part):
                fine = fine * (1.0 - positive(part @ part - most))
        return fine

    def step(self, angles: Array, q: Array, V: Array, wanted: Array, slower: Any) -> tuple[Array, Array, Any]:
        """dq of (2) or (4), without joints that their limits hold; which joints these are; 1 if there are any."""
        each = [jacobian(self.model, angles, frame)[list(rows)] for frame, rows in self.frames]
        each += [self.loops.jacobian(self.model, angles)] if self.loops is not None else []
        J = self.scale[:, None] * np.concatenate(each)
        poses, gaps = np.split(V, [len(self.rows)])
        most = 0.5 * (V @ V)
        each = [most] * len(poses) + [0.5 * (gaps @ gaps) + _STIFFER * most] * len(gaps)
        damping = np.diag(np.array(each) + _LEAST_DAMPING)
        bounds = self.at_limits(q)
        z = kinematics.subtract(self.model, wanted, q) / slower if self.posture else None
        dq = _damped(J, damping, V, z)
        out = _leaving(dq, *bounds)
        free, some = 1.0 - out, 1.0 - np.prod(1.0 - out)
        for number in range(1, self.rounds):
            rest = _damped(J * free, damping, V, None if z is None else z * free)
            free = free * (1.0 - _leaving(rest, *bounds))
            if number == self.rounds - 1:
                dq = np.array([either(some, a, b) for a, b in zip(rest, dq, strict=True)])
        longest = _LONGEST_WAY if self.posture else _LONGEST_STEP
        return dq * (longest / largest(dq, longest)), 1.0 - free, some

    def at_limits(self, q: Array) -> tuple[Array, Array]:
        """1 for each joint at its lower limit, and 1 for each joint at its upper limit."""
        low, high = zeros(self.model.nv), zeros(self.model.nv)
        for k, i in enumerate(self.coordinates):
            if np.isfinite(self.low[k]):
                low[k] = 1.0 - positive(q[i] - (self.low[k] + _AT_LIMIT))
            if np.isfinite(self.high[k]):
                high[k] = 1.0 - positive((self.high[k] - _AT_LIMIT) - q[i])
        return low, high

    def inside(self, q: Array) -> Array:
        """q with the joints of one degree of freedom clipped to their limits."""
        found = q.copy()
        for k, i in enumerate(self.coordinates):
            if np.isfinite(self.low[k]) or np.isfinite(self.high[k]):
                found[i] = found[i].clip(self.low[k], self.high[k])
        return found


def _damped(F: Array, damping: Array, V: Array, z: Array | None) -> Array:
    """dq of (2), or of (4)."""
    factors = factored(F @ F.T + damping)
    if z is None:
        return np.asarray(F.T @ solved(*factors, V))  # (2)
    return np.asarray(z + F.T @ solved(*factors, V - F @ z))  # (4)


def _leaving(dq: Array, low: Array, high: Array) -> Array:
    """1 for each joint at a limit that the step would exceed."""
    each = zip(low, high, dq, strict=True)
    return np.array([a * positive(-x - _PUSHES) + b * positive(x - _PUSHES) for a, b, x in each])
