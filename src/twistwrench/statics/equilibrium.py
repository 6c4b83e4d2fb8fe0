"""Equilibrium of a body or robot in contact, and joint stops."""

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
from ..mechanics.lie.labelled import TWIST
from ..mechanics.model.couplings import refuse_couplings
from .arguments import one_configuration
from .cone_programme import ForceBounds, cone_programme, least_norm_in_cones, two_sided
from .contacts import Contact, cones_of, contact_maps, refuse_loops
from .torque_limits import effort_limits, resting_torques

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot

_BODY_MOTION = "the body's twist (omega, v) in the frame of points and normals"
"""Meaning of the motion of a body."""
_ROBOT_MOTION = "joint velocities dq, of a floating base its twist in its own frame"
"""Meaning of the motion of a robot."""
_MIN_POWER = 1e-9
"""Power of a motion of size 1, as a share of the largest load, above which the motion proves that no forces balance."""
_MAX_RESIDUAL = 1e-6
"""Largest residual of the load, relative to the forces, that counts as balanced; checked before a positive result."""
_ROUNDING = 1e-14
"""Rounding tolerance relative to the sum of all contact loads. With short levers this sum may far exceed the load."""
_EXCESS_SHARE = 1e-6
"""Excess, relative to the least largest share of a limit, that forces of least norm may use."""
_MIN_EXCESS = _EXCESS_SHARE * _EXCESS_SHARE
"""Absolute excess that they may use in addition, for a least share of zero."""
_MIN_SHOWN_VELOCITY = 1e-6
"""Entry of a motion with a largest entry of 1 above which it is printed."""


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    r"""Static equilibrium with its proof: contact forces and torques that balance, or a motion without resistance.

    Contacts push but do not pull. In equilibrium the powers along every motion add up to zero. Suppose that along some
    motion no contact can absorb power and the loads supply more than the motors can absorb. Then no forces balance.
    This motion, the certificate, proves that the body cannot hold.

    The certificate can be checked by hand. At each contact n · v ≥ μ \|v - n (n · v)\|, with v its row of ``velocities``
    and n its normal; only a contact with a finite ``push`` may approach. Moreover ``power`` > 0. For one body without
    ``push`` and ``pull``, it is F · V of its wrench F = (m, f) and V = ``motion``.
    """

    holds: bool | None
    """True if forces balance; None if rounding prevents an answer."""
    forces: Array | None
    """(contacts, 3) N on the body in its frame, or on the robot in the base frame; None unless it holds."""
    torques: Array | None
    """(nv,) joint torques, 0 for floating joints; (6,) zeros for a body; None unless it holds."""
    share: float | None
    """Largest share of a torque limit, minimised; None unless it holds by torques with limits."""
    motion: Array | None
    """(nv,) or (6,): the certificate, dq or the body's twist V, largest entry 1; None unless it cannot hold.

    V is also a direction in wrench space: all wrenches of the contacts have F · V ≥ 0, while rest requires F · V < 0.
    """
    velocities: Array | None
    """(contacts, 3) m/s: velocities of the contact points, in the frame of the normals; None unless it cannot hold."""
    power: float | None
    """Excess of the loads' power in that motion over the most that motors and contacts can absorb [W]."""
    names: tuple[str, ...]
    """Names of the entries of ``motion``."""
    frame: str
    """Meaning of ``motion`` and its frame."""

    def __repr__(self) -> str:
        return f"Equilibrium: {self}"

    def __str__(self) -> str:
        if self.holds:
            forces = np.asarray(self.forces)
            largest_force = np.linalg.norm(forces, axis=1).max(initial=0.0)
            text = f"holds, with contact forces up to {number(largest_force)} N"
            if self.share is not None:
                text += f", torques up to {percent(self.share, 3)} of their limits"
            return text
        if self.holds is None:
            return "marginal: within rounding, neither forces nor a motion are found"
        entries = []
        for velocity, name in zip(np.asarray(self.motion), self.names, strict=True):
            if abs(velocity) > _MIN_SHOWN_VELOCITY:
                entries.append(f"{printed(velocity, 3, signed=True)} {name}")
        has_contacts = len(np.asarray(self.velocities)) > 0
        subject = "no contact resists" if has_contacts else "there is no contact to resist"
        return (
            f"cannot hold: {subject} the motion ({', '.join(entries)}), {self.frame}, "
            f"into which the load puts {number(self.power)} W"
        )


