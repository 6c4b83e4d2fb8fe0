"""Doubts about the logs of a fit: columns, causes of the residual, missing links, excitation, and the final residual."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..core.doubts import Doubt, doubt, doubt_table
from ..core.estimation.cross_validation import HeldOut
from ..core.estimation.filters import low_pass
from ..core.estimation.least_squares import NormalEquations, Prior
from ..core.estimation.noise import quantum
from ..core.estimation.sampling import cut_off, moves
from ..core.gravity import STRENGTH
from ..core.numbers import number, percent, plus_minus, printed, seconds
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.model import BASE

if TYPE_CHECKING:
    from ..robot import Robot
    from .hyperparameters import FitSettings
    from .log_windows import ReadLog
    from .parameters import BaseParameters

_UNEXPLAINED = 0.35
"""Held-out residual, as a share of the torques, from which the logs are rejected."""
OTHERS, NOTABLE_IN_OTHERS = 2.5, 0.12
"""Ratio of the residual of other logs to that of the training logs, and minimum residual, from which the logs differ."""


LEFT_OUT = "rows-left-out"
"""Kind of the notes on omitted rows, which are listed separately from the doubts."""


def of_reading(doubts: Iterable[Doubt], log: str = "") -> Iterator[Doubt]:
    """Doubts found without a model; if their row does not list ``identify``, they become notes."""
    for one in doubts:
        if one.kind != LEFT_OUT:
            level = one.level if "identify" in doubt_table()[one.kind].reads else "note"
            yield replace(one, level=level, sentence=f"{log}: {one.sentence}" if log else one.sentence)


def left_unexplained(held: HeldOut, among: HeldOut) -> list[Doubt]:
    """Doubts from held-out residuals: too large, or those of other logs far larger than of the training logs ``among``."""
    if held.all > _UNEXPLAINED:
        return [doubt("unexplained", left=percent(held.all, 3))]
    if held.kind == "test" and held.all > max(OTHERS * among.all, NOTABLE_IN_OTHERS):
        parts = percent(held.all, 3), percent(among.all, 3)
        said = f"the logs held out are explained to {parts[0]}, the training logs among themselves to {parts[1]}"
        return [doubt("other-torques", said=said, level="refuse")]
    return []


@dataclass(frozen=True, eq=False)
class FittedLog:
    """Rows (m, nv, r) and torques (m, nv) at the chosen settings, with the fit to them."""

    base: BaseParameters
    logs: Sequence[ReadLog]
    W: Array
    tau: Array
    settings: FitSettings
    prior: Prior
    x: Array
    covariance: Array
    held_out: HeldOut
    trained: HeldOut
    fifths: Sequence[NormalEquations]
    """Normal equations of the weighted rows of each fifth of the time, joint by joint, in units of the residuals."""
    speed: Array
    acceleration: Array
    rate: float
    dead: Array
    causes: Sequence[Doubt] = ()
    """Doubts about the causes of the residual."""
    payload_only: bool = False
    """True if only a payload is identified; the file lacks it, so torques may differ from the file's."""

    @property
    def deviations(self) -> Array:
        """(r,) standard deviations of the groups."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.base.unknown.model.velocity_names

    @cached_property
    def other_motion(self) -> Array:
        """(n, nv, r) columns of another motion, as fast as the logs and as wide as the limits."""
        rng, q = np.random.default_rng(0), np.concatenate([log.q for log in self.logs])
        wide = rng.uniform(*_reach(self.base.unknown.robot, q), (_MOTION, q.shape[1]))
        dq, ddq = (
            rng.normal(size=(_MOTION, x.shape[1])) * np.sqrt((x**2).mean(axis=0))
            for x in (self.speed, self.acceleration)
        )
        return self.base.unknown.columns(self.base.kept, wide, dq, ddq, self.settings.friction_speed)

    @cached_property
    def torque_shares(self) -> Array:
        """(nv, r) changes of another motion's torques by a deviation of each group, as shares of a joint's torque (rms)."""
        W = self.other_motion
        size = np.sqrt(((W @ self.x) ** 2).mean(axis=0))
        shares = np.sqrt((W**2).mean(axis=0)) * self.deviations / np.maximum(size, 1e-300)[:, None]
        return np.asarray(np.where(self.dead[:, None] | self.base.held, 0.0, shares))


# ── Columns

_COARSE = 0.15


def column_doubts(seen: FittedLog) -> Iterator[Doubt]:
    """Doubts about dead, saturated and coarse columns."""
    moved = np.any([moves(log.q[:, : len(seen.names)]) for log in seen.logs], axis=0)
    rests = not moved.any() and not any(moves(log.tau).any() for log in seen.logs)
    if rests:
        yield doubt("unexciting", said="the robot stood still: no position or torque changes by more than its noise.")
    for kind, which in (("dead-torque", seen.dead), ("dead-position", ~seen.dead & ~moved)):
        if joints := [seen.names[k] for k in np.flatnonzero(which) if not (rests and kind == "dead-position")]:
            still = kind == "dead-position" and not moved.any()
            yield doubt(kind, joints, named="all joints" if still else None, level="refuse" if still else None)
    yield from _copies(seen)
    cutoff = seen.settings.cutoff
    for k in np.flatnonzero(~seen.dead).tolist():
        tau = np.concatenate([log.tau[:, k] for log in seen.logs])
        if (cut := cut_off(tau)) is not None:
            yield doubt("saturated", seen.names[k : k + 1], extreme=number(cut[0]), rows=percent(cut[1], 3))
    for k, name in enumerate(seen.names):
        step = quantum([window.q[:, k] for log in seen.logs for window in log.windows])
        size = float(np.sqrt((seen.acceleration[:, k] ** 2).mean()))
        # White noise of that size, low-passed and differentiated twice: sqrt(∫ (2 π f)^4 df) over 0 to the cut-off.
        noise = step / np.sqrt(12.0) * (2 * np.pi * cutoff) ** 2 * np.sqrt(2 * cutoff / seen.rate / 5.0)
        if step > 0 and size > 0 and noise > _COARSE * size:
            share = percent(noise / size, 3)
            yield doubt("quantised", [name], grid=number(step, 3), noise=share, cutoff=printed(cutoff))


_EQUAL, _SAME = 1e-9, 0.99
"""Difference, as a share of a column's deviation, below which two values are equal; minimum share of rows of a copy."""


