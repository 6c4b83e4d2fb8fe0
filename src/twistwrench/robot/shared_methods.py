"""Methods that robots and closed robots share: inverse kinematics, closing loops, export, simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..typing import Array
from .arguments import Kind, Rows

if TYPE_CHECKING:
    from ..export.request import Quantities
    from ..lie.twist_wrench import Wrench
    from ..simulation import Event, JointStops, Plane
    from ..simulation.torque_laws import TorqueLaw
    from ..statics.clearance import Clearance
    from .closed_robot import ClosedRobot
    from .ik import IKResult
    from .ik_search import LoopClosureSolver
    from .robot import Robot


@cache
def _inverse_kinematics() -> Callable[..., IKResult]:
    """Import the solver at the first call; an import statement costs a good part of a solution near by."""
    from .ik import solve

    return solve


Law = Callable[[float, Array, Array], Any]
"""A function of (t, q, dq)."""
Method = Literal["dopri5", "rk4", "semi_implicit", "euler", "midpoint", "variational", "variational6"]
ClosedMethod = Literal["rk4", "dopri5", "semi_implicit", "euler"]

MethodName = TypeVar("MethodName", bound=str)
Simulated = TypeVar("Simulated")
RolledOut = TypeVar("RolledOut")


class SharedMethods(Generic[MethodName, Simulated, RolledOut]):
    """Methods of open and closed robots alike; the methods with a leading underscore differ between them.

    ``MethodName`` are the integrators there are, the others what simulations and rollouts give.
    """

    def _open(self) -> Robot:
        """The robot with its loops open."""
        raise NotImplementedError

    def _closed(self) -> ClosedRobot:
        """The robot with the loops that it has closed, none of an open one."""
        raise NotImplementedError

    def _searched_loops(self) -> LoopClosureSolver | None:
        """The gaps of its loops, as rows of a search."""
        return None

    def _constraint_options(self, name: str) -> Mapping[str, Any]:  # noqa: ARG002  a closed robot looks at it
        """Options of a quantity for the constraints."""
        return {}

    def _simulated(self, *start: Any, **given: Any) -> Simulated:
        """The result of a simulation."""
        raise NotImplementedError

    def _rolled_out(self, *start: Any, **given: Any) -> RolledOut:
        """The result of a rollout."""
        raise NotImplementedError

    def inverse_kinematics(
        self,
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
        clearance: float | None = None,
    ) -> IKResult:
        """Inverse kinematics: configurations, inside the joints' limits and with loops closed, at which a frame has the pose T.

        Parameters
        ----------
        T : (4, 4) array_like, wanted pose in the base frame [m]; (k, 4, 4) of k frames at once
        frame : str, optional, a link of the robot; its tip if None; a sequence of k names for k frames at once
        q0 : (nq,) array_like, optional, where the search starts, loops closed or not; None: neutral, or a closed configuration
        rows : str or iterable, optional, rows of the twist that count; ``"vx vy vz"`` asks for the position only;
            a mapping of frames to rows where frames differ
        restarts : int, random starts where the first fails; of a closed robot with its loops closed
        rng : numpy Generator or seed, for the random starts
        nearest : bool, whether what the poses leave free is used to come as near to ``q0`` as they let
        clearance : float, optional, distance that links keep from each other [m], as :meth:`clearance` computes it
            A solution that does not keep it gives way to the nearest that does, of those from ``restarts`` random starts.

        Returns
        -------
        found : IKResult
            It says which poses were reached, what is left, and why; nothing else counts as reached. Of a closed robot with
            the gap of its loops.

        Notes
        -----
        Newton's method, damped, MR section 6.2. Any batch of T and q0. What is left of several frames is the root of the sum
        of squares. ``nearest`` goes on from what was found, by Newton steps in the poses' null space, 240 at most: what it
        reaches is the nearest on the way, not on other branches (Siciliano et al., Robotics, section 3.5.1).
        The gaps of closed loops are further rows, so that poses and loops are met together; what was not reached is a closed
        configuration as near as was found, where there is one.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.ur5()
        >>> found = arm.inverse_kinematics(arm.forward_kinematics([0.1, -1, 1, 0.2, 0.3, 0]))
        >>> bool(found.converged), found.q.shape
        (True, (6,))
        """
        options = angle, distance, nearest, self._searched_loops()
        found = _inverse_kinematics()(self._open(), T, frame, q0, rows, restarts, rng, *options)
        if clearance is None:
            return found
        from ..statics.clearance import distances_for_search
        from .ik import clear_of_links

        robot, poses = self._open(), np.asarray(T)
        core = 2 if frame is None or isinstance(frame, str) else 3
        return clear_of_links(
            found,
            np.broadcast_to(poses, (*found.q.shape[:-1], *poses.shape[-core:])),
            lambda target, starts: _inverse_kinematics()(robot, target, frame, starts, rows, 0, rng, *options),
            distances_for_search(robot),
            arguments.positive(clearance, "inverse_kinematics: clearance", "m", zero=True),
            robot.random_configuration(rng, restarts),
        )

    def clearance(
        self, q: ArrayLike, exact: Literal["auto"] | bool = "auto", *, srdf: str | Path | None = None
    ) -> Clearance:
        """Clearance: the least distance between two links, of the shapes for contact in the robot's file, else of its visuals.

        Capsules around the links prune, and the library coal (extra ``clearance``) evaluates the nearest pairs, meshes as their
        convex hulls. Links that a joint connects are left out, as are pairs in contact in 95 % of 2,000 random configurations.

        Parameters
        ----------
        exact : "auto" or bool; ``"auto"`` uses coal if it is installed, False never: distances are lower bounds then
        srdf : str or Path, optional, SRDF file whose ``<disable_collisions>`` leave out further pairs

        Returns
        -------
        found : Clearance
            ``distance`` (...) [m], below zero in contact, ``pair`` (..., 2), ``exact``, and ``unknown``, links without a shape.

        Raises
        ------
        MissingExtraError
            ``exact`` is True, and coal is not installed.
        RobotFileError
            The SRDF file cannot be read, or is that of another robot.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().clearance([0, -1, 1, 0, 0, 0]).unknown[:2]  # its file has no shapes
        ('base_link', 'shoulder_link')
        """
        from ..statics.clearance import clearance_of

        return clearance_of(self._open(), q, exact, srdf)

    def close(
        self,
        frame_a: str,
        frame_b: str,
        rows: Rows = None,
        *,
        pose: ArrayLike | None = None,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Closed loop, or one more: the robot with ``frame_b`` held on ``frame_a``; see :class:`.closed_robot.ClosedRobot`.

        The chosen rows of the twist of {b} as {c} sees it, along the axes of {c}, are zero, and {b} lies on {c} in
        these directions. Loops are closed one after another. MR section 8.7.

        Parameters
        ----------
        frame_a, frame_b : str, frames of the robot; ``"ground"`` is the base
        rows : str or iterable, optional, rows of the twist that are held
            Three of turning and three of moving (None) are a weld; ``"vx vy vz"`` a ball joint; all but ``wz`` a hinge
            about z.
        pose : (4, 4) array_like, optional, of {c} in {a}; None: {a} itself

        Raises
        ------
        ConstraintError
            No configuration is found at which the loops close, or rows depend on the others and ``redundant`` is not
            "accept".

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> at_the_wall = tw.se3.exp([0, 0, 0, 1.5, 0, 0])
        >>> arm.close("ground", arm.tip, rows="vx vz", pose=at_the_wall)
        <ClosedRobot 'planar_3r': ground–tip vx vz; 1 degree of freedom>
        >>> arm.close("ground", "tip", rows="vz").close("ground", "tip", rows="wy").row_names
        ('ground–tip vz', 'ground–tip #2 wy')
        """
        from .constraints import closure

        return self._closed()._with(closure(self._open().model, frame_a, frame_b, rows, pose), near, redundant)

    def constrain(
        self,
        frame: str,
        rows: Rows,
        kind: Kind = "body",
        *,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Velocity constraint, or one more: the robot with chosen rows of a frame's twist zero, as for a wheel or a blade.

        No position goes with it; where one does, as for a hand on a plane, :meth:`close` with ``"ground"`` keeps it.

        Parameters
        ----------
        frame : str, a frame of the robot
        rows : str or iterable, rows of the twist that are zero
        kind : "body", "space" or "world_aligned", as for :meth:`jacobian`
            ``"vz"`` is along the frame's own z (``"body"``), wherever that points. A hand that stays on a level table
            wants the world's, ``kind="world_aligned"``.

        Raises
        ------
        ConstraintError
            Rows depend on the others and ``redundant`` is not "accept".

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy")
        <ClosedRobot 'floating_box': box vy; 5 degrees of freedom>
        >>> tw.robots.floating_box().constrain("box", "vy").constrain("box", "vz").row_names
        ('box vy', 'box #2 vz')
        """
        from .constraints import rolling

        return self._closed()._with(rolling(self._open().model, frame, rows, kind), near, redundant)

    def export_c(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> tuple[Path, ...]:
        """C code export: quantities as C99 functions that allocate nothing and need ``math.h`` only.

        docs/export.md shows the files. A closed robot exports quantities with its constraints and those of the open one.

        Parameters
        ----------
        path : str or Path, a folder, or the .c file; the header goes beside it
        test : bool, write a program that compares the functions with the kernels, too

        Raises
        ------
        KernelError
            An option does not apply, or no program without branches computes it.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.ur5().export_c(["mass_matrix", ("jacobian", {"kind": "space"})], folder)
        ...     print("void ur5_mass_matrix(const double q[6], double M[36]);" in files[0].read_text())
        True
        """
        from ..export import export_c

        return export_c(self._open(), self._requests(quantities), path, precision=precision, prefix=prefix, test=test)

    def export_st(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
        style: Literal["function_block", "codesys"] = "function_block",
        torque: Literal["joint", "motor"] = "joint",
    ) -> Path:
        """Structured Text export: quantities as function blocks (IEC 61131-3) for PLCs. Not run on a PLC.

        docs/export.md shows the file. The tests execute it by an interpreter over an independent parser's tree.

        Parameters
        ----------
        path : str or Path, a folder, or the file; a name that ends in .st, .scl, .exp or .txt
        precision : "double" or "float", numbers of type LREAL or REAL
        test : bool, write a program that compares the blocks with stored results, too
        style : "function_block" or "codesys"
            "codesys" adds a block for the interface ISMDynamics, to be completed by hand; it exports ``inverse_dynamics``
            alone, with gravity as an input.
        torque : "joint" or "motor"
            "motor" takes the torques of ``inverse_dynamics`` to the shafts of the motors, as :meth:`motor_loads` does.

        Returns
        -------
        file : Path

        Raises
        ------
        KernelError
            An option does not apply, or no program without branches computes the quantity.
        ModelError
            Torques of motors are wanted of a robot that has no actuator at some joint.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = tw.robots.ur5().export_st(["inverse_dynamics", "gravity_forces"], folder)
        ...     print("FUNCTION_BLOCK ur5_inverse_dynamics" in file.read_text())
        True
        """
        from ..export.structured_text import export_st

        wanted: Any = self._requests(quantities)
        return export_st(
            self._open(), wanted, path, precision=precision, prefix=prefix, test=test, style=style, torque=torque
        )

    def export_ros2(self, path: str | Path, *, license: str = "Apache-2.0") -> tuple[Path, ...]:  # noqa: A002
        """ROS 2 package export: a plug-in of ``inverse_dynamics_solver`` with a test. Not built by colcon so far.

        docs/export.md shows the files. The plug-in compares joints and masses with ``robot_description``.

        Parameters
        ----------
        path : str or Path, the folder to make; its last part is the name of the package
        license : str, for package.xml

        Returns
        -------
        files : tuple of Path

        Raises
        ------
        KernelError
            A joint has several coordinates, or none moves.
        ValueRangeError
            The folder is there already or its name is not one of a package, or the license is not a name.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.panda().export_ros2(f"{folder}/panda_dynamics")
        ...     print("getInertiaMatrix" in files[4].read_text())
        True
        """
        from ..export.ros2 import export_ros2

        return export_ros2(self._open(), path, license=license)

    def export_cuda(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
    ) -> tuple[Path, ...]:
        """CUDA source export: quantities as CUDA C++ kernels with a thread for each sample.

        docs/export.md describes the launch. Compiled by nvcc and NVRTC in the tests, not yet run on a GPU.

        Parameters
        ----------
        path : str or Path, a folder, which gets a file for each kernel; or the .cu file of one kernel

        Raises
        ------
        KernelError
            An option does not apply, no program without branches computes the quantity, or the program is too long.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     (file,) = tw.robots.panda().export_cuda("inverse_dynamics", folder, precision="float")
        ...     print("void __launch_bounds__(THREADS) panda_inverse_dynamics" in file.read_text())
        True
        """
        from ..export import export_cuda

        return export_cuda(self._open(), self._requests(quantities), path, precision=precision, prefix=prefix)

    def _requests(self, quantities: Quantities) -> list[tuple[str, dict[str, Any]]]:
        """Quantities with their options, the constraints among them."""
        from ..export.request import named

        return [(name, {**self._constraint_options(name), **options}) for name, options in named(quantities)]

    # ── simulation and rollout ──

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

        docs/simulation.md explains and measures, docs/constraints.md for closed robots. Their steps end on the constraints, by
        the projection that is least in the kinetic metric; Hairer, Lubich and Wanner, Geometric Numerical Integration, section
        IV.4.

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

        Examples
        --------
        >>> import twistwrench as tw
        >>> swing = tw.robots.pendulum().simulate([3.0], [0.0], duration=2.0)
        >>> len(swing), swing.stopped, swing.relative_drift < 1e-7
        (2001, 'reached the end, 2 s', True)
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

        docs/rollouts.md explains. The steps of a closed robot are those of :meth:`simulate`, in float64. Where its constraints
        lose rank on the way, the states of that motion are NaN from there on; the others go on.

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

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> many = arm.rollout(np.random.default_rng(0).normal(size=(100, 2)), [0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.unstable.any())
        ((100, 21, 2), False)
        """
        return self._rolled_out(
            q0, dq0, tau, dt=dt, steps=steps, duration=duration, every=every, method=method,
            wrench_on_robot=wrench_on_robot, parameters=parameters, friction=friction, torque_limits=torque_limits,
            torques=torques, gradients=gradients, out=out,
        )  # fmt: skip


complete(globals())
