"""Velocity step with implicit friction, torque limits and damping, and compliant contact forces.

For the velocities v after a step of length h, with what else acts known at its beginning:

    (1)  M (v - dq) / h = τ - c - g - V v - φ
    (2)  τ_i = τ0_i - kd_i (v_i - dq_i), or the limit that this is beyond
    (3)  φ_i = sign(v_i) F_i where v_i is not 0, and there what holds the joint, in [-F_i, F_i]

V is viscous friction, F dry friction, kd the gain of the rates in a law of ours whose torque at dq is τ0. g is that at q, and c
that at the velocities dq, or with friction at the mean of dq and a first v: taken halfway along a step, steps are then
symmetric but for what brakes, and gain no energy to speak of.

What is linear in v is added to M. Two cases a joint remain: it sticks or slides, and its torque is within the limits or at one.
A guess at the case is two numbers, s, which is 0 for a joint that sticks and else sign(v), and t, which is 0 within the limits
and else the sign of the limit. With a guess the equations are linear:

    (4)  K = M + h V + h (1 - t²) kd
    (5)  K v = K dq + h (τ used - c - g - V dq) - h φ        rows with s = 0 mean v = 0
    (6)  h φ = s h F where a joint slides, else what is left of (5)

The next guess follows from its solution: a semismooth Newton method, which ends where a guess confirms itself. A joint that
sticks has v = 0 exactly.

Sources: Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988, and Stewart and Trinkle, "An implicit
time-stepping scheme for rigid body dynamics with inelastic collisions and Coulomb friction", Int. J. Num. Meth. Eng. 39, 1996,
for friction as an impulse of the step; Qi and Sun, "A nonsmooth version of Newton's method", Math. Prog. 58, 1993.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from ..lie import so3
from ..model.model import Model
from ..typing import Array
from .forward_dynamics import forward_dynamics
from .friction import friction_bounds, is_zero, rubbing, signs
from .inverse_dynamics import Wrenches, bias_forces
from .kinematics import forward_kinematics, frame_velocity, wrench_torques
from .mass_matrix import factored, mass_matrix, solved, widened
from .operational_space import clipped
from .recursion import zeros

ROUNDS, WITH_LIMITS = 4, 6
"""Guesses, and guesses where torques of a law may be at their limits. Of the steps of falling arms, hands and humanoids, 98 in
100 are right at the first or second, all but some in 10⁵ by the fourth. One that is not right in the end errs for one step: a
joint is held with more than its friction, or slides against it."""
SOFT = 0.01
"""Inertia of a joint that slides the wrong way, as a share of M_ii. With more than the others leave of M_ii, guesses may cycle;
this small share costs one more guess where a joint turns back within a step."""
LARGEST = 1e30
"""Stands for no limit [N m or N]; finite in float32."""


def velocity_step(
    model: Model, q: Array, dq: Array, h: Any, tau: Array, *,
    gains: Array | None = None, limits: Array | None = None, friction: bool = False,
    push: Array | None = None, wrenches: Wrenches | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Velocities after the step, the torques applied in it, and those of friction; (nv,) each.

    ``tau`` is the torque of the law at dq, ``gains`` its -∂τ/∂dq joint by joint, ``push`` what else acts on the joints.
    """
    if limits is not None and gains is None:
        tau, limits = clipped(tau, limits), None
    viscous = model.friction.viscous if friction else zeros(model.nv)
    dry = rubbing(model) if friction else ()
    if dry or limits is not None:
        return _Corners(model, q, dq, h, tau, gains, limits, viscous, dry, friction, push, wrenches).solved()
    force = tau if push is None else tau + push
    brakes = h * viscous if gains is None else h * (viscous + gains)
    if friction:
        force = force - viscous * dq
    added = brakes if friction or gains is not None else None
    change = h * forward_dynamics(model, q, dq, force, wrenches, added)
    if friction:
        change = h * forward_dynamics(model, q, dq + 0.5 * change, force, wrenches, added)
    v = dq + change
    return v, tau if gains is None else tau - gains * change, -viscous * v


