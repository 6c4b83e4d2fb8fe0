"""Constraints of a closed robot: Jacobians, scaling, forces as wrenches on links. Modern Robotics section 8.7."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...algorithms.constraints import (
    Closure,
    Constraint,
    MotionForceSplit,
    Rolling,
    independent_constraints,
    names,
    place_of,
)
from ...algorithms.kinematics import KINDS
from ...algorithms.loop_closure import ConstraintProjector, usual_sizes
from ...algorithms.operational_space import row_numbers
from ...core import arguments, third_party
from ...core.glossary import complete
from ...errors import ConstraintError, UnknownNameError
from ...model.model import BASE, Model
from ...typing import Array
from ..arguments import Rows, finite_states

if TYPE_CHECKING:
    from ...model.model import Model
    from ..robot import Robot
    from .closed_robot import ClosedRobot


class ClosedRobotBase:
    """Base of a closed robot's methods: the open robot, the constraints and the scaling of their rows."""

    robot: Robot
    constraints: tuple[Constraint, ...]
    sizes: Array
    independent: tuple[int, ...]
    spans: Array

    @property
    def nq(self) -> int:
        """Number of coordinates nq, those of the open robot."""
        return self.robot.nq

    @property
    def nv(self) -> int:
        """Number of velocities, those of the open robot."""
        return self.robot.nv

    @cached_property
    def _independent_constraints(self) -> tuple[Constraint, ...]:
        """The constraints with their independent rows alone."""
        return independent_constraints(self.constraints, self.independent)

    def _closed(self) -> ClosedRobot:
        """The closed robot with all its methods."""
        raise NotImplementedError


