"""Checking a robot's dynamics by what knows nothing of the code that computes it: laws, closed forms, other libraries.

Residuals are relative by norm: the largest difference over the largest entry of what is compared, worst of all states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import laws
from .convert import mujoco_rates, pinocchio_rates, to_mujoco, to_pinocchio
from .errors import TwistWrenchError
from .peers import file_gap, mujoco_model, pinocchio_model
from .robot import Robot
from .testing import State, random_state, relative_gap
from .typing import Array

Residual = Callable[[Robot, State], float]

__all__ = ["Check", "VerifyReport", "verify"]

ROUNDING = 1e-10
"""Two ways of computing one thing in float64: some thousand operations each, 1e-16 apart, and room for cancellation."""
DIFFERENCES = 1e-9
"""Where one side is a derivative by differences, good to some 1e-12 of what is differentiated."""


@dataclass(frozen=True)
class Check:
    """Check of a robot's dynamics: what was compared, how far apart it was and might be."""

    name: str
    """Of the check."""
    compares: str
    """What is compared, in words."""
    residual: float = np.nan
    """The largest relative difference of all states."""
    tolerance: float = ROUNDING
    """The largest that is allowed."""
    skipped: str = ""
    """Why nothing was compared; empty if it was."""

    @property
    def passed(self) -> bool:
        """Whether the check was done and agreed."""
        return not self.skipped and bool(self.residual <= self.tolerance)

    @property
    def failed(self) -> bool:
        """Whether the check was done and disagreed; a residual that is no number disagrees."""
        return not self.skipped and not self.passed


@dataclass(frozen=True)
class VerifyReport:
    """Report of :func:`verify` on one robot."""

    robot: str
    """The robot's name."""
    states: int
    """How many random states."""
    seed: int
    """Of the random states."""
    checks: tuple[Check, ...]
    """The rows."""

    @property
    def passed(self) -> bool:
        """Whether no check failed; skipped ones do not count."""
        return not any(check.failed for check in self.checks)


def verify(robot: Robot, states: int = 4, seed: int = 0) -> VerifyReport:
    """Compare the robot's dynamics with independent formulas, and with Pinocchio and MuJoCo where they are installed.

    Parameters
    ----------
    robot : Robot
    states : int, how many random states
    seed : int, of the random states

    Returns
    -------
    report : VerifyReport; a check that cannot be done is a row that says why, nothing is raised

    Examples
    --------
    >>> import twistwrench as tw
    >>> verify(tw.robots.planar_2r(), states=2).passed
    True
    """
    rng = np.random.default_rng(seed)
    motions = [random_state(robot, rng) for _ in range(max(states, 1))]
    checks = [_check(robot, motions, *row) for row in _LAWS]
    checks += [_check_peer(robot, motions, *row) for row in _PEERS]
    return VerifyReport(robot.name, len(motions), seed, tuple(checks))


def _check(robot: Robot, motions: list[State], name: str, compares: str, tolerance: float, residual: Residual) -> Check:
    if robot.nv == 0:
        return Check(name, compares, skipped="the robot has no moving joints")
    try:
        worst = float(np.max([residual(robot, at) for at in motions]))
    except (TwistWrenchError, ArithmeticError, np.linalg.LinAlgError) as problem:
        return Check(name, compares, skipped=str(problem))
    return Check(name, compares, worst, tolerance)


def _check_peer(robot: Robot, motions: list[State], name: str, prepare: Callable[[Robot], Residual]) -> Check:
    compares = f"inverse dynamics and mass matrix, {name}'s"
    try:
        # What the file says to nine digits and loading made exact is a difference no dynamics can be blamed for.
        tolerance = ROUNDING + 100.0 * file_gap(robot)
        residual = prepare(robot)
    except TwistWrenchError as problem:
        return Check(name, compares, skipped=str(problem))
    return _check(robot, motions, name, compares, tolerance, residual)


def _compiled(robot: Robot, at: State) -> float:
    return _against(robot, at, robot.reference("inverse_dynamics", *at), robot.reference("mass_matrix", at.q))


def _pinocchio(robot: Robot) -> Residual:
    model = pinocchio_model(robot)
    import pinocchio

    data, P = model.createData(), pinocchio_rates(robot, model)

    def residual(robot: Robot, at: State) -> float:
        q, dq, ddq = to_pinocchio(robot, model, *at)
        M = np.triu(pinocchio.crba(model, data, q))  # it promises the upper triangle only
        M = M + np.triu(M, 1).T
        return _against(robot, at, P.T @ pinocchio.rnea(model, data, q, dq, ddq), P.T @ M @ P)

    return residual


def _mujoco(robot: Robot) -> Residual:
    model = mujoco_model(robot)
    import mujoco

    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco_rates(robot, model, robot.neutral)  # says now whether the joints match

    def residual(robot: Robot, at: State) -> float:
        data.qpos[:], data.qvel[:], data.qacc[:] = to_mujoco(robot, model, *at)
        P = mujoco_rates(robot, model, at.q)
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, M)
        return _against(robot, at, P.T @ data.qfrc_inverse, P.T @ M @ P)

    return residual


def _against(robot: Robot, at: State, tau: Array, M: Array) -> float:
    size = laws.torque_size(robot, at, tau)
    return max(relative_gap(robot.inverse_dynamics(*at), tau, size), relative_gap(robot.mass_matrix(at.q), M))


_LAWS: tuple[tuple[str, str, float, Residual], ...] = (
    ("closed form", "inverse dynamics, block matrices of MR section 8.4", ROUNDING, laws.closed_form_gap),
    ("energies", "inverse dynamics, Lagrange's equations from K and P", DIFFERENCES, laws.lagrange_gap),
    ("power", "torques times velocities, rate of K + P", DIFFERENCES, laws.power_gap),
    ("Ṁ − 2C skew", "Coriolis matrix, rate of the mass matrix", DIFFERENCES, laws.skewness_gap),
    ("C dq = c", "Coriolis matrix, inverse dynamics", ROUNDING, laws.coriolis_gap),
    ("forward∘inverse", "forward dynamics, inverse dynamics", ROUNDING, laws.round_trip_gap),
    ("compiled", "kernels, the algorithms on plain floats", ROUNDING, _compiled),
)
_PEERS: tuple[tuple[str, Callable[[Robot], Residual]], ...] = (("Pinocchio", _pinocchio), ("MuJoCo", _mujoco))
