"""Reactions of a motion: the wrench on the mounting, loads of its bolts, and loads of the joints' bearings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import se3
from ..mechanics.lie.labelled import WRENCH
from ..mechanics.model.joint_loads import bearing_loads as bearing_load_components
from ..mechanics.model.limits import BEARINGS
from ..mechanics.model.model import BASE, Body, Model
from ..robot.base import require_robot
from .torque_limits import floating_entries

if TYPE_CHECKING:
    from ..robot import Robot


_RANK_TOLERANCE = 1e-9
"""Singular value, relative to the largest entry, up to which a pattern of bolts has a lower rank."""


@dataclass(frozen=True, eq=False, repr=False)
class MountingLoad:
    """Wrench of a robot on its foundation, of n instants."""

    wrench: Array
    """(n, 6): (m, f) by the robot on the foundation, at the frame and in its axes [N m, N]."""
    frame: str
    """Frame fixed to the base."""

    @property
    def largest(self) -> dict[str, tuple[float, int]]:
        """Value of largest magnitude of each component ``mx`` … ``fz``, with its sign, and the index of its instant."""
        instants = np.abs(self.wrench).argmax(axis=0).tolist()
        peaks: dict[str, tuple[float, int]] = {}
        for k, name in enumerate(WRENCH):
            instant = instants[k]
            peaks[name] = (float(self.wrench[instant, k]), instant)
        return peaks

    def bolts(self, places: ArrayLike, preload: float = 0.0) -> Array:
        """Axial and shear loads of bolts through a rigid flange in the frame's xy plane; the axial load pulls if above 0.

        The plate shares axial force and tilting moment linearly over the pattern: N_i = a + b x_i + c y_i. Bolts share the
        force in the plane equally. They share the torsion m_z about the pattern's centre in proportion to their distance
        from it.

        Parameters
        ----------
        places : (k, 2) array_like, positions of the bolts in the frame [m]
        preload : float, added to the axial load of each bolt [N]

        Returns
        -------
        loads : (n, k, 2) array, axial and shear load [N]

        Raises
        ------
        ShapeError, ValueRangeError
            ``places`` is not a table of positions, or the bolts stand in one line.

        Examples
        --------
        >>> import twistwrench as tw
        >>> ur5 = tw.robots.ur5()
        >>> load = mounting_load(ur5, ur5.neutral, [0] * 6, [0] * 6)
        >>> load.bolts(bolt_circle(4, 0.17)).shape
        (1, 4, 2)
        """
        xy = arguments.finite(places, "places of bolts", 2)
        if xy.ndim != 2:
            raise ShapeError(f"places of bolts have the shape {xy.shape}. Give (k, 2): x and y of each bolt [m].")
        bolt_count = len(xy)
        pattern = np.column_stack([np.ones(bolt_count), xy])  # N = pattern @ (a, b, c)
        largest_entry = float(np.abs(pattern).max(initial=1.0))
        if np.linalg.matrix_rank(pattern, tol=_RANK_TOLERANCE * largest_entry) < 3:  # a, b and c are not unique
            raise ValueRangeError(
                f"{bolt_count} bolts in one line bear no moment about it. Give at least three places that are not in one line."
            )
        mx, my, mz, fx, fy, fz = self.wrench.T
        # Σ N, Σ N x, Σ N y: the foundation pulls back what the robot lifts.
        axial_sums = np.stack([fz, -my, mx], axis=1)
        plane_coefficients = axial_sums @ np.linalg.inv(pattern.T @ pattern)  # a, b, c of each instant
        axial = plane_coefficients @ pattern.T + arguments.number(preload, "preload")
        centre = xy.mean(axis=0)
        x, y = (xy - centre).T
        torsion = mz - centre[0] * fy + centre[1] * fx  # moment about the centre
        polar_moment = (x**2 + y**2).sum()
        force_per_distance = torsion / polar_moment
        shear_x = fx[:, None] / bolt_count - force_per_distance[:, None] * y
        shear_y = fy[:, None] / bolt_count + force_per_distance[:, None] * x
        return np.stack([axial, np.hypot(shear_x, shear_y)], axis=-1)

    def __repr__(self) -> str:
        return f"MountingLoad: {self}"

    def __str__(self) -> str:
        force = np.linalg.norm(self.wrench[:, 3:], axis=1).max(initial=0.0)
        tilting_moment = np.hypot(self.wrench[:, 0], self.wrench[:, 1]).max(initial=0.0)
        torque = np.abs(self.wrench[:, 2]).max(initial=0.0)
        return (
            f"on the foundation at {self.frame}: force up to {printed(force, 4)} N, "
            f"tilting moment {printed(tilting_moment, 4)} N m, torque {printed(torque, 4)} N m"
        )


@dataclass(frozen=True, eq=False)
class BearingLoads:
    """Loads of the bearings of joints with one degree of freedom, at the joints' origins, of n instants."""

    joints: tuple[str, ...]
    """Names of the k joints."""
    axial: Array
    """(n, k): force along the axis of a turning joint; NaN for a sliding joint [N]."""
    radial: Array
    """(n, k): force across the axis [N]."""
    tilting: Array
    """(n, k): moment across the axis of a turning joint; for a sliding joint, its whole moment [N m]."""


