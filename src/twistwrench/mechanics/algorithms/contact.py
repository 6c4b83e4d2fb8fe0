"""Velocity step with implicit friction, torque limits and damping, and compliant contact forces.

The velocities v after a step of length h satisfy the following equations; all other terms are evaluated at its beginning:

    (1)  M (v - dq) / h = τ - c - g - V v - φ
    (2)  τ_i = τ0_i - kd_i (v_i - dq_i), clipped to the torque limit
    (3)  φ_i = sign(v_i) F_i if v_i is not 0; otherwise the force that holds the joint, in [-F_i, F_i]

V is viscous friction, F dry friction, and kd the rate gain of a control law whose torque at dq is τ0. g is evaluated at q.
c is evaluated at dq; with friction, at the mean of dq and a first estimate of v. This midpoint makes steps symmetric except
for dissipation, so that energy gain is negligible.

Terms linear in v are added to M. Two discrete choices remain for each joint: it sticks or slides, and its torque is within
the limits or at one of them. A guess of these choices is a pair of numbers for each joint: s is 0 if it sticks and otherwise
sign(v); t is 0 if its torque is within the limits and otherwise the sign of the limit. For a given guess the equations are
linear:

    (4)  K = M + h V + h (1 - t²) kd
    (5)  K v = K dq + h (clipped τ - c - g - V dq) - h φ     rows with s = 0 are replaced by v = 0
    (6)  h φ = s h F if a joint slides, otherwise the residual of (5)

The solution gives the next guess. This is a semismooth Newton method, which has converged when a guess reproduces itself.
A joint that sticks has exactly v = 0.

Sources: Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988, and Stewart and Trinkle, "An implicit
time-stepping scheme for rigid body dynamics with inelastic collisions and Coulomb friction", Int. J. Num. Meth. Eng. 39, 1996,
for friction as an impulse of the step; Qi and Sun, "A nonsmooth version of Newton's method", Math. Prog. 58, 1993.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ...core.typing import Array
from ..lie import so3
from ..model.model import Model
from .forward_dynamics import forward_dynamics
from .friction import dry_friction_indices, friction_bounds, is_zero, signs
from .inverse_dynamics import Wrenches, bias_forces
from .kinematics import forward_kinematics, frame_velocity, wrench_torques
from .mass_matrix import ldl_factors, mass_matrix, solve_ldl, with_diagonal
from .operational_space import clip_torques
from .recursion import zeros

_GUESSES = 4
"""Number of guesses without torque limits on a control law. In steps of falling arms, hands and humanoids, 98 % converge within
two guesses, and all but a few in 10⁵ within four. Without convergence the error lasts one step: a joint is held by more than
its friction, or slides against it."""
_GUESSES_WITH_LIMITS = 6
"""Number of guesses with torque limits on a control law."""
SLIDING_SOFTNESS = 0.01
"""Inertia of a joint that slides the wrong way, as a fraction of M_ii. Guesses may cycle if it exceeds the part of M_ii that
the other joints leave. This small fraction costs one more guess if a joint reverses within a step."""
NO_LIMIT = 1e30
"""Limit that stands for none [N m or N]; finite in float32."""


def velocity_step(
    model: Model, q: Array, dq: Array, h: Any, tau: Array, *,
    gains: Array | None = None, limits: Array | None = None, friction: bool = False,
    push: Array | None = None, wrenches: Wrenches | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Velocities after the step, the torques applied in it, and the friction torques; (nv,) each.

    ``tau`` is the torque of the control law at dq, ``gains`` are kd = -∂τ/∂dq of each joint, ``push`` additional torques.
    """
    if limits is not None and gains is None:  # τ does not depend on v
        tau = clip_torques(tau, limits)
        limits = None
    viscous = model.friction.viscous if friction else zeros(model.nv)
    dry_joints = dry_friction_indices(model) if friction else ()
    if dry_joints or limits is not None:
        return _StepEquations(
            model, q, dq, h, tau, gains, limits, viscous, dry_joints, friction, push, wrenches
        ).solve()
    joint_torques = tau if push is None else tau + push
    added_inertia = None  # K - M of (4), with t = 0
    if gains is not None:
        added_inertia = h * (viscous + gains)
    elif friction:
        added_inertia = h * viscous
    if friction:
        joint_torques = joint_torques - viscous * dq
    v_change = h * forward_dynamics(model, q, dq, joint_torques, wrenches, added_inertia)
    if friction:  # c at the midpoint
        v_change = h * forward_dynamics(model, q, dq + 0.5 * v_change, joint_torques, wrenches, added_inertia)
    v = dq + v_change
    applied_tau = tau if gains is None else tau - gains * v_change  # (2)
    return v, applied_tau, -viscous * v