def _copies(seen: FittedLog) -> Iterator[Doubt]:
    """Doubts about pairs of columns that are equal up to a factor in nearly all rows."""
    for what, live in (("torque", ~seen.dead), ("position", np.ones(len(seen.names), bool))):
        x = np.concatenate([log.tau if what == "torque" else log.q[:, : len(seen.names)] for log in seen.logs])
        size = x.std(axis=0)
        for j, k in combinations(np.flatnonzero(live & (size > 0)).tolist(), 2):
            factor = float(x[:, j] @ x[:, k] / (x[:, j] @ x[:, j]))
            if what == "position" and abs(factor - 1.0) > _EQUAL:
                continue  # a planned motion of both joints, in proportion
            if (np.abs(x[:, k] - factor * x[:, j]) <= _EQUAL * size[k]).mean() > _SAME:
                times = "" if abs(factor - 1.0) < _EQUAL else f"{number(factor, 4)} times "
                yield doubt("copied", [seen.names[j], seen.names[k]], what=what, times=times)


# ── Common gain of all torques

_OF_FILE = 0.25, 4.0
"""Common gain of all torques against the file's bodies, below and above which it is a fault."""
_UNITS = {
    1e3: "N mm", 1e-3: "kN m", 10.197: "kgf cm", 0.10197: "kgf m", STRENGTH: "N m if the file's masses are weights",
    4.4482: "N if they were in lbf", 0.73756: "lbf ft", 8.8507: "lbf in", 1.35582: "N m if they were in lbf ft",
    0.112985: "N m if they were in lbf in",
}  # fmt: skip
"""Torques of other units, as multiples of those in N m."""
_OF_UNIT, _ALIKE = 0.02, 2.0
"""Relative deviation from a unit; ratio to the residual of free groups, below which the file's bodies fit at one gain."""
_TOLD = 0.75
"""Ratio to the residual of drives alone, below which the residual with the file's bodies makes their gain meaningful."""


