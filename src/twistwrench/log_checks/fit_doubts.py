"""Checks of a log behind an identification: dead, saturated, swapped or mis-scaled columns, delay, excitation, residuals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.numbers import number, percent, plus_minus, printed
from ..estimation.cross_validation import FOLDS, HeldOut
from ..estimation.least_squares import NormalEquations, Prior
from ..model.model import BASE
from ..typing import Array
from .doubts import Doubt
from .noise import quantum
from .rate_checks import LEFT_OUT, SINGLE_ROW

if TYPE_CHECKING:
    from ..identification.hyperparameters import FitSettings
    from ..identification.parameters import BaseParameters
    from ..motion.motion import Motion

_UNEXPLAINED = 0.35
"""Share of the torques left in rows held out that refuses the logs."""
OTHERS, NOTABLE_IN_OTHERS = 2.5, 0.12
"""Ratio of the residual of other logs to that of the training logs, and least residual, from which the logs differ."""


_HARMLESS = ("velocity column", "acceleration column", "velocities make", SINGLE_ROW)
"""Words of contradictions that change nothing here: rates are derived from positions, and single rows hardly count."""


def contradiction(sentence: str, log: str = "") -> Doubt:
    """The doubt about columns of a log that contradict each other, as reading it found."""
    refuses = not any(word in sentence for word in _HARMLESS)
    return Doubt("contradiction", f"{log}: {sentence}" if log else sentence, level="refuse" if refuses else "unsure")


def left_unexplained(held: HeldOut, among: HeldOut) -> list[Doubt]:
    """Doubts from held-out residuals: too large, or those of other logs far larger than of the training logs ``among``."""
    if held.all > _UNEXPLAINED:
        said = (
            f"rigid bodies with friction leave {percent(held.all, 3)} of the torques unexplained in rows held out: these are "
            "no torques of this robot's joints, or positions are not theirs."
        )
        return [Doubt("unexplained", said, level="refuse")]
    if held.kind == "test" and held.all > max(OTHERS * among.all, NOTABLE_IN_OTHERS):
        said = (
            f"the logs held out are explained to {percent(held.all, 3)}, and the training logs among themselves to "
            f"{percent(among.all, 3)}: their torques are not those of the same rigid bodies. Was friction compensated, or "
            "something carried, in one of them?"
        )
        return [Doubt("other-torques", said, level="refuse")]
    return []


@dataclass(frozen=True, eq=False)
class FittedLog:
    """Rows (m, nv, r), (m, nv) at the chosen settings and the fit to them, from which doubts follow."""

    base: BaseParameters
    motions: Sequence[Motion]
    W: Array
    tau: Array
    fold: Array
    settings: FitSettings
    prior: Prior
    x: Array
    covariance: Array
    held_out: HeldOut
    trained: HeldOut
    speed: Array
    acceleration: Array
    rate: float
    dead: Array
    payload_only: bool = False
    """True if only a payload is identified, which the file lacks, so that its torques are not expected."""

    @property
    def deviations(self) -> Array:
        """(r,) of the groups."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.base.unknown.model.velocity_names


# ── Columns: dead, saturated, coarse, of the wrong sign or unit, exchanged

_SATURATED, _SATURATED_ROWS = 0.02, 30
_LEAST_GAIN, _MOST_GAIN, _OF_LIMIT = 0.1, 30.0, 1.0
"""Times the file's bodies that no torque is below, nor above if it is also beyond the joint's limit: a payload at a light wrist
makes twenty times what its links do."""
_STATES = 200
_TOLD = 0.5
"""Share of |residual|² of friction alone, below which the file's bodies must bring it for a gain to be meaningful."""
_EXCHANGED, _SURELY_EXCHANGED, _GAINED = 0.5, 0.3, 0.7
"""Shares of |residual|² that another column's is below: by the file's bodies, and by any; and log of what all gain."""
_COARSE = 0.15


