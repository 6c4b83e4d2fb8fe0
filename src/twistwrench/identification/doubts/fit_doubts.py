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
OTHERS = 2.5
"""Ratio of the residual of other logs to the residual of the training logs, above which the logs differ."""
NOTABLE_IN_OTHERS = 0.12
"""Residual of other logs, as a share of the torques, up to which they do not differ."""
LEFT_OUT = "rows-left-out"
"""Kind of the notes on omitted rows, which are listed separately from the doubts."""


def reading_doubts(doubts: Iterable[Doubt], log: str = "") -> Iterator[Doubt]:
    """Doubts found without a model; a doubt whose row in the table does not list ``identify`` becomes a note.

    ``log`` is the name of the log, for sentences; empty for a single log.
    """
    for found in doubts:
        if found.kind == LEFT_OUT:
            continue
        level = found.level
        sentence = found.sentence
        table_row = doubt_table()[found.kind]
        if "identify" not in table_row.reads:
            level = "note"
        if log:
            sentence = f"{log}: {sentence}"
        yield replace(found, level=level, sentence=sentence)


def left_unexplained(held_out: HeldOut, training: HeldOut) -> list[Doubt]:
    """Doubt about large residuals ``held_out`` of held-out rows, or about test logs that differ from the training logs.

    ``training`` are the residuals of the training logs, each fifth predicted from the others.
    """
    if held_out.all > _MAX_UNEXPLAINED:
        return [doubt("unexplained", left=percent(held_out.all, 3))]
    if held_out.kind == "test" and held_out.all > max(OTHERS * training.all, NOTABLE_IN_OTHERS):
        message = (
            f"the logs held out are explained to {percent(held_out.all, 3)}, the training logs among themselves to "
            f"{percent(training.all, 3)}"
        )
        return [doubt("other-torques", said=message, level="refuse")]
    return []


_MAX_UNDETERMINED_DEVIATION = 0.2
"""Deviation of a group, as a share of its largest plausible size, above which the motion leaves it undetermined."""
_MAX_UNDETERMINED_SHARE = 0.2
"""Largest share of undetermined groups."""
_UNSURE_TORQUE = 0.1
"""Maximum share of the torques of another motion that deviations of the groups may change."""
_MAX_RESIDUAL_WITHOUT_LINK = 0.5
"""Residual without a link, as a share of the residual with all links, below which the link is missing."""
_MAX_UNEXPLAINED_OF_JOINT = 0.1
"""Largest residual of a well predicted joint, as a share of its torque (rms)."""
_MAX_SHARE_OF_LIMIT = 0.01
"""Residual, as a share of a joint's effort limit, up to which it is small."""
_MAX_NAMED_JOINTS = 4
"""Largest number of joints, or of groups, that a doubt names."""
_MAX_NAMED_GROUPS = 3
"""Largest number of undetermined groups that a doubt names."""
_MIN_NEGATIVE_DEVIATIONS = 4.0
"""Standard deviations below zero from which a negative friction or motor inertia is reported."""
_MIN_NEGATIVE_SHARE = 1e-3
"""Share of a joint's torque (rms) from which a negative value is reported.

Errors of filters cause smaller negative values, and without noise the standard deviations do not cover them."""
_MIN_RESIDUAL_RISE = 0.05
"""Relative rise of a joint's held-out residual if negative values are set to 0, from which they are more than a note."""
_MIN_SHARE_OF_JOINTS = 0.5
"""Share of joints with negative friction from which a controller counts as compensating it: usually all joints."""
_MAX_CHANCE = 1e-6
"""Chance that noise makes a kinetic energy negative in some direction of one pose."""
_POSES = 50
"""Number of poses at which the kinetic energy is tested."""
_MIN_SHARE_OF_DIRECTION = 0.3
"""Part of a joint in a direction, as a share of the largest part, from which the joint is named."""
_MAX_UNREPORTED = 0.1
"""Share of the torques not explained by rigid bodies with friction, from which it is reported."""
_MIN_RATIO_TO_NOISE = 3.0
"""Ratio of a residual to the noise above which the residual is loud."""
_MIN_SHARE_OF_TORQUE = 0.05
"""Share of a joint's torque above which a residual is loud."""
_MIN_RATE_OF_CUTOFF = 4.0
"""Least sampling rate, as a multiple of the cut-off, that shows noise above the cut-off."""
_MODEL_FREE_REASONS = {"buffered", "copied", "saturated", "unexciting"}
"""Doubts found without a model that exclude a search for causes.

Residuals of such logs would be mistaken for other causes; a log at rest has nothing to explain."""


