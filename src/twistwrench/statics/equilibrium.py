"""Whether contacts can hold a body or a robot at rest: forces that do, or a motion that proves none can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, ValueRangeError
from .contacts import Contact
from .limits import effort_limits, one_configuration, velocity_names

if TYPE_CHECKING:
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["Equilibrium", "body_equilibrium", "robot_equilibrium"]

_TWIST_NAMES = ("wx", "wy", "wz", "vx", "vy", "vz")
_MOST_EDGES = 512
_TOLERANCE = 1e-7
"""Power, as a share of the drive's, from which a motion counts as driven: ten times what the solver keeps to."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An answer with its proof: contact forces and torques that balance, or a motion nothing resists.

    ``holds`` is None where the friction cones, cut into as many edges as they may be, decide neither way: the case is
    then marginal, within one part in 10⁴ of the friction coefficients.
    """

    holds: bool | None
    forces: Array | None
    """(contacts, 3) N on the body: in its frame, or for a robot in the base frame; None unless it holds."""
    torques: Array | None
    """(nv,) of the joints, 0 for floating ones; (6,) zeros for a body; None unless it holds."""
    share: float | None
    """The largest share of a torque limit, made as small as can be; 0 for a body."""
    motion: Array | None
    """(nv,) or (6,): the certificate, dq or the body's twist, largest entry 1; None unless it cannot hold."""
    power: float | None
    """W: what the loads put into that motion beyond all that the motors could take out, with contacts adding at least 0."""
    edges: int
    """How many edges the friction cones had."""
    names: tuple[str, ...]

    def __str__(self) -> str:
        if self.holds:
            forces = np.asarray(self.forces)
            largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
            used = f", torques up to {100 * self.share:.0f} % of their limits" if self.share else ""
            return f"holds, with contact forces up to {largest:.4g} N{used}"
        if self.holds is None:
            return f"marginal: cones of {self.edges} edges decide neither way"
        moving = [f"{v:+.3g} {n}" for v, n in zip(np.asarray(self.motion), self.names, strict=True) if abs(v) > 1e-6]
        return f"cannot hold: no contact resists the motion {', '.join(moving)}, which the load drives"


def body_equilibrium(contacts: Sequence[Contact], wrench_on_body: ArrayLike, *, edges: int = 8) -> Equilibrium:
    """Whether contacts can balance a wrench (m, f) (6,) [N m, N] on one body, in the frame of points and normals.

    Forces f_i in the friction cones with Σ (p_i × f_i, f_i) + F = 0, or by Farkas' lemma a twist V with F·V > 0 along which
    no contact force does negative work. Raises ShapeError, ValueRangeError.

    >>> legs = [Contact((x, y, 0), friction=0.3) for x, y in ((1, 0), (-1, 1), (-1, -1))]
    >>> print(body_equilibrium(legs, [0, 0, 0, 0, 0, -30.0]))
    holds, with contact forces up to 15 N
    >>> print(body_equilibrium(legs, [0, 0, 0, 0, 12.0, -30.0]).holds)
    False
    """
    F = np.asarray(wrench_on_body, float)
    if F.shape != (6,) or not np.isfinite(F).all():
        raise ShapeError(f"wrench_on_body has shape {F.shape}, expected six finite numbers (m, f), moment first.")
    maps = [np.vstack([_hat(c.point), np.eye(3)]) for c in contacts]  # f → (p × f, f)
    return _decide(contacts, maps, F, np.zeros(6), edges, _TWIST_NAMES)


def robot_equilibrium(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    *,
    limits: ArrayLike | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
    edges: int = 8,
) -> Equilibrium:
    """Whether a robot at rest can hold itself at one pose by contacts and by torques within limits; (nq) → an answer.

    Forces in the friction cones with τ = g(q) - Σ J'F_on - Σ J_i' f_i, abs(τ) ≤ limits, 0 on a floating base, and the
    largest share of a limit made least; or a motion dq with -τ₀·dq - Σ L abs(dq) > 0 (τ₀ the torques without contacts)
    along which no contact force does negative work. Joints without a limit bear anything.
    Raises ShapeError, ValueRangeError, UnknownNameError, FrameError.

    >>> import twistwrench as tw
    >>> box = tw.robots.floating_box()
    >>> corners = [Contact((x, y, -0.1), frame=box.link_names[0]) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    >>> print(robot_equilibrium(box, box.neutral, corners).holds)
    True
    """
    q = one_configuration(robot, q, "robot_equilibrium")
    unloaded = np.asarray(robot.holding_torques(q, wrench_on_robot=wrench_on_robot))
    maps = []
    for c in contacts:
        J = np.asarray(robot.jacobian(q, c.frame, "world_aligned"))
        arm = np.asarray(robot.forward_kinematics(q, c.frame))[:3, :3] @ c.point
        maps.append((J[3:] - _hat(arm) @ J[:3]).T)  # f → J_point' f
    return _decide(contacts, maps, -unloaded, effort_limits(robot, limits), edges, velocity_names(robot))


