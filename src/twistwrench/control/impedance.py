"""Impedance control: mass, spring and damper at a frame. Modern Robotics section 11.7.1."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.typing import Array
from .references import Measured, gain, one_state, set_gains
from .task_space import TaskLaw


@dataclass(frozen=True, eq=False)
class Impedance(TaskLaw):
    """Impedance control (MR section 11.7.1): spring K X_e and damper B V_e. At rest under a wrench F, K X_e = -F.

    Without ``mass``, the frame keeps the robot's inertia: Λ dV_e/dt + B V_e + K X_e = -F. No measurement is needed.
    With ``mass``, M_d dV_e/dt + B V_e + K X_e = -F. The law then needs a measurement of F. V_e is the twist of the
    reference minus the twist of the frame, and F = Λ J M⁻¹ τ_ext is the force on the selected rows.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, q = tw.robots.planar_3r(), np.array([-0.6, 0.2, 2.2])
    >>> soft = Impedance(arm, arm.forward_kinematics(q), stiffness=500.0, damping=60.0, rows="vx vz", posture=q)
    >>> bool(np.allclose(soft(0.0, q, [0, 0, 0]), arm.gravity_forces(q)))
    True
    """

    stiffness: ArrayLike
    """K [N m/rad, N/m]: scalar, (r,), or (r, r)."""
    damping: ArrayLike
    """B [N m s/rad, N s/m]: scalar, (r,), or (r, r)."""
    mass: ArrayLike | None = field(default=None, kw_only=True)
    """M_d [kg m², kg]: scalar, (r,), or (r, r); None: the robot's inertia."""
    wrench_on_robot: Measured | None = field(default=None, kw_only=True)
    """Function of (t, q, dq) that returns the wrench of the world on the frame, (m, f) in the frame [N m, N].

    It may read a sensor or a :class:`MomentumObserver`."""
    _stiffness: Array = field(init=False, repr=False)
    _damping: Array = field(init=False, repr=False)
    _inverse_mass: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_gains(self, self.row_names, "stiffness", "damping")
        lacks_one_of_both = (self.mass is None) != (self.wrench_on_robot is None)
        if lacks_one_of_both:
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
        task = self.task(t, q, dq)
        spring_and_damper = self._stiffness @ task.error + self._damping @ task.error_rate  # K X_e + B V_e
        if self.wrench_on_robot is None:
            force = task.Lambda @ task.feedforward + spring_and_damper
            return self._torques(t, q, dq, task, force)
        one_q, one_dq = one_state(self.robot, "Impedance", q, dq)
        measured = self.wrench_on_robot(t, one_q, one_dq)
        wrench = arguments.one(measured, f"wrench_on_robot of Impedance at t = {printed(t)} s", 6)
        external_torques = self.robot.wrench_torques(q, wrench, self.frame)
        external_acceleration = np.linalg.solve(self.robot.mass_matrix(q), external_torques)  # M⁻¹ τ_ext
        F = task.Lambda @ task.J @ external_acceleration  # exact if all rows are selected, or other rows are zero
        desired_acceleration = task.feedforward + self._inverse_mass @ (spring_and_damper + F)
        force = task.Lambda @ desired_acceleration - F
        return self._torques(t, q, dq, task, force)


complete(globals())
