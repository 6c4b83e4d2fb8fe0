"""Methods of a closed robot: constrained dynamics, motors, simulation and statics. Modern Robotics section 8.7."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ...algorithms.constraints import (
    ConstrainedDerivatives,
    ConstrainedMotion,
    ConstrainedTorques,
    Slopes,
    balance,
    constrained_derivatives,
)
from ...algorithms.loop_closure import doubtful
from ...core import arguments, third_party
from ...core.glossary import complete
from ...typing import Array
from ..arguments import Wrenches, finite_states
from ..shared_methods import ClosedMethod, IKMethods, SimulationMethods
from . import checks
from .constraints import ConstraintMethods, projector_at

if TYPE_CHECKING:
    from ...algorithms.constraints import ConstrainedTorques
    from ...simulation.closed_run import ClosedRollout, ClosedSimulation
    from ..arguments import Wrenches
    from ..explanation import Explanation
    from ..ik_search import LoopClosureSolver
    from ..programs import KernelOptions
    from ..robot import Robot


class ClosedSharedMethods(
    ConstraintMethods, IKMethods, SimulationMethods[ClosedMethod, "ClosedSimulation", "ClosedRollout"]
):
    """Methods of a closed robot that open what is built on it."""

    # ── what the methods that open robots have, too, ask ──

    def _open(self) -> Robot:
        return self.robot

    def _searched_loops(self) -> LoopClosureSolver:
        from ..ik_search import LoopClosureSolver

        key = ("searched loops", self.constraints, self.independent)
        found: LoopClosureSolver = self.robot.engine.cached(key, lambda: LoopClosureSolver(self._closed()))
        return found

    def _constraint_options(self, name: str) -> Mapping[str, Any]:
        from ..programs import options_of

        return {"constraints": self._independent_constraints} if "constraints" in options_of(name) else {}

    def _simulated(self, *start: Any, **given: Any) -> ClosedSimulation:
        from ...simulation.closed_run import simulate_closed

        return simulate_closed(self._closed(), *start, **given)

    def _rolled_out(self, *start: Any, **given: Any) -> ClosedRollout:
        from ...simulation.closed_run import rollout_closed

        return rollout_closed(self._closed(), *start, **given)

    # ── methods of its own ──

    def holding_torques(
        self,
        q: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> ConstrainedTorques:
        """Holding torques of static equilibrium: τ of the ``actuated`` joints, and λ, of τ = g + A'λ + Σ J'F_by - Σ J'F_on.

        Returns
        -------
        torques : ConstrainedTorques
            ``tau`` (nv,) [N m, sliding joints: N], zero at the other joints, and ``lam`` (k,) [N m, N].

        Raises
        ------
        ConstraintError
            Loops are open at q, or the motors named cannot hold the robot.

        Notes
        -----
        :meth:`inverse_dynamics` at rest; MR sections 5.2 and 8.7.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> tau = held.holding_torques(q, ["joint1"]).tau
        >>> bool(abs(held.forward_dynamics(q, [0, 0, 0], tau).ddq).max() < 1e-10)
        True
        """
        rest = np.zeros(self.nv)
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        return self._closed().inverse_dynamics(q, rest, rest, actuated, **given)

    def joint_wrenches(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> Any:
        """Wrenches across the joints (bearing loads) of a closed robot: what each moving body receives across its joint.

        Returns
        -------
        F : (nbodies, 6) array, (m, f) [N m, N], each in the frame of its body, in the order of the open robot's

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints, or the motors named cannot make the motion.

        Notes
        -----
        Those of the open robot under λ of :meth:`inverse_dynamics`, a wrench on both links that a closure joins; what the
        cut joints themselves carry is λ. MR section 8.7.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.joint_wrenches(q, [0, 0, 0], [0, 0, 0], ["joint1"]).shape
        (3, 6)
        """
        from .constraints import applied

        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        lam = self._closed().inverse_dynamics(q, dq, ddq, actuated, **given).lam
        found, free = (self.robot.joint_wrenches(q, dq, ddq, **more) for more in (given, {}))
        for frame, F in applied(
            self._closed(), np.asarray(q, float), lam
        ):  # one frame may stand in several constraints
            found = found + (self.robot.joint_wrenches(q, dq, ddq, wrench_by_robot={frame: F}) - free)
        return found

    def kernel(self, *names: str, **options: Unpack[KernelOptions]) -> np.ufunc:
        """Compiled kernel of quantities with constraints, at the independent ones of this robot.

        Parameters
        ----------
        *names : str, ``"constrained_dynamics"``, ``"constraint_jacobian"``, ``"constraint_bias"``, ``"closure_poses"``, and
            with them any other of the open robot
        **options : as for :meth:`twistwrench.Robot.kernel`, ``constraints`` filled in

        Returns
        -------
        kernel : numpy.ufunc

        Raises
        ------
        KernelError
            None of them has constraints, or an option does not apply.
        SingularMassMatrixError
            A quantity needs M⁻¹, and M has none.

        Notes
        -----
        Kernels judge nothing: of constrained dynamics the pivots of A M⁻¹ A' come with the results, and where one is near zero
        the configuration is singular; :meth:`forward_dynamics` looks at them.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> held.kernel("constrained_dynamics").signature
        '(3),(3),(3)->(3),(2),(2)'
        """
        from ...errors import KernelError

        if not any(self._constraint_options(name) for name in names):
            raise KernelError(
                f"{', '.join(names)}: nothing of this knows of constraints. Of the robot with its loops open: "
                "closed.robot.kernel(…)."
            )
        given: dict[str, Any] = {"constraints": self._independent_constraints, **options}
        return self.robot.kernel(*names, **given)


# ── Forward and inverse dynamics with constraint forces. Modern Robotics section 8.7


class ClosedDynamicsMethods(ConstraintMethods):
    """The methods of a closed robot about its dynamics."""

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

        Returns
        -------
        motion : ConstrainedMotion
            ``ddq`` (nv,) [rad/s², m/s²] and ``lam`` (k,) [N m, N], rows as in :attr:`row_names`.

        Raises
        ------
        ConstraintError
            q leaves loops open by a hundredth (rad, and of what the joints' lever is), or a tenth of dq breaks the
            constraints.
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
        q, dq, tau = finite_states(self.robot.model, "forward_dynamics", q=q, dq=dq, tau=tau)
        checks.require_met(self._closed(), q, dq)
        if friction:
            tau = self.robot.engine.call("torque_past_friction", dq, tau)
        by, on = wrench_by_robot, wrench_on_robot
        if not self._independent_constraints:
            ddq = self.robot.forward_dynamics(q, dq, tau, wrench_by_robot=by, wrench_on_robot=on)
            return ConstrainedMotion(ddq, np.zeros((*ddq.shape[:-1], len(self.sizes)), ddq.dtype))
        rows, call = list(self.independent), self.robot.engine.call_with_wrenches
        with np.errstate(all="ignore"):
            ddq, some, pivots = call(
                "constrained_dynamics", (q, dq, tau), by, on, None, constraints=self._independent_constraints
            )
        lam = np.zeros((*some.shape[:-1], len(self.sizes)), some.dtype)
        lam[..., rows] = some
        again = doubtful(pivots, self.sizes[rows])
        if len(rows) < len(self.sizes) and not again.all():
            usual = np.broadcast_to(q, (*again.shape, self.nq))[~again]
            lam[~again] = (projector_at(self._closed(), usual)[1].range @ lam[~again][..., None])[..., 0]
        if again.any():
            h = call("bias_forces", (q, dq), by, on, None)
            q, dq, force = (np.broadcast_to(x, (*again.shape, x.shape[-1]))[again] for x in (q, dq, tau - h))
            ddq[again], lam[again] = self._by_singular_values(q, dq, force)
        return ConstrainedMotion(ddq, lam)

    def _by_singular_values(self, q: Array, dq: Array, force: Array) -> tuple[Array, Array]:
        """The same from τ - h (n, nv), however singular A is."""
        _, projector = projector_at(self._closed(), q)
        checks.warn_of_singular(projector.rank, len(self.independent))
        return projector.constrained(force, self.constraint_bias(q, dq))

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
        """Constrained inverse dynamics: τ of the ``actuated`` joints, and λ, for a motion that meets the constraints.

        Parameters
        ----------
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
        q, dq, ddq = finite_states(self.robot.model, "inverse_dynamics", q=q, dq=dq, ddq=ddq)
        checks.require_met(self._closed(), q, dq, ddq)
        driven = checks.driven(self.robot, actuated)
        by, on = wrench_by_robot, wrench_on_robot
        with np.errstate(all="ignore"):
            f = self.robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on, friction=friction)
        f = arguments.finite(
            f, "inverse_dynamics: the torque of wrench_by_robot, wrench_on_robot and the motion", self.nv
        )
        A, projector = projector_at(self._closed(), q)
        lam, left = balance(f, projector.range @ A, self.sizes, driven)  # λ of what never moves would be any number
        checks.require_made(self._closed(), left, f, driven)
        tau = np.where(driven, f + (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0], 0.0)
        lam = (projector.range @ lam[..., None])[..., 0]
        return ConstrainedTorques(tau.astype(f.dtype, copy=False), lam.astype(f.dtype, copy=False))


