"""What is built on robots, as methods of a robot: the one module here that imports from above, when a method is called."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from ..typing import Array
from .quantity_types import Kind, Rows
from .state_arguments import names_of, states
from .wrench_arguments import check_mapping, wrench_at

if TYPE_CHECKING:
    from ..algorithms.closed_form import ClosedForm
    from ..export.request import Quantities
    from ..screws.wrench import Wrench
    from ..simulation import Event, JointStops, Plane, SimulationBatch, SimulationOptions, SimulationResult
    from ..simulation.rollout import Rollout
    from ..simulation.torque_laws import TorqueLaw
    from .closed_robot import ClosedRobot
    from .cuda_robot import CudaRobot
    from .explanation import Explanation
    from .reached_poses import InverseKinematics
    from .wrench_arguments import Wrenches

Law = Callable[[float, Array, Array], Any]
"""A function of (t, q, dq)."""
Method = Literal["dopri5", "rk4", "semi_implicit", "euler", "midpoint", "variational", "variational6"]


@cache
def _inverse_kinematics() -> Callable[..., InverseKinematics]:
    """Imported at the first call; an import statement takes a good part of what a pose near by does."""
    from .inverse_kinematics import solve

    return solve


class Shortcuts:
    """Methods of a robot that open what is built on it: inverse kinematics, simulation, closed loops, export."""

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
        """Inverse kinematics: configurations, inside the joints' limits, at which a frame has the pose T.

        Parameters
        ----------
        T : (4, 4) array_like, wanted pose in the base frame [m]; (k, 4, 4) of k frames at once
        frame : str, optional, a link of the robot; its tip if None; a sequence of k names for k frames at once
        q0 : (nq,) array_like, optional, where the search starts; None: neutral
        rows : str or iterable, optional, rows of the twist that count; ``"vx vy vz"`` asks for the position only;
            a mapping of frames to rows where frames differ
        restarts : int, random starts where the first fails
        rng : numpy Generator or seed, for the random starts
        angle : float, tolerance [rad]
        distance : float, tolerance [m]
        nearest : bool, whether what the poses leave free is used to come as near to ``q0`` as they let

        Returns
        -------
        found : InverseKinematics
            It says which poses were reached, what is left, and why; nothing else counts as reached.

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
        Newton's method, damped, MR section 6.2. Any batch of T and q0. What is left of several frames is the root of the sum
        of squares. ``nearest`` goes on from what was found, by Newton steps in the poses' null space, 240 at most: what it
        reaches is the nearest on the way, not on other branches (Siciliano et al., Robotics, section 3.5.1).

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.ur5()
        >>> found = arm.inverse_kinematics(arm.forward_kinematics([0.1, -1, 1, 0.2, 0.3, 0]))
        >>> bool(found.converged), found.q.shape
        (True, (6,))
        """
        return _inverse_kinematics()(self, T, frame, q0, rows, restarts, rng, angle, distance, nearest)

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
    ) -> InverseKinematics:
        """All branches of inverse kinematics that are found: elbow up and down, wrist turned over, and so on.

        Parameters
        ----------
        T : (4, 4) array_like, wanted pose in the base frame [m]
        frame : str, optional, a link of the robot; its tip if None
        rows : str or iterable, optional, rows of the twist that count
        starts : int, how many places the search starts from
        rng : numpy Generator or seed, for these places
        angle : float, tolerance [rad]
        distance : float, tolerance [m]

        Returns
        -------
        found : InverseKinematics
            A row for each branch, with the least angles first; none where the pose was not reached. All are inside the limits.

        Raises
        ------
        ShapeError, ValueRangeError
            ``T`` is no single pose, another argument is invalid, or the robot has more joints than there are rows.
        UnknownNameError
            The robot has no such frame.
        FrameError
            No frame is named, and the robot has no single tip.

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
        from .pose_branches import branches

        return branches(self, T, frame, rows, starts, rng, angle, distance)

    def simulate(
        self: Any,
        q0: ArrayLike | None = None,
        dq0: ArrayLike | None = None,
        duration: float = 1.0,
        dt: float = 1e-3,
        *,
        method: Method = "dopri5",
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
    ) -> SimulationResult:
        """Simulation: the motion from one state, under torques, controllers, wrenches, contacts and limits.

        Parameters
        ----------
        q0 : (nq,) array_like, optional, configuration at the start; None: neutral
        dq0 : (nv,) array_like, optional, velocities at the start [rad/s, m/s]; None: at rest
        duration : float [s]
        dt : float, a state every so often [s]
        method : str, the integrator
            ``"dopri5"``, which adapts its steps to ``rtol`` and ``atol``; ``"rk4"``, ``"semi_implicit"``, ``"euler"``,
            and the variational ``"midpoint"``, ``"variational"``, ``"variational6"``, with steps of ``dt``.
        tau : (nv,) array_like or function of (t, q, dq), optional, joint torques [N m, sliding joints: N]
        controller : function of (t, q, dq), optional, asked every ``dt``, its torques held until the next time
        wrench_on_robot : {frame: (6,) or function of (t, q, dq)}, optional, (m, f) in that frame [N m, N]
        friction : bool, count the friction of the joints
        creep : float, optional, joint velocity below which friction is eased off [rad/s, m/s]
            In semi-implicit steps friction is an impulse that stops and holds the joints instead.
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

        Raises
        ------
        SimulationError
            A step is unstable, or a controller fails; all that was computed is in ``.result``.
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        docs/simulation.md explains and measures.

        Examples
        --------
        >>> import twistwrench as tw
        >>> swing = tw.robots.pendulum().simulate([3.0], [0.0], duration=2.0)
        >>> len(swing), swing.stopped, swing.relative_drift < 1e-7
        (2001, 'reached the end, 2 s', True)
        """
        from ..simulation import simulate

        return simulate(
            self, q0, dq0, duration, dt, method=method, tau=tau, controller=controller, wrench_on_robot=wrench_on_robot,
            friction=friction, creep=creep, contacts=contacts, limits=limits, events=events, rtol=rtol, atol=atol,
            max_step=max_step, every=every, progress=progress,
        )  # fmt: skip

    def simulate_batch(
        self: Any,
        q0: ArrayLike | None = None,
        dq0: ArrayLike | None = None,
        duration: float = 1.0,
        dt: float = 1e-3,
        **options: Unpack[SimulationOptions],
    ) -> SimulationBatch:
        """Simulations from many states, each as :meth:`simulate` gives it, to the last bit.

        Parameters
        ----------
        q0 : (..., nq) array_like, optional, configurations at the start; None: neutral
        dq0 : (..., nv) array_like, optional, velocities at the start [rad/s, m/s]; None: at rest
        duration : float [s]
        dt : float, a state every so often [s]
        **options : all others of :meth:`simulate`, the same for each

        Returns
        -------
        batch : SimulationBatch, one SimulationResult for each state

        Raises
        ------
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid.
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
        from ..simulation.batch import simulate_batch

        return simulate_batch(self, q0, dq0, duration, dt, **options)

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
        gradients: bool = False,
        out: tuple[Array, ...] | None = None,
        integrator: Literal["semi_implicit", "rk4"] | None = None,
    ) -> Rollout:
        """Rollout: motions from any batch of states, all steps of ``dt`` in one kernel.

        Parameters
        ----------
        q0 : (..., nq) array_like, configurations at the start
        dq0 : (..., nv) array_like, velocities at the start [rad/s, m/s]
        tau : (nv,) or (..., steps, nv) array_like, or law, optional
            Torques for all steps, or step by step [N m, sliding joints: N], or ``tw.simulation.BatchPD`` or
            ``BatchComputedTorque``, or ``tw.control.PD`` or ``ComputedTorque`` of this robot.
        dt : float, time step [s]
        steps : int, optional, how many; give this or ``duration``
        duration : float, optional [s]
        every : int, keep one state in so many
        method : "semi_implicit" or "rk4", the integrator
        wrench_on_robot : {frame: (6,) or (..., steps, 6)}, optional, (m, f) in that frame [N m, N]
        parameters : {name: (...)}, optional, names of :meth:`varying`, as a payload's mass for each sample
        friction : bool, count that of the joints, as in :meth:`simulate`
        torque_limits : bool or (nv,) array_like, True clips to ``limits.effort``, numbers to these
        torques : bool, return those applied, too
        gradients : bool, keep what went in, for ``.gradient`` and ``.linearize`` of the rollout
        out : (q, dq), optional, arrays of yours that take the results, for large ones again and again
        integrator : former name of ``method``

        Returns
        -------
        rollout : Rollout, q (..., n, nq) and dq (..., n, nv)
            Motions that become unstable are named in its ``.unstable``.

        Raises
        ------
        ShapeError, ValueRangeError, UnknownNameError
            An argument is invalid.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        docs/rollouts.md explains.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> many = arm.rollout(np.random.default_rng(0).normal(size=(100, 2)), [0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.unstable.any())
        ((100, 21, 2), False)
        """
        from ..simulation.rollout import rollout

        return rollout(
            self, q0, dq0, tau, dt=dt, steps=steps, duration=duration, every=every,
            method=method if integrator is None else integrator, wrench_on_robot=wrench_on_robot, parameters=parameters,
            friction=friction, torque_limits=torque_limits, torques=torques,
            gradients=gradients, out=out,
        )  # fmt: skip

    def close(
        self: Any,
        frame_a: str,
        frame_b: str,
        rows: Rows = None,
        *,
        pose: ArrayLike | None = None,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Closed loop: the robot with ``frame_b`` held on ``frame_a``; see :class:`twistwrench.robot.closed_robot.ClosedRobot`.

        Parameters
        ----------
        frame_a, frame_b : str, frames of the robot; ``"ground"`` is the base
        rows : str or iterable, optional, rows of the twist that are held
            Three of turning and three of moving (None) are a weld; ``"vx vy vz"`` a ball joint; all but ``wz`` a hinge
            about z.
        pose : (4, 4) array_like, optional, of {c} in {a}; None: {a} itself
        near : (nq,) array_like, optional, configuration near which the closed loops are searched; None: anywhere
        redundant : "error" or "accept", what to do with rows that depend on the others

        Returns
        -------
        closed : ClosedRobot

        Raises
        ------
        ConstraintError
            No configuration is found at which the loops close, or rows depend on the others and ``redundant`` is not
            "accept".
        UnknownNameError
            The robot has no such frame or row.
        ShapeError
            ``pose`` or ``near`` is of another size.

        Notes
        -----
        The chosen rows of the twist of {b} as {c} sees it, along the axes of {c}, are zero, and {b} lies on {c} in
        these directions. Loops are closed one after another. MR section 8.7.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> at_the_wall = tw.se3.exp([0, 0, 0, 1.5, 0, 0])
        >>> arm.close("ground", arm.tip, rows="vx vz", pose=at_the_wall)
        <ClosedRobot 'planar_3r': ground–tip vx vz; 1 degree of freedom>
        """
        from .closed_robot import ClosedRobot

        return ClosedRobot(self).close(frame_a, frame_b, rows, pose=pose, near=near, redundant=redundant)

    def constrain(
        self: Any,
        frame: str,
        rows: Rows,
        kind: Kind = "body",
        *,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Velocity constraint: the robot with chosen rows of a frame's twist zero, as for a wheel or a blade.

        Parameters
        ----------
        frame : str, a frame of the robot
        rows : str or iterable, rows of the twist that are zero
        kind : "body", "space" or "world_aligned", as for :meth:`jacobian`
            ``"vz"`` is along the frame's own z (``"body"``), wherever that points. A hand that stays on a level table
            wants the world's, ``kind="world_aligned"``.
        near : (nq,) array_like, optional, configuration near which the closed loops are searched; None: anywhere
        redundant : "error" or "accept", what to do with rows that depend on the others

        Returns
        -------
        closed : ClosedRobot

        Raises
        ------
        ConstraintError
            Rows depend on the others and ``redundant`` is not "accept".
        UnknownNameError
            The robot has no such frame or row.

        Notes
        -----
        No position goes with it; where one does, as for a hand on a plane, :meth:`close` with ``"ground"`` keeps it.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy")
        <ClosedRobot 'floating_box': box vy; 5 degrees of freedom>
        """
        from .closed_robot import ClosedRobot

        return ClosedRobot(self).constrain(frame, rows, kind, near=near, redundant=redundant)

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

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array, joint accelerations [rad/s², m/s²]
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, count the friction of the joints

        Returns
        -------
        why : Explanation, whose parts add up to τ

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        UnknownNameError
            A wrench is at no frame of the robot.

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
            from ..algorithms.armature import armature_forces

            apart["armature"] = armature_forces(self.model, dq, ddq)
        if friction and self.model.friction.any:
            apart["friction"] = self.friction_forces(dq, load=tau)
        Y = self.engine.kept("regressor on NumPy", lambda: _on_numpy(self))
        from .explanation import explained

        return explained(self.model, Y, (q, dq, ddq), apart)

    def closed_form(self: Any, q: ArrayLike, dq: ArrayLike, *, wrench_by_robot: Wrenches | None = None) -> ClosedForm:
        """Closed-form equations of motion: terms and block matrices of MR section 8.4 at one state.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]

        Returns
        -------
        terms : ClosedForm

        Raises
        ------
        ShapeError
            An array is a batch or of another size.
        UnknownNameError
            A wrench is at no frame of the robot.

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

    def export_c(
        self: Any,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> tuple[Path, ...]:
        """C code export: quantities as C99 functions that allocate nothing and need ``math.h`` only.

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

        Notes
        -----
        docs/export.md shows the files.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.ur5().export_c(["mass_matrix", ("jacobian", {"kind": "space"})], folder)
        ...     print("void ur5_mass_matrix(const double q[6], double M[36]);" in files[0].read_text())
        True
        """
        from ..export import export_c

        return export_c(self, quantities, path, precision=precision, prefix=prefix, test=test)

    @property
    def cuda(self: Any) -> CudaRobot:
        """The same quantities for arrays in a GPU's memory (CuPy, PyTorch); see :class:`~twistwrench.cuda.CudaRobot`."""
        from .cuda_robot import CudaRobot

        found: CudaRobot = self.engine.kept("cuda", lambda: CudaRobot(self))
        return found


def _on_numpy(robot: Any) -> Any:
    """The regressor, which is asked once in a while: not worth the second that compiling takes."""
    from ..targets.numpy import NumpyKernel

    return NumpyKernel(robot.program("regressor"), "regressor", "")
