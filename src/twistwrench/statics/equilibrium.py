"""Equilibrium of a body or robot in contact, wrenches from joint torques, and joint stops."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import FrameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, percent, printed
from ..core.typing import Array
from ..mechanics.lie import so3
from ..mechanics.lie.labelled import TWIST, WRENCH
from ..mechanics.model.couplings import refuse_couplings
from .contacts import Contact, force_balance, least_norm_forces, unresisted_motion
from .torque_limits import effort_limits, one_configuration, resting_torques

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot
    from ..robot.arguments import Kind

_OF_A_BODY = "the body's twist (omega, v) in the frame of points and normals"
_OF_A_ROBOT = "joint velocities dq, of a floating base its twist in its own frame"
_MOST_EDGES = 512


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    r"""Static equilibrium with its proof: contact forces and torques that balance, or a motion without resistance.

    Contacts push but do not pull. In equilibrium the powers along every motion add up to zero. Suppose that along some
    motion no contact can absorb power and the loads supply more than the motors can absorb. Then no forces balance.
    This motion, the certificate, proves that the body cannot hold, and can be checked by hand. At each contact n · v ≥
    μ \|v - n (n · v)\|, with v its row of ``velocities`` and n its normal. Moreover ``power`` > 0; for one body it is F
    · V of its wrench F = (m, f) and V = ``motion``.
    """

    holds: bool | None
    """True if forces balance; None if the friction cones, at the largest number of edges, are not decisive:
    the case is marginal, within 1e-4 of the friction coefficients."""
    forces: Array | None
    """(contacts, 3) N on the body: in its frame, or for a robot in the base frame; None unless it holds."""
    torques: Array | None
    """(nv,) joint torques, 0 for floating joints; (6,) zeros for a body; None unless it holds."""
    share: float | None
    """Largest share of a torque limit, minimised; None unless it holds by torques with limits."""
    motion: Array | None
    """(nv,) or (6,): the certificate, dq or the body's twist V, largest entry 1; None unless it cannot hold.

    V is also a direction in wrench space: all wrenches of the contacts have F · V ≥ 0, while rest requires F · V <
    0."""
    velocities: Array | None
    """(contacts, 3) m/s: velocities of the contact points, in the frame of the normals; None unless it cannot hold."""
    power: float | None
    """Excess of the loads' power in that motion over the most that the motors can absorb [W]; contacts add at least 0."""
    edges: int
    """Number of edges of the friction cones."""
    names: tuple[str, ...]
    """Names of the entries of ``motion``."""
    frame: str
    """Meaning of ``motion`` and its frame."""

    def __repr__(self) -> str:
        return f"Equilibrium: {self}"

    def __str__(self) -> str:
        if self.holds:
            forces = np.asarray(self.forces)
            largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
            used = "" if self.share is None else f", torques up to {percent(self.share, 3)} of their limits"
            return f"holds, with contact forces up to {number(largest)} N{used}"
        if self.holds is None:
            return f"marginal: cones of {self.edges} edges decide neither way"
        moving = [
            f"{printed(v, 3, signed=True)} {n}"
            for v, n in zip(np.asarray(self.motion), self.names, strict=True)
            if abs(v) > 1e-6
        ]
        subject = "no contact resists" if len(np.asarray(self.velocities)) else "there is no contact to resist"
        return (
            f"cannot hold: {subject} the motion ({', '.join(moving)}), {self.frame}, "
            f"into which the load puts {number(self.power)} W"
        )


