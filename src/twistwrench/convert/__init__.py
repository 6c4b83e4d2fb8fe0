"""States in the words of other libraries: the orders, signs and frames of Pinocchio, MuJoCo and Drake; SciPy's quaternions.

Joints are matched by name, so the other library must have read the same file. Theirs marked with a star, there is one
matrix P for each library with

    dq* = P dq        and so        τ = P' τ*,    M = P' M* P,    J = J* P.

Where a joint mimics another here and is independent there, P has a row for it all the same.

Pinocchio: children of one link in alphabetical order; floating joints ``(x, y, z, qx, qy, qz, qw)`` and body twists
``(v, omega)``; unbounded angles as (cos, sin). MuJoCo: children in document order; floating joints
``(x, y, z, qw, qx, qy, qz)``, their velocity the origin's along world axes, then omega in the body. Drake: its joints say where
they begin; velocities of ball, planar and floating joints along the parent's axes, ball joints as roll, pitch, yaw.
"""

from __future__ import annotations

from .drake_order import drake_rates, from_drake, to_drake
from .halves import swap_halves
from .mujoco_order import from_mujoco, mujoco_rates, to_mujoco
from .pinocchio_order import from_pinocchio, pinocchio_rates, to_pinocchio
from .scipy_order import from_scipy_quaternion, to_scipy_quaternion

__all__ = [
    "drake_rates",
    "from_drake",
    "from_mujoco",
    "from_pinocchio",
    "from_scipy_quaternion",
    "mujoco_rates",
    "pinocchio_rates",
    "swap_halves",
    "to_drake",
    "to_mujoco",
    "to_pinocchio",
    "to_scipy_quaternion",
]
