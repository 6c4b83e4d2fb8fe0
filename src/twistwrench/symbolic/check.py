"""Every derivation against Newton and Euler, whose recursions it does not use, at random states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import printed, residual
from ..errors import KernelError
from ..typing import Array
from .equations import Equations
from .evaluation import Evaluator
from .generalized_coordinates import to_robot

if TYPE_CHECKING:
    from ..robot import Robot

TOLERANCE = 1e-12
"""Of the largest torque, mass or force at the states. Both sides round some hundred sums of order-one terms."""

_STATES, _SEED = 16, 8100


@dataclass(frozen=True)
class DerivationCheck:
    """Check of a derivation: how far it is from the compiled kernels, relative to the largest entry of each quantity."""

    inverse_dynamics: float
    """Residual of τ."""
    mass_matrix: float
    """Residual of M."""
    coriolis_forces: float
    """Residual of c."""
    gravity_forces: float
    """Residual of g."""
    states: int
    """How many random states were compared."""

    @property
    def worst(self) -> float:
        """The largest of the residuals."""
        return max(self.inverse_dynamics, self.mass_matrix, self.coriolis_forces, self.gravity_forces)

    def __str__(self) -> str:
        return (
            f"checked against Newton–Euler at {self.states} random states: τ to {residual(self.inverse_dynamics)}, "
            f"M to {residual(self.mass_matrix)}, c to {residual(self.coriolis_forces)}, g to "
            f"{residual(self.gravity_forces)} of the largest entry"
        )


def checked(equations: Equations, robot: Robot) -> DerivationCheck:
    """Compare; :class:`~twistwrench.KernelError` if the two sides disagree, for then one of them is wrong."""
    n, rng = robot.nv, np.random.default_rng(_SEED)
    u, du, ddu = (
        rng.uniform(-1.5, 1.5, (_STATES, n)),
        rng.standard_normal((_STATES, n)),
        rng.standard_normal((_STATES, n)),
    )
    found = Evaluator.at(equations, u, du, ddu)
    wanted: dict[str, list[Array]] = {
        name: [] for name in ("inverse_dynamics", "mass_matrix", "coriolis_forces", "gravity_forces")
    }
    at_rest = np.zeros(n)

    def still(q: Array) -> Array:  # springs hold against what gravity alone does not
        return robot.bias_forces(q, at_rest) if robot.model.springs else robot.gravity_forces(q)

    for x, dx, ddx in zip(u, du, ddu, strict=True):
        q, dq, ddq, N = to_robot(robot.model, x, dx, ddx)
        bias = ddq - N @ ddx  # dN/dt du: what the coordinates alone put into c
        M = robot.mass_matrix(q)
        wanted["inverse_dynamics"].append(N.T @ robot.inverse_dynamics(q, dq, ddq))
        wanted["mass_matrix"].append(N.T @ M @ N)
        wanted["coriolis_forces"].append(N.T @ (robot.coriolis_forces(q, dq) + M @ bias))
        wanted["gravity_forces"].append(N.T @ still(q))
    torque = np.abs(wanted["inverse_dynamics"]).max()
    gaps = {}
    for name, rows in wanted.items():
        exprs = equations.tau if name == "inverse_dynamics" else getattr(equations, name)
        mine = found.array(exprs, (_STATES,)).reshape(np.shape(rows))
        scale = np.abs(rows).max() if name == "mass_matrix" else torque
        gaps[name] = float(np.abs(mine - rows).max() / scale) if scale else float(np.abs(mine).max())
    check = DerivationCheck(**gaps, states=_STATES)
    if not check.worst <= TOLERANCE:
        raise KernelError(
            f"the derivation of {robot.name!r} disagrees with Newton–Euler by {residual(check.worst)} "
            f"(allowed {printed(TOLERANCE)}): {gaps}. "
            "Please report this robot with its file."
        )
    return check