def doubts_of(fit: FittedLog) -> tuple[Doubt, ...]:
    """All doubts, those that reject the log first; insufficient motion is reported only without other doubts."""
    model_free_doubts: list[Doubt] = []
    for log in fit.logs:
        model_free_doubts += reading_doubts(log.doubts, log.name)
    model_free_doubts += column_doubts(fit)
    has_model_free_reason = not _MODEL_FREE_REASONS.isdisjoint(_kinds(model_free_doubts))
    is_spoiled = "refuse" in _levels(model_free_doubts) or has_model_free_reason
    cause_doubts = [] if is_spoiled else _cause_doubts(fit, model_free_doubts)
    has_known_cause = is_spoiled or bool(_levels(cause_doubts) - {"note"})
    doubts = [*model_free_doubts, *cause_doubts]
    if not has_known_cause:
        if not fit.payload_only:
            doubts += _missing_link(fit)
        motion_doubts = _unexciting(fit)
        if not motion_doubts:
            motion_doubts = _poor_predictions(fit)
        doubts += motion_doubts
    negative_doubts = _negative_doubts(fit, has_known_cause=has_known_cause)
    doubts += negative_doubts
    if not negative_doubts and not has_known_cause:
        doubts += _negative_energy(fit)
    if has_known_cause or "unexciting" not in _kinds(doubts):
        return sorted_doubts([*doubts, *_residual_doubts(fit, has_known_cause=has_known_cause, is_loud=False)])
    is_loud = _residual_above_noise(fit)
    residual_doubts = _residual_doubts(fit, has_known_cause=has_known_cause, is_loud=is_loud)
    if is_loud:
        return sorted_doubts([*residual_doubts, *doubts])  # more motion would not explain a loud residual
    return sorted_doubts([*doubts, *residual_doubts])


def _cause_doubts(fit: FittedLog, model_free_doubts: Sequence[Doubt]) -> list[Doubt]:
    """Doubts about the common gain and the causes of the residual; ``model_free_doubts`` were found before."""
    if fit.payload_only:
        return []
    doubts = [*gain_of_all(fit), *fit.causes]
    if "time-scale" in _kinds(doubts):  # accelerations by a wrong clock look like a common gain
        doubts = [found for found in doubts if found.kind != "gain" or found.joints != fit.names]
    has_other_doubt = bool(_levels([*model_free_doubts, *fit.causes]) - {"note"})
    if has_other_doubt:  # the free groups, with which the unit is compared, are then wrong too
        doubts = [found for found in doubts if found.kind != "unit"]
    return doubts


def _levels(doubts: Iterable[Doubt]) -> set[Level]:
    """Levels of doubts, each once."""
    return {found.level for found in doubts}


def _kinds(doubts: Iterable[Doubt]) -> set[str]:
    """Kinds of doubts, each once."""
    return {found.kind for found in doubts}


