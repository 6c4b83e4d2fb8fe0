"""Methods of robots that open higher layers (simulation, statics, control), imported when called."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import taking_the_arguments_of
from ..core.glossary import complete
from ..errors import ShapeError
from ..typing import Array
from .arguments import check_mapping, names_of, states, wrench_at
from .derivatives import Rows
from .ik_methods import IKMethods

if TYPE_CHECKING:
    from ..algorithms.closed_form import ClosedForm
    from ..lie.twist_wrench import Wrench
    from ..simulation import Event, JointStops, Plane, SimulationBatch, SimulationResult
    from ..simulation.rollout import Rollout
    from ..simulation.torque_laws import TorqueLaw
    from .arguments import Wrenches
    from .closed.closed_robot import ClosedRobot
    from .explanation import Explanation
    from .ik import IKResult
    from .robot import Robot

Law = Callable[[float, Array, Array], Any]
"""A function of (t, q, dq)."""
Method = Literal["dopri5", "rk4", "semi_implicit", "euler", "midpoint", "variational", "variational6"]
ClosedMethod = Literal["rk4", "dopri5", "semi_implicit", "euler"]

MethodName = TypeVar("MethodName", bound=str)
Simulated = TypeVar("Simulated")
RolledOut = TypeVar("RolledOut")


class SimulationMethods(Generic[MethodName, Simulated, RolledOut]):
    """Simulation and rollout; ``MethodName`` are the integrators there are, the others what comes out."""

    def _simulated(self, *start: Any, **given: Any) -> Simulated:
        raise NotImplementedError

    def _rolled_out(self, *start: Any, **given: Any) -> RolledOut:
        raise NotImplementedError

    def simulate(
        self,
        q0: ArrayLike | None = None,
        dq0: ArrayLike | None = None,
        duration: float = 1.0,
        dt: float = 1e-3,
        *,
        method: MethodName | None = None,
        tau: ArrayLike | Law | None = None,
        controller: Law | None = None,
        wrench_on_robot: Mapping[str, Any] | None = None,
        friction: bool = False,
        creep: float | None = None,
        contacts: Plane | JointStops | Iterable[Plane | JointStops] = (),
        limits: Literal["stop"] | None = None,
        events: Event | Law | Iterable[Event | Law] = (),
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float | None = None,
        every: int = 1,
        progress: Callable[[float], None] | None = None,
    ) -> Simulated:
        """Simulation: the motion from one state, under torques, controllers, wrenches, contacts and limits.

        Parameters
        ----------
        q0 : (nq,) array_like, optional, configuration at the start; None: neutral
            Of a closed robot one with its loops closed; None: one near neutral.
        dq0 : (nv,) array_like, optional, velocities at the start [rad/s, m/s]; None: at rest
        duration : float [s]
        dt : float, a state every so often [s]
        method : str, optional, the integrator; None: ``"dopri5"``, of a closed robot ``"rk4"``
            ``"dopri5"``, which adapts its steps to ``rtol`` and ``atol``; ``"rk4"``, ``"semi_implicit"``, ``"euler"``,
            and, of open robots, the variational ``"midpoint"``, ``"variational"``, ``"variational6"``, with steps of ``dt``.
        tau : (nv,) array_like or function of (t, q, dq), optional, joint torques [N m, sliding joints: N]
        controller : function of (t, q, dq), optional, asked every ``dt``, its torques held until the next time
        wrench_on_robot : {frame: (6,) or function of (t, q, dq)}, optional, (m, f) in that frame [N m, N]
        creep : float, optional, joint velocity below which friction is eased off [rad/s, m/s]
            In semi-implicit steps of open robots friction is an impulse that stops and holds the joints instead.
        contacts : ``tw.simulation.Plane`` and ``JointStops``, one or several
        limits : "stop" or None; ``"stop"`` ends where a joint reaches a limit
        events : ``tw.simulation.Event`` or function of (t, q, dq), one or several
        rtol, atol : float, tolerances of dopri5
        max_step : float, optional, the longest step of dopri5 [s]
        every : int, keep one state in so many
        progress : callable, optional, told the part that is done, 0 to 1

        Returns
        -------
        result : SimulationResult
            Of a closed robot a ClosedSimulation, with λ, the gaps, and what steps left to be projected away.

        Raises
        ------
        SimulationError
            A step is unstable, a controller fails, or constraints lose rank on the way or cannot be met again; all that was
            computed is in ``.result``.
        ConstraintError
            The first state is far from the constraints.
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid, or the first configuration of a closed robot is singular.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        docs/simulation.md explains and measures, docs/constraints.md for closed robots. Their steps end on the constraints, by
        the projection that is least in the kinetic metric; Hairer, Lubich and Wanner, Geometric Numerical Integration, section
        IV.4.

        Examples
        --------
        >>> import twistwrench as tw
        >>> swing = tw.robots.pendulum().simulate([3.0], [0.0], duration=2.0)
        >>> len(swing), swing.stopped, swing.relative_drift < 1e-7
        (2001, 'reached the end, 2 s', True)
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> swing = held.simulate(held.consistent([-0.6, 0.2, 2.2]), duration=0.5)
        >>> len(swing), bool(swing.gap.max() < 1e-12), swing.relative_drift < 1e-6
        (501, True, True)
        """
        return self._simulated(
            q0, dq0, duration, dt, method=method, tau=tau, controller=controller, wrench_on_robot=wrench_on_robot,
            friction=friction, creep=creep, contacts=contacts, limits=limits, events=events, rtol=rtol, atol=atol,
            max_step=max_step, every=every, progress=progress,
        )  # fmt: skip

    def rollout(
        self,
        q0: ArrayLike,
        dq0: ArrayLike,
        tau: ArrayLike | TorqueLaw | None = None,
        *,
        dt: float = 1e-3,
        steps: int | None = None,
        duration: float | None = None,
        every: int = 1,
        method: Literal["semi_implicit", "rk4"] = "semi_implicit",
        wrench_on_robot: Mapping[str, ArrayLike | Wrench] | None = None,
        parameters: Mapping[str, ArrayLike] | None = None,
        friction: bool = False,
        torque_limits: bool | ArrayLike = False,
        torques: bool = False,
        gradients: bool = False,
        out: tuple[Array, ...] | None = None,
    ) -> RolledOut:
        """Rollout: motions from any batch of states, all steps of ``dt`` in one kernel.

        Parameters
        ----------
        q0 : (..., nq) array_like, configurations at the start, loops closed
        dq0 : (..., nv) array_like, velocities at the start [rad/s, m/s]
        tau : (nv,) or (..., steps, nv) array_like, or law, optional
            Torques for all steps, or step by step [N m, sliding joints: N], or ``tw.simulation.BatchPD`` or
            ``BatchComputedTorque``, or ``tw.control.PD`` or ``ComputedTorque`` of the open robot.
        dt : float, time step [s]
        steps : int, optional, how many; give this or ``duration``
        duration : float, optional [s]
        every : int, keep one state in so many
        method : "semi_implicit" or "rk4", the integrator
        wrench_on_robot : {frame: (6,) or (..., steps, 6)}, optional, (m, f) in that frame [N m, N]
        parameters : {name: (...)}, optional, names of :meth:`twistwrench.Robot.varying`, as a payload's mass for each sample
            Of a closed robot inertias and friction alone.
        friction : bool, count that of the joints, as in :meth:`simulate`
        torque_limits : bool or (nv,) array_like, True clips to ``limits.effort``, numbers to these
        torques : bool, return those applied, too
        gradients : bool, keep what went in, for ``.gradient`` and ``.linearize`` of the rollout; of open robots alone
        out : (q, dq), optional, arrays of yours that take the results, for large ones again and again; of open robots alone

        Returns
        -------
        rollout : Rollout, q (..., n, nq) and dq (..., n, nv)
            Motions that become unstable are named in its ``.unstable``. Of a closed robot a ClosedRollout, with the gaps of
            each motion, what its steps left to be projected away, and where it lost its constraints.

        Raises
        ------
        ConstraintError
            A first state is far from the constraints.
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid, or a first configuration of a closed robot is singular.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        docs/rollouts.md explains. The steps of a closed robot are those of :meth:`simulate`, in float64. Where its constraints
        lose rank on the way, the states of that motion are NaN from there on; the others go on.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> many = arm.rollout(np.random.default_rng(0).normal(size=(100, 2)), [0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.unstable.any())
        ((100, 21, 2), False)
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([[-0.6, 0.2, 2.2], [-0.5, 0.0, 2.2]])
        >>> many = held.rollout(q, [0, 0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.gap.max() < 1e-12)
        ((2, 21, 3), True)
        """
        return self._rolled_out(
            q0, dq0, tau, dt=dt, steps=steps, duration=duration, every=every, method=method,
            wrench_on_robot=wrench_on_robot, parameters=parameters, friction=friction, torque_limits=torque_limits,
            torques=torques, gradients=gradients, out=out,
        )  # fmt: skip


# ── Methods that import higher layers when called


class Shortcuts(IKMethods, SimulationMethods[Method, "SimulationResult", "Rollout"]):
    """Methods of a robot that open what is built on it: simulation, closed loops, and what only open robots have."""

    # ── what the methods that closed robots have, too, ask ──

    def _open(self: Any) -> Robot:
        return self

    def _closed(self: Any) -> ClosedRobot:
        from .closed.closed_robot import ClosedRobot

        return ClosedRobot(self)

    def _simulated(self: Any, *start: Any, **given: Any) -> SimulationResult:
        from ..simulation.preparation import simulated

        return simulated(self, *start, **given)

    def _rolled_out(self: Any, *start: Any, **given: Any) -> Rollout:
        from ..simulation.rollout import rolled_out

        return rolled_out(self, *start, **given)

    # ── methods of its own ──

    def inverse_kinematics_branches(
        self: Any,
        T: ArrayLike,
        frame: str | None = None,
        *,
        rows: Rows = None,
        starts: int = 256,
        rng: np.random.Generator | int | None = 0,
        angle: float = 1e-10,
        distance: float = 1e-10,
    ) -> IKResult:
        """All branches of inverse kinematics that are found: elbow up and down, wrist turned over, and so on.

        Parameters
        ----------
        T : (4, 4) array_like, wanted pose in the base frame [m]
        rows : str or iterable, optional, rows of the twist that count
        starts : int, how many places the search starts from
        rng : numpy Generator or seed, for these places

        Returns
        -------
        found : IKResult
            A row for each branch, with the least angles first; none where the pose was not reached. All are inside the limits.

        Notes
        -----
        Joints that differ by full turns are one branch, told with the smallest angles the limits allow. A search from random
        places proves nothing: where more ``starts`` find more branches, there were too few. MR section 6.1. At singular
        configurations branches meet, or are points of curves on which the frame stays; a ``ModelWarning`` says so.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> T = arm.forward_kinematics([0.3, 0.8])
        >>> arm.inverse_kinematics_branches(T, rows="vx vy").q.round(3) + 0.0
        array([[ 0.3,  0.8],
               [ 1.1, -0.8]])
        """
        from .ik import branches

        return branches(self, T, frame, rows, starts, rng, angle, distance)

    @taking_the_arguments_of(SimulationMethods.simulate)
    def simulate_batch(self: Any, *start: Any, **options: Any) -> SimulationBatch:
        """Simulations from many states, each as :meth:`simulate` gives it, to the last bit.

        Parameters
        ----------
        *start : q0 (..., nq), dq0 (..., nv), duration and dt, by these names too, as in :meth:`simulate`
        **options : all others of :meth:`simulate`, the same for each

        Returns
        -------
        batch : SimulationBatch, one SimulationResult for each state

        Raises
        ------
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        One that fails is in the batch as far as it came: ``batch.completed`` says which are whole, ``.stopped`` of a result
        why. Steps of fixed length under constant torques and wrenches are taken side by side. Functions are asked by one
        simulation after the other: a controller that remembers its last call meets the start of the next. States alone, of
        many more samples, are what :meth:`rollout` is for.

        Examples
        --------
        >>> import twistwrench as tw
        >>> swings = tw.robots.pendulum().simulate_batch([[1.0], [2.0]], duration=0.5, method="rk4")
        >>> len(swings), bool(swings.completed.all()), swings[1].q[0]
        (2, True, array([2.]))
        """
        from ..simulation.preparation import simulate_batch

        return simulate_batch(self, *start, **options)

    def explain(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> Explanation:
        """Why a joint needs its torque: τ split by term and by the link, rotor or payload that causes it.

        Returns
        -------
        why : Explanation, whose parts add up to τ

        Notes
        -----
        Any batch shape; the table and the picture are of one state. Inverse dynamics is linear in the inertial
        parameters, MR section 8.2.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r().with_payload(tw.SpatialInertia.from_com(2.0))
        >>> why = arm.explain([0, 0], [0, 1], [0, 0])
        >>> why.of("payload at tip", "gravity").round(2).tolist()
        [39.24, 19.62]
        """
        wrenches: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        q, dq, ddq = map(np.asarray, states(self.model, "explain", q=q, dq=dq, ddq=ddq))
        tau = np.asarray(self.inverse_dynamics(q, dq, ddq, **wrenches), float)
        apart: dict[str, Array] = {}
        for sign, given in ((1.0, wrench_by_robot), (-1.0, wrench_on_robot)):
            for frame, F in (given or {}).items():
                found = sign * self.wrench_torques(q, wrench_at(self.model, frame, F), frame)
                apart[f"wrench at {frame}"] = found + apart.get(f"wrench at {frame}", 0.0)
        if self.model.springs:
            apart["springs"] = self.holding_torques(q) - self.gravity_forces(q)
        if self.model.armature.any():
            from ..algorithms.recursion import armature_forces

            apart["armature"] = armature_forces(self.model, dq, ddq)
        if friction and self.model.friction.any:
            apart["friction"] = self.friction_forces(dq, load=tau)
        Y = self.engine.cached("regressor on NumPy", lambda: _on_numpy(self))
        from .explanation import explained

        return explained(self.model, Y, (q, dq, ddq), apart)

    def closed_form(self: Any, q: ArrayLike, dq: ArrayLike, *, wrench_by_robot: Wrenches | None = None) -> ClosedForm:
        """Closed-form equations of motion: terms and block matrices of MR section 8.4 at one state.

        Returns
        -------
        terms : ClosedForm

        Notes
        -----
        Slow, and without any of the recursions by which the terms are computed elsewhere.

        Examples
        --------
        >>> import twistwrench as tw
        >>> terms = tw.robots.planar_2r().closed_form([0, 0.5], [1, 1])
        >>> terms.A.shape, terms.L.shape, terms.M.shape
        ((12, 2), (12, 12), (2, 2))
        """
        q, dq = (
            arguments.finite(
                arguments.one(x, f"closed_form: {name}", n, names=names_of(self.model, name)), f"closed_form: {name}", n
            )
            for name, x, n in (("q", q, self.nq), ("dq", dq, self.nv))
        )
        check_mapping(wrench_by_robot)
        wrenches = {frame: wrench_at(self.model, frame, F) for frame, F in (wrench_by_robot or {}).items()}
        if batched := [frame for frame, F in wrenches.items() if F.ndim > 1]:
            raise ShapeError(f"closed_form: the wrench at {batched[0]!r} is a batch; one state takes six numbers.")
        from ..algorithms.closed_form import closed_form

        return closed_form(self.model, q, dq, wrenches)


def _on_numpy(robot: Any) -> Any:
    """The regressor, which is asked once in a while: not worth the second that compiling takes."""
    from ..lowering.reference_interpreter import NumpyKernel

    return NumpyKernel(robot.program("regressor"), "regressor", "")


complete(globals())