# ── Motor torques: explanation, derivatives and powers


class ClosedLoadMethods(ConstraintMethods):
    """The methods of a closed robot about the loads of its motors."""

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
        """Why a motor needs its torque: τ of :meth:`inverse_dynamics` split by term and by the link or payload that causes it.

        Parameters
        ----------
        friction : bool, count the friction of all joints, driven or not

        Returns
        -------
        why : Explanation, whose parts add up to τ; they are zero at joints without a motor

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints, or the motors named cannot make the motion.

        Notes
        -----
        What a part asks of all joints of the open robot, the constraints bring to the motors: τ = f + A'λ is linear in f.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> why = held.explain(q, [0, 0, 0], [0, 0, 0], ["joint1"])
        >>> bool(abs(why.torque - held.holding_torques(q, ["joint1"]).tau).max() < 1e-10)
        True
        """
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        self._closed().inverse_dynamics(
            q, dq, ddq, actuated, friction=friction, **given
        )  # judges the state and the motors
        why = self.robot.explain(q, dq, ddq, friction=friction, **given)
        driven = checks.driven(self.robot, actuated)
        (q,) = finite_states(self.robot.model, "explain", q=q)
        A = self.constraint_jacobian(q)[..., None, None, :, :]
        lam, _ = balance(why.parts, A, self.sizes, driven)
        pressed = (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0]
        return replace(why, parts=np.where(driven, why.parts + pressed, 0.0))

    def _loads(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        robot = self.robot
        tau = self._closed().inverse_dynamics(q, dq, ddq, list(robot.actuators), friction=friction, **wrenches).tau
        _, rotor = robot.drive_torques(q, dq, ddq)
        return tau - rotor, rotor

    def _moved(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        ddq = self._closed().forward_dynamics(q, dq, tau, friction=friction, **wrenches).ddq
        left = self.robot.engine.call("torque_past_friction", dq, tau) if friction else None
        return ddq, left

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
        """Derivatives of the motors' torques by the motors' own q, dq and ddq, along motions that keep to the constraints.

        Parameters
        ----------
        actuated : iterable of str, joints with a motor, of as many velocities m as there are degrees of freedom

        Returns
        -------
        slopes : ConstrainedDerivatives, ``tau_by_q``, ``tau_by_dq`` and ``tau_by_ddq`` (m, m), in the order of the robot's
            velocities; the last is the mass matrix that the motors see

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints; the joints named have more or fewer velocities than there are degrees of
            freedom, or do not determine the others at q.

        Notes
        -----
        The other joints' coordinates, velocities and accelerations follow from the constraints. Columns are along
        :meth:`twistwrench.Robot.add`. Friction is left out. MR section 8.7, differentiated.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.inverse_dynamics_derivatives(q, [0, 0, 0], [0, 0, 0], ["joint1"]).tau_by_q.shape
        (1, 1)
        """
        robot = self.robot
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        driven = checks.driven(robot, actuated)
        q, dq, ddq = (x.astype(float) for x in finite_states(robot.model, "derivatives", q=q, dq=dq, ddq=ddq))
        batch = np.broadcast_shapes(*(x.shape[:-1] for x in (q, dq, ddq)))
        q, dq, ddq = (np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, dq, ddq))
        checks.require_met(self._closed(), q, dq, ddq)
        checks.require_independent(self._closed(), q, driven)
        f = robot.inverse_dynamics(q, dq, ddq, **given)
        f_by_q, f_by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq, **given)
        rows, empty = list(self.independent), np.zeros((*q.shape[:-1], 0, self.nv))
        A, A_by_q, b_by_q, b_by_dq = empty, empty[..., None] * np.zeros(self.nv), empty, empty
        if rows:
            A = self.constraint_jacobian(q)[..., rows, :]
            A_by_q = robot.kernel("constraint_jacobian", constraints=self._independent_constraints, by="q")(q)
            b_by_q, b_by_dq = robot.kernel(
                "constraint_bias", constraints=self._independent_constraints, by=("q", "dq")
            )(q, dq)
        slopes = Slopes(A, A_by_q, b_by_q, b_by_dq, f, f_by_q, f_by_dq, robot.mass_matrix(q))
        return constrained_derivatives(slopes, dq, ddq, driven)


complete(globals())
