"""Contact forces of a motion, and margins in speed, payload and friction: feet, wheels, bolts, fingers and suction cups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import FrameError, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import so3
from ..mechanics.model.couplings import refuse_couplings
from ..robot.base import require_robot
from .balance import Balance, BalanceSolution
from .cone_programme import cone_programme
from .contacts import Contact, cones_of, contact_maps, contacts_of, refuse_loops
from .torque_limits import effort_limits, floating_entries
from .zero_moment_point import zero_moment_point

if TYPE_CHECKING:
    from ..robot import Robot


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
    """(n,): mass that can be added [kg], negative if mass must be removed; NaN without a frame of the payload."""
    friction: Array
    """(n,): least coefficient of friction that holds, the largest of all contacts; inf if no friction suffices."""
    zmp: Array
    """(n, 2): zero moment point in the plane of the contacts [m]; NaN without one plane."""
    zmp_margin: Array
    """(n,): distance of the zero moment point from the edge of the support polygon, negative outside [m]."""
    motion: Array
    """(n, nv) for robots, (n, 6) for one body: motion that no contact resists, largest entry 1; NaN where it holds."""
    power: Array
    """(n,): power of the load in that motion [W]; NaN where it holds."""
    contacts: tuple[Contact, ...]
    """Contacts as given."""
    least_norm: Array
    """(n,) of bool: True if ``forces`` are those of least norm. False if it does not hold, and for loads that only just hold:
    smaller forces may then balance."""

    @property
    def worst(self) -> int:
        """Row with the least factor of the speed; if poses cannot be held even at rest, the first of these rows."""
        fails_at_rest = ~self.holds & np.isnan(self.speed)
        if fails_at_rest.any():
            return int(np.argmax(fails_at_rest))  # the first
        known_speeds = np.where(np.isnan(self.speed), np.inf, self.speed)
        return int(np.argmin(known_speeds))

    def __repr__(self) -> str:
        return f"Support: {self}"

    def __str__(self) -> str:
        if not self.decided.all():
            undecided_count = int((~self.decided).sum())
            return f"undecided at {undecided_count} of {len(self.holds)} rows"
        max_speed = float(self.speed[self.worst])  # factor of the speed
        if not self.holds.all():
            first_failure = int(np.argmin(self.holds))  # argmin: the first False
            margin_text = ""
            if not np.isnan(max_speed):
                margin_text = f"; it holds up to {number(max_speed, 3)} × this speed"
            return f"{self.how[first_failure]} at row {first_failure} of {len(self.holds)}{margin_text}"
        needed_friction = float(self.friction.max(initial=0.0))
        additional_mass = float(self.payload.min(initial=np.inf))
        text = "holds without friction"
        if needed_friction > 0:
            text = f"holds with friction {number(needed_friction, 3)}"
        margins = []
        if np.isfinite(max_speed):
            margins.append(f"up to {number(max_speed, 3)} × this speed")
        if np.isfinite(additional_mass):
            margins.append(f"{number(additional_mass, 3)} kg more")
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
    robot = require_robot(robot, "support")
    refuse_couplings(robot.model, "support")
    contacts = contacts_of(contacts)
    is_base = floating_entries(robot)  # mask (nv,) of the velocities of the free base
    if not is_base.any():
        raise ValueRangeError(
            f"the base of robot {robot.name!r} is fixed, so that contacts carry nothing. Load it with floating_base=True."
        )
    q, dq, ddq = _state_rows(robot, q, dq, ddq)
    tau = _torques(robot, q, dq, ddq, wrench_on_robot)
    holding_torques = _torques(robot, q, 0.0 * dq, 0.0 * ddq, wrench_on_robot)
    maps, points = contact_maps(robot, q, contacts)
    load_per_kilogram = None
    if payload_frame is not None:
        robot_with_kilogram = robot.with_payload(SpatialInertia.from_com(1.0, payload_com), payload_frame)
        tau_with_kilogram = _torques(robot_with_kilogram, q, dq, ddq, wrench_on_robot)
        load_per_kilogram = (tau_with_kilogram - tau)[:, is_base]
    screw_axes = np.concatenate([body.joint.axes for body in robot.model.leaders])  # (nv, 6)
    turns = np.asarray(screw_axes[:, :3].any(axis=1))
    balance = Balance(
        contacts,
        maps[:, is_base],
        tau[:, is_base],
        holding_torques[:, is_base],
        load_per_kilogram,
        turns[is_base],
        in_contact,
    )
    solution = balance.solve()
    if limits is not None:
        max_torques = np.where(is_base, np.inf, effort_limits(robot, limits))
        forces, least_norm = balance.forces_within(solution.forces, solution.least_norm, maps, tau, max_torques)
        solution = replace(solution, forces=forces, least_norm=least_norm)
    motion = np.full((len(q), robot.nv), np.nan)
    motion[~solution.holds] = 0.0
    motion[:, is_base] = solution.motion
    torques = tau - np.einsum("nvck,nck->nv", maps, solution.forces)
    torques[:, is_base] = 0.0
    torques[~solution.holds] = np.nan
    wrench = _wrench_at_base(robot, q, tau)
    zmp, zmp_margin = zero_moment_point(balance, points, wrench)
    return _support_of_solution(solution, balance, torques, motion, zmp, zmp_margin)


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
    maps = np.broadcast_to(_wrench_maps(points), (len(F), 6, *points.shape))
    rest_load = _balancing_load(F, at_rest, "at_rest")
    load_per_kilogram = _balancing_load(F, per_kilogram, "per_kilogram")
    is_moment = np.arange(6) < 3
    balance = Balance(contacts, maps, -F, rest_load, load_per_kilogram, is_moment, None)
    solution = balance.solve()
    points_of_rows = np.broadcast_to(points, (len(F), *points.shape))
    zmp, zmp_margin = zero_moment_point(balance, points_of_rows, -F)
    no_torques = np.zeros((len(F), 0))
    return _support_of_solution(solution, balance, no_torques, solution.motion, zmp, zmp_margin)


def _wrench_maps(points: Array) -> Array:
    """Maps (6, c, 3) from forces at points (c, 3) to wrenches (p × f, f) about the origin."""
    maps = [np.vstack([so3.hat(p), np.eye(3)]) for p in points]  # (6, 3) each
    return np.stack(maps, axis=1)


def _balancing_load(F: Array, wrench: ArrayLike | None, name: str) -> Array | None:
    """Load (n, 6) that balances another ``wrench`` on the body, (6,) or one for each row of F (n, 6); None for None."""
    if wrench is None:
        return None
    array = arguments.finite(wrench, name, 6)
    has_wrong_count = array.ndim == 2 and len(array) not in (1, len(F))
    if array.ndim > 2 or has_wrong_count:
        raise ShapeError(f"{name} has the shape {array.shape}. Give (6,) or {F.shape}, as the wrenches.")
    return -np.broadcast_to(array, F.shape)


def _state_rows(robot: Robot, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> tuple[Array, Array, Array]:
    """Checked states as rows (n, nq), (n, nv) and (n, nv); a single row is repeated."""
    arrays = []
    for name, values, width in (("q", q, robot.nq), ("dq", dq, robot.nv), ("ddq", ddq, robot.nv)):
        finite_values = arguments.finite(values, f"support: {name}", width)
        arrays.append(np.atleast_2d(np.asarray(finite_values, float)))
    row_counts = {len(array) for array in arrays} - {1}  # a single row fits any number
    if len(row_counts) > 1 or any(array.ndim != 2 for array in arrays):
        q_shape, dq_shape, ddq_shape = (array.shape for array in arrays)
        raise ShapeError(
            f"support takes rows of states, got q {q_shape}, dq {dq_shape}, ddq {ddq_shape}. Give (n, nq), "
            "(n, nv) and (n, nv)."
        )
    n = max(row_counts, default=1)
    q, dq, ddq = (np.broadcast_to(array, (n, array.shape[1])) for array in arrays)
    return q, dq, ddq


def _torques(robot: Robot, q: Array, dq: Array, ddq: Array, wrench_on_robot: Mapping[str, ArrayLike] | None) -> Array:
    """Torques (n, nv) of inverse dynamics without contacts."""
    return np.asarray(robot.inverse_dynamics(q, dq, ddq, wrench_on_robot=wrench_on_robot))


def _wrench_at_base(robot: Robot, q: Array, tau: Array) -> Array | None:
    """Wrench (n, 6) that contacts exert on a floating root, about the base origin; None for other roots."""
    undriven_bodies = [body for body in robot.model.leaders if not body.joint.driven]
    if len(undriven_bodies) != 1:
        return None
    root = undriven_bodies[0]
    if root.joint.nv != 6:
        return None
    T = np.asarray(robot.forward_kinematics(q, root.link))
    R, p = T[:, :3, :3], T[:, :3, 3]
    _, velocities = root.places
    F = tau[:, velocities]  # in the frame of the root
    m = np.einsum("nij,nj->ni", R, F[:, :3])
    f = np.einsum("nij,nj->ni", R, F[:, 3:])
    return np.concatenate([m + np.cross(p, f), f], axis=1)


def _support_of_solution(
    solution: BalanceSolution, balance: Balance, torques: Array, motion: Array, zmp: Array, zmp_margin: Array
) -> Support:
    """Result with the fields of a solution, and with arrays that were computed from it."""
    return Support(
        holds=solution.holds,
        decided=solution.decided,
        how=solution.how,
        forces=solution.forces,
        torques=torques,
        speed=solution.speed,
        slowest=solution.slowest,
        payload=solution.payload,
        friction=solution.friction,
        zmp=zmp,
        zmp_margin=zmp_margin,
        motion=motion,
        power=solution.power,
        contacts=balance.contacts,
        least_norm=solution.least_norm,
    )


# ── Force of a grip


def force_shares(wrenches: ArrayLike, contacts: Sequence[Contact]) -> Array:
    """Least factors (n,) by which the contacts' largest forces and preloads are multiplied to hold one body under wrenches.

    A factor is inf if none holds the body, and NaN if rounding prevents an answer.

    Examples
    --------
    >>> pads = [Contact((0, y, 0), (0, -y, 0), friction=0.5, push=60.0) for y in (-0.02, 0.02)]
    >>> force_shares([0, 0, 0, 0, 0, -30.0], pads).round(6).tolist()
    [0.5]
    """
    contacts = contacts_of(contacts)
    load = -np.atleast_2d(arguments.finite(wrenches, "wrenches (m, f)", 6))
    n = len(load)
    points = np.array([c.point for c in contacts])
    length = float(np.abs(points).max(initial=0.0))
    if length == 0.0:
        length = 1.0
    units = np.r_[np.full(3, length), np.ones(3)]  # moments are divided by a length, so that all rows count alike
    maps = _wrench_maps(points) / units[:, None, None]
    cones, bounds = cones_of(contacts, n)
    # Bounds are proportional to the factor s, and zero at s = 0.
    bounds_by_factor = replace(bounds, most=np.zeros_like(bounds.most), rate=bounds.most)
    preloads = np.array([c.pull for c in contacts])
    preload_forces = preloads[:, None] * cones.normals
    pulls = np.einsum("mck,ck->m", maps, preload_forces)
    optimum = cone_programme(
        cones,
        np.broadcast_to(maps, (n, *maps.shape)),
        load / units,
        np.broadcast_to(pulls, (n, 6)),
        bounds=bounds_by_factor,
        sense="least",
    )
    factors = np.where(np.isnan(optimum.s), np.inf, optimum.s)
    return np.where(optimum.settled, factors, np.nan)


complete(globals())