def _decide(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, edges: int, names: tuple[str, ...]
) -> Equilibrium:
    """Cut the cones ever finer until forces inside them, or a motion against cones around them, settle it."""
    if edges < 3:
        raise ValueRangeError(f"cones of {edges} edges have no inside. Give edges=8 or more.")
    while True:
        found = _balance(contacts, maps, load, limits, edges)
        if found is not None:
            forces, share = found
            pushed = sum((M @ f for M, f in zip(maps, forces, strict=True)), np.zeros_like(load))
            torques = np.where(limits == 0, 0.0, -load - pushed)
            return Equilibrium(True, forces, torques, share, None, None, edges, names)
        motion, power = _unresisted(contacts, maps, load, limits, edges)
        if motion is not None:
            return Equilibrium(False, None, None, None, motion, power, edges, names)
        if edges >= _MOST_EDGES:
            return Equilibrium(None, None, None, None, None, None, edges, names)
        edges *= 2


def _balance(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, edges: int
) -> tuple[Array, float] | None:
    """Forces (contacts, 3) that balance at the least share of the limits, then with the least sum; None if none do."""
    from scipy.optimize import linprog

    cones = [np.vstack([c.normal, c.edges(edges)]) for c in contacts]  # the normal alone, lest forces lean without need
    size = _size(load)
    E = np.column_stack([np.zeros((len(load), 0)), *(M @ D.T for M, D in zip(maps, cones, strict=True))])
    k, fixed, driven = E.shape[1], limits == 0, (limits > 0) & np.isfinite(limits)
    L = (limits[driven] / size)[:, None]
    constraints: dict[str, Any] = {
        "A_ub": np.block([[E[driven], -L], [-E[driven], -L]]),
        "b_ub": np.concatenate([-load[driven], load[driven]]) / size,
        "A_eq": np.column_stack([E[fixed], np.zeros(fixed.sum())]),
        "b_eq": -load[fixed] / size,
        "method": "highs",
    }
    share = 0.0
    if driven.any():
        least = linprog([0.0] * k + [1.0], bounds=[(0, None)] * k + [(0, 1)], **constraints)
        if least.status != 0:
            return None
        share = float(least.fun)
    pressing = np.concatenate([np.zeros(0), *(np.linalg.norm(D, axis=1) for D in cones), [0.0]])
    found = linprog(pressing, bounds=[(0, None)] * k + [(0, min(1.0, share * (1 + 1e-9) + 1e-9))], **constraints)
    if found.status != 0 or found.x is None:
        return None
    weights = np.split(size * found.x[:-1], np.cumsum([len(D) for D in cones])[:-1]) if cones else []
    forces = np.array([w @ D for w, D in zip(weights, cones, strict=True)]).reshape(-1, 3)
    return forces, share


def _unresisted(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, edges: int
) -> tuple[Array | None, float]:
    """A motion that the load drives against all torques, and no force of cones around the true ones resists."""
    from scipy.optimize import linprog

    n, size = len(load), _size(load)
    cones = [c.edges(edges, around=True) for c in contacts]
    E = np.column_stack([np.zeros((n, 0)), *(M @ D.T for M, D in zip(maps, cones, strict=True))])
    motors = np.where(np.isfinite(limits), limits, 0.0) / size
    still = ~np.isfinite(limits)  # an unlimited joint resists any motion of its own
    one = np.eye(n)
    found = linprog(
        np.concatenate([-load / size, motors]),
        A_ub=np.block([[-E.T, np.zeros((E.shape[1], n))], [one, -one], [-one, -one]]),
        b_ub=np.zeros(E.shape[1] + 2 * n),
        bounds=[(0, 0) if s else (-1, 1) for s in still] + [(0, 1)] * n,
        method="highs",
    )
    if found.status != 0 or found.x is None:
        return None, 0.0
    motion = found.x[:n]
    power = float(load @ motion - size * motors @ np.abs(motion))
    if power <= _TOLERANCE * size:
        return None, 0.0
    peak = np.abs(motion).max()
    return motion / peak, power / peak


def _size(load: Array) -> float:
    return float(np.abs(load).max(initial=0.0)) or 1.0


def _hat(p: Array) -> Array:
    from ..lie import so3

    return np.asarray(so3.hat(p))
