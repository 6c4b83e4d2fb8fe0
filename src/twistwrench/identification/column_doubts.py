"""Doubts about columns of a log: dead, cut off, coarse, of the wrong sign or unit, exchanged."""

from __future__ import annotations

import numpy as np

from ..core.printed_numbers import number, percent, printed
from ..motion.log_noise import quantum
from ..typing import Array
from .evidence import Evidence, LogDoubt
from .normal_equations import NormalEquations
from .parameter_groups import BaseParameters
from .setting_trial import FOLDS

_SATURATED, _SATURATED_ROWS = 0.02, 30
_LEAST_GAIN, _MOST_GAIN, _OF_LIMIT = 0.1, 30.0, 1.0
"""Times the file's bodies that no torque is below, nor above if it is also beyond the joint's limit: a payload at a light wrist
makes twenty times what its links do."""
_STATES = 200
_TOLD = 0.5
"""Share of |residual|² that friction alone leaves, which the file's bodies have to take it below for a gain to say anything."""
_EXCHANGED, _SURELY_EXCHANGED, _GAINED = 0.5, 0.3, 0.7
"""Shares of |residual|² that another column's is below: by the file's bodies, and by any; and log of what all gain."""
_COARSE = 0.15


def column_doubts(seen: Evidence) -> list[LogDoubt]:
    """All of them; gains of columns that are exchanged say nothing."""
    exchanged = _exchanged(seen)
    return [
        *_dead(seen),
        *_saturated(seen),
        *_coarse(seen),
        *(exchanged or ([] if seen.payload_only else _gains(seen))),
    ]


def _dead(seen: Evidence) -> list[LogDoubt]:
    found = []
    names = [n for n, d in zip(seen.names, seen.dead, strict=True) if d]
    if names:
        found.append(
            LogDoubt(
                "dead-torque",
                f"the torque of {', '.join(names)} is one number in nearly all rows: nothing is measured there. What only "
                "these joints feel keeps the file's values.",
                tuple(names),
            )
        )
    still = [
        n
        for k, n in enumerate(seen.names)
        if not seen.dead[k] and all(np.ptp(motion.q[:, k]) == 0 for motion in seen.motions)
    ]
    if still:
        found.append(
            LogDoubt(
                "dead-position",
                f"the position of {', '.join(still)} is one number throughout: it did not move, or its channel is dead. Its "
                "friction and its motor's inertia cannot be told.",
                tuple(still),
            )
        )
    return found


def _saturated(seen: Evidence) -> list[LogDoubt]:
    found = []
    for k, name in enumerate(seen.names):
        if seen.dead[k]:
            continue
        tau = np.concatenate([np.asarray(m.tau)[:, k] for m in seen.motions])
        for extreme in (float(tau.max()), float(tau.min())):
            count = int((tau == extreme).sum())
            if extreme != 0 and count >= _SATURATED_ROWS and count >= _SATURATED * len(tau):
                found.append(
                    LogDoubt(
                        "saturated",
                        f"the torque of {name} is exactly {number(extreme)} in {percent(count / len(tau), 3)} of the rows: it "
                        "is cut off there. Leave these rows out, or log what the motor really gives.",
                        (name,),
                    )
                )
                break
    return found


def _coarse(seen: Evidence) -> list[LogDoubt]:
    found, cutoff = [], seen.settings.cutoff
    for k, name in enumerate(seen.names):
        step = quantum([motion.q[:, k] for motion in seen.motions])
        size = float(np.sqrt((seen.acceleration[:, k] ** 2).mean()))
        # White noise of that size, below the cut-off, differentiated twice: sqrt(∫ (2 π f)^4 df) over 0 to the cut-off.
        noise = step / np.sqrt(12.0) * (2 * np.pi * cutoff) ** 2 * np.sqrt(2 * cutoff / seen.rate / 5.0)
        if step > 0 and size > 0 and noise > _COARSE * size:
            found.append(
                LogDoubt(
                    "quantised",
                    f"positions of {name} lie on a grid of {number(step, 3)}, which makes {percent(noise / size, 3)} of its "
                    f"accelerations below {printed(cutoff)} Hz noise. Log more digits, move faster, or lower the cut-off.",
                    (name,),
                )
            )
    return found


def _of_folds(seen: Evidence, columns: Array, tau: Array) -> tuple[Array, float]:
    """Coefficients of a torque ``tau`` (m,) in given columns (m, k), and |residual|² / |τ|² of fifths left out."""
    left = 0.0
    parts = [NormalEquations.of(columns[seen.fold == b, None, :], tau[seen.fold == b, None]) for b in range(FOLDS)]
    parts = [p for p in parts if p.rows]
    total = parts[0]
    for p in parts[1:]:
        total = total + p
    for p in parts:
        rest = total - p if len(parts) > 1 else total
        left += float(p.squares(least(rest))[0])
    return least(total), left / max(float((tau**2).sum()), 1e-300)


def _by_file(seen: Evidence, j: int, k: int) -> float:
    """|residual|² / |τ|² of torque k by the file's bodies at joint j and its drive."""
    own = [d for d in drive_places(seen.base) if seen.W[:, j, d].any()]
    columns = np.concatenate([_file_part(seen)[:, j, None], seen.W[:, j][:, own]], axis=1)
    return _of_folds(seen, columns, seen.tau[:, k])[1]


