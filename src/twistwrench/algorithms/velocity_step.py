"""One step of the velocities, with all that brakes it taken at the end of the step, where it can only brake.

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
    (5)  K v = K dq + h (τ used - c - g - V dq) - h φ        rows with s = 0 say v = 0
    (6)  h φ = s h F where a joint slides, else what is left of (5)

The next guess follows from its solution: a semismooth Newton method, which ends where a guess confirms itself. A joint that
sticks has v = 0 exactly.

Sources: Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988, and Stewart and Trinkle, "An implicit
time-stepping scheme for rigid body dynamics with inelastic collisions and Coulomb friction", Int. J. Num. Meth. Eng. 39, 1996,
for friction as an impulse of the step; Qi and Sun, "A nonsmooth version of Newton's method", Math. Prog. 58, 1993.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..model.model import Model
from ..typing import Array
from .control_laws import clipped
from .forward_dynamics import forward_dynamics
from .friction import friction_bounds, is_zero, rubbing, signs
from .inverse_dynamics import Wrenches, bias_forces
from .mass_matrix import mass_matrix
from .recursion import zeros
from .tree_factorisation import factored, solved, widened

ROUNDS, WITH_LIMITS = 4, 6
"""Guesses, and guesses where torques of a law may be at their limits. Of the steps of falling arms, hands and humanoids, 98 in
100 are right at the first or second, all but some in 10⁵ by the fourth. One that is not right in the end errs for one step: a
joint is held with more than its friction, or slides against it."""
SOFT = 0.01
"""Of M_ii: the inertia with which a joint that slides the wrong way is judged. Less than what the others leave of M_ii, or
guesses may go round in circles; it costs a guess more where a joint turns back within a step."""
LARGEST = 1e30
"""N m or N: what stands for no limit, and is finite in float32."""


def velocity_step(
    model: Model, q: Array, dq: Array, h: Any, tau: Array, *,
    gains: Array | None = None, limits: Array | None = None, friction: bool = False,
    push: Array | None = None, wrenches: Wrenches | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Velocities after the step, the torques applied in it, and those of friction; (nv,) each.

    ``tau`` is what the law asks for at dq, ``gains`` its -∂τ/∂dq joint by joint, ``push`` what else acts on the joints.
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
        """v, τ and the torques of friction, by the last guess; torques are within their limits whatever it was."""
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
        """v, the impulse that friction takes, and the torque that the law asks for, with a guess."""
        slides, within = s * s, 1.0 - t * t
        K = widened(self.A, self.h * within * self.gains)  # (4)
        impulse = self.h * (self.rest + self._used(t, self.tau)) + K @ ((1.0 - slides) * self.dq)
        dry = self._dry(s)
        x = self._answer(K, slides, impulse - dry)
        v = slides * self.dq + x  # (5)
        taken = dry + (1.0 - slides) * (impulse - K @ x)  # (6)
        return v, taken, self.tau - self.gains * (v - self.dq)  # (2)

    def _sliding(self, s: Array, v: Array, taken: Array) -> Array:
        """A better guess at what slides: what goes against its friction sticks, what friction cannot hold slides."""
        s = s.copy()
        for i in self.dry:
            x = self.soft[i] * v[i] + taken[i]
            s[i] = (x - x.clip(-self.back[i], self.forth[i])).sign()
        return s

    def _at_limits(self, t: Array, tau: Array) -> Array:
        """A better guess at the torques at their limits: what is asked of one comes back within, or is beyond."""
        t = t.copy()
        for i in self.limited:
            L, stiff = self.limits[i], self.h * self.gains[i] / self.soft[i]
            at = t[i] * L
            x = at + (tau[i] - at) * (1.0 - t[i] * t[i] * (stiff / (1.0 + stiff)))
            t[i] = (x - x.clip(-L, L)).sign()
        return t

    def _used(self, t: Array, tau: Array) -> Array:
        """The torques, or the limits that a guess says they are at."""
        used = tau.copy()
        for i in self.limited:
            used[i] = (1.0 - t[i] * t[i]) * tau[i] + t[i] * self.limits[i]
        return used

    def _dry(self, s: Array) -> Array:
        """The impulses of dry friction on what slides; 0 for what sticks."""
        found = zeros(len(s))
        for i in self.dry:
            back, forth = self.back[i], self.forth[i]
            found[i] = s[i] * forth if back is forth else 0.5 * s[i] * (s[i] * (forth - back) + (forth + back))
        return found

    def _answer(self, K: Array, slides: Array, impulse: Array) -> Array:
        """What impulses do to the velocities of the joints that slide, while the others hold; exactly 0 for these."""
        lower = K.copy()
        for i in range(len(K)):
            for j in range(i):
                lower[i, j] = slides[i] * (slides[j] * K[i, j])
        return solved(*factored(lower), slides * impulse)
