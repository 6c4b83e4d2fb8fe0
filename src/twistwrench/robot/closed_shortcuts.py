"""Methods of a closed robot that open what is built on it: simulation, and statics on its inverse dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from .common_methods import CommonMethods
from .simulation_methods import ClosedMethod, SimulationMethods

if TYPE_CHECKING:
    from ..algorithms.constrained import ConstrainedTorques
    from ..simulation.closed_rollout import ClosedRollout
    from ..simulation.closed_simulation import ClosedSimulation
    from .closed_robot import ClosedRobot
    from .quantity_options import KernelOptions
    from .robot import Robot
    from .searched_loops import SearchedLoops
    from .wrench_arguments import Wrenches


class ClosedShortcuts(CommonMethods, SimulationMethods[ClosedMethod, "ClosedSimulation", "ClosedRollout"]):
    """Methods of a closed robot that open what is built on it."""

    # ── what the methods that open robots have, too, ask ──

    def _open(self: Any) -> Robot:
        return self.robot

    def _closed(self: Any) -> ClosedRobot:
        return self

    def _searched_loops(self: Any) -> SearchedLoops:
        from .searched_loops import SearchedLoops

        key = ("searched loops", self.constraints, self.independent)
        found: SearchedLoops = self.robot.engine.kept(key, lambda: SearchedLoops(self))
        return found

    def _constraint_options(self: Any, name: str) -> Mapping[str, Any]:
        from .quantity_options import options_of

        return {"constraints": self._kept} if "constraints" in options_of(name) else {}

    def _simulated(self: Any, *start: Any, **given: Any) -> ClosedSimulation:
        from ..simulation.closed_simulation import simulate_closed

        return simulate_closed(self, *start, **given)

    def _rolled_out(self: Any, *start: Any, **given: Any) -> ClosedRollout:
        from ..simulation.closed_rollout import rollout_closed

        return rollout_closed(self, *start, **given)

    # ── methods of its own ──

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

        if not any(self._constraint_options(name) for name in names):
            raise KernelError(
                f"{', '.join(names)}: nothing of this knows of constraints. Of the robot with its loops open: "
                "closed.robot.kernel(…)."
            )
        return self.robot.kernel(*names, **{"constraints": self._kept, **options})
