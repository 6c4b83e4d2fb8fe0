"""Friction cones of point contacts, and linear programmes of contact forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.numbers import printed, vector
from ..errors import ValueRangeError
from ..typing import Array


@dataclass(frozen=True, eq=False, repr=False)
class Contact:
    r"""Point contact with Coulomb friction: a force within the friction cone about ``normal``.

    That is \|tangential\| ≤ μ · normal part. For one body, ``point`` and ``normal`` are in the frame of its wrench. For
    a robot, ``point`` is in ``frame``, a link of it, and ``normal`` in the base frame, so that the floor's is (0, 0, 1)
    at every foot. The normal points into what is held, and is made of unit length.

    Raises
    ------
    ShapeError, ValueRangeError
        A vector is of another size, the normal zero, or the friction negative.

    Examples
    --------
    >>> contact = Contact((0, 0, 0), normal=(0, 0, 2), friction=0.5)
    >>> contact.edges(4)[1].round(3).tolist(), bool(contact.allows([0.4, 0, 1]))
    ([0.0, 0.5, 1.0], True)
    """

    point: Any = (0.0, 0.0, 0.0)
    """(3,) m."""
    normal: Any = (0.0, 0.0, 1.0)
    """(3,), into the body held."""
    friction: float = 0.5
    """μ, the Coulomb coefficient; 0 for none."""
    frame: str | None = None
    """The robot's link that touches; the tip if None. On a single body it has to be None."""

    def __post_init__(self) -> None:
        for name in ("point", "normal"):
            what = f"a contact's {name}"
            value = arguments.finite(arguments.one(getattr(self, name), what, 3), what, 3).copy()
            object.__setattr__(self, name, value)
        object.__setattr__(self, "friction", arguments.number(self.friction, "a contact's friction"))
        size = float(np.linalg.norm(self.normal))
        if size == 0:
            raise ValueRangeError("a contact's normal has no length. Give the direction in which the world can push.")
        if not 0 <= self.friction < np.inf:
            raise ValueRangeError(
                f"a contact's friction is {printed(self.friction)}. Give a finite coefficient of at least zero."
            )
        if not isinstance(self.frame, str | None):
            raise ValueRangeError(f"a contact's frame is {self.frame!r}. Give the name of a link, or None for the tip.")
        object.__setattr__(self, "normal", self.normal / size)

    def __repr__(self) -> str:
        at = f" of {self.frame}" if self.frame else ""
        return f"Contact at {vector(self.point)} m{at}, normal {vector(self.normal)}, friction {printed(self.friction)}"

    def edges(self, count: int, *, around: bool = False) -> Array:
        """Edges of a pyramid that lies inside the friction cone, or ``around`` it: forces with unit normal part.

        Edge k leans by μ at the angle 2πk/count; those around lean by μ / cos(π/count).

        Parameters
        ----------
        count : int, 3 or more
        around : bool, around the cone rather than inside

        Returns
        -------
        forces : (count, 3) array; (1, 3) for μ = 0
        """
        count = arguments.whole(count, "the number of a cone's edges", 3)  # fewer have no inside
        if self.friction == 0:
            return np.array(self.normal[None])
        lean = self.friction / np.cos(np.pi / count) if around else self.friction
        first = _across(self.normal)
        second = np.cross(self.normal, first)
        angle = 2 * np.pi * np.arange(count)[:, None] / count
        return self.normal + lean * (np.cos(angle) * first + np.sin(angle) * second)

    def allows(self, force: ArrayLike, slack: float = 1e-9) -> Any:
        """True if a force lies in the friction cone.

        Parameters
        ----------
        force : (..., 3) array_like [N]
        slack : float, part of its size by which it may lie outside

        Returns
        -------
        answer : (...) array of bool
        """
        f = arguments.finite(force, "force", 3)
        along = f @ self.normal
        sideways = np.linalg.norm(f - along[..., None] * self.normal, axis=-1)
        return sideways <= self.friction * along + slack * np.maximum(1.0, np.linalg.norm(f, axis=-1))


def _across(n: Array) -> Array:
    """A unit vector perpendicular to ``n``: the first axis, made so, or where that is near the normal, the second."""
    axis = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t = axis - (axis @ n) * n
    return t / np.linalg.norm(t)


# ── Linear programmes: balance within the cones, or an unresisted motion

_TOLERANCE = 1e-7
"""Power, as a share of the drive's, above which a motion counts as driven: ten times the solver's tolerance."""

_BALANCED = 1e-6
"""Largest remainder of the load, relative to the forces, that counts as balanced; checked before a positive answer."""

_ROUNDING = 1e-14
"""The same beside the sum of all that presses, which may be much more than the load where levers are short."""


def force_balance(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, turning: Array, edges: int
) -> tuple[Array, float | None] | None:
    """Forces (contacts, 3) that balance at the least share of the limits, then with the least sum; None if none do.

    The share is None where no torque has a limit above zero to be a share of.
    """
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
    x = _balanced(E, size * found.x[:-1], load, limits, turning)
    if x is None:
        return None
    weights = np.split(x, np.cumsum([len(D) for D in cones])[:-1]) if cones else []
    forces = np.array([w @ D for w, D in zip(weights, cones, strict=True)]).reshape(-1, 3)
    return forces, share if driven.any() else None