def gain_of_all(seen: FittedLog) -> list[Doubt]:
    """Sign or unit of all torques together, from a fit of the file's bodies with free drives."""
    base = seen.base
    file = seen.W @ base.project(base.unknown.file_values) - seen.W[:, :, base.held] @ seen.x[base.held]
    sigma = np.maximum(np.sqrt((seen.tau**2).mean(axis=0)), 1e-300)
    drives = seen.W[:, :, base.drives]
    least = []
    for columns in (np.concatenate([file[..., None], drives], axis=2), drives):
        y = (seen.tau / sigma)[:, ~seen.dead].ravel()
        A = (columns / sigma[:, None])[:, ~seen.dead].reshape(len(y), columns.shape[2])
        x = np.linalg.lstsq(A, y, rcond=None)[0] if columns.size else np.zeros(0)
        least.append((x, float(((y - A @ x) ** 2).sum())))
    (x, left), (_, without) = least
    gain = float(x[0])
    if left > _TOLD * without:
        return []
    if _OF_FILE[0] <= gain <= _OF_FILE[1]:
        free = float((((seen.tau - seen.W @ seen.x) / sigma)[:, ~seen.dead] ** 2).sum())
        return _unit(seen, gain) if left <= _ALIKE**2 * free else []
    kind, evidence = "torque-sign" if gain < 0 else "gain", "the file's bodies explain it best so"
    said = {"value": number(gain, 3), "interval": "", "evidence": evidence}
    return [doubt(kind, seen.names, level="refuse", found={"value": gain}, named="all joints", **said)]


def _unit(seen: FittedLog, gain: float) -> list[Doubt]:
    """Unit of torques that explain the file's bodies at one gain as well as free groups do."""
    unit = next((name for factor, name in _UNITS.items() if abs(gain / factor - 1.0) < _OF_UNIT), None)
    if unit is None:
        return []
    said, found = f"they look like {unit}", {"value": gain}
    return [
        doubt("unit", seen.names, level="refuse", found=found, named="all joints", value=number(gain, 3), said=said)
    ]


# ── Final residual

_UNDETERMINED = 0.2
_MOTION, _UNSURE_TORQUE = 200, 0.1
"""Number of states of another motion, and maximum share of its torques that deviations of the groups may change."""
_WITHOUT = 0.5
_UNEXPLAINED_JOINT, _OF_LIMIT, _MOST_JOINTS = 0.1, 0.01, 4
"""Residual of a poorly predicted joint, as shares of its torque (rms) and of its effort limit; number of named joints."""
_NEGATIVE, _NEGLIGIBLE = 4.0, 1e-3
"""Standard deviations below zero, and share of a joint's torque (rms), from which a negative friction or motor inertia counts.
Without noise, standard deviations do not cover filter errors, which cause such small values."""
_MATTERS = 0.05
"""Share of itself by which a joint's residual in rows held out rises without a negative value that counts."""
_MANY = 0.5
"""Share of joints with negative friction from which a controller counts as compensating it: usually all joints."""
_CHANCE, _POSES, _PART = 1e-6, 50, 0.3
"""Chance that noise makes a kinetic energy negative in some direction of one pose; number of tested poses; share of the largest
part in a direction from which a joint is named."""
_NOTABLE = 0.1
"""Share of the torques not explained by rigid bodies with friction, from which it is reported."""
_LOUD, _LEAST_LOUD, _RATES_OF_NOISE = 3.0, 0.05, 4.0
"""Ratio to the noise, and share of a joint's torque, from which a residual is loud; least rate in cut-offs that shows noise."""
_SPOILED = ("buffered", "copied", "saturated", "unexciting")
"""Doubts without a model whose residuals would be mistaken for other causes; a log at rest has nothing to explain."""


def doubts_of(seen: FittedLog) -> tuple[Doubt, ...]:
    """All doubts, those that reject the log first; insufficient motion is reported only without other doubts."""
    read = [*(one for log in seen.logs for one in of_reading(log.doubts, log.name)), *column_doubts(seen)]
    spoiled = any(one.refuses or one.kind in _SPOILED for one in read)
    causes = [] if seen.payload_only or spoiled else [*gain_of_all(seen), *seen.causes]
    if any(
        one.kind == "time-scale" for one in causes
    ):  # accelerations of a clock that is wrong look like a common gain
        causes = [one for one in causes if one.kind != "gain" or one.joints != seen.names]
    if any(one.level != "note" for one in (*read, *seen.causes)):  # free groups are wrong too
        causes = [one for one in causes if one.kind != "unit"]
    known = spoiled or any(one.level != "note" for one in causes)
    found = [
        *read,
        *causes,
        *([] if seen.payload_only or known else _without(seen)),
        *([] if known else _unexciting(seen) or _undetermined(seen)),
        *(_negative(seen, known=known) or ([] if known else _negative_energy(seen))),
    ]
    little = any(one.kind == "unexciting" for one in found) and not known
    loud = little and _residual_above_noise(seen)
    left = _unexplained(seen, known=known, loud=loud)
    return sorted_doubts([*left, *found] if loud else [*found, *left])  # more motion does not explain what is loud


