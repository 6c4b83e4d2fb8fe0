"""Hybrid motion–force control of a constrained robot. Modern Robotics section 11.6."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.typing import Array
from ..robot import Robot
from .references import Measured, one_state, set_gains

if TYPE_CHECKING:
    from ..robot.doors import ConstrainedRobot

# With the projector P of section 8.7, torques split into P τ, which moves the robot, and (1 - P) τ, which acts against
# the constraints. A motion law determines the first part, the desired force the second:
#
#     τ = P (τ_motion - h) + h + A'(λ_cmd - (A M⁻¹ A')⁻¹ dA/dt dq),     λ_cmd = λ_d + K_f (λ_d - λ),
#
# so that A θ̈ + dA/dt dq = 0 with λ = λ_cmd, for any output of the motion law along A. As λ in
# :mod:`twistwrench.robot.constraints.projections`, λ_d is exerted by the robot on its constraints.

Law = Callable[[float, Array, Array], ArrayLike]
"""Function of (t, q, dq) that returns torques."""


@dataclass(frozen=True, eq=False)
class HybridMotionForce:
    """Hybrid motion-force control: a motion law in the free directions, λ_d in the constrained ones. MR section 11.6.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_3r()
    >>> wall = arm.close("ground", arm.tip, rows="vx", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
    >>> q = wall.consistent([-0.6, 0.2, 2.2])
    >>> press = HybridMotionForce(wall, tw.control.PD(arm, q, kp=100.0, kd=20.0), force=[12.0])
    >>> wall.forward_dynamics(q, [0, 0, 0], press(0.0, q, [0, 0, 0])).lam.round(9).tolist()
    [12.0]
    """

    closed: ConstrainedRobot
    """Robot with the constraint: ``robot.close("ground", tip, rows="vx", …)`` for a wall normal to x."""
    motion: Law
    """Any law of (t, q, dq) with torques for the open robot, such as :class:`TaskSpace`."""
    force: ArrayLike | Callable[[float], ArrayLike]
    """λ_d (k,) [N m, N], in the order of ``closed.row_names``, or a function of the time."""
    force_gain: ArrayLike = field(default=0.0, kw_only=True)
    """K_f: scalar, (k,), or (k, k); dimensionless."""
    measured: Measured | None = field(default=None, kw_only=True)
    """Measured λ (k,) as a function of (t, q, dq), exerted by the robot."""
    _force_gain: Array = field(init=False, repr=False)
    _force: Callable[[float], ArrayLike] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.closed, Robot) or not self.closed.constraints:
            raise ValueRangeError(
                f"HybridMotionForce: the first argument is a closed robot, got {type(self.closed).__name__}. Say what "
                "holds it: robot.close('ground', tip, rows='vx', pose=…)."
            )
        names = self.closed.row_names
        if not callable(self.motion):
            raise ValueRangeError(
                f"HybridMotionForce: motion is {arguments.value_text(self.motion)}, and must be a law of (t, q, dq)."
            )
        force = self.force
        if not callable(force):
            argument_name = f"HybridMotionForce: force (one for each of {', '.join(names)})"
            row_count = len(names)
            one_force = arguments.one(force, argument_name, row_count)
            constant_force = np.array(arguments.finite(one_force, argument_name, row_count))
            force = lambda _t: constant_force  # noqa: E731
        object.__setattr__(self, "_force", force)
        set_gains(self, names, "force_gain")
        has_gain = bool(np.any(self._force_gain))
        has_measurement = self.measured is not None
        if has_gain != has_measurement:
            raise ValueRangeError("HybridMotionForce: force_gain acts on λ_d - λ, so it and measured go together.")
        if self.measured is not None and not callable(self.measured):
            raise ValueRangeError(
                "HybridMotionForce: measured is a function of (t, q, dq) that gives λ (k,), from a sensor."
            )

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """Torques τ (nv,)."""
        closed = self.closed
        robot = closed.open()
        q, dq = one_state(robot, "HybridMotionForce", q, dq)
        row_count = len(closed.sizes)
        source = f"of HybridMotionForce at t = {printed(t)} s"  # for errors
        tau_motion = arguments.one(self.motion(t, q, dq), f"motion {source}", robot.nv)
        free_ddq = robot.forward_dynamics(q, dq, tau_motion)
        ddq = closed.project_acceleration(q, dq, free_ddq)  # M ddq = P (τ_motion - h) - A'(A M⁻¹ A')⁻¹ dA/dt dq
        lam = arguments.one(self._force(t), f"force {source}", row_count)
        if self.measured is not None:
            measured_lam = arguments.one(self.measured(t, q, dq), f"measured {source}", row_count)
            lam = lam + self._force_gain @ (lam - measured_lam)
        return robot.inverse_dynamics(q, dq, ddq) + closed.constraint_jacobian(q).T @ lam


complete(globals())
