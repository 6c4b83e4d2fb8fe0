"""Methods of a closed robot that open what is built on it: simulation, and statics on its inverse dynamics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from ..algorithms.constrained import ConstrainedTorques
    from ..export.request import Quantities
    from ..screws.wrench import Wrench
    from ..simulation import Event, JointStops, Plane
    from ..simulation.closed_rollout import ClosedRollout
    from ..simulation.closed_simulation import ClosedSimulation
    from ..simulation.torque_laws import TorqueLaw
    from .quantity_options import KernelOptions
    from .quantity_types import Rows
    from .reached_poses import InverseKinematics
    from .shortcuts import Law
    from .wrench_arguments import Wrenches

ClosedMethod = Literal["rk4", "dopri5", "semi_implicit", "euler"]


class ClosedShortcuts:
    """Methods of a closed robot that open what is built on it."""

    def simulate(
        self: Any,
        q0: ArrayLike | None = None,
        dq0: ArrayLike | None = None,
        duration: float = 1.0,
        dt: float = 1e-3,
        *,
        method: ClosedMethod = "rk4",
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
    ) -> ClosedSimulation:
        """Simulation: the motion from one state, by constrained dynamics, each step of which ends on the constraints.

        Parameters
        ----------
        q0 : (nq,) array_like, optional, configuration at the start, loops closed; None: a closed one near neutral
        dq0 : (nv,) array_like, optional, velocities at the start [rad/s, m/s]; None: at rest
        duration : float [s]
        dt : float, a state every so often [s]
        method : str, the integrator
            ``"rk4"``, ``"semi_implicit"`` and ``"euler"`` with steps of ``dt``, and ``"dopri5"``, which adapts them.
        tau : (nv,) array_like or function of (t, q, dq), optional, joint torques [N m, sliding joints: N]
        controller : function of (t, q, dq), optional, asked every ``dt``, its torques held until the next time
        wrench_on_robot : {frame: (6,) or function of (t, q, dq)}, optional, (m, f) in that frame [N m, N]
        friction : bool, count the friction of the joints
        creep : float, optional, joint velocity below which friction is eased off [rad/s, m/s]
        contacts : ``tw.simulation.Plane`` and ``JointStops``, one or several
        limits : "stop" or None; ``"stop"`` ends where a joint reaches a limit
        events : ``tw.simulation.Event`` or function of (t, q, dq), one or several
        rtol, atol : float, tolerances of dopri5
        max_step : float, optional, the longest step of dopri5 [s]
        every : int, keep one state in so many
        progress : callable, optional, told the part that is done, 0 to 1

        Returns
        -------
        result : ClosedSimulation, a SimulationResult with λ, the gaps, and what steps left to be projected away

        Raises
        ------
        ConstraintError
            The first state is far from the constraints.
        SimulationError
            The constraints lose rank on the way, loops cannot be closed again, a step is unstable, or a controller
            fails; all that was computed is in ``.result``.
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid, or the first configuration is singular.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        Projections are the least in the kinetic metric. docs/constraints.md explains; Hairer, Lubich and Wanner,
        Geometric Numerical Integration, section IV.4.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> swing = held.simulate(held.consistent([-0.6, 0.2, 2.2]), duration=0.5)
        >>> len(swing), bool(swing.gap.max() < 1e-12), swing.relative_drift < 1e-6
        (501, True, True)
        """
        from ..simulation.closed_simulation import simulate_closed

        return simulate_closed(
            self, q0, dq0, duration, dt, method=method, tau=tau, controller=controller, wrench_on_robot=wrench_on_robot,
            friction=friction, creep=creep, contacts=contacts, limits=limits, events=events, rtol=rtol, atol=atol,
            max_step=max_step, every=every, progress=progress,
        )  # fmt: skip

    def rollout(
        self: Any,
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
    ) -> ClosedRollout:
        """Rollout: motions from any batch of states, each step of which ends on the constraints, all in one kernel.

        Parameters
        ----------
        q0 : (..., nq) array_like, configurations at the start, loops closed
        dq0 : (..., nv) array_like, velocities at the start [rad/s, m/s]
        tau : (nv,) or (..., steps, nv) array_like, or law, optional
            Torques for all steps, or step by step [N m, sliding joints: N], or a law as for
            :meth:`twistwrench.Robot.rollout`, which knows the open robot.
        dt : float, time step [s]
        steps : int, optional, how many; give this or ``duration``
        duration : float, optional [s]
        every : int, keep one state in so many
        method : "semi_implicit" or "rk4", the integrator
        wrench_on_robot : {frame: (6,) or (..., steps, 6)}, optional, (m, f) in that frame [N m, N]
        parameters : {name: (...)}, optional, inertias and friction for each sample, names of ``robot.varying()``
        friction : bool, count that of the joints, eased off at low speeds by both methods
        torque_limits : bool or (nv,) array_like, True clips to ``limits.effort``, numbers to these
        torques : bool, return those applied, too

        Returns
        -------
        rollout : ClosedRollout, q (..., n, nq) and dq (..., n, nv)
            With the gaps of each motion, what its steps left to be projected away, and where it lost its constraints.

        Raises
        ------
        ConstraintError
            A first state is far from the constraints.
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid, or a first configuration is singular.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        The steps are those of :meth:`simulate`, in float64. Where constraints lose rank on the way, the states of that motion
        are NaN from there on; the others go on.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([[-0.6, 0.2, 2.2], [-0.5, 0.0, 2.2]])
        >>> many = held.rollout(q, [0, 0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.gap.max() < 1e-12)
        ((2, 21, 3), True)
        """
        from ..simulation.closed_rollout import rollout_closed

        return rollout_closed(
            self, q0, dq0, tau, dt=dt, steps=steps, duration=duration, every=every, method=method,
            wrench_on_robot=wrench_on_robot, parameters=parameters, friction=friction, torque_limits=torque_limits,
            torques=torques,
        )  # fmt: skip

    def inverse_kinematics(
        self: Any,
        T: ArrayLike,
        frame: str | Sequence[str] | None = None,
        q0: ArrayLike | None = None,
        *,
        rows: Rows | Mapping[str, Rows] = None,
        restarts: int = 30,
        rng: np.random.Generator | int | None = 0,
        angle: float = 1e-10,
        distance: float = 1e-10,
        nearest: bool = False,
    ) -> InverseKinematics:
        """Inverse kinematics: configurations with the loops closed, inside the limits, at which a frame has the pose T.

        Parameters
        ----------
        T : (4, 4) array_like, wanted pose in the base frame [m]; (k, 4, 4) of k frames at once
        frame : str, optional, a link of the robot; its tip if None; a sequence of k names for k frames at once
        q0 : (nq,) array_like, optional, where the search starts, loops closed or not; None: a closed configuration
        rows : str or iterable, optional, rows of the twist that count; ``"vx vy vz"`` asks for the position only;
            a mapping of frames to rows where frames differ
        restarts : int, starts from random closed configurations where the first fails
        rng : numpy Generator or seed, for the random starts
        angle : float, tolerance [rad]
        distance : float, tolerance [m]
        nearest : bool, whether what poses and loops leave free is used to come as near to ``q0`` as they let

        Returns
        -------
        found : InverseKinematics
            It says which poses were reached, with what gap of the loops, what is left, and why.

        Raises
        ------
        ShapeError, ValueRangeError
            ``T`` is no pose, or another argument is invalid.
        UnknownNameError
            The robot has no such frame.
        FrameError
            No frame is named, and the robot has no single tip.

        Notes
        -----
        The search of :meth:`twistwrench.Robot.inverse_kinematics` with the gaps of the loops as further rows, so that poses
        and loops are met together. What was not reached is a closed configuration as near as was found, where there is one.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> T = arm.forward_kinematics(held.consistent([-0.6, 0.2, 2.2]), "link2")
        >>> found = held.inverse_kinematics(T, "link2", rows="wx wy wz")
        >>> bool(found.converged), bool(found.gap < 1e-12)
        (True, True)
        """
        from .inverse_kinematics import solve
        from .searched_loops import SearchedLoops

        loops = self.robot.engine.kept(
            ("searched loops", self.constraints, self.independent), lambda: SearchedLoops(self)
        )
        return solve(self.robot, T, frame, q0, rows, restarts, rng, angle, distance, nearest, loops)

    def holding_torques(
        self: Any,
        q: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> ConstrainedTorques:
        """Holding torques of static equilibrium: τ of the ``actuated`` joints, and λ, of τ = g + A'λ + Σ J'F_by - Σ J'F_on.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        actuated : iterable of str, optional, joints that have a motor; None: all
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise

        Returns
        -------
        torques : ConstrainedTorques
            ``tau`` (nv,) [N m, sliding joints: N], zero at the other joints, and ``lam`` (k,) [N m, N].

        Raises
        ------
        ConstraintError
            Loops are open at q, or the motors named cannot hold the robot.
        UnknownNameError
            ``actuated`` names no joint of the robot, or a wrench is at no frame of it.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

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
        given = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        return self.inverse_dynamics(q, rest, rest, actuated, **given)

    def joint_wrenches(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> Any:
        """Wrenches across the joints (bearing loads) of a closed robot: what each moving body receives across its joint.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]
        actuated : iterable of str, optional, joints that have a motor; None: all
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise

        Returns
        -------
        F : (nbodies, 6) array, (m, f) [N m, N], each in the frame of its body, in the order of the open robot's

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints, or the motors named cannot make the motion.
        UnknownNameError
            ``actuated`` names no joint of the robot, or a wrench is at no frame of it.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

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
        from .constraint_wrenches import applied

        given = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        lam = self.inverse_dynamics(q, dq, ddq, actuated, **given).lam
        found, free = (self.robot.joint_wrenches(q, dq, ddq, **more) for more in (given, {}))
        for frame, F in applied(self, np.asarray(q, float), lam):  # one frame may stand in several constraints
            found = found + (self.robot.joint_wrenches(q, dq, ddq, wrench_by_robot={frame: F}) - free)
        return found

    def kernel(self: Any, *names: str, **options: Unpack[KernelOptions]) -> np.ufunc:
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
        UnknownNameError
            There is no such quantity.
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
        from ..errors import KernelError
        from .quantity_options import options_of

        if not any("constraints" in options_of(name) for name in names):
            raise KernelError(
                f"{', '.join(names)}: nothing of this knows of constraints. Of the robot with its loops open: "
                "closed.robot.kernel(…)."
            )
        return self.robot.kernel(*names, **{"constraints": self._kept, **options})

    def export_c(
        self: Any,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> tuple[Path, ...]:
        """C code export: quantities with the constraints of this robot, and those of the open one, as C99 functions.

        Parameters
        ----------
        quantities : names as for :meth:`kernel`, with options as ``(name, {option: value})``
        path : str or Path, a folder, or the .c file; the header goes beside it
        precision : "double" or "float"
        prefix : str, optional, what the functions' names begin with; None: the robot's name
        test : bool, write a program that compares the functions with the kernels, too

        Returns
        -------
        paths : tuple of Path, what was written

        Raises
        ------
        UnknownNameError
            There is no such quantity.
        KernelError
            An option does not apply, or no program without branches computes it.
        SingularMassMatrixError
            A quantity needs M⁻¹, and M has none.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = held.export_c(["constrained_dynamics", "mass_matrix"], folder)
        ...     print("double lambda[2]" in files[0].read_text())
        True
        """
        from ..export import export_c
        from ..export.request import named
        from .quantity_options import options_of

        mine = [
            (name, {"constraints": self._kept, **options} if "constraints" in options_of(name) else options)
            for name, options in named(quantities)
        ]
        return export_c(self.robot, mine, path, precision=precision, prefix=prefix, test=test)
