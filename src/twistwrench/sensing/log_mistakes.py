"""Slips in the making of a log, other than sign and mounting: what was given, swapped, upside down or left out."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np

from ..core.printed_numbers import number
from ..screws.component_names import WRENCH
from ..typing import Array
from .fit import Fit, Problem
from .log import ReadingLog
from .sensor import Sign
from .sign_and_mounting import Diagnosis, explain

MAY_POINT_UP = (
    "Or gx, gy, gz point up, as an accelerometer at rest logs them, which explains the log as well: "
    "then negate these three and keep the sign."
)
MAY_MOVE = (
    "It may be in motion: gravity turns steadily from reading to reading. Add columns wx, wy, wz, vx, vy, vz and their rates "
    "dwx, …, dvz, or keep only the readings at rest."
)
_SMOOTH = (1e-4, 0.2)  # rad from one reading to the next, of a log in motion
_ENOUGH = 10  # readings that show it
_SURE = 1e-4  # chance to prefer another bias by luck
_SWAP = [3, 4, 5, 0, 1, 2]


def free_bias(found: Diagnosis, problem: Problem) -> Diagnosis | None:
    """The log explained with a bias of its own, where the one given fits surely worse: an F test of the six."""
    if found.fit.unknowns.bias:
        return None
    from scipy import special

    free = explain(found.sign, problem.asked(bias=True))
    if free is None or free.mass <= 0:
        return None
    rows = free.kept & found.kept
    scale = np.maximum(free.fit.deviation[rows], 1e-12)
    least, more = (float(((e.fit.residuals[rows] / scale) ** 2).sum()) for e in (free, found))
    known = 6.0 * rows.sum() - len(free.fit.unknowns.names)
    limit = float(special.fdtri(6.0, max(known, 1.0), 1 - _SURE))
    return free if (more - least) / 6 > limit * max(least, 1e-9) / max(known, 1.0) else None


def swapped(problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """The log explained with forces and moments exchanged, if surely better ``than`` another explanation."""
    other = replace(problem.log, readings=problem.log.readings[:, _SWAP])
    noise = None if problem.noise is None else problem.noise[_SWAP]
    asked = replace(problem, log=other, bias=problem.bias[_SWAP], within=problem.within[_SWAP], noise=noise)
    tried = [explain(sign, asked.asked(turn=False)) for sign in get_args(Sign)]
    exchanged: Fit = replace(than.fit, residuals=than.fit.residuals[:, _SWAP])
    good = [e for e in tried if e is not None and e.mass > 0 and e.improves(exchanged)]
    return min(good, key=lambda e: e.left, default=None)


def upside_down(found: Diagnosis, problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """The log in motion explained with gravity the other way, if surely better; at rest that is the other sign."""
    log = problem.log
    if not log.by_gravity or log.V is None:
        return None
    other = explain(found.sign, replace(problem, log=replace(log, gravity=-log.gravity)))
    return other if other is not None and other.mass > 0 and other.improves(than.fit) else None


def may_point_up(log: ReadingLog, asked: str, best: Diagnosis) -> bool:
    """Whether gravity the other way explains a log exactly as well as the other sign does."""
    return log.by_gravity and log.V is None and best.sign != asked


def seems_moving(log: ReadingLog) -> bool:
    """Whether a log without twists turns steadily, as no tool does that is held still in some orientations."""
    if log.V is not None or len(log) < _ENOUGH:
        return False
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    step = np.linalg.norm(np.diff(unit, axis=0), axis=1)
    return bool(_SMOOTH[0] < np.median(step) and step.max() < _SMOOTH[1] and np.ptp(unit, axis=0).max() > _SMOOTH[1])


def listed_bias(bias: Array) -> str:
    """A bias (6,) by its axes."""
    return ", ".join(f"{axis} {number(value, 3)}" for axis, value in zip(WRENCH, bias, strict=True))
