"""Closed robots: a robot with loops or other constraints on its velocity, A(q) dq = 0. Modern Robotics section 8.7.

The equations of motion are those of the open robot with the forces of constraint in them,

    τ = M q̈ + h + A'λ,   A q̈ + (dA/dt) dq = 0,

so λ is what the robot applies where it is held, as in τ = M q̈ + h + J'F_by. Shapes are those of one state; any leading batch
shape goes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.constrained import ConstrainedMotion, ConstrainedTorques, MotionForceSplit
from ..algorithms.constraint_forces import balance
from ..algorithms.constraints import Closure, Constraint, Rolling, names, place_of, row_names
from ..algorithms.jacobians import KINDS
from ..algorithms.loop_closure import closure_gaps, settled
from ..algorithms.operational_space import ROWS, row_numbers
from ..algorithms.weighted_svd import Reach, doubtful, independent_rows
from ..core import arguments, lazy
from ..errors import ConstraintError, UnknownNameError, ValueRangeError
from ..model.model import BASE
from ..typing import Array
from . import closed_robot_checks as checks
from .closed_shortcuts import ClosedShortcuts
from .quantity_types import Rows
from .robot import Robot
from .state_arguments import names_of
from .wrench_arguments import Wrenches

CLOSED = 1e-12
"""rad, and part of the robot's length: loops closed to this are closed; positions are rounded to some 1e-15 of it."""

