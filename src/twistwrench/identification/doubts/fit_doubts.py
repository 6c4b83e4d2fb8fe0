"""Doubts about the logs of a fit: columns, causes of the residual, missing links, excitation, and the final residual."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import reduce
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from ...core.doubts import Doubt, Level, doubt, doubt_table
from ...core.estimation.cross_validation import HeldOut
from ...core.estimation.filters import low_pass
from ...core.estimation.least_squares import Prior
from ...core.numbers import percent, plus_minus, seconds
from ...core.text import listed
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.model.model import BASE
from .column_doubts import column_doubts
from .common_gain import gain_of_all
from .fitted_log import FittedLog, rms

if TYPE_CHECKING:
    from ..parameters import BaseParameters

_MAX_UNEXPLAINED = 0.35
"""Held-out residual, as a share of the torques, from which the logs are rejected."""
OTHERS, NOTABLE_IN_OTHERS = 2.5, 0.12
"""Ratio of the residual of other logs to that of the training logs, and minimum residual, from which the logs differ."""


LEFT_OUT = "rows-left-out"
"""Kind of the notes on omitted rows, which are listed separately from the doubts."""


def reading_doubts(doubts: Iterable[Doubt], log: str = "") -> Iterator[Doubt]:
    """Doubts found without a model; if their row does not list ``identify``, they become notes."""
    for one in doubts:
        if one.kind == LEFT_OUT:
            continue
        level, sentence = one.level, one.sentence
        if "identify" not in doubt_table()[one.kind].reads:
            level = "note"
        if log:
            sentence = f"{log}: {sentence}"
        yield replace(one, level=level, sentence=sentence)


def left_unexplained(held: HeldOut, among: HeldOut) -> list[Doubt]:
    """Doubts from held-out residuals: too large, or those of other logs far larger than of the training logs ``among``."""
    if held.all > _MAX_UNEXPLAINED:
        return [doubt("unexplained", left=percent(held.all, 3))]
    if held.kind == "test" and held.all > max(OTHERS * among.all, NOTABLE_IN_OTHERS):
        message = (
            f"the logs held out are explained to {percent(held.all, 3)}, the training logs among themselves to "
            f"{percent(among.all, 3)}"
        )
        return [doubt("other-torques", said=message, level="refuse")]
    return []


_MAX_UNDETERMINED = 0.2
_UNSURE_TORQUE = 0.1
"""Maximum share of the torques of another motion that deviations of the groups may change."""
_MAX_RESIDUAL_WITHOUT_LINK = 0.5
_MAX_UNEXPLAINED_OF_JOINT, _MAX_SHARE_OF_LIMIT, _MOST_JOINTS = 0.1, 0.01, 4
"""Residual of a poorly predicted joint, as shares of its torque (rms) and of its effort limit; number of named joints."""
_MIN_NEGATIVE_DEVIATIONS, _MIN_NEGATIVE_SHARE = 4.0, 1e-3
"""Standard deviations below zero, and share of a joint's torque (rms), from which a negative friction or motor inertia counts.
Without noise, standard deviations do not cover filter errors, which cause such small values."""
_MIN_RESIDUAL_RISE = 0.05
"""Share of itself by which a joint's residual in rows held out rises without a negative value that counts."""
_MIN_SHARE_OF_JOINTS = 0.5
"""Share of joints with negative friction from which a controller counts as compensating it: usually all joints."""
_MAX_CHANCE, _POSES, _MIN_SHARE_OF_DIRECTION = 1e-6, 50, 0.3
"""Chance that noise makes a kinetic energy negative in some direction of one pose; number of tested poses; share of the largest
part in a direction from which a joint is named."""
_MAX_UNREPORTED = 0.1
"""Share of the torques not explained by rigid bodies with friction, from which it is reported."""
_MIN_RATIO_TO_NOISE, _MIN_SHARE_OF_TORQUE, _MIN_RATE_OF_CUTOFF = 3.0, 0.05, 4.0
"""Ratio to the noise, and share of a joint's torque, from which a residual is loud; least rate in cut-offs that shows noise."""
_SPOILED = {"buffered", "copied", "saturated", "unexciting"}
"""Doubts without a model whose residuals would be mistaken for other causes; a log at rest has nothing to explain."""