def column_doubts(seen: FittedLog) -> list[Doubt]:
    """Doubts about columns; gains of exchanged columns are meaningless."""
    exchanged = _exchanged(seen)
    gains = [] if exchanged or seen.payload_only else _gains(seen)
    return [*_dead(seen), *_saturated(seen), *_coarse(seen), *exchanged, *gains]


def _dead(seen: FittedLog) -> Iterator[Doubt]:
    if names := [n for n, d in zip(seen.names, seen.dead, strict=True) if d]:
        yield Doubt(
            "dead-torque",
            f"the torque of {', '.join(names)} is one number in nearly all rows: nothing is measured there. What only "
            "these joints feel keeps the file's values.",
            tuple(names),
        )
    moved = np.any([np.ptp(motion.q[:, : len(seen.names)], axis=0) > 0 for motion in seen.motions], axis=0)
    if still := [n for n, d, m in zip(seen.names, seen.dead, moved, strict=True) if not d and not m]:
        yield Doubt(
            "dead-position",
            f"the position of {', '.join(still)} is one number throughout: it did not move, or its channel is dead. Its "
            "friction and its motor's inertia cannot be told.",
            tuple(still),
        )


def _saturated(seen: FittedLog) -> Iterator[Doubt]:
    for k, name in enumerate(seen.names):
        if seen.dead[k]:
            continue
        tau = np.concatenate([np.asarray(m.tau)[:, k] for m in seen.motions])
        for extreme in (float(tau.max()), float(tau.min())):
            count = int((tau == extreme).sum())
            if extreme != 0 and count >= _SATURATED_ROWS and count >= _SATURATED * len(tau):
                yield Doubt(
                    "saturated",
                    f"the torque of {name} is exactly {number(extreme)} in {percent(count / len(tau), 3)} of the rows: it "
                    "is cut off there. Leave these rows out, or log what the motor really gives.",
                    (name,),
                )
                break


def _coarse(seen: FittedLog) -> Iterator[Doubt]:
    cutoff = seen.settings.cutoff
    for k, name in enumerate(seen.names):
        step = quantum([motion.q[:, k] for motion in seen.motions])
        size = float(np.sqrt((seen.acceleration[:, k] ** 2).mean()))
        # White noise of that size, below the cut-off, differentiated twice: sqrt(∫ (2 π f)^4 df) over 0 to the cut-off.
        noise = step / np.sqrt(12.0) * (2 * np.pi * cutoff) ** 2 * np.sqrt(2 * cutoff / seen.rate / 5.0)
        if step > 0 and size > 0 and noise > _COARSE * size:
            yield Doubt(
                "quantised",
                f"positions of {name} lie on a grid of {number(step, 3)}, which makes {percent(noise / size, 3)} of its "
                f"accelerations below {printed(cutoff)} Hz noise. Log more digits, move faster, or lower the cut-off.",
                (name,),
            )


def _of_folds(seen: FittedLog, columns: Array, tau: Array) -> tuple[Array, float]:
    """Coefficients of a torque ``tau`` (m,) in given columns (m, k), and |residual|² / |τ|² of fifths left out."""
    folds = [seen.fold == b for b in range(FOLDS)]
    parts = [NormalEquations.from_rows(columns[fold, None, :], tau[fold, None]) for fold in folds if fold.any()]
    total = sum(parts[1:], parts[0])
    left = 0.0
    for p in parts:
        left += float(p.squares(least(total - p if len(parts) > 1 else total))[0])
    return least(total), left / max(float((tau**2).sum()), 1e-300)


def _by_file(seen: FittedLog, j: int, k: int) -> float:
    """|residual|² / |τ|² of torque k by the file's bodies at joint j and its drive."""
    own = [d for d in seen.base.drives if seen.W[:, j, d].any()]
    columns = np.concatenate([_file_part(seen)[:, j, None], seen.W[:, j][:, own]], axis=1)
    return _of_folds(seen, columns, seen.tau[:, k])[1]


def least(equations: NormalEquations) -> Array:
    """Plain least squares in scaled columns; undetermined unknowns are zero."""
    N, c = equations.N.sum(axis=0), equations.c.sum(axis=0)
    size = np.sqrt(np.maximum(N.diagonal(), 1e-300))
    scaled = N / size[:, None] / size[None, :]
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ (c / size) / size)