class _StepEquations:
    """Equations (4) to (6) of a step, for guesses s and t."""

    def __init__(
        self, model: Model, q: Array, dq: Array, h: Any, tau: Array, gains: Array | None, limits: Array | None, viscous: Array,
        dry_joints: Sequence[int], friction: bool, push: Array | None, wrenches: Wrenches | None,
    ) -> None:  # fmt: skip
        n = model.nv
        self.model, self.q, self.dq, self.h = model, q, dq, h
        self.tau, self.wrenches, self.friction = tau, wrenches, friction
        self.viscous, self.dry_joints = viscous, dry_joints
        self.gains = zeros(n) if gains is None else gains
        self.limits = zeros(n)
        self.limited_joints: list[int] = []
        drive_torques = tau
        if limits is not None:
            self.limits = np.array([limit.clip(0.0, NO_LIMIT) for limit in limits], object)
            self.limited_joints = [i for i in range(n) if not is_zero(self.gains[i])]  # others do not depend on v
            drive_torques = clip_torques(tau, limits)
        M = mass_matrix(model, q)
        self.sliding_inertia = SLIDING_SOFTNESS * M.diagonal()
        self.M_viscous = with_diagonal(M, h * viscous)  # M + h V
        self.push = -viscous * dq if push is None else push - viscous * dq  # additional torques - V dq of (5)
        backward_friction, forward_friction = friction_bounds(model, dq, drive_torques)
        self.backward_impulse, self.forward_impulse = h * backward_friction, h * forward_friction

    def solve(self) -> tuple[Array, Array, Array]:
        """v, τ and the friction torques of the last guess; torques are within their limits for any guess."""
        s = zeros(len(self.dq)) + 1.0  # joints without dry friction slide
        t = zeros(len(self.dq))
        directions = signs(self.dq)
        for i in self.dry_joints:
            s[i] = directions[i]  # moving joints slide on, resting joints stick
        self.load = self.push - bias_forces(self.model, self.q, self.dq, self.wrenches)  # - c - g - V dq of (5)
        v, friction_impulse, tau = self._step_for_guess(s, t)
        guess_count = _GUESSES_WITH_LIMITS if self.limited_joints else _GUESSES
        for _ in range(guess_count - 1):
            s = self._next_slips(s, v, friction_impulse)
            t = self._next_limits(t, tau)
            v, friction_impulse, tau = self._step_for_guess(s, t)
        if self.friction:  # c at the midpoint
            self.load = self.push - bias_forces(self.model, self.q, 0.5 * (self.dq + v), self.wrenches)
            v, friction_impulse, tau = self._step_for_guess(s, t)
        if self.limited_joints:
            guessed_tau = self._torques_at_limits(t, tau)
            tau = clip_torques(guessed_tau, self.limits)
            excess_impulse = self.h * (tau - guessed_tau)  # zero if the guess was right
            v = v + self._sliding_velocities(self.M_viscous, s * s, excess_impulse)
        return v, tau, -self.viscous * v - friction_impulse / self.h

    def _step_for_guess(self, s: Array, t: Array) -> tuple[Array, Array, Array]:
        """v, friction impulse, and torque of the control law for a guess.

        x is the change of velocity of joints that slide, and the velocity 0 of joints that stick.
        """
        slides = s * s  # 1 for joints that slide, 0 for joints that stick
        is_within_limit = 1.0 - t * t
        K = with_diagonal(self.M_viscous, self.h * is_within_limit * self.gains)  # (4)
        # K (v - dq) moves the velocities dq of sticking joints to the right side, where they act like an impulse.
        impulse = self.h * (self.load + self._torques_at_limits(t, self.tau)) + K @ ((1.0 - slides) * self.dq)
        dry_impulse = self._dry_impulses(s)
        x = self._sliding_velocities(K, slides, impulse - dry_impulse)
        v = slides * self.dq + x  # (5)
        friction_impulse = dry_impulse + (1.0 - slides) * (impulse - K @ x)  # (6)
        law_torque = self.tau - self.gains * (v - self.dq)  # (2)
        return v, friction_impulse, law_torque

    def _next_slips(self, s: Array, v: Array, friction_impulse: Array) -> Array:
        """Improved guess s: a joint that moves against its friction sticks, a joint whose friction exceeds its bound slides."""
        s = s.copy()
        for i in self.dry_joints:
            x = self.sliding_inertia[i] * v[i] + friction_impulse[i]
            s[i] = (x - x.clip(-self.backward_impulse[i], self.forward_impulse[i])).sign()
        return s

    def _next_limits(self, t: Array, tau: Array) -> Array:
        """Improved guess t: the control law's torque returns within its limit, or exceeds it.

        If a torque was guessed at its limit, its distance from the limit is divided by 1 + r, r = h kd / (softness M_ii): the
        rate gain, which (4) left out for this guess, would reduce the distance.
        """
        t = t.copy()
        for i in self.limited_joints:
            limit = self.limits[i]
            r = self.h * self.gains[i] / self.sliding_inertia[i]
            guessed_limit = t[i] * limit
            x = guessed_limit + (tau[i] - guessed_limit) * (1.0 - t[i] * t[i] * (r / (1.0 + r)))
            t[i] = (x - x.clip(-limit, limit)).sign()
        return t

    def _torques_at_limits(self, t: Array, tau: Array) -> Array:
        """Torques of a guess: the limits of joints that are guessed at their limits, ``tau`` for the others."""
        torques = tau.copy()
        for i in self.limited_joints:
            torques[i] = (1.0 - t[i] * t[i]) * tau[i] + t[i] * self.limits[i]
        return torques

    def _dry_impulses(self, s: Array) -> Array:
        """Impulses of dry friction on sliding joints; 0 for sticking ones."""
        impulses = zeros(len(s))
        for i in self.dry_joints:
            backward, forward = self.backward_impulse[i], self.forward_impulse[i]
            if backward is forward:  # the same symbol in both directions
                impulses[i] = s[i] * forward
            else:  # forward for s = 1, -backward for s = -1, 0 for s = 0
                impulses[i] = 0.5 * s[i] * (s[i] * (forward - backward) + (forward + backward))
        return impulses

    def _sliding_velocities(self, K: Array, slides: Array, impulse: Array) -> Array:
        """Velocities of the sliding joints due to impulses while the others stick; exactly 0 for sticking joints."""
        K_sliding = K.copy()  # without entries that couple sticking joints; only the lower triangle is used
        for i in range(len(K)):
            for j in range(i):
                K_sliding[i, j] = slides[i] * (slides[j] * K[i, j])
        return solve_ldl(*ldl_factors(K_sliding), slides * impulse)


