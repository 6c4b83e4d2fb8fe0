"""Methods for loops and other velocity constraints of a robot, A(q) dq = 0. Modern Robotics section 8.7.

Constraints act on the robot with its loops open, a tree without constraints. Shapes are given for one state; any leading
batch shape is allowed.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments, third_party
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.typing import Array
from .arguments import Kind, Rows, finite_states
from .base import RobotBase
from .engine import ConstrainedEngine

if TYPE_CHECKING:
    from ..mechanics.algorithms.constraint_projector import ConstraintProjector
    from ..mechanics.algorithms.constraints import Constraint, MotionForceSplit
    from .constraints.loop_closure_solver import LoopClosureSolver
    from .doors import ConstrainedRobot
    from .robot import Robot

MAX_CLOSED_GAP = 1e-12
"""Gap (rad, and fraction of the robot's length) below which loops count as closed; positions round at about 1e-15."""
MAX_NEAR_DISPLACEMENT = 0.5
"""Largest displacement (rad and m) at which a closed configuration still counts as near."""


def _make_split(motion: Array, force: Array) -> MotionForceSplit:
    from ..mechanics.algorithms.constraints import MotionForceSplit

    return MotionForceSplit(motion, force)


def _gap_count(closed: ConstrainedRobot) -> int:
    """Number of rows that constrain a position."""
    from ..mechanics.algorithms.constraints import with_gaps

    return sum(with_gaps(closed.constraints))


class ConstraintMethods(RobotBase):
    """Constraints of a robot: A, its rank and projections, closed configurations, constraint forces."""

    sizes: Array = np.zeros(0)
    """Typical size of each row of A, scaled by the mass matrix; singular values are compared with it."""
    independent: tuple[int, ...] = ()
    """Indices of the rows of A that do not depend on earlier rows."""
    spans: Array = np.zeros(0)
    """Scale of each row's gap: 1 rad, or the typical lever of its joints in m, at most 1 m."""

    def __repr__(self) -> str:
        if self._tree is None:
            return super().__repr__()
        from ..mechanics.lie.labelled import TWIST

        constraint_texts = []
        for constraint in self.constraints:
            rows = " ".join(TWIST[k] for k in constraint.rows)
            constraint_texts.append(f"{constraint.name} {rows}")
        freedoms = self.nv - len(self.independent)
        degrees = "degree" if freedoms == 1 else "degrees"
        return f"<Robot {self.name!r}: {', '.join(constraint_texts)}; {freedoms} {degrees} of freedom>"

    def __getstate__(self) -> Any:
        if self._tree is None:
            return super().__getstate__()
        return self._tree, self.constraints, self.sizes, self.spans, self.independent

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, tuple):
            self._constrain(*state)
        else:
            super().__setstate__(state)

    def _constrain(
        self, tree: Robot, constraints: tuple[Constraint, ...], sizes: Array, spans: Array, independent: tuple[int, ...]
    ) -> None:
        """Fill in a new robot: ``tree`` with constraints."""
        for array in (sizes, spans):
            array.setflags(write=False)
        self._tree = tree
        self.constraints = constraints
        self.sizes = sizes
        self.spans = spans
        self.independent = independent
        self.engine = ConstrainedEngine(tree.engine, self._independent_constraints)

    def close(
        self,
        frame_a: str,
        frame_b: str,
        rows: Rows = None,
        *,
        pose: ArrayLike | None = None,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ConstrainedRobot:
        """Closed loop: the robot with ``frame_b`` constrained to ``frame_a``; its dynamics are those with constraint forces.

        The selected rows of the twist of {b} relative to {c}, along the axes of {c}, are zero, and {b} lies on {c} in
        these directions. Loops are closed one after another. MR section 8.7.

        Parameters
        ----------
        frame_a, frame_b : str, frames of the robot; ``"ground"`` is the base
        rows : str or iterable, optional, rows of the twist that are constrained
            All six (None) are a weld; ``"vx vy vz"`` is a ball joint; all but ``wz`` is a hinge about z.
        pose : (4, 4) array_like, optional, pose of {c} in {a}; None: the identity

        Raises
        ------
        ConstraintError
            No configuration with closed loops is found, or rows depend on others and ``redundant`` is not "accept".

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> at_the_wall = tw.se3.exp([0, 0, 0, 1.5, 0, 0])
        >>> arm.close("ground", arm.tip, rows="vx vz", pose=at_the_wall)
        <Robot 'planar_3r': ground–tip vx vz; 1 degree of freedom>
        >>> arm.close("ground", "tip", rows="vz").close("ground", "tip", rows="wy").row_names
        ('ground–tip vz', 'ground–tip #2 wy')
        """
        from .constraints.closures import closure

        return self._with(closure(self.model, frame_a, frame_b, rows, pose), near, redundant)

    def constrain(
        self,
        frame: str,
        rows: Rows,
        kind: Kind = "body",
        *,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ConstrainedRobot:
        """Velocity constraint: the robot with selected rows of a frame's twist zero, as for a wheel or a blade.

        The position stays free. To constrain it, as for a hand on a plane, use :meth:`close` with ``"ground"``.

        Parameters
        ----------
        frame : str, a frame of the robot
        rows : str or iterable, rows of the twist that are zero
        kind : "body", "space" or "world_aligned", as for :meth:`jacobian`
            With ``"body"``, ``"vz"`` is along the frame's own z in any orientation. For a hand on a level table, use
            ``kind="world_aligned"``.

        Raises
        ------
        ConstraintError
            Rows depend on others and ``redundant`` is not "accept".

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy")
        <Robot 'floating_box': box vy; 5 degrees of freedom>
        >>> tw.robots.floating_box().constrain("box", "vy").constrain("box", "vz").row_names
        ('box vy', 'box #2 vz')
        """
        from .constraints.closures import rolling

        return self._with(rolling(self.model, frame, rows, kind), near, redundant)

    def _with(self, new_constraint: Constraint, near: ArrayLike | None, redundant: str) -> ConstrainedRobot:
        """Robot with one additional constraint."""
        if redundant not in ("error", "accept"):
            raise ValueRangeError(f"redundant={redundant!r} is not allowed. Choose from: 'error', 'accept'.")
        from ..mechanics.algorithms.constraint_projector import independent_rows
        from .constraints.closures import refuse_redundant, require_angle, some_configurations
        from .constraints.tolerances import row_sizes

        tree = self.open()
        constraints = (*self.constraints, new_constraint)
        sizes, spans = row_sizes(cast("ConstrainedRobot", self), new_constraint)

        def constrained_robot(independent: tuple[int, ...]) -> ConstrainedRobot:
            robot = cast("ConstrainedRobot", type(self).__new__(type(self)))
            robot._constrain(tree, constraints, sizes, spans, independent)
            return robot

        # At first all rows count as independent; their rank is found at closed configurations.
        closed = constrained_robot(tuple(range(len(sizes))))
        q = some_configurations(closed, near)
        require_angle(closed, q)
        independent = independent_rows(closed.constraint_jacobian(q), tree.mass_matrix(q), sizes)
        closed = constrained_robot(independent)
        new_redundant_rows = set(closed.redundant_rows) - set(self.redundant_rows)
        if redundant == "error" and new_redundant_rows:
            refuse_redundant(closed)
        return closed

    # ── properties ──

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row of A and each entry of λ."""
        from ..mechanics.algorithms.constraints import row_names

        return row_names(self.constraints)

    @property
    def redundant_rows(self) -> tuple[str, ...]:
        """Rows that depend on the others at every configuration with closed loops."""
        return tuple(name for k, name in enumerate(self.row_names) if k not in self.independent)

    @cached_property
    def _independent_constraints(self) -> tuple[Constraint, ...]:
        """Constraints reduced to their independent rows."""
        from ..mechanics.algorithms.constraints import independent_constraints

        return independent_constraints(self.constraints, self.independent)

    def _searched_loops(self) -> LoopClosureSolver:
        """Solver for the loop gaps, as rows of a search."""
        from .constraints.loop_closure_solver import LoopClosureSolver

        key = ("searched loops", self.constraints, self.independent)
        solver: LoopClosureSolver = self.open().engine.cache(
            key, lambda: LoopClosureSolver(cast("ConstrainedRobot", self))
        )
        return solver

    # ── A, its rank, and projections ──

    @third_party.lazy_by_blocks(lambda closed, _: [(len(closed.sizes), closed.nv)])
    def constraint_jacobian(self, q: ArrayLike) -> Array:
        """Constraint Jacobian A, with A dq = 0.

        Returns
        -------
        A : (k, nv) array, rows as in :attr:`row_names`
        """
        (q,) = finite_states(self.model, "constraint_jacobian", q=q)
        if not self.constraints:
            return np.zeros((*q.shape[:-1], 0, self.nv))
        return np.asarray(self.open().engine.call("constraint_jacobian", q, constraints=self.constraints))

    @third_party.lazy_by_blocks(lambda closed, _: [(len(closed.sizes),)])
    def constraint_bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Constraint bias (dA/dt) dq, so that A q̈ + (dA/dt) dq = 0.

        Returns
        -------
        b : (k,) array, rows as in :attr:`row_names` [rad/s², m/s²]
        """
        q, dq = finite_states(self.model, "constraint_bias", q=q, dq=dq)
        if not self.constraints:
            return np.zeros((*np.broadcast_shapes(q.shape[:-1], dq.shape[:-1]), 0))
        return np.asarray(self.open().engine.call("constraint_bias", q, dq, constraints=self.constraints))

    @third_party.lazy_by_blocks(lambda *_: [()], dtype=int)
    def rank(self, q: ArrayLike) -> Array:
        """Rank of A at q: number of independent rows; lower than usual if the configuration is singular.

        Returns
        -------
        count : () array of int
        """
        (q,) = finite_states(self.model, "rank", q=q)
        _, projector = self._projector(q)
        return projector.rank

    @third_party.lazy_by_blocks(lambda *_: [()], dtype=int)
    def degrees_of_freedom(self, q: ArrayLike) -> Array:
        """Degrees of freedom at q: nv minus the rank of A.

        Returns
        -------
        count : () array of int
        """
        return self.nv - self.rank(q)

    @third_party.lazy_by_blocks(lambda closed, _: [(closed.nv, closed.nv)])
    def projector(self, q: ArrayLike) -> Array:
        """Projector P = 1 - A'(A M⁻¹ A')⁻¹ A M⁻¹, which removes the part of the torques that the constraints bear.

        Its transpose removes the part of velocities that violates the constraints.

        Returns
        -------
        P : (nv, nv) array
        """
        (q,) = finite_states(self.model, "projector", q=q)
        _, projector = self._projector(q)
        return projector.projector.astype(q.dtype, copy=False)

    @third_party.lazy_by_blocks(lambda closed, _: [(closed.nv,)] * 2, _make_split)
    def split(self, q: ArrayLike, tau: ArrayLike) -> MotionForceSplit:
        """Torques split into those that move the robot, Pτ, and those that the constraints bear.

        Returns
        -------
        parts : MotionForceSplit, ``motion`` and ``force`` (nv,) [N m, sliding joints: N]
        """
        q, tau = finite_states(self.model, "split", q=q, tau=tau)
        _, projector = self._projector(q)
        motion = (projector.projector @ tau[..., None])[..., 0]
        motion = motion.astype(np.result_type(q, tau), copy=False)
        return _make_split(motion, tau - motion)

    @third_party.lazy_by_blocks(lambda closed, _: [(closed.nv,)])
    def project_velocity(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocity nearest to dq in the kinetic metric that satisfies A dq = 0: P'dq.

        Returns
        -------
        dq : (nv,) array [rad/s, m/s]
        """
        q, dq = finite_states(self.model, "project_velocity", q=q, dq=dq)
        return self._nearest(q, dq, 0.0)

    @third_party.lazy_by_blocks(lambda closed, _: [(closed.nv,)])
    def project_acceleration(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Acceleration nearest to ddq in the kinetic metric that satisfies A q̈ + (dA/dt) dq = 0.

        Returns
        -------
        ddq : (nv,) array [rad/s², m/s²]
        """
        q, dq, ddq = finite_states(self.model, "project_acceleration", q=q, dq=dq, ddq=ddq)
        return self._nearest(q, ddq, self.constraint_bias(q, dq))

    def _projector(self, q: Array) -> tuple[Array, ConstraintProjector]:
        """A at q and its projector, weighted with the mass matrix."""
        from ..mechanics.algorithms.constraint_projector import ConstraintProjector

        A = self.constraint_jacobian(q)
        M = self.open().mass_matrix(q)
        return A, ConstraintProjector.from_rows(A, M, self.sizes, max_rank=len(self.independent))

    def _nearest(self, q: Array, rates: Array, bias: Array | float) -> Array:
        """Rates nearest to ``rates`` (..., nv) in the kinetic metric that satisfy A rates + bias = 0."""
        A, projector = self._projector(q)
        violation = (A @ rates[..., None])[..., 0] + bias
        return projector.nearest(rates, violation).astype(np.result_type(q, rates), copy=False)

    def wrenches(self, lam: ArrayLike) -> dict[str, Array]:
        """Constraint wrenches: λ as wrenches (m, f) that the robot exerts on its constraints.

        The wrench of a closure is exerted by {b} on {a}, at the origin of {b}, along the axes of {c}.

        Parameters
        ----------
        lam : (k,) array_like, λ of :meth:`forward_dynamics` or :meth:`inverse_dynamics` [N m, N]

        Returns
        -------
        wrenches : {name of the constraint: (6,) array} [N m, N]
        """
        from ..mechanics.algorithms.constraints import names

        lam = arguments.finite(lam, "lam", len(self.sizes))
        wrenches = {}
        first_row = 0
        for name, constraint in zip(names(self.constraints), self.constraints, strict=True):
            rows = list(constraint.rows)
            F = np.zeros((*lam.shape[:-1], 6))
            F[..., rows] = lam[..., first_row : first_row + len(rows)]
            wrenches[name] = F
            first_row += len(rows)
        return wrenches

    # ── positions ──

    @third_party.lazy_by_blocks(lambda closed, _: [(_gap_count(closed),)])
    def constraint_error(self, q: ArrayLike) -> Array:
        """Constraint error: gap of the loops, in the rows that constrain a position.

        Returns
        -------
        gap : (rows of closures,) array [rad, m]
        """
        (q,) = finite_states(self.model, "constraint_error", q=q)
        return self.gaps(q).astype(q.dtype, copy=False)

    @third_party.lazy_by_blocks(lambda closed, _: [(closed.nq,)])
    def consistent(
        self, q: ArrayLike, tolerance: float = MAX_CLOSED_GAP, *, within: float = MAX_NEAR_DISPLACEMENT
    ) -> Array:
        """Configuration near q at which the loops are closed, to ``tolerance``.

        Each step is minimal in the kinetic metric. If loops are far open, the steps add up:
        ``robot.subtract(found, q)`` is the displacement of each joint.

        Parameters
        ----------
        tolerance : float, allowed gap of the loops (rad, m; a fraction of the length if the robot is shorter than 1 m)
        within : float, warn if a joint moves further than this (rad or m; ``np.inf``: never)

        Returns
        -------
        q : (nq,) array, configuration

        Raises
        ------
        ConstraintError
            No closed configuration is found; the message gives the remaining gap.

        Warns
        -----
        ConstraintWarning
            A joint moved further than ``within``.
        """
        (q,) = finite_states(self.model, "consistent", q=q)
        if not arguments.number(tolerance, "tolerance") > 0:
            raise ValueRangeError(
                f"tolerance={printed(tolerance)} is not allowed: a positive number, such as {printed(MAX_CLOSED_GAP)}."
            )
        if not arguments.number(within, "within") >= 0:
            raise ValueRangeError(
                f"within={printed(within)} is not allowed: rad or m, 0 or more, such as {printed(MAX_NEAR_DISPLACEMENT)}."
            )
        from .constraints.states import require_closed, warn_of_far

        starts = q.reshape(-1, self.nq).astype(float)
        flat_closed_q, gaps = self.settled(starts, tolerance)
        require_closed(cast("ConstrainedRobot", self), gaps, tolerance, q.shape[:-1])
        closed_q = flat_closed_q.reshape(q.shape).astype(q.dtype, copy=False)
        warn_of_far(self.open(), q, closed_q, within)
        return closed_q

    def settled(self, starts: Array, tolerance: float) -> tuple[Array, Array]:
        """Configurations near starts and the remaining gaps: :meth:`consistent` without checks.

        Parameters
        ----------
        starts : (n, nq) array, configurations
        tolerance : float, allowed gap of the loops (rad, m; a fraction of the length if the robot is shorter than 1 m)

        Returns
        -------
        q : (n, nq) array
        gap : (n,) array
        """
        from ..mechanics.algorithms.constraints import Closure, with_gaps
        from ..mechanics.algorithms.loop_closure import LoopProblem, close_loops
        from .constraints.tolerances import gap_units

        closures = tuple(constraint for constraint in self.constraints if isinstance(constraint, Closure))
        if not closures:
            return starts, np.zeros(len(starts))
        robot = self.open()
        sizes = self.sizes[with_gaps(self.constraints)]
        units = gap_units(cast("ConstrainedRobot", self))

        def rows_and_mass(q: Array) -> tuple[Array, Array]:
            return robot.engine.call("constraint_jacobian", q, constraints=closures), robot.mass_matrix(q)

        problem = LoopProblem(self.gaps, rows_and_mass, robot.add, sizes, units)
        return close_loops(starts, problem, tolerance)

    def gaps(self, q: Array) -> Array:
        """Constraint error at validated q; see :meth:`constraint_error`.

        Returns
        -------
        gap : (..., rows of closures) array [rad, m]
        """
        from ..mechanics.algorithms.constraints import Closure
        from ..mechanics.algorithms.loop_closure import closure_gaps

        if not any(isinstance(constraint, Closure) for constraint in self.constraints):
            return np.zeros((*q.shape[:-1], 0))
        poses = self.open().engine.call("closure_poses", q, constraints=self.constraints)
        return closure_gaps(self.constraints, poses)


complete(globals())
