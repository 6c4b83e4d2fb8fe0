"""Closed robots: a robot with loops or other constraints on its velocity, A(q) dq = 0. Modern Robotics section 8.7.

The equations of motion are those of the open robot with the forces of constraint in them,

    τ = M q̈ + h + A'λ,   A q̈ + (dA/dt) dq = 0,

so λ is what the robot applies where it is held, as in τ = M q̈ + h + J'F_by. Shapes are those of one state; any leading batch
shape goes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ...algorithms.constraints import Closure, Constraint, row_names, with_gaps
from ...algorithms.loop_closure import closure_gaps, independent_rows, settled
from ...core import arguments, third_party
from ...core.glossary import complete
from ...core.numbers import printed
from ...errors import ValueRangeError
from ...lie.labelled import TWIST
from ...typing import Array
from ..arguments import finite_states
from ..robot import Robot
from ..task_space_methods import ActuationMethods
from . import checks
from .constraints import CLOSED, gap_units, row_sizes
from .methods import ClosedDynamicsMethods, ClosedLoadMethods, ClosedSharedMethods

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRobot(
    ClosedDynamicsMethods,
    ClosedLoadMethods,
    ClosedSharedMethods,
    ActuationMethods,
):
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
    """Usual size of each row of A, through the mass matrix, which singular values are compared with."""
    independent: tuple[int, ...] = ()
    """Numbers of the rows of A that do not depend on earlier ones."""
    spans: Array = field(default_factory=lambda: np.zeros(0))
    """Scale of a gap of each row: 1 rad, or m, the usual lever of its joints, 1 at most."""

    def __post_init__(self) -> None:
        for array in (self.sizes, self.spans):
            array.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()  # arrays come out of a pickle writable

    def _closed(self) -> ClosedRobot:
        return self

    def __repr__(self) -> str:
        held = ", ".join(f"{c.name} {' '.join(TWIST[k] for k in c.rows)}" for c in self.constraints)
        free = self.robot.nv - len(self.independent)
        return f"<ClosedRobot {self.robot.name!r}: {held or 'open'}; {free} degree{'s' * (free != 1)} of freedom>"

    if not TYPE_CHECKING:  # so that checkers of types refuse these names too

        def __getattr__(self, name: str) -> NoReturn:
            """Name the open robot's method in the error; forwarding it would ignore the loops."""
            hint = ""
            if not name.startswith("_") and hasattr(Robot, name):
                call = "(…)" if callable(getattr(Robot, name)) else ""
                hint = f" Of the robot with its loops open, without the constraints: closed.robot.{name}{call}."
            raise AttributeError(f"a ClosedRobot has no {name!r}.{hint}", name=name, obj=self)

    def _with(self, new: Constraint, near: ArrayLike | None, redundant: str) -> ClosedRobot:
        if redundant not in checks.REDUNDANT:
            raise ValueRangeError(f"redundant={redundant!r} is not allowed. Choose from: 'error', 'accept'.")
        sizes, spans = row_sizes(self, new)
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
    def row_names(self) -> tuple[str, ...]:
        """A name for each row of A and each entry of λ."""
        return row_names(self.constraints)

    @property
    def redundant_rows(self) -> tuple[str, ...]:
        """The rows that depend on the others wherever loops are closed."""
        return tuple(name for k, name in enumerate(self.row_names) if k not in self.independent)

    # ── positions ──

    @third_party.by_blocks(lambda closed, _: [(sum(with_gaps(closed.constraints)),)])
    def constraint_error(self, q: ArrayLike) -> Array:
        """Constraint error: by how much loops are open, in the rows that have a position.

        Returns
        -------
        gap : (rows of closures,) array [rad, m]

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> bool(abs(held.constraint_error(q)).max() < 1e-12)
        True
        """
        (q,) = finite_states(self.robot.model, "constraint_error", q=q)
        return self.gaps(q).astype(q.dtype, copy=False)

    @third_party.by_blocks(lambda closed, _: [(closed.nq,)])
    def consistent(self, q: ArrayLike, tolerance: float = CLOSED, *, within: float = checks.NEAR) -> Array:
        """Configuration near q at which the loops are closed, to ``tolerance``.

        Parameters
        ----------
        tolerance : float, how far loops may be open (rad, m, part of a shorter robot's length)
        within : float, warn where a joint went further than this (rad or m; ``np.inf``: never)

        Returns
        -------
        q : (nq,) array, configuration

        Raises
        ------
        ConstraintError
            No configuration is reached; the gap that is left is said.

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
        (q,) = finite_states(self.robot.model, "consistent", q=q)
        if not arguments.number(tolerance, "tolerance") > 0:
            raise ValueRangeError(
                f"tolerance={printed(tolerance)} is not allowed: a positive number, such as {printed(CLOSED)}."
            )
        if not arguments.number(within, "within") >= 0:
            raise ValueRangeError(
                f"within={printed(within)} is not allowed: rad or m, 0 or more, such as {printed(checks.NEAR)}."
            )
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
            self.sizes[with_gaps(self.constraints)],
            gap_units(self),
            tolerance,
        )

    def gaps(self, q: Array) -> Array:
        """Constraint error of checked q; see :meth:`constraint_error`.

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


complete(globals())