# ── Compliant contact forces, law of Hunt and Crossley: points on a plane, joints at their stops

# A point at a depth d > 0 inside, which penetrates at the rate d', is pushed out with f = k dⁿ max(0, 1 + c d').

_MIN_LENGTH = 1e-300
"""Least length [m] with a finite logarithm, for exponents that are not multiples of 1/2."""


def largest(values: Iterable[Any]) -> Any:
    """Maximum of several symbols."""
    return reduce(lambda a, b: a.clip(b, np.inf), values)


def contact_force(depth: Any, depth_rate: Any, k: Any, n: float, c: Any) -> Any:
    """f = k dⁿ max(0, 1 + c d') of one point; exactly 0 if d ≤ 0."""
    positive_depth = depth.clip(0.0, np.inf)
    if 2 * n == int(2 * n):  # multiples of 1/2 need products and roots only
        power = positive_depth**n
    else:
        power = positive_depth.sign() * depth.clip(_MIN_LENGTH, np.inf) ** n
    return k * power * (1.0 + c * depth_rate).clip(0.0, np.inf)


def plane_contact(
    model: Model, q: Array, dq: Array, frame: str, exponent: float, points: Array, normal: Array, law: Array
) -> tuple[Array, Array]:
    """Torques J'F of a plane's contact forces on points (n, 3) of a frame, (nv,), and the depth of each point, (n,).

    ``law`` is (height, k, c, μ, slip), with the height of the plane along its normal. The friction force on a point with
    tangential velocity v is -μ f v / √(|v|² + slip²).
    """
    height, k, c, mu, slip = law
    T = forward_kinematics(model, q, frame)
    V = frame_velocity(model, q, dq, frame)
    R = T[:3, :3]
    F = zeros(6)
    depths = zeros(len(points))
    for i, p in enumerate(points):
        depths[i] = height - normal @ (R @ p + T[:3, 3])
        v = R @ (V[3:] + so3.cross(V[:3], p))  # velocity of the point, in the base frame
        depth_rate = -(normal @ v)
        f = contact_force(depths[i], depth_rate, k, exponent, c)
        v_tangential = v + depth_rate * normal
        friction_per_velocity = mu * f / (v_tangential @ v_tangential + slip * slip).sqrt()
        force = R.T @ (f * normal - friction_per_velocity * v_tangential)  # force on the point, in the frame
        F = F + np.concatenate([so3.cross(p, force), force])
    return wrench_torques(model, q, F, frame), depths


def stop_contact(
    q: Array, dq: Array, indices: Sequence[tuple[int, int]], exponent: float, lower: Array, upper: Array, law: Array
) -> tuple[Array, Array]:
    """Torques of stops, (nv,), and the depth in the nearer stop of each of m joints, (m,).

    ``indices`` has the index in q and in dq of each joint; ``lower`` and ``upper`` are (m,); ``law`` is (k, c).
    """
    k, c = law
    tau = zeros(len(dq))
    depths = zeros(len(indices))
    for j, (q_index, v_index) in enumerate(indices):
        lower_depth = lower[j] - q[q_index]
        upper_depth = q[q_index] - upper[j]
        lower_force = contact_force(lower_depth, -dq[v_index], k, exponent, c)
        upper_force = contact_force(upper_depth, dq[v_index], k, exponent, c)
        tau[v_index] = lower_force - upper_force
        depths[j] = largest([upper_depth, lower_depth])
    return tau, depths