def body_equilibrium(contacts: Sequence[Contact], wrench_on_body: ArrayLike, *, edges: int = 8) -> Equilibrium:
    """Force closure of one body: decides if contacts can balance a wrench on it (MR section 12.2).

    Finds forces f_i in the friction cones with Σ (p_i × f_i, f_i) + F = 0. If there are none, by Farkas' lemma a twist
    V exists with F·V > 0 along which no contact force does negative work. Takes one wrench per call (a linear
    programme).

    Parameters
    ----------
    contacts : sequence of Contact, in the frame of the wrench
    wrench_on_body : (6,) array_like, (m, f) [N m, N]

    Raises
    ------
    FrameError
        A contact has a ``frame``, which is for links of a robot with normals in the base frame.

    Examples
    --------
    >>> legs = [Contact((x, y, 0), friction=0.3) for x, y in ((1, 0), (-1, 1), (-1, -1))]
    >>> print(body_equilibrium(legs, [0, 0, 0, 0, 0, -30.0]))
    holds, with contact forces up to 15 N
    >>> print(body_equilibrium([], [0, 0, 0, 0, 0, -30.0]))
    cannot hold: there is no contact to resist the motion (-1 vz), the body's twist (omega, v) in the frame of points and
    normals, into which the load puts 30 W
    """
    contacts, edges = _clean(contacts, edges)
    for k, c in enumerate(contacts):
        if c.frame is not None:
            raise FrameError(
                f"contacts[{k}] is at {c.frame!r}, a link of a robot: on one body all points and normals are in the one frame "
                "of its wrench. Give them in that frame, with frame=None, or use robot_equilibrium."
            )
    F = arguments.finite(arguments.one(wrench_on_body, "wrench_on_body (m, f)", 6), "wrench_on_body (m, f)", 6)
    # About the mean contact point, to avoid cancellation in moments of distant contacts.
    points = np.array([c.point for c in contacts]).reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) if len(points) else np.zeros(3)
    maps = [np.vstack([so3.hat(p - middle), np.eye(3)]) for p in points]  # f → (p × f, f)
    about = np.concatenate([F[:3] - np.cross(middle, F[3:]), F[3:]])
    turning = np.arange(6) < 3
    found = _decide(contacts, maps, about, np.zeros(6), turning, edges, TWIST, _OF_A_BODY)
    if found.motion is None:
        return found
    w, v = found.motion[:3], found.motion[3:]
    return _of_size_one(replace(found, motion=np.concatenate([w, v - np.cross(w, middle)])))


def robot_equilibrium(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    *,
    limits: ArrayLike | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
    edges: int = 8,
) -> Equilibrium:
    """Static equilibrium of a robot: decides if contacts and torques within limits hold it at one pose.

    Finds forces in the friction cones with τ = g(q) - Σ J'F_on - Σ J_i' f_i, abs(τ) ≤ limits and 0 on a floating base,
    with the least largest share of a limit. If there are none, finds a motion dq with -τ₀·dq - Σ L abs(dq) > 0 (τ₀ the
    torques without contacts) along which no contact force does negative work. Joints without a limit bear any torque.
    Takes one pose per call (a linear programme).

    Parameters
    ----------
    contacts : sequence of Contact, each at a link of the robot

    Examples
    --------
    >>> import twistwrench as tw
    >>> box = tw.robots.floating_box()
    >>> corners = [Contact((x, y, -0.1), frame=box.link_names[0]) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    >>> print(robot_equilibrium(box, box.neutral, corners).holds)
    True
    """
    contacts, edges = _clean(contacts, edges)
    return _decide(
        contacts, *_balance(robot, q, contacts, limits, wrench_on_robot), edges, robot.model.velocity_names, _OF_A_ROBOT
    )