def body_equilibrium(contacts: Sequence[Contact], wrench_on_body: ArrayLike) -> Equilibrium:
    """Force closure of one body: decides if contacts can balance a wrench on it (MR section 12.2).

    Finds forces f_i in the friction cones with Σ (p_i × f_i, f_i) + F = 0. If there are none, by Farkas' lemma a twist
    V exists with F·V > 0 along which no contact force does negative work. Takes one wrench per call; :func:`hold` takes
    many, with margins. The forces are those of least norm.

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
    contacts = _check_contacts(contacts)
    for k, contact in enumerate(contacts):
        if contact.frame is not None:
            raise FrameError(
                f"contacts[{k}] is at {contact.frame!r}, a link of a robot: on one body all points and normals are in the "
                "one frame of its wrench. Give them in that frame, with frame=None, or use robot_equilibrium."
            )
    single_wrench = arguments.one(wrench_on_body, "wrench_on_body (m, f)", 6)
    F = arguments.finite(single_wrench, "wrench_on_body (m, f)", 6)
    # Moments are about the middle of the contacts, to avoid cancellation in those of distant contacts.
    points = np.array([contact.point for contact in contacts]).reshape(-1, 3)
    middle = np.zeros(3)
    if len(points):
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    contact_matrices = [np.vstack([so3.hat(p - middle), np.eye(3)]) for p in points]  # f → (p × f, f)
    maps = np.array(contact_matrices).reshape(-1, 6, 3)  # also without contacts
    m, f = F[:3], F[3:]
    F_at_middle = np.concatenate([m - np.cross(middle, f), f])
    is_moment = np.arange(6) < 3
    no_motors = np.zeros(6)
    system = _System(contacts, maps.swapaxes(0, 1), F_at_middle, no_motors, is_moment)
    result = system.decide(TWIST, _BODY_MOTION)
    if result.motion is None:
        return result
    w, v = result.motion[:3], result.motion[3:]
    V = np.concatenate([w, v - np.cross(w, middle)])  # of the point at the origin
    return _normalize(replace(result, motion=V))


def robot_equilibrium(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    *,
    limits: ArrayLike | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
) -> Equilibrium:
    """Static equilibrium of a robot: decides if contacts and torques within limits hold it at one pose.

    Finds forces in the friction cones with τ = g(q) - Σ J'F_on - Σ J_i' f_i, abs(τ) ≤ limits and 0 on a floating base,
    with the least largest share of a limit. If there are none, finds a motion dq with -τ₀·dq - Σ L abs(dq) > 0 (τ₀ the
    torques without contacts) along which no contact force does negative work. Joints without a limit bear any torque.
    Takes one pose per call; :func:`support` takes motions, with margins.

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
    system = _robot_system(robot, q, contacts, limits, wrench_on_robot)
    return system.decide(robot.model.velocity_names, _ROBOT_MOTION)


