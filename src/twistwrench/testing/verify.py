"""Verification of a robot's dynamics by laws of mechanics, by the algorithms on floats, and by another library.

Residuals are relative by norm: the largest difference over the largest entry of the compared quantity, worst case over
all states. Numerical derivatives are accurate to about 1e-12 of the differentiated function.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.answers.answer import Answer
from ..core.errors import TwistWrenchError
from ..core.verdict import Verdict, Word
from ..robot import Robot, load
from ..robot.base import require_robot
from .laws import LAWS, ROUNDING, Residual
from .peers import PEERS, file_gap
from .random_robots import State, random_state

if TYPE_CHECKING:
    from ..core.answers.blocks import Block

__all__ = ["Check", "VerifyReport", "verify"]

_GAP_FACTOR = 100.0
"""Residual allowed for each unit of the difference between a robot's rotations and those of its file."""


@dataclass(frozen=True)
class Check:
    """Check of a robot's dynamics: compared quantities, residual and tolerance."""

    name: str
    """Name of the check."""
    compares: str
    """Both sides of the comparison, as text."""
    residual: float = np.nan
    """Largest relative difference over all states."""
    tolerance: float = ROUNDING
    """Largest residual that passes."""
    skipped: str = ""
    """Reason for skipping the check; empty if it was made."""

    @property
    def passed(self) -> bool:
        """True if the check was made and agreed."""
        return not self.skipped and bool(self.residual <= self.tolerance)

    @property
    def failed(self) -> bool:
        """True if the check was made and disagreed; a residual of NaN disagrees."""
        return not self.skipped and not self.passed


@dataclass(frozen=True, eq=False, repr=False)
class VerifyReport(Answer):
    """Report of :func:`verify` on one robot: OK, or LOOK AGAIN if a check disagrees.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.verify(tw.robots.planar_2r(), states=2).verdict.ok
    True
    """

    call = "verify"

    robot: str
    """Name of the robot."""
    states: int
    """Number of random states."""
    seed: int
    """Seed of the random states."""
    checks: tuple[Check, ...]
    """One entry per check."""

    @property
    def passed(self) -> bool:
        """True if no check failed; skipped checks do not count."""
        return not any(check.failed for check in self.checks)

    @property
    def verdict(self) -> Verdict:
        """OK, or LOOK AGAIN with the checks that disagree."""
        failed_names = [check.name for check in self.checks if check.failed]
        if failed_names:
            return Verdict(Word.LOOK_AGAIN, (f"checks that disagree: {', '.join(failed_names)}",))
        return Verdict(Word.OK)

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    def blocks(self) -> Iterator[Block]:
        """Verdict, and a table of the checks.

        Returns
        -------
        blocks : iterator of Block
        """
        from .verify_view import verification_view

        return verification_view(self)


def verify(robot: Robot | str | Path, states: int = 4, seed: int = 0) -> VerifyReport:
    """Compare the robot's dynamics with independent formulas and, if installed, with Pinocchio or MuJoCo on its file.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    states : int
        Number of random states.
    seed : int
        Seed of the random states.

    Returns
    -------
    report : VerifyReport; skipped checks give their reason, and no check raises an error

    Examples
    --------
    >>> import twistwrench as tw
    >>> verify(tw.robots.planar_2r(), states=2).passed
    True
    """
    if isinstance(robot, str | Path):
        robot = load(robot)
    robot = require_robot(robot, "verify")
    rng = np.random.default_rng(seed)
    random_states = [random_state(robot, rng) for _ in range(max(states, 1))]
    checks: list[Check] = []
    for name, compares, tolerance, residual in LAWS:
        checks.append(_check(robot, random_states, name, compares, tolerance, residual))
    for library, residual_from_file in PEERS:
        compares = f"inverse dynamics and mass matrix, {library}'s"
        try:
            # Loading makes rotations of nine digits exact. This difference to the file is not a dynamics error.
            tolerance = ROUNDING + _GAP_FACTOR * file_gap(robot)
            residual = residual_from_file(robot)
            checks.append(_check(robot, random_states, library, compares, tolerance, residual))
        except TwistWrenchError as problem:
            checks.append(Check(library, compares, skipped=str(problem)))
    return VerifyReport(robot.name, len(random_states), seed, tuple(checks))


def _check(
    robot: Robot, random_states: list[State], name: str, compares: str, tolerance: float, residual: Residual
) -> Check:
    """Check by the largest residual over the states; skipped if the residual cannot be evaluated."""
    if robot.nv == 0:
        return Check(name, compares, skipped="the robot has no moving joints")
    try:
        largest_residual = float(np.max([residual(robot, state) for state in random_states]))
    except (TwistWrenchError, ArithmeticError, np.linalg.LinAlgError) as problem:
        return Check(name, compares, skipped=str(problem))
    return Check(name, compares, largest_residual, tolerance)
