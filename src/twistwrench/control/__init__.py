"""Controllers: laws of (t, q, dq) that return torques, each a few lines on :class:`~twistwrench.Robot`. MR chapter 11.

``robot.simulate(controller=law)`` closes the loop with a zero-order hold of the torques, ``tau=law`` without one.
"""

from __future__ import annotations

from .hybrid_motion_force import HybridMotionForce
from .impedance import Impedance
from .joint_space import PD, ComputedTorque
from .observer import ContactWrench, MomentumObserver
from .references import PoseMotion
from .residual_threshold import ResidualThreshold
from .task_space import TaskSpace

__all__ = [
    "PD",
    "ComputedTorque",
    "ContactWrench",
    "HybridMotionForce",
    "Impedance",
    "MomentumObserver",
    "PoseMotion",
    "ResidualThreshold",
    "TaskSpace",
]
