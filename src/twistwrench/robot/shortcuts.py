"""What is built on robots, as methods of a robot: the one module here that imports from above, when a method is called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.signatures import taking_the_arguments_of
from ..errors import ShapeError
from ..typing import Array
from .common_methods import CommonMethods
from .quantity_types import Rows
from .simulation_methods import Method, SimulationMethods
from .state_arguments import names_of, states
from .wrench_arguments import check_mapping, wrench_at

if TYPE_CHECKING:
    from ..algorithms.closed_form import ClosedForm
    from ..simulation import SimulationBatch, SimulationResult
    from ..simulation.rollout import Rollout
    from .closed_robot import ClosedRobot
    from .explanation import Explanation
    from .reached_poses import InverseKinematics
    from .robot import Robot
    from .wrench_arguments import Wrenches


class Shortcuts(CommonMethods, SimulationMethods[Method, "SimulationResult", "Rollout"]):
    """Methods of a robot that open what is built on it: simulation, closed loops, and what only open robots have."""

    # ── what the methods that closed robots have, too, ask ──

    def _open(self: Any) -> Robot:
        return self

    def _closed(self: Any) -> ClosedRobot:
        from .closed_robot import ClosedRobot

        return ClosedRobot(self)

    def _simulated(self: Any, *start: Any, **given: Any) -> SimulationResult:
        from ..simulation.simulated import simulated

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


def _on_numpy(robot: Any) -> Any:
    """The regressor, which is asked once in a while: not worth the second that compiling takes."""
    from ..targets.numpy import NumpyKernel

    return NumpyKernel(robot.program("regressor"), "regressor", "")