def _file_part(seen: FittedLog) -> Array:
    """(m, nv) torques of the file's bodies, without drives, in the rows."""
    own = seen.base.project(seen.base.unknown.file_values)
    return np.asarray(seen.W @ own)


def _gains(seen: FittedLog) -> Iterator[Doubt]:
    """Columns whose size or sign no robot has. The file's bodies may be wrong by much, so that they alone accuse nothing."""
    file, limits = _file_part(seen), np.asarray(seen.base.unknown.model.limits.effort, float)
    for j, name in enumerate(seen.names):
        if seen.dead[j] or not file[:, j].any():
            continue
        drives = seen.W[:, j][:, [d for d in seen.base.drives if seen.W[:, j, d].any()]]
        gains, left = _of_folds(seen, np.concatenate([file[:, j, None], drives], axis=1), seen.tau[:, j])
        _, without = _of_folds(seen, drives, seen.tau[:, j])
        gain = float(gains[0])
        if left > _TOLD * without:
            continue  # the file's bodies explain little of it either way
        largest = max(float(np.abs(np.asarray(motion.tau)[:, j]).max()) for motion in seen.motions)
        if gain < 0 and _inertia(seen, j) < 0:
            yield Doubt(
                "sign",
                f"the torque of {name} has the wrong sign: {number(gain, 2)} times the file's rigid bodies with friction "
                f"left free explain it, to {percent(np.sqrt(left), 3)}, and the joint's inertia comes out negative. Turn "
                "its sign, or that of its position.",
                (name,),
                level="refuse",
            )
        elif 0 < gain < _LEAST_GAIN or (gain > _MOST_GAIN and largest > _OF_LIMIT * limits[j]):
            yield Doubt(
                "gain",
                f"the torque of {name} is {number(gain, 3)} times that of the file's rigid bodies, friction left free: it "
                "is in another unit, before the gear, or a current.",
                (name,),
                level="refuse",
            )


def _inertia(seen: FittedLog, j: int) -> float:
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


def _exchanged(seen: FittedLog) -> list[Doubt]:
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
        Doubt(
            "exchanged",
            f"torque columns seem to be exchanged: {pairs} (residual {percent(np.sqrt(float(best[moved].max())), 3)} in place "
            f"of {percent(np.sqrt(float(own[moved].min())), 3)} and more).",
            tuple(seen.names[j] for j, _ in wrong),
            level="refuse",
        )
    ]


# ── The log as a whole, and the way that it was read

_LATE = 8e-3
_UNDETERMINED = 0.2
_MOTION, _UNSURE = 200, 0.1
"""States of another motion, and the share of its torques that deviations of the groups may make."""
_WITHOUT = 0.5
_UNEXPLAINED_JOINT = 0.6
_NEGATIVE, _NEGLIGIBLE = 4.0, 1e-3
"""Deviations below zero, and share of a joint's torque (rms), from which a negative friction or motor inertia counts. Without
noise deviations hold the errors of filters only by chance, and these make such small ones."""
_NOTABLE = 0.1
"""Share of the torques, that is worth a word where rigid bodies with friction leave it unexplained."""
_SAID = "LOOK AGAIN: "


def doubts_of(seen: FittedLog) -> tuple[Doubt, ...]:
    """All doubts, those that refuse the log first."""
    columns = column_doubts(seen)
    signs = {joint for doubt in columns if doubt.kind == "sign" for joint in doubt.joints}
    negative = [doubt for doubt in _negative(seen) if not signs >= set(doubt.joints)]  # said already
    unexciting = _unexciting(seen) or _undetermined(seen)
    found = [
        *_contradictions(seen),
        *columns,
        *([] if unexciting else _late(seen)),  # of too little, the clock's offset is a guess as well
        *([] if seen.payload_only else _without(seen)),
        *unexciting,
        *negative,
        *_unexplained(seen),
    ]
    return tuple(sorted(found, key=lambda doubt: not doubt.refuses))