def doubts_of(fit: FittedLog) -> tuple[Doubt, ...]:
    """All doubts, those that reject the log first; insufficient motion is reported only without other doubts."""
    read: list[Doubt] = []
    for log in fit.logs:
        read += reading_doubts(log.doubts, log.name)
    read += column_doubts(fit)
    spoiled = "refuse" in _levels(read) or not _SPOILED.isdisjoint(_kinds(read))
    causes = [] if spoiled else _cause_doubts(fit, read)
    known = spoiled or bool(_levels(causes) - {"note"})
    doubts = [*read, *causes]
    if not known:
        if not fit.payload_only:
            doubts += _missing_link(fit)
        doubts += _unexciting(fit) or _poor_predictions(fit)
    negative = _negative_doubts(fit, known=known)
    doubts += negative
    if not negative and not known:
        doubts += _negative_energy(fit)
    if known or "unexciting" not in _kinds(doubts):
        return sorted_doubts([*doubts, *_residual_doubts(fit, known=known, loud=False)])
    loud = _residual_above_noise(fit)
    residual = _residual_doubts(fit, known=known, loud=loud)
    if loud:
        return sorted_doubts([*residual, *doubts])  # more motion does not explain what is loud
    return sorted_doubts([*doubts, *residual])


def _cause_doubts(fit: FittedLog, read: Sequence[Doubt]) -> list[Doubt]:
    """Doubts about the common gain and the causes of the residual, of logs with the doubts ``read`` without a model."""
    if fit.payload_only:
        return []
    doubts = [*gain_of_all(fit), *fit.causes]
    if "time-scale" in _kinds(doubts):  # accelerations of a clock that is wrong look like a common gain
        doubts = [one for one in doubts if one.kind != "gain" or one.joints != fit.names]
    if _levels([*read, *fit.causes]) - {"note"}:  # free groups are wrong too
        doubts = [one for one in doubts if one.kind != "unit"]
    return doubts


def _levels(doubts: Iterable[Doubt]) -> set[Level]:
    return {one.level for one in doubts}


def _kinds(doubts: Iterable[Doubt]) -> set[str]:
    return {one.kind for one in doubts}


