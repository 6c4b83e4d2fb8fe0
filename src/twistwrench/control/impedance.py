"""Impedance control: a frame that yields like a mass on a spring and a damper. Modern Robotics section 11.7.1."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ValueRangeError
from ..typing import Array
from .control_arguments import gain, one_state
from .task_space_control import TaskLaw, TaskState

Measured = Callable[[float, Array, Array], ArrayLike]
"""Of the time [s], q (nq,) and dq (nv,)."""


@dataclass(frozen=True, eq=False)
class Impedance(TaskLaw):
    """Impedance control: K X_e + B V_e pulls the frame back; under a wrench F on it, it rests where K X_e = -F.

    Without ``mass`` the frame keeps the robot's inertia, Λ dV_e/dt + B V_e + K X_e = -F, and nothing need be measured.
    With it, M_d dV_e/dt + B V_e + K X_e = -F, and the law has to know F. V_e is that of the reference less that of the
    frame, and F what the chosen rows feel, Λ J M⁻¹ τ_ext.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError, FrameError
        An argument is invalid, or the robot has no such frame or row.

    Notes
    -----
    MR section 11.7.1.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, q = tw.robots.planar_3r(), np.array([-0.6, 0.2, 2.2])
    >>> soft = Impedance(arm, arm.forward_kinematics(q), stiffness=500.0, damping=60.0, rows="vx vz", posture=q)
    >>> bool(np.allclose(soft(0.0, q, [0, 0, 0]), arm.gravity_forces(q)))
    True
    """

    stiffness: ArrayLike
    """K [N m/rad, N/m]: a number, (r,), or (r, r)."""
    damping: ArrayLike
    """B [N m s/rad, N s/m]: the same."""
    mass: ArrayLike | None = field(default=None, kw_only=True)
    """M_d [kg m², kg]: the same; None: the robot's own."""
    wrench_on_robot: Measured | None = field(default=None, kw_only=True)
    """F as a function of (t, q, dq): what the world does there, (m, f) in the frame [N m, N], from a sensor or a
    :class:`MomentumObserver`."""
    _stiffness: Array = field(init=False, repr=False)
    _damping: Array = field(init=False, repr=False)
    _inverse_mass: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("stiffness", "damping"):
            object.__setattr__(self, f"_{name}", gain(getattr(self, name), f"Impedance: {name}", self.row_names))
        if (self.mass is None) != (self.wrench_on_robot is None):
            raise ValueRangeError(
                "Impedance: mass and wrench_on_robot go together, as a frame takes on another mass only where the wrench on it "
                "is known. Give both, or neither for the robot's own inertia."
            )
        if self.mass is not None:
            mass = gain(self.mass, "Impedance: mass", self.row_names, definite=True)
            object.__setattr__(self, "_inverse_mass", np.linalg.inv(mass))
            if not callable(self.wrench_on_robot):
                raise ValueRangeError(
                    "Impedance: wrench_on_robot is a function of (t, q, dq) that gives (m, f) in the frame."
                )

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        now = self.task(t, q, dq)
        pull = self._stiffness @ now.error + self._damping @ now.error_rate
        if self.wrench_on_robot is None:
            return self._torques(t, q, dq, now, now.Lambda @ now.feedforward + pull)
        measured = self.wrench_on_robot(t, *one_state(self.robot, "Impedance", q, dq))
        F = self._felt(q, arguments.one(measured, f"wrench_on_robot of Impedance at t = {printed(t)} s", 6), now)
        a = now.feedforward + self._inverse_mass @ (pull + F)
        return self._torques(t, q, dq, now, now.Lambda @ a - F)

    def _felt(self, q: ArrayLike, F: Array, now: TaskState) -> Array:
        """Λ J M⁻¹ τ_ext: the chosen entries of F, if its others are zero or no row is left out."""
        pushed = self.robot.wrench_torques(q, F, self.frame)
        return now.Lambda @ now.J @ np.linalg.solve(self.robot.mass_matrix(q), pushed)
