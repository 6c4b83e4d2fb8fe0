"""Robot: the class with all methods, and the methods that only robots without closed loops have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError
from ..core.glossary import complete
from ..core.typing import Array
from .arguments import Rows, Wrenches, check_mapping, names_of, states, wrench_at
from .conversion_methods import BridgeMethods, EditMethods, FileMethods
from .doors import TreeDoors
from .quantity_methods import QuantityMethods
from .shared_methods import SharedMethods
from .task_space_methods import ActuationMethods, TaskSpaceMethods

if TYPE_CHECKING:
    from ..compiler.runtime.dispatch import CallSignature
    from ..mechanics.algorithms.constraints import Constraint
    from ..mechanics.algorithms.inverse_dynamics import ClosedForm
    from ..mechanics.model.model import Model
    from .constraints.closed_robot import ClosedRobot
    from .explanation import Explanation
    from .ik import IKResult


class Robot(
    QuantityMethods,
    TaskSpaceMethods,
    ActuationMethods,
    EditMethods,
    FileMethods,
    BridgeMethods,
    SharedMethods,
    TreeDoors,
):
    """A robot: kinematics, dynamics, statics and control of a tree of joints, compiled at first use.

    Immutable: every edit returns a new robot. Created by :func:`twistwrench.load`, :func:`~twistwrench.from_screws`,
    :func:`~twistwrench.from_dh`, or from a model of a :class:`~twistwrench.mechanics.model.builder.ModelBuilder`. Every method
    accepts any leading batch shape and broadcasts as NumPy does; documented shapes are those of one state.

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
    """

    constraints: tuple[Constraint, ...] = ()
    """Closures and velocity constraints, in the order of their creation."""

    # ── hooks that differ from closed robots ──

    def open(self) -> Robot:
        """The same robot with its loops open.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.open() is arm
        True
        """
        return self

    def _of_model(self, model: Model) -> Robot:
        """Robot with another model, the result of an edit."""
        return Robot(model)

    def _closed(self) -> ClosedRobot:
        from .constraints.closed_robot import ClosedRobot

        return ClosedRobot(self)

    def _put_in_front(self, name: str, kernel: Any, asked: CallSignature, calls: int) -> bool:
        """Install a builtin that calls the kernel directly for plain arrays of one state; all other calls use the method.

        Returns True if calls of this kind need no further counting: a builtin exists or is impossible.
        """
        method = getattr(Robot, name, None)
        before = vars(self).get(name)
        if method is None or getattr(type(self), name) is not method:
            return True
        from ..compiler.runtime.dispatch import attach_fallback, calls_before, is_made_here, make_call

        if before is not None and not is_made_here(before):
            return True
        if calls < calls_before(kernel):
            return False
        direct = make_call(kernel, method.__get__(self), name, asked)
        if direct is not None and before is not None:
            attach_fallback(before, direct)
        elif direct is not None:
            vars(self)[name] = direct
        return True

    # ── inverse kinematics, explanation ──

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
        from .ik import branches

        return branches(self, T, frame, rows, starts, rng, angle, distance)

    def explain(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> Explanation:
        """Joint torques split by term and by the link, rotor or payload that causes them.

        Any batch shape is allowed; the table and the plot are of one state. Inverse dynamics is linear in the inertial
        parameters, MR section 8.2.

        Returns
        -------
        why : Explanation, parts that add up to τ

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r().with_payload(tw.SpatialInertia.from_com(2.0))
        >>> why = arm.explain([0, 0], [0, 1], [0, 0])
        >>> why.contribution("payload at tip", "gravity").round(2).tolist()
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
            from ..mechanics.algorithms.recursion import armature_forces

            apart["armature"] = armature_forces(self.model, dq, ddq)
        if friction and self.model.friction.any:
            apart["friction"] = self.friction_forces(dq, load=tau)
        from ..compiler.lowering.reference_interpreter import NumpyKernel
        from .explanation import explained

        # evaluated rarely: compiling it would take a second
        Y = self.engine.cached("regressor on NumPy", lambda: NumpyKernel(self.program("regressor"), "regressor", ""))
        return explained(self.model, Y, (q, dq, ddq), apart)

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
        from ..mechanics.algorithms.inverse_dynamics import closed_form

        return closed_form(self.model, q, dq, wrenches)


complete(globals())