def _contradictions(seen: FittedLog) -> Iterator[Doubt]:
    """Doubts found while the logs were read."""
    for motion in seen.motions:
        yield from (contradiction(note.removeprefix(_SAID)) for note in motion.notes if note.startswith(_SAID))
    for motion in seen.motions:
        if all(note.startswith(LEFT_OUT) for note in motion.notes):  # those of files were looked at when they were read
            yield from map(contradiction, motion.contradictions)


def _late(seen: FittedLog) -> Iterator[Doubt]:
    shift = seen.settings.shift
    if abs(shift) >= _LATE:
        when = "after" if shift > 0 else "before"
        yield Doubt(
            "late",
            f"torques fit best {number(abs(shift) * 1e3, 3)} ms {when} the positions of their rows: the two were stamped by "
            "different clocks, or filtered differently. The offset is taken off.",
        )


def _without(seen: FittedLog) -> list[Doubt]:
    """Fixed links that the file has, and the robot of the log does not carry."""
    base, model = seen.base, seen.base.unknown.model
    drives = base.drives
    live = ~seen.dead

    def left_by(values: Array) -> float:
        rest = seen.tau - seen.W @ base.project(values)
        x = least(NormalEquations.from_rows(seen.W[:, :, drives], rest))
        return float(((rest - seen.W[:, :, drives] @ x)[:, live] ** 2).sum())

    whole = left_by(base.unknown.file_values)
    names = {body.link for body in model.bodies}
    best: tuple[float, str] | None = None
    for link, frame in model.frames.items():
        G = model.link_inertias.get(link)
        if frame.body == BASE or link in names or G is None or not G.mass > 0:
            continue
        left = left_by(_less(base, frame.body, G.in_frame(frame.pose)))
        if left < _WITHOUT**2 * whole and (best is None or left < best[0]):
            best = (left, link)
    if best is None:
        return []
    size = float((seen.tau[:, live] ** 2).sum())
    return [
        Doubt(
            "missing-link",
            f"without {best[1]}, which is fixed to the robot in the file, the file explains the torques to "
            f"{percent(np.sqrt(best[0] / size), 3)} in place of {percent(np.sqrt(whole / size), 3)}: the robot of the log did "
            f"not carry it. Say --without {best[1]}.",
        )
    ]


def _less(base: BaseParameters, body: int, G: SpatialInertia) -> Array:
    """The file's values with an inertia taken from a body."""
    values = base.unknown.file_values.copy()
    places = base.unknown.of_bodies
    for k in np.flatnonzero((places >= 10 * body) & (places < 10 * body + 10)):
        values[k] -= G.parameters[places[k] - 10 * body]
    return values


def _unexciting(seen: FittedLog) -> list[Doubt]:
    free = ~seen.base.held
    unknown = (seen.deviations > _UNDETERMINED * seen.prior.size)[free]
    if unknown.sum() <= _UNDETERMINED * len(unknown):
        return []
    worst = np.argsort(-(seen.deviations / seen.prior.size * free))[:3]
    names = "; ".join(seen.base.names[k].split(" ")[0] for k in worst)
    return [
        Doubt(
            "unexciting",
            f"the motion tells {len(unknown) - int(unknown.sum())} of {len(unknown)} groups of parameters only, least {names} "
            "and what is grouped with them: these keep the file's values. Move all joints, far, fast and slow, in both ways.",
        )
    ]