__all__ = ["ClosedRobot", "ConstrainedMotion", "ConstrainedTorques", "MotionForceSplit"]


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRobot(ClosedShortcuts):
    """A robot with closed loops: kinematics and dynamics under constraints A dq = 0. Immutable.

    Made by :meth:`twistwrench.Robot.close` and :meth:`~twistwrench.Robot.constrain`. MR section 8.7.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_3r()
    >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
    >>> q = held.consistent([-0.6, 0.2, 2.2])
    >>> bool(abs(held.constraint_error(q)).max() < 1e-12)
    True
    >>> ddq, lam = held.forward_dynamics(q, [0, 0, 0], [0, 0, 0])
    >>> bool(abs(held.constraint_jacobian(q) @ ddq).max() < 1e-12)
    True
    """

    robot: Robot
    """The same robot with its loops open."""
    constraints: tuple[Constraint, ...] = ()
    """Closures and constraints, in the order in which they were made."""
    sizes: Array = field(default_factory=lambda: np.zeros(0))
    """How large each row of A usually is, through the mass matrix; what is small is so beside these."""
    independent: tuple[int, ...] = ()
    """Numbers of the rows of A that do not depend on earlier ones."""
    spans: Array = field(default_factory=lambda: np.zeros(0))
    """What a gap of each row is large or small beside: 1 rad, or m, the lever that its joints usually have, 1 at most."""

    def __post_init__(self) -> None:
        for array in (self.sizes, self.spans):
            array.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()  # arrays come out of a pickle writable

    def __repr__(self) -> str:
        held = ", ".join(f"{c.name} {' '.join(ROWS[k] for k in c.rows)}" for c in self.constraints)
        free = self.robot.nv - len(self.independent)
        return f"<ClosedRobot {self.robot.name!r}: {held or 'open'}; {free} degree{'s' * (free != 1)} of freedom>"

    if not TYPE_CHECKING:  # so that checkers of types refuse these names too

        def __getattr__(self, name: str) -> NoReturn:
            """Say where the open robot's methods are; forwarding them would hide that they know nothing of the loops."""
            hint = ""
            if not name.startswith("_") and hasattr(Robot, name):
                call = "(…)" if callable(getattr(Robot, name)) else ""
                hint = f" Of the robot with its loops open, without the constraints: closed.robot.{name}{call}."
            raise AttributeError(f"a ClosedRobot has no {name!r}.{hint}", name=name, obj=self)

    # ── closing ──

    def close(
        self,
        frame_a: str,
        frame_b: str,
        rows: Rows = None,
        *,
        pose: ArrayLike | None = None,
        near: ArrayLike | None = None,
        redundant: str = "error",
    ) -> ClosedRobot:
        """Close one more loop; see :meth:`twistwrench.Robot.close`.

        Parameters
        ----------
        frame_a, frame_b : str, frames of the robot; ``"ground"`` is the base
        rows : str or iterable, optional, rows of the twist by name, ``"vx vz"``, or number, 0 to 5; None: all six
        pose : (4, 4) array_like, optional, of {c} in {a}; None: {a} itself
        near : (nq,) array_like, optional, configuration near which the closed loops are searched; None: anywhere
        redundant : "error" or "accept", what to do with rows that depend on the others

        Returns
        -------
        closed : ClosedRobot

        Raises
        ------
        ConstraintError
            No configuration is found at which the loops close, or rows depend on the others.
        UnknownNameError
            The robot has no such frame or row.
        ShapeError
            ``pose`` or ``near`` is of another size.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_3r().close("ground", "tip", rows="vz").close("ground", "tip", rows="wy").row_names
        ('ground–tip vz', 'ground–tip #2 wy')
        """
        model = self.robot.model
        frame_a, frame_b = checks.named(model, frame_a), checks.named(model, frame_b)
        a, b = place_of(model, frame_a), place_of(model, frame_b)
        chosen = row_numbers(rows)
        if a.body == b.body:
            raise ConstraintError(
                f"{frame_a!r} and {frame_b!r} are fixed to one body, so nothing between them can be closed."
            )
        T_ac = np.eye(4) if pose is None else arguments.pose(arguments.one(pose, "pose", 4, 4), "pose")
        closure = Closure(frame_a, frame_b, chosen, tuple(tuple(row) for row in T_ac.tolist()))
        return self._with(closure, near, redundant)

    def constrain(
        self, frame: str, rows: Rows, kind: str = "body", *, near: ArrayLike | None = None, redundant: str = "error"
    ) -> ClosedRobot:
        """Constrain one more velocity, along the frame's own axes (``"body"``); see :meth:`twistwrench.Robot.constrain`.

        Parameters
        ----------
        frame : str, a frame of the robot
        rows : str or iterable, optional, rows of the twist by name, ``"vx vz"``, or number, 0 to 5; None: all six
        kind : "body", "space" or "world_aligned", axes and reference point as in :meth:`jacobian`
        near : (nq,) array_like, optional, configuration near which the closed loops are searched; None: anywhere
        redundant : "error" or "accept", what to do with rows that depend on the others

        Returns
        -------
        closed : ClosedRobot

        Raises
        ------
        ConstraintError
            Rows depend on the others.
        UnknownNameError
            The robot has no such frame, row or ``kind``.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy").constrain("box", "vz").row_names
        ('box vy', 'box #2 vz')
        """
        if kind not in KINDS:
            raise UnknownNameError.of("kind", kind, KINDS)
        frame = checks.named(self.robot.model, frame)
        if self.robot.model.frame(frame).body == BASE:
            raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
        return self._with(Rolling(frame, row_numbers(rows), kind), near, redundant)

    def _with(self, new: Constraint, near: ArrayLike | None, redundant: str) -> ClosedRobot:
        if redundant not in checks.REDUNDANT:
            raise ValueRangeError(f"redundant={redundant!r} is not allowed. Choose from: 'error', 'accept'.")
        sizes, spans = checks.row_sizes(self, new)
        rows = tuple(range(len(sizes)))
        closed = replace(self, constraints=(*self.constraints, new), sizes=sizes, spans=spans, independent=rows)
        q = checks.some_configurations(closed, near)
        checks.require_angle(closed, q)
        rows = independent_rows(closed.constraint_jacobian(q), self.robot.mass_matrix(q), sizes)
        closed = replace(closed, independent=rows)
        if redundant == "error" and set(closed.redundant_rows) - set(self.redundant_rows):
            checks.refuse_redundant(closed)
        return closed

    # ── what it is ──

    @property
    def nq(self) -> int:
        """Number of coordinates nq, those of the open robot."""
        return self.robot.nq

    @property
    def nv(self) -> int:
        """Number of velocities, those of the open robot."""
        return self.robot.nv

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row of A and each entry of λ."""
        return row_names(self.constraints)

    @property
    def redundant_rows(self) -> tuple[str, ...]:
        """The rows that depend on the others wherever loops are closed."""
        return tuple(name for k, name in enumerate(self.row_names) if k not in self.independent)

    # ── positions ──

    @lazy.by_blocks(lambda closed, _: [(sum(checks.with_gaps(closed.constraints)),)])
    def constraint_error(self, q: ArrayLike) -> Array:
        """Constraint error: by how much loops are open, in the rows that have a position.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        gap : (rows of closures,) array [rad, m]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> bool(abs(held.constraint_error(q)).max() < 1e-12)
        True
        """
        (q,) = self._state("constraint_error", q=q)
        return self.gaps(q).astype(q.dtype, copy=False)

    @lazy.by_blocks(lambda closed, _: [(closed.nq,)])
    def consistent(self, q: ArrayLike, tolerance: float = CLOSED, *, within: float = checks.NEAR) -> Array:
        """Configuration near q at which the loops are closed, to ``tolerance``.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        tolerance : float, how far loops may be open (rad, m, part of a shorter robot's length)
        within : float, warn where a joint went further than this (rad or m; ``np.inf``: never)

        Returns
        -------
        q : (nq,) array, configuration

        Raises
        ------
        ConstraintError
            No configuration is reached; the gap that is left is said.
        ShapeError
            ``q`` is of another size.
        ValueRangeError
            ``tolerance`` or ``within`` is not above 0.

        Warns
        -----
        ConstraintWarning
            A joint went further than ``within``.

        Notes
        -----
        Steps are the least in the kinetic metric, and where loops are far open they add up: ``robot.subtract(found,
        q)`` is how far each joint went.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.7, 1.1, 1.2], within=1.5)
        >>> q.round(4).tolist(), arm.subtract(q, [-0.7, 1.1, 1.2]).round(4).tolist()
        ([-0.6096, 0.1992, 2.2203], [0.0904, -0.9008, 1.0203])
        """
        (q,) = self._state("consistent", q=q)
        if not arguments.number(tolerance, "tolerance") > 0:
            raise ValueRangeError(f"tolerance={tolerance!r} is not allowed: a positive number, such as {CLOSED:g}.")
        if not arguments.number(within, "within") >= 0:
            raise ValueRangeError(f"within={within!r} is not allowed: rad or m, 0 or more, such as {checks.NEAR:g}.")
        flat, left = self.settled(q.reshape(-1, self.nq).astype(float), tolerance)
        checks.require_found(self, left, tolerance, q.shape[:-1])
        found = flat.reshape(q.shape).astype(q.dtype, copy=False)
        checks.warn_of_far(self.robot, q, found, within)
        return found

    def settled(self, starts: Array, tolerance: float) -> tuple[Array, Array]:
        """Configurations near starts, and the gap left at each: :meth:`consistent` without its judgement.

        Parameters
        ----------
        starts : (n, nq) array, configurations
        tolerance : float, how far loops may be open (rad, m, part of a shorter robot's length)

        Returns
        -------
        q : (n, nq) array
        gap : (n,) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.settled(np.array([[-0.6, 0.2, 2.2]]), 1e-12)[0].shape
        (1, 3)
        """
        closures = tuple(c for c in self.constraints if isinstance(c, Closure))
        if not closures:
            return starts, np.zeros(len(starts))
        return settled(
            starts,
            self.gaps,
            lambda q: (
                self.robot.engine.call("constraint_jacobian", q, constraints=closures),
                self.robot.mass_matrix(q),
            ),
            self.robot.add,
            self.sizes[checks.with_gaps(self.constraints)],
            checks.gap_units(self),
            tolerance,
        )

    def gaps(self, q: Array) -> Array:
        """Constraint error of checked q; see :meth:`constraint_error`.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        gap : (..., rows of closures) array [rad, m]

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.gaps(q).shape
        (2,)
        """
        if not any(isinstance(c, Closure) for c in self.constraints):
            return np.zeros((*q.shape[:-1], 0))
        return closure_gaps(self.constraints, self.robot.engine.call("closure_poses", q, constraints=self.constraints))

    # ── velocities and forces ──

    @lazy.by_blocks(lambda closed, _: [(len(closed.sizes), closed.nv)])
    def constraint_jacobian(self, q: ArrayLike) -> Array:
        """Constraint Jacobian A, with A dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        A : (k, nv) array, rows as in :attr:`row_names`

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

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
        (q,) = self._state("constraint_jacobian", q=q)
        if not self.constraints:
            return np.zeros((*q.shape[:-1], 0, self.nv))
        return np.asarray(self.robot.engine.call("constraint_jacobian", q, constraints=self.constraints))

    @lazy.by_blocks(lambda closed, _: [(len(closed.sizes),)])
    def constraint_bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Constraint bias (dA/dt) dq, so that A q̈ + (dA/dt) dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]

        Returns
        -------
        b : (k,) array, rows as in :attr:`row_names` [rad/s², m/s²]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.constraint_bias(q, [0, 0, 0]).tolist()
        [0.0, 0.0]
        """
        q, dq = self._state("constraint_bias", q=q, dq=dq)
        if not self.constraints:
            return np.zeros((*np.broadcast_shapes(q.shape[:-1], dq.shape[:-1]), 0))
        return np.asarray(self.robot.engine.call("constraint_bias", q, dq, constraints=self.constraints))

    @lazy.by_blocks(lambda *_: [()], dtype=int)
    def rank(self, q: ArrayLike) -> Array:
        """Rank of A at q: how many of its rows are independent; fewer than usual where the configuration is singular.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        count : () array of int

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> int(held.rank(q))
        2
        """
        return self._reach(*self._state("rank", q=q))[1].rank

    @lazy.by_blocks(lambda *_: [()], dtype=int)
    def degrees_of_freedom(self, q: ArrayLike) -> Array:
        """Degrees of freedom at q: nv less the rank of A.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        count : () array of int

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

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

    @lazy.by_blocks(lambda closed, _: [(closed.nv, closed.nv)])
    def projector(self, q: ArrayLike) -> Array:
        """Projector P = 1 - A'(A M⁻¹ A')⁻¹ A M⁻¹, which takes from torques what presses on the constraints.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        P : (nv, nv) array

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
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
        (q,) = self._state("projector", q=q)
        return self._reach(q)[1].projector.astype(q.dtype, copy=False)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)] * 2, MotionForceSplit)
    def split(self, q: ArrayLike, tau: ArrayLike) -> MotionForceSplit:
        """Torques split into those that move the robot, Pτ, and those that the constraints bear.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        tau : (nv,) array_like, joint torques [N m, sliding joints: N]

        Returns
        -------
        parts : MotionForceSplit, ``motion`` and ``force`` (nv,) [N m, sliding joints: N]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
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
        q, tau = self._state("split", q=q, tau=tau)
        motion = (self._reach(q)[1].projector @ tau[..., None])[..., 0].astype(np.result_type(q, tau), copy=False)
        return MotionForceSplit(motion, tau - motion)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_velocity(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocity nearest in the kinetic metric that meets A dq = 0: P'dq.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]

        Returns
        -------
        dq : (nv,) array [rad/s, m/s]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
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
        q, dq = self._state("project_velocity", q=q, dq=dq)
        return self._nearest(q, dq, 0.0)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_acceleration(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Acceleration nearest in the kinetic metric that meets A q̈ + (dA/dt) dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]

        Returns
        -------
        ddq : (nv,) array [rad/s², m/s²]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
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
        q, dq, ddq = self._state("project_acceleration", q=q, dq=dq, ddq=ddq)
        return self._nearest(q, ddq, self.constraint_bias(q, dq))

    def _nearest(self, q: Array, v: Array, b: Array | float) -> Array:
        A, reach = self._reach(q)
        return reach.nearest(v, (A @ v[..., None])[..., 0] + b).astype(np.result_type(q, v), copy=False)

    def wrenches(self, lam: ArrayLike) -> dict[str, Array]:
        """Constraint wrenches: λ as wrenches (m, f) that the robot applies where it is held.

        Parameters
        ----------
        lam : (k,) array_like, λ of :meth:`forward_dynamics` or :meth:`inverse_dynamics` [N m, N]

        Returns
        -------
        wrenches : {name of the constraint: (6,) array} [N m, N]

        Raises
        ------
        ShapeError
            ``lam`` has not a number for each row.

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

    # ── dynamics ──

    @lazy.by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedMotion)
    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> ConstrainedMotion:
        """Constrained forward dynamics: q̈ and λ of τ = M q̈ + h + A'λ + Σ J'F_by - Σ J'F_on, A q̈ + (dA/dt) dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        tau : (nv,) array_like, joint torques [N m, sliding joints: N]
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, count the friction of the joints

        Returns
        -------
        motion : ConstrainedMotion
            ``ddq`` (nv,) [rad/s², m/s²] and ``lam`` (k,) [N m, N], rows as in :attr:`row_names`.

        Raises
        ------
        ConstraintError
            q leaves loops open by a hundredth (rad, and of what the joints' lever is), or a tenth of dq breaks the
            constraints.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        UnknownNameError
            A wrench is at no frame of the robot.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Warns
        -----
        ConstraintWarning
            The configuration is singular.

        Notes
        -----
        MR section 8.7. λ = (A M⁻¹ A')⁻¹ (A M⁻¹ (τ - h) + (dA/dt) dq), of least norm where rows are redundant or the
        configuration is singular.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> motion = held.forward_dynamics(q, [0, 0, 0], [0, 0, 0])
        >>> bool(abs(held.constraint_jacobian(q) @ motion.ddq).max() < 1e-12)
        True
        """
        q, dq, tau = self._state("forward_dynamics", q=q, dq=dq, tau=tau)
        checks.require_met(self, q, dq)
        if friction:
            tau = self.robot.engine.call("torque_past_friction", dq, tau)
        by, on = wrench_by_robot, wrench_on_robot
        if not self._kept:
            ddq = self.robot.forward_dynamics(q, dq, tau, wrench_by_robot=by, wrench_on_robot=on)
            return ConstrainedMotion(ddq, np.zeros((*ddq.shape[:-1], len(self.sizes)), ddq.dtype))
        rows, call = list(self.independent), self.robot.engine.call_with_wrenches
        with np.errstate(all="ignore"):
            ddq, some, pivots = call("constrained_dynamics", (q, dq, tau), by, on, None, constraints=self._kept)
        lam = np.zeros((*some.shape[:-1], len(self.sizes)), some.dtype)
        lam[..., rows] = some
        again = doubtful(pivots, self.sizes[rows])
        if len(rows) < len(self.sizes) and not again.all():
            usual = np.broadcast_to(q, (*again.shape, self.nq))[~again]
            lam[~again] = (self._reach(usual)[1].range @ lam[~again][..., None])[..., 0]
        if again.any():
            h = call("bias_forces", (q, dq), by, on, None)
            q, dq, force = (np.broadcast_to(x, (*again.shape, x.shape[-1]))[again] for x in (q, dq, tau - h))
            ddq[again], lam[again] = self._by_singular_values(q, dq, force)
        return ConstrainedMotion(ddq, lam)

    def _by_singular_values(self, q: Array, dq: Array, force: Array) -> tuple[Array, Array]:
        """The same from τ - h (n, nv), however singular A is."""
        _, reach = self._reach(q)
        checks.warn_of_singular(reach.rank, len(self.independent))
        return reach.constrained(force, self.constraint_bias(q, dq))

    @lazy.by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedTorques)
    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> ConstrainedTorques:
        """Constrained inverse dynamics: τ of the ``actuated`` joints, and λ, for a motion that meets the constraints.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]
        actuated : iterable of str, optional, joints that have a motor; None: all
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, add what overcomes the friction of all joints, driven or not
            As :meth:`forward_dynamics` takes off; friction that grows with the load is that of the torques the open
            robot would need.

        Returns
        -------
        torques : ConstrainedTorques
            ``tau`` (nv,) [N m, sliding joints: N], zero at the other joints, and ``lam`` (k,) [N m, N].

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints, as in :meth:`forward_dynamics`, or the motors named cannot make the
            motion.
        UnknownNameError
            ``actuated`` names no joint of the robot.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Notes
        -----
        With more motors than degrees of freedom τ is the one of least norm.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> torques = held.inverse_dynamics(q, [0, 0, 0], [0, 0, 0], actuated=["joint1"])
        >>> torques.tau.nonzero()[0].tolist()
        [0]
        """
        q, dq, ddq = self._state("inverse_dynamics", q=q, dq=dq, ddq=ddq)
        checks.require_met(self, q, dq, ddq)
        driven = checks.driven(self.robot, actuated)
        by, on = wrench_by_robot, wrench_on_robot
        with np.errstate(all="ignore"):
            f = self.robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on, friction=friction)
        f = arguments.finite(
            f, "inverse_dynamics: the torque of wrench_by_robot, wrench_on_robot and the motion", self.nv
        )
        A, reach = self._reach(q)
        lam, left = balance(f, reach.range @ A, self.sizes, driven)  # λ of what never moves would be any number
        checks.require_made(self, left, f, driven)
        tau = np.where(driven, f + (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0], 0.0)
        lam = (reach.range @ lam[..., None])[..., 0]
        return ConstrainedTorques(tau.astype(f.dtype, copy=False), lam.astype(f.dtype, copy=False))

    # ── inputs ──

    @cached_property
    def _kept(self) -> tuple[Constraint, ...]:
        """The constraints with their independent rows alone."""
        return checks.kept(self.constraints, self.independent)

    def _reach(self, q: Array) -> tuple[Array, Reach]:
        A = self.constraint_jacobian(q)
        return A, Reach.of(A, self.robot.mass_matrix(q), self.sizes, len(self.independent))

    def _state(self, name: str, **arrays: ArrayLike) -> list[Array]:
        """Arrays of finite numbers of the right last axis whose batch shapes broadcast."""
        model, sizes = self.robot.model, {"q": self.nq}
        found = [
            arguments.finite(array, f"{name}: {x}", sizes.get(x, self.nv), names=names_of(model, x))
            for x, array in arrays.items()
        ]
        try:
            np.broadcast_shapes(*(array.shape[:-1] for array in found))
        except ValueError:
            raise arguments.mismatch(**dict(zip(arrays, found, strict=True))) from None
        return found
