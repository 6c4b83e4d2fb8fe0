"""Hybrid motion–force control of a robot that is held: motion where it is free, force where it is not. MR section 11.6.

With the projector P of section 8.7, torques split into P τ, which moves the robot, and (1 - P) τ, which presses on what holds
it. A motion law gives the first part, the force that is wanted the second:

    τ = P (τ_motion - h) + h + A'(λ_cmd - (A M⁻¹ A')⁻¹ dA/dt dq),     λ_cmd = λ_d + K_f (λ_d - λ),

so that A θ̈ + dA/dt dq = 0 with λ = λ_cmd, whatever the motion law asks for along A. As λ in the equations of
:mod:`twistwrench.robot.closed_robot`, λ_d is what the robot applies where it is held.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ValueRangeError
from ..robot.closed_robot import ClosedRobot
from ..typing import Array
from .control_arguments import gain, one_state
from .impedance import Measured

Law = Callable[[float, Array, Array], ArrayLike]


@dataclass(frozen=True, eq=False)
class HybridMotionForce:
    """Hybrid motion-force control: follows a motion law in the free directions, and presses with λ_d in the others.

    Raises
    ------
    ShapeError, ValueRangeError
        A force or a gain is of another size or not finite.

    Notes
    -----
    MR section 11.6.

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

    closed: ClosedRobot
    """What holds the robot: ``robot.close("ground", tip, rows="vx", …)`` for a wall across x."""
    motion: Law
    """Any law of (t, q, dq) with torques for the open robot, such as :class:`TaskSpace`."""
    force: ArrayLike | Callable[[float], ArrayLike]
    """λ_d (k,) [N m, N], in the order of ``closed.row_names``, or a function of the time."""
    force_gain: ArrayLike = field(default=0.0, kw_only=True)
    """K_f: a number, (k,), or (k, k), of no unit."""
    measured: Measured | None = field(default=None, kw_only=True)
    """λ (k,) as a function of (t, q, dq), from a sensor: what the robot applies."""
    _gain: Array = field(init=False, repr=False)
    _force: Callable[[float], ArrayLike] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.closed, ClosedRobot):
            raise ValueRangeError(
                f"HybridMotionForce: the first argument is a closed robot, got {type(self.closed).__name__}. Say what "
                "holds it: robot.close('ground', tip, rows='vx', pose=…)."
            )
        names = self.closed.row_names
        if not names:
            raise ValueRangeError(
                "HybridMotionForce: this robot is held nowhere. Close it: robot.close('ground', tip, rows=…)."
            )
        if not callable(self.motion):
            raise ValueRangeError(f"HybridMotionForce: motion is {self.motion!r}, and must be a law of (t, q, dq).")
        k, force = len(names), self.force
        if callable(force):
            object.__setattr__(self, "_force", force)
        else:
            what = f"HybridMotionForce: force (one for each of {', '.join(names)})"
            constant = np.array(arguments.finite(arguments.one(force, what, k), what, k))
            object.__setattr__(self, "_force", lambda _t: constant)
        object.__setattr__(self, "_gain", gain(self.force_gain, "HybridMotionForce: force_gain", names))
        if (self.measured is None) != (not np.any(self._gain)):
            raise ValueRangeError("HybridMotionForce: force_gain acts on λ_d - λ, so it and measured go together.")
        if self.measured is not None and not callable(self.measured):
            raise ValueRangeError(
                "HybridMotionForce: measured is a function of (t, q, dq) that gives λ (k,), from a sensor."
            )

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        closed, robot = self.closed, self.closed.robot
        q, dq = one_state(robot, "HybridMotionForce", q, dq)
        tau = arguments.one(self.motion(t, q, dq), f"motion of HybridMotionForce at t = {printed(t)} s", robot.nv)
        free = robot.forward_dynamics(q, dq, tau)
        ddq = closed.project_acceleration(q, dq, free)  # M ddq = P (τ - h) - A'(A M⁻¹ A')⁻¹ dA/dt dq
        pressed = closed.constraint_jacobian(q).T @ self._commanded(t, q, dq)
        return robot.inverse_dynamics(q, dq, ddq) + pressed

    def _commanded(self, t: float, q: Array, dq: Array) -> Array:
        """λ_d + K_f (λ_d - λ)."""
        k = len(self.closed.sizes)
        lam = arguments.one(self._force(t), f"force of HybridMotionForce at t = {printed(t)} s", k)
        if self.measured is None:
            return lam
        felt = arguments.one(self.measured(t, q, dq), f"measured of HybridMotionForce at t = {printed(t)} s", k)
        return lam + self._gain @ (lam - felt)