def least_norm_contact_forces(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    *,
    limits: ArrayLike | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
) -> Equilibrium:
    """Contact forces of least norm that hold a robot at rest.

    Minimises Σ f_i² over forces within the friction cones, with τ = g(q) - Σ J'F_on - Σ J_i' f_i, abs(τ) ≤ limits
    and 0 on a floating base. The solution is unique and continuous in the pose. It exists exactly if
    :func:`robot_equilibrium` holds.

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
    system = _robot_system(robot, q, contacts, limits, wrench_on_robot)
    return system.decide(robot.model.velocity_names, _ROBOT_MOTION, share=1.0)


def _robot_system(
    robot: Robot,
    q: ArrayLike,
    contacts: Sequence[Contact],
    limits: ArrayLike | None,
    wrench_on_robot: Mapping[str, ArrayLike] | None,
) -> _System:
    """Balance of a robot at one pose; raises errors for robots with loops or couplings, and for bad arguments."""
    refuse_loops(robot, "robot_equilibrium")
    refuse_couplings(robot.model, "robot_equilibrium")
    contacts = _check_contacts(contacts)
    q = one_configuration(robot, q, "robot_equilibrium", "each pose is decided on its own")  # reason of the refusal
    with np.errstate(invalid="ignore"):  # of infinite wrenches, which are refused below
        unloaded = resting_torques(robot, q, wrench_on_robot)
    if unloaded.shape != (robot.nv,) or not np.isfinite(unloaded).all():
        raise ValueRangeError(
            f"wrench_on_robot at {', '.join(wrench_on_robot or ())}: give each frame one wrench (m, f) of six finite numbers."
        )
    maps, _ = contact_maps(robot, q[None], contacts)
    is_moment = np.array([S[:3].any() for body in robot.model.leaders for S in body.joint.axes], bool)
    return _System(contacts, maps[0], -unloaded, effort_limits(robot, limits), is_moment)


def _check_contacts(contacts: Sequence[Contact]) -> tuple[Contact, ...]:
    """Contacts as a tuple; raises ValueRangeError for anything else."""
    argument: Any = contacts
    if not isinstance(argument, Iterable):
        raise ValueRangeError(f"contacts is {argument!r}. Give a list of statics.Contact.")
    checked_contacts = tuple(argument)
    for k, contact in enumerate(checked_contacts):
        if not isinstance(contact, Contact):
            raise ValueRangeError(f"contacts[{k}] is {contact!r}. Give a list of statics.Contact.")
    return checked_contacts


class _System:
    """Balance τ + load + Σ G_i f_i = 0 of m entries with abs(τ) ≤ limits.

    Moments are divided by a lever, so that all entries are in N. The forces of the solver are added to the preloads of the
    contacts.
    """

    def __init__(
        self, contacts: tuple[Contact, ...], maps: Array, load: Array, limits: Array, is_moment: Array
    ) -> None:
        self.levers = np.where(is_moment, _lever(maps, load, is_moment), 1.0)
        """(m,) divisor of each entry: the lever [m] of moments, 1 of forces."""
        self.maps = maps / self.levers[:, None, None]
        """(m, contacts, 3): G_i."""
        self.load = load / self.levers
        self.limits = limits / self.levers
        self.is_moment = is_moment
        self.cones, self.pushes = cones_of(contacts)
        pulls = np.array([contact.pull for contact in contacts])
        self.preload = -pulls[:, None] * self.cones.normals
        """(contacts, 3) force of each contact without the solver's."""
        self.load_with_preload = self.load + np.einsum("mck,ck->m", self.maps, self.preload)
        self.is_undriven = self.limits == 0
        self.is_limited = (self.limits > 0) & np.isfinite(self.limits)

    def decide(self, names: tuple[str, ...], frame: str, share: float = 0.0) -> Equilibrium:
        """Forces of least norm, or a motion without resistance.

        The largest share of a limit that torques may have is the least possible one, or ``share`` if that is larger.
        """
        # The only programme has index 0.
        least = cone_programme(
            self.cones, self.maps[None, self.is_undriven], -self.load_with_preload[None, self.is_undriven],
            bounds=self._bounds(self.is_limited, np.zeros_like(self.limits), self.limits), sense="least",
        )  # fmt: skip
        if least.settled[0] and least.s[0] <= 1.0 + _ROUNDING:
            least_share = float(least.s[0]) * (1.0 + _EXCESS_SHARE) + _MIN_EXCESS
            # Forces of least norm if they are found and balance, otherwise those of the least share.
            for added_forces in (*self._least_norm(max(least_share, share)), least.forces[0]):
                forces = added_forces + self.preload
                torques = self._torques(forces)
                if torques is None:
                    continue
                shares = np.abs(torques / self.levers)[self.is_limited] / self.limits[self.is_limited]
                largest_share = float(shares.max()) if shares.size else None
                return Equilibrium(
                    holds=True, forces=forces, torques=torques, share=largest_share,
                    motion=None, velocities=None, power=None, names=names, frame=frame,
                )  # fmt: skip
        motion, power = self._unresisted_motion()
        largest_load = float(np.abs(self.load).max(initial=0.0))
        least_size = float(np.abs(motion).max()) * 1e-300  # without load, the power must be above zero
        if not power > _MIN_POWER * max(largest_load, least_size):
            return Equilibrium(
                holds=None, forces=None, torques=None, share=None,
                motion=None, velocities=None, power=None, names=names, frame=frame,
            )  # fmt: skip
        velocities = np.einsum("mck,m->ck", self.maps, motion)  # by virtual work
        proof = Equilibrium(
            holds=False, forces=None, torques=None, share=None,
            motion=motion / self.levers, velocities=velocities, power=power, names=names, frame=frame,
        )  # fmt: skip
        return _normalize(proof)

    def _bounds(self, rows: Array, bounds_at_zero: Array, rates: Array) -> ForceBounds:
        """Bounds abs(load + Σ G_i f_i) ≤ bounds_at_zero + s rates of some entries, followed by the contacts' largest pushes."""
        torque_bounds = two_sided(
            self.maps[None, rows], self.load_with_preload[None, rows], bounds_at_zero[None, rows], rates[None, rows]
        )
        return torque_bounds.concatenate(self.pushes)

    def _least_norm(self, share: float) -> Iterator[Array]:
        """Forces of least norm with a share of the limits, (contacts, 3); nothing if they are not found."""
        bounds = self._bounds(self.is_limited, share * self.limits, np.zeros_like(self.limits))
        all_contacts = np.ones((1, self.maps.shape[1]), bool)
        maps = self.maps[None, self.is_undriven]
        balanced_load = -self.load_with_preload[None, self.is_undriven]
        forces, is_solved = least_norm_in_cones(self.cones, maps, balanced_load, all_contacts, bounds)
        if is_solved[0]:
            yield forces[0]

    def _torques(self, forces: Array) -> Array | None:
        """Torques (nv,) that balance contact forces; None if the residual is larger than rounding explains."""
        contact_torque = np.einsum("mck,ck->m", self.maps, forces)
        residual = np.abs(self.load + contact_torque)
        largest_load = float(np.abs(self.load[self.is_undriven]).max(initial=0.0))
        largest_force = float(np.abs(self.load[self.is_undriven & ~self.is_moment]).max(initial=0.0))
        if largest_force == 0.0:
            largest_force = largest_load
        scale = np.where(self.is_moment, largest_load, largest_force)
        allowed_residual = np.where(self.is_undriven, _MAX_RESIDUAL * scale, (1.0 + _MAX_RESIDUAL) * self.limits)
        sum_of_magnitudes = np.einsum("mck,ck->m", np.abs(self.maps), np.abs(forces)) + np.abs(self.load)
        if (residual > allowed_residual + _ROUNDING * sum_of_magnitudes).any():
            return None
        torques = -(self.load + contact_torque)
        return np.where(self.is_undriven, 0.0, torques) * self.levers

    def _unresisted_motion(self) -> tuple[Array, float]:
        """Motion that the load drives most against all torques and contacts, and its power.

        The sum of the magnitudes of its entries is 1. The entries are the prices of the bounds in the programme of the
        least t with abs(load + Σ G_i f_i) ≤ limits + t.
        """
        has_limit = np.isfinite(self.limits)  # a joint without limit resists any motion of its own
        no_maps = np.zeros((1, 0, *self.maps.shape[1:]))
        no_load = np.zeros((1, 0))
        growing_bounds = self._bounds(has_limit, self.limits, np.ones_like(self.limits))
        optimum = cone_programme(self.cones, no_maps, no_load, no_load, bounds=growing_bounds, sense="least")
        entry_count = int(has_limit.sum())
        prices = optimum.bound_prices[0]  # of the upper bounds, the lower bounds, and the pushes
        motion = np.zeros(len(self.load))
        motion[has_limit] = prices[:entry_count] - prices[entry_count : 2 * entry_count]
        v = np.einsum("mck,m->ck", self.maps, motion)  # of the contact points, by virtual work
        rise = (v * self.cones.normals).sum(axis=1)
        slip = np.linalg.norm(v - rise[:, None] * self.cones.normals, axis=1)
        approach = self.cones.friction * slip - rise
        pushed_contacts = np.einsum("kcx,cx->kc", self.pushes.maps[0], self.cones.normals)  # 1 where a push is bounded
        push_power = (pushed_contacts * np.maximum(approach, 0.0)).max(axis=1, initial=0.0) @ self.pushes.most[0]
        pull_power = -(self.preload * v).sum()
        motor_power = np.where(has_limit, self.limits, 0.0) @ np.abs(motion)
        power = float(self.load @ motion - motor_power - push_power - pull_power)
        return motion + 0.0, power  # + 0.0 turns -0.0 into 0.0