def sorted_doubts(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Doubts in the order of their levels: first doubts that reject the log, last notes."""
    levels = ("refuse", "unsure", "note")
    return tuple(sorted(doubts, key=lambda found: levels.index(found.level)))


def _missing_link(fit: FittedLog) -> list[Doubt]:
    """Doubt about a fixed link of the file without which the residual is far smaller, so that the robot does not carry it."""
    base = fit.base
    model = base.unknown.model
    drive_columns = fit.drive_columns
    Q, _ = np.linalg.qr(drive_columns.reshape(fit.tau.size, drive_columns.shape[2]))

    def squared_residual(values: Array) -> float:
        """Squares of the residual with given bodies and free drives."""
        residual = (fit.tau - fit.W @ base.project(values)).ravel()
        return float(residual @ residual - ((Q.T @ residual) ** 2).sum())

    squares_with_all = squared_residual(base.unknown.file_values)
    moving_links = {body.link for body in model.bodies}
    smallest_squares = _MAX_RESIDUAL_WITHOUT_LINK**2 * squares_with_all
    missing_link = ""
    for link, frame in model.frames.items():
        is_fixed_to_body = frame.body != BASE and link not in moving_links
        G = model.link_inertias.get(link)
        if not is_fixed_to_body or G is None or not G.mass > 0:
            continue
        values = _values_without(base, frame.body, G.in_frame(frame.pose))
        squares = squared_residual(values)
        if squares < smallest_squares:
            smallest_squares = squares
            missing_link = link
    if not missing_link:
        return []
    squared_torques = float((fit.tau**2).sum())
    share = percent(np.sqrt(smallest_squares / squared_torques), 3)
    share_with_all = percent(np.sqrt(squares_with_all / squared_torques), 3)
    return [doubt("missing-link", link=missing_link, left=share, whole=share_with_all)]


def _values_without(base: BaseParameters, body: int, G: SpatialInertia) -> Array:
    """Values of the file, minus an inertia of a body."""
    values = base.unknown.file_values.copy()
    columns = base.unknown.of_bodies  # of the regressor; -1 for drives
    of_body = columns // _PARAMETERS_OF_BODY == body
    values[of_body] -= G.parameters[columns[of_body] - _PARAMETERS_OF_BODY * body]
    return values


def _unexciting(fit: FittedLog) -> list[Doubt]:
    """Doubt about a motion that leaves many groups undetermined."""
    is_free = ~fit.base.held
    relative_deviations = fit.deviations / fit.prior.size
    is_undetermined = (fit.deviations > _MAX_UNDETERMINED_DEVIATION * fit.prior.size)[is_free]
    undetermined_count = int(is_undetermined.sum())
    if undetermined_count <= _MAX_UNDETERMINED_SHARE * len(is_undetermined):
        return []
    worst_first = np.argsort(-(relative_deviations * is_free))
    names = fit.first_parameters(worst_first[:_MAX_NAMED_GROUPS])
    determined_count = len(is_undetermined) - undetermined_count
    counts = f"{determined_count} of {len(is_undetermined)} groups of parameters"
    message = f"the motion determines only {counts}, least {names} and what is grouped with them: these keep the file's values."
    return [doubt("unexciting", said=message)]


def _poor_predictions(fit: FittedLog) -> list[Doubt]:
    """Doubt about joints whose torques would be poorly predicted in another motion, as fast as the logs and over the range."""
    W = fit.other_motion
    variance = np.einsum("njk,kl,njl->j", W, fit.covariance, W)  # of each joint's torque, summed over the motion
    squared_torques = ((W @ fit.x) ** 2).sum(axis=0)
    share = np.sqrt(np.maximum(variance, 0.0) / np.maximum(squared_torques, 1e-300))
    ranges = np.ptp(fit.q[:, : len(fit.names)], axis=0)
    share[fit.dead | (ranges == 0)] = 0.0
    worst_first = np.argsort(-share)
    joints = worst_first[share[worst_first] > _UNSURE_TORQUE].tolist()
    if not joints:
        return []
    shares = ", ".join(f"{fit.names[j]} {percent(share[j], 3)}" for j in joints[:_MAX_NAMED_JOINTS])
    worst_joint = joints[0]
    variance_by_group = (W[:, worst_joint] ** 2).sum(axis=0) * fit.covariance.diagonal()
    least_sure_first = np.argsort(-variance_by_group)
    least_sure = fit.first_parameters(least_sure_first[:_MAX_NAMED_GROUPS])
    message = (
        f"of another motion, as fast and over the whole range, torques would be predicted no better than to: {shares}. The "
        f"logs are too short or too narrow: they determine too little of {least_sure} and what is grouped with them."
    )
    return [doubt("unexciting", fit.joints(joints), said=message)]


_NOT_NEGATIVE = ("motor_inertia", "viscous", "coulomb", "stribeck", "m", "Ixx", "Iyy", "Izz")
"""Kinds of parameters that are never negative in a body or drive."""
_PARAMETERS_OF_BODY = 10
"""Number of inertial parameters of a body."""


def _is_never_negative(base: BaseParameters) -> Array:
    """(r,) mask of groups that are sums of parameters that are never negative.

    A group with a difference, as of coupled motors, can be negative.
    """
    is_never_negative = np.isin(base.unknown.kinds, _NOT_NEGATIVE)  # mask of parameters
    is_absent = base.grouping == 0.0
    is_allowed = is_absent | ((base.grouping > 0.0) & is_never_negative)
    return np.asarray(is_allowed.all(axis=1))


def _negative_doubts(fit: FittedLog, *, has_known_cause: bool) -> list[Doubt]:
    """Doubts about negative friction and motor inertias: two at one joint show a wrong sign of its torque."""
    kinds = np.array(fit.base.unknown.kinds)[fit.base.kept]
    of_drive = np.isin(kinds, ("coulomb", "viscous", "motor_inertia"))
    torques_by_group = np.sqrt((fit.W**2).mean(axis=0)) * np.abs(fit.x)  # (nv, r) rms
    torques = np.maximum(np.sqrt((fit.tau**2).mean(axis=0)), 1e-300)  # (nv,) rms
    shares = torques_by_group / torques[:, None]
    share = shares[~fit.dead].max(axis=0)  # of each group
    is_negative = (fit.x < -_MIN_NEGATIVE_DEVIATIONS * fit.deviations) & (share > _MIN_NEGATIVE_SHARE)
    groups = np.flatnonzero(of_drive & _is_never_negative(fit.base) & is_negative)
    if has_known_cause or not len(groups):
        return []
    doubts = list(_negative_values(fit, groups.tolist(), kinds))
    if _negative_matters(fit, groups):
        return doubts
    return [replace(found, level="note") for found in doubts]


def _negative_matters(fit: FittedLog, groups: Array) -> bool:
    """True if zeros in place of these ``groups`` raise the held-out residual of some joint by over 5 %."""
    total = reduce(operator.add, fit.fifths)
    # Squares of held-out residuals of each joint:
    squares = np.zeros(len(fit.names))
    squares_with_zeros = np.zeros(len(fit.names))
    for fifth in fit.fifths:
        other_fifths = total - fifth
        A = other_fifths.N.sum(axis=0)
        b = other_fifths.c.sum(axis=0)
        kept_groups = np.delete(np.arange(len(b)), groups)
        prior = Prior(fit.prior.mean[kept_groups], fit.prior.size[kept_groups])
        x_with_zeros = np.zeros(len(b))
        x_with_zeros[kept_groups] = prior.solve(A[np.ix_(kept_groups, kept_groups)], b[kept_groups])
        squares += fifth.squares(fit.prior.solve(A, b))
        squares_with_zeros += fifth.squares(x_with_zeros)
    is_higher = squares_with_zeros > (1.0 + _MIN_RESIDUAL_RISE) ** 2 * squares
    return bool(is_higher[~fit.dead].any())


def _negative_values(fit: FittedLog, groups: Sequence[int], kinds: Array) -> Iterator[Doubt]:
    """Doubts about negative values of groups, by joint; ``kinds`` (r,) are the kinds of the groups' first parameters."""
    joint_of_group: dict[int, str] = {}
    joint_of_inertia: dict[int, str] = {}  # by group
    joint_of_friction: dict[int, str] = {}  # by group
    for k in groups:
        joint, _, _ = fit.base.names[k].partition(".")
        joint_of_group[k] = joint
        if kinds[k] == "motor_inertia":
            joint_of_inertia[k] = joint
        else:
            joint_of_friction[k] = joint
    # A wrong sign turns friction and inertia; friction alone may be compensated.
    count_by_joint = Counter(joint_of_group.values())
    inertia_joints = set(joint_of_inertia.values())
    turned_joints = [joint for joint, count in count_by_joint.items() if count > 1 and joint in inertia_joints]
    if turned_joints:
        evidence = "its friction and motor inertia come out negative"
        yield doubt("torque-sign", turned_joints, level="refuse", named=listed(turned_joints), evidence=evidence)
        return
    if joint_of_friction:
        joints = sorted({*joint_of_friction.values()}, key=fit.names.index)
        values = _values_text(fit, list(joint_of_friction))
        if len(joints) > _MIN_SHARE_OF_JOINTS * (~fit.dead).sum():
            yield doubt("friction-compensated", joints, values=values)
        else:
            message = (
                f"friction cannot be negative, but the fit gives {values}: the logs determine too little of it, or the "
                "controller compensates it."
            )
            yield doubt("unexciting", joints, said=message)
    if joint_of_inertia:
        joints = sorted(inertia_joints, key=fit.names.index)
        yield doubt("negative-inertia", joints, values=_values_text(fit, list(joint_of_inertia)))


def _values_text(fit: FittedLog, groups: Sequence[int]) -> str:
    """Text of the first of some groups, with their values and deviations."""
    texts = [f"{fit.base.names[k]} = {plus_minus(fit.x[k], fit.deviations[k])}" for k in groups[:_MAX_NAMED_JOINTS]]
    return ", ".join(texts)


def _negative_energy(fit: FittedLog) -> list[Doubt]:
    """Doubt about a negative kinetic energy ½ q̇' M(q) q̇ at some pose of the logs.

    At each pose, q̇ is the direction with the least energy, with speeds as in the logs.
    """
    from scipy.special import chdtri

    base = fit.base
    friction_speed = fit.settings.friction_speed
    n = len(fit.names)
    row_step = max(1, len(fit.q) // _POSES)
    q = fit.q[::row_step]
    zeros = np.zeros((len(q), n))
    static_columns = base.unknown.columns(base.kept, q, zeros, zeros, friction_speed)
    # M_ij is torque i for unit acceleration j, and linear in the groups: these are its columns (m, n, n, r).
    M_columns = np.empty((*static_columns.shape[:2], n, static_columns.shape[2]))
    for j, e in enumerate(np.eye(n)):
        columns = base.unknown.columns(base.kept, q, zeros, zeros + e, friction_speed)
        M_columns[:, :, j] = columns - static_columns
    speeds = np.sqrt((fit.speed**2).mean(axis=0)) * ~fit.dead
    M = np.einsum("mijr,r,i,j->mij", M_columns, fit.x, speeds, speeds)  # for velocities in units of the speeds
    doubled_energies, directions = np.linalg.eigh(0.5 * (M + M.swapaxes(1, 2)))
    dq = directions[..., 0] * speeds  # with the least energy
    energy_columns = 0.5 * np.einsum("mijr,mi,mj->mr", M_columns, dq, dq)
    variances = np.einsum("mr,rs,ms->m", energy_columns, fit.covariance, energy_columns)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    quantile = np.sqrt(chdtri(n, _MAX_CHANCE))
    worst_pose = int(np.argmin(energy_columns @ fit.x + quantile * deviations))
    energy = float(energy_columns[worst_pose] @ fit.x)
    deviation = float(deviations[worst_pose])
    largest_energy = 0.5 * doubled_energies[worst_pose, -1]
    is_significant = energy < -quantile * deviation
    if not is_significant or -energy <= _MIN_NEGATIVE_SHARE * largest_energy:
        return []
    parts = np.abs(directions[worst_pose, :, 0])  # of the joints in the direction
    largest_first = np.argsort(-parts)
    is_large = parts[largest_first] > _MIN_SHARE_OF_DIRECTION * parts.max()
    names = fit.joints(largest_first[is_large])
    values = f"a kinetic energy of {plus_minus(energy, deviation)} J in a motion of {listed(names, 4)}"
    return [doubt("negative-inertia", names, values=values)]


def _residual_doubts(fit: FittedLog, *, has_known_cause: bool, is_loud: bool) -> list[Doubt]:
    """Doubts about the residual in held-out rows; none if the residual has a known cause.

    ``is_loud`` is True if the motion determines too little, and the residual is far above the noise.
    """
    if has_known_cause:
        return []
    held_out = fit.held_out
    doubts = left_unexplained(held_out, fit.trained)
    if not doubts and (held_out.all > _MAX_UNREPORTED or is_loud):
        live_joints = fit.joints(np.flatnonzero(~fit.dead))
        worst_joint = max(live_joints, key=lambda joint: held_out.joints[joint])
        when = _largest_at(held_out, list(held_out.joints).index(worst_joint)) if is_loud else ""
        share = percent(held_out.all, 3)
        share_of_worst = percent(held_out.joints[worst_joint], 3)
        doubts.append(doubt("partly-unexplained", [worst_joint], left=share, most=share_of_worst, when=when))
    joints = _poorly_predicted(fit)
    if joints and "refuse" not in _levels(doubts):
        message = listed([f"{joint} to {percent(held_out.joints[joint], 3)}" for joint in joints], _MAX_NAMED_JOINTS)
        doubts.append(doubt("unexplained-joint", joints, said=message))
    return doubts


def _residual_above_noise(fit: FittedLog) -> bool:
    """True if the residual of some joint in training rows exceeds three times the joint's noise, and 5 % of its torque.

    Noise is assumed to be white. The noise below the cut-off follows from the torques above the cut-off, by the ratio of both
    frequency ranges.
    """
    cutoff = fit.settings.cutoff
    noise = np.zeros((0, len(fit.names)))
    for samples in chain.from_iterable(log.samples for log in fit.logs):
        if samples.rate > _MIN_RATE_OF_CUTOFF * cutoff:
            ratio_below = np.sqrt(cutoff / (0.5 * samples.rate - cutoff))
            torques_above = samples.tau - low_pass(samples.tau, cutoff, samples.rate)
            noise = np.concatenate([noise, ratio_below * torques_above])
    if not len(noise):
        return False
    residual = rms(fit.tau - fit.W @ fit.x)
    max_quiet = np.maximum(_MIN_RATIO_TO_NOISE * rms(noise), _MIN_SHARE_OF_TORQUE * rms(fit.tau))
    return bool((residual > max_quiet)[~fit.dead].any())


def _largest_at(held_out: HeldOut, joint: int) -> str:
    """Text of the time at which the residual of a joint is largest; empty for several logs."""
    largest_residual = -1.0
    text = ""
    for rows in held_out.rows:
        is_of_several_logs = rows.log.any()  # the first has index 0
        if is_of_several_logs:
            return ""
        if len(rows.time):
            residual = np.abs(rows.measured[:, joint] - rows.predicted[:, joint])
            k = int(residual.argmax())
            if residual[k] > largest_residual:
                largest_residual = float(residual[k])
                text = f", largest at t = {seconds(float(rows.time[k]), 4)} s"
    return text


def _poorly_predicted(fit: FittedLog) -> list[str]:
    """Joints whose held-out residual is a large share of their torque and, if they have one, of their effort limit."""
    held_out = fit.held_out
    effort = fit.base.unknown.model.limits.effort
    row_count = sum(len(rows.time) for rows in held_out.rows)
    residual = np.sqrt(held_out.squares / max(row_count, 1))  # rms
    is_small = np.isfinite(effort) & (residual <= _MAX_SHARE_OF_LIMIT * effort)
    has_torque = ~fit.dead & (held_out.sizes > 0)
    shares = np.array(list(held_out.joints.values()))
    is_unexplained = shares > _MAX_UNEXPLAINED_OF_JOINT
    return fit.joints(np.flatnonzero(has_torque & ~is_small & is_unexplained))