def sorted_doubts(found: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Doubts in the order of their levels: those that reject the log first, notes last."""
    return tuple(sorted(found, key=lambda one: ("refuse", "unsure", "note").index(one.level)))


def _without(seen: FittedLog) -> list[Doubt]:
    """Fixed links of the file that the robot of the log does not carry."""
    base, model = seen.base, seen.base.unknown.model
    Q = np.linalg.qr(seen.W[:, :, base.drives].reshape(seen.tau.size, len(base.drives)))[0]

    def left_by(values: Array) -> float:
        rest = (seen.tau - seen.W @ base.project(values)).ravel()
        return float(rest @ rest - ((Q.T @ rest) ** 2).sum())

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
    size = float((seen.tau**2).sum())
    shares = [percent(np.sqrt(squares / size), 3) for squares in (best[0], whole)]
    return [doubt("missing-link", link=best[1], left=shares[0], whole=shares[1])]


def _less(base: BaseParameters, body: int, G: SpatialInertia) -> Array:
    """Values of the file after an inertia is subtracted from a body."""
    values = base.unknown.file_values.copy()
    places = base.unknown.of_bodies
    mine = places // 10 == body
    values[mine] -= G.parameters[places[mine] - 10 * body]
    return values


def _unexciting(seen: FittedLog) -> list[Doubt]:
    free = ~seen.base.held
    unknown = (seen.deviations > _UNDETERMINED * seen.prior.size)[free]
    if unknown.sum() <= _UNDETERMINED * len(unknown):
        return []
    worst = np.argsort(-(seen.deviations / seen.prior.size * free))[:3]
    names = "; ".join(seen.base.names[k].split(" ")[0] for k in worst)
    told = f"{len(unknown) - int(unknown.sum())} of {len(unknown)} groups of parameters"
    said = (
        f"the motion determines only {told}, least {names} and what is grouped with them: these keep the file's values."
    )
    return [doubt("unexciting", said=said)]


def _undetermined(seen: FittedLog) -> list[Doubt]:
    """Joints whose torques are poorly predicted in another motion, as fast as the logs and as wide as the limits."""
    base, W = seen.base, seen.other_motion
    variance = np.einsum("njk,kl,njl->j", W, seen.covariance, W)
    share = np.sqrt(np.maximum(variance, 0.0) / np.maximum(((W @ seen.x) ** 2).sum(axis=0), 1e-300))
    ranges = np.ptp(np.concatenate([log.q for log in seen.logs])[:, : len(seen.names)], axis=0)
    share[seen.dead | (ranges == 0)] = 0.0
    bad = [int(j) for j in np.argsort(-share) if share[j] > _UNSURE_TORQUE]
    if not bad:
        return []
    told = ", ".join(f"{seen.names[j]} {percent(share[j], 3)}" for j in bad[:4])
    worst = np.argsort(-((W[:, bad[0]] ** 2).sum(axis=0) * seen.covariance.diagonal()))[:3]
    least_sure = "; ".join(base.names[k].split(" ")[0] for k in worst)
    said = (
        f"of another motion, as fast and over the whole range, torques would be predicted no better than to: {told}. The "
        f"logs are too short or too narrow: they determine too little of {least_sure} and what is grouped with them."
    )
    return [doubt("unexciting", [seen.names[j] for j in bad], said=said)]


def _reach(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Ranges of positions (nv,): limits, at most half a turn; for joints without limits or motion, the logs' range."""
    low, high = q.min(axis=0), q.max(axis=0)
    turn = np.where([bool(body.joint.turning[0]) for body in robot.model.leaders], np.pi, np.inf)
    lower, upper = np.maximum(robot.limits.lower, -turn), np.minimum(robot.limits.upper, turn)
    known = (high > low) & np.isfinite(lower) & np.isfinite(upper)
    return np.where(known, np.minimum(lower, low), low), np.where(known, np.maximum(upper, high), high)


_NOT_NEGATIVE = ("motor_inertia", "viscous", "coulomb", "stribeck", "m", "Ixx", "Iyy", "Izz")
"""Kinds of parameters that are never negative in a body or drive."""


def _signed(base: BaseParameters) -> Array:
    """(r,) bool: the group cannot be negative, as a sum of such parameters; a difference, as of coupled motors, can."""
    never = np.isin(base.unknown.kinds, _NOT_NEGATIVE)
    return np.asarray(((base.grouping == 0.0) | ((base.grouping > 0.0) & never)).all(axis=1))


def _negative(seen: FittedLog, *, known: bool) -> list[Doubt]:
    """Negative friction and motor inertias: two at a joint indicate the sign of its torque, one another cause."""
    kinds = np.array(seen.base.unknown.kinds)[seen.base.kept]
    drive = np.isin(kinds, ("coulomb", "viscous", "motor_inertia"))
    parts = np.sqrt((seen.W**2).mean(axis=0)) * np.abs(seen.x)  # (nv, r) of each joint's torque
    share = (parts / np.maximum(np.sqrt((seen.tau**2).mean(axis=0)), 1e-300)[:, None])[~seen.dead].max(axis=0)
    bad = np.flatnonzero(drive & _signed(seen.base) & (seen.x < -_NEGATIVE * seen.deviations) & (share > _NEGLIGIBLE))
    owner = {int(k): seen.base.names[k].split(".")[0] for k in bad}
    if known or not owner:
        return []
    found = list(_negative_values(seen, owner, kinds))
    return found if _negative_matters(seen, bad) else [replace(one, level="note") for one in found]


def _negative_matters(seen: FittedLog, bad: Array) -> bool:
    """True if values of 0 in place of negative ones raise the residual of some joint in rows held out by 5 % of itself."""
    total, squares = reduce(operator.add, seen.fifths), np.zeros((2, len(seen.names)))
    for fifth in seen.fifths:
        A, b = (total - fifth).N.sum(axis=0), (total - fifth).c.sum(axis=0)
        left = np.delete(np.arange(len(b)), bad)
        some = Prior(seen.prior.mean[left], seen.prior.size[left])
        zero = np.zeros(len(b))
        zero[left] = some.solve(A[np.ix_(left, left)], b[left])
        squares += fifth.squares(seen.prior.solve(A, b)), fifth.squares(zero)
    return bool((squares[1] > (1.0 + _MATTERS) ** 2 * squares[0])[~seen.dead].any())


def _negative_values(seen: FittedLog, owner: dict[int, str], kinds: Array) -> Iterator[Doubt]:
    """Doubts about negative values, by the joint of each."""
    count = Counter(owner.values())
    inertias = {owner[k] for k in owner if kinds[k] == "motor_inertia"}
    if turned := [name for name, n in count.items() if n > 1 and name in inertias]:  # friction alone may be compensated
        evidence = "its friction and motor inertia come out negative"
        yield doubt("torque-sign", turned, level="refuse", named=listed(turned), evidence=evidence)
        return
    for kind, mine in (
        ("friction-compensated", kinds != "motor_inertia"),
        ("negative-inertia", kinds == "motor_inertia"),
    ):
        if which := [k for k in owner if mine[k]]:
            values = ", ".join(f"{seen.base.names[k]} = {plus_minus(seen.x[k], seen.deviations[k])}" for k in which[:4])
            joints = sorted({owner[k] for k in which}, key=seen.names.index)
            if kind == "friction-compensated" and len(joints) <= _MANY * (~seen.dead).sum():
                said = (
                    f"friction cannot be negative, but the fit gives {values}: the logs determine too little of it, or the "
                    "controller compensates it."
                )
                yield doubt("unexciting", joints, said=said)
            else:
                yield doubt(kind, joints, values=values)


def _negative_energy(seen: FittedLog) -> list[Doubt]:
    """Negative kinetic energy ½ q̇' M(q) q̇ at some pose of the logs, at velocities q̇ like those of the logs."""
    from scipy.special import chdtri

    base, speed = seen.base, seen.settings.friction_speed
    q, n = np.concatenate([log.q for log in seen.logs]), len(seen.names)
    q = q[:: max(1, len(q) // _POSES)]
    still = np.zeros((len(q), n))
    holding = base.unknown.columns(base.kept, q, still, still, speed)
    moving = np.stack(
        [base.unknown.columns(base.kept, q, still, still + e, speed) - holding for e in np.eye(n)], axis=2
    )
    fast = np.sqrt((seen.speed**2).mean(axis=0)) * ~seen.dead
    M = np.einsum("mijr,r,i,j->mij", moving, seen.x, fast, fast)
    energies, directions = np.linalg.eigh(0.5 * (M + M.swapaxes(1, 2)))
    dq = directions[..., 0] * fast
    w = 0.5 * np.einsum("mijr,mi,mj->mr", moving, dq, dq)
    deviation = np.sqrt(np.maximum(np.einsum("mr,rs,ms->m", w, seen.covariance, w), 0.0))
    sure = np.sqrt(chdtri(n, _CHANCE))
    k = int(np.argmin(w @ seen.x + sure * deviation))
    energy = float(w[k] @ seen.x)
    if energy >= -sure * deviation[k] or -energy <= _NEGLIGIBLE * 0.5 * energies[k, -1]:
        return []
    share = np.abs(directions[k, :, 0])
    names = [seen.names[j] for j in np.argsort(-share) if share[j] > _PART * share.max()]
    values = f"a kinetic energy of {plus_minus(energy, float(deviation[k]))} J in a motion of {listed(names, 4)}"
    return [doubt("negative-inertia", names, values=values)]


def _unexplained(seen: FittedLog, *, known: bool, loud: bool) -> list[Doubt]:
    """Doubts about what remains; ``loud``: the motion determines too little, and the residual is far above the noise."""
    held = seen.held_out
    found = [] if known else left_unexplained(held, seen.trained)
    bad = _poorly_predicted(seen)
    if not found and (held.all > _NOTABLE or loud) and not known:
        live = [name for k, name in enumerate(held.joints) if not seen.dead[k]]
        worst = max(live, key=lambda name: held.joints[name])
        most = percent(held.joints[worst], 3)
        when = _largest_at(held, list(held.joints).index(worst)) if loud else ""
        found.append(doubt("partly-unexplained", [worst], left=percent(held.all, 3), most=most, when=when))
    if bad and not known and not any(one.refuses for one in found):
        said = listed([f"{name} to {percent(held.joints[name], 3)}" for name in bad], _MOST_JOINTS)
        found.append(doubt("unexplained-joint", bad, said=said))
    return found


def _residual_above_noise(seen: FittedLog) -> bool:
    """True if the training rows leave a joint's residual three times as large as its noise, and 5 % of its torque.

    The noise below the cut-off is that of white noise with the part above the cut-off that the torques have.
    """
    cutoff = seen.settings.cutoff
    high = np.zeros((0, len(seen.names)))
    for samples in (one for log in seen.logs for one in log.samples):
        if samples.rate > _RATES_OF_NOISE * cutoff:
            white = np.sqrt(cutoff / (0.5 * samples.rate - cutoff))
            high = np.concatenate([high, white * (samples.tau - low_pass(samples.tau, cutoff, samples.rate))])
    if not len(high):
        return False
    noise, torque, left = (np.sqrt((x**2).mean(axis=0)) for x in (high, seen.tau, seen.tau - seen.W @ seen.x))
    return bool((left > np.maximum(_LOUD * noise, _LEAST_LOUD * torque))[~seen.dead].any())


def _largest_at(held: HeldOut, joint: int) -> str:
    """Words for the time at which the residual of a joint is largest; empty for several logs."""
    time = np.concatenate([rows.time for rows in held.rows])
    if any(rows.log.any() for rows in held.rows) or not len(time):
        return ""
    left = np.concatenate([np.abs(rows.measured - rows.predicted)[:, joint] for rows in held.rows])
    return f", largest at t = {seconds(float(time[left.argmax()]), 4)} s"


def _poorly_predicted(seen: FittedLog) -> list[str]:
    """Joints whose residual in rows held out is a large share of their torque, and of their effort limit if they have one."""
    held, effort = seen.held_out, seen.base.unknown.model.limits.effort
    count = sum(len(rows.time) for rows in held.rows)
    residual = np.sqrt(held.squares / max(count, 1))
    small = np.isfinite(effort) & (residual <= _OF_LIMIT * effort)
    live = ~seen.dead & (held.sizes > 0) & ~small
    return [name for k, (name, left) in enumerate(held.joints.items()) if live[k] and left > _UNEXPLAINED_JOINT]