class ConstraintMethods(ClosedRobotBase):
    """The methods of a closed robot about its constraints: A, its rank, and projections."""

    @third_party.by_blocks(lambda closed, _: [(len(closed.sizes), closed.nv)])
    def constraint_jacobian(self, q: ArrayLike) -> Array:
        """Constraint Jacobian A, with A dq = 0.

        Returns
        -------
        A : (k, nv) array, rows as in :attr:`row_names`

        Notes
        -----
        MR section 8.7.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.constraint_jacobian(q).shape
        (2, 3)
        """
        (q,) = finite_states(self.robot.model, "constraint_jacobian", q=q)
        if not self.constraints:
            return np.zeros((*q.shape[:-1], 0, self.nv))
        return np.asarray(self.robot.engine.call("constraint_jacobian", q, constraints=self.constraints))

    @third_party.by_blocks(lambda closed, _: [(len(closed.sizes),)])
    def constraint_bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Constraint bias (dA/dt) dq, so that A q̈ + (dA/dt) dq = 0.

        Returns
        -------
        b : (k,) array, rows as in :attr:`row_names` [rad/s², m/s²]

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.constraint_bias(q, [0, 0, 0]).tolist()
        [0.0, 0.0]
        """
        q, dq = finite_states(self.robot.model, "constraint_bias", q=q, dq=dq)
        if not self.constraints:
            return np.zeros((*np.broadcast_shapes(q.shape[:-1], dq.shape[:-1]), 0))
        return np.asarray(self.robot.engine.call("constraint_bias", q, dq, constraints=self.constraints))

    @third_party.by_blocks(lambda *_: [()], dtype=int)
    def rank(self, q: ArrayLike) -> Array:
        """Rank of A at q: how many of its rows are independent; fewer than usual where the configuration is singular.

        Returns
        -------
        count : () array of int

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> int(held.rank(q))
        2
        """
        return projector_at(self._closed(), *finite_states(self.robot.model, "rank", q=q))[1].rank

    @third_party.by_blocks(lambda *_: [()], dtype=int)
    def degrees_of_freedom(self, q: ArrayLike) -> Array:
        """Degrees of freedom at q: nv less the rank of A.

        Returns
        -------
        count : () array of int

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> int(held.degrees_of_freedom(q))
        1
        """
        return self.nv - self.rank(q)

    @third_party.by_blocks(lambda closed, _: [(closed.nv, closed.nv)])
    def projector(self, q: ArrayLike) -> Array:
        """Projector P = 1 - A'(A M⁻¹ A')⁻¹ A M⁻¹, which removes from torques the part that the constraints bear.

        Returns
        -------
        P : (nv, nv) array

        Raises
        ------
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        Its transpose takes from velocities what breaks them. MR section 8.7.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> P = held.projector(q)
        >>> bool(abs(P @ P - P).max() < 1e-12)
        True
        """
        (q,) = finite_states(self.robot.model, "projector", q=q)
        return projector_at(self._closed(), q)[1].projector.astype(q.dtype, copy=False)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,)] * 2, MotionForceSplit)
    def split(self, q: ArrayLike, tau: ArrayLike) -> MotionForceSplit:
        """Torques split into those that move the robot, Pτ, and those that the constraints bear.

        Returns
        -------
        parts : MotionForceSplit, ``motion`` and ``force`` (nv,) [N m, sliding joints: N]

        Raises
        ------
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> parts = held.split(q, [1, 2, 3])
        >>> (parts.motion + parts.force).round(12).tolist()
        [1.0, 2.0, 3.0]
        """
        q, tau = finite_states(self.robot.model, "split", q=q, tau=tau)
        motion = (projector_at(self._closed(), q)[1].projector @ tau[..., None])[..., 0].astype(
            np.result_type(q, tau), copy=False
        )
        return MotionForceSplit(motion, tau - motion)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_velocity(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocity nearest in the kinetic metric that meets A dq = 0: P'dq.

        Returns
        -------
        dq : (nv,) array [rad/s, m/s]

        Raises
        ------
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> bool(abs(held.constraint_jacobian(q) @ held.project_velocity(q, [1, 0, 0])).max() < 1e-12)
        True
        """
        q, dq = finite_states(self.robot.model, "project_velocity", q=q, dq=dq)
        return self._nearest(q, dq, 0.0)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_acceleration(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Acceleration nearest in the kinetic metric that meets A q̈ + (dA/dt) dq = 0.

        Returns
        -------
        ddq : (nv,) array [rad/s², m/s²]

        Raises
        ------
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> bool(abs(held.constraint_jacobian(q) @ held.project_acceleration(q, [0, 0, 0], [1, 0, 0])).max() < 1e-12)
        True
        """
        q, dq, ddq = finite_states(self.robot.model, "project_acceleration", q=q, dq=dq, ddq=ddq)
        return self._nearest(q, ddq, self.constraint_bias(q, dq))

    def _nearest(self, q: Array, v: Array, b: Array | float) -> Array:
        A, projector = projector_at(self._closed(), q)
        return projector.nearest(v, (A @ v[..., None])[..., 0] + b).astype(np.result_type(q, v), copy=False)

    def wrenches(self, lam: ArrayLike) -> dict[str, Array]:
        """Constraint wrenches: λ as wrenches (m, f) that the robot applies where it is held.

        Parameters
        ----------
        lam : (k,) array_like, λ of :meth:`forward_dynamics` or :meth:`inverse_dynamics` [N m, N]

        Returns
        -------
        wrenches : {name of the constraint: (6,) array} [N m, N]

        Notes
        -----
        A closure's is what {b} applies to {a}, at the origin of {b}, along the axes of {c}.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> {name: F.round(12).tolist() for name, F in held.wrenches([10.0, 0.0]).items()}
        {'ground–tip': [0.0, 0.0, 0.0, 10.0, 0.0, 0.0]}
        """
        lam = arguments.finite(lam, "lam", len(self.sizes))
        found, first = {}, 0
        for name, c in zip(names(self.constraints), self.constraints, strict=True):
            found[name] = np.zeros((*lam.shape[:-1], 6))
            found[name][..., list(c.rows)] = lam[..., first : first + len(c.rows)]
            first += len(c.rows)
        return found


def projector_at(closed: ClosedRobot, q: Array) -> tuple[Array, ConstraintProjector]:
    """A at q and its projector, weighted by the mass matrix."""
    A = closed.constraint_jacobian(q)
    return A, ConstraintProjector.from_rows(A, closed.robot.mass_matrix(q), closed.sizes, len(closed.independent))


# ── Scaling of constraint rows, and tolerances of gaps and rates

CLOSED = 1e-12
"""rad, and part of the robot's length: loops closed to this are closed; positions are rounded to some 1e-15 of it."""
SHORTEST = 1e-4
"""Part of the robot's length: beside levers shorter than it, positions of single precision are rounded to more than loops may
be open."""
LONGEST = 1.0
"""m: loops of larger robots are closed as well as those of this size."""
ROUNDED = 4e-3
"""Part of a robot's whole length, however large: 1e-12 of this is 18 units in the last place of its positions, and no loop is
closed to less."""


def row_sizes(closed: ClosedRobot, new: Constraint) -> tuple[Array, Array]:
    """Usual sizes of the rows of A, through the mass matrix, and their spans, those of one more constraint appended."""
    sizes, rows = six_sizes(closed.robot, new), list(new.rows)
    length = robot_length(closed.robot.model)
    spans = np.repeat([1.0, np.clip(sizes[3] / sizes[0], SHORTEST * length, LONGEST)], 3)
    return np.concatenate([closed.sizes, sizes[rows]]), np.concatenate([closed.spans, spans[rows]])


def robot_length(model: Model) -> float:
    """m, :data:`LONGEST` at most: how far its links may be from its base, what gaps are small beside."""
    return min(_whole_length(model), LONGEST)


def _whole_length(model: Model) -> float:
    """m: the sum of the levers along the longest chain, with what joints may slide; what positions are rounded by."""
    reach: list[float] = []
    for body in model.bodies:
        sliding = body.joint.axes[:, 3:].any(axis=1)
        most = 0.0
        if sliding.any():
            k = body.v_index
            way = [max(abs(model.limits.lower[k + n]), abs(model.limits.upper[k + n])) for n in np.flatnonzero(sliding)]
            most = float(sum(x if np.isfinite(x) else LONGEST for x in way))
        before = 0.0 if body.parent == BASE else reach[body.parent]
        reach.append(before + float(np.linalg.norm(body.placement[:3, 3])) + abs(body.ratio) * most)
    frames = [
        (0.0 if f.body == BASE else reach[f.body]) + float(np.linalg.norm(f.pose[:3, 3])) for f in model.frames.values()
    ]
    return max([*reach, *frames], default=0.0) or LONGEST


def gap_length(model: Model) -> float:
    """m: what a gap of one is."""
    return max(robot_length(model), ROUNDED * _whole_length(model))


def gap_units(closed: ClosedRobot) -> Array:
    """Unit of the gap of each row that has a position: 1 rad, or the robot's length in m, or the bound of rounding."""
    turning = np.array([k < 3 for c in closed.constraints if isinstance(c, Closure) for k in c.rows], bool)
    return np.where(turning, 1.0, gap_length(closed.robot.model))


def all_rows(constraint: Constraint) -> Constraint:
    """The same constraint with all six rows."""
    return replace(constraint, rows=tuple(range(6)))


def six_sizes(robot: Robot, constraint: Constraint) -> Array:
    """Usual sizes of the six rows of a constraint, through the mass matrix; (6,)."""
    robot.engine.require_invertible()
    some = robot.random_configuration(0, 8)
    J = np.stack([robot.reference("constraint_jacobian", q, constraints=(all_rows(constraint),)) for q in some])
    return usual_sizes(J, robot.mass_matrix(some))


def rate_units(closed: ClosedRobot) -> Array:
    """Unit of the rate of each velocity: 1 rad/s, or the robot's length per second."""
    axes = np.concatenate([np.zeros((0, 6)), *(body.joint.axes for body in closed.robot.model.leaders)])
    return np.where(axes[:, :3].any(axis=1), 1.0, robot_length(closed.robot.model))


# ── Constraint forces as wrenches on the links of the open robot

# With T_cb = (R, p), a closure's λ is the wrench F = (m, f) that {b} applies to {a} at the origin of {b}, along the axes
# of {c}:
#
#     by the robot at {b}:  (R'm, R'f),        by the robot at {a}:  -(R_ac (m + p × f) + p_ac × R_ac f, R_ac f)


def applied(closed: ClosedRobot, q: Array, lam: Array) -> list[tuple[str, Array]]:
    """(frame, (..., 6)): the wrenches by the robot that act on its links as λ (..., k) does, none for the ground."""
    found, poses = [], iter(np.moveaxis(_closure_poses(closed, q), -3, 0))
    for name, c in zip(names(closed.constraints), closed.constraints, strict=True):
        F = closed.wrenches(lam)[name]
        if isinstance(c, Rolling):
            found.append((c.frame, _at_frame(c.kind, closed.robot.forward_kinematics(q, c.frame), F)))
            continue
        T_cb = next(poses)
        R = np.swapaxes(T_cb[..., :3, :3], -1, -2)
        if place_of(closed.robot.model, c.frame_b).body != BASE:
            found.append((c.frame_b, _turned(R, F)))
        if place_of(closed.robot.model, c.frame_a).body != BASE:
            found.append((c.frame_a, -_moved(c.T_ac[:3, :3], c.T_ac[:3, 3], _moved(np.eye(3), T_cb[..., :3, 3], F))))
    return found


def _closure_poses(closed: ClosedRobot, q: Array) -> Array:
    if not any(isinstance(c, Closure) for c in closed.constraints):
        return np.zeros((*q.shape[:-1], 0, 4, 4))
    return np.asarray(closed.robot.engine.call("closure_poses", q, constraints=closed.constraints))


def _at_frame(kind: str, T: Array, F: Array) -> Array:
    """A wrench along the axes and at the point that the Jacobian's ``kind`` names, in the frame at T."""
    if kind == "body":
        return F
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    return _turned(R, F if kind == "world_aligned" else _moved(np.eye(3), -T[..., :3, 3], F))


def _turned(R: Array, F: Array) -> Array:
    m, f = ((R @ x[..., None])[..., 0] for x in (F[..., :3], F[..., 3:]))
    return np.concatenate([m, f], axis=-1)


def _moved(R: Array, p: Array, F: Array) -> Array:
    """A wrench of one frame in another, in which the first has the pose (R, p)."""
    turned = _turned(R, F)
    return np.concatenate([turned[..., :3] + np.cross(p, turned[..., 3:]), turned[..., 3:]], axis=-1)


# ── Closures and velocity constraints from frames and rows


def closure(model: Model, frame_a: str, frame_b: str, rows: Rows, pose: ArrayLike | None) -> Closure:
    """Closure of :meth:`twistwrench.Robot.close`."""
    frame_a, frame_b = _named(model, frame_a), _named(model, frame_b)
    if place_of(model, frame_a).body == place_of(model, frame_b).body:
        raise ConstraintError(
            f"{frame_a!r} and {frame_b!r} are fixed to one body, so nothing between them can be closed."
        )
    T_ac = np.eye(4) if pose is None else arguments.pose(arguments.one(pose, "pose", 4, 4), "pose")
    return Closure(frame_a, frame_b, row_numbers(rows), tuple(tuple(row) for row in T_ac.tolist()))


def rolling(model: Model, frame: str, rows: Rows, kind: str) -> Rolling:
    """Constraint of :meth:`twistwrench.Robot.constrain`."""
    if kind not in KINDS:
        raise UnknownNameError.from_choices("kind", kind, KINDS)
    frame = _named(model, frame)
    if model.frame(frame).body == BASE:
        raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
    return Rolling(frame, row_numbers(rows), kind)


def _named(model: Model, frame: str | None) -> str:
    """The frame's name, the tip's for None; errors as those of :meth:`Model.frame`."""
    if frame is None:
        model.frame(None)
        return str(model.tip)
    return frame


complete(globals())