class _Corners:
    """Equations (4) to (6) of a step, and the guesses s and t."""

    def __init__(
        self, model: Model, q: Array, dq: Array, h: Any, tau: Array, gains: Array | None, limits: Array | None, viscous: Array,
        dry: Sequence[int], friction: bool, push: Array | None, wrenches: Wrenches | None,
    ) -> None:  # fmt: skip
        n = model.nv
        self.dq, self.h, self.tau, self.viscous, self.dry = dq, h, tau, viscous, dry
        self.gains = zeros(n) if gains is None else gains
        self.limits, self.limited, held = zeros(n), [], tau
        if limits is not None:
            self.limits = np.array([L.clip(0.0, LARGEST) for L in limits], object)
            self.limited, held = [i for i in range(n) if not is_zero(self.gains[i])], clipped(tau, limits)
        M = mass_matrix(model, q)
        self.soft, self.A = SOFT * M.diagonal(), widened(M, h * viscous)
        self.model, self.q, self.wrenches = model, q, wrenches
        self.known = -viscous * dq if push is None else push - viscous * dq
        self.friction = friction
        back, forth = friction_bounds(model, dq, held)
        self.back, self.forth = h * back, h * forth

    def solved(self) -> tuple[Array, Array, Array]:
        """v, τ and the torques of friction, by the last guess; torques are within their limits for any guess."""
        s, t = zeros(len(self.dq)) + 1.0, zeros(len(self.dq))
        moving = signs(self.dq)
        for i in self.dry:
            s[i] = moving[i]  # what slides goes on, what rests stays
        self.rest = self.known - bias_forces(self.model, self.q, self.dq, self.wrenches)
        v, taken, tau = self._by(s, t)
        for _ in range((WITH_LIMITS if self.limited else ROUNDS) - 1):
            s, t = self._sliding(s, v, taken), self._at_limits(t, tau)
            v, taken, tau = self._by(s, t)
        if self.friction:
            self.rest = self.known - bias_forces(self.model, self.q, 0.5 * (self.dq + v), self.wrenches)
            v, taken, tau = self._by(s, t)
        if self.limited:
            used = self._used(t, tau)
            tau = clipped(used, self.limits)
            v = v + self._answer(self.A, s * s, self.h * (tau - used))  # nothing, where the guess was right
        return v, tau, -self.viscous * v - taken / self.h

    def _by(self, s: Array, t: Array) -> tuple[Array, Array, Array]:
        """v, the impulse that friction takes, and the torque of the law, with a guess."""
        slides, within = s * s, 1.0 - t * t
        K = widened(self.A, self.h * within * self.gains)  # (4)
        impulse = self.h * (self.rest + self._used(t, self.tau)) + K @ ((1.0 - slides) * self.dq)
        dry = self._dry(s)
        x = self._answer(K, slides, impulse - dry)
        v = slides * self.dq + x  # (5)
        taken = dry + (1.0 - slides) * (impulse - K @ x)  # (6)
        return v, taken, self.tau - self.gains * (v - self.dq)  # (2)

    def _sliding(self, s: Array, v: Array, taken: Array) -> Array:
        """Better guess at the sliding joints: a joint against its friction sticks, one beyond its friction slides."""
        s = s.copy()
        for i in self.dry:
            x = self.soft[i] * v[i] + taken[i]
            s[i] = (x - x.clip(-self.back[i], self.forth[i])).sign()
        return s

    def _at_limits(self, t: Array, tau: Array) -> Array:
        """Better guess at the torques at their limits: the torque of the law returns within its limit, or exceeds it."""
        t = t.copy()
        for i in self.limited:
            L, stiff = self.limits[i], self.h * self.gains[i] / self.soft[i]
            at = t[i] * L
            x = at + (tau[i] - at) * (1.0 - t[i] * t[i] * (stiff / (1.0 + stiff)))
            t[i] = (x - x.clip(-L, L)).sign()
        return t

    def _used(self, t: Array, tau: Array) -> Array:
        """Torques, or their limits where the guess has them at the limit."""
        used = tau.copy()
        for i in self.limited:
            used[i] = (1.0 - t[i] * t[i]) * tau[i] + t[i] * self.limits[i]
        return used

    def _dry(self, s: Array) -> Array:
        """Impulses of dry friction on sliding joints; 0 for sticking ones."""
        found = zeros(len(s))
        for i in self.dry:
            back, forth = self.back[i], self.forth[i]
            found[i] = s[i] * forth if back is forth else 0.5 * s[i] * (s[i] * (forth - back) + (forth + back))
        return found

    def _answer(self, K: Array, slides: Array, impulse: Array) -> Array:
        """Velocities of the sliding joints due to impulses, while the others hold; exactly 0 for these."""
        lower = K.copy()
        for i in range(len(K)):
            for j in range(i):
                lower[i, j] = slides[i] * (slides[j] * K[i, j])
        return solved(*factored(lower), slides * impulse)


