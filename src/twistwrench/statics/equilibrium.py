"""Whether contacts can hold a body or a robot at rest: forces that do, or a motion that proves none can."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import number, percent, printed
from ..errors import FrameError, ValueRangeError
from ..screws.component_names import TWIST
from ..typing import Array
from .contacts import Contact
from .force_balance import force_balance, unresisted_motion
from .pose_arguments import one_configuration
from .torque_limits import effort_limits, resting_torques

if TYPE_CHECKING:
    from ..robot import Robot

_OF_A_BODY = "the body's twist (omega, v) in the frame of points and normals"
_OF_A_ROBOT = "joint velocities dq, of a floating base its twist in its own frame"
_MOST_EDGES = 512


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    r"""Static equilibrium with its proof: contact forces and torques that balance, or a motion nothing resists.

    Contacts push and never pull. So if along some motion no contact can take power out, and the loads put in more than
    the motors can take out, then no forces balance: in balance all powers along every motion add up to zero. That
    motion, the certificate, is the proof of a no, and two lines check it by hand: at each contact n · v ≥ μ \|v - n (n ·
    v)\|, with v its row of ``velocities``, n its normal; and ``power`` > 0, for one body F · V of its wrench F = (m, f)
    and V = ``motion``.
    """

    holds: bool | None
    """Whether forces balance; None where the friction cones, cut into as many edges as they may be, decide neither way:
    the case is then marginal, within one part in 10⁴ of the friction coefficients."""
    forces: Array | None
    """(contacts, 3) N on the body: in its frame, or for a robot in the base frame; None unless it holds."""
    torques: Array | None
    """(nv,) of the joints, 0 for floating ones; (6,) zeros for a body; None unless it holds."""
    share: float | None
    """The largest share of a torque limit, made as small as can be; None unless it holds by torques with limits."""
    motion: Array | None
    """(nv,) or (6,): the certificate, dq or the body's twist V, largest entry 1; None unless it cannot hold.

    V is as well a direction in the space of wrenches: all that contacts can apply have F · V ≥ 0, rest needs F · V < 0."""
    velocities: Array | None
    """(contacts, 3) m/s: of the contact points in that motion, in the frame of the normals; None unless it cannot hold."""
    power: float | None
    """W: what the loads put into that motion beyond all that the motors could take out, with contacts adding at least 0."""
    edges: int
    """How many edges the friction cones had."""
    names: tuple[str, ...]
    """Of the entries of ``motion``."""
    frame: str
    """What ``motion`` is, and in which frame."""

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
    """Force closure of one body: whether contacts can balance a wrench on it.

    Parameters
    ----------
    contacts : sequence of Contact, in the frame of the wrench
    wrench_on_body : (6,) array_like, (m, f) [N m, N]
    edges : int, edges of each friction cone to begin with

    Returns
    -------
    answer : Equilibrium

    Raises
    ------
    ShapeError, ValueRangeError
        An argument is of another size or not finite.
    FrameError
        A contact has a ``frame``: that is a link of a robot, and its normal in the base frame.

    Notes
    -----
    MR section 12.2. Forces f_i in the friction cones with Σ (p_i × f_i, f_i) + F = 0, or by Farkas' lemma a twist V
    with F·V > 0 along which no contact force does negative work. One wrench at a time, as each is a linear programme.

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
                "of its wrench. Give them in that frame, with frame=None, or ask robot_equilibrium."
            )
    F = arguments.finite(arguments.one(wrench_on_body, "wrench_on_body (m, f)", 6), "wrench_on_body (m, f)", 6)
    # About the middle of the contacts, lest far away a moment be the small difference of large ones.
    points = np.array([c.point for c in contacts]).reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) if len(points) else np.zeros(3)
    maps = [np.vstack([_hat(p - middle), np.eye(3)]) for p in points]  # f → (p × f, f)
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
    """Static equilibrium of a robot: whether it holds itself at one pose by contacts and by torques within limits.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    contacts : sequence of Contact, each at a link of the robot
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]
    wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
    edges : int, edges of each friction cone to begin with

    Returns
    -------
    answer : Equilibrium

    Raises
    ------
    ShapeError
        An argument is of another size, or q is a batch; it says how to loop.
    ValueRangeError, UnknownNameError, FrameError
        An argument is invalid, or the robot has no such frame.

    Notes
    -----
    Forces in the friction cones with τ = g(q) - Σ J'F_on - Σ J_i' f_i, abs(τ) ≤ limits, 0 on a floating base, and the
    largest share of a limit made least; or a motion dq with -τ₀·dq - Σ L abs(dq) > 0 (τ₀ the torques without contacts)
    along which no contact force does negative work. Joints without a limit bear anything. One pose at a time, as each
    is a linear programme of its own.

    Examples
    --------
    >>> import twistwrench as tw
    >>> box = tw.robots.floating_box()
    >>> corners = [Contact((x, y, -0.1), frame=box.link_names[0]) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    >>> print(robot_equilibrium(box, box.neutral, corners).holds)
    True
    """
    contacts, edges = _clean(contacts, edges)
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
        maps.append((J[3:] - _hat(arm) @ J[:3]).T)  # f → J_point' f
    turning = np.array([S[:3].any() for body in robot.model.leaders for S in body.joint.axes], bool)
    torques = effort_limits(robot, limits)
    return _decide(contacts, maps, -unloaded, torques, turning, edges, robot.model.velocity_names, _OF_A_ROBOT)


def _clean(contacts: Sequence[Contact], edges: int) -> tuple[tuple[Contact, ...], int]:
    given: Any = contacts
    if not isinstance(given, Iterable):
        raise ValueRangeError(f"contacts is {given!r}. Give a list of statics.Contact.")
    given = tuple(given)
    for k, c in enumerate(given):
        if not isinstance(c, Contact):
            raise ValueRangeError(f"contacts[{k}] is {c!r}. Give a list of statics.Contact.")
    return given, arguments.whole(edges, "edges", 3)  # cones of fewer have no inside


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
    """Cut the cones ever finer until forces inside them, or a motion against cones around them, settle it.

    The ``turning`` rows are worked on as forces at the length of the contacts' levers, so that all rows are in N.
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
    """The longest lever of the contacts [m], or without one that of the load."""
    longest = max((float(np.abs(M[turning]).max(initial=0.0)) for M in maps), default=0.0)
    if longest > 0:
        return longest
    moment, force = (float(np.abs(load[which]).max(initial=0.0)) for which in (turning, ~turning))
    return moment / force if moment > 0 and force > 0 else 1.0


def _of_size_one(no: Equilibrium) -> Equilibrium:
    """The certificate with its largest entry 1, whatever the units it was found in."""
    size = float(np.abs(np.asarray(no.motion)).max())
    motion, velocities = (np.asarray(x) / size + 0.0 for x in (no.motion, no.velocities))
    return replace(no, motion=motion, velocities=velocities, power=float(no.power or 0.0) / size)


def _hat(p: Array) -> Array:
    from ..lie import so3

    return np.asarray(so3.hat(p))
