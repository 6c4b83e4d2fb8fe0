"""Friction cones of point contacts, and linear programmes for contact forces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.numbers import printed, vector
from ..core.typing import Array


@dataclass(frozen=True, eq=False, repr=False)
class Contact:
    r"""Point contact with Coulomb friction: a force within the friction cone about ``normal``.

    The cone is \|tangential\| ≤ μ · normal part. With ``pull`` P, as of a bolt, a suction cup or a magnet, the contact
    opens at a pull of P and slides at μ (normal part + P). A finger presses with at most ``push``. For one body, ``point``
    and ``normal`` are in the frame of its wrench. For a robot, ``point`` is in the link frame ``frame`` and ``normal`` in
    the base frame, so the floor's normal is (0, 0, 1) at every foot. The normal points into the held body and is scaled to
    unit length.

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
    """(3,), into the held body."""
    friction: float = 0.5
    """Coulomb coefficient μ; 0 without friction."""
    frame: str | None = None
    """Link of the robot in contact; the tip if None. For a single body it must be None."""
    push: float = np.inf
    """Largest normal force [N]."""
    pull: float = 0.0
    """Force that pulls the contact together: preload of a bolt, vacuum or magnetic force [N]."""
    group: str | None = None
    """Name shared by contacts whose normal forces add up to at most ``push``, as the corners of a pad; None: this one alone."""

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
        for name in ("push", "pull"):
            force = arguments.number(getattr(self, name), f"a contact's {name}")
            if not force >= 0 or (name == "pull" and force == np.inf):
                raise ValueRangeError(f"a contact's {name} is {printed(force)}. Give a force of at least zero [N].")
            object.__setattr__(self, name, force)
        if not isinstance(self.group, str | None):
            raise ValueRangeError(f"a contact's group is {self.group!r}. Give a name, or None.")
        if not isinstance(self.frame, str | None):
            raise ValueRangeError(f"a contact's frame is {self.frame!r}. Give the name of a link, or None for the tip.")
        object.__setattr__(self, "normal", self.normal / size)

    def __repr__(self) -> str:
        at = f" of {self.frame}" if self.frame else ""
        push = "" if self.push == np.inf else f", push {printed(self.push)} N"
        pull = "" if self.pull == 0 else f", pull {printed(self.pull)} N"
        cone = f"normal {vector(self.normal)}, friction {printed(self.friction)}"
        return f"Contact at {vector(self.point)} m{at}, {cone}{push}{pull}"

    def edges(self, count: int, *, around: bool = False) -> Array:
        """Edges of a pyramid inside the friction cone, or ``around`` it, as forces with unit normal part.

        Edge k has the tangential part μ at the angle 2πk/count; edges around the cone have μ / cos(π/count).

        Parameters
        ----------
        count : int, 3 or more
        around : bool, around the cone rather than inside

        Returns
        -------
        forces : (count, 3) array; (1, 3) for μ = 0
        """
        count = arguments.whole(count, "the number of a cone's edges", 3)  # fewer edges enclose no volume
        if self.friction == 0:
            return np.array(self.normal[None])
        lean = self.friction / np.cos(np.pi / count) if around else self.friction
        first, second = tangents(self.normal)
        angle = 2 * np.pi * np.arange(count)[:, None] / count
        return self.normal + lean * (np.cos(angle) * first + np.sin(angle) * second)

    def allows(self, force: ArrayLike, slack: float = 1e-9) -> Any:
        """True if a force lies in the friction cone and is within the contact's ``push`` and ``pull``.

        Parameters
        ----------
        force : (..., 3) array_like [N]
        slack : float, tolerance as a share of the force

        Returns
        -------
        answer : (...) array of bool
        """
        f = arguments.finite(force, "force", 3)
        along = f @ self.normal
        sideways = np.linalg.norm(f - along[..., None] * self.normal, axis=-1)
        tolerance = slack * np.maximum(1.0, np.linalg.norm(f, axis=-1))
        pressed = along + self.pull
        return (
            (sideways <= self.friction * pressed + tolerance)
            & (pressed >= -tolerance)
            & (along <= self.push + tolerance)
        )


def tangents(n: Array) -> Array:
    """Unit vectors (2, 3) across ``n``; the first from the first axis, or from the second if that is nearly along ``n``."""
    axis = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t = axis - (axis @ n) * n
    t = t / np.linalg.norm(t)
    return np.stack([t, np.cross(n, t)])


