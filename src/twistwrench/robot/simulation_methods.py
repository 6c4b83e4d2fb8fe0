"""Simulations and rollouts as methods, of robots and of closed robots: what they take stands here, once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from numpy.typing import ArrayLike

from ..typing import Array

if TYPE_CHECKING:
    from ..screws.wrench import Wrench
    from ..simulation import Event, JointStops, Plane
    from ..simulation.torque_laws import TorqueLaw

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
        friction : bool, count the friction of the joints
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