def least_norm_contact_forces(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    *,
    limits: ArrayLike | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
    edges: int = 8,
) -> Equilibrium:
    """Contact forces of least norm that hold a robot at rest.

    Minimises Σ f_i² over forces within the friction pyramids, with τ = g(q) - Σ J'F_on - Σ J_i' f_i, abs(τ) ≤ limits
    and 0 on a floating base. The solution is unique and continuous in the pose. It exists exactly if
    :func:`robot_equilibrium` holds with pyramids of as many edges.

    Parameters
    ----------
    contacts : sequence of Contact, each at a link of the robot

    Returns
    -------
    found : Equilibrium
        Result of :func:`robot_equilibrium`. If it holds, ``forces`` (contacts, 3) in the base frame, ``torques`` (nv,)
        and ``share`` are those of least norm. [N, N m]

    Examples
    --------
    >>> import twistwrench as tw
    >>> box = tw.robots.floating_box()
    >>> corners = [Contact((x, y, -0.1), frame=box.link_names[0]) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    >>> found = least_norm_contact_forces(box, box.neutral, corners)
    >>> bool(np.allclose(found.forces, found.forces.mean(axis=0)))  # each corner bears a quarter
    True
    """
    contacts, edges = _clean(contacts, edges)
    maps, load, most, turning = _balance(robot, q, contacts, limits, wrench_on_robot)
    found = _decide(contacts, maps, load, most, turning, edges, robot.model.velocity_names, _OF_A_ROBOT)
    if not found.holds:
        return found
    forces = least_norm_forces(contacts, maps, load, most, found.edges)
    if forces is None:  # at the limit of feasibility the forces of the linear programme are the only ones
        return found
    torques = np.where(most == 0, 0.0, -load - sum(M @ f for M, f in zip(maps, forces, strict=True)))
    limited = (most > 0) & np.isfinite(most)
    share = float((np.abs(torques[limited]) / most[limited]).max()) if limited.any() else None
    return replace(found, forces=forces, torques=torques, share=share)


def _balance(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    limits: ArrayLike | None,
    wrench_on_robot: Mapping[str, ArrayLike] | None,
) -> tuple[list[Array], Array, Array, Array]:
    """Maps of contact forces to torques, f → J_point' f; the load, the limits, and a mask of rotational entries."""
    refuse_couplings(robot.model, "robot_equilibrium")
    q = one_configuration(robot, q, "robot_equilibrium", "each pose is a linear programme of its own")
    unloaded = resting_torques(robot, q, wrench_on_robot)
    if unloaded.shape != (robot.nv,) or not np.isfinite(unloaded).all():
        raise ValueRangeError(
            f"wrench_on_robot at {', '.join(wrench_on_robot or ())}: give each frame one wrench (m, f) of six finite numbers."
        )
    maps = []
    for c in contacts:
        J = np.asarray(robot.jacobian(q, c.frame, "world_aligned"))
        arm = np.asarray(robot.forward_kinematics(q, c.frame))[:3, :3] @ c.point
        maps.append((J[3:] - so3.hat(arm) @ J[:3]).T)
    turning = np.array([S[:3].any() for body in robot.model.leaders for S in body.joint.axes], bool)
    return maps, -unloaded, effort_limits(robot, limits), turning


def _clean(contacts: Sequence[Contact], edges: int) -> tuple[tuple[Contact, ...], int]:
    given: Any = contacts
    if not isinstance(given, Iterable):
        raise ValueRangeError(f"contacts is {given!r}. Give a list of statics.Contact.")
    given = tuple(given)
    for k, c in enumerate(given):
        if not isinstance(c, Contact):
            raise ValueRangeError(f"contacts[{k}] is {c!r}. Give a list of statics.Contact.")
        if c.pull or c.push < np.inf:
            raise ValueRangeError(
                f"contacts[{k}] is {c!r}, and this function takes contacts without push and pull. statics.support and "
                "statics.hold count both."
            )
    return given, arguments.whole(edges, "edges", 3)  # cones of fewer edges have no interior