def contacts_of(given: Any) -> tuple[Contact, ...]:
    """Contacts of a list with at least one. Raises ValueRangeError."""
    found = tuple(given) if isinstance(given, Iterable) else ()
    if not found or not all(isinstance(c, Contact) for c in found):
        raise ValueRangeError(f"contacts is {given!r}. Give a list of statics.Contact, at least one.")
    return found


# ── Linear programmes: balance within the cones, or a motion without resistance

_TOLERANCE = 1e-7
"""Power, as a share of the driving power, above which a motion counts as driven: ten times the solver's tolerance."""

_BALANCED = 1e-6
"""Largest residual of the load, relative to the forces, that counts as balanced; checked before a positive result."""

_ROUNDING = 1e-14
"""Rounding tolerance relative to the sum of all contact loads, which may far exceed the load if levers are short."""


def force_balance(
    contacts: Sequence[Contact], maps: list[Array], load: Array, limits: Array, turning: Array, edges: int
) -> tuple[Array, float | None] | None:
    """Contact forces (contacts, 3) that balance, with the least limit share, then the least sum; None if impossible.

    The share is None if no torque has a limit above zero.
    """
    from scipy.optimize import linprog

    cones = [np.vstack([c.normal, c.edges(edges)]) for c in contacts]  # the normal itself avoids tilted forces
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
    """Non-negative edge forces near ``x`` that balance the load to :data:`_BALANCED`; None if there are none.

    The solver's tolerance is relative to the largest number, which may be far above the load.
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
    """Contact forces (contacts, 3) of least norm that balance the load within pyramids and limits; None if impossible.

    Least distance programming: min |x| with G x ≥ h has the solution x = -r[:-1] / r[-1]. Here r = E u - e is the
    residual of the non-negative least squares with E = (G, h)', e = (0, …, 0, 1). Equality constraints (entries with
    limits of zero) are eliminated first: x = x₀ + N z. Source: Lawson and Hanson, Solving Least Squares Problems,
    chapter 23.4.
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
    """Inward normals n of a pyramid's sides, n · f ≥ 0; without friction, those of the half line along the normal."""
    if contact.friction == 0:
        sideways = tangents(contact.normal)
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
    """Motion that the load drives against all torques and that no contact force resists, for cones around the true ones."""
    from scipy.optimize import linprog

    n, size = len(load), _size(load)
    cones = [c.edges(edges, around=True) for c in contacts]
    E = np.column_stack([np.zeros((n, 0)), *(M @ D.T for M, D in zip(maps, cones, strict=True))])
    motors = np.where(np.isfinite(limits), limits, 0.0) / size
    moves = np.isfinite(limits)  # a joint without limit resists any motion of its own
    one = np.eye(n)
    resisted = np.block([[-E.T, np.zeros((E.shape[1], n))], [one, -one], [-one, -one]])
    drive = np.concatenate([-load / size, motors])  # times (V, abs(V)): negative for a driven motion
    bounds: Any = [(-1, 1) if m else (0, 0) for m in moves] + [(0, 1)] * n
    most = linprog(drive, A_ub=resisted, b_ub=np.zeros(len(resisted)), bounds=bounds, method="highs")
    if most.status != 0 or most.x is None or (power := float(-drive @ most.x)) <= _TOLERANCE:
        return None, 0.0
    # Among equally driven motions the least sum of entries is chosen: it has few entries and is easier to read.
    bounds = [(None, None) if m else (0, 0) for m in moves] + [(0, None)] * n
    A, b = np.vstack([resisted, drive]), np.append(np.zeros(len(resisted)), -power)
    plain = linprog([0.0] * n + [1.0] * n, A_ub=A, b_ub=b, bounds=bounds, method="highs")
    for found in (plain, most):
        if found.status != 0 or found.x is None or (peak := np.abs(found.x[:n]).max()) < 0.5:  # 1 up to rounding
            continue
        motion = found.x[:n] / peak + 0.0  # remove negative zeros
        power = float(load @ motion - size * motors @ np.abs(motion))
        if power > 0:
            return motion, power
    return None, 0.0


def _size(load: Array) -> float:
    return float(np.abs(load).max(initial=0.0)) or 1.0