def least(equations: NormalEquations) -> Array:
    """Plain least squares in scaled columns; what they cannot tell is zero."""
    N, c = equations.N.sum(axis=0), equations.c.sum(axis=0)
    size = np.sqrt(np.maximum(N.diagonal(), 1e-300))
    scaled = N / size[:, None] / size[None, :]
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ (c / size) / size)


def drive_places(base: BaseParameters) -> Array:
    """Which of the kept parameters are drives'."""
    return np.flatnonzero(base.unknown.of_bodies[base.kept] < 0)


def _file_part(seen: Evidence) -> Array:
    """(m, nv) torques of the file's bodies, without drives, in the rows."""
    own = seen.base.project(seen.base.unknown.file_values)
    return np.asarray(seen.W @ own)


def _gains(seen: Evidence) -> list[LogDoubt]:
    """Columns whose size or sign no robot has. The file's bodies may be wrong by much, so that they alone accuse nothing."""
    found = []
    file, drives = _file_part(seen), drive_places(seen.base)
    limits = np.asarray(seen.base.unknown.model.limits.effort, float)
    for j, name in enumerate(seen.names):
        if seen.dead[j] or not file[:, j].any():
            continue
        own = [d for d in drives if seen.W[:, j, d].any()]
        others = seen.W[:, j][:, own]
        with_file = np.concatenate([file[:, j, None], others], axis=1)
        gains, left = _of_folds(seen, with_file, seen.tau[:, j])
        _, without = _of_folds(seen, others, seen.tau[:, j])
        gain = float(gains[0])
        if left > _TOLD * without:
            continue  # the file's bodies explain little of it either way
        if gain < 0 and _inertia(seen, j) < 0:
            found.append(
                LogDoubt(
                    "sign",
                    f"the torque of {name} has the wrong sign: {number(gain, 2)} times the file's rigid bodies with friction "
                    f"left free explain it, to {percent(np.sqrt(left), 3)}, and the joint's inertia comes out negative. Turn "
                    "its sign, or that of its position.",
                    (name,),
                    refuses=True,
                )
            )
        elif 0 < gain < _LEAST_GAIN or (gain > _MOST_GAIN and _largest(seen, j) > _OF_LIMIT * limits[j]):
            found.append(
                LogDoubt(
                    "gain",
                    f"the torque of {name} is {number(gain, 3)} times that of the file's rigid bodies, friction left free: it "
                    "is in another unit, before the gear, or a current.",
                    (name,),
                    refuses=True,
                )
            )
    return found


def _inertia(seen: Evidence, j: int) -> float:
    """Inertia about joint j that the groups make, mean over some states."""
    q = np.concatenate([motion.q for motion in seen.motions])
    q = q[:: max(1, len(q) // _STATES)]
    still, one = np.zeros((len(q), len(seen.names))), np.zeros((len(q), len(seen.names)))
    one[:, j] = 1.0
    moved, rest = (
        seen.base.unknown.columns(seen.base.kept, q, still, ddq, seen.settings.friction_speed)[:, j] @ seen.x
        for ddq in (one, still)
    )
    return float((moved - rest).mean())


def _largest(seen: Evidence, j: int) -> float:
    """Largest torque of joint j that was measured."""
    return max(float(np.abs(np.asarray(motion.tau)[:, j]).max()) for motion in seen.motions)


def _exchanged(seen: Evidence) -> list[LogDoubt]:
    """By predictions of every torque from every joint's columns; Kuhn and Munkres' assignment."""
    from scipy.optimize import linear_sum_assignment

    live = np.flatnonzero(~seen.dead)
    if len(live) < 2:
        return []
    left = np.ones((len(live), len(live)))
    for a, j in enumerate(live):
        felt = np.flatnonzero(seen.W[:, j].any(axis=0))
        for b, k in enumerate(live):
            left[a, b] = min(1.0, _of_folds(seen, seen.W[:, j][:, felt], seen.tau[:, k])[1])
    size = np.log(np.maximum(left, 1e-12))
    rows, columns = linear_sum_assignment(size)
    moved = [a for a in range(len(live)) if columns[a] != a]
    if not moved:
        return []
    wrong = [(int(live[a]), int(live[columns[a]])) for a in moved]
    own, best = np.diag(left), left[rows, columns]
    gained = float(np.log(own[moved] / best[moved]).sum())
    by_file = all(_by_file(seen, j, k) < _EXCHANGED * _by_file(seen, j, j) for j, k in wrong)
    if not ((best[moved] < _SURELY_EXCHANGED * own[moved]).all() or (gained > _GAINED and by_file)):
        return []
    pairs = ", ".join(f"the column of {seen.names[k]} fits {seen.names[j]}" for j, k in wrong)
    return [
        LogDoubt(
            "exchanged",
            f"torque columns seem to be exchanged: {pairs} (residual {percent(np.sqrt(float(best[moved].max())), 3)} in place "
            f"of {percent(np.sqrt(float(own[moved].min())), 3)} and more).",
            tuple(seen.names[j] for j, _ in wrong),
            refuses=True,
        )
    ]