def _decide(
    contacts: Sequence[Contact],
    maps: list[Array],
    load: Array,
    limits: Array,
    turning: Array,
    edges: int,
    names: tuple[str, ...],
    frame: str,
) -> Equilibrium:
    """Refine the cones until forces inside them, or a motion against cones around them, decide.

    Rotational rows are divided by the contacts' lever, so that all rows are in N.
    """
    units = np.where(turning, _lever(maps, load, turning), 1.0)
    scaled, weight, most = [M / units[:, None] for M in maps], load / units, limits / units
    while True:
        found = force_balance(contacts, scaled, weight, most, turning, edges)
        if found is not None:
            forces, share = found
            pushed = sum((M @ f for M, f in zip(maps, forces, strict=True)), np.zeros_like(load))
            torques = np.where(limits == 0, 0.0, -load - pushed)
            return Equilibrium(True, forces, torques, share, None, None, None, edges, names, frame)
        motion, power = unresisted_motion(contacts, scaled, weight, most, edges)
        if motion is not None:
            velocities = np.array([M.T @ motion for M in scaled]).reshape(-1, 3)  # by virtual work
            no = Equilibrium(False, None, None, None, motion / units, velocities, power, edges, names, frame)
            return _of_size_one(no)
        if edges >= _MOST_EDGES:
            return Equilibrium(None, None, None, None, None, None, None, edges, names, frame)
        edges *= 2


def _lever(maps: list[Array], load: Array, turning: Array) -> float:
    """Longest lever of the contacts [m], or of the load if there are no contacts."""
    longest = max((float(np.abs(M[turning]).max(initial=0.0)) for M in maps), default=0.0)
    if longest > 0:
        return longest
    moment, force = (float(np.abs(load[which]).max(initial=0.0)) for which in (turning, ~turning))
    return moment / force if moment > 0 and force > 0 else 1.0


def _of_size_one(no: Equilibrium) -> Equilibrium:
    """Certificate scaled to a largest entry of 1."""
    size = float(np.abs(np.asarray(no.motion)).max())
    motion, velocities = (np.asarray(x) / size + 0.0 for x in (no.motion, no.velocities))
    return replace(no, motion=motion, velocities=velocities, power=float(no.power or 0.0) / size)


# ── Wrench from torques: produced, borne by the structure, and unbalanced

RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest count as zero: the pose is then singular."""


@dataclass(frozen=True, eq=False)
class TorqueWrench:
    """Wrench of a set of torques at rest, with the wrenches and torques that the other side does not determine.

    Balance is τ - g(q) = J' F + ``unbalanced``. Torques do not determine the part that the structure bears: every
    F = ``wrench`` + ``borne`` @ x, for any x (6 - rank), fits equally. ``print`` shows the result as text.
    """

    wrench: Array
    """(6,): smallest wrench (m, f) that fits, by the robot on the world [N m, N]."""
    unbalanced: Array
    """(nv,): the part of τ - g that no wrench at the frame balances; it would set the robot in motion."""
    producible: Array
    """(6, rank): orthonormal basis of the wrenches that torques produce, of least norm; range of J."""
    borne: Array
    """(6, 6 - rank): sparse basis of the wrenches that the structure bears without torque, null space of J'."""
    idle: Array
    """(nv, nv - rank): sparse basis of the joint motions that leave the frame at rest, null space of J."""
    singular_values: Array
    """Singular values of J with lengths in units of ``length``, descending."""
    gravity: Array
    """(nv,): g(q), subtracted first; use ``robot.with_gravity((0, 0, 0))`` to exclude it."""
    joint_names: tuple[str, ...]
    """Names of the joints."""
    frame: str
    """Frame of application of the wrench."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""
    length: float
    """Characteristic length that relates moments to forces [m]."""
    size: float
    """Largest given torque, the scale of rounding errors [N m or N]."""

    @property
    def rank(self) -> int:
        """Number of independent wrenches that torques can produce."""
        return self.producible.shape[1]

    @property
    def balanced(self) -> bool:
        """True if the wrench balances the torques to within 1e-9 of them."""
        return bool(np.abs(self.unbalanced).max(initial=0.0) <= 1e-9 * self._torques)

    @property
    def _torques(self) -> float:
        return self.size + float(np.abs(self.gravity).max(initial=0.0))

    def __str__(self) -> str:
        return "\n".join(self._sentences())

    def _sentences(self) -> Iterator[str]:
        rounding = 1e-13 * self._torques / (self.singular_values[self.rank - 1] if self.rank else 1.0)
        yield f"wrench at {self.frame} ({self.kind}): {_combination(self.wrench, WRENCH, 'none', rounding)}"
        n = len(self.joint_names)
        singular = f", a singular pose (rank {self.rank} of {min(6, n)})" if self.rank < min(6, n) else ""
        yield f"{n} joints make {self.rank} independent wrenches{singular}"
        for column in self.borne.T:
            yield f"borne by the structure: {_combination(column, WRENCH)}"
        for column in self.idle.T:
            yield f"moves nothing there: {_combination(column, self.joint_names)}"
        if not self.balanced:
            yield f"no wrench balances: {_combination(self.unbalanced, self.joint_names)}"


def wrench_from_torques(
    robot: Robot, q: ArrayLike, tau: ArrayLike, frame: str | None = None, *, kind: Kind = "body", length: float = 1.0
) -> TorqueWrench:
    r"""Wrench from joint torques: the wrench that the robot at rest applies at a frame with torques ``tau``.

    Solves τ - g(q) = J' F by singular values, MR eq. 5.26, section 5.2, also at singular poses and for any number of
    joints. If several wrenches fit, the one with the least \|f\|² + \|m\|² / length² is returned. The range and null
    space do not depend on ``length``. Takes one state per call, as the rank depends on the pose.

    Parameters
    ----------
    length : float, by which moments and forces are compared [m]

    Returns
    -------
    found : TorqueWrench, ``wrench`` (6,) and its company

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r().with_gravity((0, 0, 0))
    >>> found = wrench_from_torques(arm, [0.0, np.pi / 2], [1.0, 1.0], kind="world_aligned")
    >>> found.rank, found.balanced
    (2, True)
    >>> stretched = wrench_from_torques(arm, [0.0, 0.0], [2.0, 1.0])
    >>> bool(np.allclose(arm.wrench_torques([0.0, 0.0], stretched.wrench), [2.0, 1.0]))
    True
    """
    q = one_configuration(robot, q, "wrench_from_torques", "the rank of J differs from pose to pose")
    tau = arguments.one(tau, "wrench_from_torques: tau", robot.nv, names=robot.model.velocity_names)
    tau = arguments.finite(tau, "wrench_from_torques: tau")
    length = arguments.positive(length, "length [m]")
    g = np.asarray(robot.holding_torques(q))  # includes springs of elastic joints
    J = np.asarray(robot.jacobian(q, frame, kind))
    rank, U, Vt, rows, columns = _equilibrated(J)
    scale = np.array([length] * 3 + [1.0] * 3)  # J_w * length and J_v are both in m
    idle = columns[:, None] * Vt[rank:].T
    borne = rows[:, None] * U[:, rank:]
    lost = np.linalg.qr(idle)[0]
    unbalanced = lost @ (lost.T @ (tau - g))
    # The wrench of least norm in the metric of ``length``: any solution minus its part in the null space.
    B = rows[:, None] * J * columns
    F = rows * np.linalg.lstsq(B.T, columns * (tau - g - unbalanced), rcond=RANK_TOLERANCE)[0]
    free = np.linalg.qr(borne / scale[:, None])[0]
    F = F - scale * (free @ (free.T @ (F / scale)))
    return TorqueWrench(
        wrench=F,
        unbalanced=unbalanced,
        producible=np.linalg.qr((scale**2 / rows)[:, None] * U[:, :rank])[0],
        borne=_sparse_basis(borne),
        idle=_sparse_basis(idle),
        singular_values=np.linalg.svd(scale[:, None] * J, compute_uv=False),
        gravity=g,
        joint_names=robot.model.velocity_names,
        frame=str(robot.tip if frame is None else frame),
        kind=kind,
        length=length,
        size=float(np.abs(tau).max(initial=0.0)),
    )


def _equilibrated(J: Array) -> tuple[int, Array, Array, Array, Array]:
    """Rank of J (6, nv), U and V' of R J C by singular values, and the diagonals of R and C, which equilibrate J.

    R divides rotational rows by the longest lever of a revolute joint, so that ranks do not depend on the robot's size.
    C scales every joint to the same effect on the frame.
    """
    turn, move = (np.linalg.norm(part, axis=0) for part in (J[:3], J[3:]))
    lever = np.max(move[turn > 0] / turn[turn > 0], initial=0.0)
    rows = np.array([lever or 1.0] * 3 + [1.0] * 3)
    moves = np.linalg.norm(rows[:, None] * J, axis=0)
    felt = moves > RANK_TOLERANCE**1.5 * moves.max(initial=0.0)
    columns = 1.0 / np.where(felt, moves, moves.max(initial=0.0) or 1.0)
    U, s, Vt = np.linalg.svd(rows[:, None] * J * columns)
    return int(np.sum(s > RANK_TOLERANCE * s.max(initial=0.0))), U, Vt, rows, columns


def _sparse_basis(B: Array) -> Array:
    """Sparse basis (n, k) of the same space by elimination, each column's largest entry 1."""
    rows = B.T.copy()
    for k in range(len(rows)):
        r, c = divmod(int(np.argmax(np.abs(rows[k:]))), rows.shape[1])
        rows[[k, k + r]] = rows[[k + r, k]]
        rows[k] /= rows[k, c]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, c] * rows[k]
                rows[other, c] = 0.0
    rows[np.abs(rows) < 1e-12] = 0.0  # relative to the pivot 1 of each row
    peaks = rows[np.arange(len(rows)), np.argmax(np.abs(rows), axis=1)] if rows.size else np.ones(len(rows))
    return (rows / peaks[:, None]).T