def _lever(maps: Array, load: Array, is_moment: Array) -> float:
    """Longest lever of the contacts [m]; without contacts, moment over force of the load; 1 if that is not defined."""
    longest_lever = float(np.abs(maps[is_moment]).max(initial=0.0))
    if longest_lever > 0:
        return longest_lever
    moment = float(np.abs(load[is_moment]).max(initial=0.0))
    force = float(np.abs(load[~is_moment]).max(initial=0.0))
    if moment > 0 and force > 0:
        return moment / force
    return 1.0


def _normalize(proof: Equilibrium) -> Equilibrium:
    """Equilibrium with its motion, a certificate, scaled to a largest entry of 1."""
    size = float(np.abs(np.asarray(proof.motion)).max())
    motion = np.asarray(proof.motion) / size + 0.0  # + 0.0 turns -0.0 into 0.0
    velocities = np.asarray(proof.velocities) / size + 0.0
    power = float(proof.power or 0.0) / size
    return replace(proof, motion=motion, velocities=velocities, power=power)


# ── Joint stops: positions beyond the limits


@dataclass(frozen=True)
class BeyondStop:
    """Joint outside its position limits."""

    joint: str
    """Name of the joint."""
    value: float
    """Position [rad or m]."""
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
    if limits is None:
        limits = robot.limits
    is_beyond = limits.exceeded(robot.model.positions(q))
    joints_beyond: list[BeyondStop] = []
    for body in robot.model.leaders:
        joint = body.joint
        if joint.nq == 1 and is_beyond[body.v_index]:  # ball, planar and floating joints have no stops
            value = float(q[body.q_index])
            low = float(limits.lower[body.v_index])
            high = float(limits.upper[body.v_index])
            stop = low if value < low else high
            turns = bool(joint.axes[0][:3].any())
            joints_beyond.append(BeyondStop(joint.name, value, stop, turns))
    return tuple(sorted(joints_beyond, key=lambda joint: -joint.by))


complete(globals())
