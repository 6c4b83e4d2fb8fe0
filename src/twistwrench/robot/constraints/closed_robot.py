"""Closed robots: a robot with loops or other velocity constraints, A(q) dq = 0. Modern Robotics section 8.7.

The equations of motion are those of the open robot plus constraint forces,

    τ = M q̈ + h + A'λ,   A q̈ + (dA/dt) dq = 0.

λ is therefore exerted by the robot on its constraints, as F_by in τ = M q̈ + h + J'F_by. Shapes are given for one
state; any leading batch shape is allowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments, third_party
from ...core.errors import KernelError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.constraints import (
    Closure,
    ConstrainedDerivatives,
    ConstrainedMotion,
    ConstrainedTorques,
    Constraint,
    Slopes,
    balance,
    constrained_derivatives,
    with_gaps,
)
from ...mechanics.algorithms.loop_closure import closure_gaps, doubtful, independent_rows, settled
from ...mechanics.lie.labelled import TWIST
from ..arguments import Wrenches, finite_states
from ..doors import ClosedDoors
from ..programs import KernelOptions, options_of
from ..robot import Robot
from ..shared_methods import SharedMethods
from ..task_space_methods import ActuationMethods
from . import closures as checks
from .closures import CLOSED, ConstrainedRobot, applied, gap_units, row_sizes

if TYPE_CHECKING:
    from ..explanation import Explanation
    from ..ik_search import LoopClosureSolver


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRobot(ConstrainedRobot, SharedMethods, ClosedDoors, ActuationMethods):
    """A robot with closed loops: kinematics and dynamics under constraints A dq = 0. Immutable.

    Created by :meth:`twistwrench.Robot.close` and :meth:`~twistwrench.Robot.constrain`. MR section 8.7. Methods raise
    ConstraintError if a state violates the constraints, and SingularMassMatrixError if M⁻¹ is needed but M is singular.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, rest = tw.robots.planar_3r(), np.zeros(3)
    >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
    >>> q = held.consistent([-0.7, 1.1, 1.2], within=1.5)
    >>> q.round(4).tolist(), arm.subtract(q, [-0.7, 1.1, 1.2]).round(4).tolist()
    ([-0.6096, 0.1992, 2.2203], [0.0904, -0.9008, 1.0203])
    >>> bool(abs(held.constraint_error(q)).max() < 1e-12), held.gaps(q).shape
    (True, (2,))
    >>> held.settled(q[None], 1e-12)[1].shape
    (1,)
    >>> held.open() is arm
    True
    >>> held.constraint_jacobian(q).shape, held.constraint_bias(q, rest).tolist()
    ((2, 3), [0.0, 0.0])
    >>> int(held.rank(q)), int(held.degrees_of_freedom(q))
    (2, 1)
    >>> P = held.projector(q)
    >>> bool(abs(P @ P - P).max() < 1e-12)
    True
    >>> parts = held.split(q, [1, 2, 3])
    >>> (parts.motion + parts.force).round(12).tolist()
    [1.0, 2.0, 3.0]
    >>> bool(abs(held.constraint_jacobian(q) @ held.project_velocity(q, [1, 0, 0])).max() < 1e-12)
    True
    >>> bool(abs(held.constraint_jacobian(q) @ held.project_acceleration(q, rest, [1, 0, 0])).max() < 1e-12)
    True
    >>> {name: F.round(12).tolist() for name, F in held.wrenches([10.0, 0.0]).items()}
    {'ground–tip': [0.0, 0.0, 0.0, 10.0, 0.0, 0.0]}
    >>> ddq, lam = held.forward_dynamics(q, rest, rest)
    >>> bool(abs(held.constraint_jacobian(q) @ ddq).max() < 1e-12)
    True
    >>> tau = held.inverse_dynamics(q, rest, rest, ["joint1"]).tau
    >>> tau.nonzero()[0].tolist(), bool(abs(tau - held.holding_torques(q, ["joint1"]).tau).max() < 1e-12)
    ([0], True)
    >>> bool(abs(held.explain(q, rest, rest, ["joint1"]).torque - tau).max() < 1e-10)
    True
    >>> held.joint_wrenches(q, rest, rest, ["joint1"]).shape
    (3, 6)
    >>> held.inverse_dynamics_derivatives(q, rest, rest, ["joint1"]).tau_by_q.shape
    (1, 1)
    >>> held.kernel("constrained_dynamics").signature
    '(3),(3),(3)->(3),(2),(2)'
    >>> found = held.inverse_kinematics(arm.forward_kinematics(q, "link2"), "link2", rows="wx wy wz")
    >>> bool(found.converged), bool(found.gap < 1e-12)
    (True, True)
    >>> swing = held.simulate(q, duration=0.5)
    >>> len(swing), bool(swing.gap.max() < 1e-12), swing.relative_drift < 1e-6
    (501, True, True)
    >>> many = held.rollout([q, q], rest, steps=200, every=10)
    >>> many.q.shape, bool(many.gap.max() < 1e-12)
    ((2, 21, 3), True)
    """

    def __repr__(self) -> str:
        held = ", ".join(f"{c.name} {' '.join(TWIST[k] for k in c.rows)}" for c in self.constraints)
        free = self.nv - len(self.independent)
        return f"<ClosedRobot {self.robot.name!r}: {held or 'open'}; {free} degree{'s' * (free != 1)} of freedom>"

    if not TYPE_CHECKING:  # so that type checkers reject these names too

        def __getattr__(self, name: str) -> NoReturn:
            """Name the open robot's method in the error; forwarding the call would ignore the loops."""
            hint = ""
            if not name.startswith("_") and hasattr(Robot, name):
                call = "(…)" if callable(getattr(Robot, name)) else ""
                hint = f" For the robot with its loops open, without the constraints: closed.robot.{name}{call}."
            raise AttributeError(f"a ClosedRobot has no {name!r}.{hint}", name=name, obj=self)

    # ── hooks of the methods shared with open robots ──

    def open(self) -> Robot:
        """The same robot with its loops open.

        Returns
        -------
        robot : Robot
        """
        return self.robot

    def _closed(self) -> ClosedRobot:
        return self

    def _with(self, new: Constraint, near: ArrayLike | None, redundant: str) -> ClosedRobot:
        """Robot with one additional constraint."""
        if redundant not in ("error", "accept"):
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

    def _searched_loops(self) -> LoopClosureSolver:
        from ..ik_search import LoopClosureSolver

        key = ("searched loops", self.constraints, self.independent)
        found: LoopClosureSolver = self.robot.engine.cached(key, lambda: LoopClosureSolver(self))
        return found

    def _constraint_options(self, name: str) -> Mapping[str, Any]:
        return {"constraints": self._independent_constraints} if "constraints" in options_of(name) else {}

    def _loads(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        tau = self.inverse_dynamics(q, dq, ddq, list(self.robot.actuators), friction=friction, **wrenches).tau
        _, rotor = self.robot.drive_torques(q, dq, ddq)
        return tau - rotor, rotor

    def _moved(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        ddq = self.forward_dynamics(q, dq, tau, friction=friction, **wrenches).ddq
        return ddq, self.robot.engine.call("torque_past_friction", dq, tau) if friction else None

    # ── positions ──

    @third_party.by_blocks(lambda closed, _: [(sum(with_gaps(closed.constraints)),)])
    def constraint_error(self, q: ArrayLike) -> Array:
        """Constraint error: gap of the loops, in the rows that constrain a position.

        Returns
        -------
        gap : (rows of closures,) array [rad, m]
        """
        (q,) = finite_states(self.robot.model, "constraint_error", q=q)
        return self.gaps(q).astype(q.dtype, copy=False)

    @third_party.by_blocks(lambda closed, _: [(closed.nq,)])
    def consistent(self, q: ArrayLike, tolerance: float = CLOSED, *, within: float = checks.NEAR) -> Array:
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
        closures = tuple(c for c in self.constraints if isinstance(c, Closure))
        if not closures:
            return starts, np.zeros(len(starts))
        robot, sizes = self.robot, self.sizes[with_gaps(self.constraints)]

        def rows_and_mass(q: Array) -> tuple[Array, Array]:
            return robot.engine.call("constraint_jacobian", q, constraints=closures), robot.mass_matrix(q)

        return settled(starts, self.gaps, rows_and_mass, robot.add, sizes, gap_units(self), tolerance)

    def gaps(self, q: Array) -> Array:
        """Constraint error at validated q; see :meth:`constraint_error`.

        Returns
        -------
        gap : (..., rows of closures) array [rad, m]
        """
        if not any(isinstance(c, Closure) for c in self.constraints):
            return np.zeros((*q.shape[:-1], 0))
        return closure_gaps(self.constraints, self.robot.engine.call("closure_poses", q, constraints=self.constraints))

    # ── forward and inverse dynamics with constraint forces ──

    @third_party.by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedMotion)
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

        λ = (A M⁻¹ A')⁻¹ (A M⁻¹ (τ - h) + (dA/dt) dq), of minimal norm if A loses rank.

        Returns
        -------
        motion : ConstrainedMotion
            ``ddq`` (nv,) [rad/s², m/s²] and ``lam`` (k,) [N m, N], rows as in :attr:`row_names`.

        Raises
        ------
        ConstraintError
            A gap of the loops at q exceeds 0.01 (rad, or times the joints' lever), or over a tenth of dq violates the
            constraints.

        Warns
        -----
        ConstraintWarning
            The configuration is singular.
        """
        q, dq, tau = finite_states(self.robot.model, "forward_dynamics", q=q, dq=dq, tau=tau)
        checks.require_met(self, q, dq)
        if friction:
            tau = self.robot.engine.call("torque_past_friction", dq, tau)
        by, on, held = wrench_by_robot, wrench_on_robot, self._independent_constraints
        if not held:
            ddq = self.robot.forward_dynamics(q, dq, tau, wrench_by_robot=by, wrench_on_robot=on)
            return ConstrainedMotion(ddq, np.zeros((*ddq.shape[:-1], len(self.sizes)), ddq.dtype))
        rows, call = list(self.independent), self.robot.engine.call_with_wrenches
        with np.errstate(all="ignore"):
            ddq, some, pivots = call("constrained_dynamics", (q, dq, tau), by, on, None, constraints=held)
        lam = np.zeros((*some.shape[:-1], len(self.sizes)), some.dtype)
        lam[..., rows] = some
        again = doubtful(pivots, self.sizes[rows])
        if len(rows) < len(self.sizes) and not again.all():
            usual = np.broadcast_to(q, (*again.shape, self.nq))[~again]
            lam[~again] = (self._projector(usual)[1].range @ lam[~again][..., None])[..., 0]
        if again.any():  # pseudo-inverse from singular values: valid for any rank of A
            h = call("bias_forces", (q, dq), by, on, None)
            q, dq, force = (np.broadcast_to(x, (*again.shape, x.shape[-1]))[again] for x in (q, dq, tau - h))
            _, projector = self._projector(q)
            checks.warn_of_singular(projector.rank, len(rows))
            ddq[again], lam[again] = projector.constrained(force, self.constraint_bias(q, dq))
        return ConstrainedMotion(ddq, lam)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedTorques)
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
        """Constrained inverse dynamics: τ of the ``actuated`` joints, and λ, for a motion that satisfies the constraints.

        With more motors than degrees of freedom, τ is the solution of minimal norm.

        Parameters
        ----------
        friction : bool, add the torques that overcome the friction of all joints, driven or not
            As in :meth:`forward_dynamics`. Load-dependent friction is evaluated at the open robot's torques.

        Returns
        -------
        torques : ConstrainedTorques
            ``tau`` (nv,) [N m, sliding joints: N], zero at the other joints, and ``lam`` (k,) [N m, N].

        Raises
        ------
        ConstraintError
            q, dq or ddq violates the constraints, see :meth:`forward_dynamics`, or the motors cannot produce the
            motion.
        """
        q, dq, ddq = finite_states(self.robot.model, "inverse_dynamics", q=q, dq=dq, ddq=ddq)
        checks.require_met(self, q, dq, ddq)
        driven = checks.driven(self.robot, actuated)
        by, on = wrench_by_robot, wrench_on_robot
        with np.errstate(all="ignore"):
            f = self.robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on, friction=friction)
        f = arguments.finite(
            f, "inverse_dynamics: the torque of wrench_by_robot, wrench_on_robot and the motion", self.nv
        )
        A, projector = self._projector(q)
        lam, left = balance(f, projector.range @ A, self.sizes, driven)  # projection: λ of immovable rows is arbitrary
        checks.require_made(self, left, f, driven)
        tau = np.where(driven, f + (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0], 0.0)
        lam = (projector.range @ lam[..., None])[..., 0]
        return ConstrainedTorques(tau.astype(f.dtype, copy=False), lam.astype(f.dtype, copy=False))

    def holding_torques(
        self,
        q: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> ConstrainedTorques:
        """Holding torques of static equilibrium: :meth:`inverse_dynamics` at rest, τ = g + A'λ + Σ J'F_by - Σ J'F_on.

        Returns
        -------
        torques : ConstrainedTorques
            ``tau`` (nv,) [N m, sliding joints: N], zero at the other joints, and ``lam`` (k,) [N m, N].
        """
        rest, by, on = np.zeros(self.nv), wrench_by_robot, wrench_on_robot
        return self.inverse_dynamics(q, rest, rest, actuated, wrench_by_robot=by, wrench_on_robot=on)

    def joint_wrenches(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> Array:
        """Wrenches across the joints (bearing loads) of a closed robot, received by each moving body across its joint.

        They are those of the open robot under λ of :meth:`inverse_dynamics`, which acts on both links of a closure. Cut
        joints themselves carry λ.

        Returns
        -------
        F : (nbodies, 6) array, (m, f) [N m, N], each in the frame of its body, bodies in the order of the open robot
        """
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        lam = self.inverse_dynamics(q, dq, ddq, actuated, **given).lam
        found, free = (self.robot.joint_wrenches(q, dq, ddq, **more) for more in (given, {}))
        for frame, F in applied(self, np.asarray(q, float), lam):  # a frame may occur in several constraints
            found = found + (self.robot.joint_wrenches(q, dq, ddq, wrench_by_robot={frame: F}) - free)
        return found

    def explain(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> Explanation:
        """Torques of :meth:`inverse_dynamics` split by term and by the link or payload that causes them.

        The constraints transmit the open robot's joint torques f to the motors: τ = f + A'λ is linear in f.

        Parameters
        ----------
        friction : bool, include the friction of all joints, driven or not

        Returns
        -------
        why : Explanation, parts that add up to τ; zero at joints without a motor
        """
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        self.inverse_dynamics(q, dq, ddq, actuated, friction=friction, **given)  # checks state and motors
        why = self.robot.explain(q, dq, ddq, friction=friction, **given)
        driven = checks.driven(self.robot, actuated)
        (q,) = finite_states(self.robot.model, "explain", q=q)
        A = self.constraint_jacobian(q)[..., None, None, :, :]
        lam, _ = balance(why.parts, A, self.sizes, driven)
        pressed = (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0]
        return replace(why, parts=np.where(driven, why.parts + pressed, 0.0))

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str],
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> ConstrainedDerivatives:
        """Derivatives of the motor torques by the motors' q, dq and ddq, along motions that satisfy the constraints.

        Coordinates, velocities and accelerations of the other joints follow from the constraints. Columns are along
        :meth:`twistwrench.Robot.add`. Friction is excluded.

        Parameters
        ----------
        actuated : iterable of str, joints with a motor; their number of velocities m equals the degrees of freedom

        Returns
        -------
        slopes : ConstrainedDerivatives, ``tau_by_q``, ``tau_by_dq`` and ``tau_by_ddq`` (m, m), in the order of the
            robot's velocities; ``tau_by_ddq`` is the mass matrix reduced to the motors

        Raises
        ------
        ConstraintError
            q, dq or ddq violates the constraints; the number of velocities of the named joints differs from the degrees
            of freedom; or these joints do not determine the others at q.
        """
        robot, held = self.robot, self._independent_constraints
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        driven = checks.driven(robot, actuated)
        q, dq, ddq = (x.astype(float) for x in finite_states(robot.model, "derivatives", q=q, dq=dq, ddq=ddq))
        batch = np.broadcast_shapes(*(x.shape[:-1] for x in (q, dq, ddq)))
        q, dq, ddq = (np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, dq, ddq))
        checks.require_met(self, q, dq, ddq)
        checks.require_independent(self, q, driven)
        f = robot.inverse_dynamics(q, dq, ddq, **given)
        f_by_q, f_by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq, **given)
        rows, empty = list(self.independent), np.zeros((*q.shape[:-1], 0, self.nv))
        A, A_by_q, b_by_q, b_by_dq = empty, empty[..., None] * np.zeros(self.nv), empty, empty
        if rows:
            A = self.constraint_jacobian(q)[..., rows, :]
            A_by_q = robot.kernel("constraint_jacobian", constraints=held, by="q")(q)
            b_by_q, b_by_dq = robot.kernel("constraint_bias", constraints=held, by=("q", "dq"))(q, dq)
        slopes = Slopes(A, A_by_q, b_by_q, b_by_dq, f, f_by_q, f_by_dq, robot.mass_matrix(q))
        return constrained_derivatives(slopes, dq, ddq, driven)

    def kernel(self, *names: str, **options: Unpack[KernelOptions]) -> np.ufunc:
        """Compiled kernel of quantities with constraints; dependent constraint rows are left out.

        Kernels do not check states. Constrained dynamics also returns the pivots of A M⁻¹ A'; a pivot near zero marks a
        singular configuration. :meth:`forward_dynamics` checks them.

        Parameters
        ----------
        *names : str, ``"constrained_dynamics"``, ``"constraint_jacobian"``, ``"constraint_bias"``, ``"closure_poses"``,
            together with any quantities of the open robot
        **options : as for :meth:`twistwrench.Robot.kernel`; ``constraints`` is filled in

        Returns
        -------
        kernel : numpy.ufunc

        Raises
        ------
        KernelError
            No quantity has constraints, or an option does not apply.
        """
        if not any(self._constraint_options(name) for name in names):
            raise KernelError(
                f"{', '.join(names)}: not available for a robot with constraints. For the robot with its loops open: "
                "closed.robot.kernel(…)."
            )
        given: dict[str, Any] = {"constraints": self._independent_constraints, **options}
        return self.robot.kernel(*names, **given)


complete(globals())