def _combination(x: Array, names: tuple[str, ...], nothing: str = "nothing", least: float = 0.0) -> str:
    """Linear combination as text, without rounding errors: ``0.5 mx − 2 fz``."""
    least = max(least, 1e-9 * float(np.abs(x).max(initial=0.0)))
    shown = [(v, n) for v, n in zip(x, names, strict=True) if abs(v) > least]
    if not shown:
        return nothing
    words = [f"{'-' if v < 0 else '+'} {'' if abs(abs(v) - 1) < 1e-9 else f'{number(abs(v))} '}{n}" for v, n in shown]
    return " ".join(words).removeprefix("+ ").replace("-", "−")


# ── Joint stops: positions beyond the limits


@dataclass(frozen=True)
class BeyondStop:
    """Joint outside its position limits."""

    joint: str
    """Name of the joint."""
    value: float
    """rad or m."""
    stop: float
    """Nearest position within the limits [rad or m]."""
    turns: bool
    """True for a revolute joint, False for a prismatic joint."""

    @property
    def by(self) -> float:
        """Excess over the limit [rad or m], above zero."""
        return abs(self.value - self.stop)


def joints_beyond_stops(robot: Robot, q: Array, limits: Limits | None = None) -> tuple[BeyondStop, ...]:
    """Joints of one pose (nq,) outside the robot's or the given position limits, in descending order of excess."""
    limits = robot.limits if limits is None else limits
    beyond = limits.exceeded(robot.model.positions(q))
    found = []
    for b in robot.model.leaders:
        if b.joint.nq == 1 and beyond[b.v_index]:  # ball, planar and floating joints have no stops
            value, low, high = float(q[b.q_index]), float(limits.lower[b.v_index]), float(limits.upper[b.v_index])
            stop = low if value < low else high
            found.append(BeyondStop(b.joint.name, value, stop, bool(b.joint.axes[0][:3].any())))
    return tuple(sorted(found, key=lambda f: -f.by))


complete(globals())
