"""Contact forces of a motion, and margins in speed, payload and friction: feet, wheels, bolts, fingers and suction cups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import FrameError, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import TOLERANCE, margin, number
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import so3
from ..mechanics.model.couplings import refuse_couplings
from ..robot.task_space_methods import require_robot
from .cone_programme import ConeOptimum, Cones, ForceBounds, Sense, cone_programme, least_norm_in_cones, two_sided
from .contacts import Contact, cones_of, contact_maps, contacts_of, refuse_loops, tangents
from .torque_limits import effort_limits, floating_entries

if TYPE_CHECKING:
    from ..robot import Robot

_LEFT_OVER = 1e-6
"""Load that forces leave over, relative to the load, above which a row is undecided."""
_UNLIMITED_FRICTION = 10.0
"""Coefficient of friction that counts as unlimited."""
_HALVINGS = 14
"""Halvings of the interval of the least coefficient of friction."""
_REST_SPEED_SHARE = 1e-6
"""Velocity of a contact relative to the fastest below which it does not move."""
_MAX_PLANE_DISTANCE = 0.01
"""Largest distance of contacts from one plane [m] for which a zero moment point exists."""


@dataclass(frozen=True, eq=False, repr=False)
class Support:
    r"""Contact forces of n instants, with margins, or the motions that prove that no forces balance.

    At an instant that does not hold, ``motion`` has n · v ≥ μ \|v_t\| at every contact, so that no contact force can brake it,
    and the load puts ``power`` > 0 into it (Farkas' lemma). With more than three contacts, or several corners, ``holds``
    means that some forces within the cones balance; how a stiff body shares its weight depends on its stiffness, and one foot
    may unload earlier.
    """

    holds: Array
    """(n,) of bool: True if forces within the cones balance."""
    decided: Array
    """(n,) of bool: False where rounding prevents an answer; ``holds`` is then False and ``how`` "undecided"."""
    how: Array
    """(n,) of str: "holds", "slips", "tips", "pulls off" or "undecided"."""
    forces: Array
    """(n, c, 3): forces on the robot or body, of least norm (see ``least_norm``), in the base frame; NaN where it does not
    hold [N]."""
    torques: Array
    """(n, nv): joint torques, 0 at undriven joints; (n, 0) for one body; NaN where it does not hold [N m, N]."""
    speed: Array
    """(n,): largest factor of the speed, by which time is scaled; inf without a limit, NaN if the pose at rest fails."""
    slowest: Array
    """(n,): least factor of the speed; above 0 for motions that balance by their momentum; NaN if none holds."""
    payload: Array
    """(n,): further mass that holds [kg]; negative: mass that is too much; NaN without a frame of the payload."""
    friction: Array
    """(n,): least coefficient of friction that holds, the largest of all contacts; inf if friction does not suffice."""
    zmp: Array
    """(n, 2): zero moment point in the plane of the contacts [m]; NaN without one plane."""
    zmp_margin: Array
    """(n,): distance of the zero moment point from the edge of the support polygon, negative outside [m]."""
    motion: Array
    """(n, nv) or (n, 6): motion that no contact resists, largest entry 1; NaN where it holds."""
    power: Array
    """(n,): power of the load in that motion [W]; NaN where it holds."""
    contacts: tuple[Contact, ...]
    """Contacts as given."""
    least_norm: Array
    """(n,) of bool: True where ``forces`` are those of least norm. False where it does not hold, and at the edge of what holds,
    where other forces that balance may be smaller."""

    @property
    def worst(self) -> int:
        """Row that sets the speed; the first that fails if a pose cannot be held at rest."""
        failed = np.flatnonzero(~self.holds)
        if len(failed) and np.isnan(self.speed[failed]).any():
            return int(failed[np.isnan(self.speed[failed])][0])
        return int(np.argmin(np.where(np.isnan(self.speed), np.inf, self.speed)))

    def __repr__(self) -> str:
        return f"Support: {self}"

    def __str__(self) -> str:
        k = self.worst
        if not self.decided.all():
            return f"undecided at {int((~self.decided).sum())} of {len(self.holds)} rows"
        if not self.holds.all():
            first = int(np.argmin(self.holds))
            speed = self.speed[k]
            upto = "" if np.isnan(speed) else f"; it holds up to {number(float(speed), 3)} × this speed"
            return f"{self.how[first]} at row {first} of {len(self.holds)}{upto}"
        least = float(self.friction.max(initial=0.0))
        mass = float(self.payload.min(initial=np.inf))
        text = f"holds with friction {number(least, 3)}" if least > 0 else "holds without friction"
        margins = []
        if np.isfinite(self.speed[k]):
            margins.append(f"up to {number(float(self.speed[k]), 3)} × this speed")
        if np.isfinite(mass):
            margins.append(f"{number(mass, 3)} kg more")
        if margins:
            text += f", {' or '.join(margins)}"
        return text


def support(
    robot: Robot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    contacts: Sequence[Contact],
    *,
    in_contact: ArrayLike | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
    limits: ArrayLike | None = None,
    payload_frame: str | None = None,
    payload_com: ArrayLike = (0.0, 0.0, 0.0),
) -> Support:
    """Contact forces of a motion of a robot on contacts, and how much faster, heavier or smoother it still holds.

    Finds forces f_i in the friction cones with Σ J_i' f_i = b, where b = M q̈ + h in the rows of the free base. Motors bear
    the other rows: τ = M q̈ + h - Σ J_i' f_i. Time scaled by s multiplies b less its part at rest by s².

    Parameters
    ----------
    q : (n, nq) or (nq,) array_like
    dq, ddq : (n, nv) or (nv,) array_like
    contacts : sequence of Contact, each at a link of the robot
    in_contact : (n, c) array_like of bool, optional, contacts that carry in each row; None: all
    wrench_on_robot : {frame: (6,)}, optional, constant wrenches on the robot; they are not scaled with the speed
    limits : (nv,) array_like, optional, largest torques: where those of the least forces exceed them, forces within the limits
        are chosen, or, if there are none, those with the least largest share of a limit [N m, N]
    payload_frame : str, optional, frame that carries the further mass of ``payload``
    payload_com : (3,) array_like, centre of the further mass in that frame [m]

    Returns
    -------
    found : Support, forces, torques, margins and proofs of each row

    Raises
    ------
    ShapeError, ValueRangeError, ModelError, ConstraintError
        The base is not free, there is no contact, the sizes differ, joints are coupled, or loops are closed.

    Notes
    -----
    Modern Robotics, sections 8.5 and 12.1.7; Caron, Pham and Nakamura, Stability of surface contacts, 2015.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> box = tw.robots.floating_box()
    >>> corners = [Contact((x, y, -0.1), frame=box.tip, friction=0.5) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    >>> sideways = np.array([0, 0, 0, 0, 2.0, 0])
    >>> found = support(box, box.neutral, np.zeros(6), sideways, corners)
    >>> found.how.tolist(), found.friction.round(3).tolist(), found.speed.round(3).tolist()
    (['holds'], [0.204], [1.566])
    """
    refuse_loops(robot, "support")
    refuse_couplings(require_robot(robot, "support").model, "support")
    contacts = contacts_of(contacts)
    free = floating_entries(robot)
    if not free.any():
        raise ValueRangeError(
            f"the base of robot {robot.name!r} is fixed, so that contacts carry nothing. Load it with floating_base=True."
        )
    q, dq, ddq = _rows(robot, q, dq, ddq)
    tau = _torques(robot, q, dq, ddq, wrench_on_robot)
    holding_torques = _torques(robot, q, 0.0 * dq, 0.0 * ddq, wrench_on_robot)
    maps, points = contact_maps(robot, q, contacts)
    heavier = None
    if payload_frame is not None:
        loaded = robot.with_payload(SpatialInertia.from_com(1.0, payload_com), payload_frame)
        heavier = (_torques(loaded, q, dq, ddq, wrench_on_robot) - tau)[:, free]
    turning = np.array([S[:3].any() for body in robot.model.leaders for S in body.joint.axes], bool)[free]
    balance = _Balance(contacts, maps[:, free], tau[:, free], holding_torques[:, free], heavier, turning, in_contact)
    solution = balance.solve()
    if limits is not None:
        effort = np.where(free, np.inf, effort_limits(robot, limits))
        forces, least_norm = balance.forces_within(solution.forces, solution.least_norm, maps, tau, effort)
        solution = replace(solution, forces=forces, least_norm=least_norm)
    motion = np.full((len(q), robot.nv), np.nan)
    motion[~solution.holds] = 0.0
    motion[:, free] = solution.motion
    torques = tau - np.einsum("nvck,nck->nv", maps, solution.forces)
    torques[:, free] = 0.0
    torques[~solution.holds] = np.nan
    zmp, margin = _zero_moment_point(balance, points, _wrench_at_base(robot, q, tau))
    return _support(solution, balance, torques, motion, zmp, margin)


def hold(
    wrenches: ArrayLike,
    contacts: Sequence[Contact],
    *,
    per_kilogram: ArrayLike | None = None,
    at_rest: ArrayLike | None = None,
) -> Support:
    """Contact forces that hold one body under wrenches, such as a load between fingers, with margins.

    Finds forces f_i in the friction cones with Σ (p_i × f_i, f_i) + F = 0.

    Parameters
    ----------
    wrenches : (n, 6) or (6,) array_like, (m, f) on the body, in the frame of the contacts [N m, N]
    contacts : sequence of Contact, with points and normals in that frame
    per_kilogram : (n, 6) or (6,) array_like, optional, wrench of a further kilogram
    at_rest : (n, 6) or (6,) array_like, optional, part of the wrenches that does not grow with the speed, as gravity

    Returns
    -------
    found : Support, forces, torques, margins and proofs of each row

    Raises
    ------
    FrameError, ShapeError, ValueRangeError
        A contact has a ``frame``, there is no contact, or the sizes differ.

    Examples
    --------
    >>> pads = [Contact((0, y, 0), (0, -y, 0), friction=0.5, push=60.0) for y in (-0.02, 0.02)]
    >>> found = hold([0, 0, 0, 0, 0, -9.81], pads, per_kilogram=[0, 0, 0, 0, 0, -9.81])
    >>> (1.0 + found.payload).round(5).tolist()  # 2 μ F / g
    [6.11621]
    """
    contacts = contacts_of(contacts)
    for k, c in enumerate(contacts):
        if c.frame is not None:
            raise FrameError(
                f"contacts[{k}] is at {c.frame!r}, a link of a robot: on one body all points and normals are in the one frame "
                "of its wrenches. Give them in that frame, with frame=None, or use support."
            )
    F = np.atleast_2d(arguments.finite(wrenches, "wrenches (m, f)", 6))
    if F.ndim != 2:
        raise ShapeError(f"wrenches has the shape {F.shape}. Give (n, 6), one wrench a row.")
    points = np.array([c.point for c in contacts])
    maps = np.stack([np.vstack([so3.hat(p), np.eye(3)]) for p in points], axis=1)
    maps = np.broadcast_to(maps, (len(F), *maps.shape))
    rest_load, heavier = _load_like(F, at_rest, "at_rest"), _load_like(F, per_kilogram, "per_kilogram")
    balance = _Balance(contacts, maps, -F, rest_load, heavier, np.arange(6) < 3, None)
    solution = balance.solve()
    zmp, margin = _zero_moment_point(balance, np.broadcast_to(points, (len(F), *points.shape)), -F)
    return _support(solution, balance, np.zeros((len(F), 0)), solution.motion, zmp, margin)


def _load_like(F: Array, wrench: ArrayLike | None, what: str) -> Array | None:
    """Load that balances a further wrench on the body, for each of the wrenches F."""
    if wrench is None:
        return None
    array = arguments.finite(wrench, what, 6)
    if array.ndim > 2 or (array.ndim == 2 and len(array) not in (1, len(F))):
        raise ShapeError(f"{what} has the shape {array.shape}. Give (6,) or {F.shape}, as the wrenches.")
    return -np.broadcast_to(array, F.shape)


def _rows(robot: Robot, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> tuple[Array, Array, Array]:
    """One state or several, as rows."""
    states = (("q", q, robot.nq), ("dq", dq, robot.nv), ("ddq", ddq, robot.nv))
    rows = [np.atleast_2d(np.asarray(arguments.finite(x, f"support: {name}", n), float)) for name, x, n in states]
    counts = {len(x) for x in rows if len(x) != 1} or {1}
    if len(counts) > 1 or any(x.ndim != 2 for x in rows):
        raise ShapeError(
            f"support takes rows of states, got q {rows[0].shape}, dq {rows[1].shape}, ddq {rows[2].shape}. Give (n, nq), "
            "(n, nv) and (n, nv)."
        )
    q, dq, ddq = (np.broadcast_to(x, (max(counts), x.shape[1])) for x in rows)
    return q, dq, ddq


def _torques(robot: Robot, q: Array, dq: Array, ddq: Array, wrench_on_robot: Mapping[str, ArrayLike] | None) -> Array:
    return np.asarray(robot.inverse_dynamics(q, dq, ddq, wrench_on_robot=wrench_on_robot))


def _wrench_at_base(robot: Robot, q: Array, tau: Array) -> Array | None:
    """Wrench (n, 6) that contacts give to a floating root, about the base origin; None for other roots."""
    free = [body for body in robot.model.leaders if not body.joint.driven]
    if len(free) != 1 or free[0].joint.nv != 6:
        return None
    T = np.asarray(robot.forward_kinematics(q, free[0].link))
    F = tau[:, free[0].v_index : free[0].v_index + 6]
    m, f = (np.einsum("nij,nj->ni", T[:, :3, :3], x) for x in (F[:, :3], F[:, 3:]))
    return np.concatenate([m + np.cross(T[:, :3, 3], f), f], axis=1)


@dataclass(frozen=True, eq=False)
class _Solution:
    holds: Array
    decided: Array
    how: Array
    forces: Array
    speed: Array
    slowest: Array
    payload: Array
    friction: Array
    motion: Array
    power: Array
    least_norm: Array


class _Balance:
    """Balance Σ G_i f_i = b of each row in the cones; rotational rows are divided by the contacts' lever, so all are in N."""

    def __init__(
        self,
        contacts: tuple[Contact, ...],
        maps: Array,
        b: Array,
        rest_load: Array | None,
        heavier: Array | None,
        turning: Array,
        in_contact: ArrayLike | None,
    ) -> None:
        n, _, c, _ = maps.shape
        self.contacts = contacts
        self.cones, self.bounds = cones_of(contacts, n)
        self.active = np.ones((n, c), bool) if in_contact is None else _contact_mask(in_contact, n, c)
        lever = float(np.abs(maps[:, turning]).max(initial=0.0)) or 1.0
        self.units = np.where(turning, lever, 1.0)
        self.maps = maps / self.units[:, None, None]
        pull = np.array([contact.pull for contact in contacts])
        self.preload = -pull[:, None] * self.cones.normals * self.active[..., None]
        preload = np.einsum("nmck,nck->nm", self.maps, self.preload)
        self.load = b / self.units
        self.b = self.load - preload
        self.rest_b = None if rest_load is None else rest_load / self.units - preload
        self.heavier = None if heavier is None else heavier / self.units

    def solve(self) -> _Solution:
        """Forces, margins and proofs of all rows."""
        first = self._programme(self.b)
        balanced = ~np.isnan(first.s)
        residual = np.abs(np.einsum("nmck,nck->nm", self.maps, first.forces) - self.b).max(axis=1, initial=0.0)
        size = np.abs(self.b).max(axis=1, initial=0.0)
        motion, power, how = self._motions(first.prices)
        decided = first.settled & np.where(balanced, residual <= _LEFT_OVER * size + 1e-12, power > 0)
        holds = balanced & decided
        forces = np.full(first.forces.shape, np.nan)
        least_norm = np.zeros(len(forces), bool)
        forces[holds], least_norm[holds] = self._least_norm(first.forces, holds)
        failed, friction = decided & ~holds, self._friction()
        self._tip(np.flatnonzero(failed & (how == "slips") & np.isinf(friction)), motion, power, how)
        how = np.where(decided, np.where(holds, "holds", how), "undecided")
        speed, slowest = self._speeds(holds)
        return _Solution(
            holds, decided, how, forces, speed, slowest, self._payloads(holds), friction,
            np.where(failed[:, None], motion, np.nan), np.where(failed, power, np.nan), least_norm,
        )  # fmt: skip

    def _tip(self, rows: Array, motion: Array, power: Array, how: Array) -> None:
        """Replace motions that slide, of rows that no friction holds, by those that no friction resists."""
        if not len(rows):
            return
        share = self._shares()
        cones = replace(self.cones, friction=_UNLIMITED_FRICTION * share)
        optimum = self._programme(self.b[rows], rows=rows, cones=cones)
        tip_motion, tip_power, tip_how = self._motions(optimum.prices, rows, slippery=share == 0)
        tips = np.isnan(optimum.s) & optimum.settled & (tip_power > 0)
        motion[rows[tips]], power[rows[tips]], how[rows[tips]] = tip_motion[tips], tip_power[tips], tip_how[tips]

    def forces(self) -> tuple[Array, Array, Array]:
        """Forces (n, c, 3), NaN where none balance, masks of those of least norm and of rows with forces."""
        first = self._programme(self.b)
        holds = ~np.isnan(first.s) & first.settled
        forces, least_norm = np.full(first.forces.shape, np.nan), np.zeros(len(holds), bool)
        forces[holds], least_norm[holds] = self._least_norm(first.forces, holds)
        return forces, least_norm, holds

    def _programme(
        self,
        b: Array,
        d: Array | None = None,
        rows: Any = slice(None),
        sense: Sense = "most",
        cones: Cones | None = None,
    ) -> ConeOptimum:
        maps, active, bounds = self.maps[rows], self.active[rows], self.bounds.of(rows)
        return cone_programme(cones or self.cones, maps, b, d, bounds=bounds, active=active, sense=sense)

    def _least_norm(self, basic: Array, rows: Array) -> tuple[Array, Array]:
        """Forces of least norm beyond the preload, basic ones where these are not found, and a mask of the former."""
        maps, active, bounds = self.maps[rows], self.active[rows], self.bounds.of(rows)
        forces, solved = least_norm_in_cones(self.cones, maps, self.b[rows], active, bounds)
        return np.where(solved[:, None, None], forces, basic[rows]) + self.preload[rows], solved

    def forces_within(
        self, forces: Array, least_norm: Array, maps: Array, tau: Array, limits: Array
    ) -> tuple[Array, Array]:
        """Forces that keep τ - Σ J_i' f_i within limits, or their largest share least, and a mask of those of least norm.

        ``forces`` (n, c, 3) and ``least_norm`` (n,) are those without limits, NaN where none balance.
        """
        forces, least_norm = forces.copy(), least_norm.copy()
        rows = np.flatnonzero(exceeding(tau - np.einsum("nvck,nck->nv", maps, forces), limits))
        if not len(rows):
            return forces, least_norm
        active, limited = self.active[rows], _Limited(self, maps, tau, limits, rows)
        least = cone_programme(
            self.cones, self.maps[rows], self.b[rows], bounds=limited.growing, active=active, sense="least"
        )
        within = limited.within(np.maximum(least.s * (1.0 + TOLERANCE), 1.0))
        small, least_norm[rows] = least_norm_in_cones(self.cones, self.maps[rows], self.b[rows], active, within)
        forces[rows] = np.where(least_norm[rows, None, None], small, least.forces) + self.preload[rows]
        return forces, least_norm

    def friction_within(self, friction: Array, maps: Array, tau: Array, limits: Array, maximum: float) -> Array:
        """Least coefficients (n,) from ``friction`` to ``maximum`` for which forces keep the torques within limits.

        Rows whose torques are within them at ``friction``, or above them even with ``maximum``, keep ``friction``.
        """
        needed, share = friction.copy(), self._shares()
        finite = np.flatnonzero(np.isfinite(friction) & (friction < maximum))
        cones = replace(self.cones, friction=friction[finite][:, None] * share)
        forces, solved = least_norm_in_cones(
            cones, self.maps[finite], self.b[finite], self.active[finite], self.bounds.of(finite)
        )
        torques = tau[finite] - np.einsum("nvck,nck->nv", maps[finite], forces + self.preload[finite])
        rows = finite[exceeding(torques, limits) | ~solved]
        rows = rows[~self._keeps(rows, friction[rows], share, maps, tau, limits)]
        rows = rows[self._keeps(rows, np.full(len(rows), maximum), share, maps, tau, limits)]
        if not len(rows):
            return needed
        low, high = friction[rows], np.full(len(rows), maximum)
        for _ in range(_HALVINGS):
            middle = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))
            keeps = self._keeps(rows, middle, share, maps, tau, limits)
            low, high = np.where(keeps, low, middle), np.where(keeps, middle, high)
        needed[rows] = high
        return needed

    def _keeps(self, rows: Array, friction: Array, share: Array, maps: Array, tau: Array, limits: Array) -> Array:
        """True for rows with forces within cones of these coefficients that keep the torques within limits."""
        if not len(rows):
            return np.zeros(0, bool)
        cones = replace(self.cones, friction=friction[:, None] * share)
        within = _Limited(self, maps, tau, limits, rows).within(np.full(len(rows), 1.0 + TOLERANCE))
        optimum = cone_programme(cones, self.maps[rows], self.b[rows], bounds=within, active=self.active[rows])
        return ~np.isnan(optimum.s) & optimum.settled

    def _speeds(self, holds: Array) -> tuple[Array, Array]:
        """Largest and least factors of the speed: the s² that hold are an interval, as the cones are convex."""
        if self.rest_b is None:
            unknown = np.full(len(self.b), np.nan)
            return unknown, unknown
        rate = self.b - self.rest_b
        start, offset = np.where(holds[:, None], self.b, self.rest_b), np.where(holds, 1.0, 0.0)
        maximum = self._programme(start, rate)
        minimum = self._programme(self.rest_b, rate, sense="least")
        speed = np.sqrt(np.where(maximum.settled, offset + maximum.s, np.nan))
        return speed, np.sqrt(np.where(minimum.settled, minimum.s, np.nan))

    def _payloads(self, holds: Array) -> Array:
        """Further mass where the row holds, otherwise the least that has to go."""
        payload = np.full(len(self.b), np.nan)
        if self.heavier is None:
            return payload
        sides: tuple[tuple[Array, float, Sense], ...] = ((holds, 1.0, "most"), (~holds, -1.0, "least"))
        for rows, sign, sense in sides:
            if rows.any():
                optimum = self._programme(self.b[rows], sign * self.heavier[rows], rows, sense)
                payload[rows] = sign * np.where(optimum.settled, optimum.s, np.nan)
        return payload

    def _friction(self) -> Array:
        """Least coefficient that holds, by bisection: what holds with one coefficient holds with a larger one."""
        share = self._shares()
        low, high = np.zeros(len(self.b)), np.full(len(self.b), _UNLIMITED_FRICTION)
        suffices = self._holds_with(share, high)
        needs = suffices & ~self._holds_with(share, low)
        rows = np.flatnonzero(needs)
        for _ in range(_HALVINGS):
            middle = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))
            holds = self._holds_with(share, middle, rows)
            high[rows[holds]], low[rows[~holds]] = middle[rows[holds]], middle[rows[~holds]]
        return np.where(suffices, np.where(needs, high, 0.0), np.inf)

    def _shares(self) -> Array:
        """Coefficients (c,) of the contacts as shares of the largest, all of which grow together."""
        mu = self.cones.friction
        largest = float(mu.max())
        return mu / largest if largest > 0 else np.ones_like(mu)

    def _holds_with(self, share: Array, friction: Array, rows: Array | slice = slice(None)) -> Array:
        cones = replace(self.cones, friction=friction[rows][:, None] * share)
        optimum = self._programme(self.b[rows], rows=rows, cones=cones)
        return ~np.isnan(optimum.s) & optimum.settled

    def _motions(
        self, prices: Array, rows: Any = slice(None), slippery: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Motions of Farkas' lemma, largest entry 1, their power, and what the contacts do in them.

        ``slippery`` (c,) are the contacts that may slide; None: all.
        """
        motion = prices / self.units
        size = np.abs(motion).max(axis=1, initial=0.0, keepdims=True)
        size = np.where(size > 0, size, 1.0)
        motion, y, active = motion / size, prices / size, self.active[rows]
        velocities = np.einsum("nmck,nm->nck", self.maps[rows], y)
        power = -(y * self.load[rows]).sum(axis=1)
        rise = (velocities * self.cones.normals).sum(axis=-1)
        slide = np.linalg.norm(velocities - rise[..., None] * self.cones.normals, axis=-1)
        small = _REST_SPEED_SHARE * np.abs(velocities).max(axis=(1, 2), initial=0.0)[:, None]
        along_cone = (slide > small) & (rise - self.cones.friction * slide < small) & active
        if slippery is not None:
            along_cone &= slippery
        preloaded = np.array([c.pull > 0 for c in self.contacts])
        leaves = (rise > small) & preloaded & active & ~along_cone
        slips, pulls = along_cone.any(axis=1), leaves.any(axis=1)
        return motion, power, np.where(pulls, "pulls off", np.where(slips, "slips", "tips"))


def exceeding(torques: Array, limits: Array) -> Array:
    """True for rows of torques (n, nv) above their limits; False where they are NaN."""
    return np.asarray(((np.abs(torques) > limits + margin(limits)) & (limits > 0)).any(axis=1))


class _Limited:
    """Torques τ - Σ J_i' f_i of some rows of a balance as shares of their limits, as bounds of the forces."""

    def __init__(self, balance: _Balance, maps: Array, tau: Array, limits: Array, rows: Array) -> None:
        limited = np.isfinite(limits) & (limits > 0)
        own_limits = np.broadcast_to(limits[limited], (len(rows), limited.sum()))
        load = np.einsum("nvck,nck->nv", maps[rows], balance.preload[rows]) - tau[rows]
        self.G, self.load = maps[rows][:, limited] / own_limits[..., None, None], load[:, limited] / own_limits
        self.pushes = balance.bounds.of(rows)

    @property
    def growing(self) -> ForceBounds:
        """Bounds that grow from zero with the share of the limits."""
        one = np.ones_like(self.load)
        return two_sided(self.G, self.load, 0.0 * one, one).concatenate(self.pushes)

    def within(self, share: Array) -> ForceBounds:
        """Bounds at shares (n,) of the limits."""
        one = np.ones_like(self.load)
        return two_sided(self.G, self.load, share[:, None] * one, 0.0 * one).concatenate(self.pushes)


def _contact_mask(in_contact: ArrayLike, n: int, c: int) -> Array:
    active = np.asarray(in_contact)
    if active.dtype != bool or active.shape not in ((n, c), (c,)):
        raise ShapeError(
            f"in_contact has the shape {active.shape} and the type {active.dtype}. Give ({n}, {c}) of bool: a row for each "
            "state and a column for each contact."
        )
    return np.broadcast_to(active, (n, c))


def _support(
    solution: _Solution, balance: _Balance, torques: Array, motion: Array, zmp: Array, margin: Array
) -> Support:
    return Support(
        solution.holds, solution.decided, solution.how, solution.forces, torques, solution.speed, solution.slowest,
        solution.payload, solution.friction, zmp, margin, motion, solution.power, balance.contacts, solution.least_norm,
    )  # fmt: skip


# ── Force of a grip


def force_shares(wrenches: ArrayLike, contacts: Sequence[Contact]) -> Array:
    """Least factors (n,) of the contacts' largest forces and preloads that hold one body under wrenches; inf if none does.

    Examples
    --------
    >>> pads = [Contact((0, y, 0), (0, -y, 0), friction=0.5, push=60.0) for y in (-0.02, 0.02)]
    >>> force_shares([0, 0, 0, 0, 0, -30.0], pads).round(6).tolist()
    [0.5]
    """
    contacts = contacts_of(contacts)
    load = -np.atleast_2d(arguments.finite(wrenches, "wrenches (m, f)", 6))
    points, n = np.array([c.point for c in contacts]), len(load)
    units = np.r_[np.full(3, float(np.abs(points).max(initial=0.0)) or 1.0), np.ones(3)]
    maps = np.stack([np.vstack([so3.hat(p), np.eye(3)]) for p in points], axis=1) / units[:, None, None]
    cones, bounds = cones_of(contacts, n)
    growing = replace(bounds, most=np.zeros_like(bounds.most), rate=bounds.most)
    pulls = np.einsum("mck,ck->m", maps, np.array([c.pull for c in contacts])[:, None] * cones.normals)
    optimum = cone_programme(
        cones,
        np.broadcast_to(maps, (n, *maps.shape)),
        load / units,
        np.broadcast_to(pulls, (n, 6)),
        bounds=growing,
        sense="least",
    )
    return np.where(optimum.settled, np.where(np.isnan(optimum.s), np.inf, optimum.s), np.nan)


# ── Forces alone, for the torques of a motion


class ContactForces(NamedTuple):
    """Contact forces of n instants, without margins."""

    forces: Array
    """(n, c, 3): forces on the robot in the base frame [N]; where no forces balance, those of contacts that stick."""
    maps: Array
    """(n, nv, c, 3): maps of contact forces to torques."""
    holds: Array
    """(n,) of bool: True where forces within the cones balance."""


def contact_forces(
    robot: Robot,
    q: Array,
    tau: Array,
    contacts: tuple[Contact, ...],
    in_contact: Array,
    limits: Array | None = None,
) -> ContactForces:
    """Forces of :func:`support` that balance torques (n, nv) without contacts in the rows of the free base."""
    free = floating_entries(robot)
    maps, balance = _balance_of(robot, q, tau, contacts, in_contact)
    forces, least_norm, holds = balance.forces()
    if limits is not None:
        forces, _ = balance.forces_within(forces, least_norm, maps, tau, np.where(free, np.inf, limits))
    if not holds.all():
        G = balance.maps[~holds] * in_contact[~holds][:, None, :, None]
        G = G.reshape(len(G), G.shape[1], -1)
        forces[~holds] = (np.linalg.pinv(G) @ balance.load[~holds][..., None]).reshape(-1, len(contacts), 3)
    return ContactForces(forces, maps, holds)


def friction_within(
    robot: Robot, q: Array, tau: Array, contacts: tuple[Contact, ...], in_contact: Array, friction: Array, limits: Array,
    most: float,
) -> Array:  # fmt: skip
    """Least coefficients (n,) from ``friction`` to ``most`` that keep the torques within limits (nv,) too.

    ``friction`` (n,) is that of the balance alone; it stays where the limits do not matter, or cannot be kept.
    """
    maps, balance = _balance_of(robot, q, tau, contacts, in_contact)
    return balance.friction_within(friction, maps, tau, np.where(floating_entries(robot), np.inf, limits), most)


def _balance_of(
    robot: Robot, q: Array, tau: Array, contacts: tuple[Contact, ...], in_contact: Array
) -> tuple[Array, _Balance]:
    """Maps (n, nv, c, 3) of the contacts, and the balance of torques (n, nv) at the free base."""
    free = floating_entries(robot)
    turning = np.array([S[:3].any() for body in robot.model.leaders for S in body.joint.axes], bool)[free]
    maps, _ = contact_maps(robot, q, contacts)
    return maps, _Balance(contacts, maps[:, free], tau[:, free], None, None, turning, in_contact)


# ── Zero moment point


def _zero_moment_point(balance: _Balance, points: Array, wrench: Array | None) -> tuple[Array, Array]:
    """Zero moment points (n, 2) and their distances (n,) from the edge of the support polygon, negative outside."""
    n = len(points)
    zmp, margin = np.full((n, 2), np.nan), np.full(n, np.nan)
    normals = balance.cones.normals
    if wrench is None or np.abs(normals - normals[0]).max() > 1e-9:
        return zmp, margin
    normal = normals[0]
    axes = tangents(normal)
    heights = np.where(balance.active, points @ normal, np.nan)
    carried = balance.active.any(axis=1)
    height, spread = np.zeros(n), np.zeros(n)
    height[carried] = np.nanmean(heights[carried], axis=1)
    spread[carried] = np.nanmax(heights[carried], axis=1) - np.nanmin(heights[carried], axis=1)
    moment = wrench[:, :3] - np.cross(height[:, None] * normal, wrench[:, 3:])
    pressing = wrench[:, 3:] @ normal
    flat = carried & (spread <= _MAX_PLANE_DISTANCE) & (pressing > 1e-9 * np.linalg.norm(wrench[:, 3:], axis=1))
    across = np.stack([-(moment @ axes[1]), moment @ axes[0]], axis=1)
    zmp[flat] = across[flat] / pressing[flat, None]
    for k in np.flatnonzero(flat):
        margin[k] = _inside(points[k, balance.active[k]] @ axes.T, zmp[k])
    return zmp, margin


def _inside(points: Array, position: Array) -> float:
    """Distance of a position from the edge of the convex hull of points (k, 2), negative outside."""
    start, end = points[:, None], points[None, :]
    along = end - start
    length = np.linalg.norm(along, axis=-1)
    unit = along / np.maximum(length, 1e-300)[..., None]
    inward = np.stack([-unit[..., 1], unit[..., 0]], axis=-1)  # of edges counterclockwise
    sides = np.einsum("ijk,ijmk->ijm", inward, points[None, None] - start[:, :, None])
    edge = (length > 0) & (sides.min(axis=-1) >= -1e-12 * (1.0 + length))
    to_line = ((position - start) * inward).sum(axis=-1)
    if edge.any() and float(to_line[edge].min()) >= 0:
        return float(to_line[edge].min())
    foot = np.clip(((position - start) * unit).sum(axis=-1), 0.0, length)
    return -float(np.linalg.norm(start + foot[..., None] * unit - position, axis=-1).min())


complete(globals())