def bolt_circle(count: int, diameter: float) -> Array:
    """Places (count, 2) [m] of bolts spaced evenly on a circle about the frame's origin; the first bolt is on the x axis.

    Parameters
    ----------
    count : int, 3 or more
    diameter : float, of the circle [m]

    Returns
    -------
    places : (count, 2) array [m]

    Examples
    --------
    >>> bolt_circle(4, 0.2).round(3).tolist()
    [[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0], [-0.0, -0.1]]
    """
    count = arguments.whole(count, "the number of bolts", 3)
    angle = 2 * np.pi * np.arange(count) / count
    radius = 0.5 * arguments.positive(diameter, "the diameter of a bolt circle", "m")
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def mounting_load(
    robot: Robot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    frame: str | None = None,
    *,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
) -> MountingLoad:
    """Wrench on the foundation from all that stands on a frame of a robot with a fixed base, along a motion.

    Parameters
    ----------
    q : (n, nq) or (nq,) array_like
    dq, ddq : (n, nv) or (nv,) array_like
    frame : str, optional
        Link fixed to the base, whose origin and axes the wrench has; None: the root link. The link and all links beyond it
        stand on it, with their weights: a rail below it, or another arm beside it, does not count.
    wrench_on_robot : {frame: (n, 6) or (6,)}, optional, wrenches on frames of the robot

    Returns
    -------
    load : MountingLoad

    Raises
    ------
    ValueRangeError
        The base is not fixed, the frame moves, or it is a site, so that the links on it are not known.

    Examples
    --------
    >>> import twistwrench as tw
    >>> ur5 = tw.robots.ur5()
    >>> load = mounting_load(ur5, ur5.neutral, [0] * 6, [0] * 6)
    >>> print(load)  # doctest: +ELLIPSIS
    on the foundation at base_link: force up to ... N, tilting moment ... N m, torque 0 N m
    """
    model = require_robot(robot, "mounting_load").model
    if floating_entries(robot).any():
        raise ValueRangeError(
            f"the base of robot {robot.name!r} is free, so that nothing mounts it. Load it with floating_base=False, or use "
            "statics.support for its contacts."
        )
    root = _root_link(model)
    if frame is None:
        frame = root
    _check_mounting(model, frame)
    q = np.asarray(q, float)
    F = np.asarray(robot.joint_wrenches(q, dq, ddq, wrench_on_robot=wrench_on_robot))
    wrench = np.zeros((*F.shape[:-2], 6))  # in the base frame
    for k, body in enumerate(model.bodies):
        if body.parent == BASE and _stands_on(model, _carrier(model, body), frame):
            wrench_on_body = _transform(_poses(body, q), F[..., k, :])
            wrench = wrench - wrench_on_body  # the body's reaction on the base
    wrenches_on_robot = {} if wrench_on_robot is None else wrench_on_robot
    for name, F_on in wrenches_on_robot.items():
        loaded_frame = model.frame(name)
        if loaded_frame.body == BASE and _stands_on(model, name, frame):  # joints transmit wrenches on moving links
            wrench = wrench + _transform(loaded_frame.pose, np.asarray(F_on, float))
    if frame in model.sites or frame == root:
        fixed_inertia = model.base_inertia
    else:
        fixed_inertia = _fixed_inertia(model, frame)
    weight = fixed_inertia.mass * model.gravity
    wrench = wrench + np.concatenate([np.cross(fixed_inertia.com, weight), weight])
    wrench_at_frame = _transform(se3.inverse(model.frame(frame).pose), wrench)
    return MountingLoad(np.atleast_2d(wrench_at_frame), frame)