# ── Compliant contact forces, law of Hunt and Crossley: points on a plane, joints at their stops

# Where a point is a depth d > 0 inside, and sinks in at the rate d', it is pushed out with f = k dⁿ max(0, 1 + c d').

_LEAST = 1e-300
"""Least length [m] with a logarithm, for powers other than halves."""


def largest(values: Iterable[Any]) -> Any:
    """The largest of some symbols."""
    return reduce(lambda a, b: a.clip(b, np.inf), values)


def pushed(depth: Any, sinking: Any, k: Any, n: float, c: Any) -> Any:
    """f = k dⁿ max(0, 1 + c d'), of one point; exactly 0 where d is not above 0."""
    inside = depth.clip(0.0, np.inf)
    power = inside**n if 2 * n == int(2 * n) else inside.sign() * depth.clip(_LEAST, np.inf) ** n
    return k * power * (1.0 + c * sinking).clip(0.0, np.inf)


def plane_contact(
    model: Model, q: Array, dq: Array, frame: str, exponent: float, points: Array, normal: Array, law: Array
) -> tuple[Array, Array]:
    """Torques J'F of a plane on points (n, 3) of a frame, (nv,), and the depth of each point, (n,).

    ``law`` is (height, k, c, μ, slip): along the plane a point at v is held back by μ f v / √(|v|² + slip²).
    """
    height, k, c, mu, slip = law
    T, V = forward_kinematics(model, q, frame), frame_velocity(model, q, dq, frame)
    R, n = T[:3, :3], normal
    F, depths = zeros(6), zeros(len(points))
    for i, p in enumerate(points):
        depths[i] = height - n @ (R @ p + T[:3, 3])
        v = R @ (V[3:] + so3.cross(V[:3], p))  # of the point, in the base frame
        sinking = -(n @ v)
        f = pushed(depths[i], sinking, k, exponent, c)
        slide = v + sinking * n
        held = mu * f / (slide @ slide + slip * slip).sqrt()
        force = R.T @ (f * n - held * slide)  # on the point, in the frame
        F = F + np.concatenate([so3.cross(p, force), force])
    return wrench_torques(model, q, F, frame), depths


def stop_contact(
    q: Array, dq: Array, places: Sequence[tuple[int, int]], exponent: float, lower: Array, upper: Array, law: Array
) -> tuple[Array, Array]:
    """Torques of stops on joints at ``places`` in q and in dq, (nv,), and the excess over the nearer stop, (m,).

    ``law`` is (k, c).
    """
    (k, c), tau, depths = law, zeros(len(dq)), zeros(len(places))
    for j, (i, v) in enumerate(places):
        over, under = q[i] - upper[j], lower[j] - q[i]
        tau[v] = pushed(under, -dq[v], k, exponent, c) - pushed(over, dq[v], k, exponent, c)
        depths[j] = largest([over, under])
    return tau, depths