def _undetermined(seen: FittedLog) -> list[Doubt]:
    """Joints whose torques the groups do not predict in another motion, as wide and as fast as the logs'."""
    base, rng = seen.base, np.random.default_rng(0)
    q = np.concatenate([motion.q for motion in seen.motions])
    wide = rng.uniform(q.min(axis=0), q.max(axis=0), (_MOTION, q.shape[1]))
    dq, ddq = (
        rng.normal(size=(_MOTION, x.shape[1])) * np.sqrt((x**2).mean(axis=0)) for x in (seen.speed, seen.acceleration)
    )
    W = base.unknown.columns(base.kept, wide, dq, ddq, seen.settings.friction_speed)
    variance = np.einsum("njk,kl,njl->j", W, seen.covariance, W)
    share = np.sqrt(np.maximum(variance, 0.0) / np.maximum(((W @ seen.x) ** 2).sum(axis=0), 1e-300))
    share[seen.dead | np.array([np.ptp(q[:, k]) == 0 for k in range(len(seen.names))])] = 0.0
    bad = [int(j) for j in np.argsort(-share) if share[j] > _UNSURE]
    if not bad:
        return []
    told = ", ".join(f"{seen.names[j]} {percent(share[j], 3)}" for j in bad[:4])
    worst = np.argsort(-((W[:, bad[0]] ** 2).sum(axis=0) * seen.covariance.diagonal()))[:3]
    least_sure = "; ".join(base.names[k].split(" ")[0] for k in worst)
    return [
        Doubt(
            "unexciting",
            f"of another motion, as wide and as fast, torques would be predicted no better than to: {told}. The logs are too "
            f"short, or tell too little of {least_sure} and what is grouped with them. Move these joints longer, far, fast and "
            "slow, in both ways.",
            tuple(seen.names[j] for j in bad),
        )
    ]


def _negative(seen: FittedLog) -> list[Doubt]:
    kinds = np.array(seen.base.unknown.kinds)[seen.base.kept]
    drive = np.isin(kinds, ("coulomb", "viscous", "motor_inertia"))
    parts = np.sqrt((seen.W**2).mean(axis=0)) * np.abs(seen.x)  # (nv, r) of each joint's torque
    share = (parts / np.maximum(np.sqrt((seen.tau**2).mean(axis=0)), 1e-300)[:, None])[~seen.dead].max(axis=0)
    bad = np.flatnonzero(drive & (seen.x < -_NEGATIVE * seen.deviations) & (share > _NEGLIGIBLE))
    if not bad.size:
        return []
    said = ", ".join(f"{seen.base.names[k]} = {plus_minus(seen.x[k], seen.deviations[k])}" for k in bad[:4])
    joints = tuple(dict.fromkeys(seen.base.names[k].split(".")[0] for k in bad))
    count = Counter(seen.base.names[k].split(".")[0] for k in bad)
    turned = tuple(name for name, n in count.items() if n > 1)
    if turned:
        return [
            Doubt(
                "sign",
                f"friction and motors' inertias of {', '.join(turned)} come out negative: {said}. The torque, or the position, "
                "has the wrong sign there.",
                turned,
                level="refuse",
            )
        ]
    return [
        Doubt(
            "negative",
            f"friction and motors' inertias cannot be negative, and come out so: {said}. Was friction compensated by the "
            "controller, or is a unit wrong?",
            joints,
        )
    ]


def _unexplained(seen: FittedLog) -> list[Doubt]:
    held = seen.held_out
    found = left_unexplained(held, seen.trained)
    share = held.sizes / max(float(held.sizes.sum()), 1e-300)
    bad = [
        name
        for k, (name, left) in enumerate(held.joints.items())
        if left > _UNEXPLAINED_JOINT and not seen.dead[k] and share[k] > 0
    ]
    if not found and held.all > _NOTABLE:
        worst = max(
            (name for k, name in enumerate(held.joints) if not seen.dead[k]), key=lambda name: held.joints[name]
        )
        found.append(
            Doubt(
                "partly-unexplained",
                f"rigid bodies with friction leave {percent(held.all, 3)} of the torques unexplained in rows held out, most at "
                f"{worst} ({percent(held.joints[worst], 3)}): elasticity, friction of another law, or torques that are not all "
                "that acts, as where the controller compensates friction.",
                (worst,),
            )
        )
    if bad and not any(doubt.refuses for doubt in found):
        said = ", ".join(f"{name} {percent(held.joints[name], 3)}" for name in bad)
        found.append(Doubt("unexplained-joint", f"torques are left unexplained in rows held out: {said}.", tuple(bad)))
    return found