def _root_link(model: Model) -> str:
    """Fixed link that no other link carries."""
    fixed_links = [name for name, frame in model.frames.items() if frame.body == BASE]
    return next(link for link in fixed_links if _parent(model, link) not in model.frames)


def _check_mounting(model: Model, frame: str) -> None:
    """Raise ValueRangeError if a frame moves, or if the links that stand on it are not known."""
    if model.frame(frame).body != BASE:
        raise ValueRangeError(
            f"{frame!r} moves with a joint. Give a link fixed to the base of robot {model.name!r}. The load of what moves it "
            "is that of the joint's bearing: give limits with columns radial, axial, tilting, or use statics.bearing_loads."
        )
    fixed_links = [name for name, fixed_frame in model.frames.items() if fixed_frame.body == BASE]
    if frame in model.sites and len(fixed_links) > 1:
        raise ValueRangeError(
            f"{frame!r} is a site, and the links that stand on it are not known. Give one of {listed(fixed_links)}."
        )


def _parent(model: Model, link: str) -> str:
    """Link that carries a link; empty for the root."""
    parent, _ = model.mounts.get(link, ("", ""))
    return parent


def _stands_on(model: Model, link: str, frame: str) -> bool:
    """True if a link is ``frame`` or beyond it in the tree. If ``frame`` is a site, there is one fixed link: always True."""
    while link and link != frame:
        link = _parent(model, link)
    return link == frame or frame in model.sites


def _carrier(model: Model, body: Body) -> str:
    """Link of a body; for a rotor, its carrying link: the actuator's, or else the parent of the driven link."""
    if body.joint.moves_body:
        return body.link
    actuator = next(actuator for actuator in model.actuators.values() if f"{actuator.joint}.rotor" == body.link)
    if actuator.rotor is not None and actuator.rotor.link is not None:
        return actuator.rotor.link
    driven_body = next(driven for driven in model.bodies if driven.joint.name == actuator.joint)
    return _parent(model, driven_body.link)


def _poses(body: Body, q: Array) -> Array:
    """Poses (..., 4, 4) in the base frame of a body that the base carries."""
    q_indices, _ = body.places
    coordinates = body.ratio * q[..., q_indices] + body.offset
    rows = coordinates.reshape(-1, coordinates.shape[-1])  # one row per configuration
    poses = [body.placement @ body.joint.pose(row) for row in rows]
    return np.reshape(poses, (*q.shape[:-1], 4, 4))


def _fixed_inertia(model: Model, frame: str) -> SpatialInertia:
    """Inertia of the fixed links that stand on a frame, in the base frame."""
    total = SpatialInertia.zero()
    for name, inertia in model.link_inertias.items():
        link = model.frames[name]
        if link.body == BASE and _stands_on(model, name, frame):
            total = total + inertia.in_frame(link.pose)
    return total


def _transform(T_ab: Array, F_b: Array) -> Array:
    """Wrench (..., 6) about the origin and in the axes of {a}: m_a = R m_b + p × R f_b, f_a = R f_b."""
    R, p = T_ab[..., :3, :3], T_ab[..., :3, 3]
    m = np.einsum("...ij,...j->...i", R, F_b[..., :3])
    f = np.einsum("...ij,...j->...i", R, F_b[..., 3:])
    return np.concatenate([m + np.cross(p, f), f], axis=-1)


def bearing_loads(robot: Robot, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> BearingLoads:
    """Axial and radial forces and tilting moments of the bearings of each turning and sliding joint along a motion.

    Parameters
    ----------
    q : (n, nq) or (nq,) array_like
    dq, ddq : (n, nv) or (nv,) array_like

    Returns
    -------
    loads : BearingLoads

    Examples
    --------
    >>> import twistwrench as tw
    >>> ur5 = tw.robots.ur5()
    >>> loads = bearing_loads(ur5, ur5.neutral, [0] * 6, [0] * 6)
    >>> loads.joints[0], loads.tilting.shape
    ('shoulder_pan_joint', (1, 6))
    """
    model = require_robot(robot, "bearing_loads").model
    F = np.asarray(robot.joint_wrenches(q, dq, ddq))
    loads = bearing_load_components(model, F.reshape(-1, *F.shape[-2:]))
    indices = [k for k, body in enumerate(model.bodies) if body.joint.nv == 1 and body.joint.moves_body]
    names = tuple(model.bodies[k].joint.name for k in indices)
    axial, radial, tilting = (loads[kind][:, indices] for kind in BEARINGS)
    return BearingLoads(names, axial, radial, tilting)


complete(globals())
