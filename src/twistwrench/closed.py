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
from numpy.typing import ArrayLike, NDArray

from . import closing
from .algorithms.balance import balance
from .algorithms.constrained import ConstrainedMotion, ConstrainedTorques, MotionForceSplit
from .algorithms.constraints import Closure, Constraint, Rolling, names, place_of, row_names
from .algorithms.gaps import closure_gaps, settled
from .algorithms.jacobians import KINDS
from .algorithms.reach import Reach, doubtful, independent_rows
from .algorithms.task_space import ROWS, row_numbers
from .core import arguments, lazy
from .errors import ConstraintError, UnknownNameError, ValueRangeError
from .model.model import BASE
from .robot import Robot, Rows, Wrenches

Array = NDArray[Any]

CLOSED = 1e-12
"""rad, and part of the robot's length: loops closed to this are closed; positions are rounded to some 1e-15 of it."""

__all__ = ["ClosedRobot", "ConstrainedMotion", "ConstrainedTorques", "MotionForceSplit"]


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRobot:
    """A robot whose loops are closed, by :meth:`twistwrench.Robot.close` and :meth:`~twistwrench.Robot.constrain`. Immutable.

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
        """Close one more loop; see :meth:`twistwrench.Robot.close`."""
        model = self.robot.model
        frame_a, frame_b = closing.named(model, frame_a), closing.named(model, frame_b)
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
        """Constrain one more velocity, along the frame's own axes (``"body"``); see :meth:`twistwrench.Robot.constrain`."""
        if kind not in KINDS:
            raise UnknownNameError.of("kind", kind, KINDS)
        frame = closing.named(self.robot.model, frame)
        if self.robot.model.frame(frame).body == BASE:
            raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
        return self._with(Rolling(frame, row_numbers(rows), kind), near, redundant)

    def _with(self, new: Constraint, near: ArrayLike | None, redundant: str) -> ClosedRobot:
        if redundant not in closing.REDUNDANT:
            raise ValueRangeError(f"redundant={redundant!r} is not allowed. Choose from: 'error', 'accept'.")
        sizes, spans = closing.row_sizes(self, new)
        rows = tuple(range(len(sizes)))
        closed = replace(self, constraints=(*self.constraints, new), sizes=sizes, spans=spans, independent=rows)
        q = closing.some_configurations(closed, near)
        closing.require_angle(closed, q)
        rows = independent_rows(closed.constraint_jacobian(q), self.robot.mass_matrix(q), sizes)
        closed = replace(closed, independent=rows)
        if redundant == "error" and set(closed.redundant_rows) - set(self.redundant_rows):
            closing.refuse_redundant(closed)
        return closed

    # ── what it is ──

    @property
    def nq(self) -> int:
        """Number of coordinates, those of the open robot."""
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

    @lazy.by_blocks(lambda closed, _: [(sum(closing.with_gaps(closed.constraints)),)])
    def constraint_error(self, q: ArrayLike) -> Array:
        """By how much loops are open, in the rows that have a position, rad and m; (nq) → (rows of closures)."""
        (q,) = self._state("constraint_error", q=q)
        return self.gaps(q).astype(q.dtype, copy=False)

    @lazy.by_blocks(lambda closed, _: [(closed.nq,)])
    def consistent(self, q: ArrayLike, tolerance: float = CLOSED, *, within: float = closing.NEAR) -> Array:
        """A configuration near q with loops closed to ``tolerance`` (rad, m, part of a shorter robot's length); (nq) → (nq).

        Steps are the least in the kinetic metric, and where loops are far open they add up: ``robot.subtract(found, q)`` is how
        far each joint went. A ConstraintWarning says so where one went further than ``within`` (rad or m; ``np.inf``: never).
        Raises ConstraintError, with the gap that is left, where no configuration is reached.

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
            raise ValueRangeError(f"within={within!r} is not allowed: rad or m, 0 or more, such as {closing.NEAR:g}.")
        flat, left = self.settled(q.reshape(-1, self.nq).astype(float), tolerance)
        closing.require_found(self, left, tolerance, q.shape[:-1])
        found = flat.reshape(q.shape).astype(q.dtype, copy=False)
        closing.warn_of_far(self.robot, q, found, within)
        return found

    def settled(self, starts: Array, tolerance: float) -> tuple[Array, Array]:
        """Configurations near the starts (n, nq) and the gap left at each (n,): :meth:`consistent` without its judgement."""
        closures = tuple(c for c in self.constraints if isinstance(c, Closure))
        if not closures:
            return starts, np.zeros(len(starts))
        return settled(
            starts,
            self.gaps,
            lambda q: (self.robot._call("constraint_jacobian", q, constraints=closures), self.robot.mass_matrix(q)),
            self.robot.add,
            self.sizes[closing.with_gaps(self.constraints)],
            closing.gap_units(self),
            tolerance,
        )

    def gaps(self, q: Array) -> Array:
        """:meth:`constraint_error` of checked q."""
        if not any(isinstance(c, Closure) for c in self.constraints):
            return np.zeros((*q.shape[:-1], 0))
        return closure_gaps(self.constraints, self.robot._call("closure_poses", q, constraints=self.constraints))

    # ── velocities and forces ──

    @lazy.by_blocks(lambda closed, _: [(len(closed.sizes), closed.nv)])
    def constraint_jacobian(self, q: ArrayLike) -> Array:
        """A, with A dq = 0; (nq) → (k, nv), rows as in :attr:`row_names`."""
        (q,) = self._state("constraint_jacobian", q=q)
        if not self.constraints:
            return np.zeros((*q.shape[:-1], 0, self.nv))
        return np.asarray(self.robot._call("constraint_jacobian", q, constraints=self.constraints))

    @lazy.by_blocks(lambda closed, _: [(len(closed.sizes),)])
    def constraint_bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """(dA/dt) dq, so that A q̈ + (dA/dt) dq = 0; (nq), (nv) → (k)."""
        q, dq = self._state("constraint_bias", q=q, dq=dq)
        if not self.constraints:
            return np.zeros((*np.broadcast_shapes(q.shape[:-1], dq.shape[:-1]), 0))
        return np.asarray(self.robot._call("constraint_bias", q, dq, constraints=self.constraints))

    @lazy.by_blocks(lambda *_: [()], dtype=int)
    def rank(self, q: ArrayLike) -> Array:
        """How many rows of A are independent at q; fewer than usual where the configuration is singular; (nq) → ()."""
        return self._reach(*self._state("rank", q=q))[1].rank

    @lazy.by_blocks(lambda *_: [()], dtype=int)
    def degrees_of_freedom(self, q: ArrayLike) -> Array:
        """nv less the rank; (nq) → ()."""
        return self.nv - self.rank(q)

    @lazy.by_blocks(lambda closed, _: [(closed.nv, closed.nv)])
    def projector(self, q: ArrayLike) -> Array:
        """P = 1 - A'(A M⁻¹ A')⁻¹ A M⁻¹, which takes from torques what presses on the constraints; (nq) → (nv, nv).

        Its transpose takes from velocities what breaks them. MR section 8.7.
        """
        (q,) = self._state("projector", q=q)
        return self._reach(q)[1].projector.astype(q.dtype, copy=False)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)] * 2, MotionForceSplit)
    def split(self, q: ArrayLike, tau: ArrayLike) -> MotionForceSplit:
        """Torques as those that move the robot, Pτ, and those that the constraints bear; (nq), (nv) → (nv), (nv)."""
        q, tau = self._state("split", q=q, tau=tau)
        motion = (self._reach(q)[1].projector @ tau[..., None])[..., 0].astype(np.result_type(q, tau), copy=False)
        return MotionForceSplit(motion, tau - motion)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_velocity(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """The dq nearest in the kinetic metric with A dq = 0, P'dq; (nq), (nv) → (nv)."""
        q, dq = self._state("project_velocity", q=q, dq=dq)
        return self._nearest(q, dq, 0.0)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_acceleration(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """The q̈ nearest in the kinetic metric with A q̈ + (dA/dt) dq = 0; (nq), (nv), (nv) → (nv)."""
        q, dq, ddq = self._state("project_acceleration", q=q, dq=dq, ddq=ddq)
        return self._nearest(q, ddq, self.constraint_bias(q, dq))

    def _nearest(self, q: Array, v: Array, b: Array | float) -> Array:
        A, reach = self._reach(q)
        return reach.nearest(v, (A @ v[..., None])[..., 0] + b).astype(np.result_type(q, v), copy=False)

    def wrenches(self, lam: ArrayLike) -> dict[str, Array]:
        """λ as wrenches (m, f) that the robot applies where it is held, by the names of the constraints; (k) → (6) each.

        A closure's is what {b} applies to {a}, at the origin of {b}, along the axes of {c}.
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
        """q̈ and λ of τ = M q̈ + h + A'λ + Σ J'F_by - Σ J'F_on, A q̈ + (dA/dt) dq = 0; (nq), (nv), (nv) → (nv), (k).

        λ = (A M⁻¹ A')⁻¹ (A M⁻¹ (τ - h) + (dA/dt) dq), of least norm where rows are redundant, and, with a ConstraintWarning,
        where the configuration is singular. Raises ConstraintError where q leaves loops open by a
        hundredth (rad, and of what the joints' lever is), or a tenth of dq breaks the constraints. MR section 8.7.
        """
        q, dq, tau = self._state("forward_dynamics", q=q, dq=dq, tau=tau)
        closing.require_met(self, q, dq)
        if friction:
            tau = self.robot._call("torque_past_friction", dq, tau)
        by, on = wrench_by_robot, wrench_on_robot
        if not self._kept:
            ddq = self.robot.forward_dynamics(q, dq, tau, wrench_by_robot=by, wrench_on_robot=on)
            return ConstrainedMotion(ddq, np.zeros((*ddq.shape[:-1], len(self.sizes)), ddq.dtype))
        rows, call = list(self.independent), self.robot._with_wrenches
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
        closing.warn_of_singular(reach.rank, len(self.independent))
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
        """τ of the ``actuated`` joints (None: all), and λ, for a motion that meets the constraints; → (nv), (k).

        ``friction=True`` adds what overcomes the friction of all joints, driven or not, as :meth:`forward_dynamics` takes off;
        friction that grows with the load is that of the torques the open robot would need. With more motors than degrees of
        freedom τ is the one of least norm. Raises ConstraintError where q, dq or ddq breaks the constraints, as in
        :meth:`forward_dynamics`, and where the motors named cannot make the motion.
        """
        q, dq, ddq = self._state("inverse_dynamics", q=q, dq=dq, ddq=ddq)
        closing.require_met(self, q, dq, ddq)
        driven = closing.driven(self.robot, actuated)
        by, on = wrench_by_robot, wrench_on_robot
        with np.errstate(all="ignore"):
            f = self.robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on, friction=friction)
        f = arguments.finite(
            f, "inverse_dynamics: the torque of wrench_by_robot, wrench_on_robot and the motion", self.nv
        )
        A, reach = self._reach(q)
        lam, left = balance(f, A, self.sizes, driven)
        closing.require_made(self, left, f, driven)
        tau = np.where(driven, f + (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0], 0.0)
        lam = (reach.range @ lam[..., None])[..., 0]
        return ConstrainedTorques(tau.astype(f.dtype, copy=False), lam.astype(f.dtype, copy=False))

    # ── inputs ──

    @cached_property
    def _kept(self) -> tuple[Constraint, ...]:
        """The constraints with their independent rows alone."""
        return closing.kept(self.constraints, self.independent)

    def _reach(self, q: Array) -> tuple[Array, Reach]:
        A = self.constraint_jacobian(q)
        return A, Reach.of(A, self.robot.mass_matrix(q), self.sizes)

    def _state(self, name: str, **arrays: ArrayLike) -> list[Array]:
        """Arrays of finite numbers of the right last axis whose batch shapes broadcast."""
        found = [
            arguments.finite(
                array,
                f"{name}: {label}",
                self.nq if label == "q" else self.nv,
                names=self.robot.coordinate_names if label == "q" else self.robot.model.velocity_names,
            )
            for label, array in arrays.items()
        ]
        try:
            np.broadcast_shapes(*(array.shape[:-1] for array in found))
        except ValueError:
            raise arguments.mismatch(**dict(zip(arrays, found, strict=True))) from None
        return found