def sorted_doubts(found: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Doubts in the order of their levels: those that reject the log first, notes last."""
    return tuple(sorted(found, key=lambda one: ("refuse", "unsure", "note").index(one.level)))


def _missing_link(fit: FittedLog) -> list[Doubt]:
    """Fixed links of the file that the robot of the log does not carry."""
    base, model = fit.base, fit.base.unknown.model
    Q = np.linalg.qr(fit.W[:, :, base.drives].reshape(fit.tau.size, len(base.drives)))[0]

    def squares_left(values: Array) -> float:
        residual = (fit.tau - fit.W @ base.project(values)).ravel()
        return float(residual @ residual - ((Q.T @ residual) ** 2).sum())

    whole = squares_left(base.unknown.file_values)
    moving_links = {body.link for body in model.bodies}
    least, missing = _MAX_RESIDUAL_WITHOUT_LINK**2 * whole, ""
    for link, frame in model.frames.items():
        G = model.link_inertias.get(link)
        if frame.body == BASE or link in moving_links or G is None or not G.mass > 0:
            continue
        squares = squares_left(_values_without(base, frame.body, G.in_frame(frame.pose)))
        if squares < least:
            least, missing = squares, link
    if not missing:
        return []
    size = float((fit.tau**2).sum())
    share, share_of_whole = percent(np.sqrt(least / size), 3), percent(np.sqrt(whole / size), 3)
    return [doubt("missing-link", link=missing, left=share, whole=share_of_whole)]


def _values_without(base: BaseParameters, body: int, G: SpatialInertia) -> Array:
    """Values of the file after an inertia is subtracted from a body."""
    values = base.unknown.file_values.copy()
    columns = base.unknown.of_bodies
    of_body = columns // 10 == body
    values[of_body] -= G.parameters[columns[of_body] - 10 * body]
    return values


def _unexciting(fit: FittedLog) -> list[Doubt]:
    """Doubt about a motion that leaves many groups undetermined."""
    free = ~fit.base.held
    is_unknown = (fit.deviations > _MAX_UNDETERMINED * fit.prior.size)[free]
    if is_unknown.sum() <= _MAX_UNDETERMINED * len(is_unknown):
        return []
    worst = np.argsort(-(fit.deviations / fit.prior.size * free))[:3]
    names = fit.first_parameters(worst)
    count = f"{len(is_unknown) - int(is_unknown.sum())} of {len(is_unknown)} groups of parameters"
    message = f"the motion determines only {count}, least {names} and what is grouped with them: these keep the file's values."
    return [doubt("unexciting", said=message)]


def _poor_predictions(fit: FittedLog) -> list[Doubt]:
    """Joints whose torques are poorly predicted in another motion, as fast as the logs and as wide as the limits."""
    W = fit.other_motion
    variance = np.einsum("njk,kl,njl->j", W, fit.covariance, W)
    share = np.sqrt(np.maximum(variance, 0.0) / np.maximum(((W @ fit.x) ** 2).sum(axis=0), 1e-300))
    ranges = np.ptp(fit.q[:, : len(fit.names)], axis=0)
    share[fit.dead | (ranges == 0)] = 0.0
    order = np.argsort(-share)
    joints = order[share[order] > _UNSURE_TORQUE].tolist()
    if not joints:
        return []
    shares = ", ".join(f"{fit.names[j]} {percent(share[j], 3)}" for j in joints[:4])
    worst = np.argsort(-((W[:, joints[0]] ** 2).sum(axis=0) * fit.covariance.diagonal()))[:3]
    least_sure = fit.first_parameters(worst)
    message = (
        f"of another motion, as fast and over the whole range, torques would be predicted no better than to: {shares}. The "
        f"logs are too short or too narrow: they determine too little of {least_sure} and what is grouped with them."
    )
    return [doubt("unexciting", fit.joints(joints), said=message)]


_NOT_NEGATIVE = ("motor_inertia", "viscous", "coulomb", "stribeck", "m", "Ixx", "Iyy", "Izz")
"""Kinds of parameters that are never negative in a body or drive."""


def _is_never_negative(base: BaseParameters) -> Array:
    """(r,) bool: the group cannot be negative, as a sum of such parameters; a difference, as of coupled motors, can."""
    never = np.isin(base.unknown.kinds, _NOT_NEGATIVE)
    return np.asarray(((base.grouping == 0.0) | ((base.grouping > 0.0) & never)).all(axis=1))


def _negative_doubts(fit: FittedLog, *, known: bool) -> list[Doubt]:
    """Negative friction and motor inertias: two at a joint indicate the sign of its torque, one another cause."""
    kinds = np.array(fit.base.unknown.kinds)[fit.base.kept]
    of_drive = np.isin(kinds, ("coulomb", "viscous", "motor_inertia"))
    parts = np.sqrt((fit.W**2).mean(axis=0)) * np.abs(fit.x)  # (nv, r) of each joint's torque
    torques = np.maximum(np.sqrt((fit.tau**2).mean(axis=0)), 1e-300)
    share = (parts / torques[:, None])[~fit.dead].max(axis=0)
    is_negative = fit.x < -_MIN_NEGATIVE_DEVIATIONS * fit.deviations
    groups = np.flatnonzero(of_drive & _is_never_negative(fit.base) & is_negative & (share > _MIN_NEGATIVE_SHARE))
    if known or not len(groups):
        return []
    doubts = list(_negative_values(fit, groups.tolist(), kinds))
    if _negative_matters(fit, groups):
        return doubts
    return [replace(one, level="note") for one in doubts]


def _negative_matters(fit: FittedLog, groups: Array) -> bool:
    """True if values of 0 in place of negative ones raise the residual of some joint in rows held out by 5 % of itself."""
    total, squares = reduce(operator.add, fit.fifths), np.zeros((2, len(fit.names)))
    for fifth in fit.fifths:
        others = total - fifth
        A, b = others.N.sum(axis=0), others.c.sum(axis=0)
        kept = np.delete(np.arange(len(b)), groups)
        prior = Prior(fit.prior.mean[kept], fit.prior.size[kept])
        x_zero = np.zeros(len(b))
        x_zero[kept] = prior.solve(A[np.ix_(kept, kept)], b[kept])
        squares += fifth.squares(fit.prior.solve(A, b)), fifth.squares(x_zero)
    return bool((squares[1] > (1.0 + _MIN_RESIDUAL_RISE) ** 2 * squares[0])[~fit.dead].any())


def _negative_values(fit: FittedLog, groups: Sequence[int], kinds: Array) -> Iterator[Doubt]:
    """Doubts about negative values of groups, by the joint of each."""
    owners = [fit.base.names[k].split(".")[0] for k in groups]
    count = Counter(owners)
    inertias, friction = dict[int, str](), dict[int, str]()  # joint of each group
    for k, joint in zip(groups, owners, strict=True):
        parameters = inertias if kinds[k] == "motor_inertia" else friction
        parameters[k] = joint
    # a wrong sign turns both; friction alone may be compensated
    turned = [name for name, n in count.items() if n > 1 and name in inertias.values()]
    if turned:
        evidence = "its friction and motor inertia come out negative"
        yield doubt("torque-sign", turned, level="refuse", named=listed(turned), evidence=evidence)
        return
    if friction:
        joints = sorted({*friction.values()}, key=fit.names.index)
        values = _values_text(fit, list(friction))
        if len(joints) > _MIN_SHARE_OF_JOINTS * (~fit.dead).sum():
            yield doubt("friction-compensated", joints, values=values)
        else:
            message = (
                f"friction cannot be negative, but the fit gives {values}: the logs determine too little of it, or the "
                "controller compensates it."
            )
            yield doubt("unexciting", joints, said=message)
    if inertias:
        joints = sorted({*inertias.values()}, key=fit.names.index)
        yield doubt("negative-inertia", joints, values=_values_text(fit, list(inertias)))


def _values_text(fit: FittedLog, groups: Sequence[int]) -> str:
    """First four of some groups with their values and deviations."""
    return ", ".join(f"{fit.base.names[k]} = {plus_minus(fit.x[k], fit.deviations[k])}" for k in groups[:4])


def _negative_energy(fit: FittedLog) -> list[Doubt]:
    """Negative kinetic energy ½ q̇' M(q) q̇ at some pose of the logs, at velocities q̇ like those of the logs."""
    from scipy.special import chdtri

    base, friction_speed = fit.base, fit.settings.friction_speed
    n = len(fit.names)
    q = fit.q[:: max(1, len(fit.q) // _POSES)]
    still = np.zeros((len(q), n))
    holding = base.unknown.columns(base.kept, q, still, still, friction_speed)
    inertial = np.empty((*holding.shape[:2], n, holding.shape[2]))
    for j, e in enumerate(np.eye(n)):
        inertial[:, :, j] = base.unknown.columns(base.kept, q, still, still + e, friction_speed) - holding
    speeds = np.sqrt((fit.speed**2).mean(axis=0)) * ~fit.dead
    M = np.einsum("mijr,r,i,j->mij", inertial, fit.x, speeds, speeds)
    energies, directions = np.linalg.eigh(0.5 * (M + M.swapaxes(1, 2)))
    dq = directions[..., 0] * speeds
    w = 0.5 * np.einsum("mijr,mi,mj->mr", inertial, dq, dq)
    deviation = np.sqrt(np.maximum(np.einsum("mr,rs,ms->m", w, fit.covariance, w), 0.0))
    quantile = np.sqrt(chdtri(n, _MAX_CHANCE))
    k = int(np.argmin(w @ fit.x + quantile * deviation))
    energy = float(w[k] @ fit.x)
    if energy >= -quantile * deviation[k] or -energy <= _MIN_NEGATIVE_SHARE * 0.5 * energies[k, -1]:
        return []
    share = np.abs(directions[k, :, 0])
    order = np.argsort(-share)
    names = fit.joints(order[share[order] > _MIN_SHARE_OF_DIRECTION * share.max()])
    values = f"a kinetic energy of {plus_minus(energy, float(deviation[k]))} J in a motion of {listed(names, 4)}"
    return [doubt("negative-inertia", names, values=values)]


def _residual_doubts(fit: FittedLog, *, known: bool, loud: bool) -> list[Doubt]:
    """Doubts about what remains; ``loud``: the motion determines too little, and the residual is far above the noise."""
    if known:
        return []
    held = fit.held_out
    doubts = left_unexplained(held, fit.trained)
    if not doubts and (held.all > _MAX_UNREPORTED or loud):
        live = fit.joints(np.flatnonzero(~fit.dead))
        worst = max(live, key=lambda name: held.joints[name])
        largest = percent(held.joints[worst], 3)
        when = _largest_at(held, list(held.joints).index(worst)) if loud else ""
        doubts.append(doubt("partly-unexplained", [worst], left=percent(held.all, 3), most=largest, when=when))
    joints = _poorly_predicted(fit)
    if joints and "refuse" not in _levels(doubts):
        message = listed([f"{name} to {percent(held.joints[name], 3)}" for name in joints], _MOST_JOINTS)
        doubts.append(doubt("unexplained-joint", joints, said=message))
    return doubts


def _residual_above_noise(fit: FittedLog) -> bool:
    """True if the training rows leave a joint's residual three times as large as its noise, and 5 % of its torque.

    The noise below the cut-off is that of white noise with the part above the cut-off that the torques have.
    """
    cutoff = fit.settings.cutoff
    high = np.zeros((0, len(fit.names)))
    for samples in chain.from_iterable(log.samples for log in fit.logs):
        if samples.rate > _MIN_RATE_OF_CUTOFF * cutoff:
            white = np.sqrt(cutoff / (0.5 * samples.rate - cutoff))
            high = np.concatenate([high, white * (samples.tau - low_pass(samples.tau, cutoff, samples.rate))])
    if not len(high):
        return False
    size = rms(fit.tau - fit.W @ fit.x)
    largest = np.maximum(_MIN_RATIO_TO_NOISE * rms(high), _MIN_SHARE_OF_TORQUE * rms(fit.tau))
    return bool((size > largest)[~fit.dead].any())


def _largest_at(held: HeldOut, joint: int) -> str:
    """Words for the time at which the residual of a joint is largest; empty for several logs."""
    largest, text = -1.0, ""
    for rows in held.rows:
        if rows.log.any():
            return ""
        if len(rows.time):
            residual = np.abs(rows.measured - rows.predicted)[:, joint]
            k = int(residual.argmax())
            if residual[k] > largest:
                largest, text = float(residual[k]), f", largest at t = {seconds(float(rows.time[k]), 4)} s"
    return text


def _poorly_predicted(fit: FittedLog) -> list[str]:
    """Joints whose residual in rows held out is a large share of their torque, and of their effort limit if they have one."""
    held, effort = fit.held_out, fit.base.unknown.model.limits.effort
    count = sum(len(rows.time) for rows in held.rows)
    residual = np.sqrt(held.squares / max(count, 1))
    small = np.isfinite(effort) & (residual <= _MAX_SHARE_OF_LIMIT * effort)
    live = ~fit.dead & (held.sizes > 0) & ~small
    shares = np.array(list(held.joints.values()))
    return fit.joints(np.flatnonzero(live & (shares > _MAX_UNEXPLAINED_OF_JOINT)))