def _balanced(E: Array, x: Array, load: Array, limits: Array, turning: Array) -> Array | None:
    """Shares of the edges near ``x``, 0 at least, that balance the load to :data:`_BALANCED` of it; None where none do.

    The solver keeps to its tolerance beside the largest number, which may be far above the load.
    """
    fixed = limits == 0
    for _ in range(3):
        if (used := x > 0).any():
            x[used] -= np.linalg.lstsq(E[np.ix_(fixed, used)], (load + E @ x)[fixed], rcond=None)[0]
            x = np.maximum(x, 0.0)
    left = np.abs(load + E @ x)
    whole = float(np.abs(load[fixed]).max(initial=0.0))
    pushes = float(np.abs(load[fixed & ~turning]).max(initial=0.0)) or whole
    allowed = np.where(fixed, _BALANCED * np.where(turning, whole, pushes), (1.0 + _BALANCED) * limits)
    return x if (left <= allowed + _ROUNDING * (np.abs(E) @ x + np.abs(load))).all() else None


def least_norm_forces(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, edges: int
) -> Array | None:
    """Forces (contacts, 3) of least norm that balance the load within pyramids and limits; None where none do.

    Least distance programming: of min |x|, G x ≥ h the answer is x = -r[:-1] / r[-1], with r = E u - e the remainder of the
    non-negative least squares E = (G, h)', e = (0, …, 0, 1). Source: Lawson and Hanson, Solving Least Squares Problems,
    chapter 23.4. What has to be met exactly, entries with limits of zero, is taken out first: x = x₀ + N z.
    """
    from scipy.optimize import nnls

    if not contacts:
        return np.zeros((0, 3))
    B = np.column_stack(maps)  # τ = -load - B f
    fixed, driven = limits == 0, (limits > 0) & np.isfinite(limits)
    size = _size(load)
    U, sigma, Vt = np.linalg.svd(B[fixed]) if fixed.any() else (np.eye(0), np.zeros(0), np.eye(B.shape[1]))
    rank = int((sigma > 1e-10 * sigma.max(initial=0.0)).sum())
    x0 = Vt[:rank].T @ (U[:, :rank].T @ (-load[fixed] / size) / sigma[:rank])
    N = Vt[rank:].T
    sides = _block_diagonal([pyramid_facets(c, edges) for c in contacts])
    C = np.vstack([sides, B[driven], -B[driven]])
    h = np.concatenate([np.zeros(len(sides)), -(load + limits)[driven] / size, (load - limits)[driven] / size])
    G, h = C @ N, h - C @ x0
    u, left = nnls(np.vstack([G.T, h]), np.append(np.zeros(N.shape[1]), 1.0), maxiter=50 * len(h) + 100)
    if left <= 1e-9:
        return None
    r = np.vstack([G.T, h]) @ u
    return size * (x0 + N @ (r[:-1] / (1.0 - r[-1]))).reshape(-1, 3)


def pyramid_facets(contact: Contact, edges: int) -> Array:
    """Inward normals of a pyramid's sides, n · f ≥ 0; of a contact without friction, of the half line along its normal."""
    if contact.friction == 0:
        across = _across(contact.normal)
        sideways = np.stack([across, np.cross(contact.normal, across)])
        return np.vstack([contact.normal, sideways, -sideways])
    corners = contact.edges(edges)
    normals = np.cross(corners, np.roll(corners, -1, axis=0))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _block_diagonal(blocks: list[Array]) -> Array:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


def unresisted_motion(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, edges: int
) -> tuple[Array | None, float]:
    """A motion that the load drives against all torques, and no force of cones around the true ones resists."""
    from scipy.optimize import linprog

    n, size = len(load), _size(load)
    cones = [c.edges(edges, around=True) for c in contacts]
    E = np.column_stack([np.zeros((n, 0)), *(M @ D.T for M, D in zip(maps, cones, strict=True))])
    motors = np.where(np.isfinite(limits), limits, 0.0) / size
    moves = np.isfinite(limits)  # an unlimited joint resists any motion of its own
    one = np.eye(n)
    resisted = np.block([[-E.T, np.zeros((E.shape[1], n))], [one, -one], [-one, -one]])
    drive = np.concatenate([-load / size, motors])  # times (V, abs(V)): less than nothing for a motion that is driven
    bounds: Any = [(-1, 1) if m else (0, 0) for m in moves] + [(0, 1)] * n
    most = linprog(drive, A_ub=resisted, b_ub=np.zeros(len(resisted)), bounds=bounds, method="highs")
    if most.status != 0 or most.x is None or (power := float(-drive @ most.x)) <= _TOLERANCE:
        return None, 0.0
    # Of all motions that take as much, the one with the least sum of entries: it has few, and is read more easily.
    bounds = [(None, None) if m else (0, 0) for m in moves] + [(0, None)] * n
    A, b = np.vstack([resisted, drive]), np.append(np.zeros(len(resisted)), -power)
    plain = linprog([0.0] * n + [1.0] * n, A_ub=A, b_ub=b, bounds=bounds, method="highs")
    for found in (plain, most):
        if found.status != 0 or found.x is None or (peak := np.abs(found.x[:n]).max()) < 0.5:  # 1 but for rounding
            continue
        motion = found.x[:n] / peak + 0.0  # no minus zeros
        power = float(load @ motion - size * motors @ np.abs(motion))
        if power > 0:
            return motion, power
    return None, 0.0


def _size(load: Array) -> float:
    return float(np.abs(load).max(initial=0.0)) or 1.0
