"""Methods for simulation, clearance, pages and summaries of robots, and plots, whose packages depend on this one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, cast

from numpy.typing import ArrayLike

from ..core.arguments import refuse_unused_srdf, taking_the_arguments_of
from ..core.glossary import complete
from ..core.typing import Array, Seconds
from .arguments import Wrenches

if TYPE_CHECKING:
    from typing_extensions import TypeVar

    from ..mechanics.algorithms.constraints import ConstrainedDerivatives, ConstrainedMotion, ConstrainedTorques
    from ..mechanics.lie.twist_wrench import Wrench
    from ..modern_robotics.newton_euler import NewtonEuler
    from ..simulation import Event, JointStops, Plane, Rollout, SimulationBatch, SimulationResult
    from ..simulation.closed import ClosedRollout, ClosedSimulation
    from ..simulation.torque_laws import TorqueLaw
    from ..statics.clearance import Clearance
    from ..statics.clearance import PathClearance as PathClearance
    from ..viz.page import ShownPage
    from .explanation import Explanation
    from .load import LoadOptions
    from .robot import Robot
else:
    from typing import TypeVar

Law = Callable[[float, Array, Array], Any]
"""Control law: function of (t, q, dq)."""
Method = Literal["dopri5", "rk4", "semi_implicit", "euler", "midpoint", "variational", "variational6"]
"""Integrators of open robots."""
ClosedMethod = Literal["rk4", "dopri5", "semi_implicit", "euler"]
"""Integrators of closed robots."""


if TYPE_CHECKING:
    MethodName = TypeVar("MethodName", bound=str, default=Method)
    Simulated = TypeVar("Simulated", default=SimulationResult)
    RolledOut = TypeVar("RolledOut", default=Rollout)
    ConstrainedRobot: TypeAlias = Robot[
        ConstrainedMotion, ConstrainedTorques, ConstrainedDerivatives, ClosedMethod, ClosedSimulation, ClosedRollout
    ]
else:
    MethodName, Simulated, RolledOut = map(TypeVar, ("MethodName", "Simulated", "RolledOut"))


def load_by_name(name: str, options: LoadOptions) -> Robot:
    """Robot with this name, loaded with the options of :func:`.load`. Raises NotFoundError with similar names."""
    from .. import robots
    from ..robots.finding import plain_name, robot_file
    from .load import load

    given_options = {option: value for option, value in options.items() if value is not None}
    robot_name = plain_name(name)
    if robot_name in robots.names():  # its function has the robot's defaults, such as a floating base
        return cast("Robot", getattr(robots, robot_name)(**given_options))
    return load(robot_file(name), **cast("LoadOptions", given_options))


def clearance_along(
    robot: Robot, samples: Iterable[tuple[Array, Array]], distance: float | None, srdf: str | Path | None = None
) -> PathClearance | None:
    """Least distance between links along a motion; None if ``distance``, the distance to keep, is None.

    ``samples`` are portions of times (n,) [s] and configurations (n, nq).

    Raises
    ------
    ValueRangeError
        Pairs of links are left out, and no distance is to be kept.
    """
    refuse_unused_srdf(distance, srdf)
    if distance is None:
        return None
    from ..statics.clearance import PathClearance

    return PathClearance.along(robot, samples, distance, srdf)


class RobotDoors(Generic[MethodName, Simulated, RolledOut]):
    """Methods of a robot that call packages above this one.

    ``MethodName`` are the available integrators; the other parameters are the types of simulations and rollouts.
    """

    def clearance(
        self, q: ArrayLike, exact: Literal["auto"] | bool = "auto", *, srdf: str | Path | None = None
    ) -> Clearance:
        """Clearance: smallest distance between two links, from the collision shapes of the robot's file, else its visuals.

        Capsules around the links exclude distant pairs. The library coal (extra ``clearance``) evaluates the others,
        with meshes as convex hulls. Pairs connected by a joint, and pairs in contact in 95 % of 2,000 random
        configurations, are excluded.

        Parameters
        ----------
        exact : "auto" or bool; ``"auto"`` uses coal if it is installed; False gives lower bounds of the distances
        srdf : str or Path, optional, SRDF file whose ``<disable_collisions>`` exclude further pairs

        Returns
        -------
        found : Clearance
            ``distance`` (...) [m], negative in contact, ``pair`` (..., 2), ``exact``; ``unknown``: links without shape.

        Raises
        ------
        MissingExtraError
            ``exact`` is True, and coal is not installed.
        RobotFileError
            The SRDF file cannot be read or belongs to another robot.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().clearance([0, -1, 1, 0, 0, 0]).unknown[:2]  # its file has no shapes
        ('base_link', 'shoulder_link')
        """
        from ..statics.clearance import clearance_of

        return clearance_of(cast("Robot", self), q, exact, srdf)

    def newton_euler(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> NewtonEuler:
        """Inverse dynamics step by step: twist, acceleration and wrench of each body. MR section 8.3.

        The recursion has the book's form and is evaluated for one state, to be read. :meth:`.Robot.inverse_dynamics`
        computes the same torques for any batch.

        Returns
        -------
        steps : NewtonEuler, with ``V``, ``dV``, ``F``, ``tau``; it prints as tables

        Raises
        ------
        ConstraintError
            The robot has constraints, whose forces the recursion does not contain.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_2r().newton_euler([0, 0], [0, 0], [0, 0]).tau.round(2).tolist()
        [29.43, 9.81]
        """
        from ..modern_robotics.newton_euler import newton_euler

        wrenches = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        return newton_euler(cast("Robot", self), q, dq, ddq, **wrenches)

    def _clearance_search(self) -> Callable[[Array], Clearance]:
        """Clearance of configurations, for inverse kinematics."""
        from ..statics.clearance import distances_for_search

        return distances_for_search(cast("Robot", self))

    def simulate(
        self,
        q0: ArrayLike | None = None,
        dq0: ArrayLike | None = None,
        duration: Seconds = 1.0,
        dt: Seconds = 1e-3,
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

        docs/simulation.md explains the methods and measures their accuracy, docs/constraints.md those for closed
        robots. Steps of closed robots end on the constraints, by the smallest projection in the kinetic metric; Hairer,
        Lubich and Wanner, Geometric Numerical Integration, section IV.4.

        Parameters
        ----------
        q0 : (nq,) array_like, optional, initial configuration; None: neutral
            For a closed robot a configuration with closed loops; None: one near neutral.
        dq0 : (nv,) array_like, optional, initial velocities [rad/s, m/s]; None: at rest
        duration : float
            Duration of the motion [s].
        dt : float
            Time between two states [s].
        method : str, optional
            Integrator: dopri5, which adapts its steps, the default; rk4, the default of closed robots, semi_implicit, euler,
            and for open robots the variational midpoint, variational and variational6, in steps of ``dt``.
        tau : (nv,) array_like or function of (t, q, dq), optional, joint torques [N m, sliding joints: N]
        controller : function of (t, q, dq), optional, evaluated once per ``dt``, with torques held in between
            (zero-order hold)
        wrench_on_robot : {frame: (6,) or function of (t, q, dq)}, optional, (m, f) in that frame [N m, N]
        creep : float, optional, joint velocity below which friction is smoothed [rad/s, m/s]
            In semi-implicit steps of open robots, friction is instead an impulse that can stop and hold the joints.
        contacts : ``tw.simulation.Plane`` and ``JointStops``, one or several
        limits : "stop" or None; ``"stop"`` ends the simulation when a joint reaches a limit
        events : ``tw.simulation.Event`` or function of (t, q, dq), one or several
        rtol : float
            Relative tolerance of a dopri5 step.
        atol : float, absolute tolerance of a dopri5 step
        every : int
            Keep every N-th state.
        max_step : float, optional, largest step of dopri5 [s]
        progress : callable, optional, receives the completed fraction, 0 to 1

        Returns
        -------
        result : SimulationResult
            For a closed robot a ClosedSimulation, with λ, the gaps, and the constraint errors removed by projection.

        Raises
        ------
        SimulationError
            A step is unstable, a controller fails, or constraints lose rank or are violated. The motion so far is in
            ``.result``.
        ConstraintError
            The initial state is far from the constraints.

        Examples
        --------
        >>> import twistwrench as tw
        >>> swing = tw.robots.pendulum().simulate([3.0], [0.0], duration=2.0)
        >>> len(swing), swing.stopped, swing.relative_drift < 1e-7
        (2001, 'reached the end, 2 s', True)
        """
        from ..simulation.preparation import simulate_robot

        result: Any = simulate_robot(
            cast("Robot", self), q0, dq0, duration, dt, method=method, tau=tau, controller=controller,
            wrench_on_robot=wrench_on_robot, friction=friction, creep=creep, contacts=contacts, limits=limits,
            events=events, rtol=rtol, atol=atol, max_step=max_step, every=every, progress=progress,
        )  # fmt: skip
        return result

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

        docs/rollouts.md explains the method. Steps of a closed robot are those of :meth:`simulate`, in float64. If
        constraints lose rank, the remaining states of that motion are NaN; other motions continue.

        Parameters
        ----------
        q0 : (..., nq) array_like, initial configurations, loops closed
        dq0 : (..., nv) array_like, initial velocities [rad/s, m/s]
        tau : (nv,) or (..., steps, nv) array_like, or law, optional
            Constant torques, torques for each step [N m, sliding joints: N], ``tw.simulation.BatchPD`` or
            ``BatchComputedTorque``, or ``tw.control.PD`` or ``ComputedTorque`` of the open robot.
        dt : float, time step [s]
        steps : int, optional, number of steps; give this or ``duration``
        duration : float, optional [s]
        method : "semi_implicit" or "rk4", the integrator
        wrench_on_robot : {frame: (6,) or (..., steps, 6)}, optional, (m, f) in that frame [N m, N]
        parameters : {name: (...)}, optional, names of :meth:`twistwrench.Robot.varying`, such as a payload's mass per
            sample; for a closed robot only inertias and friction
        friction : bool, include joint friction, as in :meth:`simulate`
        torque_limits : bool or (nv,) array_like, True clips to ``limits.effort``, numbers to these
        torques : bool, also return the applied torques
        gradients : bool, store the inputs for ``.gradient`` and ``.linearize`` of the rollout; open robots only
        out : (q, dq), optional, arrays for the results, to reuse memory; open robots only

        Returns
        -------
        rollout : Rollout, q (..., n, nq) and dq (..., n, nv)
            ``.unstable`` marks motions that become unstable. For a closed robot a ClosedRollout, with the gaps of each
            motion, the errors removed by projection, and where it lost its constraints.

        Raises
        ------
        ConstraintError
            An initial state is far from the constraints.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> many = arm.rollout(np.random.default_rng(0).normal(size=(100, 2)), [0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.unstable.any())
        ((100, 21, 2), False)
        """
        from ..simulation.rollout import roll_out

        result: Any = roll_out(
            cast("Robot", self), q0, dq0, tau, dt=dt, steps=steps, duration=duration, every=every, method=method,
            wrench_on_robot=wrench_on_robot, parameters=parameters, friction=friction, torque_limits=torque_limits,
            torques=torques, gradients=gradients, out=out,
        )  # fmt: skip
        return result

    @taking_the_arguments_of(simulate)
    def simulate_batch(self, *start: Any, **options: Any) -> SimulationBatch:
        """Simulations from many states, each bit-identical to :meth:`simulate`.

        A failed simulation is in the batch up to its failure: ``batch.completed`` is False for it, and ``.stopped`` of
        its result gives the reason. With constant torques and wrenches, fixed steps are evaluated side by side.
        Functions are called by one simulation after the other, so the internal state of a controller carries over from
        one to the next. For states only of many more samples, use :meth:`rollout`.

        Parameters
        ----------
        *start : q0 (..., nq), dq0 (..., nv), duration and dt, also by name, as in :meth:`simulate`
        **options : all other options of :meth:`simulate`, the same for each simulation

        Returns
        -------
        batch : SimulationBatch, one SimulationResult for each state

        Examples
        --------
        >>> import twistwrench as tw
        >>> swings = tw.robots.pendulum().simulate_batch([[1.0], [2.0]], duration=0.5, method="rk4")
        >>> len(swings), bool(swings.completed.all()), swings[1].q[0]
        (2, True, array([2.]))
        """
        from ..simulation.batch import simulate_batch

        return simulate_batch(cast("Robot", self), *start, **options)

    # ── pages and summaries ──

    def info(self) -> dict[str, Any]:
        """Robot description as plain data: joints, links with mass, frames, gravity, defects; printed by ``info --json``.

        Returns
        -------
        info : dict, serialisable by ``json.dumps``
            ``name``, ``nq``, ``nv``, ``gravity`` [m/s²], ``tip``, ``moving_mass`` and ``fixed_mass`` [kg], ``joints``,
            ``links`` (``mass``, ``com`` [m], ``moment_about_com`` [kg m²]), ``frames``, ``defects``; SI units and radians.
        """
        from ..reports.robot_summary import summary

        return summary(cast("Robot", self))

    def show(
        self,
        q: ArrayLike | None = None,
        *,
        actuated: Iterable[str] | None = None,
        wrench_on_robot: Wrenches | None = None,
        section: str | None = None,
        embed: bool = False,
        control: str | None = None,
    ) -> ShownPage:
        """Show the robot's page, with its loops closed: below the cell in a notebook, otherwise in the browser.

        Parameters
        ----------
        q : (nq,) array_like, optional, initial configuration
        actuated, wrench_on_robot, section, embed, control : as for :func:`twistwrench.viz.write_page`

        Returns
        -------
        page : ShownPage

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().show([0, -1, 1, 0, 0, 0])  # doctest: +SKIP
        """
        from ..viz.page import show

        return show(
            cast("Robot", self), q=q, actuated=actuated, wrench_on_robot=wrench_on_robot, section=section, embed=embed,
            control=control,
        )  # fmt: skip

    def _repr_html_(self) -> str | None:
        """Summary in HTML, which notebooks display."""
        from ..reports.robot_summary import html_summary

        return html_summary(cast("Robot", self))


class ExplanationDoors:
    """Methods of an explanation that call packages above this one."""

    def plot(self, path: str | Path) -> Path:
        """Bar chart: a bar per joint, stacked by cause.

        Parameters
        ----------
        path : str or Path; the suffix sets the kind (.png, .pdf, .svg)

        Returns
        -------
        path : Path of the file written
        """
        from ..viz.plots.explanation import plot_explanation

        return plot_explanation(cast("Explanation", self), path)


complete(globals())
