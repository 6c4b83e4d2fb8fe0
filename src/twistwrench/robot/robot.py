"""Robot: the class with all methods; inverse kinematics, explanation and closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from types import FunctionType
from typing import TYPE_CHECKING, Any, Generic, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import HintedClass, ShapeError
from ..core.glossary import complete
from ..core.typing import Array
from .arguments import Rows, Wrenches, check_mapping, names_of, states, wrench_at
from .base import Motion, Slopes, Torques, require_robot
from .constraint_methods import ConstraintMethods
from .conversion_methods import BridgeMethods, EditMethods, ExportMethods, FileMethods
from .doors import MethodName, RobotDoors, RolledOut, Simulated
from .quantity_methods import QuantityMethods
from .task_space_methods import ActuationMethods, TaskSpaceMethods

if TYPE_CHECKING:
    from ..compiler.runtime.dispatch import CallSignature
    from ..mechanics.algorithms.closed_form import ClosedForm
    from .doors import ConstrainedRobot
    from .explanation import Explanation
    from .inverse_kinematics.solve import IKResult


@cache
def _inverse_kinematics() -> Callable[..., IKResult]:
    """Solver, imported at the first call: an import statement in each call would take as long as a search from a near start."""
    from .inverse_kinematics.solve import solve

    return solve


class Robot(
    QuantityMethods[Motion, Torques, Slopes],
    TaskSpaceMethods,
    ActuationMethods,
    EditMethods,
    FileMethods,
    BridgeMethods,
    ExportMethods,
    ConstraintMethods,
    RobotDoors[MethodName, Simulated, RolledOut],
    Generic[Motion, Torques, Slopes, MethodName, Simulated, RolledOut],
    metaclass=HintedClass,
):
    """A robot: kinematics, dynamics, statics and control of a tree of joints, compiled at first use.

    Immutable: every edit returns a new robot. Created by :func:`twistwrench.load`, :func:`~twistwrench.from_screws`,
    :func:`~twistwrench.from_dh`, or from a model of a :class:`~twistwrench.mechanics.model.builder.ModelBuilder`. Every method
    accepts any leading batch shape and broadcasts as NumPy does; documented shapes are those of one state.

    :meth:`close` and :meth:`constrain` return the robot with :attr:`constraints` A dq = 0. Its dynamics are those with
    constraint forces, MR section 8.7; a state that violates the constraints is a ConstraintError.

    Parameters
    ----------
    model : Model

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, q, dq = tw.robots.planar_2r(), [0.0, np.pi / 2], [0.0, 1.0]
    >>> arm.info()["joints"][0]["unit"], arm.coordinates(joint2=0.5).tolist(), arm.random_configuration(0, (2, 3)).shape
    ('rad', [0.0, 0.5], (2, 3, 2))
    >>> arm.screws_at_com().Glist[0].round(9).diagonal().tolist()
    [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    >>> arm.mass_matrix(q).round(9).tolist(), arm.gravity_forces(q).round(2).tolist()
    ([[3.0, 1.0], [1.0, 1.0]], [19.62, 0.0])
    >>> arm.coriolis_forces(q, dq).round(9).tolist(), arm.bias_forces(q, dq).round(2).tolist()
    ([-1.0, 0.0], [18.62, 0.0])
    >>> arm.coriolis_matrix(q, dq).round(9).tolist(), arm.christoffel(q)[0].round(9).tolist()
    ([[-1.0, -1.0], [0.0, 0.0]], [[0.0, -1.0], [-1.0, -1.0]])
    >>> arm.joint_wrenches(q, dq, [0, 0]).shape
    (2, 6)
    >>> arm.kinetic_energy(q, dq).round(9).item(), arm.potential_energy(q).round(2).item()
    (0.5, 9.81)
    >>> arm.momentum(q, dq).round(9).tolist()
    [0.0, -1.0, 0.0, -1.0, 0.0, 0.0]
    >>> arm.center_of_mass(q).round(9).tolist(), arm.com_jacobian(q)[2].round(9).tolist()
    ([1.0, 0.0, 0.5], [1.0, 0.0])
    >>> arm.link_poses(q).shape == (len(arm.link_names), 4, 4)
    True
    >>> arm.frame_velocity(q, dq, kind="world_aligned").round(9).tolist()
    [0.0, -1.0, 0.0, -1.0, 0.0, 0.0]
    >>> arm.frame_acceleration(q, [1, 0], [0, 0], kind="world_aligned").round(9)[3:].tolist()
    [-1.0, 0.0, -1.0]
    >>> bool(np.allclose(arm.jacobian_derivative(q) @ dq, arm.jacobian_rate(q, dq)))
    True
    >>> arm.mass_matrix_derivative(q)[:, :, 1].round(9).tolist()
    [[-2.0, -1.0], [-1.0, 0.0]]
    >>> arm.forward_dynamics_derivatives(q, dq, [0, 0])[2].round(9).tolist()  # M⁻¹
    [[0.5, -0.5], [-0.5, 1.5]]
    >>> arm.subtract(q, dq).round(9).tolist()
    [0.0, 0.570796327]
    >>> (arm.regressor(q, dq, [0, 0]) @ arm.parameters).round(2).tolist()
    [18.62, 0.0]
    >>> arm.with_gravity([0, 0, -1.62]).gravity_forces(q).round(9).tolist(), arm.lock({"joint2": 0.5}).joint_names
    ([3.24, 0.0], ('joint1',))
    >>> arm.with_armature({"joint2": 0.5}).mass_matrix(q)[1, 1].round(9).item()
    1.5
    >>> [tw.load(text).nv for text in (arm.to_mjcf(), arm.to_sdf())]
    [2, 2]
    >>> arm.program("inverse_dynamics").signature, arm.reference("gravity_forces", q).round(2).tolist()
    ('(2),(2),(2)->(2)', [19.62, 0.0])
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
    >>> held.inverse_dynamics_derivatives(q, rest, rest, ["joint1"]).tau_by_q.shape
    (1, 1)
    >>> held.kernel("constrained_dynamics").signature
    '(3),(3),(3)->(3),(2),(2)'
    >>> bool(held.simulate(q, duration=0.5).gap.max() < 1e-12)
    True
    """

    # ── direct calls of kernels ──

    def _install_direct_call(self, name: str, kernel: Any, signature: CallSignature, call_count: int) -> bool:
        """Install a builtin that calls the kernel directly for plain arrays of one state; all other calls use the method.

        Returns True if calls of this kind need not be counted any more: a builtin exists or is impossible.
        """
        method = getattr(Robot, name) if name in _METHODS else None
        if method is None or getattr(type(self), name) is not method:  # a subclass has its own method
            return True
        from ..compiler.runtime.dispatch import attach_fallback, calls_before, is_made_here, make_call

        installed = vars(self).get(name)
        if installed is not None and not is_made_here(installed):  # the user's attribute
            return True
        if call_count < calls_before(kernel):
            return False
        direct_call = make_call(kernel, method.__get__(self), name, signature)
        if direct_call is None:
            return True
        if installed is None:
            vars(self)[name] = direct_call
        else:  # of another signature, such as float32
            attach_fallback(installed, direct_call)
        return True

    # ── inverse kinematics, explanation ──

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
        """Inverse kinematics: configurations, inside joint limits and with loops closed, at which a frame has the pose T.

        Parameters
        ----------
        T : (4, 4) array_like, desired pose in the base frame [m]; (k, 4, 4) for k frames at once
        frame : str, optional, a link of the robot; its tip if None; a sequence of k names for k frames at once
        q0 : (nq,) array_like, optional, start of the search, loops closed or not; None: neutral, or a closed
            configuration
        rows : str or iterable, optional, rows of the twist that count; ``"vx vy vz"`` selects the position only;
            a mapping of frames to rows if frames differ
        restarts : int, number of random starts if the first one fails; with loops closed for a closed robot
        rng : numpy Generator or seed, for the random starts
        nearest : bool, use the remaining degrees of freedom to come as near to ``q0`` as possible
        clearance : float, optional, smallest distance between links [m], as computed by :meth:`clearance`
            A solution below it is replaced by the nearest sufficient one from ``restarts`` random starts.

        Returns
        -------
        found : IKResult
            Poses reached, remaining errors and reasons, and for a closed robot the gaps of its loops. Only solutions
            within the tolerances count as reached.

        Notes
        -----
        Damped Newton method, MR section 6.2. Any batch of T and q0. The error of several frames is the root of the sum
        of squares. ``nearest`` continues from the solution with at most 240 Newton steps in the null space of the
        poses. It finds the nearest configuration on the same branch only (Siciliano et al., Robotics, section 3.5.1).
        The gaps of closed loops are further rows, so that poses and loops are satisfied together. If a pose is not
        reached, the result is the nearest closed configuration found, if there is one.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.ur5()
        >>> found = arm.inverse_kinematics(arm.forward_kinematics([0.1, -1, 1, 0.2, 0.3, 0]))
        >>> bool(found.converged), found.q.shape
        (True, (6,))
        """
        loops = self._searched_loops() if self.constraints else None
        robot = cast("Robot", self) if loops is None else self.open()
        solve = _inverse_kinematics()
        options = angle, distance, nearest, loops
        result = solve(robot, T, frame, q0, rows, restarts, rng, *options)
        if clearance is None:
            return result
        from .inverse_kinematics.solve import clear_of_links

        def solve_without_restarts(target: Array, starts: Array) -> IKResult:
            return solve(robot, target, frame, starts, rows, 0, rng, *options)

        poses = np.asarray(T)
        has_single_frame = frame is None or isinstance(frame, str)
        target_rank = 2 if has_single_frame else 3  # (4, 4) or (k, 4, 4)
        batch_shape = result.q.shape[:-1]
        return clear_of_links(
            result,
            np.broadcast_to(poses, (*batch_shape, *poses.shape[-target_rank:])),
            solve_without_restarts,
            robot._clearance_search(),
            arguments.positive(clearance, "inverse_kinematics: clearance", "m", zero=True),
            robot.random_configuration(rng, restarts),
        )

    def inverse_kinematics_branches(
        self,
        T: ArrayLike,
        frame: str | None = None,
        *,
        rows: Rows = None,
        starts: int = 256,
        rng: np.random.Generator | int | None = 0,
        angle: float = 1e-10,
        distance: float = 1e-10,
    ) -> IKResult:
        """Branches of inverse kinematics found by a search, such as elbow up and down or wrist flipped.

        Solutions that differ by full turns are one branch, with the smallest angles within the limits. The search
        starts from random configurations and may miss branches; if more ``starts`` find more branches, there were too
        few. MR section 6.1. At singular configurations branches meet or are points on a continuum of solutions; a
        ``ModelWarning`` reports it.

        Parameters
        ----------
        T : (4, 4) array_like, desired pose in the base frame [m]
        rows : str or iterable, optional, rows of the twist that count
        starts : int, number of random start configurations
        rng : numpy Generator or seed, for the start configurations

        Returns
        -------
        found : IKResult
            A row for each branch, smallest angles first; empty if the pose was not reached. All are inside the limits.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> T = arm.forward_kinematics([0.3, 0.8])
        >>> arm.inverse_kinematics_branches(T, rows="vx vy").q.round(3) + 0.0
        array([[ 0.3,  0.8],
               [ 1.1, -0.8]])
        """
        from .inverse_kinematics.branches import branches

        return branches(
            require_robot(self, "inverse_kinematics_branches"), T, frame, rows, starts, rng, angle, distance
        )

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
        """Joint torques of :meth:`inverse_dynamics` split by term and by the link, rotor or payload that causes them.

        Any batch shape is allowed; the table and the plot are of one state. Inverse dynamics is linear in the inertial
        parameters, MR section 8.2. Constraints transmit the tree's torques f to the motors: τ = f + A'λ is linear in f.

        Parameters
        ----------
        friction : bool, include the friction of all joints, driven or not

        Returns
        -------
        why : Explanation, parts that add up to τ; with constraints zero at joints without a motor

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r().with_payload(tw.SpatialInertia.from_com(2.0))
        >>> why = arm.explain([0, 0], [0, 1], [0, 0])
        >>> why.contribution("payload at tip", "gravity").round(2).tolist()
        [39.24, 19.62]
        """
        wrenches: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        if self.constraints:
            from .constraints.projections import explanation

            return explanation(cast("ConstrainedRobot", self), q, dq, ddq, actuated, friction=friction, **wrenches)
        if actuated is not None:
            self._motors(actuated)
        q, dq, ddq = map(np.asarray, states(self.model, "explain", q=q, dq=dq, ddq=ddq))
        tau = np.asarray(self.inverse_dynamics(q, dq, ddq, **wrenches), float)
        other_torques: dict[str, Array] = {}  # of terms without inertial parameters
        for sign, frame_wrenches in ((1.0, wrench_by_robot), (-1.0, wrench_on_robot)):
            for frame, F in (frame_wrenches or {}).items():
                name = f"wrench at {frame}"
                torque = sign * self.wrench_torques(q, wrench_at(self.model, frame, F), frame)
                other_torques[name] = torque + other_torques.get(name, 0.0)
        if self.model.springs:
            other_torques["springs"] = self.holding_torques(q) - self.gravity_forces(q)
        if self.model.armature.any():
            from ..mechanics.algorithms.recursion import armature_forces

            other_torques["armature"] = armature_forces(self.model, dq, ddq)
        if friction and self.model.friction.any:
            other_torques["friction"] = self.friction_forces(dq, load=tau)
        from ..compiler.lowering.numpy_kernels import NumpyKernel
        from .explanation import explain_torques

        # On NumPy, since it is evaluated rarely and compiling it would take a second.
        regressor = self.engine.cache(
            "regressor on NumPy", lambda: NumpyKernel(self.program("regressor"), "regressor", "")
        )
        return explain_torques(self.model, regressor, (q, dq, ddq), other_torques)

    def closed_form(self, q: ArrayLike, dq: ArrayLike, *, wrench_by_robot: Wrenches | None = None) -> ClosedForm:
        """Closed-form equations of motion: terms and block matrices of MR section 8.4 at one state.

        Slow, and independent of the recursive algorithms that compute the terms elsewhere.

        Examples
        --------
        >>> import twistwrench as tw
        >>> terms = tw.robots.planar_2r().closed_form([0, 0.5], [1, 1])
        >>> terms.A.shape, terms.L.shape, terms.M.shape
        ((12, 2), (12, 12), (2, 2))
        """
        q = arguments.one(q, "closed_form: q", self.nq, names=names_of(self.model, "q"))
        q = arguments.finite(q, "closed_form: q", self.nq)
        dq = arguments.one(dq, "closed_form: dq", self.nv, names=names_of(self.model, "dq"))
        dq = arguments.finite(dq, "closed_form: dq", self.nv)
        require_robot(self, "closed_form")
        check_mapping(wrench_by_robot)
        wrenches = {frame: wrench_at(self.model, frame, F) for frame, F in (wrench_by_robot or {}).items()}
        for frame, F in wrenches.items():
            if F.ndim > 1:
                raise ShapeError(f"closed_form: the wrench at {frame!r} is a batch; one state takes six numbers.")
        from ..mechanics.algorithms.closed_form import closed_form

        return closed_form(self.model, q, dq, wrenches)


def _name_methods() -> None:
    """Set the qualified names of the mixins' methods to ``Robot.…``, which errors for missing arguments show."""
    for mixin in Robot.__mro__[1:]:
        if not mixin.__module__.startswith(__package__):
            continue
        for name, method in vars(mixin).items():
            if isinstance(method, FunctionType):
                method.__qualname__ = f"Robot.{name}"


_name_methods()
_METHODS = frozenset(dir(Robot))
complete(globals())
