"""Point contacts with friction: their cones, and maps of their forces to torques."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ConstraintError, ValueRangeError
from ..core.numbers import number, printed, vector
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.algorithms.constraints import Closure, place_of
from ..mechanics.model.model import BASE
from .cone_programme import Cones, ForceBounds

if TYPE_CHECKING:
    from ..mechanics.algorithms.constraints import Constraint
    from ..robot import Robot


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
    radius: float = 0.0
    """Radius of a wheel or ball about ``point``, which touches the ground below it, however it has turned; of a robot [m]."""

    def __post_init__(self) -> None:
        for name in ("point", "normal"):
            label = f"a contact's {name}"
            one_vector = arguments.one(getattr(self, name), label, 3)  # not a batch
            checked_vector = arguments.finite(one_vector, label, 3)
            object.__setattr__(self, name, checked_vector.copy())  # the caller may change the array given
        object.__setattr__(self, "friction", arguments.number(self.friction, "a contact's friction"))
        length = float(np.linalg.norm(self.normal))
        if length == 0:
            raise ValueRangeError("a contact's normal has no length. Give the direction in which the world can push.")
        if not 0 <= self.friction < np.inf:
            raise ValueRangeError(
                f"a contact's friction is {printed(self.friction)}. Give a finite coefficient of at least zero."
            )
        object.__setattr__(self, "radius", arguments.positive(self.radius, "a contact's radius", "m", zero=True))
        for name in ("push", "pull"):
            force = arguments.number(getattr(self, name), f"a contact's {name}")
            is_infinite_pull = name == "pull" and force == np.inf
            if not force >= 0 or is_infinite_pull:  # also for nan
                raise ValueRangeError(f"a contact's {name} is {printed(force)}. Give a force of at least zero [N].")
            object.__setattr__(self, name, force)
        if not isinstance(self.group, str | None):
            raise ValueRangeError(f"a contact's group is {self.group!r}. Give a name, or None.")
        if not isinstance(self.frame, str | None):
            raise ValueRangeError(f"a contact's frame is {self.frame!r}. Give the name of a link, or None for the tip.")
        object.__setattr__(self, "normal", self.normal / length)

    def __repr__(self) -> str:
        text = f"Contact at {vector(self.point)} m"
        if self.frame:
            text += f" of {self.frame}"
        text += f", normal {vector(self.normal)}, friction {printed(self.friction)}"
        if self.push != np.inf:
            text += f", push {printed(self.push)} N"
        if self.pull != 0:
            text += f", pull {printed(self.pull)} N"
        return text

    def edges(self, count: int, *, around: bool = False) -> Array:
        """Edges of a pyramid inside the friction cone, or ``around`` it, as forces with unit normal part.

        Edge k has the tangential part μ at the angle 2πk/count, or μ / cos(π/count) if the pyramid is around the cone.

        Parameters
        ----------
        count : int, number of edges, 3 or more
        around : bool, around the cone rather than inside

        Returns
        -------
        forces : (count, 3) array; (1, 3) for μ = 0
        """
        count = arguments.whole(count, "the number of a cone's edges", 3)  # fewer edges enclose no volume
        if self.friction == 0:
            return np.array(self.normal[None])
        tangential_size = self.friction
        if around:
            tangential_size = tangential_size / np.cos(np.pi / count)
        t1, t2 = tangents(self.normal)
        angles = 2 * np.pi * np.arange(count)[:, None] / count
        directions = np.cos(angles) * t1 + np.sin(angles) * t2
        return self.normal + tangential_size * directions

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
        normal_part = f @ self.normal
        tangential_size = np.linalg.norm(f - normal_part[..., None] * self.normal, axis=-1)
        tolerance = slack * np.maximum(1.0, np.linalg.norm(f, axis=-1))  # [N], for forces below 1 N too
        pressing_force = normal_part + self.pull
        does_not_slide = tangential_size <= self.friction * pressing_force + tolerance
        stays_closed = pressing_force >= -tolerance
        is_within_push = normal_part <= self.push + tolerance
        return does_not_slide & stays_closed & is_within_push


def tangents(n: Array) -> Array:
    """Unit vectors (2, 3) across ``n`` and each other; the first is nearest to the x axis, or to y if n is nearly along x."""
    axis = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])  # 0.9: within 26° of x
    t = axis - (axis @ n) * n
    t = t / np.linalg.norm(t)
    return np.stack([t, np.cross(n, t)])


def contacts_of(value: Any) -> tuple[Contact, ...]:
    """Contacts of a list. Raises ValueRangeError for an empty list or other values."""
    contacts = tuple(value) if isinstance(value, Iterable) else ()
    are_contacts = all(isinstance(c, Contact) for c in contacts)
    if not contacts or not are_contacts:
        raise ValueRangeError(f"contacts is {value!r}. Give a list of statics.Contact, at least one.")
    return contacts


def refuse_loops(robot: Robot, function: str) -> None:
    """Raise ConstraintError if the robot has constraints: their forces and the contact forces are not computed together."""
    if not robot.constraints:
        return
    first_constraint, *other_constraints = robot.constraints
    and_others = f" and {len(other_constraints)} more" if other_constraints else ""
    held_at_base = [c.name for c in robot.constraints if not _joins_moving_links(robot, c)]
    if held_at_base:
        remedy = f"In place of {held_at_base[0]} give a contact that holds there, with pull=, on a robot without it."
    else:
        remedy = (
            "Loops of its links change neither contact forces nor margins: robot.open() gives them here. Torques with these "
            "forces are robot.inverse_dynamics(q, dq, ddq, actuated=…, wrench_on_robot=…)."
        )
    raise ConstraintError(
        f"{function}: robot {robot.name!r} is closed by {first_constraint.name}{and_others}, and forces of closures and "
        f"contacts are not computed together. {remedy}"
    )


def _joins_moving_links(robot: Robot, constraint: Constraint) -> bool:
    """True for a closure of two links that move."""
    if not isinstance(constraint, Closure):
        return False
    body_a = place_of(robot.model, constraint.frame_a).body
    body_b = place_of(robot.model, constraint.frame_b).body
    return body_a != BASE and body_b != BASE


def contact_maps(robot: Robot, q: Array, contacts: Sequence[Contact]) -> tuple[Array, Array]:
    """Maps (n, nv, c, 3) of contact forces to torques, and contact points (n, c, 3), in the base frame."""
    jacobians = np.zeros((len(contacts), len(q), 3, robot.nv))  # of the contact points
    points = np.zeros((len(q), len(contacts), 3))
    frames: dict[str | None, tuple[Array, Array]] = {}  # Jacobians and poses, once for each frame
    for k, c in enumerate(contacts):
        if c.frame not in frames:
            frames[c.frame] = (
                np.asarray(robot.jacobian(q, c.frame, "world_aligned")),
                np.asarray(robot.forward_kinematics(q, c.frame)),
            )
        J, T = frames[c.frame]
        lever = T[:, :3, :3] @ c.point - c.radius * c.normal
        jacobians[k] = J[:, 3:] + np.cross(J[:, :3], lever[:, :, None], axis=1)  # v + ω × lever
        points[:, k] = T[:, :3, 3] + lever
    return jacobians.transpose(1, 3, 0, 2), points


def cones_of(contacts: Sequence[Contact], rows: int = 1) -> tuple[Cones, ForceBounds]:
    """Cones of forces with the preloads added, and bounds of the normal parts of these forces.

    Contacts of a group share a bound. Bounds are repeated for ``rows`` states.
    """
    groups: dict[object, list[int]] = {}  # indices of contacts
    for k, c in enumerate(contacts):
        if c.push < np.inf:
            group = k if c.group is None else (c.group, c.frame)
            groups.setdefault(group, []).append(k)
    is_member = np.zeros((len(groups), len(contacts)))
    max_sums = np.zeros(len(groups))
    for g, members in enumerate(groups.values()):
        is_member[g, members] = 1.0
        first_member = contacts[members[0]]
        pushes = sorted({contacts[k].push for k in members})
        if len(pushes) > 1:
            pushes_text = listed([number(push) for push in pushes])
            raise ValueRangeError(
                f"contacts of group {first_member.group!r} have pushes of {pushes_text} N. "
                "Give all of them the largest sum of their normal forces."
            )
        max_sums[g] = first_member.push + sum(contacts[k].pull for k in members)
    normals = np.array([c.normal for c in contacts]).reshape(-1, 3)
    maps = is_member[..., None] * normals  # (groups, c, 3): from forces to the sum of normal parts of each group
    no_growth = np.zeros((rows, len(groups)))
    bounds = ForceBounds(
        maps=np.broadcast_to(maps, (rows, *maps.shape)),
        most=np.broadcast_to(max_sums, (rows, len(groups))),
        rate=no_growth,
    )
    frictions = np.array([c.friction for c in contacts])
    return Cones(normals, frictions), bounds
